# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""FIRE, the fast inertial relaxation engine: damped motion steered downhill.

Bitzek et al., Phys. Rev. Lett. 97, 170201 (2006), and its second form, Guénolé et al., Comput. Mater. Sci.
175, 109584 (2020).
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

from packmech.check import positive, real
from packmech.constraints.compiled_links import speeds
from packmech.jit.compiled import device, inlined, inner_lean, kernel
from packmech.jit.threads import ThreadRecord, broadcast, is_first, is_shared, run_together, share
from packmech.minimize.passes.kernels import (
    RUNNING,
    SEARCH,
    Goal,
    clear_rows,
    move_pass,
    moved_far,
    net_forces,
    rows_of,
    survey,
)
from packmech.minimize.passes.pair_list import DISPLACED, follow, update_lists
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
        settings = _FireSettings(_FireRule(*self[:-1], 0.0, 0.0), strains)
        # a box that strains is moved by one thread
        loop = _steps_of(program) if strains is None else fire_steps
        return program.advance(loop, settings, goal, progress, steps, self.largest_step)


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
        settings = _FireSettings(_FireRule(*self[:-1], 0.5, 1.0))
        return program.advance(_steps_of(program), settings, goal, progress, steps, self.largest_step)


class _FireRule(NamedTuple):
    """The numbers of either form, the part of an uphill step taken back, and whether mixing sees the kick."""

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


class _FireSettings(NamedTuple):
    """The rule, free strains and which of several threads takes the steps; None where there are none."""

    rule: _FireRule
    strains: Any = None
    thread: ThreadRecord | None = None


def _steps_of(program: Program) -> Any:
    """Return what takes the steps: the loop, or several threads in it."""
    return fire_steps if program.threads == 1 else functools.partial(_on_threads, program.threads)


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
def _steer(rule, uphill, dt, mixing, downhill):
    """Return the next time step, mixing and number of steps downhill: slow down uphill, speed up after a delay."""
    if uphill:
        return max(rule.dt_min, rule.shrink * dt), rule.mixing, 0.0
    if downhill + 1.0 > rule.delay:
        return min(rule.grow * dt, rule.dt_max), rule.mixing_decay * mixing, downhill + 1.0
    return dt, mixing, downhill + 1.0


@inlined
def _take_back(axes, row, velocity_nd, back, low, high):
    """Move rows back along their velocities."""
    for i in range(low, high):
        for a in range(len(axes)):
            row[i, a] -= back * velocity_nd[i, a]


@device
def _stiffness_on(thread, effects, row, pairs):
    """Return the stiffness that one thread finds; none of them moves on before."""
    stiffness = 0.0
    if is_first(thread):
        stiffness = survey(effects, row, pairs).stiffness
    return broadcast(thread, stiffness)


@inner_lean
def _mixed(rule, sums, stopped, dt, mixing, mobility, speed2, fastest2, largest_step):
    """Return what is kept of velocities and what is added of forces: one code for any number of threads."""
    kick = dt * mobility
    if stopped:
        keep = 0.0
        push = kick
    else:
        keep = 1.0 - mixing
        if rule.mix_kicked > 0.0:
            kicked2 = speed2 + 2.0 * kick * sums.power + kick * kick * sums.square
            push = keep * kick + mixing * math.sqrt(kicked2 / sums.square)
        else:
            push = kick + mixing * math.sqrt(speed2 / sums.square)
    # none moves farther than largest_step: all velocities shrink by one factor, which keeps their sum at rest
    reach = dt * (keep * math.sqrt(fastest2) + push * math.sqrt(sums.largest))
    if reach > largest_step:
        keep *= largest_step / reach
        push *= largest_step / reach
    return keep, push


@device
def _must_follow(thread, axes, row, space, pairs, moved):
    """Return whether lists must be followed after no row moved farther than this; with threads, by a search."""
    if thread is None:
        return moved_far(axes, row, space, pairs.number, moved)
    search = 0.0
    if is_first(thread) and moved_far(axes, row, space, pairs.number, moved):
        search = 1.0 * update_lists(axes, row, space, pairs, None)
    return broadcast(thread, search) > 0.0


