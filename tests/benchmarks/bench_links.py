"""What links cost: basis, projection, way back to lengths and rank at N = 16,000; and against the dense reference.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_links.py
"""

from __future__ import annotations

import statistics
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
from calibration import calibrate, cpu_seconds

import packmech as pm
from packmech.constraints.link_system import make_link_system, project_links, record_link_positions, refill_links

GOAL = {
    "basis": 0.6,
    "projection": 1e-3,
    "re-affixing": 50e-3,
    "largest array": 200e6,
    "dense ratio": 300.0,
    "dense ratio of moduli": 100.0,
}


def chains(length: int, count: int, *, reach: int = 1, angle: float = 0.6, seed: int = 0) -> pm.Packing:
    """Return `count` chains side by side in two dimensions, each particle linked to the next `reach` along it."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.uniform(-angle, angle, (count, length)), axis=1)
    place = np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=2), axis=1)
    place[:, :, 1] += 2.5 * np.arange(count)[:, None]
    place = place.reshape(-1, 2)
    first = np.arange(count)[:, None] * length
    i = np.concatenate([(first + np.arange(length - u)).ravel() for u in range(1, reach + 1)])
    j = np.concatenate([(first + np.arange(u, length)).ravel() for u in range(1, reach + 1)])
    links = pm.Links(i, j, np.zeros((len(i), 2)), np.linalg.norm(place[j] - place[i], axis=1))
    return pm.Packing(place, np.full(len(place), 0.5), pm.Box.cubic(1.2 * max(length, 2.5 * count), 2), links)


def told(name: str, seconds: float, goal: float | None = None) -> None:
    """Print one figure in CPU milliseconds, with the part of its goal that it takes."""
    print(f"  {name:<46} {1e3 * seconds:10.3f} ms" + (f"   {seconds / goal:6.2f} of the goal" if goal else ""))


def peak(function: Callable[[], Any]) -> float:
    """Return the most memory that Python and numpy held at once during a call, beyond what was held before [bytes]."""
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    kept = function()
    most = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    del kept
    return float(most)


def large() -> None:
    """Time everything at N = 16,000 in 80 chains of 200."""
    packing = chains(200, 80)
    links = packing.links
    rng = np.random.default_rng(1)
    force, lattice = rng.normal(size=packing.position_nd.shape), packing.box.lattice_dd
    print(f"N = {packing.particles}, {len(links)} links, chains of 200, two dimensions")
    basis = pm.constraint_basis(packing)
    told("basis", cpu_seconds(lambda: pm.constraint_basis(packing), repeats=5), GOAL["basis"])
    print(f"  rank {basis.rank}, orthogonality {basis.orthogonality:.1e}")
    told("basis with strains and volume", cpu_seconds(lambda: pm.constraint_basis(packing, "isochoric"), repeats=5))
    told("independent links", cpu_seconds(lambda: pm.independent_links(packing), repeats=5))
    told("structure", cpu_seconds(lambda: make_link_system(links, packing.particles, 2)))
    system = make_link_system(links, packing.particles, 2, mean_diameter=1.0)
    refill_links(system, packing.position_nd, lattice)
    told("Jacobian and factor", cpu_seconds(lambda: refill_links(system, packing.position_nd, lattice)))
    out, multiplier = np.empty_like(force), np.empty(len(links))
    project_links(system, force, out, multiplier, True)
    took = cpu_seconds(lambda: project_links(system, force, out, multiplier, True), repeats=51)
    told("one projection", took, GOAL["projection"])
    pm.project_force(packing, force)
    took = cpu_seconds(lambda: pm.project_force(packing, force), repeats=51)
    told("project_force, a further force", took, GOAL["projection"])
    took = cpu_seconds(lambda: pm.project_force(packing.replace(), force))
    told("project_force, a first force", took)
    took = cpu_seconds(lambda: pm.project_force(packing.replace(), force, np.ones(3), strain="isochoric"))
    told("project_force with strains, a first force", took)
    spent = []
    for _ in range(7):
        place = packing.position_nd + 0.03 * rng.normal(size=force.shape)
        started = time.process_time()
        iterations, error, _ = record_link_positions(system, place, lattice, 1e-13, 20, np.empty(0))
        spent.append(time.process_time() - started)
    told(f"re-affixing from 3 %, {iterations} iterations to {error:.0e}", statistics.median(spent), GOAL["re-affixing"])
    moved = packing.replace(position_nd=packing.position_nd + 0.03 * rng.normal(size=force.shape))
    told("pm.reaffix_links", cpu_seconds(lambda: pm.reaffix_links(moved)), GOAL["re-affixing"])
    for name, call in {
        "basis": lambda: pm.constraint_basis(packing).link_basis,
        "basis of motions": lambda: pm.constraint_basis(packing, "isochoric").null_basis,
        "projection with strains": lambda: pm.project_force(packing.replace(), force, np.ones(3), strain="isochoric"),
        "re-affixing": lambda: pm.reaffix_links(moved),
    }.items():
        print(f"  most memory at once, {name:<25} {peak(call) / 1e6:10.1f} MB")
    found = pm.constraint_basis(packing, "isochoric")
    largest = max(m.data.nbytes for m in (found.null_basis, found.link_basis))
    print(f"  largest array {largest / 1e6:.1f} MB, {largest / GOAL['largest array']:.2f} of the goal")


def against_dense() -> None:
    """Time the projection against the dense reference at N = 1024, each from the packing to the force."""
    packing = chains(128, 8)
    rng = np.random.default_rng(2)
    force, pull = rng.normal(size=packing.position_nd.shape), rng.normal(size=3)
    print(f"N = {packing.particles}, chains of 128: from a packing to its first constrained force")
    for name, given in {"fixed box": None, "with strains and volume": pull}.items():
        volume = given is not None
        took, answer = {}, {}
        for method, repeats in (("clusters", 15), ("whole-matrix", 3)):
            call = lambda m=method, g=given, v=volume: pm.project_force(packing.replace(), force, g, volume=v, method=m)  # noqa: E731
            answer[method] = call()
            took[method] = cpu_seconds(call, repeats=repeats)
        ratio = took["whole-matrix"] / took["clusters"]
        differ = max(
            float(np.abs(getattr(answer["clusters"], part) - getattr(answer["whole-matrix"], part)).max())
            for part in ("force_nd", "strain_force_e", "multiplier_l")
        )
        told(f"clusters, {name}", took["clusters"])
        told(f"whole matrix, {name}", took["whole-matrix"])
        print(f"  ratio {ratio:.0f} ({ratio / GOAL['dense ratio']:.1f} of the goal), largest difference {differ:.1e}")


def by_method() -> None:
    """Print seconds and orthogonality of each method for the three chains of 200."""
    print("chains of 200: method, rank, orthogonality, CPU ms")
    for name, case in {
        "free angles": {}, "fixed angles": {"reach": 2}, "all pairs up to 4": {"reach": 4},
        "nearly straight": {"reach": 2, "angle": 0.01},
    }.items():  # fmt: skip
        packing = chains(200, 1, **case)  # type: ignore[arg-type]
        for method in ("householder", "gram-schmidt", "gram-schmidt-twice", "whole-matrix"):
            basis = pm.constraint_basis(packing, method=method)
            took = cpu_seconds(lambda m=method, p=packing: pm.constraint_basis(p, method=m), repeats=3)
            print(f"  {name:<18} {method:<20} {basis.rank:4d} {basis.orthogonality:9.1e} {1e3 * took:8.1f}")


if __name__ == "__main__":
    calibrate()
    large()
    against_dense()
    by_method()
