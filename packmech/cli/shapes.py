"""`packmech shapes`: jam ellipses, spheroids or rigid bodies; follow shear moduli up from jamming; local stability."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from packmech.check import integer, real
from packmech.cli.output import show, table, working
from packmech.validation.studies.annealing import ASPECTS as ANNEALED_ASPECTS
from packmech.validation.studies.annealing import PRESSURE as ANNEALED_PRESSURE
from packmech.validation.studies.annealing import STEPS, Annealed, anneal_all, draw_annealed, words_of
from packmech.validation.studies.bodies import JammedBodies, draw_bodies, jam_bodies
from packmech.validation.studies.preparations import (
    CYCLES,
    Prepared,
    draw_prepared,
    groups_of,
    prepare_all,
)
from packmech.validation.studies.preparations import PRESSURE as PREPARED_PRESSURE
from packmech.validation.studies.shapes import (
    ASPECTS,
    MODULUS_ASPECTS,
    PRESSURE,
    Jammed,
    Sheared,
    crossover,
    densest_aspect,
    draw_jammed,
    draw_moduli,
    exponent,
    jam_all,
    mean_and_error,
    over_aspect,
    shear_all,
)
from packmech.validation.studies.stability import (
    DISCS,
    LOCAL,
    MECHANICAL,
    Found,
    deform,
    draw_stability,
    exponent_of_energy,
    free_way,
    search,
    similar_pair,
    write_deformed,
    write_found,
)

# seeds of both searches for stable packings
_STARTS = 40
# which studies know an option
_HONORED = {
    "aspects": ("jammed", "moduli", "annealing"),
    "pressure": ("jammed", "bodies", "annealing", "preparations"),
    "scatter": ("bodies",),
    "steps": ("annealing",),
    "workers": ("jammed", "moduli", "bodies", "preparations"),
}
_PHI = "jamming_packing_fraction"
Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]


def shapes(
    study: Literal["jammed", "moduli", "bodies", "stability", "annealing", "preparations"] = "jammed",
    *,
    out: Path = Path("shapes"),
    dimension: int = 2,
    particles: int | None = None,
    packings: int | None = None,
    aspects: Numbers = None,
    pressure: float | None = None,
    scatter: float = 0.0,
    steps: Numbers = None,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Jam ellipses, spheroids or rigid bodies, follow shear moduli, or compare kinds of stability; resumes.

    Parameters
    ----------
    study
        "jammed", packing fraction, contacts and quartic modes over the aspect; "moduli", shear modulus over the
        distance above jamming; "bodies", dimers over their asymmetry and trimers over their bend, every strain free;
        "stability", equal discs in a square, mechanically stable beside only locally stable, moved along their lowest
        mode; "annealing", discs that become ellipses in small steps of the aspect, beside ellipses quenched from random
        places; "preparations", ellipses of aspect 1.5 quenched, sheared to and fro, tapped, and annealed. All but
        stability go on from what they find in the folder.
    out
        folder to write to
    dimension
        2: ellipses; 3: spheroids; sizes 1:1.4 in halves
    particles
        number of particles (default: 128 ellipses, 64 spheroids, bodies, or ellipses annealed or prepared; for moduli
        256; for stability 7)
    packings
        of each shape, from seeds that follow each other (default: 3); for stability, starts of both searches (40)
    aspects
        axis along the director over that across it
    pressure
        of jammed packings and bodies [energy scale / diameter^d] (default: 1e-7, for annealing and preparations 1e-6)
    scatter
        of bodies: by which part of them the radii of beads may be larger or smaller [1]
    steps
        of the aspect, for annealing (default: 0.05 and 0.005)
    seed
        of the first packing
    workers
        processes that share the work, but for stability and annealing (default: one for each core); 0: the command's
        own

    """
    integer("dimension", dimension, at_least=2, at_most=3)
    real("scatter", scatter, at_least=0.0, below=1.0)
    given = {"aspects": aspects, "pressure": pressure, "scatter": scatter or None, "steps": steps, "workers": workers}
    for name, studies in _HONORED.items():
        if given[name] is not None and study not in studies:
            raise ValueError(f"{name} must be left out for {study}: only {' and '.join(studies)} know it")
    if packings is None:
        packings = _STARTS if study == "stability" else 3
    seeds = range(seed, seed + integer("packings", packings, at_least=1))
    out.mkdir(parents=True, exist_ok=True)
    if study == "stability":
        if dimension != 2:
            raise ValueError(f"dimension must be 2 for stability, got {dimension}")
        _compare_stability(out, DISCS if particles is None else integer("particles", particles, at_least=3), seeds)
        return
    if study == "annealing":
        _anneal(
            out,
            64 if particles is None else particles,
            STEPS if steps is None else steps,
            ANNEALED_ASPECTS if aspects is None else aspects,
            ANNEALED_PRESSURE if pressure is None else pressure,
            seeds,
        )
        return
    if study == "preparations":
        many = 64 if particles is None else particles
        _prepare(out, many, PREPARED_PRESSURE if pressure is None else pressure, seeds, workers)
        return
    pressure = PRESSURE if pressure is None else pressure
    if study == "jammed":
        count = particles if particles is not None else {2: 128, 3: 64}[dimension]
        with working("shapes") as say:

            def show_progress(done: int, of: int, last: Jammed | None) -> None:
                note = "" if last is None else f"; aspect {last.aspect:g} gave {last.packing_fraction:.4f}"
                say(f"shapes: {done} of {of} packings{note}")

            jammed = jam_all(
                out,
                dimension=dimension,
                particles=count,
                aspects=ASPECTS if aspects is None else aspects,
                pressure=pressure,
                seeds=seeds,
                progress=show_progress,
                workers=workers,
            )
        draw_jammed(jammed, out, out / f"jammed-{dimension}d.png")
        _show_jammed(jammed)
        show(f"wrote jammed-{dimension}d.csv and jammed-{dimension}d.png in {out}")
        return
    if study == "bodies":
        _jam_bodies(out, dimension, 64 if particles is None else particles, pressure, seeds, scatter, workers)
        return
    count = particles if particles is not None else 256
    with working("shapes") as say:

        def noted(done: int, of: int, last: Sheared | None) -> None:
            note = "" if last is None else f"; aspect {last.aspect:g}, G = {last.shear_modulus:.3g}"
            say(f"shapes: {done} of {of} moduli{note}")

        found = shear_all(
            out,
            dimension=dimension,
            particles=count,
            aspects=MODULUS_ASPECTS if aspects is None else aspects,
            seeds=seeds,
            progress=noted,
            workers=workers,
        )
    draw_moduli(found, out / f"moduli-{dimension}d.png")
    rows = []
    for aspect in sorted({one.aspect for one in found}):
        cells = [
            exponent(found, aspect, low, high) for low, high in ((1e-5, 1e-4), (1e-4, 1e-3), (1e-3, 1e-2), (1e-2, 1e-1))
        ]
        cells.append(exponent(found, aspect, 2e-2, 1e-1))
        place, spread = crossover(found, aspect)
        rows.append(
            (f"{aspect:g}", *(f"{slope:.3f} +- {error:.3f}" for slope, error in cells), f"{place:.2g} +- {spread:.0%}")
        )
    head = ("aspect", "1e-5 to 1e-4", "to 1e-3", "to 1e-2", "to 1e-1", "2e-2 to 1e-1", "3/4 at")
    show(table("exponents of G over the distance above jamming", head, rows, right=tuple(range(len(head)))))
    show(f"wrote moduli-{dimension}d.csv and moduli-{dimension}d.png in {out}")


