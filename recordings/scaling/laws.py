"""Power laws of packings near jamming, of what `scaling.py` measured: energy, contacts, moduli and omega*.

    python recordings/scaling/laws.py springs --particles 64 --particles 256 --particles 1024

They are prefactor x^exponent (1 + correction sqrt(x) + size / (N sqrt(x))) in x, the packing fraction above jamming,
fitted where x > 25 / N^2: below, N alone sets contacts in excess, shear moduli and the lowest frequencies. One N cannot
tell its term from the correction. Errors are those over packings. Expected of springs: pressure 1, energy 2, contacts
1/2, bulk modulus 0, shear modulus 1/2, omega* 1/2; of Hertz 3/2, 5/2, 1/2, 1/2, 1, 3/4.
"""

from pathlib import Path
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run
from scaling import FREQUENCIES, HERE
from scipy.optimize import least_squares

import packmech as pm

NAMES = "distance pressure energy_per_particle excess_coordination bulk_modulus shear_modulus plateau_edge".split()
# samples from which errors are found
DRAWS = 50


def means(packings: list[dict[str, np.ndarray]]) -> np.ndarray:
    """Return the mean of each figure at each level; omega* is that of the states of all packings together."""
    counts = sum(one["count_lb"] for one in packings)
    edge_l = [pm.StateDensity(FREQUENCIES, count, count.sum(), 0.0).plateau_edge for count in counts]
    return np.column_stack([np.mean([one["figure_lq"] for one in packings], axis=0), edge_l])


def fit(x: np.ndarray, y: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Return exponent, prefactor, correction and, of several N, the size of the law above; by relative deviations."""
    terms = [np.sqrt(x), 1.0 / (n * np.sqrt(x))][: 1 + (np.ptp(n) > 0)]
    line = np.polyfit(np.log(x), np.log(y), 1)

    def miss(guess: np.ndarray) -> np.ndarray:
        return np.exp(guess[1] + guess[0] * np.log(x)) * (1.0 + guess[2:] @ terms) / y - 1.0

    scale = [1.0, 1.0, *(1.0 / np.max(terms, axis=1))]
    found = least_squares(miss, [*line, *np.zeros(len(terms))], x_scale=scale, xtol=1e-12).x
    return np.concatenate([[found[0], np.exp(found[1])], found[2:]])


def main(
    scene: Literal["springs", "hertz"] = "springs",
    *,
    particles: tuple[int, ...] = (256,),
    largest: float = 0.1,
    out: Path = HERE,
) -> None:
    """Write tables, draw the figure and print the power laws."""
    found = pm.read_ensemble(out / "members" / scene)
    figure, axes = plt.subplots(2, 3, figsize=(11.0, 7.2), layout="constrained")
    rng, curves = np.random.default_rng(0), []
    for count in particles:
        part = found.where(particles=count, state="done")
        kept = [part.arrays(k) for k in range(len(part))]
        # the packings, then as many drawn from them again and again
        drawn = [kept, *([kept[k] for k in rng.integers(len(kept), size=len(kept))] for _ in range(DRAWS))]
        curves.append(np.array([means(one) for one in drawn]))
        table = np.stack([curves[-1][0], curves[-1][1:].std(axis=0)], axis=-1).reshape(-1, 2 * len(NAMES))
        head = ",".join(f"{name},{name}_error" for name in NAMES)
        np.savetxt(out / f"{scene}-{count}.csv", table, "%.9g", delimiter=",", header=head, comments="")
    whole, n_k = np.concatenate(curves, axis=1), np.repeat(particles, [one.shape[1] for one in curves])
    above = (whole[0, :, 0] > 25.0 / n_k**2) & (whole[0, :, 0] <= largest)
    for ax, q in zip(axes.flat, range(1, len(NAMES)), strict=True):
        for one, count in zip(curves, particles, strict=True):
            ax.errorbar(
                one[0, :, 0], one[0, :, q], one[1:, :, q].std(axis=0), fmt="o", capsize=2.0, label=f"N = {count}"
            )
        ax.set(xscale="log", yscale="log", xlabel="packing fraction above jamming", ylabel=NAMES[q].replace("_", " "))
        fitted = above & (whole[:, :, q] > 0.0).all(axis=0)
        if np.count_nonzero(fitted) > 4:
            laws = np.array([fit(one[fitted, 0], one[fitted, q], n_k[fitted]) for one in whole])
            words = [f"{value:.4g} +- {error:.2g}" for value, error in zip(laws[0], laws[1:].std(axis=0), strict=True)]
            ax.set_title(f"exponent {words[0]}")
            print(f"{NAMES[q]}: exponent, prefactor, correction, size: {', '.join(words)}")
    axes[0, 0].legend()
    figure.savefig(out / f"{scene}-{'sizes' if len(particles) > 1 else particles[0]}.png", dpi=150)


if __name__ == "__main__":
    run(main)
