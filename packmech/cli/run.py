"""`packmech run`: do what the scene's own drive says; and how a scene is run, for the verbs that do."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

import packmech as pm
from packmech.check import FRAME_BYTES, integer, one_of
from packmech.cli import FAILED, INTERRUPTED, OK
from packmech.cli.changes import UNCHANGED, Changes
from packmech.cli.output import (
    SCENE,
    WHOLE,
    Files,
    Json,
    Load,
    Modes,
    Out,
    Record,
    Seed,
    Switch,
    Watch,
    check_modes,
    show,
    show_summary,
    table,
    title_of,
    working,
)
from packmech.effects import Bonds, bonds_of
from packmech.files.modules import load_modules
from packmech.files.paths import made_folder
from packmech.generate import fragment_numbers
from packmech.jit.interrupts import safe_interrupts
from packmech.observables import State, added_observables
from packmech.result import NotConverged, Run
from packmech.scene import Scene, scene_after
from packmech.scenes import run as run_drive
from packmech.scenes import takes_checkpoint
from packmech.view.report import Report, examine

# packings that a recording shows of a run that follows time
_RECORDED = 60


@dataclass(frozen=True)
class Pictures:
    """What to show of a run: live, as so many pictures in a folder."""

    live: str | None = None
    frames: int | None = None
    format: str = "png"
    folder: Path = Path("frames")

    def __post_init__(self) -> None:
        one_of("format", self.format, ("png", "svg"))
        if self.frames is not None:
            integer("frames", self.frames, at_least=2, bytes_each=FRAME_BYTES)
            made_folder("pictures", self.folder)
        if self.live is not None:
            from packmech.view.live import check_live_target

            check_live_target(self.live)


@dataclass(frozen=True)
class Wanted:
    """A scene, and what is wanted of its run.

    Attributes
    ----------
    name, scene, seed
        As the command line says.
    files, pictures
        What to write and what to show.
    modes
        How many of the lowest vibrations to find, where the packing is examined.
    checkpoint
        The file to go on from and to leave; None: one named after the scene, taken away at the end.

    """

    name: str
    scene: Scene
    seed: int | None
    files: Files
    pictures: Pictures
    modes: int
    checkpoint: Path | None = None

    @property
    def frames(self) -> int:
        """How many packings a run must keep on the way."""
        return max(_RECORDED if self.files.record is not None else 0, self.pictures.frames or 0)

    @property
    def own_checkpoint(self) -> Path | None:
        """The file named after the scene in this folder, unless nothing can be written there."""
        if not takes_checkpoint(self.scene) or not os.access(".", os.W_OK):
            return None
        return Path(f"{Path(self.name).stem}{'' if self.seed is None else f'-seed-{self.seed}'}.checkpoint.npz")


def run(
    scene: Annotated[str, Parameter(help=SCENE)],
    /,
    *,
    load: Load = (),
    changes: Changes = UNCHANGED,
    record: Record = None,
    no_record: Switch = False,
    out: Out = None,
    json: Json = None,
    modes: Modes = 10,
    seed: Seed = None,
    live: str | None = None,
    frames: Annotated[int | None, WHOLE] = None,
    pictures: Path = Path("frames"),
    format: str = "png",
    checkpoint: Path | None = None,
) -> int:
    """Do what a scene's own [drive] says, and report the result.

    Parameters
    ----------
    live
        show the run as it goes on in the Rerun viewer, or at its address, or in a .rrd file
    no_record
        write no recording, as without --record
    frames
        write so many evenly spaced pictures, at least 2, to the folder --pictures
    pictures
        the folder of the pictures
    format
        of the pictures: png or svg
    checkpoint
        scenes that are stepped through time keep what is finished in this .npz file, and go on from it when it is there
        (default: a file named after the scene, taken away at the end): after Ctrl-C give the same command again

    """
    load_modules(load)
    shown = Pictures(live, frames, format, pictures)
    files = Files(None if no_record else record, out, json)
    read = changes.scene(scene, seed=seed)
    if read.drive is None:
        raise ValueError(f"scene must have a [drive] to be run, got none in {scene!r}")
    return carry_out(Wanted(scene, read, seed, files, shown, check_modes(modes), checkpoint))


def carry_out(wanted: Wanted) -> int:
    """Run a scene, print the result and write what was asked for; return the exit code."""
    scene, files = wanted.scene, wanted.files
    path = wanted.own_checkpoint if wanted.checkpoint is None else wanted.checkpoint
    if path is not None and path.exists() and takes_checkpoint(scene):
        show(f"packmech: going on from {path}", error=True)
    done: Any = None
    report: Report | None = None
    code = OK
    with safe_interrupts(), working(f"{wanted.name}: {scene.packing.particles} particles") as say:
        try:
            with _live(wanted) as live:
                watch = Watch(say, live)
                done = _run(wanted, watch, path)
            done = _with_trace(done, scene, watch) if wanted.frames else done
            files.write_packing(_packing(done), scene)  # before the examination, which may be interrupted
            strain = getattr(scene.drive, "examined_strain", None)
            if strain is not None:
                start = scene_after(done, scene)
                report = examine(start, run=done, strain=strain, modes=wanted.modes, progress=say)
        except KeyboardInterrupt as stop:
            code, done = INTERRUPTED, getattr(stop, "run", done)
    if code == INTERRUPTED:
        _interrupted(wanted, done, path)
        if not hasattr(done, "runs"):
            return code
    _finish(wanted, done, report)
    if code == OK and path is not None and wanted.checkpoint is None:
        path.unlink(missing_ok=True)
    if code == OK:
        for one, label in _labeled(done):
            if isinstance(one, Run) and not one.ok:
                what = f"{label}: " if label else ""
                show(f"packmech: {what}{NotConverged(one)}", error=True)
                code = FAILED
    return code


def _run(wanted: Wanted, watch: Watch, path: Path | None) -> Any:
    """Return the run; where its checkpoint cannot be written at the end, say so, and the results are whole."""
    try:
        return run_drive(wanted.scene, frames=wanted.frames, progress=watch, checkpoint=path)
    except OSError as failure:
        if not hasattr(failure, "run"):
            raise
        show(f"packmech: the checkpoint could not be written: {failure}", error=True)
        return failure.run


@contextmanager
def _live(wanted: Wanted) -> Iterator[Callable[[str, dict[str, Any]], None] | None]:
    """Give what shows a run live, as far as that was asked for; end it when the run has ended."""
    if wanted.pictures.live is None:
        yield None
        return
    from packmech.view.live import LiveRecording

    live = LiveRecording(wanted.scene, wanted.pictures.live)
    try:
        yield live.watch
    finally:
        live.close()
        show(f"live: {live.shown} pictures")


def _with_trace(done: Any, scene: Scene, watch: Watch) -> Any:
    """Return a run that kept no packings with those that it passed on."""
    if not isinstance(done, Run) or done.trace is not None or not watch.step_t:
        return done
    # brings time stepping, which a run that is not recorded need not wait for
    from packmech.view.trajectory import trace_of

    return replace(done, trace=trace_of(scene, watch.step_t, watch.packing_t))


def _packing(done: Any) -> pm.Packing:
    """Return the last packing of a run, or of several."""
    last: Run = done.runs[-1] if hasattr(done, "runs") else done
    return last.packing


def _interrupted(wanted: Wanted, done: Any, path: Path | None) -> None:
    """Save what was finished, if there is anything and somewhere to put it, and say so."""
    words = "packmech: interrupted"
    if done is not None and wanted.files.out is not None:
        wanted.files.write_packing(_packing(done), wanted.scene)
        words += f"; the last finished packing is in {wanted.files.out}"
    show(words, error=True)
    if path is not None and path.exists():
        show(f"packmech: the same command goes on from {path}", error=True)


def _finish(wanted: Wanted, done: Any, report: Report | None) -> None:
    """Print the tables and write the numbers, the recordings and the pictures."""
    scene, files = wanted.scene, wanted.files
    about = done if report is None else report
    numbers, title = about.to_dict(), title_of(wanted.name, about)
    last: Run = done.runs[-1] if hasattr(done, "runs") else done
    after = scene_after(last, scene)
    numbers |= _measured(last, after)
    if bonds_of(scene.effects) is not None and report is None:
        # none may be left
        bonds = next(one for one in after.effects if isinstance(one, Bonds))
        numbers["bonds"] = len(bonds)
        numbers["fragments"] = int(fragment_numbers(bonds, after.packing.particles).max()) + 1
    if hasattr(done, "runs"):
        show(table(title, done.headings, done.lines()))
    else:
        show_summary(title, about.summary())
    if "cementing" in numbers:
        _show_cementing(numbers["cementing"])
    numbers |= _show_ledgers(done)
    files.write_json(numbers)
    files.say_what_was_written()
    parameters = {"scene": wanted.name, "seed": wanted.seed, "drive": scene.drive}
    for one, label in _labeled(done):
        if wanted.pictures.frames is not None:
            folder = wanted.pictures.folder / label if label else wanted.pictures.folder
            written = pm.write_pictures(
                one, folder, scene=scene, frames=wanted.pictures.frames, format=wanted.pictures.format
            )
            show(f"pictures: {len(written)} in {folder}")
        if files.record is not None:
            path = files.record.with_stem(f"{files.record.stem}-{label}") if label else files.record
            pm.record_run(
                one,
                path,
                scene=scene,
                modes=None if report is None else report.modes,
                parameters=parameters,
                results=one.to_dict() if label else numbers,
                summary=(one if label else about).summary().markdown(f"{title} {label}".strip()),
            )
            show(f"recording: {path}   (open it: rerun {path})")


def _measured(run: Run, after: Scene) -> dict[str, Any]:
    """Return what observables of a user's own say of the end of a run; what one of them fails at loses no other."""
    dt = getattr(run, "dt", None)
    moved = (getattr(run, "velocity_nd", None), getattr(run, "spin_nk", None))
    end = State(after.packing, after.effects, run.steps, None if dt is None else dt * run.steps, *moved)
    found = {}
    for one in added_observables():
        try:
            found[one.name] = one.of(end).tolist()
        except (ValueError, TypeError, ArithmeticError, LookupError) as error:
            show(f"packmech: observable {one.name} cannot be measured at the end: {error}", error=True)
    return found


