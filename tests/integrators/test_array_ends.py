"""Compiled code reads and writes no array beyond its end."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

# An access behind an array of NumPy ends the process: a page follows that nobody may read.
GUARD = """
import ctypes, faulthandler, mmap
import numpy as np

faulthandler.enable()
libc, zeros, PAGE = ctypes.CDLL(None), np.zeros, mmap.PAGESIZE

class Guarded:
    def __init__(self, size):
        self.length = -(-size // PAGE) * PAGE
        self.memory = mmap.mmap(-1, self.length + PAGE)
        self.start = ctypes.addressof(ctypes.c_char.from_buffer(self.memory))
        self.protect(0)
        data = self.start + self.length - -(-size // 8) * 8, False
        self.__array_interface__ = {"shape": (size,), "typestr": "|u1", "data": data, "version": 3}

    def protect(self, rights):
        assert libc.mprotect(ctypes.c_void_p(self.start + self.length), PAGE, rights) == 0

    def __del__(self):
        self.protect(mmap.PROT_READ | mmap.PROT_WRITE)

def guarded(shape, dtype=float, order="C", **others):
    plain = zeros(shape, dtype, order, **others)
    if not 0 < plain.nbytes < 2**20 or plain.dtype.hasobject:
        return plain
    return np.ndarray(plain.shape, plain.dtype, np.asarray(Guarded(plain.nbytes)), order=order)
"""
WORK = """
import math, sys
import mems_impact as mi

def flow(mode, t, y, p):
    return y.v, p.A * math.cos(t) - y.x - p.c * y.v

system = mi.System(
    states=("x", "v"), flow=flow, parameters={"A": 0.6, "c": 0.1}, period=2.0 * math.pi,
    parts=[mi.Stopper("stop", "x", "v", upper=1.0, restitution=0.8)],
)
mi.simulate(system, periods=1)  # imports and compiles what it needs
np.zeros = guarded
assert isinstance(np.zeros(3).base.base, Guarded)
options = mi.Options(method=sys.argv[1])
actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
kicked = mi.kicked_state(actuator)
for args, start, x, stop, y in (
    ((system,), None, "A", 0.8, "c"),
    ((actuator, drive), kicked, "amplitude", 0.2, "omega"),
):
    run = mi.simulate(*args, periods=200, initial=start, options=options)
    assert mi.continue_solution(mi.find_orbit(run), x, stop).ended == f"{x} reached its bound"
    mi.lyapunov(*args, periods=20, initial=start, options=options)
    mi.operating_map(*args, x=(x, [0.2, 0.5]), y=(y, [0.2, 0.5]), options=options, workers=1)
print("done")
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mprotect of Linux")
@pytest.mark.parametrize("method", ["adams", "bdf", "dop853"])
def test_nothing_is_read_behind_an_array(method):
    done = subprocess.run(
        [sys.executable, "-c", GUARD + WORK, method], capture_output=True, text=True
    )
    assert done.stdout == "done\n", done.stderr
