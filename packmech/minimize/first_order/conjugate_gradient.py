# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Nonlinear conjugate gradients (Polak, Ribiere, Polyak), started afresh where the direction no longer descends."""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.check import positive, real
from packmech.constraints.compiled_links import along_links
from packmech.jit.compiled import kernel
from packmech.minimize.first_order.line_search import copy_to, dot, line_search, longest, read_places
from packmech.minimize.passes.kernels import FLOOR, RUNNING, STALLED, Goal, clear, judge, moved_far, net_forces, survey
from packmech.minimize.passes.pair_list import follow
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _STIFFNESS, _LENGTH, _SLOPE, _NUMBERS = range(6)
# the stiffness, which sets the rounding floor, is looked at again after this many steps
_RENEW = 64
# a search that fails within this many floors of balance has met rounding
_FLOORS = 64.0


class ConjugateGradient(NamedTuple):
    """Nonlinear conjugate gradients (Polak-Ribiere-Polyak, Nocedal and Wright, Numerical Optimization, eq. 5.45).

    The line search looks at slopes, not at energies, so it has no floor above that of the forces.

    Parameters
    ----------
    slope_ratio
        A search ends where the slope has fallen to this part of its first value.
    largest_step
        No particle moves farther than this in one step [largest diameter; smallest under a diverging law].

    """

    slope_ratio: float = 0.1
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        real("method.slope_ratio", self.slope_ratio, above=0.0, below=1.0)
        positive("method.largest_step", self.largest_step)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        self.check()
        return program.progress(_NUMBERS, 2)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        return program.advance(conjugate_gradient_steps, self, goal, progress, steps)


@kernel
def conjugate_gradient_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list; velocity_nd is the direction."""
    force_f = force_nd.reshape(force_nd.size)
    direction_f = velocity_nd.reshape(force_nd.size)
    start_f = vector_kf[0]
    before_f = vector_kf[1]
    if moved_far(axes, row, space, pairs.number, 0.0):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    sums = net_forces(None, effects, axes, row, force_nd, velocity_nd, space, pairs, None)
    number[_EVALUATIONS] += 1.0
    step = 0
    while True:
        if int(number[_STEP]) % _RENEW == 0:
            number[_STIFFNESS] = survey(effects, row, pairs).stiffness
        status = judge(sums, number[_STIFFNESS], space, goal)
        if status != RUNNING or step == steps:
            break
        square = dot(force_f, force_f)
        steepest = True
        slope = square
        if number[_SLOPE] > 0.0:
            earlier = dot(before_f, before_f)
            turn = (square - dot(force_f, before_f)) / earlier
            if turn > 0.0:
                for k in range(direction_f.shape[0]):
                    direction_f[k] = force_f[k] + turn * direction_f[k]
                along_links(space.links, velocity_nd)
                slope = dot(force_f, direction_f)
                steepest = slope <= 1e-4 * math.sqrt(square * dot(direction_f, direction_f))
        first = number[_LENGTH] * number[_SLOPE] / slope
        if steepest:
            copy_to(direction_f, force_f)
            slope = square
            first = 0.5 / number[_STIFFNESS]
        copy_to(before_f, force_f)
        read_places(axes, row, start_f)
        fastest = longest(axes, velocity_nd)
        reached = line_search(
            effects, axes, row, force_nd, velocity_nd, space, pairs, start_f,
            slope, first, largest_step / fastest, fastest, settings.slope_ratio, settings.slope_ratio,
        )  # fmt: skip
        pairs = reached.pairs
        sums = reached.sums
        number[_EVALUATIONS] += reached.evaluations
        number[_LENGTH] = reached.length
        number[_SLOPE] = slope if reached.good else 0.0
        number[_STEP] += 1.0
        step += 1
        if steepest and not reached.good:
            status = FLOOR if math.sqrt(sums.largest) <= _FLOORS * number[_STIFFNESS] * space.resolution[0] else STALLED
            break
    return status, pairs
