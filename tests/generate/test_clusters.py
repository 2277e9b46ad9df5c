"""Facts about clusters and their random starting packings: rigid by rank, no bond across another, exact fractions."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts.excluded import rigid_clusters
from packmech.links import image_offsets

SHAPES = {
    "dimer": pm.Dimer(0.8, radii=(0.5, 0.7)),
    "triangle": pm.Trimer(),
    "bent trimer": pm.Trimer(angle=2.5, radii=(0.5, 0.6, 0.7)),
    "square": pm.RingCluster(4),
    "hexagon": pm.RingCluster(6, length=1.3),
    "flexible ring": pm.RingCluster(5, rigid=False),
    "star": pm.StarCluster(3, arm_beads=2),
    "row": pm.LinearCluster(4),
    "by hand": pm.Cluster([[0, 0], [1.0, 0.1], [1.4, 1.0], [0.2, 1.2], [3.0, 0.5]], [0.5, 0.6, 0.7, 0.4, 0.3]),
}
SPATIAL = {
    "dimer": pm.Dimer(),
    "triangle": pm.Trimer(),
    "flexible hexagon": pm.RingCluster(6, rigid=False),
    "four arms": pm.StarCluster(4),
    "six arms": pm.StarCluster(6),
    "long arms": pm.StarCluster(4, arm_beads=2),
    "row": pm.LinearCluster(3),
    "tetrahedron": pm.Cluster(np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 8**0.5, [0.5] * 4),
}
FLEXIBLE = {"flexible ring", "flexible hexagon", "row"}
ALL = [(name, shape, 2) for name, shape in SHAPES.items()] + [(name, shape, 3) for name, shape in SPATIAL.items()]


def packed(shape, dimension, count=6, packing_fraction=0.5, seed=1, **more):
    return pm.cluster_packing(
        count, shape, dimension=dimension, packing_fraction=packing_fraction, seed=seed, crossing="allowed", **more
    )


def jacobian_rank(packing):
    """Return the rank of the links' derivatives, from singular values of one dense matrix."""
    links = packing.links
    vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
    normal = vector / np.linalg.norm(vector, axis=1)[:, None]
    matrix = np.zeros((len(links), packing.particles, packing.dimension))
    matrix[np.arange(len(links)), links.j_l] += normal
    matrix[np.arange(len(links)), links.i_l] -= normal
    value = np.linalg.svd(matrix.reshape(len(links), -1), compute_uv=False)
    return int((value > 1e-9 * value[0]).sum())


@pytest.mark.parametrize(("name", "shape", "dimension"), ALL, ids=[f"{name} {d}D" for name, _, d in ALL])
def test_no_link_of_a_shape_is_redundant_and_a_rigid_one_has_as_many_as_inner_freedoms(name, shape, dimension):
    packing = packed(shape, dimension, count=2)
    assert jacobian_rank(packing) == len(packing.links)
    beads = packing.particles // 2
    rotations = {2: 1, 3: 3}[dimension] - (dimension == 3 and beads == 2)
    if name not in FLEXIBLE:
        assert len(packing.links) == 2 * (dimension * beads - dimension - rotations)
    assert rigid_clusters(packing).all() == (name not in FLEXIBLE)


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 9), st.sampled_from([2, 3]), st.integers(0, 2**32))
def test_any_beads_that_do_not_lie_flat_are_held_rigid(beads, dimension, seed):
    rng = np.random.default_rng(seed)
    cluster = pm.Cluster(rng.random((beads, dimension)), rng.uniform(0.05, 0.3, beads))
    if beads > 2:
        assert len(cluster.links) == dimension * beads - dimension * (dimension + 1) // 2
    assert rigid_clusters(packed(cluster, dimension, count=1)).all()


