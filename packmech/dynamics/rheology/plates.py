"""Rough plates: particles at both ends of a cell that are held, and move with it as the plates of a rheometer do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import instance, integer, positive
from packmech.packing import Packing, without_links

# part of the height by which other lattice vectors may stand out of the plates' plane
_FLAT = 1e-9


def height_across(box: Box, axis: int) -> float | None:
    """Return the height of a box along an axis that all but one of its vectors are across; None if there is no such."""
    row = np.abs(box.lattice_dd[axis])
    out = row > _FLAT * row.max()
    return float(row.max()) if np.count_nonzero(out) == 1 else None


def rough_plates(packing: Packing, *, layer: str | float = "crossing", axis: int = 1) -> NDArray[np.bool_]:
    """Return which particles rough plates at both ends of the cell would hold: (N,) for held_n of what strains a scene.

    The ends are the faces of the cell across `axis`. Held particles follow the box, so that the plates slide past each
    other as it is sheared; nothing pushes or turns them. Who is free stays free (particleShear goes on catching
    particles for ever, section 7 of the corrected specification).

    Parameters
    ----------
    packing
        The packing, without rigid links; all its lattice vectors but one must lie across the axis.
    layer
        "crossing": who reaches across an end, y < r or y > H - r. Or a thickness [length]: whose center is nearer than
        that to an end.
    axis
        Normal of the plates.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, the box has no such ends, or there are no particles for both plates and between them.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(60, dimension=2, packing_fraction=0.9, seed=1)
    >>> held = rough_plates(packing)
    >>> run = pm.simulate(pm.Scene(packing, (pm.Repulsion(),)), steps=3, held_n=held)
    >>> bool(np.array_equal(run.packing.position_nd[held], packing.position_nd[held]))
    True

    """
    instance("packing", packing, Packing)
    without_links("packing", packing)
    axis = integer("axis", axis, at_least=0, at_most=packing.dimension - 1)
    if layer == "crossing":
        reach = packing.radius_n
    elif isinstance(layer, str):
        raise ValueError(f"layer must be 'crossing' or a thickness, got {layer!r}")
    else:
        reach = np.full(packing.particles, positive("layer", layer))
    height = height_across(packing.box, axis)
    if height is None:
        raise ValueError(f"packing must have a box whose vectors but one are across axis {axis}, got others")
    at = np.mod(packing.position_nd[:, axis], height)
    low, high = at < reach, at > height - reach
    if (low & high).any():
        raise ValueError(f"layer must leave room between the plates, got {layer!r} in a height of {height:g}")
    if not low.any() or not high.any() or (low | high).all():
        count = int(np.count_nonzero(low)), int(np.count_nonzero(high))
        raise ValueError(
            f"layer must hold particles at both ends and leave some free, got {layer!r} that holds {count[0]} and "
            f"{count[1]} of {packing.particles}"
        )
    return np.asarray(low | high)
