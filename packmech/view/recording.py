"""Rerun recordings of packings, of runs and of played motions.

Packings at rest are drawn with contact forces and links, packings in motion with bonds, sliding contacts and marks that
turn, played motions with contacts that stay, open and close. `World` holds what all recordings show of a packing.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from packmech.calls.status import shown_as
from packmech.check import FRAME_BYTES, instance, integer, table
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.network import pair_contacts
from packmech.contacts.pairs import pair_names
from packmech.files.paths import file_name, printable, replacing, writable_file
from packmech.files.records import is_record, to_table
from packmech.jamming.play import PlayedMotion
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import pressure
from packmech.mechanics.rigid_clusters import RigidClusters
from packmech.packing import Packing
from packmech.result import Run
from packmech.scene import Scene
from packmech.shapes import Beads, Discs, Spheroids, Superellipsoids
from packmech.view import drawing
from packmech.view.trajectory import (
    Curve,
    DrawnMode,
    PackingFrame,
    Trajectory,
    draw_moving,
    motions_of,
    trajectory_of_packing,
    trajectory_of_run,
)

PLAY_SECONDS = 6.0
MARGIN = 0.04
# plots that stand in one column
COLUMN_PLOTS = 8

# how Rerun ends a recording, and within how many bytes of the end of the file that stands
_FOOT, _FOOT_WITHIN = b"RRF2FOOT", 64

Views = list[rrb.Container | rrb.View]
Clock = list[rr.TimeColumn]


def check_arguments(path: Any, parameters: Any, results: Any) -> None:
    """Check where to write, and that parameters and results come by name."""
    file_name("path", path)
    for name, value in (("parameters", parameters), ("results", results)):
        if value is not None:
            table(name, value)


@contextmanager
def opened(
    path: str | Path,
    layout: rrb.Blueprint,
    trajectory: Trajectory,
    parameters: Mapping[str, Any] | None,
    results: Mapping[str, Any],
) -> Iterator[tuple[rr.RecordingStream, Path]]:
    """Open a recording, write its properties and curves, and give the stream and the absolute path.

    The file is made at the end, as a whole.
    """
    target = Path(path).absolute()
    writable_file("path", target, make_folder=True)
    stream = rr.RecordingStream("packmech")
    # written by packmech: Rerun logs what goes wrong as it writes a file, or waits for ever
    content = rr.binary_stream(stream)
    try:
        stream.send_blueprint(layout, make_active=False, make_default=True)
        stream.send_recording_name(printable(target.stem))
        properties = properties_of(trajectory.final, trajectory.effects, parameters or {}, results)
        stream.send_property("packmech", property_values(properties))
        send_curves(stream, trajectory.curves)
        yield stream, target
        # once: each time that it is read it ends as a recording does
        whole = content.read() or b""
    finally:
        stream.disconnect()
    try:
        with replacing(target) as partial:
            partial.write_bytes(whole)
    except OSError as error:
        raise unwritten(target, error.strerror or str(error)) from error


@contextmanager
def written_whole(path: Path) -> Iterator[None]:
    """Turn what Rerun raises of a recording that it cannot write, or only logs, into an OSError that names the file."""
    try:
        yield
    except RuntimeError as error:
        raise unwritten(path, str(error)) from error
    if path.is_file():
        with open(path, "rb") as file:
            file.seek(max(path.stat().st_size - _FOOT_WITHIN, 0))
            if _FOOT not in file.read():
                raise unwritten(path, "its end is missing; is there room for it?")


def unwritten(path: Path, reason: str) -> OSError:
    """Return the error of a recording that could not be written."""
    return OSError(f"path must be a file that can be written, got {str(path)!r}: {reason}")


def send_curves(stream: rr.RecordingStream, curves: Mapping[str, Curve]) -> None:
    """Send what is plotted against step, and how."""
    for name, (step_t, value_t) in curves.items():
        path = f"series/{name.replace(' ', '_')}"
        stream.log(path, rr.SeriesLines(names=name, colors=drawing.CURVE, widths=2.0), static=True)
        stream.send_columns(path, [rr.TimeColumn("step", sequence=step_t)], rr.Scalars.columns(scalars=value_t))


def properties_of(
    packing: Packing, effects: Sequence[Any], parameters: Mapping[str, Any], results: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the properties of a recording: all parameters and results as JSON, and each plain result by name."""
    given = {
        "particles": packing.particles,
        "dimension": packing.dimension,
        "effects": [to_table(effect) for effect in effects],
        **parameters,
    }
    plain = {name: value for name, value in results.items() if isinstance(value, bool | int | float | str)}
    return {
        "parameters_json": json.dumps(plain_value(given)),
        "results_json": json.dumps(plain_value(results)),
        **plain,
    }


