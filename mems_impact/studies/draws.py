"""What is drawn for a study of scatter: quantities by their distributions, parameters of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.sampling import digest_of, unit_sample
from mems_impact.studies.tolerance import relative_distribution

__all__ = ["FIRST", "SECOND", "Draws", "Making", "distributions", "draw", "matrices"]

Making = Callable[..., Mapping[str, float]]

FIRST, SECOND = "A", "B"  # the two samples of which indices are made


@dataclass(frozen=True, kw_only=True, eq=False)
class Draws:
    """Points that are drawn.

    Attributes
    ----------
    names : tuple of str
        What is drawn.
    values : float array, shape (points, names)
    parameters : tuple of str
        The parameters of the system that are made of it.
    settings : float array, shape (points, parameters)
    blocks : tuple of str
        To which sample each block of as many points belongs; one without indices.
    identity : dict
        What tells them from others.
    """

    names: tuple[str, ...]
    values: Floats
    parameters: tuple[str, ...]
    settings: Floats
    blocks: tuple[str, ...]
    identity: dict[str, Any]


def distributions(over: Any, system: System) -> dict[str, Any]:
    """Return distributions by name, those that are told as a part of a parameter about its value.

    InvalidParameter unless the others are frozen ones of scipy.stats.
    """
    allowed = 'distributions by name: {"e": scipy.stats.norm(0.62, 0.02), "d": "5%"}'
    if not isinstance(over, Mapping) or not over:
        raise InvalidParameter("over", over, allowed)
    found = {
        name: relative_distribution(name, given, system) if isinstance(given, str) else given
        for name, given in over.items()
    }
    for name, given in found.items():
        if not (callable(getattr(given, "ppf", None)) and hasattr(given, "dist")):
            frozen = 'a frozen distribution of scipy.stats, such as norm(0.62, 0.02), or "5%"'
            raise InvalidParameter(f"over.{name}", given, frozen)
    return found


def draw(
    system: System,
    over: Mapping[str, Any],
    making: Making | None,
    *,
    samples: int,
    sampling: str,
    seed: int,
    indices: bool,
) -> Draws:
    """Draw points.

    Parameters
    ----------
    system : System
    over : mapping of str to distribution
    making : callable, optional
        Parameters by name of what is drawn, given by name; what is drawn are parameters by default.
    samples : int
        Points of a sample.
    sampling : {"sobol", "lhs", "random"}
    seed : int
    indices : bool
        Whether two samples are drawn, and for every quantity the first once more, with that
        quantity from the second (Saltelli et al., *Computer Physics Communications* 181, 259,
        2010).
    """
    names, count = tuple(over), len(over)
    unit = unit_sample(samples, 2 * count if indices else count, sampling, seed)
    blocks = [
        np.stack([over[name].ppf(part) for name, part in zip(names, block.T, strict=True)], axis=1)
        for block in np.split(unit, 2 if indices else 1, axis=1)
    ]
    which: tuple[str, ...] = ("",)
    if indices:
        first, second = blocks
        for i in range(count):
            mixed = first.copy()
            mixed[:, i] = second[:, i]
            blocks.append(mixed)
        which = (FIRST, SECOND, *(f"{FIRST}, {name} of {SECOND}" for name in names))
    values = np.concatenate(blocks)
    parameters, settings = _made(system, names, values, making)
    told = {
        "over": {name: _told(given) for name, given in over.items()},
        "samples": samples,
        "sampling": sampling,
        "seed": seed,
        "indices": indices,
        "points": digest_of(np.hstack([values, settings])),
    }
    return Draws(
        names=names,
        values=values,
        parameters=parameters,
        settings=settings,
        blocks=which,
        identity=told,
    )


def matrices(draws: Draws, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the values of quantities, a column each, at the two samples and at those between.

    Returns
    -------
    first, second : array, shape (quantities, n)
    between : array, shape (drawn, quantities, n)
    """
    blocks = np.stack(np.split(values.T, len(draws.blocks), axis=1))
    return blocks[0], blocks[1], blocks[2:]


def _made(
    system: System, names: tuple[str, ...], values: Floats, making: Making | None
) -> tuple[tuple[str, ...], Floats]:
    """Return the parameters of the system that are made of what is drawn."""
    known = system.parameters
    if making is None:
        for name in names:
            system.check_parameter(name, "over")
        return names, values
    made = [making(**dict(zip(names, row, strict=True))) for row in values.tolist()]
    parameters = tuple(made[0]) if isinstance(made[0], Mapping) else ()
    unknown = [name for name in parameters if name not in known]
    if unknown or not parameters:
        problem = f"must return parameters among {', '.join(known)}"
        problem += f", not {unknown[0]}" if unknown else ""
        raise InvalidParameter("parameters", None, "", problem=problem)
    rows = [[float(row[name]) for name in parameters] for row in made]
    return parameters, np.array(rows)


def _told(given: Any) -> dict[str, Any]:
    """Return what tells a distribution from others; its points are told apart from that."""
    kind = given.dist
    told = {"name": getattr(kind, "name", type(kind).__name__), "args": given.args, **given.kwds}
    found: dict[str, Any] = json.loads(json.dumps(told, default=np.ndarray.tolist))
    return found
