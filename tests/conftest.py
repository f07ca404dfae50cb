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
    """Mark the cases of a test beyond the first ones that `quick` gives as slow."""
    counts = Counter()
    for item in items:
        quick = item.get_closest_marker("quick")
        if quick and not item.get_closest_marker("slow"):
            test = item.nodeid.partition("[")[0]
            counts[test] += 1
            if counts[test] > quick.args[0]:
                item.add_marker("slow")


def pytest_sessionfinish():
    """Collect what is garbage once, not at each of several ends: of pytest, and of Python."""
    gc.collect()
    gc.freeze()
