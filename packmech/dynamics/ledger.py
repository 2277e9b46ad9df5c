"""The ledger of a run through time: the work done on it, what it stores, and where the rest was dissipated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import LETTERS, Row, as_html, as_text
from packmech.dynamics import account
from packmech.dynamics.engine import Engine
from packmech.observables import Table, make_table
from packmech.result import Condition

Curves = Mapping[str, NDArray[np.float64]]

# figures are kept about so often unless a trace says when
_ROWS = 200
# largest residual, which is rounding, and share of all energy that the integrator may leave [1]
_RESIDUAL, _INTEGRATOR = 1e-10, 0.05
_CUT = "take a shorter dt"
# energies that are rounding, over the largest [1]
_TINY = 1e-15


class WorstContact(NamedTuple):
    """The contact or bond at which one step was worst: its particles, when, and by how much [energy].

    `j` is None where it is one of a particle with a wall.
    """

    i: int
    j: int | None
    time: float
    energy: float

    def __str__(self) -> str:
        pair = f"particle {self.i} with a wall" if self.j is None else f"particles {self.i} and {self.j}"
        return f"most at the contact of {pair}, {self.energy:.2g} in a step at {self.time:.6g}"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class EnergyLedger:
    """Where the energy of a run went: work done on it = kinetic + stored + dissipated + what the integrator left.

    Each force is booked with what it does in the kicks of the time steps. So the sums over contacts, bonds and single
    particles must give the kinetic energy, which is summed over particles, but for rounding: `residual_t` is what they
    do not. What a force took up, less what its springs then hold, is the error of the integrator: of second order in
    dt for velocity Verlet as long as forces do not jump. Works are against the mean velocities in a kick.

    Channels that store: "contacts", "interactions", springs of friction ("tangential"), "rolling", "twisting", "bonds",
    "bond_tangential", "bodies" (potentials of single particles), "walls", and "pistons" (the kinetic energy of walls
    that hold a stress); "turning" stores nothing: what shapes in space lose of their kinetic energy as they turn freely
    is left by the integrator (beside `Langevin` it is in "bath"). That dissipate: "normal_dashpots",
    "tangential_dashpots", "sliding", "rolling", "twisting",
    "bond_dashpots", "breaking" (of bonds), "drag", "wall_dashpots", "piston_dashpots" (of walls that hold a stress),
    "stiffness_changes" (what `Mindlin`'s springs lose as the normal force changes under them) and "interactions" (what
    forming and breaking of `JKR` contacts and bridges takes). That do work: the deforming "box", particles that are
    "held" and moved, walls that are moved at a given velocity ("moved_walls") and the "held_stress" of others, single
    particles' forces without a potential ("pushing"), and the heat "bath" of `Langevin`, friction and noise together.
    Springs and dashpots of rough walls are booked where those of contacts are. What a scene lacks is left out.

    Attributes
    ----------
    time_t
        (T,) times since the start [time].
    kinetic_t
        (T,) kinetic energies of what is not held, of peculiar velocities and spins [energy].
    stored, dissipated, work
        (T,) energies by channel [energy]: stored now, dissipated and put in since the start.
    integrator
        (T,) what the integrator left since the start, by channel that stores [energy].
    worst_left, worst_gave
        The contact at which the kicks of one step differed most in what they stored, and the one that gave most energy
        in a step from where it should be dissipated; None where none did.

    """

    time_t: NDArray[np.float64]
    kinetic_t: NDArray[np.float64]
    stored: Curves
    dissipated: Curves
    work: Curves
    integrator: Curves
    worst_left: WorstContact | None
    worst_gave: WorstContact | None

    def __repr__(self) -> str:
        return as_text(type(self).__name__, self.verdict, self.rows())

    def _repr_html_(self) -> str:
        return as_html(type(self).__name__, self.verdict, self.rows(), self)

    def rows(self) -> list[Row]:
        """Return works and changes of energy since the start: name, value, and the channels that it is made of."""

        def of(curves: Curves) -> str:
            return ", ".join(f"{name.replace('_', ' ')} {one[-1] - one[0]:.4g}" for name, one in curves.items())

        change = float(self.kinetic_t[-1] - self.kinetic_t[0]), float(self.stored_t[-1] - self.stored_t[0])
        return [
            ("work done", f"{self.work_t[-1]:.6g}", of(self.work)),
            ("change of kinetic", f"{change[0]:.6g}", f"to {self.kinetic_t[-1]:.4g}"),
            ("change of stored", f"{change[1]:.6g}", of(self.stored)),
            ("dissipated", f"{self.dissipated_t[-1]:.6g}", of(self.dissipated)),
            ("left by integrator", f"{self.integrator_t[-1]:.3g}", of(self.integrator)),
            ("unexplained", f"{self.residual_t[-1]:.2g}", f"at most {self.residual:.1e} of all"),
            *((("worst contact", str(self.worst_left), ""),) if self.worst_left else ()),
        ]

    def _sum(self, curves: Curves) -> NDArray[np.float64]:
        return sum(curves.values(), np.zeros_like(self.time_t))

    @cached_property
    def work_t(self) -> NDArray[np.float64]:
        """The (T,) works done on the particles since the start [energy]."""
        return self._sum(self.work)

    @cached_property
    def stored_t(self) -> NDArray[np.float64]:
        """The (T,) energies stored now [energy]."""
        return self._sum(self.stored)

    @cached_property
    def dissipated_t(self) -> NDArray[np.float64]:
        """The (T,) energies dissipated since the start [energy]."""
        return self._sum(self.dissipated)

    @cached_property
    def integrator_t(self) -> NDArray[np.float64]:
        """The (T,) energies that the integrator left since the start: positive where it lost them [energy]."""
        return self._sum(self.integrator)

    @cached_property
    def residual_t(self) -> NDArray[np.float64]:
        """The (T,) works that none of these explain [energy]."""
        change = self.kinetic_t - self.kinetic_t[0] + self.stored_t - self.stored_t[0]
        return np.asarray(self.work_t - change - self.dissipated_t - self.integrator_t)

    @cached_property
    def scale(self) -> float:
        """The largest sum of works, kinetic energies, dissipated ones and changes of stored ones, by size [energy]."""
        found = np.abs(self.kinetic_t)
        for curves in (self.work, self.dissipated, self.stored):
            for curve in curves.values():
                found = found + np.abs(curve - curve[0])
        return float(found.max())

    @property
    def residual(self) -> float:
        """The largest residual over `scale` [1]."""
        return self._share(np.abs(self.residual_t).max())

    def _share(self, energy: Any) -> float:
        return float(energy) / self.scale if self.scale != 0.0 else float(energy)

    def conditions(self, *, integrator: float = _INTEGRATOR) -> tuple[Condition, ...]:
        """Return what must hold for the ledger to close: nothing unexplained, nothing dissipated that comes back.

        Parameters
        ----------
        integrator
            Largest share of `scale` that the integrator may have left [1].

        """
        left = self._share(np.abs(self.integrator_t).max())
        found = [Condition("energy that no channel explains, over all", self.residual, _RESIDUAL)]
        hint = "" if self.worst_gave is None else f"{self.worst_gave}; {_CUT}"
        for name, curve in self.dissipated.items():
            given = self._share((np.maximum.accumulate(curve) - curve).max())
            words = f"energy that came from {name.replace('_', ' ')}, over all"
            found.append(Condition(words, given, left + _RESIDUAL, hint=hint))
        most = max(self.integrator, key=lambda name: abs(self.integrator[name][-1]), default="contacts")
        hint = "" if self.worst_left is None else f"{self.worst_left}; {_CUT}"
        words = f"energy that the integrator left, most in {most.replace('_', ' ')}, over all"
        return (*found, Condition(words, left, integrator, hint=hint))

    @property
    def unmet(self) -> tuple[Condition, ...]:
        """The conditions that do not hold."""
        return tuple(one for one in self.conditions() if not one.met)

    @property
    def closed(self) -> bool:
        """Whether all conditions hold."""
        return not self.unmet

    @property
    def verdict(self) -> str:
        """Whether it closes, in words, and if not at which channel and contact."""
        if self.closed:
            return f"closes to {self.residual:.1e} of {self.scale:.4g}"
        return "does not close\n" + "\n".join(_wrapped(str(one)) for one in self.unmet[:2])

    def row(self) -> Row:
        """Return whether it closes as a row of what a run reached."""
        unmet = "; ".join(map(str, self.unmet))
        words = unmet or f"{self.residual:.1e} of all energies are not explained"
        return "energy ledger", "does not close" if unmet else "closes", words

    def to_dict(self) -> dict[str, Any]:
        """Return what its energies changed by, by channel, as plain values."""
        kinds = {"work": self.work, "stored": self.stored, "dissipated": self.dissipated, "integrator": self.integrator}
        found: dict[str, Any] = {"closed": self.closed, "residual": self.residual}
        found["kinetic"] = float(self.kinetic_t[-1] - self.kinetic_t[0])
        for kind, curves in kinds.items():
            found[kind] = {name: float(curve[-1] - curve[0]) for name, curve in curves.items()}
        return found

    def about(self) -> dict[str, Any]:
        """Return what a table of this ledger says of it."""
        return {"kind": type(self).__name__, "closed": self.closed, "residual": self.residual}

    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Return every curve by its name: those of channels as "stored contacts"."""
        named = {"stored": self.stored, "dissipated": self.dissipated, "work": self.work, "integrator": self.integrator}
        whole = {name: getattr(self, f"{name}_t") for name in ("kinetic", *named, "residual")}
        parts = {f"{kind}_{name}": curve for kind, curves in named.items() for name, curve in curves.items()}
        return {"time": self.time_t, **whole, **parts}

    def table(self) -> Table:
        """Return every curve as a column; `pm.write_table` writes it."""
        found = self.columns()
        return make_table(found, self.about(), {name: "time" if name == "time" else "energy" for name in found})


