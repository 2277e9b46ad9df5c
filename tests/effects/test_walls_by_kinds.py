"""Facts about walls that differ by the kind of the particle that touches them: each kind has walls of its own."""

import math

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.dynamics.integrators import choose_time_step

SOFT, HARD = pm.LinearSpring(100.0), pm.LinearSpring(400.0)
PAIRS = pm.Repulsion(SOFT)
SMOOTH = pm.Walls(1, 0.0, 9.0, pm.LawPerKind([SOFT, HARD]), pm.Restitution(pm.PerKind([0.9, 0.4])))
ROUGH = SMOOTH._replace(
    friction=pm.Friction(pm.PerKind([0.1, 0.5]), pm.Mindlin(pm.PerKind([0.1, 0.4])), pm.DampingRatio(1.0))
)
# a disc of each kind, at one height and out of each other's reach
BOTH = pm.Packing([[2.0, 1.0], [7.0, 1.0]], [0.5, 0.5], pm.Box.cubic(10.0, 2), kind_n=[0, 1], mass_n=[1.0, 2.0])

TILTED = pm.Spheroids([1.5, 1.8], [[math.cos(angle), math.sin(angle)] for angle in (0.3, 0.8)])


def alone(packing, n):
    """Return one particle of a packing without its kind."""
    kept = np.arange(packing.particles) == n
    return pm.Packing(
        packing.position_nd[kept], packing.radius_n[kept], packing.box, mass_n=packing.mass_n[kept],
        shapes=packing.shapes.select(kept) if packing.shapes.has_orientations else None,
    )  # fmt: skip


def test_each_kind_rebounds_with_its_own_restitution():
    run = pm.simulate(
        pm.Scene(BOTH, (PAIRS, SMOOTH)), duration=1.2, dt=2e-4, velocity_nd=[[0.0, -1.0]] * 2, check=False
    )
    assert run.velocity_nd[:, 1] == pytest.approx([0.9, 0.4], rel=1e-3)


@pytest.mark.parametrize("wall", [SMOOTH, ROUGH], ids=["smooth", "rough"])
def test_each_kind_moves_as_it_does_alone_between_its_own_walls(wall):
    """Two discs that never meet, one run of both and one of each."""
    start = {"steps": 1200, "dt": 1e-3, "check": False, "ledger": True}
    velocity, gravity = np.array([[1.0, -1.0], [0.7, -1.3]]), pm.Gravity(0.0, -2.0)
    run = pm.simulate(pm.Scene(BOTH, (PAIRS, gravity, wall)), velocity_nd=velocity, **start)
    assert run.ledger.closed and run.ledger.residual < 1e-10
    for n in (0, 1):
        scene = pm.Scene(alone(BOTH, n), (PAIRS, gravity, wall.of(n)))
        own = pm.simulate(scene, velocity_nd=velocity[n : n + 1], **start)
        np.testing.assert_allclose(run.packing.position_nd[n], own.packing.position_nd[0], rtol=1e-13)
        np.testing.assert_allclose(run.velocity_nd[n], own.velocity_nd[0], rtol=1e-11)
        now, then = pm.Scene(run.packing, (PAIRS, gravity, wall)), scene.replace(packing=own.packing)
        np.testing.assert_allclose(pm.forces(now)[n], pm.forces(then)[0], rtol=1e-9, atol=1e-12)


def test_a_lid_that_holds_a_stress_is_pushed_by_each_kind_as_its_law_says():
    """At rest the overlaps of a soft and a hard disc of one size bear together what the lid holds."""
    packing = BOTH.replace(position_nd=[[2.0, 0.5], [7.0, 0.5]])
    lid = pm.WallMotion(y=pm.HeldStress(-0.5, inertia=1.0))
    walls = SMOOTH._replace(high=1.0, damping=pm.PerKind([4.0, 8.0]), high_motion=lid)
    run = pm.simulate(pm.Scene(packing, (PAIRS, walls)), duration=60.0, check=False)
    gap = run.walls.place_tf[-1, 1]
    # each disc is pressed d/2 deep into both walls, 2 k (d/2) at each, and the box is 10 wide
    assert run.walls.steady_fd.all()
    assert (1.0 - gap) * (100.0 + 400.0) == pytest.approx(5.0, rel=1e-6)


