"""What the commands show of a run while it goes on, and the pictures that they write of it afterwards."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol

from packmech.cli_show import console, print_results, write_json
from packmech.outcome import Run
from packmech.report_table import Row, summary_markdown
from packmech.scene import Scene

if TYPE_CHECKING:
    from packmech.cli_run import Outputs

# pictures of a run that is recorded as a film
RECORDED = 60


class Watch(Protocol):
    """Something that is told of progress."""

    def __call__(self, stage: str, figures: dict[str, Any]) -> None:
        """Take what a run tells of a stage."""


def nobody(stage: str, figures: dict[str, Any]) -> None:
    """Take what a run tells, and leave it at that."""


def telling(tell: Callable[[str], None], live: Watch = nobody) -> Watch:
    """Return what shows the plain figures of progress as words, and passes all of them on."""

    def told(stage: str, figures: dict[str, Any]) -> None:
        words = [f"{name} {value:.3g}" for name, value in figures.items() if isinstance(value, int | float)]
        tell(", ".join([stage, *words]))
        live(stage, figures)

    return told


@contextmanager
def live_watch(scene: Scene, outputs: Outputs) -> Iterator[Watch]:
    """Give what shows a run live, as far as that was asked for; end it when the run has ended."""
    if outputs.live is None:
        yield nobody
        return
    from packmech.recording_march import LiveRecording

    live = LiveRecording(scene, outputs.live)
    try:
        yield live.watch
    finally:
        live.close()
        console().print(f"live: {live.shown} moments")


def moments_wanted(outputs: Outputs) -> int:
    """Return how many moments a run must keep for what is to be written of it."""
    return max(RECORDED if outputs.record is not None else 0, outputs.frames if outputs.frames is not None else 0)


def write_frames(run: Run, scene: Scene, outputs: Outputs) -> None:
    """Write pictures of a run, if any were asked for."""
    if outputs.frames is None or outputs.folder is None:
        return
    from packmech.pictures import write_pictures

    written = write_pictures(run, outputs.folder, scene=scene, frames=outputs.frames, format=outputs.format)
    console().print(f"pictures: {len(written)} in {outputs.folder}")


def finish_run(
    name: str,
    title: str,
    rows: list[Row],
    numbers: dict[str, Any],
    run: Run,
    scene: Scene,
    outputs: Outputs,
    *,
    start: Scene | None = None,
    before: Run | None = None,
) -> int:
    """Print what a run came to, write what was asked for, and return the exit code.

    Parameters
    ----------
    name, title
        Of the scene, and of the table.
    rows, numbers
        Results to print, and by name.
    run, scene
        The run, and the scene that was asked for.
    outputs
        What to write.
    start, before
        The scene that was run, if it is another one, and the run that brought it there.

    """
    from packmech.cli_run import FAILED, OK, write_result

    print_results(title, rows, [*(() if before is None else before.stages), *run.stages])
    if outputs.out is not None:
        write_result(scene, run.packing, outputs.out)
        console().print(f"packing: {outputs.out}")
    if outputs.json is not None:
        write_json(outputs.json, numbers)
        console().print(f"numbers: {outputs.json}")
    summary = summary_markdown(title, rows, list(run.stages))
    told = {"scene": name, "drive": scene.drive}
    write_film(run, scene if start is None else start, outputs, parameters=told, results=numbers, summary=summary)
    code = OK
    for one in (before, run):
        if one is not None and not one.ok:
            console(error=True).print(f"packmech: {one.outcome.value} (residual {one.residual:.1e})")
            code = FAILED
    return code


def write_film(
    run: Run,
    scene: Scene,
    outputs: Outputs,
    *,
    parameters: Mapping[str, Any],
    results: Mapping[str, Any],
    summary: str,
) -> None:
    """Write pictures and a recording of a run, as far as they were asked for."""
    write_frames(run, scene, outputs)
    if outputs.record is None:
        return
    from packmech.recording import record_run

    record_run(run, outputs.record, scene=scene, parameters=parameters, results=results, summary=summary)
    console().print(f"recording: {outputs.record}   (look at it: rerun {outputs.record})")
