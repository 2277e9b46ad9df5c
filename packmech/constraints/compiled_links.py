# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links inside compiled loops: chosen by type, so that a scene without links has no code and no cost of them.

`Space.joints` is None or a `Joints`, and every function here has a form for each; compiled loops hold only the one
that they need. Minimizers move particles back to the links' lengths by the shortest way (`affix`). Time steps are
RATTLE (`Rattle`): positions go back along the gradients at the old positions, x - W Omega_old lambda. Then a step is
its own inverse when velocities are reversed, it is symplectic, and the method is of second order (H. C. Andersen,
J. Comput. Phys. 52, 24, 1983; B. Leimkuhler and R. Skeel, ibid. 112, 117, 1994). W are the inverse masses. The impulses
are internal and along the links, so momentum and angular momentum hold.

Rows hold a position in the first columns; RATTLE takes velocities in arrays of their own. One thread does all of it, so
that the number of threads changes no bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from packmech.constraints.link_system import (
    NEWTON,
    TIGHT,
    Lengths,
    LinkSystem,
    make_link_system,
    measure_lengths,
    project_force,
    project_links,
    project_velocity,
    reaffix,
    reaffix_links,
    refill,
    refill_links,
    set_multipliers,
    solve_links,
)
from packmech.contacts.cells import PairTable
from packmech.contacts.excluded import rigid_clusters
from packmech.jit.compiled import compiled_form, device, inner_lean
from packmech.links import Links, image_offsets
from packmech.packing import Packing

# beyond this they are lost
_LOST = 1e-10
# places in Joints.number and Rattle.number
ERROR, ITERATIONS, NUMBERS = 0, 1, 2


class Joints(NamedTuple):
    """The links between the rows of a program, and what tells which pairs are no contacts.

    other_l and image_ld list, from start_n[i] on, the links of row i to rows j >= i. Pairs of one rigid cluster
    (label rigid_n, -1 for none) at the image offset_j - offset_i are no contacts either. scale_l is what the error of a
    link is measured in; number holds the largest error now and the iterations so far.
    """

    system: LinkSystem
    start_n: NDArray[np.int64]
    other_l: NDArray[np.int64]
    image_ld: NDArray[np.int64]
    rigid_n: NDArray[np.int64]
    offset_nd: NDArray[np.int64]
    spare_nd: NDArray[np.float64]
    multiplier_l: NDArray[np.float64]
    number: NDArray[np.float64]


def row_links(
    links: Links, order_n: NDArray[np.int64], home_nd: NDArray[np.float64], change_dd: NDArray[np.int64]
) -> tuple[Links, NDArray[np.int64]]:
    """Return the links numbered and imaged as a program's rows are, and the (N, d) offsets that unwrap the rows.

    Parameters
    ----------
    links
        The links between particles.
    order_n
        (N,) particle of each row.
    home_nd
        (N, d) images by which particles were moved: x = row + lattice @ home.
    change_dd
        (d, d) whole numbers: the program's lattice is lattice @ change.

    """
    particles = len(order_n)
    back = np.rint(np.linalg.inv(change_dd)).astype(np.int64)
    home = home_nd.astype(np.int64)
    moved = links.moved(home)
    offset, _ = image_offsets(links, particles)
    number = np.empty(particles, dtype=np.int64)
    number[order_n] = np.arange(particles)
    moved = Links(moved.i_l, moved.j_l, moved.image_ld @ back.T, moved.length_l, moved.shape_l)
    return moved.numbered(number), ((home + offset) @ back.T)[order_n]


def make_joints(
    packing: Packing,
    workable: Links,
    order_n: NDArray[np.int64],
    home_nd: NDArray[np.float64],
    change_dd: NDArray[np.int64],
) -> tuple[Links, Joints]:
    """Return the workable links between a program's rows, as a record and as its loops take them.

    Other parameters are those of `row_links`.
    """
    whole = packing.links
    assert whole is not None
    links, offset = row_links(whole, order_n, home_nd, change_dd)
    independent, _ = row_links(workable, order_n, home_nd, change_dd)
    n, d = packing.particles, packing.dimension
    rigid = np.where(rigid_clusters(packing), whole.clusters(n), -1)[order_n]
    padded = np.zeros((len(links), 3), dtype=np.int64)
    padded[:, :d] = links.image_ld
    offsets = np.zeros((n, 3), dtype=np.int64)
    offsets[:, :d] = offset
    joints = Joints(
        system=make_link_system(independent, n, d, mean_diameter=float(packing.diameter_n.mean())),
        start_n=np.searchsorted(links.i_l, np.arange(n + 1)).astype(np.int64),
        other_l=np.ascontiguousarray(links.j_l),
        image_ld=padded,
        rigid_n=rigid,
        offset_nd=offsets,
        spare_nd=np.zeros((n, d)),
        multiplier_l=np.zeros(len(independent)),
        number=np.zeros(NUMBERS),
    )
    return independent, joints


