"""Facts about materials of kinds in scene files: names, means, and what pairs have instead."""

import tomllib

import pytest

import packmech as pm
from packmech.scenes.reference import commented_scene

PACKING = """
[packing]
kind = "lattice"
name = "fcc"
repeats = [2, 2, 2]

[kinds]
shares = [2, 1, 1]
seed = 5
"""
GLASS = '[[material]]\nname = "glass"\nyoung_modulus = 7.0\npoisson_ratio = 0.22\nrestitution = 0.9\nfriction = 0.4\n'
STEEL = '[[material]]\nname = "steel"\nyoung_modulus = 20.0\nrestitution = 0.6\nfriction = 0.1\ndensity = 3.1\n'
RUBBER = "[[material]]\nyoung_modulus = 0.1\npoisson_ratio = 0.5\nrestitution = 0.3\nfriction = 0.9\n"
THREE = GLASS + STEEL + RUBBER
MIXING = '[mixing]\nfriction = "min"\n'
EXCEPTIONS = """
[[exception]]
between = ["steel", "glass"]
friction = 0.3

[[exception]]
between = ["steel", 2]
young_modulus = 1
restitution = 0.5
"""


def read(folder, text, **changes):
    (folder / "scene.toml").write_text(text)
    return pm.read_scene(folder / "scene.toml", **changes)


def test_means_and_exceptions_of_a_file_are_those_of_the_record(tmp_path):
    glass = pm.Material(7.0, 0.22, restitution=0.9, friction=0.4)
    steel = pm.Material(20.0, density=3.1, restitution=0.6, friction=0.1)
    rubber = pm.Material(0.1, 0.5, restitution=0.3, friction=0.9)
    exceptions = {(0, 1): {"friction": 0.3}, (1, 2): {"young_modulus": 1.0, "restitution": 0.5}}
    same = pm.Materials((glass, steel, rubber), {"friction": "min"}, exceptions)
    scene = read(tmp_path, PACKING + THREE + MIXING + EXCEPTIONS)
    assert scene.effects == same.effects(scene.packing)
    assert (scene.packing.mass_n == same.masses(scene.packing)).all()
    # of every pair: (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)
    assert scene.effects[2].coefficient.numbers == (0.4, 0.3, 0.1, 0.4, 0.1, 0.9)
    assert scene.effects[1].coefficient.of(1, 2) == 0.5
    # one word stands for all means, and without any they are geometric
    (tmp_path / "scene.toml").write_text(PACKING + THREE)
    for word in ("min", "geometric"):
        found = pm.read_scene(tmp_path / "scene.toml", changes={"mixing": word})
        assert found.effects == pm.Materials((glass, steel, rubber), word).effects(scene.packing)
    assert pm.read_scene(tmp_path / "scene.toml") == found


def test_a_scene_of_materials_is_written_and_read_back_equal(tmp_path):
    scene = read(tmp_path, PACKING + THREE + MIXING + EXCEPTIONS)
    pm.write_scene(scene, tmp_path / "again.toml")
    assert pm.read_scene(tmp_path / "again.toml") == scene


def test_a_material_is_changed_by_its_name(tmp_path):
    text = PACKING + THREE + MIXING + EXCEPTIONS
    changed = read(
        tmp_path,
        text,
        changes={"material.steel.friction": 0.05, "exception.0.friction": 0.2, "mixing.friction": "mean"},
    )
    by_hand = text.replace("friction = 0.1", "friction = 0.05").replace("friction = 0.3", "friction = 0.2")
    assert changed == read(tmp_path, by_hand.replace('"min"', '"mean"'))
    with pytest.raises(ValueError, match=r"no 'stel' in material \(\['glass', 'steel', None\]\); did you mean 'steel'"):
        read(tmp_path, text, changes={"material.stel.friction": 0.05})


