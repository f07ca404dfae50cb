"""Identity of systems: stores of studies recognize whatever results depend on."""

import math
from types import SimpleNamespace

import pytest

import mems_impact as mi
from mems_impact.systems.serialization.identity import identity

INTERPRETED = mi.Options(engine="interpreted", method="dop853")


def driven(stiffness=lambda: 1.0, period=lambda p: 2.0 * math.pi / p.omega):
    def flow(mode, t, y, p):
        return y.v, math.cos(p.omega * t) - 0.1 * y.v - stiffness() * y.x

    return mi.System(flow=flow, states=("x", "v"), parameters={"omega": 1.0}, period=period)


def of_dict():
    values = {"k": 1.0, "own": None}
    values["own"] = values
    return (lambda: values["k"]), lambda k: values.update(k=k)


def of_nested_list():
    values = ([1.0],)
    return (lambda: values[0][0]), lambda k: values[0].__setitem__(0, k)


def of_object():
    values = SimpleNamespace(k=1.0)
    return (lambda: values.k), lambda k: setattr(values, "k", k)


@pytest.mark.parametrize("made", [of_dict, of_nested_list, of_object])
def test_a_store_refuses_a_system_whose_functions_read_something_else_now(tmp_path, made):
    stiffness, change = made()
    system = driven(stiffness)

    def compute():
        length = {"transient": 2, "periods": 1, "options": INTERPRETED}
        mi.sweep(system, "omega", [1.0, 2.0], **length, store=tmp_path)

    compute()
    compute()
    change(2.0)
    with pytest.raises(mi.InvalidFile, match="holds another study: functions is"):
        compute()


def test_lists_and_dicts_enter_by_their_contents():
    one, other = of_dict()[0], of_dict()[0]
    assert identity(driven(one), INTERPRETED) == identity(driven(other), INTERPRETED)


def test_functions_of_times_enter():
    period = driven(period=lambda p: 2.0 * math.pi / p.omega * (2.0 if p.omega > 1.0 else 1.0))
    assert period.numbers().period == driven().numbers().period
    one, other = (identity(each, INTERPRETED) for each in (period, driven()))
    assert one["functions"] != other["functions"]
