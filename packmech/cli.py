"""The command `packmech`. Thin: each command is a few calls that Python users make too.

Arguments are read by the standard library, because every run of the command waits for what is imported here.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

FAILED, BAD_INPUT = 1, 2
# errors that speak for themselves; PACKMECH_TRACEBACK=1 shows where they came from
SPEAKING = (ValueError, TypeError, OSError, ImportError)

ABOUT = "Mechanics of jammed packings: make them, ask whether they are jammed, how stiff they are, how they vibrate."
SCENE = "a scene file (.toml), or the name of one that ships (see `packmech scenes`)"


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    root = argparse.ArgumentParser(prog="packmech", description=ABOUT)
    root.add_argument("--version", action=_Version)
    commands = root.add_subparsers(dest="command", metavar="command", required=True)

    jam = _command(commands, "jam", "jam a scene, say what the packing is, and leave a recording of it")
    jam.add_argument("scene", nargs="?", default="default", help=SCENE + "; the default scene if not given")
    jam.add_argument("--pressure", type=float, help="pressure to end at [energy_scale / diameter^d]; else the scene's")
    jam.add_argument(
        "--strain", help='"fixed" keeps the shape of the box, "free" relaxes every strain; else the scene\'s'
    )
    jam.add_argument("--no-record", action="store_true", help="write no recording")
    _outputs(jam, record="jam.rrd", out=True, seed=True)

    run = _command(commands, "run", "do what a scene's own [drive] says, then examine the packing")
    run.add_argument("scene", help=SCENE)
    _outputs(run, record=None, out=True, seed=True)
    _pictures(run)
    run.add_argument(
        "--checkpoint",
        type=Path,
        metavar="FILE",
        help="strained scenes keep what is finished in this .npz file, and go on from it when it is there (default: a "
        "file named after the scene, taken away at the end): after Ctrl-C give the same command again",
    )

    analyze = _command(commands, "analyze", "examine a packing made elsewhere; nothing is moved")
    analyze.add_argument("file", type=Path, help="a packing: .npz, .gsd, or a text table of positions and radii")
    analyze.add_argument("--law", help="harmonic, hertz, ... of energy scale 1; else the file's own law, else harmonic")
    _judging(analyze)
    _outputs(analyze, record=None, out=False, seed=False)

    unjam = _command(commands, "unjam", "ask whether a packing is jammed, and play the motion that unjams it")
    _unjam_options(unjam)

    _command(commands, "scenes", "list the scenes that ship inside the package")

    accuracy = _command(commands, "accuracy", "measure what accuracy costs in time: tables and figures")
    accuracy.add_argument("study", nargs="?", help="the study to run; all of them if not given")
    accuracy.add_argument("--out", type=Path, default=Path("accuracy"), help="folder to write to (default: accuracy)")

    cement = _command(commands, "cement", "turn contacts into rigid links and follow the moduli; resumes what it finds")
    _cement_options(cement)

    cases = _command(commands, "hard-cases", "measure every hard case against its bound; exit code 1 if one is outside")
    cases.add_argument("name", nargs="?", help="only cases whose name contains this")
    return root


class _Version(argparse.Action):
    """Print the version; the metadata are read only when asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print the version and end")

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        from importlib.metadata import version

        print("packmech", version("packmech"))
        parser.exit()


def _command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, about: str
) -> argparse.ArgumentParser:
    return commands.add_parser(name, help=about, description=about[0].upper() + about[1:] + ".")


def _outputs(command: argparse.ArgumentParser, *, record: str | None, out: bool, seed: bool) -> None:
    """Add the options on what to write and how much to find."""
    default = None if record is None else Path(record)
    where = "not written unless given" if record is None else f"default: {record}"
    command.add_argument("--record", type=Path, metavar="FILE", default=default, help=f"Rerun recording ({where})")
    command.add_argument("--json", type=Path, metavar="FILE", help="write the numbers as JSON")
    command.add_argument(
        "--modes", type=int, default=10, help="how many of the lowest vibrations to find (default: 10)"
    )
    if out:
        command.add_argument("--out", type=Path, metavar="FILE", help="write the packing: .npz (exact), .gsd or .txt")
    if seed:
        command.add_argument("--seed", type=int, help="another seed for the scene's random start")


def _judging(command: argparse.ArgumentParser) -> None:
    """Add the options on how it is judged whether a packing is jammed."""
    command.add_argument(
        "--gap-tolerance",
        type=float,
        metavar="X",
        help="pairs touch up to this gap, in contact distances (default: 7 mean overlaps, at least 1e-9)",
    )
    command.add_argument(
        "--method", default="certificate", help='"certificate" (default): rank and forces; "loads": random loads'
    )


