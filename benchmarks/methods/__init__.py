"""Methods of the literature on the same records: free decays, measured inputs, outputs alone."""
