"""Facts about minimizers of packings with shapes: gradients, the minima they find, Newton's method."""

import numpy as np
import pytest

import packmech as pm
from packmech.minimize.program import build_program

METHODS = (pm.Fire(), pm.Fire2(), pm.LBFGS(), pm.ConjugateGradient(), pm.GradientDescent())


def crowd(d, count=20, seed=1, aspect=1.6):
    fraction = 0.95 if d == 2 else 0.85
    packing = pm.random_packing(count, dimension=d, packing_fraction=fraction, seed=seed, shapes=pm.Ellipses(aspect))
    return pm.Scene(packing, (pm.Repulsion(),))


@pytest.mark.parametrize("d", [2, 3])
def test_forces_on_coordinates_are_slopes_of_the_energy(d):
    scene = crowd(d)
    program = build_program(scene)
    now = program.evaluate()
    stress = pm.stress_tensor(scene)
    assert now.energy == pytest.approx(pm.energy(scene), rel=1e-13)
    assert np.abs(now.force_nd[:20] - pm.forces(scene)).max() < 1e-13
    assert np.abs(now.stress_dd - 0.5 * (stress + stress.T)).max() < 1e-13
    assert now.contacts == len(pm.find_shape_contacts(scene.packing, gap_tolerance=0.0))
    where, rng, step = program.coordinates(), np.random.default_rng(1), 1e-6
    for _ in range(3):
        way = rng.normal(size=where.shape)
        slope = (program.evaluate(where + step * way).energy - program.evaluate(where - step * way).energy) / (2 * step)
        assert slope == pytest.approx(-(now.force_nd * way).sum(), rel=1e-7, abs=1e-8)
    # longer directors turn nobody
    assert np.abs((now.force_nd[20:] * where[20:]).sum(axis=1)).max() < 1e-14


@pytest.mark.parametrize("d", [2, 3])
def test_torques_are_forces_on_directors_times_the_radius_of_gyration(d):
    scene = crowd(d, seed=2)
    packing, torque = scene.packing, pm.torques(scene)
    turn = packing.shapes.turn_basis(packing.radius_n)
    wanted = np.einsum("nkt,nt->nk", turn, torque.reshape(20, -1))
    pull = build_program(scene).evaluate().force_nd[20:]
    assert np.abs(np.sqrt((pull**2).sum(axis=1)) - np.sqrt((wanted**2).sum(axis=1))).max() < 1e-13


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
def test_every_minimizer_turns_particles_to_a_minimum(d, method):
    scene = crowd(d)
    run = pm.quench(scene, force_tolerance=1e-5, method=method)
    there = scene.replace(packing=run.packing)
    assert run.ok and run.residual <= 1e-5 and pm.energy(there) < 0.5 * pm.energy(scene)
    radius = run.packing.radius_n
    assert (
        np.abs(pm.torques(there) / run.packing.shapes.gyration(radius)[:, None]).max()
        < 1e-3 * np.abs(pm.torques(scene)).max()
    )
    assert np.abs((run.packing.shapes.director_nd * scene.packing.shapes.director_nd).sum(axis=1)).min() < 0.99


@pytest.mark.parametrize("d", [2, 3])
def test_newtons_method_ends_at_rounding_and_says_so(d):
    scene = crowd(d, seed=3)
    run = pm.quench(scene, force_tolerance=1e-11)
    assert run.ok and run.residual < 1e-10 and run.stages[-1].name == "Newton"
    again = pm.quench(scene, force_tolerance=1e-11)
    assert again.packing == run.packing
    there = scene.replace(packing=run.packing)
    assert max(np.abs(pm.forces(there)).max(), np.abs(pm.torques(there)).max()) < 1e-10
    assert (np.linalg.eigvalsh(pm.hessian(there).toarray()) > -1e-10).all()


def test_relabelled_particles_come_to_rest_in_the_same_place():
    scene = crowd(2, seed=4)
    order = np.random.default_rng(1).permutation(20)
    one, other = (
        pm.quench(scene.replace(packing=packing), force_tolerance=1e-9).packing
        for packing in (scene.packing, scene.packing.select(order))
    )
    apart = one.position_nd[order] - other.position_nd
    assert np.abs(apart - apart.mean(axis=0)).max() < 1e-9
    assert np.abs(one.shapes.director_nd[order] - other.shapes.director_nd).max() < 1e-9


@pytest.mark.parametrize("d", [2, 3])
def test_aspect_one_takes_the_way_of_discs(d):
    start = pm.random_packing(20, dimension=d, packing_fraction=0.95 if d == 2 else 0.75, seed=5)
    shapes = pm.Spheroids(np.ones(20), np.random.default_rng(1).normal(size=(20, d)))
    discs, shaped = (
        build_program(pm.Scene(packing, (pm.Repulsion(),))).relax(force_tolerance=1e-2, method=pm.Fire())
        for packing in (start, start.replace(shapes=shapes))
    )
    assert abs(discs.steps - shaped.steps) <= 2 and discs.energy == pytest.approx(shaped.energy, rel=1e-3)
    assert np.abs(shaped.packing.shapes.director_nd - shapes.director_nd).max() < 1e-15


def test_coordinates_are_those_of_the_packing_and_back():
    scene = crowd(3)
    program = build_program(scene)
    assert np.array_equal(program.coordinates_of(scene.packing)[:20], scene.packing.position_nd)
    assert program.coordinates().shape == (40, 3)
    turned = scene.packing.replace(shapes=scene.packing.shapes.turned(np.full((20, 3), 0.3)))
    program.put(turned)
    assert np.abs(program.packing().shapes.director_nd - turned.shapes.director_nd).max() < 1e-15
    # positions alone leave the directors as they are
    program.place(scene.packing.position_nd + 0.1)
    assert np.abs(program.packing().shapes.director_nd - turned.shapes.director_nd).max() < 1e-15


def test_deep_overlaps_under_a_law_that_diverges_are_relaxed_first():
    scene = crowd(2).replace(effects=(pm.Repulsion(pm.RepulsiveLennardJones()),))
    run = pm.quench(scene, force_tolerance=1e-6)
    assert run.ok and run.stages[0].name == "harmonic law first"


def test_traces_keep_directors():
    scene = crowd(2)
    run = pm.quench(scene, force_tolerance=1e-4, trace_every=20, trace_positions=True)
    assert run.trace.orientation_tnq.shape == run.trace.position_tnd.shape
    shapes = pm.Spheroids(scene.packing.shapes.aspect_n, run.trace.orientation_tnq[-1])
    there = scene.replace(packing=run.packing.replace(position_nd=run.trace.position_tnd[-1], shapes=shapes))
    assert pm.energy(there) == pytest.approx(run.trace.energy_t[-1], rel=1e-10)
