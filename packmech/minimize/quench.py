"""Quench: from where the particles are to a nearby minimum of the energy, in the box as it is, by any minimizer."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import boolean, instance, integer, positive
from packmech.contacts import crossing_links
from packmech.effects import (
    FixedParticles,
    Harmonic,
    MeshWalls,
    Repulsion,
    Walls,
    lacking_second,
    refuse_free_fall,
    refuse_unknown_to_shapes,
    single_effects,
)
from packmech.jit.compiled import compiling_noted
from packmech.linalg.threads import factor_threads
from packmech.loop.run_loop import RunLoop, RunSettings, run_settings
from packmech.mechanics.stability import Stability, stability
from packmech.minimize.bodies_apart import report_of_bodies, separate
from packmech.minimize.first_order.fire import Fire
from packmech.minimize.first_order.lbfgs import LBFGS
from packmech.minimize.minimizers import checked_minimizer
from packmech.minimize.passes.kernels import Goal
from packmech.minimize.program import Evaluation, Minimization, Minimizer, Program, build_program
from packmech.minimize.second_order.newton import Newton, displaced, polish
from packmech.observables import State, measure_added
from packmech.packing import Packing
from packmech.result import Condition, Outcome, Run, Stage, Trace, unmet_conditions
from packmech.scene import Scene

# the default route hands over to Newton's method here, where contacts no longer change
_HAND_OVER = 1e-6
# beyond this ratio of sizes stiffnesses differ so much that FIRE, which knows one time scale, falls behind L-BFGS
_BROAD = 20.0
# a symmetric start can lead to a saddle: so often particles are moved off it, the tolerance a tenth each time but for
# the first, as contacts that bear no more than the tolerance may be what bends
_ROUNDS, _TIGHTER, _TIGHTEST = 8, 0.1, 1e-15
# residual at which particles rest well enough for unstable directions to tell of a saddle [1]
_AT_REST = 1e-4
# step off a saddle [smallest diameter]: the first that is tried, the shortest, the longest
_KICK, _SHORTEST, _LONGEST = 1e-4, 1e-10, 0.1
# energy that rounding of positions leaves where nothing touches [energy scale]
_NO_ENERGY = 1e-24
# second derivatives of coincident centers are none: Newton's method starts with overlaps below this [1]
_COINCIDENT = 0.99
# forces within this many floors of balance may be rounding
_FLOORS = 8.0


@honors(
    "repulsion kinds bonds interactions gravity walls mesh held links shapes",
    at_rest=True,
    rough="pm.settle",
)
def quench(
    scene: Scene,
    *,
    force_tolerance: float,
    method: Any = None,
    step_limit: int = 500_000,
    trace_every: int | None = None,
    trace_positions: bool = False,
    threads: int = 1,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Run:
    """Return the run to a minimum of the energy in the box as it is.

    Starts with coincident or deeply overlapping particles are fine: steps are bounded, and coincident ones part along
    a direction made of their numbers. Under a law that diverges at the center (repulsive Lennard-Jones,
    DivergentRepulsion), and for Newton's method where centers all but coincide, deep overlaps are first relaxed with
    the harmonic law. Effects without an energy, such as damping, have no part in it; with friction there is no energy
    to minimize: `settle` comes to rest in time.

    With links in two dimensions, overlaps deeper than a quarter are relaxed first by steps that let no links pass
    through each other. From there on contacts keep them apart by themselves, unless links are longer than sqrt(2) times
    the diameter or the packing is so dense that overlaps stay deep: `report` names the links that crossed all the same.
    Rigid bodies whose beads overlap by more than a quarter are shrunk in place first and grown again little by little,
    so that none stay across each other; `report["deep_overlaps"]` counts the pairs that do all the same.

    Parameters
    ----------
    scene
        The scene.
    force_tolerance
        Stop when the largest net force on a particle falls to this times the mean contact force [1].
    method
        Fire(), Fire2(), ConjugateGradient(), LBFGS(), DampedDynamics(), GradientDescent(), SteepestDescent() or
        Newton(). Unless given: FIRE (L-BFGS for size ratios above 20), and below a tolerance of 1e-6 Newton's method
        for the last digits, which also tells a saddle from a minimum.
    step_limit
        Largest number of steps; on the default route those of Newton's method, at most 60 a time, are not counted.
    trace_every
        Keep energy, pressure, contacts and largest force every so many steps, in `Run.trace`; Newton's steps are not
        among them.
    trace_positions
        Keep the positions with them.
    threads
        Number of threads; it changes no bit. Measured with two, 4096 and 16384 discs come to rest 1.2 and 1.6 times as
        fast, 4096 and 10000 spheres 1.1 and 1.4 times. FIRE takes several from 4096 discs or spheres on, without links,
        bonds and interactions, and so do factorizations; all else runs on one. They wait for each other in every step:
        ask for no more than there are idle processors. Time limits and `seconds` count the time of all of them.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures), figures a dict with "steps" and "residual".
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    Run
        Outcome.ROUNDING_FLOOR, a success, where the tolerance lies below what the coordinates' rounding allows;
        Outcome.UNJAMMED, a success, where nothing touches any more. On a saddle of the whole energy, rattlers and what
        acts on single particles included, particles are moved off it and the minimizer goes on; Outcome.UNSTABLE where
        that ends on saddles again and again. `report["negative_modes"]` is 0 where the end was found to be a minimum,
        None where there is no second derivative, and "not_judged" says why.

        With links in two dimensions `report` names the
        pairs of links that cross at the end, "crossing_links", and those of them that crossed on the way,
        "crossed_links": they are locked, and may bear forces at any density (None where links are so much longer than
        the box that it is not known).

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the tolerance was not met and `check` is set; its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.run` set to what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(64, dimension=2, packing_fraction=0.9, seed=1)
    >>> run = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-10)
    >>> run.outcome.name, run.residual <= 1e-10
    ('CONVERGED', True)

    """
    instance("scene", scene, Scene)
    refuse_free_fall(scene.effects)
    tolerance = positive("force_tolerance", force_tolerance)
    boolean("trace_positions", trace_positions)
    if method is not None:
        method = checked_minimizer(method)
    every = None if trace_every is None else integer("trace_every", trace_every, at_least=1)
    settings = run_settings(
        step_limit=step_limit, threads=threads, time_limit=time_limit, progress=progress, check=check
    )
    descent = _Descent(scene, settings, None if every is None else _TraceBuilder(scene, every, trace_positions))

    def work() -> Outcome:
        descent.separate()
        failed = descent.relax_deep_overlaps(_COINCIDENT if isinstance(method, Newton) else 1.0)
        if failed is not None:
            return failed
        if method is None:
            return descent.to_minimum(lambda goal, note: _default_route(descent, goal, note), tolerance)
        if isinstance(method, Newton):
            return descent.to_minimum(
                lambda goal, note: descent.polish(goal, method, descent.step_limit - descent.steps, note), tolerance
            )
        return descent.to_minimum(
            lambda goal, note: descent.follow(type(method).__name__ + note, method, goal), tolerance
        )

    with factor_threads(settings.threads):
        return descent.loop.run(work, lambda outcome: descent.finish(outcome, tolerance))


def _default_route(descent: _Descent, tolerance: float, note: str) -> Outcome:
    """FIRE or L-BFGS until contacts settle, then Newton's method; the first again where that finds no balance."""
    radius = descent.scene.packing.radius_n
    method: Any
    name, method = ("L-BFGS", LBFGS()) if radius.max() > _BROAD * radius.min() else ("FIRE", Fire())
    outcome = descent.follow(name + note, method, max(tolerance, _HAND_OVER))
    # Newton's method may help where steps ran out on the way to the first balance
    if tolerance >= _HAND_OVER or not (outcome is Outcome.CONVERGED or (outcome is Outcome.STEP_LIMIT and not note)):
        return outcome
    if descent.to_the_end:
        return descent.follow(f"{name}, to the end", method, tolerance)
    before = descent.program.coordinates()
    polished = descent.polish(tolerance)
    if polished.ok or outcome is Outcome.STEP_LIMIT:
        return polished if polished.ok else outcome
    if polished is Outcome.UNSTABLE:
        return polished
    descent.program.place(before)
    return descent.follow(f"{name}, to the end", method, tolerance)


class _Descent:
    """One quench on its way: its program, its stages so far, and what is kept."""

    def __init__(self, scene: Scene, settings: RunSettings, trace: _TraceBuilder | None) -> None:
        self.loop = RunLoop(settings)
        self.began = time.process_time()
        self.scene = scene
        refuse_unknown_to_shapes(scene)
        self.program = build_program(scene, threads=settings.threads)
        self.build_seconds = time.process_time() - self.began
        self.step_limit = settings.step_limit
        self.stages: list[Stage] = []
        self.steps = 0
        # Newton's, which no limit counts
        self.newton_steps = 0
        self.evaluations = 0
        # where the last stage ended, and what is known of the stability there
        self.reached = self.program.evaluate()
        self.stability: Stability | None = None
        self._trace = trace
        # Newton's method takes second derivatives
        self.to_the_end = bool(lacking_second(scene.effects))

    def separate(self) -> None:
        """Relax deep overlaps of linked particles in the plane, and of rigid bodies, that nothing passes through."""
        began = self._now()
        packing, steps = separate(self.program, self.packing(), step_limit=self.step_limit, look=self.loop.check_time)
        if steps:
            self.program.put(packing)
            self.steps += steps
            self.evaluations += steps
            self._keep("deep overlaps", self.program.evaluate(), steps, steps, began)

    def relax_deep_overlaps(self, bearable: float) -> Outcome | None:
        """Relax deep overlaps with the harmonic law where the scene's own diverges; return how that failed, or None.

        With another law only overlaps deeper than the minimizer can bear.
        """
        if not self.program.evaluate().deepest_overlap > min(self.program.bearable_overlap, bearable):
            return None
        held = tuple(one for one in self.scene.effects if isinstance(one, FixedParticles))
        harmonic = self.scene.replace(effects=(Repulsion(law=Harmonic(energy_scale=self.scene.energy_scale)), *held))
        own, self.program = self.program, build_program(harmonic, threads=self.program.threads)
        keep, self._trace = self._trace, None
        outcome = self.follow("harmonic law first", Fire(), 1e-2)
        reached = self.program.coordinates()
        self.program, self._trace = own, keep
        self.program.place(reached)
        return None if outcome.ok or outcome is Outcome.STEP_LIMIT else outcome

    def to_minimum(self, attempt: Callable[[float, str], Outcome], tolerance: float) -> Outcome:
        """Minimize until the particles rest in a minimum; return how that ended.

        Where forces balance on a saddle, particles are moved off it along a direction in which the energy falls, and
        the minimizer goes on from there. Unstable directions at a residual above 1e-4 make no saddle yet: there the
        minimizer just goes on to a tenth of its tolerance.

        Parameters
        ----------
        attempt
            The minimizer: takes a tolerance and a note on its stage, returns how it ended.
        tolerance
            When forces balance [1].

        """
        goal, note, saddles = tolerance, "", 0
        while saddles < _ROUNDS:
            outcome = attempt(goal, note)
            now = self.reached
            met = outcome is not Outcome.TIME_LIMIT and now.mean_force > 0.0 and now.residual <= tolerance
            if outcome is Outcome.UNJAMMED and self._alone(now):
                self.stability = Stability(0)
                return outcome
            if not (met or outcome.ok or outcome is Outcome.UNSTABLE):
                return outcome
            found = self.stability
            if found is None or found.negative:
                self.stability = found = stability(self.scene.replace(packing=self.packing()), now.max_force)
            if not found.negative:
                # Newton's method counts less exactly with links and shapes
                balanced = outcome in (Outcome.UNSTABLE, Outcome.UNJAMMED)
                return Outcome.CONVERGED if met or balanced else outcome
            if min(goal, now.residual) > _AT_REST:
                goal, note = goal * _TIGHTER, ", nearer to rest"
                continue
            if saddles < _ROUNDS - 1:
                self.step_off(found)
            goal = min(goal, max(tolerance * _TIGHTER**saddles, min(tolerance, _TIGHTEST)))
            note, saddles = ", off the saddle", saddles + 1
        return Outcome.UNSTABLE

    def _alone(self, now: Evaluation) -> bool:
        """Return whether nothing presses a particle, where what acts on single ones may balance by itself."""
        acting = single_effects(self.scene.effects)
        walls_only = all(isinstance(one, Walls | MeshWalls) for one in acting)
        return not acting or (walls_only and now.energy <= _NO_ENERGY * self.scene.energy_scale)

    def follow(self, name: str, method: Minimizer, tolerance: float) -> Outcome:
        """Advance by one method until it ends or a limit is met; return how it ended."""
        began, before, trace = self._now(), self.steps, self._trace
        self.stability = None
        self.program.velocity_nd[:] = 0.0
        task = Minimization(
            self.program,
            method,
            Goal(tolerance, 0.0),
            max(self.step_limit - (self.steps - self.newton_steps), 0),
            keep=None if trace is None else lambda step: trace.add_in_turn(step, self.program),
            keep_every=None if trace is None else trace.every,
            before=before,
            describe=lambda steps: (name, {"steps": before + steps, "residual": self.program.evaluate().residual}),
        )
        try:
            return self.loop.advance(task)
        finally:
            self.steps += task.steps
            self.evaluations += task.force_evaluations
            self._keep(name, self.program.evaluate(), task.steps, task.force_evaluations, began)

    def polish(self, tolerance: float, method: Any = None, step_limit: int = 60, note: str = "") -> Outcome:
        """Take Newton steps; return how they ended."""
        began = self._now()
        done = polish(
            self.packing(),
            self.scene.effects,
            force_tolerance=tolerance,
            step_limit=max(step_limit, 0),
            method=method,
            is_late=lambda: self.loop.late,
        )
        self.program.put(done.packing)
        self.steps += done.steps
        self.newton_steps += done.steps
        self.evaluations += done.force_evaluations
        # with links or shapes only as far as the last step saw
        self.stability = Stability(done.negative) if done.outcome.ok and self.scene.packing.plain else None
        unstable = f"{done.negative} unstable directions" if done.negative else ""
        self._keep("Newton" + note, self.program.evaluate(), done.steps, done.force_evaluations, began, unstable)
        return done.outcome

    def step_off(self, found: Stability) -> None:
        """Move particles off a saddle, along an unstable direction as far as the energy falls."""
        packing, direction = self.packing(), found.direction()
        diameter = float(packing.diameter_n.min())
        start = self._energy_at(packing)
        size, sign, best = _KICK * diameter, 1.0, start
        while size > _SHORTEST * diameter and best >= start:
            # where contacts close nearby, and where the curvature is small, only short steps go down
            for side in (1.0, -1.0):
                energy = self._energy_at(displaced(packing, side * size * direction))
                if energy < best:
                    sign, best = side, energy
            size *= 1.0 if best < start else 0.1
        if best >= start:
            # the energy falls by less than its last digit
            size = _KICK * diameter
        while best < start and 2.0 * size <= _LONGEST * diameter:
            energy = self._energy_at(displaced(packing, sign * 2.0 * size * direction))
            if not energy < best:
                break
            size, best = 2.0 * size, energy
        self.program.put(displaced(packing, sign * size * direction))

    def _energy_at(self, packing: Packing) -> float:
        """Return the energy with the particles where a packing has them."""
        self.program.put(packing)
        self.evaluations += 1
        return self.program.evaluate().energy

    def packing(self) -> Packing:
        """Return the packing as it is now."""
        return self.program.packing()

    def _now(self) -> tuple[float, float]:
        """Return the CPU time, and how much time went into compiling so far [s]."""
        return time.process_time(), self.loop.compiling()

    def _keep(
        self, name: str, now: Evaluation, steps: int, evaluations: int, began: tuple[float, float], note: str = ""
    ) -> None:
        self.evaluations += 1
        self.reached = now
        seconds, compiling = (end - start for start, end in zip(began, self._now(), strict=True))
        note = compiling_noted(note, compiling, seconds)
        self.stages.append(Stage(name, now.residual, steps, evaluations, seconds, note))
        self.loop.report(name, steps=self.steps, residual=now.residual)

    def finish(self, outcome: Outcome, tolerance: float) -> Run:
        """Return the run; its figures are those of the positions that are returned."""
        packing = self.packing()
        self.program.put(packing)
        end = self.program.evaluate()
        if outcome is Outcome.CONVERGED and end.residual > tolerance:
            near = end.max_force <= _FLOORS * end.force_floor
            outcome = Outcome.ROUNDING_FLOOR if near else Outcome.STALLED
        trace = None
        if self._trace is not None:
            self._trace.add(self.steps, self.program)
            trace = self._trace.build()
        judged = {} if self.stability is None else self.stability.to_dict()
        return Run(
            packing=packing,
            outcome=outcome,
            residual=0.0 if outcome is Outcome.UNJAMMED else end.residual,
            steps=self.steps,
            force_evaluations=self.evaluations + 1,
            seconds=time.process_time() - self.began - self.build_seconds,
            build_seconds=self.build_seconds,
            stages=tuple(self.stages),
            trace=trace,
            unmet=unmet_conditions(outcome, Condition("force residual", end.residual, tolerance)),
            report={**_crossings(self.scene.packing, packing, self.scene.effects), **judged},
        )


def find_crossings(packing: Packing) -> set[tuple[int, ...]] | None:
    """Return the pairs of links that cross, by (link, link, image), in two dimensions; None where not found out."""
    try:
        found = crossing_links(packing)
    except ValueError:
        # links much longer than the box pass over more images than can be listed
        return None
    return {tuple(row) for row in np.column_stack([found.first_c, found.second_c, found.image_cd]).tolist()}


def pairs_crossing(crossings: set[tuple[int, ...]]) -> tuple[tuple[int, ...], ...]:
    """Return the pairs of links among crossings, each once, in order."""
    return tuple(sorted({one[:2] for one in crossings}))


def _crossings(start: Packing, end: Packing, effects: tuple[Any, ...]) -> dict[str, Any]:
    """Return which links cross at the end, and which of them did not at the start; of rigid bodies, deep overlaps.

    Links in two dimensions only.
    """
    if not end.links or end.dimension != 2:
        return report_of_bodies(end, effects)
    # the lists stand in one order, and images are those of the positions as they are in both
    before, after = find_crossings(start), find_crossings(end)
    if before is None or after is None:
        return {"crossing_links": None, "crossed_links": None}
    return {"crossing_links": pairs_crossing(after), "crossed_links": pairs_crossing(after - before)}


def orientations_of(packings: Sequence[Packing]) -> NDArray[np.float64] | None:
    """Return the (T, N, q) orientations of packings with shapes; None of others."""
    found = np.array([one.shapes.orientation_nq for one in packings])
    return found if found.size else None


class _TraceBuilder:
    """Rows of observables kept on the way, every so many steps. Measuring them changes no bit of what follows."""

    def __init__(self, scene: Scene, every: int, positions: bool) -> None:
        self.scene, self.every = scene, every
        self.rows: list[dict[str, Any]] = []
        self.packing_t: list[Packing] | None = [] if positions else None

    def add_in_turn(self, step: int, program: Program) -> None:
        """Keep the figures of this step if its turn has come."""
        if step % self.every == 0:
            self.add(step, program)

    def add(self, step: int, program: Program) -> None:
        """Keep the observables of this step, once."""
        if self.rows and self.rows[-1]["step"] == step:
            return
        now = program.evaluate()
        measured = {name: getattr(now, name) for name in ("energy", "pressure", "contacts", "max_force")}
        added = measure_added(lambda: State(program.packing(), self.scene.effects, step))
        self.rows.append({"step": step, **measured, **added})
        if self.packing_t is not None:
            self.packing_t.append(program.packing())

    def build(self) -> Trace:
        """Return what was kept."""
        packings = self.packing_t
        if packings is None:
            return Trace.of_rows(self.rows)
        position = np.array([one.position_nd for one in packings])
        return Trace.of_rows(self.rows, position_tnd=position, orientation_tnq=orientations_of(packings))
