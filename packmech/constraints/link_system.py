# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links in compiled loops: Jacobian, factored normal matrix A = Omega^T W Omega, projections, and Newton's way back.

Links are eliminated cluster by cluster, along each, in an order that keeps the envelope of A narrow. Cholesky's factor
of A costs least, but A has the square of Omega's condition number: long chains whose angles are held, the straighter
the worse, leave it no digit. For clusters that show this, the triangle R with R^T R = A comes from rotating the rows of
W^(1/2) Omega into it one by one (J. A. George and M. T. Heath, Linear Algebra Appl. 34, 69, 1980). It fills the same
envelope, and a step of minimum norm, W Omega (R^T R)^-1 c, then errs by the condition number itself times rounding
(C. C. Paige, Math. Comp. 27, 873, 1973: the semi-normal equations are stable for steps of minimum norm).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import device, inner_lean, kernel
from packmech.links import Links

# a link whose gradient lies, to this square of the sine, in the span of the links before it, takes no part in solves
DEPENDENT = 1e-12
# the same by rotations, which know sines to rounding and not only their squares
_DEPENDENT_ROTATED = 1e-16
# Cholesky's factor does where all relative pivots are above this and A^-1 enlarges nothing by more than the second
_ILL_CONDITIONED, _ENLARGED = 1e-9, 1e8
# pivots above this are those of chains and rings without angles: nothing is nearly dependent
_SOUND = 0.4
# in clusters of fewer links relative pivots tell of the condition number
_LONG = 16
# rates of links below this many units of rounding of the largest force are zero
AT_ROUNDING = 4.0 * np.finfo(np.float64).eps
# a pass gains the digits that rounding leaves in the factor of A: nearly all of them, but few for long stiff chains
PASS_LIMIT = 12
# relative errors below this only fall, as long as rounding lets them
_NEARLY = 1e-7
# errors within so many tolerances that fall no further are rounding of the positions
_ROUNDING, _FEW = 8.0, 2.0
# what no coordinates of unit size can do better than, whatever the tolerance
_ROUNDING_FLOOR = 1e-14
# steps have gone astray where the largest error has grown by this factor, or where links nearly depend on each other
# and a particle has gone farther than this many of the largest errors, or than this part of the longest link: beside a
# straight angle a full step can swing a whole chain round to another shape of the same lengths
_ASTRAY, _FAR, _SWING = 4.0, 100.0, 0.25
# links with a relative pivot below this nearly depend on each other
_SUSPECT = 1e-3
# damping at the start, below what it is none, above what steps lead nowhere
_FIRST, _NONE, _LARGEST_DAMPING = 1e-2, 1e-20, 1e2
# parts of the predicted fall of the squares below which a step is refused, or damping stays
_REFUSED, _FAIR = 1e-3, 0.5
# factors on the damping
_LESS, _MORE = 0.05, 10.0
# links hold to this part of the larger of their length and the mean diameter, or to rounding of the coordinates
TIGHT = 4e-15
# maximum number of Newton steps back to the links' lengths
NEWTON = 40
# damped steps for each full one, and refused ones in a row after which no digits are left
DAMPED, _IN_A_ROW = 5, 8


