"""Hard cases of dynamics: stiff springs, far shear, resonance, limits of stability, and odd collisions."""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HardCase

# a box at rest that could deform: all of these scenes are compiled together
STILL = pm.SteadyStrain(0.0)


def bonds_of(*ends: tuple[int, int, int, float], **numbers: Any) -> pm.Bonds:
    """Return bonds of (i, j, image along x, rest length)."""
    i, j, image, rest = (np.array(column) for column in zip(*ends, strict=True)) if ends else [np.zeros(0, int)] * 4
    return pm.Bonds(i, j, np.stack([image, 0 * image], axis=1).astype(int), rest.astype(float), **numbers)


def frictional_scene(
    packing: pm.Packing,
    *,
    stiffness: float = 1.0,
    damping: float = 0.0,
    friction: float = 0.5,
    across: float = 0.4,
    damping_across: float = 0.0,
    bonds: pm.Bonds | None = None,
) -> pm.Scene:
    """Return a scene with every effect of the frictional model; a strength of zero is as good as none."""
    return pm.Scene(
        packing,
        (
            pm.Repulsion(law=pm.LinearSpring(stiffness)),
            pm.ContactDamping(damping),
            pm.Friction(friction, across, damping_across),
            bonds_of() if bonds is None else bonds,
        ),
    )


def pair_of(distance: float, across: float = 0.0, radius: float = 0.5) -> pm.Packing:
    """Return two discs of mass 1, the second so far from the first along x and y."""
    position_nd = np.array([[5.0, 5.0], [5.0 + distance, 5.0 + across]])
    return pm.Packing(position_nd, np.full(2, radius), pm.Box.cubic(12.0, 2), mass_n=np.ones(2))


@cache
def dense_packing(particles: int = 40, sizes: Any = pm.Bidisperse(1.4)) -> pm.Packing:  # noqa: B008 - a frozen record
    """Return a dense packing at rest without friction."""
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.95, seed=1)
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=pm.LinearSpring()),)), force_tolerance=1e-10).packing


def energies(run: pm.Simulation) -> NDArray[np.float64]:
    """Return the energies that a run kept."""
    return np.asarray(run.trace.energy_t + run.trace.kinetic_t)


def _stiff_bond() -> float:
    """Energy error of an undamped bonded pair whose tangential spring is 1e4 times as stiff as its normal one."""
    scene = frictional_scene(pair_of(1.05), bonds=bonds_of((0, 1, 0, 1.0), tangential_stiffness=1e4))
    moving: dict[str, Any] = {"velocity_nd": [[0.01, -0.02], [0.0, 0.03]], "spin_nk": [[0.02], [-0.05]]}
    total = energies(pm.simulate(scene, steps=50_000, applied_strain=STILL, trace_every=97, **moving))
    return float(np.abs(total / total[0] - 1.0).max())


def _stiff_friction(across: float) -> float:
    """How far tangential forces, by springs so many times as stiff as contacts, go beyond the Coulomb limit."""
    scene = frictional_scene(dense_packing(), across=across, damping=0.3, damping_across=1.0)
    run = pm.simulate(scene, steps=3000, applied_strain=pm.SteadyStrain(0.05), trace_every=500, trace_positions=True)
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


def _there_and_back(scene: pm.Scene, rate: float, dt: float) -> tuple[pm.Simulation, pm.Simulation]:
    steps = round(100.0 / (rate * dt))
    there = pm.simulate(scene, steps=steps, dt=dt, applied_strain=pm.SteadyStrain(rate), trace_every=steps)
    turned = scene.replace(packing=there.packing)
    velocity: dict[str, Any] = {"velocity_nd": there.velocity_nd, "spin_nk": there.spin_nk}
    return there, pm.simulate(
        turned, steps=steps, dt=dt, applied_strain=pm.SteadyStrain(-rate), trace_every=steps, **velocity
    )


