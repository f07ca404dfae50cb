"""What those see who build on the package: types, completion, signatures, small tables."""

import inspect
import re
import subprocess
import sys
from pathlib import Path

import pydantic
import pytest

import mems_impact as mi
from mems_impact.actuator.terms import TERM_CLASSES

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CONFIGURATION = """[mypy]
strict = True
# Of the package's own files errors are told by the check of the package.
follow_imports = silent
mypy_path = {root}
[mypy-matplotlib.*,numba.*,pandas.*,pyarrow.*,scipy.*,xarray.*]
ignore_missing_imports = True
follow_imports = skip
"""
PYDANTIC = {name for name in dir(pydantic.BaseModel) if not name.startswith("__")}


@pytest.mark.slow
def test_a_consumer_passes_mypy_strict(tmp_path):
    (tmp_path / "mypy.ini").write_text(CONFIGURATION.format(root=ROOT))
    used = HERE / "uses_every_name.py"
    cache = ROOT / ".mypy_cache" / "consumer"
    arguments = ["--config-file", "mypy.ini", "--cache-dir", str(cache), str(used)]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *arguments], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.startswith("Success"), done.stdout + done.stderr


def test_the_consumer_uses_every_public_name():
    used = set(re.findall(r"\bmi\.(\w+)", (HERE / "uses_every_name.py").read_text("utf-8")))
    assert set(mi.__all__) - set(TERM_CLASSES.values()) <= used  # of terms, a few


def test_the_package_says_that_it_is_typed():
    assert (ROOT / "mems_impact" / "py.typed").is_file()


@pytest.mark.parametrize(
    "one", [mi.load_actuator("mita2003"), mi.Sine(amplitude=1.0, omega=1.0), mi.Tilt(angle=0.1)]
)
def test_completion_and_signature_of_parameter_objects_are_their_own(one):
    for offered in (dir(one), dir(type(one))):
        assert not PYDANTIC & set(offered)
        assert "replace" in offered
    assert set(type(one).model_fields) <= set(dir(one))
    signature = inspect.signature(type(one))
    assert list(signature.parameters) == list(type(one).model_fields)
    assert "Annotated" not in str(signature)


def test_signatures_tell_types_and_defaults():
    expected = "(*, amplitude: float, omega: float = nan, bias: float = 0.0, phase: float = 0.0, "
    expected += "frequency: float | None = None)"
    assert str(inspect.signature(mi.Sine)) == expected


def test_results_and_devices_are_small_tables_in_a_notebook():
    device = mi.load_actuator("mita2003")
    assert "<th style='text-align:left'>k [N/m]</th><td style='text-align:left'>4.765</td>" in (
        device._repr_html_()
    )
    blows = mi.BlowStatistics(
        count=3, per_period=1.0, displacement_per_blow=0.25, displacement_std=0.0
    )
    assert "<caption>BlowStatistics</caption>" in blows._repr_html_()
    assert "0.25" in blows._repr_html_()
    for name in mi.__all__:
        kind = getattr(mi, name)
        has_table = isinstance(inspect.getattr_static(kind, "table", None), property)
        assert not (inspect.isclass(kind) and has_table) or hasattr(kind, "_repr_html_"), name
