"""Systems whose functions read the time: pulses, ramps, events at given times, late ones too.

Without a period the state grows at a rate that is linear in time between the edges of pulses, at
which the time also moves it; a mode that ends at a given time adds to the rate. With a period a
wave and a blow per period act, and the blow grows with the time. Reference: integrals and roots of
polynomials, in closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import mems_impact as mi
from validation.campaign.comparing import Unit, Verdict

BEFORE, AFTER = mi.modes("before", "after")
RTOL = 1e-10
CLEAR = 1e-6  # of the run: events closer than that may come in either order
INTERPRETED = 0.03  # share of the cases


@dataclass(frozen=True)
class Setting:
    """The numbers of a case; times are those since the start of the run, of the user."""

    begin: float
    length: float
    scale: float
    edges: tuple[float, float, float, float]
    heights: tuple[float, float]
    level: float
    slope: float
    at: float  # the time of the event that changes the mode
    gain: float  # of the rate, by it
    kick: float  # change at each edge, per time
    mark: float  # level at which the state is recorded, at the start
    drift: float  # of this level
    period: float | None
    parts: int
    interpreted: bool

    @property
    def end(self) -> float:
        return self.begin + self.length


def drawn(seed: int, number: int) -> Setting:
    """Draw a case."""
    rng = np.random.default_rng([seed, number, 46])
    length = 10.0 ** rng.uniform(-3.0, 5.0)
    begin = float(rng.choice([0.0, length * rng.uniform(0.0, 3.0), length * 1e3]))
    interpreted = bool(rng.random() < INTERPRETED)
    scales = 30.0 if interpreted else 10.0 ** rng.uniform(0.5, 3.0)
    edges = tuple(float(each) for each in begin + length * np.sort(rng.uniform(0.01, 0.99, 4)))
    return Setting(
        begin=begin,
        length=length,
        scale=length / scales,
        edges=edges,  # type: ignore[arg-type]
        heights=(float(rng.normal()) / length, float(rng.normal()) / length),
        level=float(rng.normal()) / length,
        slope=float(rng.normal()) / length**2 if begin < 10.0 * length else 0.0,
        at=begin + length * float(rng.uniform(0.02, 1.2)),
        gain=float(rng.normal()) / length,
        kick=float(rng.normal()) / max(begin, length),
        mark=float(rng.normal()),
        drift=float(rng.normal()) / length,
        period=length / rng.uniform(3.0, 200.0) if rng.random() < 0.4 else None,
        parts=int(rng.integers(1, 3)),
        interpreted=interpreted,
    )


# --- The systems


def rate(mode, t, y, p):  # type: ignore[no-untyped-def]
    total = p.level + p.slope * t + (p.gain if mode == AFTER else 0.0)
    if p.e0 <= t < p.e1:
        total += p.h0
    if p.e2 <= t < p.e3:
        total += p.h1
    return (total,)


def wave(mode, t, y, p):  # type: ignore[no-untyped-def]
    added = p.gain if mode == AFTER else 0.0
    return (p.level + added + p.h0 * math.cos(2.0 * math.pi * t / p.period),)


def moment(mode, t, y, p):  # type: ignore[no-untyped-def]
    return p.at - t


def goes_on(mode, t, y, p):  # type: ignore[no-untyped-def]
    return AFTER, (y.q + p.kick * t,)


def kicked(mode, t, y, p):  # type: ignore[no-untyped-def]
    return mode, (y.q + p.kick * t,)


def below_mark(mode, t, y, p):  # type: ignore[no-untyped-def]
    return p.mark + p.drift * (t - p.begin) - y.q


def in_time(mode, t, y, p):  # type: ignore[no-untyped-def]
    return p.end - t


def edges(p):  # type: ignore[no-untyped-def]
    return p.e0, p.e1, p.e2, p.e3


def blows(p):  # type: ignore[no-untyped-def]
    return (0.37 * p.period, p.period)


NAMES = ("begin", "end", "e0", "e1", "e2", "e3", "h0", "h1", "level", "slope", "at", "gain")
GUARDS = (
    mi.Guard("moment", moment, goes_on, modes=(BEFORE,)),
    mi.Guard("mark", below_mark),
)


@cache
def system(forced: bool, typical: bool) -> mi.System:
    """Return the system with or without a period, at some values of its parameters."""
    values = dict.fromkeys((*NAMES, "kick", "mark", "drift"), 0.0)
    values |= {"e0": 1.0, "e1": 2.0, "e2": 3.0, "e3": 4.0, "scale": 1.0, "period": 1.0, "at": 9.0}
    return mi.System(
        states=("q",),
        flow=wave if forced else rate,
        parameters=values,
        guards=GUARDS if not forced else (recorded_moment(), GUARDS[1]),
        modes=(BEFORE, AFTER),
        period=(lambda p: p.period) if forced else None,
        switches=blows if forced else edges,
        switch_transition=kicked,
        time_scale=(lambda p: p.period) if forced else (lambda p: p.scale),
        typical={"q": 3e-3, "time": 0.2} if typical else None,
    )


def recorded_moment() -> mi.Guard:
    """Return the guard at the given time for a system with a period, whose margins are periodic."""
    return mi.Guard("moment", moment)


def parameters(s: Setting) -> dict[str, float]:
    """Return the parameters of a case."""
    return {
        "begin": s.begin,
        "end": s.end,
        **{f"e{i}": edge for i, edge in enumerate(s.edges)},
        "h0": s.heights[0],
        "h1": s.heights[1],
        **{name: getattr(s, name) for name in ("level", "slope", "at", "gain", "kick")},
        **{name: getattr(s, name) for name in ("mark", "drift", "scale")},
        "period": s.period or 1.0,
    }


# --- The reference


@dataclass
class Motion:
    """The end of the state, and the events: names and times. `loose` have no certain order."""

    q: float
    events: list[tuple[str, float]]
    loose: bool


def expected(s: Setting) -> Motion:
    """Return the motion in closed form."""
    if s.period is None:
        changes = [(edge, "edge") for edge in s.edges]
        changes += [(s.at, "moment")] if s.at < s.end else []
        marks = [*sorted(changes), (s.end, "end")]
    else:
        times = blow_times(s)
        marks = [*((each, "edge") for each in times), (s.end, "end")]
    q, t, mode, events = 0.0, s.begin, 0, []
    gaps = np.diff([s.begin, *(each[0] for each in marks)])
    loose = bool((gaps < CLEAR * s.length).any()) and s.period is None
    lowest = s.mark - q
    for at, what in marks:
        crossed, near = crossings(s, q, t, at, mode)
        events += [("mark", each) for each in crossed]
        loose = loose or near
        q += change(s, t, at, mode)
        t = at
        if what == "end":
            break
        before = s.mark + s.drift * (t - s.begin) - q
        q += s.kick * t
        lowest = s.mark + s.drift * (t - s.begin) - q
        if what == "moment":
            mode = 1
            events.append(("moment", t))
        if before > 0.0 > lowest:
            events.append(("mark", t))
        loose = loose or min(abs(before), abs(lowest)) < CLEAR
    if s.period is not None and s.begin < s.at < s.end:
        events.append(("moment", s.at))
        loose = loose or min(abs(s.at - each[0]) for each in marks) < CLEAR * s.length
    return Motion(q, sorted(events, key=lambda each: each[1]), loose)


def blow_times(s: Setting) -> list[float]:
    """Return the times of the blows of a system with a period."""
    assert s.period is not None
    first = math.floor(s.begin / s.period) - 1
    times = [
        (first + k + part) * s.period
        for k in range(3 + math.ceil(s.length / s.period))
        for part in (0.37, 1.0)
    ]
    return [each for each in times if s.begin < each < s.end]


def change(s: Setting, a: float, b: float, mode: int) -> float:
    """Return the change of the state from one time to a later one between two edges."""
    level = s.level + s.gain * mode
    if s.period is not None:
        turn = 2.0 * math.pi / s.period
        waves = s.heights[0] / turn * (math.sin(turn * b) - math.sin(turn * a))
        return level * (b - a) + waves
    middle = 0.5 * (a + b)
    for height, (begin, end) in zip(s.heights, (s.edges[:2], s.edges[2:]), strict=True):
        level += height if begin < middle < end else 0.0
    return (level + s.slope * middle) * (b - a)


def crossings(s: Setting, q: float, a: float, b: float, mode: int) -> tuple[list[float], bool]:
    """Return where the margin of the mark falls through zero, and whether it nearly does."""
    grid = np.linspace(a, b, 3 if s.period is None else 40)
    margins = [s.mark + s.drift * (t - s.begin) - q - change(s, a, float(t), mode) for t in grid]
    if s.period is None:  # a parabola
        c, d = margins[0], (4.0 * margins[1] - 3.0 * margins[0] - margins[2]) / (b - a)
        e = 2.0 * (margins[0] - 2.0 * margins[1] + margins[2]) / (b - a) ** 2
        size = max(map(abs, margins))
        roots = np.roots([e, d, c]) if abs(e) * (b - a) ** 2 > 1e-12 * size else np.roots([d, c])
        real = [float(x.real) for x in roots if abs(x.imag) < 1e-9 * (b - a)]
        inside = [x for x in real if 0.0 < x < b - a]
        falling = [a + x for x in inside if d + 2.0 * e * x < 0.0]
        near = any(abs(d + 2.0 * e * x) * s.length < 1e-2 for x in real)
        near = near or any(min(abs(x), abs(x - (b - a))) < CLEAR * s.length for x in real)
        return falling, near
    found = []
    for i in range(len(grid) - 1):
        if margins[i] > 0.0 >= margins[i + 1]:
            low, high = float(grid[i]), float(grid[i + 1])
            for _ in range(80):
                middle = 0.5 * (low + high)
                margin = s.mark + s.drift * (middle - s.begin) - q - change(s, a, middle, mode)
                low, high = (middle, high) if margin > 0.0 else (low, middle)
            found.append(high)
    slopes = np.diff(margins) / (grid[1] - grid[0]) * s.length
    return found, bool((np.abs(slopes[np.abs(margins[1:]) < 0.2]) < 1e-1).any())


# --- The check


def answer(s: Setting, method: str, typical: bool) -> tuple[mi.State, list[tuple[str, float]]]:
    """Return the last state and the events that the package finds."""
    case = system(s.period is not None, typical).changed(**parameters(s))
    options = mi.Options(
        engine="interpreted" if s.interpreted else "compiled", method=method, rtol=RTOL, atol=RTOL
    )
    initial: mi.State = mi.State(q=0.0, mode="before")
    events: list[tuple[str, float]] = []
    start, lengths = s.begin, [s.length / s.parts] * (s.parts - 1)
    for length in (*lengths, None):
        until = in_time if length is None else None
        run = mi.simulate(
            case,
            duration=2.0 * s.length if length is None else length,
            until=until,
            initial=initial,
            start=start,
            options=options,
        )
        rows = run.events[run.events["event"].isin(["moment", "mark"])]
        events += list(zip(rows["event"], rows["t"], strict=True))
        initial, start = run.final, run.end
    assert run.ended == "until"
    return initial, events


def check(seed: int, number: int, unit: Unit) -> Verdict:
    """Try a case."""
    s = drawn(seed, number)
    if s.period is not None:
        s = replace(s, slope=0.0)
    known = expected(s)
    final, events = answer(s, unit.method, typical=number % 3 == 0)
    verdict = Verdict("clocks", number, events=len(known.events))
    size = 1.0 + abs(known.q) + abs(s.kick) * s.end
    resolution = 2.0**-52 * s.end / s.length  # of the times that functions receive
    bound = 1e-7 + 1e2 * resolution
    if not known.loose:
        if [name for name, _ in events] != [name for name, _ in known.events]:
            verdict.story = f"events {events}, not {known.events}"
        elif events:
            late = max(abs(a[1] - b[1]) for a, b in zip(events, known.events, strict=True))
            if late > 1e2 * bound * s.length:
                verdict.story = f"events off by {late / s.length:.1e} of the run"
    error = abs(final.q - known.q) / size
    if not error <= bound:
        verdict.story = f"state off by {error:.1e}"
    return verdict
