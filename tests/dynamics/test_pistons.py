"""Facts about walls that hold a stress: what they press at rest, how they swing and drag, where their energy goes."""

import math

import numpy as np
import pytest

import packmech as pm

STIFF = 1e3
SPRING = pm.LinearSpring(STIFF)


def plate(d=2, number=1, low_motion=None, high_motion=None, friction=None, law=SPRING, damping=0.0):
    """Return a scene of particles side by side on a floor at 1, under a plate that touches them at 2."""
    place = np.full((number, d), 1.5)
    place[:, 0] = 2.0 + 1.5 * np.arange(number)
    packing = pm.Packing(place, [0.5] * number, pm.Box([12.0, 6.0, 12.0][:d]), mass_n=[1.0] * number)
    walls = pm.Walls(1, 1.0, 2.0, law, damping, friction, low_motion=low_motion, high_motion=high_motion)
    return pm.Scene(packing, (walls,))


def column():
    """Return discs that fall on a floor under a piston, and lose their energy."""
    packing = pm.random_packing(30, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.5, seed=3)
    packing = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-9).packing
    side = float(packing.box.lattice_dd[0, 0])
    packing = packing.replace(box=pm.Box([side, 1.5 * side]), position_nd=packing.position_nd % side + [0.0, 1.0])
    piston = pm.WallMotion(y=pm.HeldStress(-2.0, inertia=0.5, damping=1.0))
    walls = pm.Walls(1, 0.5, side + 1.5, SPRING, 10.0, high_motion=piston)
    slowed = pm.ContactDamping(10.0), pm.BackgroundDamping(1.0)
    return pm.Scene(packing, (pm.Repulsion(SPRING), *slowed, pm.Gravity(0.0, -0.5), walls))


def test_a_floor_under_a_piston_bears_the_weight_and_the_pressure():
    scene = column()
    run = pm.simulate(scene, duration=120.0)
    walls = run.walls
    side, weight = float(scene.packing.box.lattice_dd[0, 0]), 0.5 * scene.packing.mass_n.sum()
    low, high = walls.pressure_tf[-1]
    assert high == pytest.approx(2.0, rel=1e-8)
    assert low * side == pytest.approx(weight + 2.0 * side, rel=1e-8)
    assert walls.steady_fd.all() and walls.place_tf[-1, 1] < scene.effects[-1].high - 0.1
    # at rest, on the walls where they stand, it is a minimum of the energy
    still = scene.replace(packing=run.packing, effects=tuple(getattr(one, "still", one) for one in walls.effects))
    assert np.abs(pm.forces(still)).max() < 1e-8 * weight


def test_a_sphere_between_two_pistons_is_pressed_as_hertz_says():
    """F = (energy_scale / sigma) xi^(3/2) at both poles, and plates are sigma (1 - xi) apart."""
    held = pm.HeldStress(-0.02, inertia=0.01, damping=0.3)
    motion = pm.WallMotion(y=held)
    scene = plate(3, 1, motion, motion, law=pm.Hertz(100.0), damping=1.0)
    run = pm.simulate(scene, duration=80.0)
    xi = (0.02 * 144.0 * 1.0 / 100.0) ** (2.0 / 3.0)
    low, high = run.walls.place_tf[-1]
    assert high - low == pytest.approx(1.0 - xi, rel=1e-9)
    assert run.walls.steady_fd.all()
    # pushed alike from both sides it stays where it is
    assert run.packing.position_nd[0, 1] == pytest.approx(1.5, abs=1e-9)


def test_a_piston_on_a_spring_swings_as_a_cosine_to_second_order_in_the_step():
    """A wall's contact has the stiffness 2 u'': X = X0 + (p A / 2 k) (cos(w t) - 1) with w^2 = 2 k / M."""
    motion = pm.WallMotion(y=pm.HeldStress(-1.0, inertia=0.5))
    scene = plate(2, 1, None, motion)
    swing, omega = 12.0 / (2.0 * STIFF), math.sqrt(2.0 * STIFF / (0.5 * 12.0))
    end, errors = 1.3 * 2.0 * math.pi / omega, []
    for steps in (40, 80, 160):
        run = pm.simulate(scene, steps=steps, dt=end / steps, held_n=[True])
        exact = 2.0 + swing * (math.cos(omega * end) - 1.0)
        errors.append(abs(run.walls.place_tf[-1, 1] - exact))
    assert errors[-1] < 1e-3 * swing
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert order == pytest.approx([2.0, 2.0], abs=0.1)
    # nothing takes energy: the piston's, the spring's and that of the stress are the same at all times
    assert abs(run.energy_drift) < 1e-3


