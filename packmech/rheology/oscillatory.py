"""Oscillatory shear: a sine of strain, and the moduli of the stress that answers to it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.check import (
    boolean,
    brief,
    check_memory,
    check_steps,
    integer,
    one_of,
    positive,
    real,
    two_axes,
)
from packmech.dynamics.breaking import numbers_of_broken, rows_of_broken
from packmech.dynamics.deformation import Increments, OscillatoryStrain, Sine
from packmech.effects import bonds_of, equal_partners, is_bound, law_second, pair_second
from packmech.effects.kinds import reference_partners
from packmech.measure.counting import packing_fraction
from packmech.measure.signals import Demodulation, demodulate
from packmech.observables import columns_in
from packmech.result import Condition, Outcome, Row, Run, particles_in_words
from packmech.rheology.arguments import SAMPLE_BYTES, Common, StrainSettings, check_arguments, listed
from packmech.rheology.strain_run import StrainPlan, StrainRun, StrainTask
from packmech.rheology.walls import WallModuli, wall_forces
from packmech.scene import Scene

STAGE = "oscillatory shear"
# of larger strains rounding leaves the box too few digits to say where its images are
_LARGEST_STRAIN = 1e12
# overlap at which the stiffness of a contact is taken [1]
_TOUCH = 1e-9
# errors between periods, and a negative G' beyond so many errors, over |G*|: more is no modulus
_KNOWN, _NEGATIVE, _SURE = 0.5, 0.1, 3.0
# kinetic energy over the energy that |G*| stores: where one mode moves, more changes G' by more than a fifth
_MOVING = 0.25


def rest_row(ratio: float, expected_stress: float) -> Row:
    """Return what is said of how quiet a scene was before the shear: name, value, and what the value is."""
    note = f"stress before the shear over the amplitude expected, {expected_stress:.4g}"
    return ("residual oscillation", f"{ratio:.2g}", note)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class OscillatoryShear(StrainRun):
    """A run under gamma = amplitude sin(2 pi frequency (t - start)), with the moduli of its overall stress.

    Attributes
    ----------
    amplitude, frequency
        Of the strain [1] and in periods per unit of time [1/time].
    start
        Time at which the strain starts [time].
    periods, skip_periods
        How many were asked for, and how many of the first do not count [1].
    moduli
        G' and G'' of the overall stress, with error bars over periods; None where the run ended before a period that
        counts.
    walls
        The same from the force on walls and from what is between them, where the scene has walls across the gradient:
        rough plates (held_n of `rough_plates`), or smooth Walls; None without, or as above.

    """

    amplitude: float
    frequency: float
    start: float
    periods: float
    skip_periods: float
    moduli: Demodulation | None
    walls: WallModuli | None = None

    @property
    def measured(self) -> bool:
        """Whether the run came to its end and has moduli, steady and in balance or not."""
        return self.ok or self.outcome in (Outcome.NOT_STEADY, Outcome.NEAR_RESONANCE)

    @property
    def kinetic_share(self) -> float:
        """Mean kinetic energy of peculiar motion over V |G*| amplitude^2 / 4, over the periods that count [1].

        (frequency / that of the modes that move)^2 where these are elastic: near one, the frequency is near a mode. nan
        without moduli.
        """
        found, phase = self.moduli, self.phase_t / (2.0 * np.pi)
        on = (phase >= self.skip_periods) & (phase <= self.periods)
        stored = 0.0
        if found is not None:
            stored = 0.25 * math.hypot(found.storage, found.loss) * self.amplitude**2 * self.packing.box.volume
        kinetic_t = self.kinetic_t + self.rotational_t
        return float(kinetic_t[on].mean() / stored) if stored > 0.0 and on.any() else math.nan

    @property
    def broken_while_measured(self) -> int:
        """How many bonds broke in the periods that count."""
        if self.broken_bonds is None:
            return 0
        period_e = self.frequency * (self.broken_bonds.time_e - self.start)
        return int(((period_e > self.skip_periods) & (period_e <= self.periods)).sum())

    @property
    def phase_t(self) -> NDArray[np.float64]:
        """The (T,) phases of the strain; not positive before it starts."""
        return np.asarray(2.0 * np.pi * self.frequency * (self.time_t - self.start))

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the observables that were kept, by name."""
        return {**super().columns(), **columns_in(self, ["phase_t"])}

    def about(self) -> dict[str, Any]:
        """Return what a table of this run says of it."""
        names = ("amplitude", "frequency", "start", "periods", "skip_periods")
        numbers = {**super().about(), **{name: getattr(self, name) for name in names}}
        if self.moduli is not None:
            numbers |= {"storage_modulus": float(self.moduli.storage), "loss_modulus": float(self.moduli.loss)}
        return numbers

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{particles_in_words(self.packing)}, strain {self.amplitude:g} sin(2 pi {self.frequency:.6g} t)"

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values; stresses in the scene's units of energy/length^d."""
        numbers = {
            **Run.to_dict(self),
            "packing_fraction": packing_fraction(self.packing),
            "strain_amplitude": self.amplitude,
            "frequency": self.frequency,
            "time_step": self.dt,
            "mean_pressure": float(np.mean(self.pressure_t)),
            "end_stress": self.stress["overall"][-1].tolist(),
            "mean_contacts": float(np.mean(self.contacts_t)),
            "mean_sliding_fraction": float(np.mean(self.sliding_fraction_t)),
            **numbers_of_broken(self.broken_bonds),
        }
        if self.broken_bonds is not None:
            numbers["bonds_broken_while_measured"] = self.broken_while_measured
        found = self.moduli
        if found is not None:
            numbers |= {
                "in_phase_stress": found.in_phase,
                "out_of_phase_stress": found.out_of_phase,
                "stress": found.stress,
                "storage_modulus": found.storage,
                "loss_modulus": found.loss,
                "storage_error": found.storage_error,
                "loss_error": found.loss_error,
                "storage_fit_error": found.storage_fit_error,
                "loss_fit_error": found.loss_fit_error,
                "kinetic_share": self.kinetic_share,
            }
        if self.held_n is not None:
            numbers["held"] = int(self.held_n.sum())
        if self.walls is not None:
            numbers["walls"] = self.walls.to_dict()
        return numbers

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        numbers, unit = self.to_dict(), self.stress_unit
        rows: list[Row] = []
        if self.walls is not None:
            # contacts inside the plates count in the overall stress, so that its moduli are those of no material
            rows += self.walls.rows(numbers.get("held", 0), unit)
        whole = "" if self.walls is None else " of the whole box"
        if self.moduli is not None:
            rows += [
                (f"in-phase stress{whole}", f"{numbers['in_phase_stress']:.6g}", f"amplitude; {unit}"),
                (f"out-of-phase stress{whole}", f"{numbers['out_of_phase_stress']:.6g}", f"amplitude; {unit}"),
                (f"stress{whole}", f"{numbers['stress']:.6g}", "amplitude of both together"),
            ]
            for name, key in (("G'", "storage"), ("G''", "loss")):
                between, fit = numbers[f"{key}_error"], numbers[f"{key}_fit_error"]
                error = f"+- {between:.2g} between periods"
                if not math.isfinite(between):
                    # one period that counts says nothing of how periods differ
                    error = f"error not known: fewer than two periods count; fit to {fit:.2g}"
                note = "contacts inside the plates counted; " if whole and self.held_n is not None else ""
                if self.broken_while_measured:
                    note = f"{self.broken_while_measured} bonds broke while it was measured; {note}"
                rows.append((f"{name}{whole}", f"{numbers[f'{key}_modulus']:.6g}", f"{note}{error}; {unit}"))
            # first, so that a short line does not lose it
            led = "inertia takes part: no moduli of a slow strain; " if numbers["kinetic_share"] > _MOVING else ""
            rows.append(("kinetic share", f"{numbers['kinetic_share']:.3g}", f"{led}over the energy that |G*| stores"))
        else:
            lines = ["  ".join(f"{entry + 0.0:.6g}" for entry in row) for row in numbers["end_stress"]]
            rows += [("moduli", "none", "less than a whole period counts")]
            rows += [("stress at the end", ";  ".join(lines), f"row by row, tension positive; {unit}")]
        if "oscillation_ratio" in self.report:
            rows.append(rest_row(self.report["oscillation_ratio"], self.report["expected_stress"]))
        sliding = numbers["mean_sliding_fraction"]
        return [
            *self.outcome_rows(),
            *rows,
            ("packing fraction", f"{numbers['packing_fraction']:.8f}", "overlaps counted twice"),
            ("mean pressure", f"{numbers['mean_pressure']:.6g}", unit),
            ("contacts", f"{numbers['mean_contacts']:.1f}", f"mean; {sliding:.1%} of them slide"),
            *rows_of_broken(self.broken_bonds),
        ]

    def demodulated(self, tensor: str = "overall", axes: tuple[int, int] | None = None) -> Demodulation:
        """Return the moduli of a component of one of the tensors in `stress`, over the periods that count.

        Raises
        ------
        ValueError
            If there is no such tensor, or too little of it.

        """
        if tensor not in self.stress:
            raise ValueError(f"tensor must be one of {', '.join(map(repr, self.stress))}, got {brief(tensor)}")
        a, b = self.axes if axes is None else axes
        return self.demodulated_of(self.stress[tensor][:, a, b])

    def demodulated_of(self, stress_t: NDArray[np.float64]) -> Demodulation:
        """Return the moduli of a (T,) stress of the times of this run, over the periods that count."""
        phase = self.phase_t
        sheared = (phase >= 0.0) & (phase <= 2.0 * np.pi * (self.periods + 1e-9))
        return demodulate(
            phase[sheared],
            stress_t[sheared],
            amplitude=self.amplitude,
            skip_periods=self.skip_periods,
            periods=min(self.periods, float(phase[sheared][-1]) / (2.0 * np.pi)) if sheared.any() else self.periods,
        )


