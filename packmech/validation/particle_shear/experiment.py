"""The package's oscillatory shear: discs made ready, the run, G' and G'' as it computes them and as they should be."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import check
from packmech.calls.display import shown
from packmech.observables import Table, make_table
from packmech.validation.particle_shear.material import (
    Material,
    contact_stiffness,
    contact_viscosity,
    model_mass,
    package_longest_step,
    package_time_step,
    time_constant,
)
from packmech.validation.particle_shear.step import STRESSES, ShearedDiscs, StepRules, Steps, advance

# how a drift of the stress is treated
DRIFTS = ("package", "none", "removed", "least_squares")


class ComplexModuli(NamedTuple):
    """In-phase and out-of-phase stress [Pa] and the storage and loss moduli G' and G'' [Pa]."""

    in_phase: float
    out_of_phase: float
    storage: float
    loss: float


class Periods(NamedTuple):
    """An oscillatory protocol: frequency [Hz], strain amplitude [1], and periods before, under and after shear [1]."""

    frequency: float
    amplitude: float
    pre_periods: float
    periods: float
    post_periods: float


def remove_jumps(stress_t: ArrayLike, *, largest: float = 0.15) -> NDArray[np.float64]:
    """Return a stress without the steps that contacts make as they change class, as the package's evaluation does.

    Each step larger than `largest` of the stress's range is replaced by the step before it; the first step stays.

    Parameters
    ----------
    stress_t
        (T,) stresses [Pa].
    largest
        Of the range of all of them [1].

    Examples
    --------
    >>> print(remove_jumps([0.0, 1.0, 2.0, 30.0, 31.0, 32.0]))
    [0. 1. 2. 3. 4. 5.]

    """
    stress = check.finite_array("stress_t", stress_t, shape=(None,), what="time")
    step = np.diff(stress)
    large = np.flatnonzero(np.abs(step) > check.positive("largest", largest) * float(np.ptp(stress)))
    corrected = stress.copy()
    for k in large[large > 0].tolist():
        excess = step[k] - step[k - 1]
        step[k] = step[k - 1]
        corrected[k + 1 :] -= excess
    return corrected


def demodulate(
    time_t: ArrayLike,
    stress_t: ArrayLike,
    protocol: Periods,
    *,
    drift: str = "package",
    largest_jump: float | None = None,
) -> ComplexModuli:
    """Return G' and G'' of a shear stress under the strain A sin(2 pi (t f - pre)).

    The first period of shear is left out where there are at least two.

    Parameters
    ----------
    time_t, stress_t
        (T,) times [s] and shear stresses [Pa].
    protocol
        What was applied.
    drift
        "package": the line through the mean stresses before and after the shear is *added* to the stress, as the
        package does (its slope has the wrong sign), which doubles a drift. "removed": the line is subtracted, as was
        meant. "none": the stress as it is. For these three G' = sum(stress sin) / (A sum(sin^2)), with sin and cos
        taken one by one. "least_squares": sine, cosine, their third harmonics, an offset and a slope fitted together.

    Raises
    ------
    ValueError
        If no time falls inside the shear that counts.

    Examples
    --------
    >>> protocol = Periods(frequency=1.0, amplitude=0.2, pre_periods=1.0, periods=3.0, post_periods=1.0)
    >>> time_t = np.arange(5000) / 1000.0
    >>> sheared = (time_t >= 1.0) & (time_t <= 4.0)
    >>> stress_t = 20.0 * np.sin(2 * np.pi * time_t) * sheared + 10.0 * time_t  # G' = 100 Pa, 10 Pa/period of drift
    >>> for drift in DRIFTS:
    ...     print(drift, round(demodulate(time_t, stress_t, protocol, drift=drift).storage, 1))
    package 68.2
    none 84.1
    removed 100.0
    least_squares 100.0

    """
    treatment = check.one_of("drift", drift, DRIFTS)
    time = check.finite_array("time_t", time_t, shape=(None,), what="time")
    stress = check.finite_array("stress_t", stress_t, shape=(len(time),), what="time")
    if largest_jump is not None:
        stress = remove_jumps(stress, largest=check.positive("largest_jump", largest_jump))
    check.instance("protocol", protocol, Periods)
    frequency = check.positive("frequency", protocol.frequency)
    amplitude = check.positive("amplitude", protocol.amplitude)
    pre = check.real("pre_periods", protocol.pre_periods, at_least=0.0)
    periods = check.positive("periods", protocol.periods)
    check.real("post_periods", protocol.post_periods, at_least=0.0)
    skipped = 1.0 if periods >= 2.0 else 0.0
    window = (time >= (pre + skipped) / frequency) & (time <= (pre + periods) / frequency)
    if not window.any():
        raise ValueError(f"time_t must reach into the shear that counts, got {time[0]:g} to {time[-1]:g} s")
    if treatment in ("package", "removed"):
        sign = 1.0 if treatment == "package" else -1.0
        stress = stress + sign * _drift_slope(time, stress, protocol) * (time - pre / frequency)
    phase = 2.0 * np.pi * (time[window] * frequency - pre)
    if treatment == "least_squares":
        in_phase, out_of_phase = _fit(phase, stress[window])
    else:
        in_phase, out_of_phase = (
            float((stress[window] * wave).sum() / (wave**2).sum()) for wave in (np.sin(phase), np.cos(phase))
        )
    return ComplexModuli(in_phase, out_of_phase, in_phase / amplitude, out_of_phase / amplitude)


