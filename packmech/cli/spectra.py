"""`packmech spectra`: vibrational states near jamming, the end of their plateau, forces and gaps of hard packings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from packmech.check import integer
from packmech.cli.output import show, table, working
from packmech.validation.studies import spectra as study

Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]
# particles that a study takes by default
_PARTICLES = {"states": 120, "edges": 1024, "contacts": 256}


def spectra(
    what: Literal["states", "edges", "contacts"] = "states",
    *,
    out: Path = Path("spectra"),
    dimension: int = 2,
    particles: int | None = None,
    packings: int = 100,
    aspects: Numbers = None,
    distances: Numbers = None,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Find vibrational states near jamming, where their plateau ends, or hard packings' forces; resumes what it finds.

    Parameters
    ----------
    what
        states: modes of discs and ellipses 1e-4 above jamming, their rotational parts and participation ratios;
        edges: omega*, where the plateau of states of discs ends; contacts: forces and gaps of exact hard packings
    out
        folder to write to
    dimension
        2 or 3 (states of spheroids)
    particles
        number of particles (default: 120 for states, 1024 for edges, 256 for contacts)
    packings
        of each aspect, from seeds that follow each other
    aspects
        of the states (default: 1, 1.1, 1.5)
    distances
        of the edges, packing fractions above jamming (default: two a decade, 1e-5 to 1e-2)
    seed
        of the first packing
    workers
        processes that share the work (default: one for each core); 0: the command's own

    """
    integer("dimension", dimension, at_least=2, at_most=3)
    for name, values, of in (("aspects", aspects, "states"), ("distances", distances, "edges")):
        if values is not None and what != of:
            raise ValueError(f"{name} must be left out for {what}, got {values}")
    out.mkdir(parents=True, exist_ok=True)
    chosen: dict[str, Any] = {
        "dimension": dimension,
        "particles": _PARTICLES[what] if particles is None else particles,
        "seeds": range(seed, seed + packings),
        "workers": workers,
    }
    figure = out / f"{what}-{dimension}d.png"
    with working("spectra") as say:

        def show_progress(done: int, of: int, last: Any) -> None:
            say(f"spectra: {done} of {of} packings")

        chosen["progress"] = show_progress
        if what == "states":
            states = study.vibrate_all(out, aspects=study.ASPECTS if aspects is None else aspects, **chosen)
            study.draw_states(states, out, figure)
        elif what == "edges":
            given = study.EDGE_DISTANCES if distances is None else distances
            edges = study.edges_all(out, distances=given, **chosen)
            study.draw_edges(edges, figure)
            rows = [(f"{one[0]:.3g}", f"{one[1]:.4g}", f"{one[2]:.2g}", f"{one[3]}") for one in study.edge_rows(edges)]
            show(table("end of the plateau", ("above jamming", "omega*", "+-", "packings"), rows, right=(0, 1, 2, 3)))
        else:
            found = study.read_contacts(out, study.touch_all(out, **chosen))
            if not found:
                raise ValueError(
                    f"particles must leave hard packings with one state of self stress, got {chosen['particles']}: "
                    "none of them has; take more particles or packings"
                )
            study.draw_contacts(found, dimension, chosen["particles"], figure)
            lines = [
                (name, f"{value:.3f}", f"{error:.3f}", f"{count}", f"{theory:.4g}")
                for name, value, error, count, theory in study.exponents(found)
            ]
            title = f"small exponents, {len(found)} hard packings of {chosen['particles']}, d = {dimension}"
            show(table(title, ("density of", "exponent", "+-", "values", "mean field"), lines, right=(1, 2, 3, 4)))
    show(f"wrote {what}-{dimension}d.csv and {figure.name} in {out}")
