"""`packmech hard-cases`: measure every hard case against its bound."""

from __future__ import annotations

from packmech.cli import FAILED, OK
from packmech.cli.output import show, table, working
from packmech.validation.hard_cases import catalogue, measure


def hard_cases(name: str | None = None, /) -> int:
    """Measure every hard case against its bound; exit code 1 if one is outside.

    Parameters
    ----------
    name
        only cases whose name contains this

    """
    cases = [case for case in catalogue() if name is None or name.lower() in case.name.lower()]
    if not cases:
        raise ValueError(f"name must be part of the name of a hard case, got {name!r}")
    rows, outside = [], 0
    with working("hard cases") as say:
        for number, case in enumerate(cases, start=1):
            say(f"hard case {number} of {len(cases)}: {case.name}")
            found = measure(case)
            outside += not found.within
            verdict = "ok" if found.within else "OUT OF BOUNDS"
            value = found.raised or f"{found.value:.3g}"
            rows.append(
                (verdict, case.name, case.watched, value, f"{case.bound:.3g}", case.why, f"{found.seconds:.2f}")
            )
    headings = ("", "case", "quantity measured", "measured", "bound", "where the bound comes from", "CPU s")
    show(table("hard cases", headings, rows, right=(3, 4, 6)))
    show(f"{len(cases) - outside} of {len(cases)} cases within their bounds")
    return FAILED if outside else OK
