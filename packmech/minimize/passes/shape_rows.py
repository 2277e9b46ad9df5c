# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Shapes inside the loops of minimizers: how particles are turned stands in rows below those of their positions.

The row of an ellipse or spheroid holds its director times the radius of gyration, so that its changes are lengths and
the forces on it torques over that radius. Its length has no force: what makes it longer turns none, and it is put
right where a program's particles are placed. The row of a rigid body of beads, or of a superellipsoid, holds the
rotation since the program was built (the angle first in a plane, the rotation vector in space) times the radius of
gyration. Minimizers walk over these rows as over all others. What the shapes are travels in the tuple of effects as a
record of its own, so that loops of discs and spheres have no code for them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.contact_distance import exact_root, height, pair_of
from packmech.contacts.gauge_contact import body_at, gauge_touch, slopes_of_scale
from packmech.contacts.network import effective_radius
from packmech.contacts.scaled_contact import touch_of
from packmech.effects.partners import Partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.minimize.passes.kind_rows import kinds_between
from packmech.packing import Packing
from packmech.shapes import Beads, Superellipsoids


class ShapeRows(NamedTuple):
    """Radii, semi-axes along and across the directors, radii of gyration, and unit directors, by rows; d."""

    radius_n: NDArray[np.float64]
    along_n: NDArray[np.float64]
    across_n: NDArray[np.float64]
    gyration_n: NDArray[np.float64]
    unit_nd: NDArray[np.float64]
    dimension: int


class BeadRows(NamedTuple):
    """Radii and radii of gyration, first beads, beads in their bodies' frames, and what turned of these, by rows; d.

    `rate_nk` are one over the radii of gyration about the axes of the bodies, 0 where nothing turns (in a plane the
    third one); frames are 3 x 3, axes in columns.
    """

    radius_n: NDArray[np.float64]
    gyration_n: NDArray[np.float64]
    start_n: NDArray[np.int64]
    offset_bd: NDArray[np.float64]
    size_b: NDArray[np.float64]
    rate_nk: NDArray[np.float64]
    reference_ndd: NDArray[np.float64]
    frame_ndd: NDArray[np.float64]
    arm_bd: NDArray[np.float64]
    dimension: int


class GaugeRows(NamedTuple):
    """Superellipsoids as `BeadRows` has bodies, each of one bead at its center, with semi-axes and exponents."""

    radius_n: NDArray[np.float64]
    gyration_n: NDArray[np.float64]
    start_n: NDArray[np.int64]
    offset_bd: NDArray[np.float64]
    size_b: NDArray[np.float64]
    rate_nk: NDArray[np.float64]
    reference_ndd: NDArray[np.float64]
    frame_ndd: NDArray[np.float64]
    arm_bd: NDArray[np.float64]
    dimension: int
    semi_nk: NDArray[np.float64]
    exponent_n: NDArray[np.float64]


# the kinds of rows that say how particles are shaped
ROWS_WITH_SHAPES = (ShapeRows, BeadRows, GaugeRows)


class RowLaws(NamedTuple):
    """What acts between rows: effects, the shapes among them (None without), axes, and the rows."""

    effects: Any
    shapes: Any
    axes: Any
    body: Any


class ShapeTouch(NamedTuple):
    """Whether two shapes touch, rho, contact distance and effective radius, and rho's slopes.

    These along the vector and along the turns of i and j.
    """

    touching: bool
    rho: float
    sigma: float
    effective_radius: float
    x: float
    y: float
    z: float
    ix: float
    iy: float
    iz: float
    jx: float
    jy: float
    jz: float


@inlined
def partners_at(effects, i, j, touch):
    """Return the partners that two rows are at a touch, as laws take them."""
    return Partners(touch.sigma, touch.effective_radius, kinds_between(effects, i, j))


