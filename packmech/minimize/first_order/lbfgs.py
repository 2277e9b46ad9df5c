# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""L-BFGS: a quasi-Newton direction from the last few steps, and the line search that looks at slopes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from packmech.check import check_memory, integer, positive, real
from packmech.constraints.compiled_links import along_links
from packmech.jit.compiled import device, kernel
from packmech.minimize.first_order.line_search import add_to, copy_to, dot, line_search, longest, read_places
from packmech.minimize.passes.kernels import FLOOR, RUNNING, STALLED, Goal, clear, judge, moved_far, net_forces, survey
from packmech.minimize.passes.pair_list import follow
from packmech.minimize.program import Program, Progress

# places in Progress.number, followed by 1 / (s.y) of each remembered step
_STEP, _EVALUATIONS, _STIFFNESS, _KNOWN, _NEWEST, _FIXED = range(6)
_RENEW = 64
_FLOORS = 64.0


class LBFGS(NamedTuple):
    """Limited-memory BFGS (Nocedal and Wright, Numerical Optimization, algorithm 7.4).

    A step is taken where the slope lies between -0.8 and `slope_ratio` of its first value (the approximate Wolfe
    conditions of Hager and Zhang, SIAM J. Optim. 16, 170, 2005), which needs no energies and so knows no floor above
    that of the forces.

    Parameters
    ----------
    memory
        Number of steps remembered.
    slope_ratio
        A search ends where the slope has fallen to this part of its first value.
    largest_step
        No particle moves farther than this in one step [largest diameter; smallest under a diverging law].

    """

    memory: int = 8
    slope_ratio: float = 0.9
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        integer("method.memory", self.memory, at_least=1)
        real("method.slope_ratio", self.slope_ratio, above=0.0, below=1.0)
        positive("method.largest_step", self.largest_step)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        self.check()
        check_memory("method.memory", 16.0 * self.memory * program.velocity_nd.size)
        return program.progress(_FIXED + self.memory, 2 + 2 * self.memory)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        return program.advance(lbfgs_steps, self, goal, progress, steps)


@device
def _quasi_newton(force_f, direction_f, step_kf, change_kf, number):
    """Set the direction to the approximate inverse Hessian times the force (two-loop recursion)."""
    memory = step_kf.shape[0]
    known = int(number[_KNOWN])
    newest = int(number[_NEWEST])
    part = np.zeros(memory)
    copy_to(direction_f, force_f)
    for age in range(known):
        k = (newest - age) % memory
        part[k] = number[_FIXED + k] * dot(step_kf[k], direction_f)
        add_to(direction_f, -part[k], change_kf[k])
    scale = 1.0 / (number[_FIXED + newest] * dot(change_kf[newest], change_kf[newest]))
    for f in range(direction_f.shape[0]):
        direction_f[f] *= scale
    for age in range(known - 1, -1, -1):
        k = (newest - age) % memory
        add_to(direction_f, part[k] - number[_FIXED + k] * dot(change_kf[k], direction_f), step_kf[k])


@kernel
def lbfgs_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list; velocity_nd is the direction."""
    force_f = force_nd.reshape(force_nd.size)
    direction_f = velocity_nd.reshape(force_nd.size)
    memory = (vector_kf.shape[0] - 2) // 2
    start_f = vector_kf[0]
    before_f = vector_kf[1]
    step_kf = vector_kf[2 : 2 + memory]
    change_kf = vector_kf[2 + memory :]
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
        steepest = number[_KNOWN] == 0.0
        slope = square
        first = 1.0
        if not steepest:
            _quasi_newton(force_f, direction_f, step_kf, change_kf, number)
            along_links(space.links, velocity_nd)
            slope = dot(force_f, direction_f)
            steepest = not slope > 1e-6 * math.sqrt(square * dot(direction_f, direction_f))
        if steepest:
            copy_to(direction_f, force_f)
            slope = square
            first = 0.5 / number[_STIFFNESS]
            number[_KNOWN] = 0.0
        copy_to(before_f, force_f)
        read_places(axes, row, start_f)
        fastest = longest(axes, velocity_nd)
        reached = line_search(
            effects, axes, row, force_nd, velocity_nd, space, pairs, start_f,
            slope, first, largest_step / fastest, fastest, 0.8, settings.slope_ratio,
        )  # fmt: skip
        pairs = reached.pairs
        sums = reached.sums
        number[_EVALUATIONS] += reached.evaluations
        number[_STEP] += 1.0
        step += 1
        if not reached.good:
            if steepest:
                status = (
                    FLOOR if math.sqrt(sums.largest) <= _FLOORS * number[_STIFFNESS] * space.resolution[0] else STALLED
                )
                break
            number[_KNOWN] = 0.0
            continue
        newest = (int(number[_NEWEST]) + 1) % memory
        read_places(axes, row, step_kf[newest])
        add_to(step_kf[newest], -1.0, start_f)
        copy_to(change_kf[newest], before_f)
        add_to(change_kf[newest], -1.0, force_f)
        curvature = dot(step_kf[newest], change_kf[newest])
        sizes = dot(step_kf[newest], step_kf[newest]) * dot(change_kf[newest], change_kf[newest])
        if curvature > 1e-10 * math.sqrt(sizes):
            number[_FIXED + newest] = 1.0 / curvature
            number[_NEWEST] = newest
            number[_KNOWN] = min(number[_KNOWN] + 1.0, float(memory))
    return status, pairs