def _show_ledgers(done: Any) -> dict[str, Any]:
    """Print where the energy of each run went, if it was accounted for; return it by name, of several runs a list."""
    listed = []
    for one, label in _labeled(done):
        ledger = getattr(one, "ledger", None)
        if ledger is not None:
            rows = [ledger.row(), *ledger.rows()]
            show(table(f"where the energy went {label}".strip(), ("", "", ""), rows, right=()))
            listed.append(ledger.to_dict())
    return {"ledger": listed if hasattr(done, "runs") else listed[0]} if listed else {}


def _labeled(done: Any) -> list[tuple[Run, str]]:
    """Return the runs, each with what its files are named by where there are several."""
    if not hasattr(done, "runs"):
        return [(done, "")]
    if len(done.runs) == 1:
        return [(done.runs[0], "")]
    return [(one, f"rate-{rate:g}") for one, rate in zip(done.runs, done.rate_r, strict=True)]


def _show_cementing(means: dict[str, Any]) -> None:
    """Print the table of a scene that was cemented, and its thresholds."""
    averages = ("Reuss", "Hill", "Voigt")
    names = [f"{modulus}_modulus_{name.lower()}" for modulus in ("bulk", "shear") for name in averages]
    names += ["poisson_ratio", "anisotropy"]
    headings = [f"{letter} {name}" for letter in "KG" for name in averages]
    rows = [
        (f"{fraction:.3f}", *(f"{means[name][k]:.4g}" for name in names))
        for k, fraction in enumerate(means["link_fraction"])
    ]
    orders = len(means["first_stiff"])
    title = f"cementing, mean of {orders} order{'' if orders == 1 else 's'}"
    show(table(title, ("n_l/N", *headings, "Poisson ratio", "anisotropy"), rows))
    if means["states_of_self_stress"] != 1:
        show(f"cemented from {means['states_of_self_stress']} states of self stress, not from one")
    for words, name in (("first infinitely stiff direction", "first_stiff"), ("complete rigidity", "all_stiff")):
        reached = [x for x in means[name] if x is not None]
        if reached:
            show(f"{words}: n_l/N = {np.mean(reached):.3f} ({len(reached)} of {orders} orders)")