def test_a_kind_rests_where_its_own_law_bears_its_weight():
    scene = pm.Scene(BOTH, (PAIRS, pm.Gravity(0.0, -1.0), SMOOTH))
    run = pm.quench(scene, force_tolerance=1e-10, check=False)
    assert run.packing.position_nd[:, 1] == pytest.approx([0.5 - 1.0 / 200.0, 0.5 - 2.0 / 800.0], abs=1e-10)
    found = pm.wall_contacts(scene.replace(packing=run.packing))
    assert found.particle_w.tolist() == [0, 1]
    assert found.force_w == pytest.approx([1.0, 2.0], rel=1e-8)
    assert pm.energy(scene.replace(packing=run.packing, effects=(PAIRS, SMOOTH))) == pytest.approx(
        0.5 * 1.0 / 200.0 + 0.5 * 4.0 / 800.0, rel=1e-7
    )
    modes = pm.normal_modes(scene.replace(packing=run.packing), rattlers="keep")
    # both slide along the walls for nothing, one against the other
    assert modes.eigenvalue_m == pytest.approx([0.0, 200.0, 800.0 / 2.0], abs=1e-9)


def test_each_kind_is_braked_by_its_own_coefficient():
    """Sliding discs at rest across the floor lose the speed mu g t, until they roll."""
    height = np.array([[2.0, 0.5 - 1.0 / 200.0], [5.0, 0.5 - 2.0 / 800.0]])
    wall = ROUGH._replace(friction=ROUGH.friction._replace(damping=0.0))
    scene = pm.Scene(BOTH.replace(position_nd=height), (PAIRS, pm.Gravity(0.0, -1.0), wall))
    run = pm.simulate(scene, duration=0.5, dt=1e-4, velocity_nd=[[1.0, 0.0]] * 2, check=False)
    early = pm.simulate(scene, duration=0.25, dt=1e-4, velocity_nd=[[1.0, 0.0]] * 2, check=False)
    lost = early.velocity_nd[:, 0] - run.velocity_nd[:, 0]
    assert lost == pytest.approx([0.25 * 0.1, 0.25 * 0.5], rel=1e-6)
    across = pm.wall_contacts(scene.replace(packing=run.packing))
    assert across.tangential_wd[:, 0] == pytest.approx([-0.1, -0.5 * 2.0], rel=1e-6)


def test_rows_with_one_entry_again_and_again_are_the_plain_walls_bit_for_bit():
    packing = pm.random_packing(24, dimension=2, packing_fraction=0.6, seed=3).replace(kind_n=[0, 1, 2] * 8)
    side = float(packing.box.lattice_dd[0, 0])
    box = pm.Box(np.diag([side, 1.5 * side]))
    packing = packing.replace(box=box, position_nd=packing.position_nd % side)
    plain = pm.Walls(1, 0.3, side - 0.3, HARD, pm.Restitution(0.7), pm.Friction(0.3, pm.Mindlin(0.2)))
    rows = plain._replace(
        law=pm.LawPerKind([HARD] * 3),
        damping=pm.Restitution(pm.PerKind([0.7] * 3)),
        friction=pm.Friction(pm.PerKind([0.3] * 3), pm.Mindlin(pm.PerKind([0.2] * 3))),
    )
    velocity = np.random.default_rng(1).normal(size=(24, 2))
    scenes = [pm.Scene(packing, (PAIRS, pm.Friction(0.2), walls)) for walls in (plain, rows)]
    one, other = (pm.simulate(scene, steps=200, dt=1e-3, velocity_nd=velocity, check=False) for scene in scenes)
    assert np.array_equal(one.packing.position_nd, other.packing.position_nd)
    assert np.array_equal(one.velocity_nd, other.velocity_nd)
    assert one.packing.tangential == other.packing.tangential
    first, second = (pm.contact_forces(scene.replace(packing=one.packing)) for scene in scenes)
    assert np.array_equal(first.force_nd, second.force_nd) and np.array_equal(first.torque_nk, second.torque_nk)
    assert np.array_equal(first.rattlers_n, second.rattlers_n)


