"""Facts about contact forces with friction at rest: the engine's own, who is held by two contacts, what is counted."""

import functools
import math

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.rattlers import can_balance


@functools.cache
def at_rest(dimension, mu=0.5, particles=40):
    """Return a frictional scene at rest, with springs, and the run that brought it there."""
    fraction = 0.95 if dimension == 2 else 0.72
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=fraction, seed=2)
    effects = (
        pm.Repulsion(pm.LinearSpring(1.0)),
        pm.Friction(mu, 0.7, 0.2),
        pm.ContactDamping(0.2),
        pm.BackgroundDamping(0.3),
    )
    run = pm.simulate(pm.Scene(packing, effects), steps=12_000, dt=0.1, trace_every=12_000, trace_positions=True)
    return pm.Scene(run.packing, effects), run


@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_are_those_that_the_engine_took(dimension):
    scene, run = at_rest(dimension)
    found, told = pm.contact_forces(scene), run.trace.touching_t[-1]
    assert len(found.contacts) == len(told.i_c) > 60
    assert np.array_equal(found.contacts.i_c, told.i_c) and np.array_equal(found.contacts.image_cd, told.image_cd)
    scale = told.normal_c.mean()
    np.testing.assert_allclose(found.normal_c, told.normal_c, atol=1e-12 * scale)
    np.testing.assert_allclose(found.force_cd, told.force_cd, atol=1e-9 * scale)
    assert np.array_equal(found.at_limit_c, told.sliding_c)
    assert np.abs(found.tangential_cd).max() > 0.01 * scale


@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_and_torques_of_a_packing_at_rest_cancel(dimension):
    scene, _ = at_rest(dimension)
    found = pm.contact_forces(scene)
    assert found.residual < 1e-6
    assert np.abs(found.force_nd.sum(axis=0)).max() < 1e-13
    assert pm.torques(scene).shape == ((40,) if dimension == 2 else (40, 3))
    np.testing.assert_array_equal(pm.torques(scene).reshape(40, -1), found.torque_nk)
    # a stress without torques is symmetric
    assert np.abs(found.stress_dd - found.stress_dd.T).max() < 1e-6 * found.pressure
    slack = pm.contact_forces(scene.replace(packing=scene.packing.replace(tangential=None)))
    assert slack.residual > 1e-3 and not slack.tangential_cd.any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_net_forces_and_torques_are_those_that_the_engine_steps_with_to_rounding(dimension):
    """Of springs that are given, cut at the limit, and in space laid into the plane across the contact."""
    from packmech.dynamics.engine import build_engine

    packing = pm.random_packing(30, dimension=dimension, packing_fraction=0.9, seed=4)
    contacts = pm.find_contacts(packing)
    given = 0.1 * np.random.default_rng(2).normal(size=(len(contacts), 1 if dimension == 2 else 3))
    springs = pm.TangentialDisplacements(contacts.i_c, contacts.j_c, contacts.image_cd, given)
    scene = pm.Scene(packing.replace(tangential=springs), (pm.Repulsion(), pm.Friction(0.4, 0.7)))
    engine = build_engine(scene, dt=0.01, velocity_nd=np.zeros_like(packing.position_nd))
    engine.begin()
    push = np.empty_like(engine.state.push)
    push[engine.order_n] = engine.state.push
    found = pm.contact_forces(scene)
    assert 0 < found.at_limit_c.sum() < len(contacts)
    scale = found.normal_c.mean()
    assert np.abs(found.force_nd - push[:, :dimension]).max() < 1e-13 * scale * len(contacts)
    assert np.abs(found.torque_nk - push[:, dimension:]).max() < 1e-13 * scale * len(contacts)
    assert np.abs((found.tangential_cd * contacts.normal_cd).sum(axis=1)).max() < 1e-15


