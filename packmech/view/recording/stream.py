"""What all recordings share: how they are opened and laid out, their properties and curves, and the packing in them."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from packmech.check import table
from packmech.files.records import is_record, to_table
from packmech.packing import Packing
from packmech.view import drawing
from packmech.view.trajectory import Curve, Motion, Trajectory

PLAY_SECONDS = 6.0
MARGIN = 0.04
# plots that stand in one column
COLUMN_PLOTS = 8

Views = list[rrb.Container | rrb.View]
Clock = list[rr.TimeColumn]


def check_arguments(path: Any, parameters: Any, results: Any) -> None:
    """Check where to write, and that parameters and results come by name."""
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file name, got {path!r}")
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
    """Open a recording, write its properties and curves, and give the stream and the absolute path."""
    target = Path(path).absolute()
    target.parent.mkdir(parents=True, exist_ok=True)
    with target.open("ab"):  # the writer only logs a file that it cannot open
        pass
    stream = rr.RecordingStream("packmech")
    try:
        stream.save(target, default_blueprint=layout)
        stream.send_recording_name(target.stem)
        properties = properties_of(trajectory.final, trajectory.effects, parameters or {}, results)
        stream.send_property("packmech", property_values(properties))
        send_curves(stream, trajectory.curves)
        yield stream, target
    finally:
        stream.flush()
        stream.disconnect()


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
                kind = rr.Points2D if name.startswith("particles") else kind
                stream.log(f"world/{name}", kind.from_fields(draw_order=place), static=True)
        else:
            stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log(
            "world/particles", self.points.from_fields(radii=packing.radius_n, colors=self.color_nc), static=True
        )
        for name, (width, color) in lines.items():
            kind = self.arrows if name in arrows else self.strips
            radii = None if width is None else width * packing.reference_diameter
            stream.log(f"world/{name}", kind.from_fields(radii=radii, colors=color), static=True)
        stream.log("state/radius", rr.AnyValues(radius_n=packing.radius_n), static=True)
        if summary:
            stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)

    def send(self, clock: Clock, path: str, columns: Any, sizes: Sequence[int]) -> None:
        """Send columns of several frames, so many rows of each."""
        self.stream.send_columns(path, clock, columns.partition(sizes))

    def send_lines(self, clock: Clock, path: str, line_f: Sequence[Any], **fields: Any) -> None:
        """Send the lines of several frames, with further fields of all of them one after the other."""
        lines = [line for lines in line_f for line in lines]
        self.send(clock, f"world/{path}", self.strips.columns(strips=lines, **fields), [len(one) for one in line_f])

    def send_packings(self, clock: Clock, packing_f: Sequence[Packing], drawing_f: Sequence[drawing.Drawing]) -> None:
        """Send particles, periodic copies, links and box of several frames, and their exact arrays."""
        center_f, owner_f = [one.center_nd for one in drawing_f], [one.copy_of_k for one in drawing_f]
        centers, owner_k = np.concatenate(center_f), np.concatenate(owner_f)
        count_f = [len(one) for one in center_f]
        self.send(clock, "world/particles", self.points.columns(positions=centers), count_f)
        if self.flat:
            copies = self.points.columns(
                positions=np.concatenate([one.copy_center_kd for one in drawing_f]),
                radii=self.packing.radius_n[owner_k],
                colors=drawing.dimmed(self.color_nc[owner_k]),
            )
            self.send(clock, "world/particles/copies", copies, [len(one) for one in owner_f])
        self.send_lines(clock, "box", [one.outline_ed for one in drawing_f])
        if self.packing.links is not None:
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
        images = [packing.links.image_ld for packing in packing_f if packing.links is not None]
        self.send_state(clock, "link_image", "image_ld", images)

    def send_state(self, clock: Clock, path: str, name: str, array_f: Sequence[NDArray[Any]]) -> None:
        """Send an exact array of several frames."""
        flat: Any = {name: np.concatenate([one.ravel() for one in array_f])}
        self.send(clock, f"state/{path}", rr.AnyValues.columns(**flat), [one.size for one in array_f])


def blueprint(trajectory: Trajectory, motions: Sequence[Motion] = (), *, summary: bool) -> rrb.Blueprint:
    """Return how a recording opens: the packing large, modes, loop and results beside it, then the curves.

    Only panels that have something to show are there.
    """
    flat, linked = trajectory.final.dimension == 2, trajectory.final.links is not None
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
                name=f"stress (up, whole {up:.3g}) against strain (across, whole {across:.3g})",
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
    whole = rr.TimeRange(
        rr.TimeRangeBoundary.absolute(seq=first - edge), rr.TimeRangeBoundary.absolute(seq=last + edge)
    )
    return [
        rrb.TimeSeriesView(
            origin=f"/series/{name.replace(' ', '_')}",
            name=name,
            plot_legend=rrb.PlotLegend(visible=False),
            axis_x=rrb.TimeAxis(view_range=whole),
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
        pad = MARGIN * extent + float(final.radius_n.max())
        if final.links is not None:  # bonds across the edge end in a center outside
            pad += min(float(final.links.length_l.max()), 0.1 * extent)
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
