"""Repulsion of overlapping particles by a law of the distance."""

from __future__ import annotations

from typing import NamedTuple

from packmech.effects.laws import Harmonic, Law, law_energy, law_first, law_second
from packmech.effects.pair import effect
from packmech.effects.partners import Partners, passes_partners_on


@effect
@passes_partners_on
class Repulsion(NamedTuple):
    """Touching particles repel along the line of centers by the given law.

    Its law is checked when a `Scene` is made with it.
    """

    law: Law = Harmonic()

    def pair_energy(self, distance: float, partners: Partners) -> float:
        """Return the energy [energy]."""
        return law_energy(self.law, distance, partners)

    def pair_first(self, distance: float, partners: Partners) -> float:
        """Return du/dr [force]."""
        return law_first(self.law, distance, partners)

    def pair_second(self, distance: float, partners: Partners) -> float:
        """Return d2u/dr2 [force/length]."""
        return law_second(self.law, distance, partners)