def _carried() -> float:
    """Largest distance from its start, over the box, of a row of discs that shear carries to strain 100 and back."""
    position = np.stack([1.5 * np.arange(8.0) + 0.3, np.full(8, 7.7)], axis=1)
    packing = pm.Packing(position, np.full(8, 0.5), pm.Box.cubic(12.0, 2))
    there, back = _there_and_back(frictional_scene(packing), 1.0, 0.05)
    gone = np.abs(there.packing.position_nd[:, 0] - position[:, 0] - 100.0 * 7.7).max()
    returned = np.abs(back.packing.position_nd - position).max()
    box = np.abs(back.packing.box.lattice_dd - packing.box.lattice_dd).max()
    return float(max(gone / 100.0, returned, box)) / 12.0


def _far() -> float:
    """Relative difference of the energy of contacts, at strain 100 and back, to that of a search from nothing."""
    scene = frictional_scene(dense_packing(), damping=0.3, damping_across=0.2)
    worst = 0.0
    for run in _there_and_back(scene, 0.5, 0.05):
        trace: Any = run.trace
        alone = pm.energy(pm.Scene(run.packing, (pm.Repulsion(law=pm.LinearSpring()),)))
        worst = max(worst, abs(float(trace.energy_t[-1] - trace.tangential_t[-1]) / alone - 1.0))
    return worst


def _resonance() -> float:
    """Largest error, over the largest amplitude, of a bonded pair driven for 50 periods at its own frequency.

    Two springs k along x, one of them through the boundary, of rest lengths 1/2 and 7/2 in a box of 4 (1 + A sin wt),
    which takes what is in it along: u'' + w^2 u = w^2 (2 - 1/2) A sin wt to first order in A, with w^2 = 4 k/m and
    u'(0) = A w / 2, so that u = -(3/4) A wt cos wt + (5/4) A sin wt.
    """
    amplitude, periods, phase = 1e-5, 50, 0.01
    packing = pm.Packing(np.array([[1.0, 2.0], [1.5, 2.0]]), np.full(2, 0.1), pm.Box.cubic(4.0, 2), mass_n=np.ones(2))
    bonds = bonds_of((0, 1, 0, 0.5), (0, 1, -1, 3.5))
    scene = frictional_scene(packing, bonds=bonds)
    scene = scene.replace(effects=(*scene.effects, pm.BackgroundDamping(0.0)))
    omega = 2.0
    run: Any = pm.simulate(
        scene,
        duration=2.0 * math.pi * periods / omega,
        dt=phase / omega,
        applied_strain=pm.OscillatoryStrain(amplitude, omega / (2.0 * math.pi), mode="uniaxial"),
        trace_every=50,
        trace_positions=True,
    )
    turned = omega * run.trace.time_t
    exact = amplitude * (1.25 * np.sin(turned) - 0.75 * turned * np.cos(turned))
    found = run.trace.position_tnd[:, 1, 0] - run.trace.position_tnd[:, 0, 0] - 0.5
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _outcome(scene: pm.Scene, dt: float | None = None, steps: int = 3000, **how: Any) -> pm.Outcome:
    return pm.simulate(scene, steps=steps, dt=dt, check=False, **{"applied_strain": STILL, **how}).outcome


def _limits() -> float:
    """How many runs just below the limit of stability are stopped, and how many above it go on without a word."""
    good, bad = pm.Outcome.FINISHED, pm.Outcome.STEP_TOO_LONG
    thermal = 1e-4 * np.random.default_rng(0).standard_normal((40, 2))
    bonded = frictional_scene(pair_of(1.01), bonds=bonds_of((0, 1, 0, 1.0), tangential_stiffness=0.0), friction=0.0)
    rest = bonds_of((0, 1, 0, 0.95), tangential_stiffness=0.0, damping=40.0)
    damped = frictional_scene(pair_of(0.9), bonds=rest, friction=0.0)
    packed = frictional_scene(dense_packing())
    lossy = frictional_scene(dense_packing(), damping=0.3, damping_across=0.2)
    shear = pm.SteadyStrain(1e-3)
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
    packing = dense_packing(416, pm.Mixture(ratios=(1.0, 10.0), fractions=(400.0, 16.0)))
    rng = np.random.default_rng(2)
    velocity, spin = 0.01 * rng.standard_normal((416, 2)), 0.01 * rng.standard_normal((416, 1))
    run: Any = pm.simulate(
        frictional_scene(packing), steps=5000, velocity_nd=velocity, spin_nk=spin, applied_strain=STILL, trace_every=20
    )
    total = energies(run)
    if not run.trace.sliding_t.any():
        return math.inf
    return float((total - np.minimum.accumulate(total)).max() / run.trace.kinetic_t[0])