def shape_rows(packing: Packing, order_n: NDArray[np.int64]) -> tuple[ShapeRows | BeadRows | GaugeRows, ...]:
    """Return the shapes by rows; nothing for discs and spheres."""
    shapes = packing.shapes
    if not shapes.has_orientations:
        return ()
    if isinstance(shapes, Beads):
        return (_bead_rows(packing.radius_n[order_n], shapes.select(order_n)),)
    if isinstance(shapes, Superellipsoids):
        return (_gauge_rows(packing.radius_n[order_n], shapes.select(order_n)),)
    along, across = shapes.semi_axes(packing.radius_n)
    sizes = (packing.radius_n, along, across, shapes.gyration(packing.radius_n))
    unit = np.zeros((packing.particles, 3))
    radius, along, across, gyration = (one[order_n] for one in sizes)
    return (ShapeRows(radius, along, across, gyration, unit, packing.dimension),)


def _bead_rows(radius_n: NDArray[np.float64], shapes: Beads) -> BeadRows:
    """Return bodies as they stand one after another."""
    return BeadRows(*_framed_rows(radius_n, shapes, shapes.offset_bd * radius_n[shapes.particle_b, None]))


def _gauge_rows(radius_n: NDArray[np.float64], shapes: Superellipsoids) -> GaugeRows:
    """Return superellipsoids as they stand one after another."""
    # across a plane any length does
    semi = np.ones((len(shapes), 3))
    semi[:, : shapes.dimension] = shapes.axes(radius_n)
    rows = *_framed_rows(radius_n, shapes, np.zeros((len(shapes), shapes.dimension))), semi, np.array(shapes.exponent_n)
    return GaugeRows(*rows)


def _framed_rows(
    radius_n: NDArray[np.float64], shapes: Beads | Superellipsoids, place_bd: NDArray[np.float64]
) -> tuple[Any, ...]:
    """Return the fields of `BeadRows`, of sites at these places in the frames of the bodies."""
    n, d = len(shapes), shapes.dimension
    frame, offset, rate = np.zeros((n, 3, 3)), np.zeros((len(place_bd), 3)), np.zeros((n, 3))
    frame[:, 2, 2] = 1.0
    frame[:, :d, :d] = shapes.frames()
    offset[:, :d] = place_bd
    rates = shapes.turn_rates(radius_n)
    rate[:, 3 - rates.shape[1] :] = rates
    gyration, size = shapes.gyration(radius_n), shapes.site_radius(radius_n)
    return radius_n, gyration, shapes.start_n, offset, size, rate, frame, frame.copy(), np.zeros_like(offset), d


def _kind(one: Any) -> Any:
    """Return the class of a record, or of numba's type of one."""
    return getattr(one, "instance_class", type(one))


def shapes_of(effects: Any) -> Any:
    """Return the shapes among the effects; None where there are none."""
    return next((one for one in effects if _kind(one) in ROWS_WITH_SHAPES), None)


@compiled_form(shapes_of)
def _choose_shapes_of(effects: Any) -> Any:
    places = [k for k, one in enumerate(effects) if _kind(one) in ROWS_WITH_SHAPES]
    if not places:
        return lambda effects: None
    place = places[0]
    return lambda effects: effects[place]


@device
def _keep_directors(shapes, row):
    n = shapes.radius_n.shape[0]
    for i in range(n):
        x, y, z = row[n + i, 0], row[n + i, 1], row[n + i, 2]
        inverse = 1.0 / math.sqrt(x * x + y * y + z * z)
        shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2] = inverse * x, inverse * y, inverse * z


@device
def _keep_frames(shapes, row):
    n = shapes.radius_n.shape[0]
    for i in range(n):
        inverse = 1.0 / shapes.gyration_n[i]
        if shapes.dimension == 2:
            x, y, z = 0.0, 0.0, inverse * row[n + i, 0]
        else:
            x, y, z = inverse * row[n + i, 0], inverse * row[n + i, 1], inverse * row[n + i, 2]
        first, b, _ = _rotation_factors(x * x + y * y + z * z)
        # Rodrigues' formula, row by row
        turn = (
            (1.0 - b * (y * y + z * z), b * x * y - first * z, b * x * z + first * y),
            (b * x * y + first * z, 1.0 - b * (x * x + z * z), b * y * z - first * x),
            (b * x * z - first * y, b * y * z + first * x, 1.0 - b * (x * x + y * y)),
        )
        for k in range(3):
            for m in range(3):
                shapes.frame_ndd[i, k, m] = (
                    turn[k][0] * shapes.reference_ndd[i, 0, m]
                    + turn[k][1] * shapes.reference_ndd[i, 1, m]
                    + turn[k][2] * shapes.reference_ndd[i, 2, m]
                )
        for bead in range(shapes.start_n[i], shapes.start_n[i + 1]):
            u, v, w = shapes.offset_bd[bead, 0], shapes.offset_bd[bead, 1], shapes.offset_bd[bead, 2]
            for k in range(3):
                shapes.arm_bd[bead, k] = (
                    shapes.frame_ndd[i, k, 0] * u + shapes.frame_ndd[i, k, 1] * v + shapes.frame_ndd[i, k, 2] * w
                )


