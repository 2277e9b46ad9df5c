"""Facts about scene files: what they make, exact round trips, errors that name the field."""

import tomllib
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.files.records import kind_of

EFFECTS = """
[[effects]]
kind = "repulsion"
law = { kind = "harmonic", energy_scale = 1.0 }
"""
SQUARE = '[packing]\nkind = "lattice"\nname = "square"\n'


def read(folder, text):
    (folder / "scene.toml").write_text(text)
    return pm.read_scene(folder / "scene.toml")


def random_scene(**changes):
    packing = pm.random_packing(20, dimension=3, packing_fraction=0.7, seed=4, sizes=pm.Monodisperse(scatter=0.1))
    given_here = {"packing": packing, "effects": (pm.Repulsion(law=pm.Harmonic(2.5)),), "drive": None} | changes
    return pm.Scene(**given_here)


# -- the scenes that ship ----------------------------------------------------------------------------------------------


def test_default_scene_is_256_bidisperse_discs_with_every_strain_free():
    scene = pm.read_scene("default")
    assert (scene.packing.particles, scene.packing.dimension) == (256, 2)
    assert sorted(set(scene.packing.diameter_n)) == [1.0, 1.4]
    assert np.count_nonzero(scene.packing.diameter_n == 1.0) == 128
    assert scene.effects == (pm.Repulsion(law=pm.Harmonic(energy_scale=1.0)),)
    assert scene.drive == pm.JamDrive(pressure=1e-8, strain="free")


def test_default_is_the_first_scene_listed():
    assert next(iter(pm.list_scenes())) == "default"


@pytest.mark.parametrize("name", list(pm.list_scenes()))
def test_every_shipped_scene_says_what_it_is_and_can_be_read(name):
    assert len(pm.list_scenes()[name]) > 20
    scene = pm.read_scene(name)
    assert scene.drive is not None
    find = pm.find_shape_contacts if scene.packing.shapes.has_orientations else pm.find_contacts
    assert len(find(scene.packing)) > 0 or isinstance(scene.drive, pm.SimulateDrive)


def test_shipped_scenes_cover_every_law_drive_and_dimension_that_the_first_steps_offer():
    scenes = [pm.read_scene(name) for name in pm.list_scenes()]
    assert {type(getattr(scene.effects[0], "law", None)) for scene in scenes} >= {
        pm.Harmonic,
        pm.Hertz,
        pm.RepulsiveLennardJones,
    }
    assert {type(scene.drive) for scene in scenes} == {
        pm.CementDrive,
        pm.DeformDrive,
        pm.JamDrive,
        pm.OscillatoryShearDrive,
        pm.QuenchDrive,
        pm.RampStrainDrive,
        pm.SettleDrive,
        pm.ShearAtPressureDrive,
        pm.ShearStabilizeDrive,
        pm.SimulateDrive,
    }
    assert {scene.packing.dimension for scene in scenes} == {2, 3}
    assert {scene.drive.strain for scene in scenes if isinstance(scene.drive, pm.JamDrive)} == {"isotropic", "free"}


def test_a_shipped_scene_is_found_from_any_folder(tmp_path, monkeypatch):
    (tmp_path / "default").mkdir()
    monkeypatch.chdir(tmp_path)
    assert pm.read_scene("default").packing.particles == 256


# -- what a file makes -------------------------------------------------------------------------------------------------


def test_random_packing_of_a_file_is_the_one_that_the_function_makes(tmp_path):
    scene = read(
        tmp_path,
        EFFECTS
        + """
[packing]
kind = "random"
particles = 30
dimension = 2
packing_fraction = 0.84
seed = 17
sizes = { kind = "mixture", ratios = [1, 2], fractions = [2, 1], scatter = 0.03 }
lattice_vectors = [[1.0, 0.0], [0.25, 2.0]]
""",
    )
    sizes = pm.Mixture(ratios=(1, 2), fractions=(2, 1), scatter=0.03)
    shape = np.array([[1.0, 0.25], [0.0, 2.0]])
    assert scene.packing == pm.random_packing(
        30, dimension=2, packing_fraction=0.84, seed=17, sizes=sizes, box=pm.Box(shape)
    )
    assert scene.drive is None


