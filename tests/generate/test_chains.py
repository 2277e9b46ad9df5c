"""Facts about random starting packings of chains: no bond across another, no redundant link, images as state."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.links import image_offsets

STAR = (0, 0, 0, 1, 2, 3, 4, 5, 6)
FORMS = ["open", "ring", "wound", STAR]


def chains(count=3, beads=10, dimension=2, packing_fraction=0.5, seed=1, **more):
    return pm.chain_packing(count, beads, dimension=dimension, packing_fraction=packing_fraction, seed=seed, **more)


def unwrapped(packing):
    offset, winding = image_offsets(packing.links, packing.particles)
    return packing.position_nd + offset @ packing.box.lattice_dd.T, winding


def bends(packing, beads):
    """Return the angles between successive links of open chains, from unwrapped places."""
    step = np.diff(unwrapped(packing)[0].reshape(-1, beads, packing.dimension), axis=1)
    step /= np.linalg.norm(step, axis=-1)[..., None]
    return np.arccos(np.clip((step[:, 1:] * step[:, :-1]).sum(axis=-1), -1, 1))


def jacobian_rank(packing):
    """Return the rank of the links' derivatives, from singular values of one dense matrix."""
    links = packing.links
    vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
    normal = vector / np.linalg.norm(vector, axis=1)[:, None]
    matrix = np.zeros((len(links), packing.particles, packing.dimension))
    matrix[np.arange(len(links)), links.j_l] += normal
    matrix[np.arange(len(links)), links.i_l] -= normal
    value = np.linalg.svd(matrix.reshape(len(links), -1), compute_uv=False)
    return int((value > 1e-10 * value[0]).sum())


