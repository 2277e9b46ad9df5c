"""Links that may not pass through each other, in two dimensions: steps checked, and links pushed apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts.crossing import NearLinks, find_crossings, link_ends, link_gaps, near_links, swept_links
from packmech.packing import Packing

if TYPE_CHECKING:
    from packmech.minimize.program import Program

# links further apart than this are not looked at until particles have moved by as much [mean link length]
_REACH = 0.5
# links are pushed apart up to this distance [mean diameter], until no overlap is deeper than so much [1]
_APART, _SHALLOW = 0.5, 0.25
# stiffness of that push over that of the contacts; maximum number of steps; largest displacement in one step, over the
# diameter; times a step is shortened
_PUSH, _STEPS, _FARTHEST, _SHORTER = 0.3, 400, 0.05, 40


def links_can_cross(packing: Packing) -> bool:
    """Return whether links can cross: there are bonds, in two dimensions, not much longer than the box."""
    links = packing.links
    if links is None or packing.dimension != 2 or links.shape_l is None or links.shape_l.all():
        return False
    return bool(links.length_l[~links.shape_l].max() < 2.0 * packing.box.height_d.min())


class LinkGuard:
    """The last packing whose links have not passed through each other since the first one.

    Links that cross in the first packing may do what they like with each other.

    Parameters
    ----------
    packing
        The first packing.

    """

    def __init__(self, packing: Packing) -> None:
        links = packing.links
        assert links is not None and links.shape_l is not None
        self._reach = _REACH * float(links.length_l[~links.shape_l].mean())
        self._crossing = _crossing_pairs(packing)
        # the way taken since the last look, over that at which links could meet
        self.share = 0.0
        self.take(packing)

    def take(self, packing: Packing) -> None:
        """Keep a packing."""
        self.packing = packing
        self.near = self._near(self._reach)
        self.clearance = min(float(link_gaps(packing, self.near).min(initial=np.inf)), self._reach)

    def _near(self, reach: float) -> NearLinks:
        """Return the pairs of links within reach that may not pass through each other."""
        near = near_links(self.packing, reach)
        pairs = zip(near.first_c.tolist(), near.second_c.tolist(), strict=True)
        free = np.array([pair not in self._crossing for pair in pairs], dtype=bool)
        return NearLinks(*(part[free] for part in near))

    def admits(self, after: Packing) -> bool:
        """Return whether links come to another packing without passing through each other, and keep it if so."""
        # an affine motion moves no link through another: what counts is the rest
        strain = after.box.lattice_dd @ self.packing.box.inverse_dd
        moved = after.position_nd - self.packing.position_nd @ strain.T
        approach = 2.0 * float(np.sqrt((moved**2).sum(axis=1).max()))
        kept = 1.0 - float(np.abs(strain - np.eye(2)).sum())
        self.share = approach / max(kept * self.clearance, 1e-300)
        if 0.0 <= self.share < 1.0 and kept > 0.5:
            return True
        if len(self.swept(after, 2.0 * approach)):
            return False
        self.take(after)
        return True

    def swept(self, after: Packing, reach: float = 0.0) -> NDArray[np.int64]:
        """Return the links that pass through each other on the straight way to another packing.

        Parameters
        ----------
        after
            The packing.
        reach
            Distance within which links may meet on the way; never less than that which is looked at anyway [length].

        """
        near = self.near if reach <= self._reach else self._near(reach)
        found = swept_links(self.packing, after, near)
        return np.unique(np.concatenate([near.first_c[found], near.second_c[found]]))


def links_stay_apart(before: Packing, after: Packing) -> bool:
    """Return whether no links pass through each other on the straight way from one packing to another."""
    return not links_can_cross(before) or LinkGuard(before).admits(after)


def _crossing_pairs(packing: Packing) -> set[tuple[int, int]]:
    assert packing.links is not None
    found = find_crossings(packing.position_nd, packing.box, packing.links)
    return set(zip(found.first_c.tolist(), found.second_c.tolist(), strict=True))


def push_apart(program: Program, guard: LinkGuard) -> tuple[Packing, int]:
    """Return the packing moved down the energy, its links apart, until overlaps are shallow, and the number of steps.

    A barrier, (ln(h / a))^2 of the distance h of an end of one link from another nearer than a, keeps links from
    touching (incremental potential contact: Li et al., ACM Trans. Graph. 39, 49 (2020)); clusters whose
    links would pass through each other in a step go half as far.
    """
    packing = guard.packing
    constraints = ConstraintFactor(packing, workable_links(packing))
    apart = _APART * float(packing.diameter_n.mean())
    links = packing.links
    assert links is not None
    cluster = links.clusters(packing.particles)
    farthest = _FARTHEST * float(packing.diameter_n.min())
    for step in range(_STEPS):
        now = program.evaluate(packing.position_nd, packing.box.lattice_dd)
        stiffness = now.force_floor / program.space.resolution
        if now.deepest_overlap < _SHALLOW or not stiffness > 0.0:
            return packing, step
        force = now.force_nd + _barrier(packing, guard.near, apart, _PUSH * stiffness)
        force, _, _ = constraints.project(force)
        length = np.sqrt((force**2).sum(axis=1)) / stiffness
        longest = np.zeros(packing.particles)
        np.maximum.at(longest, cluster, length)
        size = np.minimum(1.0, farthest / np.maximum(longest, 1e-300))[cluster]
        for _ in range(_SHORTER):
            u = (size / stiffness)[:, None] * force
            trial = constraints.projected(packing.replace(position_nd=packing.position_nd + u))
            swept = guard.swept(trial)
            if not len(swept):
                break
            # the clusters of links that would meet go half as far
            size[np.isin(cluster, cluster[links.i_l[swept]])] *= 0.5
        else:
            return packing, step
        guard.take(trial)
        packing = trial
        constraints = constraints.at(packing)
    return packing, _STEPS


def _barrier(packing: Packing, near: NearLinks, apart: float, stiffness: float) -> NDArray[np.float64]:
    """Return the forces (N, 2) that push links apart."""
    links = packing.links
    assert links is not None
    place, along = link_ends(packing, near)
    share = np.clip((place * along).sum(axis=2) / (along**2).sum(axis=2), 0.0, 1.0)
    away = place - share[:, :, None] * along
    h = np.sqrt((away**2).sum(axis=2))
    size = np.where(h < apart, 2.0 * stiffness * apart**2 * np.log(apart / np.maximum(h, 1e-12)) / h, 0.0)
    push = size[:, :, None] * away / h[:, :, None]
    a, b = near.first_c, near.second_c
    point = np.stack([links.i_l[a], links.j_l[a], links.i_l[b], links.j_l[b]])
    start = np.stack([links.i_l[b], links.i_l[b], links.i_l[a], links.i_l[a]])
    end = np.stack([links.j_l[b], links.j_l[b], links.j_l[a], links.j_l[a]])
    force = np.zeros_like(packing.position_nd)
    np.add.at(force, point, push)
    np.add.at(force, start, -(1.0 - share)[:, :, None] * push)
    np.add.at(force, end, -share[:, :, None] * push)
    return force
