"""Records that try to make the chain wrong, with truth from their own equations: `python -m benchmarks.adversary`."""
