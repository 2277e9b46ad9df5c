# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Damped molecular dynamics: touching particles lose the energy of their approach, until all are at rest."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from packmech.check import positive
from packmech.constraints.compiled_links import speeds
from packmech.jit.compiled import compiled_form, device, kernel
from packmech.minimize.passes.kernels import (
    RUNNING,
    Goal,
    Resistance,
    clear,
    judge,
    move_pass,
    moved_far,
    net_forces,
    survey,
)
from packmech.minimize.passes.pair_list import follow
from packmech.minimize.passes.shape_rows import ROWS_WITH_SHAPES
from packmech.minimize.passes.single_rows import RowsHeld
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _STIFFNESS, _NUMBERS = range(4)
_RENEW = 16
# velocities are those of the implicit step to this, relative to its right-hand side, in at most so many iterations
_SOLVED, _ITERATIONS = 1e-6, 400
# a step relaxes no contact by more than about this
_RELAXED = 0.5


class DampedDynamics(NamedTuple):
    """Newton's equations with a dashpot at every contact, all masses equal: eq. 2.3 of Schreck and O'Hern (2010).

    m a_i = sum over touching j of [-u'(r) - b (v_ij . n)] n, n from j to i. The forces of the law are those where the
    particles stand, the dashpots see the velocities that the step ends with: velocities solve
    (1 + dt b R^T R / m) v = v_before + dt F / m, R the rates at which touching pairs part (conjugate gradients), and
    the step is stable whatever b. Momentum is conserved.

    For large b inertia matters no more: touching pairs part at the rates that b R^T R v = F gives, each contact relaxes
    in a time b / u'' whether its surroundings are stiff or soft, and paths are not those of steepest descent, which is
    the limit of strong drag against a background. Motions that change no distance of a touching pair are not damped.

    Parameters
    ----------
    damping
        b [sqrt(m energy_scale) / reference diameter].
    dt
        Time step [reference diameter sqrt(m / energy_scale)], shortened where the stiffest particle asks for it; times
        b where b > 1, for that is how slowly contacts relax.
    largest_step
        No particle moves farther than this in one step [largest diameter; smallest under a diverging law].

    """

    damping: float = 1.0
    dt: float = 0.2
    largest_step: float = 0.1

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        positive("method.damping", self.damping)
        positive("method.dt", self.dt)
        positive("method.largest_step", self.largest_step)

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        self.check()
        return program.progress(_NUMBERS, 3)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        scene = program.scene
        mobility = scene.packing.reference_diameter**2 / scene.energy_scale
        dt = self.dt * max(1.0, self.damping)
        numbers = _Damped(Resistance(self.damping / mobility), dt, mobility)
        return program.advance(damped_steps, numbers, goal, progress, steps, self.largest_step)


class _Damped(NamedTuple):
    """The method in the units of the loop, where one over the mass is the mobility and velocities are lengths."""

    dashpot: Resistance
    dt: float
    mobility: float


def _without_laws(effects: Any) -> Any:
    """Return what shapes particles and what holds them, among the effects in a loop."""
    return tuple(one for one in effects if isinstance(one, (*ROWS_WITH_SHAPES, RowsHeld)))


@compiled_form(_without_laws)
def _choose_without_laws(effects: Any) -> Any:
    kinds = (*ROWS_WITH_SHAPES, RowsHeld)
    places = [k for k, one in enumerate(effects) if getattr(one, "instance_class", None) in kinds]
    if not places:
        return lambda effects: ()
    first, last = places[0], places[-1]
    if first == last:
        return lambda effects: (effects[first],)
    return lambda effects: (effects[first], effects[last])


@device
def _resist(dashpots, axes, row, space, pairs, dt, velocity_nd, product_nd):
    """Set the product to v + dt (b R^T R / m) v, within what links admit; return v times it."""
    clear(product_nd)
    net_forces(None, dashpots, axes, row, product_nd, velocity_nd, space, pairs, None)
    power = 0.0
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            product_nd[i, a] = velocity_nd[i, a] - dt * product_nd[i, a]
            power += velocity_nd[i, a] * product_nd[i, a]
    return power


@device
def _slow_down(dashpots, axes, row, space, pairs, push, kick_nd, velocity_nd, left_nd, way_nd, product_nd):
    """Solve (1 + dt b R^T R / m) v = v + dt F / m for the velocities; return passes and the largest speed squared."""
    _resist(dashpots, axes, row, space, pairs, push, velocity_nd, product_nd)
    square = size = 0.0
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            aim = velocity_nd[i, a] + push * kick_nd[i, a]
            size += aim * aim
            left_nd[i, a] = way_nd[i, a] = aim - product_nd[i, a]
            square += left_nd[i, a] ** 2
    passes = 1
    enough = _SOLVED * _SOLVED * size
    while square > enough and passes < _ITERATIONS:
        far = square / _resist(dashpots, axes, row, space, pairs, push, way_nd, product_nd)
        passes += 1
        before = square
        square = 0.0
        for i in range(row.shape[0]):
            for a in range(len(axes)):
                velocity_nd[i, a] += far * way_nd[i, a]
                left_nd[i, a] -= far * product_nd[i, a]
                square += left_nd[i, a] ** 2
        for i in range(row.shape[0]):
            for a in range(len(axes)):
                way_nd[i, a] = left_nd[i, a] + square / before * way_nd[i, a]
    fastest = 0.0
    for i in range(row.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += velocity_nd[i, a] ** 2
        fastest = max(fastest, own)
    return passes, fastest


@kernel
def damped_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list."""
    dashpots = (*_without_laws(effects), settings.dashpot)
    left_nd = vector_kf[0].reshape(force_nd.shape)
    way_nd = vector_kf[1].reshape(force_nd.shape)
    product_nd = vector_kf[2].reshape(force_nd.shape)
    if moved_far(axes, row, space, pairs.number, 0.0):
        pairs, _ = follow(axes, row, space, pairs, None)
    clear(force_nd)
    step = 0
    while True:
        sums = net_forces(None, effects, axes, row, force_nd, velocity_nd, space, pairs, None)
        number[_EVALUATIONS] += 1.0
        if int(number[_STEP]) % _RENEW == 0:
            number[_STIFFNESS] = survey(effects, row, pairs).stiffness
        status = judge(sums, number[_STIFFNESS], space, goal)
        if status != RUNNING or step == steps:
            break
        # where dashpots rule, their relaxation bounds the step in place of the oscillation
        longest = max(
            0.7 / math.sqrt(settings.mobility * number[_STIFFNESS]),
            _RELAXED * settings.dashpot.coefficient / number[_STIFFNESS],
        )
        dt = min(settings.dt, longest)
        passes, fastest2 = _slow_down(
            dashpots,
            axes,
            row,
            space,
            pairs,
            dt * settings.mobility,
            force_nd,
            velocity_nd,
            left_nd,
            way_nd,
            product_nd,
        )
        number[_EVALUATIONS] += passes
        reach = dt * math.sqrt(fastest2)
        keep = largest_step / reach if reach > largest_step else 1.0
        speed2, fastest2 = move_pass(None, axes, row, force_nd, velocity_nd, pairs, keep, 0.0, dt)
        if moved_far(axes, row, space, pairs.number, dt * math.sqrt(fastest2)):
            pairs, _ = follow(axes, row, space, pairs, None)
        speeds(space.links, axes, velocity_nd, speed2, fastest2)
        number[_STEP] += 1.0
        step += 1
    return status, pairs
