"""`packmech accuracy`: measure what accuracy costs in time."""

from __future__ import annotations

from pathlib import Path

from packmech.check import one_of
from packmech.cli.output import show, working
from packmech.validation.studies.accuracy import studies


def accuracy(study: str | None = None, /, *, out: Path = Path("accuracy"), workers: int | None = None) -> None:
    """Measure what accuracy costs in time: tables and figures; long studies resume what they find.

    Parameters
    ----------
    study
        the study to run; all of them if not given
    out
        folder to write to
    workers
        processes that share long studies (default: one for each core); 0: the command's own

    """
    known = studies()
    if study is not None:
        one_of("study", study, tuple(known))
    out.mkdir(parents=True, exist_ok=True)
    for key in known if study is None else (study,):
        with working(f"study {key}") as say:

            def progress(method: str, setting: float, key: str = key) -> None:
                say(f"study {key}: {method} at {setting:.0e}")

            table, text = known[key](progress, out, workers)
        (out / f"{key}.csv").write_text(table.to_csv(), encoding="utf-8")
        (out / f"{key}.md").write_text(f"# {table.title}\n\n{text}\n\n{table.to_markdown()}", encoding="utf-8")
        table.save_figure(out / f"{key}.png")
        show(text)
        show(f"wrote {key}.csv, {key}.md and {key}.png in {out}")
