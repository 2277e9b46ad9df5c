"""Whether the energy has a minimum here: the inertia of its Hessian, translations and rattlers apart."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from packmech.contacts.rattlers import remove_rattlers
from packmech.mechanics.factor import NotDefinite, factorize
from packmech.mechanics.hessian import hessian
from packmech.mechanics.strain import isochoric_basis
from packmech.scene import Scene


def is_stable(scene: Scene, *, strain: bool, gap_tolerance: float = 0.0) -> bool:
    """Return whether the exact Hessian is positive on all motions but the d translations.

    Parameters
    ----------
    scene
        The scene; its rattlers are taken out first.
    strain
        False: in the fixed box. True: with the strains that keep the volume, whose curvature counts.
    gap_tolerance
        Largest gap relative to the contact distance [1] of a contact, as in `hessian`.

    Examples
    --------
    >>> import packmech as pm
    >>> effects = (pm.Repulsion(),)
    >>> scene = pm.Scene(pm.lattice_packing("square", repeats=(1, 1), relative_overlap=0.01), effects)
    >>> is_stable(scene, strain=False), is_stable(scene, strain=True)
    (True, False)

    """
    try:
        packing, _ = remove_rattlers(scene.packing, gap_tolerance=gap_tolerance)
    except ValueError:
        return False
    d = packing.dimension
    backbone = scene.replace(packing=packing)
    matrix = hessian(backbone, strain, volume="fixed", gap_tolerance=gap_tolerance)[d:, d:]
    if strain:
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
