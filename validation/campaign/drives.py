"""The drives of the campaign: how the package gets them and, apart from it, how the judge does.

For the judge a waveform is a function of time that returns a `Source` and the time at which that
ends, written from the drives' documentation and not from their code.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

import mems_impact as mi
from mems_impact.actuator.drives import Drive
from validation.campaign.ladder import Ladder
from validation.judges.heyoka_full import Piece, Source

Fields = dict[str, Any]
Wave = Callable[[float], tuple[Source, float]]
TAU = 2.0 * math.pi


@dataclass(frozen=True)
class Spec:
    """A drive by kind and fields; a field may be a Spec."""

    kind: str
    fields: Fields

    def build(self) -> Drive:
        """Return the drive of the package."""
        fields = {k: v.build() if isinstance(v, Spec) else v for k, v in self.fields.items()}
        if self.kind == "custom":
            return custom(**fields)
        return BUILD[self.kind](**fields)

    def wave(self) -> Wave:
        """Return the voltage on the right as the judge takes it."""
        return JUDGED[self.kind](**self.fields)

    def pieces(self) -> Callable[[float], Piece]:
        """Return what pulls, for the judge."""
        if self.kind != "voltages":
            right = self.wave()

            def one(t: float) -> Piece:
                source, end = right(t)
                return Piece(end, source)

            return one
        waves = self.fields["right"].wave(), self.fields["left"].wave()

        def both(t: float) -> Piece:
            (right, first), (left, second) = waves[0](t), waves[1](t)
            return Piece(min(first, second), right, left)

        return both


def _two_tones(t, q):  # type: ignore[no-untyped-def]
    return q[0] + q[1] * math.cos(q[2] * t) + q[3] * math.cos(q[4] * t + q[5])


def custom(bias: float, a1: float, omega: float, a2: float, times: int, phase: float) -> Drive:
    values = {"bias": bias, "a1": a1, "w1": omega, "a2": a2, "w2": times * omega, "f": phase}
    period = TAU / omega
    return mi.Custom(function=_two_tones, period=period, values=values, fastest=period / times)


BUILD: dict[str, Callable[..., Drive]] = {
    "sine": mi.Sine,
    "ladder": Ladder,
    "square": mi.Square,
    "pulse": mi.Pulse,
    "trapezoid": mi.Trapezoid,
    "sampled": mi.Sampled,
    "burst": mi.Burst,
    "voltages": mi.Voltages,
}


# Waveforms of the judge


def straight(length: float, knots: list[tuple[float, ...]], lead: float = 0.0) -> Wave:
    """Return a periodic waveform of polynomials (start, coefficients), ahead by `lead`."""
    starts = np.array([knot[0] for knot in knots])

    def wave(t: float) -> tuple[Source, float]:
        later = t + lead + 1e-14 * (length + abs(t))
        cycle = math.floor(later / length)
        i = int(np.searchsorted(starts, later - cycle * length, side="right")) - 1
        end = starts[i + 1] if i + 1 < len(knots) else length
        start, *coefficients = knots[i]
        coefficients += [0.0] * (4 - len(coefficients))
        begin = cycle * length - lead
        return Source(*coefficients, since=begin + start), begin + float(end)

    return wave


def sine(amplitude: float, omega: float, bias: float = 0.0, phase: float = 0.0) -> Wave:
    source = Source(bias=bias, a1=amplitude, w1=omega, f1=phase)
    return lambda _: (source, math.inf)


def two_tones(bias: float, a1: float, omega: float, a2: float, times: int, phase: float) -> Wave:
    source = Source(bias=bias, a1=a1, w1=omega, a2=a2, w2=times * omega, f2=phase)
    return lambda _: (source, math.inf)


def ladder(length: float, starts: Any, levels: Any, slopes: Any) -> Wave:
    return straight(length, list(zip(starts, levels, slopes, strict=True)))


def pulse(
    amplitude: float,
    period: float,
    width: float,
    rise: float = 0.0,
    fall: float = 0.0,
    low: float = 0.0,
    phase: float = 0.0,
) -> Wave:
    knots = [(0.0, low, (amplitude - low) / rise)] if rise > 0.0 else []
    knots.append((rise, amplitude, 0.0))
    if fall > 0.0:
        knots.append((width, amplitude, (low - amplitude) / fall))
    knots.append((width + fall, low, 0.0))
    return straight(period, knots, phase / TAU * period)


def square(
    amplitude: float,
    omega: float,
    duty: float = 0.5,
    rise: float = 0.0,
    low: float = 0.0,
    phase: float = 0.0,
) -> Wave:
    period = TAU / omega
    return pulse(amplitude, period, duty * period, rise, rise, low, phase)


def trapezoid(
    amplitude: float, omega: float, flat: float = 0.5, bias: float = 0.0, phase: float = 0.0
) -> Wave:
    period = TAU / omega
    crest, flank = 0.5 * flat * period, 0.5 * (1.0 - flat) * period
    slope, half = 2.0 * amplitude / flank, 0.5 * period
    knots = [
        (0.0, bias + amplitude, 0.0),
        (crest, bias + amplitude, -slope),
        (half, bias - amplitude, 0.0),
        (half + crest, bias - amplitude, slope),
    ]
    return straight(period, knots, phase / omega + 0.5 * crest)


def sampled(times: Any, voltages: Any, period: float, phase: float = 0.0) -> Wave:
    t, v, k = np.array(times), np.array(voltages), 3
    around_t = np.concatenate([t[-k:] - period, t, t[: k + 1] + period]) - t[0]
    cubic = PchipInterpolator(around_t, np.concatenate([v[-k:], v, v[: k + 1]]))
    knots = [
        (float(cubic.x[i]), *(float(c) for c in cubic.c[::-1, i])) for i in range(k, k + len(t))
    ]
    return straight(period, knots, phase / TAU * period)


def period_of(spec: Spec) -> float:
    """Return the forcing period, from the drives' documentation."""
    f = spec.fields
    if spec.kind in ("pulse", "sampled"):
        return float(f["period"])
    if spec.kind == "ladder":
        return float(f["length"])
    half = spec.kind in ("sine", "trapezoid") and f.get("bias", 0.0) == 0.0
    half |= spec.kind == "square" and f.get("duty") == 0.5 and f.get("low") == -f["amplitude"]
    return (0.5 if half else 1.0) * TAU / float(f["omega"])


