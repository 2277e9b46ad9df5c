"""What an engine keeps of its energy: the account of its steps, and the figures of those that are due."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.account import (
    BREAKING,
    CHANNELS,
    ENERGY,
    FIGURES,
    GAVE,
    LEFT,
    SHIFT,
    STORED,
    WORST,
    Account,
    new_account,
)
from packmech.dynamics.faces import face_number
from packmech.dynamics.wall_friction import VisitedWalls, faces_of
from packmech.minimize.passes.pair_list import Track
from packmech.scene import Scene


@dataclass(eq=False)
class Book:
    """The account of an engine, and its figures every so many steps.

    Attributes
    ----------
    account
        What the compiled loops add to.
    every
        Steps from row to row.
    step_t, row_tk
        The steps at which figures were kept, and these.
    before
        What was stored when bonds were last about to be taken out, less what channels had taken up.
    steps_before
        Steps before those of the engine, of a run that was cut into spans.

    """

    account: Account
    every: int
    step_t: list[int] = field(default_factory=list)
    row_tk: list[NDArray[np.float64]] = field(default_factory=list)
    before: NDArray[np.float64] = field(default_factory=lambda: np.zeros(STORED))
    steps_before: int = 0

    def account_for(self, track: Track | None) -> Account:
        """Return the account with room for the springs of these lists."""
        return self.account._replace(spring_pk=None if track is None else np.empty_like(track.inner_pk))

    def until_next(self, steps: int) -> int:
        """Return how many steps may be taken until figures are due."""
        return self.every - steps % self.every

    def keep(self, steps: int) -> None:
        """Keep the figures of this step, in place of those that were kept of it before."""
        if self.step_t and self.step_t[-1] == self.steps_before + steps:
            self.step_t.pop(), self.row_tk.pop()
        self.step_t.append(self.steps_before + steps)
        self.row_tk.append(self.account.number.copy())

    def keep_due(self, steps: int) -> None:
        """Keep the figures of this step if they are due."""
        if steps % self.every == 0:
            self.keep(steps)

    def go_on_from(
        self, book: Book, order_n: NDArray[np.int64], row_n: NDArray[np.int64], span: tuple[int, float]
    ) -> None:
        """Go on where the book of another engine of the same particles ended.

        Parameters
        ----------
        book
            The other one.
        order_n
            The particle of each of its rows.
        row_n
            The row of each particle here.
        span
            Steps of the other engine, and their time.

        """
        steps, time = span
        self.steps_before, self.step_t, self.row_tk = book.steps_before + steps, [*book.step_t], [*book.row_tk]
        # nothing is shifted: what acts on single particles has no potential where boxes deform
        self.account.number[:CHANNELS] = book.account.number[:CHANNELS]
        for place in range(LEFT, WORST, GAVE):
            energy, *rows, then = book.account.worst[place : place + 4].tolist()
            here = [row_n[order_n[int(row)]] if row < len(order_n) else row for row in rows]
            self.account.worst[place : place + 4] = energy, *here, then - time

    def mark(self) -> None:
        """Keep in mind what is stored, and was taken up, before bonds are taken out."""
        self.before = self._left()

    def release(self) -> None:
        """Book what broken bonds took with them, once the forces without them were taken."""
        gone = self.before - self._left()
        self.account.number[:STORED] -= gone
        self.account.number[BREAKING] += gone.sum()

    def _left(self) -> NDArray[np.float64]:
        """Return the stored energies minus the works that were stored, by channel: minus the errors of the integrator.

        Forces that are taken anew leave them as they are.
        """
        number = self.account.number
        return np.asarray(number[ENERGY : ENERGY + STORED] - number[:STORED])

    def shift(self, energy: float) -> None:
        """Add to the energy of single particles what was lost as they were moved by lattice vectors."""
        self.account.number[SHIFT] += energy

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a checkpoint keeps."""
        return {
            "book.number": self.account.number.copy(),
            "book.worst": self.account.worst.copy(),
            "book.every": np.array(self.every),
            "book.step_t": np.array(self.step_t, dtype=np.int64),
            "book.row_tk": np.array(self.row_tk),
        }

    def restore(self, saved: Callable[[str, Any], NDArray[Any]], rows: int) -> None:
        """Go on from what a checkpoint kept, in so many rows."""
        self.account.number[:] = saved("book.number", self.account.number)
        self.account.worst[:] = saved("book.worst", self.account.worst)
        self.every = int(saved("book.every", 0))
        self.step_t = saved("book.step_t", np.zeros(rows, dtype=np.int64)).tolist()
        self.row_tk = list(saved("book.row_tk", np.zeros((rows, FIGURES))))


def refuse_unknown(argument: str, scene: Scene) -> None:
    """Refuse what no channel is known of: rigid links.

    Parameters
    ----------
    argument
        The argument to name.
    scene
        The scene.

    """
    packing = scene.packing
    if packing.links:
        raise ValueError(
            f"{argument} must have no rigid links where energies are accounted for, got {len(packing.links)} links"
        )


def make_book(
    scene: Scene, body: NDArray[np.float64], width: int, blocks: int, walls: VisitedWalls | None, every: int
) -> Book:
    """Return the book of a scene's rows and visited walls, after refusing what a ledger does not know."""
    refuse_unknown("scene.packing", scene)
    account = new_account(body, width, blocks, face_number(faces_of(walls)))
    return Book(account._replace(wall_nk=None if walls is None else np.empty_like(walls.stretch_nk)), every)
