"""How often the order is right, and what is lost, over random systems of known truth: `python -m benchmarks.order`."""
