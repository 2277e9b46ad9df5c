"""At which strain does a jammed packing soften and yield under oscillatory shear?

Boschan, Vagberg, Somfai and Tighe, Soft Matter 12, 5450 (2016), on soft discs beyond linear elasticity: G' keeps the
value of linear response up to some strain, then falls. The yield strain is where G' and G'' cross, at this frequency.
Overdamped discs, drag against the flow.

Prints, with a margin for other seeds, of which one more set was run:
    G' at the smallest amplitude over linear response = 1.000 +- 0.002
    yield strain = 0.094 +- 0.030

Time: 6 s, as a processor counts, with compiled code on disk. Larger: several packings (pm.shear_series), and
frequencies.
"""

import sys

import numpy as np

import packmech as pm

out, seed = sys.argv[1] if sys.argv[1:] else ".", 1
start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
law = pm.Repulsion(pm.LinearSpring())
packing = pm.jam(pm.Scene(start, (law,)), pressure=1e-2).packing
scene = pm.Scene(packing, (law, pm.BackgroundDamping(1.0)))
sweep = pm.amplitude_sweep(scene, amplitudes=np.geomspace(1e-4, 0.3, 8), frequency=2e-3, periods=3)
ax = pm.plot(sweep)
linear = pm.complex_modulus(scene, [2e-3])
ax.axhline(linear.storage_f[0], color="k", linestyle=":", label="linear response, $G'$")
ax.legend(frameon=False, fontsize=9)
ax.figure.savefig(f"{out}/amplitude_sweep.png", dpi=120)
print(f"G' at the smallest amplitude over linear response = {sweep.storage_a[0] / linear.storage_f[0]:.3f}")
print(f"yield strain = {pm.yield_strain(sweep.amplitude_a, sweep.storage_a, sweep.loss_a):.3f}")
