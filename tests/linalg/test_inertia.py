"""Facts about numbers of eigenvalues below a bound: those of NumPy, and how sure they say they are."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from packmech.linalg.factor import factorize
from packmech.linalg.inertia import count_below, judged


def symmetric(seed, size=60):
    rng = np.random.default_rng(seed)
    lower = sp.random_array((size, size), density=0.1, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    return sp.csr_array(lower + lower.T + sp.diags_array(rng.normal(size=size)))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.floats(-4.0, 4.0))
def test_numbers_that_are_certain_are_those_of_numpy_and_no_eigenvalue_is_nearer_than_said(seed, bound):
    matrix = symmetric(seed)
    value = np.linalg.eigvalsh(matrix.toarray())
    found = count_below(matrix, bound)
    near = float(np.abs(value - bound).min())
    if found.certain:
        assert found.number == int((value < bound).sum())
        assert 0.0 < found.distance <= near
    else:
        # only what is next to an eigenvalue is in doubt
        assert near < 1e-8 and found.distance == 0.0


@pytest.mark.parametrize("apart", [1e-4, 1e-6, 1e-8])
def test_a_bound_next_to_an_eigenvalue_is_certain_and_one_on_it_is_not(apart):
    matrix = symmetric(3)
    value = np.linalg.eigvalsh(matrix.toarray())
    for sign, number in ((1.0, 21), (-1.0, 20)):
        found = count_below(matrix, value[20] + sign * apart)
        assert found.certain and found.number == number and found.distance <= 1.01 * apart
    assert not count_below(matrix, value[20]).certain
    assert not count_below(sp.diags_array([1.0, 2.0, 3.0]), 2.0).certain


@pytest.mark.parametrize("seed", range(5))
def test_factors_of_another_matrix_with_other_signs_are_found_out(seed):
    """One eigenvalue is moved through zero: of |F^-1 (A - F)| this makes 1 at least."""
    matrix = symmetric(seed).toarray()
    value, vector = np.linalg.eigh(matrix)
    k = int(np.argmin(np.abs(value)))
    wrong = sp.csr_array(matrix - 1.01 * value[k] * np.outer(vector[:, k], vector[:, k]))
    factor = factorize(wrong, kind="symmetric")
    found = judged(sp.csr_array(matrix), factor, factor.inertia.negative, 10.0)
    assert found.number != int((value < 0).sum()) and not found.certain


def test_small_pivots_that_cost_digits_leave_a_doubt_or_none():
    """Without pivots off the diagonal, a diagonal of 1e-13 beside ones loses all digits of what is below."""
    for size in (1e-3, 1e-7, 1e-13):
        matrix = sp.csr_array([[size, 1.0, 1.0], [1.0, size, 0.5], [1.0, 0.5, 0.3]])
        found = count_below(matrix, 0.0)
        assert not found.certain or found.number == int((np.linalg.eigvalsh(matrix.toarray()) < 0).sum())


def test_an_empty_matrix_has_no_eigenvalues_and_factors_that_are_gone_solve_nothing():
    assert count_below(sp.csr_array((0, 0)), 1.0)[:2] == (0, 0.0)
    matrix = symmetric(1)
    emptied = factorize(matrix, kind="symmetric").emptied()
    with pytest.raises(ValueError, match="must hold its factors"):
        emptied.solve(np.ones(60))
    assert factorize(matrix, kind="symmetric", like=emptied).inertia == emptied.inertia


@pytest.mark.parametrize("backend", ["blocks", "qdldl", "superlu", "dense", "rslab"])
def test_factors_say_how_much_memory_they_take(backend):
    assert factorize(symmetric(2), kind="symmetric", backend=backend).memory > 8 * 60


@pytest.mark.parametrize("zero", [0, 1])
def test_a_pivot_that_is_zero_to_rounding_leaves_every_count_in_doubt(zero):
    matrix = sp.csr_array(sp.diags_array([-2.0, 1.0, 3.0]))
    factor = factorize(matrix, kind="symmetric")

    class Told:
        size, memory, inertia = factor.size, factor.memory, factor.inertia._replace(zero=zero)
        solve, solve_once, emptied = factor.solve, factor.solve_once, factor.emptied

    found = judged(matrix, Told(), 1, 3.0)
    assert found.certain == (zero == 0) and np.isinf(found.doubt) == bool(zero)


def test_entries_that_are_rounded_by_more_than_the_distance_leave_the_count_in_doubt():
    matrix = sp.csr_array(sp.diags_array([-2.0, 1.0, 3.0]))
    factor = factorize(matrix, kind="symmetric")
    assert judged(matrix, factor, 1, 3.0).certain and not judged(matrix, factor, 1, 1e18).certain
