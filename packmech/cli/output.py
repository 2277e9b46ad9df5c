"""What the verbs share: options, progress, tables, numbers as JSON, the files of a run, modules that are loaded."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token
from rich import box
from rich.console import Console
from rich.table import Table

from packmech.calls.status import Status, shows, words_of
from packmech.check import brief, integer
from packmech.cli import FAILED, OK
from packmech.effects import law_of
from packmech.files.packings import NotKeptError, target_file, write_packing
from packmech.jamming.certificate_file import write_certificate
from packmech.jamming.verdict import Verdict
from packmech.packing import Packing
from packmech.result import STAGE_HEADINGS, HasSummary, Summary, stage_rows
from packmech.scene import Scene


def _whole(hint: object, tokens: Sequence[Token]) -> int:
    """Return a whole number of the command line; one with a fraction is none."""
    text = tokens[0].value
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"must be a whole number, got {brief(text)}") from None


# of options that are whole numbers
WHOLE = Parameter(converter=_whole)
# options that several verbs have
Load = Annotated[
    tuple[Path, ...],
    Parameter(
        help="a Python file to import first, which registers laws, effects, drives, ... of your own; may be repeated",
        show_default=False,
    ),
]
Switch = Annotated[bool, Parameter(show_default=False)]
Json = Annotated[Path | None, Parameter(help="write the numbers as JSON")]
Out = Annotated[
    Path | None,
    Parameter(help="write the packing: .npz, .gsd, .data, .dump, .extxyz, .vtp, .csv, ... (as pm.write_packing)"),
]
Record = Annotated[Path | None, Parameter(help="Rerun recording; not written unless given")]
CertificateFile = Annotated[
    Path | None, Parameter(help="write the verdict with its grounds (.npz), for `packmech verify`")
]
Modes = Annotated[int, WHOLE, Parameter(help="how many of the lowest vibrations to find")]
Seed = Annotated[int | None, WHOLE, Parameter(help="another seed for the scene's random start")]
GapTolerance = Annotated[
    float | None,
    Parameter(help="pairs touch up to this gap, in contact distances (default: 7 mean overlaps, at least 1e-9)"),
]
Method = Annotated[str, Parameter(help='"certificate": rank and forces; "loads": random loads')]
SCENE = "a scene file (.toml), or the name of one that ships (see `packmech scenes`)"

# columns beyond any table's, so that lines are not folded where the output is no terminal
_UNLIMITED = 10_000
# largest number of packings that are kept of a run that keeps none by itself
_KEPT = 240


@dataclass(frozen=True)
class Files:
    """What to write of a run: the recording, the packing, the numbers, the certificate of its verdict."""

    record: Path | None = None
    out: Path | None = None
    json: Path | None = None
    certificate: Path | None = None

    def __post_init__(self) -> None:
        """Fail before the work, not after it, when a file cannot be written."""
        for path in (self.record, self.out, self.json, self.certificate):
            if path is not None:
                target_file(path, packing=path is self.out)
        if self.record is not None and self.record.suffix != ".rrd":  # the viewer goes by the ending
            raise ValueError(f"record must be a file name ending in .rrd, got {str(self.record)!r}")
        if self.certificate is not None and self.certificate.suffix != ".npz":
            raise ValueError(f"certificate must be a file name ending in .npz, got {str(self.certificate)!r}")

    def write_packing(self, packing: Packing, scene: Scene | None = None) -> None:
        """Write the packing, and the law of its scene with it where the format has a place for it."""
        if self.out is not None:
            law = None if scene is None or self.out.suffix != ".npz" else law_of(scene.effects)
            try:
                write_packing(packing, self.out, law=law)
            except OSError as error:
                raise OSError(f"{self._rescue(packing, law)}: {error.strerror or error}") from error
            except NotKeptError as error:
                # the work is done: what the format has a place for is written
                write_packing(packing, self.out, law=law, drop=True)
                show(f"{self.out} has no place for, and does not hold: {'; '.join(error.lost)}")

    def _rescue(self, packing: Packing, law: Any) -> str:
        """Write a packing that its place has no room for somewhere else; return where it is, in words."""
        assert self.out is not None
        kept = Path(tempfile.mkdtemp(prefix="packmech-")) / f"{self.out.stem}.npz"
        write_packing(packing, kept, law=law)
        return f"out must be a file that can be written, got {str(self.out)!r} (the packing is kept in {kept})"

    def write_json(self, numbers: dict[str, Any]) -> None:
        """Write the numbers as JSON; what is no number there (infinite, undefined) becomes null."""
        if self.json is not None:
            self.json.write_text(json.dumps(_finite(numbers), indent=2) + "\n", encoding="utf-8")

    def write_certificate(self, verdict: Verdict | None) -> int:
        """Write the certificate of a verdict; return the exit code, with a line on why where there is none."""
        if self.certificate is None:
            return OK
        try:
            if verdict is None:
                raise ValueError("the packing has no verdict")
            write_certificate(verdict, self.certificate)
        except ValueError as error:
            show(f"packmech: no certificate is written: {error}", error=True)
            return FAILED
        show(f"certificate: {self.certificate}   (check it: packmech verify {self.certificate})")
        return OK

    def say_what_was_written(self) -> None:
        """Print where the packing and the numbers are."""
        for name, path in (("packing", self.out), ("numbers", self.json)):
            if path is not None:
                show(f"{name}: {path}")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value


def show(thing: Any, *, error: bool = False) -> None:
    """Print a text or a table; where the output is no terminal, whole lines without blanks at their ends."""
    # texts hold brackets of their own, as of [packing] in a scene file
    console = Console(stderr=error, highlight=False, markup=False, emoji=False)
    if console.is_terminal:
        console.print(thing)
        return
    wide = Console(highlight=False, markup=False, emoji=False, width=_UNLIMITED)
    with wide.capture() as lines:
        wide.print(thing)
    stream = sys.stderr if error else sys.stdout
    stream.writelines(f"{line.rstrip()}\n" for line in lines.get().splitlines())


def table(
    title: str, headings: Sequence[str], rows: Iterable[Sequence[str]], *, right: Sequence[int] | None = None
) -> Table:
    """Return a table; the columns numbered in `right`, all unless given, are aligned to the right."""
    made = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_header=any(headings),
    )
    for k, heading in enumerate(headings):
        made.add_column(
            heading, justify="right" if right is None or k in right else "left", overflow="fold", no_wrap=k < 2
        )
    for row in rows:
        made.add_row(*row)
    return made


def show_summary(title: str, summary: Summary) -> None:
    """Print the results of a run or a report, and what each step cost."""
    show(table(title, ("", "", ""), summary.rows, right=()))
    show(table("what each step achieved and cost", STAGE_HEADINGS, stage_rows(summary.stages), right=(1, 2, 3)))


def title_of(name: str, thing: HasSummary) -> str:
    """Return the title of a table: the name of the scene or file, and what it is about."""
    return f"{name}: {thing.summary().title}"


@contextmanager
def working(first: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the seconds on standard error, and give a function that changes its words."""
    with shows(first, after=0.0):
        assert Status.current is not None
        yield Status.current.say


