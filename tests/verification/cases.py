"""Motions with closed forms: what time steps give beside what mechanics says, at a step and at half of it.

Benchmarks of contacts are tests 1 to 8 of Chung and Ooi, Granul. Matter 13, 643 (2011); those of free fall, rebound,
stacking, sliding, oblique impact and settling are cases DEM01 to 06 of MFiX (Garg, Galvin, Li and Pannala, Powder
Technol. 220, 122 (2012)). Closed forms are derived here, for any stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import beta, hyp2f1

import packmech as pm

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Compared:
    """A quantity over another, from time steps and from the closed form."""

    x: Array
    found: Array
    exact: Array

    @property
    def error(self) -> float:
        """Largest difference over the largest value of the closed form."""
        return float(np.abs(self.found - self.exact).max() / np.abs(self.exact).max())


@dataclass(frozen=True)
class Case:
    """A motion with a closed form.

    `solve(steps)` is it with so many steps over its natural time. `order` is that of the error in the time step, None
    where the closed form is a limit of another kind, which `why` says; `bound` is the largest error at `steps`.
    """

    name: str
    source: str
    axes: tuple[str, str]
    solve: Callable[[int], Compared]
    steps: int
    bound: float
    order: float | None
    why: str

    @property
    def title(self) -> str:
        """What happens, in the words of the function."""
        return (self.solve.__doc__ or "").strip().split("\n")[0]


CASES: dict[str, Case] = {}


def case(
    source: str, axes: tuple[str, str], *, steps: int, bound: float, order: float | None = 2.0, why: str = ""
) -> Callable[[Callable[[int], Compared]], Callable[[int], Compared]]:
    """Return a decorator that registers a motion."""

    def add(solve: Callable[[int], Compared]) -> Callable[[int], Compared]:
        name = solve.__name__.replace("_", "-")
        CASES[name] = Case(name, source, axes, solve, steps, bound, order, why)
        return solve

    return add


# -- spheres and what acts on them ------------------------------------------------------------------------------------

# glass beads of Chung and Ooi's first test: radius, Young's modulus, Poisson's ratio, density, speed
RADIUS, YOUNG, POISSON, DENSITY, SPEED = 0.01, 4.8e10, 0.2, 2800.0, 10.0


def mass_of(radius: float, density: float = DENSITY) -> float:
    """Return the mass of a sphere."""
    return density * 4.0 / 3.0 * math.pi * radius**3


def hertz(young: float, poisson: float, radius: float) -> tuple[pm.Hertz, float]:
    """Return the law of two equal spheres and K in F = K overlap^(3/2) = (4/3) E* sqrt(R*) overlap^(3/2)."""
    stiff = 4.0 / 3.0 * young / (2.0 * (1.0 - poisson**2)) * math.sqrt(0.5 * radius)
    return pm.Hertz(stiff * (2.0 * radius) ** 2.5), stiff


def pair(radii: tuple[float, float], masses: tuple[float, float], *effects: Any) -> pm.Scene:
    """Return two spheres along x that just touch, far from their images."""
    side = 20.0 * max(radii)
    place = np.full((2, 3), 0.5 * side)
    place[1, 0] += sum(radii)
    return pm.Scene(pm.Packing(place, radii, pm.Box.cubic(side, 3), mass_n=masses), effects)


def alone(radius: float, mass: float, height: float, *effects: Any) -> pm.Scene:
    """Return a sphere whose center is at a height, in a box far larger."""
    side = 20.0 * max(radius, height)
    return pm.Scene(
        pm.Packing([[0.5 * side, height, 0.5 * side]], [radius], pm.Box.cubic(side, 3), mass_n=[mass]), effects
    )


def moved(scene: pm.Scene, duration: float, steps: int, every: int, **start: Any) -> tuple[Array, Array]:
    """Return the times and (T, N, 3) places of a run."""
    run = pm.simulate(
        scene, steps=steps, dt=duration / steps, trace_every=every, trace_positions=True, check=False, **start
    )
    return np.asarray(run.trace.step_t) * (duration / steps), np.asarray(run.trace.position_tnd)


def hertz_overlap(time: float, deepest: float, speed: float) -> float:
    """Return the overlap of an elastic Hertz contact: t = (d/v) 2F1(2/5, 1/2; 7/5; (d/d_max)^(5/2)) while it grows."""
    half = deepest / speed * float(hyp2f1(0.4, 0.5, 1.4, 1.0))
    time = time if time <= half else 2.0 * half - time
    if time >= half:
        return deepest
    return float(
        brentq(
            lambda d: d / speed * hyp2f1(0.4, 0.5, 1.4, (d / deepest) ** 2.5) - time, 0.0, deepest, xtol=1e-16 * deepest
        )
    )


def hertz_contact(stiff: float, mass: float, speed: float) -> tuple[float, float]:
    """Return the deepest overlap and the time to it, of a mass against a contact of F = K overlap^(3/2)."""
    deepest = (1.25 * mass * speed**2 / stiff) ** 0.4
    return deepest, deepest / speed * float(hyp2f1(0.4, 0.5, 1.4, 1.0))


@case("Chung and Ooi (2011), test 1", ("time / duration", "overlap / deepest"), steps=200, bound=1e-4)
def elastic_impact_of_two_spheres(steps: int) -> Compared:
    """Two equal spheres of glass meet head on and rebound: Hertz contact."""
    law, stiff = hertz(YOUNG, POISSON, RADIUS)
    mass = mass_of(RADIUS)
    deepest, half = hertz_contact(stiff, 0.5 * mass, 2.0 * SPEED)
    scene = pair((RADIUS, RADIUS), (mass, mass), pm.Repulsion(law))
    velocity = [[SPEED, 0.0, 0.0], [-SPEED, 0.0, 0.0]]
    time, place = moved(scene, 2.0 * half, steps, steps // 40, velocity_nd=velocity)
    found = 2.0 * RADIUS - (place[:, 1, 0] - place[:, 0, 0])
    exact = np.array([hertz_overlap(t, deepest, 2.0 * SPEED) for t in time])
    return Compared(time / (2.0 * half), found / deepest, exact / deepest)


@case("Chung and Ooi (2011), test 2", ("time / duration", "overlap / deepest"), steps=200, bound=1e-4)
def elastic_impact_on_a_wall(steps: int) -> Compared:
    """A sphere of aluminium alloy meets a wall and rebounds: it is pressed as by its mirror image."""
    law, stiff = hertz(7e10, 0.33, 0.1)
    mass, speed = mass_of(0.1, 2699.0), 0.2
    # the image comes twice as near, and the force is that of the pair
    stiff *= 2.0**1.5
    deepest, half = hertz_contact(stiff, mass, speed)
    scene = alone(0.1, mass, 0.1, pm.Walls(axis=1.0, low=0.0, high=1.5, law=law))
    time, place = moved(scene, 2.0 * half, steps, steps // 40, velocity_nd=[[0.0, -speed, 0.0]])
    exact = np.array([hertz_overlap(t, deepest, speed) for t in time])
    return Compared(time / (2.0 * half), (0.1 - place[:, 0, 1]) / deepest, exact / deepest)


@case("Chung and Ooi (2011), test 3", ("restitution asked for", "speed after / before"), steps=400, bound=1e-3,
      order=None, why="dashpots set in with the fourth root of the overlap")  # fmt: skip
def restitution_of_damped_impacts(steps: int) -> Compared:
    """Spheres of aluminium alloy whose dashpots are made by a restitution rebound with it: Hertz contact."""
    law, stiff = hertz(7e10, 0.33, 0.1)
    mass, speed = mass_of(0.1, 2699.0), 0.2
    asked, found = np.linspace(0.1, 0.9, 5), []
    half = hertz_contact(stiff, 0.5 * mass, 2.0 * speed)[1]
    for restitution in asked:
        scene = pair((0.1, 0.1), (mass, mass), pm.Repulsion(law), pm.Restitution(float(restitution)))
        # the more is lost, the longer it takes
        time = 2.0 * half * (2.0 - math.log(restitution))
        run = pm.simulate(scene, duration=time, dt=2.0 * half / steps, velocity_nd=[[speed, 0, 0], [-speed, 0, 0]])
        found.append((run.velocity_nd[1, 0] - run.velocity_nd[0, 0]) / (2.0 * speed))
    return Compared(asked, np.array(found), asked)


def oblique(radii: tuple[float, float], masses: tuple[float, float], spin: tuple[float, float], steps: int) -> Compared:
    """Return slips after impacts of two spheres that meet head on with spins, over the range of sticking and sliding.

    With a tangential spring of 2/7 of the normal one both swing at the same frequency: the ratio of their forces stays,
    and a contact either sticks throughout and turns its slip about, or slides throughout by 7 mu (1 + e) v_n / 2.
    """
    # stiff, as arms are shorter by the overlap
    stiff, mu, speed = 1e15, 0.4, 0.2
    reduced = masses[0] * masses[1] / sum(masses)
    time = math.pi * math.sqrt(reduced / stiff)
    effects = (pm.Repulsion(pm.LinearSpring(stiff)), pm.Friction(mu, 2.0 / 7.0 * stiff))
    ratios, found, exact = np.array([0.2, 0.8, 1.2, 2.0, 4.0]), [], []
    for ratio in ratios:
        # slip over what the normal speed lets stick
        slip = ratio * 3.5 * mu * speed
        share = slip / (spin[0] * radii[0] + spin[1] * radii[1])
        scene = pair(radii, masses, *effects)
        away = reduced * speed
        run = pm.simulate(
            scene,
            steps=steps,
            dt=time / steps,
            velocity_nd=[[away / masses[0], 0, 0], [-away / masses[1], 0, 0]],
            spin_nk=[[0, 0, share * spin[0]], [0, 0, share * spin[1]]],
        )
        across = run.velocity_nd[1, 1] - run.velocity_nd[0, 1]
        turned = radii[0] * run.spin_nk[0, 2] + radii[1] * run.spin_nk[1, 2]
        found.append((across - turned) / slip)
        exact.append(1.0 if ratio < 1.0 else -1.0 + 2.0 / ratio)
    return Compared(ratios, np.array(found), np.array(exact))


OBLIQUE = ("slip before / largest that sticks", "- slip after / slip before")


@case("Ramirez, Poschel, Brilliantov and Schwager (1999)", ("speed / largest", "part of the speed that is lost"),
      steps=400, bound=1e-3, order=None, why="the closed form is a series, taken to its second term")  # fmt: skip
def restitution_of_viscoelastic_spheres(steps: int) -> Compared:
    """Viscoelastic spheres lose less of their speed the slower they meet."""
    law, stiff = hertz(YOUNG, POISSON, RADIUS)
    mass, relative = mass_of(RADIUS), 2.0 * SPEED * 10.0 ** np.linspace(-3.0, 0.0, 5)
    time = 1e-2 * hertz_contact(stiff, 0.5 * mass, 2.0 * SPEED)[1]
    found, exact = [], []
    for speed in relative:
        deepest, half = hertz_contact(stiff, 0.5 * mass, speed)
        scene = pair((RADIUS, RADIUS), (mass, mass), pm.Repulsion(law), pm.ViscoelasticDamping(time))
        velocity = [[0.5 * speed, 0, 0], [-0.5 * speed, 0, 0]]
        run = pm.simulate(scene, duration=3.0 * half, dt=2.0 * half / steps, velocity_nd=velocity)
        found.append(1.0 - (run.velocity_nd[1, 0] - run.velocity_nd[0, 0]) / speed)
        share = 6.0 * time * stiff / (mass * speed) * deepest**1.5 * 0.4 * beta(0.6, 1.5)
        exact.append(share - 0.6 * share**2)
    return Compared(relative / relative[-1], np.array(found), np.array(exact))


IN_STEP = "both springs swing in step, at any time step: what is left is the overlap over the radius"


@case("Chung and Ooi (2011), test 7", OBLIQUE, steps=200, bound=1e-6, order=None, why=IN_STEP)
def spinning_impact_of_two_spheres(steps: int) -> Compared:
    """Two equal spheres meet head on with equal spins, with friction: they stick or slide."""
    mass = mass_of(0.025, 2500.0)
    return oblique((0.025, 0.025), (mass, mass), (1.0, 1.0), steps)


@case("Chung and Ooi (2011), test 8", OBLIQUE, steps=200, bound=1e-6, order=None, why=IN_STEP)
def spinning_impact_of_unequal_spheres(steps: int) -> Compared:
    """A spinning sphere meets one of twice its radius and eight times its mass, at rest, with friction."""
    mass = mass_of(0.025, 2500.0)
    return oblique((0.025, 0.05), (mass, 8.0 * mass), (1.0, 0.0), steps)


@case(
    "Chung and Ooi (2011), test 7",
    ("tangential / normal stiffness", "slip late in the contact / before"),
    steps=100,
    bound=1e-3,
)
def spinning_impact_that_sticks(steps: int) -> Compared:
    """Two equal spheres meet head on with equal spins and never slide: their slip swings as a spring does.

    At four fifths of the contact: at its end the spring would be let go in the middle of a step.
    """
    radius, stiff, speed = 0.025, 1e15, 0.2
    mass = mass_of(radius, 2500.0)
    time = 0.8 * math.pi * math.sqrt(0.5 * mass / stiff)
    ratios, found = np.linspace(0.1, 1.1, 6), []
    for ratio in ratios:
        scene = pair(
            (radius, radius), (mass, mass), pm.Repulsion(pm.LinearSpring(stiff)), pm.Friction(1e3, ratio * stiff)
        )
        run = pm.simulate(
            scene,
            steps=steps,
            dt=time / steps,
            velocity_nd=[[speed, 0, 0], [-speed, 0, 0]],
            spin_nk=[[0, 0, speed / radius]] * 2,
        )
        across = run.velocity_nd[1, 1] - run.velocity_nd[0, 1]
        found.append((radius * run.spin_nk[:, 2].sum() - across) / (2.0 * speed))
    # seven halves of the inverse reduced mass act on the slip
    return Compared(ratios, np.array(found), np.cos(0.8 * math.pi * np.sqrt(3.5 * ratios)))


# -- free fall, rebound, stacking, settling ---------------------------------------------------------------------------


def damped_swing(stiff: float, damping: float, mass: float, gravity: float, start: Array, time_t: Array) -> Array:
    """Return overlap and its rate over time of a mass on a wall's spring and dashpot under gravity."""
    # (overlap, its rate, 1)
    matrix = np.array([[0.0, 1.0, 0.0], [-stiff / mass, -damping / mass, gravity], [0.0, 0.0, 0.0]])
    return np.array([(expm(t * matrix) @ np.array([*start, 1.0]))[:2] for t in time_t])


