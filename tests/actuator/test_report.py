"""Reports: one page of HTML, section by section."""

from __future__ import annotations

import math
from html.parser import HTMLParser

import pytest

import mems_impact as mi
from mems_impact.actuator import plausibility
from mems_impact.actuator.report_page import amount, duration

MITA, ZHAO = mi.load_actuator("mita2003"), mi.load_actuator("zhao2004")
SLOW = mi.Sine(amplitude=100.0, frequency=1.0)
SHORT = {"transient": 2, "periods": 2}
VOID = {"meta", "img", "br"}


class Page(HTMLParser):
    """Headings, cells and images of a page, with a check that every tag is closed."""

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.attributes = [], {}, []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(tag, *each) for each in attrs]
        if tag not in VOID:
            self.open.append(tag)
        self.texts.setdefault(tag, []).append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.texts[self.open[-1]][-1] += data


@pytest.fixture(scope="module")
def page():
    wanted = ["Device", "Pull-in and release", "Drive", "Motion", "Energy", "Life", "Tolerances"]
    return mi.report(MITA, SLOW, only=wanted, samples=4, title="A <device>", **SHORT)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (2.0134e-8, "m", "20.13 nm"), (0.0, "V", "0 V"), (-4e-7, "m/s", "-400 nm/s"),
        (1.0486e-5, "kg", "10.49 mg"), (2e-8, "m^2", "0.02 mm²"), (9.80665, "m/s^2", "9.807 m/s²"),
        (8.854e-20, "F m", "8.854e-20 F m"), (999.96, "m", "1 km"), (5000.0, "s", "5000 s"),
        (math.inf, "s", "unlimited"), (math.nan, "m", "–"), (0.25, "", "0.25"),
    ],
)  # fmt: skip
def test_amounts(value, unit, text):
    assert amount(value, unit) == text


def test_durations():
    assert [duration(each) for each in (2.5, 7200.0, 3e5, 6.3e7, math.inf)] == [
        "2.5 s", "2 h", "3.472 days", "1.996 years", "unlimited"
    ]  # fmt: skip


@pytest.mark.slow
def test_numbers_are_those_of_the_design_functions(page):
    facts = page.facts
    pull_in = math.sqrt(4.0 * MITA.k * MITA.d**3 / (27.0 * MITA.alpha))
    assert facts["pull-in"] == f"{pull_in:.4g} V"
    release = math.sqrt(MITA.k * MITA.delta * (MITA.d - MITA.delta) ** 2 / MITA.alpha)
    assert facts["release"] == f"{release:.4g} V"
    run = mi.simulate(MITA, SLOW, 4, window=(2, 4), initial=mi.kicked_state(MITA))
    assert facts["step per cycle"] == amount(run.statistics["displacement per period"], "m")
    energy = mi.energy(run)
    assert facts["energy per cycle"] == amount(energy.input / energy.periods, "J")
    life = mi.life(run, wear=1e-13, area=1e-8, depth=1e-7)
    assert facts["life (assumed wear)"] == duration(life.time)
    assert [section.problem for section in page.sections] == [""] * 7


