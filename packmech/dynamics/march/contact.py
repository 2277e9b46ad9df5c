# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The pass over contacts and bonds of a march: normal forces, and where a scene has friction or bonds, theirs.

A row of `body` holds x, y, z, radius, the peculiar velocity (d numbers) and, where particles turn, the spin (1 in a
plane, 3 in space); a row of `push` the force (d) and the torque. Everything that a scene may lack is chosen by type.

A tangential spring's stretch is the integral of the slip, by the trapezoidal rule: a pass first adds `before` times the
slip, takes the force, and then adds `after` times it. In three dimensions it turns with the contact by half a step
before and half a step after.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll, types
from numpy.typing import NDArray

from packmech.compiled import compiled_form, device, kernel
from packmech.dynamics.kernels import coincident_direction
from packmech.dynamics.march.flow import with_flow
from packmech.effects import law_first, pair_first
from packmech.effects.pair import hook_of


class BondTable(NamedTuple):
    """Bonds between rows: laws for compression and tension, numbers, places, rest lengths, stretches of the springs.

    image_bd is in the loops' lattice; start_n, other_s and image_sd list both ways who is bonded to a row, sorted, so
    that a bonded pair is found and taken out of the contacts.
    """

    compression: Any
    tension: Any
    tangential_stiffness: float
    damping: float
    tangential_damping: float
    i_b: NDArray[np.int64]
    j_b: NDArray[np.int64]
    image_bd: NDArray[np.float64]
    rest_b: NDArray[np.float64]
    stretch_bk: NDArray[np.float64]
    start_n: NDArray[np.int64]
    other_s: NDArray[np.int64]
    image_sd: NDArray[np.int64]


class Pace(NamedTuple):
    """How much of the slip is added before and after the force is taken [time]."""

    before: float
    after: float


def slide(friction: Any, stretch: float, slip: float) -> float:
    """Return the tangential force of a friction before its cap [force]."""
    return float(friction.tangential_force(stretch, slip))


@compiled_form(slide)
def _choose_slide(friction: Any, stretch: Any, slip: Any) -> Any:
    function = hook_of(friction, "tangential_force")
    if function is None:
        return None
    return lambda friction, stretch, slip: function(friction, stretch, slip)


@device
def rub_flat(friction, body, push, held_pk, p, i, j, nx, ny, ux, uy, r, sigma, normal, pace):
    """Add friction in a plane: the stretch is a number along t = (-ny, nx); return the tangential force."""
    ai = body[i, 3] * r / sigma
    aj = body[j, 3] * r / sigma
    slip = ux * -ny + uy * nx - ai * body[i, 6] - aj * body[j, 6]
    stretch = held_pk[p, 0] + pace.before * slip
    force = slide(friction, stretch, slip)
    cap = friction.coefficient * normal
    if abs(force) > cap:
        force = math.copysign(cap, force)
        stretch = (force - friction.damping * slip) / friction.stiffness
    held_pk[p, 0] = stretch + pace.after * slip
    push[i, 0] += force * -ny
    push[i, 1] += force * nx
    push[j, 0] -= force * -ny
    push[j, 1] -= force * nx
    push[i, 2] += ai * force
    push[j, 2] += aj * force
    return force


@device
def spun(x, y, z, ox, oy, oz, time):
    """Return a stretch turned by the angular velocity o for a time."""
    # the rotation of Cayley, (1 - W t/2)^-1 (1 + W t/2), keeps lengths and is of second order
    hx, hy, hz = 0.5 * time * ox, 0.5 * time * oy, 0.5 * time * oz
    cx, cy, cz = x + hy * z - hz * y, y + hz * x - hx * z, z + hx * y - hy * x
    dot = hx * cx + hy * cy + hz * cz
    scale = 1.0 / (1.0 + hx * hx + hy * hy + hz * hz)
    return (
        scale * (cx + hy * cz - hz * cy + hx * dot),
        scale * (cy + hz * cx - hx * cz + hy * dot),
        scale * (cz + hx * cy - hy * cx + hz * dot),
    )