@pytest.mark.parametrize(("name", "shape", "dimension"), ALL, ids=[f"{name} {d}D" for name, _, d in ALL])
def test_links_have_their_lengths_to_rounding_and_do_not_wind(name, shape, dimension):
    packing = packed(shape, dimension, count=20)
    assert packing.link_error < 8 * np.finfo(float).eps * np.abs(packing.box.lattice_dd).max()
    assert not image_offsets(packing.links, packing.particles)[1].any()


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(sorted(SHAPES)), st.integers(1, 12), st.floats(0.05, 2.0), st.integers(0, 2**32))
def test_packing_fraction_is_the_one_that_was_asked_for(name, count, packing_fraction, seed):
    packing = packed(SHAPES[name], 2, count, packing_fraction, seed)
    assert pm.packing_fraction(packing) == pytest.approx(packing_fraction, rel=1e-13)
    if name in ("triangle", "square", "row"):
        sum_of_areas = math.pi * math.fsum(packing.radius_n**2)
        assert sum_of_areas / packing.box.volume == pytest.approx(packing_fraction, rel=1e-14)


def test_every_cluster_is_the_shape_turned_but_not_mirrored():
    shape = pm.Cluster([[0, 0, 0], [1, 0, 0], [0, 1.2, 0], [0, 0, 1.5]], [0.5] * 4)
    packing = packed(shape, 3, count=30)
    offset, _ = image_offsets(packing.links, packing.particles)
    place = (packing.position_nd + offset @ packing.box.lattice_dd.T).reshape(30, 4, 3)
    edges = place[:, 1:] - place[:, :1]
    lengths = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
    own = np.linalg.norm(shape.position_bd[:, None] - shape.position_bd[None], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(own, lengths.shape), atol=1e-13)
    np.testing.assert_allclose(np.linalg.det(edges), 1.0 * 1.2 * 1.5, rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_orientations_are_uniform(dimension):
    packing = packed(pm.Dimer(), dimension, count=4000)
    links = packing.links
    along = links.vectors(packing.position_nd, packing.box.lattice_dd)
    # mean of n and of n n over the sphere: 0 and 1/d, with a standard error of about 1/sqrt(4000 d)
    assert np.abs(along.mean(axis=0)).max() < 5 / math.sqrt(4000 * dimension)
    np.testing.assert_allclose(along.T @ along / 4000, np.eye(dimension) / dimension, atol=5 / math.sqrt(8 * 4000))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["triangle", "dimer", "square", "row"]))
def test_no_bond_crosses_another_in_two_dimensions(seed, name):
    packing = pm.cluster_packing(30, SHAPES[name], dimension=2, packing_fraction=0.9, seed=seed)
    assert len(pm.crossing_links(packing)) == 0


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32))
def test_no_bond_crosses_another_in_a_tilted_box_narrower_than_the_cluster(seed):
    shape = pm.LinearCluster(5, length=1.0, radii=0.1)
    packing = pm.cluster_packing(
        2, shape, dimension=2, packing_fraction=0.1, seed=seed, box=[[1.0, 0.7], [0.0, 0.5]], tries=100_000
    )
    assert packing.box.height_d.min() < 4.0
    assert len(pm.crossing_links(packing)) == 0


def test_allowed_crossings_happen_at_high_density():
    packing = pm.cluster_packing(30, pm.Trimer(), dimension=2, packing_fraction=0.9, seed=1, crossing="allowed")
    assert len(pm.crossing_links(packing)) > 0


def test_fifty_trimers_at_a_packing_fraction_of_nine_tenths_find_room_for_any_of_thirty_seeds():
    for seed in range(30):
        packing = pm.cluster_packing(50, pm.Trimer(), dimension=2, packing_fraction=0.9, seed=seed)
        assert (packing.particles, len(packing.links)) == (150, 150)


