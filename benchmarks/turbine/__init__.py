"""A turbine-like system from its outputs alone, over many draws: two masses, coloured forces, lines of 1P and 3P."""
