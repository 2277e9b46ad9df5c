"""How many contacts has a packing of discs with friction?

Silbert, Soft Matter 6, 2918 (2010); Shundyak, van Hecke and van Saarloos, Phys. Rev. E 75, 010301 (2007): z falls from
2d without friction to about d + 1 with strong friction. Packings are pressed in time at a finite rate; the slower, the
lower z.

Prints, with a margin of some errors over its two seeds:
    z at mu 0.01 = 3.887 +- 0.060
    z at mu 10 = 3.057 +- 0.040

Time: 42 s, as a processor counts, with compiled code on disk. Larger: N = 256, ten packings, a tenth of the rate
(recordings/friction).
"""

import sys

import packmech as pm

out, first = sys.argv[1] if sys.argv[1:] else ".", 0


def press(coefficient: float, seed: int) -> pm.Run:
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.7, seed=seed)
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3), pm.Friction(coefficient, 1.0, 0.1))
    return pm.jam(pm.Scene(start, effects), pressure=1e-4, strain="isotropic", method=pm.Press(rate=1e-3))


grid = {"coefficient": [0.01, 0.1, 1.0, 10.0], "seed": range(first, first + 2)}
found = pm.run_ensemble(press, grid, f"{out}/members/friction_coordination", seeding="seed", workers=0).of(grid)
z = pm.group_statistics(found, "coordination_number", ["coefficient"])
ax = pm.plot(z, log=False)
for count, words in ((3, "$d + 1$"), (4, "$2d$")):
    ax.axhline(count, color="#888888", linestyle=":")
    ax.text(0.011, count + 0.02, words)
ax.set(xscale="log", xlabel=r"friction coefficient $\mu$", ylabel="coordination number $z$ without rattlers")
ax.figure.savefig(f"{out}/friction_coordination.png", dpi=120)
print(f"z at mu 0.01 = {z.value_g[0]:.3f}")
print(f"z at mu 10 = {z.value_g[-1]:.3f}")
