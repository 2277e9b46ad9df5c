# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What is measured of a time-stepped packing, in one pass; it changes no bit of what follows."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.constraints.compiled_links import ERROR
from packmech.constraints.rattle import measure_tensions
from packmech.dynamics.bonds import bond_energy, bond_vector, pull_of_bond
from packmech.dynamics.by_shape import energy_of_row, measure_spinning, touch_of_rows, touches_of
from packmech.dynamics.contact_forces import (
    energy_across,
    energy_of,
    has_interactions,
    laws_of,
    pull_beyond,
    pull_of_touch,
)
from packmech.dynamics.deformation import GAMMA, gamma_at, turning, with_flow
from packmech.dynamics.faces import measure_faces
from packmech.dynamics.friction import Now
from packmech.dynamics.wall_friction import energy_at_moving_walls, energy_at_walls, faces_of
from packmech.effects import on_row, spin_drag
from packmech.jit.compiled import compiled_form, device, inlined, lean
from packmech.minimize.passes.pair_list import is_near, visit, walk_pairs

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
# energy of the springs at rough walls, part of TANGENTIAL, and what these can hold at their limits
AT_WALLS, HELD_AT_WALLS = 68, 69
# kinetic energy of faces that hold stresses, and minus the work of what moves faces, which is none of POTENTIAL
OF_FACES, BEHIND_FACES = 70, 71
COLUMNS = 72


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
                energy += energy_of_row(shapes, on_row(one, i), body, i, mass_n[i])
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


class Summing(NamedTuple):
    """The visitor that adds up the observables of contacts."""

    axes: Any


class ContactSums(NamedTuple):
    """Energies of laws and of tangential springs, touches, sliding ones, normal forces, and nine of force by branch."""

    potential: float
    tangential: float
    contacts: float
    slides: float
    total: float
    force: Any


def _with_interactions(effects: Any, laws: Any, pair: Any, sums: ContactSums) -> ContactSums:
    """Return the sums with what a pair's interactions beyond contact add; the same where a scene has none."""
    raise NotImplementedError("observables are summed in compiled loops")


@inlined
def _add_beyond(effects, laws, pair, sums):
    energy, pull = pull_beyond(effects, laws, pair)
    force = dyad(laws.axes, sums.force, pull.fx, pull.fy, pull.fz, pair.dx, pair.dy, pair.dz)
    total = sums.total + pull.normal
    return ContactSums(sums.potential + energy, sums.tangential, sums.contacts, sums.slides, total, force)


@compiled_form(_with_interactions, inline=True)
def _choose_with_interactions(effects: Any, laws: Any, pair: Any, sums: Any) -> Any:
    return _add_beyond if has_interactions(effects) else lambda effects, laws, pair, sums: sums


@visit.form(Summing)
@inlined
def _add_up(summing, laws, pair, sums):
    sums = _with_interactions(laws.effects, laws, pair, sums)
    if is_near(laws, pair):
        for k in range(touches_of(laws.shapes, pair.i, pair.j)):
            touch = touch_of_rows(laws.shapes, laws.axes, laws.body, pair, k)
            if touch.touching:
                pull = pull_of_touch(laws, pair, k, touch)
                sums = ContactSums(
                    sums.potential + energy_of(laws.effects, pair, touch),
                    sums.tangential + energy_across(laws.friction, laws, pair, touch, pull),
                    sums.contacts + 1.0,
                    sums.slides + pull.across.sliding,
                    sums.total + pull.normal,
                    dyad(summing.axes, sums.force, pull.fx, pull.fy, pull.fz, pair.dx, pair.dy, pair.dz),
                )
    return sums


