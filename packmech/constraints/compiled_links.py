# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links inside compiled loops: chosen by type, so that a scene without links has no code and no cost of them.

`Space.links` is None or `CompiledLinks`; the table at the end has a form of each function for either. Minimizers
project particles back onto the links' lengths by the shortest way (`project_rows`); time steps do it as
`packmech.constraints.rattle` says.

Rows hold a position in the first columns. One thread does all of it, so that the number of threads changes no bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.link_system import (
    NEWTON,
    TIGHT,
    LinkSystem,
    make_link_system,
    project_force,
    project_positions,
    project_velocity,
    refill,
)
from packmech.contacts.cells import PairTable
from packmech.contacts.excluded import rigid_clusters
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device
from packmech.links import Links, image_offsets
from packmech.packing import Packing

# beyond this they are lost
_LOST = 1e-10
# places in CompiledLinks.number and in that of RATTLE
ERROR, ITERATIONS, NUMBERS = 0, 1, 2


class CompiledLinks(NamedTuple):
    """The links between the rows of a program, and which pairs are no contacts.

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


class LinkedPairs(NamedTuple):
    """Which pairs of rows are no contacts, as linked or of one rigid cluster: as in `CompiledLinks`."""

    start_n: NDArray[np.int64]
    other_l: NDArray[np.int64]
    image_ld: NDArray[np.int64]
    rigid_n: NDArray[np.int64]
    offset_nd: NDArray[np.int64]


def linked_pairs(links: CompiledLinks) -> LinkedPairs:
    """Return which pairs of rows are no contacts."""
    return LinkedPairs(links.start_n, links.other_l, links.image_ld, links.rigid_n, links.offset_nd)


def row_links(
    links: Links, order_n: NDArray[np.int64], wrap_nd: NDArray[np.float64], change_dd: NDArray[np.int64]
) -> tuple[Links, NDArray[np.int64]]:
    """Return the links numbered and imaged as a program's rows are, and the (N, d) offsets that unwrap the rows.

    Parameters
    ----------
    links
        The links between particles.
    order_n
        (N,) particle of each row.
    wrap_nd
        (N, d) images by which particles were moved: x = row + lattice @ wrap.
    change_dd
        (d, d) whole numbers: the program's lattice is lattice @ change.

    """
    particles = len(order_n)
    back = np.rint(np.linalg.inv(change_dd)).astype(np.int64)
    wrap = wrap_nd.astype(np.int64)
    moved = links.moved(wrap)
    offset, _ = image_offsets(links, particles)
    number = np.empty(particles, dtype=np.int64)
    number[order_n] = np.arange(particles)
    moved = Links(moved.i_l, moved.j_l, moved.image_ld @ back.T, moved.length_l, moved.shape_l)
    return moved.numbered(number), ((wrap + offset) @ back.T)[order_n]


def compile_links(
    packing: Packing,
    workable: Links,
    order_n: NDArray[np.int64],
    wrap_nd: NDArray[np.float64],
    change_dd: NDArray[np.int64],
) -> tuple[Links, CompiledLinks]:
    """Return the workable links between a program's rows, as a record and as its loops take them.

    Other parameters are those of `row_links`.
    """
    whole = packing.links
    between, offset = row_links(whole, order_n, wrap_nd, change_dd)
    independent, _ = row_links(workable, order_n, wrap_nd, change_dd)
    n, d = packing.particles, packing.dimension
    rigid = np.where(rigid_clusters(packing), whole.clusters(n), -1)[order_n]
    padded = np.zeros((len(between), 3), dtype=np.int64)
    padded[:, :d] = between.image_ld
    offsets = np.zeros((n, 3), dtype=np.int64)
    offsets[:, :d] = offset
    compiled = CompiledLinks(
        system=make_link_system(independent, n, d, mean_diameter=float(packing.diameter_n.mean())),
        start_n=np.searchsorted(between.i_l, np.arange(n + 1)).astype(np.int64),
        other_l=np.ascontiguousarray(between.j_l),
        image_ld=padded,
        rigid_n=rigid,
        offset_nd=offsets,
        spare_nd=np.zeros((n, d)),
        multiplier_l=np.zeros(len(independent)),
        number=np.zeros(NUMBERS),
    )
    return independent, compiled


@device
def _is_linked(links, i, j, image_d):
    same = links.rigid_n[i] >= 0 and links.rigid_n[i] == links.rigid_n[j] and i != j
    for a in range(3):
        same = same and image_d[a] == links.offset_nd[j, a] - links.offset_nd[i, a]
    if same:
        return True
    for k in range(links.start_n[i], links.start_n[i + 1]):
        if links.other_l[k] == j:
            ahead = behind = True
            for a in range(3):
                ahead = ahead and image_d[a] == links.image_ld[k, a]
                behind = behind and image_d[a] == -links.image_ld[k, a]
            if ahead or (behind and i == j):
                return True
    return False


@device
def _without_linked(links, found):
    kept = 0
    bits = np.uint64(found.bits)
    mask = np.uint64((1 << found.bits) - 1)
    for p in range(found.i_p.shape[0]):
        i = found.i_p[p]
        code = found.code_p[p]
        found.i_p[kept] = i
        found.code_p[kept] = code
        kept += not _is_linked(links, np.int64(i), np.int64(code >> bits), found.image_kd[code & mask])
    return PairTable(found.i_p[:kept], found.code_p[:kept], found.image_kd, found.bits)


@device
def _project_rows(links, axes, row, space):
    system, spare = links.system, links.spare_nd
    lattice = space.frame.lattice_dd
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            spare[i, a] = row[i, a]
    shortest = np.inf
    for r in range(system.scale_r.shape[0]):
        shortest = min(shortest, system.scale_r[r])
    tolerance = max(TIGHT, 2.0 * space.resolution[0] / shortest)
    iterations, error, _ = project_positions(system, row, lattice, tolerance, NEWTON)
    refill(system, row, lattice)
    links.number[ERROR] = error
    links.number[ITERATIONS] += iterations
    largest = 0.0
    for i in range(row.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += (row[i, a] - spare[i, a]) ** 2
        largest = max(largest, own)
    return math.sqrt(largest)


@device
def _refresh(links, row, space):
    refill(links.system, row, space.frame.lattice_dd)


@device
def _along_links(links, vector_nd):
    project_velocity(links.system, vector_nd, vector_nd, links.multiplier_l)


@device
def _speeds(links, axes, velocity_nd, square, largest):
    _along_links(links, velocity_nd)
    square = largest = 0.0
    for i in range(velocity_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += velocity_nd[i, a] * velocity_nd[i, a]
        square += own
        largest = max(largest, own)
    return square, largest


@device
def _add_tensions(links, axes, virial_dd):
    system = links.system
    for r in range(system.i_r.shape[0]):
        pull = links.multiplier_l[system.order_r[r]] * system.distance_r[r]
        for a in range(len(axes)):
            for b in range(len(axes)):
                virial_dd[a, b] += pull * system.normal_rd[r, a] * system.normal_rd[r, b]


@device
def _project_forces(links, axes, force_nd, velocity_nd, power, square, largest):
    project_force(links.system, force_nd, force_nd, links.multiplier_l)
    power = square = largest = 0.0
    for i in range(force_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += force_nd[i, a] * force_nd[i, a]
            power += force_nd[i, a] * velocity_nd[i, a]
        square += own
        largest = max(largest, own)
    if not links.number[ERROR] < _LOST:
        largest = np.inf
    return power, square, largest


# the pairs of a search that may touch: neither linked nor of one rigid cluster
without_linked = by_type(_without_linked, {type(None): lambda links, found: found})
# moves the rows back onto the links and refills the system there; the farthest that one moved
project_rows = by_type(_project_rows, {type(None): lambda links, axes, row, space: 0.0})
# refills the system where the rows are, without moving them
refresh = by_type(_refresh, {type(None): lambda links, row, space: None})
# projects a vector onto the motions that the links admit, at the rows of the last `project_rows` or `refresh`
along_links = by_type(_along_links, {type(None): lambda links, vector_nd: None})
# projects velocities; v.v over all and the largest squared speed, which are given as they are without links
speeds = by_type(_speeds, {type(None): lambda links, axes, velocity_nd, square, largest: (square, largest)})
# adds the links' part of V times the stress, where forces were projected last
add_tensions = by_type(_add_tensions, {type(None): lambda links, axes, virial_dd: None})
# projects forces onto the motions that the links admit; F.v, F.F and the largest squared force, given without links
project_forces = by_type(
    _project_forces,
    {type(None): lambda links, axes, force_nd, velocity_nd, power, square, largest: (power, square, largest)},
)
