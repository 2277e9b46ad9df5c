"""Facts about walls that move at a velocity: collisions, the work they do, what a run keeps of them."""

import math

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine

STIFF = 1e3


def ball_between(low_motion=None, high_motion=None, friction=None, damping=0.0, d=2, **place):
    """Return a scene of one particle between two walls across y, at 1 and 8."""
    at = [[5.0, place.get("y", 3.0), 5.0][:d]]
    packing = pm.Packing(at, [0.5], pm.Box.cubic(10.0, d), mass_n=[1.0])
    walls = pm.Walls(
        1, 1.0, 8.0, pm.LinearSpring(STIFF), damping, friction, low_motion=low_motion, high_motion=high_motion
    )
    return pm.Scene(packing, (walls,))


def grains(d=2, number=60, friction=None, damping=0.0, motions=(None, None), seed=3):
    """Return a scene of particles that move about between two walls across y, in a box that is higher."""
    packing = pm.random_packing(number, dimension=d, packing_fraction=0.5, seed=seed)
    packing = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-9).packing
    side = float(packing.box.lattice_dd[0, 0])
    height = np.ones(d)
    height[1] = 1.5
    packing = packing.replace(box=pm.Box(np.diag(side * height)), position_nd=packing.position_nd % side)
    reach = float(packing.radius_n.max())
    walls = pm.Walls(
        1, -0.5 * reach, side + 0.5 * reach, pm.LinearSpring(STIFF), damping, friction,
        low_motion=motions[0], high_motion=motions[1],
    )  # fmt: skip
    effects = (pm.Repulsion(pm.LinearSpring(STIFF)), walls)
    return pm.Scene(packing, effects if friction is None else (*effects, friction))


def test_a_wall_that_comes_on_sends_a_ball_away_at_twice_its_speed_more():
    """Elastic, of infinite mass: v' = 2 V - v, whatever the law."""
    scene = ball_between(low_motion=pm.WallMotion(y=0.4))
    run = pm.simulate(scene, duration=2.0, dt=2e-4, velocity_nd=[[0.2, -1.0]])
    assert run.velocity_nd[0] == pytest.approx([0.2, 1.8], rel=1e-4)
    wall = run.walls
    assert wall.place_tf[-1] == pytest.approx([1.8, 8.0], rel=1e-12)
    # what it did is what the ball has more
    assert wall.work_tfd[-1, 0, 1] == pytest.approx(0.5 * (1.8**2 - 1.0), rel=2e-4)


def test_a_collision_with_a_moving_wall_is_that_with_a_still_one_seen_by_whoever_moves_along():
    """Galilei: with dashpot and friction, to rounding."""
    friction = pm.Friction(0.3, 0.5 * STIFF, 2.0)
    moving = ball_between(pm.WallMotion(0.5, 0.4, -0.3), friction=friction, damping=3.0, d=3, y=1.55)
    still = ball_between(friction=friction, damping=3.0, d=3, y=1.55)
    drift, start = np.array([0.5, 0.4, -0.3]), np.array([1.2, -0.8, 0.1])
    spin = [[0.2, -0.5, 1.0]]
    how = {"duration": 0.4, "dt": 1e-3, "spin_nk": spin}
    one = pm.simulate(moving, velocity_nd=[start + drift], **how)
    other = pm.simulate(still, velocity_nd=[start], **how)
    assert np.abs(one.velocity_nd - drift - other.velocity_nd).max() < 1e-11
    assert np.abs(one.spin_nk - other.spin_nk).max() < 1e-11
    assert np.abs(other.spin_nk - spin).max() > 0.1


def test_walls_that_move_at_no_velocity_do_what_still_ones_do():
    friction = pm.Friction(0.4, 0.5 * STIFF, 1.0)
    for rough in (None, friction):
        still = grains(friction=rough, damping=2.0)
        moving = grains(friction=rough, damping=2.0, motions=(pm.WallMotion(), None))
        velocity = np.random.default_rng(1).normal(size=(60, 2))
        how = {"steps": 300, "dt": 1e-3, "velocity_nd": velocity, "ledger": True}
        one, other = pm.simulate(moving, **how), pm.simulate(still, **how)
        assert np.abs(one.velocity_nd - other.velocity_nd).max() < 1e-9
        assert one.ledger.stored_t == pytest.approx(other.ledger.stored_t, abs=1e-8 * one.ledger.scale)
        assert other.walls is None and one.walls is not None


