"""The page of hard cases: what was measured of each, its bound, and what a naive way gives.

python tests/hard_cases/page.py recordings/hard-cases
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from hard_cases import ROOMS, Measured, measure  # noqa: E402

HEAD = """# Hard cases

Situations in which codes of this kind are known to go wrong: what could go wrong, the quantity watched, what was
measured of it, the largest value that is right and where that comes from, and, where there is one, the figure that a
naive way gives. `pytest tests/hard_cases -v` checks every row and prints the same; measured figures at rounding differ
between processors. {within} of {count} are within their bounds.
"""
COLUMNS = """
| case | what could go wrong | quantity | measured | bound | naive way | where the bound comes from |
|---|---|---|---|---|---|---|
"""


def row(found: Measured) -> str:
    """Return the row of a case."""
    case = found.case
    figures = found.raised or f"{found.value:.3g}", f"{case.bound:.3g}", found.naive or "-"
    cells = (case.name, case.risk, case.watched, *figures, case.why)
    return f"| {' | '.join(one.replace('|', '/') for one in cells)} |\n"


def main(folder: Path) -> None:
    """Write the page."""
    folder.mkdir(parents=True, exist_ok=True)
    found = {name: [measure(one) for one in cases] for name, cases in ROOMS.items()}
    every = [one for rows in found.values() for one in rows]
    parts = [HEAD.format(within=sum(one.within for one in every), count=len(every))]
    parts += [f"\n## {name}\n{COLUMNS}{''.join(map(row, rows))}" for name, rows in found.items()]
    (folder / "README.md").write_text("".join(parts))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
