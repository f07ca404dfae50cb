"""Bad files: of devices, of drives, and measured waveforms. Each is one clear error."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import mems_impact as mi
from validation.campaign.result import Result

DEVICE = """name = "mine"
description = "a device"
units = "SI"
[parameters]
m1 = 1e-5
m2 = 2e-6
k = 4.7
c = 6e-4
d = 5e-6
delta = 2.5e-6
e = 0.8
mu_s = 0.4
mu_d = 0.27
alpha = 8.9e-20
g = 9.81
"""
DRIVES = (
    '[drive]\nkind = "sine"\namplitude = 0.3\nomega = 0.5\nbias = 0.1\nphase = 0.2\n',
    '[drive]\nkind = "square"\namplitude = 0.3\nomega = 0.5\nduty = 0.4\nrise = 0.2\nlow = -0.1\n',
    '[drive]\nkind = "pulse"\namplitude = 0.3\nperiod = 9.0\nwidth = 2.0\nrise = 0.5\nfall = 0.1\n',
    '[drive]\nkind = "trapezoid"\namplitude = 0.3\nomega = 0.5\nflat = 0.4\nbias = 0.1\n',
    '[drive]\nkind = "sampled"\ntimes = [0.0, 1.0, 2.5, 4.0]\nvoltages = [0.1, 0.3, 0.2, 0.1]\n'
    "period = 5.0\nphase = 1.0\n",
    '[drive]\nkind = "burst"\non = 3.5\noff = 2.0\n[drive.wave]\nkind = "sine"\namplitude = 0.3\n'
    "omega = 2.0\n",
    '[drive]\nkind = "voltages"\n[drive.right]\nkind = "sine"\namplitude = 0.3\nomega = 0.5\n'
    '[drive.left]\nkind = "square"\namplitude = 0.2\nomega = 1.0\n',
)
CSV = "t,v\n0.0,0.1\n0.5,0.3\n1.0,0.2\n1.5,-0.1\n2.0,0.1\n"
VALUES = (
    "0", "-0.0", "1", "-1", "1e-320", "1e308", "-1e308", "1e400", "inf", "-inf", "nan", "true",
    "false", '""', '"1.0"', '"sine"', '"burst"', "[]", "[1.0]", "[[1.0]]", "{}", "{ a = 1 }",
    "1979-05-27", "07:32:00", "1979-05-27T07:32:00Z", "0x10", "9" * 400, "0b1", "[nan, inf, 1.0]",
    "[0.0, 1.0, 2.0, 3.0]", "[0.0, 0.0, 0.0, 0.0]", '["a", "b", "c"]', "[true, false, true]",
    "1e-300", "1e300", "2.5", "0.5", "1_000", "'x'", '"\\u0000"', "[" * 300 + "]" * 300,
)  # fmt: skip


def broken_bytes(rng: np.random.Generator, text: str) -> bytes:
    """Return the file with bytes changed, lost, doubled or cut off."""
    raw = bytearray(text.encode())
    for _ in range(int(rng.integers(1, 6))):
        how, at = rng.integers(6), int(rng.integers(len(raw) + 1))
        if how == 0 and at < len(raw):
            raw[at] = int(rng.integers(256))
        elif how == 1:
            del raw[at : at + int(rng.integers(1, 12))]
        elif how == 2:
            raw[at:at] = raw[at : at + int(rng.integers(1, 40))]
        elif how == 3:
            raw[at:at] = bytes(rng.integers(256, size=int(rng.integers(1, 6)), dtype=np.uint8))
        elif how == 4:
            del raw[at:]
        else:
            raw[at:at] = rng.choice(
                [b"\n", b"=", b"[", b"]", b'"', b"#", b".", b"\xef\xbb\xbf", b"-"]
            )
        if not raw:
            break
    return bytes(raw)


def broken_structure(rng: np.random.Generator, text: str) -> bytes:
    """Return the file with values, names and tables exchanged, lost, doubled or made up."""
    lines = text.splitlines()
    for _ in range(int(rng.integers(1, 4))):
        if not lines:
            break
        how, at = rng.integers(7), int(rng.integers(len(lines)))
        name, equals, value = lines[at].partition(" = ")
        if how <= 2 and equals:
            lines[at] = f"{name} = {VALUES[rng.integers(len(VALUES))]}"
        elif how == 3:
            del lines[at]
        elif how == 4 and equals:
            lines[at] = f"{rng.choice(['x', 'm1', 'kind', 'wave', 'omega', 'file'])} = {value}"
        elif how == 5:
            lines.insert(at, lines[rng.integers(len(lines))])
        else:
            extra = ("[drive]", "[parameters]", "[other]", "[[drive]]", "[drive.wave]", "x = 1")
            lines.insert(at, str(rng.choice(extra)))
    return "\n".join(lines).encode()


def broken_table(rng: np.random.Generator, text: str) -> bytes:
    """Return the measured waveform with cells exchanged."""
    cells = ["nan", "inf", "1e400", "-1", "", "x", "1,2", "1;2", "0x1", "١", "1e-320", "1_0"]
    lines = text.splitlines()
    for _ in range(int(rng.integers(1, 4))):
        if not lines:
            break
        at = int(rng.integers(len(lines)))
        row = lines[at].split(",")
        how = rng.integers(4)
        if how == 0:
            row[rng.integers(len(row))] = str(rng.choice(cells))
        elif how == 1:
            row.append(str(rng.choice(cells)))
        elif how == 2:
            lines.insert(at, lines[rng.integers(len(lines))])
        else:
            row = row[:1]
        lines[at] = ",".join(row)
    return "\n".join(lines).encode()


def tell(load: Callable[[str], Any], path: Path) -> tuple[str, str]:
    """Load a file: what it gave, and what is wrong with that."""
    try:
        loaded = load(str(path))
    except (mi.InvalidParameter, mi.InvalidFile) as error:
        text = str(error)
        if "\n" in text or not text.isprintable():
            return type(error).__name__, f"more than a line: {text!r}"
        if len(text) > 1200:
            return type(error).__name__, f"{len(text)} characters"
        return type(error).__name__, ""
    except BaseException as error:
        return type(error).__name__, f"{type(error).__name__}: {error}"
    if isinstance(loaded, mi.Drive):
        try:
            problem = usable(loaded)
        except Exception as error:
            return "accepted", f"accepted, then {type(error).__name__}: {error}"
        return "accepted", problem
    return "accepted", ""


def usable(drive: mi.Drive) -> str:
    """Say what is wrong with a drive that was accepted."""
    period, switches = drive.period, drive.switches
    if not (np.isfinite(period) and period > 0.0):
        return f"accepted with period {period}"
    if any(not 0.0 < time <= period for time in switches) or list(switches) != sorted(
        set(switches)
    ):
        return f"accepted with switches {switches[:8]} of {period}"
    times = np.array([0.0, 0.3, 0.9]) * period
    if not np.isfinite(drive.value(times)).all():
        return "accepted with a voltage that is not finite"
    if not np.isfinite(drive.parameters()).all():
        return "accepted with parameters that are not finite"
    return ""


def files(seed: int, small: bool) -> Result:
    """Fuzz the three kinds of files."""
    rng = np.random.default_rng(seed)
    count = 600 if small else 30_000
    told: Counter[str] = Counter()
    findings: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        for i in range(count):
            which = rng.integers(10)
            if which < 3:
                text, load, ending = DEVICE, mi.load_actuator, ".toml"
            elif which < 9:
                text, load, ending = str(rng.choice(DRIVES)), mi.load, ".toml"
            else:
                text, load, ending = CSV, mi.load, ".csv"
            how = rng.random() < 0.4
            other = broken_table if ending == ".csv" else broken_structure
            raw = (broken_bytes if how else other)(rng, text)
            path = Path(folder) / f"{i % 50}{ending}"
            path.write_bytes(raw)
            kind, problem = tell(load, path)
            told[kind] += 1
            if problem:
                findings.setdefault(problem[:60], f"{problem[:300]} from {raw[:400]!r}")
    figures = ", ".join(f"{name} {number}" for name, number in told.most_common())
    return Result("files, bytes and structure", count, figures, list(findings.values())[:20])


ATTACKS: list[Callable[..., Result]] = [files]
