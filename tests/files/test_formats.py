"""Facts about every file format: what it keeps comes back to the last bit, and what it does not keep is refused."""

import re
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.files.packings import FORMATS

TRAJECTORIES = [".gsd", ".dump", ".extxyz"]
ENDINGS = [".npz", ".gsd", ".txt", ".csv", ".data", ".dump", ".extxyz", ".vtp"]
BOXES = {
    "square": np.diag([7.0, 7.3, 7.7]),
    "tilted": np.array([[7.0, 2.1, -1.3], [0.0, 7.3, 0.9], [0.0, 0.0, 7.7]]),
    "far": np.array([[7.0, -9.1, 16.3], [0.0, 7.3, -5.9], [0.0, 0.0, 7.7]]),
    "general": np.array([[6.9, 0.4, -1.3], [0.7, 7.1, 0.9], [-0.3, 0.2, 7.7]]),
    "left-handed": np.array([[6.9, -8.4, -1.3], [7.7, 1.1, 0.9], [-0.3, 0.2, 7.7]]),
}


def discs(dimension=2, box="tilted", seed=1, particles=23, masses=False):
    """Return particles at random, some of them outside the cell."""
    rng = np.random.default_rng(seed)
    lattice = BOXES[box][:dimension, :dimension]
    place = rng.uniform(-1.0, 2.0, (particles, dimension)) @ lattice.T
    radius = rng.choice([0.3, 1 / 3, 0.7], particles)
    return pm.Packing(place, radius, pm.Box(lattice), mass_n=rng.uniform(0.1, 9.0, particles) if masses else None)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("ending", ENDINGS)
def test_positions_radii_and_boxes_come_back_to_the_last_bit(tmp_path, ending, box, dimension):
    packing = discs(dimension, box)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ending", [one for one in ENDINGS if one != ".data"])
def test_masses_come_back_to_the_last_bit(tmp_path, ending, dimension):
    packing = discs(dimension, masses=True)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


def test_masses_of_a_lammps_data_file_come_back_by_way_of_densities(tmp_path):
    packing = discs(masses=True, particles=400)
    pm.write_packing(packing, tmp_path / "a.data")
    found = pm.read_packing(tmp_path / "a.data")
    assert found.replace(mass_n=None) == packing.replace(mass_n=None)
    np.testing.assert_allclose(found.mass_n, packing.mass_n, rtol=3e-16, atol=0.0)
    assert (found.mass_n == packing.mass_n).mean() > 0.7


def of_kinds(packing, seed=11):
    """Return the packing with kinds among 0 to 63, some of which no particle has."""
    return packing.replace(kind_n=np.random.default_rng(seed).choice([0, 1, 5, 63], packing.particles))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ending", [one for one in ENDINGS if one != ".txt"])
