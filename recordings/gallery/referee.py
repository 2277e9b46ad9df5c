"""How large a fault in the certificate of a jammed packing does a referee notice who believes none of it?

Contact forces that all push and balance, and rows of full rank, prove that a packing is jammed (Roth and Whiteley,
Trans. Am. Math. Soc. 265, 419 (1981)). Forces that nearly balance prove it too, as long as what they leave, over a
bound on the smallest singular value, is less than the least of them: a certificate with a smaller fault is still a
proof. A radius may be wrong as far as contacts touch within the gap tolerance, and rattlers find room.

Prints, with a margin for other seeds, of which one more set was run:
    share refused of faults of 1e-5 in a force = 1.00 +- 0.01
    share refused of faults of 1e-5 in a radius = 1.00 +- 0.20
    share refused of faults of 1e-11 in a radius = 0.00 +- 0.01

Time: 6 s, as a processor counts, with compiled code on disk. Larger: more particles, up to some thousand.
"""

import functools
import sys

import numpy as np

import packmech as pm

out, first, ax = sys.argv[1] if sys.argv[1:] else ".", 0, None


@functools.cache
def certificate(seed: int) -> dict[str, np.ndarray]:
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.8, seed=seed)
    verdict = pm.classify_jamming(pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8).packing)
    pm.write_certificate(verdict, f"{out}/members/referee.npz")
    return dict(np.load(f"{out}/members/referee.npz"))


def refused(array: str, fault: float, seed: int) -> dict[str, float]:
    changed = certificate(seed)[array].copy()
    changed[np.random.default_rng(seed).integers(len(changed))] += fault * np.abs(changed).mean()
    np.savez(f"{out}/members/referee.npz", **(certificate(seed) | {array: changed}))
    return {"refused": float(not pm.verify(f"{out}/members/referee.npz").accepted)}


for array, label in (("strict_force_c", "in a force"), ("radius_n", "in a radius")):
    grid = {"array": [array], "fault": np.logspace(-11, -3, 17), "seed": range(first, first + 6)}
    found = pm.run_ensemble(refused, grid, f"{out}/members/referee/{array}", workers=0).of(grid)
    share = pm.group_statistics(found, "refused", ["fault"])
    ax = pm.plot(share, ax, log=False, label=label)
    print(f"share refused of faults of 1e-5 {label} = {share.value_g[12]:.2f}")
ax.set(xscale="log", xlabel="fault / mean of the array", ylabel="share of certificates refused")
ax.figure.savefig(f"{out}/referee.png", dpi=120)
print(f"share refused of faults of 1e-11 in a radius = {share.value_g[0]:.2f}")
