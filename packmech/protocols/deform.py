"""`deform`, `deform_at_rate`: each component of the box's strain and stress is set by itself, at rest or in time."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, logm

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import boolean, brief, check_steps, instance, integer, positive, real
from packmech.contacts.shape_contacts import touching_pairs
from packmech.dynamics.engine import refuse_misfits
from packmech.dynamics.integrators import choose_time_step, stiffness_and_damping
from packmech.dynamics.ledger import EnergyLedger
from packmech.dynamics.spans import Spans
from packmech.effects import bonds_of, interactions_of
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import stress_tensor
from packmech.minimize.second_order.soft_network import Load
from packmech.observables import Table, make_table
from packmech.packing import no_own_images
from packmech.protocols.pressure_path import PressurePath
from packmech.protocols.protocol import Protocol, check_jammed
from packmech.protocols.shearing.sheared_lattice import StrainedLattice
from packmech.protocols.shearing.strain_path import StrainPath
from packmech.result import Condition, Outcome, Row, Run, Stage, unmet_conditions
from packmech.scene import Scene

_AXES = "xyz"
# most strain between two looks at the stress
_STRAIN = 1e-3
# time over which missing stress is integrated, over that in which a strain follows it
_MEMORY = 20.0
# largest missing stress that a strain answers to, and largest integral of it, over the scale of the stresses
_LARGEST = 1.0
# fraction of the shortest time of a contact that a step takes
_STEP = 0.1
# spans in a row at whose ends stresses are held before the box strains, and spans after which they will not be
_HELD, _SPANS = 20, 20_000
APPROACH, STAGE = "going to the stresses", "deformation"


class Control(NamedTuple):
    """What is asked of a box: by components (row, column), strains at the end, and stresses that are held.

    Missing stresses are compared with `scale`: the largest that is held, or the pressure at the start where all are 0.
    """

    strain: dict[tuple[int, int], float]
    stress: dict[tuple[int, int], float]
    dimension: int
    scale: float

    @property
    def end_dd(self) -> NDArray[np.float64]:
        """The (d, d) strains at the end, 0 where none is given."""
        return self._matrix(self.strain)

    @property
    def held_dd(self) -> NDArray[np.bool_]:
        """The (d, d) components whose stress is held, above the diagonal and on it."""
        return self._matrix(dict.fromkeys(self.stress, 1.0)) > 0.0

    @property
    def asked_dd(self) -> NDArray[np.float64]:
        """The (d, d) stresses that are held, 0 elsewhere."""
        return self._matrix(self.stress)

    def missing(self, stress_dd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (d, d) stress less that which is held; 0 where none is."""
        return np.where(self.held_dd, 0.5 * (stress_dd + stress_dd.T) - self.asked_dd, 0.0)

    def conditions(self, stress_dd: NDArray[np.float64], tolerance: float, hint: str) -> tuple[Condition, ...]:
        """Return what is missing of the stresses that are held, over the scale."""
        part = np.abs(self.missing(stress_dd)) / (self.scale or 1.0)
        return tuple(
            Condition(f"missing stress {_AXES[i] + _AXES[j]}", float(part[i, j]), tolerance, hint=hint)
            for i, j in self.stress
        )

    def _matrix(self, values: dict[tuple[int, int], float]) -> NDArray[np.float64]:
        found = np.zeros((self.dimension, self.dimension))
        for place, value in values.items():
            found[place] = value
        return found


def _components(name: str, given: Any, dimension: int) -> dict[tuple[int, int], float]:
    """Return numbers by components of a mapping such as {"xx": -0.1}."""
    if not isinstance(given, Mapping):
        raise TypeError(f'{name} must be a mapping of components such as {{"yy": -0.01}}, got {brief(given)}')
    axes = _AXES[:dimension]
    known = {a + b: (i, j) for i, a in enumerate(axes) for j, b in enumerate(axes) if i <= j}
    for key in given:
        if key not in known:
            turned = f"; it is {key[::-1]!r} here" if isinstance(key, str) and key[::-1] in known else ""
            raise ValueError(f"{name} must name components among {', '.join(known)}, got {brief(key)}{turned}")
    return {known[key]: real(f"{name}[{key!r}]", value) for key, value in given.items()}


