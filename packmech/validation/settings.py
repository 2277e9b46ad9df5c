"""The cheapest settings with which a run gives its figures to a stated accuracy, by trial against finer ones."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom
from scipy.stats import t as student

from packmech.calls.status import Progress, check_progress, shows
from packmech.check import boolean, brief, clear_errors, did_you_mean, integer, positive
from packmech.files.paths import PathLike
from packmech.jit.compiled import working_time
from packmech.result import Run
from packmech.scene import Scene, scene_after
from packmech.scenes import run as run_drive
from packmech.scenes.recipes import is_random
from packmech.scenes.scene_file import changed_tables, read_scene_tables, scene_of_tables
from packmech.validation.cheapest import CheapestSettings, SettingTrial
from packmech.validation.knobs import Knob, given_knobs, label, of_a_duration, set_fields, usual_knobs
from packmech.validation.targets import Target, read_targets
from packmech.view.report import examine

# share of the starts whose error must be within the target [1]
_SHARE = 0.9
# probability that a mean over starts is within it: their scatter is known from few [1]
_MEAN_SHARE = 0.95
# how many times as many further starts decide on settings of which that share of the first may be within [1], and how
# likely so few or fewer of them must be where it is [1]
_FURTHER, _UNLIKELY = 3, 0.05
# what is cheaper by less than this factor is not: clocks tell no better [1]
_CHEAPER = 0.95
# a value finer helps where it leaves at most this part of an error [1]; told from so many values
_HELPS, _TRIED = 0.8, 3
# errors below which figures of the same bits are no proof [1]: a last step of Newton's method may be that of both
_SMALL = 1e-6
# starts after which settings may be given up, and errors that are, in units of the target
_FEW, _FAR = 3, 3.0
# references may fail so many times in a row, with finer settings each time
_UNSOUND = 2
# figures that are no answers
_COSTS = ("seconds", "build_seconds", "verdict_seconds", "steps", "force_evaluations")
# repeats beyond these are no answer
_MOST_REPEATS = 1_000_000


@clear_errors
def settings_for(
    scene: Scene | PathLike,
    target: str | Sequence[str] | Mapping[str, float],
    *,
    knobs: Mapping[str, Sequence[Any]] | None = None,
    starts: int = 10,
    seed: int | None = None,
    mean: bool = False,
    time_limit: float | None = None,
    progress: Progress = None,
) -> CheapestSettings:
    """Return the cheapest settings with which the run of a scene gives its figures to a stated accuracy.

    Settings are tried from the cheapest on, from several starts, and compared with runs of the same starts with finer
    ones, which become finer still until some settings meet the target or nothing helps any more. The target is met
    where at least nine in ten of the starts are within it, and another start is expected to be with a probability of
    nine tenths at least (Student's distribution of a further value). Differences from the reference are taken for
    larger by what a reference of first order lacks. Of all settings of the grid that was searched the chosen one is
    the cheapest that meets the target, to a twentieth of its time.

    Parameters
    ----------
    scene
        A scene with a drive; or a scene's file, or the name of one that ships, whose random start is drawn anew for
        each start. A scene itself has one start, for which settings count only where finer ones meet the target, too.
    target
        Figures and how far each may be off, as "storage_modulus:1%", several parted by commas, or as
        {"storage_modulus": 0.01}; of a figure's value, or as it is, "contacts:2 absolute". Figures are those of the
        run and of the report (`packmech run --json`); of one with several entries the largest counts.
    knobs
        Values of fields of the drive, each from coarse to fine, the last for the reference, in place of the usual ones:
        {"drive.dt": (0.1, 0.05, 0.0125)}.
    starts
        How many starts to try; settings of which nine in ten of these may be within are tried with four times as
        many. One: as for a scene itself.
    seed
        Of the first start, 0 unless given; the others follow.
    mean
        Whether the figures are means over starts: how many of them the mean takes to be within the target in 19 of 20
        cases is then one of the settings, and the error is that of the mean.
    time_limit
        Stop after so much CPU time [s]; what was found until then is not met.
    progress
        Called as progress(stage, figures); None shows a line.

    Returns
    -------
    CheapestSettings
        With `met`, which must be looked at; with all that was tried.

    Raises
    ------
    TypeError, ValueError
        Naming the argument; of a figure that the run does not give, with those that it does.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, packing_fraction=0.95, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),), pm.QuenchDrive(method=pm.Fire()))
    >>> found = pm.settings_for(scene, "energy:0.1%")
    >>> found.met, found.scene.drive.force_tolerance in (1e-1, 1e-2, 1e-3)
    (True, True)

    """
    count = integer("starts", starts, at_least=1)
    targets = read_targets(target)
    if isinstance(scene, Scene):
        if seed is not None:
            raise ValueError(f"seed must be left out for a scene with one start, got {brief(seed)}")
        drawn = Starts(lambda number: scene, 1)
    else:
        if not isinstance(scene, str | os.PathLike):
            raise TypeError(f"scene must be a Scene or a scene's file, got {brief(scene)}")
        try:
            drawn = starts_of(*read_scene_tables(scene), str(scene), count, seed)
        except FileNotFoundError as error:
            raise ValueError(f"scene{str(error).removeprefix('path')}") from None
    with shows("settings", check_progress(progress), after=0.0) as say:
        return search_settings(drawn, targets, knobs, mean=mean, time_limit=time_limit, say=say)


class Starts(NamedTuple):
    """A function that returns the start of a number, and how many there are."""

    draw: Callable[[int], Scene]
    number: int


def search_settings(
    starts: Starts,
    targets: tuple[Target, ...],
    knobs: Mapping[str, Sequence[Any]] | None,
    *,
    mean: bool,
    time_limit: float | None,
    say: Callable[..., Any],
) -> CheapestSettings:
    """Return what `settings_for` does, for starts."""
    boolean("mean", mean)
    limit = math.inf if time_limit is None else positive("time_limit", time_limit)
    return _Search(starts, targets, knobs, mean, limit).run(say)


def starts_of(tables: Mapping[str, Any], folder: Path, name: str, count: int, seed: int | None) -> Starts:
    """Return the starts of a scene file, from seeds in a row, and more that decide; of what is not random one."""
    if not is_random(tables):
        if seed is not None:
            raise ValueError(f"seed must be left out for a packing that is not random, got {brief(seed)}")
        return Starts(lambda number: scene_of_tables(dict(tables), folder, name=name), 1)
    first = 0 if seed is None else integer("seed", seed, at_least=0)
    return Starts(
        lambda number: scene_of_tables(changed_tables(tables, seed=first + number), folder, name=name),
        (1 + _FURTHER) * count if count > 1 else 1,
    )


class _Search:
    """Trials of settings from several starts, against a reference that becomes finer as it must.

    Settings are places: the number of a value for each knob.
    """

    def __init__(
        self,
        starts: Starts,
        targets: tuple[Target, ...],
        knobs: Mapping[str, Sequence[Any]] | None,
        mean: bool,
        time_limit: float,
    ) -> None:
        first = starts.draw(0)
        if first.drive is None:
            raise ValueError("scene must have a drive to be run, such as pm.QuenchDrive(), got none")
        self.draw, self.first = starts.draw, of_a_duration(first)
        # further starts decide on what the first say may do
        first_few = max(1, starts.number // (1 + _FURTHER))
        self.starts, self.further = range(first_few), range(first_few, starts.number)
        if mean and first_few < 2:
            raise ValueError("mean must be False for a scene with one start, got True: give the file of a random one")
        self.targets, self.mean, self.time_limit = targets, mean, time_limit
        self.knobs = usual_knobs(self.first) if knobs is None else given_knobs(self.first, knobs)
        if not self.knobs:
            kind = type(first.drive).__name__
            raise ValueError(f"knobs must be given for a drive that has none of the usual ones, got {kind}")
        self.caps = tuple(knob.first_cap for knob in self.knobs)
        self.ran: dict[tuple[tuple[int, ...], int], tuple[dict[str, Any], str, float]] = {}
        self.warm: set[tuple[int, ...]] = set()
        self.unsound, self.began = 0, working_time()

    def run(self, say: Callable[..., Any]) -> CheapestSettings:
        """Return the cheapest settings that meet the target."""
        self.say = say
        trials: dict[tuple[int, ...], SettingTrial] = {}
        before, why_not = trials, ""
        try:
            while True:
                best = self._cheapest(trials)
                rising = self._rising
                if best is not None and not (rising and self._proves_nothing(best, trials[best])):
                    break
                finer = self._finer(trials) if best is None else self._raised(rising)
                if isinstance(finer, str):
                    why_not = finer
                    break
                self.caps, before, trials = finer, trials, {}
        except _UnknownFigureError as error:
            raise ValueError(str(error)) from None
        except _TimeUpError:
            best, why_not = None, f"the time limit of {self.time_limit:g} s ran out"
        except KeyboardInterrupt as stop:
            stop.found = self._result(None, trials or before, "interrupted")  # type: ignore[attr-defined]
            raise
        return self._result(best, trials or before, why_not)

    def _result(
        self, best: tuple[int, ...] | None, trials: Mapping[tuple[int, ...], SettingTrial], why_not: str
    ) -> CheapestSettings:
        place = best
        if place is None:
            place = min(trials, key=lambda one: self._size(trials[one]), default=(0,) * len(self.knobs))
        chosen = trials.get(place)
        changes = self._changes(place)
        return CheapestSettings(
            scene=set_fields(self.first, changes),
            changes=changes,
            repeats=1 if chosen is None else max(1, chosen.repeats),
            met=best is not None,
            why_not=why_not,
            targets=self.targets,
            trials=tuple(trials.values()),
            reference=self._changes(self._reference),
            starts=len(self.starts),
            seconds=working_time() - self.began,
        )

    @property
    def _reference(self) -> tuple[int, ...]:
        """The place of the reference: of alternatives the first, and finer than the finest settings that are tried."""
        return tuple(knob.reference(cap) for knob, cap in zip(self.knobs, self.caps, strict=True))

    @property
    def _rising(self) -> list[int]:
        """The knobs of which finer values may be tried still."""
        return [k for k, knob in enumerate(self.knobs) if not knob.alternatives and self.caps[k] < knob.last]

    def _raised(self, knobs: Sequence[int]) -> tuple[int, ...]:
        return tuple(cap + (k in knobs) for k, cap in enumerate(self.caps))

    def _proves_nothing(self, place: tuple[int, ...], trial: SettingTrial) -> bool:
        """Whether a small error was asked for and figures are the reference's to the last bit, by one last step."""
        for one in self.targets:
            value = np.asarray(self.ran[place, 0][0][one.figure])
            scale = float(np.abs(value).max(initial=0.0)) if one.absolute else 1.0
            if value.dtype.kind == "f" and one.error < _SMALL * scale and not any(trial.errors[one.figure]):
                return True
        return False

    def _scale(self, place: tuple[int, ...]) -> float:
        """Return what differences from the reference are multiplied by, for what they lack of an error."""
        known = zip(self.knobs, place, self._reference, strict=True)
        return 1.0 / (1.0 - max(knob.lacking(k, reference) for knob, k, reference in known))

    def _changes(self, place: tuple[int, ...]) -> dict[str, Any]:
        return {knob.path: knob.values[k] for knob, k in zip(self.knobs, place, strict=True)}

    def _cheapest(self, trials: dict[tuple[int, ...], SettingTrial]) -> tuple[int, ...] | None:
        """Return the cheapest place within the caps that meets the target, if one does; keep what was tried.

        Places are tried by what they cost at the least: as much as the places that are coarser in one knob, where finer
        values of it are sure to cost more.
        """
        best: tuple[int, ...] | None = None
        waiting = {place: 0.0 for place in itertools.product(*(self._first(knob) for knob in self.knobs))}
        while waiting:
            place = min(waiting, key=lambda one: (waiting[one], one))
            least = waiting.pop(place)
            most = math.inf if best is None else _CHEAPER * trials[best].cost
            if least >= most:
                break
            trial = trials[place] = self._trial(place, self.starts)
            if self._hopeful(trial) and trial.cost < most:
                trial = trials[place] = self._decided(place, trial, trials)
                best = place if trial.meets and trial.cost < most else best
            for k, knob in enumerate(self.knobs):
                finer = (*place[:k], place[k] + 1, *place[k + 1 :])
                if not knob.alternatives and finer[k] <= self.caps[k] and finer not in trials:
                    waiting[finer] = max(trial.seconds if knob.costs else 0.0, waiting.get(finer, 0.0))
        return best

    @staticmethod
    def _first(knob: Knob) -> Sequence[int]:
        return range(len(knob.values)) if knob.alternatives else (0,)

    def _hopeful(self, trial: SettingTrial) -> bool:
        """Whether so few starts within would not be unlikely if nine in ten were."""
        if self.mean:
            return trial.meets
        within = self._within(trial.errors)
        return bool(binom.cdf(round(within.sum()), len(within), _SHARE) > _UNLIKELY)

    def _decided(
        self, place: tuple[int, ...], trial: SettingTrial, trials: Mapping[tuple[int, ...], SettingTrial]
    ) -> SettingTrial:
        """Return a trial with further starts, as long as the target may be met: the best of many may be so by luck.

        Where there is one start, the next finer settings must meet the target.
        """
        step = len(self.starts)
        for more in range(2 * step, len(self.starts) + len(self.further) + 1, step):
            trial = self._trial(place, range(more))
            if not self._hopeful(trial):
                return replace(trial, meets=False, repeats=0)
        for k, knob in enumerate(self.knobs if trial.meets and not self.further else ()):
            finer = (*place[:k], place[k] + 1, *place[k + 1 :])
            if knob.alternatives or finer[k] >= self._reference[k]:
                continue
            if not (trials.get(finer) or self._trial(finer, self.starts)).meets:
                return replace(trial, meets=False, repeats=0)
        return trial

    def _within(self, errors: Mapping[str, Sequence[float]]) -> NDArray[np.bool_]:
        """Return of which starts all errors are within their targets."""
        within: NDArray[np.bool_] = np.all([np.abs(errors[one.figure]) <= one.error for one in self.targets], axis=0)
        return within

    def _finer(self, trials: Mapping[tuple[int, ...], SettingTrial]) -> tuple[int, ...] | str:
        """Return the caps with the knobs finer that make errors smaller; or why nothing does, in words."""
        rising = self._rising
        if not rising:
            return "no settings of the grid meet the target"
        wrong = self._ran(self._reference, 0)[1]
        self.unsound = self.unsound + 1 if wrong else 0
        if self.unsound > _UNSOUND:
            return f"runs with finer settings do not end well: {wrong}"
        corner = tuple(0 if knob.alternatives else cap for knob, cap in zip(self.knobs, self.caps, strict=True))
        here = self._size(trials[corner])
        if not math.isfinite(here) and not trials[corner].failed:
            return "a figure is no number, or zero in the reference: ask for an absolute error of what is zero"
        if not math.isfinite(here):
            helpful = rising[:1]
        else:
            helpful = [k for k in rising if here <= 1.0 or self._helps(k, corner, trials)]
        if not helpful:
            return (
                f"finer settings no longer help, errors stay at {here:.2g} times the target: where motion is chaotic, "
                "ask for the mean over starts"
            )
        return self._raised(helpful)

    def _helps(self, k: int, corner: tuple[int, ...], trials: Mapping[tuple[int, ...], SettingTrial]) -> bool:
        """Whether errors fall with a knob, judged by its last values; of few values it is not known yet, and tried."""
        if self.caps[k] < _TRIED:
            return True
        sizes = [
            self._size(trials[(*corner[:k], j, *corner[k + 1 :])])
            for j in range(self.caps[k] - _TRIED, self.caps[k] + 1)
        ]
        return any(sizes[-1] <= _HELPS**n * sizes[-1 - n] for n in range(1, _TRIED + 1))

    def _size(self, trial: SettingTrial) -> float:
        """Return the error of a trial over its target, the largest of all figures, in the middle of the starts."""
        errors = ((np.median(np.abs(trial.errors[one.figure])), one.error) for one in self.targets)
        size = max(float(error) / max(bound, np.finfo(float).tiny) for error, bound in errors)
        return math.inf if math.isnan(size) else size

    def _trial(self, place: tuple[int, ...], starts: range) -> SettingTrial:
        """Return what a place costs and how far its figures are off, from as many starts as it takes to tell."""
        errors: dict[str, list[float]] = {one.figure: [] for one in self.targets}
        values: dict[str, list[Any]] = {one.figure: [] for one in self.targets}
        seconds, failed, scale = [], "", self._scale(place)
        for start in starts:
            figures, wrong, cost = self._ran(place, start)
            true, unsound, _ = self._ran(self._reference, start)
            if unsound:
                wrong = wrong or f"the reference: {unsound}"
            seconds.append(cost)
            failed = failed or wrong
            for one in self.targets:
                off = math.inf if wrong else scale * one.error_of(figures[one.figure], true[one.figure])
                errors[one.figure].append(off)
                values[one.figure].append(figures.get(one.figure))
            hopeless = any(self._hopeless(one, errors[one.figure]) for one in self.targets)
            if len(seconds) >= _FEW and hopeless and not self.mean:
                break
        shares = {one.figure: share_within(errors[one.figure], one.error) for one in self.targets}
        repeats = int(len(seconds) == len(starts) and min(*shares.values(), self._within(errors).mean()) >= _SHARE)
        if self.mean:
            needed = [self._repeats(one, errors[one.figure], values[one.figure], starts, scale) for one in self.targets]
            repeats = max(needed) if all(needed) else 0
        return SettingTrial(
            changes=self._changes(place),
            labels=tuple(map(label, self._changes(place).values())),
            seconds=float(np.median(seconds)),
            errors={name: tuple(found) for name, found in errors.items()},
            share=shares,
            repeats=repeats,
            meets=repeats > 0,
            failed=failed,
        )

    @staticmethod
    def _hopeless(target: Target, errors: Sequence[float]) -> bool:
        """Whether all errors are far outside, so that further starts need not be tried."""
        return min(map(abs, errors)) > _FAR * target.error

    def _repeats(
        self, target: Target, errors: Sequence[float], values: Sequence[Any], starts: range, lacking: float
    ) -> int:
        """Return how many starts a mean takes to be within the target; 0 where none do."""
        if not np.isfinite(errors).all():
            return 0
        references = [self._ran(self._reference, start)[0][target.figure] for start in starts]
        if len({np.shape(one) for one in (*values, *references)}) > 1:
            return 0
        found, true = (
            np.array([np.asarray(one, dtype=float).ravel() for one in each]) for each in (values, references)
        )
        scale = 1.0 if target.absolute else float(np.abs(true.mean(axis=0)).max())
        if not scale > 0.0:
            return 0
        # of the same starts: their scatter is no part of how far the mean is off
        shift = lacking * (found - true) / scale
        bias, unsure = np.abs(shift.mean(axis=0)).max(), shift.std(axis=0, ddof=1).max() / math.sqrt(len(found))
        scatter = float((found.std(axis=0, ddof=1) / scale).max())
        return fewest_repeats(float(bias), float(unsure), scatter, target.error, len(found))

    def _ran(self, place: tuple[int, ...], start: int) -> tuple[dict[str, Any], str, float]:
        """Return the figures of a run, what was wrong with it, and its CPU time without compiling; each is run once."""
        key = (place, start)
        if key not in self.ran:
            self._look_at_the_clock()
            labels = ", ".join(map(label, self._changes(place).values()))
            self.say(f"{labels}; start {start + 1}", {})
            drawn = self.first if start == 0 else of_a_duration(self.draw(start))
            scene = set_fields(drawn, self._changes(place))
            way = tuple(k for k, knob in zip(place, self.knobs, strict=True) if knob.alternatives)
            if way not in self.warm:
                # the first run of a kind loads its loops, which is no cost of its settings
                self._measure(scene)
                self.warm.add(way)
            self.ran[key] = self._measure(scene)
        return self.ran[key]

    def _look_at_the_clock(self, *_: Any) -> None:
        if working_time() - self.began > self.time_limit:
            raise _TimeUpError

    def _measure(self, scene: Scene) -> tuple[dict[str, Any], str, float]:
        began = working_time()
        try:
            done = run_drive(scene, progress=self._look_at_the_clock)
            # without the examination, which every choice of settings takes alike
            seconds = working_time() - began
            runs = done.runs if hasattr(done, "runs") else [done]
            wrong = next((one.outcome.value for one in runs if isinstance(one, Run) and not one.ok), "")
            figures = {} if wrong else self._figures(done, scene)
        except (ValueError, ArithmeticError, RuntimeError, np.linalg.LinAlgError) as error:
            return {}, str(error).partition("\n")[0], working_time() - began
        return figures, wrong, max(seconds, 1e-6)

    def _figures(self, done: Any, scene: Scene) -> dict[str, Any]:
        """Return the figures of the targets, of the run or of the report on its end."""
        named = done.to_dict()
        strain = getattr(scene.drive, "examined_strain", None)
        if strain is not None and any(one.figure not in named for one in self.targets):
            modes = 10 if any(one.figure == "lowest_frequencies" for one in self.targets) else 0
            named |= examine(
                scene_after(done, scene), run=done, strain=strain, modes=modes, progress=self._look_at_the_clock
            ).to_dict()
        found = {}
        for one in self.targets:
            if one.figure not in named:
                known = [name for name, value in named.items() if _is_number(value) and name not in _COSTS]
                raise _UnknownFigureError(
                    f"target must name figures of the run, one of {', '.join(known)}, got "
                    f"{brief(one.figure)}{did_you_mean(one.figure, known)}"
                )
            if one.figure in _COSTS:
                raise _UnknownFigureError(
                    f"target must name what a run finds, got {one.figure!r}, which is what it costs"
                )
            if not _is_number(named[one.figure]):
                raise _UnknownFigureError(
                    f"target must name a number, got {one.figure!r}, which is {brief(named[one.figure])}"
                )
            found[one.figure] = named[one.figure]
        return found


