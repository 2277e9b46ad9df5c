"""Recordings that are written while something runs: frame by frame from a loop of your own, or live."""

from __future__ import annotations

import atexit
import os
import time
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from packmech.check import brief, instance, integer, real, table
from packmech.contacts import Contacts
from packmech.dynamics.engine import Engine
from packmech.dynamics.pair_forces import Touching, touching_of
from packmech.files.paths import file_name, printable, writable_file
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.shapes import same_but_turned
from packmech.view import drawing
from packmech.view.frame import drawn_contacts
from packmech.view.recording import (
    BLOCK_NUMBERS,
    World,
    blueprint,
    log_loop,
    log_moving,
    log_resting,
    properties_of,
    property_values,
    send_curves,
    send_moving,
    send_resting,
    unwritten,
    written_whole,
)
from packmech.view.trajectory import Curve, PackingFrame, Trajectory, turned_marks

# a live picture is sent no sooner than so long after the last one [s]
LIVE_SECONDS = 0.05


class Recording:
    """A Rerun recording that is written frame by frame, in the style of those of `pm.record_run`.

    Use it in a `with` statement, or call `close`: what was added is then in the file, whatever happened. Particles,
    contacts (as wide as their forces, blue where they slide), bonds, links, walls and the box are drawn; figures are
    plotted against the step. Recording changes nothing that is recorded.

    Parameters
    ----------
    path
        Where to write, usually `name.rrd`; the folder is made if need be, an existing file is replaced.
    scene
        The scene: its particles, and the effects whose forces, bonds and walls are drawn.
    parameters
        How this was made, by name; kept as the recording's properties.
    loop
        Names of two of the figures, across and up, that are drawn against each other too, such as ("strain", "stress").

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.
    OSError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with Recording(folder + "/steps.rrd", scene) as recording:
    ...         for step in range(3):
    ...             recording.add(scene.packing, figures={"pressure": pm.pressure(scene)})
    ...     recording.path.stat().st_size > 1000, recording.frames
    (True, 3)

    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        scene: Scene,
        *,
        parameters: Mapping[str, Any] | None = None,
        loop: tuple[str, str] | None = None,
    ) -> None:
        file = file_name("path", path).absolute()
        instance("scene", scene, Scene)
        if parameters is not None:
            table("parameters", parameters)
        if loop is not None and not (
            isinstance(loop, tuple) and len(loop) == 2 and all(isinstance(name, str) for name in loop)
        ):
            raise TypeError(f"loop must be the names of two figures, got {brief(loop)}")
        self._writer = _Writer(file, scene, dict(parameters or {}), loop)
        # closes the file when this is forgotten, or Python ends, before Rerun's own end
        self._finish = weakref.finalize(self, self._writer.finish)
        atexit.register(self._finish)

    @property
    def path(self) -> Path:
        """The absolute path of the file."""
        return self._writer.path

    @property
    def frames(self) -> int:
        """How many frames were added."""
        return self._writer.frames

    @property
    def closed(self) -> bool:
        """Whether the file is complete and takes no more frames."""
        return not self._finish.alive

    def add(
        self,
        packing: Packing,
        *,
        step: int | None = None,
        time: float | None = None,
        contacts: Contacts | None = None,
        force_c: ArrayLike | None = None,
        sliding_c: ArrayLike | None = None,
        figures: Mapping[str, float] | None = None,
    ) -> None:
        """Add a frame.

        Parameters
        ----------
        packing
            The packing: the scene's particles, at these positions in this box.
        step
            Where the frame stands; one after the last one unless given.
        time
            When it was; the step unless given.
        contacts, force_c, sliding_c
            What touches, with images for positions as they are, the (C,) forces, and (C,) True for those that
            slide. Unless given, and with rigid links, the pairs that touch with the forces of the scene's effects.
        figures
            Numbers by name, to be plotted against the step. What is not finite is left out.

        Raises
        ------
        TypeError, ValueError
            Naming the argument that is wrong; the recording goes on.

        """
        writer = self._writer
        if self.closed:
            raise ValueError(f"recording must be open for more frames, got one that is closed: {self.path.name}")
        packing = writer.checked(packing)
        at = writer.next_step if step is None else integer("step", step, at_least=writer.next_step)
        when = float(at) if time is None else real("time", time)
        touching = None
        if not writer.resting:
            drawn = drawn_contacts(packing, writer.scene.effects, contacts, force_c, sliding_c)
            shown = drawn.contacts
            assert isinstance(shown, Contacts)
            pushed = -drawn.force_c[:, None] * shown.normal_cd
            touching = Touching(shown.i_c, shown.j_c, shown.image_cd, drawn.force_c, pushed, drawn.sliding_c)
        writer.take(PackingFrame(at, when, packing, touching), _numbers(figures))

    def close(self, results: Mapping[str, Any] | None = None) -> Path:
        """Complete the file and return its absolute path; what was found is kept with it by name.

        Raises
        ------
        OSError
            If the file could not be written to its end.

        """
        if results is not None:
            table("results", results)
            self._writer.results.update(results)
        with written_whole(self.path):
            self._finish()
        atexit.unregister(self._finish)
        return self.path

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *stopped: object) -> None:
        self.close()


def _numbers(figures: Mapping[str, float] | None) -> dict[str, float]:
    if figures is None:
        return {}
    table("figures", figures)
    found = {}
    for name, value in figures.items():
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
            raise TypeError(f"figures[{name!r}] must be a number, got {brief(value)}")
        if np.isfinite(value):
            found[name] = float(value)
    return found


class _Writer:
    """What a recording holds until it is finished; knows nothing of the Recording, so that this can be forgotten."""

    def __init__(self, path: Path, scene: Scene, parameters: dict[str, Any], loop: tuple[str, str] | None) -> None:
        self.path, self.scene, self.parameters, self.loop = path, scene, parameters, loop
        self.results: dict[str, Any] = {}
        self.frames, self.next_step = 0, 0
        packing = scene.packing
        # frames are drawn as packings at rest: contacts of what is linked or has shapes are found there
        self.resting = not packing.plain
        self.block: list[PackingFrame] = []
        self.size = max(1, BLOCK_NUMBERS // (packing.particles * packing.dimension * 12))
        # what the layout is made of: figures, the first step, the last frame, and those with the widest boxes
        self.first_step = 0
        self.curves: dict[str, tuple[list[int], list[float]]] = {}
        self.wide: list[PackingFrame] = []
        self.reach = (np.full(packing.dimension, np.inf), np.full(packing.dimension, -np.inf))
        self.last: PackingFrame | None = None
        if printable(str(path)) != str(path):
            raise ValueError(f"path must be a file name of whole letters, got {brief(str(path))}")
        # the writer only logs a file that it cannot open
        writable_file("path", path, make_folder=True)
        self.stream = rr.RecordingStream("packmech")
        try:
            self.stream.save(path)
        except RuntimeError as error:
            raise unwritten(path, str(error)) from error
        self.stream.send_recording_name(path.stem)
        self.send_properties(of_parameters=True)
        self.world = World(self.stream, packing, drawing.particle_colors(packing, scene.effects))
        if self.resting:
            log_resting(self.world)
        else:
            log_moving(self.world)

    def send_properties(self, *, of_parameters: bool) -> None:
        """Write the parameters, or else the results, as properties."""
        found = properties_of(self.scene.packing, self.scene.effects, self.parameters, self.results)
        found = {name: value for name, value in found.items() if (name == "parameters_json") == of_parameters}
        self.stream.send_property("packmech", property_values(found))

    def checked(self, packing: Any) -> Packing:
        """Return the packing, or say why it is none of the scene's particles."""
        if not isinstance(packing, Packing):
            raise TypeError(f"packing must be a Packing, got {brief(packing)}")
        mine = self.scene.packing
        if packing.particles != mine.particles or packing.dimension != mine.dimension:
            raise ValueError(
                f"packing must have the scene's {mine.particles} particles in {mine.dimension} dimensions, "
                f"got {packing.particles} in {packing.dimension}"
            )
        if not np.array_equal(packing.radius_n, mine.radius_n):
            raise ValueError("packing must have the scene's radii, got others")
        if bool(packing.links) != bool(mine.links):
            raise ValueError(f"packing must have links as the scene has, got {len(packing.links)}")
        if not same_but_turned(packing.shapes, mine.shapes):
            raise ValueError(f"packing must have shapes as the scene has, got {brief(packing.shapes)}")
        return packing

    def take(self, frame: PackingFrame, figures: Mapping[str, float]) -> None:
        """Take a frame, and send a block of them when it is full."""
        if not self.frames:
            self.first_step = frame.step
        self.block.append(frame)
        self.frames += 1
        self.next_step = frame.step + 1
        for name, value in figures.items():
            step_t, value_t = self.curves.setdefault(name, ([], []))
            step_t.append(frame.step)
            value_t.append(value)
        self.last = frame
        box, _ = drawing.shown_box(frame.packing.box)
        corner = np.concatenate(drawing.box_outline(box))
        low, high = self.reach
        if (corner.min(axis=0) < low).any() or (corner.max(axis=0) > high).any():
            self.reach = np.minimum(low, corner.min(axis=0)), np.maximum(high, corner.max(axis=0))
            self.wide.append(frame)
        if len(self.block) >= self.size:
            self.send()

    def send(self) -> None:
        """Send the frames that are waiting."""
        block, self.block = self.block, []
        if block:
            (send_resting if self.resting else send_moving)(self.world, self.scene.effects, block)

    def finish(self) -> None:
        """Send all that is left, with the layout, and let go of the file."""
        try:
            self.send()
            if self.last is not None:
                self.lay_out(self.last)
            self.send_properties(of_parameters=False)
        finally:
            self.stream.flush()
            self.stream.disconnect()

    def lay_out(self, last: PackingFrame) -> None:
        """Send the curves and how the recording opens, which needs the names of all of them."""
        curves: dict[str, Curve] = {
            name: (np.array(step_t), np.array(value_t)) for name, (step_t, value_t) in self.curves.items()
        }
        send_curves(self.stream, curves)
        # what does not change is in the file, and not plotted
        curves = {name: curve for name, curve in curves.items() if np.ptp(curve[1]) > 0.0}

        def shown(frame: PackingFrame, step: int) -> PackingFrame:
            packing = frame.packing
            return PackingFrame(step, 0.0, packing.replace(box=drawing.shown_box(packing.box)[0]))

        trajectory = Trajectory(
            (*(shown(one, self.first_step) for one in self.wide), shown(last, last.step)),
            self.scene.effects,
            curves,
            *self.looped(curves),
            in_motion=not self.resting,
        )
        if self.loop is not None and len(trajectory.strain_t):
            log_loop(self.stream, trajectory, curves[self.loop[0]][0])
        self.stream.send_blueprint(blueprint(trajectory, summary=False), make_active=True, make_default=True)

    def looped(self, curves: Mapping[str, Curve]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the two figures that are drawn against each other, where both are known."""
        if self.resting or self.loop is None or any(name not in curves for name in self.loop):
            return np.zeros(0), np.zeros(0)
        (across_at, across), (up_at, up) = (curves[name] for name in self.loop)
        if not (np.array_equal(across_at, up_at) and np.ptp(across) > 0.0):
            return np.zeros(0), np.zeros(0)
        return across, up


class LiveRecording:
    """A recording that is shown while a run goes on. It changes no bit of the run.

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
        where = check_live_target(target)
        self.scene, self.least_seconds = scene, least_seconds
        self.shown = 0
        self._sent = -np.inf
        self._mark: NDArray[np.float64] | None = None
        self._spun: tuple[float, NDArray[np.float64]] | None = None
        self._step, self._time = -1, 0.0
        # several time integrations may follow each other: each counts its own steps from 0
        self._engine: Engine | None = None
        self._past: tuple[int, float] = (0, 0.0)
        self.stream = rr.RecordingStream("packmech")
        if where == "viewer":
            self.stream.spawn(hide_welcome_screen=True)
        elif "://" in where:
            self.stream.connect_grpc(where)
        else:
            self.stream.save(where)
        self.world = World(
            self.stream, scene.packing, drawing.particle_colors(scene.packing, scene.effects, None, held_n)
        )
        log_moving(self.world)

    def watch(self, stage: str, figures: Mapping[str, Any]) -> None:
        """Show the progress of a run, unless the last picture has just been sent."""
        if time.monotonic() - self._sent < self.least_seconds:
            return
        engine, packing = figures.get("engine"), figures.get("packing")
        if engine is not None:
            self.show(self._frame(engine))
        elif isinstance(packing, Packing):
            # protocols count the steps of each stage from zero
            self._step = max(self._step + 1, int(figures.get("steps", 0)))
            self.show(PackingFrame(self._step, float(figures.get("time", self._step)), packing))
        else:
            return
        for name, value in figures.items():
            if isinstance(value, int | float) and name not in ("steps", "of"):
                self._curve(name, float(value))

    def _frame(self, engine: Engine) -> PackingFrame:
        if engine is not self._engine:
            self._engine, self._past, self._spun = engine, (self._step + 1, self._time), None
        self._step, self._time = self._past[0] + engine.steps, self._past[1] + engine.time
        spin, box = engine.spins(), engine.box()
        packing = self.scene.packing.replace(position_nd=engine.positions(), box=box)
        if spin is not None:
            # marks turn as far as spins at the times of the frames say
            before, old = self._spun or (engine.time, spin)
            times, spins = np.array([before, engine.time]), np.array([old, spin])
            self._mark = turned_marks(times, spins, box.dimension, self._mark)[1]
            self._spun = (engine.time, spin)
        broken = None if engine.breaks is None else engine.breaks.bond_e
        return PackingFrame(self._step, self._time, packing, touching_of(engine), self._mark, broken)

    def show(self, frame: PackingFrame) -> None:
        """Send one frame."""
        send_moving(self.world, self.scene.effects, [frame])
        self._sent = time.monotonic()
        self.shown += 1

    def _curve(self, name: str, value: float) -> None:
        self.stream.set_time("step", sequence=self._step)
        self.stream.log(f"series/{name.replace(' ', '_')}", rr.Scalars(value))
        self.stream.reset_time()

    def close(self) -> None:
        """Send what is left and let go."""
        self.stream.flush()
        self.stream.disconnect()


def check_live_target(target: Any) -> str:
    """Return where a live recording goes, or say what is wrong with it."""
    if not isinstance(target, str | os.PathLike):
        raise TypeError(f"live must be 'viewer', an address or a file name, got {brief(target)}")
    where = str(target)
    if where == "viewer" or "://" in where:
        return where
    if Path(where).suffix != ".rrd":
        raise ValueError(
            f"live must be 'viewer', an address such as rerun+http://... or end in .rrd, got {brief(where)}"
        )
    return str(writable_file("live", where))
