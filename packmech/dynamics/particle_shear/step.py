# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""One time step of the reference package, in its order and with its faults, compiled.

Change of the shear rate; contacts and forces, each pair visited twice; stress; kick; cooling; histories and drift;
strain and wrap.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device, kernel
from packmech.dynamics.particle_shear.material import repulsion, tension
from packmech.dynamics.particle_shear.pairs import BOND, OPEN, SLIP, STICK, image, list_pairs

# rows of the stress array, by the names of `STRESSES`
(LOVE_WEBER, EXTERNAL, ACCELERATION, UNBALANCED, TORQUE, INTERNAL_TORQUE, CENTRIFUGAL, OTSUKI, OVERALL) = range(9)


class Motion(NamedTuple):
    """Arrays that a step changes in place."""

    position_nd: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    spin_n: NDArray[np.float64]
    angle_n: NDArray[np.float64]
    carried_nd: NDArray[np.float64]


class Body(NamedTuple):
    """Arrays that stay; the last two are what a force and a torque add to speed and spin in one step."""

    radius_n: NDArray[np.float64]
    mass_n: NDArray[np.float64]
    push_n: NDArray[np.float64]
    turn_n: NDArray[np.float64]


class Cell(NamedTuple):
    """Size of the cell [um], whether plates catch discs, and the step's constants."""

    width: float
    height: float
    plates: bool
    time_step: float
    cooling: float
    clears_all: bool
    all_spin: bool
    otsuki_flow: bool


class Register(NamedTuple):
    """What a force evaluation reads and leaves, packed by disc so that a contact touches few cache lines.

    Rows are (x, y, v_x, v_y, r w, r, 1 if mobile, 0); parts are (F_x, F_y, T, 0) from contacts inside the cell between
    mobile discs, and from all others.
    """

    row_n8: NDArray[np.float64]
    part_n24: NDArray[np.float64]
    force_nd: NDArray[np.float64]
    torque_n: NDArray[np.float64]
    virial_dd: NDArray[np.float64]


@device
def change_rate(motion, cell, change):
    """Shift all velocities by an affine flow and its spin."""
    for i in range(motion.spin_n.shape[0]):
        motion.velocity_nd[i, 0] += (motion.position_nd[i, 1] - cell.height / 2.0) * change
        motion.spin_n[i] -= change / 2.0


@device
def pack(motion, body, cell, register):
    """Fill the rows and say who is mobile now: with plates, who is farther than its radius from both."""
    row_n8, x, v = register.row_n8, motion.position_nd, motion.velocity_nd
    for i in range(body.radius_n.shape[0]):
        y, r = x[i, 1], body.radius_n[i]
        row_n8[i, 0], row_n8[i, 1], row_n8[i, 2], row_n8[i, 3] = x[i, 0], y, v[i, 0], v[i, 1]
        row_n8[i, 4], row_n8[i, 5] = r * motion.spin_n[i], r
        row_n8[i, 6] = 1.0 if (not cell.plates) or (y > r and y < cell.height - r) else 0.0
    register.part_n24[:] = 0.0


@device
def add_parts(motion, register):
    """Set the totals, on top of forces that earlier steps left on caught discs."""
    for i in range(register.torque_n.shape[0]):
        for a in range(2):
            total = register.part_n24[i, 0, a] + register.part_n24[i, 1, a]
            register.force_nd[i, a] = motion.carried_nd[i, a] + total
        register.torque_n[i] = register.part_n24[i, 0, 2] + register.part_n24[i, 1, 2]


@device
def two_visits(drag, spring, cap, first, second):
    """Return the tangential force of a contact that may slip, whether its second visit slipped, and whether any did.

    The lower-numbered disc visits with its history, then the higher-numbered with its own; each gives half of its
    force. A visit that slips wipes both histories: the one after it sees the dashpot alone, and mostly sticks again.
    """
    one = drag + spring * first
    slips = abs(one) > cap
    two = drag + spring * (0.0 if slips else second)
    slips_again = abs(two) > cap
    force = (min(max(one, -cap), cap) + min(max(two, -cap), cap)) / 2.0
    return force, slips_again, slips or slips_again


@device
def look(cell, strain, pairs, register):
    """Fill in where the lower disc of each pair sees the other; apart from the forces, as roots and quotients wait."""
    row_n8, state_p9 = register.row_n8, pairs.state_p9
    for p in range(pairs.i_p.shape[0]):
        # unsigned numbers need no test for counting from the end
        i, j = np.uint64(pairs.i_p[p]), np.uint64(pairs.j_p[p])
        dx, dy, up, along = image(
            row_n8[j, 0] - row_n8[i, 0], row_n8[j, 1] - row_n8[i, 1], cell.width, cell.height, strain
        )
        d = math.sqrt(dx * dx + dy * dy)
        inverse = 1.0 / d if d > 0.0 else np.inf
        # the package draws a fresh direction for coincident centers at every call; here it is the x axis
        state_p9[p, 3] = dx * inverse if d > 0.0 else 1.0
        state_p9[p, 4] = dy * inverse if d > 0.0 else 0.0
        state_p9[p, 5] = up
        state_p9[p, 6] = d
        state_p9[p, 7] = inverse
        state_p9[p, 8] = 0.0 if up == 0 and along == 0 else 1.0


