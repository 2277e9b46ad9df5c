"""Facts about what environments are given: options that are checked, and scenes as they take them."""

import numpy as np
import pytest
from packmech_envs.tasks import (
    bonds_for_links,
    boolean,
    budget,
    count,
    one_of,
    positive,
    quenchable,
    real,
    scene_of,
)
from packmech_envs.words import brief, nearest

import packmech as pm


def discs(*effects):
    packing = pm.random_packing(8, dimension=2, packing_fraction=0.5, seed=1)
    return pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), *effects))


def test_counts_begin_at_one_and_budgets_may_be_none():
    assert count("steps", 1) == 1 and count("steps", np.int64(7)) == 7
    assert budget("step_budget", None) is None and budget("step_budget", 1) == 1
    for bad, error in (
        (0, ValueError),
        (-3, ValueError),
        (True, TypeError),
        (1.0, TypeError),
        (np.bool_(1), TypeError),
    ):
        with pytest.raises(error, match="steps must be an integer at least 1, got"):
            count("steps", bad)


def test_numbers_are_real_and_finite_and_where_it_is_asked_positive():
    assert real("a", -1) == -1.0 and isinstance(real("a", np.float32(2.0)), float)
    assert positive("a", 1e-300) == 1e-300
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(ValueError, match="a must be a finite number"):
            real("a", bad)
    for bad in (True, "1", None):
        with pytest.raises(TypeError, match="a must be a finite number"):
            real("a", bad)
    for bad in (0.0, -1e-300):
        with pytest.raises(ValueError, match="a must be a positive number"):
            positive("a", bad)


class Unspeakable:
    def __repr__(self):
        raise RuntimeError("no repr")

    def __eq__(self, other):
        raise RuntimeError("no comparison")


def test_what_cannot_be_shown_or_compared_is_refused_by_the_name_of_its_option():
    assert brief(Unspeakable()) == "a Unspeakable that cannot be shown (RuntimeError)"
    assert len(brief("n" * 10**6)) == 60
    for check, words in ((count, "an integer"), (real, "a finite number"), (boolean, "True or False")):
        with pytest.raises(TypeError, match=f"a must be {words}.*got a Unspeakable"):
            check("a", Unspeakable())
    with pytest.raises(ValueError, match="a must be one of 'b', got a Unspeakable"):
        one_of("a", Unspeakable(), ("b",))
    with pytest.raises(ValueError, match="a must be a finite number, got 1000"):
        real("a", 10**400)


def test_names_are_among_those_there_are_and_the_nearest_is_named():
    one_of("kind", "discs", ("discs", "spheres"))
    for bad in ("disc", 3, None):
        with pytest.raises(ValueError, match="kind must be one of 'discs', 'spheres', got"):
            one_of("kind", bad, ("discs", "spheres"))
    assert nearest("disc", ["discs", "spheres"]) == "; did you mean 'discs'?" and nearest("xyz", ["discs"]) == ""
    boolean("flag", False)
    with pytest.raises(TypeError, match="flag must be True or False, got 0"):
        boolean("flag", 0)


def test_a_name_that_is_no_scene_is_answered_with_those_there_are_and_a_file_that_is_missing_is_said_to_be(tmp_path):
    with pytest.raises(ValueError, match="scene must be a file or one of .*did you mean 'triangular'"):
        scene_of("triangula")
    for missing in ("missing.toml", str(tmp_path / "missing"), tmp_path / "missing.toml"):
        with pytest.raises(FileNotFoundError, match="missing"):
            scene_of(missing)


@pytest.mark.parametrize("size", [1.0, 3.0])
def test_bonds_for_links_are_ten_times_as_stiff_as_contacts_whatever_the_units_are(size):
    trimers = scene_of("fifty-trimers-2d")
    packing = trimers.packing
    links = packing.links
    large = pm.Packing(
        packing.position_nd * size, packing.radius_n * size, pm.Box(packing.box.lattice_dd * size),
        pm.Links(links.i_l, links.j_l, links.image_ld, links.length_l * size),
    )  # fmt: skip
    scene = pm.Scene(large, (pm.Repulsion(law=pm.Harmonic(energy_scale=2.0)),))
    bonds = bonds_for_links(scene).effects[-1]
    stiffness = 20.0 / large.reference_diameter**2
    assert np.isclose(bonds.tension.stiffness, stiffness, rtol=1e-14, atol=0.0) and bonds.compression == bonds.tension
    assert np.array_equal(bonds.rest_length_b, links.length_l * size)


def test_minimizers_take_energies_of_pairs_and_leave_out_what_does_nothing_at_rest():
    plain = discs()
    assert quenchable(plain) is plain
    assert quenchable(discs(pm.ContactDamping(0.3))).effects == plain.effects
    for rough in (pm.Friction(0.5), pm.RollingResistance(0.1)):
        scene = discs(pm.Friction(0.5)) if isinstance(rough, pm.Friction) else discs(pm.Friction(0.0), rough)
        with pytest.raises(ValueError, match=r"scene must have no friction here.*got effects\["):
            quenchable(scene)
        assert quenchable(scene, friction="leave out").effects == plain.effects
    assert quenchable(discs(pm.Friction(0.0))).effects == plain.effects
    with pytest.raises(ValueError, match="scene must have no Gravity here"):
        quenchable(discs(pm.Gravity()))
    with pytest.raises(ValueError, match="scene must have an effect with an energy"):
        quenchable(pm.Scene(plain.packing, (pm.ContactDamping(0.3),)))


def test_bonds_are_refused_unless_they_are_to_be_left_out_and_no_bonds_are_none():
    none = np.zeros(0, dtype=np.int64)
    spring = pm.LinearSpring()
    bonded = discs(pm.Bonds([0], [1], [[0, 0]], [1.0], compression=spring, tension=spring))
    empty = discs(
        pm.Bonds(none, none, np.zeros((0, 2), dtype=np.int64), np.zeros(0), compression=spring, tension=spring)
    )
    with pytest.raises(ValueError, match=r"got 1 in effects\[1\]"):
        quenchable(bonded)
    for scene, how in ((bonded, "leave out"), (empty, "refuse"), (empty, "leave out")):
        assert quenchable(scene, bonds=how).effects == bonded.effects[:1]
