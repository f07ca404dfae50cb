"""What tests of the campaign run in processes of their own: few imports, for a quick start."""

import math
import time

# Two automata out of one factory, which differ in a function that they close over.


def _square(t):
    return t * t


def _cube(t):
    return t * t * t


def _made(voltage):
    def force(t):
        # Large, so that LLVM calls it rather than putting it in place: only what is called has a
        # symbol that can be taken for another.
        total = 0.0
        for i in range(9):
            x = math.sin(t + i) * math.cos(t - i) + math.atan(t) * math.exp(-i * t)
            y = math.sin(x) + math.cos(x) + math.tan(x) + math.log(2.0 + x * x)
            total += math.atan2(x, y) + math.sinh(y) + math.cosh(x) + math.tanh(x + y)
            total += math.sqrt(1.0 + x * x) + math.asinh(y) + math.exp(math.sin(total))
        return voltage(t) + 0.0 * total

    def flow(mode, t, y, p, dy):
        dy[0] = 0.25 * (force(t) + force(1.0 * t) + force(t + 0.0) + force(t - 0.0))

    def margins(mode, t, y, p, g, r):
        g[0] = force(t)

    def transition(mode, code, t, y, p):
        return mode

    return flow, margins, transition


_AUTOMATA = {"a": _made(_square), "b": _made(_cube)}


def automaton(name):
    return _AUTOMATA[name]


def hang(item):
    while item == 1:
        time.sleep(60.0)
    return item
