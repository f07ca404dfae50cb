"""A device in SI whose spring moves the frame before the block strikes; the frame hardly rests."""

import math

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
