"""Energy, forces, stress and contacts do not depend on how a packing is written down (up to rounding).

The bounds are those of rounding: a center written with coordinates of size X is known to X epsilon, so a distance is
uncertain by a few X epsilon, an energy by the sum of |u'| and a force by the sum of (u'' + |u'|/r) times that.
"""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.effects import contact_terms

EPSILON = float(np.finfo(float).eps)
LAWS = [pm.Harmonic(1.5), pm.Hertz(), pm.RepulsiveLennardJones(0.5), pm.LinearSpring(2.0), pm.PowerLaw(1.0, 3.0)]


class Answer(NamedTuple):
    energy: float
    force_nd: np.ndarray
    stress_dd: np.ndarray
    contacts: int


def answer(scene):
    return Answer(
        pm.energy(scene), pm.forces(scene), pm.stress_tensor(scene),
        len(pm.find_contacts(scene.packing, gap_tolerance=0.0)),
    )  # fmt: skip


def rounding(*scenes):
    """Return the bounds on energy, force and stress that rounding of the coordinates of these scenes allows."""
    bounds = []
    for scene in scenes:
        packing = scene.packing
        contacts = pm.find_contacts(packing, gap_tolerance=0.0)
        terms = contact_terms(scene.effects, contacts)
        images = 1 + np.abs(contacts.image_cd).max(initial=0)
        size = np.abs(packing.position_nd).max() + images * np.abs(packing.box.lattice_dd).max()
        shift = 16 * EPSILON * size
        first, stiff = np.abs(terms.first_c), terms.second_c + np.abs(terms.first_c) / contacts.distance_c
        bounds.append(
            (
                shift * first.sum() + 64 * EPSILON * terms.energy_c.sum(),
                shift * stiff.sum() + 64 * EPSILON * first.sum(),
                shift * (stiff * contacts.distance_c + first).sum() / packing.box.volume,
            )
        )
    return np.array(bounds).max(axis=0)


