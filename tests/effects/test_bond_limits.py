"""Facts about the limits of bonds: what is refused, what goes with bonds that are chosen, written and read."""

import math

import numpy as np
import pytest

import packmech as pm


def bonds(limits, **springs):
    return pm.Bonds([2, 0, 1], [1, 1, 3], [[0, 0]] * 3, [1.0, 1.1, 1.2], breaks_at=limits, **springs)


@pytest.fixture
def scene():
    packing = pm.Packing([[1.0, 1.0], [2.0, 1.0], [3.0, 1.0], [2.0, 2.0]], [0.5] * 4, pm.Box.cubic(5.0, 2))
    limits = pm.BondLimits(tension=(0.1, 1.0 / 3.0, math.inf), squeeze=0.1 + 0.2, shear=1e-3)
    return pm.Scene(packing, (pm.Repulsion(), bonds(limits)))


@pytest.mark.parametrize(
    ("given", "error", "match"),
    [
        ({}, ValueError, "tension must be given, or one of compression, .*got no limit"),
        ({"tension": 0.0}, ValueError, "tension must be positive, got 0.0"),
        ({"compression": -1.0}, ValueError, "compression must be positive, got -1.0"),
        ({"squeeze": math.nan}, ValueError, "squeeze must be positive, got nan"),
        ({"squeeze": 1.0}, ValueError, "squeeze must be below 1, as no bond is shorter than 0, .*got 1.0"),
        ({"squeeze": [0.1, 2.0]}, ValueError, "squeeze must be below 1, as no bond is shorter than 0, .*got 2.0"),
        ({"stretch": "0.1"}, TypeError, "stretch must be a number, or one for each bond, or None, got '0.1'"),
        ({"stretch": [0.1, True]}, TypeError, "stretch must be a number, or one for each bond, or None, got True"),
        ({"shear": [[0.1]]}, TypeError, r"shear must be a number, or one for each bond, or None, got \[0.1\]"),
        ({"shear": pm.Harmonic()}, TypeError, r"shear must be a number, or one for each bond, or None, got Harmonic"),
    ],
)
def test_limits_that_mean_nothing_are_refused(given, error, match):
    with pytest.raises(error, match=match):
        pm.BondLimits(**given)


def test_limits_that_do_not_fit_the_bonds_are_refused():
    with pytest.raises(ValueError, match=r"breaks_at.tension must be a number or one for each of 3 bonds, got 2"):
        bonds(pm.BondLimits(tension=[0.1, 0.2]))
    with pytest.raises(ValueError, match=r"breaks_at.shear must be None for bonds without tangential springs"):
        bonds(pm.BondLimits(shear=0.1), tangential_stiffness=0.0)
    with pytest.raises(TypeError, match="breaks_at must be a BondLimits, got 0.1"):
        bonds(0.1)


def test_limits_of_single_bonds_go_with_them():
    """Bonds are sorted by their particles, and limits with them."""
    made = bonds(pm.BondLimits(tension=[0.3, 0.1, 0.2], stretch=0.5))
    assert list(zip(made.i_b.tolist(), made.breaks_at.tension, strict=True)) == [(0, 0.1), (1, 0.3), (1, 0.2)]
    assert made.rest_length_b.tolist() == [1.1, 1.0, 1.2]
    some = made.select(made.rest_length_b > 1.05)
    assert some.breaks_at == pm.BondLimits(tension=(0.1, 0.2), stretch=0.5)
    assert made.select(np.zeros(3, dtype=bool)).breaks_at.tension == ()
    assert made == bonds(pm.BondLimits(tension=[0.3, 0.1, 0.2], stretch=0.5))
    assert made != bonds(pm.BondLimits(tension=[0.3, 0.1, 0.2], stretch=0.4)) != made.unbreakable()
    assert made.unbreakable() == bonds(None)


def test_bonds_of_a_wrapped_packing_keep_their_limits(scene):
    bond = scene.effects[1]
    packing = scene.packing
    moved = packing.replace(
        position_nd=packing.position_nd + np.array([[5.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    )
    gone_on = scene.replace(packing=moved).effects[1]
    assert gone_on.image_bd[0].tolist() == [1, 0] and gone_on.breaks_at == bond.breaks_at
    made = pm.bond_contacts(pm.lattice_packing("square"), breaks_at=pm.BondLimits(stretch=0.1))
    assert made.breaks_at == pm.BondLimits(stretch=0.1)


def test_limits_are_read_from_files_as_they_were_written(scene, tmp_path):
    pm.write_scene(scene, tmp_path / "scene.toml")
    assert pm.read_scene(tmp_path / "scene.toml") == scene
    for name in ("a.npz", "a.gsd"):
        pm.write_packing(pm.Snapshot(scene.packing, bonds=(scene.effects[1],)), tmp_path / name)
        (again,) = pm.read_trajectory(tmp_path / name)
        assert again.bonds == (scene.effects[1],)


def test_a_scene_file_names_the_limits_without_a_kind(tmp_path):
    text = """
[packing]
kind = "lattice"
name = "triangular"
repeats = 3
relative_overlap = 0.01

[[effects]]
kind = "repulsion"

[[effects]]
kind = "bonds"
of = "contacts"
breaks_at = { tension = 0.02, squeeze = 0.1 }
"""
    path = tmp_path / "scene.toml"
    path.write_text(text)
    assert pm.read_scene(path).effects[1].breaks_at == pm.BondLimits(tension=0.02, squeeze=0.1)
    path.write_text(text.replace("tension = 0.02", 'tension = "much"'))
    with pytest.raises(TypeError, match=r"effects\[1\].breaks_at.tension must be a number or a list, got 'much'"):
        pm.read_scene(path)
    path.write_text(text.replace("squeeze = 0.1", "squeeze = -0.1"))
    with pytest.raises(ValueError, match=r"effects\[1\].breaks_at.squeeze must be positive, got -0.1"):
        pm.read_scene(path)


def test_calls_that_break_no_bonds_refuse_limits(scene):
    with pytest.raises(ValueError, match=r"no bonds that break for pm.quench, .*got limits of Bonds at 1: take them"):
        pm.quench(scene.replace(effects=(scene.effects[0], bonds(pm.BondLimits(stretch=1.0)))))
    # forces as they are now do not depend on what may break later
    lasting = scene.replace(effects=(scene.effects[0], scene.effects[1].unbreakable()))
    assert pm.energy(scene) == pm.energy(lasting) > 0.0
