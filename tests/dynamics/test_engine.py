"""The engine: absent effects hold nothing, forces add up, and neither threads nor lists change a bit."""

import functools
import itertools

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import new_ledger
from packmech.minimize.passes.pair_list import blocks_of

SHEAR = np.array([[0.0, 1.0], [0.0, 0.0]])
SPRING = pm.Repulsion(law=pm.LinearSpring(1.0))
DASHPOT = pm.ContactDamping(0.2)
FRICTION = pm.Friction(0.4, 0.3, 0.1)


@functools.cache
def packing(particles=700):
    return pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=3)


@functools.cache
def bonds(particles=700, tangential_stiffness=0.4, scale=1.0):
    contacts = pm.find_contacts(packing(particles), gap_tolerance=0.0)
    pick = np.arange(0, len(contacts), 4)
    law = pm.LinearSpring(scale)
    return pm.Bonds(
        contacts.i_c[pick],
        contacts.j_c[pick],
        contacts.image_cd[pick],
        contacts.contact_distance_c[pick],
        compression=law,
        tension=law,
        tangential_stiffness=scale * tangential_stiffness,
        damping=scale * 0.05,
        tangential_damping=scale * 0.03,
    )


def engine_of(effects, *, sheared=True, threads=1, particles=700, speed=0.02):
    start = packing(particles)
    rng = np.random.default_rng(5)
    velocity = speed * rng.standard_normal((particles, 2))
    spin = speed * rng.standard_normal((particles, 1))
    return build_engine(
        pm.Scene(start.replace(mass_n=start.diameter_n**2), effects),
        dt=0.1,
        velocity_nd=velocity,
        spin_nk=spin,
        profile=Ramp(0.0, 0.01, 0.0, np.inf) if sheared else None,
        direction_dd=SHEAR if sheared else None,
        threads=threads,
    )


def forces(effects):
    """Return the forces and torques of a start, by particles."""
    engine = engine_of(effects)
    engine.begin()
    push = np.zeros((700, 3))
    push[engine.order_n, : engine.state.push.shape[1]] = engine.state.push
    return push


EVERYTHING = (SPRING, DASHPOT, FRICTION)


def test_without_friction_and_bonds_there_are_no_spins_stretches_torques_or_slots_for_them():
    engine = engine_of((SPRING, DASHPOT))
    assert engine.track is None and engine.space.bonds is None and engine.acting.bodies is None
    assert engine.spins() is None and engine.state.spins == ()
    assert engine.state.push.shape[1] == engine.state.half.shape[1] == engine.pairs.slots.push_qk.shape[1] == 2


def test_a_box_at_rest_holds_no_flow():
    assert engine_of((SPRING, DASHPOT), sheared=False).space.flow is None


@pytest.mark.parametrize("threads", [2, 3])
def test_any_number_of_threads_gives_the_same_bits(threads):
    one, more = engine_of(EVERYTHING), engine_of(EVERYTHING, threads=threads)
    one.advance(100)
    more.advance(100)
    np.testing.assert_array_equal(one.state.body, more.state.body)
    np.testing.assert_array_equal(one.state.push, more.state.push)
    np.testing.assert_array_equal(one.stretches().stretch_ck, more.stretches().stretch_ck)


@pytest.mark.slow
def test_threads_keep_the_same_figures_on_the_way():
    rows = [new_ledger(25, 8) for _ in range(2)]
    engine_of(EVERYTHING).advance(100, rows[0])
    engine_of(EVERYTHING, threads=2).advance(100, rows[1])
    np.testing.assert_array_equal(rows[0].row_tk, rows[1].row_tk)


@pytest.mark.slow
def test_simulate_takes_threads_and_gives_the_same_bits():
    runs = [
        pm.simulate(
            pm.Scene(packing(), EVERYTHING), steps=20, dt=0.1, applied_strain=pm.SteadyStrain(0.01), threads=threads
        )
        for threads in (1, 2)
    ]
    np.testing.assert_array_equal(runs[0].packing.position_nd, runs[1].packing.position_nd)
    np.testing.assert_array_equal(runs[0].spin_nk, runs[1].spin_nk)


def test_the_scene_of_the_threads_has_several_blocks():
    assert len(blocks_of(700)) == 3


def test_cutting_a_run_changes_no_bit():
    whole, cut = engine_of(EVERYTHING), engine_of(EVERYTHING)
    whole.advance(90)
    for steps in (1, 7, 30, 2, 50):
        cut.advance(steps)
    np.testing.assert_array_equal(whole.state.body, cut.state.body)
    np.testing.assert_array_equal(whole.stretches().stretch_ck, cut.stretches().stretch_ck)


def test_lists_rebuilt_at_every_step_change_no_bit():
    whole, rebuilt = engine_of(EVERYTHING), engine_of(EVERYTHING)
    whole.advance(40)
    for _ in range(40):
        rebuilt.advance(1)
        rebuilt._follow()
    np.testing.assert_array_equal(whole.state.body, rebuilt.state.body)
    np.testing.assert_array_equal(whole.stretches().stretch_ck, rebuilt.stretches().stretch_ck)


@pytest.mark.slow
def test_for_every_subset_of_effects_the_force_is_the_sum_of_single_effects():
    gravity, drag = pm.Gravity(0.01, -0.02), pm.BackgroundDamping(0.1)
    alone = {one: forces((SPRING, one)) - forces((SPRING,)) for one in (DASHPOT, gravity, drag)}
    base = forces((SPRING,))
    for size in (2, 3):
        for chosen in itertools.combinations(alone, size):
            together = forces((SPRING, *chosen))
            np.testing.assert_allclose(together, base + sum(alone[one] for one in chosen), rtol=0, atol=1e-13)


@pytest.mark.slow
def test_friction_and_dashpots_add_up():
    with_friction = forces((SPRING, FRICTION)) - forces((SPRING,))
    with_dashpot = forces((SPRING, DASHPOT)) - forces((SPRING,))
    np.testing.assert_allclose(forces(EVERYTHING), forces((SPRING,)) + with_friction + with_dashpot, rtol=0, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("nothing", [pm.ContactDamping(0.0), pm.Friction(0.0, 0.3, 0.1)], ids=["dashpot", "friction"])
def test_an_effect_of_no_strength_is_as_good_as_absent(nothing):
    absent, zero = engine_of((SPRING,)), engine_of((SPRING, nothing))
    absent.advance(20)
    zero.advance(20)
    np.testing.assert_allclose(zero.positions(), absent.positions(), rtol=0, atol=1e-13)
    np.testing.assert_allclose(zero.velocities(), absent.velocities(), rtol=0, atol=1e-13)


@pytest.mark.slow
def test_bonds_in_threads_keep_bits_and_momentum():
    effects = (*EVERYTHING, bonds())
    one, two = engine_of(effects, sheared=False), engine_of(effects, sheared=False, threads=2)
    momentum = one.state.mass_n @ one.velocities()[one.order_n]
    one.advance(50)
    two.advance(50)
    np.testing.assert_array_equal(one.state.body, two.state.body)
    np.testing.assert_allclose(one.state.mass_n @ one.velocities()[one.order_n], momentum, rtol=0, atol=1e-12)
