"""Facts about the contact network: a multigraph over periodic images, the same however the packing is written down."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import packmech as pm

SEEDS = st.integers(0, 2**32)


def clear_cut(difficult_packing, seed):
    """Return a packing whose gaps are far larger than rounding, so that rewriting it changes no contact."""
    packing = difficult_packing(seed, work=2e4)
    overlap_c = pm.find_contacts(packing, gap_tolerance=1e-6).overlap_c
    assume(np.abs(overlap_c).min(initial=1.0) > 1e-9)
    return packing


# -- against listing every image ---------------------------------------------------------------------------------------


@settings(max_examples=100, deadline=None)
@given(SEEDS, st.sampled_from([0.0, 1e-3, 0.5, -0.2]))
def test_contacts_are_those_found_by_listing_every_pair_and_image(
    list_pairs, difficult_packing, as_list, seed, tolerance
):
    packing = difficult_packing(seed, work=1e5)
    assert as_list(pm.find_contacts(packing, gap_tolerance=tolerance)) == list_pairs(packing, 1.0 + tolerance)


# -- one particle that touches its own images --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "contacts"),
    [("triangular", 3), ("square", 2), ("sc", 3), ("bcc", 4), ("fcc", 6)],
)
def test_one_particle_lattice_counts_each_of_its_contacts_with_images_once(name, contacts):
    # 6, 4, 6, 8, 12 neighbors: the image at z and the one at -z are the same contact
    packing = pm.lattice_packing(name)
    assert packing.particles == 1
    assert len(pm.find_contacts(packing, gap_tolerance=1e-12)) == contacts


def test_self_images_point_along_their_first_nonzero_component():
    image_cd = pm.find_contacts(pm.lattice_packing("fcc"), gap_tolerance=1e-12).image_cd
    first = [next(z for z in image if z) for image in image_cd.tolist()]
    assert all(z > 0 for z in first)


def test_one_pair_touches_through_several_images():
    # two discs in a cell one diameter wide: each stands between two images of the other, and touches its own
    packing = pm.Packing([[0.0, 0.0], [0.5, 0.5]], [0.5, 0.5], pm.Box([[1.0, 0.0], [0.0, 1.0]]))
    contacts = pm.find_contacts(packing, gap_tolerance=1e-12)
    between = contacts.image_cd[contacts.i_c != contacts.j_c].tolist()
    assert between == [[-1, -1], [-1, 0], [0, -1], [0, 0]]
    assert np.count_nonzero(contacts.i_c == contacts.j_c) == 4


def test_a_particle_larger_than_its_box_overlaps_all_images_within_its_diameter():
    # images of a point lattice of spacing 1 within distance 2 * 1.6 = 3.2: 37 - 1 lattice points of the circle, halved
    within = sum(1 for x in range(-4, 5) for y in range(-4, 5) if 0 < x * x + y * y <= 3.2**2)
    packing = pm.Packing([[0.3, 0.7]], [1.6], pm.Box.cubic(1.0, 2))
    assert len(pm.find_contacts(packing)) == within // 2


@pytest.mark.parametrize("dimension", [2, 3])
def test_nothing_touches_in_a_wide_box(dimension):
    packing = pm.Packing(np.zeros((1, dimension)), [0.5], pm.Box.cubic(1.5, dimension))
    contacts = pm.find_contacts(packing)
    assert len(contacts) == 0
    assert contacts.normal_cd.shape == (0, dimension) and contacts.gap_c.shape == (0,)


# -- geometry of each contact ------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_vector_runs_from_i_to_the_named_image_of_j(difficult_packing, seed):
    packing = difficult_packing(seed, work=2e4)
    contacts = pm.find_contacts(packing)
    x, lattice = packing.position_nd, packing.box.lattice_dd
    vector = x[contacts.j_c] - x[contacts.i_c] + contacts.image_cd @ lattice.T
    size = np.abs(x).max() + np.abs(lattice).max() * (1 + np.abs(contacts.image_cd).max(initial=0))
    np.testing.assert_allclose(contacts.vector_cd, vector, atol=1e-14 * size)
    np.testing.assert_allclose(contacts.distance_c, np.linalg.norm(vector, axis=1), rtol=1e-14, atol=1e-14 * size)


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_normals_are_unit_vectors_and_gaps_follow_from_distances(difficult_packing, seed):
    packing = difficult_packing(seed, work=2e4)
    contacts = pm.find_contacts(packing)
    np.testing.assert_allclose(np.linalg.norm(contacts.normal_cd, axis=1), 1.0, rtol=1e-15 * 4)
    sigma = packing.radius_n[contacts.i_c] + packing.radius_n[contacts.j_c]
    assert np.array_equal(contacts.contact_distance_c, sigma)
    assert (contacts.gap_c <= 0).all()
    np.testing.assert_allclose(contacts.overlap_c, -contacts.gap_c / sigma, atol=2e-16)


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_contacts_are_sorted_and_none_stands_twice(difficult_packing, as_list, seed):
    listed = as_list(pm.find_contacts(difficult_packing(seed, work=2e4)))
    assert listed == sorted(set(listed))


def test_coincident_centers_get_a_fixed_unit_normal():
    packing = pm.Packing([[0.25, 0.25]] * 3, [0.5] * 3, pm.Box.cubic(5.0, 2))
    first, second = (pm.find_contacts(packing) for _ in range(2))
    assert len(first) == 3
    assert first.distance_c.tolist() == [0.0] * 3
    np.testing.assert_allclose(np.linalg.norm(first.normal_cd, axis=1), 1.0, rtol=1e-15)
    assert first.normal_cd.tobytes() == second.normal_cd.tobytes()
    # three directions, so that three particles at one place leave it by different ways
    assert len({tuple(normal) for normal in first.normal_cd.tolist()}) == 3


@pytest.mark.parametrize(("tolerance", "count"), [(0.0, 0), (0.0499, 0), (0.0501, 1), (-0.5, 0)])
def test_gap_tolerance_is_relative_to_the_contact_distance(tolerance, count):
    # radii 1 and 3: sigma = 4, gap 0.2 = 0.05 sigma
    packing = pm.Packing([[0.0, 0.0], [4.2, 0.0]], [1.0, 3.0], pm.Box.cubic(20.0, 2))
    assert len(pm.find_contacts(packing, gap_tolerance=tolerance)) == count


def test_a_pair_that_just_touches_is_a_contact():
    packing = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    assert pm.find_contacts(packing).gap_c.tolist() == [0.0]


# -- the same packing written down otherwise ---------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_relabelling_particles_relabels_contacts(difficult_packing, as_list, forward, seed):
    packing = clear_cut(difficult_packing, seed)
    order = np.random.default_rng(seed).permutation(packing.particles)
    new_label = np.argsort(order)
    relabelled = packing.replace(position_nd=packing.position_nd[order], radius_n=packing.radius_n[order])
    expected = [
        forward((int(new_label[i]), int(new_label[j]), *image))
        for i, j, *image in as_list(pm.find_contacts(packing))
    ]  # fmt: skip
    assert as_list(pm.find_contacts(relabelled)) == sorted(expected)


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_moving_particles_by_lattice_vectors_changes_images_only(difficult_packing, as_list, seed):
    packing = clear_cut(difficult_packing, seed)
    moved_nd = np.random.default_rng(seed).integers(-4, 5, packing.position_nd.shape)
    moved = packing.replace(position_nd=packing.position_nd - moved_nd @ packing.box.lattice_dd.T)
    contacts = pm.find_contacts(packing)
    # polymer.md section 2: x_i -> x_i - lattice m changes z -> z - m for contacts from i, z + m for those into i
    image_cd = contacts.image_cd - moved_nd[contacts.i_c] + moved_nd[contacts.j_c]
    found = pm.find_contacts(moved)
    expected = sorted(zip(contacts.i_c.tolist(), contacts.j_c.tolist(), image_cd.tolist(), strict=True))
    assert as_list(found) == [(i, j, *image) for i, j, image in expected]


def unimodular(rng, dimension):
    """Return a random integer matrix of determinant 1 or -1, made of shears and swaps."""
    matrix = np.eye(dimension, dtype=np.int64)
    for _ in range(3):
        a, b = rng.permutation(dimension)[:2]
        matrix[:, a] += int(rng.integers(-2, 3)) * matrix[:, b]
        matrix = matrix[:, rng.permutation(dimension)]
    return matrix


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_other_lattice_vectors_of_the_same_lattice_change_images_only(difficult_packing, as_list, forward, seed):
    packing = clear_cut(difficult_packing, seed)
    change = unimodular(np.random.default_rng(seed), packing.dimension)
    other = packing.replace(box=pm.Box(packing.box.lattice_dd @ change))
    back = np.rint(np.linalg.inv(change)).astype(np.int64)
    expected = [
        forward((i, j, *(back @ np.array(image)).tolist())) for i, j, *image in as_list(pm.find_contacts(packing))
    ]
    assert as_list(pm.find_contacts(other)) == sorted(expected)


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.floats(-12, 12))
def test_the_unit_of_length_changes_no_contact(difficult_packing, as_list, seed, power):
    packing = clear_cut(difficult_packing, seed)
    unit = 10.0**power
    scaled = pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    assert as_list(pm.find_contacts(scaled)) == as_list(pm.find_contacts(packing))


def test_wrapping_changes_no_distance():
    packing = pm.random_packing(100, dimension=3, packing_fraction=0.7, seed=3)
    far = packing.replace(position_nd=packing.position_nd + 7 * packing.box.lattice_dd[:, 1])
    found, wrapped = pm.find_contacts(far), pm.find_contacts(far.wrapped())
    assert len(found) == len(wrapped)
    size = np.abs(far.position_nd).max()
    np.testing.assert_allclose(found.distance_c, wrapped.distance_c, atol=8 * np.finfo(float).eps * size)


def test_select_keeps_the_named_contacts_in_their_order():
    contacts = pm.find_contacts(pm.random_packing(30, dimension=2, packing_fraction=0.9, seed=1))
    keep = contacts.overlap_c > 0.2
    chosen = contacts.select(keep)
    assert len(chosen) == np.count_nonzero(keep)
    assert np.array_equal(chosen.image_cd, contacts.image_cd[keep])
    assert math.isclose(chosen.overlap_c.min(), contacts.overlap_c[keep].min())


def test_number_of_contacts_of_a_particle_counts_a_self_image_on_both_sides():
    assert pm.find_contacts(pm.lattice_packing("fcc"), gap_tolerance=1e-12).count_n().tolist() == [12]


@pytest.mark.parametrize(
    ("method", "given", "message"),
    [
        ("select", [99], "keep_c must be numbers of 27 rows, got 99"),
        ("select", np.zeros(3, dtype=bool), r"keep_c must be a mask of shape \(27,\)"),
        ("select", ["a"], "keep_c must be an array of booleans or integers"),
        ("select", [0.5], "keep_c must be an array of booleans or integers"),
        ("among", 3, "kept_n must be"),
        ("among", np.ones(3, dtype=bool), r"kept_n must have shape \(9,\)"),
        ("at", 3, "packing must be a Packing"),
    ],
)
def test_contacts_that_are_none_are_refused_by_name(method, given, message):
    contacts = pm.find_contacts(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01))
    with pytest.raises((TypeError, ValueError), match=message):
        getattr(contacts, method)(given)


def test_contacts_are_chosen_by_masks_numbers_from_either_end_and_not_at_all():
    contacts = pm.find_contacts(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01))
    mask = np.arange(len(contacts)) == len(contacts) - 1
    assert contacts.select(mask).i_c.tolist() == contacts.select([-1]).i_c.tolist() == contacts.i_c[-1:].tolist()
    assert len(contacts.select([])) == len(contacts.select(np.zeros(0))) == 0


@pytest.mark.parametrize("gap", [5e-13, 5e-11])
def test_without_a_tolerance_pairs_that_touch_to_a_billionth_count_only_where_none_overlap(gap):
    def row(overlap):
        place = np.cumsum([1.0, 1.0 - overlap, 1.0 + gap])
        return pm.Packing(np.stack([place, np.full(3, 2.0)], axis=1), [0.5] * 3, pm.Box.cubic(9.0, 2))

    assert len(pm.find_contacts(row(1e-3), gap_tolerance=None)) == 1
    assert len(pm.find_contacts(row(0.0), gap_tolerance=None)) == 2
    assert len(pm.find_contacts(row(1e-3), gap_tolerance=1e-10)) == 2


def test_points_of_contacts_lie_between_the_centers_as_radii_do_and_need_a_radius_for_each_particle():
    packing = pm.Packing([[1.0, 1.0], [2.4, 1.0]], [1.0, 0.5], pm.Box.cubic(9.0, 2))
    contacts = pm.find_contacts(packing)
    assert np.allclose(contacts.points(packing.radius_n), [[1.4 / 1.5, 0.0]], rtol=1e-15)
    for bad in (packing.radius_n[:1], packing.radius_n[:, None]):
        with pytest.raises(ValueError, match=r"radius_n must have shape \(2,\), got"):
            contacts.points(bad)
