import copy
import math
import pickle
import tomllib
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.device_files import load_actuator, preset_names
from mems_impact.actuator.parameters import PARAMETER_NAMES
from mems_impact.errors import InvalidFile, InvalidParameter, MemsImpactError

SET = {
    "m1": 5.0,
    "m2": 1.0,
    "k": 1.0,
    "c": 0.04,
    "d": 1.0,
    "delta": 0.5,
    "e": 0.8,
    "mu_s": 0.4,
    "mu_d": 0.27,
    "alpha": 1.0,
    "g": 9.81,
}
TOML = "[parameters]\n" + "".join(f"{name} = {value}\n" for name, value in SET.items())


@pytest.fixture
def write(tmp_path):
    def write_file(content: str | bytes) -> Path:
        path = tmp_path / "my.toml"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write_file


def refused(**changes) -> InvalidParameter:
    with pytest.raises(InvalidParameter) as caught:
        Actuator(**{**SET, **changes})
    assert "\n" not in str(caught.value)
    return caught.value


def test_preset_is_section_4_of_the_paper():
    assert "zhao2004" in preset_names()
    assert dict(load_actuator("zhao2004")) == {**SET, "units": "dimensionless"}


def test_array_in_declared_order():
    array = Actuator(**SET).to_array()
    assert tuple(SET) == PARAMETER_NAMES
    assert array.dtype == np.float64
    assert array.tolist() == list(SET.values())


def test_immutable_hashable_picklable():
    actuator = Actuator(**SET)
    with pytest.raises(ValueError, match="frozen"):
        actuator.m1 = 2.0
    assert pickle.loads(pickle.dumps(actuator)) == actuator
    assert hash(actuator) == hash(Actuator(**SET))


@pytest.mark.parametrize("value", [2, np.float64(2), np.float32(2), np.int64(2)])
def test_every_kind_of_number_becomes_a_float(value):
    assert type(Actuator(**{**SET, "m1": value}).m1) is float


@pytest.mark.parametrize("value", ["1.0", True, None, 1j, [1.0], np.bool_(True), {}])
@pytest.mark.parametrize("name", PARAMETER_NAMES)
def test_other_types_are_refused(name, value):
    error = refused(**{name: value})
    assert error.field == name
    assert error.value is value
    assert error.allowed.startswith("a finite number")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10**400, np.float32("nan")])
@pytest.mark.parametrize("name", PARAMETER_NAMES)
def test_not_finite_is_refused(name, value):
    assert refused(**{name: value}).field == name


negative = st.floats(max_value=0, exclude_max=True, allow_infinity=False)


@given(st.sampled_from(PARAMETER_NAMES), negative)
def test_negative_is_refused(name, value):
    error = refused(**{name: value})
    assert error.field == name
    assert error.value == value


@pytest.mark.parametrize("name", ["m1", "m2", "k", "d", "alpha", "delta"])
def test_zero_is_refused(name):
    error = refused(**{name: 0.0})
    assert (error.field, error.allowed) == (name, "a finite number > 0")


@given(st.floats(min_value=1, exclude_min=True, allow_infinity=False))
def test_restitution_above_one_is_refused(value):
    assert refused(e=value).allowed == "a finite number >= 0 and <= 1"


@given(st.floats(min_value=1e-300, max_value=1e300), st.floats(min_value=1e-300, max_value=1e300))
def test_stopper_is_nearer_than_electrode(delta, d):
    if delta < d:
        assert Actuator(**{**SET, "delta": delta, "d": d}).delta == delta
    else:
        assert refused(delta=delta, d=d).field == "delta"


def test_messages_name_the_other_parameter():
    assert str(refused(delta=1.2)) == "delta = 1.2: must be < 1, the gap d"
    assert str(refused(mu_d=0.5)) == "mu_d = 0.5: must be <= 0.4, which is mu_s"


def test_unknown_name_suggests_the_nearest():
    values = {("detla" if name == "delta" else name): value for name, value in SET.items()}
    with pytest.raises(InvalidParameter, match=r"^detla = 0\.5: unknown .* mean delta\?$"):
        Actuator(**values)
    assert "one of m1, m2" in str(refused(voltage=3))
    assert refused(self=3).field == "self"


@pytest.mark.parametrize("name", PARAMETER_NAMES)
def test_missing_name(name):
    with pytest.raises(InvalidParameter, match=f"^{name}: missing, must be a finite") as caught:
        Actuator(**{key: value for key, value in SET.items() if key != name})
    assert caught.value.field == name


def test_replace_checks():
    actuator = Actuator(**SET)
    assert actuator.replace(e=0.5) == Actuator(**{**SET, "e": 0.5})
    for replace in (actuator.replace, actuator.__replace__):
        with pytest.raises(InvalidParameter):
            replace(delta=2.0)
        with pytest.raises(InvalidParameter):
            replace(f=2.0)
    assert copy.copy(actuator) == actuator


def test_load_file(write):
    path = write('name = "mine"\ndescription = "a device"\n' + TOML)
    assert load_actuator(path) == load_actuator(str(path)) == Actuator(**SET)


