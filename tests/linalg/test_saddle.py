"""Facts about the factorization of stiffness and link gradients together: it solves, and it counts."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from packmech.linalg.factor import NotDefinite, factor_saddle


def network(seed, particles=12, dimension=2, shift=0.0):
    """Return a stiffness of springs along a ring and some chords, and gradients of links along a chain."""
    rng = np.random.default_rng(seed)
    place = rng.normal(size=(particles, dimension))
    stiff = np.zeros((particles * dimension,) * 2)
    pairs = [(i, (i + 1) % particles) for i in range(particles)] + [(i, (i + 3) % particles) for i in range(particles)]
    for i, j in pairs:
        row = np.zeros((particles, dimension))
        normal = (place[j] - place[i]) / np.linalg.norm(place[j] - place[i])
        row[i], row[j] = -normal, normal
        stiff += rng.uniform(0.5, 2.0) * np.outer(row.ravel(), row.ravel())
    stiff += (0.3 + shift) * np.eye(len(stiff))
    gradient = np.zeros((particles // 2, particles * dimension))
    for k in range(particles // 2):
        normal = (place[k + 1] - place[k]) / np.linalg.norm(place[k + 1] - place[k])
        gradient[k, k * dimension : (k + 2) * dimension] = np.concatenate([-normal, normal])
    return stiff, gradient


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**20), st.sampled_from([2, 3]))
def test_the_solution_is_that_of_the_dense_system(seed, dimension):
    stiff, gradient = network(seed, dimension=dimension)
    done = factor_saddle(sp.csr_array(stiff), sp.csr_array(gradient), dimension, stiffness=2.0)
    whole = np.block([[stiff, 2.0 * gradient.T], [2.0 * gradient, np.zeros((len(gradient),) * 2)]])
    right = np.random.default_rng(seed).normal(size=(len(whole), 3))
    expected = np.linalg.solve(whole, right)
    np.testing.assert_allclose(done.solve(right), expected, atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(done.solve(right[:, 0]), expected[:, 0], atol=1e-11 * np.abs(expected).max())


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**20), st.floats(-2.5, 0.0))
def test_negative_pivots_less_one_a_link_are_the_unstable_motions_that_links_admit(seed, shift):
    stiff, gradient = network(seed, shift=shift)
    _, _, rows = np.linalg.svd(gradient)
    null = rows[len(gradient) :]
    value = np.linalg.eigvalsh(null @ stiff @ null.T)
    if np.abs(value).min() < 1e-6:
        return
    done = factor_saddle(sp.csr_array(stiff), sp.csr_array(gradient), 2)
    assert done.inertia.negative - len(gradient) == (value < 0).sum()


def test_a_soft_motion_of_1e_10_is_still_counted_rightly():
    # a dimer on a stiff ground along x; across it, next to nothing, up or down
    gradient = np.array([[-1.0, 0.0, 1.0, 0.0]])
    for soft, unstable in ((1e-10, 0), (-1e-10, 1)):
        stiff = np.diag([1.0, 1.0, 2.0, soft])
        done = factor_saddle(sp.csr_array(stiff), sp.csr_array(gradient), 2)
        assert done.inertia.negative - 1 == unstable


def test_links_that_depend_on_each_other_are_refused():
    stiff, gradient = network(1)
    twice = np.concatenate([gradient, gradient[:1]])
    with pytest.raises(NotDefinite, match="matrix must be nonsingular on the motions that the links admit"):
        factor_saddle(sp.csr_array(stiff), sp.csr_array(twice), 2)
