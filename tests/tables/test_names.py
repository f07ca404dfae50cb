"""Names of users that are columns of tables, too."""

import math

import pytest

import mems_impact as mi


@pytest.mark.parametrize(("parameter", "quantity"), [("stable", "energy"), ("a", "stable")])
def test_a_second_column_of_a_name_is_refused(parameter, quantity):
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p[0] * math.cos(t) - y.v - y.x),
        parameters={parameter: 1.0},
        period=2.0 * math.pi,
        observables=[mi.Observable(quantity, lambda y, p: y.x**2)],
    )
    plain = mi.Options(engine="interpreted", method="dop853")
    orbit = mi.find_orbit(system, transient=30, periods=1, options=plain)
    branch = mi.continue_solution(orbit, parameter, stop=1.1)
    with pytest.raises(mi.InvalidParameter, match="two columns of the table would have this"):
        _ = branch.table, branch.special_table
