"""Studies of accuracy, time and memory, by name. Each makes a table and says in words what it shows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol

from packmech.validation.studies.constraint_bases import constraint_bases
from packmech.validation.studies.effect_costs import effect_costs
from packmech.validation.studies.exact_hessian import exact_hessian
from packmech.validation.studies.gap_tolerance import gap_tolerance
from packmech.validation.studies.integrators import integrators
from packmech.validation.studies.jamming_programs import jamming_programs
from packmech.validation.studies.minimizers import minimizers
from packmech.validation.studies.reaffixing import reaffixing
from packmech.validation.studies.shear_time_step import shear_time_step

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


Study = Callable[[Progress], tuple[Table, str]]


def studies() -> dict[str, Study]:
    """Return the studies by name.

    Examples
    --------
    >>> list(studies())
    ['minimizers', 'constraint_bases', 'exact_hessian', 'reaffixing', 'jamming_2d', 'jamming_3d', 'gap_tolerance',
     'shear_time_step', 'integrators', 'effect_costs']

    """
    return {
        "minimizers": minimizers,
        "constraint_bases": constraint_bases,
        "exact_hessian": exact_hessian,
        "reaffixing": reaffixing,
        "jamming_2d": partial(jamming_programs, 2),
        "jamming_3d": partial(jamming_programs, 3),
        "gap_tolerance": gap_tolerance,
        "shear_time_step": shear_time_step,
        "integrators": integrators,
        "effect_costs": effect_costs,
    }
