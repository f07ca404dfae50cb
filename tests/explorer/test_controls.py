"""Number fields take what the sliders cannot reach, also with a unit."""

import pytest

pytest.importorskip("bokeh")

from mems_impact.errors import InvalidParameter
from mems_impact.explorer.session import first_setting, slider_specs
from mems_impact.explorer.view.controls import Controls
from tests.explorer.subjects import mita, zhao


class Wired:
    """Controls, and the setting that they change."""

    def __init__(self, subject):
        self.setting = first_setting(subject)
        made = (subject, slider_specs(subject), self.setting)
        self.controls = Controls(*made, self.change, lambda: None, lambda what: None)

    def change(self, change):
        self.setting = change(self.setting)
        self.controls.show(self.setting)

    def field(self, name):
        return self.controls.layout.select_one({"name": f"field {name}"})


def test_a_text_with_a_unit_is_a_value():
    page = Wired(mita())
    page.field("amplitude").value = "0.05 kV"
    assert page.setting.values["amplitude"] == 50.0
    assert page.field("amplitude").value == "50"
    page.field("d").value = "6e-3 mm"
    assert page.setting.values["d"] == pytest.approx(6e-6, rel=1e-15)
    assert page.field("d").value == "6"  # um, the unit of the slider
    page.field("d").value = "7"
    assert page.setting.values["d"] == pytest.approx(7e-6, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("amplitude", "50 Hz", r"amplitude = '50 Hz': must be a number \[V\]"),
        ("e", "much", "e = 'much': must be a number"),
        ("length", "5 V", "must be a number"),
    ],
)
def test_another_text_is_refused(name, text, said):
    page = Wired(mita())
    before = page.setting
    with pytest.raises(InvalidParameter, match=said):
        page.field(name).value = text
    assert page.setting == before


def test_a_dimensionless_device_has_no_units():
    page = Wired(zhao())
    with pytest.raises(InvalidParameter, match="dimensionless"):
        page.field("amplitude").value = "0.3 V"
