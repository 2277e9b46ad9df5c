"""Which gaps count as contacts: gap tolerance against contacts and verdict, for packings at falling pressure.

    python recordings/accuracy/gap_tolerance.py

A packing under pressure has more contacts than the hard packing near it: those whose gaps its overlaps have closed. At
a low pressure there is a plateau of tolerances, wider than the overlaps and narrower than the smallest true gap, where
the contacts are those of the hard packing; at a high one there is none.
"""

from functools import partial
from pathlib import Path

from cyclopts import run

import packmech as pm

EXCESS, WORDS = "contacts beyond the fewest that jam", ("not jammed", "jammed", "ambiguous")


def packing_at(particles: int, pressure: float) -> pm.Packing:
    """Return the packing of the common random start at a pressure [energy_scale / diameter^2], every strain free."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.87, seed=1)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="free").packing


def trial(packing: pm.Packing | pm.Scene, tolerance: float) -> pm.Answer:
    """Return the contacts beyond the fewest that jam, with the verdicts (numbers of the words) at one gap tolerance."""
    verdict = pm.classify_jamming(packing, gap_tolerance=tolerance)
    excess = float(verdict.contacts - verdict.strictly.isostatic_contacts)
    said = {name: float(WORDS.index(getattr(verdict, name))) for name in ("collective", "strict")}
    return pm.Answer({EXCESS: excess}, work={"contacts": float(verdict.contacts), "excess": excess} | said)


def main(*, particles: int = 128, decades: tuple[int, int] = (3, 9), out: Path = Path(__file__).parent) -> None:
    """Judge the packings at all tolerances; write table and figure, and print what the default rule takes."""
    packings = {f"pressure 1e-{k:02d}": packing_at(particles, 10.0**-k) for k in range(decades[0], decades[1] + 1)}
    table = pm.work_precision(
        {name: partial(trial, packing) for name, packing in packings.items()},
        [10.0**-k for k in range(2, 13)],
        {EXCESS: 0.0},
        knob="gap tolerance",
        title=f"Which gaps are contacts: {particles} discs jammed at falling pressure",
        reference_is="one state of self stress, as hard packings have",
        repeats=1,
    )
    for name, packing in packings.items():
        verdict = pm.classify_jamming(packing)
        print(f"{name}: the default rule takes {verdict.touching.tolerance:.0e}, {verdict.strict}")
    (out / "gap_tolerance.csv").write_text(table.to_csv())
    (out / "gap_tolerance.md").write_text(table.to_markdown())
    table.save_figure(out / "gap_tolerance.png")


if __name__ == "__main__":
    run(main)
