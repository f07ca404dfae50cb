"""Normal forms of codimension two of maps that are made from them.

With a change of variables H(w) = T (w + Q(w)), the map H N H^-1 has the normal form N, if Q is
quadratic without the monomials that are resonant. T has columns of unit length that are not
orthogonal, and another direction is contracted.
"""

import itertools

import numpy as np
import pytest

from mems_impact.continuation.codimension_two import (
    RESONANT_FORMS,
    _double_minus,
    _double_plus,
    _generalized_flip,
    _resonant,
)


class Conjugate:
    """A return map with a known normal form, in complex coordinates w and a contracted one.

    `normal(w)` returns the image of all coordinates and its derivatives.
    """

    size = 1.0

    def __init__(self, normal, pairs, quadratic, seed):
        rng = np.random.default_rng(seed)
        self.normal, self.pairs = normal, pairs
        self.quadratic = quadratic
        count = len(pairs)
        vectors = rng.normal(size=(count, count)) + 0.0j
        done = set()
        for i, j in enumerate(pairs):
            if i == j:
                vectors[:, i] = vectors[:, i].real * (1 if vectors[:, i].real.sum() >= 0 else -1)
            elif j not in done:
                vectors[:, i] += 1j * rng.normal(size=count)
                vectors[:, j] = np.conj(vectors[:, i])
            done.add(i)
        self.vectors = vectors / np.linalg.norm(vectors, axis=0)
        self.jacobian = self.jacobian_at(np.zeros(count))

    def bend(self, w):
        """Return w + Q(w) and its derivatives."""
        value, by = w.astype(complex), np.eye(len(w), dtype=complex)
        for k, i, j, factor in self.quadratic:
            value[k] += factor * w[i] * w[j]
            by[k, i] += factor * w[j]
            by[k, j] += factor * w[i]
        return value, by

    def jacobian_at(self, x):
        target = np.linalg.solve(self.vectors, x.astype(complex))
        w = target.copy()
        for _ in range(50):
            value, by = self.bend(w)
            w = w - np.linalg.solve(by, value - target)
        image, slope = self.normal(w)
        after = self.bend(image)[1]
        whole = self.vectors @ after @ slope @ np.linalg.inv(self.bend(w)[1])
        return (whole @ np.linalg.inv(self.vectors)).real


def polynomial(multipliers, terms):
    """Return the map of diagonal multipliers with terms (component, factors, coefficient)."""

    def normal(w):
        image, slope = multipliers * w, np.diag(multipliers).astype(complex)
        for k, factors, value in terms:
            image[k] += value * np.prod(w[list(factors)])
            for place, i in enumerate(factors):
                others = [each for at, each in enumerate(factors) if at != place]
                slope[k, i] += value * np.prod(w[others])
        return image, slope

    return normal


ANGLES = {"fold-Neimark-Sacker": [1.1], "flip-Neimark-Sacker": [0.8]}
ANGLES["double Neimark-Sacker"] = [0.7, 1.9]


def with_conjugates(pairs, terms):
    found = []
    for k, factors, value in terms:
        found.append((k, factors, value))
        if pairs[k] != k:
            mirrored = tuple(pairs[i] for i in factors)
            found.append((pairs[k], mirrored, np.conj(value)))
    return found


