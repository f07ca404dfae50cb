"""Former words of the command line go on working, unseen, and say what is written now."""

import pytest

from mems_impact.cli.former import FORMER

SIMULATE = "simulate zhao2004 --amplitude 0.24 --omega 0.5 --periods 3 --no-figure"
ORBIT = "orbit zhao2004 --amplitude 0.24 --omega 0.5 --no-figure"
CONTINUE = "continue zhao2004 --parameter amplitude --omega 0.5 --stop 0.239 --no-figure"
FIT = "fit mita2003 --free k --frequency 1 --amplitude 100 --target blows\xa0per\xa0period=1"
PULSE = "zhao2004 --drive pulse --amplitude 0.3 --width 2 --no-figure"
SHORT = "--points 2 --transient 1 --periods 1 --no-figure"
SWEEP = f"sweep zhao2004 --parameter amplitude --omega 0.5 {SHORT}"
WIDTH = f"{PULSE} --parameter width --start 2 --stop"
STATE = ("x2", "v2", "v1")
PERIOD = ("--period 12", "--drive-period 12")

# What was typed before and is typed now, after a command that is quick with it.
CASES = [
    ("chart zhao2004", "--from 0.6", "--start 0.6"),
    ("chart zhao2004", "--to 0.3", "--stop 0.3"),
    (CONTINUE, "--from 0.24", "--start 0.24"),
    (f"continue {WIDTH} 2", *PERIOD),
    *((f"{CONTINUE} --start 0.24", f"--{x} 0.01", f"--initial {x}=0.01") for x in STATE),
    (f"drive {PULSE}", *PERIOD),
    *((FIT, f"--{x} 1e-9", f"--initial {x}=1e-9") for x in STATE),
    (FIT, *PERIOD),
    *((ORBIT, f"--{x} 0.01", f"--initial {x}=0.01") for x in STATE),
    (f"orbit {PULSE}", *PERIOD),
    *((SIMULATE, f"--{x} 0.1", f"--initial {x}=0.1") for x in STATE),
    (f"simulate {PULSE} --periods 3", *PERIOD),
    (f"{SWEEP} --stop 0.24", "--from 0.2", "--start 0.2"),
    (f"{SWEEP} --start 0.2", "--to 0.24", "--stop 0.24"),
    (f"sweep {WIDTH} 2.1 {SHORT}", *PERIOD),
    ("validate --quick", "--figure 1", "1"),
]  # fmt: skip


def words(line):
    return [word.replace("\xa0", " ") for word in line.split()]


def files(directory):
    return {path.name: path.read_bytes() for path in directory.rglob("*.csv")}


@pytest.mark.parametrize(("rest", "before", "now"), CASES)
def test_a_former_word_does_the_same_and_says_the_present_one(cli, tmp_path, rest, before, now):
    former = cli(*words(rest), *words(before))
    written = files(tmp_path)
    present = cli(*words(rest), *words(now))
    assert former.err.splitlines()[0] == f"mems-impact: warning: {before} is now written {now}"
    assert former.err.split("\n", 1)[1] == present.err
    assert former[:2] == present[:2]
    assert written == files(tmp_path)


def test_every_former_word_is_tried():
    tried = {(rest.split()[0], before.split()[0]) for rest, before, _ in CASES}
    assert tried == {(command, word) for command, former in FORMER.items() for word in former}


@pytest.mark.parametrize("command", FORMER)
def test_help_shows_present_words_alone(cli, command):
    shown = cli(command, "--help").out.replace(",", " ").split()
    for word in FORMER[command]:
        assert word not in shown


def test_one_line_for_all_of_them_with_values_joined_too(cli):
    done = cli(*words(SWEEP), "--from=0.2", "--to", "0.24")
    assert done.status == 0
    line = "--from 0.2 --to 0.24 is now written --start 0.2 --stop 0.24"
    assert done.err == f"mems-impact: warning: {line}\n"


def test_a_former_word_without_its_value(cli):
    assert "'--figure' requires an argument" in cli("validate", "--figure").complaint()


def test_present_words_are_left_alone(cli):
    done = cli(*words(SIMULATE.replace("--no-figure", "--figure run.png")))
    assert done.status == 0
    assert "is now written" not in done.err
    assert "run.png" in done.out
    assert "--from" in cli("simulate", "zhao2004", "--from", "1").complaint()


def test_what_follows_two_dashes_is_no_option(cli):
    assert "Traceback" not in cli("validate", "--", "--figure", "3").complaint()
