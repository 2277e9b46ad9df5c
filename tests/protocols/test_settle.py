"""Facts about scenes with friction that settle: a pile's weight on its floor, Coulomb's cone, balance, limits."""

import functools
import math

import numpy as np
import pytest

import packmech as pm

MU, PULL = 0.4, 1e-4


@functools.cache
def heap(dimension):
    """Return a scene of grains above a floor of held ones, without dashpots, and the run that settles it."""
    side, across = (8, 8.0) if dimension == 2 else (4, 4.0)
    floor = np.stack(np.meshgrid(*[np.arange(side) + 0.5] * (dimension - 1)), axis=-1).reshape(-1, dimension - 1)
    rng = np.random.default_rng(5)
    layers, height = (5, 12.0) if dimension == 2 else (2, 8.0)
    grid = np.stack(np.meshgrid(*[np.arange(side - 1) + 0.8] * (dimension - 1)), axis=-1).reshape(-1, dimension - 1)
    spots = [np.column_stack([floor, np.full(len(floor), 1.0)])]
    for layer in range(layers):
        level = np.full((len(grid), 1), 2.2 + 1.1 * layer)
        spots.append(
            np.hstack([grid * across / (side - 0.6), level]) + rng.uniform(-0.05, 0.05, (len(grid), dimension))
        )
    position = np.vstack(spots)
    lengths = [across] * (dimension - 1) + [height]
    radius = np.concatenate([np.full(len(floor), 0.5), rng.uniform(0.42, 0.5, len(position) - len(floor))])
    packing = pm.Packing(position, radius, pm.Box(np.diag(lengths)))
    pull = (0.0, -PULL) if dimension == 2 else (0.0, 0.0, -PULL)
    effects = (
        pm.Repulsion(pm.LinearSpring(1.0)),
        pm.Friction(MU, 0.7),
        pm.Gravity(*pull),
        pm.FixedParticles(tuple(range(len(floor)))),
    )
    scene = pm.Scene(packing, effects)
    return scene, pm.settle(scene, force_tolerance=1e-8), len(floor)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_weight_of_a_pile_stands_on_its_floor(dimension):
    scene, run, held = heap(dimension)
    found = pm.contact_forces(scene.replace(packing=run.packing))
    total = np.zeros((run.packing.particles, dimension))
    np.add.at(total, found.contacts.i_c, found.force_cd)
    np.subtract.at(total, found.contacts.j_c, found.force_cd)
    weight = PULL * run.packing.mass_n[held:].sum()
    expected = np.zeros(dimension)
    expected[-1] = -weight
    np.testing.assert_allclose(total[:held].sum(axis=0), expected, atol=1e-7 * weight)


@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_and_torques_of_a_pile_balance_within_the_cones_of_friction(dimension):
    scene, run, held = heap(dimension)
    found = pm.contact_forces(scene.replace(packing=run.packing))
    assert run.outcome is pm.Outcome.CONVERGED and run.residual == found.residual <= 1e-8
    tangential = np.sqrt((found.tangential_cd**2).sum(axis=1))
    assert (tangential <= MU * found.normal_c * (1.0 + 1e-12)).all()
    # friction has its part in it, and nobody is left in the air
    assert tangential.max() > 0.05 * found.normal_c.mean()
    assert (found.contacts.count_n()[held:] >= 2).all()


def test_a_pile_at_rest_stays_where_it_is_in_time_and_in_every_bit_where_it_settles_again():
    scene, run, _ = heap(2)
    at_rest = scene.replace(packing=run.packing)
    again = pm.settle(at_rest, force_tolerance=1e-8)
    assert again.packing == run.packing and again.steps == 0
    later = pm.simulate(at_rest.replace(effects=(*scene.effects, pm.ContactDamping(0.3))), steps=500, dt=0.1)
    assert np.abs(later.packing.position_nd - run.packing.position_nd).max() < 1e-8


def test_a_dashpot_is_added_where_nothing_takes_energy_out_and_reported():
    scene, run, _ = heap(2)
    assert run.report["added_damping"] == pytest.approx(0.3 * run.packing.mass_n.mean() ** 0.5, rel=1e-12)


