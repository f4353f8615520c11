"""A(t) whose structure is found, on random mechanical systems of known A(t): `python -m benchmarks.structure`."""
