"""Figure S1-3 of particleShear's documentation: force against overlap of the linear, divergent and Hertzian contact."""

import math
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import packmech as pm

YOUNG_MODULUS, RADIUS = 8000.0, 10.0


def hertz_force(overlap: float, young_modulus: float, radius: float, poisson_ratio: float = 0.0) -> float:
    """Return the force of two equal spheres, sqrt(2) E / (3 (1 - nu^2)) R^(1/2) dx^(3/2) [1e-12 N] (S1-10)."""
    modulus = young_modulus / (1.0 - poisson_ratio**2)
    return math.sqrt(2.0 * radius * overlap) * overlap * modulus / 3.0


def layer_force(overlap: float, young_modulus: float, radius: float) -> float:
    """Return the force of a sphere's contacts on one side per height of a layer [1e-6 N per m] (S1-12, S1-13).

    Z/4 times Hertz's force, Z = 6 + 7.9 (1 - 0.64)^(1/2) contacts of soft spheres that fill space (S1-11), over the
    height 2 R / sqrt(3) of a close-packed layer: about 1.1 E R^(-1/2) dx^(3/2), in space what k dx is in a plane.
    """
    contacts = 6.0 + 7.9 * math.sqrt(1.0 - 0.64)
    return hertz_force(overlap, young_modulus, radius) * contacts / 4.0 * math.sqrt(3.0) / (2.0 * radius)


def draw(path: Path) -> None:
    """Write the figure for spheres of E = 8 kPa and R = 10 um."""
    stiffness, sigma = pm.material_constants(young_modulus=YOUNG_MODULUS).stiffness, 2.0 * RADIUS
    overlap = np.linspace(0.0, sigma, 401)
    laws = {
        "linear (S1-5a)": pm.LinearSpring(stiffness),
        "divergent (S1-5b)": pm.DivergentRepulsion(stiffness),
        "plateau (slope 0.1 from 0.3 to 0.8)": pm.PlateauRepulsion(law=pm.DivergentRepulsion(stiffness)),
    }
    equal = pm.Partners(sigma, 0.25 * sigma)
    curves = {name: [-pm.Repulsion(law).pair_first(sigma - x, equal) for x in overlap] for name, law in laws.items()}
    curves["Hertz, per height of a layer (S1-13)"] = [layer_force(x, YOUNG_MODULUS, RADIUS) for x in overlap]
    figure, (whole, small) = plt.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
    for ax, largest, highest in ((whole, sigma, 0.4), (small, 0.25 * sigma, 0.025)):
        for name, force in curves.items():
            # 1e-6 N per m to N per m
            ax.plot(overlap, np.array(force) * 1e-6, "--" if name.startswith("plateau") else "-", label=name)
        ax.set(xlabel="overlap $\\Delta x$ (um)", ylabel="force per depth (N/m)")
        ax.set(xlim=(0.0, largest), ylim=(0.0, highest))
    whole.legend(loc="upper left")
    figure.suptitle("Repulsion of two particles, E = 8 kPa, R = 10 um; right: small overlaps", fontsize=10)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else "recordings/contact_laws.png"))
