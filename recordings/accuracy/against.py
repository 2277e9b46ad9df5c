"""How studies are written whose setting is no tolerance: table, text, and errors and seconds against the setting."""

from pathlib import Path

import matplotlib.pyplot as plt

import packmech as pm

MARKERS = "osD^vP*X<>"


def write(table: pm.WorkPrecision, out: Path, name: str, words: str, *, floor: str = "", clock: bool = True) -> None:
    """Write a study's table, its text and its figure; quantities without any error above zero are not drawn.

    Parameters
    ----------
    table
        The study.
    out, name
        Folder, and name of the files without ending.
    words
        What the table says; stands before it.
    floor
        The column of work that holds the floor of the first quantity's errors, dotted in the figure.
    clock
        Whether CPU seconds are drawn, too.

    """
    (out / f"{name}.csv").write_text(table.to_csv())
    text = f"# {table.title}\n\nReference: {table.reference_is}.\n\n{words}\n\n{table.to_markdown()}"
    (out / f"{name}.md").write_text(text)
    drawn = [one for one in table.quantities if any(trial.errors.get(one, 0.0) > 0.0 for trial in table.trials)]
    panels = len(drawn) + clock
    figure, axes = plt.subplots(1, panels, figsize=(5.0 * panels, 4.8), layout="constrained", squeeze=False)
    settings = sorted({one.setting for one in table.trials})
    for ax, quantity in zip(axes[0], [*drawn, None], strict=False):
        for k, method in enumerate(table.methods):
            value = [(one.seconds if quantity is None else one.errors.get(quantity, 0.0)) for one in table.of(method)]
            points = [(one.setting, y) for one, y in zip(table.of(method), value, strict=True) if y > 0.0]
            ax.plot(*zip(*points, strict=True) if points else ([], []), f"C{k}-", marker=MARKERS[k % 10], label=method)
        if floor and quantity == table.quantities[0]:
            points = sorted({(one.setting, one.work[floor]) for one in table.trials if floor in one.work})
            ax.plot(*zip(*points, strict=True), "k:", label="floor")
        label = "CPU seconds" if quantity is None else f"error in {quantity}"
        ax.set(xlabel=table.knob, ylabel=label, xscale="log", yscale="log")
        if settings[-1] < 100.0 * settings[0]:
            ax.set_xticks(settings, [f"{one:g}" for one in settings])
            ax.minorticks_off()
    figure.suptitle(table.title)
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9)
    figure.savefig(out / f"{name}.png", dpi=130)