class LinkSystem(NamedTuple):
    """Links compiled for projections: arrays only, so that kernels take it as one argument.

    Index r counts links in the order of elimination; `order_r` is the place of each among the packing's links. The
    arrays of the last group are working space that `refill` and the others overwrite.

    Attributes
    ----------
    axes
        A tuple as long as the dimension.
    order_r, i_r, j_r, image_rd, length_r, scale_r
        Links in the order of elimination; scale is the larger of the length and the mean diameter [length].
    inverse_mass_n
        (N,) inverse masses.
    row_e, column_e, particle_e
        Pairs of links row > column that share a particle.
    slot_e, sign_e
        Where the pair stands in the envelope, and +1 or -1 as both links point alike at the particle.
    first_r, start_r
        First column of each row of the envelope, and its place in `factor`.
    normal_rd, distance_r, error_r
        Unit vectors, distances and distances less lengths at the last refill.
    factor, inverse_pivot_r
        The Cholesky factor of A by rows (its diagonal inverted apart; 0 for a dependent link).
    last_r, block_b
        Last row whose envelope reaches each column, and the first link of each cluster (with the count at the end).
    part_b, who_q, from_q, near_k, sense_k
        Particles by cluster, in the order of their first links: from part_b[b] on, each with its links near_k from
        from_q[q] on, and the signs of their gradients at it.
    diagonal_r, row_r
        Working space of the factor; row_r is zero between calls.
    multiplier_r, spare_nd, start_nd
        Working space of the solves, and of `project_positions`.

    """

    axes: tuple[int, ...]
    order_r: NDArray[np.int64]
    i_r: NDArray[np.int64]
    j_r: NDArray[np.int64]
    image_rd: NDArray[np.float64]
    length_r: NDArray[np.float64]
    scale_r: NDArray[np.float64]
    inverse_mass_n: NDArray[np.float64]
    row_e: NDArray[np.int64]
    column_e: NDArray[np.int64]
    particle_e: NDArray[np.int64]
    slot_e: NDArray[np.int64]
    sign_e: NDArray[np.float64]
    first_r: NDArray[np.int64]
    start_r: NDArray[np.int64]
    normal_rd: NDArray[np.float64]
    distance_r: NDArray[np.float64]
    error_r: NDArray[np.float64]
    factor: NDArray[np.float64]
    inverse_pivot_r: NDArray[np.float64]
    last_r: NDArray[np.int64]
    block_b: NDArray[np.int64]
    part_b: NDArray[np.int64]
    who_q: NDArray[np.int64]
    from_q: NDArray[np.int64]
    near_k: NDArray[np.int64]
    sense_k: NDArray[np.float64]
    diagonal_r: NDArray[np.float64]
    row_r: NDArray[np.float64]
    multiplier_r: NDArray[np.float64]
    spare_nd: NDArray[np.float64]
    start_nd: NDArray[np.float64]


def make_link_system(
    links: Links,
    particles: int,
    dimension: int,
    *,
    mean_diameter: float = 0.0,
    mass_n: NDArray[np.float64] | None = None,
) -> LinkSystem:
    """Return the links compiled for projections: the structure only, `refill` puts the numbers in.

    Parameters
    ----------
    links
        The links, for the rows of the positions that the other functions will get.
    particles, dimension
        Number of particles and of Cartesian axes.
    mean_diameter
        Errors of a link are relative to the larger of its length and this [length].
    mass_n
        (N,) masses; equal when left out.

    Examples
    --------
    >>> chain = Links([0, 1], [1, 2], [[0, 0]] * 2, [1.0, 1.0])
    >>> system = make_link_system(chain, 3, 2)
    >>> position = np.array([[0.0, 0.0], [1.1, 0.0], [1.1, 1.0]])
    >>> _, dependent = refill(system, position, 9.0 * np.eye(2))
    >>> dependent, system.error_r.round(12).tolist()
    (0, [0.0, 0.1])

    """
    order = link_order(links.i_l, links.j_l, particles)
    i, j = links.i_l[order], links.j_l[order]
    (row, column, shared, slot, sign), (first, start, last, block), parts = link_envelope(i, j, particles)
    part, who, place, near, sense = parts
    count, d = len(order), dimension
    length = links.length_l[order]
    inverse = np.ones(particles) if mass_n is None else 1.0 / mass_n
    return LinkSystem(
        axes=(0,) * d, order_r=order, i_r=i, j_r=j, image_rd=links.image_ld[order].astype(np.float64),
        length_r=length, scale_r=np.maximum(length, mean_diameter), inverse_mass_n=inverse,
        row_e=row, column_e=column, particle_e=shared, slot_e=slot, sign_e=sign,
        first_r=first, start_r=start, last_r=last, block_b=block,
        part_b=part, who_q=who, from_q=place, near_k=near, sense_k=sense,
        normal_rd=np.zeros((count, d)), distance_r=np.zeros(count), error_r=np.zeros(count),
        factor=np.zeros(int(start[-1])), inverse_pivot_r=np.zeros(count), diagonal_r=np.zeros(count),
        row_r=np.zeros(count), multiplier_r=np.zeros(count), spare_nd=np.zeros((particles, d)),
        start_nd=np.zeros((particles, d)),
    )  # fmt: skip