@device
def _rotation_factors(square):
    """Return sin t / t, (1 - cos t) / t^2 and (t - sin t) / t^3, for the square of an angle t."""
    if square < 1e-4:
        first = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
        second = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
        third = (1.0 - square / 20.0 * (1.0 - square / 42.0 * (1.0 - square / 72.0))) / 6.0
        return first, second, third
    angle = math.sqrt(square)
    sine = math.sin(angle)
    half = math.sin(0.5 * angle)
    return sine / angle, 2.0 * half * half / square, (angle - sine) / (square * angle)


@inlined
def _shape(shapes, i):
    """Return the semi-axes and the unit director of a particle."""
    unit = shapes.unit_nd
    return shapes.along_n[i], shapes.across_n[i], unit[i, 0], unit[i, 1], unit[i, 2]


@inlined
def _touch_of_spheroids(shapes, i, j, k, dx, dy, dz, d):
    one, other = _shape(shapes, i), _shape(shapes, j)
    # no one radius stands for the curvature of these
    sigma, effective = shapes.radius_n[i] + shapes.radius_n[j], np.nan
    pair = pair_of(dx, dy, dz, one, other, d)
    # F is nowhere larger than at its root: where it is 1 or more half way, the two are apart; few others are
    if height(pair, 0.5) >= 1.0:
        return ShapeTouch(False, sigma, sigma, effective, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    s, _, x, y, z, ix, iy, iz, jx, jy, jz = touch_of(pair, dx, dy, dz, one, other, exact_root(pair, 0.5), d)
    return ShapeTouch(
        s < 1.0, s * sigma, sigma, effective, sigma * x, sigma * y, sigma * z,
        sigma * ix, sigma * iy, sigma * iz, sigma * jx, sigma * jy, sigma * jz,
    )  # fmt: skip


@inlined
def _touch_of_beads(shapes, i, j, k, dx, dy, dz, d):
    """Return the ShapeTouch of the k-th pair of beads of two bodies."""
    others = shapes.start_n[j + 1] - shapes.start_n[j]
    return touch_of_two_beads(shapes, shapes.start_n[i] + k // others, shapes.start_n[j] + k % others, dx, dy, dz)


@inlined
def touch_of_two_beads(shapes, one, other, dx, dy, dz):
    """Return the ShapeTouch of two beads of bodies whose centers are (dx, dy, dz) apart."""
    ax, ay, az = shapes.arm_bd[one, 0], shapes.arm_bd[one, 1], shapes.arm_bd[one, 2]
    bx, by, bz = shapes.arm_bd[other, 0], shapes.arm_bd[other, 1], shapes.arm_bd[other, 2]
    size, size_j = shapes.size_b[one], shapes.size_b[other]
    sigma, effective = size + size_j, effective_radius(size, size_j)
    x, y, z = dx + bx - ax, dy + by - ay, dz + bz - az
    square = x * x + y * y + z * z
    if square >= sigma * sigma:
        return ShapeTouch(False, sigma, sigma, effective, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rho = math.sqrt(square)
    if square == 0.0:
        x, inverse = 1.0, 1.0
    else:
        inverse = 1.0 / rho
    x, y, z = inverse * x, inverse * y, inverse * z
    return ShapeTouch(
        True, rho, sigma, effective, x, y, z,
        az * y - ay * z, ax * z - az * x, ay * x - ax * y,
        by * z - bz * y, bz * x - bx * z, bx * y - by * x,
    )  # fmt: skip


@inlined
def gauge_body(shapes, i):
    """Return a superellipsoid as it stands."""
    return body_at(shapes.semi_nk[i], shapes.exponent_n[i], shapes.frame_ndd[i])


@device
def _touch_of_superellipsoids(shapes, i, j, k, dx, dy, dz, d):
    sigma, effective = shapes.radius_n[i] + shapes.radius_n[j], np.nan
    touch = gauge_touch(gauge_body(shapes, i), gauge_body(shapes, j), dx, dy, dz, d, 1.0)
    if touch.square >= 1.0:
        return ShapeTouch(False, sigma, sigma, effective, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    s, x, y, z, ix, iy, iz, jx, jy, jz = slopes_of_scale(touch, dx, dy, dz)
    return ShapeTouch(
        True, s * sigma, sigma, effective, sigma * x, sigma * y, sigma * z,
        sigma * ix, sigma * iy, sigma * iz, sigma * jx, sigma * jy, sigma * jz,
    )  # fmt: skip


@inlined
def _director(shapes, i):
    return shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]


@inlined
def _first_axis(shapes, i):
    return shapes.frame_ndd[i, 0, 0], shapes.frame_ndd[i, 1, 0], shapes.frame_ndd[i, 2, 0]


@device
def _pairs_of_beads(shapes, i, j):
    start = shapes.start_n
    return (start[i + 1] - start[i]) * (start[j + 1] - start[j])


@device
def _turning_vector(shapes, row, velocity_nd, i):
    """Return the angular velocity of a body whose row holds a rotation in space."""
    k = shapes.radius_n.shape[0] + i
    inverse = 1.0 / shapes.gyration_n[i]
    x, y, z = inverse * row[k, 0], inverse * row[k, 1], inverse * row[k, 2]
    u, v, w = inverse * velocity_nd[k, 0], inverse * velocity_nd[k, 1], inverse * velocity_nd[k, 2]
    _, second, third = _rotation_factors(x * x + y * y + z * z)
    cx, cy, cz = y * w - z * v, z * u - x * w, x * v - y * u
    return (
        u + second * cx + third * (y * cz - z * cy),
        v + second * cy + third * (z * cx - x * cz),
        w + second * cz + third * (x * cy - y * cx),
    )


@device
def _flat_turning(shapes, row, velocity_nd, i):
    return velocity_nd[shapes.radius_n.shape[0] + i, 0] / shapes.gyration_n[i]


@device
def _flat_spin(shapes, row, velocity_nd, i):
    """Return the rate at which a director turns in its plane."""
    k = shapes.radius_n.shape[0] + i
    x, y = row[k, 0], row[k, 1]
    return (x * velocity_nd[k, 1] - y * velocity_nd[k, 0]) / (x * x + y * y)


@device
def _spin(shapes, row, velocity_nd, i):
    """Return the angular velocity of a director, across it."""
    k = shapes.radius_n.shape[0] + i
    x, y, z = row[k, 0], row[k, 1], row[k, 2]
    u, v, w = velocity_nd[k, 0], velocity_nd[k, 1], velocity_nd[k, 2]
    inverse = 1.0 / (x * x + y * y + z * z)
    return inverse * (y * w - z * v), inverse * (z * u - x * w), inverse * (x * v - y * u)


@device
def _turn_directors(shapes, axes, row, force_nd, velocity_nd):
    n = shapes.radius_n.shape[0]
    power = 0.0
    whole = 0.0
    largest = 0.0
    for k in range(n, 2 * n):
        x, y, z = row[k, 0], row[k, 1], row[k, 2]
        square = x * x + y * y + z * z
        inverse = 1.0 / square
        if len(axes) == 2:
            torque = inverse * force_nd[k, 0]
            fx, fy = -torque * y, torque * x
            force_nd[k, 0] = fx
            force_nd[k, 1] = fy
            own = fx * fx + fy * fy
            power += fx * velocity_nd[k, 0] + fy * velocity_nd[k, 1]
        else:
            u, v, w = inverse * force_nd[k, 0], inverse * force_nd[k, 1], inverse * force_nd[k, 2]
            fx, fy, fz = v * z - w * y, w * x - u * z, u * y - v * x
            force_nd[k, 0] = fx
            force_nd[k, 1] = fy
            force_nd[k, 2] = fz
            own = fx * fx + fy * fy + fz * fz
            power += fx * velocity_nd[k, 0] + fy * velocity_nd[k, 1] + fz * velocity_nd[k, 2]
        whole += own
        # balance is judged by the radius of gyration, whatever the director's length is now
        largest = max(largest, own * square / shapes.gyration_n[k - n] ** 2)
    return power, whole, largest


@device
def _turn_bodies(shapes, axes, row, force_nd, velocity_nd):
    n = shapes.radius_n.shape[0]
    power = 0.0
    whole = 0.0
    largest = 0.0
    for i in range(n):
        k = n + i
        inverse = 1.0 / shapes.gyration_n[i]
        if len(axes) == 2:
            torque = force_nd[k, 0]
            fx = inverse * torque
            force_nd[k, 0] = fx
            whole += fx * fx
            power += fx * velocity_nd[k, 0]
            largest = max(largest, (torque * shapes.rate_nk[i, 2]) ** 2)
        else:
            tx, ty, tz = force_nd[k, 0], force_nd[k, 1], force_nd[k, 2]
            x, y, z = inverse * row[k, 0], inverse * row[k, 1], inverse * row[k, 2]
            _, second, third = _rotation_factors(x * x + y * y + z * z)
            cx, cy, cz = y * tz - z * ty, z * tx - x * tz, x * ty - y * tx
            # the transpose of what makes an angular velocity of the rate of a rotation vector
            fx = inverse * (tx - second * cx + third * (y * cz - z * cy))
            fy = inverse * (ty - second * cy + third * (z * cx - x * cz))
            fz = inverse * (tz - second * cz + third * (x * cy - y * cx))
            force_nd[k, 0] = fx
            force_nd[k, 1] = fy
            force_nd[k, 2] = fz
            whole += fx * fx + fy * fy + fz * fz
            power += fx * velocity_nd[k, 0] + fy * velocity_nd[k, 1] + fz * velocity_nd[k, 2]
            own = 0.0
            for m in range(3):
                frame = shapes.frame_ndd
                about = frame[i, 0, m] * tx + frame[i, 1, m] * ty + frame[i, 2, m] * tz
                own += (about * shapes.rate_nk[i, m]) ** 2
            largest = max(largest, own)
    return power, whole, largest


# what is done for each kind of shape: an entry for discs and spheres, spheroids, bodies of beads, and superellipsoids,
# which turn as bodies of beads do


def by_shape(discs: Any, spheroids: Any, beads: Any, superellipsoids: Any = None) -> Any:
    """Return a function that runs one of four, by its first argument: None, `ShapeRows`, `BeadRows` or `GaugeRows`.

    For the last ones that of beads unless there is one of their own.
    """
    own = beads if superellipsoids is None else superellipsoids
    return by_type(discs, {ShapeRows: spheroids, BeadRows: beads, GaugeRows: own})


# keeps the shapes as the rows turn them, for the pass that follows: (shapes, row)
keep_turned = by_shape(lambda shapes, row: None, _keep_directors, _keep_frames)
# the direction by which pairs are aligned, the director or the first axis of a body: (shapes, i)
axis_of = by_shape(None, _director, _first_axis)
# in how many places two particles may touch: (shapes, i, j)
touches = by_shape(None, lambda shapes, i, j: 1, _pairs_of_beads, lambda shapes, i, j: 1)
# the k-th ShapeTouch of two particles whose centers are (dx, dy, dz) apart: (shapes, i, j, k, dx, dy, dz, d)
shape_touch = by_shape(None, _touch_of_spheroids, _touch_of_beads, _touch_of_superellipsoids)
# the rate at which a particle turns in its plane, and its angular velocity in space: (shapes, row, velocity_nd, i)
flat_spin = by_shape(None, _flat_spin, _flat_turning)
spin_of = by_shape(None, _spin, _turning_vector)
# makes forces on turns of the torques in their rows; F.v, F.F, and the square of the largest
turn_rows = by_shape(
    lambda shapes, axes, row, force_nd, velocity_nd: (0.0, 0.0, 0.0), _turn_directors, _turn_bodies
)  # fmt: skip
