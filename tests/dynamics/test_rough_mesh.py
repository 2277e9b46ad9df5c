"""Facts about friction on surfaces of triangles: the flat wall's numbers, closed forms, accounts, cuts, and rest."""

import functools
import itertools
import math

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import POTENTIAL, TANGENTIAL

LAW = pm.LinearSpring(1e3)
PAIRS = pm.Repulsion(LAW)
FRICTION = pm.Friction(0.3, 500.0, 5.0)
EVERYTHING = {
    "friction": pm.Friction(0.5, pm.Mindlin(0.2), pm.DampingRatio(0.5)),
    "rolling": pm.RollingResistance(0.1, 100.0, 1.0),
    "twisting": pm.TwistingResistance(0.05, 100.0, 1.0),
}


def grid(place, number=9, seed=3, size=8.0):
    """Return a surface over a square, z = place(x, y), of triangles of all sizes."""
    x = np.concatenate([[0.0], np.sort(np.random.default_rng(seed).uniform(0.0, size, number)), [size]])
    at = np.array([place(u, v) for u in x for v in x])
    n = len(x)
    first = np.array([i * n + j for i in range(n - 1) for j in range(n - 1)])
    one = np.column_stack([first, first + 1, first + n])
    return at, np.concatenate([one, np.column_stack([first + 1, first + n + 1, first + n])])


def floor(**across):
    return pm.MeshWalls(*grid(lambda u, v: (u, v, 1.0)), LAW, pm.Restitution(0.5), **across)


def slope(angle, **across):
    """Return a plane that falls along x, 1 below the middle at x = 4."""
    drop = math.tan(angle)
    return pm.MeshWalls(*grid(lambda u, v: (u, v, 3.0 - drop * (u - 4.0))), LAW, pm.Restitution(0.5), **across)


def hills(**across):
    random = np.random.default_rng(5)
    return pm.MeshWalls(
        *grid(lambda u, v: (u, v, 2.0 + random.uniform(-0.7, 0.7)), number=6), LAW, pm.Restitution(0.5), **across
    )


def drum(facets, **across):
    """Return the inside of a drum about y, of radius 3 about (4, 4), and its two ends."""
    angle = 2.0 * np.pi * np.arange(facets) / facets
    rim = np.column_stack([4.0 + 3.0 * np.cos(angle), np.zeros(facets), 4.0 + 3.0 * np.sin(angle)])
    at = np.concatenate([rim + [0.0, 1.0, 0.0], rim + [0.0, 7.0, 0.0], [[4.0, 1.0, 4.0], [4.0, 7.0, 4.0]]])
    k = np.arange(facets)
    after = (k + 1) % facets
    n = facets
    sides = np.concatenate([np.column_stack([k, after, k + n]), np.column_stack([after, after + n, k + n])])
    ends = [np.column_stack([k + s, after + s, np.full(n, 2 * n + (s > 0))]) for s in (0, n)]
    return pm.MeshWalls(at, np.concatenate([sides, *ends]), LAW, pm.Restitution(0.5), **across)


def balls(place_nd, radius=0.5):
    place_nd = np.atleast_2d(place_nd)
    return pm.Packing(place_nd, [radius] * len(place_nd), pm.Box.cubic(8.0, 3), mass_n=[1.0] * len(place_nd))


def many(height, seed=2):
    """Return sixteen balls with velocities and spins."""
    random = np.random.default_rng(seed)
    place = np.array([[u, v, height] for u in (2.2, 3.4, 4.6, 5.8) for v in (2.2, 3.4, 4.6, 5.8)])
    packing = balls(place + random.uniform(-0.05, 0.05, place.shape))
    return packing, {"velocity_nd": random.normal(size=(16, 3)), "spin_nk": 3.0 * random.normal(size=(16, 3))}


# the weight presses a ball 1/2000 deep into a floor
WEIGHT = pm.Gravity(0.0, 0.0, -1.0)
ARM = 0.4995


