"""Which gaps count as contacts, by law: gap tolerance against contacts and verdicts for stiff, soft and sticky discs.

    python recordings/accuracy/gap_tolerance_laws.py

As `gap_tolerance.py`, for packings pressed by other laws. What counts is the overlap that a law has at a pressure:
Hertz's law, soft at contact, has P^(2/3) where others have P, and repulsive Lennard-Jones discs, 72 times as stiff, a
72nd of it. Sticky discs are pressed without their attraction and then quenched with it in a box that is wider by a
quarter of its width: contacts are stretched to gaps. Scenes are judged, as the law decides what is at rest, and of
sticky discs the positions alone: a verdict knows no attraction. The reference is one state of self stress, as hard
packings have; a count has no floor.
"""

from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
from against import compare
from cyclopts import run
from gap_tolerance import EXCESS, WORDS, trial

import packmech as pm

STICKY, WIDTH = "sticky", 1e-4
LAWS = {"harmonic": pm.Harmonic(), "Hertz": pm.Hertz(), "repulsive Lennard-Jones": pm.RepulsiveLennardJones()}
LAWS |= {"divergent": pm.DivergentRepulsion(1.0), STICKY: pm.Harmonic()}


def pressed(law: str, particles: int, pressure: float) -> pm.Scene | pm.Packing:
    """Return the common random start pressed by a law, every strain free; sticky ones are stretched and quenched."""
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.87, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(law=LAWS[law]),))
    scene = scene.replace(packing=pm.jam(scene, pressure=pressure, strain="free").packing)
    if law == STICKY:
        fraction = pm.packing_fraction(scene.packing) * (1.0 - 0.5 * WIDTH)
        effects = (*scene.effects, pm.ShortRangeAttraction(width=WIDTH))
        wider = pm.Scene(pm.at_packing_fraction(scene.packing, fraction), effects)
        return pm.quench(wider, force_tolerance=1e-10).packing
    return scene


def in_words(table: pm.WorkPrecision, method: str) -> str:
    """Return a line of a packing by tolerance: contacts, how many too many, and both verdicts by their letters."""
    line = f"| {method} |"
    for work in (one.work for one in table.of(method)):
        letters = "".join(WORDS[int(work[verdict])][0] for verdict in ("collective", "strict"))
        line += f" {work['contacts']:.0f}, {work['excess']:+.0f} {letters} |"
    return line


def draw(table: pm.WorkPrecision, path: Path) -> None:
    """Draw contacts beyond the fewest that jam against tolerance, one panel for each law; nothing without contacts."""
    figure, axes = plt.subplots(1, len(LAWS), figsize=(3.2 * len(LAWS), 3.6), sharey=True, layout="constrained")
    for ax, law in zip(axes, LAWS, strict=True):
        for name, mark in zip([one for one in table.methods if one.startswith(law)], "osD", strict=False):
            trials = [one for one in table.of(name) if one.work["contacts"]]
            points = [(one.setting, one.work["excess"]) for one in trials]
            ax.plot(*zip(*points, strict=True), marker=mark, label=name.removeprefix(law))
        ax.set(title=law, xlabel="gap tolerance", xscale="log", yscale="symlog")
    axes[0].set_ylabel(EXCESS)
    axes[0].legend(title="pressure")
    figure.savefig(path, dpi=130)


def main(*, particles: int = 128, exponents: tuple[int, ...] = (3, 5, 7), out: Path = Path(__file__).parent) -> None:
    """Judge the packings of all laws at all tolerances; write table, text and figure."""
    scenes = {f"{law} 1e-{k:02d}": pressed(law, particles, 10.0**-k) for law in LAWS for k in exponents}
    tolerances, problem = [10.0**-k for k in range(1, 11)], {one: partial(trial, scenes[one]) for one in scenes}
    title = f"Which gaps are contacts, by law and pressure: {particles} discs"
    about = {"knob": "gap tolerance", "title": title, "reference_is": "one state of self stress"}
    table = compare(problem, tolerances, (EXCESS,), **about)
    head = " | ".join(f"{one:.0e}" for one in tolerances)
    lines = [f"| law, pressure | {head} |", "|---" * 11 + "|", *(in_words(table, one) for one in scenes)]
    words = "Contacts, those beyond the fewest that jam, collective and strict verdict: jammed, not jammed, ambiguous."
    text = "\n".join([f"# {table.title}", "", words, "", *lines, "", table.to_markdown()])
    (out / "gap_tolerance_laws.md").write_text(text)
    (out / "gap_tolerance_laws.csv").write_text(table.to_csv())
    draw(table, out / "gap_tolerance_laws.png")


if __name__ == "__main__":
    run(main)
