"""Functions of a module, which processes can be sent."""

import os
from pathlib import Path


def double(job):
    return 2 * job


def dies(job):
    """Ends its process: of "always" each time, of the path of a file that is not there yet the first time."""
    if job == "always":
        os._exit(7)
    if isinstance(job, Path) and not job.exists():
        job.touch()
        os._exit(7)
    return str(job)


def raises(job):
    raise RuntimeError(f"lost {job}.")
