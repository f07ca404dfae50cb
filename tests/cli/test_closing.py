"""`mems-impact closing` and `soft-landing`, beside what Python gives."""

import json

import pandas as pd
import pytest

import mems_impact as mi

SWITCH = mi.load_actuator("abdulrahim2016")


def test_closing_is_that_of_python(cli, tmp_path):
    done = cli("closing", "abdulrahim2016", "--amplitude", "90 V", "--json",
               "--output", "out")  # fmt: skip
    assert done.status == 0
    found = mi.closing(SWITCH, mi.VoltageStep(amplitude=90))
    shown = json.loads(done.out)
    assert shown["values"]["closing time"] == found.closing_time
    assert shown["values"]["bounces"] == found.bounces
    assert shown["values"]["energy lost"] == pytest.approx(found.energy.lost)
    assert shown["units"]["settling time"] == "s"
    written = pd.read_csv(tmp_path / "out" / "closing-impacts.csv")
    assert written["impact speed [m/s]"].iloc[0] == pytest.approx(found.impact_speed)


def test_a_run_that_ends_before_the_contact_closes(cli):
    """The contact closes at 27.8 us."""
    done = cli("closing", "abdulrahim2016", "--amplitude", "90", "--duration", "20 us")
    assert done.status == 1
    assert "the contact does not close within 2e-05 s; " in done.err
    assert "lengthen --duration" in done.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["closing", "zhao2004"], "missing option '--amplitude'"),
        (["simulate", "zhao2004", "--drive", "voltage-step", "--amplitude", "1"],
         "--drive-duration: missing: without a duration, this voltage has no forcing period"),
        (["soft-landing", "zhao2004", "--amplitude", "1"], "missing option '--width'"),
        (["soft-landing", "mita2003", "--over", "width=2e-3:1e-3"], "--over width = "),
    ],
)  # fmt: skip
def test_wrong_options(cli, arguments, message):
    assert message in cli(*arguments).complaint()


def test_a_landing_of_a_device_whose_file_has_another_voltage(cli):
    cli("new", "device", "mine.toml")  # with a sine
    done = cli("soft-landing", "mine.toml", "--amplitude", "40 V")
    assert done.status == 2
    assert "mine.toml has a table [drive] of another kind; add --drive pulse-and-hold" in done.err
