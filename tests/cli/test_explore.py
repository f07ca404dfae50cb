import importlib.util

import pytest


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "no such preset or file"),
        (["zhao2004", "--set", "e=2"], "e = 2"),
        (["zhao2004", "--port", "70000"], "--port"),
        (["zhao2004", "--drive", "pulse"], "missing option"),
        (["own.py:system"], "own.py: no such file"),
        (["own.py:system", "--amplitude", "1"], "own.py:system has no voltage"),
        (["no_such_module:system"], "cannot be imported"),
    ],
)
def test_bad_input_is_reported_in_one_line(cli, arguments, told):
    assert told in cli("explore", *arguments, "--no-browser").complaint()


def test_without_its_library_it_says_what_to_install(cli, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "bokeh" else find(name)
    )
    told = cli("explore", "zhao2004").complaint()
    assert "pip install 'mems-impact[explore]'" in told
