"""`packmech inertia`: shear discs with friction at constant pressure and volume, and draw what comes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from packmech.check import integer, positive
from packmech.cli.output import show, table, working
from packmech.validation.studies.inertia import INERTIAL_NUMBERS, Flow, draw_flows, fit_line, shear_all

Numbers = Annotated[list[float] | None, Parameter(consume_multiple=True)]


def inertia(
    *,
    out: Path = Path("inertia"),
    particles: int = 400,
    packings: int = 1,
    friction: float = 0.4,
    pressure: float = 1e-3,
    inertial_numbers: Numbers = None,
    seed: int = 0,
    workers: int | None = None,
) -> None:
    """Shear discs with friction: stress over the inertial number, at constant pressure and volume; resumes.

    Parameters
    ----------
    out
        folder to write to
    particles
        number of discs
    packings
        of each kind, from seeds that follow each other
    friction
        coefficient of friction
    pressure
        in units of the stiffness: the relative overlap of contacts
    inertial_numbers
        rate sqrt(m / pressure) (default: .01 .02 .03 .05 .1)
    seed
        of the first packing
    workers
        processes that share the work (default: one for each core); 0: the command's own

    """
    integer("particles", particles, at_least=2)
    positive("pressure", pressure)
    out.mkdir(parents=True, exist_ok=True)
    with working("inertia") as say:

        def progress(done: int, of: int, last: Flow | None) -> None:
            note = "" if last is None else f"; I = {last.inertial_number:g} gave {last.stress_ratio:.3f}"
            say(f"inertia: {done} of {of} flows{note}")

        found = shear_all(
            out / "inertia.csv",
            particles=particles,
            coefficient=friction,
            pressure=pressure,
            inertial_numbers=INERTIAL_NUMBERS if inertial_numbers is None else inertial_numbers,
            seeds=range(seed, seed + packings),
            progress=progress,
            workers=workers,
        )
    draw_flows(found, out / "inertia.png")
    rows = [
        (
            f"{one.inertial_number:g}",
            f"{one.stress_ratio:.4f} +- {one.stress_ratio_error:.4f}",
            f"{one.volume_stress_ratio:.4f} +- {one.volume_stress_ratio_error:.4f}",
            f"{one.packing_fraction:.4f} +- {one.packing_fraction_error:.4f}",
            f"{one.mean_pressure / pressure:.3f} +- {one.mean_pressure_error / pressure:.3f}",
            f"{one.volume_pressure / pressure:.3f} +- {one.volume_pressure_error / pressure:.3f}",
        )
        for one in found
    ]
    head = (
        "I",
        "stress / pressure",
        "at constant volume",
        "packing fraction",
        "pressure / asked",
        "at constant volume",
    )
    show(table(f"N = {particles}, friction {friction:g}", head, rows, right=tuple(range(len(head)))))
    if len({one.inertial_number for one in found}) > 1:
        for name in ("stress_ratio", "packing_fraction"):
            (a, b), (a_error, b_error) = fit_line(found, name)
            show(f"{name.replace('_', ' ')}: {a:.4f} +- {a_error:.4f} + ({b:.3f} +- {b_error:.3f}) I")
    show(f"wrote inertia.csv and inertia.png in {out}")
