"""The path of steepest descent, integrated to a tolerance: which minimum a start belongs to."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.integrate import BDF, Radau

from packmech.check import one_of, real
from packmech.jit.blas import single_thread
from packmech.mechanics.hessian import hessian
from packmech.minimize.kernels import NOT_FINITE, RUNNING, STALLED, Goal
from packmech.minimize.program import Program, Progress

# places in Progress.number
_STEP, _EVALUATIONS, _NUMBERS = range(3)
_SOLVERS: dict[str, Any] = {"BDF": BDF, "Radau": Radau}


class SteepestDescent(NamedTuple):
    """The path dx/dt = F, overdamped motion against a background, by an adaptive method for stiff equations.

    Each starting point belongs to one minimum, the one that this path leads to; minimizers that take larger steps end
    in others. Slow (about a millisecond a step at N = 64) and meant as the reference. For discs and spheres without
    links.

    Parameters
    ----------
    tolerance
        Relative and absolute error of a step, displacements from the start in reference diameters [1].
    solver
        "BDF", backward differentiation formulas of orders 1 to 5, or "Radau", the implicit Runge-Kutta method of order
        5, both scipy's with the exact Hessian as a sparse Jacobian, so that soft modes cost no more than stiff ones.

    """

    tolerance: float = 1e-8
    solver: str = "BDF"

    def check(self) -> None:
        """Check every setting; the error names the first that is wrong."""
        real("method.tolerance", self.tolerance, above=1e-13, below=1.0)
        one_of("method.solver", self.solver, tuple(_SOLVERS))

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        self.check()
        if not program.scene.packing.plain:
            raise ValueError(
                "method must not be SteepestDescent for a packing with links or shapes, whose constraints or turns it "
                "does not follow: use GradientDescent(step=...) with a small step"
            )
        return program.progress(_NUMBERS, 0)._replace(path=_Path(self, program))

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        path = progress.path
        with single_thread():
            for _ in range(steps):
                status = path.judge(goal, progress)
                if status != RUNNING:
                    return int(status)
                if not path.step():
                    return NOT_FINITE if not np.isfinite(path.solver.y).all() else STALLED
                progress.number[_STEP] += 1.0
            return int(path.judge(goal, progress))


class _Path:
    """One path on its way: the solver of the differential equation in units of reference diameter and force."""

    def __init__(self, method: SteepestDescent, program: Program) -> None:
        self.program = program
        packing = program.scene.packing
        self.start_nd = program.coordinates()
        self.length = packing.reference_diameter
        # F in units of energy_scale / length moves one length in a unit of time
        self.force = program.scene.energy_scale / self.length
        self.evaluations = 0
        self.solver: Any = _SOLVERS[method.solver](
            self._rate,
            0.0,
            np.zeros(self.start_nd.size),
            np.inf,
            rtol=method.tolerance,
            atol=method.tolerance,
            jac=self._slope,
        )

    def judge(self, goal: Goal, progress: Progress) -> int:
        """Return how the present place stands to the goal."""
        self.program.place(self._place(self.solver.y))
        status, _ = self.program.judge(goal)
        progress.number[_EVALUATIONS] = self.evaluations = self.evaluations + 1
        return status

    def step(self) -> bool:
        """Take a step; return whether it could be taken."""
        self.solver.step()
        return self.solver.status == "running"

    def _place(self, moved_x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.start_nd + self.length * moved_x.reshape(self.start_nd.shape))

    def _rate(self, time: float, moved_x: NDArray[np.float64]) -> NDArray[np.float64]:
        self.evaluations += 1
        return np.asarray(self.program.evaluate(self._place(moved_x)).force_nd.ravel() / self.force)

    def _slope(self, time: float, moved_x: NDArray[np.float64]) -> sp.csc_matrix:
        scene = self.program.scene
        here = scene.replace(packing=scene.packing.replace(position_nd=self._place(moved_x), box=self.program.box))
        # scipy's solver knows sparse matrices only
        return sp.csc_matrix(hessian(here, "none") * (-self.length / self.force))