def characteristic_time(scene: Scene) -> float:
    """Return tau = sqrt(mean mass / k) [time], k the normal stiffness of a contact (or a bond) that just closes.

    Where contacts differ by kinds of particles k is that of the stiffest.

    The time scale of particleShear (Braschler, 2021): the mean mass is that of one size with the same packing
    fraction.

    Raises
    ------
    ValueError
        If nothing is stiff at contact.

    """
    pair = equal_partners(scene.packing.reference_diameter)
    close = (1.0 - _TOUCH) * pair.contact_distance
    bonds, pairs = bonds_of(scene.effects), [one for one in scene.effects if not is_bound(one)]
    stiffness = max(
        abs(sum(pair_second(one, close, each) for one in pairs))
        for each in reference_partners(scene.effects, scene.packing)
    )
    if stiffness == 0.0 and bonds is not None:
        stiffness = abs(law_second(bonds.compression, close, pair))
    if not stiffness > 0.0:
        raise ValueError("relative_frequency must be left out where contacts have no stiffness: give frequency")
    return math.sqrt(float(scene.packing.mass_n.mean()) / stiffness)


def frequency_of(settings: StrainSettings, frequency: float | None, relative_frequency: float | None) -> float:
    """Return the frequency [1/time] from whichever of the two is given."""
    relative = None if relative_frequency is None else positive("relative_frequency", relative_frequency)
    if (frequency is None) == (relative is None):
        got = "neither" if frequency is None else "both"
        raise ValueError(f"frequency must be given, or else relative_frequency, got {got}")
    if relative is not None:
        return relative / characteristic_time(settings.scene)
    return positive("frequency", frequency)


