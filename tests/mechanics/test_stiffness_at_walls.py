"""Facts about the linear response of what rests on rough walls: the engine's own derivatives, closed forms."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.effects import wall_sides
from packmech.measure.friction import wall_springs

SPRING = pm.LinearSpring(1e3)
STEP, CLOSE = 1e-5, 1e-7


@functools.cache
def between_walls(dimension, coefficient=1e6):
    """Return particles with stretched springs at each other and at rough walls, that slide nowhere."""
    packing = pm.random_packing(12, dimension=dimension, packing_fraction=0.6, seed=3)
    side = float(packing.box.lattice_dd[0, 0])
    height = np.ones(dimension)
    height[1] = 1.5
    packing = packing.replace(box=pm.Box(np.diag(side * height)), position_nd=packing.position_nd % side)
    reach = float(packing.radius_n.max())
    turning = (pm.RollingResistance(coefficient, 200.0), pm.TwistingResistance(coefficient, 100.0))[: dimension - 1]
    friction = pm.Friction(coefficient, 300.0)
    at_wall = dict(zip(("rolling", "twisting"), turning, strict=False))
    walls = pm.Walls(1, 0.6 * reach, side - 0.6 * reach, SPRING, friction=friction, **at_wall)
    scene = pm.Scene(packing, (pm.Repulsion(SPRING), friction, *turning, walls))
    rng = np.random.default_rng(7)
    n, k = len(packing.radius_n), 1 if dimension == 2 else 3
    moved = pm.simulate(
        scene, steps=20, dt=1e-3, check=False,
        velocity_nd=rng.normal(size=(n, dimension)), spin_nk=rng.normal(size=(n, k)),
    )  # fmt: skip
    assert len(moved.packing.tangential.at_wall_w) > 3
    return scene.replace(packing=moved.packing)


def pushes(scene, motion_nq, step):
    """Return the engine's forces and torques after one small step of particles too heavy to be moved by them."""
    n, d = scene.packing.position_nd.shape
    heavy = scene.replace(packing=scene.packing.replace(mass_n=np.full(n, 1e14)))
    engine = build_engine(
        heavy, dt=step, velocity_nd=motion_nq[:, :d], spin_nk=motion_nq[:, d:], second_order=False
    )  # fmt: skip
    engine.advance(1)
    push = np.empty_like(engine.state.push)
    push[engine.order_n] = engine.state.push
    return push


def lengths(packing, motion_nq):
    """Return what makes lengths of displacements and rotations: 1, and radii of gyration."""
    scale = np.ones_like(motion_nq)
    scale[:, packing.dimension :] = packing.shapes.gyration(packing.radius_n)[:, None]
    return scale


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_stiffness_is_the_derivative_of_the_engines_forces_and_torques_at_rough_walls(dimension):
    scene = between_walls(dimension)
    n, k = scene.packing.particles, 1 if dimension == 2 else 3
    motion = np.random.default_rng(5).normal(size=(n, dimension + k))
    scale = lengths(scene.packing, motion)
    ahead, behind = (pushes(scene, sign * motion, STEP) for sign in (1.0, -1.0))
    change = (ahead - behind) / (2.0 * STEP) / scale
    at_walls = scene.packing.tangential.at_wall_w
    expected = (pm.stiffness_matrix(scene, "none") @ (motion * scale).ravel()).reshape(change.shape)
    assert np.abs(expected + change).max() < CLOSE * np.abs(change).max()
    bare = (pm.stiffness_matrix(scene, "none", "unstressed") @ (motion * scale).ravel()).reshape(change.shape)
    assert np.abs(bare + change)[at_walls].max() > 1e-4 * np.abs(change).max()


