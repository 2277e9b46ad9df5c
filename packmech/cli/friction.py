"""`packmech friction`: press packings with more and more friction, and draw what it does to them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from packmech.check import integer
from packmech.cli.output import show, table, working
from packmech.validation.studies.friction import COEFFICIENTS, Pressed, draw_friction, over_friction, press_all

Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]


def friction(
    *,
    out: Path = Path("friction"),
    dimension: int = 2,
    particles: int | None = None,
    packings: int = 3,
    coefficients: Numbers = None,
    stiffness_ratios: Numbers = None,
    pressures: Numbers = None,
    rates: Numbers = None,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Press packings with more and more friction: packing fraction and coordination; resumes what it finds.

    Parameters
    ----------
    out
        folder to write to
    dimension
        2: discs 1:1.4; 3: equal spheres
    particles
        number of particles (default: 256 discs, 512 spheres)
    packings
        of each kind, from seeds that follow each other
    coefficients
        of friction (default: 0 .01 .1 .5 1 10)
    stiffness_ratios
        tangential over normal stiffness (default: 1)
    pressures
        in units of the stiffness (default: 1e-4)
    rates
        largest rates of strain [sqrt(k / m)] (default: 1e-4)
    seed
        of the first packing
    workers
        processes that share the work (default: one for each core); 0: the command's own

    """
    integer("dimension", dimension, at_least=2, at_most=3)
    count = particles if particles is not None else {2: 256, 3: 512}[dimension]
    out.mkdir(parents=True, exist_ok=True)
    with working("friction") as say:

        def progress(done: int, of: int, last: Pressed | None) -> None:
            note = "" if last is None else f"; mu = {last.coefficient:g} gave {last.packing_fraction:.4f}"
            say(f"friction: {done} of {of} packings{note}")

        found = press_all(
            out / f"friction-{dimension}d.csv",
            dimension=dimension,
            particles=count,
            coefficients=COEFFICIENTS if coefficients is None else coefficients,
            ratios=(1.0,) if stiffness_ratios is None else stiffness_ratios,
            pressures=(1e-4,) if pressures is None else pressures,
            rates=(1e-4,) if rates is None else rates,
            seeds=range(seed, seed + packings),
            progress=progress,
            workers=workers,
        )
    draw_friction(found, out / f"friction-{dimension}d.png")
    rows = []
    for ratio, pressure, rate in sorted({(one.stiffness_ratio, one.pressure, one.rate) for one in found}):
        part = [one for one in found if (one.stiffness_ratio, one.pressure, one.rate) == (ratio, pressure, rate)]
        columns = [over_friction(part, name) for name in ("packing_fraction", "coordination_number", "rattlers")]
        bound = over_friction(part, "isostatic_coordination")[1]
        for k, mu in enumerate(columns[0][0]):
            cells = [f"{mean[k]:.4f} +- {error[k]:.4f}" for _, mean, error in columns[:2]]
            rows.append((f"{mu:g}", f"{ratio:.3g}", f"{pressure:g}", f"{rate:g}", *cells, f"{bound[k]:.3f}"))
    head = ("friction", "k_t/k_n", "pressure", "rate", "packing fraction", "coordination", "isostatic")
    show(table(f"{packings} packings of {count}, d = {dimension}", head, rows, right=tuple(range(len(head)))))
    show(f"wrote friction-{dimension}d.csv and friction-{dimension}d.png in {out}")
