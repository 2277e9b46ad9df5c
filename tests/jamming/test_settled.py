"""What stands of an answer, by what was assumed: rest, and contacts at three gap tolerances, in every case."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import packmech as pm
from packmech.jamming.certificates import Finding
from packmech.jamming.classify import _answer, _local, _stable, judged_by_fewest, settle, undecided
from packmech.jamming.contact_selection import ContactSelection, GapLevel, RestCheck, check_rest, select_contacts
from packmech.jamming.motion_cone import motion_cone
from packmech.jamming.verdict import JammingAnswer

YES, NO, OPEN = "jammed", "not jammed", "ambiguous"
AT_REST, AWAY = RestCheck(1e-7, 0.0, 1e-5, "law"), RestCheck(1e-3, 0.0, 1e-5, "law")
PARTICLES = 100


def answer(verdict, states=1, **others):
    return JammingAnswer(verdict, "as it is", None, 199, states, 0, **others)


def touching(*excess, mean_overlap=1e-6, rule="7 mean overlaps", contacts=(200, 200, 200)):
    """Return a selection with these excess contacts at the three levels."""
    levels = [
        GapLevel(10.0**k * 1e-8, count, PARTICLES, one)
        for k, (one, count) in enumerate(zip(excess, contacts, strict=True))
    ]
    return ContactSelection(None, 1e-7, mean_overlap, rule, tuple(levels))


def never(level):
    raise AssertionError(f"level {level} is not asked for")


def by_level(fewest=None, most=None):
    """Return what is known at the lowest and at the highest level: whether jammed, in the fixed box and strictly."""
    found = {0: fewest, 2: most}
    return lambda level: SimpleNamespace(jammed=found[level]) if found[level] is not None else never(level)


def settled(collective, strict, selection, within, rest=AT_REST, states=1):
    one, other = settle(answer(collective, states), answer(strict, states), selection, rest, within)
    return one.verdict, other.verdict


SURE = [(YES, YES), (YES, NO), (NO, NO)]


@pytest.mark.parametrize("verdicts", SURE)
@pytest.mark.parametrize("selection", [touching(1, 1, 1), touching(0, 1, 5, rule="given")], ids=["plateau", "given"])
def test_answers_stand_at_rest_on_the_plateau_and_with_a_tolerance_that_was_asked_for(verdicts, selection):
    assert settled(*verdicts, selection, never) == verdicts
    assert settled(*verdicts, selection, never, rest=None) == verdicts


@pytest.mark.parametrize("verdicts", SURE)
@pytest.mark.parametrize("excess", [(1, 1, 1), (0, 1, 5)])
def test_nothing_is_known_of_a_packing_that_is_not_at_rest(verdicts, excess):
    assert settled(*verdicts, touching(*excess), never, rest=AWAY) == (OPEN, OPEN)


def test_strictly_jammed_is_collectively_so_and_not_collectively_is_not_strictly():
    plateau = touching(1, 1, 1)
    assert settled(OPEN, YES, plateau, never) == (YES, YES)
    assert settled(NO, OPEN, plateau, never) == (NO, NO)
    assert settled(YES, OPEN, plateau, never) == (YES, OPEN) and settled(OPEN, NO, plateau, never) == (OPEN, NO)


@pytest.mark.parametrize("fewest", list(itertools.product([True, False, None], repeat=2)))
def test_jammed_off_the_plateau_is_jammed_by_the_fewest_contacts_already(fewest):
    found = settled(YES, YES, touching(1, 3, 5), by_level(fewest), states=3)
    # strictly jammed with the fewest is collectively so
    strict = YES if fewest[1] else OPEN
    assert found == (YES if fewest[0] or strict == YES else OPEN, strict)


@pytest.mark.parametrize(("fewest", "most"), list(itertools.product([True, False, None], repeat=2)))
def test_jammed_in_its_box_only_is_so_by_the_fewest_contacts_and_not_strictly_with_the_most(fewest, most):
    found = settled(YES, NO, touching(1, 3, 5), by_level((fewest, None), (None, most)), states=3)
    assert found == (YES if fewest else OPEN, NO if most is False else OPEN)


@pytest.mark.parametrize("most", list(itertools.product([True, False, None], repeat=2)))
def test_not_jammed_off_the_plateau_is_not_jammed_with_the_most_contacts_either(most):
    found = settled(NO, NO, touching(1, 3, 5), by_level(most=most))
    collective = NO if most[0] is False else OPEN
    assert found == (collective, NO if most[1] is False or collective == NO else OPEN)


@pytest.mark.parametrize(
    ("excess", "states", "mean_overlap", "stands"),
    [
        # so small an overlap has closed no gap: mean overlap times N^2 below a tenth
        ((1, 3, 5), 3, 0.99e-5, True),
        ((1, 3, 5), 3, 1.01e-5, False),
        # or the only state of self stress, with no contact that the fewest lack
        ((1, 1, 5), 1, 1e-3, True),
        ((1, 1, 5), 2, 1e-3, False),
        ((0, 1, 5), 1, 1e-3, False),
    ],
)
def test_jammed_may_stand_where_the_pairs_in_doubt_cannot_matter(excess, states, mean_overlap, stands):
    selection = touching(*excess, mean_overlap=mean_overlap)
    found = settled(YES, YES, selection, by_level((True, True)) if stands else never, states=states)
    assert found == ((YES, YES) if stands else (OPEN, OPEN))
    if not stands:
        assert settled(YES, NO, selection, by_level(most=(True, False)), states=states) == (OPEN, NO)


def test_a_plateau_has_one_excess_and_no_level_without_contacts_beside_others():
    assert touching(1, 1, 1).on_plateau and touching(1, 1, 1, contacts=(0, 0, 0)).on_plateau
    assert not touching(1, 1, 2).on_plateau and not touching(0, 1, 1).on_plateau
    # nothing at all counts as one in excess
    assert not touching(1, 1, 1, contacts=(0, 200, 200)).on_plateau


@pytest.mark.parametrize(
    ("contacts", "jammed", "counts", "excess", "rest", "expected"),
    [
        (200, True, (200, 200, 200), (1, 1, 1), AT_REST, YES),
        (200, True, (200, 200, 200), (1, 1, 5), AT_REST, YES),
        (200, True, (200, 200, 200), (1, 1, 1), AWAY, OPEN),
        (200, True, (0, 200, 200), (1, 1, 1), AT_REST, OPEN),
        (0, False, (0, 0, 0), (1, 1, 1), AT_REST, NO),
        (0, None, (0, 0, 0), (1, 1, 1), AT_REST, OPEN),
        (0, False, (0, 0, 200), (1, 1, 1), AT_REST, OPEN),
    ],
)
def test_locally_jammed_is_a_backbone_at_rest_that_is_there_at_every_level(
    contacts, jammed, counts, excess, rest, expected
):
    finding = SimpleNamespace(reason="no solver could tell")
    judged = SimpleNamespace(network=np.zeros(contacts), jammed=(jammed, jammed), collective=(None, finding))
    assert _local(judged, touching(*excess, contacts=counts), rest)[0] == expected


@pytest.mark.parametrize(
    ("links", "verdict", "stable", "expected"),
    [
        (True, NO, True, OPEN), (True, NO, False, NO), (True, NO, None, NO), (True, YES, True, YES),
        (False, NO, True, NO), (True, OPEN, True, OPEN),
    ],
)  # fmt: skip
def test_forces_may_block_at_second_order_only_what_links_admit(links, verdict, stable, expected):
    assert undecided(SimpleNamespace(links=links), answer(verdict, stable=stable)).verdict == expected


@pytest.mark.parametrize("linked", [False, True])
def test_a_crystal_has_its_contacts_less_the_fewest_that_jam_in_excess_at_three_tolerances(linked):
    crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    if linked:
        pair = pm.find_contacts(crystal, gap_tolerance=1e-9).select(np.arange(1))
        crystal = crystal.replace(links=pm.Links(pair.i_c, pair.j_c, pair.image_cd, pair.distance_c))
    found = select_contacts(crystal, None)
    # 27 contacts; 2 N - 1 jam nine discs; a link is no contact, and one fewer is needed
    assert [(one.contacts, one.particles, one.excess) for one in found.levels] == [(27 - linked, 9, 10)] * 3
    assert [one.tolerance for one in found.levels] == pytest.approx([1e-10, 1e-9, 1e-8]) and found.on_plateau
    wide = select_contacts(crystal.replace(radius_n=crystal.radius_n * (1.0 - 3e-9)), None)
    assert [one.contacts for one in wide.levels] == [0, 0, 27 - linked] and not wide.on_plateau


def test_rest_compares_the_largest_net_force_with_the_mean_of_forces_and_with_rounding():
    place = [[1.0, 1.0], [1.9, 1.0], [1.0, 3.0], [1.7, 3.0]]
    pairs = pm.Packing(place, [0.5] * 4, pm.Box.cubic(6.0, 2))
    found = check_rest(pairs, None, 1e-5)
    # forces .1 and .3, of which nothing bears any
    assert found.residual == pytest.approx(1.5, rel=1e-12) and not found.at_rest and found.limit == 1e-5
    assert check_rest(pairs, None, 2.0).at_rest
    close = check_rest(pairs, None, 1e-300)
    assert close.limit == 8.0 * close.floor and 0.0 < close.floor < 1e-13


def test_links_bear_the_net_forces_of_a_column_of_dimers():
    links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    place = [[2.0, 0.5 + k] for k in range(4)]
    column = pm.Packing(place, [0.525] * 4, pm.Box(np.diag([4.0, 4.0])), links)
    assert check_rest(column, None, 1e-5).residual < 1e-12
    apart = check_rest(
        column.replace(links=None, position_nd=np.array(place) + [[0, 0], [0, 0.01], [0, 0], [0, 0.01]]), None, 1e-5
    )
    assert apart.residual > 0.1


def test_the_fewest_contacts_are_asked_first_only_where_they_may_answer_for_the_others():
    def asked(selection, rest=AT_REST):
        try:
            return judged_by_fewest(SimpleNamespace(dimension=2), selection, rest, never, "free")
        except AssertionError:
            return "asked"

    off = replace(touching(2, 3, 5, contacts=(199, 200, 202)), backbone=(None, None))
    few, at, most = off.levels
    assert asked(off) == "asked"
    # two in excess of a fixed box's fewest are needed to jam strictly in the plane
    for fewer in (replace(few, particles=PARTICLES - 1), replace(few, excess=1), replace(few, contacts=200)):
        assert asked(replace(off, levels=(fewer, at, most))) is None
    assert asked(off, AWAY) is None and asked(replace(off, backbone=None)) is None
    assert asked(replace(off, rule="given")) is None


@pytest.mark.parametrize(("jammed", "verdict"), [(True, YES), (False, NO), (None, OPEN)])
def test_what_nobody_could_tell_is_ambiguous(jammed, verdict):
    crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    cone = motion_cone(crystal, contacts, strain="none")
    assert _answer(crystal, "certificate", (cone, Finding(jammed, "")), len(contacts)).verdict == verdict


def test_stability_is_claimed_at_rest_only_and_of_a_backbone_only():
    scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))
    assert pm.classify_jamming(scene).mechanically_stable is True
    shaken = scene.packing.position_nd + 1e-4 * np.random.default_rng(0).normal(size=(9, 2))
    away = pm.classify_jamming(scene.replace(packing=scene.packing.replace(position_nd=shaken)))
    assert not away.rest.at_rest and away.mechanically_stable is None and away.prestress_stable is None
    pair = pm.find_contacts(scene.packing).select(np.arange(1))
    links = pm.Links(pair.i_c, pair.j_c, pair.image_cd, pair.distance_c)
    linked = scene.replace(packing=scene.packing.replace(links=links))
    for rattling, stable in ((False, True), (True, False)):
        assert _stable(linked, np.full(9, rattling), strain="none", gap_tolerance=0.0) is stable


def test_contacts_that_are_not_those_of_the_packing_are_not_judged():
    crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    assert pm.classify_jamming(crystal, contacts=contacts).strict == YES
    moved = crystal.replace(position_nd=crystal.position_nd + 0.1 * np.eye(9, 2))
    with pytest.raises(ValueError, match="contacts must"):
        pm.classify_jamming(moved, contacts=contacts)
