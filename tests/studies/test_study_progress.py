"""What is said of a study while it runs."""

import io
import logging

import pytest

from mems_impact._util import progress
from mems_impact.studies.engine.scheduler import run_study
from tests.studies.toys import Toy


class Clock:
    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(progress.time, "monotonic", lambda: self.now)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def progress_lines(clock, capsys, moments, before=0):
    """Return the lines at moments (seconds, points done, failed), of 1000 points."""
    with progress.progress_bar(True, "points", 1000, "map", before) as notice:
        for seconds, done, failed in moments:
            clock.now = seconds
            notice(done, f"{failed} failed")
    return capsys.readouterr().err.splitlines()


def test_a_line_every_tenth_of_the_points(clock, capsys):
    lines = progress_lines(clock, capsys, [(i, 25.0 * i, i // 10) for i in range(41)])
    assert len(lines) == 11
    assert lines[0] == (
        "mems-impact: map: 75 of 1000 points (8%), 25 points/s, 37 s left, 0 failed"
    )
    assert lines[1] == (
        "mems-impact: map: 175 of 1000 points (18%), 25 points/s, 33 s left, 0 failed"
    )
    assert lines[-1] == "mems-impact: map: 1000 of 1000 points (100%), 25 points/s, 4 failed"


def test_a_line_every_half_minute(clock, capsys):
    lines = progress_lines(clock, capsys, [(i, i / 100.0, 0) for i in range(100)])
    assert len(lines) == 4
    assert lines[0] == (
        "mems-impact: map: 0 of 1000 points (0%), 0.01 points/s, 27.8 h left, 0 failed"
    )


def test_the_rate_begins_with_the_first_points_of_this_run(clock, capsys):
    # The first 40 s hold loading and compiling; then 100 points take 20 s.
    first, second = progress_lines(clock, capsys, [(40.0, 810.0, 0), (60.0, 910.0, 2)], before=800)
    assert first == "mems-impact: map: 810 of 1000 points (81%), 0 failed"
    assert second == "mems-impact: map: 910 of 1000 points (91%), 5 points/s, 18 s left, 2 failed"


def test_nothing_is_said_of_short_work(clock, capsys):
    assert progress_lines(clock, capsys, [(2.9, 1000.0, 0)]) == []


def test_lines_go_where_a_log_is_kept(clock, capsys, caplog):
    with caplog.at_level(logging.INFO, "mems_impact"):
        assert progress_lines(clock, capsys, [(10.0, 950.0, 2)]) == []
    assert caplog.messages == ["map: 950 of 1000 points (95%), 2 failed"]


def test_a_bar_on_a_terminal(monkeypatch):
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr(progress, "QUIET_SECONDS", 0.0)
    run_study(Toy(size=40, failing=(3, 4)), progress=True, chunk=4)
    last = terminal.getvalue().rpartition("\r")[2]
    assert "toy: 100%" in last
    assert "40/40" in last
    assert "2 failed" in last


def test_silence_is_the_default(capsys):
    run_study(Toy(size=40))
    assert capsys.readouterr() == ("", "")
