"""Random systems with one to three switching surfaces, beside smoothed ones.

x' = A x - b x^3 + c + B s (1 + d sin(x_n)), where s_i is the sign of h_i x + q_i (x^2 - 1): planes,
and curved surfaces in a third of the cases. In a third a body, u'' = x_0 + s_0 - u - u'/5, strikes
a stop at u = 1/5 with the restitution 0.7, and rests there after weak impacts. The reference
replaces the signs by tanh(h/w) and integrates by LSODA for two widths w; a case counts as far as
the two agree. Where the package says that the motion is not unique, motions of the reference must
part that start beside its state, with widths that differ between the surfaces, or signs with
hysteresis in place of smoothed ones; or a spiral around two surfaces must begin to expand there.
"""

from __future__ import annotations

import itertools
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
PLACE, RESTITUTION = 0.2, 0.7  # of the stop
MAX_IMPACTS = 300  # of the reference
REST_SPEED = 1e-5  # of an impact, below which the body of the reference rests
ASIDE, SHIFTS, LOOK = (1e-5, 1e-4), 8, 0.3  # distances and number of starts aside, and time
TOUCHED, NEUTRAL = 1e-7, 1e-3  # height on a surface, change of a spiral over one turn
HYSTERESIS = 1e-4  # width
AMPLIFIED = 30.0  # distance of motions that are not unique, over that of their starts
SHARE, FLOOR = 0.5, 1e-6  # of the difference of the references, that the package may be off


@cache
def system(k: int, curved: bool, stops: bool) -> mi.System:
    """Return the system with k surfaces, a further state and a body."""
    n = k + 1
    lines = ["def flow(mode, t, y, p):", f"    jump = 1.0 + p.d * math.sin(y.x{n - 1})"]
    for i in range(n):
        terms = [f"p.a{i}{j} * y.x{j}" for j in range(n)]
        terms += [f"-p.b * y.x{i} * y.x{i} * y.x{i}", f"p.c{i}"]
        terms += [f"jump * p.B{i}{j} * mode.s{j}" for j in range(k)]
        lines.append(f"    d{i} = {' + '.join(terms)}")
    flow = ", ".join(f"d{i}" for i in range(n))
    lines.append(f"    return ({flow}, y.v, y.x0 + mode.s0 - y.u - 0.2 * y.v)")
    for i in range(k):
        height = " + ".join(f"p.h{i}{j} * y.x{j} + p.q{i} * y.x{j} ** 2" for j in range(n))
        lines += [f"def h{i}(t, y, p):", f"    return {height} - p.q{i}"]
    space: dict[str, Any] = {"math": __import__("math")}
    exec(compile("\n".join(lines), "<surfaces>", "exec"), space)
    names = [f"a{i}{j}" for i in range(n) for j in range(n)] + [f"c{i}" for i in range(n)]
    names += [f"B{i}{j}" for i in range(n) for j in range(k)] + ["b", "d"]
    names += [f"h{i}{j}" for i in range(k) for j in range(n)]
    names += [f"q{i}" for i in range(k)]
    parts: list[mi.Part] = [
        mi.SwitchingSurface(f"s{i}", space[f"h{i}"])
        if curved
        else mi.SwitchingSurface(f"s{i}", {f"x{j}": f"h{i}{j}" for j in range(n)})
        for i in range(k)
    ]
    if stops:
        parts.append(mi.Stopper("stop", "u", "v", upper=PLACE, restitution=RESTITUTION))
    still = dict.fromkeys(names, 0.0)
    still |= {f"h{i}{i}": 1.0 for i in range(k)} | {f"B{i}{i}": -1.0 for i in range(k)}
    states = (*(f"x{i}" for i in range(n)), "u", "v")
    return mi.System(
        states=states, flow=space["flow"], parameters=still, parts=parts,
        initial=dict.fromkeys(states[:n], 1.0),
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
    numbers = {
        "a": rng.normal(0.0, 0.4, (n, n)), "c": rng.normal(0.0, 0.5, n), "B": jumps, "h": normals,
        "b": np.array(rng.choice([0.0, 0.2])), "d": np.array(rng.choice([0.0, 0.4])),
        "start": np.append(rng.uniform(-1.0, 1.0, n), (0.0, 0.0)), "q": np.zeros(k),
    }  # fmt: skip
    if rng.random() < 1.0 / 3.0:
        numbers["q"] = rng.normal(0.0, 0.5, k)
    return numbers


def smoothed(
    numbers: dict[str, Floats], stops: bool, start: Floats, width: float | Floats, end: float = END
) -> Floats:
    """Return the end of the reference's motion, nan if it fails or has more than `MAX_IMPACTS`."""

    def slope(_: float, y: Floats) -> Floats:
        x, (u, v) = y[:-2], y[-2:]
        signs = np.tanh((numbers["h"] @ x + numbers["q"] * (x @ x - 1.0)) / width)
        free = numbers["a"] @ x - numbers["b"] * x**3 + numbers["c"]
        flow = free + (1.0 + numbers["d"] * np.sin(x[-1])) * (numbers["B"] @ signs)
        return np.append(flow, (v, x[0] + signs[0] - u - 0.2 * v))

    def held(t: float, y: Floats) -> Floats:
        return slope(t, y) * np.append(np.ones(len(y) - 2), (0.0, 0.0))

    def gap(_: float, y: Floats) -> float:
        return float(PLACE - y[-2])

    def push(t: float, y: Floats) -> float:
        return float(slope(t, y)[-1])

    for event in (gap, push):
        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
    options: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-11, "method": "LSODA"}
    t, y, rests = 0.0, start, False
    for _ in range(MAX_IMPACTS):
        flow, event = (held, push) if rests else (slope, gap)
        try:
            done = solve_ivp(flow, (t, end), y, events=event if stops else None, **options)
        except ValueError:  # SciPy's interpolant has no root in the step
            break
        t, y = done.t[-1], done.y[:, -1]
        if done.status == 0:
            return y
        rests = not rests and abs(y[-1]) < REST_SPEED and push(t, y) > 0.0
        y[-2:] = PLACE, 0.0 if rests or event is push else -RESTITUTION * y[-1]
    return np.full_like(y, np.nan)


