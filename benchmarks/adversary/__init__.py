"""Records that try to make the chain wrong, with truth from equations of their own: `python -m benchmarks.adversary`."""
