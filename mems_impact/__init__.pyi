# ruff: noqa: I001 - in the order of the reference, whose sections are the comments below
# The public names, each with its module: imported on first use by `__init__.py`.

# Describe a system
# Systems that switch between smooth modes (:doc:`hybrid`), and their parts (:doc:`parts`).
from .systems.base import HybridSystem as HybridSystem
from .systems.system import System as System
from .hybrid.automaton import Guard as Guard
from .hybrid.automaton import Impact as Impact
from .systems.state import modes as modes
from .systems.state import State as State
from .systems.state import NamedValues as NamedValues
from .systems.observables import Observable as Observable
from .systems.components.base import Part as Part
from .systems.components.friction import Friction as Friction
from .systems.components.friction import Stribeck as Stribeck
from .systems.components.stopper import Stopper as Stopper
from .systems.components.rate_limit import RateLimit as RateLimit
from .systems.components.relay import Relay as Relay
from .systems.components.switching_surface import SwitchingSurface as SwitchingSurface

# Describe a device
# The impact actuator of Zhao et al., and terms for further effects of real devices (:doc:`terms`).
from .actuator.actuator import Actuator as Actuator
from .actuator.device_files import load_actuator as load_actuator
from .actuator.design.data_sheet import DataSheet as DataSheet
from .actuator.terms.base import Term as Term
from .actuator.terms.squeeze_film import SqueezeFilm as SqueezeFilm
from .actuator.terms.series_resistance import SeriesResistance as SeriesResistance
from .actuator.terms.slew_rate import SlewRate as SlewRate
from .actuator.terms.charge_drive import ChargeDrive as ChargeDrive
from .actuator.terms.dielectric_charging import DielectricCharging as DielectricCharging
from .actuator.terms.fringing import Fringing as Fringing
from .actuator.terms.comb_drive import CombDrive as CombDrive
from .actuator.terms.tabulated_capacitance import TabulatedCapacitance as TabulatedCapacitance
from .actuator.terms.tilted_plate import TiltedPlate as TiltedPlate
from .actuator.terms.compliant_stopper import CompliantStopper as CompliantStopper
from .actuator.terms.adhesion import Adhesion as Adhesion
from .actuator.terms.power_law_restitution import PowerLawRestitution as PowerLawRestitution
from .actuator.terms.tabulated_restitution import TabulatedRestitution as TabulatedRestitution
from .actuator.terms.stribeck_friction import StribeckFriction as StribeckFriction
from .actuator.terms.regularized_friction import RegularizedFriction as RegularizedFriction
from .actuator.terms.cubic_stiffness import CubicStiffness as CubicStiffness
from .actuator.terms.tabulated_spring import TabulatedSpring as TabulatedSpring
from .actuator.terms.tilt import Tilt as Tilt
from .actuator.terms.clamp import Clamp as Clamp
from .actuator.terms.clamp_electrode import ClampElectrode as ClampElectrode
from .actuator.terms.frame_force import FrameForce as FrameForce
from .actuator.terms.frame_spring import FrameSpring as FrameSpring

# Draw a device
# Parts of a drawing, with a process (:doc:`device`).
from .actuator.geometry.geometry import Geometry as Geometry
from .actuator.geometry.folded_beams import FoldedBeams as FoldedBeams
from .actuator.geometry.crab_legs import CrabLegs as CrabLegs
from .actuator.geometry.clamped_beams import ClampedBeams as ClampedBeams
from .actuator.geometry.plate import Plate as Plate
from .actuator.geometry.comb_fingers import CombFingers as CombFingers
from .actuator.geometry.gap_closing_fingers import GapClosingFingers as GapClosingFingers
from .actuator.geometry.plate_electrode import PlateElectrode as PlateElectrode

# Drive a device
# Waveforms, each with its forcing period (:doc:`drives`).
from .actuator.drives.base import Drive as Drive
from .actuator.drives.sine import Sine as Sine
from .actuator.drives.square import Square as Square
from .actuator.drives.pulse import Pulse as Pulse
from .actuator.drives.trapezoid import Trapezoid as Trapezoid
from .actuator.drives.voltage_step import VoltageStep as VoltageStep
from .actuator.drives.pulse_and_hold import PulseAndHold as PulseAndHold
from .actuator.drives.sampled import Sampled as Sampled
from .actuator.drives.burst import Burst as Burst
from .actuator.drives.voltages import Voltages as Voltages
from .actuator.drives.custom import Custom as Custom

