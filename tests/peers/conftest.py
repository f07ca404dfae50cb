"""How the cases of other solvers are run: by both engines, and by two unrelated methods."""

import pytest

import mems_impact as mi

WAYS = {
    "dop853": mi.Options(engine="interpreted", method="dop853"),
    "adams": mi.Options(engine="interpreted"),
    "compiled": mi.Options(),  # what nobody chooses: each system compiles for a second or two
}


@pytest.fixture(
    params=[way if way == "dop853" else pytest.param(way, marks=pytest.mark.slow) for way in WAYS]
)
def options(request):
    return WAYS[request.param]
