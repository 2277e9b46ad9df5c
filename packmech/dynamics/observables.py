# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What is measured of a time-stepped packing, in one pass; it changes no bit of what follows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.constraints.compiled_links import ERROR
from packmech.constraints.rattle import measure_tensions
from packmech.dynamics.bonds import bond_first, bond_vector
from packmech.dynamics.deformation import GAMMA, gamma_at, rates, relative, turning, with_flow
from packmech.dynamics.friction import Contact, along_contact, measure_spring, slip_in_space, stretch_now
from packmech.dynamics.shape_pairs import energy_of_row, measure_shapes, spinning_shapes
from packmech.effects import law_energy, pair_elastic, pair_energy, pair_first, spin_drag
from packmech.jit.compiled import device, inlined, lean

# columns of a row of observables
TIME, STRAIN, RATE = 0, 1, 2
POTENTIAL, TANGENTIAL, KINETIC, ROTATIONAL = 3, 4, 5, 6
CONTACTS, SLIDING, LARGEST_FORCE, TOTAL = 7, 8, 9, 10
# 3 x 3 sums, row by row: force on i times branch vector over contacts and bonds; bonds alone; m c c; I/2 (w w - w^2 1)
FORCE, BONDED, MOTION, SPINNING = 11, 20, 29, 38
# 3 numbers each: sum of torques, of m c, of x cross m v + I w; then the sum of m |c|
TORQUE, MOMENTUM, ANGULAR, IMPULSE = 47, 50, 53, 56
# 3 x 3 sums, row by row, of the force on i times branch vector over links; the largest error of a link over its scale
LINKED, LINK_ERROR = 57, 66
# power of what moves particles that are held, and of a flow whose drag turns particles
MOVING = 67
COLUMNS = 68


