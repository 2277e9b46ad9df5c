# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Spheres on surfaces of triangles: which touch where, found by cells, with exact distances to faces, edges, corners.

A sphere touches a surface where its distance has a minimum on the surface around that place: in a face, on an edge that
stands out, or at a corner. So what lies on the edge between two triangles of one plane touches once, and what lies in a
groove touches either side.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.wall_touches import WallTouches
from packmech.jit.compiled import device, kernel

# contacts whose directions differ by less than ten degrees count as one, the nearest
_ONE_DIRECTION = math.cos(math.radians(10.0))
# a place is on a triangle that is as near as this part of the surface's extent
_ON = 1e-10
# square of the sine below which a direction is that of a face's normal: over the rim of a triangle it still is its face
_UPRIGHT = 1e-14
# what of a triangle is touched
FACE, EDGE, CORNER = 0.0, 1.0, 2.0


class Triangles(NamedTuple):
    """Triangles by their corners (T, 9), and the cells that each reaches into.

    Cell (a, b, c) has the triangles triangle_k[start_c[n] : start_c[n + 1]], n = (a ny + b) nz + c; bound_t6 holds the
    first and last cell of each triangle along each axis. `near` is the distance within which places are the same.
    """

    corner_t9: NDArray[np.float64]
    bound_t6: NDArray[np.int64]
    start_c: NDArray[np.int64]
    triangle_k: NDArray[np.int64]
    low_d: NDArray[np.float64]
    side_d: NDArray[np.float64]
    count_d: NDArray[np.int64]
    near: float


def make_triangles(corner_tcd: NDArray[np.float64]) -> Triangles:
    """Return triangles, given by their (T, 3, 3) corners, sorted into cells about as large as they are."""
    low_td, high_td = corner_tcd.min(axis=1), corner_tcd.max(axis=1)
    low, extent = low_td.min(axis=0), np.ptp(corner_tcd.reshape(-1, 3), axis=0)
    largest = float(extent.max())
    side = max(float((high_td - low_td).max(axis=1).mean()), largest / max(4.0, 4.0 * len(corner_tcd) ** (1 / 3)))
    count = np.maximum(np.ceil(extent / side), 1.0).astype(np.int64)
    sides = np.maximum(extent / count, 1e-3 * side)
    first, last = (np.clip(np.floor((one - low) / sides), 0, count - 1).astype(np.int64) for one in (low_td, high_td))
    cells: list[list[int]] = [[] for _ in range(int(count.prod()))]
    for t, (a, b) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        for x in range(a[0], b[0] + 1):
            for y in range(a[1], b[1] + 1):
                for z in range(a[2], b[2] + 1):
                    cells[(x * int(count[1]) + y) * int(count[2]) + z].append(t)
    start = np.concatenate([[0], np.cumsum([len(one) for one in cells])]).astype(np.int64)
    inside = np.array([t for one in cells for t in one], dtype=np.int64)
    corner_t9 = np.ascontiguousarray(corner_tcd.reshape(-1, 9), dtype=np.float64)
    return Triangles(corner_t9, np.hstack([first, last]), start, inside, low, sides, count, _ON * largest)


@device
def _corner(corner_t9, t, c):
    return corner_t9[t, 3 * c], corner_t9[t, 3 * c + 1], corner_t9[t, 3 * c + 2]


@device
def _less(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@device
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@device
def _between(a, b, share):
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])