@st.composite
def scenes(draw):
    """A random scene: 1 to 12 particles, 2D or 3D, skewed box, sizes up to 1:5, crowded or dilute."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    dimension = draw(st.sampled_from([2, 3]))
    shape = np.eye(dimension) + 0.5 * rng.standard_normal((dimension, dimension))
    assume(abs(np.linalg.det(shape)) > 0.05)
    packing = pm.random_packing(
        draw(st.integers(1, 12)),
        dimension=dimension,
        packing_fraction=draw(st.floats(0.3, 1.5)),
        sizes=pm.Uniform(ratio=5.0),
        box=shape,
        rng=rng,
    )
    contacts = pm.find_contacts(packing, gap_tolerance=1e-6)
    # not on the edge of touching, nor so deep that rounding of the distance alone decides
    assume(np.abs(contacts.overlap_c).min(initial=1.0) > 1e-9)
    assume((contacts.distance_c / contacts.contact_distance_c).min(initial=1.0) > 0.05)
    return pm.Scene(packing, (pm.Repulsion(law=draw(st.sampled_from(LAWS))),))


def assert_same(found, expected, bounds):
    assert found.contacts == expected.contacts
    assert abs(found.energy - expected.energy) <= bounds[0]
    np.testing.assert_allclose(found.force_nd, expected.force_nd, rtol=0, atol=bounds[1])
    np.testing.assert_allclose(found.stress_dd, expected.stress_dd, rtol=0, atol=bounds[2])


PROPERTY = settings(max_examples=60, deadline=None)


@PROPERTY
@given(scenes(), st.floats(-10, 10))
def test_translation_changes_nothing(scene, shift):
    packing = scene.packing
    direction = np.arange(1.0, packing.dimension + 1)
    moved = scene.replace(packing=packing.replace(position_nd=packing.position_nd + shift * direction))
    assert_same(answer(moved), answer(scene), rounding(scene, moved))


@PROPERTY
@given(scenes(), st.integers(0, 2**32))
def test_rotation_rotates_forces_and_stress(scene, seed):
    packing = scene.packing
    turn = np.linalg.qr(np.random.default_rng(seed).standard_normal((packing.dimension, packing.dimension)))[0]
    turned = scene.replace(
        packing=pm.Packing(packing.position_nd @ turn.T, packing.radius_n, pm.Box(turn @ packing.box.lattice_dd))
    )
    before = answer(scene)
    expected = before._replace(force_nd=before.force_nd @ turn.T, stress_dd=turn @ before.stress_dd @ turn.T)
    assert_same(answer(turned), expected, packing.dimension * rounding(scene, turned))


@PROPERTY
@given(scenes(), st.integers(0, 2**32))
def test_relabelling_permutes_forces(scene, seed):
    packing = scene.packing
    order = np.random.default_rng(seed).permutation(packing.particles)
    relabelled = scene.replace(
        packing=packing.replace(position_nd=packing.position_nd[order], radius_n=packing.radius_n[order])
    )
    before = answer(scene)
    assert_same(answer(relabelled), before._replace(force_nd=before.force_nd[order]), rounding(scene))


@PROPERTY
@given(scenes(), st.integers(0, 2**32))
def test_moving_particles_by_lattice_vectors_changes_nothing(scene, seed):
    packing = scene.packing
    cells_nd = np.random.default_rng(seed).integers(-5, 6, packing.position_nd.shape)
    moved = scene.replace(
        packing=packing.replace(position_nd=packing.position_nd + cells_nd @ packing.box.lattice_dd.T)
    )
    assert_same(answer(moved), answer(scene), rounding(scene, moved))


@PROPERTY
@given(scenes(), st.lists(st.integers(-3, 3), min_size=3, max_size=3))
def test_other_lattice_vectors_of_the_same_lattice_change_nothing(scene, steps):
    packing = scene.packing
    change = np.eye(packing.dimension, dtype=int)
    for k, step in enumerate(steps[: packing.dimension]):
        change[:, k] += step * change[:, (k + 1) % packing.dimension]
    other = scene.replace(packing=packing.replace(box=pm.Box(packing.box.lattice_dd @ change)))
    assert_same(answer(other), answer(scene), rounding(scene, other))


@PROPERTY
@given(scenes(), st.integers(-40, 40))
def test_unit_of_length_scales_forces_to_the_last_bit_and_stress(scene, power):
    # a power of two is exact; 2^40 is 1e12
    assume(not isinstance(scene.effects[0].law, pm.LinearSpring))
    packing, unit = scene.packing, 2.0**power
    scaled = scene.replace(
        packing=pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    )
    before, after = answer(scene), answer(scaled)
    assert (after.energy, after.contacts) == (before.energy, before.contacts)
    assert np.array_equal(after.force_nd * unit, before.force_nd)
    # but for the volume, a determinant that is computed as the exponential of a sum of logarithms
    logarithms = sum(abs(np.log(one.packing.box.volume)) for one in (scene, scaled))
    rounding_of_volume = EPSILON * (8 + 2 * logarithms)
    np.testing.assert_allclose(after.stress_dd * unit**packing.dimension, before.stress_dd, rtol=rounding_of_volume)


@PROPERTY
@given(scenes(), st.sampled_from([1e-12, 1e-3, 7.0, 1e12]))
def test_decimal_units_of_length_scale_forces_and_stress(scene, unit):
    assume(not isinstance(scene.effects[0].law, pm.LinearSpring))
    packing = scene.packing
    scaled = scene.replace(
        packing=pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    )
    after = answer(scaled)
    after = after._replace(force_nd=after.force_nd * unit, stress_dd=after.stress_dd * unit**packing.dimension)
    assert_same(after, answer(scene), rounding(scene))


@PROPERTY
@given(scenes(), st.integers(-40, 40))
def test_unit_of_energy_scales_everything_to_the_last_bit(scene, power):
    law, unit = scene.effects[0].law, 2.0**power
    field = law._fields[0]
    scaled = scene.replace(effects=(pm.Repulsion(law=law._replace(**{field: unit * getattr(law, field)})),))
    before, after = answer(scene), answer(scaled)
    assert (after.energy, after.contacts) == (unit * before.energy, before.contacts)
    assert np.array_equal(after.force_nd, unit * before.force_nd)
    assert np.array_equal(after.stress_dd, unit * before.stress_dd)


@PROPERTY
@given(scenes(), st.floats(-40, 40))
def test_pressure_in_its_own_unit_has_no_unit(scene, power):
    assume(not isinstance(scene.effects[0].law, pm.LinearSpring))
    packing, unit = scene.packing, 2.0 ** round(power)
    scaled = scene.replace(
        packing=pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    )
    numbers = [pm.pressure(one) / one.pressure_unit for one in (scene, scaled)]
    assert numbers[1] == pytest.approx(numbers[0], rel=1e-13)


@PROPERTY
@given(scenes())
def test_forces_add_up_to_nothing(scene):
    assert np.abs(pm.forces(scene).sum(axis=0)).max() <= rounding(scene)[1]


@PROPERTY
@given(scenes())
def test_stress_is_symmetric_and_its_trace_is_minus_d_times_the_pressure(scene):
    stress = pm.stress_tensor(scene)
    bound = rounding(scene)[2]
    np.testing.assert_allclose(stress, stress.T, rtol=0, atol=bound)
    assert abs(np.trace(stress) + scene.packing.dimension * pm.pressure(scene)) <= bound


@PROPERTY
@given(scenes())
def test_the_same_scene_gives_the_same_bits_again(scene):
    first, second = answer(scene), answer(scene)
    assert first.energy == second.energy
    assert first.force_nd.tobytes() == second.force_nd.tobytes()
    assert first.stress_dd.tobytes() == second.stress_dd.tobytes()


@settings(max_examples=25, deadline=None)
@given(scenes(), st.sampled_from([2, 3]))
def test_repeating_the_cell_multiplies_energy_and_contacts_and_keeps_the_stress(scene, repeats):
    packing = scene.packing
    lattice = packing.box.lattice_dd
    copies = [packing.position_nd + k * lattice[:, 0] for k in range(repeats)]
    wider = lattice.copy()
    wider[:, 0] *= repeats
    repeated = scene.replace(
        packing=pm.Packing(np.concatenate(copies), np.tile(packing.radius_n, repeats), pm.Box(wider))
    )
    before, after = answer(scene), answer(repeated)
    bounds = rounding(repeated)
    assert after.contacts == repeats * before.contacts
    assert abs(after.energy - repeats * before.energy) <= bounds[0]
    np.testing.assert_allclose(after.force_nd, np.tile(before.force_nd, (repeats, 1)), rtol=0, atol=bounds[1])
    np.testing.assert_allclose(after.stress_dd, before.stress_dd, rtol=0, atol=bounds[2])
