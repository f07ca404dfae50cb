"""A function that raises on every path is reported by its exception, whichever engine meets it."""

import pytest

import mems_impact as mi


def refusing(mode, t, y, p):
    raise ValueError("no data")


def decaying(mode, t, y, p):
    return (-1.0,)


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("engine", ["auto", "interpreted"])
@pytest.mark.parametrize(
    "functions",
    [
        {"flow": refusing},
        {"guards": [mi.Guard("zero", lambda mode, t, y, p: y.x, refusing)]},
        {"period": 1.0, "switches": (0.5,), "switch_transition": refusing},
    ],
)
def test_a_function_that_only_raises(functions, engine):
    def run():
        system = mi.System(states=("x",), **{"flow": decaying, **functions})
        start = {"x": 0.0 if "flow" in functions else 0.2}
        length = {"periods": 2} if system.forced else {"duration": 1.0}
        mi.simulate(system, initial=start, options=mi.Options(engine=engine), **length)

    errors = mi.FunctionError, mi.RunError
    with pytest.raises(errors, match="raises ValueError: no data") as caught:
        run()
    assert "test_exceptions.py, line" in str(caught.value)


def test_friction_that_raises_where_a_run_starts():
    friction = mi.Friction("ground", "x", mu=lambda u, p: refusing(0, 0.0, u, p))
    with pytest.raises(mi.FunctionError, match="raises ValueError: no data"):
        mi.System(states=("x",), flow=decaying, parts=[friction])
