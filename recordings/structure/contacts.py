"""How many discs of jammed packings have how many contacts: figure 2.20 of Schreck and O'Hern.

python recordings/structure/contacts.py --packings 10
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

HERE = Path(__file__).parent


def count_contacts(particles: int, seed: int) -> dict[str, np.ndarray]:
    """Return how many discs of a packing have 0, 1, ... 6 contacts; rattlers have none, and theirs do not count."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    jammed = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8, strain="isotropic")
    found = pm.contact_statistics(jammed.packing).count_z
    count_z = np.zeros(16, dtype=np.int64)
    count_z[: len(found)] = found
    count_z[0] += particles - found.sum()
    return {"count_z": count_z}


def main(*, particles: int = 128, packings: int = 20, out: Path = HERE, workers: int | None = None) -> None:
    """Count the contacts, write the table and draw the figure."""
    grid = {"particles": particles, "seed": range(packings)}
    found = pm.run_ensemble(count_contacts, grid, out / "members" / "contacts", workers=workers).of(grid)
    count_z = np.trim_zeros(sum(found.arrays(k)["count_z"] for k in range(len(found))), "b")
    share_z, number = count_z / count_z.sum(), np.arange(len(count_z))
    table = np.column_stack([number, count_z, share_z])
    np.savetxt(out / "contacts.csv", table, "%.12g", delimiter=",", header="contacts,discs,share", comments="")
    figure, ax = plt.subplots(figsize=(5.4, 3.8), layout="constrained")
    ax.bar(
        number,
        share_z,
        yerr=np.sqrt(share_z * (1.0 - share_z) / count_z.sum()),
        color=["#b0b0b0"] + ["C0"] * (len(number) - 1),
    )
    ax.set(xlabel="contacts of a disc (gray: rattlers)", ylabel="share of the discs")
    mean = (number * count_z)[1:].sum() / count_z[1:].sum()
    ax.set_title(f"{packings} packings of {particles} discs 1:1.4; mean without rattlers {mean:.3f}", fontsize=9)
    figure.savefig(out / "contacts.png", dpi=150)


if __name__ == "__main__":
    run(main)
