"""What each effect of a time integration costs: arrays, bytes, and CPU time of a step, counted on the engine.

A thousand discs at packing fraction 0.95 are sheared steadily on one thread; pair lists are rebuilt on the way and
their time is counted. A scene pays for what is in it: no spins and tangential displacements without friction or bonds,
no observables where none are asked for.

    OMP_NUM_THREADS=1 python tests/benchmarks/bench_effect_costs.py recordings/dynamics
"""

from __future__ import annotations

import sys
import time
from dataclasses import astuple, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import Engine, build_engine
from packmech.dynamics.observables import CONTACTS, Ledger, new_ledger
from packmech.result import csv_text

PARTICLES, FRACTION = 1000, 0.95
RATE, DT, STEPS, REPEATS = 1e-3, 0.05, 1000, 4
WARM_STEPS = 2000
SPRING, DASHPOT = pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.3)
ROLLING = pm.RollingResistance(0.1, 0.1, 0.05)
FRICTION, DRAG = pm.Friction(0.5, 2.0 / 7.0, 0.15), pm.BackgroundDamping(0.01)
SHEAR = np.array([[0.0, 1.0], [0.0, 0.0]])


@dataclass(frozen=True)
class Cost:
    """What an engine holds and how long a step takes; `every` is 0 where no observables are kept."""

    effects: str
    every: int
    arrays: int
    bytes: int
    bytes_per_particle: float
    contacts: int
    microseconds: float
    nanoseconds: float
    ratio: float


@dataclass(frozen=True, eq=False)
class Start:
    """The state that every run starts from: one under steady shear, mapped back to a square box."""

    packing: pm.Packing
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64]


@cache
def start_of(particles: int) -> Start:
    """Return the common start of all runs of this many discs."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=FRACTION, seed=1)
    packing = pm.quench(pm.Scene(packing, (SPRING,)), force_tolerance=1e-2).packing
    packing = packing.replace(mass_n=packing.diameter_n**2 / np.mean(packing.diameter_n**2))
    rest = Start(packing, np.zeros((particles, 2)), np.zeros((particles, 1)))
    engine = engine_of(rest, (SPRING, DASHPOT, FRICTION))
    engine.advance(WARM_STEPS)
    back = np.linalg.inv(np.eye(2) + engine.gamma * SHEAR)
    spin = engine.spins()
    assert spin is not None
    return Start(packing.replace(position_nd=engine.positions() @ back.T), engine.velocities(), spin)


def engine_of(start: Start, effects: tuple[Any, ...]) -> Engine:
    """Return an engine at the start under these effects."""
    turns = any(isinstance(one, pm.Friction | pm.Bonds) for one in effects)
    return build_engine(
        pm.Scene(start.packing, effects),
        dt=DT,
        velocity_nd=start.velocity_nd,
        spin_nk=start.spin_nk if turns else None,
        profile=Ramp(0.0, RATE, 0.0, np.inf),
        direction_dd=SHEAR,
    )


def bonds_of(packing: pm.Packing) -> pm.Bonds:
    """Return bonds along every third contact."""
    bonds: pm.Bonds = pm.bond_contacts(
        packing,
        compression=pm.LinearSpring(),
        tension=pm.LinearSpring(),
        tangential_stiffness=0.4,
        damping=0.05,
        tangential_damping=0.03,
    )
    return bonds.select(np.arange(len(bonds)) % 3 == 0)


def arrays_of(record: Any) -> list[NDArray[Any]]:
    """Return the arrays that hold something in nested records.

    Examples
    --------
    >>> len(arrays_of((np.zeros(3), (np.zeros(0), None, np.ones(2)), 4.0)))
    2

    """
    if isinstance(record, np.ndarray):
        return [record] if record.size else []
    return [one for part in record for one in arrays_of(part)] if isinstance(record, tuple) else []


def cost_of(start: Start, name: str, effects: tuple[Any, ...], every: int) -> Cost:
    """Return what an engine under these effects holds, and the smallest CPU time of its steps."""
    best = np.inf
    for _ in range(REPEATS):
        engine = engine_of(start, effects)
        ledger: Ledger | None = None if not every else new_ledger(every, STEPS // every + 4)
        engine.advance(4, ledger)
        began = time.process_time()
        engine.advance(STEPS, ledger)
        best = min(best, (time.process_time() - began) / STEPS)
    held = arrays_of((engine.state, engine.space, engine.pairs, engine.track, ledger))
    size = sum(one.nbytes for one in held)
    contacts = int(engine.observe()[CONTACTS]) + sum(len(one) for one in effects if isinstance(one, pm.Bonds))
    particles = start.packing.particles
    return Cost(name, every, len(held), size, size / particles, contacts, best * 1e6, best / contacts * 1e9, np.nan)


def measure() -> list[Cost]:
    """Return the costs of all that is asked."""
    start, all_three = start_of(PARTICLES), (SPRING, DASHPOT, FRICTION)
    asked: list[tuple[str, tuple[Any, ...], int]] = [
        ("spring", (SPRING,), 0),
        ("spring, dashpot", (SPRING, DASHPOT), 0),
        ("spring, dashpot, friction", all_three, 0),
        ("spring, dashpot, friction, rolling resistance", (*all_three, ROLLING), 0),
        ("spring, dashpot, friction, background damping", (*all_three, DRAG), 0),
        ("spring, dashpot, friction, bonds", (*all_three, bonds_of(start.packing)), 0),
        ("spring, dashpot, friction", all_three, 10),
        ("spring, dashpot, friction", all_three, 1),
    ]
    rows: list[Cost] = []
    for name, effects, every in asked:
        one = cost_of(start, name, effects, every)
        rows.append(replace(one, ratio=one.nanoseconds / (rows[0] if rows else one).nanoseconds))
    return rows


if __name__ == "__main__":
    text = csv_text([field.name for field in fields(Cost)], map(astuple, measure()))
    Path(sys.argv[1], "effect_costs.csv").write_text(text)
    print(text)