@pytest.mark.parametrize("across", [{"friction": FRICTION}, EVERYTHING], ids=["friction", "everything"])
def test_a_ball_slides_and_rolls_over_triangles_as_on_a_flat_wall(across):
    start = {"velocity_nd": [[1.7, 0.4, 0.0]], "spin_nk": [[0.3, -0.2, 2.0]]}
    walls = pm.Walls(2, 1.0, 7.9, LAW, pm.Restitution(0.5), **across)
    for steps in (600, 2000):
        mesh, flat = (
            pm.simulate(pm.Scene(balls([[1.0, 3.1, 1.0 + ARM]]), (PAIRS, one, WEIGHT)), steps=steps, dt=2e-3, **start)
            for one in (floor(**across), walls)
        )
        for one, other in ((mesh.velocity_nd, flat.velocity_nd), (mesh.spin_nk, flat.spin_nk)):
            assert np.abs(one - other).max() < 1e-12
        assert np.abs(mesh.packing.position_nd - flat.packing.position_nd).max() < 1e-12
        spring, expected = (one.packing.tangential.wall_stretch_wk[0] for one in (mesh, flat))
        assert spring[:3] == pytest.approx([0.0, 0.0, -1.0], abs=1e-14)
        assert spring[3:11] == pytest.approx(expected[:8], abs=1e-12) and not spring[11:].any()
        # it slides, then rolls, and has passed edges of triangles
        assert steps > 600 or np.abs(spring[3:6]).max() > 1e-6
    assert mesh.packing.position_nd[0, 0] > 4.0


def test_a_sliding_ball_loses_mu_g_until_it_rolls_at_its_share_of_the_speed():
    """Friction has no moment about the contact: v a + 2/5 r^2 w = v0 a, and v = a w at last, 5/7 v0 for a = r."""
    start, dt = pm.Scene(balls([[1.0, 3.1, 1.0 + ARM]]), (PAIRS, floor(friction=FRICTION), WEIGHT)), 1e-3
    run = pm.simulate(start, steps=4000, dt=dt, velocity_nd=[[1.5, 0.0, 0.0]], trace_every=1, trace_positions=True)
    speed, inertia = run.trace.velocity_tnd[:, 0, 0], 0.1
    until = 1.5 / 0.3 / (1.0 + ARM**2 / inertia)
    # the spring takes up its force within the first steps
    loaded = speed[200]
    sliding = np.arange(200, int(0.95 * until / dt))
    assert speed[sliding] == pytest.approx(loaded - 0.3 * dt * (sliding - 200), abs=1e-9)
    # short of mu g t by what it takes to stretch the spring, mu N / k at this speed: 4e-4 of time, 1e-4 of speed
    assert loaded == pytest.approx(1.5 - 0.3 * 0.2, abs=0.3 * 1e-3)
    rolling = 1.5 / (1.0 + inertia / ARM**2)
    assert run.velocity_nd[0, 0] == pytest.approx(rolling, rel=1e-7) and rolling == pytest.approx(1.5 * 5 / 7, rel=1e-3)
    assert run.spin_nk[0, 1] * ARM == pytest.approx(rolling, rel=1e-7)


def test_a_ball_rolls_down_a_slope_with_five_sevenths_of_what_pulls_it():
    angle = math.radians(20.0)
    normal, along = np.array([math.sin(angle), 0.0, math.cos(angle)]), np.array([math.cos(angle), 0, -math.sin(angle)])
    arm = 0.5 - 0.0005 * math.cos(angle)
    place = np.array([2.0, 3.3, 3.0 + 2.0 * math.tan(angle)]) + arm * normal
    scene = pm.Scene(balls(place), (PAIRS, slope(angle, friction=FRICTION), WEIGHT))
    run = pm.simulate(scene, steps=3000, dt=5e-4)
    share = 1.0 / (1.0 + 0.1 / arm**2)
    assert run.velocity_nd[0] @ along == pytest.approx(share * math.sin(angle) * 1.5, rel=1e-3)
    assert abs(run.velocity_nd[0] @ normal) < 1e-10 and share == pytest.approx(5 / 7, rel=2e-3)
    touch = pm.wall_contacts(scene.replace(packing=run.packing))
    assert touch.normal_wd == pytest.approx(-normal[None], abs=1e-12)
    assert touch.force_w == pytest.approx([math.cos(angle)], rel=1e-9)
    assert touch.tangential_wd == pytest.approx(-(1.0 - share) * math.sin(angle) * along[None], rel=0.1, abs=1e-12)


