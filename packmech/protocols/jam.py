"""`jam`: from a scene to the packing at a small pressure, by a protocol named by its method."""

from __future__ import annotations

import time
from dataclasses import replace

from packmech.calls.honors import declare
from packmech.calls.status import Progress
from packmech.check import BoxStrain, brief, clear_errors, instance, one_of, positive
from packmech.effects import friction_of, rolling_spring_of, twisting_of
from packmech.jit.blas import single_thread
from packmech.linalg.threads import factor_threads
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.protocols.decompression import Decompression, StepHalving
from packmech.protocols.hard_vertex import HardVertex
from packmech.protocols.method import JamMethod, held_columns
from packmech.protocols.press import Press
from packmech.protocols.program_chain import ProgramChain
from packmech.protocols.protocol import Protocol, check_reachable, is_jammed, report_start
from packmech.result import Outcome, Run
from packmech.scene import ROUGH_PRESSURE, Scene

# pressure at the end where none is given, without friction [energy_scale / diameter^d]
_PRESSURE = 1e-8
# methods that ship, and what they honor; one of a user's may honor more
_SHIPPED: tuple[type[JamMethod], ...] = (HardVertex, ProgramChain, Decompression, Press, StepHalving)
_HONORED = declare(
    "jam", "repulsion kinds friction rolling links shapes", at_rest=True
)  # fmt: skip
# where a method that does not know both strains works, in words
_WHERE = {"isotropic": "in a box of fixed shape", "free": "with free strains"}
# the first of these that suits a scene is taken where none is named
_DEFAULTS: tuple[JamMethod, ...] = (HardVertex(), Decompression(), Press())


def _check_suits(method: JamMethod, scene: Scene, strain: BoxStrain) -> None:
    """Refuse a method that does not know the strain, or not what the scene holds.

    Raises
    ------
    ValueError
        Naming the methods of packmech that do.

    """
    if method.suits(scene, strain):
        return
    always, sometimes = list[str](), list[str]()
    for one in _SHIPPED:
        known = [each for each in ("isotropic", "free") if one.suits(scene, each)]
        if len(known) == 2:
            always.append(one.__name__)
        elif known:
            sometimes.append(f"{one.__name__} {_WHERE[known[0]]}")
    *others, last = [*always, *sometimes]
    names = f"{', '.join(others)}, or {last}" if others else last
    held, where, way = held_columns(scene), "", ""
    springs = (find(scene.effects) for find in (friction_of, rolling_spring_of, twisting_of))
    rough = [type(one).__qualname__ for one in springs if one is not None]
    if rough:
        kinds = ", ".join(f"pm.{one}" for one in rough)
        where, way = " for a scene with friction", f": leave friction out with scene.without({kinds})"
    elif held:
        where = ", for a packing with links or shapes"
    raise ValueError(f"method must be {names}{where}, got {brief(method)}{way}")


