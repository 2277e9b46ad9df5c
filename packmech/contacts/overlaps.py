"""How far particles of a packing overlap, over all pairs: what a packing of hard particles is judged by."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import candidate_pairs
from packmech.contacts.shape_contacts import touching_pairs
from packmech.packing import Packing

# hard particles overlap by no more than this, over the contact distance; roundings of positions that also count
HARD = 1e-12
_ROUNDINGS = 8.0


class Overlap(NamedTuple):
    """The largest overlap of a packing over the contact distance [1], and the pair (i, j, image) that has it."""

    relative: float
    pair: tuple[int, ...]

    def __str__(self) -> str:
        i, j, *image = self.pair
        across = f" across the box {image}" if any(image) else ""
        return f"particles {i} and {j}{across} overlap by {self.relative:.1e} of their contact distance"


def largest_overlap(packing: Packing, counted_n: NDArray[np.bool_] | None = None) -> Overlap | None:
    """Return the largest overlap over all pairs and images; None where no particles overlap.

    Parameters
    ----------
    packing
        The packing, with shapes or links or without; pairs that a link joins do not count.
    counted_n
        (N,) particles whose pairs alone count, such as the rattlers. All unless given.

    """
    near = touching_pairs(packing)
    overlap = near.overlap_c
    if counted_n is not None:
        overlap = np.where(counted_n[near.i_c] | counted_n[near.j_c], overlap, 0.0)
    if not (overlap > 0.0).any():
        return None
    c = int(np.argmax(overlap))
    return Overlap(float(overlap[c]), (int(near.i_c[c]), int(near.j_c[c]), *near.image_cd[c].tolist()))


def overlap_of_hard(packing: Packing) -> Overlap | None:
    """Return the largest overlap of a packing that is to be hard; None where none is beyond 1e-12, or rounding.

    Parameters
    ----------
    packing
        The packing.

    """
    allowed = max(HARD, _ROUNDINGS * packing.rounding)
    if packing.plain:
        # touching pairs are not even listed: one compiled search
        pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0 - allowed)
        if not len(pairs.i_c):
            return None
    found = largest_overlap(packing)
    return None if found is None or found.relative <= allowed else found
