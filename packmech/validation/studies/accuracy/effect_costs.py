"""What each effect of a time integration costs: arrays, bytes, and CPU time of a step, counted on the engine.

A thousand discs at packing fraction 0.95 are sheared steadily on one thread; pair lists are rebuilt on the way and
their time is counted. A scene pays for what is in it: no spins and tangential displacements without friction or bonds,
no observables where none are asked for.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import Engine, build_engine
from packmech.dynamics.observables import CONTACTS, Ledger, new_ledger
from packmech.result import csv_text, markdown_table
from packmech.view.figures import COLORS, styled_figure

PARTICLES, FRACTION = 1000, 0.95
RATE, DT, STEPS, REPEATS = 1e-3, 0.05, 1000, 4
WARM_STEPS = 2000
SPRING, DASHPOT = pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.3)
FRICTION, DRAG = pm.Friction(0.5, 2.0 / 7.0, 0.15), pm.BackgroundDamping(0.01)
SHEAR = np.array([[0.0, 1.0], [0.0, 0.0]])
HEADINGS = (
    "effects",
    "observables kept every",
    "arrays",
    "bytes",
    "bytes a particle",
    "contacts and bonds",
    "us a step",
    "ns a contact and step",
    "times the spring",
)


@dataclass(frozen=True)
class Cost:
    """What an engine holds and how long a step takes; `every` is 0 where no observables are kept."""

    effects: str
    every: int
    arrays: int
    bytes: int
    bytes_per_particle: float
    contacts: int
    microseconds: float
    nanoseconds: float
    ratio: float


@dataclass(frozen=True)
class EffectCosts:
    """Costs by effects present, as text and as a figure."""

    rows: tuple[Cost, ...]
    title: str = "What each effect costs"

    def to_csv(self) -> str:
        """Return the table as comma-separated values, numbers with every digit."""
        return csv_text([field.name for field in fields(Cost)], map(astuple, self.rows))

    def to_markdown(self) -> str:
        """Return the table as Markdown."""
        rows = []
        for one in self.rows:
            counts = (_steps(one), str(one.arrays), str(one.bytes), f"{one.bytes_per_particle:.0f}", str(one.contacts))
            times = (f"{one.microseconds:.1f}", f"{one.nanoseconds:.1f}", f"{one.ratio:.2f}")
            rows.append((one.effects, *counts, *times))
        return markdown_table(HEADINGS, rows)

    def save_figure(self, path: str | Path) -> None:
        """Write bars of time and of bytes; the ending of path names the format."""
        names = [one.effects + ("" if not one.every else f"; observables every {_steps(one)}") for one in self.rows]
        draw_costs(
            self.title,
            names,
            {
                "CPU ns a contact and step": [one.nanoseconds for one in self.rows],
                "bytes a particle": [one.bytes_per_particle for one in self.rows],
                "arrays": [float(one.arrays) for one in self.rows],
            },
            Path(path),
        )


def _steps(one: Cost) -> str:
    return {0: "-", 1: "step"}.get(one.every, f"{one.every} steps")


@dataclass(frozen=True, eq=False)
class Start:
    """The state that every run starts from: one under steady shear, mapped back to a square box."""

    packing: pm.Packing
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64]


@cache
def start_of(particles: int) -> Start:
    """Return the common start of all runs of this many discs."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=FRACTION, seed=1)
    packing = pm.quench(pm.Scene(packing, (SPRING,)), force_tolerance=1e-2).packing
    packing = packing.replace(mass_n=packing.diameter_n**2 / np.mean(packing.diameter_n**2))
    rest = Start(packing, np.zeros((particles, 2)), np.zeros((particles, 1)))
    engine = engine_of(rest, (SPRING, DASHPOT, FRICTION))
    engine.advance(WARM_STEPS)
    back = np.linalg.inv(np.eye(2) + engine.gamma * SHEAR)
    spin = engine.spins()
    assert spin is not None
    return Start(packing.replace(position_nd=engine.positions() @ back.T), engine.velocities(), spin)


def engine_of(start: Start, effects: tuple[Any, ...]) -> Engine:
    """Return an engine at the start under these effects."""
    turns = any(isinstance(one, pm.Friction | pm.Bonds) for one in effects)
    return build_engine(
        pm.Scene(start.packing, effects),
        dt=DT,
        velocity_nd=start.velocity_nd,
        spin_nk=start.spin_nk if turns else None,
        profile=Ramp(0.0, RATE, 0.0, np.inf),
        direction_dd=SHEAR,
    )


def bonds_of(packing: pm.Packing) -> pm.Bonds:
    """Return bonds along every third contact."""
    bonds: pm.Bonds = pm.bond_contacts(
        packing,
        compression=pm.LinearSpring(),
        tension=pm.LinearSpring(),
        tangential_stiffness=0.4,
        damping=0.05,
        tangential_damping=0.03,
    )
    return bonds.select(np.arange(len(bonds)) % 3 == 0)


