# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Tangential springs of contacts and bonds, and friction: a scene without it (None) holds none of its code.

A row of `body` holds x, y, z, radius, the peculiar velocity (d numbers) and, where particles turn, the spin (1 in a
plane, 3 in space); a row of `push` the force (d) and the torque. Of shapes the radius is that of the disc or sphere
that holds them, and in space their angular momentum over a moment of inertia stands for the spin (`shape_pairs`,
`rigid_bodies`).

A tangential displacement is the integral of the slip velocity, by the trapezoidal rule: a pass first adds `before`
times the slip, takes the force, and then adds `after` times it. In space it turns with the contact by half a step
before and half a step after.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import types

from packmech.effects import Bonds, Friction
from packmech.effects.pair import hook_of
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.packing import Packing
from packmech.scene import Scene


class Contact(NamedTuple):
    """A touching pair: its rows, direction n from i to j, velocity u of j relative to i, distance, contact distance."""

    i: Any
    j: Any
    nx: float
    ny: float
    nz: float
    ux: float
    uy: float
    uz: float
    r: float
    sigma: float


class Slip(NamedTuple):
    """Arms of a contact, the slip velocity of the contact points (in a plane along t = (-ny, nx)), and how it turns."""

    ai: float
    aj: float
    sx: float
    sy: float
    sz: float
    ox: float
    oy: float
    oz: float


class Pace(NamedTuple):
    """How much of the slip is added before and after the force is taken [time]."""

    before: float
    after: float


@device
def rotated(x, y, z, ox, oy, oz, time):
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
def stretch_before(stretch_pk, p, contact, slip, time):
    """Return the stretch after a time at the present slip: turned, laid into the tangent plane, and stretched."""
    x, y, z = stretch_pk[p, 0], stretch_pk[p, 1], stretch_pk[p, 2]
    size = x * x + y * y + z * z
    if size > 0.0:
        x, y, z = rotated(x, y, z, slip.ox, slip.oy, slip.oz, time)
        along = x * contact.nx + y * contact.ny + z * contact.nz
        x -= along * contact.nx
        y -= along * contact.ny
        z -= along * contact.nz
        left = x * x + y * y + z * z
        scale = math.sqrt(size / left) if left > 0.0 else 0.0
        x *= scale
        y *= scale
        z *= scale
    return x + time * slip.sx, y + time * slip.sy, z + time * slip.sz


@device
def stretch_after(stretch_pk, p, x, y, z, slip, time):
    """Store the stretch after a time at the present slip: stretched, then turned."""
    x, y, z = x + time * slip.sx, y + time * slip.sy, z + time * slip.sz
    x, y, z = rotated(x, y, z, slip.ox, slip.oy, slip.oz, time)
    stretch_pk[p, 0] = x
    stretch_pk[p, 1] = y
    stretch_pk[p, 2] = z


@device
def slip_in_space(body, contact):
    """Return the slip, with the angular velocity with which the contact turns."""
    i, j, nx, ny, nz, ux, uy, uz, r, sigma = contact
    share = r * (1.0 / sigma)
    ai = body[i, 3] * share
    aj = body[j, 3] * share
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
    return Slip(ai, aj, sx, sy, sz, ox, oy, oz)


@device
def slip_in_plane(body, contact):
    """Return arms, and the slip along t = (-ny, nx)."""
    i, j, nx, ny, _, ux, uy, _, r, sigma = contact
    share = r * (1.0 / sigma)
    ai = body[i, 3] * share
    aj = body[j, 3] * share
    return ai, aj, uy * nx - ux * ny - ai * body[i, 6] - aj * body[j, 6]


@device
def with_moment(contact, slip, fx, fy, fz):
    """Return a tangential force on i, its moment for an arm of one, and the arms: the torques are arm times moment."""
    nx, ny, nz = contact.nx, contact.ny, contact.nz
    return fx, fy, fz, ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx, slip.ai, slip.aj


@device
def add_force(axes, spins, push, i, done):
    """Add a pair's force, and its torque where particles turn, to row i."""
    fx, fy, fz, mx, my, mz, ai, _ = done
    push[i, 0] += fx
    push[i, 1] += fy
    if len(axes) == 3:
        push[i, 2] += fz
    if len(spins) == 1:
        push[i, 2] += ai * mz
    if len(spins) == 3:
        push[i, 3] += ai * mx
        push[i, 4] += ai * my
        push[i, 5] += ai * mz