def test_another_seed_gives_the_packing_of_that_seed():
    sizes = pm.Bidisperse(ratio=1.4, fraction="50:50")
    expected = pm.random_packing(256, dimension=2, packing_fraction=0.87, seed=12, sizes=sizes)
    assert pm.read_scene("default", seed=12).packing == expected


def test_another_seed_is_refused_where_nothing_is_random():
    with pytest.raises(ValueError, match="^seed must be left out for a packing that is not random, got 3"):
        pm.read_scene("kagome", seed=3)


def test_a_kind_alone_stands_for_its_defaults(tmp_path):
    scene = read(
        tmp_path,
        'effects = [{ kind = "repulsion", law = "hertz" }]\n'
        '[packing]\nkind = "random"\nparticles = 8\npacking_fraction = 1\nseed = 0\nsizes = "monodisperse"\n',
    )
    assert scene.effects == (pm.Repulsion(law=pm.Hertz()),)
    assert set(scene.packing.radius_n) == {0.5}


def test_lattice_of_a_file_is_the_one_that_the_function_makes(tmp_path):
    scene = read(
        tmp_path,
        EFFECTS + '[packing]\nkind = "lattice"\nname = "fcc"\nsupercell = [[1, 1, 0], [0, 2, 0], [0, 0, 3]]\n'
        "relative_overlap = 0.01\ndiameter = 2\n",
    )
    supercell = np.array([[1, 0, 0], [1, 2, 0], [0, 0, 3]])
    assert scene.packing == pm.lattice_packing("fcc", supercell=supercell, relative_overlap=0.01, diameter=2.0)


@pytest.mark.parametrize("ending", [".npz", ".gsd", ".txt", ".data", ".dump", ".extxyz", ".csv", ".vtp"])
def test_packing_file_is_found_beside_its_scene_file(tmp_path, monkeypatch, ending):
    packing = random_scene().packing
    pm.write_packing(packing, tmp_path / f"start{ending}")
    monkeypatch.chdir("/")
    assert read(tmp_path, EFFECTS + f'[packing]\nkind = "file"\npath = "start{ending}"\n').packing == packing


def test_a_scene_says_what_a_packing_file_of_another_program_does_not(tmp_path):
    (tmp_path / "places").write_text("x,y\n0.5,0.5\n1.5,0.75\n")
    more = 'format = "csv"\nradius = 0.5\nlattice_vectors = [[3, 0], [0.5, 2]]\n'
    scene = read(tmp_path, EFFECTS + f'[packing]\nkind = "file"\npath = "places"\n{more}')
    expected = pm.Packing([[0.5, 0.5], [1.5, 0.75]], 0.5, pm.Box([[3.0, 0.5], [0.0, 2.0]]))
    assert scene.packing == expected
    for field, wrong in (("radius = 0.5", "radius = -1"), ('format = "csv"', 'format = "pdb"')):
        with pytest.raises(ValueError, match=f"packing.{field.split()[0]} must be"):
            read(tmp_path, EFFECTS + f'[packing]\nkind = "file"\npath = "places"\n{more.replace(field, wrong)}')


def test_inline_packing_has_one_lattice_vector_a_line(tmp_path):
    scene = read(
        tmp_path,
        EFFECTS + '[packing]\nkind = "inline"\nlattice_vectors = [[4, 0], [0.5, 3]]\n'
        "positions = [[0, 0], [1, 2]]\nradii = [0.5, 0.25]\n",
    )
    assert scene.packing == pm.Packing([[0, 0], [1, 2]], [0.5, 0.25], pm.Box([[4, 0.5], [0, 3]]))


# -- round trips -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scene",
    [
        random_scene(),
        random_scene(drive=pm.QuenchDrive(force_tolerance=3e-11)),
        random_scene(drive=pm.JamDrive(pressure=1e-7, strain="isotropic")),
        random_scene(drive=pm.ShearStabilizeDrive(pressure=1e-3, force_tolerance=1e-8)),
        random_scene(drive=pm.CementDrive(pressure=1e-7, orders=3, seed=4, step=0.1, freeze="clusters")),
        random_scene(effects=(pm.Repulsion(law=pm.PowerLaw(0.1, 2.25)), pm.ContactDamping(0.3))),
        random_scene(effects=(pm.Repulsion(law=pm.LinearSpring(3.0)),)),
        pm.Scene(pm.lattice_packing("kagome"), (pm.Repulsion(law=pm.RepulsiveLennardJones()),)),
    ],
    ids=["plain", "quench", "jam", "shear-stabilize", "cement", "damped", "spring", "lattice"],
)
def test_a_scene_is_read_back_equal(tmp_path, scene):
    pm.write_scene(scene, tmp_path / "a.toml")
    assert pm.read_scene(tmp_path / "a.toml") == scene


