"""Facts about scene files of the frictional model: effects, bonds and drives written and read, scenes that ship."""

import json

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute

SCENES = ("microgel", "bulk", "uncrosslinked", "frictionless", "plateau")
PREPARED = """
[packing]
kind = "prepared"
particles = 40
packing_fraction = 1.2
side = 20.0
seed = 3

[[effects]]
kind = "repulsion"
law = { kind = "divergent-repulsion", stiffness = 2.0 }
"""
CRYSTAL = """
[packing]
kind = "lattice"
name = "triangular"
repeats = 4
relative_overlap = 0.01

[[effects]]
kind = "repulsion"
law = "linear-spring"
"""


def read(folder, text):
    (folder / "scene.toml").write_text(text)
    return pm.read_scene(folder / "scene.toml")


def again(folder, scene):
    pm.write_scene(scene, folder / "again.toml")
    return pm.read_scene(folder / "again.toml")


@pytest.fixture(scope="module")
def packing():
    return pm.random_packing(40, dimension=2, packing_fraction=1.2, seed=3)


@pytest.fixture(scope="module")
def shipped():
    return {name: pm.read_scene(name) for name in SCENES}


# -- effects, bonds and drives written and read ------------------------------------------------------------------------


def test_every_effect_of_the_frictional_model_is_read_as_it_was_written(tmp_path, packing):
    plateau = pm.PlateauRepulsion(0.2, 0.7, 0.3, pm.DivergentRepulsion(1.0 / 3.0, 0.7, 123.0))
    effects = (
        pm.Repulsion(plateau),
        pm.ContactDamping(0.1, onset="smooth"),
        pm.Friction(0.3, 1.0 / 7.0, 0.02),
        pm.Gravity(0.1, -9.81, 0.0),
        pm.BackgroundDamping(1.0 / 3.0),
        pm.Walls(1.0, -0.1, 20.0, pm.Hertz(2.0), 0.3, pm.Friction(0.2, pm.Mindlin(0.25), pm.DampingRatio(0.5))),
    )
    scene = pm.Scene(packing, effects)
    assert again(tmp_path, scene) == scene


@pytest.mark.parametrize("dimension", [2, 3])
def test_bonds_are_read_as_they_were_written_to_the_last_bit(tmp_path, dimension):
    packing = pm.random_packing(30, dimension=dimension, packing_fraction=1.2, seed=5)
    bonds = pm.bond_contacts(
        packing,
        compression=pm.DivergentRepulsion(2.0),
        tension=pm.ExponentialTension(1.0 / 3.0, 0.3),
        tangential_stiffness=0.1,
        damping=1.0 / 7.0,
        tangential_damping=0.3,
        rest="distance",
    )
    scene = pm.Scene(packing, (pm.Repulsion(), bonds))
    found = again(tmp_path, scene)
    assert found == scene
    assert found.effects[1].rest_length_b.tobytes() == bonds.rest_length_b.tobytes()


def test_a_scene_without_any_bond_left_is_read_as_it_was_written(tmp_path, packing):
    bonds = pm.bond_contacts(packing)
    scene = pm.Scene(packing, (pm.Repulsion(), bonds.select(np.zeros(len(bonds), dtype=bool))))
    assert again(tmp_path, scene) == scene


def test_a_drive_of_oscillatory_shear_is_read_as_it_was_written(tmp_path, packing):
    drive = pm.OscillatoryShearDrive(
        amplitude=1.0 / 3.0,
        relative_frequency=0.025,
        pre_periods=1.5,
        periods=3.0,
        skip_periods=0.5,
        axes=(1, 0),
        method=pm.SemiImplicitEuler(0.1),
        largest_oscillation=0.05,
    )
    scene = pm.Scene(packing, (pm.Repulsion(),), drive)
    assert again(tmp_path, scene) == scene


def test_a_drive_of_steady_shear_is_read_as_it_was_written(tmp_path, packing):
    drive = pm.SteadyShearDrive(rates=(0.1, 1.0 / 3.0), applied_strain=2.0, samples=50, axes=(1, 0), dt=0.01)
    scene = pm.Scene(packing, (pm.Repulsion(),), drive)
    assert again(tmp_path, scene) == scene


# -- what a file makes -------------------------------------------------------------------------------------------------


