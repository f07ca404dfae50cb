"""Maps over two parameters, from tables made by hand."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.figure import Figure

import mems_impact as mi
from mems_impact.plotting.maps import MOTIONS, PERIOD_COLORS
from mems_impact.tables import with_units
from tests.analysis.systems import oscillator

X, Y = [0.1, 0.2, 0.4], [1.0, 2.0]
KINDS = ["off", "resting", "periodic", "periodic", "chaotic", "failed"]


def map_table(kinds=KINDS, periods=(1, 0, 1, 2, 0, 0), x=X, y=Y, **more):
    """The table of a map with these motions, the values of x first."""
    count = len(x) * len(y)
    speed = np.where(np.isin(kinds, ["off", "resting"]), 0.0, np.arange(count) + 1.0)
    table = pd.DataFrame(
        {
            "amplitude": np.tile(x, len(y)),
            "omega": np.repeat(y, len(x)),
            "motion": np.array(kinds, dtype=object),
            "period": periods,
            "speed": np.where(np.array(kinds) == "failed", np.nan, speed),
            "status": "ok",
            **more,
        }
    )
    table.attrs = {"units": {"amplitude": "V", "speed": "m/s"}, "symbols": {"amplitude": "$f$"}}
    return table


def words(ax):
    """What the legend says, row by row."""
    ax.figure.draw_without_rendering()
    texts = ax.get_legend().get_texts()
    places = [text.get_window_extent() for text in texts]
    order = sorted(range(len(texts)), key=lambda i: (-round(places[i].y0 / 8), places[i].x0))
    return [texts[i].get_text() for i in order]


def cells(ax, x, y):
    """The legend's labels of what is drawn at a point: one for each mesh that has a cell there."""
    found = []
    handles = {handle.get_label(): handle for handle in ax.get_legend().legend_handles}
    for mesh in ax.collections:
        if type(mesh).__name__ != "QuadMesh":
            continue
        corners, values = mesh.get_coordinates(), mesh.get_array()
        i = np.searchsorted(corners[0, :, 0], x) - 1
        j = np.searchsorted(corners[:, 0, 1], y) - 1
        if not np.ma.getmaskarray(values)[j, i]:
            color = mesh.cmap(0)
            found += [name for name, each in handles.items() if each.get_facecolor() == color]
    return found


