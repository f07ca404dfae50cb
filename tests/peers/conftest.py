"""How the cases of other solvers are run: by both engines, and by two unrelated methods."""

import pytest

import mems_impact as mi

WAYS = {
    "adams": mi.Options(engine="interpreted"),
    "dop853": mi.Options(engine="interpreted", method="dop853"),
    "compiled": mi.Options(),  # what nobody chooses: each system compiles for a second or two
}


@pytest.fixture(
    params=[pytest.param(way, marks=pytest.mark.slow) if way == "compiled" else way for way in WAYS]
)
def options(request):
    return WAYS[request.param]
