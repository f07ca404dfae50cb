"""Drives from TOML and CSV files."""

import math

import numpy as np
import pytest

import mems_impact as mi

FILES = {
    "sine": ('kind = "sine"\namplitude = 0.2\nomega = 0.5\nphase = 1', mi.Sine),
    "in hertz": (f'kind = "sine"\namplitude = 0.2\nfrequency = {0.5 / (2 * math.pi)!r}', mi.Sine),
    "square": ('kind = "square"\namplitude = 0.2\nomega = 0.5\nduty = 0.3', mi.Square),
    "pulse": ('kind = "pulse"\namplitude = 0.2\nperiod = 10\nwidth = 3', mi.Pulse),
    "trapezoid": ('kind = "trapezoid"\namplitude = 0.2\nomega = 0.5', mi.Trapezoid),
    "sampled": ('kind = "sampled"\nfile = "wave.csv"\nphase = 0.5', mi.Sampled),
    "record": ('kind = "sampled"\ntimes = [0, 1, 2]\nvoltages = [0, 1, 0.5]', mi.Sampled),
    "burst": ('kind = "burst"\non = 3\noff = 2\n[drive.wave]\nkind = "sine"\n'
              "amplitude = 0.2\nomega = 1", mi.Burst),
    "voltages": ('kind = "voltages"\n[drive.right]\nkind = "sine"\namplitude = 0.2\nomega = 1\n'
                  '[drive.left]\nkind = "sine"\namplitude = 0.1\nomega = 1', mi.Voltages),
    "custom": ('kind = "custom"\nsource = "wave.py"\nperiod = 3.141592653589793\n'
               "values = {top = 0.2}", mi.Custom),
}  # fmt: skip

