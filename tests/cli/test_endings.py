"""How commands end early: what stands on the disk then, what is said, and the exit status."""

import os
import re
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.cli import interrupts
from mems_impact.cli.interrupts import interruptible

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals and limits of Unix")

PROGRAM = [sys.executable, "-m", "mems_impact"]
SIMULATE = ["simulate", "zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--periods", "200"]
SWEEP = ["sweep", "zhao2004", "amplitude=0.16:0.24:3", "--omega", "0.5"]
SWEEP += ["--transient", "20", "--periods", "5"]
CHART = ["chart", "zhao2004"]
TABLES = [f"simulate-{what}.csv" for what in ("blows", "events", "impacts", "statistics")]


def hears_interrupts():
    # A shell that starts something in the background lets its children ignore them.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def started(*arguments, **more):
    return subprocess.Popen(
        [*PROGRAM, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hears_interrupts,
        **more,
    )


def stopped(process, number):
    """Send a signal; return the seconds until the end, and standard error."""
    begin = time.perf_counter()
    process.send_signal(number)
    try:
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    return time.perf_counter() - begin, errors


def names(directory):
    return sorted(path.name for path in directory.iterdir())


@pytest.mark.parametrize(
    ("arguments", "files"),
    [
        pytest.param(SIMULATE, [*TABLES, "simulate.png"], marks=pytest.mark.slow),
        pytest.param(
            [*SWEEP, "--no-figure"],
            ["sweep-summary.csv", "sweep-table.csv"],
            marks=pytest.mark.slow,
        ),
    ],
    ids=["simulate", "sweep"],
)
def test_a_reader_that_goes_away_loses_no_file(tmp_path, arguments, files):
    command = started(*arguments, "--no-progress", "--output", str(tmp_path))
    command.stdout.close()
    assert all(": warning: " in line for line in command.stderr)  # of so short a sweep
    assert command.wait() == 141
    assert names(tmp_path) == files


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_standard_output(tmp_path, unbuffered):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*PROGRAM, *SIMULATE, "--no-figure", "--no-progress", "--output", str(tmp_path)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )
    assert done.returncode == 1
    assert done.stderr.startswith("mems-impact: cannot write standard output (no space left")
    assert done.stderr.count("\n") == 1
    assert "simulate-impacts.csv" in done.stderr
    assert names(tmp_path) == TABLES


def test_a_help_page_into_a_closed_pipe():
    help_page = started("--help")
    help_page.stdout.close()
    assert help_page.stderr.read() == ""
    assert help_page.wait() == 141


def test_a_full_disk_leaves_the_tables_of_the_run_before(tmp_path, cli):
    for table in TABLES:
        (tmp_path / table).write_text("the run before")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # No file may be longer: writing fails as on a full disk.
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        done = cli(*SIMULATE, "--no-figure", "--no-progress", "--output", ".")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "simulate-impacts.csv: cannot be written (file too large); make room" in done.err
    assert names(tmp_path) == TABLES
    for table in TABLES:
        assert (tmp_path / table).read_text() == "the run before"


@pytest.mark.slow
def test_an_interrupt_before_anything_leaves_no_folder(tmp_path):
    directory = tmp_path / "new" / "out"
    arguments = ["--omega", "0.46:0.47", "--periods", "1000000", "--no-progress"]
    command = started("chart", "zhao2004", *arguments, "--output", str(directory))
    while not directory.exists():
        assert command.poll() is None, command.stderr.read()
        time.sleep(0.01)
    time.sleep(0.3)
    seconds, errors = stopped(command, signal.SIGINT)
    assert command.returncode == 130
    after = r"( after 0 (of 2 )?parts)?"  # none where it still imports what it needs
    assert re.fullmatch(f"mems-impact: interrupted{after}; nothing was written\n", errors)
    assert names(tmp_path) == []
    assert seconds < 5.0


def test_an_interrupt_while_the_command_line_is_imported():
    program = """
import os, signal, sys

class Interrupt:
    def find_spec(self, name, *rest):
        if name == "click":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Interrupt())
from mems_impact.cli import main
main(["devices"])
"""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=hears_interrupts)
    assert done.stderr == "mems-impact: interrupted; nothing was written\n"
    assert done.returncode == 130