@pytest.mark.parametrize("d", [2, 3])
def test_the_ledger_books_the_work_of_walls_that_squeeze_and_shear_grains(d):
    friction = pm.Friction(0.4, 0.5 * STIFF, 1.0)
    scene = grains(d, friction=friction, damping=2.0, motions=(pm.WallMotion(0.5), pm.WallMotion(-0.5, -2.0)))
    run = pm.simulate(scene, steps=1500, dt=5e-4, ledger=True)
    ledger = run.ledger
    assert ledger.residual < 1e-12
    work = ledger.work["moved_walls"]
    assert work[-1] > 0.0 and set(ledger.work) == {"moved_walls"}
    assert ledger.dissipated["wall_dashpots"][-1] > 0.0 and ledger.dissipated["sliding"][-1] > 0.0
    # without a ledger walls count the same work
    assert run.walls.work_tfd[-1].sum() == pytest.approx(work[-1], rel=1e-10)
    # squeezed: compression at both faces
    assert run.walls.stress_tfd[:, :, 1].mean(axis=0).max() < 0.0


def test_energy_less_work_is_kept_to_second_order():
    scene = ball_between(low_motion=pm.WallMotion(y=0.4), y=1.48)
    errors = []
    for dt in (2e-3, 1e-3):
        run = pm.simulate(scene, duration=0.02, dt=dt)
        errors.append(abs(run.energy_drift))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_a_run_that_was_cut_goes_on_with_the_same_bits_on_any_number_of_threads(tmp_path):
    friction = pm.Friction(0.4, 0.5 * STIFF, 1.0)
    scene = grains(number=800, friction=friction, motions=(None, pm.WallMotion(1.0, -3.0)))
    how = {"dt": 5e-4, "ledger": True}
    whole = pm.simulate(scene, steps=300, **how)
    both = pm.simulate(scene, steps=300, threads=2, **how)
    pm.simulate(scene, steps=300, checkpoint=tmp_path / "run.npz", checkpoint_every=70, **how)
    assert whole.walls.place_tf[-1, 1] < whole.walls.place_tf[0, 1] - 0.4
    path = tmp_path / "cut.npz"
    pm.simulate(scene, steps=100, checkpoint=path, **how)
    cut = pm.resume(path, scene, steps=300)
    for one in (both, cut):
        assert np.array_equal(one.velocity_nd, whole.velocity_nd) and one.packing == whole.packing
        assert one.walls.effects == whole.walls.effects
        assert np.array_equal(one.walls.work_tfd[-1], whole.walls.work_tfd[-1])
    assert np.array_equal(both.walls.stress_tfd, whole.walls.stress_tfd)


def test_another_run_goes_on_from_where_the_walls_stand():
    scene = grains(motions=(None, pm.WallMotion(y=-2.0)))
    whole = pm.simulate(scene, steps=400, dt=5e-4)
    first = pm.simulate(scene, steps=200, dt=5e-4)
    then = scene.replace(packing=first.packing, effects=first.walls.effects)
    second = pm.simulate(then, steps=200, dt=5e-4, velocity_nd=first.velocity_nd)
    assert np.abs(second.velocity_nd - whole.velocity_nd).max() < 1e-6 * np.abs(whole.velocity_nd).max()
    # at rest the walls are taken where they stand
    still = then.replace(effects=tuple(getattr(one, "still", one) for one in then.effects))
    engine = build_engine(then, dt=1e-3, velocity_nd=np.zeros_like(first.velocity_nd))
    push = engine.observe() is not None and engine.state.push[:, :2]
    force = np.empty_like(push)
    force[engine.order_n] = push
    assert pm.forces(still) == pytest.approx(force, abs=1e-12 * STIFF)


def test_what_walls_that_move_are_not_for_is_refused_by_name():
    scene = grains(motions=(None, pm.WallMotion(y=-2.0)))
    with pytest.raises(ValueError, match="walls that stand still for pm.quench"):
        pm.quench(scene)
    with pytest.raises(ValueError, match="no Walls that move where the box deforms"):
        pm.simulate(scene, steps=1, applied_strain=pm.SteadyStrain(0.1))
    slanted = scene.packing.replace(box=pm.Box(scene.packing.box.lattice_dd + [[0.0, 0.0], [1.0, 0.0]]))
    with pytest.raises(ValueError, match="all lattice vectors but one in walls"):
        pm.simulate(scene.replace(packing=slanted), steps=1)
    with pytest.raises(ValueError, match=r"high_motion.z must be zero in a plane"):
        grains(motions=(None, pm.WallMotion(z=-2.0)))
    with pytest.raises(ValueError, match=r"high_motion.y.inertia must be positive"):
        grains(motions=(None, pm.WallMotion(y=pm.HeldStress(-1.0, inertia=0.0))))
    ellipses = pm.random_packing(4, dimension=2, packing_fraction=0.4, seed=1, shapes=pm.Ellipses(1.5))
    with pytest.raises(ValueError, match="Walls that stand still for"):
        pm.Scene(ellipses, (pm.Repulsion(), pm.Walls(1, 0.0, 1.0, low_motion=pm.WallMotion())))


