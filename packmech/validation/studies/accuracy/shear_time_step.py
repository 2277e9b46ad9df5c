"""Time step and integrator against G' and G'' under oscillatory shear, with bonds and without.

The scene is that of the reference package's stored run as far as forces go: 100 discs at packing fraction 1.5 with its
divergent repulsion and a friction of 0.01, sheared by 0.2 at 0.025 periods in tau. Without bonds contacts open, close
and slide all the time; with every contact bonded trajectories are smooth. Means are over repeats, with error bars.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

import packmech as pm
from packmech.effects import Bonds
from packmech.result import markdown_table
from packmech.validation.work_precision import Answer, WorkPrecision, work_precision
from packmech.view.figures import COLORS, MARKERS, label_settings, styled_figure

PARTICLES, FRACTION = 100, 1.5
# what is bonded differs little from repeat to repeat
REPEATS = {"linked": 12, "unlinked": 48, "smooth onset": 48}
STIFFNESS, FRICTION, VISCOSITY = 1.0, 0.01, 0.1
AMPLITUDE, FREQUENCY, PERIODS = 0.2, 0.025, 5.0
# peculiar velocities halve in a period
KEPT = 0.5
# time steps in units of tau; the last is what the others are compared with
STEPS = (0.4, 0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625)
STORAGE, LOSS = "G' (relative)", "G'' (relative)"
# a mean that is off by less than so many of its standard errors is not distinguished from the reference
DISTINCT = 2.0


@cache
def scene_of(kind: str, repeat: int) -> pm.Scene:
    """Return a scene at rest; kind is "unlinked", "smooth onset" (unlinked too) or "linked"."""
    start = pm.random_packing(
        PARTICLES, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=FRACTION, seed=repeat
    )
    law = pm.DivergentRepulsion(STIFFNESS)
    packing = pm.quench(pm.Scene(start, (pm.Repulsion(law=law),)), force_tolerance=1e-9).packing
    packing = packing.replace(mass_n=(packing.diameter_n / packing.reference_diameter) ** 2)
    mass = float(packing.mass_n.mean())
    dashpot = VISCOSITY * math.sqrt(mass * STIFFNESS)
    drag = -math.log(KEPT) * FREQUENCY / math.sqrt(mass / STIFFNESS)
    effects = (
        pm.Repulsion(law=law),
        pm.ContactDamping(dashpot, onset="smooth" if kind == "smooth onset" else "jump"),
        pm.Friction(FRICTION, STIFFNESS, dashpot),
        pm.BackgroundDamping(drag),
    )
    if kind != "linked":
        return pm.Scene(packing, effects)
    bonds: Bonds = pm.bond_contacts(
        packing,
        compression=law,
        tension=pm.LinearSpring(STIFFNESS),
        tangential_stiffness=STIFFNESS,
        damping=dashpot,
        tangential_damping=dashpot,
    )
    return pm.Scene(packing, (*effects, bonds))


def moduli(kind: str, method: object, step: float, repeat: int) -> tuple[float, float]:
    """Return G' and G'' of one repeat at a time step in units of tau."""
    scene = scene_of(kind, repeat)
    tau = math.sqrt(float(scene.packing.mass_n.mean()) / STIFFNESS)
    run = pm.oscillatory_shear(
        scene,
        amplitude=AMPLITUDE,
        relative_frequency=FREQUENCY,
        periods=PERIODS,
        dt=step * tau,
        method=method,
        samples_per_period=100,
        # steps are coarse on purpose
        check=False,
    )
    if not run.measured:
        raise pm.NotConverged(run)
    return run.moduli.storage, run.moduli.loss


@cache
def finest(kind: str) -> tuple[tuple[float, float], ...]:
    """Return the moduli of each repeat by velocity Verlet at the shortest time step."""
    return tuple(moduli(kind, pm.VelocityVerlet(), STEPS[-1], repeat) for repeat in range(REPEATS[kind]))


