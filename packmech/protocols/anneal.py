"""Preparations of jammed packings a little at a time: `anneal_shape` changes shapes, `tap` shakes particles."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import BoxStrain, instance, integer, one_of, positive
from packmech.contacts.shape_contacts import touching_pairs
from packmech.generate.cluster_shapes import LinearCluster
from packmech.generate.random import generator_of
from packmech.generate.rigid import beads_of, body_of
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import RunLoop, RunSettings, run_settings
from packmech.packing import Packing, no_own_images
from packmech.protocols.hard_vertex import HardVertex
from packmech.protocols.linked_jam import PRESSED, compress_linked, follow_pressure
from packmech.protocols.pressure_path import follow_jammed
from packmech.protocols.protocol import (
    Protocol,
    check_jammed,
    check_reachable,
    finish,
    in_turn,
    is_jammed,
    report_start,
    sequence,
)
from packmech.result import Outcome, Run
from packmech.scene import Scene
from packmech.shapes import Beads, Shapes, Spheroids

# growth of the packing fraction in each step of compression, net force over mean contact force at which FIRE stops in
# each box, and its maximum number of steps
_DENSER, _QUENCHED, _QUENCH_STEPS = 1.003, 1e-4, 1_000_000


def _reshaped(packing: Packing, aspect: float, beads: int | None, rng: np.random.Generator | None) -> Shapes:
    """Return ellipses or spheroids of an aspect, or straight rows of beads, turned as the particles of the packing are.

    Discs and spheres are turned at random.
    """
    d, count, orientation = packing.dimension, packing.particles, packing.shapes.orientation_nq
    if not orientation.size:
        width = d if beads is None or d == 2 else 4
        orientation = generator_of(None, rng).standard_normal((count, width))
    if beads is None:
        return Spheroids(np.full(count, aspect), orientation)
    row = LinearCluster(beads, length=(aspect - 1.0) / (beads - 1.0)).cluster(d)
    return beads_of([body_of(row.position_bd, row.radius_b)] * count, orientation)


@honors("repulsion kinds shapes", at_rest=True)
def anneal_shape(
    scene: Scene,
    aspects: Iterable[float],
    *,
    beads: int | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    pressure: float = 1e-6,
    strain: BoxStrain = "isotropic",
    force_tolerance: float = 1e-5,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> tuple[Run, ...]:
    """Return one run for each aspect: a jammed packing whose particles change their shape, jammed again each time.

    At every step all particles take the next aspect at the area or volume that they have, relax where they stand by
    FIRE, are compressed in small steps (0.3 % of the packing fraction) until they press, and are followed down to the
    pressure: the shape annealing of Schreck and O'Hern (2010). Directors are drawn at random, uniform over all
    directions, when discs or spheres get them; from then on they are those that the step before ended with. The smaller
    the steps, the more of them: `numpy.arange(1.05, 1.501, 0.05)` gives those of .05 up to 1.5.

    Parameters
    ----------
    scene
        The scene of a jammed packing of discs or spheres, or of one that was annealed before, which goes on.
    aspects
        In the order in which they are visited: axis along the director over that across it; of rows of beads length
        over width, above 1 and at most the number of beads [1].
    beads
        None: ellipses or spheroids. Otherwise the number of equal beads in a straight rigid row: 2 for dimers.
    seed, rng
        Of the random directors: exactly one of them for discs or spheres, none for particles that have directors.
    pressure
        At which each packing ends [energy_scale / diameter^d].
    strain
        "isotropic": the box keeps its shape. "free": strains relax, so that the stress is isotropic.
    force_tolerance
        Largest net force over mean contact force that counts as balance [1].
    time_limit
        Stop after so much CPU time in all, compiling aside [s]; the run in hand ends with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures).
    check
        Raise NotConverged when a packing is not jammed or not balanced; otherwise a run that is not jammed is the last.

    Returns
    -------
    tuple of Run
        `report` as for `jam`, and aspect. contacts_closed and contacts_opened are pairs of particles since the packing
        before; `start` is "continued" where there are none, otherwise "rearranged".

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If a packing does not come to rest at the pressure and `check` is set.
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished, `.run` to the one in hand.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),))
    >>> discs = pm.jam(scene, pressure=1e-5, strain="isotropic")
    >>> runs = pm.anneal_shape(scene.replace(packing=discs.packing), [1.1, 1.2], seed=1, pressure=1e-5)
    >>> [run.report["aspect"] for run in runs], runs[0].report["packing_fraction"] > discs.report["packing_fraction"]
    ([1.1, 1.2], True)

    """
    instance("scene", scene, Scene)
    goals = sequence("aspects", aspects, "aspect")
    one_of("strain", strain, ("isotropic", "free"))
    check_reachable(scene, "pressure", positive("pressure", pressure))
    positive("force_tolerance", force_tolerance)
    settings = run_settings(time_limit=time_limit, progress=progress, check=check)
    packing = scene.packing
    if beads is not None:
        integer("beads", beads, at_least=2)
        if (goals <= 1.0).any() or (goals > beads).any():
            wrong = goals[(goals <= 1.0) | (goals > beads)][0]
            raise ValueError(f"aspects must be above 1 and at most the number of beads, {beads}, got {wrong:g}")
    kind = Spheroids if beads is None else Beads
    if not packing.shapes.has_orientations:
        rng = generator_of(seed, rng)
    elif not isinstance(packing.shapes, kind):
        raise ValueError(
            f"scene.packing must be of discs, spheres or {kind.__name__}, got {type(packing.shapes).__name__}"
        )
    elif seed is not None or rng is not None:
        raise ValueError("seed and rng must be left out for particles that have directors")
    check_jammed(scene)
    again = _Again(packing, settings, pressure, strain, force_tolerance, "anneal_shape")

    def with_aspect(aspect: float) -> Run:
        before = again.packing
        reshaped = before.replace(shapes=_reshaped(before, aspect, beads, rng))
        return again.jam(scene.replace(packing=reshaped), {"aspect": aspect})

    return in_turn(goals.tolist(), with_aspect)


def kicked(packing: Packing, amplitude: float, rng: np.random.Generator) -> Packing:
    """Return the packing with every particle displaced and turned at random.

    Parameters
    ----------
    packing
        The packing, without links.
    amplitude
        Standard deviation of each coordinate, of turns times radii of gyration, too [length].
    rng
        Where random numbers come from.

    """
    position = packing.position_nd + amplitude * rng.standard_normal(packing.position_nd.shape)
    basis = packing.turn_nkt
    turns = amplitude * rng.standard_normal(basis.shape[:2])
    shapes = packing.shapes.turned((turns[:, :, None] * basis).sum(axis=1))
    return packing.replace(position_nd=position, shapes=shapes, tangential=None)


@honors("repulsion kinds shapes", at_rest=True)
def tap(
    scene: Scene,
    amplitude: float,
    taps: int = 1,
    *,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    pressure: float = 1e-6,
    strain: BoxStrain = "isotropic",
    force_tolerance: float = 1e-5,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> tuple[Run, ...]:
    """Return one run for each tap of a jammed packing: particles are kicked at random, then the packing jams again.

    At every tap all particles are displaced, and turned if they have shapes, at random and independently; then they
    relax where they stand by FIRE, are compressed in small steps (0.3 % of the packing fraction) until they press, and
    are followed down to the pressure. Vibration without inertia: a tap is a jump to another place in the landscape of
    energies and the way down from there. Weak kicks lead back to the same packing, kicks of some tenths of the diameter
    make loose packings denser, and those near the diameter make other random packings. To go on, call again with the
    packing of the last run and the same `rng`: the taps are those of one call.

    Parameters
    ----------
    scene
        The scene of a jammed packing.
    amplitude
        Standard deviation of every component of the displacements, and of angles times radii of gyration, over the mean
        diameter [1].
    taps
        How many.
    seed, rng
        Of the kicks: exactly one of them.
    pressure
        At which each packing ends [energy_scale / diameter^d].
    strain
        "isotropic": the box keeps its shape. "free": strains relax, so that the stress is isotropic.
    force_tolerance
        Largest net force over mean contact force that counts as balance [1].
    time_limit
        Stop after so much CPU time in all, compiling aside [s]; the run in hand ends with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures), and as progress("tap", figures) after each tap, with "tap", "packing" and
        "packing_fraction".
    check
        Raise NotConverged when a packing is not jammed or not balanced; otherwise a run that is not jammed is the last.

    Returns
    -------
    tuple of Run
        `report` as for `jam`, and tap (1 for the first) and amplitude. contacts_closed and contacts_opened are since
        the packing before; `start` is "continued" where there are none, otherwise "rearranged".

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If a packing does not come to rest at the pressure and `check` is set.
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished, `.run` to the one in hand.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),))
    >>> scene = scene.replace(packing=pm.jam(scene, pressure=1e-5, strain="isotropic").packing)
    >>> runs = pm.tap(scene, 0.05, 3, seed=1, pressure=1e-5)
    >>> [run.report["tap"] for run in runs], round(runs[-1].report["pressure"], 9)
    ([1, 2, 3], 1e-05)

    """
    instance("scene", scene, Scene)
    no_own_images("scene.packing", scene.packing)
    kick = positive("amplitude", amplitude) * float(scene.packing.diameter_n.mean())
    number = integer("taps", taps, at_least=1)
    rng = generator_of(seed, rng)
    one_of("strain", strain, ("isotropic", "free"))
    check_reachable(scene, "pressure", positive("pressure", pressure))
    positive("force_tolerance", force_tolerance)
    settings = run_settings(time_limit=time_limit, progress=progress, check=check)
    check_jammed(scene)
    again = _Again(scene.packing, settings, pressure, strain, force_tolerance, "tap")

    def tapped(count: int) -> Run:
        shaken = scene.replace(packing=kicked(again.packing, kick, rng))
        return again.jam(shaken, {"tap": count, "amplitude": float(amplitude)})

    def reported(count: int, run: Run) -> None:
        if callable(progress):
            figures = {"packing": run.packing, "packing_fraction": run.report["packing_fraction"]}
            progress("tap", {"tap": count, **figures})

    return in_turn(range(1, number + 1), tapped, reported)


class _Again:
    """A packing that is changed and jams again, one time after the other, and how it does."""

    def __init__(
        self,
        packing: Packing,
        settings: RunSettings,
        pressure: float,
        strain: BoxStrain,
        force_tolerance: float,
        method: str,
    ) -> None:
        self.packing, self.loop = packing, RunLoop(settings)
        self.asked = pressure, strain, force_tolerance, method

    def jam(self, changed: Scene, report: dict[str, Any]) -> Run:
        """Return the run of the changed packing, with more to report; it is the packing from then on."""
        run = _jammed_again(changed, self.packing, self.loop.rest(), *self.asked)
        self.packing = run.packing
        return dataclasses.replace(run, report={**report, **run.report})


def _jammed_again(
    scene: Scene,
    before: Packing,
    settings: RunSettings,
    pressure: float,
    strain: BoxStrain,
    force_tolerance: float,
    method: str,
) -> Run:
    """Return the run of a packing that was changed: relaxed, compressed where it stands, then down to the pressure.

    One that is still at rest, because it was changed by nothing, is followed in pressure from where it stands.
    """
    began, loop = time.process_time(), RunLoop(settings)
    protocol = Protocol(scene, strain, force_tolerance, loop)
    protocol.continues = True

    def work() -> Outcome:
        if is_jammed(scene):
            protocol.last, outcome = _followed(protocol, pressure)
            return outcome
        until = max(PRESSED, pressure)
        protocol.last, now = compress_linked(protocol, protocol.scene.packing, until, _QUENCHED, _QUENCH_STEPS, _DENSER)
        if now < until:
            return Outcome.NOT_JAMMED
        protocol.scene = protocol.scene.replace(packing=protocol.last)
        if scene.packing.plain:
            protocol.last, outcome = _followed(protocol, pressure)
        else:
            protocol.last, outcome = follow_pressure(protocol, protocol.last, now, pressure)
        return outcome

    def finished(outcome: Outcome) -> Run:
        # pairs of particles: their shapes may be others than before
        was, now = (
            set(zip(one.i_c.tolist(), one.j_c.tolist(), map(tuple, one.image_cd.tolist()), strict=True))
            for one in (touching_pairs(before), touching_pairs(protocol.last))
        )
        # those that the way down in pressure counts are not all
        protocol.report.pop("rearrangements", None)
        protocol.report.update(contacts_closed=len(now - was), contacts_opened=len(was - now))
        report_start(protocol)
        return finish(protocol, protocol.last, outcome, pressure, method, began)

    with single_thread():
        return loop.run(work, finished)


def _followed(protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
    """Return the scene's packing, which is jammed, followed to the pressure, and how that ended."""
    if protocol.scene.packing.plain:
        return HardVertex().follow(protocol, pressure)
    return follow_jammed(protocol, pressure)