@device
def _is_joined(joints, i, j, image_d):
    same = joints.rigid_n[i] >= 0 and joints.rigid_n[i] == joints.rigid_n[j] and i != j
    for a in range(3):
        same = same and image_d[a] == joints.offset_nd[j, a] - joints.offset_nd[i, a]
    if same:
        return True
    for k in range(joints.start_n[i], joints.start_n[i + 1]):
        if joints.other_l[k] == j:
            ahead = behind = True
            for a in range(3):
                ahead = ahead and image_d[a] == joints.image_ld[k, a]
                behind = behind and image_d[a] == -joints.image_ld[k, a]
            if ahead or (behind and i == j):
                return True
    return False


@device
def _without_joined(joints, found):
    kept = 0
    bits = np.uint64(found.bits)
    mask = np.uint64((1 << found.bits) - 1)
    for p in range(found.i_p.shape[0]):
        i = found.i_p[p]
        code = found.code_p[p]
        found.i_p[kept] = i
        found.code_p[kept] = code
        kept += not _is_joined(joints, np.int64(i), np.int64(code >> bits), found.image_kd[code & mask])
    return PairTable(found.i_p[:kept], found.code_p[:kept], found.image_kd, found.bits)


@device
def _affix(joints, axes, row, space):
    system, spare = joints.system, joints.spare_nd
    lattice = space.frame.lattice_dd
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            spare[i, a] = row[i, a]
    shortest = np.inf
    for r in range(system.scale_r.shape[0]):
        shortest = min(shortest, system.scale_r[r])
    tolerance = max(TIGHT, 2.0 * space.resolution / shortest)
    iterations, error, _ = reaffix(system, row, lattice, tolerance, NEWTON)
    refill(system, row, lattice)
    joints.number[ERROR] = error
    joints.number[ITERATIONS] += iterations
    most = 0.0
    for i in range(row.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += (row[i, a] - spare[i, a]) ** 2
        most = max(most, own)
    return math.sqrt(most)


@device
def _along(joints, vector_nd):
    project_velocity(joints.system, vector_nd, vector_nd, joints.multiplier_l)


@device
def projected(joints, axes, force_nd, velocity_nd):
    """Project forces onto the motions that the links admit; return F.v, F.F and the largest squared force."""
    project_force(joints.system, force_nd, force_nd, joints.multiplier_l)
    power = 0.0
    square = 0.0
    most = 0.0
    for i in range(force_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += force_nd[i, a] * force_nd[i, a]
            power += force_nd[i, a] * velocity_nd[i, a]
        square += own
        most = max(most, own)
    if not joints.number[ERROR] < _LOST:
        most = np.inf
    return power, square, most


def has_links(joints: Any) -> bool:
    """Return whether the type of `Space.joints` is one with links."""
    return not isinstance(joints, types.NoneType)


def without_joined(joints: Joints | None, found: PairTable) -> PairTable:
    """Return the pairs of a search that may touch: neither linked nor of one rigid cluster."""
    return found if joints is None else _without_joined(joints, found)


@compiled_form(without_joined)
def _choose_without_joined(joints: Any, found: Any) -> Any:
    if has_links(joints):
        return _without_joined
    return lambda joints, found: found


def affix(joints: Joints | None, axes: Any, row: NDArray[np.float64], space: Any) -> float:
    """Move the rows back onto the links and refill the system there; return the farthest that one moved."""
    return 0.0 if joints is None else float(_affix(joints, axes, row, space))


@compiled_form(affix)
def _choose_affix(joints: Any, axes: Any, row: Any, space: Any) -> Any:
    if has_links(joints):
        return _affix
    return lambda joints, axes, row, space: 0.0


def refresh(joints: Joints | None, row: NDArray[np.float64], space: Any) -> None:
    """Refill the system where the rows are, moving nobody."""
    if joints is not None:
        refill(joints.system, row, space.frame.lattice_dd)


@compiled_form(refresh)
def _choose_refresh(joints: Any, row: Any, space: Any) -> Any:
    def renew(joints: Any, row: Any, space: Any) -> None:
        refill(joints.system, row, space.frame.lattice_dd)

    def nothing(joints: Any, row: Any, space: Any) -> None:
        pass

    return renew if has_links(joints) else nothing


def along_links(joints: Joints | None, vector_nd: NDArray[np.float64]) -> None:
    """Project a vector onto the motions that the links admit, at the rows of the last `affix` or `refresh`."""
    if joints is not None:
        _along(joints, vector_nd)


@compiled_form(along_links)
def _choose_along(joints: Any, vector_nd: Any) -> Any:
    def project_it(joints: Any, vector_nd: Any) -> None:
        _along(joints, vector_nd)

    def nothing(joints: Any, vector_nd: Any) -> None:
        pass

    return project_it if has_links(joints) else nothing


def speeds(joints: Joints | None, axes: Any, velocity_nd: NDArray[np.float64], square: float, most: float) -> Any:
    """Project velocities; return v.v over all and the largest squared speed, known already where nothing is linked."""
    return (square, most) if joints is None else _speeds(joints, axes, velocity_nd)


@device
def _speeds(joints, axes, velocity_nd):
    _along(joints, velocity_nd)
    square = 0.0
    most = 0.0
    for i in range(velocity_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += velocity_nd[i, a] * velocity_nd[i, a]
        square += own
        most = max(most, own)
    return square, most


@compiled_form(speeds)
def _choose_speeds(joints: Any, axes: Any, velocity_nd: Any, square: Any, most: Any) -> Any:
    if has_links(joints):
        return lambda joints, axes, velocity_nd, square, most: _speeds(joints, axes, velocity_nd)
    return lambda joints, axes, velocity_nd, square, most: (square, most)


# errors, over the larger of a link's length and the mean diameter, that are rounding where they no longer fall; links
# with larger ones are lost
_ROUNDING = 1e-13
_MOST_TRIES = 200


class LinkedPairs(NamedTuple):
    """Which pairs of rows are no contacts, as linked or of one rigid cluster: the arrays of `Joints` that say so."""

    start_n: NDArray[np.int64]
    other_l: NDArray[np.int64]
    image_ld: NDArray[np.int64]
    rigid_n: NDArray[np.int64]
    offset_nd: NDArray[np.int64]


def linked_pairs(joints: Joints) -> LinkedPairs:
    """Return which pairs of rows are no contacts."""
    return LinkedPairs(joints.start_n, joints.other_l, joints.image_ld, joints.rigid_n, joints.offset_nd)


class Rattle(NamedTuple):
    """The links between rows as time steps take them, at the start of a step, factored, and their lengths at its end.

    tension_l holds the tensions that were last measured, centripetal_l the part of them by which links turn. Errors of
    links are over their scale: brought down to `tolerance`, lost above `lost`. `number` holds the largest at the end of
    the last step, and the iterations so far.
    """

    here: LinkSystem
    there: Lengths
    impulse_r: NDArray[np.float64]
    multiplier_l: NDArray[np.float64]
    tension_l: NDArray[np.float64]
    centripetal_l: NDArray[np.float64]
    tolerance: float
    lost: float
    number: NDArray[np.float64]


def make_rattle(joints: Joints, inverse_mass_n: NDArray[np.float64], resolution: float) -> Rattle:
    """Return the links of rows as time steps take them; `affix_rows` or `refill_rattle` put the numbers in.

    Parameters
    ----------
    joints
        The links between the rows.
    inverse_mass_n
        (N,) inverse masses of the rows, zero for what is held.
    resolution
        Rounding of positions [length].

    """
    here = joints.system._replace(inverse_mass_n=inverse_mass_n)
    there = Lengths(np.zeros_like(here.normal_rd), np.zeros_like(here.distance_r), np.zeros_like(here.error_r))
    count = len(here.length_r)
    tolerance = max(TIGHT, 2.0 * resolution / float(here.scale_r.min()))
    return Rattle(
        here,
        there,
        impulse_r=np.zeros(count),
        multiplier_l=np.zeros(count),
        tension_l=np.zeros(count),
        centripetal_l=np.zeros(count),
        tolerance=tolerance,
        lost=max(_ROUNDING, 4.0 * tolerance),
        number=np.zeros(NUMBERS),
    )


def affix_rows(rattle: Rattle | None, row: NDArray[np.float64], lattice: NDArray[np.float64]) -> None:
    """Move rows, whose first columns are positions, back onto the links' lengths by the least displacement.

    Raises
    ------
    ValueError
        If that cannot be done.

    """
    if rattle is None:
        return
    _, error, _ = reaffix_links(rattle.here, row, lattice, rattle.tolerance, NEWTON)
    if not error <= rattle.lost:
        raise ValueError(f"scene.packing must have links that can be held at their lengths, got an error of {error:g}")
    refill_rattle(rattle, row, lattice)
    rattle.number[ERROR] = error


def refill_rattle(rattle: Rattle, row: NDArray[np.float64], lattice: NDArray[np.float64]) -> None:
    """Set the gradients of the links and their factor at the present rows."""
    refill_links(rattle.here, row, lattice)


def along_rattle(rattle: Rattle | None, velocity_nd: NDArray[np.float64]) -> int:
    """Take what would stretch links out of the (N, d) velocities of rows; return how many links are independent."""
    if rattle is None:
        return 0
    project_links(rattle.here, velocity_nd, velocity_nd, rattle.multiplier_l, False)
    return int(np.count_nonzero(rattle.here.inverse_pivot_r))


@device
def _pull(system, value_r, factor, vector_nd, first):
    """Take factor W Omega value from positions or velocities, which start at a column of rows."""
    normal, weight = system.normal_rd, system.inverse_mass_n
    for r in range(value_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        for a in range(len(system.axes)):
            impulse = factor * value_r[r] * normal[r, a]
            vector_nd[j, first + a] -= weight[j] * impulse
            vector_nd[i, first + a] += weight[i] * impulse


@device
def _hold(rattle, row, lattice):
    """Move rows back to the links' lengths by impulse_r, along the links as they were; return whether that worked."""
    here, there, impulse = rattle.here, rattle.there, rattle.impulse_r
    value = here.multiplier_r
    for r in range(impulse.shape[0]):
        impulse[r] = 0.0
    worst = measure_lengths(here, there, row, lattice)
    tries = 0
    # Newton's method with the matrix of the old positions: it differs from the right one by the turn of a step
    while not worst <= rattle.tolerance and tries < _MOST_TRIES:
        for r in range(impulse.shape[0]):
            value[r] = there.error_r[r]
        solve_links(here, value)
        for r in range(impulse.shape[0]):
            impulse[r] += value[r]
        _pull(here, value, 1.0, row, 0)
        before = worst
        worst = measure_lengths(here, there, row, lattice)
        tries += 1
        if worst <= rattle.lost and worst > 0.5 * before:
            break
    rattle.number[ERROR] = worst
    rattle.number[ITERATIONS] += tries
    return worst <= rattle.lost


@inner_lean
def hold(rattle, axes, body, half_nd, lattice, dt, ahead, moved):
    """Move rows that went dt v from good ones back to the links' lengths, the velocities half_nd with them.

    The velocities in the rows are half + ahead (half - what they were before), and stay so. Returns the largest
    displacement in the step, `moved` where nothing is linked, infinity where links are lost.
    """
    if rattle is None:
        return moved
    d = len(axes)
    good = _hold(rattle, body, lattice)
    _pull(rattle.here, rattle.impulse_r, 1.0 / dt, half_nd, 0)
    if ahead > 0.0:
        _pull(rattle.here, rattle.impulse_r, (1.0 + ahead) / dt, body, 4)
    refill(rattle.here, body, lattice)
    if ahead == 0.0:
        # these are the velocities at the end of the step
        project_velocity(rattle.here, half_nd, half_nd, rattle.multiplier_l)
        for i in range(body.shape[0]):
            for a in range(d):
                body[i, 4 + a] = half_nd[i, a]
    largest = 0.0
    for i in range(body.shape[0]):
        square = 0.0
        for a in range(d):
            square += half_nd[i, a] * half_nd[i, a]
        # written so that a speed that is not a number is the largest
        if not square <= largest:
            largest = square
    return dt * math.sqrt(largest) if good else np.inf


@inner_lean
def project_rows(rattle, axes, body, half_nd):
    """Project the velocities in rows onto those that change no link's length; half_nd is room for them."""
    d = len(axes)
    for i in range(body.shape[0]):
        for a in range(d):
            half_nd[i, a] = body[i, 4 + a]
    project_velocity(rattle.here, half_nd, half_nd, rattle.multiplier_l)
    for i in range(body.shape[0]):
        for a in range(d):
            body[i, 4 + a] = half_nd[i, a]


@inner_lean
def measure_tensions(rattle, axes, body, push):
    """Set tension_l to the forces in the links, tension positive; return the largest net force with them.

    A link's length does not accelerate: n.(a_j - a_i) = -w^2 / length with w the relative velocity across it, so
    that (Omega^T W Omega) t = Omega^T W F + w^2 / length. push (N, >= d) are the forces F of everything else.
    """
    here, d = rattle.here, len(axes)
    force, motion, turning = here.spare_nd, here.start_nd, rattle.multiplier_l
    for i in range(body.shape[0]):
        for a in range(d):
            force[i, a] = push[i, a]
    for r in range(here.i_r.shape[0]):
        i, j = here.i_r[r], here.j_r[r]
        along = square = 0.0
        for a in range(d):
            rate = body[j, 4 + a] - body[i, 4 + a]
            along += rate * here.normal_rd[r, a]
            square += rate * rate
        turning[here.order_r[r]] = (square - along * along) / here.distance_r[r]
    project_force(here, force, force, rattle.tension_l)
    set_multipliers(here, turning, motion, rattle.centripetal_l)
    for k in range(turning.shape[0]):
        rattle.tension_l[k] += rattle.centripetal_l[k]
    largest = 0.0
    for i in range(body.shape[0]):
        square = 0.0
        for a in range(d):
            net = force[i, a] - motion[i, a]
            square += net * net
        largest = max(largest, square)
    return math.sqrt(largest)