@functools.cache
def among_ridges():
    """Return spheres with stretched springs at faces, ridges and peaks of a rough surface, that slide nowhere."""
    rng, x = np.random.default_rng(5), np.linspace(0.0, 6.0, 7)
    at = np.array([[u, v, 2.0 + rng.uniform(-0.5, 0.5)] for u in x for v in x])
    first = np.array([7 * i + j for i in range(6) for j in range(6)])
    one = np.column_stack([first, first + 1, first + 7])
    faces = np.concatenate([one, np.column_stack([first + 1, first + 8, first + 7])])
    sticking = pm.Friction(1e6, 300.0), pm.RollingResistance(1e6, 200.0), pm.TwistingResistance(1e6, 100.0)
    ridges = pm.MeshWalls(at, faces, SPRING, 0.0, *sticking)
    peak = at[np.argsort(at[:, 2])[-6:]] + [0.02, 0.01, 0.48]
    high, low = (at.reshape(7, 7, 3)[1:6:2, 1:6:2].reshape(-1, 3) + [s, s, 0.4] for s in (0.5, 0.3))
    place = np.concatenate([peak, high, low])
    packing = pm.Packing(place, [0.5] * len(place), pm.Box.cubic(6.0, 3), mass_n=[1.0] * len(place))
    scene = pm.Scene(packing, (pm.Repulsion(SPRING), *sticking, ridges))
    moved = pm.simulate(
        scene, steps=10, dt=1e-3, check=False,
        velocity_nd=rng.normal(size=place.shape), spin_nk=rng.normal(size=place.shape),
    )  # fmt: skip
    return scene.replace(packing=moved.packing)


def test_the_stiffness_is_the_derivative_of_the_engines_forces_and_torques_over_edges_and_corners():
    scene = among_ridges()
    packing = scene.packing
    side = wall_sides(scene.effects, packing)[-1]
    springs = wall_springs(packing, [side])
    # faces bend nothing, edges one way, corners both
    bends = np.linalg.matrix_rank(springs.bend_wdd, tol=1e-6)
    assert set(bends) == {0, 1, 2}
    assert np.abs(springs.force_wd)[bends == 2].max() > 0.1 and np.abs(springs.rolling_wd)[bends == 1].max() > 0.1
    motion = np.random.default_rng(5).normal(size=(packing.particles, 6))
    scale = lengths(packing, motion)
    ahead, behind = (pushes(scene, sign * motion, STEP) for sign in (1.0, -1.0))
    change = (ahead - behind) / (2.0 * STEP) / scale
    expected = (pm.stiffness_matrix(scene, "none") @ (motion * scale).ravel()).reshape(change.shape)
    assert np.abs(expected + change).max() < CLOSE * np.abs(change).max()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_disc_that_slides_on_a_wall_follows_the_normal_force_and_returns_as_on_a_spring(sign):
    """A disc pressed into a floor with its spring at mu N: loaded it slides, unloaded it sticks."""
    mu, stiffness = 0.4, 300.0
    packing = pm.Packing([[5.0, 0.49]], [0.5], pm.Box.cubic(20.0, 2), mass_n=[1.0])
    walls = pm.Walls(1, 0.0, 15.0, SPRING, friction=pm.Friction(mu, stiffness))
    normal = 2.0 * 0.01 * 1e3
    # carried until it slides, by a force along the floor that turns it, too
    run = pm.simulate(
        pm.Scene(packing.replace(mass_n=[1e14]), (pm.Repulsion(SPRING), walls)),
        steps=100, dt=1e-3, velocity_nd=[[sign, 0.0]], check=False,
    )  # fmt: skip
    scene = pm.Scene(run.packing.replace(mass_n=[1.0]), (pm.Repulsion(SPRING), walls))
    force = pm.forces(scene)
    assert force[0] == pytest.approx([-sign * mu * normal, normal], rel=1e-9)
    slip, stick = (pm.stiffness_matrix(scene, "none", contacts_at_limit=one).toarray() for one in ("slip", "stick"))
    gyration = 0.5 / np.sqrt(2.0)
    # deeper by 1: the normal force grows by twice the spring of the law, friction by mu of that, its arm shrinks
    deeper = np.array([0.0, -1.0, 0.0])
    steep = 2.0e3
    assert -slip @ deeper == pytest.approx(
        [-sign * mu * steep, steep, sign * (mu * normal - mu * steep * 0.49) / gyration], rel=1e-9
    )
    along = np.array([-sign, 0.0, 0.0])
    assert -stick @ along == pytest.approx([sign * stiffness, 0.0, sign * stiffness * 0.49 / gyration], abs=1e-9)
    assert np.abs(slip @ along).max() < 1e-9


