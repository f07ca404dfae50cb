"""Functions of actuators in C are those in Python, to the last bit, for every drive and term."""

import ctypes
import subprocess

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.terms import TERM_CLASSES
from mems_impact.export.c_kinds import INTEGER, REAL, Array
from mems_impact.export.c_source import CSource
from mems_impact.export.event_loop_source import HANDLERS
from mems_impact.export.fmu import FLAGS, find_compiler
from tests.actuator.waveforms import DRIVES
from validation.campaign.terms import fitting_term

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not find_compiler(), reason="no C compiler"),
]
TEMPLATES = mi.__path__[0] + "/export/templates"
ZHAO, MITA = mi.load_actuator("zhao2004"), mi.load_actuator("mita2003")
BOTH = mi.Voltages(
    right=mi.Square(amplitude=60.0, frequency=100.0),
    left=mi.Square(amplitude=60.0, frequency=100.0, phase=3.0),
)
SYSTEMS = {name: ZHAO.under(drive) for name, drive in DRIVES.items()}
CHARGES = mi.Voltages(
    right=mi.Square(amplitude="2 pC", frequency=100.0),
    left=mi.Square(amplitude="2 pC", frequency=100.0, phase=3.0),
)
LIMIT = mi.SeriesResistance(resistance=1e9, parasitic_capacitance=1e-12, current_limit=1e-9)
for name, term in {
    "limit": LIMIT,
    **{each: fitting_term(each, MITA) for each in TERM_CLASSES},
}.items():
    SYSTEMS[name] = MITA.adding(term).under(CHARGES if term.drive_unit == "C" else BOTH)

EXPORTS = """
#include "arithmetic.h"
{source}
void flow(int64_t mode, double t, double *y, double *p, double *dy)
{{ {flow}(mode, t, y, p, dy); }}
void margins(int64_t mode, double t, double *y, double *p, double *g, double *r)
{{ {margins}(mode, t, y, p, g, r); }}
int64_t transition(int64_t mode, int64_t code, double t, double *y, double *p)
{{ return {transition}(mode, code, t, y, p); }}
"""


def library_of(model, count, folder):
    source, automaton = CSource(HANDLERS, model.generated), model.automaton
    n, m = len(automaton.states), len(automaton.guards)
    y, p, g = Array((n,)), Array((count,)), Array((m,))
    names = {
        "flow": source.function(automaton.flow, (INTEGER, REAL, y, p, y)).name,
        "margins": source.function(automaton.margins, (INTEGER, REAL, y, p, g, g)).name,
        "transition": source.function(automaton.transition, (INTEGER, INTEGER, REAL, y, p)).name,
    }
    (folder / "all.c").write_text(EXPORTS.format(source=source.text(), **names))
    flags = ["-O0" if flag == "-O2" else flag for flag in FLAGS if "visibility" not in flag]
    command = [*find_compiler(), *flags, f"-I{TEMPLATES}", "all.c", "-o", "all.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "all.so"))
    library.transition.restype = ctypes.c_int64
    return library


def pointer(values):
    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@pytest.mark.parametrize("name", SYSTEMS)
def test_flow_margins_and_transitions(name, tmp_path):
    system = SYSTEMS[name]
    problem = system.problem(mi.Options(method="dop853"))
    automaton, p = problem.automaton, np.asarray(problem.parameters, dtype=float)
    library = library_of(system._export_model(), len(p), tmp_path)
    n, m = len(automaton.states), len(automaton.guards)
    random = np.random.default_rng(1)
    for _ in range(20):
        mode, t = int(random.integers(len(automaton.modes))), random.uniform(0, 2 * problem.period)
        y = 0.4 * random.normal(size=n)
        at = ctypes.c_int64(mode), ctypes.c_double(t)
        slope, g, r = np.zeros(n), np.ones(m), np.ones(m)
        library.flow(*at, pointer(y.copy()), pointer(p.copy()), pointer(slope))
        np.testing.assert_array_equal(slope, automaton.slope_at(mode, t, y, p))
        library.margins(*at, pointer(y.copy()), pointer(p.copy()), pointer(g), pointer(r))
        margins, rates = automaton.margins_at(mode, t, y, p)
        np.testing.assert_array_equal(g, margins)
        impacts = [guard.impact for guard in automaton.guards]  # in C, rates are differences
        np.testing.assert_allclose(r[impacts], rates[impacts], rtol=1e-9, atol=1e-12)
        for code in range(2 * m + 1):
            after = y.copy()
            into = library.transition(
                at[0], ctypes.c_int64(code), at[1], pointer(after), pointer(p.copy())
            )
            expected, state = automaton.state_after(mode, code, t, y, p)
            assert into == expected
            np.testing.assert_array_equal(after, state)
