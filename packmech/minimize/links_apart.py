"""Deep overlaps of linked particles relaxed so that no links pass through each other, in two dimensions.

Contacts keep tangent links apart by themselves once no overlap is deeper than 1 - link / (sqrt(2) diameter), .29 for
beads that touch along the chain: two links that cross have two ends so near. Only starts with deeper ones need this.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts.crossing import NearLinks, crossing_links, link_ends, near_links, swept_links
from packmech.minimize.program import Program
from packmech.packing import Packing

# links are pushed apart up to this distance [mean diameter], until no overlap is deeper than so much [1]
_APART, _SHALLOW = 0.5, 0.25
# how much farther than that links are looked for, so that the pairs serve for several steps [mean diameter]
_SKIN = 0.4
# stiffness of that push over that of the contacts; maximum number of steps; largest displacement in one step, over the
# diameter; times a step is shortened
_PUSH, _STEPS, _FARTHEST, _SHORTER = 0.3, 400, 0.1, 40


def separate_links(
    program: Program, packing: Packing, *, step_limit: int = _STEPS, look: Callable[[], None] | None = None
) -> tuple[Packing, int]:
    """Return the packing moved down the energy until overlaps are shallow, and the number of steps; none if they are.

    A barrier (ln(h / a))^2 of the distance h of an end of one link from another nearer than a keeps links from
    touching (incremental potential contact: Li et al., ACM Trans. Graph. 39, 49 (2020)); clusters whose
    links would pass through each other in a step go half as far. Links that cross at the start are left to it.

    Parameters
    ----------
    program
        The compiled scene.
    packing
        Where to start; returned as it is in three dimensions, without links, or where links are so much longer than
        the box that which of them cross is not known.
    step_limit
        Maximum number of steps, if below the usual one.
    look
        Called before each step: raises where time is up.

    """
    if not _links_can_cross(packing):
        return packing, 0
    if program.evaluate(packing.position_nd, packing.box.lattice_dd).deepest_overlap < _SHALLOW:
        return packing, 0
    near = _Near(packing)
    constraints = ConstraintFactor(packing, workable_links(packing))
    apart = _APART * float(packing.diameter_n.mean())
    links, cluster = packing.links, packing.cluster_n
    farthest = _FARTHEST * float(packing.diameter_n.min())
    steps = min(step_limit, _STEPS)
    for step in range(steps):
        if look is not None:
            look()
        now = program.evaluate(packing.position_nd, packing.box.lattice_dd)
        stiffness = now.force_floor / program.space.resolution[0]
        if now.deepest_overlap < _SHALLOW or not stiffness > 0.0:
            return packing, step
        pairs = near.pairs(packing, apart + 2.0 * farthest)
        force, _, _ = constraints.project(now.force_nd + _barrier(packing, pairs, apart, _PUSH * stiffness))
        length = np.sqrt((force**2).sum(axis=1)) / stiffness
        longest = np.zeros(packing.particles)
        np.maximum.at(longest, cluster, length)
        size = np.minimum(1.0, farthest / np.maximum(longest, 1e-300))[cluster]
        for _ in range(_SHORTER):
            shift = (size / stiffness)[:, None] * force
            trial = constraints.projected(packing.replace(position_nd=packing.position_nd + shift))
            swept = swept_links(packing, trial, pairs)
            if not swept.any():
                break
            # the clusters of links that would meet go half as far
            met = np.concatenate([pairs.first_c[swept], pairs.second_c[swept]])
            size[np.isin(cluster, cluster[links.i_l[met]])] *= 0.5
        else:
            return packing, step
        packing = trial
        constraints = constraints.at(packing)
    return packing, steps


def _links_can_cross(packing: Packing) -> bool:
    """Return whether links can cross: there are bonds, in two dimensions, not much longer than the box."""
    links = packing.links
    if packing.dimension != 2 or links.shape_l.all():
        return False
    return bool(links.length_l[~links.shape_l].max() < 2.0 * packing.box.height_d.min())


class _Near:
    """Pairs of links near each other, searched for again when particles have moved too far."""

    def __init__(self, packing: Packing) -> None:
        found = crossing_links(packing)
        self._crossing = set(zip(found.first_c.tolist(), found.second_c.tolist(), strict=True))
        self._anchor = packing
        self._reach = -np.inf
        self._pairs: NearLinks | None = None

    def pairs(self, packing: Packing, reach: float) -> NearLinks:
        """Return the pairs of links within reach that did not cross at the start, and some farther apart [length]."""
        moved = np.sqrt(((packing.position_nd - self._anchor.position_nd) ** 2).sum(axis=1).max())
        if self._pairs is None or self._reach - 2.0 * moved < reach:
            self._reach = reach + _SKIN * float(packing.diameter_n.mean())
            near = near_links(packing, self._reach)
            names = zip(near.first_c.tolist(), near.second_c.tolist(), strict=True)
            free = np.array([pair not in self._crossing for pair in names], dtype=bool)
            self._pairs, self._anchor = NearLinks(*(part[free] for part in near)), packing
        return self._pairs


def _barrier(packing: Packing, near: NearLinks, apart: float, stiffness: float) -> NDArray[np.float64]:
    """Return the forces (N, 2) that push links apart."""
    links = packing.links
    place, along = link_ends(packing, near)
    share = np.clip((place * along).sum(axis=2) / (along**2).sum(axis=2), 0.0, 1.0)
    away = place - share[:, :, None] * along
    h = np.maximum(np.sqrt((away**2).sum(axis=2)), 1e-12 * apart)
    size = np.where(h < apart, 2.0 * stiffness * apart**2 * np.log(apart / h) / h, 0.0)
    push = (size / h)[:, :, None] * away
    a, b = near.first_c, near.second_c
    point = np.stack([links.i_l[a], links.j_l[a], links.i_l[b], links.j_l[b]])
    start = np.stack([links.i_l[b], links.i_l[b], links.i_l[a], links.i_l[a]])
    end = np.stack([links.j_l[b], links.j_l[b], links.j_l[a], links.j_l[a]])
    force = np.zeros_like(packing.position_nd)
    np.add.at(force, point, push)
    np.add.at(force, start, -(1.0 - share)[:, :, None] * push)
    np.add.at(force, end, -share[:, :, None] * push)
    return force
