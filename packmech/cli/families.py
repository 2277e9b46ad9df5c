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
    map_name,
    read_columns,
    stress_over_strain,
    walk_both_ways,
)

Counts = Annotated[list[int] | None, Parameter(consume_multiple=True)]


def families(
    study: Literal["map", "slopes", "first-change", "stress"] = "map",
    *,
    out: Path = Path("families"),
    particles: Counts = None,
    packings: int = 10,
    applied_strain: float = 0.5,
    step: float = 2e-3,
    aspect: float = 1.0,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Shear packings at zero pressure along their families, or up to their first change of contacts; resumes.

    Parameters
    ----------
    study
        map: packing fraction at jamming over strain, each packing sheared up and back; slopes: how well d ln(phi_J) /
        d(strain) = -Sigma/P holds for discs and ellipses; first-change: its strain over pressure and number of discs;
        stress: shear stress over strain at distances above jamming
    out
        folder to write to
    particles
        numbers of discs (default: 10 for the map, 32 128 for the first change, 64 for the stress)
    packings
        of each, from seeds that follow each other
    applied_strain, step
        of the map
    aspect
        of the map's particles: 1 for discs, else ellipses
    seed
        of the first packing
    workers
        processes that share slopes and first changes (default: one for each core); 0: the command's own

    """
    integer("packings", packings, at_least=1)
    positive("applied_strain", applied_strain), positive("step", step), real("aspect", aspect, at_least=1.0)
    if study != "map" and aspect != 1.0:
        raise ValueError(f"aspect must be left out for {study}, got {aspect:g}")
    out.mkdir(parents=True, exist_ok=True)
    seeds = range(seed, seed + packings)
    if study == "map":
        if workers is not None:
            raise ValueError(f"workers must be left out for the map, got {workers}")
        counts = [10] if particles is None else particles
        with working("families") as say:
            for count in counts:
                for k, one in enumerate(seeds):
                    say(f"families: {k} of {packings} packings of {count}")
                    walk_both_ways(out, count, one, applied_strain, step, aspect)
        for count in counts:
            name = map_name(count, aspect)
            pieces = draw_map(out, count, out / f"{name}.png", aspect)
            _say_where_walks_end(out, name, applied_strain)
            show(f"wrote {name}-*.csv, {name.replace('map', 'changes')}-*.csv and {name}.png in {out}: {pieces} pieces")
    elif study == "slopes":
        _slopes(out, seed, workers)
    elif study == "stress":
        for count in [64] if particles is None else particles:
            _stress(out, count, seeds)
    else:
        _first_changes(out, [32, 128] if particles is None else particles, seeds, workers)


def _say_where_walks_end(out: Path, name: str, strain: float) -> None:
    """Name walks that ended before the strain was reached: the packing was lost."""
    for path in sorted(out.glob(f"{name}-*-up.csv")):
        end = float(read_columns(path)["strain"][-1])
        if end != strain:
            show(f"{path.name} ends at a strain of {end:.6g}: after a fall no jammed packing was found")


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
        fit, error, packings = fit_first_changes(found, large=large)
        powers = ", ".join(f"{name}^{x:.3f}({e:.3f})" for name, x, e in zip("PN", fit[1:], error[1:], strict=True))
        show(f"N^2 P {law}: strain = {np.exp(fit[0]):.3g} {powers}, from {packings} packings")
    show(table("first change of contacts, medians", head, rows, right=tuple(range(len(head)))))
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
