"""Free responses of simulated machines, identified and held against their own equations."""
