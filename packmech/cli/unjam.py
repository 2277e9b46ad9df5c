"""`packmech unjam`: whether a packing is jammed, and if not, the motion that unjams it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import packmech as pm
from packmech.check import brief, one_of
from packmech.cli import FAILED
from packmech.cli.output import CertificateFile, Files, GapTolerance, Json, Method, Out, Record, show, table, working
from packmech.files.packings import read_packing
from packmech.generate import LATTICE_NAMES, lattice_packing
from packmech.jamming.classify import classify_jamming
from packmech.jamming.play import play_motion


def unjam(
    packing: Annotated[str, Parameter(help="a packing in a file, or the name of a lattice: square, kagome, ...")],
    /,
    *,
    repeats: Annotated[list[int] | None, Parameter(consume_multiple=True)] = None,
    strain: str = "either",
    gap_tolerance: GapTolerance = None,
    method: Method = "certificate",
    amplitude: float = 0.5,
    steps: int = 50,
    record: Record = None,
    out: Out = None,
    json: Json = None,
    certificate: CertificateFile = None,
) -> int:
    """Ask whether a packing is jammed, and play the motion that unjams it.

    Parameters
    ----------
    repeats
        cells of the lattice along each vector
    strain
        "none": the box stays; "free": it may strain; "either": none if that unjams
    amplitude
        how far to go, in diameters
    steps
        in how many steps

    """
    one_of("strain", strain, ("none", "free", "either"))
    files = Files(record, out, json, certificate)
    start = _packing(packing, repeats)
    with working("is it jammed?") as say:
        verdict = classify_jamming(start, gap_tolerance=gap_tolerance, method=method)
        motion = {
            "none": verdict.collectively.unjamming_motion,
            "free": verdict.strictly.unjamming_motion,
            "either": verdict.unjamming_motion,
        }[strain]
        answers = {
            "packing": packing,
            "particles": start.particles,
            "local": verdict.local,
            "collective": verdict.collective,
            "strict": verdict.strict,
            "method": verdict.method,
            "gap_tolerance": verdict.touching.tolerance,
        }
        if motion is None:
            _show(answers)
            files.write_json(answers | {"outcome": None, "reason": verdict.strictly.reason})
            show(f"packmech: no unjamming motion: {verdict.strictly.reason}", error=True)
            files.write_certificate(verdict)
            return FAILED
        played = play_motion(
            start,
            motion,
            amplitude=amplitude,
            steps=steps,
            progress=lambda _, figures: say(f"amplitude {figures['amplitude']:.3f} of {amplitude:g}"),
        )
        answers |= played.to_dict()
        if record is not None:
            say("writing the recording")
            pm.record_motion(played, record, parameters={"packing": packing, "strain": strain})
        files.write_packing(played.packing)
    _show(answers)
    files.write_json(answers)
    files.say_what_was_written()
    if record is not None:
        show(f"recording: {record}   (open it: rerun {record})")
    return files.write_certificate(verdict)


def _packing(name: str, repeats: list[int] | None) -> pm.Packing:
    if name in LATTICE_NAMES:
        return lattice_packing(name, repeats=None if repeats is None else repeats[0] if len(repeats) == 1 else repeats)
    if repeats is not None:
        raise ValueError(f"repeats must be left out for a packing in a file, got {repeats}")
    path = Path(name)
    if not path.exists():
        raise ValueError(f"packing must be a file or one of {', '.join(LATTICE_NAMES)}, got {brief(name)}")
    return read_packing(path)


def _show(answers: dict[str, object]) -> None:
    rows = [
        (key.replace("_", " "), f"{value:.6g}" if isinstance(value, float) else str(value))
        for key, value in answers.items()
    ]
    show(table("unjam", ("quantity", "value"), rows, right=(1,)))
