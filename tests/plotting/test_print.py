"""Every figure can be read: at the width of a column and of a page."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from mems_impact.studies.sampling import Axis, Grid
from tests.actuator.figures.test_chart import chart
from tests.plotting.reading import flaws
from tests.plotting.sweeps import silent_table, sweep_table
from tests.plotting.test_basins import basins_of
from tests.plotting.test_branch import curve, diagram
from tests.plotting.test_map import map_table
from tests.plotting.test_sensitivity import MITA, ZHAO, sensitivity_of
from tests.plotting.test_tolerance_analysis import analysis_of
from validation.paper import figures
from validation.paper.diagrams import plot_automaton, plot_displacement

COLUMN, PAGE = (3.4, 2.4), (7.0, 4.2)
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)


def crowded():
    """Branches whose special points lie near each other, as in Fig. 6 of the paper."""
    found = diagram()
    rows = found.special_table.loc[[0, 1, 0, 1]].assign(label=["PD", "G", "PD", "CF"])
    rows = rows.assign(
        admissible=True, amplitude=[0.2, 0.202, 0.206, 0.21], v2=[0.4, 0.4, 0.39, 0.41]
    )
    found.special_table = pd.concat([found.special_table, rows])
    return found


def narrow():
    """A sweep whose values differ in the fifth digit, and that switches on and off at once."""
    table = sweep_table(statuses=("ok", "ok", "ok"))
    table["amplitude"] = 0.1717 + 1e-4 * table["amplitude"]
    return table


def front():
    table = pd.DataFrame({"mean speed": [1e-5, 2e-5, 2.4e-5], "drive energy": [2e-9, 3e-9, 9e-9]})
    table.attrs = {"aims": {"mean speed": "maximize", "drive energy": "minimize"},
                   "units": {"mean speed": "m/s", "drive energy": "J"}}  # fmt: skip
    return table


def energy():
    accounts = ["drive", "viscous damping", "impacts", "sliding_friction", "load", "stored"]
    table = pd.DataFrame({
        "account": accounts, "kind": ["in", "lost", "lost", "lost", "load", "stored"],
        "energy per period": [5e-13, -2e-13, -1.5e-13, -1e-13, -4e-14, -1e-14],
        "share": [1.0, -0.4, -0.3, -0.2, -0.08, -0.02]})  # fmt: skip
    table.attrs = {"units": {"energy per period": "J"}}
    return SimpleNamespace(table=table)


def load():
    table = pd.DataFrame({
        "load": [-2e-5, 0.0, 1e-5, 2e-5, 3e-5], "mean speed": [4e-6, 3e-6, 1e-6, 0.0, np.nan],
        "does": ["walks"] * 4 + ["runs away"]})  # fmt: skip
    table.attrs = {"units": {"load": "N", "mean speed": "m/s"}}
    return SimpleNamespace(table=table, sliding_force=2.78e-5, stall_force=2.4e-5,
                           holding_force=4.12e-5)  # fmt: skip


def characteristic(amplitudes=(20.0, 40.0, 60.0)):
    points = [(f, w, way) for f in amplitudes for way in ("up", "down") for w in (600, 700, 800)]
    rows = [(f, w, way, True, 1e-6 * f / w, 2e-7 * f * w, 4e-9 * f, 1e-13 * f * w, 1e-6 * f)
            for f, w, way in points]  # fmt: skip
    table = pd.DataFrame(rows, columns=[
        "amplitude", "frequency", "direction", "impacting", "displacement per blow", "mean speed",
        "mean speed error", "energy in per blow", "stall force"])  # fmt: skip
    table.loc[1, "mean speed error"], table.loc[4, "mean speed error"] = np.inf, 1e-3
    units = {"frequency": "Hz", "amplitude": "V", "displacement per blow": "m",
             "mean speed": "m/s", "energy in per blow": "J", "stall force": "N"}  # fmt: skip
    table.attrs = {"units": units}
    first = "amplitude" if len(amplitudes) > 1 else ""
    return SimpleNamespace(table=table, parameter="frequency", curves=first)


def curves():
    cusp, flip = ("cusp", 0.3, 0.7), ("fold-flip", 0.31, 0.69)
    return [curve("fold", [1.0, 0.9, 0.7, 0.4], [True, True, False, False], [cusp, flip]),
            curve("grazing", [0.2, 0.4, 0.7, 0.9], [True] * 4, [cusp])]  # fmt: skip


def displacement():
    device = mi.load_actuator("mita2003")
    run = mi.simulate(device, mi.Sine(amplitude=100.0, omega=2.0 * np.pi), 3)
    rows = [(f, v, 1e-10 * v * f**0.1, 1.0) for f in (0.1, 1.0, 10.0) for v in (38.0, 90.0, 150.0)]
    table = pd.DataFrame(rows, columns=figures.DISPLACEMENT_COLUMNS)
    return plot_displacement(table, run, 36.6)[0]


@cache
def transitions():
    found = figures.figure2(figures.Devices(), figures.Effort(quick=True))
    return found.tables["transitions"]


def two_sided(*terms):
    pulse = mi.Pulse(amplitude=40.0, period=2e-3, width=5e-4)
    return mi.plot_drive(mi.Voltages(right=pulse, left=pulse.replace(amplitude=30.0)),
                         mi.load_actuator("mita2003").adding(*terms))[0]  # fmt: skip


@cache
def resisted():
    """A run with two electrodes behind resistances."""
    pulse = mi.Pulse(amplitude=0.5, period=12.0, width=3.8)
    drive = mi.Voltages(right=pulse, left=pulse.replace(amplitude=0.4, phase=3.0))
    device = mi.load_actuator("zhao2004").adding(mi.SeriesResistance(resistance=0.3))
    options = mi.Options(engine="interpreted")
    return mi.simulate(device, drive, 4, initial=mi.State(v2=0.6), options=options)


@cache
def closing():
    return mi.closing(mi.load_actuator("abdulrahim2016"), mi.VoltageStep(amplitude=90.0, rise=1e-6))


@cache
def real():
    return mi.simulate(mi.load_actuator("mita2003"), mi.Sine(amplitude=100.0, omega=6.283), 3)


def well(mode, t, y, p):
    return y.v, y.x - y.x**3 - 0.2 * y.v


@cache
def manifolds():
    (saddle,) = mi.find_equilibria(mi.System(states=("x", "v"), flow=well), guess={"x": 0.1})
    return [mi.manifold(saddle, kind, length=2.0) for kind in ("unstable", "stable")]


def logistic(mode, t, y, p):
    return mode, (p.a * y.x * (1.0 - y.x),)


def quadratic_map():
    return mi.System(
        states=("x",), flow=lambda mode, t, y, p: (0.0,), switch_transition=logistic,
        switches=(0.5,), period=1.0, parameters={"a": 3.7}, initial={"x": 0.3},
    )  # fmt: skip


@cache
def doublings():
    return mi.bifurcation_diagram(quadratic_map(), "a", (2.8, 3.3), depth=1, values=5)


@cache
def walk():
    return mi.find_orbit(mi.load_actuator("zhao2004"), DRIVE, transient=300)


@cache
def fitted():
    ball = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": 9.8}
    )
    times = np.linspace(0.05, 0.6, 12)
    noise = 0.01 * np.cos(7.0 * np.arange(12))
    seen = pd.DataFrame({"t": times, "x": 3.0 * times - 4.9 * times**2 + noise})
    return mi.fit(ball, seen, free=["g", "x0.v"], options=mi.Options(engine="interpreted"))


GRID = Grid(Axis("x", (0.0, 1.0, 2.0)), Axis("v", (0.0, 1.0)))
QUICK = {
    "plot_branch": lambda _: mi.plot_branch(crowded(), narrow_to(sweep_table())),
    "plot_chart": lambda _: mi.plot_chart(chart()),
    "plot_sweep": lambda _: mi.plot_sweep(narrow()),
    "plot_map": lambda _: mi.plot_map(map_table()),
}
LONG = {
    "plot_basins": lambda _: mi.plot_basins(basins_of(GRID, [0, 0, 0, 1, 1, -1])),
    "plot_basins of many attractors": lambda _: mi.plot_basins(basins_of(
        Grid(Axis("x", (0.0, 1.0, 2.0, 3.0)), Axis("v", (0.0, 1.0, 2.0))), [*range(9), 0, 1, -1])),
    "plot_diagram": lambda _: mi.plot_diagram(doublings()),
    "plot_manifold": lambda _: mi.plot_manifold(manifolds()),
    "plot_return_map": lambda _: mi.plot_return_map(mi.simulate(quadratic_map(), 60)),
    "plot_closing": lambda _: mi.plot_closing(closing())[0],
    "plot_curve": lambda _: mi.plot_curve(curves()),
    "plot_drive": lambda _: two_sided(),
    "plot_drive of a source with a slew rate": lambda _: two_sided(mi.SlewRate(rate=2e5)),
    "plot_energy": lambda _: mi.plot_energy(energy()),
    "plot_fit": lambda _: mi.plot_fit(fitted()),
    "plot_fit of errors": lambda _: mi.plot_fit(fitted(), kind="ellipses"),
    "plot_force_curve": lambda _: mi.plot_force_curve(load()),
    "plot_map of a column": lambda _: mi.plot_map(map_table(), "speed"),
    "plot_orbit": lambda get: mi.plot_orbit(get("orbit")),
    "plot_orbit of an actuator": lambda _: mi.plot_orbit(walk()),
    "plot_pareto": lambda _: mi.plot_pareto(front()),
    "plot_characteristic": lambda _: mi.plot_characteristic(characteristic()),
    "plot_characteristic of one curve": lambda _: mi.plot_characteristic(characteristic((20.0,))),
    "plot_run": lambda get: mi.plot_run(get("resting"), 10.5, 13.5),
    "plot_run of an actuator": lambda _: mi.plot_run(real()),
    "plot_run of an actuator behind a resistance": lambda _: mi.plot_run(resisted()),
    "plot_run of its states": lambda _: mi.plot_run(real(), states=("x1", "v1", "x2", "v2")),
    "plot_tolerance_analysis": lambda _: mi.plot_tolerance_analysis(analysis_of()),
    "plot_sensitivity": lambda _: mi.plot_sensitivity(sensitivity_of(MITA), "mean speed"),
    "plot_sensitivity without units": lambda _: mi.plot_sensitivity(
        sensitivity_of(ZHAO), "mean speed"),
    "plot_sweep without crossings": lambda _: mi.plot_sweep(silent_table()),
    "animate": lambda get: SimpleNamespace(figure=mi.animate(get("run"), 98).frame(-1)),
    "animate an actuator": lambda _: SimpleNamespace(figure=mi.animate(real(), 2).frame(-1)),
    "the paper's displacement": lambda _: displacement(),
    "the paper's automaton": lambda _: plot_automaton(transitions()),
}  # fmt: skip


def narrow_to(table):
    return table[["amplitude", "v2"]]


def test_every_figure_is_among_them():
    figures = {name for name in mi.__all__ if name.startswith("plot_")} | {"animate"}
    assert figures <= set(QUICK) | set(LONG)


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_it_can_be_read_in_a_column(name, request):
    assert flaws(QUICK[name](request.getfixturevalue).figure) == []


@pytest.mark.slow
def test_it_has_the_same_ticks_wherever_it_is_saved(tmp_path):
    # matplotlib takes their number from the style that holds when a figure is saved.
    ax = mi.plot_map(map_table())
    ax.figure.savefig(tmp_path / "here.png")
    here = list(ax.get_xticks()), list(ax.get_yticks())
    with mi.style():
        ax.figure.savefig(tmp_path / "there.png")
        assert (list(ax.get_xticks()), list(ax.get_yticks())) == here


@pytest.mark.nightly
@pytest.mark.parametrize("name", [*QUICK, *LONG])
def test_it_can_be_read(name, request):
    draw = {**QUICK, **LONG}[name]
    for size in (COLUMN, PAGE):
        with mi.style({"figure.figsize": size}):
            figure = draw(request.getfixturevalue).figure
        assert figure.get_figwidth() == size[0]
        assert flaws(figure) == []


def test_what_cannot_be_read_is_found():
    figure = Figure(figsize=(3.0, 3.0))
    ax = figure.subplots()
    ax.annotate("one", (0.5, 0.5))
    ax.annotate("another", (0.52, 0.5))
    ax.annotate("outside", (1.2, 0.5))
    ax.annotate("tiny", (0.1, 0.1), fontsize=5)
    ax.plot([0, 1], [0, 1], marker="o", markersize=0.5, label="dots")
    for x in (0.7, 0.71):
        ax.plot(x, 0.2, marker="s", markersize=4.5, zorder=7, label=f"at {x}")
    ax.legend()
    found = flaws(figure)
    for words in ("'one' lies over 'another'", "'tiny' has 5 pt"):
        assert words in found
    assert "the dot of 'dots' is not seen" in found
    assert "a legend lies over what is drawn" in found
    assert any(words.startswith("a legend takes") for words in found)
    assert "special points lie over each other" in found
    astray = Figure()
    ax = astray.subplots()
    for x in (0.3, 0.7):
        ax.plot(x, 0.5, marker="s", markersize=4.5, zorder=7)
        ax.annotate(f"of {x}", (1.0 - x, 0.52), zorder=8)
    assert flaws(astray) == [f"'of {x}' is beside the marker of another point" for x in (0.3, 0.7)]
    two = Figure()
    two.subplots(2)
    assert flaws(two) == ["panels have letters [], not ['(a)', '(b)']"]
