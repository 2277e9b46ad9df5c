"""The links of one packing outside compiled loops: back onto them, and along what they admit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.dynamics.joints import NEWTON, TIGHT
from packmech.links import Links, image_offsets
from packmech.mechanics.link_calls import project_links, reaffix_links, refill_links
from packmech.mechanics.link_system import make_link_system
from packmech.packing import Packing, no_own_images


def workable_links(packing: Packing) -> Links:
    """Return the packing's links without redundant ones, whose forces would not be determined.

    Raises
    ------
    ValueError
        If a redundant link contradicts the others, or if links depend on each other only to first order, where
        particles stand in a line or in a plane: nothing could bring them back to their lengths.

    """
    links = packing.links
    assert links is not None
    no_own_images("packing", packing)
    beads = np.bincount(links.clusters(packing.particles))
    if len(links) == int((beads - 1).sum()) and (links.i_l != links.j_l).all():
        return links  # without rings every link is independent
    from packmech.mechanics.redundant_links import independent_links

    found = independent_links(packing)
    if found.degenerate:
        raise ValueError(f"packing must have links that hold to first order, got a link of {found.degenerate[0]}")
    assert found.packing.links is not None
    return found.packing.links


class Tether:
    """Links compiled once for a packing's particles, for many positions and boxes.

    Parameters
    ----------
    packing
        A packing with links.

    """

    def __init__(self, packing: Packing) -> None:
        self.links = links = workable_links(packing)
        mean = float(packing.diameter_n.mean())
        self._system = make_link_system(links, packing.particles, packing.dimension, mean_diameter=mean)

    def affixed(self, position_nd: NDArray[np.float64], box: Box) -> NDArray[np.float64]:
        """Return the positions moved back onto the links by the least displacement, to rounding."""
        position, lattice = position_nd.copy(), box.lattice_dd
        extent = max(float(np.abs(position).max()), float(np.abs(lattice).max()))
        rounding = 2.0 * np.finfo(np.float64).eps * extent / float(self._system.scale_r.min(initial=np.inf))
        reaffix_links(self._system, position, lattice, max(TIGHT, rounding), NEWTON)
        return position

    def project(
        self, position_nd: NDArray[np.float64], box: Box, force_nd: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the part of the forces that the links leave, and the (L,) tensions with which they bear the rest."""
        refill_links(self._system, position_nd, box.lattice_dd)
        left, tension = np.empty_like(force_nd), np.zeros(len(self.links))
        project_links(self._system, force_nd, left, tension, True)
        return left, tension


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
    box, links = packing.box.scaled(factor), packing.links
    if links is None:
        return packing.replace(position_nd=packing.position_nd * factor, box=box)
    offset, winding = image_offsets(links, packing.particles)
    cluster = links.clusters(packing.particles)
    count = np.bincount(cluster)
    apart = offset @ packing.box.lattice_dd.T
    place = packing.position_nd + apart
    center = np.stack([np.bincount(cluster, place[:, a]) / count for a in range(packing.dimension)], axis=1)[cluster]
    moved = np.where(winding[:, None], place * factor, place + (factor - 1.0) * center)
    position = moved - offset @ box.lattice_dd.T
    return packing.replace(position_nd=Tether(packing).affixed(position, box), box=box)
