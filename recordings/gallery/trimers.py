"""How many contacts hold a packing of rigid molecules?

Schreck, Xu and O'Hern, Soft Matter 6, 2960 (2010): rigid dimers in the plane have at jamming as many contacts as
degrees of freedom ask for, unlike ellipses. Here bent trimers of random angles with all strains free: with one state
of self stress, contacts are as many as the isostatic count.

Prints, with a margin for other seeds, of which one more set was run:
    contacts less isostatic contacts = 0
    packing fraction = 0.779 +- 0.020
    strictly = jammed

Time: 6 s, as a processor counts, with compiled code on disk. Larger: recordings/trimers.py, in space too.
"""

import sys

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.cluster_packing(
    24, pm.Trimer(angle=(1.1, 2.6)), dimension=2, packing_fraction=0.35, largest_overlap=0.1, seed=seed
)
run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8)
scene = pm.Scene(run.packing, (pm.Repulsion(),))
ax = pm.plot(scene)
ax.figure.savefig(f"{out}/trimers.png", dpi=120)
print(f"contacts less isostatic contacts = {run.report['contacts'] - run.report['isostatic_contacts']}")
print(f"packing fraction = {run.report['packing_fraction']:.3f}")
print(f"strictly = {pm.classify_jamming(run.packing).strict}")
