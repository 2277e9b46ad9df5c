"""The source's program of strict jamming taken literally: dense basis, dense R B^T, cvxpy.

The literal path: Gamma dense with the uniform translations appended and the volume's column, its null space B by a QR
of the whole matrix, R B^T dense, then min b.z and min -b.z over R B^T z >= 0, |z| <= 1 through cvxpy at its default
settings, here Clarabel. (As printed R B^T z <= 0, which is the same question about -z.) It is asked with strains only;
the package answers with strains and in the fixed box.

The source's program is for packings with links: the goal is judged on jammed discs half of which are linked in pairs
that touch, a random matching. Links given to pairs of a packing at rest keep it at rest, and jammed.
"""

from __future__ import annotations

import time

import numpy as np
import scipy.linalg as sl

import packmech as pm
from packmech.jamming.contact_selection import backbone_of, select_contacts


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
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    free = np.ones(packing.particles, dtype=bool)
    chosen: list[int] = []
    for c in np.random.default_rng(seed).permutation(len(contacts)):
        i, j = contacts.i_c[c], contacts.j_c[c]
        if i != j and free[i] and free[j] and 2 * len(chosen) < linked * packing.particles:
            chosen.append(int(c))
            free[i] = free[j] = False
    pairs = contacts.select(np.array(chosen))
    return packing.replace(links=pm.Links(pairs.i_c, pairs.j_c, pairs.image_cd, pairs.distance_c))
