"""`packmech gallery`: list or run the short scripts that each answer one question."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import packmech
from packmech.check import brief, did_you_mean
from packmech.cli.output import show, table
from packmech.files.paths import made_folder

INSTALLED = Path(packmech.__file__).parent / "gallery"
CHECKOUT = Path(packmech.__file__).parents[1] / "recordings" / "gallery"


def scripts() -> dict[str, Path]:
    """Return name -> file of the scripts, beside the package or, where it is installed, in it."""
    folder = INSTALLED if INSTALLED.is_dir() else CHECKOUT
    return {file.stem: file for file in sorted(folder.glob("*.py"))}


def about(file: Path) -> str:
    """Return what a script says of itself."""
    return ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""


def gallery(
    name: Annotated[str | None, Parameter(help="the script to run; none: list them")] = None,
    /,
    *,
    out: Path = Path(),
    show_script: Annotated[bool, Parameter(name="--show", show_default=False)] = False,
) -> None:
    """List the short scripts that each answer one question of the literature; or run or show one.

    Parameters
    ----------
    out
        the folder for the figure
    show_script
        print the script instead of running it

    """
    found = scripts()
    if name is None:
        rows = [(one, about(file).partition("\n")[0]) for one, file in found.items()]
        show(table("scripts on public names, each with a figure", ("name", "question"), rows, right=()))
        show("run one: packmech gallery NAME --out FOLDER; read it: packmech gallery NAME --show")
        return
    if name not in found:
        near = did_you_mean(name, found)
        raise ValueError(f"name must be one of those that `packmech gallery` lists, got {brief(name)}{near}")
    if show_script:
        sys.stdout.write(found[name].read_text(encoding="utf-8"))
        return
    made_folder("out", out)
    show(about(found[name]) + "\n")
    words, sys.argv = sys.argv, [str(found[name]), str(out)]
    try:
        runpy.run_path(str(found[name]), run_name="__main__")
    except ModuleNotFoundError as error:
        raise ImportError(f'{name} needs {error.name}: pip install "packmech[learning]"') from error
    finally:
        sys.argv = words
    show(f"wrote {out / name}.png")