class _TimeUpError(Exception):
    """The time limit ran out."""


class _UnknownFigureError(Exception):
    """A figure that the run does not give: no failure of one setting, but of all."""


def _is_number(value: Any) -> bool:
    try:
        array = np.asarray(value)
    except ValueError:
        return False
    return array.dtype.kind in "iuf" and array.size > 0


def share_within(errors: Sequence[float], bound: float) -> float:
    """Return the share of further errors that are expected within a bound, after those that were seen.

    Of a normal distribution whose mean and width are known from n values only, a further value follows Student's
    distribution with n - 1 degrees of freedom, wider by sqrt(1 + 1 / n). Where fewer than nine tenths of those that
    were seen are within, the share is theirs.

    Examples
    --------
    >>> share_within([0.01], 0.02), share_within([0.03], 0.02)
    (1.0, 0.0)
    >>> round(share_within([0.0, 1.0, -1.0, 0.5, -0.5], 2.5), 3)
    0.955

    """
    seen = np.array(errors)
    within = float(np.mean(np.abs(seen) <= bound))
    if len(seen) < 2 or within < _SHARE or not np.isfinite(seen).all():
        return within
    width = float(seen.std(ddof=1)) * math.sqrt(1.0 + 1.0 / len(seen))
    if width == 0.0:
        return within
    middle = float(seen.mean())
    low, high = (student.cdf((side * bound - middle) / width, len(seen) - 1) for side in (-1.0, 1.0))
    return float(high - low)


