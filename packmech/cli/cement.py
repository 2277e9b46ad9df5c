"""`packmech cement`: turn contacts into rigid links and follow the moduli."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from packmech.cli.output import Switch, show, table, working
from packmech.effects import Harmonic, Repulsion
from packmech.ensemble.cementing_curve import cementing_curve
from packmech.ensemble.cementing_tables import (
    cementing_markdown,
    curve_csv,
    draw_cementing,
    thresholds,
    thresholds_csv,
)
from packmech.files.packings import read_law, read_packing
from packmech.scene import Scene
from packmech.scenes.scene_file import read_scene


def _scene(file: Path) -> Scene:
    """Return what a scene file holds, or a packing with its file's own law, else harmonic repulsion."""
    if file.suffix == ".toml":
        return read_scene(file)
    return Scene(read_packing(file), (Repulsion(law=read_law(file) or Harmonic()),))


@contextmanager
def _named(files: tuple[Path, ...]) -> Iterator[None]:
    """Call scenes by their files' names in errors."""
    try:
        yield
    except (TypeError, ValueError) as error:
        said = re.sub(r"scenes\[(\d+)\]", lambda place: str(files[int(place[1])]), str(error))
        raise (TypeError if isinstance(error, TypeError) else ValueError)(said) from error


def cement(
    *files: Annotated[
        Path, Parameter(help="jammed packings of one's own: .npz, .gsd, text tables, or scene files (.toml)")
    ],
    out: Path = Path("cementing"),
    particles: Annotated[list[int] | None, Parameter(consume_multiple=True)] = None,
    packings: int | None = None,
    orders: int | None = None,
    full: Switch = False,
    seed: int = 0,
    step: float = 0.05,
    freeze: str = "angles",
    order: str = "random",
    workers: int | None = None,
) -> None:
    """Turn contacts into rigid links and follow the moduli; resumes what it finds.

    Parameters
    ----------
    out
        folder to write to
    particles
        sizes of the packings (default: 64 128 256)
    packings
        packings of each size (default: 10)
    orders
        random orders of cementing of each packing (default: 20)
    full
        the size of the source: N = 64 to 2048, 25 packings, 50 orders (days)
    seed
        everything is drawn from it
    step
        moduli are measured every so much n_l/N
    freeze
        "angles": bond angles; "clusters": whole clusters; "nothing"
    order
        "random", or "aggregate": contacts that touch what is cemented
    workers
        processes that share the work (default: one for each core); 0: the command's own

    """
    for name, given in (("particles", particles), ("packings", packings), ("full", full or None)):
        if files and given is not None:
            raise ValueError(f"{name} must be left out where files name the packings, got {given}")
    sizes, samples, draws = ([64, 128, 256, 512, 1024, 2048], 25, 50) if full else ([64, 128, 256], 10, 20)
    sizes = sizes if particles is None else particles
    samples = samples if packings is None else packings
    draws = draws if orders is None else orders
    scenes = [_scene(file) for file in files] or None
    samples = len(files) or samples
    with working("cementing") as say, _named(files):
        curves = cementing_curve(
            out / "members",
            scenes=scenes,
            particles=sizes,
            packings=samples,
            orders=draws,
            seed=seed,
            step=step,
            freeze=freeze,
            order=order,
            workers=workers,
            progress=lambda size, packing, done: say(
                f"cementing: N = {size}, packing {packing + 1} of {samples}, {done} of {draws} orders"
            ),
        )
    drawn = f"--particles {' '.join(map(str, sizes))} --packings {samples}"
    made_by = (
        f"packmech cement {' '.join(file.name for file in files) or drawn} --orders {draws} "
        f"--seed {seed} --step {step:g} --freeze {freeze} --order {order}"
    )
    (out / "curve.csv").write_text(curve_csv(curves), encoding="utf-8")
    (out / "thresholds.csv").write_text(thresholds_csv(curves), encoding="utf-8")
    (out / "cementing.md").write_text(cementing_markdown(curves, made_by), encoding="utf-8")
    draw_cementing(curves, out / "cementing.png")
    headings, rows = thresholds(curves)
    by_size = [(heading, *(row[k] for row in rows)) for k, heading in enumerate(headings) if k]
    head = (headings[0], *(row[0] for row in rows))
    show(table("cementing", head, by_size, right=tuple(range(1, len(head)))))
    show(f"wrote curve.csv, thresholds.csv, cementing.md and cementing.png in {out}")
