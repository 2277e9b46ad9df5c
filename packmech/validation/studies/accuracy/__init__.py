"""Studies of accuracy, time and memory, by name. Each makes a table and says in words what it shows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from packmech.validation.studies.accuracy import (
    constraint_bases,
    contact_distance,
    effect_costs,
    exact_hessian,
    gap_tolerance,
    integrators,
    jamming_programs,
    minima,
    minimizers,
    reaffixing,
    shear_time_step,
)

__all__ = ["Study", "Table", "studies"]

Progress = Callable[[str, float], None]


class Table(Protocol):
    """What a study makes: a table that can be written as text and drawn."""

    @property
    def title(self) -> str:
        """What the study is."""

    def to_csv(self) -> str:
        """Return it as comma-separated values."""

    def to_markdown(self) -> str:
        """Return it as Markdown."""

    def save_figure(self, path: str | Path) -> None:
        """Write its picture."""


Found = tuple[Table, str]
# the folder is where studies that take long are kept, the number that of processes that share them
Study = Callable[[Progress, Path, int | None], Found]


def _in_one_go(run: Callable[[Progress], Found], progress: Progress, folder: Path, workers: int | None) -> Found:
    """Run a study that keeps nothing on the way."""
    return run(progress)


def studies() -> dict[str, Study]:
    """Return the studies by name.

    Examples
    --------
    >>> list(studies())
    ['minimizers', 'constraint_bases', 'exact_hessian', 'reaffixing', 'jamming_2d', 'jamming_3d', 'gap_tolerance',
     'shear_time_step', 'integrators', 'effect_costs', 'contact_distance', 'minima']

    """
    short: dict[str, Callable[[Progress], Found]] = {
        "minimizers": minimizers.run,
        "constraint_bases": constraint_bases.run,
        "exact_hessian": exact_hessian.run,
        "reaffixing": reaffixing.run,
        "jamming_2d": partial(jamming_programs.run, 2),
        "jamming_3d": partial(jamming_programs.run, 3),
        "gap_tolerance": gap_tolerance.run,
        "shear_time_step": shear_time_step.run,
        "integrators": integrators.run,
        "effect_costs": effect_costs.run,
        "contact_distance": contact_distance.run,
    }
    return {
        **{name: partial(_in_one_go, run) for name, run in short.items()},
        "minima": minima.run,
    }