@pytest.mark.parametrize(("shape", "dimension"), [(pm.Trimer(), 2), (SPATIAL["tetrahedron"], 3)])
def test_same_seed_gives_the_same_packing_to_the_last_bit_and_another_another(shape, dimension):
    make = lambda seed: pm.cluster_packing(  # noqa: E731
        20, shape, dimension=dimension, packing_fraction=0.8, sizes=pm.LogNormal(0.2), seed=seed
    )
    assert make(3) == make(3)
    assert make(3) != make(4)


def test_sizes_scale_whole_clusters():
    shape = pm.Dimer(0.8, radii=(0.5, 0.3))
    packing = packed(shape, 2, count=4, sizes=pm.Bidisperse(ratio=1.4))
    np.testing.assert_allclose(packing.links.length_l, [0.8, 0.8, 1.12, 1.12], rtol=1e-15)
    np.testing.assert_allclose(packing.radius_n, [0.5, 0.3, 0.5, 0.3, 0.7, 0.42, 0.7, 0.42], rtol=1e-15)


def test_bonds_of_a_shape_are_its_touching_pairs_and_the_rest_holds_the_shape():
    square = pm.RingCluster(4).cluster(2)
    by_hand = pm.Cluster(square.position_bd, square.radius_b)
    assert sorted(by_hand.links[~by_hand.shape_l].tolist()) == [[0, 1], [0, 3], [1, 2], [2, 3]]
    assert len(by_hand.links) == 5
    # overlapping beads: both diagonals touch too, and would cross
    wide = pm.Cluster(square.position_bd, [0.9] * 4)
    assert wide.crossing() is None and len(wide.links) == 5


def test_a_flower_of_seven_discs_has_twelve_touching_pairs_of_which_eleven_are_links():
    ring = [[math.cos(k * math.pi / 3), math.sin(k * math.pi / 3)] for k in range(6)]
    flower = pm.Cluster([[0.0, 0.0], *ring], [0.5] * 7)
    assert len(flower.links) == 11 and not flower.shape_l.any()