@inlined
def measure_pairs(effects, laws, pairs, out):
    """Write the observables of touching pairs; nothing where no effect acts on them."""
    if effects is None:
        return
    sums = ContactSums(0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for b in range(pairs.row_b.shape[0] - 1):
        sums = walk_pairs(Summing(laws.axes), laws, pairs, b, sums)
    out[POTENTIAL] = sums.potential
    out[TANGENTIAL] = sums.tangential
    out[CONTACTS] = sums.contacts
    out[SLIDING] = sums.slides
    out[TOTAL] = sums.total
    write(out, FORCE, sums.force)


@device
def measure_bonds(bonds, laws, lattice, out):
    """Add what bonds do; nothing where the scene has none."""
    if bonds is None:
        return
    axes, body = laws.axes, laws.body
    potential = tangential = 0.0
    force = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for b in range(np.uint64(bonds.i_b.shape[0])):
        dx, dy, dz = bond_vector(axes, body, bonds, lattice, b)
        pull = pull_of_bond(bonds, laws, b, dx, dy, dz)
        across = pull.across
        potential += bond_energy(bonds, b, math.sqrt(dx * dx + dy * dy + dz * dz))
        square = across.x * across.x + across.y * across.y + across.z * across.z
        tangential += 0.5 * bonds.tangential_stiffness * square
        force = dyad(axes, force, pull.fx, pull.fy, pull.fz, dx, dy, dz)
    out[POTENTIAL] += potential
    out[TANGENTIAL] += tangential
    for k in range(9):
        out[FORCE + k] += force[k]
        out[BONDED + k] = force[k]


@device
def write_torques(out):
    """Write the sums of torques on particles, which make up for those of the forces about their centers."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        out[TORQUE + c] = out[FORCE + 3 * b + a] - out[FORCE + 3 * a + b]


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
    return flow.number[GAMMA], gamma_at(flow.course, time)[1]


@inlined
def measure_into(system, time, now, out):
    """Write the observables of the present time, in the columns named above."""
    for k in range(COLUMNS):
        out[k] = 0.0
    acting, axes, state, space = system.acting, system.axes, system.state, system.space
    laws = laws_of(system, now)
    out[TIME] = time
    out[STRAIN], out[RATE] = strain_of(space.flow, time)
    measure_pairs(acting.pairs, laws, system.pairs, out)
    measure_bonds(space.bonds, laws, space.frame.lattice_dd, out)
    write_torques(out)
    out[POTENTIAL] += energy_of_bodies(acting.shapes, acting.bodies, state.body, state.mass_n)
    out[POTENTIAL] += energy_at_moving_walls(acting.walls, axes, state)
    out[AT_WALLS], out[HELD_AT_WALLS] = energy_at_walls(acting.walls, axes, state, now)
    out[TANGENTIAL] += out[AT_WALLS]
    measure_motion(axes, state, laws.rates, out)
    out[OF_FACES], out[BEHIND_FACES] = measure_faces(faces_of(acting.walls))
    out[MOVING] += power_of_turning(acting.bodies, axes, state, laws.rates)
    measure_spinning(acting.shapes, axes, state, out, ROTATIONAL, SPINNING)
    measure_links(system.links, axes, state, out)


@lean
def measure(system, time, now, out):
    """Write the observables of the present time, in the columns named above; `now` is a `Now`."""
    measure_into(system, time, now, out)


class Ledger(NamedTuple):
    """Rows of observables: a row every `every` steps, `written` (one number) of them written."""

    every: int
    row_tk: NDArray[np.float64]
    written: NDArray[np.int64]


def new_ledger(every: int, rows: int) -> Ledger:
    """Return a ledger with room for so many rows."""
    return Ledger(every, np.zeros((rows, COLUMNS)), np.zeros(1, dtype=np.int64))


@device
def append_row(ledger, system, step, pace, dt):
    """Write the observables of this step; nothing without a ledger."""
    if ledger is not None:
        measure_into(system, step * dt, Now(pace.after), ledger.row_tk[ledger.written[0]])
        ledger.written[0] += 1


@lean
def append_due(ledger, system, step, now, dt):
    """Write the observables of this step where they are due; `now` is a `Now`."""
    if is_due(ledger, step):
        append_row(ledger, system, step, now, dt)


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
    term, (I/2)(|w|^2 - w w)). "overall": the sum of these three, symmetric (section 7.2.2 of the
    documentation of particleShear, in three dimensions too). "kinetic": -sum m c c of the peculiar velocities; in no
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
