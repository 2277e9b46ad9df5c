"""Facts about walls of triangles: distances, energies and their derivatives, motion on them, files of surfaces."""

import itertools
import math
import struct

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.triangles import CORNER, EDGE, FACE, first_near, next_near, touch_of_triangle
from packmech.effects import single_terms

LAW = pm.Hertz(100.0)
PAIRS = pm.Repulsion(pm.Hertz(100.0))


def cube(low=1.0, high=5.0):
    """Return the corners of a cube and its twelve triangles."""
    corner = np.array(list(itertools.product((low, high), repeat=3)))
    faces = []
    for axis, side in itertools.product(range(3), (low, high)):
        four = np.flatnonzero(corner[:, axis] == side)
        faces += [four[[0, 1, 2]], four[[1, 3, 2]]]
    return corner, np.array(faces)


def floor(shift=(0.0, 0.0)):
    """Return a plane at z = 1 of triangles of all sizes."""
    x = np.concatenate([[-1.0], np.sort(np.random.default_rng(3).uniform(0.0, 6.0, 9)), [7.0]])
    at = np.array([[u + shift[0], v + shift[1], 1.0] for u in x for v in x])
    n = len(x)
    first = np.array([i * n + j for i in range(n - 1) for j in range(n - 1)])
    one = np.column_stack([first, first + 1, first + n])
    return at, np.concatenate([one, np.column_stack([first + 1, first + n + 1, first + n])])


def hills():
    """Return a surface with ridges, peaks, grooves and pits."""
    rng = np.random.default_rng(5)
    x = np.linspace(0.0, 6.0, 6)
    at = np.array([[u, v, 2.0 + rng.uniform(-0.6, 0.6)] for u in x for v in x])
    n = len(x)
    first = np.array([i * n + j for i in range(n - 1) for j in range(n - 1)])
    one = np.column_stack([first, first + 1, first + n])
    return at, np.concatenate([one, np.column_stack([first + 1, first + n + 1, first + n])])


def balls(place_nd, radius=0.5):
    place_nd = np.atleast_2d(place_nd)
    return pm.Packing(place_nd, [radius] * len(place_nd), pm.Box.cubic(6.0, 3), mass_n=[1.0] * len(place_nd))


def terms(effect, place_nd, radius=0.5):
    found = single_terms((effect,), balls(place_nd, radius))
    return found.energy_n, found.force_nd, found.second_ndd


def parts(mesh, place, radius=0.5):
    """Return what of the surface a sphere touches."""
    rows, found = mesh.rows.triangles, []
    near = first_near(rows, *place, radius)
    while near.number >= 0:
        touch = touch_of_triangle(rows, near)
        found += [touch.part] if touch.touches else []
        near = next_near(rows, near)
    return found


def test_a_plane_of_triangles_is_a_flat_wall_over_faces_edges_and_corners():
    at, triangles = floor()
    mesh, wall = pm.MeshWalls(at, triangles, LAW), pm.Walls(2, 1.0, 5.9, LAW)
    rng = np.random.default_rng(1)
    height = 1.5 - rng.uniform(0.001, 0.2, 200)
    inside = at[(at[:, :2] > 0.0).all(axis=1) & (at[:, :2] < 6.0).all(axis=1)]
    corner_tcd = at[triangles]
    edge = corner_tcd[:, [0, 1, 2]] * 0.3 + corner_tcd[:, [1, 2, 0]] * 0.7
    edge = edge.reshape(-1, 3)
    edge = edge[(edge[:, :2] > 0.0).all(axis=1) & (edge[:, :2] < 6.0).all(axis=1)]
    for place in (rng.uniform(0.0, 6.0, (200, 3)), inside[:60], edge[:200]):
        above = place.copy()
        above[:, 2] = height[: len(place)]
        for one, other in zip(terms(mesh, above), terms(wall, above), strict=True):
            assert np.abs(one - other).max() < 1e-12 * np.abs(other).max()


