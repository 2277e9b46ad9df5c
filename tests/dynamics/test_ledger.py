"""Facts about the ledger of runs through time: it closes but for rounding, and channels are those of closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.dynamics.ledger import ledger_of

SPRING = pm.Repulsion(pm.LinearSpring())
SMOOTH = pm.ContactDamping(0.3, onset="smooth")
GRAINS = (SPRING, pm.Friction(0.3, stiffness=0.5, damping=0.1), SMOOTH)


def two(*effects, distance=1.05, **given):
    packing = pm.Packing([[2.0, 2.0], [2.0 + distance, 2.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2), **given)
    return pm.Scene(packing, effects)


def jammed(*effects, dimension=2, count=64, fraction=0.88, **given):
    packing = pm.random_packing(count, dimension=dimension, packing_fraction=fraction, seed=1, **given)
    packing = pm.quench(pm.Scene(packing, (SPRING,)), force_tolerance=1e-8).packing
    return pm.Scene(packing, effects)


def shaken(scene, speed=0.05, seed=3):
    return speed * np.random.default_rng(seed).standard_normal(scene.packing.position_nd.shape)


def closed(run):
    ledger = run.ledger
    assert ledger.closed, ledger
    assert ledger.residual < 1e-12
    return ledger


# -- closed forms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.3, 0.8])
def test_a_collision_loses_the_share_that_restitution_says_to_its_dashpot(restitution):
    scene = two(SPRING, pm.Restitution(restitution))
    run = pm.simulate(scene, duration=8.0, dt=2e-4, velocity_nd=[[0.1, 0.0], [-0.1, 0.0]], ledger=True)
    ledger = closed(run)
    lost = (1.0 - restitution**2) * ledger.kinetic_t[0]
    assert list(ledger.dissipated) == ["normal_dashpots"]
    assert ledger.dissipated["normal_dashpots"][-1] == pytest.approx(lost, rel=1e-3)


def test_free_fall_turns_the_potential_into_kinetic_energy_across_periodic_boundaries():
    scene = pm.Scene(pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(2.0, 2)), (pm.Gravity(0.3, -1.0),))
    engine = build_engine(scene, dt=0.01, velocity_nd=np.zeros((1, 2)), ledger_every=100)
    engine.advance(4500)
    ledger = ledger_of(engine)
    assert np.abs(engine.wrap_nd).max() > 100
    assert ledger.closed
    assert ledger.kinetic_t[-1] == pytest.approx(0.5 * scene.packing.mass_n[0] * 1.09 * 45.0**2, rel=1e-12)
    assert ledger.stored["bodies"][-1] - ledger.stored["bodies"][0] == pytest.approx(-ledger.kinetic_t[-1], rel=1e-12)


def test_drag_takes_kinetic_energy_exponentially_from_spins_too():
    scene = two(*GRAINS, pm.BackgroundDamping(0.2), distance=2.0)
    start = {"velocity_nd": [[-0.1, 0.1], [0.2, 0.1]], "spin_nk": [[1.0], [-2.0]]}
    ledger = closed(pm.simulate(scene, duration=3.0, dt=1e-3, ledger=True, **start))
    assert ledger.kinetic_t[-1] == pytest.approx(ledger.kinetic_t[0] * math.exp(-2.0 * 0.2 * 3.0), rel=1e-6)
    assert ledger.dissipated["drag"][-1] == pytest.approx(ledger.kinetic_t[0] - ledger.kinetic_t[-1], rel=1e-12)


def driven(scene, spins):
    """Return the ledger of two discs that are held, turn at given rates, and have done so for a while."""
    run = pm.simulate(scene, steps=2000, dt=0.01, spin_nk=spins, held_n=[True, True], ledger=True, trace_every=500)
    ledger = closed(run)
    return ledger, {name: np.diff(curve)[1:] / 5.0 for name, curve in {**ledger.dissipated, **ledger.work}.items()}


@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_sliding_loses_the_friction_times_its_path_whatever_the_dashpot(damping):
    scene = two(SPRING, pm.Friction(0.3, stiffness=0.5, damping=damping), distance=0.9)
    _, rates = driven(scene, [[1.0], [1.0]])
    # the normal force is 0.1, and both surfaces move against each other at 0.45
    assert rates["sliding"] == pytest.approx(0.3 * 0.1 * 0.9, rel=1e-10)
    assert rates["held"] == pytest.approx(rates["sliding"], rel=1e-10)


def test_rolling_loses_its_resistance_times_the_way_it_rolls():
    scene = two(SPRING, pm.Friction(0.3, stiffness=0.5), pm.RollingResistance(0.2, stiffness=0.5), distance=0.9)
    ledger, rates = driven(scene, [[1.0], [-1.0]])
    # the reduced arm is 0.45 / 2
    assert rates["rolling"] == pytest.approx(0.2 * 0.1 * 0.225 * 2.0, rel=1e-10)
    assert "sliding" not in ledger.dissipated


def test_rolling_without_a_spring_loses_its_force_times_the_way_it_rolls():
    # the normal force is 0.1, the velocity of rolling 0.45 and 0.0045
    for rolling, spin, lost in (
        (pm.ConstantRolling(0.2, 0.5), 1.0, 0.02 * 0.45),
        (pm.ConstantRolling(0.2, 0.5), 0.01, 0.5 * 0.0045**2),
        (pm.ViscousRolling(0.7), 1.0, 0.07 * 0.45**2),
    ):
        ledger, rates = driven(two(SPRING, pm.Friction(0.3, 0.5), rolling, distance=0.9), [[spin], [-spin]])
        assert rates["rolling"] == pytest.approx(lost, rel=1e-10)
        assert rates["held"] == pytest.approx(lost, rel=1e-10)
        assert "rolling" not in ledger.stored


# -- it closes ------------------------------------------------------------------------------------------------------


def test_sheared_grains_close_in_a_plane_for_both_methods():
    scene = jammed(*GRAINS, pm.BackgroundDamping(0.05))
    for method in (pm.VelocityVerlet(), pm.SemiImplicitEuler()):
        ledger = closed(pm.ramp_strain(scene, rate=0.02, applied_strain=0.3, method=method, ledger=True))
        assert {"normal_dashpots", "tangential_dashpots", "sliding", "drag"} == set(ledger.dissipated)


def test_work_of_the_box_is_that_of_its_stress():
    scene = jammed(*GRAINS)
    run = pm.ramp_strain(scene, rate=0.01, applied_strain=0.2, samples=4000, ledger=True)
    power = run.packing.box.volume * (run.stress["contact"] + run.stress["kinetic"])[:, 0, 1] * 0.01
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(run.time_t))])
    assert run.ledger.work["box"] == pytest.approx(work, abs=2e-4 * work[-1])


def test_spheres_that_slide_roll_and_twist_close():
    resisting = pm.RollingResistance(0.1, stiffness=0.3), pm.TwistingResistance(0.05, stiffness=0.2, damping=0.05)
    scene = jammed(*GRAINS, *resisting, dimension=3, fraction=0.7)
    ledger = closed(pm.ramp_strain(scene, rate=0.02, applied_strain=0.3, ledger=True))
    assert {"sliding", "rolling", "twisting"} <= set(ledger.dissipated)
    assert {"contacts", "tangential", "rolling", "twisting"} == set(ledger.stored)


@pytest.mark.parametrize("rolling", [pm.ConstantRolling(0.1, 2.0), pm.ViscousRolling(2.0)])
@pytest.mark.parametrize("dimension", [2, 3])
def test_grains_that_roll_without_springs_close_in_bulk_and_between_walls(rolling, dimension):
    scene = jammed(*GRAINS, rolling, dimension=dimension, fraction=0.88 if dimension == 2 else 0.7)
    ledger = closed(pm.ramp_strain(scene, rate=0.02, applied_strain=0.3, ledger=True))
    assert ledger.dissipated["rolling"][-1] > 0.0
    assert {"contacts", "tangential"} == set(ledger.stored)
    side = float(scene.packing.box.lattice_dd[0, 0])
    walls = pm.Walls(0.0, 0.0, 0.9 * side, friction=pm.Friction(0.4), rolling=rolling)
    scene = scene.replace(effects=(*scene.effects, walls, pm.Gravity(-0.01, -0.003)))
    ledger = closed(pm.simulate(scene, duration=20.0, velocity_nd=shaken(scene), ledger=True, check=False))
    assert ledger.dissipated["rolling"][-1] > 0.0 and "rolling" not in ledger.stored


def test_an_oscillation_closes_cycle_by_cycle():
    run = pm.oscillatory_shear(
        jammed(*GRAINS), amplitude=0.05, frequency=0.02, periods=3, skip_periods=1, ledger=True, check=False
    )
    ledger = closed(run)
    assert ledger.work_t[-1] > 0.0
    assert ledger.dissipated_t[-1] > 0.5 * ledger.work_t[-1]


def test_a_pile_under_gravity_between_walls_closes_and_loses_to_walls():
    packing = pm.Packing(
        [[1.0 + 1.1 * (k % 5), 1.0 + 1.1 * (k // 5)] for k in range(20)], [0.5] * 20, pm.Box.cubic(9.0, 2)
    )
    walls = (pm.Walls(1.0, 0.2, 8.0, damping=0.2), pm.Walls(0.0, 0.2, 6.5, damping=0.2))
    scene = pm.Scene(
        packing, (pm.Repulsion(pm.LinearSpring(100.0)), pm.ContactDamping(0.5), pm.Gravity(0.1, -0.5), *walls)
    )
    ledger = closed(pm.simulate(scene, duration=20.0, ledger=True))
    assert ledger.dissipated["wall_dashpots"][-1] > 0.0
    assert ledger.stored["bodies"][-1] < ledger.stored["bodies"][0]


def test_bonds_that_break_give_up_their_energy_to_breaking():
    scene = jammed(SPRING, count=40)
    bonds = pm.bond_contacts(
        scene.packing, compression=pm.LinearSpring(), tangential_stiffness=0.3, damping=0.2, tangential_damping=0.1
    )
    weak = replace(bonds, breaks_at=pm.BondLimits(tension=0.02))
    run = pm.ramp_strain(scene.replace(effects=(SPRING, SMOOTH, weak)), rate=0.02, applied_strain=0.2, ledger=True)
    assert len(run.broken_bonds)
    ledger = closed(run)
    assert {"normal_dashpots", "bond_dashpots", "breaking"} == set(ledger.dissipated)


def test_ellipses_with_friction_close():
    scene = jammed(*GRAINS, count=40)
    shapes = pm.Spheroids(np.full(40, 1.5), np.eye(2)[np.arange(40) % 2])
    scene = scene.replace(packing=scene.packing.replace(shapes=shapes))
    ledger = closed(pm.simulate(scene, duration=30.0, velocity_nd=shaken(scene), ledger=True))
    assert ledger.dissipated["sliding"][-1] > 0.0


def test_bodies_that_touch_in_several_places_close_with_springs_of_mindlin():
    bodies = pm.random_packing(20, dimension=2, packing_fraction=0.9, seed=1, shapes=pm.Trimer(angle=2.0))
    friction = pm.Friction(0.4, pm.Mindlin(0.3), damping=0.2)
    scene = pm.Scene(bodies, (pm.Repulsion(pm.Hertz()), SMOOTH, friction))
    ledger = closed(pm.simulate(scene, steps=300, dt=0.02, temperature=1e-3, seed=1, ledger=True))
    assert ledger.dissipated["stiffness_changes"][-1] > 0.0


@pytest.mark.parametrize("shapes", [pm.Ellipses(1.6), pm.Trimer(angle=2.0)])
def test_shapes_that_turn_in_space_close_and_what_their_free_turning_leaves_is_of_second_order(shapes):
    packing = pm.random_packing(12, dimension=3, packing_fraction=0.62, seed=1, shapes=shapes)
    scene, strain = pm.Scene(packing, (*GRAINS, pm.BackgroundDamping(0.1))), pm.SteadyStrain(0.05)
    left = []
    for dt in (0.02, 0.01):
        run = pm.simulate(
            scene, duration=3.0, dt=dt, temperature=1e-3, seed=1, applied_strain=strain, ledger=True, trace_every=1
        )
        assert closed(run).dissipated["tangential_dashpots"][-1] > 0.0
        left.append(run.ledger.integrator["turning"][-1] if "turning" in run.ledger.integrator else 0.0)
    if isinstance(shapes, pm.Ellipses):
        # a free director turns as it does without time steps
        assert left == [0.0, 0.0]
    else:
        assert math.log2(left[0] / left[1]) == pytest.approx(2.0, abs=0.1)
    found = pm.contact_dissipation(
        scene.replace(packing=run.packing), run.velocity_nd, run.spin_nk, applied_strain=strain
    )  # fmt: skip
    lost = run.ledger.dissipated
    across = lost["tangential_dashpots"] + lost["sliding"]
    for power, curve in (
        (found.by_channel["normal_dashpots"], lost["normal_dashpots"]),
        (found.by_channel["tangential_dashpots"] + found.by_channel["sliding"], across),
    ):
        rate = (1.5 * (curve[-1] - curve[-2]) - 0.5 * (curve[-2] - curve[-3])) / 0.01
        assert power == pytest.approx(rate, rel=0.01)


def test_held_particles_that_move_do_the_work():
    scene = jammed(*GRAINS)
    scene = scene.replace(effects=(*scene.effects, pm.FixedParticles((0, 1), velocity=(0.02, 0.0))))
    ledger = closed(pm.simulate(scene, duration=50.0, ledger=True))
    assert list(ledger.work) == ["held"]
    assert ledger.work_t[-1] > 0.0


def test_a_disc_thrown_on_a_rough_floor_slides_until_it_rolls_and_loses_a_third():
    packing = pm.Packing([[2.0, 0.5]], [0.5], pm.Box.cubic(8.0, 2))
    weight = packing.mass_n[0] * 1e-3
    floor = pm.Walls(1.0, 0.0, 4.0, pm.LinearSpring(10.0), friction=pm.Friction(0.3, stiffness=4.0, damping=0.05))
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(10.0)), floor, pm.Gravity(0.0, -1e-3)))
    # at rest on the floor, whose spring is twice that of the pair of equal discs
    scene = scene.replace(packing=packing.replace(position_nd=[[2.0, 0.5 - weight / 40.0]]))
    # it rolls after a time of v / (3 mu g)
    run = pm.simulate(scene, duration=40.0, velocity_nd=[[0.02, 0.0]], spin_nk=[[0.0]], ledger=True)
    ledger = closed(run)
    # what the spring holds at its cap is 4e-5 of it
    assert ledger.kinetic_t[-1] == pytest.approx(2.0 / 3.0 * ledger.kinetic_t[0], rel=1e-4)
    assert ledger.dissipated["sliding"][-1] == pytest.approx(ledger.kinetic_t[0] / 3.0, rel=1e-3)
    assert set(ledger.dissipated) <= {"sliding", "tangential_dashpots", "wall_dashpots"}


def test_forming_and_breaking_of_an_adhesive_contact_takes_what_thornton_and_ning_say():
    modulus, adhesion, radius = 1.0, 1e-3, 0.25
    packing = pm.Packing([[2.0] * 3, [3.01, 2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(6.0, 3))
    scene = pm.Scene(packing, (pm.JKR(modulus, adhesion),))
    run = pm.simulate(scene, duration=30.0, dt=5e-4, velocity_nd=[[0.05, 0, 0], [-0.05, 0, 0]], ledger=True)
    ledger = closed(run)
    assert ledger.stored["interactions"][-1] == 0.0
    lost = 7.09 * (adhesion**5 * radius**4 / modulus**2) ** (1.0 / 3.0)
    # the contact forms within a step of touching, where it pulls with 4/3 pi w R; 7.09 is three digits of 7.0921
    late = 4.0 / 3.0 * math.pi * adhesion * radius * 0.1 * 5e-4
    assert ledger.dissipated["interactions"][-1] == pytest.approx(lost, abs=late + 5e-4 * lost)


def test_a_bridge_that_forms_and_ruptures_takes_its_energy_at_contact():
    packing = pm.Packing([[2.0] * 3, [3.01, 2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(6.0, 3))
    bridge = pm.CapillaryBridge(volume=1e-4, surface_tension=0.01)
    scene = pm.Scene(packing, (SPRING, bridge))
    run = pm.simulate(scene, duration=15.0, dt=5e-4, velocity_nd=[[0.1, 0, 0], [-0.1, 0, 0]], ledger=True)
    ledger = closed(run)
    assert ledger.stored["interactions"][-1] == 0.0
    # 0 at the rupture; it forms within a step of touching, where it pulls with pi g
    late = math.pi * 0.01 * 0.2 * 5e-4
    lost = -bridge.interaction_energy(1.0, pm.Partners(1.0, 0.25), 1.0, (1.0,))
    assert ledger.dissipated["interactions"][-1] == pytest.approx(lost, abs=late)


def test_a_heat_bath_supplies_what_dashpots_dissipate():
    scene = jammed(SPRING, SMOOTH, pm.Langevin(1e-4, 0.1, seed=1))
    ledger = closed(pm.simulate(scene, duration=200.0, ledger=True))
    assert ledger.dissipated["normal_dashpots"][-1] > 0.0
    assert ledger.work["bath"][-1] > 0.5 * ledger.dissipated_t[-1]
    # free particles have nothing but what it gave them
    apart = pm.Scene(pm.random_packing(16, dimension=2, packing_fraction=0.1, seed=1), (pm.Langevin(1e-4, 0.1),))
    ledger = closed(pm.simulate(apart, steps=100, dt=0.01, ledger=True))
    assert ledger.work["bath"] == pytest.approx(ledger.kinetic_t - ledger.kinetic_t[0], rel=1e-12)


def test_springs_of_mindlin_lose_energy_as_the_normal_force_changes_and_close():
    hertz = pm.Repulsion(pm.Hertz(energy_scale=1.0))
    friction = pm.Friction(0.5, pm.Mindlin(0.3), pm.DampingRatio(1.0))
    scene = jammed(hertz, friction, pm.Restitution(0.5), fraction=0.95)
    ledger = closed(pm.ramp_strain(scene, rate=0.01, applied_strain=0.2, ledger=True))
    assert 0.0 < ledger.dissipated["stiffness_changes"][-1] < ledger.dissipated["sliding"][-1]
    assert (np.diff(ledger.dissipated["stiffness_changes"]) >= 0.0).all()


def test_friction_under_a_pull_closes_with_the_cap_of_the_force_that_the_pull_is_taken_off():
    scene = jammed(*GRAINS, pm.DMT(adhesion=0.01, separation=0.01))
    ledger = closed(pm.ramp_strain(scene, rate=0.02, applied_strain=0.2, ledger=True))
    assert ledger.dissipated["sliding"][-1] > 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_grains_between_rough_walls_close(dimension):
    fraction = 0.7 if dimension == 2 else 0.5
    packing = pm.random_packing(40, dimension=dimension, packing_fraction=fraction, seed=2)
    side = float(packing.box.lattice_dd[0, 0])
    turning = (pm.RollingResistance(0.1, 0.5),)
    if dimension == 3:
        turning = (*turning, pm.TwistingResistance(0.1, 0.5))
    rough = {"friction": pm.Friction(0.4, pm.Mindlin(0.3)), "rolling": turning[0]}
    walls = pm.Walls(0.0, 0.0, 0.9 * side, **rough, twisting=turning[1] if dimension == 3 else None)
    effects = (SPRING, pm.Friction(0.4, pm.Mindlin(0.3), 0.05), SMOOTH, *turning, pm.Gravity(-0.01, -0.003), walls)
    scene = pm.Scene(packing, effects)
    ledger = closed(pm.simulate(scene, duration=60.0, velocity_nd=shaken(scene), ledger=True, check=False))
    assert ledger.dissipated["sliding"][-1] > 0.0


def test_runs_in_spans_close_and_do_the_work_of_their_stress():
    scene = jammed(*GRAINS, fraction=0.86)
    run = pm.shear_at_pressure(
        scene, rate=1e-3, pressure=1e-2, applied_strain=0.2, skip_strain=0.0, ledger=True, check=False
    )
    ledger = closed(run)
    assert ledger.time_t[-1] == pytest.approx(run.strain_t[-1] / 1e-3, rel=1e-12)
    side = -float(np.trace(pm.stress_tensor(scene))) / 2.0
    closed(pm.deform_at_rate(scene, rate=1e-3, strain={"yy": -0.02}, stress={"xx": -side}, ledger=True, check=False))
    # where no stress is held the rate does not change, with which that of dashpots would jump from span to span
    run = pm.deform_at_rate(scene, rate=1e-3, strain={"yy": -0.05}, answer=1.0, ledger=True, check=False)
    ledger = closed(run)
    strain = run.strain_tdd
    volume = scene.packing.box.volume * np.exp(np.trace(strain, axis1=1, axis2=2))
    pull = run.stress_tdd * volume[:, None, None]
    work = float(np.einsum("tij,tij->", 0.5 * (pull[1:] + pull[:-1]), np.diff(strain, axis=0)))
    # 6e-5 with 57 looks at the stress, 1.6e-5 with 1,250
    assert ledger.work["box"][-1] == pytest.approx(work, rel=2e-4)


def test_what_springs_hold_goes_from_span_to_span():
    """Springs of bonds, whose energy is all there is, and Mindlin's, whose stiffness a packing does not keep."""
    scene = jammed(SPRING, count=40)
    bonds = pm.bond_contacts(scene.packing, compression=pm.LinearSpring(), tangential_stiffness=0.3, damping=0.2)
    held = scene.replace(effects=(SPRING, SMOOTH, bonds))
    run = pm.deform_at_rate(held, rate=1e-3, strain={"xy": 0.05}, ledger=True, check=False)
    ledger = closed(run)
    assert ledger.stored["bond_tangential"][-1] > 0.01 * ledger.work_t[-1]
    effects = pm.Repulsion(pm.Hertz()), pm.Friction(0.5, pm.Mindlin(0.3), pm.DampingRatio(1.0)), pm.Restitution(0.5)
    grains = jammed(*effects, fraction=0.95)
    ledger = closed(pm.deform_at_rate(grains, rate=1e-3, strain={"xy": 0.05}, ledger=True, check=False))
    assert (np.diff(ledger.dissipated["stiffness_changes"]) >= 0.0).all()


