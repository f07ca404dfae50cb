"""Equilibria of a system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.formatting import stability_name
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.equilibrium import EquilibriumState, find_equilibrium
from mems_impact.systems.base import HybridSystem, system_at
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, interval, whole

SAME_STATE_RTOL = 1e-6  # relative difference below which two states are one equilibrium
SEED = 1  # of the starting points of Newton's method between bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class Equilibrium(Result):
    """An equilibrium of a system in one mode, stable or unstable.

    Attributes
    ----------
    system : System
        At the parameters of the equilibrium.
    numeric : EquilibriumState
        The equilibrium as arrays.

    See Also
    --------
    find_equilibria, continue_solution

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> round(found.state.x, 9), found.stable
    (1.0, True)
    >>> [f"{value:.4f}" for value in found.eigenvalues]
    ['-0.0500+1.4133j', '-0.0500-1.4133j']
    """

    system: HybridSystem = field(repr=False)
    numeric: EquilibriumState = field(repr=False)

    def __repr__(self) -> str:
        kind = stability_name(self.stable)
        kind += f" in its mode, on the boundary {self.boundaries[0]!r}" if self.boundaries else ""
        kind += "" if self.admissible else ", virtual"
        kind += f", one of a continuum of dimension {self.nullity}" if self.nullity else ""
        return f"Equilibrium({kind}, {self.state})"

    def summary(self) -> dict[str, Any]:
        """Return its state, stability and admissibility."""
        largest = self.eigenvalues[:3].tolist()
        return {
            "system": repr(self.system),
            "state": repr(self.state),
            "stability": stability_name(self.stable),
            "boundaries": ", ".join(self.boundaries) or "none",
            "eigenvalues": ", ".join(f"{each:.6g}" for each in largest),
            "admissible": self.admissible or f"beyond {', '.join(self.violated_guards)}",
        }

    @property
    def mode(self) -> str:
        """Name of its mode."""
        return self.system.modes[self.numeric.mode]

    @property
    def state(self) -> State:
        """Its state; ``initial`` of a run."""
        numeric = self.numeric
        return self.system.state_space.state(
            HybridState(0, 0.0, numeric.mode, numeric.state, initial=True)
        )

    @property
    def eigenvalues(self) -> NDArray[np.complex128]:
        """Eigenvalues of the Jacobian of the flow, per unit of time, largest real part first.

        The zero eigenvalues of a continuum are omitted (see `nullity`).
        """
        return self.numeric.eigenvalues / self.system.units.out("time", 1.0)

    @property
    def nullity(self) -> int:
        """Dimension of the continuum of equilibria around this equilibrium, 0 if isolated.

        A body that sticks or rests has a continuum of equilibria.
        """
        return self.numeric.nullity

    @property
    def stable(self) -> bool | None:
        """Whether all eigenvalues have negative real parts: states of its mode approach it.

        None ("neutral") if an eigenvalue is imaginary within its error, 1e-9 of the entries of the
        Jacobian matrix of the flow, and no eigenvalue has a positive real part. On a boundary,
        stability depends on the flow beyond as well.
        """
        return self.numeric.stable

    @property
    def admissible(self) -> bool:
        """Whether no guard is violated; otherwise the equilibrium is virtual.

        A motion may rest at a virtual equilibrium where all violated guards wait.
        """
        return self.numeric.admissible

    @property
    def boundaries(self) -> tuple[str, ...]:
        """The guards whose margins are zero, so that states nearby are in several modes."""
        return self.numeric.boundaries

    @property
    def violated_guards(self) -> tuple[str, ...]:
        """The guards that a virtual equilibrium violates."""
        return self.numeric.violated


def equilibrium_of(system: HybridSystem, state: EquilibriumState) -> Equilibrium:
    """Return an equilibrium of `orbits` as an `Equilibrium` at its own parameters."""
    return Equilibrium(system=system_at(system, state.family.values), numeric=state)


@takes_system(start="guess")
def find_equilibria(
    system: HybridSystem,
    *,
    guess: State | Mapping[str, float] | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
    samples: int = 64,
    modes: Sequence[str | int] | None = None,
) -> tuple[Equilibrium, ...]:
    """Find the equilibria of each mode of an autonomous system.

    Newton's method starts from the guess and from points of a box, with a Jacobian by
    finite differences of sixth order. Cyclic states need not be constant.

    Parameters
    ----------
    system : System, or Run
        A run provides its system and, as `guess`, its last state.
    guess : State or mapping of str to float, optional
        A state near an equilibrium; the initial state of the system by default.
    box : mapping of str to (float, float), optional
        Ranges by state, in which to search as well; other states start as in `guess`.
    samples : int, optional
        Number of starting points in the box, from a Sobol sequence.
    modes : sequence of str or int, optional
        Modes to search; all by default.

    Returns
    -------
    tuple of Equilibrium
        Equilibria in order of the modes, admissible ones first. A continuum is represented by the
        equilibrium closest to the guess.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the system has forcing.
    OrbitError
        If no equilibrium is found.

    See Also
    --------
    Equilibrium, continue_solution

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> found = mi.find_equilibria(well, box={"x": (-2.0, 2.0), "v": (-1.0, 1.0)})
    >>> sorted((round(point.state.x, 9) + 0.0, point.stable) for point in found)
    [(-1.0, True), (0.0, False), (1.0, True)]
    """
    if system.forced:
        problem = "the system has forcing, hence periodic orbits (find_orbit) but no equilibria"
        raise InvalidParameter("period", system.forcing_period, "", problem=problem)
    inner = system.problem(ORBIT_OPTIONS)
    start = system.state_space.instant(guess, inner, field="guess")
    box = checked_box(system, box or {})
    guesses = [start.y, *_between(system, start.y, box, whole("samples", samples, 1))]
    chosen = range(len(system.modes)) if modes is None else modes
    numbers = sorted({system.state_space.mode_number(mode, "modes") for mode in chosen})
    family = system.family(ORBIT_OPTIONS)
    equilibria: list[Equilibrium] = []
    failed: OrbitError | None = None
    for mode in numbers:
        in_mode: list[EquilibriumState] = []
        for y in guesses:
            try:
                state = find_equilibrium(family, mode, y)
            except OrbitError as error:
                failed = failed or error
                continue
            if not _inside(system, state.state, box) and y is not start.y:
                continue
            # A contact that holds leaves the position open: the state has to be admissible in its
            # mode.
            if state.admissible and not system.state_space.fits(mode, state.state, inner):
                continue
            # A state on a boundary belongs to the first of the modes that meet there.
            met = [each.numeric for each in equilibria if state.boundaries and each.boundaries]
            known = any(_same(state, other) for other in in_mode)
            if not known and not any(_coincide(state, other) for other in met):
                in_mode.append(state)
        in_mode.sort(key=lambda state: (not state.admissible, *state.state.tolist()))
        equilibria += [Equilibrium(system=system, numeric=state) for state in in_mode]
    if not equilibria:
        reason = "no equilibrium was found" if failed is None else failed.reason
        argument = f"box={{{system.states[0]!r}: (low, high)}}"
        raise OrbitError(reason, f"give another guess, or {argument} for the search")
    return tuple(equilibria)


def _same(state: EquilibriumState, other: EquilibriumState) -> bool:
    """Return whether two states are the same equilibrium, or belong to one continuum."""
    if state.nullity and state.nullity == other.nullity:
        return True
    return _coincide(state, other)


def _coincide(state: EquilibriumState, other: EquilibriumState) -> bool:
    """Return whether two equilibria have one state."""
    size = 1.0 + float(np.abs(state.state).max(initial=0.0))
    return float(np.abs(state.state - other.state).max(initial=0.0)) < SAME_STATE_RTOL * size


def checked_box(
    system: HybridSystem, box: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Return ranges of states as numbers; InvalidParameter for others."""
    if not isinstance(box, Mapping):
        allowed = f'ends of some states, {{"{system.states[0]}": (low, high)}}'
        raise InvalidParameter("box", box, allowed)
    checked = {}
    for name, pair in box.items():
        if name not in system.states:
            raise InvalidParameter("box", name, f"one of {', '.join(system.states)}")
        label = f"box.{name}"
        checked[name] = interval(label, pair, system.units.parse(name, pair, label))
    return checked


def _inside(system: HybridSystem, y: Floats, box: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether a state lies in the box of the search."""
    values = dict(zip(system.states, y.tolist(), strict=True))
    return all(
        low <= system.units.out(name, values[name]) <= high for name, (low, high) in box.items()
    )


def _between(
    system: HybridSystem, y: Floats, box: Mapping[str, tuple[float, float]], samples: int
) -> list[Floats]:
    """Return the starting points in a box."""
    if not box:
        return []
    from scipy.stats import qmc

    indices = [system.states.index(name) for name in box]
    low, high = ([system.units.into(name, ends[i]) for name, ends in box.items()] for i in (0, 1))
    sobol = qmc.Sobol(len(indices), scramble=False, seed=SEED)
    # Sobol sequences need a power of two; the first point is a corner.
    sample = sobol.random(1 << (samples - 1).bit_length())[:samples]
    guesses = np.tile(y, (samples, 1))
    guesses[:, indices] = qmc.scale(sample, low, high)
    return list(guesses)
