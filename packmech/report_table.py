"""The numbers of a report as rows of words, for the terminal and for the recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from packmech.mechanics.verdict_text import verdict_rows
from packmech.outcome import Stage

if TYPE_CHECKING:
    from rich.table import Table

Row = tuple[str, str, str]


def result_rows(numbers: Mapping[str, Any], missing: Mapping[str, str]) -> list[Row]:
    """Return rows of quantity, value and what the value is, for what the numbers hold."""
    d = numbers["dimension"]
    unit = f"energy_scale / diameter^{d}"
    rows: list[Row] = []
    if "jamming_packing_fraction" in numbers:
        note = f"of the hard packing, rattlers included; protocol {numbers['method']}"
        rows.append(("packing fraction at jamming", f"{numbers['jamming_packing_fraction']:.8f}", note))
    rows += [
        ("packing fraction", f"{numbers['packing_fraction']:.8f}", "as it stands, rattlers included"),
        ("pressure", f"{numbers['pressure']:.6g}", unit),
        _residual(numbers["force_residual"]),
        _contacts(numbers),
        _rattlers(numbers),
    ]
    if "links" in numbers:
        rows.append(_links(numbers))
    if numbers.get("redundant_patches"):
        sizes = ", ".join(str(len(patch)) for patch in numbers["redundant_patches"])
        rows.append(("redundant self stress", "yes", f"crystalline patches of {sizes} particles, listed in --json"))
    if "collective" in numbers:
        rows += verdict_rows(numbers)
    if "bulk_modulus" in numbers:
        rows += _moduli(numbers, unit)
    if "lowest_frequencies" in numbers:
        rows.append(_frequencies(numbers["lowest_frequencies"][:6], numbers["frequency_floor"]))
    rows += [(part, "not available", reason) for part, reason in missing.items()]
    return rows


def _residual(residual: float | None) -> Row:
    if residual is None:
        return ("force residual", "-", "no contact carries a force")
    return ("force residual", f"{residual:.1e}", "largest net force / mean contact force")


def _frequencies(frequencies: Sequence[float], floor: float) -> Row:
    listed = ["0" if abs(value) <= floor else f"{value:.3g}" for value in frequencies]
    note = "sqrt(energy_scale / mass) / diameter"
    if "0" in listed:
        note += f"; 0: within rounding, {floor:.0e} (1e-6 of the stiffest)"
    return ("lowest frequencies", "  ".join(listed) or "none", note)


def _contacts(numbers: Mapping[str, Any]) -> Row:
    d = numbers["dimension"]
    extra = 1 if numbers["strain"] == "fixed" else d * (d + 1) // 2
    note = f"isostatic: {numbers['isostatic_contacts']}"
    if numbers["isostatic_contacts"]:
        less = " - L'" if "links" in numbers else ""
        note += f" = {d}N'{extra - d:+d}{less}, strain {numbers['strain']}"
    if "states_of_self_stress" in numbers:
        states = numbers["states_of_self_stress"]
        note += f"; {states} state{'s' if states != 1 else ''} of self stress"
    return ("contacts", str(numbers["contacts"]), note)


def _rattlers(numbers: Mapping[str, Any]) -> Row:
    share = numbers["rattlers"] / numbers["particles"]
    note = f"{share:.1%} of {numbers['particles']} particles"
    if "danglers" in numbers:
        note += f"; {numbers['danglers']} touch nothing"
    if "rattling_clusters" in numbers:
        note += f", {numbers['rattling_clusters']} clusters rattle as a whole"
    return ("rattlers", str(numbers["rattlers"]), note)


def _links(numbers: Mapping[str, Any]) -> Row:
    shapes = numbers["shape_links"]
    note = f"{numbers['links'] - shapes} bonds, {shapes} hold shapes; lengths kept to {numbers['link_error']:.0e}"
    if numbers.get("crossing_links"):
        count = numbers["crossing_links"]
        note += f"; {count} pair{'s' if count != 1 else ''} of bonds CROSS"
    return ("links", str(numbers["links"]), note)


def _moduli(numbers: Mapping[str, Any], unit: str) -> list[Row]:
    shear = f"simple shear xy, relaxed; mean over directions {numbers['shear_modulus_mean']:.4g}, {unit}"
    if numbers["shear_modulus"] < 0.0:
        shear += "; NEGATIVE: this shear lowers the energy"
    if not numbers["elastically_stable"]:
        shear += "; elastically unstable: some motion of particles and box lowers the energy"
    return [
        ("bulk modulus", f"{numbers['bulk_modulus']:.6g}", f"box scaled, particles relaxed, {unit}"),
        ("shear modulus", f"{numbers['shear_modulus']:.6g}", shear),
    ]


def stage_rows(stages: Iterable[Stage]) -> list[tuple[str, ...]]:
    """Return rows of step, residual, force evaluations, CPU seconds and note."""
    return [
        (
            stage.name,
            f"{stage.residual:.1e}" if stage.residual else "-",
            f"{stage.force_evaluations:,}" if stage.force_evaluations else "-",
            f"{stage.seconds:.3f}",
            stage.note,
        )
        for stage in stages
    ]


STAGE_HEADINGS = ("step", "residual", "force evaluations", "CPU s", "")


def rich_table(title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], *, right: Sequence[int]) -> Table:
    """Return a table for the terminal; the columns numbered in `right` are aligned to the right."""
    from rich import box
    from rich.table import Table

    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_header=any(headings),
    )
    for k, heading in enumerate(headings):
        table.add_column(heading, justify="right" if k in right else "left", overflow="fold", no_wrap=k < 2)
    for row in rows:
        table.add_row(*row)
    return table


def markdown_table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown.

    Examples
    --------
    >>> print(markdown_table(("step", "CPU s"), [("verdict", "0.1")]), end="")
    | step | CPU s |
    |---|---|
    | verdict | 0.1 |

    """
    lines = [headings, *rows]
    text = ["| " + " | ".join(line) + " |\n" for line in lines]
    return text[0] + "|" + "---|" * len(headings) + "\n" + "".join(text[1:])


def summary_markdown(title: str, rows: Iterable[Row], stages: Iterable[Stage]) -> str:
    """Return the text that stands beside a recorded packing: narrow tables, what the values are below them."""
    rows = list(rows)
    results = markdown_table((title, ""), [(name, value) for name, value, _ in rows])
    steps = markdown_table(STAGE_HEADINGS[:-1], [row[:-1] for row in stage_rows(stages)])
    notes = "".join(f"- **{name}**: {note}\n" for name, _, note in rows if note)
    return f"{results}\n{steps}\n{notes}"