# Simulate
# Runs with event location (:doc:`guide`).
from .overloads import simulate as simulate
from .analysis.run import Run as Run
from .integrators.options import Options as Options
from .analysis.settling import Settling as Settling
from .analysis.steady_state import steady_state as steady_state
from .analysis.verification import Verification as Verification
from .actuator.state_space import kicked_state as kicked_state

# Differentiate and fit
# Derivatives of runs (:doc:`methods/derivatives`), and parameters from records (:doc:`howto/fit`).
from .analysis.run_derivatives import RunDerivatives as RunDerivatives
from .analysis.run_function import value_and_jacobian as value_and_jacobian
from .studies.jax_function import jax_function as jax_function
from .studies.fit import fit as fit
from .studies.fit import Fit as Fit
from .studies.records import Record as Record

# Find orbits and equilibria
# Stable or unstable (:doc:`orbits`), with Lyapunov exponents (:doc:`lyapunov`).
from .overloads import find_orbit as find_orbit
from .analysis.orbit import Orbit as Orbit
from .analysis.equilibrium import find_equilibria as find_equilibria
from .analysis.equilibrium import Equilibrium as Equilibrium
from .analysis.edge_state import edge_state as edge_state
from .analysis.edge_state import EdgeState as EdgeState
from .analysis.symmetry import symmetries as symmetries
from .analysis.symmetry import Symmetry as Symmetry
from .analysis.manifold import manifold as manifold
from .analysis.manifold import Manifold as Manifold
from .analysis.lyapunov import lyapunov as lyapunov
from .analysis.lyapunov import LyapunovSpectrum as LyapunovSpectrum
from .analysis.lyapunov import classify as classify

# Continue orbits and equilibria
# Branches over one parameter, special points, and their curves in two parameters (:doc:`orbits`).
from .analysis.branch import continue_solution as continue_solution
from .analysis.branch import Branch as Branch
from .analysis.special_points import SpecialPoint as SpecialPoint
from .continuation.arclength import StepControl as StepControl
from .analysis.branch import switch_branch as switch_branch
from .analysis.curve import continue_curve as continue_curve
from .analysis.curve import Curve as Curve
from .analysis.special_points import GrazingType as GrazingType
from .analysis.sliding_type import SlidingType as SlidingType
from .continuation.normal_forms import NormalForm as NormalForm
from .analysis.homoclinic import HomoclinicEnd as HomoclinicEnd
from .analysis.boundary_equilibrium_type import BoundaryType as BoundaryType

# Chart motions
# Sweeps, maps and basins, on one core or on a cluster (:doc:`studies`, :doc:`basins`).
from .studies.sweep import sweep as sweep
from .studies.sweep import Sweep as Sweep
from .studies.operating_map import operating_map as operating_map
from .studies.operating_map import OperatingMap as OperatingMap
from .analysis.attractor import RecurrenceOptions as RecurrenceOptions
from .studies.basins import basins as basins
from .studies.basins import Basins as Basins
from .studies.attractor_continuation import continue_attractors as continue_attractors
from .studies.attractor_continuation import AttractorBranches as AttractorBranches
from .studies.diagram_construction import bifurcation_diagram as bifurcation_diagram
from .studies.bifurcation_diagram import BifurcationDiagram as BifurcationDiagram

# Vary parameters
# Tolerances (:doc:`tolerances`), sensitivities and optima (:doc:`sensitivity`).
from .studies.uncertainty import tolerance_analysis as tolerance_analysis
from .studies.uncertainty import ToleranceAnalysis as ToleranceAnalysis
from .studies.sensitivity import sensitivity as sensitivity
from .studies.sensitivity import Sensitivity as Sensitivity
from .studies.sensitivity import bifurcation_margins as bifurcation_margins
from .studies.optimize import optimize as optimize
from .studies.optimize import Optimum as Optimum
from .studies.optimize import pareto_front as pareto_front
from .studies.optimize import ParetoFront as ParetoFront
from .systems.observables import Quantity as Quantity