def test_a_ball_rests_on_a_slope_that_friction_and_resistance_to_rolling_hold_and_slides_on_a_steeper_one():
    rolling = pm.RollingResistance(0.3, 500.0, 5.0)
    for degrees, rests in ((10.0, True), (25.0, False)):
        angle = math.radians(degrees)
        place = np.array([4.0, 3.3, 3.0]) + 0.499 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        mesh = slope(angle, friction=FRICTION, rolling=rolling)
        scene = pm.Scene(balls(place), (PAIRS, mesh, WEIGHT))
        if not rests:
            fall = pm.simulate(scene, steps=3000, dt=5e-4, check=False)
            assert fall.velocity_nd[0, 0] > 0.1
            continue
        rest = pm.settle(scene, force_tolerance=1e-8)
        found = scene.replace(packing=rest.packing)
        touch, forces = pm.wall_contacts(found), pm.contact_forces(found)
        assert rest.outcome is pm.Outcome.CONVERGED
        assert touch.force_w == pytest.approx([math.cos(angle)], rel=1e-7)
        assert np.linalg.norm(touch.tangential_wd) == pytest.approx(math.sin(angle), rel=1e-6)
        assert touch.on_walls() == pytest.approx([0.0, 0.0, -1.0], abs=1e-7)
        assert forces.residual < 1e-7 and not forces.rattlers_n.any()


def groove(half, **across):
    """Return two triangles that meet at an edge along y, below, either turned by an angle out of the vertical."""
    s, c = 40.0 * math.sin(half), 40.0 * math.cos(half)
    at = [[4.0, -40.0, 1.0], [4.0, 48.0, 1.0], [4.0 - s, 4.0, 1.0 + c], [4.0 + s, 4.0, 1.0 + c]]
    return pm.MeshWalls(at, [[0, 1, 2], [0, 1, 3]], LAW, 5.0, **across)


def test_a_ball_that_was_pressed_into_a_groove_is_held_there_by_friction():
    """It rises by w until pushes and springs, 2 N sin a = 2 T cos a + m g, balance: N falls, T grows with w."""
    half, depth, spring = math.radians(15.0), 0.01, 500.0
    height = 1.0 + (0.5 - depth) / math.sin(half)
    scene = pm.Scene(
        balls([[4.0, 4.0, height]]), (PAIRS, groove(half, friction=pm.Friction(1.0, spring, 10.0)), WEIGHT)
    )
    s, c = math.sin(half), math.cos(half)
    rise = (4e3 * depth * s - 1.0) / (4e3 * s * s + 2.0 * spring * c * c)
    coarse, fine = (pm.simulate(scene, duration=4.0, dt=dt).packing for dt in (1e-3, 5e-4))
    # stretches are summed up to second order in the time step
    limit = (4.0 * fine.position_nd[0] - coarse.position_nd[0]) / 3.0
    assert limit == pytest.approx([4.0, 4.0, height + rise], rel=1e-10)
    touch, risen = pm.wall_contacts(scene.replace(packing=fine)), fine.position_nd[0, 2] - height
    assert touch.force_w == pytest.approx([2e3 * (depth - risen * s)] * 2, rel=1e-10)
    across = np.linalg.norm(touch.tangential_wd, axis=1)
    assert across == pytest.approx([spring * rise * c] * 2, rel=1e-3) and across.max() < 0.5 * touch.force_w.min()
    assert touch.on_walls() == pytest.approx([0.0, 0.0, -1.0], abs=1e-10)
    # without friction it leaves
    smooth = scene.replace(effects=(PAIRS, groove(half), WEIGHT))
    assert pm.simulate(smooth, steps=2000, dt=1e-3).packing.position_nd[0, 2] > height + 10.0 * rise


