"""Elastic moduli of a packing by one sparse factorization."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import instance, one_of
from packmech.compiled import single_thread
from packmech.measure import contact_stress, sum_forces
from packmech.measure.link_tension import LinkGradients, tension_of
from packmech.mechanics.bonds import BondSums, bond_sums
from packmech.mechanics.factor import NotDefinite, factorize
from packmech.mechanics.hessian import KINDS, bordered, closed_terms
from packmech.mechanics.link_fronts import cut_places, relax_by_fronts
from packmech.mechanics.link_relaxation import linked_system, negative_motions, relax_linked, soft_shift
from packmech.mechanics.link_rows import independent_rows, prestressed, stiff_strains
from packmech.mechanics.moduli import Moduli, cauchy_tangent, firm_inverse, with_infinities
from packmech.mechanics.network import held_network
from packmech.mechanics.rigidity import TOUCHING
from packmech.scene import Scene

# eigenvalues below this fraction of their scale are zero: pinned Hessians of jammed packings stay above 1e-7
SOFT = 1e-10
# a relaxation that leaves more than this unbalanced has no solution: a zero mode that carries strain under stress
_INCONSISTENT = 1e-6
_REFINEMENTS = 8


class _Relaxation(NamedTuple):
    """The (s, s) stiffness that relaxation takes from the strains, and what the positions' Hessian is like."""

    relief_ee: NDArray[np.float64] | float
    negative: int
    floppy: int
    residual: float


def _pinned(sums: BondSums, count_n: NDArray[np.int64]) -> tuple[NDArray[np.bool_], sp.csr_array]:
    """Return which particles may move when the best connected one is held, and their Hessian."""
    keep = np.ones(len(sums.diagonal_ndd), dtype=bool)
    if len(keep):
        keep[np.argmax(count_n)] = False
    return keep, sums.position_matrix(keep)


def _shift(matrix: sp.csr_array) -> sp.dia_array:
    """Return a diagonal that is small against each row's own stiffness."""
    diagonal = np.abs(matrix.diagonal())
    firm = diagonal > 0.0
    return sp.diags_array(SOFT * np.where(firm, diagonal, diagonal[firm].mean() if firm.any() else 1.0))


def _relax(sums: BondSums, count_n: NDArray[np.int64], push: float) -> _Relaxation:
    """Return how the particles relax; `push` is the size of a contact's force under a unit strain."""
    keep, matrix = _pinned(sums, count_n)
    right = -sums.coupling_nde[keep].reshape(matrix.shape[0], len(sums.strain_ee))
    if not matrix.shape[0]:
        return _Relaxation(0.0, 0, 0, 0.0)
    floppy = 0
    try:
        factor = factorize(matrix, kind="symmetric")
        negative = factor.inertia.negative
        singular = factor.inertia.zero > 0
    except NotDefinite:
        singular = True
    if singular:
        # counts by two definite shifts, then a solution without zero modes by refinement from the shifted factorization
        shift = _shift(matrix)
        factor = factorize(matrix + shift, kind="symmetric")
        negative = factor.inertia.negative
        floppy = factorize(matrix - shift, kind="symmetric").inertia.negative - negative
    solution = factor.solve(right)
    residual = right - matrix @ solution
    size = float(np.abs(residual).max())
    for _ in range(_REFINEMENTS if singular else 0):
        better = solution + factor.solve(residual)
        left = right - matrix @ better
        reached = float(np.abs(left).max())
        if reached >= size:
            break
        solution, residual, size = better, left, reached
    return _Relaxation(right.T @ solution, negative, floppy, size / push if push else 0.0)


def _negative_total(sums: BondSums, count_n: NDArray[np.int64], links: LinkGradients | None) -> int:
    keep, matrix = _pinned(sums, count_n)
    whole = bordered(matrix, sums.coupling_nde[keep].reshape(matrix.shape[0], -1), sums.strain_ee)
    if links is None:
        return factorize(whole + _shift(whole), kind="symmetric").inertia.negative
    dimension = links.pairs.dimension
    gradient, stretch = independent_rows(links)
    rows = sp.csr_array(sp.hstack([gradient[:, np.repeat(keep, dimension)], sp.csr_array(stretch)], format="csr"))
    return negative_motions(linked_system(whole, rows), soft_shift(whole), dimension)


def _relax_with_links(
    sums: BondSums, count_n: NDArray[np.int64], links: LinkGradients, push: float, place_nd: NDArray[np.float64]
) -> _Relaxation:
    """Return how the particles relax where links keep their lengths, and the links' share of the stiffness."""
    exact = relax_by_fronts(sums, links, place_nd, int(np.argmax(count_n)), push) if len(count_n) else None
    if exact is not None:
        return _Relaxation(*exact)
    keep, matrix = _pinned(sums, count_n)
    dimension = links.pairs.dimension
    gradient, stretch = independent_rows(links)
    moving = np.repeat(keep, dimension)
    right = -sums.coupling_xe[moving]
    found = relax_linked(linked_system(matrix, gradient[:, moving]), right, -stretch, push, dimension)
    relief = right.T @ found.response - stretch.T @ found.multiplier
    return _Relaxation(relief, found.negative, found.floppy, found.residual)