def test_links_by_hand_may_be_redundant():
    square = pm.RingCluster(4).cluster(2)
    pairs = list(itertools.combinations(range(4), 2))
    packing = packed(pm.Cluster(square.position_bd, [0.5] * 4, pairs, [j - i == 2 for i, j in pairs]), 2, count=3)
    assert len(packing.links) == 18 and jacobian_rank(packing) == 15


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pm.Cluster([[0, 0], [1, 0], [2, 0]], [0.5] * 3), "position_bd must not lie on a line .* 3 beads"),
        (lambda: pm.Cluster([[0, 0], [1, 0], [0, 0]], [0.5] * 3), "position_bd must be distinct, got beads 0 and 2"),
        (
            lambda: pm.Cluster([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1.5, 1]], [0.5] * 4),
            "position_bd must not lie on a plane .* got 4 beads on a plane",
        ),
        (lambda: pm.Cluster([[0, 0], [1, 0], [2, 1]], [0.5] * 3, [[0, 1]]), "links must join all beads, got bead 2"),
        (lambda: pm.Cluster([[0, 0], [1, 0]], [0.5] * 2, shape_l=[True]), "shape_l must be left out without links"),
        (lambda: packed(pm.RingCluster(4), 3), "rigid must be False for a ring of more than three beads in three dim"),
        (lambda: packed(pm.StarCluster(3), 3), "arms must be 4, 6 or 8 in three dimensions, got 3"),
        (lambda: packed(SPATIAL["tetrahedron"], 2), "dimension must be that of the cluster, 3, got 2"),
    ],
)
def test_shapes_that_cannot_be_are_refused_with_the_reason(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_shape_whose_own_bonds_cross_is_refused_unless_crossings_are_allowed():
    bow = pm.Cluster([[0, 0], [1, 1], [1, 0], [0, 1]], [0.5] * 4, [[0, 1], [1, 2], [2, 3]])
    with pytest.raises(ValueError, match=r"^shape must have no bonds that cross .* got \(0, 1\) and \(2, 3\)"):
        pm.cluster_packing(3, bow, dimension=2, packing_fraction=0.1, seed=1)
    assert len(pm.crossing_links(packed(bow, 2, 3, 0.1))) >= 3


def test_bonds_without_room_end_in_an_error_that_names_the_cluster():
    with pytest.raises(ValueError, match="^crossing must leave room for all clusters .* got no place for clus"):
        pm.cluster_packing(60, pm.LinearCluster(20), dimension=2, packing_fraction=0.9, seed=1, tries=20)


def test_a_range_of_angles_gives_every_trimer_its_own():
    packing = packed(pm.Trimer(length=0.9, angle=(1.2, 2.6)), 3, count=40, sizes=pm.Bidisperse(ratio=1.4))
    length = packing.links.length_l.reshape(40, 3)
    bond = length[:, [0, 2]]
    assert np.allclose(bond[:, 0], bond[:, 1], rtol=1e-14)
    angle = 2.0 * np.arcsin(0.5 * length[:, 1] / bond[:, 0])
    assert packing.links.shape_l.reshape(40, 3).tolist() == [[False, True, False]] * 40
    assert len(np.unique(angle.round(12))) == 40
    assert (angle > 1.2).all()
    assert (angle < 2.6).all()
    assert packing.link_error < 1e-14
    assert rigid_clusters(packing).all()


def test_angles_drawn_are_those_of_the_seed():
    shape = pm.Trimer(angle=(1.2, 2.6))
    assert packed(shape, 2, seed=4) == packed(shape, 2, seed=4)
    assert packed(shape, 2, seed=4) != packed(shape, 2, seed=5)


def test_bonds_of_trimers_with_angles_of_their_own_do_not_cross():
    shape = pm.Trimer(angle=(1.1, 2.8))
    packing = pm.cluster_packing(50, shape, dimension=2, packing_fraction=0.95, seed=2)
    assert len(pm.crossing_links(packing)) == 0


def test_a_range_of_angles_is_no_single_cluster():
    with pytest.raises(ValueError, match=r"^angle must be one angle for one cluster .see drawn., got \(1.2, 2.6\)"):
        pm.Trimer(angle=(1.2, 2.6)).cluster(2)


def test_shapes_that_draw_clusters_of_different_size_are_refused():
    class Fickle:
        def cluster(self, dimension):
            return pm.Dimer().cluster(dimension)

        def drawn(self, rng):
            return pm.LinearCluster(int(rng.integers(2, 5)))

    with pytest.raises(ValueError, match="^shape must draw clusters of one number of beads, got"):
        packed(Fickle(), 2, count=20)


@pytest.mark.parametrize("dimension", [2, 3])
def test_beads_of_different_clusters_overlap_no_more_than_they_may(dimension):
    box = pm.Box(np.eye(dimension) + 0.4 * np.eye(dimension, k=1))
    packing = pm.cluster_packing(
        40, pm.Trimer(), dimension=dimension, packing_fraction=0.25, largest_overlap=0.05, seed=3, box=box
    )
    overlap = pm.find_contacts(packing, gap_tolerance=0.0).overlap_c
    assert 0.0 < overlap.max() <= 0.05
    free = pm.cluster_packing(40, pm.Trimer(), dimension=dimension, packing_fraction=0.25, seed=3, box=box)
    assert pm.find_contacts(free, gap_tolerance=0.0).overlap_c.max() > 0.05


def test_a_cluster_in_a_box_smaller_than_itself_meets_its_own_images_only():
    # images of one cluster are not different clusters: nothing to refuse
    packing = pm.cluster_packing(
        1, pm.Dimer(), dimension=2, packing_fraction=1.2, largest_overlap=0.0, crossing="allowed", seed=1
    )
    assert packing.particles == 2
    with pytest.raises(ValueError, match="got no place for cluster 1 in 50 tries"):
        pm.cluster_packing(2, pm.Dimer(), dimension=2, packing_fraction=1.2, largest_overlap=0.0, tries=50, seed=1)
