"""Orbits of any system in a phase plane."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from tests.analysis.systems import oscillator


def labelled(ax, label):
    return [line for line in ax.lines if line.get_label() == label]


def test_phase_plane_with_its_jump(orbit, tmp_path):
    ax = mi.plot_orbit(orbit)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$x$", "$v$")
    (jump,) = labelled(ax, "impact")
    hit = orbit.impacts.iloc[0]
    assert jump.get_xydata() == pytest.approx(
        np.array([[1.0, hit["v before"]], [1.0, hit["v after"]]])
    )
    (begins,) = labelled(ax, "period begins")
    assert begins.get_xydata() == pytest.approx(np.array([[orbit.state.x, orbit.state.v]]))
    ax.figure.savefig(tmp_path / "orbit.png")


def test_the_line_is_closed(orbit):
    line = labelled(mi.plot_orbit(orbit), "free")[0].get_xydata()
    assert line[0] == pytest.approx(line[-1], abs=1e-9)
    assert np.isnan(line).any(axis=1).sum() == 1


def test_modes_are_lines_of_their_own(resting, tmp_path):
    ax = mi.plot_orbit(mi.find_orbit(resting), x="t", y="v")
    assert ax.get_xlabel() == "time"
    (held,) = labelled(ax, "held")
    assert np.nanmax(np.abs(held.get_ydata())) == 0.0
    assert held.get_color() != labelled(ax, "free")[0].get_color()
    ax.figure.savefig(tmp_path / "orbit.png")


@pytest.mark.slow
def test_section_is_marked(tmp_path):
    orbit = mi.find_orbit(oscillator(section=("x", 0.5)), transient=100)
    ax = mi.plot_orbit(orbit)
    (points,) = labelled(ax, "$x = 0.5$")
    assert sorted(points.get_ydata()) == pytest.approx(sorted(orbit.section()["v"]))
    assert len(points.get_ydata()) == 2
    assert [0.5, 0.5] in [list(line.get_xdata()) for line in ax.lines]
    ax = mi.plot_orbit(orbit, x="v", y="x")
    assert [0.5, 0.5] in [list(line.get_ydata()) for line in ax.lines]
    ax.figure.savefig(tmp_path / "orbit.png")


def test_given_axes_and_wrong_arguments(orbit, run):
    ax = Figure().subplots()
    assert mi.plot_orbit(orbit, ax, x="v") is ax
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$v$", "$x$")
    with pytest.raises(mi.InvalidParameter, match="one of x, v, t"):
        mi.plot_orbit(orbit, y="x2")
    with pytest.raises(mi.InvalidParameter, match="an Orbit"):
        mi.plot_orbit(run)
