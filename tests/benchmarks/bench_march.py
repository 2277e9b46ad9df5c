# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What a step of sheared frictional discs costs: against loops written by hand, LAMMPS, the reference package, threads.

Packing fraction 0.95, friction 0.5, steady shear; pair lists are remade on the way and their time is counted. All
programs start from the same places, velocities and spins and take the same number of steps, one thread each (but for
the last table, which shows wall time).

Run with one thread: OMP_NUM_THREADS=1 python tests/benchmarks/bench_march.py [largest number of particles]
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any, NamedTuple

import hand_march
import numpy as np
from calibration import calibrate

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import CONTACTS
from packmech.minimize.program import space_order

RATE, DT = 1e-3, 0.05
SHEAR = np.array([[0.0, 1.0], [0.0, 0.0]])
LAW = hand_march.Numbers(1.0, 0.3, 0.5, 2.0 / 7.0, 0.15, 0.4, 0.05, 0.03)
SPRING = pm.Repulsion(law=pm.LinearSpring(LAW.stiffness))
DASHPOT = pm.ContactDamping(LAW.damping)
FRICTION = pm.Friction(LAW.friction, LAW.tangential, LAW.tangential_damping)
# the skin with which the loops written by hand are fastest
SKIN = 0.2
# the reference package at N = 150, s/step (its stress is recorded every step)
REFERENCE_SECONDS = 0.0585


class Start(NamedTuple):
    """Where everybody starts, rows sorted in space; velocities of the laboratory and peculiar ones."""

    position_nd: Any
    velocity_nd: Any
    peculiar_nd: Any
    spin_n: Any
    radius_n: Any
    mass_n: Any
    side: float


def make_start(n):
    """Return a sheared state of n discs, carried back to a square box."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(n, dimension=2, sizes=sizes, packing_fraction=0.95, seed=1)
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
    contacts = pm.find_contacts(packing)
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
    """Return name, effects, the pass written by hand, and bonds of each combination."""
    bonds = some_bonds(start)
    return (
        ("spring", (SPRING,), hand_march.spring_pass, None),
        ("spring, dashpot", (SPRING, DASHPOT), hand_march.dashpot_pass, None),
        ("spring, dashpot, friction", (SPRING, DASHPOT, FRICTION), hand_march.friction_pass, None),
        ("the same and bonds", (SPRING, DASHPOT, FRICTION, bonds), hand_march.friction_pass, bonds),
    )


def cpu_of(advance, steps, clock=time.process_time):
    """Return the seconds of a run."""
    began = clock()
    advance(steps)
    return clock() - began


def compare(start, steps, repeats=8):
    """Print ns a contact and step of every combination; return those with friction."""
    n = len(start.radius_n)
    whole = np.nan
    for name, effects, by_hand, bonds in combinations(start):
        best = [np.inf, np.inf]
        march = ours(start, effects)
        march.advance(3)
        contacts = march.observe()[CONTACTS] + (0 if bonds is None else len(bonds))
        hand = hand_march.HandMarch(start, LAW, by_hand, RATE, DT, SKIN, bonds)
        hand.advance(3)
        for _ in range(repeats):
            march, hand = ours(start, effects), hand_march.HandMarch(start, LAW, by_hand, RATE, DT, SKIN, bonds)
            march.advance(3)
            hand.advance(3)
            best[0] = min(best[0], cpu_of(march.advance, steps))
            best[1] = min(best[1], cpu_of(hand.advance, steps))
        apart = float(np.abs(march.positions() - hand.row[:, :2]).max())
        each = [one / steps / contacts * 1e9 for one in best]
        print(f"{n:7d}  {name:28s} {each[0]:8.1f} {each[1]:8.1f} {best[0] / best[1]:7.2f}    {apart:.0e}", flush=True)
        if name.endswith("friction"):
            whole = each[0]
    return whole


def main(largest=100_000):
    """Print the tables."""
    calibrate()
    print(f"other processes that run: {os.getloadavg()[0]:.1f}")
    print("ns a contact (or bond) and step     effects by type  by hand  ratio   positions apart at the end")
    starts = {n: make_start(n) for n in (150, 1_000, 10_000, 100_000) if n <= largest}
    steps = {150: 10_000, 1_000: 2_000, 10_000: 200, 100_000: 40}
    taken = {n: compare(start, steps[n]) for n, start in starts.items()}
    print("\nfriction: ns a contact and step     packmech  LAMMPS gran/hooke/history  ratio")
    try:
        import peer_lammps

        for n, start in starts.items():
            best = np.inf
            for skin in (0.2, 0.3, 0.4):
                seconds, contacts = peer_lammps.measure(start, LAW, RATE, DT, steps[n], skin)
                best = min(best, seconds / steps[n] / contacts * 1e9)
            print(f"{n:7d}  {'':26s} {taken[n]:8.1f} {best:10.1f} {taken[n] / best:20.2f}", flush=True)
    except ImportError as missing:
        print(f"not measured: {missing} (install the extra `bench`)")
    march = ours(starts[150], (SPRING, DASHPOT, FRICTION))
    march.advance(3)
    seconds = cpu_of(march.advance, 20_000) / 20_000
    print(
        f"\n150 particles: {seconds * 1e6:.1f} us a step, the reference package {REFERENCE_SECONDS / seconds:.0f} times"
    )
    print("\nfriction: wall ms a step, 1 thread, 2 threads, gained, same bits")
    for n, start in starts.items():
        if n >= 1_000:
            walls, ends = [np.inf, np.inf], [None, None]
            for _ in range(12):
                for t in (0, 1):
                    march = ours(start, (SPRING, DASHPOT, FRICTION), threads=t + 1)
                    march.advance(3)
                    walls[t] = min(walls[t], cpu_of(march.advance, steps[n], time.perf_counter))
                    ends[t] = march.state.body.copy()
            same = np.array_equal(*ends)
            one, two = (1e3 * wall / steps[n] for wall in walls)
            print(f"{n:7d}  {one:9.3f} {two:9.3f} {one / two:7.2f}   {same}", flush=True)


if __name__ == "__main__":
    main(*(int(float(word)) for word in sys.argv[1:]))
