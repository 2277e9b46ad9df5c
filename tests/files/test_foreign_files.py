"""Facts about files of other programs, which are read, and of packmech's files, which other programs read."""

import pathlib
import warnings

import numpy as np
import pytest
from peer_programs import lammps

import packmech as pm

MADE = pathlib.Path(__file__).parents[1] / "golden" / "foreign_files"
PLANE = pm.Box([[6.0, 1.0], [0.0, 5.0]])
SPACE = pm.Box([[6.0, 1.0, 0.0], [0.0, 5.0, 0.0], [0.0, 0.0, 4.0]])


def only(path, **given):
    """Return the last snapshot of a file, of which nothing is left out."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return pm.read_trajectory(path, **given)[-1]


# -- what LAMMPS, ASE, OVITO and VTK write -----------------------------------------------------------------------------


def test_a_data_file_of_lammps_has_radii_masses_velocities_and_spins(tmp_path):
    found = only(MADE / "sphere.data")
    np.testing.assert_allclose(found.packing.position_nd, [[0.5, 0.25], [1.75, 0.5], [5.5, 4.5]], rtol=1e-15)
    assert found.packing.box == PLANE and found.packing.radius_n.tolist() == [0.5, 0.75, 0.5]
    # LAMMPS's densities are those of spheres, of 1 here for type 2
    density = found.packing.mass_n / (4 / 3 * np.pi * found.packing.radius_n**3)
    np.testing.assert_allclose(density, [2.0, 0.2962962962962963, 2.0], rtol=1e-15)
    assert found.fields["velocity_nd"].tolist() == [[0.25, 0.0], [0.0, 0.0], [0.0, -0.5]]
    assert found.fields["spin_nk"].tolist() == [[0.0], [0.125], [0.0]]
    with pytest.warns(UserWarning, match="sphere.data: left out, .*: velocities; spins$"):
        pm.read_packing(MADE / "sphere.data")


def test_a_general_box_of_lammps_is_read_as_it_stands():
    for name, words in (("general.data", "section Pair Coeffs"), ("general.dump", None)):
        frames = pm.read_trajectory(MADE / name)
        if words is None:
            found = frames[0]
        else:
            with pytest.warns(UserWarning, match=f"left out, .*: {words}"):
                found = frames[0]
        np.testing.assert_allclose(found.packing.box.lattice_dd, [[6.0, 1.0], [-1.0, 5.0]], rtol=1e-15)
        np.testing.assert_allclose(found.packing.position_nd, [[0.5, 0.25], [4.5, 3.5]], rtol=1e-15)


def test_bonds_of_lammps_are_springs_and_a_hybrid_says_of_what():
    with pytest.raises(
        ValueError, match="hybrid.data.*must name its atom style after 'Atoms #'.*got 'hybrid': give it"
    ):
        pm.read_packing(MADE / "hybrid.data")
    frames = pm.read_trajectory(MADE / "hybrid.data", format="lammps-data:hybrid sphere bond")
    with pytest.warns(UserWarning, match="left out, .*: section Pair Coeffs"):
        found = frames[0]
    assert found.packing.box == SPACE and found.packing.radius_n.tolist() == [0.5, 0.75, 0.5]
    spring = pm.LinearSpring(5.0)
    assert found.bonds == (pm.Bonds([0], [1], [[0, 0, 0]], [1.25], spring, spring, 0.0),)
    assert found.fields["molecule"].tolist() == [0, 0, 0]


def test_a_dump_of_lammps_in_scaled_coordinates_is_a_trajectory():
    snapshots = pm.read_trajectory(MADE / "moved.dump")
    with pytest.warns(UserWarning, match="moved.dump: left out, .*: item UNITS; item TIME$"):
        assert snapshots[0].step == 0
    with pytest.warns(UserWarning, match="moved.dump: left out, .*item TIME$"):
        frames = list(snapshots)
    assert [one.step for one in frames] == [0, 1, 2] and all(one.packing.box == PLANE for one in frames)
    np.testing.assert_allclose(frames[1].packing.position_nd[0], [1.5, 0.25], rtol=2e-6)
    np.testing.assert_allclose(frames[2].packing.position_nd, frames[2].fields["c_far"], rtol=2e-5)
    assert frames[0].fields["spin_nk"].tolist() == [[0.0], [0.125], [0.0]]
    words = r"left out, .*: item UNITS; item TIME; velocities; spins; fields c_far$"
    with pytest.warns(UserWarning, match=words):
        assert pm.read_packing(MADE / "moved.dump", frame=0).radius_n.tolist() == [0.5, 0.75, 0.5]


def test_extended_xyz_of_ase_has_species_and_entries_without_a_place():
    frames = pm.read_trajectory(MADE / "ase.xyz")
    with pytest.warns(UserWarning, match="left out, .*: entries note"):
        found = frames[1]
    assert found.packing == pm.Packing([[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]], [0.5, 0.75], SPACE)
    assert found.fields["species"].tolist() == ["Cu", "Au"] and found.fields["momenta"].shape == (2, 3)


@pytest.mark.parametrize("name", ["ovito.dump", "ovito.xyz", "ovito.data"])
def test_files_of_ovito_are_read(name):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = pm.read_packing(MADE / name)
    assert [str(one.message).partition("them: ")[2] for one in said] == (
        ["densities, which are all 0"] if name == "ovito.data" else ["fields species"] if name == "ovito.xyz" else []
    )
    np.testing.assert_allclose(found.position_nd, [[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]], rtol=1e-15)
    np.testing.assert_allclose(found.radius_n, [0.5, 0.75], rtol=1e-7)
    assert found.box == SPACE


@pytest.mark.parametrize("name", ["ascii", "binary", "appended", "raw", "compressed", "old", "grid"])
def test_points_of_vtk_are_particles_in_the_box_that_is_given(name):
    name = f"{name}.vtp"
    found = only(MADE / name, box=SPACE)
    assert found.packing == pm.Packing([[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]], [0.5, 0.75], SPACE)
    assert found.fields["velocity_nd"].tolist() == [[0.25, 0.0, 0.0], [0.0, 0.0, 0.5]]
    with pytest.raises(ValueError, match=f"{name}.*it holds no periodic box: give it as box="):
        pm.read_packing(MADE / name)


def test_radii_that_a_file_does_not_hold_are_given(tmp_path):
    path = tmp_path / "a.xyz"
    path.write_text('2\nLattice="6 0 0 1 5 0 0 0 4" Properties=species:S:1:pos:R:3\nA 0 0 0\nB 1 1 1\n')
    assert only(path, radius=0.5).packing.radius_n.tolist() == [0.5, 0.5]
    assert only(path, radius={"A": 0.5, "B": 0.25}).packing.radius_n.tolist() == [0.5, 0.25]
    assert only(path, radius=[0.1, 0.2]).packing.radius_n.tolist() == [0.1, 0.2]
    for given, words in (
        ({}, "it holds no radii: give them as radius="),
        ({"radius": {"A": 0.5}}, "radius must be given for the types B, got A"),
        ({"radius": [0.5]}, r"radius must have shape \(2\), got \(1,\)"),
    ):
        with pytest.raises(ValueError, match=f"a.xyz.*{words}"):
            pm.read_packing(path, **given)
    pm.write_packing(pm.lattice_packing("square"), tmp_path / "b.extxyz")
    with pytest.raises(ValueError, match="radius must be left out where a file holds radii"):
        pm.read_packing(tmp_path / "b.extxyz", radius=0.5)
    pm.write_packing(pm.lattice_packing("square"), tmp_path / "b.npz")
    with pytest.raises(ValueError, match="^radius must be left out for .npz files, which hold it, got 0.5"):
        pm.read_packing(tmp_path / "b.npz", radius=0.5)


@pytest.mark.parametrize("ending", [".dump", ".extxyz", ".csv"])
def test_a_box_is_given_only_where_the_file_has_no_periodic_one(tmp_path, ending):
    packing, other = pm.Packing([[0.5, 0.5], [1.5, 1.0]], 0.5, [3.0, 4.0]), pm.Box([9.0, 9.0])
    pm.write_packing(packing, tmp_path / f"a{ending}")
    with pytest.raises(ValueError, match=f"a{ending}.*box must be left out where a file holds one"):
        pm.read_packing(tmp_path / f"a{ending}", box=other)
    text = (tmp_path / f"a{ending}").read_text()
    text = text.replace("pp pp pp", "ff pp pp").replace("T T F", "F T F").replace("# lattice", "# side")
    (tmp_path / f"a{ending}").write_text(text)
    with pytest.raises(ValueError, match=f"a{ending}.*give the (periodic )?box as box="):
        pm.read_packing(tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}", box=other) == packing.replace(box=other)


DUMP = """ITEM: TIMESTEP
0
ITEM: NUMBER OF ATOMS
2
ITEM: BOX BOUNDS pp pp pp
0 6
0 5
0 4
ITEM: ATOMS id type x y z radius
1 1 0 0 1 0.5
2 1 1 1 1 0.5
"""
DATA = """a title

