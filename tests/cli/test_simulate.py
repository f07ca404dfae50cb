from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.tables import with_units

ARGUMENTS = ["simulate", "zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--periods", "20"]


@pytest.mark.slow
def test_tables_and_figure_are_written_and_said(cli, tmp_path):
    done = cli(*ARGUMENTS)
    assert done.status == 0
    names = [f"simulate-{table}.csv" for table in ("impacts", "blows", "events", "statistics")]
    names.append("simulate.png")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(names)
    for name in names:
        assert f"out/{name}" in done.out.partition("written: ")[2]
    assert (tmp_path / "out" / "simulate.png").read_bytes().startswith(b"\x89PNG")


def test_tables_hold_what_python_gives(cli, tmp_path):
    cli(*ARGUMENTS, "--no-figure", "--set", "e=0.7", "--initial", "x2=0.1", "--bias", "0.05")
    run = mi.simulate(
        mi.load_actuator("zhao2004").replace(e=0.7),
        mi.Sine(amplitude=0.24, omega=0.5, bias=0.05),
        periods=20,
        initial=mi.State(x2=0.1),
    )
    written = pd.read_csv(tmp_path / "out" / "simulate-impacts.csv")
    expected = run.impacts.astype({"stopper": object})
    pd.testing.assert_frame_equal(written, expected, check_dtype=False, rtol=1e-15)
    statistics = pd.read_csv(tmp_path / "out" / "simulate-statistics.csv", index_col=0)["value"]
    assert statistics["displacement per period"] == pytest.approx(
        run.statistics["displacement per period"], rel=1e-15
    )


def test_blows_are_shown_and_written(cli, tmp_path):
    real = ["simulate", "mita2003", "--amplitude", "100", "--frequency", "1", "--no-figure"]
    done = cli(*real, "--periods", "3")
    drive = mi.Sine(amplitude=100.0, omega=2 * np.pi)
    run = mi.simulate(mi.load_actuator("mita2003"), drive, 3)
    assert f"First of the {len(run.blows)} blows into which the impacts are grouped:" in done.out
    assert "displacement per blow std [m]" in done.out
    written = pd.read_csv(tmp_path / "out" / "simulate-blows.csv")
    expected = with_units(run.blows).astype({"stopper": object})
    pd.testing.assert_frame_equal(written, expected, check_dtype=False, rtol=1e-15)
    assert len(written) < len(run.impacts) == written["impacts"].sum()
    assert "Each impact is a blow of its own." in cli(*ARGUMENTS, "--no-figure").out


def test_a_run_without_impact_says_so(cli):
    done = cli(*ARGUMENTS, "--amplitude", "0.05")
    assert done.status == 0
    assert "No impact. A slowly rising voltage strikes at 0.3849" in done.out
    assert "closest approach" in done.out
    assert "impact speed" not in done.out


def test_window_is_that_of_the_statistics(cli):
    out = cli(*ARGUMENTS, "--no-figure", "--window", "18:20").out
    assert "forcing periods 18 to 20" in out


def test_a_failed_run_keeps_its_tables(cli, tmp_path, monkeypatch):
    whole = mi.simulate(
        mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), periods=20
    )

    def failing(*_arguments, **_options):
        raise mi.RunError(
            reason="it broke",
            remedy="mend it",
            cycle=20,
            phase_time=0.0,
            mode="stuck-free",
            state={"x1": 0.0},
            partial=whole,
        )

    monkeypatch.setattr(mi, "simulate", failing, raising=False)
    done = cli(*ARGUMENTS)
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "it broke" in done.err
    assert "mend it" in done.err
    assert "out/simulate-impacts.csv" in done.err
    assert len(pd.read_csv(tmp_path / "out" / "simulate-impacts.csv")) == len(whole.impacts)


def test_interrupted(cli, monkeypatch):
    def interrupted(*_arguments, **_options):
        raise KeyboardInterrupt

    monkeypatch.setattr(mi, "simulate", interrupted, raising=False)
    done = cli(*ARGUMENTS)
    assert done.status == 130
    assert done.err.strip() == "mems-impact: interrupted; nothing was written"


def test_a_fallback_is_one_line(cli, monkeypatch):
    from mems_impact.errors import EngineUnavailable
    from mems_impact.integrators.cvode import compiled

    def unavailable():
        raise EngineUnavailable("no SUNDIALS here", "install it")

    monkeypatch.setattr(compiled, "load", unavailable)
    done = cli(*ARGUMENTS, "--no-figure", "--periods", "1")
    assert done.status == 0
    assert done.err.count("\n") == 1
    assert done.err.startswith("mems-impact: warning: no SUNDIALS here; install it")
    refused = cli(*ARGUMENTS, "--no-figure", "--engine", "compiled")
    assert refused.status == 1
    assert refused.err == "mems-impact: no SUNDIALS here; install it\n"


def test_verify_shows_and_writes_the_comparison(cli, tmp_path):
    done = cli(*ARGUMENTS, "--verify", "--no-figure")
    assert done.status == 0
    statistics, comparison = done.out.split("Comparison with an independent method:\n")
    assert "impacts per period" in statistics
    assert "agree to the end, period 20" in comparison.splitlines()
    assert "out/simulate-verification.csv" in done.out.splitlines()[-1]
    run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), periods=20)
    written = pd.read_csv(tmp_path / "out" / "simulate-verification.csv")
    pd.testing.assert_frame_equal(written, run.verify().table, rtol=1e-15)


@pytest.mark.slow
def test_a_chaotic_run_is_no_failure(cli):
    done = cli(*ARGUMENTS, "--omega", "0.45", "--amplitude", "0.26", "--periods", "50", "--verify")
    assert done.status == 0
    assert "beyond, the motion is too sensitive" in done.out


@pytest.mark.nightly
def test_a_run_that_does_not_agree_fails(cli, tmp_path, monkeypatch):
    simulate = mi.simulate

    def without_an_impact(*arguments, **options):
        run = simulate(*arguments, **options)
        events = run.trajectory.events
        rows = np.ones(len(events), dtype=bool)
        rows[np.flatnonzero(events.kind == 0)[4]] = False
        return replace(run, trajectory=replace(run.trajectory, events=events[rows]))

    monkeypatch.setattr(mi, "simulate", without_an_impact, raising=False)
    assert cli(*ARGUMENTS).status == 0
    done = cli(*ARGUMENTS, "--verify")
    assert done.status == 1
    assert "do not agree: 'slip end'" in done.out
    assert (tmp_path / "out" / "simulate-verification.csv").exists()
    assert "out/simulate-verification.csv" in done.out.splitlines()[-1]


def test_what_the_first_run_gave_stands_if_the_second_fails(cli, tmp_path, monkeypatch):
    def interrupted(_run):
        raise KeyboardInterrupt

    monkeypatch.setattr(mi.Run, "verify", interrupted)
    done = cli(*ARGUMENTS, "--verify")
    assert done.status == 130
    assert "out/simulate-impacts.csv" in done.err
    assert not (tmp_path / "out" / "simulate-verification.csv").exists()
