"""One page: passes user actions to the computing threads and draws their results."""

from __future__ import annotations

import base64
import json
import sys
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import cache, partial
from importlib.resources import files
from typing import Any

from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.models import CustomJS, Div

from mems_impact._util.progress import Watch
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.errors import InvalidParameter, MemsImpactError
from mems_impact.explorer.background import LatestOnlyWorker
from mems_impact.explorer.export import device_file, python_of, run_picture
from mems_impact.explorer.session import (
    PageSetting,
    SliderSpec,
    Subject,
    address_of,
    first_setting,
    length_name,
    setting_at,
)
from mems_impact.explorer.snapshot import (
    COARSE,
    DiagramRequest,
    DiagramSnapshot,
    Floquet,
    RunSnapshot,
    diagram_of,
    floquet_of,
    series_states,
    take_snapshot,
    with_special_points,
)
from mems_impact.explorer.view.controls import Controls
from mems_impact.explorer.view.panels import (
    AnimationPanels,
    BifurcationPanel,
    CyclesPanel,
    DevicePanel,
    HeadlinePanel,
    MultiplierPanel,
    Panel,
    PortraitPanel,
    TimeSeriesPanel,
)

FIRST_STATUS = "computing; a new system is compiled first, about 7 s, once"
STALE_RUN_SECONDS = 0.5  # s for which an outdated run continues
ORBIT_DELAY, DIAGRAM_DELAY = 0.1, 0.25  # s without changes before the computation


