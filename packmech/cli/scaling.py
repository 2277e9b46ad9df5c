"""`packmech scaling`: follow packings towards or from the jamming point, and fit how they soften."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from packmech.check import integer
from packmech.cli import FAILED
from packmech.cli.output import show, table, working
from packmech.ensemble.drawing import FITTED, draw_scaling, draw_sizes
from packmech.ensemble.jamming_scaling import Exponent, JammingScaling, fit_sizes, jamming_scaling
from packmech.protocols.jam import HardVertex
from packmech.result import csv_text
from packmech.scenes.scene_file import read_scene

Counts = Annotated[list[int] | None, Parameter(consume_multiple=True)]
Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]
# quenches at a given packing fraction are decompressed to this pressure before the hard packing is looked for
_STOP_PRESSURE = 1e-4
# laws of several N are also fitted up to these packing fractions above jamming
LARGEST = (0.1, 0.03)


def scaling(
    scene: str = "default",
    /,
    *,
    out: Path = Path("scaling"),
    particles: Counts = None,
    packings: int = 20,
    over: Literal["pressure", "distance"] = "pressure",
    levels: Numbers = None,
    strain: str = "free",
    quenched_at: float | None = None,
    states: bool = False,
    seed: int = 0,
    workers: int | None = None,
) -> int | None:
    """Follow packings over pressure or the distance to jamming: how moduli, contacts and energy fall; resumes.

    Parameters
    ----------
    scene
        scene file or shipped scene that is drawn again, from another seed, for each packing
    out
        folder to write to
    particles
        other numbers of particles than the scene's; several are fitted together, too, with what N sets
    packings
        number of packings of each, of seeds that follow each other
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
    method = None
    if quenched_at is not None:
        method = HardVertex(start_packing_fraction=quenched_at, stop_pressure=_STOP_PRESSURE)
    levels_p = np.logspace(-2.0, -6.0, 9) if over == "pressure" else np.logspace(-5.0, -1.0, 9)
    if levels is not None:
        levels_p = np.array(levels)
    integer("packings", packings, at_least=1)
    counts = [None] if particles is None else sorted({integer("particles", one, at_least=1) for one in particles})
    finished: list[JammingScaling] = []
    for count in counts:
        changes = None if count is None else {"packing.particles": count}
        starts = [read_scene(scene, seed=seed + k, changes=changes) for k in range(packings)]
        with working("scaling") as say:

            def progress(stage: str, figures: dict[str, object], of: int = starts[0].packing.particles) -> None:
                if "done" in figures:
                    say(f"scaling: {figures['done']} of {packings} packings of {of}")

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
        if found.packings:
            _write(found, out, len(counts) > 1)
            finished.append(found)
        else:
            show(f"none of {packings} packings of {found.particles} came to rest at every level")
    if len(finished) > 1:
        _show_sizes(finished, out)
    return None if len(finished) == len(counts) else FAILED


def _show_sizes(found: list[JammingScaling], out: Path) -> None:
    """Print, draw and write the power laws of all N together."""
    reached = max(float(one.mean_p("distance").max()) for one in found)
    bounds = [None, *(one for one in LARGEST if one < reached)]
    rows: list[tuple[str, ...]] = []
    reasons: dict[str, None] = {}
    fitted: list[tuple[object, ...]] = []
    drawn: dict[str, Exponent] = {}
    shown = bounds[1] if len(bounds) > 1 else None
    for name in FITTED:
        if name not in found[0].names or name == "distance":
            continue
        cells = []
        for largest in bounds:
            try:
                fit = fit_sizes(found, name, largest=largest)
                cells += [f"{fit.exponent:.3f}", f"{fit.error:.3f}", f"{fit.correction:.3g}", f"{fit.finite_size:.3g}"]
                if largest == shown:
                    drawn[name] = fit
                fitted.append((name, "" if largest is None else largest, *fit, found[0].theory(name, over="distance")))
            except ValueError as error:
                # too few levels, or a mean that is not positive
                cells += ["-"] * 4
                reasons[str(error)] = None
        rows.append((name.replace("_", " "), *cells, f"{found[0].theory(name, over='distance'):.4g}"))
    counts = ", ".join(str(one.particles) for one in found)
    names = [word for one in bounds for word in ("all" if one is None else f"x < {one:g}", "+-", "c", "b")]
    title = f"x^exponent (1 + c sqrt(x) + b / (N sqrt(x))), x distance to jamming, N = {counts} together"
    show(table(title, ("quantity", *names, "theory"), rows, right=tuple(range(1, len(names) + 2))))
    for reason in reasons:
        show(f"-: {reason}")
    columns = ("quantity", "largest_distance", *Exponent._fields, "theory")
    (out / "scaling-sizes.csv").write_text(csv_text(columns, fitted), encoding="utf-8")
    draw_sizes(found, drawn, shown, out / "scaling-sizes.png")
    show(f"wrote scaling-sizes.csv and scaling-sizes.png in {out}")


def _write(found: JammingScaling, out: Path, several: bool) -> None:
    """Write table and figure, named by N where there are several, and print the fits."""
    name = f"scaling-{found.particles}" if several else "scaling"
    out.mkdir(parents=True, exist_ok=True)
    (out / f"{name}.csv").write_text(found.to_csv(), encoding="utf-8")
    draw_scaling(found, out / f"{name}.png")
    asked = len(found.value_sp["residual"])
    title = (
        f"exponents above the plateau of N, from {found.counted_from:.2g} above jamming on, "
        f"{found.packings} of {asked} packings of {found.particles}"
        + ("" if found.packings == asked else "; the others did not come to rest at every level")
    )
    head = ("quantity", "over x", "levels", "x^exponent", "+-", "x^exponent (1 + c sqrt(x))", "+-", "c", "theory")
    rows, reasons = fits(found)
    show(table(title, head, rows, right=tuple(range(2, len(head)))))
    show(
        "+-: scatter of packings, choice of levels (nan: too few to leave one out), and what N does, which one N "
        "cannot tell from c (several N: --particles 64 256 1024)"
    )
    for reason in reasons:
        show(f"-: {reason}")
    show(f"wrote {name}.csv and {name}.png in {out}; {found.seconds:.3g} s CPU")


def fits(found: JammingScaling) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return a line for each quantity and what it is fitted over, and why fits are missing."""
    rows: list[tuple[str, ...]] = []
    reasons: dict[str, None] = {}
    for over in ("distance", "pressure"):
        for name in FITTED:
            if name not in found.names or name in (over, found.control):
                continue
            cells: list[str] = []
            correction, levels = "-", "-"
            for corrected in (False, True):
                try:
                    fit = found.fit(name, over=over, corrected=corrected)
                    cells += [f"{fit.exponent:.3f}", f"{fit.error:.3f}"]
                    correction = f"{fit.correction:.3g}" if corrected else "-"
                    levels = f"{fit.levels} of {fit.of_levels}"
                except ValueError as error:
                    # too few levels, or a mean that is not positive
                    cells += ["-", "-"]
                    reasons[str(error)] = None
            theory = found.theory(name, over=over)
            rows.append((name.replace("_", " "), over, levels, *cells, correction, f"{theory:.4g}"))
    return rows, list(reasons)
