"""Whether a function reads the time, by its code."""

import math

import pytest

from mems_impact.hybrid.time_dependence import reads_time


def still(mode, t, y, p):
    return (y.v,)


def wave(mode, t, y, p):
    return math.sin(t)


def passes_on(mode, t, y, p):
    return still(mode, t, y, p)


def passes_on_by_name(mode, t, y, p):
    return still(p=p, mode=mode, t=t, y=y)[0]


def passes_on_in_other_units(mode, t, y, p):
    hours = t / 3600.0
    return still(mode, hours, y if y.v > 0.0 else p, p)


def passes_on_to_a_wave(mode, t, y, p):
    return wave(mode, t / 3600.0, y, p)


def branches(mode, t, y, p):
    return (1.0,) if t > 20.0 else (0.0,)


def closes_over(mode, t, y, p):
    return sum([t * k for k in range(3)])


def writes(mode, t, y, p, dy):
    dy[0] = t


def recurs(mode, t, y, p):
    return recurs(mode, t, y, p) if y > 0.0 else 1.0


def takes_all(mode, *rest):
    return rest[1]


def closure(inner):
    return lambda mode, t, y, p: inner(mode, t, y, p)


@pytest.mark.parametrize(
    ("function", "reads"),
    [
        (still, False),
        (wave, True),
        (passes_on, False),
        (passes_on_by_name, False),
        (passes_on_in_other_units, False),
        (passes_on_to_a_wave, True),
        (branches, True),
        (closes_over, True),
        (writes, True),
        (recurs, False),
        (takes_all, True),
        (closure(still), False),
        (closure(wave), True),
        (math.sin, True),
    ],
)
def test_a_function_reads_the_time(function, reads):
    assert reads_time(function) == reads


def test_functions_that_do_not_count():
    visited = set()
    assert reads_time(wave, visited)
    assert not reads_time(passes_on_to_a_wave, set(visited))
    assert reads_time(branches, set(visited))
