"""The page in a real browser, moved by its sliders."""

import base64
import json
import subprocess
import sys
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.explorer.session import address_of, first_setting, setting_at
from mems_impact.explorer.snapshot import series_states, take_snapshot
from tests.explorer.conftest import LONG
from tests.explorer.subjects import DRIVE, own
from tests.explorer.subjects import zhao as zhao2004

pytestmark = pytest.mark.slow

START = address_of(zhao2004(), first_setting(zhao2004()))
COMPUTING = "renderers.some((r) => r.muted)"
FIND = "const found = [...Bokeh.documents[0].all_models].find((m) => m.name === arguments[0]);"


SOURCES = """const found = {};
for (const model of Bokeh.documents[0].all_models) {
  if (model.type !== "ColumnDataSource" || !model.name || model.name.startsWith("moving")) continue;
  found[model.name] = Object.fromEntries(Object.entries(model.data).map(
    ([name, values]) => [name, JSON.stringify(Array.from(values))]));
}
return found"""

POINTS = """const models = [...Bokeh.documents[0].all_models];
const root = (name) => models.find((m) => m.name === name);
const figures = [...root("series").children, root("portrait")];
const dots = [...document.querySelectorAll(".point")];
return dots.map((dot, k) => {
  if (dot.hidden) return null;
  const view = Bokeh.index.find_one(figures[k]);
  const box = view.el.getBoundingClientRect();
  const [, left, top] = dot.style.transform.match(/translate\\((.*)px, (.*)px\\)/).map(Number);
  const at = [left - box.left - scrollX, top - box.top - scrollY];
  const line = figures[k].renderers.find((r) => r.glyph?.type === "Line").data_source.data;
  const [x, y] = "value" in line ? [line.t, line.value] : [line.x, line.y];
  const xs = Array.from(x, (each) => view.frame.x_scale.compute(each) - at[0]);
  const ys = Array.from(y, (each) => view.frame.y_scale.compute(each) - at[1]);
  let least = Infinity;
  for (let i = 0; i + 1 < xs.length; i++) {
    const dx = xs[i + 1] - xs[i], dy = ys[i + 1] - ys[i];
    const part = dx || dy ? -(xs[i] * dx + ys[i] * dy) / (dx * dx + dy * dy) : 0;
    const near = Math.min(1, Math.max(0, part));
    const away = Math.hypot(xs[i] + near * dx, ys[i] + near * dy);
    if (away < least) least = away;
  }
  return least;
})"""


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

    def resize(self, width):
        """Show the page on a screen of that width, below 600 on a phone."""
        screen = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": width < 600}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
        self.wait(lambda: self.browser.execute_script("return innerWidth") == width)

    def tap(self, name, x, y):
        """Click a figure where its axes have these values."""
        from selenium.webdriver import ActionChains

        offset = self.browser.execute_script(
            f"""{FIND} const view = Bokeh.index.find_one(found);
            view.el.scrollIntoView({{block: "center"}});
            const box = view.el.getBoundingClientRect();
            return [view.frame.x_scale.compute(arguments[1]) - box.width / 2,
              view.frame.y_scale.compute(arguments[2]) - box.height / 2]""",
            name, x, y,
        )  # fmt: skip
        element = self.browser.execute_script(f"{FIND} return Bokeh.index.find_one(found).el", name)
        chain = ActionChains(self.browser)
        chain.move_to_element_with_offset(element, *map(round, offset)).click().perform()

    def points(self):
        """Return how far, in pixels, each moving point lies from the curves of its figure."""
        return self.browser.execute_script(POINTS)

    def sources(self):
        """Return the columns of all sources of the page but those that the animation writes."""
        return self.browser.execute_script(SOURCES)

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
    options = (f"--{name}={value}" for name, value in DRIVE.items())
    return served("zhao2004", *options)


@pytest.fixture(scope="module")
def opened(zhao, browser):
    return Page(browser, zhao.address)


@pytest.fixture
def page(opened):
    """The page with the numbers that it begins with."""
    opened.click("reset")
    opened.wait(lambda: opened.text("address") == START and opened.query == parse_qs(START))
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


def settled_sources(page):
    """Return the sources of a page when its orbit and its diagram are there."""
    page.wait(lambda: page.get("multipliers", "title.text") != "searching for the orbit …")
    page.wait(
        lambda: page.get("current", "data.x.length") and not page.get("bifurcation", COMPUTING)
    )
    return page.sources()


