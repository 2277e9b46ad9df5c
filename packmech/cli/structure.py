"""`packmech structure`: order of jammed packings against disorder, and the spectral density of what they fill."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any, Literal

from packmech.check import integer
from packmech.cli.output import show, table, working
from packmech.measure.structure import CorrelationLength
from packmech.result import csv_text
from packmech.validation.studies.shapes import mean_and_error
from packmech.validation.studies.structure import (
    DIMERS,
    DISCS,
    ELLIPSES,
    KINDS,
    PRESSURE,
    SHOWN,
    SPECTRAL_PRESSURE,
    Ordered,
    contact_numbers,
    correlate,
    draw_contact_numbers,
    draw_dimers,
    draw_order,
    draw_spectrum,
    jam_all,
    measure_spectrum,
    spectral_packings,
)


def structure(
    study: Literal["order", "spectrum", "contacts"] = "order",
    *,
    out: Path = Path("structure"),
    particles: int | None = None,
    shaped: int | None = None,
    packings: int | None = None,
    pressure: float | None = None,
    k_min: float | None = None,
    k_max: float | None = None,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Measure order and correlation lengths against disorder, or the spectral density of packings; resumes.

    Parameters
    ----------
    study
        order: six-fold order over sizes and aspects, correlation lengths of both, numbers of contacts; spectrum: the
        spectral density of discs of two sizes, and its power law between two wave numbers; contacts: how many discs
        of two sizes have how many contacts
    out
        folder to write to
    particles
        number of discs (default: 1024, for the spectrum 16384, for contacts 128)
    shaped
        number of ellipses and of dimers, for order (default: 128); 0 leaves them out
    packings
        of each kind, from seeds that follow each other (default: 4, for the spectrum 1, for contacts 20)
    pressure
        of the jammed packings [energy scale / diameter^d] (default: 1e-6, for the spectrum 1e-3)
    k_min
        lower end of the spectrum's power law [1 / mean diameter] (default: 0.2)
    k_max
        its upper end (default: 2)
    seed
        of the first packing
    workers
        processes that share the work (default: one for each core); 0: the command's own

    """
    used = {"order": ("shaped", "pressure"), "spectrum": ("k_min", "k_max", "pressure"), "contacts": ()}[study]
    given = {"shaped": shaped, "k_min": k_min, "k_max": k_max, "pressure": pressure}
    for name, value in given.items():
        if value is not None and name not in used:
            raise ValueError(f"{name} must be left out for {study}, got {value:g}")
    out.mkdir(parents=True, exist_ok=True)
    count = packings if packings is not None else {"order": 4, "spectrum": 1, "contacts": 20}[study]
    seeds = range(seed, seed + count)
    if study == "contacts":
        _count_contacts(out, 128 if particles is None else integer("particles", particles, at_least=2), seeds, workers)
        return
    if study == "spectrum":
        many = 16384 if particles is None else particles
        with working("structure") as say:
            made = spectral_packings(
                out,
                many,
                seeds,
                SPECTRAL_PRESSURE if pressure is None else pressure,
                lambda done, of: say(f"structure: {done} of {of} packings"),
                workers,
            )
        found = measure_spectrum(made)
        low, high = 0.2 if k_min is None else k_min, 2.0 if k_max is None else k_max
        fit = found.filled.power_law(low, high)
        (out / "spectrum.csv").write_text(found.to_csv(), encoding="utf-8")
        draw_spectrum(found, fit, out / "spectrum.png")
        show(f"N = {many}: exponent {fit.exponent:.4f} +- {fit.exponent_error:.4f} for k d from {low:g} to {high:g}")
        show(f"wrote spectrum.csv and spectrum.png in {out}")
        return
    many, pressure = 1024 if particles is None else particles, PRESSURE if pressure is None else pressure
    with working("structure") as say:

        def show_progress(done: int, of: int, last: Ordered | None) -> None:
            note = "" if last is None else f"; {KINDS[last.kind]} {last.disorder:g} gave {last.global_order:.3f}"
            say(f"structure: {done} of {of} packings{note}")

        settings: dict[str, Any] = {
            "seeds": seeds,
            "pressure": pressure,
            "progress": show_progress,
            "workers": workers,
        }
        ordered = jam_all(out, particles=many, kinds=(DISCS,), **settings)
        count_shaped = 128 if shaped is None else shaped
        if count_shaped:
            ordered += jam_all(out, particles=count_shaped, kinds=(ELLIPSES, DIMERS), **settings)
    correlated = []
    for kind, disorder in itertools.product(KINDS, SHOWN):
        mine = [one for one in ordered if (one.kind, one.disorder, one.converged) == (kind, disorder, 1)]
        if mine:
            correlated.append(correlate(out, mine))
    draw_order(ordered, correlated, out, out / "order.png")
    if any(one.kind == DIMERS and one.converged for one in ordered):
        draw_dimers(ordered, out, out / "dimers.png")
    rows = []
    for kind, disorder in sorted({(one.kind, one.disorder) for one in ordered}):
        part = [one for one in ordered if (one.kind, one.disorder) == (kind, disorder)]
        names = ("packing_fraction", "coordination_number", "global_order", "local_order")
        cells = [mean_and_error([getattr(one, name) for one in part if one.converged]) for name in names]
        texts = [f"{mean:.4f} +- {error:.4f}" for mean, error in cells]
        rows.append((KINDS[kind], f"{disorder:g}", *texts, f"{sum(one.converged for one in part)} of {len(part)}"))
    head = ("kind", "disorder", "packing fraction", "z", "psi_6 global", "local", "at rest")
    show(table(f"pressure {pressure:g}", head, rows, right=tuple(range(1, len(head)))))
    lengths = [
        (KINDS[one.kind], f"{one.disorder:g}", *map(_length_words, (one.bond_length, one.pair_length)))
        for one in correlated
    ]
    title = "correlation lengths in mean diameters, through so many maxima"
    show(table(title, ("kind", "disorder", "of psi_6", "of g - 1"), lengths, right=(1, 2, 3)))
    show(f"wrote order.csv, order.png and, of dimers, dimers.png in {out}")


def _length_words(found: CorrelationLength) -> str:
    """Return a correlation length with its error and number of maxima."""
    count = len(found.r_m)
    return f"{found.length:.3f} +- {found.error:.3f} ({count})" if count > 2 else f"too few maxima ({count})"


def _count_contacts(out: Path, particles: int, seeds: range, workers: int | None) -> None:
    """Count contacts of discs of jammed packings, and print and draw how many have how many."""
    with working("structure") as say:

        def show_progress(done: int, of: int) -> None:
            say(f"structure: {done} of {of} packings")

        count = contact_numbers(out, particles=particles, seeds=seeds, progress=show_progress, workers=workers)
    shares = [(z, int(one), float(one / count.sum())) for z, one in enumerate(count)]
    (out / "contacts.csv").write_text(csv_text(("contacts", "discs", "share"), shares), encoding="utf-8")
    draw_contact_numbers(count, particles, out / "contacts.png")
    rows = [(f"{z}" if z else "rattlers", f"{one}", f"{share:.4f}") for z, one, share in shares]
    show(table(f"{len(seeds)} packings of {particles} discs", ("contacts", "discs", "share"), rows, right=(0, 1, 2)))
    show(f"wrote contacts.csv and contacts.png in {out}")