def test_without_friction_it_is_what_forces_and_stress_say():
    scene, _ = at_rest(2)
    bare = scene.without(pm.Friction)
    found = pm.contact_forces(bare)
    np.testing.assert_allclose(found.force_nd, pm.forces(bare), atol=1e-15)
    np.testing.assert_allclose(found.stress_dd, pm.stress_tensor(bare), atol=1e-15)
    assert not pm.torques(bare).any() and not found.at_limit_c.any()


def test_a_spring_beyond_the_limit_is_cut_to_it():
    springs = pm.TangentialDisplacements([0], [1], [[0, 0]], [[-0.4]])
    pair = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), tangential=springs)
    found = pm.contact_forces(pm.Scene(pair, (pm.Repulsion(pm.LinearSpring(2.0)), pm.Friction(0.25, 1.0))))
    assert found.tangential_cd[0] == pytest.approx([0.0, -0.25 * 0.2]) and found.at_limit_c.tolist() == [True]
    # arms are the shares of the distance, .45 each
    assert found.torque_nk[:, 0] == pytest.approx([-0.45 * 0.05] * 2)


def near_the_limit(distance_c, residual):
    """Return the contacts at the limit of a row of distances to it, over the mean normal force, at a residual."""
    from packmech.contacts.coulomb_limit import find_at_limit

    normal = np.ones(len(distance_c))
    return find_at_limit(0.5 - np.asarray(distance_c), normal, 0.5, residual)


# distances of an issue: a packing pressed to a residual of 8.5e-9, eight contacts apart from all others
PRESSED = [4e-9, 9e-9, 1.3e-8, 2e-8, 3.1e-8, 4.4e-8, 8e-8, 1.1e-7, 8e-3, 2e-2, 0.1, 0.3]


def test_contacts_that_a_wide_gap_parts_from_the_others_are_at_the_limit_however_far_the_residual_leaves_them():
    found = near_the_limit(PRESSED, 8.5e-9)
    assert found.at_limit_c.tolist() == [True] * 8 + [False] * 4 and not found.doubtful_c.any()
    assert 1.1e-7 < found.bound < 8e-3
    # what stands off the limit by more than the residual explains is none
    assert not near_the_limit([3e-6, 2e-4, 1e-3, 0.2, 0.4], 5e-9).at_limit_c.any()


def test_without_a_gap_the_contacts_beside_the_bound_are_doubtful():
    ladder = 10.0 ** np.arange(-8.0, 0.0, 0.5)
    found = near_the_limit(ladder, 1e-8)
    assert 1 <= found.doubtful_c.sum() <= 5
    assert (np.abs(np.log10(ladder[found.doubtful_c] / found.bound)) <= 1.0).all()


def test_contacts_that_slide_in_motion_are_at_the_limit_to_rounding_and_none_besides():
    found = near_the_limit([0.0, 1e-10, 1e-7, 1e-3], 0.4)
    assert found.at_limit_c.tolist() == [True, True, False, False] and not found.doubtful_c.any()


@functools.cache
def pressed(dimension, mu=0.1):
    """Return a scene pressed until it is at rest, to residuals of 1e-8 and, going on from there, of 1e-12."""
    sizes, fraction = (pm.Bidisperse(ratio=1.4), 0.7) if dimension == 2 else (pm.Monodisperse(), 0.5)
    packing = pm.random_packing(32, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(1.0)), pm.ContactDamping(0.3), pm.Friction(mu, 1.0, 0.1)))
    scenes = []
    for tolerance in (1e-8, 1e-12):
        method = pm.Press(force_tolerance=tolerance)
        scene = scene.replace(packing=pm.jam(scene, pressure=1e-2, strain="isotropic", method=method).packing)
        scenes.append(scene)
    return scenes


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_sliding_fraction_at_the_residual_of_jam_is_that_of_a_residual_of_1e_minus_12(dimension):
    rough, fine = (pm.contact_forces(scene) for scene in pressed(dimension))
    assert rough.residual > 1e-10 and fine.residual <= 1e-12
    # exactly at the limit but for rounding, at a residual that is but rounding
    size = np.sqrt((fine.tangential_cd**2).sum(axis=1))
    sliding = fine.bearing_c & (size > 0.1 * fine.normal_c * (1.0 - 1e-9))
    assert rough.to_dict()["contacts_at_limit"] == sliding.sum() > 10
    assert rough.to_dict()["doubtful_at_limit"] == 0
    assert np.array_equal(rough.at_limit_c, fine.at_limit_c)
    assert rough.isostatic_coordination > dimension + 1.1


