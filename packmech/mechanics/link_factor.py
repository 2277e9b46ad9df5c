# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The triangular factor R of the links' Jacobian, R^T R = A = Omega^T W Omega, in the envelope of A.

Cholesky's factor of A costs least, but A has the square of Omega's condition number: long chains whose angles are
held, the straighter the worse, leave it no digit. For clusters that show this, R comes from rotating the rows of
W^(1/2) Omega into a triangle one by one (J. A. George and M. T. Heath, Linear Algebra Appl. 34, 69, 1980). It fills the
same envelope, and a step of minimum norm, W Omega (R^T R)^-1 c, then errs by the condition number itself times rounding
(C. C. Paige, Math. Comp. 27, 873, 1973: the semi-normal equations are stable for steps of minimum norm).
"""

from __future__ import annotations

import math

from packmech.compiled import device

# a link whose gradient lies, to this square of the sine, in the span of the links before it, takes no part in solves
DEPENDENT = 1e-12
# the same by rotations, which know sines to rounding and not only their squares
_DEPENDENT_ROTATED = 1e-16
# Cholesky's factor does where all relative pivots are above this and A^-1 enlarges nothing by more than the second
_SUSPECT, _ENLARGED = 1e-9, 1e8
# pivots above this are those of chains and rings without angles: nothing is nearly dependent
_SOUND = 0.4
# in clusters of fewer links relative pivots tell of the condition number
_LONG = 16


@device
def whole_of(system, r):
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
        whole = whole_of(system, r)
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


@device
def solve_links(system, value_r):
    """Set value = A^-1 value, in the order of elimination."""
    _solve_rows(system, value_r, 0, value_r.shape[0])


@device
def _enlarges(system, begin, end):
    """Return whether A^-1, times its diagonal, enlarges a vector of scattered signs beyond what Cholesky bears."""
    row = system.row_r
    for r in range(begin, end):
        row[r] = whole_of(system, r) * (1.0 if (((r - begin + 1) * 2654435761) >> 13) & 1 else -1.0)
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
            row[damped] = math.sqrt(damping * whole_of(system, damped))
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
        whole = whole_of(system, r)
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


@device
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
            bad = pivot < _SUSPECT
        if not bad and pivot < _SOUND and end - begin >= _LONG:
            bad = _enlarges(system, begin, end)
        if bad:
            pivot, left_out = _rotations(system, b, damping)
        smallest = min(smallest, pivot)
        dependent += left_out
    return smallest, dependent
