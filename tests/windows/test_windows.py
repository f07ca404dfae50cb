"""Tests of files, studies, the command line and export where what Windows lacks is hidden."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
FILES = (
    "studies/engine/test_store.py", "studies/engine/test_executors.py", "_util/test_files.py",
    "export/test_library.py", "studies/test_saving.py", "systems/test_result.py",
    "cli/test_simulate.py", "cli/test_sweep.py", "cli/test_show.py", "cli/test_diagram.py",
    "cli/test_help.py", "cli/test_new.py", "cli/test_devices.py", "cli/test_export.py",
)  # fmt: skip


def environment():
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(HERE), str(ROOT)]),
        "PYTHONIOENCODING": "cp1252",
        "PYTHONUTF8": "0",
    }


def output(command, folder=ROOT):
    done = subprocess.run(command, cwd=folder, env=environment(), capture_output=True)
    text = (done.stdout + done.stderr).decode("cp1252", "replace")
    assert done.returncode == 0, text[-8000:]
    return text


def test_what_windows_lacks_is_hidden(tmp_path):
    script = tmp_path / "hidden.py"
    script.write_text(
        "import os, sys, multiprocessing\n"
        "from mems_impact.studies.engine import executors\n"
        "assert not hasattr(executors.os, 'sched_getaffinity') and hasattr(os, 'fork')\n"
        "assert not hasattr(executors.signal, 'pthread_sigmask')\n"
        "assert multiprocessing.get_start_method() == 'spawn'\n"
        "assert sys.stdout.encoding == 'cp1252' and open(__file__).encoding == 'cp1252'\n"
        "with open('held', 'w'):\n"
        "    try:\n"
        "        os.replace('held', 'other')\n"
        "    except PermissionError:\n"
        "        os.chdir('/')\n"
        "assert os.getcwd() == '/'\n",
        encoding="utf-8",
    )
    done = subprocess.run([sys.executable, script], cwd=tmp_path, env=environment(), text=True)
    assert done.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
def test_tests_pass_without_what_windows_lacks(file):
    arguments = ["-q", "-p", "no:cacheprovider", "-m", "not slow", f"tests/{file}"]
    assert " passed" in output([sys.executable, "-m", "pytest", *arguments])


@pytest.mark.slow
def test_the_readme_runs_without_what_windows_lacks(tmp_path):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    (tmp_path / "own.py").write_text(block, encoding="utf-8")
    assert "PD" in output([sys.executable, "own.py"], tmp_path)
    command = [sys.executable, "-m", "mems_impact"]
    (main,) = re.findall(r"mems-impact (sweep .*)", text)
    shorter = main.replace(":401", ":5").replace("--transient 300", "--transient 30").split()
    assert "off at" in output([*command, *shorter], tmp_path)
    for line in re.findall(r"bin/mems-impact ((?:new|docs) [^`]*)`", text):
        output([*command, *line.split()], tmp_path)
    written = {each.name for each in tmp_path.iterdir()}
    assert written == {"own.py", "branch.png", "out", "mine.toml"}
