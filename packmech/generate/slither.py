"""Open chains in a plane that slither out of rows: how long ones get in at high density without crossing.

A chain moves by losing a bead at one end and growing one at the other (the slithering snake of Wall and Mandel, 1975);
it goes on in one direction until it finds no room, then in the other.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from packmech.box import Box
from packmech.generate.segments import Bonds
from packmech.generate.walks import PROPOSALS, Point, Walk, minus, plus, unit

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
