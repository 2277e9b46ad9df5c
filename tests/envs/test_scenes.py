"""Facts about the scenes that environments take: which are refused, and what becomes of links and bonds."""

import numpy as np
import pytest
from packmech_envs.tasks import bonds_for_links, quenchable, scene_of, shearable

import packmech as pm


def test_a_scene_is_taken_as_it_is_by_its_name_or_from_its_file(tmp_path):
    scene = scene_of("triangular")
    assert scene == pm.read_scene("triangular")
    assert scene_of(scene) is scene
    pm.write_scene(scene, tmp_path / "mine.toml")
    assert scene_of(tmp_path / "mine.toml") == scene_of(str(tmp_path / "mine.toml")) == scene


@pytest.mark.parametrize(
    ("scene", "error", "message"),
    [
        (3, TypeError, "scene must be a Scene, a scene file or the name of a shipped scene, got int"),
        (None, TypeError, "scene must be a Scene.* got NoneType"),
        ("kagone", ValueError, "scene must be a file or one of default, .*kagome.*, got 'kagone'"),
        ("no/such/file.toml", FileNotFoundError, "existing file, got 'no/such/file.toml'"),
    ],
)
def test_what_is_no_scene_gets_one_clear_error(scene, error, message):
    with pytest.raises(error, match=message):
        scene_of(scene)


def test_every_shipped_scene_can_be_sheared_with_bonds_in_place_of_links_and_quenched_without_bonds():
    foreign_to_agents = pm.JKR | pm.DMT | pm.CapillaryBridge | pm.ShortRangeAttraction | pm.Langevin
    for name in pm.list_scenes():
        scene = scene_of(name)
        assert not shearable(scene, links="bonds").packing.links
        if any(isinstance(one, pm.Gravity | pm.Walls) for one in scene.effects):
            with pytest.raises(ValueError, match="no (Gravity|Walls) here"):
                quenchable(scene, bonds="leave out", friction="leave out")
            continue
        foreign = [type(one) for one in scene.effects if isinstance(one, foreign_to_agents)]
        if foreign:
            with pytest.raises(ValueError, match=f"no {foreign[0].__name__} here"):
                quenchable(scene, bonds="leave out", friction="leave out")
            continue
        quenched = quenchable(scene, bonds="leave out", friction="leave out")
        assert quenched.packing == scene.packing
        assert all(isinstance(one, pm.Repulsion) for one in quenched.effects)


def test_links_and_bonds_are_refused_unless_what_to_do_is_said():
    with pytest.raises(ValueError, match='no rigid links here, got 150; links="bonds" makes'):
        shearable(scene_of("fifty-trimers-2d"))
    with pytest.raises(ValueError, match=r'no bonds here.*effects\[4\]; bonds="leave out"'):
        quenchable(scene_of("microgel"), friction="leave out")
    with pytest.raises(ValueError, match="links must be one of 'refuse', 'bonds', got 'keep'"):
        shearable(scene_of("triangular"), links="keep")
    with pytest.raises(ValueError, match="bonds must be one of 'refuse', 'leave out', got True"):
        quenchable(scene_of("triangular"), bonds=True)


def test_friction_is_refused_where_no_time_passes_unless_it_is_to_be_left_out():
    with pytest.raises(ValueError, match=r"no friction here, whose tangential springs .*pm.settle"):
        quenchable(scene_of("rough-discs"))
    smooth = scene_of("triangular").replace(effects=(pm.Repulsion(), pm.Friction(0.0), pm.ContactDamping(0.3)))
    assert quenchable(smooth).effects == (pm.Repulsion(),)


@pytest.mark.parametrize("effect", [pm.Gravity(0.0, -1.0), pm.Walls(1, 0.0, 5.0)])
def test_gravity_and_walls_are_refused_where_only_pairs_have_an_energy(effect):
    scene = scene_of("triangular")
    with pytest.raises(ValueError, match=rf"no {type(effect).__name__} here.*effects\[1\]"):
        quenchable(scene.replace(effects=(*scene.effects, effect)))


def test_bonds_stand_at_the_links_with_their_lengths_and_bear_nothing_where_links_are_exact():
    scene = scene_of("fifty-trimers-3d")
    links, bonded = scene.packing.links, bonds_for_links(scene, 50.0)
    bonds = bonded.effects[-1]
    for mine, theirs in (("i_b", "i_l"), ("j_b", "j_l"), ("image_bd", "image_ld"), ("rest_length_b", "length_l")):
        assert np.array_equal(getattr(bonds, mine), getattr(links, theirs))
    vector = links.vectors(scene.packing.position_nd, scene.packing.box.lattice_dd)
    assert np.linalg.norm(vector, axis=1) == pytest.approx(bonds.rest_length_b, rel=1e-12)


@pytest.mark.parametrize(
    ("stiffness", "error"), [(0.0, ValueError), (-1.0, ValueError), (float("nan"), ValueError), ("1", TypeError)]
)
def test_a_bad_stiffness_is_named(stiffness, error):
    with pytest.raises(error, match="link_stiffness must be a positive number"):
        shearable(scene_of("fifty-trimers-2d"), links="bonds", link_stiffness=stiffness)


@pytest.mark.slow  # compiles an engine of its own
def test_a_bonded_trimer_keeps_its_shape_when_it_is_sheared_slowly():
    start = pm.cluster_packing(8, pm.Trimer(angle=1.3), dimension=2, packing_fraction=0.3, seed=2)
    scene = bonds_for_links(pm.Scene(start, (pm.Repulsion(), pm.BackgroundDamping(0.5))), 100.0)
    run = pm.simulate(scene, duration=2.0, applied_strain=pm.SteadyStrain(0.05))
    bonds = scene.effects[-1]
    position, lattice = run.packing.position_nd, run.packing.box.lattice_dd
    vector = position[bonds.j_b] - position[bonds.i_b] + bonds.image_bd @ lattice.T
    assert np.linalg.norm(vector, axis=1) == pytest.approx(bonds.rest_length_b, rel=0.02)