def parted(
    rng: np.random.Generator,
    numbers: dict[str, Floats],
    stops: bool,
    place: Floats,
    distance: float,
) -> float:
    """Return by how much motions part that start beside a state, over the distance."""
    k = len(numbers["h"])
    asides = np.pad(distance * rng.normal(size=(SHIFTS, k + 1)), ((1, 0), (0, 2)))
    widths = distance / 50.0 * 10.0 ** rng.uniform(-1.0, 1.0, (len(asides), k))
    ends = [
        smoothed(numbers, stops, place + aside, width, LOOK)
        for aside, width in zip(asides, widths, strict=True)
    ]
    return float(np.ptp(ends, axis=0).max()) / distance


def hysteretic(numbers: dict[str, Floats], place: Floats, widths: Floats) -> Floats:
    """Return the end of a motion without stops whose signs change beyond the widths."""
    heights, free = numbers["h"], numbers["a"]
    x, signs, step = place[:-2], np.ones(len(widths)), 0.1 * float(widths.min())
    for _ in range(int(LOOK / step)):
        h = heights @ x + numbers["q"] * (x @ x - 1.0)
        signs = np.where(np.abs(h) > widths, np.sign(h), signs)
        slope = free @ x - numbers["b"] * x**3 + numbers["c"]
        x = x + step * (slope + (1.0 + numbers["d"] * np.sin(x[-1])) * (numbers["B"] @ signs))
    return x


def parted_by_hysteresis(
    rng: np.random.Generator, numbers: dict[str, Floats], place: Floats
) -> float:
    """Return by how much a motion with hysteresis parts from a smoothed one, over the width."""
    k = len(numbers["h"])
    widths = HYSTERESIS * 10.0 ** rng.uniform(-0.5, 0.5, (SHIFTS, k))
    ends = [hysteretic(numbers, place, width) for width in widths]
    ends.append(smoothed(numbers, False, place, HYSTERESIS / 10.0, LOOK)[:-2])
    return float(np.ptp(ends, axis=0).max()) / HYSTERESIS


def neutral_spiral(numbers: dict[str, Floats], place: Floats) -> bool:
    """Return whether motions turn around two surfaces at a state and neither grow nor shrink."""
    x = place[:-2]
    heights = numbers["h"] @ x + numbers["q"] * (x @ x - 1.0)
    around = np.flatnonzero(np.abs(heights) < TOUCHED)
    if around.size != 2:
        return False
    normals = numbers["h"] + 2.0 * numbers["q"][:, None] * x
    free = numbers["a"] @ x - numbers["b"] * x**3 + numbers["c"]
    growth, turns = 1.0, 0.0
    for quadrant in itertools.product((1.0, -1.0), repeat=2):
        signs = np.sign(heights)
        signs[around] = quadrant
        slope = free + (1.0 + numbers["d"] * np.sin(x[-1])) * (numbers["B"] @ signs)
        outward = quadrant * (normals @ slope)[around]
        if outward.prod() > 0.0:
            return False
        growth *= outward.max() / -outward.min()
        turns += np.sign(outward[0]) * quadrant[0] * quadrant[1]
    return abs(turns) == 4.0 and abs(growth - 1.0) < NEUTRAL


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Run a case of the package beside the reference."""
    rng = np.random.default_rng([seed, number])
    k = int(rng.integers(1, 4))
    numbers = drawn(rng, k)
    stops = bool(rng.random() < 1.0 / 3.0)
    verdict = Verdict("surfaces", number)
    start = numbers["start"]
    values = {
        f"{name}{''.join(map(str, place))}": float(value)
        for name, array in numbers.items()
        if name != "start"
        for place, value in np.ndenumerate(array)
    }
    coarse, fine = (smoothed(numbers, stops, start, width) for width in WIDTHS)
    apart = float(np.abs(coarse - fine).max())
    try:
        model = system(k, bool(numbers["q"].any()), stops).changed(**values)
        initial = dict(zip(model.states, start.tolist(), strict=True))
        options = mi.Options(method=unit.method, rtol=1e-10, atol=1e-12)
        run = mi.simulate(model, duration=END, initial=initial, options=options)
    except mi.RunError as error:
        place = np.array([error.state[name] for name in model.states])
        parts = max(parted(rng, numbers, stops, place, distance) for distance in ASIDE)
        if not parts > AMPLIFIED:
            parts = parted_by_hysteresis(rng, numbers, place)
        verdict.horizon = 0.0
        right = parts > AMPLIFIED or neutral_spiral(numbers, place)
        if not right or "not unique" not in str(error):
            verdict.story = f"refused, while distances grow by {parts:.1e} only: {error}"
        return verdict
    if not apart <= PARTED:
        verdict.horizon = 0.0
        return verdict
    verdict.events = len(run.events)
    end = np.array([float(getattr(run.final, name)) for name in model.states])
    off = float(np.abs(end - fine).max())
    if not off <= SHARE * apart + FLOOR * (1.0 + float(np.abs(fine).max())):
        verdict.story = f"k = {k}, ends {off:.1e} off where references differ by {apart:.1e}"
    return verdict
