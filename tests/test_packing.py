"""Facts about packings: arrays of one meaning, checked once, never changed."""

import numpy as np
import pytest

import packmech as pm


def two():
    return pm.Packing([[0.0, 0.0], [1.5, 0.0]], [0.5, 1.0], pm.Box.cubic(4.0, 2))


def test_arrays_are_copied_read_only_contiguous_doubles():
    position = np.asfortranarray(np.arange(6, dtype=np.float32).reshape(3, 2))
    packing = pm.Packing(position, np.array([1, 2, 3]), pm.Box.cubic(9.0, 2))
    position[0, 0] = 7.0
    for array in (packing.position_nd, packing.radius_n):
        assert array.dtype == np.float64 and array.flags.c_contiguous and not array.flags.writeable
    assert packing.position_nd[0, 0] == 0.0


def test_one_radius_and_one_length_stand_for_all():
    place = [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]]
    whole = pm.Packing(place, [0.5, 0.5], pm.Box(np.diag([4.0, 4.0, 4.0])))
    assert pm.Packing(place, 0.5, 4) == pm.Packing(place, np.float64(0.5), [4.0, 4.0, 4.0]) == whole
    assert pm.Packing(place, 0.5, (4.0, 5.0, 6.0)).box == pm.Box([4.0, 5.0, 6.0]) == pm.Box(np.diag([4.0, 5.0, 6.0]))
    assert whole.replace(radius_n=0.25).radius_n.tolist() == [0.25, 0.25]


def test_radii_may_be_listed_where_packings_are_made():
    radius = [0.5, 0.6, 0.7, 0.5]
    packing = pm.random_packing(4, dimension=2, packing_fraction=0.5, sizes=radius, seed=1)
    assert packing.radius_n.tolist() == radius and pm.packing_fraction(packing) == pytest.approx(0.5, rel=1e-14)
    with pytest.raises(ValueError, match=r"sizes must hold as many radii as are drawn \(5\), got 4"):
        pm.random_packing(5, dimension=2, packing_fraction=0.5, sizes=radius, seed=1)


def test_numbers_that_follow_from_the_arrays():
    packing = two()
    assert (packing.particles, packing.dimension) == (2, 2)
    assert packing.diameter_n.tolist() == [1.0, 2.0]


def test_reference_diameter_of_a_mixture_is_the_smallest():
    for count in (1, 2, 10):
        radius = np.repeat(np.linspace(0.5, 1.0, count), 3)
        packing = pm.Packing(np.zeros((len(radius), 2)), radius[::-1], pm.Box.cubic(9.0, 2))
        assert packing.reference_diameter == 1.0


def test_reference_diameter_of_continuous_sizes_is_the_mean():
    radius = np.linspace(0.5, 1.5, 11)
    packing = pm.Packing(np.zeros((11, 3)), radius, pm.Box.cubic(9.0, 3))
    assert packing.reference_diameter == pytest.approx(2.0, rel=1e-15)


def test_rounding_of_equal_radii_makes_no_new_size():
    radius = 0.5 * (1 + 2e-16 * np.arange(40))
    packing = pm.Packing(np.zeros((40, 2)), radius, pm.Box.cubic(9.0, 2))
    assert packing.reference_diameter == 1.0


def test_replace_exchanges_the_named_field_and_leaves_the_original():
    packing = two()
    moved = packing.replace(position_nd=packing.position_nd + 1.0)
    assert moved.position_nd.tolist() == [[1.0, 1.0], [2.5, 1.0]]
    assert moved.box is packing.box and packing == two()


def test_packings_are_equal_when_every_bit_is():
    assert two() == two() and hash(two()) == hash(two())
    for change in (
        {"position_nd": two().position_nd + [0.0, 2**-60]},
        {"radius_n": [0.5, 1.0 + 2**-52]},
        {"box": pm.Box.cubic(4.0 + 2**-50, 2)},
    ):
        assert two() != two().replace(**change)
    assert two() != "packing"