def test_the_time_step_is_that_of_the_stiffest_kind():
    stiff = pm.LinearSpring(1e6)
    scene = pm.Scene(BOTH, (PAIRS, pm.Walls(1, 0.0, 9.0, pm.LawPerKind([SOFT, stiff]))))
    dt, soft, hard = (
        choose_time_step(scene.replace(effects=(PAIRS, wall)), 0.1)
        for wall in (scene.effects[1], scene.effects[1].of(0), scene.effects[1].of(1))
    )
    assert dt == hard < 0.1 * soft
    # of the kinds that there are
    assert choose_time_step(scene.replace(packing=BOTH.replace(kind_n=[0, 0])), 0.1) == soft


def packed(coefficient=(1e6, 2e6)):
    """Return discs of two kinds pressed against rough walls and each other, springs stretched; nothing slides."""
    packing = pm.random_packing(12, dimension=2, packing_fraction=0.6, seed=3).replace(kind_n=[0, 1] * 6)
    side = float(packing.box.lattice_dd[0, 0])
    packing = packing.replace(box=pm.Box(np.diag([side, 1.5 * side])), position_nd=packing.position_nd % side)
    reach = float(packing.radius_n.max())
    friction = pm.Friction(pm.PerKind(coefficient), 300.0)
    walls = pm.Walls(1, 0.6 * reach, side - 0.6 * reach, pm.LawPerKind([SOFT, pm.LinearSpring(1e3)]), friction=friction)
    scene = pm.Scene(packing, (PAIRS, pm.Friction(1e6, 300.0), walls))
    rng = np.random.default_rng(7)
    run = pm.simulate(
        scene, steps=20, dt=1e-3, check=False, velocity_nd=rng.normal(size=(12, 2)), spin_nk=rng.normal(size=(12, 1))
    )
    kinds = packing.kind_n[run.packing.tangential.at_wall_w]
    assert set(kinds) == {0, 1}
    return scene.replace(packing=run.packing)


def pushes(scene, motion_nq, step):
    """Return the engine's forces and torques after one small step of particles too heavy to be moved by them."""
    n, d = scene.packing.position_nd.shape
    heavy = scene.replace(packing=scene.packing.replace(mass_n=np.full(n, 1e14)))
    engine = build_engine(heavy, dt=step, velocity_nd=motion_nq[:, :d], spin_nk=motion_nq[:, d:], second_order=False)
    engine.advance(1)
    push = np.empty_like(engine.state.push)
    push[engine.order_n] = engine.state.push
    return push


def test_the_stiffness_is_the_derivative_of_the_engines_forces_and_torques():
    scene, step = packed(), 1e-5
    motion = np.random.default_rng(5).normal(size=(12, 3))
    scale = np.ones_like(motion)
    scale[:, 2:] = scene.packing.shapes.gyration(scene.packing.radius_n)[:, None]
    ahead, behind = (pushes(scene, sign * motion, step) for sign in (1.0, -1.0))
    change = (ahead - behind) / (2.0 * step) / scale
    expected = (pm.stiffness_matrix(scene, "none") @ (motion * scale).ravel()).reshape(change.shape)
    assert np.abs(expected + change).max() < 1e-7 * np.abs(change).max()


@pytest.mark.parametrize("shapes", ["discs", "ellipses"])
def test_the_hessian_is_the_derivative_of_forces(shapes):
    if shapes == "discs":
        packing = BOTH.replace(position_nd=[[2.0, 0.45], [2.8, 0.48]])
    else:
        packing = pm.Packing([[2.0, 0.4], [5.0, 0.3]], [0.5, 0.5], BOTH.box, kind_n=[0, 1], shapes=TILTED)
    scene = pm.Scene(packing, (PAIRS, SMOOTH))
    matrix, step = pm.hessian(scene, "none").toarray(), 1e-6
    x = 2 if shapes == "discs" else 3
    for column in range(2):
        for n in range(2):
            moved = np.zeros((2, 2))
            moved[n, column] = step
            ahead, behind = (
                pm.forces(scene.replace(packing=packing.replace(position_nd=packing.position_nd + sign * moved)))
                for sign in (1.0, -1.0)
            )
            own = -matrix[:, n * x + column].reshape(2, x)[:, :2]
            np.testing.assert_allclose((ahead - behind) / (2.0 * step), own, rtol=1e-6, atol=1e-6)


