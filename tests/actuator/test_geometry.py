"""Devices from a drawing and a process, by finite elements, fields and closed forms."""

from __future__ import annotations

import math
import warnings
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.sparse import coo_array, diags_array, kron
from scipy.sparse.linalg import spsolve

import mems_impact as mi

UM = 1e-6
FOLDED = mi.FoldedBeams(count=4, length="250 um", width="3 um")
CRAB = mi.CrabLegs(count=4, length="150 um", width="2.4 um", shin_length="60 um", shin_width="3 um")
COMB = mi.CombFingers(
    count=60, length="40 um", width="3 um", gap="3 um", overlap="20 um", tip_gap="15 um"
)
GAPS = mi.GapClosingFingers(
    count=70, length="86.5 um", width="5 um", gap="5 um", back_gap="8 um", overlap="76.5 um",
    sides="right",
)  # fmt: skip
PROCESS = {
    "thickness": "25 um", "youngs_modulus": "169 GPa", "density": 2330, "substrate_gap": "2 um",
}  # fmt: skip
REST = {"frame_mass": "0.1 mg", "friction": 0.3, "restitution": 0.6}
DRIVE = mi.Sine(amplitude=30, frequency="4 kHz")


def geometry(**changes):
    block = mi.Plate(length="400 um", width="100 um")
    given = {"springs": FOLDED, "block": block, "electrodes": COMB, "travel": "5 um"}
    return mi.Geometry(**{**PROCESS, **given, **changes})


def device(**changes):
    return mi.Actuator.from_design(geometry=geometry(**changes), **REST)


def finding(made, name):
    return made.datasheet.geometry.loc[name, "value"]


# --- Beams


