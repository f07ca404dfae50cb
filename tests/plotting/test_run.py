"""The motion of any system over time."""

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import mems_impact as mi
from mems_impact.plotting.style import MODE_COLORS, color, wearing
from tests.analysis.systems import oscillator

with wearing():
    BLACK = color("impact")


def curve(ax):
    return next(line for line in ax.lines if line.get_linestyle() == "-")


def dots(ax):
    found = [line for line in ax.lines if line.get_marker() == "o"]
    return np.concatenate([line.get_xydata() for line in found]) if found else np.empty((0, 2))


def jumps(ax):
    dashed = [line for line in ax.lines if line.get_color() == BLACK and line.get_marker() != "o"]
    return dashed[0].get_xydata().reshape(-1, 3, 2) if dashed else np.empty((0, 3, 2))


def legend(ax):
    shown = ax.get_legend()
    return [] if shown is None else [text.get_text() for text in shown.get_texts()]


def test_one_panel_a_state_over_the_last_periods(run, tmp_path):
    x, v = mi.plot_run(run).figure.axes
    assert [ax.get_ylabel() for ax in (x, v)] == ["$x$", "$v$"]
    assert v.get_xlabel() == "time / forcing period"
    assert v.get_xlim() == pytest.approx((94, 100))
    assert legend(x) == ["impact"]
    x.figure.savefig(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_impacts_are_dots_where_the_state_continues_and_lines_where_it_jumps(run):
    x, v = mi.plot_run(run, 90, 95).figure.axes
    hits = run.impacts[run.impacts["t"].between(*(n * 2 * np.pi / 0.8 for n in (90, 95)))]
    assert len(hits) == 5
    times = hits["t"].to_numpy() * 0.8 / (2 * np.pi)
    assert dots(x) == pytest.approx(np.column_stack([times, np.ones(5)]))
    assert jumps(x).shape == (0, 3, 2)
    assert dots(v).shape == (0, 2)
    assert jumps(v)[:, 0] == pytest.approx(np.column_stack([times, hits["v before"]]))
    assert jumps(v)[:, 1] == pytest.approx(np.column_stack([times, hits["v after"]]))


def test_the_line_reaches_both_sides_of_a_jump_and_is_broken_there(run):
    line = curve(mi.plot_run(run, 90, 95).figure.axes[1]).get_xydata()
    gaps = np.flatnonzero(np.isnan(line[:, 1]))
    hits = run.impacts.tail(10)
    assert len(gaps) == 5
    for gap in gaps:
        assert np.abs(hits["v before"] - line[gap - 1, 1]).min() < 1e-12
        assert np.abs(hits["v after"] - line[gap + 1, 1]).min() < 1e-12
    assert (np.diff(line[:, 0]) >= 0).all()


def test_the_rarer_mode_is_shaded_and_named(resting, tmp_path):
    x, v = mi.plot_run(resting, 10.5, 13.5).figure.axes
    assert legend(x) == ["impact", "held", "free"]
    for ax in (x, v):
        assert {to_hex(patch.get_facecolor()) for patch in ax.patches} == {MODE_COLORS[0]}
        assert len(ax.patches) == 3
    held = resting.events[resting.events["mode after"] == "held"]["t"]
    period = resting.system.forcing_period
    left = [patch.get_x() for patch in x.patches]
    assert set(np.round(left, 9)) <= set(np.round(held / period, 9))
    x.figure.savefig(tmp_path / "run.png")


def test_a_window_that_begins_at_rest(resting):
    inside = float(resting.events[resting.events["mode after"] == "held"]["t"].iloc[8]) + 0.1
    first = inside / resting.system.forcing_period
    x, _ = mi.plot_run(resting, first, first + 0.05).figure.axes
    # All of it is in one mode, which is then the one that is not shaded.
    assert len(x.patches) == 0
    assert set(curve(x).get_ydata()) == {1.0}


@pytest.mark.slow
def test_a_system_without_forcing_is_drawn_whole_over_time(falling, tmp_path):
    x, v = mi.plot_run(falling).figure.axes
    assert [ax.get_ylabel() for ax in (x, v)] == ["$x$ [m]", "$v$ [m/s]"]
    assert v.get_xlabel() == "time [s]"
    assert v.get_xlim() == pytest.approx((0, 3))
    assert len(dots(x)) == len(falling.impacts) == 6
    x.figure.savefig(tmp_path / "run.png")
    assert mi.plot_run(falling, 0.5, 1.5).figure.axes[0].get_xlim() == pytest.approx((0.5, 1.5))


def test_chosen_states_on_given_axes(run):
    (ax,) = mi.plot_run(run, states=["v"]).figure.axes
    assert ax.get_ylabel() == "$v$"
    axes = Figure().subplots(2)
    assert mi.plot_run(run, 1, 2, axes, states=("v", "x")) is axes[0]
    assert [ax.get_ylabel() for ax in axes] == ["$v$", "$x$"]
    with pytest.raises(mi.InvalidParameter, match="one of x, v"):
        mi.plot_run(run, states=["x2"])
    with pytest.raises(mi.InvalidParameter, match="one of x, v"):
        mi.plot_run(run, states=[])
    with pytest.raises(mi.InvalidParameter, match="2 axes"):
        mi.plot_run(run, ax=axes[:1])


def test_many_states_are_cut_to_six():
    def flow(mode, t, y, p, dy):
        for i in range(8):
            dy[i] = -y[i]

    run = mi.simulate(mi.System(states=8, flow=flow, initial={"u0": 1.0}), duration=1.0)
    panels = mi.plot_run(run).figure.axes
    assert [ax.get_ylabel() for ax in panels] == [f"$u_{i}$" for i in range(6)]
    assert mi.plot_run(run, states=["u7"]).figure.axes[0].get_ylabel() == "$u_7$"


def test_no_run_and_a_run_that_kept_nothing(run):
    with pytest.raises(mi.InvalidParameter, match="a Run"):
        mi.plot_run(run.events)
    kept = mi.simulate(oscillator(), 3, keep="statistics")
    with pytest.raises(mi.InvalidParameter, match="keep='events'"):
        mi.plot_run(kept)


def test_panels_do_not_lie_over_each_other_without_impacts(tmp_path):
    # A line without points, unclipped, once pushed all panels out of the figure.
    axes = mi.plot_run(mi.simulate(oscillator().changed(A=0.1), 3)).figure.axes
    axes[0].figure.savefig(tmp_path / "run.png")
    boxes = [ax.get_position() for ax in axes]
    assert all(above.y0 > below.y1 for above, below in pairwise(boxes))
    assert min(box.width for box in boxes) > 0.8
    assert legend(axes[0]) == []


@pytest.mark.slow
def test_pyplot_makes_figures_where_it_is_in_use():
    code = (
        "import sys, mems_impact as mi\n"
        "run = mi.simulate(mi.load_actuator('zhao2004'), mi.Sine(amplitude=.2, omega=.5), 1,"
        " options=mi.Options(engine='interpreted', method='dop853', rtol=1e-6))\n"
        "mi.plot_run(run), mi.plot_run(run, states=['v2']), mi.animate(run, per_period=4)\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "import matplotlib.pyplot as plt\n"
        "assert mi.plot_run(run).figure is plt.gcf()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