def _anneal(
    out: Path, particles: int, steps: Sequence[float], aspects: Sequence[float], pressure: float, seeds: range
) -> None:
    """Anneal and quench ellipses, and print and draw what came of it."""
    with working("shapes") as say:

        def show_progress(done: int, of: int, last: Annealed | None) -> None:
            note = "" if last is None else f"; aspect {last.aspect:g} gave {last.packing_fraction:.4f}"
            say(f"shapes: {done} of {of} packings{note}")

        found = anneal_all(
            out,
            particles=particles,
            steps=[0.0, *steps],
            aspects=aspects,
            pressure=pressure,
            seeds=seeds,
            progress=show_progress,
        )
    draw_annealed(found, out / "annealing.png")
    rows = []
    for step, aspect in sorted({(one.step, one.aspect) for one in found}):
        part = [one for one in found if (one.step, one.aspect) == (step, aspect)]
        rest = [one for one in part if one.converged]
        names = (_PHI, "coordination_number", "nematic_order", "local_order", "global_order")
        cells = [mean_and_error([getattr(one, name) for one in rest]) for name in names]
        texts = [f"{mean:.4f} +- {error:.4f}" for mean, error in cells]
        rows.append((words_of(step), f"{aspect:g}", *texts, f"{len(rest)} of {len(part)}"))
    head = ("made", "aspect", "packing fraction", "z", "nematic", "psi_6 local", "global", "at rest")
    show(table(f"N = {particles}, pressure {pressure:g}", head, rows, right=tuple(range(1, len(head)))))
    show(f"wrote annealed-*.csv, their packings, and annealing.png in {out}")