def balances(normal, arm, mu):
    """Return whether contacts along these directions, away from a particle, can balance force and torque on it."""
    count, d = normal.shape
    if d == 2:
        across = np.stack([-normal[:, 1], normal[:, 0]], axis=1)[:, None]
        turn = np.ones((count, 1, 1))
    else:
        across = np.linalg.svd(normal[:, None])[2][:, 1:]
        turn = np.cross(normal[:, None], across)
    push = np.hstack([-normal, np.zeros((count, turn.shape[2]))])
    side = np.concatenate([across, arm[:, None, None] * turn], axis=2)
    return bool(can_balance(push, side, np.array([side.shape[1]]), count, mu))


def test_what_resists_rolling_balances_what_a_linear_program_balances():
    """In the plane, where cones are edges: forces, tangential forces and moments, each kind within its own limit."""
    from scipy.optimize import linprog

    rng = np.random.default_rng(2)
    told, sliding_alone = [], []
    for _ in range(80):
        count = int(rng.integers(2, 5))
        normal = rng.normal(size=(count, 2)) - 0.5
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        arm, mu, rolling = rng.uniform(0.1, 1.0, count), rng.uniform(0.05, 1.0), rng.uniform(0.02, 0.5)
        across = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
        push = np.hstack([-normal, np.zeros((count, 1))])
        slide = np.hstack([across, arm[:, None]])
        turn = np.hstack([np.zeros((count, 2)), arm[:, None]])
        side = np.stack([slide, rolling / mu * turn], axis=1)
        found = bool(can_balance(push, side, np.array([1, 2]), count, mu))
        eye = np.eye(count)
        limits = [[mu * eye, sign * eye, 0 * eye] for sign in (1, -1)] + [
            [rolling * eye, 0 * eye, sign * eye] for sign in (1, -1)
        ]
        balance = np.vstack([np.vstack([push, slide, turn]).T, np.r_[np.ones(count), np.zeros(2 * count)]])
        bounds = [(0, None)] * count + [(None, None)] * (2 * count)
        program = linprog(
            np.zeros(3 * count), -np.block(limits), np.zeros(4 * count), balance, [0, 0, 0, 1], bounds=bounds
        )
        assert found is (program.status == 0)
        told.append(found)
        sliding_alone.append(balances(normal, arm, mu))
    assert 10 < sum(told) < 70 and sum(sliding_alone) < sum(told)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("mu", [1e-3, 0.4, 10.0])
def test_two_contacts_hold_where_the_chord_lies_in_both_cones(dimension, mu):
    """Contacts at angles above and below a line leave a particle held just where tan(half the bend) <= mu."""
    rng = np.random.default_rng(3)
    for off, held in ((-1e-5, True), (1e-5, False)):
        half = math.atan(mu) * (1.0 + off) + (off if mu < 1.0 else 0.0)
        normal = np.zeros((2, dimension))
        normal[:, 0] = [math.cos(half), -math.cos(half)]
        normal[:, 1] = math.sin(half)
        # whichever way the particle is turned
        normal = normal @ np.linalg.qr(rng.normal(size=(dimension, dimension)))[0]
        assert balances(normal, np.ones(2), mu) is held


