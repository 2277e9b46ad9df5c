"""All that matplotlib draws: work-precision tables, costs, deviations, cementing curves, and pictures of runs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray
from PIL import Image

from packmech.check import instance, integer, one_of
from packmech.protocols.cementing_curve import CementingCurve
from packmech.result import Run
from packmech.scene import Scene
from packmech.view import drawing
from packmech.view.cementing import STIFF_SHARE
from packmech.view.trajectory import Curve, DrawnSnapshot, Snapshot, Trajectory, draw_snapshot, trajectory_of_run

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


class PrecisionTrial(Protocol):
    """One trial of a work-precision table."""

    @property
    def setting(self) -> float:
        """The setting that was tried."""

    @property
    def errors(self) -> Mapping[str, float]:
        """Errors by quantity."""

    @property
    def seconds(self) -> float:
        """CPU seconds."""

    @property
    def failed(self) -> str:
        """Why it failed, empty if it did not."""


class PrecisionTable(Protocol):
    """What is drawn of a work-precision table."""

    @property
    def title(self) -> str:
        """What was compared."""

    @property
    def knob(self) -> str:
        """What the setting is."""

    @property
    def reference_is(self) -> str:
        """What errors are relative to."""

    @property
    def quantities(self) -> Sequence[str]:
        """Names of what has errors."""

    @property
    def methods(self) -> Sequence[str]:
        """Names of the methods."""

    @property
    def trials(self) -> Sequence[PrecisionTrial]:
        """All trials."""

    def of(self, method: str) -> Sequence[PrecisionTrial]:
        """Return the trials of a method."""


@contextmanager
def styled_figure(path: Path, size: tuple[float, float]) -> Iterator[Figure]:
    """Give a figure of this size [inch] in the one style, and write it to the path at the end."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None} if path.suffix == ".png" else None)


def draw_work_precision(table: PrecisionTable, path: Path) -> None:
    """Write the figure: one column for each quantity; above error against setting, below seconds against error."""
    quantities = table.quantities
    if not quantities:
        raise ValueError("table must have at least one measured error to be drawn, got none")
    width = max(3.9 * len(quantities) + 0.4, 7.2)
    with styled_figure(path, (width, 6.6)) as figure:
        ax_rows = figure.subplots(2, len(quantities), squeeze=False)
        for column, quantity in enumerate(quantities):
            above, below = ax_rows[0][column], ax_rows[1][column]
            zero = _zero_level(table, quantity)
            for index, method in enumerate(table.methods):
                _method(table, method, quantity, zero, COLORS[index % 8], MARKERS[index % 8], above, below)
            above.set(title=quantity, xlabel=table.knob, ylabel=f"error in {quantity}", xscale="log", yscale="log")
            settings = sorted({trial.setting for trial in table.trials})
            if settings[-1] < 100.0 * settings[0]:
                # less than two decades: powers of ten say too little, and numbers between them overlap
                above.set_xticks(settings, [f"{one:g}" for one in settings], minor=False)
                above.xaxis.set_minor_formatter(NullFormatter())
            above.invert_xaxis()
            below.set(xlabel=f"error in {quantity}", ylabel="CPU seconds", xscale="log", yscale="log")
            below.invert_xaxis()
            if any(trial.errors.get(quantity) == 0.0 for trial in table.trials):
                above.axhline(zero, color="#999999", linewidth=0.8, linestyle=":")
                above.annotate("exactly 0", (0.01, zero), xycoords=("axes fraction", "data"), va="top", fontsize=7.5)
                above.set_ylim(bottom=0.1 * zero)
                below.axvline(zero, color="#999999", linewidth=0.8, linestyle=":")
                below.annotate(
                    "exactly 0", (zero, 0.02), xycoords=("data", "axes fraction"), rotation=90, ha="right", fontsize=7.5
                )
        handles, labels = ax_rows[0][0].get_legend_handles_labels()
        if any(trial.failed and trial.errors for trial in table.trials):
            handles.append(Line2D([], [], color="#666666", marker="o", markerfacecolor="none", linestyle="none"))
            labels.append("hollow: failed")
        # a letter takes about 0.075 inches, a line and the space around it half an inch
        fitting = int(width / (0.5 + 0.075 * max((len(label) for label in labels), default=1)))
        figure.legend(handles, labels, loc="outside lower center", ncols=max(1, min(len(labels), 4, fitting)))
        heading = table.title or "work and precision"
        figure.suptitle(f"{heading}\nreference: {table.reference_is}" if table.reference_is else heading, fontsize=10)


