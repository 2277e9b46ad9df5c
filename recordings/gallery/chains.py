"""How does the packing fraction of granular polymers depend on the length of the chains?

Zou, Cheng, Rivers, Jaeger and Nagel, Science 326, 408 (2009): long floppy chains jam looser than short ones; Lopatina,
Reichhardt and Reichhardt, Phys. Rev. E 84, 011303 (2011), in two dimensions. Flexible chains of equal discs, 96 in
all; dimers are dense, since equal discs order.

Prints, with a margin for other seeds, of which one more set was run:
    phi_J of dimers = 0.842 +- 0.008
    phi_J of chains of 16 = 0.816 +- 0.015

Time: 23 s, as a processor counts, with compiled code on disk. Larger: more discs than these 96, by the length of the
chains.
"""

import sys

import packmech as pm

out, first = sys.argv[1] if sys.argv[1:] else ".", 0


def jam(beads: int, seed: int) -> pm.Run:
    start = pm.chain_packing(96 // beads, beads, dimension=2, packing_fraction=0.4, largest_overlap=0.2, seed=seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-5, strain="isotropic", check=False)


grid = {"beads": [2, 4, 8, 16], "seed": range(first, first + 4)}
found = pm.run_ensemble(jam, grid, f"{out}/members/chains", workers=0).of(grid)
mean = pm.group_statistics(found, "packing_fraction", ["beads"])
ax = pm.plot(mean)
x = mean.by["beads"]
ax.set(xscale="log", xticks=x, xticklabels=x, xlabel="discs in a chain", ylabel=r"packing fraction at jamming $\phi_J$")
ax.minorticks_off()
ax.figure.savefig(f"{out}/chains.png", dpi=120)
print(f"phi_J of dimers = {mean.value_g[0]:.3f}")
print(f"phi_J of chains of 16 = {mean.value_g[-1]:.3f}")
