"""Facts about rattlers that are taken as far from what surrounds them as they can be."""

from dataclasses import replace

import numpy as np
import pytest

import packmech as pm
from packmech.jamming import room as room_of_rattlers
from packmech.jamming.room import AT_ONCE, NEAR, make_room
from packmech.result import Outcome

# the rattler of a cage, and the three discs around it that touch it at once
TIGHT = {(0, 1), (0, 2), (0, 3)}


def caged(rooms, off=(2e-4, 1e-4), aside=True):
    """Return a packing of cages, a rattler in each that can have so much room, its rattlers, and their cages' discs.

    Three discs of radius 1 hold each rattler; a fourth is near, and farther than these from the middle.
    """
    angle = np.radians([90.0, 210.0, 330.0, 30.0])
    place, radius, rattling = [], [], []
    for k, room in enumerate(rooms):
        middle = np.array([10.0 * k + 5.0, 5.0])
        small = 1.3 / (1.0 + room) - 1.0
        around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        place += [middle + off, *(middle + 1.3 * around[:3])]
        radius += [small, 1.0, 1.0, 1.0]
        rattling += [True, False, False, False]
        if aside:
            place.append(middle + 1.04 * (small + 0.11) * around[3])
            radius.append(0.11)
            rattling.append(False)
    box = pm.Box(np.diag([10.0 * len(rooms), 10.0]))
    return pm.Packing(np.array(place), np.array(radius), box), np.array(rattling)


def pairs_of(pairs):
    return {(min(i, j), max(i, j)) for i, j in zip(pairs.i_c.tolist(), pairs.j_c.tolist(), strict=True)}


def smallest_gap(packing, rattling):
    near = pm.find_contacts(packing, gap_tolerance=NEAR)
    loose = rattling[near.i_c] | rattling[near.j_c]
    return float((near.gap_c / near.contact_distance_c)[loose].min())


def test_a_squeezed_rattler_goes_to_the_middle_of_its_cage_and_the_three_discs_that_are_nearest_there_limit_it():
    packing, rattling = caged([5e-5])
    assert smallest_gap(packing, rattling) < 0.0
    moved, room, limits = make_room(packing, pm.find_contacts(packing, gap_tolerance=NEAR), rattling)
    assert abs(room - 5e-5) < AT_ONCE and abs(smallest_gap(moved, rattling) - room) < 1e-15
    assert np.abs(moved.position_nd[0] - 5.0).max() < 1e-6
    assert np.array_equal(moved.position_nd[~rattling], packing.position_nd[~rattling])
    # the fourth is near, and holds nothing
    near = pm.find_contacts(moved, gap_tolerance=NEAR)
    assert (0, 4) in pairs_of(near.pairs)
    assert pairs_of(limits) == TIGHT


@pytest.mark.parametrize("tighter", [0, 1])
def test_the_pairs_that_limit_are_those_of_the_rattler_with_the_least_room(tighter):
    rooms = [7e-5, 7e-5]
    rooms[tighter] = 5e-5
    packing, rattling = caged(rooms)
    moved, room, limits = make_room(packing, pm.find_contacts(packing, gap_tolerance=NEAR), rattling)
    assert abs(room - 5e-5) < AT_ONCE and abs(smallest_gap(moved, rattling) - room) < 1e-15
    assert pairs_of(limits) == {(i + 5 * tighter, j + 5 * tighter) for i, j in TIGHT}


def test_a_rattler_with_room_stays_and_nothing_limits_it():
    packing, rattling = caged([2e-3], off=(0.0, 0.0))
    moved, room, limits = make_room(packing, pm.find_contacts(packing, gap_tolerance=NEAR), rattling)
    assert moved is packing and abs(room - 2e-3) < 1e-15 and len(limits.i_c) == 0


def test_a_rattler_whose_program_was_not_solved_stays(monkeypatch):
    packing, rattling = caged([5e-5])
    solved = room_of_rattlers.solve_highs

    def failed(program, tolerance):
        found = solved(program, tolerance)
        return replace(found, solve=replace(found.solve, outcome=Outcome.INACCURATE))

    monkeypatch.setattr(room_of_rattlers, "solve_highs", failed)
    moved, room, limits = make_room(packing, pm.find_contacts(packing, gap_tolerance=NEAR), rattling)
    assert np.array_equal(moved.position_nd, packing.position_nd)
    assert room == smallest_gap(packing, rattling) and len(limits.i_c) == 0


