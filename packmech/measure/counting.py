"""Counts: packing fraction and coordination number."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.check import instance, one_of, warn
from packmech.contacts.fused_volume import shared_volume
from packmech.contacts.shape_contacts import touching_pairs
from packmech.measure.rattlers import find_rattlers
from packmech.packing import Packing, no_tangential

# overlaps of less than this part of the contact distance are rounding [1]
_ROUNDING = 1e-9


@honors("links shapes", packing_only=True)
def packing_fraction(packing: Packing) -> float:
    """Return the volume of the particles over that of the box [1], rattlers included.

    Fused particles fill their union: those that overlap within a rigid cluster, and linked ones. What particles share
    that touch counts for each of them, as is usual at a finite pressure: this is the sum of all volumes over that of
    the box unless links are shorter than the sum of the radii. It depends on radii, links and box only, and falls as
    volume^-1 where the box grows between particles or clusters that keep their shape.

    Exact in two dimensions, and in three where no three particles are all fused with each other; else the error is
    below 1e-10 of a particle's volume in each particle's part.

    Parameters
    ----------
    packing
        The packing.

    Examples
    --------
    >>> import packmech as pm
    >>> round(pm.packing_fraction(pm.lattice_packing("triangular", repeats=(1, 1))), 6)
    0.9069
    >>> links = pm.Links([0], [1], [[0, 0]], [1.0])
    >>> dimer = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [1.0, 1.0], pm.Box.cubic(10.0, 2), links)
    >>> round(100.0 * pm.packing_fraction(dimer), 6)  # 4 pi / 3 + sqrt(3) / 2
    5.054816

    """
    instance("packing", packing, Packing)
    unit = math.pi if packing.dimension == 2 else 4.0 * math.pi / 3.0
    volume = unit * (packing.radius_n**packing.dimension).sum() - shared_volume(packing)
    return float(volume / packing.box.volume)


def mean_contacts(contacts: int, rattlers: int, particles: int) -> float:
    """Return 2 N_c / N' of N_c contacts between the particles that do not rattle [1]; 0 where all do."""
    held = particles - rattlers
    return 2.0 * contacts / held if held else 0.0


def mean_of_moving(count_n: NDArray[np.int64], rattler_n: NDArray[np.bool_], held_n: NDArray[np.bool_] | None) -> float:
    """Return the mean of (N,) numbers of contacts over particles that neither rattle nor are held [1]; 0 without any.

    Those of a pile are its grains, not those that its floor is made of.
    """
    counted = ~rattler_n if held_n is None else ~rattler_n & ~held_n
    return float(count_n[counted].mean()) if counted.any() else 0.0


@honors("links shapes", packing_only=True)
def coordination_number(packing: Packing, *, gap_tolerance: float | None = None, rattlers: str = "remove") -> float:
    """Return the mean number of contacts of a particle, 2 N_c / N' [1], in the periodic box.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    rattlers
        "remove" leaves rattlers and their contacts out of N' and N_c; "keep" counts everything. Where particles that
        overlap all rattle, which is 0, a UserWarning says so: they are not at rest, or friction, weights or walls hold
        them, which a packing does not know.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.coordination_number(pm.lattice_packing("fcc", repeats=(2, 2, 2)), gap_tolerance=1e-9)
    12.0

    """
    instance("packing", packing, Packing)
    no_tangential("packing", packing)
    one_of("rattlers", rattlers, ("remove", "keep"))
    contacts = touching_pairs(packing, gap_tolerance)
    if rattlers == "keep":
        return 2.0 * len(contacts) / packing.particles
    rattling = find_rattlers(packing, gap_tolerance=gap_tolerance)
    kept = int((~rattling).sum())
    if not kept:
        overlapping = int((contacts.overlap_c > _ROUNDING * contacts.contact_distance_c).sum())
        if overlapping:
            warn(
                f"packing should be at rest, got {overlapping} pairs that overlap and no particle that they hold: all "
                "rattle; relax it first, by pm.quench; where friction, weights or walls hold it, "
                'pm.contact_forces(scene) tells; rattlers="keep" counts all contacts',
            )
        return 0.0
    return 2.0 * len(contacts.among(~rattling)) / kept