@pytest.mark.parametrize("share", [0.5, 0.95, 1.05, 1.5])
def test_a_plate_that_is_dragged_gives_way_at_coulombs_limit(share):
    """Below mu p the springs of friction hold it; above it moves at (stress - mu p) / damping in the end."""
    mu, pressure, damping = 0.4, 1.0, 0.3
    friction = pm.Friction(mu, 0.5 * STIFF, 20.0)
    shear = share * mu * pressure
    motion = pm.WallMotion(
        x=pm.HeldStress(shear, inertia=0.2, damping=damping), y=pm.HeldStress(-pressure, inertia=0.2, damping=2.0)
    )
    scene = plate(2, 3, None, motion, friction, damping=20.0)
    # the particles are held: they neither move nor turn; at first the plate sinks, and is not dragged
    sunk = pm.simulate(
        scene.replace(effects=(scene.effects[0]._replace(high_motion=motion._replace(x=0.0)),)),
        duration=20.0, held_n=[True] * 3,
    )  # fmt: skip
    place = float(sunk.walls.place_tf[-1, 1])
    pressed = scene.replace(effects=(scene.effects[0]._replace(high=place),))
    run = pm.simulate(pressed, duration=30.0, held_n=[True] * 3, ledger=True)
    velocity, stress = run.walls.velocity_tfd[-1, 1, 0], run.walls.stress_tfd[-1, 1]
    assert stress[1] == pytest.approx(-pressure, rel=1e-6)
    assert run.walls.steady_fd.all()
    assert run.ledger.residual < 1e-10
    if share < 1.0:
        assert abs(velocity) < 1e-8 and stress[0] == pytest.approx(shear, rel=1e-6)
        # a load that is put on at once swings up to twice itself, which the springs hold below the limit
        assert share > 0.5 or "sliding" not in run.ledger.dissipated
    else:
        assert stress[0] == pytest.approx(mu * pressure, rel=1e-6)
        assert velocity == pytest.approx((shear - mu * pressure) / damping, rel=1e-6)
        # the held stress pays for sliding and for the dashpot of the plate
        slid = mu * pressure * 12.0 * run.walls.moved_tfd[-1, 1, 0]
        assert run.ledger.dissipated["sliding"][-1] == pytest.approx(slid, rel=1e-2)
        assert run.ledger.dissipated["piston_dashpots"][-1] > 0.0


def test_the_ledger_of_grains_under_a_piston_closes_and_runs_go_on_with_the_same_bits(tmp_path):
    friction = pm.Friction(0.4, 0.5 * STIFF, 1.0)
    packing = pm.random_packing(700, dimension=2, packing_fraction=0.7, seed=2)
    packing = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-9).packing
    side = float(packing.box.lattice_dd[0, 0])
    packing = packing.replace(box=pm.Box([side, 1.5 * side]), position_nd=packing.position_nd % side)
    motion = pm.WallMotion(x=pm.HeldStress(5.0, 1.0, 0.1), y=pm.HeldStress(-20.0, 0.5, 0.1, velocity=-3.0))
    walls = pm.Walls(1, -0.3, side + 0.3, SPRING, 2.0, friction, low_motion=pm.WallMotion(x=0.3), high_motion=motion)
    scene = pm.Scene(packing, (pm.Repulsion(SPRING), friction, walls))
    how = {"dt": 5e-4, "ledger": True}
    whole = pm.simulate(scene, steps=600, **how)
    ledger = whole.ledger
    assert ledger.residual < 1e-12
    assert {"held_stress", "moved_walls"} <= set(ledger.work) and "pistons" in ledger.stored
    # the kinetic energy of the piston
    velocity, mass = whole.walls.velocity_tfd[-1, 1], np.array([1.0, 0.5]) * side
    assert ledger.stored["pistons"][-1] == pytest.approx(0.5 * (mass * velocity**2).sum(), rel=1e-12)
    # the work of stresses that do not change
    way = whole.walls.moved_tfd[-1, 1] * side
    assert ledger.work["held_stress"][-1] == pytest.approx(5.0 * way[0] - 20.0 * way[1], rel=1e-2)
    assert abs(ledger.integrator["pistons"][-1]) < 1e-12 * ledger.scale
    both = pm.simulate(scene, steps=600, threads=2, **how)
    pm.simulate(scene, steps=250, checkpoint=tmp_path / "cut.npz", **how)
    cut = pm.resume(tmp_path / "cut.npz", scene, steps=600)
    for one in (both, cut):
        assert one.packing == whole.packing and one.walls.effects == whole.walls.effects
        assert np.array_equal(one.velocity_nd, whole.velocity_nd)
        assert np.array_equal(one.ledger.residual_t[-1], whole.ledger.residual_t[-1])


@pytest.mark.parametrize("inertia", [1e-3, 1e-5])
def test_a_face_asks_for_time_steps_below_two_over_its_own_frequency_on_a_contact(inertia):
    """Verlet's limit dt = 2 / sqrt(2 k (1/M + 1/m)): an overlap with a wall is half that with the mirror image."""
    scene = plate(high_motion=pm.WallMotion(y=pm.HeldStress(-0.1, inertia=inertia)))
    limit = 2.0 / math.sqrt(2.0 * STIFF * (1.0 / (12.0 * inertia) + 1.0))
    run = pm.simulate(scene, steps=10, dt=1.1 * limit, check=False)
    assert run.outcome is pm.Outcome.STEP_TOO_LONG
    (condition,) = [one for one in run.unmet if one.name == "time step"]
    assert "a face that holds a stress" in condition.hint
    assert condition.asked == pytest.approx(limit, rel=1e-2)
    assert pm.simulate(scene, steps=10, dt=0.5 * limit, check=False).outcome is pm.Outcome.FINISHED


def test_a_dashpot_of_a_face_asks_for_time_steps_below_its_own_time():
    scene = plate(high_motion=pm.WallMotion(y=pm.HeldStress(-0.1, inertia=1.0, damping=500.0)))
    run = pm.simulate(scene, steps=10, dt=0.004, check=False)
    (condition,) = [one for one in run.unmet if one.name == "time step"]
    assert "the dashpot of a face that holds a stress" in condition.hint
    # as of the drag on a particle: Verlet's dashpot sees extrapolated velocities
    assert condition.asked == pytest.approx(1.0 / 500.0, rel=0.1)
