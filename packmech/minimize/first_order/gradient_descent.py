# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Gradient descent: down the force by steps that the stiffest particle bounds. Slow, simple, and true to the basin."""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.check import positive, real
from packmech.jit.compiled import kernel
from packmech.minimize.passes.kernels import RUNNING, Goal, clear, judge, move_pass, moved_far, net_forces, survey
from packmech.minimize.passes.pair_list import follow
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _STIFFNESS, _NUMBERS = range(4)
_RENEW = 16


class GradientDescent(NamedTuple):
    """Explicit Euler steps of dx/dt = F: x = x + step F / k, k the largest sum of contact stiffnesses on one particle.

    Parameters
    ----------
    step
        Step [1]; stable below 1. Smaller ones follow the path of steepest descent more closely.
    largest_step
        No particle moves farther than this in one step [largest diameter; smallest under a diverging law].

    """

    step: float = 0.8
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        real("method.step", self.step, above=0.0, at_most=1.0)
        positive("method.largest_step", self.largest_step)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        self.check()
        return program.progress(_NUMBERS, 0)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        return program.advance(gradient_descent_steps, self, goal, progress, steps)


@kernel
def gradient_descent_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list."""
    if moved_far(axes, row, space, pairs.number, 0.0):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    clear(velocity_nd)
    step = 0
    while True:
        sums = net_forces(None, effects, axes, row, force_nd, velocity_nd, space, pairs, None)
        number[_EVALUATIONS] += 1.0
        if int(number[_STEP]) % _RENEW == 0:
            number[_STIFFNESS] = survey(effects, row, pairs).stiffness
        status = judge(sums, number[_STIFFNESS], space, goal)
        if status != RUNNING or step == steps:
            break
        push = settings.step / number[_STIFFNESS]
        push = min(push, largest_step / math.sqrt(sums.largest))
        _, fastest2 = move_pass(None, axes, row, force_nd, velocity_nd, pairs, 0.0, push, 1.0)
        if moved_far(axes, row, space, pairs.number, math.sqrt(fastest2)):
            pairs, _ = follow(axes, row, space, pairs, None)
        number[_STEP] += 1.0
        step += 1
    return status, pairs
