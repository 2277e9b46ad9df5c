"""What the command prints: progress while it works, tables at the end, and one clear line for an error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from packmech.outcome import Stage
from packmech.report_table import STAGE_HEADINGS, Row, rich_table, stage_rows

if TYPE_CHECKING:
    from rich.console import Console


def console(*, error: bool = False) -> Console:
    """Return a console; where output is no terminal it is as wide as its tables need."""
    from rich.console import Console

    made = Console(stderr=error, highlight=False)
    return made if made.is_terminal else Console(stderr=error, highlight=False, width=160)


@contextmanager
def working(first: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the seconds on standard error, and give a function that changes its words."""
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console(error=True), transient=True) as progress:
        task = progress.add_task(first, total=None)

        def tell(words: str) -> None:
            progress.update(task, description=words)

        yield tell


def print_scenes() -> int:
    """Print the scenes that ship; return the exit code."""
    from packmech.scene_file import list_scenes

    console().print(rich_table("scenes that ship", ("name", "what it is"), list_scenes().items(), right=()))
    return 0


def print_results(title: str, rows: list[Row], stages: list[Stage]) -> None:
    """Print the table of results, then the table of steps."""
    out = console()
    out.print(rich_table(title, ("", "", ""), rows, right=()))
    out.print(rich_table("what each step achieved and cost", STAGE_HEADINGS, stage_rows(stages), right=(1, 2, 3)))


def write_json(path: Path, numbers: dict[str, Any]) -> None:
    """Write the numbers as JSON; what is no number there (infinite, undefined) becomes null."""
    path.write_text(json.dumps(_finite(numbers), indent=2) + "\n", encoding="utf-8")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value
