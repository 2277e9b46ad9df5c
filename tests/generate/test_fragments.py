"""Facts about cut fragments: what is bonded to what, that fragments stay whole, how high they are, and refusals."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import packmech as pm
from packmech.generate import fragment_numbers


@pytest.fixture(scope="module")
def packing():
    return pm.random_packing(150, dimension=2, packing_fraction=1.5, seed=3)


@pytest.fixture(scope="module")
def bonds(packing):
    return pm.bond_contacts(packing)


@pytest.fixture(scope="module")
def crystal():
    made = pm.lattice_packing("triangular", repeats=(30, 30), relative_overlap=0.01)
    # off the sides of the cell, so that all its particles are inside
    return made.replace(position_nd=made.position_nd + (0.3, 0.2))


@pytest.fixture(scope="module")
def crystal_bonds(crystal):
    return pm.bond_contacts(crystal)


def pairs(bonds):
    return set(zip(bonds.i_b.tolist(), bonds.j_b.tolist(), map(tuple, bonds.image_bd.tolist()), strict=True))


def parts(i_b, j_b, particles):
    graph = coo_array((np.ones(len(i_b)), (i_b, j_b)), shape=(particles, particles))
    return connected_components(graph, directed=False)[0]


def heights(bonds, packing):
    """Return the heights of the fragments, walked bond by bond with Cartesian vectors."""
    ends = {i: [] for i in range(packing.particles)}
    vector = (
        packing.position_nd[bonds.j_b]
        - packing.position_nd[bonds.i_b]
        + bonds.image_bd @ packing.box.lattice_dd.T
    )  # fmt: skip
    for i, j, v in zip(bonds.i_b, bonds.j_b, vector, strict=True):
        ends[i].append((j, v))
        ends[j].append((i, -v))
    place, found = {}, []
    for root in range(packing.particles):
        if root in place:
            continue
        place[root] = np.zeros(2)
        waiting, members = [root], [root]
        while waiting:
            i = waiting.pop()
            for j, v in ends[i]:
                if j not in place:
                    place[j] = place[i] + v
                    waiting.append(j)
                    members.append(j)
                assert np.abs(place[j] - place[i] - v)[1] < 1e-9, "winds around the box"
        y, r = np.array([place[m][1] for m in members]), packing.radius_n[members]
        found.append((y + r).max() - (y - r).min())
    return np.array(found)


def test_cut_bonds_are_some_of_the_bonds_with_their_rest_lengths(packing, bonds):
    cut = pm.cut_fragments(bonds, packing, centers=5, seed=1)
    assert pairs(cut) < pairs(bonds)
    rest = dict(zip(zip(bonds.i_b, bonds.j_b, strict=True), bonds.rest_length_b, strict=True))
    assert all(rest[i, j] == r for i, j, r in zip(cut.i_b, cut.j_b, cut.rest_length_b, strict=True))


def test_no_centers_and_no_lines_leave_one_bulk(packing, bonds):
    assert pm.cut_fragments(bonds, packing, centers=0, seed=1) == bonds
    assert pm.cut_fragments(bonds, packing, seed=1) == bonds


def test_ends_of_a_bond_that_stays_have_the_same_nearest_image_of_a_center(crystal, crystal_bonds):
    cut = pm.cut_fragments(crystal_bonds, crystal, centers=7, join_isolated=False, seed=5)
    # the draw is one array of fractions; every center through every image near
    center = np.random.default_rng(5).random((7, 2)) @ crystal.box.lattice_dd.T
    image = np.array(list(itertools.product((-2, -1, 0, 1, 2), repeat=2)))
    copies = (center[:, None] + image @ crystal.box.lattice_dd.T).reshape(-1, 2)

    def nearest(x):
        return np.argmin(((x[:, None] - copies) ** 2).sum(axis=2), axis=1)

    x, box = crystal.position_nd, crystal.box.lattice_dd
    one = nearest(x[crystal_bonds.i_b])
    other = nearest(x[crystal_bonds.j_b] + crystal_bonds.image_bd @ box.T)
    assert pairs(cut) == pairs(crystal_bonds.select(one == other))


def test_a_fragment_of_each_center_is_in_one_piece_in_a_crystal(crystal, crystal_bonds):
    cut = pm.cut_fragments(crystal_bonds, crystal, centers=9, seed=2)
    assert fragment_numbers(cut, crystal.particles).max() + 1 == 9


@pytest.mark.parametrize("how", [{"centers": 5}, {"lines": 6, "cut_top_bottom": True}], ids=str)
def test_no_fragment_is_as_high_as_the_box(packing, bonds, how):
    height = packing.box.height_d[1]
    for seed in range(3):
        cut = pm.cut_fragments(bonds, packing, seed=seed, **how)
        assert heights(cut, packing).max() <= 0.9 * height


def test_a_box_that_one_center_fills_is_refused_after_so_many_tries(packing, bonds):
    with pytest.raises(ValueError, match=r"spanning must be 'allowed' .* in each of 4 tries"):
        pm.cut_fragments(bonds, packing, centers=1, seed=1, tries=4)
    assert len(pm.cut_fragments(bonds, packing, centers=1, seed=1, spanning="allowed")) > 0


def test_a_cut_at_top_and_bottom_leaves_no_bond_across(packing, bonds):
    cut = pm.cut_fragments(bonds, packing, cut_top_bottom=True, seed=1)
    assert (cut.image_bd[:, 1] == 0).all() and len(cut) < len(bonds)
    assert (cut.image_bd[:, 0] != 0).any()


def test_bonds_do_not_depend_on_where_the_cell_begins(packing, bonds):
    # the same particles named through other images
    moved = np.array([[3, -2]] * 150)
    moved[::2] = (-1, 1)
    elsewhere = packing.replace(position_nd=packing.position_nd + moved @ packing.box.lattice_dd.T)
    how = {"centers": 5, "edge_fuzziness": 0.5, "removed_fraction": 0.1, "seed": 4}
    one = pm.cut_fragments(bonds, packing, **how)
    other = pm.cut_fragments(pm.bond_contacts(elsewhere), elsewhere, **how)
    assert np.array_equal(one.i_b, other.i_b) and np.array_equal(one.j_b, other.j_b)


def test_a_line_cuts_what_has_ends_on_both_sides(crystal, crystal_bonds):
    cut = pm.cut_fragments(crystal_bonds, crystal, lines=1, spanning="allowed", join_isolated=False, seed=8)
    gone = crystal_bonds.select(~np.isin(crystal_bonds.i_b * 900 + crystal_bonds.j_b, cut.i_b * 900 + cut.j_b))
    inside = ~gone.image_bd.any(axis=1)
    middle = 0.5 * (crystal.position_nd[gone.i_b] + crystal.position_nd[gone.j_b])[inside]
    # centers of the bonds that were cut inside the cell lie along a line, half a bond to either side of it
    spread = np.linalg.svd(middle - middle.mean(axis=0))[1]
    assert inside.sum() > 20 and spread[1] / np.sqrt(len(middle)) < 0.5


def test_lines_are_not_near_the_horizontal(crystal, crystal_bonds):
    for seed in range(20):
        cut = pm.cut_fragments(
            crystal_bonds, crystal, lines=1, avoided_angle=1.0, spanning="allowed", join_isolated=False, seed=seed
        )
        gone = crystal_bonds.select(~np.isin(crystal_bonds.i_b * 900 + crystal_bonds.j_b, cut.i_b * 900 + cut.j_b))
        inside = ~gone.image_bd.any(axis=1)
        middle = 0.5 * (crystal.position_nd[gone.i_b] + crystal.position_nd[gone.j_b])[inside]
        if len(middle) > 30:
            along = np.linalg.svd(middle - middle.mean(axis=0))[2][0]
            assert np.degrees(np.arctan2(abs(along[1]), abs(along[0]))) > np.degrees(1.0) - 6.0


def test_fuzzy_edges_are_rougher(crystal, crystal_bonds):
    bonded = [
        len(pm.cut_fragments(crystal_bonds, crystal, centers=9, edge_fuzziness=fuzz, seed=2)) for fuzz in (0.0, 2.0)
    ]
    assert bonded[1] < bonded[0]


def test_isolated_particles_get_a_bond_back(crystal, crystal_bonds):
    how = {"centers": 100, "edge_fuzziness": 3.0, "seed": 3}
    lone = [
        np.setdiff1d(np.arange(900), np.concatenate([cut.i_b, cut.j_b])).size
        for cut in (pm.cut_fragments(crystal_bonds, crystal, join_isolated=j, **how) for j in (False, True))
    ]
    assert lone[0] > 0 and lone[1] == 0


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), fraction=st.floats(0.0, 0.4))
def test_removal_takes_so_many_bonds_and_leaves_fragments_whole(seed, fraction):
    packing = pm.random_packing(60, dimension=2, packing_fraction=1.5, seed=seed)
    bonds = pm.bond_contacts(packing)
    # the same draws come first, so that the same cuts are made
    whole, thinned = (
        pm.cut_fragments(bonds, packing, centers=4, spanning="allowed", removed_fraction=q, seed=seed)
        for q in (0.0, fraction)
    )
    assert len(whole) - len(thinned) == round(fraction * len(whole))
    assert pairs(thinned) <= pairs(whole)
    assert parts(thinned.i_b, thinned.j_b, 60) == parts(whole.i_b, whole.j_b, 60)


def one_by_one(bonds, particles, due, order):
    """Remove bonds as the definition says, with the fragments counted anew for each."""
    keep = np.ones(len(bonds), dtype=bool)
    before, gone = parts(bonds.i_b, bonds.j_b, particles), 0
    for b in order:
        if gone == due:
            break
        keep[b] = False
        if parts(bonds.i_b[keep], bonds.j_b[keep], particles) > before:
            keep[b] = True
        else:
            gone += 1
    return keep


def test_removal_at_one_stroke_is_removal_one_by_one():
    # small boxes: some pairs are bonded through two images, and a particle to itself
    for seed in range(12):
        packing = pm.random_packing(6, dimension=2, packing_fraction=2.5, seed=seed)
        bonds = pm.bond_contacts(packing)
        order = np.random.default_rng(seed).permutation(len(bonds))
        expected = one_by_one(bonds, 6, round(0.5 * len(bonds)), order)
        assert pm.cut_fragments(bonds, packing, removed_fraction=0.5, seed=seed) == bonds.select(expected)


def test_removal_beyond_what_fragments_need_is_refused(packing, bonds):
    with pytest.raises(ValueError, match=r"removed_fraction must be at most 0\.\d+, or fragments fall apart, got 0.9"):
        pm.cut_fragments(bonds, packing, centers=5, removed_fraction=0.9, seed=1)


def test_spheres_are_cut_too():
    packing = pm.random_packing(300, dimension=3, packing_fraction=1.0, seed=1)
    bonds = pm.bond_contacts(packing)
    for how in ({"centers": 12}, {"lines": 8, "cut_top_bottom": True}):
        cut = pm.cut_fragments(bonds, packing, axis=2, seed=1, **how)
        assert 0 < len(cut) < len(bonds)


def test_a_sheared_cell_is_cut_as_the_same_lattice_named_otherwise(crystal):
    # another basis of the same lattice: the layers across the second vector are the same
    lattice = crystal.box.lattice_dd @ np.array([[1, 3], [0, 1]])
    other = pm.Packing(crystal.position_nd, crystal.radius_n, pm.Box(lattice))
    cut = pm.cut_fragments(pm.bond_contacts(other), other, centers=9, seed=1)
    assert fragment_numbers(cut, 900).max() + 1 == 9


def test_the_same_seed_gives_the_same_bonds(packing, bonds):
    one, other = (pm.cut_fragments(bonds, packing, centers=6, edge_fuzziness=1.0, seed=9) for _ in range(2))
    assert one == other


def test_all_bonds_may_be_cut():
    packing = pm.lattice_packing("square", repeats=(1, 1), relative_overlap=0.01)
    cut = pm.cut_fragments(pm.bond_contacts(packing), packing, centers=1, spanning="allowed", seed=1)
    assert len(cut) == 0


def test_bonds_of_another_packing_are_refused(bonds):
    with pytest.raises(ValueError, match="bonds must be between 4 particles, got particle 149"):
        pm.cut_fragments(bonds, pm.lattice_packing("square", repeats=(2, 2)), centers=1, seed=1)


def test_a_filled_box_keeps_its_size_and_has_the_packing_fraction():
    box = pm.Box([[300.0, 40.0], [0.0, 500.0]])
    packing = pm.fill_box(box, 151, packing_fraction=1.3, seed=2)
    assert packing.box == box
    assert np.pi * (packing.radius_n**2).sum() == pytest.approx(1.3 * 150_000.0, rel=1e-13)
    assert np.bincount(np.unique(packing.radius_n, return_inverse=True)[1]).tolist() == [76, 75]
