# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Chains of particles: how they grow, and packings of them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.status import shown_as
from packmech.check import (
    PARTICLE_BYTES,
    brief,
    finite_array,
    given_shape,
    integer,
    one_of,
    positive,
    positive_array,
    real,
)
from packmech.contacts.crossing import crossing_links
from packmech.contacts.fused_volume import lens, shared_volume
from packmech.generate.placed import Placed, checked_overlap
from packmech.generate.random import SizeDistribution, box_for, generator_of, shape_of, sizes_of, start_fraction
from packmech.jit.compiled import kernel
from packmech.links import Links, image_offsets
from packmech.packing import Packing, masses_of_density

Point = tuple[float, ...]
# a bond: the numbers of its beads, where it starts, its vector, and the image of its second bead (none: the first one)
Bond = tuple[int, int, Point, Point, tuple[int, ...]]
# what becomes of bonds that would cross, in two dimensions
CROSSING = ("avoided", "allowed")
# a segment reaches this little further than its ends (relative), so that rounding makes no new crossing later
_SLACK = 1e-9
# volumes that chains share count as equal up to this part of the box; how often chains may be drawn for it, and how
# often with the same random numbers
_SAME, _ANEW, _AGAIN = 1e-13, 100, 25


class SegmentGrid(NamedTuple):
    """Cells of a reduced box, each with a list of the segments whose middle lies in it; the last one placed first.

    start_ld is for the segment moved so that its middle is in the box; end_lk holds its two beads, the image of the
    second one, and the image by which it was moved.
    """

    lattice_dd: NDArray[np.float64]
    inverse_dd: NDArray[np.float64]
    cells_d: NDArray[np.int64]
    reach_d: NDArray[np.int64]
    head_g: NDArray[np.int64]
    next_l: NDArray[np.int64]
    start_ld: NDArray[np.float64]
    along_ld: NDArray[np.float64]
    end_lk: NDArray[np.int64]


@kernel
def _crosses(grid, first, second, image_x, image_y, x, y, along_x, along_y):
    """Return whether a bond from (x, y) crosses a placed one with which it shares no bead."""
    lattice, inverse = grid.lattice_dd, grid.inverse_dd
    middle_x, middle_y = x + 0.5 * along_x, y + 0.5 * along_y
    f0 = inverse[0, 0] * middle_x + inverse[0, 1] * middle_y
    f1 = inverse[1, 0] * middle_x + inverse[1, 1] * middle_y
    n0, n1 = grid.cells_d[0], grid.cells_d[1]
    c0, c1 = int(math.floor(f0 * n0)), int(math.floor(f1 * n1))
    for a0 in range(c0 - grid.reach_d[0], c0 + grid.reach_d[0] + 1):
        for a1 in range(c1 - grid.reach_d[1], c1 + grid.reach_d[1] + 1):
            q0, q1 = a0 // n0, a1 // n1
            k = grid.head_g[(a0 - q0 * n0) * n1 + a1 - q1 * n1]
            while k >= 0:
                end = grid.end_lk[k]
                # the image of the placed bond's first bead as it is met here
                z0, z1 = q0 - end[4], q1 - end[5]
                shared = (first == end[0] and z0 == 0 and z1 == 0) or (
                    first == end[1] and z0 + end[2] == 0 and z1 + end[3] == 0
                )
                shared = shared or (second == end[0] and z0 == image_x and z1 == image_y)
                shared = shared or (second == end[1] and z0 + end[2] == image_x and z1 + end[3] == image_y)
                if not shared:
                    gap_x = grid.start_ld[k, 0] + lattice[0, 0] * q0 + lattice[0, 1] * q1 - x
                    gap_y = grid.start_ld[k, 1] + lattice[1, 0] * q0 + lattice[1, 1] * q1 - y
                    u_x, u_y = grid.along_ld[k, 0], grid.along_ld[k, 1]
                    turn = along_x * u_y - along_y * u_x
                    if turn != 0.0:
                        s = (gap_x * u_y - gap_y * u_x) / turn
                        t = (gap_x * along_y - gap_y * along_x) / turn
                        if -_SLACK <= s <= 1 + _SLACK and -_SLACK <= t <= 1 + _SLACK:
                            return True
                k = grid.next_l[k]
    return False


