"""Figure 2.15: seven discs that are mechanically stable, and seven that are only locally stable."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.validation.studies import stability

MECHANICAL_SEED, LOCAL_SEED = 3, 34


@functools.cache
def mechanical():
    return stability.mechanically_stable(MECHANICAL_SEED)


@functools.cache
def local():
    return stability.locally_stable(LOCAL_SEED)


def widest_angle(packing, particle):
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    out = np.concatenate([contacts.normal_cd[contacts.i_c == particle], -contacts.normal_cd[contacts.j_c == particle]])
    angle = np.sort(np.arctan2(out[:, 1], out[:, 0]))
    return np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()


def test_search_by_moves_of_single_discs_ends_where_no_disc_can_move_by_itself():
    packing = local().scene.packing
    assert max(widest_angle(packing, n) for n in range(7)) < np.pi - 0.01


def test_one_is_collectively_jammed_and_the_other_only_locally_at_nearly_the_same_packing_fraction():
    one, other = mechanical(), local()
    assert one.fits and (one.local, one.collective) == ("jammed", "jammed")
    assert (one.contacts, one.states_of_self_stress, one.floppy_modes) == (13, 1, 0)
    assert other.fits and (other.local, other.collective) == ("jammed", "not jammed")
    # 11 distances of 14 coordinates, two of which are translations
    assert (other.contacts, other.states_of_self_stress, other.floppy_modes) == (11, 0, 1)
    assert abs(one.packing_fraction - other.packing_fraction) < 0.01


def test_energy_along_the_lowest_mode_grows_as_the_square_in_the_mechanically_stable_one():
    rows = stability.deform(mechanical())
    assert stability.exponent_of_energy(rows) == pytest.approx(2.0, abs=0.05)
    for name in ("forward", "backward"):
        cost = np.array([getattr(one, name) for one in rows if one.amplitude <= 1e-2])
        amplitude = np.array([one.amplitude for one in rows if one.amplitude <= 1e-2])
        assert np.abs(np.diff(np.log(cost)) / np.diff(np.log(amplitude)) - 2.0).max() < 0.05


def test_energy_along_the_lowest_mode_is_exactly_zero_to_a_finite_amplitude_in_the_locally_stable_one():
    rows = stability.deform(local())
    ahead, back = stability.free_way(rows)
    assert ahead > 0.15 and back > 1e-3
    assert {one.forward for one in rows if one.amplitude <= ahead} == {0.0}
    # where the way ends, discs meet that did not touch
    moved = local().moved(local().mode_nd, 1.3 * ahead)
    start = pm.find_contacts(local().scene.packing, gap_tolerance=1e-9)
    pairs = {tuple(row) for row in np.column_stack([start.i_c, start.j_c, start.image_cd]).tolist()}
    found = pm.find_contacts(moved)
    new = {tuple(row) for row in np.column_stack([found.i_c, found.j_c, found.image_cd]).tolist()} - pairs
    assert pm.energy(local().scene.replace(packing=moved)) > 0.0 and new
    # and no old contact was closed: straight motions that change a distance to second order only make it larger
    assert len(found) == len(new)


def test_middle_of_a_cage_is_as_far_from_three_neighbors_that_surround_it():
    rng = np.random.default_rng(7)
    for _ in range(20):
        ring = np.linspace(0.0, 2.0 * np.pi, 6)[:-1] + rng.uniform(0.0, 0.8, 5)
        others = rng.uniform(0.8, 1.4, 5)[:, None] * np.column_stack([np.cos(ring), np.sin(ring)])
        middle = stability.middle_of_cage(np.zeros(2), others)
        distance = np.sort(np.sqrt(((others - middle) ** 2).sum(axis=1)))
        assert distance[2] - distance[0] < 1e-12
        near = np.sqrt(((others - middle) ** 2).sum(axis=1)) < distance[0] + 1e-9
        # no small step leads farther from all of them
        step = 1e-4 * np.column_stack([np.cos(np.linspace(0, 6.28, 200)), np.sin(np.linspace(0, 6.28, 200))])
        after = np.sqrt(((middle + step[:, None] - others[near]) ** 2).sum(axis=-1)).min(axis=1)
        assert after.max() <= distance[0] + 1e-8


def test_motion_of_an_unbounded_program_is_played_at_unit_size():
    # the solver returns a motion of 1e170 here
    motion = pm.classify_jamming(stability.locally_stable(51).scene).unjamming_motion
    assert 0.5 < np.abs(motion.displacement_nd).max() <= 1.0 and motion.opening > 0.01 and motion.closing < 1e-9
