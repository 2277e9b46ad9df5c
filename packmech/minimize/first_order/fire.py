# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""FIRE, the fast inertial relaxation engine: damped motion steered downhill.

Bitzek et al., Phys. Rev. Lett. 97, 170201 (2006), and its second form, Guénolé et al., Comput. Mater. Sci.
175, 109584 (2020).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from packmech.check import positive, real
from packmech.constraints.compiled_links import speeds
from packmech.jit.compiled import device, kernel
from packmech.minimize.passes.kernels import RUNNING, Goal, clear, move_pass, moved_far, net_forces, survey
from packmech.minimize.passes.pair_list import DISPLACED, follow
from packmech.minimize.passes.strains import bring_anchors, judge_all, move_box, pull_box, virial_of, with_rates
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _DT, _ALPHA, _DOWNHILL, _SPEED2, _FASTEST2, _STIFFNESS, _MOBILITY, _NUMBERS = range(10)

# the stiffness is looked at again after this many steps, and whenever motion starts again
_RENEW = 64


class Fire(NamedTuple):
    """FIRE as Bitzek et al. describe it, with semi-implicit Euler steps.

    Times are in units of sqrt(m / k) with k a fifth of the largest sum of contact stiffnesses on one particle, so that
    one set of numbers serves every law, size and unit; particles have equal mass.

    Parameters
    ----------
    dt, dt_max, dt_min
        First, largest and smallest time step [sqrt(m / k)].
    delay
        Steps downhill before dt grows.
    grow, shrink
        Factors on dt downhill and after a stop.
    mixing, mixing_decay
        Fraction of the velocity turned towards the force each step, and the factor on it downhill.
    largest_step
        No particle moves farther than this in one step [largest diameter; smallest under a diverging law].

    """

    dt: float = 0.3
    dt_max: float = 0.6
    dt_min: float = 0.02
    delay: float = 10.0
    grow: float = 1.1
    shrink: float = 0.8
    mixing: float = 0.15
    mixing_decay: float = 0.97
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        _check(self)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        return _start(self, program)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        return self.advance_strained(program, None, goal, progress, steps)

    def advance_strained(self, program: Program, strains: Any, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps, in free strains of the box, too, where there are any."""
        numbers = _FireNumbers(*self[:-1], 0.0, 0.0, strains)
        return program.advance(fire_steps, numbers, goal, progress, steps, self.largest_step)


class Fire2(NamedTuple):
    """FIRE 2.0: velocities are mixed after the kick, and an uphill step is taken half back.

    The parameters are those of Fire. The step limit keeps strongly overlapping starts together.
    """

    dt: float = 0.1
    dt_max: float = 0.5
    dt_min: float = 0.002
    delay: float = 20.0
    grow: float = 1.1
    shrink: float = 0.5
    mixing: float = 0.25
    mixing_decay: float = 0.99
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        _check(self)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        return _start(self, program)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        return program.advance(fire_steps, _FireNumbers(*self[:-1], 0.5, 1.0), goal, progress, steps, self.largest_step)


class _FireNumbers(NamedTuple):
    """The numbers of either form, the part of an uphill step taken back, whether mixing sees the kick, and strains."""

    dt: float
    dt_max: float
    dt_min: float
    delay: float
    grow: float
    shrink: float
    mixing: float
    mixing_decay: float
    step_back: float
    mix_kicked: float
    strains: Any = None


def _check(method: Fire | Fire2) -> None:
    for name in ("dt", "dt_max", "largest_step"):
        positive(f"method.{name}", getattr(method, name))
    for name in ("dt_min", "delay"):
        real(f"method.{name}", getattr(method, name), at_least=0.0)
    real("method.grow", method.grow, at_least=1.0)
    for name in ("shrink", "mixing", "mixing_decay"):
        real(f"method.{name}", getattr(method, name), above=0.0, at_most=1.0)


def _start(method: Fire | Fire2, program: Program) -> Progress:
    method.check()
    progress = program.progress(_NUMBERS, 0)
    progress.number[_DT] = method.dt
    progress.number[_ALPHA] = method.mixing
    return progress


@device
def _steer(settings, uphill, dt, mixing, downhill):
    """Return the next time step, mixing and number of steps downhill: slow down uphill, speed up after a delay."""
    if uphill:
        return max(settings.dt_min, settings.shrink * dt), settings.mixing, 0.0
    if downhill + 1.0 > settings.delay:
        return min(settings.grow * dt, settings.dt_max), settings.mixing_decay * mixing, downhill + 1.0
    return dt, mixing, downhill + 1.0


@kernel
def fire_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list."""
    dt = number[_DT]
    alpha = number[_ALPHA]
    downhill = number[_DOWNHILL]
    speed2 = number[_SPEED2]
    fastest2 = number[_FASTEST2]
    stiffness = number[_STIFFNESS]
    strains = settings.strains
    mobility = number[_MOBILITY]
    status = RUNNING
    step = 0
    if moved_far(axes, row, space, pairs.number, 0.0):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    while True:
        sums = net_forces(effects, axes, row, force_nd, velocity_nd, space, pairs, virial_of(strains))
        now = int(number[_STEP]) + step
        found = sums
        sums = pull_box(strains, effects, axes, row, space, pairs, found)
        stopped = sums.power <= 0.0
        if stopped or now % _RENEW == 0:
            stiffness = survey(effects, row, pairs).stiffness
            if stiffness > 0.0:
                mobility = 5.0 / stiffness
        status = judge_all(strains, found, stiffness, space, goal)
        if status != RUNNING or step == steps:
            break
        step += 1
        if stopped and now > 0 and settings.step_back > 0.0:
            back = settings.step_back * dt
            for i in range(row.shape[0]):
                for a in range(len(axes)):
                    row[i, a] -= back * velocity_nd[i, a]
            pairs.number[DISPLACED] += back * math.sqrt(fastest2)
        if now > 0:
            dt, alpha, downhill = _steer(settings, stopped, dt, alpha, downhill)
        kick = dt * mobility
        if stopped:
            keep = 0.0
            push = kick
        else:
            keep = 1.0 - alpha
            if settings.mix_kicked > 0.0:
                kicked2 = speed2 + 2.0 * kick * sums.power + kick * kick * sums.square
                push = keep * kick + alpha * math.sqrt(kicked2 / sums.square)
            else:
                push = kick + alpha * math.sqrt(speed2 / sums.square)
        # none moves farther than largest_step: all velocities shrink by one factor, which keeps their sum at rest
        reach = dt * (keep * math.sqrt(fastest2) + push * math.sqrt(sums.largest))
        if reach > largest_step:
            keep *= largest_step / reach
            push *= largest_step / reach
        speed2, fastest2 = move_pass(axes, row, force_nd, velocity_nd, keep, push, dt)
        move_box(strains, axes, row, space, pairs, keep, push, dt)
        if moved_far(axes, row, space, pairs.number, dt * math.sqrt(fastest2)):
            bring_anchors(strains, axes, pairs)
            pairs, _ = follow(axes, row, space, pairs, None)
        speed2, fastest2 = speeds(space.links, axes, velocity_nd, speed2, fastest2)
        speed2, fastest2 = with_rates(strains, speed2, fastest2)
    bring_anchors(strains, axes, pairs)
    number[_DT] = dt
    number[_ALPHA] = alpha
    number[_DOWNHILL] = downhill
    number[_SPEED2] = speed2
    number[_FASTEST2] = fastest2
    number[_STEP] += step
    number[_EVALUATIONS] += step + 1
    number[_STIFFNESS] = stiffness
    number[_MOBILITY] = mobility
    return status, pairs
