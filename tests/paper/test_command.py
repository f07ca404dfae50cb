"""`python -m validation`."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from validation.__main__ import main

ROOT = Path(__file__).parents[2]


@pytest.mark.nightly
def test_one_figure_with_expected_verdicts(tmp_path, capsys):
    assert main(["--figure", "3", "--quick", "--output", str(tmp_path / "out")]) == 0
    assert "2 statements: 2 agrees" in capsys.readouterr().out
    assert (tmp_path / "out" / "report.html").exists()
    again = ["--figure", "3", "--quick", "--output", str(tmp_path / "again"), "--expect"]
    assert main([*again, str(tmp_path / "out" / "verdicts.csv")]) == 0
    assert "no verdict differs" in capsys.readouterr().out
    other = tmp_path / "other.csv"
    other.write_text("id,verdict\n3.displacement,differs\n3.two-impacts,agrees\n")
    assert main([*again, str(other)]) == 1
    assert "verdicts changed: 3.displacement: agrees, was: differs" in capsys.readouterr().err


def test_a_figure_that_the_paper_has_not(tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        main(["--figure", "1", "--output", str(tmp_path / "out")])
    assert end.value.code == 2
    assert "invalid choice: 1" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_that_cannot_be_read_or_written(tmp_path, capsys):
    out = ["--figure", "3", "--output", str(tmp_path / "out")]
    assert main([*out, "--expect", str(tmp_path / "none.csv")]) == 2
    assert "none.csv: cannot be read" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").write_text("a file")
    assert main(out) == 2
    assert "out: cannot be written" in capsys.readouterr().err


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_ctrl_c_is_heard_at_once_and_keeps_what_is_done(tmp_path):
    command = subprocess.Popen(
        [sys.executable, "-m", "validation", "--figure", "3", "7", "--quick", "--output", tmp_path],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that starts something in the background lets its children ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        while "figure 3 done" not in (line := command.stderr.readline()):
            assert line, "the command ended before figure 3"
        begin = time.perf_counter()
        command.send_signal(signal.SIGINT)
        _, errors = command.communicate(timeout=60)
    finally:
        command.kill()
    assert command.returncode == 130
    # A second on a machine that does nothing else; figure 7 takes thirty.
    assert time.perf_counter() - begin < 5.0
    last = errors.splitlines()[-1]
    assert re.match(r"validation: interrupted after 1 of 2 figures; written: \d+ files in ", last)
    names = {path.name for path in tmp_path.iterdir()}
    assert {"figure3.png", "report.md", "verdicts.csv"} < names
    assert not any("figure7" in name for name in names)
    assert "3.displacement" in (tmp_path / "report.md").read_text()
    assert "leaked" not in errors