def _zero_level(table: PrecisionTable, quantity: str) -> float:
    """Where exact zeros are drawn on a logarithmic axis: a decade under the smallest error."""
    positive = [t.errors[quantity] for t in table.trials if t.errors.get(quantity, 0.0) > 0.0]
    return 0.1 * min(positive, default=1e-15)


def _method(
    table: PrecisionTable, method: str, quantity: str, zero: float, color: str, marker: str, above: Any, below: Any
) -> None:
    trials = [trial for trial in table.of(method) if quantity in trial.errors]
    good = [trial for trial in trials if not trial.failed]
    failed = [trial for trial in trials if trial.failed]
    common = {"color": color, "marker": marker, "markersize": 5.0, "linewidth": 1.2}
    for subset, extra in (
        (good, {"label": method or "method"}),
        (failed, {"markerfacecolor": "none", "linestyle": "none"}),
    ):
        errors = [max(trial.errors[quantity], zero) for trial in subset]
        style: dict[str, Any] = {**common, **extra}
        above.plot([trial.setting for trial in subset], errors, **style)
        below.plot(errors, [trial.seconds for trial in subset], **style)


def draw_costs(title: str, names: Sequence[str], columns: Mapping[str, Sequence[float]], path: Path) -> None:
    """Write the figure: a column of bars for each quantity, names at the left, numbers at the ends of the bars."""
    # a letter takes about 0.075 inches
    margin = 0.075 * max(len(name) for name in names)
    with styled_figure(path, (margin + 2.6 * len(columns), 1.2 + 0.42 * len(names))) as figure:
        axes = figure.subplots(1, len(columns), squeeze=False, sharey=True)[0]
        place = range(len(names))
        for k, (ax, (quantity, values)) in enumerate(zip(axes, columns.items(), strict=True)):
            bars = ax.barh(place, values, color=COLORS[k % len(COLORS)], height=0.62)
            ax.bar_label(bars, [f"{value:.3g}" if value < 1000.0 else f"{value:.0f}" for value in values], padding=3)
            ax.set(title=quantity, xlim=(0.0, 1.18 * max(values)))
            ax.grid(axis="y", visible=False)
            ax.set_axisbelow(True)
        axes[0].set_yticks(place, names)
        axes[0].invert_yaxis()
        figure.suptitle(title, fontsize=10)


# (setting, deviation, its standard error), by method and quantity
Deviations = Mapping[str, Mapping[str, Sequence[tuple[float, float, float]]]]


def draw_deviations(deviations: Deviations, path: Path, *, title: str, knob: str, largest: float = 0.15) -> None:
    """Write the figure: a column for each quantity; above deviations with error bars, below their sizes in logarithms.

    Parameters
    ----------
    deviations
        Deviations relative to the reference, by method, then by quantity.
    path
        The file; its ending names the format.
    title, knob
        Words: what is shown, and what the setting is.
    largest
        Deviations are drawn above up to this size; larger ones stand below alone.

    """
    quantities = list(next(iter(deviations.values())))
    with styled_figure(path, (4.4 * len(quantities), 6.8)) as figure:
        axes = figure.subplots(2, len(quantities), squeeze=False, sharex=True)
        settings = sorted({row[0] for found in deviations.values() for rows in found.values() for row in rows})
        for column, quantity in enumerate(quantities):
            above, below = axes[0][column], axes[1][column]
            for k, (method, found) in enumerate(deviations.items()):
                setting, off, bar = np.array(found[quantity]).reshape(-1, 3).T
                style = {"color": COLORS[k % 8], "marker": MARKERS[k % 8], "markersize": 4.5, "linewidth": 1.0}
                # side by side, or bars hide each other
                beside = setting * 1.05 ** (k - 0.5 * (len(deviations) - 1))
                shown = np.abs(off) <= largest
                above.errorbar(
                    beside[shown], 100.0 * off[shown], 100.0 * bar[shown], capsize=2.0, label=method, **style
                )
                below.plot(setting, np.abs(off), **style)
            above.axhline(0.0, color="#999999", linewidth=0.8)
            above.set(title=quantity, ylabel="off the reference [%]", xscale="log")
            # what is nowhere off cannot be seen in logarithms
            scale = "log" if any(row[1] for found in deviations.values() for row in found[quantity]) else "linear"
            below.set(xlabel=knob, ylabel="size of it, relative", yscale=scale)
            below.set_xticks(settings, [f"{one:g}" for one in settings], minor=False)
            below.xaxis.set_minor_formatter(NullFormatter())
        # all columns share it
        axes[0][0].invert_xaxis()
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        figure.suptitle(title, fontsize=10)