def test_a_ball_that_slides_along_a_groove_rolls_about_the_chord_of_its_two_contacts():
    """With normals 45 degrees from the vertical v = v0 / (1 + I / (m a^2 cos^2)) at last.

    But for what springs turn with the spin about the normals before they slide, less the stiffer they are.
    """
    half = math.radians(45.0)
    depth = 1.0 / (2.0 * math.cos(half)) / 2e3
    arm = 0.5 - depth
    place = [4.0, 2.0, 1.0 + arm / math.sin(half)]
    scene = pm.Scene(balls([place]), (PAIRS, groove(half, friction=FRICTION), WEIGHT))
    run = pm.simulate(scene, steps=4000, dt=1e-3, velocity_nd=[[0.0, 1.0, 0.0]])
    rolling = 1.0 / (1.0 + 0.1 / (arm * math.cos(half)) ** 2)
    assert run.velocity_nd[0] == pytest.approx([0.0, rolling, 0.0], rel=1e-5, abs=1e-7)
    assert run.spin_nk[0] == pytest.approx([-rolling / (arm * math.cos(half)), 0.0, 0.0], rel=1e-5, abs=1e-7)


def test_energy_is_kept_to_second_order_by_springs_that_turn_over_an_edge_and_a_corner():
    corner = np.array(list(itertools.product((3.0, 5.0), repeat=3)))
    faces = []
    for axis, side in itertools.product(range(3), (3.0, 5.0)):
        four = np.flatnonzero(corner[:, axis] == side)
        faces += [four[[0, 1, 2]], four[[1, 3, 2]]]
    mesh = pm.MeshWalls(corner, faces, LAW, friction=pm.Friction(1e9, 300.0))
    place = [[5.34, 4.0, 5.34], [5.27, 5.27, 5.27]]
    for at, velocity in zip(place, ([-0.5, 0.7, 0.4], [0.5, -0.6, -0.4]), strict=True):
        scene, errors = pm.Scene(balls([at]), (PAIRS, mesh)), []
        for dt in (1e-3, 5e-4):
            run = pm.simulate(
                scene, duration=0.02, dt=dt, trace_every=1, velocity_nd=[velocity], spin_nk=[[3.0, -2.0, 4.0]],
                check=False,
            )  # fmt: skip
            whole = run.trace.energy_t + run.trace.kinetic_t
            assert run.trace.tangential_t.max() > 1e-3 * whole[0]
            errors.append(np.abs(whole - whole[0]).max())
        assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize("facets", [20, 60])
def test_the_account_of_balls_in_a_drum_closes(facets):
    packing, start = many(3.0)
    scene = pm.Scene(
        packing, (PAIRS, pm.ContactDamping(2.0), FRICTION, drum(facets, friction=FRICTION), pm.Gravity(0.0, 0.0, -5.0))
    )
    run = pm.simulate(scene, steps=3000, dt=1e-3, ledger=True, **start)
    ledger = run.ledger
    assert ledger.residual < 1e-12
    assert len(run.packing.tangential.at_wall_w) > 2


@functools.cache
def on_hills():
    """Return balls on hills with everything, and how they start."""
    packing, start = many(3.4)
    return pm.Scene(packing, (PAIRS, hills(**EVERYTHING), pm.Gravity(0.0, 0.0, -5.0))), start


def test_a_run_that_was_cut_ends_with_the_same_bits_on_any_number_of_threads(tmp_path):
    scene, start = on_hills()
    how = {"dt": 5e-4, **start}
    whole = pm.simulate(scene, steps=2000, **how)
    both = pm.simulate(scene, steps=2000, threads=2, **how)
    pm.simulate(scene, steps=1300, checkpoint=tmp_path / "run.npz", **how)
    cut = pm.resume(tmp_path / "run.npz", scene, steps=2000)
    for one in (both, cut):
        assert np.array_equal(one.velocity_nd, whole.velocity_nd) and one.packing == whole.packing
    assert len(whole.packing.tangential.at_wall_w) > 3


def test_the_account_of_springs_on_hills_closes_and_the_account_changes_no_bit():
    scene, start = on_hills()
    how = {"dt": 5e-4, "steps": 2000, **start}
    run = pm.simulate(scene, ledger=True, **how)
    assert run.ledger.residual < 1e-12
    assert np.array_equal(run.velocity_nd, pm.simulate(scene, **how).velocity_nd)


