"""Does a packing that is jammed in its box stay jammed when the box is repeated?

Donev, Torquato and Stillinger, J. Comput. Phys. 197, 139 (2004): two copies can have motions that one has not. A
packing that was compressed in a box of fixed shape has one contact more than that box asks for, which is less than
waves do. One whose box gave way in all strains has two more, and is proven to be jammed in any number of copies.

Prints:
    fixed shape, when repeated = not jammed in 1 x 2 copies
    free shape, when repeated = jammed for all repeats
    longest change of a contact by the motion below 1e-12 = True

Time: 4 s, as a processor counts, with compiled code on disk. Larger: shares over N, recordings/tiled/shares.py.
"""

import sys

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.8, seed=seed)
for strain, shape in (("isotropic", "fixed"), ("free", "free")):
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-9, strain=strain).packing
    tiled = pm.classify_jamming(packing, tiled=True).tiled
    where = "for all repeats" if tiled.repeats is None else f"in {' x '.join(map(str, tiled.repeats))} copies"
    print(f"{shape} shape, when repeated = {tiled.collective} {where}")
    if tiled.motion is not None:
        longest = max(tiled.motion.opening, tiled.motion.closing)
        pm.plot(tiled).figure.savefig(f"{out}/repeated.png", dpi=120)
print(f"longest change of a contact by the motion below 1e-12 = {longest < 1e-12}")
