"""Facts about materials: contacts are those of their constants, in calls and in scene files."""

import math

import numpy as np
import pytest

import packmech as pm

GLASS = pm.Material(young_modulus=7.0, poisson_ratio=0.22, density=2.5, restitution=0.9, friction=0.4)


@pytest.mark.parametrize("other", [1.0, 1.4, 30.0])
@pytest.mark.parametrize("radius", [0.2, 0.5, 3.0])
def test_spheres_of_any_sizes_repel_and_slide_as_hertz_and_mindlin_have_it(radius, other):
    overlap, slip, both = 1e-3 * radius, 1e-7 * radius, np.array([radius, radius * other])
    place = np.array([[0.0] * 3, [both.sum() - overlap, 0.0, 0.0]])
    springs = pm.TangentialDisplacements([0], [1], [[0] * 3], [[0.0, slip, 0.0]])
    packing = pm.Packing(place, both, pm.Box.cubic(10.0 * both.max(), 3))
    scene = pm.Scene(packing.replace(tangential=springs), GLASS.effects(packing))
    found = pm.contact_forces(scene)
    effective, shear = 7.0 / (2.0 * (1.0 - 0.22**2)), 7.0 / (2.0 * 1.22) / (2.0 * (2.0 - 0.22))
    contact_radius = math.sqrt(both.prod() / both.sum() * overlap)
    assert found.normal_c[0] == pytest.approx(4.0 / 3.0 * effective * contact_radius * overlap, rel=1e-9)
    assert found.tangential_cd[0, 1] == pytest.approx(8.0 * shear * contact_radius * slip, rel=1e-9)
    assert GLASS.effective_modulus == pytest.approx(effective) and GLASS.shear_modulus == pytest.approx(7.0 / 2.44)


def test_a_wall_is_a_rigid_plane_to_a_sphere():
    sphere = pm.Packing([[2.0, 2.0, 0.499]], [0.5], pm.Box.cubic(4.0, 3))
    scene = pm.Scene(sphere, (pm.Walls(2.0, 0.0, 4.0, pm.ElasticSpheres(GLASS.effective_modulus)),))
    # E / (1 - nu^2) and the radius of the sphere
    due = 4.0 / 3.0 * 7.0 / (1.0 - 0.22**2) * math.sqrt(0.5) * 0.001**1.5
    np.testing.assert_allclose(pm.forces(scene)[0], [0.0, 0.0, due], rtol=1e-9)


STEEL = pm.Material(young_modulus=20.0, poisson_ratio=0.3, density=7.8, restitution=0.4, friction=0.9)


@pytest.mark.parametrize("of", [GLASS, STEEL])
def test_walls_are_thick_plates_of_their_material(of):
    overlap = 1e-3
    sphere = pm.Packing([[2.0, 2.0, 0.5 - overlap]], [0.5], pm.Box.cubic(4.0, 3))
    floor = GLASS.walls(sphere, 2, 0.0, 3.5, of=of)
    compliance = (1.0 - 0.22**2) / 7.0 + (1.0 - of.poisson_ratio**2) / of.young_modulus
    a = math.sqrt(0.5 * overlap)
    due = 4.0 / 3.0 / compliance * a * overlap
    np.testing.assert_allclose(pm.forces(pm.Scene(sphere, (floor,)))[0, 2], due, rtol=1e-9)
    # Mindlin: 8 G* a, 1/G* = (2 - nu_i)/G_i + (2 - nu_j)/G_j
    shear = 1.0 / ((2.0 - 0.22) / GLASS.shear_modulus + (2.0 - of.poisson_ratio) / of.shear_modulus)
    nu = floor.friction.stiffness.poisson_ratio
    assert 2.0 * (1.0 - nu) / (2.0 - nu) * 2.0 / compliance * a == pytest.approx(8.0 * shear * a, rel=1e-12)
    assert floor.damping.coefficient == pytest.approx(math.sqrt(0.9 * of.restitution))
    assert floor.friction.coefficient == pytest.approx(math.sqrt(0.4 * of.friction))


