# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Ellipses and spheroids in a time step: their contacts, tangential springs in a plane, turns and observables.

Contacts are those of minimization (`shape_touch`): a distance rho with slopes along the vector between the centers and
the rotations of both. A dashpot sees the rate of rho. Where two ellipses touch, the arms of a tangential force are the
distances of the centers from the tangent, rho / sigma times the supports of the ellipses along the normal.
"""

from __future__ import annotations

import math

import numpy as np
from numba import literal_unroll

from packmech.dynamics.deformation import relative
from packmech.dynamics.friction import reset_stretch, spring_in_plane, uncapped_force
from packmech.dynamics.pair_lists import NO_SLOT
from packmech.effects import pair_elastic, pair_energy, pair_first
from packmech.jit.compiled import inlined
from packmech.minimize.kernels import coincident_direction
from packmech.minimize.shape_rows import shape_touch


@inlined
def _touch(shapes, axes, i, j, dx, dy, dz):
    """Return the touch of two rows; coincident ones get a direction."""
    if dx * dx + dy * dy + dz * dz == 0.0:
        sigma = shapes.radius_n[i] + shapes.radius_n[j]
        nx, ny, nz = coincident_direction(i, j, len(axes))
        dx, dy, dz = 1e-9 * sigma * nx, 1e-9 * sigma * ny, 1e-9 * sigma * nz
    return shape_touch(shapes, i, j, 0, dx, dy, dz, len(axes))


@inlined
def _push(effects, rho, sigma, rate):
    """Return the derivative of the energy with its dashpots, and what of it is elastic."""
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        first += pair_first(one, rho, sigma, rate)
        elastic += pair_elastic(one, rho, sigma)
    return first, elastic


@inlined
def _energy(effects, rho, sigma):
    energy = 0.0
    for one in literal_unroll(effects):
        energy += pair_energy(one, rho, sigma)
    return energy


@inlined
def _rate(axes, body, touch, i, j, ux, uy, uz):
    """Return the rate of rho."""
    rate = ux * touch.x + uy * touch.y
    if len(axes) == 2:
        return rate + touch.iz * body[i, 6] + touch.jz * body[j, 6]
    rate += uz * touch.z
    rate += touch.ix * body[i, 7] + touch.iy * body[i, 8] + touch.iz * body[i, 9]
    return rate + touch.jx * body[j, 7] + touch.jy * body[j, 8] + touch.jz * body[j, 9]


@inlined
def _arm(shapes, touch, i, nx, ny):
    """Return the distance of a center from the tangent at the touch."""
    along = shapes.unit_nd[i, 0] * nx + shapes.unit_nd[i, 1] * ny
    a, b = shapes.along_n[i] * along, shapes.across_n[i]
    return touch.rho / touch.sigma * math.sqrt(a * a + b * b * (1.0 - along * along))


@inlined
def _slip(shapes, body, touch, i, j, ux, uy):
    """Return the normal, arms, and the slip along t = (-ny, nx), in a plane."""
    inverse = 1.0 / math.sqrt(touch.x * touch.x + touch.y * touch.y)
    nx, ny = inverse * touch.x, inverse * touch.y
    ai, aj = _arm(shapes, touch, i, nx, ny), _arm(shapes, touch, j, nx, ny)
    return nx, ny, ai, aj, uy * nx - ux * ny - ai * body[i, 6] - aj * body[j, 6]


@inlined
def _friction(friction, shapes, body, stretch_pk, p, touch, i, j, ux, uy, elastic, pace):
    """Return the friction on i in a plane, and its torques on both; nothing without."""
    if friction is None:
        return 0.0, 0.0, 0.0, 0.0
    nx, ny, ai, aj, slip = _slip(shapes, body, touch, i, j, ux, uy)
    normal = abs(elastic) * math.sqrt(touch.x * touch.x + touch.y * touch.y)
    force = spring_in_plane(friction, stretch_pk, p, slip, normal, pace)
    return force * -ny, force * nx, ai * force, aj * force


@inlined
def _forces(shapes, effects, friction, rates, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
    """Return whether two rows touch, the force on i, and the torques on both."""
    touch = _touch(shapes, axes, i, j, dx, dy, dz)
    if not touch.touching:
        reset_stretch(axes, stretch_pk, p)
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = relative(rates, axes, body, i, j, dx, dy, dz)
    rate = _rate(axes, body, touch, i, j, ux, uy, uz)
    first, elastic = _push(effects, touch.rho, touch.sigma, rate)
    fx, fy, ti, tj = _friction(friction, shapes, body, stretch_pk, p, touch, i, j, ux, uy, elastic, pace)
    return (
        True, first * touch.x + fx, first * touch.y + fy, first * touch.z,
        -first * touch.ix, -first * touch.iy, ti - first * touch.iz,
        -first * touch.jx, -first * touch.jy, tj - first * touch.jz,
    )  # fmt: skip


@inlined
def _add(axes, row_nk, n, fx, fy, fz, tx, ty, tz):
    row_nk[n, 0] += fx
    row_nk[n, 1] += fy
    if len(axes) == 2:
        row_nk[n, 2] += tz
    else:
        row_nk[n, 2] += fz
        row_nk[n, 3] += tx
        row_nk[n, 4] += ty
        row_nk[n, 5] += tz


@inlined
def shapes_of_block(shapes, effects, friction, rates, axes, body, push, pairs, stretch_pk, pace, b):
    """Add what touching pairs of a block's rows do to these, and leave in slots what they do to other blocks' rows."""
    for q in range(pairs.slots.start_b[b], pairs.slots.start_b[b + 1]):
        pairs.slots.push_qk[q] = 0.0
    if effects is None:
        return
    special = pairs.start_s[2 * b + 1]
    for p in range(pairs.start_s[2 * b], pairs.start_s[2 * b + 2]):
        i, j, slot = pairs.i_p[p], pairs.j_p[p], NO_SLOT
        dx, dy, dz = body[j, 0] - body[i, 0], body[j, 1] - body[i, 1], 0.0
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
        if p >= special:
            k, slot = pairs.image_p[p], pairs.slot_p[p]
            dx += pairs.shift_kd[k, 0]
            dy += pairs.shift_kd[k, 1]
            dz += pairs.shift_kd[k, 2]
        reach = body[i, 3] + body[j, 3]
        if dx * dx + dy * dy + dz * dz >= reach * reach:
            reset_stretch(axes, stretch_pk, p)
            continue
        touching, fx, fy, fz, ix, iy, iz, jx, jy, jz = _forces(
            shapes, effects, friction, rates, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
        )
        if touching:
            _add(axes, push, i, fx, fy, fz, ix, iy, iz)
            if slot == NO_SLOT:
                _add(axes, push, j, -fx, -fy, -fz, jx, jy, jz)
            else:
                _add(axes, pairs.slots.push_qk, slot, -fx, -fy, -fz, jx, jy, jz)


@inlined
def turn_shapes(shapes, axes, state, low, high, dt):
    """Turn the directors of rows by a step at the spins of `half`; nothing without shapes."""
    if shapes is None:
        return
    unit, half = shapes.unit_nd, state.half
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
def slip_of_shapes(shapes, axes, body, flowing, i, j, dx, dy, dz):
    """Return whether two rows touch, and their slip in a plane."""
    touch = _touch(shapes, axes, i, j, dx, dy, dz)
    if not touch.touching:
        return False, 0.0
    ux, uy, _ = relative(flowing, axes, body, i, j, dx, dy, dz)
    return True, _slip(shapes, body, touch, i, j, ux, uy)[4]


@inlined
def measure_shapes(shapes, effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
    """Return whether two rows touch, two energies, whether they slide, the elastic force, and the force on i."""
    touch = _touch(shapes, axes, i, j, dx, dy, dz)
    if not touch.touching:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    rate = _rate(axes, body, touch, i, j, ux, uy, uz)
    energy = _energy(effects, touch.rho, touch.sigma)
    first, elastic = _push(effects, touch.rho, touch.sigma, rate)
    normal = abs(elastic) * math.sqrt(touch.x * touch.x + touch.y * touch.y + touch.z * touch.z)
    spring, sliding, fx, fy = _measure_friction(
        friction, shapes, body, stretch_pk, p, touch, i, j, ux, uy, normal, pace
    )
    return True, energy, spring, sliding, normal, first * touch.x + fx, first * touch.y + fy, first * touch.z


@inlined
def _measure_friction(friction, shapes, body, stretch_pk, p, touch, i, j, ux, uy, normal, pace):
    """Return the energy of a tangential spring, whether it slides, and its force on i; zeros without friction."""
    if friction is None:
        return 0.0, 0.0, 0.0, 0.0
    nx, ny, _, _, slip = _slip(shapes, body, touch, i, j, ux, uy)
    stretch = stretch_pk[p, 0] - pace.after * slip
    force, cap = uncapped_force(friction, stretch, slip), friction.coefficient * normal
    # a spring at its cap is as far as it gets: rounding must not tell it from one beyond
    sliding = 1.0 if abs(force) >= cap * (1.0 - 1e-9) else 0.0
    force = min(max(force, -cap), cap)
    return 0.5 * friction.stiffness * stretch * stretch, sliding, force * -ny, force * nx


@inlined
def inertial_stress(shapes, axes, state, i, work_dd):
    """Write the integral of a x over a turning shape, a the acceleration by its rotation, its symmetric part.

    With S the integral of x x: w (S w) - w^2 S, and what the angular acceleration adds.
    """
    d = len(axes)
    a, b = shapes.along_n[i], shapes.across_n[i]
    share = state.mass_n[i] * (0.25 if d == 2 else 0.2)
    ox = oy = 0.0
    px = py = 0.0
    inverse = state.weight_nk[i, 1]
    if d == 2:
        oz, pz = state.body[i, 6], inverse * state.push[i, 2]
    else:
        ox, oy, oz = state.body[i, 7], state.body[i, 8], state.body[i, 9]
        px, py, pz = inverse * state.push[i, 3], inverse * state.push[i, 4], inverse * state.push[i, 5]
    square = ox * ox + oy * oy + oz * oz
    spin = (ox, oy, oz)
    for k in range(3):
        for m in range(3):
            work_dd[1, k, m] = share * (a * a - b * b) * shapes.unit_nd[i, k] * shapes.unit_nd[i, m]
        if k < d:
            work_dd[1, k, k] += share * b * b
    s = work_dd[1]
    for m in range(3):
        work_dd[2, 0, m] = py * s[2, m] - pz * s[1, m]
        work_dd[2, 1, m] = pz * s[0, m] - px * s[2, m]
        work_dd[2, 2, m] = px * s[1, m] - py * s[0, m]
    for k in range(3):
        for m in range(3):
            along = ox * s[0, m] + oy * s[1, m] + oz * s[2, m]
            work_dd[0, k, m] = spin[k] * along - square * s[k, m] + 0.5 * (work_dd[2, k, m] + work_dd[2, m, k])


@inlined
def spinning_shapes(shapes, axes, state, place, out):
    """Write the sum of `inertial_stress` to a row of observables; nothing without shapes."""
    if shapes is None:
        return
    work = np.zeros((3, 3, 3))
    for k in range(9):
        out[place + k] = 0.0
    for i in range(state.body.shape[0]):
        inertial_stress(shapes, axes, state, i, work)
        for k in range(3):
            for m in range(3):
                out[place + 3 * k + m] += work[0, k, m]
