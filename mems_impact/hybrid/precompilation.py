"""Compilation of the event loop and the methods before their first use.

``python -m mems_impact.hybrid.precompilation`` compiles into the cache of this machine;
``--distribute`` compiles into the package, for all instruction sets of a wheel
(`mems_impact.integrators.jit.machine_code`).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from mems_impact.hybrid.attractors.mapper import AttractorMapper
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import Variational
from mems_impact.hybrid.variational.lyapunov import LyapunovIntegrator
from mems_impact.hybrid.variational.run_columns import Quantities, RunColumns
from mems_impact.hybrid.variational.saltation import NO_EVENT
from mems_impact.integrators.jit import machine_code
from mems_impact.integrators.options import METHODS, Options


def _flow(mode: int, t: float, y: Any, p: Any, dy: Any) -> None:
    dy[0] = -y[0]


def _margins(mode: int, t: float, y: Any, p: Any, g: Any, r: Any) -> None:
    g[0] = 1.0


def _transition(mode: int, code: int, t: float, y: Any, p: Any) -> int:
    return mode


# The compiled code does not depend on the automaton.
DECAY = Automaton(
    states=("y",),
    modes=("decay",),
    guards=(Guard(name="never", order=0),),
    flow=_flow,
    margins=_margins,
    transition=_transition,
    stiff=True,
)
START = HybridState(0, 0.0, 0, np.ones(1))
DISTRIBUTE, RECORD = "--distribute", "--record"


def decay(method: str) -> Problem:
    """Return a problem with a method."""
    options = Options(method=method, engine="compiled")
    return Problem(automaton=DECAY, parameters=[0.0], period=1.0, options=options)


def compile_orbits() -> None:
    """Compile the event loop, the functions of all methods, and the loops of orbits."""
    for method in METHODS:
        run(decay(method), START, 1.0)
    problem, y = decay("auto"), np.ones((1, 1))
    times, segments = np.array([[0.0, 1.0, 1.0]]), np.array([[0, NO_EVENT]])
    rows, instants = np.array([[0, 0, 0, 0], [0, -1, -1, 0]]), np.zeros((1, 3))
    derivatives = np.zeros((1, 2)), np.zeros((1, 1, 2))
    equations = rows, y, instants, instants, np.ones(1), np.zeros(1), *derivatives
    variational = Variational(problem, np.ones((1, 1)))
    variational.traverse(segments, y, times)
    variational.traverse(segments, y, times, equations)


def compile_attractors() -> None:
    """Compile the loops of attractors, of derivatives of runs and of exponents."""
    problem = decay("auto")
    AttractorMapper(problem, longest=1, tolerance=1e-6).follow([(problem.numbers, START)], 1.0, 1.0)
    one = Quantities(np.zeros((1, 1)), np.ones((1, 1)), np.zeros(1), np.zeros((1, 0)))
    RunColumns(run(problem, START, 1.0), one).at(np.ones(1))
    exponents = LyapunovIntegrator(problem, START)
    exponents.restart(problem, START)
    exponents.advance_exponents()


# Of about the same time each: one is compiled beside the other.
PARTS = {"orbits": compile_orbits, "attractors": compile_attractors}


def compile_side_by_side(*tasks: tuple[Sequence[str], dict[str, str]]) -> None:
    """Compile parts in several processes; a task has arguments of this command and variables.

    Raises CalledProcessError if a part cannot be compiled.
    """

    def compile_task(task: tuple[Sequence[str], dict[str, str]]) -> None:
        command = [sys.executable, "-m", "mems_impact.hybrid.precompilation", *task[0]]
        subprocess.run(command, env={**os.environ, **task[1]}, check=True)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(compile_task, tasks))


def fill_cache() -> None:
    """Compile into the cache of this machine."""
    compile_side_by_side(*(([part], {}) for part in PARTS))


def replace_code() -> None:
    """Replace the code in the package by code for all instruction sets of a wheel."""
    for file in machine_code.DIRECTORY.glob("*.code"):
        file.unlink()
    compile_side_by_side(
        *(
            ([RECORD, *PARTS], {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": ""})
            for name in machine_code.instruction_sets()
        )
    )


def main(options: Sequence[str]) -> None:
    """Fill the cache or replace the code of the package, or compile some parts."""
    parts = [option for option in options if option in PARTS]
    if not parts:
        replace_code() if DISTRIBUTE in options else fill_cache()
        return
    if RECORD in options:
        machine_code.record()
    for part in parts:
        PARTS[part]()


if __name__ == "__main__":
    main(sys.argv[1:])