def fewest_repeats(bias: float, unsure: float, scatter: float, bound: float, starts: int) -> int:
    """Return the fewest repeats whose mean is within a bound with a probability of 19 in 20; 0 where none are.

    Parameters
    ----------
    bias, unsure
        How far the mean of the settings is off, and the standard error of that.
    scatter
        Standard deviation between starts, in the units of the bound.
    bound, starts
        The bound, and from how many starts all this is known.

    Examples
    --------
    The mean of n values of scatter 1 is within 0.1 with a probability of 19 in 20 for n near (1.96 / 0.1)^2:

    >>> fewest_repeats(0.0, 0.0, 1.0, 0.1, 10**6)
    385
    >>> fewest_repeats(0.2, 0.0, 1.0, 0.1, 10)
    0

    """

    def share(repeats: float) -> float:
        width = math.sqrt(scatter**2 / repeats + unsure**2)
        if width == 0.0:
            return float(bias <= bound)
        low, high = (student.cdf((side * bound - bias) / width, starts - 1) for side in (-1.0, 1.0))
        return float(high - low)

    if not share(_MOST_REPEATS) >= _MEAN_SHARE:
        return 0
    low, high = 0, 1
    while not share(high) >= _MEAN_SHARE:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if share(middle) >= _MEAN_SHARE else (middle, high)
    return high
