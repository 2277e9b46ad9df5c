"""Forces without the part that links and a fixed volume take up: F_cons = (1 - Gamma_o Gamma_o^T) F.

Equations 6 and 18 of the polymer source. Gamma is never made dense. At fixed box the projection is one sparse solve per
cluster. With strains, what the constraints leave free are the motions at fixed strain and, for each admissible strain
e, the motion (-Y e, e), Y = Omega A^-1 T^T with A = Omega^T Omega and T the rows of strains; the two sets are
orthogonal, so that strains cost s further solves and a system of size s.
"""

from __future__ import annotations

import threading
import time
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, one_of
from packmech.compiled import single_thread
from packmech.mechanics.constraint_basis import METHODS as BASES
from packmech.mechanics.constraint_basis import Block, ConstraintBasis, constraint_basis
from packmech.mechanics.constraints import link_vectors, scale_of_strain, strain_rows
from packmech.mechanics.link_calls import prepare_strains, project_links, project_strained, refill_links
from packmech.mechanics.link_system import make_link_system
from packmech.mechanics.strain import isochoric_basis, mandel_basis, strain_components, trace_vector
from packmech.packing import Packing

METHODS = ("clusters", *BASES)
# below this squared sine between a link and those before it the normal matrix keeps too few digits to tell its rank
_SAFE_PIVOT = 1e-10
# a rate left over, relative to the force, that is no longer rounding: the normal matrix is too ill-conditioned
_ROUNDING = 1e-13


# what is left of the force and of the force on scaled strains, multipliers of the links and of the volume
Parts = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]


@dataclass(frozen=True, eq=False)
class ConstrainedForce:
    """A force without the part that the constraints take up.

    Attributes
    ----------
    force_nd
        (N, d) constrained force on the particles [force].
    strain_force_e
        (s,) constrained force on the Mandel strains, in the units of the one given [energy]; zeros at fixed box.
    multiplier_l
        (L,) multipliers of the links, > 0 is tension: F = F_cons + Gamma lambda [force].
    volume_multiplier
        Multiplier of the volume, trace of the strain; 0 when the volume is free [energy].
    rate
        Largest rate of a constraint left in the force [force].
    method
        How it was made.
    seconds
        CPU time.

    """

    force_nd: NDArray[np.float64]
    strain_force_e: NDArray[np.float64]
    multiplier_l: NDArray[np.float64]
    volume_multiplier: float
    rate: float
    method: str
    seconds: float