def shown_text(page, name):
    return page.browser.execute_script(
        f"{FIND} return Bokeh.index.find_one(found).el.shadowRoot.textContent", name
    )


def assert_shows_its_run(page, subject):
    """Assert that all panels show the run of the address, as a page does that is opened there."""
    page.wait(lambda: None not in page.points() and max(page.points()) < 1.0)
    here, address = settled_sources(page), page.browser.current_url
    picture = take_snapshot(subject, setting_at(subject, page.query))
    first, setting = series_states(picture.system, picture.setting)[0], picture.setting
    for source, column, name in (("series 0", "value", first), ("portrait", "y", setting.y)):
        values = np.array(json.loads(here[source][column]), dtype=float)
        np.testing.assert_array_equal(values, picture.motion.curve[name])
    page.browser.switch_to.new_window("tab")
    there = settled_sources(Page(page.browser, address))
    page.browser.close()
    page.browser.switch_to.window(page.browser.window_handles[0])
    assert here.keys() == there.keys()
    assert {"frames", "hits", "section", "cycles", "counts", "multipliers"} <= here.keys()
    # The diagram may be coarse still.
    later = {"up", "down", "special points"}
    assert {name for name in here if here[name] != there[name]} <= later


def test_every_panel_shows_the_run_of_the_sliders(page):
    for name, value in (("omega", 0.45), ("delta", 0.3)):
        page.set(f"slider {name}", value)
        page.wait(lambda name=name, value=value: page.query.get(name) == [str(value)])
        assert_shows_its_run(page, zhao2004())


def test_number_fields_and_sliders_show_the_same(page):
    page.set("field amplitude", "0.61")  # beyond the slider
    page.wait(lambda: page.query["amplitude"] == ["0.61"])
    assert page.get("slider amplitude", "value") == 0.61
    assert page.get("slider amplitude", "end") >= 0.61
    page.set("slider amplitude", 0.2)
    page.wait(lambda: page.get("field amplitude", "value") == "0.2")
    page.set("field length", "1e9")
    page.wait(lambda: page.query["show.periods"] == ["1000"])
    page.set("choice start", "rest")
    page.click("reset")
    page.wait(lambda: page.query == parse_qs(START))
    assert page.get("field amplitude", "value") == "0.24"
    assert (page.get("slider length", "value"), page.get("field length", "value")) == (100, "100")
    assert page.get("choice start", "value") == "kicked"


def test_headlines_sum_up_the_run(page):
    shown = (
        "speed 5.835e-05",
        "step 0.0003666",
        "impact speed 0.1594",
        "pull-in voltage 0.3849",
    )
    page.wait(lambda: all(each in shown_text(page, "headlines") for each in shown))
    page.set("slider amplitude", 0.1)
    page.wait(lambda: "impact speed –" in shown_text(page, "headlines"))


def test_a_click_on_the_diagram_sets_its_parameter(page):
    settled_sources(page)
    page.tap("bifurcation", 0.36, 0.35)
    page.wait(lambda: float(page.query["amplitude"][0]) == pytest.approx(0.36, abs=0.002))
    assert page.get("slider amplitude", "value") == float(page.query["amplitude"][0])
    assert_shows_its_run(page, zhao2004())


def test_a_click_on_a_special_point_sets_its_value(page):
    page.wait(lambda: (page.get("special points", "data.label") or []) == ["CF", "G"])
    value = page.get("special points", "data.x[0]")
    page.tap("bifurcation", value + 0.002, 0.464)
    page.wait(lambda: page.query["amplitude"] == [repr(value)])


def test_the_script_is_copied(page):
    page.browser.execute_cdp_cmd(
        "Browser.grantPermissions",
        {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]},
    )
    page.click("save copy")
    page.wait(lambda: '"copied": true' in page.text("parcel"))
    script = base64.b64decode(json.loads(page.text("parcel"))["content"]).decode()
    read = "const done = arguments[0]; navigator.clipboard.readText().then(done, done)"
    page.wait(lambda: page.browser.execute_async_script(read) == script)
    assert "mi.simulate(system, periods=100.0" in script


def test_device_and_points_move(page):
    places = "return [...document.querySelectorAll('.point')].map((p) => p.style.transform)"
    page.wait(lambda: len(page.browser.execute_script(places)) == 3)
    before = page.browser.execute_script(places)
    for value in ("no-preference", "reduce"):
        motion = {"features": [{"name": "prefers-reduced-motion", "value": value}]}
        page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", motion)
        if value == "no-preference":
            page.wait(lambda: page.browser.execute_script(places) != before)