def _pictures(command: argparse.ArgumentParser) -> None:
    """Add the options on what to show on the way, and as pictures."""
    command.add_argument(
        "--live",
        nargs="?",
        const="viewer",
        metavar="WHERE",
        help="show the run as it goes on in the Rerun viewer, or at its address, or in a .rrd file",
    )
    command.add_argument(
        "--frames",
        type=int,
        metavar="N",
        help="write so many evenly spaced pictures, and the packing, to the folder --out (default: frames)",
    )
    command.add_argument("--format", default="png", help="of the pictures: png (default) or svg")


def _unjam_options(command: argparse.ArgumentParser) -> None:
    """Add the options of `packmech unjam`."""
    command.add_argument("packing", help="a packing in a file, or the name of a lattice: square, kagome, ...")
    command.add_argument("--repeats", type=int, nargs="+", metavar="N", help="cells of the lattice along each vector")
    command.add_argument(
        "--box", default="either", help='"fixed": the box stays; "free": it may strain; default: fixed if that unjams'
    )
    _judging(command)
    command.add_argument("--amplitude", type=float, default=0.5, help="how far to go, in diameters (default: 0.5)")
    command.add_argument("--steps", type=int, default=50, help="in how many steps (default: 50)")
    command.add_argument("--record", type=Path, metavar="FILE", help="Rerun recording (not written unless given)")
    command.add_argument("--out", type=Path, metavar="FILE", help="write the packing at the end: .npz, .gsd or .txt")
    command.add_argument("--json", type=Path, metavar="FILE", help="write the numbers as JSON")


def _cement_options(command: argparse.ArgumentParser) -> None:
    """Add the options of `packmech cement`."""
    command.add_argument("--out", type=Path, default=Path("cementing"), help="folder to write to (default: cementing)")
    command.add_argument(
        "--particles", type=int, nargs="+", metavar="N", help="sizes of the packings (default: 64 128 256)"
    )
    command.add_argument("--packings", type=int, help="packings of each size (default: 10)")
    command.add_argument("--orders", type=int, help="random orders of cementing of each packing (default: 20)")
    command.add_argument(
        "--full", action="store_true", help="the size of the source: N = 64 to 2048, 25 packings, 50 orders (days)"
    )
    command.add_argument("--seed", type=int, default=0, help="everything is drawn from it (default: 0)")
    command.add_argument("--step", type=float, default=0.05, help="moduli are measured every so much n_l/N (0.05)")
    command.add_argument(
        "--freeze", default="angles", help='"angles" (default): bond angles; "clusters": whole clusters; "nothing"'
    )
    command.add_argument("--processes", type=int, default=1, help="how many share the work (default: 1)")


def execute(given: argparse.Namespace) -> int:
    """Do what the command line says; return the exit code."""
    if given.command == "scenes":
        from packmech.cli_show import print_scenes

        return print_scenes()
    if given.command == "accuracy":
        from packmech.cli_studies import run_studies

        return run_studies(given.study, given.out)
    if given.command == "cement":
        from packmech.cli_cement import run_cement

        return run_cement(given)
    if given.command == "unjam":
        from packmech.cli_unjam import unjam

        return unjam(given)
    if given.command == "hard-cases":
        from packmech.cli_studies import run_hard_cases

        return run_hard_cases(given.name)

    from packmech.cli_run import Outputs, analyze_file, jam_scene, run_scene

    record = None if getattr(given, "no_record", False) else given.record
    out, folder, frames = getattr(given, "out", None), None, getattr(given, "frames", None)
    if frames is not None:
        folder = Path("frames") if out is None else out
        out = folder / "packing.npz"
    outputs = Outputs(
        record=record,
        out=out,
        json=given.json,
        modes=given.modes,
        live=getattr(given, "live", None),
        frames=frames,
        format=getattr(given, "format", "png"),
        folder=folder,
        checkpoint=getattr(given, "checkpoint", None),
    )
    if given.command == "jam":
        return jam_scene(given.scene, outputs, seed=given.seed, pressure=given.pressure, strain=given.strain)
    if given.command == "run":
        return run_scene(given.scene, outputs, seed=given.seed)
    return analyze_file(given.file, given.law, outputs, gap_tolerance=given.gap_tolerance, method=given.method)


def main() -> None:
    """Run the command; an error of the input or of convergence is one line and an exit code."""
    given = parser().parse_args()
    from packmech.outcome import NotConverged

    try:
        sys.exit(execute(given))
    except (*SPEAKING, NotConverged) as error:
        if os.environ.get("PACKMECH_TRACEBACK"):
            raise
        print("packmech:", " ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        sys.exit(FAILED if isinstance(error, NotConverged) else BAD_INPUT)
    except KeyboardInterrupt:
        print("packmech: interrupted", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
