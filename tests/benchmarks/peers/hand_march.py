# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Sheared discs stepped by loops written by hand for one combination of effects each, from bench_march.py's starts.

Linear springs, dashpots, capped tangential springs and bonds, velocity Verlet with trapezoidal stretches, the box
sheared as x = x0 + gamma y0 up to gamma = 1/2. One row of eight numbers a particle (x, y, vx, vy, spin, radius, 1/m,
1/I), one flat list of pairs with neighbor and image in one word, remade when a pair might be missing from it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts.cells import find_pairs, frame_of, size_levels
from packmech.jit.compiled import device, kernel


class Bonded(NamedTuple):
    """Bonds between rows, with images, rest lengths and stretches."""

    i_b: NDArray[np.int64]
    j_b: NDArray[np.int64]
    image_bd: NDArray[np.float64]
    rest_b: NDArray[np.float64]
    stretch_b: NDArray[np.float64]


@device
def shear_rows(row, push, half, low, high, dt, rate):
    """Kick by half a step and move to its end; return the largest displacement."""
    dg = rate * dt
    most = 0.0
    for i in range(low, high):
        u, v, w = row[i, 2], row[i, 3], row[i, 4]
        kick = 0.5 * dt * row[i, 6]
        p, q = u + kick * push[i, 0], v + kick * push[i, 1]
        o = w + 0.5 * dt * row[i, 7] * push[i, 2]
        mx, my = dt * p, dt * q
        row[i, 0] += dg * row[i, 1] + mx
        row[i, 1] += my
        half[i, 0] = p - dg * q
        half[i, 1] = q
        half[i, 2] = o
        s, t = 2.0 * p - u, 2.0 * q - v
        row[i, 2] = s - dg * t
        row[i, 3] = t
        row[i, 4] = 2.0 * o - w
        push[i, 0] = 0.0
        push[i, 1] = 0.0
        push[i, 2] = 0.0
        most = max(most, mx * mx + my * my)
    return math.sqrt(most)


@device
def finish_rows(row, push, half, dt):
    """Kick by the other half of a step."""
    for i in range(row.shape[0]):
        kick = 0.5 * dt * row[i, 6]
        row[i, 2] = half[i, 0] + kick * push[i, 0]
        row[i, 3] = half[i, 1] + kick * push[i, 1]
        row[i, 4] = half[i, 2] + 0.5 * dt * row[i, 7] * push[i, 2]


@kernel
def spring_pass(row, push, pairs, rate, number, before, after):
    """Add the forces of springs."""
    i_p, j_p, k_p, shift, held = pairs
    for p in range(np.uint64(i_p.shape[0])):
        i, j, k = i_p[p], j_p[p], k_p[p]
        dx = row[j, 0] - row[i, 0] + shift[k, 0]
        dy = row[j, 1] - row[i, 1] + shift[k, 1]
        square = dx * dx + dy * dy
        sigma = row[i, 5] + row[j, 5]
        if square < sigma * sigma:
            r = math.sqrt(square)
            force = number.stiffness * (r - sigma) / r
            fx, fy = force * dx, force * dy
            push[i, 0] += fx
            push[i, 1] += fy
            push[j, 0] -= fx
            push[j, 1] -= fy


@kernel
def dashpot_pass(row, push, pairs, rate, number, before, after):
    """Add the forces of springs and dashpots."""
    i_p, j_p, k_p, shift, held = pairs
    for p in range(np.uint64(i_p.shape[0])):
        i, j, k = i_p[p], j_p[p], k_p[p]
        dx = row[j, 0] - row[i, 0] + shift[k, 0]
        dy = row[j, 1] - row[i, 1] + shift[k, 1]
        square = dx * dx + dy * dy
        sigma = row[i, 5] + row[j, 5]
        if square < sigma * sigma:
            r = math.sqrt(square)
            inverse = 1.0 / r
            nx, ny = dx * inverse, dy * inverse
            ux = row[j, 2] - row[i, 2] + rate * dy
            uy = row[j, 3] - row[i, 3]
            force = number.stiffness * (r - sigma) + number.damping * (ux * nx + uy * ny)
            fx, fy = force * nx, force * ny
            push[i, 0] += fx
            push[i, 1] += fy
            push[j, 0] -= fx
            push[j, 1] -= fy


