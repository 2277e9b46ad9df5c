"""Methods for the basis of constraints against orthogonality, span, rank and seconds, on chains of 200.

The chain's bends are drawn within a largest angle and all of them are held by links: the straighter the chain, the
nearer the links come to depending on each other. With all pairs up to four apart linked, half of the links do.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np

import packmech as pm
from packmech.result import markdown_table
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

LENGTH, SEED = 200, 1
ANGLES = (1.0, 0.3, 0.1, 0.03, 0.01)
METHODS = ("householder", "gram-schmidt", "gram-schmidt-twice", "whole-matrix")
# name of the links: how far along the chain each particle is linked, and the rank of all links
LINKS = {"angles fixed": (2, 2 * LENGTH - 3), "all pairs up to 4": (4, 2 * LENGTH - 3)}
ORTHOGONALITY, SPAN, RANK = "orthogonality", "span", "rank"


def chain(angle: float, reach: int) -> pm.Packing:
    """Return a chain in the plane, bent within `angle` [rad], each particle linked to the next `reach` along it."""
    turn = np.cumsum(np.random.default_rng(SEED).uniform(-angle, angle, LENGTH))
    place = np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0)
    i = np.concatenate([np.arange(LENGTH - u) for u in range(1, reach + 1)])
    j = np.concatenate([np.arange(u, LENGTH) for u in range(1, reach + 1)])
    links = pm.Links(i, j, np.zeros((len(i), 2)), np.sqrt(((place[j] - place[i]) ** 2).sum(axis=1)))
    return pm.Packing(place, np.full(LENGTH, 0.5), pm.Box.cubic(1.2 * LENGTH, 2), links)


_chain = cache(chain)


def trial(method: str, reach: int, angle: float) -> Answer:
    """Return orthogonality, rank, and how much of the links' gradients the basis leaves out."""
    packing = _chain(angle, reach)
    basis = pm.constraint_basis(packing, method=method)
    return Answer({ORTHOGONALITY: basis.orthogonality, SPAN: left_out(packing, basis), RANK: float(basis.rank)})


def left_out(packing: pm.Packing, basis: pm.ConstraintBasis) -> float:
    """Return the largest entry of (1 - Q Q^T) Omega [1]."""
    gradient = pm.constraint_jacobian(packing).toarray()
    # a chain is one cluster, and its basis one dense block
    columns = basis.link_basis.toarray()
    return float(np.abs(gradient - columns @ (columns.T @ gradient)).max())


def run(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {
            f"{method}, {name}": partial(trial, method, reach)
            for name, (reach, _) in LINKS.items()
            for method in METHODS
        },
        ANGLES,
        {ORTHOGONALITY: 0.0, SPAN: 0.0, RANK: float(2 * LENGTH - 3)},
        knob="largest bend (rad)",
        title=f"Basis of constraints: chains of {LENGTH} with their bends fixed",
        reference_is="closed forms: Q^T Q = 1, nothing of the links' gradients left out, rank 2 N - 3",
        repeats=1,
        progress=progress,
    )
    return table, describe(table)


def describe(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it or measured here."""
    lines = [
        "Orthogonality: largest entry of Q^T Q - 1. Span: largest entry of (1 - Q Q^T) Omega. The seconds of the",
        "figure are of the basis and of these two checks; those of the second table of the basis alone.",
        "",
    ]
    first_column = f"orthogonality, bends up to {ANGLES[0]:g}"
    headings = ("method", "links", first_column, f"up to {ANGLES[-1]:g}", "span", "rank wrong by")
    rows = []
    for name in LINKS:
        for method in METHODS:
            trials = {one.setting: one for one in table.of(f"{method}, {name}")}
            first, last = trials[ANGLES[0]].errors, trials[ANGLES[-1]].errors
            span = max(one.errors[SPAN] for one in trials.values())
            rank = max(one.errors[RANK] for one in trials.values())
            ends = (f"{one[ORTHOGONALITY]:.1e}" for one in (first, last))
            rows.append((method, name, *ends, f"{span:.1e}", f"{rank:.0f}"))
    lines += [
        markdown_table(headings, rows),
        "CPU milliseconds of the basis alone, the smallest of five, and what it finds:",
        "",
        _cases(),
    ]
    return "\n".join(lines)


def _rigid(place_nd: list[list[float]]) -> pm.Packing:
    place = np.array(place_nd)
    i, j = np.triu_indices(len(place), 1)
    length = np.sqrt(((place[j] - place[i]) ** 2).sum(axis=1))
    links = pm.Links(i, j, np.zeros((len(i), place.shape[1])), length)
    return pm.Packing(place, np.full(len(place), 0.5), pm.Box.cubic(9.0, place.shape[1]), links)


def _cases() -> str:
    """Return a table of the named cases: method against rank, orthogonality and seconds."""
    cases = {
        f"chain of {LENGTH}, angles free": _chain(0.6, 1),
        f"chain of {LENGTH}, angles fixed": _chain(0.6, 2),
        f"chain of {LENGTH}, all pairs up to 4 apart": _chain(0.6, 4),
        f"chain of {LENGTH}, nearly straight (0.01 rad)": _chain(0.01, 2),
        "rigid trimer, collinear": _rigid([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]),
        "rigid tetramer, coplanar": _rigid([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
    }
    rows = []
    for name, packing in cases.items():
        assert packing.links is not None
        for method in METHODS:
            found = [pm.constraint_basis(packing, method=method) for _ in range(5)]
            took = 1e3 * min(one.seconds for one in found)
            orthogonality = f"{found[0].orthogonality:.1e}"
            rows.append((name, str(len(packing.links)), method, str(found[0].rank), orthogonality, f"{took:.2f}"))
    return markdown_table(("case", "links", "method", "rank", "orthogonality", "CPU ms"), rows).rstrip("\n")
