"""The page in a real browser, moved by its sliders."""

import base64
import json
import subprocess
import sys
from urllib.parse import parse_qs, urlsplit

import pytest

import mems_impact as mi
from tests.explorer.conftest import LONG

pytestmark = pytest.mark.slow

FIND = "const found = [...Bokeh.documents[0].all_models].find((m) => m.name === arguments[0]);"


class Page:
    """What a test sees of the page, and does to it."""

    def __init__(self, browser, address):
        self.browser = browser
        browser.get(address)
        self.wait(lambda: browser.execute_script("return window.Bokeh?.documents.length > 0"))

    def wait(self, condition):
        from selenium.webdriver.support.ui import WebDriverWait

        return WebDriverWait(self.browser, LONG, 0.05).until(lambda _: condition())

    def get(self, name, what):
        return self.browser.execute_script(f"{FIND} return found?.{what}", name)

    def set(self, name, value):
        self.browser.execute_script(f"{FIND} found.value = arguments[1]", name, value)

    def click(self, name):
        button = self.browser.execute_script(
            f"{FIND} return Bokeh.index.find_one(found).button_el", name
        )
        button.click()  # as a user does: browsers save nothing that nobody has asked for

    def text(self, name):
        return self.get(name, "text") or ""

    @property
    def query(self):
        return parse_qs(urlsplit(self.browser.current_url).query)

    def curve(self):
        """Return what is drawn of the first state over time."""
        return self.browser.execute_script(
            """const column = [...Bokeh.documents[0].all_models].find((m) => m.name === "series");
            const line = column.children[0].renderers.find((r) => r.glyph.type === "Line");
            return Array.from(line.data_source.data.value).filter(Number.isFinite)"""
        )

    def saved(self, name):
        """Return the path of a file that the page has saved."""
        path = self.browser.folder / name
        self.wait(path.exists)
        return path


@pytest.fixture(scope="module")
def zhao(served):
    return served("zhao2004")


@pytest.fixture(scope="module")
def opened(zhao, browser):
    return Page(browser, zhao.address)


@pytest.fixture
def page(opened):
    """The page with the numbers that it begins with."""
    for name, value in {"amplitude": 0.24, "d": 1.0, "delta": 0.5, "e": 0.8}.items():
        opened.set(f"slider {name}", value)
        opened.wait(lambda name=name, value=value: opened.query.get(name) == [str(value)])
    return opened


def test_a_slider_moves_the_picture_and_the_address(page):
    before = page.curve()
    assert max(before) == pytest.approx(0.5)  # at the stopper
    page.set("slider amplitude", 0.1)
    page.wait(lambda: page.query.get("amplitude") == ["0.1"])
    after = page.curve()
    assert max(after) < 0.4
    # The link shows the same to who follows it.
    Page(page.browser, page.browser.current_url)
    page.wait(lambda: page.curve() == after)
    assert page.get("slider amplitude", "value") == 0.1


def test_diagram_and_multipliers_follow(page):
    def crossings():
        return page.browser.execute_script(
            FIND
            + """const dots = found.renderers.filter((r) => r.glyph?.type === "Scatter");
            return dots.map((r) => r.data_source.get_length() ?? 0)""",
            "bifurcation",
        )

    page.wait(lambda: min(crossings()) > 0 and max(crossings()) > 300)  # up, down, here; fine
    told = (
        "return [...Bokeh.documents[0].all_models].find((m) => m.name === 'multipliers').title.text"
    )
    page.wait(lambda: page.browser.execute_script(told) == "stable, 1 forcing period, 1 impact")
    page.set("slider amplitude", 0.1)
    page.wait(lambda: page.browser.execute_script(told) == "stable, 1 forcing period, no impacts")


def test_device_and_points_move(page):
    places = "return [...document.querySelectorAll('.point')].map((p) => p.style.transform)"
    page.wait(lambda: len(page.browser.execute_script(places)) == 3)
    before = page.browser.execute_script(places)
    page.wait(lambda: page.browser.execute_script(places) != before)


def test_what_is_out_of_range_is_told_and_the_picture_stays(page):
    page.set("slider delta", 0.9)
    page.wait(lambda: page.query.get("delta") == ["0.9"])
    before = page.curve()
    page.set("slider d", 0.6)
    page.wait(lambda: page.text("message"))
    assert page.text("message") == "delta = 0.9: must be between 0 and d = 0.6 (exclusive)"
    assert page.curve() == before
    page.set("slider d", 1.2)
    page.wait(lambda: not page.text("message"))


def test_a_bad_address_is_told_and_runs_nothing(zhao, browser):
    page = Page(browser, f"{zhao.address}?amplitude=<b>much</b>&show.x=__class__")
    page.wait(lambda: "100 periods" in page.text("status"))
    told = page.text("message")
    assert told == "The address: amplitude = '<b>much</b>': must be a finite number"
    assert page.get("slider amplitude", "value") == 0.24
    assert "<b>" in browser.execute_script(
        f"{FIND} return Bokeh.index.find_one(found).el.shadowRoot.textContent", "message"
    )


def test_files_are_saved(page, tmp_path):
    page.set("slider e", 0.7)
    page.wait(lambda: page.query.get("e") == ["0.7"])
    page.click("save device")
    device = page.saved("zhao2004.toml")
    page.click("save picture")
    picture = page.saved("zhao2004.png")
    # A browser asks its user whether to keep a program: what it is handed, then.
    page.click("save python")
    page.wait(lambda: '"zhao2004.py"' in page.text("parcel"))
    script = tmp_path / "zhao2004.py"
    script.write_bytes(base64.b64decode(json.loads(page.text("parcel"))["content"]))
    assert mi.load_actuator(device) == mi.load_actuator("zhao2004").replace(e=0.7)
    assert mi.load_drive(device) == mi.Sine(amplitude=0.24, omega=0.5)
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run.png").exists()
    assert (tmp_path / "sweep.png").exists()


def test_nothing_on_the_page_overlaps_or_is_cut_off(page):
    for width in (1280, 800):
        page.browser.set_window_size(width, 1000)
        page.wait(lambda width=width: page.browser.execute_script("return innerWidth") <= width)
        boxes = page.browser.execute_script(
            """return [...document.querySelectorAll("aside, section")].map((e) => {
              const b = e.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom] })"""
        )
        assert len(boxes) == 7
        for i, (left, top, right, bottom) in enumerate(boxes):
            assert left >= 0
            assert right <= width
            for other in boxes[:i]:
                apart = left >= other[2] - 1 or right <= other[0] + 1
                assert apart or top >= other[3] - 1 or bottom <= other[1] + 1
    page.browser.set_window_size(1280, 1000)


def test_the_browser_has_nothing_to_complain_of(page):
    complaints = [each for each in page.browser.get_log("browser") if each["level"] == "SEVERE"]
    assert [each for each in complaints if "favicon" not in each["message"]] == []
