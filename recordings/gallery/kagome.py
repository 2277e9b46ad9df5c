"""Is the kagome lattice jammed, and if not, which motion unjams it?

Torquato and Stillinger, J. Phys. Chem. B 105, 11849 (2001); Donev, Torquato, Stillinger and Connelly, J. Appl. Phys.
95, 989 (2004): each disc is held by its neighbors (locally jammed), but many can move together. A lattice of L x L
cells has 3 L - 2 floppy modes besides translations: one more state of self stress for each row than contacts and
degrees of freedom balance.

Prints, exactly:
    collectively = not jammed
    floppy modes = 7
    contacts opened by the motion = 54

Time: 4 s, as a processor counts, with compiled code on disk. Larger: any lattice of pm.lattice_packing.
"""

import sys

import packmech as pm

out = sys.argv[1] if sys.argv[1:] else "."
packing = pm.lattice_packing("kagome", repeats=(3, 3))
verdict = pm.classify_jamming(packing)
played = pm.play_motion(packing, verdict.unjamming_motion, amplitude=0.8)
ax = pm.plot(verdict, packing=packing)
ax.figure.savefig(f"{out}/kagome.png", dpi=120)
print(f"collectively = {verdict.collective}")
print(f"floppy modes = {verdict.collectively.floppy_modes}")
print(f"contacts opened by the motion = {played.opened_t[-1]}")
