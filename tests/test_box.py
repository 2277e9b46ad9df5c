"""Facts about periodic boxes."""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.box import Copies


@st.composite
def lattices(draw, tilt=10.0):
    """Lattice vectors in 2D and 3D: sides 0.05 to 20, tilts up to `tilt`, any orientation and handedness."""
    dimension = draw(st.sampled_from([2, 3]))
    side = st.floats(0.05, 20.0)
    lattice = np.diag([draw(side) for _ in range(dimension)])
    for a, b in itertools.combinations(range(dimension), 2):
        lattice[a, b] = draw(st.floats(-tilt, tilt)) * lattice[a, a]
    turn = np.linalg.qr(np.random.default_rng(draw(st.integers(0, 2**32))).standard_normal((dimension, dimension)))[0]
    return turn @ lattice


@given(lattices())
def test_volume_is_the_determinant(lattice):
    assert pm.Box(lattice).volume == pytest.approx(abs(np.linalg.det(lattice)), rel=1e-15)


@given(lattices())
def test_inverse_undoes_the_lattice(lattice):
    box = pm.Box(lattice)
    # rounding grows with the condition number of the directions, and with the ratio of two vectors' lengths
    length = np.linalg.norm(lattice, axis=0)
    bound = 1e-15 * condition(lattice) * length[None, :] / length[:, None]
    assert (np.abs(box.inverse_dd @ lattice - np.eye(box.dimension)) <= 4 * bound).all()


def condition(lattice):
    """Return the condition number of the directions of the lattice vectors, which rounding is multiplied by."""
    return float(np.linalg.cond(lattice / np.linalg.norm(lattice, axis=0)))


@given(lattices())
def test_height_is_the_distance_of_a_vector_from_the_plane_of_the_others(lattice):
    box = pm.Box(lattice)
    for k in range(box.dimension):
        ordered = np.concatenate([np.delete(lattice, k, axis=1), lattice[:, [k]]], axis=1)
        distance = abs(np.linalg.qr(ordered)[1][-1, -1])
        assert box.height_d[k] == pytest.approx(distance, rel=1e-14 * condition(lattice))


@given(lattices(), st.integers(0, 2**32))
def test_wrapping_brings_positions_inside_and_says_what_it_took_away(lattice, seed):
    box = pm.Box(lattice)
    position = np.random.default_rng(seed).uniform(-50, 50, (20, box.dimension))
    wrapped, image = box.wrap(position)
    size = np.abs(box.inverse_dd).max() * (np.abs(position).max() + np.abs(lattice).max())
    np.testing.assert_allclose(wrapped + image @ lattice.T, position, atol=1e-15 * size * np.abs(lattice).max())
    fraction = wrapped @ box.inverse_dd.T
    assert fraction.min() >= -1e-14 * size and fraction.max() <= 1 + 1e-14 * size
    assert image.dtype == np.int64


def test_wrapping_nothing_gives_nothing():
    wrapped, image = pm.Box.cubic(2.0, 3).wrap(np.zeros((0, 3)))
    assert wrapped.shape == image.shape == (0, 3)


@given(lattices())
def test_strain_multiplies_the_lattice_from_the_left(lattice):
    box = pm.Box(lattice)
    strain = 0.1 * np.arange(box.dimension**2).reshape(box.dimension, box.dimension)
    strained = box.strained(strain)
    np.testing.assert_allclose(strained.lattice_dd, lattice + strain @ lattice, rtol=1e-13, atol=1e-13)
    expected = box.volume * abs(np.linalg.det(np.eye(box.dimension) + strain))
    assert strained.volume == pytest.approx(expected, rel=1e-14 * condition(lattice))


def test_simple_shear_tilts_the_second_vector():
    assert pm.Box.cubic(2.0, 2).strained([[0.0, 0.25], [0.0, 0.0]]) == pm.Box([[2.0, 0.5], [0.0, 2.0]])


@settings(deadline=None)
@given(lattices())
def test_reduced_vectors_span_the_same_lattice(lattice):
    box = pm.Box(lattice)
    reduced, change = box.reduced()
    assert change.dtype == np.int64
    assert abs(round(np.linalg.det(change))) == 1
    size = np.abs(lattice).max() * np.abs(change).max()
    np.testing.assert_allclose(reduced.lattice_dd, lattice @ change, atol=1e-15 * size)
    assert reduced.volume == pytest.approx(box.volume, rel=1e-14 * condition(lattice))


@settings(max_examples=60, deadline=None)
@given(lattices(tilt=5.0))
def test_reduced_vectors_are_the_shortest_independent_ones(lattice):
    reduced = pm.Box(lattice).reduced()[0]
    dimension = reduced.dimension
    # every lattice vector no longer than the longest reduced one has coefficients below longest / height
    longest = np.linalg.norm(reduced.lattice_dd, axis=0).max()
    most = np.ceil(longest / reduced.height_d).astype(int)
    steps = np.array([z for z in itertools.product(*[range(-m, m + 1) for m in most]) if any(z)])
    vectors = steps @ reduced.lattice_dd.T
    vectors = vectors[np.linalg.norm(vectors, axis=1) <= longest * (1 + 1e-9)]
    beyond, expected = vectors.copy(), []
    for _ in range(dimension):
        # the shortest vector that is not in the span of those before
        free = np.linalg.norm(beyond, axis=1) > 1e-7 * np.linalg.norm(vectors, axis=1)
        vectors, beyond = vectors[free], beyond[free]
        k = np.argmin((vectors**2).sum(axis=1))
        expected.append(float(np.linalg.norm(vectors[k])))
        direction = beyond[k] / np.linalg.norm(beyond[k])
        beyond = beyond - np.outer(beyond @ direction, direction)
    assert sorted(np.linalg.norm(reduced.lattice_dd, axis=0)) == pytest.approx(expected, rel=1e-9)


