"""Facts about coordinates with strains: Jacobian, bases, rigidity matrix and Hessian share them, whatever the scale."""

import json
import pathlib

import numpy as np
import pytest

import packmech as pm

GOLDEN = pathlib.Path(__file__).parents[1] / "golden"


def linked(name="random_trimer_2d_w2.5"):
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    link = data["links"]
    links = pm.Links(
        [one["i"] for one in link],
        [one["j"] for one in link],
        [one["z"] for one in link],
        [one["length"] for one in link],
    )
    return pm.Packing(data["positions"], data["radii"], pm.Box(data["lattice_columns"]), links)


@pytest.mark.parametrize("scale", [{}, {"strain_scale": 3.7}, {"strain_scale": None}], ids=str)
@pytest.mark.parametrize("strain", ["none", "free", "isochoric"])
def test_bases_are_orthonormal_in_the_coordinates_of_the_jacobian(strain, scale):
    packing = linked()
    jacobian = pm.constraint_jacobian(packing, strain, **scale).toarray()
    for basis in (
        pm.change_of_basis(packing, strain, **scale),
        pm.constraint_basis(packing, strain, **scale).null_basis.toarray(),
    ):
        assert basis.shape[0] == jacobian.shape[0]
        assert np.abs(basis.T @ basis - np.eye(basis.shape[1])).max() < 1e-13
        assert np.abs(jacobian.T @ basis).max() < 1e-12 * np.abs(jacobian).max()
    one, other = pm.change_of_basis(packing, strain, **scale), basis
    assert np.abs(one @ (one.T @ other) - other).max() < 1e-12


def test_reduced_matrices_do_not_depend_on_the_scale():
    scene = pm.Scene(linked(), (pm.Repulsion(),))
    found = []
    for scale in (1.0, 3.7):
        basis = pm.change_of_basis(scene.packing, "free", strain_scale=scale)
        wide = basis / np.concatenate([np.ones(scene.packing.position_nd.size), np.full(3, scale)])[:, None]
        hessian = pm.hessian(scene, "free", strain_scale=scale)
        rigidity = pm.rigidity_matrix(scene.packing, "free", strain_scale=scale)
        plain = pm.hessian(scene, "free").toarray(), pm.rigidity_matrix(scene.packing, "free").toarray()
        assert np.allclose(basis.T @ (hessian @ basis), wide.T @ plain[0] @ wide, atol=1e-12)
        assert np.allclose(rigidity @ basis, plain[1] @ wide, atol=1e-12)
        found.append(pm.constrained_rigidity_matrix(scene.packing, "free", strain_scale=scale))
        assert np.allclose(found[-1], rigidity @ basis, atol=1e-12)
    # the same motions in other coordinates: the ranks agree
    assert np.linalg.matrix_rank(found[0]) == np.linalg.matrix_rank(found[1])
