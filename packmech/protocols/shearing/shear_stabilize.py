"""`shear_stabilize`: relax positions and every strain together, at the volume as it is or at a pressure."""

from __future__ import annotations

import time

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import instance, integer, positive
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.minimize.second_order.soft_newton import SoftState, judge, newton
from packmech.packing import Packing
from packmech.protocols.linked_jam import stabilize_linked
from packmech.protocols.protocol import Protocol, check_reachable, finish
from packmech.result import Outcome, Run
from packmech.scene import Scene

_FIRST_TOLERANCE = 1e-2
_TIGHTER = 0.03


@honors("repulsion kinds links shapes", at_rest=True)
def shear_stabilize(
    scene: Scene,
    *,
    pressure: float | None = None,
    force_tolerance: float = 1e-10,
    step_limit: int = 200_000,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Run:
    """Return the run that ends in a packing whose forces balance and whose stress is isotropic.

    FIRE with the box first, then Newton's method; both take the positions and all d(d+1)/2 strains as unknowns. With
    links or shapes: FIRE in the box as it is, then Newton's method that only goes down, pressure by pressure if one is
    asked for.

    Parameters
    ----------
    scene
        The scene; its packing must overlap somewhere if the volume is held.
    pressure
        Pressure to reach [energy_scale / diameter^d]; None holds the volume.
    force_tolerance
        Net force over mean contact force, and stress missing over pressure, to reach [1]; the floor of rounding also
        counts.
    step_limit
        Maximum number of FIRE steps.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures).
    check
        Raise NotConverged when the outcome is not a success.

    Returns
    -------
    Run
        `report` as for `jam`, without the figures of the hard packing.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.
    NotConverged
        If the packing does not come to rest and `check` is set.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    >>> run = pm.shear_stabilize(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)))
    >>> run.report["stress_anisotropy"] < 1e-9, round(run.report["packing_fraction"], 12)
    (True, 0.95)

    """
    instance("scene", scene, Scene)
    tolerance = positive("force_tolerance", force_tolerance)
    asked = None if pressure is None else positive("pressure", pressure)
    limit = integer("step_limit", step_limit, at_least=0)
    if asked is not None:
        check_reachable(scene, "pressure", asked)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    began = time.process_time()
    protocol = Protocol(scene, "free", tolerance, loop)
    stabilized = _stabilized if scene.packing.plain else stabilize_linked

    def work() -> Outcome:
        protocol.last, outcome = stabilized(protocol, asked, limit)
        return outcome

    def finished(outcome: Outcome) -> Run:
        return finish(protocol, protocol.last, outcome, asked, "shear_stabilize", began)

    with single_thread():
        return loop.run(work, finished)


def _stabilized(protocol: Protocol, pressure: float | None, step_limit: int) -> tuple[Packing, Outcome]:
    goal = None if pressure is None else protocol.reduced_pressure(pressure)
    packing, left, tolerance = protocol.scene.packing, step_limit, _FIRST_TOLERANCE
    best: SoftState | None = None
    with protocol.stage("shear stabilization") as figures:
        while True:
            done = protocol.relax_strained(packing, pressure, tolerance, left)
            figures.steps += done.steps
            figures.residual, figures.force_evaluations = done.residual, figures.steps
            packing = protocol.last = done.packing
            left -= done.steps
            if done.pressure <= 0.0:
                return packing, Outcome.UNJAMMED
            best = newton(protocol.reduced(packing), protocol.units, protocol.basis_kdd, goal, watch=protocol.in_time)
            if best.sound(protocol.force_tolerance) or left <= 0 or done.merit > tolerance:
                break
            tolerance *= _TIGHTER
            if tolerance < protocol.force_tolerance * 1e-2:
                break
        figures.residual = best.residual
        figures.note = "FIRE with the box, then Newton's method"
        protocol.last = protocol.restored(best.packing)
    return protocol.last, judge(best, protocol.force_tolerance)
