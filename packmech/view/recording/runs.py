"""Recordings of packings and of runs: forces and links at rest; bonds, sliding contacts and marks in motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from packmech.check import instance, integer
from packmech.measure import packing_fraction, pressure
from packmech.packing import Packing
from packmech.result import Run
from packmech.scene import Scene
from packmech.view import drawing
from packmech.view.recording.stream import World, blueprint, check_arguments, opened
from packmech.view.trajectory import (
    Motion,
    Snapshot,
    Trajectory,
    draw_snapshot,
    motions_of,
    trajectory_of_packing,
    trajectory_of_run,
)

# bytes of raw columns in one block: larger ones cost memory and are slower to write
BLOCK_BYTES = 2_000_000
# snapshots of a packing in motion in one block, for about this many numbers
BLOCK_NUMBERS = 250_000
# the present place on the curve of stress against strain
NOW = (255, 96, 96)


def record_packing(
    subject: Packing | Scene,
    path: str | Path,
    *,
    modes: Any = None,
    mode_count: int = 4,
    parameters: Mapping[str, Any] | None = None,
    results: Mapping[str, Any] | None = None,
    summary: str = "",
) -> Path:
    """Write one packing as a Rerun recording and return the absolute path.

    A scene's contact forces are drawn as lines as wide as the force, a bare packing's contacts as lines of one width;
    rattlers have their own color. Rigid links are lines of their own, bonds apart from links that hold a shape, as wide
    as their force and colored by its sign. Positions and lattice are there twice: rounded for the picture, exact under
    `/state`.

    Parameters
    ----------
    subject
        The packing or scene.
    path
        Where to write, usually `name.rrd`.
    modes
        Normal modes of the packing (`pm.normal_modes`); the lowest that are no free motions are drawn as arrows.
    mode_count
        How many of them.
    parameters, results
        How the packing was made and what was found, by name; kept as the recording's properties.
    summary
        Markdown shown beside the packing.

    Raises
    ------
    TypeError, ValueError
        For a subject that is neither packing nor scene, modes of another packing, a negative mode_count.
    OSError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = record_packing(pm.lattice_packing("kagome", repeats=(3, 3)), folder + "/kagome.rrd")
    ...     written.stat().st_size > 1000
    True

    """
    if not isinstance(subject, Packing | Scene):
        raise TypeError(f"subject must be a Packing or a Scene, got {type(subject).__name__}")
    check_arguments(path, parameters, results)
    found = dict(results or {})
    if isinstance(subject, Scene):
        found.setdefault("pressure", pressure(subject))
    trajectory = trajectory_of_packing(subject)
    found.setdefault("packing_fraction", packing_fraction(trajectory.final))
    stiffness = _stiffness(subject) if isinstance(subject, Scene) else 1.0
    motions = _motions(modes, trajectory, stiffness, mode_count)
    return _write(trajectory, path, motions, parameters, found, summary)


def record_run(
    run: Run,
    path: str | Path,
    *,
    scene: Scene,
    frames: int = 60,
    modes: Any = None,
    mode_count: int = 4,
    parameters: Mapping[str, Any] | None = None,
    results: Mapping[str, Any] | None = None,
    summary: str = "",
) -> Path:
    """Write a run as a Rerun recording, from its start to its final packing, and return the absolute path.

    Energy, pressure, contacts, the largest net force and the observables that were added are drawn against the step for
    every saved time of the trace; packings at `frames` of them at most, evenly chosen, first and last included. A run
    without a trace shows its start and its end.

    A time integration with friction, bonds, walls or strain that kept positions shows bonds, contacts that stick and
    contacts that slide apart, marks that turn with the particles, walls, which particles are held, the moving box, and
    stress against strain.

    Parameters
    ----------
    run
        The run. Its outcome, residual, steps, force evaluations and seconds are kept as properties.
    path
        Where to write, usually `name.rrd`.
    scene
        The scene that was run: the start, and the effects whose forces are drawn.
    frames
        Largest number of packings to draw.
    modes, mode_count, parameters, results, summary
        As in `record_packing`; modes are those of the final packing.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind, or a scene of another number of particles.
    OSError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> packing = pm.random_packing(16, dimension=2, packing_fraction=0.8, seed=3)
    >>> scene = pm.Scene(packing, effects=(pm.Repulsion(law=pm.Harmonic()),))
    >>> run = pm.jam(scene, pressure=1e-6)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = record_run(run, folder + "/jam.rrd", scene=scene)
    ...     written.stat().st_size > 1000
    True

    """
    instance("run", run, Run)
    instance("scene", scene, Scene)
    frames = integer("frames", frames, at_least=2)
    check_arguments(path, parameters, results)
    if run.packing.particles != scene.packing.particles:
        raise ValueError(f"scene must have the run's {run.packing.particles} particles, got {scene.packing.particles}")
    final = scene.replace(packing=run.packing)
    found: dict[str, Any] = {
        "outcome": run.outcome.name.lower(),
        "force_residual": run.residual,
        "steps": run.steps,
        "force_evaluations": run.force_evaluations,
        "seconds": run.seconds,
        "packing_fraction": packing_fraction(run.packing),
        **(results or {}),
    }
    trajectory = trajectory_of_run(run, scene, frames)
    motions: list[Motion] = []
    if not trajectory.in_motion:
        found.setdefault("pressure", pressure(final))
        motions = _motions(modes, trajectory, _stiffness(final), mode_count)
    return _write(trajectory, path, motions, parameters, {**trajectory.moduli, **found}, summary)


def _stiffness(scene: Scene) -> float:
    return scene.energy_scale / scene.packing.reference_diameter**2


def _motions(modes: Any, trajectory: Trajectory, stiffness: float, mode_count: int) -> list[Motion]:
    mode_count = integer("mode_count", mode_count, at_least=0)
    return [] if modes is None else motions_of(modes, trajectory.final, stiffness, mode_count)


def _write(
    trajectory: Trajectory,
    path: str | Path,
    motions: list[Motion],
    parameters: Mapping[str, Any] | None,
    results: Mapping[str, Any],
    summary: str,
) -> Path:
    layout = blueprint(trajectory, motions, summary=bool(summary))
    with opened(path, layout, trajectory, parameters, results) as (stream, target):
        world = World(stream, trajectory.final, trajectory.colors())
        if trajectory.in_motion:
            log_moving(world, summary)
            log_loop(stream, trajectory)
            size = max(1, BLOCK_NUMBERS // (world.packing.particles * world.packing.dimension * 12))
            for first in range(0, len(trajectory.snapshots), size):
                send_moving(world, trajectory.effects, trajectory.snapshots[first : first + size])
        else:
            log_resting(world, motions, summary)
            log_motions(world, motions, int(trajectory.step_f[-1]))
            # positions in doubles and floats, copies, and about 2 d lines of two ends a particle with width and color
            d = world.packing.dimension
            size = max(1, BLOCK_BYTES // (world.packing.particles * d * (8 + 4 + 2 * 2 * 4 * d)))
            for first in range(0, len(trajectory.snapshots), size):
                send_resting(world, trajectory.effects, trajectory.snapshots[first : first + size])
    return target


def log_resting(world: World, motions: Sequence[Motion] = (), summary: str = "") -> None:
    """Log what does not change of a packing with contact forces and links."""
    arrows = [f"modes/{motion.name}" for motion in motions]
    order = {"forces": 40.0, **dict.fromkeys(arrows, 50.0), **_link_order(world)}
    world.log_static(order, {"box": (drawing.OUTLINE_RADIUS, drawing.OUTLINE)}, arrows, summary)
    _log_links(world)


def _link_order(world: World) -> dict[str, float]:
    return {} if world.packing.links is None else {"links/shapes": 44.0, "links/bonds": 46.0}


def _log_links(world: World) -> None:
    """Log what does not change of links."""
    packing, links = world.packing, world.packing.links
    if links is not None:
        if not world.flat:  # whole spheres would hide their links
            beads = world.points.from_fields(radii=drawing.BEAD * packing.radius_n, colors=world.color_nc)
            world.stream.log("world/links/beads", beads, static=True)
        pairs = rr.AnyValues(i_l=links.i_l, j_l=links.j_l, length_l=links.length_l, shape_l=links.shape_l)
        world.stream.log("state/links", pairs, static=True)


def log_motions(world: World, motions: Sequence[Motion], step: int) -> None:
    """Log modes as arrows at a step."""
    packing = world.packing
    center_nd = drawing.draw_packing(packing).center_nd
    world.stream.set_time("step", sequence=step)
    for motion in motions:
        scale = drawing.arrow_scale(motion.displacement_nd, packing.reference_diameter)
        arrows = world.arrows(
            origins=center_nd,
            vectors=scale * motion.displacement_nd,
            colors=drawing.ARROW,
            radii=drawing.ARROW_RADIUS * packing.reference_diameter,
        )
        world.stream.log(f"world/modes/{motion.name}", arrows)
    world.stream.reset_time()


def send_resting(world: World, effects: tuple[Any, ...], snapshots: Sequence[Snapshot]) -> None:
    """Send packings with their contact forces and links as columns."""
    packing_f = [one.packing for one in snapshots]
    drawing_f = [drawing.draw_packing(packing, effects) for packing in packing_f]
    clock = [rr.TimeColumn("step", sequence=[one.step for one in snapshots])]
    world.send_packings(clock, packing_f, drawing_f)
    force_s = np.concatenate([one.force_s for one in drawing_f])
    packing = world.packing
    world.send_lines(
        clock,
        "forces",
        [one.segment_sed for one in drawing_f],
        radii=drawing.force_radii(force_s, packing.reference_diameter, packing.dimension),
        colors=drawing.force_colors(force_s),
    )


def log_moving(world: World, summary: str = "") -> None:
    """Log what does not change of a packing in motion."""
    order = {"marks": 35.0, "bonds": 38.0, "contacts/sticking": 40.0, "contacts/sliding": 44.0, "walls": 55.0}
    lines: dict[str, tuple[float | None, Any]] = {
        "marks": (drawing.MARK_WIDTH, drawing.MARK),
        "walls": (drawing.WALL_WIDTH, drawing.WALL),
        "box": (drawing.OUTLINE_RADIUS, drawing.OUTLINE),
        "bonds": (drawing.BOND_WIDTH, None),
        "contacts/sliding": (None, drawing.SLIDING),
    }
    world.log_static({**order, **_link_order(world)}, lines, summary=summary)
    _log_links(world)


def log_loop(stream: rr.RecordingStream, trajectory: Trajectory, step_t: NDArray[np.int64] | None = None) -> None:
    """Log stress against strain, each over its largest, as a curve, and the present place on it.

    The places are those of the snapshots, or at the steps step_t, one for each point of the curve.
    """
    if len(trajectory.strain_t) < 2:
        return
    strain_t, stress_t = trajectory.strain_t, trajectory.stress_t
    across, up = (float(np.abs(part).max(initial=0.0)) or 1.0 for part in (strain_t, stress_t))
    curve = np.column_stack([strain_t / across, stress_t / up])
    stream.log("loop", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
    axes = [[[-1.1, 0.0], [1.1, 0.0]], [[0.0, -1.1], [0.0, 1.1]]]
    stream.log("loop/axes", rr.LineStrips2D(axes, colors=drawing.OUTLINE, radii=0.004, draw_order=10.0), static=True)
    stream.log("loop/curve", rr.LineStrips2D([curve], colors=drawing.CURVE, radii=0.008, draw_order=20.0), static=True)
    if step_t is None:
        at, strain = trajectory.curves["strain"]
        stress = next(value for name, (_, value) in trajectory.curves.items() if name.startswith("stress"))
        step_t = trajectory.step_f
        place = np.column_stack([np.interp(step_t, at, strain / across), np.interp(step_t, at, stress / up)])
    else:
        place = curve
    columns = rr.Points2D.columns(positions=place).partition([1] * len(step_t))
    stream.log("loop/now", rr.Points2D.from_fields(radii=0.035, colors=NOW, draw_order=30.0), static=True)
    stream.send_columns("loop/now", [rr.TimeColumn("step", sequence=step_t)], columns)


def send_moving(world: World, effects: tuple[Any, ...], snapshots: Sequence[Snapshot]) -> None:
    """Send packings in motion as columns."""
    drawn_f = [draw_snapshot(one, effects) for one in snapshots]
    d, unit = world.packing.dimension, world.packing.reference_diameter
    clock = [
        rr.TimeColumn("step", sequence=[one.step for one in snapshots]),
        rr.TimeColumn("time", duration=[one.time for one in snapshots]),
    ]
    world.send_packings(clock, [one.packing for one in snapshots], [one.drawing for one in drawn_f])
    sticking = np.concatenate([one.sticking_force_s for one in drawn_f])
    sliding = np.concatenate([one.sliding_force_s for one in drawn_f])
    pull = np.concatenate([one.bond_pull_s for one in drawn_f])
    world.send_lines(
        clock,
        "contacts/sticking",
        [one.sticking_sed for one in drawn_f],
        radii=drawing.force_radii(sticking, unit, d),
        colors=drawing.force_colors(sticking),
    )
    sliding_f = [one.sliding_sed for one in drawn_f]
    world.send_lines(clock, "contacts/sliding", sliding_f, radii=drawing.force_radii(sliding, unit, d))
    world.send_lines(
        clock, "bonds", [one.bond_sed for one in drawn_f], colors=drawing.tension_colors(pull, shape=False)
    )
    world.send_lines(clock, "marks", [one.mark_ned for one in drawn_f])
    if any(one.wall_ed for one in drawn_f):
        world.send_lines(clock, "walls", [one.wall_ed for one in drawn_f])
