"""Damping of the relative motion of touching particles."""

from __future__ import annotations

from typing import NamedTuple

from packmech.effects.pair import effect


@effect
class ContactDamping(NamedTuple):
    """A dashpot along the line of centers of touching pairs: force = -coefficient * d(distance)/dt.

    The damping term of equation 2.3 of Schreck and O'Hern; it conserves momentum. `coefficient` is [mass/time].
    """

    coefficient: float = 0.1

    def pair_first(self, distance: float, contact_distance: float, rate: float) -> float:
        """Return the radial derivative that stands for the dashpot [force]."""
        return self.coefficient * rate
