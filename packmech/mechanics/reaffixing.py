"""Positions back to the lengths of the links."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, integer, positive
from packmech.mechanics.constraints import link_vectors
from packmech.mechanics.link_affix import DAMPED
from packmech.mechanics.link_calls import record_links, refill_links
from packmech.mechanics.link_system import make_link_system
from packmech.mechanics.redundant_links import SINE, DegenerateLink, check_consistent, dependence
from packmech.outcome import NotConverged, Outcome, Run
from packmech.packing import Packing, no_own_images

# a squared sine below this is looked into: links may depend on others
_SUSPECT = 1e-9
# errors this small fall in every step of Newton's method
_CLOSE = 1e-5
# Newton's method is done by then where links have full rank, from places not too far off
_QUADRATIC = 12
# and from so close a handful of errors is all it leaves, rounding included
_LAST = 5
# sine between dependent links where the error has fallen as far as rounding lets it beside a degenerate shape
_NEAR = 1e-4
# tolerance for the lengths of redundant links [larger of length and mean diameter]
_AGREEMENT = 1e-9


@dataclass(frozen=True, eq=False)
class ReaffixedLinks:
    """A packing whose links have their lengths again, and how it got there.

    Attributes
    ----------
    packing
        The packing at the end, or the one given when the steps led nowhere; its box is the one given.
    outcome
        `CONVERGED`, `STALLED` when the tolerance was not met, `DEGENERATE` when it was met where links lose rank.
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
        Most Newton steps.
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
    instance("check", check, bool)
    started = time.process_time()
    links = packing.links
    if links is None:
        spent = time.process_time() - started
        return ReaffixedLinks(packing, Outcome.CONVERGED, 0, np.zeros(1), 0, (), spent)
    link_vectors(packing)
    mean, lattice = float(packing.diameter_n.mean()), packing.box.lattice_dd
    system = make_link_system(links, packing.particles, packing.dimension, mean_diameter=mean)
    pivot, _ = refill_links(system, packing.position_nd, lattice)
    if pivot < _SUSPECT:
        found = dependence(packing)
        if len(found.redundant_l):
            check_consistent(packing, found, _AGREEMENT)
            keep = np.ones(len(links), dtype=bool)
            keep[found.redundant_l] = False
            system = make_link_system(links.select(keep), packing.particles, packing.dimension, mean_diameter=mean)
    place = np.array(packing.position_nd)
    error_t = np.zeros((1 + DAMPED) * limit + 1)
    steps = int(record_links(system, place, lattice, tolerance, limit, error_t)[0])
    residual = error_t[: steps + 1]
    outcome = Outcome.CONVERGED if residual[-1] <= tolerance else Outcome.STALLED
    degenerate: tuple[DegenerateLink, ...] = ()
    rank = len(system.order_r)
    if residual[-1] <= max(_CLOSE, tolerance):
        packing = packing.replace(position_nd=place)
    # from farther off than that, where the steps went tells nothing about the links
    if residual[-1] < _CLOSE:
        # near a degenerate shape the error falls by a constant factor, and the shape is met to its square root only
        many = len(residual) > _QUADRATIC or np.count_nonzero(residual < _CLOSE) > _LAST
        slow = many and residual[-1] > 0.05 * residual[-2]
        if slow or refill_links(system, place, lattice)[0] < _SUSPECT:
            degenerate = dependence(packing, _NEAR if slow else SINE).degenerate
            rank -= len(degenerate)
    if degenerate:
        outcome = Outcome.DEGENERATE
    seconds = time.process_time() - started
    result = ReaffixedLinks(packing, outcome, steps, residual.copy(), rank, degenerate, seconds)
    if check and not result.ok:
        raise NotConverged(
            Run(packing, outcome, result.residual, result.iterations, 0, seconds, report={"rank": rank}), _words(result)
        )
    return result


def _words(result: ReaffixedLinks) -> str:
    told = f"largest error {result.residual:.3g} after {result.iterations} iterations"
    if not result.degenerate:
        return f"links could not be brought to their lengths: {told}"
    first = result.degenerate[0]
    more = f" and {len(result.degenerate) - 1} more" if len(result.degenerate) > 1 else ""
    return f"{Outcome.DEGENERATE.value} Here: {first}{more} ({told})"
