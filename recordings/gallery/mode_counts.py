"""How many vibrations of a large packing lie below a frequency, and is a list of those in a window complete?

Silbert, Liu and Nagel, Phys. Rev. Lett. 95, 098301 (2005), on the plateau of modes above omega*, which falls with
the pressure. The signs of a sparse factorization count modes without computing one (Sylvester's law of inertia), with a
proof that rounding changed none: exactly, at any size. Line: counts; red: the modes of a window, all of them.

Prints, with a margin for other seeds, of which one more set was run:
    share of modes below 0.05 = 0.0196 +- 0.0020
    modes missed in the window = 0
    largest residual below 1e-10 = True

Time: 10 s, as a processor counts, with compiled code on disk. Larger: a million discs, tests/benchmarks/.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(1024, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.84, seed=seed)
law = (pm.Repulsion(),)
cell = pm.jam(pm.Scene(start, law), pressure=1e-4, force_tolerance=1e-10).packing
scene = pm.Scene(cell.repeated((4, 4)), law)
counts = pm.count_modes(scene, np.geomspace(0.005, 0.1, 12), signs=False)
window = pm.normal_modes(scene, between=(0.015, 0.02))
ax = pm.plot(counts)
ax.plot(
    window.frequency_m, window.below + np.arange(len(window)), ".", markersize=3, color="C3", label="a window, listed"
)
ax.legend(frameon=False)
ax.figure.savefig(f"{out}/mode_counts.png", dpi=120)
below = pm.count_modes(scene, 0.05, signs=False)
print(f"share of modes below 0.05 = {below.count_v[0] / below.available:.4f}")
print(f"modes missed in the window = {window.missed}")
print(f"largest residual below 1e-10 = {window.residual < 1e-10}")
