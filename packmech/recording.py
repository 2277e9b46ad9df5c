"""Rerun recordings of packings and of runs. With its layout, the only importer of rerun."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from packmech import drawing
from packmech.check import instance, integer, table
from packmech.march_film import film_of_march, is_march
from packmech.measure import packing_fraction, pressure
from packmech.outcome import Run
from packmech.packing import Packing
from packmech.recording_film import Film, Motion, film_of_packing, film_of_run, motions_of, properties_of
from packmech.recording_march import write_march
from packmech.scene import Scene

if TYPE_CHECKING:
    import rerun as rr

__all__ = ["record_packing", "record_run"]

# bytes of raw columns in one block: larger ones cost memory and are slower to write
BLOCK_BYTES = 2_000_000


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
    check_told(path, parameters, results)
    told = dict(results or {})
    if isinstance(subject, Scene):
        told.setdefault("pressure", pressure(subject))
    film = film_of_packing(subject)
    told.setdefault("packing_fraction", packing_fraction(film.final))
    stiffness = _stiffness(subject) if isinstance(subject, Scene) else 1.0
    return _write(film, path, _motions(modes, film, stiffness, mode_count), parameters or {}, told, summary)


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

    Energy, pressure, contacts and the largest net force are drawn against the step for every saved time of the trace;
    packings at `frames` of them at most, evenly chosen, first and last included. A run without a trace shows its start
    and its end.

    A run of a march (friction, bonds, walls, strain) that kept positions shows bonds, contacts that stick and contacts
    that slide apart, marks that turn with the particles, walls, who is held, the moving box, and stress against strain.

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
    check_told(path, parameters, results)
    if run.packing.particles != scene.packing.particles:
        raise ValueError(f"scene must have the run's {run.packing.particles} particles, got {scene.packing.particles}")
    final = scene.replace(packing=run.packing)
    told: dict[str, Any] = {
        "outcome": run.outcome.name.lower(),
        "force_residual": run.residual,
        "steps": run.steps,
        "force_evaluations": run.force_evaluations,
        "seconds": run.seconds,
        "packing_fraction": packing_fraction(run.packing),
        **(results or {}),
    }
    if is_march(run):
        return write_march(film_of_march(run, scene, frames), path, parameters or {}, told, summary)
    told.setdefault("pressure", pressure(final))
    film = film_of_run(run, scene, frames)
    return _write(film, path, _motions(modes, film, _stiffness(final), mode_count), parameters or {}, told, summary)


def check_told(path: Any, parameters: Any, results: Any) -> None:
    """Check where to write, and that what is told comes by name."""
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file name, got {path!r}")
    for name, value in (("parameters", parameters), ("results", results)):
        if value is not None:
            table(name, value)


def _stiffness(scene: Scene) -> float:
    return scene.energy_scale / scene.packing.reference_diameter**2


def _motions(modes: Any, film: Film, stiffness: float, mode_count: int) -> list[Motion]:
    mode_count = integer("mode_count", mode_count, at_least=0)
    return [] if modes is None else motions_of(modes, film.final, stiffness, mode_count)


def _write(
    film: Film,
    path: str | Path,
    motions: list[Motion],
    parameters: Mapping[str, Any],
    results: Mapping[str, Any],
    summary: str,
) -> Path:
    from packmech.recording_layout import blueprint

    layout = blueprint(film, motions, summary=bool(summary))
    with opened(path, layout, film, parameters, results) as (stream, target):
        color_nc = drawing.particle_colors(film.final.radius_n, film.rattler_n(), film.final.links)
        log_packing(stream, film, motions, color_nc, summary)
        for block in _blocks(film):
            send_block(stream, film, block, color_nc)
    return target


@contextmanager
def opened(
    path: str | Path, layout: Any, film: Film, parameters: Mapping[str, Any], results: Mapping[str, Any]
) -> Iterator[tuple[rr.RecordingStream, Path]]:
    """Open a recording, write properties and curves of the film, and give the stream and the absolute path."""
    import rerun as rr

    target = Path(path).absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("ab"):  # the writer only logs a file that it cannot open
        pass
    stream = rr.RecordingStream("packmech")
    try:
        stream.save(target, default_blueprint=layout)
        stream.send_recording_name(target.stem)
        stream.send_property("packmech", property_values(properties_of(film, parameters, results)))
        for name, (step_t, value_t) in film.curves.items():
            path_of = f"series/{name.replace(' ', '_')}"
            stream.log(path_of, rr.SeriesLines(names=name, colors=drawing.CURVE, widths=2.0), static=True)
            stream.send_columns(path_of, [rr.TimeColumn("step", sequence=step_t)], rr.Scalars.columns(scalars=value_t))
        yield stream, target
    finally:
        stream.flush()
        stream.disconnect()


def property_values(told: Mapping[str, Any]) -> rr.AnyValues:
    """Return properties as Rerun takes them, each with the type that it has in this recording.

    Rerun remembers the first type of a name for the whole process: a result that is a word in one recording and a
    number in the next ("strain") would be left out of the second.
    """
    import pyarrow
    import rerun as rr

    return rr.AnyValues(**{name: pyarrow.array([value]) for name, value in told.items()})


def _blocks(film: Film) -> list[range]:
    """Ranges of frames whose raw columns stay near BLOCK_BYTES."""
    packing = film.final
    # positions in doubles and floats, copies, and about 2 d lines of two ends a particle with width and color
    frame_bytes = packing.particles * packing.dimension * (8 + 4 + 2 * 2 * 4 * packing.dimension)
    size = max(1, BLOCK_BYTES // frame_bytes)
    return [range(first, min(first + size, len(film.step_f))) for first in range(0, len(film.step_f), size)]


def log_packing(
    stream: rr.RecordingStream, film: Film, motions: list[Motion], color_nc: NDArray[np.uint8], summary: str
) -> None:
    """Log what does not change, and the motions at the last step."""
    import rerun as rr

    packing, flat = film.final, film.final.dimension == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    if flat:  # the viewer's 2D axes point down
        stream.log("world", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
    else:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/particles", points.from_fields(radii=packing.radius_n, colors=color_nc), static=True)
    if flat:  # what lies over what; 3D views know it by themselves
        stream.log("world/particles/copies", rr.Points2D.from_fields(draw_order=20.0), static=True)
        stream.log("world/particles", rr.Points2D.from_fields(draw_order=30.0), static=True)
        stream.log("world/forces", rr.LineStrips2D.from_fields(draw_order=40.0), static=True)
        stream.log("world/box", rr.LineStrips2D.from_fields(draw_order=60.0), static=True)
        for motion in motions:
            stream.log(f"world/modes/{motion.name}", rr.Arrows2D.from_fields(draw_order=50.0), static=True)
    width = drawing.OUTLINE_RADIUS * packing.reference_diameter
    stream.log("world/box", strips.from_fields(radii=width, colors=drawing.OUTLINE), static=True)
    stream.log("state/radius", rr.AnyValues(radius_n=packing.radius_n), static=True)
    links = packing.links
    if links is not None:
        if flat:
            stream.log("world/links/shapes", rr.LineStrips2D.from_fields(draw_order=44.0), static=True)
            stream.log("world/links/bonds", rr.LineStrips2D.from_fields(draw_order=46.0), static=True)
        else:  # whole spheres would hide their links
            beads = points.from_fields(radii=drawing.BEAD * packing.radius_n, colors=color_nc)
            stream.log("world/links/beads", beads, static=True)
        pairs = rr.AnyValues(i_l=links.i_l, j_l=links.j_l, length_l=links.length_l, shape_l=links.shape_l)
        stream.log("state/links", pairs, static=True)
    arrows = rr.Arrows2D if flat else rr.Arrows3D
    center_nd = drawing.draw_packing(packing).center_nd
    last = int(film.step_f[-1])
    stream.set_time("step", sequence=last)
    for motion in motions:
        scale = drawing.arrow_scale(motion.displacement_nd, packing.reference_diameter)
        stream.log(
            f"world/modes/{motion.name}",
            arrows(
                origins=center_nd,
                vectors=scale * motion.displacement_nd,
                colors=drawing.ARROW,
                radii=drawing.ARROW_RADIUS * packing.reference_diameter,
            ),
        )
    stream.reset_time()
    if summary:
        stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)


def send_block(stream: rr.RecordingStream, film: Film, block: range, color_nc: NDArray[np.uint8]) -> None:
    """Send the frames of a block as columns."""
    import rerun as rr

    packing_f = [film.packing_f[f] for f in block]
    drawing_f = [drawing.draw_packing(packing, film.effects) for packing in packing_f]
    flat = film.final.dimension == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    time = [rr.TimeColumn("step", sequence=film.step_f[block.start : block.stop])]

    def send(path: str, columns: Any, sizes: list[int]) -> None:
        stream.send_columns(path, time, columns.partition(sizes))

    send(
        "world/particles",
        points.columns(positions=np.concatenate([d.center_nd for d in drawing_f])),
        _counts(drawing_f, "center_nd"),
    )
    owner_k = np.concatenate([d.copy_of_k for d in drawing_f])
    if flat:
        send(
            "world/particles/copies",
            points.columns(
                positions=np.concatenate([d.copy_center_kd for d in drawing_f]),
                radii=film.final.radius_n[owner_k],
                colors=drawing.dimmed(color_nc[owner_k]),
            ),
            _counts(drawing_f, "copy_of_k"),
        )
    force_s = np.concatenate([d.force_s for d in drawing_f])
    send(
        "world/forces",
        strips.columns(
            strips=np.concatenate([d.segment_sed for d in drawing_f]),
            radii=drawing.force_radii(force_s, film.final.reference_diameter, film.final.dimension),
            colors=drawing.force_colors(force_s),
        ),
        _counts(drawing_f, "force_s"),
    )
    if film.final.links is not None:
        send_links(packing_f, drawing_f, send)
    outline_k = [line for d in drawing_f for line in d.outline_ed]
    send("world/box", strips.columns(strips=outline_k), [len(d.outline_ed) for d in drawing_f])
    state = rr.AnyValues.columns(
        position_nd=np.concatenate([packing.position_nd.ravel() for packing in packing_f]),
    )
    send("state/position", state, [packing.position_nd.size for packing in packing_f])
    lattice = rr.AnyValues.columns(lattice_dd=np.concatenate([packing.box.lattice_dd.ravel() for packing in packing_f]))
    send("state/lattice", lattice, [packing.box.lattice_dd.size for packing in packing_f])


def send_links(packing_f: list[Packing], drawing_f: list[drawing.Drawing], send: Callable[..., None]) -> None:
    """Send the lines of the links, bonds and shapes apart, and the images that the exact positions have them at."""
    import rerun as rr

    d, diameter = packing_f[0].dimension, packing_f[0].reference_diameter
    if d == 3:
        beads = rr.Points3D.columns(positions=np.concatenate([one.center_nd for one in drawing_f]))
        send("world/links/beads", beads, _counts(drawing_f, "center_nd"))
    strips = rr.LineStrips2D if d == 2 else rr.LineStrips3D
    for path, name, shape in (("bonds", "bond", False), ("shapes", "shape", True)):
        tension_s = np.concatenate([getattr(one, f"{name}_tension_s") for one in drawing_f])
        columns = strips.columns(
            strips=np.concatenate([getattr(one, f"{name}_sed") for one in drawing_f]),
            radii=drawing.tension_radii(tension_s, diameter, d, shape=shape),
            colors=drawing.tension_colors(tension_s, shape=shape),
        )
        send(f"world/links/{path}", columns, _counts(drawing_f, f"{name}_tension_s"))
    image_f = [packing.links.image_ld.ravel() for packing in packing_f if packing.links is not None]
    send("state/link_image", rr.AnyValues.columns(image_ld=np.concatenate(image_f)), [len(one) for one in image_f])


def _counts(drawing_f: list[drawing.Drawing], name: str) -> list[int]:
    return [len(getattr(one, name)) for one in drawing_f]
