"""Ours and other people's identifiers on the same responses in one run: time, accuracy, and what had to be chosen."""