2 atoms
1 atom types

0 6 xlo xhi
0 5 ylo yhi
0 4 zlo zhi

Atoms # sphere

1 1 1.0 1.0 0 0 1
2 1 1.0 1.0 2 2 1
"""
XYZ = '2\nLattice="6 0 0 0 5 0 0 0 4" Properties=species:S:1:pos:R:3:radius:R:1\nX 0 0 0 0.5\nX 1 1 1 0.5\n'


@pytest.mark.parametrize(
    ("name", "text", "change", "words"),
    [
        ("a.dump", DUMP, ("2 1 1 1 1 0.5", "2 1 1 one 1 0.5"), "line 11 must hold a number as y, got 'one'"),
        ("a.dump", DUMP, ("2 1 1 1 1 0.5\n", "2 1 1 1 1\n"), "line 11 must hold 6 words .id type x y z radius., got 5"),
        ("a.dump", DUMP, ("2 1 1 1 1 0.5\n", ""), "line 9 must be followed by 2 lines of atoms, got 1"),
        ("a.dump", DUMP, ("0 5", "0 five"), "line 7 must hold a number as a bound, got 'five'"),
        ("a.dump", DUMP, ("pp pp pp", "pp ff pp"), "its box must be periodic .pp. along each axis"),
        ("a.dump", DUMP, ("radius", "c_r"), "it holds no radii: give them as radius="),
        ("a.dump", DUMP, ("ITEM: ATOMS", "ITEM: OTHERS"), "line 11 must be an item of a LAMMPS dump"),
        ("a.dump", DUMP, (DUMP, "nothing\n"), "it must be a LAMMPS dump"),
        ("a.data", DATA, ("2 1 1.0 1.0 2 2 1", "2 1 1.0 1.0 2 b 1"), "line 13 must hold a number as y, got 'b'"),
        ("a.data", DATA, ("2 1 1.0 1.0 2 2 1", "2 1 1.0 1.0 2 2"), "line 13 must hold 7 words as others of Atoms"),
        ("a.data", DATA, ("2 atoms", "3 atoms"), "section Atoms must hold 3 lines, as its head says, got 2"),
        ("a.data", DATA, ("# sphere", "# mdpd"), "its atom style must be one of atomic, .*got 'mdpd'"),
        ("a.data", DATA, ("# sphere", "# full"), "its atoms must have whole numbers as type, got 1.0"),
        ("a.data", DATA, ("0 6 xlo xhi", "0 6 xlo"), "line 6 must be of the head of a LAMMPS data file, got '0 6 xlo'"),
        ("a.data", DATA, (DATA, ""), "it must be a LAMMPS data file"),
        ("a.xyz", XYZ, ("X 1 1 1 0.5", "X 1 1 1"), "line 4 must hold 5 words .*, got 4"),
        ("a.xyz", XYZ, ("X 1 1 1 0.5\n", ""), "line 1 must be followed by 3 lines, got 2"),
        ("a.xyz", XYZ, ("X 1 1 1 0.5", "X 1 1 a 0.5"), "line 4 must hold a number as pos, got 'a'"),
        ("a.xyz", XYZ, ("Lattice=", "Cell="), "line 2 must hold Lattice=..., got none: give the periodic box as box="),
        ("a.xyz", XYZ, ("2\n", "two\n"), "line 1 must hold a number of particles, got 'two'"),
        ("a.xyz", XYZ, ("pos:R:3", "pos:R"), "line 2 must hold Properties=name:type:columns"),
    ],
)
def test_broken_files_are_refused_with_their_lines(tmp_path, name, text, change, words):
    assert change[0] in text
    (tmp_path / name).write_text(text.replace(*change, 1))
    with pytest.raises(ValueError, match=f"path must name a readable packing, got .*{name}.*(?:{words})"):
        pm.read_packing(tmp_path / name)


def test_a_broken_frame_is_named_by_its_line_in_the_whole_file(tmp_path):
    (tmp_path / "a.dump").write_text(DUMP + DUMP.replace("1 1 0 0 1 0.5", "1 1 0 0 x 0.5"))
    frames = pm.read_trajectory(tmp_path / "a.dump")
    assert frames[0].packing.particles == 2
    with pytest.raises(ValueError, match="line 21 must hold a number as z, got 'x'"):
        frames[1]


# -- tables of all kinds -----------------------------------------------------------------------------------------------

TABLES = {
    "header": "# lattice 4 0\n# lattice 0.5 3\nx,y,radius\n0.25,0.5,0.5\n1,2,0.25\n",
    "lines": "lattice 4 0\nlattice 0.5 3\nx,y,radius\n0.25,0.5,0.5\n1,2,0.25\n",
    "order": "# lattice 4 0\n# lattice 0.5 3\nDiameter,Y,X\n1,0.5,0.25\n0.5,2,1\n",
    "semicolons": "# lattice 4 0\n# lattice 0.5 3\nx;y;r\n0.25;0.5;0.5\n1;2;0.25\n",
    "decimal commas": "# lattice 4 0\n# lattice 0.5 3\nx;y;r\n0,25;0,5;0,5\n1;2;0,25\n",
    "no header, decimal commas": "lattice 4 0\nlattice 0.5 3\n0,25;0,5;0,5\n1;2;0,25\n",
    "tabs": "# lattice 4 0\n# lattice 0.5 3\nx [mm]\ty [mm]\tradius [mm]\n0.25\t0.5\t0.5\n1\t2\t0.25\n",
    "blanks": "# lattice 4 0\n# lattice 0.5 3\n x  y   r \n 0.25 0.5 0.5\n1 2  0.25 \n",
    "D exponents": "# lattice 4D0 0.D0\n# lattice 5.0d-1 3\nx,y,radius\n2.5D-01,0.5D+00,0.5\n1,2,0.25D0\n",
    "quotes": '# lattice 4 0\n# lattice 0.5 3\n"x","y","radius"\n"0.25","0.5","0.5"\n1,2,0.25\n',
    "line ends": "# lattice 4 0\r\n# lattice 0.5 3\r\nx,y,radius\r\n0.25,0.5,0.5\r\n1,2,0.25\r\n",
}


@pytest.mark.parametrize("kind", TABLES)
@pytest.mark.parametrize("ending", [".csv", ".txt"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
def test_tables_as_other_programs_write_them_are_read(tmp_path, kind, ending, encoding):
    text = TABLES[kind] + ("# größe in µm\n" if encoding == "latin-1" else "")
    (tmp_path / f"a{ending}").write_bytes(text.encode(encoding))
    expected = pm.Packing([[0.25, 0.5], [1.0, 2.0]], [0.5, 0.25], pm.Box([[4.0, 0.5], [0.0, 3.0]]))
    assert pm.read_packing(tmp_path / f"a{ending}") == expected


def test_a_table_without_box_and_radii_gets_those_that_are_given(tmp_path):
    (tmp_path / "a.csv").write_text("id,x,y,z,label\n7,0.25,0.5,0,big one\n8,1,2,0,small\n")
    found = only(tmp_path / "a.csv", box=pm.Box([4.0, 3.0]), radius=0.5)
    assert found.packing == pm.Packing([[0.25, 0.5], [1.0, 2.0]], 0.5, [4.0, 3.0])
    assert found.fields["id"].tolist() == [7, 8] and found.fields["label"].tolist() == ["big one", "small"]
    with pytest.warns(UserWarning, match="left out, .*: fields id, label"):
        pm.read_packing(tmp_path / "a.csv", box=pm.Box([4.0, 3.0]), radius=0.5)
    (tmp_path / "b.csv").write_text("0.25,0.5\n1,2\n")
    assert pm.read_packing(tmp_path / "b.csv", box=pm.Box([4.0, 3.0]), radius=0.5) == found.packing


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# lattice 4 0\n# lattice 0 3\nx,y,radius\n1,2\n", "line 4 must hold 3 entries, as the header does, got 2"),
        ("# lattice 4 0\n# lattice 0 3\nx,y,radius\n1,,0.5\n", "line 4 must hold a number as y, got ''"),
        (
            "# lattice 4 0\n# lattice 0 3\nx,x,radius\n1,2,0.5\n",
            "line 3 must name each column, and once, got x, x, radius",
        ),
        ("# lattice 4 0\n# lattice 0 3\nx,radius\n1,0.5\n", "it must hold columns x y, got x, radius"),
        ("x,y,radius\n1,2,0.5\n", "it must hold 2 or 3 lines 'lattice x y .z.', .* got 0 .or give the box as box=."),
        ("# lattice 4 0\n# lattice 0 3\nx,y\n1,2\n", "it holds no radii"),
    ],
)
def test_broken_tables_with_a_header_are_refused_with_their_line(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ValueError, match=f"a.csv.*{words}"):
        pm.read_packing(tmp_path / "a.csv")


# -- what other programs read of packmech's files ----------------------------------------------------------------------


def discs(dimension=2, seed=2):
    lattice = np.array([[6.0, 1.5, -0.5], [0.0, 5.5, 0.75], [0.0, 0.0, 5.0]])[:dimension, :dimension]
    return pm.random_packing(60, dimension=dimension, packing_fraction=0.8, box=lattice, seed=seed).wrapped()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ending", [".dump", ".extxyz", ".data", ".gsd"])
def test_ovito_sees_positions_radii_box_and_velocities(tmp_path, ending, dimension):
    io = pytest.importorskip("ovito.io")
    packing = discs(dimension)
    velocity = np.random.default_rng(1).normal(size=(60, dimension))
    pm.write_packing(pm.Snapshot(packing, {"velocity_nd": velocity}), tmp_path / f"a{ending}")
    seen = io.import_file(str(tmp_path / f"a{ending}")).compute()
    apart = np.asarray(seen.particles.positions)[:, :dimension] - packing.position_nd
    apart -= np.rint(apart @ packing.box.inverse_dd.T) @ packing.box.lattice_dd.T
    # .gsd shows single precision; OVITO reads decimals to a rounding or two
    rounding = 1e-6 if ending == ".gsd" else 1e-15
    assert np.abs(apart).max() <= 6.0 * rounding
    np.testing.assert_allclose(seen.cell[:dimension, :dimension], packing.box.lattice_dd, rtol=rounding, atol=rounding)
    np.testing.assert_allclose(seen.particles["Radius"], packing.radius_n, rtol=1e-6)
    seen_velocity = np.asarray(seen.particles["Velocity"])[:, :dimension]
    np.testing.assert_allclose(seen_velocity, velocity, rtol=rounding, atol=rounding)


@pytest.mark.parametrize("ending", [".dump", ".extxyz", ".data", ".gsd"])
def test_ovito_sees_kinds(tmp_path, ending):
    io = pytest.importorskip("ovito.io")
    packing = pm.assign_kinds(discs(), (1, 2, 3), seed=1)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    particles = io.import_file(str(tmp_path / f"a{ending}")).compute().particles
    types = particles.particle_types
    if ending == ".extxyz":
        kind_n = np.asarray(particles["kind"])
    elif ending == ".gsd":
        kind_n = np.array([int(types.type_by_id(one).name[len("kind")]) for one in np.asarray(types)])
    else:
        kind_n = np.asarray(types) - 1
    assert kind_n.tolist() == packing.kind_n.tolist()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ending", [".dump", ".extxyz", ".gsd"])
def test_ovito_sees_ellipsoids_as_they_are_turned(tmp_path, ending, dimension):
    io = pytest.importorskip("ovito.io")
    rng = np.random.default_rng(3)
    shapes = pm.Spheroids(rng.choice([0.5, 2.0], 60), rng.normal(size=(60, dimension)))
    packing = discs(dimension).replace(shapes=shapes)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    particles = io.import_file(str(tmp_path / f"a{ending}")).compute().particles
    if ending != ".gsd":  # in which particle types have shapes
        along, across = shapes.semi_axes(packing.radius_n)
        np.testing.assert_allclose(particles["Aspherical Shape"], np.column_stack([along, across, across]), rtol=1e-6)
    x, y, z, w = np.asarray(particles["Orientation"], dtype=float).T
    first = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])[:, :dimension]
    np.testing.assert_allclose(first, shapes.director_nd, atol=2e-6)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ending", [".dump", ".extxyz"])
def test_ellipsoids_of_other_programs_are_read_from_axes_and_quaternions(tmp_path, ending, dimension):
    rng = np.random.default_rng(3)
    shapes = pm.Spheroids(rng.choice([0.5, 2.0], 60), rng.normal(size=(60, dimension)))
    packing = discs(dimension).replace(shapes=shapes)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    text = (tmp_path / f"a{ending}").read_text()
    for own in ("aspect", "director_x", "director_y", "director_z", "director"):
        text = text.replace(f" {own} ", f" c_{own} ").replace(f":{own}:", f":c_{own}:")
    (tmp_path / f"a{ending}").write_text(text)
    (found,) = pm.read_trajectory(tmp_path / f"a{ending}")
    np.testing.assert_allclose(found.packing.radius_n, packing.radius_n, rtol=1e-13)
    np.testing.assert_allclose(found.packing.shapes.aspect_n, shapes.aspect_n, rtol=1e-13)
    np.testing.assert_allclose(found.packing.shapes.director_nd, shapes.director_nd, atol=1e-13)


def test_ovito_sees_every_frame_and_the_forces_of_contacts(tmp_path):
    io = pytest.importorskip("ovito.io")
    packing = discs()
    forces = pm.contact_forces(pm.Scene(packing, (pm.Repulsion(),)))
    bonded = pm.Snapshot(packing, contact_forces=forces)
    for ending in (".gsd", ".dump", ".extxyz"):
        pm.write_trajectory([bonded, packing, packing], tmp_path / f"a{ending}", drop=True)
        assert io.import_file(str(tmp_path / f"a{ending}")).num_frames == 3
    seen = io.import_file(str(tmp_path / "a.gsd")).compute(0)
    assert seen.particles.bonds.count == len(forces.normal_c)
    np.testing.assert_allclose(seen.particles.bonds["normal_force"], forces.normal_c, rtol=1e-15)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ending", [".extxyz", ".dump"])
def test_ase_reads_positions_and_cell_to_the_last_bit(tmp_path, ending, dimension):
    io = pytest.importorskip("ase.io")
    packing = discs(dimension)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    atoms = io.read(tmp_path / f"a{ending}", format={".extxyz": "extxyz", ".dump": "lammps-dump-text"}[ending])
    place = atoms.positions[:, :dimension]
    # ASE's reader of dumps turns the box that it has read, and rounds
    rounding = 1e-14 if ending == ".dump" else 0.0
    np.testing.assert_allclose(place, packing.position_nd, rtol=rounding, atol=rounding)
    np.testing.assert_allclose(atoms.cell.array.T[:dimension, :dimension], packing.box.lattice_dd, rtol=rounding)
    if ending == ".extxyz":
        np.testing.assert_array_equal(atoms.arrays["radius"], packing.radius_n)
        assert atoms.pbc.tolist() == [True, True, dimension == 3]


def test_paraview_sees_particles_and_lines_of_the_right_lengths(tmp_path):
    pytest.importorskip("vtkmodules")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    packing = discs(3)
    forces = pm.contact_forces(pm.Scene(packing, (pm.Repulsion(),)))
    pm.write_packing(pm.Snapshot(packing, contact_forces=forces), tmp_path / "a.vtp")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "a.vtp"))
    reader.Update()
    data = reader.GetOutput()
    assert (data.GetNumberOfVerts(), data.GetNumberOfLines()) == (60, len(forces.normal_c))
    place = vtk_to_numpy(data.GetPoints().GetData())
    end = vtk_to_numpy(data.GetLines().GetConnectivityArray()).reshape(-1, 2)
    length = np.linalg.norm(place[end[:, 1]] - place[end[:, 0]], axis=1)
    np.testing.assert_allclose(length, forces.contacts.distance_c, rtol=1e-13)
    cells, points = data.GetCellData(), data.GetPointData()
    np.testing.assert_array_equal(vtk_to_numpy(cells.GetArray("normal_force"))[60:], forces.normal_c)
    radius, particle = (vtk_to_numpy(points.GetArray(name)) for name in ("radius", "particle"))
    np.testing.assert_array_equal(radius[:60], packing.radius_n)
    assert (
        not radius[60:].any() and (particle[end] == np.column_stack([forces.contacts.i_c, forces.contacts.j_c])).all()
    )


# -- LAMMPS itself -----------------------------------------------------------------------------------------------------


LATTICES = {
    "square": np.diag([6.0, 5.5, 5.0]),
    "tilted": np.array([[6.0, 1.5, -0.5], [0.0, 5.5, 0.75], [0.0, 0.0, 5.0]]),
    "general": np.array([[5.5, 1.5, -0.5], [1.25, 5.5, 0.75], [0.5, -0.75, 5.0]]),
    "left-handed": np.array([[1.5, 5.5, -0.5], [5.5, 1.25, 0.75], [-0.75, 0.5, 5.0]]),
}


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kind", LATTICES)
def test_lammps_computes_the_energy_and_forces_of_a_frictional_bonded_packing(tmp_path, kind, dimension):
    lattice = LATTICES[kind][:dimension, :dimension]
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(120, dimension=dimension, packing_fraction=0.9, sizes=sizes, box=lattice, seed=3)
    law = pm.Repulsion(pm.LinearSpring(2.0))
    start = pm.quench(pm.Scene(start, (law,)), force_tolerance=1e-3).packing
    rough = (law, pm.Friction(0.5), pm.ContactDamping(0.3))
    run = pm.simulate(pm.Scene(start, rough), steps=200, dt=0.05, temperature=1e-3, seed=1)
    packing = run.packing
    assert packing.tangential is not None
    every = pm.bond_contacts(packing, tangential_stiffness=0.0)
    stiff = pm.LinearSpring(3.0)
    bonds = pm.Bonds(
        *(one[::3] for one in (every.i_b, every.j_b, every.image_bd, every.rest_length_b)),
        compression=stiff, tension=stiff, tangential_stiffness=0.0,
    )  # fmt: skip
    velocity = np.random.default_rng(4).normal(size=packing.position_nd.shape)
    snapshot = pm.Snapshot(packing, {"velocity_nd": velocity}, bonds)
    pm.write_packing(snapshot, tmp_path / "a.data", drop=True)  # of friction LAMMPS's data files hold nothing
    small, large = np.unique(packing.radius_n).tolist()
    peer = lammps()
    peer.commands_string(
        f"units lj\ndimension {dimension}\natom_style hybrid sphere bond\nbond_style harmonic\n"
        f"read_data {tmp_path / 'a.data'}\nspecial_bonds lj 0 1 1\ncomm_modify mode single cutoff {3 * large!r}\n"
        f"pair_style harmonic/cut\npair_coeff 1 1 1.0 {2 * small!r}\npair_coeff 1 2 1.0 {small + large!r}\n"
        f"pair_coeff 2 2 1.0 {2 * large!r}\nthermo_style custom step pe evdwl ebond\nthermo_modify norm no\nrun 0\n"
        f"write_dump all custom {tmp_path / 'a.dump'} id type x y z ix iy iz radius mass vx vy vz fx fy fz "
        "modify format float %.17g" + (" triclinic/general yes" if kind in ("general", "left-handed") else "")
    )
    pair, bond = peer.get_thermo("evdwl"), peer.get_thermo("ebond")
    peer.close()
    plain = packing.replace(tangential=None)
    whole = pm.energy(pm.Scene(plain, (law, bonds)))
    distance = np.sqrt((bonds_vectors(packing, bonds) ** 2).sum(axis=1))
    springs = 1.5 * ((distance - bonds.rest_length_b) ** 2).sum()
    assert springs > 0.0 and pair > 0.0
    assert bond == pytest.approx(springs, rel=1e-12)
    assert pair == pytest.approx(whole - springs, rel=1e-12)
    (found,) = pm.read_trajectory(tmp_path / "a.dump")
    force = pm.forces(pm.Scene(plain, (law, bonds)))
    sign = -1.0 if np.linalg.det(lattice) < 0.0 else 1.0
    expected = packing.box.lattice_dd * np.append(np.ones(dimension - 1), sign)
    np.testing.assert_allclose(found.packing.box.lattice_dd, expected, atol=1e-14 * np.abs(lattice).max())
    apart = found.packing.position_nd - packing.position_nd
    apart -= np.rint(apart @ packing.box.inverse_dd.T) @ packing.box.lattice_dd.T
    assert np.abs(apart).max() < 1e-13
    np.testing.assert_array_equal(found.packing.radius_n, packing.radius_n)
    np.testing.assert_allclose(found.packing.mass_n, packing.mass_n, rtol=1e-15)
    general = kind in ("general", "left-handed")
    if not general:
        np.testing.assert_array_equal(found.fields["velocity_nd"], velocity)
    np.testing.assert_allclose(found.fields["velocity_nd"], velocity, atol=1e-14)
    np.testing.assert_allclose(found.fields["force_nd"], force, atol=1e-12 * np.abs(force).max())


def bonds_vectors(packing, bonds):
    place = packing.position_nd
    return place[bonds.j_b] - place[bonds.i_b] + bonds.image_bd @ packing.box.lattice_dd.T


@pytest.mark.slow
def test_a_data_file_of_a_square_box_is_dumped_by_lammps_to_the_last_bit(tmp_path):
    packing = pm.random_packing(50, dimension=3, packing_fraction=0.6, seed=1).wrapped()
    pm.write_packing(packing, tmp_path / "a.data")
    peer = lammps()
    peer.commands_string(
        f"units lj\natom_style sphere\nread_data {tmp_path / 'a.data'}\npair_style zero 2.5\npair_coeff * *\nrun 0\n"
        f"write_dump all custom {tmp_path / 'a.dump'} id type x y z radius modify format float %.17g\n"
        f"write_data {tmp_path / 'b.data'}"
    )
    peer.close()
    assert pm.read_packing(tmp_path / "a.dump") == packing
    with pytest.warns(UserWarning, match="section Pair Coeffs"):
        assert pm.read_packing(tmp_path / "b.data") == packing


@pytest.mark.slow
def test_lammps_takes_kinds_for_its_types_of_atoms(tmp_path):
    packing = pm.random_packing(50, dimension=2, packing_fraction=0.6, seed=1).wrapped()
    packing = pm.assign_kinds(packing, (1, 2, 3), seed=1)
    pm.write_packing(packing, tmp_path / "a.data")
    peer = lammps()
    peer.commands_string(f"units lj\ndimension 2\natom_style sphere\nread_data {tmp_path / 'a.data'}")
    types = np.array(peer.numpy.extract_atom("type")[:50]).ravel()
    number = np.array(peer.numpy.extract_atom("id")[:50]).ravel()
    peer.close()
    assert (types[np.argsort(number)] - 1).tolist() == packing.kind_n.tolist()


def test_types_that_are_not_numbered_by_size_are_named_and_kept_by_a_snapshot(tmp_path):
    square = pm.lattice_packing("square", repeats=(2, 1)).replace(radius_n=[0.5, 0.4])
    mine, again = tmp_path / "mine.dump", tmp_path / "again.dump"
    pm.write_packing(pm.Snapshot(square, {"type": [1, 2]}), mine)
    with pytest.warns(UserWarning, match=r"\(pm.read_trajectory keeps .*\) has no place for them: fields type$"):
        assert pm.read_packing(mine) == square
    pm.write_packing(pm.read_trajectory(mine)[-1], again)
    assert pm.read_trajectory(again)[0].fields["type"].tolist() == [1, 2]
    # types by size, which writing a packing gives it, are no news
    pm.write_packing(square, again)
    assert pm.read_packing(again) == square and pm.read_trajectory(again)[0].fields["type"].tolist() == [2, 1]