def moved_system(system: LinkSystem) -> LinkSystem:
    """Return the same links with numbers and working space of their own, for another configuration."""
    own = (
        "normal_rd", "distance_r", "error_r", "factor", "inverse_pivot_r", "diagonal_r", "row_r", "multiplier_r",
        "spare_nd", "start_nd",
    )  # fmt: skip
    return system._replace(**{name: np.zeros_like(getattr(system, name)) for name in own})


# -- the order of elimination and its envelope -------------------------------------------------------------------------


@device
def _ends(i_l, j_l, particles):
    """Return where each particle's entries begin, and the links there, in their order; one of itself stands once."""
    start = np.zeros(particles + 1, np.int64)
    for link in range(i_l.shape[0]):
        start[i_l[link] + 1] += 1
        if i_l[link] != j_l[link]:
            start[j_l[link] + 1] += 1
    for n in range(particles):
        start[n + 1] += start[n]
    entry, at = np.empty(start[particles], np.int64), start[:-1].copy()
    for link in range(i_l.shape[0]):
        i, j = i_l[link], j_l[link]
        entry[at[i]] = link
        at[i] += 1
        if i != j:
            entry[at[j]] = link
            at[j] += 1
    return start, entry


@device
def _flood(first, mark, seen, start, entry, i_l, j_l, out, begin):
    """Write the particles that hang on `first` to `out` from `begin` on, level by level; return the end."""
    seen[first] = mark
    out[begin] = first
    end, here = begin + 1, begin
    while here < end:
        i = out[here]
        here += 1
        level = end
        for h in range(start[i], start[i + 1]):
            other = j_l[entry[h]] if i_l[entry[h]] == i else i_l[entry[h]]
            if seen[other] == mark:
                continue
            seen[other] = mark
            degree = start[other + 1] - start[other]
            at = end
            while at > level and start[out[at - 1] + 1] - start[out[at - 1]] > degree:
                out[at] = out[at - 1]
                at -= 1
            out[at] = other
            end += 1
    return end


@kernel
def link_order(i_l, j_l, particles):
    """Return the links in the order of elimination: clusters by their smallest particle, along each."""
    start, entry = _ends(i_l, j_l, particles)
    seen = np.zeros(particles, np.int8)
    sequence = np.empty(particles, np.int64)
    rank = np.empty(particles, np.int64)
    order = np.empty(i_l.shape[0], np.int64)
    end = used = 0
    for first in range(particles):
        if seen[first] or start[first] == start[first + 1]:
            continue
        begin = end
        end = _flood(first, 1, seen, start, entry, i_l, j_l, sequence, begin)
        seed = first
        for k in range(begin, end):
            one = sequence[k]
            fewer = start[one + 1] - start[one] - start[seed + 1] + start[seed]
            if fewer < 0 or (fewer == 0 and one < seed):
                seed = one
        _flood(seed, 2, seen, start, entry, i_l, j_l, sequence, begin)
        for k in range(begin, end):
            rank[sequence[k]] = begin + end - 1 - k
        for k in range(end - 1, begin - 1, -1):
            one = sequence[k]
            low = used
            for h in range(start[one], start[one + 1]):
                link = entry[h]
                far = rank[i_l[link]] + rank[j_l[link]] - rank[one]
                if far >= rank[one]:
                    at = used
                    while at > low and rank[i_l[order[at - 1]]] + rank[j_l[order[at - 1]]] - rank[one] > far:
                        order[at] = order[at - 1]
                        at -= 1
                    order[at] = link
                    used += 1
    return order