def test_a_contact_that_forms_as_a_bond_breaks_is_booked_once():
    packing = pm.Packing([[2.0] * 3, [2.97, 2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(6.0, 3))
    bond = pm.Bonds(
        [0], [1], [[0, 0, 0]], [0.97], compression=pm.LinearSpring(), breaks_at=pm.BondLimits(tension=0.005)
    )
    scene = pm.Scene(packing, (pm.JKR(1.0, 1e-3), bond))
    run = pm.simulate(scene, duration=3.0, dt=1e-3, velocity_nd=[[-0.01, 0, 0], [0.01, 0, 0]], ledger=True)
    assert len(run.broken_bonds) == 1
    ledger = closed(run)
    # the energy of its spring, which is stretched beyond its limit by what it moves in a step
    assert ledger.dissipated["breaking"][-1] == pytest.approx(0.005**2 / 2.0, abs=0.005 * 0.02 * 1e-3)
    assert abs(ledger.integrator["interactions"][-1]) < 0.02 * ledger.dissipated["interactions"][-1]


# -- order ----------------------------------------------------------------------------------------------------------


def test_what_the_integrator_leaves_is_of_second_order_in_sheared_grains_that_slide():
    hertz = pm.Repulsion(pm.Hertz(energy_scale=1.0))
    scene = jammed(hertz, *GRAINS[1:], fraction=0.95)
    left = []
    for dt in (0.04, 0.02, 0.01):
        ledger = closed(pm.ramp_strain(scene, rate=0.01, applied_strain=0.3, dt=dt, samples=10, ledger=True))
        left.append([abs(ledger.integrator[name][-1]) for name in ("contacts", "tangential")])
        assert ledger.dissipated["sliding"][-1] > 0.1 * ledger.work_t[-1]
    orders = np.log2(np.array(left)[:-1] / np.array(left)[1:])
    assert orders == pytest.approx(2.0, abs=0.1)


# -- the same bits --------------------------------------------------------------------------------------------------


def test_a_ledger_changes_no_bit_of_the_run_and_threads_none_of_the_ledger():
    scene = jammed(*GRAINS, count=700)
    asked = {"steps": 300, "dt": 0.02, "velocity_nd": shaken(scene), "applied_strain": pm.SteadyStrain(0.01)}
    plain, one, both = (
        pm.simulate(scene, **asked, **how) for how in ({}, {"ledger": True}, {"ledger": True, "threads": 2})
    )
    assert plain.ledger is None
    assert plain.packing == one.packing == both.packing
    for name, curve in one.ledger.columns().items():
        assert np.array_equal(curve, both.ledger.columns()[name]), name
    assert one.ledger.worst_left == both.ledger.worst_left


def wet(count):
    """Return grains of all that remembers: bridges, Mindlin's springs, rough walls, in a heat bath."""
    friction = pm.Friction(0.5, pm.Mindlin(0.3))
    scene = jammed(pm.Repulsion(pm.Hertz()), count=count, fraction=0.95)
    side = float(scene.packing.box.lattice_dd[0, 0])
    walls = pm.Walls(0.0, 0.05 * side, 0.95 * side, friction=friction)
    bridge, bath = pm.CapillaryBridge(1e-4, 0.01), pm.Langevin(1e-5, 0.1)
    return scene.replace(effects=(*scene.effects, friction, walls, bridge, bath, SMOOTH))


def test_threads_change_no_bit_of_the_ledger_of_what_remembers():
    scene = wet(700)
    one, both = (pm.simulate(scene, steps=200, dt=0.02, ledger=True, threads=n, check=False) for n in (1, 2))
    assert one.ledger.residual < 1e-12
    for name, curve in one.ledger.columns().items():
        assert np.array_equal(curve, both.ledger.columns()[name]), name


@pytest.mark.parametrize("scene", [jammed(*GRAINS), wet(64)], ids=["grains", "wet"])
def test_a_run_that_goes_on_from_its_checkpoint_has_the_same_ledger(scene, tmp_path):
    path = tmp_path / "run.npz"
    asked = {"dt": 0.02, "velocity_nd": shaken(scene), "ledger": True, "trace_every": 50}
    whole = pm.simulate(scene, steps=1000, **asked)
    pm.simulate(scene, steps=430, checkpoint=path, **asked)
    ledger = pm.resume(path, scene, steps=1000).ledger
    at = np.isin(ledger.time_t, whole.ledger.time_t)
    for name, curve in whole.ledger.columns().items():
        if not name.startswith("residual"):
            assert np.array_equal(curve, ledger.columns()[name][at]), name


# -- what breaks ----------------------------------------------------------------------------------------------------


def test_a_step_that_is_too_long_for_one_contact_is_seen_and_that_contact_is_named():
    scene = jammed(SPRING, fraction=0.95)
    contacts = pm.find_contacts(scene.packing, gap_tolerance=0.0)
    light = int(contacts.i_c[0])
    mass = scene.packing.mass_n.copy()
    mass[light] *= 0.02
    scene = scene.replace(packing=scene.packing.replace(mass_n=mass))
    dt = 0.95 * 2.0 * math.sqrt(mass[light])
    run = pm.simulate(scene, steps=400, dt=dt, velocity_nd=shaken(scene, 0.01), ledger=True, check=False)
    ledger = run.ledger
    assert not ledger.closed
    assert light in ledger.worst_left[:2]
    assert f"particles {ledger.worst_left.i} and {ledger.worst_left.j}" in repr(ledger)
    assert "does not close" in repr(ledger)


def test_what_the_ledger_does_not_know_is_refused_by_name():
    scene = jammed(SPRING, count=16)
    mindlin = scene.replace(effects=(pm.Repulsion(pm.Hertz()), pm.Friction(0.5, pm.Mindlin(0.3))))
    with pytest.raises(ValueError, match="must have no Mindlin"):
        pm.contact_dissipation(mindlin, np.zeros((16, 2)))
    bath = scene.replace(effects=(SPRING, pm.Langevin(1e-6, 0.1)))
    with pytest.raises(ValueError, match="no Langevin where energies are accounted for in a box that deforms"):
        pm.simulate(bath, steps=1, applied_strain=pm.SteadyStrain(0.01), ledger=True)
    link = pm.Links([0], [1], [[0, 0]], [1.0])
    dimer = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), link, [1.0, 1.0])
    with pytest.raises(ValueError, match="rigid links where energies are accounted for, got 1 links"):
        pm.simulate(pm.Scene(dimer, (SPRING,)), steps=1, ledger=True)


