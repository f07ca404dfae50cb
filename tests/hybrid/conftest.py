"""Tests of the loop, for both families of methods."""

import pytest

from tests.hybrid import systems


@pytest.fixture(params=["adams", "dop853"])
def each_method(request, monkeypatch):
    """Run the tests of a file with a multistep and with a one-step method."""
    monkeypatch.setitem(systems.DEFAULTS, "method", request.param)