@kernel
def link_envelope(i_r, j_r, particles):
    """Return the tables of a `LinkSystem` that links in the order of elimination make.

    They are (row_e, column_e, particle_e, slot_e, sign_e), (first_r, start_r, last_r, block_b) and (part_b, who_q,
    from_q, near_k, sense_k).
    """
    count = i_r.shape[0]
    # a link of a particle with its own image does not change when the particle moves: it couples to no other link
    start = np.zeros(particles + 1, np.int64)
    for r in range(count):
        if i_r[r] != j_r[r]:
            start[i_r[r] + 1] += 1
            start[j_r[r] + 1] += 1
    parts = pairs = 0
    for n in range(particles):
        parts += start[n + 1] > 0
        pairs += start[n + 1] * (start[n + 1] - 1) // 2
        start[n + 1] += start[n]
    entry, at = np.empty(start[particles], np.int64), start[:-1].copy()
    first, last = np.arange(count), np.arange(count)
    for r in range(count):
        if i_r[r] != j_r[r]:
            for n in (i_r[r], j_r[r]):
                if at[n] > start[n]:
                    first[r] = min(first[r], entry[start[n]])
                entry[at[n]] = r
                at[n] += 1
    begin = np.zeros(count + 1, np.int64)
    for r in range(count):
        begin[r + 1] = begin[r] + r - first[r]
        last[first[r]] = max(last[first[r]], r)
    for r in range(1, count):
        last[r] = max(last[r], last[r - 1])
    # no later row reaches before a cluster's first
    block, blocks, ahead = np.empty(count + 1, np.int64), 1, count
    block[count] = count
    for r in range(count - 1, -1, -1):
        ahead = min(ahead, first[r])
        if ahead == r:
            blocks += 1
            block[count + 1 - blocks] = r
    block = block[count + 1 - blocks :].copy()
    row, column, shared = np.empty(pairs, np.int64), np.empty(pairs, np.int64), np.empty(pairs, np.int64)
    slot, sign = np.empty(pairs, np.int64), np.empty(pairs)
    e = 0
    for n in range(particles):
        for h in range(start[n], start[n + 1]):
            r = entry[h]
            for k in range(start[n], h):
                c = entry[k]
                row[e], column[e], shared[e] = r, c, n
                slot[e] = begin[r] + c - first[r]
                sign[e] = 1.0 if (i_r[r] == n) == (i_r[c] == n) else -1.0
                e += 1
    part, who, place = np.empty(blocks, np.int64), np.empty(parts, np.int64), np.empty(parts + 1, np.int64)
    near, sense = np.empty(entry.shape[0], np.int64), np.empty(entry.shape[0])
    q = k = b = 0
    place[0] = 0
    for r in range(count):
        if r == block[b]:
            part[b] = q
            b += 1
        if i_r[r] == j_r[r]:
            continue
        for n in (i_r[r], j_r[r]):
            if entry[start[n]] != r:
                continue
            who[q] = n
            for h in range(start[n], start[n + 1]):
                near[k] = entry[h]
                sense[k] = -1.0 if i_r[entry[h]] == n else 1.0
                k += 1
            q += 1
            place[q] = k
    part[b] = q
    return (row, column, shared, slot, sign), (first, begin, last, block), (part, who, place, near, sense)


# -- the factor --------------------------------------------------------------------------------------------------------


class Lengths(NamedTuple):
    """Unit vectors, distances, and distances less lengths of links: what `measure_lengths` sets."""

    normal_rd: NDArray[np.float64]
    distance_r: NDArray[np.float64]
    error_r: NDArray[np.float64]


@device
def measure(system, position, lattice):
    """Set unit vectors, distances and errors of the links; return the largest error over the link's scale."""
    return measure_lengths(system, Lengths(system.normal_rd, system.distance_r, system.error_r), position, lattice)


