"""An orbit of an actuator: its block between the stoppers."""

import pytest

import mems_impact as mi


@pytest.fixture(scope="module")
def orbit():
    zhao, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    return mi.find_orbit(zhao, drive, transient=300)


def test_orbit(orbit, tmp_path):
    ax = mi.plot_orbit(orbit)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["frame stuck", "frame slips", "impact"]
    ax.figure.savefig(tmp_path / "orbit.png")


def test_a_chosen_plane_is_drawn_as_that_of_any_system(orbit, tmp_path):
    ax = mi.plot_orbit(orbit, x="x1")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$x_1$ [$10^{-4}$]", "$v_1$")
    # Cyclic: the frame ends where its step has brought it.
    ends = [line.get_xdata()[-1] for line in ax.lines if line.get_label() == "stuck-free"]
    start = [line.get_xdata()[0] for line in ax.lines if line.get_label() == "stuck-free"]
    assert ends[0] - start[0] == pytest.approx(orbit.step, rel=1e-9)
    ax.figure.savefig(tmp_path / "orbit.png")