def test_a_commented_scene_of_materials_is_read_as_the_one_without_comments(tmp_path):
    text = PACKING + THREE + MIXING + EXCEPTIONS
    scene = read(tmp_path, text)
    commented = commented_scene(tomllib.loads(text))
    assert "Two materials by their `name`" in commented
    assert read(tmp_path, commented) == scene
    one_word = 'mixing = "min"\n' + text.replace(MIXING, "")
    assert read(tmp_path, commented_scene(tomllib.loads(one_word))) == read(tmp_path, one_word)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (THREE + '[mixing]\nfriction = "max"\n', "mixing.friction must be one of 'geometric', .*, got 'max'"),
        (THREE + '[mixing]\nfrictoin = "min"\n', "mixing.frictoin must be a field of .*did you mean 'friction'"),
        (THREE + "[mixing]\nfriction = 1\n", "mixing.friction must be a string, got 1"),
        (THREE + '[[mixing]]\nfriction = "min"\n', "mixing must be a table of means of friction and restitution"),
        (
            THREE + '[[exception]]\nbetween = ["glass", "stel"]\nfriction = 1\n',
            r"exception\[0\].between must name .* from 0 to 2, or by name \('glass', 'steel'\), got 'stel'; did you",
        ),
        (THREE + "[[exception]]\nbetween = [0, 3]\nfriction = 1\n", r"exception\[0\].between must name .* got 3"),
        (THREE + "[[exception]]\nbetween = [0]\nfriction = 1\n", r"exception\[0\].between must name two materials"),
        (THREE + "[[exception]]\nfriction = 1\n", r"exception\[0\].between must be given, got nothing"),
        (
            THREE + "[[exception]]\nbetween = [0, 1]\n",
            r"exception\[0\].young_modulus, .* one of them at least",
        ),
        (
            THREE + "[[exception]]\nbetween = [0, 1]\nfriction = -1\n",
            r"exception\[0\].friction must be .* at least 0, got -1",
        ),
        (
            THREE + "[[exception]]\nbetween = [0, 1]\ndensity = 1\n",
            r"exception\[0\].density must be a field of exception \(between, young_modulus, .*got an unknown one",
        ),
        (
            THREE + EXCEPTIONS + '[[exception]]\nbetween = ["glass", 1]\nfriction = 1\n',
            r"exception\[2\].between must be a pair that no other has, got \['glass', 1\] again",
        ),
        (
            THREE + "[exception]\nbetween = [0, 1]\nfriction = 1\n",
            r"exception must be a list of tables \(\[\[exception",
        ),
        (GLASS + GLASS, r"material\[1\].name must be that of no other material, got 'glass' as of 0"),
        (GLASS.replace('"glass"', "1"), r"material\[0\].name must be a string, got 1"),
        (GLASS.replace("[[material]]", "[material]") + MIXING, r"mixing must stand beside .* got one material for all"),
        (EXCEPTIONS, r"exception must stand beside a material for each kind \(\[\[material\]\]\), got no material"),
    ],
)
def test_wrong_means_and_exceptions_are_refused_naming_table_and_field(tmp_path, text, message):
    with pytest.raises((TypeError, ValueError), match=message) as error:
        read(tmp_path, PACKING + text)
    assert "scene.toml" in str(error.value)


@pytest.mark.parametrize("first", [True, False])
def test_one_material_beside_materials_of_kinds_is_said_to_be_both(tmp_path, first):
    one = GLASS.replace("[[material]]", "[material]")
    text = PACKING + (one + STEEL if first else STEEL + one)
    said = r"material must be one table \[material\] or several \[\[material\]\] .*got both, in lines 10 and 16"
    with pytest.raises(ValueError, match=said) as error:
        read(tmp_path, text)
    assert "scene.toml" in str(error.value)
    with pytest.raises(ValueError, match=r"effects must be one table \[effects\] or several \[\[effects\]\], got both"):
        read(tmp_path, PACKING + '[[effects]]\nkind = "repulsion"\n[effects]\nkind = "gravity"\n')
