# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The path of steepest descent, integrated to a tolerance: which minimum a start belongs to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from packmech.check import positive, real
from packmech.jit.compiled import device, inner_kernel, kernel
from packmech.minimize.first_order.line_search import copy_to, longest, read_places
from packmech.minimize.passes.kernels import RUNNING, STALLED, Goal, clear, judge, moved_far, net_forces, survey
from packmech.minimize.passes.pair_list import follow
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _STIFFNESS, _TIME_STEP, _NUMBERS = range(5)
_RENEW = 16
# a step is shortened where its error is too large, and chosen so much shorter than the error would allow
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0
# the pair is stable to 2.5 over the largest curvature, which is at most twice the largest sum of stiffnesses
_STABLE = 1.2
# shorter steps than this, over the time in which the stiffest particle relaxes, are none
_SHORTEST = 1e-12


class SteepestDescent(NamedTuple):
    """The path dx/dt = F, overdamped motion against a background, by an embedded Runge-Kutta pair with adaptive steps.

    Each starting point belongs to one minimum, the one that this path leads to; minimizers that take larger steps end
    in others. The pair is that of Bogacki and Shampine, of orders 3 and 2, Appl. Math. Lett. 2, 321 (1989). Steps are
    as long as the tolerance and the stiffest particle allow: near jamming, where soft modes relax slowly, there are
    many.

    Parameters
    ----------
    tolerance
        Error of a particle's displacement in a step [smallest diameter].
    largest_step
        No particle moves farther than this in one step [largest diameter; smallest under a diverging law].

    """

    tolerance: float = 1e-8
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        real("method.tolerance", self.tolerance, above=0.0, below=1.0)
        positive("method.largest_step", self.largest_step)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        self.check()
        return program.progress(_NUMBERS, 4)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps, those that were too long counted; return the status code."""
        allowed = self.tolerance * 2.0 * float(program.scene.packing.radius_n.min())
        return program.advance(descent_steps, _DescentNumbers(allowed), goal, progress, steps, self.largest_step)


class _DescentNumbers(NamedTuple):
    """The error allowed in a step [length]."""

    allowed: float


@device
def _start_at(axes, row, start_f, velocity_nd, dt):
    """Set the rows to their places at the start of the step, moved by dt times the velocities."""
    d = len(axes)
    for i in range(row.shape[0]):
        for a in range(d):
            row[i, a] = start_f[i * d + a] + dt * velocity_nd[i, a]


@inner_kernel
def _force_at(effects, axes, row, force_nd, velocity_nd, space, pairs, start_f, dt, moved):
    """Move the rows by dt times the velocities from the start and take the forces there; return sums and pair list."""
    _start_at(axes, row, start_f, velocity_nd, dt)
    if moved_far(axes, row, space, pairs.number, moved + dt * longest(axes, velocity_nd)):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    return net_forces(None, effects, axes, row, force_nd, velocity_nd, space, pairs, None), pairs


@kernel
def descent_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list."""
    force_f = force_nd.reshape(force_nd.size)
    velocity_f = velocity_nd.reshape(force_nd.size)
    start_f, first_f, second_f, third_f = vector_kf[0], vector_kf[1], vector_kf[2], vector_kf[3]
    if moved_far(axes, row, space, pairs.number, 0.0):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    clear(velocity_nd)
    sums = net_forces(None, effects, axes, row, force_nd, velocity_nd, space, pairs, None)
    number[_EVALUATIONS] += 1.0
    step = 0
    while True:
        if int(number[_STEP]) % _RENEW == 0:
            number[_STIFFNESS] = survey(effects, row, pairs).stiffness
        status = judge(sums, number[_STIFFNESS], space, goal)
        if status != RUNNING or step == steps:
            break
        if number[_TIME_STEP] == 0.0:
            number[_TIME_STEP] = 0.1 / number[_STIFFNESS]
        read_places(axes, row, start_f)
        copy_to(first_f, force_f)
        # beyond the bound of stability, errors within the tolerance would be kept alive for ever
        dt = min(number[_TIME_STEP], _STABLE / number[_STIFFNESS], largest_step / longest(axes, force_nd))
        copy_to(velocity_f, first_f)
        sums, pairs = _force_at(effects, axes, row, force_nd, velocity_nd, space, pairs, start_f, 0.5 * dt, 0.0)
        far = 0.5 * dt * longest(axes, velocity_nd)
        copy_to(second_f, force_f)
        copy_to(velocity_f, second_f)
        sums, pairs = _force_at(effects, axes, row, force_nd, velocity_nd, space, pairs, start_f, 0.75 * dt, far)
        far = 0.75 * dt * longest(axes, velocity_nd)
        copy_to(third_f, force_f)
        for f in range(force_f.shape[0]):
            velocity_f[f] = (2.0 * first_f[f] + 3.0 * second_f[f] + 4.0 * third_f[f]) / 9.0
        sums, pairs = _force_at(effects, axes, row, force_nd, velocity_nd, space, pairs, start_f, dt, far)
        far = dt * longest(axes, velocity_nd)
        number[_EVALUATIONS] += 3.0
        number[_STEP] += 1.0
        step += 1
        for f in range(force_f.shape[0]):
            velocity_f[f] = -5.0 / 72.0 * first_f[f] + second_f[f] / 12.0 + third_f[f] / 9.0 - force_f[f] / 8.0
        error = dt * longest(axes, velocity_nd) / settings.allowed
        good = error <= 1.0
        if error < np.inf:
            number[_TIME_STEP] = dt * min(_GROW, max(_SHRINK, _SAFETY * max(error, 1e-12) ** (-1.0 / 3.0)))
        else:
            number[_TIME_STEP] = dt * _SHRINK
        if not good:
            if number[_TIME_STEP] * number[_STIFFNESS] < _SHORTEST:
                status = STALLED
                break
            clear(velocity_nd)
            sums, pairs = _force_at(effects, axes, row, force_nd, velocity_nd, space, pairs, start_f, 0.0, far)
            # the forces there are those that the step began with
            number[_EVALUATIONS] += 1.0
    clear(velocity_nd)
    return status, pairs
