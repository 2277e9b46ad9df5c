"""`quasistatic_shear`, `cyclic_shear`: small steps of strain, each followed to equilibrium, one way or to and fro."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import check_memory, instance, integer, one_of, positive, real, two_axes
from packmech.contacts.pairs import pair_names
from packmech.contacts.shape_contacts import touching_pairs
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import RunLoop, RunSettings, run_settings
from packmech.measure.counting import packing_fraction
from packmech.measure.rattlers import find_rattlers
from packmech.observables import Table, make_table
from packmech.packing import Packing, no_own_images
from packmech.protocols.pressure_path import PressurePath
from packmech.protocols.protocol import Protocol, check_jammed, check_reachable, finish
from packmech.protocols.shearing.avalanche import Avalanche
from packmech.protocols.shearing.sheared_lattice import ShearedLattice
from packmech.protocols.shearing.strain_path import WIDTH, Located, Pairs, Sheared, StrainPath, work_between
from packmech.result import Condition, Outcome, Row, Run, Stage, csv_text, unmet_conditions
from packmech.scene import Scene

_COLUMNS = (
    "strain", "shear_stress", "pressure", "packing_fraction", "energy", "work", "modulus", "contacts", "network",
    "predicted_change", "residual",
)  # fmt: skip
# part of the energy that a fall must free to be one and no exchange of contacts
_FALL = 1e-12
# strain within which a network that comes again is not located again, and a fall is that of the change before it
_PROGRESS = 1e-9
# bytes that a strain to go to takes
_GOAL_BYTES = 32.0


@shown()
@dataclass(frozen=True)
class ContactChange:
    """The strain at which a contact of a sheared packing opens or closes.

    Attributes
    ----------
    strain, strain_from_above
        The strain by tangents ever nearer before the change, and by such behind it [1]; where it `falls`, the nearest
        strain behind it at which there is no equilibrium nearby; where several contacts change at once, strains of the
        nearest equilibria on both sides, at most 1e-10 apart.
    opened
        Whether the contact `pair` opened; else it closed.
    pair
        Its particles (or beads) and image, (i, j, image); the first of several where contacts change at once, as
        those of a particle that becomes a rattler.
    shear_stress, pressure
        There [energy_scale / diameter^d].
    energy_change, work
        What the energy (with a pressure held, energy + pressure * volume) has grown by since the start, summed over
        changes of pairs, and the work that the shear stress did, its integral over the strain times the volume
        [energy_scale].
    tangents
        Strains of tangents before the change, and the strains of the change that they predict; the first is that of
        linear response at the start of the step.
    falls
        Whether the packing becomes unstable by this change, and falls to another.

    """

    strain: float
    strain_from_above: float
    opened: bool
    pair: tuple[int, ...]
    shear_stress: float
    pressure: float
    energy_change: float
    work: float
    tangents: tuple[tuple[float, float], ...] = dataclasses.field(repr=False)
    falls: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class QuasistaticShear(Run):
    """Stress against strain of a packing that is sheared from equilibrium to equilibrium.

    Attributes
    ----------
    strain_t
        (T,) shear strains since the start [1].
    shear_stress_t, pressure_t
        (T,) shear stress, Cauchy's with tension positive, and pressure [energy_scale / diameter^d].
    packing_fraction_t
        (T,) packing fractions [1].
    energy_t, work_t
        (T,) energies, and work that the shear stress has done since the start [energy_scale].
    modulus_t
        (T,) tangent moduli d(volume * stress)/d(strain) / volume of the equilibrium, by linear response [energy_scale /
        diameter^d].
    contacts_t, network_t
        (T,) contacts of particles that are no rattlers, and the number of their network.
    predicted_change_t
        (T,) strain of the next change of contacts by the tangent there; infinite where it predicts none [1].
    residual_t
        (T,) largest net force over the mean contact force [1].
    changes
        Changes of contacts that were located, in order.
    avalanches
        Falls to other equilibria, in order.
    axes, held
        Direction of the flow and of its gradient; "volume" or "pressure".

    """

    strain_t: NDArray[np.float64] = None  # type: ignore[assignment]
    shear_stress_t: NDArray[np.float64] = None  # type: ignore[assignment]
    pressure_t: NDArray[np.float64] = None  # type: ignore[assignment]
    packing_fraction_t: NDArray[np.float64] = None  # type: ignore[assignment]
    energy_t: NDArray[np.float64] = None  # type: ignore[assignment]
    work_t: NDArray[np.float64] = None  # type: ignore[assignment]
    modulus_t: NDArray[np.float64] = None  # type: ignore[assignment]
    contacts_t: NDArray[np.int64] = None  # type: ignore[assignment]
    network_t: NDArray[np.int64] = None  # type: ignore[assignment]
    predicted_change_t: NDArray[np.float64] = None  # type: ignore[assignment]
    residual_t: NDArray[np.float64] = None  # type: ignore[assignment]
    changes: tuple[ContactChange, ...] = ()
    avalanches: tuple[Avalanche, ...] = ()
    axes: tuple[int, int] = (0, 1)
    held: str = "volume"

    @property
    def first_change(self) -> ContactChange | None:
        """The first change of contacts that was located; None where there was none, or none could be."""
        return self.changes[0] if self.changes else None

    @property
    def yield_strain(self) -> float:
        """Strain of the largest growth of the stress along the shear; nan where it is still growing at the end [1]."""
        if not len(self.strain_t):
            return math.nan
        grown = (self.shear_stress_t - self.shear_stress_t[0]) * np.sign(self.strain_t[-1] or 1.0)
        k = int(np.argmax(grown))
        return float(self.strain_t[k]) if 0 < k < len(grown) - 1 else math.nan

    def linear_range(self, tolerance: float = 0.05) -> float:
        """Return the strain up to which stress follows the modulus at the start; inf up to the end.

        It does while it is off by less than `tolerance` times modulus * strain [1]. Between rows it is interpolated.

        Raises
        ------
        TypeError, ValueError
            If the tolerance is not positive.

        """
        part = positive("tolerance", tolerance)
        if not len(self.strain_t):
            return math.nan
        straight = self.modulus_t[0] * (self.strain_t - self.strain_t[0])
        off = np.abs(self.shear_stress_t - self.shear_stress_t[0] - straight) - part * np.abs(straight)
        off[0] = 0.0
        beyond = np.flatnonzero(off > 0.0)
        if not len(beyond):
            return math.inf
        k = int(beyond[0])
        low, high = min(float(off[k - 1]), 0.0), float(off[k])
        return abs(float(self.strain_t[k - 1] + (self.strain_t[k] - self.strain_t[k - 1]) * low / (low - high)))

    def to_dict(self) -> dict[str, Any]:
        """Return what was found by name, as plain values."""
        first = self.first_change
        return {
            **super().to_dict(),
            "held": self.held,
            "strain": _last(self.strain_t),
            "shear_stress": _last(self.shear_stress_t),
            "modulus": _last(self.modulus_t[:1]),
            "first_change": math.nan if first is None else first.strain,
            "first_change_opened": None if first is None else first.opened,
            "yield_strain": self.yield_strain,
            "linear_range": self.linear_range(),
            "avalanches": len(self.avalanches),
        }

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, sheared quasistatically at constant {self.held}"

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        found, d, first = self.to_dict(), self.packing.dimension, self.first_change
        unit = f"energy_scale / diameter^{d}"
        yields = "of the largest stress" if math.isfinite(self.yield_strain) else "the stress grows up to the end"
        what = "none was located" if first is None else f"a contact {'opens' if first.opened else 'closes'}"
        return [
            *self.outcome_rows(),
            ("shear strain", f"{found['strain']:.6g}", "at the end"),
            ("shear stress", f"{found['shear_stress']:.6g}", unit),
            ("shear modulus", f"{found['modulus']:.6g}", f"{unit}, at the start"),
            ("first change", f"{found['first_change']:.10g}", what),
            ("linear range", f"{found['linear_range']:.4g}", "strain up to which stress is linear to 5 %"),
            ("yield strain", f"{found['yield_strain']:.4g}", yields),
            ("avalanches", str(found["avalanches"]), ""),
            ("force residual", f"{self.residual:.1e}", "largest net force / mean contact force"),
        ]

    def table(self) -> Table:
        """Return the rows as columns."""
        found = {name: getattr(self, f"{name}_t") for name in _COLUMNS}
        density = f"energy_scale/diameter^{self.packing.dimension}"
        units = dict.fromkeys(found, "1") | dict.fromkeys(("shear_stress", "pressure", "modulus"), density)
        return make_table(found, self.about(), units | dict.fromkeys(("energy", "work"), "energy_scale"))

    def to_csv(self) -> str:
        """Return the rows as CSV; numbers keep every digit."""
        return csv_text(_COLUMNS, zip(*(getattr(self, f"{name}_t").tolist() for name in _COLUMNS), strict=True))


@honors("repulsion kinds links shapes", at_rest=True, rough="pm.deform_at_rate or pm.ramp_strain")
def quasistatic_shear(
    scene: Scene,
    applied_strain: float = 0.1,
    *,
    step: float = 1e-3,
    axes: tuple[int, int] = (0, 1),
    pressure: float | None = None,
    locate: str = "first",
    smallest_drop: float | None = None,
    avalanche_limit: int | None = None,
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> QuasistaticShear:
    """Return the run of a jammed packing that is sheared in small steps, in equilibrium after each.

    Athermal quasistatic shear: particles are taken along, x + step * y, with what linear response adds, then Newton's
    method finds the equilibrium, at constant volume or at constant pressure in a box of the shape that the strain gives
    it. Where the packing does not go on smoothly the step is halved down to a strain of 1e-8; what is left is
    a rearrangement: the packing falls downhill, which is kept as an `Avalanche`. Shapes keep their directors while
    they are taken along; links keep their length.

    Parameters
    ----------
    scene
        The scene of a jammed packing, at rest under pressure.
    applied_strain
        Shear strain at the end, positive or negative [1].
    step
        Step of strain, at the end of each of which there is a row [1].
    axes
        Direction of the flow, and of its gradient.
    pressure
        Pressure to hold [energy_scale / diameter^d]; the packing goes there first. None holds the volume.
    locate
        "first": the strain of the first change of contacts is found from both sides, to rounding if one contact
        changes, and has a row;
        "all": those of all changes, so that `work_t` is exact to fourth order of the steps throughout; "none".
    smallest_drop
        Energy drop down to which avalanches are to be found, whatever the step [energy_scale]: a step is halved where
        more than half of that is missing of the work that was done, by cubics through stress and modulus. None: a step
        may pass over falls that move particles no farther than linear response moves them.
    avalanche_limit
        Stop after so many plastic avalanches; None: at the end of the strain.
    force_tolerance
        Net force over mean contact force that counts as balance [1]; the floor of rounding also counts.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress("shear", figures) after each step, figures with "strain", "shear_stress", "avalanches".
    check
        Raise NotConverged when the packing does not come to rest; otherwise return what there is.

    Returns
    -------
    QuasistaticShear
        Outcome.FINISHED; Outcome.UNJAMMED, a success, where the pressure is lost.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If the packing does not come to rest and `check` is set; its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.run` set to what was finished.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> scene = pm.Scene(start, (pm.Repulsion(),))
    >>> scene = scene.replace(packing=pm.jam(scene, pressure=1e-3).packing)
    >>> run = pm.quasistatic_shear(scene, 3e-3, step=1e-3)
    >>> first = run.first_change
    >>> first.opened, abs(first.strain - first.strain_from_above) < 1e-12
    (True, True)

    """
    pair, asked, tolerance = _checked(scene, axes, pressure, force_tolerance)
    end = real("applied_strain", applied_strain)
    size = positive("step", step)
    one_of("locate", locate, ("first", "all", "none"))
    smallest = None if smallest_drop is None else positive("smallest_drop", smallest_drop)
    most = math.inf if avalanche_limit is None else integer("avalanche_limit", avalanche_limit, at_least=1)
    settings = run_settings(time_limit=time_limit, progress=progress, check=check)
    shear = _Shear(_protocol(scene, asked, tolerance, settings), pair, asked, locate)
    return shear.until(end, size, smallest, most)


def shear_held(
    scene: Scene,
    applied_strain: float,
    *,
    step: float,
    smallest_drop: float | None,
    avalanche_limit: int,
    force_tolerance: float,
    settings: RunSettings,
) -> QuasistaticShear:
    """Return the run of discs of which some are held, sheared by these, which are taken along and stay there.

    Arguments are those of `quasistatic_shear`, checked.
    """
    shear = _Shear(_protocol(scene, None, force_tolerance, settings), (0, 1), None, "none")
    return shear.until(applied_strain, step, smallest_drop, avalanche_limit)


@honors("repulsion kinds links shapes", at_rest=True)
def cyclic_shear(
    scene: Scene,
    amplitude: float,
    cycles: int = 1,
    *,
    step: float = 1e-3,
    axes: tuple[int, int] = (0, 1),
    pressure: float | None = None,
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> tuple[QuasistaticShear, ...]:
    """Return one run for each cycle of shear of a jammed packing: to the amplitude, to its negative, and back to zero.

    Each cycle is sheared quasistatically, as by `quasistatic_shear`. At constant pressure loose packings grow denser
    over the first cycles, until small ones come to a limit cycle; at constant volume the pressure falls, or they unjam.
    A cycle without a change of contacts comes back to where it began, to rounding (`displacement` 0). To go on, call
    again with the packing of the last run: the cycles are those of one call.

    Parameters
    ----------
    scene
        The scene of a jammed packing, at rest under pressure.
    amplitude
        Largest shear strain either way [1].
    cycles
        How many.
    step
        Step of strain, at the end of each of which there is a row [1].
    axes
        Direction of the flow, and of its gradient.
    pressure
        Pressure to hold [energy_scale / diameter^d]; the packing goes there first. None holds the volume.
    force_tolerance
        Net force over mean contact force that counts as balance [1]; the floor of rounding also counts.
    time_limit
        Stop after so much CPU time in all, compiling aside [s]; the cycle in hand ends with Outcome.TIME_LIMIT.
    progress
        Called as progress("shear", figures) after each step, and as progress("cycle", figures) after each cycle, with
        "cycle", "packing", "packing_fraction" and "displacement".
    check
        Raise NotConverged when the packing does not come to rest; otherwise such a cycle is the last.

    Returns
    -------
    tuple of QuasistaticShear
        `strain_t` begins and ends at 0 in each. `report` as for `jam`, and cycle (1 for the first), amplitude; of whole
        cycles also displacement (root mean square of the particles that are no rattlers since the cycle began, over the
        mean diameter, what all do and the growth of the box left out), contacts_opened and contacts_closed since then,
        and work (of the shear stress over the cycle [energy_scale]). A packing that unjams at constant volume ends with
        Outcome.UNJAMMED, a success, and is the last.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not jammed.
    NotConverged
        If the packing does not come to rest and `check` is set; its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.runs` set to the cycles that were finished, `.run` to the one in hand.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=1)
    >>> scene = pm.Scene(start, (pm.Repulsion(),))
    >>> scene = scene.replace(packing=pm.jam(scene, pressure=1e-3).packing)
    >>> small, = pm.cyclic_shear(scene, 1e-4, step=1e-4, pressure=1e-3)
    >>> small.report["displacement"] < 1e-10, small.report["contacts_opened"]
    (True, 0)

    """
    pair, asked, tolerance = _checked(scene, axes, pressure, force_tolerance)
    largest, size = positive("amplitude", amplitude), positive("step", step)
    number = integer("cycles", cycles, at_least=1)
    settings = run_settings(time_limit=time_limit, progress=progress, check=check)
    check_memory("amplitude / step", _GOAL_BYTES * largest / size)
    steps = max(1, math.ceil(largest / size - 1e-9))
    up = np.linspace(0.0, largest, steps + 1)[1:]
    quarter = np.concatenate([up[:-1][::-1], [0.0]])
    goals = np.concatenate([up, quarter, -up, -quarter])
    # the last goal without its sign
    goals[-1] = 0.0
    runs: list[QuasistaticShear] = []
    loop = RunLoop(settings)
    for cycle in range(1, number + 1):
        started = time.process_time()
        protocol = _protocol(scene, asked, tolerance, loop.rest())
        try:
            run = _Shear(protocol, pair, asked, "none").run(goals)
            report = {"cycle": cycle, "amplitude": largest, **_report(protocol, run, asked, started)}
            if run.outcome is Outcome.FINISHED:
                # since the packing was at the pressure
                report |= {**_changed(protocol.scene.packing, run.packing), "work": float(run.work_t[-1])}
            runs.append(dataclasses.replace(run, report=report, seconds=time.process_time() - started))
            if run.outcome is not Outcome.FINISHED:
                break
            figures = {name: report[name] for name in ("cycle", "packing_fraction", "displacement")}
            protocol.loop.report("cycle", packing=run.packing, **figures)
        except KeyboardInterrupt as stop:
            stop.runs = tuple(runs)  # type: ignore[attr-defined]
            raise
        scene = scene.replace(packing=run.packing)
    return tuple(runs)


def _checked(
    scene: Scene, axes: tuple[int, int], pressure: float | None, force_tolerance: float
) -> tuple[tuple[int, int], float | None, float]:
    """Return axes, pressure and tolerance, checked, for a scene that can be sheared."""
    instance("scene", scene, Scene)
    no_own_images("scene.packing", scene.packing)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)
    asked = None if pressure is None else positive("pressure", pressure)
    if asked is not None:
        check_reachable(scene, "pressure", asked)
    tolerance = positive("force_tolerance", force_tolerance)
    check_jammed(scene)
    return pair, asked, tolerance


def _protocol(scene: Scene, pressure: float | None, tolerance: float, settings: RunSettings) -> Protocol:
    """Return the protocol of a packing whose box keeps its volume, or grows and shrinks at a pressure."""
    return Protocol(scene, "none" if pressure is None else "isotropic", tolerance, RunLoop(settings))


def _report(protocol: Protocol, run: QuasistaticShear, pressure: float | None, began: float) -> dict[str, Any]:
    """Return the report of a cycle, as `jam` makes it; contacts are counted for a box whose shape is given."""
    counted = Protocol(protocol.scene, "isotropic", protocol.force_tolerance, protocol.loop)
    report = finish(counted, run.packing, run.outcome, pressure, "cyclic_shear", began).report
    return {**report, "strain": protocol.strain}


def _changed(before: Packing, after: Packing) -> dict[str, Any]:
    """Return how far particles of a whole cycle moved, and how many contacts opened and closed."""
    box = after.box
    size = (box.volume / before.box.volume) ** (1.0 / after.dimension)
    start_nd = size * before.position_nd
    moved_nd = after.position_nd - start_nd
    moved_nd -= np.rint(moved_nd @ box.inverse_dd.T) @ box.lattice_dd.T
    # both in one box with the same images
    was, now = (
        set(pair_names(touching_pairs(one)))
        for one in (before.replace(box=before.box.reduced()[0]), after.replace(position_nd=start_nd + moved_nd))
    )
    held = ~(find_rattlers(before) | find_rattlers(after))
    moved_nd = moved_nd[held] - moved_nd[held].mean(axis=0)
    return {
        "displacement": float(np.sqrt((moved_nd**2).sum(axis=1).mean()) / after.diameter_n.mean()),
        "contacts_opened": len(was - now),
        "contacts_closed": len(now - was),
    }


def _last(values: NDArray[np.float64]) -> float:
    """Return the last value; nan of a run that was ended before its first row."""
    return float(values[-1]) if len(values) else math.nan


class _Shear:
    """A packing on its way, and the rows that it leaves."""

    def __init__(self, protocol: Protocol, axes: tuple[int, int], pressure: float | None, locate: str) -> None:
        self.protocol, self.axes, self.asked, self.locate = protocol, axes, pressure, locate
        self.began = time.process_time()
        self.rows: list[tuple[float, ...]] = []
        self.changes: list[ContactChange] = []
        self.avalanches: list[Avalanche] = []
        self.networks: dict[frozenset[tuple[int, ...]], int] = {}
        self.work = self.growth = 0.0
        self.largest_loss = self.most_avalanches = math.inf
        # whether contacts have changed, located or not
        self.changed = False
        # the strains to go through, and how many of them are done
        self.goals, self.done = np.zeros(1), 0
        # networks since the strain last grew, and that strain: changes there and back are not located again and again
        self.lately: set[Pairs] = set()
        self.since = self.shortest = 0.0
        self.path: StrainPath | None = None

    def until(self, end: float, step: float, smallest: float | None, most: float) -> QuasistaticShear:
        """Return the run in steps to a strain or to so many plastic avalanches, of which small ones are looked for."""
        self.most_avalanches = most
        if smallest is not None:
            self.largest_loss = 0.5 * smallest * self.protocol.scene.energy_scale
        check_memory("applied_strain / step", _GOAL_BYTES * abs(end) / step)
        steps = max(1, math.ceil(abs(end) / step - 1e-9))
        return self.run(np.linspace(0.0, end, steps + 1)[1:])

    def run(self, goals: NDArray[np.float64]) -> QuasistaticShear:
        """Return the run through all strains."""
        with single_thread():
            return self.protocol.loop.run(lambda: self.through(goals), self.finish)

    def through(self, goals: NDArray[np.float64]) -> Outcome:
        """Go to the pressure, then through all strains."""
        protocol, unit = self.protocol, self.protocol.scene.pressure_unit
        self.goals = goals
        if self.asked is not None:
            outcome = PressurePath(protocol).go(self.asked)
            if not outcome.ok:
                return outcome
            protocol.scene = protocol.scene.replace(packing=protocol.last)
        lattice = ShearedLattice(protocol.reduced(protocol.scene.packing), self.axes)
        self.path = path = StrainPath(protocol, lattice, None if self.asked is None else self.asked * unit)
        path.largest_loss = self.largest_loss
        if not path.sound:
            return Outcome.STALLED
        self._keep(path.now, 0.0, float(goals[0]))
        self.shortest = min(WIDTH, abs(float(goals[0])))
        for goal in goals.tolist():
            while path.now.strain != goal:
                ended = self._towards(path, goal)
                if ended is not None:
                    return ended
                if sum(one.plastic for one in self.avalanches) >= self.most_avalanches:
                    return Outcome.FINISHED
            self.protocol.loop.report(
                "shear", strain=goal, shear_stress=self.rows[-1][1], avalanches=len(self.avalanches)
            )
            self.done += 1
        return Outcome.FINISHED

    def _towards(self, path: StrainPath, goal: float) -> Outcome | None:
        """Go on to a strain, or to the next change of contacts that is to be located before it."""
        start = path.now
        wanted = self.locate == "all" or (self.locate == "first" and not self.changed)
        reached, fallen = path.step(goal)
        if wanted and (reached.pairs != start.pairs or fallen is not None):
            found = path.locate(start, reached.strain if fallen is None else fallen.strain)
            if found is not None and abs(found.below - start.strain) > abs(goal - start.strain):
                found = None
            if found is not None and self._comes_again(found):
                # behind the change there was balance to the tolerance only, and none farther on
                if found.after is None and self.changes and self.changes[-1].pair == found.pair:
                    self.changes[-1] = dataclasses.replace(self.changes[-1], falls=True, strain_from_above=found.above)
                found = None
            if found is not None:
                self._note(found, start, goal)
                if found.after is not None:
                    path.now = found.after
                    return None
                # it falls where it has been located, not at the end of the step
                start = found.there
                path.now = start
                reached, fallen = path.step(goal, self.shortest)
        return self._went(path, start, reached, fallen, goal)

    def _comes_again(self, found: Located) -> bool:
        """Return whether a change leads to a network that it has had since the strain last grew."""
        known = found.before.pairs
        if abs(found.below - self.since) > _PROGRESS:
            self.since, self.lately = found.below, {known}
        after = known ^ {found.pair} if found.after is None else found.after.pairs
        again = after in self.lately
        self.lately.add(after)
        return again

    def _went(
        self, path: StrainPath, start: Sheared, reached: Sheared, fallen: Sheared | None, goal: float
    ) -> Outcome | None:
        """Keep the equilibrium that was reached, and what it fell to; return how the run ended, if it did."""
        self.changed |= reached.pairs != start.pairs or fallen is not None
        if reached is not start:
            self.growth += start.network.growth_to(reached.packing)
            self._keep(reached, work_between(start, reached), goal)
        if fallen is None:
            return None
        if fallen.pressure <= 0.0 or not fallen.pairs:
            return Outcome.UNJAMMED
        if not path.sound:
            return Outcome.STALLED
        self._fall(path, reached, fallen)
        return None

    def _note(self, found: Located, start: Sheared, goal: float) -> None:
        """Keep a change of contacts that was located, and a row at it."""
        there, scene, self.changed = found.there, self.protocol.scene, True
        # up to the change with the contacts before it
        self.growth += start.network.growth_to(found.before.packing) + found.before.network.growth_to(there.packing)
        self._keep(there, work_between(start, found.before) + work_between(found.before, there), goal)
        self.changes.append(
            ContactChange(
                found.below,
                found.above,
                found.opened,
                found.pair,
                there.stress / scene.pressure_unit,
                there.pressure / scene.pressure_unit,
                self.growth / scene.energy_scale,
                self.work / scene.energy_scale,
                found.tangents,
                found.after is None,
            )
        )
        if found.after is not None:
            self.growth += there.network.growth_to(found.after.packing)
            self._keep(found.after, work_between(there, found.after), goal)

    def _fall(self, path: StrainPath, before: Sheared, after: Sheared) -> None:
        """Keep a fall to another equilibrium, and a row after it; what falls at a change of contacts falls by it."""
        if self.changes and abs(before.strain - self.changes[-1].strain_from_above) <= _PROGRESS:
            self.changes[-1] = dataclasses.replace(self.changes[-1], falls=True)
        scene, step = self.protocol.scene, after.strain - before.strain
        ahead = before.enthalpy + step * before.slope + 0.5 * step**2 * before.curvature
        drop = ahead - after.enthalpy
        self.growth += after.enthalpy - before.enthalpy
        self._keep(after, step * before.slope + 0.5 * step**2 * before.curvature, 2.0 * after.strain - before.strain)
        if drop > _FALL * abs(before.enthalpy):
            self.avalanches.append(
                Avalanche(
                    after.strain,
                    abs(step),
                    drop / scene.energy_scale,
                    (before.stress - after.stress) / scene.pressure_unit,
                    len(before.pairs - after.pairs),
                    len(after.pairs - before.pairs),
                    not path.comes_back(before, after),
                    self.protocol.restored(before.packing),
                    self.protocol.restored(after.packing),
                )
            )

    def _keep(self, one: Sheared, work: float, goal: float) -> None:
        assert self.path is not None
        self.work += work
        scene = self.protocol.scene
        unit = scene.pressure_unit
        self.protocol.last = self.protocol.restored(one.packing)
        self.rows.append(
            (
                one.strain,
                one.stress / unit,
                one.pressure / unit,
                packing_fraction(self.protocol.last),
                one.energy / scene.energy_scale,
                self.work / scene.energy_scale,
                one.modulus / unit,
                len(one.pairs),
                self.networks.setdefault(one.pairs, len(self.networks)),
                self.path.predicted(one, goal - one.strain or 1.0, one.pairs)[0],
                one.residual,
            )
        )

    def _end(self, strain: float) -> Condition:
        """Return how far the run came: in strain, or in steps where it turns on the way and ends where it began."""
        goal = float(self.goals[-1])
        if np.abs(self.goals).max() <= abs(goal):
            return Condition("shear strain", strain, goal, 0.0)
        hint = f"it stands at shear strain {strain:.4g}"
        return Condition("steps of strain of the cycle", self.done, len(self.goals), 0.0, hint)

    def finish(self, outcome: Outcome) -> QuasistaticShear:
        """Return the run as far as it came."""
        table = np.array(self.rows).reshape(-1, len(_COLUMNS)).T.copy()
        columns: dict[str, Any] = dict(zip(_COLUMNS, table, strict=True))
        for name in ("contacts", "network"):
            columns[name] = columns[name].astype(np.int64)
        seconds = time.process_time() - self.began
        residual = float(columns["residual"].max(initial=0.0))
        iterations = 0 if self.path is None else self.path.iterations
        stage = Stage("quasistatic shear", residual, iterations, iterations, seconds, f"{len(self.rows)} equilibria")
        packing = self.protocol.last
        small, _ = packing.box.reduced()
        strain = self.rows[-1][0] if self.rows else 0.0
        return QuasistaticShear(
            packing=packing.replace(box=small).wrapped(),
            outcome=outcome,
            unmet=unmet_conditions(outcome, self._end(strain)),
            residual=residual,
            steps=iterations,
            force_evaluations=iterations,
            seconds=seconds,
            stages=(*self.protocol.stages, stage),
            changes=tuple(self.changes),
            avalanches=tuple(self.avalanches),
            axes=self.axes,
            held="volume" if self.asked is None else "pressure",
            **{f"{name}_t": columns[name] for name in _COLUMNS},
        )
