"""The compliance of a packing: strains under imposed stresses, particles relaxed and links kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, one_of, positive
from packmech.compiled import single_thread
from packmech.measure.link_tension import link_gradients
from packmech.mechanics.bonds import bond_sums
from packmech.mechanics.elasticity import elastic_moduli
from packmech.mechanics.hessian import KINDS, bordered, closed_terms
from packmech.mechanics.link_basis import MEMORY_LIMIT, check_memory, motion_basis
from packmech.mechanics.link_rows import prestressed
from packmech.mechanics.moduli import firm_inverse, with_infinities
from packmech.mechanics.network import held_network
from packmech.mechanics.rigidity import TOUCHING
from packmech.scene import Scene

METHODS = ("sparse", "pseudoinverse")
# eigenvalues below this fraction of the largest are zero
_ZERO = 1e-10
# zero modes of size 1 that strain by less than this (as part of their size) carry none
_CARRIES = 1e-6


def compliance_matrix(
    scene: Scene,
    *,
    kind: str = "exact",
    method: str = "sparse",
    rattlers: str = "remove",
    gap_tolerance: float = TOUCHING,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the (s, s) compliance [length^d/energy] in Mandel components: the inverse of `Moduli.energy`.

    Strains per imposed stress, box free, particles relaxed, links kept (equation 49 of the polymer source with its
    errata: both sides selected, times V). Strains that links forbid have compliance 0; entries that a soft direction
    makes infinite are inf.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest.
    kind, rattlers, gap_tolerance
        As in `elastic_moduli`.
    method
        "sparse": from the relaxed stiffness. "pseudoinverse": V times the strain block of B^T (B H B^T)^+ B with a
        dense B (`change_of_basis`), as the source has it, for small packings and comparison. A pseudoinverse alone
        gives 0 for infinitely soft strains too: its zero modes are searched for strains, which get inf.
    memory_limit
        Largest memory of the pseudoinverse [bytes].

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or the pseudoinverse would exceed the limit.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3)), (pm.Repulsion(),))
    >>> one, other = (pm.compliance_matrix(scene, method=name) for name in ("sparse", "pseudoinverse"))
    >>> bool(abs(one - other).max() < 1e-12)
    True

    """
    instance("scene", scene, Scene)
    one_of("kind", kind, KINDS)
    one_of("method", method, METHODS)
    positive("memory_limit", memory_limit)
    if method == "sparse":
        moduli = elastic_moduli(scene, kind=kind, rattlers=rattlers, gap_tolerance=gap_tolerance)
        stiff = moduli.stiff_directions
        scale = float(np.abs(moduli.affine).max(initial=0.0)) or 1.0
        lifted = moduli.energy + scale * stiff.T @ stiff
        _, size, direction = np.linalg.svd(lifted)
        soft = direction[size <= _ZERO * scale]
        across = np.eye(len(lifted)) - stiff.T @ stiff
        return with_infinities(across @ firm_inverse(lifted, soft) @ across, soft)
    with single_thread():
        return _pseudoinverse(scene, kind, rattlers, gap_tolerance, memory_limit)


def _pseudoinverse(
    scene: Scene, kind: str, rattlers: str, gap_tolerance: float, memory_limit: float
) -> NDArray[np.float64]:
    packing = scene.packing
    backbone = held_network(packing, gap_tolerance=gap_tolerance, rattlers=rattlers)
    contacts, links = backbone.contacts, backbone.links
    size = contacts.particles * contacts.dimension
    components = contacts.dimension * (contacts.dimension + 1) // 2
    if not size:
        return with_infinities(np.zeros((components, components)), np.eye(components))
    if links is None:
        kept = backbone.index_n
        links = link_gradients(
            packing.replace(position_nd=packing.position_nd[kept], radius_n=packing.radius_n[kept], links=None)
        )
    check_memory(size + components, size + components, memory_limit)
    sums = bond_sums(*prestressed(contacts, closed_terms(scene, contacts), kind, links))
    full = bordered(sums.position_matrix(), sums.coupling_xe, sums.strain_ee)
    scale = packing.box.volume ** (1.0 / packing.dimension)
    basis = motion_basis(
        links, np.eye(components), mass_n=np.ones(contacts.particles), strain_scale=scale, memory_limit=memory_limit
    )
    value, vector = np.linalg.eigh(basis.T @ (full @ basis))
    strain = basis[size:] @ vector
    zero = np.abs(value) <= _ZERO * np.abs(value).max()
    _, carried, direction = np.linalg.svd((strain[:, zero] * scale).T, full_matrices=False)
    soft = direction[carried > _CARRIES]
    firm = packing.box.volume * (strain[:, ~zero] / value[~zero]) @ strain[:, ~zero].T
    return with_infinities(firm, soft)
