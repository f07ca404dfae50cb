"""Drawings of published devices beside measurements."""

import pytest

from validation.devices.__main__ import combs


def test_a_comb_drive_has_the_stiffness_of_another():
    fitted, predicted = combs()
    assert fitted.ours == pytest.approx(fitted.measured, rel=1e-3)
    assert predicted.ours == pytest.approx(predicted.measured, rel=0.05)
    # Without the fields at the edges of fingers the ratio would be (15/2) 8/((15/5) 4) = 5.
    assert predicted.ours / fitted.ours == pytest.approx(4.41, rel=2e-3)
