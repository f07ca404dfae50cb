"""Settings of all tests."""

import gc
from collections import Counter

import pytest
from hypothesis import HealthCheck, settings

# Drawing is slow on a busy machine, which is no fault of a test.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

# Collecting and compiling make many objects that stay. With Python's thresholds the garbage
# collector scans them so often that it takes a tenth of the processor time.
gc.set_threshold(50_000, 20, 50)


@pytest.hookimpl(tryfirst=True)  # before cases are selected by their marks
def pytest_collection_modifyitems(items):
    """Mark the cases of a test by their order.

    Cases beyond those that `quick` gives are slow. Cases of a slow test beyond the first are for
    the nightly run, unless each has a subject of its own (`slow(all=True)`).
    """
    counts = Counter()
    for item in items:
        test = item.nodeid.partition("[")[0]
        quick, slow = item.get_closest_marker("quick"), [*item.iter_markers("slow")]
        counts[test] += 1
        first = counts[test] <= (quick.args[0] if quick else 1)
        if (quick or slow) and not (first or any(mark.kwargs.get("all") for mark in slow)):
            item.add_marker("nightly")
        if item.get_closest_marker("nightly"):
            item.add_marker("slow")


def pytest_sessionfinish():
    """Collect what is garbage once, not at each of several ends: of pytest, and of Python."""
    gc.collect()
    gc.freeze()
