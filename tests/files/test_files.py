"""Facts about packing files: exact round trips, what other programs see, clear refusals."""

import json
import math
import pathlib

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import packmech as pm

ENDINGS = [".npz", ".gsd", ".txt", ".csv"]


def some_packing(seed=1, dimension=2, particles=17, left_handed=False):
    rng = np.random.default_rng(seed)
    box = np.eye(dimension) + 0.7 * rng.standard_normal((dimension, dimension))
    if (np.linalg.det(box) < 0) != left_handed:
        box[:, 0] *= -1
    sizes = pm.Bidisperse(scatter=0.03) if seed % 2 else pm.Bidisperse()
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=0.8, box=box, sizes=sizes, rng=rng)
    # some of the particles outside the cell: positions need not be wrapped
    outside = rng.integers(-3, 4, (particles, dimension)) @ packing.box.lattice_dd.T
    return packing.replace(position_nd=packing.position_nd + outside)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("left_handed", [False, True])
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_packing_is_read_back_to_the_last_bit(tmp_path, ending, dimension, left_handed):
    packing = some_packing(3, dimension, left_handed=left_handed)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.lists(st.tuples(*[st.floats(-1e9, 1e9)] * 2), min_size=1, max_size=5),
    st.floats(1e-59, 1e59),
    st.floats(1e-59, 1e59),
)
@pytest.mark.parametrize("ending", [".npz", ".txt"])
def test_any_double_that_a_packing_holds_survives(tmp_path, ending, positions, radius, flat):
    place = np.array(positions) * radius
    box = pm.Box([[radius, 0.1 * min(flat, radius)], [0.0, min(flat, radius)]])
    packing = pm.Packing(place, [radius] * len(positions), box)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


@pytest.mark.parametrize(
    "law",
    [None, pm.Harmonic(), pm.Hertz(2.5), pm.PowerLaw(1.0, 1.75), pm.RepulsiveLennardJones(), pm.LinearSpring(3.0)],
)
def test_the_law_stored_with_a_packing_is_read_back(tmp_path, law):
    pm.write_packing(some_packing(), tmp_path / "a.npz", law=law)
    found = pm.read_law(tmp_path / "a.npz")
    assert found == law and type(found) is type(law)


def test_a_file_without_a_place_for_a_law_has_none(tmp_path):
    pm.write_packing(some_packing(), tmp_path / "a.txt")
    assert pm.read_law(tmp_path / "a.txt") is None


def test_an_npz_of_the_three_arrays_alone_is_read(tmp_path):
    packing = some_packing()
    np.savez(
        tmp_path / "a.npz",
        position_nd=packing.position_nd,
        radius_n=packing.radius_n,
        lattice_dd=packing.box.lattice_dd,
    )
    assert pm.read_packing(tmp_path / "a.npz") == packing
    assert pm.read_law(tmp_path / "a.npz") is None


@pytest.mark.parametrize("ending", [".npz", ".txt"])
def test_the_same_packing_gives_the_same_file(tmp_path, ending):
    for name in "ab":
        pm.write_packing(some_packing(), tmp_path / f"{name}{ending}")
    assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


def test_writing_replaces_a_file_and_leaves_nothing_beside_it(tmp_path):
    for seed in (1, 2):
        for ending in ENDINGS:
            pm.write_packing(some_packing(seed), tmp_path / f"a{ending}")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(f"a{ending}" for ending in ENDINGS)
    assert pm.read_packing(tmp_path / "a.npz") == some_packing(2)


def test_a_write_that_fails_leaves_the_old_file_whole(tmp_path, monkeypatch):
    pm.write_packing(some_packing(1), tmp_path / "a.npz")

    def fail(file, **arrays):
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(OSError, match="disk full"):
        pm.write_packing(some_packing(2), tmp_path / "a.npz")
    monkeypatch.undo()
    assert pm.read_packing(tmp_path / "a.npz") == some_packing(1)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


# -- what other programs see in a .gsd ---------------------------------------------------------------------------------


def gsd_frame(path):
    gsd = pytest.importorskip("gsd.hoomd")
    with gsd.open(str(path), "r") as file:
        return file[0]