@inlined
def dyad(axes, sums, fx, fy, fz, dx, dy, dz):
    """Return nine sums, row by row, with a product of two vectors added; a plane's third axis stays zero."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = sums
    xx += fx * dx
    xy += fx * dy
    yx += fy * dx
    yy += fy * dy
    if len(axes) == 3:
        xz += fx * dz
        yz += fy * dz
        zx += fz * dx
        zy += fz * dy
        zz += fz * dz
    return xx, xy, xz, yx, yy, yz, zx, zy, zz


@inlined
def moment(axes, sums, ai, aj, nx, ny, nz, fx, fy, fz):
    """Return three sums of torques with those of a tangential force added."""
    mx, my, mz = sums
    arm = ai + aj
    mz += arm * (nx * fy - ny * fx)
    if len(axes) == 3:
        mx += arm * (ny * fz - nz * fy)
        my += arm * (nz * fx - nx * fz)
    return mx, my, mz


@device
def write(out, place, sums):
    """Write a tuple of sums to a row of observables."""
    for k in range(len(sums)):
        out[place + k] = sums[k]


@device
def energy_of_bodies(shapes, bodies, body, mass_n):
    """Return the energy of single particles under what acts on them."""
    energy = 0.0
    if bodies is not None:
        for i in range(body.shape[0]):
            for one in literal_unroll(bodies):
                energy += energy_of_row(one, shapes, body, i, mass_n[i])
    return energy


@device
def power_of_turning(bodies, axes, state, flowing):
    """Return what a flow gives to spins by drag, which takes angular momentum at its rate: rate w.I.w_flow [power]."""
    power = 0.0
    if bodies is not None and len(state.spins) > 0:
        d = len(axes)
        body, weight = state.body, state.weight_nk
        wx, wy, wz = turning(flowing)
        rate = 0.0
        for one in literal_unroll(bodies):
            rate += spin_drag(one)
        for i in range(body.shape[0]):
            # rows hold angular momenta over these moments of inertia
            if weight[i, 1] > 0.0:
                along = body[i, 6] * wz if d == 2 else body[i, 7] * wx + body[i, 8] * wy + body[i, 9] * wz
                power += rate / weight[i, 1] * along
    return power


@inlined
def measure_motion(axes, state, flowing, out):
    """Write the observables of single particles and their motion."""
    d = len(axes)
    body, push, mass_n, weight = state.body, state.push, state.mass_n, state.weight_nk
    kinetic = rotational = impulse = largest = moving = 0.0
    motion = spinning = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    px = py = pz = lx = ly = lz = 0.0
    for i in range(np.uint64(body.shape[0])):
        m = mass_n[i]
        u, v, w = body[i, 4], body[i, 5], 0.0
        x, y, z = body[i, 0], body[i, 1], 0.0
        if d == 3:
            w, z = body[i, 6], body[i, 2]
        square = u * u + v * v + w * w
        kinetic += 0.5 * m * square
        impulse += m * math.sqrt(square)
        motion = dyad(axes, motion, m * u, m * v, m * w, u, v, w)
        px += m * u
        py += m * v
        pz += m * w
        u, v, w = with_flow(flowing, u, v, w, x, y, z)
        lz += m * (x * v - y * u)
        if d == 3:
            lx += m * (y * w - z * v)
            ly += m * (z * u - x * w)
        if len(state.spins) > 0:
            inertia = 1.0 / weight[i, 1] if weight[i, 1] > 0.0 else 0.0
            half = 0.5 * inertia
            p = q = 0.0
            r = body[i, 4 + d + len(state.spins) - 1]
            if d == 3:
                p, q = body[i, 7], body[i, 8]
                lx += inertia * p
                ly += inertia * q
            lz += inertia * r
            square = p * p + q * q + r * r
            rotational += half * square
            spinning = dyad(axes, spinning, half * p, half * q, half * r, p, q, r)
        square = along = 0.0
        for a in range(d):
            square += push[i, a] * push[i, a]
            along += push[i, a] * body[i, 4 + a]
        # what holds a particle takes up its net force
        if weight[i, 0] > 0.0:
            largest = max(largest, square)
        else:
            moving -= along
    out[KINETIC] = kinetic
    out[ROTATIONAL] = rotational
    out[IMPULSE] = impulse
    out[LARGEST_FORCE] = math.sqrt(largest)
    out[MOVING] = moving
    write(out, MOTION, motion)
    write(out, SPINNING, spinning)
    # w w - w^2 1, whose last number is zero in a plane
    for k in range(d):
        out[SPINNING + 4 * k] -= rotational
    write(out, MOMENTUM, (px, py, pz))
    write(out, ANGULAR, (lx, ly, lz))


@device
def slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma):
    """Return arms, the slip (its first number in a plane), and how fast the contact turns."""
    if len(axes) == 2:
        ai = body[i, 3] * r / sigma
        aj = body[j, 3] * r / sigma
        slip = ux * -ny + uy * nx - ai * body[i, 6] - aj * body[j, 6]
        return ai, aj, slip, 0.0, 0.0, 0.0, 0.0, 0.0
    ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, Contact(i, j, nx, ny, nz, ux, uy, uz, r, sigma))
    return ai, aj, sx, sy, sz, ox, oy, oz


@inlined
def measure_friction(friction, axes, body, stretch_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
    """Return energy of a tangential spring, whether it slides, its force on i, and arms; zeros without friction."""
    if friction is None:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # numbers one by one: records here would round some sums in another way
    ai, aj, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    spring, sliding, fx, fy, fz = measure_spring(
        friction, axes, stretch_pk, p, nx, ny, sx, sy, sz, ox, oy, oz, normal, pace.after
    )
    return spring, sliding, fx, fy, fz, ai, aj


@device
def is_touching(body, i, j, dx, dy, dz):
    """Whether two particles that are so far apart touch."""
    sigma = body[i, 3] + body[j, 3]
    return dx * dx + dy * dy + dz * dz < sigma * sigma


@inlined
def measure_pair(effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace):
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
    spring, sliding, fx, fy, fz, ai, aj = measure_friction(
        friction, axes, body, stretch_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace
    )
    return energy, spring, sliding, normal, (first * nx, first * ny, first * nz), (fx, fy, fz), (nx, ny, nz), (ai, aj)


@inlined
def measure_pairs(shapes, effects, friction, flowing, axes, body, pairs, stretch_pk, pace, out):
    """Write the observables of touching pairs; nothing where no effect acts on them."""
    if effects is None:
        return
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
            if shapes is not None:
                touching, energy, spring, sliding, normal, fx, fy, fz = measure_shapes(
                    shapes, effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
                )
                if touching:
                    potential += energy
                    tangential += spring
                    contacts += touching
                    slides += sliding
                    total += normal
                    force = dyad(axes, force, fx, fy, fz, dx, dy, dz)
                    # torques on both make up for that of the forces about either center
                    torque = moment(axes, torque, 1.0, 0.0, dx, dy, dz, fx, fy, fz)
            elif is_touching(body, i, j, dx, dy, dz):
                energy, spring, sliding, normal, (gx, gy, gz), (fx, fy, fz), (nx, ny, nz), (ai, aj) = measure_pair(
                    effects, friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
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
def bond_forces(bonds, flowing, axes, body, pace, b, branch):
    """Return energies of a bond's two springs, its force on i along the bond and across it, n, and arms."""
    i, j = bonds.i_b[b], bonds.j_b[b]
    dx, dy, dz = branch
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = dx / r, dy / r, dz / r
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    rest = bonds.rest_b[b]
    first = bond_first(bonds.compression, bonds.tension, r, rest) + bonds.damping * (ux * nx + uy * ny + uz * nz)
    energy = law_energy(bonds.compression, r, rest) if r < rest else law_energy(bonds.tension, r, rest)
    sigma = body[i, 3] + body[j, 3]
    ai, aj, sx, sy, sz, ox, oy, oz = slip_of(axes, body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_now(axes, bonds.stretch_bk, b, sx, sy, sz, ox, oy, oz, pace.after)
    k, c = bonds.tangential_stiffness, bonds.tangential_damping
    spring = 0.5 * k * (x * x + y * y + z * z)
    across = along_contact(axes, nx, ny, k * x + c * sx, k * y + c * sy, k * z + c * sz)
    return energy, spring, (first * nx, first * ny, first * nz), across, (nx, ny, nz), (ai, aj)


@device
def measure_bonds(bonds, flowing, axes, body, lattice, pace, out):
    """Add what bonds do; nothing where the scene has none."""
    if bonds is None:
        return
    potential = tangential = 0.0
    force = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    torque = (0.0, 0.0, 0.0)
    for b in range(np.uint64(bonds.i_b.shape[0])):
        i, j = bonds.i_b[b], bonds.j_b[b]
        dx, dy, dz = bond_vector(axes, body, bonds.image_bd, lattice, b, i, j)
        if dx * dx + dy * dy + dz * dz == 0.0:
            continue
        energy, spring, (gx, gy, gz), (fx, fy, fz), (nx, ny, nz), (ai, aj) = bond_forces(
            bonds, flowing, axes, body, pace, b, (dx, dy, dz)
        )
        potential += energy
        tangential += spring
        force = dyad(axes, force, gx + fx, gy + fy, gz + fz, dx, dy, dz)
        torque = moment(axes, torque, ai, aj, nx, ny, nz, fx, fy, fz)
    out[POTENTIAL] += potential
    out[TANGENTIAL] += tangential
    for k in range(9):
        out[FORCE + k] += force[k]
        out[BONDED + k] = force[k]
    for k in range(3):
        out[TORQUE + k] += torque[k]


@device
def measure_links(links, axes, state, out):
    """Write what links bear, and the largest net force with them; nothing where nothing is linked."""
    if links is None:
        return
    here = links.here
    out[LARGEST_FORCE] = measure_tensions(links, axes, state.body, state.push)
    out[LINK_ERROR] = links.number[ERROR]
    for r in range(here.i_r.shape[0]):
        size = links.tension_l[here.order_r[r]] * here.distance_r[r]
        for a in range(len(axes)):
            for b in range(len(axes)):
                out[LINKED + 3 * a + b] += size * here.normal_rd[r, a] * here.normal_rd[r, b]


@device
def strain_of(flow, time):
    """Return gamma and its rate; zeros where nothing deforms."""
    if flow is None:
        return 0.0, 0.0
    return flow.number[GAMMA], gamma_at(flow.profile, time)[1]


@inlined
def measure_into(acting, axes, state, links, space, pairs, track, time, pace, out):
    """Write the observables of the present time, in the columns named above."""
    for k in range(COLUMNS):
        out[k] = 0.0
    flowing = rates(space.flow)
    out[TIME] = time
    out[STRAIN], out[RATE] = strain_of(space.flow, time)
    body = state.body
    stretch_pk = None if track is None else track.inner_pk
    measure_pairs(acting.shapes, acting.pairs, acting.friction, flowing, axes, body, pairs, stretch_pk, pace, out)
    measure_bonds(space.bonds, flowing, axes, body, space.frame.lattice_dd, pace, out)
    out[POTENTIAL] += energy_of_bodies(acting.shapes, acting.bodies, body, state.mass_n)
    measure_motion(axes, state, flowing, out)
    out[MOVING] += power_of_turning(acting.bodies, axes, state, flowing)
    spinning_shapes(acting.shapes, axes, state, ROTATIONAL, SPINNING, out)
    measure_links(links, axes, state, out)


@lean
def measure(acting, axes, state, links, space, pairs, track, time, pace, out):
    """Write the observables of the present time, in the columns named above."""
    measure_into(acting, axes, state, links, space, pairs, track, time, pace, out)


class Ledger(NamedTuple):
    """Rows of observables: a row every `every` steps, `written` (one number) of them written."""

    every: int
    row_tk: NDArray[np.float64]
    written: NDArray[np.int64]


def new_ledger(every: int, rows: int) -> Ledger:
    """Return a ledger with room for so many rows."""
    return Ledger(every, np.zeros((rows, COLUMNS)), np.zeros(1, dtype=np.int64))


@device
def append_row(ledger, acting, axes, state, links, space, pairs, track, step, dt, pace):
    """Write the observables of this step; nothing without a ledger."""
    if ledger is not None:
        measure_into(acting, axes, state, links, space, pairs, track, step * dt, pace, ledger.row_tk[ledger.written[0]])
        ledger.written[0] += 1


@device
def is_due(ledger, step):
    """Whether the observables of this step are to be kept."""
    if ledger is None:
        return False
    return step % ledger.every == 0 and ledger.written[0] < ledger.row_tk.shape[0]


def tensors(row_tk: NDArray[np.float64], dimension: int, volume: float) -> dict[str, NDArray[np.float64]]:
    """Return the parts of the stress by name, (..., d, d), Cauchy, tension positive, of rows of observables.

    "contact": forces of contacts and bonds times branch vectors. "torque": half the sum of torques as an antisymmetric
    matrix, which makes up for what is not symmetric in it. "spin": what rotation stretches grains by (the centrifugal
    term, (I/2)(|w|^2 - w w)). "overall": the sum of these three, symmetric (section 10 of the corrected specification
    and section 7.2.2 of its source, in three dimensions too). "kinetic": -sum m c c of the peculiar velocities; in no
    other.
    """
    d = dimension

    def whole(place: int) -> NDArray[np.float64]:
        return np.asarray(row_tk[..., place : place + 9].reshape(*row_tk.shape[:-1], 3, 3)[..., :d, :d] / volume)

    torque = np.zeros((*row_tk.shape[:-1], 3, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        torque[..., a, b] = 0.5 * row_tk[..., TORQUE + c] / volume
        torque[..., b, a] = -torque[..., a, b]
    parts = {"contact": whole(FORCE), "torque": torque[..., :d, :d], "spin": -whole(SPINNING)}
    return {**parts, "overall": sum(parts.values(), np.zeros((d, d))), "kinetic": -whole(MOTION)}


def link_stress(row_tk: NDArray[np.float64], dimension: int, volume: float) -> NDArray[np.float64]:
    """Return the part of the stress that rigid links bear, (..., d, d), Cauchy, tension positive."""
    sums = row_tk[..., LINKED : LINKED + 9].reshape(*row_tk.shape[:-1], 3, 3)
    return np.asarray(sums[..., :dimension, :dimension] / volume)
