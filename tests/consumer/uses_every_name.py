"""What a user's checker sees: every public name once, as `mypy --strict` infers it.

Nothing here is run; `test_consumer` lets mypy read it.
"""

import math
from typing import Any, assert_type

import mems_impact as mi
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun


def errors(caught: BaseException) -> str:
    known = (
        mi.EngineUnavailable | mi.FileNotWritten | mi.FunctionError | mi.FunctionsMissing
        | mi.InvalidFile | mi.OrbitError | mi.RunError | mi.WorkersLost
    )  # fmt: skip
    if isinstance(caught, mi.InvalidParameter):
        return assert_type(caught.field, str)
    if isinstance(caught, known | mi.MemsImpactError | mi.Interrupted):
        return str(caught)
    return "none of the package's"


WARNINGS: tuple[type[Warning], ...] = (
    mi.EngineFallbackWarning, mi.FitWarning, mi.PluginWarning, mi.ScaleWarning,
    mi.DiscontinuityWarning, mi.LengthWarning, mi.StartWarning, mi.StiffnessWarning,
    mi.TransientWarning, mi.UnitsWarning, mi.ValidityWarning,
)  # fmt: skip


def devices() -> tuple[mi.Actuator, mi.Drive]:
    terms: tuple[mi.Term, ...] = (
        mi.ChargeDrive(parasitic_capacitance=1e-13),
        mi.TabulatedRestitution(speeds=(0.0, 1.0), values=(0.8, 0.7)),
        mi.Tilt(angle=0.05),
    )
    process: dict[str, Any] = {"thickness": 25e-6, "youngs_modulus": 169e9, "density": 2330.0}
    beams: tuple[Any, ...] = (
        mi.FoldedBeams(count=4, length=3e-4, width=3e-6),
        mi.CrabLegs(count=4, length=3e-4, width=3e-6, shin_length=1e-4, shin_width=3e-6),
        mi.ClampedBeams(count=4, length=3e-4, width=3e-6),
        mi.CombFingers(count=9, length=4e-5, width=3e-6, gap=2e-6, overlap=2e-5, tip_gap=2e-5),
        mi.PlateElectrode(length=1e-4, width=1e-4, gap=2e-6),
    )
    fingers = mi.GapClosingFingers(count=9, length=4e-5, width=3e-6, gap=2e-6, overlap=2e-5)
    drawing = mi.Geometry(
        **process, springs=beams[0], block=(mi.Plate(length=1e-3, width=1e-3),), electrodes=fingers,
        travel=1e-6,
    )  # fmt: skip
    mi.load_actuator("mita2003").replace(k="5 N/m", c=drawing.thickness)
    actuator = mi.load_actuator("mita2003").adding(*terms[-2:])
    sine = mi.Sine(amplitude="100 V", omega=6.0)
    drives: list[mi.Drive] = [
        mi.Square(amplitude=1.0, omega=6.0),
        mi.Pulse(amplitude=1.0, width=0.1, period=1.0),
        mi.Trapezoid(amplitude=1.0, omega=6.0),
        mi.VoltageStep(amplitude=1.0),
        mi.PulseAndHold(amplitude=1.0, width=0.1, hold=0.5),
        mi.Sampled(times=(0.0, 0.5), voltages=(0.0, 1.0), period=1.0),
        mi.Burst(wave=sine, on=3.0, off=2.0),
        mi.Voltages(right=sine, left=sine),
        mi.Custom(function=math.cos, period=1.0),
        mi.load("wave.toml"),
    ]
    assert_type(mi.pull_in_voltage(actuator), float)
    assert_type(mi.pull_in_charge(actuator.adding(terms[0])), float)
    assert_type(actuator.datasheet, mi.DataSheet)
    assert_type(mi.resting_voltage(actuator), float)
    mi.step_length(actuator, 0.1)
    return actuator, drives[0]


