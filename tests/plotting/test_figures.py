"""Figures hold what they should, on axes of their own or given ones, without pyplot."""

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from mems_impact.plotting.bifurcation import switches

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)


@pytest.fixture(scope="module")
def run():
    return mi.simulate(ZHAO, DRIVE, 40, initial=mi.State(v2=1.0))


def made_table(statuses=("ok", "ok", "ok")):
    impacts = {"up": [0.0, 0.0, 1.0], "down": [1.0, 1.0, 0.0]}
    rows = []
    for direction, values in (("up", (0.1, 0.2, 0.3)), ("down", (0.3, 0.2, 0.1))):
        for value, hits, status in zip(values, impacts[direction], statuses, strict=True):
            good = status == "ok"
            rows.append((value, direction, 0.0, value if good else np.nan, 0.0,
                         hits if good else np.nan, hits if good else np.nan, 0.0,
                         status))  # fmt: skip
    columns = ["amplitude", "direction", "period", "v2", "v1", "impacts per period",
               "blows per period", "displacement per period", "status"]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def test_run_shows_its_last_periods(run, tmp_path):
    block, frame = mi.plot_run(run)
    assert block.figure is frame.figure
    assert frame.get_xlim() == pytest.approx((34, 40))
    hits = next(line for line in block.lines if line.get_marker() == "o")
    assert len(hits.get_xdata()) == 6
    assert set(hits.get_ydata()) == {ZHAO.delta}
    assert len(block.patches) == 6  # slips
    block.figure.savefig(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_run_on_given_axes(run):
    axes = Figure().subplots(2)
    block, frame = mi.plot_run(run, 10, 12, axes=axes)
    assert block is axes[0]
    assert frame is axes[1]
    assert frame.get_xlim() == pytest.approx((10, 12))


def test_run_without_impacts():
    block, _ = mi.plot_run(mi.simulate(ZHAO, DRIVE.replace(amplitude=0.1), 3))
    assert len(block.patches) == 0


def test_run_that_kept_nothing():
    with pytest.raises(mi.InvalidParameter, match="keep='events'"):
        mi.plot_run(mi.simulate(ZHAO, DRIVE, 3, keep="statistics"))


def test_switches():
    assert switches(made_table()) == [("up", 0.3, True), ("down", 0.1, False)]
    assert switches(made_table(("ok", "lost", "ok"))) == [("up", 0.3, True), ("down", 0.1, False)]
    assert switches(made_table(("ok", "lost", "lost"))) == []


@pytest.mark.parametrize("statuses", [("ok", "ok", "ok"), ("ok", "lost", "ok")])
def test_sweep(statuses, tmp_path):
    ax = mi.plot_sweep(made_table(statuses))
    labels = [text.get_text() for text in ax.texts]
    assert labels == ["off at $f$ = 0.1", "on at $f$ = 0.3"]
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend[:2] == ["$f$ increased", "$f$ decreased"]
    assert ("failed" in legend) == ("lost" in statuses)
    ax.figure.savefig(tmp_path / "sweep.png")


def silent_table():
    """Return a table whose last value of each chain never crosses the section, with speeds."""
    table = made_table()
    table.loc[table["amplitude"] == 0.1, "v2"] = np.nan
    table["displacement per impact"] = np.where(table["impacts per period"] > 0, 1e-4, np.nan)
    table["mean speed"] = 2e-5 * table["impacts per period"]
    return table


def drawn(ax, marker):
    lines = [line for line in ax.lines if line.get_marker() == marker]
    return sorted(x for line in lines for x in line.get_xdata())


def test_sweep_shows_values_that_never_cross_the_section(tmp_path):
    ax = mi.plot_sweep(silent_table())
    assert drawn(ax, "v") == [0.1, 0.1]  # one for each direction
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["$f$ increased", "$f$ decreased", "never crosses $x_2 = 0$"]
    ax.figure.savefig(tmp_path / "sweep.png")


def test_sweep_shows_step_and_speed():
    top, step, speed = mi.plot_sweep(silent_table()).figure.axes
    assert [ax.get_ylabel() for ax in (top, step, speed)] == [
        "$v_2$ at $x_2 = 0$", "step per impact", "mean speed"]  # fmt: skip
    for ax, expected in ((step, [1e-4] * 3), (speed, [0, 0, 0, 2e-5, 2e-5, 2e-5])):
        dots = [line for line in ax.lines if line.get_marker() == "o"]
        values = np.concatenate([line.get_ydata() for line in dots])
        assert sorted(values[~np.isnan(values)]) == expected
        assert len(ax.texts) == 0
    assert speed.get_xlabel() == "amplitude $f$"


def test_sweep_of_one_quantity():
    ax = mi.plot_sweep(silent_table(), quantity="speed")
    assert ax.figure.axes == [ax]
    assert ax.get_ylabel() == "mean speed"
    given = Figure().subplots()
    assert mi.plot_sweep(silent_table(), given, quantity="step") is given
    with pytest.raises(mi.InvalidParameter, match="one of v2, step, speed"):
        mi.plot_sweep(silent_table(), quantity="x1")
    # A file of an earlier version has neither step nor speed.
    with pytest.raises(mi.InvalidParameter, match="one of v2"):
        mi.plot_sweep(made_table(), quantity="speed")


def test_sweep_in_one_direction_on_given_axes():
    table = made_table()
    ax = Figure().subplots()
    assert mi.plot_sweep(table[table["direction"] == "up"], ax) is ax
    assert len(ax.texts) == 1


def test_pyplot_is_left_alone():
    code = (
        "import sys, mems_impact as mi\n"
        "run = mi.simulate(mi.load_actuator('zhao2004'), mi.Sine(amplitude=.2, omega=.5), 2,"
        " options=mi.Options(engine='interpreted', rtol=1e-6))\n"
        "mi.plot_run(run)\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