def burst(wave: Spec, on: float, off: float) -> Wave:
    one = period_of(wave)
    inner, length, period = wave.wave(), on * one, (on + off) * one

    def result(t: float) -> tuple[Source, float]:
        later = t + 1e-14 * (period + abs(t))
        cycle = math.floor(later / period)
        begin = cycle * period
        if later - begin >= length:
            return Source(), begin + period
        source, end = inner(t - begin)
        moved = source._replace(
            since=source.since + begin,
            f1=source.f1 - source.w1 * begin,
            f2=source.f2 - source.w2 * begin,
        )
        return moved, begin + min(end, length)

    return result


JUDGED: dict[str, Callable[..., Wave]] = {
    "sine": sine,
    "ladder": ladder,
    "square": square,
    "pulse": pulse,
    "trapezoid": trapezoid,
    "sampled": sampled,
    "burst": burst,
    "custom": two_tones,
}


# Random drives


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-7.0, 7.0)) if rng.random() < 0.4 else 0.0


def _level(rng: np.random.Generator, scale: float) -> float:
    return scale * 10.0 ** float(rng.uniform(-1.0, 0.6))


def _bias(rng: np.random.Generator, scale: float) -> float:
    return float(scale * rng.normal()) if rng.random() < 0.4 else 0.0


def _short(rng: np.random.Generator, longest: float) -> float:
    """A duration up to `longest`: none, all of it, or anything between by orders."""
    how = rng.random()
    if how < 0.3:
        return 0.0
    return longest if how < 0.4 else longest * 10.0 ** float(rng.uniform(-6.0, 0.0))


def _draw_sine(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    level, bias = _level(rng, scale), _bias(rng, scale)
    return {"amplitude": level, "omega": omega, "bias": bias, "phase": _phase(rng)}


def _draw_ladder(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    length = TAU / omega
    count = int(rng.integers(1, 6))
    starts = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 1.0, count - 1))]) * length
    if rng.random() < 0.3 and count > 2:
        starts[-1] = starts[-2] + length * 10.0 ** rng.uniform(-9.0, -3.0)  # a short pulse
    levels = scale * rng.normal(size=count)
    slopes = np.where(rng.random(count) < 0.5, 0.0, scale / length * rng.normal(size=count))
    columns = (starts, levels, slopes)
    names = ("starts", "levels", "slopes")
    return {"length": length, **{n: tuple(c.tolist()) for n, c in zip(names, columns, strict=True)}}