def trial(kind: str, method: object, step: float) -> Answer:
    """Return how far the means of G' and G'' are off, relative, with their error bars over repeats."""
    fine = np.array(finest(kind))
    count = REPEATS[kind]
    found = np.array([moduli(kind, method, step, repeat) for repeat in range(count)])
    size = np.abs(fine.mean(axis=0))
    off = (found - fine) / size
    bars = off.std(axis=0, ddof=1) / math.sqrt(count)
    spread = found.std(axis=0, ddof=1) / math.sqrt(count)
    work = {
        "storage": float(found[:, 0].mean()),
        "storage error": float(spread[0]),
        "loss": float(found[:, 1].mean()),
        "loss error": float(spread[1]),
        "storage off": float(off[:, 0].mean()),
        "storage off error": float(bars[0]),
        "loss off": float(off[:, 1].mean()),
        "loss off error": float(bars[1]),
    }
    return Answer({STORAGE: float(off[:, 0].mean()), LOSS: float(off[:, 1].mean())}, work=work)


def methods() -> dict[str, tuple[str, object]]:
    """Return scene and integrator by name."""
    return {
        "linked, velocity Verlet": ("linked", pm.VelocityVerlet()),
        "linked, semi-implicit Euler": ("linked", pm.SemiImplicitEuler()),
        "unlinked, velocity Verlet": ("unlinked", pm.VelocityVerlet()),
        "unlinked, semi-implicit Euler": ("unlinked", pm.SemiImplicitEuler()),
        "unlinked, smooth onset, velocity Verlet": ("smooth onset", pm.VelocityVerlet()),
    }


def _counts() -> str:
    return f"{REPEATS['linked']} repeats with bonds, {REPEATS['unlinked']} without"


@dataclass(frozen=True)
class Deviations:
    """The table of the study, whose figure has error bars."""

    table: WorkPrecision

    @property
    def title(self) -> str:
        """What the study is."""
        return self.table.title

    def to_csv(self) -> str:
        """Return the table as comma-separated values."""
        return self.table.to_csv()

    def to_markdown(self) -> str:
        """Return the table as Markdown."""
        return self.table.to_markdown()

    def save_figure(self, path: str | Path) -> None:
        """Write the figure: how far means are off, with error bars."""
        table = self.table
        off = {
            method: {
                quantity: [
                    (one.setting, one.work[f"{name} off"], one.work[f"{name} off error"])
                    for one in table.of(method)
                    if not one.failed
                ]
                for quantity, name in ((STORAGE, "storage"), (LOSS, "loss"))
            }
            for method in table.methods
        }
        heading = f"{table.title}\nreference: {table.reference_is}"
        draw_deviations(off, Path(path), title=heading, knob=table.knob)


def run(progress: Callable[[str, float], None]) -> tuple[Deviations, str]:
    """Run the study; return its table and what it shows in words."""
    table = work_precision(
        {name: partial(trial, kind, method) for name, (kind, method) in methods().items()},
        STEPS[:-1],
        {STORAGE: 0.0, LOSS: 0.0},
        knob="time step / tau",
        title=f"Time step of oscillatory shear: {PARTICLES} discs, {_counts()}",
        reference_is=f"velocity Verlet at {STEPS[-1]} tau, the same repeats",
        repeats=1,
        progress=progress,
    )
    return Deviations(table), describe(table)