def test_wrapped_brings_every_center_into_the_cell():
    packing = two().replace(position_nd=[[-1.0, 9.0], [4.0, 3.5]])
    assert packing.wrapped().position_nd.tolist() == [[3.0, 1.0], [0.0, 3.5]]


def test_a_field_cannot_be_set():
    with pytest.raises(AttributeError):
        two().radius_n = [1.0, 1.0]


BOX = pm.Box.cubic(4.0, 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0.0, 0.0]], [0.5], np.eye(2)), "box must be a Box, got array"),
        (([[0.0, np.nan]], [0.5], BOX), "position_nd must be finite, got nan for particle 0"),
        (([[0.0, 0.0], [np.inf, 0.0]], [0.5, 0.5], BOX), "position_nd must be finite, got inf for particle 1"),
        (([[0.0, 0.0, 0.0]], [0.5], BOX), r"position_nd must have shape \(any, 2\), got \(1, 3\)"),
        ((np.zeros((0, 2)), [], BOX), "position_nd must hold at least one particle, got none"),
        (([], [], BOX), r"position_nd must have shape \(any, 2\), got \(0,\)"),
        (([[0.0, 0.0]], [-0.5], BOX), "radius_n must be positive, got -0.5 for particle 0"),
        (([[0.0, 0.0], [1.0, 1.0]], [0.5, 0.0], BOX), "radius_n must be positive, got 0.0 for particle 1"),
        (([[0.0, 0.0]], [np.nan], BOX), "radius_n must be finite, got nan for particle 0"),
        (([[0.0, 0.0]], [0.5, 0.5], BOX), r"radius_n must have one entry per particle \(1\), got 2"),
        (([[0.0, 0.0]], -0.5, BOX), "radius_n must be a finite number above 0, got -0.5"),
        (([[0.0, 0.0]], True, BOX), "radius_n must have shape"),
        (([[0.0, 0.0]], 0.5, -2.0), "box must be a finite number above 0, got -2.0"),
        (
            ([[0.0, 0.0]], 0.5, [2.0, 3.0, 4.0]),
            "box must be a Box, got .2.0, 3.0, 4.0. .one length, or those of its 2 sides, would do",
        ),
        (([["a", "b"]], [0.5], BOX), "position_nd must be an array of real numbers"),
        (([[0.0, 0.0]], [None], BOX), "radius_n must be an array of real numbers"),
        (([[0.0], [0.0, 1.0]], [0.5, 0.5], BOX), "position_nd must be an array of real numbers"),
    ],
)
def test_wrong_packing_is_refused_naming_argument_and_particle(arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.Packing(*arguments)


def test_a_packing_says_what_it_is_in_one_line():
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    assert repr(packing) == "Packing of 9 particles in 2D: radius 0.5, box of area 7.79423"
    place, box = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], pm.Box.cubic(3.0, 3)
    shaped = pm.Packing(place, [0.5, 0.4], box, shapes=pm.Spheroids([2.0, 0.5], [[1.0, 0.0, 0.0]] * 2))
    linked = pm.Packing(place, [0.5, 0.5], box, pm.Links([0], [1], [[0, 0, 0]], [1.0]), mass_n=[1.0, 2.0])
    assert repr(shaped) == "Packing of 2 particles in 3D: radii 0.4 to 0.5, box of volume 27, Spheroids"
    assert repr(linked) == "Packing of 2 particles in 3D: radius 0.5, box of volume 27, 1 rigid link, masses given"


@pytest.mark.parametrize("d", [2, 3])
def test_discs_and_spheres_answer_what_other_shapes_do(d):
    packing = pm.random_packing(12, dimension=d, packing_fraction=0.3, seed=4)
    bodies, radius_n = packing.shapes, packing.radius_n
    even = pm.Spheroids(np.ones(12), np.eye(d)[[0] * 12])
    assert not bodies.has_orientations and (len(bodies), bodies.dimension) == (12, d)
    for question in ("reach", "gyration", "stiffening", "site_radius", "sweep"):
        assert np.allclose(getattr(bodies, question)(radius_n), getattr(even, question)(radius_n), rtol=1e-14)
    assert packing.turn_nkt.shape[:2] == (12, 0) and not bodies.turns_n.any()
    for question in ("start_n", "particle_b"):
        assert np.array_equal(getattr(bodies, question), getattr(even, question))
    assert not bodies.turned_arrays() and not len(bodies.long_axes()) and not len(bodies.coordinates(bodies, radius_n))
    assert bodies.turned(np.ones((12, 3))) == bodies.oriented(bodies.orientation_nq) == bodies
    assert packing.select(np.arange(12) < 5).shapes == bodies.select(np.arange(12) < 5) == bodies.select(np.arange(5))


