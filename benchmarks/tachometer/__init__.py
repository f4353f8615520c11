"""A pulse a revolution, known to a sample: speeds, widths of the pulse, rates, steady and not, by one command."""
