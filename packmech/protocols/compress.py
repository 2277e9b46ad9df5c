"""`compress`: packings at stated distances above their own onset of jamming, the contacts followed on the way."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import BoxStrain, instance, integer, one_of, positive
from packmech.contacts.pairs import pair_names
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.minimize.second_order.soft_network import isochoric_part
from packmech.minimize.second_order.soft_newton import SoftState, find_bottom, judge, newton
from packmech.packing import Packing, no_own_images
from packmech.protocols.continuation import Step, StepLengths, follow
from packmech.protocols.hard_vertex import find_hard_packing
from packmech.protocols.linked_jam import find_onset
from packmech.protocols.pressure_path import PressurePath, stays_on_branch
from packmech.protocols.protocol import (
    Protocol,
    at_packing_fraction,
    follow_series,
    is_jammed,
    report_changes,
    sequence,
)
from packmech.protocols.soft import follow_pressure
from packmech.result import Outcome, Run
from packmech.scene import Scene

# first distance above the onset
_FIRST = 1e-7
# steps in the logarithm of the distance
_LENGTHS = StepLengths(math.log(2.0), math.log(2.0), growth=2.0, shortest=math.log(1.05))


@honors("repulsion kinds links shapes", at_rest=True)
def compress(
    scene: Scene,
    distances: Iterable[float],
    *,
    strain: BoxStrain = "isotropic",
    force_tolerance: float = 1e-9,
    iteration_limit: int = 2000,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> tuple[Run, ...]:
    """Return one run for each distance: the packing at packing fraction onset + distance, in balance.

    The onset is that of the exact hard packing nearby, found from the packing as it is (jam it first to choose the
    protocol); one that is jammed above a pressure of 1e-5 is followed down to that first. From there the packing is
    followed upward in small steps by Newton's method; where that does not end in a minimum, contacts rearrange: the
    next one lies where Newton's method leads going down, and the report counts it.

    With links, which keep their lengths, the box is scaled about the centers of unwrapped clusters (one that winds
    around it is strained with it and moved back onto its links). No hard packing is looked for: the packing is followed
    down in pressure, compressed first where nothing presses, and the onset is where the line through the last two makes
    the overlaps vanish. So it goes with shapes.

    Parameters
    ----------
    scene
        The scene.
    distances
        Packing fraction minus onset [1], all positive; runs come in increasing order.
    strain
        "isotropic": the box keeps its shape. "free": strains relax at every packing fraction, so that the stress is
        isotropic.
    force_tolerance
        Net force over mean contact force (and stress missing over pressure) that counts as balance [1]; the floor of
        rounding also counts.
    iteration_limit
        Maximum number of interior-point iterations for the onset.
    time_limit
        Stop after so much CPU time in all, compiling aside [s]; the run in hand ends with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures).
    check
        Raise NotConverged when a packing does not come to rest.

    Returns
    -------
    tuple of Run
        `report` as for `jam`, and distance, onset, rearrangements (on the way from the distance before),
        onset_rearrangements (of a jammed packing on the way down to its onset; None: not counted), contacts_closed and
        contacts_opened (since the distance before); pressure_asked is None.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.
    NotConverged
        If the onset is not found, or a packing does not come to rest, and `check` is set.
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished, `.run` to the one in hand.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> jammed = pm.jam(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)), strain="isotropic")
    >>> runs = pm.compress(pm.Scene(jammed.packing, (pm.Repulsion(law=pm.Harmonic()),)), [1e-4, 1e-3])
    >>> [round(run.report["packing_fraction"] - run.report["onset"], 12) for run in runs]
    [0.0001, 0.001]

    """
    instance("scene", scene, Scene)
    no_own_images("scene.packing", scene.packing)
    goals = np.sort(sequence("distances", distances, "distance"))
    one_of("strain", strain, ("isotropic", "free"))
    tolerance = positive("force_tolerance", force_tolerance)
    limit = integer("iteration_limit", iteration_limit, at_least=1)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    protocol = Protocol(scene, strain, tolerance, loop)
    return follow_series(protocol, goals, _Ascent(protocol, float(goals[0]), limit).climb, "compress", pressures=False)


class _AboveOnset(NamedTuple):
    """A packing just above its onset, that packing fraction, how far above, and the pairs that touch at the onset."""

    packing: Packing
    fraction: float
    depth: float
    pairs: set[tuple[int, ...]]


class _Ascent:
    """One packing followed upward from its onset, which is looked for when the first distance is asked for."""

    def __init__(self, protocol: Protocol, nearest: float, iteration_limit: int) -> None:
        self.protocol, self.nearest, self.iteration_limit = protocol, nearest, iteration_limit
        self.tolerance = protocol.force_tolerance
        self.shears = isochoric_part(protocol.basis_kdd, protocol.scene.packing.dimension)
        self.place: _AboveOnset | None = None
        self.rearrangements = self.iterations = 0
        # what was reached last, in balance or not
        self.tried: SoftState

    def climb(self, goal: float) -> Outcome:
        """Go on to the distance; return how that ended."""
        protocol = self.protocol
        protocol.report["distance"] = goal
        place = self._start() if self.place is None else self.place
        if place is None:
            return Outcome.NOT_JAMMED
        self.rearrangements = self.iterations = 0
        protocol.report["onset"] = place.fraction
        with protocol.stage("compression") as figures:
            state = self._advance(place.packing, place.fraction, place.depth, goal)
            protocol.last = protocol.restored(state.packing)
            figures.residual, figures.steps = state.residual, self.iterations
            figures.force_evaluations = self.iterations
            figures.note = f"{self.rearrangements} rearrangements"
        pairs = report_changes(protocol, self.rearrangements, place.pairs)
        self.place = _AboveOnset(state.packing, place.fraction, goal, pairs)
        return judge(state, self.tolerance)

    def _start(self) -> _AboveOnset | None:
        protocol = self.protocol
        if not protocol.scene.packing.plain:
            found = find_onset(protocol, self.nearest)
            if found is None:
                return None
            return _AboveOnset(found.state.packing, found.fraction, found.depth, set(pair_names(found.contacts)))
        near: Packing | None = protocol.scene.packing
        if is_jammed(protocol.scene):
            near = PressurePath(protocol).go_down()
            protocol.report["onset_rearrangements"] = protocol.report["rearrangements"]
        hard = None if near is None else find_hard_packing(protocol, near, self.iteration_limit)
        if hard is None:
            return None
        depth = min(_FIRST, 0.5 * self.nearest)
        # a pressure of this order brings the packing about so far above its onset; the exact volume is set below
        state = follow_pressure(
            hard, protocol.units, protocol.basis_kdd, 0.3 * depth, tolerance=1e-5, watch=protocol.in_time
        )
        onset = protocol.report["jamming_packing_fraction"]
        return _AboveOnset(state.packing, onset, depth, set(pair_names(hard.contacts)))

    def _advance(self, packing: Packing, onset: float, depth: float, goal: float) -> SoftState:
        """Return the packing at onset + goal, followed from onset + depth by steps that Newton's method can take."""
        end, least, lengths = math.log(goal), max(self.tolerance, 1e-7), replace(_LENGTHS)
        watch = self.protocol.in_time

        def denser(packing: Packing, place: float) -> Packing:
            return at_packing_fraction(packing, onset + (goal if place == end else math.exp(place)))

        def reach(packing: Packing, place: float, further: float) -> Step[Packing, str] | None:
            trial = newton(denser(packing, further), self.protocol.units, self.shears, None, iterations=25, watch=watch)
            self.iterations += trial.iterations
            if not (trial.sound(least) and stays_on_branch(self.protocol, (packing, trial.packing))):
                return None
            self.tried = trial
            return Step(trial.packing, further)

        def rearrange(packing: Packing, place: float, further: float) -> Step[Packing, str] | None:
            self.rearrangements += 1
            lengths.grow()
            self.tried = self._rearranged(denser(packing, further))
            return Step(self.tried.packing, further, "rearranged") if self.tried.sound(least) else None

        for _ in follow(reach, packing, math.log(depth), end, lengths, rearrange):
            pass
        return self.tried

    def _rearranged(self, packing: Packing) -> SoftState:
        """Return the packing at this volume that Newton's method reaches going down."""
        protocol, least = self.protocol, max(self.tolerance, 1e-7)
        state = find_bottom(packing, protocol.units, self.shears, None, least, watch=protocol.in_time)
        self.iterations += state.iterations
        return state