@pytest.mark.parametrize("sizes", ["few", "many"])
def test_kinds_come_back_exactly_and_without_a_word(tmp_path, ending, dimension, sizes):
    packing = of_kinds(discs(dimension))
    if sizes == "many":
        packing = packing.replace(radius_n=np.linspace(0.3, 0.7, 23))
    pm.write_packing(packing, tmp_path / f"a{ending}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = pm.read_packing(tmp_path / f"a{ending}")
    assert found == packing and found.kind_n.tolist() == packing.kind_n.tolist()
    # and of what was read a file is written again
    (again,) = pm.read_trajectory(tmp_path / f"a{ending}")
    pm.write_packing(again, tmp_path / f"b{ending}")
    assert pm.read_packing(tmp_path / f"b{ending}") == packing


@pytest.mark.parametrize("ending", [".csv", ".dump", ".extxyz", ".gsd", ".npz", ".vtp"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_kinds_of_spheroids_with_masses_and_fields_come_back(tmp_path, ending, dimension):
    rng = np.random.default_rng(3)
    shapes = pm.Spheroids(rng.choice([0.7, 1.5], 23), rng.normal(size=(23, dimension)))
    packing = of_kinds(discs(dimension, masses=True)).replace(shapes=shapes)
    snapshot = pm.Snapshot(packing, fields(dimension), step=5)
    pm.write_packing(snapshot, tmp_path / f"a{ending}")
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    assert found.packing == packing and found.fields.keys() - {"type"} == snapshot.fields.keys()


@pytest.mark.parametrize("ending", [".npz", ".gsd", ".vtp"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_kinds_of_rigid_bodies_come_back(tmp_path, ending, dimension):
    packing = pm.random_packing(23, dimension=dimension, packing_fraction=0.4, seed=1, shapes=pm.Dimer())
    packing = of_kinds(packing)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


@pytest.mark.parametrize("ending", TRAJECTORIES)
def test_kinds_may_change_along_a_trajectory(tmp_path, ending):
    frames = [of_kinds(discs(), seed) for seed in range(3)] + [discs()]
    pm.write_trajectory(frames, tmp_path / f"a{ending}")
    assert [one.packing for one in pm.read_trajectory(tmp_path / f"a{ending}")] == frames


def test_a_plain_table_is_refused_where_there_are_several_kinds(tmp_path):
    packing = of_kinds(discs())
    with pytest.raises(
        ValueError, match=r"must be of one kind of particles for .txt files \(only .npz, .*got 64 kinds"
    ):
        pm.write_packing(packing, tmp_path / "a.txt")
    pm.write_packing(packing, tmp_path / "a.txt", drop=True)
    assert pm.read_packing(tmp_path / "a.txt") == discs()


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_packing_of_one_kind_is_written_as_one_without_kinds(tmp_path, ending):
    for name, packing in {"a": discs(), "b": discs().replace(kind_n=np.zeros(23, dtype=int))}.items():
        pm.write_packing(packing, tmp_path / f"{name}{ending}")
    assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


def test_only_an_npz_file_with_kinds_is_of_the_version_that_older_readers_refuse(tmp_path):
    for packing, version in ((discs(), 1), (of_kinds(discs()), 9)):
        pm.write_packing(packing, tmp_path / "a.npz")
        assert np.load(tmp_path / "a.npz")["format_version"] == version


def test_types_of_lammps_are_kinds_from_one(tmp_path):
    packing = of_kinds(discs())
    pm.write_packing(packing, tmp_path / "a.data")
    lines = (tmp_path / "a.data").read_text().splitlines()
    assert "types are kinds" in lines[0] and "64 atom types" in lines
    first = lines.index("Atoms # sphere") + 2
    assert [int(line.split()[1]) - 1 for line in lines[first : first + 23]] == packing.kind_n.tolist()
    pm.write_packing(packing, tmp_path / "a.dump")
    (found,) = pm.read_trajectory(tmp_path / "a.dump")
    assert (found.fields["type"] - 1).tolist() == packing.kind_n.tolist()


def test_a_field_of_types_beside_kinds_is_kept_by_a_dump_and_refused_by_a_data_file(tmp_path):
    snapshot = pm.Snapshot(of_kinds(discs()), {"type": np.arange(1, 24)})
    pm.write_packing(snapshot, tmp_path / "a.dump")
    (found,) = pm.read_trajectory(tmp_path / "a.dump")
    assert found.packing == snapshot.packing and found.fields["type"].tolist() == list(range(1, 24))
    with pytest.raises(ValueError, match="packing must have no field type beside kinds of particles"):
        pm.write_packing(snapshot, tmp_path / "a.data")
    pm.write_packing(snapshot, tmp_path / "a.data", drop=True)
    assert pm.read_packing(tmp_path / "a.data") == snapshot.packing


def test_types_beyond_kinds_in_a_file_of_kinds_are_refused(tmp_path):
    pm.write_packing(of_kinds(discs(particles=3), 2), tmp_path / "a.data")
    text = (tmp_path / "a.data").read_text()
    (tmp_path / "a.data").write_text(re.sub(r"^1 \d+ ", "1 65 ", text, flags=re.MULTILINE))
    with pytest.raises(ValueError, match="atoms must be of types 1 to 64 where types are kinds"):
        pm.read_packing(tmp_path / "a.data")


@pytest.mark.parametrize(
    ("words", "is_field"),
    [("0 1", False), ("1 2", False), ("1 64", True), ("-1 0", True), ("0.5 1.5", True), ("a b", True)],
)
@pytest.mark.parametrize("ending", [".csv", ".extxyz", ".dump"])
def test_a_column_of_that_name_is_a_field_where_it_holds_no_kinds(tmp_path, ending, words, is_field):
    one, other = words.split()
    letter = {"a": "S", "0.5": "R"}.get(one, "I")
    text = {
        ".csv": f"# lattice 9 0\n# lattice 0 9\nx,y,radius,kind\n1,1,0.5,{one}\n3,3,0.5,{other}\n",
        ".extxyz": f'2\nLattice="9 0 0 0 9 0 0 0 1" pbc="T T F" Properties=pos:R:3:radius:R:1:kind:{letter}:1\n'
        f"1 1 0 0.5 {one}\n3 3 0 0.5 {other}\n",
        ".dump": "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n-0.5 0.5\n"
        f"ITEM: ATOMS id x y z radius kind\n1 1 1 0 0.5 {one}\n2 3 3 0 0.5 {other}\n",
    }[ending]
    (tmp_path / f"a{ending}").write_text(text)
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    assert ("kind" in found.fields) == is_field
    assert found.packing.kinds == (1 if is_field else 1 + int(other))


@pytest.mark.parametrize("ending", [".csv", ".extxyz", ".dump", ".vtp"])
def test_a_field_that_would_be_read_back_as_kinds_is_refused(tmp_path, ending):
    with pytest.raises(ValueError, match="packing must have no fields kind"):
        pm.write_packing(pm.Snapshot(discs(), {"kind": np.arange(23)}), tmp_path / f"a{ending}")
    with pytest.raises(ValueError, match="fields must have names, and of their own, got 'kind_n'"):
        pm.Snapshot(discs(), {"kind_n": np.arange(23)})


@pytest.mark.parametrize("ending", [".csv", ".dump", ".extxyz", ".gsd", ".npz", ".vtp"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_spheroids_come_back_to_the_last_bit(tmp_path, ending, dimension):
    rng = np.random.default_rng(3)
    packing = discs(dimension)
    shapes = pm.Spheroids(rng.uniform(0.4, 2.5, 23), rng.normal(size=(23, dimension)))
    packing = packing.replace(shapes=shapes)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


def fields(dimension, particles=23, seed=5):
    rng = np.random.default_rng(seed)
    return {
        "velocity_nd": rng.normal(size=(particles, dimension)),
        "spin_nk": rng.normal(size=(particles, 1 if dimension == 2 else 3)),
        "force_nd": 1e-9 * rng.normal(size=(particles, dimension)),
        "stress": rng.normal(size=(particles, 6)),
        "temperature": rng.normal(size=particles),
        "age": rng.integers(0, 10**12, particles),
    }


@pytest.mark.parametrize("ending", [".csv", ".dump", ".extxyz", ".gsd", ".npz", ".vtp"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("box", ["tilted", "left-handed"])
def test_fields_and_steps_come_back_to_the_last_bit(tmp_path, ending, dimension, box):
    snapshot = pm.Snapshot(discs(dimension, box), fields(dimension), step=1234567)
    pm.write_packing(snapshot, tmp_path / f"a{ending}")
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    types = {"type": found.fields["type"]} if ending == ".dump" else {}
    assert found == pm.Snapshot(snapshot.packing, {**snapshot.fields, **types}, step=1234567)
    assert all(array.dtype == found.fields[name].dtype for name, array in snapshot.fields.items())
    with pytest.warns(UserWarning, match=r"left out, .*: velocities; forces; spins; fields (?=.*stress)(?=.*age)"):
        assert pm.read_packing(tmp_path / f"a{ending}") == snapshot.packing


@pytest.mark.parametrize("dimension", [2, 3])
def test_velocities_and_spins_of_a_lammps_data_file_come_back(tmp_path, dimension):
    own = {name: array for name, array in fields(dimension).items() if name in ("velocity_nd", "spin_nk")}
    types = np.random.default_rng(1).integers(1, 4, 23)
    snapshot = pm.Snapshot(discs(dimension), {**own, "type": types}, step=7)
    pm.write_packing(snapshot, tmp_path / "a.data")
    (found,) = pm.read_trajectory(tmp_path / "a.data")
    assert found == snapshot


def bonded(dimension=2, box="tilted", tangential=0.0, **changes):
    """Return discs that overlap, with springs between those that touch, links between others, and contact forces."""
    rng = np.random.default_rng(7)
    lattice = BOXES[box][:dimension, :dimension]
    packing = pm.random_packing(40, dimension=dimension, packing_fraction=0.9, box=lattice, rng=rng)
    contacts = pm.find_contacts(packing)
    apart = contacts.i_c != contacts.j_c
    first, rest = np.flatnonzero(apart)[:5], np.flatnonzero(apart)[5:15]
    links = pm.Links(*(one[first] for one in (contacts.i_c, contacts.j_c, contacts.image_cd, contacts.distance_c)))
    bonds = pm.Bonds(
        *(one[rest] for one in (contacts.i_c, contacts.j_c, contacts.image_cd, contacts.contact_distance_c)),
        tangential_stiffness=tangential, **changes,
    )  # fmt: skip
    return packing.replace(links=links), bonds


@pytest.mark.parametrize("ending", [".npz", ".gsd", ".vtp", ".data"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("box", ["tilted", "general"])
def test_links_and_springs_come_back_to_the_last_bit(tmp_path, ending, dimension, box):
    packing, bonds = bonded(dimension, box)
    pm.write_packing(pm.Snapshot(packing, bonds=bonds), tmp_path / f"a{ending}")
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    assert found.packing == packing and found.bonds == (bonds,)


@pytest.mark.parametrize("ending", [".npz", ".gsd", ".vtp"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_contact_forces_tangential_springs_and_bodies_come_back(tmp_path, ending, dimension):
    packing, bonds = bonded(dimension, tangential=0.5, damping=0.1, tension=pm.ExponentialTension())
    packing = packing.replace(links=None)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5)))
    contacts = pm.find_contacts(packing)
    count = min(len(contacts), 9)
    springs = pm.TangentialDisplacements(
        contacts.i_c[:count], contacts.j_c[:count], contacts.image_cd[:count],
        1e-3 * np.random.default_rng(2).normal(size=(count, 1 if dimension == 2 else 3)),
    )  # fmt: skip
    packing = packing.replace(tangential=springs)
    forces = pm.contact_forces(scene.replace(packing=packing))
    assert np.abs(forces.tangential_cd).max() > 0.0
    pm.write_packing(pm.Snapshot(packing, bonds=bonds, contact_forces=forces), tmp_path / f"a{ending}")
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    assert found.packing == packing and found.bonds == (bonds,)
    np.testing.assert_array_equal(found.contact_forces.normal_c, forces.normal_c)
    np.testing.assert_array_equal(found.contact_forces.tangential_cd, forces.tangential_cd)
    with pytest.warns(UserWarning, match=f"springs .bonds.; forces of {len(forces.normal_c)} contacts"):
        pm.read_packing(tmp_path / f"a{ending}")
    body = pm.rigid_packing(discs(dimension, particles=2), [0, 0])
    pm.write_packing(body, tmp_path / f"b{ending}")
    assert pm.read_packing(tmp_path / f"b{ending}") == body


# -- what is not kept --------------------------------------------------------------------------------------------------


def everything():
    packing, bonds = bonded(2)
    contacts = pm.find_contacts(packing)
    springs = pm.TangentialDisplacements(contacts.i_c[:1], contacts.j_c[:1], contacts.image_cd[:1], [[0.1]])
    packing = packing.replace(tangential=springs)
    zero = np.zeros(len(contacts))
    forces = pm.ContactData(contacts.i_c, contacts.j_c, contacts.image_cd, zero, np.zeros((len(contacts), 2)))
    return pm.Snapshot(packing, {"velocity_nd": packing.position_nd, "heat": zero[:1].repeat(40)}, bonds, forces, 3)


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_a_format_does_not_keep_is_refused_by_name_unless_it_is_dropped(tmp_path, ending):
    whole, path = everything(), tmp_path / f"a{ending}"
    kept = next(one for one in FORMATS.values() if ending in one.endings)
    lost = [what for what, _, _ in kept.not_kept(whole)]
    assert bool(lost) == (ending not in (".npz", ".gsd", ".vtp"))
    if lost:
        with pytest.raises(
            ValueError, match=rf"packing must have no .* for {ending} files \(only .* keep.? them; drop=T"
        ):
            pm.write_packing(whole, path)
        assert list(tmp_path.iterdir()) == []
    pm.write_packing(whole, path, drop=True)
    (found,) = pm.read_trajectory(path)
    assert found.packing.box == whole.packing.box
    np.testing.assert_array_equal(found.packing.position_nd, whole.packing.position_nd)
    assert len(found.packing.links) == (0 if "links" in lost else 5)
    assert len(found.bonds) == ("springs" not in lost)
    assert ("velocity_nd" in found.fields) == (ending != ".txt")
    assert found.step == (None if "step" in lost else 3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tangential": 0.5}, "springs without tangential ones for .data files .*, got a stiffness of 0.5"),
        ({"damping": 0.5}, "springs without dashpots for .data files"),
        ({"tension": pm.LinearSpring(2.0)}, "springs of LinearSpring alone, the same for both signs for .data files"),
        ({"breaks_at": pm.BondLimits(stretch=0.1)}, "springs that never break for .data files .*, got limits: stretch"),
    ],
)
def test_springs_that_lammps_has_not_are_refused(tmp_path, changes, words):
    packing, bonds = bonded(**changes)
    with pytest.raises(ValueError, match=words):
        pm.write_packing(pm.Snapshot(packing, bonds=bonds), tmp_path / "a.data")
    pm.write_packing(pm.Snapshot(packing, bonds=bonds), tmp_path / "a.data", drop=True)
    assert len(pm.read_trajectory(tmp_path / "a.data")[0].bonds[0]) == len(bonds)


def test_links_beyond_the_nearest_image_are_refused_by_lammps_data_files(tmp_path):
    packing = pm.Packing([[0.0, 0.0], [1.0, 0.0]], 0.5, pm.Box.cubic(4.0, 2), pm.Links([0], [1], [[1, 0]], [5.0]))
    with pytest.raises(ValueError, match="no links or springs to other than the nearest image for .data files"):
        pm.write_packing(packing, tmp_path / "a.data")


# -- trajectories ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", TRAJECTORIES)
def test_a_trajectory_is_written_from_a_generator_and_read_by_frame(tmp_path, ending):
    packings = [discs(2, box, seed=k, particles=5 + k) for k, box in enumerate(BOXES)]
    pm.write_trajectory((one for one in packings), tmp_path / f"a{ending}")
    found = pm.read_trajectory(tmp_path / f"a{ending}")
    assert len(found) == 5 and [one.packing for one in found] == packings
    assert found[-2].packing == packings[3] and [one.step for one in found[1::2]] == [1, 3]
    assert pm.read_packing(tmp_path / f"a{ending}") == packings[-1]
    assert pm.read_packing(tmp_path / f"a{ending}", frame=2) == packings[2]
    with pytest.raises(ValueError, match=f"a{ending}.*frame must be below 5, the number of frames, got 5"):
        pm.read_packing(tmp_path / f"a{ending}", frame=5)


@pytest.mark.parametrize("ending", [".npz", ".csv", ".data"])
def test_a_format_of_one_packing_takes_no_trajectory(tmp_path, ending):
    with pytest.raises(
        ValueError, match=r"path must be of a format that holds several packings \(.gsd, .dump, .extxyz"
    ):
        pm.write_trajectory([discs()], tmp_path / f"a{ending}")
    pm.write_packing(discs(), tmp_path / f"a{ending}")
    assert len(pm.read_trajectory(tmp_path / f"a{ending}")) == 1


def test_an_empty_or_broken_trajectory_leaves_no_file(tmp_path):
    for wrong, words in (([], "at least one packing"), ([discs(), 3], r"snapshots\[1\] must be a Packing, got 3")):
        with pytest.raises((ValueError, TypeError), match=words):
            pm.write_trajectory(wrong, tmp_path / "a.dump")
    assert list(tmp_path.iterdir()) == []


def test_the_format_may_be_named_where_the_ending_does_not_say_it(tmp_path):
    pm.write_packing(discs(), tmp_path / "data.jammed", format="lammps-data")
    assert pm.read_packing(tmp_path / "data.jammed", format="lammps-data") == discs()
    with pytest.raises(ValueError, match="path must end in one of .*or format= name its format"):
        pm.read_packing(tmp_path / "data.jammed")
    with pytest.raises(ValueError, match="format must be one of 'npz', 'gsd', .*, got 'pdb'"):
        pm.read_packing(tmp_path / "data.jammed", format="pdb")


# -- files that are broken ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize(
    "content", [b"", b"\n\n", b"\x00\xff\xfe garbage \x80", b"1\n", b"<VTKFile>", b"# vtk DataFile"]
)
def test_what_is_no_such_file_is_refused_by_name(tmp_path, capfd, ending, content):
    (tmp_path / f"a{ending}").write_bytes(content)
    for read in (pm.read_packing, lambda path: pm.read_trajectory(path)[0]):
        with pytest.raises(ValueError, match=f"path must name a readable packing, got .*a{ending}"):
            read(tmp_path / f"a{ending}")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_that_breaks_off_is_refused_or_a_whole_packing(tmp_path, ending):
    pm.write_packing(discs(particles=5), tmp_path / f"a{ending}")
    whole = (tmp_path / f"a{ending}").read_bytes()
    for length in range(0, len(whole) - 10, max(len(whole) // 40, 1)):
        (tmp_path / f"b{ending}").write_bytes(whole[:length])
        try:
            found = pm.read_packing(tmp_path / f"b{ending}")
        except ValueError as error:
            assert "path must name a readable packing" in str(error)
        else:
            # a table says nowhere how many lines it has
            assert ending in (".txt", ".csv") or found == discs(particles=5)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_file_with_changed_bytes_is_refused_or_read(tmp_path, ending):
    pm.write_packing(discs(particles=5), tmp_path / f"a{ending}")
    whole, rng = (tmp_path / f"a{ending}").read_bytes(), np.random.default_rng(1)
    for k in range(100):
        content = bytearray(whole)
        if k % 2:
            content[rng.integers(len(content))] = rng.integers(256)
        else:
            first, last = sorted(rng.integers(len(content), size=2))
            del content[first:last]
        (tmp_path / f"b{ending}").write_bytes(bytes(content))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            try:
                pm.read_packing(tmp_path / f"b{ending}")
            except ValueError as error:
                assert "path must name a readable packing" in str(error)


# -- numbers and names of all kinds ------------------------------------------------------------------------------------


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 3), min_size=1, max_size=4),
    st.floats(1e-59, 1e59),
    st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6),
    st.sampled_from([2, 3]),
)
@pytest.mark.parametrize("ending", [".csv", ".data", ".dump", ".extxyz"])
def test_any_double_that_a_packing_holds_survives(tmp_path, ending, positions, radius, tilts, dimension):
    lattice = np.array([[3.0, tilts[0], tilts[1]], [0.0, 2.0, tilts[2]], [0.0, 0.0, 5.0]])
    lattice[1, 0], lattice[2, 0], lattice[2, 1] = 0.0, 0.0, 0.0
    packing = pm.Packing(
        (np.array(positions) * radius)[:, :dimension], radius, pm.Box(radius * lattice[:dimension, :dimension])
    )
    fields = {"velocity_nd": 1e-9 * packing.position_nd, "heat": packing.position_nd[:, 0] / 3.0}
    fields = {name: one for name, one in fields.items() if ending != ".data" or name != "heat"}
    pm.write_packing(pm.Snapshot(packing, fields), tmp_path / f"a{ending}")
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    assert found.packing == packing
    for name, array in fields.items():
        np.testing.assert_array_equal(found.fields[name], array)


def test_the_sign_of_z_does_not_make_a_plane_of_a_layer_in_space(tmp_path):
    layer = pm.Packing([[0.5, 0.5, 0.0], [1.5, 0.5, 0.0]], 0.5, [3.0, 3.0, 1.0])
    for ending in (".data", ".dump", ".extxyz", ".csv", ".vtp"):
        pm.write_packing(layer, tmp_path / f"a{ending}")
        assert pm.read_packing(tmp_path / f"a{ending}") == layer


def test_whole_numbers_that_no_int64_holds_are_refused_and_not_turned_negative():
    packing = pm.lattice_packing("square", repeats=(2, 2))
    with pytest.raises(ValueError, match="fields.*must be below 2.63, got 18446744073709551615 for particle 3"):
        pm.Snapshot(packing, {"id": np.array([1, 2, 3, 2**64 - 1], dtype=np.uint64)})
    assert pm.Snapshot(packing, {"id": np.array([1, 2, 3, 2**63 - 1], dtype=np.uint64)}).fields["id"][3] == 2**63 - 1


@pytest.mark.parametrize("ending", [".csv", ".dump", ".extxyz", ".npz"])
def test_fields_of_words_whole_numbers_and_nothing_come_back(tmp_path, ending):
    own = {
        "label": np.array(["a", "b;c", "10d"]),
        "large": np.array([2**63 - 1, -(2**63), 0]),
        "missing": np.array([np.nan, np.inf, 1.0]),
        "pair": np.array([[1.5, np.nan], [2.0, 3.0], [0.0, 1.0]]),
    }
    snapshot = pm.Snapshot(pm.Packing([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], 0.5, 5.0), own)
    pm.write_packing(snapshot, tmp_path / f"a{ending}")
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    assert pm.Snapshot(found.packing, {name: found.fields[name] for name in own}) == snapshot


@pytest.mark.parametrize(
    ("ending", "name", "value"),
    [
        (".csv", "a#b", [1.0, 2.0]),
        (".csv", "x [mm]", [1.0, 2.0]),
        (".csv", "r", [1.0, 2.0]),
        (".csv", "vx", [1.0, 2.0]),
        (".csv", "label", ["a#b", "c"]),
        (".csv", "label", ["1", "2"]),
        (".csv", "label", [" a", "c"]),
        (".dump", "label", ["a b", "c"]),
        (".dump", "xu", [1.0, 2.0]),
        (".dump", "a[1]", [1.0, 2.0]),
        (".extxyz", "a:b", [1.0, 2.0]),
        (".extxyz", "radius", [1.0, 2.0]),
        (".gsd", "label", ["a", "b"]),
        (".vtp", "label", ["a", "b"]),
        (".data", "heat", [1.0, 2.0]),
        (".txt", "velocity_nd", [[1.0, 2.0], [3.0, 4.0]]),
    ],
)
def test_fields_that_would_be_read_back_as_something_else_are_refused(tmp_path, ending, name, value):
    snapshot = pm.Snapshot(pm.Packing([[0.0, 0.0], [1.0, 0.0]], 0.5, 5.0), {name: value})
    with pytest.raises(ValueError, match=f"packing must have no fields .* for {ending} files"):
        pm.write_packing(snapshot, tmp_path / f"a{ending}")
    pm.write_packing(snapshot, tmp_path / f"a{ending}", drop=True)
    assert pm.read_packing(tmp_path / f"a{ending}") == snapshot.packing


def test_a_run_is_written_as_a_trajectory_with_velocities_spins_and_forces(tmp_path):
    packing = pm.random_packing(30, dimension=2, packing_fraction=0.95, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5)))
    run = pm.simulate(scene, steps=30, dt=0.02, temperature=1e-3, seed=1, trace_every=10, trace_positions=True)
    kept = list(pm.snapshots(run, scene))
    assert [one.step for one in kept] == [0, 10, 20, 30]
    for f, one in enumerate(kept):
        np.testing.assert_array_equal(one.packing.position_nd, run.trace.position_tnd[f])
        np.testing.assert_array_equal(one.fields["velocity_nd"], run.trace.velocity_tnd[f])
        np.testing.assert_array_equal(one.fields["spin_nk"], run.trace.spin_tnk[f])
        contacts, forces = pm.find_contacts(one.packing), one.contact_forces
        np.testing.assert_array_equal(forces.image_cd, contacts.image_cd)
        overlap = contacts.contact_distance_c - contacts.distance_c
        np.testing.assert_allclose(forces.normal_c, overlap, rtol=1e-9, atol=1e-12)
        size = np.linalg.norm(forces.tangential_cd, axis=1)
        assert (size <= 0.5 * forces.normal_c * (1.0 + 1e-9) + 1e-12).all() and (f == 0 or size.max() > 0.0)
    pm.write_trajectory(pm.snapshots(run, scene), tmp_path / "run.gsd")
    assert list(pm.read_trajectory(tmp_path / "run.gsd")) == kept
    pm.write_trajectory(pm.snapshots(run, scene), tmp_path / "run.dump", drop=True)
    for one, written in zip(kept, pm.read_trajectory(tmp_path / "run.dump"), strict=True):
        assert written.packing == one.packing
        np.testing.assert_array_equal(written.fields["spin_nk"], one.fields["spin_nk"])