def test_an_ellipse_has_the_room_that_is_said_of_it_and_never_less_than_before():
    """Distances of ellipses bend both ways: a step as far as they are taken to be straight may lose room."""
    rng = np.random.default_rng(2)
    for _ in range(8):
        packing, rattling = caged([5e-5], aside=False)
        angle = rng.uniform(0.0, np.pi, 4)
        shapes = pm.Spheroids(np.array([1.6, 1.0, 1.0, 1.0]), np.stack([np.cos(angle), np.sin(angle)], axis=1))
        tight = packing.radius_n * np.where(rattling, rng.uniform(0.9, 1.0), 1.0)
        packing = pm.Packing(packing.position_nd, tight, packing.box, shapes=shapes)
        near = pm.find_shape_contacts(packing, gap_tolerance=NEAR)
        before = float((near.gap_c / near.contact_distance_c).min())
        moved, room, _ = make_room(packing, near, rattling)
        after = pm.find_shape_contacts(moved, gap_tolerance=NEAR)
        assert abs(float((after.gap_c / after.contact_distance_c).min()) - room) < 1e-12 and room >= before


@pytest.mark.parametrize("programs", [1, 2, 3])
def test_after_as_few_programs_as_there_may_be_the_room_is_that_of_the_packing_all_the_same(programs, monkeypatch):
    monkeypatch.setattr(room_of_rattlers, "_PROGRAMS", programs)
    packing, rattling = caged([5e-5, 7e-5], off=(0.03, 0.02))
    near = pm.find_contacts(packing, gap_tolerance=NEAR)
    moved, room, _ = make_room(packing, near, rattling)
    assert smallest_gap(packing, rattling) <= room and abs(smallest_gap(moved, rattling) - room) < 1e-15


def test_an_ellipse_that_its_tips_hold_turns_away_from_what_they_touch():
    """A tip is as far out as the disc around the ellipse: pairs are looked for as far as tips go when they turn."""
    radius, semi = 1.0, 0.3 * np.sqrt(3.0)
    place = [[5.0, 5.0], [5.0 - semi - radius - 4e-5, 5.0], [5.0 + semi + radius + 2e-5, 5.0]]
    shapes = pm.Spheroids(np.array([3.0, 1.0, 1.0]), np.tile([1.0, 0.0], (3, 1)))
    packing = pm.Packing(place, [0.3, radius, radius], pm.Box.cubic(10.0, 2), shapes=shapes)
    rattling = np.array([True, False, False])
    near = pm.find_shape_contacts(packing, gap_tolerance=NEAR)
    before = float((near.gap_c / near.contact_distance_c).min())
    assert len(near) == 2 and 0.0 < before < 2e-5
    moved, room, _ = make_room(packing, near, rattling)
    after = pm.find_shape_contacts(moved, gap_tolerance=NEAR)
    assert before < room and abs(float((after.gap_c / after.contact_distance_c).min(initial=NEAR)) - room) < 1e-12


@pytest.mark.parametrize("seed", range(6))
def test_bodies_of_discs_have_the_room_that_is_said_of_them_though_their_ends_swing_far(seed):
    packing = pm.random_packing(10, dimension=2, packing_fraction=0.75, seed=seed, shapes=pm.Dimer())
    rattling = np.arange(10) == 0

    def room_of(packing):
        near = pm.find_shape_contacts(packing, gap_tolerance=NEAR)
        loose = rattling[near.i_c] | rattling[near.j_c]
        return float((near.gap_c / near.contact_distance_c)[loose].min(initial=NEAR))

    near = pm.find_shape_contacts(packing, gap_tolerance=NEAR)
    moved, room, _ = make_room(packing, near, rattling)
    assert abs(room_of(moved) - room) < 1e-12 and room >= room_of(packing)
    assert np.array_equal(moved.position_nd[1:], packing.position_nd[1:])
