"""The commands that make or examine a packing: jam, run, analyze."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from packmech.check import integer, one_of
from packmech.cli_show import console, print_results, working, write_json
from packmech.cli_strain import STRAINED, strain_scene
from packmech.cli_watch import Watch, live_watch, moments_wanted, nobody, write_frames
from packmech.interrupts import safe_interrupts
from packmech.motion_drive import SimulateDrive
from packmech.outcome import Run, Stage
from packmech.packing import Packing
from packmech.recording_film import trace_of
from packmech.report import Report, check_judging, examine
from packmech.report_table import result_rows, summary_markdown
from packmech.scene import (
    CementDrive,
    Drive,
    JamDrive,
    QuenchDrive,
    Scene,
    ShearStabilizeDrive,
)

OK, FAILED, INTERRUPTED = 0, 1, 130


@dataclass(frozen=True)
class Outputs:
    """What to write, how many vibrations to find, what to show (live, as pictures in a folder), what to go on from."""

    record: Path | None
    out: Path | None
    json: Path | None
    modes: int
    live: str | None = None
    frames: int | None = None
    format: str = "png"
    folder: Path | None = None
    checkpoint: Path | None = None

    def check(self) -> None:
        """Fail before the work, not after it, when a file cannot be written."""
        from packmech.files import target_file

        one_of("format", self.format, ("png", "svg"))
        if self.frames is not None and self.folder is not None:
            integer("frames", self.frames, at_least=2)
            self.folder.mkdir(parents=True, exist_ok=True)
        if self.live is not None:
            from packmech.recording_march import check_target

            check_target(self.live)
        for path in (self.record, self.out, self.json):
            if path is not None:
                target_file(path, packing=path is self.out)
        if self.record is not None and self.record.suffix != ".rrd":  # the viewer goes by the ending
            raise ValueError(f"record must be a file name ending in .rrd, got {str(self.record)!r}")
        integer("modes", self.modes, at_least=0)


def jam_scene(name: str, outputs: Outputs, *, seed: int | None, pressure: float | None, strain: str | None) -> int:
    """Jam the scene as its drive says, unless told otherwise; return the exit code."""
    from packmech.scene_file import read_scene

    outputs.check()
    scene = read_scene(name, seed=seed)
    drive = scene.drive if isinstance(scene.drive, JamDrive) else JamDrive()
    drive = replace(
        drive,
        pressure=drive.pressure if pressure is None else pressure,
        strain=drive.strain if strain is None else strain,
    )
    return _run_and_report(name, scene.replace(drive=drive), outputs, {"scene": name, "seed": seed})


def run_scene(name: str, outputs: Outputs, *, seed: int | None) -> int:
    """Do what the scene's drive says; return the exit code."""
    from packmech.scene_file import read_scene

    outputs.check()
    scene = read_scene(name, seed=seed)
    if scene.drive is None:
        raise ValueError(f"scene must have a [drive] to be run, got none in {name!r}")
    if isinstance(scene.drive, STRAINED):
        return strain_scene(name, scene, outputs, seed=seed)
    if outputs.checkpoint is not None:
        raise ValueError(
            f"checkpoint must be left out for a scene that is not strained, got {str(outputs.checkpoint)!r}"
        )
    if isinstance(scene.drive, SimulateDrive):
        from packmech.cli_simulate import simulate_scene

        return simulate_scene(name, scene, outputs)
    return _run_and_report(name, scene, outputs, {"scene": name, "seed": seed})


def analyze_file(
    path: Path, law: str | None, outputs: Outputs, *, gap_tolerance: float | None = None, method: str = "certificate"
) -> int:
    """Examine a packing in a file; return the exit code."""
    from packmech.effects import Repulsion
    from packmech.files import read_law, read_packing
    from packmech.records import kind_of

    outputs.check()
    check_judging(gap_tolerance, method)
    packing = read_packing(path)
    stored = read_law(path) if law is None else None
    chosen = stored if stored is not None else _law(law or "harmonic")
    source = "stored with it" if stored is not None else "as asked" if law is not None else "none is stored with it"
    scene = Scene(packing, (Repulsion(law=chosen),))
    console().print(f"law: {kind_of(type(chosen))} {chosen._asdict()} ({source})")
    with working("analyzing") as tell:
        report = examine(scene, modes=outputs.modes, gap_tolerance=gap_tolerance, method=method, told=tell)
    _finish(path.name, scene, None, report, outputs, {"file": path.name})
    return OK


