"""A device in SI whose spring moves the frame before the block strikes; the frame hardly rests."""

import math
from functools import cache

import numpy as np

import mems_impact as mi

SLIPPING = mi.Actuator(
    m1=8e-7,
    m2=2.5e-7,
    k=9.0,
    c=6e-5,
    d=4.2e-6,
    delta=2.4e-6,
    e=0.6,
    mu_s=0.3,
    mu_d=0.24,
    alpha=2.6e-20,
    g=9.81,
    units="SI",
)
PULLED = mi.Sine(amplitude=56.0, omega=2.0 * math.pi * 480.0)  # one impact a period

LIGHT = mi.Actuator(
    m1=1e-6,
    m2=2e-7,
    k=11.37,
    c=5.027e-5,
    d=4e-6,
    delta=2.5e-6,
    e=0.65,
    mu_s=0.35,
    mu_d=0.28,
    alpha=2.2e-20,
    g=9.81,
    units="SI",
)
"""A block of a fifth of the frame's mass, Q = 30, pull-in at 70 V."""


@cache
def random_device(seed):
    """Return a device whose frame slips before its block strikes, and the orbit of a drive of it.

    The spring holds 1.3 to 12 times what friction does when the block touches; the orbit has one
    impact a period.
    """
    random = np.random.default_rng(seed)
    share = 0.0
    while not 1.3 < share < 12.0:
        m1 = 10.0 ** random.uniform(-6.3, -5.7)
        m2 = m1 * random.uniform(0.15, 0.4)
        own = 2.0 * math.pi * random.uniform(600.0, 2000.0)
        k = m2 * own**2
        d = random.uniform(3e-6, 6e-6)
        delta = d * random.uniform(0.5, 0.7)
        mu_s = random.uniform(0.2, 0.45)
        share = k * delta / (mu_s * (m1 + m2) * 9.81)
    pull_in = random.uniform(50.0, 90.0)
    device = mi.Actuator(
        m1=m1, m2=m2, k=k, c=math.sqrt(k * m2) / 10.0 ** random.uniform(0.9, 1.9), d=d, delta=delta,
        e=random.uniform(0.4, 0.75), mu_s=mu_s, mu_d=mu_s * random.uniform(0.7, 0.95),
        alpha=4.0 * k * d**3 / (27.0 * pull_in**2), g=9.81, units="SI",
    )  # fmt: skip
    for volts in (0.8, 0.9, 0.7, 0.6, 1.0):
        for part in (0.5, 0.46, 0.54, 0.42, 0.58):
            drive = mi.Sine(amplitude=volts * pull_in, omega=part * own)
            try:
                orbit = mi.find_orbit(device, drive, guess=mi.kicked_state(device), transient=300)
            except mi.OrbitError:
                continue
            if orbit.stable and orbit.admissible and orbit.periods == len(orbit.impacts) == 1:
                return device, orbit
    raise LookupError(seed)