def test_a_cube_from_outside_is_as_far_as_the_nearest_place_in_it():
    mesh = pm.MeshWalls(*cube(2.0, 4.0), LAW)
    place = np.random.default_rng(2).uniform(1.4, 4.6, (3000, 3))
    away = np.linalg.norm(place - np.clip(place, 2.0, 4.0), axis=1)
    place, away = place[away > 0.05], away[away > 0.05]
    energy = terms(mesh, place)[0]
    exact = 0.5 * np.array([LAW.energy(2.0 * d, 1.0) if d < 0.5 else 0.0 for d in away])
    assert np.abs(energy - exact).max() < 1e-12 * exact.max()
    touched = {part for one in place[:300] for part in parts(mesh, one)}
    assert touched == {FACE, EDGE, CORNER}
    assert max(len(parts(mesh, one)) for one in place[:300]) == 1


def test_a_cube_from_inside_pushes_with_each_of_its_faces():
    mesh = pm.MeshWalls(*cube(), LAW)
    walls = [pm.Walls(axis, 1.0, 5.0, LAW) for axis in range(3)]
    place = np.random.default_rng(2).uniform(1.3, 4.7, (500, 3))
    whole = [sum(one) for one in zip(*(terms(wall, place) for wall in walls), strict=True)]
    for one, other in zip(terms(mesh, place), whole, strict=True):
        assert np.abs(one - other).max() < 1e-12 * np.abs(other).max()
    assert max(len(parts(mesh, one)) for one in place[:100]) >= 2


def test_forces_and_second_derivatives_are_those_of_the_energy():
    mesh = pm.MeshWalls(*hills(), LAW)
    rng = np.random.default_rng(4)
    place = np.column_stack([rng.uniform(0.7, 5.3, (150, 2)), np.zeros(150)])
    # lowered until they touch
    for k in range(len(place)):
        height = next(z for z in np.arange(3.6, 1.0, -0.02) if parts(mesh, [*place[k, :2], z]))
        place[k, 2] = height - 0.005
    _, force, second = terms(mesh, place)
    h = 1e-6
    for a in range(3):
        step = np.zeros(3)
        step[a] = h
        up, down = terms(mesh, place + step), terms(mesh, place - step)
        slope = (up[0] - down[0]) / (2.0 * h)
        assert np.abs(slope + force[:, a]).max() < 1e-7 * np.abs(force).max()
        bend = -(up[1] - down[1]) / (2.0 * h)
        # where no contact begins or ends within the difference
        near = np.abs(bend - second[:, a]).max(axis=1) / np.abs(second).max()
        assert np.quantile(near, 0.95) < 1e-5
    touched = {part for one in place for part in parts(mesh, one)}
    assert touched == {FACE, EDGE, CORNER}


def test_no_sphere_sees_an_edge_that_it_slides_over():
    at, triangles = floor()
    scene = pm.Scene(balls([[0.5, 3.1, 1.45]]), (PAIRS, pm.MeshWalls(at, triangles, LAW), pm.Gravity(0.0, 0.0, -1.0)))
    run = pm.simulate(scene, duration=4.0, velocity_nd=[[1.2, 0.1, 0.0]], trace_every=1, trace_positions=True)
    velocity = run.trace.velocity_tnd[:, 0]
    assert np.abs(velocity[:, :2] - [1.2, 0.1]).max() < 1e-13
    flat = scene.replace(effects=(PAIRS, pm.Walls(2, 1.0, 5.9, LAW), pm.Gravity(0.0, 0.0, -1.0)))
    other = pm.simulate(flat, steps=run.steps, dt=run.dt, velocity_nd=[[1.2, 0.1, 0.0]])
    assert run.packing.position_nd == pytest.approx(other.packing.position_nd, abs=1e-10)