@pytest.mark.parametrize("name", list(pm.list_scenes()))
def test_a_shipped_scene_written_out_is_read_back_equal(tmp_path, name):
    pm.write_scene(pm.read_scene(name), tmp_path / "a.toml", description="a copy")
    assert pm.read_scene(tmp_path / "a.toml") == pm.read_scene(name)


@pm.law
class QuarticWell(NamedTuple):
    energy_scale: float = 1.0
    shape: float = 4.0

    def energy(self, distance, contact_distance):
        return self.energy_scale * (1.0 - distance / contact_distance) ** self.shape

    def first(self, distance, contact_distance):
        overlap = 1.0 - distance / contact_distance
        return -self.energy_scale * self.shape * overlap ** (self.shape - 1.0) / contact_distance

    def second(self, distance, contact_distance):
        overlap = 1.0 - distance / contact_distance
        return self.energy_scale * self.shape * (self.shape - 1.0) * overlap ** (self.shape - 2.0) / contact_distance**2


def test_a_registered_law_of_ones_own_is_written_and_read_by_its_name(tmp_path):
    scene = random_scene(effects=(pm.Repulsion(law=QuarticWell(2.0, 3.0)),))
    pm.write_scene(scene, tmp_path / "a.toml")
    assert 'kind = "quartic-well"' in (tmp_path / "a.toml").read_text()
    assert pm.read_scene(tmp_path / "a.toml") == scene


@pytest.mark.parametrize(
    "drive",
    [
        pm.JamDrive(
            strain="isotropic", method=pm.StepHalving(increment=1e-3, minimizer=pm.DampedDynamics(damping=0.5))
        ),
        pm.JamDrive(pressure=1e-6, method=pm.Decompression(factor=0.3)),
        pm.JamDrive(method=pm.ProgramChain(solver="highs")),
        pm.JamDrive(pressure=1e-7, method=pm.HardVertex(start_packing_fraction=0.9)),
        pm.QuenchDrive(force_tolerance=1e-6, method=pm.ConjugateGradient()),
        pm.QuenchDrive(method=pm.Newton(largest_step=0.05)),
    ],
)
def test_a_drive_names_its_method_and_its_parameters(tmp_path, drive):
    scene = random_scene().replace(drive=drive)
    pm.write_scene(scene, tmp_path / "a.toml")
    read = pm.read_scene(tmp_path / "a.toml").drive
    assert read == drive
    assert type(read.method) is type(drive.method)


# -- refusals, each naming the field -----------------------------------------------------------------------------------

RANDOM = '[packing]\nkind = "random"\nparticles = 8\npacking_fraction = 0.8\nseed = 1\n'

INLINE = '[packing]\nkind = "inline"\nlattice_vectors = [[1, 0], [0, 1]]\n'


def random(line, **exchanged):
    text = RANDOM
    for old, new in exchanged.items():
        text = text.replace(f"{old} = ", f"{old} = {new} #")
    return f"{text}{line}\n{EFFECTS}"


def square(line):
    return f"{SQUARE}{line}\n{EFFECTS}"


def inline(line):
    return f"{INLINE}{line}\n{EFFECTS}"


def effects(text):
    return SQUARE + "[[effects]]\n" + text


def law(table):
    return effects(f'kind = "repulsion"\nlaw = {{ {table} }}\n')


def drive(text):
    return f"{SQUARE}{EFFECTS}[drive]\n{text}\n"