@kernel
def fire_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list.

    Several threads come back, with SEARCH, where the list must be rebuilt: who called them does it.
    """
    rule, strains, thread = settings.rule, settings.strains, settings.thread
    dt = number[_DT]
    mixing = number[_ALPHA]
    downhill = number[_DOWNHILL]
    speed2 = number[_SPEED2]
    fastest2 = number[_FASTEST2]
    stiffness = number[_STIFFNESS]
    mobility = number[_MOBILITY]
    before = int(number[_STEP])
    status = RUNNING
    step = 0
    low, high = rows_of(pairs, row, share(thread, pairs.row_b.shape[0] - 1))
    clear_rows(force_nd, low, high)
    search = _must_follow(thread, axes, row, space, pairs, 0.0)
    if search and not is_shared(thread):
        pairs, _ = follow(axes, row, space, pairs, None)
    while not (search and is_shared(thread)):
        found = net_forces(thread, effects, axes, row, force_nd, velocity_nd, space, pairs, virial_of(strains))
        now = before + step
        sums = pull_box(strains, effects, axes, row, space, pairs, found)
        stopped = sums.power <= 0.0
        if stopped or now % _RENEW == 0:
            stiffness = _stiffness_on(thread, effects, row, pairs)
            if stiffness > 0.0:
                mobility = 5.0 / stiffness
        status = judge_all(strains, found, stiffness, space, goal)
        if status != RUNNING or step == steps:
            break
        step += 1
        if stopped and now > 0 and rule.step_back > 0.0:
            back = rule.step_back * dt
            _take_back(axes, row, velocity_nd, back, low, high)
            if is_first(thread):
                pairs.number[DISPLACED] += back * math.sqrt(fastest2)
        if now > 0:
            dt, mixing, downhill = _steer(rule, stopped, dt, mixing, downhill)
        keep, push = _mixed(rule, sums, stopped, dt, mixing, mobility, speed2, fastest2, largest_step)
        speed2, fastest2 = move_pass(thread, axes, row, force_nd, velocity_nd, pairs, keep, push, dt)
        move_box(strains, axes, row, space, pairs, keep, push, dt)
        search = _must_follow(thread, axes, row, space, pairs, dt * math.sqrt(fastest2))
        if search and not is_shared(thread):
            bring_anchors(strains, axes, pairs)
            pairs, _ = follow(axes, row, space, pairs, None)
        speed2, fastest2 = speeds(space.links, axes, velocity_nd, speed2, fastest2)
        speed2, fastest2 = with_rates(strains, speed2, fastest2)
    bring_anchors(strains, axes, pairs)
    # what threads share is written by one, once all have read it
    comes_back = search and is_shared(thread)
    if is_first(thread):
        number[_DT] = dt
        number[_ALPHA] = mixing
        number[_DOWNHILL] = downhill
        number[_SPEED2] = speed2
        number[_FASTEST2] = fastest2
        number[_STEP] += step
        number[_EVALUATIONS] += step + (0 if comes_back else 1)
        number[_STIFFNESS] = stiffness
        number[_MOBILITY] = mobility
    return SEARCH if comes_back else status, pairs


def _on_threads(
    threads: int, effects: Any, axes: Any, row: Any, force_nd: Any, velocity_nd: Any, space: Any, pairs: Any,
    settings: Any, goal: Any, largest_step: float, number: Any, vector_kf: Any, steps: int,
) -> tuple[int, Any]:  # fmt: skip
    """Take steps as `fire_steps` does, with the same bits, on so many threads; on no more than there are blocks."""
    last = number[_STEP] + steps
    threads = min(threads, len(pairs.row_b) - 1)

    def run(thread: ThreadRecord | None) -> tuple[int, Any]:
        own = settings._replace(thread=thread)
        status, listed = fire_steps(
            effects, axes, row, force_nd, velocity_nd, space, pairs, own, goal, largest_step, number, vector_kf, left
        )
        return int(status), listed

    while True:
        left = int(last - number[_STEP])
        status, pairs = run(None) if threads == 1 else run_together(run, threads)
        if status != SEARCH:
            return status, pairs
        pairs = _followed(axes, row, space, pairs)


@kernel
def _followed(axes, row, space, pairs):
    """Return the list made valid."""
    return follow(axes, row, space, pairs, None)[0]
