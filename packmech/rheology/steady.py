"""Strain at a constant rate (shear, compression, the flow curve), and creep at a constant stress."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import check_steps, integer, one_of, positive, real, two_axes
from packmech.dynamics.deformation import MODES, Ramp, SteadyStrain
from packmech.dynamics.integrators import stiffness_and_damping
from packmech.dynamics.observables import tensors
from packmech.measure.counting import packing_fraction
from packmech.measure.signals import block_drift, block_mean
from packmech.result import Condition, NotConverged, Outcome, Row, Summary, particles_in_words
from packmech.rheology.arguments import (
    SAMPLE_BYTES,
    Common,
    Several,
    SeveralRuns,
    StrainSettings,
    check_arguments,
    listed,
    listed_numbers,
    run_each,
)
from packmech.rheology.strain_run import StrainPlan, StrainRun, StrainTask
from packmech.scene import Scene

STAGE = "steady strain"
# errors beyond which a change is one
_SURE = 3.0
FLOW_HEADINGS = ("rate", "stress", "+-", "pressure", "+-", "stress/rate", "stress/pressure", "contacts", "sliding")
# arrays of a flow curve, by their names in files
FLOW_COLUMNS = {
    "rates": "rate_r",
    "stresses": "stress_r",
    "stress_errors": "stress_error_r",
    "pressures": "pressure_r",
    "pressure_errors": "pressure_error_r",
    "contacts_per_particle": "contacts_r",
    "sliding_fractions": "sliding_r",
}
_CREEP = "creep"
# creep has come to rest where from this part of the time on it goes on at less than this part of its mean rate
_LAST, _STILL = 0.9, 0.01
# the strain's rate is renewed so often in the shortest time in which a box of this inertia answers
_OFTEN = 0.02
# spans from one call of `progress` to the next
_REPORT = 100


@listed(Common)
@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag noise shapes breaking")
def ramp_strain(
    scene: Scene,
    *,
    rate: float,
    applied_strain: float,
    mode: str = "shear",
    axes: tuple[int, int] = (0, 1),
    samples: int = 200,
    **common: Unpack[Common],
) -> StrainRun:
    """Return a run in which the box deforms at a constant rate, F = 1 + rate t M, up to a strain.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    rate
        Of gamma [1/time]; negative rates compress.
    applied_strain
        Size of gamma at the end, positive [1].
    mode, axes
        "shear" along the first and with the gradient along the second of the axes; "uniaxial" along the first;
        "isotropic".
    samples
        How often figures are kept. Each falls on the end of a step: steps are as long as `dt` at most, and no longer
        than from one to the next. `run.dt` says how long they were.
    dt, method, velocity_nd, spin_nk, held_n, frames, time_limit, progress, checkpoint, check
        As in `oscillatory_shear`; `time_limit` and interrupts keep what was reached.

    Raises
    ------
    TypeError, ValueError, NotConverged, KeyboardInterrupt
        As in `oscillatory_shear`.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),))
    >>> run = pm.ramp_strain(scene, rate=-1e-3, applied_strain=0.01, mode="isotropic")
    >>> bool(run.pressure_t[-1] > 1.9 * run.pressure_t[0]), round(float(run.strain_t[-1]), 12)
    (True, -0.01)

    """
    settings = check_arguments(scene, **common)
    speed, end = real("rate", rate), positive("applied_strain", applied_strain)
    if speed == 0.0:
        raise ValueError("rate must not be zero, got 0.0")
    if one_of("mode", mode, MODES) != "shear" and speed < 0.0 and end >= 1.0:
        raise ValueError(f"applied_strain must be below 1 where the box is compressed, got {end:g}")
    count = integer("samples", samples, at_least=1, bytes_each=SAMPLE_BYTES)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension, different=mode == "shear")
    return _ramp(settings, speed, end, mode, pair, count)


def _ramp(
    settings: StrainSettings,
    rate: float,
    strain: float,
    mode: str,
    axes: tuple[int, int],
    samples: int,
    stage: str = STAGE,
    judge: Callable[[StrainRun], StrainRun] | None = None,
) -> StrainRun:
    duration = strain / abs(rate)
    check_steps("applied_strain / rate", duration, settings.longest)
    every = max(1, math.ceil(duration / (settings.longest * samples) * (1.0 - 1e-12)))
    steps = every * samples
    plan = StrainPlan(
        stage,
        dt=duration / steps,
        steps=steps,
        every=every,
        profile=Ramp(0.0, rate, 0.0, math.inf),
        direction_dd=SteadyStrain(rate, mode=mode, axes=axes).direction(settings.scene.packing.dimension),
        axes=axes if mode == "shear" else (axes[0], axes[0]),
    )
    task = StrainTask(settings, plan)

    def finished(outcome: Outcome) -> StrainRun:
        run = StrainRun(**task.fields(outcome))
        return run if judge is None or outcome is not Outcome.FINISHED else judge(run)

    return task.run(finished)


def _judged(run: StrainRun, skip: float, blocks: int, tolerance: float) -> StrainRun:
    """Return a run that was finished, with the outcome NOT_STEADY where stress or pressure drift over what counts.

    They may change between its halves by three errors and `tolerance` times the larger of both means.
    """
    on = run.strain_t >= skip * (1.0 - 1e-12)
    scale = max(abs(float(run.pressure_t[on].mean())), abs(float(run.shear_stress_t[on].mean())))
    unmet = []
    for name, value_t in (("shear stress", run.shear_stress_t), ("pressure", run.pressure_t)):
        change, error = block_drift(value_t[on], blocks)
        one = Condition(f"drift of the {name}", abs(change), tolerance * scale + _SURE * error)
        if not one.met:
            unmet.append(one)
    return replace(run, outcome=Outcome.NOT_STEADY, unmet=tuple(unmet)) if unmet else run


def _of_bonds(run: StrainRun) -> str:
    """Return how many bonds broke in a run, as the end of a note; nothing where none may."""
    return "" if run.broken_bonds is None else f"; {run.broken_bonds}"


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class FlowCurve(SeveralRuns):
    """Stress against rate in steady shear; errors are those of block means. All are nan where a run did not finish.

    Attributes
    ----------
    rate_r
        (R,) shear rates [1/time].
    stress_r, stress_error_r
        (R,) mean shear stresses [energy/length^d].
    pressure_r, pressure_error_r
        (R,) mean pressures [energy/length^d].
    contacts_r, sliding_r
        (R,) mean numbers of contacts of a particle, and mean parts of the contacts that slide [1].
    runs
        The run at each rate.
    seconds
        CPU time.

    """

    rate_r: NDArray[np.float64]
    stress_r: NDArray[np.float64]
    stress_error_r: NDArray[np.float64]
    pressure_r: NDArray[np.float64]
    pressure_error_r: NDArray[np.float64]
    contacts_r: NDArray[np.float64]
    sliding_r: NDArray[np.float64]
    runs: tuple[StrainRun, ...]
    seconds: float

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of `lines`."""
        return FLOW_HEADINGS if self.bonds_broken is None else (*FLOW_HEADINGS, "bonds broken")

    @property
    def viscosity_r(self) -> NDArray[np.float64]:
        """The (R,) stresses over rates [energy time/length^d]."""
        return np.asarray(self.stress_r / self.rate_r)

    @property
    def stress_ratio_r(self) -> NDArray[np.float64]:
        """The (R,) shear stresses over pressures, the macroscopic friction [1]."""
        return np.asarray(self.stress_r / self.pressure_r)

    def lines(self) -> list[tuple[str, ...]]:
        """Return a row of words for each rate, under `headings`."""
        broken = self.bonds_broken
        return [
            (
                f"{self.rate_r[k]:.4g}",
                f"{self.stress_r[k]:.5g}",
                f"{self.stress_error_r[k]:.2g}",
                f"{self.pressure_r[k]:.5g}",
                f"{self.pressure_error_r[k]:.2g}",
                f"{self.viscosity_r[k]:.5g}",
                f"{self.stress_ratio_r[k]:.4f}",
                f"{self.contacts_r[k]:.3f}",
                f"{self.sliding_r[k]:.1%}",
                *([] if broken is None else [str(broken[k])]),
            )
            for k in range(len(self.rate_r))
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the curve by name, as plain values; stresses in the scene's own units of energy/length^d."""
        packing = self.runs[0].packing
        return {
            "particles": packing.particles,
            "dimension": packing.dimension,
            "packing_fraction": packing_fraction(packing),
            "outcome": self.outcome.name.lower(),
            **{name: getattr(self, column).tolist() for name, column in FLOW_COLUMNS.items()},
            **({} if self.bonds_broken is None else {"bonds_broken": self.bonds_broken}),
            "seconds": self.seconds,
        }

    def summary(self) -> Summary:
        """Return stress and pressure at each rate, and what each run cost, in words."""
        packing = self.runs[0].packing
        title = f"{particles_in_words(packing)} under steady shear"
        unit = self.runs[0].stress_unit
        rows = [
            (
                f"rate {line[0]}",
                f"stress {line[1]} +- {line[2]}",
                f"pressure {line[3]}; {line[8]} slide; {unit}{_of_bonds(run)}" if run.ok else str(NotConverged(run)),
            )
            for line, run in zip(self.lines(), self.runs, strict=True)
        ]
        return Summary(title, tuple(rows), tuple(stage for run in self.runs for stage in run.summary().stages))

    def __repr__(self) -> str:
        text = str(self.summary()).split("\n")
        return "\n".join([f"FlowCurve: {text[0]}", *text[1 : 1 + min(len(self.rate_r), 11)]])


@listed(Several)
@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag noise shapes breaking")
def steady_shear(
    scene: Scene,
    *,
    rates: Sequence[float],
    applied_strain: float = 3.0,
    skip_strain: float = 1.0,
    blocks: int = 8,
    samples: int = 400,
    axes: tuple[int, int] = (0, 1),
    drift_tolerance: float = 0.25,
    check: bool = True,
    **common: Unpack[Several],
) -> FlowCurve:
    """Return the flow curve: mean stress in steady shear at several rates, each from the scene as it is.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    rates
        Shear rates, positive [1/time].
    applied_strain, skip_strain
        How far each shear goes, and how much of it is not yet steady and does not count [1].
    blocks
        The strain that counts is cut into so many blocks, whose means give the errors.
    samples
        How often figures are kept at each rate.
    axes, dt, method, held_n, frames
        As in `oscillatory_shear`; as many frames of each run.
    drift_tolerance
        Largest change of stress and pressure between the halves of what counts, beyond three errors, over the larger of
        their means [1]. Where it is more the run ends with Outcome.NOT_STEADY.
    check
        Raise NotConverged at the first run that does not finish or is not steady; otherwise the place of what does not
        finish is nan in the curve, and `FlowCurve.outcome` says how it ended.
    time_limit
        Stop after so much CPU time for all rates, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures), the stage naming the rate.
    checkpoint
        As in `oscillatory_shear`, one file for all rates: those that were finished are not run again.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If a time step is too long, a flow is not steady or time is up, and `check` is set; its `.run` holds that run,
        its `.finished` the curve of the rates before, or None.
    KeyboardInterrupt
        Passed on with `.run` set to the curve of the rates that were finished, or None.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.5)))
    >>> curve = pm.steady_shear(scene, rates=[0.1, 0.2], applied_strain=2.0)
    >>> curve.stress_r.shape, bool((curve.pressure_r > 0).all())
    ((2,), True)

    """
    began = time.process_time()
    speeds = listed_numbers("rates", rates, "shear rates")
    end = positive("applied_strain", applied_strain)
    skip = real("skip_strain", skip_strain, at_least=0.0, below=end)
    parts = integer("blocks", blocks, at_least=2)
    count = integer("samples", samples, at_least=1, bytes_each=SAMPLE_BYTES)
    if count * (1.0 - skip / end) < 2 * parts:
        raise ValueError(f"samples must be at least 2 in each of the blocks that count, got {count}")
    tolerance = positive("drift_tolerance", drift_tolerance)
    settings = check_arguments(scene, check=check, **common)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)

    def run(speed: float) -> StrainRun:
        return _ramp(
            settings, speed, end, "shear", pair, count, f"steady shear at {speed:g}",
            lambda made: _judged(made, skip, parts, tolerance),
        )  # fmt: skip

    def curve(runs: list[StrainRun]) -> FlowCurve:
        return _curve(speeds[: len(runs)], tuple(runs), skip, parts, time.process_time() - began)

    return run_each(speeds, run, curve)