def runs(actuator: mi.Actuator, drive: mi.Drive) -> None:
    run = mi.simulate(actuator, drive, periods=300, initial=mi.State(x2=0.0, v2=1.0))
    assert_type(run, ActuatorRun[mi.Actuator])
    assert_type(run.actuator, mi.Actuator)
    assert_type(actuator.under(drive).actuator, mi.Actuator)
    assert_type(
        mi.simulate(actuator.under(drive), 3, initial=mi.kicked_state(actuator)),
        ActuatorRun[mi.Actuator],
    )
    assert_type(
        mi.simulate(actuator=actuator, drive=drive, options=mi.Options()), ActuatorRun[mi.Actuator]
    )
    assert_type(run.verify(), mi.Verification)
    assert_type(run.derivatives(["e"]), mi.RunDerivatives[ActuatorRun[mi.Actuator]])
    mi.value_and_jacobian(run.system, lambda each: each.final.x, ["e"], duration=1.0)
    mi.jax_function(run.system, lambda each: each.final.x, ["e"], duration=1.0)
    assert_type(run.settling, mi.Settling)
    assert_type(mi.steady_state(run), mi.Run)
    assert_type(run.blow_statistics, mi.BlowStatistics)
    assert_type(mi.duty_cycle(run), mi.DutyCycle)
    assert_type(mi.energy(run), mi.Energy)
    assert_type(mi.life(run, wear=1e-16, area=1e-9, depth=1e-7), mi.WearLife)
    assert_type(mi.lyapunov(run), mi.LyapunovSpectrum)
    mi.classify(0.1, 0.01)
    run.step_lengths()
    mi.plot_return_map(run)
    mi.plot_run(run)
    mi.plot_energy(mi.energy(run))
    mi.plot_drive(drive)
    mi.to_xarray(run.samples())
    again: Any = mi.load("run.zip")
    assert isinstance(again, mi.Run)


def designs(actuator: mi.Actuator, drive: mi.Drive) -> None:
    target = mi.Target(quantity="pull-in voltage", value=30.0)
    fitted = assert_type(mi.fit(actuator, [target, mi.Record(samples="x2.csv")], ["k"]), mi.Fit)
    mi.plot_fit(fitted)
    assert_type(mi.force_curve(actuator, drive, [0.0]), mi.ForceCurve)
    assert_type(mi.ring_down(actuator, drive), mi.RingDown)
    assert_type(mi.closing(actuator, drive, duration="50 us"), mi.Closing)
    assert_type(mi.soft_landing(actuator), mi.SoftLanding)
    assert_type(mi.walking_drive(actuator), mi.Sine)
    mi.plot_closing(mi.closing(actuator, drive))
    assert_type(mi.operating_chart(actuator), mi.OperatingChart)
    assert_type(mi.period_one_window(actuator, drive, (1.0, 2.0)), mi.PeriodOneWindow)
    curve = mi.characteristic(actuator, drive, "amplitude", [1.0], curves=("omega", [0.5]))
    assert_type(curve, mi.Characteristic).resolution()
    mi.plot_characteristic(curve)
    mi.plot_force_curve(mi.force_curve(actuator, drive, [0.0]))
    mi.plot_chart(mi.operating_chart(actuator))
    assert_type(mi.report(actuator, drive, "report.html"), mi.DeviceReport)


def flow(mode: int, t: float, y: mi.NamedValues, p: mi.NamedValues) -> tuple[float, float]:
    return y.v, -p.k * assert_type(y.x, float)


def systems() -> mi.System:
    parts: list[mi.Part] = [
        mi.Friction("ground", "v", mu=mi.Stribeck(0.4, 0.3, 1.0)),
        mi.Stopper("wall", "x", "v", upper=1.0, restitution=0.8),
        mi.Relay("switch", "x", lower=-1.0, upper=1.0),
        mi.RateLimit("source", "x", limit=1.0),
        mi.SwitchingSurface("sliding", "x"),
    ]
    guards = [
        mi.Impact("floor", lambda mode, t, y, p: y.x, lambda mode, t, y, p: (mode, (0.0, -y.v))),
        mi.Guard("apex", lambda mode, t, y, p: y.v),
    ]
    height = mi.Observable("height", lambda mode, t, y, p: y.x)
    system = mi.System(states=("x", "v"), flow=flow, parts=parts, observables=[height])
    free, _held = mi.modes("free", "held")
    assert free is not None
    assert guards
    return system


