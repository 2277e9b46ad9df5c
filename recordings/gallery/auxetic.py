"""Which springs must be cut so that a network grows wide when it is pulled?

Goodrich, Liu and Nagel, Phys. Rev. Lett. 114, 225501 (2015): as bonds differ in what they do for the bulk and for the
shear modulus, cutting the right ones leads to any Poisson ratio. Derivatives of the ratio by all bonds at once are one
adjoint solve (`pm.sensitivity`); `pm.design` cuts the best, and asks again.

Prints, with a margin for other seeds, of which one more set was run:
    Poisson ratio before = 0.45 +- 0.08
    Poisson ratio after = -0.60 +- 0.12
    springs cut = 13 +- 4

Time: 4 s, as a processor counts, with compiled code on disk. Larger: other goals, recordings/design/design.py.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.96, seed=seed)
packing = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-12).packing
springs = pm.bond_contacts(packing, rest="distance", tangential_stiffness=0.0)
points = packing.replace(radius_n=0.1 * packing.radius_n)
run = pm.design(pm.Scene(points, (pm.Repulsion(), springs)), "poisson_ratio", "bonds", at_most=-0.5)
kept = next(one for one in run.scene.effects if isinstance(one, pm.Bonds))
ax = pm.plot(points)
ax.get_legend().remove()
for bonds, color, width in ((springs, "C3", 1.0), (kept, "0.35", 2.0)):
    first = points.position_nd[bonds.i_b]
    last = points.position_nd[bonds.j_b] + bonds.image_bd @ points.box.lattice_dd.T
    ax.plot(*np.stack([first, last]).transpose(2, 0, 1), color=color, linewidth=width, zorder=0.5)
ax.set_title(f"Poisson ratio {run.value_t[0]:.2f} to {run.value_t[-1]:.2f} without the red springs")
ax.figure.savefig(f"{out}/auxetic.png", dpi=120)
print(f"Poisson ratio before = {run.value_t[0]:.2f}")
print(f"Poisson ratio after = {run.value_t[-1]:.2f}")
print(f"springs cut = {len(springs) - len(kept)}")