REFUSED = {
    "not TOML": ("[packing]\nkind = \n", "path must name a TOML file: .*line 2"),
    "no packing": (EFFECTS, "packing must be given, got nothing"),
    "no effects": (SQUARE, r"effects must be a list of tables \(\[\[effects\]\]\), got nothing"),
    "one effect, no list": (SQUARE + '[effects]\nkind = "repulsion"\n', "effects must be a list of tables"),
    "unknown top field": ("units = 1\n" + SQUARE + EFFECTS, "units must be a field of a scene .description, packing"),
    "description": ("description = 3\n" + SQUARE + EFFECTS, "description must be a string, got 3"),
    "packing without kind": ("[packing]\nparticles = 3\n" + EFFECTS, "packing.kind must be one of .*, got nothing"),
    "packing of unknown kind": ('packing = "heap"\n' + EFFECTS, "packing.kind must be one of .*'file', .* got 'heap'"),
    "packing no table": ("packing = 3\n" + EFFECTS, "packing must be a table with a kind, got 3"),
    "missing field": (
        '[packing]\nkind = "random"\nparticles = 8\nseed = 1\n' + EFFECTS,
        "packing.packing_fraction must be given, got nothing",
    ),
    "unknown packing field": (random("weight = 1"), "packing.weight must be a field of random .particles"),
    "wrong type": (random("", particles='"8"'), "packing.particles must be an integer, got '8'"),
    "boolean for number": (random("", packing_fraction="true"), "packing.packing_fraction must be a number, got True"),
    "fraction for count": (random("", particles="8.0"), "packing.particles must be an integer, got 8.0"),
    "no particles": (random("", particles="0"), "packing.particles must be an integer at least 1, got 0"),
    "negative fraction": (random("", packing_fraction="-0.8"), "packing.packing_fraction must be .* got -0.8"),
    "nan": (random("", packing_fraction="nan"), "packing.packing_fraction must be a finite number .* got nan"),
    "four dimensions": (random("dimension = 4"), "packing.dimension must be an integer .* got 4"),
    "sizes kind": (random('sizes = "two"'), "packing.sizes.kind must be one of 'bidisperse', .* 'two'"),
    "sizes field": (
        random('sizes = { kind = "uniform", width = 1 }'),
        "packing.sizes.width must be a field of uniform .ratio",
    ),
    "sizes value": (
        random('sizes = { kind = "bidisperse", ratio = 0.5 }'),
        "packing.sizes.ratio must be a finite number above 1, got 0.5",
    ),
    "sizes entry": (
        random('sizes = { kind = "mixture", ratios = [1, "a"], fractions = [1, 1] }'),
        r"packing.sizes.ratios\[1\] must be a number, got 'a'",
    ),
    "vectors": (
        random("lattice_vectors = [[1, 0], [0]]"),
        "packing.lattice_vectors must hold rows of one length",
    ),
    "singular vectors": (
        random("lattice_vectors = [[1, 0], [2, 0]]"),
        "packing.lattice_vectors must have linearly independent columns",
    ),
    "lattice name": (
        SQUARE.replace("square", "cubic") + EFFECTS,
        "packing.name must be one of 'triangular'.* got 'cubic'",
    ),
    "lattice repeats": (square("repeats = [2, 0]"), r"packing.repeats\[1\] must be an integer at least 1, got 0"),
    "missing packing file": (
        '[packing]\nkind = "file"\npath = "no.npz"\n' + EFFECTS,
        "packing.path must name an existing file",
    ),
    "inline shape": (
        inline("positions = [[0, 0]]\nradii = [1, 2]"),
        "packing.radii must have one entry per particle",
    ),
    "inline row": (
        inline("positions = [[0, 0], [1]]\nradii = [1, 2]"),
        "packing.positions must hold rows of one length",
    ),
    "inline radius": (
        inline("positions = [[0, 0]]\nradii = [-1]"),
        "packing.radii must be positive, got -1.0 for particle 0",
    ),
    "inline entry": (
        inline('positions = [[0, "x"]]\nradii = [1]'),
        r"packing.positions\[0\]\[1\] must be a number, got 'x'",
    ),
    "inline, no particle": (inline("positions = []\nradii = []"), "packing.positions must"),
    "effect kind": (effects('kind = "repel"\n'), r"effects\[0\].kind must be one of .*'repulsion'.* got 'repel'"),
    "second effect": (
        SQUARE + EFFECTS + '[[effects]]\nkind = "contact-damping"\ncoefficient = -1\n',
        r"effects\[1\].coefficient must not be negative",
    ),
    "effect no table": ("effects = [3]\n" + SQUARE, r"effects\[0\] must be a table with a kind, got 3"),
    "law kind": (law('kind = "no-such-law"'), r"effects\[0\].law.kind must be one of .* got 'no-such-law'"),
    "law without kind": (law("energy_scale = 1"), r"effects\[0\].law.kind must be one of .* got nothing"),
    "law field": (
        law('kind = "harmonic", stiffness = 1'),
        r"effects\[0\].law.stiffness must be a field of harmonic .energy_scale",
    ),
    "law value": (
        law('kind = "harmonic", energy_scale = -1'),
        r"effects\[0\].law.energy_scale must be positive, got -1.0",
    ),
    "law infinite": (
        law('kind = "harmonic", energy_scale = inf'),
        r"effects\[0\].law.energy_scale must be a finite number",
    ),
    "law text": (
        law('kind = "harmonic", energy_scale = "1"'),
        r"effects\[0\].law.energy_scale must be a number, got '1'",
    ),
    "drive kind": (
        drive('kind = "push"'),
        # and those that somebody registered
        "drive.kind must be one of 'cement', 'creep', .*'jam', 'oscillatory-shear', .*'steady-shear'.*, got 'push'",
    ),
    "drive field": (drive('kind = "jam"\ntolerance = 1'), "drive.tolerance must be a field of jam-drive"),
    "drive method": (
        drive('kind = "jam"\nmethod = "fire"'),
        "drive.method.kind must be one of 'decompression', .*'fire'",
    ),
    "drive method of another drive": (
        drive('kind = "quench"\nmethod = "hard-vertex"'),
        "drive.method.kind must be one",
    ),
    "drive method field": (
        drive('kind = "jam"\nmethod = { kind = "step-halving", step = 1 }'),
        "drive.method.step must be a field of step-halving .start_packing_fraction, increment",
    ),
    "drive method value": (
        drive('kind = "jam"\nmethod = { kind = "step-halving", increment = -1 }'),
        "drive.method.increment must be a finite number above 0",
    ),
    "drive method where there is none": (
        drive('kind = "shear-stabilize"\nmethod = "fire"'),
        "drive.method must be a field of shear-stabilize-drive .pressure, force_tolerance",
    ),
    "stabilizing pressure": (
        drive('kind = "shear-stabilize"\npressure = 0.0'),
        "drive.pressure must be a finite number above 0",
    ),
    "drive value": (drive('kind = "jam"\npressure = -1'), "drive.pressure must be a finite number above 0"),
    "drive choice": (
        drive('kind = "jam"\nstrain = "loose"'),
        "drive.strain must be one of 'isotropic', 'free', got 'loose'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_scene_is_refused_naming_the_field_and_the_file(tmp_path, case):
    text, message = REFUSED[case]
    with pytest.raises((TypeError, ValueError), match=f"^{message}") as caught:
        read(tmp_path, text)
    assert "scene.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_scene_file_is_refused_by_name(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"path must name an existing file, got .*none\.toml"):
        pm.read_scene(tmp_path / "none.toml")


def test_unknown_shipped_scene_is_refused_with_the_names_that_exist():
    with pytest.raises(FileNotFoundError, match=r"a shipped scene \(default, .*kagome.*\), got 'defualt'"):
        pm.read_scene("defualt")


def test_file_that_is_not_text_is_refused(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"\x80\xff")
    with pytest.raises(ValueError, match=r"path must name a TOML file: .*a\.toml"):
        pm.read_scene(tmp_path / "a.toml")


def test_a_description_is_written_whatever_it_holds(tmp_path):
    description = 'quotes " and \\, lines\nand tabs\t, \x7f, é, 圆'
    pm.write_scene(random_scene(), tmp_path / "a.toml", description=description)
    assert tomllib.loads((tmp_path / "a.toml").read_text(encoding="utf-8"))["description"] == description


def test_kinds_are_class_names_in_lower_case_with_hyphens():
    names = {pm.RepulsiveLennardJones: "repulsive-lennard-jones", pm.Hertz: "hertz", pm.LogNormal: "log-normal"}
    assert {cls: kind_of(cls) for cls in names} == names
