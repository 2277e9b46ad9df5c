"""Moduli and projection with links at N = 1024 against the source's dense matrices taken literally, and memory.

The literal path: Gamma dense, its null space B by a QR of the whole matrix, H dense, B H B^T, its pseudoinverse by
singular values, back with B; a force less its part along the orthonormal columns of the dense Gamma with strains and
volume, and the same by the columns of the null space that a complete QR of that Gamma gives. None of it calls the
package's own dense forms, only `hessian` and `constraint_jacobian` for their entries.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_link_dense.py
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import scipy.linalg as sl
from bench_link_mechanics import linked_crystal
from bench_links import GOAL, chains, peak
from calibration import calibrate, cpu_seconds

import packmech as pm

# a column whose pivot is below this part of the first depends on the others; eigenvalues likewise are zero
_DEPENDENT = 1e-10


def literal_compliance(scene: pm.Scene) -> np.ndarray[Any, Any]:
    """Return V times the strain block of B^T (B H B^T)^+ B, every matrix dense (equations 28-32, 45, 49)."""
    packing = scene.packing
    gamma = pm.constraint_jacobian(packing, "free").toarray()
    whole, triangle, _ = sl.qr(gamma, pivoting=True)
    pivot = np.abs(np.diag(triangle))
    free = whole[:, int((pivot > _DEPENDENT * pivot[0]).sum()) :].T
    inverse = np.linalg.pinv(free @ pm.hessian(scene).toarray() @ free.T, rcond=_DEPENDENT)
    complete = free.T @ inverse @ free
    size = packing.position_nd.size
    return packing.box.volume * complete[size:, size:]


def literal_projection(packing: pm.Packing, whole: np.ndarray[Any, Any], scale: float) -> np.ndarray[Any, Any]:
    """Return (1 - Gamma_o Gamma_o^T) F for positions and scaled strains, Gamma_o by QR of the dense Gamma (18)."""
    gamma = pm.constraint_jacobian(packing, "isochoric").toarray()
    gamma[packing.position_nd.size :] /= scale
    column = sl.qr(gamma, mode="economic")[0]
    projected: np.ndarray[Any, Any] = whole - column @ (column.T @ whole)
    return projected


def literal_motion(packing: pm.Packing, whole: np.ndarray[Any, Any], scale: float) -> np.ndarray[Any, Any]:
    """Return Null Null^T F, Null the orthonormal complement of the dense Gamma by the complete QR of it."""
    gamma = pm.constraint_jacobian(packing, "isochoric").toarray()
    gamma[packing.position_nd.size :] /= scale
    free = sl.qr(gamma)[0][:, gamma.shape[1] :]
    projected: np.ndarray[Any, Any] = free @ (free.T @ whole)
    return projected


def moduli() -> None:
    """Print the ratio for moduli."""
    print(
        "moduli at N = 1024: beads, dimension, ours ms, literal ms, ratio, part of the goal, difference of compliance"
    )
    for beads, repeats in ((2, (32, 32)), (3, (32, 32)), (200, (32, 32)), (3, (16, 8, 8))):
        scene = linked_crystal(beads, repeats)
        ours = cpu_seconds(lambda s=scene: pm.elastic_moduli(s), repeats=9)
        began = time.process_time()
        dense = literal_compliance(scene)
        literal = time.process_time() - began
        error = np.abs(pm.compliance_matrix(scene) - dense).max() / np.abs(dense).max()
        ratio = literal / ours
        print(
            f"  {beads:4d} {len(repeats)}D N = {scene.packing.particles} {1e3 * ours:9.1f} {1e3 * literal:10.0f} "
            f"{ratio:7.0f} {ratio / GOAL['dense ratio of moduli']:6.2f} {error:9.1e}",
            flush=True,
        )


def projection() -> None:
    """Print the ratios for a first force on a packing, on one with new links too, and for further forces on it."""
    packing = chains(128, 8)
    rng = np.random.default_rng(2)
    force, pull = rng.normal(size=packing.position_nd.shape), rng.normal(size=3)
    scale = packing.box.volume**0.5
    first = cpu_seconds(lambda: pm.project_force(packing.replace(), force, pull, strain="isochoric"), repeats=51)
    # what is kept about links from call to call is not there for new ones; to make and check these is no part of it
    fresh = iter([packing.replace(links=packing.links.scaled(1.0)) for _ in range(100)])
    unseen = cpu_seconds(lambda: pm.project_force(next(fresh), force, pull, strain="isochoric"), repeats=51)
    further = cpu_seconds(lambda: pm.project_force(packing, force, pull, strain="isochoric"), repeats=51)
    whole = np.concatenate([force.ravel(), pull / scale])
    found = pm.project_force(packing, force, pull, strain="isochoric")
    mine = np.concatenate([found.force_nd.ravel(), found.strain_force_e / scale])
    print("projection with strains and volume at N = 1024, against two dense paths")
    for title, path in (
        ("Gamma's columns", literal_projection),
        ("Gamma and its null space", literal_motion),
    ):
        literal = cpu_seconds(lambda path=path: path(packing, whole, scale), repeats=3)
        dense = path(packing, whole, scale)
        error = np.abs(mine - dense).max() / np.abs(dense).max()
        print(f"  {title}: literal {1e3 * literal:.0f} ms, difference {error:.1e}")
        for name, took in (("a first force", first), ("new links", unseen), ("a further force", further)):
            ratio = literal / took
            print(f"    {name:<16} {1e3 * took:8.2f} ms, ratio {ratio:6.0f}, {ratio / GOAL['dense ratio']:.2f} of goal")


def memory() -> None:
    """Print the most that is held at once at N = 16,000, which bounds the largest array."""
    scene = linked_crystal(200, (160, 100))
    packing = scene.packing
    force = np.random.default_rng(3).normal(size=packing.position_nd.shape)
    print(
        f"most memory at once at N = {packing.particles}, no array is larger; goal {GOAL['largest array'] / 1e6:.0f} MB"
    )
    for name, call in {
        "moduli": lambda: pm.elastic_moduli(scene),
        "projection with strains and volume": lambda: pm.project_force(packing, force, np.ones(3), strain="isochoric"),
        "re-affixing": lambda: pm.reaffix_links(packing.replace(position_nd=packing.position_nd + 1e-3 * force)),
        "Hessian": lambda: pm.hessian(scene),
    }.items():
        print(f"  {name:<36} {peak(call) / 1e6:8.1f} MB", flush=True)


if __name__ == "__main__":
    calibrate()
    moduli()
    projection()
    memory()
