"""What exact contact distances of ellipses cost: levels of table 2.1 of Schreck and O'Hern (2010), and their times.

    python recordings/accuracy/contact_distance.py

Pairs of unlike ellipses of one aspect, size ratio 1.4, at independent uniform angles; errors of the contact distance
are relative to the exact one. `mean` is over the pairs for which a level finds a contact, `counted` takes an error of
1 for the others. Time is CPU time of `pm.contact_distance`, its checks included.
"""

import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

LEVELS, ASPECTS = ("gaussian", "linear", "quadratic", "exact"), (1.0, 1.2, 1.5, 2.0, 3.0, 10.0)


def draw_pairs(aspect: float, count: int) -> tuple[np.ndarray, ...]:
    """Return what `pm.contact_distance` takes: vectors, semi-axes and directors, each angle uniform."""
    angle = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (count, 3))
    vector_cd, one_cd, other_cd = np.moveaxis(np.stack([np.cos(angle), np.sin(angle)], axis=2), 1, 0)
    axes = np.array([np.sqrt(aspect), 1.0 / np.sqrt(aspect)])
    return vector_cd, np.tile(0.5 * axes, (count, 1)), one_cd, np.tile(0.7 * axes, (count, 1)), other_cd


def measure(aspect: float, level: str, pairs: int, timed: int = 20_000) -> tuple[float, float, float, float, float]:
    """Return mean, counted and largest error of a level, the share of pairs with a contact, and nanoseconds a pair."""
    drawn = draw_pairs(aspect, pairs)
    exact, rough = (pm.contact_distance(*drawn, level=one) for one in ("exact", level))
    found = np.isfinite(rough)
    error = np.abs(rough[found] / exact[found] - 1.0)
    few, seconds = [part[:timed] for part in drawn], []
    for _ in range(9):
        began = time.process_time()
        pm.contact_distance(*few, level=level)
        seconds.append(time.process_time() - began)
    counted = (error.sum() + np.count_nonzero(~found)) / pairs
    return (
        float(error.mean()),
        float(counted),
        float(error.max()),
        float(found.mean()),
        1e9 * min(seconds) / len(few[0]),
    )


def main(*, pairs: int = 400_000, out: Path = Path(__file__).parent) -> None:
    """Measure all levels at all aspects; write the table and draw the figure."""
    lines = ["level,aspect,mean,counted,largest,found,nanoseconds"]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for level in LEVELS:
        rows = np.array([measure(aspect, level, pairs) for aspect in ASPECTS])
        lines += [f"{level},{aspect}," + ",".join(map(str, row)) for aspect, row in zip(ASPECTS, rows, strict=True)]
        left.loglog(ASPECTS, np.maximum(rows[:, 1], 1e-17), "o-", label=level)
        right.semilogy(rows[:, 4], np.maximum(rows[:, 1], 1e-17), "o")
    (out / "contact_distance.csv").write_text("\n".join([*lines, ""]))
    left.set(xlabel="aspect", ylabel="mean relative error of the contact distance")
    left.legend()
    right.set(xlabel="CPU time of a pair [ns]")
    figure.suptitle(f"Unlike ellipses of size ratio 1.4, {pairs} pairs")
    figure.savefig(out / "contact_distance.png", dpi=150)


if __name__ == "__main__":
    run(main)
