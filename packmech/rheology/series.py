"""Amplitude sweeps, and series of them over repeats and friction, with controls, means and error bars."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.check import function, instance, integer, one_of, positive, real, two_axes
from packmech.effects import Bonds, Friction
from packmech.effects.bonds import bond_contacts
from packmech.honors import honors
from packmech.loop.checkpoint import read_results, scene_fingerprints, write_checkpoint
from packmech.loop.run_loop import Progress
from packmech.measure.signals import ERRORS, mean_with_error, softening_strain, yield_strain
from packmech.rheology.arguments import Several, listed, runs_file
from packmech.rheology.oscillatory import OscillatoryShear, oscillatory_shear
from packmech.scene import Scene

KIND = "trials of oscillatory shear"
CONTROLS = ("prepared", "bulk", "uncrosslinked", "frictionless")
# called as (control, friction, repeat, amplitude)
TrialProgress = Callable[[str, float | None, int, float], None]


@dataclass(frozen=True, eq=False)
class AmplitudeSweep:
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


def check_amplitudes(amplitudes: Any) -> list[float]:
    """Return the amplitudes after checking that they are positive and differ.

    Raises
    ------
    TypeError, ValueError
        Naming what is wrong.

    """
    if isinstance(amplitudes, str) or not isinstance(amplitudes, Sequence | np.ndarray) or not len(amplitudes):
        raise TypeError(f"amplitudes must be a list of strain amplitudes, got {amplitudes!r}")
    found = [positive("amplitudes", one) for one in amplitudes]
    if len(set(found)) != len(found):
        raise ValueError(f"amplitudes must name each amplitude once, got {amplitudes!r}")
    return found


@listed(Several)
@honors("repulsion damping friction bonds gravity walls drag shapes")
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
    progress
        Called now and then as progress(stage, figures), the stage naming the amplitude.
    checkpoint
        As in `oscillatory_shear`, one file for all amplitudes: those that were finished are not run again.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If a time step is too long; its `.run` holds that run.
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
    if progress is not None:
        function("progress", progress)
    # one file for all of them
    file = runs_file(common.get("checkpoint"))
    runs: list[OscillatoryShear] = []
    for amplitude in asked:
        reported = None if progress is None else named(progress, amplitude)
        given: Several = {**common, "progress": reported, "checkpoint": file}
        try:
            run = oscillatory_shear(
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
            )
        except KeyboardInterrupt as stop:
            stop.run = _gathered(asked, runs) if runs else None  # type: ignore[attr-defined]
            raise
        runs.append(run)
    return _gathered(asked, runs)


def named(progress: Progress, amplitude: float) -> Callable[[str, dict[str, Any]], None]:
    """Return a progress function that hears of the amplitude as well."""
    return lambda stage, figures: progress(f"{stage} at amplitude {amplitude:g}", figures)


def _gathered(amplitudes: list[float], runs: list[OscillatoryShear]) -> AmplitudeSweep:
    moduli = [run.moduli for run in runs]
    table = [
        (np.nan,) * 4 if one is None else (one.storage, one.loss, one.storage_error, one.loss_error) for one in moduli
    ]
    storage, loss, storage_error, loss_error = np.array(table).T.copy()
    return AmplitudeSweep(np.array(amplitudes[: len(runs)]), storage, loss, storage_error, loss_error, tuple(runs))


@dataclass(frozen=True)
class Settings:
    """What decides the numbers of one trial, beside the scene."""

    control: str
    friction: float | None
    repeat: int
    amplitude: float
    frequency: float | None
    relative_frequency: float | None
    pre_periods: float
    periods: float
    post_periods: float
    axes: tuple[int, int]
    dt: float | None
    samples_per_period: int

    def table(self, scene: Scene) -> dict[str, Any]:
        """Return the settings and the fingerprints of the scene, to be compared with those of a file."""
        return {**asdict(self), "axes": list(self.axes), "scene": scene_fingerprints(scene)}

    def path(self, folder: Path) -> Path:
        """Return the file of the trial."""
        friction = "" if self.friction is None else f"-friction{self.friction:g}"
        return folder / f"{self.control}{friction}-amplitude{self.amplitude:g}-repeat{self.repeat:03d}.npz"


@dataclass(frozen=True, eq=False)
class ShearTrial:
    """One trial: moduli, and the stress against time.

    Attributes
    ----------
    storage, loss
        G' and G'' of the overall stress [energy/length^d].
    storage_error, loss_error
        Their errors over periods.
    time_t, strain_t, stress_tdd
        (T,) times, strains and (T, d, d) overall stresses.
    contacts_t, sliding_t
        (T,) numbers of contacts, and of those that slide.
    seconds
        CPU time.

    """

    storage: float
    loss: float
    storage_error: float
    loss_error: float
    time_t: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    stress_tdd: NDArray[np.float64]
    contacts_t: NDArray[np.int64]
    sliding_t: NDArray[np.int64]
    seconds: float


def controlled(scene: Scene, control: str, friction: float | None) -> Scene:
    """Return the scene with other bonds or other friction.

    "prepared": as it is. "bulk": every contact a bond, of the kind that the scene has. "uncrosslinked": no bonds.
    "frictionless": contacts without friction. A friction coefficient replaces that of the scene.

    Raises
    ------
    ValueError
        If the scene lacks what the control changes.

    """
    effects = scene.effects
    bonds = next((one for one in effects if isinstance(one, Bonds)), None)
    if control in ("bulk", "uncrosslinked") and bonds is None:
        raise ValueError(f"controls must not hold {control!r} where prepare(seed) returns a scene without Bonds")
    if friction is not None:
        if not any(isinstance(one, Friction) for one in effects):
            raise ValueError("frictions must be None where prepare(seed) returns a scene without Friction")
        effects = tuple(one._replace(coefficient=friction) if isinstance(one, Friction) else one for one in effects)
    if control == "bulk":
        assert bonds is not None
        whole = bond_contacts(
            scene.packing,
            compression=bonds.compression,
            tension=bonds.tension,
            tangential_stiffness=bonds.tangential_stiffness,
            damping=bonds.damping,
            tangential_damping=bonds.tangential_damping,
        )
        effects = tuple(whole if isinstance(one, Bonds) else one for one in effects)
    elif control == "uncrosslinked":
        effects = tuple(one for one in effects if not isinstance(one, Bonds))
    elif control == "frictionless":
        effects = tuple(one for one in effects if not isinstance(one, Friction))
    return scene.replace(effects=effects)


def trial_of(run: OscillatoryShear) -> ShearTrial:
    """Return what is kept of a run."""
    assert run.moduli is not None
    return ShearTrial(
        run.moduli.storage,
        run.moduli.loss,
        run.moduli.storage_error,
        run.moduli.loss_error,
        run.time_t,
        run.strain_t,
        run.stress["overall"],
        run.contacts_t,
        run.sliding_t,
        run.seconds,
    )


def read_trial(path: Path, table: dict[str, Any]) -> ShearTrial:
    """Return a trial that was kept.

    Raises
    ------
    ValueError
        If the file cannot be read, or holds a trial of other settings.

    """
    kept = read_results(path, KIND, table)
    named: dict[str, Any] = {
        field.name: kept[field.name] if kept[field.name].ndim else float(kept[field.name])
        for field in dataclasses.fields(ShearTrial)
    }
    return ShearTrial(**named)


def write_trial(path: Path, table: dict[str, Any], trial: ShearTrial) -> None:
    """Write the file of a trial."""
    kept = {field.name: np.asarray(getattr(trial, field.name)) for field in dataclasses.fields(trial)}
    write_checkpoint(path, KIND, table, kept)


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
    progress: TrialProgress | None = None,
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
    coefficients = _frictions(frictions)
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
        "axes": two_axes("axes", axes),
        "dt": dt,
        "samples_per_period": samples_per_period,
    }
    pairs = [(kind, friction) for kind in kinds for friction in ([None] if kind == "frictionless" else coefficients)]
    trials: dict[tuple[str, float | None, int, float], ShearTrial] = {}
    for repeat in range(count):
        start = int(np.random.SeedSequence([source, repeat]).generate_state(1, dtype=np.uint32)[0])
        prepared = prepare(start)
        instance("prepare(seed)", prepared, Scene)
        for (kind, friction), amplitude in itertools.product(pairs, asked):
            settings = Settings(kind, friction, repeat, amplitude, **choices)
            trials[kind, friction, repeat, amplitude] = _trial(prepared, settings, choices, folder)
            if progress is not None:
                progress(kind, friction, repeat, amplitude)
    return ShearSeries(trials, tuple(_curve(trials, kind, friction, count, asked, error) for kind, friction in pairs))


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
    table = settings.table(scene)
    path = None if folder is None else settings.path(folder)
    if path is not None and path.exists():
        return read_trial(path, table)
    underway = None if path is None else path.with_suffix(".underway.npz")
    trial = trial_of(oscillatory_shear(scene, amplitude=settings.amplitude, checkpoint=underway, **choices))
    if path is not None and underway is not None:
        write_trial(path, table, trial)
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
