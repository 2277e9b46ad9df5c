"""How steep is a heap of discs with friction on a rough floor?

Zhou, Wright, Yang, Xu and Yu, Physica A 269, 536 (1999), on rolling friction and sand piles. A column of 200 discs,
friction .5, collapses onto a floor of held discs, and comes to rest under gravity. Its slope depends on how it falls:
a collapsed column is flatter than a heap that is poured.

Prints, with a margin for other seeds, of which one more set was run:
    slope of the surface in degrees = 22.1 +- 6.0
    weight that the floor bears over all weight = 1.0000 +- 0.0001

Time: 7 s, as a processor counts, with compiled code on disk. Larger: thousands of discs, poured.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
rng = np.random.default_rng(seed)
column = np.array([(24.0 + 1.25 * (i + 0.5 * (j % 2)), 1.4 + 1.05 * j) for j in range(20) for i in range(10)])
floor = np.array([(0.5 + x, 0.5) for x in range(60)])
radius = np.concatenate([rng.permutation(np.repeat([0.42, 0.58], 100)), np.full(60, 0.5)])
place = np.concatenate([column + rng.uniform(-0.02, 0.02, column.shape), floor])
packing = pm.Packing(place, radius, pm.Box(np.diag([60.0, 40.0])))
effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.4), pm.Friction(0.5, 0.5), pm.Gravity(0.0, -1e-4))
effects += (pm.FixedParticles(tuple(range(200, 260))), pm.BackgroundDamping(0.003))
run = pm.settle(pm.Scene(packing, effects), force_tolerance=1e-6)
scene = pm.Scene(run.packing, effects)
x, y = run.packing.position_nd[:200].T
height = np.array([y[abs(x - x.mean()) > distance].max() for distance in range(2, 14, 2)])
found = pm.contact_forces(scene)
on_floor = (found.contacts.i_c < 200) & (found.contacts.j_c >= 200)
borne = found.force_cd[on_floor, 1].sum() / (1e-4 * run.packing.mass_n[:200].sum())
ax = pm.plot(scene, copies=False)
ax.set_ylim(-0.5, 11.0)
ax.figure.set_size_inches(8.0, 2.8)
ax.figure.savefig(f"{out}/pile.png", dpi=120)
print(f"slope of the surface in degrees = {np.degrees(np.arctan(-np.polyfit(np.arange(2, 14, 2), height, 1)[0])):.1f}")
print(f"weight that the floor bears over all weight = {borne:.4f}")
