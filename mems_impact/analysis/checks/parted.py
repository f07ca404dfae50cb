"""Whether the flow of a system that is put together from parts does what a flow must."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mems_impact.hybrid.tried import Place, Tried, Undefined
from mems_impact.hybrid.written import Definition, named

__all__ = ["check_parted"]


def check_parted(
    flow: Callable[..., Any],
    states: tuple[str, ...],
    parameters: Mapping[str, float],
    signs: Mapping[str, Sequence[int]],
    start: Mapping[str, float],
) -> None:
    """Try a flow by itself, at the start, in every combination of the modes of the parts.

    What is put together from it has a text of its own, in which nobody finds a mistake.

    Parameters
    ----------
    flow : callable
        ``flow(mode, t, y, p)``, which finds the mode of each part by its name.
    states : tuple of str
    parameters : mapping of str to float
    signs : mapping of str to sequence of int
        By part, what it may find as its mode.
    start : mapping of str to float

    Raises
    ------
    FunctionError
        If it does not do what it must.
    """
    definition = Definition(states=states, modes=("any",), parameters=tuple(parameters), flow=flow)
    tried, modes = Tried(definition, list(parameters.values())), named("Modes", tuple(signs))
    y = [float(start.get(name, 0.0)) for name in states]
    for each in itertools.product(*signs.values()):
        try:
            tried.flow(Place(modes(*each), 0.0, y))
        except Undefined:
            continue  # where runs come to is for the system as a whole to say
