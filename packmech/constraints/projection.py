"""Projection onto the constraints: forces without the part that links and a fixed volume take up, and positions back.

F_cons = (1 - Gamma_o Gamma_o^T) F, equations 6 and 18 of Dennis (2021), Gamma never made dense; and Newton's way
back to the links' lengths, equation 7.
"""

from __future__ import annotations

import threading
import time
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import ANY_LENGTH, honors
from packmech.check import BoxStrain, boolean, finite_array, instance, integer, one_of, positive
from packmech.constraints.basis import METHODS as BASES
from packmech.constraints.basis import Block, ConstraintBasis, constraint_basis
from packmech.constraints.factor import ConstraintFactor, Strains
from packmech.constraints.jacobian import link_rows, scale_of_strain
from packmech.constraints.redundancy import SINE, DegenerateLink, check_consistent, dependence, workable_links
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import strain_components, trace_vector
from packmech.packing import Packing, no_own_images
from packmech.result import NotConverged, Outcome, Run

METHODS = ("clusters", *BASES)
# below this squared sine between a link and those before it the normal matrix keeps too few digits to tell its rank
_SAFE_PIVOT = 1e-10
# a rate left over, relative to the force, that is no longer rounding: the normal matrix is too ill-conditioned
_ROUNDING = 1e-13
# a squared sine below this is looked into: links may depend on others
_SUSPECT = 1e-9
# errors this small fall in every step of Newton's method
_CLOSE = 1e-5
# Newton's method is done by then where links have full rank, from places not too far off
_QUADRATIC = 12
# and from so close a handful of errors is all it leaves, rounding included
_FEW = 5
# sine between dependent links where the error has fallen as far as rounding lets it beside a degenerate shape
_NEAR = 1e-4
# tolerance for the lengths of redundant links [larger of length and mean diameter]
_AGREEMENT = 1e-9

# what is left of the force and of the force on scaled strains, multipliers of the links and of the volume
Parts = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], float]


@shown()
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


class _Last(threading.local):
    """What was factored for the last packing in this thread: a packing never changes, so that it serves again."""

    def __init__(self) -> None:
        self._packing: Any = lambda: None
        self._key: tuple[Any, ...] = ()
        self._made: tuple[ConstraintFactor, Strains | None] | None = None

    def factor(
        self, packing: Packing, strain: BoxStrain, scale: float
    ) -> tuple[ConstraintFactor, Strains | None] | None:
        """Return the factored links and what strains need of them; None where links nearly depend on each other."""
        key = (strain, scale)
        if self._packing() is not packing or self._key != key:
            found = ConstraintFactor(packing)
            self._made = None
            if found.left_out == 0 and found.smallest_pivot > _SAFE_PIVOT:
                self._made = found, None if strain == "none" else found.strains(scale, strain)
            self._packing, self._key = weakref.ref(packing), key
        return self._made


_LAST = _Last()


def _multipliers(
    basis: ConstraintBasis, taken_x: NDArray[np.float64], taken_e: NDArray[np.float64],
    rows_el: NDArray[np.float64], held_e: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float]:  # fmt: skip
    """Return multipliers of links and volume that make up the part taken out; dependent links share the smallest."""
    multiplier = np.zeros(rows_el.shape[1])
    dependents: list[tuple[Block, NDArray[np.float64]]] = []
    columns = [held_e[:, None]]
    for block in basis.blocks:
        rank = block.basis_xr.shape[1]
        triangle, link = block.triangle_rl, block.link_l
        multiplier[link[:rank]] = np.linalg.solve(triangle[:, :rank], block.basis_xr.T @ taken_x[block.row_x])
        if len(held_e) and rank < len(link):
            combination = np.asarray(np.linalg.solve(triangle[:, :rank], triangle[:, rank:]), dtype=np.float64)
            dependents.append((block, combination))
            columns.append(rows_el[:, link[rank:]] - rows_el[:, link[:rank]] @ combination)
    if not len(held_e):
        return multiplier, 0.0
    matrix = np.concatenate(columns, axis=1)
    # a redundant link asks nothing of the strain: its column is rounding and must not be leaned on
    share = np.linalg.lstsq(matrix, taken_e - rows_el @ multiplier, rcond=1e-9)[0]
    done = 1
    for block, combination in dependents:
        rank = len(combination)
        part = share[done : done + combination.shape[1]]
        multiplier[block.link_l[rank:]] = part
        multiplier[block.link_l[:rank]] -= combination @ part
        done += combination.shape[1]
    return multiplier, float(share[0])


