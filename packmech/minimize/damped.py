# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Damped molecular dynamics: touching particles lose the energy of their approach, until all are at rest."""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech.check import positive
from packmech.constraints.compiled_links import project_rows, speeds
from packmech.effects import ContactDamping
from packmech.jit.compiled import kernel
from packmech.minimize.kernels import (
    CONVERGED,
    FLOOR,
    RUNNING,
    Goal,
    clear,
    force_pass,
    judge,
    move_pass,
    project_forces,
    survey,
)
from packmech.minimize.pair_list import follow, is_stale
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _STIFFNESS, _FASTEST, _NUMBERS = range(5)
_RENEW = 16


class DampedDynamics(NamedTuple):
    """Newton's equations with a dashpot at every contact, all masses equal: eq. 2.3 of Schreck and O'Hern.

    m a_i = sum over touching j of [-u'(r) - b (v_ij . n)] n, n from j to i. Semi-implicit Euler steps; the dashpots see
    the velocities of half a step ago. Momentum is conserved.

    Parameters
    ----------
    damping
        b [sqrt(m energy_scale) / reference diameter].
    dt
        Time step [reference diameter sqrt(m / energy_scale)], shortened where the stiffest particle or the damping
        ask for it.
    largest_step
        Nobody moves farther than this in one step [largest diameter; smallest under a diverging law].

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
        return program.progress(_NUMBERS, 0)

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        scene = program.scene
        mobility = scene.packing.reference_diameter**2 / scene.energy_scale
        numbers = _Damped(ContactDamping(self.damping / mobility), self.damping, self.dt, mobility)
        return program.advance(damped_steps, numbers, goal, progress, steps, self.largest_step)


class _Damped(NamedTuple):
    """The method in the units of the loop, where one over the mass is the mobility and velocities are lengths."""

    dashpot: ContactDamping
    damping: float
    dt: float
    mobility: float


@kernel
def damped_steps(
    effects, axes, row, force_nd, velocity_nd, space, pairs, settings, goal, largest_step, number, vector_kf, steps
):
    """Advance up to `steps` steps and return how they ended and the pair list."""
    both = (*effects, settings.dashpot)
    if is_stale(pairs, project_rows(space.links, axes, row, space)):
        pairs = follow(axes, row, space, pairs)
    clear(force_nd)
    step = 0
    while True:
        sums = force_pass(both, axes, row, force_nd, velocity_nd, pairs)
        sums = project_forces(space.links, axes, force_nd, velocity_nd, sums)
        number[_EVALUATIONS] += 1.0
        if int(number[_STEP]) % _RENEW == 0:
            number[_STIFFNESS] = survey(effects, row, pairs).stiffness
        status = judge(sums, number[_STIFFNESS], space, goal)
        if status == CONVERGED or status == FLOOR:
            # balance counts without the dashpots
            clear(force_nd)
            quiet = force_pass(effects, axes, row, force_nd, velocity_nd, pairs)
            quiet = project_forces(space.links, axes, force_nd, velocity_nd, quiet)
            status = judge(quiet, number[_STIFFNESS], space, goal)
            number[_EVALUATIONS] += 1.0
            if status == RUNNING and step < steps:
                clear(force_nd)
                sums = force_pass(both, axes, row, force_nd, velocity_nd, pairs)
                sums = project_forces(space.links, axes, force_nd, velocity_nd, sums)
                number[_EVALUATIONS] += 1.0
        if status != RUNNING or step == steps:
            break
        # a particle with z contacts is stiffer than one contact by about z / 2, and as much more damped
        dt = min(settings.dt, 0.7 / math.sqrt(settings.mobility * number[_STIFFNESS]), 0.1 / settings.damping)
        push = dt * settings.mobility
        keep = 1.0
        reach = dt * (number[_FASTEST] + push * math.sqrt(sums.largest))
        if reach > largest_step:
            keep = largest_step / reach
            push *= keep
        speed2, fastest2 = move_pass(axes, row, force_nd, velocity_nd, keep, push, dt)
        moved = dt * math.sqrt(fastest2) + project_rows(space.links, axes, row, space)
        _, fastest2 = speeds(space.links, axes, velocity_nd, speed2, fastest2)
        number[_FASTEST] = math.sqrt(fastest2)
        if is_stale(pairs, moved):
            pairs = follow(axes, row, space, pairs)
        number[_STEP] += 1.0
        step += 1
    return status, pairs
