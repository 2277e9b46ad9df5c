"""Hard cases of time-stepped dynamics: stiff springs, far shear, resonance, limits of stability, odd collisions."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.dynamics.deformation import OscillatoryStrain, SteadyStrain
from packmech.dynamics.simulate import simulate
from packmech.dynamics.simulation import Simulation
from packmech.effects import BackgroundDamping, Bonds, ContactDamping, Friction, LinearSpring, Repulsion
from packmech.generate import Bidisperse, Mixture, random_packing
from packmech.measure import energy
from packmech.minimize.quench import quench
from packmech.packing import Packing
from packmech.result import Outcome
from packmech.scene import Scene
from packmech.validation.hard_cases.case import HardCase

# a box at rest that could deform: all of these scenes are compiled together
STILL = SteadyStrain(0.0)


def bonds_of(*ends: tuple[int, int, int, float], **numbers: Any) -> Bonds:
    """Return bonds of (i, j, image along x, rest length)."""
    i, j, image, rest = (np.array(column) for column in zip(*ends, strict=True)) if ends else [np.zeros(0, int)] * 4
    return Bonds(i, j, np.stack([image, 0 * image], axis=1).astype(int), rest.astype(float), **numbers)


def frictional_scene(
    packing: Packing,
    *,
    stiffness: float = 1.0,
    damping: float = 0.0,
    friction: float = 0.5,
    across: float = 0.4,
    damping_across: float = 0.0,
    bonds: Bonds | None = None,
) -> Scene:
    """Return a scene with every effect of the frictional model; a strength of zero is as good as none."""
    return Scene(
        packing,
        (
            Repulsion(law=LinearSpring(stiffness)),
            ContactDamping(damping),
            Friction(friction, across, damping_across),
            bonds_of() if bonds is None else bonds,
        ),
    )


def pair_of(distance: float, across: float = 0.0, radius: float = 0.5) -> Packing:
    """Return two discs, the second so far from the first along x and y."""
    position_nd = np.array([[5.0, 5.0], [5.0 + distance, 5.0 + across]])
    return Packing(position_nd, np.full(2, radius), Box.cubic(12.0, 2))


@cache
def dense_packing(particles: int = 40, sizes: Any = Bidisperse(1.4)) -> Packing:  # noqa: B008 - a frozen record
    """Return a dense packing at rest without friction."""
    start = random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.95, seed=1)
    return quench(Scene(start, (Repulsion(law=LinearSpring()),)), force_tolerance=1e-10).packing


def energies(run: Simulation) -> NDArray[np.float64]:
    """Return the energies that a run kept."""
    assert run.trace is not None
    return np.asarray(run.trace.energy_t + run.trace.kinetic_t)  # type: ignore[attr-defined]


def _stiff_bond() -> float:
    """Energy error of an undamped bonded pair whose tangential spring is 1e4 times as stiff as its normal one."""
    scene = frictional_scene(pair_of(1.05), bonds=bonds_of((0, 1, 0, 1.0), tangential_stiffness=1e4))
    moving: dict[str, Any] = {"velocity_nd": [[0.01, -0.02], [0.0, 0.03]], "spin_nk": [[0.02], [-0.05]]}
    total = energies(simulate(scene, steps=50_000, applied_strain=STILL, trace_every=97, **moving))
    return float(np.abs(total / total[0] - 1.0).max())


def _stiff_friction() -> float:
    """How far tangential forces, by springs 1e4 times as stiff as contacts, go beyond Coulomb's cap, over the cap."""
    scene = frictional_scene(dense_packing(), across=1e4, damping=0.3, damping_across=1.0)
    run = simulate(scene, steps=3000, applied_strain=SteadyStrain(0.05), trace_every=500, trace_positions=True)
    trace: Any = run.trace
    beyond, slid = -math.inf, 0
    for t, one in enumerate(trace.touching_t[1:], start=1):
        branch = trace.position_tnd[t][one.j_c] - trace.position_tnd[t][one.i_c]
        branch += one.image_cd @ trace.lattice_tdd[t].T
        normal = branch / np.linalg.norm(branch, axis=1)[:, None]
        along = (one.force_cd * normal).sum(axis=1)
        across = np.linalg.norm(one.force_cd - along[:, None] * normal, axis=1)
        beyond = max(beyond, float((across / (0.5 * one.normal_c)).max()) - 1.0)
        slid += int(one.sliding_c.sum())
    return max(beyond, 0.0) if slid else math.inf