def _law(name: str) -> Any:
    from packmech.effects import registered_laws
    from packmech.records import kinds_of

    laws = kinds_of(registered_laws())
    return laws[one_of("law", name, tuple(laws))]()


def _run_and_report(name: str, scene: Scene, outputs: Outputs, parameters: Mapping[str, Any]) -> int:
    with safe_interrupts(), working(f"{name}: {scene.packing.particles} particles") as tell:
        run: Run | None = None
        try:
            with live_watch(scene, outputs) as live:
                run = _drive(scene, tell, live, keep=moments_wanted(outputs) > 0)
            if outputs.out is not None:  # before the examination, which may be interrupted
                write_result(scene, run.packing, outputs.out)
            report = examine(
                scene.replace(packing=run.packing), strain=_strain(scene.drive), modes=outputs.modes, told=tell
            )
        except KeyboardInterrupt as stop:
            return interrupted(scene, getattr(stop, "run", run), outputs)
        cemented: dict[str, Any] | None = None
        try:
            if isinstance(scene.drive, CementDrive) and run.ok:
                from packmech.cli_cement import cement_scene

                cemented = cement_scene(scene.replace(packing=run.packing), scene.drive, tell)
        except KeyboardInterrupt:
            return interrupted(scene, run, outputs)
    if cemented is not None:
        report = replace(report, numbers={**report.numbers, "cementing": cemented})
    _finish(name, scene, run, report, outputs, parameters)
    write_frames(run, scene, outputs)
    if cemented is not None:
        from packmech.cli_cement import print_cementing

        print_cementing(cemented)
    if not run.ok:
        console(error=True).print(f"packmech: {run.outcome.value} (residual {run.residual:.1e})")
        return FAILED
    return OK


def _strain(drive: Drive | None) -> str:
    if isinstance(drive, JamDrive):
        return drive.strain
    return "free" if isinstance(drive, ShearStabilizeDrive | CementDrive) else "fixed"


def interrupted(scene: Scene, run: Run | None, outputs: Outputs) -> int:
    """Save what was finished, if there is anything and somewhere to put it."""
    words = "packmech: interrupted"
    if run is not None and outputs.out is not None:
        write_result(scene, run.packing, outputs.out)
        words += f"; the last finished packing is in {outputs.out}"
    console(error=True).print(words)
    return INTERRUPTED


