"""Derivatives along a vector, of maps that have them in closed form, and their errors."""

import numpy as np
import pytest

from mems_impact.continuation.higher_derivatives import directional_derivatives

LINEAR = np.array([[-1.0, 0.3], [0.2, 0.5]])
ALONG = np.array([0.6, 0.8])


def sine(x):
    """Return the Jacobian of (x, y) -> LINEAR (x, y) + (sin(x + y), 0)."""
    return LINEAR + np.array([[1.0, 1.0], [0.0, 0.0]]) * np.cos(x.sum())


@pytest.mark.parametrize("jacobian", [sine, lambda x: LINEAR], ids=["sine", "linear"])
def test_errors_are_those_of_the_map_in_any_unit(jacobian):
    """A linear map has an error, too: that of the rounding of its Jacobian."""
    exact = np.zeros((2, 2)), np.zeros((2, 2))
    if jacobian is sine:
        exact = exact[0], np.array([[-1.96, -1.96], [0.0, 0.0]])
    plain = directional_derivatives(jacobian, ALONG, 1.0)
    large = directional_derivatives(lambda x: 2.0**20 * jacobian(x), ALONG, 1.0)
    for found, unit in ((plain, 1.0), (large, 2.0**20)):
        assert np.abs(found.second / unit - exact[0]).max() <= found.second_error / unit < 1e-9
        assert np.abs(found.third / unit - exact[1]).max() <= found.third_error / unit < 1e-6
    assert large.second_error == 2.0**20 * plain.second_error > 0.0
    assert large.third_error == 2.0**20 * plain.third_error > 0.0