def _crushed() -> float:
    """Relative error of the speed at which two discs part that coincided, under the divergent law up to its cap."""
    law = pm.DivergentRepulsion()
    run = pm.simulate(pm.Scene(pair_of(0.0), (pm.Repulsion(law=law),)), duration=0.6, dt=1e-5)
    parting = float(np.linalg.norm(run.velocity_nd[1] - run.velocity_nd[0]))
    return abs(parting / math.sqrt(4.0 * law.energy(0.0, 1.0)) - 1.0)


def _crossed() -> float:
    """Relative change of the speed of two discs that are thrown through each other, over the cap at their centers."""
    law = pm.DivergentRepulsion()
    speed = math.sqrt(1.3 * law.energy(0.0, 1.0))
    run = pm.simulate(
        pm.Scene(pair_of(1.1, 1e-9), (pm.Repulsion(law=law),)),
        duration=1.0,
        dt=1e-5,
        velocity_nd=[[speed, 0.0], [-speed, 0.0]],
    )
    through = run.packing.position_nd[0, 0] - run.packing.position_nd[1, 0] > 1.0
    return abs(float(run.velocity_nd[0, 0]) / speed - 1.0) if through else math.inf


def _head_on() -> float:
    """Error of the restitution of a head-on collision against exp(-pi b / sqrt(w^2 - b^2)), the linear dashpot's."""
    stiffness, damping, speed = 2.0, 0.3, 0.1
    run = pm.simulate(
        frictional_scene(pair_of(1.05), stiffness=stiffness, damping=damping),
        duration=8.0,
        dt=1e-4,
        velocity_nd=[[speed, 0.0], [-speed, 0.0]],
        applied_strain=STILL,
    )
    # the reduced mass is 1/2: w^2 = 2 k, b = c
    exact = math.exp(-math.pi * damping / math.sqrt(2.0 * stiffness - damping**2))
    return abs(float(run.velocity_nd[1, 0]) / speed - exact)


def _grazing() -> float:
    """Relative error of the push that two fast discs give each other as they graze, to the integral along a line."""
    aside, speed = 0.999, 10.0
    run = pm.simulate(
        frictional_scene(pair_of(-1.0, aside), friction=0.0),
        duration=0.2,
        dt=1e-5,
        velocity_nd=[[-0.5 * speed, 0.0], [0.5 * speed, 0.0]],
        applied_strain=STILL,
    )
    half = math.sqrt(1.0 - aside**2)
    # integral of (1 - r) b/r dx over the overlap, over the speed
    push = (2.0 * aside * math.asinh(half / aside) - 2.0 * aside * half) / speed
    return abs(float(run.velocity_nd[1, 1]) / push - 1.0)


def _grazing_with_friction(spin: float = 3.0, dt: float = 5e-3) -> float:
    """Change of the angular momentum of two spinning discs that graze with friction, over the sum of its parts."""
    scene = frictional_scene(pair_of(-1.0, 0.97), friction=0.8, across=5.0, damping=0.2, damping_across=0.3)
    velocity = np.array([[-0.5, 0.0], [0.5, 0.0]])
    run: Any = pm.simulate(
        scene, duration=3.0, dt=dt, velocity_nd=velocity, spin_nk=[[spin], [1.0]], applied_strain=STILL, trace_every=10
    )
    angular = run.trace.angular_momentum_tk
    if not run.trace.sliding_t.any() or abs(run.spin_nk[0, 0] - spin) < 1e-2:
        return math.inf
    return float(np.abs(angular - angular[0]).max() / (5.0 * 2.0 * 0.5 + 0.125 * (spin + 1.0)))


