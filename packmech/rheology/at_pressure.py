"""Steady shear at constant pressure: the box dilates as its contents ask for."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import value_with_error
from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import boolean, check_steps, instance, integer, positive, real, two_axes
from packmech.dynamics.engine import refuse_misfits
from packmech.dynamics.integrators import choose_time_step, stiffness_and_damping
from packmech.dynamics.ledger import EnergyLedger
from packmech.dynamics.spans import Spans
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.counting import packing_fraction
from packmech.measure.signals import block_drift, block_mean
from packmech.result import Condition, Outcome, Row, Run, Stage, unmet_conditions
from packmech.scene import Scene

# time between two looks at the stress, over that of a contact, and most strain between them
_SPAN, _STRAIN = 10.0, 0.01
# largest excess of the pressure that the box answers to, over the pressure
_SHOCK = 10.0
# fraction of the shortest time of a contact that a step takes
_STEP = 0.1
# what a start that nothing presses shrinks by along each axis, over what it shears by; looks over which the pressure of
# a loose start is averaged, and part of the one asked for at which it is loose no more
_SHRINK, _LOOKS, _BORNE = 0.3, 10, 0.8
# errors beyond which a difference is one
_SURE = 3.0
STAGE = "shear at constant pressure"


@dataclass(frozen=True, eq=False, repr=False)
class PressureShear(Run):
    """A run of steady shear at constant pressure.

    Attributes
    ----------
    rate, pressure
        The shear rate [1/time], and the pressure that was asked for [energy/length^d].
    strain_t
        (T,) shear strains [1].
    shear_stress_t, pressure_t
        (T,) stresses, kinetic parts included [energy/length^d].
    packing_fraction_t
        (T,) packing fractions, overlaps counted twice [1].
    contacts_t, sliding_t
        (T,) touching pairs, and those of them at the Coulomb limit.
    steady_t
        (T,) which of these count as steady.
    blocks
        Into so many blocks the steady part is cut for errors.
    tolerance
        Largest error of the mean pressure over the one asked for, and largest drift (`conditions`) [1].
    approach
        Strain up to which the box only shrank, as nothing bore the pressure yet [1].
    ledger
        Where the energy went, if it was asked for.

    """

    rate: float = 0.0
    pressure: float = 0.0
    strain_t: NDArray[np.float64] = None  # type: ignore[assignment]
    shear_stress_t: NDArray[np.float64] = None  # type: ignore[assignment]
    pressure_t: NDArray[np.float64] = None  # type: ignore[assignment]
    packing_fraction_t: NDArray[np.float64] = None  # type: ignore[assignment]
    contacts_t: NDArray[np.int64] = None  # type: ignore[assignment]
    sliding_t: NDArray[np.int64] = None  # type: ignore[assignment]
    steady_t: NDArray[np.bool_] = None  # type: ignore[assignment]
    blocks: int = 8
    tolerance: float = 0.1
    approach: float = 0.0
    ledger: EnergyLedger | None = None

    @property
    def inertial_number(self) -> float:
        """Rate sqrt(m / (p d^(dim - 2))) with the mean mass and diameter and the mean pressure p that was measured [1].

        nan where there is no mean, or nothing pressed. da Cruz et al., Phys. Rev. E 72, 021309 (2005).
        """
        packing, pressure = self.packing, self.mean(self.pressure_t)[0]
        size = float(packing.diameter_n.mean()) ** (packing.dimension - 2)
        return float(self.rate * math.sqrt(packing.mass_n.mean() / (pressure * size))) if pressure > 0.0 else math.nan

    def mean(self, value_t: NDArray[np.float64]) -> tuple[float, float]:
        """Return the mean of a signal over the steady part and its error by blocks; nan where it is too short."""
        steady = np.asarray(value_t, dtype=np.float64)[self.steady_t]
        return block_mean(steady, self.blocks) if len(steady) >= 2 * self.blocks else (math.nan, math.nan)

    def conditions(self) -> tuple[Condition, ...]:
        """Return what a steady flow at the pressure asked for meets; where it is too short for means, that alone.

        The mean pressure lies within `tolerance` plus its error of the one asked for, and its error is at most
        `tolerance` times the pressure asked for. Between the two halves of the steady part, pressure and shear stress
        change by no more than `tolerance` times the mean pressure plus three errors, and the packing fraction by no
        more than `tolerance` times the void fraction plus three errors; these errors count up to twice as much.
        """
        mean, error = self.mean(self.pressure_t)
        if not math.isfinite(mean):
            looks = int(np.count_nonzero(self.steady_t))
            hint = "a longer applied_strain, or fewer blocks"
            return (Condition("samples that the steady part lacks", 2 * self.blocks - looks, 0, hint=hint),)
        asked = self.pressure
        found = [
            Condition("pressure", mean, asked, self.tolerance + min(error / asked, self.tolerance)),
            Condition("error of the pressure", error, self.tolerance * asked),
        ]
        void = 1.0 - self.mean(self.packing_fraction_t)[0]
        for name, value_t, scale in (
            ("pressure", self.pressure_t, abs(mean)),
            ("shear stress", self.shear_stress_t, abs(mean)),
            ("packing fraction", self.packing_fraction_t, void),
        ):
            change, error = block_drift(value_t[self.steady_t], self.blocks)
            least = self.tolerance * scale
            found.append(Condition(f"drift of the {name}", abs(change), least + min(_SURE * error, 2.0 * least)))
        return tuple(found)

    @property
    def time_t(self) -> NDArray[np.float64]:
        """The (T,) times since the start [time]."""
        return self.strain_t / self.rate

    @property
    def stress_ratio(self) -> tuple[float, float]:
        """Mean shear stress over the mean pressure, and its error [1]."""
        stress, error = self.mean(self.shear_stress_t)
        pressure = self.mean(self.pressure_t)[0]
        return stress / pressure, error / pressure

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values."""
        means = {
            "stress_ratio": self.stress_ratio,
            "packing_fraction": self.mean(self.packing_fraction_t),
            "mean_pressure": self.mean(self.pressure_t),
            "mean_contacts": self.mean(2.0 * self.contacts_t / self.packing.particles),
        }
        errors = {f"{name}_error": error for name, (_, error) in means.items()}
        asked = {"rate": self.rate, "pressure_asked": self.pressure, "inertial_number": self.inertial_number}
        return {**super().to_dict(), **asked, **{name: value for name, (value, _) in means.items()}, **errors}

    @property
    def flows(self) -> bool:
        """True: the box shears on and on."""
        return True

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, sheared at constant pressure"

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        numbers = self.to_dict()
        named = (
            ("stress over pressure", "stress_ratio", "their means"),
            ("packing fraction", "packing_fraction", "overlaps counted twice"),
            ("pressure", "mean_pressure", f"asked for {self.pressure:g}"),
            ("contacts a particle", "mean_contacts", ""),
        )
        return [
            *self.outcome_rows(),
            ("inertial number", f"{self.inertial_number:.4g}", f"at the rate {self.rate:g} and the pressure measured"),
            *((words, value_with_error(numbers[name], numbers[name + "_error"]), what) for words, name, what in named),
        ]