def test_a_prepared_packing_is_the_filled_box_at_its_energy_minimum(tmp_path):
    scene = read(tmp_path, PREPARED)
    drawn = pm.fill_box(pm.Box.cubic(20.0, 2), 40, packing_fraction=1.2, seed=3)
    expected = pm.quench(pm.Scene(drawn, scene.effects), force_tolerance=1e-10)
    assert scene.packing == expected.packing
    assert np.abs(pm.forces(scene)).max() < 1e-9


def test_bonds_of_contacts_are_those_of_bond_contacts_and_cuts_those_of_cut_fragments(tmp_path):
    whole = read(tmp_path, CRYSTAL + '[[effects]]\nkind = "bonds"\nof = "contacts"\nrest = "distance"\n')
    assert whole.effects[1] == pm.bond_contacts(whole.packing, rest="distance")
    cut = read(
        tmp_path,
        CRYSTAL
        + """
[[effects]]
kind = "bonds"
of = "contacts"
centers = 3
spanning = "allowed"
removed_fraction = 0.1
seed = 7
tension = { kind = "exponential-tension", stiffness = 2.0 }
damping = 1
""",
    )
    bonds = pm.bond_contacts(cut.packing, tension=pm.ExponentialTension(2.0), damping=1.0)
    how = {"centers": 3, "spanning": "allowed", "removed_fraction": 0.1, "seed": 7}
    assert cut.effects[1] == pm.cut_fragments(bonds, cut.packing, **how)


def test_another_seed_draws_packing_and_cuts_anew(tmp_path):
    text = PREPARED + '[[effects]]\nkind = "bonds"\nof = "contacts"\ncenters = 4\nseed = 1\n'
    (tmp_path / "a.toml").write_text(text)
    scene = pm.read_scene(tmp_path / "a.toml", seed=9)
    assert scene.packing == read(tmp_path, PREPARED.replace("seed = 3", "seed = 9")).packing
    bonds = pm.bond_contacts(scene.packing)
    assert scene.effects[1] == pm.cut_fragments(bonds, scene.packing, centers=4, seed=9)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("", r"effects\[1\].pairs must be given \(or of = 'contacts'\), got nothing"),
        ('of = "links"', r"effects\[1\].of must be one of 'contacts', got 'links'"),
        ('of = "contacts"\npairs = [[0, 1]]', r"effects\[1\].pairs must be left out with of = 'contacts'"),
        ('of = "contacts"\ncenters = 3', r"effects\[1\].centers must be left out without a seed, got 3"),
        ("pairs = [[0, 1]]", r"effects\[1\].rest_lengths must be given with pairs, got nothing"),
        ("pairs = [[0, 1]]\nrest_lengths = [1.0]\nseed = 1", r"effects\[1\].seed must be left out without of ="),
        ("pairs = [[0, 1, 2]]\nrest_lengths = [1.0]", r"effects\[1\].pairs\[0\] must hold 2 numbers, got 3"),
        ("pairs = [[0, 1]]\nrest_lengths = [-1.0]", r"effects\[1\].rest_lengths must be positive, got -1.0 for bond 0"),
        ('of = "contacts"\ntension = "rope"', r"effects\[1\].tension.kind must be one of"),
        ('of = "contacts"\nstiffness = 1.0', r"effects\[1\].stiffness must be a field of"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_bonds_is_named_by_its_path(tmp_path, fields, message):
    with pytest.raises((TypeError, ValueError), match=message):
        read(tmp_path, CRYSTAL + '[[effects]]\nkind = "bonds"\n' + fields + "\n")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ("frequency = 1.0", "drive.amplitude must be given, got nothing"),
        ("amplitude = 0.1", "drive.frequency must be given, or else relative_frequency, got neither"),
        ("amplitude = 0.1\nfrequency = 1.0\naxes = [0, 0]", "drive.axes must be two different axes"),
        ('amplitude = 0.1\nfrequency = 1.0\nmethod = "fire"', "drive.method.kind must be one of 'semi-implicit-euler'"),
        ("amplitude = 0.1\nfrequency = 1.0\nperiods = 2\nskip_periods = 2", "drive.skip_periods must be .* below 2"),
    ],
)
def test_what_is_wrong_with_a_drive_is_named_by_its_path(tmp_path, fields, message):
    with pytest.raises((TypeError, ValueError), match=message):
        read(tmp_path, CRYSTAL + '[drive]\nkind = "oscillatory-shear"\n' + fields + "\n")


