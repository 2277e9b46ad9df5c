"""How do contacts and stiffness grow above jamming?

O'Hern, Silbert, Liu and Nagel, Phys. Rev. E 68, 011306 (2003); van Hecke, J. Phys.: Condens. Matter 22, 033101 (2010):
harmonic discs have z - 2d ~ P^(1/2) and G ~ P^(1/2), and a bulk modulus that stays finite. Packings are shear-
stabilized; pressures are high enough for N = 512 not to show, and low enough for a rough power law.

Prints, with a margin for other seeds, of which one more set was run:
    exponent of bulk modulus = 0.09 +- 0.02
    exponent of excess coordination = 0.55 +- 0.05
    exponent of shear modulus = 0.48 +- 0.08

Time: 24 s, as a processor counts, with compiled code on disk. Larger: recordings/scaling, where one law for N from 64
to 1024 gives .545(11) and .486(13).
"""

import sys

import numpy as np

import packmech as pm

out, first = sys.argv[1] if sys.argv[1:] else ".", 0


def jam(particles: int, pressure: float, seed: int) -> dict[str, float]:
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="free")
    moduli = pm.elastic_moduli(pm.Scene(run.packing, (pm.Repulsion(),)))
    excess = 2 * run.report["excess_contacts"] / (particles - run.report["rattlers"])
    return {"excess_coordination": excess, "bulk_modulus": moduli.bulk_modulus, "shear_modulus": moduli.shear_modulus}


grid = {"particles": 512, "pressure": list(np.geomspace(3e-4, 1e-2, 4)), "seed": range(first, first + 4)}
found, ax = pm.run_ensemble(jam, grid, f"{out}/members/pressure_scaling", seeding="seed", workers=0).of(grid), None
for name in ("bulk_modulus", "excess_coordination", "shear_modulus"):
    mean = pm.group_statistics(found, name, ["pressure"])
    fit = pm.fit_power_law(mean.by["pressure"], mean.value_g, mean.error_g)
    ax = pm.plot(mean, ax, log=True, label=f"{name.replace('_', ' ')}, exponent {fit.exponent:.2f}")
    print(f"exponent of {name.replace('_', ' ')} = {fit.exponent:.2f}")
ax.set(xlabel="pressure $P$ [energy scale/diameter$^2$]", ylabel="$z - z_{iso}$, moduli [energy scale/diameter$^2$]")
ax.figure.savefig(f"{out}/pressure_scaling.png", dpi=120)