def test_a_ball_leaves_a_wall_of_its_material_with_the_restitution_of_both():
    ball = pm.Packing([[2.0, 2.0, 1.0]], [0.5], pm.Box.cubic(4.0, 3), mass_n=[1.0])
    material = pm.Material(young_modulus=100.0, poisson_ratio=0.2, restitution=0.6)
    scene = pm.Scene(ball, (material.walls(ball, 2, 0.0, 3.5),))
    run = pm.simulate(scene, duration=8.0, dt=2e-4, velocity_nd=[[0.0, 0.0, -0.1]], check=False)
    assert run.velocity_nd[0, 2] == pytest.approx(0.06, rel=1e-3)


def test_discs_are_cylinders_of_any_size_and_collisions_leave_what_the_material_says():
    packing = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1)
    repulsion, dashpot, friction = GLASS.effects(packing)
    assert repulsion.law.stiffness == pytest.approx(math.pi * 7.0 / (8.0 * (1.0 - 0.22**2)), rel=1e-15)
    assert pm.coefficient_of_restitution((repulsion, dashpot), 1e-3, radii=(0.3, 2.0)) == pytest.approx(0.9, rel=1e-6)
    assert friction == pm.Friction(0.4, pm.Mindlin(0.22), pm.DampingRatio(1.0))
    assert pm.Material(7.0, 0.22).effects(packing) == (repulsion,)


def test_shapes_whose_curvature_differs_from_place_to_place_are_refused_by_name():
    flat = pm.random_packing(8, dimension=2, packing_fraction=0.5, shapes=pm.Ellipses(1.5), seed=1)
    with pytest.raises(ValueError, match="packing must be of discs or spheres"):
        GLASS.effects(flat)
    with pytest.raises(ValueError, match=r"asks for effective radii for ellipses, whose curvature"):
        pm.Scene(flat, (pm.Repulsion(pm.ElasticSpheres()),))
    with pytest.raises(ValueError, match=r"must hold no DMT for ellipses.*scene\.without\(pm\.DMT\)"):
        pm.Scene(flat, (pm.Repulsion(), pm.DMT()))


def test_scene_files_have_a_table_for_it(tmp_path):
    text = """
[packing]
kind = "lattice"
name = "fcc"

[material]
young_modulus = 7.0
poisson_ratio = 0.22
density = 2.5
restitution = 0.9
friction = 0.4
"""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    scene = pm.read_scene(path)
    assert scene.effects == GLASS.effects(scene.packing)
    np.testing.assert_allclose(scene.packing.mass_n, 2.5 * math.pi / 6.0 * (2.0 * scene.packing.radius_n) ** 3)
    path.write_text(text + '\n[[effects]]\nkind = "background-damping"\nrate = 0.1\n')
    assert pm.read_scene(path).effects == (*scene.effects, pm.BackgroundDamping(0.1))
    pm.write_scene(scene, tmp_path / "again.toml")
    assert pm.read_scene(tmp_path / "again.toml") == scene
    wall = '\n[[effects]]\nkind = "walls"\naxis = 2\nlow = -0.5\nhigh = 3.0\n'
    path.write_text(text + wall)
    assert pm.read_scene(path).effects[-1] == GLASS.walls(scene.packing, 2, -0.5, 3.0)
    path.write_text(text + wall + "damping = 0.25\n")
    assert pm.read_scene(path).effects[-1] == GLASS.walls(scene.packing, 2, -0.5, 3.0)._replace(damping=0.25)
    for wrong, said in (("poisson_ratio = 0.22", "poisson_ratio = 0.7"), ("friction", "fricton")):
        path.write_text(text.replace(wrong, said))
        with pytest.raises(ValueError, match=rf"material\.{said.split(' ')[0]}"):
            pm.read_scene(path)