@device
def closest_point(corner_t9, t, p):
    """Return the place of a triangle that is nearest to a point, what of it that is, and the edge (from, to) if it is.

    Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    a, b, c = _corner(corner_t9, t, 0), _corner(corner_t9, t, 1), _corner(corner_t9, t, 2)
    ab, ac, ap = _less(b, a), _less(c, a), _less(p, a)
    d1, d2 = _dot(ab, ap), _dot(ac, ap)
    if d1 <= 0.0 and d2 <= 0.0:
        return a, CORNER, a, b
    bp = _less(p, b)
    d3, d4 = _dot(ab, bp), _dot(ac, bp)
    if d3 >= 0.0 and d4 <= d3:
        return b, CORNER, a, b
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return _between(a, b, d1 / (d1 - d3)), EDGE, a, b
    cp = _less(p, c)
    d5, d6 = _dot(ab, cp), _dot(ac, cp)
    if d6 >= 0.0 and d5 <= d6:
        return c, CORNER, a, b
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return _between(a, c, d2 / (d2 - d6)), EDGE, a, c
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        return _between(b, c, (d4 - d3) / ((d4 - d3) + (d5 - d6))), EDGE, b, c
    whole = 1.0 / (va + vb + vc)
    v, w = vb * whole, vc * whole
    place = a[0] + v * ab[0] + w * ac[0], a[1] + v * ab[1] + w * ac[1], a[2] + v * ab[2] + w * ac[2]
    return place, FACE, a, b


@device
def _cell(triangles, axis, place):
    """Return the cell of a place along an axis, the first or the last where it is beyond all."""
    found = math.floor((place - triangles.low_d[axis]) / triangles.side_d[axis])
    return int(min(max(found, 0.0), triangles.count_d[axis] - 1.0))


@device
def _span(triangles, p, radius):
    """Return the first and the last cell that a sphere reaches into along each axis, and whether there are any."""
    reaches = True
    for axis in range(3):
        high = triangles.low_d[axis] + triangles.side_d[axis] * triangles.count_d[axis]
        if p[axis] + radius < triangles.low_d[axis] or p[axis] - radius > high:
            reaches = False
    first = _cell(triangles, 0, p[0] - radius), _cell(triangles, 1, p[1] - radius), _cell(triangles, 2, p[2] - radius)
    last = _cell(triangles, 0, p[0] + radius), _cell(triangles, 1, p[1] + radius), _cell(triangles, 2, p[2] + radius)
    return first, last, reaches


class Search(NamedTuple):
    """A sphere, the cells that it reaches into, and where in them the search is; the number is below 0 at its end."""

    p: Any
    radius: float
    first: Any
    last: Any
    x: int
    y: int
    z: int
    k: int
    number: int


class SurfaceTouch(NamedTuple):
    """Whether a sphere touches a triangle; the direction from there, distance, part, and an edge's direction."""

    touches: bool
    n: Any
    distance: float
    part: float
    along: Any


@device
def first_near(triangles, x, y, z, radius):
    """Return the search for triangles near a sphere, at the first of them."""
    p = (x, y, z)
    first, last, reaches = _span(triangles, p, radius)
    if not reaches:
        return Search(p, radius, first, last, 0, 0, 0, 0, -1)
    start = triangles.start_c[_number(triangles, first[0], first[1], first[2])]
    return next_near(triangles, Search(p, radius, first, last, first[0], first[1], first[2], start, -1))


@device
def _number(triangles, x, y, z):
    return (x * triangles.count_d[1] + y) * triangles.count_d[2] + z


@device
def next_near(triangles, search):
    """Return the search at the next triangle; each that reaches into one of the cells is returned once."""
    p, radius, first, last, x, y, z, k, _ = search
    bound = triangles.bound_t6
    while x <= last[0]:
        end = triangles.start_c[_number(triangles, x, y, z) + 1]
        while k < end:
            t = triangles.triangle_k[k]
            k += 1
            # one that reaches into several of these cells is met in the first of them
            if x == max(bound[t, 0], first[0]) and y == max(bound[t, 1], first[1]) and z == max(bound[t, 2], first[2]):
                return Search(p, radius, first, last, x, y, z, k, t)
        z += 1
        if z > last[2]:
            z = first[2]
            y += 1
        if y > last[1]:
            y = first[1]
            x += 1
        if x <= last[0]:
            k = triangles.start_c[_number(triangles, x, y, z)]
    return Search(p, radius, first, last, x, y, z, k, -1)


@device
def _nearest_on(triangles, t, p):
    """Return the nearest place of a triangle, the way from there, its length, the part, and an edge's direction."""
    place, part, start, end = closest_point(triangles.corner_t9, t, p)
    away = _less(p, place)
    return place, away, math.sqrt(_dot(away, away)), part, _less(end, start)


@device
def _is_minimum(triangles, search, place, distance):
    """Whether no triangle that holds a place comes nearer to the center: distances there are least on the surface."""
    p = search.p
    other = first_near(triangles, p[0], p[1], p[2], search.radius)
    while other.number >= 0:
        _, _, nearer, _, _ = _nearest_on(triangles, other.number, p)
        if nearer < distance - triangles.near:
            _, _, off, _, _ = _nearest_on(triangles, other.number, place)
            if off <= triangles.near:
                return False
        other = next_near(triangles, other)
    return True


@device
def _has_nearer_contact(triangles, search, away, distance):
    """Whether a nearer contact is in nearly the same direction; of equally near ones the first stands for all."""
    p = search.p
    other = first_near(triangles, p[0], p[1], p[2], search.radius)
    while other.number >= 0:
        if other.number != search.number:
            place, there, nearer, part, _ = _nearest_on(triangles, other.number, p)
            before = nearer < distance or (nearer == distance and other.number < search.number)
            if before and nearer > 0.0 and _dot(there, away) > _ONE_DIRECTION * nearer * distance:
                if part == FACE or _is_minimum(triangles, other, place, nearer):
                    return True
        other = next_near(triangles, other)
    return False