@pytest.mark.quick(4)
@pytest.mark.parametrize("kind", [kind for kind in RESONANT_FORMS if kind != "flip-fold"])
def test_simple_multipliers(kind):
    seed = len(kind)
    form = RESONANT_FORMS[kind]
    multipliers, pairs = [], []
    for value in (*form.values, *np.exp(1j * np.array(ANGLES.get(kind, [])))):
        i = len(multipliers)
        if np.imag(value):
            multipliers += [value, np.conj(value)]
            pairs += [i + 1, i]
        else:
            multipliers.append(value)
            pairs.append(i)
    stable, count = len(pairs), len(pairs)
    multipliers, pairs = np.array([*multipliers, 0.3], dtype=complex), [*pairs, stable]
    rng = np.random.default_rng(seed + 10)
    coefficients = {}
    for name, (component, _) in form.terms.items():
        complex_one = pairs[component] != component and name != form.phase
        value = rng.normal() + (1j * rng.normal() if complex_one else 0.0)
        coefficients[name] = abs(value) if name == form.phase else value
    terms = [(*form.terms[name], value) for name, value in coefficients.items()]
    quadratic = []
    for i, j in itertools.combinations_with_replacement(range(count), 2):
        for k in range(count + 1):
            if abs(multipliers[i] * multipliers[j] - multipliers[k]) > 1e-6:
                factor = complex(*rng.normal(scale=0.2, size=2))
                quadratic.append((k, i, j, factor))
                quadratic.append((pairs[k], pairs[i], pairs[j], factor.conjugate()))
    normal = polynomial(multipliers, with_conjugates(pairs, terms))
    found = _resonant(Conjugate(normal, pairs, quadratic, seed), form)
    assert found.coefficients.keys() == coefficients.keys()
    for name, value in coefficients.items():
        error = abs(found.coefficients[name] - value)
        assert error < min(1e-5, 10.0 * found.errors[name] + 1e-9), name


def block(multiplier, terms):
    """Return the map (x, y, s) -> (mu x + y, mu y + terms, 0.3 s)."""

    def normal(w):
        x, y, s = w
        image = np.array([multiplier * x + y, multiplier * y, 0.3 * s])
        slope = np.array([[multiplier, 1.0, 0.0], [0.0, multiplier, 0.0], [0.0, 0.0, 0.3]])
        slope = slope.astype(complex)
        for m, n, value in terms:
            image[1] += value * x**m * y**n
            slope[1, 0] += value * m * x ** max(m - 1, 0) * y**n
            slope[1, 1] += value * n * x**m * y ** max(n - 1, 0)
        return image, slope

    return normal


class Block(Conjugate):
    """A map with a double multiplier, of which only the first vector has unit length."""

    def __init__(self, normal, seed):
        rng = np.random.default_rng(seed)
        self.normal = normal
        every = [(i, j) for i in range(2) for j in range(i, 2)]
        self.quadratic = [(k, i, j, 0.3 * rng.normal()) for i, j in every for k in range(3)]
        self.vectors = rng.normal(size=(3, 3)) + 0.0j
        first = self.vectors[:, 0] * (1.0 if self.vectors[:, 0].sum().real >= 0.0 else -1.0)
        self.vectors[:, :2] /= np.linalg.norm(first)
        self.vectors[:, 0] = first / np.linalg.norm(first)
        self.jacobian = self.jacobian_at(np.zeros(3))


@pytest.mark.parametrize("seed", [0, 1])
def test_double_multipliers(seed):
    plus = _double_plus(Block(block(1.0, [(2, 0, 0.7), (1, 1, -1.3)]), seed))
    assert plus.coefficients == pytest.approx({"a": 0.7, "b": -1.3}, abs=1e-7)
    assert max(plus.errors.values()) < 1e-6
    minus = _double_minus(Block(block(-1.0, [(3, 0, 0.7), (2, 1, -1.3)]), seed))
    assert minus.coefficients == pytest.approx({"a": 0.7, "b": -1.3}, abs=1e-5)
    assert max(minus.errors.values()) < 1e-3


@pytest.mark.parametrize("seed", [0, 1])
def test_fifth_order_of_a_generalized_flip(seed):
    normal = polynomial(np.array([-1.0, 0.3]), [(0, (0,) * 5, 0.8)])
    quadratic = [(0, 0, 0, 0.2), (1, 0, 0, -0.4), (0, 0, 1, 0.1)]
    form = _generalized_flip(Conjugate(normal, [0, 1], quadratic, seed))
    assert form.coefficient == pytest.approx(0.8, abs=1e-5)
    assert form.criticality == "supercritical"
