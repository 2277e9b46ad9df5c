"""Whether the energy has a minimum here: the inertia of its Hessian, translations and rattlers apart."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from packmech.linalg.factor import NotDefinite, factorize
from packmech.linalg.mandel import isochoric_basis
from packmech.measure.counting import remove_rattlers
from packmech.mechanics.hessian import bordered, closed_terms, hessian, scene_sums, volume_curvature_term
from packmech.mechanics.linked_systems import linked_system, negative_motions, soft_shift, weighted_rows
from packmech.mechanics.network import held_network
from packmech.scene import Scene


def is_stable(scene: Scene, *, strain: str, gap_tolerance: float = 0.0, free_turns: bool = True) -> bool:
    """Return whether the exact Hessian is positive on all motions but the d translations.

    Parameters
    ----------
    scene
        The scene; its rattlers are taken out first, with rigid links only clusters that can be moved as a whole. Then
        the motions are those that keep the links.
    strain
        "none": in the fixed box. "isochoric": with the strains that keep the volume, whose curvature counts.
    gap_tolerance
        Largest gap relative to the contact distance [1] of a contact, as in `hessian`.
    free_turns
        Whether the free turns of linked particles that are held on one side only count as no instability.

    Examples
    --------
    >>> import packmech as pm
    >>> effects = (pm.Repulsion(),)
    >>> scene = pm.Scene(pm.lattice_packing("square", repeats=(1, 1), relative_overlap=0.01), effects)
    >>> is_stable(scene, strain="none"), is_stable(scene, strain="isochoric")
    (True, False)

    """
    if scene.packing.links is not None:
        return _is_stable_with_links(scene, strain, gap_tolerance, allowed=1.0 if free_turns else -1.0)
    try:
        packing, _ = remove_rattlers(scene.packing, gap_tolerance=gap_tolerance)
    except ValueError:
        return False
    d = packing.dimension
    backbone = scene.replace(packing=packing)
    matrix = hessian(backbone, strain, gap_tolerance=gap_tolerance)[d:, d:]
    if strain != "none":
        scale = packing.box.volume ** (1.0 / d)
        basis = sp.csr_array(isochoric_basis(d) / scale)
        change = sp.block_diag([sp.eye_array((packing.particles - 1) * d), basis], format="csr")
        matrix = sp.csr_array(change.T @ matrix @ change)
    if matrix.shape[0] and not np.abs(matrix.diagonal()).max() > 0:
        return False
    try:
        factorize(matrix, kind="definite")
    except NotDefinite:
        return False
    return True


def _is_stable_with_links(scene: Scene, strain: str, gap_tolerance: float, allowed: float) -> bool:
    """Return whether no motion is unstable, those softer than counts as zero being `allowed` (1) or not (-1)."""
    contacts, index, links = held_network(scene.packing, gap_tolerance=gap_tolerance)
    if not len(index) or not len(contacts):
        return False
    d = contacts.dimension
    terms = closed_terms(scene, contacts)
    sums = scene_sums(contacts, terms, "exact", links)
    matrix = sums.position_matrix()
    admitted = np.zeros((d * (d + 1) // 2, 0))
    scale = scene.packing.box.volume ** (1.0 / d)
    if strain != "none":
        admitted = isochoric_basis(d)
        corner = sums.strain_ee + volume_curvature_term(contacts, terms, links)
        matrix = bordered(matrix, sums.coupling_xe @ admitted / scale, admitted.T @ corner @ admitted / scale**2)
    pinned = matrix[d:, d:]
    if links is None:
        rows = sp.csr_array((0, pinned.shape[0]))
    else:
        rows = weighted_rows(links, np.ones(len(index) * d), admitted, scale)[:, d:]
    system = linked_system(pinned, sp.csr_array(rows))
    return negative_motions(system, allowed * soft_shift(pinned), d) == 0
