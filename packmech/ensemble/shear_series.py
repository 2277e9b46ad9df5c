"""`shear_series`: amplitude sweeps over repeats and friction, with controls, means and error bars."""

from __future__ import annotations

import dataclasses
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache, wraps
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.status import check_progress, shows
from packmech.check import (
    brief,
    check_memory,
    clear_errors,
    function,
    instance,
    integer,
    one_of,
    positive,
    real,
    two_axes,
)
from packmech.effects import Bonds, Friction, bonds_of, friction_of
from packmech.effects.bonds import bond_contacts
from packmech.ensemble.folder import CHECKPOINT, WORKSPACE, find, read_arrays
from packmech.ensemble.members import member_of
from packmech.ensemble.run import complete_members, member_settings
from packmech.files.paths import file_name, made_folder
from packmech.loop.checkpoint import fingerprint, scene_fingerprints
from packmech.measure.signals import ERRORS, mean_with_error, yield_strain
from packmech.result import NotConverged
from packmech.rheology.amplitude_sweep import check_amplitudes
from packmech.rheology.oscillatory import oscillatory_shear
from packmech.scene import Scene
from packmech.scenes.scene_file import read_scene, write_scene

# beside the members: scenes that their parameters name
SCENES = "scenes"
CONTROLS = ("prepared", "bulk", "uncrosslinked", "frictionless")
# what a trial takes at least: its key, its scene's name, its signals
_TRIAL_BYTES = 2000.0
# called as (control, friction, repeat, amplitude)
TrialProgress = Callable[[str, float | None, int, float], None]


@shown()
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
    outcome
        The name of the outcome: "FINISHED", or "NOT_STEADY" or "NEAR_RESONANCE" where the moduli are known badly, or
        led by inertia.

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
    outcome: str = "FINISHED"


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
    bonds = bonds_of(effects)
    if control in ("bulk", "uncrosslinked") and bonds is None:
        raise ValueError(f"controls must not hold {control!r} where prepare(seed) returns a scene without Bonds")
    if friction is not None:
        if not friction_of(effects):
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
            breaks_at=bonds.breaks_at,
        )
        effects = tuple(whole if isinstance(one, Bonds) else one for one in effects)
    scene = scene.replace(effects=effects)
    left_out = {"uncrosslinked": Bonds, "frictionless": Friction}.get(control)
    return scene if left_out is None else scene.without(left_out)


@shown()
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
    unmet_a
        (A,) in how many trials the moduli are known badly or led by inertia: these are in the means, too.

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
    unmet_a: NDArray[np.int64]


@shown()
@dataclass(frozen=True, eq=False)
class ShearSeries:
    """A series: every trial by (control, friction, repeat, amplitude), and the curves of its means."""

    trials: dict[tuple[str, float | None, int, float], ShearTrial]
    curves: tuple[ShearCurve, ...]

    def __repr__(self) -> str:
        """Return what was sheared, in a line."""
        kinds = ", ".join(one.control + ("" if one.friction is None else f" {one.friction:g}") for one in self.curves)
        unmet = sum(one.outcome != "FINISHED" for one in self.trials.values())
        badly = f"; {unmet} of them not steady or led by inertia" if unmet else ""
        return (
            f"ShearSeries: {len(self.trials)} trials at {len(self.curves[0].amplitude_a)} amplitudes of {kinds}{badly}"
        )

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


