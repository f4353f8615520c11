"""floquid: identification of linear time-periodic systems from measured responses."""

__version__ = "0.1.0"
