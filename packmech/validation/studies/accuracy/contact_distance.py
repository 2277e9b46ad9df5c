"""What exact contact distances of ellipses cost: the levels of the third source's table 2.1, with a column for time.

Pairs of unlike ellipses of one aspect, size ratio 1.4, at independent uniform angles; errors of the contact distance
relative to the exact one. Time is that of one thread, of whole pairs from their vectors and directors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.contact_distance import LEVELS, distances
from packmech.contacts.scaled_contact import scaled_contacts
from packmech.result import csv_text, markdown_table
from packmech.view.figures import COLORS, MARKERS, styled_figure

ASPECTS = (1.0, 1.2, 1.5, 2.0, 3.0, 10.0)
# log10 of errors as printed in table 2.1
PRINTED = {
    "gaussian": (-2.0, -2.0, -1.9, -1.6, -1.3, -0.4),
    "linear": (-3.9, -3.8, -3.7, -3.6, -1.5, -0.1),
    "quadratic": (-6.3, -6.2, -6.3, -5.0, -3.8, -1.4),
}
PAIRS, TIMED, REPEATS, RATIO, SEED = 400_000, 20_000, 9, 1.4, 1


class Level(NamedTuple):
    """One level at one aspect: errors, and nanoseconds a pair.

    `mean` is that of the pairs for which the level finds a contact, `counted` the mean with an error of 1 for others.
    """

    level: str
    aspect: float
    mean: float
    counted: float
    largest: float
    found: float
    nanoseconds: float


@dataclass(frozen=True)
class LevelTable:
    """Levels at all aspects, and nanoseconds of force and torque of the exact one by aspect."""

    rows: tuple[Level, ...]
    exact: dict[float, float]
    title: str = "Contact distances of ellipses: what accuracy costs"

    def to_csv(self) -> str:
        """Return the rows as comma-separated values."""
        head = (*Level._fields, "force and torque ns")
        return csv_text(head, [(*one, self.exact[one.aspect] if one.level == LEVELS[-1] else "") for one in self.rows])

    def to_markdown(self) -> str:
        """Return log10 of mean errors beside the printed ones, and the cost."""
        head = ("level", "", *(f"{aspect:g}" for aspect in ASPECTS), "distance, ns", "force and torque, ns")
        lines = []
        for level in LEVELS:
            rows = [one for one in self.rows if one.level == level]
            cost = f"{min(one.nanoseconds for one in rows):.0f} to {max(one.nanoseconds for one in rows):.0f}"
            both = f"{min(self.exact.values()):.0f} to {max(self.exact.values()):.0f}" if level == LEVELS[-1] else ""
            if level in PRINTED:
                lines.append((level, "printed", *(f"{value:.1f}" for value in PRINTED[level]), "", ""))
            lines.append((level, "mean error", *(_log(one.mean) for one in rows), cost, both))
            if any(one.found < 1.0 for one in rows):
                lines.append((level, "no contact found: error 1", *(_log(one.counted) for one in rows), "", ""))
            lines.append((level, "largest error", *(_log(one.largest) for one in rows), "", ""))
        return markdown_table(head, lines)

    def save_figure(self, path: str | Path) -> None:
        """Write its picture: mean error over aspect, and error against time."""
        with styled_figure(Path(path), (9.6, 4.2)) as figure:
            left, right = figure.subplots(1, 2)
            for k, level in enumerate(LEVELS):
                rows = [one for one in self.rows if one.level == level]
                style = {"color": COLORS[k], "marker": MARKERS[k], "markersize": 4.0, "label": level}
                error = [max(one.counted, 1e-17) for one in rows]
                left.plot([one.aspect for one in rows], error, linewidth=1.0, **style)
                right.plot([one.nanoseconds for one in rows], error, linestyle="none", **style)
            left.set(xlabel="aspect", ylabel="mean relative error of the contact distance", xscale="log", yscale="log")
            right.set(xlabel="CPU time of a pair [ns]", yscale="log")
            left.legend(fontsize=8.0)
            figure.suptitle(f"Unlike ellipses of size ratio {RATIO:g}, {PAIRS} pairs", fontsize=10)


def _log(error: float) -> str:
    return f"{math.log10(error):.2f}" if error > 0.0 else "-inf"


class Pairs(NamedTuple):
    """Unlike ellipses at random angles: what `distances` takes."""

    vector_pd: NDArray[np.float64]
    radius_pk: NDArray[np.float64]
    aspect_pk: NDArray[np.float64]
    director_pkd: NDArray[np.float64]


def draw_pairs(aspect: float, count: int, seed: int) -> Pairs:
    """Return pairs at unit distance, each angle uniform."""
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, (count, 3))
    way = np.stack([np.cos(angle), np.sin(angle)], axis=2)
    radius = np.tile([0.5, 0.5 * RATIO], (count, 1))
    return Pairs(way[:, 0].copy(), radius, np.full((count, 2), aspect), way[:, 1:].copy())


def _nanoseconds(work: Callable[[], object], pairs: int) -> float:
    best = math.inf
    for _ in range(REPEATS):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return 1e9 * best / pairs


def measure(aspect: float, level: str, pairs: int = PAIRS, timed: int = TIMED) -> Level:
    """Return what a level does at an aspect."""
    drawn = draw_pairs(aspect, pairs, SEED)
    exact, rough = (distances(*drawn, LEVELS.index(one)) for one in ("exact", level))
    found = np.isfinite(rough)
    error = np.abs(rough[found] / exact[found] - 1.0)
    few = Pairs(*(part[:timed] for part in drawn))
    cost = _nanoseconds(lambda: distances(*few, LEVELS.index(level)), timed)
    mean = float(error.mean())
    counted = float(np.append(error, np.ones(int((~found).sum()))).mean())
    return Level(level, aspect, mean, counted, float(error.max()), float(found.mean()), cost)


def run(progress: Callable[[str, float], None]) -> tuple[LevelTable, str]:
    """Run the study; return its table and what it shows in words."""
    rows, exact = [], {}
    for aspect in ASPECTS:
        for level in LEVELS:
            progress(level, aspect)
            rows.append(measure(aspect, level))
        few = draw_pairs(aspect, TIMED, SEED)
        exact[aspect] = _nanoseconds(lambda few=few: scaled_contacts(*few), TIMED)  # type: ignore[misc]
    table = LevelTable(tuple(rows), exact)
    return table, describe(table)


def describe(table: LevelTable) -> str:
    """Return what the table shows, every figure taken from it."""
    at = {(one.level, one.aspect): one for one in table.rows}
    rough, fine = at["quadratic", 2.0], at["exact", 2.0]
    return (
        "log10 of the mean relative error of the contact distance over unlike pairs, beside what the source prints,\n"
        f"by aspect. At aspect 2 the exact distance costs {fine.nanoseconds:.0f} ns a pair where the quadratic level,\n"
        f"wrong by {rough.mean:.0e}, costs {rough.nanoseconds:.0f} ns; exact force and torque cost "
        f"{min(table.exact.values()):.0f} to {max(table.exact.values()):.0f} ns. Of the linear level "
        f"{1.0 - at['linear', 10.0].found:.0%} of pairs of aspect 10 find no\ncontact at all."
    )