def _curve(rates: list[float], runs: tuple[StrainRun, ...], skip: float, blocks: int, seconds: float) -> FlowCurve:
    table = []
    for run in runs:
        if run.outcome not in (Outcome.FINISHED, Outcome.NOT_STEADY):
            table.append([math.nan] * 6)
            continue
        on = run.strain_t >= skip * (1.0 - 1e-12)
        particles = run.packing.particles
        table.append(
            [
                *block_mean(run.shear_stress_t[on], blocks),
                *block_mean(run.pressure_t[on], blocks),
                float(2.0 * run.contacts_t[on].mean() / particles),
                float(run.sliding_fraction_t[on].mean()),
            ]
        )
    stress, stress_error, pressure, pressure_error, contacts, sliding = np.array(table).T.copy()
    return FlowCurve(np.array(rates), stress, stress_error, pressure, pressure_error, contacts, sliding, runs, seconds)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Creep(StrainRun):
    """A run at constant stress.

    Attributes
    ----------
    applied_stress
        The stress [energy/length^d].
    hold
        How long it acted; none acts after [time].
    inertia, viscosity
        W and eta of the box's equation of motion [mass length^2], [energy time/length^d].

    """

    applied_stress: float
    hold: float
    inertia: float
    viscosity: float

    @property
    def compliance_t(self) -> NDArray[np.float64]:
        """The (T,) creep compliances gamma / stress [length^d/energy]."""
        return np.asarray(self.strain_t / self.applied_stress)

    @property
    def flows(self) -> bool:
        """Whether the box still strains: in the last tenth of the time at more than a hundredth of its mean rate."""
        last = int(np.searchsorted(self.time_t, _LAST * self.time_t[-1], side="right")) - 1
        changed, overall = np.ptp(self.strain_t[last:]), np.ptp(self.strain_t)
        # what is not finite is not at rest
        return not changed <= _STILL * (1.0 - _LAST) * overall

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{particles_in_words(self.packing)} under a shear stress of {self.applied_stress:g}"

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values; stresses in the scene's units of energy/length^d."""
        held = float(self.strain_t[self.time_t <= self.hold * (1.0 + 1e-9)][-1])
        return {**super().to_dict(), "strain_under_stress": held, "compliance": held / self.applied_stress}

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        numbers, rest = self.to_dict(), super().rows()[len(self.outcome_rows()) :]
        return [
            *self.outcome_rows(),
            ("strain under stress", f"{numbers['strain_under_stress']:.6g}", "when the stress ends"),
            ("compliance", f"{numbers['compliance']:.6g}", "that strain over the stress"),
            *rest,
            *self._residual_rows(),
        ]


