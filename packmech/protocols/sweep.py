"""`sweep_pressure`: one jammed packing followed from pressure to pressure, up and down."""

from __future__ import annotations

from collections.abc import Iterable

from packmech.check import instance, one_of, positive
from packmech.honors import honors
from packmech.loop.run_loop import Progress, RunLoop, run_settings
from packmech.packing import no_own_images
from packmech.protocols.jam import free_strains, is_jammed
from packmech.protocols.pressure_path import PressurePath
from packmech.protocols.protocol import Protocol, follow_series, sequence
from packmech.result import Run
from packmech.scene import Scene


@honors("repulsion links", at_rest=True)
def sweep_pressure(
    scene: Scene,
    pressures: Iterable[float],
    *,
    strain: str = "isotropic",
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress | None = None,
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
        "isotropic": the box keeps its shape. "free": strains relax, so that the stress is isotropic.
    force_tolerance
        Net force over mean contact force (and stress missing over pressure) that counts as balance [1]; the floor of
        rounding also counts.
    time_limit
        Stop after so much CPU time in all [s]; the run in hand ends with Outcome.INTERRUPTED.
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
    one_of("strain", strain, ("isotropic", "free"))
    tolerance = positive("force_tolerance", force_tolerance)
    if not is_jammed(scene):
        raise ValueError(
            "scene.packing must be jammed, its forces balanced under pressure, got one that is not: jam it"
        )
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    protocol = Protocol(scene, free_strains(strain, scene.packing.dimension), strain, tolerance, loop)
    return follow_series(protocol, goals, PressurePath(protocol).go, "sweep_pressure", pressures=True)
