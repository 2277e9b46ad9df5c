# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Ellipses and spheroids in a time step: their contacts, tangential springs, turns and observables; walls push them.

Contacts are those of minimization (`shape_touch`): a distance rho with slopes along the vector between the centers and
the rotations of both. A dashpot sees the rate of rho. A tangential force acts where the two touch when both are scaled
by s = rho / sigma. With the supports g = sqrt(n A n) of the shapes along the normal n this is s A_i n / g_i from one
center, and -s A_j n / g_j from the other; in a plane only their lengths along n count.

In space the row of a spheroid holds its angular momentum over its moment of inertia across the director, not its
angular velocity (`spin_in_space`): a free director turns at just this rate, which nothing but torques changes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.friction import Slip, dot
from packmech.dynamics.rigid_bodies import Side, motion_of_row, slip_of_surfaces, stretched_matter
from packmech.jit.compiled import inlined
from packmech.minimize.passes.kernels import coincident_direction
from packmech.minimize.passes.shape_rows import ShapeRows, shape_touch
from packmech.minimize.passes.shape_singles import energy_of_shape, push_on_shape


@inlined
def touch_of_spheroids(shapes, axes, body, pair, k):
    """Return the touch of two rows; coincident ones get a direction."""
    i, j, dx, dy, dz = pair.i, pair.j, pair.dx, pair.dy, pair.dz
    if dx * dx + dy * dy + dz * dz == 0.0:
        sigma = shapes.radius_n[i] + shapes.radius_n[j]
        nx, ny, nz = coincident_direction(i, j, len(axes))
        dx, dy, dz = 1e-9 * sigma * nx, 1e-9 * sigma * ny, 1e-9 * sigma * nz
    return shape_touch(shapes, i, j, 0, dx, dy, dz, len(axes))


@inlined
def rate_of_spheroids(shapes, axes, body, pair, touch, u):
    """Return the rate of rho."""
    i, j = pair.i, pair.j
    rate = u[0] * touch.x + u[1] * touch.y
    if len(axes) == 2:
        return rate + touch.iz * body[i, 6] + touch.jz * body[j, 6]
    rate += u[2] * touch.z
    rate += touch.ix * body[i, 7] + touch.iy * body[i, 8] + touch.iz * body[i, 9]
    return rate + touch.jx * body[j, 7] + touch.jy * body[j, 8] + touch.jz * body[j, 9]


@inlined
def steepness(shapes, touch):
    """Return the size of the slope of rho along the vector between the centers."""
    return math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)


@inlined
def slip_of_spheroids(shapes, axes, body, pair, k, touch, u):
    """Return the slip of two rows at their touch."""
    if len(axes) == 2:
        return _slip_in_plane(shapes, body, touch, pair.i, pair.j, u)
    return _slip_in_space(shapes, body, touch, pair.i, pair.j, u)


@inlined
def _arm(shapes, touch, i, nx, ny):
    """Return the distance of a center from the tangent at the touch."""
    along = shapes.unit_nd[i, 0] * nx + shapes.unit_nd[i, 1] * ny
    a, b = shapes.along_n[i] * along, shapes.across_n[i]
    return touch.rho / touch.sigma * math.sqrt(a * a + b * b * (1.0 - along * along))


