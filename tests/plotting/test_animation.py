"""Runs that move."""

import shutil

import numpy as np
import pytest
from PIL import Image

import mems_impact as mi
from mems_impact.plotting import animation
from mems_impact.plotting.animation import FLASH, frames_of, glow


@pytest.fixture(scope="module")
def moving(run):
    return mi.animate(run, 98, x="x", y="v", per_period=8)


@pytest.fixture(scope="module")
def device():
    actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    return mi.simulate(actuator, drive, 12, initial=mi.State(v2=1.0))


def artists(moving, marker):
    ax = moving.figure.axes[0]
    return [line for line in ax.lines if line.get_marker() == marker]


def test_no_impact_is_lost_between_two_frames(run):
    for per_period in (1, 7):  # frames far apart and near
        frames = frames_of(run, 95.0, 100.0, per_period)
        hits = frames.corners[frames.corners["impact"]]
        assert len(hits) == 5
        brightest: dict[int, float] = {}
        for t in frames.frame_samples["t"]:
            for name, strength in glow(t, frames.step, hits)["strength"].items():
                assert 0.0 < strength <= 1.0
                brightest[name] = max(brightest.get(name, 0.0), strength)
        shown = hits[hits["t"] <= frames.frame_samples["t"].iloc[-1]]
        assert set(brightest) == set(shown.index)
        # Frames far apart show an impact that is at hand at least.
        assert min(brightest.values()) >= 1.0 - 1.0 / FLASH


def test_the_portrait_draws_itself(moving, run):
    assert moving.frames == 17
    head = next(line for line in artists(moving, "o"))
    for number in (0, 5, -1):
        moving.frame(number)
        now = run.samples(8, 98).iloc[number]
        assert [head.get_xdata()[0], head.get_ydata()[0]] == pytest.approx([now["x"], now["v"]])
    # Both impacts are there as jumps, and the axes have not moved.
    jumps = [line for line in moving.figure.axes[0].lines if line.get_linestyle() == "--"]
    assert max(np.isnan(line.get_xdata()).sum() for line in jumps) == 2
    with pytest.raises(mi.InvalidParameter, match="between 0 and 16"):
        moving.frame(17)


def test_frames_drawn_fast_are_those_drawn_whole(moving, tmp_path):
    moving.save(tmp_path / "run.gif", dpi=60)
    with Image.open(tmp_path / "run.gif") as picture:
        assert picture.n_frames == moving.frames
        picture.seek(9)
        fast = np.asarray(picture.convert("L"), dtype=float)
    moving.frame(9).savefig(tmp_path / "frame.png", dpi=60)
    with Image.open(tmp_path / "frame.png") as picture:
        whole = np.asarray(picture.convert("L"), dtype=float)
    assert fast.shape == whole.shape
    assert np.abs(fast - whole).mean() < 1.0  # of 255: the table of colours
    assert whole.std() > 10.0


def test_html_and_notebooks(moving, tmp_path):
    moving.save(tmp_path / "run.html", dpi=40)
    page = (tmp_path / "run.html").read_text()
    assert page.startswith("<!doctype html>")
    assert page.count("data:image/png;base64") == moving.frames
    assert list(tmp_path.iterdir()) == [tmp_path / "run.html"]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_mp4(moving, tmp_path):
    moving.save(tmp_path / "run.mp4", dpi=60)
    assert (tmp_path / "run.mp4").read_bytes()[4:8] == b"ftyp"


@pytest.mark.parametrize("ending", ["gif", "mp4", "html"])
def test_what_ends_early_leaves_no_file(moving, tmp_path, ending):
    if ending == "mp4" and shutil.which("ffmpeg") is None:
        pytest.skip("needs ffmpeg")

    def stop(done):
        if done >= 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        moving.save(tmp_path / f"run.{ending}", dpi=40, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_without_ffmpeg_one_sentence_says_so(moving, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "_ffmpeg", lambda: None)
    with pytest.raises(mi.InvalidParameter, match="pip install imageio-ffmpeg, or take"):
        moving.save(tmp_path / "run.mp4")
    with pytest.raises(mi.InvalidParameter, match=r"\.mp4, \.gif or \.html"):
        moving.save(tmp_path / "run.avi")


def test_the_device_is_true_to_scale(device):
    moving = mi.animate(device, 9, per_period=20)
    above, below = moving.figure.axes
    frames = device.samples(20, 9)
    block = next(p for p in above.patches if p.get_facecolor()[2] > 0.6 > p.get_facecolor()[0])
    stoppers = [p for p in above.patches if p.get_facecolor()[:3] == pytest.approx((0.45,) * 3)]
    factor = float(above.texts[0].get_text().split("× ")[1])
    for number in (0, 13, -1):
        moving.frame(number)
        x1, x2 = frames["x1"].iloc[number] - frames["x1"].iloc[0], frames["x2"].iloc[number]
        right = max(stoppers, key=lambda p: p.get_x())
        gap = right.get_x() - block.get_x() - block.get_width()
        assert gap == pytest.approx(0.5 - x2)  # delta - x2, in gaps d = 1
        assert block.get_x() == pytest.approx(-1.0 + x2 + factor * x1)
        # The parts that move carry their names with them.
        labels = {text.get_text(): text.get_position()[0] for text in above.texts[1:]}
        assert set(labels) == {"block", "frame", "stopper"}
        assert labels["block"] == pytest.approx(x2 + factor * x1)
        assert labels["frame"] == pytest.approx(factor * x1)
    assert below.lines[0].get_ydata()[-1] == pytest.approx(x1)
    assert below.get_ylabel().startswith("frame $x_1$")


def test_a_run_without_forcing_and_wrong_arguments(falling, run):
    moving = mi.animate(falling, per_period=10)
    assert 55 <= moving.frames <= 70
    assert "t = 0 s" in moving.figure.axes[0].texts[0].get_text()
    with pytest.raises(mi.InvalidParameter, match="a Run"):
        mi.animate(run.events)
    with pytest.raises(mi.InvalidParameter, match="one of x, v, t"):
        mi.animate(run, x="x2")
    with pytest.raises(mi.InvalidParameter, match="> 0"):
        mi.animate(run, per_period=0)
    with pytest.raises(mi.InvalidParameter, match="at least two frames apart"):
        mi.animate(run, 99, 99.001)
