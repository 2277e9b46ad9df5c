# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Shapes inside the loops of minimizers: directors are rows of their own below those of the particles.

The row of a director holds the director times the radius of gyration, so that its changes are lengths and the forces on
it torques over that radius. Its length has no force: what makes it longer turns nobody, and it is put right where a
program's particles are placed. Minimizers walk over these rows as over all others. What the shapes are travels in the
tuple of effects as a record of its own, so that loops of discs and spheres have no code for them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.contact_distance import exact_root, height, pair_of, rough_root
from packmech.contacts.scaled_contact import touch_of
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.packing import Packing


class ShapeRows(NamedTuple):
    """Radii, semi-axes along and across the directors, radii of gyration, and unit directors, by rows; d."""

    radius_n: NDArray[np.float64]
    along_n: NDArray[np.float64]
    across_n: NDArray[np.float64]
    gyration_n: NDArray[np.float64]
    unit_nd: NDArray[np.float64]
    dimension: int


class ShapeTouch(NamedTuple):
    """Whether two shapes touch, rho and contact distance, and rho's slopes along the vector and turns of i and j."""

    touching: bool
    rho: float
    sigma: float
    x: float
    y: float
    z: float
    ix: float
    iy: float
    iz: float
    jx: float
    jy: float
    jz: float


def shape_rows(packing: Packing, order_n: NDArray[np.int64]) -> tuple[ShapeRows, ...]:
    """Return the shapes by rows; nothing for discs and spheres."""
    shapes = packing.shapes
    if shapes is None:
        return ()
    along, across = shapes.semi_axes(packing.radius_n)
    sizes = (packing.radius_n, along, across, shapes.gyration(packing.radius_n))
    unit = np.zeros((packing.particles, 3))
    radius, along, across, gyration = (one[order_n] for one in sizes)
    return (ShapeRows(radius, along, across, gyration, unit, packing.dimension),)


def has_shapes(effects: Any) -> bool:
    """Return whether a tuple of effects, or numba's type of one, holds shapes."""
    kinds = (getattr(one, "instance_class", type(one)) for one in effects)
    return any(kind is ShapeRows for kind in kinds)


def shapes_of(effects: Any) -> Any:
    """Return the shapes among the effects."""
    return next(one for one in effects if isinstance(one, ShapeRows))


@compiled_form(shapes_of)
def _choose_shapes_of(effects: Any) -> Any:
    place = next(k for k, one in enumerate(effects) if getattr(one, "instance_class", None) is ShapeRows)
    return lambda effects: effects[place]


@device
def _keep_directors(effects, row):
    shapes = shapes_of(effects)
    n = shapes.radius_n.shape[0]
    for i in range(n):
        x, y, z = row[n + i, 0], row[n + i, 1], row[n + i, 2]
        inverse = 1.0 / math.sqrt(x * x + y * y + z * z)
        shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2] = inverse * x, inverse * y, inverse * z


def keep_directors(effects: Any, row: Any) -> None:
    """Keep the unit directors of the rows as they are, for the pass that follows."""
    if has_shapes(effects):
        _keep_directors(effects, row)


@compiled_form(keep_directors)
def _choose_keep_directors(effects: Any, row: Any) -> Any:
    if has_shapes(effects):
        return lambda effects, row: _keep_directors(effects, row)
    return lambda effects, row: None


@inlined
def _shape(shapes, i):
    """Return the semi-axes and the unit director of a particle."""
    unit = shapes.unit_nd
    return shapes.along_n[i], shapes.across_n[i], unit[i, 0], unit[i, 1], unit[i, 2]


@inlined
def shape_touch(shapes, i, j, dx, dy, dz, d):
    """Return the ShapeTouch of two particles whose centers are (dx, dy, dz) apart."""
    one, other = _shape(shapes, i), _shape(shapes, j)
    sigma = shapes.radius_n[i] + shapes.radius_n[j]
    square = dx * dx + dy * dy + dz * dz
    r = math.sqrt(square)
    inverse = 1.0 / r
    pair = pair_of(dx * inverse, dy * inverse, dz * inverse, one, other, d)
    at = rough_root(pair, 2)
    # F is nowhere larger than at its root: where it is 1 or more already, the two are apart
    if square * height(pair, at) >= 1.0:
        return ShapeTouch(False, sigma, sigma, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    at = exact_root(pair, at)
    s, _, x, y, z, ix, iy, iz, jx, jy, jz = touch_of(pair, r, dx, dy, dz, one, other, at)
    return ShapeTouch(
        s < 1.0, s * sigma, sigma, sigma * x, sigma * y, sigma * z,
        sigma * ix, sigma * iy, sigma * iz, sigma * jx, sigma * jy, sigma * jz,
    )  # fmt: skip


@device
def flat_spin(row, velocity_nd, k):
    """Return the rate at which the director of a row turns in its plane."""
    x, y = row[k, 0], row[k, 1]
    return (x * velocity_nd[k, 1] - y * velocity_nd[k, 0]) / (x * x + y * y)


@device
def spin_of(row, velocity_nd, k):
    """Return the angular velocity of the director of a row, across it."""
    x, y, z = row[k, 0], row[k, 1], row[k, 2]
    u, v, w = velocity_nd[k, 0], velocity_nd[k, 1], velocity_nd[k, 2]
    inverse = 1.0 / (x * x + y * y + z * z)
    return inverse * (y * w - z * v), inverse * (z * u - x * w), inverse * (x * v - y * u)


@device
def _turn_rows(effects, axes, row, force_nd, velocity_nd):
    shapes = shapes_of(effects)
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


def turn_rows(effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any) -> tuple[float, float, float]:
    """Make forces on directors of the torques in their rows; return F.v, F.F, and the square of the largest."""
    if has_shapes(effects):
        power, whole, largest = _turn_rows(effects, axes, row, force_nd, velocity_nd)
        return power, whole, largest
    return 0.0, 0.0, 0.0


@compiled_form(turn_rows)
def _choose_turn_rows(effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any) -> Any:
    if has_shapes(effects):
        return lambda effects, axes, row, force_nd, velocity_nd: _turn_rows(effects, axes, row, force_nd, velocity_nd)
    return lambda effects, axes, row, force_nd, velocity_nd: (0.0, 0.0, 0.0)
