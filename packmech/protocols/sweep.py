"""`sweep_pressure`, `sweep_stress`: one jammed packing followed from pressure to pressure, or from stress to stress."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import BoxStrain, finite_array, instance, one_of, positive
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.stress import stress_tensor
from packmech.minimize.second_order.soft_network import Load
from packmech.packing import no_own_images
from packmech.protocols.pressure_path import PressurePath
from packmech.protocols.protocol import Protocol, check_jammed, check_reachable, follow_series, sequence
from packmech.result import Outcome, Run
from packmech.scene import Scene

# largest difference of the two halves of a stress, over its largest component
_SYMMETRIC = 1e-9


@honors("repulsion kinds links shapes", at_rest=True)
def sweep_pressure(
    scene: Scene,
    pressures: Iterable[float],
    *,
    strain: BoxStrain = "isotropic",
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> tuple[Run, ...]:
    """Return one run for each pressure: the jammed packing followed along its contact network, up or down.

    The packing goes from pressure to pressure in the order given, in steps that Newton's method can take; contacts
    close and open on the way. Where no step ends in a minimum, contacts rearrange: the way down in enthalpy leads to
    the next packing, and the report counts it. Up and down again is the same path as long as nothing rearranged.

    Parameters
    ----------
    scene
        The scene of a jammed packing: `scene.replace(packing=run.packing)` of a run of `jam`.
    pressures
        In the order in which they are visited [energy_scale / diameter^d], all positive.
    strain
        "isotropic": the box keeps its shape. "free": strains relax, so that the stress is isotropic, the default of
        `jam`: a packing of that is followed on its own way with "free".
    force_tolerance
        Net force over mean contact force (and stress missing over pressure) that counts as balance [1]; the floor of
        rounding also counts.
    time_limit
        Stop after so much CPU time in all, compiling aside [s]; the run in hand ends with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures).
    check
        Raise NotConverged when a packing does not come to rest.

    Returns
    -------
    tuple of Run
        `report` as for `jam`, and rearrangements (on the way from the pressure before), contacts_closed and
        contacts_opened (since the pressure before).

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If a packing does not come to rest and `check` is set.
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished, `.run` to the one in hand.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    >>> jammed = pm.jam(scene, pressure=1e-6, strain="isotropic")
    >>> runs = pm.sweep_pressure(scene.replace(packing=jammed.packing), [1e-5, 1e-4, 1e-6])
    >>> [round(run.report["pressure"], 9) for run in runs]
    [1e-05, 0.0001, 1e-06]

    """
    instance("scene", scene, Scene)
    no_own_images("scene.packing", scene.packing)
    goals = sequence("pressures", pressures, "pressure")
    check_reachable(scene, "pressures", max(goals))
    one_of("strain", strain, ("isotropic", "free"))
    tolerance = positive("force_tolerance", force_tolerance)
    check_jammed(scene)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    protocol = Protocol(scene, strain, tolerance, loop)
    return follow_series(protocol, goals, PressurePath(protocol).go, "sweep_pressure", pressures=True)


@honors("repulsion kinds links shapes", at_rest=True)
def sweep_stress(
    scene: Scene,
    stresses: ArrayLike,
    *,
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> tuple[Run, ...]:
    """Return one run for each stress: the jammed packing whose box deforms until its stress is the one asked for.

    The packing goes from its own stress to the first, and on in the order given, along straight lines in pressure and
    in stress over pressure, in steps that Newton's method can take; all strains of the box are free. Contacts close and
    open on the way, and where no step ends in a minimum they rearrange, as in `sweep_pressure`. A packing bears shear
    stress up to its yield stress only: beyond, the run does not converge.

    Parameters
    ----------
    scene
        The scene of a jammed packing.
    stresses
        (R, d, d) Cauchy stresses in the order in which they are visited, symmetric, tension positive as
        `stress_tensor` has them, each with a positive pressure [energy_scale / diameter^d].
    force_tolerance
        Net force over mean contact force, and largest missing stress over pressure, that count as balance [1]; the
        floor of rounding also counts.
    time_limit
        Stop after so much CPU time in all, compiling aside [s]; the run in hand ends with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures).
    check
        Raise NotConverged when a packing does not come to rest under the stress.

    Returns
    -------
    tuple of Run
        `report` as for `sweep_pressure`, and stress_asked, stress and stress_error, the largest missing component over
        the pressure.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If a packing does not come to rest and `check` is set.
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished, `.run` to the one in hand.

    Examples
    --------
    >>> import numpy as np
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    >>> jammed = pm.jam(scene, pressure=1e-3)
    >>> sheared = 1e-3 * np.array([[-1.0, 0.02], [0.02, -1.0]])
    >>> (run,) = pm.sweep_stress(scene.replace(packing=jammed.packing), [sheared])
    >>> run.report["stress_error"] < 1e-9
    True

    """
    instance("scene", scene, Scene)
    no_own_images("scene.packing", scene.packing)
    d = scene.packing.dimension
    goals = finite_array("stresses", stresses, shape=(None, d, d), what="stress")
    for k, one in enumerate(goals):
        if np.abs(one - one.T).max() > _SYMMETRIC * np.abs(one).max():
            raise ValueError(f"stresses[{k}] must be symmetric, got {one.tolist()}")
        if np.trace(one) >= 0.0:
            raise ValueError(f"stresses[{k}] must have a positive pressure -trace / {d}, got {one.tolist()}")
    tolerance = positive("force_tolerance", force_tolerance)
    check_jammed(scene)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    protocol = Protocol(scene, "free", tolerance, loop)
    path = PressurePath(protocol)

    def go(k: float) -> Outcome:
        for name in ("stress", "stress_error"):
            protocol.report.pop(name, None)
        asked = Load.of(goals[int(k)])
        outcome = path.go(asked.pressure, asked.rest_dd)
        stress = stress_tensor(scene.replace(packing=protocol.last)) / scene.pressure_unit
        error = float(np.abs(stress - goals[int(k)]).max()) / asked.pressure
        protocol.report.update(stress_asked=goals[int(k)], stress=stress, stress_error=error)
        return outcome

    return follow_series(protocol, np.arange(len(goals), dtype=float), go, "sweep_stress", pressures=False)
