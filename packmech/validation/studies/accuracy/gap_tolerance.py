"""Which gaps count as contacts: gap tolerance against contacts and verdict, for packings at falling pressure.

A packing under pressure has more contacts than the hard packing near it: those whose gaps its overlaps have closed. At
a low pressure there is a plateau of tolerances, wider than the overlaps and narrower than the smallest true gap, where
the contacts are those of the hard packing; at a high one there is none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial

import packmech as pm
from packmech.result import markdown_table
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision

PARTICLES, SEED = 128, 1
PRESSURES = tuple(10.0**-k for k in range(3, 10))
TOLERANCES = tuple(10.0**-k for k in range(2, 13))
EXCESS = "contacts beyond the fewest that jam"
WORDS = ("not jammed", "jammed", "ambiguous")


@cache
def packing_at(pressure: float) -> pm.Packing:
    """Return the packing of the common random start at a pressure [energy_scale / diameter^2], every strain free."""
    start = pm.random_packing(PARTICLES, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=SEED)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="free").packing


@cache
def by_rule(pressure: float) -> tuple[float, str]:
    """Return the gap tolerance that the default rule takes, and the strict verdict with it."""
    verdict = pm.classify_jamming(packing_at(pressure))
    return verdict.touching.tolerance, verdict.strict


def trial(pressure: float, tolerance: float) -> Answer:
    """Return the contacts beyond the fewest that jam, with the verdicts at one gap tolerance."""
    verdict = pm.classify_jamming(packing_at(pressure), gap_tolerance=tolerance)
    strictly = verdict.strictly
    excess = float(verdict.contacts - strictly.isostatic_contacts)
    work = {
        "contacts": float(verdict.contacts),
        "excess": excess,
        "collective": float(WORDS.index(verdict.collective)),
        "strict": float(WORDS.index(verdict.strict)),
    }
    return Answer({EXCESS: excess}, work=work)


def run(progress: Callable[[str, float], None]) -> tuple[WorkPrecision, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {f"pressure {pressure:.0e}": partial(trial, pressure) for pressure in PRESSURES},
        TOLERANCES,
        {EXCESS: 0.0},
        knob="gap tolerance",
        title=f"Which gaps are contacts: {PARTICLES} discs jammed at falling pressure",
        reference_is="one state of self stress, as hard packings have",
        repeats=1,
        progress=progress,
    )
    return table, describe(table, {f"pressure {pressure:.0e}": by_rule(pressure) for pressure in PRESSURES})


def describe(table: WorkPrecision, rule: Mapping[str, tuple[float, str]]) -> str:
    """Return what the table shows, every figure taken from it.

    Parameters
    ----------
    table
        The table of the study.
    rule
        For each method, the tolerance that the default rule takes and the strict verdict with it.

    """
    tolerances = [one.setting for one in table.of(table.methods[0])]
    lines = [
        "Contacts beyond the fewest that jam strictly (0: one state of self stress) and the strict verdict with the",
        "tolerance given: j jammed, n not jammed, a ambiguous. Last: the tolerance of the default rule, and what it",
        "says after checking a tenth and ten times.",
        "",
    ]
    rows = []
    for method in table.methods:
        cells = [f"{one.work['excess']:+.0f} {WORDS[int(one.work['strict'])][0]}" for one in table.of(method)]
        taken, verdict = rule[method]
        rows.append((method, *cells, f"{taken:.0e}: {verdict}"))
    lines.append(markdown_table(("packing", *(f"{one:.0e}" for one in tolerances), "by rule"), rows))
    for method in table.methods:
        level = [one.setting for one in table.of(method) if one.work["excess"] == 0.0 and one.work["strict"] == 1.0]
        lines.append(
            f"{method}: one state of self stress, strictly jammed, from {min(level):.0e} to {max(level):.0e}."
            if level
            else f"{method}: at no tolerance one state of self stress."
        )
    return "\n".join(lines)