@device
def stretch_before(held_pk, p, nx, ny, nz, sx, sy, sz, ox, oy, oz, time):
    """Return the stretch led on by a time at the present slip: turned, laid into the tangent plane, and stretched."""
    x, y, z = held_pk[p, 0], held_pk[p, 1], held_pk[p, 2]
    size = x * x + y * y + z * z
    if size > 0.0:
        x, y, z = spun(x, y, z, ox, oy, oz, time)
        along = x * nx + y * ny + z * nz
        x -= along * nx
        y -= along * ny
        z -= along * nz
        left = x * x + y * y + z * z
        scale = math.sqrt(size / left) if left > 0.0 else 0.0
        x *= scale
        y *= scale
        z *= scale
    return x + time * sx, y + time * sy, z + time * sz


@device
def stretch_after(held_pk, p, x, y, z, sx, sy, sz, ox, oy, oz, time):
    """Keep the stretch, led on by a time at the present slip: stretched, then turned."""
    x, y, z = spun(x + time * sx, y + time * sy, z + time * sz, ox, oy, oz, time)
    held_pk[p, 0] = x
    held_pk[p, 1] = y
    held_pk[p, 2] = z


@device
def slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma):
    """Return arms, slip velocity of the contact points, and the angular velocity with which the contact turns."""
    ai = body[i, 3] * r / sigma
    aj = body[j, 3] * r / sigma
    wx = ai * body[i, 7] + aj * body[j, 7]
    wy = ai * body[i, 8] + aj * body[j, 8]
    wz = ai * body[i, 9] + aj * body[j, 9]
    along = ux * nx + uy * ny + uz * nz
    tx, ty, tz = ux - along * nx, uy - along * ny, uz - along * nz
    # v_j - v_i - (a_i w_i + a_j w_j) x n, tangential part
    sx = tx - (wy * nz - wz * ny)
    sy = ty - (wz * nx - wx * nz)
    sz = tz - (wx * ny - wy * nx)
    # the line of centers turns by n x dn/dt, and about itself with the mean spin along it
    about = 0.5 * ((body[i, 7] + body[j, 7]) * nx + (body[i, 8] + body[j, 8]) * ny + (body[i, 9] + body[j, 9]) * nz)
    inverse = 1.0 / r if r > 0.0 else 0.0
    ox = (ny * tz - nz * ty) * inverse + about * nx
    oy = (nz * tx - nx * tz) * inverse + about * ny
    oz = (nx * ty - ny * tx) * inverse + about * nz
    return ai, aj, sx, sy, sz, ox, oy, oz


@device
def push_in_space(push, i, j, ai, aj, nx, ny, nz, fx, fy, fz):
    """Add a tangential force f on i, -f on j, and its torques a n x f on both."""
    push[i, 0] += fx
    push[i, 1] += fy
    push[i, 2] += fz
    push[j, 0] -= fx
    push[j, 1] -= fy
    push[j, 2] -= fz
    qx, qy, qz = ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx
    push[i, 3] += ai * qx
    push[i, 4] += ai * qy
    push[i, 5] += ai * qz
    push[j, 3] += aj * qx
    push[j, 4] += aj * qy
    push[j, 5] += aj * qz