def edges(normal_kd, arm_k, mu, number):
    """Return the wrenches at so many edges of each cone, and of the pyramids around the cones."""
    if normal_kd.shape[1] == 2:
        across = np.stack([-normal_kd[:, 1], normal_kd[:, 0]], axis=1)
        ways = [across, -across]
    else:
        e = np.cross(normal_kd, np.eye(3)[np.abs(normal_kd).argmin(axis=1)])
        e /= np.linalg.norm(e, axis=1)[:, None]
        f = np.cross(normal_kd, e)
        ways = [math.cos(a) * e + math.sin(a) * f for a in 2.0 * math.pi * np.arange(number) / number]
    for wide in (mu, mu / math.cos(math.pi / number)):
        force = np.concatenate([wide * way - normal_kd for way in ways])
        torque = np.cross(np.tile(normal_kd, (len(ways), 1)), force).reshape(len(force), -1)
        yield np.column_stack([force, np.tile(arm_k, len(ways))[:, None] * torque])


def parted(wrench_wp):
    """Return whether some velocity and spin have a positive power with all wrenches (Gordan: then none balance)."""
    from scipy.optimize import linprog

    count, p = wrench_wp.shape
    found = linprog(
        [0.0] * p + [-1.0],
        np.column_stack([-wrench_wp, np.ones(count)]),
        np.zeros(count),
        bounds=[(-1, 1)] * p + [(0, 1)],
    )
    return bool(found.x[p] > 1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_balances_is_what_no_half_space_of_wrenches_parts_from_zero(dimension):
    """In the plane exactly; in space between the pyramids inside and around the cones."""
    rng = np.random.default_rng(1)
    told = []
    for _ in range(60):
        count = rng.integers(2, 6)
        normal = rng.normal(size=(count, dimension)) - 0.4
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        arm, mu = rng.uniform(0.8, 1.0, count), rng.uniform(0.05, 1.0)
        inner, outer = (parted(wrench) for wrench in edges(normal, arm, mu, 24))
        found = balances(normal, arm, mu)
        assert found or inner
        assert not (found and outer) or dimension == 2
        if dimension == 2:
            assert found is not inner
        told.append(found)
    assert 10 < sum(told) < 50


def column():
    """Return a scene of five discs between their own images up and down, and one that touches nobody."""
    place = [[1.0, 0.95 * k + 0.4] for k in range(5)] + [[3.0, 2.0]]
    packing = pm.Packing(place, [0.5] * 6, pm.Box(np.diag([4.0, 4.75])))
    return pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.3, 1.0)))


def test_a_column_of_discs_is_held_by_two_contacts_each_and_the_lone_one_rattles():
    found = pm.contact_forces(column())
    assert found.rattlers_n.tolist() == [False] * 5 + [True]
    assert found.coordination_number == 2.0 and found.to_dict()["rattlers"] == 1
    # without friction nothing keeps the column from buckling
    assert pm.find_rattlers(column().packing).all()


def test_the_coordination_of_a_pile_is_that_of_its_grains_and_not_of_its_floor():
    # a grain on two of a floor of seven: two contacts a grain, however long the floor is
    place = [*([k, 0.5] for k in range(1, 8)), [3.5, 0.5 + math.sqrt(0.75) - 1e-3]]
    packing = pm.Packing(place, [0.5] * 8, pm.Box.cubic(9.0, 2))
    floor = pm.FixedParticles(tuple(range(7)))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.5, 1.0), pm.Gravity(0.0, -1e-3), floor))
    assert pm.contact_forces(scene).coordination_number == 2.0
    assert pm.contact_forces(scene.without(pm.FixedParticles)).coordination_number != 2.0


