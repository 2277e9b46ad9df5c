"""Of which order is an integrator, and what does accuracy cost?

Hairer, Lubich and Wanner, Geometric Numerical Integration (2006): velocity Verlet is of second order, semi-implicit
Euler of first, where forces are smooth. Discs under pressure that swing too little for contacts to change, started off
balance: from rest without force both would be of second order.

Prints, with a margin for other seeds, of which one more set was run:
    order of velocity Verlet = 2.01 +- 0.05
    order of semi-implicit Euler = 1.06 +- 0.08

Time: 3 s, as a processor counts, with compiled code on disk. Larger: recordings/accuracy/integrators.py, with contacts
that come and go.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(512, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.88, seed=seed)
scene = pm.Scene(start, (pm.Repulsion(pm.LinearSpring()),))
scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-10).packing)
moved = scene.packing.position_nd + 1e-4 * np.random.default_rng(seed).normal(size=(512, 2))
scene = scene.replace(packing=scene.packing.replace(position_nd=moved))


def swing(dt, method=pm.VelocityVerlet):
    return pm.simulate(scene, duration=5.0, dt=dt, method=method()).packing.position_nd


methods = {"velocity Verlet": swing, "semi-implicit Euler": lambda dt: swing(dt, pm.SemiImplicitEuler)}
found = pm.work_precision(methods, [0.1, 0.05, 0.025, 0.0125, 0.00625], swing(0.001), repeats=1)
ax = pm.plot(found)
ax.set_ylabel("largest error of a position [length]")
ax.figure.savefig(f"{out}/integrator_order.png", dpi=120)
for name in methods:
    print(f"order of {name} = {found.order(name):.2f}")