@listed(Common)
@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag noise shapes breaking")
def oscillatory_shear(
    scene: Scene,
    *,
    amplitude: float,
    frequency: float | None = None,
    relative_frequency: float | None = None,
    pre_periods: float = 0.0,
    periods: float = 4.0,
    post_periods: float = 0.0,
    skip_periods: float | None = None,
    axes: tuple[int, int] = (0, 1),
    samples_per_period: int = 200,
    carried: bool = True,
    strain_path: str = "exact",
    **common: Unpack[Common],
) -> OscillatoryShear:
    """Return a run under oscillatory shear, gamma = amplitude sin(2 pi frequency t), with G' and G'' of its stress.

    The box is sheared (Lees and Edwards's sliding images), particles follow Newton's equations in it. The strain is
    exact at every step. The stress is that of all contacts and bonds with their branch vectors across the boundary, so
    that nothing jumps when a particle leaves the cell. Moduli come from `demodulate`.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    amplitude
        Of the strain [1].
    frequency, relative_frequency
        One of them: periods in a unit of time, or in tau = sqrt(mean mass / stiffness of a contact).
    pre_periods, periods, post_periods
        Periods of rest before, of shear, and of rest after [1].
    skip_periods
        How many of the first periods of shear do not count. Unless given: 1, or 0 with fewer than 2 periods.
    axes
        Direction of the displacements, and of their gradient.
    dt
        Longest time step. Unless given: the method's fraction of the shortest of sqrt(m / stiffness) and m / damping of
        whatever acts, whatever the amplitude. Steps are shortened so that a period is a whole number of them, and of
        samples. Where there are rests, the strain starts and ends in the middle of a step.
    method
        VelocityVerlet() unless given, or SemiImplicitEuler().
    velocity_nd, spin_nk
        (N, d) peculiar velocities [length/time] and (N, 1 or 3) spins [1/time] at the start; at rest unless given.
    held_n
        (N,) True for particles that nothing pushes or turns: they follow the box, as rough plates do.
    samples_per_period
        How often figures are kept, at least 8.
    carried
        Whether everything is carried along as the box deforms, so that only motion against it has inertia (SLLOD: a
        part of an endless sheared medium). False: nothing is, and plates alone (held_n of `rough_plates`) drive the
        sample, about the middle between them; steps then take their time in Python.
    strain_path
        "exact", or "increments": the strain is that of the sine at every step and linear in it, so that the rate is the
        mean one of the step, as where strain increments drive an experiment.
    frames
        Positions are kept so many times, evenly spaced, the start and the end among them.
    ledger
        Account for the energy: `run.ledger` says how much work the box did, what is stored and where the rest was
        dissipated, as in `simulate`.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures), figures a dict with "steps", "of", "time" and "strain".
    checkpoint
        A .npz file to which the full state goes, whole or not at all: at the end, at an interrupt (Ctrl-C, SIGTERM,
        time_limit) and now and then on the way. Where it is there already, made of the same scene and arguments, the
        run goes on from it with the same bits; a run that got to its end is returned as it was. Writing changes no bit.
    check
        Raise NotConverged when the run did not get to its end; otherwise return what it came to all the same.

    Returns
    -------
    OscillatoryShear
        Outcome.FINISHED, or Outcome.STEP_TOO_LONG where something moved by the smallest diameter in one step;
        Outcome.NOT_STEADY where G' or G'' differ from period to period by more than half of |G*|, and
        Outcome.NEAR_RESONANCE where G' is negative beyond its error: inertia leads the stress. `kinetic_share` is
        the kinetic energy over the energy that |G*| stores; above 1/4 the moduli are not those of a slow strain, as the
        run says when it is printed.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the end was not reached and `check` is set; its `.run` holds what was.
    KeyboardInterrupt
        Passed on with `.run` set to what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.1)))
    >>> run = pm.oscillatory_shear(scene, amplitude=1e-4, frequency=0.01, periods=2)
    >>> round(run.moduli.storage, 3), abs(run.moduli.loss) < 1e-6  # sqrt(3)/4 less the pressure's part
    (0.42, True)

    """
    settings = check_arguments(scene, **common)
    rate = frequency_of(settings, frequency, relative_frequency)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)
    strain = OscillatoryStrain(real("amplitude", amplitude, above=0.0, at_most=_LARGEST_STRAIN), rate, axes=pair)
    pre = real("pre_periods", pre_periods, at_least=0.0)
    count = positive("periods", periods)
    post = real("post_periods", post_periods, at_least=0.0)
    check_steps("periods / frequency", (pre + count + post) / rate, settings.longest)
    if skip_periods is None:
        skip = 1.0 if count >= 2.0 else 0.0
    else:
        skip = real("skip_periods", skip_periods, at_least=0.0, below=count)
    samples = integer("samples_per_period", samples_per_period, at_least=8, bytes_each=SAMPLE_BYTES)
    check_memory("periods x samples_per_period", SAMPLE_BYTES * (pre + count + post) * samples)
    every = math.ceil(1.0 / (rate * settings.longest * samples) * (1.0 - 1e-12))
    if not every:
        raise ValueError(f"frequency must be such that float64 holds the steps of a period, got {rate:g}")
    each = every * samples
    step = 1.0 / (rate * each)
    one_of("strain_path", strain_path, ("exact", "increments"))
    boolean("carried", carried)
    before, sheared, after = round(pre * each), max(1, round(count * each)), round(post * each)
    rests = before > 0 or after > 0
    # the rate jumps there: in the middle of a step a trapezoidal rule takes no notice
    start = (before + 0.5) * step if rests else 0.0
    end = start + sheared * step if rests else math.inf
    sine = Sine(float(amplitude), 2.0 * math.pi * rate, start, end)
    profile = sine if strain_path == "exact" else Increments(*sine, step)
    plan = StrainPlan(
        STAGE,
        dt=step,
        steps=before + sheared + after + (1 if rests else 0),
        every=every,
        profile=profile,
        direction_dd=strain.direction(scene.packing.dimension),
        axes=pair,
        further={"carried": carried},
        walls=wall_forces(settings, pair, every, profile, carried=carried),
    )
    task = StrainTask(settings, plan)
    return task.run(lambda outcome: _finish(task, outcome, strain, start, count, skip))


