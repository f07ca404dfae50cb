"""Controls of the page: a slider for each parameter, and the selection of the display."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from bokeh.layouts import column, row
from bokeh.models import (
    Button,
    CustomJS,
    Div,
    Select,
    Slider,
    TextInput,
)

from mems_impact.errors import InvalidParameter
from mems_impact.explorer.session import (
    MAX_LENGTH,
    MIN_LENGTH,
    PageSetting,
    SliderSpec,
    Subject,
    length_name,
    plane_axes,
)

STRETCH_WIDTH = "stretch_width"
LENGTHS = 10.0  # least and step of the slider of the length
MAX_PERIODS = 300.0
MOVED = "window.slider_moved = performance.now()"
FIELD_WIDTH_PX = 80
FIELD_STYLE = ".bk-input { height: 24px; min-height: 0; padding: 0 8px; }"
FIELD_DIGITS = "%.6g"
SAME_RTOL = 1e-12  # of a value that a slider has and is to have
SAVES = {
    "device": "Save device",
    "picture": "Save picture",
    "python": "Save script",
    "copy": "Copy script",
}
"""Captions of the buttons that export, by format."""


class Controls:
    """Sliders, number fields and choices (``layout``), and the buttons (``buttons``).

    ``changed(change)`` is called with a function from the old setting to the new setting,
    ``save(what)`` with a key of `SAVES`.
    """

    def __init__(
        self,
        subject: Subject,
        specs: tuple[SliderSpec, ...],
        setting: PageSetting,
        changed: Callable[[Callable[[PageSetting], PageSetting]], None],
        reset: Callable[[], None],
        save: Callable[[str], None],
    ) -> None:
        self._changed = changed
        self._updates: list[Callable[[PageSetting], None]] = []
        self._updating = False
        self._system = system = subject.system
        by_name = {spec.name: spec for spec in specs}
        widgets: list[Any] = []
        for heading, names in subject.groups.items():
            widgets.append(_heading(heading))
            widgets += [self._parameter(by_name[name], setting) for name in names]
        planar = list(plane_axes(system))
        selectors = [
            self._length(setting, length_name(system)),
            self._choice("start", "start", list(subject.starts), setting),
            self._choice("x", "phase portrait, x axis", planar, setting),
            self._choice("y", "phase portrait, y axis", planar, setting),
        ]
        if system.parameters:
            parameters = list(system.parameters)
            selectors.append(self._choice("parameter", "diagram parameter", parameters, setting))
        exports = dict(SAVES)
        if "device" not in subject.groups:
            del exports["device"]
        buttons = [_button("reset", "Reset", reset)]
        buttons += [
            _button(f"save {kind}", label, partial(save, kind)) for kind, label in exports.items()
        ]
        self.buttons = row(*buttons, sizing_mode=STRETCH_WIDTH, styles={"flex-wrap": "wrap"})
        self.layout = column(*widgets, _heading("shown"), *selectors, sizing_mode=STRETCH_WIDTH)

    def show(self, setting: PageSetting) -> None:
        """Show the values of another setting."""
        self._updating = True
        for update in self._updates:
            update(setting)
        self._updating = False

    def _change(self, change: Callable[[PageSetting], PageSetting]) -> None:
        if not self._updating:
            self._changed(change)

    def _parameter(self, spec: SliderSpec, setting: PageSetting) -> Any:
        def read(setting: PageSetting) -> float:
            return spec.displayed(setting.values[spec.name])

        def changed(setting: PageSetting, new: float | str) -> PageSetting:
            value = self._system.units.parse(spec.name, new) if isinstance(new, str) else None
            if isinstance(value, str):
                raise InvalidParameter(spec.name, new, "a number")
            return setting.with_value(spec.name, spec.value(float(new)) if value is None else value)

        bounds = (each / spec.factor for each in (spec.low, spec.high, spec.step))
        return self._number(spec.name, spec.title, setting, read, changed, *bounds)

    def _length(self, setting: PageSetting, word: str) -> Any:
        def changed(setting: PageSetting, new: float | str) -> PageSetting:
            if isinstance(new, str):
                raise InvalidParameter(word, new, "a number")
            return replace(setting, length=min(max(new, MIN_LENGTH), MAX_LENGTH))

        return self._number(
            "length", word, setting, lambda setting: setting.length, changed,
            LENGTHS, MAX_PERIODS, LENGTHS,
        )  # fmt: skip

    def _number(
        self,
        name: str,
        title: str,
        setting: PageSetting,
        read: Callable[[PageSetting], float],
        changed: Callable[[PageSetting, float | str], PageSetting],
        low: float,
        high: float,
        step: float,
    ) -> Any:
        """Return a slider and a field of the same value; the field goes beyond the slider.

        `read` returns the value of a setting, `changed` the setting with another value, or with a
        text that is no number, such as one with a unit.
        """
        value = read(setting)
        slider = Slider(
            value=value, start=min(low, value), end=max(high, value), step=step, title=None,
            sizing_mode=STRETCH_WIDTH, align="center", margin=(0, 5, 0, 5), name=f"slider {name}",
        )  # fmt: skip
        field = TextInput(
            value=FIELD_DIGITS % value, width=FIELD_WIDTH_PX, margin=(0, 5, 0, 5),
            stylesheets=[FIELD_STYLE], name=f"field {name}",
        )  # fmt: skip

        def moved(_attr: str, _old: Any, new: float | None) -> None:
            if new is not None and math.isfinite(new):
                self._change(lambda setting: changed(setting, float(new)))

        def typed(_attr: str, _old: Any, new: str) -> None:
            try:
                moved("", None, float(new))
            except ValueError:
                self._change(lambda setting: changed(setting, new))

        def update(setting: PageSetting) -> None:
            value = read(setting)
            if not math.isclose(slider.value, value, rel_tol=SAME_RTOL):
                slider.update(
                    start=min(slider.start, value), end=max(slider.end, value), value=value
                )
            field.value = FIELD_DIGITS % value

        self._updates.append(update)
        slider.on_change("value", moved)
        field.on_change("value", typed)
        slider.js_on_change("value", CustomJS(code=MOVED))
        label = Div(text=title, render_as_text=True, margin=(4, 5, 0, 5))
        inputs = row(slider, field, sizing_mode=STRETCH_WIDTH)
        return column(label, inputs, sizing_mode=STRETCH_WIDTH)

    def _choice(self, field: str, title: str, options: list[str], setting: PageSetting) -> Select:
        menu = Select(
            title=title,
            options=options,
            value=getattr(setting, field),
            sizing_mode=STRETCH_WIDTH,
            name=f"choice {field}",
        )

        def chosen(_attr: str, _old: str, new: str) -> None:
            if new in options:  # the browser may send any value
                change: dict[str, Any] = {field: new}
                self._change(lambda setting: replace(setting, **change))

        def update(setting: PageSetting) -> None:
            menu.value = getattr(setting, field)

        self._updates.append(update)
        menu.on_change("value", chosen)
        return menu


def _button(name: str, label: str, clicked: Callable[[], None]) -> Button:
    button = Button(label=label, name=name)
    button.on_click(clicked)
    return button


def _heading(text: str) -> Div:
    return Div(text=text, render_as_text=True, css_classes=["heading"], sizing_mode=STRETCH_WIDTH,
               styles={"font-weight": "600", "margin-top": "8px"})  # fmt: skip
