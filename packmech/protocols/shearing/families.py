"""`shear_families`: packing fraction at jamming against shear strain, along families of one contact network each."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import check_memory, instance, listed, positive, real, two_axes
from packmech.contacts.network import find_contacts, pair_contacts
from packmech.contacts.overlaps import overlap_of_hard
from packmech.contacts.pairs import are_among
from packmech.contacts.rattlers import rattlers_of
from packmech.effects import Harmonic, Repulsion
from packmech.jamming.hard_packing import HardPacking, HardState, certify, search_hard, start_state
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import pressure as pressure_of
from packmech.minimize.second_order.soft_network import length_unit
from packmech.minimize.second_order.soft_newton import descend
from packmech.observables import Table, make_table
from packmech.packing import Packing
from packmech.protocols.continuation import Lost
from packmech.protocols.protocol import Protocol
from packmech.protocols.shearing.hard_discs import HardDiscs
from packmech.protocols.shearing.hard_path import Change, HardPath, Vertex
from packmech.protocols.shearing.hard_shapes import HardShapes
from packmech.result import Condition, Outcome, Row, Run, Stage, csv_text, unmet_conditions
from packmech.scene import Scene

# a jammed packing is as near as this to its hard packing [mean diameter], and its volume [1]
_NEARBY, _DENSER = 0.1, 0.01
_NOT_JAMMED = (
    "packing must be jammed, at zero pressure or nearly, with only the volume of its box free, got another: take the "
    "packing of pm.jam"
)
# largest number of interior-point iterations for the hard packing at the start
_ITERATIONS = 400
# net force over the mean one of a packing of shapes at a small pressure
_BALANCED = 1e-6
# strain within which a network that comes again is given up, and steps within it after which the path is; how far
# beyond the next one is looked for, the first time and, ten times as far each time, at most
_PROGRESS, _STEPS = 1e-6, 60
_BEYOND, _FARTHEST = 2e-9, 1e-4
# a fall back into its own network that moves no particle by more is none [mean diameter]
_SAME = 1e-6
_COLUMNS = ("strain", "packing_fraction", "stress_ratio", "family", "contacts", "rattlers", "gap_error", "imbalance")


@shown()
@dataclass(frozen=True)
class FamilyChange:
    """A change of the contact network at a shear strain.

    Attributes
    ----------
    strain
        Where it happens [1].
    cause
        "closing": a pair closed; "squeezing": what surrounds a rattler closed on it; "opening": the force of a contact
        fell to zero; "fold": the network cannot be followed for another reason; with shapes "instability": the volume
        has no minimum nearby any more.
    route
        How the packing came to its next network: "exchange": positions stay, a contact takes over from another, or with
        shapes just closes or opens; "interior point": it fell to the hard packing nearby, by the interior-point method
        that minimizes the volume, and with shapes "downhill": by steps that lower the enthalpy. Other ways down may
        lead elsewhere.
    family_before, family_after
        Numbers of the families.
    closed, opened
        Pairs (i, j, image) that bear forces after it and not before, and before it and not after.
    jump
        Packing fraction after less that before, both at this strain to 2e-9, where contacts change over and over to
        1e-4, with shapes sometimes to 1e-3 [1]; 0 for an exchange.
    moved
        Largest displacement of a particle that bears forces before and after [mean diameter]; 0 for an exchange.

    """

    strain: float
    cause: str
    route: str
    family_before: int
    family_after: int
    closed: tuple[tuple[int, ...], ...]
    opened: tuple[tuple[int, ...], ...]
    jump: float
    moved: float


@dataclass(frozen=True, eq=False, repr=False)
class ShearFamilies(Run):
    """The packing fraction at jamming along a shear strain, and the contact networks on the way.

    Rows are at each step of strain, and two at each change of network, before it and after it. `residual` is the
    largest imbalance of forces, `steps` counts factorizations.

    Attributes
    ----------
    strain_t
        (T,) shear strains since the start [1].
    packing_fraction_t
        (T,) packing fractions of the exact hard packings, rattlers included [1].
    stress_ratio_t
        (T,) shear stress over pressure, the stress Cauchy's with tension positive: -d ln(packing fraction)/d(strain).
    family_t
        (T,) number of the contact network; one that comes again has the number that it had.
    contacts_t, rattlers_t
        (T,) force-bearing contacts, and particles that bear none.
    gap_error_t, imbalance_t
        (T,) largest gap of a contact over the mean diameter, and largest net force over the mean force [1].
    changes
        The changes, in order.
    packings
        Packings at the strains that were asked for by `keep`, in the order in which they were reached.
    axes
        Direction of the flow, and of its gradient.
    report
        `stopped`: why the path ended before the strain that was asked for, in a sentence, where it lost the packing.

    """

    strain_t: NDArray[np.float64] = None  # type: ignore[assignment]
    packing_fraction_t: NDArray[np.float64] = None  # type: ignore[assignment]
    stress_ratio_t: NDArray[np.float64] = None  # type: ignore[assignment]
    family_t: NDArray[np.int64] = None  # type: ignore[assignment]
    contacts_t: NDArray[np.int64] = None  # type: ignore[assignment]
    rattlers_t: NDArray[np.int64] = None  # type: ignore[assignment]
    gap_error_t: NDArray[np.float64] = None  # type: ignore[assignment]
    imbalance_t: NDArray[np.float64] = None  # type: ignore[assignment]
    changes: tuple[FamilyChange, ...] = ()
    packings: tuple[Packing, ...] = ()
    axes: tuple[int, int] = (0, 1)

    @property
    def families(self) -> int:
        """Number of different contact networks."""
        return len(np.unique(self.family_t))

    def jumps(self, above: float = 0.0) -> tuple[FamilyChange, ...]:
        """Return the changes that fell to another packing, by more than so much in packing fraction."""
        return tuple(one for one in self.changes if one.route != "exchange" and one.jump > above)

    def to_dict(self) -> dict[str, Any]:
        """Return what was found by name, as plain values."""
        return {
            **super().to_dict(),
            "strain": float(self.strain_t[-1]),
            "packing_fraction": float(self.packing_fraction_t[-1]),
            "families": self.families,
            "changes": len(self.changes),
            "jumps": len(self.jumps()),
            "largest_jump": max((one.jump for one in self.jumps()), default=0.0),
            "gap_error": float(self.gap_error_t.max()),
        }

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, families under shear"

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        found = self.to_dict()
        largest = f", the largest by {found['largest_jump']:.3g}" if found["jumps"] else ""
        jumps = f"to other packings{largest}"
        return [
            *self.outcome_rows(),
            ("shear strain", f"{found['strain']:.6g}", "at the end"),
            (
                "packing fraction",
                f"{found['packing_fraction']:.10g}",
                f"{self.packing_fraction_t[0]:.10g} at the start",
            ),
            ("families", str(found["families"]), "different contact networks"),
            ("changes", str(found["changes"]), "of the network"),
            ("jumps", str(found["jumps"]), jumps),
            ("gap error", f"{found['gap_error']:.1e}", "over the mean diameter"),
            ("force residual", f"{self.residual:.1e}", "largest net force / mean contact force"),
            *([("stopped", f"at {found['strain']:.6g}", found["stopped"])] if "stopped" in found else []),
        ]

    def table(self) -> Table:
        """Return the rows as columns."""
        found = {name: getattr(self, f"{name}_t") for name in _COLUMNS}
        return make_table(found, self.about(), dict.fromkeys(found, "1"))

    def to_csv(self) -> str:
        """Return the rows as CSV; numbers keep every digit."""
        return csv_text(_COLUMNS, zip(*(getattr(self, f"{name}_t").tolist() for name in _COLUMNS), strict=True))


@honors("shapes", packing_only=True)
def shear_families(
    packing: Packing,
    applied_strain: float = 0.1,
    *,
    step: float = 2e-3,
    axes: tuple[int, int] = (0, 1),
    pressure: float = 1e-5,
    keep: Iterable[float] = (),
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> ShearFamilies:
    """Return the run of a jammed packing whose box is sheared at zero pressure: its families and what parts them.

    The box keeps the shape that the strain gives it, lattice (1 + strain e_flow e_gradient) of that at the start, and
    its volume is free. The exact hard packing is followed along its contact network by Newton's method; strains at
    which a contact closes or its force falls to zero are found to rounding, whatever the step, and what happens there
    depends on the packing alone (`FamilyChange`). Packing fraction falls, or rises, by d ln(phi) / d(strain) = -Sigma/P
    along a family, and jumps only up. A negative strain shears the other way; a walk back from `run.packing` is the
    same path up to the first jump. Labels of the lattice vectors are renewed on the way, so that strains may be large.

    Hard packings of shapes are followed as exactly, with their forces, the multipliers of the least volume, among
    Newton's unknowns. They may have fewer contacts than degrees of freedom, the curvature of the shapes holding the
    rest, so that at most changes of the network one contact closes or opens and no other takes its place. Where the
    volume has no minimum nearby any more they fall, soft, at a small pressure and under the harmonic law.

    Parameters
    ----------
    packing
        A jammed packing: of discs or spheres `run.packing` of a run of `jam` at a small pressure with
        ``strain="isotropic"``, its `report["hard_packing"]`, or an earlier run's packing.
    applied_strain
        Shear strain at the end, positive or negative [1].
    step
        Largest step of strain, at the end of each of which there is a row [1].
    axes
        Direction of the flow, and of its gradient.
    pressure
        Pressure at which packings with shapes fall [energy_scale / diameter^d]; discs and spheres need none.
    keep
        Strains at which to keep the packings.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress("families", figures) after each step, figures with "strain", "packing_fraction", "changes".
    check
        Raise NotConverged when a hard packing is lost on the way; otherwise return what there is.

    Returns
    -------
    ShearFamilies
        Outcome.FINISHED; Outcome.NOT_JAMMED where no hard packing is found after a jump; Outcome.STALLED where the path
        makes no progress; Outcome.INACCURATE where particles would overlap by more than 1e-12 of their contact
        distance: all pairs of every packing that is returned are checked. `report["stopped"]` says why and where.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If the hard packing is lost and `check` is set; its `.run` holds what was reached, and the last hard packing.
    KeyboardInterrupt
        Passed on with `.run` set to what was finished.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(10, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    >>> jammed = pm.jam(pm.Scene(start, (pm.Repulsion(),)), strain="isotropic").packing
    >>> run = pm.shear_families(jammed, 0.06)
    >>> [(round(one.strain, 6), one.cause, one.route) for one in run.changes[:2]]
    [(0.039117, 'opening', 'interior point'), (0.053443, 'closing', 'exchange')]

    """
    instance("packing", packing, Packing)
    end = real("applied_strain", applied_strain)
    size = positive("step", step)
    pair = two_axes("axes", axes, dimension=packing.dimension)
    kept = [real(f"keep[{k}]", one) for k, one in enumerate(listed("keep", keep, "strains"))]
    for k, one in enumerate(kept):
        if not min(0.0, end) <= one <= max(0.0, end):
            raise ValueError(f"keep[{k}] must lie between 0 and applied_strain, got {one}")
    small = positive("pressure", pressure)
    check_memory("applied_strain / step", 40.0 * (abs(end) / size))
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    began = time.process_time()
    with single_thread():
        network: HardDiscs | HardShapes
        if packing.shapes.has_orientations:
            network = _hard_shapes(packing, small, pair, loop)
        else:
            network = HardDiscs(_hard_packing(packing), pair)
        walk = _HardWalk(packing, HardPath(network, network.start, loop.check_time), loop, began)
        goals = np.linspace(0.0, end, max(1, int(np.ceil(abs(end) / size - 1e-9))) + 1)[1:]
        goals = np.unique(np.concatenate([goals, kept]))
        return loop.run(lambda: walk.through(goals if end >= 0.0 else goals[::-1], kept), walk.finish)


def _hard_packing(packing: Packing) -> HardPacking:
    """Return the exact hard packing of a jammed one, in reduced lengths.

    Raises
    ------
    ValueError
        If there is none nearby.

    """
    unit = length_unit(packing)
    box = Box(packing.box.lattice_dd / unit)
    reduced = packing.replace(position_nd=packing.position_nd / unit, radius_n=packing.radius_n / unit, box=box)
    d = packing.dimension
    isotropic = np.eye(d)[None] / np.sqrt(d)
    load = float(packing.particles * d)
    state = start_state(reduced.position_nd, reduced.box.lattice_dd, reduced.radius_n, load)
    contacts = find_contacts(reduced, gap_tolerance=None)
    bearing = contacts.among(~rattlers_of(contacts))
    hard = None
    if len(bearing):
        # a soft packing at a small pressure, or a hard one, has the contacts of the hard packing already
        near = pair_contacts(reduced, *state.pairs)
        touching = are_among(near, bearing)
        force = np.where(touching, 1.0, 1e-12)
        slack = np.where(touching, 1e-12, 1.0)
        hard, _ = certify(
            HardState(reduced.position_nd, reduced.box.lattice_dd, state.pairs, slack, force, 1e-12, 0.0),
            reduced,
            isotropic,
        )
        if hard is None or hard.floppy_modes:
            hard, _ = search_hard(state, reduced, isotropic, _ITERATIONS)
    if hard is not None and _is_nearby(hard.packing, hard.contacts.count_n() > 0, reduced):
        return hard
    raise ValueError(f'{_NOT_JAMMED}(scene, strain="isotropic")')


def _hard_shapes(packing: Packing, pressure: float, axes: tuple[int, int], loop: RunLoop) -> HardShapes:
    """Return the network of the exact hard packing of a jammed one with shapes.

    Raises
    ------
    ValueError
        If there is none nearby.

    """
    scene = Scene(packing, (Repulsion(Harmonic()),))
    protocol = Protocol(scene, "isotropic", 1e-9, loop)
    reduced, goal = protocol.reduced(packing), protocol.reduced_pressure(pressure)
    # a hard packing is taken to where its contacts overlap by about what the pressure asks for
    size = 1.0 if pressure_of(scene) > 0.1 * pressure * scene.pressure_unit else 1.0 - goal
    start = reduced.replace(position_nd=reduced.position_nd * size, box=reduced.box.scaled(size))
    state = descend(start, protocol.units, protocol.basis_kdd, goal, watch=protocol.in_time)
    if state.sound(_BALANCED):
        with contextlib.suppress(Lost):
            network = HardShapes(state.packing, protocol.units, goal, axes, lambda _: loop.check_time())
            if _is_nearby(network.start.packing, network.start.live_n, reduced):
                return network
    raise ValueError(f'{_NOT_JAMMED}(scene, pressure=1e-6, strain="isotropic")')


def _is_nearby(hard: Packing, live_n: NDArray[np.bool_], packing: Packing) -> bool:
    """Return whether a hard packing is the one near a packing."""
    away = hard.position_nd @ hard.box.inverse_dd.T - packing.position_nd @ packing.box.inverse_dd.T
    away = (away - away[live_n].mean(axis=0))[live_n] @ packing.box.lattice_dd.T
    return bool(np.abs(away).max() < _NEARBY and abs(hard.box.volume / packing.box.volume - 1.0) < _DENSER)


class _FamilyRows:
    """The rows, changes and packings that a walk leaves, and the run that they make."""

    def __init__(self, axes: tuple[int, int], began: float) -> None:
        self.axes, self.began = axes, began
        # the strain at the end
        self.goal = 0.0
        self.numbers: dict[frozenset[tuple[int, ...]], int] = {}
        self.rows: list[tuple[float, ...]] = []
        self.changes: list[FamilyChange] = []
        self.kept: list[Packing] = []

    def number(self, network: frozenset[tuple[int, ...]]) -> int:
        """Return the number of a network."""
        return self.numbers.setdefault(network, len(self.numbers))

    def run(self, packing: Packing, outcome: Outcome, steps: int, report: dict[str, Any]) -> ShearFamilies:
        """Return the run as far as it came."""
        columns: dict[str, Any] = dict(
            zip(_COLUMNS, np.array(self.rows).reshape(-1, len(_COLUMNS)).T.copy(), strict=True)
        )
        for name in ("family", "contacts", "rattlers"):
            columns[name] = columns[name].astype(np.int64)
        seconds = time.process_time() - self.began
        residual = float(columns["imbalance"].max(initial=0.0))
        stage = Stage("families", residual, steps, 0, seconds, f"{len(self.changes)} changes of the network")
        return ShearFamilies(
            packing=packing,
            outcome=outcome,
            unmet=unmet_conditions(outcome, Condition("shear strain", float(columns["strain"][-1]), self.goal, 0.0)),
            residual=residual,
            steps=steps,
            force_evaluations=0,
            seconds=seconds,
            stages=(stage,),
            changes=tuple(self.changes),
            packings=tuple(self.kept),
            axes=self.axes,
            report=report,
            **{f"{name}_t": column for name, column in columns.items()},
        )


class _HardWalk:
    """A hard packing on its way through strains."""

    def __init__(self, packing: Packing, path: HardPath, loop: RunLoop, began: float) -> None:
        self.given, self.path, self.loop = packing, path, loop
        self.unit = length_unit(packing)
        self.found = _FamilyRows(path.axes, began)
        self.report: dict[str, Any] = {}
        # the strain up to which it has come on, networks and steps since then, and how far beyond to look for the next
        self.beyond = _BEYOND
        self._begin(path.vertex.strain, {path.network.identity(path.vertex)})
        self.last = path.vertex
        self._keep(path.vertex, self.found.number(path.network.identity(path.vertex)))

    def through(self, goals: NDArray[np.float64], kept: list[float]) -> Outcome:
        """Go through all strains."""
        path, found = self.path, self.found
        found.goal = float(goals[-1])
        direction = float(np.sign(goals[-1]))
        for goal in goals.tolist():
            # a fall ends a little beyond the strain where it begins
            while abs(path.vertex.strain) < abs(goal):
                self.loop.check_time()
                try:
                    change = self._gone(goal, direction)
                    if change is not None:
                        self._note(change)
                        if self._comes_again(change):
                            # contacts that change in turn, and none for good, change together
                            change = self._fallen(direction, change.cause)
                            self._note(change)
                            self.since += change.after.strain - change.before.strain
                except Lost:
                    return self._stopped(Outcome.NOT_JAMMED, "no hard packing was found")
                vertex = path.vertex
                if self._stands_still():
                    return self._stopped(Outcome.STALLED, "contacts change over and over, and the strain does not grow")
                self.last = vertex
                self._keep(vertex, found.number(path.network.identity(vertex)))
            if goal in kept:
                wrong = overlap_of_hard(path.vertex.packing)
                if wrong is not None:
                    return self._stopped(Outcome.INACCURATE, str(wrong))
                found.kept.append(self._restored(path.vertex))
            last = found.rows[-1]
            self.loop.report("families", strain=last[0], packing_fraction=last[1], changes=len(found.changes))
        return Outcome.FINISHED

    def _gone(self, goal: float, direction: float) -> Change | None:
        """Go on towards a strain; return the change on the way, if there was one."""
        try:
            return self.path.go(goal)
        except Lost:
            return self._fallen(direction, "fold")

    def _fallen(self, direction: float, cause: str) -> Change:
        """Give the network up, and look ever farther beyond for the next; return the change."""
        while True:
            beyond, self.beyond = self.beyond, min(10.0 * self.beyond, _FARTHEST)
            try:
                return self.path.fall(direction, cause, beyond)
            except Lost:
                # where many contacts part by next to nothing, which of them are closed is seen farther on only
                if beyond >= _FARTHEST:
                    raise

    def _comes_again(self, change: Change) -> bool:
        """Return whether a change leads to a network that it has had since the strain last grew."""
        # what a fall looks beyond is no way made
        self.since += change.after.strain - change.before.strain
        if abs(change.after.strain - self.since) > _PROGRESS:
            self._begin(change.after.strain, {change.identities[0]})
        again = change.identities[1] in self.networks
        self.networks.add(change.identities[1])
        return again

    def _stands_still(self) -> bool:
        """Return whether it has gone on for too many steps without the strain growing."""
        strain = self.path.vertex.strain
        self.steps += 1
        if abs(strain - self.since) > _PROGRESS:
            self._begin(strain, set())
        return self.steps > _STEPS

    def _begin(self, strain: float, networks: set[frozenset[tuple[int, ...]]]) -> None:
        self.since, self.networks, self.steps, self.beyond = strain, networks, 0, _BEYOND

    def _stopped(self, outcome: Outcome, why: str) -> Outcome:
        self.report["stopped"] = f"{why}, beyond strain {self.last.strain:.10g}"
        return outcome

    def _keep(self, vertex: Vertex, number: int) -> None:
        self.found.rows.append(
            (
                vertex.strain,
                packing_fraction(vertex.packing),
                vertex.stress_ratio(self.path.axes),
                number,
                len(vertex.contacts),
                int((~vertex.live_n).sum()),
                vertex.gap_error,
                vertex.force_imbalance,
            )
        )

    def _note(self, change: Change) -> None:
        """Keep a change, and a row of what was before it; what rounding took for a change is none."""
        before, after = change.identities
        if before == after and change.moved < _SAME:
            return
        first, second = self.found.number(before), self.found.number(after)
        self._keep(change.before, first)
        jump = packing_fraction(change.after.packing) - packing_fraction(change.before.packing)
        self.found.changes.append(
            FamilyChange(
                change.before.strain,
                change.cause,
                self.path.network.falls_by if change.jumps else "exchange",
                first,
                second,
                tuple(sorted(after - before)),
                tuple(sorted(before - after)),
                jump if change.jumps else 0.0,
                change.moved,
            )
        )

    def _restored(self, vertex: Vertex) -> Packing:
        """Return the packing of a vertex in true lengths, in a box of short vectors, particles inside."""
        small, _ = vertex.packing.box.reduced()
        box = Box(small.lattice_dd * self.unit)
        position, _ = box.wrap(vertex.packing.position_nd * self.unit)
        return self.given.replace(position_nd=position, box=box, shapes=vertex.packing.shapes)

    def finish(self, outcome: Outcome) -> ShearFamilies:
        """Return the run as far as it came, its last packing checked as those that are kept."""
        wrong = overlap_of_hard(self.last.packing)
        if wrong is not None and "stopped" not in self.report:
            outcome = self._stopped(Outcome.INACCURATE, str(wrong))
        return self.found.run(self._restored(self.last), outcome, self.path.factorizations, self.report)
