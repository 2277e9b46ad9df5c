"""Time step and integrator against G' and G'' under oscillatory shear, with bonds and without, means over repeats.

    python recordings/accuracy/shear_time_step.py

The scene is that of the reference package's stored run as far as forces go: 100 discs at packing fraction 1.5 with its
divergent repulsion and a friction of 0.01, sheared by 0.2 at 0.025 periods in tau. Without bonds contacts open, close
and slide all the time; with every contact bonded trajectories are smooth.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

STEPS = (0.4, 0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625)
STORAGE, LOSS, FREQUENCY = "G' (relative)", "G'' (relative)", 0.025
METHODS = {"velocity Verlet": pm.VelocityVerlet(), "semi-implicit Euler": pm.SemiImplicitEuler()}


@cache
def scene_of(kind: str, particles: int, repeat: int) -> pm.Scene:
    """Return a scene at rest; kind is "linked", "unlinked" or "smooth onset" (unlinked too)."""
    sizes, law = pm.Bidisperse(ratio=1.4), pm.DivergentRepulsion(1.0)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=1.5, seed=repeat)
    packing = pm.quench(pm.Scene(start, (pm.Repulsion(law=law),)), force_tolerance=1e-9).packing
    packing = packing.replace(mass_n=(packing.diameter_n / packing.reference_diameter) ** 2)
    tau = float(np.sqrt(packing.mass_n.mean()))
    damping = pm.ContactDamping(0.1 * tau, onset="smooth" if kind == "smooth onset" else "jump")
    # peculiar velocities halve in a period
    drag = pm.BackgroundDamping(float(np.log(2.0)) * FREQUENCY / tau)
    effects = (pm.Repulsion(law=law), damping, pm.Friction(0.01, 1.0, 0.1 * tau), drag)
    if kind == "linked":
        along = {"compression": law, "tension": pm.LinearSpring(1.0), "damping": 0.1 * tau}
        bonds = pm.bond_contacts(packing, tangential_stiffness=1.0, tangential_damping=0.1 * tau, **along)
        effects += (bonds,)
    return pm.Scene(packing, effects)


def moduli(kind: str, method: str, particles: int, step: float, repeat: int) -> tuple[float, float]:
    """Return G' and G'' of one repeat at a time step in units of tau; steps are coarse on purpose."""
    scene = scene_of(kind, particles, repeat)
    how = {"relative_frequency": FREQUENCY, "periods": 5.0, "samples_per_period": 100, "method": METHODS[method]}
    dt = step * float(np.sqrt(scene.packing.mass_n.mean()))
    found = pm.oscillatory_shear(scene, amplitude=0.2, dt=dt, check=False, **how)
    if not found.measured:
        raise pm.NotConverged(found)
    return found.moduli.storage, found.moduli.loss


@cache
def finest(kind: str, particles: int, step: float, repeats: int) -> np.ndarray:
    """Return the moduli of each repeat by velocity Verlet at the shortest time step."""
    return np.array([moduli(kind, "velocity Verlet", particles, step, one) for one in range(repeats)])


def trial(kind: str, method: str, particles: int, shortest: float, repeats: int, step: float) -> pm.Answer:
    """Return how far the means of G' and G'' are off, relative, with their error bars over repeats."""
    fine = finest(kind, particles, shortest, repeats)
    found = np.array([moduli(kind, method, particles, step, one) for one in range(repeats)])
    off = (found - fine) / np.abs(fine.mean(axis=0))
    bars = off.std(axis=0, ddof=1) / np.sqrt(repeats)
    work = dict(zip(("storage", "loss"), found.mean(axis=0).tolist(), strict=True))
    work |= dict(zip(("storage off error", "loss off error"), bars.tolist(), strict=True))
    return pm.Answer(dict(zip((STORAGE, LOSS), off.mean(axis=0).tolist(), strict=True)), work=work)


def main(*, particles: int = 100, linked: int = 12, unlinked: int = 48, out: Path = Path(__file__).parent) -> None:
    """Shear all scenes at all time steps; write table and figure."""
    kinds = [("linked", name, linked) for name in METHODS] + [("unlinked", name, unlinked) for name in METHODS]
    kinds.append(("smooth onset", "velocity Verlet", unlinked))
    table = pm.work_precision(
        {f"{kind}, {name}": partial(trial, kind, name, particles, STEPS[-1], count) for kind, name, count in kinds},
        STEPS[:-1],
        {STORAGE: 0.0, LOSS: 0.0},
        knob="time step / tau",
        title=f"Time step of oscillatory shear: {particles} discs, {linked} repeats with bonds, {unlinked} without",
        reference_is=f"velocity Verlet at {STEPS[-1]} tau, the same repeats",
        repeats=1,
    )
    (out / "shear_time_step.csv").write_text(table.to_csv())
    (out / "shear_time_step.md").write_text(table.to_markdown())
    table.save_figure(out / "shear_time_step.png")


if __name__ == "__main__":
    run(main)
