"""Which share of random starts ends in the minimum that steepest descent leads to, by method and damping, and phi_J.

    python recordings/accuracy/minima.py

64 discs 50:50, 1:1.4, V = overlap^2 / 2, at packing fraction .9. Two minima are the same when their energies agree and
their contact networks, rattlers taken out, are equal. Errors of shares are half of Wilson's interval.
"""

import zlib
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

REFERENCE = "steepest descent, 1e-9"
METHODS = {
    REFERENCE: pm.SteepestDescent(1e-9),
    "steepest descent, 1e-6": pm.SteepestDescent(1e-6),
    "default route": None,
}
METHODS |= {"FIRE": pm.Fire(), "FIRE 2.0": pm.Fire2(), "conjugate gradient": pm.ConjugateGradient()}
METHODS |= {"L-BFGS": pm.LBFGS(), "gradient descent, step 0.8": pm.GradientDescent()}
DAMPINGS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
METHODS |= {f"dashpots, b = {one:g}": pm.DampedDynamics(damping=one) for one in DAMPINGS}


def end(method: str, particles: int, jammed: bool, seed: int) -> dict[str, float]:
    """Return where a method takes a start: energy, network as a checksum, cost and, if asked for, the jamming point."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.9, seed=seed)
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),))
    chosen = {"method": METHODS[method], "step_limit": 20_000_000} if METHODS[method] else {}
    found = pm.quench(scene, force_tolerance=1e-10, check=False, **chosen)
    scene = scene.replace(packing=found.packing)
    backbone, index = pm.remove_rattlers(found.packing)
    contacts = pm.find_contacts(backbone)
    pairs = np.sort(np.stack([index[contacts.i_c], index[contacts.j_c]], axis=1), axis=1)
    network = zlib.crc32(np.ascontiguousarray(pairs[np.lexsort(pairs.T)], dtype="<i8").tobytes())
    onset = pm.jam(scene, strain="isotropic", check=False) if jammed and found.ok else None
    onset = onset.report["jamming_packing_fraction"] if onset is not None and onset.ok else np.nan
    cost = {"evaluations": found.force_evaluations, "converged": int(found.ok)}
    return cost | {"energy": pm.energy(scene), "network": network, "onset": onset}


def share_and_error(hits: int, of: int) -> tuple[float, float]:
    """Return a share and its binomial error, half of Wilson's interval of one standard deviation."""
    share = hits / of
    return share, float(np.sqrt(share * (1.0 - share) / of + 1.0 / (4.0 * of**2)) / (1.0 + 1.0 / of))


def same(one: pm.Ensemble, other: pm.Ensemble) -> np.ndarray:
    """Return for each seed whether both ended in one minimum."""
    near = np.abs(one["energy"] - other["energy"]) <= 1e-8 * np.maximum(one["energy"], other["energy"])
    return near & (one["network"] == other["network"]) & (one["converged"] == 1) & (other["converged"] == 1)


def main(
    *,
    particles: int = 64,
    starts: int = 200,
    jammed: int = 20,
    methods: tuple[str, ...] = tuple(METHODS),
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Quench all starts by all methods, write the table and draw the figure."""
    grid = [{"method": list(methods), "particles": particles, "jammed": True, "seed": range(jammed)}]
    if starts > jammed:
        grid.append(grid[0] | {"jammed": False, "seed": range(jammed, starts)})
    found = pm.run_ensemble(end, grid, out / "members" / "minima", workers=workers).of(grid)
    lines = [
        "method,starts,failed,same minimum,+-,energy per particle,jamming packing fraction,median force evaluations"
    ]
    reference, shares = found.where(method=REFERENCE), []
    for method in methods:
        mine = found.where(method=method)
        shares.append(share_and_error(int(same(mine, reference).sum()), len(mine)))
        energy, onset = mine["energy"].mean() / particles, np.nanmean(mine["onset"])
        failed, cost = int((mine["converged"] == 0).sum()), np.median(mine["evaluations"])
        share, error = shares[-1]
        lines.append(f'"{method}",{len(mine)},{failed},{share:.6g},{error:.6g},{energy:.9g},{onset:.6g},{cost:.0f}')
    (out / "minima.csv").write_text("\n".join([*lines, ""]))
    figure, ax = plt.subplots(figsize=(7.2, 5.0), layout="constrained")
    ax.errorbar(*np.array(shares).T[0:1], range(len(methods)), xerr=np.array(shares).T[1], fmt="o", capsize=2.0)
    ax.set_yticks(range(len(methods)), methods)
    ax.set(xlabel=f"share of {starts} starts that end in the minimum of steepest descent", xlim=(-0.03, 1.03))
    figure.savefig(out / "minima.png", dpi=150)


if __name__ == "__main__":
    run(main)
