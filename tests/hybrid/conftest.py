"""Tests of the loop, for all families of methods."""

import pytest

from tests.hybrid import systems


@pytest.fixture(params=["adams", "dop853", pytest.param("auto", marks=pytest.mark.slow)])
def each_method(request, monkeypatch):
    """Run the tests of a file with a multistep method, a one-step method, and what has both."""
    monkeypatch.setitem(systems.DEFAULTS, "method", request.param)
