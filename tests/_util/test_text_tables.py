"""Tables as instruments write them, as drives and as records of fits."""

from __future__ import annotations

import numpy as np
import pytest

import mems_impact as mi

T = -1e-4 + 2e-6 * np.arange(12)
V = np.round(20.0 + 20.0 * np.cos(0.4 * np.arange(12)), 4)
W = np.round(0.5 * np.sin(0.5 * np.arange(12)), 4)


def rows(form, *columns):
    return "".join(form.format(*row) + "\n" for row in zip(*columns, strict=True))


def with_commas(text):
    return text.replace(".", ",")


SETTINGS = ("Record Length,1.2e+01,", "Sample Interval,2.0e-06,", "Vertical Units,V,", ",,", ",,")
INSTRUMENTS = {
    "Tektronix TDS": "".join(
        f"{setting},{t:017.12f},{v:10.5f},\n"
        for setting, t, v in zip((*SETTINGS, *7 * (",,",)), T, V, strict=True)
    ),
    "Tektronix MSO": "Model,MSO24\nFirmware Version,1.22.5\nSample Interval,2e-06\n,\n,\nLabel,\n"
    "TIME,CH1\n" + rows("{:.4e},{:.4f}", T, V),
    "Keysight InfiniiVision": "x-axis,CH1,CH2\nsecond,Volt,Volt\n"
    + rows("{:+.8E},{:+.6E},{:+.6E}", T, V, W),
    "Keysight Infiniium": "Type:,raw\nPoints:,12\nXInc:,2E-06\nXOrg:,-1.0E-04\nXUnits:,Second\n"
    "YUnits:,Volt\nDate:,30 Nov 2026\nData:\n" + rows("{:.4f}", V),
    "Rohde & Schwarz": "in s,C1 in V\n" + rows("{:.6E},{:.6E}", T, V),
    "Rohde & Schwarz, commas": with_commas(
        '"Zeit in s";"Kanal 1 in V"\n' + rows("{:.8f};{:.4f}", T, V)
    ),
    "LeCroy": "LECROYWaveRunner,30123,Waveform\nSegments,1,SegmentSize,12\n"
    "Segment,TrigTime,TimeSinceSegment1\n#1,30-Nov-2026 10:11:12,0   \nTime,Ampl\n"
    + rows("{:.8g},{:.6g}", T, V),
    "PicoScope": "Time,Channel A,Channel B\n(us),(V),(mV)\n\n"
    + rows("{:.8f},{:.8f},{:.8f}", 1e6 * T, V, 1e3 * W),
    "PicoScope, commas": with_commas(
        "Zeit\tKanal A\n(us)\t(mV)\n\n" + rows("{:.8f}\t{:.8f}", 1e6 * T, 1e3 * V)
    ),
    "Rigol": "X,CH1,Start,Increment,\nSequence,VOLT,-1.0e-04,2.0e-06\n"
    + rows("{:.0f},{:.6e},,", np.arange(12), V),
    "Rigol, two channels": "X,CH1,CH2,Start,Increment,\nSequence,Volt,Volt,-1.0e-04,2.0e-06\n"
    + rows("{:.0f},{:.6e},{:.6e},", np.arange(12), V, W),
    "Siglent": "Record Length,Analog:12\nSample Interval,Analog:2.0e-06\nVertical Units,CH1:V\n"
    "Model Number,SDS1104X-E\nSource,CH1\nSecond,Value\n" + rows("{:.7f},{:.5f}", T, V),
    "Yokogawa": '"Model","DL9040"\n"Date","2026/11/30"\n"HResolution",2.0E-06\n'
    '"HOffset",-1.0E-04\n"VUnit","V"\n,"CH1"\n' + rows(",{:.6E}", V),
    "GW Instek": "Memory Length,12,\nTrigger Level,1.2V,\nSampling Period,2.0e-06,\n"
    "Time,30-Nov-26 10:11:12,\nWaveform Data,\n" + rows("{:.4f},", V),
    "a spreadsheet, quoted": '"Time (ms)","CH1 (V)"\n' + rows('"{:.6f}","{:.4f}"', 1e3 * T, V),
    "separators at the end": with_commas("Time [s];CH1 [V];\n" + rows("{:.8f};{:.4f};", T, V)),
}
TWO = ("Keysight InfiniiVision", "PicoScope", "Rigol, two channels")
WITHOUT_START = ("GW Instek",)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
@pytest.mark.parametrize("instrument", INSTRUMENTS)
def test_a_file_of_an_instrument(tmp_path, instrument, encoding):
    file = tmp_path / "trace.csv"
    file.write_bytes(INSTRUMENTS[instrument].replace("\n", "\r\n").encode(encoding))
    times = T - T[0] if instrument in WITHOUT_START else T

    drive = mi.Sampled.from_csv(file, channel=1 if instrument in TWO else None)
    assert drive.times == pytest.approx(times.tolist(), abs=1e-12)
    assert drive.voltages == pytest.approx(V.tolist(), abs=1e-9)

    samples = mi.Record(samples=file).samples
    units = samples.attrs.get("units", {})
    factors = [{"us": 1e-6, "ms": 1e-3, "mV": 1e-3}.get(units.get(n), 1.0) for n in samples]
    measured = samples.to_numpy() * factors
    assert samples.columns[0] == "t"
    np.testing.assert_allclose(measured[:, 0], times, rtol=0, atol=1e-12)
    np.testing.assert_allclose(measured[:, 1], V, rtol=0, atol=1e-9)
    if instrument in TWO:
        np.testing.assert_allclose(measured[:, 2], W, rtol=0, atol=1e-9)


def test_columns_of_a_vibrometer_have_names_of_states(tmp_path):
    file = tmp_path / "trace.txt"
    heading = "Signal:\tVib Displacement\nTime\tDisplacement\tReference\n[ s ]\t[ um ]\t[ V ]\n"
    file.write_text(heading + rows("{:.6E}\t{:.6E}\t{:.3f}", T - T[0], W, V))
    record = mi.Record(samples=file, columns={"Displacement": "x2"})
    assert list(record.samples) == ["t", "x2"]
    assert record.samples.attrs["units"] == {"t": "s", "x2": "um"}
    with pytest.raises(mi.InvalidParameter, match="must be one of t, Displacement, Reference"):
        mi.Record(samples=file, columns={"CH1": "x2"})


@pytest.mark.parametrize("read", [mi.Sampled.from_csv, lambda path: mi.Record(samples=path)])
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Date,CH1\n2026-11-30 10:11:12.5,0.1\n", "line 2 begins with 2026-11-30 10:11:12.5, a d"),
        ("Time,CH1\n10:11:12,0.1\n", "a date or a time of day; replace it by seconds"),
        ("Model,X\nCH1\n0.1\n0.2\n0.3\n", "from line 3 on has no times, and no sampling interval"),
    ],
)
def test_a_file_without_times(tmp_path, read, text, words):
    file = tmp_path / "trace.csv"
    file.write_text(text)
    with pytest.raises(mi.InvalidFile, match="trace") as caught:
        read(file)
    assert words in str(caught.value)
    assert str(caught.value).count("trace.csv") == 1
