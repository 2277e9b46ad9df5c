"""Hard cases of collisions in time: at the cap of a law, with dashpots, grazing, between walls, at one place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from packmech.box import Box
from packmech.dynamics.simulate import simulate
from packmech.effects import DivergentRepulsion, LinearSpring, Repulsion, Walls
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.validation.hard_cases.case import HardCase
from packmech.validation.hard_cases.shearing import STILL, bonds_of, energies, frictional_scene, pair_of


def _crushed() -> float:
    """Relative error of the speed at which two discs part that coincided, under the divergent law up to its cap."""
    law = DivergentRepulsion()
    run = simulate(Scene(pair_of(0.0), (Repulsion(law=law),)), duration=0.6, dt=1e-5, mass_n=[1.0, 1.0])
    parting = float(np.linalg.norm(run.velocity_nd[1] - run.velocity_nd[0]))
    return abs(parting / math.sqrt(4.0 * law.energy(0.0, 1.0)) - 1.0)


def _crossed() -> float:
    """Relative change of the speed of two discs that are thrown through each other, over the cap at their centers."""
    law = DivergentRepulsion()
    speed = math.sqrt(1.3 * law.energy(0.0, 1.0))
    run = simulate(
        Scene(pair_of(1.1, 1e-9), (Repulsion(law=law),)),
        duration=1.0,
        dt=1e-5,
        mass_n=[1.0, 1.0],
        velocity_nd=[[speed, 0.0], [-speed, 0.0]],
    )
    through = run.packing.position_nd[0, 0] - run.packing.position_nd[1, 0] > 1.0
    return abs(float(run.velocity_nd[0, 0]) / speed - 1.0) if through else math.inf


def _head_on() -> float:
    """Error of the restitution of a head-on collision against exp(-pi b / sqrt(w^2 - b^2)), the linear dashpot's."""
    stiffness, damping, speed = 2.0, 0.3, 0.1
    run = simulate(
        frictional_scene(pair_of(1.05), stiffness=stiffness, damping=damping),
        duration=8.0,
        dt=1e-4,
        mass_n=[1.0, 1.0],
        velocity_nd=[[speed, 0.0], [-speed, 0.0]],
        applied_strain=STILL,
    )
    # the reduced mass is 1/2: w^2 = 2 k, b = c
    exact = math.exp(-math.pi * damping / math.sqrt(2.0 * stiffness - damping**2))
    return abs(float(run.velocity_nd[1, 0]) / speed - exact)


def _grazing() -> float:
    """Relative error of the push that two fast discs give each other as they graze, to the integral along a line."""
    aside, speed = 0.999, 10.0
    run = simulate(
        frictional_scene(pair_of(-1.0, aside), friction=0.0),
        duration=0.2,
        dt=1e-5,
        mass_n=[1.0, 1.0],
        velocity_nd=[[-0.5 * speed, 0.0], [0.5 * speed, 0.0]],
        applied_strain=STILL,
    )
    half = math.sqrt(1.0 - aside**2)
    # integral of (1 - r) b/r dx over the overlap, over the speed
    push = (2.0 * aside * math.asinh(half / aside) - 2.0 * aside * half) / speed
    return abs(float(run.velocity_nd[1, 1]) / push - 1.0)


def _rubbed() -> float:
    """Change of the angular momentum of two spinning discs that graze and rub, over the sum of its parts."""
    scene = frictional_scene(pair_of(-1.0, 0.97), friction=0.8, across=5.0, damping=0.2, damping_across=0.3)
    velocity = np.array([[-0.5, 0.0], [0.5, 0.0]])
    run: Any = simulate(
        scene, duration=3.0, dt=5e-3, velocity_nd=velocity, spin_nk=[[3.0], [1.0]], applied_strain=STILL, trace_every=10
    )
    angular = run.trace.angular_momentum_tk
    if not run.trace.sliding_t.any() or abs(run.spin_nk[0, 0] - 3.0) < 1e-2:
        return math.inf
    return float(np.abs(angular - angular[0]).max() / (5.0 * 2.0 * 0.5 + 0.125 * 4.0))


