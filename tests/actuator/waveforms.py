"""One drive of every kind, and functions for custom ones."""

import math

import numpy as np

import mems_impact as mi


def cosine(t, q):
    return q[0] * math.cos(q[1] * t)


# A sawtooth of period 1 that jumps at 1/4; compared with the very number in `switches`.
def saw(t, q):
    u = t - math.floor(t)
    return q[0] * (u - 0.25 if u >= 0.25 else u + 0.75)


TIMES = np.linspace(0.0, 9.0, 31)
RECORD = {"times": TIMES, "voltages": 0.1 + 0.3 * np.cos(2.0 * np.pi * TIMES / 9.0)}
SQUARE = mi.Square(amplitude=0.3, omega=0.5, duty=0.3)
PULSE = mi.Pulse(amplitude=0.4, period=10.0, width=3.0, rise=0.5, fall=1.0, low=-0.1, phase=1.0)
SINE = mi.Sine(amplitude=0.24, omega=0.5, phase=0.3)

DRIVES = {
    "sine": SINE,
    "biased sine": SINE.replace(bias=0.1),
    "square": SQUARE,
    "square with flanks": SQUARE.replace(rise=0.7, phase=-4.0),
    "mirrored square": mi.Square(amplitude=0.3, omega=0.5, low=-0.3, rise=0.4, phase=0.9),
    "constant square": mi.Square(amplitude=0.3, omega=0.5, low=-0.3),
    "pulse": PULSE,
    "triangular pulse": mi.Pulse(amplitude=0.4, period=10, width=4, rise=4, fall=6),
    "trapezoid": mi.Trapezoid(amplitude=0.3, omega=0.5, flat=0.3, phase=0.2),
    "triangle": mi.Trapezoid(amplitude=0.3, omega=0.5, flat=0),
    "biased trapezoid": mi.Trapezoid(amplitude=0.3, omega=0.5, bias=0.2),
    "voltage-step": mi.VoltageStep(amplitude=0.5, rise=0.4, duration=10.0),
    "sudden step": mi.VoltageStep(amplitude=0.5, duration=10.0),
    "pulse and hold": mi.PulseAndHold(amplitude=0.6, width=1.5, pause=0.9, hold=0.4, low=-0.1,
                                   rise=0.3, duration=10.0),
    "two levels": mi.PulseAndHold(amplitude=0.6, width=1.5, hold=0.4, duration=10.0),
    "sampled": mi.Sampled(**RECORD, phase=0.7),
    "burst of a sine": mi.Burst(wave=SINE, on=4.5, off=3),
    "burst of pulses": mi.Burst(wave=PULSE, on=3.21, pause=11.0),
    "burst of bursts": mi.Burst(wave=mi.Burst(wave=SQUARE, on=2, off=1), on=3, off=2),
    "voltages": mi.Voltages(right=PULSE, left=PULSE.replace(phase=1.0 + math.pi)),
    "two-sided, 2 to 3": mi.Voltages(right=PULSE, left=PULSE.replace(period=15.0)),
    "two-sided sine": mi.Voltages(right=SINE, left=SINE.replace(phase=0.3 + math.pi / 2)),
    "burst on both sides": mi.Burst(wave=mi.Voltages(right=SQUARE, left=SINE), on=2, off=1),
    "custom": mi.Custom(function=cosine, period=math.pi / 0.5,
                     values={"amplitude": 0.24, "omega": 0.5}),
    "jumping custom": mi.Custom(function=saw, period=1.0, values={"top": 0.3},
                             switches=[0.25]),
}  # fmt: skip


def channels(drive):
    """The waveforms of a drive."""
    return [each for each in (drive.voltage, drive.left_voltage) if each is not None]
