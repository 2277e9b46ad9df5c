"""Amplitude sweeps: G' and G'' of one scene over the amplitude of its strain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import Report, check_progress
from packmech.check import brief
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.signals import softening_strain, yield_strain
from packmech.result import NotConverged
from packmech.rheology.arguments import Several, SeveralRuns, listed, listed_numbers, run_each, runs_file
from packmech.rheology.oscillatory import OscillatoryShear, oscillatory_shear
from packmech.scene import Scene


@shown(lambda sweep: _headline(sweep))
@dataclass(frozen=True, eq=False)
class AmplitudeSweep(SeveralRuns):
    """Moduli against the amplitude of the strain; errors are those over periods.

    Attributes
    ----------
    amplitude_a
        (A,) amplitudes [1].
    storage_a, loss_a
        (A,) G' and G'' of the overall stress [energy/length^d].
    storage_error_a, loss_error_a
        (A,) their errors over periods; nan with less than two periods that count.
    runs
        The run at each amplitude.

    """

    amplitude_a: NDArray[np.float64]
    storage_a: NDArray[np.float64]
    loss_a: NDArray[np.float64]
    storage_error_a: NDArray[np.float64]
    loss_error_a: NDArray[np.float64]
    runs: tuple[OscillatoryShear, ...]

    @property
    def yield_strain(self) -> float:
        """Amplitude at which G' = G'' [1], as the function of this name finds it; nan where they do not cross."""
        return yield_strain(self.amplitude_a, self.storage_a, self.loss_a)

    def softening_strain(self, remaining: float = 0.9) -> float:
        """Return the amplitude above which G' is less than a part of what it is at the smallest [1]; nan if nowhere."""
        return softening_strain(self.amplitude_a, self.storage_a, remaining=remaining)


def _headline(sweep: AmplitudeSweep) -> str:
    """Return how many bonds broke at the amplitudes, where any may: moduli are then those of networks that break."""
    broken = sweep.bonds_broken
    return "" if broken is None else f"bonds broken at each amplitude: {', '.join(map(str, broken))}"


def check_amplitudes(amplitudes: Any) -> list[float]:
    """Return the amplitudes after checking that they are positive and differ.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.

    """
    found = listed_numbers("amplitudes", amplitudes, "strain amplitudes")
    if len(set(found)) != len(found):
        raise ValueError(f"amplitudes must name each amplitude once, got {brief(amplitudes)}")
    return found


@listed(Several)
@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag noise shapes breaking")
def amplitude_sweep(
    scene: Scene,
    *,
    amplitudes: Sequence[float],
    frequency: float | None = None,
    relative_frequency: float | None = None,
    pre_periods: float = 0.0,
    periods: float = 4.0,
    post_periods: float = 0.0,
    axes: tuple[int, int] = (0, 1),
    samples_per_period: int = 200,
    **common: Unpack[Several],
) -> AmplitudeSweep:
    """Return G' and G'' at several amplitudes, each from the scene as it is, with the same time step.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    amplitudes
        Of the strain, in any order [1].
    frequency, relative_frequency, pre_periods, periods, post_periods, axes, dt, method, held_n
        As in `oscillatory_shear`.
    samples_per_period, frames
        As in `oscillatory_shear`.
    time_limit
        Stop after so much CPU time for all amplitudes, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures), the stage naming the amplitude.
    checkpoint
        As in `oscillatory_shear`, one file for all amplitudes: those that were finished are not run again.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If a run does not get to its end, as where time is up; its `.run` holds that run, its `.finished` the sweep of
        those before, or None, and a checkpoint both. Amplitudes whose moduli are unsteady or led by inertia stay in
        the sweep: `AmplitudeSweep.outcome` says so.
    KeyboardInterrupt
        Passed on with `.run` set to the sweep of the amplitudes that were finished, or None.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.1)))
    >>> sweep = pm.amplitude_sweep(scene, amplitudes=[1e-4, 1e-3], frequency=0.01, periods=2)
    >>> sweep.storage_a.round(3).tolist()
    [0.42, 0.42]

    """
    asked = check_amplitudes(amplitudes)
    progress = common.get("progress")
    check_progress(progress)
    # one file for all of them
    file = runs_file(common.get("checkpoint"))
    clock = RunLoop(run_settings(time_limit=common.get("time_limit")))

    def run(amplitude: float) -> OscillatoryShear:
        reported = named(progress, amplitude) if callable(progress) else progress
        given: Several = {**common, "progress": reported, "checkpoint": file, "time_limit": clock.time_left}
        made = oscillatory_shear(
            scene,
            amplitude=amplitude,
            frequency=frequency,
            relative_frequency=relative_frequency,
            pre_periods=pre_periods,
            periods=periods,
            post_periods=post_periods,
            axes=axes,
            samples_per_period=samples_per_period,
            **given,
            check=False,
        )
        if not made.measured:
            raise NotConverged(made)
        return made

    return run_each(asked, run, lambda runs: _gathered(asked, runs))


def named(progress: Report, amplitude: float) -> Report:
    """Return a progress function that hears of the amplitude as well."""
    return lambda stage, figures: progress(f"{stage} at amplitude {amplitude:g}", figures)


def _gathered(amplitudes: list[float], runs: list[OscillatoryShear]) -> AmplitudeSweep:
    moduli = [run.moduli for run in runs]
    table = [
        (np.nan,) * 4 if one is None else (one.storage, one.loss, one.storage_error, one.loss_error) for one in moduli
    ]
    storage, loss, storage_error, loss_error = np.array(table).T.copy()
    return AmplitudeSweep(np.array(amplitudes[: len(runs)]), storage, loss, storage_error, loss_error, tuple(runs))
