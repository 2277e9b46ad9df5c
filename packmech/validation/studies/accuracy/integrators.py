"""Time step and integrator against positions, energy and G', where contacts stay and where they come and go.

Thirty discs are set moving at random and sheared for one period. Four scenes have the same packings and differ in what
acts: bonds alone (nothing opens, closes or slides); contacts with the linear dashpot, whose force jumps where a contact
closes; contacts with the dashpot that sets in smoothly; and the latter with friction, whose springs reach the Coulomb
limit. Errors are against the same scene at a much shorter time step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.result import markdown_table
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

PARTICLES, FRACTION, REPEATS = 30, 0.88, 16
LAW = pm.LinearSpring()
DASHPOT, DRAG = 0.3, 0.02
FRICTION, TANGENTIAL = 0.3, 0.5
SPEED = 0.05
AMPLITUDE, FREQUENCY = 0.05, 0.05
# a sample is a unit of time, so that these time steps divide it
SAMPLES = 20
STEPS = (0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625)
REFERENCE = 0.2 / 1024
POSITIONS, ENERGY, STORAGE = "positions (diameters)", "energy (of the largest)", "G' (relative)"
QUANTITIES = (POSITIONS, ENERGY, STORAGE)
State = tuple[NDArray[np.float64], float, float]


@cache
def packing_of(repeat: int) -> pm.Packing:
    """Return a packing at its energy minimum, with mass 1 for a small disc."""
    start = pm.random_packing(
        PARTICLES, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=FRACTION, seed=repeat
    )
    start = start.replace(mass_n=(start.diameter_n / start.reference_diameter) ** 2)
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=LAW),)), force_tolerance=1e-10).packing


def scene_of(kind: str, repeat: int) -> pm.Scene:
    """Return a scene: "bonds", "jump", "smooth" or "friction"."""
    packing, drag = packing_of(repeat), pm.BackgroundDamping(DRAG)
    if kind == "bonds":
        bonds = pm.bond_contacts(
            packing,
            compression=LAW,
            tension=LAW,
            tangential_stiffness=TANGENTIAL,
            damping=DASHPOT,
            tangential_damping=0.5 * DASHPOT,
        )
        return pm.Scene(packing, (bonds, drag))
    dashpot = pm.ContactDamping(DASHPOT, onset="jump" if kind == "jump" else "smooth")
    friction = (pm.Friction(FRICTION, TANGENTIAL, 0.0),) if kind == "friction" else ()
    return pm.Scene(packing, (pm.Repulsion(law=LAW), dashpot, *friction, drag))


def measure(kind: str, method: object, step: float, repeat: int) -> State:
    """Return (N, d) positions and energy at the end of a period, and its G'."""
    velocity = SPEED * np.random.default_rng(repeat).normal(size=(PARTICLES, 2))
    run = pm.oscillatory_shear(
        scene_of(kind, repeat),
        amplitude=AMPLITUDE,
        frequency=FREQUENCY,
        periods=1.0,
        samples_per_period=SAMPLES,
        dt=step,
        method=method,
        velocity_nd=velocity - velocity.mean(axis=0),
        # steps are coarse on purpose
        check=False,
    )
    if not run.measured:
        raise pm.NotConverged(run)
    assert run.moduli is not None
    energy_t = run.potential_t + run.tangential_t + run.kinetic_t + run.rotational_t
    return run.packing.position_nd, float(energy_t[-1] / energy_t.max()), run.moduli.storage


@cache
def reference(kind: str, repeat: int) -> State:
    """Return what a much shorter time step gives."""
    return measure(kind, pm.VelocityVerlet(), REFERENCE, repeat)


def trial(kind: str, method: object, step: float) -> Answer:
    """Return the errors, each the geometric mean over repeats: what a typical run is off by."""
    off = []
    for repeat in range(REPEATS):
        found, true = measure(kind, method, step, repeat), reference(kind, repeat)
        apart = float(np.linalg.norm(found[0] - true[0], axis=1).max())
        off.append((apart, abs(found[1] - true[1]), abs(found[2] / true[2] - 1.0)))
    means = np.exp(np.log(np.maximum(off, 1e-300)).mean(axis=0))
    return Answer(dict(zip(QUANTITIES, means.tolist(), strict=True)))


METHODS = {
    "bonds, velocity Verlet": ("bonds", pm.VelocityVerlet()),
    "bonds, semi-implicit Euler": ("bonds", pm.SemiImplicitEuler()),
    "contacts, dashpot jumps, velocity Verlet": ("jump", pm.VelocityVerlet()),
    "contacts, dashpot jumps, semi-implicit Euler": ("jump", pm.SemiImplicitEuler()),
    "contacts, smooth onset, velocity Verlet": ("smooth", pm.VelocityVerlet()),
    "contacts, smooth onset, semi-implicit Euler": ("smooth", pm.SemiImplicitEuler()),
    "smooth onset and friction, velocity Verlet": ("friction", pm.VelocityVerlet()),
}


def run(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {name: partial(trial, kind, method) for name, (kind, method) in METHODS.items()},
        STEPS,
        dict.fromkeys(QUANTITIES, 0.0),
        knob="time step / sqrt(m/k)",
        title=f"Time step and integrator: {PARTICLES} discs from random velocities through one period of shear",
        reference_is=f"velocity Verlet at {STEPS[0]:g}/{STEPS[0] / REFERENCE:.0f}, scene by scene; "
        f"typical errors of {REPEATS} repeats",
        repeats=1,
        progress=progress,
    )
    return table, describe(table)


def describe(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it."""
    lines = [
        f"{PARTICLES} discs at packing fraction {FRACTION} (linear spring, drag {DRAG}), set moving at random and",
        f"sheared by {AMPLITUDE} sin({FREQUENCY} 2 pi t) for one period. Order of convergence, fitted to the errors:",
        "",
    ]
    rows = []
    for method in table.methods:
        orders = (f"{table.order(method, quantity=name):.2f}" for name in QUANTITIES)
        rows.append((method, *orders, f"{table.of(method)[-1].errors[POSITIONS]:.1e}"))
    headings = ("scene, method", *QUANTITIES, f"largest error in positions at {STEPS[-1]:g}")
    lines.append(markdown_table(headings, rows))
    verlet = {name: table.order(name, quantity=POSITIONS) for name in table.methods if "Verlet" in name}
    second = [name for name, order in verlet.items() if order > 1.8]
    first = [name for name, order in verlet.items() if order < 1.3]
    between = {name: order for name, order in verlet.items() if name not in (*second, *first)}
    lines += [
        f"Velocity Verlet is of second order in positions with {_listed(second)}; of first with {_listed(first)}.",
        "A contact that closes between two steps brings a dashpot that jumps in at once, wherever in the step that",
        "was: an error of the order of the step at each such event, whatever the method. The smooth onset has no jump.",
    ]
    if between:
        lines.append(
            f"In between, of order {', '.join(f'{order:.2f}' for order in between.values())}: "
            f"{_listed(list(between))}, whose springs reach the Coulomb limit and leave it."
        )
    return "\n".join(lines)


def _listed(names: list[str]) -> str:
    words = [name.rpartition(",")[0] for name in names]
    return " and with ".join(words) if words else "none of the scenes"