def test_forces_torques_and_energy_at_rest_are_those_that_time_steps_begin_with():
    scene, start = on_hills()
    end = pm.simulate(scene, steps=1700, dt=5e-4, **start).packing
    scene = scene.replace(packing=end)
    engine = build_engine(scene, dt=5e-4, velocity_nd=np.zeros_like(end.position_nd))
    row = engine.observe()
    push = np.empty_like(engine.state.push)
    push[engine.order_n] = engine.state.push
    at = end.tangential.at_wall_w
    assert np.abs(push[at, 3:]).max() > 1e-3 * np.abs(push).max()
    found = np.concatenate([pm.forces(scene), pm.torques(scene)], axis=1)
    assert np.abs(found - push).max() < 1e-12 * np.abs(push).max()
    assert pm.energy(scene) == pytest.approx(row[POTENTIAL] + row[TANGENTIAL], rel=1e-12)
    touch = pm.wall_contacts(scene)
    assert set(at) == set(touch.particle_w)
    weight, pairs = 5.0 * len(push), pm.contact_forces(scene).force_cd
    assert pairs.shape[1] == 3
    assert -touch.on_walls() + [0.0, 0.0, -weight] == pytest.approx(push[:, :3].sum(axis=0), abs=1e-9)


@pytest.mark.parametrize("friction", [None, FRICTION])
def test_a_surface_leaves_rattlers_as_the_same_flat_wall_does(friction):
    place = [[2.0, 2.0, 1.45], [2.9, 2.0, 1.45], [6.0, 6.0, 1.45]]
    plane = pm.MeshWalls([[0, 0, 1], [8, 0, 1], [0, 8, 1], [8, 8, 1]], [[0, 1, 2], [1, 3, 2]], LAW, friction=friction)
    rough = () if friction is None else (friction,)
    found = []
    for wall in (plane, pm.Walls(2, 1.0, 7.5, LAW, friction=friction)):
        scene = pm.Scene(balls(place), (PAIRS, *rough, wall))
        found.append(pm.contact_forces(scene).rattlers_n.tolist())
    assert found[0] == found[1] == [True] * 3


def test_more_places_than_there_are_springs_for_end_a_run_by_name():
    """A ball on the tip of a cone of twenty facets."""
    angle = 2.0 * np.pi * np.arange(20) / 20
    at = np.concatenate(
        [[[4.0, 4.0, 1.0]], np.column_stack([4 + 3 * np.cos(angle), 4 + 3 * np.sin(angle), angle * 0 + 4])]
    )
    cone = pm.MeshWalls(
        at, [[0, 1 + k, 1 + (k + 1) % 20] for k in range(20)], LAW, pm.Restitution(0.5), friction=FRICTION
    )
    scene = pm.Scene(balls([[4.0, 4.0, 1.9]]), (PAIRS, cone, WEIGHT))
    run = pm.simulate(scene, steps=3000, dt=1e-3, check=False)
    assert run.outcome is pm.Outcome.TOO_MANY_TOUCHES and not run.ok
    assert pm.settle(scene, force_tolerance=1e-6, check=False).outcome is pm.Outcome.TOO_MANY_TOUCHES
    smooth = scene.replace(effects=(PAIRS, pm.MeshWalls(cone.vertices, cone.triangles, LAW), WEIGHT))
    assert len(pm.wall_contacts(pm.Scene(balls([[4.0, 4.0, 1.7]]), smooth.effects))) == 20


def test_surfaces_with_friction_are_refused_by_name_where_springs_are_not_known(tmp_path):
    mesh = floor(**EVERYTHING)
    scene = pm.Scene(balls([[1.0, 3.1, 1.0 + ARM]]), (PAIRS, mesh))
    with pytest.raises(ValueError, match="smooth walls for pm.quench, which knows no rough ones, got MeshWalls"):
        pm.quench(scene, force_tolerance=1e-9)
    with pytest.raises(ValueError, match="friction must be Friction"):
        floor(friction=0.3)
    with pytest.raises(ValueError, match="rolling must be RollingResistance"):
        floor(rolling=pm.Friction(0.3))
    with pytest.raises(ValueError, match="coefficient must not be negative"):
        scene.replace(effects=(PAIRS, floor(friction=pm.Friction(-0.1))))
    pm.write_scene(scene, tmp_path / "scene.toml")
    assert pm.read_scene(tmp_path / "scene.toml") == scene
