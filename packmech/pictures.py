"""Evenly spaced pictures of a run as files, drawn without a display."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech import drawing
from packmech.check import instance, integer, one_of
from packmech.march_film import (
    BOND_WIDTH,
    MARK,
    MARK_WIDTH,
    SLIDING,
    WALL,
    WALL_WIDTH,
    MarchFilm,
    Moment,
    Picture,
    draw_moment,
    film_of_march,
    is_march,
)
from packmech.outcome import Run
from packmech.recording_film import Curve, film_of_run
from packmech.scene import Scene

FORMATS = ("png", "svg")
# inches and dots an inch of a picture; the packing takes the left part
SIZE, DOTS = (9.6, 6.4), 100
PLOTS = ("strain", "stress", "pressure", "log10 energy")
PAPER, INK, NOW = "#0d111a", "#c8d0dc", "#ff6060"
# in space what lies at the back is dimmed to this part, and looked at from this direction
DIM, VIEW = 0.35, (0.42, -0.88, 0.45)


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
    film = film_of_march(run, scene, frames) if is_march(run) else _plain_film(run, scene, frames)
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    sheet = _Sheet(film)
    return tuple(
        sheet.write(moment, target / f"frame-{k:04d}.{format}", format) for k, moment in enumerate(film.moments)
    )


def _plain_film(run: Run, scene: Scene, frames: int) -> MarchFilm:
    """Return the film of a run that is no march: forces are those of its effects."""
    film = film_of_run(run, scene, frames)
    moments = tuple(
        Moment(int(step), float(step), packing, None, None)
        for step, packing in zip(film.step_f, film.packing_f, strict=True)
    )
    return MarchFilm(scene, moments, film.curves, np.zeros(0), np.zeros(0), {})


class _Sheet:
    """One figure on which every moment is drawn in its turn: axes and curves stay, the packing changes."""

    def __init__(self, film: MarchFilm) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.film, self.color_nc = film, film.colors() / 255.0
        self.flat = film.scene.packing.dimension == 2
        self.figure = Figure(figsize=SIZE, dpi=DOTS, facecolor=PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((0.01, 0.02, 0.64, 0.9), facecolor=PAPER)
        self.axes.set_axis_off()
        corners = [drawing.box_outline(drawn) for drawn in self._boxes()]
        place_kd = np.concatenate([self._seen(np.concatenate(lines))[:, :2] for lines in corners])
        pad = 2.2 * float(film.scene.packing.radius_n.max())
        low, high = place_kd.min(axis=0) - pad, place_kd.max(axis=0) + pad
        self.axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        width, height = 0.64 * SIZE[0] * 72.0, 0.9 * SIZE[1] * 72.0
        # points of a line as wide as one unit of length
        self.points = float(min(width / (high[0] - low[0]), height / (high[1] - low[1])))
        self.title = self.figure.text(0.02, 0.955, "", color=INK, fontsize=11)
        self.dots: list[tuple[Any, Curve | None]] = []
        self.still: Any = None
        self._plots()

    def _boxes(self) -> list[Any]:
        from packmech.march_film import shown_box

        return [shown_box(moment.packing.box)[0] for moment in self.film.moments]

    def _plots(self) -> None:
        film = self.film
        looped = len(film.strain_t) > 1
        names = [name for name in film.curves if name.startswith(PLOTS) and len(film.curves[name][0]) > 1]
        rows = names[: 3 if looped else 4]
        bottom, top = 0.08, 0.5 if looped else 0.92
        if looped:
            axes = self._plot(self.figure.add_axes((0.73, 0.58, 0.25, 0.34)))
            axes.plot(film.strain_t, film.stress_t, color="#7aaee6", lw=1.0)
            axes.set_title("stress against strain", color=INK, fontsize=8)
            self.dots.append((axes.plot([], [], "o", color=NOW, ms=5)[0], None))
        height = (top - bottom) / max(1, len(rows))
        for k, name in enumerate(rows):
            axes = self._plot(self.figure.add_axes((0.73, top - (k + 1) * height + 0.035, 0.25, height - 0.065)))
            axes.plot(*film.curves[name], color="#7aaee6", lw=1.0)
            axes.set_title(name, color=INK, fontsize=8, pad=2)
            self.dots.append((axes.plot([], [], "o", color=NOW, ms=4)[0], film.curves[name]))

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
        toward = np.array(VIEW) / np.linalg.norm(VIEW)
        across = np.cross((0.0, 0.0, 1.0), toward)
        across /= np.linalg.norm(across)
        return np.asarray(place_kd @ np.array([across, np.cross(toward, across), toward]).T)

    def write(self, moment: Moment, path: Path, format: str) -> Path:
        """Draw a moment and write it."""
        picture = draw_moment(moment, self.film.scene)
        artists = [*self._discs(picture), *self._lines(picture)]
        for artist in artists:
            self.axes.add_collection(artist)
        words = [f"step {moment.step}"] if moment.touching is None else [f"time {moment.time:.4g}"]
        for dot, curve in self.dots:
            if curve is None:
                strain = self._at(moment, "strain")
                stress = self._at(moment, "stress")
                dot.set_data([strain], [stress])
                words += [f"strain {strain:.4f}", f"stress {stress:.3g}"]
            else:
                dot.set_data([moment.step], [np.interp(moment.step, *curve)])
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
        from PIL import Image

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
        from matplotlib import rc_context

        # the same run writes the same file
        with rc_context({"svg.hashsalt": "packmech"}):
            self.figure.savefig(path, format="svg", metadata={"Date": None})

    def _at(self, moment: Moment, start: str) -> float:
        curve = next((curve for name, curve in self.film.curves.items() if name.startswith(start)), None)
        return 0.0 if curve is None else float(np.interp(moment.step, *curve))

    def _discs(self, picture: Picture) -> list[Any]:
        from matplotlib.collections import EllipseCollection

        radius_n, drawn = self.film.scene.packing.radius_n, picture.drawing

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
            owner = drawn.copy_of_k
            dim = drawing.dimmed((255.0 * self.color_nc[owner]).astype(np.uint8)) / 255.0
            copies = discs(drawn.copy_center_kd, radius_n[owner], dim, 1.0)
            return [copies, discs(drawn.center_nd, radius_n, self.color_nc, 2.0)]
        seen = self._seen(drawn.center_nd)
        order = np.argsort(seen[:, 2])
        depth = seen[order, 2]
        share = DIM + (1.0 - DIM) * (depth - depth.min()) / (np.ptp(depth) or 1.0)
        return [discs(seen[order, :2], radius_n[order], self.color_nc[order] * share[:, None], 2.0)]

    def _lines(self, picture: Picture) -> list[Any]:
        from matplotlib.collections import LineCollection

        unit, d = self.film.scene.packing.reference_diameter, self.film.scene.packing.dimension

        def lines(segments: Any, half_width: Any, color: Any, order: float) -> Any:
            flat = [self._seen(np.asarray(line))[:, :2] for line in segments]
            width = 2.0 * self.points * np.asarray(half_width)
            return LineCollection(flat, linewidths=width, colors=color, zorder=order, capstyle="round")

        found = [
            lines(picture.drawing.outline_ed, drawing.OUTLINE_RADIUS * unit, _rgb(drawing.OUTLINE), 6.0),
            lines(picture.wall_ed, WALL_WIDTH * unit, _rgb(WALL), 5.0),
        ]
        if not self.flat:  # lines inside solid spheres are not seen
            return found
        force_s, slide_s = picture.sticking_force_s, picture.sliding_force_s
        pull = drawing.tension_colors(picture.bond_pull_s, shape=False) / 255.0
        return [
            *found,
            lines(picture.mark_ned, MARK_WIDTH * unit, _rgb(MARK), 3.0),
            lines(picture.bond_sed, BOND_WIDTH * unit, pull, 3.5),
            lines(
                picture.sticking_sed,
                drawing.force_radii(force_s, unit, d),
                drawing.force_colors(force_s) / 255.0,
                4.0,
            ),
            lines(picture.sliding_sed, drawing.force_radii(slide_s, unit, d), _rgb(SLIDING), 4.5),
        ]


def _rgb(color: Sequence[int]) -> tuple[float, ...]:
    return tuple(part / 255.0 for part in color)
