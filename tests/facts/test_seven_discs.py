"""Seven equal discs in a square periodic box: mechanically stable, or only locally (Schreck and O'Hern, figure 2.15).

Both packings come from random starts. One is what jamming by step halving ends in: 13 contacts, one state of self
stress. The other is met on the way of a quench: 12 contacts, one state of self stress, and so a collective motion that
changes no contact to first order. Under any pressure that one is a saddle; exactly touching, it costs nothing to leave.
"""

import functools

import numpy as np
import pytest

import packmech as pm

STABLE_SEED, LOCAL_SEED = 193, 5150
CONTACTS = 12
REPULSION = (pm.Repulsion(),)


def random_start(packing_fraction, seed):
    return pm.Scene(pm.random_packing(7, dimension=2, packing_fraction=packing_fraction, seed=seed), REPULSION)


@functools.cache
def stable(energy_per_particle=1e-16):
    """Return the scene of a packing just above its jamming onset."""
    start = random_start(0.6, STABLE_SEED)
    method = pm.StepHalving(start_packing_fraction=0.6, increment=3e-3, energy_tolerance=energy_per_particle)
    return start.replace(packing=pm.jam(start, strain="isotropic", method=method).packing)


@functools.cache
def local():
    """Return the scene of a packing that touches to rounding: contact forces in balance, found by Newton's method."""
    start = random_start(0.74, LOCAL_SEED)
    packing = pm.quench(start, force_tolerance=1e-3, check=False).packing
    pairs = pm.find_contacts(packing, gap_tolerance=0.2)
    pairs = pairs.select(np.sort(np.argsort(pairs.distance_c)[:CONTACTS]))
    return start.replace(packing=touching_in_balance(packing, pairs))


def touching_in_balance(packing, pairs):
    """Return the packing of equal discs in which all these pairs touch and push in balance: a critical point.

    Newton's method on: net forces 0, sum of forces 1, distances = diameter, for positions, diameter and forces.
    """
    count, size = len(pairs), packing.position_nd.size
    ends = np.zeros((count, packing.particles))
    ends[np.arange(count), pairs.i_c], ends[np.arange(count), pairs.j_c] = -1.0, 1.0
    shift = pairs.image_cd @ packing.box.lattice_dd.T
    place, diameter, force = np.array(packing.position_nd), 2.0 * packing.radius_n[0], None
    for _ in range(20):
        vector = ends @ place + shift
        distance = np.linalg.norm(vector, axis=1)
        normal = vector / distance[:, None]
        rows = np.einsum("cn,cd->cnd", ends, normal).reshape(count, size)
        if force is None:
            force = np.linalg.lstsq(np.vstack([rows.T, np.ones(count)]), np.append(np.zeros(size), 1.0), rcond=None)[0]
        across = (np.eye(2) - normal[:, :, None] * normal[:, None, :]) * (force / distance)[:, None, None]
        bend = np.einsum("cn,cm,cde->ndme", ends, ends, across).reshape(size, size)
        column = np.zeros((size, 1))
        matrix = np.block([
            [bend, column, rows.T],
            [column.T, np.zeros((1, 1)), -np.ones((1, count))],
            [rows, -np.ones((count, 1)), np.zeros((count, count))],
        ])  # fmt: skip
        wrong = np.concatenate([rows.T @ force, [1.0 - force.sum()], distance - diameter])
        step = np.linalg.lstsq(matrix, -wrong, rcond=1e-12)[0]
        place, diameter, force = place + step[:size].reshape(-1, 2), diameter + step[size], force + step[size + 1 :]
    assert np.abs(wrong).max() < 1e-14
    assert force.min() > 1e-3
    # no overlap by rounding
    return packing.replace(position_nd=place, radius_n=np.full(packing.particles, 0.5 * diameter * (1.0 - 1e-14)))


def lowest_mode(scene):
    return pm.normal_modes(scene, count=1, rattlers="keep").displacement_mnd[0]


