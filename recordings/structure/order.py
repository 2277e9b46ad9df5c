"""Six-fold order of jammed packings over disorder: sizes of discs, aspects of ellipses and of dimers.

    python recordings/structure/order.py --shaped 256

As figures 2.25 and 2.26 of Schreck and O'Hern; `lengths.py` draws correlations of these packings.
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from cyclopts import run

import packmech as pm

RATIOS, ASPECTS = (1.02, 1.05, 1.1, 1.15, 1.2, 1.3, 1.4, 1.5), (1.02, 1.05, 1.1, 1.2, 1.3, 1.4, 1.6)
PICTURED = (1.05, 1.1, 1.2, 1.3, 1.4, 1.6)


def jam(kind: str, particles: int, disorder: float, pressure: float, seed: int) -> dict[str, Any]:
    """Return the order of a packing in a square box, and the packing."""
    given = {"packing_fraction": 0.9 if kind == "discs" else 0.6, "seed": seed}
    given["sizes"] = pm.Uniform(disorder) if kind == "discs" else pm.Monodisperse()
    if kind != "discs":
        # length over width of a dimer is 1 + distance of the beads / width
        given["shapes"] = pm.Ellipses(disorder) if kind == "ellipses" else pm.Dimer(disorder - 1.0)
    scene = pm.Scene(pm.random_packing(particles, dimension=2, **given), (pm.Repulsion(),))
    found = pm.jam(scene, pressure=pressure, strain="isotropic")
    bonds, report = pm.bond_orientational_order(found.packing, 6), found.report
    z = 2.0 * report["contacts"] / max(particles - report["rattlers"], 1)
    order = {"global_order": bonds.global_order, "local_order": bonds.local_order}
    return order | {"packing_fraction": report["packing_fraction"], "coordination_number": z, "packing": found.packing}


def main(
    *,
    particles: int = 1024,
    shaped: int = 128,
    packings: int = 4,
    pressure: float = 1e-6,
    ratios: tuple[float, ...] = RATIOS,
    aspects: tuple[float, ...] = ASPECTS,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Jam the packings, write the table and draw the figures."""
    common = {"pressure": pressure, "seed": range(packings)}
    grid = [common | {"kind": "discs", "particles": particles, "disorder": ratios}]
    grid.append(common | {"kind": ["ellipses", "dimers"], "particles": shaped, "disorder": aspects})
    found = pm.run_ensemble(jam, grid, out / "members" / "order", workers=workers).of(grid)
    pm.write_table(found, out / "order.csv")
    figure, ax = plt.subplots(figsize=(5.4, 4.4), layout="constrained")
    for color, kind in enumerate(("discs", "ellipses", "dimers")):
        for name, style in (("global_order", "-"), ("local_order", ":")):
            mean = pm.group_statistics(found.where(kind=kind), name, ["disorder"])
            ax.errorbar(mean.by["disorder"], mean.value_g, mean.error_g, fmt=style, color=f"C{color}", label=kind)
    ax.set(xlabel="largest over smallest diameter, or aspect", ylabel="|psi_6|, global and (dotted) local")
    ax.legend()
    figure.savefig(out / "order.png", dpi=150)
    figure, axes = plt.subplots(2, 3, figsize=(6.6, 4.8), layout="constrained")
    for ax, aspect in zip(axes.flat, [one for one in PICTURED if one in aspects], strict=False):
        packing = found.where(kind="dimers", disorder=aspect).packing(0)
        none = pm.find_shape_contacts(packing, gap_tolerance=-0.9)
        ax.imshow(pm.draw_frame(packing, contacts=none, rattler_n=pm.find_rattlers(packing), size=(300, 300)))
        ax.set_title(f"aspect {aspect:g}", fontsize=8)
        ax.set_axis_off()
    figure.savefig(out / "dimers.png", dpi=150)


if __name__ == "__main__":
    run(main)