def test_what_is_out_of_range_is_reported_and_the_picture_stays(page):
    page.set("slider delta", 0.9)
    page.wait(lambda: page.query.get("delta") == ["0.9"])
    before = page.curve()
    page.set("slider d", 0.6)
    page.wait(lambda: page.text("message"))
    assert page.text("message") == "delta = 0.9: must be < 0.6, the gap d"
    assert page.curve() == before
    page.set("slider d", 1.2)
    page.wait(lambda: not page.text("message"))


def test_a_bad_address_is_reported_and_runs_nothing(zhao, browser):
    page = Page(browser, f"{zhao.address}?amplitude=<b>much</b>&show.x=__class__")
    page.wait(lambda: "100 periods" in page.text("status"))
    told = page.text("message")
    assert told == "The address: amplitude = '<b>much</b>': must be a finite number"
    assert page.get("slider amplitude", "value") == 0.24
    assert "<b>" in shown_text(page, "message")


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
    assert mi.load(device).drive == mi.Sine(amplitude=0.24, omega=0.5)
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run.png").exists()
    assert (tmp_path / "sweep.png").exists()


def test_nothing_on_the_page_overlaps_or_is_cut_off(page):
    for width in (1280, 800, 390, 320):
        page.resize(width)
        boxes = page.browser.execute_script(
            """return [...document.querySelectorAll("aside, section")].map((e) => {
              const b = e.getBoundingClientRect(); return [b.left, b.top, b.right, b.bottom] })"""
        )
        assert len(boxes) == 7
        if width < 600:
            boxes = boxes[1:]  # the controls lie above the panels, which scroll below them
        assert page.browser.execute_script("return document.documentElement.scrollWidth") <= width
        for i, (left, top, right, bottom) in enumerate(boxes):
            assert left >= 0
            assert right <= width
            for other in boxes[:i]:
                apart = left >= other[2] - 1 or right <= other[0] + 1
                assert apart or top >= other[3] - 1 or bottom <= other[1] + 1
    page.resize(1280)


def test_the_caption_of_the_device_fits_a_phone(page):
    page.wait(lambda: page.get("moving caption", "data.text[0]").strip())
    widths = page.browser.execute_script(
        """const pen = document.createElement("canvas").getContext("2d")
        pen.font = "13px Helvetica, Arial, sans-serif"
        return arguments[0].split("\\n").map((line) => pen.measureText(line).width)""",
        page.get("moving caption", "data.text[0]"),
    )
    assert max(widths) < 280.0  # on a screen of 320 pixels


def test_the_unit_circle_is_round_at_every_width(page):
    def diameters():
        return page.browser.execute_script(
            f"""{FIND} const view = Bokeh.index.find_one(found);
            const [x, y] = [view.frame.x_scale, view.frame.y_scale];
            return [x.compute(1) - x.compute(-1), y.compute(-1) - y.compute(1)]""",
            "multipliers",
        )

    for width in (1280, 800, 390):
        page.resize(width)
        page.wait(lambda: diameters()[0] == pytest.approx(diameters()[1], rel=0.01))
        assert diameters()[0] > 100.0
    page.resize(1280)


def test_the_browser_has_nothing_to_complain_of(page):
    complaints = [each for each in page.browser.get_log("browser") if each["level"] == "SEVERE"]
    assert [each for each in complaints if "favicon" not in each["message"]] == []


@pytest.mark.nightly
def test_the_page_of_another_system_shows_the_run_of_its_sliders(served, browser):
    page = Page(browser, served("tests.analysis.systems:oscillator").address)
    page.wait(lambda: "impacts per period" in shown_text(page, "headlines"))
    assert page.get("device", "name") is None
    for name, value in (("A", 0.4), ("omega", 0.9)):
        page.set(f"slider {name}", value)
        page.wait(lambda name=name, value=value: page.query.get(name) == [str(value)])
    assert_shows_its_run(page, own())
    page.tap("bifurcation", 0.7, 0.0)
    page.wait(lambda: float(page.query["A"][0]) == pytest.approx(0.7, abs=0.01))
    page.click("reset")
    page.wait(lambda: page.query["A"] == ["0.6"])
    assert page.query["omega"] == ["0.8"]
