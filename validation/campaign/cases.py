"""What is tried: one case is a device, a drive, a start and settings, all from a seed.

A case is plain numbers, so that it prints, pickles and can be run again alone
(``python -m validation.campaign --seed 1 --only 4711``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

import mems_impact as mi
from validation.campaign import drives

LONGEST = 60.0 * 2.0 * math.pi  # of a run, in times of the block's own
PRESETS = ("zhao2004", "mita2003")


@dataclass(frozen=True)
class Case:
    """One run."""

    name: str
    device: dict[str, float]
    drive: drives.Spec
    start: tuple[float, float, float, float]
    time: float  # of the start, within the forcing period
    periods: float
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def actuator(self) -> mi.Actuator:
        return mi.Actuator(**self.device)

    @property
    def initial(self) -> mi.State:
        x1, v1, x2, v2 = self.start
        return mi.State(x1=x1, v1=v1, x2=x2, v2=v2, time=self.time)

    def by(self, method: str | None) -> Case:
        """Return the case with this method of integration, or as it is."""
        return replace(self, options={**self.options, "method": method}) if method else self

    def run(self, **changes: Any) -> mi.Run:
        """Run the package on it."""
        options = mi.Options(**{**self.options, **changes})
        drive = self.drive.build()
        return mi.simulate(
            self.actuator, drive, self.periods, initial=self.initial, options=options
        )


def hold_voltage(p: dict[str, float]) -> float:
    """The voltage that holds a resting block on the right stopper."""
    return math.sqrt(p["k"] * p["delta"] / p["alpha"]) * (p["d"] - p["delta"])


def random_case(seed: int, number: int) -> Case:
    """Draw case `number` of the campaign `seed`."""
    rng = np.random.default_rng([seed, number])
    p = random_device(rng)
    own = math.sqrt(p["k"] / p["m2"])
    spec = drives.random_spec(rng, hold_voltage(p), own)
    period = spec.build().period
    longest = min(30.0, LONGEST / own / period)
    periods = longest * rng.uniform(0.2, 1.0)
    rtol = 10.0 ** rng.uniform(-12.0, -5.0)
    options = {
        "rtol": rtol,
        "atol": rtol * p["delta"] * min(1.0, own) * 10.0 ** rng.uniform(-3.0, -1.0),
        "method": "bdf" if rng.random() < 0.25 else "adams",
        "engine": "compiled",
    }
    time = 0.0 if rng.random() < 0.5 else rng.uniform(0.0, period * (1.0 - 1e-12))
    return Case(
        f"random {seed}:{number}", p, spec, random_start(rng, p, own), time, periods, options
    )


def random_device(rng: np.random.Generator) -> dict[str, float]:
    """Orders of magnitude around a preset, each parameter with even odds."""
    base = mi.load_actuator(PRESETS[rng.integers(len(PRESETS))]).to_dimensionless()
    p = {name: float(value) for name, value in base if name != "units"}
    for name in ("m1", "m2", "k", "c", "d", "alpha", "g"):
        if rng.random() < 0.5:
            p[name] *= 10.0 ** rng.uniform(-1.5, 1.5)
    share = 0.5 if rng.random() < 0.4 else rng.uniform(0.02, 0.98)
    p["delta"] = p["d"] * share
    p["e"] = float(rng.choice([p["e"], 0.0, 1.0, rng.random()], p=[0.35, 0.1, 0.1, 0.45]))
    p["mu_s"] *= 1.0 if rng.random() < 0.4 else 10.0 ** rng.uniform(-3.0, 1.0)
    ratio = rng.choice([0.675, 0.0, 1.0, rng.random()], p=[0.4, 0.1, 0.15, 0.35])
    p["mu_d"] = p["mu_s"] * float(ratio)
    if rng.random() < 0.05:
        p["c"] = 0.0
    return p


def random_start(
    rng: np.random.Generator, p: dict[str, float], own: float
) -> tuple[float, float, float, float]:
    speed = p["delta"] * own
    x2 = float(rng.choice([0.0, rng.uniform(-1.0, 1.0), 1.0, -1.0], p=[0.3, 0.5, 0.1, 0.1]))
    v2 = float(rng.choice([0.0, rng.normal()], p=[0.3, 0.7])) * speed
    v1 = float(rng.choice([0.0, rng.normal()], p=[0.6, 0.4])) * speed
    return 0.0, v1, x2 * p["delta"], v2