@device
def evaluate(motion, body, cell, material, strain, rate, pairs, register):
    """Fill the register and return how many contacts there are; kinds and histories change as they slip and part."""
    contacts = 0
    pack(motion, body, cell, register)
    look(cell, strain, pairs, register)
    kind_p, state_p9, row_n8, part_n24 = pairs.kind_p, pairs.state_p9, register.row_n8, register.part_n24
    shear = cell.height * rate
    bond_damping, bond_drag = material.viscosity, material.tangential_viscosity
    if material.bond_viscosity_follows != 0.0:
        bond_damping *= material.bond_normal_ratio
        bond_drag *= material.bond_tangential_ratio
    virial_xx, virial_xy, virial_yx, virial_yy = 0.0, 0.0, 0.0, 0.0
    for p in range(pairs.i_p.shape[0]):
        i, j, kind = np.uint64(pairs.i_p[p]), np.uint64(pairs.j_p[p]), kind_p[p]
        ri, rj, d = row_n8[i, 5], row_n8[j, 5], state_p9[p, 6]
        rest = ri + rj
        if kind != BOND and d >= rest:
            if kind != OPEN:
                kind_p[p] = OPEN
                state_p9[p, 0] = 0.0
                state_p9[p, 1] = 0.0
            continue
        nx, ny = state_p9[p, 3], state_p9[p, 4]
        vx, vy = row_n8[j, 2] - row_n8[i, 2] - state_p9[p, 5] * shear, row_n8[j, 3] - row_n8[i, 3]
        approach = vx * nx + vy * ny
        slip = vy * nx - vx * ny - (row_n8[i, 4] + row_n8[j, 4])
        inner = row_n8[i, 6] * row_n8[j, 6] * (1.0 - state_p9[p, 8])
        first, second = state_p9[p, 0], state_p9[p, 1]
        inverse_rest = state_p9[p, 2]
        elastic = repulsion(material, d, rest, rest * state_p9[p, 7])
        if kind == BOND:
            # a stretched bond keeps its tangential spring and loses its dashpot
            drag = bond_drag * slip if d < rest else 0.0
            spring = material.bond_tangential_ratio * material.tangential_stiffness
            tangential = drag + spring * (first + second) / 2.0
            pull = elastic if d < rest else tension(material, d - rest, rest)
            normal = material.bond_normal_ratio * pull + bond_damping * approach
        else:
            normal = elastic + material.viscosity * approach
            tangential, slips, wiped = two_visits(
                material.tangential_viscosity * slip, material.tangential_stiffness,
                material.friction_coefficient * abs(elastic), first, second,
            )  # fmt: skip
            kind_p[p] = SLIP if slips else STICK
            first, second = (0.0, 0.0) if wiped else (first, second)
        state_p9[p, 0], state_p9[p, 1] = first, second
        fx, fy = normal * nx - tangential * ny, normal * ny + tangential * nx
        # S1-3: the arms are the radii times d/(r_i + r_j), while the slip speed has the radii themselves
        turn = d * inverse_rest * tangential
        contacts += 1
        part = np.uint64(0 if inner == 1.0 else 1)
        part_n24[i, part, 0] += fx
        part_n24[i, part, 1] += fy
        part_n24[i, part, 2] += turn * ri
        part_n24[j, part, 0] -= fx
        part_n24[j, part, 1] -= fy
        part_n24[j, part, 2] += turn * rj
        inner_x, inner_y = inner * d * nx, inner * d * ny
        virial_xx -= fx * inner_x
        virial_xy -= fx * inner_y
        virial_yx -= fy * inner_x
        virial_yy -= fy * inner_y
    add_parts(motion, register)
    register.virial_dd[0, 0], register.virial_dd[0, 1] = virial_xx, virial_xy
    register.virial_dd[1, 0], register.virial_dd[1, 1] = virial_yx, virial_yy
    return contacts