def draw_cementing(curves: Sequence[CementingCurve], path: Path) -> None:
    """Write the figure: shear and bulk modulus, Poisson ratio, and the fractions of stiff packings, against n_l/N."""
    with styled_figure(path, (9.6, 7.2)) as figure:
        axes = figure.subplots(2, 2)
        for number, curve in enumerate(curves):
            color, marker = COLORS[number % len(COLORS)], MARKERS[number % len(MARKERS)]
            style = {"color": color, "marker": marker, "markersize": 4.0, "linewidth": 1.0}
            _moduli(axes[0][0], curve, "shear", style)
            _moduli(axes[0][1], curve, "bulk", style)
            show = curve.some_stiff_k < STIFF_SHARE
            poisson = curve.poisson_ratio
            axes[1][0].errorbar(
                curve.link_fraction_k[show], poisson.mean_k[show], poisson.error_k[show], capsize=2.0, **style
            )
            axes[1][1].plot(curve.link_fraction_k, curve.some_stiff_k, **style)
            axes[1][1].plot(curve.link_fraction_k, curve.all_stiff_k, markerfacecolor="none", linestyle="--", **style)
        for ax, name in ((axes[0][0], "shear"), (axes[0][1], "bulk")):
            shown = [getattr(curve, name).mean_k[curve.some_stiff_k < STIFF_SHARE] for curve in curves]
            # means of the upper bound run away shortly before directions become stiff
            ax.set_ylim(0.4 * min(map(np.nanmin, shown)), 5.0 * max(map(np.nanmax, shown)))
        axes[0][0].set(ylabel="shear modulus (energy / diameter$^d$)", yscale="log")
        axes[0][1].set(ylabel="bulk modulus (energy / diameter$^d$)", yscale="log")
        axes[1][0].set(ylabel="Poisson ratio")
        axes[1][1].set(ylabel="fraction of trials", ylim=(-0.03, 1.03))
        axes[1][1].set_title("filled: a stiff direction; open: completely rigid", fontsize=8.0)
        for ax in axes.flat:
            ax.set_xlabel("cemented contacts per particle, $n_l/N$")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 6))
        first = curves[0]
        shape = " x ".join(map(str, first.first_stiff_po.shape))
        figure.suptitle(
            f"Cementing: random contacts become rigid links; {shape} packings x orders\n"
            "points: means weighted by the Voigt and Reuss bounds; bands: mean bounds; shown until half are stiff",
            fontsize=10,
        )


def _moduli(ax: Any, curve: CementingCurve, name: str, style: dict[str, Any]) -> None:
    show = curve.some_stiff_k < STIFF_SHARE
    means, fraction = getattr(curve, name), curve.link_fraction_k[show]
    ax.errorbar(fraction, means.mean_k[show], means.error_k[show], capsize=2.0, label=f"N = {curve.particles}", **style)
    low, high = (curve.bound_means[f"{name}_{bound}"][show] for bound in ("reuss", "voigt"))
    ax.fill_between(fraction, low, high, color=style["color"], alpha=0.12, linewidth=0.0)


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
    frames = integer("frames", frames, at_least=2)
    one_of("format", format, FORMATS)
    if not isinstance(folder, str | os.PathLike):
        raise TypeError(f"folder must be a folder's name, got {folder!r}")
    if run.packing.particles != scene.packing.particles:
        raise ValueError(f"scene must have the run's {run.packing.particles} particles, got {scene.packing.particles}")
    trajectory = trajectory_of_run(run, scene, frames)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    picture = _RunPicture(trajectory)
    return tuple(
        picture.write(snapshot, target / f"frame-{k:04d}.{format}", format)
        for k, snapshot in enumerate(trajectory.snapshots)
    )