@device
def _is_upright(corner_t9, t, away, distance):
    a, b, c = _corner(corner_t9, t, 0), _corner(corner_t9, t, 1), _corner(corner_t9, t, 2)
    ab, ac = _less(b, a), _less(c, a)
    normal = ab[1] * ac[2] - ab[2] * ac[1], ab[2] * ac[0] - ab[0] * ac[2], ab[0] * ac[1] - ab[1] * ac[0]
    across = (
        away[1] * normal[2] - away[2] * normal[1],
        away[2] * normal[0] - away[0] * normal[2],
        away[0] * normal[1] - away[1] * normal[0],
    )
    return _dot(across, across) <= _UPRIGHT * distance * distance * _dot(normal, normal)


@device
def touch_of_triangle(triangles, search):
    """Return what a sphere does at the triangle that the search is at."""
    place, away, distance, part, edge = _nearest_on(triangles, search.number, search.p)
    # a center on the surface is pushed nowhere
    touches = 0.0 < distance < search.radius
    if touches and part != FACE:
        touches = _is_minimum(triangles, search, place, distance)
    if touches:
        touches = not _has_nearer_contact(triangles, search, away, distance)
    over = 1.0 / distance if distance > 0.0 else 0.0
    if _is_upright(triangles.corner_t9, search.number, away, distance):
        part = FACE
    size = 1.0 / math.sqrt(_dot(edge, edge))
    n = (over * away[0], over * away[1], over * away[2])
    return SurfaceTouch(touches, n, distance, part, (size * edge[0], size * edge[1], size * edge[2]))


@kernel
def _count_touches(triangles, place_n3, radius_n):
    count = 0
    for i in range(place_n3.shape[0]):
        near = first_near(triangles, place_n3[i, 0], place_n3[i, 1], place_n3[i, 2], radius_n[i])
        while near.number >= 0:
            count += touch_of_triangle(triangles, near).touches
            near = next_near(triangles, near)
    return count


@kernel
def _write_touches(triangles, place_n3, radius_n, particle_w, number_wk):
    w = 0
    for i in range(place_n3.shape[0]):
        near = first_near(triangles, place_n3[i, 0], place_n3[i, 1], place_n3[i, 2], radius_n[i])
        while near.number >= 0:
            touch = touch_of_triangle(triangles, near)
            if touch.touches:
                particle_w[w] = i
                number_wk[w, 0], number_wk[w, 1] = touch.distance, touch.part
                for a in range(3):
                    number_wk[w, 2 + a], number_wk[w, 5 + a] = touch.n[a], touch.along[a]
                w += 1
            near = next_near(triangles, near)


def surface_touches(triangles: Triangles, place_n3: NDArray[np.float64], radius_n: NDArray[np.float64]) -> WallTouches:
    """Return what touches a surface, as of a wall, sorted by particles; spheres, which nothing turns.

    Parameters
    ----------
    triangles
        The surface.
    place_n3, radius_n
        (N, 3) centers and (N,) radii of the spheres [length].

    """
    count = _count_touches(triangles, place_n3, radius_n)
    particle, number = np.zeros(count, dtype=np.int64), np.zeros((count, 8))
    _write_touches(triangles, place_n3, radius_n, particle, number)
    distance, part, away, along = number[:, 0], number[:, 1], number[:, 2:5], number[:, 5:]
    slope, curvature = np.zeros((count, 6)), np.zeros((count, 6, 6))
    slope[:, :3] = 2.0 * away
    across = np.eye(3) - away[:, :, None] * away[:, None, :]
    across[part == EDGE] -= (along[:, :, None] * along[:, None, :])[part == EDGE]
    bend = np.where(part == FACE, 0.0, 2.0 / distance)
    curvature[:, :3, :3] = bend[:, None, None] * across
    return WallTouches(particle, 2.0 * distance, 2.0 * radius_n[particle], slope, curvature)


def face_area_of(corner_tcd: NDArray[np.float64]) -> NDArray[Any]:
    """Return the (T,) areas of triangles by their corners [length^2]."""
    a, b = corner_tcd[:, 1] - corner_tcd[:, 0], corner_tcd[:, 2] - corner_tcd[:, 0]
    return np.asarray(0.5 * np.linalg.norm(np.cross(a, b), axis=1))