@device
def measure(motion, body, cell, rate, register, stress_sdd):
    """Fill the nine tensors [Pa], compression positive; rows are the force's components, columns the position's."""
    x, v = motion.position_nd, motion.velocity_nd
    stress_sdd[:] = 0.0
    flow = rate if cell.otsuki_flow else 0.0
    torque, inner_torque, energy = 0.0, 0.0, 0.0
    pxx, pxy, pyy = 0.0, 0.0, 0.0
    exx, exy, eyx, eyy, axx, axy, ayx, ayy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(x.shape[0]):
        dx, dy = x[i, 0] - cell.width / 2.0, x[i, 1] - cell.height / 2.0
        torque += register.torque_n[i]
        inner_torque += register.part_n24[i, 0, 2]
        if register.row_n8[i, 6] == 1.0:
            fx, fy = register.part_n24[i, 1, 0], register.part_n24[i, 1, 1]
            exx, exy, eyx, eyy = exx + fx * dx, exy + fx * dy, eyx + fy * dx, eyy + fy * dy
            fx, fy = register.force_nd[i, 0], register.force_nd[i, 1]
            axx, axy, ayx, ayy = axx + fx * dx, axy + fx * dy, ayx + fy * dx, ayy + fy * dy
        if cell.all_spin or register.row_n8[i, 6] == 1.0:
            energy += body.mass_n[i] * body.radius_n[i] ** 2 * motion.spin_n[i] ** 2 / 4.0
            px, py = v[i, 0] - flow * dy, v[i, 1]
            pxx += body.mass_n[i] * px * px
            pxy += body.mass_n[i] * px * py
            pyy += body.mass_n[i] * py * py
    stress_sdd[TORQUE, 1, 0] = torque / 2.0
    stress_sdd[INTERNAL_TORQUE, 1, 0] = inner_torque / 2.0
    stress_sdd[CENTRIFUGAL, 0, 0] = -energy
    # the sign of the paper it follows, where tension is positive, in tensors where compression is
    stress_sdd[OTSUKI, 0, 0], stress_sdd[OTSUKI, 1, 1] = -pxx, -pyy
    stress_sdd[OTSUKI, 0, 1], stress_sdd[OTSUKI, 1, 0] = -pxy, -pxy
    for s in (TORQUE, INTERNAL_TORQUE):
        stress_sdd[s, 0, 1] = -stress_sdd[s, 1, 0]
    stress_sdd[CENTRIFUGAL, 1, 1] = stress_sdd[CENTRIFUGAL, 0, 0]
    stress_sdd[EXTERNAL, 0, 0], stress_sdd[EXTERNAL, 0, 1] = -exx, -exy
    stress_sdd[EXTERNAL, 1, 0], stress_sdd[EXTERNAL, 1, 1] = -eyx, -eyy
    stress_sdd[ACCELERATION, 0, 0], stress_sdd[ACCELERATION, 0, 1] = axx, axy
    stress_sdd[ACCELERATION, 1, 0], stress_sdd[ACCELERATION, 1, 1] = ayx, ayy
    # sums of force times length in 1e-18 J per metre of depth, over an area in um^2
    unit = 1e-6 / (cell.width * cell.height)
    for a in range(2):
        for b in range(2):
            stress_sdd[LOVE_WEBER, a, b] = register.virial_dd[a, b]
            stress_sdd[UNBALANCED, a, b] = stress_sdd[ACCELERATION, a, b]
            spinning = stress_sdd[INTERNAL_TORQUE, a, b] + stress_sdd[CENTRIFUGAL, a, b]
            stress_sdd[OVERALL, a, b] = stress_sdd[LOVE_WEBER, a, b] + spinning
            for s in range(9):
                stress_sdd[s, a, b] *= unit


@device
def kick(motion, body, cell, rate, register):
    """Accelerate by the register's forces, drag the caught discs with their plate, and cool towards the flow."""
    v = motion.velocity_nd
    for i in range(v.shape[0]):
        y = motion.position_nd[i, 1]
        if register.row_n8[i, 6] == 1.0:
            for a in range(2):
                v[i, a] += register.force_nd[i, a] * body.push_n[i]
        else:
            v[i, 0] = rate * cell.height / 2.0 if y > cell.height / 2.0 else -rate * cell.height / 2.0
            v[i, 1] = 0.0
        motion.spin_n[i] += register.torque_n[i] * body.turn_n[i]
        flow = (y - cell.height / 2.0) * rate
        v[i, 0] = flow + (v[i, 0] - flow) * cell.cooling
        v[i, 1] *= cell.cooling
        motion.spin_n[i] *= cell.cooling
        cleared = cell.clears_all or register.row_n8[i, 6] == 1.0
        for a in range(2):
            motion.carried_nd[i, a] = 0.0 if cleared else register.force_nd[i, a]


