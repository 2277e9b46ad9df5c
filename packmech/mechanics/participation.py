"""How many particles take part in a normal mode."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.honors import honors
from packmech.mechanics.modes import Modes
from packmech.packing import Packing


@honors("links shapes", packing_only=True)
def participation_ratio(packing: Packing, modes: Modes) -> NDArray[np.float64]:
    """Return the (M,) participation ratios of normal modes: (sum of e)^2 / (N' sum of e^2) [1].

    e is the mass of a particle times the squares of its displacement and of its turns, angles times radii of gyration:
    its share of the mode's kinetic energy. 1 where all N' particles that take part move alike, 1/N' where one moves
    alone, 2/3 for a standing wave.

    Parameters
    ----------
    packing
        The packing.
    modes
        Its modes, by `normal_modes`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the modes are those of another packing.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4))
    >>> modes = pm.normal_modes(pm.Scene(crystal, (pm.Repulsion(),)))
    >>> ratio = pm.participation_ratio(crystal, modes)
    >>> len(ratio), bool(((ratio > 1.0 / 16.0) & (ratio <= 1.0 + 1e-12)).all())
    (30, True)

    """
    instance("packing", packing, Packing)
    instance("modes", modes, Modes)
    if modes.displacement_mnd.shape[1:] != packing.position_nd.shape:
        raise ValueError(
            f"modes must be those of the packing, of {packing.position_nd.shape} coordinates, got "
            f"{modes.displacement_mnd.shape[1:]}"
        )
    square = (modes.displacement_mnd**2).sum(axis=2) + (modes.turn_mnk**2).sum(axis=2)
    energy = packing.mass_n * square
    return np.asarray(energy.sum(axis=1) ** 2 / (len(modes.index_n) * (energy**2).sum(axis=1)))
