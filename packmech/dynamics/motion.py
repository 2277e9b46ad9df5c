"""A simulation on its way: the program, masses, velocities and links, and what is to be seen of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.joints import NEWTON
from packmech.dynamics.kernels import RUNNING, force_pass
from packmech.dynamics.pair_list import SKIN_FULL, empty_list
from packmech.dynamics.program import Program
from packmech.dynamics.rattle import ERROR, Rattle, make_rattle
from packmech.dynamics.verlet import look, start_forces
from packmech.effects import Bonds, Friction, Walls, is_bound, law_second, pair_first, pair_second
from packmech.mechanics.link_calls import move_links, project_links, reaffix_links, refill_links
from packmech.scene import Scene

# overlaps [1] at which the stiffness of a contact is looked up
_OVERLAPS = (0.0, 0.1)
# particles that left the cell far behind are looked for, and brought back, every so many steps
_HOMING = 1024


class Sight(NamedTuple):
    """Figures at one moment; stresses are Cauchy, tension positive [energy/length^d].

    Energies [energy]; momentum_d; impulse the sum of m |v|, against which momentum is to be compared; stress_dd of
    contacts (dashpots included) and links; kinetic_stress_dd -(1/V) sum m u u^T with u = v - mean velocity; contacts
    the number of touching pairs; max_force and mean_force largest net force (links included) and mean contact force;
    link_error the largest error of a link over its scale; tension_l of the program's links [force].
    overall_stress_dd with torques and spins, symmetric; strain gamma of the box and its rate; sliding the number of
    contacts at Coulomb's cap; angular_momentum_k about the origin; tangential and rotational the parts of energy and
    kinetic in tangential springs and spins; the parts of overall_stress_dd by torques and spins, and the part of
    stress_dd by bonds; the power with which a deforming box works, and what it is of the order of (`power_of`). From
    overall_stress_dd on they are of marches, else None or zero.
    """

    time: float
    energy: float
    kinetic: float
    momentum_d: NDArray[np.float64]
    impulse: float
    stress_dd: NDArray[np.float64]
    kinetic_stress_dd: NDArray[np.float64]
    contacts: int
    max_force: float
    mean_force: float
    link_error: float
    tension_l: NDArray[np.float64]
    overall_stress_dd: NDArray[np.float64] | None = None
    strain: float = 0.0
    strain_rate: float = 0.0
    sliding: int = 0
    angular_momentum_k: NDArray[np.float64] | None = None
    tangential: float = 0.0
    rotational: float = 0.0
    torque_stress_dd: NDArray[np.float64] | None = None
    spin_stress_dd: NDArray[np.float64] | None = None
    bond_stress_dd: NDArray[np.float64] | None = None
    power: float = 0.0
    pressing: float = 0.0

    @property
    def total(self) -> float:
        """Potential and kinetic energy together [energy]."""
        return self.energy + self.kinetic


def choose_time_step(scene: Scene, mass_n: NDArray[np.float64], fraction: float) -> float:
    """Return fraction times the shortest of sqrt(m / k) and m / c over the particles [time].

    m is the least mass; k the largest stiffness and c the largest damping of whatever acts (`stiffness_and_damping`).
    How far anything moves has no part in it.

    Parameters
    ----------
    scene
        The scene.
    mass_n
        (N,) masses.
    fraction
        The fraction [1].

    """
    stiffest, most_damped, drag = stiffness_and_damping(scene)
    least = float(mass_n.min())
    # one over each of the two times
    fastest = max(math.sqrt(stiffest / least), most_damped / least + drag)
    if not fastest > 0.0:
        raise ValueError("dt must be given for effects without stiffness, got None")
    return fraction / fastest


def stiffness_and_damping(scene: Scene) -> tuple[float, float, float]:
    """Return the largest stiffness k [energy/length^2], damping c [mass/time] and background drag [1/time] of a scene.

    k is |d2u/dr2| of two particles of one size at an overlap of 0 or 0.1, c the damping of their approach; so for bonds
    at their rest lengths, and for walls, by half their stiffness, as a single particle moves there where otherwise two
    do. Tangential springs and dashpots count 3 fold in a plane, 3.5 fold in space: they turn particles as well as move
    them, with the inertia m r^2 / 2 or 2 m r^2 / 5.
    """
    sizes = np.unique(scene.packing.diameter_n).tolist()
    turned = 3.0 if scene.packing.dimension == 2 else 3.5
    stiff, damped, drag = [0.0], [0.0], 0.0
    pairs = [one for one in scene.effects if not is_bound(one)]
    for sigma in sizes:
        for overlap in _OVERLAPS:
            r = (1.0 - overlap) * sigma
            stiff.append(abs(sum(pair_second(one, r, sigma) for one in pairs)))
            rates = (sum(pair_first(one, r, sigma, rate) for one in pairs) for rate in (1.0, 0.0))
            damped.append(abs(next(rates) - next(rates)))
    for one in scene.effects:
        if isinstance(one, Friction):
            stiff.append(turned * one.stiffness)
            damped.append(turned * one.damping)
        elif isinstance(one, Bonds) and len(one):
            for rest in (float(one.rest_length_b.min()), float(one.rest_length_b.max())):
                stiff += [abs(law_second(one.compression, (1.0 - overlap) * rest, rest)) for overlap in _OVERLAPS]
                stiff.append(abs(law_second(one.tension, rest, rest)))
            stiff.append(turned * one.tangential_stiffness)
            damped += [one.damping, turned * one.tangential_damping]
        elif isinstance(one, Walls):
            stiff += [0.5 * one.body_stiffness(0.5 * sigma) for sigma in sizes]
            damped.append(one.damping)
        elif hasattr(type(one), "body_force"):
            center = np.zeros(3)
            center[: scene.packing.dimension] = scene.packing.box.lattice_dd.sum(axis=1) / 2.0
            radius = 0.5 * scene.packing.reference_diameter
            slow, fast = (one.body_force(*center.tolist(), speed, 0.0, 0.0, 1.0, radius)[0] for speed in (0.0, 1.0))
            drag += abs(fast - slow)
    return max(stiff), max(damped), drag


@dataclass(eq=False)
class Motion:
    """The state of a simulation. All arrays but mass_n are by the program's rows."""

    program: Program
    effects: tuple[Any, ...]
    weight_n: NDArray[np.float64]
    rattle: Rattle | None
    dt: float
    steps: int = 0
    force_evaluations: int = 0

    @property
    def velocity_nd(self) -> NDArray[np.float64]:
        """The (N, d) velocities of the rows [length/time]."""
        return self.program.velocity_nd

    @property
    def time(self) -> float:
        """Time since the start."""
        return self.steps * self.dt

    def set_velocities(self, velocity_nd: NDArray[np.float64]) -> None:
        """Take velocities in the order of the packing; what would stretch links is left out. Forces are made anew."""
        program = self.program
        program.velocity_nd[:] = velocity_nd[program.order_n]
        if self.rattle is not None:
            project_links(self.rattle.here, self.velocity_nd, self.velocity_nd, self.rattle.multiplier_l, False)
        program.pairs = start_forces(
            self.effects, program.axes, program.row, program.force_nd, self.velocity_nd, program.space, program.pairs
        )
        self.force_evaluations += 1

    def thermal_velocities(self, temperature: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return (N, d) random velocities without total momentum, along the links, of just the kinetic energy."""
        program = self.program
        n, d = program.velocity_nd.shape
        draw = np.empty((n, d))
        # drawn by particle, so that the order of the rows does not matter
        draw[:] = rng.standard_normal((n, d))[program.order_n] * np.sqrt(temperature * self.weight_n)[:, None]
        mass = 1.0 / self.weight_n
        draw -= (mass[:, None] * draw).sum(axis=0) / mass.sum()
        freedom = (n - 1) * d
        if self.rattle is not None:
            project_links(self.rattle.here, draw, draw, self.rattle.multiplier_l, False)
            freedom -= int(np.count_nonzero(self.rattle.here.inverse_pivot_r))
        kinetic = 0.5 * float((mass[:, None] * draw**2).sum())
        if freedom <= 0 or not kinetic > 0.0:
            raise ValueError(f"temperature must be left out where nothing can move, got {temperature:g}")
        velocity = np.empty((n, d))
        velocity[program.order_n] = draw * np.sqrt(0.5 * freedom * temperature / kinetic)
        return velocity

    def advance(self, kernel: Any, steps: int) -> tuple[int, int]:
        """Advance by up to `steps` steps of a loop; return how that ended and the steps taken."""
        program = self.program
        half = np.empty_like(program.velocity_nd)
        status, taken, program.pairs = kernel(
            self.effects,
            program.axes,
            program.row,
            program.force_nd,
            program.velocity_nd,
            half,
            self.weight_n,
            program.space,
            self.rattle,
            program.pairs,
            self.dt,
            2.0 * float(program.row[:, 3].min()),
            steps,
        )
        return int(status), int(taken)

    def stride(self, steps: int) -> int:
        """Return how many of so many steps `follow` would take from here: none beyond one that brings particles home.

        Few enough, too, that an interrupt is seen.
        """
        return min(steps, self.program.chunk, _HOMING - self.steps % _HOMING)

    def follow(self, method: Any, steps: int) -> int:
        """Advance by up to `steps` steps; return how that ended."""
        due = self.stride(steps)
        status: int
        status, taken = method.advance(self, due)
        self.steps += taken
        self.force_evaluations += taken
        if status == RUNNING and self.steps % _HOMING == 0:
            self.bring_home()
        return status

    def bring_home(self) -> None:
        """Move particles that went far beyond the cell by whole lattice vectors, so that images stay few."""
        program = self.program
        d = len(program.axes)
        fraction = program.row[:, :d] @ program.box.inverse_dd.T
        shift = np.where((fraction < -1.0) | (fraction >= 2.0), np.floor(fraction), 0.0)
        if not shift.any():
            return
        program.row[:, :d] -= shift @ program.box.lattice_dd.T
        program.home_nd[program.order_n] += shift
        program.join()
        program.pairs = empty_list(len(shift), float(program.pairs.number[SKIN_FULL]))
        self.affix()
        # forces by the new list: their bits may differ by the order of a sum
        program.pairs = start_forces(
            self.effects, program.axes, program.row, program.force_nd, self.velocity_nd, program.space, program.pairs
        )
        self.force_evaluations += 1

    def affix(self) -> None:
        """Make the links ready at the present positions, on their lengths."""
        program = self.program
        self.rattle = make_rattle(program.space.joints, self.weight_n, program.space.resolution)
        if self.rattle is None:
            return
        here, lattice = self.rattle.here, program.space.frame.lattice_dd
        _, error, _ = reaffix_links(here, program.row, lattice, self.rattle.tolerance, NEWTON)
        if not error <= self.rattle.lost:
            raise ValueError(
                f"scene.packing must have links that can be held at their lengths, got an error of {error:g}"
            )
        refill_links(here, program.row, lattice)
        self.rattle.number[ERROR] = error

    def see(self) -> Sight:
        """Return the figures of the present moment. Looking changes no bit of what follows."""
        program = self.program
        d, volume = len(program.axes), program.box.volume
        velocity = program.velocity_nd
        force = np.zeros_like(program.force_nd)
        # the forces of the loop hold dashpots at an extrapolated velocity
        sums = force_pass(self.effects, program.axes, program.row, force, velocity, program.pairs)
        seen = look(self.effects, program.axes, program.row, velocity, program.pairs)
        stress = seen.virial_dd[:d, :d] / volume
        tension = np.zeros(0)
        error = 0.0
        if self.rattle is not None:
            tension, virial = self._link_forces(force)
            stress = stress + virial / volume
            error = float(self.rattle.number[ERROR])
        mass = (1.0 / self.weight_n)[:, None]
        momentum = (mass * velocity).sum(axis=0)
        own = velocity - momentum / mass.sum()
        most = float(np.sqrt((force**2).sum(axis=1)).max())
        return Sight(
            time=self.time,
            energy=float(seen.energy),
            kinetic=0.5 * float((mass * velocity**2).sum()),
            momentum_d=momentum,
            impulse=float((mass[:, 0] * np.sqrt((velocity**2).sum(axis=1))).sum()),
            stress_dd=stress,
            kinetic_stress_dd=-np.einsum("na,nb->ab", mass * own, own) / volume,
            contacts=int(sums.touching),
            max_force=most,
            mean_force=sums.total / sums.touching if sums.touching else 0.0,
            link_error=error,
            tension_l=tension,
        )

    def _link_forces(self, force_nd: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take the links' forces from force_nd; return their tensions and V times their part of the stress.

        A link's length does not accelerate: n.(a_j - a_i) = -w^2 / length with w the relative velocity across it, so
        that (Omega^T W Omega) t = Omega^T W F + w^2 / length.
        """
        program, rattle = self.program, self.rattle
        assert rattle is not None and program.links is not None
        d = len(program.axes)
        links = program.links
        vector = links.vectors(program.row[:, :d], program.space.frame.lattice_dd[:d, :d])
        distance = np.sqrt((vector**2).sum(axis=1))
        relative = program.velocity_nd[links.j_l] - program.velocity_nd[links.i_l]
        along = (relative * vector).sum(axis=1) / distance
        turning = ((relative**2).sum(axis=1) - along**2) / distance
        tension, motion = np.zeros(len(links)), np.empty_like(force_nd)
        project_links(rattle.here, force_nd, force_nd, tension, True)
        centripetal = np.zeros(len(links))
        move_links(rattle.here, turning, motion, centripetal)
        force_nd -= motion
        tension += centripetal
        return tension, np.einsum("l,la,lb->ab", tension / distance, vector, vector)

    def tensions(self, tension_l: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return tensions of the program's links by the links of the packing; redundant ones carry none."""
        program = self.program
        whole, own = program.scene.packing.links, program.links
        if whole is None or own is None:
            return np.zeros(0)
        home = program.home_nd.astype(np.int64)
        i, j = program.order_n[own.i_l], program.order_n[own.j_l]
        image = own.image_ld @ program.change_dd.T - home[j] + home[i]
        named = zip(whole.i_l.tolist(), whole.j_l.tolist(), map(tuple, whole.image_ld.tolist()), strict=True)
        place = {key: k for k, key in enumerate(named)}
        found = np.zeros(len(whole))
        for p, q, z, tension in zip(i.tolist(), j.tolist(), image.tolist(), tension_l.tolist(), strict=True):
            back = (q, p, tuple(-part for part in z))
            found[place[back] if back in place else place[p, q, tuple(z)]] = tension
        return found

    def state(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return copies of the (N, d) positions and velocities in the order of the packing."""
        velocity = np.empty_like(self.velocity_nd)
        velocity[self.program.order_n] = self.velocity_nd
        return self.program.positions(), velocity
