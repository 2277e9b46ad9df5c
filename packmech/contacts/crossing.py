"""Links that cross in two dimensions: a test of segments over all periodic images."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import ANY_LENGTH, honors
from packmech.check import instance
from packmech.contacts.network import candidate_pairs
from packmech.links import Links
from packmech.packing import Packing

# midpoints this little beyond reach (relative) are tested too, so that rounding loses no pair that just touches
_SLACK = 1e-9


@shown()
@dataclass(frozen=True, eq=False)
class Crossings:
    """Pairs of links that cross, each once, sorted by (first, second, image).

    Parameters
    ----------
    first_c, second_c
        (C,) places of the two links in ``packing.links``; first < second.
    image_cd
        (C, d) the image of the second link that crosses the first: its ends moved by lattice @ image, for the
        positions as they stand.
    point_cd
        (C, d) where they cross [length], on the first link as it stands.

    """

    first_c: NDArray[np.int64]
    second_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    point_cd: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.first_c)


@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def crossing_links(packing: Packing) -> Crossings:
    """Return the pairs of links that cross, over all periodic images; bonds only, in two dimensions.

    A link is the segment between its two beads. Links that hold an angle or a shape (``shape_l``) are no bonds and
    cross what they like; two links that end on the same bead, at the same image, do not count; an end that lies on
    another link does. Parallel links never cross.

    Parameters
    ----------
    packing
        The packing, in two dimensions; without links nothing crosses.

    Raises
    ------
    TypeError, ValueError
        If it is no packing, or a packing in three dimensions, where links do not cross.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    >>> position = [[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0]]
    >>> found = pm.crossing_links(pm.Packing(position, [0.5] * 4, pm.Box.cubic(4.0, 2), links))
    >>> found.first_c.tolist(), found.second_c.tolist(), found.point_cd.tolist()
    ([0], [1], [[0.5, 0.5]])

    """
    instance("packing", packing, Packing)
    if packing.dimension != 2:
        raise ValueError(f"packing must have two dimensions for links to cross, got {packing.dimension}")
    return find_crossings(packing.position_nd, packing.box, packing.links)


def find_crossings(position_nd: NDArray[np.float64], box: Box, links: Links) -> Crossings:
    """Return the pairs of bonds that cross; see ``crossing_links``."""
    bond = np.flatnonzero(~links.shape_l)
    if not len(bond):
        return _sorted(bond, bond, np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)))
    i_l, j_l, image_ld = links.i_l[bond], links.j_l[bond], links.image_ld[bond]
    start_ld = position_nd[i_l]
    along_ld = position_nd[j_l] - start_ld + np.einsum("de,le->ld", box.lattice_dd, image_ld)
    half_l = 0.5 * np.sqrt((along_ld**2).sum(axis=1))
    # beads that lie on each other make a link of no length; the search of pairs wants sizes above zero
    half_l = np.maximum(half_l, 1e-9 * (half_l.max() or box.height_d.min()))
    # two segments can only meet where their midpoints are no further apart than half the sum of their lengths
    pairs = candidate_pairs(start_ld + 0.5 * along_ld, half_l, box, scale=1.0 + _SLACK)
    a, b, shift = pairs.i_c, pairs.j_c, pairs.image_cd
    keep = a != b
    for one, one_image in ((i_l, None), (j_l, image_ld)):
        for other, other_image in ((i_l, None), (j_l, image_ld)):
            apart = shift if other_image is None else shift + other_image[b]
            apart = apart if one_image is None else apart - one_image[a]
            keep &= (one[a] != other[b]) | apart.any(axis=1)
    a, b, shift = a[keep], b[keep], shift[keep]
    gap_cd = start_ld[b] + np.einsum("de,ce->cd", box.lattice_dd, shift) - start_ld[a]
    turn = _cross(along_ld[a], along_ld[b])
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = _cross(gap_cd, along_ld[b]) / turn, _cross(gap_cd, along_ld[a]) / turn
    meet = (turn != 0) & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
    a, b, shift, s = a[meet], b[meet], shift[meet], s[meet]
    return _sorted(bond[a], bond[b], shift, start_ld[a] + s[:, None] * along_ld[a])


def _cross(a_cd: NDArray[np.float64], b_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    turn: NDArray[np.float64] = a_cd[:, 0] * b_cd[:, 1] - a_cd[:, 1] * b_cd[:, 0]
    return turn


def _sorted(
    first_c: NDArray[np.int64], second_c: NDArray[np.int64], image_cd: NDArray[np.int64], point_cd: NDArray[np.float64]
) -> Crossings:
    order = np.lexsort((*image_cd.T[::-1], second_c, first_c))
    return Crossings(first_c[order], second_c[order], image_cd[order], point_cd[order])


class NearLinks(NamedTuple):
    """Pairs of bonds near each other that share no particle at the same image; `image_cd` is that of the second."""

    first_c: NDArray[np.int64]
    second_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]


def near_links(packing: Packing, reach: float) -> NearLinks:
    """Return the pairs of bonds, by their places in the packing's links, no further apart than a reach [length].

    Pairs a little further apart may be among them.
    """
    links = packing.links
    bond = np.flatnonzero(~links.shape_l)
    start_ld, along_ld = _segments(packing, bond)
    half_l = 0.5 * np.sqrt((along_ld**2).sum(axis=1)) + 1e-300
    pairs = candidate_pairs(start_ld + 0.5 * along_ld, half_l, packing.box, scale=1.0 + _SLACK, skin=reach)
    a, b, shift = pairs.i_c, pairs.j_c, pairs.image_cd
    keep = a != b
    ends = [(links.i_l[bond], None), (links.j_l[bond], links.image_ld[bond])]
    for one, one_image in ends:
        for other, other_image in ends:
            apart = shift if other_image is None else shift + other_image[b]
            apart = apart if one_image is None else apart - one_image[a]
            keep &= (one[a] != other[b]) | apart.any(axis=1)
    return NearLinks(bond[a[keep]], bond[b[keep]], shift[keep])


def _segments(packing: Packing, link: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where links start and their vectors."""
    links = packing.links
    start = packing.position_nd[links.i_l[link]]
    end = packing.position_nd[links.j_l[link]] + links.image_ld[link] @ packing.box.lattice_dd.T
    return start, end - start


