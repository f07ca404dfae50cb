"""The method of runs where none is chosen: one that copes with terms that are stiff."""

import json
import math

import pytest

import mems_impact as mi
from mems_impact.actuator.terms.files import term_type

MITA, ZHAO = mi.load_actuator("mita2003"), mi.load_actuator("zhao2004")
AIR = mi.SqueezeFilm(
    length=2e-4, width=1e-4, pressure=1e5, viscosity=1.82e-5, free_path_pressure=6.7e-3
)
FILM = mi.SqueezeFilm(length=1.0, width=0.5, pressure=2.0, viscosity=1.0, free_path_pressure=0.1)
STIFF = {
    "squeeze_film": AIR,
    "series_resistance": mi.SeriesResistance(resistance=1e4, parasitic_capacitance=1e-13),
    "regularized_friction": mi.RegularizedFriction(width=1e-7),
    "compliant_stopper": mi.CompliantStopper(stiffness=5e3, damping=50.0),
}
SLOW = mi.Sine(amplitude=100.0, omega=2.0 * math.pi)
DRIVE = mi.Sine(amplitude=0.6, omega=0.5)
INTERPRETED = mi.Options(engine="interpreted")

pytestmark = pytest.mark.filterwarnings("ignore::mems_impact.errors.ValidityWarning")


def test_these_terms_are_stiff():
    assert all(term_type(name).stiff for name in STIFF)


@pytest.mark.nightly
@pytest.mark.parametrize("name", STIFF)
def test_a_device_with_a_stiff_term_runs_by_default(name):
    """Where Adams' method is lost; beside a run with a hundredth of the tolerances."""
    device = MITA.adding(STIFF[name])
    with pytest.raises(mi.RunError, match="max_steps"):
        mi.simulate(device, SLOW, 1, options=mi.Options(method="adams", max_steps=20_000))
    run = mi.simulate(device, SLOW, 1)
    assert run.options.method == "auto"
    assert run.summary()["method"] == "auto, rtol 1e-09"
    assert "by bdf" in repr(run)
    fine = mi.Options(method="bdf", rtol=1e-11, atol=1e-13)
    reference = mi.simulate(device, SLOW, 1, options=fine)
    assert reference.options == fine
    assert run.final.x1 == pytest.approx(reference.final.x1, rel=1e-6)
    assert run.verify().agrees


def test_a_choice_of_the_users_wins():
    system = ZHAO.adding(FILM).under(DRIVE)
    for method in ("adams", "bdf", "dop853", "auto"):
        assert system.problem(mi.Options(method=method)).options.method == method
    assert system.problem(mi.Options(rtol=1e-8)).options == mi.Options(method="auto", rtol=1e-8)
    assert ZHAO.under(DRIVE).problem(mi.Options()).options == mi.Options(method="adams")
    # An orbit keeps to the one of both that suits.
    assert system.family(mi.Options()).suited(stiff=True).problem().options.method == "bdf"


@pytest.mark.slow
def test_results_and_files_tell_the_method(tmp_path):
    device = ZHAO.adding(FILM)
    run = mi.simulate(device, DRIVE, 1, initial={"v2": 1.0}, options=INTERPRETED)
    assert run.arcs.keys() == {"dop853", "bdf"}
    run.save(tmp_path / "run.zip")
    assert mi.load(tmp_path / "run.zip").options.method == "auto"
    store = tmp_path / "sweep"
    mi.sweep(
        device, DRIVE, "amplitude", [0.5, 0.6], transient=1, periods=1, options=INTERPRETED,
        store=store,
    )  # fmt: skip
    assert '"auto"' in json.dumps(json.loads((store / "study.json").read_text())["identity"])