def _there_and_back(scene: Scene, rate: float, dt: float) -> tuple[Simulation, Simulation]:
    steps = round(100.0 / (rate * dt))
    there = simulate(scene, steps=steps, dt=dt, applied_strain=SteadyStrain(rate), trace_every=steps)
    turned = scene.replace(packing=there.packing)
    velocity: dict[str, Any] = {"velocity_nd": there.velocity_nd, "spin_nk": there.spin_nk}
    return there, simulate(
        turned, steps=steps, dt=dt, applied_strain=SteadyStrain(-rate), trace_every=steps, **velocity
    )


def _carried() -> float:
    """Largest distance from its start, over the box, of a row of discs that shear carries to strain 100 and back."""
    position = np.stack([1.5 * np.arange(8.0) + 0.3, np.full(8, 7.7)], axis=1)
    packing = Packing(position, np.full(8, 0.5), Box.cubic(12.0, 2))
    there, back = _there_and_back(frictional_scene(packing), 1.0, 0.05)
    gone = np.abs(there.packing.position_nd[:, 0] - position[:, 0] - 100.0 * 7.7).max()
    home = np.abs(back.packing.position_nd - position).max()
    box = np.abs(back.packing.box.lattice_dd - packing.box.lattice_dd).max()
    return float(max(gone / 100.0, home, box)) / 12.0


def _far() -> float:
    """Relative difference of the energy of contacts, at strain 100 and back, to that of a search from nothing."""
    scene = frictional_scene(dense_packing(), damping=0.3, damping_across=0.2)
    worst = 0.0
    for run in _there_and_back(scene, 0.5, 0.05):
        trace: Any = run.trace
        alone = energy(Scene(run.packing, (Repulsion(law=LinearSpring()),)))
        worst = max(worst, abs(float(trace.energy_t[-1] - trace.tangential_t[-1]) / alone - 1.0))
    return worst


def _resonance() -> float:
    """Largest error, over the largest amplitude, of a bonded pair driven for 50 periods at its own frequency.

    Two springs k along x, one of them through the boundary, of rest lengths 1/2 and 7/2 in a box of 4 (1 + A sin wt),
    which takes what is in it along: u'' + w^2 u = w^2 (2 - 1/2) A sin wt to first order in A, with w^2 = 4 k/m and
    u'(0) = A w / 2, so that u = -(3/4) A wt cos wt + (5/4) A sin wt.
    """
    amplitude, periods, phase = 1e-5, 50, 0.01
    packing = Packing(np.array([[1.0, 2.0], [1.5, 2.0]]), np.full(2, 0.1), Box.cubic(4.0, 2))
    bonds = bonds_of((0, 1, 0, 0.5), (0, 1, -1, 3.5))
    scene = frictional_scene(packing, bonds=bonds)
    scene = scene.replace(effects=(*scene.effects, BackgroundDamping(0.0)))
    omega = 2.0
    run: Any = simulate(
        scene,
        duration=2.0 * math.pi * periods / omega,
        dt=phase / omega,
        mass_n=[1.0, 1.0],
        applied_strain=OscillatoryStrain(amplitude, omega / (2.0 * math.pi), mode="uniaxial"),
        trace_every=50,
        trace_positions=True,
    )
    turned = omega * run.trace.time_t
    exact = amplitude * (1.25 * np.sin(turned) - 0.75 * turned * np.cos(turned))
    found = run.trace.position_tnd[:, 1, 0] - run.trace.position_tnd[:, 0, 0] - 0.5
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _outcome(scene: Scene, dt: float | None = None, steps: int = 3000, **how: Any) -> Outcome:
    return simulate(scene, steps=steps, dt=dt, check=False, **{"applied_strain": STILL, **how}).outcome