@pytest.mark.parametrize("angles", ["free", "fixed"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("form", FORMS)
def test_links_have_their_lengths_to_rounding_and_none_is_redundant(form, dimension, angles):
    for seed in range(5):
        packing = chains(3, 10, dimension, form=form, angles=angles, link_length=1.1, seed=seed)
        bond = ~packing.links.shape_l
        assert (packing.links.length_l[bond] == 1.1).all()
        assert packing.link_error < 8 * np.finfo(float).eps * packing.box.lattice_dd.max()
        assert jacobian_rank(packing) == len(packing.links)


def inner_freedoms(form, dimension, beads):
    # a chain around the box turns about the way it winds only
    around = (dimension - 1) * (dimension - 2) // 2
    return dimension * beads - dimension - (around if form == "wound" else dimension * (dimension - 1) // 2)


@pytest.mark.parametrize("form", FORMS)
def test_a_chain_with_fixed_angles_is_rigid_in_two_dimensions(form):
    packing = chains(1, 10, form=form, angles="fixed")
    assert len(packing.links) == jacobian_rank(packing) == inner_freedoms(form, 2, 10)


@pytest.mark.parametrize(("form", "links"), [("open", 9 + 8), ("ring", 20), ("wound", 20), (STAR, 9 + 9)])
def test_fixed_angles_in_three_dimensions_leave_dihedral_angles_free(form, links):
    # ten beads: one angle at each bead with two bonds, three at the star's center
    packing = chains(1, 10, 3, form=form, angles="fixed")
    assert len(packing.links) == links < inner_freedoms(form, 3, 10)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("form", ["ring", "wound"])
@pytest.mark.parametrize("beads", [3, 4, 5, 6])
def test_short_closed_chains_have_no_link_too_many(form, dimension, beads):
    for seed in range(4):
        fraction = 0.7 if dimension == 2 else 0.9
        packing = chains(1, beads, dimension, fraction, form=form, angles="fixed", seed=seed, radii=0.6, tries=5000)
        assert len(packing.links) == jacobian_rank(packing) <= inner_freedoms(form, dimension, beads)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(FORMS), st.integers(0, 2**32), st.sampled_from([0.5, 0.7, 0.9]))
def test_no_bond_crosses_another_in_two_dimensions(form, seed, packing_fraction):
    packing = chains(4, 10, form=form, packing_fraction=packing_fraction, seed=seed, tries=2000)
    assert len(pm.crossing_links(packing)) == 0


def test_allowed_crossings_happen_at_high_density():
    assert len(pm.crossing_links(chains(6, 10, packing_fraction=0.9, crossing="allowed"))) > 0


def test_no_bond_crosses_another_in_a_tilted_box_narrower_than_two_links():
    packing = chains(2, 12, packing_fraction=0.1, radii=0.1, box=[[2.0, 1.4], [0.0, 0.5]], tries=2000)
    assert packing.box.height_d.min() < 2.0
    assert len(pm.crossing_links(packing)) == 0


def test_one_chain_of_thirty_at_high_density_is_found_for_any_of_twenty_seeds():
    for seed in range(20):
        packing = chains(1, 30, packing_fraction=0.9, angles="fixed", seed=seed)
        assert len(pm.crossing_links(packing)) == 0 and len(packing.links) == 57


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(FORMS), st.sampled_from([2, 3]), st.floats(0.5, 1.5), st.integers(0, 2**32))
def test_packing_fraction_of_chains_whose_links_never_overlap_is_the_sum_over_all_beads(
    form, dimension, packing_fraction, seed
):
    packing = chains(2, 10, dimension, packing_fraction, seed, form=form, crossing="allowed", tries=5000)
    ball = math.pi if dimension == 2 else 4 * math.pi / 3
    fraction = ball * math.fsum(packing.radius_n**dimension) / packing.box.volume
    assert fraction == pytest.approx(packing_fraction, rel=1e-14)
    assert pm.packing_fraction(packing) == pytest.approx(fraction, rel=1e-14)


@pytest.mark.parametrize("angles", ["free", "fixed", 2.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_chains_with_fused_neighbors_fill_the_packing_fraction_asked_for(dimension, angles):
    for seed in range(5):
        packing = chains(4, 8, dimension, 0.5, seed, radii=0.8, angles=angles)
        assert pm.packing_fraction(packing) == pytest.approx(0.5, rel=1e-12)
        assert packing.link_error < 1e-13
        assert dimension == 3 or len(pm.crossing_links(packing)) == 0


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("form", FORMS)
def test_same_seed_gives_the_same_packing_to_the_last_bit_and_another_another(form, dimension):
    make = lambda seed: chains(3, 10, dimension, form=form, seed=seed, sizes=pm.LogNormal(0.2))  # noqa: E731
    assert make(3) == make(3)
    assert make(3) != make(4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_only_wound_chains_wind_and_by_the_vector_asked_for(dimension):
    for form in FORMS:
        assert unwrapped(chains(2, 10, dimension, form=form))[1].all() == (form == "wound")
    winding = (1, -1, 0)[:dimension]
    packing = chains(2, 20, dimension, 0.9, form="wound", winding=winding)
    # the links' images add up, along each chain, to the vector that it winds by
    links = packing.links
    step = links.j_l - links.i_l
    around = np.where((step == 1)[:, None], links.image_ld, -links.image_ld)
    np.testing.assert_array_equal(around[links.i_l < 20].sum(axis=0), winding)
    np.testing.assert_array_equal(around[links.i_l >= 20].sum(axis=0), winding)


def test_beads_follow_those_that_a_branched_form_names():
    packing = chains(2, 10, form=STAR)
    pairs = sorted(zip(packing.links.i_l.tolist(), packing.links.j_l.tolist(), strict=True))
    expected = [(b, k + 1) for k, b in enumerate(STAR)]
    assert pairs == sorted([*expected, *((i + 10, j + 10) for i, j in expected)])


@pytest.mark.parametrize("dimension", [2, 3])
def test_nearly_straight_chains_bend_by_no_more_than_was_said_and_by_something(dimension):
    angle = bends(chains(2, 50, dimension, angles="fixed", bend=0.01), 50)
    assert angle.max() < 0.01 * (1 + 1e-6) and angle.min() > 0.99e-5
    assert angle.max() > 0.009


@pytest.mark.parametrize("dimension", [2, 3])
def test_default_bends_keep_next_neighbors_but_one_at_least_a_link_apart(dimension):
    packing = chains(20, 20, dimension, crossing="allowed")
    assert bends(packing, 20).max() < 2 * math.pi / 3 + 1e-9
    place = unwrapped(packing)[0].reshape(20, 20, dimension)
    assert np.linalg.norm(place[:, 2:] - place[:, :-2], axis=-1).min() > 1 - 1e-9


@pytest.mark.parametrize(("dimension", "mean"), [(2, math.pi / 3), (3, None)])
def test_bends_are_uniform_in_the_angle_or_over_the_cap(dimension, mean):
    angle = bends(chains(100, 30, dimension, crossing="allowed"), 30).ravel()
    if dimension == 2:
        assert angle.mean() == pytest.approx(mean, abs=5 * mean / math.sqrt(3 * len(angle)))
    else:
        # the cosine is uniform from 1 to cos(120 degrees) = -1/2
        assert np.cos(angle).mean() == pytest.approx(0.25, abs=5 * 0.75 / math.sqrt(3 * len(angle)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_angles_asked_for_are_those_between_the_links(dimension):
    angles = np.linspace(1.2, 3.0, 8)
    packing = chains(3, 10, dimension, angles=angles)
    np.testing.assert_allclose(np.pi - bends(packing, 10), np.tile(angles, (3, 1)), atol=1e-9)
    same = chains(3, 10, dimension, angles=2.0)
    np.testing.assert_allclose(np.pi - bends(same, 10), 2.0, atol=1e-9)
    assert len(same.links) == 3 * 17


def test_radii_are_one_for_all_or_repeat_along_each_chain_or_are_drawn():
    assert (chains(radii=0.3).radius_n == 0.3).all()
    along = np.linspace(0.3, 0.6, 10)
    np.testing.assert_array_equal(chains(radii=along).radius_n, np.tile(along, 3))
    drawn = chains(4, 10, sizes=pm.Bidisperse(1.4)).radius_n
    assert sorted(drawn) == [0.5] * 20 + [0.7] * 20 and drawn.tolist() != sorted(drawn)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"form": "ring", "beads": 2}, "beads must be at least 3 for a chain that closes, got 2"),
        (
            {"form": "wound", "packing_fraction": 0.01},
            r"beads must be at least \d\d for a chain to reach around the box",
        ),
        ({"angles": "fixed", "bend": 0.0}, "bend must be at least 1e-6 for angles that links can hold, got 0"),
        ({"angles": [1.0] * 7 + [math.pi]}, "angles must be at least 1e-6 away from 0 and pi, got 3.14159 for angle 7"),
        ({"angles": [1.0] * 7}, "angles must have one entry per inner bead .8., got 7"),
        ({"angles": 2.0, "form": "ring"}, "angles must be 'free' or 'fixed' unless form is 'open', got 2.0"),
        ({"winding": (1, 0)}, "winding must be left out unless form is 'wound'"),
        ({"winding": (0, 0), "form": "wound"}, "winding must be whole numbers, not all 0"),
        ({"radii": 0.5, "sizes": pm.Monodisperse()}, "radii must be left out when sizes are given"),
        ({"radii": 1e13}, r"link_length must be at least 1e-12 of the largest radius 1e\+13, got 1"),
        ({"radii": 1e200, "link_length": 1e200}, "radii must be of volumes that float64 can hold, got 1e.200"),
        ({"radii": 1e154, "link_length": 1.5e154}, "radii must be of volumes that float64 can hold, got 1e.154"),
        ({"link_length": 1e12, "dimension": 3}, "link_length must be at most .* heights of the box, got 1e"),
        ({"form": (0, 0)}, "form must name a bead for each bead but the first .9., got 2"),
    ],
)
def test_chains_that_cannot_be_are_refused_with_the_reason(arguments, message):
    with pytest.raises(ValueError, match=message):
        chains(**arguments)


def test_bonds_without_room_end_in_an_error_that_names_the_chain():
    with pytest.raises(ValueError, match="^bend must be larger, or crossing 'allowed', .* no way in 5 tries"):
        chains(20, 30, packing_fraction=0.9, link_length=5.0, tries=5)


# -- long chains at high density in a plane, which slither out of rows -------------------------------------------------


@pytest.fixture(scope="module", params=[(1, 400), (10, 100)], ids=["one of 400", "ten of 100"])
def dense(request):
    count, beads = request.param
    return count, beads, chains(count, beads, packing_fraction=0.9, angles="fixed", bend=2.0, seed=2)


def test_long_chains_at_high_density_do_not_cross(dense):
    count, beads, packing = dense
    assert len(pm.crossing_links(packing)) == 0
    assert len(packing.links) == count * (2 * beads - 3)


def test_long_chains_at_high_density_keep_lengths_and_bends(dense):
    _, beads, packing = dense
    assert packing.link_error < 8 * np.finfo(float).eps * packing.box.lattice_dd.max()
    angle = bends(packing, beads)
    assert angle.max() < 2.0 + 1e-9 and angle.min() > 2e-3 - 1e-9


def nematic_order(packing):
    """Return 1 for bonds of one direction, 0 for any."""
    bond = ~packing.links.shape_l
    along = packing.links.vectors(packing.position_nd, packing.box.lattice_dd)[bond]
    along /= np.linalg.norm(along, axis=1)[:, None]
    return np.linalg.norm(2 * along.T @ along / bond.sum() - np.eye(2), 2)


def test_chains_that_slither_long_enough_forget_the_direction_of_their_rows(monkeypatch):
    order = []
    for lengths in (0, 20):
        monkeypatch.setattr("packmech.generate.chains._LENGTHS", lengths)
        order.append(nematic_order(chains(10, 100, packing_fraction=0.9, seed=2)))
    assert order[0] > 0.5 and order[1] < 0.3


def test_chains_that_slither_are_the_same_to_the_last_bit_for_the_same_seed():
    first, second = (chains(4, 60, packing_fraction=0.9, link_length=2.0, seed=3) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("dimension", [2, 3])
def test_beads_that_no_link_joins_overlap_no_more_than_allowed(dimension):
    packing = pm.chain_packing(10, 8, dimension=dimension, packing_fraction=0.25, largest_overlap=0.1, seed=1)
    assert pm.find_contacts(packing, gap_tolerance=0.0).overlap_c.max(initial=0.0) <= 0.1