def _prepare(out: Path, particles: int, pressure: float, seeds: range, workers: int | None) -> None:
    """Prepare ellipses in all ways, and print and draw what came of each."""
    with working("shapes") as say:

        def show_progress(done: int, of: int, last: Prepared | None) -> None:
            note = "" if last is None else f"; {last.cycles} cycles gave {last.packing_fraction:.4f}"
            say(f"shapes: {done} of {of} packings{note}")

        found = prepare_all(
            out,
            particles=particles,
            cycles=CYCLES,
            pressure=pressure,
            seeds=seeds,
            progress=show_progress,
            workers=workers,
        )
    draw_prepared(found, out / "preparations.png")
    names = (_PHI, "coordination_number", "nematic_order", "local_order", "global_order")
    rows = []
    for words, done, part in groups_of(found):
        cells = [mean_and_error([getattr(one, name) for one in part]) for name in names]
        seconds = mean_and_error([one.seconds for one in part])[0]
        texts = [f"{mean:.4f} +- {error:.4f}" for mean, error in cells]
        rows.append((words, f"{done}", *texts, f"{len(part)} of {len(seeds)}", f"{seconds:.1f}"))
    head = ("prepared", "cycles", "packing fraction", "z", "nematic", "psi_6 local", "global", "at rest", "CPU s")
    show(table(f"N = {particles}, pressure {pressure:g}", head, rows, right=tuple(range(1, len(head)))))
    show(f"wrote preparations.csv and preparations.png in {out}")


def _jam_bodies(
    out: Path, dimension: int, particles: int, pressure: float, seeds: range, scatter: float, workers: int | None
) -> None:
    """Jam bodies of all shapes, and print and draw what came of each."""
    with working("shapes") as say:

        def show_progress(done: int, of: int, last: JammedBodies | None) -> None:
            note = "" if last is None else f"; {last.beads} beads gave {last.packing_fraction:.4f}"
            say(f"shapes: {done} of {of} packings{note}")

        found = jam_bodies(
            out,
            dimension=dimension,
            particles=particles,
            pressure=pressure,
            seeds=seeds,
            scatter=scatter,
            progress=show_progress,
            workers=workers,
        )
    name = f"bodies-{dimension}d" + (f"-{scatter:g}" if scatter else "")
    draw_bodies(found, out / f"{name}.png")
    rows = []
    for beads, shape in sorted({(one.beads, one.shape) for one in found}):
        part = [one for one in found if (one.beads, one.shape) == (beads, shape)]
        certain = [one for one in part if one.certain]
        means = [mean_and_error([getattr(one, name) for one in part]) for name in (_PHI, "coordination_number")]
        states = [one.states_of_self_stress - one.states_within_pairs for one in certain]
        isostatic = sum(
            count == 1 and one.floppy_modes == one.turning_freely for count, one in zip(states, certain, strict=True)
        )
        within = sum(one.states_within_pairs for one in part) / len(part)
        free = sum(one.turning_freely for one in part) / len(part)
        cells = [f"{mean:.4f} +- {error:.4f}" for mean, error in means]
        rows.append(
            (
                f"{beads}",
                f"{shape:g}",
                *cells,
                f"{free:.1f}",
                f"{within:.1f}",
                f"{len(certain)} of {len(part)}",
                f"{isostatic}",
            )
        )
    head = (
        *("beads", "radii or angle", "packing fraction", "z", "free turns", "self stress of pairs", "certain"),
        "isostatic but for these",
    )
    show(table(f"N = {particles}, d = {dimension}", head, rows, right=tuple(range(len(head)))))
    show(f"wrote bodies-{dimension}d.csv and {name}.png in {out}")


