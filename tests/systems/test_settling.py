"""Limits of sequences, against closed forms."""

import numpy as np
import pytest

from mems_impact.systems.settling import (
    CHANGING,
    FLUCTUATING,
    SETTLED,
    UNKNOWN,
    block_length,
    limit_of,
)

NONE = np.zeros((200, 1))  # states that do not move


def _limit(blocks, noise=1e-9):
    return limit_of(blocks, noise, NONE[: len(blocks)])


@pytest.mark.parametrize("q", [0.9, 0.97, -0.97, 0.995])
@pytest.mark.parametrize("limit", [0.0, -3.0])
def test_one_multiplier(q, limit):
    found = _limit(limit + 0.2 * q ** np.arange(40.0))
    assert found.kind == CHANGING
    assert abs(found.value - limit) < 1e-6
    assert found.error >= abs(found.value - limit)
    assert found.ratio == pytest.approx(abs(q), abs=0.02)


@pytest.mark.parametrize("angle", [0.05, 0.4, 2.0, np.pi])
def test_a_spiral_and_a_fast_transient(angle):
    k = np.arange(60.0)
    found = _limit(1.0 + 0.3 * 0.985**k * np.cos(angle * k + 0.3) + 0.1 * 0.6**k)
    assert found.kind == CHANGING
    assert abs(found.value - 1.0) <= found.error < 0.1


def test_a_multiplier_that_the_sequence_hides():
    """A slow state has hardly shown in the statistic; with it the limit is found."""
    k = np.arange(40.0)
    fast, slow = 0.8**k, 1.0 - 0.999**k
    blocks = fast + 1e-3 * slow
    states = np.column_stack([fast, slow / slow.max()])
    found = limit_of(blocks, 1e-9, states)
    assert abs(found.value - 1e-3) <= found.error < 1e-3


def test_a_drift_without_an_end():
    found = _limit(np.arange(40.0))
    assert (found.kind, found.error) == (CHANGING, np.inf)


def test_constant_within_the_noise():
    found = _limit(1.0 + 1e-10 * np.sin(np.arange(50.0)))
    assert found.kind == SETTLED
    assert found.error < 1e-9


def test_few_blocks():
    assert _limit(np.array([1.0, 2.0, 3.0])).kind == UNKNOWN
    assert _limit(np.array([1.0, np.nan, np.nan, np.nan, 3.0])).kind == UNKNOWN


def test_means_of_the_logistic_map():
    """At r = 4 the invariant density is known: the mean is 1/2. All of 200 errors hold."""
    rng = np.random.default_rng(0)
    x = rng.random(200)
    means = np.zeros((200, 40))
    for k in range(480):
        x = 4.0 * x * (1.0 - x)
        means[:, k // 12] += x / 12.0
    for row in means:
        found = limit_of(row, 1e-9, row[:, None])
        assert found.kind == FLUCTUATING
        assert abs(found.value - 0.5) <= found.error


@pytest.mark.parametrize("period", [1, 2, 3, 5])
def test_block_length(period):
    k = np.arange(200)
    states = np.sin(1.0 + k % period)[:, None] + 0.5 * 0.99 ** k[:, None]
    assert block_length(states) == period
