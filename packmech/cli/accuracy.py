"""`packmech accuracy`: the cheapest settings with which a scene's run gives its figures to a stated accuracy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from packmech.check import brief, integer
from packmech.cli import FAILED, INTERRUPTED, OK
from packmech.cli.changes import UNCHANGED, Changes
from packmech.cli.output import SCENE, WHOLE, Files, Json, Load, Seed, Switch, show, table, working
from packmech.files.modules import load_modules
from packmech.files.paths import replacing, writable_file
from packmech.files.records import split_values, to_table, value_of_text
from packmech.scenes.reference import commented_scene
from packmech.validation.cheapest import CheapestSettings, plain
from packmech.validation.knobs import label
from packmech.validation.settings import search_settings, starts_of
from packmech.validation.targets import read_targets


def accuracy(
    scene: Annotated[str, Parameter(help=SCENE)],
    /,
    *,
    target: Annotated[tuple[str, ...], Parameter(show_default=False)],
    knob: Annotated[tuple[str, ...], Parameter(show_default=False)] = (),
    starts: Annotated[int, WHOLE] = 10,
    mean: Switch = False,
    time_limit: float | None = None,
    changes: Changes = UNCHANGED,
    load: Load = (),
    seed: Seed = None,
    out: Path | None = None,
    overwrite: Switch = False,
    json: Json = None,
    csv: Path | None = None,
    figure: Path | None = None,
) -> int:
    """Find the cheapest settings of a scene's run that meet a target, and show the curve that was searched.

    Parameters
    ----------
    target
        FIGURE:ERROR of a figure that --json names, as in "storage_modulus:1%" or "contacts:2 absolute"; may be repeated
    knob
        PATH=VALUES, a field of the drive and its values from coarse to fine, the last for the reference, in place of
        the usual ones: drive.dt=0.1,0.05,0.0125; may be repeated
    starts
        how many random starts to try; a scene without one has one
    mean
        the figures are means over starts: find how many repeats they take, too
    time_limit
        stop after so much CPU time [s]
    out
        write the scene with these settings to this file
    overwrite
        replace a file that exists, such as the scene's own
    csv
        write what was tried
    figure
        draw errors against CPU time: .png, .svg, .pdf

    """
    load_modules(load)
    targets = read_targets(target)
    given = [_values(one) for one in knob]
    knobs = dict(given) or None
    if len(given) > len(dict(given)):
        raise ValueError(f"knob must name each field once, got {', '.join(path for path, _ in given)}")
    files = Files(json=json)
    for name, path in (("out", out), ("csv", csv), ("figure", figure)):
        if path is not None:
            writable_file(name, path)
    if out is not None and (out.suffix != ".toml" or (out.exists() and not overwrite)):
        needed = "end in .toml" if out.suffix != ".toml" else "not exist (or give --overwrite)"
        raise ValueError(f"out must {needed}, got {str(out)!r}")
    tables, folder = changes.tables(scene, seed=None)
    drawn = starts_of(tables, folder, scene, integer("starts", starts, at_least=1), seed)
    with working(f"{scene}: settings for {', '.join(map(str, targets))}") as say:
        try:
            found = search_settings(
                drawn, targets, knobs, mean=mean, time_limit=time_limit, say=lambda stage, _: say(stage)
            )
        except KeyboardInterrupt as stop:
            tried: CheapestSettings | None = getattr(stop, "found", None)
            if tried is not None:
                _say(scene, tried)
                _write(tried, files, csv, figure if tried.trials else None)
            show("packmech: interrupted: this is what was tried so far, and nothing is chosen", error=True)
            return INTERRUPTED
    _say(scene, found)
    _write(found, files, csv, figure)
    if not found.met:
        unwritten = "" if out is None else f"; {out} is not written"
        show(f"packmech: no settings meet the target: {found.why_not}{unwritten}", error=True)
        return FAILED
    if out is not None:
        with replacing(out) as partial:
            partial.write_text(commented_scene(_with_settings(tables, found)), encoding="utf-8")
        drawn_anew = found.starts > 1 and tables["packing"].get("seed") is None
        show(f"wrote {out}   (next: packmech run {out}{' --seed 1' * drawn_anew})")
    return OK


def _write(found: CheapestSettings, files: Files, csv: Path | None, figure: Path | None) -> None:
    """Write what was tried, as it was asked for."""
    files.write_json(found.to_dict())
    files.say_what_was_written()
    if csv is not None:
        with replacing(csv) as partial:
            partial.write_text(found.to_csv(), encoding="utf-8")
    if figure is not None:
        found.save_figure(figure)
        show(f"figure: {figure}")


def _values(text: str) -> tuple[str, list[Any]]:
    """Return the path and the values that a word of the command line gives."""
    path, given, values = text.partition("=")
    if not given or not path.strip():
        raise ValueError(f"knob must be PATH=VALUES, such as drive.dt=0.1,0.05,0.0125, got {brief(text)}")
    return path.strip(), [value_of_text(value.strip()) for value in split_values(values)]


def _say(scene: str, found: CheapestSettings) -> None:
    """Print what was tried, by rising cost, and what was chosen."""
    headings, rows = found.table()
    what = ", ".join(map(str, found.targets))
    starts = f"{found.starts} starts" if found.starts > 1 else "one start"
    most = max((len(errors) for one in found.trials for errors in one.errors.values()), default=0)
    starts += f", {most} where these do not tell" if most > found.starts else ""
    title = f"{scene}: settings for {what}; {starts}, {found.seconds:.3g} s"
    show(table(title, headings, rows, right=range(len(found.changes), len(headings) - 2)))
    measured = ", ".join(f"{path} = {label(value)}" for path, value in found.reference.items())
    show(f"reference: {measured}")
    if found.met:
        show(f"cheapest: {found.words()}")


def _with_settings(tables: dict[str, Any], found: CheapestSettings) -> dict[str, Any]:
    """Return the tables of a scene whose drive has the settings that were found."""
    drive = found.scene.drive
    now = to_table(drive) | {path.removeprefix("drive."): plain(value) for path, value in found.changes.items()}
    before = tables["drive"]
    named = [path.removeprefix("drive.") for path in found.changes]
    # a drive that said how many steps of which length says for how long now
    kept = [name for name in (*before, *named, "duration") if now.get(name) is not None and name != "kind"]
    return {**tables, "drive": {"kind": before["kind"], **{name: now[name] for name in dict.fromkeys(kept)}}}
