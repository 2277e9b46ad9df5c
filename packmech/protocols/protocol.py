"""What every jamming protocol works with, and the run that it ends with.

Compiled scene, reduced units, stages, relaxation in a given box; figures recomputed from the packing at the end.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.check import BoxStrain, instance, listed, positive, positive_array
from packmech.constraints.projection import scale_box
from packmech.contacts import Contacts
from packmech.contacts.pairs import pair_names
from packmech.contacts.rattlers import rattlers_of
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import law_first, law_of, refuse_unknown_to_shapes
from packmech.effects.kinds import reference_partners
from packmech.jit.blas import single_thread
from packmech.jit.compiled import compile_clock, compiling_noted
from packmech.linalg.mandel import mandel_basis, strain_directions
from packmech.loop.run_loop import RunLoop, TimeUp
from packmech.measure.contact_forces import ContactForces, resting_forces
from packmech.measure.counting import mean_contacts, packing_fraction
from packmech.measure.rattlers import find_rattling_clusters
from packmech.mechanics.network import contact_network
from packmech.mechanics.self_stress import states_of_self_stress
from packmech.minimize.bodies_apart import report_of_bodies
from packmech.minimize.first_order.fire import Fire
from packmech.minimize.first_order.strain_fire import StrainedFire, StrainRelaxation
from packmech.minimize.passes.kernels import Goal
from packmech.minimize.program import Minimization, Minimizer, Program, Relaxation, build_program
from packmech.minimize.quench import find_crossings, pairs_crossing
from packmech.minimize.second_order.soft_network import Load, SoftNetwork, Units, length_unit, scaled_load
from packmech.minimize.second_order.soft_newton import FLOORS, rounding_floor
from packmech.packing import Packing
from packmech.result import Condition, Outcome, Run, Stage, unmet_conditions
from packmech.scene import Scene

# what helps packings of chains and clusters that end unjammed
_OF_LINKED = "a start without deep overlaps (largest_overlap=0.2, packing_fraction=0.4) or a higher pressure may help"
# largest net force over mean contact force of a packing that a protocol goes on from
_BALANCED = 1e-3
# numbers times steps of a relaxation between two packings that an interrupt leaves, and steps where someone watches
_PORTION, _WATCHED = 5_000_000, 20
# rounding of positions, relative to the smallest radius, above which particles are wrapped into the cell first
_ROUNDING = 1e-11
# part of the pressure that the contacts of rattlers may bear in a jammed packing [1]
BORNE_BY_RATTLERS = 1e-2
# outcomes after which a series of runs does not go on
_LAST = (Outcome.NOT_JAMMED, Outcome.TIME_LIMIT)
# times the pressure at overlaps of half the contact distance, beyond which none is asked for [1]
_BEYOND = 1000.0
# overlap over the contact distance that rounding of positions makes [1]
_ROUNDED = 2.0**-51
T = TypeVar("T")
# relative error of the pressure below which it is the one asked for, whatever force balance is asked for [1]
PRESSED = 1e-6


def is_jammed(scene: Scene) -> bool:
    """Return whether forces press and are balanced, so that a protocol can go on from the packing as it stands."""
    found = resting_forces(scene)
    return found.mean_force > 0.0 and found.residual <= _BALANCED and found.pressure > 0.0


def check_jammed(scene: Scene) -> None:
    """Refuse a scene whose packing cannot be followed because it is not jammed.

    Raises
    ------
    ValueError
        If its forces do not press or are not balanced.

    """
    if not is_jammed(scene):
        raise ValueError(
            "scene.packing must be jammed, its forces balanced under pressure, got one that is not: jam it"
        )


class Figures:
    """What a stage achieved, filled in while it runs."""

    def __init__(self) -> None:
        self.residual, self.steps, self.force_evaluations, self.note = float("nan"), 0, 0, ""

    def take(self, done: Relaxation) -> None:
        """Take over what FIRE achieved and cost."""
        self.residual, self.steps, self.force_evaluations = done.residual, done.steps, done.force_evaluations


class Protocol:
    """One jamming run on its way: stages so far, last finished packing, and the tools of the methods.

    Parameters
    ----------
    scene
        The scene.
    strain
        What the box may do.
    force_tolerance
        Net force over mean contact force that counts as balance [1].
    loop
        The run loop of the call.

    """

    def __init__(self, scene: Scene, strain: BoxStrain, force_tolerance: float, loop: RunLoop) -> None:
        refuse_unknown_to_shapes(scene, single=False)
        # far from the cell rounding of positions is larger than the gaps that decide about contacts
        if scene.packing.rounding > _ROUNDING:
            scene = scene.replace(packing=scene.packing.wrapped())
        self.scene, self.strain, self.force_tolerance, self.loop = scene, strain, force_tolerance, loop
        # the (k, d, d) free strains
        d = scene.packing.dimension
        self.basis_kdd = np.einsum("sk,sab->kab", strain_directions(d, strain), mandel_basis(d))
        self.stages: list[Stage] = []
        self.last = scene.packing
        self.report: dict[str, Any] = {}
        # whether the scene's packing is jammed, and followed from where it stands
        self.continues = False
        self.length = length_unit(scene.packing)
        self.units = Units(scene.effects, self.length, scene.energy_scale)
        self._program: Program | None = None
        self.build_seconds = 0.0

    @property
    def program(self) -> Program:
        """The compiled scene."""
        if self._program is None:
            began = time.process_time()
            self._program = build_program(self.scene, threads=self.loop.settings.threads)
            self.build_seconds = time.process_time() - began
        return self._program

    def watcher(self, stage: str, *, reduced: bool) -> Callable[[Packing], None] | None:
        """Return what reports packings of a stage, in reduced lengths or not, and ends at the time limit; or None."""
        watched = self.loop.watched
        if not watched and np.isinf(self.loop.settings.time_limit):
            return None

        def watch(packing: Packing) -> None:
            if watched:
                self.loop.report(stage, packing=self.restored(packing) if reduced else packing)
            self.loop.check_time()

        return watch

    def in_time(self, packing: Packing) -> None:
        """End the protocol where time is up: what loops call with the packing after each iteration."""
        self.loop.check_time()

    @contextmanager
    def stage(self, name: str) -> Iterator[Figures]:
        """Time one part of the protocol and keep what it achieved."""
        self.loop.check_time()
        figures = Figures()
        began = time.process_time()
        self.loop.report(name)
        compiling = 0.0
        try:
            with compile_clock() as clock:
                yield figures
                compiling = clock()
        except (KeyboardInterrupt, TimeUp) as stop:
            figures.note = figures.note or ("time limit" if isinstance(stop, TimeUp) else "interrupted")
            raise
        finally:
            seconds = time.process_time() - began
            note = compiling_noted(figures.note, compiling, seconds)
            done = Stage(name, figures.residual, figures.steps, figures.force_evaluations, seconds, note)
            self.stages.append(done)
            self.loop.report(
                name, packing=self.last, residual=done.residual, steps=done.steps, seconds=seconds, note=done.note
            )

    def reduced_pressure(self, pressure: float) -> float:
        """Return a pressure given in the scene's unit [energy_scale / reference diameter^d] in reduced units."""
        return pressure * (self.length / self.scene.packing.reference_diameter) ** self.scene.packing.dimension

    def reduced(self, packing: Packing) -> Packing:
        """Return the packing in reduced lengths."""
        return self.units.reduced(packing)

    def restored(self, packing: Packing) -> Packing:
        """Return a packing of reduced lengths in the scene's own, with the scene's radii exactly."""
        return self.units.restored(packing, self.scene.packing)

    def start_fraction(self, given: float | None, usual: dict[int, float]) -> float:
        """Return the packing fraction to start at: the one given, the packing's own if it is followed, or the usual."""
        if given is not None:
            return given
        packing = self.scene.packing
        return packing_fraction(packing) if self.continues else usual[packing.dimension]

    def relax(
        self,
        packing: Packing,
        force_tolerance: float,
        step_limit: int,
        floor: float = 0.0,
        method: Minimizer | None = None,
    ) -> tuple[Packing, Relaxation]:
        """Return the packing that a minimizer relaxes to in the box as it is, and how that went.

        Parameters
        ----------
        packing
            Where to start.
        force_tolerance, step_limit
            When to stop.
        floor
            Mean contact force at which the packing counts as unjammed [energy_scale / reference diameter].
        method
            Fire() unless given.

        """
        self.loop.check_time()
        program = self.program
        goal = Goal(force_tolerance, floor * self.scene.energy_scale / packing.reference_diameter)
        program.put(packing)

        def keep(steps: int) -> None:
            if steps:
                self.last = program.packing()

        stop_every = max(1, _PORTION // packing.particles)
        task = Minimization(
            program,
            Fire() if method is None else method,
            goal,
            step_limit,
            stop_every=min(stop_every, _WATCHED) if self.loop.watched else stop_every,
            keep=keep,
            describe=lambda steps: ("relaxation", {"steps": steps, "packing": self.last}),
        )
        done = task.relaxation(self.loop.advance(task))
        self.last = done.packing
        if done.outcome is Outcome.TIME_LIMIT:
            raise TimeUp
        return self.last, done

    def relax_strained(
        self,
        packing: Packing,
        pressure: float | Load | None,
        tolerance: float,
        step_limit: int,
        watch: Callable[[Packing], None] | None = None,
    ) -> StrainRelaxation:
        """Return the packing that FIRE relaxes to in positions and free strains.

        Parameters
        ----------
        packing
            Where to start.
        pressure
            Pressure to hold [energy_scale / reference diameter^d], or a load; None to hold the volume.
        tolerance, step_limit
            When to stop.
        watch
            Called with the packing every few steps.

        """
        self.loop.check_time()
        task = StrainedFire(
            self.program,
            packing,
            self.basis_kdd,
            scaled_load(pressure, self.scene.pressure_unit),
            tolerance=tolerance,
            step_limit=step_limit,
            watch=watch,
        )
        if self.loop.advance(task) is Outcome.TIME_LIMIT:
            self.last = task.packing
            raise TimeUp
        return task.relaxation()


@honors("links shapes", packing_only=True)
def at_packing_fraction(packing: Packing, value: float) -> Packing:
    """Return the packing with its box, and the centers of particles or linked clusters, scaled to a packing fraction.

    Radii stay, and clusters keep their shape: they are unwrapped, moved as a whole, and one that winds around the box
    is put back onto its links.

    Parameters
    ----------
    packing
        The packing.
    value
        Packing fraction, as `packing_fraction` measures it [1].

    Raises
    ------
    TypeError, ValueError
        If it is no packing, or the value is not positive.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.at_packing_fraction(pm.lattice_packing("square", repeats=(3, 3)), 0.5)
    >>> round(pm.packing_fraction(packing), 12), float(packing.radius_n[0])
    (0.5, 0.5)

    """
    instance("packing", packing, Packing)
    fraction = positive("value", value)
    return scale_box(packing, (packing_fraction(packing) / fraction) ** (1.0 / packing.dimension))


def contact_count(contacts: Contacts | ShapeContacts, rattling_n: NDArray[np.bool_], strains: int) -> dict[str, Any]:
    """Return N', rattlers, contacts between the N', and the isostatic number d N' - d + k for k free strains."""
    kept = int((~rattling_n).sum())
    number = len(contacts.among(~rattling_n))
    isostatic = contacts.dimension * (kept - 1) + strains if kept else 0
    return {
        "particles": contacts.particles,
        "rattlers": contacts.particles - kept,
        "contacts": number,
        "isostatic_contacts": isostatic,
        "excess_contacts": number - isostatic,
    }


def linked_count(packing: Packing, contacts: Any, strain: BoxStrain) -> dict[str, Any]:
    """Return rattling particles, contacts of the backbone, and their counts.

    The isostatic number is that of one state of self stress, N_dof - d + 1, where N_dof leaves out clusters that rattle
    as a whole; free turns and ends of clusters that are held, `floppy_modes`, take as many contacts off. Where no
    solver can tell which clusters rattle, counts are None and `counts_unknown` says why.

    Parameters
    ----------
    packing
        The packing, with links.
    contacts
        Its touching pairs.
    strain
        "isotropic" or "free".

    """
    try:
        rattling = find_rattling_clusters(packing, contacts=contacts)
    except np.linalg.LinAlgError as error:
        # a run that took minutes does not end with its counts
        unknown = dict.fromkeys(("rattlers", "contacts", "isostatic_contacts", "excess_contacts"))
        return {"particles": packing.particles, **unknown, "states_of_self_stress": None, "counts_unknown": str(error)}
    none = {"particles": packing.particles, "rattlers": int(rattling.rattling_n.sum())}
    if rattling.empty:
        return {**none, "contacts": 0, "isostatic_contacts": 0, "excess_contacts": 0, "states_of_self_stress": 0}
    held = ~rattling.rattling_cluster_n
    part = packing.select(held)
    # a contact can bear a force of a cluster that all of it may move against, such as one between links that cross
    inner = contacts.select(rattling.backbone_c).among(held)
    inner = inner.numbered(np.where(held, np.cumsum(held) - 1, -1), part)
    states = states_of_self_stress(
        part, "none" if strain == "isotropic" else "isochoric", contacts=inner, basis_limit=1.0
    )
    floppy = states.motions - states.trivial - states.rank
    isostatic = states.isostatic_contact_count - floppy
    return {
        **none,
        "contacts": len(inner),
        "isostatic_contacts": isostatic,
        "excess_contacts": len(inner) - isostatic,
        "floppy_modes": floppy,
        "states_of_self_stress": states.count,
    }


def locked_links(packing: Packing) -> dict[str, Any]:
    """Return the pairs of links that cross, in two dimensions: they are locked, and press whatever the pressure is."""
    if not packing.links or packing.dimension != 2:
        return {}
    crossings = find_crossings(packing)
    return {"crossing_links": None if crossings is None else pairs_crossing(crossings)}


def finish(
    protocol: Protocol, packing: Packing, outcome: Outcome, asked: float | None, method: str, began: float
) -> Run:
    """Return the run of a protocol that ended with the packing.

    Parameters
    ----------
    protocol
        The protocol.
    packing, outcome
        The packing it ended with, and how.
    asked
        The pressure asked for [energy_scale / diameter^d]; None where none was.
    method
        Its name.
    began
        CPU time of the start [s].

    """
    found = resting_forces(protocol.scene.replace(packing=packing))
    contacts, plain = found.contacts, packing.plain
    loose_n = rattlers_of(contacts)
    loose_c = loose_n[contacts.i_c] | loose_n[contacts.j_c]
    if packing.links:
        counts = linked_count(packing, contacts, protocol.strain)
        # contacts of clusters that rattle as a whole bear no pressure, but where they are with own images
        share = None if counts["contacts"] is None else float(counts["contacts"] > 0)
    else:
        counts = contact_count(contacts, loose_n, len(protocol.basis_kdd))
        counts |= {} if plain else shaped_count(packing, protocol.strain)
        share = share_of(found.virial_c, ~loose_c)
    report = report_of(protocol, found, {**counts, "patches": (), **locked_links(packing)}, asked, method)
    # forces that are no more than rounding have no balance
    residual = found.residual if outcome is not Outcome.UNJAMMED else 0.0
    if plain:
        free = report.get("floppy_modes", 0)
        report["states_of_self_stress"] = report["excess_contacts"] + 1 + free if report["contacts"] else 0
    if report.get("contacts") is not None:
        report["coordination_number"] = mean_contacts(report["contacts"], report["rattlers"], packing.particles)
    outcome = judged(protocol, packing, outcome, residual, report, share)
    # a particle that its contacts do not hold must bear no force, but for what is not balanced
    allowed = max(protocol.force_tolerance, 10.0 * residual) * found.mean_force
    pressed = plain and float(np.abs(found.normal_c[loose_c]).max(initial=0.0)) > allowed
    if pressed and outcome.ok and outcome is not Outcome.UNJAMMED:
        outcome = Outcome.UNSTABLE
    _add_onset(report, outcome)
    return run_of(protocol, packing, outcome, residual, report, began)


def _add_onset(report: dict[str, Any], outcome: Outcome) -> None:
    """Report both sides of the onset of jamming where they are sides of one packing, else neither."""
    apart = report.pop("packing_below_onset", None)
    same = outcome.ok and outcome is not Outcome.UNJAMMED and not report.get("onset_rearrangements")
    if apart is None or not same:
        return
    low, high = packing_fraction(apart), report["packing_fraction"]
    if low < high:
        report |= {"packing_below_onset": apart, "onset_between": (low, high)}


def report_of(
    protocol: Protocol, found: ContactForces, counts: dict[str, Any], asked: float | None, method: str
) -> dict[str, Any]:
    """Return what is reported of the packing that a protocol ended with, its counts among it."""
    packing, pressure = found.scene.packing, found.pressure
    rest = found.stress_dd + pressure * np.eye(packing.dimension)
    return {
        "method": method,
        "strain": protocol.strain,
        "packing_fraction": packing_fraction(packing),
        "pressure": pressure / found.scene.pressure_unit,
        "pressure_asked": asked,
        **counts,
        "stress": found.stress_dd / found.scene.pressure_unit,
        "stress_anisotropy": float(np.abs(rest).max() / abs(pressure)) if pressure else 0.0,
        **protocol.report,
    }


def share_of(virial_c: NDArray[np.float64], kept_c: NDArray[np.bool_]) -> float:
    """Return the part of the pressure that the kept contacts bear [1]; 0 where none does."""
    whole = float(virial_c.sum())
    return float(virial_c[kept_c].sum()) / whole if whole else 0.0


def judged(
    protocol: Protocol, packing: Packing, outcome: Outcome, residual: float, report: dict[str, Any], share: float | None
) -> Outcome:
    """Return how a run ended, by the packing that is returned; what a protocol calls a success must hold for it.

    Reported are `rounding_floor`, the residual that rounding of positions alone can cause [1], and
    `backbone_pressure`, the part of the pressure between particles that do not rattle [1].

    Parameters
    ----------
    protocol
        The protocol.
    packing, outcome, residual
        The packing, how the protocol found it, and its largest net force over the mean contact force.
    report
        Its figures, among them the pressure and the one asked for.
    share
        The part of the pressure between particles that do not rattle; None where it is not known.

    """
    floor = 0.0
    if outcome is not Outcome.UNJAMMED and report["pressure"]:
        floor = rounding_floor(SoftNetwork(protocol.reduced(packing), protocol.units, protocol.basis_kdd[:0], None))
        report["rounding_floor"] = floor
        if share is not None:
            report["backbone_pressure"] = share
    if outcome not in (Outcome.CONVERGED, Outcome.ROUNDING_FLOOR):
        return outcome
    if share is not None and share < 1.0 - BORNE_BY_RATTLERS:
        # a contact that bears less than rounding makes of it may be lost, and what it held seems to rattle
        return Outcome.STALLED if FLOORS * floor > BORNE_BY_RATTLERS else Outcome.NOT_JAMMED
    asked, tolerance = report["pressure_asked"], protocol.force_tolerance
    least = max(tolerance, FLOORS * floor)
    if residual > least or (asked is not None and abs(report["pressure"] / asked - 1.0) > max(least, PRESSED)):
        return Outcome.STALLED
    return Outcome.ROUNDING_FLOOR if residual > tolerance else outcome


def shaped_count(packing: Packing, strain: BoxStrain) -> dict[str, Any]:
    """Return the counts of a packing with shapes, its turns among the degrees of freedom.

    Contacts and rattlers as they are in balance, the isostatic number of one state of self stress, and from the rank of
    the contacts' slopes the states of self stress and the floppy modes of the stiffness: of ellipses those are quartic.

    Parameters
    ----------
    packing
        The packing, at rest.
    strain
        "isotropic" or "free".

    """
    network = contact_network(packing, second=False)
    none = {"particles": packing.particles, "rattlers": packing.particles - len(network.index_n)}
    none |= report_of_bodies(packing)
    if not len(network.contacts):
        return {**none, "contacts": 0, "isostatic_contacts": 0, "excess_contacts": 0, "states_of_self_stress": 0}
    states = states_of_self_stress(
        network.packing, "none" if strain == "isotropic" else "isochoric", contacts=network.contacts, basis_limit=1.0
    )
    isostatic = states.isostatic_contact_count
    return {
        **none,
        "contacts": states.contacts,
        "isostatic_contacts": isostatic,
        "excess_contacts": states.contacts - isostatic,
        "floppy_modes": states.motions - states.trivial - states.rank,
        "states_of_self_stress": states.count,
        "rank_certain": states.certain,
    }


def run_of(
    protocol: Protocol,
    packing: Packing,
    outcome: Outcome,
    residual: float,
    report: dict[str, Any],
    began: float,
    tolerance: float | None = None,
) -> Run:
    """Return the run, with the conditions that it does not meet; the protocol's force tolerance unless given."""
    asked, tolerance = report["pressure_asked"], protocol.force_tolerance if tolerance is None else tolerance
    conditions = [Condition("force residual", residual, tolerance)]
    if asked is not None:
        conditions.append(Condition("pressure", report["pressure"], asked, max(tolerance, PRESSED)))
    if "backbone_pressure" in report:
        borne = 1.0 - report["backbone_pressure"]
        hint = _OF_LINKED if len(packing.links) else ""
        conditions.append(Condition("part of the pressure that rattlers bear", borne, BORNE_BY_RATTLERS, hint=hint))
    if report.get("negative_modes") is not None:
        conditions.append(Condition("unstable directions", report["negative_modes"], 0))
    if "distance" in report:
        # without an onset, which is found first, the distance to it is not known
        above = report["packing_fraction"] - report.get("onset", float("nan"))
        conditions.append(Condition("packing fraction above the onset", above, report["distance"], PRESSED))
    return Run(
        packing=packing,
        outcome=outcome,
        residual=residual,
        steps=sum(stage.steps for stage in protocol.stages),
        force_evaluations=sum(stage.force_evaluations for stage in protocol.stages),
        seconds=time.process_time() - began,
        build_seconds=protocol.build_seconds,
        stages=tuple(protocol.stages),
        report=report,
        unmet=unmet_conditions(outcome, *conditions),
    )


def sequence(name: str, values: Iterable[float], what: str) -> NDArray[np.float64]:
    """Return the positive numbers that a series of runs goes through, checked; `what` one of them is, for messages."""
    return positive_array(name, listed(name, values, "positive numbers"), shape=(None,), what=what)


# what a packing that is followed reports of the way
CHANGES = ("rearrangements", "contacts_closed", "contacts_opened")


def report_changes(protocol: Protocol, rearrangements: int, pairs: set[tuple[int, ...]]) -> set[tuple[int, ...]]:
    """Report which contacts closed and opened since there were these pairs; return those of the packing now."""
    protocol.report.update(rearrangements=rearrangements, **contacts_changed(pairs, protocol.last))
    return set(pair_names(touching_pairs(protocol.last)))


def contacts_changed(pairs: set[tuple[int, ...]], packing: Packing) -> dict[str, int]:
    """Return how many contacts of a packing closed and opened since there were these pairs."""
    now = set(pair_names(touching_pairs(packing)))
    return {"contacts_closed": len(now - pairs), "contacts_opened": len(pairs - now)}


def report_start(protocol: Protocol) -> None:
    """Report whether the packing was followed from where it stood, and whether its contacts rearranged on the way.

    Where no rearrangements were counted, contacts that changed are taken for one.
    """
    report = protocol.report
    if not protocol.continues:
        report["start"] = "fresh"
        return
    if "contacts_closed" not in report:
        report.update(contacts_changed(set(pair_names(touching_pairs(protocol.scene.packing))), protocol.last))
    same = not report.get("rearrangements", report["contacts_closed"] + report["contacts_opened"])
    report["start"] = "continued" if same else "rearranged"


def in_turn(
    goals: Iterable[T], run: Callable[[T], Run], after: Callable[[T, Run], None] | None = None
) -> tuple[Run, ...]:
    """Return one run for each goal; one that finds nothing jammed, or is stopped, is the last.

    Parameters
    ----------
    goals
        One after the other.
    run
        Returns the run of a goal.
    after
        Called with every goal and run but the last of such an end, once that run is kept.

    Raises
    ------
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished.

    """
    runs = list[Run]()
    try:
        for goal in goals:
            runs.append(run(goal))
            if runs[-1].outcome in _LAST:
                break
            if after is not None:
                after(goal, runs[-1])
    except KeyboardInterrupt as stop:
        stop.runs = tuple(runs)  # type: ignore[attr-defined]
        raise
    return tuple(runs)


def follow_series(
    protocol: Protocol, goals: NDArray[np.float64], go: Callable[[float], Outcome], method: str, *, pressures: bool
) -> tuple[Run, ...]:
    """Return one run for each goal, of a packing that goes from one to the next.

    Parameters
    ----------
    protocol
        The protocol; its `last` packing is what a run ends with.
    goals
        (R,) what they go to, in this order; a run that finds nothing jammed, or is stopped, is the last.
    go
        Goes on to a goal, reports `report_changes`, and returns how that ended.
    method
        Name of the call.
    pressures
        Whether the goals are pressures [energy_scale / diameter^d].

    Raises
    ------
    KeyboardInterrupt
        Passed on with `.runs` set to the runs that were finished, `.run` to the one in hand.

    """

    def run(goal: float) -> Run:
        began, protocol.stages = time.process_time(), []
        # what is not reached is not in the report
        for name in CHANGES:
            protocol.report.pop(name, None)
        asked = goal if pressures else None
        return protocol.loop.run(
            lambda: go(goal),
            lambda outcome: finish(protocol, protocol.last, outcome, asked, method, began),
        )

    with single_thread():
        return in_turn(goals.tolist(), run)


def check_reachable(scene: Scene, name: str, pressure: float) -> None:
    """Refuse a pressure at which no end is ever reached.

    Particles would lie on each other by the dozen, or overlap by less than the rounding of their positions.
    """
    law = law_of(scene.effects)
    if law is None:
        return
    sigma, d = scene.packing.reference_diameter, scene.packing.dimension
    # 2 d contacts of half the contact distance each, as many particles as the volume holds then
    pairs = reference_partners(scene.effects, scene.packing)
    least = min(-float(law_first(law, (1.0 - _ROUNDED) * sigma, pair)) for pair in pairs)
    if 0.0 < pressure < 0.5 * least * sigma / scene.energy_scale:
        raise ValueError(
            f"{name} must be at least {0.5 * least * sigma / scene.energy_scale:.3g} under {law}, got {pressure:g}: "
            "such overlaps are lost in the rounding of positions"
        )
    push = max(-float(law_first(law, 0.5 * sigma, pair)) for pair in pairs)
    half = push * 0.5 * sigma * 2.0**d / scene.energy_scale
    if 0.0 < _BEYOND * half < pressure:
        raise ValueError(
            f"{name} must be at most {_BEYOND * half:.3g} under {law}, {_BEYOND:g} times what overlaps of half the "
            f"contact distance bear, got {pressure:g}: such particles lie on each other, and no law of contacts holds"
        )