def _beats(ratio: float) -> float:
    """Largest error, over the largest amplitude, of that pair driven at a ratio of its own frequency for 100 periods.

    u'' + w^2 u = (2 w^2 - W^2 / 2) A sin Wt with u'(0) = A W / 2: u = C sin Wt + D sin wt with C (w^2 - W^2) =
    (2 w^2 - W^2 / 2) A.
    """
    amplitude, omega, phase = 1e-5, 2.0, 0.01
    driven = ratio * omega
    packing = pm.Packing(np.array([[1.0, 2.0], [1.5, 2.0]]), np.full(2, 0.1), pm.Box.cubic(4.0, 2), mass_n=np.ones(2))
    scene = frictional_scene(packing, bonds=bonds_of((0, 1, 0, 0.5), (0, 1, -1, 3.5)))
    scene = scene.replace(effects=(*scene.effects, pm.BackgroundDamping(0.0)))
    run: Any = pm.simulate(
        scene,
        duration=2.0 * math.pi * 100 / omega,
        dt=phase / omega,
        applied_strain=pm.OscillatoryStrain(amplitude, driven / (2.0 * math.pi), mode="uniaxial"),
        trace_every=50,
        trace_positions=True,
    )
    forced = (2.0 * omega**2 - 0.5 * driven**2) * amplitude / (omega**2 - driven**2)
    own = (0.5 * amplitude * driven - forced * driven) / omega
    exact = forced * np.sin(driven * run.trace.time_t) + own * np.sin(omega * run.trace.time_t)
    found = run.trace.position_tnd[:, 1, 0] - run.trace.position_tnd[:, 0, 0] - 0.5
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _stretched() -> float:
    """Largest distance from its start, over the box, of a row of discs taken to a strain of 99 along x, and back."""
    position = np.stack([1.4 * np.arange(8.0) + 0.6, np.full(8, 7.7)], axis=1)
    packing = pm.Packing(position, np.full(8, 0.5), pm.Box.cubic(12.0, 2))
    scene = frictional_scene(packing)
    there = pm.simulate(scene, steps=1980, dt=0.05, applied_strain=pm.SteadyStrain(1.0, mode="uniaxial"))
    turned = scene.replace(packing=there.packing)
    back = pm.simulate(
        turned, steps=1980, dt=0.05, velocity_nd=there.velocity_nd,
        applied_strain=pm.SteadyStrain(-0.01, mode="uniaxial"),
    )  # fmt: skip
    gone = np.abs(there.packing.position_nd[:, 0] - 100.0 * position[:, 0]).max() / 100.0
    returned = np.abs(back.packing.position_nd - position).max()
    box = np.abs(back.packing.box.lattice_dd - packing.box.lattice_dd).max()
    return float(max(gone, returned, box)) / 12.0


FLIGHT = 1_000_000


def _free_flight() -> float:
    """Relative error of the way of a disc that nothing pushes, after a million steps across a thousand boxes."""
    packing = pm.Packing([[0.1, 0.2], [5.0, 5.0]], [0.5, 0.5], pm.Box.cubic(12.0, 2), mass_n=np.ones(2))
    velocity = np.array([[1.3, -0.7], [1.3, -0.7]])
    run = pm.simulate(
        pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)), steps=FLIGHT, dt=0.01, velocity_nd=velocity
    )
    way = run.packing.position_nd - packing.position_nd
    if not np.array_equal(run.velocity_nd, velocity):
        return math.inf
    return float(np.abs(way / (velocity * 0.01 * FLIGHT) - 1.0).max())


def _flight_in_single() -> float:
    """Return the same of a sum in single precision."""
    place = np.add.accumulate(np.full(FLIGHT, 0.013, dtype=np.float32), dtype=np.float32)
    return abs(float(place[-1]) / (0.013 * FLIGHT) - 1.0)


