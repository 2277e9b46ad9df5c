"""Series under oscillatory shear: repeats x amplitudes x friction, with controls, means and error bars."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import function, instance, integer, one_of, real
from packmech.dynamics.rheology.oscillatory import oscillatory_shear
from packmech.dynamics.rheology.sweep import check_amplitudes
from packmech.dynamics.rheology.trials import (
    CONTROLS,
    Settings,
    ShearTrial,
    controlled,
    fingerprint,
    read_trial,
    trial_of,
    write_trial,
)
from packmech.measure import mean_with_error, yield_strain
from packmech.measure.averages import ERRORS
from packmech.scene import Scene

# told as (control, friction, repeat, amplitude)
Told = Callable[[str, float | None, int, float], None]


@dataclass(frozen=True, eq=False)
class ShearCurve:
    """Means over repeats against the amplitude; errors are those of the means.

    Attributes
    ----------
    control, friction
        What was sheared.
    amplitude_a
        (A,) amplitudes, rising [1].
    storage_a, loss_a, storage_error_a, loss_error_a
        (A,) means of G' and G'' and their errors [energy/length^d]; errors are nan with a single repeat.
    yield_strain, yield_strain_error
        Mean over the repeats that yield within the amplitudes, and its error [1]; nan where none does.
    yielding
        How many repeats do.

    """

    control: str
    friction: float | None
    amplitude_a: NDArray[np.float64]
    storage_a: NDArray[np.float64]
    loss_a: NDArray[np.float64]
    storage_error_a: NDArray[np.float64]
    loss_error_a: NDArray[np.float64]
    yield_strain: float
    yield_strain_error: float
    yielding: int


@dataclass(frozen=True, eq=False)
class ShearSeries:
    """A series: every trial by (control, friction, repeat, amplitude), and the curves of its means."""

    trials: dict[tuple[str, float | None, int, float], ShearTrial]
    curves: tuple[ShearCurve, ...]

    def curve(self, control: str = "prepared", friction: float | None = None) -> ShearCurve:
        """Return the curve of a control, at a friction if several were asked for.

        Raises
        ------
        KeyError
            If there is none.

        """
        for one in self.curves:
            if one.control == control and one.friction == friction:
                return one
        raise KeyError(f"no curve of {control!r} at friction {friction!r}")


def shear_series(
    prepare: Callable[[int], Scene],
    folder: str | os.PathLike[str] | None = None,
    *,
    amplitudes: Sequence[float],
    repeats: int = 3,
    frictions: Sequence[float] | None = None,
    controls: Sequence[str] = ("prepared",),
    seed: int = 0,
    frequency: float | None = None,
    relative_frequency: float | None = None,
    pre_periods: float = 0.0,
    periods: float = 4.0,
    post_periods: float = 0.0,
    axes: tuple[int, int] = (0, 1),
    dt: float | None = None,
    samples_per_period: int = 200,
    error: str = "standard",
    progress: Told | None = None,
) -> ShearSeries:
    """Return G' and G'' against amplitude over repeats, for several frictions and controls.

    Parameters
    ----------
    prepare
        prepare(seed) returns the scene of a repeat, the same for the same seed.
    folder
        Where trials are kept, a file for each and a checkpoint of the one underway, so that interrupted work goes on
        where it was when called again, and more repeats, amplitudes, frictions or controls may be asked for. None
        keeps nothing.
    amplitudes
        Of the strain [1].
    repeats
        How many scenes are prepared.
    frictions
        Coefficients of friction that replace those of the scenes; None leaves them.
    controls
        Which of these are sheared: "prepared", the scenes as they are; "bulk", with every contact a bond;
        "uncrosslinked", without bonds; "frictionless", without friction (sheared once, whatever the frictions).
    seed
        Seeds of the repeats are drawn from it, each for itself.
    frequency, relative_frequency, pre_periods, periods, post_periods, axes, dt, samples_per_period
        As in `oscillatory_shear`.
    error
        "standard" or "bootstrap", as in `mean_with_error`.
    progress
        Called as progress(control, friction, repeat, amplitude) when a trial is finished.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the folder holds trials of other settings or scenes.
    NotConverged
        If a time step is too long.
    KeyboardInterrupt
        Passed on; what is in the folder stays there.

    Examples
    --------
    >>> import packmech as pm
    >>> def prepare(seed):
    ...     start = pm.random_packing(8, dimension=2, packing_fraction=1.0, seed=seed)
    ...     scene = pm.Scene(start, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.1)))
    ...     return scene.replace(packing=pm.quench(pm.Scene(start, scene.effects[:1]), force_tolerance=1e-9).packing)
    >>> series = pm.shear_series(prepare, amplitudes=[1e-3], repeats=2, frequency=0.01, periods=2)
    >>> len(series.trials), series.curve().storage_a.shape
    (2, (1,))

    """
    function("prepare", prepare)
    asked = sorted(check_amplitudes(amplitudes))
    count = integer("repeats", repeats, at_least=1)
    rubs = _frictions(frictions)
    kinds = _controls(controls)
    source = integer("seed", seed, at_least=0)
    one_of("error", error, ERRORS)
    if progress is not None:
        function("progress", progress)
    if folder is not None:
        if not isinstance(folder, str | os.PathLike):
            raise TypeError(f"folder must be a path or None, got {folder!r}")
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
    choices: dict[str, Any] = {
        "frequency": frequency,
        "relative_frequency": relative_frequency,
        "pre_periods": pre_periods,
        "periods": periods,
        "post_periods": post_periods,
        "axes": axes,
        "dt": dt,
        "samples_per_period": samples_per_period,
    }
    pairs = [(kind, rub) for kind in kinds for rub in ([None] if kind == "frictionless" else rubs)]
    trials: dict[tuple[str, float | None, int, float], ShearTrial] = {}
    for repeat in range(count):
        start = int(np.random.SeedSequence([source, repeat]).generate_state(1, dtype=np.uint32)[0])
        prepared = prepare(start)
        instance("prepare(seed)", prepared, Scene)
        for (kind, rub), amplitude in itertools.product(pairs, asked):
            settings = Settings(kind, rub, repeat, amplitude, **choices)
            trials[kind, rub, repeat, amplitude] = _trial(prepared, settings, choices, folder)
            if progress is not None:
                progress(kind, rub, repeat, amplitude)
    return ShearSeries(trials, tuple(_curve(trials, kind, rub, count, asked, error) for kind, rub in pairs))


def _frictions(frictions: Any) -> list[float | None]:
    if frictions is None:
        return [None]
    if isinstance(frictions, str) or not isinstance(frictions, Sequence | np.ndarray) or not len(frictions):
        raise TypeError(f"frictions must be a list of coefficients or None, got {frictions!r}")
    found: list[float | None] = [real("frictions", one, at_least=0.0) for one in frictions]
    if len(set(found)) != len(found):
        raise ValueError(f"frictions must name each coefficient once, got {frictions!r}")
    return found


def _controls(controls: Any) -> list[str]:
    if isinstance(controls, str) or not isinstance(controls, Sequence) or not len(controls):
        raise TypeError(f"controls must be a list of names, got {controls!r}")
    return list(dict.fromkeys(one_of("controls", one, CONTROLS) for one in controls))


def _trial(prepared: Scene, settings: Settings, choices: dict[str, Any], folder: Path | None) -> ShearTrial:
    scene = controlled(prepared, settings.control, settings.friction)
    text = settings.text(fingerprint(scene))
    path = None if folder is None else settings.path(folder)
    if path is not None and path.exists():
        return read_trial(path, text)
    underway = None if path is None else path.with_suffix(".underway.npz")
    trial = trial_of(oscillatory_shear(scene, amplitude=settings.amplitude, checkpoint=underway, **choices))
    if path is not None and underway is not None:
        write_trial(path, text, trial)
        underway.unlink()
    return trial


def _curve(
    trials: dict[tuple[str, float | None, int, float], ShearTrial],
    control: str,
    friction: float | None,
    repeats: int,
    amplitudes: list[float],
    error: str,
) -> ShearCurve:
    rows = [[trials[control, friction, repeat, a] for a in amplitudes] for repeat in range(repeats)]
    storage = np.array([[one.storage for one in row] for row in rows])
    loss = np.array([[one.loss for one in row] for row in rows])
    means = [np.array([mean_with_error(column, error=error) for column in table.T]) for table in (storage, loss)]
    ends = np.array([yield_strain(amplitudes, up, down) for up, down in zip(storage, loss, strict=True)])
    ends = ends[np.isfinite(ends)]
    end, end_error = mean_with_error(ends, error=error) if len(ends) else (float("nan"), float("nan"))
    return ShearCurve(
        control,
        friction,
        np.array(amplitudes),
        means[0][:, 0],
        means[1][:, 0],
        means[0][:, 1],
        means[1][:, 1],
        end,
        end_error,
        len(ends),
    )
