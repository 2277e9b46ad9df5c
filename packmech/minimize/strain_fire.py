"""FIRE with the box: positions and strains relax together, at constant pressure or constant volume.

The slow but sure way to shear-stabilized packings: it crosses instabilities that stop Newton's method. A strain moves
every particle with it; its coordinate is the strain times sqrt(N) mean diameters, which makes it about as stiff as a
particle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.minimize.fire import Fire, steer
from packmech.minimize.program import Evaluation, Program
from packmech.minimize.soft_network import isochoric_part
from packmech.packing import Packing

# strains make steps uphill costlier than they are for particles alone
_FIRE = Fire(dt_max=0.5, shrink=0.5)
# steps between two calls of `watch`
_WATCHED = 20


@dataclass(frozen=True, eq=False)
class StrainRelaxation:
    """Where positions and strains came to rest, and the errors: net force over mean force, stress over pressure."""

    packing: Packing
    residual: float
    stress_error: float
    pressure: float
    steps: int

    @property
    def merit(self) -> float:
        """The larger of the two errors."""
        return max(self.residual, self.stress_error)


def relax_strained(
    program: Program,
    packing: Packing,
    basis_kdd: NDArray[np.float64],
    pressure: float | None,
    *,
    tolerance: float,
    step_limit: int,
    watch: Callable[[Packing], None] | None = None,
) -> StrainRelaxation:
    """Return the packing relaxed in positions and strains.

    Parameters
    ----------
    program
        The compiled scene.
    packing
        Where to start.
    basis_kdd
        (k, d, d) free strains; their traces are kept out of the motion when the volume is held.
    pressure
        Pressure to hold [energy/length^d], or None to hold the volume.
    tolerance
        Both errors to stop at [1].
    step_limit
        Most steps.
    watch
        Called with the packing every few steps.

    """
    d, n = packing.dimension, packing.particles
    volume = packing.box.volume
    scale = float(np.sqrt(n) * packing.diameter_n.mean())
    basis = isochoric_part(basis_kdd, d) if pressure is None else basis_kdd
    position, box = packing.position_nd.copy(), packing.box
    constraints = None if packing.links is None else ConstraintFactor(packing, workable_links(packing))
    if constraints is not None:
        position = constraints.reaffixed(packing).position_nd
    velocity, rate = np.zeros_like(position), np.zeros((d, d))
    dt, mixing, downhill, mobility = _FIRE.dt, _FIRE.mixing, 0.0, 1.0
    furthest = _FIRE.largest_step * float(packing.diameter_n.min())
    step = 0
    while True:
        now = program.evaluate(position, box.lattice_dd)
        pull = _stress_pull(now, basis, box.volume, pressure)
        errors = _errors(now, basis, pressure)
        if max(errors) <= tolerance or step >= step_limit:
            return StrainRelaxation(packing.replace(position_nd=position, box=box), *errors, now.pressure, step)
        if watch is not None and step and step % _WATCHED == 0:
            watch(packing.replace(position_nd=position, box=box))
        if step % 64 == 0:
            stiffness = now.force_floor / program.space.resolution
            mobility = 5.0 / stiffness if stiffness > 0.0 else mobility
        step += 1
        strain_force = pull / scale
        power = float((now.force_nd * velocity).sum() + (strain_force * rate).sum())
        if power > 0.0:
            speed = float(np.sqrt((velocity**2).sum() + (rate**2).sum()))
            force = float(np.sqrt((now.force_nd**2).sum() + (strain_force**2).sum()))
            velocity = (1.0 - mixing) * velocity + mixing * speed / force * now.force_nd
            rate = (1.0 - mixing) * rate + mixing * speed / force * strain_force
        else:
            velocity, rate = np.zeros_like(velocity), np.zeros_like(rate)
        dt, mixing, downhill = steer(_FIRE, power <= 0.0, dt, mixing, downhill)  # type: ignore[no-untyped-call]
        velocity = velocity + dt * mobility * now.force_nd
        rate = rate + dt * mobility * strain_force
        reach = dt * max(float(np.sqrt((velocity**2).sum(axis=1).max())), float(np.abs(rate).max()))
        if reach > furthest:
            velocity, rate = velocity * (furthest / reach), rate * (furthest / reach)
        strain = dt * rate / scale
        position = position + dt * velocity + position @ strain.T
        box = box.strained(strain)
        if pressure is None:
            factor = (volume / box.volume) ** (1.0 / d)
            position, box = position * factor, box.scaled(factor)
        if constraints is not None:
            constraints = constraints.at(constraints.reaffixed(packing.replace(position_nd=position, box=box)))
            position = constraints.packing.position_nd
            velocity, _, _ = constraints.project(velocity)


def _stress_pull(
    now: Evaluation, basis: NDArray[np.float64], volume: float, pressure: float | None
) -> NDArray[np.float64]:
    """Return minus the enthalpy's slope along the free strains, as a tensor in their span."""
    stress = now.stress_dd + (0.0 if pressure is None else pressure) * np.eye(len(now.stress_dd))
    pull: NDArray[np.float64] = -volume * np.einsum("kab,kcd,cd->ab", basis, basis, stress)
    return pull


def _errors(now: Evaluation, basis: NDArray[np.float64], pressure: float | None) -> tuple[float, float]:
    d = len(now.stress_dd)
    held = now.pressure if pressure is None else pressure
    missing = np.einsum("kab,ab->k", basis, now.stress_dd + held * np.eye(d))
    residual = now.residual if now.contacts else (0.0 if pressure is None else np.inf)
    return residual, float(np.abs(missing).max()) / held if held > 0.0 else 0.0
