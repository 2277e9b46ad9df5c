"""`packmech analyze`: examine a packing in a file; nothing is moved."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import packmech as pm
from packmech.check import BoxStrain, one_of
from packmech.cli.output import (
    CertificateFile,
    Files,
    GapTolerance,
    Json,
    Load,
    Method,
    Modes,
    Record,
    check_modes,
    show,
    show_summary,
    title_of,
    working,
)
from packmech.effects import Friction, Law, Repulsion, registered_laws
from packmech.files.modules import load_modules
from packmech.files.packings import read_law, read_packing
from packmech.files.records import kind_of, kinds_of, to_table
from packmech.scene import Scene
from packmech.view.report import check_verdict_settings, examine

_STRAINS: tuple[BoxStrain, ...] = ("isotropic", "free")


def analyze(
    file: Annotated[Path, Parameter(help="a packing: .npz, .gsd, .data, .dump, .xyz, .csv, ... (pm.read_packing)")],
    /,
    *,
    load: Load = (),
    law: str | None = None,
    friction: float | None = None,
    strain: str = "isotropic",
    gap_tolerance: GapTolerance = None,
    method: Method = "certificate",
    record: Record = None,
    json: Json = None,
    certificate: CertificateFile = None,
    modes: Modes = 10,
) -> int:
    """Examine a packing made elsewhere; nothing is moved.

    Parameters
    ----------
    law
        harmonic, hertz, ... of energy scale 1; else the file's own law, else harmonic
    friction
        Coulomb's coefficient, of contacts whose tangential springs have stiffness 1, as in `packmech jam --friction`
    strain
        for the isostatic number of contacts: "isotropic" where the box kept its shape, "free" where all strains relaxed

    """
    load_modules(load)
    files, count = Files(record, None, json, certificate), check_modes(modes)
    check_verdict_settings(gap_tolerance, method)
    asked = one_of("strain", strain, _STRAINS)
    packing = read_packing(file)
    chosen, source = _law(file, law)
    if friction is None and packing.tangential is not None:
        raise ValueError(
            f"friction must be given for a packing that friction holds, got none with {packing.tangential.springs} "
            f"tangential springs in {str(file)!r}: give its coefficient, as --friction 0.5, or 0 to judge it without"
        )
    acting = () if not friction else (Friction(friction),)
    scene = Scene(packing if acting else packing.replace(tangential=None), (Repulsion(law=chosen), *acting))
    settings = {name: value for name, value in to_table(chosen).items() if name != "kind"}
    show(f"law: {kind_of(type(chosen))} {settings} ({source})")
    if friction is not None:
        show(f"friction: {to_table(acting[0]) if acting else 'none, tangential springs left out'} (as asked)")
    if acting and packing.tangential is not None and packing.tangential.at_wall_w is not None:
        show(f"walls: none, springs of {len(packing.tangential.at_wall_w)} particles at them left out")
    with working("analyzing") as say:
        report = examine(scene, strain=asked, modes=count, gap_tolerance=gap_tolerance, method=method, progress=say)
    title, summary, numbers = title_of(file.name, report), report.summary(), report.to_dict()
    show_summary(title, summary)
    files.write_json(numbers)
    files.say_what_was_written()
    if record is not None:
        pm.record_packing(
            scene,
            record,
            modes=report.modes,
            parameters={"file": file.name},
            results=numbers,
            summary=summary.markdown(title),
        )
        show(f"recording: {record}   (open it: rerun {record})")
    return files.write_certificate(report.verdict)


def _law(file: Path, name: str | None) -> tuple[Law, str]:
    """Return the law to examine a packing by, and where it is from."""
    laws = kinds_of(registered_laws())
    if name is not None:
        return laws[one_of("law", name, tuple(laws))](), "as asked"
    stored = read_law(file)
    return (laws["harmonic"](), "none is stored with it") if stored is None else (stored, "stored with it")
