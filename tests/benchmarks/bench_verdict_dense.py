"""A verdict at N ~ 1000 against the source's program taken literally: dense basis, dense R B^T, cvxpy.

The literal path: Gamma dense with the uniform translations appended and the volume's column, its null space B by a QR
of the whole matrix, R B^T dense, then min b.z and min -b.z over R B^T z >= 0, |z| <= 1 through cvxpy at its default
settings. (As printed R B^T z <= 0, which is the same question about -z.) It is asked with strains only; the package
answers with strains and in the fixed box.

The source's program is for packings with links: the goal is judged on jammed discs half of which are linked in pairs
that touch, a random matching. Links given to pairs of a packing at rest keep it at rest, and jammed.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_verdict_dense.py
"""

from __future__ import annotations

import time

import numpy as np
import scipy.linalg as sl
from bench_link_mechanics import linked_crystal
from bench_verdict import soft_packing
from calibration import calibrate, cpu_seconds

import packmech as pm
from packmech.jamming.contact_selection import backbone_of, select_contacts

GOAL = {"certificate": 150.0, "loads": 100.0}


def literal(packing: pm.Packing, gap_tolerance: float | None) -> tuple[float, float]:
    """Return the CPU seconds of the literal path and the longest motion that it finds."""
    import cvxpy as cp

    began = time.process_time()
    network, kept = backbone_of(packing, select_contacts(packing, gap_tolerance).contacts)
    d = packing.dimension
    strains = d * (d + 1) // 2
    moving = (kept[:, None] * d + np.arange(d)).ravel()
    columns = np.concatenate([moving, packing.position_nd.size + np.arange(strains)])
    rigidity = pm.rigidity_matrix(packing, "free", contacts=network).toarray()[:, columns]
    gamma = np.zeros((len(columns), 0))
    if packing.links:
        gamma = pm.constraint_jacobian(packing, "free").toarray()[columns]
        gamma = gamma[:, np.abs(gamma).max(axis=0) > 0]
    translations = np.zeros((len(columns), d))
    translations[: len(moving)] = np.tile(np.eye(d), (len(kept), 1))
    volume = np.zeros((len(columns), 1))
    volume[len(moving) : len(moving) + d] = 1.0
    gamma = np.hstack([gamma, translations, volume])
    whole, _ = sl.qr(gamma)
    basis = whole[:, gamma.shape[1] :].T
    dense = rigidity @ basis.T
    load = np.random.default_rng(0).standard_normal(len(basis))
    load /= np.linalg.norm(load)
    longest = 0.0
    for sign in (1.0, -1.0):
        z = cp.Variable(len(basis))
        cp.Problem(cp.Minimize(sign * load @ z), [dense @ z >= 0, cp.norm(z, 2) <= 1]).solve(
            solver=cp.CLARABEL, max_threads=1
        )
        longest = max(longest, float(np.linalg.norm(z.value)))
    return time.process_time() - began, longest


def with_matching(packing: pm.Packing, linked: float, seed: int) -> pm.Packing:
    """Return the packing with links between touching pairs, none sharing a particle, for that part of them."""
    contacts = pm.find_contacts(packing)
    free = np.ones(packing.particles, dtype=bool)
    chosen: list[int] = []
    for c in np.random.default_rng(seed).permutation(len(contacts)):
        i, j = contacts.i_c[c], contacts.j_c[c]
        if i != j and free[i] and free[j] and 2 * len(chosen) < linked * packing.particles:
            chosen.append(int(c))
            free[i] = free[j] = False
    pairs = contacts.select(np.array(chosen))
    return packing.replace(links=pm.Links(pairs.i_c, pairs.j_c, pairs.image_cd, pairs.distance_c))


if __name__ == "__main__":
    calibrate()
    discs = soft_packing(1024, 2, "free", 1)
    for name, packing, gap_tolerance in (
        ("discs N = 1024, half of them linked in pairs", with_matching(discs, 0.5, 1), None),
        ("discs N = 1024", discs, None),
        ("rigid dimers in a crystal, N = 1024", linked_crystal(2, (32, 32)).packing, 0.0),
    ):
        pm.classify_jamming(pm.lattice_packing("triangular", (4, 4)))
        took, longest = literal(packing, gap_tolerance)
        print(f"{name}: literal {took:.2f} s, longest motion {longest:.0e}", flush=True)
        for method, goal in GOAL.items():
            verdict = pm.classify_jamming(packing, method=method, gap_tolerance=gap_tolerance)
            ours = cpu_seconds(
                lambda p=packing, m=method, g=gap_tolerance: pm.classify_jamming(p, method=m, gap_tolerance=g),
                repeats=5,
            )
            programs = sum(one.seconds for one in verdict.strictly.solves)
            print(
                f"  {method:>12}: {1e3 * ours:7.1f} ms ({1e3 * programs:.1f} in its solvers), {verdict.strict}, "
                f"ratio {took / ours:5.0f}, {took / ours / goal:.2f} of the goal",
                flush=True,
            )
