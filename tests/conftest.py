"""Settings of all tests."""

import gc
import subprocess
import sys
from collections import Counter
from importlib.util import find_spec

import pytest
from hypothesis import HealthCheck, settings

# Drawing is slow on a busy machine, which is no fault of a test.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

# Collecting and compiling make many objects that stay. With Python's thresholds the garbage
# collector scans them so often that it takes a tenth of the processor time.
gc.set_threshold(50_000, 20, 50)

if find_spec("heyoka") is None:  # the judge, whose wheels are for Linux
    collect_ignore = [
        *("campaign", "judges", "export/test_actuators.py"),
        *("actuator/test_verilog_a.py", "actuator/terms/test_terms.py"),
    ]


def pytest_configure(config):
    """Compile the event loop once for all workers that run the whole set."""
    is_worker, is_whole = hasattr(config, "workerinput"), config.args_source.name != "ARGS"
    if is_whole and not is_worker and getattr(config.option, "numprocesses", None):
        subprocess.run([sys.executable, "-m", "mems_impact.hybrid.precompilation"], check=True)


@pytest.hookimpl(tryfirst=True)  # before cases are selected by their marks
def pytest_collection_modifyitems(items):
    """Mark the cases of a test by their order.

    Cases beyond those that `quick` gives are slow. All but the first case of a slow test, or the
    last case of a quick one, are for the nightly run, unless each has a subject of its own
    (`slow(all=True)`).
    """
    tests = [item.nodeid.partition("[")[0] for item in items]
    totals, counts = Counter(tests), Counter()
    for item, test in zip(items, tests, strict=True):
        quick, slow = item.get_closest_marker("quick"), [*item.iter_markers("slow")]
        counts[test] += 1
        if quick and counts[test] > quick.args[0]:
            item.add_marker("slow" if counts[test] == totals[test] else "nightly")
        elif slow and counts[test] > 1 and not any(mark.kwargs.get("all") for mark in slow):
            item.add_marker("nightly")
        if item.get_closest_marker("nightly"):
            item.add_marker("slow")


def pytest_sessionfinish():
    """Collect what is garbage once, not at each of several ends: of pytest, and of Python."""
    gc.collect()
    gc.freeze()