@pytest.mark.slow
def test_the_page_stands_alone(page, tmp_path):
    parsed = Page(page.html)
    assert parsed.texts["title"] == ["A <device>"]
    assert parsed.texts["h2"] == [section.title for section in page.sections]
    links = [value for _, name, value in parsed.attributes if name in ("href", "src")]
    assert all(each.startswith(("#section-", "data:image/")) for each in links)
    assert "http" not in page.html.replace("http-equiv", "")
    images = [value for tag, name, value in parsed.attributes if (tag, name) == ("img", "alt")]
    assert len(images) == 4
    assert all(images)
    cells = parsed.texts["td"]
    assert cells[cells.index("stiffness") + 1] == "4.765 N/m"
    assert "mi.report(Actuator(" in parsed.texts["pre"][0]
    page.save(tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == page.html


def test_it_depends_on_its_inputs_alone(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    pages = [mi.report(MITA, SLOW, only=["Device", "Drive"], **SHORT).html for _ in range(2)]
    assert pages[0] == pages[1]
    assert "on 1970-01-01." in pages[0]


def test_tolerances_of_the_user():
    page = mi.report(
        MITA, SLOW, only=["Tolerances"], samples=8, **SHORT,
        tolerances={"k": "0.1 N/m", "mu_d": ("uniform", 0.26, 0.02)},
        specification={"mean speed": ("1 nm/s", "1 um/s")},
    )  # fmt: skip
    assert page.facts["yield"] == "100 %"
    parsed = Page(page.html)
    assert {"0.1 N/m", "uniform, 0.26, 0.02", "1 nm/s", "1 µm/s"} <= set(parsed.texts["td"])
    assert "Assumed" not in page.html


def test_a_section_fails_alone():
    wanted = ["Device", "Motion", "Step and speed over the voltage", "Energy", "Life"]
    page = mi.report(ZHAO, mi.Sine(amplitude=0.0, omega=0.5), only=wanted, **SHORT)
    problems = {section.title: section.problem for section in page.sections if section.problem}
    assert problems.keys() == {"Step and speed over the voltage", "Life"}
    assert "give voltages" in problems["Step and speed over the voltage"]
    assert "the device is dimensionless" in problems["Life"]
    assert "so the device makes no step" in page.html
    parsed = Page(page.html)
    assert parsed.texts["h2"] == wanted
    page = mi.report(MITA, SLOW.replace(amplitude=1.0), only=["Tolerances"], **SHORT)
    assert "makes no step" in page.sections[0].problem


@pytest.mark.slow
def test_a_frame_that_slips_before_the_blow():
    device = MITA.replace(mu_s=0.01, mu_d=0.008)
    page = mi.report(device, SLOW, only=["Device", "Motion"], **SHORT)
    assert page.facts["regime"] == "frame slips before the blow"


def test_a_device_without_friction():
    page = mi.report(MITA.replace(mu_s=0.0, mu_d=0.0), SLOW, only=["Device"])
    assert "Static friction holds 0 N" in page.html


def test_a_device_with_a_charge():
    device = MITA.adding(mi.ChargeDrive())
    drive = mi.Sine(amplitude=1.5 * mi.pull_in_charge(device), frequency=1.0)
    page = mi.report(device, drive, only=["Pull-in and release"])
    assert page.facts == {"pull-in": amount(mi.pull_in_charge(device), "C")}
    plausibility._warn_once.cache_clear()
    with pytest.warns(mi.UnitsWarning, match="amplitude = 30 C, outside the range"):
        mi.report(device, mi.Sine(amplitude=30.0, frequency=1.0), only=["Drive"])


def test_a_default_drive():
    page = mi.report(MITA, only=["Drive", "Motion"], **SHORT)
    assert "No drive was given. Simulation found this sine" in page.html
    drive = mi.walking_drive(MITA)
    assert {f"{drive.amplitude:g} V", f"{drive.frequency:g} Hz"} <= set(Page(page.html).texts["td"])
    assert page.facts["step per cycle"] != "0 m"


@pytest.mark.slow
def test_curves_window_load_and_corners():
    device, drive = MITA, mi.Sine(amplitude="28 V", frequency="108 Hz")
    wanted = ["Step and speed over the voltage", "Step and speed over the frequency",
              "Voltage window", "Load curve", "Corners"]  # fmt: skip
    page = mi.report(device, drive, only=wanted, quick=True, voltages=[26.0, 28.0])
    assert [section.problem for section in page.sections] == [""] * 5
    run = mi.simulate(device, drive, 400, window=(300, 400), initial=mi.kicked_state(device))
    speed, step = (run.statistics[name] for name in ("mean speed", "displacement per period"))
    cells = Page(page.html).texts["td"]
    assert amount(speed, "m/s") in cells  # of the table over the voltage
    assert amount(step, "m") in cells  # the nominal corner
    stiffer = device.replace(k=device.k * (1.0 + 0.03 * 1.959964))
    assert amount(mi.pull_in_voltage(stiffer), "V") in cells  # the corner of a stiff spring
    low, high = page.facts["voltage window"].split(" to ")
    assert float(low.split()[0]) < 28.0 < float(high.split()[0])
    stall = mi.force_curve(device, drive, [0.0], transient=150).stall_force
    assert page.facts["stall force"].split()[0][:3] == amount(stall, "N")[:3]


def test_an_interruption_keeps_the_finished_sections(tmp_path):
    def interrupt(finished):
        if finished == 1:
            raise KeyboardInterrupt

    path = tmp_path / "report.html"
    with pytest.raises(mi.Interrupted, match="after 1 of 3 sections") as caught:
        mi.report(MITA, SLOW, path, only=["Device", "Energy", "Life"], progress=interrupt)
    assert [section.title for section in caught.value.partial.sections] == ["Device"]
    assert "The report was interrupted. Missing: Energy, Life." in path.read_text("utf-8")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"only": ["Speed"]}, "only = 'Speed': must be titles among Device, Pull-in"),
        ({"samples": 0}, "samples = 0"),
        ({"wear": -1.0}, "wear = -1: must be a finite number > 0"),
        ({"depth": "1 V"}, r"depth = '1 V': must be a number \[m\]"),
        ({"path": "."}, "cannot be written"),
    ],
)
def test_bad_arguments(given, message):
    with pytest.raises((mi.InvalidParameter, mi.InvalidFile), match=message):
        mi.report(MITA, SLOW, **given)


@pytest.mark.nightly
def test_a_drive_without_an_amplitude():
    drive = mi.Sampled(times=(0.0, 0.1, 0.2), voltages=(0.0, 60.0, 5.0), period=0.3)
    wanted = ["Operating chart", "Step and speed over the voltage", "Energy"]
    page = mi.report(MITA, drive, only=wanted, **SHORT)
    assert "a waveform with amplitude and omega" in page.sections[0].problem
    assert page.sections[1].problem == "The Sampled drive has no amplitude to vary."
    assert page.facts.keys() == {"energy per cycle"}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("drive", "where"),
    [
        (mi.Square(amplitude=60.0, frequency=400.0), "around the resonance."),
        (mi.Sine(amplitude=60.0, frequency=400.0), "around half the resonance, which the force"),
    ],
)
def test_a_chart_lies_where_the_force_excites_the_block(drive, where):
    (section,) = mi.report(MITA, drive, only=["Operating chart"], quick=True).sections
    assert where in str(section.blocks[0])


@pytest.mark.slow
def test_a_comb_has_a_voltage_of_contact():
    comb = mi.CombDrive(fingers=100, gap="2 um", thickness="20 um", overlap="30 um", sides="right")
    x = [-3e-6, -1e-6, 1e-6, 3e-6]
    spring = mi.TabulatedSpring(positions=x, forces=[MITA.k * each for each in x])
    page = mi.report(MITA.adding(comb, spring), only=["Device", "Pull-in and release", "Drive"])
    assert [section.problem for section in page.sections] == [""] * 3
    assert "No pull-in with CombDrive: its force does not depend on the position." in page.html
    assert "36.68 V" in Page(page.html).texts["td"]
    assert "4 values, -3 µm to 3 µm" in page.html.replace("−", "-")
