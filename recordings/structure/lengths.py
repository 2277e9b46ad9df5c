"""Correlations of psi_6 and of g - 1 of the packings of `order.py`, with the lengths of their decay over disorder.

    python recordings/structure/lengths.py

As figures 2.25 to 2.29 of Schreck and O'Hern; run `order.py` first.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from cyclopts import run

import packmech as pm

WIDTH = 0.05


def correlate(packings: list[pm.Packing]) -> tuple[np.ndarray, np.ndarray, pm.CorrelationLength, pm.CorrelationLength]:
    """Return distances in mean diameters, |C(r)| of psi_6, and the lengths of C(r) and of g - 1, pooled.

    Noise is twice the standard error over the packings, averaged over a diameter, or of the pairs if that is more:
    without it lines go through maxima of noise. Correlations of psi_6 are less those of its mean, with their sign.
    """
    half = min(0.5 * float(one.box.reduced()[0].height_d.min()) for one in packings)
    bins = int(min(14.0, half) / WIDTH)
    pairs, value, connected, excess = [], [], [], []
    for packing in packings:
        psi_n = pm.bond_orientational_order(packing, 6).psi_n
        one = pm.correlation_function(packing, psi_n, r_max=bins * WIDTH, bins=bins)
        pairs.append(one.count_b)
        value.append(np.nan_to_num(one.value_b))
        connected.append(value[-1] - one.mean_square)
        excess.append(pm.pair_distribution(packing, r_max=bins * WIDTH, bins=bins).g_b - 1.0)
    count_b, window = np.sum(pairs, axis=0), np.ones(round(1.0 / WIDTH))
    weight_pb, lengths = np.array(pairs) / np.maximum(count_b, 1), []
    for value_pb, weights in ((connected, weight_pb), (excess, np.full(weight_pb.shape, 1.0 / len(packings)))):
        mean_b = (weights * value_pb).sum(axis=0)
        square_b = (weights * (value_pb - mean_b) ** 2).sum(axis=0) / max(len(packings) - 1, 1)
        smooth_b = np.convolve(square_b, window, "same") / np.convolve(np.ones(bins), window, "same")
        noise_b = 2.0 * np.maximum(np.sqrt(smooth_b), 1.0 / np.sqrt(np.maximum(count_b, 1.0)))
        lengths.append(pm.correlation_length(one.r_b, mean_b, count_b, noise_b=noise_b, r_min=1.5, separation=0.4))
    return one.r_b, np.abs((weight_pb * value).sum(axis=0)), *lengths


def main(*, out: Path = Path(__file__).parent) -> None:
    """Pool the packings of each kind and degree of disorder, write the table and draw the figure."""
    found, lines = pm.read_ensemble(out / "members" / "order"), ["kind,disorder,psi_6,+-,g - 1,+-"]
    figure, (decay, length) = plt.subplots(1, 2, figsize=(10.0, 4.4), layout="constrained")
    for color, kind in enumerate(("discs", "ellipses", "dimers")):
        rows = []
        for disorder in np.unique(found.where(kind=kind)["disorder"]):
            part = found.where(kind=kind, disorder=disorder)
            r_b, value_b, *lengths = correlate([part.packing(k) for k in range(len(part))])
            rows.append((disorder, *(x for one in lengths for x in (one.length, one.error))))
            lines.append(",".join(map(str, (kind, *rows[-1]))))
            if kind == "discs":
                decay.semilogy(r_b, value_b, linewidth=0.8, label=f"ratio {disorder:g}")
        x, bond, bond_error, pair, pair_error = np.array(rows).T
        length.errorbar(x, bond, bond_error, fmt="--o", color=f"C{color}", label=f"{kind}, psi_6")
        length.errorbar(x, pair, pair_error, fmt="-s", color=f"C{color}", label=f"{kind}, g - 1")
    (out / "lengths.csv").write_text("\n".join([*lines, ""]))
    decay.set(xlabel="distance [mean diameter]", ylabel="|<psi_6(r) psi_6*(0)>|", ylim=(1e-3, 1.0))
    length.set(xlabel="largest over smallest diameter, or aspect", ylabel="correlation length [mean diameter]")
    for ax in (decay, length):
        ax.legend(fontsize=7)
    figure.savefig(out / "lengths.png", dpi=150)


if __name__ == "__main__":
    run(main)
