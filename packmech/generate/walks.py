"""Random walks without overlap: the backbones of chains."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.jit.compiled import kernel

# mypy: disable-error-code="no-untyped-def, no-untyped-call"


Point = tuple[float, ...]

# a segment reaches this little further than its ends (relative), so that rounding makes no new crossing later
_SLACK = 1e-9


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


class Bonds:
    """Bonds of a packing in the making, in two dimensions: whether a new one crosses any, and a list to take back from.

    Parameters
    ----------
    box
        The periodic box.
    most
        Number of bonds at the end.
    longest
        Length of the longest bond [length].

    """

    def __init__(self, box: Box, most: int, longest: float) -> None:
        small, change = box.reduced()
        self._to_small = np.rint(np.linalg.inv(change)).astype(np.int64).tolist()
        # cells at least as high as a bond is long, and not many more of them than bonds
        room = int(math.sqrt(most)) + 1
        cells = np.clip((small.height_d / longest).astype(np.int64), 1, room)
        reach = np.ceil(longest / (small.height_d / cells) * (1 + _SLACK)).astype(np.int64)
        self._grid = SegmentGrid(
            small.lattice_dd,
            small.inverse_dd,
            cells,
            reach,
            np.full(int(cells.prod()), -1),
            np.full(most, -1),
            np.zeros((most, 2)),
            np.zeros((most, 2)),
            np.zeros((most, 6), dtype=np.int64),
        )
        self._cells: list[int] = []

    def __len__(self) -> int:
        return len(self._cells)

    def place(self, first: int, second: int, start: Point, along: Point, image: tuple[int, ...] = ()) -> bool:
        """Place the bond from bead to bead and return True, or return False if it would cross one of the others."""
        if self.crosses(first, second, start, along, image):
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


def slither(walk: Walk, bonds: Bonds, count: int, box: Box, tries: int) -> list[Point] | None:
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


def _move(snake: _Snake, walk: Walk, bonds: Bonds) -> None:
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