def test_a_disc_rests_on_two_that_are_held_as_its_weight_bends_the_contacts():
    """By symmetry each bears half the weight along the vertical: N cos(a) + T sin(a) = m g / 2, and no torque acts."""
    place = [[3.0, 1.0], [4.2, 1.0], [3.6, 1.81]]
    packing = pm.Packing(place, [0.5] * 3, pm.Box.cubic(8.0, 2))
    effects = (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5), pm.Gravity(0.0, -1e-3), pm.FixedParticles((0, 1)))
    run = pm.settle(pm.Scene(packing, effects), force_tolerance=1e-10)
    found = pm.contact_forces(pm.Scene(run.packing, effects))
    on_top = np.where((found.contacts.i_c == 2)[:, None], found.force_cd, -found.force_cd)
    half = 0.5e-3 * packing.mass_n[2]
    np.testing.assert_allclose(on_top[:, 1], [half, half], rtol=1e-7)
    assert run.packing.position_nd[2, 0] == pytest.approx(3.6, abs=1e-9)


def test_what_falls_through_the_box_for_ever_meets_the_step_limit():
    packing = pm.Packing([[1.0, 1.0], [3.0, 1.0]], [0.5] * 2, pm.Box.cubic(8.0, 2))
    scene = pm.Scene(
        packing, (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5), pm.Gravity(0.0, -1e-3), pm.FixedParticles(()))
    )
    run = pm.settle(scene, force_tolerance=1e-8, step_limit=2000, check=False)
    assert run.outcome is pm.Outcome.STEP_LIMIT and run.residual == pytest.approx(1.0)
    with pytest.raises(pm.NotConverged):
        pm.settle(scene, force_tolerance=1e-8, step_limit=500)


def test_discs_that_push_each_other_apart_end_unjammed():
    packing = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5] * 2, pm.Box.cubic(8.0, 2))
    # weightless, with nothing held
    effects = (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5), pm.Gravity(0.0, 0.0), pm.FixedParticles(()))
    run = pm.settle(pm.Scene(packing, effects), force_tolerance=1e-8)
    assert run.outcome is pm.Outcome.UNJAMMED and run.residual == 0.0


def test_quench_and_jam_name_it_for_friction_under_gravity():
    scene, _, _ = heap(2)
    for call in (lambda: pm.quench(scene, force_tolerance=1e-6), lambda: pm.jam(scene)):
        with pytest.raises(ValueError, match=r"pm\.settle"):
            call()


def balanced_disc(aside=0.0):
    """Return a disc that stands on top of a held one, its weight borne by the spring between them."""
    mass = math.pi / 4.0
    lower = pm.Packing([[4.0, 0.5], [4.0 + aside, 1.5 - PULL * mass]], [0.5, 0.5], pm.Box.cubic(8.0, 2))
    effects = (
        pm.Repulsion(pm.LinearSpring(1.0)),
        pm.ContactDamping(0.3),
        pm.Friction(0.5),
        pm.Gravity(0.0, -PULL),
        pm.FixedParticles((0,)),
    )
    return pm.Scene(lower, effects)


def test_a_disc_balanced_on_another_is_no_packing_at_rest():
    run = pm.settle(balanced_disc(), force_tolerance=1e-9, check=False)
    assert run.outcome is pm.Outcome.UNSTABLE and not run.ok
    assert run.report["negative_modes"] == 1 and run.residual < 1e-9
    # it rolls off by itself once it is a little aside
    moving = pm.simulate(balanced_disc(1e-6), steps=5000, dt=0.2)
    assert moving.packing.position_nd[1, 0] - 4.0 > 1e-3


def test_what_bears_forces_that_balance_exactly_is_not_called_apart():
    square = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.1)
    run = pm.settle(pm.Scene(square, (pm.Repulsion(), pm.Friction(0.5))), force_tolerance=1e-8, check=False)
    assert run.residual < 1e-12 and run.report["bearing_contacts"] == 32
    assert run.outcome is not pm.Outcome.UNJAMMED


@pytest.mark.parametrize("call", [pm.settle, pm.quench])
def test_weights_that_nothing_bears_are_refused(call):
    packing = pm.random_packing(8, dimension=2, packing_fraction=0.3, seed=1)
    with pytest.raises(ValueError, match="scene.effects must hold what bears weights.*Gravity alone"):
        call(pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -1e-3))), force_tolerance=1e-6)