def test_an_interrupt_while_a_class_names_its_members(monkeypatch, cli):
    class Member:
        def __set_name__(self, owner, name):
            raise KeyboardInterrupt

    def load(_name):
        type("Owner", (), {"member": Member()})  # as where a class is imported

    monkeypatch.setattr("mems_impact.actuator.device_files.load_actuator", load)
    done = cli(*SIMULATE)
    assert done.err == "mems-impact: interrupted; nothing was written\n"
    assert done.status == 130


def test_an_interrupt_names_the_store_and_the_same_command_completes_it(tmp_path, monkeypatch, cli):
    grid = ["--x", "amplitude=0.2:0.24:3", "--y", "omega=0.49:0.5:2"]
    store = str(tmp_path / "store")
    command = ["map", "zhao2004", *grid, "--transient", "5", "--periods", "2", "--store", store]
    command += ["--exponents", "none", "--no-figure", "--no-progress", "--workers", "1", "--output"]

    def stop(*arguments, **named):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("mems_impact.studies.attractor_study.map_attractors", stop)
        done = cli(*command, "one")
    assert done.status == 130
    assert done.err == (
        f"mems-impact: interrupted after 0 of 6 points; the same command resumes from {store}\n"
    )
    assert cli(*command, "one").status == 0
    assert mi.load(store).done == 6


def test_an_interrupt_during_the_margins_keeps_the_search(tmp_path, monkeypatch, cli):
    def stop(*arguments, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr("mems_impact.studies.optimize.bifurcation_margins", stop)
    done = cli(
        "optimize", "zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--initial", "kicked",
        "--maximize", "mean speed", "--over", "amplitude=0.235:0.245", "--no-progress",
    )  # fmt: skip
    assert done.status == 130
    assert done.err.endswith("written: out/optimize-history.csv\n")


@pytest.mark.slow
def test_sigterm_is_heard_like_ctrl_c(tmp_path):
    directory = tmp_path / "out"
    command = started(*SIMULATE, "--periods", "1e8", "--output", str(directory), "--progress")
    assert "periods" in read_until(command.stderr, "periods/s")
    _, errors = stopped(command, signal.SIGTERM)
    assert command.returncode == 143
    line = errors.splitlines()[-1]
    assert line.startswith("mems-impact: interrupted after ")
    assert names(directory) == TABLES
    assert len(pd.read_csv(directory / "simulate-impacts.csv")) > 0


def read_until(stream, words):
    """Return what a process says up to `words`."""
    said = ""
    while words not in said:
        more = stream.read(1)
        assert more, f"the process ended after saying {said!r}"
        said += more
    return said


@pytest.fixture
def heard_in_background():
    """A shell has what it puts into the background ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard_in_background")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_is_not_lost_in_a_call_from_c(number):
    class Late:
        def __del__(self):
            signal.raise_signal(number)

    def work(heard):
        with interruptible() as signals:
            heard.append(signals)
            for _ in range(2):
                late = Late()
                del late  # what its deletion raises is dropped
            for _ in range(500):
                time.sleep(0.01)

    heard = []
    with pytest.raises(KeyboardInterrupt):
        work(heard)
    assert set(heard[0]) == {number}


@pytest.mark.nightly
@pytest.mark.usefixtures("heard_in_background")
def test_an_interrupt_waits_for_an_extension_module(monkeypatch):
    """Such modules drop what is raised while they are imported."""
    imported = []

    def importing(_module):  # what the loader does, in a module that imports others
        signal.raise_signal(signal.SIGINT)
        imported.append(True)

    monkeypatch.setattr(interrupts, "_IMPORTS", {importing.__code__})

    def work():
        with interruptible():
            importing(None)
            time.sleep(5)

    with pytest.raises(KeyboardInterrupt):
        work()
    assert imported == [True]


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [([], True), (["--quiet"], False), (["--progress"], True), (["--no-progress"], False),
     (["--progress", "--quiet"], True)],
)  # fmt: skip
@pytest.mark.parametrize(
    ("name", "command"), [("simulate", SIMULATE), ("sweep", SWEEP), ("operating_chart", CHART)]
)
def test_progress_unless_quiet(cli, monkeypatch, name, command, arguments, shown):
    asked = []

    def heard(*_arguments, progress, **_more):
        asked.append(bool(progress))
        raise KeyboardInterrupt

    monkeypatch.setattr(mi, name, heard)
    assert cli(*command, *arguments).status == 130
    assert asked == [shown]
