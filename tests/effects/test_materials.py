"""Facts about materials: contacts are those of their constants, in calls and in scene files."""

import math

import numpy as np
import pytest

import packmech as pm

GLASS = pm.Material(young_modulus=7.0, poisson_ratio=0.22, density=2.5, restitution=0.9, friction=0.4)


@pytest.mark.parametrize("radius", [0.2, 0.5, 3.0])
def test_spheres_repel_and_slide_as_hertz_and_mindlin_have_it(radius):
    overlap, slip = 1e-3 * radius, 1e-7 * radius
    place = np.array([[0.0] * 3, [2.0 * radius - overlap, 0.0, 0.0]])
    springs = pm.TangentialDisplacements([0], [1], [[0] * 3], [[0.0, slip, 0.0]])
    packing = pm.Packing(place, [radius] * 2, pm.Box.cubic(10.0 * radius, 3))
    scene = pm.Scene(packing.replace(tangential=springs), GLASS.effects(packing))
    found = pm.contact_forces(scene)
    effective, shear = 7.0 / (2.0 * (1.0 - 0.22**2)), 7.0 / (2.0 * 1.22) / (2.0 * (2.0 - 0.22))
    contact_radius = math.sqrt(0.5 * radius * overlap)
    assert found.normal_c[0] == pytest.approx(4.0 / 3.0 * effective * contact_radius * overlap, rel=1e-9)
    assert found.tangential_cd[0, 1] == pytest.approx(8.0 * shear * contact_radius * slip, rel=1e-9)
    assert GLASS.effective_modulus == pytest.approx(effective) and GLASS.shear_modulus == pytest.approx(7.0 / 2.44)


def test_discs_are_cylinders_of_any_size_and_collisions_leave_what_the_material_says():
    packing = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1)
    repulsion, dashpot, friction = GLASS.effects(packing)
    assert repulsion.law == pm.LinearSpring(math.pi * 7.0 / (8.0 * (1.0 - 0.22**2)))
    assert pm.coefficient_of_restitution((repulsion, dashpot), 1e-3, radii=(0.3, 2.0)) == pytest.approx(0.9, rel=1e-6)
    assert friction == pm.Friction(0.4, pm.Mindlin(0.22), pm.DampingRatio(1.0))
    assert pm.Material(7.0, 0.22).effects(packing) == (repulsion,)


def test_what_hertz_contacts_of_one_number_cannot_be_is_refused_by_name():
    mixed = pm.Packing([[0.0] * 3, [2.0] * 3], [0.5, 0.6], pm.Box.cubic(5.0, 3))
    with pytest.raises(ValueError, match=r"spheres of one size.*got radii 0.5 and 0.6 of particles 0 and 1"):
        GLASS.effects(mixed)
    flat = pm.random_packing(8, dimension=2, packing_fraction=0.5, shapes=pm.Ellipses(1.5), seed=1)
    with pytest.raises(ValueError, match="packing must be of discs or spheres"):
        GLASS.effects(flat)


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