def _drive(scene: Scene, tell: Callable[[str], None], live: Watch = nobody, *, keep: bool) -> Run:
    """Do what the scene's drive says; keep packings on the way when they are to be recorded."""
    drive = scene.drive
    watch = _Snapshots(tell, live)
    if isinstance(drive, QuenchDrive):
        from packmech.dynamics.quench import quench

        every = max(10, scene.packing.particles // 10) if keep else None
        return quench(
            scene,
            force_tolerance=drive.force_tolerance,
            method=drive.method,
            trace_every=every,
            trace_positions=keep,
            progress=watch,
            check=False,
        )
    if isinstance(drive, ShearStabilizeDrive):
        from packmech.dynamics.shear_stabilize import shear_stabilize

        watch.keep(0, scene.packing)
        run = shear_stabilize(
            scene, pressure=drive.pressure, force_tolerance=drive.force_tolerance, progress=watch, check=False
        )
        return replace(run, trace=trace_of(scene, watch.step_t, watch.packing_t)) if keep else run
    from packmech.dynamics.jam import jam

    if isinstance(drive, CementDrive):
        drive = JamDrive(pressure=drive.pressure)
    assert isinstance(drive, JamDrive)
    run = jam(scene, pressure=drive.pressure, strain=drive.strain, method=drive.method, progress=watch, check=False)
    return replace(run, trace=trace_of(scene, watch.step_t, watch.packing_t)) if keep else run


class _Snapshots:
    """Progress of a run: its words are shown; packings that it passes on are kept, thinned evenly."""

    MOST = 240

    def __init__(self, tell: Callable[[str], None], live: Watch = nobody) -> None:
        self.tell, self.live = tell, live
        self.step_t: list[int] = []
        self.packing_t: list[Packing] = []
        self._before = 0
        self._seen = 0
        self._every = 1

    def __call__(self, stage: str, figures: dict[str, Any]) -> None:
        words = [f"{name} {value:.3g}" for name, value in figures.items() if isinstance(value, int | float)]
        self.tell(", ".join([stage, *words]))
        self.live(stage, figures)
        steps = int(figures.get("steps", 0))
        if "packing" in figures:
            # a stage that does not count its steps shows one packing after the other
            after = self.step_t[-1] + 1 if self.step_t and "steps" not in figures else 0
            self.keep(max(self._before + steps, after), figures["packing"])
        if "seconds" in figures:  # a stage has ended; the next counts its own steps
            self._before += steps

    def keep(self, step: int, packing: Packing) -> None:
        """Keep a packing, unless it is one too many or of no later step."""
        self._seen += 1
        if self._seen % self._every or (self.step_t and step <= self.step_t[-1]):
            return
        self.step_t.append(step)
        self.packing_t.append(packing)
        if len(self.step_t) > self.MOST:
            self._every *= 2
            del self.step_t[::2], self.packing_t[::2]


def write_result(scene: Scene, packing: Packing, path: Path) -> None:
    """Write the packing, and the scene's law with it where the format has a place for it."""
    from packmech.effects import law_of
    from packmech.files import write_packing

    write_packing(packing, path, law=law_of(scene.effects) if path.suffix == ".npz" else None)


def _finish(
    name: str, scene: Scene, run: Run | None, report: Report, outputs: Outputs, parameters: Mapping[str, Any]
) -> None:
    """Print the tables and write the files."""
    numbers = dict(report.numbers)
    stages = list(report.stages)
    if run is not None:
        numbers |= numbers_of_run(run)
        if report.numbers["force_residual"] is None:  # no contact carries a force
            numbers["force_residual"] = None
        stages = [*(run.stages or (stage_of_run(run),)), *stages]
    else:
        numbers["seconds"] = sum(stage.seconds for stage in stages)
    rows = result_rows(numbers, report.missing)
    count = scene.packing.particles
    kind = "disc" if scene.packing.dimension == 2 else "sphere"
    title = f"{name}: {count} {kind}{'' if count == 1 else 's'}"
    print_results(title, rows, stages)
    out = console()
    if outputs.out is not None:
        out.print(f"packing: {outputs.out}")
    if outputs.json is not None:
        write_json(outputs.json, numbers)
        out.print(f"numbers: {outputs.json}")
    if outputs.record is not None:
        _record(scene, run, report, outputs.record, parameters, numbers, summary_markdown(title, rows, stages))
        out.print(f"recording: {outputs.record}   (look at it: rerun {outputs.record})")


def numbers_of_run(run: Run) -> dict[str, Any]:
    """Return what a run says of itself, by name; what is counted anew from its packing is left to the report."""
    told = {
        "outcome": run.outcome.name.lower(),
        "force_residual": run.residual,
        "steps": run.steps,
        "force_evaluations": run.force_evaluations,
        "seconds": run.seconds,
        "build_seconds": run.build_seconds,
    }
    further = (
        "method",
        "jamming_packing_fraction",
        "pressure_asked",
        "stress_anisotropy",
        "gap_error",
        "force_imbalance",
    )
    told |= {name: run.report[name] for name in further if name in run.report}
    if "patches" in run.report:
        told["redundant_patches"] = [np.asarray(patch).tolist() for patch in run.report["patches"]]
    return told


def stage_of_run(run: Run) -> Stage:
    """Return a run without parts of its own as one step."""
    return Stage("run", run.residual, run.steps, run.force_evaluations, run.seconds, run.outcome.name.lower())


def _record(
    scene: Scene,
    run: Run | None,
    report: Report,
    path: Path,
    parameters: Mapping[str, Any],
    numbers: Mapping[str, Any],
    summary: str,
) -> None:
    from packmech.recording import record_packing, record_run

    told = {**parameters, "drive": scene.drive}
    if run is None:
        record_packing(scene, path, modes=report.modes, parameters=told, results=numbers, summary=summary)
    else:
        record_run(run, path, scene=scene, modes=report.modes, parameters=told, results=numbers, summary=summary)
