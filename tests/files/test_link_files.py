"""Facts about packings with links in files: exact round trips with images as state, what other programs see."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import packmech as pm


def linked(seed=1, dimension=2, particles=13, count=9):
    """Return particles at random in a tilted box, with links over any images, some of a particle with its own image."""
    rng = np.random.default_rng(seed)
    box = np.eye(dimension) + 0.3 * rng.standard_normal((dimension, dimension))
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=0.8, box=box, rng=rng)
    packing = packing.replace(position_nd=packing.position_nd + rng.integers(-2, 3, (particles, dimension)) @ box.T)
    i, j = rng.choice(particles, count), rng.choice(particles, count)
    image = rng.integers(-2, 3, (count, dimension))
    image[(i == j) & ~image.any(axis=1), 0] = 1
    _, first = np.unique(np.column_stack([np.minimum(i, j), np.maximum(i, j)]), axis=0, return_index=True)
    i, j, image = i[first], j[first], image[first]
    vector = packing.position_nd[j] - packing.position_nd[i] + image @ packing.box.lattice_dd.T
    links = pm.Links(i, j, image, np.linalg.norm(vector, axis=1), rng.random(len(i)) < 0.4)
    return packing.replace(links=links)


def frame_of(path):
    gsd = pytest.importorskip("gsd.hoomd")
    with gsd.open(str(path), "r") as file:
        return file[0]


def rewritten(frame, path):
    gsd = pytest.importorskip("gsd.hoomd")
    with gsd.open(str(path), "w") as file:
        file.append(frame)
    return path


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32), st.sampled_from([2, 3]))
@pytest.mark.parametrize("ending", [".npz", ".gsd"])
def test_a_packing_with_links_is_read_back_to_the_last_bit(tmp_path, ending, seed, dimension):
    packing = linked(seed, dimension)
    pm.write_packing(packing, tmp_path / f"a{ending}")
    assert pm.read_packing(tmp_path / f"a{ending}") == packing


def test_a_table_has_no_place_for_links_and_is_not_written(tmp_path):
    with pytest.raises(
        ValueError, match=r"^packing must have no links for .txt files \(only .npz, .gsd, .data and .vtp keep them"
    ):
        pm.write_packing(linked(), tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


def test_only_a_file_with_links_is_of_the_version_that_older_readers_refuse(tmp_path):
    for packing, version in ((linked(), 2), (linked().replace(links=None), 1)):
        pm.write_packing(packing, tmp_path / "a.npz")
        with np.load(tmp_path / "a.npz") as arrays:
            assert arrays["format_version"] == version


def test_links_without_one_of_their_arrays_are_refused(tmp_path):
    pm.write_packing(linked(), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as archive:
        arrays = {name: archive[name] for name in archive.files if name not in ("link_image_ld", "sha256")}
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match="a.npz.*must hold all arrays of its links, got none named link_image_ld"):
        pm.read_packing(tmp_path / "a.npz")


def test_gsd_shows_other_programs_bonds_and_constraints_with_their_lengths(tmp_path):
    packing = linked(5)
    pm.write_packing(packing, tmp_path / "a.gsd")
    frame = frame_of(tmp_path / "a.gsd")
    links = packing.links.select(packing.links.i_l != packing.links.j_l)
    pair = np.column_stack([links.i_l, links.j_l])
    np.testing.assert_array_equal(frame.bonds.group, pair)
    np.testing.assert_array_equal(frame.constraints.group, pair)
    np.testing.assert_array_equal(frame.constraints.value, links.length_l.astype(np.float32))
    assert [frame.bonds.types[k] for k in frame.bonds.typeid] == ["shape" if one else "bond" for one in links.shape_l]


def test_gsd_constraints_of_another_program_are_links_to_the_nearest_image(tmp_path):
    box = pm.Box([[4.0, 1.0], [0.0, 4.0]])
    links = pm.Links([0, 1], [1, 2], [[-1, 0], [0, 0]], [0.5, 1.0], [False, True])
    packing = pm.Packing([[0.25, 0.5], [3.75, 0.5], [3.75, 1.5]], [0.5] * 3, box, links)
    pm.write_packing(packing, tmp_path / "a.gsd")
    frame = frame_of(tmp_path / "a.gsd")
    frame.log = {}
    seen = pm.read_packing(rewritten(frame, tmp_path / "b.gsd"))
    assert seen.link_error < 1e-6
    assert seen.links.length_l.tolist() == [0.5, 1.0] and seen.links.shape_l.tolist() == [False, True]


@pytest.mark.parametrize("change", ["length", "pair", "fewer"])
def test_gsd_whose_visible_links_were_changed_by_another_program_is_refused(tmp_path, change):
    pm.write_packing(linked(5), tmp_path / "a.gsd")
    frame = frame_of(tmp_path / "a.gsd")
    if change == "length":
        frame.constraints.value[1] *= 1.01
    elif change == "pair":
        frame.constraints.group[1] = frame.constraints.group[1][::-1]
    else:
        frame.constraints.N = 0
        frame.constraints.group = frame.constraints.value = None
    with pytest.raises(ValueError, match="must be one packing, got two that differ"):
        pm.read_packing(rewritten(frame, tmp_path / "b.gsd"))


# -- scene files -------------------------------------------------------------------------------------------------------

INLINE = 'kind = "inline"\nlattice_vectors = [[4, 0], [0, 4]]\npositions = [[0, 0], [1, 0]]\nradii = [0.5, 0.5]\n'
EFFECTS = '[[effects]]\nkind = "repulsion"\n'


def read(folder, packing):
    (folder / "scene.toml").write_text(f"{EFFECTS}law = 'harmonic'\n[packing]\n{packing}\n")
    return pm.read_scene(folder / "scene.toml").packing


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_scene_with_links_is_read_back_equal(tmp_path, dimension):
    scene = pm.Scene(linked(3, dimension), (pm.Repulsion(),))
    pm.write_scene(scene, tmp_path / "a.toml")
    assert pm.read_scene(tmp_path / "a.toml") == scene


SHAPES = [
    ('shape = { kind = "dimer", length = 0.8, radii = [0.5, 0.7] }', pm.Dimer(0.8, (0.5, 0.7))),
    ('shape = "trimer"', pm.Trimer()),
    ('shape = { kind = "ring-cluster", beads = 5, rigid = false }', pm.RingCluster(5, rigid=False)),
    ('shape = { kind = "star-cluster", arms = 3 }', pm.StarCluster(3)),
    ('shape = { kind = "linear-cluster", beads = 4 }', pm.LinearCluster(4)),
    (
        'shape = { kind = "cluster", position_bd = [[0, 0], [1, 0], [1, 1]], radius_b = [0.5, 0.5, 0.6], '
        "links = [[0, 1], [0, 2]], shape_l = [false, true] }",
        pm.Cluster([[0, 0], [1, 0], [1, 1]], [0.5, 0.5, 0.6], [[0, 1], [0, 2]], [False, True]),
    ),
]


@pytest.mark.parametrize(("text", "shape"), SHAPES, ids=[type(shape).__name__ for _, shape in SHAPES])
def test_clusters_of_a_scene_file_are_those_that_the_function_makes(tmp_path, text, shape):
    found = read(tmp_path, f'kind = "clusters"\ncount = 7\n{text}\npacking_fraction = 0.6\nseed = 3\nsizes = "uniform"')
    assert found == pm.cluster_packing(7, shape, dimension=2, packing_fraction=0.6, seed=3, sizes=pm.Uniform())


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        ("", {}),
        ('angles = "fixed"\nbend = 0.5\nlink_length = 0.9', {"angles": "fixed", "bend": 0.5, "link_length": 0.9}),
        ("angles = [2.0, 2.5]\nradii = 0.4", {"angles": [2.0, 2.5], "radii": 0.4}),
        ('angles = 2\nsizes = "bidisperse"', {"angles": 2.0, "sizes": pm.Bidisperse()}),
        ('form = [0, 0, 0]\ncrossing = "allowed"', {"form": (0, 0, 0), "crossing": "allowed"}),
        ('form = "ring"\nradii = [0.3, 0.4, 0.5, 0.6]', {"form": "ring", "radii": [0.3, 0.4, 0.5, 0.6]}),
        ('form = "wound"\nwinding = [0, 1, 0]\ndimension = 3', {"form": "wound", "winding": (0, 1, 0), "dimension": 3}),
        ("lattice_vectors = [[1, 0], [0.3, 2]]\ntries = 900", {"box": [[1, 0.3], [0, 2]], "tries": 900}),
    ],
)
def test_chains_of_a_scene_file_are_those_that_the_function_makes(tmp_path, text, arguments):
    found = read(tmp_path, f'kind = "chains"\ncount = 3\nbeads = 4\npacking_fraction = 0.8\nseed = 3\n{text}')
    assert found == pm.chain_packing(3, 4, **{"dimension": 2, "packing_fraction": 0.8, "seed": 3} | arguments)


def test_another_seed_makes_other_clusters_and_chains(tmp_path):
    for text in ('kind = "clusters"\nshape = "dimer"', 'kind = "chains"\nbeads = 4'):
        first = read(tmp_path, f"{text}\ncount = 3\npacking_fraction = 0.6\nseed = 3")
        second = pm.read_scene(tmp_path / "scene.toml", seed=4).packing
        assert read(tmp_path, f"{text}\ncount = 3\npacking_fraction = 0.6\nseed = 4") == second != first


def test_links_written_by_hand_need_images_and_shapes_only_where_they_have_some(tmp_path):
    found = read(tmp_path, INLINE + "link_pairs = [[0, 1]]\nlink_lengths = [1]")
    assert found.links == pm.Links([0], [1], [[0, 0]], [1.0])


@pytest.mark.parametrize(
    ("packing", "message"),
    [
        (INLINE + "link_lengths = [1]", "packing.link_lengths must be left out without link_pairs"),
        (INLINE + "link_pairs = [[0, 1]]", "packing.link_lengths must be given with link_pairs, got nothing"),
        (
            INLINE + "link_pairs = [[0, 1, 1]]\nlink_lengths = [1]",
            r"packing.link_pairs\[0\] must hold 2 numbers, got 3",
        ),
        (INLINE + "link_pairs = [[0, 2]]\nlink_lengths = [1]", "packing.link_pairs must name particles below 2, got 2"),
        (INLINE + "link_pairs = [[0, 1]]\nlink_lengths = [-1]", "packing.link_lengths must be positive, got -1.0"),
        (
            INLINE + "link_pairs = [[0, 1]]\nlink_lengths = [1]\nlink_images = [[0, 0, 1]]",
            r"packing.link_images\[0\] must hold 2 numbers, got 3",
        ),
        (
            'kind = "clusters"\ncount = 2\npacking_fraction = 0.6\nseed = 1\nshape = { kind = "trimer", angle = 4 }',
            "packing.shape.angle must be a finite number above 0 and below 3.14159, got 4.0",
        ),
        (
            'kind = "clusters"\ncount = 2\npacking_fraction = 0.6\nseed = 1\nshape = "blob"',
            "packing.shape.kind must be one of 'cluster', 'dimer', .* got 'blob'",
        ),
        (
            'kind = "chains"\ncount = 2\nbeads = 4\npacking_fraction = 0.6\nseed = 1\nform = "knot"',
            "packing.form must be one of 'open', 'ring', 'wound', got 'knot'",
        ),
    ],
)
def test_a_wrong_packing_with_links_is_refused_naming_the_field(tmp_path, packing, message):
    with pytest.raises((TypeError, ValueError), match=f"^{message}"):
        read(tmp_path, packing)