def test_kinds_of_motions(tmp_path):
    ax = mi.plot_map(map_table())
    assert words(ax) == ["no impacts", "resting", "period 1", "2", "chaotic", "failed"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("amplitude $f$ [mV]", "$\\omega$")
    assert cells(ax, 0.4, 1.0) == ["period 1"]
    assert cells(ax, 0.1, 2.0) == ["2"]
    assert cells(ax, 0.2, 2.0) == ["chaotic"]
    ax.figure.savefig(tmp_path / "map.png")
    assert ax.figure.get_size_inches()[0] == 3.4
    texts = [*ax.get_xticklabels(), *ax.get_yticklabels(), *ax.get_legend().get_texts()]
    texts += [ax.xaxis.label, ax.yaxis.label]
    assert min(text.get_fontsize() for text in texts) >= 7.0


def test_cells_end_halfway_to_their_neighbours():
    mesh = mi.plot_map(map_table()).collections[0]
    np.testing.assert_allclose(mesh.get_coordinates()[0, :, 0], [0.05, 0.15, 0.3, 0.5])
    np.testing.assert_allclose(mesh.get_coordinates()[:, 0, 1], [0.5, 1.5, 2.5])


def test_values_in_any_order_are_drawn_where_they_are():
    table = map_table(x=[0.4, 0.1, 0.2], kinds=["off", "chaotic", "off"] * 2, periods=1)
    ax = mi.plot_map(table)
    assert cells(ax, 0.1, 1.0) == cells(ax, 0.1, 2.0) == ["chaotic"]
    assert cells(ax, 0.2, 1.0) == ["no impacts"]


def test_one_value_alone():
    ax = mi.plot_map(map_table(["off"], [1], x=[0.0], y=[2.0]))
    assert ax.get_xlim() == (-0.05, 0.05)
    np.testing.assert_allclose(ax.get_ylim(), (1.9, 2.1))


def test_long_periods_share_a_colour():
    one = mi.plot_map(map_table(["periodic"] * 6, [1, 2, 3, 4, 7, 1]))
    assert words(one) == ["period 1", "2", "3", "4", "7"]
    more = mi.plot_map(map_table(["periodic"] * 6, [1, 2, 16, 6, 7, 1]))
    assert words(more) == ["period 1", "2", "≥ 6"]
    assert cells(more, 0.4, 1.0) == cells(more, 0.2, 2.0) == ["≥ 6"]


def lightness(color):
    """CIE L* of a colour."""
    rgb = np.array(to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    return 116.0 * np.cbrt(luminance) - 16.0


def test_kinds_differ_in_grey():
    """By lightness, or by a hatching of their own."""
    plain = [paint.color for paint in MOTIONS.values() if not paint.hatch]
    steps = np.diff(sorted(lightness(color) for color in (*plain, *PERIOD_COLORS)))
    assert steps.min() > 9.0
    hatches = [paint.hatch for paint in MOTIONS.values() if paint.hatch]
    assert len(set(hatches)) == len(hatches)
    for paint in MOTIONS.values():
        if paint.hatch:
            assert abs(lightness(paint.color) - lightness(paint.ink)) > 20.0
    # Blue against yellow to purple: no pair of red and green.
    assert all(0.5 < rgb_to_hsv(to_rgb(color))[0] < 0.7 for color in PERIOD_COLORS)


@pytest.mark.slow
def test_a_column(tmp_path):
    ax = mi.plot_map(map_table(), "speed")
    above, bar = ax.figure.axes
    assert above is ax
    assert bar.get_ylabel() == "speed [m/s]"
    shown = ax.collections[-1].get_array()
    np.testing.assert_array_equal(shown.mask, [[True, True, False], [False, False, True]])
    np.testing.assert_array_equal(shown.compressed(), [3.0, 4.0, 5.0])
    assert words(ax) == ["no impacts, resting, failed"]
    ax.figure.savefig(tmp_path / "map.png")
    # Where off points have a value it is shown.
    gap = map_table(gap=[0.4, 0.0, np.nan, np.nan, np.nan, np.nan])
    assert mi.plot_map(gap, "gap").collections[-1].get_array().compressed() == [0.4]
    assert mi.plot_map(gap.assign(gap=np.nan), "gap").figure.axes[1:] == []


def test_a_part_of_a_map():
    ax = mi.plot_map(map_table().iloc[:4], ax=Figure().subplots())
    assert cells(ax, 0.4, 2.0) == []
    assert cells(ax, 0.4, 1.0) == ["period 1"]
    assert mi.plot_map(map_table().iloc[:4], "speed").collections[-1].get_array().count() == 2


def test_a_table_from_a_file(tmp_path):
    with_units(map_table()).to_csv(tmp_path / "map.csv", index=False)
    ax = mi.plot_map(pd.read_csv(tmp_path / "map.csv"))
    assert ax.get_xlabel() == "amplitude [mV]"
    assert cells(ax, 0.4, 1.0) == ["period 1"]


class Curved:
    """A curve of continuation, as far as it is drawn."""

    kind = "grazing"
    table = pd.DataFrame(
        {"omega": [1.0, 1.5, 2.0], "amplitude": [0.1, 0.2, 0.3], "admissible": [True, True, False]}
    )


def lines_of(ax, label):
    return next(line for line in ax.lines if line.get_label() == label)


CHART = pd.DataFrame(
    {"boundary": ["on", "on", "off"], "omega": [2.0, 1.0, 1.5], "amplitude": [0.4, 0.2, 0.3]}
)


@pytest.mark.slow
def test_boundaries(tmp_path):
    ax = mi.plot_map(map_table(), boundaries=[Curved(), CHART])
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    assert words(ax)[-3:] == ["grazing", "on", "off"]
    np.testing.assert_array_equal(lines["grazing"], [[0.1, 1.0], [0.2, 1.5], [np.nan, np.nan]])
    np.testing.assert_array_equal(lines["on"], [[0.2, 1.0], [0.4, 2.0]])
    styles = [lines_of(ax, name).get_linestyle() for name in ("grazing", "on", "off")]
    assert styles[2] not in styles[:2]
    np.testing.assert_allclose(ax.get_xlim(), (0.05, 0.5))
    ax.figure.savefig(tmp_path / "map.png")
    for single in (Curved(), CHART):
        assert len(mi.plot_map(map_table(), boundaries=single).lines) >= 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"operating_map": "map"}, "operating_map = 'str': must be an OperatingMap"),
        ({"operating_map": map_table().drop(columns="motion")}, "must be an OperatingMap"),
        ({"operating_map": map_table().iloc[:0]}, "no finished points to draw"),
        ({"column": "status"}, "column = 'status': must be one of period, speed"),
        ({"column": "step"}, "must be one of period, speed"),
        ({"boundaries": [map_table()[["omega"]]]}, "curves over amplitude and omega"),
        ({"boundaries": "grazing"}, "curves over amplitude and omega"),
        ({"boundaries": 3}, "curves over amplitude and omega"),
    ],
)
def test_refused(arguments, sentence):
    with pytest.raises(mi.InvalidParameter, match=sentence):
        mi.plot_map(**{"operating_map": map_table(), **arguments})


def test_motions():
    table = map_table(
        ["off", "periodic", "chaotic", "periodic", "periodic", "off"], [1, 2, 0, 1, 10, 1]
    )
    given = mi.OperatingMap(system=oscillator(), x=("amplitude", X), y=("omega", Y), table=table)
    found = given.motions
    assert found["motion"].to_list() == ["off", "period 1", "period 2", "period 10", "chaotic"]
    assert found["points"].to_list() == [2, 1, 1, 1, 1]
    assert found["share"].sum() == pytest.approx(1.0)
    off = found.iloc[0]
    assert (off["amplitude min"], off["amplitude max"]) == (0.1, 0.4)
    assert (off["omega min"], off["omega max"]) == (1.0, 2.0)
    assert found.attrs["units"] == {"amplitude min": "V", "amplitude max": "V"}


def test_hatching_is_one_path_for_all_cells():
    kinds = ["chaotic", "off", "chaotic", "chaotic", "chaotic", "off"]
    ax = mi.plot_map(map_table(kinds, [0] * 6))
    (region,) = [each for each in ax.patches if each.get_hatch()]
    x, y = sorted(X), sorted(Y)
    found = [kinds[list(X).index(a) + len(X) * list(Y).index(b)] for b in y for a in x]
    inside = [region.get_path().contains_point((a, b)) for b in y for a in x]
    assert inside == [kind == "chaotic" for kind in found]
