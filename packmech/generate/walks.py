"""Random walks of fixed step: how one chain grows, bead by bead, with steps back where it finds no room."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from packmech.box import Box
from packmech.generate.segments import Bonds

Point = tuple[float, ...]

# proposals for one bead before the walk steps back; share of all proposals that one chain may use
PROPOSALS = 20
_SHARE = 0.2
# share of the spare length of a closed chain that each part of it must leave to the rest
_SPARE = 0.2
# bends that are held keep this far from straight (relative to the largest) and from folding back [rad]
_STRAIGHT, _FOLD = 1e-3, 1e-3
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Plan:
    """How a chain is joined and bent.

    parent_b holds the bead each bead follows (-1 for the first); bend is the largest angle between a link and the one
    before it [rad], bend_b the angles themselves where they are prescribed; closing is the image of the first bead
    that the last one is linked to, by the lattice vector around.
    """

    dimension: int
    parent_b: tuple[int, ...]
    link_length: float
    bend: float
    held: bool = False
    bend_b: tuple[float, ...] | None = None
    closing: tuple[int, ...] | None = None
    around: Point = ()

    @property
    def beads(self) -> int:
        """Number of beads."""
        return len(self.parent_b)


class Walk:
    """Chains of one plan, grown one after another; in two dimensions their bonds avoid each other where asked for."""

    def __init__(self, plan: Plan, rng: np.random.Generator, bonds: Bonds | None) -> None:
        self.plan, self._rng, self._bonds = plan, rng, bonds
        reach = math.sqrt(math.fsum(x * x for x in plan.around))
        self._left = 0
        self._spare = plan.beads * plan.link_length - reach

    def grow(self, count: int, box: Box, tries: int) -> list[Point] | None:
        """Return the places of all beads of that many chains; None if they find no room in ``tries`` tries per bead.

        Where one chain finds no room, all are grown anew: their earlier turns leave it none.
        """
        self._left = tries * count * self.plan.beads
        most = max(PROPOSALS, int(_SHARE * self._left))
        while self._left > 0:
            places: list[Point] = []
            if self._bonds is not None:
                self._bonds.take_back(0)
            for _ in range(count):
                chain = self._chain(len(places), box, most)
                if chain is None:
                    break
                places += chain
            else:
                return places
        return None

    def _chain(self, first: int, box: Box, most: int) -> list[Point] | None:
        """Return the places of the beads of a chain whose first particle has this number."""
        lattice = box.lattice_dd.tolist()
        before = 0 if self._bonds is None else len(self._bonds)
        stop = max(0, self._left - most)
        places = [self._start(lattice)]
        longest, back = 1, 1
        while len(places) < self.plan.beads:
            if self._extend(places, first):
                if len(places) > longest:
                    longest, back = len(places), 1
                continue
            if self._left <= stop:
                return None
            del places[max(0, len(places) - back) :]
            back *= 2
            if not places:
                places, longest, back = [self._start(lattice)], 1, 1
            if self._bonds is not None:
                self._bonds.take_back(before + len(places) - 1)
        return places

    def _start(self, lattice_dd: list[list[float]]) -> Point:
        fraction = self._rng.random(self.plan.dimension).tolist()
        return tuple(math.fsum(a * f for a, f in zip(row, fraction, strict=True)) for row in lattice_dd)

    def _extend(self, places: list[Point], first: int) -> bool:
        """Add a bead, if one of some proposals fits."""
        last = len(places) == self.plan.beads - 1 and self.plan.closing is not None
        for _ in range(PROPOSALS):
            self._left -= 1
            place = self._last(places) if last else self._next(places)
            if place is not None and self._join(places, place, first):
                places.append(place)
                return True
        return False

    def _join(self, places: list[Point], place: Point, first: int) -> bool:
        if self._bonds is None:
            return True
        bead, plan = len(places), self.plan
        parent = plan.parent_b[bead]
        before = len(self._bonds)
        if not self._bonds.place(first + parent, first + bead, places[parent], minus(place, places[parent])):
            return False
        if plan.closing is None or bead < plan.beads - 1:
            return True
        along = minus(plus(places[0], plan.around), place)
        if self._bonds.place(first + bead, first, place, along, plan.closing):
            return True
        self._bonds.take_back(before)
        return False

    def _next(self, places: list[Point]) -> Point | None:
        plan, bead = self.plan, len(places)
        parent = plan.parent_b[bead]
        here = places[parent]
        if parent == 0:
            along = self._any_direction()
        else:
            bend = None if plan.bend_b is None else plan.bend_b[parent]
            along = self.bent(unit(minus(here, places[plan.parent_b[parent]])), bend)
        place = tuple(x + plan.link_length * u for x, u in zip(here, along, strict=True))
        if plan.closing is not None:
            # what is left of the chain must reach the end, with a share of its length to spare
            rest = plan.beads - bead
            reach = rest * (plan.link_length - _SPARE * self._spare / plan.beads)
            if math.dist(place, plus(places[0], plan.around)) > reach:
                return None
        return place

    def _last(self, places: list[Point]) -> Point | None:
        """Return a place at link length from the bead before and from the end of the chain."""
        plan, here = self.plan, places[-1]
        end = plus(places[0], plan.around)
        apart = minus(end, here)
        distance = math.sqrt(math.fsum(x * x for x in apart))
        if not 0.0 < distance < 2.0 * plan.link_length:
            return None
        aside = self._perpendicular(unit(apart))
        height = math.sqrt(plan.link_length**2 - 0.25 * distance**2)
        place = tuple(x + 0.5 * a + height * u for x, a, u in zip(here, apart, aside, strict=True))
        steps = [
            unit(step)
            for step in (
                minus(here, places[-2]), minus(place, here), minus(end, place), minus(places[1], places[0])
            )
        ]  # fmt: skip
        low, high = self._bends()
        for one, other in zip(steps, steps[1:], strict=False):
            bend = _angle(one, other)
            if not low <= bend <= high + _ROUNDING:
                return None
        return place

    def _bends(self) -> tuple[float, float]:
        bend = self.plan.bend
        return (_STRAIGHT * bend, min(bend, math.pi - _FOLD)) if self.plan.held else (0.0, bend)

    def bent(self, along: Point, given: float | None = None) -> Point:
        """Return a direction at a random bend from another one, uniform within the largest bend; or at the given."""
        low, high = self._bends()
        bend = given
        while bend is None:
            share = self._rng.random()
            # uniform in the angle in a plane, uniform over the cap of the sphere in space
            drawn = share * high if len(along) == 2 else 2.0 * math.asin(math.sqrt(share) * math.sin(0.5 * high))
            bend = drawn if drawn >= low else None
        aside = self._perpendicular(along)
        c, s = math.cos(bend), math.sin(bend)
        return unit(tuple(c * x + s * y for x, y in zip(along, aside, strict=True)))

    def _any_direction(self) -> Point:
        turn = 2.0 * math.pi * self._rng.random()
        if self.plan.dimension == 2:
            return (math.cos(turn), math.sin(turn))
        z = 2.0 * self._rng.random() - 1.0
        r = math.sqrt(1.0 - z * z)
        return unit((r * math.cos(turn), r * math.sin(turn), z))

    def _perpendicular(self, along: Point) -> Point:
        """Return a random direction at right angles: one of two, or any around the axis."""
        if len(along) == 2:
            side = 1.0 if self._rng.random() < 0.5 else -1.0
            return (-side * along[1], side * along[0])
        x, y, z = along
        # the axis that lies least along
        least = min(range(3), key=lambda k: abs(along[k]))
        one = unit(((0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0))[least])
        other = (y * one[2] - z * one[1], z * one[0] - x * one[2], x * one[1] - y * one[0])
        turn = 2.0 * math.pi * self._rng.random()
        c, s = math.cos(turn), math.sin(turn)
        return tuple(c * a + s * b for a, b in zip(one, other, strict=True))


def plus(a: Point, b: Point) -> Point:
    """Return the sum."""
    return tuple(x + y for x, y in zip(a, b, strict=True))


def minus(a: Point, b: Point) -> Point:
    """Return the first less the second."""
    return tuple(x - y for x, y in zip(a, b, strict=True))


def unit(a: Point) -> Point:
    """Return the direction."""
    size = math.sqrt(math.fsum(x * x for x in a))
    return tuple(x / size for x in a)


def _angle(a: Point, b: Point) -> float:
    """Return the angle between two directions [rad], exact for small ones too."""
    return 2.0 * math.atan2(math.dist(a, b), math.sqrt(math.fsum(x * x for x in plus(a, b))))
