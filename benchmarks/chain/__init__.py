"""The whole chain on hard records of known truth, what it finds and what it takes: `python -m benchmarks.chain`."""