@pytest.mark.parametrize("left_handed", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_gsd_shows_other_programs_the_same_distances(tmp_path, dimension, left_handed):
    packing = some_packing(2, dimension, left_handed=left_handed)
    pm.write_packing(packing, tmp_path / "a.gsd")
    frame = gsd_frame(tmp_path / "a.gsd")
    freud = pytest.importorskip("freud")
    query = freud.locality.AABBQuery.from_system(frame)
    # freud wants less than half the smallest height; below it only the nearest image can be in reach
    reach = 0.49 * packing.box.height_d.min()
    pairs = query.query(frame.particles.position, {"r_max": reach, "exclude_ii": True}).toNeighborList()
    seen = np.sort(pairs.distances[pairs.query_point_indices < pairs.point_indices])
    apart = packing.position_nd[:, None] - packing.position_nd[None]
    fraction = apart @ packing.box.inverse_dd.T
    apart = (fraction - np.rint(fraction)) @ packing.box.lattice_dd.T
    distance = np.sqrt((apart**2).sum(-1))[np.triu_indices(packing.particles, 1)]
    expected = np.sort(distance[distance < reach])
    size = np.abs(packing.box.lattice_dd).max()
    assert len(seen) == len(expected)
    np.testing.assert_allclose(seen, expected, atol=32 * np.finfo(np.float32).eps * size)


@pytest.mark.parametrize("dimension", [2, 3])
def test_gsd_particles_lie_inside_the_centered_box(tmp_path, dimension):
    packing = some_packing(4, dimension)
    pm.write_packing(packing, tmp_path / "a.gsd")
    frame = gsd_frame(tmp_path / "a.gsd")
    x, y, z, xy, xz, yz = frame.configuration.box
    lattice = np.array([[x, xy * y, xz * z], [0, y, yz * z], [0, 0, z]])[:dimension, :dimension]
    fraction = frame.particles.position[:, :dimension] @ np.linalg.inv(lattice).T
    assert np.abs(fraction).max() <= 0.5 + 1e-6
    assert abs(np.linalg.det(lattice)) == pytest.approx(packing.box.volume, rel=1e-6)


def test_gsd_names_a_particle_type_for_each_of_a_few_sizes(tmp_path):
    pm.write_packing(some_packing(2), tmp_path / "a.gsd")
    frame = gsd_frame(tmp_path / "a.gsd")
    assert frame.particles.types == ["A", "B"]
    assert set(frame.particles.diameter[frame.particles.typeid == 1]) == {np.float32(1.4)}


def test_gsd_of_another_program_is_read_as_every_program_sees_it(tmp_path):
    gsd = pytest.importorskip("gsd.hoomd")
    frame = gsd.Frame()
    frame.particles.N = 2
    frame.particles.position = [[-1.0, 0.5, 0.25], [1.0, 0.0, 0.0]]
    frame.particles.diameter = [1.0, 1.5]
    frame.configuration.box = [4.0, 5.0, 6.0, 0.5, 0.25, -0.5]
    with gsd.open(str(tmp_path / "a.gsd"), "w") as file:
        file.append(frame)
    expected = pm.Packing(
        frame.particles.position,
        [0.5, 0.75],
        pm.Box([[4.0, 0.5 * 5.0, 0.25 * 6.0], [0.0, 5.0, -0.5 * 6.0], [0.0, 0.0, 6.0]]),
    )
    assert pm.read_packing(tmp_path / "a.gsd") == expected


def test_gsd_whose_visible_particles_were_moved_by_another_program_is_refused(tmp_path):
    gsd = pytest.importorskip("gsd.hoomd")
    pm.write_packing(some_packing(), tmp_path / "a.gsd")
    frame = gsd_frame(tmp_path / "a.gsd")
    frame.particles.position[3, 0] += 0.01
    with gsd.open(str(tmp_path / "b.gsd"), "w") as file:
        file.append(frame)
    with pytest.raises(ValueError, match="must be one packing, got two that differ"):
        pm.read_packing(tmp_path / "b.gsd")


# -- the plain table ---------------------------------------------------------------------------------------------------


def test_plain_table_has_one_lattice_vector_a_line(tmp_path):
    (tmp_path / "a.dat").write_text(
        "# by hand\nlattice 4.0, 0.0\nlattice 0.5, 3.0\n\n0.25 0.5 0.5  # first\n1 2 0.25\n"
    )
    expected = pm.Packing([[0.25, 0.5], [1.0, 2.0]], [0.5, 0.25], pm.Box([[4.0, 0.5], [0.0, 3.0]]))
    assert pm.read_packing(tmp_path / "a.dat") == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "it must hold 2 or 3 lines 'lattice x y"),
        ("lattice 1 0\nlattice 0 1\n", "it must hold at least one line"),
        ("lattice 1 0\n0 0 0.5\n", "line 2 must hold 1 coordinates and a radius"),
        ("lattice 1 0\nlattice 0 1\n0 0\n", "line 3 must hold 2 coordinates and a radius, .* got 2 numbers"),
        ("0 0 0.5\nlattice 1 0\nlattice 0 1\n", "line 1 must hold 0 coordinates .* after the lines with the lattice"),
        ("lattice 1 0\nlattice 0 1\n0 zero 0.5\n", "line 3 must hold numbers, got '0 zero 0.5'"),
        ("lattice 1\n", "line 1 must hold a lattice vector of 2 or 3 numbers, got 1"),
        ("lattice 1 0 0\nlattice 0 1 0\n0 0 0.5\n", "as many as coordinates, got 2"),
        ("lattice 1 0\nlattice 2 0\n0 0 0.5\n", "lattice_dd must have linearly independent columns"),
        ("lattice 1 0\nlattice 0 1\n0 nan 0.5\n", "position_nd must be finite, got nan for particle 0"),
        ("lattice 1 0\nlattice 0 1\n0 0 -0.5\n", "radius_n must be positive, got -0.5 for particle 0"),
    ],
)
def test_broken_table_is_refused_with_its_line(tmp_path, text, message):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(ValueError, match=f"a.txt.*{message}"):
        pm.read_packing(tmp_path / "a.txt")


