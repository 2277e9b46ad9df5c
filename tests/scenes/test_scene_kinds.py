"""Facts about kinds of particles in scene files: written out, assigned by a table, or in a file that a scene names."""

import tomllib

import pytest

import packmech as pm
from packmech.scenes.reference import commented_scene, scene_reference

EFFECTS = """
[[effects]]
kind = "repulsion"
law = { kind = "harmonic", energy_scale = 1.0 }
"""
SQUARE = '[packing]\nkind = "lattice"\nname = "square"\n'
RANDOM = '[packing]\nkind = "random"\nparticles = 20\npacking_fraction = 0.8\nseed = 3\n'
SHARES = "[kinds]\nshares = [2, 1, 1]\nseed = 5\n"


def read(folder, text):
    (folder / "scene.toml").write_text(text)
    return pm.read_scene(folder / "scene.toml")


def test_kinds_of_a_file_are_those_that_the_function_assigns(tmp_path):
    start = pm.random_packing(20, dimension=2, packing_fraction=0.8, seed=3)
    assert read(tmp_path, EFFECTS + RANDOM + SHARES).packing == pm.assign_kinds(start, (2, 1, 1), seed=5)
    by_size = read(tmp_path, EFFECTS + RANDOM + '[kinds]\nby = "size"\n').packing
    assert by_size == pm.assign_kinds(start, by="size")
    changed = {"kinds.shares": [1, 0, 3], "kinds.seed": 6}
    (tmp_path / "scene.toml").write_text(EFFECTS + RANDOM + SHARES)
    assert pm.read_scene(tmp_path / "scene.toml", changes=changed).packing == pm.assign_kinds(start, (1, 0, 3), seed=6)


def test_another_seed_draws_start_and_kinds_again_but_for_a_seed_that_is_given_beside_it(tmp_path):
    (tmp_path / "a.toml").write_text(EFFECTS + RANDOM + SHARES)
    start = pm.random_packing(20, dimension=2, packing_fraction=0.8, seed=9)
    assert pm.read_scene(tmp_path / "a.toml", seed=9).packing == pm.assign_kinds(start, (2, 1, 1), seed=9)
    found = pm.read_scene(tmp_path / "a.toml", seed=9, changes={"kinds.seed": 7}).packing
    assert found == pm.assign_kinds(start, (2, 1, 1), seed=7)
    # of a crystal with kinds by chance only these are drawn
    (tmp_path / "a.toml").write_text(EFFECTS + SQUARE + "repeats = [3, 3]\n" + SHARES)
    crystal = pm.lattice_packing("square", repeats=(3, 3))
    assert pm.read_scene(tmp_path / "a.toml", seed=9).packing == pm.assign_kinds(crystal, (2, 1, 1), seed=9)


@pytest.mark.parametrize("shapes", [None, pm.Ellipses(1.5), pm.Dimer()])
def test_a_scene_with_kinds_is_read_back_equal(tmp_path, shapes):
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.5, seed=4, shapes=shapes)
    scene = pm.Scene(pm.assign_kinds(packing, (1, 1, 1), seed=1), (pm.Repulsion(),))
    pm.write_scene(scene, tmp_path / "a.toml")
    assert pm.read_scene(tmp_path / "a.toml") == scene
    pm.write_scene(pm.Scene(packing, (pm.Repulsion(),)), tmp_path / "a.toml")
    assert "kinds" not in (tmp_path / "a.toml").read_text()


def test_kinds_are_read_from_a_packing_file_that_a_scene_names(tmp_path):
    packing = pm.assign_kinds(pm.lattice_packing("square", repeats=(3, 3)), (1, 1), seed=1)
    for ending in (".npz", ".gsd", ".csv"):
        pm.write_packing(packing, tmp_path / f"a{ending}")
        assert read(tmp_path, EFFECTS + f'[packing]\nkind = "file"\npath = "a{ending}"\n').packing == packing


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (RANDOM + SHARES.replace("shares", "shars"), "kinds.shars must be a field of .*did you mean 'shares'"),
        (RANDOM + SHARES.replace("seed = 5", ""), "kinds.seed must be an integer"),
        (RANDOM + SHARES.replace("[2, 1, 1]", "[2, -1]"), "kinds.shares must not be negative, got -1 for kind 1"),
        (RANDOM + SHARES + 'by = "size"\n', "kinds.shares must be left out with by='size'"),
        (RANDOM + SHARES + 'kind = "shares"\n', "kinds must be a table of shares and a seed, or of by, without a kind"),
        (
            '[packing]\nkind = "inline"\nlattice_vectors = [[9, 0], [0, 9]]\npositions = [[1, 1], [3, 3]]\n'
            "radii = [1, 1]\nkinds = [0, 64]\n",
            "packing.kinds must lie between 0 and 63, got 64 for particle 1",
        ),
        (
            '[packing]\nkind = "inline"\nlattice_vectors = [[9, 0], [0, 9]]\npositions = [[1, 1], [3, 3]]\n'
            "radii = [1, 1]\nkinds = [0, 1]\n" + SHARES,
            "kinds.packing must be of one kind of particles in a scene with kinds, got 2",
        ),
    ],
)
def test_wrong_kinds_are_refused_naming_the_field(tmp_path, text, message):
    with pytest.raises((TypeError, ValueError), match=message):
        read(tmp_path, EFFECTS + text)


def test_a_commented_scene_with_kinds_is_read_as_the_one_without_comments(tmp_path):
    scene = read(tmp_path, EFFECTS + RANDOM + SHARES)
    text = commented_scene(tomllib.loads(EFFECTS + RANDOM + SHARES))
    assert "Share of the particles of kind 0, 1, and so on" in text
    assert read(tmp_path, text) == scene


def test_the_tables_by_kinds_that_the_page_on_scene_files_shows_are_read(tmp_path):
    text = scene_reference().partition("```toml by-kinds.toml\n")[2].partition("```")[0]
    scene = read(tmp_path, text)
    repulsion, friction, walls = scene.effects
    assert walls.of(1).law == pm.Harmonic(2.0) and walls.of(0).friction.coefficient == 0.5
    assert repulsion.law == pm.LawByKind({(0, 0): pm.Harmonic(1.0), (0, 1): pm.Harmonic(1.5), (1, 1): pm.Harmonic(3.0)})
    assert friction.coefficient == pm.ByKind({(0, 0): 0.5, (0, 1): 0.1, (1, 1): 0.3})
    pm.write_scene(scene, tmp_path / "again.toml")
    assert pm.read_scene(tmp_path / "again.toml") == scene
    # no field offers pairs, which TOML cannot name
    assert "{(a, b): " not in scene_reference()
