"""How many contacts have ellipses at jamming, between discs (4) and twice their degrees of freedom (6)?

Donev et al., Science 303, 990 (2004); Mailman, Schreck, O'Hern and Chakraborty, Phys. Rev. Lett. 102, 255501 (2009): z
grows continuously from 4 with the aspect and stays below 6; what is missing are quartic modes.

Prints, with a margin for other seeds, of which one more set was run:
    z at aspect 1.05 = 4.421 +- 0.200
    z at aspect 1.8 = 5.604 +- 0.200

Time: 8 s, as a processor counts, with compiled code on disk. Larger: N = 128, ten packings, quartic modes counted
(recordings/shapes/jammed.py).
"""

import sys

import packmech as pm

out, first = sys.argv[1] if sys.argv[1:] else ".", 0


def jam(aspect: float, seed: int) -> dict[str, float]:
    given = {"sizes": pm.Bidisperse(1.4), "packing_fraction": 0.6, "seed": seed}
    start = pm.random_packing(32, dimension=2, shapes=pm.Ellipses(aspect), **given)
    found = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic", check=False).report
    return {"z": 2 * found["contacts"] / (32 - found["rattlers"]), "packing_fraction": found["packing_fraction"]}


grid = {"aspect": [1.02, 1.05, 1.1, 1.3, 1.8], "seed": range(first, first + 3)}
found = pm.run_ensemble(jam, grid, f"{out}/members/ellipses", workers=0).of(grid)
z = pm.group_statistics(found, "z", ["aspect"])
ax = pm.plot(z)
ax.set(xlabel="aspect ratio", ylabel="coordination number $z$ without rattlers")
ax.figure.savefig(f"{out}/ellipses.png", dpi=120)
print(f"z at aspect 1.05 = {z.value_g[1]:.3f}")
print(f"z at aspect 1.8 = {z.value_g[-1]:.3f}")