def test_a_packing_without_shapes_or_links_is_the_same_with_discs_and_no_links():
    packing = pm.random_packing(12, dimension=2, packing_fraction=0.3, seed=4)
    links = packing.links
    assert not links and links.vectors(packing.position_nd, np.eye(2)).shape == (0, 2)
    again = packing.replace(shapes=packing.shapes, links=links)
    assert again == packing and again.plain and again.links is links and again.shapes == packing.shapes
    assert links.clusters(12).tolist() == list(range(12)) and packing.link_error == 0.0
    with pytest.raises(ValueError, match="shapes must be of as many particles"):
        packing.replace(shapes=packing.shapes.select(np.arange(3)))
    box = pm.Box.cubic(9.0, 3)
    other = packing.replace(position_nd=np.eye(3), radius_n=[0.1] * 3, box=box)
    assert (len(other.shapes), other.shapes.dimension, other.links.dimension) == (3, 3, 3)


@pytest.mark.parametrize("repeats", [(1, 1), (3, 2)])
def test_copies_side_by_side_have_as_many_times_the_energy_the_contacts_and_the_links(repeats):
    copies = repeats[0] * repeats[1]
    springs = (pm.Repulsion(),)
    trimers = pm.random_packing(12, dimension=2, packing_fraction=0.7, seed=2, shapes=pm.Trimer())
    ellipses = pm.random_packing(12, dimension=2, packing_fraction=0.8, seed=2, shapes=pm.Ellipses(1.5))
    discs = pm.random_packing(12, dimension=2, packing_fraction=0.9, seed=2)
    tilted = discs.replace(box=discs.box.strained([[0.0, 0.3], [0.1, 0.0]]))
    for packing in (trimers, ellipses, discs, tilted):
        many = packing.repeated(repeats)
        assert many.particles == copies * packing.particles and len(many.links) == copies * len(packing.links)
        assert many.select(np.arange(packing.particles)).radius_n.tolist() == packing.radius_n.tolist()
        one = pm.energy(pm.Scene(packing, springs))
        assert pm.energy(pm.Scene(many, springs)) == pytest.approx(copies * one, rel=1e-12)
        assert many.link_error <= 1e-12


def test_links_across_the_box_join_a_copy_to_the_next_and_the_last_to_the_first():
    bar = pm.Packing([[3.6, 1.0], [0.4, 1.0]], [0.3, 0.3], pm.Box.cubic(4.0, 2), pm.Links([0], [1], [[1, 0]], [0.8]))
    many = bar.repeated((3, 1))
    # the link of the last copy, 4-1 through the box, is named from its smaller end
    assert (many.links.i_l.tolist(), many.links.j_l.tolist()) == ([0, 1, 2], [3, 4, 5])
    assert many.links.image_ld.tolist() == [[0, 0], [-1, 0], [0, 0]] and many.link_error <= 1e-15


@pytest.mark.parametrize(
    ("repeats", "words"),
    [
        ((0, 1), r"repeats\[0\] must be an integer at least 1, got 0"),
        ((2,), "repeats must be 2 whole numbers"),
        ("ab", "repeats must be a sequence of whole numbers"),
        ((1, 1.5), r"repeats\[1\] must be an integer"),
        ((10**9, 10**9), "repeats must be so small that memory holds it"),
    ],
)
def test_copies_are_asked_for_by_whole_numbers(repeats, words):
    with pytest.raises((TypeError, ValueError), match=words):
        pm.lattice_packing("square").repeated(repeats)