# Design a device
# Design quantities of an actuator (:doc:`designer`, :doc:`device`).
from .actuator.design.estimates import pull_in_voltage as pull_in_voltage
from .actuator.design.estimates import pull_in_charge as pull_in_charge
from .actuator.design.estimates import resting_voltage as resting_voltage
from .actuator.design.walking_drive import walking_drive as walking_drive
from .actuator.design.step_length import step_length as step_length
from .actuator.design.characteristic import characteristic as characteristic
from .actuator.design.characteristic import Characteristic as Characteristic
from .actuator.design.period_one_window import period_one_window as period_one_window
from .actuator.design.period_one_window import PeriodOneWindow as PeriodOneWindow
from .actuator.design.chart_construction import operating_chart as operating_chart
from .actuator.design.operating_chart import OperatingChart as OperatingChart
from .actuator.results import BlowStatistics as BlowStatistics
from .actuator.design.duty_cycle import duty_cycle as duty_cycle
from .actuator.design.duty_cycle import DutyCycle as DutyCycle
from .actuator.design.energy import energy as energy
from .actuator.design.energy import Energy as Energy
from .actuator.design.wear import life as life
from .actuator.design.wear import WearLife as WearLife
from .actuator.design.force_curve import force_curve as force_curve
from .actuator.design.force_curve import ForceCurve as ForceCurve
from .actuator.report import report as report
from .actuator.report_page import DeviceReport as DeviceReport
from .actuator.design.ring_down import ring_down as ring_down
from .actuator.design.ring_down import RingDown as RingDown
from .actuator.design.closing import closing as closing
from .actuator.design.closing import Closing as Closing
from .actuator.design.soft_landing import soft_landing as soft_landing
from .actuator.design.soft_landing import SoftLanding as SoftLanding
from .actuator.design.targets import Target as Target

# Draw figures
# Functions that take axes or make a figure, and return the axes (:doc:`figures`).
from .plotting.trajectories import plot_run as plot_run
from .plotting.fits import plot_fit as plot_fit
from .plotting.trajectories import plot_orbit as plot_orbit
from .plotting.bifurcation import plot_sweep as plot_sweep
from .plotting.bifurcation import plot_branch as plot_branch
from .plotting.bifurcation import plot_curve as plot_curve
from .plotting.bifurcation import plot_diagram as plot_diagram
from .plotting.maps import plot_map as plot_map
from .plotting.maps import plot_basins as plot_basins
from .plotting.return_maps import plot_manifold as plot_manifold
from .plotting.return_maps import plot_return_map as plot_return_map
from .plotting.uncertainty import plot_tolerance_analysis as plot_tolerance_analysis
from .plotting.uncertainty import plot_sensitivity as plot_sensitivity
from .plotting.uncertainty import plot_pareto as plot_pareto
from .actuator.plots.drive import plot_drive as plot_drive
from .actuator.plots.energy import plot_energy as plot_energy
from .actuator.plots.force_curve import plot_force_curve as plot_force_curve
from .actuator.plots.characteristic import plot_characteristic as plot_characteristic
from .actuator.plots.chart import plot_chart as plot_chart
from .actuator.plots.closing import plot_closing as plot_closing
from .plotting.animation import animate as animate
from .plotting.animation import Animation as Animation
from .plotting.style import style as style

# Save and load
# Files of results, devices and studies; labelled arrays (:doc:`guide`, :doc:`studies`).
from .loading import load as load
from .studies.engine.store import StoredStudy as StoredStudy
from .tables import to_xarray as to_xarray

# Errors and interruptions
# Each message states the problem and the remedy in one line; interruptions hold the partial result.
from .errors import MemsImpactError as MemsImpactError
from .errors import InvalidParameter as InvalidParameter
from .errors import InvalidFile as InvalidFile
from .errors import FunctionError as FunctionError
from .errors import FunctionsMissing as FunctionsMissing
from .errors import FileNotWritten as FileNotWritten
from .errors import RunError as RunError
from .errors import OrbitError as OrbitError
from .errors import EngineUnavailable as EngineUnavailable
from .errors import WorkersLost as WorkersLost
from .errors import Interrupted as Interrupted
from .errors import EngineFallbackWarning as EngineFallbackWarning
from .errors import FitWarning as FitWarning
from .errors import UnitsWarning as UnitsWarning
from .errors import ScaleWarning as ScaleWarning
from .errors import ValidityWarning as ValidityWarning
from .errors import TransientWarning as TransientWarning
from .errors import StartWarning as StartWarning
from .errors import DiscontinuityWarning as DiscontinuityWarning
from .errors import LengthWarning as LengthWarning
from .errors import StiffnessWarning as StiffnessWarning
from .errors import PluginWarning as PluginWarning

__all__: list[str]
__version__: str
