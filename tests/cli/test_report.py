"""`mems-impact report`."""

import json

import pytest


@pytest.fixture
def device(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("""
        name = "mine"
        description = "A device & its drive"
        units = "SI"
        [design]
        frequency = "240 Hz"
        quality = 5
        proof_mass = "2 mg"
        mass_ratio = 5
        gap = "5 um"
        travel = "2.5 um"
        pull_in = "30 V"
        friction = [0.4, 0.27]
        restitution = 0.8
        [drive]
        kind = "sine"
        amplitude = "100 V"
        frequency = "1 Hz"
    """)
    return str(path)


BRIEF = ("--transient", "2", "--periods", "2", "--samples", "4")


@pytest.mark.slow
def test_a_page(cli, device, tmp_path):
    only = ("--only", "Pull-in and release", "--only", "Tolerances")
    over = ("--tolerance", "k=norm:4.8:0.1", "--specification", "mean speed=1 nm/s:")
    out = cli("report", device, "--output", "r.html", *only, *over, *BRIEF).out
    assert "pull-in  30 V" in out
    assert "yield    100 %" in out
    assert out.endswith("written: r.html\n")
    page = (tmp_path / "r.html").read_text("utf-8")
    assert '<h1>mine</h1>\n<p class="lead">A device &amp; its drive</p>' in page
    assert f"mems-impact report {device} --output r.html --only" in page


def test_json_and_a_section_that_fails(cli):
    only = ("--only", "Life", "--only", "Device")
    told = cli(
        "report", "zhao2004", "--amplitude", "0.2", "--omega", "0.5", *only, *BRIEF, "--json"
    )
    document = json.loads(told.out)
    assert document["files"] == ["report.html"]
    assert "the device is dimensionless" in document["values"]["Life"]


def test_without_a_drive(cli, tmp_path):
    cli("report", "mita2003", "--only", "Drive")
    assert "No drive was given" in (tmp_path / "report.html").read_text("utf-8")


def test_bad_input(cli):
    assert "must be a number [m]" in cli("report", "mita2003", "--depth", "3 V").complaint()
    charged = ("report", "mita2003", "--voltages", "1 pC:2 pC:3")
    assert "voltages = '1 pC': must be a number [V]" in cli(*charged).complaint()
