"""Where does the plateau of the density of vibrational states end?

Silbert, Liu and Nagel, Phys. Rev. Lett. 95, 098301 (2005); Wyart, Nagel and Witten, Europhys. Lett. 72, 486 (2005):
D(omega) has a plateau down to omega* ~ P^(1/2), below which there are few modes. All masses are 1, contacts without
the forces that they bear.

Prints, with a margin for other seeds, of which one more set was run:
    plateau = 0.427 +- 0.020
    omega* at P 0.003 = 0.0594 +- 0.0100
    exponent of omega* = 0.52 +- 0.06

Time: 10 s, as a processor counts, with compiled code on disk. Larger: N = 1024, ten packings (recordings/spectra):
.514(15).
"""

import sys

import numpy as np

import packmech as pm

out, seed, ax, found = sys.argv[1] if sys.argv[1:] else ".", 1, None, []
start = pm.random_packing(512, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
scene = pm.Scene(start, (pm.Repulsion(),))
pressures = (5e-4, 3e-3, 2e-2)
for pressure in pressures:
    jammed = pm.jam(scene, pressure=pressure, strain="isotropic").packing
    alike = scene.replace(packing=jammed.replace(mass_n=np.ones(512)))
    states = pm.density_of_states(alike, np.geomspace(1e-2, 4.0, 27), kind="unstressed")
    found.append(states)
    ax = pm.plot(states, ax, log=True, label=f"$P$ = {pressure:g}, $\\omega^*$ = {states.plateau_edge:.3f}")
ax.figure.savefig(f"{out}/density_of_states.png", dpi=120)
print(f"plateau = {found[0].plateau:.3f}")
print(f"omega* at P 0.003 = {found[1].plateau_edge:.4f}")
edges = [one.plateau_edge for one in found]
print(f"exponent of omega* = {np.polyfit(np.log(pressures), np.log(edges), 1)[0]:.2f}")
