"""Laws of the frictional model: repulsion that diverges or yields in between, and tension that saturates.

Those of particleShear (Braschler, 2021), whose equations are S1-n. A law here may say with `fault`
which of its numbers is out of bounds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.check import brief
from packmech.effects.laws import Law, LinearSpring, law, law_energy, law_first, law_second
from packmech.effects.partners import Partners, passes_partners_on

# below this slope a plateau's energy is a power series of the slope, as a quotient would lose its digits
_FLAT = 1e-5
# stretches over reach below which tension's energy is a power series
_SHORT = 0.5
# overlaps below which the divergent law's energy is a power series
_SHALLOW = 0.1


@law
class DivergentRepulsion(NamedTuple):
    """Force k (1 - c) (sigma - r) + k c sigma (sigma/r - 1), and no more than cap k sigma.

    The linear law S1-5a and the divergent one S1-5b, blended by the divergence c; both have the stiffness k at contact.
    The limit is S1-6 itself, 1000 k sigma, where the package stops at 999 k sigma for c = 1: the force is constant from
    the distance where it first reaches the limit down to the center, and the energy rises linearly there.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    stiffness
        k [energy/length^2].
    divergence
        c, from 0 (linear) to 1 [1].
    cap
        Largest force over k sigma, at least 1 [1].

    Examples
    --------
    >>> law = DivergentRepulsion(stiffness=2.0)
    >>> -law.first(15.0, 20.0), -law.first(0.0, 20.0)
    (13.333333333333332, 40000.0)

    """

    stiffness: float = 1.0
    divergence: float = 1.0
    cap: float = 1000.0

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        if not 0.0 <= self.divergence <= 1.0:
            return f"divergence must be from 0 to 1, got {brief(self.divergence)}"
        return "" if self.cap >= 1.0 else f"cap must be at least 1, got {brief(self.cap)}"

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        c = self.divergence
        s = distance / contact_distance
        # r/sigma at the cap, the root of (1 - c) s^2 + (cap + 2 c - 1) s - c
        b = self.cap + 2.0 * c - 1.0
        least = 2.0 * c / (b + math.sqrt(b * b + 4.0 * (1.0 - c) * c)) if c > 0.0 else 0.0
        at = max(s, least)
        overlap = (contact_distance - max(distance, least * contact_distance)) / contact_distance
        diverging = 0.0
        if c > 0.0:
            # -ln(1 - xi) - xi loses digits for small overlaps, its series xi^2/2 + xi^3/3 + ... does not
            if overlap < _SHALLOW:
                for k in range(18, 1, -1):
                    diverging = diverging * overlap + 1.0 / k
                diverging *= overlap * overlap
            else:
                diverging = -math.log1p(-overlap) - overlap
        own = 0.5 * (1.0 - c) * overlap * overlap + c * diverging
        return self.stiffness * contact_distance * contact_distance * (own + self.cap * (at - s))

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        c = self.divergence
        overlap = contact_distance - distance
        limit = self.cap * contact_distance
        # compared before the division, so that coincident centers push with the limit
        if c > 0.0 and (1.0 - c) * overlap * distance + c * contact_distance * overlap >= limit * distance:
            return -self.stiffness * limit
        blend = 1.0 - c
        if c > 0.0:
            blend += c * contact_distance / distance
        return -self.stiffness * blend * overlap

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]; 0 at the cap."""
        c = self.divergence
        overlap = contact_distance - distance
        limit = self.cap * contact_distance
        if c > 0.0 and (1.0 - c) * overlap * distance + c * contact_distance * overlap >= limit * distance:
            return 0.0
        steeper = 0.0
        if c > 0.0:
            ratio = contact_distance / distance
            steeper = c * ratio * ratio
        return self.stiffness * (1.0 - c + steeper)