@clear_errors
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
    workers: int | None = 0,
    progress: TrialProgress | bool | None = None,
) -> ShearSeries:
    """Return G' and G'' against amplitude over repeats, for several frictions and controls.

    Parameters
    ----------
    prepare
        prepare(seed) returns the scene of a repeat, the same for the same seed.
    folder
        An ensemble with a member for each trial (`pm.read_ensemble`), and the scenes. Interrupted work goes on where it
        was when called again, within a trial too, and more repeats, amplitudes, frictions or controls may be asked for.
        None keeps nothing.
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
    workers
        How many processes share the trials, as in `run_ensemble`; 0: none, they run here. Scenes with laws or effects
        of your own need 0.
    progress
        Called as progress(control, friction, repeat, amplitude) for every trial that is finished.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.
    NotConverged
        If a run does not come to its end, as where a time step is too long; a RuntimeError where other processes run
        the trials.
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
    count = integer("repeats", repeats, at_least=1, bytes_each=_TRIAL_BYTES * len(asked))
    coefficients = _frictions(frictions)
    kinds = _controls(controls)
    source = integer("seed", seed, at_least=0)
    one_of("error", error, ERRORS)
    check_progress(progress)
    choices: dict[str, Any] = {
        "frequency": None if frequency is None else positive("frequency", frequency),
        "relative_frequency": None
        if relative_frequency is None
        else positive("relative_frequency", relative_frequency),
        "pre_periods": real("pre_periods", pre_periods, at_least=0.0),
        "periods": real("periods", periods, at_least=1.0),
        "post_periods": real("post_periods", post_periods, at_least=0.0),
        "axes": two_axes("axes", axes),
        "dt": None if dt is None else positive("dt", dt),
        "samples_per_period": integer("samples_per_period", samples_per_period, at_least=1),
    }
    pairs = [(kind, friction) for kind in kinds for friction in ([None] if kind == "frictionless" else coefficients)]
    keys = [
        (kind, friction, repeat, a)
        for repeat in range(count)
        for (kind, friction), a in itertools.product(pairs, asked)
    ]
    # a function of its own figures hears of trials only
    line = progress if isinstance(progress, bool) else False if callable(progress) else None
    with _folder_of(folder) as place, shows("shear series", line) as report:

        def finished(number: int) -> None:
            if callable(progress):
                progress(*keys[number])
            else:
                report("shear series, trial finished", {"number": number + 1, "of": len(keys)})

        scenes = []
        for repeat in range(count):
            start = int(np.random.SeedSequence([source, repeat]).generate_state(1, dtype=np.uint32)[0])
            scenes.append(_kept(place, prepare(start), pairs))
        names = ("control", "friction", "repeat", "amplitude")
        wanted = [{"scene": scenes[key[2]], **dict(zip(names, key, strict=True)), **choices} for key in keys]
        members = _complete(wanted, place, workers, finished)
        trials = dict(zip(keys, map(_trial_of, members), strict=True))
    return ShearSeries(trials, tuple(_curve(trials, kind, friction, count, asked, error) for kind, friction in pairs))


@contextmanager
def _folder_of(folder: str | os.PathLike[str] | None) -> Iterator[Path]:
    """Give the folder that was named, or for None one that is removed when the block ends."""
    if folder is None:
        with tempfile.TemporaryDirectory(prefix="packmech-") as place:
            yield Path(place)
        return
    yield file_name("folder", folder, "a folder's name or None")


def _kept(folder: Path, scene: Any, pairs: Sequence[tuple[str, float | None]]) -> str:
    """Write a scene that was prepared into the folder once, after checking that it has what the controls change.

    Returned is its name, a hash of what it holds.
    """
    instance("prepare(seed)", scene, Scene)
    for kind, friction in pairs:
        controlled(scene, kind, friction)
    name = fingerprint([sorted(scene_fingerprints(scene).items()), scene.drive])[:32]
    path = folder / SCENES / f"{name}.toml"
    if not path.exists():
        made_folder("folder", path.parent)
        write_scene(scene, path)
    return name


@lru_cache(maxsize=4)
def _scene_at(path: Path) -> Scene:
    """Return a scene that was kept, which never changes."""
    return read_scene(path)


def _complete(
    wanted: Sequence[Mapping[str, Any]], folder: Path, workers: int | None, finished: Callable[[int], None] | None
) -> list[dict[str, Any]]:
    """Return what trials with these parameters left, after running those that are missing or failed before.

    Here (no workers) the first exception passes on at once; else all are run before failures are raised. `finished` is
    called with the number of each trial that is done.
    """
    if workers is not None:
        integer("workers", workers, at_least=0)
    members = [member_of(one) for one in wanted]
    numbers = {one.id: k for k, one in enumerate(members)}
    found: dict[int, dict[str, Any]] = {}
    raised: list[Exception] = []

    def take(number: int) -> None:
        result = find(folder, members[number]).result
        if result is not None and number not in found:
            found[number] = result["values"] | read_arrays((folder / WORKSPACE / members[number].id).absolute())
            if finished is not None:
                finished(number)

    @wraps(shear_trial)
    def here(**given: Any) -> ShearTrial:
        try:
            return shear_trial(**given)
        except Exception as error:
            raised.append(error)
            raise

    def report(stage: str, figures: dict[str, Any]) -> None:
        if raised:
            raise raised[0]
        if "member" in figures:
            take(numbers[figures["member"]])

    for number in range(len(members)):
        take(number)
    if len(found) < len(members):
        grid = [{name: [value] for name, value in one.items()} for one in wanted]
        job = here if workers == 0 else shear_trial
        complete_members(job, grid, folder, member_settings(workers=workers, retry=True, progress=report))
    failed = [one for number, one in enumerate(members) if number not in found]
    if failed:
        failure = find(folder, failed[0]).failure or {}
        reason, message = failure.get("reason", ""), failure.get("message", "")
        kind = {"TypeError": TypeError, "ValueError": ValueError}.get(reason, RuntimeError)
        raise kind(
            f"{message} ({reason} of {failed[0].parameters}; {len(failed)} of {len(members)} members failed in "
            f"{folder}, which has their tracebacks; the others are finished and stay)"
        )
    return [found[number] for number in range(len(members))]


def _frictions(frictions: Any) -> list[float | None]:
    if frictions is None:
        return [None]
    if isinstance(frictions, str) or not isinstance(frictions, Sequence | np.ndarray) or not len(frictions):
        raise TypeError(f"frictions must be a list of coefficients or None, got {brief(frictions)}")
    check_memory("frictions", _TRIAL_BYTES * len(frictions))
    found: list[float | None] = [real("frictions", one, at_least=0.0) for one in frictions]
    if len(set(found)) != len(found):
        raise ValueError(f"frictions must name each coefficient once, got {brief(frictions)}")
    return found


def _controls(controls: Any) -> list[str]:
    if isinstance(controls, str) or not isinstance(controls, Sequence) or not len(controls):
        raise TypeError(f"controls must be a list of names, got {brief(controls)}")
    return list(dict.fromkeys(one_of("controls", one, CONTROLS) for one in controls))


def shear_trial(
    folder: Path, scene: str, control: str, friction: float | None, repeat: int, amplitude: float, **choices: Any
) -> ShearTrial:
    """Return what a member of a series is: one trial of a scene that is kept beside the members."""
    strained = controlled(_scene_at(folder.parents[1] / SCENES / f"{scene}.toml"), control, friction)
    run = oscillatory_shear(strained, amplitude=amplitude, checkpoint=folder / CHECKPOINT, check=False, **choices)
    if not run.measured:
        raise NotConverged(run)
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
        run.outcome.name,
    )


def _trial_of(kept: Mapping[str, Any]) -> ShearTrial:
    return ShearTrial(**{field.name: kept[field.name] for field in dataclasses.fields(ShearTrial)})


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
        np.array([sum(one.outcome != "FINISHED" for one in column) for column in zip(*rows, strict=True)]),
    )