@clear_errors
def jam(
    scene: Scene,
    pressure: float | None = None,
    *,
    strain: BoxStrain = "free",
    method: JamMethod | None = None,
    start: str = "continue",
    energy_tolerance: float | None = None,
    force_tolerance: float = 1e-5,
    threads: int = 1,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Run:
    """Return the run that ends in a jammed packing at the pressure asked for.

    A packing that is jammed already, its forces balanced under pressure, is followed in pressure from where it stands
    (`sweep_pressure`) and keeps its contact network as far as pressure lets it; one that is at rest at the pressure
    asked for stays as it is. Press and StepHalving begin where it stands. Any other, and where `method` gives the
    start, is scaled to the start of the protocol, whatever its packing fraction. Radii and links never change: clusters
    keep their shape, so that the volume of fused ones, their union, does too. Every figure is recomputed from the
    packing that is returned. Particles that stand so far away that rounding of their places exceeds 1e-11 of the
    smallest radius are wrapped into the cell first.

    Ellipses and spheroids end at rest in their turns, too: counts are those of all degrees of freedom, and in place of
    missing contacts there are `floppy_modes` of the stiffness (`quartic_modes`).

    A scene with friction is pressed in time (`Press`) from where it stands, and the packing that comes back holds the
    tangential displacements of its contacts.

    Parameters
    ----------
    scene
        The scene; its law decides about the soft packing only, not about the hard one it comes from.
    pressure
        Pressure at the end [energy_scale / diameter^d]; None: 1e-8, and 1e-3 with friction, which is pressed in time
        and takes hours to 1e-8. To be left out for StepHalving, which ends at an
        energy.
    strain
        "free": all strains relax, so that the stress is isotropic (shear-stabilized). "isotropic": the box keeps its
        shape, the default of `sweep_pressure`.
    method
        HardVertex() (the default), ProgramChain(), StepHalving(), Decompression() (the default with links or shapes,
        where only it, Press and StepHalving with a fixed box know the way), Press() (with friction the default, and the
        only one), or one of one's own (`JamMethod`); their parameters are those of the protocol.
    start
        "continue", or "fresh": a jammed packing is scaled to the start of the protocol, too. Where strains become free
        that bore a shear stress, packings with links or shapes are compressed again, and `report["start"]` is "fresh".
    energy_tolerance
        If given, StepHalving(energy_tolerance=...) instead: the energy per particle at the end [energy_scale].
    force_tolerance
        Largest net force over mean contact force that counts as balance [1].
    threads
        Number of threads; it changes no bit. Quenches and factorizations of large packings take them, and pressing in
        time: measured with two, discs at N = 4096 are ready 1.05 times as fast, spheres at N = 1024
        1.16 times. Ask for no more than there are idle processors; `time_limit` counts the time of all of them.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress(stage, figures) while the protocol works; figures holds "packing" where a stage has ended.
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    Run
        `stages` tells what each part achieved and cost. `report` holds: packing_fraction, jamming_packing_fraction (of
        the hard packing), pressure, pressure_asked (None for StepHalving) [energy_scale / diameter^d], particles,
        rattlers, contacts, isostatic_contacts, excess_contacts, states_of_self_stress, patches (arrays of particles
        held redundantly), stress (the whole tensor, Cauchy's with tension positive, of contacts found anew in the
        packing that is returned) [energy_scale / diameter^d], stress_anisotropy, rounding_floor (the residual that
        rounding of positions alone can cause), backbone_pressure (the part of the pressure between particles that do
        not rattle; below .99 the outcome is NOT_JAMMED; with links 0 or 1, whether there are such contacts), method,
        strain, start ("continued", "rearranged" or "fresh"), and, where a hard packing was found, hard_packing,
        hard_contacts, hard_excess_contacts, gap_error, force_imbalance, smallest_force. Where a hard packing was found,
        and of discs and spheres by StepHalving, both sides of the onset are held: packing_below_onset, the one nearby
        in which no particles overlap (they touch to rounding), and onset_between, its packing fraction and that of the
        packing that is returned, which presses. With links in two dimensions also crossing_links: pairs that cross are
        locked, press at any pressure and add states of self stress. Of a packing that is followed: rearrangements on
        the way (none where `start` is "continued"), contacts_closed and contacts_opened, and onset_rearrangements, on
        the way down to the hard packing; Press and StepHalving cannot count rearrangements and say "rearranged"
        wherever contacts changed. Links that do not cross at the start are kept from it, as in `quench`. Press reports
        counts with friction instead, as `ContactForces.to_dict` does, and rate, time [sqrt(m / k)], added_damping of
        contacts whose own dashpots are too weak (0: none) [mass/time] and kinetic_energy, over pressure times volume.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.
    NotConverged
        If the packing is not jammed or not balanced and `check` is set; its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.run` set to what was finished.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(16, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=3)
    >>> run = pm.jam(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)), pressure=1e-7, strain="isotropic")
    >>> run.report["states_of_self_stress"], run.residual < 1e-5
    (1, True)

    """
    instance("scene", scene, Scene)
    one_of("strain", strain, ("isotropic", "free"))
    one_of("start", start, ("continue", "fresh"))
    tolerance = positive("force_tolerance", force_tolerance)
    loop = RunLoop(run_settings(threads=threads, time_limit=time_limit, progress=progress, check=check))
    if energy_tolerance is not None:
        if method is not None:
            raise ValueError(f"energy_tolerance must be left out when method is given, got {brief(energy_tolerance)}")
        method = StepHalving(energy_tolerance=positive("energy_tolerance", energy_tolerance))
    if method is None:
        method = next((one for one in _DEFAULTS if one.suits(scene, strain)), _DEFAULTS[0])
    if not isinstance(method, JamMethod):
        *names, last = (one.__name__ for one in _SHIPPED)
        raise TypeError(f"method must be {', '.join(names)} or {last}, got {brief(method)}")
    honored = dict.fromkeys((*_HONORED.columns, *method.honors.get(strain, "").split()))
    replace(_HONORED, columns=tuple(honored)).check("scene", scene)
    _check_suits(method, scene, strain)
    usual = ROUGH_PRESSURE if held_columns(scene) & {"friction", "rolling"} else _PRESSURE
    name, goal = type(method).__name__, usual if pressure is None else positive("pressure", pressure)
    at_pressure = method.ends_at == "a pressure"
    if not at_pressure and pressure is not None:
        raise ValueError(f"pressure must be left out for {name}, which ends at {method.ends_at}, got {brief(pressure)}")
    check_reachable(scene, "pressure", goal)
    began = time.process_time()
    protocol = Protocol(scene, strain, tolerance, loop)

    def work() -> Outcome:
        protocol.continues = start == "continue" and not method.begins_afresh and is_jammed(scene)
        protocol.last, outcome = method.follow(protocol, goal)
        return outcome

    def finished(outcome: Outcome) -> Run:
        report_start(protocol)
        return method.finish(protocol, outcome, goal if at_pressure else None, began)

    with single_thread(), factor_threads(loop.settings.threads):
        return loop.run(work, finished)


__all__ = ["Decompression", "HardVertex", "JamMethod", "Press", "ProgramChain", "StepHalving"]