@inlined
def _slip_in_plane(shapes, body, touch, i, j, u):
    inverse = 1.0 / math.sqrt(touch.x * touch.x + touch.y * touch.y)
    nx, ny = inverse * touch.x, inverse * touch.y
    ai, aj = _arm(shapes, touch, i, nx, ny), _arm(shapes, touch, j, nx, ny)
    slip = u[1] * nx - u[0] * ny - ai * body[i, 6] - aj * body[j, 6]
    return Slip(nx, ny, 0.0, ai, aj, slip, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def excess_of_spin(along, across):
    """Return by how much the moment of inertia across the director exceeds that about it, over the latter [1]."""
    return 0.5 * (along - across) * (along + across) / (across * across)


@inlined
def spin_of_turn(shapes, axes, i, u, v, w):
    """Return the angular velocity of a spheroid in space whose row holds this."""
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    about = u * x + v * y + w * z
    about *= excess_of_spin(shapes.along_n[i], shapes.across_n[i])
    return u + about * x, v + about * y, w + about * z


@inlined
def spin_in_space(shapes, body, i):
    """Return the angular velocity of a spheroid."""
    return spin_of_turn(shapes, (0, 1, 2), i, body[i, 7], body[i, 8], body[i, 9])


def rows_of_spins(shapes: ShapeRows, spin_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what the rows of spheroids hold for angular velocities."""
    about = (spin_nk * shapes.unit_nd).sum(axis=1, keepdims=True)
    excess = excess_of_spin(shapes.along_n, shapes.across_n)[:, None]
    return np.asarray(spin_nk - excess / (1.0 + excess) * about * shapes.unit_nd)


def spins_of_rows(shapes: ShapeRows, row_nk: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angular velocities of spheroids."""
    about = (row_nk * shapes.unit_nd).sum(axis=1, keepdims=True)
    return np.asarray(row_nk + excess_of_spin(shapes.along_n, shapes.across_n)[:, None] * about * shapes.unit_nd)


@inlined
def dragged_to(shapes, axes, i, wx, wy, wz):
    """Return what the row of a spheroid holds where it turns with a flow."""
    if len(axes) == 2:
        return wx, wy, wz
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    excess = excess_of_spin(shapes.along_n[i], shapes.across_n[i])
    about = -excess / (1.0 + excess) * (wx * x + wy * y + wz * z)
    return wx + about * x, wy + about * y, wz + about * z


@inlined
def spread_of_kicks(shapes, axes, i, x, y, z):
    """Return an isotropic random vector in space, times the root of the inertia over that across the director."""
    ux, uy, uz = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    excess = excess_of_spin(shapes.along_n[i], shapes.across_n[i])
    about = (1.0 / math.sqrt(1.0 + excess) - 1.0) * (x * ux + y * uy + z * uz)
    return x + about * ux, y + about * uy, z + about * uz


@inlined
def push_on_spheroid(shapes, one, axes, body, i, mass):
    """Return the force and the torque of one effect on a row."""
    # the angular momentum over the moment across the director, which differs from the spin along the director alone
    spin = (body[i, 7], body[i, 8], body[i, 9]) if len(axes) == 3 else (0.0, 0.0, body[i, 6])
    return push_on_shape(one, shapes, i, motion_of_row(axes, body, i, spin), mass)


@inlined
def energy_of_spheroid(shapes, one, body, i, mass):
    """Return the energy of a row under one effect."""
    return energy_of_shape(one, shapes, i, body[i, 0], body[i, 1], body[i, 2], mass)[0]


@inlined
def _support(shapes, i, normal):
    """Return a shape's support g along a normal, and the point A n / g of its surface where this is the normal."""
    unit = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    a, b = shapes.along_n[i], shapes.across_n[i]
    square, along = b * b, (a - b) * (a + b) * dot(unit, normal)
    x = square * normal[0] + along * unit[0]
    y = square * normal[1] + along * unit[1]
    z = square * normal[2] + along * unit[2]
    size = math.sqrt(x * normal[0] + y * normal[1] + z * normal[2])
    inverse = 1.0 / size
    return size, (inverse * x, inverse * y, inverse * z)


@inlined
def _radii(shapes, i, size, point):
    """Return xx, xy, xz, yy, yz, zz of (A - p p) / g, which makes the change of the point p of one of the normal."""
    a, b = shapes.along_n[i], shapes.across_n[i]
    over, square, share = 1.0 / size, b * b, (a - b) * (a + b)
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    return (
        over * (square + share * x * x - point[0] * point[0]),
        over * (share * x * y - point[0] * point[1]),
        over * (share * x * z - point[0] * point[2]),
        over * (square + share * y * y - point[1] * point[1]),
        over * (share * y * z - point[1] * point[2]),
        over * (square + share * z * z - point[2] * point[2]),
    )


@inlined
def _slip_in_space(shapes, body, touch, i, j, u):
    """Return the slip, levers the points of contact."""
    inverse = 1.0 / math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
    n = inverse * touch.x, inverse * touch.y, inverse * touch.z
    gi, pi = _support(shapes, i, n)
    gj, pj = _support(shapes, j, n)
    wi, wj = spin_in_space(shapes, body, i), spin_in_space(shapes, body, j)
    ri, rj = _radii(shapes, i, gi, pi), _radii(shapes, j, gj, pj)
    return slip_of_surfaces(touch.rho / touch.sigma, n, Side(gi, pi, ri, wi), Side(gj, pj, rj, wj), u)


@inlined
def turn_directors(shapes, axes, half, low, high, dt):
    """Turn the directors of rows by a step at what `half` holds of turns."""
    unit = shapes.unit_nd
    for i in range(low, high):
        x, y, z = unit[i, 0], unit[i, 1], unit[i, 2]
        if len(axes) == 2:
            angle = dt * half[i, 2]
            c, s = math.cos(angle), math.sin(angle)
            x, y = c * x - s * y, s * x + c * y
        else:
            u, v, w = dt * half[i, 3], dt * half[i, 4], dt * half[i, 5]
            angle = math.sqrt(u * u + v * v + w * w)
            # Rodrigues' formula; sin t / t and (1 - cos t) / t^2 without division by small angles
            share = math.sin(angle) / angle if angle > 0.0 else 1.0
            half_share = math.sin(0.5 * angle) / (0.5 * angle) if angle > 0.0 else 1.0
            bend = 0.5 * half_share * half_share * (u * x + v * y + w * z)
            c = math.cos(angle)
            x, y, z = (
                c * x + share * (v * z - w * y) + bend * u,
                c * y + share * (w * x - u * z) + bend * v,
                c * z + share * (u * y - v * x) + bend * w,
            )
        inverse = 1.0 / math.sqrt(x * x + y * y + z * z)
        unit[i, 0], unit[i, 1], unit[i, 2] = inverse * x, inverse * y, inverse * z


@inlined
def inertial_stress(shapes, axes, state, i):
    """Return xx, xy, xz, yy, yz, zz of the integral of a x over a turning shape, a the acceleration by its rotation.

    Half the second derivative of that of x x is that for the row's rate of turning, less the flux of momentum, which is
    that of the angular velocity.
    """
    d = len(axes)
    a, b = shapes.along_n[i], shapes.across_n[i]
    share = state.mass_n[i] * (0.25 if d == 2 else 0.2)
    inverse = state.weight_nk[i, 1]
    x, y, z = shapes.unit_nd[i, 0], shapes.unit_nd[i, 1], shapes.unit_nd[i, 2]
    along, flux = share * (a * a - b * b), share * b * b
    spread = (
        along * x * x + flux, along * x * y, along * x * z,
        along * y * y + flux, along * y * z, along * z * z + (flux if d == 3 else 0.0),
    )  # fmt: skip
    if d == 2:
        return stretched_matter(spread, (0.0, 0.0, state.body[i, 6]), (0.0, 0.0, inverse * state.push[i, 2]))
    spin = state.body[i, 7], state.body[i, 8], state.body[i, 9]
    rate = inverse * state.push[i, 3], inverse * state.push[i, 4], inverse * state.push[i, 5]
    xx, xy, xz, yy, yz, zz = stretched_matter(spread, spin, rate)
    own = spin_in_space(shapes, state.body, i)
    more = dot(spin, spin) - dot(own, own)
    return (
        xx + flux * (more + own[0] * own[0] - spin[0] * spin[0]),
        xy + flux * (own[0] * own[1] - spin[0] * spin[1]),
        xz + flux * (own[0] * own[2] - spin[0] * spin[2]),
        yy + flux * (more + own[1] * own[1] - spin[1] * spin[1]),
        yz + flux * (own[1] * own[2] - spin[1] * spin[2]),
        zz + flux * (more + own[2] * own[2] - spin[2] * spin[2]),
    )


@inlined
def energy_about_director(shapes, axes, state, i):
    """Return what a spheroid's energy of rotation is more than the row alone gives."""
    if len(axes) == 2 or state.weight_nk[i, 1] == 0.0:
        return 0.0
    about = 0.0
    for k in range(3):
        about += state.body[i, 7 + k] * shapes.unit_nd[i, k]
    return 0.5 / state.weight_nk[i, 1] * excess_of_spin(shapes.along_n[i], shapes.across_n[i]) * about * about
