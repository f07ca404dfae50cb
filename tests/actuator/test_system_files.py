"""Study files: what Python does with the same words, and what is refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from tests.analysis import systems

DEVICE = 'device = "zhao2004"\n[drive]\nkind = "sine"\n'
STUDY = """[study]
kind = "map"
x = ["amplitude", 0.22, 0.26, 3]
y = ["omega", [0.49, 0.5]]
"""
OWN = """system = "own.py:oscillator"
[study]
kind = "map"
x = ["A", 0.5, 0.6, 2]
y = ["e", [0.7]]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "own.py").write_text(Path(systems.__file__).read_text())
    return tmp_path


def written(folder, text, name="study.toml"):
    (folder / name).write_text(text)
    return folder / name


def test_the_words_are_those_of_python(folder):
    text = (
        DEVICE
        + "[set]\ne = 0.7\ntilt = {angle = 0.01}\n"
        + STUDY
        + 'initial = "kicked"\nworkers = 1\n'
        + "[study.recurrence]\ntransient = 20\nperiods = 5\n[study.options]\nrtol = 1e-8\n"
    )
    study = mi.load(written(folder, text))
    actuator = mi.load_actuator("zhao2004").changed(e=0.7, **{"tilt.angle": 0.01})
    assert study.system == actuator.under(mi.Sine(amplitude=0.22, omega=0.49))
    given = study.arguments
    assert given["initial"] == mi.kicked_state(actuator)
    assert given["recurrence"] == mi.RecurrenceOptions(transient=20, periods=5)
    assert given["options"] == mi.Options(method="auto", rtol=1e-8)
    assert given["workers"] == 1
    assert repr(study) == f"StudyFile(path='{folder / 'study.toml'}', kind='map')"


@pytest.mark.slow
def test_it_runs_as_python_does(folder):
    study = mi.load(written(folder, f'{DEVICE}{STUDY}initial = {{v2 = 1.0}}\nstore = "out"\n'))
    brief = mi.RecurrenceOptions(transient=20, periods=5)
    found = study.run(recurrence=brief)
    again = mi.operating_map(
        mi.load_actuator("zhao2004"),
        mi.Sine(amplitude=0.22, omega=0.49),
        x=("amplitude", np.linspace(0.22, 0.26, 3)),
        y=("omega", [0.49, 0.5]),
        initial={"v2": 1.0},
        recurrence=brief,
    )
    pd.testing.assert_frame_equal(found.table, again.table, check_exact=True)
    assert (folder / "out" / "study.json").exists()  # beside the file, wherever it is run from


def test_a_drive_from_a_file_and_a_device_from_a_file(folder):
    written(
        folder, '[drive]\nkind = "sine"\namplitude = 0.3\nomega = 0.5\nphase = 1\n', "wave.toml"
    )
    device = Path(mi.__file__).parent / "actuator" / "devices" / "zhao2004.toml"
    written(folder, device.read_text(), "mine.toml")
    text = 'device = "mine.toml"\ndrive = "wave.toml"\n'
    text += STUDY.replace('"omega", [0.49, 0.5]', '"tilt.angle", 0.0, 0.1, 2')
    study = mi.load(written(folder, text))
    assert study.system.drive == mi.Sine(amplitude=0.3, omega=0.5, phase=1)
    assert study.system.parameters["tilt.angle"] == 0.0


def test_code_runs_only_when_it_is_allowed(folder):
    (folder / "own.py").write_text("open('it-ran', 'w').close()")
    with pytest.raises(mi.InvalidFile) as caught:
        mi.load(written(folder, OWN))
    for word in (
        "study.toml",
        "system = 'own.py'",
        "--allow-code",
        "allow_code=True in load",
    ):
        assert word in str(caught.value)
    assert not (folder / "it-ran").exists()


@pytest.mark.parametrize("way", ["../elsewhere/own.py", "link.py"])
def test_code_from_elsewhere_never_runs(folder, way):
    below = folder / "below"
    for place in (below, folder / "elsewhere"):
        place.mkdir()
    (folder / "elsewhere" / "own.py").write_text("open('it-ran', 'w').close()")
    (below / "link.py").symlink_to(folder / "elsewhere" / "own.py")
    with pytest.raises(mi.InvalidFile, match="outside the folder of the study file"):
        mi.load(written(below, OWN.replace("own.py", way)), allow_code=True)
    assert not (folder / "it-ran").exists()


