"""Basins: cells of a grid, dots of a sample, a strip of one component."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from mems_impact.analysis.attractor import Attractor
from mems_impact.studies.attractor_matching import label_points, returns
from mems_impact.studies.basins import Basins
from mems_impact.studies.sampling import Axis, Grid, Sample
from tests.analysis.systems import oscillator

UNITS = {"x": "m", "v": "m/s"}


def basins_of(starts, labels):
    """Return basins with these labels; the attractors are at (0, 0), (1, 1) and so on."""
    table = pd.DataFrame(dict(zip(starts.names, starts.points.T, strict=True)))
    table = table.assign(motion="periodic", period=1)
    table.attrs = {"starts": list(starts.names), "units": UNITS}
    labels = np.array(labels)
    found = [
        Attractor(motion="periodic", period=1, states=np.array([[i, i]], dtype=float))
        for i in range(labels.max() + 1)
    ]
    table, attractors = label_points(table, labels, found, starts, 16)
    system = oscillator()
    seen = returns(attractors, found, system)
    return Basins(
        system=system,
        starts=starts,
        initial=system.initial,
        table=table,
        attractors=attractors,
        returns=seen,
    )


def legend(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_a_grid(tmp_path):
    starts = Grid(Axis("x", (0.0, 1.0, 2.0)), Axis("v", (0.0, 1.0)))
    ax = mi.plot_basins(basins_of(starts, [0, 0, 0, 1, 1, -1]))
    (cells,) = ax.collections
    assert cells.get_array().reshape(2, 3).tolist() == [[0, 0, 0], [1, 1, 2]]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("$x$ [m]", "$v$ [m/s]")
    assert legend(ax) == ["period 1 a  50.0%", "period 1 b  33.3%", "failed  16.7%"]
    marks = [(*line.get_xdata(), *line.get_ydata()) for line in ax.lines]
    assert marks == [(0.0, 0.0), (1.0, 1.0)]
    ax.figure.savefig(tmp_path / "basins.png")
    turned = mi.plot_basins(basins_of(starts, [0, 0, 0, 1, 1, -1]), x="v")
    assert (turned.get_xlabel(), turned.get_ylabel()) == ("$v$ [m/s]", "$x$ [m]")
    assert turned.collections[0].get_array().reshape(3, 2).tolist() == [[0, 1], [0, 1], [0, 2]]


def test_a_sample_and_many_attractors(tmp_path):
    starts = Sample((("x", 0.0, 1.0), ("v", -1.0, 1.0)), 20, "sobol", 0)
    labels = [0, 0, 0, 0, *range(9), *[1] * 7]
    ax = mi.plot_basins(basins_of(starts, labels), Figure().subplots())
    (dots,) = ax.collections
    assert np.array_equal(dots.get_offsets(), starts.points)
    assert legend(ax)[-1] == "2 others  10.0%"
    ax.figure.savefig(tmp_path / "basins.png")


def test_one_component(tmp_path):
    ax = mi.plot_basins(basins_of(Grid(Axis("v", (1.0, 0.0, 2.0))), [0, 1, 1]))
    (strip,) = ax.collections
    assert strip.get_array().reshape(2, 3).tolist() == [[0, 1, 0]] * 2
    assert (ax.get_xlabel(), list(ax.get_yticks())) == ("$v$ [m/s]", [])
    ax.figure.savefig(tmp_path / "basins.png")


def test_what_is_wrong_is_named():
    with pytest.raises(mi.InvalidParameter, match=r"as mems_impact\.basins returns"):
        mi.plot_basins(pd.DataFrame())
    starts = Grid(Axis("x", (0.0, 1.0)), Axis("v", (0.0, 1.0)))
    with pytest.raises(mi.InvalidParameter, match="one of x, v"):
        mi.plot_basins(basins_of(starts, [0, 0, 1, 1]), y="u")