class Watch:
    """Progress of a run: shown as words and passed on; packings on the way are kept, thinned evenly.

    Parameters
    ----------
    say
        Shows words.
    live
        Called with all that a run reports, if anything is.

    """

    def __init__(self, say: Callable[[str], None], live: Callable[[str, dict[str, Any]], None] | None = None) -> None:
        self.say, self.live = say, live
        self.step_t: list[int] = []
        self.packing_t: list[Packing] = []
        self._before = 0
        self._seen = 0
        self._every = 1

    def __call__(self, stage: str, figures: dict[str, Any]) -> None:
        """Take what a run reports of a stage."""
        self.say(words_of(stage, figures))
        if self.live is not None:
            self.live(stage, figures)
        steps = int(figures.get("steps", 0))
        if "packing" in figures:
            # a stage that does not count its steps reports one packing after the other
            after = self.step_t[-1] + 1 if self.step_t and "steps" not in figures else 0
            self._keep(max(self._before + steps, after), figures["packing"])
        if "seconds" in figures:  # a stage has ended; the next counts its own steps
            self._before += steps

    def _keep(self, step: int, packing: Packing) -> None:
        """Keep a packing, unless it is one too many or of no later step."""
        self._seen += 1
        if self._seen % self._every or (self.step_t and step <= self.step_t[-1]):
            return
        self.step_t.append(step)
        self.packing_t.append(packing)
        if len(self.step_t) > _KEPT:
            self._every *= 2
            del self.step_t[::2], self.packing_t[::2]


def check_modes(modes: int) -> int:
    """Return the number of vibrations to find, after checking it."""
    return integer("modes", modes, at_least=0)