def _control(scene: Any, strain: Any, stress: Any) -> Control:
    """Return what is asked of the box, checked."""
    instance("scene", scene, Scene)
    d = scene.packing.dimension
    given, held = _components("strain", strain, d), _components("stress", stress, d)
    scale = max(map(abs, held.values()), default=0.0) or abs(float(np.trace(stress_tensor(scene)))) / d
    found = Control(given, held, d, scale)
    pulls = bonds_of(scene.effects) is not None or interactions_of(scene.effects)
    for (i, j), value in held.items():
        if i == j and value >= 0.0 and not pulls:
            raise ValueError(
                f"stress must be below 0 for {_AXES[i] + _AXES[j]!r} where particles only push, as tension is positive "
                f"(a compression of 0.01 is -0.01), got {value:g}"
            )
    both = sorted(set(found.strain) & set(found.stress))
    if both:
        i, j = both[0]
        raise ValueError(
            f"stress must name no component whose strain is given, got {brief(_AXES[i] + _AXES[j])} in both"
        )
    if not found.stress and not any(found.strain.values()):
        raise ValueError("strain must name a component that is not 0 where no stress is held, got none")
    return found


@dataclass(frozen=True, eq=False, repr=False)
class Deformation(Run):
    """Stress against strain of a packing in a box of which each component is set by its strain or by its stress.

    Attributes
    ----------
    strain_tdd
        (T, d, d) strains since the start: integrals of the velocity gradient L over time, so that those on the
        diagonal are logarithms of ratios of lengths and those above it, "xy", shears that carry x along y [1]. Those
        below it are 0: vectors along x keep their direction. Free shears are summed step by step.
    stress_tdd
        (T, d, d) Cauchy stresses, tension positive, in time with their kinetic parts [energy/length^d].
    packing_fraction_t
        (T,) packing fractions, overlaps counted twice [1].
    contacts_t
        (T,) touching pairs.
    residual_t
        (T,) largest net forces over the mean contact force [1]; `residual` is the largest of them at rest, and the last
        one in time.
    asked
        Strains at the end and stresses held, by their components, and 0 for what neither names.
    rate
        Rate of the largest of the given strains [1/time]; 0 at rest.
    tolerance
        Largest missing stress over the scale of the held ones at which these count as held [1].
    rearrangements
        Falls to other equilibria on the way, at rest.
    ledger
        Where the energy went, of runs in time that were asked for it.

    """

    strain_tdd: NDArray[np.float64] = None  # type: ignore[assignment]
    stress_tdd: NDArray[np.float64] = None  # type: ignore[assignment]
    packing_fraction_t: NDArray[np.float64] = None  # type: ignore[assignment]
    contacts_t: NDArray[np.int64] = None  # type: ignore[assignment]
    residual_t: NDArray[np.float64] = None  # type: ignore[assignment]
    asked: Control = None  # type: ignore[assignment]
    rate: float = 0.0
    tolerance: float = 0.0
    rearrangements: int = 0
    ledger: EnergyLedger | None = None

    @property
    def pressure_t(self) -> NDArray[np.float64]:
        """The (T,) pressures, -trace(stress)/d [energy/length^d]."""
        return np.asarray(-np.trace(self.stress_tdd, axis1=1, axis2=2) / self.packing.dimension)

    @property
    def principal_stress_td(self) -> NDArray[np.float64]:
        """The (T, d) principal stresses, the most compressive first [energy/length^d]."""
        return np.asarray(np.linalg.eigvalsh(0.5 * (self.stress_tdd + self.stress_tdd.swapaxes(1, 2))))

    @property
    def friction_angle_t(self) -> NDArray[np.float64]:
        """The (T,) mobilized angles of friction, asin((s_1 - s_3) / (s_1 + s_3)) of principal stresses s [rad].

        Coulomb's criterion for the steepest plane; nan where a principal stress is a tension.
        """
        most, least = -self.principal_stress_td[:, 0], -self.principal_stress_td[:, -1]
        valid = (least >= 0.0) & (most > 0.0)
        ratio = (most - least) / np.where(valid, most + least, 1.0)
        return np.asarray(np.where(valid, np.arcsin(np.clip(ratio, -1.0, 1.0)), np.nan))

    def conditions(self) -> tuple[Condition, ...]:
        """Return what is to be met: the missing stress of each component that is held, over the scale, in the mean."""
        if not len(self.stress_tdd):
            return ()
        hint = "a lower rate, a shorter answer, more dashpots" if self.rate else "a looser force_tolerance"
        return self.asked.conditions(self.stress_tdd.mean(axis=0), self.tolerance, hint)

    @property
    def flows(self) -> bool:
        """Whether the box was deformed in time."""
        return self.rate > 0.0

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, deformed {'in time' if self.rate else 'quasistatically'}"

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values."""
        found = {**super().to_dict(), "rate": self.rate, "rearrangements": self.rearrangements}
        if len(self.strain_tdd):
            for (i, j), name in self.component_names.items():
                found[f"strain_{name}"] = float(self.strain_tdd[-1, i, j])
                found[f"stress_{name}"] = float(self.stress_tdd[-1, i, j])
            found["packing_fraction"] = float(self.packing_fraction_t[-1])
            found["friction_angle"] = float(self.friction_angle_t[-1])
        return found

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        found = self.outcome_rows()
        if not len(self.strain_tdd):
            return found
        loaded = self.loaded_component
        if loaded is not None:
            place = next(at for at, name in self.component_names.items() if name == loaded)
            reached, end = self.strain_tdd[-1][place], self.asked.strain[place]
            words = f"strain {reached:.6g}, stress {self.stress_tdd[-1][place]:.6g}"
            note = f"[1], [energy/length^{self.packing.dimension}]; a strain of {end:g} was asked for"
            found.append((f"loaded: {loaded}", words, note))
        for place, name in self.component_names.items():
            held = place in self.asked.stress
            mean, spread = (float(part(self.stress_tdd[:, *place])) for part in (np.mean, np.std))
            strain, stress = f"{self.strain_tdd[-1][place]:.6g}", f"{self.stress_tdd[-1][place]:.6g}"
            found.append((f"strain {name}", strain, "free" if held else "given"))
            found.append(
                (
                    f"stress {name}",
                    stress,
                    f"held at {self.asked.stress[place]:g}: {mean:.4g} +- {spread:.1g}" if held else "",
                )
            )
        return [
            *found,
            ("packing fraction", f"{self.packing_fraction_t[-1]:.6f}", "overlaps counted twice"),
            ("friction angle", f"{np.degrees(self.friction_angle_t[-1]):.2f}", "mobilized at the end [degrees]"),
            *self._residual_rows(),
        ]

    def table(self) -> Table:
        """Return the rows as columns."""
        columns: dict[str, Any] = {}
        for (i, j), name in self.component_names.items():
            columns[f"strain_{name}"] = self.strain_tdd[:, i, j]
            columns[f"stress_{name}"] = self.stress_tdd[:, i, j]
        rest = ("packing_fraction", "contacts", "residual")
        columns |= {name: getattr(self, f"{name}_t") for name in rest}
        density = f"energy/length^{self.packing.dimension}"
        return make_table(
            columns, self.about(), {name: density if name.startswith("stress") else "1" for name in columns}
        )

    @property
    def loaded_component(self) -> str | None:
        """Name of the component with the largest of the given strains; None where only stresses were asked for."""
        size_dd = np.abs(self.asked.end_dd)
        return self.component_names[divmod(int(size_dd.argmax()), len(size_dd))] if size_dd.any() else None

    @property
    def component_names(self) -> dict[tuple[int, int], str]:
        """Names of the components by row and column."""
        d = self.packing.dimension
        return {(i, j): _AXES[i] + _AXES[j] for i in range(d) for j in range(i, d)}


class _Rows:
    """What a run keeps: strain, stress, packing fraction, contacts and residual."""

    def __init__(self, control: Control) -> None:
        self.control = control
        self.began = time.process_time()
        self.rows: list[tuple[Any, ...]] = []
        self.strain_dd = np.zeros((control.dimension, control.dimension))

    def columns(self) -> dict[str, Any]:
        """Return the rows by columns."""
        d = self.control.dimension
        strain, stress, fraction, contacts, residual = zip(*self.rows, strict=True) if self.rows else ([],) * 5
        return {
            "strain_tdd": np.array(strain).reshape(-1, d, d),
            "stress_tdd": np.array(stress).reshape(-1, d, d),
            "packing_fraction_t": np.array(fraction, dtype=np.float64),
            "contacts_t": np.array(contacts, dtype=np.int64),
            "residual_t": np.array(residual, dtype=np.float64),
            "asked": self.control,
        }

    def end(self) -> tuple[Condition, ...]:
        """Return how far the given strains came."""
        return tuple(
            Condition(f"strain {_AXES[i] + _AXES[j]}", float(self.strain_dd[i, j]), goal, 1e-9)
            for (i, j), goal in self.control.strain.items()
            if goal != 0.0
        )


def _judged(run: Deformation) -> Deformation:
    """Return a run that came to its end, judged by its conditions."""
    unmet = tuple(one for one in run.conditions() if not one.met)
    return replace(run, outcome=Outcome.NOT_AT_PRESSURE, unmet=unmet) if unmet else run


@honors("repulsion kinds links shapes", at_rest=True)
def deform(
    scene: Scene,
    *,
    strain: Mapping[str, float] = {},  # noqa: B006 - read only
    stress: Mapping[str, float] = {},  # noqa: B006 - read only
    steps: int = 50,
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Deformation:
    """Return the run of a jammed packing whose box is deformed quasistatically, component by component.

    The packing goes to the stresses that are held first, and then in equal steps to the strains, in equilibrium after
    each, as in `quasistatic_shear`: on along its linear response and by Newton's method where it goes on smoothly, and
    downhill where it falls. Components are "xx", "yy", "xy" and so on; "xy" is a shear that carries x along y. Those
    that neither mapping names keep their strain.

    It takes minutes: at a pressure of 1e-2, in 20 steps, the stresses across held, a compression of 100 discs by 0.1
    took 75 CPU s (18 falls), of 100 spheres by 0.05 40 CPU s (6 falls), of 400 discs by 0.02 106 CPU s (14 falls). At
    1e-4 packings fall more often: 100 discs came to 0.06 in 500 CPU s (74 falls). `time_limit` ends it at what was
    reached.

    Parameters
    ----------
    scene
        The scene of a jammed packing at rest, without friction.
    strain
        Strains at the end, as `Deformation.strain_tdd` counts them: logarithmic ones along the axes, a side L becomes L
        exp(strain), which no strain turns inside out [1].
    stress
        Cauchy stresses that are held, tension positive, in the units of `stress_tensor` [energy/length^d]: the pressure
        p of `jam` is -p times `scene.pressure_unit`.
    steps
        Number of steps of strain, at the end of each of which there is a row.
    force_tolerance
        Net force over mean contact force, and missing stress over the largest one held, that count as balance [1]; the
        floor of rounding also counts.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress("deformation", figures) after each step.
    check
        Raise NotConverged when the packing does not come to rest; otherwise return what there is.

    Returns
    -------
    Deformation
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
    >>> scene = scene.replace(packing=pm.jam(scene, pressure=1e-2).packing)
    >>> side = float(pm.stress_tensor(scene)[0, 0])
    >>> run = pm.deform(scene, strain={"yy": -1e-3}, stress={"xx": side}, steps=2)
    >>> bool(abs(run.stress_tdd[-1, 0, 0] / side - 1.0) < 1e-8), bool(run.strain_tdd[-1, 0, 0] > 0.0)
    (True, True)

    """
    control = _control(scene, strain, stress)
    no_own_images("scene.packing", scene.packing)
    integer("steps", steps, at_least=1, bytes_each=8.0)
    tolerance = positive("force_tolerance", force_tolerance)
    check_jammed(scene)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    still = _AtRest(Protocol(scene, "free", tolerance, loop), control, steps)
    with single_thread():
        return loop.run(still.through, still.finish)


class _AtRest:
    """A packing on its way at rest."""

    def __init__(self, protocol: Protocol, control: Control, steps: int) -> None:
        self.protocol, self.control, self.steps = protocol, control, steps
        d = control.dimension
        protocol.basis_kdd = np.array([np.outer(*np.eye(d)[list(place)]) for place in control.stress]).reshape(-1, d, d)
        self.kept = _Rows(control)
        self.falls = self.iterations = 0

    def through(self) -> Outcome:
        """Go to the stresses, then through all strains."""
        protocol, control = self.protocol, self.control
        load = None
        if control.stress:
            # components that are not held have no part in the load: they bear what they bear now
            now_dd = stress_tensor(protocol.scene)
            load = Load.of(now_dd - control.missing(now_dd) - np.triu(control.missing(now_dd), 1).T)
            outcome = PressurePath(protocol).go(load.pressure / protocol.scene.pressure_unit, load.rest_dd)
            if not outcome.ok:
                return outcome
            self._follow(protocol.scene.packing.box.lattice_dd, protocol.last.box.lattice_dd)
            protocol.scene = protocol.scene.replace(packing=protocol.last)
        path = StrainPath(protocol, StrainedLattice(control.end_dd), load)
        if not path.sound:
            return Outcome.STALLED
        self._keep(path)
        goals = np.linspace(0.0, 1.0, self.steps + 1)[1:] if control.end_dd.any() else np.zeros(0)
        for goal in goals.tolist():
            while path.now.strain != goal:
                before = path.now.packing.box.lattice_dd
                _, fallen = path.step(goal)
                self._follow(before, path.now.packing.box.lattice_dd)
                self.iterations = path.iterations
                if fallen is not None:
                    self.falls += 1
                    if fallen.pressure <= 0.0 or not fallen.pairs:
                        self._keep(path)
                        return Outcome.UNJAMMED
                    if not path.sound:
                        return Outcome.STALLED
            self._keep(path)
            protocol.loop.report(STAGE, strain=self.kept.strain_dd, stress=self.kept.rows[-1][1], packing=protocol.last)
        return Outcome.FINISHED

    def _follow(self, before_dd: NDArray[np.float64], after_dd: NDArray[np.float64]) -> None:
        """Count the strain between two lattices, that of given components exactly."""
        self.kept.strain_dd = self.kept.strain_dd + np.triu(logm(after_dd @ np.linalg.inv(before_dd)).real)

    def _keep(self, path: StrainPath) -> None:
        one, scene = path.now, self.protocol.scene
        packing = self.protocol.last = self.protocol.restored(one.packing)
        given = np.array(list(self.control.strain), dtype=np.int64).reshape(-1, 2).T
        self.kept.strain_dd[tuple(given)] = one.strain * self.control.end_dd[tuple(given)]
        stress_dd = stress_tensor(scene.replace(packing=packing))
        contacts = len(touching_pairs(packing))
        self.kept.rows.append(
            (self.kept.strain_dd.copy(), stress_dd, packing_fraction(packing), contacts, one.residual)
        )

    def _held(self) -> tuple[Condition, ...]:
        """Return what is missing of the stresses where the run stands."""
        stress_dd = stress_tensor(self.protocol.scene.replace(packing=self.protocol.last))
        return self.control.conditions(stress_dd, max(self.protocol.force_tolerance, 1e-7), "a stress it can bear")

    def finish(self, outcome: Outcome) -> Deformation:
        """Return the run as far as it came."""
        protocol, seconds = self.protocol, time.process_time() - self.kept.began
        columns = self.kept.columns()
        residual = float(columns["residual_t"].max()) if self.kept.rows else math.nan
        note = f"{len(self.kept.rows)} equilibria"
        run = Deformation(
            packing=protocol.last.replace(box=protocol.last.box.reduced()[0]).wrapped(),
            outcome=outcome,
            residual=residual,
            steps=self.iterations,
            force_evaluations=self.iterations,
            seconds=seconds,
            stages=(*protocol.stages, Stage(STAGE, residual, self.iterations, self.iterations, seconds, note)),
            unmet=unmet_conditions(outcome, *self._held(), *self.kept.end()),
            tolerance=max(protocol.force_tolerance, 1e-7),
            rearrangements=self.falls,
            **columns,
        )
        return _judged(run) if outcome is Outcome.FINISHED else run


@honors("repulsion kinds damping friction rolling bonds interactions drag noise shapes")
def deform_at_rate(
    scene: Scene,
    *,
    rate: float,
    strain: Mapping[str, float],
    stress: Mapping[str, float] = {},  # noqa: B006 - read only
    answer: float = 3.0,
    stress_tolerance: float = 0.02,
    dt: float | None = None,
    ledger: bool = False,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Deformation:
    """Return the run of a packing whose box is deformed in time, component by component, with friction or without.

    Given strains grow at constant rates. Each component of the stress that is held has a strain that follows it: its
    rate is that of the missing stress over (answer tau K) with the stiffness k of a contact, K = k d^(2 - dim) and
    tau = sqrt(m / k) of the mean mass, and a part in proportion to the integral of the missing stress, over twenty
    times answer tau, so that nothing stays missing where it strains on and on. The box goes to the stresses first, with
    the given strains at rest. Other components keep their strain; components are those of `deform`. Velocities are
    peculiar ones; nothing is thermostatted: dashpots and friction take what the deformation puts in.

    Triaxial compression: `strain={"zz": -0.2}, stress={"xx": -p, "yy": -p}`; direct shear under a normal stress:
    `strain={"xy": 1.0}, stress={"yy": -p}`.

    Parameters
    ----------
    scene
        The scene, without rigid links, of a packing near the stresses: as `jam` leaves it with `pm.Press`.
    rate
        Rate of the largest of the given strains [1/time].
    strain
        Strains at the end, as `Deformation.strain_tdd` counts them, one of them not 0 [1].
    stress
        Cauchy stresses that are held, tension positive, in the units of `stress_tensor` [energy/length^d]: the pressure
        p of `jam` is -p times `scene.pressure_unit`.
    answer
        Time in which a box as stiff as a contact follows the stress, and between looks at it [tau].
    stress_tolerance
        Largest missing stress over the largest one held, in the mean over the run, at which it counts as held [1].
    dt
        Time step; a tenth of the shortest time of a contact unless given.
    ledger
        Account for the energy, as `simulate` does: `run.ledger`, with figures whenever the stress is looked at. Not
        with thermal noise.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures).
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    Deformation
        Outcome.FINISHED; Outcome.NOT_AT_PRESSURE where a stress was not held.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If it is no success and `check` is set; its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.run` set to what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(60, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    >>> effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.5), pm.Friction(0.5, damping=0.1))
    >>> pressed = pm.jam(pm.Scene(start, effects), pressure=1e-2, method=pm.Press(rate=1e-3))
    >>> scene = pm.Scene(pressed.packing, effects)
    >>> side = -1e-2 * scene.pressure_unit
    >>> run = pm.deform_at_rate(scene, rate=1e-4, strain={"yy": -0.02}, stress={"xx": side})
    >>> bool(run.stress_tdd[-1, 1, 1] < -1.2e-2), run.outcome.name
    (True, 'FINISHED')

    """
    control = _control(scene, strain, stress)
    refuse_misfits(scene)
    if not any(control.strain.values()):
        raise ValueError("strain must name a component that is not 0, got none")
    if scene.packing.links:
        raise ValueError(f"scene.packing must have no rigid links, got {len(scene.packing.links)}")
    positive("rate", rate), positive("answer", answer)
    boolean("ledger", ledger)
    tolerance = positive("stress_tolerance", stress_tolerance)
    step = choose_time_step(scene, _STEP) if dt is None else positive("dt", dt)
    check_steps("strain / rate", max(map(abs, control.strain.values())) / rate, step)
    moving = _InTime(scene, control, rate, answer, step, ledger)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    return loop.run(lambda: moving.through(loop, tolerance), lambda outcome: moving.finish(outcome, tolerance))


class _InTime:
    """A packing on its way through time, span by span."""

    def __init__(self, scene: Scene, control: Control, rate: float, answer: float, dt: float, ledger: bool) -> None:
        self.control, self.rate = control, rate
        self.kept = _Rows(control)
        packing = scene.packing
        stiff = stiffness_and_damping(scene)[0]
        self.tau = math.sqrt(float(packing.mass_n.mean()) / stiff)
        self.time = answer * self.tau
        # rate of strain over a missing stress
        self.follow = 1.0 / (self.time * stiff * float(packing.diameter_n.mean()) ** (2 - control.dimension))
        self.direction_dd = control.end_dd * (rate / np.abs(control.end_dd).max())
        self.whole = float(np.abs(control.end_dd).max()) / rate
        self.spans = Spans(scene, dt, ledger=ledger)
        self.volume = packing_fraction(packing) * packing.box.volume
        # of the missing stress over time, over the time of its memory
        self.integral_dd = np.zeros((control.dimension, control.dimension))
        self.stages: list[Stage] = []
        self.goals = control.strain

    def through(self, loop: RunLoop, tolerance: float) -> Outcome:
        """Go to the stresses, then through all strains."""
        spans, control = self.spans, self.control
        scale = control.scale
        span = max(1, int(self.time / spans.dt))
        if control.stress:
            held, still = 0, np.zeros_like(self.direction_dd)
            for _ in range(_SPANS):
                missing = float(np.abs(control.missing(spans.stress_dd)).max())
                held = held + 1 if missing <= tolerance * scale else 0
                if held == _HELD:
                    break
                if not self._advance(still, span, scale):
                    return Outcome.STEP_TOO_LONG
                self._report(loop, APPROACH)
            else:
                return Outcome.NOT_AT_PRESSURE
            note = f"missing stress {missing / scale:.1e} of the largest"
            self.stages.append(Stage(APPROACH, spans.residual, spans.steps, spans.steps, self._seconds(), note))
        self._keep()
        steps = math.ceil(self.whole / spans.dt * (1.0 - 1e-12))
        direction_dd = self.direction_dd * (self.whole / (steps * spans.dt))
        most = max(1, int(min(span, _STRAIN / (self.rate * spans.dt))))
        for left in range(steps, 0, -most):
            if not self._advance(direction_dd, min(most, left), scale):
                return Outcome.STEP_TOO_LONG
            self._keep()
            self._report(loop, STAGE)
        return Outcome.FINISHED

    def _advance(self, given_dd: NDArray[np.float64], steps: int, scale: float) -> bool:
        """Take a span of steps at the rates that are given, and at those that answer to missing stress."""
        time_taken, most = steps * self.spans.dt, _LARGEST * scale
        missing = self.control.missing(self.spans.stress_dd)
        # the integral does not grow while strains go as fast as they may, and always falls
        counted = np.where((np.abs(missing) < most) | (missing * self.integral_dd < 0.0), missing, 0.0)
        grown = self.integral_dd + np.clip(counted, -most, most) * (time_taken / (_MEMORY * self.time))
        self.integral_dd = np.clip(grown, -most, most)
        gradient_dd = given_dd - self.follow * (np.clip(missing, -most, most) + self.integral_dd)
        # the deformation gradient of a span is 1 + time rate, that of a constant velocity gradient its exponential
        whole_dd = expm(time_taken * gradient_dd)
        if not self.spans.advance((whole_dd - np.eye(len(whole_dd))) / time_taken, steps):
            return False
        self.kept.strain_dd = self.kept.strain_dd + time_taken * gradient_dd
        return True

    def _seconds(self) -> float:
        return time.process_time() - self.kept.began

    def _report(self, loop: RunLoop, stage: str) -> None:
        loop.check_time()
        figures: dict[str, Any] = {"strain": self.kept.strain_dd, "stress": self.spans.stress_dd}
        if loop.watched:
            figures["packing"] = self.spans.scene.packing
        loop.report(stage, **figures)

    def _keep(self) -> None:
        spans = self.spans
        fraction = self.volume / spans.scene.packing.box.volume
        self.kept.rows.append((self.kept.strain_dd, spans.stress_dd, fraction, spans.contacts, spans.residual))

    def finish(self, outcome: Outcome, tolerance: float) -> Deformation:
        """Return the run as far as it came; where it came to its end, judged by its conditions."""
        spans, seconds = self.spans, self._seconds()
        before = self.stages[0].steps if self.stages else 0
        spent = self.stages[0].seconds if self.stages else 0.0
        steps = spans.steps - before
        run = Deformation(
            packing=spans.scene.packing,
            outcome=outcome,
            residual=spans.residual,
            steps=spans.steps,
            force_evaluations=spans.steps,
            seconds=seconds,
            stages=(*self.stages, Stage(STAGE, spans.residual, steps, steps, seconds - spent, "")),
            unmet=unmet_conditions(
                outcome,
                *spans.limits(),
                *self.control.conditions(spans.stress_dd, tolerance, "a start nearer to it, more dashpots"),
                *self.kept.end(),
            ),
            rate=self.rate,
            tolerance=tolerance,
            ledger=spans.ledger,
            **self.kept.columns(),
        )
        return _judged(run) if outcome is Outcome.FINISHED else run
