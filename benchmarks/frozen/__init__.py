"""Decisions on records of all kinds, kept from one day, compared with those of today: `python -m benchmarks.frozen`."""
