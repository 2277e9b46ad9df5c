# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What can be seen of a march at one moment, in one pass; looking changes no bit of what follows.

Sums over pairs count each contact once, with its branch vector through the image at which it touches, and each bond.
"""

from __future__ import annotations

import math
from typing import Any

from numba import literal_unroll, types

from packmech.compiled import compiled_form, device, kernel
from packmech.dynamics.march.bonding import bond_first, bond_vector
from packmech.dynamics.march.flow import GAMMA, gamma_at, is_still, rates, with_flow
from packmech.dynamics.march.lists import held_of
from packmech.dynamics.march.rubbing import slide
from packmech.dynamics.march.springs import slip_in_space, spun
from packmech.effects import body_energy, law_energy, pair_energy, pair_first

# columns of a ledger
TIME, STRAIN, RATE = 0, 1, 2
POTENTIAL, TANGENTIAL, KINETIC, ROTATIONAL = 3, 4, 5, 6
CONTACTS, SLIDING, MOST, TOTAL = 7, 8, 9, 10
# 3 x 3 sums, row by row: force on i times branch vector over contacts and bonds; bonds alone; m c c; I/2 (w w - w^2 1)
FORCE, BONDED, MOTION, SPINNING = 11, 20, 29, 38
# 3 numbers each: sum of torques, of m c, of x cross m v + I w; then the sum of m |c|
TORQUE, MOMENTUM, ANGULAR, IMPULSE = 47, 50, 53, 56
COLUMNS = 57


@device
def _enter(out, place, fx, fy, fz, dx, dy, dz):
    out[place] += fx * dx
    out[place + 1] += fx * dy
    out[place + 2] += fx * dz
    out[place + 3] += fy * dx
    out[place + 4] += fy * dy
    out[place + 5] += fy * dz
    out[place + 6] += fz * dx
    out[place + 7] += fz * dy
    out[place + 8] += fz * dz


@device
def _torques(out, ai, aj, nx, ny, nz, fx, fy, fz):
    arm = ai + aj
    out[TORQUE] += arm * (ny * fz - nz * fy)
    out[TORQUE + 1] += arm * (nz * fx - nx * fz)
    out[TORQUE + 2] += arm * (nx * fy - ny * fx)


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


@device
def _rubbed(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace, out):
    """Return the frictional force on i; its spring's energy, its torques and whether it slides go to `out`."""
    ai, aj, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_now(axes, held_pk, p, sx, sy, sz, ox, oy, oz, pace.after)
    fx, fy, fz = slide(friction, x, sx), slide(friction, y, sy), slide(friction, z, sz)
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    cap = friction.coefficient * normal
    # a spring at its cap is as far as it gets: rounding must not tell it from one beyond
    if size >= cap * (1.0 - 1e-9):
        out[SLIDING] += 1.0
    if size > cap:
        fx, fy, fz = fx * cap / size, fy * cap / size, fz * cap / size
    out[TANGENTIAL] += 0.5 * friction.stiffness * (x * x + y * y + z * z)
    fx, fy, fz = along_contact(axes, nx, ny, fx, fy, fz)
    _torques(out, ai, aj, nx, ny, nz, fx, fy, fz)
    return fx, fy, fz


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
    out: Any,
) -> tuple[float, float, float]:
    """Return the frictional force on i; zero where the scene has none."""
    raise NotImplementedError("a march is looked at in compiled loops")


@compiled_form(rubbed)
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
    out: Any,
) -> Any:
    if isinstance(friction, types.NoneType):

        def none(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace, out):
            return 0.0, 0.0, 0.0

        return none

    def some(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace, out):
        return _rubbed(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace, out)

    return some


@device
def _relative(axes, flowing, body, i, j, dx, dy, dz):
    ux = body[j, 4] - body[i, 4]
    uy = body[j, 5] - body[i, 5]
    uz = body[j, 6] - body[i, 6] if len(axes) == 3 else 0.0
    return with_flow(flowing, ux, uy, uz, dx, dy, dz)


@device
def touch(body, i, j, dx, dy, dz):
    """Whether two particles that are so far apart touch."""
    sigma = body[i, 3] + body[j, 3]
    return dx * dx + dy * dy + dz * dz < sigma * sigma