def _there_and_back_again() -> float:
    """Largest distance from their start of two discs that collide, turn around, and collide again backwards."""
    packing = pair_of(1.05, 0.3)
    velocity = np.array([[0.2, 0.01], [-0.1, 0.0]])
    scene = frictional_scene(packing, friction=0.0)
    way: dict[str, Any] = {"steps": 1000, "dt": 0.01, "applied_strain": STILL}
    there = pm.simulate(scene, velocity_nd=velocity, **way)
    back = pm.simulate(scene.replace(packing=there.packing), velocity_nd=-there.velocity_nd, **way)
    if np.abs(there.velocity_nd - velocity).max() < 0.05:
        return math.inf
    return float(np.abs(back.packing.position_nd - packing.position_nd).max())


def _no_drift() -> float:
    """Change of the mean energy, over the kinetic energy, from the first to the last tenth of 100 000 steps."""
    start = dense_packing(16)
    scene = frictional_scene(start, friction=0.0)
    thermal = 1e-4 * np.random.default_rng(0).standard_normal((16, 2))
    run: Any = pm.simulate(scene, steps=100_000, dt=0.05, velocity_nd=thermal, applied_strain=STILL, trace_every=50)
    total = energies(run)
    part = len(total) // 10
    return float(abs(total[-part:].mean() - total[:part].mean()) / run.trace.kinetic_t.mean())


def _top(spin: float) -> float:
    """Largest error of the axis of a free spheroid after five units of time, against that of a symmetric top."""
    axis = np.array([0.6, 0.0, 0.8])
    packing = pm.Packing([[2.0] * 3], [0.5], pm.Box.cubic(4.0, 3), shapes=pm.Spheroids([2.5], [axis]))
    along, across = (float(one[0]) for one in packing.shapes.semi_axes(packing.radius_n))
    side, own = (
        float(packing.mass_n[0]) * (along**2 + across**2) / 5.0,
        float(packing.mass_n[0]) * 2.0 * across**2 / 5.0,
    )
    turning = spin * np.array([0.3, -0.4, 1.1])
    whole = side * turning + (own - side) * (turning @ axis) * axis
    size = float(np.sqrt(whole @ whole))
    run = pm.simulate(
        pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),)), steps=500, dt=0.01, spin_nk=turning[None]
    )
    about, angle = whole / size, 5.0 * size / side
    exact = (
        math.cos(angle) * axis
        + math.sin(angle) * np.cross(about, axis)
        + (1.0 - math.cos(angle)) * (about @ axis) * about
    )
    return float(np.abs(run.packing.shapes.director_nd[0] - exact).max())


def _squeezed() -> float:
    """Largest error, over the amplitude, of a disc between two walls nearer than its diameter, for 20 periods."""
    # each wall pushes with 2 k (r - distance): w^2 = 4 k/m
    stiffness, gap, aside, periods = 1.0, 0.8, 0.05, 20
    omega = math.sqrt(4.0 * stiffness)
    walls = pm.Walls(axis=1, low=5.0, high=5.0 + gap, law=pm.LinearSpring(stiffness))
    packing = pm.Packing(
        np.array([[5.0, 5.0 + 0.5 * gap + aside]]), np.array([0.5]), pm.Box.cubic(12.0, 2), mass_n=[1.0]
    )
    run: Any = pm.simulate(
        pm.Scene(packing, (walls,)),
        duration=2.0 * math.pi * periods / omega,
        dt=0.01 / omega,
        trace_every=100,
        trace_positions=True,
    )
    exact = 5.0 + 0.5 * gap + aside * np.cos(omega * run.trace.time_t)
    return float(np.abs(run.trace.position_tnd[:, 0, 1] - exact).max() / aside)


