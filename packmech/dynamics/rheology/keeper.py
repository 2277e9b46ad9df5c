"""Strained runs kept in a file while they go on, one after the other, so that interrupted work goes on where it was."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from packmech.dynamics.checkpoint import check_path, mark, read_checkpoint, write_checkpoint
from packmech.dynamics.march.checkpoint import Leaves

KIND = "strained runs"
# what goes on is written so often [s]
_EVERY = 30.0


class Keeper:
    """The file of one call, or of several that follow each other: a run after the other, each with its settings.

    A run that is in the file already is taken from it, whether it was finished or not, if its settings are the same.

    Parameters
    ----------
    path
        The file. It need not be there yet.

    Raises
    ------
    TypeError, ValueError
        If it cannot be written, or is there and holds something else.

    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path: Path = check_path(path)
        self.marks: list[dict[str, str]] = []
        self.finished: list[bool] = []
        self.arrays: list[Leaves] = []
        # runs that were asked for so far; the last of them is the one that goes on
        self.begun = 0
        self.written = time.monotonic()
        if self.path.exists():
            try:
                told, arrays = read_checkpoint(self.path)
            except ValueError as reason:
                raise ValueError(f"checkpoint must be a checkpoint where the file is there: {reason}") from reason
            if told.get("kind") != KIND:
                raise ValueError(f"checkpoint must hold strained runs where the file is there, got {str(self.path)!r}")
            self.marks, self.finished = told["marks"], told["finished"]
            self.arrays = [{} for _ in self.marks]
            for name, value in arrays.items():
                run, _, rest = name.partition(".")
                self.arrays[int(run)][rest] = value

    def next(self, settings: Mapping[str, Any]) -> Leaves | None:
        """Return what is kept of the run whose turn it is, None if it is yet to begin.

        Raises
        ------
        ValueError
            If what is kept is of other settings.

        """
        marks = {name: mark(value) for name, value in settings.items()}
        turn, self.begun = self.begun, self.begun + 1
        if turn == len(self.marks):
            self.marks.append(marks)
            self.finished.append(False)
            self.arrays.append({})
            return None
        kept = self.marks[turn]
        others = [name for name in {**kept, **marks} if kept.get(name) != marks.get(name)]
        if others:
            raise ValueError(
                f"checkpoint must hold a run of the same scene and settings, or be no file yet, got {str(self.path)!r} "
                f"with another {', another '.join(others)}; without that file the work begins anew"
            )
        return self.arrays[turn] or None

    def due(self) -> bool:
        """Whether what goes on has not been written for long."""
        return time.monotonic() - self.written > _EVERY

    def write(self, arrays: Leaves, *, finished: bool) -> None:
        """Write the file with the run that goes on as it is now; one that was finished before stays as it was."""
        turn = self.begun - 1
        if self.finished[turn]:
            return
        self.arrays[turn], self.finished[turn] = arrays, finished
        told = {"kind": KIND, "marks": self.marks, "finished": self.finished}
        whole = {f"{run}.{name}": value for run, part in enumerate(self.arrays) for name, value in part.items()}
        write_checkpoint(self.path, told, whole)
        self.written = time.monotonic()


def keeper_of(checkpoint: Any) -> Keeper | None:
    """Return the keeper of a file name, and what is one already or None as it is."""
    return checkpoint if checkpoint is None or isinstance(checkpoint, Keeper) else Keeper(checkpoint)
