# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links that leave a front together with one coordinate each: it follows the others, and neither costs a dense pivot.

A link's row holds a few coordinates only when it enters a front. Reduced against each other (Gauss-Jordan) the rows
say w + T v = g for one coordinate w each and the rest v. Then w goes, with the link's force as its reaction:

    A' = A - T s - s T + h T T,   s the row of w in A, h its diagonal

which touches the few rows that T names, and counts as one positive and one negative pivot.
"""

from __future__ import annotations

from packmech.compiled import device

# a coordinate follows the others where its share of the link's reduced row is at least this, and growth stays small
_SHARE = 0.25


@device
def reduce_links(line, share, count, width, own, unit, taken, column):
    """Reduce the first rows of `line` (links, coordinates: `own` ones first), and with them those of `share`.

    `column` gets the coordinate that each row is solved for, -1 where none is fit; `taken` marks these coordinates.
    Return the number of rows solved for.
    """
    solved = 0
    for k in range(own):
        taken[k] = False
    for h in range(count):
        for k in range(count):
            share[h, k] = 0.0
        share[h, h] = 1.0
        column[h] = -1
    for h in range(count):
        best, most = -1, _SHARE * unit
        for k in range(own):
            if not taken[k] and abs(line[h, k]) > most:
                best, most = k, abs(line[h, k])
        if best < 0:
            continue
        inverse = 1.0 / line[h, best]
        for k in range(width):
            line[h, k] *= inverse
        for k in range(h + 1):
            share[h, k] *= inverse
        line[h, best] = 1.0
        for other in range(count):
            factor = line[other, best]
            if other != h and factor != 0.0:
                for k in range(width):
                    line[other, k] -= factor * line[h, k]
                line[other, best] = 0.0
                for k in range(count):
                    share[other, k] -= factor * share[h, k]
        taken[best] = True
        column[h] = best
        solved += 1
    return solved


@device
def take_paired(front, n, k, at, value, first, last, line):
    """Take row k, the coordinate of a paired link, out of the rest: T has `value` at the places `at`, first..last."""
    half = 0.5 * front[k * n + k]
    for x in range(k + 1, n):
        line[x] = front[k * n + x]
    for h in range(first, last):
        line[at[h]] -= half * value[h]
    for h in range(first, last):
        v, factor = at[h], value[h]
        for x in range(k + 1, v):
            front[x * n + v] -= factor * line[x]
        front[v * n + v] -= factor * line[v]
        for x in range(v, n):
            front[v * n + x] -= factor * line[x]
