"""Ellipses, spheroids and rigid bodies that fall, bounce and rock between walls in time, and those that are held."""

import math

import numpy as np
import pytest

import packmech as pm

ELLIPSES = pm.Ellipses(aspect=1.8)
BODIES = pm.Trimer(angle=2.0)
SQUARISH = pm.Superellipses(3.0)


def tumbling(dimension=2, damping=0.0, shapes=ELLIPSES):
    """A few particles in a closed container that is shorter than they would like."""
    packing = pm.random_packing(6, dimension=dimension, packing_fraction=0.35, shapes=shapes, seed=5)
    side = packing.box.lattice_dd[0, 0]
    walls = tuple(pm.Walls(k, 0.3, side - 0.3, damping=damping) for k in range(dimension))
    weight = pm.Gravity(0.0, -0.02)
    start = pm.quench(pm.Scene(packing, (pm.Repulsion(), *walls)), force_tolerance=1e-3, check=False).packing
    return pm.Scene(start, (pm.Repulsion(), *walls, weight))


def motion(scene, seed=1):
    rng = np.random.default_rng(seed)
    n, d = scene.packing.position_nd.shape
    return {"velocity_nd": 0.1 * rng.normal(size=(n, d)), "spin_nk": 0.1 * rng.normal(size=(n, 1 if d == 2 else 3))}


@pytest.mark.parametrize("shapes", [ELLIPSES, BODIES])
@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_energy_between_walls_is_kept_to_second_order(dimension, shapes):
    scene = tumbling(dimension, shapes=shapes)

    def error(dt, steps):
        run = pm.simulate(scene, steps=steps, dt=dt, trace_every=steps // 500, check=False, **motion(scene))
        trace = run.trace
        whole = trace.energy_t + trace.kinetic_t
        assert np.abs(np.diff(trace.energy_t)).max() > 0.0
        return np.abs(whole - whole[0]).max()

    # contacts that open and close within a step scatter the order a little
    order = math.log(error(0.02, 1000) / error(0.00125, 16000)) / math.log(16.0)
    assert 1.8 < order < 2.5


@pytest.mark.parametrize(("dimension", "exponent"), [(2, 4.0), (3, 2.0)])
def test_a_superellipsoid_that_bounces_off_a_floor_keeps_its_energy_to_second_order(dimension, exponent):
    # it meets the floor twice, both times with a corner: no face turns past the floor
    turn, ratio, spin = [math.cos(0.6), math.sin(0.6)], [1.5, 1.0], [0.2]
    if dimension == 3:
        turn, ratio, spin = [0.8, 0.4, 0.4, 0.2], [1.5, 1.2, 1.0], [0.2, -0.1, 0.3]
    packing = pm.Packing(
        [[3.0, 1.75, 3.0][:dimension]],
        [0.5],
        pm.Box.cubic(6.0, dimension),
        shapes=pm.Superellipsoids([exponent], [ratio], [turn]),
    )
    # a law whose stiffness begins at zero, where contacts open and close
    floor = pm.Walls(1, 1.0, 5.0, law=pm.PowerLaw(1.0, 3.0))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -0.05), floor))
    error = []
    for dt in (0.04, 0.02, 0.01):
        run = pm.simulate(
            scene, duration=16.0, dt=dt, trace_every=1, velocity_nd=[[0.02, -0.3, 0.05][:dimension]], spin_nk=[spin]
        )
        whole = run.trace.energy_t + run.trace.kinetic_t
        error.append(np.abs(whole - whole[0]).max())
        assert np.abs(run.spin_nk - spin).max() > 0.1
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.05)
    assert error[1] / error[2] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("shapes", [ELLIPSES, BODIES, SQUARISH])
def test_the_energy_of_a_run_is_that_of_the_packing(shapes):
    scene = tumbling(shapes=shapes)
    run = pm.simulate(scene, steps=200, dt=0.05, trace_every=200, check=False, **motion(scene))
    assert run.trace.energy_t[-1] == pytest.approx(pm.energy(scene.replace(packing=run.packing)), rel=1e-11)