@kernel
def _add(grid, place, first, second, image_x, image_y, x, y, along_x, along_y):
    """Place a bond as number ``place`` and return its cell."""
    inverse = grid.inverse_dd
    middle_x, middle_y = x + 0.5 * along_x, y + 0.5 * along_y
    f0 = inverse[0, 0] * middle_x + inverse[0, 1] * middle_y
    f1 = inverse[1, 0] * middle_x + inverse[1, 1] * middle_y
    n0, n1 = grid.cells_d[0], grid.cells_d[1]
    c0, c1 = int(math.floor(f0 * n0)), int(math.floor(f1 * n1))
    # the image follows from the cell, so that a middle on the face of the box is in one place only
    q0, q1 = c0 // n0, c1 // n1
    cell = (c0 - q0 * n0) * n1 + c1 - q1 * n1
    grid.start_ld[place, 0] = x - grid.lattice_dd[0, 0] * q0 - grid.lattice_dd[0, 1] * q1
    grid.start_ld[place, 1] = y - grid.lattice_dd[1, 0] * q0 - grid.lattice_dd[1, 1] * q1
    grid.along_ld[place, 0], grid.along_ld[place, 1] = along_x, along_y
    end = grid.end_lk[place]
    end[0], end[1], end[2], end[3], end[4], end[5] = first, second, image_x, image_y, q0, q1
    grid.next_l[place] = grid.head_g[cell]
    grid.head_g[cell] = place
    return cell


@kernel
def _remove(grid, place, cell):
    """Take a bond out of the list of its cell."""
    if grid.head_g[cell] == place:
        grid.head_g[cell] = grid.next_l[place]
        return
    k = grid.head_g[cell]
    while grid.next_l[k] != place:
        k = grid.next_l[k]
    grid.next_l[k] = grid.next_l[place]