@listed(Common)
@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag noise shapes breaking")
def creep(
    scene: Scene,
    *,
    stress: float,
    duration: float,
    hold: float | None = None,
    inertia: float | None = None,
    viscosity: float | None = None,
    axes: tuple[int, int] = (0, 1),
    **common: Unpack[Common],
) -> Creep:
    """Return how the box shears under a constant stress.

    The strain has an equation of motion of its own, W gamma'' = V (stress - sigma - eta gamma'), with sigma the overall
    stress of the particles along the axes, W the box's inertia and eta a viscosity beside it. It is stepped by the
    semi-implicit Euler method with the rate constant over a few time steps (a fiftieth of the time in which a box that
    is as stiff as a contact would answer), so that gamma(t) is of first order in these; where the box comes to rest
    sigma is the stress, whatever W and eta are.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    stress
        Shear stress [energy/length^d], of any sign but not zero.
    duration
        How long [time].
    hold
        How long the stress acts; after that there is none (recovery). All the time unless given.
    inertia
        W [mass length^2]. Unless given M H^2 / 12 with the total mass M and H = V^(1/d): the inertia of the sheared
        material itself, so that the box answers as fast as its own slowest shear wave.
    viscosity
        eta [energy time/length^d]; 0 lets the box ring. Unless given, critical for a box as stiff as a contact:
        2 sqrt(W E / V) with E = stiffness d^(2 - dimension).
    axes
        Direction of the displacements, and of their gradient.
    dt, method, velocity_nd, spin_nk, held_n, frames, time_limit, progress, checkpoint, check
        As in `oscillatory_shear`.

    Raises
    ------
    TypeError, ValueError, NotConverged, KeyboardInterrupt
        As in `oscillatory_shear`.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.5)))
    >>> run = pm.creep(scene, stress=1e-4, duration=200.0)
    >>> round(1 / float(run.compliance_t[-1]), 3)  # the shear modulus
    0.42

    """
    settings = check_arguments(scene, **common)
    load = real("stress", stress)
    if load == 0.0:
        raise ValueError("stress must not be zero, got 0.0")
    time = positive("duration", duration)
    check_steps("duration", time, settings.longest)
    held = time if hold is None else real("hold", hold, above=0.0, at_most=time)
    packing = scene.packing
    d, volume = packing.dimension, packing.box.volume
    if inertia is None:
        weight = float(packing.mass_n.sum()) * volume ** (2.0 / d) / 12.0
    else:
        weight = positive("inertia", inertia)
    stiff = stiffness_and_damping(scene)[0] * packing.reference_diameter ** (2 - d)
    eta = 2.0 * math.sqrt(weight * stiff / volume)
    if viscosity is not None:
        eta = real("viscosity", viscosity, at_least=0.0)
    answer = min(math.sqrt(weight / (volume * stiff)) if stiff > 0.0 else math.inf, time)
    chunk = max(1, int(_OFTEN * answer / settings.longest))
    turns = max(1, math.ceil(time / (settings.longest * chunk) * (1.0 - 1e-12)))
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)
    driven = {"applied_stress": load, "hold": held, "inertia": weight, "viscosity": eta}
    span = chunk * time / (turns * chunk)

    def drive(task: StrainTask) -> None:
        """Give the box the rate of strain, which is stepped like a velocity."""
        rows, rate = task.driven_rows, task.engine.profile.rate
        assert rows is not None
        sigma = float(tensors(rows[-1], d, volume)["overall"][pair])
        # what ends within half a span ends now
        acting = load if task.engine.time < held - 0.5 * span else 0.0
        task.drive_at((rate + span * volume * (acting - sigma) / weight) / (1.0 + span * volume * eta / weight))

    plan = StrainPlan(
        _CREEP,
        dt=time / (turns * chunk),
        steps=turns * chunk,
        every=turns * chunk + 1,
        profile=Ramp(0.0, 0.0, 0.0, math.inf),
        direction_dd=SteadyStrain(0.0, axes=pair).direction(d),
        axes=pair,
        further={**driven, "chunk": chunk},
        drive=drive,
        span=chunk,
        report_every=_REPORT,
    )
    task = StrainTask(settings, plan)
    return task.run(lambda outcome: Creep(**task.fields(outcome), **driven))