def test_a_kind_without_friction_rattles_between_walls_that_hold_the_other():
    packing = pm.Packing([[5.0, 0.45], [12.0, 0.45]], [0.5] * 2, pm.Box.cubic(20.0, 2), kind_n=[0, 1])
    walls = pm.Walls(1, 0.0, 0.9, SOFT, friction=pm.Friction(pm.PerKind([0.0, 0.3])))
    scene = pm.Scene(packing, (PAIRS, walls))
    assert pm.contact_forces(scene).rattlers_n.tolist() == [True, False]
    stiffness = pm.stiffness_matrix(scene, "none").toarray()
    # of the one without friction the walls feel its height alone
    assert np.flatnonzero(stiffness[:3, :3]).tolist() == [4]
    assert np.count_nonzero(np.diag(stiffness)[3:]) == 3
    assert scene.replace(effects=(PAIRS, walls.of(0))).effects[1].roughness is None


def test_walls_that_differ_by_kinds_say_what_they_lack_and_what_must_not_differ():
    for wrong, said in (
        (BOTH.replace(kind_n=None), r"effects\[1\].law must be the same for all particles of a packing without kinds"),
        (BOTH.replace(kind_n=[0, 2]), r"effects\[1\].law must have an entry .*3, got 2: particle 1 is of kind 2"),
    ):
        with pytest.raises(ValueError, match=said):
            pm.Scene(wrong, (PAIRS, SMOOTH))
    row = pm.PerKind([0.1, 0.2])
    for walls, said in (
        (
            SMOOTH._replace(damping=pm.PerKind([0.1, 0.2, 0.3])),
            r"effects\[0\].damping must be for as many kinds as law",
        ),
        (SMOOTH._replace(rolling=pm.RollingResistance(row)), r"effects\[0\].rolling.coefficient must be the same for"),
        (SMOOTH._replace(friction=pm.Friction(0.1, row)), r"effects\[0\].friction.stiffness must be the same for all"),
        (SMOOTH._replace(low=row), r"effects\[0\].low must be the same for all kinds"),
        (SMOOTH._replace(damping=pm.PerKind([0.1, -0.2])), r"effects\[0\].damping must not be negative, got -0.2"),
        (SMOOTH._replace(law=pm.LawByKind([[SOFT]])), r"effects\[0\].law must be pm.LawPerKind for walls"),
        (SMOOTH._replace(damping=pm.Restitution(pm.ByKind([[0.5]]))), r"damping.coefficient must be pm.PerKind for"),
    ):
        with pytest.raises(ValueError, match=said):
            pm.Scene(BOTH, (walls, PAIRS))
    with pytest.raises(TypeError, match=r"effects\[0\].coefficient must not be PerKind, which walls alone take"):
        pm.Scene(BOTH, (pm.Friction(row), PAIRS))
    with pytest.raises(TypeError, match=r"effects\[0\].law must not be LawPerKind, which walls alone take"):
        pm.Scene(BOTH, (pm.Repulsion(SMOOTH.law),))
    with pytest.raises(TypeError, match="laws must be of one class, LinearSpring, got Harmonic"):
        pm.LawPerKind([SOFT, pm.Harmonic()])
    with pytest.raises(TypeError, match=r"values must be numbers, one for each kind of particles, got 0.3"):
        pm.PerKind(0.3)
    with pytest.raises(ValueError, match="kind must be from 0 to 1, got 2"):
        SMOOTH.of(2)
    with pytest.raises(TypeError, match="law must be that of one kind of particles"):
        SMOOTH.body_energy(0.0, 0.4, 0.0, 1.0, 0.5)


