"""Short decays of many hits: identified, and held against integration."""
