"""What holds for every test: figures without a screen, and hypothesis that draws the same examples each time."""

import gc
import os
import re
from collections import Counter

import pytest
from hypothesis import HealthCheck, settings

os.environ["MPLBACKEND"] = "Agg"

LOOKED_AT = re.compile(r"tests/browser/|tests/docs/test_blocks\.py::test_page\b")
REPEATED = re.compile(r"tests/statistics/|benchmarks/(?!frozen/)\w+/")

# No time is ever asserted: neither a deadline nor hypothesis' own complaint about slow data.
settings.register_profile(
    "fixed",
    max_examples=10,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "explore", deadline=None, max_examples=2000, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("fixed")


# Modules and tests are there to the end: the collector of cycles need not look at a million objects again and again.
# Later it seldom looks either: of the usual 700 objects a tenth of the time went there.
gc.disable()
gc.set_threshold(100_000, 20, 20)


def pytest_collection_finish():
    gc.freeze()
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Statistics and the paper's experiment are slow; of a test marked `first` all sets of parameters but the first.

    Pages have a target: `make pages` makes the report, opens it in a browser, and runs the blocks of every page.
    """
    seen = Counter()
    for item in items:
        if LOOKED_AT.search(item.nodeid):
            item.add_marker(pytest.mark.pages)
        if REPEATED.search(item.nodeid):
            item.add_marker(pytest.mark.slow)
        few = item.get_closest_marker("first")
        if few is not None:
            name = item.nodeid.partition("[")[0]
            seen[name] += 1
            if seen[name] > few.args[0]:
                item.add_marker(pytest.mark.slow)