def plain_value(value: Any) -> Any:
    """Return the value as JSON knows it: records as tables, arrays as lists, what has no such form as its text.

    Examples
    --------
    >>> import packmech as pm
    >>> plain_value({"law": pm.Hertz(), "shares": np.array([0.5, 0.5])})
    {'law': {'kind': 'hertz', 'energy_scale': 1.0}, 'shares': [0.5, 0.5]}

    """
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if is_record(value):  # before the plain tuples, which some records are
        return plain_value(to_table(value))
    if isinstance(value, Mapping):
        return {str(name): plain_value(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(entry) for entry in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def property_values(properties: Mapping[str, Any]) -> rr.AnyValues:
    """Return properties as Rerun takes them, each with the type that it has in this recording.

    Rerun remembers the first type of a name for the whole process: a result that is a word in one recording and a
    number in the next ("strain") would be left out of the second.
    """
    return rr.AnyValues(**{name: pyarrow.array([value]) for name, value in properties.items()})


# half the width of an ellipse's outline [reference diameter]
SHAPE_RIM = 0.03
# under `state`, of the shapes: the entity of the arrays that stay as they are, and that of the one that turns
STAYING = {Discs: "", Spheroids: "aspect", Beads: "beads", Superellipsoids: "superellipsoids"}
_ORIENTATION = {"orientation": "orientation_nq"}
TURNING = {Discs: {}, Spheroids: {"director": "director_nd"}, Beads: _ORIENTATION, Superellipsoids: _ORIENTATION}


class World:
    """What every recording shows of its packing, under `world`, and its exact arrays, under `state`.

    Parameters
    ----------
    stream
        Where to.
    packing
        The particles, with their radii and links.
    color_nc
        (N, 3) their colors.

    """

    def __init__(self, stream: rr.RecordingStream, packing: Packing, color_nc: NDArray[np.uint8]) -> None:
        self.stream, self.packing, self.color_nc = stream, packing, color_nc
        self.flat = packing.dimension == 2
        # superellipsoids in space have surfaces of triangles, all others sites
        surfaces = not self.flat and not packing.shapes.has_spheroid_sites
        self.solids = drawing.solids_of(packing, color_nc) if surfaces else []
        self.sites: Any = None if surfaces else drawing.sites_of(packing, packing.position_nd)
        self.points: Any = rr.Points2D if self.flat else rr.Points3D
        self.strips: Any = rr.LineStrips2D if self.flat else rr.LineStrips3D
        self.arrows: Any = rr.Arrows2D if self.flat else rr.Arrows3D

    def log_static(
        self,
        order: Mapping[str, float],
        lines: Mapping[str, tuple[float | None, Any]],
        arrows: Sequence[str] = (),
        summary: str = "",
    ) -> None:
        """Log what does not change.

        Parameters
        ----------
        order
            Which entity lies over which, in a plane; in space it is seen.
        lines
            Half width over the reference diameter, and color, of each entity of lines; None: they change.
        arrows
            Those of the entities that are arrows.
        summary
            Markdown shown beside the packing.

        """
        stream, packing = self.stream, self.packing
        if self.flat:  # the viewer's 2D axes point down
            stream.log("world", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
            for name, place in {"particles/copies": 20.0, "particles": 30.0, "box": 60.0, **order}.items():
                kind: Any = rr.Arrows2D if name in arrows else rr.LineStrips2D
                if name.startswith("particles") and self.sites.round:
                    kind = rr.Points2D
                stream.log(f"world/{name}", kind.from_fields(draw_order=place), static=True)
        else:
            stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for path, particles in self._static_particles():
            stream.log(path, particles, static=True)
        for name, (width, color) in lines.items():
            kind = self.arrows if name in arrows else self.strips
            radii = None if width is None else width * packing.reference_diameter
            stream.log(f"world/{name}", kind.from_fields(radii=radii, colors=color), static=True)
        stream.log("state/radius", rr.AnyValues(radius_n=packing.radius_n), static=True)
        if packing.kinds > 1:
            stream.log("state/kind", rr.AnyValues(kind_n=packing.kind_n), static=True)
        kind = type(packing.shapes)
        turning = TURNING[kind].values()
        # rows one after the other: columns of this kind are flat
        staying: Any = {name: one.ravel() for name, one in packing.shapes.arrays().items() if name not in turning}
        if staying:
            stream.log(f"state/{STAYING[kind]}", rr.AnyValues(**staying), static=True)
        if summary:
            stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)

    def _static_particles(self) -> Iterator[tuple[str, Any]]:
        """Give what does not change of the particles: sizes and colors, of ellipses the outlines' width, surfaces."""
        sites, path = self.sites, "world/particles"
        if self.solids:
            shapes: Any = self.packing.shapes
            axes_nd = shapes.axes(self.packing.radius_n)
            for k, one in enumerate(self.solids):
                yield (
                    f"{path}/{k}",
                    rr.Mesh3D(
                        vertex_positions=one.corner_vd,
                        vertex_normals=one.normal_vd,
                        triangle_indices=one.triangle_tk,
                        albedo_factor=one.color,
                    ),
                )
                yield f"{path}/{k}", rr.InstancePoses3D.from_fields(scales=axes_nd[one.particle_k])
        elif sites.round:
            yield path, self.points.from_fields(radii=sites.along_b, colors=self.color_nc[sites.owner_b])
        elif self.flat:
            yield path, rr.LineStrips2D.from_fields(radii=SHAPE_RIM * self.packing.reference_diameter)
        else:
            yield (
                path,
                rr.Ellipsoids3D.from_fields(
                    half_sizes=np.stack([sites.along_b, sites.across_b, sites.across_b], axis=1),
                    colors=self.color_nc[sites.owner_b],
                    fill_mode=rr.components.FillMode.Solid,
                ),
            )

    def _send_solids(self, clock: Clock, packing_f: Sequence[Packing], drawing_f: Sequence[drawing.Drawing]) -> None:
        """Send places and orientations of superellipsoids in several frames."""
        for k, one in enumerate(self.solids):
            mine = one.particle_k
            turned = np.concatenate([packing.shapes.orientation_nq[mine] for packing in packing_f])
            poses = rr.InstancePoses3D.columns(
                translations=np.concatenate([drawn.center_nd[mine] for drawn in drawing_f]),
                quaternions=np.roll(turned, -1, axis=1),
            )
            self.send(clock, f"world/particles/{k}", poses, [len(mine)] * len(packing_f))

    def _send_particles(self, clock: Clock, packing_f: Sequence[Packing], drawing_f: Sequence[drawing.Drawing]) -> None:
        """Send the particles of several frames, and in a plane their periodic copies."""
        if self.solids:
            self._send_solids(clock, packing_f, drawing_f)
            return
        pairs = list(zip(packing_f, drawing_f, strict=True))
        inner = [drawing.sites_of(packing, drawn.center_nd) for packing, drawn in pairs]
        place = np.concatenate([one.place_bd for one in inner])
        if self.sites.round:
            columns: Any = self.points.columns(positions=place)
        elif self.flat:
            columns = rr.LineStrips2D.columns(
                strips=[line for one in inner for line in one.outlines()],
                colors=np.concatenate([self.color_nc[one.owner_b] for one in inner]),
            )
        else:
            turned = np.concatenate([drawing.orientations(one.axis_bd) for one in inner])
            columns = rr.Ellipsoids3D.columns(centers=place, quaternions=turned)
        self.send(clock, "world/particles", columns, [len(one.owner_b) for one in inner])
        if not self.flat:
            return
        outer = [drawing.sites_of(packing, drawn.copy_center_kd, drawn.copy_of_k) for packing, drawn in pairs]
        colors = drawing.dimmed(self.color_nc[np.concatenate([one.owner_b for one in outer])])
        if self.sites.round:
            columns = self.points.columns(
                positions=np.concatenate([one.place_bd for one in outer]),
                radii=np.concatenate([one.along_b for one in outer]),
                colors=colors,
            )
        else:
            columns = rr.LineStrips2D.columns(
                strips=[line for one in outer for line in one.outlines()],
                colors=colors,
                radii=np.full(len(colors), SHAPE_RIM * self.packing.reference_diameter),
            )
        self.send(clock, "world/particles/copies", columns, [len(one.owner_b) for one in outer])

    def send(self, clock: Clock, path: str, columns: Any, sizes: Sequence[int]) -> None:
        """Send columns of several frames, so many rows of each."""
        self.stream.send_columns(path, clock, columns.partition(sizes))

    def send_lines(self, clock: Clock, path: str, line_f: Sequence[Any], **fields: Any) -> None:
        """Send the lines of several frames, with further fields of all of them one after the other."""
        lines = [line for lines in line_f for line in lines]
        self.send(clock, f"world/{path}", self.strips.columns(strips=lines, **fields), [len(one) for one in line_f])

    def send_packings(self, clock: Clock, packing_f: Sequence[Packing], drawing_f: Sequence[drawing.Drawing]) -> None:
        """Send particles, periodic copies, links and box of several frames, and their exact arrays."""
        self._send_particles(clock, packing_f, drawing_f)
        for entity, name in TURNING[type(self.packing.shapes)].items():
            self.send_state(clock, entity, name, [one.shapes.orientation_nq for one in packing_f])
        self.send_lines(clock, "box", [one.outline_ed for one in drawing_f])
        if len(self.packing.links):
            self._send_links(clock, packing_f, drawing_f)
        self.send_state(clock, "position", "position_nd", [one.position_nd for one in packing_f])
        self.send_state(clock, "lattice", "lattice_dd", [one.box.lattice_dd for one in packing_f])

    def _send_links(self, clock: Clock, packing_f: Sequence[Packing], drawing_f: Sequence[drawing.Drawing]) -> None:
        """Send the lines of the links, bonds and shapes apart, and the images that the exact positions have them at."""
        d, diameter = self.packing.dimension, self.packing.reference_diameter
        if d == 3:
            beads = rr.Points3D.columns(positions=np.concatenate([one.center_nd for one in drawing_f]))
            self.send(clock, "world/links/beads", beads, [len(one.center_nd) for one in drawing_f])
        for path, name, shape in (("bonds", "bond", False), ("shapes", "shape", True)):
            tension_s = np.concatenate([getattr(one, f"{name}_tension_s") for one in drawing_f])
            self.send_lines(
                clock,
                f"links/{path}",
                [getattr(one, f"{name}_sed") for one in drawing_f],
                radii=drawing.tension_radii(tension_s, diameter, d, shape=shape),
                colors=drawing.tension_colors(tension_s, shape=shape),
            )
        self.send_state(clock, "link_image", "image_ld", [packing.links.image_ld for packing in packing_f])

    def send_state(self, clock: Clock, path: str, name: str, array_f: Sequence[NDArray[Any]]) -> None:
        """Send an exact array of several frames."""
        flat: Any = {name: np.concatenate([one.ravel() for one in array_f])}
        self.send(clock, f"state/{path}", rr.AnyValues.columns(**flat), [one.size for one in array_f])


def blueprint(
    trajectory: Trajectory, motions: Sequence[DrawnMode] = (), *, summary: bool, clusters: bool = False
) -> rrb.Blueprint:
    """Return how a recording opens: the packing large, modes, loop and results beside it, then the curves.

    Only panels that have something to show are there.
    """
    flat, linked = trajectory.final.dimension == 2, len(trajectory.final.links) > 0
    particles = ["/world/particles/**"]
    pictures: Views
    # in space lines inside solid spheres are not seen, so they have views of their own
    if trajectory.in_motion:
        bodies, lines = [*particles, "/world/walls/**"], ["/world/bonds/**", "/world/contacts/**"]
        lines += ["/world/links/**"] if linked else []
        if flat:
            pictures = [world_view(trajectory, "packing", [*bodies, *lines, "/world/marks/**"])]
        else:
            pictures = [
                world_view(trajectory, "packing", bodies),
                world_view(trajectory, "bonds and contacts", lines),
            ]
    else:
        forces, links = ["/world/forces/**"], ["/world/links/**"] if linked else []
        if flat:
            pictures = [world_view(trajectory, "packing", [*particles, *forces, *links])]
        else:
            pictures = [world_view(trajectory, "packing", particles), world_view(trajectory, "contact forces", forces)]
            if linked:
                pictures = [pictures[0], rrb.Horizontal(world_view(trajectory, "links", links), pictures[1])]
    middle: Views = []
    if clusters:
        middle.append(world_view(trajectory, "rigid clusters", ["/world/clusters/**"]))
    if motions:
        shown = ["/world/particles"] if flat else []
        views = [world_view(trajectory, motion.title, [*shown, f"/world/modes/{motion.name}/**"]) for motion in motions]
        middle.append(rrb.Tabs(*views, active_tab=0, name="lowest modes"))
    if len(trajectory.strain_t) > 1:
        across, up = (float(np.abs(part).max()) for part in (trajectory.strain_t, trajectory.stress_t))
        middle.append(
            rrb.Spatial2DView(
                origin="/",
                contents=["/loop/**"],
                name=f"stress (up, to {up:.3g}) against strain (across, to {across:.3g})",
                visual_bounds=rrb.VisualBounds2D(x_range=[-1.25, 1.25], y_range=[-1.25, 1.25]),
                background=drawing.BACKGROUND,
            )
        )
    if summary:
        middle.append(rrb.TextDocumentView(origin="/summary", name="results"))
    columns: list[tuple[rrb.Container, float]] = [(rrb.Vertical(*pictures), 5.0)]
    if middle:
        columns.append((rrb.Vertical(*middle), 3.0))
    plotted = plots(trajectory)
    if len(plotted) > COLUMN_PLOTS:
        columns.append((rrb.Grid(*plotted, grid_columns=2), 3.6))
    elif plotted:
        columns.append((rrb.Vertical(*plotted), 2.4))
    return page(trajectory, columns)


def page(trajectory: Trajectory, columns: Sequence[tuple[rrb.Container, float]]) -> rrb.Blueprint:
    """Return the layout of columns of these widths, played in a few seconds."""
    steps = float(trajectory.step_f[-1] - trajectory.step_f[0])
    return rrb.Blueprint(
        rrb.Horizontal(*(column for column, _ in columns), column_shares=[share for _, share in columns]),
        rrb.TimePanel(timeline="step", state="collapsed", fps=max(steps / PLAY_SECONDS, 1.0), loop_mode="off"),
        collapse_panels=True,
    )


def plots(trajectory: Trajectory) -> Views:
    """Return one plot for each curve; curves of a single point say nothing that the results do not."""
    first, last = int(trajectory.step_f[0]), int(trajectory.step_f[-1])
    edge = max(1, round(MARGIN * (last - first)))  # a last fall in one step should be seen
    every_step = rr.TimeRange(
        rr.TimeRangeBoundary.absolute(seq=first - edge), rr.TimeRangeBoundary.absolute(seq=last + edge)
    )
    return [
        rrb.TimeSeriesView(
            origin=f"/series/{name.replace(' ', '_')}",
            name=name,
            plot_legend=rrb.PlotLegend(visible=False),
            axis_x=rrb.TimeAxis(view_range=every_step),
        )
        for name, (step_t, _) in trajectory.curves.items()
        if len(step_t) > 1
    ]


def world_view(trajectory: Trajectory, name: str, shown: Sequence[str]) -> rrb.View:
    """Return a view of the box and of what is shown, wide enough for the packings of the later half.

    A packing that is compressed from far away would otherwise end as a spot in a corner.
    """
    contents = ["/world/box/**", *shown]
    packing_f, final = trajectory.packing_f, trajectory.final
    corner_kd = np.concatenate(
        [np.concatenate(drawing.box_outline(one.box)) for one in packing_f[len(packing_f) // 2 :]]
    )
    low, high = corner_kd.min(axis=0), corner_kd.max(axis=0)
    if final.dimension == 2:
        extent = float(np.max(high - low))
        # links across the edge end in a center outside
        beyond = min(float(final.links.length_l.max(initial=0.0)), 0.1 * extent)
        pad = MARGIN * extent + float(final.radius_n.max()) + beyond
        # 2D views point down; /world is mirrored, and so are these bounds
        bounds = rrb.VisualBounds2D(x_range=[low[0] - pad, high[0] + pad], y_range=[-high[1] - pad, -low[1] + pad])
        return rrb.Spatial2DView(
            origin="/", contents=contents, name=name, visual_bounds=bounds, background=drawing.BACKGROUND
        )
    center = 0.5 * (low + high)
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name=name,
        background=drawing.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=center + float(np.linalg.norm(high - low)) * np.array(drawing.VIEW),
            look_target=center,
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


# bytes of raw columns in one block: larger ones cost memory and are slower to write
BLOCK_BYTES = 2_000_000
# frames of a packing in motion in one block, for about this many numbers
BLOCK_NUMBERS = 250_000
# the present place on the curve of stress against strain
NOW = (255, 96, 96)


@shown_as("recording")
def record_packing(
    subject: Packing | Scene,
    path: str | Path,
    *,
    modes: Any = None,
    mode_count: int = 4,
    clusters: RigidClusters | None = None,
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
    clusters
        Rigid clusters of the packing (`pm.rigid_clusters`): contacts and links in their colors, wide where these are
        over-constrained, in a view of their own.
    parameters, results
        How the packing was made and what was found, by name; kept as the recording's properties.
    summary
        Markdown shown beside the packing.

    Raises
    ------
    TypeError, ValueError
        For a subject that is neither packing nor scene, modes or clusters of another packing, a negative mode_count.
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
    if clusters is not None:
        instance("clusters", clusters, RigidClusters)
        own, other = trajectory.final, clusters.packing
        if own.position_nd.shape != other.position_nd.shape or not np.array_equal(own.position_nd, other.position_nd):
            raise ValueError(f"clusters must be those of the packing, {own!r:.60}, got those of {other!r:.60}")
    return _write(trajectory, path, motions, parameters, found, summary, clusters)


@shown_as("recording")
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
    frames = integer("frames", frames, at_least=2, bytes_each=FRAME_BYTES)
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
    motions: list[DrawnMode] = []
    if not trajectory.in_motion:
        found.setdefault("pressure", pressure(final))
        motions = _motions(modes, trajectory, _stiffness(final), mode_count)
    return _write(trajectory, path, motions, parameters, {**trajectory.moduli, **found}, summary)


def _stiffness(scene: Scene) -> float:
    return scene.energy_scale / scene.packing.reference_diameter**2


def _motions(modes: Any, trajectory: Trajectory, stiffness: float, mode_count: int) -> list[DrawnMode]:
    mode_count = integer("mode_count", mode_count, at_least=0)
    return [] if modes is None else motions_of(modes, trajectory.final, stiffness, mode_count)


def _write(
    trajectory: Trajectory,
    path: str | Path,
    motions: list[DrawnMode],
    parameters: Mapping[str, Any] | None,
    results: Mapping[str, Any],
    summary: str,
    clusters: RigidClusters | None = None,
) -> Path:
    layout = blueprint(trajectory, motions, summary=bool(summary), clusters=clusters is not None)
    with opened(path, layout, trajectory, parameters, results) as (stream, target):
        world = World(stream, trajectory.final, trajectory.colors())
        if trajectory.in_motion:
            log_moving(world, summary)
            log_loop(stream, trajectory)
            size = max(1, BLOCK_NUMBERS // (world.packing.particles * world.packing.dimension * 12))
            for first in range(0, len(trajectory.frames), size):
                send_moving(world, trajectory.effects, trajectory.frames[first : first + size])
        else:
            log_resting(world, motions, summary)
            log_motions(world, motions, int(trajectory.step_f[-1]))
            if clusters is not None:
                _log_clusters(world, clusters)
            # positions in doubles and floats, copies, and about 2 d lines of two ends a particle with width and color
            d = world.packing.dimension
            size = max(1, BLOCK_BYTES // (world.packing.particles * d * (8 + 4 + 2 * 2 * 4 * d)))
            for first in range(0, len(trajectory.frames), size):
                send_resting(world, trajectory.effects, trajectory.frames[first : first + size])
    return target


def log_resting(world: World, motions: Sequence[DrawnMode] = (), summary: str = "") -> None:
    """Log what does not change of a packing with contact forces and links."""
    arrows = [f"modes/{motion.name}" for motion in motions]
    order = {"forces": 40.0, **dict.fromkeys(arrows, 50.0), **_link_order(world)}
    world.log_static(order, {"box": (drawing.OUTLINE_RADIUS, drawing.OUTLINE)}, arrows, summary)
    _log_links(world)


def _link_order(world: World) -> dict[str, float]:
    return {"links/shapes": 44.0, "links/bonds": 46.0} if len(world.packing.links) else {}


def _log_links(world: World) -> None:
    """Log what does not change of links."""
    packing, links = world.packing, world.packing.links
    if len(links):
        if not world.flat:  # spheres at full size would hide their links
            beads = world.points.from_fields(radii=drawing.BEAD * packing.radius_n, colors=world.color_nc)
            world.stream.log("world/links/beads", beads, static=True)
        pairs = rr.AnyValues(i_l=links.i_l, j_l=links.j_l, length_l=links.length_l, shape_l=links.shape_l)
        world.stream.log("state/links", pairs, static=True)


def _log_clusters(world: World, clusters: RigidClusters) -> None:
    """Log contacts and links in the colors of their rigid clusters."""
    lines = drawing.cluster_lines(clusters)
    radii = world.packing.reference_diameter * lines.width_s
    world.stream.log("world/clusters", world.strips(lines.segment_sed, colors=lines.color_sc, radii=radii), static=True)
    numbers = rr.AnyValues(cluster_c=clusters.cluster_c, overconstrained_c=clusters.overconstrained_c)
    world.stream.log("state/clusters", numbers, static=True)


def log_motions(world: World, motions: Sequence[DrawnMode], step: int) -> None:
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


def send_resting(world: World, effects: tuple[Any, ...], frames: Sequence[PackingFrame]) -> None:
    """Send packings with their contact forces and links as columns."""
    packing_f = [one.packing for one in frames]
    drawing_f = [drawing.draw_packing(packing, effects) for packing in packing_f]
    clock = [rr.TimeColumn("step", sequence=[one.step for one in frames])]
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

    The places are those of the frames, or at the steps step_t, one for each point of the curve.
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


def send_moving(world: World, effects: tuple[Any, ...], frames: Sequence[PackingFrame]) -> None:
    """Send packings in motion as columns."""
    drawn_f = [draw_moving(one, effects) for one in frames]
    d, unit = world.packing.dimension, world.packing.reference_diameter
    clock = [
        rr.TimeColumn("step", sequence=[one.step for one in frames]),
        rr.TimeColumn("time", duration=[one.time for one in frames]),
    ]
    world.send_packings(clock, [one.packing for one in frames], [one.drawing for one in drawn_f])
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


# contacts that touch as at the start, those that have opened (by WIDE contact distances or more), those that have
# closed on the way
STAYED, JUST_OPEN, OPENED, CLOSED = (255, 236, 170), (244, 170, 104), (226, 70, 70), (110, 226, 150)
WIDE = 0.2
# half widths of their lines [reference diameter]
STAYED_WIDTH, OPENED_WIDTH = 0.024, 0.014
TRAIL, TRAIL_WIDTH = (170, 196, 226), 0.015
GHOST = (78, 88, 104)
# contacts that have opened wider than this are not drawn any more [1]
FAR = 0.6
ARROW, ARROW_LENGTH, ARROW_WIDTH = (84, 222, 232), 0.6, 0.035


@shown_as("recording")
def record_motion(
    played: PlayedMotion,
    path: str | Path,
    *,
    frames: int = 60,
    parameters: Mapping[str, Any] | None = None,
    results: Mapping[str, Any] | None = None,
) -> Path:
    """Write a played motion as a Rerun recording and return the absolute path.

    Contacts that still touch are pale lines, those that have opened thin ones from orange to red, and those that closed
    on the way green. Thin lines lead back to where the particles were; arrows show where they move. The box at the
    start stays in dark gray.

    Parameters
    ----------
    played
        What `pm.play_motion` returned.
    path
        Where to write, usually `name.rrd`.
    frames
        Largest number of packings to draw, evenly chosen, first and last included.
    parameters, results
        How the packing was made and what was found, by name; kept as the recording's properties.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind.
    OSError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> kagome = pm.lattice_packing("kagome", repeats=(2, 2))
    >>> played = pm.play_motion(kagome, pm.classify_jamming(kagome).unjamming_motion, steps=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = record_motion(played, folder + "/kagome.rrd")
    ...     written.stat().st_size > 1000
    True

    """
    instance("played", played, PlayedMotion)
    frames = integer("frames", frames, at_least=2, bytes_each=FRAME_BYTES)
    check_arguments(path, parameters, results)
    chosen = np.unique(np.rint(np.linspace(0, played.steps, min(frames, played.steps + 1))).astype(int))
    shown = tuple(PackingFrame(int(t), float(t), played.packing_t[t]) for t in chosen)
    trajectory = Trajectory(shown, (), _motion_curves(played))
    found = {**played.to_dict(), **(results or {})}
    with opened(path, _motion_layout(trajectory), trajectory, parameters, found) as (stream, target):
        # no particle is marked as a rattler, since the motion may free them all
        world = World(stream, played.packing_t[0], drawing.particle_colors(played.packing_t[0]))
        _log_motion(world, _motion_in_words(played))
        _send_motion(world, trajectory, _draw_motion(played, chosen))
    return target


def _motion_curves(played: PlayedMotion) -> dict[str, Curve]:
    """Return what to plot against the step; what never changes is left to the results."""
    step_t = np.arange(played.steps + 1)
    diameter = played.packing.reference_diameter
    curves: dict[str, Curve] = {"contacts that stayed": (step_t, played.stayed_t.astype(float))}
    if len(played.contacts):
        curves["widest gap"] = (step_t, played.gap_tc.max(axis=1) / diameter)
    fraction_t = played.packing_fraction_t
    if np.ptp(fraction_t) > 1e-4:
        curves["packing fraction"] = (step_t, fraction_t)
    curves["amplitude"] = (step_t, played.amplitude_t)
    return curves


def _motion_in_words(played: PlayedMotion) -> str:
    """Return the results as the recording's text."""
    before, after = played.packing_fraction_t[[0, -1]]
    return (
        f"# {played.outcome}\n\n{played.reason[0].upper() + played.reason[1:]}.\n\n"
        f"| | |\n|---|---|\n"
        f"| amplitude | {played.amplitude:.3g} diameters in {played.steps} steps |\n"
        f"| contacts at the start | {len(played.contacts)} |\n"
        f"| of them still touch | {played.stayed_t[-1]} |\n"
        f"| of them have opened | {played.opened_t[-1]} |\n"
        f"| contacts at the end | {played.contacts_t[-1]} |\n"
        f"| largest closing | {played.residual:.1e} |\n"
        f"| packing fraction | {before:.6f} to {after:.6f} |\n\n"
        "Pale lines: contacts that stay. Orange to red: contacts that have opened. Green: pairs that have met. Arrows: "
        "where particles go; thin lines behind them: where they came from. Dark gray: the box at the start.\n"
    )


@dataclass(frozen=True, eq=False)
class _DrawnMotion:
    """Lines of one frame by kind, the particles, trails and arrows."""

    drawing: drawing.Drawing
    stayed_sed: NDArray[np.float64]
    opened_sed: NDArray[np.float64]
    opened_color_sc: NDArray[np.uint8]
    closed_sed: NDArray[np.float64]
    trail_ned: NDArray[np.float64]
    arrow_nd: NDArray[np.float64]


def _draw_motion(played: PlayedMotion, chosen: NDArray[np.int64]) -> list[_DrawnMotion]:
    start = played.packing_t[0]
    first = played.displacement_tnd[0] + start.position_nd @ played.strain_tdd[0]
    scale = ARROW_LENGTH / 1.5 * drawing.arrow_scale(first, start.reference_diameter)
    known = set(pair_names(played.contacts))
    found = []
    for t in chosen:
        packing = played.packing_t[t]
        _, image_nd = packing.box.wrap(packing.position_nd)
        now = pair_contacts(packing, played.contacts.i_c, played.contacts.j_c, played.contacts.image_cd)
        stayed = played.stayed_tc[t]
        near = now.gap_c < FAR * now.contact_distance_c
        touching = find_contacts(packing, gap_tolerance=played.gap_tolerance)
        new = np.array([pair not in known for pair in pair_names(touching)], dtype=bool)
        picture = drawing.draw_packing(packing)
        open_sed, of_s = _unwrapped_lines(packing, now.select(~stayed & near), image_nd)
        share_s = np.clip(-now.overlap_c[~stayed & near][of_s] / WIDE, 0.0, 1.0)
        arrow = scale * (played.displacement_tnd[t] + packing.position_nd @ played.strain_tdd[t])
        way = packing.position_nd - start.position_nd
        found.append(
            _DrawnMotion(
                picture,
                _unwrapped_lines(packing, now.select(stayed), image_nd)[0],
                open_sed,
                drawing.between(JUST_OPEN, OPENED, share_s),
                _unwrapped_lines(packing, touching.select(new), image_nd)[0],
                np.stack([picture.center_nd - way, picture.center_nd], axis=1),
                arrow,
            )
        )
    return found


def _unwrapped_lines(
    packing: Packing, pairs: Contacts, image_nd: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return lines between wrapped centers and whose they are; image_nd are the cells that the centers were in."""
    inside = packing.position_nd - image_nd @ packing.box.lattice_dd.T
    image_cd = pairs.image_cd + image_nd[pairs.j_c] - image_nd[pairs.i_c]
    return drawing.pair_lines(inside, pairs.i_c, pairs.j_c, image_cd, pairs.vector_cd)


def _motion_layout(trajectory: Trajectory) -> rrb.Blueprint:
    lines = ["/world/contacts/**", "/world/motion/**", "/world/trails/**", "/world/start/**", "/world/links/**"]
    particles = ["/world/particles/**"]
    if trajectory.final.dimension == 2:
        views = [world_view(trajectory, "motion", [*particles, *lines])]
    else:  # lines inside solid spheres are not seen
        views = [world_view(trajectory, "particles", particles), world_view(trajectory, "motion", lines)]
    beside: Views = [rrb.TextDocumentView(origin="/summary", name="results"), *plots(trajectory)]
    shares = [0.6 + 0.7 * len(beside)] + [1.0] * (len(beside) - 1)
    return page(trajectory, [(rrb.Vertical(*views), 5), (rrb.Vertical(*beside, row_shares=shares), 3)])


def _log_motion(world: World, summary: str) -> None:
    order = {"trails": 36.0, "contacts/opened": 40.0, "contacts/stayed": 42.0, "contacts/closed": 43.0}
    order |= {"links/shapes": 44.0, "links/bonds": 46.0, "motion": 50.0, "start": 58.0}
    lines: dict[str, tuple[float | None, Any]] = {
        "motion": (ARROW_WIDTH, ARROW),
        "contacts/stayed": (STAYED_WIDTH, STAYED),
        "contacts/closed": (STAYED_WIDTH, CLOSED),
        "trails": (TRAIL_WIDTH, TRAIL),
        "start": (0.5 * drawing.OUTLINE_RADIUS, GHOST),
        "box": (0.7 * drawing.OUTLINE_RADIUS, drawing.OUTLINE),
        # its colors change, and what is static would hide them
        "contacts/opened": (OPENED_WIDTH, None),
    }
    world.log_static(order, lines, ["motion"], summary)
    start = world.strips.from_fields(strips=drawing.box_outline(world.packing.box))
    world.stream.log("world/start", start, static=True)


def _send_motion(world: World, trajectory: Trajectory, drawn_f: list[_DrawnMotion]) -> None:
    clock = [rr.TimeColumn("step", sequence=trajectory.step_f)]
    drawing_f = [one.drawing for one in drawn_f]
    world.send_packings(clock, trajectory.packing_f, drawing_f)
    world.send_lines(clock, "contacts/stayed", [one.stayed_sed for one in drawn_f])
    world.send_lines(clock, "contacts/closed", [one.closed_sed for one in drawn_f])
    world.send_lines(clock, "trails", [one.trail_ned for one in drawn_f])
    color_sc = np.concatenate([one.opened_color_sc for one in drawn_f])
    world.send_lines(clock, "contacts/opened", [one.opened_sed for one in drawn_f])
    opened_f = [len(one.opened_sed) for one in drawn_f]
    world.send(clock, "world/contacts/opened", world.strips.columns(colors=color_sc), opened_f)
    vectors = np.concatenate([one.arrow_nd for one in drawn_f])
    centers = np.concatenate([one.center_nd for one in drawing_f])
    count_f = [len(one.center_nd) for one in drawing_f]
    world.send(clock, "world/motion", world.arrows.columns(origins=centers, vectors=vectors), count_f)
