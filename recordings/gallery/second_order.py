"""What holds a packing of ellipses that has too few contacts for its degrees of freedom?

Schreck, Mailman, Chakraborty and O'Hern, Phys. Rev. E 85, 061305 (2012): motions that no contact resists to first order
are held by the contact forces, as ellipses push back when they turn. That is prestress stability in the sense of
Connelly and Whiteley, SIAM J. Discrete Math. 9, 453 (1996): a state of self stress holds every floppy mode, proven here
by its curvatures. Their number is what the contacts lack.

Prints, with a margin for other seeds, of which one more set was run:
    prestress stable of 4 packings = 4 +- 1
    floppy modes per particle at aspect 1.1 = 0.46 +- 0.10
    floppy modes less those counted by contacts = 0

Time: 7 s, as a processor counts, with compiled code on disk. Larger: more particles, spheroids.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
law, aspects, rows = (pm.Repulsion(),), (1.1, 1.3, 1.6, 2.0), []
for aspect in aspects:
    shapes = pm.Ellipses(aspect)
    start = pm.random_packing(48, dimension=2, packing_fraction=0.7, seed=seed, shapes=shapes)
    scene = pm.Scene(pm.jam(pm.Scene(start, law), pressure=1e-7).packing, law)
    found = pm.second_order(scene)
    # each ellipse has three motions, two of the whole cost nothing; a state of self stress is a contact to spare
    lack = 3 * (48 - found.rattlers) - 2 - (found.contacts - found.self_stresses)
    rows.append((found.prestress_stable == "yes", found.floppy_modes, found.floppy_modes - lack))
stable, modes, less = np.array(rows, dtype=float).T
figure = pm.plot(scene).figure
figure.axes[0].set_title(f"aspect {aspects[-1]}: {int(modes[-1])} floppy modes, held by the forces")
figure.savefig(f"{out}/second_order.png", dpi=120)
print(f"prestress stable of {len(aspects)} packings = {int(stable.sum())}")
print(f"floppy modes per particle at aspect 1.1 = {modes[0] / 48:.2f}")
print(f"floppy modes less those counted by contacts = {int(np.abs(less).max())}")