def _compare_stability(out: Path, particles: int, seeds: range) -> None:
    """Search for packings that are mechanically and only locally stable, move two of them, and print and draw that."""
    with working("shapes") as say:

        def show_progress(done: int, of: int, last: Found | None) -> None:
            say(f"shapes: {done} of {of} starts" + ("" if last is None else f"; {last.packing_fraction:.4f}"))

        found = search(seeds, show_progress, particles)
    write_found(found, out / "stability-found.csv")
    rows = []
    for kind in (MECHANICAL, LOCAL):
        part = [one for one in found if one.search == kind]
        fits = [one for one in part if one.fits]
        fractions = [one.packing_fraction for one in fits]
        reach = f"{min(fractions):.4f} to {max(fractions):.4f}" if fits else ""
        contacts = ", ".join(str(count) for count in sorted({one.contacts for one in fits}))
        rows.append((kind, f"{len(part)}", f"{len(fits)}", reach, contacts))
    head = ("search for", "packings", "that are", "packing fractions", "contacts")
    show(table(f"N = {particles} equal discs in a square", head, rows, right=(1, 2, 3, 4)))
    pair = similar_pair(found)
    moved = [deform(one) for one in pair]
    write_deformed([row for part in moved for row in part], out / "stability.csv")
    draw_stability(pair, [row for part in moved for row in part], out / "stability.png")
    show(
        f"mechanically stable, seed {pair[0].seed}: energy along the lowest mode grows with exponent "
        f"{exponent_of_energy(moved[0]):.3f}"
    )
    ahead, back = free_way(moved[1])
    show(f"locally stable, seed {pair[1].seed}: none up to {ahead:.3g} diameters one way, {back:.3g} the other")
    show(f"wrote stability-found.csv, stability.csv and stability.png in {out}")


def _show_jammed(found: list[Jammed]) -> None:
    """Print what came of each aspect."""
    rows = []
    columns = [
        over_aspect(found, name) for name in ("jamming_packing_fraction", "coordination_number", "quartic_modes")
    ]
    for k, aspect in enumerate(columns[0][0]):
        part = [one for one in found if one.aspect == aspect]
        certain = [one for one in part if one.certain]
        single = sum(one.states_of_self_stress == 1 for one in certain)
        least = min((one.smallest_curvature for one in certain), default=float("nan"))
        cells = [f"{mean[k]:.4f} +- {error[k]:.4f}" for _, mean, error in columns[:2]]
        rows.append(
            (
                f"{aspect:g}",
                *cells,
                f"{columns[2][1][k]:.1f}",
                f"{len(certain)} of {len(part)}",
                f"{single}",
                f"{least:.3g}",
            )
        )
    head = ("aspect", "packing fraction", "z", "quartic modes", "certain", "one self stress", "least curvature / P")
    show(table(f"N = {found[0].particles}, d = {found[0].dimension}", head, rows, right=tuple(range(len(head)))))
    peak, fraction = densest_aspect(found)
    show(f"densest at aspect {peak:.3f}: packing fraction {fraction:.4f}")
