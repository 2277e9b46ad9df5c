"""The figure of `learning.py`: an agent while it learns, and what it reaches on new starts beside acting at random."""

import matplotlib.pyplot as plt
import numpy as np


def draw(rows, trained, random, path):
    """Draw the learning curve, and what the policies reach on new starts."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    edges = np.linspace(0, rows[:, 0].max(), 41)
    place = np.clip(np.digitize(rows[:, 0], edges) - 1, 0, 39)
    middle = 0.5 * (edges[1:] + edges[:-1])
    some = [k for k in range(40) if (place == k).sum() > 1]
    for axis, column, name in ((axes[0], 1, "return of an episode"), (axes[1], 3, "episodes that end jammed")):
        mean = np.array([rows[place == k, column].mean() for k in some])
        error = np.array([rows[place == k, column].std(ddof=1) / np.sqrt((place == k).sum()) for k in some])
        axis.fill_between(middle[some], mean - error, mean + error, alpha=0.3, color="C0", lw=0)
        axis.plot(middle[some], mean, color="C0", label="PPO while it learns (mean and standard error)")
        for data, color, label in ((trained, "C2", "trained, 200 new starts"), (random, "C3", "acting at random")):
            level = data[:, 0 if column == 1 else 2].mean()
            axis.axhline(level, color=color, ls="--", label=f"{label}: {level:.2f}")
        axis.set(xlabel="steps of environments", ylabel=name)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.3 * (high - low))
        axis.legend(frameon=False, fontsize=8, loc="upper left")
    figure.suptitle("Quench-v0, 32 bidisperse discs: to a jammed packing with few force evaluations")
    figure.savefig(path, dpi=120)