def describe(table: WorkPrecision) -> str:
    """Return what the table shows, every figure taken from it."""
    lines = [
        f"G' and G'' under {AMPLITUDE} at {FREQUENCY} periods in tau, {PARTICLES} discs at packing fraction {FRACTION}",
        f"(divergent repulsion, friction {FRICTION}). Means with standard errors over {_counts()};",
        f"in units of the stiffness, and how far they are off from velocity Verlet at {STEPS[-1]} tau, one repeat",
        "after the other.",
        "",
    ]
    rows: list[tuple[str, ...]] = []
    for method in table.methods:
        for one in table.of(method):
            if one.failed:
                rows.append((method, f"{one.setting:g}", "failed", one.failed, "", ""))
                continue
            means = (f"{one.work[name]:.4f} +- {one.work[f'{name} error']:.4f}" for name in ("storage", "loss"))
            off = (f"{one.work[name]:+.2%} +- {one.work[f'{name} error']:.2%}" for name in ("storage off", "loss off"))
            rows.append((method, f"{one.setting:g}", *means, *off))
    lines.append(markdown_table(("scene, method", "time step / tau", "G'", "G''", "G' off", "G'' off"), rows))
    for method in table.methods:
        good = [one.setting for one in table.of(method) if not one.failed and _converged(one.work)]
        lines.append(
            f"{method}: from {max(_lower_end(good, table, method)):g} tau down neither modulus is off the reference "
            f"by more than 1 % and {DISTINCT:g} error bars."
            if _lower_end(good, table, method)
            else f"{method}: converged at none of these time steps."
        )
    return "\n".join(lines)


def _converged(work: Mapping[str, float]) -> bool:
    return all(
        abs(work[f"{name} off"]) <= max(0.01, DISTINCT * work[f"{name} off error"])
        and work[f"{name} off error"] <= 0.05
        for name in ("storage", "loss")
    )


def _lower_end(good: list[float], table: WorkPrecision, method: str) -> list[float]:
    """Return the converged settings below which all are."""
    settings = sorted(one.setting for one in table.of(method))
    kept = []
    for one in settings:
        if one not in good:
            break
        kept.append(one)
    return kept


# (setting, deviation, its standard error), by method and quantity
Series = Mapping[str, Mapping[str, Sequence[tuple[float, float, float]]]]


def draw_deviations(deviations: Series, path: Path, *, title: str, knob: str, largest: float = 0.15) -> None:
    """Write the figure: a column for each quantity; above deviations with error bars, below their sizes in logarithms.

    Parameters
    ----------
    deviations
        Deviations relative to the reference, by method, then by quantity.
    path
        The file; its ending names the format.
    title, knob
        Words: what is shown, and what the setting is.
    largest
        Deviations are drawn above up to this size; larger ones stand below alone.

    """
    quantities = list(next(iter(deviations.values())))
    with styled_figure(path, (4.4 * len(quantities), 6.8)) as figure:
        axes = figure.subplots(2, len(quantities), squeeze=False, sharex=True)
        settings = sorted({row[0] for found in deviations.values() for rows in found.values() for row in rows})
        for column, quantity in enumerate(quantities):
            above, below = axes[0][column], axes[1][column]
            for k, (method, found) in enumerate(deviations.items()):
                setting, off, bar = np.array(found[quantity]).reshape(-1, 3).T
                style = {"color": COLORS[k % 8], "marker": MARKERS[k % 8], "markersize": 4.5, "linewidth": 1.0}
                # side by side, or bars hide each other
                beside = setting * 1.05 ** (k - 0.5 * (len(deviations) - 1))
                shown = np.abs(off) <= largest
                above.errorbar(
                    beside[shown], 100.0 * off[shown], 100.0 * bar[shown], capsize=2.0, label=method, **style
                )
                below.plot(setting, np.abs(off), **style)
            above.axhline(0.0, color="#999999", linewidth=0.8)
            above.set(title=quantity, ylabel="off the reference [%]", xscale="log")
            # what is nowhere off cannot be seen in logarithms
            scale = "log" if any(row[1] for found in deviations.values() for row in found[quantity]) else "linear"
            below.set(xlabel=knob, ylabel="size of it, relative", yscale=scale)
            label_settings(below, settings)
        # all columns share it
        axes[0][0].invert_xaxis()
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
        figure.suptitle(title, fontsize=10)
