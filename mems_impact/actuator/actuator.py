"""The actuator: parameters and terms, and what they become."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Self

from mems_impact.actuator.design.data_sheet import DataSheet, actuator_from_design
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.plausibility import check_plausible_device, check_plausible_drive
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import Term
from mems_impact.integrators.options import Options
from mems_impact.systems.state import State


class Actuator(ActuatorParameters):
    """The electrostatic impact microactuator: a block in a frame that rests on the ground.

    All parameters are keyword-only, in SI or dimensionless as in the paper, according to `units`.
    States, drives and results are in the same units. An actuator is immutable and hashable;
    `replace` returns a changed copy, `to_dimensionless` and `to_si` convert between the two forms.

    Parameters
    ----------
    m1 : float
        Mass of the frame [kg], > 0. Equation (1).
    m2 : float
        Mass of the block [kg], > 0. Equation (2).
    k : float
        Stiffness of the spring between block and frame [N/m], > 0. Equation (2).
    c : float
        Damping between block and frame [N s/m], >= 0. Equation (2).
    d : float
        Gap between the electrodes without voltage [m], > 0. Equation (2).
    delta : float
        Distance from the block at rest to each stopper [m], 0 < delta < d. An impact is at
        abs(x2) = delta.
    e : float
        Coefficient of restitution [-], 0 <= e <= 1. Equations (5) and (6).
    mu_s : float
        Coefficient of static friction, frame on ground [-], >= mu_d. Equation (4).
    mu_d : float
        Coefficient of dynamic friction, frame on ground [-], >= 0. Equation (3).
    alpha : float
        Half the permittivity times the overlap area of the electrodes [F m], > 0. The
        electrostatic force is alpha v^2 / (d - x2)^2. Equation (2).
    g : float
        Gravity [m/s^2], >= 0; the normal force on the ground is N = (m1 + m2) g, more with a
        `Clamp`. Equation (3).
    units : {"dimensionless", "SI"}, optional
        The units of all of the above, and of the terms.
    terms : tuple of Term, optional
        Additional terms of the model (see `mems_impact.actuator.terms`); none by default.
    geometry : Geometry, optional
        Drawing and process of the device, whose numbers are then parameters of the device.

    Raises
    ------
    InvalidParameter
        If a value is out of range or not a number, or a parameter is missing or unknown; if two
        terms have the same class, or replace the same rule.

    See Also
    --------
    load_actuator, Term, Drive, System

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> softer = actuator.replace(e=0.7)
    >>> softer.e, actuator.e
    (0.7, 0.8)
    >>> system = actuator.under(mi.Sine(amplitude=0.24, omega=0.5))
    >>> system.states
    ('x1', 'v1', 'x2', 'v2')
    """

    def under(self, drive: Drive) -> ActuatorSystem[Self]:
        """Return the system of this actuator under a drive.

        The system can replace the two arguments actuator and drive:
        ``simulate(actuator.under(drive))``.
        """
        system = ActuatorSystem(self, drive)
        check_plausible_device(self)
        check_plausible_drive(self, drive)
        return system

    @classmethod
    def from_design(cls, *, terms: Sequence[Term] = (), **quantities: Any) -> Self:
        """Return the actuator of a data sheet, in SI.

        Any consistent set of quantities that determines the device is accepted: two of
        `stiffness`, `frequency` and `proof_mass`; `damping`, `quality` or `damping_ratio`;
        `electrode_area`, `capacitance`, `pull_in` or `electrode_constant`, and so on. A drawing,
        ``geometry=Geometry(…)``, determines quantities and terms that are not given.

        Parameters
        ----------
        terms : sequence of Term, optional
            Additional terms of the model.
        **quantities : float or str
            By name, in SI, or as texts with a unit such as ``"1.2 kHz"``: frame_mass, proof_mass,
            total_mass, mass_ratio, stiffness, frequency [Hz] of the block in a held frame, damping,
            quality, damping_ratio, gap, travel (distance to each stopper), spring_force (at the
            stopper), restitution, electrode_area, capacitance, electrode_constant, pull_in and
            release [V], static_friction and dynamic_friction (coefficients; ``friction`` sets both,
            or is a pair), static_friction_force, dynamic_friction_force, gravity (9.80665 by
            default). See `DataSheet`.

        Returns
        -------
        Actuator

        Raises
        ------
        InvalidParameter
            If quantities contradict each other by more than 1e-6, or do not determine the device;
            the message names both values, or the missing quantities.

        See Also
        --------
        DataSheet, load_actuator, walking_drive

        Examples
        --------
        >>> import mems_impact as mi
        >>> device = mi.Actuator.from_design(
        ...     frequency="1.2 kHz", quality=30, proof_mass="0.2 mg", frame_mass="1 mg",
        ...     gap="4 um", travel="2.5 um", pull_in="70 V", friction=(0.35, 0.28),
        ...     restitution=0.65,
        ... )
        >>> round(device.k, 3), round(mi.pull_in_voltage(device), 9)
        (11.37, 70.0)
        """
        return actuator_from_design(cls, quantities, terms)

    def to_fmu(
        self,
        path: str | PathLike[str],
        drive: Drive,
        *,
        fmi: str = "3.0",
        inputs: Sequence[str] = (),
        initial: State | Mapping[str, float] | None = None,
        options: Options | None = None,
    ) -> Path:
        """Write the device under a drive as a functional mock-up unit (FMU).

        Parameters
        ----------
        path : str or os.PathLike
            Name of the file, usually with the suffix ``.fmu``.
        drive : Drive
        fmi, initial, options
            As for `System.to_fmu`.
        inputs : sequence of str, optional
            Parameters that become inputs. With ``"voltage"`` (and ``"left_voltage"`` for a second
            electrode) the voltage is an input, in place of the drive.

        Returns
        -------
        Path

        Raises
        ------
        InvalidParameter
            If an argument is not allowed.
        FunctionError
            If a function of the drive cannot be translated to C.

        See Also
        --------
        System, simulate

        Examples
        --------
        >>> import mems_impact as mi
        >>> device = mi.load_actuator("mita2003")
        >>> drive = mi.Sine(amplitude="60 V", frequency="100 Hz")
        >>> device.to_fmu("device.fmu", drive, inputs=["voltage"]).name
        'device.fmu'
        """
        return self.under(drive).to_fmu(
            path, fmi=fmi, inputs=inputs, initial=initial, options=options
        )

    def to_verilog_a(self, path: str | PathLike[str], *, electrodes: Literal[1, 2] = 1) -> None:
        """Write the device as a Verilog-A module for circuit simulators, named like the file.

        The ports are ``p``, ``n`` (electrode and block, electrical) and ``block``, ``frame``
        (kinematic: positions above the ground, moved by the forces at the ports). Numbers of device
        and terms, and the initial state, are parameters of the module.

        Parameters
        ----------
        path : str or os.PathLike
            The file, such as ``dev.va``.
        electrodes : {1, 2}, optional
            Number of electrodes; 2 for a module with a port of the left electrode, ``left`` between
            ``p`` and ``n``.

        Raises
        ------
        InvalidParameter
            If the device is dimensionless or has events (it lacks `CompliantStopper` or
            `RegularizedFriction`), or if it has a term of the source, which belongs to the circuit.
        FunctionError
            If a function of a term of your own cannot be translated.

        See Also
        --------
        load_actuator, CompliantStopper, RegularizedFriction

        Notes
        -----
        OpenVAF compiles the module for VACASK or ngspice. `to_fmu` exports impacts, sticking and
        slipping as events.

        Examples
        --------
        >>> import mems_impact as mi
        >>> from pathlib import Path
        >>> actuator = mi.load_actuator("mita2003").adding(
        ...     mi.CompliantStopper(stiffness=500.0), mi.RegularizedFriction(width=1e-5)
        ... )
        >>> actuator.to_verilog_a("dev.va")
        >>> [line for line in Path("dev.va").read_text().splitlines() if line[:6] == "module"]
        ['module dev(p, n, block, frame);']
        """
        from mems_impact.actuator.verilog_a import write_verilog_a

        write_verilog_a(self, path, electrodes)

    @property
    def datasheet(self) -> DataSheet:
        """Parameters and derived quantities, such as quality factor and pull-in voltage.

        Raises
        ------
        InvalidParameter
            If the device is dimensionless.
        """
        return DataSheet(self)
