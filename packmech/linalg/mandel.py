"""Symmetric strains as vectors: the Mandel basis, in which lengths and rotations keep their meaning.

Components: xx, yy, sqrt2 xy in two dimensions; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy in three. The basis tensors
E_m are orthonormal, E_m : E_n = delta_mn, so that a stiffness matrix in this basis has the eigenvalues of the
stiffness tensor.
"""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import BoxStrain, brief, clear_errors, finite_array, integer

_AXIS = {"x": 0, "y": 1, "z": 2}
_SHEARS = {2: ((0, 1),), 3: ((1, 2), (0, 2), (0, 1))}


def strain_components(dimension: int) -> int:
    """Return the number of independent strains, d(d+1)/2."""
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    return dimension * (dimension + 1) // 2


@functools.cache
def mandel_basis(dimension: int) -> NDArray[np.float64]:
    """Return the (s, d, d) orthonormal basis tensors E_m of symmetric strains.

    Parameters
    ----------
    dimension
        Number of Cartesian axes, 2 or 3.

    Examples
    --------
    >>> basis = mandel_basis(2)
    >>> float(np.tensordot(basis[2], basis[2]).round(12)), float(basis[2, 0, 1].round(6))
    (1.0, 0.707107)

    """
    basis = np.zeros((strain_components(dimension), dimension, dimension))
    for k in range(dimension):
        basis[k, k, k] = 1.0
    for k, (a, b) in enumerate(_SHEARS[dimension]):
        basis[dimension + k, a, b] = basis[dimension + k, b, a] = np.sqrt(0.5)
    basis.setflags(write=False)
    return basis


@functools.cache
def trace_vector(dimension: int) -> NDArray[np.float64]:
    """Return the (s,) Mandel components of the unit tensor: (1, .., 1, 0, .., 0)."""
    vector: NDArray[np.float64] = np.trace(mandel_basis(dimension), axis1=1, axis2=2)
    vector.setflags(write=False)
    return vector


@functools.cache
def isochoric_basis(dimension: int) -> NDArray[np.float64]:
    """Return an (s, s - 1) orthonormal basis of the strains without trace, as columns."""
    components = strain_components(dimension)
    basis = np.zeros((components, components - 1))
    for k in range(1, dimension):
        basis[:k, k - 1] = 1.0 / np.sqrt(k * (k + 1.0))
        basis[k, k - 1] = -k / np.sqrt(k * (k + 1.0))
    basis[dimension:, dimension - 1 :] = np.eye(components - dimension)
    basis.setflags(write=False)
    return basis


def strain_directions(dimension: int, strain: BoxStrain) -> NDArray[np.float64]:
    """Return an (s, k) orthonormal basis of the strains that the box may make, k = 0 for "none"."""
    if strain == "isochoric":
        return isochoric_basis(dimension)
    if strain == "isotropic":
        return np.asarray(trace_vector(dimension)[:, None] / np.sqrt(dimension))
    components = strain_components(dimension)
    return np.eye(components) if strain == "free" else np.zeros((components, 0))


@clear_errors
def mandel_vector(tensor_dd: ArrayLike) -> NDArray[np.float64]:
    """Return the (s,) Mandel components of the symmetric part of a (d, d) tensor.

    Examples
    --------
    >>> mandel_vector([[1.0, 3.0], [3.0, 2.0]]).round(6).tolist()
    [1.0, 2.0, 4.242641]

    """
    tensor = finite_array("tensor_dd", tensor_dd, shape=(None, None), what="row")
    if tensor.shape not in ((2, 2), (3, 3)):
        raise ValueError(f"tensor_dd must have shape (2, 2) or (3, 3), got {tensor.shape}")
    vector: NDArray[np.float64] = np.einsum("mab,ab->m", mandel_basis(len(tensor)), tensor)
    return vector


@clear_errors
def mandel_tensor(vector_e: ArrayLike) -> NDArray[np.float64]:
    """Return the (d, d) symmetric tensor with the given Mandel components.

    Examples
    --------
    >>> mandel_tensor([1.0, 2.0, 2**0.5]).round(12).tolist()
    [[1.0, 1.0], [1.0, 2.0]]

    """
    vector = finite_array("vector_e", vector_e, shape=(None,), what="component")
    if len(vector) not in (3, 6):
        raise ValueError(f"vector_e must have 3 or 6 components, got {len(vector)}")
    tensor: NDArray[np.float64] = np.einsum("m,mab->ab", vector, mandel_basis(2 if len(vector) == 3 else 3))
    return tensor


def stiffness_tensor(stiffness_ee: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (d, d, d, d) tensor C_abcd of an (s, s) Mandel matrix."""
    basis = mandel_basis(2 if len(stiffness_ee) == 3 else 3)
    tensor: NDArray[np.float64] = np.einsum("mab,mn,ncd->abcd", basis, stiffness_ee, basis)
    return tensor


def stiffness_component(stiffness_ee: NDArray[np.float64], indices: str) -> float:
    """Return one tensor component of an (s, s) Mandel matrix, named like "xxyy" or "xyxy".

    Parameters
    ----------
    stiffness_ee
        (s, s) matrix in Mandel components.
    indices
        Four letters out of x, y and, in three dimensions, z.

    Raises
    ------
    ValueError
        If the name is not four letters of this dimension's axes.

    Examples
    --------
    >>> round(stiffness_component(np.diag([3.0, 3.0, 2.0]), "xyxy"), 12)
    1.0

    """
    axes = "xy" if len(stiffness_ee) == 3 else "xyz"
    if not isinstance(indices, str) or len(indices) != 4 or not set(indices) <= set(axes):
        raise ValueError(f"indices must be four letters out of {axes}, got {brief(indices)}")
    a, b, c, d = (_AXIS[letter] for letter in indices)
    basis = mandel_basis(len(axes))
    return float(basis[:, a, b] @ stiffness_ee @ basis[:, c, d])


def normal_strains(normal_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C, s) products n.E_m.n: the relative stretch of each contact under each unit strain."""
    dimension = normal_cd.shape[1]
    columns = [normal_cd[:, k] ** 2 for k in range(dimension)]
    columns += [np.sqrt(2.0) * normal_cd[:, a] * normal_cd[:, b] for a, b in _SHEARS[dimension]]
    return np.stack(columns, axis=1)
