"""Packing fraction and coordination number."""

from __future__ import annotations

import math

from packmech.check import instance, one_of
from packmech.contacts import find_contacts
from packmech.measure.rattlers import find_rattlers
from packmech.packing import Packing


def packing_fraction(packing: Packing) -> float:
    """Return the sum of the particles' volumes over the box volume [1], rattlers included, overlaps counted twice.

    Parameters
    ----------
    packing
        The packing.

    Examples
    --------
    >>> import packmech as pm
    >>> round(pm.packing_fraction(pm.lattice_packing("triangular", repeats=(1, 1))), 6)
    0.9069

    """
    instance("packing", packing, Packing)
    unit = math.pi if packing.dimension == 2 else 4.0 * math.pi / 3.0
    return float(unit * (packing.radius_n**packing.dimension).sum() / packing.box.volume)


def coordination_number(packing: Packing, *, gap_tolerance: float = 0.0, rattlers: str = "remove") -> float:
    """Return the mean number of contacts of a particle, 2 N_c / N' [1], in the periodic box.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.
    rattlers
        "remove" leaves rattlers and their contacts out of N' and N_c; "keep" counts everything.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.coordination_number(pm.lattice_packing("fcc", repeats=(2, 2, 2)), gap_tolerance=1e-9)
    12.0

    """
    instance("packing", packing, Packing)
    one_of("rattlers", rattlers, ("remove", "keep"))
    contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
    if rattlers == "keep":
        return 2.0 * len(contacts) / packing.particles
    rattling = find_rattlers(packing, gap_tolerance=gap_tolerance)
    kept = int((~rattling).sum())
    if not kept:
        return 0.0
    return 2.0 * int((~rattling[contacts.i_c] & ~rattling[contacts.j_c]).sum()) / kept