class Page:
    """A page of the explorer, for one browser session with its Bokeh document.

    `complete` has the complete diagrams of all pages, which are shown again.
    """

    def __init__(
        self,
        document: Document,
        subject: Subject,
        specs: tuple[SliderSpec, ...],
        query: Mapping[str, Iterable[str]],
        complete: deque[DiagramSnapshot],
    ) -> None:
        self.document, self.subject, self._complete = document, subject, complete
        self.specs = {spec.name: spec for spec in specs}
        self.picture: RunSnapshot | None = None
        self._requested_diagram: Any = None
        self._saved = 0
        refused = ""
        try:
            self.setting = setting_at(subject, query)
        except InvalidParameter as error:
            self.setting, refused = first_setting(subject), f"The address: {error}"
        self._draw_first(tuple(specs))
        self.message.text = refused
        self.pictures = self._thread(
            partial(take_snapshot, subject), self._show, patience=STALE_RUN_SECONDS
        )
        self.orbits = self._thread(floquet_of, self._show_orbit, delay=ORBIT_DELAY)
        self.diagrams = self._thread(self._diagram, self._show_diagram, delay=DIAGRAM_DELAY)
        self.drawings = self._thread(_drawing, lambda _, drawing: self._send("png", drawing))
        self._refused = bool(refused)
        self.pictures.request(self.setting)

    def stop(self) -> None:
        """End the threads."""
        for thread in (self.pictures, self.orbits, self.diagrams, self.drawings):
            thread.stop()

    def change(self, change: Callable[[PageSetting], PageSetting]) -> None:
        """Compute the picture of a changed setting; say why a text is no value."""
        try:
            self.setting = change(self.setting)
        except InvalidParameter as error:
            self.message.text, self._refused = str(error), True
        else:
            self._refused = False
        self.controls.show(self.setting)
        self.pictures.request(self.setting)

    def reset(self) -> None:
        """Compute the picture with which the command opens."""
        self.change(lambda _: first_setting(self.subject))

    def save(self, kind: str) -> None:
        """Save a file of the shown run in the browser."""
        picture = self.picture
        if picture is None:
            return
        if kind == "picture":
            self.drawings.request(picture)
        elif kind in ("python", "copy"):
            spec = self.specs.get(picture.setting.parameter)
            script = python_of(self.subject, picture.setting, spec)
            self._send("py", script.encode(), copied=kind == "copy")
        elif isinstance(picture.system, ActuatorSystem):
            self._send("toml", device_file(self.subject, picture.system).encode())

    def _draw_first(self, specs: tuple[SliderSpec, ...]) -> None:
        subject, setting = self.subject, self.setting
        actuator = isinstance(subject.system, ActuatorSystem)
        self.multipliers = MultiplierPanel()
        self.bifurcation = BifurcationPanel(self.specs, self._select) if self.specs else None
        series = TimeSeriesPanel(len(series_states(subject.system, setting)))
        portrait, device = PortraitPanel(), DevicePanel() if actuator else None
        animation = AnimationPanels(series, portrait, device)
        self.controls = Controls(subject, specs, setting, self.change, self.reset, self.save)
        panels: dict[str, Panel | None] = {
            "headlines": HeadlinePanel(),
            "device": device,
            "series": series,
            "portrait": portrait,
            "multipliers": self.multipliers,
            "bifurcation": self.bifurcation,
            "cycles": CyclesPanel(),
            "frames": animation,  # after those in which it moves something
        }
        self.panels = {name: panel for name, panel in panels.items() if panel is not None}
        self.title = _text(subject.title, **{"font-size": "20px", "font-weight": "600"})
        self.status = _text(FIRST_STATUS, color="#555")
        self.message = _text("", color="#a33b00")
        self.address, self.parcel = Div(visible=False), Div(visible=False)
        script = CustomJS(args={"address": self.address}, code=_asset("address.js"))
        self.address.js_on_change("text", script)
        # The first picture may be complete before the page is ready.
        self.document.js_on_event(DocumentReady, script)
        self.parcel.js_on_change("text", CustomJS(code=_asset("download.js")))
        roots = {
            "title": self.title,
            "status": self.status,
            "message": self.message,
            "controls": self.controls.layout,
            "buttons": self.controls.buttons,
            "address": self.address,
            "parcel": self.parcel,
            **{name: panel.layout for name, panel in self.panels.items()},
        }
        for name, root in roots.items():
            root.name = name
            self.document.add_root(root)
        play = CustomJS(args=animation.browser_arguments, code=_asset("play.js"))
        self.document.js_on_event(DocumentReady, play)
        self.document.title = f"{subject.title} – mems-impact"
        self.document.template = _asset("page.html")
        self.document.template_variables["style"] = _asset("style.css")
        self.document.template_variables["panels"] = tuple(
            (name, caption) for name, caption in PANEL_CAPTIONS.items() if name in self.panels
        )
        self.document.on_session_destroyed(lambda _context: self.stop())

    def _thread(
        self, compute: Any, show: Callable[[Any, Any], None], **waits: float
    ) -> LatestOnlyWorker[Any]:
        """Return a thread whose results are shown by `show`, called by the server's thread."""

        def deliver(request: Any, result: Any, error: Exception | None) -> None:
            if error is not None:
                self.document.add_next_tick_callback(lambda: self._fail(request, error))
            else:
                self.document.add_next_tick_callback(lambda: show(request, result))

        return LatestOnlyWorker(compute, deliver, **waits)

    def _fail(self, request: Any, error: Exception) -> None:
        """Show an error in one sentence; the last valid picture stays."""
        if isinstance(error, MemsImpactError):
            text = str(error)
        else:
            print("".join(traceback.format_exception(error)), file=sys.stderr)  # noqa: T201
            text = f"{type(error).__name__}: {error} (a bug; see the traceback in the terminal)"
        if isinstance(request, DiagramRequest | DiagramSnapshot):
            if self.bifurcation is not None:
                self.bifurcation.show_message(text, stale=True)
            return
        self.message.text = text

    def _show(self, setting: PageSetting, picture: RunSnapshot) -> None:
        """Draw a run."""
        self.picture = picture
        self.document.hold("combine")
        for panel in self.panels.values():
            panel.show(picture)
        length = f"{setting.length:g} {length_name(picture.system)}"
        if not picture.system.forced:
            length = f"{length_name(picture.system)} {setting.length:g}"
        self.status.text = (
            f"{length}, {len(picture.run.events)} events, {1e3 * picture.seconds:.0f} ms"
        )
        if not self._refused:
            self.message.text = "; ".join(picture.warnings)
        self.address.text = address_of(self.subject, setting)
        self.document.unhold()
        self.orbits.request(picture)
        request = DiagramRequest(setting=setting, points=COARSE)
        if self.bifurcation is not None and self._requested_diagram != request.key:
            self._requested_diagram = request.key
            self.bifurcation.show_message("computing …", stale=True)
            known = (each for each in self._complete if each.request.setting == setting)
            self.diagrams.request(next(known, request))

    def _show_orbit(self, picture: RunSnapshot, floquet: Floquet) -> None:
        if picture is self.picture:
            self.multipliers.show_orbit(floquet)

    def _select(self, name: str, value: float) -> None:
        self.change(lambda setting: setting.with_value(name, value))

    def _diagram(self, request: DiagramRequest | DiagramSnapshot, watch: Watch) -> DiagramSnapshot:
        """Compute a diagram, or its special points."""
        if isinstance(request, DiagramSnapshot):
            known = request.continued
            return request if known else with_special_points(self.subject, request, watch)
        return diagram_of(self.subject, request, self.specs[request.setting.parameter], watch)

    def _show_diagram(self, _: DiagramRequest | DiagramSnapshot, diagram: DiagramSnapshot) -> None:
        request = diagram.request
        if self.bifurcation is None or self.picture is None:
            return
        if request.key != self._requested_diagram:
            return
        self.bifurcation.show_diagram(diagram, self.picture)
        if request.points == COARSE:
            self.diagrams.request(request.finer())
        elif not diagram.continued:
            self.diagrams.request(diagram)
        elif not any(each is diagram for each in self._complete):
            self._complete.append(diagram)

    def _send(self, ending: str, content: bytes, *, copied: bool = False) -> None:
        """Let the browser save a file, or copy it to the clipboard."""
        name = "".join(letter if letter.isalnum() else "_" for letter in self.subject.title)
        self._saved += 1  # a change, even for the same file
        message = {"name": f"{name}.{ending}", "number": self._saved, "copied": copied}
        self.parcel.text = json.dumps(message | {"content": base64.b64encode(content).decode()})


def _drawing(picture: RunSnapshot, watch: Watch) -> bytes:
    return run_picture(picture.run)


PANEL_CAPTIONS = {
    "device": "Device in motion",
    "series": "Motion over time",
    "portrait": "Phase portrait and section",
    "multipliers": "Multipliers of the orbit",
    "bifurcation": "Bifurcation diagram, up and down",
    "cycles": "Cycle by cycle",
}
"""The panels in their order, and the caption above each."""


def _text(text: str, **styles: str) -> Div:
    # As text, since a message may quote the address.
    return Div(text=text, render_as_text=True, sizing_mode="stretch_width", styles=styles)


@cache
def _asset(name: str) -> str:
    return (files(__package__) / name).read_text("utf-8")
