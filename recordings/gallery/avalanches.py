"""How does a jammed packing give way when it is sheared slowly?

Maloney and Lemaitre, Phys. Rev. E 74, 016118 (2006): elastic branches end in avalanches, in which the stress drops; in
the mean as much falls as is built up. 128 discs at a pressure of 1e-2, one packing, from equilibrium to equilibrium at
constant volume.

Prints, with a margin for other seeds, of which one more set was run:
    avalanches = 22 +- 15
    largest stress drop = 0.00058 +- 0.00040
    mean stress beyond a strain of 0.08 = 0.00077 +- 0.00040

Time: 30 s, as a processor counts, with compiled code on disk. Larger: strains of 2 and more and several packings, for
the statistics of drops.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
scene = pm.Scene(start, (pm.Repulsion(),))
scene = scene.replace(packing=pm.jam(scene, pressure=1e-2).packing)
run = pm.quasistatic_shear(scene, 0.2, step=2e-3)
drops = np.array([one.stress_drop for one in run.avalanches])
steady = run.strain_t > 0.08
ax = pm.plot(run)
ax.figure.savefig(f"{out}/avalanches.png", dpi=120)
print(f"avalanches = {len(drops)}")
print(f"largest stress drop = {drops.max():.5f}")
print(f"mean stress beyond a strain of 0.08 = {run.shear_stress_t[steady].mean():.5f}")