@device
def add_reaction(axes, spins, push, j, done):
    """Add the reaction to row j: the torque has the same sign on both."""
    fx, fy, fz, mx, my, mz, _, aj = done
    push[j, 0] -= fx
    push[j, 1] -= fy
    if len(axes) == 3:
        push[j, 2] -= fz
    if len(spins) == 1:
        push[j, 2] += aj * mz
    if len(spins) == 3:
        push[j, 3] += aj * mx
        push[j, 4] += aj * my
        push[j, 5] += aj * mz


@device
def store_reaction(axes, spins, slot_qk, q, done):
    """Write the reaction to a slot."""
    fx, fy, fz, mx, my, mz, _, aj = done
    slot_qk[q, 0] = -fx
    slot_qk[q, 1] = -fy
    if len(axes) == 3:
        slot_qk[q, 2] = -fz
    if len(spins) == 1:
        slot_qk[q, 2] = aj * mz
    if len(spins) == 3:
        slot_qk[q, 3] = aj * mx
        slot_qk[q, 4] = aj * my
        slot_qk[q, 5] = aj * mz


# a little more than 1/3: oscillations up to omega dt = 1/3 then fall, by less than (omega dt)^4 / 100 a step
_SHARE = 0.35
# (omega dt)^2 of the fastest springs, over stiffness dt^2 / mass: with 6 neighbors, or 12 in space
_FASTEST = {2: 12.0, 3: 24.0}


def stiffening(packing: Packing) -> tuple[float, float]:
    """Return how many fold the stiffness of contacts, and of tangential springs, counts over mass.

    Tangential ones turn particles as well as move them, with the inertia m r^2 / 2 or 2 m r^2 / 5; of other shapes this
    is their own `stiffening`.
    """
    if packing.shapes is not None:
        return packing.shapes.stiffening(packing.radius_n)
    return 1.0, 3.0 if packing.dimension == 2 else 3.5


def leading_share(scene: Scene, dt: float, smallest_mass: float) -> float:
    """Return the share of the forces' last change that belongs in extrapolated velocities [1].

    None, unless some tangential spring k has a dashpot c so weak that what it takes, (c / 2k) omega^2 dt of an
    oscillation in every step, is less than the growth.

    Parameters
    ----------
    scene
        The scene.
    dt, smallest_mass
        Time step, and the smallest mass.

    """
    springs = []
    for one in scene.effects:
        if isinstance(one, Friction) and one.coefficient > 0.0:
            springs.append((one.stiffness, one.damping))
        if isinstance(one, Bonds) and len(one):
            springs.append((one.tangential_stiffness, one.tangential_damping))
    fastest = _FASTEST[scene.packing.dimension] * stiffening(scene.packing)[1]
    weak = 0.25 * fastest * dt**3 / smallest_mass
    return _SHARE if any(k > 0.0 and c < weak * k * k for k, c in springs) else 0.0


def uncapped_force(friction: Any, stretch: float, slip: float) -> float:
    """Return the tangential force of a friction before its cap [force]."""
    return float(friction.tangential_force(stretch, slip))


@compiled_form(uncapped_force)
def _choose_uncapped_force(friction: Any, stretch: Any, slip: Any) -> Any:
    function = hook_of(friction, "tangential_force")
    if function is None:
        return None
    return lambda friction, stretch, slip: function(friction, stretch, slip)


def turning_axes(friction: Any, axes: Any) -> Any:
    """Return a tuple as long as the torques that a pair has: none without friction, 1 in a plane, 3 in space."""
    return () if friction is None else axes if len(axes) == 3 else axes[:1]


@compiled_form(turning_axes)
def _choose_turning_axes(friction: Any, axes: Any) -> Any:
    if isinstance(friction, types.NoneType):
        return lambda friction, axes: ()
    return (lambda friction, axes: axes) if len(axes) == 3 else (lambda friction, axes: (0,))


@device
def spring_in_plane(friction, stretch_pk, p, slip, normal, pace):
    """Return the tangential force of a contact in a plane, its spring taken along."""
    stretch = stretch_pk[p, 0] + pace.before * slip
    force = uncapped_force(friction, stretch, slip)
    cap = friction.coefficient * normal
    soft = 1.0 / friction.stiffness
    # no branch predictor knows which contacts slide: without a branch, what the cap takes is taken off the spring too;
    # never past rest nor beyond what it was, so that a strong dashpot does not wind it
    capped = min(max(force, -cap), cap)
    less = stretch + (capped - force) * soft
    stretch = min(max(less, min(stretch, 0.0)), max(stretch, 0.0))
    stretch_pk[p, 0] = stretch + pace.after * slip
    return capped


