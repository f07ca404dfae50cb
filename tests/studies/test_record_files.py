"""Records of motions from files."""

from __future__ import annotations

import numpy as np
import pytest

import mems_impact as mi


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
def test_a_table_of_samples_as_an_instrument_writes_it(tmp_path, separator, comma):
    if comma and separator == ",":
        pytest.skip("ambiguous")
    rows = [(0.25 * i, np.cos(0.25 * i)) for i in range(5)]
    lines = [separator.join(f"{value:.6f}" for value in row) for row in rows]
    text = "\n".join([f"Vibrometer{separator}7", "", f"t{separator}x", *lines])
    file = tmp_path / "trace.csv"
    file.write_text(text.replace(".", ",") if comma else text, "utf-8-sig")
    samples = mi.Record(samples=file).samples
    assert list(samples.columns) == ["t", "x"]
    np.testing.assert_allclose(samples.to_numpy(), rows, rtol=0, atol=1e-6)


def test_rounded_times_of_samples_are_equally_spaced(tmp_path):
    times = 3.3e-6 * np.arange(300)
    file = tmp_path / "trace.csv"
    file.write_text("t,x\n" + "".join(f"{t:.5f},{np.cos(t):.9f}\n" for t in times))
    samples = mi.Record(samples=file).samples
    assert np.abs(samples["t"] - times).max() < 1e-5
    assert np.ptp(np.diff(samples["t"])) < 1e-15