class Projector:
    """The links of one packing, prepared for many forces by sparse solves; for one thread at a time.

    Sums over particles are the kernels', not BLAS's: their bits must not depend on the number of threads.

    `independent` tells whether the links are: otherwise only bases with pivoting can project.
    """

    def __init__(self, packing: Packing, *, strain: bool, volume: bool, scale: float) -> None:
        links, d = packing.links, packing.dimension
        assert links is not None
        self._system = make_link_system(links, packing.particles, d)
        pivot, dependent = refill_links(self._system, packing.position_nd, packing.box.lattice_dd)
        if not self._system.distance_r.all():
            link_vectors(packing)
        self.independent = dependent == 0 and pivot > _SAFE_PIVOT
        if not (strain and self.independent):
            return
        strains = strain_components(d)
        rows, part = np.empty((strains, len(links))), np.empty((strains, len(links)))
        motion, inner = np.empty((strains, packing.position_nd.size)), np.empty((strains, strains))
        prepare_strains(self._system, mandel_basis(d), scale, rows, part, motion, inner)
        free = isochoric_basis(d) if volume else np.eye(strains)
        follow = free @ np.linalg.solve(free.T @ inner @ free, free.T)
        self._strains = rows, part, motion, follow, trace_vector(d) / scale if volume else np.zeros(strains)

    def split(self, force_nd: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return what is left of a force at fixed strain, the multipliers, and the links' largest rate."""
        out, multiplier = np.empty_like(force_nd), np.empty(len(self._system.order_r))
        rate = float(project_links(self._system, force_nd, out, multiplier, True))
        return out, multiplier, rate

    def project(self, force_nd: NDArray[np.float64], pull_e: NDArray[np.float64]) -> tuple[Parts, float]:
        """Return what is left of a force and of one on the scaled strains, the multipliers; and the largest rate."""
        out, strain = np.empty_like(force_nd), np.empty_like(pull_e)
        multiplier = np.empty(len(self._system.order_r))
        held, rate = project_strained(self._system, self._strains, force_nd, pull_e, out, strain, multiplier)
        return (out, strain, multiplier, float(held)), float(rate)


class _Last(threading.local):
    """The projector of the last packing in this thread: a packing never changes, so that it serves again."""

    def __init__(self) -> None:
        self._packing: Any = lambda: None
        self._key: tuple[Any, ...] = ()
        self._made: Projector | None = None

    def projector(self, packing: Packing, strain: bool, volume: bool, scale: float) -> Projector:
        key = (strain, volume, scale)
        if self._made is None or self._packing() is not packing or self._key != key:
            self._made = Projector(packing, strain=strain, volume=volume, scale=scale)
            self._packing, self._key = weakref.ref(packing), key
        return self._made


_LAST = _Last()


def _multipliers(
    basis: ConstraintBasis, taken_x: NDArray[np.float64], taken_e: NDArray[np.float64],
    rows_el: NDArray[np.float64], held_e: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float]:  # fmt: skip
    """Return multipliers of links and volume that make up the part taken out; dependent links share the smallest."""
    multiplier = np.zeros(rows_el.shape[1])
    ties: list[tuple[Block, NDArray[np.float64]]] = []
    columns = [held_e[:, None]]
    for block in basis.blocks:
        rank = block.basis_xr.shape[1]
        triangle, link = block.triangle_rl, block.link_l
        multiplier[link[:rank]] = np.linalg.solve(triangle[:, :rank], block.basis_xr.T @ taken_x[block.row_x])
        if len(held_e) and rank < len(link):
            tie = np.asarray(np.linalg.solve(triangle[:, :rank], triangle[:, rank:]), dtype=np.float64)
            ties.append((block, tie))
            columns.append(rows_el[:, link[rank:]] - rows_el[:, link[:rank]] @ tie)
    if not len(held_e):
        return multiplier, 0.0
    matrix = np.concatenate(columns, axis=1)
    # a redundant link asks nothing of the strain: its column is rounding and must not be leaned on
    share = np.linalg.lstsq(matrix, taken_e - rows_el @ multiplier, rcond=1e-9)[0]
    done = 1
    for block, tie in ties:
        rank = len(tie)
        part = share[done : done + tie.shape[1]]
        multiplier[block.link_l[rank:]] = part
        multiplier[block.link_l[:rank]] -= tie @ part
        done += tie.shape[1]
    return multiplier, float(share[0])


def project_force(
    packing: Packing,
    force_nd: ArrayLike,
    strain_force: ArrayLike | None = None,
    *,
    volume: bool = False,
    method: str = "clusters",
    strain_scale: float | None = None,
) -> ConstrainedForce:
    """Return the part of a force that links (and a fixed volume) do not take up, with the multipliers of the rest.

    Coordinates are the positions and, when a force on the strains is given, the Mandel strains times `strain_scale`;
    what is left of the force depends on that scale, because the projection mixes both.

    Parameters
    ----------
    packing
        The packing; without links every force is free.
    force_nd
        (N, d) forces on the particles [force].
    strain_force
        (s,) force on the Mandel strains, -dU/de [energy]; the box is fixed when left out.
    volume
        Whether the volume is a constraint too; needs a force on the strains.
    method
        "clusters" (a sparse solve per cluster and s more for the strains; where links depend on each other, or
        nearly, it hands over to "householder"), or the bases by name: "householder", "gram-schmidt",
        "gram-schmidt-twice", "whole-matrix" (see `constraint_basis`). What "clusters" prepared for the last packing is
        kept, for further forces on it.
    strain_scale
        Length by which strains are multiplied to be coordinates; V^(1/d) when left out.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or shape, or volume is asked for without a force on the strains.

    Examples
    --------
    >>> import packmech as pm
    >>> dimer = pm.Packing([[0, 0], [1, 0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), pm.Links([0], [1], [[0, 0]], [1.0]))
    >>> found = pm.project_force(dimer, [[-1.0, 1.0], [3.0, 0.0]])
    >>> found.force_nd.round(12).tolist(), found.multiplier_l.round(12).tolist()
    ([[1.0, 1.0], [1.0, 0.0]], [2.0])

    """
    instance("packing", packing, Packing)
    strains = strain_components(packing.dimension)
    force = finite_array("force_nd", force_nd, shape=packing.position_nd.shape)
    instance("volume", volume, bool)
    one_of("method", method, METHODS)
    scale = scale_of_strain(packing, strain_scale)
    strain = strain_force is not None
    pull = np.zeros(strains)
    if strain_force is not None:
        pull = finite_array("strain_force", strain_force, shape=(strains,), what="component") / scale
    elif volume:
        raise ValueError("volume must be False without a force on the strains, got True")
    started = time.process_time()
    projector = None
    if method == "clusters" and packing.links is not None:
        projector = _LAST.projector(packing, strain, volume, scale)
    if projector is not None and projector.independent:
        if strain:
            parts, rate = projector.project(force, pull)
        else:
            out, multiplier, rate = projector.split(force)
            parts = out, np.zeros(strains), multiplier, 0.0
        answer = _answer(packing, parts, scale, volume, method, started, rate=rate)
        if answer.rate <= _ROUNDING * max(np.abs(force).max(), np.abs(pull).max()):
            return answer
    method = "householder" if method == "clusters" else method
    with single_thread():
        basis = constraint_basis(packing, strain, volume, method=method, strain_scale=scale)
        parts = _by_basis(packing, basis, force, pull, scale, volume)
    return _answer(packing, parts, scale, volume, method, started)


def _by_basis(
    packing: Packing, basis: ConstraintBasis, force_nd: NDArray[np.float64], pull_e: NDArray[np.float64],
    scale: float, volume: bool,
) -> Parts:  # fmt: skip
    size, strains = basis.shape
    whole = np.concatenate([force_nd.ravel(), pull_e[:strains]])
    left = basis.project(basis.project(whole))
    taken = whole - left
    held = trace_vector(packing.dimension)[:strains] / scale * (1.0 if volume else 0.0)
    multiplier, share = _multipliers(basis, taken[:size], taken[size:], strain_rows(packing) / scale, held)
    strain = left[size:] if strains else np.zeros_like(pull_e)
    return left[:size].reshape(force_nd.shape), strain, multiplier, share


def _answer(
    packing: Packing, parts: Parts, scale: float, volume: bool, method: str, started: float, rate: float | None = None
) -> ConstrainedForce:
    force, strain, multiplier, held = parts
    if rate is None:
        rate = _largest_rate(packing, force, strain, scale, volume)
    return ConstrainedForce(force, scale * strain, multiplier, held, rate, method, time.process_time() - started)


def _largest_rate(
    packing: Packing, force_nd: NDArray[np.float64], strain_e: NDArray[np.float64], scale: float, volume: bool
) -> float:
    rate = 0.0
    links = packing.links
    if links is not None:
        vector = link_vectors(packing)
        vector /= np.sqrt((vector**2).sum(axis=1))[:, None]
        stretch = (vector * (force_nd[links.j_l] - force_nd[links.i_l])).sum(axis=1)
        if strain_e.any():
            stretch += strain_rows(packing).T @ strain_e / scale
        rate = float(np.abs(stretch).max())
    if volume:
        rate = max(rate, abs(float(trace_vector(packing.dimension) @ strain_e)) / scale)
    return rate
