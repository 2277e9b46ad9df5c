"""`compress`: packings at stated distances above their own onset of jamming, the contacts followed on the way."""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, integer, one_of, positive, positive_array
from packmech.contacts import find_contacts
from packmech.jit.blas import single_thread
from packmech.jit.interrupts import safe_interrupts
from packmech.loop.run_loop import Progress, RunLoop, run_settings
from packmech.minimize.soft_network import isochoric_part
from packmech.minimize.soft_newton import SoftState, descend, judge, newton
from packmech.minimize.strain_fire import relax_strained
from packmech.packing import Packing, no_own_images
from packmech.protocols.hard_vertex import find_vertex
from packmech.protocols.jam import free_strains
from packmech.protocols.linked_jam import find_onset
from packmech.protocols.protocol import Protocol, finish
from packmech.protocols.soft import soften
from packmech.result import NotConverged, Outcome, Run
from packmech.scene import Scene

# first distance above the onset, and the largest ratio of successive ones
_FIRST, _FACTOR, _LEAST_FACTOR = 1e-7, 2.0, 1.02
_FIRE_TOLERANCE, _TIGHTER, _FIRE_ROUNDS, _FIRE_STEPS = 1e-3, 0.03, 3, 300_000


def compress(
    scene: Scene,
    distances: Iterable[float],
    *,
    strain: str = "isotropic",
    force_tolerance: float = 1e-9,
    iteration_limit: int = 2000,
    progress: Progress | None = None,
    check: bool = True,
) -> tuple[Run, ...]:
    """Return one run for each distance: the packing at packing fraction onset + distance, in balance.

    The onset is that of the exact hard packing nearby, found from the packing as it is (jam it first to choose the
    protocol). From there the packing is followed upward in small steps by Newton's method; where that does not end in
    a minimum, contacts rearrange: FIRE finds the next packing, and the report counts it.

    With links, which keep their lengths, the box is scaled about the centers of unwrapped clusters (one that winds
    around it is strained with it and moved back onto its links). No hard packing is looked for: the packing is followed
    down in pressure, compressed first where nothing presses, and the onset is where the line through the last two makes
    the overlaps vanish.

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
        Most interior-point iterations for the onset.
    progress
        Called as progress(stage, figures).
    check
        Raise NotConverged when a packing does not come to rest.

    Returns
    -------
    tuple of Run
        `report` as for `jam`, and distance, onset, rearrangements (on the way from the distance before),
        contacts_closed and contacts_opened (since the distance before).

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.
    NotConverged
        If the onset is not found, or a packing does not come to rest, and `check` is set.

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
    if isinstance(distances, str) or not isinstance(distances, Iterable):
        raise TypeError(f"distances must be a sequence of positive numbers, got {distances!r}")
    goals = np.sort(positive_array("distances", list(distances), shape=(None,), what="distance"))
    one_of("strain", strain, ("isotropic", "free"))
    tolerance = positive("force_tolerance", force_tolerance)
    limit = integer("iteration_limit", iteration_limit, at_least=1)
    loop = RunLoop(run_settings(progress=progress, check=check))
    with safe_interrupts(), single_thread():
        return tuple(_Ascent(scene, strain, tolerance, loop).climb(goals, limit, check))


class _Ascent:
    """One packing followed upward from its onset."""

    def __init__(self, scene: Scene, strain: str, tolerance: float, loop: RunLoop) -> None:
        self.began = time.process_time()
        self.protocol = Protocol(scene, free_strains(strain, scene.packing.dimension), strain, tolerance, loop)
        self.tolerance = tolerance
        self.shears = isochoric_part(self.protocol.basis_kdd, scene.packing.dimension)
        self.rearrangements = 0
        self.iterations = 0

    def climb(self, goals: NDArray[np.float64], limit: int, check: bool) -> list[Run]:
        protocol = self.protocol
        runs: list[Run] = []
        start = self._start(float(goals[0]), limit)
        if start is None:
            run = finish(protocol, protocol.last, Outcome.NOT_JAMMED, 0.0, "compress", self.began)
            if check:
                raise NotConverged(run)
            return [run]
        packing, onset, depth, network = start
        try:
            for goal in goals:
                self.rearrangements = self.iterations = 0
                with protocol.stage("compression") as figures:
                    state = self._advance(packing, onset, depth, float(goal))
                    packing, depth = state.packing, float(goal)
                    protocol.last = protocol.restored(packing)
                    figures.residual, figures.steps = state.residual, self.iterations
                    figures.force_evaluations = self.iterations
                    figures.note = f"{self.rearrangements} rearrangements"
                now = find_contacts(protocol.last)
                pairs = _pairs_of(now.i_c, now.j_c, now.image_cd)
                protocol.report.update(
                    distance=float(goal),
                    onset=onset,
                    rearrangements=self.rearrangements,
                    contacts_closed=len(pairs - network),
                    contacts_opened=len(network - pairs),
                )
                network = pairs
                outcome = judge(state, self.tolerance)
                runs.append(finish(protocol, protocol.last, outcome, 0.0, "compress", self.began))
                if check and not outcome.ok:
                    raise NotConverged(runs[-1])
                protocol.stages, self.began = [], time.process_time()
        except KeyboardInterrupt as stop:
            stop.runs = tuple(runs)  # type: ignore[attr-defined]
            raise
        return runs

    def _start(self, goal: float, limit: int) -> tuple[Packing, float, float, set[tuple[int, ...]]] | None:
        """Return a packing just above the onset, the onset, how far above, and the pairs that touch at the onset."""
        protocol = self.protocol
        if protocol.scene.packing.links is not None:
            found = find_onset(protocol, goal)
            if found is None:
                return None
            pairs = _pairs_of(found.contacts.i_c, found.contacts.j_c, found.contacts.image_cd)
            return found.state.packing, found.fraction, found.depth, pairs
        vertex = find_vertex(protocol, protocol.scene.packing, limit)
        if vertex is None:
            return None
        depth = min(_FIRST, 0.5 * goal)
        # a pressure of this order brings the packing about so far above its onset; the exact volume is set below
        state = soften(vertex, protocol.units, protocol.basis_kdd, 0.3 * depth, tolerance=1e-5)
        pairs = _pairs_of(vertex.contacts.i_c, vertex.contacts.j_c, vertex.contacts.image_cd)
        return state.packing, protocol.report["jamming_packing_fraction"], depth, pairs

    def _advance(self, packing: Packing, onset: float, depth: float, goal: float) -> SoftState:
        """Return the packing at onset + goal, followed from onset + depth by steps that Newton's method can take."""
        factor = _FACTOR
        state: SoftState | None = None
        while state is None or depth < goal:
            further = min(goal, depth * factor)
            trial = newton(self._at(packing, onset + further), self.protocol.units, self.shears, None, iterations=25)
            self.iterations += trial.iterations
            if not trial.sound(max(self.tolerance, 1e-7)):
                if factor > _LEAST_FACTOR:
                    factor = factor**0.5
                    continue
                self.rearrangements += 1
                trial = self._rearranged(self._at(packing, onset + further))
                if not trial.sound(max(self.tolerance, 1e-7)):
                    return trial
            state, packing, depth = trial, trial.packing, further
            factor = min(_FACTOR, factor**2)
        return state

    def _at(self, packing: Packing, fraction: float) -> Packing:
        return self.protocol.at_fraction(packing, fraction)

    def _rearranged(self, packing: Packing) -> SoftState:
        """Return the packing that FIRE finds at this volume, polished by Newton's method."""
        protocol, tolerance = self.protocol, _FIRE_TOLERANCE
        here = protocol.restored(packing)
        for _ in range(_FIRE_ROUNDS):
            if len(self.shears):
                here = relax_strained(
                    protocol.program, here, self.shears, None, tolerance=tolerance, step_limit=_FIRE_STEPS // 10
                ).packing
            else:
                here, done = protocol.relax(here, tolerance, _FIRE_STEPS)
                self.iterations += done.steps
            # with links, FIRE may end on saddles: Newton's method must be one that only goes down
            bottom = newton if packing.links is None else descend
            state = bottom(protocol.reduced(here), protocol.units, self.shears, None)
            if state.sound(max(self.tolerance, 1e-7)):
                break
            tolerance *= _TIGHTER
        return state


def _pairs_of(i_c: NDArray[np.int64], j_c: NDArray[np.int64], image_cd: NDArray[np.int64]) -> set[tuple[int, ...]]:
    return {tuple(row) for row in np.column_stack([i_c, j_c, image_cd]).tolist()}