@kernel
def friction_pass(row, push, pairs, rate, number, before, after):
    """Add the forces of springs, dashpots and capped tangential springs."""
    i_p, j_p, k_p, shift, held = pairs
    soft = 1.0 / number.tangential
    for p in range(np.uint64(i_p.shape[0])):
        i, j, k = i_p[p], j_p[p], k_p[p]
        dx = row[j, 0] - row[i, 0] + shift[k, 0]
        dy = row[j, 1] - row[i, 1] + shift[k, 1]
        square = dx * dx + dy * dy
        sigma = row[i, 5] + row[j, 5]
        if square < sigma * sigma:
            r = math.sqrt(square)
            inverse = 1.0 / r
            nx, ny = dx * inverse, dy * inverse
            ux = row[j, 2] - row[i, 2] + rate * dy
            uy = row[j, 3] - row[i, 3]
            elastic = number.stiffness * (r - sigma)
            force = elastic + number.damping * (ux * nx + uy * ny)
            share = r / sigma
            ai, aj = row[i, 5] * share, row[j, 5] * share
            slip = uy * nx - ux * ny - ai * row[i, 4] - aj * row[j, 4]
            stretch = held[p] + before * slip
            across = number.tangential * stretch + number.tangential_damping * slip
            cap = -number.friction * elastic
            capped = min(max(across, -cap), cap)
            # what the cap takes is taken off the spring, too, never past rest nor beyond what it was
            less = stretch + (capped - across) * soft
            held[p] = min(max(less, min(stretch, 0.0)), max(stretch, 0.0)) + after * slip
            fx, fy = force * nx - capped * ny, force * ny + capped * nx
            push[i, 0] += fx
            push[i, 1] += fy
            push[i, 2] += ai * capped
            push[j, 0] -= fx
            push[j, 1] -= fy
            push[j, 2] += aj * capped
        else:
            held[p] = 0.0


@kernel
def bond_pass(row, push, bonds, lattice, rate, number, before, after):
    """Add the forces of bonds."""
    i_b, j_b, image_bd, rest_b, stretch_b = bonds
    for b in range(np.uint64(i_b.shape[0])):
        i, j = i_b[b], j_b[b]
        dx = row[j, 0] - row[i, 0] + lattice[0, 0] * image_bd[b, 0] + lattice[0, 1] * image_bd[b, 1]
        dy = row[j, 1] - row[i, 1] + lattice[1, 0] * image_bd[b, 0] + lattice[1, 1] * image_bd[b, 1]
        r = math.sqrt(dx * dx + dy * dy)
        inverse = 1.0 / r
        nx, ny = dx * inverse, dy * inverse
        ux = row[j, 2] - row[i, 2] + rate * dy
        uy = row[j, 3] - row[i, 3]
        force = number.stiffness * (r - rest_b[b]) + number.bond_damping * (ux * nx + uy * ny)
        share = r / (row[i, 5] + row[j, 5])
        ai, aj = row[i, 5] * share, row[j, 5] * share
        slip = uy * nx - ux * ny - ai * row[i, 4] - aj * row[j, 4]
        stretch = stretch_b[b] + before * slip
        across = number.bond_tangential * stretch + number.bond_tangential_damping * slip
        stretch_b[b] = stretch + after * slip
        fx, fy = force * nx - across * ny, force * ny + across * nx
        push[i, 0] += fx
        push[i, 1] += fy
        push[i, 2] += ai * across
        push[j, 0] -= fx
        push[j, 1] -= fy
        push[j, 2] += aj * across


@kernel
def relist(row, sizes, frame, skin, old, bonded):
    """Return pairs nearer than contact plus skin, with the stretches of the old ones, and the images."""
    place = np.zeros((row.shape[0], 4))
    for i in range(row.shape[0]):
        place[i, 0], place[i, 1], place[i, 3] = row[i, 0], row[i, 1], row[i, 5]
    found = find_pairs((0, 1), place, sizes, frame, 1.0, skin)
    total = found.i_p.shape[0]
    mask = np.uint32((1 << found.bits) - 1)
    i_p, j_p, k_p = np.empty(total, np.uint32), np.empty(total, np.uint32), np.empty(total, np.uint32)
    held = np.zeros(total)
    old_i, old_j, old_k, old_held, old_image = old
    kept = 0
    q = 0
    for p in range(total):
        i, j, k = found.i_p[p], found.code_p[p] >> np.uint32(found.bits), found.code_p[p] & mask
        if bonded[0].shape[0] > 0:
            known = False
            for b in range(bonded[0][i], bonded[0][i + 1]):
                known = known or (
                    bonded[1][b] == j
                    and bonded[2][b, 0] == found.image_kd[k, 0]
                    and bonded[2][b, 1] == found.image_kd[k, 1]
                )
            if known:
                continue
        while q < old_i.shape[0] and old_i[q] < i:
            q += 1
        m = q
        while m < old_i.shape[0] and old_i[m] == i:
            if old_j[m] == j:
                same = True
                for a in range(2):
                    same = same and old_image[old_k[m], a] == found.image_kd[k, a]
                if same:
                    held[kept] = old_held[m]
            m += 1
        i_p[kept], j_p[kept], k_p[kept] = i, j, k
        kept += 1
    return (i_p[:kept], j_p[:kept], k_p[:kept], np.zeros_like(found.image_kd), held[:kept]), found.image_kd


@kernel
def place_images(shift, image, side, gamma):
    """Put images where the sheared box has them."""
    for k in range(shift.shape[0]):
        shift[k, 0] = side * image[k, 0] + gamma * side * image[k, 1]
        shift[k, 1] = side * image[k, 1]