def _across(matrix_ee: NDArray[np.float64], stiff_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix on the strains across the stiff ones, zero along these."""
    if not len(stiff_ke):
        return matrix_ee
    across = np.eye(len(matrix_ee)) - stiff_ke.T @ stiff_ke
    kept: NDArray[np.float64] = across @ matrix_ee @ across
    return kept


def elastic_moduli(
    scene: Scene, *, kind: str = "exact", rattlers: str = "remove", gap_tolerance: float = TOUCHING
) -> Moduli:
    """Return the elastic moduli of a packing at rest, its particles free to relax.

    The relaxed stiffness is the Schur complement H_ee - H_ex H_xx^-1 H_xe of the extended Hessian, with d coordinates
    of one particle pinned (equations 44-49 of the polymer source with their errata: over the volume, and Cauchy
    terms). Its null space is the soft strains, whose modulus is 0 and not, as a pseudo-inverse of the compliance
    would have it, infinite: a square lattice has G = 0. Rigid links keep their lengths while the particles relax, their
    forces unknowns of the same sparse system; strains that links forbid are `Moduli.stiff_directions`.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest (see `Moduli.force_residual`).
    kind
        "exact" with the forces of contacts and links, "unstressed" without them; "paper" with those of the contacts
        alone, which is the same where there are no links.
    rattlers
        "remove" leaves them out, linked ones where their whole cluster can be moved; "keep" lets their last contacts
        stiffen the packing.
    gap_tolerance
        Pairs with a gap up to this times the contact distance [1] are contacts; those that do not overlap count with
        u''(1-).

    Returns
    -------
    Moduli
        `bulk_modulus` and `shear_modulus` are relaxed Cauchy moduli at imposed box scaling and imposed simple shear
        in the xy plane; averages over directions by name (`voigt`, `reuss`, `hill`). A packing without contacts has
        moduli 0, and all strains soft.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or touching centers coincide.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(1, 1))
    >>> moduli = pm.elastic_moduli(pm.Scene(crystal, (pm.Repulsion(),)))
    >>> round(moduli.bulk_modulus, 9), round(moduli.shear_modulus, 9), moduli.stable
    (0.866025404, 0.433012702, True)

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    one_of("kind", kind, KINDS)
    with single_thread():
        backbone = held_network(scene.packing, gap_tolerance=gap_tolerance, rattlers=rattlers)
        contacts, links = backbone.contacts, backbone.links
        volume = scene.packing.box.volume
        terms = closed_terms(scene, contacts)
        tension = None if links is None else tension_of(links, contacts, terms.first_c)
        bonds = prestressed(contacts, terms, kind, links, tension)
        sums = bond_sums(*bonds)
        push = float((np.abs(terms.second_c) * contacts.distance_c + np.abs(terms.first_c)).max(initial=0.0))
        if links is None:
            relaxation = _relax(sums, contacts.count_n(), push)
        else:
            place = cut_places(scene.packing.position_nd[backbone.index_n], scene.packing.box)
            relaxation = _relax_with_links(sums, contacts.count_n(), links, push, place)
        stiff = stiff_strains(links, contacts.dimension)
        affine = sums.strain_ee / volume
        relaxed = sums.strain_ee - relaxation.relief_ee
        energy = _across((relaxed + relaxed.T) / (2.0 * volume), stiff)
        stress = contact_stress(bonds.pairs, bonds.first_c, volume)
        cauchy = _across(cauchy_tangent(energy, stress), stiff)
        scale = float(np.abs(np.linalg.eigvalsh(affine)).max())
        negative = int(np.count_nonzero(np.linalg.eigvalsh(energy) < -SOFT * scale))
        if relaxation.residual > _INCONSISTENT:
            negative = max(_negative_total(sums, contacts.count_n(), links) - relaxation.negative, 1)
        # along stiff directions there is no motion: lift them out of the way of soft and unstable ones
        lift = scale or 1.0
        lifted = cauchy + lift * (stiff.T @ stiff) if len(stiff) else cauchy
        least = float(np.linalg.eigvalsh((lifted + lifted.T) / 2.0)[0])
        _, size, direction = np.linalg.svd(lifted)
        soft = direction[size <= SOFT * lift]
        firm = _across(firm_inverse(lifted, soft), stiff)
        force = np.abs(terms.first_c)
        net = sum_forces(contacts, -terms.first_c)
        if links is not None and tension is not None:
            net += sum_forces(links.pairs, -tension)
    largest = float(np.sqrt((net**2).sum(axis=1)).max(initial=0.0))
    return Moduli(
        energy=energy,
        cauchy=cauchy,
        compliance=with_infinities(firm, soft),
        affine=affine,
        stress_dd=stress,
        soft_directions=soft,
        stiff_directions=stiff,
        negative_positions=relaxation.negative,
        negative_strains=negative,
        cauchy_least=least,
        floppy_positions=relaxation.floppy,
        particles=contacts.particles,
        contacts=len(contacts),
        residual=relaxation.residual,
        force_residual=largest / float(force.mean()) if force.any() else 0.0,
        seconds=time.process_time() - start,
    )
