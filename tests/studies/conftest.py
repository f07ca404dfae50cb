import multiprocessing
import signal

import pytest


@pytest.fixture(scope="session")
def forking():
    """Give a context whose processes start at once, from one that has imported what they need."""
    if "forkserver" not in multiprocessing.get_all_start_methods():  # Windows
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(
        [
            "mems_impact.studies.engine.scheduler",
            "mems_impact.studies.engine.store",
            "pyarrow.parquet",
            "sksundae",
        ]
    )
    return context


@pytest.fixture
def heard_in_background():
    """A shell has what it puts into the background ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