def _finish(
    task: StrainTask, outcome: Outcome, strain: OscillatoryStrain, start: float, periods: float, skip: float
) -> OscillatoryShear:
    run = OscillatoryShear(
        **task.fields(outcome),
        amplitude=strain.amplitude,
        frequency=strain.frequency,
        start=start,
        periods=periods,
        skip_periods=skip,
        moduli=None,
    )
    # a whole period that counts, or nothing
    if run.phase_t[-1] < 2.0 * np.pi * (skip + 1.0 - 1.0 / 8.0):
        return run
    walls = None if task.walls is None else task.walls.moduli(run)
    run = replace(run, moduli=run.demodulated(), walls=walls)
    return run if outcome is not Outcome.FINISHED else _judged(run)


def _judged(run: OscillatoryShear) -> OscillatoryShear:
    """Return a run that was finished, with the outcome NOT_STEADY or NEAR_RESONANCE where its moduli are no such.

    Errors between periods must be below half of |G*|, and G' must not be negative beyond three errors and a tenth of
    |G*|: what is in balance resists, and only inertia gives way. Inertia that only adds to the stress, as in waves
    between plates, is no failure: the kinetic share tells.
    """
    found = run.moduli
    assert found is not None
    size = math.hypot(found.storage, found.loss)
    conditions = [
        (Outcome.NOT_STEADY, Condition(f"error of {name} between periods", error, _KNOWN * size))
        for name, error in (("G'", found.storage_error), ("G''", found.loss_error))
        if math.isfinite(error)
    ]
    error = found.storage_error if math.isfinite(found.storage_error) else found.storage_fit_error
    led = Condition("negative G'", -found.storage, _SURE * error + _NEGATIVE * size)
    unmet = [(name, one) for name, one in [*conditions, (Outcome.NEAR_RESONANCE, led)] if not one.met]
    return replace(run, outcome=unmet[0][0], unmet=tuple(one for _, one in unmet)) if unmet else run
