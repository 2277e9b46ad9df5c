"""Recordings that are written frame by frame by whoever steps a packing: an environment, a protocol of one's own."""

from __future__ import annotations

import atexit
import os
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import drawing
from packmech.check import finite_array, instance, integer, real, table
from packmech.contacts import Contacts, find_contacts
from packmech.dynamics.march.touching import Touching
from packmech.frame import TOUCH, contact_forces, not_bonded
from packmech.march_film import MarchFilm, Moment, particle_colors, shown_box
from packmech.packing import Packing
from packmech.recording import property_values
from packmech.recording_film import Curve, Film, properties_of
from packmech.recording_march import BLOCK_NUMBERS, log_loop, log_march, send_moments
from packmech.scene import Scene

__all__ = ["Recording"]


class Recording:
    """A Rerun recording that is written frame by frame, with the look of those of `pm.record_run`.

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
        Names of two figures, across and up, that are drawn against each other too, such as ("strain", "stress").

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
        if not isinstance(path, str | os.PathLike):
            raise TypeError(f"path must be a file name, got {path!r}")
        instance("scene", scene, Scene)
        if parameters is not None:
            table("parameters", parameters)
        if loop is not None and not (
            isinstance(loop, tuple) and len(loop) == 2 and all(isinstance(name, str) for name in loop)
        ):
            raise TypeError(f"loop must be the names of two figures, got {loop!r}")
        self._writer = _Writer(Path(path).absolute(), scene, dict(parameters or {}), loop)
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
            What touches, with images for positions as they are, the (C,) forces, and (C,) who slides. Unless given, and
            with rigid links, the pairs that touch with the forces of the scene's effects.
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
        if not writer.linked:
            touching = _touching(packing, writer.scene.effects, contacts, force_c, sliding_c)
        told = _figures(figures)
        writer.take(Moment(at, when, packing, touching, None), told)

    def close(self, results: Mapping[str, Any] | None = None) -> Path:
        """Complete the file and return its absolute path; what was found is kept with it by name."""
        if results is not None:
            table("results", results)
            self._writer.results.update(results)
        self._finish()
        atexit.unregister(self._finish)
        return self.path

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *stopped: object) -> None:
        self.close()


def _touching(
    packing: Packing,
    effects: tuple[Any, ...],
    contacts: Contacts | None,
    force_c: ArrayLike | None,
    sliding_c: ArrayLike | None,
) -> Touching:
    """Return who touches, bonded pairs not among them, as it is drawn."""
    if contacts is None:
        if force_c is not None or sliding_c is not None:
            name = "force_c" if force_c is not None else "sliding_c"
            raise ValueError(f"{name} must come with the contacts that it belongs to, got no contacts")
        contacts = find_contacts(packing, gap_tolerance=TOUCH)
    elif not isinstance(contacts, Contacts) or contacts.particles != packing.particles:
        raise TypeError(f"contacts must be those of the packing (pm.find_contacts), got {type(contacts).__name__}")
    count = len(contacts)
    if force_c is not None and count:
        force = np.abs(finite_array("force_c", force_c, shape=(count,), what="contact"))
    else:
        force = contact_forces(contacts, effects)
    sliding = np.zeros(count, dtype=bool)
    if sliding_c is not None:
        sliding = np.asarray(sliding_c)
        if sliding.dtype != bool or sliding.shape != (count,):
            raise ValueError(f"sliding_c must be {count} booleans, got {sliding.dtype} of shape {sliding.shape}")
    apart = not_bonded(contacts, effects)
    contacts, force, sliding = contacts.select(apart), force[apart], sliding[apart]
    pushed = -force[:, None] * contacts.normal_cd
    return Touching(contacts.i_c, contacts.j_c, contacts.image_cd, force, pushed, sliding)


def _figures(figures: Mapping[str, float] | None) -> dict[str, float]:
    if figures is None:
        return {}
    table("figures", figures)
    told = {}
    for name, value in figures.items():
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
            raise TypeError(f"figures[{name!r}] must be a number, got {value!r:.60}")
        if np.isfinite(value):
            told[name] = float(value)
    return told


class _Writer:
    """What a recording holds until it is finished; knows nothing of the Recording, so that this can be forgotten."""

    def __init__(self, path: Path, scene: Scene, parameters: dict[str, Any], loop: tuple[str, str] | None) -> None:
        import rerun as rr

        self.path, self.scene, self.parameters, self.loop = path, scene, parameters, loop
        self.results: dict[str, Any] = {}
        self.frames, self.next_step = 0, 0
        packing = scene.packing
        self.linked = packing.links is not None
        self.color_nc = (
            drawing.particle_colors(packing.radius_n, np.zeros(packing.particles, dtype=bool), packing.links)
            if self.linked
            else particle_colors(scene, None)
        )
        self.block: list[Moment] = []
        self.size = max(1, BLOCK_NUMBERS // (packing.particles * packing.dimension * 12))
        # what the layout is made of: steps, figures, the first and the last moment, and those with the widest boxes
        self.step_f: list[int] = []
        self.curves: dict[str, tuple[list[int], list[float]]] = {}
        self.wide: list[Moment] = []
        self.reach = (np.full(packing.dimension, np.inf), np.full(packing.dimension, -np.inf))
        self.last: Moment | None = None
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb"):  # the writer only logs a file that it cannot open
            pass
        self.stream = rr.RecordingStream("packmech")
        self.stream.save(path)
        self.stream.send_recording_name(path.stem)
        self.tell(of_parameters=True)
        if self.linked:
            from packmech.recording import log_packing

            log_packing(self.stream, self.film([], {}), [], self.color_nc, "")
        else:
            log_march(self.stream, scene, self.color_nc)

    def film(self, packings: list[Packing], curves: Mapping[str, Curve]) -> Film:
        """Return the film that layouts and static entities are made of."""
        steps = np.array([self.step_f[0], self.step_f[-1]] if self.step_f else [0])
        return Film(steps, tuple(packings or [self.scene.packing]), self.scene.effects, curves)

    def tell(self, *, of_parameters: bool) -> None:
        """Write the parameters, or else the results, as properties."""
        told = properties_of(self.film([], {}), self.parameters, self.results)
        told = {name: value for name, value in told.items() if (name == "parameters_json") == of_parameters}
        self.stream.send_property("packmech", property_values(told))

    def checked(self, packing: Any) -> Packing:
        """Return the packing, or say why it is none of the scene's particles."""
        if not isinstance(packing, Packing):
            raise TypeError(f"packing must be a Packing, got {packing!r:.60}")
        mine = self.scene.packing
        if packing.particles != mine.particles or packing.dimension != mine.dimension:
            raise ValueError(
                f"packing must have the scene's {mine.particles} particles in {mine.dimension} dimensions, "
                f"got {packing.particles} in {packing.dimension}"
            )
        if not np.array_equal(packing.radius_n, mine.radius_n):
            raise ValueError("packing must have the scene's radii, got others")
        if (packing.links is None) == self.linked:
            raise ValueError(f"packing must have links as the scene has, got {packing.links!r:.40}")
        return packing

    def take(self, moment: Moment, figures: Mapping[str, float]) -> None:
        """Take a frame, and send a block of them when it is full."""
        self.block.append(moment)
        self.frames += 1
        self.next_step = moment.step + 1
        self.step_f.append(moment.step)
        for name, value in figures.items():
            step_t, value_t = self.curves.setdefault(name, ([], []))
            step_t.append(moment.step)
            value_t.append(value)
        self.last = moment
        box, _ = shown_box(moment.packing.box)
        corner = np.concatenate(drawing.box_outline(box))
        low, high = self.reach
        if (corner.min(axis=0) < low).any() or (corner.max(axis=0) > high).any():
            self.reach = np.minimum(low, corner.min(axis=0)), np.maximum(high, corner.max(axis=0))
            self.wide.append(moment)
        if len(self.block) >= self.size:
            self.send()

    def send(self) -> None:
        """Send the frames that are waiting."""
        block, self.block = self.block, []
        if not block:
            return
        if self.linked:
            from packmech.recording import send_block

            steps = np.array([moment.step for moment in block])
            film = Film(steps, tuple(moment.packing for moment in block), self.scene.effects, {})
            send_block(self.stream, film, range(len(block)), self.color_nc)
        else:
            send_moments(self.stream, self.scene, self.color_nc, block)

    def finish(self) -> None:
        """Send all that is left, with the layout, and let go of the file."""
        try:
            self.send()
            if self.last is not None:
                self.lay_out(self.last)
            self.tell(of_parameters=False)
        finally:
            self.stream.flush()
            self.stream.disconnect()

    def lay_out(self, last: Moment) -> None:
        """Send the curves and how the recording opens, which needs the names of all of them."""
        import rerun as rr

        from packmech.recording_layout import blueprint, march_blueprint

        curves: dict[str, Curve] = {
            name: (np.array(step_t), np.array(value_t)) for name, (step_t, value_t) in self.curves.items()
        }
        for name, (step_t, value_t) in curves.items():
            path = f"series/{name.replace(' ', '_')}"
            self.stream.log(path, rr.SeriesLines(names=name, colors=drawing.CURVE, widths=2.0), static=True)
            columns = rr.Scalars.columns(scalars=value_t)
            self.stream.send_columns(path, [rr.TimeColumn("step", sequence=step_t)], columns)
        # what does not change is in the file, and not plotted
        curves = {name: curve for name, curve in curves.items() if np.ptp(curve[1]) > 0.0}
        wide = [moment.packing.replace(box=shown_box(moment.packing.box)[0]) for moment in self.wide]
        if self.linked:
            layout = blueprint(self.film([*wide, last.packing], curves), [], summary=False)
        else:
            moments = [Moment(self.step_f[0], 0.0, one, None, None) for one in wide]
            shown = last.packing.replace(box=shown_box(last.packing.box)[0])
            moments.append(Moment(last.step, last.time, shown, None, None))
            film = MarchFilm(self.scene, tuple(moments), curves, *self.looped(curves), {})
            if self.loop is not None and len(film.strain_t):
                log_loop(self.stream, film, curves[self.loop[0]][0])
            layout = march_blueprint(film, summary=False)
        self.stream.send_blueprint(layout, make_active=True, make_default=True)

    def looped(self, curves: Mapping[str, Curve]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the two figures that are drawn against each other, where both are known."""
        if self.loop is None or any(name not in curves for name in self.loop):
            return np.zeros(0), np.zeros(0)
        (across_at, across), (up_at, up) = (curves[name] for name in self.loop)
        if not (np.array_equal(across_at, up_at) and np.ptp(across) > 0.0):
            return np.zeros(0), np.zeros(0)
        return across, up