CODE = """
import math
def voltage(t, q):
    return q[0] * math.cos(t)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wave.csv").write_text("time, voltage\n0, 0\n# noise\n1, 1\n2, 0.5\n")
    (tmp_path / "wave.py").write_text(CODE)
    return tmp_path


def written(folder, text, name="drive.toml"):
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ('kind = "sine"\namplitude = 1\nomega = 1\nfrequency = 1', "omitted if omega is given"),
        ('kind = "sine"\namplitude = 1\nfrequency = 0', "a finite number > 0"),
        ('kind = "pulse"\namplitude = 1\nfrequency = 1\nwidth = 1', "one of amplitude, period"),
    ],
)
def test_a_wrong_frequency(folder, lines, complaint):
    with pytest.raises(mi.InvalidParameter, match=f"^frequency = .*{complaint}"):
        mi.load(written(folder, f"[drive]\n{lines}\n"))


def test_a_frequency_is_omega_over_two_pi(folder):
    drive = mi.load(written(folder, "[drive]\n" + FILES["in hertz"][0]))
    assert drive.omega == pytest.approx(0.5, rel=1e-15)


@pytest.mark.parametrize("name", FILES)
def test_load(folder, name):
    text, kind = FILES[name]
    drive = mi.load(written(folder, f'name = "x"\n[drive]\n{text}\n'), allow_code=True)
    assert type(drive) is kind
    assert mi.load(str(folder / "drive.toml"), allow_code=True).period == drive.period


def test_csv(folder):
    drive = mi.load("wave.csv")
    assert drive.times == (0.0, 1.0, 2.0)
    assert drive.voltages == (0.0, 1.0, 0.5)
    assert drive.period == pytest.approx(3.0)
    for text in (
        "0 0\n1 1\n2 .5",
        "0;0\n1;1\n2;.5",
        "\n0\t0\n1\t1\n2\t.5\n\n",
        "t v\n0 0\n1 1\n2 .5",
    ):
        assert mi.load(written(folder, text, "other.txt")) == drive


def test_a_device_file_may_hold_the_drive(folder):
    device = mi.load_actuator("zhao2004")
    lines = [f"{name} = {value}" for name, value in device if name != "units"]
    text = "[parameters]\n" + "\n".join(lines) + "\n[drive]\n" + FILES["sine"][0]
    path = written(folder, text)
    assert mi.load_actuator(path) == device
    assert mi.load(path) == device.under(mi.Sine(amplitude=0.2, omega=0.5, phase=1))


BAD = {
    "": ["holds none of the tables", "[drive]"],
    "drive = 3": ["holds no table [drive]"],
    "[drive]\n": ["kind", "missing", "sine, square"],
    '[drive]\nkind = "sinus"': ["kind = 'sinus'", "sine, square"],
    "[drive]\nkind = 3": ["kind = 3"],
    "[drive]\nkind = []": ["kind"],
    '[drive]\nkind = "sine"\namplitude = 1\nomga = 1': ["omga", "did you mean omega?"],
    '[drive]\nkind = "sine"\namplitude = "1"\nomega = 1': ["amplitude", "finite number"],
    '[drive]\nkind = "sine"\namplitude = 1\nomega = nan': ["omega", "finite number"],
    'kind = "sine"\n[drive]': ["kind", "in the table [drive]"],
    '[drive]\nkind = "burst"\non = 1\noff = 1\nwave = 3': ["wave = 3", "a drive"],
    '[drive]\nkind = "burst"\non = 1\noff = 1\n[drive.wave]\nkind = "sine"\nomega = 1': [
        "wave.amplitude", "missing"],
    '[drive]\nkind = "sampled"\nfile = "none.csv"': ["none.csv", "no such file"],
    '[drive]\nkind = "sampled"\nfile = 3': ["file = 3", "CSV"],
    '[drive]\nkind = "sampled"\nfile = "wave.csv"\ntimes = [1]': ["times", "file, channel, period"],
    '[drive]\nkind = "custom"': ["source", "Python file"],
    '[drive]\nkind = "custom"\nsource = "none.py"': ["none.py", "no such file"],
    '[drive]\nkind = "custom"\nsource = "empty.py"': ["empty.py", "no function voltage"],
    '[drive]\nkind = "custom"\nsource = "broken.py"': ["broken.py", "SyntaxError"],
    '[drive]\nkind = "custom"\nsource = "leaving.py"': ["leaving.py", "SystemExit"],
    '[drive]\nkind = "custom"\nsource = "\\u0000.py"': ["not a path"],
    "[drive": ["not valid TOML"],
}  # fmt: skip


@pytest.mark.parametrize("text", BAD, ids=range(len(BAD)))
def test_bad_files(folder, text):
    (folder / "empty.py").write_text("")
    (folder / "broken.py").write_text("def")
    (folder / "leaving.py").write_text("raise SystemExit(0)")
    with pytest.raises((mi.InvalidFile, mi.InvalidParameter)) as caught:
        mi.load(written(folder, text), allow_code=True)
    message = str(caught.value)
    assert "\n" not in message
    for word in BAD[text]:
        assert word in message


RUNS = "open('it-ran', 'w').close()" + CODE
INSIDE_A_BURST = '[drive]\nkind = "burst"\non = 1\noff = 1\n[drive.wave]\n'


@pytest.mark.parametrize("above", ["[drive]\n", INSIDE_A_BURST])
def test_code_runs_only_when_it_is_allowed(folder, above):
    (folder / "wave.py").write_text(RUNS)
    path = written(folder, above + FILES["custom"][0])
    with pytest.raises(mi.InvalidFile) as caught:
        mi.load(path)
    assert not (folder / "it-ran").exists()
    for word in ("drive.toml", "source = 'wave.py'", "--allow-code", "allow_code=True"):
        assert word in str(caught.value)
    mi.load(path, allow_code=True)
    assert (folder / "it-ran").exists()


@pytest.mark.parametrize("way", ["../elsewhere/wave.py", "{}/elsewhere/wave.py", "link.py",
                                 "linked/wave.py"])  # fmt: skip
def test_code_from_elsewhere_never_runs(folder, way):
    own = folder / "own"
    for place in (own, folder / "elsewhere"):
        place.mkdir()
    (folder / "elsewhere" / "wave.py").write_text(RUNS)
    (own / "link.py").symlink_to(folder / "elsewhere" / "wave.py")
    (own / "linked").symlink_to(folder / "elsewhere")
    text = f'[drive]\nkind = "custom"\nsource = "{way.format(folder)}"\nperiod = 3.0\n'
    with pytest.raises(mi.InvalidFile, match="outside the folder of the drive file"):
        mi.load(written(own, text), allow_code=True)
    assert not (folder / "it-ran").exists()


def test_code_below_the_folder_runs(folder):
    (folder / "below").mkdir()
    (folder / "below" / "wave.py").write_text(CODE)
    text = "[drive]\n" + FILES["custom"][0].replace("wave.py", "below/wave.py")
    assert isinstance(mi.load(written(folder, text), allow_code=True), mi.Custom)


def test_the_code_is_that_of_the_text(folder):
    """Bytecode kept beside a file is taken for current by its date and size alone."""
    import os
    import py_compile

    (folder / "wave.py").write_text(RUNS)
    py_compile.compile(str(folder / "wave.py"))
    stamp = (folder / "wave.py").stat()
    (folder / "wave.py").write_text(CODE.ljust(len(RUNS)))
    os.utime(folder / "wave.py", ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    mi.load(written(folder, "[drive]\n" + FILES["custom"][0]), allow_code=True)
    assert not (folder / "it-ran").exists()


DEEP = ".".join(["a"] * 5_000)


@pytest.mark.parametrize("text", [f"[{DEEP}]\nx = 1", f"[drive.{DEEP}]\nx = 1",
                                  pytest.param(f"{DEEP} = 1", marks=pytest.mark.slow),
                                  f"[parameters.{DEEP}]\nx = 1"])  # fmt: skip
@pytest.mark.parametrize("load", [mi.load, mi.load_actuator])
def test_tables_far_within_tables(folder, load, text):
    with pytest.raises(mi.InvalidFile, match=r"drive\.toml: nests tables") as caught:
        load(written(folder, text))
    assert "\n" not in str(caught.value)


COMMAS = {
    "semicolons": "Zeit [ms];Spannung [V]\n-1,0;0,00\n0,0;1,25\n1,0;0,50\n",
    "tabs": "Kanal\tA\nZeit [ms]\tSpannung [V]\n-1,0\t0,00\n0,0\t1,25\n1,0\t0,50\n",
    "blanks": "-1,0E-3 0,00\n0,0E-3 1,25\n1,0E-3 0,50\n",
    "whole numbers among them": "-0,001;0\n0;1,25\n0,001;0,5\n",
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("text", COMMAS.values(), ids=COMMAS)
def test_a_record_with_decimal_commas(folder, text, encoding):
    (folder / "scope.csv").write_bytes(text.encode(encoding))
    drive = mi.load("scope.csv")
    assert drive.times == (-0.001, 0.0, 0.001)
    assert drive.voltages == (0.0, 1.25, 0.5)


def test_a_channel_of_several(folder):
    rows = "".join(f"{t},{t / 2},{9 - t}\n" for t in range(4))
    (folder / "two.csv").write_text(f"Model,X1\nTime [ms],CH1 [mV],CH2 [V]\n{rows}")
    for channel, voltages in (("CH1", (0.0, 5e-4, 1e-3, 1.5e-3)), (2, (9.0, 8.0, 7.0, 6.0))):
        drive = mi.Sampled.from_csv("two.csv", channel=channel)
        assert drive.voltages == pytest.approx(voltages, rel=1e-15)
        assert drive.times == pytest.approx((0.0, 1e-3, 2e-3, 3e-3), rel=1e-15)
    with pytest.raises(mi.InvalidParameter, match="channel = 'CH3'"):
        mi.Sampled.from_csv("two.csv", channel="CH3")


@pytest.mark.parametrize("form", ["{:.5f}", "{:.3e}"])
def test_rounded_times_are_equally_spaced(folder, form):
    times = 1e-3 + 3.3e-6 * np.arange(400)
    rows = "".join(f"{form.format(t)},{math.sin(9e3 * t):.6f}\n" for t in times)
    (folder / "rounded.csv").write_text(rows)
    with pytest.warns(mi.ValidityWarning, match=r"taken as equally spaced, 3\.(3|29\d+)e-06 s"):
        drive = mi.Sampled.from_csv("rounded.csv")
    assert np.ptp(np.diff(drive.times)) < 1e-15
    assert np.diff(drive.times)[0] == pytest.approx(3.3e-6, rel=1e-2)


def test_a_whole_cycle_is_told(folder):
    rows = "".join(f"{i * 1e-3},{math.cos(2 * math.pi * i / 100):.3f}\n" for i in range(100))
    (folder / "cycle.csv").write_text(rows)
    with pytest.warns(mi.ValidityWarning, match="counts two periods of the force as one"):
        mi.Sampled.from_csv("cycle.csv")


@pytest.mark.parametrize(
    ("heading", "time", "volt"),
    [
        ("time [ms],voltage [mV]", 1e-3, 1e-3),
        ("Time,Channel A\n(ms),(V)", 1e-3, 1.0),
        ("# t [us], V [kV]", 1e-6, 1e3),
        ("second,Volt", 1.0, 1.0),
        ("time (msec);CH1 (Volts)", 1e-3, 1.0),
        ("t/ms\tU/V", 1e-3, 1.0),
        ("time [ms], Channel A", 1e-3, 1.0),
        ("q_ns, q_pC", 1e-9, 1e-12),
        ("milliseconds millivolts", 1e-3, 1e-3),
        ("Vertical Units,mV\nTIME,CH1", 1.0, 1.0),
        ("Zeit,Spannung (rms)", 1.0, 1.0),
    ],
)
def test_units_in_headings_apply(folder, heading, time, volt):
    (folder / "wave.csv").write_text(f"{heading}\n0,0\n1,1\n2,0.5\n", "utf-8")
    drive = mi.load("wave.csv")
    assert drive.times == pytest.approx((0.0, time, 2.0 * time), rel=1e-15)
    assert drive.voltages == pytest.approx((0.0, volt, 0.5 * volt), rel=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time [ms], current [mA]\n0,0\n1,1\n2,0\n", "line 1 has the unit mA for numbers in V"),
        ("", "no line begins with a number"),
        ("0 0\n1 1\n", "a list of 3"),
        ("0 0\n1 x\n2 0", "line 2 holds 'x'"),
        ("0 0\n1 nan\n2 0", "line 2 holds 'nan'"),
        ("0 0\n1 1 1\n2 0", "line 2 holds 3 columns"),
        ("0 0\n2 1\n1 0", "ascending"),
        ("a b\nc d\n", "no line begins with a number"),
        ("\x00\x01", "no line begins"),
        (b"\xff\xfe0", "no line begins"),
        ("t;CH1;CH2\n0;1;2\n1;2;3\n2;1;0\n", "holds 3 columns; give channel=, one of CH1, CH2"),
        ("0,001,1,5\n0,002,2,5\n0,003,1,5\n", "holds 4 columns, not 2; separate columns by semi"),
    ],
)
def test_bad_csv(folder, text, words):
    (folder / "bad.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises((mi.InvalidFile, mi.InvalidParameter)) as caught:
        mi.load("bad.csv")
    assert words in str(caught.value)
    assert "bad.csv" in str(caught.value)


@pytest.mark.parametrize("path", [3, b"x.toml", None, "", "none.toml", "\0", "."])
def test_bad_paths(folder, path):
    with pytest.raises((mi.InvalidFile, mi.InvalidParameter)):
        mi.load(path)


RECORD = [(t / 20.0, 2.0 + math.sin(math.pi * t / 10.0)) for t in range(-10, 11)]


@pytest.mark.parametrize("line", ["{:.2f},{:.5f}", '"{:.2f}";"{:.5f}"', "'{:.2f}'\t'{:.5f}'"])
@pytest.mark.parametrize("heading", ["", "time [s],voltage [V]\n", "TIME,CH1\n", "x-axis,1\n"])
@pytest.mark.parametrize("minus", ["-", "\N{MINUS SIGN}"])
def test_no_row_is_taken_for_a_heading(folder, line, heading, minus):
    rows = "\n".join(line.format(*row) for row in RECORD).replace("-", minus)
    (folder / "wave.csv").write_text(heading + rows, encoding="utf-8")
    record = mi.Sampled.from_csv(folder / "wave.csv")
    assert record.period == pytest.approx(1.0, rel=1e-12)
    assert record.voltages == pytest.approx([round(v, 5) for _, v in RECORD[:-1]], rel=1e-12)


@pytest.mark.parametrize(
    "row",
    ["0x0,1.5", "\u20130.5,1.5", "~0.5,1.5", "0.5s,1.5V", "=0.5,1.5", "--,1.5", "0.5.1;1", "1/2 1"],
)
def test_a_row_above_the_numbers_is_no_heading(folder, row):
    (folder / "wave.csv").write_text(f"time,voltage\n{row}\n0.0,1.0\n1.0,2.0\n", encoding="utf-8")
    with pytest.raises(mi.InvalidFile, match=r"line 2 holds .*, which is not a number; correct it"):
        mi.Sampled.from_csv(folder / "wave.csv")
