"""A march as `pm.simulate` drives it: the same questions and answers as those of a motion without friction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.growth import look_every, power_of
from packmech.dynamics.march.look import (
    ANGULAR,
    BONDED,
    CONTACTS,
    FORCE,
    IMPULSE,
    KINETIC,
    MOMENTUM,
    MOST,
    MOTION,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    SPINNING,
    STRAIN,
    TANGENTIAL,
    TORQUE,
    TOTAL,
)
from packmech.dynamics.march.state import March, build_march
from packmech.dynamics.motion import Sight
from packmech.dynamics.strain import Strain
from packmech.effects import Bonds, Friction, Walls
from packmech.packing import without_links
from packmech.scene import Scene


def needs_march(scene: Scene, strain: Strain | None) -> bool:
    """Whether the scene has more to it than forces between touching pairs and rigid links."""
    beyond = any(isinstance(one, Friction | Bonds) or hasattr(type(one), "body_force") for one in scene.effects)
    return beyond or strain is not None


def refuse_misfits(scene: Scene) -> None:
    """Refuse bonds of particles or of a dimension that are not the packing's, or whose ends coincide, and walls beyond.

    Bonds without a length have no direction to push in; walls across z mean nothing in a plane; a pair has one
    tangential spring.
    """
    for kind in (Friction, Bonds):
        number = sum(isinstance(one, kind) for one in scene.effects)
        if number > 1:
            raise ValueError(f"scene.effects must hold one {kind.__name__} at most, got {number}")
    position, lattice = scene.packing.position_nd, scene.packing.box.lattice_dd
    n, d = position.shape
    for k, one in enumerate(scene.effects):
        if isinstance(one, Walls) and one.axis >= d:
            raise ValueError(f"scene.effects[{k}].axis must be 0 or 1 in a plane, got {one.axis:g}")
        if not isinstance(one, Bonds) or not len(one):
            continue
        if one.image_bd.shape[1] != d:
            raise ValueError(f"scene.effects[{k}].image_bd must have shape ({len(one)}, {d}), got {one.image_bd.shape}")
        if int(one.j_b.max()) >= n:
            # i < j, so that j tells
            bond = int(one.j_b.argmax())
            raise ValueError(f"scene.effects[{k}].j_b must be below {n}, got {int(one.j_b[bond])} for bond {bond}")
        length = np.linalg.norm(position[one.j_b] - position[one.i_b] + one.image_bd @ lattice.T, axis=1)
        least = int(np.argmin(length))
        if length[least] == 0.0:
            raise ValueError(f"scene.effects must hold bonds whose ends are apart, got no length for bond {least}")


def tensors(figures: NDArray[np.float64], dimension: int, volume: float) -> dict[str, NDArray[np.float64]]:
    """Return the parts of the stress by name, (..., d, d), Cauchy, tension positive, of rows of a march's figures.

    "contact": forces of contacts and bonds times branch vectors. "torque": half the sum of torques as an antisymmetric
    matrix, which makes up for what is not symmetric in it. "spin": what rotation stretches grains by (the centrifugal
    term, (I/2)(|w|^2 - w w)). "overall": the sum of these three, symmetric (section 10 of the corrected specification
    and section 7.2.2 of its source, in three dimensions too). "kinetic": -sum m c c of the peculiar velocities; in no
    other.
    """
    d = dimension

    def whole(place: int) -> NDArray[np.float64]:
        return np.asarray(figures[..., place : place + 9].reshape(*figures.shape[:-1], 3, 3)[..., :d, :d] / volume)

    torque = np.zeros((*figures.shape[:-1], 3, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        torque[..., a, b] = 0.5 * figures[..., TORQUE + c] / volume
        torque[..., b, a] = -torque[..., a, b]
    parts = {"contact": whole(FORCE), "torque": torque[..., :d, :d], "spin": -whole(SPINNING)}
    return {**parts, "overall": sum(parts.values(), np.zeros((d, d))), "kinetic": -whole(MOTION)}


class Marching:
    """A march with the face of a `Motion`."""

    rattle = None

    def __init__(
        self,
        scene: Scene,
        mass_n: NDArray[np.float64],
        dt: float,
        *,
        second_order: bool,
        spin_nk: NDArray[np.float64] | None,
        strain: Strain | None,
        held_n: NDArray[np.bool_] | None,
        threads: int = 1,
    ) -> None:
        without_links("scene.packing", scene.packing)
        refuse_misfits(scene)
        self.scene, self.mass_n = scene, mass_n
        self.look_every = look_every(strain, dt, scene.packing.particles)
        d = scene.packing.dimension
        self.march: March = build_march(
            scene,
            dt=dt,
            mass_n=mass_n,
            velocity_nd=np.zeros((len(mass_n), d)),
            spin_nk=spin_nk,
            profile=None if strain is None else strain.profile(),
            direction_dd=None if strain is None else strain.direction(d),
            held_n=held_n,
            second_order=second_order,
            threads=threads,
        )
        self.force_evaluations = 0

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.march.steps

    @property
    def time(self) -> float:
        """Time since the start."""
        return self.march.time

    def set_velocities(self, velocity_nd: NDArray[np.float64]) -> None:
        """Take (N, d) peculiar velocities in the order of the packing; forces are taken anew."""
        d = self.scene.packing.dimension
        body = self.march.state.body
        body[:, 4 : 4 + d] = velocity_nd[self.march.order_n]
        body[self.march.state.weight_nk[:, 0] == 0.0, 4 : 4 + d] = 0.0
        self.march.begin()
        self.force_evaluations += 1

    def thermal_velocities(self, temperature: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return (N, d) random velocities without total momentum, of just the kinetic energy."""
        d = self.scene.packing.dimension
        free = np.empty(len(self.mass_n), dtype=bool)
        free[self.march.order_n] = self.march.state.weight_nk[:, 0] > 0.0
        mass = self.mass_n[:, None]
        draw = rng.standard_normal((len(self.mass_n), d)) * np.sqrt(temperature / mass) * free[:, None]
        freedom = int(free.sum()) * d
        if free.all():
            draw -= (mass * draw).sum(axis=0) / mass.sum()
            freedom -= d
        kinetic = 0.5 * float((mass * draw**2).sum())
        if freedom <= 0 or not kinetic > 0.0:
            raise ValueError(f"temperature must be left out where nothing can move, got {temperature:g}")
        return np.asarray(draw * math.sqrt(0.5 * freedom * temperature / kinetic))

    def stride(self, steps: int) -> int:
        """Return how many of so many steps `follow` would take from here: few enough that an interrupt is seen."""
        return int(min(steps, max(1, 1_000_000 // int(self.march.state.body.size)), self.look_every))

    def follow(self, method: Any, steps: int) -> int:
        """Advance by up to `steps` steps; return how that ended."""
        due = self.stride(steps)
        before = self.march.steps
        status = self.march.advance(due)
        self.force_evaluations += self.march.steps - before
        return status

    def see(self) -> Sight:
        """Return the figures of the present moment. Looking changes no bit of what follows."""
        d = self.scene.packing.dimension
        out = self.march.see()
        volume = self.march.box().volume
        parts = tensors(out, d, volume)
        # what is held has no velocity of its own, and no part in the mean
        momentum, none = out[MOMENTUM : MOMENTUM + d].copy(), np.zeros((d, d))
        free = float(self.mass_n[self.march.order_n][self.march.state.weight_nk[:, 0] > 0.0].sum())
        power, pressing = 0.0, 0.0
        if self.march.space.flow is not None:
            rate = self.march.space.flow.rate_dd[:d, :d]
            power, pressing = power_of(volume, parts["contact"], parts["kinetic"], rate)
        return Sight(
            time=self.time,
            energy=float(out[POTENTIAL] + out[TANGENTIAL]),
            kinetic=float(out[KINETIC] + out[ROTATIONAL]),
            momentum_d=momentum,
            impulse=float(out[IMPULSE]),
            stress_dd=parts["contact"],
            kinetic_stress_dd=parts["kinetic"] + np.outer(momentum, momentum) / (free * volume) if free else none,
            contacts=int(out[CONTACTS]),
            max_force=float(out[MOST]),
            mean_force=float(out[TOTAL] / out[CONTACTS]) if out[CONTACTS] else 0.0,
            link_error=0.0,
            tension_l=np.zeros(0),
            overall_stress_dd=parts["overall"],
            strain=float(out[STRAIN]),
            strain_rate=float(out[RATE]),
            sliding=int(out[SLIDING]),
            angular_momentum_k=out[ANGULAR : ANGULAR + 3].copy(),
            tangential=float(out[TANGENTIAL]),
            rotational=float(out[ROTATIONAL]),
            torque_stress_dd=parts["torque"],
            spin_stress_dd=parts["spin"],
            bond_stress_dd=out[BONDED : BONDED + 9].reshape(3, 3)[:d, :d] / volume,
            power=power,
            pressing=pressing,
        )

    def tensions(self, tension_l: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return no tensions: a march knows no rigid links."""
        return np.zeros(0)

    def state(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the (N, d) positions and velocities in the order of the packing."""
        return self.march.positions(), self.march.velocities()
