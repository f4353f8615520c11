"""Systems drawn at random, with measured inputs and of outputs alone: what comes of their records."""
