"""Sweeps of any system."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from mems_impact.plotting.labels import PANEL_LETTER
from tests.analysis.systems import oscillator
from tests.plotting.sweeps import silent_table, sweep_table


def drawn(ax, marker):
    lines = [line for line in ax.lines if line.get_marker() == marker]
    return sorted(x for line in lines for x in line.get_xdata())


@pytest.mark.slow
@pytest.mark.parametrize("section", [None, ("x", 0.5)])
def test_own_system(section, tmp_path):
    units = {"A": "N", "x": "m", "v": "m/s", "speed": "m/s"}
    system = oscillator(section=section, units=units)
    sweep = mi.sweep(system, "A", np.linspace(0.35, 0.4, 3), transient=60, periods=4)
    ax = mi.plot_sweep(sweep)
    above, speed, energy = ax.figure.axes
    assert above is ax
    words = "$x$ [m] where periods begin" if section is None else "$v$ [m/s] at $x = 0.5$"
    assert above.get_ylabel() == words
    assert speed.get_ylabel() == "speed [mm/s]"
    assert energy.get_ylabel().startswith("energy")
    assert energy.get_xlabel() == "$A$ [mN]"
    assert drawn(above, "o") == list(sweep.table["A"])
    assert mi.plot_sweep(sweep, quantity="impacts per period").figure.axes[1:] == []
    ax.figure.savefig(tmp_path / "sweep.png")


@pytest.mark.quick(1)
@pytest.mark.parametrize("statuses", [("ok", "ok", "ok"), ("ok", "lost", "ok")])
def test_switches_are_marked(statuses, tmp_path):
    ax = mi.plot_sweep(sweep_table(statuses))
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend[:2] == ["$f$ increased", "$f$ decreased"]
    before = (0.3, 0.1) if "lost" in statuses else (0.2, 0.2)
    expected = [f"off at $f$ = 0.1 to {before[0]:g}", f"on at $f$ = {before[1]:g} to 0.3"]
    assert legend[-2:] == expected
    marked = {line.get_label(): line.get_xdata()[0] for line in ax.lines}
    assert (marked[legend[-2]], marked[legend[-1]]) == (0.1, 0.3)
    assert ("failed" in legend) == ("lost" in statuses)
    ax.figure.savefig(tmp_path / "sweep.png")


def test_switches_have_the_unit_of_the_parameter():
    table = sweep_table(("ok", "ok", "ok"))
    table.attrs = {**table.attrs, "units": {table.columns[0]: "V"}}
    legend = [text.get_text() for text in mi.plot_sweep(table).get_legend().get_texts()]
    assert legend[-2:] == ["off at $f$ = 0.1 to 0.2 V", "on at $f$ = 0.2 to 0.3 V"]


@pytest.mark.slow
def test_values_that_never_cross_the_section(tmp_path):
    ax = mi.plot_sweep(silent_table())
    assert drawn(ax, "v") == [0.1, 0.1]  # one for each direction
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend[:3] == ["$f$ increased", "$f$ decreased", "no crossing of $x_2 = 0$"]
    ax.figure.savefig(tmp_path / "sweep.png")


@pytest.mark.parametrize(("periods", "missing"), [(1, True), (3, False)])
def test_a_part_without_a_crossing_is_no_motion_without_one(periods, missing):
    # The period is three forcing periods, with one rising zero.
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.k * y.x),
        parameters={"k": 1.0 / 9.0},
        period=2.0 * np.pi,
        section=("x", 0.0),
        initial={"x": 0.1, "v": 1.0 / 3.0},
    )
    sweep = mi.sweep(system, "k", [1.0 / 9.0], transient=1, periods=periods)
    legend = mi.plot_sweep(sweep).get_legend().get_texts()
    assert ("no crossing of $x = 0$" in [text.get_text() for text in legend]) == missing


def test_statistics_stand_below_the_state():
    top, step, speed = mi.plot_sweep(silent_table()).figure.axes
    assert [ax.get_ylabel() for ax in (top, step, speed)] == [
        "$v_2$ at $x_2 = 0$", "step per impact\n[$10^{-4}$]",
        "mean speed\n[$10^{-5}$]"]  # fmt: skip
    for ax, expected in ((step, [1e-4] * 3), (speed, [0, 0, 0, 2e-5, 2e-5, 2e-5])):
        dots = [line for line in ax.lines if line.get_marker() == "o"]
        values = np.concatenate([line.get_ydata() for line in dots])
        assert sorted(values[~np.isnan(values)]) == expected
        assert all(text.get_gid() == PANEL_LETTER for text in ax.texts)
    assert speed.get_xlabel() == "amplitude $f$"


def test_a_panel_without_data_is_left_out():
    table = silent_table()
    table["displacement per impact"] = np.nan
    axes = mi.plot_sweep(table).figure.axes
    assert [ax.get_ylabel() for ax in axes] == ["$v_2$ at $x_2 = 0$", "mean speed\n[$10^{-5}$]"]
    letters = [text.get_text() for ax in axes for text in ax.texts]
    assert letters == ["(a)", "(b)"]


def test_one_quantity():
    ax = mi.plot_sweep(silent_table(), quantity="speed")
    assert ax.figure.axes == [ax]
    assert ax.get_ylabel() == "mean speed [$10^{-5}$]"
    given = Figure().subplots()
    assert mi.plot_sweep(silent_table(), given, quantity="step") is given
    assert mi.plot_sweep(silent_table(), quantity="v1").get_ylabel() == "$v_1$ at $x_2 = 0$"
    with pytest.raises(mi.InvalidParameter, match="one of v2, step, speed"):
        mi.plot_sweep(silent_table(), quantity="x1")
    # This table has neither step nor speed.
    with pytest.raises(mi.InvalidParameter, match="one of v2, v1, impacts per period"):
        mi.plot_sweep(sweep_table(), quantity="speed")


def test_no_table_of_a_sweep():
    statistics = mi.Sweep(
        system=oscillator(), parameter="amplitude", table=sweep_table()
    ).statistics
    with pytest.raises(mi.InvalidParameter, match="sweep = 'DataFrame': must be a Sweep"):
        mi.plot_sweep(statistics)


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["x_a_b", "x__", "lambda_"])
def test_a_section_has_the_name_of_any_state(name, tmp_path):
    system = mi.System(
        states=(name, "v"), flow=lambda mode, t, y, p: (y.v, p.a * np.cos(t) - y.v),
        parameters={"a": 1.0}, period=2.0 * np.pi, section=(name, 0.5),
    )  # fmt: skip
    plain = mi.Options(engine="interpreted", method="dop853")
    sweep = mi.sweep(system, "a", [1.0, 2.0], transient=5, periods=3, options=plain)
    axes = mi.plot_sweep(sweep, quantity="v")
    axes.figure.savefig(tmp_path / "sweep.png")
    assert name in axes.get_ylabel().replace("\\", "")
