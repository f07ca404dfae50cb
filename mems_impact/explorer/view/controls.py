"""Controls of the page: a slider for each parameter, and the selection of what is displayed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bokeh.layouts import column, row
from bokeh.models import Button, CustomJS, Div, PrintfTickFormatter, Select, Slider

from mems_impact.explorer.session import (
    LONGEST,
    PageSetting,
    SliderSpec,
    Subject,
    length_word,
    planes,
)

__all__ = ["Controls"]

STRETCH_WIDTH = "stretch_width"
LENGTHS = 10.0  # least and step of the slider of the length
MAX_PERIODS = 300.0
MOVED = "window.slider_moved = performance.now()"


class Controls:
    """Sliders and choices (``layout``), and the buttons that save files (``files``).

    Parameters
    ----------
    subject : Subject
    dials : tuple of SliderSpec
    setting : PageSetting
        That they begin with.
    changed : callable
        ``changed(change)`` is called with a function from the setting to the one that is wanted.
    save : callable
        ``save(what)`` is called with "device", "picture" or "python".
    """

    def __init__(
        self,
        subject: Subject,
        dials: tuple[SliderSpec, ...],
        setting: PageSetting,
        changed: Callable[[Callable[[PageSetting], PageSetting]], None],
        save: Callable[[str], None],
    ) -> None:
        self._changed = changed
        by_name = {dial.name: dial for dial in dials}
        parts: list[Any] = []
        for heading, names in subject.groups.items():
            parts.append(_heading(heading))
            parts += [self._slider(by_name[name], setting.values[name]) for name in names]
        system = subject.system
        planar = list(planes(system))
        shown = [
            self._length(setting, length_word(system)),
            self._choice("start", "start", list(subject.starts), setting.start),
            self._choice("x", "phase portrait, x axis", planar, setting.x),
            self._choice("y", "phase portrait, y axis", planar, setting.y),
        ]
        if system.parameters:
            known = list(system.parameters)
            shown.append(self._choice("parameter", "diagram parameter", known, setting.parameter))
        files = {"device": "Save device", "picture": "Save picture", "python": "Save Python"}
        if "device" not in subject.groups:
            del files["device"]
        buttons = [self._button(save, what, label) for what, label in files.items()]
        self.files = row(*buttons, sizing_mode=STRETCH_WIDTH)
        self.layout = column(*parts, _heading("shown"), *shown, sizing_mode=STRETCH_WIDTH)

    def _slider(self, dial: SliderSpec, value: float) -> Slider:
        low, high = min(dial.low, value), max(dial.high, value)
        made = Slider(
            title=dial.label, value=value / dial.factor, start=low / dial.factor,
            end=high / dial.factor, step=dial.step / dial.factor, sizing_mode=STRETCH_WIDTH,
            format=PrintfTickFormatter(format="%.5g"), name=f"slider {dial.name}",
        )  # fmt: skip

        def moved(_attr: str, _old: float, new: float) -> None:
            self._changed(lambda setting: setting.with_value(dial.name, new * dial.factor))

        made.on_change("value", moved)
        made.js_on_change("value", CustomJS(code=MOVED))
        return made

    def _length(self, setting: PageSetting, word: str) -> Slider:
        made = Slider(
            title=word, value=setting.length, start=min(LENGTHS, setting.length),
            end=max(MAX_PERIODS, min(setting.length, LONGEST)), step=LENGTHS,
            sizing_mode=STRETCH_WIDTH,
            name="slider length",
        )  # fmt: skip

        def moved(_attr: str, _old: float, new: float) -> None:
            self._changed(lambda setting: replace(setting, length=float(new)))

        made.on_change("value", moved)
        return made

    def _choice(self, field: str, title: str, options: list[str], value: str) -> Select:
        made = Select(
            title=title,
            options=options,
            value=value,
            sizing_mode=STRETCH_WIDTH,
            name=f"choice {field}",
        )

        def chosen(_attr: str, _old: str, new: str) -> None:
            if new in options:  # the page may say anything
                change: dict[str, Any] = {field: new}
                self._changed(lambda setting: replace(setting, **change))

        made.on_change("value", chosen)
        return made

    def _button(self, save: Callable[[str], None], what: str, label: str) -> Button:
        made = Button(label=label, sizing_mode=STRETCH_WIDTH, name=f"save {what}")
        made.on_click(lambda: save(what))
        return made


def _heading(text: str) -> Div:
    return Div(text=text, render_as_text=True, css_classes=["heading"], sizing_mode=STRETCH_WIDTH,
               styles={"font-weight": "600", "margin-top": "8px"})  # fmt: skip
