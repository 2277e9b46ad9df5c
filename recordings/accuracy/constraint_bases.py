"""Methods for the basis of constraints against orthogonality, span, rank and seconds, on chains of 200.

    python recordings/accuracy/constraint_bases.py

The chain's bends are drawn within a largest angle and all of them are held by links: the straighter the chain, the
nearer the links come to depending on each other. With all pairs up to four apart linked, half of the links do.
"""

from functools import partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

METHODS = ("householder", "gram-schmidt", "gram-schmidt-twice", "whole-matrix")


def chain(length: int, reach: int, angle: float) -> pm.Packing:
    """Return a chain in the plane, bent within `angle` [rad], each particle linked to the next `reach` along it."""
    turn = np.cumsum(np.random.default_rng(1).uniform(-angle, angle, length))
    place = np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0)
    i = np.concatenate([np.arange(length - u) for u in range(1, reach + 1)])
    j = np.concatenate([np.arange(u, length) for u in range(1, reach + 1)])
    links = pm.Links(i, j, np.zeros((len(i), 2)), np.linalg.norm(place[j] - place[i], axis=1))
    return pm.Packing(place, np.full(length, 0.5), pm.Box.cubic(1.2 * length, 2), links)


def left_out(packing: pm.Packing, basis: pm.ConstraintBasis) -> float:
    """Return the largest entry of (1 - Q Q^T) Omega [1]."""
    gradient = pm.constraint_jacobian(packing).toarray()
    # a chain is one cluster, and its basis one dense block
    columns = basis.link_basis.toarray()
    return float(np.abs(gradient - columns @ (columns.T @ gradient)).max())


def trial(method: str, length: int, reach: int, angle: float) -> dict[str, float]:
    """Return orthogonality, rank, and how much of the links' gradients the basis leaves out."""
    packing = chain(length, reach, angle)
    basis = pm.constraint_basis(packing, method=method)
    return {"orthogonality": basis.orthogonality, "span": left_out(packing, basis), "rank": float(basis.rank)}


def main(*, length: int = 200, out: Path = Path(__file__).parent) -> None:
    """Run all methods at all bends; write table and figure."""
    kinds = {"angles fixed": 2, "all pairs up to 4": 4}
    table = pm.work_precision(
        {f"{one}, {words}": partial(trial, one, length, reach) for words, reach in kinds.items() for one in METHODS},
        (1.0, 0.3, 0.1, 0.03, 0.01),
        {"orthogonality": 0.0, "span": 0.0, "rank": float(2 * length - 3)},
        knob="largest bend (rad)",
        title=f"Basis of constraints: chains of {length} with their bends fixed",
        reference_is="closed forms: Q^T Q = 1, nothing of the links' gradients left out, rank 2 N - 3",
        repeats=1,
    )
    (out / "constraint_bases.csv").write_text(table.to_csv())
    (out / "constraint_bases.md").write_text(table.to_markdown())
    table.save_figure(out / "constraint_bases.png")


if __name__ == "__main__":
    run(main)
