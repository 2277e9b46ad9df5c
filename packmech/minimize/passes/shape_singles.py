# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What effects on single particles do to shapes in compiled loops: walls push and turn them, all else acts on centers.

Distances from walls are those of `packmech.contacts.wall_touches`, between a particle and its mirror image, of whose
energy it has half; a wall's dashpot sees their rate, which for discs is twice the speed. Shapes are the records of
`shape_rows`, and decide by their type.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.contacts.gauge_contact import support_point
from packmech.effects import Walls, body_energy, body_force, body_second, first_on_wall, law_energy, law_second
from packmech.effects.partners import equal_partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import inlined
from packmech.minimize.passes.shape_rows import by_shape, gauge_body


class RowMotion(NamedTuple):
    """Where the center of a particle is, how fast it moves, and its angular velocity."""

    x: float
    y: float
    z: float
    u: float
    v: float
    w: float
    ox: float
    oy: float
    oz: float


@inlined
def _component(axis, x, y, z):
    if axis == 0.0:
        return x
    return y if axis == 1.0 else z


@inlined
def _across(axis, x, y, z):
    """Return the vector times the unit vector along an axis."""
    if axis == 0.0:
        return 0.0, z, -y
    if axis == 1.0:
        return -z, 0.0, x
    return y, -x, 0.0


@inlined
def _along(axis, push):
    if axis == 0.0:
        return push, 0.0, 0.0
    if axis == 1.0:
        return 0.0, push, 0.0
    return 0.0, 0.0, push


@inlined
def _reach(wall, shapes, i):
    """Return how far a spheroid reaches to a wall, and the factor that its director times the axis turns it by."""
    cosine = _component(wall.axis, shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2])
    a, b = shapes.along_n[i], shapes.across_n[i]
    excess = (a - b) * (a + b)
    size = math.sqrt(b * b + excess * cosine * cosine)
    return size, excess * cosine / size


@inlined
def _turning_reach(wall, shapes, i):
    """Return how far a superellipsoid reaches to a wall, and the slopes of this along its turns."""
    nx, ny, nz = _along(wall.axis, 1.0)
    size, px, py, pz = support_point(gauge_body(shapes, i), nx, ny, nz)
    gx, gy, gz = _across(wall.axis, px, py, pz)
    return size, gx, gy, gz


@inlined
def _pull(wall, distance, sigma, rate, per_inertia):
    """Return half of du/drho of a wall, its dashpot's part in it: what the particle has of it.

    Per inertia is the sum of the squared slopes of rho along the particle's coordinates, over their inertia: the
    particle and its image have half the energy each.
    """
    return 0.5 * first_on_wall(wall, distance, sigma, rate, 2.0 / per_inertia)


@inlined
def _push_of_walls_on_spheroid(shapes, wall, i, motion, mass):
    size, bend = _reach(wall, shapes, i)
    at = _component(wall.axis, motion.x, motion.y, motion.z)
    speed = _component(wall.axis, motion.u, motion.v, motion.w)
    cx, cy, cz = _across(wall.axis, shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2])
    # the rate at which the reach grows
    growth = bend * (cx * motion.ox + cy * motion.oy + cz * motion.oz)
    sigma = 2.0 * shapes.radius_n[i]
    share = sigma / size
    push = twist = 0.0
    below, above = at - wall.low, wall.high - at
    turn = bend * bend * (cx * cx + cy * cy + cz * cz) / (size * shapes.gyration_n[i]) ** 2
    if below < size:
        inverse = share * share * (1.0 + below * below * turn) / mass
        first = _pull(wall, share * below, sigma, share * (speed - below / size * growth), inverse)
        push -= first * share
        twist += first * share * below / size * bend
    if above < size:
        inverse = share * share * (1.0 + above * above * turn) / mass
        first = _pull(wall, share * above, sigma, share * (-speed - above / size * growth), inverse)
        push += first * share
        twist += first * share * above / size * bend
    fx, fy, fz = _along(wall.axis, push)
    return fx, fy, fz, twist * cx, twist * cy, twist * cz


@inlined
def _turning(shapes, i, x, y, z):
    """Return the square of a torque over the moments of inertia of a body, times the mass."""
    frame, rate = shapes.frame_ndd, shapes.rate_nk
    total = 0.0
    for k in range(3):
        along = rate[i, k] * (frame[i, 0, k] * x + frame[i, 1, k] * y + frame[i, 2, k] * z)
        total += along * along
    return total


@inlined
def _push_of_walls_on_beads(shapes, wall, i, motion, mass):
    at = _component(wall.axis, motion.x, motion.y, motion.z)
    speed = _component(wall.axis, motion.u, motion.v, motion.w)
    push = tx = ty = tz = 0.0
    for bead in range(shapes.start_n[i], shapes.start_n[i + 1]):
        x, y, z = shapes.arm_bd[bead, 0], shapes.arm_bd[bead, 1], shapes.arm_bd[bead, 2]
        arm = _component(wall.axis, x, y, z)
        radius = shapes.size_b[bead]
        below, above = at + arm - wall.low, wall.high - at - arm
        if below < radius or above < radius:
            cx, cy, cz = _across(wall.axis, x, y, z)
            moving = speed + cx * motion.ox + cy * motion.oy + cz * motion.oz
            own = 0.0
            inverse = 4.0 * (1.0 + _turning(shapes, i, cx, cy, cz)) / mass
            if below < radius:
                own -= 2.0 * _pull(wall, 2.0 * below, 2.0 * radius, 2.0 * moving, inverse)
            if above < radius:
                own += 2.0 * _pull(wall, 2.0 * above, 2.0 * radius, -2.0 * moving, inverse)
            push += own
            tx += own * cx
            ty += own * cy
            tz += own * cz
    fx, fy, fz = _along(wall.axis, push)
    return fx, fy, fz, tx, ty, tz


