"""How does the packing fraction at jamming change while a hard packing is sheared?

Bertrand, Behringer, Chakraborty, O'Hern and Shattuck, Phys. Rev. E 93, 012901 (2016): along geometric families, smooth
in the strain, with kinks and jumps where the contact network changes. Ten discs; how many networks there are, and how
high they go, is another matter in each packing.

Prints, with a margin for other seeds, of which one more set was run:
    families = 21 +- 8
    range of the packing fraction = 0.0440 +- 0.0250

Time: 7 s, as a processor counts, with compiled code on disk. Larger: recordings/families.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(10, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.8, seed=seed)
jammed = pm.jam(pm.Scene(start, (pm.Repulsion(),)), strain="isotropic").packing
run = pm.shear_families(jammed, 0.5)
ax = pm.plot(run)
ax.figure.savefig(f"{out}/shear_families.png", dpi=120)
print(f"families = {len(np.unique(run.family_t))}")
print(f"range of the packing fraction = {np.ptp(run.packing_fraction_t):.4f}")