@case("MFiX, DEM01", ("time / time of fall", "height / height at the start"), steps=2000, bound=1e-3, order=None,
      why="the dashpot's force sets in at once, in the middle of a step")  # fmt: skip
def sphere_that_falls_and_rebounds(steps: int) -> Compared:
    """A sphere falls on a wall of springs and dashpots, and rebounds."""
    radius, height, gravity = 0.1, 0.5, 9.81
    mass, stiff, part = mass_of(radius, 2600.0), 2e4, 0.3
    fall = math.sqrt(2.0 * (height - radius) / gravity)
    # of the sphere on the wall; its image comes twice as near and as fast
    damping = part * 2.0 * math.sqrt(mass * stiff)
    walls = pm.Walls(axis=1.0, low=0.0, high=2.0, law=pm.LinearSpring(0.5 * stiff), damping=0.5 * damping)
    scene = alone(radius, mass, height, pm.Gravity(0.0, -gravity, 0.0), walls)
    end = 1.6 * fall
    time, place = moved(scene, end, steps, steps // 100)
    exact = height - 0.5 * gravity * time**2
    inside = time > fall
    speed = gravity * fall
    swing = lambda t: damped_swing(stiff, damping, mass, gravity, np.array([0.0, speed]), np.atleast_1d(t))  # noqa: E731
    omega = math.sqrt(stiff / mass * (1.0 - part**2))
    out = fall + brentq(lambda t: swing(t)[0, 0], 0.5 * math.pi / omega, 1.6 * math.pi / omega)
    exact[inside] = radius - swing(time[inside] - fall)[:, 0]
    away = time > out
    rebound = -swing(out - fall)[0, 1]
    exact[away] = radius + rebound * (time[away] - out) - 0.5 * gravity * (time[away] - out) ** 2
    return Compared(time / fall, place[:, 0, 1] / height, exact / height)


@case("MFiX, DEM02", ("bounce", "height of the bounce / height before"), steps=20_000, bound=2e-2, order=None,
      why="hard spheres are the limit of stiff ones: off by gravity's part in the contact")  # fmt: skip
def bounces_of_hard_spheres(steps: int) -> Compared:
    """A ball bounces lower and lower, by the square of its restitution each time."""
    radius, height, gravity, restitution = 0.1, 0.5, 9.81, 0.8
    mass = mass_of(radius, 2600.0)
    walls = pm.Walls(axis=1.0, low=0.0, high=2.0, law=pm.LinearSpring(5e6), damping=pm.Restitution(restitution))
    scene = alone(radius, mass, height, pm.Gravity(0.0, -gravity, 0.0), walls)
    fall = math.sqrt(2.0 * (height - radius) / gravity)
    bounces = np.arange(1, 5)
    end = fall * (1.0 + 2.0 * float(np.sum(restitution ** bounces[:-1])) + restitution ** bounces[-1])
    _, place = moved(scene, 1.02 * end, steps, steps // 400)
    low, middle, high = (place[k : len(place) - 2 + k, 0, 1] for k in range(3))
    top = (middle >= low) & (middle > high)
    # the parabola of the free flight through three places
    slope, bend = 0.5 * (high - low)[top], (high - 2.0 * middle + low)[top]
    found = (middle[top] - 0.5 * slope**2 / bend)[: len(bounces)] - radius
    return Compared(bounces.astype(float), found / (height - radius), restitution ** (2.0 * bounces))


@case("MFiX, DEM03", ("time / period", "height / radius"), steps=400, bound=1e-4)
def two_spheres_pressed_between_walls(steps: int) -> Compared:
    """Two spheres of different density, one on the other and pressed between two walls, swing under gravity."""
    radius, gravity, stiff = 5e-4, 9.81, 1e3
    masses = np.array([mass_of(radius, 2e4), mass_of(radius, 1e4)])
    high = 3.6 * radius
    start = np.array([0.9, 2.7]) * radius
    side = 40.0 * radius
    place = [[0.5 * side, y, 0.5 * side] for y in start]
    walls = pm.Walls(axis=1.0, low=0.0, high=high, law=pm.LinearSpring(0.5 * stiff))
    packing = pm.Packing(place, [radius, radius], pm.Box.cubic(side, 3), mass_n=masses)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(stiff)), walls, pm.Gravity(0.0, -gravity, 0.0)))
    period = 2.0 * math.pi * math.sqrt(masses[0] / stiff)
    time, found = moved(scene, period, steps, steps // 40)
    # m y1'' = k (r - y1) - k (2r - y2 + y1) - m g, and so on: (y1, y2, their rates, 1)
    matrix = np.zeros((5, 5))
    matrix[0, 2] = matrix[1, 3] = 1.0
    matrix[2, [0, 1, 4]] = np.array([-2.0 * stiff, stiff, stiff * (radius - 2.0 * radius)]) / masses[0]
    matrix[3, [0, 1, 4]] = np.array([stiff, -2.0 * stiff, stiff * (2.0 * radius + high - radius)]) / masses[1]
    matrix[2:4, 4] -= gravity
    exact = np.array([(expm(t * matrix) @ np.array([*start, 0.0, 0.0, 1.0]))[:2] for t in time])
    return Compared(time / period, (found[:, :, 1] / radius)[:, 1], (exact / radius)[:, 1])


@case("MFiX, DEM06", ("time / relaxation time", "speed / terminal speed"), steps=100, bound=1e-4)
def settling_with_drag(steps: int) -> Compared:
    """A sphere falls through a fluid that drags in proportion to the speed, up to its terminal speed."""
    rate, gravity = 4.0, 9.81
    scene = alone(0.01, mass_of(0.01), 0.5, pm.Gravity(0.0, -gravity, 0.0), pm.BackgroundDamping(rate))
    times, found = np.linspace(0.5, 3.0, 6) / rate, []
    for time in times:
        run = pm.simulate(scene, steps=steps, dt=time / steps)
        found.append(-run.velocity_nd[0, 1])
    return Compared(times * rate, np.array(found) * rate / gravity, 1.0 - np.exp(-rate * times))


@case("Ai, Chen, Rotter and Ooi (2011)", ("time / time to rest", "spin / spin at the start"), steps=400, bound=2e-3,
      order=None, why="the spring is at its limit after a first stretch, which is taken for none")  # fmt: skip
def spins_that_rolling_resistance_stops(steps: int) -> Compared:
    """Two pressed spheres roll on each other and are stopped at a constant rate by their rolling resistance."""
    overlap, rolling, spin, arm = 0.02, 0.05, 0.2, 0.245
    place = [[0.0, 1.5, 1.5], [0.98, 1.5, 1.5]]
    # a ring of two, each pressed from both sides
    packing = pm.Packing(place, [0.5, 0.5], pm.Box(np.diag([1.96, 3.0, 3.0])), mass_n=[1.0, 1.0])
    effects = (pm.Repulsion(pm.LinearSpring()), pm.Friction(1e3, 0.7), pm.RollingResistance(rolling, 10.0))
    rate = 2.0 * arm * rolling * overlap / (0.4 * 0.25)
    times, found = np.linspace(0.2, 0.9, 8) * spin / rate, []
    for time in times:
        run = pm.simulate(
            pm.Scene(packing, effects), duration=time, dt=spin / rate / steps, spin_nk=[[0, spin, 0], [0, -spin, 0]]
        )
        found.append(run.spin_nk[0, 1] / spin)
    return Compared(times * rate / spin, np.array(found), 1.0 - times * rate / spin)


# -- rough walls ------------------------------------------------------------------------------------------------------


def on_rough_wall(starts: Array, stiff: float, restitution: float, steps: int) -> Array:
    """Return slips after a sphere met a rough wall at a speed of 1, for (K, 2) tangential speeds and slips by spin.

    Its radius and mass are 1, the friction is .4, and the tangential spring 2/7 of the normal one.
    """
    # pressed to d, a particle has twice the force of the law of itself and its image
    law = pm.LinearSpring(0.5 * stiff)
    walls = pm.Walls(1.0, 0.0, 15.0, law, pm.Restitution(restitution), friction=pm.Friction(0.4, 2.0 / 7.0 * stiff))
    scene, time = alone(1.0, 1.0, 1.0, walls), math.pi / math.sqrt(stiff)
    found = []
    for speed, slip in starts:
        # a dashpot makes it longer
        run = pm.simulate(
            scene, duration=3.0 * time, dt=time / steps, velocity_nd=[[speed, -1.0, 0.0]], spin_nk=[[0.0, 0.0, slip]]
        )
        found.append(run.velocity_nd[0, 0] + run.spin_nk[0, 2])
    return np.array(found)


def slips_after(slips: Array, restitution: float) -> Array:
    """Return slips after impacts at a speed of 1 that stick throughout (rebound in step), or slide throughout."""
    lost = 3.5 * 0.4 * (1.0 + restitution)
    return np.where(slips < 0.5 * lost, -slips, slips - lost)


@case("Chung and Ooi (2011), test 4", OBLIQUE, steps=200, bound=2e-4)
def oblique_impact_on_a_rough_wall(steps: int) -> Compared:
    """A sphere meets a rough wall at the same normal speed and ever flatter: it sticks or slides."""
    slips = np.array([0.2, 0.8, 1.2, 2.0, 4.0]) * 1.4
    found = on_rough_wall(np.stack([slips, 0.0 * slips], axis=1), 1e12, 1.0, steps)
    return Compared(slips / 1.4, -found / slips, -slips_after(slips, 1.0) / slips)


@case("Chung and Ooi (2011), test 6", OBLIQUE, steps=200, bound=2e-4)
def spinning_impact_on_a_rough_wall(steps: int) -> Compared:
    """A spinning sphere meets a rough wall head on, ever faster spinning: it sticks or slides."""
    slips = np.array([0.2, 0.8, 1.2, 2.0, 4.0]) * 1.4
    found = on_rough_wall(np.stack([0.0 * slips, slips], axis=1), 1e12, 1.0, steps)
    return Compared(slips / 1.4, -found / slips, -slips_after(slips, 1.0) / slips)


@case("Chung and Ooi (2011), test 5; MFiX, DEM05", ("angle of impact", "tangential speed after / before"), steps=400,
      bound=2e-3, order=None, why="the dashpot's force sets in at once, in the middle of a step")  # fmt: skip
def oblique_impact_with_restitution(steps: int) -> Compared:
    """A sphere meets a rough wall at angles at which it slides throughout, and keeps .9 of its normal speed."""
    angles = np.radians([70.0, 75.0, 80.0, 85.0])
    slips = np.tan(angles)
    found = on_rough_wall(np.stack([slips, 0.0 * slips], axis=1), 1e12, 0.9, steps)
    # two sevenths of the change of slip are that of the speed
    exact = slips + 2.0 / 7.0 * (slips_after(slips, 0.9) - slips)
    return Compared(np.degrees(angles), (slips + 2.0 / 7.0 * (found - slips)) / slips, exact / slips)


def resting_on_wall(
    friction: pm.Friction, gravity: tuple[float, float], stiff: float = 1e8, rolling: pm.RollingResistance | None = None
) -> pm.Scene:
    """Return a sphere of radius 1 and mass 1 that weights press on a rough wall, where its spring balances it."""
    walls = pm.Walls(1.0, 0.0, 15.0, pm.LinearSpring(0.5 * stiff), friction=friction, rolling=rolling)
    return alone(1.0, 1.0, 1.0 - gravity[1] / stiff, pm.Gravity(gravity[0], -gravity[1], 0.0), walls)


@case("MFiX, DEM04", ("time / time of sliding", "speed / speed at the start"), steps=2000, bound=1e-8, order=None,
      why="off by the stretch at which the spring slips, at any time step")  # fmt: skip
def ball_that_slips_and_then_rolls(steps: int) -> Compared:
    """A ball thrown along a rough floor slips ever slower, and rolls at five sevenths of its speed."""
    mu, gravity, speed = 0.2, 1.0, 1.0
    scene = resting_on_wall(pm.Friction(mu, 1e6, 2e3), (0.0, gravity))
    sliding = 2.0 / 7.0 * speed / (mu * gravity)
    end = 2.0 * sliding
    run = pm.simulate(
        scene, steps=10 * steps, dt=end / (10 * steps), trace_every=steps // 4, trace_positions=True,
        velocity_nd=[[speed, 0.0, 0.0]], check=False,
    )  # fmt: skip
    time = np.asarray(run.trace.step_t) * end / (10 * steps)
    slips = np.minimum(time, sliding)
    exact = speed * time - mu * gravity * slips * (time - 0.5 * slips)
    place = np.asarray(run.trace.position_tnd)[:, 0, 0]
    return Compared(time[1:] / sliding, (place[1:] - place[0]) / time[1:], exact[1:] / time[1:])


@case("Ke and Bray (1995)", ("slope over friction", "acceleration / gravity"), steps=4000, bound=5e-5, order=None,
      why="off by the time in which the spring is stretched, at any time step")  # fmt: skip
def ball_on_a_slope(steps: int) -> Compared:
    """A ball on a rough slope rolls with five sevenths of the pull, or slides where 3.5 mu is below the slope."""
    mu, slopes, found, exact = 0.2, np.array([0.2, 0.4, 0.6, 0.8, 1.0, 1.5]), [], []
    for slope in slopes:
        along, across = math.sin(math.atan(slope)), math.cos(math.atan(slope))
        scene = resting_on_wall(pm.Friction(mu, 1e6, 2e3), (along, across))
        run = pm.simulate(scene, steps=10 * steps, dt=1.0 / (10 * steps))
        found.append(run.velocity_nd[0, 0])
        exact.append(5.0 / 7.0 * along if slope <= 3.5 * mu else along - mu * across)
    return Compared(slopes / mu, np.array(found), np.array(exact))


@case("Ai, Chen, Rotter and Ooi (2011)", ("time / time to rest", "speed / speed at the start"), steps=2000, bound=1e-6,
      order=None, why="off by the stretch at which the spring slips, at any time step")  # fmt: skip
def ball_that_rolls_to_rest(steps: int) -> Compared:
    """A ball that rolls on a floor is stopped at a constant rate by the floor's resistance to rolling."""
    mu_r, gravity, speed = 0.2, 1.0, 1.0
    resistance = pm.RollingResistance(mu_r, 1e3, 30.0)
    scene = resting_on_wall(pm.Friction(0.5, 1e5, 5e2), (0.0, gravity), 1e6, resistance)
    rate = 5.0 / 7.0 * mu_r * gravity
    times, found = np.array([0.2, 0.5, 0.8]) * speed / rate, []
    for time in times:
        run = pm.simulate(
            scene, duration=time, dt=speed / rate / (10 * steps), velocity_nd=[[speed, 0.0, 0.0]],
            spin_nk=[[0.0, 0.0, -speed]],
        )  # fmt: skip
        found.append(run.velocity_nd[0, 0] / speed)
    return Compared(times * rate / speed, np.array(found), 1.0 - times * rate / speed)


# -- cohesion ---------------------------------------------------------------------------------------------------------

FLAT, MODULUS = 0.01, 2.0  # work of adhesion, effective Young's modulus


def pulled(effects: tuple[Any, ...], distances: Array) -> Array:
    """Return the pull between two spheres of radius .5 that once touched, at distances of their centers."""
    found = []
    for distance in distances:
        packing = pm.Packing([[1.5, 2.0, 2.0], [1.5 + distance, 2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 3))
        memory = pm.TangentialDisplacements([0], [1], [[0, 0, 0]], [[0.0, 0.0, 0.0]], memory_ck=[[1.0]])
        scene = pm.Scene(packing.replace(tangential=memory if isinstance(effects[0], pm.JKR) else None), effects)
        found.append(pm.forces(scene)[0, 0])
    return np.array(found)


@case("Johnson, Kendall and Roberts (1971)", ("radius of contact / that at rest", "pull / pull-off force"), steps=12,
      bound=1e-12, order=None, why="forces alone are compared, without steps")  # fmt: skip
def spheres_that_part_by_jkr(steps: int) -> Compared:
    """Two adhesive spheres are pulled apart: the largest pull is 3/2 pi w R, and 5/6 pi w R where they let go."""
    radius = 0.25
    rest = (9.0 * math.pi * FLAT * radius**2 / (2.0 * MODULUS)) ** (1.0 / 3.0)
    # the contact lets go where the distance is largest
    a = rest * np.linspace(1.5, (1.0 / 9.0) ** (1.0 / 3.0) * 1.01, steps)
    overlap = a**2 / radius - np.sqrt(2.0 * math.pi * FLAT * a / MODULUS)
    force = 4.0 * MODULUS * a**3 / (3.0 * radius) - np.sqrt(8.0 * math.pi * FLAT * MODULUS * a**3)
    found = pulled((pm.JKR(MODULUS, FLAT),), 1.0 - overlap)
    return Compared(a / rest, found / (1.5 * math.pi * FLAT * radius), -force / (1.5 * math.pi * FLAT * radius))


@case("Derjaguin, Muller and Toporov (1975)", ("gap / range", "pull / pull-off force"), steps=12, bound=1e-12,
      order=None, why="forces alone are compared, without steps")  # fmt: skip
def spheres_that_part_by_dmt(steps: int) -> Compared:
    """Two stiff adhesive spheres are pulled apart: the pull is 2 pi w R where they touch, and falls as gaps squared."""
    radius, width = 0.25, 0.02
    gap = width * np.linspace(0.0, 5.0, steps)
    found = pulled((pm.DMT(FLAT, width, 50.0),), 1.0 + gap)
    # lowered in proportion to end at the cut
    exact = (1.0 / (1.0 + gap / width) ** 2 - 1.0 / 51.0**2) / (1.0 - 1.0 / 51.0**2)
    return Compared(gap / width, found / (2.0 * math.pi * FLAT * radius), exact)