def test_scene_files_hold_motions(tmp_path):
    motion = pm.WallMotion(0.1, pm.HeldStress(-1.0, inertia=2.0, damping=0.5, velocity=0.1))
    scene = grains(number=12, friction=pm.Friction(0.5), motions=(None, motion))
    pm.write_scene(scene, tmp_path / "scene.toml")
    assert pm.read_scene(tmp_path / "scene.toml") == scene
    shipped = pm.read_scene("piston")
    lid = shipped.effects[-1].high_motion
    assert lid == pm.WallMotion(0.02, pm.HeldStress(-0.01, 1.0, 0.2), 0.0)
    with pytest.raises(ValueError, match="high_motion.y.inertia must be positive"):
        pm.read_scene("piston", changes={"effects.walls.high_motion.y.inertia": 0.0})


def test_frames_of_a_run_draw_walls_where_they_stood():
    from packmech.view.trajectory import trajectory_of_run

    scene = grains(number=12, motions=(None, pm.WallMotion(y=-2.0)))
    run = pm.simulate(scene, steps=40, dt=1e-3, trace_every=20, trace_positions=True)
    frames = trajectory_of_run(run, scene, 3).frames
    high = [one.effects[1].high for one in frames]
    assert high == pytest.approx(scene.effects[1].high - 2.0 * np.array([0.0, 0.02, 0.04]), rel=1e-12)


def test_what_goes_on_from_walls_that_left_the_cell_stays_between_them():
    """The cell is the one that has the middle between the walls: forces, rest and motion agree."""
    disc = pm.Packing([[1.0, -0.55]], [0.5], pm.Box.cubic(6.0, 2))
    for shift in (0.0, 6.0):
        walls = pm.Walls(1, -1.0, 2.7, pm.LinearSpring(1.0), 0.5)
        scene = pm.Scene(
            disc.replace(position_nd=disc.position_nd + [0.0, shift]), (pm.Repulsion(), pm.Gravity(0.0, -0.1), walls)
        )
        weight = 0.1 * float(disc.mass_n[0])
        # 0.45 above the wall: pressed in by 0.05, and so is the image
        assert pm.forces(scene)[0] == pytest.approx([0.0, 0.1 - weight], rel=1e-12)
        rest = -0.5 - 0.5 * weight
        for run in (pm.simulate(scene, duration=80.0), pm.quench(scene, force_tolerance=1e-12)):
            place = run.packing.position_nd[0, 1]
            assert place - 6.0 * round((place - rest) / 6.0) == pytest.approx(rest, abs=1e-8)


def test_a_run_ends_before_its_walls_meet_and_before_they_are_farther_apart_than_the_box():
    disc = pm.Packing([[1.0, 1.5]], [0.1], pm.Box.cubic(6.0, 2))
    apart = pm.Walls(1, 0.5, 2.5, pm.LinearSpring(100.0), high_motion=pm.WallMotion(y=0.5))
    run = pm.simulate(pm.Scene(disc, (pm.Repulsion(), apart)), duration=20.0, dt=1e-2, check=False)
    assert run.outcome is pm.Outcome.WALLS_MET and not run.ok
    assert 6.4 < run.walls.place_tf[-1, 1] <= 6.5
    behind = disc.replace(position_nd=[[1.0, 2.3]])
    closing = pm.Walls(1, 0.5, 2.0, pm.LinearSpring(1e-9), low_motion=pm.WallMotion(y=0.5))
    run = pm.simulate(pm.Scene(behind, (pm.Repulsion(), closing)), duration=20.0, dt=1e-2, check=False)
    assert run.outcome is pm.Outcome.WALLS_MET
    assert 1.9 < run.walls.place_tf[-1, 0] < 2.0


@pytest.mark.parametrize("along", [0.1, pm.HeldStress(0.1)])
def test_a_smooth_wall_that_should_move_along_itself_is_refused(along):
    with pytest.raises(ValueError, match="high_motion.x must be zero for smooth walls, which drag nothing along"):
        ball_between(high_motion=pm.WallMotion(x=along))
    assert ball_between(high_motion=pm.WallMotion(x=along), friction=pm.Friction(0.5)).effects


def test_a_lid_that_falls_steadily_against_its_dashpot_does_not_bear_what_it_holds():
    lid = pm.WallMotion(y=pm.HeldStress(-0.01, inertia=0.1, damping=1.0))
    walls = pm.Walls(1, 0.5, 5.5, pm.LinearSpring(1.0), high_motion=lid)
    disc = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(6.0, 2))
    run = pm.simulate(pm.Scene(disc, (pm.Repulsion(), walls)), duration=20.0)
    assert run.walls.velocity_tfd[-1, 1, 1] == pytest.approx(-0.01, rel=1e-6) and run.walls.steady_fd[1, 1]
    assert "-0.01 is held, not reached; steady" in [words for _, _, words in run.walls.rows()]
