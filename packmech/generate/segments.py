# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds placed one by one in a plane, none of which may cross another: a grid of segments, over all images."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.compiled import kernel

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
