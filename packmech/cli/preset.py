"""`packmech preset`: hold the reference model against the tables of its package."""

from __future__ import annotations

import packmech as pm
from packmech.cli import FAILED, OK
from packmech.cli.output import show, table, working


def preset(name: str | None = None, /) -> int:
    """Run the reference model's scenarios and hold each row of the package's tables against them.

    The exit code is 1 if a row fails that holds in the package, or holds that fails there.

    Parameters
    ----------
    name
        only scenarios whose name contains this

    """
    preset = pm.particle_shear
    chosen = [one for one in preset.SCENARIOS if name is None or name.lower().replace("-", "_") in one]
    if not chosen:
        raise ValueError(f"name must be part of the name of a scenario, got {name!r}")
    lines, failed = [], 0
    with working("scenarios of the reference model") as say:
        for one in chosen:
            say(one)
            scenario = preset.SCENARIOS[one]()
            found = preset.judge(scenario, scenario.run())
            for row in scenario.rows:
                good = preset.is_as_stated(row, found[row.about])
                failed += not good
                verdict = "pass" if good else "FAIL"
                note = "not tested" if not row.states else "fails in the package, too" if row.fails else ""
                lines.append((verdict, scenario.table, one, row.about, ", ".join(row.states), note))
    headings = ("", "table", "scenario", "about", "the package's statement", "")
    show(table("the reference model against its package's tables", headings, lines, right=()))
    show(f"{len(lines) - failed} of {len(lines)} rows pass")
    return FAILED if failed else OK