@settings(max_examples=60, deadline=None)
@given(lattices(tilt=5.0), st.integers(0, 2**32 - 1))
def test_nearest_images_are_no_farther_than_any_other(lattice, seed):
    box = pm.Box(lattice)
    short, d = box.reduced()[0], box.dimension
    vector = (np.random.default_rng(seed).random((20, d)) - 0.5) @ (3.0 * lattice.T)
    found = vector + box.nearest_images(vector) @ lattice.T
    # with reduced vectors the nearest image lies within two of a rounded one, even at the least height
    around = np.array(list(itertools.product(range(-2, 3), repeat=d))) @ short.lattice_dd.T
    rounded = vector - np.rint(vector @ short.inverse_dd.T) @ short.lattice_dd.T
    least = np.linalg.norm(rounded[:, None] + around, axis=2).min(axis=1)
    size = np.abs(lattice).max()
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), least, rtol=1e-9, atol=1e-12 * size)


@given(lattices())
def test_reducing_twice_changes_no_length(lattice):
    once = pm.Box(lattice).reduced()[0]
    twice = once.reduced()[0]
    lengths = [np.sort(np.linalg.norm(box.lattice_dd, axis=0)) for box in (once, twice)]
    np.testing.assert_allclose(lengths[0], lengths[1], rtol=1e-12)


@pytest.mark.parametrize("tilt", [1e3, 1e6])
def test_a_square_lattice_written_with_a_huge_tilt_is_found_again(tilt):
    reduced = pm.Box([[1.0, tilt], [0.0, 1.0]]).reduced()[0]
    np.testing.assert_allclose(np.linalg.norm(reduced.lattice_dd, axis=0), 1.0, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_unit_of_length_changes_no_inverse_height_or_reduction(unit):
    lattice = np.array([[3.0, 7.0], [0.5, 2.0]])
    box, scaled = pm.Box(lattice), pm.Box(unit * lattice)
    np.testing.assert_allclose(scaled.inverse_dd * unit, box.inverse_dd, rtol=1e-14)
    np.testing.assert_allclose(scaled.height_d / unit, box.height_d, rtol=1e-14)
    assert np.array_equal(scaled.reduced()[1], box.reduced()[1])


@given(lattices(), st.floats(1e-12, 1e12))
def test_scaling_multiplies_every_length(lattice, factor):
    box = pm.Box(lattice)
    assume(np.isfinite(factor * lattice).all())
    assert box.scaled(factor) == pm.Box(factor * lattice)


def test_a_box_keeps_its_own_read_only_copy():
    lattice = np.eye(2)
    box = pm.Box(lattice)
    lattice[0, 0] = 5.0
    assert box.lattice_dd[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        box.lattice_dd[0, 0] = 2.0


def test_boxes_are_equal_when_every_bit_of_their_vectors_is():
    one, same, other = pm.Box(np.eye(2)), pm.Box(np.eye(2)), pm.Box(np.eye(2) * (1 + 2**-52))
    assert one == same and hash(one) == hash(same)
    assert one != other and one != np.eye(2).tolist()


@pytest.mark.parametrize(
    ("lattice", "message"),
    [
        ([[1.0, 0.0], [0.0, np.nan]], "lattice_dd must be finite, got nan"),
        ([[1.0, 2.0], [2.0, 4.0]], "lattice_dd must have linearly independent columns"),
        (np.zeros((3, 3)), "lattice_dd must have linearly independent columns"),
        (np.eye(4), r"lattice_dd must have shape \(2, 2\) or \(3, 3\), got \(4, 4\)"),
        (np.ones((2, 3)), r"lattice_dd must have shape \(2, 2\) or \(3, 3\), got \(2, 3\)"),
        ([1.0, -2.0], "lattice_dd must be positive, got -2.0 for side 1"),
        (3.0, r"lattice_dd must say how many dimensions a box has, got 3.0: take Box.cubic\(3.0, 2\)"),
        ("box", "lattice_dd must be an array of real numbers, got 'box'"),
        ([[1.0, 1j], [0.0, 1.0]], "lattice_dd must be an array of real numbers"),
    ],
)
def test_wrong_lattice_vectors_are_refused(lattice, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.Box(lattice)


@pytest.mark.parametrize("repeats", [(3,), (2, 3), (1, 2, 4)])
def test_what_leaves_a_copy_ends_in_another_or_in_an_image_of_all(repeats):
    copies, size = Copies(repeats), np.array(repeats)
    image_cd = np.random.default_rng(0).integers(-5, 6, size=(20, len(repeats)))
    number, beyond = copies.reached(image_cd)
    assert copies.place_md.tolist() == [list(place) for place in itertools.product(*map(range, repeats))]
    np.testing.assert_array_equal(copies.place_md[number] + beyond * size, copies.place_md[:, None] + image_cd)
