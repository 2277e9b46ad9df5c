"""Batches of ellipses, spheroids and rigid bodies: what pm.quench does to each, and the same bits on any threads."""

from functools import cache

import numpy as np
import pytest

import packmech as pm

SHAPES = {
    "ellipses": (2, pm.Ellipses(aspect=1.5), 0.9),
    "trimers": (3, pm.Trimer(), 0.65),
}
SLOW = {"spheroids": (3, pm.Ellipses(aspect=1.4), 0.7), "dimers": (2, pm.Dimer(), 0.9)}
KINDS = [*SHAPES, *(pytest.param(kind, marks=pytest.mark.slow) for kind in SLOW)]


@cache
def scene(kind, particles=14):
    dimension, shapes, fraction = {**SHAPES, **SLOW}[kind]
    packing = pm.random_packing(particles, dimension=dimension, shapes=shapes, packing_fraction=fraction, seed=2)
    return pm.Scene(packing, (pm.Repulsion(),))


def starts(kind, count):
    packing = scene(kind).packing
    fraction = pm.packing_fraction(packing)
    return [pm.scattered_packing(packing, packing_fraction=fraction, seed=seed) for seed in range(count)]


@pytest.mark.parametrize("kind", KINDS)
def test_full_relaxation_is_the_quench_and_figures_are_the_measures(kind):
    batch = pm.QuenchBatch(scene(kind), force_tolerance=1e-6)
    batch.restart(0, starts(kind, 1)[0], relax=True)
    run = pm.quench(scene(kind).replace(packing=starts(kind, 1)[0]), method=pm.Fire(), force_tolerance=1e-6)
    now = batch.packing(0)
    assert batch.outcome(0) is run.outcome is pm.Outcome.CONVERGED
    np.testing.assert_allclose(now.position_nd, run.packing.position_nd, rtol=0, atol=1e-9)
    turned = now.shapes.rotation_since(run.packing.shapes)
    assert np.abs(turned).max() < 1e-8
    # steps of parting rigid bodies count in both
    assert batch.force_evaluations_b[0] == pytest.approx(run.force_evaluations, abs=4)
    here = scene(kind).replace(packing=now)
    contacts = pm.find_shape_contacts(now, gap_tolerance=0.0)
    assert batch.energy_b[0] == pytest.approx(pm.energy(here), rel=1e-11)
    assert batch.pressure_b[0] == pytest.approx(pm.pressure(here), rel=1e-11)
    # the stress is symmetric as far as torques balance
    np.testing.assert_allclose(batch.stress_bdd[0], pm.stress_tensor(here), atol=1e-6 * batch.pressure_b[0])
    assert batch.contacts_b[0] == len(contacts)
    freedom = (now.shapes.turn_basis(now.radius_n) != 0.0).any(axis=2).sum() + now.position_nd.size
    if not batch.rattlers_b[0]:
        assert batch.excess_contacts_b[0] == len(contacts) - (freedom - now.dimension + 1)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_strain_carries_centers_and_leaves_directions(kind):
    batch = pm.QuenchBatch(scene(kind), relax=1, force_tolerance=1e3)
    start = batch.packing(0)
    # a tolerance that everything meets: one look at the forces and no step
    batch.step([0.0], [0.1])
    now = batch.packing(0)
    strain = now.box.lattice_dd @ start.box.inverse_dd
    assert strain[0, 1] == pytest.approx(0.1, rel=1e-12)
    np.testing.assert_allclose(now.position_nd, start.position_nd @ strain.T, atol=1e-12)
    assert np.abs(now.shapes.rotation_since(start.shapes)).max() < 1e-14


@pytest.mark.parametrize(("kind", "relax"), [("ellipses", "full"), ("ellipses", 5), ("trimers", 5)])
def test_bits_depend_neither_on_the_others_nor_on_threads(kind, relax):
    packings = starts(kind, 4)
    rng = np.random.default_rng(3)
    moves = [(rng.uniform(-0.02, 0.02, 4), rng.uniform(-0.05, 0.05, 4)) for _ in range(6)]

    def ends(batch, index):
        for place, b in enumerate(index):
            batch.restart(place, packings[b], relax=True)
        for change, strain in moves:
            batch.step(change[index], strain[index])
        return [(batch.packing(place), batch.energy_b[place]) for place in range(len(index))]

    together = ends(pm.QuenchBatch(scene(kind), 4, relax=relax), np.arange(4))
    threads = ends(pm.QuenchBatch(scene(kind), 4, relax=relax, threads=2), np.arange(4))
    for b in range(4):
        alone = ends(pm.QuenchBatch(scene(kind), 1, relax=relax), np.array([b]))[0]
        for packing, energy in (together[b], threads[b]):
            assert np.array_equal(packing.position_nd, alone[0].position_nd) and packing.box == alone[0].box
            assert packing.shapes == alone[0].shapes and energy == alone[1]


def test_a_box_that_is_wound_up_goes_on_with_the_same_motion():
    """Sheared by more than a cell in portions, against one batch whose particles are wrapped in the middle."""
    for kind in SHAPES:
        batch = pm.QuenchBatch(scene(kind), relax=3, force_tolerance=1e-12)
        programs = []
        for _ in range(12):
            batch.step([0.0], [0.25])
            programs.append(batch._programs[0])
            now = scene(kind).replace(packing=batch.packing(0))
            assert batch.energy_b[0] == pytest.approx(pm.energy(now), rel=1e-10)
        assert len(set(map(id, programs))) > 1


def test_rotation_vectors_that_start_anew_keep_the_turning():
    """The rate of a rotation vector at its start is the angular velocity, before and after it starts anew."""
    batch = pm.QuenchBatch(scene("trimers"), relax=4, force_tolerance=1e-12)
    for _ in range(4):
        batch.step([0.0], [0.0])
    program = batch._programs[0]
    n = len(program.order_n)
    before, shapes = batch.packing(0), program.scene.packing.shapes
    rate = np.empty((n, 3))
    rate[program.order_n] = program.velocity_nd[n:]
    small = 1e-6
    ahead = program.coordinates()[n:] + small * rate
    turned = shapes.at_coordinates(ahead, before.radius_n).rotation_since(before.shapes) / small
    batch._wrap(0)
    program = batch._programs[0]
    again = np.empty((n, 3))
    again[program.order_n] = program.velocity_nd[n:] / before.shapes.gyration(before.radius_n)[program.order_n, None]
    # where bodies stand is the same, and how fast they turn
    assert np.abs(program.packing().shapes.rotation_since(before.shapes)).max() < 1e-14
    np.testing.assert_allclose(again, turned, atol=1e-4 * np.abs(turned).max())


def test_packings_of_another_kind_of_shape_are_refused():
    batch = pm.QuenchBatch(scene("ellipses"))
    with pytest.raises(ValueError, match="packing must have shapes of the kind of the scene's, Spheroids, got Discs"):
        batch.restart(0, scene("ellipses").packing.replace(shapes=None))