def look_at_pair(
    effects: Any,
    friction: Any,
    flowing: Any,
    axes: Any,
    body: Any,
    held_pk: Any,
    p: int,
    i: int,
    j: int,
    dx: float,
    dy: float,
    dz: float,
    pace: Any,
    out: Any,
) -> None:
    """Add what a touching pair does; nothing where no effect acts on touching pairs."""
    raise NotImplementedError("a march is looked at in compiled loops")


@compiled_form(look_at_pair)
def _choose_look_at_pair(
    effects: Any,
    friction: Any,
    flowing: Any,
    axes: Any,
    body: Any,
    held_pk: Any,
    p: Any,
    i: Any,
    j: Any,
    dx: Any,
    dy: Any,
    dz: Any,
    pace: Any,
    out: Any,
) -> Any:
    if isinstance(effects, types.NoneType):
        return lambda effects, friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace, out: None

    def some(effects, friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace, out):
        _look_at_pair(effects, friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace, out)

    return some


@device
def _look_at_pair(effects, friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace, out):
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    sigma = body[i, 3] + body[j, 3]
    # coincident centers have an energy, but no branch vector and so no stress
    inverse = 1.0 / r if r > 0.0 else 0.0
    nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
    ux, uy, uz = _relative(axes, flowing, body, i, j, dx, dy, dz)
    rate = ux * nx + uy * ny + uz * nz
    energy = 0.0
    first = 0.0
    elastic = 0.0
    for one in literal_unroll(effects):
        energy += pair_energy(one, r, sigma)
        first += pair_first(one, r, sigma, rate)
        elastic += pair_first(one, r, sigma, 0.0)
    out[POTENTIAL] += energy
    out[CONTACTS] += 1.0
    out[TOTAL] += abs(elastic)
    fx, fy, fz = rubbed(
        friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, abs(elastic), pace, out
    )
    _enter(out, FORCE, first * nx + fx, first * ny + fy, first * nz + fz, dx, dy, dz)


@device
def _look_at_bonds(bonds, flowing, axes, body, lattice, pace, out):
    for b in range(bonds.i_b.shape[0]):
        i, j = bonds.i_b[b], bonds.j_b[b]
        dx, dy, dz = bond_vector(axes, body, bonds.image_bd, lattice, b, i, j)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        if r == 0.0:
            continue
        nx, ny, nz = dx / r, dy / r, dz / r
        ux, uy, uz = _relative(axes, flowing, body, i, j, dx, dy, dz)
        sigma = body[i, 3] + body[j, 3]
        rest = bonds.rest_b[b]
        first = bond_first(bonds.compression, bonds.tension, r, rest) + bonds.damping * (ux * nx + uy * ny + uz * nz)
        out[POTENTIAL] += law_energy(bonds.compression, r, rest) if r < rest else law_energy(bonds.tension, r, rest)
        ai, aj, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
        x, y, z = stretch_now(axes, bonds.stretch_bk, b, sx, sy, sz, ox, oy, oz, pace.after)
        k, c = bonds.tangential_stiffness, bonds.tangential_damping
        out[TANGENTIAL] += 0.5 * k * (x * x + y * y + z * z)
        fx, fy, fz = along_contact(axes, nx, ny, k * x + c * sx, k * y + c * sy, k * z + c * sz)
        _torques(out, ai, aj, nx, ny, nz, fx, fy, fz)
        _enter(out, FORCE, first * nx + fx, first * ny + fy, first * nz + fz, dx, dy, dz)
        _enter(out, BONDED, first * nx + fx, first * ny + fy, first * nz + fz, dx, dy, dz)


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


def energy_of_bodies(bodies: Any, body: Any, mass_n: Any) -> float:
    """Return the energy of single particles under what acts on them."""
    raise NotImplementedError("a march is looked at in compiled loops")