def energy_along(scene, mode, amplitude):
    packing = scene.packing
    return pm.energy(scene.replace(packing=packing.replace(position_nd=packing.position_nd + amplitude * mode)))


def widest_angle(packing, particle):
    """Return the widest angle between neighboring contacts of a disc: below pi, it cannot move by itself."""
    contacts = pm.find_contacts(packing, gap_tolerance=1e-7)
    out = np.concatenate([contacts.normal_cd[contacts.i_c == particle], -contacts.normal_cd[contacts.j_c == particle]])
    angle = np.sort(np.arctan2(out[:, 1], out[:, 0]))
    return np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()


def test_both_have_nearly_the_same_packing_fraction():
    one, other = (pm.packing_fraction(scene().packing) for scene in (stable, local))
    assert (round(one, 4), round(other, 4)) == (0.7254, 0.7236)
    assert abs(one - other) < 0.002


@pytest.mark.parametrize("scene", [stable, local])
def test_every_disc_is_held_by_its_neighbors(scene):
    packing = scene().packing
    assert max(widest_angle(packing, particle) for particle in range(7)) < np.pi - 0.01


def test_stable_packing_is_collectively_jammed_and_the_other_only_locally():
    verdict = pm.classify_jamming(stable())
    assert (verdict.local, verdict.collective) == ("jammed", "jammed")
    assert (verdict.contacts, verdict.states_of_self_stress["none"]) == (13, 1)
    assert verdict.mechanically_stable
    verdict = pm.classify_jamming(local())
    assert (verdict.local, verdict.collective) == ("jammed", "not jammed")
    assert (verdict.contacts, verdict.states_of_self_stress["none"]) == (12, 1)
    assert verdict.collectively.floppy_modes == 1
    assert not verdict.rattlers.any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_energy_along_the_lowest_mode_of_the_stable_packing_grows_as_the_square(sign):
    scene = stable()
    mode = sign * lowest_mode(scene)
    start = pm.energy(scene)
    amplitude = np.geomspace(3e-5, 3e-3, 5)
    change = np.array([energy_along(scene, mode, a) for a in amplitude]) - start
    slope = np.diff(np.log(change)) / np.diff(np.log(amplitude))
    assert np.abs(slope - 2.0).max() < 0.03


def test_energy_of_the_stable_packing_starts_with_half_the_eigenvalue():
    scene = stable(1e-12)  # overlaps large enough for their rounding to be small against the change
    modes = pm.normal_modes(scene, count=1, rattlers="keep")
    assert modes.eigenvalue_m[0] > 1e-6  # the source's threshold for "nonzero"
    small = 0.1 * pm.find_contacts(scene.packing, gap_tolerance=0.0).overlap_c.min() * scene.packing.reference_diameter
    both = sum(energy_along(scene, sign * modes.displacement_mnd[0], small) for sign in (1.0, -1.0))
    assert (both - 2.0 * pm.energy(scene)) / small**2 == pytest.approx(modes.eigenvalue_m[0], rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_energy_along_the_lowest_mode_of_the_locally_stable_packing_stays_zero(sign):
    scene = local()
    mode = sign * lowest_mode(scene)
    diameter = scene.packing.reference_diameter
    # farther on two discs meet that did not touch, in one direction at .14 and in the other at .26
    for amplitude in np.linspace(0.0, 0.13, 27) * diameter:
        # rounding of a distance, squared
        assert energy_along(scene, mode, amplitude) < 1e-28
    # every contact that the mode turns has opened
    moved = scene.packing.replace(position_nd=scene.packing.position_nd + 0.13 * diameter * mode)
    assert len(pm.find_contacts(moved, gap_tolerance=1e-9)) < CONTACTS


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_lowest_mode_played_by_hard_discs_is_blocked_in_the_one_and_goes_on_in_the_other(sign):
    blocked, free = (pm.play_motion(s, sign * lowest_mode(s), amplitude=0.1, steps=10) for s in (stable(), local()))
    assert (blocked.outcome, blocked.steps) == ("blocked", 0)
    assert free.outcome == "unjammed"
    assert free.energy_t.max() < 1e-28