@law
@passes_partners_on
class PlateauRepulsion(NamedTuple):
    """Another law's force, with a plateau between two distances: sponge-like particles.

    The force at r is the other law's at the distance m(r): m = r from `end` sigma on; from `end` down to `begin` m
    falls with the given slope, so that the force rises by that much more slowly; below `begin` it falls in proportion
    to r, to 0 at the center. The package's `elastic_force_law_plateau`; a slope of 1 is the other law. The energy is
    the integral of this force.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    begin, end
        Over the contact distance, 0 < begin <= end <= 1 [1].
    slope
        Of the plateau against no plateau, from 0 (flat) to 1 [1].
    law
        The other law.

    Examples
    --------
    >>> from packmech.effects.partners import equal_partners
    >>> law = PlateauRepulsion(law=LinearSpring(1.0))
    >>> [round(-law.first(r, equal_partners(1.0)), 12) for r in (0.9, 0.8, 0.3)]
    [0.1, 0.2, 0.25]

    """

    begin: float = 0.3
    end: float = 0.8
    slope: float = 0.1
    law: Law = LinearSpring()

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        if not 0.0 < self.begin <= 1.0:
            return f"begin must be above 0 and at most 1, got {brief(self.begin)}"
        if not self.begin <= self.end <= 1.0:
            return f"end must be at least begin and at most 1, got {brief(self.end)}"
        return "" if self.slope <= 1.0 else f"slope must be at most 1, got {brief(self.slope)}"

    def energy(self, distance: float, partners: Partners) -> float:
        """Return the energy [energy]."""
        begin, end = self.begin * partners.contact_distance, self.end * partners.contact_distance
        if distance >= end:
            return law_energy(self.law, distance, partners)
        lowest = end + (begin - end) * self.slope
        at = max(distance, begin)
        energy = law_energy(self.law, end, partners)
        if self.slope < _FLAT:
            across = end - at
            energy -= law_first(self.law, end, partners) * across
            energy += 0.5 * law_second(self.law, end, partners) * self.slope * across * across
        else:
            mapped = end + (at - end) * self.slope
            energy += (law_energy(self.law, mapped, partners) - energy) / self.slope
        if distance < begin:
            pace = lowest / begin
            deeper = law_energy(self.law, distance * pace, partners)
            energy += (deeper - law_energy(self.law, lowest, partners)) / pace
        return energy

    def first(self, distance: float, partners: Partners) -> float:
        """Return du/dr [energy/length]."""
        begin, end = self.begin * partners.contact_distance, self.end * partners.contact_distance
        mapped = distance
        if distance < begin:
            mapped = distance / begin * (end + (begin - end) * self.slope)
        elif distance < end:
            mapped = end + (distance - end) * self.slope
        return law_first(self.law, mapped, partners)

    def second(self, distance: float, partners: Partners) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        begin, end = self.begin * partners.contact_distance, self.end * partners.contact_distance
        mapped, pace = distance, 1.0
        if distance < begin:
            pace = (end + (begin - end) * self.slope) / begin
            mapped = distance * pace
        elif distance < end:
            pace = self.slope
            mapped = end + (distance - end) * self.slope
        return pace * law_second(self.law, mapped, partners)


@law
class ExponentialTension(NamedTuple):
    """Pull k q sigma (1 - exp(-(r - sigma)/(q sigma))), which saturates; for bonds longer than their rest length sigma.

    The package's undocumented exponential option. At its rest length it is as stiff as a spring of stiffness k; no
    stretch pulls harder than k q sigma.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    stiffness
        k [energy/length^2].
    fraction
        q, the reach of the linear part over the rest length [1].

    Examples
    --------
    >>> pull = ExponentialTension(2.0, 0.2)
    >>> round(pull.first(1.001, 1.0), 6), round(pull.first(9.0, 1.0), 6)
    (0.001995, 0.4)

    """

    stiffness: float = 1.0
    fraction: float = 0.2

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        return "" if self.fraction > 0.0 else f"fraction must be positive, got {brief(self.fraction)}"

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        reach = self.fraction * contact_distance
        t = (distance - contact_distance) / reach
        # t + exp(-t) - 1 loses digits for small t, its series t^2/2! - t^3/3! + ... does not
        if abs(t) < _SHORT:
            bracket = 0.0
            for k in range(18, 2, -1):
                bracket = (1.0 - bracket) * t / k
            bracket = 0.5 * t * t * (1.0 - bracket)
        else:
            bracket = t + math.expm1(-t)
        return self.stiffness * reach * reach * bracket

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        reach = self.fraction * contact_distance
        return -self.stiffness * reach * math.expm1((contact_distance - distance) / reach)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        return self.stiffness * math.exp((contact_distance - distance) / (self.fraction * contact_distance))