def _limits() -> float:
    """How many runs just below the limit of stability are stopped, and how many above it go on without a word."""
    good, bad = Outcome.FINISHED, Outcome.STEP_TOO_LONG
    thermal = 1e-4 * np.random.default_rng(0).standard_normal((40, 2))
    bonded = frictional_scene(pair_of(1.01), bonds=bonds_of((0, 1, 0, 1.0), tangential_stiffness=0.0), friction=0.0)
    rest = bonds_of((0, 1, 0, 0.95), tangential_stiffness=0.0, damping=40.0)
    damped = frictional_scene(pair_of(0.9), bonds=rest, friction=0.0)
    packed = frictional_scene(dense_packing())
    lossy = frictional_scene(dense_packing(), damping=0.3, damping_across=0.2)
    shear = SteadyStrain(1e-3)
    found = [
        # two masses on a spring: w^2 = 2 k/m and w dt = 2; on a dashpot: 2 c dt/m = 1
        (_outcome(bonded, 0.99 * math.sqrt(2.0)), good),
        (_outcome(bonded, 1.01 * math.sqrt(2.0)), bad),
        (_outcome(damped, 0.99 / 80.0), good),
        (_outcome(damped, 1.01 / 80.0, steps=20_000), bad),
        *((_outcome(scene, None, velocity_nd=thermal), good) for scene in (packed, lossy)),
        *((_outcome(scene, 0.6, velocity_nd=thermal), bad) for scene in (packed, lossy)),
        *((_outcome(scene, None, velocity_nd=thermal, applied_strain=shear), good) for scene in (packed, lossy)),
        *((_outcome(scene, 1.0, velocity_nd=thermal, applied_strain=shear), bad) for scene in (packed, lossy)),
    ]
    return float(sum(one is not expected for one, expected in found))


def _broad() -> float:
    """How far the energy of an undamped frictional mixture of diameters 1 and 10 rises, over its kinetic energy."""
    # sixteen large discs in a bed of small ones
    packing = dense_packing(416, Mixture(ratios=(1.0, 10.0), fractions=(400.0, 16.0)))
    rng = np.random.default_rng(2)
    velocity, spin = 0.01 * rng.standard_normal((416, 2)), 0.01 * rng.standard_normal((416, 1))
    run: Any = simulate(
        frictional_scene(packing), steps=5000, velocity_nd=velocity, spin_nk=spin, applied_strain=STILL, trace_every=20
    )
    total = energies(run)
    if not run.trace.sliding_t.any():
        return math.inf
    return float((total - np.minimum.accumulate(total)).max() / run.trace.kinetic_t[0])


CASES = (
    HardCase(
        "tangential bond 1e4 times stiffer",
        "the soft motion outlives millions of swings of the stiff one, which gain or lose a little each",
        "largest relative change of the energy over 50 000 undamped steps of the chosen length",
        0.03,
        "(w dt)^2 = 0.005 of the stiff swing: a quarter of it shows, and it loses less than 2 (w dt)^4 / 100 a step",
        _stiff_bond,
    ),
    HardCase(
        "friction 1e4 times stiffer than contacts",
        "one step of slip stretches the spring far beyond the cap",
        "largest tangential force over Coulomb's cap less one",
        1e-12,
        "the cap holds to rounding",
        _stiff_friction,
    ),
    HardCase(
        "strain 100 and back, carried",
        "images, lattice vectors and positions pile up errors as the box is mapped anew again and again",
        "distance from where the flow carries discs that touch nobody, over the box",
        1e-12,
        "4000 steps round by 1e-16 of up to 2 boxes each, homing takes whole boxes off",
        _carried,
    ),
    HardCase(
        "strain 100 and back, dense",
        "pair lists lose a contact, or count one twice, in a box sheared far",
        "relative difference of the contacts' energy to a search from nothing at strain 100 and back",
        1e-9,
        "positions 100 boxes away round by 2e-13 against overlaps of 0.1, energies by twice as much and their sums",
        _far,
    ),
    HardCase(
        "bonded pair at resonance",
        "the amplitude grows without bound, by the right amount only if no step is out of phase",
        "largest error over the largest amplitude, in 50 periods without damping",
        1.4e-3,
        "velocity Verlet's frequency is (w dt)^2 / 24 too high: 314 rad at w dt = 0.01",
        _resonance,
    ),
    HardCase(
        "steps just below and above stability",
        "above it energy comes from nowhere, and dashpots, friction or a large energy at rest hide it",
        "runs, of twelve, that end with another outcome than their step deserves",
        0.0,
        "below the limit the time is finished, above it the step is named too long",
        _limits,
    ),
    HardCase(
        "size ratio 10 with friction",
        "a light disc on a heavy one turns too fast for the step",
        "largest rise of the energy over the kinetic energy at the start, 5000 undamped steps",
        0.005,
        "friction only takes energy; the method swings by (w dt)^2 / 4 = 0.005 of what swings at the chosen step",
        _broad,
    ),
)
