from urllib.parse import parse_qs

import pytest

import mems_impact as mi
from mems_impact.explorer.session import address_of, first_setting, setting_at
from tests.explorer.subjects import mita, own, zhao


@pytest.mark.parametrize("subject", [zhao, mita, own])
def test_an_address_holds_the_setting_of_a_page(subject):
    subject = subject()
    name = next(iter(subject.system.parameters))
    first = first_setting(subject)
    setting = first.with_value(name, first.values[name] * 1.0 / 3.0)
    assert setting_at(subject, parse_qs(address_of(subject, setting))) == setting
    assert setting_at(subject, {}) == first


def test_the_words_of_the_page_are_apart_from_parameters():
    setting = setting_at(
        zhao(),
        {"amplitude": ["0.2"], "show.periods": ["40"], "show.start": ["rest"],
         "show.parameter": ["omega"], "show.x": ["t"], "show.y": ["x1"]},
    )  # fmt: skip
    assert setting.values["amplitude"] == 0.2
    assert setting.length == 40.0
    assert (setting.start, setting.parameter, setting.x, setting.y) == ("rest", "omega", "t", "x1")


@pytest.mark.parametrize(
    ("query", "told"),
    [
        ({"amplitude": ["much"]}, "amplitude = 'much': must be a finite number"),
        ({"amplitude": ["nan"]}, "amplitude = 'nan': must be a finite number"),
        ({"amplitude": ["1e999"]}, "must be a finite number"),
        ({"amplitude": ["0.2", "0.3"]}, "amplitude: given 2 times, not once"),
        ({"e": ["2"]}, "e = 2: must be a finite number >= 0 and <= 1"),
        ({"delta": ["1.5"]}, "delta = 1.5: must be < 1, the gap d"),
        ({"frobnicate": ["1"]}, "frobnicate: none of amplitude, omega"),
        ({"show.periods": ["1e9"]}, "show.periods = 1000000000: must be between 1 and 1000"),
        ({"show.x": ["__class__"]}, "must be one of x1, v1, x2, v2, t"),
        ({"show.start": ["import os"]}, "show.start = 'import os': must be one of rest, kicked"),
        ({"show.values": ["1"]}, "show.values: none of"),
        ({"show.system": ["own.py:system"]}, "show.system: none of"),
    ],
)
def test_what_an_address_says_wrong_is_reported_in_one_line(query, told):
    with pytest.raises(mi.InvalidParameter) as error:
        setting_at(zhao(), query)
    assert told in str(error.value)
    assert "\n" not in str(error.value)
