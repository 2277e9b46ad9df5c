"""`packmech silo`: lower the floor of a silo, and hold the stress against Janssen's law."""

from __future__ import annotations

from pathlib import Path

from packmech.check import integer, positive
from packmech.cli.output import show, table, working
from packmech.validation.studies.silo import draw_silos, fit_silo, lower_all


def silo(
    *,
    out: Path = Path("silo"),
    width: float = 20.0,
    height: float = 170.0,
    friction: float = 0.5,
    packings: int = 1,
    seed: int = 0,
) -> None:
    """Lower the floor of a silo of discs with friction: stress over depth, and Janssen's law; resumes.

    Parameters
    ----------
    out
        folder to write to
    width
        between the walls, in mean diameters
    height
        of the grains, in mean diameters
    friction
        coefficient of friction
    packings
        from seeds that follow each other
    seed
        of the first packing

    """
    integer("packings", packings, at_least=1)
    if positive("width", width) < 6.0 or positive("height", height) < width:
        raise ValueError(f"width must be at least 6 and height at least the width, got {width:g} and {height:g}")
    out.mkdir(parents=True, exist_ok=True)
    with working("silo") as say:
        found = lower_all(
            out,
            width=width,
            height=height,
            friction=friction,
            seeds=range(seed, seed + packings),
            progress=lambda done, of, look, looks: say(f"silo {done + 1} of {of}: look {look + 1} of {looks}"),
        )
    draw_silos(found, out / "silo.png")
    fits = [fit_silo(one)[0] for one in found]
    rows = [
        (
            f"{one.height:.0f}",
            f"{one.length:.1f}",
            f"{one.wall_friction:.3f}",
            f"{one.stress_ratio:.3f}",
            f"{one.fitted_ratio:.3f}",
            f"{where.floor_part:.3f}",
        )
        for one, where in zip(fits, found, strict=True)
    ]
    head = ("height", "length of Janssen's law", "wall friction", "K measured", "K fitted", "weight on the floor")
    show(table(f"silo {width:g} d wide, friction {friction:g}", head, rows, right=tuple(range(len(head)))))
    show(f"wrote tables and silo.png in {out}")
