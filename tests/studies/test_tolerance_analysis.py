"""Tolerance analysis: samples, yields, quantiles and Sobol's indices against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import mems_impact as mi
from mems_impact.studies.sampling import distributions, draw, seed_of, unit_sample
from mems_impact.studies.uncertainty import indices_table
from tests.studies.toys import bits

ACTUATOR = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
SYSTEM = ACTUATOR.under(DRIVE)
FAST = mi.Options(method="dop853")
OVER = {"mu_d": stats.uniform(0.25, 0.04), "g": stats.norm(1.0, 0.02)}
GIVEN = {"initial": mi.kicked_state(ACTUATOR), "options": FAST}
STEP = "displacement per period"


@pytest.fixture(scope="module")
def found():
    """A device whose friction varies."""
    wanted = {STEP: (4e-3, 4.5e-3), "period": (1, None)}
    return mi.tolerance_analysis(
        ACTUATOR, DRIVE, over=OVER, samples=16, indices=True, specification=wanted, **GIVEN
    )


def test_every_point_is_a_device_of_its_own(found):
    assert len(found.table) == 16 * 4
    assert len(found.points) == 32
    for i in (0, 17, 40, 63):
        row = found.table.iloc[i]
        system = SYSTEM.changed(mu_d=row["mu_d"], g=row["g"])
        run = mi.simulate(system, 200, window=(190, 200), **GIVEN)
        assert row[STEP] == pytest.approx(run.statistics[STEP], rel=1e-5)
    assert found.table["sample"].iloc[[0, 16, 32, 48]].tolist() == [
        "A", "B", "A, mu_d of B", "A, g of B"]  # fmt: skip
    assert found.table.attrs["drawn"] == ["mu_d", "g"]


def test_yields_count_points(found):
    points = found.points
    inside = ((points[STEP] >= 4e-3) & (points[STEP] <= 4.5e-3)).to_numpy()
    assert 0 < inside.sum() < 32
    yields = found.yields.set_index("quantity")
    assert yields.loc[STEP, "points"] == yields.loc["all", "points"] == inside.sum()
    assert yields.loc["period", "share"] == 1.0
    low, high = yields.loc["all", ["low", "high"]]
    # Wilson's bounds are where the share lies 1.96 standard deviations off.
    share = inside.mean()
    for bound in (low, high):
        assert abs(share - bound) == pytest.approx(
            1.959963984540054 * math.sqrt(bound * (1.0 - bound) / 32), rel=1e-9
        )
    interval = f"({low:.1%} to {high:.1%})"
    assert interval in repr(found)
    assert interval in found.summary()["yield"]


def test_motions_that_have_not_settled_meet_no_specification():
    """Half of the points take 1e7 periods to the rate 1 of all, and are at 1.5."""

    def flow(mode, t, y, p):
        return p.rate * (1.0 - y.x), y.x

    system = mi.System(
        states=("x", "w"), flow=flow, parameters={"rate": 1.0}, period=1.0, cyclic=["w"],
        observables=[mi.Observable("gain", lambda y, p: y.w)], initial={"x": 1.5},
    )  # fmt: skip
    analysis = mi.tolerance_analysis(
        system, over={"draw": stats.uniform(0.0, 1.0)}, samples=16, sampling="lhs",
        parameters=lambda draw: {"rate": 1.0 if draw < 0.5 else 1e-7},
        specification={"gain": (1.4, 1.6)},
        recurrence=mi.RecurrenceOptions(transient=20, periods=10, exponents="none"),
    )  # fmt: skip
    assert (analysis.points["motion"] == "unsettled").sum() == 8
    assert analysis.yields["points"].tolist() == [0, 0]
    quantiles = analysis.quantiles([0.05, 0.95]).loc["gain"]
    assert quantiles.tolist() == pytest.approx([1.0, 1.0, 8])


def test_quantiles(found):
    table = found.quantiles([0.0, 0.5, 1.0])
    steps = found.points[STEP]
    assert table.loc[STEP].tolist() == [steps.min(), steps.median(), steps.max(), 32]
    with pytest.raises(mi.InvalidParameter, match="between 0 and 1"):
        found.quantiles(5)


def test_what_does_not_vary_has_no_indices(found):
    indices = found.indices.set_index(["quantity", "parameter"])
    assert (indices.loc["impacts per period", ["first", "total"]] == 0.0).all(axis=None)
    assert (indices.loc["closest approach", "missing"] == 64).all()
    assert indices.loc["closest approach", ["first", "total"]].isna().all(axis=None)


def test_a_sample_has_a_seed_of_any_generator():
    def drawn(rng):
        return unit_sample(4, 2, "sobol", seed_of(rng)).tolist()

    assert seed_of(3) == 3
    assert drawn(np.random.default_rng(3)) == drawn(np.random.default_rng(3)) != drawn(3)
    assert drawn(np.random.SeedSequence(3)) == drawn(np.random.SeedSequence(3))
    assert drawn(None) != drawn(None)


def test_the_same_on_any_worker(tmp_path):
    given = {"over": OVER, "samples": 5, "sampling": "random", "rng": 3, **GIVEN}
    brief = {**given, "recurrence": mi.RecurrenceOptions(transient=40, periods=2, tolerance=1e-3)}
    one = mi.tolerance_analysis(ACTUATOR, DRIVE, **brief, workers=1)
    two = mi.tolerance_analysis(ACTUATOR, DRIVE, **brief, workers=3, store=tmp_path)
    assert bits(one.table) == bits(two.table)
    other = {**brief, "over": {**OVER, "g": stats.norm(1.0, 0.03)}}
    with pytest.raises(mi.InvalidFile, match="over"):
        mi.tolerance_analysis(ACTUATOR, DRIVE, **other, store=tmp_path)


def test_what_depends_on_one_thing_together():
    def made(width):
        return {"k": width**3, "d": 2.0 - width}

    draws = draw(
        SYSTEM,
        {"width": stats.norm(1.0, 0.05)},
        made,
        samples=6,
        sampling="lhs",
        seed=1,
        indices=False,
    )
    assert draws.parameters == ("k", "d")
    width = draws.values[:, 0]
    assert draws.parameter_values == pytest.approx(
        np.stack([width**3, 2.0 - width], axis=1), rel=1e-15
    )
    with pytest.raises(mi.InvalidParameter, match="not width"):
        mi.tolerance_analysis(
            SYSTEM, over={"width": stats.norm(1.0, 0.05)}, parameters=lambda width: {"width": width}
        )  # fmt: skip


def test_a_device_that_cannot_be_is_a_row():
    # Half of the restitutions lie above 1.
    brief = mi.RecurrenceOptions(transient=20, periods=2, tolerance=1e-2)
    some = mi.tolerance_analysis(
        SYSTEM, over={"e": stats.uniform(0.8, 0.4)}, samples=4, recurrence=brief,
        specification={STEP: (None, None)}, **GIVEN,
    )  # fmt: skip
    bad = some.table["e"] > 1.0
    assert bad.any()
    assert (some.table.loc[bad, "motion"] == "failed").all()
    assert some.table.loc[bad, "status"].str.contains("e = 1").all()
    assert some.yields["points"].tolist() == [4 - bad.sum()] * 2
    assert replace(some, specification={}).yields["points"].tolist() == [4 - bad.sum()]


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"over": {}}, "distributions by name"),
        ({"over": {"e": 0.8}}, "a frozen distribution"),
        ({"over": {"q": stats.norm()}}, "one of amplitude"),
        ({"samples": 0}, "samples = 0"),
        ({"samples": 100, "indices": True}, "such as 128"),
        ({"sampling": "halton"}, "one of sobol"),
        ({"rng": 0.5}, "rng = 0.5"),
        ({"specification": {"speed": (0, 1)}}, "one of the columns"),
        ({"specification": {STEP: (1, 0)}}, "lowest, highest"),
        ({"specification": {STEP: 3}}, "lowest, highest"),
        ({"recurrence": 3}, "a RecurrenceOptions"),
        ({"initial": {"q": 1.0}}, "components among"),
        ({"parameters": lambda **drawn: {}}, "must return parameters"),
    ],
)
def test_what_is_wrong_is_named(given, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.tolerance_analysis(SYSTEM, **{"over": OVER, **given})


# Estimators, by closed forms.


@pytest.mark.parametrize("sampling", ["sobol", "lhs", "random"])
def test_samples_are_uniform(sampling):
    points = unit_sample(512, 3, sampling, 5)
    assert points.shape == (512, 3)
    assert ((points > 0.0) & (points < 1.0)).all()
    for column in points.T:
        assert stats.kstest(column, "uniform").pvalue > 0.01
    assert np.array_equal(points, unit_sample(512, 3, sampling, 5))
    assert not np.array_equal(points, unit_sample(512, 3, sampling, 6))


def test_indices_of_ishigami():
    # sin x1 + a sin^2 x2 + b x3^4 sin x1 on a cube of sides 2 pi: T. Ishigami and T. Homma, ISUMA
    # 1990; the closed forms in I. M. Sobol' and Y. L. Levitan, Comput. Phys. Commun. 117, 52, 1999.
    a, b, pi = 7.0, 0.1, math.pi
    over = {name: stats.uniform(-pi, 2.0 * pi) for name in ("m1", "m2", "k")}
    draws = draw(SYSTEM, over, None, samples=2048, sampling="sobol", seed=2, indices=True)
    x, y, z = draws.values.T
    value = np.sin(x) + a * np.sin(y) ** 2 + b * z**4 * np.sin(x)
    broken = np.where(np.arange(len(value)) == 7, np.nan, value)
    table = indices_table(draws, ["f", "g"], np.stack([value, broken], axis=1), 1)
    first = (1.0 + b * pi**4 / 5.0) ** 2 / 2.0, a**2 / 8.0, 0.0
    both = 8.0 * b**2 * pi**8 / 225.0
    variance = sum(first) + both
    ours = table[table["quantity"] == "f"]
    assert ours["first"].to_numpy() == pytest.approx(np.array(first) / variance, abs=0.02)
    total = np.array([first[0] + both, first[1], both]) / variance
    assert ours["total"].to_numpy() == pytest.approx(total, abs=0.02)
    for what, exact in (("first", np.array(first) / variance), ("total", total)):
        assert (ours[f"{what} low"] - 1e-9 <= exact).all()
        assert (exact <= ours[f"{what} high"]).all()
    lost = table[table["quantity"] == "g"]
    assert lost["first"].isna().all()
    assert (lost["missing"] == 1).all()


def test_distributions_about_the_value_of_the_system():
    """As a part of it: normal of that deviation, or even to either side."""
    system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))
    e, d = distributions({"e": "5%", "d": "uniform: 2%"}, system).values()
    assert (e.mean(), e.std()) == pytest.approx((0.8, 0.04))
    size = system.parameters["d"]
    assert d.support() == pytest.approx((0.98 * size, 1.02 * size))
    for given, told in [("5", "e"), ("beta: 5%", "5%"), ("-5%", "5%")]:
        with pytest.raises(mi.InvalidParameter, match=told):
            distributions({"e": given}, system)
    with pytest.raises(mi.InvalidParameter, match="bias is 0, so a relative tolerance"):
        distributions({"bias": "5%"}, system)
