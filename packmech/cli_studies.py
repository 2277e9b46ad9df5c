"""The commands that measure the package itself: studies of accuracy against time, and the hard cases."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from packmech.check import one_of
from packmech.cli_show import console, working
from packmech.report_table import rich_table


def run_hard_cases(part_of_name: str | None) -> int:
    """Measure the cases and print them; 0 if all are within bounds, else 1."""
    from packmech.hard_cases import catalogue, measure

    cases = [case for case in catalogue() if part_of_name is None or part_of_name.lower() in case.name.lower()]
    if not cases:
        raise ValueError(f"name must be part of the name of a hard case, got {part_of_name!r}")
    rows, outside = [], 0
    with working("hard cases") as tell:
        for number, case in enumerate(cases, start=1):
            tell(f"hard case {number} of {len(cases)}: {case.name}")
            found = measure(case)
            outside += not found.within
            verdict = "ok" if found.within else "OUT OF BOUNDS"
            value = found.raised or f"{found.value:.3g}"
            rows.append(
                (verdict, case.name, case.watched, value, f"{case.bound:.3g}", case.why, f"{found.seconds:.2f}")
            )
    headings = ("", "case", "quantity watched", "measured", "bound", "where the bound comes from", "CPU s")
    console().print(rich_table("hard cases", headings, rows, right=(3, 4, 6)))
    console().print(f"{len(cases) - outside} of {len(cases)} cases within their bounds")
    return 1 if outside else 0


def run_studies(name: str | None, folder: Path) -> int:
    """Run one study or all, write their tables and figures, print what they say."""
    from packmech.studies import studies

    known = studies()
    if name is not None:
        one_of("study", name, tuple(known))
    folder.mkdir(parents=True, exist_ok=True)
    for key in known if name is None else (name,):
        with working(f"study {key}") as tell:
            table, text = known[key](partial(_tell, tell, key))
        (folder / f"{key}.csv").write_text(table.to_csv(), encoding="utf-8")
        (folder / f"{key}.md").write_text(f"# {table.title}\n\n{text}\n\n{table.to_markdown()}", encoding="utf-8")
        table.save_figure(folder / f"{key}.png")
        console().print(text)
        console().print(f"wrote {key}.csv, {key}.md and {key}.png in {folder}")
    return 0


def _tell(tell: Callable[[str], None], study: str, method: str, setting: float) -> None:
    tell(f"study {study}: {method} at {setting:.0e}")