# -- the scenes that ship ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_shipped_constants_are_those_of_the_material(shipped, name):
    made, scene = pm.material_constants(), shipped[name]
    of = {type(one).__name__: one for one in scene.effects}
    law = of["Repulsion"].law
    assert (law.law if name == "plateau" else law) == pm.DivergentRepulsion(made.stiffness)
    assert of["ContactDamping"].coefficient == made.damping
    assert of["BackgroundDamping"].rate == made.background_damping
    assert np.array_equal(scene.packing.mass_n, made.density * np.pi * scene.packing.radius_n**2)
    if name != "frictionless":
        assert of["Friction"] == pm.Friction(0.01, made.tangential_stiffness, made.tangential_damping)
    radii = sorted(set(scene.packing.radius_n))
    assert radii == pytest.approx([made.small_radius, made.large_radius], rel=1e-13)
    assert np.count_nonzero(scene.packing.radius_n == radii[0]) == 75


def test_shipped_scenes_differ_as_their_names_say(shipped):
    kinds = {name: {type(one).__name__ for one in scene.effects} for name, scene in shipped.items()}
    assert "Bonds" not in kinds["uncrosslinked"] | kinds["frictionless"] and "Friction" not in kinds["frictionless"]
    assert shipped["bulk"].packing == shipped["microgel"].packing == shipped["uncrosslinked"].packing
    bulk, cut = (shipped[name].effects[-1] for name in ("bulk", "microgel"))
    assert len(cut) < len(bulk) == len(pm.find_contacts(shipped["bulk"].packing))
    assert cut.compression == shipped["microgel"].effects[0].law
    assert isinstance(shipped["plateau"].effects[0].law, pm.PlateauRepulsion)


def test_the_command_prints_stresses_and_moduli_and_writes_them(tmp_path, capsys, shipped):
    arguments = ["run", "microgel", "--json", str(tmp_path / "a.json"), "--out", str(tmp_path / "a.npz")]
    assert execute(arguments) == 0
    said = capsys.readouterr().out
    for words in ("in-phase stress", "out-of-phase stress", "stress ", "G' ", "G'' ", "residual oscillation"):
        assert words in said
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers["in_phase_stress"] == pytest.approx(0.2 * numbers["storage_modulus"], rel=1e-12)
    assert numbers["stress"] == pytest.approx(np.hypot(numbers["in_phase_stress"], numbers["out_of_phase_stress"]))
    assert numbers["oscillation_ratio"] < 0.1 and numbers["fragments"] == 5
    assert pm.read_packing(tmp_path / "a.npz").particles == 150
    # the same by hand
    scene = shipped["microgel"]
    run = pm.oscillatory_shear(scene, amplitude=0.2, relative_frequency=0.025, pre_periods=2, periods=3, post_periods=1)
    assert run.moduli.storage == numbers["storage_modulus"]
    assert run.frequency == pytest.approx(pm.material_constants().frequency, rel=1e-8)


def test_the_command_prints_a_flow_curve_and_writes_it(tmp_path, capsys):
    drag = '[[effects]]\nkind = "background-damping"\nrate = 0.5\n'
    drive = '[drive]\nkind = "steady-shear"\nrates = [0.1, 0.2]\n'
    drive += "applied_strain = 0.4\nskip_strain = 0.2\nsamples = 40\n"
    (tmp_path / "flow.toml").write_text(CRYSTAL + drag + drive)
    arguments = ["run", str(tmp_path / "flow.toml"), "--json", str(tmp_path / "a.json")]
    assert execute(arguments) == 0
    assert "stress/pressure" in capsys.readouterr().out
    numbers = json.loads((tmp_path / "a.json").read_text())
    scene = pm.read_scene(tmp_path / "flow.toml")
    curve = pm.steady_shear(scene, rates=[0.1, 0.2], applied_strain=0.4, skip_strain=0.2, samples=40)
    assert numbers["stresses"] == curve.stress_r.tolist() and numbers["rates"] == [0.1, 0.2]
