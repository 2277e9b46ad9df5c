"""Rerun recordings of marches: bonds, contacts that stick or slide, marks that turn, the moving box; also live."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from packmech import drawing
from packmech.dynamics.march.state import March
from packmech.dynamics.march.touching import touching_of
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
    particle_colors,
    turned_marks,
)
from packmech.packing import Packing
from packmech.scene import Scene

if TYPE_CHECKING:
    import rerun as rr

# a live picture is sent no sooner than so long after the last one [s]
LIVE_SECONDS = 0.05
# moments in one block of columns, for about this many numbers
BLOCK_NUMBERS = 250_000
NOW = (255, 96, 96)


def write_march(
    film: MarchFilm,
    path: str | Path,
    parameters: Mapping[str, Any],
    results: Mapping[str, Any],
    summary: str,
) -> Path:
    """Write a film as a Rerun recording and return the absolute path.

    Parameters
    ----------
    film
        The film.
    path
        Where to write.
    parameters, results, summary
        As in `pm.record_run`.

    """
    import rerun as rr

    from packmech.recording import opened
    from packmech.recording_layout import march_blueprint

    plain = film.film()
    layout = march_blueprint(film, summary=bool(summary))
    with opened(path, layout, plain, parameters, {**film.moduli, **results}) as (stream, target):
        log_march(stream, film.scene, film.colors())
        log_loop(stream, film)
        if summary:
            stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)
        size = max(1, BLOCK_NUMBERS // (film.scene.packing.particles * film.scene.packing.dimension * 12))
        for first in range(0, len(film.moments), size):
            send_moments(stream, film.scene, film.colors(), film.moments[first : first + size])
    return target


def log_march(stream: rr.RecordingStream, scene: Scene, color_nc: NDArray[np.uint8]) -> None:
    """Log what does not change: radii, colors, widths, what lies over what."""
    import rerun as rr

    packing = scene.packing
    flat, unit = packing.dimension == 2, packing.reference_diameter
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    order = {"particles/copies": 20.0, "particles": 30.0, "marks": 35.0, "bonds": 38.0, "contacts/sticking": 40.0}
    order |= {"contacts/sliding": 44.0, "walls": 55.0, "box": 60.0}
    if flat:  # the viewer's 2D axes point down
        stream.log("world", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
        for name, place in order.items():
            kind = rr.Points2D if name.startswith("particles") else rr.LineStrips2D
            stream.log(f"world/{name}", kind.from_fields(draw_order=place), static=True)
    else:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/particles", points.from_fields(radii=packing.radius_n, colors=color_nc), static=True)
    lines = {
        "marks": (MARK_WIDTH, MARK),
        "walls": (WALL_WIDTH, WALL),
        "box": (drawing.OUTLINE_RADIUS, drawing.OUTLINE),
    }
    for name, (width, color) in lines.items():
        stream.log(f"world/{name}", strips.from_fields(radii=width * unit, colors=color), static=True)
    stream.log("world/bonds", strips.from_fields(radii=BOND_WIDTH * unit), static=True)
    stream.log("world/contacts/sliding", strips.from_fields(colors=SLIDING), static=True)
    stream.log("state/radius", rr.AnyValues(radius_n=packing.radius_n), static=True)


def loop_scales(film: MarchFilm) -> tuple[float, float]:
    """Return what strain and stress are divided by in the plot of one against the other."""
    strain, stress = (float(np.abs(part).max(initial=0.0)) for part in (film.strain_t, film.stress_t))
    return strain or 1.0, stress or 1.0


def log_loop(stream: rr.RecordingStream, film: MarchFilm, step_f: NDArray[np.int64] | None = None) -> None:
    """Log stress against strain, each over its largest, as a curve, and the present place on it.

    The places are those of the film's moments, or at the steps step_f, one for each point of the curve.
    """
    import rerun as rr

    if len(film.strain_t) < 2:
        return
    across, up = loop_scales(film)
    curve = np.column_stack([film.strain_t / across, film.stress_t / up])
    stream.log("loop", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
    axes = [[[-1.1, 0.0], [1.1, 0.0]], [[0.0, -1.1], [0.0, 1.1]]]
    stream.log("loop/axes", rr.LineStrips2D(axes, colors=drawing.OUTLINE, radii=0.004, draw_order=10.0), static=True)
    stream.log("loop/curve", rr.LineStrips2D([curve], colors=drawing.CURVE, radii=0.008, draw_order=20.0), static=True)
    if step_f is None:
        at, strain = film.curves["strain"]
        stress = next(value for name, (_, value) in film.curves.items() if name.startswith("stress"))
        step_f = np.array([moment.step for moment in film.moments])
        place = np.column_stack([np.interp(step_f, at, strain / across), np.interp(step_f, at, stress / up)])
    else:
        place = curve
    columns = rr.Points2D.columns(positions=place).partition([1] * len(step_f))
    stream.log("loop/now", rr.Points2D.from_fields(radii=0.035, colors=NOW, draw_order=30.0), static=True)
    stream.send_columns("loop/now", [rr.TimeColumn("step", sequence=step_f)], columns)


def send_moments(
    stream: rr.RecordingStream, scene: Scene, color_nc: NDArray[np.uint8], moments: Sequence[Moment]
) -> None:
    """Send moments as columns."""
    import rerun as rr

    pictures = [draw_moment(moment, scene) for moment in moments]
    d, unit = scene.packing.dimension, scene.packing.reference_diameter
    flat = d == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    clock = [
        rr.TimeColumn("step", sequence=[moment.step for moment in moments]),
        rr.TimeColumn("time", duration=[moment.time for moment in moments]),
    ]

    def send(path: str, columns: Any, sizes: list[int]) -> None:
        stream.send_columns(path, clock, columns.partition(sizes))

    def joined(name: str) -> tuple[NDArray[Any], list[int]]:
        parts = [_part(picture, name) for picture in pictures]
        return np.concatenate(parts), [len(part) for part in parts]

    center, sizes = joined("center_nd")
    send("world/particles", points.columns(positions=center), sizes)
    if flat:
        owner, sizes = joined("copy_of_k")
        center, _ = joined("copy_center_kd")
        radii, colors = scene.packing.radius_n[owner], drawing.dimmed(color_nc[owner])
        send("world/particles/copies", points.columns(positions=center, radii=radii, colors=colors), sizes)
    for name in ("sticking", "sliding"):
        lines, sizes = joined(f"{name}_sed")
        force, _ = joined(f"{name}_force_s")
        told: dict[str, Any] = {"strips": lines, "radii": drawing.force_radii(force, unit, d)}
        if name == "sticking":
            told["colors"] = drawing.force_colors(force)
        send(f"world/contacts/{name}", strips.columns(**told), sizes)
    lines, sizes = joined("bond_sed")
    pull, _ = joined("bond_pull_s")
    send("world/bonds", strips.columns(strips=lines, colors=drawing.tension_colors(pull, shape=False)), sizes)
    lines, sizes = joined("mark_ned")
    send("world/marks", strips.columns(strips=lines), sizes)
    for name, outlines in (
        ("box", [picture.drawing.outline_ed for picture in pictures]),
        ("walls", [picture.wall_ed for picture in pictures]),
    ):
        polylines = [line for outline in outlines for line in outline]
        if polylines:
            send(f"world/{name}", strips.columns(strips=polylines), [len(outline) for outline in outlines])
    for name, parts in (
        ("position", [moment.packing.position_nd for moment in moments]),
        ("lattice", [moment.packing.box.lattice_dd for moment in moments]),
    ):
        whole: Any = {
            f"{name}_{'nd' if name == 'position' else 'dd'}": np.concatenate([part.ravel() for part in parts])
        }
        values = rr.AnyValues.columns(**whole)
        send(f"state/{name}", values, [part.size for part in parts])


def _part(picture: Picture, name: str) -> NDArray[Any]:
    found: NDArray[Any] = getattr(picture, name) if hasattr(picture, name) else getattr(picture.drawing, name)
    return found


class LiveRecording:
    """A recording that is seen while a run goes on. Looking changes no bit of the run.

    Parameters
    ----------
    scene
        The scene that runs.
    target
        "viewer": open the Rerun viewer, or use the one that is open; an address such as
        "rerun+http://127.0.0.1:9876/proxy": a viewer that listens there; else a file name ending in .rrd.
    held_n
        (N,) particles that are held.
    least_seconds
        Send no picture sooner than so long after the last one [s].

    Raises
    ------
    ValueError
        For another target.

    """

    def __init__(
        self,
        scene: Scene,
        target: str | Path = "viewer",
        *,
        held_n: NDArray[np.bool_] | None = None,
        least_seconds: float = LIVE_SECONDS,
    ) -> None:
        import rerun as rr

        where = check_target(target)
        self.scene, self.least_seconds = scene, least_seconds
        self.colors = particle_colors(scene, held_n)
        self.shown = 0
        self._sent = -np.inf
        self._mark: NDArray[np.float64] | None = None
        self._spun: tuple[float, NDArray[np.float64]] | None = None
        self._step, self._time = -1, 0.0
        # what several marches follow on: each counts its own steps from 0
        self._march: March | None = None
        self._past: tuple[int, float] = (0, 0.0)
        self.stream = rr.RecordingStream("packmech")
        if where == "viewer":
            self.stream.spawn(hide_welcome_screen=True)
        elif "://" in where:
            self.stream.connect_grpc(where)
        else:
            self.stream.save(where)
        log_march(self.stream, scene, self.colors)

    def watch(self, stage: str, figures: Mapping[str, Any]) -> None:
        """Show what a run tells of its progress, unless the last picture has just been sent."""
        if time.monotonic() - self._sent < self.least_seconds:
            return
        march, packing = figures.get("march"), figures.get("packing")
        if isinstance(march, March):
            self.show(self._moment(march))
        elif isinstance(packing, Packing):
            # protocols count the steps of each stage anew
            self._step = max(self._step + 1, int(figures.get("steps", 0)))
            self.show(Moment(self._step, float(figures.get("time", self._step)), packing, None, None))
        else:
            return
        for name, value in figures.items():
            if isinstance(value, int | float) and name not in ("steps", "of"):
                self._curve(name, float(value))

    def _moment(self, march: March) -> Moment:
        if march is not self._march:
            self._march, self._past, self._spun = march, (self._step + 1, self._time), None
        self._step, self._time = self._past[0] + march.steps, self._past[1] + march.time
        spin, box = march.spins(), march.box()
        packing = self.scene.packing.replace(position_nd=march.positions(), box=box)
        if spin is not None:
            # marks turn as far as spins at the times that were looked at say
            before, old = self._spun or (march.time, spin)
            times, spins = np.array([before, march.time]), np.array([old, spin])
            self._mark = turned_marks(times, spins, box.dimension, self._mark)[1]
            self._spun = (march.time, spin)
        return Moment(self._step, self._time, packing, touching_of(march), self._mark)

    def show(self, moment: Moment) -> None:
        """Send one moment."""
        send_moments(self.stream, self.scene, self.colors, [moment])
        self._sent = time.monotonic()
        self.shown += 1

    def _curve(self, name: str, value: float) -> None:
        import rerun as rr

        self.stream.set_time("step", sequence=self._step)
        self.stream.log(f"series/{name.replace(' ', '_')}", rr.Scalars(value))
        self.stream.reset_time()

    def close(self) -> None:
        """Send what is left and let go."""
        self.stream.flush()
        self.stream.disconnect()


def check_target(target: Any) -> str:
    """Return where a live recording goes, or say what is wrong with it."""
    if not isinstance(target, str | os.PathLike):
        raise TypeError(f"live must be 'viewer', an address or a file name, got {target!r}")
    where = str(target)
    if where == "viewer" or "://" in where:
        return where
    if Path(where).suffix != ".rrd":
        raise ValueError(f"live must be 'viewer', an address such as rerun+http://... or end in .rrd, got {where!r}")
    if not Path(where).absolute().parent.is_dir():
        raise ValueError(f"live must lie in an existing folder, got {where!r}")
    return where
