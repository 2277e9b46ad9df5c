"""Avalanches: falls of a sheared packing to another equilibrium, where they are and what they moved."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.measure.displacements import Displacements, LocalStrain, displacements, local_strain
from packmech.measure.rattlers import find_rattlers
from packmech.packing import Packing


@shown()
@dataclass(frozen=True)
class Avalanche:
    """A fall to another equilibrium at a strain where the packing becomes unstable.

    Attributes
    ----------
    strain, width
        The strain of the equilibrium after the fall, and how far before it the last one before is [1].
    energy_drop
        Energy (with a pressure held, energy + pressure * volume) that is freed [energy_scale].
    stress_drop
        Shear stress before less that after it [energy_scale / diameter^d].
    contacts_opened, contacts_closed
        How many contacts are lost and won.
    plastic
        Whether it is irreversible: sheared back by `width`, particles that are no rattlers do not come to within a
        hundredth of what the fall moved them by, at the root mean square.
    before, after
        The packings at both ends of `width`, in boxes whose lattice vectors were sheared along.

    """

    strain: float
    width: float
    energy_drop: float
    stress_drop: float
    contacts_opened: int
    contacts_closed: int
    plastic: bool
    before: Packing = dataclasses.field(repr=False, compare=False)
    after: Packing = dataclasses.field(repr=False, compare=False)

    @cached_property
    def displacements(self) -> Displacements:
        """How particles moved, as by `pm.displacements`."""
        return displacements(self.before, self.after)

    @cached_property
    def local_strain(self) -> LocalStrain:
        """The strain and D2min of each neighborhood, as by `pm.local_strain`."""
        return local_strain(self.before, self.after)

    @cached_property
    def rattler_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that rattle before and after, which the next two leave out."""
        return find_rattlers(self.before) & find_rattlers(self.after)

    @property
    def participation_number(self) -> float:
        """The number of particles that took part, (sum u^2)^2 / sum u^4 of nonaffine displacements about their mean."""
        moved_nd = self.displacements.nonaffine_nd[~self.rattler_n]
        square_n = ((moved_nd - moved_nd.mean(axis=0)) ** 2).sum(axis=1)
        return float(square_n.sum() ** 2 / (square_n**2).sum())

    @cached_property
    def particle(self) -> int:
        """The particle of largest D2min, where the avalanche is."""
        d2min_n = np.nan_to_num(self.local_strain.d2min_n, nan=-1.0)
        return int(np.argmax(np.where(self.rattler_n, -2.0, d2min_n)))