# -- one moment -----------------------------------------------------------------------------------------------------


def test_powers_of_contacts_add_up_to_the_rate_of_the_ledger():
    scene = jammed(*GRAINS, pm.RollingResistance(0.1, stiffness=0.3), pm.BackgroundDamping(0.05))
    strain = pm.SteadyStrain(0.02)
    run = pm.simulate(scene, steps=3000, dt=0.01, applied_strain=strain, ledger=True, trace_every=1)
    found = pm.contact_dissipation(
        scene.replace(packing=run.packing), run.velocity_nd, run.spin_nk, applied_strain=strain
    )  # fmt: skip
    for name, curve in run.ledger.dissipated.items():
        # at the end, from the rates in the middle of the last two steps
        rate = (1.5 * (curve[-1] - curve[-2]) - 0.5 * (curve[-2] - curve[-3])) / 0.01
        assert found.by_channel[name] == pytest.approx(rate, rel=0.01), name


def test_powers_of_one_contact_are_those_of_closed_forms():
    scene = two(SPRING, pm.ContactDamping(0.2), pm.Friction(0.3, stiffness=0.5, damping=0.7), distance=0.9)
    tangential = pm.TangentialDisplacements([0], [1], [[0, 0]], [[0.06]])
    packing = scene.packing.replace(tangential=tangential)
    apart = {"velocity_nd": [[0.0, -0.5], [0.1, 0.5]]}
    sliding = pm.contact_dissipation(scene.replace(packing=packing), **apart)
    # friction is at its cap of 0.3 * 0.1, which falls a little; the dashpot along the normal takes 0.2 * 0.1^2
    assert sliding.power["sliding"] == pytest.approx([0.03], rel=0.02)
    assert sliding.power["normal_dashpots"] == pytest.approx([0.002], rel=1e-12)
    sticking = pm.contact_dissipation(scene, [[0.0, -1e-3], [0.0, 1e-3]])
    assert sticking.power["tangential_dashpots"] == pytest.approx([0.7 * 4e-6], rel=1e-12)
    assert "sliding" not in sticking.power or abs(sticking.power["sliding"][0]) < 1e-12