def test_surfaces_of_triangles_do_the_same_to_all_kinds():
    balls = pm.Packing([[1.0] * 3, [3.0] * 3], [0.5] * 2, pm.Box.cubic(4.0, 3), kind_n=[0, 1])
    floor = [[0, 0, 1], [4, 0, 1], [0, 4, 1]], [[0, 1, 2]]
    for wrong, said in (({"law": SMOOTH.law}, "law"), ({"damping": SMOOTH.damping}, "damping.coefficient")):
        with pytest.raises((TypeError, ValueError), match=rf"effects\[1\].{said} must not (differ by kinds|be LawPer)"):
            pm.Scene(balls, (PAIRS, pm.MeshWalls(*floor, **wrong)))


GLASS = pm.Material(young_modulus=7.0, poisson_ratio=0.22, density=2.5, restitution=0.9, friction=0.4)
STEEL = pm.Material(young_modulus=20.0, poisson_ratio=0.3, density=7.8, restitution=0.4, friction=0.9)
WOOD = pm.Material(young_modulus=2.0, poisson_ratio=0.4, density=0.7, restitution=0.5, friction=0.6)
BALLS = pm.Packing([[1.0, 1.0, 0.499], [3.0, 1.0, 0.499]], [0.5] * 2, pm.Box.cubic(4.0, 3), kind_n=[0, 1])


def test_walls_of_a_material_are_to_each_kind_those_of_its_own_material():
    both = pm.Materials((GLASS, STEEL))
    walls = both.walls(BALLS, 2, 0.0, 3.5, of=WOOD)
    for kind, one in enumerate((GLASS, STEEL)):
        assert walls.of(kind) == one.walls(BALLS, 2, 0.0, 3.5, of=WOOD)
    assert pm.Materials((GLASS, GLASS)).walls(BALLS, 2, 0.0, 3.5, of=WOOD) == GLASS.walls(BALLS, 2, 0.0, 3.5, of=WOOD)
    assert pm.Materials((GLASS, STEEL, WOOD)).walls(BALLS, 2, 0.0, 3.5, of=2).of(1) == walls.of(1)
    assert both.walls(BALLS, 2, 0.0, 3.5, of=0).of(0) == GLASS.walls(BALLS, 2, 0.0, 3.5)
    # 1/E* = sum of (1 - nu^2)/E, and the radius of the sphere
    force = pm.forces(pm.Scene(BALLS, (walls,)))[:, 2]
    for kind, one in enumerate((GLASS, STEEL)):
        compliance = sum((1.0 - each.poisson_ratio**2) / each.young_modulus for each in (one, WOOD))
        assert force[kind] == pytest.approx(4.0 / 3.0 / compliance * math.sqrt(0.5) * 0.001**1.5, rel=1e-9)


def test_what_was_measured_of_a_wall_and_a_kind_stands_for_the_means():
    measured = {(0, 2): {"friction": 0.05, "restitution": 0.8, "young_modulus": 3.0}}
    walls = pm.Materials((GLASS, STEEL, WOOD), "min", measured).walls(BALLS, 2, 0.0, 3.5, of=2)
    assert walls.damping.coefficient == pm.PerKind([0.8, 0.4, 0.5])
    assert walls.friction.coefficient == pm.PerKind([0.05, 0.6, 0.6])
    nu = GLASS.mixed(WOOD).poisson_ratio
    assert walls.law.of(0).modulus == pytest.approx(0.5 * 3.0 / (2.0 * (1.0 - nu**2)), rel=1e-12)
    assert walls.of(1) == pm.Materials((GLASS, STEEL), "min").walls(BALLS, 2, 0.0, 3.5, of=WOOD).of(1)
    with pytest.raises(ValueError, match="of must be an integer at least 0 and at most 1, got 2"):
        pm.Materials((GLASS, STEEL)).walls(BALLS, 2, 0.0, 3.5, of=2)
    with pytest.raises(ValueError, match="packing must have kinds for 2 materials, got none"):
        pm.Materials((GLASS, STEEL)).walls(BALLS.replace(kind_n=None), 2, 0.0, 3.5, of=WOOD)
    smooth = pm.Material(1.0), pm.Material(3.0)
    assert pm.Materials(smooth).walls(BALLS, 2, 0.0, 3.5, of=0).friction is None
    rubbing = pm.Materials((pm.Material(1.0, friction=0.3), pm.Material(3.0, friction=0.3)))
    assert rubbing.walls(BALLS, 2, 0.0, 3.5, of=pm.Material(1.0)).friction == pm.Friction(0.0)


