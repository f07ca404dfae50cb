"""The small form of the campaign; the large one is ``python -m validation.campaign``."""

import pytest

from tests.campaign.waveforms import hang
from validation.campaign import boundaries, chatter, fuzz, invariance, pull_in, scans
from validation.campaign.campaign import random_runs
from validation.campaign.cases import random_case
from validation.campaign.invariance import CHEAP
from validation.campaign.pool import each

SEED = 2


@pytest.mark.nightly
def test_random_runs():
    """Of the drives that need two compiled automata only: the others take the compiler longer.

    One in six is interpreted as well, which takes most of the time.
    """
    numbers = [i for i in range(100) if random_case(SEED, i).drive.kind in CHEAP]
    outcomes = random_runs(SEED, numbers, workers=1, balance="interpreted", interpreted=6)
    assert [f"{one.name}: {one.findings}" for one in outcomes if one.findings] == []
    assert sum(one.impacts for one in outcomes) > 250
    assert sum(one.horizon for one in outcomes) > 0.9 * len(outcomes)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "attack",
    [*scans.ATTACKS[:-1], *chatter.ATTACKS, *pull_in.ATTACKS, *invariance.ATTACKS[:-1]],
    ids=lambda attack: attack.__name__,
)
def test_aimed(attack):
    result = attack(seed=SEED, small=True)
    assert result.findings == []
    assert result.tried > 0


@pytest.mark.nightly
def test_boundaries_by_simulation():
    assert boundaries.boundaries(seed=SEED, small=True).findings == []


def test_bad_files():
    assert fuzz.files(seed=SEED, small=True).findings == []


def test_a_hang_is_an_answer_too():
    """A run that never returns is killed, told, and the others go on."""
    told = list(each(hang, [0, 1, 2], 2, lambda item, why: (item, why), limit=2.0))
    assert sorted(map(str, told)) == ["(1, 'hung for 2 s')", "0", "2"]