def test_a_sphere_comes_to_rest_in_the_corner_that_its_weight_points_to():
    """At each of three faces F = (energy_scale / sigma) xi^(3/2) balances a component of the weight."""
    mesh, pull = pm.MeshWalls(*cube(), LAW), (-0.3, -0.5, -1.0)
    scene = pm.Scene(balls([[2.0, 1.7, 1.6]]), (PAIRS, mesh, pm.Gravity(*pull)))
    run = pm.quench(scene, force_tolerance=1e-12)
    depth = (-np.array(pull) / 100.0) ** (2.0 / 3.0)
    assert run.packing.position_nd[0] == pytest.approx(1.0 + 0.5 * (1.0 - depth), rel=1e-11)
    scene = scene.replace(packing=run.packing)
    assert np.abs(pm.forces(scene)).max() < 1e-11
    weight = run.packing.position_nd[0] @ -np.array(pull)
    assert pm.energy(scene) == pytest.approx(0.5 * sum(LAW.energy(1.0 - d, 1.0) for d in depth) + weight, rel=1e-12)


def test_energy_is_kept_to_second_order_by_spheres_that_fly_about_in_a_box_of_triangles():
    place = np.array([[2.0, 2.1, 2.2], [3.6, 3.5, 2.4], [2.4, 3.7, 3.8]])
    scene = pm.Scene(balls(place), (PAIRS, pm.MeshWalls(*cube(), LAW), pm.Gravity(0.0, 0.0, -1.0)))
    start = np.array([[2.0, 1.0, 1.4], [-1.6, 0.6, 2.0], [0.4, -2.2, 0.8]])
    errors = []
    for dt in (4e-3, 2e-3):
        run = pm.simulate(scene, duration=3.0, dt=dt, velocity_nd=start, trace_every=1)
        whole = run.trace.energy_t + run.trace.kinetic_t
        errors.append(np.abs(whole - whole[0]).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    assert not np.allclose(run.velocity_nd[:, :2], start[:, :2])


def test_restitution_is_that_of_a_flat_wall():
    at, triangles = floor()
    mesh = pm.MeshWalls(at, triangles, LAW, pm.Restitution(0.6))
    run = pm.simulate(
        pm.Scene(balls([[3.0, 3.1, 1.6]]), (PAIRS, mesh)), duration=2.0, dt=5e-4, velocity_nd=[[0.3, 0.0, -0.5]]
    )
    assert run.velocity_nd[0] == pytest.approx([0.3, 0.0, 0.3], rel=2e-3, abs=1e-12)


def stl(path, corner_tcd):
    """Write triangles as a binary STL file."""
    with path.open("wb") as file:
        file.write(b"made by a test".ljust(80, b" ") + struct.pack("<I", len(corner_tcd)))
        for corner_cd in corner_tcd:
            file.write(struct.pack("<12fH", 0.0, 0.0, 0.0, *corner_cd.ravel(), 0))


def test_a_surface_is_read_from_a_file_with_its_corners_joined(tmp_path):
    corner, triangles = cube()
    stl(tmp_path / "cube.stl", corner[triangles])
    lines = [f"v {x} {y} {z}" for x, y, z in corner] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles]
    (tmp_path / "cube.obj").write_text("\n".join(lines))
    for name in ("cube.stl", "cube.obj"):
        mesh = pm.read_mesh(tmp_path / name, scale=0.5)
        assert mesh.vertices.shape == (8, 3) and mesh.triangles.shape == (12, 3)
        assert np.array_equal(0.5 * corner[triangles], mesh.vertices[mesh.triangles])
    with pytest.raises(FileNotFoundError, match="path must name an existing file"):
        pm.read_mesh(tmp_path / "none.stl")
    (tmp_path / "bad.stl").write_text("no surface")
    with pytest.raises(ValueError, match="path must name a file of triangles"):
        pm.read_mesh(tmp_path / "bad.stl")


def test_scene_files_hold_surfaces(tmp_path):
    scene = pm.Scene(balls([[2.0, 1.7, 1.6]]), (PAIRS, pm.MeshWalls(*cube(), LAW, pm.Restitution(0.5))))
    pm.write_scene(scene, tmp_path / "scene.toml")
    assert pm.read_scene(tmp_path / "scene.toml") == scene


