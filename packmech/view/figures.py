"""All that is imported of matplotlib and the one style of figures; pictures of runs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from packmech.calls.status import shown_as
from packmech.check import FRAME_BYTES, instance, integer, one_of
from packmech.files.paths import file_name, made_folder
from packmech.packing import Packing
from packmech.result import Run
from packmech.scene import Scene
from packmech.view import drawing
from packmech.view.trajectory import Curve, DrawnFrame, PackingFrame, Trajectory, draw_moving, trajectory_of_run

# eight colors and shapes that stay apart for color-blind readers and in gray (Okabe and Ito)
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#8C6D31")
MARKERS = "osD^vP*X"
STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "legend.frameon": False,
    "svg.hashsalt": "packmech",
}


# of pictures of runs: inches and dots an inch; the packing takes the left part
SIZE, DOTS = (9.6, 6.4), 100
FORMATS = ("png", "svg")
PLOTS = ("strain", "stress", "pressure", "log10 energy")
PAPER, INK, NOW = "#0d111a", "#c8d0dc", "#ff6060"
# in space what lies at the back is dimmed to this part
DIM = 0.35


@cache
def matplotlib_parts() -> SimpleNamespace:
    """Return what is used of matplotlib, which takes long to import: not before the first figure is drawn."""
    import matplotlib
    from matplotlib import cm, collections, colors, figure, lines, ticker
    from matplotlib.backends import backend_agg
    from PIL import Image

    return SimpleNamespace(
        rc_context=matplotlib.rc_context,
        Figure=figure.Figure,
        FigureCanvasAgg=backend_agg.FigureCanvasAgg,
        EllipseCollection=collections.EllipseCollection,
        LineCollection=collections.LineCollection,
        PolyCollection=collections.PolyCollection,
        Normalize=colors.Normalize,
        ScalarMappable=cm.ScalarMappable,
        Line2D=lines.Line2D,
        NullFormatter=ticker.NullFormatter,
        Image=Image,
        colormaps=matplotlib.colormaps,
        to_rgb=colors.to_rgb,
    )


def new_axes(size: tuple[float, float]) -> Any:
    """Return the axes of a new figure of pyplot of this size [inch], which notebooks show, in the one style."""
    from matplotlib import pyplot

    with matplotlib_parts().rc_context(STYLE):
        return pyplot.subplots(figsize=size, layout="constrained")[1]


@contextmanager
def styled_figure(path: Path, size: tuple[float, float]) -> Iterator[Any]:
    """Give a figure of this size [inch] in the one style, and write it to the path at the end."""
    with matplotlib_parts().rc_context(STYLE):
        figure = matplotlib_parts().Figure(figsize=size, layout="constrained")
        yield figure
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)


def label_settings(axes: Any, settings: Sequence[float]) -> None:
    """Write these settings along the x axis in plain numbers, and nothing between them."""
    axes.set_xticks(settings, [f"{one:g}" for one in settings], minor=False)
    axes.xaxis.set_minor_formatter(matplotlib_parts().NullFormatter())


def hollow_marker() -> Any:
    """Return the marker of the legend that stands for hollow points."""
    return matplotlib_parts().Line2D([], [], color="#666666", marker="o", markerfacecolor="none", linestyle="none")


@shown_as("pictures")
def write_pictures(
    run: Run, folder: str | os.PathLike[str], *, scene: Scene, frames: int = 200, format: str = "png"
) -> tuple[Path, ...]:
    """Return the files of evenly spaced pictures of a run, written to a folder; no display is needed.

    Each shows the packing with its contacts (those that slide in blue), bonds (green in tension, violet in
    compression), marks that turn with the particles, walls and box, and beside it stress against strain and the figures
    against step.

    Parameters
    ----------
    run
        The run, with positions kept on the way (trace_positions, or frames); otherwise its start and its end are shown.
    folder
        Where to write frame-0000.png and so on; made if need be. Files of these names are replaced.
    scene
        The scene that was run.
    frames
        Largest number of pictures.
    format
        "png" or "svg".

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.
    OSError
        When a file cannot be written.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> packing = pm.random_packing(16, dimension=2, packing_fraction=0.8, seed=3)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),))
    >>> run = pm.quench(scene, force_tolerance=1e-6)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = write_pictures(run, folder, scene=scene, frames=2)
    ...     [path.name for path in written]
    ['frame-0000.png', 'frame-0001.png']

    """
    instance("run", run, Run)
    instance("scene", scene, Scene)
    frames = integer("frames", frames, at_least=2, bytes_each=FRAME_BYTES)
    one_of("format", format, FORMATS)
    file_name("folder", folder, "a folder's name")
    if run.packing.particles != scene.packing.particles:
        raise ValueError(f"scene must have the run's {run.packing.particles} particles, got {scene.packing.particles}")
    trajectory = trajectory_of_run(run, scene, frames)
    target = made_folder("folder", folder)
    picture = _RunPicture(trajectory)
    return tuple(
        picture.write(frame, target / f"frame-{k:04d}.{format}", format) for k, frame in enumerate(trajectory.frames)
    )


def outlined(axes: Any, outlines: drawing.Outlines, **style: Any) -> Any:
    """Return the collection that draws outlines on axes: ellipses, or polygons where they are none."""
    parts, place = matplotlib_parts(), outlines.place_ks[:, :2]
    if outlines.corner_kcs is not None:
        return parts.PolyCollection(place[:, None] + outlines.corner_kcs, **style)
    ellipses = outlines.width_k, outlines.height_k, outlines.angle_k
    return parts.EllipseCollection(*ellipses, units="xy", offsets=place, transOffset=axes.transData, **style)


class _RunPicture:
    """One figure on which every frame is drawn in its turn: axes and curves stay, the packing changes."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory, self.packing = trajectory, trajectory.final
        # links are not drawn here, and their clusters have no colors of their own
        bare = self.packing.replace(links=None)
        self.color_nc = drawing.particle_colors(bare, trajectory.effects, None, trajectory.held_n) / 255.0
        self.flat = self.packing.dimension == 2
        self.figure = matplotlib_parts().Figure(figsize=SIZE, dpi=DOTS, facecolor=PAPER)
        self.canvas = matplotlib_parts().FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((0.01, 0.02, 0.64, 0.9), facecolor=PAPER)
        self.axes.set_axis_off()
        boxes = [drawing.shown_box(one.packing.box)[0] for one in trajectory.frames]
        corners = [drawing.box_outline(box) for box in boxes]
        place_kd = np.concatenate([drawing.projected(np.concatenate(lines))[:, :2] for lines in corners])
        pad = 2.2 * float(self.packing.shapes.reach(self.packing.radius_n).max())
        low, high = place_kd.min(axis=0) - pad, place_kd.max(axis=0) + pad
        self.axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        width, height = 0.64 * SIZE[0] * 72.0, 0.9 * SIZE[1] * 72.0
        # points of a line as wide as one unit of length
        self.points = float(min(width / (high[0] - low[0]), height / (high[1] - low[1])))
        self.title = self.figure.text(0.02, 0.955, "", color=INK, fontsize=11)
        self.dots: list[tuple[Any, Curve | None]] = []
        self.still: Any = None
        self._plots()

    def _plots(self) -> None:
        trajectory = self.trajectory
        looped = len(trajectory.strain_t) > 1
        names = [name for name in trajectory.curves if name.startswith(PLOTS) and len(trajectory.curves[name][0]) > 1]
        rows = names[: 3 if looped else 4]
        bottom, top = 0.08, 0.5 if looped else 0.92
        if looped:
            axes = self._plot(self.figure.add_axes((0.73, 0.58, 0.25, 0.34)))
            axes.plot(trajectory.strain_t, trajectory.stress_t, color="#7aaee6", lw=1.0)
            axes.set_title("stress against strain", color=INK, fontsize=8, loc="right")
            self.dots.append((axes.plot([], [], "o", color=NOW, ms=5)[0], None))
        height = (top - bottom) / max(1, len(rows))
        for k, name in enumerate(rows):
            axes = self._plot(self.figure.add_axes((0.73, top - (k + 1) * height + 0.035, 0.25, height - 0.065)))
            axes.plot(*trajectory.curves[name], color="#7aaee6", lw=1.0)
            axes.set_title(name, color=INK, fontsize=8, pad=2, loc="right")
            self.dots.append((axes.plot([], [], "o", color=NOW, ms=4)[0], trajectory.curves[name]))

    def _plot(self, axes: Any) -> Any:
        axes.set_facecolor(PAPER)
        axes.tick_params(colors=INK, labelsize=6)
        for spine in axes.spines.values():
            spine.set_color("#4a5260")
        # a power of ten of the numbers stands above them, at the left, where titles leave room
        for axis in (axes.xaxis, axes.yaxis):
            axis.get_offset_text().set(color=INK, fontsize=6)
        return axes

    def write(self, frame: PackingFrame, path: Path, format: str) -> Path:
        """Draw a frame and write it."""
        drawn = draw_moving(frame, self.trajectory.effects)
        artists = [*self._particles(drawn, frame.packing), *self._lines(drawn)]
        for artist in artists:
            self.axes.add_collection(artist)
        words = [f"step {frame.step}"] if frame.touching is None else [f"time {frame.time:.4g}"]
        for dot, curve in self.dots:
            if curve is None:
                strain = self._at(frame, "strain")
                stress = self._at(frame, "stress")
                dot.set_data([strain], [stress])
                words += [f"strain {strain:.4f}", f"stress {stress:.3g}"]
            else:
                dot.set_data([frame.step], [np.interp(frame.step, *curve)])
        self.title.set_text("    ".join(words))
        if format == "png":
            self._write_png(artists, path)
        else:
            self._write_svg(path)
        for artist in artists:
            artist.remove()
        return path

    def _write_png(self, artists: Sequence[Any], path: Path) -> None:
        """Write what stays as it was drawn once, and what moves over it."""
        moving = [*artists, *(dot for dot, _ in self.dots), self.title]
        if self.still is None:
            for artist in moving:
                artist.set_visible(False)
            self.canvas.draw()
            self.still = self.canvas.copy_from_bbox(self.figure.bbox)
        self.canvas.restore_region(self.still)
        for artist in sorted(artists, key=lambda one: float(one.get_zorder())):
            artist.set_visible(True)
            self.axes.draw_artist(artist)
        for dot, _ in self.dots:
            dot.set_visible(True)
            dot.axes.draw_artist(dot)
        self.title.set_visible(True)
        self.figure.draw_artist(self.title)
        matplotlib_parts().Image.fromarray(np.asarray(self.canvas.buffer_rgba())).convert("RGB").save(
            path, compress_level=4
        )

    def _write_svg(self, path: Path) -> None:
        # the same run writes the same file
        with matplotlib_parts().rc_context({"svg.hashsalt": STYLE["svg.hashsalt"]}):
            self.figure.savefig(path, format="svg", metadata={"Date": None})

    def _at(self, frame: PackingFrame, start: str) -> float:
        curve = next((curve for name, curve in self.trajectory.curves.items() if name.startswith(start)), None)
        return 0.0 if curve is None else float(np.interp(frame.step, *curve))

    def _particles(self, drawn: DrawnFrame, packing: Packing) -> list[Any]:
        """Return the particles as they are turned in this frame, and in a plane their periodic copies."""
        plain, every = drawn.drawing, np.arange(packing.particles)
        if self.flat:
            dim = drawing.dimmed((255.0 * self.color_nc).astype(np.uint8)) / 255.0
            outlines = drawing.seen_outlines(packing, plain.copy_center_kd, plain.copy_of_k)
            copies = self._ellipses(outlines, dim[outlines.owner_k], 1.0)
            outlines = drawing.seen_outlines(packing, plain.center_nd, every)
            return [copies, self._ellipses(outlines, self.color_nc[outlines.owner_k], 2.0)]
        outlines = drawing.seen_outlines(packing, plain.center_nd, every)
        order = np.argsort(outlines.place_ks[:, 2])
        outlines = outlines.taken(order)
        depth = outlines.place_ks[:, 2]
        share = DIM + (1.0 - DIM) * (depth - depth.min()) / (np.ptp(depth) or 1.0)
        return [self._ellipses(outlines, self.color_nc[outlines.owner_k] * share[:, None], 2.0)]

    def _ellipses(self, outlines: drawing.Outlines, color: Any, order: float) -> Any:
        return outlined(self.axes, outlines, facecolors=color, edgecolors=PAPER, linewidths=0.3, zorder=order)

    def _lines(self, drawn: DrawnFrame) -> list[Any]:
        unit, d = self.packing.reference_diameter, self.packing.dimension

        def lines(segments: Any, half_width: Any, color: Any, order: float) -> Any:
            flat = [drawing.projected(np.asarray(line))[:, :2] for line in segments]
            width = 2.0 * self.points * np.asarray(half_width)
            style = {"linewidths": width, "colors": color, "zorder": order, "capstyle": "round"}
            return matplotlib_parts().LineCollection(flat, **style)

        found = [
            lines(drawn.drawing.outline_ed, drawing.OUTLINE_RADIUS * unit, _rgb(drawing.OUTLINE), 6.0),
            lines(drawn.wall_ed, drawing.WALL_WIDTH * unit, _rgb(drawing.WALL), 5.0),
        ]
        if not self.flat:  # lines inside solid spheres are not seen
            return found
        force_s, slide_s = drawn.sticking_force_s, drawn.sliding_force_s
        pull = drawing.tension_colors(drawn.bond_pull_s, shape=False) / 255.0
        return [
            *found,
            lines(drawn.mark_ned, drawing.MARK_WIDTH * unit, _rgb(drawing.MARK), 3.0),
            lines(drawn.bond_sed, drawing.BOND_WIDTH * unit, pull, 3.5),
            lines(
                drawn.sticking_sed,
                drawing.force_radii(force_s, unit, d),
                drawing.force_colors(force_s) / 255.0,
                4.0,
            ),
            lines(drawn.sliding_sed, drawing.force_radii(slide_s, unit, d), _rgb(drawing.SLIDING), 4.5),
        ]


def _rgb(color: Sequence[int]) -> tuple[float, ...]:
    return tuple(part / 255.0 for part in color)
