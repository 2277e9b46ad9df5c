# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links inside compiled loops: chosen by type, so that a scene without links has no code and no cost of them.

`Space.links` is None or `CompiledLinks`, and every function here has a form for each; compiled loops hold only the one
that they need. Minimizers project particles back onto the links' lengths by the shortest way (`project_rows`); time
steps do it as `packmech.constraints.rattle` says.

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
def without_linked(links, found):
    """Return the pairs of a search that may touch: neither linked nor of one rigid cluster."""
    if links is None:
        return found
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
def project_rows(links, axes, row, space):
    """Move the rows back onto the links and refill the system there; return the farthest that one moved."""
    if links is None:
        return 0.0
    system, spare = links.system, links.spare_nd
    lattice = space.frame.lattice_dd
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            spare[i, a] = row[i, a]
    shortest = np.inf
    for r in range(system.scale_r.shape[0]):
        shortest = min(shortest, system.scale_r[r])
    tolerance = max(TIGHT, 2.0 * space.resolution / shortest)
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
def refresh(links, row, space):
    """Refill the system where the rows are, without moving them."""
    if links is not None:
        refill(links.system, row, space.frame.lattice_dd)


@device
def along_links(links, vector_nd):
    """Project a vector onto the motions that the links admit, at the rows of the last `project_rows` or `refresh`."""
    if links is not None:
        project_velocity(links.system, vector_nd, vector_nd, links.multiplier_l)


@device
def speeds(links, axes, velocity_nd, square, largest):
    """Project velocities; return v.v over all and the largest squared speed, known already where nothing is linked."""
    if links is None:
        return square, largest
    along_links(links, velocity_nd)
    square = largest = 0.0
    for i in range(velocity_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += velocity_nd[i, a] * velocity_nd[i, a]
        square += own
        largest = max(largest, own)
    return square, largest


@device
def add_tensions(links, axes, virial_dd):
    """Add the links' part of V times the stress, where forces were projected last."""
    if links is not None:
        system = links.system
        for r in range(system.i_r.shape[0]):
            pull = links.multiplier_l[system.order_r[r]] * system.distance_r[r]
            for a in range(len(axes)):
                for b in range(len(axes)):
                    virial_dd[a, b] += pull * system.normal_rd[r, a] * system.normal_rd[r, b]


@device
def projected(links, axes, force_nd, velocity_nd):
    """Project forces onto the motions that the links admit; return F.v, F.F and the largest squared force."""
    project_force(links.system, force_nd, force_nd, links.multiplier_l)
    power = 0.0
    square = 0.0
    largest = 0.0
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
