"""Which packings that are jammed in their box stay jammed when it is repeated, over N: isotropic and shear-stabilized.

Isotropic packings at the lowest pressure have one contact more than a fixed box asks for, fewer than waves do: two
copies unjam. Contacts that pressure closes, and those with which a box that is free resists shear, keep copies jammed.

python recordings/tiled/shares.py --packings 10

Every answer is checked by the verdict's program on copies: "not jammed" on those that it names, "jammed" on 4 x 4,
4 x 3, 3 x 4 and 3 x 3, which contain all up to 4 x 4 (a motion of fewer copies, repeated, is one of more).
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

COPIES = ((4, 4), (4, 3), (3, 4), (3, 3))
NAMES = ("jammed", "jammed_repeated", "not_jammed_repeated", "ambiguous", "confirmed", "contradicted", "copies")


def judge(particles: int, strain: str, pressure: float, seed: int) -> dict[str, float]:
    """Return what is said of a packing and its copies, and what the program says of these."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(),))
    made = pm.jam(scene, pressure=pressure, strain=strain, check=False)
    # the pairs that press: at finite pressure gaps are no errors
    verdict = pm.classify_jamming(made.packing, contacts=pm.find_contacts(made.packing), tiled=True)
    found = dict.fromkeys(NAMES, 0.0)
    if not made.ok or verdict.collective != "jammed":
        return found
    tiled = verdict.tiled
    if tiled.collective == "not jammed":
        many = [tiled.packing]
    else:
        many = [made.packing.repeated(one) for one in COPIES if tiled.collective == "jammed"]
    again = [pm.classify_jamming(one, contacts=pm.find_contacts(one)).collective == tiled.collective for one in many]
    sure = tiled.collective != "ambiguous"
    return found | {
        "jammed": 1.0,
        "jammed_repeated": float(tiled.collective == "jammed"),
        "not_jammed_repeated": float(tiled.collective == "not jammed"),
        "ambiguous": float(not sure),
        "confirmed": float(sure and all(again)),
        "contradicted": float(sure and not all(again)),
        "copies": float(np.prod(tiled.repeats)) if tiled.repeats else 0.0,
    }


def main(*, packings: int = 10, out: Path = Path(__file__).parent, workers: int | None = None) -> None:
    """Judge the packings, write the table and draw the shares."""
    sizes, kinds = (16, 24, 32, 48, 64), (("isotropic", 1e-9), ("isotropic", 1e-4), ("isotropic", 1e-3), ("free", 1e-9))
    figure, axes = plt.subplots(layout="constrained", figsize=(5.0, 3.6))
    found = dict.fromkeys(NAMES[:-1], 0)
    for strain, pressure in kinds:
        grid = {"particles": sizes, "strain": strain, "pressure": pressure, "seed": range(packings)}
        name = f"{strain}-{pressure:g}"
        rows = pm.run_ensemble(judge, grid, out / "members" / name, workers=workers).of(grid).table()
        pm.write_table(rows, out / f"{name}.csv")
        found = {one: count + int(rows[one].sum()) for one, count in found.items()}
        own = [rows["jammed_repeated"][(rows["particles"] == n) & (rows["jammed"] > 0.0)] for n in sizes]
        share = [one.mean() if len(one) else np.nan for one in own]
        axes.plot(sizes, share, marker="so"[strain == "isotropic"], label=f"{strain}, pressure {pressure:g}")
    print(found)
    axes.set(xlabel="particles", ylabel="share jammed for all repeats", ylim=(-0.03, 1.03))
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(out / "shares.png", dpi=160)


if __name__ == "__main__":
    run(main)