@compiled_form(energy_of_bodies)
def _choose_energy_of_bodies(bodies: Any, body: Any, mass_n: Any) -> Any:
    if isinstance(bodies, types.NoneType):
        return lambda bodies, body, mass_n: 0.0

    def total(bodies, body, mass_n):
        energy = 0.0
        for i in range(body.shape[0]):
            for one in literal_unroll(bodies):
                energy += body_energy(one, body[i, 0], body[i, 1], body[i, 2], mass_n[i], body[i, 3])
        return energy

    return total


def strain_of(flow: Any, time: float) -> tuple[float, float]:
    """Return gamma and its rate; zeros where nothing deforms."""
    return (0.0, 0.0) if flow is None else (float(flow.number[GAMMA]), gamma_at(flow.profile, time)[1])


@compiled_form(strain_of)
def _choose_strain_of(flow: Any, time: Any) -> Any:
    if is_still(flow):
        return lambda flow, time: (0.0, 0.0)
    return lambda flow, time: (flow.number[GAMMA], gamma_at(flow.profile, time)[1])


@device
def _look_at_motion(axes, state, flowing, out):
    d = len(axes)
    body, mass_n, weight = state.body, state.mass_n, state.weight_nk
    for i in range(body.shape[0]):
        m = mass_n[i]
        u, v = body[i, 4], body[i, 5]
        w = body[i, 6] if d == 3 else 0.0
        out[KINETIC] += 0.5 * m * (u * u + v * v + w * w)
        out[IMPULSE] += m * math.sqrt(u * u + v * v + w * w)
        _enter(out, MOTION, m * u, m * v, m * w, u, v, w)
        out[MOMENTUM] += m * u
        out[MOMENTUM + 1] += m * v
        out[MOMENTUM + 2] += m * w
        x, y, z = body[i, 0], body[i, 1], body[i, 2]
        u, v, w = with_flow(flowing, u, v, w, x, y, z)
        out[ANGULAR] += m * (y * w - z * v)
        out[ANGULAR + 1] += m * (z * u - x * w)
        out[ANGULAR + 2] += m * (x * v - y * u)
        if state.push.shape[1] > d:
            inertia = 1.0 / weight[i, 1] if weight[i, 1] > 0.0 else 0.0
            p = q = 0.0
            r = body[i, 6] if d == 2 else body[i, 9]
            if d == 3:
                p, q = body[i, 7], body[i, 8]
            square = p * p + q * q + r * r
            out[ROTATIONAL] += 0.5 * inertia * square
            half = 0.5 * inertia
            _enter(out, SPINNING, half * p, half * q, half * r, p, q, r)
            out[SPINNING] -= half * square
            out[SPINNING + 4] -= half * square
            out[SPINNING + 8] -= half * square
            out[ANGULAR] += inertia * p
            out[ANGULAR + 1] += inertia * q
            out[ANGULAR + 2] += inertia * r
        square = 0.0
        for a in range(d):
            square += state.push[i, a] * state.push[i, a]
        out[MOST] = max(out[MOST], math.sqrt(square))


@kernel
def look(acting, axes, state, space, pairs, track, time, pace, out):
    """Write the figures of the present moment, in the columns named above."""
    for k in range(COLUMNS):
        out[k] = 0.0
    flowing = rates(space.flow)
    out[TIME] = time
    out[STRAIN], out[RATE] = strain_of(space.flow, time)
    body = state.body
    held_pk = held_of(track)
    for s in range(pairs.start_s.shape[0] - 1):
        for p in range(pairs.start_s[s], pairs.start_s[s + 1]):
            i, j = pairs.i_p[p], pairs.j_p[p]
            dx, dy, dz = body[j, 0] - body[i, 0], body[j, 1] - body[i, 1], body[j, 2] - body[i, 2]
            if s % 2 == 1:
                k = pairs.image_p[p]
                dx += pairs.shift_kd[k, 0]
                dy += pairs.shift_kd[k, 1]
                dz += pairs.shift_kd[k, 2]
            if touch(body, i, j, dx, dy, dz):
                look_at_pair(
                    acting.pairs, acting.friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace, out
                )
    look_at_bonds(space.bonds, flowing, axes, body, space.frame.lattice_dd, pace, out)
    out[POTENTIAL] += energy_of_bodies(acting.bodies, body, state.mass_n)
    _look_at_motion(axes, state, flowing, out)