@device
def measure_lengths(system, lengths, position, lattice):
    """Set unit vectors, distances and errors of a system's links elsewhere; return the largest error over its scale."""
    image, normal = system.image_rd, lengths.normal_rd
    d = len(system.axes)
    worst = 0.0
    for r in range(system.i_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        square = 0.0
        for a in range(d):
            part = position[j, a] - position[i, a]
            for b in range(d):
                part += lattice[a, b] * image[r, b]
            normal[r, a] = part
            square += part * part
        distance = math.sqrt(square)
        for a in range(d):
            normal[r, a] /= distance
        lengths.distance_r[r] = distance
        error = distance - system.length_r[r]
        lengths.error_r[r] = error
        relative = abs(error) / system.scale_r[r]
        if not relative <= worst:
            worst = relative
    return worst


@device
def diagonal_of_a(system, r):
    """Return the diagonal of A, the sum of the inverse masses at the ends; 0 for a link of a particle to itself."""
    i, j = system.i_r[r], system.j_r[r]
    if i == j:
        return 0.0
    return system.inverse_mass_n[i] + system.inverse_mass_n[j]


@device
def _cholesky(system, begin, end):
    """Factor rows begin to end of A; return the smallest relative pivot and the number of links left out."""
    factor, first_r, start_r, inverse_r = system.factor, system.first_r, system.start_r, system.inverse_pivot_r
    smallest, dependent = 1.0, 0
    for r in range(begin, end):
        first, own = first_r[r], start_r[r] - first_r[r]
        whole = diagonal_of_a(system, r)
        rest = whole
        for c in range(first, r):
            other = start_r[c] - first_r[c]
            value = factor[own + c]
            for k in range(max(first, first_r[c]), c):
                value -= factor[own + k] * factor[other + k]
            value *= inverse_r[c]
            factor[own + c] = value
            rest -= value * value
        # written so that a pivot that is not a number counts as none
        if rest > DEPENDENT * whole:
            inverse_r[r] = 1.0 / math.sqrt(rest)
            smallest = min(smallest, rest / whole)
        else:
            inverse_r[r] = 0.0
            smallest = 0.0
            dependent += 1
    return smallest, dependent


@device
def _solve_rows(system, value_r, begin, end):
    factor, first_r, start_r, inverse_r = system.factor, system.first_r, system.start_r, system.inverse_pivot_r
    for r in range(begin, end):
        own = start_r[r] - first_r[r]
        rest = value_r[r]
        for c in range(first_r[r], r):
            rest -= factor[own + c] * value_r[c]
        value_r[r] = rest * inverse_r[r]
    for r in range(end - 1, begin - 1, -1):
        own = start_r[r] - first_r[r]
        value = value_r[r] * inverse_r[r]
        value_r[r] = value
        for c in range(first_r[r], r):
            value_r[c] -= factor[own + c] * value


@inner_lean
def solve_links(system, value_r):
    """Set value = A^-1 value, in the order of elimination."""
    _solve_rows(system, value_r, 0, value_r.shape[0])


@device
def _enlarges(system, begin, end):
    """Return whether A^-1, times its diagonal, enlarges a vector of scattered signs beyond what Cholesky bears."""
    row = system.row_r
    for r in range(begin, end):
        row[r] = diagonal_of_a(system, r) * (1.0 if (((r - begin + 1) * 2654435761) >> 13) & 1 else -1.0)
    _solve_rows(system, row, begin, end)
    largest = 0.0
    for r in range(begin, end):
        largest = max(largest, abs(row[r]))
        row[r] = 0.0
    return not largest < _ENLARGED


@device
def _rotate_in(system, column, reach):
    """Rotate the row that stands in `row_r`, zero outside column to reach, into the triangle; leave zeros there."""
    factor, first_r, start_r = system.factor, system.first_r, system.start_r
    row, diagonal = system.row_r, system.diagonal_r
    c = column
    while c <= reach:
        part = row[c]
        if part != 0.0:
            row[c] = 0.0
            before = diagonal[c]
            whole = math.sqrt(before * before + part * part)
            if whole == 0.0:  # the square of a part below rounding of all others
                c += 1
                continue
            diagonal[c] = whole
            cosine, sine = before / whole, part / whole
            for r in range(c + 1, system.last_r[c] + 1):
                if first_r[r] <= c:
                    place = start_r[r] - first_r[r] + c
                    above, here = factor[place], row[r]
                    factor[place] = cosine * above + sine * here
                    row[r] = cosine * here - sine * above
            if before == 0.0:
                # the triangle had no row here yet: all of this one has become it
                for r in range(c + 1, system.last_r[c] + 1):
                    row[r] = 0.0
                return
            reach = max(reach, system.last_r[c])
        c += 1


@device
def _rotations(system, b, damping):
    """Set R for the links of block b, of W^(1/2) Omega above damping^(1/2) times its column norms on a diagonal.

    Returns what `_cholesky` does; no link is left out when there is damping.
    """
    begin, end = system.block_b[b], system.block_b[b + 1]
    factor, first_r, start_r = system.factor, system.first_r, system.start_r
    row, diagonal, inverse_r, normal = system.row_r, system.diagonal_r, system.inverse_pivot_r, system.normal_rd
    for k in range(start_r[begin], start_r[end]):
        factor[k] = 0.0
    for r in range(begin, end):
        row[r] = diagonal[r] = 0.0
    damped = begin if damping > 0.0 else end
    # every particle gives a row for each axis, and every link one of damping, in turn: so that rows, which go down the
    # triangle until they meet one of its rows that is empty yet, meet it soon
    d = len(system.axes)
    q, a, last_q = system.part_b[b], 0, system.part_b[b + 1]
    while q < last_q or damped < end:
        if damped < end and (q == last_q or damped < system.near_k[system.from_q[q]]):
            column = reach = damped
            row[damped] = math.sqrt(damping * diagonal_of_a(system, damped))
            damped += 1
        else:
            low, high = system.from_q[q], system.from_q[q + 1]
            column, reach = system.near_k[low], system.near_k[high - 1]
            root = math.sqrt(system.inverse_mass_n[system.who_q[q]])
            for k in range(low, high):
                row[system.near_k[k]] += system.sense_k[k] * root * normal[system.near_k[k], a]
            a += 1
            if a == d:
                a = 0
                q += 1
        _rotate_in(system, column, reach)
    smallest, dependent = 1.0, 0
    for r in range(begin, end):
        whole = diagonal_of_a(system, r)
        square = diagonal[r] * diagonal[r]
        if square > _DEPENDENT_ROTATED * whole or (damping > 0.0 and square > 0.0):
            inverse_r[r] = 1.0 / diagonal[r]
            smallest = min(smallest, square / whole)
        else:
            # without its column, what its row holds of later links belongs to their rows
            inverse_r[r] = diagonal[r] = 0.0
            smallest = 0.0
            dependent += 1
            for c in range(r + 1, system.last_r[r] + 1):
                if first_r[c] <= r:
                    place = start_r[c] - first_r[c] + r
                    row[c] = factor[place]
                    factor[place] = 0.0
            _rotate_in(system, r + 1, system.last_r[r])
    return smallest, dependent


@inner_lean
def factorize_links(system, damping):
    """Factor A, or A + damping diag(A) above 0; return the smallest relative pivot and the number of links left out.

    The relative pivot of a link is the squared sine of the angle between its gradient and those of the links before
    it. Links below DEPENDENT are left out: they get no multiplier, so that projections hold for redundant links too.
    The system must have been measured at its configuration.
    """
    axes, normal, factor, weight = system.axes, system.normal_rd, system.factor, system.inverse_mass_n
    d = len(axes)
    for k in range(factor.shape[0]):
        factor[k] = 0.0
    for e in range(system.row_e.shape[0]):
        r, c = system.row_e[e], system.column_e[e]
        product = 0.0
        for a in range(d):
            product += normal[r, a] * normal[c, a]
        factor[system.slot_e[e]] += system.sign_e[e] * weight[system.particle_e[e]] * product
    smallest, dependent = 1.0, 0
    for b in range(system.block_b.shape[0] - 1):
        begin, end = system.block_b[b], system.block_b[b + 1]
        bad = damping > 0.0
        pivot, left_out = 0.0, 0
        if not bad:
            pivot, left_out = _cholesky(system, begin, end)
            bad = pivot < _ILL_CONDITIONED
        if not bad and pivot < _SOUND and end - begin >= _LONG:
            bad = _enlarges(system, begin, end)
        if bad:
            pivot, left_out = _rotations(system, b, damping)
        smallest = min(smallest, pivot)
        dependent += left_out
    return smallest, dependent


# -- projections and the way back --------------------------------------------------------------------------------------


@inner_lean
def refill(system, position, lattice):
    """Set the Jacobian and the factor at a configuration.

    position is (N, >= d): its first d columns are the positions. Returns the smallest relative pivot and the number of
    links left out as dependent (see `factorize_links`); the largest error is that of `measure`.
    """
    measure(system, position, lattice)
    return factorize_links(system, 0.0)


@device
def rates(system, vector_nd, of_force):
    """Set multiplier = Omega^T v, or Omega^T W F of a force; return the largest."""
    axes, normal, weight = system.axes, system.normal_rd, system.inverse_mass_n
    d = len(axes)
    largest = 0.0
    for r in range(system.i_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        wi = weight[i] if of_force else 1.0
        wj = weight[j] if of_force else 1.0
        rate = 0.0
        for a in range(d):
            rate += normal[r, a] * (wj * vector_nd[j, a] - wi * vector_nd[i, a])
        system.multiplier_r[r] = rate
        if system.inverse_pivot_r[r] > 0.0:
            largest = max(largest, abs(rate))
    return largest


@device
def push(system, value_r, vector_nd, of_force):
    """Take Omega value from a force, or W Omega value from a velocity or from positions."""
    axes, normal, weight = system.axes, system.normal_rd, system.inverse_mass_n
    d = len(axes)
    for r in range(system.i_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        wi = value_r[r] if of_force else value_r[r] * weight[i]
        wj = value_r[r] if of_force else value_r[r] * weight[j]
        for a in range(d):
            vector_nd[j, a] -= wj * normal[r, a]
            vector_nd[i, a] += wi * normal[r, a]


@inner_lean
def project_vector(system, vector_nd, out_nd, multiplier_l, of_force):
    """Take out what the links bear of a force, or what would stretch them of a velocity; see the two below."""
    d = len(system.axes)
    largest = 0.0
    for i in range(vector_nd.shape[0]):
        for a in range(d):
            out_nd[i, a] = vector_nd[i, a]
            part = abs(vector_nd[i, a])
            if of_force:
                part *= system.inverse_mass_n[i]
            largest = max(largest, part)
    order = system.order_r
    for r in range(order.shape[0]):
        multiplier_l[order[r]] = 0.0
    rate = rates(system, out_nd, of_force)
    # each further pass takes the rounding of the one before out; where A is well conditioned one is enough
    for _ in range(PASS_LIMIT):
        if not rate > AT_ROUNDING * largest:
            break
        solve_links(system, system.multiplier_r)
        for r in range(order.shape[0]):
            multiplier_l[order[r]] += system.multiplier_r[r]
        push(system, system.multiplier_r, out_nd, of_force)
        rate = rates(system, out_nd, of_force)
    return rate


@device
def project_force(system, force_nd, out_nd, multiplier_l):
    """Set out = F - Omega lambda, the force that accelerates no link; return its largest rate of a link.

    lambda are the links' multipliers, in the packing's order of links: each link adds the force -lambda n on j and
    lambda n on i, so that lambda > 0 is tension. Needs `refill` at this configuration; out may be the force itself. No
    link should depend on others: what is left of the largest rate shows when rounding won.
    """
    return project_vector(system, force_nd, out_nd, multiplier_l, True)


@device
def project_velocity(system, velocity_nd, out_nd, multiplier_l):
    """Set out = v - W Omega lambda, which changes no link's length; return its largest rate of a link."""
    return project_vector(system, velocity_nd, out_nd, multiplier_l, False)


@device
def _copy(d, source, target):
    for i in range(source.shape[0]):
        for a in range(d):
            target[i, a] = source[i, a]


@device
def _farthest(d, source, target):
    largest = 0.0
    for i in range(source.shape[0]):
        for a in range(d):
            part = abs(target[i, a] - source[i, a])
            if not part <= largest:
                largest = part
    return largest


@device
def _squares(system):
    """Return the sum of the squared errors over the diagonal of A."""
    total = 0.0
    for r in range(system.error_r.shape[0]):
        whole = diagonal_of_a(system, r)
        if whole > 0.0:
            total += system.error_r[r] * system.error_r[r] / whole
    return total


@device
def _step(system, position, lattice, damping):
    """Copy the positions to `spare_nd` and move them by a step; return the smallest pivot and the squares predicted."""
    value = system.multiplier_r
    pivot, _ = factorize_links(system, damping)
    _copy(len(system.axes), position, system.spare_nd)
    for r in range(value.shape[0]):
        value[r] = system.error_r[r]
    solve_links(system, value)
    predicted = 0.0
    for r in range(value.shape[0]):
        left = damping * value[r]
        predicted += left * left * diagonal_of_a(system, r)
    push(system, value, position, False)
    return pivot, predicted


@inner_lean
def project_positions_recorded(system, position, lattice, tolerance, iteration_limit, error_t):
    """Do what `project_positions` does; write the largest errors, at first and after each kept step, to error_t."""
    smallest, longest, farthest = 1.0, 0.0, 0.0
    spare, start = system.spare_nd, system.start_nd
    d = len(system.axes)
    worst = measure(system, position, lattice)
    first = worst
    for r in range(system.error_r.shape[0]):
        longest = max(longest, abs(system.error_r[r]))
        farthest = max(farthest, system.scale_r[r])
    farthest = min(_FAR * longest, _SWING * farthest)
    if error_t.shape[0] > 0:
        error_t[0] = worst
    _copy(d, position, start)
    damped, damping, tried, kept, refused = False, 0.0, 0, 0, 0
    while not worst <= tolerance and tried < (DAMPED if damped else 1) * iteration_limit:
        before, squares = worst, _squares(system)
        pivot, predicted = _step(system, position, lattice, damping)
        worst = measure(system, position, lattice)
        tried += 1
        if damped:
            gain = (squares - _squares(system)) / (squares - predicted) if squares > predicted else 0.0
            moved = gain > _REFUSED
            if gain > _FAIR:
                damping = damping * _LESS if damping * _LESS > _NONE else 0.0
            elif not moved:
                damping = max(damping * _MORE, _NONE)
        else:
            smallest = min(smallest, pivot)
            # A^-1 makes too much of rounding, or of the error of second order: more steps would cost digits
            moved = not (before < _NEARLY and not worst < before)
        if moved:
            kept += 1
            refused = 0
            if kept < error_t.shape[0]:
                error_t[kept] = worst
        else:
            _copy(d, spare, position)
            worst = measure(system, position, lattice)
            refused += 1
        if damped:
            if damping > _LARGEST_DAMPING or (
                refused == _IN_A_ROW and worst <= max(_ROUNDING * tolerance, _ROUNDING_FLOOR)
            ):
                break
            continue
        astray = not worst <= _ASTRAY * first
        if pivot < _SUSPECT and not _farthest(d, start, position) <= farthest:
            astray = True
        if not moved and not astray and worst <= max(_FEW * tolerance, _ROUNDING_FLOOR):
            break
        if astray or not moved or (tried == iteration_limit and not worst <= first):
            _copy(d, start, position)
            worst = measure(system, position, lattice)
            damped, damping, tried, kept, refused = True, _FIRST, 0, 0, 0
    if damped and not worst <= first:
        _copy(d, start, position)
        kept, worst = 0, measure(system, position, lattice)
    return kept, worst, smallest


@device
def project_positions(system, position, lattice, tolerance, iteration_limit):
    """Move the positions back to the links' lengths by minimum-norm Newton steps x - W Omega A^-1 c (equation 7).

    Where those lead astray, or raise the error at the end, damped ones start again from the positions given, DAMPED
    times as many at most. Returns the steps that led to where positions are, the largest error over the link's scale,
    and the smallest relative pivot met (1 when nothing had to be done). The error is never larger than it was: where no
    step helps, positions stay as they are. The factor is left at some configuration before the last: a refill away from
    the new one.
    """
    return project_positions_recorded(system, position, lattice, tolerance, iteration_limit, system.error_r[:0])


@kernel
def refill_links(system, position, lattice):
    """Call `refill` from Python."""
    return refill(system, position, lattice)


@kernel
def project_links(system, vector_nd, out_nd, multiplier_l, of_force):
    """Call `project_force` (or `project_velocity`) from Python."""
    return project_vector(system, vector_nd, out_nd, multiplier_l, of_force)


@kernel
def record_link_positions(system, position, lattice, tolerance, iteration_limit, error_t):
    """Call `project_positions_recorded` from Python."""
    return project_positions_recorded(system, position, lattice, tolerance, iteration_limit, error_t)


@inner_lean
def set_multipliers(system, rate_l, motion_nd, multiplier_l):
    """Set motion = Omega multiplier, multiplier = A^-1 rate: for equal masses the shortest motion with these rates."""
    order, value = system.order_r, system.multiplier_r
    motion_nd[:] = 0.0
    multiplier_l[:] = 0.0
    # each further pass takes the rounding of the one before out
    for _ in range(PASS_LIMIT):
        rates(system, motion_nd, True)
        rest, largest = 0.0, 0.0
        for r in range(order.shape[0]):
            value[r] -= rate_l[order[r]]
            rest = max(rest, abs(value[r]))
            largest = max(largest, abs(rate_l[order[r]]))
        if not rest > AT_ROUNDING * largest:
            break
        solve_links(system, value)
        for r in range(order.shape[0]):
            multiplier_l[order[r]] -= value[r]
        push(system, value, motion_nd, True)


@kernel
def solve_rates(system, rate_l, motion_nd, multiplier_l):
    """Call `set_multipliers` from Python."""
    set_multipliers(system, rate_l, motion_nd, multiplier_l)