@device
def rub_in_space(friction, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
    """Add friction between spheres: the stretch is a vector across n; return the tangential force."""
    ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_before(held_pk, p, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
    fx = slide(friction, x, sx)
    fy = slide(friction, y, sy)
    fz = slide(friction, z, sz)
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    cap = friction.coefficient * normal
    if size > cap:
        scale = cap / size
        fx *= scale
        fy *= scale
        fz *= scale
        soft = 1.0 / friction.stiffness
        x = (fx - friction.damping * sx) * soft
        y = (fy - friction.damping * sy) * soft
        z = (fz - friction.damping * sz) * soft
    stretch_after(held_pk, p, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
    push_in_space(push, i, j, ai, aj, nx, ny, nz, fx, fy, fz)
    return size


def rub(
    friction: Any,
    axes: Any,
    body: Any,
    push: Any,
    held_pk: Any,
    p: int,
    i: int,
    j: int,
    nx: float,
    ny: float,
    nz: float,
    ux: float,
    uy: float,
    uz: float,
    r: float,
    sigma: float,
    normal: float,
    pace: Pace,
) -> None:
    """Add the friction of a touching pair with the relative velocity u; nothing where the scene has none."""
    raise NotImplementedError("friction acts in compiled loops")


@compiled_form(rub)
def _choose_rub(
    friction: Any,
    axes: Any,
    body: Any,
    push: Any,
    held_pk: Any,
    p: Any,
    i: Any,
    j: Any,
    nx: Any,
    ny: Any,
    nz: Any,
    ux: Any,
    uy: Any,
    uz: Any,
    r: Any,
    sigma: Any,
    normal: Any,
    pace: Any,
) -> Any:
    if isinstance(friction, types.NoneType):
        return lambda friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace: None
    if len(axes) == 2:

        def flat(friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
            rub_flat(friction, body, push, held_pk, p, i, j, nx, ny, ux, uy, r, sigma, normal, pace)

        return flat

    def space(friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
        rub_in_space(friction, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace)

    return space


def forget(held_pk: Any, p: int) -> None:
    """Forget the stretch of a pair that does not touch; nothing where no stretches are held."""
    if held_pk is not None:
        held_pk[p] = 0.0


@compiled_form(forget)
def _choose_forget(held_pk: Any, p: Any) -> Any:
    if isinstance(held_pk, types.NoneType):
        return lambda held_pk, p: None

    def clear(held_pk, p):
        for a in range(held_pk.shape[1]):
            if held_pk[p, a] != 0.0:
                held_pk[p, a] = 0.0

    return clear


@device
def meet(effects, friction, rates, axes, body, push, held_pk, p, i, j, dx, dy, dz, square, sigma, pace):
    """Add what a touching pair does to both."""
    r = math.sqrt(square)
    inverse = 1.0 / r
    if square == 0.0:
        dx, dy, dz = coincident_direction(i, j, len(axes))
        inverse = 1.0
    ux = body[j, 4] - body[i, 4]
    uy = body[j, 5] - body[i, 5]
    uz = 0.0
    if len(axes) == 3:
        uz = body[j, 6] - body[i, 6]
    if square > 0.0:
        ux, uy, uz = with_flow(rates, ux, uy, uz, dx, dy, dz)
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    rate = ux * nx + uy * ny + uz * nz
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        first += pair_first(one, r, sigma, rate)
        elastic += pair_first(one, r, sigma, 0.0)
    push[i, 0] += first * nx
    push[i, 1] += first * ny
    push[j, 0] -= first * nx
    push[j, 1] -= first * ny
    if len(axes) == 3:
        push[i, 2] += first * nz
        push[j, 2] -= first * nz
    rub(friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, abs(elastic), pace)


@device
def bond_ends(axes, body, bonds, lattice, b):
    """Return the rows of a bond and the vector between them."""
    i, j = bonds.i_b[b], bonds.j_b[b]
    dx = body[j, 0] - body[i, 0]
    dy = body[j, 1] - body[i, 1]
    dz = 0.0
    for k in range(len(axes)):
        dx += lattice[0, k] * bonds.image_bd[b, k]
        dy += lattice[1, k] * bonds.image_bd[b, k]
    if len(axes) == 3:
        dz = body[j, 2] - body[i, 2]
        for k in range(3):
            dz += lattice[2, k] * bonds.image_bd[b, k]
    return i, j, dx, dy, dz


@device
def bond_first(bonds, r, rest):
    """Return du/dr of a bond's normal spring [force]."""
    if r < rest:
        return law_first(bonds.compression, r, rest)
    return law_first(bonds.tension, r, rest)


@device
def _bond_pass(bonds, rates, axes, body, push, lattice, pace):
    for b in range(bonds.i_b.shape[0]):
        i, j, dx, dy, dz = bond_ends(axes, body, bonds, lattice, b)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        if r == 0.0:
            # no direction is better than another: the next step tells them apart
            continue
        nx, ny, nz = dx / r, dy / r, dz / r
        ux = body[j, 4] - body[i, 4]
        uy = body[j, 5] - body[i, 5]
        uz = 0.0
        if len(axes) == 3:
            uz = body[j, 6] - body[i, 6]
        ux, uy, uz = with_flow(rates, ux, uy, uz, dx, dy, dz)
        first = bond_first(bonds, r, bonds.rest_b[b]) + bonds.damping * (ux * nx + uy * ny + uz * nz)
        push[i, 0] += first * nx
        push[i, 1] += first * ny
        push[j, 0] -= first * nx
        push[j, 1] -= first * ny
        sigma = body[i, 3] + body[j, 3]
        if len(axes) == 2:
            ai = body[i, 3] * r / sigma
            aj = body[j, 3] * r / sigma
            slip = ux * -ny + uy * nx - ai * body[i, 6] - aj * body[j, 6]
            stretch = bonds.stretch_bk[b, 0] + pace.before * slip
            force = bonds.tangential_stiffness * stretch + bonds.tangential_damping * slip
            bonds.stretch_bk[b, 0] = stretch + pace.after * slip
            push[i, 0] += force * -ny
            push[i, 1] += force * nx
            push[j, 0] -= force * -ny
            push[j, 1] -= force * nx
            push[i, 2] += ai * force
            push[j, 2] += aj * force
        else:
            push[i, 2] += first * nz
            push[j, 2] -= first * nz
            ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
            x, y, z = stretch_before(bonds.stretch_bk, b, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
            fx = bonds.tangential_stiffness * x + bonds.tangential_damping * sx
            fy = bonds.tangential_stiffness * y + bonds.tangential_damping * sy
            fz = bonds.tangential_stiffness * z + bonds.tangential_damping * sz
            stretch_after(bonds.stretch_bk, b, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
            push_in_space(push, i, j, ai, aj, nx, ny, nz, fx, fy, fz)


def bond_pass(bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Pace) -> None:
    """Add the forces and torques of all bonds; nothing where the scene has none."""
    if bonds is not None:
        _bond_pass(bonds, rates, axes, body, push, lattice, pace)


@compiled_form(bond_pass)
def _choose_bond_pass(bonds: Any, rates: Any, axes: Any, body: Any, push: Any, lattice: Any, pace: Any) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, rates, axes, body, push, lattice, pace: None
    return lambda bonds, rates, axes, body, push, lattice, pace: _bond_pass(
        bonds, rates, axes, body, push, lattice, pace
    )


@kernel
def contact_pass(effects, friction, bonds, rates, axes, body, push, lattice, pairs, within_pk, crossing_pk, pace):
    """Add the forces and torques of touching pairs and of bonds to push."""
    shift_kd = pairs.shift_kd
    for p in range(pairs.count_b[1]):
        i = pairs.crossing_i_p[p]
        j = pairs.crossing_j_p[p]
        k = pairs.crossing_k_p[p]
        dx = body[j, 0] - body[i, 0] + shift_kd[k, 0]
        dy = body[j, 1] - body[i, 1] + shift_kd[k, 1]
        dz = 0.0
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2] + shift_kd[k, 2]
            square += dz * dz
        sigma = body[i, 3] + body[j, 3]
        if square < sigma * sigma:
            meet(effects, friction, rates, axes, body, push, crossing_pk, p, i, j, dx, dy, dz, square, sigma, pace)
        else:
            forget(crossing_pk, p)
    i_p = pairs.i_p
    j_p = pairs.j_p
    for p in range(pairs.count_b[0]):
        i = i_p[p]
        j = j_p[p]
        dx = body[j, 0] - body[i, 0]
        dy = body[j, 1] - body[i, 1]
        dz = 0.0
        square = dx * dx + dy * dy
        if len(axes) == 3:
            dz = body[j, 2] - body[i, 2]
            square += dz * dz
        sigma = body[i, 3] + body[j, 3]
        if square < sigma * sigma:
            meet(effects, friction, rates, axes, body, push, within_pk, p, i, j, dx, dy, dz, square, sigma, pace)
        else:
            forget(within_pk, p)
    bond_pass(bonds, rates, axes, body, push, lattice, pace)