def _drift_slope(time: NDArray[np.float64], stress: NDArray[np.float64], protocol: Periods) -> float:
    """Return the slope between the rests before and after the shear [Pa/s]; their first and last samples if none."""
    f, pre, end = protocol.frequency, protocol.pre_periods, protocol.pre_periods + protocol.periods
    before = (time >= 2.0 / 3.0 * pre / f) & (time < pre / f) if pre > 0.0 else np.arange(len(time)) == 0
    after = np.arange(len(time)) == len(time) - 1
    if protocol.post_periods > 0.0:
        after = (time > end / f) & (time <= (end + protocol.post_periods / 3.0) / f)
    if not before.any() or not after.any():
        raise ValueError("time_t must hold the rests before and after the shear that the drift is taken from")
    return float((stress[after].mean() - stress[before].mean()) / (time[after].mean() - time[before].mean()))


def _fit(phase: NDArray[np.float64], stress: NDArray[np.float64]) -> tuple[float, float]:
    waves = [np.sin(phase), np.cos(phase), np.sin(3.0 * phase), np.cos(3.0 * phase), np.ones_like(phase), phase]
    found = np.linalg.lstsq(np.stack(waves, axis=1), stress, rcond=None)[0]
    return float(found[0]), float(found[1])


@shown()
@dataclasses.dataclass(frozen=True)
class ParticleShear:
    """Parameters of one oscillatory shear experiment, run step by step as the package particleShear 1.0.2 runs it.

    Its faults are part of it: rough plates that catch discs for ever, friction that wipes its history and averages two
    visits, stresses without the contacts at the boundary, a drift correction of the wrong sign. To see what an old
    result was made of, use this; to measure a material, use the native dynamics.

    The package's parameters and their places here:

    ======================================  ==========================================================
    particleShear                           packmech
    ======================================  ==========================================================
    theAmplitude                            ``amplitude``
    theMu                                   ``friction_coefficient``
    Young_modulus_spheres                   ``young_modulus``
    N                                       ``particles``
    packing_fraction                        ``packing_fraction``
    density                                 ``density``; 50 as in its code, its documentation says 1000
    bimodal_factor                          ``size_ratio``
    relative_viscosity                      ``relative_viscosity``
    relative_transversal_link_strength      ``tangential_ratio``
    relative_frequency                      ``relative_frequency``
    central_repulsion_coefficient           ``divergence``
    interface_reenforcement_central         ``reinforcement_normal``
    interface_reenforcement_tangential      ``reinforcement_tangential``
    keep_viscosity_coefficients_constant    ``keep_viscosity``
    pre_periods, periods, post_periods      the same
    cool_factor                             ``cooling``
    size of the cell (500 x 500)            ``width``, ``height``
    do_permanent_links                      ``prepared_discs(..., centers=...)`` or ``lines=``; without, no bonds
    cut_lines, doCutByTriangulation         ``centers`` or ``lines`` of ``prepared_discs``; 0: one bulk
    avoid_horizontal_angle_degree           ``avoided_angle`` of ``prepared_discs``
    avoid_height_spanning_particles         ``spanning`` of ``prepared_discs``
    cut_top_bottom, edge_fuzziness          the same of ``prepared_discs``
    remove_link_fraction                    ``removed_fraction`` of ``prepared_discs``
    root_folder, saveData                   ``write_text(run, folder)``
    saveStressTensorData                    ``write_text(..., tensors=False)`` leaves the series out
    saveOutputImages, imageFileType         ``packmech run --frames 200 --format``
    doDrawing, plotStress                   ``packmech run --live``
    relative_y_scale_force                  none: figures find their scale
    doParticleShearSimulationSeries         ``run_series``
    call_back_elastic_force_law             ``law``, ``plateau_begin`` and the like, ``tensile_range``
    ======================================  ==========================================================

    `prepared_discs` makes the discs ready as the package does, with seeded random numbers in place of unseeded ones.

    Parameters
    ----------
    amplitude
        Strain amplitude [1].
    friction_coefficient
        [1].
    young_modulus, density
        Of the discs [Pa], [kg/m^3].
    particles, packing_fraction, size_ratio
        The model's constants come from these; the discs that are run have radii and masses of their own.
    width, height
        Sides of the cell [um].
    relative_viscosity
        Dashpots over sqrt(m k) [1].
    tangential_ratio
        Tangential over normal springs and dashpots [1].
    relative_frequency
        Frequency times tau [1].
    divergence
        Share of the divergent law in the repulsion; 0 is linear [1].
    reinforcement_normal, reinforcement_tangential
        Contacts' springs over those of bonds [1].
    keep_viscosity
        Whether reinforcement leaves the dashpots alone.
    pre_periods, periods, post_periods
        Periods at rest, under shear, and at rest again [1].
    cooling
        What one period leaves of velocities relative to the sheared flow [1].
    law
        "divergent" (with the share above), "plateau" or "exponential" (bonds whose tension saturates).
    plateau_begin, plateau_end, plateau_slope
        Between these fractions of the contact distance the plateau's repulsion rises with this slope instead of 1, as
        the package ships it [1].
    tensile_range
        Range of the saturating tension, in rest lengths [1].

    Examples
    --------
    >>> experiment = ParticleShear(particles=2, pre_periods=0.1, periods=0.2, post_periods=0.1)
    >>> experiment.steps, f"{experiment.frequency:.1f} Hz"
    (895, '457.6 Hz')
    >>> mass = experiment.mass
    >>> start = ShearedDiscs([[200.0, 250.0], [370.0, 250.0]], [90.0, 90.0], [mass, mass])
    >>> run = experiment.run(start)
    >>> run.stress("overall").shape, run.moduli("overall", drift="none")._fields
    ((895, 2, 2), ('in_phase', 'out_of_phase', 'storage', 'loss'))

    """

    amplitude: float = 0.2
    friction_coefficient: float = 0.01
    young_modulus: float = 8000.0
    particles: int = 150
    packing_fraction: float = 1.5
    density: float = 50.0
    size_ratio: float = 1.4
    width: float = 500.0
    height: float = 500.0
    relative_viscosity: float = 0.1
    tangential_ratio: float = 1.0
    relative_frequency: float = 0.025
    divergence: float = 1.0
    reinforcement_normal: float = 1.0
    reinforcement_tangential: float = 1.0
    keep_viscosity: bool = False
    pre_periods: float = 2.0
    periods: float = 3.0
    post_periods: float = 1.0
    cooling: float = 0.5
    law: str = "divergent"
    plateau_begin: float = 0.3
    plateau_end: float = 0.8
    plateau_slope: float = 0.1
    tensile_range: float = 0.2

    def __post_init__(self) -> None:
        for name in ("friction_coefficient", "relative_viscosity", "tangential_ratio", "pre_periods", "post_periods"):
            object.__setattr__(self, name, check.real(name, getattr(self, name), at_least=0.0))
        for name in (
            *("amplitude", "young_modulus", "packing_fraction", "density", "relative_frequency", "periods"),
            *("width", "height", "tensile_range"),
            *("reinforcement_normal", "reinforcement_tangential"),
        ):
            object.__setattr__(self, name, check.positive(name, getattr(self, name)))
        object.__setattr__(self, "particles", check.integer("particles", self.particles, at_least=1))
        object.__setattr__(self, "size_ratio", check.real("size_ratio", self.size_ratio, at_least=1.0))
        object.__setattr__(self, "divergence", check.real("divergence", self.divergence, at_least=0.0, at_most=1.0))
        object.__setattr__(self, "cooling", check.real("cooling", self.cooling, above=0.0, at_most=1.0))
        check.one_of("law", self.law, ("divergent", "plateau", "exponential"))
        begin = check.real("plateau_begin", self.plateau_begin, above=0.0, at_most=1.0)
        end = check.real("plateau_end", self.plateau_end, at_least=begin, at_most=1.0)
        slope = check.real("plateau_slope", self.plateau_slope, at_least=0.0, at_most=1.0)
        for name, value in (("plateau_begin", begin), ("plateau_end", end), ("plateau_slope", slope)):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "keep_viscosity", check.boolean("keep_viscosity", self.keep_viscosity))

    @functools.cached_property
    def mass(self) -> float:
        """The model's mass [mg/m]."""
        return model_mass(self.particles, self.packing_fraction, self.density, width=self.width, height=self.height)

    @functools.cached_property
    def tau(self) -> float:
        """The time constant [s], of the springs before reinforcement."""
        return time_constant(self.mass, contact_stiffness(self.young_modulus))

    @property
    def frequency(self) -> float:
        """Frequency of the shear [Hz]."""
        return self.relative_frequency / self.tau

    @functools.cached_property
    def time_step(self) -> float:
        """The package's time step [s]."""
        return package_time_step(
            self.tau,
            size_ratio=self.size_ratio,
            amplitude=self.amplitude,
            friction_coefficient=self.friction_coefficient,
            relative_viscosity=self.relative_viscosity,
            tangential_ratio=self.tangential_ratio,
        )

    @property
    def longest_step(self) -> float:
        """The longest time step of the package's preparation [s]."""
        return package_longest_step(
            self.tau,
            size_ratio=self.size_ratio,
            friction_coefficient=self.friction_coefficient,
            relative_viscosity=self.relative_viscosity,
            tangential_ratio=self.tangential_ratio,
        )

    @property
    def steps(self) -> int:
        """Number of steps of the protocol."""
        return int((self.pre_periods + self.periods + self.post_periods) / self.frequency / self.time_step)

    @property
    def protocol(self) -> Periods:
        """Frequency, amplitude and periods."""
        return Periods(self.frequency, self.amplitude, self.pre_periods, self.periods, self.post_periods)

    @property
    def material(self) -> Material:
        """The contact's constants that follow."""
        stiffness = contact_stiffness(self.young_modulus)
        viscosity = contact_viscosity(self.mass, stiffness, relative=self.relative_viscosity)
        normal, tangential = self.reinforcement_normal, self.reinforcement_tangential
        kept = (1.0, 1.0) if self.keep_viscosity else (normal, tangential)
        return Material(
            stiffness * normal,
            viscosity * kept[0],
            stiffness * self.tangential_ratio * tangential,
            viscosity * self.tangential_ratio * kept[1],
            self.friction_coefficient,
            self.divergence,
            1.0 / normal,
            1.0 / tangential,
            bond_viscosity_follows=0.0 if self.keep_viscosity else 1.0,
            plateau_begin=self.plateau_begin,
            plateau_end=self.plateau_end,
            plateau_slope=self.plateau_slope if self.law == "plateau" else 1.0,
            tensile_range=self.tensile_range if self.law == "exponential" else 0.0,
        )

    @property
    def rules(self) -> StepRules:
        """The steps' length and cooling; with plates."""
        return StepRules(self.time_step, self.cooling ** (self.frequency * self.time_step))

    def strain_rate(self, time_t: ArrayLike, *, first_step: int = 0) -> NDArray[np.float64]:
        """Return the shear rate that steps at these times set [1/s], the first of them being that step of the protocol.

        Its left sums are the strain, A sin with half a step's lag and an offset of A pi f dt.
        """
        time = check.finite_array("time_t", time_t, shape=(None,), what="step")
        step_t = np.arange(len(time)) + check.integer("first_step", first_step, at_least=0)
        f, dt = self.frequency, self.time_step
        sheared = (step_t >= self.pre_periods / f / dt) & (step_t <= (self.pre_periods + self.periods) / f / dt)
        cosine = np.cos(2.0 * math.pi * (time * f - self.pre_periods))
        return np.where(sheared, self.amplitude * 2.0 * math.pi * f * cosine, 0.0)

    def run(self, start: ShearedDiscs, *, frames: int = 0) -> ParticleShearRun:
        """Return the run of the experiment on discs that are ready for it.

        Parameters
        ----------
        start
            The discs at the protocol's first step, in the experiment's cell; their time must be 0.
        frames
            How many states to keep, evenly spaced from the start to the end; they change no bit of the run.

        """
        check.instance("start", start, ShearedDiscs)
        check.integer("frames", frames, at_least=0, bytes_each=check.FRAME_BYTES)
        if start.time != 0.0:
            raise ValueError(f"start must be at time 0, got {start.time:g} s")
        if (start.width, start.height) != (self.width, self.height):
            raise ValueError(
                f"start must be in the experiment's cell of {self.width:g} by {self.height:g}, "
                f"got one of {start.width:g} by {start.height:g}"
            )
        steps = self.steps
        if steps < 1:
            raise ValueError(f"the protocol must last at least one step, got {steps}")
        time_t = np.add.accumulate(np.concatenate([[0.0], np.full(steps - 1, self.time_step)]))
        rate_t = self.strain_rate(time_t)
        stops = sorted({*np.linspace(0, steps, frames).astype(int).tolist(), 0, steps} if frames else {0, steps})
        kept, parts, state = ([start] if frames else []), [], start
        for first, last in zip(stops[:-1], stops[1:], strict=True):
            part = advance(state, self.material, self.rules, rate_t[first:last])
            state = part.final
            parts.append(part)
            if frames > 1:
                kept.append(state)
        joined = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in dataclasses.fields(Steps)
            if field.name.endswith(("_t", "_tsdd"))
        }
        for array in joined.values():
            array.flags.writeable = False
        return ParticleShearRun(self, start, tuple(kept), Steps(state, last=parts[-1].last, **joined))


