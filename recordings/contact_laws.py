"""Figure S1-3 of particleShear's documentation: force against overlap of the linear, divergent and Hertzian contact."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import packmech as pm
from packmech.dynamics.material import contact_stiffness, layer_force
from packmech.view.figures import COLORS, STYLE

YOUNG_MODULUS, RADIUS = 8000.0, 10.0


def draw(path: Path) -> None:
    """Write the figure for spheres of E = 8 kPa and R = 10 um."""
    stiffness, sigma = contact_stiffness(YOUNG_MODULUS), 2.0 * RADIUS
    overlap = np.linspace(0.0, sigma, 401)
    curves = {
        "linear (S1-5a)": [-pm.LinearSpring(stiffness).first(sigma - x, sigma) for x in overlap],
        "divergent (S1-5b)": [-pm.DivergentRepulsion(stiffness).first(sigma - x, sigma) for x in overlap],
        "Hertz, per height of a layer (S1-13)": [layer_force(x, YOUNG_MODULUS, RADIUS) for x in overlap],
        "plateau (slope 0.1 from 0.3 to 0.8)": [
            -pm.PlateauRepulsion(law=pm.DivergentRepulsion(stiffness)).first(sigma - x, sigma) for x in overlap
        ],
    }
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 4.0), layout="constrained")
        whole, small = figure.subplots(1, 2)
        for ax, most in ((whole, sigma), (small, 0.25 * sigma)):
            for color, (name, force) in zip(COLORS, curves.items(), strict=False):
                # 1e-6 N per m to N per m
                style = {"linestyle": "--"} if name.startswith("plateau") else {}
                ax.plot(overlap, np.array(force) * 1e-6, color=color, label=name, **style)
            ax.set(xlabel="overlap $\\Delta x$ (um)", ylabel="force per depth (N/m)", xlim=(0.0, most))
        whole.set_ylim(0.0, 0.4)
        small.set_ylim(0.0, 0.025)
        whole.legend(loc="upper left")
        figure.suptitle("Repulsion of two particles, E = 8 kPa, R = 10 um; right: small overlaps", fontsize=10)
        figure.savefig(path, dpi=150)


if __name__ == "__main__":
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else "recordings/contact_laws.png"))
