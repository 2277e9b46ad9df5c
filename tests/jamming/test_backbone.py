"""What is believed of parts of a network, of more contacts than were judged, and of a network that rattles away."""

from types import SimpleNamespace

import numpy as np
import pytest
from hard_cases.jamming import three_in_a_hole

import packmech as pm
from packmech.jamming import backbone as module
from packmech.jamming.backbone import Judged, _left_open, _nothing_held, carrying_contacts, judge_network, with_more
from packmech.jamming.certificates import Finding
from packmech.jamming.contact_selection import backbone_of
from packmech.jamming.motion_cone import motion_cone
from packmech.result import Outcome

CRYSTAL = pm.lattice_packing("triangular", repeats=(3, 3))
NETWORK, KEPT = backbone_of(CRYSTAL, pm.find_contacts(CRYSTAL, gap_tolerance=1e-9))
FIXED, FREE = (motion_cone(CRYSTAL, NETWORK, strain=one, kept_n=KEPT) for one in ("none", "free"))


def judged(collective, strict, motion=None):
    return Judged(NETWORK, (FIXED, Finding(collective, "")), (FREE, Finding(strict, "", motion=motion)))


def test_more_contacts_jam_what_fewer_jam_strictly_and_no_other_particles():
    def more(fewer):
        return with_more(CRYSTAL, fewer, (NETWORK, KEPT), "free")

    found = more(judged(True, True))
    assert found.jammed == (True, True) and found.strict[1].weight is None
    for wrong in ((True, False), (True, None), (False, False), (None, None)):
        assert more(judged(*wrong)) is None
    others = motion_cone(CRYSTAL, NETWORK, strain="free", kept_n=KEPT[:-1])
    assert more(Judged(NETWORK, (FIXED, Finding(True, "")), (others, Finding(True, "")))) is None


def test_a_part_that_is_not_known_leaves_all_open_but_motions_that_strain_the_box():
    strained, still = np.ones(FREE.unknowns), np.ones(FREE.unknowns)
    still[-3:] = 1e-9
    assert _left_open(judged(False, False, strained)).jammed == (None, False)
    assert _left_open(judged(False, False, still)).jammed == (None, None)
    assert _left_open(judged(None, None)).jammed == (None, None)
    assert _left_open(judged(False, True)).jammed == (None, True)


@pytest.mark.parametrize(
    ("decided", "smaller", "expected"),
    [
        # the part is the whole: the first answer stands where there is one
        (False, NETWORK, False), (None, NETWORK, None),
        # which part may be jammed nobody could tell
        (False, None, None), (None, None, None),
    ],
)  # fmt: skip
def test_not_jammed_stands_where_its_parts_are_known(decided, smaller, expected):
    found = judge_network(
        CRYSTAL, NETWORK, "free", lambda cone: Finding(decided, ""), lambda *given: smaller, backbone=(NETWORK, KEPT)
    )
    assert found.jammed[0] is expected


@pytest.mark.parametrize(
    ("kept", "hardly", "floppy", "expected"),
    [
        (True, False, False, False), (True, True, False, None), (False, False, False, None),
        (True, True, True, False), (False, False, True, False),
    ],
)  # fmt: skip
def test_what_rattles_away_is_not_jammed_where_a_motion_surely_closes_nothing(
    monkeypatch, kept, hardly, floppy, expected
):
    motion = np.ones(FIXED.unknowns)
    monkeypatch.setattr(module, "open_all", lambda cone, **named: SimpleNamespace(motion=motion))
    monkeypatch.setattr(module, "kept_open", lambda *given: motion if kept else None)
    monkeypatch.setattr(module, "closes_hardly", lambda *given: hardly)
    cone = motion_cone(CRYSTAL, NETWORK.select(np.arange(2)), strain="none", kept_n=KEPT) if floppy else FIXED
    assert cone.is_floppy == floppy
    assert _nothing_held(cone)[1].jammed is expected


def test_a_program_that_failed_names_no_contacts_that_carry(monkeypatch):
    def told(outcome):
        found = SimpleNamespace(carrying_c=np.zeros(len(NETWORK), dtype=bool), solve=SimpleNamespace(outcome=outcome))
        monkeypatch.setattr(module, "open_all", lambda cone, **named: found)
        return carrying_contacts(CRYSTAL, FIXED, NETWORK, "clarabel", 1e-8)

    assert len(told(Outcome.CONVERGED)) == 0
    # all may carry then, and hold one another: no smaller part is known
    assert told(Outcome.INACCURATE) is None


def test_contacts_that_carry_among_discs_that_turn_together_are_left_out():
    packing = three_in_a_hole()
    network, kept = backbone_of(packing, pm.find_contacts(packing, gap_tolerance=1e-9))
    cone = motion_cone(packing, network, strain="none", kept_n=kept)
    found = carrying_contacts(packing, cone, network, "clarabel", 1e-8)
    ends = np.union1d(found.i_c, found.j_c)
    assert len(found) and not np.isin([35, 36, 37], ends).any() and np.isin([35, 36, 37], kept).all()