@kernel
def advance(contact_pass, bonded, row, push, half, pairs, image, bonds, anchor, frame, rate, number, dt, span, skin):
    """Step until the list may miss a pair, in the middle of a step (`span` holds 1 then); return the step reached."""
    travel, room = 0.0, 0.5 * skin
    side = frame.lattice_dd[0, 0]
    far = 2.0 * row[:, 5].max() + skin
    for step in range(span[0], span[1]):
        gamma = (step + 1) * dt * rate
        if span[2] == 0:
            travel += shear_rows(row, push, half, 0, row.shape[0], dt, rate)
            strained = gamma - anchor[0, 2]
            if travel + 0.5 * strained * far > room:
                most = 0.0
                for i in range(row.shape[0]):
                    x = row[i, 0] - anchor[i, 0] - strained * anchor[i, 1]
                    y = row[i, 1] - anchor[i, 1]
                    most = max(most, x * x + y * y)
                travel = math.sqrt(most)
                if travel + 0.5 * strained * far > 0.9 * room:
                    span[2] = 1
                    return step
        span[2] = 0
        frame.lattice_dd[0, 1] = gamma * side
        place_images(pairs[3], image, side, gamma)
        contact_pass(row, push, pairs, rate, number, 0.5 * dt, 0.5 * dt)
        if bonded:
            bond_pass(row, push, bonds, frame.lattice_dd, rate, number, 0.5 * dt, 0.5 * dt)
        finish_rows(row, push, half, dt)
    return span[1]


class HandMarch:
    """Discs of a start (see bench_march.py) on their way; `contact_pass` is one of the passes above."""

    def __init__(self, start, numbers, contact_pass, rate, dt, skin, bonds=None):
        n = len(start.radius_n)
        self.pass_, self.number, self.rate, self.dt, self.skin = contact_pass, numbers, rate, dt, skin
        space = np.zeros(8 * n + 8)
        ahead = (-space.ctypes.data % 64) // 8
        self.row = space[ahead : ahead + 8 * n].reshape(n, 8)
        self.row[:, :2], self.row[:, 2:4], self.row[:, 4] = start.position_nd, start.peculiar_nd, start.spin_n
        self.row[:, 5], self.row[:, 6] = start.radius_n, 1.0 / start.mass_n
        self.row[:, 7] = 2.0 / (start.mass_n * start.radius_n**2)
        self.push, self.half = np.zeros((n, 3)), np.zeros((n, 3))
        self.sizes, self.frame = size_levels(start.radius_n.copy()), frame_of(Box.cubic(start.side, 2))
        self.anchor = np.zeros((n, 3))
        none = np.zeros(0, dtype=np.uint32)
        self.pairs, self.image = (none, none, none, np.zeros((1, 3)), np.zeros(0)), np.zeros((1, 3))
        self.known = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
        whole = np.zeros(0, dtype=np.int64)
        self.bonds = Bonded(whole, whole, np.zeros((0, 2)), np.zeros(0), np.zeros(0))
        if bonds is not None:
            image = bonds.image_bd.astype(float)
            self.bonds = Bonded(
                bonds.i_b.copy(), bonds.j_b.copy(), image, bonds.rest_length_b.copy(), np.zeros(len(bonds))
            )
            self.known = (np.searchsorted(bonds.i_b, np.arange(n + 1)), bonds.j_b.copy(), image)
        self.steps = 0
        self.lists = 0
        self.relist(0.0)
        self.pass_(self.row, self.push, self.pairs, rate, numbers, 0.0, 0.5 * dt)
        bond_pass(self.row, self.push, self.bonds, self.frame.lattice_dd, rate, numbers, 0.0, 0.5 * dt)

    def relist(self, gamma):
        """Make the list at the present places."""
        side = self.frame.lattice_dd[0, 0]
        lattice = np.array([[side, gamma * side], [0.0, side]])
        frame = frame_of(Box(lattice))
        for old, new in zip(self.frame, frame, strict=True):
            old[...] = new
        old = (*self.pairs[:3], self.pairs[4], self.image)
        self.pairs, self.image = relist(self.row, self.sizes, self.frame, self.skin, old, self.known)
        place_images(self.pairs[3], self.image, side, gamma)
        self.anchor[:, :2] = self.row[:, :2]
        self.anchor[0, 2] = gamma
        self.lists += 1

    def advance(self, steps):
        """Take so many steps."""
        span = np.array([self.steps, self.steps + steps, 0])
        while self.steps < span[1]:
            span[0] = self.steps
            self.steps = advance(
                self.pass_,
                len(self.bonds.i_b) > 0,
                self.row,
                self.push,
                self.half,
                self.pairs,
                self.image,
                self.bonds,
                self.anchor,
                self.frame,
                self.rate,
                self.number,
                self.dt,
                span,
                self.skin,
            )
            if span[2]:
                self.relist((self.steps + 1) * self.dt * self.rate)