def test_spheres_meet_a_surface_where_they_are_across_the_edge_of_the_cell_too():
    """Two halves of a run are the whole, and energies are those of the run; an image would be at the wall."""
    wall = pm.MeshWalls([[1, 0, 0], [1, 8, 0], [1, 0, 8], [1, 8, 8]], [[0, 1, 2], [1, 3, 2]], LAW)
    start = pm.Packing([[6.0, 4.0, 4.0]], [0.5], pm.Box.cubic(8.0, 3), mass_n=[1.0])
    scene, velocity = pm.Scene(start, (PAIRS, wall)), [[0.1, 0.0, 0.0]]
    half = pm.simulate(scene, duration=27.0, velocity_nd=velocity)
    after = scene.replace(packing=half.packing)
    assert half.packing.position_nd[0, 0] == pytest.approx(8.7, rel=1e-12)
    assert pm.energy(after) == 0.0 and not pm.forces(after).any()
    rest = pm.simulate(after, duration=10.0, velocity_nd=half.velocity_nd)
    assert rest.packing.position_nd[0] == pytest.approx([9.7, 4.0, 4.0], rel=1e-12)
    assert pm.quench(after, force_tolerance=1e-10).packing.position_nd[0, 0] == pytest.approx(8.7, rel=1e-12)


def test_surfaces_refuse_tables_by_kinds_as_flat_walls_do():
    soft, hard = pm.Hertz(1.0), pm.Hertz(9.0)
    by_kind = pm.LawByKind([[soft, hard], [hard, hard]])
    packing = balls([[2.0, 1.7, 1.6]]).replace(kind_n=[1])
    for given in ({"law": by_kind}, {"law": LAW, "damping": pm.Restitution(pm.ByKind([[0.5, 0.6], [0.6, 0.7]]))}):
        with pytest.raises(ValueError, match=r"effects\[1\]\..* must not differ by kinds"):
            pm.Scene(packing, (PAIRS, pm.MeshWalls(*cube(), **given)))


def test_what_surfaces_are_not_for_is_refused_by_name():
    mesh = pm.MeshWalls(*cube(), LAW)
    discs = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(6.0, 2))
    with pytest.raises(ValueError, match=r"effects\[1\] must be no MeshWalls for discs"):
        pm.Scene(discs, (PAIRS, mesh))
    with pytest.raises(ValueError, match="pm.normal_modes would ignore, got MeshWalls"):
        pm.normal_modes(pm.Scene(balls([[2.0, 1.7, 1.6]]), (PAIRS, mesh)), 1)
    with pytest.raises(ValueError, match="triangles must have an area, got none of number 1"):
        pm.MeshWalls([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3]])
    with pytest.raises(ValueError, match="triangles must name vertices below 3"):
        pm.MeshWalls([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 3]])
    rough = (PAIRS, pm.Friction(0.3))
    with pytest.raises(
        ValueError, match=r"effects\[2\].friction of MeshWalls must be given where contacts have Friction"
    ):
        pm.Scene(balls([[2.0, 1.7, 1.6]]), (*rough, mesh))
    with pytest.raises(
        ValueError, match=r"effects\[3\].rolling of MeshWalls must be given where contacts have Rolling"
    ):
        rolls = (*rough, pm.RollingResistance(0.1))
        pm.Scene(balls([[2.0, 1.7, 1.6]]), (*rolls, pm.MeshWalls(*cube(), LAW, friction=pm.Friction(0.3))))
    assert pm.Scene(balls([[2.0, 1.7, 1.6]]), (*rough, pm.MeshWalls(*cube(), LAW, friction=pm.Friction(0.0))))
    with pytest.raises(ValueError, match=r"effects\[1\].damping must not be negative"):
        pm.Scene(balls([[2.0, 1.7, 1.6]]), (PAIRS, pm.MeshWalls(*cube(), LAW, damping=-1.0)))