@honors("repulsion kinds damping friction rolling bonds interactions drag noise shapes")
def shear_at_pressure(
    scene: Scene,
    *,
    rate: float,
    pressure: float,
    applied_strain: float = 5.0,
    skip_strain: float = 1.0,
    blocks: int = 8,
    axes: tuple[int, int] = (0, 1),
    answer: float = 10.0,
    pressure_tolerance: float = 0.1,
    dt: float | None = None,
    ledger: bool = False,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> PressureShear:
    """Return a run of steady shear in a box whose volume follows the pressure.

    The box shears at a constant rate, x along y, and dilates at the rate e = (p - P) / (answer tau K) with the pressure
    p of the moment, kinetic parts included, the pressure P asked for, the stiffness k of a contact, K = k d^(2 - dim)
    and tau = sqrt(m / k) of the mean mass; p - P counts up to 10 P. It is a barostat without mass, which has the mean
    pressure right where everything is steady. A loose start shrinks along each axis by .3 (1 - p / P) of what it
    shears, with the mean p over ten looks, until that is .8 P (`approach`). A start that is too dense takes a time of
    answer tau (K / P) times what is missing of ln V: begin near the packing fraction to come, or skip more strain where
    rates are high. Stress is looked at every 10 tau or every hundredth of strain. Velocities are peculiar ones, as in
    `ramp_strain`; nothing is thermostatted: dashpots and friction take what shear puts in.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    rate
        Shear rate [1/time].
    pressure
        The pressure [energy/length^d].
    applied_strain, skip_strain
        How far the shear goes, and how much of it is not yet steady and does not count [1].
    blocks
        The strain that counts is cut into so many blocks, whose means give the errors.
    axes
        Direction of the flow, and of its gradient.
    answer
        Time in which a box as stiff as a contact follows the pressure [tau]. Means do not depend on it.
    pressure_tolerance
        Largest error of the mean pressure over the one asked for, and largest drift, at which the flow counts as steady
        at its pressure (`PressureShear.conditions`) [1].
    dt
        Time step; a tenth of the shortest time of a contact unless given.
    ledger
        Account for the energy, as `simulate` does: `run.ledger`, with figures whenever the stress is looked at, from
        the start on, whatever `skip_strain` is. Of a start with overlaps most of the energy is that of these: go on
        from `run.packing`. Not with thermal noise.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures).
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    PressureShear
        Signals over the strain, and means over its steady part with their errors. Outcome.NOT_AT_PRESSURE where the
        mean pressure is another one, Outcome.NOT_STEADY where anything drifts or errors are too large to tell.

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
    >>> packing = pm.random_packing(60, dimension=2, packing_fraction=0.8, seed=1)
    >>> effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.5))
    >>> run = pm.shear_at_pressure(pm.Scene(packing, effects), rate=3e-3, pressure=1e-3, applied_strain=10.0)
    >>> mean, error = run.mean(run.pressure_t)
    >>> bool(abs(mean - 1e-3) < 3.0 * error), bool(0.1 < run.stress_ratio[0] < 0.6)
    (True, True)

    """
    instance("scene", scene, Scene)
    refuse_misfits(scene)
    if scene.packing.links:
        raise ValueError(f"scene.packing must have no rigid links, got {len(scene.packing.links)}")
    positive("rate", rate), positive("pressure", pressure), positive("answer", answer)
    end = positive("applied_strain", applied_strain)
    skip = real("skip_strain", skip_strain, at_least=0.0, below=end)
    integer("blocks", blocks, at_least=2)
    boolean("ledger", ledger)
    tolerance = positive("pressure_tolerance", pressure_tolerance)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)
    step = choose_time_step(scene, _STEP) if dt is None else positive("dt", dt)
    check_steps("applied_strain / rate", end / rate, step)
    shearing = _PressureShearing(scene, rate, pressure, pair, answer, step, ledger)
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))

    def finished(outcome: Outcome) -> PressureShear:
        return shearing.finish(outcome, skip, blocks, tolerance)

    return loop.run(lambda: shearing.until(end, loop), finished)