def arrays_of(record: Any) -> list[NDArray[Any]]:
    """Return the arrays that hold something in nested records.

    Examples
    --------
    >>> len(arrays_of((np.zeros(3), (np.zeros(0), None, np.ones(2)), 4.0)))
    2

    """
    if isinstance(record, np.ndarray):
        return [record] if record.size else []
    return [one for part in record for one in arrays_of(part)] if isinstance(record, tuple) else []


def cost_of(start: Start, name: str, effects: tuple[Any, ...], every: int) -> Cost:
    """Return what an engine under these effects holds, and the smallest CPU time of its steps."""
    best = np.inf
    for _ in range(REPEATS):
        engine = engine_of(start, effects)
        ledger: Ledger | None = None if not every else new_ledger(every, STEPS // every + 4)
        engine.advance(4, ledger)
        began = time.process_time()
        engine.advance(STEPS, ledger)
        best = min(best, (time.process_time() - began) / STEPS)
    held = arrays_of((engine.state, engine.space, engine.pairs, engine.track, ledger))
    size = sum(one.nbytes for one in held)
    contacts = int(engine.observe()[CONTACTS]) + sum(len(one) for one in effects if isinstance(one, pm.Bonds))
    particles = start.packing.particles
    return Cost(name, every, len(held), size, size / particles, contacts, best * 1e6, best / contacts * 1e9, np.nan)


def run(progress: Callable[[str, float], None]) -> tuple[EffectCosts, str]:
    """Run the study; return its table and what it shows in words."""
    start = start_of(PARTICLES)
    all_three = (SPRING, DASHPOT, FRICTION)
    asked: list[tuple[str, tuple[Any, ...], int]] = [
        ("spring", (SPRING,), 0),
        ("spring, dashpot", (SPRING, DASHPOT), 0),
        ("spring, dashpot, friction", all_three, 0),
        ("spring, dashpot, friction, background damping", (*all_three, DRAG), 0),
        ("spring, dashpot, friction, bonds", (*all_three, bonds_of(start.packing)), 0),
        ("spring, dashpot, friction", all_three, 10),
        ("spring, dashpot, friction", all_three, 1),
    ]
    rows: list[Cost] = []
    for name, effects, every in asked:
        progress(name, float(max(every, 1)))
        one = cost_of(start, name, effects, every)
        rows.append(replace(one, ratio=one.nanoseconds / (rows[0] if rows else one).nanoseconds))
    return EffectCosts(tuple(rows)), describe(tuple(rows))


def describe(rows: tuple[Cost, ...]) -> str:
    """Return what the table shows, every figure taken from it."""
    spring, every = rows[0], rows[-1]
    plain = next(one for one in rows if one.effects == every.effects and not one.every)
    return "\n".join(
        [
            f"{PARTICLES} discs, packing fraction {FRACTION}, sheared at {RATE:g} in steps of {DT:g}, one thread,",
            f"pair lists rebuilt on the way. CPU time, the smallest of {REPEATS} runs of {STEPS} steps; arrays are",
            "those of the engine that hold anything, observables that are kept included.",
            "",
            f"The spring alone takes {spring.nanoseconds:.1f} ns a contact and step and",
            f"{spring.bytes_per_particle:.0f} bytes a particle; with dashpot and friction it is",
            f"{plain.nanoseconds:.1f} ns and {plain.bytes_per_particle:.0f} bytes. Stress, energies and the other",
            f"observables of every step make it {every.nanoseconds:.1f} ns; they cost nothing where none are kept.",
        ]
    )


def draw_costs(title: str, names: Sequence[str], columns: Mapping[str, Sequence[float]], path: Path) -> None:
    """Write the figure: a column of bars for each quantity, names at the left, numbers at the ends of the bars."""
    # a letter takes about 0.075 inches
    margin = 0.075 * max(len(name) for name in names)
    with styled_figure(path, (margin + 2.6 * len(columns), 1.2 + 0.42 * len(names))) as figure:
        axes = figure.subplots(1, len(columns), squeeze=False, sharey=True)[0]
        place = range(len(names))
        for k, (ax, (quantity, values)) in enumerate(zip(axes, columns.items(), strict=True)):
            bars = ax.barh(place, values, color=COLORS[k % len(COLORS)], height=0.62)
            ax.bar_label(bars, [f"{value:.3g}" if value < 1000.0 else f"{value:.0f}" for value in values], padding=3)
            ax.set(title=quantity, xlim=(0.0, 1.18 * max(values)))
            ax.grid(axis="y", visible=False)
            ax.set_axisbelow(True)
        axes[0].set_yticks(place, names)
        axes[0].invert_yaxis()
        figure.suptitle(title, fontsize=10)
