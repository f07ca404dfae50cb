"""Settings of all tests."""

import gc

from hypothesis import HealthCheck, settings

# Drawing is slow on a busy machine, which is no fault of a test.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

# Collecting and compiling make many objects that stay. With Python's thresholds the garbage
# collector scans them so often that it takes a tenth of the processor time.
gc.set_threshold(50_000, 20, 50)


def pytest_sessionfinish():
    """Collect what is garbage once, not at each of several ends: of pytest, and of Python."""
    gc.collect()
    gc.freeze()