@shown()
@dataclasses.dataclass(frozen=True, eq=False)
class ParticleShearRun:
    """What an experiment of `ParticleShear` gave.

    Attributes
    ----------
    experiment, start
        What was run, on what.
    frames
        The states that were kept, evenly spaced.
    series
        Times, strains, rates, the nine tensors and counts of every step, and the final state.

    """

    experiment: ParticleShear
    start: ShearedDiscs
    frames: tuple[ShearedDiscs, ...]
    series: Steps

    @property
    def final(self) -> ShearedDiscs:
        """The state after the last step."""
        return self.series.final

    @property
    def time_t(self) -> NDArray[np.float64]:
        """(T,) times [s]."""
        return self.series.time_t

    @property
    def strain_t(self) -> NDArray[np.float64]:
        """(T,) shear strains [1]."""
        return self.series.strain_t

    @property
    def position_tnd(self) -> NDArray[np.float64]:
        """(frames, N, 2) positions of the states kept [um]."""
        return np.array([state.position_nd for state in self.frames])

    def stress(self, name: str = "overall") -> NDArray[np.float64]:
        """Return the (T, 2, 2) tensor of that name [Pa], compression positive."""
        return self.series.stress(name)

    def shear_stress(self, name: str = "overall") -> NDArray[np.float64]:
        """Return the (T,) shear stress -sigma_xy of the tensor of that name [Pa] (S1-25)."""
        return -self.series.stress(name)[:, 0, 1]

    def moduli(
        self, name: str = "overall", *, drift: str = "package", largest_jump: float | None = None
    ) -> ComplexModuli:
        """Return G' and G'' from the tensor of that name, with drift and jumps treated as `demodulate` says."""
        stress = self.shear_stress(name)
        return demodulate(self.time_t, stress, self.experiment.protocol, drift=drift, largest_jump=largest_jump)

    def table(self) -> Table:
        """Return strain, rate and the nine tensors against time."""
        found = {"time": self.time_t, "strain": self.strain_t, "strain_rate": self.series.strain_rate_t}
        units = {"time": "s", "strain": "1", "strain_rate": "1/s"}
        for name in STRESSES:
            found[f"{name}_stress"] = self.stress(name)
            units[f"{name}_stress"] = "Pa"
        return make_table(found, {"kind": "ParticleShearRun", "dimension": 2, "sign": "compression positive"}, units)