def test_a_disc_on_a_rough_floor_has_the_frequencies_of_pressing_and_of_slipping_and_rolls_for_nothing():
    mass, stiffness, arm = 2.0, 300.0, 0.49
    packing = pm.Packing([[5.0, arm]], [0.5], pm.Box.cubic(20.0, 2), mass_n=[mass])
    walls = pm.Walls(1, 0.0, 15.0, SPRING, friction=pm.Friction(0.5, stiffness))
    scene = pm.Scene(packing, (pm.Repulsion(SPRING), walls, pm.Gravity(0.0, -2.0e3 * 0.01 / mass, 0.0)))
    modes = pm.frictional_modes(scene, rattlers="keep")
    slipping = stiffness * (1.0 / mass + arm**2 / (0.125 * mass))
    assert modes.eigenvalue_m.real == pytest.approx([0.0, slipping, 2.0e3 / mass], abs=1e-9)
    rolling = modes.displacement_mnd[0, 0, 0] + modes.rotation_mnk[0, 0, 0] * arm
    assert abs(rolling) < 1e-12 and abs(modes.rotation_mnk[0, 0, 0]) > 0.1


@pytest.mark.parametrize("held", [False, True], ids=["free", "held"])
def test_without_friction_it_is_the_hessian_of_what_walls_press_and_modes_are_its(held):
    scene = between_walls(2)
    plain = scene.packing.replace(tangential=None)
    smooth = scene.effects[-1]._replace(friction=pm.Friction(0.0), rolling=None)
    effects = (scene.effects[0], smooth, *([pm.FixedParticles((0, 3))] if held else []))
    without = pm.Scene(plain, effects)
    with_friction = without.replace(effects=(*effects, pm.Friction(0.0)))
    whole = pm.stiffness_matrix(with_friction, "none").toarray().reshape(12, 3, 12, 3)
    expected = pm.hessian(without, "none").toarray().reshape(12, 2, 12, 2)
    assert np.abs(whole[:, :2, :, :2] - expected).max() < 1e-12 * np.abs(expected).max()
    assert not whole[:, 2].any() and not whole[:, :, :, 2].any()
    modes = pm.frictional_modes(with_friction, rattlers="keep")
    free = 10 if held else 12
    # between smooth walls all slide along for nothing
    assert len(modes) == 3 * free - (not held)
    other = np.concatenate([pm.normal_modes(without, rattlers="keep").eigenvalue_m, np.zeros(free)])
    assert np.abs(np.sort(modes.eigenvalue_m.real) - np.sort(other)).max() < 1e-10 * modes.largest


def test_the_sparse_modes_are_those_of_dense_diagonalization_with_held_particles_and_rough_walls():
    scene = between_walls(2)
    scene = scene.replace(effects=(*scene.effects, pm.FixedParticles((0, 3))))
    whole = pm.frictional_modes(scene, rattlers="keep", method="dense")
    few = pm.frictional_modes(scene, 8, rattlers="keep", method="shift-invert")
    assert not few.displacement_mnd[:, [0, 3]].any()
    near = whole.eigenvalue_m[np.argsort(np.abs(whole.eigenvalue_m))[: len(few)]]
    assert np.abs(np.sort_complex(near) - np.sort_complex(few.eigenvalue_m)).max() < 1e-9 * whole.largest


@pytest.mark.parametrize("friction", [None, pm.Friction(0.0)])
def test_walls_that_only_resist_rolling_hold_a_disc_against_turning_alone(friction):
    disc = pm.Packing([[1.0, 0.49]], [0.5], pm.Box.cubic(3.0, 2))
    rolling = pm.RollingResistance(0.1, 0.3)
    walls = pm.Walls(1, 0.0, 3.0, pm.LinearSpring(1.0), friction=friction, rolling=rolling)
    found = pm.stiffness_matrix(pm.Scene(disc, (pm.Repulsion(), walls)), "none").toarray()
    # the coordinate of turns is the angle times the radius of gyration, r / sqrt 2
    assert np.allclose(found, np.diag([0.0, 2.0, 0.3 * 0.49**2 / (0.5 * 0.5**2)]), rtol=1e-12, atol=1e-15)
