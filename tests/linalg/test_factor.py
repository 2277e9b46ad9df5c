"""Facts about factorizations: they solve, and their pivots have the signs of the eigenvalues."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.linalg.block_factor import block_size, plan
from packmech.linalg.factor import Inertia, NotDefinite, eigenvalues_below, factorize

WAYS = ["auto", "blocks", "qdldl", "superlu", "dense"]


def symmetric(seed, size=60, shift=0.0):
    rng = np.random.default_rng(seed)
    lower = sp.random_array((size, size), density=0.05, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    diagonal = sp.diags_array(rng.normal(size=size) + shift)
    return sp.csc_array(lower + lower.T + diagonal)


@pytest.mark.parametrize("backend", WAYS)
@pytest.mark.parametrize("seed", range(4))
def test_every_backend_solves_indefinite_systems(backend, seed):
    matrix = symmetric(seed)
    right = np.random.default_rng(seed).normal(size=(60, 3))
    expected = np.linalg.solve(matrix.toarray(), right)
    factor = factorize(matrix, kind="symmetric", backend=backend)
    found = factor.solve(right)
    assert (
        np.abs(found - expected).max()
        <= 1e-13 * factor.growth * np.linalg.cond(matrix.toarray()) * np.abs(expected).max()
    )
    assert np.array_equal(factor.solve(right[:, 1]), found[:, 1]) or np.allclose(
        factor.solve(right[:, 1]), found[:, 1], rtol=1e-12
    )


@pytest.mark.parametrize("backend", WAYS)
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32), st.floats(-3.0, 3.0))
def test_signs_of_the_pivots_are_the_signs_of_the_eigenvalues(backend, seed, shift):
    matrix = symmetric(seed, 25, shift)
    value = np.linalg.eigvalsh(matrix.toarray())
    if np.abs(value).min() < 1e-6 * np.abs(value).max():
        return
    found = factorize(matrix, kind="symmetric", backend=backend).inertia
    assert found == (int((value > 0).sum()), int((value < 0).sum()), 0)


@pytest.mark.parametrize("backend", WAYS)
def test_an_indefinite_hessian_is_never_taken_for_a_definite_one(backend):
    crystal = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    matrix = pm.hessian(pm.Scene(crystal, (pm.Repulsion(),)), "none")[2:, 2:]
    negative = int((np.linalg.eigvalsh(matrix.toarray()) < 0).sum())
    with pytest.raises(NotDefinite, match=f"must be positive definite, got {negative} negative") as caught:
        factorize(matrix, backend=backend)
    assert caught.value.inertia == (30 - negative, negative, 0)


@pytest.mark.parametrize("backend", WAYS)
def test_a_singular_hessian_is_never_taken_for_a_definite_one(backend):
    crystal = pm.lattice_packing("kagome", repeats=(3, 3))
    with pytest.raises(NotDefinite):
        factorize(pm.hessian(pm.Scene(crystal, (pm.Repulsion(),)), "none"), backend=backend)


def test_a_matrix_that_needs_pivots_off_the_diagonal_is_still_solved():
    matrix = sp.csc_array(np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 2.0], [0.0, 2.0, 3.0]]))
    factor = factorize(matrix, kind="symmetric")
    assert factor.inertia == (2, 1, 0)
    np.testing.assert_allclose(matrix @ factor.solve([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0], atol=1e-14)


def test_unpivoted_factors_that_lost_their_digits_are_not_used():
    matrix = sp.csc_array(np.array([[1e-14, 1.0], [1.0, 0.0]]))
    factor = factorize(matrix, kind="symmetric")
    assert factor.growth < 1e8
    np.testing.assert_allclose(matrix @ factor.solve([0.3, 0.7]), [0.3, 0.7], rtol=1e-14)
    assert factor.inertia == (1, 1, 0)


@pytest.mark.parametrize("scale", [1e-24, 1e-12, 1.0, 1e12, 1e24])
def test_the_unit_of_the_matrix_does_not_matter(scale):
    matrix = symmetric(7)
    assert factorize(matrix * scale, kind="symmetric").inertia == factorize(matrix, kind="symmetric").inertia


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32), st.floats(-4.0, 4.0))
def test_eigenvalues_below_a_bound_are_counted_exactly(seed, bound):
    matrix = symmetric(seed, 30)
    value = np.linalg.eigvalsh(matrix.toarray())
    if np.abs(value - bound).min() > 1e-8:
        assert eigenvalues_below(matrix, bound) == int((value < bound).sum())


@pytest.mark.parametrize("backend", WAYS)
def test_rows_without_entries_are_zero_eigenvalues(backend):
    matrix = sp.csc_array(np.diag([2.0, 0.0, -1.0, 0.0]))
    try:
        assert factorize(matrix, kind="symmetric", backend=backend).inertia == (1, 1, 2)
    except NotDefinite as refused:
        assert "cannot factor" in str(refused) and backend in ("blocks", "superlu", "dense")


def test_the_matrix_given_is_left_as_it_was():
    matrix = sp.csr_array((np.array([1.0, 2.0, 1.0, 5.0]), np.array([1, 0, 0, 1]), np.array([0, 2, 4])), shape=(2, 2))
    before = matrix.data.copy(), matrix.indices.copy(), matrix.indptr.copy()
    factorize(matrix, kind="symmetric")
    assert all(np.array_equal(a, b) for a, b in zip(before, (matrix.data, matrix.indices, matrix.indptr), strict=True))


@pytest.mark.parametrize("backend", ["auto", "blocks", "qdldl", "superlu", "dense", "rslab"])
def test_an_earlier_factorization_serves_whatever_became_of_the_matrix(backend):
    if backend == "rslab":
        pytest.importorskip("rslab")
    right = np.random.default_rng(1).normal(size=60)
    factor = None
    # the same places, a pivot that vanishes there, the same places, other ones, another size
    first, other = symmetric(3, shift=4.0), symmetric(4, shift=4.0)
    singular = first.copy()
    singular.data[:] = 0.0
    for matrix in (first, 2.0 * first, singular, first, other, symmetric(5, 25, 4.0)):
        try:
            factor = factorize(matrix, kind="symmetric", backend=backend, like=factor)
        except NotDefinite:
            assert matrix is singular
            continue
        if matrix is not singular:
            part = right[: matrix.shape[0]]
            np.testing.assert_allclose(factor.solve(part), np.linalg.solve(matrix.toarray(), part), rtol=1e-9)
            assert factor.inertia == factorize(matrix, kind="symmetric", backend=backend).inertia


@pytest.mark.parametrize("size", [2, 3])
def test_random_blocks_are_factored_as_such(size):
    graph = sp.random_array((40, 40), density=0.06, rng=np.random.default_rng(size)) + sp.eye_array(40)
    places = sp.kron(graph + graph.T, np.ones((size, size)), format="csr")
    number = np.random.default_rng(1).normal(size=places.shape)
    matrix = sp.csr_array(places.astype(bool).multiply(number + number.T))
    matrix.sort_indices()
    factor = factorize(matrix, kind="symmetric")
    assert factor.backend == "blocks" and block_size(matrix.indices, matrix.indptr) == size
    value = np.linalg.eigvalsh(matrix.toarray())
    assert factor.inertia == (int((value > 0).sum()), int((value < 0).sum()), 0)
    right = np.random.default_rng(2).normal(size=(len(value), 2))
    bound = 1e-13 * factor.growth * np.linalg.cond(matrix.toarray())
    assert np.abs(matrix @ factor.solve(right) - right).max() <= bound * np.abs(right).max()
    exact = np.linalg.solve(matrix.toarray(), right)
    assert np.abs(factor.solve(right) - exact).max() <= bound * np.abs(exact).max()


@pytest.mark.parametrize(("dimension", "particles"), [(2, 400), (3, 200)])
def test_blocks_fill_in_as_little_as_single_rows_do(dimension, particles):
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=0.8 if dimension == 2 else 0.6, seed=1)
    pairs = pm.hessian(pm.Scene(packing, (pm.Repulsion(),)), "none")
    matrix = sp.csr_array(pairs @ pairs + sp.eye_array(pairs.shape[0]))
    found = plan(dimension, matrix.indices, matrix.indptr)
    below = dimension**2 * found.begin[-1] + matrix.shape[0] * (dimension - 1) / 2
    # bytes of a number and of its row
    assert below < 1.1 * factorize(matrix, backend="qdldl").memory / 12


def test_entries_without_their_mirror_images_are_left_to_those_who_read_one_triangle():
    matrix = sp.csr_array(([2.0, 1e-12, 2.0], ([0, 0, 1], [0, 1, 1])), shape=(2, 2))
    assert block_size(matrix.indices, matrix.indptr) == 0
    assert factorize(matrix).inertia == (2, 0, 0)
    with pytest.raises(NotDefinite, match="without their mirror images"):
        factorize(matrix, backend="blocks")


def test_entries_that_stand_twice_make_no_blocks():
    index, start = np.array([0, 1, 1, 0, 0, 1], np.int32), np.array([0, 3, 6], np.int32)
    assert block_size(index, start) == 0


def test_an_empty_matrix_has_an_empty_factorization():
    factor = factorize(sp.csr_array((0, 0)))
    assert factor.inertia == Inertia(0, 0, 0)
    assert factor.solve(np.zeros((0, 2))).shape == (0, 2)


EYE = sp.eye_array(3, format="csr")


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: factorize(np.eye(3)), TypeError, "matrix must be a scipy sparse array"),
        (lambda: factorize(1j * EYE), TypeError, "matrix must be real"),
        (lambda: factorize(sp.csr_array((3, 2))), ValueError, r"matrix must be square, got shape \(3, 2\)"),
        (
            lambda: factorize(sp.csr_array(np.diag([1.0, np.nan]))),
            ValueError,
            "matrix must be finite, got nan in row 1",
        ),
        (lambda: factorize(sp.csr_array(np.triu(np.ones((3, 3))))), ValueError, "matrix must be symmetric"),
        (lambda: factorize(EYE, kind="any"), ValueError, "kind must be one of"),
        (lambda: factorize(EYE, backend="mumps"), ValueError, "backend must be one of"),
        (lambda: factorize(EYE).solve([1.0, 2.0]), ValueError, "right must have 3 rows, got 2"),
        (lambda: factorize(EYE).solve([1.0, np.inf, 0.0]), ValueError, "right must be finite"),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()