def link_ends(packing: Packing, near: NearLinks) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return for both ends of both links of each pair, (4, C, 2), their place from the other link, and its vector."""
    a_start, a_along = _segments(packing, near.first_c)
    b_start, b_along = _segments(packing, near.second_c)
    b_start = b_start + near.image_cd @ packing.box.lattice_dd.T
    place = np.stack([a_start - b_start, a_start + a_along - b_start, b_start - a_start, b_start + b_along - a_start])
    return place, np.stack([b_along, b_along, a_along, a_along])


def swept_links(before: Packing, after: Packing, near: NearLinks) -> NDArray[np.bool_]:
    """Return which pairs of links sweep through each other while particles and box go straight to another packing.

    Two segments begin or cease to cross only when an end of one lies on the other: the two roots of a quadratic in
    time are looked at for all four ends. Images are those of the positions as they stand in both packings.
    """
    place, along = link_ends(before, near)
    place_after, along_after = link_ends(after, near)
    move, turn = place_after - place, along_after - along
    shape = place.shape[:2]

    def cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
        return _cross(one.reshape(-1, 2), other.reshape(-1, 2)).reshape(shape)

    c, b, a = cross(place, along), cross(move, along) + cross(place, turn), cross(move, turn)
    swept = np.zeros(shape, dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b**2 - 4.0 * a * c)
        q = -0.5 * (b + np.where(b < 0.0, -root, root))
        for time in (q / a, c / q):
            there, vector = place + time[:, :, None] * move, along + time[:, :, None] * turn
            share = (there * vector).sum(axis=2) / (vector**2).sum(axis=2)
            inside = (share >= -_SLACK) & (share <= 1.0 + _SLACK)
            swept |= (time >= -_SLACK) & (time <= 1.0 + _SLACK) & inside
    return np.asarray(swept.any(axis=0))