def _squeezed() -> float:
    """Largest error, over the amplitude, of a disc between two walls nearer than its diameter, for 20 periods."""
    # each wall pushes with 4 k (r - distance): w^2 = 8 k/m
    stiffness, gap, aside, periods = 1.0, 0.8, 0.05, 20
    omega = math.sqrt(8.0 * stiffness)
    walls = Walls(axis=1, low=5.0, high=5.0 + gap, law=LinearSpring(stiffness))
    packing = Packing(np.array([[5.0, 5.0 + 0.5 * gap + aside]]), np.array([0.5]), Box.cubic(12.0, 2))
    run: Any = simulate(
        Scene(packing, (walls,)),
        duration=2.0 * math.pi * periods / omega,
        dt=0.01 / omega,
        mass_n=[1.0],
        trace_every=100,
        trace_positions=True,
    )
    exact = 5.0 + 0.5 * gap + aside * np.cos(omega * run.trace.time_t)
    return float(np.abs(run.trace.position_tnd[:, 0, 1] - exact).max() / aside)


def _coincident() -> float:
    """How far the energy of three discs of one center rises with friction and spins, over what it was."""
    packing = Packing(np.full((3, 2), 5.0), np.full(3, 0.5), Box.cubic(12.0, 2))
    run = simulate(
        frictional_scene(packing), steps=100, spin_nk=[[0.3], [-0.1], [0.2]], applied_strain=STILL, trace_every=1
    )
    position = run.packing.position_nd
    apart = min(float(np.linalg.norm(position[i] - position[j])) for i, j in ((0, 1), (0, 2), (1, 2)))
    total = energies(run)
    return float(total.max() / total[0] - 1.0) if apart > 0.9 and run.momentum_error < 1e-13 else math.inf


def _coincident_bond() -> float:
    """Whether a bond without length, which has no direction, is simulated and not refused by its number."""
    scene = frictional_scene(pair_of(0.0), bonds=bonds_of((0, 1, 0, 1.0)))
    try:
        simulate(scene, steps=1, dt=0.01, applied_strain=STILL)
    except ValueError as refusal:
        return float("bond 0" not in str(refusal))
    return 1.0


CASES = (
    HardCase(
        "full compression at the cap",
        "the divergent law's force has no direction and a kink where two discs coincide",
        "relative error of the speed of parting to that of the law's energy at no distance",
        1e-4,
        "second order but for the kink at the cap: k dt^2 cap / m = 1e-7 a step, over the 50 steps within it",
        _crushed,
    ),
    HardCase(
        "thrown through each other over the cap",
        "the force turns around within one step at the center",
        "relative change of the speed",
        6e-3,
        "half the work of the largest force over one step, 1000 x 6.7 x 1e-5 / 2, over the kinetic energy of 9",
        _crossed,
    ),
    HardCase(
        "head-on collision with a dashpot",
        "the dashpot's force jumps as the contact opens and closes",
        "error of the coefficient of restitution",
        6e-5,
        "first order: both jumps of c v within a step change the speed by 2 c dt / m at most",
        _head_on,
    ),
    HardCase(
        "grazing collision",
        "a contact lasts a few steps and overlaps by a thousandth",
        "relative error of the momentum exchanged to the impulse along a straight line",
        1e-3,
        "turning aside on the way changes the overlap by 2 k (1 - b^2) / v^2 = 4e-5 of itself; 900 steps of contact",
        _grazing,
    ),
    HardCase(
        "grazing and rubbing with spins",
        "torques with other arms than slips create angular momentum",
        "change of the angular momentum over the sum of its parts",
        1e-13,
        "arms add up to the distance, so that only sums round: 600 steps of 1e-16",
        _rubbed,
    ),
    HardCase(
        "pressed by two walls",
        "both walls push at once, each of them beyond the center of the other's reach",
        "largest error over the amplitude, 20 periods",
        6e-4,
        "velocity Verlet's frequency is (w dt)^2 / 24 too high: 126 rad at w dt = 0.01",
        _squeezed,
    ),
    HardCase(
        "coincident centers with friction",
        "no normal, no arms, no slip: NaN, or momentum from nowhere",
        "relative rise of the energy (infinite if they stay together or momentum is not kept)",
        1e-3,
        "the method swings by (w dt)^2 / 4 of the energy in motion",
        _coincident,
    ),
    HardCase(
        "bond without length",
        "it pushes nowhere and would stay for ever at the top of its energy",
        "one if it is simulated all the same",
        0.0,
        "a clear refusal",
        _coincident_bond,
    ),
)
