"""`packmech scaling`: follow packings towards the jamming point, and fit how they soften."""

from __future__ import annotations

from pathlib import Path

from packmech.cli.output import show, table, working
from packmech.protocols.scaling import PRESSURES, jamming_scaling
from packmech.scenes.scene_file import read_scene
from packmech.view.figures import FITTED, draw_scaling


def scaling(
    scene: str = "default",
    /,
    *,
    out: Path = Path("scaling"),
    packings: int = 20,
    highest: float = 1e-2,
    lowest: float = 1e-6,
    strain: str = "free",
    seed: int = 0,
) -> None:
    """Follow packings over pressure to the jamming point: how moduli, contacts and energy fall.

    Parameters
    ----------
    scene
        scene file or shipped scene that is drawn again, from another seed, for each packing
    out
        folder to write to
    packings
        number of packings, of seeds that follow each other
    highest, lowest
        pressures, two a decade [energy_scale / diameter^d]
    strain
        "free" relaxes every strain; "isotropic" keeps the shape of the box (many are unstable to shear then)
    seed
        of the first packing

    """
    starts = [read_scene(scene, seed=seed + k) for k in range(packings)]
    pressures = [highest]
    while pressures[-1] > lowest * 1.001:
        pressures.append(max(lowest, pressures[-1] * PRESSURES[1] / PRESSURES[0]))
    with working("scaling") as say:

        def progress(stage: str, figures: dict[str, object]) -> None:
            if "done" in figures:
                say(f"scaling: {figures['done']} of {packings} packings")

        found = jamming_scaling(starts, pressures, strain=strain, progress=progress, check=False)
    out.mkdir(parents=True, exist_ok=True)
    (out / "scaling.csv").write_text(found.to_csv(), encoding="utf-8")
    draw_scaling(found, out / "scaling.png")
    rows = []
    for name in FITTED:
        fit = found.fit(name)
        rows.append((name.replace("_", " "), f"{fit.exponent:.3f}", f"{fit.error:.3f}", f"{fit.prefactor:.4g}"))
    title = f"exponents of pressure from {found.counted_from:.2g} up, {found.packings} packings of {found.particles}"
    show(table(title, ("quantity", "exponent", "+-", "prefactor"), rows, right=(1, 2, 3)))
    show(f"wrote scaling.csv and scaling.png in {out}; {found.seconds:.3g} s CPU")