@pytest.mark.parametrize("shapes", [ELLIPSES, BODIES, SQUARISH])
def test_a_dashpot_of_a_wall_only_takes_energy(shapes):
    scene = tumbling(damping=0.4, shapes=shapes)
    run = pm.simulate(scene, steps=4000, dt=0.02, trace_every=40, check=False, **motion(scene))
    trace = run.trace
    whole = trace.energy_t + trace.kinetic_t
    assert np.diff(whole).max() < 1e-5 * np.ptp(whole) and whole[-1] < whole[0]


def test_discs_written_as_round_ellipses_bounce_off_walls_as_discs_do():
    packing = pm.random_packing(6, dimension=2, packing_fraction=0.3, seed=5)
    side = packing.box.lattice_dd[0, 0]
    walls = tuple(pm.Walls(k, 0.3, side - 0.3, damping=0.2) for k in range(2))
    scene = pm.Scene(packing, (pm.Repulsion(), *walls, pm.Gravity(0.0, -0.05), pm.FixedParticles((2,))))
    round_ones = scene.replace(packing=packing.replace(shapes=pm.Spheroids(np.ones(6), np.eye(2)[[0] * 6])))
    velocity = motion(scene)["velocity_nd"]
    one, other = (
        pm.simulate(each, steps=300, dt=0.03, velocity_nd=velocity, check=False) for each in (scene, round_ones)
    )
    np.testing.assert_allclose(other.packing.position_nd, one.packing.position_nd, rtol=0, atol=1e-10)
    np.testing.assert_allclose(other.velocity_nd, one.velocity_nd, rtol=0, atol=1e-10)


def test_an_ellipse_rocks_on_a_floor_with_the_period_of_its_shape():
    radius, aspect, weight, stiffness = 0.5, 2.0, 0.01, 50.0
    a, b = radius * math.sqrt(aspect), radius / math.sqrt(aspect)
    height = b * (1.0 - math.pi * radius**2 * weight * b / (2.0 * stiffness * radius**2))
    tilt = 1e-3
    shapes = pm.Spheroids([aspect], [[math.cos(tilt), math.sin(tilt)]])
    packing = pm.Packing([[2.0, 1.0 + height]], [radius], pm.Box.cubic(4.0, 2), shapes=shapes)
    floor = pm.Walls(1, 1.0, 3.9, law=pm.LinearSpring(stiffness))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -weight), floor))
    square = weight * height * (a**2 - b**2) / b**2 / ((a**2 + b**2) / 4.0)
    half = math.pi / math.sqrt(square)
    steps = 4000
    run = pm.simulate(scene, steps=steps, dt=half / steps, check=False)
    end = math.atan2(run.packing.shapes.director_nd[0, 1], run.packing.shapes.director_nd[0, 0])
    assert end == pytest.approx(-tilt, rel=1e-3)


@pytest.mark.parametrize("shapes", [ELLIPSES, BODIES, SQUARISH])
@pytest.mark.parametrize("velocity", [(), (0.02, -0.01)])
def test_what_is_held_keeps_its_direction_and_goes_on_as_it_does(velocity, shapes):
    scene = tumbling(shapes=shapes)
    held = scene.replace(effects=(*scene.effects, pm.FixedParticles((1,), velocity)))
    run = pm.simulate(held, steps=300, dt=0.03, check=False, **motion(scene))
    start, end = scene.packing, run.packing
    went = np.array(velocity or (0.0, 0.0)) * 9.0
    np.testing.assert_allclose(end.position_nd[1] - start.position_nd[1], went, atol=1e-12)
    assert np.abs(end.shapes.rotation_since(start.shapes)[1]).max() < 1e-14
    assert run.spin_nk[1] == 0.0
    moved = np.abs(end.position_nd - start.position_nd).max(axis=1)
    assert np.delete(moved, 1).min() > 1e-3


def test_threads_change_no_bit():
    scene = tumbling()
    whole = pm.simulate(scene, steps=120, dt=0.05, check=False, **motion(scene))
    again = pm.simulate(scene, steps=120, dt=0.05, check=False, threads=2, **motion(scene))
    assert whole.packing == again.packing