class _RunPicture:
    """One figure on which every snapshot is drawn in its turn: axes and curves stay, the packing changes."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory, self.packing = trajectory, trajectory.final
        # links are not drawn here, and their clusters not told apart
        bare = self.packing.replace(links=None)
        self.color_nc = drawing.particle_colors(bare, trajectory.effects, None, trajectory.held_n) / 255.0
        self.flat = self.packing.dimension == 2
        self.figure = Figure(figsize=SIZE, dpi=DOTS, facecolor=PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((0.01, 0.02, 0.64, 0.9), facecolor=PAPER)
        self.axes.set_axis_off()
        boxes = [drawing.shown_box(one.packing.box)[0] for one in trajectory.snapshots]
        corners = [drawing.box_outline(box) for box in boxes]
        place_kd = np.concatenate([self._seen(np.concatenate(lines))[:, :2] for lines in corners])
        pad = 2.2 * float(self.packing.radius_n.max())
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
            axes.set_title("stress against strain", color=INK, fontsize=8)
            self.dots.append((axes.plot([], [], "o", color=NOW, ms=5)[0], None))
        height = (top - bottom) / max(1, len(rows))
        for k, name in enumerate(rows):
            axes = self._plot(self.figure.add_axes((0.73, top - (k + 1) * height + 0.035, 0.25, height - 0.065)))
            axes.plot(*trajectory.curves[name], color="#7aaee6", lw=1.0)
            axes.set_title(name, color=INK, fontsize=8, pad=2)
            self.dots.append((axes.plot([], [], "o", color=NOW, ms=4)[0], trajectory.curves[name]))

    def _plot(self, axes: Any) -> Any:
        axes.set_facecolor(PAPER)
        axes.tick_params(colors=INK, labelsize=6)
        for spine in axes.spines.values():
            spine.set_color("#4a5260")
        return axes

    def _seen(self, place_kd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what is seen across, up, and toward the eye."""
        if place_kd.shape[-1] == 2:
            return np.concatenate([place_kd, np.zeros((*place_kd.shape[:-1], 1))], axis=-1)
        return np.asarray(place_kd @ drawing.view_axes())

    def write(self, snapshot: Snapshot, path: Path, format: str) -> Path:
        """Draw a snapshot and write it."""
        drawn = draw_snapshot(snapshot, self.trajectory.effects)
        artists = [*self._discs(drawn), *self._lines(drawn)]
        for artist in artists:
            self.axes.add_collection(artist)
        words = [f"step {snapshot.step}"] if snapshot.touching is None else [f"time {snapshot.time:.4g}"]
        for dot, curve in self.dots:
            if curve is None:
                strain = self._at(snapshot, "strain")
                stress = self._at(snapshot, "stress")
                dot.set_data([strain], [stress])
                words += [f"strain {strain:.4f}", f"stress {stress:.3g}"]
            else:
                dot.set_data([snapshot.step], [np.interp(snapshot.step, *curve)])
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
        Image.fromarray(np.asarray(self.canvas.buffer_rgba())).convert("RGB").save(path, compress_level=4)

    def _write_svg(self, path: Path) -> None:
        # the same run writes the same file
        with matplotlib.rc_context({"svg.hashsalt": STYLE["svg.hashsalt"]}):
            self.figure.savefig(path, format="svg", metadata={"Date": None})

    def _at(self, snapshot: Snapshot, start: str) -> float:
        curve = next((curve for name, curve in self.trajectory.curves.items() if name.startswith(start)), None)
        return 0.0 if curve is None else float(np.interp(snapshot.step, *curve))

    def _discs(self, drawn: DrawnSnapshot) -> list[Any]:
        radius_n, plain = self.packing.radius_n, drawn.drawing

        def discs(center: NDArray[np.float64], radius: NDArray[np.float64], color: Any, order: float) -> Any:
            width = 2.0 * radius
            return EllipseCollection(
                width,
                width,
                np.zeros(len(width)),
                units="xy",
                offsets=center,
                transOffset=self.axes.transData,
                facecolors=color,
                edgecolors=PAPER,
                linewidths=0.3,
                zorder=order,
            )

        if self.flat:
            owner = plain.copy_of_k
            dim = drawing.dimmed((255.0 * self.color_nc[owner]).astype(np.uint8)) / 255.0
            copies = discs(plain.copy_center_kd, radius_n[owner], dim, 1.0)
            return [copies, discs(plain.center_nd, radius_n, self.color_nc, 2.0)]
        seen = self._seen(plain.center_nd)
        order = np.argsort(seen[:, 2])
        depth = seen[order, 2]
        share = DIM + (1.0 - DIM) * (depth - depth.min()) / (np.ptp(depth) or 1.0)
        return [discs(seen[order, :2], radius_n[order], self.color_nc[order] * share[:, None], 2.0)]

    def _lines(self, drawn: DrawnSnapshot) -> list[Any]:
        unit, d = self.packing.reference_diameter, self.packing.dimension

        def lines(segments: Any, half_width: Any, color: Any, order: float) -> Any:
            flat = [self._seen(np.asarray(line))[:, :2] for line in segments]
            width = 2.0 * self.points * np.asarray(half_width)
            return LineCollection(flat, linewidths=width, colors=color, zorder=order, capstyle="round")

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
