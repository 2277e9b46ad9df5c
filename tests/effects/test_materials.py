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


def test_discs_are_cylinders_of_any_size_and_collisions_leave_what_the_material_says():
    packing = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1)
    repulsion, dashpot, friction = GLASS.effects(packing)
    assert repulsion.law == pm.LinearSpring(math.pi * 7.0 / (8.0 * (1.0 - 0.22**2)))
    assert pm.coefficient_of_restitution((repulsion, dashpot), 1e-3, radii=(0.3, 2.0)) == pytest.approx(0.9, rel=1e-6)
    assert friction == pm.Friction(0.4, pm.Mindlin(0.22), pm.DampingRatio(1.0))
    assert pm.Material(7.0, 0.22).effects(packing) == (repulsion,)


def test_shapes_whose_curvature_differs_from_place_to_place_are_refused_by_name():
    flat = pm.random_packing(8, dimension=2, packing_fraction=0.5, shapes=pm.Ellipses(1.5), seed=1)
    with pytest.raises(ValueError, match="packing must be of discs or spheres"):
        GLASS.effects(flat)
    for effects in ((pm.Repulsion(pm.ElasticSpheres()),), (pm.Repulsion(), pm.DMT())):
        with pytest.raises(ValueError, match=r"asks for effective radii for .*llipse.*, whose curvature"):
            pm.Scene(flat, effects)


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
    for wrong, said in (("poisson_ratio = 0.22", "poisson_ratio = 0.7"), ("friction", "fricton")):
        path.write_text(text.replace(wrong, said))
        with pytest.raises(ValueError, match=rf"material\.{said.split(' ')[0]}"):
            pm.read_scene(path)
