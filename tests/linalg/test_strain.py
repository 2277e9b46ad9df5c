"""Facts about strains as vectors."""

import numpy as np
import pytest

from packmech.linalg.mandel import (
    isochoric_basis,
    mandel_basis,
    mandel_tensor,
    mandel_vector,
    normal_strains,
    stiffness_component,
    stiffness_tensor,
    strain_components,
    strain_directions,
    trace_vector,
)


@pytest.mark.parametrize("dimension", [2, 3])
def test_mandel_components_keep_lengths_and_products(dimension):
    basis = mandel_basis(dimension)
    np.testing.assert_allclose(np.einsum("mab,nab->mn", basis, basis), np.eye(strain_components(dimension)), atol=1e-15)
    one, two = np.random.default_rng(1).normal(size=(2, dimension, dimension))
    one, two = one + one.T, two + two.T
    assert mandel_vector(one) @ mandel_vector(two) == pytest.approx(np.tensordot(one, two), rel=1e-13)
    np.testing.assert_allclose(mandel_tensor(mandel_vector(one)), one, atol=1e-14)


@pytest.mark.parametrize("dimension", [2, 3])
def test_isochoric_strains_are_those_without_trace(dimension):
    basis = isochoric_basis(dimension)
    np.testing.assert_allclose(trace_vector(dimension) @ basis, 0.0, atol=1e-15)
    np.testing.assert_allclose(basis.T @ basis, np.eye(strain_components(dimension) - 1), atol=1e-15)


@pytest.mark.parametrize("dimension", [2, 3])
def test_order_of_the_components_is_diagonal_then_yz_xz_xy(dimension):
    normal = np.random.default_rng(2).normal(size=(4, dimension))
    n = normal.T
    root = np.sqrt(2)
    expected = [n[0] ** 2, n[1] ** 2, root * n[0] * n[1]]
    if dimension == 3:
        expected = [n[0] ** 2, n[1] ** 2, n[2] ** 2, root * n[1] * n[2], root * n[0] * n[2], root * n[0] * n[1]]
    np.testing.assert_allclose(normal_strains(normal), np.array(expected).T, rtol=1e-14)
    direct = np.einsum("ca,mab,cb->cm", normal, mandel_basis(dimension), normal)
    np.testing.assert_allclose(normal_strains(normal), direct, rtol=1e-13)


@pytest.mark.parametrize("size", [3, 6])
def test_components_of_a_stiffness_are_those_of_its_tensor(size):
    matrix = np.random.default_rng(3).normal(size=(size, size))
    tensor = stiffness_tensor(matrix)
    np.testing.assert_allclose(tensor, tensor.transpose(1, 0, 2, 3), atol=1e-15)
    for name in ("xxxx", "xyxy", "yyxy", "xyyy") + (("yzxz", "zzxx") if size == 6 else ()):
        index = tuple("xyz".index(letter) for letter in name)
        assert stiffness_component(matrix, name) == pytest.approx(tensor[index], rel=1e-13, abs=1e-15)
    strain = np.random.default_rng(4).normal(size=size)
    stress = np.einsum("abcd,cd->ab", tensor, mandel_tensor(strain))
    np.testing.assert_allclose(mandel_vector(stress), matrix @ strain, atol=1e-13)


@pytest.mark.parametrize("dimension", [2, 3])
def test_strains_that_a_box_may_make_are_all_none_the_isotropic_one_or_those_of_no_trace(dimension):
    trace, count = trace_vector(dimension), strain_components(dimension)
    assert np.array_equal(strain_directions(dimension, "free"), np.eye(count))
    assert strain_directions(dimension, "none").shape == (count, 0)
    assert np.array_equal(strain_directions(dimension, "isochoric"), isochoric_basis(dimension))
    isotropic = strain_directions(dimension, "isotropic")
    assert isotropic.shape == (count, 1) and np.allclose(isotropic[:, 0], trace / np.linalg.norm(trace), rtol=1e-15)
