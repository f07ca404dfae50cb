"""Random systems with one to three switching surfaces, beside smoothed ones.

x' = A x - b x^3 + c + B s (1 + d sin(x_n)), where s_i is the sign of a linear combination of the
states. The reference replaces the signs by tanh(h/w) and integrates by LSODA for two widths w; a
case counts as far as the two agree. Where the package says that the motion is not unique, motions
of the reference from starts beside each other must part.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import mems_impact as mi
from validation.campaign.comparing import ONE, Unit, Verdict

Floats = NDArray[np.float64]

END = 3.0
WIDTHS = (1e-4, 1e-5)
PARTED = 3e-2  # difference of two references that agree no longer
SHARE, FLOOR = 0.5, 1e-6  # of the difference of the references, that the package may be off


@cache
def system(k: int) -> mi.System:
    """Return the system with k surfaces and a further state."""
    n = k + 1
    lines = ["def flow(mode, t, y, p):", f"    jump = 1.0 + p.d * math.sin(y.x{n - 1})"]
    for i in range(n):
        terms = [f"p.a{i}{j} * y.x{j}" for j in range(n)]
        terms += [f"-p.b * y.x{i} * y.x{i} * y.x{i}", f"p.c{i}"]
        terms += [f"jump * p.B{i}{j} * mode.s{j}" for j in range(k)]
        lines.append(f"    d{i} = {' + '.join(terms)}")
    lines.append(f"    return ({', '.join(f'd{i}' for i in range(n))},)")
    space: dict[str, Any] = {"math": __import__("math")}
    exec(compile("\n".join(lines), "<surfaces>", "exec"), space)
    names = [f"a{i}{j}" for i in range(n) for j in range(n)] + [f"c{i}" for i in range(n)]
    names += [f"B{i}{j}" for i in range(n) for j in range(k)] + ["b", "d"]
    names += [f"h{i}{j}" for i in range(k) for j in range(n)]
    surfaces = [
        mi.SwitchingSurface(f"s{i}", {f"x{j}": f"h{i}{j}" for j in range(n)}) for i in range(k)
    ]
    still = dict.fromkeys(names, 0.0)
    still |= {f"h{i}{i}": 1.0 for i in range(k)} | {f"B{i}{i}": -1.0 for i in range(k)}
    return mi.System(
        states=tuple(f"x{i}" for i in range(n)), flow=space["flow"], parameters=still,
        initial=dict.fromkeys([f"x{i}" for i in range(n)], 1.0), parts=surfaces,
    )  # fmt: skip


def drawn(rng: np.random.Generator, k: int) -> dict[str, Floats]:
    """Draw the numbers of a system and its start."""
    n = k + 1
    coupled = rng.random() < 0.7
    jumps = np.zeros((n, k))
    jumps[:k] = -np.diag(rng.uniform(0.5, 3.0, k)) * np.where(rng.random(k) < 0.9, 1.0, -0.3)
    if coupled:
        jumps += rng.normal(0.0, 0.8, (n, k)) * (rng.random((n, k)) < 0.7)
    jumps[k] += rng.normal(0.0, 1.0, k)
    normals = np.eye(n)[:k] + coupled * rng.normal(0.0, 0.3, (k, n)) * (rng.random((k, n)) < 0.5)
    return {
        "a": rng.normal(0.0, 0.4, (n, n)), "c": rng.normal(0.0, 0.5, n), "B": jumps, "h": normals,
        "b": np.array(rng.choice([0.0, 0.2])), "d": np.array(rng.choice([0.0, 0.4])),
        "start": rng.uniform(-1.0, 1.0, n),
    }  # fmt: skip


def smoothed(numbers: dict[str, Floats], start: Floats, width: float) -> Floats:
    """Return the end of the reference's motion."""

    def slope(_: float, x: Floats) -> Floats:
        signs = np.tanh(numbers["h"] @ x / width)
        free = numbers["a"] @ x - numbers["b"] * x**3 + numbers["c"]
        result: Floats = free + (1.0 + numbers["d"] * np.sin(x[-1])) * (numbers["B"] @ signs)
        return result

    done = solve_ivp(slope, (0.0, END), start, method="LSODA", rtol=1e-9, atol=1e-11)
    result: Floats = done.y[:, -1]
    return result


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Run a case of the package beside the reference."""
    rng = np.random.default_rng([seed, number])
    k = int(rng.integers(1, 4))
    numbers = drawn(rng, k)
    verdict = Verdict("surfaces", number)
    start = numbers["start"]
    values = {
        f"{name}{''.join(map(str, place))}": float(value)
        for name, array in numbers.items()
        if name != "start"
        for place, value in np.ndenumerate(array)
    }
    coarse, fine = (smoothed(numbers, start, width) for width in WIDTHS)
    apart = float(np.abs(coarse - fine).max())
    try:
        initial = {f"x{i}": float(value) for i, value in enumerate(start)}
        options = mi.Options(method=unit.method, rtol=1e-10, atol=1e-12)
        run = mi.simulate(
            system(k).changed(**values), duration=END, initial=initial, options=options
        )
    except mi.RunError as error:
        beside = smoothed(numbers, start + 1e-6 * rng.normal(size=k + 1), WIDTHS[1])
        also = smoothed(numbers, start - 1e-6 * rng.normal(size=k + 1), WIDTHS[1])
        parts = max(apart, float(np.abs(beside - fine).max()), float(np.abs(also - fine).max()))
        verdict.horizon = 0.0
        if parts < PARTED or "not unique" not in str(error):
            verdict.story = f"refused, while references agree within {parts:.1e}: {error}"
        return verdict
    if apart > PARTED:
        verdict.horizon = 0.0
        return verdict
    verdict.events = len(run.events)
    end = np.array([float(getattr(run.final, f"x{i}")) for i in range(k + 1)])
    off = float(np.abs(end - fine).max())
    if not off <= SHARE * apart + FLOOR * (1.0 + float(np.abs(fine).max())):
        verdict.story = f"k = {k}, ends {off:.1e} off where references differ by {apart:.1e}"
    return verdict