@device
def drift(motion, body, cell, strain, rate, pairs, register, new_nd):
    """Turn, wind the histories and move, disc by disc: a disc sees the lower-numbered ones where they already are."""
    x, v, spin, dt, row_n8 = motion.position_nd, motion.velocity_nd, motion.spin_n, cell.time_step, register.row_n8
    shear = cell.height * rate
    for i in range(x.shape[0]):
        motion.angle_n[i] += spin[i] * dt
        new_nd[i, 0] = x[i, 0] + v[i, 0] * dt
        new_nd[i, 1] = x[i, 1] + v[i, 1] * dt
        row_n8[i, 2], row_n8[i, 3], row_n8[i, 4] = v[i, 0], v[i, 1], body.radius_n[i] * spin[i]
    for p in range(pairs.i_p.shape[0]):
        if pairs.kind_p[p] != OPEN:
            one, other = np.uint64(pairs.i_p[p]), np.uint64(pairs.j_p[p])
            winding = 0.0 if pairs.kind_p[p] == SLIP else dt
            state_p9 = pairs.state_p9
            vx, vy = row_n8[other, 2] - row_n8[one, 2], row_n8[other, 3] - row_n8[one, 3]
            rolled = row_n8[one, 4] + row_n8[other, 4]
            along = vx - state_p9[p, 5] * shear
            state_p9[p, 0] += (vy * state_p9[p, 3] - along * state_p9[p, 4] - rolled) * winding
            new_x, new_y = row_n8[one, 0] + row_n8[one, 2] * dt, row_n8[one, 1] + row_n8[one, 3] * dt
            dx, dy, up, _ = image(new_x - row_n8[other, 0], new_y - row_n8[other, 1], cell.width, cell.height, strain)
            d = math.sqrt(dx * dx + dy * dy)
            inverse = 1.0 / d if d > 0.0 else 0.0
            nx, ny = dx * inverse, dy * inverse
            if d == 0.0:
                nx = 1.0
            along = -vx - up * shear
            state_p9[p, 1] += (-vy * nx - along * ny - rolled) * winding


@device
def wrap(motion, cell, strain, rate, new_nd):
    """Put the discs at their new places, wrapped into the cell as it is strained now; return the longest own way.

    A disc's own way is its way less that of the sheared flow where it was.
    """
    farthest = 0.0
    x, v = motion.position_nd, motion.velocity_nd
    for i in range(x.shape[0]):
        own = v[i, 0] - (x[i, 1] - cell.height / 2.0) * rate
        farthest = max(farthest, own * own + v[i, 1] * v[i, 1])
        x[i, 0], x[i, 1] = new_nd[i, 0], new_nd[i, 1]
        if x[i, 1] < 0.0 or x[i, 1] >= cell.height:
            up = math.floor(x[i, 1] / cell.height)
            x[i, 1] -= up * cell.height
            x[i, 0] -= up * cell.height * strain
            v[i, 0] -= up * cell.height * rate
        if x[i, 0] < 0.0 or x[i, 0] >= cell.width:
            x[i, 0] -= math.floor(x[i, 0] / cell.width) * cell.width
    return math.sqrt(farthest) * cell.time_step


@kernel
def run_steps(motion, body, cell, material, clock, rate_t, margin, pairs, register, stress_tsdd, count_tk, strain_t):
    """Advance by one step for every rate given; return the pairs, their last histories, and the strain, rate and time.

    The histories are those of the last force evaluation, before the discs moved on. Saves the nine tensors, the numbers
    of caught discs and of contacts and bonds, and the strain of every step's force evaluation.
    """
    strain, rate, time = clock
    new_nd = np.empty_like(motion.position_nd)
    seen_p9 = pairs.state_p9
    reach = 2.0 * np.max(body.radius_n) + margin
    # a list that nobody has made yet: the first step makes it
    gone = np.inf
    for t in range(rate_t.shape[0]):
        if gone >= margin:
            pairs = list_pairs(motion.position_nd, body.radius_n, cell.width, cell.height, strain, margin, pairs)
            gone = 0.0
        change_rate(motion, cell, rate_t[t] - rate)
        rate = rate_t[t]
        count_tk[t, 1] = evaluate(motion, body, cell, material, strain, rate, pairs, register)
        measure(motion, body, cell, rate, register, stress_tsdd[t])
        strain_t[t] = strain
        caught = 0
        for i in range(body.radius_n.shape[0]):
            caught += register.row_n8[i, 6] == 0.0
        count_tk[t, 0] = caught
        if t == rate_t.shape[0] - 1:
            seen_p9 = pairs.state_p9.copy()
        kick(motion, body, cell, rate, register)
        drift(motion, body, cell, strain, rate, pairs, register, new_nd)
        strain += rate * cell.time_step
        # two discs approach by their own ways and by what the flow shrinks the longest distance that could matter
        gone += 2.0 * wrap(motion, cell, strain, rate, new_nd) + reach * abs(rate) * cell.time_step
        time += cell.time_step
    return pairs, seen_p9, strain, rate, time
