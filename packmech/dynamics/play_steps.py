"""One step of hard particles along a motion: contacts may open and not close, links keep their lengths.

A direction is (displacements u, symmetric strain E): x -> x + s (u + E x), lattice -> (1 + s E) lattice. Every vector
between particles then changes along a straight line, and lengths along straight lines are convex: contacts that do not
close to first order do not close at all. Where others come into the way, the step is the nearest one that they allow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts import Contacts, find_contacts
from packmech.measure.link_tension import distance_gradients, link_pairs
from packmech.mechanics.reaffixing import reaffix_links
from packmech.mechanics.rigidity import strain_columns
from packmech.mechanics.strain import mandel_tensor, mandel_vector, strain_components, trace_vector
from packmech.packing import Packing

# what is left of a step where contacts hold a motion up [1]
_STANDSTILL = 0.02
# a step is given up when so much of it is lost on the way back to where links and contacts allow it
_LOST = 0.5
_CORRECTIONS = 12
# links this near to their lengths count as kept [1]
_KEPT = 1e-12
_SOLVER = 1e-10


@dataclass(frozen=True, eq=False)
class Direction:
    """Displacements (N, d) [length] and a symmetric strain (d, d) [1], for a unit of amplitude."""

    displacement_nd: NDArray[np.float64]
    strain_dd: NDArray[np.float64]

    def times(self, factor: float) -> Direction:
        """Return the direction, longer by the factor."""
        return Direction(factor * self.displacement_nd, factor * self.strain_dd)

    def product(self, other: Direction, scale: float) -> float:
        """Return the scalar product with another direction, strains counted as `scale` lengths [length^2]."""
        strain = scale**2 * float((self.strain_dd * other.strain_dd).sum())
        return float((self.displacement_nd * other.displacement_nd).sum()) + strain

    def size(self, scale: float) -> float:
        """Return the largest displacement, or scale times the largest Mandel strain [length]."""
        moved = np.sqrt((self.displacement_nd**2).sum(axis=1)).max()
        return float(max(moved, scale * np.abs(mandel_vector(self.strain_dd)).max()))

    def apply(self, packing: Packing) -> Packing:
        """Return the packing after a unit of the direction; links are not mended."""
        position = packing.position_nd
        moved = position + self.displacement_nd + position @ self.strain_dd
        return packing.replace(position_nd=moved, box=packing.box.strained(self.strain_dd))

    def ahead(self, step: float) -> Direction:
        """Return the same straight line as seen from the place one step along it."""
        back = np.linalg.inv(np.eye(len(self.strain_dd)) + step * self.strain_dd)
        strain = back @ self.strain_dd
        return Direction(self.displacement_nd @ back.T, 0.5 * (strain + strain.T))


def difference(before: Packing, after: Packing) -> Direction:
    """Return the step from one packing to another; of a box that turned, what strained it."""
    change = after.box.lattice_dd @ before.box.inverse_dd - np.eye(before.dimension)
    strain = 0.5 * (change + change.T)
    return Direction(after.position_nd - before.position_nd - before.position_nd @ change.T, strain)


@dataclass(frozen=True, eq=False)
class Rules:
    """What a motion has to keep to.

    Attributes
    ----------
    volume
        "nonincreasing" or "fixed", where the box moves.
    start_volume
        The volume that it is held at [length^d].
    scale
        Length that a unit strain counts as [length].
    overlap_tolerance
        Largest relative overlap [1] beyond those of the start.
    floor
        Distances of the pairs that overlap at the start, by (i, j, image): they are hard at that distance [length].
    box_moves
        Whether the box takes part in the motion.

    """

    volume: str
    start_volume: float
    scale: float
    overlap_tolerance: float
    floor: dict[tuple[int, ...], float]
    box_moves: bool

    def floor_c(self, contacts: Contacts) -> NDArray[np.float64]:
        """Return the (C,) distances below which pairs are not to come [length]."""
        floor = contacts.contact_distance_c.copy()
        if self.floor:
            for c, pair in enumerate(pairs_of(contacts)):
                floor[c] = self.floor.get(pair, floor[c])
        return floor

    def closing(self, packing: Packing) -> float:
        """Return how far the worst pair is below its floor, over the contact distance [1]; 0 when none is."""
        contacts = find_contacts(packing)
        below = (self.floor_c(contacts) - contacts.distance_c) / contacts.contact_distance_c
        return float(below.max(initial=0.0))

    def kept(self, packing: Packing) -> bool:
        """Whether contacts and links are as they should be."""
        return packing.link_error <= _KEPT and self.closing(packing) <= self.overlap_tolerance

    def mended(self, packing: Packing, volume: float) -> Packing:
        """Return the packing with volume and links put right, as far as it takes no contacts; they may be wrong after.

        Parameters
        ----------
        packing
            The packing.
        volume
            The volume before the step [length^d].

        """
        if self.box_moves:
            held = self.volume == "fixed"
            aim = self.start_volume if held else min(volume, packing.box.volume)
            if aim != packing.box.volume:
                factor = (aim / packing.box.volume) ** (1.0 / packing.dimension)
                box = Box(factor * packing.box.lattice_dd)
                packing = packing.replace(position_nd=factor * packing.position_nd, box=box)
        return packing if packing.links is None else reaffix_links(packing, check=False).packing


def pairs_of(contacts: Contacts) -> list[tuple[int, ...]]:
    """Return each pair as (i, j, image)."""
    table = np.column_stack([contacts.i_c, contacts.j_c, contacts.image_cd])
    return [tuple(row) for row in table.tolist()]


def advance(
    packing: Packing, direction: Direction, step: float, rules: Rules
) -> tuple[Packing, Direction, float] | str:
    """Return the packing after a step, the direction that goes on from there and the way made, or why there is none.

    "contacts": nothing is left of the direction. "second order": what links and contacts admit to first order leads
    nowhere, at this length of the step.

    Parameters
    ----------
    packing, direction
        Where it stands and where it goes.
    step
        How far, in units of the direction.
    rules
        What to keep to.

    """
    volume, scale = packing.box.volume, rules.scale
    target = direction.times(step)
    ahead = rules.mended(target.apply(packing), volume)
    free = rules.kept(ahead)
    if free and packing.links is None:
        return ahead, direction.ahead(step), step
    reach = target.size(scale)
    wanted = target if free else nearest(packing, target, rules, reach)
    if wanted.size(scale) < _STANDSTILL * reach:
        return "contacts"
    if not free:
        ahead = rules.mended(wanted.apply(packing), volume)
    for _ in range(_CORRECTIONS):
        done = difference(packing, ahead)
        if done.product(wanted, scale) < _LOST * wanted.product(wanted, scale):
            break
        if rules.kept(ahead):
            way = done.size(scale) / direction.size(scale)
            return ahead, done.times(1.0 / way), min(way, step)
        stay = Direction(np.zeros_like(packing.position_nd), np.zeros_like(packing.box.lattice_dd))
        ahead = rules.mended(nearest(ahead, stay, rules, reach).apply(ahead), volume)
    return "second order"


def nearest(packing: Packing, target: Direction, rules: Rules, reach: float) -> Direction:
    """Return the step nearest to the target that contacts, links and volume admit, all taken as linear.

    Parameters
    ----------
    packing
        Where the step begins.
    target
        The step that is wanted.
    rules
        What to keep to.
    reach
        How far anything may move; pairs that cannot meet by then are left out [length].

    """
    import clarabel

    d, moving = packing.dimension, packing.position_nd.size
    strains = strain_components(d) if rules.box_moves else 0
    smallest = 2.0 * float(packing.radius_n.min())
    # both partners of a pair move, and what contacts ask may add as much
    near = find_contacts(packing, gap_tolerance=4.0 * reach * (1.0 / smallest + 1.0 / rules.scale))
    links = link_pairs(packing)
    room_c = near.distance_c - rules.floor_c(near)
    wrong_l = np.zeros(0) if packing.links is None else packing.links.length_l - links.distance_c
    # numbers of order one for the solver: lengths in units of the step, or of the errors to be mended
    unit = max(target.size(rules.scale), float(np.abs(wrong_l).max(initial=0.0)), float(-room_c.min(initial=0.0)))

    def rows(pairs: Contacts) -> sp.csr_array:
        gradient = distance_gradients(pairs)
        if not strains:
            return gradient
        return sp.csr_array(sp.hstack([gradient, sp.csr_array(strain_columns(pairs) / rules.scale)], format="csr"))

    trace = sp.csr_array(np.concatenate([np.zeros(moving), trace_vector(d) / np.sqrt(d)])[None, :]) if strains else None
    equal, below = [rows(links)], [-rows(near)]
    equal_to, below_to = [wrong_l / unit], [room_c / unit]
    if trace is not None:
        (equal if rules.volume == "fixed" else below).append(trace)
        (equal_to if rules.volume == "fixed" else below_to).append(np.zeros(1))
    wanted = target.displacement_nd.ravel()
    if strains:
        wanted = np.concatenate([wanted, rules.scale * mandel_vector(target.strain_dd)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _SOLVER
    counts = [sum(len(part) for part in side) for side in (equal_to, below_to)]
    found = clarabel.DefaultSolver(
        sp.csc_matrix(sp.eye_array(moving + strains)),
        -wanted / unit,
        sp.csc_matrix(sp.vstack([*equal, *below])),
        np.concatenate([*equal_to, *below_to]),
        [clarabel.ZeroConeT(counts[0]), clarabel.NonnegativeConeT(counts[1])],
        settings,
    ).solve()
    motion = unit * np.array(found.x)
    strain = mandel_tensor(motion[moving:] / rules.scale) if strains else np.zeros((d, d))
    return Direction(motion[:moving].reshape(-1, d), strain)
