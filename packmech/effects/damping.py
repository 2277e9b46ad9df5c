"""Damping of the relative motion of touching particles."""

from __future__ import annotations

from typing import NamedTuple

from packmech.effects.pair import effect

# how a dashpot sets in, and the relative overlap at which half of it acts
ONSETS = {"jump": 0.0, "smooth": 0.01}


class _ContactDamping(NamedTuple):
    coefficient: float = 0.1
    # a name in files and calls, a number in every record
    onset: float | str = 0.0


@effect
class ContactDamping(_ContactDamping):
    """A dashpot along the line of centers of touching pairs: force = -coefficient * s(xi) * d(distance)/dt.

    The damping term of equation 2.3 of Schreck and O'Hern (2010); it conserves momentum.

    Parameters
    ----------
    coefficient
        Of the dashpot [mass/time].
    onset
        "jump": the whole dashpot acts as soon as particles touch, s = 1 (the usual linear dashpot). Its force
        jumps as a contact opens or closes, which leaves every integrator at first order there. "smooth": it grows with
        the relative overlap xi = 1 - r/sigma, s = xi / (xi + onset), half of it at an overlap of 0.01; forces are then
        continuous and velocity Verlet of second order across openings and closings. Or another overlap than 0.01 (0 is
        "jump").

    Examples
    --------
    >>> ContactDamping(0.2, onset="smooth")
    ContactDamping(coefficient=0.2, onset=0.01)
    >>> round(ContactDamping(0.2, onset="smooth").pair_first(0.99, 1.0, 1.0), 12)
    0.1

    """

    damps_only = True

    def __new__(cls, coefficient: float = 0.1, onset: float | str = "jump") -> ContactDamping:
        """Return the record; compiled loops take numbers, so that an onset by name becomes one."""
        if isinstance(onset, str):
            if onset not in ONSETS:
                raise ValueError(f"onset must be one of {', '.join(map(repr, ONSETS))} or an overlap, got {onset!r}")
            onset = ONSETS[onset]
        return super().__new__(cls, coefficient, onset)

    def pair_first(self, distance: float, contact_distance: float, rate: float) -> float:
        """Return the radial derivative that stands for the dashpot [force]."""
        onset = float(self.onset)
        if onset == 0.0:
            return self.coefficient * rate
        overlap = (contact_distance - distance) / contact_distance
        return self.coefficient * rate * overlap / (overlap + onset)