def _draw_square(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    duty = 0.5 if rng.random() < 0.4 else float(rng.uniform(0.02, 0.98))
    rise = _short(rng, min(duty, 1.0 - duty) * TAU / omega * (1.0 - 1e-9))
    level = _level(rng, scale)
    low = -level if rng.random() < 0.3 else _bias(rng, scale)
    fields = {"amplitude": level, "omega": omega, "duty": duty, "rise": rise, "low": low}
    return {**fields, "phase": _phase(rng)}


def _draw_pulse(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    period = TAU / omega
    width = period * float(rng.choice([rng.uniform(0.02, 0.98), 10.0 ** rng.uniform(-5.0, -1.0)]))
    return {
        "amplitude": _level(rng, 2.0 * scale),
        "period": period,
        "width": width,
        "rise": _short(rng, width * (1.0 - 1e-9)),
        "fall": _short(rng, (period - width) * (1.0 - 1e-9)),
        "low": _bias(rng, scale),
        "phase": _phase(rng),
    }


def _draw_trapezoid(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    flat = 0.0 if rng.random() < 0.2 else float(rng.uniform(0.0, 0.999))
    return {
        "amplitude": _level(rng, scale),
        "omega": omega,
        "flat": flat,
        "bias": _bias(rng, scale),
        "phase": _phase(rng),
    }


def _draw_sampled(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    period = TAU / omega
    count = int(rng.integers(4, 40))
    gaps = rng.uniform(0.2, 1.0, count)
    times = period * np.cumsum(gaps) / gaps.sum()
    if rng.random() < 0.5:  # smooth
        voltages = np.cos(TAU * times / period + rng.uniform(0.0, TAU))
        voltages += 0.5 * np.cos(2.0 * TAU * times / period)
    else:
        voltages = rng.normal(size=count)
    voltages *= _level(rng, scale)
    return {
        "times": tuple((times - times[0]).tolist()),
        "voltages": tuple(voltages.tolist()),
        "period": period,
        "phase": _phase(rng),
    }


def _draw_custom(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    return {
        "bias": _bias(rng, scale),
        "a1": _level(rng, scale),
        "omega": omega,
        "a2": _level(rng, scale),
        "times": int(rng.integers(2, 60)),
        "phase": _phase(rng),
    }


SIMPLE = ("sine", "square", "pulse", "trapezoid", "sampled", "ladder")
DRAW: dict[str, Callable[[np.random.Generator, float, float], Fields]] = {
    "sine": _draw_sine,
    "ladder": _draw_ladder,
    "square": _draw_square,
    "pulse": _draw_pulse,
    "trapezoid": _draw_trapezoid,
    "sampled": _draw_sampled,
    "custom": _draw_custom,
}
WEIGHTS = {"sine": 3.0, "burst": 1.0, "voltages": 1.0, **dict.fromkeys(list(DRAW)[1:], 1.0)}
WITHIN = ("sine", "square")  # of bursts and pairs: each combination is compiled by itself


def random_spec(rng: np.random.Generator, scale: float, own: float) -> Spec:
    """Draw a drive around the voltage `scale` and the block's own frequency `own`."""
    kinds = list(WEIGHTS)
    weights = np.array(list(WEIGHTS.values()))
    kind = kinds[rng.choice(len(kinds), p=weights / weights.sum())]
    omega = own * 10.0 ** float(rng.uniform(-1.7, 0.7))
    if kind == "burst":
        inner = str(rng.choice(WITHIN))
        on = float(rng.integers(1, 9)) if rng.random() < 0.5 else float(rng.uniform(0.1, 9.0))
        off = 10.0 ** float(rng.uniform(-1.0, 1.0))
        wave = Spec(inner, DRAW[inner](rng, scale, 5.0 * omega))
        return Spec("burst", {"wave": wave, "on": on, "off": off})
    if kind == "voltages":
        return Spec("voltages", _pair(rng, scale, omega))
    return Spec(kind, DRAW[kind](rng, scale, omega))


def _pair(rng: np.random.Generator, scale: float, omega: float) -> Fields:
    names = [str(rng.choice(WITHIN)) for _ in range(2)]
    right = Spec(names[0], DRAW[names[0]](rng, scale, omega))
    count = int(rng.integers(1, 4))
    left = Spec(names[1], DRAW[names[1]](rng, scale, omega))
    # Periods in a ratio of whole numbers.
    ratio = period_of(left) / period_of(right) * count
    fields = {**left.fields, "omega": left.fields["omega"] * ratio}
    if "rise" in fields:
        fields["rise"] /= ratio
    return {"right": right, "left": Spec(names[1], fields)}