def frame(nodes, beams, held, moved, elements=8):
    """Return force and reduced mass of a plane frame at a unit deflection of a degree of freedom.

    Euler-Bernoulli beams (start, end, width) of unit thickness, modulus and density; `held` and
    `moved` are degrees of freedom (node, component) of x, y and rotation.
    """
    points = [np.array(node, dtype=float) for node in nodes]
    parts = []
    for start, end, width in beams:
        inner = range(len(points), len(points) + elements - 1)
        along = np.linspace(points[start], points[end], elements + 1)[1:-1]
        points += list(along)
        chain = [start, *inner, end]
        parts += [(*pair, width) for pair in pairwise(chain)]
    size = 3 * len(points)
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for start, end, width in parts:
        way = points[end] - points[start]
        h = np.linalg.norm(way)
        c, s = way / h
        bending, axial = width**3 / 12.0, width
        k, m = np.zeros((6, 6)), np.zeros((6, 6))
        across, lengthwise = np.ix_((1, 2, 4, 5), (1, 2, 4, 5)), np.ix_((0, 3), (0, 3))
        k[across] = bending / h**3 * np.array(
            [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
             [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
        )  # fmt: skip
        m[across] = width * h / 420 * np.array(
            [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
             [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]]
        )  # fmt: skip
        k[lengthwise] = axial / h * np.array([[1, -1], [-1, 1]])
        m[lengthwise] = width * h / 6 * np.array([[2, 1], [1, 2]])
        turn = np.kron(np.eye(2), [[c, s, 0], [-s, c, 0], [0, 0, 1]])
        at = np.ix_(*[[3 * node + i for node in (start, end) for i in range(3)]] * 2)
        stiffness[at] += turn.T @ k @ turn
        mass[at] += turn.T @ m @ turn
    fixed = [3 * node + component for node, component in held]
    given = 3 * moved[0] + moved[1]
    free = [i for i in range(size) if i not in {*fixed, given}]
    shape = np.zeros(size)
    shape[given] = 1.0
    shape[free] = -np.linalg.solve(stiffness[np.ix_(free, free)], stiffness[free, given])
    return shape @ stiffness @ shape, shape @ mass @ shape


CLAMP = [(0, 0), (0, 1), (0, 2)]


@pytest.mark.parametrize("recess", [0.0, 0.2])
def test_suspensions_are_those_of_plane_frames(recess):
    width, length = 3.0 - 2 * recess, 250.0 + 2 * recess
    # Anchor, truss, and the block, which is held in y and in rotation.
    block = [(2, 1), (2, 2), (1, 2)]
    folded = frame(
        [(0, 0), (0, length), (0, 0)], [(0, 1, width), (1, 2, width)], [*CLAMP, *block], (2, 0)
    )
    clamped = frame([(0, 0), (0, length)], [(0, 1, width)], [*CLAMP, (1, 1), (1, 2)], (1, 0))
    shin, thigh = 60.0 + recess, 150.0 + recess
    crab = frame(
        [(0, 0), (0, shin), (thigh, shin)],
        [(0, 1, 3.0 - 2 * recess), (1, 2, 2.4 - 2 * recess)],
        [*CLAMP, (1, 1), (2, 0), (2, 2)],
        (2, 1),
    )
    springs = mi.ClampedBeams(count=2, length="250 um", width="3 um", axially="free")
    cases = (FOLDED, folded, 4), (springs, clamped, 2), (CRAB, crab, 4)
    for springs, (stiffness, mass), count in cases:
        made = device(springs=springs, undercut=recess * UM)
        # Beams of the formulas are inextensible.
        assert made.k == pytest.approx(count * stiffness * 169e9 * 25 * UM, rel=2e-3)
        suspended = finding(made, "mass of the suspension")
        assert suspended == pytest.approx(count * mass * 2330 * 25 * UM**3, rel=2e-3)


def test_side_stiffness_is_that_of_beam_columns():
    """A pair of beams with a small tension and the opposite compression, at a deflection."""
    side, travel = finding(device(), "side stiffness at the stopper"), 5.0
    length, width = 250.0, 3.0
    bending = width**3 / 12.0

    def shortened(tension, deflection):
        """Return force and shortening of a guided beam."""
        k = np.sqrt(complex(tension / bending))
        x = np.linspace(0.0, length, 2001)
        slope = (1.0 - np.cosh(k * (0.5 * length - x)) / np.cosh(0.5 * k * length)).real
        slope *= deflection / np.trapezoid(slope, x)
        force = (
            tension
            * deflection
            / np.trapezoid(
                1.0 - np.cosh(k * (0.5 * length - x)).real / np.cosh(0.5 * k * length).real, x
            )
        )
        return force, 0.5 * np.trapezoid(slope**2, x)

    tension = 1e-3 * bending / length**2 * 10.0
    soft = shortened(-tension, 1.0)[0]
    stiff = shortened(tension, 1.0)[0]
    inner, outer = travel * soft / (soft + stiff), travel * stiff / (soft + stiff)
    moved = shortened(-tension, outer)[1] - shortened(tension, inner)[1]
    moved += 2.0 * tension * length / width
    assert side == pytest.approx(4.0 * tension / moved * 169e9 * 25 * UM, rel=1e-3)


@pytest.mark.parametrize(("deflection", "rtol"), [(0.3, 2e-4), (3.0, 0.011), (6.0, 0.055)])
def test_clamped_beams_stretch(deflection, rtol):
    made = device(springs=mi.ClampedBeams(count=2, length="250 um", width="3 um"))
    length, width = 250.0, 3.0
    bending = width**3 / 12.0

    def rates(x, y, p):
        # Deflection, slope, moment, shear and elongation of a beam with the tension p.
        return np.array([y[1], y[2] / bending, p[0] * y[1] - y[3], 0 * x, 0.5 * y[1] ** 2])

    def ends(start, end, p):
        stretch = end[4] - p[0] * length / width
        return np.array([start[0], start[1], start[4], end[0] - deflection, end[1], stretch * 1e3])

    x = np.linspace(0.0, length, 41)
    s = x / length
    guess = [
        deflection * (3 * s**2 - 2 * s**3),
        deflection * 6 * s * (1 - s) / length,
        0 * x,
        0 * x,
        0 * x,
    ]
    found = solve_bvp(rates, ends, x, np.array(guess), [1e-4], tol=1e-6)
    assert found.success
    force = 2.0 * abs(found.y[3, 0]) * 169e9 * 25 * UM * UM
    cubic = made.term("cubic_stiffness").k3
    x2 = deflection * UM
    assert made.k * x2 + cubic * x2**3 == pytest.approx(force, rel=rtol)


@pytest.mark.parametrize(("tension", "rtol"), [(-5.0, 0.01), (10.0, 0.01), (40.0, 0.03)])
def test_clamped_beams_under_residual_stress(tension, rtol):
    springs = mi.ClampedBeams(count=2, length="250 um", width="3 um")
    stress = tension * 169e9 * 3.0**2 / 12.0 / 250.0**2
    root = np.sqrt(complex(tension))
    exact = (tension / (1.0 - 2.0 / root * np.tanh(0.5 * root))).real
    loose = device(springs=springs).k
    assert device(springs=springs, residual_stress=stress).k / loose == pytest.approx(
        exact / 12.0, rel=rtol
    )
    free = springs.replace(axially="free")
    assert device(springs=free, residual_stress=stress).k == loose


# --- Fields between fingers


def field_capacitance(width, right, left, thickness, step):
    """Return the capacitance of a finger per length, by differences, in permittivities.

    The cell reaches from the middle of one neighbour to that of the other, and from the middle of
    the layer to where the field has decayed.
    """

    def count(size):
        return round(size / step)

    ends = np.cumsum([count(each) for each in (width / 2, left, width, right, width / 2)])
    deep = count(thickness / 2)
    volts = np.full((deep + count(2.0 * (width + max(left, right))) + 1, ends[-1] + 1), np.nan)
    volts[: deep + 1, : ends[0] + 1] = volts[: deep + 1, ends[3] :] = 0.0
    volts[: deep + 1, ends[1] : ends[2] + 1] = 1.0
    free = np.isnan(volts)
    number = np.where(free, np.cumsum(free).reshape(volts.shape) - 1, -1)
    half = [np.ones(size) for size in volts.shape]
    for each in half:
        each[[0, -1]] = 0.5
    pairs = []
    for axis in (0, 1):
        first, second = np.delete(number, -1, axis), np.delete(number, 0, axis)
        weight = np.broadcast_to(half[1] if axis == 0 else half[0][:, None], first.shape)
        of_first, of_second = np.delete(volts, -1, axis), np.delete(volts, 0, axis)
        pairs.append([a.ravel() for a in (first, second, weight, of_first, of_second)])
    first, second, weight, start, end = (np.concatenate(each) for each in zip(*pairs, strict=True))
    size = int(free.sum())
    inner = (first >= 0) & (second >= 0)
    matrix = coo_array((weight[inner], (first[inner], second[inner])), shape=(size, size))
    diagonal, load = np.zeros(size), np.zeros(size)
    for one, other, given in ((first, second, end), (second, first, start)):
        np.add.at(diagonal, one[one >= 0], weight[one >= 0])
        edge = (one >= 0) & (other < 0)
        np.add.at(load, one[edge], weight[edge] * given[edge])
    solved = spsolve((diags_array(diagonal) - matrix - matrix.T).tocsc(), load)
    start[first >= 0], end[second >= 0] = solved[first[first >= 0]], solved[second[second >= 0]]
    return 2.0 * float(np.sum(weight * (start - end) ** 2))


@pytest.mark.parametrize(
    ("width", "front", "back", "rtol"), [(3.0, 3.0, None, 1e-3), (5.0, 2.0, 8.0, 4e-3)]
)
def test_capacitance_of_fingers_is_that_of_their_field(width, front, back, rtol):
    coarse, fine = (
        field_capacitance(width, front, back or front, 25.0, step) for step in (0.5, 0.25)
    )
    field = fine + (fine - coarse) / (2.0 ** (4.0 / 3.0) - 1.0)  # singular at the edges
    sizes = {"count": 10, "width": width * UM, "gap": front * UM, "length": "60 um"}
    if back is None:
        fingers = mi.CombFingers(**sizes, overlap="20 um", tip_gap="30 um")
        length = 20 * UM
    else:
        fingers = mi.GapClosingFingers(**sizes, overlap="50 um", back_gap=back * UM)
        length = 50 * UM
    made = device(electrodes=fingers, travel="0.5 um")
    expected = 10 * length * 8.8541878188e-12 * field
    assert made.datasheet["capacitance"] == pytest.approx(expected, rel=rtol)
    plates = 25.0 / front + 25.0 / (back or front)
    assert field > 1.05 * plates


# --- Films


def test_films_of_gap_closing_fingers():
    """Reynolds' equation by differences in the rectangle between two fingers."""
    made = device(electrodes=GAPS, travel="4 um", substrate_gap=None, free_path_pressure=0.0)
    n, m = 40, 120
    dx, dy = 25 * UM / n, 76.5 * UM / m

    def second(size, step):
        return (
            diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(size - 1, size - 1)) / step**2
        )

    eye = [diags_array(np.ones(size - 1)) for size in (n, m)]
    laplacian = kron(second(n, dx), eye[1]) + kron(eye[0], second(m, dy))
    pressure = spsolve(laplacian.tocsc(), -np.full((n - 1) * (m - 1), 12 * 1.82e-5 / (5 * UM) ** 3))
    damping = 70 * pressure.sum() * dx * dy
    assert finding(made, "damping in front gaps at rest") == pytest.approx(damping, rel=2e-3)
    # The term, at slow motion: half a period of free decay is too short, so by its own statics.
    film = made.term("squeeze_film")
    alone = 1.0 - 192.0 / math.pi**5 * film.width / film.length * sum(
        math.tanh(0.5 * math.pi * k * film.length / film.width) / k**5 for k in (1, 3, 5)
    )
    strip = 1.82e-5 * film.length * film.width**3 * alone / (5 * UM) ** 3
    assert strip == pytest.approx(damping, rel=2e-3)
    assert made.c == pytest.approx(damping * (5.0 / 8.0) ** 3, rel=2e-3)
    assert device(viscosity=0).c == 0.0


@pytest.mark.parametrize(
    ("side", "gap", "thickness", "rtol"),
    [(2.0, 2.0, 2.0, 0.05), (4.0, 1.0, 15.0, 0.07), (6.0, 2.0, 2.0, 0.1), (4.0, 4.0, 2.0, 0.2)],
)
def test_film_below_a_plate_with_holes(side, gap, thickness, rtol):
    """Reynolds' equation by differences around 8 times 8 holes of a pitch of 10 um."""
    count, cell, pitch, viscosity = 8, 20, 10.0, 1.82e-5
    made = device(
        thickness=thickness * UM, free_path_pressure=0.0, travel="0.5 um",
        springs=mi.ClampedBeams(count=4, length="100 um", width="8 um"),
        block=mi.Plate(
            length="80 um", width="80 um", holes=64, hole_length=side * UM, hole_width=side * UM
        ),
        electrodes=mi.PlateElectrode(length="80 um", width="80 um", gap=gap * UM),
    )  # fmt: skip
    film = made.term("squeeze_film")
    strip = film.length / film.width  # its ends matter little
    alone = 1.0 - 0.63 / strip
    damping = made.c + viscosity * film.length * film.width**3 * alone / (gap * UM) ** 3

    place = np.arange(count * cell)
    edge = round(0.5 * (cell - side / pitch * cell))
    inside = (place % cell >= edge) & (place % cell < cell - edge)
    hole = inside[:, None] & inside
    number = np.full(hole.shape, -1)
    solid = int((~hole).sum())
    number[~hole] = np.arange(solid)
    number[hole] = solid + ((place // cell)[:, None] * count + place // cell)[hole]
    size = solid + count * count
    flow = (gap * UM) ** 3 / (12.0 * viscosity)  # between neighbours, by their pressures
    diagonal = np.zeros(size)
    pairs = []
    for axis in (0, 1):
        first, second = np.delete(number, -1, axis).ravel(), np.delete(number, 0, axis).ravel()
        apart = first != second
        first, second = first[apart], second[apart]
        weight = np.where(np.maximum(first, second) >= solid, 2.0 * flow, flow)
        for one in (first, second):
            np.add.at(diagonal, one, weight)
        pairs.append(coo_array((weight, (first, second)), shape=(size, size)))
    for side_of_plate in (number[0], number[-1], number[:, 0], number[:, -1]):
        np.add.at(diagonal, side_of_plate, 2.0 * flow)
    radius = 0.547 * side * UM
    pipe = 8.0 * viscosity * (thickness * UM + 0.375 * math.pi * radius) / (math.pi * radius**4)
    diagonal[solid:] += 1.0 / pipe
    area = np.bincount(number.ravel(), minlength=size) * (pitch / cell * UM) ** 2
    links = pairs[0] + pairs[1]
    pressure = spsolve((diags_array(diagonal) - links - links.T).tocsc(), area)
    assert damping == pytest.approx(pressure @ area, rel=rtol)


# --- Motion out of the plane

ABOVE = {
    "thickness": "2 um", "travel": "1.5 um", "undercut": "0.1 um", "free_path_pressure": 0.0,
    "springs": mi.ClampedBeams(count=4, length="100 um", width="8 um"),
    "block": mi.Plate(length="200 um", width="150 um"),
    "electrodes": mi.PlateElectrode(length="180 um", width="130 um", gap="2.5 um", spread="220 um"),
}  # fmt: skip


@pytest.mark.parametrize("springs", ["clamped_beams", "folded_beams"])
def test_beams_bend_out_of_the_plane(springs):
    """As plane frames of beams as deep as the layer; trusses may turn."""
    kind = mi.ClampedBeams if springs == "clamped_beams" else mi.FoldedBeams
    made = device(**{**ABOVE, "springs": kind(count=4, length="100 um", width="8 um")})
    length, breadth = 100.2, 7.8
    if springs == "clamped_beams":
        stiffness, mass = frame(
            [(0, 0), (0, length)], [(0, 1, 2.0)], [*CLAMP, (1, 1), (1, 2)], (1, 0)
        )
    else:
        nodes, beams = [(0, 0), (0, length), (0, 0)], [(0, 1, 2.0), (1, 2, 2.0)]
        stiffness, mass = frame(nodes, beams, [*CLAMP, (2, 1), (2, 2)], (2, 0))
    assert made.k == pytest.approx(4 * stiffness * 169e9 * breadth * UM, rel=1e-9)
    suspended = finding(made, "mass of the suspension")
    assert suspended == pytest.approx(4 * mass * 2330 * breadth * UM**3, rel=1e-9)


def test_a_plate_above_its_electrode():
    made = device(**ABOVE)
    assert (made.d, made.delta) == pytest.approx((2.5 * UM, 1.5 * UM), rel=1e-12)
    area = 179.8 * 129.8 * UM**2
    assert made.alpha == pytest.approx(0.5 * 8.8541878188e-12 * area)
    film = made.term("squeeze_film")
    assert (film.length, film.width) == pytest.approx((199.8 * UM, 149.8 * UM))
    assert made.c == 0.0
    stretching = made.term("cubic_stiffness")
    positions = np.linspace(0.0, made.delta, 20_001)
    spring = made.k * positions + stretching.k3 * positions**3
    volts = np.sqrt(spring / made.alpha) * (made.d - positions)
    assert mi.pull_in_voltage(made) == pytest.approx(volts.max(), rel=1e-7)
    thicker = made.changed(**{"geometry.thickness": "2.2 um"})
    assert thicker.k / made.k == pytest.approx(1.1**3)
    with pytest.raises(mi.InvalidParameter, match="crab legs would twist"):
        device(**{**ABOVE, "springs": CRAB})


def test_a_plate_wider_than_its_springs_tilts():
    narrow = ABOVE["electrodes"].replace(spread="100 um")
    with pytest.warns(mi.ValidityWarning, match="electrode by the spread of the springs"):
        device(**{**ABOVE, "electrodes": narrow}).under(DRIVE)


def test_a_liquid_in_the_gaps():
    dry, wet = (
        device(electrodes=GAPS, travel="4 um"),
        device(electrodes=GAPS, travel="4 um", relative_permittivity=80.0),
    )
    assert wet.datasheet["capacitance"] == pytest.approx(80 * dry.datasheet["capacitance"])
    assert mi.pull_in_voltage(wet) == pytest.approx(mi.pull_in_voltage(dry) / 80**0.5)
    assert device(relative_permittivity=80.0).datasheet["capacitance"] == pytest.approx(
        80 * device().datasheet["capacitance"]
    )


# --- Process


def test_a_corner_of_the_process_moves_all_numbers_together():
    made = device(undercut="0.2 um")
    for name, value, drawn in (
        ("undercut", "0.3 um", {"undercut": "0.3 um"}),
        ("thickness", "27 um", {"thickness": "27 um"}),
        ("springs.width", "2.9 um", {"springs": FOLDED.replace(width="2.9 um")}),
    ):
        expected = device(**{"undercut": "0.2 um", **drawn})
        changed = made.changed(**{f"geometry.{name}": value})
        assert changed == expected.replace(alpha=made.alpha)  # a scale only
        system = made.under(DRIVE).changed(**{f"geometry.{name}": value})
        assert system.actuator == changed
        number = expected.geometry.numbers[f"geometry.{name}"]
        varied = made.under(DRIVE).numbers({f"geometry.{name}": number})
        moved = system.restored({}, made.scales).numbers()
        assert varied.parameters == pytest.approx(moved.parameters, rel=1e-13)
    corner = made.changed(**{"geometry.undercut": "0.3 um"})
    assert corner.k / made.k == pytest.approx((2.4 / 2.6) ** 3 * (250.4 / 250.6) ** 3, rel=1e-12)
    assert corner.delta - made.delta == pytest.approx(0.2 * UM)
    assert corner.term("comb_drive").gap == pytest.approx(3.6 * UM)


def test_measured_numbers_keep_their_place():
    made = mi.Actuator.from_design(geometry=geometry(), frequency="8 kHz", quality=30, **REST)
    assert made.datasheet["frequency"] == pytest.approx(8e3)
    assert made.datasheet["quality"] == pytest.approx(30)
    drawn = device()
    change = {"geometry.undercut": "0.1 um"}
    for name in ("k", "c", "m2"):
        ratio = getattr(drawn.changed(**change), name) / getattr(drawn, name)
        assert getattr(made.changed(**change), name) / getattr(made, name) == pytest.approx(ratio)
    assert made.changed(k=5.0, **change).k == 5.0
    film = mi.SqueezeFilm(
        length=2e-4, width=1e-4, pressure=1e2, viscosity=1.82e-5, free_path_pressure=6.7e-3
    )
    own = mi.Actuator.from_design(
        geometry=geometry(electrodes=GAPS, travel="4 um"), terms=[film], **REST
    )
    assert own.term("squeeze_film") == film
    assert own.without("tabulated_capacitance").changed(**change).geometry.undercut == 1e-7


def test_tolerances_of_a_process():
    made = device(undercut="0.2 um")
    drawn = mi.tolerance_analysis(
        made, DRIVE, over={"geometry.undercut": "0.05 um", "geometry.thickness": "uniform: 2%"},
        samples=2, recurrence=mi.RecurrenceOptions(transient=1, periods=1, exponents="none"),
        options=mi.Options(engine="interpreted"),  # nothing to compile for so short runs
    )  # fmt: skip
    assert drawn.drawn == ("geometry.undercut", "geometry.thickness")
    assert (drawn.points["status"] == "ok").all()


@pytest.mark.slow
def test_an_undercut_is_fitted_to_a_voltage():
    made = mi.load_actuator("rauf2022")
    volts = mi.pull_in_voltage(made.changed(**{"geometry.undercut": "0.4 um"}))
    target = mi.Target(quantity="pull-in voltage", value=volts)
    found = mi.fit(made, [target], ["geometry.undercut"])
    assert found.parameters["fitted"].tolist() == pytest.approx([0.4 * UM], rel=1e-6)


def test_files_and_copies(tmp_path):
    made = device(electrodes=GAPS, travel="4 um", undercut="0.2 um")
    assert mi.Actuator.from_design(**made.datasheet) == made
    path = tmp_path / "device.mi"
    run = mi.simulate(made, DRIVE, periods=2)
    run.save(path)
    assert mi.load(path).actuator == made
    text = """
        [design]
        frame_mass = "0.1 mg"
        friction = 0.3
        restitution = 0.6
        [geometry]
        thickness = "25 um"
        youngs_modulus = "169 GPa"
        density = 2330
        undercut = "0.2 um"
        substrate_gap = "2 um"
        travel = "5 um"
        [geometry.springs]
        kind = "folded_beams"
        count = 4
        length = "250 um"
        width = "3 um"
        [geometry.block]
        length = "400 um"
        width = "100 um"
        [geometry.electrodes]
        kind = "comb_fingers"
        count = 60
        length = "40 um"
        width = "3 um"
        gap = "3 um"
        overlap = "20 um"
        tip_gap = "15 um"
        """
    (tmp_path / "device.toml").write_text(text)
    assert mi.load_actuator(tmp_path / "device.toml") == device(undercut="0.2 um")
    (tmp_path / "device.toml").write_text(text.replace("folded_beams", "coils"))
    with pytest.raises(mi.InvalidParameter, match=r"kind = 'coils': must be one of folded_beams"):
        mi.load_actuator(tmp_path / "device.toml")


def test_drawings_that_cannot_be():
    with pytest.raises(mi.InvalidParameter, match=r"folded_beams\.width = 3e-06: must be above tw"):
        geometry(undercut="1.5 um")
    with pytest.raises(
        mi.InvalidParameter, match=r"travel = 2e-05: .* below the gap of 1\.5e-05 m"
    ):
        geometry(travel="20 um")
    with pytest.raises(mi.InvalidParameter, match="holes = 5: must be with less area"):
        mi.Plate(length=1e-4, width=1e-4, holes=5, hole_length=5e-5, hole_width=5e-5)
    with pytest.raises(mi.InvalidParameter, match="geometry = 'flat': must be a Geometry"):
        mi.Actuator.from_design(geometry="flat", **REST)
    with pytest.raises(
        mi.InvalidParameter, match=r"geometry\.undercut: the device has no geometry"
    ):
        mi.load_actuator("mita2003").changed(**{"geometry.undercut": 1e-7})
    with pytest.raises(mi.InvalidParameter, match=r"must be one of geometry\.thick"):
        device().changed(**{"geometry.overcut": 1e-7})


# --- Where the model ends


def messages(make):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        make()
    return [str(each.message) for each in caught if each.category is mi.ValidityWarning]


def test_warnings_where_the_model_ends():
    stiff = mi.ClampedBeams(count=2, length="41 um", width="3 um")
    weak = device(springs=stiff)
    found = messages(lambda: weak.under(DRIVE))
    assert any(each.startswith("stress at the stopper") for each in found)
    assert any(each.startswith("deflection at the stopper by length = 0.122") for each in found)
    high = mi.Sine(amplitude=260, frequency="4 kHz")
    found = messages(lambda: device().under(high))
    assert [each.split(":")[0] for each in found] == [
        "the drive reaches 260 V, above the breakdown of the narrowest gap, 248 V"
    ]
    soft = mi.FoldedBeams(count=4, length="900 um", width="1.5 um")
    found = messages(lambda: device(springs=soft, travel="12 um").under(high))
    assert any("side instability at the stopper" in each for each in found)
    slender = GAPS.replace(width=2.5 * UM)
    found = messages(lambda: device(electrodes=slender, travel="4 um").under(high))
    assert any("bending of fingers" in each for each in found)
    plate = mi.load_actuator("mita2003")
    found = messages(lambda: plate.under(mi.Sine(amplitude=250, frequency="100 Hz")))
    assert [each.split(":")[0] for each in found] == [
        "the drive reaches 250 V, above the breakdown of the narrowest gap, 206 V"
    ]
    assert messages(lambda: plate.under(mi.Sine(amplitude=100, frequency="100 Hz"))) == []


def test_fingers_snap_to_the_side_where_the_field_is_stiffer_than_the_beams():
    made = device()
    side, volts = (
        finding(made, f"{name} at the stopper") for name in ("side stiffness", "side instability")
    )

    def energy(shift):
        gaps = 3 * UM - shift, 3 * UM + shift
        area = 60 * 25 * UM * 25 * UM  # overlap and travel
        return 0.5 * side * shift**2 - 0.5 * 8.8541878188e-12 * area * volts**2 * sum(
            1.0 / gap for gap in gaps
        )

    h = 0.01 * UM
    curvature = (energy(h) - 2.0 * energy(0.0) + energy(-h)) / h**2
    assert abs(curvature) < 1e-3 * side


def test_stroke_of_a_comb_drive_before_it_snaps_to_a_side():
    """M. Olfatnia, S. Sood, J. J. Gorman, S. Awtar, J. Microelectromech. Syst. 22, 483 (2013).

    Paired double parallelograms with beams of 1 mm and gaps of 3 um have a stroke of 50 um. Beside
    these lengths it depends on the overlap alone, which the abstract does not state: 48 um at an
    overlap of 60 um, 55 um at 20 um.
    """
    comb = mi.CombFingers(
        count=100, length="150 um", width="6 um", gap="3 um", overlap="60 um", tip_gap="90 um"
    )
    springs = mi.FoldedBeams(count=4, length="1 mm", width="3 um")

    def excess(stroke):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mi.ValidityWarning)
            made = device(thickness="50 um", springs=springs, electrodes=comb, travel=stroke)
            volts = mi.resting_voltage(made)
        return volts / finding(made, "side instability at the stopper") - 1.0

    assert brentq(excess, 20 * UM, 59 * UM, xtol=1e-8) == pytest.approx(50 * UM, rel=0.1)
