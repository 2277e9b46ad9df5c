"""The command that unjams: whether a packing is jammed, and if not, where its motion leads."""

from __future__ import annotations

import argparse
from pathlib import Path

from packmech.check import one_of
from packmech.cli_show import console, working, write_json
from packmech.packing import Packing
from packmech.report_table import rich_table


def unjam(given: argparse.Namespace) -> int:
    """Classify a packing, play its unjamming motion, record it and say what came of it; return the exit code."""
    from packmech.dynamics.play import play_motion
    from packmech.files import target_file
    from packmech.mechanics.jamming import classify_jamming

    one_of("box", given.box, ("fixed", "free", "either"))
    for path in (given.record, given.out, given.json):
        if path is not None:
            target_file(path, packing=path is given.out)
    if given.record is not None and given.record.suffix != ".rrd":  # the viewer goes by the ending
        raise ValueError(f"record must be a file name ending in .rrd, got {str(given.record)!r}")
    packing = _packing(given.packing, given.repeats)
    with working("is it jammed?") as tell:
        verdict = classify_jamming(packing, gap_tolerance=given.gap_tolerance, method=given.method)
        motion = {
            "fixed": verdict.collectively.unjamming_motion,
            "free": verdict.strictly.unjamming_motion,
            "either": verdict.unjamming_motion,
        }[given.box]
        answers = {
            "packing": given.packing,
            "particles": packing.particles,
            "local": verdict.local,
            "collective": verdict.collective,
            "strict": verdict.strict,
            "method": verdict.method,
            "gap_tolerance": verdict.touching.tolerance,
        }
        if motion is None:
            console().print(rich_table("unjam", ("quantity", "value"), _rows(answers), right=(1,)))
            if given.json is not None:
                write_json(given.json, answers | {"outcome": None, "reason": verdict.strictly.reason})
            console(error=True).print(f"packmech: no unjamming motion: {verdict.strictly.reason}")
            return 1
        played = play_motion(
            packing,
            motion,
            amplitude=given.amplitude,
            steps=given.steps,
            progress=lambda _, figures: tell(f"amplitude {figures['amplitude']:.3f} of {given.amplitude:g}"),
        )
        answers |= {
            "outcome": played.outcome,
            "reason": played.reason,
            "amplitude": played.amplitude,
            "steps": played.steps,
            "contacts": len(played.contacts),
            "opened": int(played.opened_t[-1]),
            "largest_closing": played.residual,
            "packing_fraction_start": float(played.packing_fraction_t[0]),
            "packing_fraction": float(played.packing_fraction_t[-1]),
            "seconds": played.seconds,
        }
        if given.record is not None:
            from packmech.recording_motion import record_motion

            tell("writing the recording")
            record_motion(played, given.record, parameters={"packing": given.packing, "box": given.box})
        if given.out is not None:
            from packmech.files import write_packing

            write_packing(played.packing, given.out)
    console().print(rich_table("unjam", ("quantity", "value"), _rows(answers), right=(1,)))
    if given.json is not None:
        write_json(given.json, answers)
    if given.record is not None:
        console().print(f"recording: {given.record}    (open it with: rerun {given.record})")
    return 0


def _packing(name: str, repeats: list[int] | None) -> Packing:
    from packmech.files import read_packing
    from packmech.generate import LATTICE_NAMES, lattice_packing

    if name in LATTICE_NAMES:
        return lattice_packing(name, repeats=None if repeats is None else repeats[0] if len(repeats) == 1 else repeats)
    if repeats is not None:
        raise ValueError(f"repeats must be left out for a packing in a file, got {repeats}")
    path = Path(name)
    if not path.exists():
        raise ValueError(f"packing must be a file or one of {', '.join(LATTICE_NAMES)}, got {name!r}")
    return read_packing(path)


def _rows(answers: dict[str, object]) -> list[tuple[str, str]]:
    return [
        (key.replace("_", " "), f"{value:.6g}" if isinstance(value, float) else str(value))
        for key, value in answers.items()
    ]
