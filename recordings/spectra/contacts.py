"""Contact forces and gaps of exact hard packings with one state of self stress, beside the exponents of mean field.

python recordings/spectra/contacts.py --particles 1024 --packings 16 [--dimension 3 --particles 256]
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

HERE = Path(__file__).parent
# mean field: gaps ~ h^-.41269; forces ~ f^.17462 on bucklers, which have d + 1 contacts, ~ f^.42311 on others
BUCKLERS, OTHERS, GAPS = 0.17462, 0.42311, -0.41269
SMALL_FORCE, SMALL_GAP, CLOSED = 0.1, 1e-2, 1e-10


def touch(dimension: int, particles: int, seed: int) -> dict[str, float | np.ndarray]:
    """Return forces [mean force] and gaps [contact distance] of a hard packing, if it has one state of self stress."""
    given = {"sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": {2: 0.87, 3: 0.68}[dimension], "seed": seed}
    scene = pm.Scene(pm.random_packing(particles, dimension=dimension, **given), (pm.Repulsion(),))
    found = pm.jam(scene, strain="isotropic", check=False)
    if found.report.get("hard_excess_contacts") != 0:
        return {"contacts": 0}
    backbone, _ = pm.remove_rattlers(found.report["hard_packing"], gap_tolerance=CLOSED)
    near = pm.find_contacts(backbone, gap_tolerance=0.1)
    gap = near.gap_c / near.contact_distance_c
    contacts = near.select(gap <= CLOSED)
    stress = pm.states_of_self_stress(backbone, contacts=contacts)
    force_c = stress.force_ck[:, 0]
    buckler_n = contacts.count_n() == dimension + 1
    return {
        "contacts": len(contacts),
        "isostatic_contacts": dimension * (backbone.particles - 1) + 1,
        "bucklers": int(buckler_n.sum()),
        "jamming_packing_fraction": found.report["jamming_packing_fraction"],
        "force_imbalance": float(stress.residual / abs(force_c.mean())),
        "force_c": force_c / force_c.mean(),
        "on_buckler_c": buckler_n[contacts.i_c] | buckler_n[contacts.j_c],
        "gap_p": gap[gap > CLOSED],
    }


def main(
    *, dimension: int = 2, particles: int = 256, packings: int = 10, out: Path = HERE, workers: int | None = None
) -> None:
    """Find the hard packings, write the table, draw the figure and print the exponents."""
    name, grid = f"contacts-{dimension}d", {"dimension": dimension, "particles": particles, "seed": range(packings)}
    found = pm.run_ensemble(touch, grid, out / "members" / name, workers=workers).of(grid)
    pm.write_table(found, out / f"{name}.csv")
    kept = [found.arrays(k) for k in np.flatnonzero(found["contacts"] > 0)]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.4), layout="constrained")
    for ax, words, theory, small, parts in (
        (left, "forces on bucklers", BUCKLERS, SMALL_FORCE, [one["force_c"][one["on_buckler_c"]] for one in kept]),
        (left, "other forces", OTHERS, SMALL_FORCE, [one["force_c"][~one["on_buckler_c"]] for one in kept]),
        (right, "gaps", GAPS, SMALL_GAP, [one["gap_p"] for one in kept]),
    ):
        value = np.sort(np.concatenate(parts))
        share = np.arange(1, len(value) + 1) / len(value)
        (line,) = ax.loglog(value, share, label=words)
        x = np.geomspace(1e-4 * small, small, 20)
        law = np.interp(small, value, share) * (x / small) ** (1.0 + theory)
        ax.loglog(x, law, ":", color=line.get_color(), label=f"{1 + theory:.3f}")
        exponent, error, count = pm.small_value_exponent(parts, small)
        print(f"{words}: {exponent:.3f} +- {error:.3f} from {count} values, mean field {theory:g}")
    for ax, words in ((left, "contact force over its mean"), (right, "gap over contact distance")):
        ax.set(xlabel=words, ylabel="share of smaller ones")
        ax.legend()
    figure.suptitle(f"{len(kept)} exact hard packings of N = {particles}, d = {dimension}")
    figure.savefig(out / f"{name}.png", dpi=150)


if __name__ == "__main__":
    run(main)
