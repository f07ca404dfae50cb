"""Figures of return maps and manifolds."""

import numpy as np
import pytest

import mems_impact as mi


def _still(mode, t, y, p):
    return 0.0, 0.0


def _line(mode, t, y, p):
    """A saddle whose manifolds are the axes."""
    return mode, (2.0 * y.x, 0.5 * y.y)


SADDLE = mi.System(
    states=("x", "y"), flow=_still, switch_transition=_line, switches=(0.5,), period=1.0,
    initial={"x": 0.1, "y": 1.0},
)  # fmt: skip


def test_the_return_map_shows_each_return_over_the_one_before():
    run = mi.simulate(SADDLE, 6)
    ax = mi.plot_return_map(run, "y", last=3)
    diagonal, web, dots = ax.get_lines()
    values = 0.5 ** np.arange(7)
    assert dots.get_xdata() == pytest.approx(values[:-1])
    assert dots.get_ydata() == pytest.approx(values[1:])
    assert diagonal.get_xdata() == pytest.approx(diagonal.get_ydata())
    assert web.get_xydata()[::2] == pytest.approx(np.stack([values[-4:]] * 2, axis=1)[:4])
    assert len(mi.plot_return_map(run, last=0, skip=2).get_lines()) == 2
    with pytest.raises(mi.InvalidParameter, match=r"one of .*x"):
        mi.plot_return_map(run, "q")
    with pytest.raises(mi.InvalidParameter, match="below 6"):
        mi.plot_return_map(run, skip=6)


@pytest.mark.slow
def test_manifolds_are_drawn_in_pieces_over_other_axes(tmp_path):
    orbit = mi.find_orbit(SADDLE, guess={"x": 0.0, "y": 0.0}, periods=1)
    both = [mi.manifold(orbit, kind, length=1.0, distance=0.1) for kind in ("unstable", "stable")]
    ax = mi.plot_manifold(both)
    lines = [line for line in ax.get_lines() if len(line.get_xdata()) > 2]
    assert len(lines) == 4
    assert np.abs(lines[0].get_ydata()).max() < 1e-12
    assert np.abs(lines[-1].get_xdata()).max() < 1e-12
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [
        "unstable manifold", "stable manifold"]  # fmt: skip
    ax.set(xlim=(-0.2, 0.3), ylim=(-2.0, 2.0))
    assert mi.plot_manifold(both[0], ax, x="y", y="x").get_xlim() == (-0.2, 0.3)
    with pytest.raises(mi.InvalidParameter, match="a Manifold"):
        mi.plot_manifold(orbit)
    with pytest.raises(mi.InvalidParameter, match="one of x, y"):
        mi.plot_manifold(both, x="z")
    path = tmp_path / "manifold.zip"
    both[1].save(path)
    assert mi.load(path, system=SADDLE) == both[1]
