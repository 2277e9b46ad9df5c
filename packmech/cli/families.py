"""`packmech families`: packings sheared at zero pressure, or up to the first change of their contacts; resumes."""

from __future__ import annotations

from dataclasses import astuple, fields
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from packmech.check import integer, positive, real
from packmech.cli.output import show, table, working
from packmech.result import csv_text
from packmech.validation.studies.families import (
    ASPECT,
    ELLIPSES,
    LARGE,
    PRESSURES,
    SLOPES,
    FirstChange,
    Slope,
    Stressed,
    compare_slopes,
    draw_first_changes,
    draw_map,
    draw_stress,
    first_changes,
    fit_first_changes,
    map_families,
    map_name,
    stress_over_strain,
)

Counts = Annotated[list[int] | None, Parameter(consume_multiple=True)]


def families(
    study: Literal["map", "slopes", "first-change", "stress"] = "map",
    *,
    out: Path = Path("families"),
    particles: Counts = None,
    packings: int | None = None,
    applied_strain: float | None = None,
    step: float | None = None,
    aspect: float | None = None,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Shear packings at zero pressure along their families, or up to their first change of contacts; resumes.

    Parameters
    ----------
    study
        map: packing fraction at jamming over strain, each packing sheared up and back; slopes: how well d ln(phi_J) /
        d(strain) = -Sigma/P holds for discs and ellipses; first-change: its strain at pressures 1e-2 to 1e-8, and over
        the number of discs;
        stress: shear stress over strain at distances above jamming
    out
        folder to write to
    particles
        their numbers (default: 10 for the map, 32 128 for the first change, 64 for the stress; given for the slopes)
    packings
        of each, from seeds that follow each other (default: 10); given for the slopes
    applied_strain
        of the map, its largest (default: 0.5)
    step
        of the map, between rows (default: 0.002)
    aspect
        of the map's particles: 1 for discs, else ellipses (default: 1)
    seed
        of the first packing
    workers
        processes that share the packings (default: one for each core); 0: the command's own; not for the stress

    """
    given = {"applied_strain": applied_strain, "step": step, "aspect": aspect}
    unused = [name for name, value in given.items() if value is not None and study != "map"]
    unused += ["workers"] if study == "stress" and workers is not None else []
    if study == "slopes":
        unused += [name for name, value in (("particles", particles), ("packings", packings)) if value is not None]
    if unused:
        raise ValueError(f"{unused[0]} must be left out for {study}")
    seeds = range(seed, seed + (10 if packings is None else integer("packings", packings, at_least=1)))
    strain = 0.5 if applied_strain is None else positive("applied_strain", applied_strain)
    size = 2e-3 if step is None else positive("step", step)
    ratio = 1.0 if aspect is None else real("aspect", aspect, at_least=1.0)
    out.mkdir(parents=True, exist_ok=True)
    if study == "map":
        _map(out, [10] if particles is None else particles, seeds, strain, size, ratio, workers)
    elif study == "slopes":
        _slopes(out, seed, workers)
    elif study == "stress":
        for count in [64] if particles is None else particles:
            _stress(out, count, seeds)
    else:
        _first_changes(out, [32, 128] if particles is None else particles, seeds, workers)


def _map(
    out: Path, counts: list[int], seeds: range, strain: float, step: float, aspect: float, workers: int | None
) -> None:
    """Shear packings up and back, draw their families, and say which were lost."""
    with working("families") as say:
        made = {}
        for count in counts:

            def show_progress(done: int, of: int, count: int = count) -> None:
                say(f"families: {done} of {of} packings of {count}")

            wanted = [(count, one, strain, step, aspect) for one in seeds]
            made[count] = map_families(out, wanted, show_progress, workers)
    for count, (tables, lost) in made.items():
        name = map_name(count, aspect)
        pieces = draw_map(tables, count, aspect, out / f"{name}.png")
        for words in lost:
            show(f"a packing was lost after a fall: {words}")
        show(f"{pieces} pieces of families")
        show(f"wrote {name}-*.csv, {name.replace('map', 'changes')}-*.csv and {name}.png in {out}")


def _slopes(out: Path, seed: int, workers: int | None) -> None:
    """Compare slopes, and print the largest differences."""
    wanted = [(count, 1.0, seed + k, strain) for count, many, strain in SLOPES for k in range(many)]
    wanted += [(count, ASPECT, seed + k, strain) for count, many, strain in ELLIPSES for k in range(many)]
    with working("families") as say:

        def show_progress(done: int, of: int, last: Slope | None) -> None:
            note = "" if last is None else f"; off by {last.largest_error:.1e}"
            say(f"families: slopes of {done} of {of} packings{note}")

        found = compare_slopes(out, wanted, show_progress, workers)
    rows = []
    for count, aspect in sorted({(one.particles, one.aspect) for one in found}):
        part = [one for one in found if (one.particles, one.aspect) == (count, aspect)]
        numbers = [sum(getattr(one, name) for one in part) for name in ("changes", "jumps", "compared")]
        error = np.nanmax([one.largest_error for one in part])
        rows.append((f"{count}", f"{aspect:g}", f"{len(part)}", *map(str, numbers), f"{error:.1e}"))
    head = ("N", "aspect", "packings", "changes", "jumps", "families compared", "largest error")
    show(table("d ln(phi_J)/d(strain) against -Sigma/P", head, rows, right=tuple(range(len(head)))))
    show(f"wrote slopes.csv in {out}")


def _first_changes(out: Path, counts: list[int], seeds: range, workers: int | None) -> None:
    """Find first changes, draw them, and print medians."""
    with working("families") as say:

        def show_progress(done: int, of: int, last: FirstChange | None) -> None:
            note = "" if last is None else f"; N = {last.particles}, P = {last.pressure:.1e}: {last.strain:.3e}"
            say(f"families: {done} of {of} first changes{note}")

        found = first_changes(
            out, particles=counts, pressures=PRESSURES, seeds=seeds, progress=show_progress, workers=workers
        )
    draw_first_changes(found, out / "first-change.png")
    rows = []
    for count in counts:
        for pressure in PRESSURES:
            part = [one for one in found if (one.particles, one.pressure) == (count, pressure)]
            part = [one for one in part if np.isfinite(one.strain)]
            if not part:
                continue
            strain = float(np.median([one.strain for one in part]))
            apart = max(abs(one.strain - one.strain_from_above) for one in part)
            shot = float(np.median([abs(one.one_shot / one.strain - 1.0) for one in part]))
            rows.append(
                (
                    f"{count}",
                    f"{pressure:.1e}",
                    f"{count**2 * pressure:.2g}",
                    f"{len(part)}",
                    f"{strain:.3e}",
                    f"{strain / pressure:.3g}",
                    f"{strain * count / pressure**0.5:.3g}",
                    f"{sum(one.opened for one in part)}",
                    f"{apart:.0e}",
                    f"{shot:.1e}",
                )
            )
    head = (
        "N",
        "P",
        "N^2 P",
        "packings",
        "strain",
        "strain/P",
        "strain N/sqrt P",
        "openings",
        "sides apart",
        "one shot",
    )
    for large, law in ((False, "small"), (True, "large")):
        if len(counts) < 2 or not any((one.particles**2 * one.pressure > LARGE) == large for one in found):
            continue
        try:
            fit, error, packings = fit_first_changes(found, large=large)
        except ValueError as reason:
            show(f"N^2 P {law}: no fit, {reason}")
            continue
        powers = ", ".join(f"{name}^{x:.3f}({e:.3f})" for name, x, e in zip("PN", fit[1:], error[1:], strict=True))
        show(f"N^2 P {law}: strain = {np.exp(fit[0]):.3g} {powers}, from {packings} packings")
    show(table("first change of contacts, medians over packings", head, rows, right=tuple(range(len(head)))))
    show(
        "openings: how many of them; sides apart: largest difference of the strains before and behind the change; "
        "one shot: median error of linear response at the start"
    )
    show(f"wrote first-change.csv and first-change.png in {out}")


def _stress(out: Path, particles: int, seeds: range) -> None:
    """Follow stress over strain, draw it, and print where it stops being linear."""
    found: list[Stressed] = []
    with working("families") as say:
        for seed in seeds:

            def show_progress(distance: float, seed: int = seed) -> None:
                say(f"families: packing {seed} at {distance:g} above jamming")

            found += stress_over_strain(particles, seed, "free", show_progress)
    rows = [astuple(one) for one in found]
    names = [one.name for one in fields(Stressed)]
    (out / f"stress-{particles}.csv").write_text(csv_text(names, rows), encoding="utf-8")
    draw_stress(found, out / f"stress-{particles}.png")
    lines = []
    for seed, distance in sorted({(one.seed, one.distance) for one in found}):
        part = [one for one in found if (one.seed, one.distance) == (seed, distance)]
        off = [one.strain for one in part if abs(one.shear_stress / (one.modulus * one.strain) - 1.0) > 0.05]
        change, least = part[-1].first_change, min(off, default=float("inf"))
        lines.append((f"{seed}", f"{distance:g}", f"{part[0].modulus:.3e}", f"{change:.3e}", f"{least:.1e}"))
    head = ("packing", "above jamming", "modulus", "first change", "not linear from")
    show(table(f"{particles} discs", head, lines, right=tuple(range(len(head)))))
    show(f"wrote stress-{particles}.csv and stress-{particles}.png in {out}")
