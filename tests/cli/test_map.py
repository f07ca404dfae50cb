import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi

AXES = ["--x", "amplitude=0.2:0.26:3", "--y", "omega=0.48:0.5:2"]
BRIEF = ["--transient", "20", "--periods", "5"]
# The fast tests compile the loops of maps and exponents for one method only.
METHOD = ["--method", "dop853"]
ARGUMENTS = ["map", "zhao2004", *AXES, *BRIEF, *METHOD]
FILE = """device = "zhao2004"
[drive]
kind = "sine"
[study]
kind = "map"
x = ["amplitude", 0.2, 0.26, 3]
y = ["omega", 0.48, 0.5, 2]
recurrence = {transient = 20, periods = 5}
options = {method = "dop853"}
store = "kept"
"""


@pytest.mark.slow
def test_table_summary_and_figure(cli, tmp_path):
    done = cli(*ARGUMENTS, "--initial", "kicked", "--column", "mean speed")
    assert done.status == 0
    written = "written: out/map-table.csv, out/map-summary.csv, out/map.png"
    assert done.out.splitlines()[-1] == written
    table = pd.read_csv(tmp_path / "out" / "map-table.csv", float_precision="round_trip")
    actuator = mi.load_actuator("zhao2004")
    found = mi.operating_map(
        actuator,
        mi.Sine(amplitude=0.2, omega=0.48),
        x=("amplitude", np.linspace(0.2, 0.26, 3)),
        y=("omega", [0.48, 0.5]),
        initial=mi.kicked_state(actuator),
        recurrence=mi.RecurrenceOptions(transient=20, periods=5),
        options=mi.Options(method="dop853"),
    )
    pd.testing.assert_frame_equal(table, found.table, check_exact=True)
    summary = pd.read_csv(tmp_path / "out" / "map-summary.csv")
    assert summary["points"].sum() == 6
    assert (tmp_path / "out" / "map.png").read_bytes().startswith(b"\x89PNG")
    shown = [line.split() for line in done.out.splitlines()[1 : 1 + len(summary)]]
    assert [int(words[-6]) for words in shown] == summary["points"].to_list()


@pytest.mark.slow
def test_a_study_file_continues_with_the_same_store(cli, tmp_path):
    (tmp_path / "study.toml").write_text(FILE)
    first = cli(*ARGUMENTS, "--store", "kept", "--no-figure")
    assert first.status == 0
    table = (tmp_path / "out" / "map-table.csv").read_bytes()
    chunks = sorted((tmp_path / "kept" / "points").iterdir())
    before = [chunk.stat().st_mtime_ns for chunk in chunks]
    again = cli("map", "study.toml", "--no-figure", "--workers", "1")
    assert again == first
    assert (tmp_path / "out" / "map-table.csv").read_bytes() == table
    assert [chunk.stat().st_mtime_ns for chunk in chunks] == before
    assert cli("map", "study.toml", "--store", "other", "--no-figure").out == again.out
    assert (tmp_path / "other").exists()


def test_ends_of_an_axis_have_units(cli, tmp_path):
    axes = ["--x", "amplitude=40V:0.06kV:3", "--y", "frequency=680Hz:0.72kHz:2"]
    done = cli("map", "mita2003", *axes, "--exponents", "none", "--transient", "2",
               "--periods", "2", *METHOD, "--no-figure")  # fmt: skip
    assert done.status == 0
    table = pd.read_csv(tmp_path / "out" / "map-table.csv")
    assert sorted(set(table["amplitude [V]"])) == pytest.approx([40.0, 50.0, 60.0])
    assert sorted(set(table["frequency [Hz]"])) == pytest.approx([680.0, 720.0])


def test_a_failed_point_is_said(cli):
    done = cli("map", "zhao2004", "--x", "e=0.8:1.2:2", "--y", "omega=0.48:0.5:2",
               *BRIEF, *METHOD, "--amplitude", "0.2", "--no-figure")  # fmt: skip
    assert done.status == 0
    assert "failed at e = 1.2, omega = 0.48: e = 1.2: must be" in done.out


REFUSED = {
    ("map", "zhao2004"): "missing option '--x'",
    ("map", "zhao2004", *AXES[:2]): "missing option '--y'",
    ("map", "nothing.toml"): "no such file",
    (*ARGUMENTS, "--omega", "0.5"): "--omega is the varied parameter",
    (*ARGUMENTS, "--column", "status"): "--column status: must be one of period, impacts",
    (*ARGUMENTS, "--initial", "kick"): "'kick' must be NAME=NUMBER",
    ("map", "zhao2004", *AXES[:2], "--y", "e=0.7:0.8:2", "--omega", "0.5", "--curves"):
        "--curves: for maps of a device over amplitude and omega",
    ("map", "zhao2004", *AXES[:2], "--y", "f=0.7:0.8:2", "--omega", "0.5"):
        "y = 'f': must be one of",
    ("map", "zhao2004", *AXES, "--x", "amplitude=0.2:0.2:3"): "finite numbers that differ",
    ("map", "study.toml", *AXES): "--x: study.toml describes the study",
    ("map", "study.toml", "--bias", "1"): "--bias: study.toml describes the study",
    ("map", "code.toml"): "names Python code",
}  # fmt: skip


@pytest.mark.parametrize("arguments", REFUSED, ids=lambda each: " ".join(each))
def test_refused(cli, tmp_path, arguments):
    (tmp_path / "study.toml").write_text(FILE)
    (tmp_path / "code.toml").write_text('system = "a.py:b"\n[study]\n' + FILE.split("[study]")[1])
    assert REFUSED[arguments] in cli(*arguments).complaint()
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT to another process there")
def test_an_interrupted_map_keeps_what_is_done(tmp_path):
    axes = ["--x", "amplitude=0.2:0.26:100", "--y", "omega=0.48:0.5:100"]
    store = tmp_path / "kept"
    mapping = subprocess.Popen(
        [sys.executable, "-m", "mems_impact", "map", "zhao2004", *axes, "--store", str(store),
         "--output", str(tmp_path / "out")],
        stderr=subprocess.PIPE,
        # A shell that starts something in the background lets its children ignore interrupts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    while mapping.poll() is None and not list((store / "points").glob("0*.parquet")):
        time.sleep(0.01)
    mapping.send_signal(signal.SIGINT)
    try:
        _, said = mapping.communicate(timeout=60)
    finally:
        mapping.kill()
    assert mapping.returncode == 130
    line = said.decode().splitlines()[-1]
    done = int(line.split("interrupted after ")[1].split()[0])
    assert "map-table.csv" in line
    assert len(pd.read_csv(tmp_path / "out" / "map-table.csv")) == done > 0
