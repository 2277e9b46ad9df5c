# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Newton's way back to the lengths of links, compiled, damped where it would lead astray.

A full step is x - W Omega A^-1 c (equation 7). Where A is ill-conditioned it follows the error of second order, which
A^-1 enlarges, far away from places that are near. Then x - W Omega (A + mu D)^-1 c is taken, D the diagonal of A: the
least square of the errors linearized with mu times that of the step, so that stiff directions come right first and soft
ones as mu falls (K. Levenberg, Q. Appl. Math. 2, 164, 1944; D. Marquardt, J. SIAM 11, 431, 1963). No such step is kept
that raises the errors.
"""

from __future__ import annotations

from packmech.compiled import device
from packmech.mechanics.link_factor import factorize_links, solve_links, whole_of
from packmech.mechanics.link_system import measure, push

# relative errors below this only fall, as long as rounding lets them
_NEARLY = 1e-7
# errors within so many tolerances that fall no further are rounding of the positions
_ROUNDING, _FEW = 8.0, 2.0
# what no coordinates of unit size can do better than, whatever the tolerance
_LEAST = 1e-14
# steps have gone astray where the largest error has grown by this factor, or where links nearly depend on each other
# and a particle has gone farther than this many of the largest errors
_ASTRAY, _FAR = 4.0, 100.0
# links with a relative pivot below this nearly depend on each other
_SUSPECT = 1e-3
# damping at the start, below what it is none, above what steps lead nowhere
_FIRST, _NONE, _MOST = 1e-2, 1e-20, 1e2
# parts of the predicted fall of the squares below which a step is refused, or damping stays
_REFUSED, _FAIR = 1e-3, 0.5
# factors on the damping
_LESS, _MORE = 0.05, 10.0
# damped steps for each full one, and refused ones in a row that tell that no digits are left
DAMPED, _IN_A_ROW = 5, 8


@device
def _copy(d, source, target):
    for i in range(source.shape[0]):
        for a in range(d):
            target[i, a] = source[i, a]


@device
def _farthest(d, source, target):
    most = 0.0
    for i in range(source.shape[0]):
        for a in range(d):
            part = abs(target[i, a] - source[i, a])
            if not part <= most:
                most = part
    return most


@device
def _squares(system):
    """Return the sum of the squared errors over the diagonal of A."""
    total = 0.0
    for r in range(system.error_r.shape[0]):
        whole = whole_of(system, r)
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
        predicted += left * left * whole_of(system, r)
    push(system, value, position, False)
    return pivot, predicted


@device
def reaffix_recorded(system, position, lattice, tolerance, most_iterations, error_t):
    """Do what `reaffix` does and write the largest error before and after each step that was kept to error_t."""
    smallest, longest = 1.0, 0.0
    spare, start = system.spare_nd, system.start_nd
    d = len(system.axes)
    worst = measure(system, position, lattice)
    first = worst
    for r in range(system.error_r.shape[0]):
        longest = max(longest, abs(system.error_r[r]))
    if error_t.shape[0] > 0:
        error_t[0] = worst
    _copy(d, position, start)
    damped, damping, tried, kept, refused = False, 0.0, 0, 0, 0
    while not worst <= tolerance and tried < (DAMPED if damped else 1) * most_iterations:
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
            if damping > _MOST or (refused == _IN_A_ROW and worst <= max(_ROUNDING * tolerance, _LEAST)):
                break
            continue
        astray = not worst <= _ASTRAY * first
        if pivot < _SUSPECT and not _farthest(d, start, position) <= _FAR * longest:
            astray = True
        if not moved and not astray and worst <= max(_FEW * tolerance, _LEAST):
            break
        if astray or not moved or (tried == most_iterations and not worst <= first):
            _copy(d, start, position)
            worst = measure(system, position, lattice)
            damped, damping, tried, kept, refused = True, _FIRST, 0, 0, 0
    if damped and not worst <= first:
        _copy(d, start, position)
        kept, worst = 0, measure(system, position, lattice)
    return kept, worst, smallest


@device
def reaffix(system, position, lattice, tolerance, most_iterations):
    """Move the positions back to the links' lengths by minimum-norm Newton steps x - W Omega A^-1 c (equation 7).

    Where those lead astray, or raise the error at the end, damped ones start again from the positions given, DAMPED
    times as many at most. Returns the steps that led to where positions are, the largest error over the link's scale,
    and the smallest relative pivot met (1 when nothing had to be done). The error is never larger than it was: where no
    step helps, positions stay as they are. The factor is left at some configuration before the last: a refill away from
    the new one.
    """
    return reaffix_recorded(system, position, lattice, tolerance, most_iterations, system.error_r[:0])