class _PressureShearing:
    """A box on its way, span by span."""

    def __init__(
        self,
        scene: Scene,
        rate: float,
        pressure: float,
        axes: tuple[int, int],
        answer: float,
        dt: float,
        ledger: bool,
    ) -> None:
        self.began = time.process_time()
        self.rate, self.pressure, self.axes = rate, pressure, axes
        packing = scene.packing
        d = packing.dimension
        stiff = stiffness_and_damping(scene)[0]
        tau = math.sqrt(float(packing.mass_n.mean()) / stiff)
        # rate of dilation over a missing pressure
        self.follow = 1.0 / (answer * tau * stiff * float(packing.diameter_n.mean()) ** (2 - d))
        self.steps_of_span = max(1, int(min(_SPAN * tau, _STRAIN / rate) / dt))
        self.spans = Spans(scene, dt, ledger=ledger)
        self.volume = packing_fraction(packing) * packing.box.volume
        self.rows: list[tuple[float, ...]] = []
        # the strain at the end, and that at which something bore the pressure
        self.goal, self.approach = math.inf, 0.0
        self.borne = 0.0
        self.approaching = self.spans.pressure < _BORNE * pressure

    def until(self, strain: float, loop: RunLoop) -> Outcome:
        """Shear up to a strain."""
        self.goal = strain
        spans = math.ceil(strain / (self.rate * self.spans.dt * self.steps_of_span) * (1.0 - 1e-12))
        d = self.spans.scene.packing.dimension
        for _ in range(spans):
            loop.check_time()
            # overlaps of a start open the box no faster than this
            missing = min(self.spans.pressure - self.pressure, _SHOCK * self.pressure)
            self._approach()
            shrink = _SHRINK * self.rate * min(self.borne / self.pressure - 1.0, 0.0)
            rate_dd = np.eye(d) * (shrink if self.approaching else self.follow * missing)
            rate_dd[self.axes] += self.rate
            if not self.spans.advance(rate_dd, self.steps_of_span):
                return Outcome.STEP_TOO_LONG
            self._keep()
            figures: dict[str, Any] = {
                "strain": self.rows[-1][0],
                "stress": self.rows[-1][1],
                "packing_fraction": self.rows[-1][3],
            }
            if loop.watched:
                figures["packing"] = self.spans.scene.packing
            loop.report(STAGE, **figures)
        return Outcome.FINISHED

    def _approach(self) -> None:
        """Find whether the start is still loose: the barostat would take long where little presses."""
        if self.approaching:
            recent = [row[2] for row in self.rows[-_LOOKS:]]
            # a random start may touch hard for a moment: what presses is known from several looks
            self.borne = float(np.mean(recent)) if recent else self.spans.pressure
            self.approaching = len(recent) < _LOOKS or self.borne < _BORNE * self.pressure
            self.approach = self.rows[-1][0] if self.rows else 0.0

    def _keep(self) -> None:
        spans = self.spans
        fraction = self.volume / spans.scene.packing.box.volume
        strain = spans.steps * spans.dt * self.rate
        stress = spans.shear_stress(self.axes)
        self.rows.append((strain, stress, spans.pressure, fraction, spans.contacts, spans.sliding))

    def finish(self, outcome: Outcome, skip: float, blocks: int, tolerance: float) -> PressureShear:
        """Return the run as far as it came; where it came to its end, judged by its `conditions`."""
        spans = self.spans
        seconds = time.process_time() - self.began
        # spans end a little beyond the strain asked for
        reached = min(spans.steps * spans.dt * self.rate, self.goal)
        strain, stress, pressure, fraction, contacts, sliding = np.array(self.rows).reshape(-1, 6).T.copy()
        run = PressureShear(
            packing=spans.scene.packing,
            outcome=outcome,
            residual=spans.residual,
            steps=spans.steps,
            force_evaluations=spans.steps,
            seconds=seconds,
            stages=(Stage(STAGE, spans.residual, spans.steps, spans.steps, seconds, ""),),
            rate=self.rate,
            pressure=self.pressure,
            strain_t=strain,
            shear_stress_t=stress,
            pressure_t=pressure,
            packing_fraction_t=fraction,
            contacts_t=contacts.astype(np.int64),
            sliding_t=sliding.astype(np.int64),
            steady_t=strain > skip * (1.0 + 1e-12),
            blocks=blocks,
            tolerance=tolerance,
            approach=self.approach,
            ledger=spans.ledger,
        )
        if outcome is not Outcome.FINISHED:
            end = Condition("shear strain", reached, self.goal, 1e-12)
            return replace(run, unmet=unmet_conditions(outcome, *self.spans.limits(), end))
        unmet = tuple(one for one in run.conditions() if not one.met)
        if unmet:
            off = unmet[0].name == "pressure"
            outcome = Outcome.NOT_AT_PRESSURE if off else Outcome.NOT_STEADY
        return replace(run, outcome=outcome, unmet=unmet)