def test_load_file_with_byte_order_mark_and_dos_lines(write):
    path = write(b"\xef\xbb\xbf" + TOML.replace("\n", "\r\n").encode())
    assert load_actuator(path) == Actuator(**SET)


def test_path_object_is_never_a_preset(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidFile, match="no such"):
        load_actuator(Path("zhao2004"))


@pytest.mark.parametrize(
    ("old", "new", "field", "pattern"),
    [
        ("delta = 0.5", "delta = 1.2", "delta", "must be < 1, the gap d"),
        ("m1 = 5.0", 'm1 = "5"', "m1", "finite number > 0"),
        ("m1 = 5.0", "m1 = true", "m1", "finite number > 0"),
        ("m1 = 5.0", "m1 = nan", "m1", "finite number > 0"),
        ("m1 = 5.0", "m1 = 2026-01-01", "m1", "finite number > 0"),
        ("alpha = 1.0", "alhpa = 1.0", "alhpa", r"did you mean alpha\?"),
        ("alpha = 1.0\n", "", "alpha", "missing"),
        ("g = 9.81", "g = 9.81\n[more]", "more", "unknown name"),
        ("[parameters]", "[parametres]", "parametres", r"did you mean parameters\?"),
        ("[parameters]", "", "m1", r"in the table \[parameters\]"),
        ("[parameters]", "name = 3\n[parameters]", "name", "must be a string"),
        (TOML, "", "parameters", "missing, must be a table"),
        (TOML, "parameters = 3", "parameters", "must be a table"),
        (TOML, "[[parameters]]\nm1 = 1", "parameters", "must be a table"),
        ("m1 = 5.0", '"a\\nb" = 1', "a\nb", "unknown"),
    ],
)
def test_wrong_entry_in_file(write, old, new, field, pattern):
    assert old in TOML
    path = write(TOML.replace(old, new))
    with pytest.raises(InvalidParameter, match=pattern) as caught:
        load_actuator(path)
    assert caught.value.field == field
    assert caught.value.source == str(path)
    assert str(caught.value).endswith(f"[in {path}]")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (TOML[: TOML.index("delta") + 7], "not valid TOML"),
        (TOML + "m1 = 3\n", "not valid TOML"),
        ("m1 = " + "1" * 5000, "not valid TOML"),
        ("m1 = " + "[" * 100_000, "not valid TOML"),
        (b"m1 = \xff\xfe", "not UTF-8"),
        (b"\x00", "not valid TOML"),
        (b"#" * 1_000_001, "too large"),
    ],
    ids=["truncated", "twice", "huge-integer", "deep", "bytes", "null", "large"],
)
def test_file_that_is_not_toml(write, content, reason):
    path = write(content)
    with pytest.raises(InvalidFile, match=reason) as caught:
        load_actuator(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_directory_and_missing_file(tmp_path):
    with pytest.raises(InvalidFile, match="is a directory; give"):
        load_actuator(tmp_path)
    with pytest.raises(InvalidFile, match=r"absent\.toml: no such file; give"):
        load_actuator(tmp_path / "absent.toml")
    (tmp_path / "file").touch()
    with pytest.raises(InvalidFile, match="cannot be read"):
        load_actuator(tmp_path / "file" / "my.toml")


@pytest.mark.parametrize("name", ["zhao2040", "", "../devices/zhao2004", "x" * 5000])
def test_unknown_preset_lists_presets_and_mentions_paths(name):
    with pytest.raises(InvalidFile, match=r"preset \(.*zhao2004.*\) or the path of a TOML"):
        load_actuator(name)


@pytest.mark.parametrize("name", [3, None, b"zhao2004", 1.5])
def test_neither_name_nor_path(name):
    with pytest.raises(InvalidParameter, match="name of a preset or the path"):
        load_actuator(name)


@given(st.data())
def test_damaged_file_loads_right_or_is_refused(tmp_path_factory, data):
    raw = bytearray(TOML.encode())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(raw) - 1))
        raw[place] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "fuzz.toml"
    path.write_bytes(raw[: data.draw(st.integers(0, len(raw)))])
    try:
        actuator = load_actuator(path)
    except MemsImpactError as error:
        message = str(error)
    else:
        message = str(path)
        content = tomllib.loads(path.read_text("utf-8-sig"))
        units = content.get("units", "dimensionless")
        assert dict(actuator) == {**content["parameters"], "units": units}
    assert str(path) in message
    assert "\n" not in message


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 20_000) + " = 1",
        "[ " + " . ".join("a" * 10_000) + " ]",
        "a = { b." + '."b"' * 10_000 + " = 1 }",
        "a = " + "[" * 20_000,
    ],
)
def test_a_deep_name_is_refused_before_it_is_parsed(tmp_path, text):
    path = tmp_path / "deep.toml"
    path.write_text(text)
    tracemalloc.start()
    try:
        with pytest.raises(InvalidFile, match=r"not valid TOML|nests tables more than 20 deep"):
            load_actuator(path)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()