def _coincident() -> float:
    """How far the energy of three discs of one center rises with friction and spins, over what it was."""
    packing = pm.Packing(np.full((3, 2), 5.0), np.full(3, 0.5), pm.Box.cubic(12.0, 2))
    run = pm.simulate(
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
        pm.simulate(scene, steps=1, dt=0.01, applied_strain=STILL)
    except ValueError as refusal:
        return float("bond 0" not in str(refusal))
    return 1.0


CASES = (
    HardCase(
        "tangential bond 1e4 times stiffer",
        "the soft motion outlives millions of swings of the stiff one, which gain or lose a little each",
        "largest relative change of the energy over 50 000 undamped steps of the chosen length",
        0.03,
        "(w dt)^2 = 0.005 of the stiff swing: a quarter of it shows, and it loses less than 2 (w dt)^4 / 100 a step",
        _stiff_bond,
    ),
    *(
        HardCase(
            f"friction {across:.0e} times stiffer than contacts",
            "one step of slip stretches the spring far beyond the Coulomb limit",
            "largest tangential force over the Coulomb limit less one",
            1e-12,
            "the limit holds to rounding",
            partial(_stiff_friction, across),
        )
        for across in (1e4, 1e8)
    ),
    HardCase(
        "strain 100 and back, carried",
        "images, lattice vectors and positions pile up errors as the box is mapped anew again and again",
        "distance from where the flow carries discs that touch nobody, over the box",
        1e-12,
        "4000 steps round by 1e-16 of up to 2 boxes each, wrapping takes off multiples of the box",
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
        "above it the energy grows, and dashpots, friction or a large energy at rest hide it",
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
        "grazing with friction and spins",
        "torques with other arms than slips create angular momentum",
        "change of the angular momentum over the sum of its parts",
        1e-13,
        "arms add up to the distance, so that only sums round: 600 steps of 1e-16",
        _grazing_with_friction,
    ),
    HardCase(
        "grazing with friction at a spin of 1e6",
        "the spin is a million times what friction changes of it in a contact",
        "change of the angular momentum over the sum of its parts",
        1e-13,
        "arms add up to the distance, so that only sums round: 600 steps of 1e-16",
        partial(_grazing_with_friction, 1e6),
    ),
    HardCase(
        "a spheroid that spins at 1e6",
        "ten thousand radians in one step: turned by small angles, it is somewhere",
        "largest error of its axis against that of a symmetric top, 500 steps",
        1e-8,
        "the phase of 5e6 x 1.7 rad is rounded by 1e-9, and that of each step by 2e-12, which add up",
        partial(_top, 1e6),
        "turned by spin x dt once a step: any direction",
    ),
    *(
        HardCase(
            f"bonded pair driven at {ratio:g} of its frequency",
            "beats: the amplitude grows and falls again, at times that the step's error in phase decides",
            "largest error over the largest amplitude, in 100 periods without damping",
            2e-3,
            "velocity Verlet's frequency is (w dt)^2 / 24 too high: 628 rad of half a swing, and 4e-4 of the detuning",
            partial(_beats, ratio),
            "explicit Euler: grown by e^((w dt)^2 62832 / 2) = 23",
        )
        for ratio in (0.99, 1.01)
    ),
    HardCase(
        "stretched by 99 and back, carried",
        "images and lattice vectors pile up errors as one side of the box grows a hundredfold",
        "distance from where the flow carries discs that touch nobody, over the box",
        1e-12,
        "4000 steps round by 1e-16 of up to 2 boxes each",
        _stretched,
    ),
    HardCase(
        "free flight of a million steps",
        "every step rounds the place, and wrapping it once more",
        "relative error of the way after 9 000 to 13 000 diameters; infinite if a velocity changed",
        1e-10,
        "a million steps round by half a spacing, 9e-13, of 13 000: 7e-11 if all go one way",
        _free_flight,
        _flight_in_single,
    ),
    HardCase(
        "a collision and the same backwards",
        "a method that is not reversible, or contacts that remember",
        "largest distance from the start, in diameters",
        1e-12,
        "2000 steps round by 1e-15 each, at random, and the collision turns them by three",
        _there_and_back_again,
    ),
    HardCase(
        "100 000 steps without damping",
        "a drift of a 1e8th in a step is of some tenths of a percent in the end",
        "change of the mean energy over the mean kinetic energy",
        6e-4,
        "velocity Verlet swings by (w dt)^2 / 4 at w^2 = k / m, and its mean stays",
        _no_drift,
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
        "no normal, no arms, no slip: NaN, or momentum that is not conserved",
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