def _wrapped(words: str) -> str:
    """Return a sentence that is cut into lines at spaces."""
    lines = [""]
    for word in words.split():
        if len(lines[-1]) + len(word) > LETTERS - 4:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


def every_of(asked: int | None, steps: int) -> int:
    """Return after how many steps figures are kept, unless it is asked."""
    return max(1, steps // _ROWS) if asked is None else asked


def _worst(engine: Engine, numbers: NDArray[np.float64]) -> WorstContact | None:
    energy, i, j, time = numbers.tolist()
    if not energy > 0.0:
        return None
    assert engine.book is not None
    time += engine.book.steps_before * engine.dt
    other = int(engine.order_n[int(j)]) if int(j) < len(engine.order_n) else None
    return WorstContact(int(engine.order_n[int(i)]), other, time, energy)


def ledger_of(engine: Engine) -> EnergyLedger | None:
    """Return the ledger of an engine as far as it came; None where it keeps none."""
    book = engine.book
    if book is None or not book.step_t:
        return None
    step = book.steps_before + engine.steps
    now = book.step_t[-1] == step
    step_t = book.step_t if now else [*book.step_t, step]
    rows = np.array(book.row_tk if now else [*book.row_tk, book.account.number])
    # what springs gave up as the very first forces were taken was before the start
    rows[:, : account.CHANNELS] -= rows[0, : account.CHANNELS].copy()
    storing, dissipating = account.STORED, account.BOX
    energy = rows[:, account.ENERGY : account.KINETIC]
    left = rows[:, :storing] - (energy - energy[0])

    tiny = _TINY * float(np.abs(rows).max())

    def curves(names: tuple[str, ...], columns: NDArray[np.float64], seen: NDArray[np.float64]) -> Curves:
        # what is nowhere anything but rounding is no channel of this scene
        return {name: columns[:, k].copy() for k, name in enumerate(names) if not (np.abs(seen[:, k]) <= tiny).all()}

    active = np.abs(energy) + np.abs(rows[:, :storing])
    lost, done = rows[:, storing:dissipating], rows[:, dissipating : account.CHANNELS]
    worst = book.account.worst
    return EnergyLedger(
        time_t=np.array(step_t) * engine.dt,
        kinetic_t=rows[:, account.KINETIC].copy(),
        stored=curves(account.STORING, energy, active),
        dissipated=curves(account.DISSIPATING, lost, lost),
        work=curves(account.WORKING, done, done),
        integrator=curves(account.STORING, left, active),
        worst_left=_worst(engine, worst[account.LEFT : account.LEFT + 4]),
        worst_gave=_worst(engine, worst[account.GAVE : account.GAVE + 4]),
    )
