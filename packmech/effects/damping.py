"""Damping of the relative motion of touching particles."""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.check import brief
from packmech.effects.kinds import ByKind, largest_number, number_at
from packmech.effects.pair import TouchingPair, effect

# how a dashpot sets in, and the relative overlap at which half of it acts
ONSETS = {"jump": 0.0, "smooth": 0.01}


class _ContactDamping(NamedTuple):
    coefficient: float | ByKind = 0.1
    # a name in files and calls, a number in every record
    onset: float | str = 0.0


@effect
class ContactDamping(_ContactDamping):
    """A dashpot along the line of centers of touching pairs: force = -coefficient * s(xi) * d(distance)/dt.

    The damping term of equation 2.3 of Schreck and O'Hern (2010); it conserves momentum.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    coefficient
        Of the dashpot [mass/time], or `ByKind`, of walls `PerKind`.
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
    >>> pair = TouchingPair(0.99, 1.0, rate=1.0, energy=0.0, first=0.0, second=0.0, mass=1.0, effective_radius=0.25)
    >>> round(ContactDamping(0.2, onset="smooth").pair_damping(pair), 12)
    0.1

    """

    def __new__(cls, coefficient: float | ByKind = 0.1, onset: float | str = "jump") -> ContactDamping:
        """Return the record; compiled loops take numbers, so that an onset by name becomes one."""
        if isinstance(onset, str):
            if onset not in ONSETS:
                raise ValueError(
                    f"onset must be one of {', '.join(map(repr, ONSETS))} or an overlap, got {brief(onset)}"
                )
            onset = ONSETS[onset]
        return super().__new__(cls, coefficient, onset)

    def pair_damping(self, pair: TouchingPair) -> float:
        """Return the coefficient at this overlap [mass/time]."""
        onset, coefficient = float(self.onset), float(number_at(self.coefficient, pair.kinds))
        if onset == 0.0:
            return coefficient
        overlap = (pair.contact_distance - pair.distance) / pair.contact_distance
        return coefficient * overlap / (overlap + onset)


@effect
class Restitution(NamedTuple):
    """A dashpot that takes the same share of the speed from every head-on collision: e = speed after / speed before.

    Its coefficient is c = 2 zeta sqrt(m) |u'| / sqrt(2 u), with the energy u of the contact, the reduced mass m of the
    pair and zeta = -ln(e) / sqrt(pi^2 + ln(e)^2). In y = sqrt(2 u) every law is a linear spring then,
    m v dv/dy + 2 zeta sqrt(m) v + y = 0, so that e holds exactly for any law that repels, any masses, radii and speeds.
    For a linear spring c is constant; for Hertz contacts it is the form of Tsuji, Tanaka and Ishida (Powder Technol. 71
    (1992) 239), with the value of Antypov and Elliott (EPL 94 (2011) 50004). The contact lasts until the particles
    part: shortly before, the dashpot holds them back. Where forces attract, and u is not positive, there is none.

    A collision is head-on where friction takes no part in it. In contacts of more than two particles each dashpot is
    that of its pair alone.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    coefficient
        e, above 0 and at most 1 [1], or `ByKind`, of walls `PerKind`.

    Examples
    --------
    >>> spring = TouchingPair(0.9, 1.0, -1.0, 0.5 * 4.0 * 0.1**2, -0.4, 4.0, mass=0.5, effective_radius=0.25)
    >>> round(Restitution(0.5).pair_damping(spring), 12)  # 2 zeta sqrt(m k)
    0.609395264474

    """

    coefficient: float | ByKind = 0.9

    def fault(self) -> str:
        """Return what is wrong with the number; nothing is, where it is empty."""
        within = 0.0 < largest_number(self.coefficient) <= 1.0
        return "" if within else f"coefficient must be above 0 and at most 1, got {brief(self.coefficient)}"

    def pair_damping(self, pair: TouchingPair) -> float:
        """Return the coefficient of the dashpot [mass/time]."""
        if not pair.energy > 0.0:
            return 0.0
        lost = -math.log(number_at(self.coefficient, pair.kinds))
        ratio = lost / math.sqrt(math.pi * math.pi + lost * lost)
        return 2.0 * ratio * abs(pair.first) * math.sqrt(0.5 * pair.mass / pair.energy)


@effect
class ViscoelasticDamping(NamedTuple):
    """The dashpot of a viscous material: c = time u'', with the stiffness u'' of the contact.

    For Hertz contacts these are the viscoelastic spheres of Kuwabara and Kono (Jpn. J. Appl. Phys. 26 (1987) 1230) and
    of Brilliantov, Spahn, Hertzsch and Pöschel (Phys. Rev. E 53 (1996) 5382), whose A is the time. Slow collisions take
    a smaller share of the speed than fast ones: `coefficient_of_restitution` says how much is left, `viscoelastic_time`
    gives the time for it.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    time
        How long stresses last that a strain leaves in the material [time], or `ByKind`, of walls `PerKind`.

    """

    time: float | ByKind = 0.1

    def pair_damping(self, pair: TouchingPair) -> float:
        """Return the coefficient of the dashpot [mass/time]."""
        return float(number_at(self.time, pair.kinds)) * abs(pair.second)
