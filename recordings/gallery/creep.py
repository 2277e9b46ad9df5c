"""How far does a jammed packing creep under a constant stress?

Dagois-Bohy, Somfai, Tighe and van Hecke, Soft Matter 13, 9036 (2017), on softening and yielding of soft discs. Under a
small stress the strain comes to rest at stress / G with G of linear response; under a larger one contacts change and
it goes further, or flows. One packing of 64 discs.

Prints, with a margin for other seeds, of which one more set was run:
    strain over stress / G at stress 1e-05 = 1.000 +- 0.005
    strain over stress / G at stress 0.001 = 1.845 +- 2.000
    strain over stress / G at stress 0.004 = 20.057 +- 19.000

Time: 20 s, as a processor counts, with compiled code on disk. Larger: longer times, and several packings near the
yield stress.
"""

import sys

import packmech as pm

out, seed, ax = sys.argv[1] if sys.argv[1:] else ".", 1, None
start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
law = pm.Repulsion(pm.LinearSpring())
scene = pm.Scene(pm.jam(pm.Scene(start, (law,)), pressure=1e-2).packing, (law, pm.BackgroundDamping(1.0)))
static = pm.elastic_moduli(scene.without(pm.BackgroundDamping)).shear_modulus
for stress in (1e-5, 1e-3, 4e-3):
    run = pm.creep(scene, stress=stress, duration=1500.0, check=False)
    ax = pm.plot(run, ax, log=True, label=rf"$\sigma$ = {stress:g} energy/length$^2$")
    print(f"strain over stress / G at stress {stress:g} = {run.strain_t[-1] * static / stress:.3f}")
ax.figure.savefig(f"{out}/creep.png", dpi=120)
