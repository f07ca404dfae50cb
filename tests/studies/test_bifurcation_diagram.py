"""Bifurcation diagrams: branches, none twice, special points in closed form, partial results."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.studies import diagram_construction as construction

PLAIN = mi.Options(method="dop853", rtol=1e-10, atol=1e-12)
SHORT = mi.RecurrenceOptions(transient=40, periods=10, exponents="none", chaos_persistence=1.0)


def _fork(mode, t, y, p):
    return (p.a * y.x - y.x**3,)


FORK = mi.System(states=("x",), flow=_fork, parameters={"a": 1.0})
FORK_OPTIONS = {"values": 4, "starts": 2, "recurrence": SHORT, "options": PLAIN}


@pytest.fixture(scope="module")
def fork():
    """A pitchfork at a = 0: x = 0, and both halves of x^2 = a."""
    return mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS)


@pytest.mark.slow
def test_a_pitchfork_of_equilibria_has_two_branches(fork):
    assert len(fork.branches) == 2
    (point,) = fork.special_points
    assert point.label == "BP"
    assert abs(point.value) < 1e-9
    child = next(i for i, parent in enumerate(fork.parents) if parent is not None)
    x = fork.branches[child].table["x"].to_numpy()
    a = fork.branches[child].table["a"].to_numpy()
    np.testing.assert_allclose(x**2, a, atol=1e-8)
    assert x.min() == pytest.approx(-1.0, abs=1e-9)
    assert x.max() == pytest.approx(1.0, abs=1e-9)


def test_the_tree_and_the_tables_name_the_branches(fork):
    assert fork.tree.splitlines()[0] == "a -1 to 1"
    assert "└─ 1: equilibria" in fork.tree
    assert fork.tree.endswith("from BP 0")
    assert set(fork.table["branch"]) == {0, 1}
    assert fork.special_table["label"].tolist() == ["BP"]
    assert list(fork.summary())[-2:] == ["branch 0", "branch 1"]
    assert repr(fork) == "BifurcationDiagram(a -1 to 1, 2 branches, 1 special points)"
    assert set(fork.attractors["branch"]) == {0, 1}
    assert mi.plot_diagram(fork).get_xlabel() == "$a$"


def test_a_diagram_is_saved(fork, tmp_path):
    fork.save(tmp_path / "fork.zip")
    loaded = mi.load(tmp_path / "fork.zip", system=FORK)
    assert loaded.tree == fork.tree
    assert mi.load(tmp_path / "fork.zip").special_table.equals(fork.special_table)


@pytest.mark.nightly
def test_an_interrupted_diagram_is_completed(fork, monkeypatch):
    def stop(self):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(construction.DiagramBuilder, "_search", stop)
        with pytest.raises(mi.Interrupted, match="interrupted after 2 branches") as caught:
            mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS)
    partial = caught.value.partial
    assert not partial.complete
    whole = mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS, resume=partial)
    assert whole.tree == fork.tree
    assert whole.complete
    with pytest.raises(mi.InvalidParameter, match="another system, parameter or range"):
        mi.bifurcation_diagram(FORK, "a", (-1.0, 0.5), **FORK_OPTIONS, resume=partial)


@pytest.mark.slow
def test_a_diagram_resumes_from_its_store(fork, tmp_path, monkeypatch):
    """Interrupted every few steps, it is that of one computation; finished, it is loaded."""
    store, left = tmp_path / "fork.zip", [0]

    def tick(self, done=0.0, note=""):
        left[0] -= 1
        if left[0] == 0:
            raise KeyboardInterrupt

    monkeypatch.setattr(construction, "STORE_INTERVAL", 0.0)
    begun = 0
    with monkeypatch.context() as patched:
        patched.setattr(construction.DiagramBuilder, "_tick", tick)
        for begun in range(40):
            left[0] = 3 + 2 * begun  # parts that are repeated finish, too
            try:
                mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS, store=store)
                break
            except mi.Interrupted:
                assert store.exists()
    assert begun > 2
    monkeypatch.setattr(construction.DiagramBuilder, "_find_attractors", None)
    whole = mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS, store=store)
    assert whole.complete
    assert whole.tree == fork.tree
    assert whole.attractors.equals(fork.attractors)
    assert whole.cloud.equals(fork.cloud)
    with pytest.raises(mi.InvalidFile, match="other arguments: depth is 4 there, 2 here"):
        mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS, depth=2, store=store)
    fork.branches[0].save(store)
    with pytest.raises(mi.InvalidFile, match="holds no bifurcation diagram"):
        mi.bifurcation_diagram(FORK, "a", (-1.0, 1.0), **FORK_OPTIONS, store=store)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a", (1.0, -1.0)), r"bounds = .*: must be .*in this order"),
        (("b", (0.0, 1.0)), "b"),
        (("a", (0.0, 1.0), {"depth": -1}), "depth = -1"),
        (("a", (0.0, 1.0), {"values": 1}), "values = 1"),
        (("a", (0.0, 1.0), {"box": {"z": (0.0, 1.0)}}), "box = 'z': must be one of x"),
        (("a", (0.0, 1.0), {"box": {"x": (1.0, 0.0)}}), r"box\.x = .*in this order"),
        (("a", (0.0, 1.0), {"resume": 1}), "resume = 1: must be a BifurcationDiagram"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    *places, last = arguments
    named = last if isinstance(last, dict) else {}
    if not named:
        places.append(last)
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.bifurcation_diagram(FORK, *places, **named)
    with pytest.raises(mi.InvalidParameter, match="must be a BifurcationDiagram"):
        mi.plot_diagram(1)


# --- Maps


def _wave(mode, t, y, p):
    return 0.0, math.cos(2.0 * math.pi * t) - 3.0 * y.w


def _logistic(mode, t, y, p):
    return mode, (p.r * y.x * (1.0 - y.x), y.w)


LOGISTIC = mi.System(
    states=("x", "w"), flow=_wave, switch_transition=_logistic, switches=(0.5,), period=1.0,
    parameters={"r": 2.0}, initial={"x": 0.5, "w": 0.0618834},
)  # fmt: skip


@pytest.mark.slow
def test_the_cascade_of_the_logistic_map():
    """Period doublings at 3, 1 + sqrt 6 and 3.5440903596; the fixed point 0 is a second root."""
    diagram = mi.bifurcation_diagram(
        LOGISTIC, "r", (2.5, 3.6), values=5, starts=1, depth=2, options=PLAIN, recurrence=SHORT,
        box={"x": (0.1, 0.9), "w": (0.06, 0.07)}, longest=4,
    )  # fmt: skip
    found = {s.orbit.periods: s.value for s in diagram.special_points if s.label == "PD"}
    assert found == pytest.approx({1: 3.0, 2: 1.0 + math.sqrt(6.0), 4: 3.5440903596}, abs=1e-9)
    by_period = {b.orbits[0].periods: i for i, b in enumerate(diagram.branches) if len(b) > 3}
    assert diagram.parents[by_period[4]] == by_period[2]
    periods = sorted(branch.orbits[0].periods for branch in diagram.branches)
    assert periods in ([1, 2, 4], [1, 1, 2, 4])


@pytest.mark.nightly
def test_unstable_orbits_of_each_period_up_to_four_are_found():
    """At r = 4 there are 2, 1, 2 and 3 of the periods 1 to 4; two fold at 3.9601."""
    diagram = mi.bifurcation_diagram(
        LOGISTIC, "r", (3.9, 4.0), values=5, starts=4, depth=0, recurrence=SHORT,
        box={"x": (0.05, 0.95), "w": (0.06, 0.07)}, longest=4,
    )  # fmt: skip
    periods = [branch.orbits[0].periods for branch in diagram.branches]
    assert sorted(periods) == [1, 1, 2, 3, 3, 4, 4]
    assert [s.value for s in diagram.special_points if s.label == "CF"] == pytest.approx([3.960102])


def _pair(mode, t, y, p):
    return 0.0, 0.0, math.cos(2.0 * math.pi * t) - 3.0 * y.w


def _alternating(mode, t, y, p):
    ring = (y.x**2 - 1.0) ** 2 + p.a**2 - 0.25
    return mode, (-y.x * (1.0 - 0.3 * ring), 3.0 * y.z - y.x**2, y.w)


@pytest.mark.nightly
def test_an_isola_of_unstable_orbits_of_period_two_is_found_and_closed():
    """The orbits of period 2 are (x^2 - 1)^2 + a^2 = 1/4, z = x^2 / 2; that of period 1 is 0."""
    system = mi.System(
        states=("x", "z", "w"), flow=_pair, switch_transition=_alternating, switches=(0.5,),
        period=1.0, parameters={"a": 0.1}, initial={"x": 0.1, "z": 0.1, "w": 0.0618834},
    )  # fmt: skip
    diagram = mi.bifurcation_diagram(
        system, "a", (-0.8, 0.8), values=5, starts=4, recurrence=SHORT,
        box={"x": (-1.5, 1.5), "z": (-1.0, 1.0), "w": (0.06, 0.07)},
    )  # fmt: skip
    assert diagram.tree.splitlines()[1:] == [
        "0: period 1, a -0.8 to 0.8",
        "1: period 2, a -0.5 to 0.5, closed, CF 0.5, CF -0.5",
    ]
    table = diagram.branches[1].table
    np.testing.assert_allclose((table["x"] ** 2 - 1.0) ** 2 + table["a"] ** 2, 0.25, atol=1e-8)
    assert not diagram.table["stable"].any()


@pytest.mark.nightly
def test_the_device_has_one_branch():
    """The orbit without impacts grazes and folds; none with a slip that ends at once is another."""
    device, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    diagram = mi.bifurcation_diagram(device, drive, "amplitude", (0.16, 0.30), values=15)
    assert len(diagram.branches) == 1
    found = {special.label: special.value for special in diagram.special_points}
    assert found == pytest.approx({"G": 0.2271775831, "CF": 0.176515440628}, abs=1e-9)
    assert (diagram.attractors["branch"] == 0).all()
