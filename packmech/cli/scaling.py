"""`packmech scaling`: follow packings towards or from the jamming point, and fit how they soften."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from packmech.cli.output import show, table, working
from packmech.ensemble.drawing import FITTED, draw_scaling
from packmech.ensemble.jamming_scaling import JammingScaling, jamming_scaling
from packmech.protocols.jam import HardVertex
from packmech.scenes.scene_file import read_scene

Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]
# quenches at a given packing fraction are decompressed to this pressure before the hard packing is looked for
_STOP_PRESSURE = 1e-4


def scaling(
    scene: str = "default",
    /,
    *,
    out: Path = Path("scaling"),
    packings: int = 20,
    over: Literal["pressure", "distance"] = "pressure",
    levels: Numbers = None,
    strain: str = "free",
    quenched_at: float | None = None,
    states: bool = False,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Follow packings over pressure or the distance to jamming: how moduli, contacts and energy fall; resumes.

    Parameters
    ----------
    scene
        scene file or shipped scene that is drawn again, from another seed, for each packing
    out
        folder to write to
    packings
        number of packings, of seeds that follow each other
    over
        pressure: from high to low; distance: packing fraction above each packing's own jamming, from low to high
    levels
        pressures [energy_scale / diameter^d] or distances (default: two a decade, 1e-2 to 1e-6, or 1e-5 to 1e-1)
    strain
        "free" relaxes every strain; "isotropic" keeps the shape of the box (many are unstable to shear then)
    quenched_at
        packing fraction of the quench from which they are decompressed to jamming
    states
        count vibrational states, too, for the end of their plateau
    seed
        of the first packing
    workers
        processes on this machine (default: one for each core); 0: the command's own

    """
    starts = [read_scene(scene, seed=seed + k) for k in range(packings)]
    method = None
    if quenched_at is not None:
        method = HardVertex(start_packing_fraction=quenched_at, stop_pressure=_STOP_PRESSURE)
    levels_p = np.logspace(-2.0, -6.0, 9) if over == "pressure" else np.logspace(-5.0, -1.0, 9)
    if levels is not None:
        levels_p = np.array(levels)
    with working("scaling") as say:

        def progress(stage: str, figures: dict[str, object]) -> None:
            if "done" in figures:
                say(f"scaling: {figures['done']} of {packings} packings")

        try:
            found = jamming_scaling(
                starts,
                levels_p if over == "pressure" else None,
                distances=levels_p if over == "distance" else None,
                strain=strain,
                method=method,
                states=states,
                folder=out / "members",
                workers=workers,
                progress=progress,
                check=False,
            )
        except KeyboardInterrupt as stop:
            # the packings that are there are worth as much as fewer that were asked for
            finished: JammingScaling | None = getattr(stop, "scaling", None)
            if finished is not None:
                _write(finished, out)
            raise
    _write(found, out)


def _write(found: JammingScaling, out: Path) -> None:
    """Write table and figure, and print the fits."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "scaling.csv").write_text(found.to_csv(), encoding="utf-8")
    draw_scaling(found, out / "scaling.png")
    asked = len(found.value_sp["residual"])
    title = (
        f"exponents where N does not show (packing fractions {found.counted_from:.2g} above jamming), "
        f"{found.packings} of {asked} packings of {found.particles}"
        + ("" if found.packings == asked else "; the others did not come to rest at every level")
    )
    head = ("quantity", "over", "exponent", "+-", "corrected", "+-", "correction", "theory")
    show(table(title, head, fits(found), right=tuple(range(2, len(head)))))
    show(f"wrote scaling.csv and scaling.png in {out}; {found.seconds:.3g} s CPU")


def fits(found: JammingScaling) -> list[tuple[str, ...]]:
    """Return a line for each quantity and what it is fitted over: exponents, errors, correction, theory."""
    rows = []
    for over in ("distance", "pressure"):
        for name in FITTED:
            if name not in found.names or name in (over, found.control):
                continue
            cells: list[str] = []
            for corrected in (False, True):
                try:
                    fit = found.fit(name, over=over, corrected=corrected)
                    cells += [f"{fit.exponent:.3f}", f"{fit.error:.3f}"]
                    correction = f"{fit.correction:.3g}" if corrected else ""
                except ValueError:
                    # too few levels, or a mean that is not positive
                    cells += ["-", "-"]
                    correction = "-"
            theory = found.theory(name, over=over)
            rows.append((name.replace("_", " "), over, *cells, correction, f"{theory:.4g}"))
    return rows
