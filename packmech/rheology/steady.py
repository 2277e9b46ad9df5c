"""Strain at a constant rate: shear, uniaxial and isotropic compression, and the flow curve of steady shear."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.check import integer, one_of, positive, real
from packmech.dynamics.deformation import MODES, Ramp, SteadyStrain
from packmech.measure import block_mean, packing_fraction
from packmech.result import Summary, particles_in_words
from packmech.rheology.arguments import Common, Several, StrainSettings, check_arguments, listed, two_axes
from packmech.rheology.strain_run import StrainRun, StrainTask
from packmech.scene import Scene

STAGE = "steady strain"


@listed(Common)
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
        How often figures are kept.
    dt, method, mass_n, velocity_nd, spin_nk, held_n, frames, time_limit, progress, checkpoint, check
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
    speed, most = real("rate", rate), positive("applied_strain", applied_strain)
    if speed == 0.0:
        raise ValueError("rate must not be zero, got 0.0")
    if one_of("mode", mode, MODES) != "shear" and speed < 0.0 and most >= 1.0:
        raise ValueError(f"applied_strain must be below 1 where the box is compressed, got {most:g}")
    count = integer("samples", samples, at_least=1)
    return _ramp(settings, speed, most, mode, two_axes(axes), count)


def _ramp(
    settings: StrainSettings,
    rate: float,
    strain: float,
    mode: str,
    axes: tuple[int, int],
    samples: int,
    stage: str = STAGE,
) -> StrainRun:
    direction = SteadyStrain(rate, mode=mode, axes=axes).direction(settings.scene.packing.dimension)
    duration = strain / abs(rate)
    every = max(1, math.ceil(duration / (settings.longest * samples) * (1.0 - 1e-12)))
    steps = every * samples
    task = StrainTask(
        settings,
        stage,
        dt=duration / steps,
        steps=steps,
        every=every,
        profile=Ramp(0.0, rate, 0.0, math.inf),
        direction_dd=direction,
    )
    shown = axes if mode == "shear" else (axes[0], axes[0])
    return task.run(lambda outcome: StrainRun(**task.fields(outcome, shown)))


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


@dataclass(frozen=True, eq=False, repr=False)
class FlowCurve:
    """Stress against rate in steady shear; errors are those of block means.

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
    headings: ClassVar[tuple[str, ...]] = FLOW_HEADINGS

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
            **{name: getattr(self, column).tolist() for name, column in FLOW_COLUMNS.items()},
            "seconds": self.seconds,
        }

    def summary(self) -> Summary:
        """Return stress and pressure at each rate, and what each run cost, in words."""
        packing = self.runs[0].packing
        title = f"{particles_in_words(packing)} under steady shear"
        unit = self.runs[0].stress_unit
        rows = [
            (f"rate {rate}", f"stress {stress} +- {error}", f"pressure {pressure}; {sliding} slide; {unit}")
            for rate, stress, error, pressure, _, _, _, _, sliding in self.lines()
        ]
        return Summary(title, tuple(rows), tuple(stage for run in self.runs for stage in run.stages))

    def __repr__(self) -> str:
        text = str(self.summary()).split("\n")
        return "\n".join([f"FlowCurve: {text[0]}", *text[1 : 1 + min(len(self.rate_r), 11)]])


@listed(Several)
def steady_shear(
    scene: Scene,
    *,
    rates: Sequence[float],
    applied_strain: float = 3.0,
    skip_strain: float = 1.0,
    blocks: int = 8,
    samples: int = 400,
    axes: tuple[int, int] = (0, 1),
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
    axes, dt, method, mass_n, held_n, frames
        As in `oscillatory_shear`; as many frames of each run.
    progress
        Called now and then as progress(stage, figures), the stage naming the rate.
    checkpoint
        As in `oscillatory_shear`, one file for all rates: those that were finished are not run again.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If a time step is too long; its `.run` holds that run.
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
    if isinstance(rates, str) or not isinstance(rates, Sequence | np.ndarray) or not len(rates):
        raise TypeError(f"rates must be a list of shear rates, got {rates!r}")
    speeds = [positive("rates", one) for one in rates]
    most = positive("applied_strain", applied_strain)
    skip = real("skip_strain", skip_strain, at_least=0.0, below=most)
    parts = integer("blocks", blocks, at_least=2)
    count = integer("samples", samples, at_least=1)
    if count * (1.0 - skip / most) < 2 * parts:
        raise ValueError(f"samples must be at least 2 in each of the blocks that count, got {count}")
    settings = check_arguments(scene, **common)
    runs: list[StrainRun] = []

    def curve() -> FlowCurve:
        return _curve(speeds[: len(runs)], tuple(runs), skip, parts, time.process_time() - began)

    pair = two_axes(axes)
    for speed in speeds:
        try:
            runs.append(_ramp(settings, speed, most, "shear", pair, count, f"steady shear at {speed:g}"))
        except KeyboardInterrupt as stop:
            stop.run = curve() if runs else None  # type: ignore[attr-defined]
            raise
    return curve()


def _curve(rates: list[float], runs: tuple[StrainRun, ...], skip: float, blocks: int, seconds: float) -> FlowCurve:
    table = []
    for run in runs:
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
