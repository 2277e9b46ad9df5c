"""Facts about bases of constraints: orthonormal whatever the chain, the right span, rank, and freedoms left."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.constraints.basis import METHODS

RANDOM = ["random_chain_3d_w2.5", "random_dimer_3d_w2.0", "random_mono_2d_w3.0", "random_trimer_2d_w2.5"]
EQUILIBRIUM = ["equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d"]
ANGLES_FIXED = {"length": 200, "reach": 2}
ALL_PAIRS = {"length": 200, "reach": 4}
NEARLY_STRAIGHT = {"length": 200, "reach": 2, "angle": 0.01}


def taut_ring():
    """Return four particles in a straight line around the box: four links, of which the box needs only three."""
    place = [[0.5 + k, 1.0] for k in range(4)]
    links = pm.Links([0, 1, 2, 0], [1, 2, 3, 3], [[0, 0]] * 3 + [[-1, 0]], [1.0] * 4)
    return pm.Packing(place, [0.4] * 4, pm.Box.cubic(4.0, 2), links)


@pytest.mark.parametrize(
    ("case", "links", "rank"),
    [({"length": 200}, 199, 199), (ANGLES_FIXED, 397, 397), (ALL_PAIRS, 790, 397), (NEARLY_STRAIGHT, 397, 397)],
)
def test_default_basis_of_long_chains_is_orthonormal_to_rounding_and_has_their_rank(case, links, rank, chain_packing):
    packing = chain_packing(**case)
    basis = pm.constraint_basis(packing)
    assert len(packing.links) == links and basis.rank == basis.link_rank == rank
    assert basis.freedoms == 400 - rank
    assert basis.orthogonality <= 2e-15


def test_one_pass_of_gram_schmidt_loses_orthogonality_where_a_second_keeps_it(chain_packing):
    packing = chain_packing(**NEARLY_STRAIGHT)
    once, twice = (pm.constraint_basis(packing, method=m) for m in ("gram-schmidt", "gram-schmidt-twice"))
    assert once.orthogonality > 1e-12 > 4e-15 > twice.orthogonality
    assert once.rank == twice.rank == 397


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_the_rank_of_redundant_links(method, chain_packing):
    assert pm.constraint_basis(chain_packing(length=60, reach=4), method=method).rank == 117


def strain_of(strain, volume):
    """Return the name of what the box may do: whether it strains, and whether its volume is held."""
    return "isochoric" if volume else "free" if strain else "none"


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", [*RANDOM, *EQUILIBRIUM])
def test_null_basis_spans_the_null_space_of_the_stored_jacobian(name, method, stored_links, dense_null):
    packing, data, place = stored_links(name)
    key = "Gamma_links_mandel" if name in EQUILIBRIUM else "constraint_jacobian_Gamma_links_mandel"
    strains = packing.dimension * (packing.dimension + 1) // 2
    links = np.array(data[key]).reshape(packing.position_nd.size + strains, -1)[:, place]
    volume = np.zeros(len(links))
    volume[packing.position_nd.size : packing.position_nd.size + packing.dimension] = 1.0
    for strain, held, matrix in (
        (False, False, links[: packing.position_nd.size]),
        (True, False, links),
        (True, True, np.column_stack([links, volume])),
    ):
        basis = pm.constraint_basis(packing, strain_of(strain, held), method=method, strain_scale=1.0)
        rows = basis.null_basis.toarray().T
        null = dense_null(matrix)
        assert basis.freedoms == len(rows) == len(null) and basis.rank == matrix.shape[1]
        assert np.abs(rows @ rows.T - np.eye(len(rows))).max() < 1e-13
        assert np.abs(rows @ matrix).max(initial=0.0) < 1e-12
        assert np.abs(rows.T @ rows - null.T @ null).max() < 1e-12


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_rigid_trimer_keeps_translations_and_rotations_about_its_centroid(dimension, rigid_cluster):
    packing = rigid_cluster(dimension, np.random.default_rng(5).normal(size=(3, dimension)))
    basis = pm.constraint_basis(packing)
    rows = basis.null_basis.toarray().T
    projector = rows.T @ rows
    assert np.trace(projector) == pytest.approx({2: 3.0, 3: 6.0}[dimension], abs=1e-14)
    place = packing.position_nd - packing.position_nd.mean(axis=0)
    motions = [np.tile(axis, (3, 1)) for axis in np.eye(dimension)]
    for a in range(dimension):
        for b in range(a):
            turn = np.zeros((dimension, dimension))
            turn[a, b], turn[b, a] = 1.0, -1.0
            motions.append(place @ turn.T)
    motions = np.linalg.qr(np.array([one.ravel() for one in motions]).T)[0]
    assert np.abs(projector - motions @ motions.T).max() < 3e-15


@pytest.mark.parametrize(("strain", "volume", "extra"), [(False, False, 0), (True, False, 3), (True, True, 2)])
def test_freedoms_are_coordinates_less_independent_constraints(strain, volume, extra, chain_packing):
    packing = chain_packing(length=10, chains=3)
    basis = pm.constraint_basis(packing, strain_of(strain, volume))
    assert basis.freedoms == 60 + extra - 27 == basis.null_basis.shape[1]
    assert basis.rank == 27 + volume


def test_a_taut_ring_around_the_box_holds_the_strain_along_it(dense_null):
    packing = taut_ring()
    fixed, free = pm.constraint_basis(packing), pm.constraint_basis(packing, strain="free")
    assert (fixed.rank, free.rank, free.link_rank) == (3, 4, 3)
    matrix = pm.constraint_jacobian(packing, strain="free", strain_scale=None).toarray()
    rows, null = free.null_basis.toarray().T, dense_null(matrix)
    assert np.abs(rows.T @ rows - null.T @ null).max() < 1e-13
    assert np.abs(rows[:, -3]).max() < 1e-14


def test_a_link_to_the_own_image_holds_one_strain():
    packing = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(4.0, 2), pm.Links([0], [0], [[1, 0]], [4.0]))
    fixed, free = pm.constraint_basis(packing), pm.constraint_basis(packing, strain="free")
    assert (fixed.rank, fixed.freedoms, free.rank, free.freedoms) == (0, 2, 1, 4)


@pytest.mark.parametrize(
    ("places", "links", "rank"),
    [([[0, 0], [1, 0], [2, 0]], 3, 2), ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], 6, 5)],
)
def test_collinear_trimers_and_coplanar_tetramers_lack_one_rank(places, links, rank, rigid_cluster):
    packing = rigid_cluster(len(places[0]), places)
    assert len(packing.links) == links
    assert pm.constraint_basis(packing).rank == rank


def test_columns_of_a_cluster_stand_on_its_own_particles(chain_packing):
    packing = chain_packing(length=10, chains=3)
    basis = pm.constraint_basis(packing).link_basis
    cluster = packing.links.clusters(30)[basis.tocoo().coords[0] // 2]
    columns = basis.tocoo().coords[1]
    for k in range(basis.shape[1]):
        assert len(set(cluster[columns == k])) == 1
    assert basis.nnz == 3 * 20 * 9


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_relabelled_particles_have_the_same_projector(seed, dimension, off_lengths):
    packing = off_lengths(dimension)
    number = np.random.default_rng(seed).permutation(packing.particles)
    place = np.empty_like(packing.position_nd)
    place[number] = packing.position_nd
    moved = packing.replace(position_nd=place, links=packing.links.numbered(number))
    rows, again = (pm.constraint_basis(one, "isochoric").null_basis.toarray().T for one in (packing, moved))
    column = np.concatenate(
        [(number[:, None] * dimension + np.arange(dimension)).ravel(), np.arange(place.size, rows.shape[1])]
    )
    assert np.allclose((again.T @ again)[np.ix_(column, column)], rows.T @ rows, rtol=0, atol=1e-11)


@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_projection_is_that_of_the_null_basis(seed, dimension, off_lengths):
    packing = off_lengths(dimension, seed=seed % 20)
    basis = pm.constraint_basis(packing, "isochoric")
    vector = np.random.default_rng(seed).normal(size=basis.null_basis.shape[0])
    rows = basis.null_basis.T
    assert np.allclose(basis.project(vector), rows.T @ (rows @ vector), rtol=0, atol=1e-12)


def test_without_links_everything_is_free():
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    basis = pm.constraint_basis(packing, strain="isochoric")
    assert (basis.rank, basis.freedoms, basis.link_basis.shape) == (1, 20, (18, 0))
    assert np.abs(basis.null_basis[:18, :18] - np.eye(18)).max() == 0.0


def test_a_basis_beyond_the_limit_is_refused_with_the_bytes_it_needs(chain_packing):
    with pytest.raises(ValueError, match=r"basis_limit must be at least 1.3e\+04 bytes for this basis, got 1e\+03"):
        pm.constraint_basis(chain_packing(length=10, chains=3), method="whole-matrix", basis_limit=1e3)