SCENE = """
[packing]
kind = "random"
particles = 8
dimension = 3
packing_fraction = 0.3
seed = 1

[kinds]
shares = [0.5, 0.5]
seed = 1

[[material]]
young_modulus = 7.0
restitution = 0.9

[[material]]
young_modulus = 20.0
friction = 0.4

[[effects]]
kind = "walls"
axis = 2
low = -1.0
high = 5.0
"""


def test_scene_files_say_of_which_material_walls_are_or_hold_rows(tmp_path):
    path, materials = (
        tmp_path / "scene.toml",
        pm.Materials((pm.Material(7.0, restitution=0.9), pm.Material(20.0, friction=0.4))),
    )
    path.write_text(SCENE + "material = 1\n")
    scene = pm.read_scene(path)
    due = materials.walls(scene.packing, 2, -1.0, 5.0, of=1)
    assert scene.effects == pm.Scene(scene.packing, (*materials.effects(scene.packing), due)).effects
    assert due.law.of(0) != due.law.of(1) and due.friction.coefficient == pm.PerKind([0.0, 0.4])
    pm.write_scene(scene, tmp_path / "again.toml")
    assert pm.read_scene(tmp_path / "again.toml") == scene
    by_hand = """damping = { kind = "restitution", coefficient = { values = [0.5, 0.7] } }
law = { kind = "law-per-kind", laws = [{ kind = "elastic-spheres", modulus = 1.0 }, { kind = "elastic-spheres" }] }
friction = { coefficient = { values = [0.1, 0.2] } }
"""
    path.write_text(SCENE + by_hand)
    wall = pm.read_scene(path).effects[-1]
    assert wall.damping == pm.Restitution(pm.PerKind([0.5, 0.7]))
    assert wall.law.of(0) == pm.ElasticSpheres(1.0) and wall.friction.coefficient == pm.PerKind([0.1, 0.2])
    path.write_text(SCENE + 'material = 0\ndamping = { kind = "per-kind", values = [0.5, 0.7] }\n')
    assert pm.read_scene(path).effects[-1].damping == pm.PerKind([0.5, 0.7])
    path.write_text(SCENE + "material = 2\n")
    with pytest.raises(ValueError, match=r"effects\[0\].material must name materials by number, from 0 to 1"):
        pm.read_scene(path)
    path.write_text(SCENE)
    with pytest.raises(ValueError, match=r"effects\[0\].law must be given .*, got nothing: say .* material = 0"):
        pm.read_scene(path)
    one = SCENE.replace("[[material]]\nyoung_modulus = 20.0\nfriction = 0.4\n", "").replace(
        "[[material]]", "[material]"
    )
    path.write_text(one + "material = 0\n")
    with pytest.raises(ValueError, match=r"effects\[0\].material must stand beside tables \[\[material\]\], got one"):
        pm.read_scene(path)


@pytest.mark.parametrize("table", [pm.LawByKind, pm.LawPerKind])
def test_laws_of_a_table_or_a_row_are_of_one_class_and_so_are_those_they_hold(table):
    plateau = [pm.PlateauRepulsion(law=one) for one in (pm.Harmonic(1.0), pm.LinearSpring(3.0), pm.Harmonic(2.0))]
    with pytest.raises(TypeError, match="laws must be of one class, PlateauRepulsion of Harmonic, got"):
        table(plateau)
    assert table([plateau[0], plateau[2], plateau[0]])