@device
def _friction_in_plane(friction, body, stretch_pk, p, contact, normal, pace):
    ai, aj, slip = slip_in_plane(body, contact)
    force = spring_in_plane(friction, stretch_pk, p, slip, normal, pace)
    # along t = (-ny, nx); the moment n x t is one
    return force * -contact.ny, force * contact.nx, 0.0, 0.0, 0.0, force, ai, aj


@device
def spring_in_space(friction, stretch_pk, p, contact, slip, normal, pace):
    """Return the tangential force of a contact in space, its spring taken along."""
    x, y, z = stretch_before(stretch_pk, p, contact, slip, pace.before)
    fx = uncapped_force(friction, x, slip.sx)
    fy = uncapped_force(friction, y, slip.sy)
    fz = uncapped_force(friction, z, slip.sz)
    square = fx * fx + fy * fy + fz * fz
    cap = friction.coefficient * normal
    soft = 1.0 / friction.stiffness
    if square > cap * cap:
        size = math.sqrt(square)
        # as in a plane: the spring gives way along the force, and no farther than to rest
        along = (x * fx + y * fy + z * fz) / size
        less = min((size - cap) * soft, max(along, 0.0)) / size
        x -= less * fx
        y -= less * fy
        z -= less * fz
        scale = cap / size
        fx *= scale
        fy *= scale
        fz *= scale
    stretch_after(stretch_pk, p, x, y, z, slip, pace.after)
    return fx, fy, fz


@device
def _friction_in_space(friction, body, stretch_pk, p, contact, normal, pace):
    slip = slip_in_space(body, contact)
    fx, fy, fz = spring_in_space(friction, stretch_pk, p, contact, slip, normal, pace)
    return with_moment(contact, slip, fx, fy, fz)


@device
def tangential_force_of_pair(friction, axes, body, stretch_pk, p, contact, normal, pace):
    """Return the friction on i of a touching pair, its moment and arms; zeros without."""
    if friction is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if len(axes) == 2:
        return _friction_in_plane(friction, body, stretch_pk, p, contact, normal, pace)
    return _friction_in_space(friction, body, stretch_pk, p, contact, normal, pace)


@device
def stretch_now(axes, stretch_pk, p, sx, sy, sz, ox, oy, oz, after):
    """Return the stretch at this time, from the one that a pass has taken half a step ahead."""
    if len(axes) == 2:
        return stretch_pk[p, 0] - after * sx, 0.0, 0.0
    x, y, z = rotated(stretch_pk[p, 0], stretch_pk[p, 1], stretch_pk[p, 2], ox, oy, oz, -after)
    return x - after * sx, y - after * sy, z - after * sz


@device
def along_contact(axes, nx, ny, x, y, z):
    """Return a tangential vector in Cartesian components."""
    if len(axes) == 2:
        return x * -ny, x * nx, 0.0
    return x, y, z


@inlined
def measure_spring(friction, axes, stretch_pk, p, nx, ny, sx, sy, sz, ox, oy, oz, normal, after):
    """Return energy of a tangential spring, whether it slides, and its force on i."""
    x, y, z = stretch_now(axes, stretch_pk, p, sx, sy, sz, ox, oy, oz, after)
    cap = friction.coefficient * normal
    if len(axes) == 2:
        fx, fy, fz = uncapped_force(friction, x, sx), 0.0, 0.0
        size = abs(fx)
        square = x * x
    else:
        fx, fy, fz = uncapped_force(friction, x, sx), uncapped_force(friction, y, sy), uncapped_force(friction, z, sz)
        size = math.sqrt(fx * fx + fy * fy + fz * fz)
        square = x * x + y * y + z * z
    # a spring at its cap is as far as it gets: rounding must not tell it from one beyond
    sliding = 1.0 if size >= cap * (1.0 - 1e-9) else 0.0
    if size > cap:
        scale = cap / size
        fx, fy, fz = fx * scale, fy * scale, fz * scale
    fx, fy, fz = along_contact(axes, nx, ny, fx, fy, fz)
    return 0.5 * friction.stiffness * square, sliding, fx, fy, fz


@device
def reset_stretch(axes, stretch_pk, p):
    """Set the stretch of a pair that does not touch to zero; nothing where no stretches are held."""
    if stretch_pk is not None:
        stretch_pk[p, 0] = 0.0
        if len(axes) == 3:
            stretch_pk[p, 1] = 0.0
            stretch_pk[p, 2] = 0.0
