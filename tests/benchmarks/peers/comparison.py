"""Packmech and one peer on the same start, in turn; medians of their ratios, and the table of all of them.

Times are CPU seconds of the process that does the work, so that other work on the machine counts little; what is left
of it (caches, clocks) hits both, since they take turns.
"""

from __future__ import annotations

import csv
import datetime
import importlib.metadata
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import packmech as pm
from packmech.result import csv_text, markdown_table
from packmech.view.figures import styled_figure


@dataclass(frozen=True)
class Pair:
    """The same work in packmech and in a peer; each call returns its CPU seconds.

    Parameters
    ----------
    ours, theirs
        Called in turn.
    agreement
        Returns how far the two results are apart, in words; called at the end.
    unit
        What a call is divided by in the table, such as the number of steps [1].

    """

    ours: Callable[[], float]
    theirs: Callable[[], float]
    agreement: Callable[[], str]
    unit: float = 1.0


@dataclass(frozen=True)
class Row:
    """One comparison: what both do, who the peer is, the ratio wanted, and how the start of a seed is made."""

    work: str
    peer: str
    needs: str
    prepare: Callable[[int], Pair]
    wanted: float | None = None
    turns: int = 4


@dataclass(frozen=True)
class Sample:
    """What one seed gave: seconds of both and the median of the ratios of its turns."""

    seed: int
    ours: float
    theirs: float
    ratio: float
    agreement: str


def cpu_of(call: Callable[[], Any]) -> float:
    """Return the CPU seconds of a call."""
    began = time.process_time()
    call()
    return time.process_time() - began


def timed(call: Callable[[], Any]) -> Callable[[], float]:
    """Return a call that returns its CPU seconds."""
    return lambda: cpu_of(call)


def measure(row: Row, seed: int, *, first: bool) -> Sample:
    """Return what one seed gives; the very first call of each, which may compile, is not counted."""
    pair = row.prepare(seed)
    if first:
        pair.ours(), pair.theirs()
    took = []
    for turn in range(row.turns):
        # packmech, peer, peer, packmech, ...
        if turn % 2:
            their, own = pair.theirs(), pair.ours()
        else:
            own, their = pair.ours(), pair.theirs()
        took.append((own, their))
    ours, theirs = (statistics.median(column) / pair.unit for column in zip(*took, strict=True))
    return Sample(seed, ours, theirs, statistics.median(their / own for own, their in took), pair.agreement())


def seconds(value: float) -> str:
    """Return a time with its unit, three digits.

    Examples
    --------
    >>> seconds(2.5e-5), seconds(1.23456)
    ('25 us', '1.23 s')

    """
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    unit = next((unit for unit, factor in units.items() if value >= 0.9995 * factor), "ns")
    return f"{value / units[unit]:.3g} {unit}"


@dataclass(frozen=True)
class Table:
    """Samples of all rows, peers that were left out, and where and with what it was measured."""

    order: list[Row]
    samples: dict[Row, list[Sample]]
    left_out: dict[str, str]
    versions: dict[str, str]
    machine: str

    def ratio(self, row: Row) -> float:
        """Return the median over seeds of the peer's time over packmech's."""
        return statistics.median(one.ratio for one in self.samples[row])

    def _measured(self) -> list[tuple[Row, list[Sample]]]:
        """Return the rows that have samples, in the order of the list of rows."""
        return [(row, self.samples[row]) for row in self.order if self.samples.get(row)]

    def lines(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the text."""
        for row, found in self._measured():
            ratios = [one.ratio for one in found]
            wanted = "" if row.wanted is None else f"{row.wanted:g}"
            yield (
                *(row.work, row.peer),
                *(seconds(statistics.median(getattr(one, side) for one in found)) for side in ("ours", "theirs")),
                f"**{self.ratio(row):.3g}** ({min(ratios):.3g} to {max(ratios):.3g}; {len(found)})",
                wanted,
                found[-1].agreement,
            )

    def to_markdown(self) -> str:
        """Return the table with all that belongs to it."""
        head = ("both do", "peer", "packmech", "peer's time", "ratio", "wanted", "agreement (last seed)")
        text = [
            "# packmech beside its peers\n\n",
            f"CPU seconds on one thread, {self.machine}. Both start from the same packing and take turns in one run; ",
            "the ratio is the peer's time over packmech's, the median over starts (smallest to largest; how many). ",
            "Rows may come from several runs of the command. Other work ran on the machine. Loops written by hand for ",
            "one case are the limit of what a machine can do with the same lists.\n\n",
            markdown_table(head, self.lines()),
            "\nVersions: " + ", ".join(f"{name} {version}" for name, version in self.versions.items()) + ".\n",
        ]
        missing = [f"{row.work} ({row.peer})" for row in self.order if not self.samples.get(row)]
        if missing:
            text.append(f"\nNot measured in this table, measure them with `--rows`: {', '.join(missing)}.\n")
        text += [f"\nLeft out: {name}. {why}\n" for name, why in self.left_out.items()]
        return "".join(text)

    def to_csv(self) -> str:
        """Return every sample."""
        head = ("work", "peer", "wanted", "seed", "packmech_seconds", "peer_seconds", "ratio", "agreement")
        rows = (
            (row.work, row.peer, row.wanted or "", one.seed, one.ours, one.theirs, one.ratio, one.agreement)
            for row, found in self._measured()
            for one in found
        )
        return csv_text(head, rows)

    def save_figure(self, path: Path) -> None:
        """Draw the ratios with their spread, and what was wanted."""
        rows = [row for row, _ in self._measured()]
        with styled_figure(path, (8.0, 0.36 * len(rows) + 1.2)) as figure:
            axes = figure.add_subplot()
            axes.axvline(1.0, color="#909090", linewidth=0.8)
            for place, row in enumerate(reversed(rows)):
                ratios, middle = [one.ratio for one in self.samples[row]], self.ratio(row)
                axes.plot([min(ratios), max(ratios)], [place, place], color="C0", linewidth=2.5, alpha=0.5)
                axes.plot(middle, place, "o", color="C0")
                if row.wanted is not None:
                    axes.plot(row.wanted, place, "|", color="C1", markersize=14, markeredgewidth=2)
            axes.set_yticks(range(len(rows)), [f"{row.work}: {row.peer}" for row in reversed(rows)])
            axes.set(xscale="log", xlabel="peer's CPU time over packmech's; orange: wanted")

    def keep(self, path: Path, rows: Iterable[Row]) -> None:
        """Take the samples of rows that are not measured now from an earlier table of samples."""
        if not path.exists():
            return
        named = {(row.work, row.peer): row for row in rows if row not in self.samples}
        with path.open(newline="") as file:
            for one in csv.DictReader(file):
                row = named.get((one["work"], one["peer"]))
                if row is not None:
                    number = (float(one[name]) for name in ("packmech_seconds", "peer_seconds", "ratio"))
                    self.samples.setdefault(row, []).append(Sample(int(one["seed"]), *number, one["agreement"]))

    def write(self, folder: Path) -> None:
        """Write text, samples and figure."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "peers.md").write_text(self.to_markdown())
        (folder / "peers.csv").write_text(self.to_csv())
        self.save_figure(folder / "peers.png")


def machine() -> str:
    """Return what this machine is, for the text."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        named = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = f"{named[0]} ({len(named)} cores)" if named else model
    return f"{model}, {platform.system()}, Python {platform.python_version()}, {datetime.date.today()}"


def installed(names: dict[str, str]) -> dict[str, str]:
    """Return the versions of the distributions of these names that are here."""
    found = {"packmech": pm.__version__}
    for shown, name in names.items():
        try:
            found[shown] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found
