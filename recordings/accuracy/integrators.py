"""Time step and integrator against positions, energy and G', where contacts stay and where they come and go.

    python recordings/accuracy/integrators.py

Thirty discs are set moving at random and sheared for one period. Four scenes have the same packings and differ in what
acts: bonds alone; contacts with the linear dashpot, whose force jumps where a contact closes; with the dashpot that
sets in smoothly; and the latter with friction. Errors are geometric means over repeats: what a typical run is off by.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

LAW, STEPS, REFERENCE = pm.LinearSpring(), (0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625), 0.2 / 1024
QUANTITIES = ("positions (diameters)", "energy (of the largest)", "G' (relative)")
METHODS = {"velocity Verlet": pm.VelocityVerlet(), "semi-implicit Euler": pm.SemiImplicitEuler()}


@cache
def packing_of(repeat: int) -> pm.Packing:
    """Return a packing at its energy minimum, with mass 1 for a small disc."""
    start = pm.random_packing(30, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.88, seed=repeat)
    start = start.replace(mass_n=(start.diameter_n / start.reference_diameter) ** 2)
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=LAW),)), force_tolerance=1e-10).packing


def scene_of(kind: str, repeat: int) -> pm.Scene:
    """Return a scene: "bonds", "jump", "smooth" or "friction"."""
    packing, drag = packing_of(repeat), pm.BackgroundDamping(0.02)
    if kind == "bonds":
        given = {"tangential_stiffness": 0.5, "damping": 0.3, "tangential_damping": 0.15}
        return pm.Scene(packing, (pm.bond_contacts(packing, compression=LAW, tension=LAW, **given), drag))
    dashpot = pm.ContactDamping(0.3, onset="jump" if kind == "jump" else "smooth")
    friction = (pm.Friction(0.3, 0.5, 0.0),) if kind == "friction" else ()
    return pm.Scene(packing, (pm.Repulsion(law=LAW), dashpot, *friction, drag))


@cache
def measure(kind: str, method: str, step: float, repeat: int) -> tuple[np.ndarray, float, float]:
    """Return (N, d) positions and energy at the end of a period, and its G'; steps are coarse on purpose."""
    velocity_nd = 0.05 * np.random.default_rng(repeat).normal(size=(30, 2))
    how = {"amplitude": 0.05, "frequency": 0.05, "periods": 1.0, "samples_per_period": 20, "dt": step, "check": False}
    how |= {"method": METHODS[method], "velocity_nd": velocity_nd - velocity_nd.mean(axis=0)}
    found = pm.oscillatory_shear(scene_of(kind, repeat), **how)
    if not found.measured:
        raise pm.NotConverged(found)
    energy_t = found.potential_t + found.tangential_t + found.kinetic_t + found.rotational_t
    return found.packing.position_nd, float(energy_t[-1] / energy_t.max()), found.moduli.storage


def trial(kind: str, method: str, repeats: int, reference: float, step: float) -> dict[str, float]:
    """Return the errors against the same scene at a much shorter time step."""
    off = []
    for repeat in range(repeats):
        found, true = measure(kind, method, step, repeat), measure(kind, "velocity Verlet", reference, repeat)
        apart = float(np.linalg.norm(found[0] - true[0], axis=1).max())
        off.append((apart, abs(found[1] - true[1]), abs(found[2] / true[2] - 1.0)))
    means = np.exp(np.log(np.maximum(off, 1e-300)).mean(axis=0))
    return dict(zip(QUANTITIES, means.tolist(), strict=True))


def main(*, repeats: int = 16, reference: float = REFERENCE, out: Path = Path(__file__).parent) -> None:
    """Shear all scenes at all time steps; write table and figure, and print orders of convergence."""
    kinds = [(kind, name) for kind in ("bonds", "jump", "smooth") for name in METHODS]
    table = pm.work_precision(
        {f"{k}, {m}": partial(trial, k, m, repeats, reference) for k, m in [*kinds, ("friction", "velocity Verlet")]},
        STEPS,
        dict.fromkeys(QUANTITIES, 0.0),
        knob="time step / sqrt(m/k)",
        title="Time step and integrator: 30 discs from random velocities through one period of shear",
        reference_is=f"velocity Verlet at {reference:g}, scene by scene; typical errors of {repeats} repeats",
        repeats=1,
    )
    for method in table.methods:
        print(method, *(f"{name}: order {table.order(method, quantity=name):.2f}" for name in QUANTITIES), sep=", ")
    (out / "integrators.csv").write_text(table.to_csv())
    (out / "integrators.md").write_text(table.to_markdown())
    table.save_figure(out / "integrators.png")


if __name__ == "__main__":
    run(main)
