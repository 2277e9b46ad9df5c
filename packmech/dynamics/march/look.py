# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What can be seen of a march at one moment, in one pass; looking changes no bit of what follows.

Sums over pairs count each contact once, with its branch vector through the image at which it touches, and each bond.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import literal_unroll, types

from packmech.compiled import compiled_form, device
from packmech.dynamics.march.bonding import bond_first, bond_vector
from packmech.dynamics.march.figures import (
    ANGULAR,
    BONDED,
    COLUMNS,
    CONTACTS,
    FORCE,
    IMPULSE,
    KINETIC,
    MOMENTUM,
    MOST,
    MOTION,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    SPINNING,
    STRAIN,
    TANGENTIAL,
    TIME,
    TORQUE,
    TOTAL,
    dyad,
    energy_of_bodies,
    look_at_motion,
    moment,
    write,
)
from packmech.dynamics.march.flow import GAMMA, gamma_at, is_still, rates, relative
from packmech.dynamics.march.inlined import inlined, inlined_form, lean
from packmech.dynamics.march.rubbing import slide
from packmech.dynamics.march.springs import slip_in_space, spun
from packmech.effects import law_energy, pair_elastic, pair_energy, pair_first

__all__ = [
    "ANGULAR",
    "BONDED",
    "COLUMNS",
    "CONTACTS",
    "FORCE",
    "IMPULSE",
    "KINETIC",
    "MOMENTUM",
    "MOST",
    "MOTION",
    "POTENTIAL",
    "RATE",
    "ROTATIONAL",
    "SLIDING",
    "SPINNING",
    "STRAIN",
    "TANGENTIAL",
    "TIME",
    "TORQUE",
    "TOTAL",
    "along_contact",
    "look",
    "look_into",
    "seen_pair",
    "slip_of",
    "stretch_now",
    "touch",
]


@device
def stretch_now(axes, held_pk, p, sx, sy, sz, ox, oy, oz, after):
    """Return the stretch at the present moment, from the one that a pass has led half a step ahead."""
    if len(axes) == 2:
        return held_pk[p, 0] - after * sx, 0.0, 0.0
    x, y, z = spun(held_pk[p, 0], held_pk[p, 1], held_pk[p, 2], ox, oy, oz, -after)
    return x - after * sx, y - after * sy, z - after * sz


@device
def slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma):
    """Return arms, the slip (its first number in a plane), and how fast the contact turns."""
    if len(axes) == 2:
        ai = body[i, 3] * r / sigma
        aj = body[j, 3] * r / sigma
        slip = ux * -ny + uy * nx - ai * body[i, 6] - aj * body[j, 6]
        return ai, aj, slip, 0.0, 0.0, 0.0, 0.0, 0.0
    return slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)


@device
def along_contact(axes, nx, ny, x, y, z):
    """Return a tangential vector in Cartesian components."""
    if len(axes) == 2:
        return x * -ny, x * nx, 0.0
    return x, y, z


def rubbed(
    friction: Any,
    axes: Any,
    body: Any,
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
    pace: Any,
) -> tuple[float, float, float, float, float, float, float]:
    """Return energy of a tangential spring, whether it slides, its force on i, and arms; zeros without friction."""
    raise NotImplementedError("a march is looked at in compiled loops")