@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def project_force(
    packing: Packing,
    force_nd: ArrayLike,
    strain_force: ArrayLike | None = None,
    *,
    strain: BoxStrain = "free",
    method: str = "clusters",
    strain_scale: float | None = 1.0,
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
    strain
        "free", or "isochoric" where the volume is a constraint too; of no effect without a force on the strains.
    method
        "clusters" (a sparse solve per cluster and s more for the strains; where links depend on each other, or
        nearly, it hands over to "householder"), or the bases by name: "householder", "gram-schmidt",
        "gram-schmidt-twice", "whole-matrix" (see `constraint_basis`). What "clusters" prepared for the last packing is
        kept, for further forces on it.
    strain_scale
        Length by which strains are multiplied to be coordinates. None: V^(1/d).

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or shape, or a name is unknown.

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
    one_of("strain", strain, ("isochoric", "free"))
    one_of("method", method, METHODS)
    scale = scale_of_strain(packing, strain_scale)
    pull = np.zeros(strains)
    if strain_force is not None:
        pull = finite_array("strain_force", strain_force, shape=(strains,), what="component") / scale
    else:
        strain = "none"
    started = time.process_time()

    def answer(parts: Parts, rate: float) -> ConstrainedForce:
        left, strain_left, multiplier, held = parts
        seconds = time.process_time() - started
        return ConstrainedForce(left, scale * strain_left, multiplier, held, rate, method, seconds)

    if method == "clusters":
        factored = _LAST.factor(packing, strain, scale)
        if factored is not None:
            factor, prepared = factored
            if prepared is None:
                left, multiplier, rate = factor.project(force)
                found: Parts = left, np.zeros(strains), multiplier, 0.0
            else:
                left, strain_left, multiplier, held, rate = factor.project_strained(prepared, force, pull)
                found = left, strain_left, multiplier, held
            if rate <= _ROUNDING * max(np.abs(force).max(), np.abs(pull).max()):
                return answer(found, rate)
    method = "householder" if method == "clusters" else method
    with single_thread():
        basis = constraint_basis(packing, strain, method=method, strain_scale=scale)
        position, stretch = link_rows(ConstraintFactor(packing))
        found = _by_basis(basis, stretch / scale, force, pull, scale, strain)
    left, strain_left, *_ = found
    rate = np.abs(position.T @ left.ravel() + stretch.T @ strain_left / scale).max(initial=0.0)
    if strain == "isochoric":
        rate = max(rate, abs(trace_vector(packing.dimension) @ strain_left) / scale)
    return answer(found, float(rate))


def _by_basis(
    basis: ConstraintBasis, rows_el: NDArray[np.float64], force_nd: NDArray[np.float64], pull_e: NDArray[np.float64],
    scale: float, box: str,
) -> Parts:  # fmt: skip
    size, strains = basis.shape
    whole = np.concatenate([force_nd.ravel(), pull_e[:strains]])
    left = basis.project(basis.project(whole))
    taken = whole - left
    held = trace_vector(force_nd.shape[1])[:strains] / scale * (1.0 if box == "isochoric" else 0.0)
    multiplier, share = _multipliers(basis, taken[:size], taken[size:], rows_el, held)
    strain = left[size:] if strains else np.zeros_like(pull_e)
    return left[:size].reshape(force_nd.shape), strain, multiplier, share


@shown()
@dataclass(frozen=True, eq=False)
class ReaffixedLinks:
    """A packing whose links have their lengths again, and how it got there.

    Attributes
    ----------
    packing
        The packing at the end, or the one given when the steps led nowhere; its box is the one given.
    outcome
        `CONVERGED`, `ROUNDING_FLOOR` where the errors are no more than rounding of coordinates, `STALLED` when the
        tolerance was not met, `DEGENERATE` when it was met where links lose rank.
    iterations
        Newton steps.
    residual_t
        (iterations + 1,) largest errors, over the larger of the link's length and the mean diameter [1].
    rank
        Number of independent links at the end.
    degenerate
        Links that depend on others only because of how particles stand.
    seconds
        CPU time.

    """

    packing: Packing
    outcome: Outcome
    iterations: int
    residual_t: NDArray[np.float64]
    rank: int
    degenerate: tuple[DegenerateLink, ...]
    seconds: float

    @property
    def residual(self) -> float:
        """Largest error at the end, over the larger of the link's length and the mean diameter [1]."""
        return float(self.residual_t[-1])

    @property
    def ok(self) -> bool:
        """Whether the outcome is a success."""
        return self.outcome.ok


@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def reaffix_links(
    packing: Packing, *, tolerance: float = 1e-13, iteration_limit: int = 50, check: bool = True
) -> ReaffixedLinks:
    """Return the packing with its links at their lengths, by Newton steps of minimum norm (equation 7, corrected).

    Each step is x - Omega (Omega^T Omega)^-1 c, c the errors, with the Jacobian at the present places: the error falls
    quadratically, unless links lose rank. Redundant links are left to those they depend on, if their lengths agree.

    Parameters
    ----------
    packing
        The packing, not too far from the lengths.
    tolerance
        Largest error to stop at, over the larger of the link's length and the mean diameter [1].
    iteration_limit
        Maximum number of Newton steps.
    check
        Whether an outcome that is no success raises.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or a redundant link's length disagrees: the message names the pair.
    NotConverged
        If the tolerance was not met, or was met where links lose rank, as for collinear trimers and coplanar
        tetramers, which the message names. `.run` holds what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> dimer = pm.Packing([[0, 0], [1.1, 0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), pm.Links([0], [1], [[0, 0]], [1.0]))
    >>> found = pm.reaffix_links(dimer)
    >>> found.packing.position_nd.round(12).tolist(), found.iterations, found.rank
    ([[0.05, 0.0], [1.05, 0.0]], 1, 1)

    """
    instance("packing", packing, Packing)
    no_own_images("packing", packing)
    tolerance = positive("tolerance", tolerance)
    limit = integer("iteration_limit", iteration_limit, at_least=1)
    boolean("check", check)
    started = time.process_time()
    factor = ConstraintFactor(packing)
    if factor.smallest_pivot < _SUSPECT:
        found = dependence(packing)
        if len(found.redundant_l):
            check_consistent(packing, found, _AGREEMENT)
            keep = np.ones(len(packing.links), dtype=bool)
            keep[found.redundant_l] = False
            factor = ConstraintFactor(packing, packing.links.select(keep))
    place, residual = factor.project_positions(packing.position_nd, packing.box.lattice_dd, tolerance, limit)
    steps = len(residual) - 1
    outcome = Outcome.CONVERGED if residual[-1] <= tolerance else Outcome.STALLED
    if tolerance < residual[-1] <= factor.rounding(packing):
        outcome = Outcome.ROUNDING_FLOOR
    degenerate: tuple[DegenerateLink, ...] = ()
    rank = len(factor.pairs)
    if residual[-1] <= max(_CLOSE, tolerance):
        packing = packing.replace(position_nd=place)
    # from farther off than that, where the steps went is inconclusive about the links
    if residual[-1] < _CLOSE:
        # near a degenerate shape the error falls by a constant factor, and the shape is met to its square root only
        many = len(residual) > _QUADRATIC or np.count_nonzero(residual < _CLOSE) > _FEW
        slow = many and residual[-1] > 0.05 * residual[-2]
        if slow or factor.at(packing).smallest_pivot < _SUSPECT:
            degenerate = dependence(packing, _NEAR if slow else SINE).degenerate
            rank -= len(degenerate)
    if degenerate:
        outcome = Outcome.DEGENERATE
    seconds = time.process_time() - started
    result = ReaffixedLinks(packing, outcome, steps, residual.copy(), rank, degenerate, seconds)
    if check and not result.ok:
        raise NotConverged(
            Run(packing, outcome, result.residual, result.iterations, 0, seconds, report={"rank": rank}),
            _description(result),
        )
    return result


def _description(result: ReaffixedLinks) -> str:
    reached = f"largest error {result.residual:.3g} after {result.iterations} iterations"
    if not result.degenerate:
        return f"links could not be brought to their lengths: {reached}"
    first = result.degenerate[0]
    more = f" and {len(result.degenerate) - 1} more" if len(result.degenerate) > 1 else ""
    return f"{Outcome.DEGENERATE.value} Here: {first}{more} ({reached})"


def scale_box(packing: Packing, factor: float) -> Packing:
    """Return the packing with its box scaled, and with it the centers of particles and of clusters of linked ones.

    Clusters keep their shape. One that winds around the box is strained with it and moved back onto its links.

    Parameters
    ----------
    packing
        The packing.
    factor
        Factor on the lattice vectors [1].

    """
    return strain_box(packing, (factor - 1.0) * np.eye(packing.dimension))


def strain_box(packing: Packing, gradient_dd: NDArray[np.float64]) -> Packing:
    """Return the packing with its box strained by a (d, d) displacement gradient, as `scale_box` scales it."""
    box, cluster = packing.box.strained(gradient_dd), packing.cluster_n
    offset, winding = packing.unwrapping_nd, packing.winding_n
    count = np.bincount(cluster)
    place = packing.position_nd + offset @ packing.box.lattice_dd.T
    center = np.stack([np.bincount(cluster, place[:, a]) / count for a in range(packing.dimension)], axis=1)[cluster]
    moved = place + np.where(winding[:, None], place, center) @ gradient_dd.T
    position = moved - offset @ box.lattice_dd.T
    return ConstraintFactor(packing, workable_links(packing)).projected(packing.replace(position_nd=position, box=box))