def test_a_sphere_between_two_others_is_held_but_can_spin_about_the_chord():
    """A column of spheres between its own images; without friction, or in the plane, nothing spins so."""
    place = [[1.0, 1.0, 0.95 * k + 0.4] for k in range(4)]
    packing = pm.Packing(place, [0.5] * 4, pm.Box(np.diag([3.0, 3.0, 3.8])))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.3, 1.0)))
    found = pm.contact_forces(scene)
    assert found.spinning_n.all() and not found.rattlers_n.any()
    assert not pm.contact_forces(column()).spinning_n.any()
    bare = pm.contact_forces(scene.without(pm.Friction))
    assert bare.rattlers_n.all() and not bare.spinning_n.any()
    # one spin for each, and those of all against each other about two axes across
    modes = pm.frictional_modes(scene, kind="unstressed")
    about = modes.rotation_mnk[modes.zero_m][:, :, 2]
    assert np.linalg.matrix_rank(about, tol=1e-6) == 4


def test_rattlers_without_friction_are_those_of_the_frictionless_rule():
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.86, seed=3)
    run = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-12)
    found = pm.contact_forces(pm.Scene(run.packing, (pm.Repulsion(), pm.Friction(0.0, 1.0))))
    assert np.array_equal(found.rattlers_n, pm.find_rattlers(run.packing)) and found.rattlers_n.any()
    # a little friction holds no fewer
    rough = pm.contact_forces(pm.Scene(run.packing, (pm.Repulsion(), pm.Friction(0.2, 1.0))))
    assert not (rough.rattlers_n & ~found.rattlers_n).any()


def test_rattlers_of_packings_at_rest_bear_nothing_and_the_rest_is_held():
    for dimension in (2, 3):
        scene, _ = at_rest(dimension)
        found = pm.contact_forces(scene)
        bearing = found.contacts.select(found.bearing_c).count_n()
        assert (bearing[~found.rattlers_n] >= 2).all() and found.rattlers_n.sum() < 20
        assert not pm.contact_forces(scene).rattlers_n[bearing > dimension + 1].any()


def test_mu_to_zero_counts_every_tangential_force_as_chosen():
    """n_m = 1 in the plane and 3 in space make the frictionless 2 d of a rule that is d + 1 at infinite friction."""
    for d, n_m in ((2, 1.0), (3, 3.0)):
        assert (d + 1) + 2.0 * n_m / d == 2 * d
    found = pm.contact_forces(at_rest(2)[0])
    assert found.isostatic_coordination == 3.0 + found.at_limit_per_particle
    assert found.coordination_number >= found.isostatic_coordination


@pytest.mark.parametrize("sliding", [0, 1, 5])
@pytest.mark.parametrize(("name", "d"), [("triangular", 2), ("fcc", 3)])
def test_each_sliding_contact_of_a_crystal_adds_2_over_d_n_to_its_isostatic_coordination(name, d, sliding):
    crystal = pm.lattice_packing(name, repeats=(2,) * d, relative_overlap=0.01)
    found = pm.find_contacts(crystal).select(np.arange(sliding))
    # displacements far beyond what the coefficient lets a contact bear, in the plane one number each
    across = np.cross(found.normal_cd, np.roll(found.normal_cd, 1, axis=1)) if d == 3 else np.ones((sliding, 1))
    springs = pm.TangentialDisplacements(found.i_c, found.j_c, found.image_cd, across) if sliding else None
    rough = pm.Scene(crystal.replace(tangential=springs), (pm.Repulsion(), pm.Friction(0.1, stiffness=1.0)))
    forces = pm.contact_forces(rough)
    assert forces.at_limit_c.sum() == sliding and not forces.rattlers_n.any()
    # d + 1 where all stick: d (d + 1) / 2 numbers balance a particle, and a contact bears d for two of them
    expected = (d + 1) + 2.0 * sliding / (d * crystal.particles)
    assert forces.isostatic_coordination == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("call", ["find_rattlers", "coordination_number", "remove_rattlers", "classify_jamming"])
def test_a_frictional_packing_is_refused_where_friction_would_be_ignored(call):
    with pytest.raises(ValueError, match="must have no tangential displacements .*pm.contact_forces"):
        getattr(pm, call)(at_rest(2)[0].packing)