BAD = {
    "": "holds none of the tables",
    "[study": "not valid TOML",
    DEVICE: "zhao2004': must be in the table",
    "sytem = 1\n" + DEVICE + STUDY: "sytem = 1: unknown name, did you mean system?",
    STUDY: "device: missing",
    "device = 3\n" + STUDY: "device = 3: must be the name of a preset",
    'device = "nothing.toml"\n' + STUDY: "no such file",
    'device = "zhao2004"\n' + STUDY: "drive: missing",
    'device = "zhao2004"\ndrive = 1\n' + STUDY: "drive = 1: must be a table",
    'device = "zhao2004"\n[drive]\nkind = "sinus"\n' + STUDY: "drive.kind = 'sinus'",
    'device = "zhao2004"\n[drive]\nkind = "sine"\nbiass = 1\n' + STUDY: "drive.biass = 1",
    "set = 1\n" + DEVICE + STUDY: "set = 1: must be a table",
    DEVICE + "[set]\nq = 1\n" + STUDY: "q = 1",
    DEVICE + "[study]\n": "study.kind: missing, must be one of map",
    DEVICE + "[study]\nkind = 1\n": "study.kind = 1: must be one of map",
    DEVICE + '[study]\nkind = "maps"\n': "study.kind = 'maps'",
    DEVICE + '[study]\nkind = "map"\n': 'study.x: missing, must be ["NAME", START',
    DEVICE + STUDY + "transient = 3\n": "study.transient = 3: unknown name, must be one of x, y",
    DEVICE + STUDY + "recurrence = 3\n": "study.recurrence = 3: must be a table of some of",
    DEVICE + STUDY + "recurrence = {period = 3}\n": "study.recurrence.period = 3: unknown name",
    DEVICE + STUDY + "recurrence = {periods = 0}\n": "study.recurrence.periods = 0: must be a",
    DEVICE + STUDY + 'options = {method = "x"}\n': "study.options.method = 'x': must be one of",
    DEVICE + STUDY + "store = 3\n": "study.store = 3: must be a text",
    DEVICE + STUDY + 'executor = "dask"\n': "study.executor = 'dask': must be one of threads",
    DEVICE + STUDY + 'initial = "rest"\n': "study.initial = 'rest': must be a table",
    DEVICE + STUDY.replace(", 3]", "]"): "study.x = ['amplitude', 0.22, 0.26]: must be",
    DEVICE + STUDY.replace(", 3]", ", 0]"): "study.x = ",
    DEVICE + STUDY.replace(", 3]", ", 2.5]"): "study.x = ",
    DEVICE + STUDY.replace('["amplitude", 0.22, 0.26, 3]', '"amplitude"'): "study.x = 'amplitude'",
    'device = "zhao2004"\n' + OWN: "device: not allowed together with system",
    OWN.replace(":oscillator", ""): "system = 'own.py': must be a Python file and a name in it",
    OWN.replace("own.py", "own.txt"): "system = 'own.txt': must be a Python file",
    OWN.replace("own.py", "none.py"): "none.py: no such file",
    OWN.replace(":oscillator", ":nothing"): "holds no system nothing",
    OWN.replace(":oscillator", ":flow"): "flow() fails (TypeError",
    OWN.replace(":oscillator", ":math"): "holds no system math",
    OWN + 'initial = "kicked"\n': "study.initial = 'kicked': must be a table of components",
}  # fmt: skip


@pytest.mark.parametrize("text", BAD)
def test_bad_files_say_what_and_where(folder, text):
    with pytest.raises((mi.InvalidFile, mi.InvalidParameter)) as caught:
        mi.load(written(folder, text), allow_code=True)
    message = str(caught.value)
    assert BAD[text] in message
    assert "\n" not in message
    assert any(name in message for name in ("study.toml", "own.py", "none.py", "nothing.toml"))


def test_no_path():
    with pytest.raises(mi.InvalidParameter, match="path = 3: must be"):
        mi.load(3)
    with pytest.raises(mi.InvalidFile, match="no such file"):
        mi.load("nowhere.toml")
