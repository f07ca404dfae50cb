"""Projections onto the constraints of a mode, as source."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

PROJECTION_STEPS = 3  # iterations of Newton's method onto a curved surface
CONSTRAINT_STEP = 1e-3  # of the gradient of a constraint that takes no numbers with tangents
REDUNDANCY_RTOL = "1e-11"  # relative pivot below which an equation is redundant


def projection_source(constraints: Sequence[tuple[int, Callable[..., Any]]], n: int) -> list[str]:
    """Return the lines that project a state, a tuple ``s``, onto the constraints of its mode.

    They call the constraints as ``holds_0``, ``holds_1`` and so on, and construct states by
    ``State``.
    """
    lines = []
    for i, (mode, _) in enumerate(constraints):
        lines += [
            f"on{i} = mode == {mode}",
            f"r{i} = -holds_{i}(mode, t, s, q) if on{i} else 0.0",
        ]
        lines += [f"a{i}_{j} = {slope(i, j, n)} if on{i} else 0.0" for j in range(n)]
        for k in range(i + 1):
            gain = " + ".join(f"a{k}_{j} * a{i}_{j}" for j in range(n))
            lines.append(f"g{k}_{i} = {gain}")
    lines += elimination(len(constraints))
    components = (
        " + ".join([f"s[{j}]", *(f"a{i}_{j} * f{i}" for i in range(len(constraints)))])
        for j in range(n)
    )
    lines.append(f"s = State({', '.join(components)})")
    return [
        f"for _ in range({PROJECTION_STEPS}):",
        *(f"    {line}" for line in lines),
        "return mode, s",
    ]


def slope(i: int, j: int, n: int) -> str:
    """Return the derivative of a constraint by a component of the state, as an expression."""
    state = ", ".join(f"with_rate(s[{k}], {float(k == j)})" for k in range(n))
    moving = f"with_rate(t, 0.0, s[0]), State({state})"
    return f"along(holds_{i}, {CONSTRAINT_STEP!r}, mode, {moving}, q)[1]"


Pairs = set[tuple[int, int]]


def elimination(
    k: int, redundant: str = REDUNDANCY_RTOL, coupled: Pairs | None = None
) -> list[str]:
    """Return the lines that solve the symmetric system ``g`` with the right sides ``r`` for ``f``.

    Unknowns of redundant equations are zero, as are elements of ``g`` beside the diagonal that are
    not among the pairs `coupled`, of all equations by default.
    """
    coupled = all_pairs(k) if coupled is None else coupled
    sizes = [f"size{i} = g{i}_{i}" for i in range(k)]
    return [*sizes, *triangular(k, redundant, coupled), *substitution(k, coupled)]


def all_pairs(k: int) -> Pairs:
    """Return the pairs i < j of k numbers."""
    return set(itertools.combinations(range(k), 2))


def triangular(k: int, redundant: str, coupled: Pairs) -> list[str]:
    """Return the lines that bring the symmetric system to triangular form, by ``share``.

    Elements that become nonzero are added to `coupled`.
    """
    lines = []
    for i in range(k):
        lines.append(f"alone{i} = g{i}_{i} > {redundant} * size{i}")
        lines.append(f"inverse{i} = 1.0 / g{i}_{i} if alone{i} else 0.0")
        others = [j for j in range(i + 1, k) if (i, j) in coupled]
        coupled |= set(itertools.combinations(others, 2))
        for j in others:
            lines.append(f"share{i}_{j} = g{i}_{j} * inverse{i}")
            lines += [f"g{j}_{n} -= share{i}_{j} * g{i}_{n}" for n in others if n >= j]
            lines.append(f"r{j} -= share{i}_{j} * r{i}")
    return lines


def substitution(k: int, coupled: Pairs) -> list[str]:
    """Return the lines that solve the triangular system for ``f``."""
    lines = []
    for i in reversed(range(k)):
        known = "".join(f" - g{i}_{j} * f{j}" for j in range(i + 1, k) if (i, j) in coupled)
        lines.append(f"f{i} = (r{i}{known}) * inverse{i}")
    return lines