def orbits(system: mi.HybridSystem, actuator: mi.Actuator, drive: mi.Drive) -> None:
    run = assert_type(mi.simulate(system, duration=3.0), mi.Run)
    with mi.style({}):
        moving = assert_type(mi.animate(run), mi.Animation)
    moving.save("run.gif")
    orbit = assert_type(mi.find_orbit(system), mi.Orbit)
    assert_type(mi.find_orbit(actuator, drive), ActuatorOrbit[mi.Actuator])
    branch = assert_type(
        mi.continue_solution(orbit, "A", 1.0, steps=mi.StepControl()), mi.Branch[mi.Orbit]
    )
    special = assert_type(branch.special_points[0], mi.SpecialPoint[mi.Orbit])
    assert_type(special.type, mi.GrazingType | mi.SlidingType | mi.BoundaryType | None)
    assert_type(special.normal_form, mi.NormalForm | None)
    assert_type(mi.switch_branch(special), mi.Branch[Any])
    assert_type(branch.homoclinic, mi.HomoclinicEnd | None)
    symmetry = assert_type(mi.symmetries(orbit)[0], mi.Symmetry)
    assert_type(symmetry.image(orbit), mi.Orbit)
    curve = assert_type(mi.continue_curve(special, "omega", 1.0), mi.Curve[Any])
    equilibrium = assert_type(mi.find_equilibria(system)[0], mi.Equilibrium)
    places = assert_type(mi.continue_solution(equilibrium, "A", 1.0), mi.Branch[mi.Equilibrium])
    saddle = assert_type(mi.manifold(orbit, "stable", length=1.0), mi.Manifold)
    mi.plot_manifold([saddle])
    assert_type(mi.edge_state(system, {"x": 0.0}, {"x": 1.0}), mi.EdgeState)
    place = assert_type(places.special_points[0], mi.SpecialPoint[mi.Equilibrium])
    assert_type(
        mi.continue_curve(place, "B", 1.0).points, tuple[mi.SpecialPoint[mi.Equilibrium], ...]
    )
    mi.plot_orbit(orbit)
    mi.plot_branch(branch)
    mi.plot_curve(curve)


def studies(system: mi.HybridSystem, orbit: mi.Orbit) -> None:
    mi.plot_sweep(assert_type(mi.sweep(system, "A", [0.1, 0.2]), mi.Sweep))
    axes = {"x": ("A", [0.1]), "y": ("omega", [1.0])}
    found = mi.operating_map(system, x=axes["x"], y=axes["y"], recurrence=mi.RecurrenceOptions())
    assert_type(found, mi.OperatingMap)
    mi.plot_map(found)
    basins = assert_type(mi.basins(system, x=("x", [0.0])), mi.Basins)
    assert_type(mi.continue_attractors(basins, "A", [0.1]), mi.AttractorBranches)
    mi.plot_basins(basins)
    diagram = assert_type(mi.bifurcation_diagram(system, "A", (0.0, 1.0)), mi.BifurcationDiagram)
    mi.plot_diagram(diagram)
    analysis = assert_type(mi.tolerance_analysis(system, over={}), mi.ToleranceAnalysis)
    mi.plot_tolerance_analysis(analysis)
    size = mi.Quantity("size", lambda orbit: 1.0)
    derivatives = assert_type(mi.sensitivity(orbit, quantities=[size]), mi.Sensitivity)
    mi.plot_sensitivity(derivatives, "size")
    best = mi.optimize(orbit, over={"A": (0.1, 0.2)}, maximize="size")
    assert_type(best, mi.Optimum)
    front = mi.pareto_front(
        orbit, {"size": "maximize", "period": "minimize"}, over={"A": (0.1, 0.2)}
    )
    assert_type(front, mi.ParetoFront)
    mi.plot_pareto(front)
    mi.bifurcation_margins(orbit, ["A"])
    stored: mi.StoredStudy = mi.load("store")
    assert stored.done
    mi.load("study.toml").run()
