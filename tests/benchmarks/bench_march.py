# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What a step of sheared frictional discs costs, by effects and by threads.

Packing fraction 0.95, friction 0.5, steady shear; pair lists are remade on the way and their time is counted. One
thread, but for the last table, which shows wall time. Beside loops written by hand and LAMMPS: tests/benchmarks/peers.

Run with one thread: OMP_NUM_THREADS=1 python tests/benchmarks/bench_march.py [largest number of particles]
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any, NamedTuple

import numpy as np
from calibration import calibrate

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import CONTACTS
from packmech.minimize.program import space_order


class Numbers(NamedTuple):
    """Stiffness, dashpot, Coulomb's coefficient, tangential stiffness and dashpot, and the same three of bonds."""

    stiffness: float
    damping: float
    friction: float
    tangential: float
    tangential_damping: float
    bond_tangential: float = 0.0
    bond_damping: float = 0.0
    bond_tangential_damping: float = 0.0


RATE, DT = 1e-3, 0.05
SHEAR = np.array([[0.0, 1.0], [0.0, 0.0]])
LAW = Numbers(1.0, 0.3, 0.5, 2.0 / 7.0, 0.15, 0.4, 0.05, 0.03)
SPRING = pm.Repulsion(law=pm.LinearSpring(LAW.stiffness))
DASHPOT = pm.ContactDamping(LAW.damping)
STEPS = {150: 10_000, 1_000: 2_000, 10_000: 200, 100_000: 40}
FRICTION = pm.Friction(LAW.friction, LAW.tangential, LAW.tangential_damping)


class Start(NamedTuple):
    """Where everybody starts, rows sorted in space; velocities of the laboratory and peculiar ones."""

    position_nd: Any
    velocity_nd: Any
    peculiar_nd: Any
    spin_n: Any
    radius_n: Any
    mass_n: Any
    side: float


def make_start(n, seed=1):
    """Return a sheared state of n discs, carried back to a square box."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(n, dimension=2, sizes=sizes, packing_fraction=0.95, seed=seed)
    packing = pm.quench(pm.Scene(packing, (SPRING,)), force_tolerance=1e-2).packing
    order = space_order(packing)
    packing = packing.replace(position_nd=packing.position_nd[order], radius_n=packing.radius_n[order])
    mass = packing.diameter_n**2 / np.mean(packing.diameter_n**2)
    side = float(packing.box.lattice_dd[0, 0])
    still = np.zeros((n, 2))
    start = Start(packing.position_nd, still, still, np.zeros(n), packing.radius_n, mass, side)
    march = ours(start, (SPRING, DASHPOT, FRICTION))
    march.advance(2000 if n < 5e4 else 400)
    place = march.positions() @ np.linalg.inv(np.eye(2) + march.gamma * SHEAR).T
    place -= np.floor(place / side) * side
    peculiar = march.velocities()
    lab = peculiar + RATE * place[:, 1:] * np.array([1.0, 0.0])
    return Start(place, lab, peculiar, march.spins()[:, 0], packing.radius_n, mass, side)


def ours(start, effects, threads=1):
    """Return the march of a start under these effects."""
    packing = pm.Packing(start.position_nd, start.radius_n, pm.Box.cubic(start.side, 2), mass_n=start.mass_n)
    turns = any(isinstance(one, pm.Friction | pm.Bonds) for one in effects)
    return build_engine(
        pm.Scene(packing, effects),
        dt=DT,
        velocity_nd=start.peculiar_nd,
        spin_nk=start.spin_n[:, None] if turns else None,
        profile=Ramp(0.0, RATE, 0.0, np.inf),
        direction_dd=SHEAR,
        threads=threads,
    )


def some_bonds(start):
    """Return bonds along every third contact."""
    packing = pm.Packing(start.position_nd, start.radius_n, pm.Box.cubic(start.side, 2))
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    pick = np.arange(0, len(contacts), 3)
    return pm.Bonds(
        contacts.i_c[pick],
        contacts.j_c[pick],
        contacts.image_cd[pick],
        contacts.contact_distance_c[pick],
        compression=pm.LinearSpring(LAW.stiffness),
        tension=pm.LinearSpring(LAW.stiffness),
        tangential_stiffness=LAW.bond_tangential,
        damping=LAW.bond_damping,
        tangential_damping=LAW.bond_tangential_damping,
    )


def combinations(start):
    """Return name, effects and bonds of each combination."""
    bonds = some_bonds(start)
    return (
        ("spring", (SPRING,), None),
        ("spring, dashpot", (SPRING, DASHPOT), None),
        ("spring, dashpot, friction", (SPRING, DASHPOT, FRICTION), None),
        ("the same and bonds", (SPRING, DASHPOT, FRICTION, bonds), bonds),
    )


def cpu_of(advance, steps, clock=time.process_time):
    """Return the seconds of a run."""
    began = clock()
    advance(steps)
    return clock() - began


def costs(start, steps, repeats=8):
    """Print ns a contact and step of every combination."""
    n = len(start.radius_n)
    for name, effects, bonds in combinations(start):
        best = np.inf
        for _ in range(repeats):
            march = ours(start, effects)
            march.advance(3)
            best = min(best, cpu_of(march.advance, steps))
        contacts = march.observe()[CONTACTS] + (0 if bonds is None else len(bonds))
        print(f"{n:7d}  {name:28s} {best / steps / contacts * 1e9:8.1f}", flush=True)


def main(largest=100_000):
    """Print the tables."""
    calibrate()
    print(f"other processes that run: {os.getloadavg()[0]:.1f}")
    print("ns a contact (or bond) and step")
    starts = {n: make_start(n) for n in STEPS if n <= largest}
    for n, start in starts.items():
        costs(start, STEPS[n])
    print("\nfriction: wall ms a step, 1 thread, 2 threads, gained, same bits")
    for n, start in starts.items():
        if n >= 1_000:
            walls, ends = [np.inf, np.inf], [None, None]
            for _ in range(12):
                for t in (0, 1):
                    march = ours(start, (SPRING, DASHPOT, FRICTION), threads=t + 1)
                    march.advance(3)
                    walls[t] = min(walls[t], cpu_of(march.advance, STEPS[n], time.perf_counter))
                    ends[t] = march.state.body.copy()
            same = np.array_equal(*ends)
            one, two = (1e3 * wall / STEPS[n] for wall in walls)
            print(f"{n:7d}  {one:9.3f} {two:9.3f} {one / two:7.2f}   {same}", flush=True)


if __name__ == "__main__":
    main(*(int(float(word)) for word in sys.argv[1:]))
