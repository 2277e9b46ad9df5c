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
from packmech.minimize.first_order.fire import Fire, steer
from packmech.minimize.program import Evaluation, Program
from packmech.minimize.second_order.soft_network import Load, isochoric_part
from packmech.packing import Packing
from packmech.result import Outcome

Array = NDArray[np.float64]

# strains make steps uphill costlier than they are for particles alone
_FIRE = Fire(dt_max=0.5, shrink=0.5)
# strain under a load that shears, above which a packing is taken to flow without end
_FLOWS = 1.0
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


class StrainedFire:
    """FIRE in positions and strains, as the run loop steps it.

    Parameters
    ----------
    program
        The compiled scene.
    packing
        Where to start.
    basis_kdd
        (k, d, d) free strains; their traces are kept out of the motion when the volume is held.
    pressure
        Pressure to hold [energy/length^d], or a load; None to hold the volume.
    tolerance
        Both errors to stop at [1].
    step_limit
        Maximum number of steps.
    watch
        Called with the packing every few steps.

    """

    def __init__(
        self,
        program: Program,
        packing: Packing,
        basis_kdd: NDArray[np.float64],
        pressure: float | Load | None,
        *,
        tolerance: float,
        step_limit: int,
        watch: Callable[[Packing], None] | None = None,
    ) -> None:
        self.program, self.start, self.tolerance = program, packing, tolerance
        rest_dd = np.zeros((packing.dimension,) * 2)
        if isinstance(pressure, Load):
            pressure, rest_dd = pressure
        self._sheared, self._inverse_dd = bool(rest_dd.any()), packing.box.inverse_dd
        self.pressure, self._load_dd = pressure, np.eye(packing.dimension) + rest_dd
        self.step_limit, self.watch = step_limit, watch
        self.basis_kdd = isochoric_part(basis_kdd, packing.dimension) if pressure is None else basis_kdd
        self.constraints = None if packing.links is None else ConstraintFactor(packing, workable_links(packing))
        if self.constraints is not None:
            packing = self.constraints.projected(packing)
        # what is strained with the box: directors are not
        self._centers = slice(packing.particles)
        self.coordinate_rd, self.box = self.program.coordinates_of(packing).copy(), packing.box
        self._velocity_nd, self._rate_dd = np.zeros_like(self.coordinate_rd), np.zeros((packing.dimension,) * 2)
        self._dt, self._mixing, self._downhill, self._mobility = _FIRE.dt, _FIRE.mixing, 0.0, 1.0
        # length that a unit strain counts as
        self._scale = float(np.sqrt(packing.particles) * packing.diameter_n.mean())
        self._farthest = _FIRE.largest_step * float(packing.diameter_n.min())
        self.steps = 0
        self._evaluate()

    @property
    def packing(self) -> Packing:
        """The packing as it is now."""
        return self.program.packing_at(self.coordinate_rd, self.box)

    def relaxation(self) -> StrainRelaxation:
        """Return what was arrived at."""
        return StrainRelaxation(self.packing, *self.errors, self.now.pressure, self.steps)

    def next_stop(self) -> int | Outcome:
        """Return the step at which the packing is due to be watched next, or how it ended."""
        if max(self.errors) <= self.tolerance:
            return Outcome.CONVERGED
        if self.steps >= self.step_limit:
            return Outcome.STEP_LIMIT
        if (
            self._sheared
            and np.abs(self.box.lattice_dd @ self._inverse_dd - np.eye(len(self._inverse_dd))).max() > _FLOWS
        ):
            return Outcome.STALLED
        return min(self.steps + _WATCHED - self.steps % _WATCHED, self.step_limit)

    def advance(self, steps: int) -> Outcome | None:
        """Take up to so many steps; return CONVERGED where forces and stress balance."""
        for _ in range(steps):
            self._step()
            if max(self.errors) <= self.tolerance:
                return Outcome.CONVERGED
        return None

    def observe(self) -> Outcome | None:
        """Pass the packing on to whoever watches."""
        if self.watch is not None and self.steps % _WATCHED == 0:
            self.watch(self.packing)
        return None

    def figures(self) -> None:
        """Return nothing: `watch` is called instead of the progress callback."""
        return None

    def _evaluate(self) -> None:
        self.now = self.program.evaluate(self.coordinate_rd, self.box.lattice_dd)
        self.errors = _errors(self.now, self.basis_kdd, self.pressure, self._load_dd)

    def _step(self) -> None:
        now, velocity, rate, centers = self.now, self._velocity_nd, self._rate_dd, self._centers
        if self.steps % 64 == 0:
            stiffness = now.force_floor / self.program.space.resolution
            self._mobility = 5.0 / stiffness if stiffness > 0.0 else self._mobility
        self.steps += 1
        strain_force = _stress_pull(now, self.basis_kdd, self.box.volume, self.pressure, self._load_dd) / self._scale
        power = float((now.force_nd * velocity).sum() + (strain_force * rate).sum())
        if power > 0.0:
            speed = float(np.sqrt((velocity**2).sum() + (rate**2).sum()))
            force = float(np.sqrt((now.force_nd**2).sum() + (strain_force**2).sum()))
            velocity = (1.0 - self._mixing) * velocity + self._mixing * speed / force * now.force_nd
            rate = (1.0 - self._mixing) * rate + self._mixing * speed / force * strain_force
        else:
            velocity, rate = np.zeros_like(velocity), np.zeros_like(rate)
        self._dt, self._mixing, self._downhill = steer(  # type: ignore[no-untyped-call]
            _FIRE, power <= 0.0, self._dt, self._mixing, self._downhill
        )
        dt = self._dt
        velocity = velocity + dt * self._mobility * now.force_nd
        rate = rate + dt * self._mobility * strain_force
        reach = dt * max(float(np.sqrt((velocity**2).sum(axis=1).max())), float(np.abs(rate).max()))
        if reach > self._farthest:
            velocity, rate = velocity * (self._farthest / reach), rate * (self._farthest / reach)
        strain = dt * rate / self._scale
        coordinate = self.coordinate_rd + dt * velocity
        coordinate[centers] += self.coordinate_rd[centers] @ strain.T
        box = self.box.strained(strain)
        if self.pressure is None:
            factor = (self.start.box.volume / box.volume) ** (1.0 / self.start.dimension)
            coordinate[centers] *= factor
            box = box.scaled(factor)
        if self.constraints is not None:
            moved = self.start.replace(position_nd=coordinate, box=box)
            self.constraints = self.constraints.at(self.constraints.projected(moved))
            coordinate = self.constraints.packing.position_nd.copy()
            velocity, _, _ = self.constraints.project(velocity)
        self.coordinate_rd, self.box, self._velocity_nd, self._rate_dd = coordinate, box, velocity, rate
        self._evaluate()


def _stress_pull(now: Evaluation, basis: Array, volume: float, pressure: float | None, load_dd: Array) -> Array:
    """Return minus the enthalpy's slope along the free strains, as a tensor in their span."""
    stress = now.stress_dd + (0.0 if pressure is None else pressure) * load_dd
    pull: Array = -volume * np.einsum("kab,kcd,cd->ab", basis, basis, stress)
    return pull


def _errors(now: Evaluation, basis: Array, pressure: float | None, load_dd: Array) -> tuple[float, float]:
    held = now.pressure if pressure is None else pressure
    missing = np.einsum("kab,ab->k", basis, now.stress_dd + held * load_dd)
    residual = now.residual if now.contacts else (0.0 if pressure is None else np.inf)
    return residual, float(np.abs(missing).max()) / held if held > 0.0 else 0.0