class BondGrid:
    """Bonds of a packing in the making, in two dimensions: whether a new one crosses any, and a list to take back from.

    Parameters
    ----------
    box
        The periodic box.
    count
        Number of bonds at the end.
    longest
        Length of the longest bond [length].
    avoid
        Whether bonds are to avoid each other; if not, `place` admits all and keeps none, in three dimensions too.

    """

    def __init__(self, box: Box, count: int, longest: float, *, avoid: bool = True) -> None:
        self._avoid = avoid
        self._cells: list[int] = []
        if not avoid:
            return
        small, change = box.reduced()
        self._to_small = np.rint(np.linalg.inv(change)).astype(np.int64).tolist()
        # cells at least as high as a bond is long, and not many more of them than bonds
        room = int(math.sqrt(count)) + 1
        cells = np.clip((small.height_d / longest).astype(np.int64), 1, room)
        reach = np.ceil(longest / (small.height_d / cells) * (1 + _SLACK)).astype(np.int64)
        self._grid = SegmentGrid(
            small.lattice_dd,
            small.inverse_dd,
            cells,
            reach,
            np.full(int(cells.prod()), -1),
            np.full(count, -1),
            np.zeros((count, 2)),
            np.zeros((count, 2)),
            np.zeros((count, 6), dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self._cells)

    def place(self, bonds: Sequence[Bond]) -> bool:
        """Place bonds and return True, or place none and return False where one would cross another."""
        before = len(self)
        for first, second, start, along, image in bonds if self._avoid else ():
            if self.crosses(first, second, start, along, image):
                self.take_back(before)
                return False
            self.lay(first, second, start, along, image=image)
        return True

    def crosses(self, first: int, second: int, start: Point, along: Point, image: tuple[int, ...] = ()) -> bool:
        """Return whether the bond from bead to bead would cross one of the others."""
        return bool(_crosses(self._grid, *self._bond(first, second, start, along, image)))

    def lay(
        self, first: int, second: int, start: Point, along: Point, number: int = -1, image: tuple[int, ...] = ()
    ) -> int:
        """Place the bond whether it crosses others or not, as a new one or in the place of one lifted."""
        new = number < 0
        number = len(self._cells) if new else number
        cell = int(_add(self._grid, number, *self._bond(first, second, start, along, image)))
        if new:
            self._cells.append(cell)
        else:
            self._cells[number] = cell
        return number

    def lift(self, number: int) -> None:
        """Remove a bond, whose place ``lay`` is to fill."""
        _remove(self._grid, number, self._cells[number])

    def _bond(
        self, first: int, second: int, start: Point, along: Point, image: tuple[int, ...]
    ) -> tuple[int | float, ...]:
        (a, b), (c, d) = self._to_small
        z0, z1 = (a * image[0] + b * image[1], c * image[0] + d * image[1]) if image else (0, 0)
        return (first, second, z0, z1, start[0], start[1], along[0], along[1])

    def take_back(self, count: int) -> None:
        """Remove all bonds but the first ``count`` of them."""
        while len(self._cells) > count:
            cell = self._cells.pop()
            self._grid.head_g[cell] = self._grid.next_l[len(self._cells)]


# heights of the box that a link may be long where it is asked whether it crosses others
_BOXES = 100
# times that each chain moves by its own length, if it never turned around
_LENGTHS = 10
# share of the spacing of rows that a row may fill
_FILLED = 0.98
# proposals for a bead of a row: in a narrow strip few directions stay inside
_AHEAD = 300
# beads that a row steps back where it meets the edge of its strip
_BACK = 5


@dataclass
class _Snake:
    """A chain: places and numbers of its beads and numbers of its bonds, in order along it."""

    places: deque[Point]
    beads: deque[int]
    bonds: deque[int]

    def turn(self) -> None:
        """Exchange head and tail."""
        for part in (self.places, self.beads, self.bonds):
            part.reverse()


def slither(walk: Walk, bonds: BondGrid, count: int, box: Box, tries: int) -> list[Point] | None:
    """Return the places of all beads, chain after chain; None if chains bend too little to stay in rows.

    Chains start as random walks that go forward only, one behind the other in a strip that winds around the box: no
    walk leaves the strip or turns back, so none crosses another. Then they slither.

    Parameters
    ----------
    walk
        How chains bend.
    bonds
        The grid of bonds, with none in it.
    count
        Number of chains, of as many beads as the walk's plan says.
    box
        The periodic box.
    tries
        Number of proposals per bead for the rows.

    """
    rows = _strip(walk, count, box, tries)
    if rows is None:
        return None
    snakes, beads = [], walk.plan.beads
    for k, places in enumerate(rows):
        numbers = range(k * beads, (k + 1) * beads)
        slots = [bonds.lay(k * beads + b, k * beads + b + 1, places[b], minus(places[b + 1], places[b]))
                 for b in range(beads - 1)]  # fmt: skip
        snakes.append(_Snake(deque(places), deque(numbers), deque(slots)))
    for _ in range(_LENGTHS * beads):
        for snake in snakes:
            _move(snake, walk, bonds)
    return [place for snake in snakes for place in snake.places]


def _strip(walk: Walk, count: int, box: Box, tries: int) -> list[list[Point]] | None:
    """Return chains in a strip around the box with as few turns, each as wide, as they fit in."""
    first, second = (tuple(vector) for vector in box.reduced()[0].lattice_dd.T.tolist())
    left, share = tries * count * walk.plan.beads, 0.5
    while left > 0:
        needed = share * count * walk.plan.beads * walk.plan.link_length
        turns = 1
        while math.hypot(turns * first[0] + second[0], turns * first[1] + second[1]) < needed:
            turns += 1
        around = (turns * first[0] + second[0], turns * first[1] + second[1])
        end, along = math.hypot(*around), unit(around)
        half = 0.5 * _FILLED * box.volume / end
        rows: list[list[Point]] = []
        ahead = 0.0
        while len(rows) < count and left > 0:
            row, spent = _row(walk, ahead, half, left)
            left -= spent
            if row is None:
                return None
            ahead = row[-1][0] + 0.5 * walk.plan.link_length
            if ahead > end:
                break
            rows.append(row)
        else:
            if left > 0:
                return [[(x * along[0] - y * along[1], x * along[1] + y * along[0]) for x, y in row] for row in rows]
        share *= 1.2
    return None


def _row(walk: Walk, ahead: float, half: float, most: int) -> tuple[list[Point] | None, int]:
    """Return a walk forward along x from ``ahead`` on, within ``half`` of the axis; and the proposals made."""
    places: list[Point] = [(ahead, 0.0)]
    spent = 0
    while len(places) < walk.plan.beads:
        here = places[-1]
        for _ in range(_AHEAD):
            spent += 1
            step = walk.bent(unit(minus(here, places[-2]))) if len(places) > 1 else (1.0, 0.0)
            place = (here[0] + walk.plan.link_length * step[0], here[1] + walk.plan.link_length * step[1])
            if step[0] > 0 and abs(place[1]) < half:
                places.append(place)
                break
        else:
            del places[max(1, len(places) - _BACK) :]
        if spent >= most:
            return None, spent
    return places, spent


def _move(snake: _Snake, walk: Walk, bonds: BondGrid) -> None:
    """Move a chain by one bead, or turn it around where it finds no room."""
    head, bead, slot = snake.places[-1], snake.beads[0], snake.bonds[0]
    inward = unit(minus(head, snake.places[-2]))
    bonds.lift(slot)
    for _ in range(PROPOSALS):
        step = tuple(walk.plan.link_length * x for x in walk.bent(inward))
        if not bonds.crosses(snake.beads[-1], bead, head, step):
            bonds.lay(snake.beads[-1], bead, head, step, slot)
            snake.places.popleft()
            snake.places.append(plus(head, step))
            snake.beads.rotate(-1)
            snake.bonds.rotate(-1)
            return
    bonds.lay(snake.beads[0], snake.beads[1], snake.places[0], minus(snake.places[1], snake.places[0]), slot)
    snake.turn()


# proposals for one bead before the walk steps back; share of all proposals that one chain may use
PROPOSALS = 20
_SHARE = 0.2
# share of the spare length of a closed chain that each part of it must leave to the rest
_SPARE = 0.2
# bends that are held keep this far from straight (relative to the largest) and from folding back [rad]
_STRAIGHT, _FOLD = 1e-3, 1e-3
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Chain:
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

    def __init__(self, plan: Chain, rng: np.random.Generator, bonds: BondGrid, placed: Placed) -> None:
        self.plan, self._rng, self._bonds, self._placed = plan, rng, bonds, placed
        # the earlier beads of its chain that each bead is linked to
        self._linked_b: list[list[int]] = [[] for _ in range(plan.beads)]
        for i, j, _ in [*_bonds(plan), *(_angle_pairs(plan) if plan.held else [])]:
            self._linked_b[max(i, j)].append(min(i, j))
        reach = math.sqrt(math.fsum(x * x for x in plan.around))
        self._left = 0
        self._spare = plan.beads * plan.link_length - reach

    def grow(self, count: int, box: Box, tries: int) -> list[Point] | None:
        """Return the places of all beads of that many chains; None if they find no room in ``tries`` tries per bead.

        Where one chain finds no room, all are grown again: their earlier turns leave it none.
        """
        self._left = tries * count * self.plan.beads
        most = max(PROPOSALS, int(_SHARE * self._left))
        while self._left > 0:
            places: list[Point] = []
            self._bonds.take_back(0)
            self._placed.take_back(0)
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
        before = len(self._bonds)
        stop = max(0, self._left - most)
        places = self._first(lattice, first, stop)
        if not places:
            return None
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
            self._placed.take_back(first + len(places))
            if not places:
                places, longest, back = self._first(lattice, first, stop), 1, 1
                if not places:
                    return None
            self._bonds.take_back(before + len(places) - 1)
        return places

    def _first(self, lattice_dd: list[list[float]], first: int, stop: int) -> list[Point]:
        """Return the place of the first bead of a chain; none where no place is found before the tries are used up."""
        while True:
            place = self._start(lattice_dd)
            if self._placed.admits_next(place, ()):
                self._placed.add(np.array([place]))
                return [place]
            self._left -= 1
            if self._left <= stop:
                return []

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
        linked = [first + bead for bead in self._linked_b[len(places)]]
        if not self._placed.admits_next(place, linked) or not self._bonds.place(self._bonds_to(places, place, first)):
            return False
        self._placed.add(np.array([place]))
        return True

    def _bonds_to(self, places: list[Point], place: Point, first: int) -> list[Bond]:
        """Return the bonds that the next bead closes."""
        bead, plan = len(places), self.plan
        parent = plan.parent_b[bead]
        bonds: list[Bond] = [(first + parent, first + bead, places[parent], minus(place, places[parent]), ())]
        if plan.closing is not None and bead == plan.beads - 1:
            along = minus(plus(places[0], plan.around), place)
            bonds.append((first + bead, first, place, along, plan.closing))
        return bonds

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


FORMS = ("open", "ring", "wound")
_ANGLES = ("free", "fixed")

# shorter links, in the largest radius, are lost in the rounding of positions
_SHORTEST_LINK = 1e-12
# heights of the box that a chain may reach: packings count images up to twice as many
_FARTHEST = 2.0**30

# links cannot hold angles of chains that bend less [rad]
_MINIMUM_BEND = 1e-6

# a pair of beads within a chain: first, second, and the image of the second
_Pair = tuple[int, int, tuple[int, ...]]


@shown_as("growing chains")
def chain_packing(
    count: int,
    beads: int,
    *,
    dimension: int,
    packing_fraction: float,
    link_length: float = 1.0,
    radii: ArrayLike | None = None,
    sizes: SizeDistribution | ArrayLike | None = None,
    angles: str | ArrayLike = "free",
    bend: float = 2.0 * math.pi / 3.0,
    form: str | Sequence[int] = "open",
    winding: Sequence[int] | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    box: Box | ArrayLike | None = None,
    crossing: str = "avoided",
    largest_overlap: float | None = None,
    tries: int = 200,
    density: float | None = None,
) -> Packing:
    """Return chains grown as random walks from independent uniform places, at the packing fraction asked for.

    Beads overlap at random, as particles do in ``random_packing``, unless ``largest_overlap`` is given. In two
    dimensions bonds do not cross: a chain steps back and grows another way where it finds no room. Open chains that
    find none at all, because long walks lock themselves in, start in rows instead (where overlaps do not matter) and
    slither out of them for ten times their own length; they keep some of the rows' direction (nematic order of bonds
    about 0.3 for chains of 100 discs, 0.5 for 400, at a packing fraction of 0.9). Closed and branched ones, and those
    with angles given, then want a lower packing fraction. The particles of a chain follow each other.

    Parameters
    ----------
    count, beads
        Number of chains, and of beads in each.
    dimension
        2 (discs) or 3 (spheres).
    packing_fraction
        Area or volume of all chains over that of the box [1]. Neighbors along a chain fill their union where links are
        shorter than the sum of their radii, and so do all beads of a chain that is rigid, as in ``packing_fraction``.
        Where held angles decide on overlaps the box is scaled after the chains have grown, and chains grow again where
        bonds would then cross.
    link_length
        Length of the bonds [length].
    radii
        Radius of all beads, or (beads,) along each chain, or (count * beads,) of all particles [length]; 0.5 when
        nothing is said.
    sizes
        Instead of ``radii``: a distribution from which the radii of all beads are drawn, in random order.
    angles
        ``"free"``: bonds only. ``"fixed"``: the angles between successive bonds are held as they came out, by a link
        between next neighbors but one along the chain (``shape_l``); dihedral angles stay free in three dimensions. A
        number or (beads - 2,) of them: the angles [rad] of an open chain, held; above 0 and below pi, because links
        cannot hold three beads on a line. No link is redundant: at a branch, and where a ring closes, only as many
        links are made as hold all angles.
    bend
        Largest angle between a bond and the one before it at the start, 0 for straight on [rad]; uniform below it
        (in three dimensions uniform over that cap of the sphere). The default keeps touching next neighbors but one
        from overlapping; 0.01 makes nearly straight chains.
    form
        ``"open"``; ``"ring"``: the last bead is linked to the first; ``"wound"``: it is linked to an image of the
        first, so that the chain winds around the box; or, for branched chains, the bead that each bead but the first
        follows: (0, 0, 0) is a star with three arms, (0, 1, 1) a fork.
    winding
        (d,) the image of the first bead that a wound chain ends at; one box along the first lattice vector when
        nothing is said.
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    box
        Shape of the box, a ``Box`` or (d, d) lattice vectors as columns; its size is set by the packing fraction.
        Square or cubic when nothing is said.
    crossing
        ``"avoided"`` or ``"allowed"``: whether bonds may cross in two dimensions. In three, chains of spheres that do
        not overlap cannot pass through each other while every link is shorter than sqrt(2) times the smallest
        diameter: two links at right angles through each other's middle have their beads 1/sqrt(2) of a link apart.
        Longer links, and overlaps deeper than 1 - link / (sqrt(2) diameter), let them pass, and this is not reported.
    largest_overlap
        Largest overlap of two beads that no link joins, relative to the sum of their radii [1]; None: any.
    tries
        Number of proposals per bead, on average, before giving up.
    density
        Mass over area, or over volume in space, of every bead [mass/length^d]; as of a `Packing` unless given.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what was given; also where a chain finds no room in ``tries`` tries.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.chain_packing(1, 30, dimension=2, packing_fraction=0.9, angles="fixed", seed=1)
    >>> len(packing.links), int(packing.links.shape_l.sum()), len(pm.crossing_links(packing))
    (57, 28, 0)

    """
    count = integer("count", count, at_least=1, bytes_each=PARTICLE_BYTES)
    beads = integer("beads", beads, at_least=2, bytes_each=count * PARTICLE_BYTES)
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    packing_fraction = start_fraction(packing_fraction)
    link_length = positive("link_length", link_length)
    parent_b, closing = _form(form, winding, beads, dimension)
    bend = real("bend", bend, at_least=0.0, at_most=math.pi)
    held, bend_b = _angles(angles, bend, beads, form)
    rng = generator_of(seed, rng)
    shape_dd = shape_of(box, dimension)
    one_of("crossing", crossing, CROSSING)
    overlap = checked_overlap(largest_overlap)
    tries = integer("tries", tries, at_least=1)
    radius_n = _radius_n(radii, sizes, count, beads, rng)
    largest = float(radius_n.max())
    if link_length < _SHORTEST_LINK * largest:
        raise ValueError(
            f"link_length must be at least {_SHORTEST_LINK:g} of the largest radius {largest:g}, got {link_length:g}"
        )
    # radii that no box can hold are refused here; the box itself follows once it is known what beads share
    box_for(radius_n, packing_fraction, shape_dd)

    avoid = dimension == 2 and crossing == "avoided"
    bond = [(a, b) for a, b, _ in _bonds(Chain(dimension, parent_b, link_length, bend, held, bend_b, closing, ()))]
    shared = math.fsum(
        lens(dimension == 2, first, second, link_length)
        for radius_b in radius_n.reshape(count, beads).tolist()
        for first, second in ((radius_b[a], radius_b[b]) for a, b in bond)
    )
    state = rng.bit_generator.state
    for number in range(_ANEW):
        # a chain around the box changes with it: the same random numbers, again, until it fits the box
        if closing is not None and any(closing) and number % _AGAIN:
            rng.bit_generator.state = state
        state = rng.bit_generator.state
        scaled = box_for(radius_n, packing_fraction, shape_dd, shared)
        boxes = _BOXES if avoid else _FARTHEST / beads
        longest = boxes * float(scaled.reduced()[0].height_d.min())
        if link_length > longest:
            raise ValueError(
                f"link_length must be at most {longest:.4g}, {boxes:g} heights of the box"
                f"{', where links must not cross' if avoid else ''}, got {link_length:g}"
            )
        around = () if closing is None else tuple(np.einsum("de,e->d", scaled.lattice_dd, np.array(closing)).tolist())
        reach = math.sqrt(math.fsum(x * x for x in around))
        if reach >= beads * link_length:
            least = math.floor(reach / link_length) + 1
            raise ValueError(f"beads must be at least {least} for a chain to reach around the box, got {beads}")
        plan = Chain(dimension, parent_b, link_length, bend, held, bend_b, closing, around)
        slithers = avoid and largest_overlap is None and isinstance(form, str) and form == "open" and bend_b is None
        placed = Placed(scaled, radius_n, overlap)
        packing = _grown(plan, count, radius_n, scaled, placed, rng, avoid=avoid, slithers=slithers, tries=tries)
        packing = packing.replace(mass_n=masses_of_density(density, radius_n, dimension))
        found = shared_volume(packing)
        if abs(found - shared) <= _SAME * scaled.volume:
            return packing.wrapped()
        shared = found
        if closing is None or not any(closing):
            fitted = _spread(packing, box_for(radius_n, packing_fraction, shape_dd, shared))
            if not (avoid and len(crossing_links(fitted))):
                return fitted
    raise ValueError(
        "packing_fraction must be lower, or crossing 'allowed', or links longer where held angles let beads of a chain "
        f"overlap, got {packing_fraction:g} and no box that chains drawn {_ANEW} times would fill"
    )


def _grown(
    plan: Chain,
    count: int,
    radius_n: NDArray[np.float64],
    box: Box,
    placed: Placed,
    rng: np.random.Generator,
    *,
    avoid: bool,
    slithers: bool,
    tries: int,
) -> Packing:
    """Return chains grown in a box."""
    bonds = BondGrid(box, count * len(_bonds(plan)), plan.link_length, avoid=avoid)
    walk = Walk(plan, rng, bonds, placed)
    places = walk.grow(count, box, max(1, tries // 10) if slithers else tries)
    if places is None and slithers:
        bonds.take_back(0)
        places = slither(walk, bonds, count, box, tries)
    if places is None:
        raise ValueError(
            "bend must be larger, or crossing 'allowed', or largest_overlap larger, or the packing fraction lower "
            f"where a chain finds no way, got bend = {plan.bend:g} and no way in {tries} tries per bead"
        )
    position_nd, image_nd = _folded(places, plan, box)
    return Packing(position_nd, radius_n, box, _links(plan, count, position_nd, image_nd, box))


def _spread(packing: Packing, box: Box) -> Packing:
    """Return the packing with its box, and the centers of its chains, scaled to another box of the same shape."""
    links = packing.links
    offset, _ = image_offsets(links, packing.particles)
    apart = np.einsum("de,ne->nd", packing.box.lattice_dd, offset)
    cluster = links.clusters(packing.particles)
    size, place = np.bincount(cluster), packing.position_nd + apart
    center = np.stack([np.bincount(cluster, place[:, a]) / size for a in range(packing.dimension)], axis=1)
    further = (box.volume / packing.box.volume) ** (1.0 / packing.dimension) - 1.0
    position = packing.position_nd + further * (center[cluster] - apart)
    return packing.replace(position_nd=position, box=box).wrapped()


def _form(form: Any, winding: Any, beads: int, dimension: int) -> tuple[tuple[int, ...], tuple[int, ...] | None]:
    """Return the bead that each bead follows, -1 for the first, and the image at which the chain closes."""
    if winding is not None and not (isinstance(form, str) and form == "wound"):
        raise ValueError(f"winding must be left out unless form is 'wound', got {brief(winding)}")
    if isinstance(form, str) or not hasattr(form, "__len__"):
        one_of("form", form, FORMS)
        row = tuple(range(-1, beads - 1))
        if form == "open":
            return row, None
        if beads < 3:
            raise ValueError(f"beads must be at least 3 for a chain that closes, got {beads}")
        if form == "ring":
            return row, (0,) * dimension
        image = [1] + [0] * (dimension - 1) if winding is None else winding
        whole = finite_array("winding", image, shape=(dimension,), what="")
        if (whole != np.rint(whole)).any() or not whole.any():
            raise ValueError(f"winding must be whole numbers, not all 0, got {brief(image)}")
        return row, tuple(int(z) for z in whole)
    if len(form) != beads - 1:
        raise ValueError(f"form must name a bead for each bead but the first ({beads - 1}), got {len(form)}")
    follows = [integer(f"form[{k}]", bead, at_least=0, at_most=k) for k, bead in enumerate(form)]
    return (-1, *follows), None


def _angles(angles: Any, bend: float, beads: int, form: Any) -> tuple[bool, tuple[float, ...] | None]:
    """Return whether the angles are held, and the prescribed bend at each bead, if any."""
    if isinstance(angles, str):
        held = one_of("angles", angles, _ANGLES) == "fixed"
        if held and bend < _MINIMUM_BEND:
            raise ValueError(f"bend must be at least 1e-6 for angles that links can hold, got {bend:g}")
        return held, None
    if not (isinstance(form, str) and form == "open"):
        raise ValueError(f"angles must be 'free' or 'fixed' unless form is 'open', got {brief(angles)}")
    given = np.full(max(beads - 2, 1), positive("angles", angles)) if not given_shape(angles) else angles
    checked = positive_array("angles", given, shape=(None,), what="angle")
    if given_shape(angles) and len(checked) != beads - 2:
        raise ValueError(f"angles must have one entry per inner bead ({beads - 2}), got {len(checked)}")
    straight = np.abs(checked - math.pi / 2) > math.pi / 2 - 1e-6
    if straight.any():
        k = int(np.flatnonzero(straight)[0])
        raise ValueError(f"angles must be at least 1e-6 away from 0 and pi, got {checked[k]:g} for angle {k}")
    return True, (0.0, *(math.pi - checked).tolist(), 0.0)


def _radius_n(
    radii: ArrayLike | None, sizes: Any, count: int, beads: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    if sizes is not None:
        if radii is not None:
            raise ValueError(f"radii must be left out when sizes are given, got {brief(radii)}")
        return np.asarray(rng.permutation(sizes_of(sizes, sizes).radii(count * beads, rng)))
    if radii is None or not given_shape(radii):
        return np.full(count * beads, 0.5 if radii is None else positive("radii", radii))
    checked = positive_array("radii", radii, shape=(None,))
    if len(checked) not in (beads, count * beads):
        raise ValueError(
            f"radii must be one number, one for each bead of a chain ({beads}) or of all ({count * beads}), got "
            f"{len(checked)}"
        )
    return checked if len(checked) == count * beads else np.tile(checked, count)


def _bonds(plan: Chain) -> list[_Pair]:
    here = (0,) * plan.dimension
    pairs: list[_Pair] = [(plan.parent_b[k], k, here) for k in range(1, plan.beads)]
    return pairs if plan.closing is None else [*pairs, (plan.beads - 1, 0, plan.closing)]


def _angle_pairs(plan: Chain) -> list[_Pair]:
    """Return the pairs whose distances hold all angles, as many as that takes."""
    d, n = plan.dimension, plan.beads
    here = (0,) * d
    if plan.closing is None:
        near: list[list[int]] = [[] for _ in range(n)]
        for k in range(1, n):
            near[plan.parent_b[k]].append(k)
            near[k].append(plan.parent_b[k])
        # m bonds from one bead have m - 1 angles in a plane and 2 m - 3 in space: each to the first, or first two
        return [(min(a, b), max(a, b), here) for one in near for m, b in enumerate(one) for a in one[: min(m, d - 1)]]
    pairs: list[_Pair] = [(k, k + 2, here) for k in range(n - 2)] + [(n - 2, 0, plan.closing), (n - 1, 1, plan.closing)]
    # a ring turns as a whole; a chain around the box turns about the way it winds, which takes three dimensions
    rotations = (d - 1) * (d - 2) // 2 if any(plan.closing) else d * (d - 1) // 2
    return pairs[: max(0, d * n - d - rotations - n)]


def _folded(places: list[tuple[float, ...]], plan: Chain, box: Box) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return positions in the cell, and the images by which they were moved there.

    Each link is laid off again from where the one before ends in the cell, so that chains that lead far away lose no
    digits to the size of their coordinates.
    """
    free = np.array(places).reshape(-1, plan.beads, plan.dimension)
    position, image = np.empty_like(free), np.zeros(free.shape, dtype=np.int64)
    position[:, 0], image[:, 0] = box.wrap(free[:, 0])
    last = plan.beads if plan.closing is None else plan.beads - 1
    for bead in range(1, plan.beads):
        parent = plan.parent_b[bead]
        step = free[:, bead] - free[:, parent]
        if bead < last:
            step *= plan.link_length / np.sqrt(np.add.reduce(step**2, axis=1))[:, None]
        position[:, bead], moved = box.wrap(position[:, parent] + step)
        image[:, bead] = image[:, parent] + moved
    return position.reshape(-1, plan.dimension), image.reshape(-1, plan.dimension)


def _links(plan: Chain, count: int, position_nd: NDArray[np.float64], image_nd: NDArray[np.int64], box: Box) -> Links:
    bonds = _bonds(plan)
    pairs = bonds + (_angle_pairs(plan) if plan.held else [])
    shape = np.tile(np.arange(len(pairs)) >= len(bonds), count)
    step = np.repeat(plan.beads * np.arange(count), len(pairs))
    i = np.tile([pair[0] for pair in pairs], count) + step
    j = np.tile([pair[1] for pair in pairs], count) + step
    image = np.tile(np.array([pair[2] for pair in pairs]), (count, 1)) + image_nd[j] - image_nd[i]
    vector = position_nd[j] - position_nd[i] + np.einsum("de,le->ld", box.lattice_dd, image)
    length = np.where(shape, np.sqrt(np.add.reduce(vector**2, axis=1)), plan.link_length)
    return Links(i, j, image, length, shape)
