"""Search for modes and their harmonics: one objective, one list of moves."""
