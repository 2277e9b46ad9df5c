"""Settings that were tried, the cheapest that are good enough, and the curve of errors against time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from packmech.calls.display import shown
from packmech.files.records import is_record, to_table
from packmech.result import csv_text, markdown_table
from packmech.scene import Scene
from packmech.validation.targets import Target
from packmech.view.figures import COLORS, MARKERS, styled_figure


@dataclass(frozen=True)
class SettingTrial:
    """Runs with one choice of settings, from several starts.

    Attributes
    ----------
    changes
        The settings, by path of the field.
    seconds
        CPU time of one run, the median, without compiling [s].
    errors
        By figure, of each start: what its target measures, infinite where a run failed.
    share
        By figure: the share of starts whose error is expected to be within the target [1].
    repeats
        How many starts a mean takes to be within the target; 1 where single runs were asked for, 0 where none do.
    meets
        Whether the target is met.
    failed
        What was wrong with the first run that did not end well.

    """

    changes: Mapping[str, Any]
    labels: tuple[str, ...]
    seconds: float
    errors: Mapping[str, tuple[float, ...]]
    share: Mapping[str, float]
    repeats: int
    meets: bool
    failed: str = ""

    @property
    def cost(self) -> float:
        """CPU time of all repeats [s]."""
        return self.seconds * max(1, self.repeats)

    def error(self, figure: str) -> float:
        """Return the root of the mean square of a figure's errors."""
        return float(np.sqrt(np.mean(np.square(self.errors[figure]))))


@shown(lambda found: f"{'met' if found.met else 'not met'}: {found.words()}")
@dataclass(frozen=True)
class CheapestSettings:
    """What `settings_for` found.

    Attributes
    ----------
    scene
        The scene with these settings; those of the smallest errors where none meets the target.
    changes
        Its settings by path, such as {"drive.dt": 0.01}.
    repeats
        How many starts to average; 1 unless a mean was asked for.
    met
        Whether they meet the target.
    why_not
        What was in the way where they do not.
    targets
        What was asked for.
    trials
        All that was tried.
    reference
        The settings of the runs that errors are measured from.
    starts
        How many starts were tried; of what may meet the target, four times as many.
    seconds
        CPU time of the search [s].

    """

    scene: Scene
    changes: Mapping[str, Any]
    repeats: int
    met: bool
    why_not: str
    targets: tuple[Target, ...]
    trials: tuple[SettingTrial, ...]
    reference: Mapping[str, Any]
    starts: int
    seconds: float

    def words(self) -> str:
        """Return the settings in words."""
        chosen = next((one for one in self.trials if one.changes == self.changes), None)
        if chosen is None:
            return "no settings"
        named = [f"{path} = {label}" for path, label in zip(self.changes, chosen.labels, strict=True)]
        named += [f"{self.repeats} repeats"] if self.repeats > 1 else []
        return f"{', '.join(named)} ({chosen.cost:.3g} s)"

    def to_dict(self) -> dict[str, Any]:
        """Return what was found by name, as plain values, with all that was tried."""
        return {
            "settings": {path: plain(value) for path, value in self.changes.items()},
            "repeats": self.repeats,
            "met": self.met,
            "why_not": self.why_not,
            "targets": [asdict(one) for one in self.targets],
            "reference": {path: plain(value) for path, value in self.reference.items()},
            "starts": self.starts,
            "seconds": self.seconds,
            "trials": [
                {
                    **{path: plain(value) for path, value in one.changes.items()},
                    "errors": {name: list(errors) for name, errors in one.errors.items()},
                    "share_within": dict(one.share),
                    "seconds": one.seconds,
                    "repeats": one.repeats,
                    "meets": one.meets,
                    "failed": one.failed,
                }
                for one in self.trials
            ],
        }

    def _rows(self) -> Iterator[tuple[SettingTrial, list[Any]]]:
        for one in sorted(self.trials, key=lambda trial: trial.cost):
            yield one, [f(target.figure) for target in self.targets for f in (one.error, one.share.__getitem__)]

    @property
    def _headings(self) -> list[str]:
        of_figure = [
            heading
            for target in self.targets
            for heading in (
                f"{'' if target.absolute else 'relative '}rms error of {target.figure}",
                f"share expected within, of {target.figure}",
            )
        ]
        return [*self.changes, *of_figure, "CPU s", "repeats", "meets", "failed"]

    def to_csv(self) -> str:
        """Return what was tried as comma-separated values, by rising cost."""
        rows = [
            (*one.labels, *figures, one.seconds, one.repeats, one.meets, one.failed) for one, figures in self._rows()
        ]
        return csv_text(self._headings, rows)

    def table(self) -> tuple[list[str], list[tuple[str, ...]]]:
        """Return the headings and the rows, in words, of what was tried, by rising cost."""
        rows = []
        for one, figures in self._rows():
            numbers = [f"{value:.2g}" for value in figures]
            repeats = str(one.repeats or "")
            rows.append((*one.labels, *numbers, f"{one.seconds:.2g}", repeats, "yes" if one.meets else "", one.failed))
        return self._headings, rows

    def to_markdown(self) -> str:
        """Return what was tried as a Markdown table, by rising cost; what meets the target says so."""
        return markdown_table(*self.table())

    def save_figure(self, path: str | Path) -> None:
        """Write a picture of errors against CPU time, the target as a line; filled where it is met.

        Raises
        ------
        ImportError
            When matplotlib is not installed.

        """
        with styled_figure(Path(path), (4.2 * len(self.targets) + 0.4, 3.6)) as figure:
            for axes, target in zip(figure.subplots(1, len(self.targets), squeeze=False)[0], self.targets, strict=True):
                _draw(axes, target, self)


def _draw(axes: Any, target: Target, found: CheapestSettings) -> None:
    """Draw the errors of one figure against the cost; settings that differ in the first knob alone are joined."""
    lines: dict[tuple[str, ...], list[SettingTrial]] = {}
    for one in found.trials:
        if 0.0 < one.error(target.figure) < math.inf:
            lines.setdefault(one.labels[1:], []).append(one)
    names = [path.rpartition(".")[2].replace("_", " ") for path in found.changes][1:]
    for index, (kept, trials) in enumerate(lines.items()):
        label = ", ".join(f"{name} {value}" for name, value in zip(names, kept, strict=True)) or None
        color = COLORS[index % len(COLORS)]
        seconds, errors = [one.cost for one in trials], [one.error(target.figure) for one in trials]
        axes.plot(seconds, errors, color=color, lw=1.0, label=label)
        for x, y, one in zip(seconds, errors, trials, strict=True):
            axes.plot(x, y, MARKERS[0], color=color, mfc=color if one.meets else "white", ms=6)
    axes.axhline(target.error, color="0.5", lw=0.8, ls="--")
    unit = "" if target.absolute else "relative "
    axes.set(xscale="log", yscale="log", xlabel="CPU time [s]", ylabel=f"{unit}error", title=target.figure)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=7, frameon=False)


def plain(value: Any) -> Any:
    """Return the value of a setting as a scene file has it: of a record its kind, and what is not as usual."""
    if not is_record(value):
        return value
    usual = to_table(type(value)())
    return {name: one for name, one in to_table(value).items() if name == "kind" or usual.get(name) != one}