# -- refusals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("content", [b"", b"\x00\xff\xfe garbage \x80", b"PK\x03\x04 cut off"])
def test_unreadable_file_is_refused_by_name(tmp_path, ending, content):
    path = tmp_path / f"broken{ending}"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=f"path must name a readable packing, got .*broken{ending}"):
        pm.read_packing(path)


def test_truncated_npz_is_refused(tmp_path):
    pm.write_packing(some_packing(), tmp_path / "a.npz")
    whole = (tmp_path / "a.npz").read_bytes()
    for length in range(1, len(whole), 97):
        (tmp_path / "b.npz").write_bytes(whole[:length])
        with pytest.raises(ValueError, match="path must name a readable packing"):
            pm.read_packing(tmp_path / "b.npz")


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"position_nd": np.zeros((1, 2))}, "it must hold the arrays radius_n, lattice_dd, got position_nd"),
        ({"position_nd": np.zeros(2), "radius_n": [1.0], "lattice_dd": np.eye(2)}, "position_nd must have shape"),
        ({"position_nd": [[0.0, 0.0]], "radius_n": [1.0], "lattice_dd": np.zeros((2, 2))}, "must have linearly indep"),
        *(
            ({"format_version": version}, "format_version must be an integer from 1 to 10, got ")
            for version in (99, 0, -1, np.nan, 1.0, 1j, True, [1], np.uint64(2**64 - 1))
        ),
        ({"format_version": "new"}, "path must name a readable packing"),
        ({"position_nd": np.array([None, 1])}, "path must name a readable packing"),
    ],
)  # fmt: skip
def test_npz_with_wrong_arrays_is_refused(tmp_path, arrays, message):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=message):
        pm.read_packing(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ("{", "path must name a readable packing"),
        (json.dumps({"kind": "gravity"}), "law.kind must be one of .*'harmonic'.* got 'gravity'"),
        (json.dumps({"kind": "my-cubic"}), "got 'my-cubic'.*register it with pm.law, and load its file with --load"),
        (json.dumps({"kind": "harmonic", "stiffness": 1.0}), "law.stiffness must be a field of harmonic .energy_scale"),
        (json.dumps({"kind": "harmonic", "energy_scale": "1"}), "law.energy_scale must be a number, got '1'"),
    ],
)
def test_npz_with_a_wrong_law_is_refused(tmp_path, law, message):
    np.savez(tmp_path / "a.npz", law=np.array(law))
    with pytest.raises(ValueError, match=message):
        pm.read_law(tmp_path / "a.npz")


def test_gsd_without_a_frame_is_refused(tmp_path):
    gsd = pytest.importorskip("gsd.hoomd")
    gsd.open(str(tmp_path / "a.gsd"), "w").close()
    with pytest.raises(ValueError, match="it must hold at least one frame, got none"):
        pm.read_packing(tmp_path / "a.gsd")


def test_missing_file_and_unknown_ending_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="path must name an existing file, got .*nowhere.npz"):
        pm.read_packing(tmp_path / "nowhere.npz")
    (tmp_path / "a.pdb").write_text("1\n")
    with pytest.raises(ValueError, match=r"path must end in one of \.npz, \.gsd, \.txt, \.dat, \.csv, .*, got"):
        pm.read_packing(tmp_path / "a.pdb")
    with pytest.raises(TypeError, match="path must be a file name, got 3"):
        pm.read_packing(3)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda folder: pm.write_packing("packing", folder / "a.npz"), "packing must be a Packing"),
        (lambda folder: pm.write_packing(some_packing(), folder / "a.pdb"), "path must end in one of"),
        (lambda folder: pm.write_packing(some_packing(), folder / "no" / "a.npz"), "path must lie in an existing"),
        (lambda folder: pm.write_packing(some_packing(), folder / "a.npz", law="hertz"), "law must be a law such as"),
        (lambda folder: pm.write_packing(some_packing(), folder / "a.txt", law=pm.Hertz()), "law must be None for"),
        (lambda folder: pm.write_packing(some_packing(), None), "path must be a file name, got None"),
    ],
)  # fmt: skip
def test_impossible_write_is_refused_and_leaves_no_file(tmp_path, write, message):
    with pytest.raises((TypeError, ValueError), match=message):
        write(tmp_path)
    assert list(pathlib.Path(tmp_path).iterdir()) == []


def test_every_number_in_a_text_file_is_the_shortest_that_reads_back(tmp_path):
    packing = pm.Packing([[0.1, 1 / 3]], [math.pi], pm.Box.cubic(0.3, 2))
    pm.write_packing(packing, tmp_path / "a.txt")
    assert "0.1 0.3333333333333333 3.141592653589793" in (tmp_path / "a.txt").read_text()
