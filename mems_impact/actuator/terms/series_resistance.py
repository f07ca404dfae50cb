"""A resistance between the drive and each electrode."""

from __future__ import annotations

from mems_impact.actuator.parameter_base import NonNegative, Positive
from mems_impact.actuator.terms.base import Electrode, Function, ParameterIndices, Shape, Term

__all__ = ["SeriesResistance"]


class SeriesResistance(Term):
    """A resistance of source or leads, through which each electrode is charged.

    Parameters
    ----------
    resistance : float
        Between drive and electrode [ohm], > 0.
    parasitic : float, optional
        Parasitic capacitance to ground, parallel to the electrode [F], >= 0.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    DielectricCharging, Fringing, Actuator

    Notes
    -----
    The charge behind the resistance is a state, ``charge`` (and ``left_charge``), 0 by default:

        charge = C(x) (node - offset) + parasitic node,    d charge/dt = (v - node)/resistance

    with the capacitance C(x) = 2 alpha/(d - x) of the electrode and terms in its gap, and the
    voltage ``node`` at the electrode, which determines the force (S. D. Senturia, *Microsystem
    Design*, 2001, Chapter 6). Slow charging prevents pull-in: at constant charge, without parasitic
    capacitance, the attraction does not grow as the gap closes (J. I. Seeger, B. E. Boser, J.
    Microelectromech. Syst. 12, 656 (2003)). The charge has the sign of the voltage: if the sign
    alternates, the forcing period is that of the voltage, not of its square.

    A time constant far below the forcing period makes the equations stiff, so the default method of
    runs is ``"auto"``.

    Examples
    --------
    >>> import mems_impact as mi
    >>> slower = mi.load_actuator("mita2003").adding(mi.SeriesResistance(resistance=1e9))
    """

    resistance: Positive
    parasitic: NonNegative = 0.0

    units = {"resistance": "ohm", "parasitic": "F", "charge": "C"}  # noqa: RUF012 - ClassVar above
    layer = 1
    signed = True
    stiff = True

    @classmethod
    def electrode_states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the charge."""
        return ("charge",)

    @classmethod
    def electrode(cls, at: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the voltage determined by its charge."""
        capacitance, offset = electrode.capacitance, electrode.offset
        charge, parasitic = at.y["charge"], at.p["parasitic"]

        def node(v, x, y, p):  # type: ignore[no-untyped-def]
            own = capacitance(x, p)
            return (y[charge] + own * offset(y, p)) / (own + p[parasitic])

        return electrode._replace(node=node)

    @classmethod
    def electrode_rates(
        cls, at: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> tuple[Function, ...]:
        """Return the current."""
        node, resistance = electrode.node, at.p["resistance"]

        def current(v, x, speed, y, p):  # type: ignore[no-untyped-def]
            return (v - node(v, x, y, p)) / p[resistance]

        return (current,)

    @classmethod
    def electrode_energy(cls, at: ParameterIndices, shape: Shape, electrode: Electrode) -> Function:
        """Return the energy of the fields, in the gap and in the parasitic capacitance."""
        node, offset, capacitance = electrode.node, electrode.offset, electrode.capacitance
        parasitic = at.p["parasitic"]

        def energy(v, x, y, p):  # type: ignore[no-untyped-def]
            own = node(v, x, y, p)
            across = own - offset(y, p)
            return 0.5 * (capacitance(x, p) * across * across + p[parasitic] * own * own)

        return energy

    @classmethod
    def electrode_lost(cls, at: ParameterIndices, shape: Shape, electrode: Electrode) -> Function:
        """Return the power dissipated in the resistance."""
        node, resistance = electrode.node, at.p["resistance"]

        def lost(v, x, y, p):  # type: ignore[no-untyped-def]
            drop = v - node(v, x, y, p)
            return drop * drop / p[resistance]

        return lost
