"""How studies are run and written whose trials give errors themselves: table, text, figure against the setting."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt

import packmech as pm

MARKERS = "osD^vP*X<>"


def compare(
    problem: Mapping[str, Callable[[float], pm.Answer]],
    settings: Sequence[float] | Mapping[str, Sequence[float]],
    quantities: Sequence[str],
    repeats: int = 1,
    **words: str,
) -> pm.WorkPrecision:
    """Return the study of trials whose values are errors by quantity; `words` are knob, title and reference_is.

    Settings may be those of each method.
    """
    zero = dict.fromkeys(quantities, 0.0)
    if isinstance(settings, Mapping):
        parts = [compare({name: problem[name]}, settings[name], quantities, repeats, **words) for name in problem]
        seconds = {name: part.first_seconds[name] for name, part in zip(problem, parts, strict=True)}
        return replace(parts[0], trials=tuple(one for part in parts for one in part.trials), first_seconds=seconds)
    return pm.work_precision(problem, settings, zero, error=lambda off, _: off, repeats=repeats, **words)


def write(
    table: pm.WorkPrecision,
    out: Path,
    name: str,
    words: str,
    *,
    floor: str = "",
    clock: bool = True,
    least: float = 0.0,
) -> None:
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
    least
        Smallest error that there can be above zero, where errors are shares: the axis goes down to zero then.

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
            points = [
                (one.setting, y)
                for one, y in zip(table.of(method), value, strict=True)
                if y > 0.0 or (y == 0.0 and least)
            ]
            label = method if points or clock else f"{method}: none"
            ax.plot(*zip(*points, strict=True) if points else ([], []), f"C{k}-", marker=MARKERS[k % 10], label=label)
            points = [(one.setting, one.work[floor]) for one in table.of(method) if floor in one.work]
            if points and quantity == table.quantities[0]:
                ax.plot(*zip(*points, strict=True), f"C{k}:", linewidth=1.2)
        label = "CPU seconds" if quantity is None else f"error in {quantity}"
        ax.set(xlabel=table.knob, ylabel=label, xscale="log", yscale="log")
        if least and quantity is not None:
            ax.set_yscale("symlog", linthresh=least)
        if settings[-1] < 100.0 * settings[0]:
            ax.set_xticks(settings, [f"{one:g}" for one in settings])
            ax.set_xticks([], minor=True)
    figure.suptitle(table.title + (f"\ndotted: floor of {table.quantities[0]}" if floor else ""))
    figure.legend(*axes[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9)
    figure.savefig(out / f"{name}.png", dpi=130)
