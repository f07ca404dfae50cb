"""The family of terms: its judge knows all of them, meets another judge, and can say no."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.terms import TERM_CLASSES
from validation.campaign import terms
from validation.campaign.comparing import END
from validation.judges import dop853_free, with_terms
from validation.judges.heyoka_full import Piece, Source

SEED = 3
QUICK = (*range(4, 12), *range(13, 20))  # cases that are interpreted and short


def test_every_term_is_tried():
    assert with_terms.TERMS.keys() == set(TERM_CLASSES)
    tried = {name for number in QUICK for name in terms.Drawn(SEED, number).terms}
    # A slew rate changes the voltage of the source, not the equations.
    assert tried == set(terms.JUDGED) == set(TERM_CLASSES) - {"slew_rate"}


@pytest.mark.slow(all=True)
@pytest.mark.parametrize("number", QUICK)
def test_motions_and_energies_with_terms_are_those_of_the_judge(number):
    """Of devices with random terms under random drives, all kinds of drives among them."""
    assert terms.check(SEED, number).story == ""


@pytest.mark.nightly
def test_without_terms_it_meets_the_judge_of_the_papers_equations():
    device = {name: value for name, value in mi.load_actuator("zhao2004") if name != "units"}
    device |= {"mu_s": 0.0012, "mu_d": 0.0009}
    voltage = Source(bias=0.05, a1=0.3, w1=0.5)
    judge = with_terms.Device(device, {}, lambda t: Piece(math.inf, voltage))
    start = np.zeros(len(judge.states))
    start[3] = 0.9
    mine = terms._Follower(judge, start, 1e-12).follow(30.0)[0]
    theirs, last = dop853_free.Judge(device, (0.3, 0.5, 0.05)).run((0.0, 0.0, 0.0, 0.9), 30.0)
    kinds = {with_terms.RIGHT: 0, with_terms.LEFT: 1, with_terms.SLIP_END: 2}
    assert [kinds.get(row.guard, 3) for row in mine[:-1]] == [kind for kind, _, _ in theirs]
    assert len(theirs) > 8
    for row, (_, t, y) in zip(mine, theirs, strict=False):
        assert row.t == pytest.approx(t, abs=1e-9)
        assert row.y[:4] == pytest.approx(y, abs=1e-9)
    assert mine[-1].guard == END
    assert mine[-1].y[:4] == pytest.approx(last, abs=1e-9)


# The number of the judge by which a term without numbers of its own changes.
COMPUTED = {
    "tabulated_capacitance": ("capacitance 1",),
    "tabulated_spring": ("spring 1",),
    "tilted_plate": ("wedge",),
    "clamp_electrode": ("plate",),
}


@pytest.mark.nightly
@pytest.mark.parametrize("name", terms.JUDGED)
def test_a_term_that_is_a_little_different_is_found(name, monkeypatch):
    """Of its numbers, the first one that the judge has, a thousandth off."""
    known = [*with_terms.TERMS[name].places.values(), *COMPUTED.get(name, ())]
    places = [with_terms.PLACE[place] for place in known]

    class Other(terms._Judged):
        def __init__(self, *given):
            super().__init__(*given)
            if places:
                self.p[places[0]] *= 1.001
            else:
                self.table.c *= 1.001

    tried = 0
    for i in range(4, 200):  # those before are long
        drawn = terms.Drawn(SEED, i)
        if drawn.compiled or name not in drawn.terms:
            continue
        with monkeypatch.context() as patch:
            patch.setattr(terms, "_Judged", Other)
            story = terms.check(SEED, i).story
        tried += 1
        if story or tried == 16:
            break
    assert story != ""
    assert terms.check(SEED, i).story == ""  # with the judge as it is
