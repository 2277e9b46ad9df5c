"""Facts about states of self stress and floppy modes of packings with links."""

import numpy as np
import pytest

import packmech as pm
from packmech.constraints.factor import ConstraintFactor

NAMES = [
    "equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d",
    "random_trimer_2d_w2.5", "random_dimer_3d_w2.0", "random_chain_3d_w2.5",
]  # fmt: skip


@pytest.mark.parametrize(("name", "strain"), [("jammed_dimer_strain", "isochoric"), ("jammed_trimer_fixedbox", "none")])
@pytest.mark.parametrize("method", ["dense", "sparse"])
def test_counts_near_jamming_are_the_stored_ones(linked, name, strain, method):
    scene, data = linked(name)
    stored = data["first_order"]
    states = pm.states_of_self_stress(scene.packing, strain, method=method)
    motions = pm.floppy_modes(scene.packing, strain, method=method)
    assert (states.count, states.rank, states.certain) == (stored["sss"], stored["rank"], True)
    assert motions.count == stored["floppy"]
    assert motions.columns - motions.trivial == stored["dims_mod_translations"] == states.motions - states.trivial
    assert states.contacts == len(data["contacts"])
    # one state of self stress: as many contacts as isostaticity says, less the floppy motions
    assert states.contacts == states.isostatic_contact_count - stored["floppy"]
    # the one state of a jammed packing pushes everywhere
    if motions.count == 0:
        assert (states.force_ck[:, 0] > 0).all() or (states.force_ck[:, 0] < 0).all()


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("strain", ["none", "isochoric", "free"])
@pytest.mark.parametrize("method", ["dense", "sparse"])
def test_ranks_are_those_of_the_constrained_rigidity_matrix(linked, name, strain, method):
    packing = linked(name)[0].packing
    reduced = pm.constrained_rigidity_matrix(packing, strain)
    size = np.linalg.svd(reduced, compute_uv=False)
    rank = int(np.count_nonzero(size > 1e-8 * size[0]))
    states = pm.states_of_self_stress(packing, strain, method=method)
    motions = pm.floppy_modes(packing, strain, method=method)
    assert (states.rank, states.count, states.motions) == (rank, len(reduced) - rank, reduced.shape[1])
    assert (motions.rank, motions.count) == (rank, reduced.shape[1] - packing.dimension - rank)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("method", ["dense", "sparse"])
def test_states_are_orthonormal_and_balance_with_what_the_links_bear(linked, name, method):
    packing = linked(name)[0].packing
    states = pm.states_of_self_stress(packing, "isochoric", method=method)
    force = states.force_ck
    assert np.abs(force.T @ force - np.eye(states.count)).max(initial=0.0) < 1e-12
    reduced = pm.constrained_rigidity_matrix(packing, strain="isochoric")
    assert np.abs(force.T @ reduced).max(initial=0.0) < 1e-11


def test_floppy_modes_of_half_held_trimers_change_no_contact_and_no_link(linked):
    scene, _ = linked("jammed_trimer_fixedbox")
    packing = scene.packing
    for strain in ("none", "free"):
        modes = pm.floppy_modes(packing, strain)
        links = ConstraintFactor(packing)
        rows = np.hstack([links.gradient_lx.toarray(), links.strain_le])
        assert modes.count == (2 if strain == "none" else 4)
        assert np.abs(rows @ modes.motion_xk).max() < 1e-12
        assert np.abs(pm.rigidity_matrix(packing) @ modes.motion_xk).max() < 1e-12


def test_clusters_without_contacts_have_their_own_motions():
    links = pm.Links([0, 1, 3], [1, 2, 4], [[0, 0]] * 3, [1.0] * 3)
    place = [[0, 0], [1, 0], [1, 1], [4, 4], [5, 4]]
    packing = pm.Packing(place, [0.4] * 5, pm.Box.cubic(9.0, 2), links)
    # a chain of three: 6 - 2; a dimer: 4 - 1; less two uniform translations
    for method in ("dense", "sparse"):
        assert pm.floppy_modes(packing, method=method).count == 4 + 3 - 2
        assert pm.states_of_self_stress(packing, method=method).count == 0
