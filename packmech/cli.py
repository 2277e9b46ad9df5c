"""The command `packmech`. Thin: each command is a few calls that Python users make too."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

FAILED, BAD_INPUT = 1, 2
# errors that speak for themselves; PACKMECH_TRACEBACK=1 shows where they came from
SPEAKING = (ValueError, TypeError, OSError, ImportError)

app = typer.Typer(
    help="Mechanics of jammed packings: make them, ask whether they are jammed, how stiff they are, how they vibrate.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Scene = Annotated[str, typer.Argument(help="A scene file (.toml), or the name of one that ships: `packmech scenes`.")]
Out = Annotated[Path | None, typer.Option("--out", help="Write the final packing: .npz (exact), .gsd or .txt.")]
Json = Annotated[Path | None, typer.Option("--json", help="Write the numbers as JSON.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Another seed for the scene's random start.")]
Modes = Annotated[int, typer.Option("--modes", min=0, help="How many of the lowest vibrations to find.")]
Record = Annotated[Path | None, typer.Option("--record", help="Where to write the Rerun recording.")]
Pressure = Annotated[
    float | None,
    typer.Option("--pressure", help="Pressure to end at, in energy_scale / diameter^d; the scene's if not given."),
]
Strain = Annotated[
    str | None,
    typer.Option(
        "--strain", help='"fixed" keeps the box\'s shape, "free" relaxes every strain; the scene\'s if not given.'
    ),
]


@app.command()
def jam(
    scene: Scene = "default",
    record: Record = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="Write no recording.")] = False,
    out: Out = None,
    json: Json = None,
    seed: Seed = None,
    pressure: Pressure = None,
    strain: Strain = None,
    modes: Modes = 10,
) -> None:
    """Jam a scene, say what the packing is, and leave a recording of it (jam.rrd unless --record says another)."""
    from packmech.cli_run import Outputs, jam_scene

    recording = None if no_record else record or Path("jam.rrd")
    outputs = Outputs(record=recording, out=out, json=json, modes=modes)
    raise typer.Exit(jam_scene(scene, outputs, seed=seed, pressure=pressure, strain=strain))


@app.command()
def run(
    scene: Scene,
    record: Record = None,
    out: Out = None,
    json: Json = None,
    seed: Seed = None,
    modes: Modes = 10,
) -> None:
    """Run what a scene's own [drive] says, then examine the packing. Records only where --record says to."""
    from packmech.cli_run import Outputs, run_scene

    raise typer.Exit(run_scene(scene, Outputs(record=record, out=out, json=json, modes=modes), seed=seed))


@app.command()
def analyze(
    file: Annotated[Path, typer.Argument(help="A packing: .npz, .gsd, or a text table of positions and radii.")],
    law: Annotated[
        str | None,
        typer.Option(
            "--law", help="harmonic, hertz, ... with energy_scale 1; the file's own law, or harmonic, if not given."
        ),
    ] = None,
    record: Record = None,
    json: Json = None,
    modes: Modes = 10,
) -> None:
    """Examine a packing made elsewhere: contacts, rattlers, verdict, moduli, vibrations. Nothing is moved."""
    from packmech.cli_run import Outputs, analyze_file

    raise typer.Exit(analyze_file(file, law, Outputs(record=record, out=None, json=json, modes=modes)))


@app.command()
def scenes() -> None:
    """List the scenes that ship inside the package."""
    from packmech.cli_show import console
    from packmech.report_table import rich_table
    from packmech.scene_file import list_scenes

    console().print(rich_table("scenes that ship", ("name", "what it is"), list_scenes().items(), right=()))


@app.command()
def accuracy(
    study: Annotated[str | None, typer.Argument(help="The study to run; all of them if not given.")] = None,
    out: Annotated[Path, typer.Option("--out", help="Folder for tables and figures.")] = Path("accuracy"),
) -> None:
    """Measure what accuracy costs in time: run the studies, write tables (.csv, .md) and figures (.png)."""
    from packmech.cli_studies import run_studies

    raise typer.Exit(run_studies(study, out))


@app.command("hard-cases")
def hard_cases(
    name: Annotated[str | None, typer.Argument(help="Only cases whose name contains this.")] = None,
) -> None:
    """Measure every hard case against its bound; exit code 1 if any is out of bounds."""
    from packmech.cli_studies import run_hard_cases

    raise typer.Exit(run_hard_cases(name))


def main() -> None:
    """Run the command; an error of the input or of convergence is one line and an exit code."""
    from packmech.outcome import NotConverged

    try:
        app()
    except (*SPEAKING, NotConverged) as error:
        if os.environ.get("PACKMECH_TRACEBACK"):
            raise
        print("packmech:", " ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        sys.exit(FAILED if isinstance(error, NotConverged) else BAD_INPUT)


if __name__ == "__main__":
    main()
