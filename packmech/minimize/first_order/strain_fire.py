"""FIRE with the box: positions and strains relax together, at constant pressure or constant volume.

The slow but sure way to shear-stabilized packings: it crosses instabilities that stop Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.minimize.first_order.fire import Fire
from packmech.minimize.passes.kernels import CONVERGED, NOT_FINITE, Goal, Virial
from packmech.minimize.passes.strains import NUMBERS, PRESSURE, RESIDUAL, STRESS_ERROR, FreeStrains
from packmech.minimize.program import Program
from packmech.minimize.second_order.soft_network import Load, isochoric_part
from packmech.packing import Packing
from packmech.result import Outcome

# strains make steps uphill costlier than they are for particles alone
_FIRE = Fire(dt_max=0.5, shrink=0.5)
# strain under a load that shears, above which a packing is taken to flow without end
_FLOWS = 1.0
# steps between two calls of `watch`, and between two looks at the clock where nobody watches
_WATCHED, _UNWATCHED = 20, 200
_ENDED = {CONVERGED: Outcome.CONVERGED, NOT_FINITE: Outcome.STALLED}


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
        self.program, self.step_limit, self.watch = program, step_limit, watch
        d = packing.dimension
        load = Load(pressure or 0.0, np.zeros((d, d))) if not isinstance(pressure, Load) else pressure
        self._sheared, self._inverse_dd = bool(load.rest_dd.any()), packing.box.inverse_dd
        basis = isochoric_part(basis_kdd, d) if pressure is None else basis_kdd
        in_space, load_dd = np.zeros((len(basis), 3, 3)), np.zeros((3, 3))
        in_space[:, :d, :d], load_dd[:d, :d] = basis, np.eye(d) + load.rest_dd
        self._strains = FreeStrains(
            basis_kdd=in_space,
            load_dd=load_dd,
            pressure=load.pressure,
            volume=packing.box.volume if pressure is None else 0.0,
            scale=float(np.sqrt(packing.particles) * packing.diameter_n.mean()),
            since_dd=np.eye(3),
            rate_dd=np.zeros((3, 3)),
            pull_dd=np.zeros((3, 3)),
            number_k=np.zeros(NUMBERS),
            virial=Virial(np.zeros((3, 3))),
            stiffness_n=np.zeros(len(program.row)),
        )
        program.put(packing)
        # no particle moves farther than a part of the smallest diameter
        smallest = float(packing.diameter_n.min()) / program.step_unit
        self._method = _FIRE._replace(largest_step=_FIRE.largest_step * smallest)
        self._goal, self._progress = Goal(tolerance, 0.0), self._method.start(program)
        self._status = 0
        self.advance(0)

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self._progress.steps

    @property
    def packing(self) -> Packing:
        """The packing as it is now."""
        return self.program.packing()

    def relaxation(self) -> StrainRelaxation:
        """Return what was arrived at."""
        number = self._strains.number_k
        return StrainRelaxation(
            self.packing, float(number[RESIDUAL]), float(number[STRESS_ERROR]), float(number[PRESSURE]), self.steps
        )

    def next_stop(self) -> int | Outcome:
        """Return the step at which the packing is due to be watched next, or how it ended."""
        if self._status in _ENDED:
            return _ENDED[self._status]
        if self.steps >= self.step_limit:
            return Outcome.STEP_LIMIT
        flow = self.program.box.lattice_dd @ self._inverse_dd - np.eye(len(self._inverse_dd))
        if self._sheared and np.abs(flow).max() > _FLOWS:
            return Outcome.STALLED
        portion = _UNWATCHED if self.watch is None else _WATCHED
        return min(self.steps + portion - self.steps % portion, self.step_limit)

    def advance(self, steps: int) -> Outcome | None:
        """Take up to so many steps; return CONVERGED where forces and stress balance."""
        self._status = self._method.advance_strained(self.program, self._strains, self._goal, self._progress, steps)
        self.program.keep_strained()
        return _ENDED.get(self._status)

    def observe(self) -> Outcome | None:
        """Pass the packing on to whoever watches."""
        if self.watch is not None and self.steps % _WATCHED == 0:
            self.watch(self.packing)
        return None

    def figures(self) -> None:
        """Return nothing: `watch` is called instead of the progress callback."""
        return None