@inlined
def _rubbed(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
    ai, aj, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_now(axes, held_pk, p, sx, sy, sz, ox, oy, oz, pace.after)
    cap = friction.coefficient * normal
    if len(axes) == 2:
        fx, fy, fz = slide(friction, x, sx), 0.0, 0.0
        size = abs(fx)
        square = x * x
    else:
        fx, fy, fz = slide(friction, x, sx), slide(friction, y, sy), slide(friction, z, sz)
        size = math.sqrt(fx * fx + fy * fy + fz * fz)
        square = x * x + y * y + z * z
    # a spring at its cap is as far as it gets: rounding must not tell it from one beyond
    sliding = 1.0 if size >= cap * (1.0 - 1e-9) else 0.0
    if size > cap:
        scale = cap / size
        fx, fy, fz = fx * scale, fy * scale, fz * scale
    fx, fy, fz = along_contact(axes, nx, ny, fx, fy, fz)
    return 0.5 * friction.stiffness * square, sliding, fx, fy, fz, ai, aj


@inlined_form(rubbed)
def _choose_rubbed(
    friction: Any,
    axes: Any,
    body: Any,
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

        def none(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0

        return none

    def some(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
        return _rubbed(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace)

    return some


@device
def touch(body, i, j, dx, dy, dz):
    """Whether two particles that are so far apart touch."""
    sigma = body[i, 3] + body[j, 3]
    return dx * dx + dy * dy + dz * dz < sigma * sigma


@inlined
def seen_pair(effects, friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace):
    """Return what a touching pair does: two energies, whether it slides, elastic force, force on i, n, and arms."""
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    sigma = body[i, 3] + body[j, 3]
    # coincident centers have an energy, but no branch vector and so no stress
    inverse = 1.0 / r if r > 0.0 else 0.0
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    rate = ux * nx + uy * ny + uz * nz
    energy = 0.0
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        energy += pair_energy(one, r, sigma)
        first += pair_first(one, r, sigma, rate)
        elastic += pair_elastic(one, r, sigma)
    normal = abs(elastic)
    spring, sliding, fx, fy, fz, ai, aj = rubbed(
        friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace
    )
    return energy, spring, sliding, normal, (first * nx, first * ny, first * nz), (fx, fy, fz), (nx, ny, nz), (ai, aj)


def look_at_pairs(
    acting: Any, flowing: Any, axes: Any, body: Any, pairs: Any, held_pk: Any, pace: Any, out: Any
) -> None:
    """Write the figures of touching pairs; nothing where no effect acts on them."""
    raise NotImplementedError("a march is looked at in compiled loops")


@inlined_form(look_at_pairs)
def _choose_look_at_pairs(
    acting: Any, flowing: Any, axes: Any, body: Any, pairs: Any, held_pk: Any, pace: Any, out: Any
) -> Any:
    if isinstance(acting[0], types.NoneType):
        return lambda acting, flowing, axes, body, pairs, held_pk, pace, out: None
    return lambda acting, flowing, axes, body, pairs, held_pk, pace, out: _look_at_pairs(
        acting, flowing, axes, body, pairs, held_pk, pace, out
    )


@inlined
def _look_at_pairs(acting, flowing, axes, body, pairs, held_pk, pace, out):
    potential = tangential = contacts = slides = total = 0.0
    force = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    torque = (0.0, 0.0, 0.0)
    i_p, j_p, image_p, shift_kd = pairs.i_p, pairs.j_p, pairs.image_p, pairs.shift_kd
    for s in range(pairs.start_s.shape[0] - 1):
        for p in range(np.uint64(pairs.start_s[s]), np.uint64(pairs.start_s[s + 1])):
            i, j = i_p[p], j_p[p]
            dx, dy, dz = body[j, 0] - body[i, 0], body[j, 1] - body[i, 1], 0.0
            if len(axes) == 3:
                dz = body[j, 2] - body[i, 2]
            if s % 2 == 1:
                k = image_p[p]
                dx += shift_kd[k, 0]
                dy += shift_kd[k, 1]
                if len(axes) == 3:
                    dz += shift_kd[k, 2]
            if touch(body, i, j, dx, dy, dz):
                energy, spring, sliding, normal, (gx, gy, gz), (fx, fy, fz), (nx, ny, nz), (ai, aj) = seen_pair(
                    acting.pairs, acting.friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace
                )
                potential += energy
                tangential += spring
                contacts += 1.0
                slides += sliding
                total += normal
                force = dyad(axes, force, gx + fx, gy + fy, gz + fz, dx, dy, dz)
                torque = moment(axes, torque, ai, aj, nx, ny, nz, fx, fy, fz)
    out[POTENTIAL] = potential
    out[TANGENTIAL] = tangential
    out[CONTACTS] = contacts
    out[SLIDING] = slides
    out[TOTAL] = total
    write(out, FORCE, force)
    write(out, TORQUE, torque)


@inlined
def _look_at_bonds(bonds, flowing, axes, body, lattice, pace, out):
    potential = tangential = 0.0
    force = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    torque = (0.0, 0.0, 0.0)
    for b in range(np.uint64(bonds.i_b.shape[0])):
        i, j = bonds.i_b[b], bonds.j_b[b]
        dx, dy, dz = bond_vector(axes, body, bonds.image_bd, lattice, b, i, j)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        if r == 0.0:
            continue
        nx, ny, nz = dx / r, dy / r, dz / r
        ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
        sigma = body[i, 3] + body[j, 3]
        rest = bonds.rest_b[b]
        first = bond_first(bonds.compression, bonds.tension, r, rest) + bonds.damping * (ux * nx + uy * ny + uz * nz)
        potential += law_energy(bonds.compression, r, rest) if r < rest else law_energy(bonds.tension, r, rest)
        ai, aj, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
        x, y, z = stretch_now(axes, bonds.stretch_bk, b, sx, sy, sz, ox, oy, oz, pace.after)
        k, c = bonds.tangential_stiffness, bonds.tangential_damping
        tangential += 0.5 * k * (x * x + y * y + z * z)
        fx, fy, fz = along_contact(axes, nx, ny, k * x + c * sx, k * y + c * sy, k * z + c * sz)
        force = dyad(axes, force, first * nx + fx, first * ny + fy, first * nz + fz, dx, dy, dz)
        torque = moment(axes, torque, ai, aj, nx, ny, nz, fx, fy, fz)
    out[POTENTIAL] += potential
    out[TANGENTIAL] += tangential
    for k in range(9):
        out[FORCE + k] += force[k]
        out[BONDED + k] = force[k]
    for k in range(3):
        out[TORQUE + k] += torque[k]


def look_at_bonds(bonds: Any, flowing: Any, axes: Any, body: Any, lattice: Any, pace: Any, out: Any) -> None:
    """Add what bonds do; nothing where the scene has none."""
    raise NotImplementedError("a march is looked at in compiled loops")


@compiled_form(look_at_bonds)
def _choose_look_at_bonds(bonds: Any, flowing: Any, axes: Any, body: Any, lattice: Any, pace: Any, out: Any) -> Any:
    if isinstance(bonds, types.NoneType):
        return lambda bonds, flowing, axes, body, lattice, pace, out: None
    return lambda bonds, flowing, axes, body, lattice, pace, out: _look_at_bonds(
        bonds, flowing, axes, body, lattice, pace, out
    )


def strain_of(flow: Any, time: float) -> tuple[float, float]:
    """Return gamma and its rate; zeros where nothing deforms."""
    return (0.0, 0.0) if flow is None else (float(flow.number[GAMMA]), gamma_at(flow.profile, time)[1])


@compiled_form(strain_of)
def _choose_strain_of(flow: Any, time: Any) -> Any:
    if is_still(flow):
        return lambda flow, time: (0.0, 0.0)
    return lambda flow, time: (flow.number[GAMMA], gamma_at(flow.profile, time)[1])


@inlined
def look_into(acting, axes, state, space, pairs, track, time, pace, out):
    """Write the figures of the present moment, in the columns named above."""
    for k in range(COLUMNS):
        out[k] = 0.0
    flowing = rates(space.flow)
    out[TIME] = time
    out[STRAIN], out[RATE] = strain_of(space.flow, time)
    body = state.body
    held_pk = None if track is None else track.inner_pk
    look_at_pairs(acting, flowing, axes, body, pairs, held_pk, pace, out)
    look_at_bonds(space.bonds, flowing, axes, body, space.frame.lattice_dd, pace, out)
    out[POTENTIAL] += energy_of_bodies(acting.bodies, body, state.mass_n)
    look_at_motion(axes, state, flowing, out)


@lean
def look(acting, axes, state, space, pairs, track, time, pace, out):
    """Write the figures of the present moment, in the columns named above."""
    look_into(acting, axes, state, space, pairs, track, time, pace, out)
