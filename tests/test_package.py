"""The package's table of contents."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import mems_impact as mi
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.actuator.terms import TERM_CLASSES


def test_every_name_is_there():
    for name in mi.__all__:
        assert getattr(mi, name).__name__ == name
    assert set(mi.__all__) <= set(dir(mi))


def test_every_waveform_and_term_is_public():
    assert {*WAVEFORMS.values(), *TERM_CLASSES.values()} < set(mi.__all__)


def test_unknown_name():
    with pytest.raises(AttributeError, match="attribute simulte"):
        _ = mi.simulte


def test_import_is_light():
    code = (
        "import sys, mems_impact\n"
        "heavy = {'numba', 'pandas', 'matplotlib', 'numpy', 'pydantic', 'sksundae'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_a_run_without_tables_is_light():
    code = (
        "import sys, mems_impact as mi\n"
        "import mems_impact.actuator.system_files\n"
        "drive = mi.Sine(amplitude=0.24, omega=0.5)\n"
        "options = mi.Options(method='dop853', engine='interpreted')\n"
        "mi.simulate(mi.load_actuator('zhao2004'), drive, periods=1, options=options)\n"
        "assert 'scipy.linalg' not in sys.modules\n"  # numba and scikit-sundae import it
        "system = mi.System(states=('x',), flow=lambda mode, t, y, p: (-y.x,), period=1.0)\n"
        "run = mi.simulate(system, 2)\n"
        "heavy = {'pandas', 'matplotlib', 'scipy.optimize', 'scipy.stats'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)\n"
        "assert len(run.events) == 0 and 'pandas' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    ("room", "above"), [("mems_impact", "tests|validation"), ("validation", "tests")]
)
def test_what_is_tested_does_not_import_its_tests(room, above):
    pattern = re.compile(rf"^\s*(?:from|import) (?:{above})\b", re.MULTILINE)
    files = list((Path(__file__).parents[1] / room).rglob("*.py"))
    assert len(files) > 10
    assert [str(file) for file in files if pattern.search(file.read_text("utf-8"))] == []


def test_messages_and_docstrings_name_what_is_public():
    named = {
        (path.name, name)
        for path in Path(mi.__file__).parent.rglob("*.py")
        for name in re.findall(r"\bmems_impact\.([A-Z]\w*)", path.read_text(encoding="utf-8"))
    }
    assert named
    assert {(file, name) for file, name in named if name not in mi.__all__} == set()
