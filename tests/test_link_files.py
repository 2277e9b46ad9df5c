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
    with pytest.raises(ValueError, match=r"^packing must have no links for .txt files \(only .npz and .gsd keep them"):
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
        arrays = {name: archive[name] for name in archive.files if name != "link_image_ld"}
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
