"""Strain at a constant rate: shear, uniaxial and isotropic compression, and the flow curve of steady shear."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.check import integer, one_of, positive, real
from packmech.dynamics.march.flow import Ramp
from packmech.dynamics.rheology.manner import Common, Manner, Several, check_arguments, listed, two_axes
from packmech.dynamics.rheology.travel import StrainRun, Travel
from packmech.dynamics.strain import MODES, SteadyStrain
from packmech.measure import block_mean
from packmech.scene import Scene

STAGE = "steady strain"


@listed(Common)
def ramp_strain(
    scene: Scene,
    *,
    rate: float,
    strain: float,
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
    strain
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
    >>> run = pm.ramp_strain(scene, rate=-1e-3, strain=0.01, mode="isotropic")
    >>> bool(run.pressure_t[-1] > 1.9 * run.pressure_t[0]), round(float(run.strain_t[-1]), 12)
    (True, -0.01)

    """
    manner = check_arguments(scene, **common)
    speed, most = real("rate", rate), positive("strain", strain)
    if speed == 0.0:
        raise ValueError("rate must not be zero, got 0.0")
    if one_of("mode", mode, MODES) != "shear" and speed < 0.0 and most >= 1.0:
        raise ValueError(f"strain must be below 1 where the box is compressed, got {most:g}")
    count = integer("samples", samples, at_least=1)
    return _ramp(manner, speed, most, mode, two_axes(axes), count)


def _ramp(
    manner: Manner, rate: float, strain: float, mode: str, axes: tuple[int, int], samples: int, stage: str = STAGE
) -> StrainRun:
    direction = SteadyStrain(rate, mode=mode, axes=axes).direction(manner.scene.packing.dimension)
    duration = strain / abs(rate)
    every = max(1, math.ceil(duration / (manner.longest * samples) * (1.0 - 1e-12)))
    steps = every * samples
    travel = Travel(
        manner,
        dt=duration / steps,
        steps=steps,
        every=every,
        profile=Ramp(0.0, rate, 0.0, math.inf),
        direction_dd=direction,
    )
    shown = axes if mode == "shear" else (axes[0], axes[0])
    return travel.end(lambda: travel.go(stage), lambda outcome: StrainRun(**travel.fields(stage, outcome, shown)))


@dataclass(frozen=True, eq=False)
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

    @property
    def viscosity_r(self) -> NDArray[np.float64]:
        """The (R,) stresses over rates [energy time/length^d]."""
        return np.asarray(self.stress_r / self.rate_r)

    @property
    def stress_ratio_r(self) -> NDArray[np.float64]:
        """The (R,) shear stresses over pressures, the macroscopic friction [1]."""
        return np.asarray(self.stress_r / self.pressure_r)


@listed(Several)
def steady_shear(
    scene: Scene,
    *,
    rates: Sequence[float],
    strain: float = 3.0,
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
    strain, skip_strain
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
    >>> curve = pm.steady_shear(scene, rates=[0.1, 0.2], strain=2.0)
    >>> curve.stress_r.shape, bool((curve.pressure_r > 0).all())
    ((2,), True)

    """
    began = time.process_time()
    if isinstance(rates, str) or not isinstance(rates, Sequence | np.ndarray) or not len(rates):
        raise TypeError(f"rates must be a list of shear rates, got {rates!r}")
    speeds = [positive("rates", one) for one in rates]
    most = positive("strain", strain)
    skip = real("skip_strain", skip_strain, at_least=0.0, below=most)
    parts = integer("blocks", blocks, at_least=2)
    count = integer("samples", samples, at_least=1)
    if count * (1.0 - skip / most) < 2 * parts:
        raise ValueError(f"samples must be at least 2 in each of the blocks that count, got {count}")
    manner = check_arguments(scene, **common)
    runs: list[StrainRun] = []

    def curve() -> FlowCurve:
        return _curve(speeds[: len(runs)], tuple(runs), skip, parts, time.process_time() - began)

    pair = two_axes(axes)
    for speed in speeds:
        try:
            runs.append(_ramp(manner, speed, most, "shear", pair, count, f"steady shear at {speed:g}"))
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
