"""The table that `work_precision` returns: order of convergence, floor, cheapest setting, text and figure."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from packmech.accuracy import Trial

__all__ = ["PowerLawFit", "WorkPrecision", "fit_power_law"]


@dataclass(frozen=True)
class PowerLawFit:
    """error = prefactor * setting**order, down to a floor; floor is 0 where none was reached."""

    order: float
    prefactor: float
    floor: float


@dataclass(frozen=True)
class WorkPrecision:
    """Trials of every method at every setting, failures included, and the questions that they answer."""

    trials: tuple[Trial, ...]
    first_seconds: Mapping[str, float]
    knob: str = "setting"
    title: str = ""
    reference_is: str = ""

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods, in the order in which they ran."""
        return tuple(self.first_seconds)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities whose errors were measured."""
        return tuple(dict.fromkeys(name for trial in self.trials for name in trial.errors))

    def of(self, method: str) -> tuple[Trial, ...]:
        """Trials of one method, from the coarsest setting (the largest) to the finest."""
        if method not in self.first_seconds:
            raise ValueError(f"method must be one of {list(self.methods)}, got {method!r}")
        return tuple(sorted((t for t in self.trials if t.method == method), key=lambda trial: -trial.setting))

    def fit(self, method: str, *, quantity: str | None = None) -> PowerLawFit:
        """Power law and floor fitted to one method's errors; failed trials are left out.

        Raises
        ------
        ValueError
            For an unknown method or quantity, or fewer than two trials with an error above zero.
        """
        name = self._quantity(quantity)
        point_td = [
            (trial.setting, trial.errors[name])
            for trial in self.of(method)
            if not trial.failed and name in trial.errors
        ]
        return fit_power_law([setting for setting, _ in point_td], [error for _, error in point_td])

    def order(self, method: str, *, quantity: str | None = None) -> float:
        """Order of convergence: the exponent p of error ~ setting**p above the floor."""
        return self.fit(method, quantity=quantity).order

    def floor(self, method: str, *, quantity: str | None = None) -> float:
        """Error below which finer settings do not help; 0 where the trials did not reach one."""
        return self.fit(method, quantity=quantity).floor

    def cheapest(self, *, error_below: float, quantity: str | None = None) -> Trial | None:
        """Return the quickest trial that did not fail and whose error is below the bound; None when there is none."""
        if not error_below > 0.0:
            raise ValueError(f"error_below must be positive, got {error_below}")
        name = self._quantity(quantity)
        good = [trial for trial in self.trials if not trial.failed and trial.errors.get(name, math.inf) < error_below]
        return min(good, key=lambda trial: trial.seconds, default=None)

    def to_csv(self) -> str:
        """Return the table as comma-separated values, numbers with every digit."""
        work = tuple(dict.fromkeys(name for trial in self.trials for name in trial.work))
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(
            ("method", self.knob, *(f"error in {name}" for name in self.quantities), "cpu seconds", *work, "failed")
        )
        for trial in self.trials:
            errors = (repr(trial.errors[name]) if name in trial.errors else "" for name in self.quantities)
            counts = (repr(trial.work[name]) if name in trial.work else "" for name in work)
            writer.writerow((trial.method, repr(trial.setting), *errors, repr(trial.seconds), *counts, trial.failed))
        return text.getvalue()

    def to_markdown(self) -> str:
        """Return the table as Markdown: short numbers, failures in words."""
        work = tuple(dict.fromkeys(name for trial in self.trials for name in trial.work))
        header = ("method", self.knob, *(f"error in {name}" for name in self.quantities), "CPU s", *work, "failed")
        lines = [_row(header), _row(["---"] * len(header))]
        for trial in self.trials:
            errors = [f"{trial.errors[name]:.1e}" if name in trial.errors else "-" for name in self.quantities]
            counts = [_short(trial.work[name]) if name in trial.work else "-" for name in work]
            cells = (trial.method, f"{trial.setting:.0e}", *errors, f"{trial.seconds:.2g}", *counts, trial.failed)
            lines.append(_row(cells))
        return "\n".join(lines) + "\n"

    def save_figure(self, path: str | Path) -> None:
        """Write a picture: for each quantity error against setting (left) and CPU seconds against error (right).

        Failed trials that still gave an answer are drawn hollow. The ending of path names the format (png, svg, pdf).

        Raises
        ------
        ImportError
            When matplotlib is not installed.
        """
        from packmech.accuracy_figure import draw

        draw(self, Path(path))

    def _quantity(self, quantity: str | None) -> str:
        names = self.quantities
        if quantity is None:
            return names[0] if names else "error"
        if quantity not in names:
            raise ValueError(f"quantity must be one of {list(names)}, got {quantity!r}")
        return quantity


def fit_power_law(setting_t: list[float], error_t: list[float]) -> PowerLawFit:
    """Power law that the errors follow down to a floor.

    Least squares in the logarithms of C h^p for the coarse settings and of a constant for the fine ones, for every
    place of the bend; the best fit stays. A floor needs two settings at least, the power law two (three where there
    are three or more), so exact data without a floor are fitted without one. Errors of exactly zero are under any
    floor and left out.

    Examples
    --------
    >>> fit = fit_power_law([1e-1, 1e-2, 1e-3, 1e-4, 1e-5], [2e-2, 2e-4, 2e-6, 3e-7, 3e-7])
    >>> print(f"{fit.order:.2f} {fit.floor:.0e}")
    2.00 3e-07
    """
    point_td = sorted(((h, e) for h, e in zip(setting_t, error_t, strict=True) if e > 0.0), reverse=True)
    if len(point_td) < 2:
        raise ValueError(f"an order must be fitted to at least two errors above zero, got {len(point_td)}")
    log_h_t, log_e_t = np.log(np.array(point_td).T)
    count = len(point_td)
    best: tuple[float, PowerLawFit] | None = None
    for bend in range(min(3, count), count + 1):
        if count - bend == 1:
            continue
        design = np.stack([log_h_t[:bend], np.ones(bend)], axis=1)
        (slope, offset), *_ = np.linalg.lstsq(design, log_e_t[:bend], rcond=None)
        residual = float(np.sum((design @ (slope, offset) - log_e_t[:bend]) ** 2))
        floor = 0.0
        if bend < count:
            level = float(np.mean(log_e_t[bend:]))
            residual += float(np.sum((log_e_t[bend:] - level) ** 2))
            floor = math.exp(level)
        if best is None or residual < best[0] * (1.0 - 1e-9) - 1e-24:
            best = (residual, PowerLawFit(float(slope), math.exp(float(offset)), floor))
    assert best is not None
    return best[1]


def _short(value: float) -> str:
    """Return whole numbers as they are, others with three digits."""
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.3g}"


def _row(cells: list[str] | tuple[str, ...]) -> str:
    return "| " + " | ".join(cells) + " |"