@inlined
def _push_of_walls_on_superellipsoid(shapes, wall, i, motion, mass):
    size, gx, gy, gz = _turning_reach(wall, shapes, i)
    at = _component(wall.axis, motion.x, motion.y, motion.z)
    speed = _component(wall.axis, motion.u, motion.v, motion.w)
    growth = gx * motion.ox + gy * motion.oy + gz * motion.oz
    sigma = 2.0 * shapes.radius_n[i]
    share = sigma / size
    turn = _turning(shapes, i, gx, gy, gz)
    push = twist = 0.0
    for side in range(2):
        distance, away = (at - wall.low, 1.0) if side == 0 else (wall.high - at, -1.0)
        if distance < size:
            scale = distance / size
            inverse = share * share * (1.0 + scale * scale * turn) / mass
            first = _pull(wall, share * distance, sigma, share * (away * speed - scale * growth), inverse)
            push -= away * first * share
            twist += first * share * scale
    fx, fy, fz = _along(wall.axis, push)
    return fx, fy, fz, twist * gx, twist * gy, twist * gz


@inlined
def _push_on_center(one, shapes, i, motion, mass):
    x, y, z = body_force(
        one, motion.x, motion.y, motion.z, motion.u, motion.v, motion.w, mass, shapes.radius_n[i]
    )  # fmt: skip
    return x, y, z, 0.0, 0.0, 0.0


@inlined
def _spheroid_on_walls(shapes, wall, i, x, y, z):
    """Return the energy of a spheroid on both walls, and a bound of its stiffness along its coordinates."""
    size, bend = _reach(wall, shapes, i)
    at = _component(wall.axis, x, y, z)
    sigma = 2.0 * shapes.radius_n[i]
    share, image = sigma / size, equal_partners(sigma)
    energy = stiffness = 0.0
    for side in range(2):
        distance = at - wall.low if side == 0 else wall.high - at
        if distance < size:
            energy += 0.5 * law_energy(wall.law, share * distance, image)
            turn = share * distance / size * bend / shapes.gyration_n[i]
            stiffness += 0.5 * abs(law_second(wall.law, share * distance, image)) * (share * share + turn * turn)
    return energy, stiffness


@inlined
def _superellipsoid_on_walls(shapes, wall, i, x, y, z):
    size, gx, gy, gz = _turning_reach(wall, shapes, i)
    at = _component(wall.axis, x, y, z)
    sigma = 2.0 * shapes.radius_n[i]
    share, image = sigma / size, equal_partners(sigma)
    turn = (gx * gx + gy * gy + gz * gz) / shapes.gyration_n[i] ** 2
    energy = stiffness = 0.0
    for side in range(2):
        distance = at - wall.low if side == 0 else wall.high - at
        if distance < size:
            energy += 0.5 * law_energy(wall.law, share * distance, image)
            steep = share * share * (1.0 + (distance / size) ** 2 * turn)
            stiffness += 0.5 * abs(law_second(wall.law, share * distance, image)) * steep
    return energy, stiffness


@inlined
def _beads_on_walls(shapes, wall, i, x, y, z):
    at = _component(wall.axis, x, y, z)
    energy = stiffness = 0.0
    for bead in range(shapes.start_n[i], shapes.start_n[i + 1]):
        u, v, w = shapes.arm_bd[bead, 0], shapes.arm_bd[bead, 1], shapes.arm_bd[bead, 2]
        radius = shapes.size_b[bead]
        image = equal_partners(2.0 * radius)
        turn = (u * u + v * v + w * w) / shapes.gyration_n[i] ** 2
        for side in range(2):
            arm = _component(wall.axis, u, v, w)
            distance = at + arm - wall.low if side == 0 else wall.high - at - arm
            if distance < radius:
                energy += 0.5 * law_energy(wall.law, 2.0 * distance, image)
                stiffness += 2.0 * abs(law_second(wall.law, 2.0 * distance, image)) * (1.0 + turn)
    return energy, stiffness


@inlined
def _center_alone(one, shapes, i, x, y, z, mass):
    radius = shapes.radius_n[i]
    xx, yy, zz, yz, xz, xy = body_second(one, x, y, z, mass, radius)
    stiffness = max(abs(xx), abs(yy), abs(zz)) + abs(yz) + abs(xz) + abs(xy)
    return body_energy(one, x, y, z, mass, radius), stiffness


# force and torque of walls on a particle: (shapes, walls, i, motion, mass); its energy there, and a bound of its
# stiffness along its coordinates: (shapes, walls, i, x, y, z)
_push_of_walls = by_shape(
    None, _push_of_walls_on_spheroid, _push_of_walls_on_beads, _push_of_walls_on_superellipsoid
)  # fmt: skip
_energy_on_walls = by_shape(None, _spheroid_on_walls, _beads_on_walls, _superellipsoid_on_walls)


@inlined
def _pushed_by_walls(walls, shapes, i, motion, mass):
    return _push_of_walls(shapes, walls, i, motion, mass)


@inlined
def _on_walls(walls, shapes, i, x, y, z, mass):
    return _energy_on_walls(shapes, walls, i, x, y, z)


# force and torque of one effect on a particle with a shape: (effect, shapes, i, motion, mass)
push_on_shape = by_type(_push_on_center, {Walls: _pushed_by_walls})
# energy of a particle with a shape under one effect, and a bound of its stiffness: (effect, shapes, i, x, y, z, mass)
energy_of_shape = by_type(_center_alone, {Walls: _on_walls})
