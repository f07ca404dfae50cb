import pickle

import pytest

import mems_impact as mi
from mems_impact import errors

RUN_ERROR = mi.RunError(
    reason="too many events",
    remedy="raise max_events",
    cycle=12,
    phase_time=0.5,
    mode="stuck-free",
    state={"x2": 0.25, "v2": -1.0},
    partial=[1, 2, 3],
)
HUGE = 10**5000  # more digits than Python agrees to print
ERRORS = [
    mi.InvalidParameter("delta", 1.2, "between 0 and d = 1 (exclusive)", "my.toml"),
    mi.InvalidParameter("m1", None, "> 0", problem="missing"),
    mi.InvalidFile("my.toml", "is a directory", "give a file"),
    RUN_ERROR,
    mi.EngineUnavailable("no C API", "use the interpreted engine"),
    mi.FunctionError("flow 'fall'", "returns 3 numbers", "return 2", "/a/ball.py", 7),
    mi.FunctionsMissing("run.zip does not hold the functions of its system"),
    mi.FileNotWritten("table.csv", "no space left on device", "make room"),
    mi.OrbitError("no orbit", "take another guess", [1, 2, 3]),
    mi.WorkersLost("a process was killed", "try again", "2 of 5 points", [1, 2]),
]
INTERRUPTION = mi.Interrupted("sweep", "2 of 5 points", [1, 2])


def test_all_errors_are_listed_and_pickled():
    own = {
        kind
        for kind in vars(errors).values()
        if isinstance(kind, type) and kind.__module__ == errors.__name__
    }
    warnings = {kind for kind in own if issubclass(kind, Warning)}
    raised = {type(error) for error in [*ERRORS, INTERRUPTION]}
    assert own - warnings - {errors.Picklable, mi.MemsImpactError} == raised
    assert {kind.__name__ for kind in own} - {"Picklable"} <= set(errors.__all__)


@pytest.mark.parametrize("error", [*ERRORS, INTERRUPTION], ids=lambda error: type(error).__name__)
def test_pickling_keeps_message_and_attributes(error):
    error.add_note("in point 7 of the sweep")
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)


def test_an_interruption_has_progress_and_partial_result():
    assert isinstance(INTERRUPTION, KeyboardInterrupt)
    assert str(INTERRUPTION) == (
        "sweep interrupted after 2 of 5 points; .partial is the result so far"
    )
    attributes = INTERRUPTION.work, INTERRUPTION.after, INTERRUPTION.partial
    assert attributes == ("sweep", "2 of 5 points", [1, 2])


@pytest.mark.parametrize(
    ("kind", "base"),
    [
        (mi.InvalidParameter, ValueError),
        (mi.InvalidFile, ValueError),
        (mi.RunError, RuntimeError),
        (mi.EngineUnavailable, ImportError),
    ],
)
def test_tree(kind, base):
    assert issubclass(kind, mi.MemsImpactError)
    assert issubclass(kind, base)


def test_fallback_is_a_warning_not_an_error():
    assert issubclass(mi.EngineFallbackWarning, UserWarning)
    assert not issubclass(mi.EngineFallbackWarning, mi.MemsImpactError)


def test_invalid_parameter_message():
    error = mi.InvalidParameter("delta", 1.2, "between 0 and d = 1 (exclusive)")
    assert str(error) == "delta = 1.2: must be between 0 and d = 1 (exclusive)"
    located = error.located("my.toml")
    assert str(located) == f"{error} [in my.toml]"
    assert located.source == "my.toml"
    assert error.source is None


def test_messages_carry_the_remedy():
    assert str(mi.InvalidFile("a.toml", "is a directory", "give a file")) == (
        "a.toml: is a directory; give a file"
    )
    assert str(mi.EngineUnavailable("no C API", "do this")) == "no C API; do this"


def test_run_error_says_where():
    assert str(RUN_ERROR) == (
        "too many events (cycle 12, phase time 0.5, mode stuck-free, x2 = 0.25, v2 = -1);"
        " raise max_events"
    )


@pytest.mark.parametrize("value", ["a\nb", [[1]] * 500, HUGE, "x" * 500, None, object()], ids=type)
@pytest.mark.parametrize("name", ["m1", "", "a\nb", "x" * 500])
def test_messages_stay_on_one_short_line(name, value):
    error = mi.InvalidParameter(name, value, "a number", name)
    assert "\n" not in str(error)
    assert len(str(error)) < 800
    assert str(mi.InvalidFile(name, "bad", "mend it")).count("\n") == 0
