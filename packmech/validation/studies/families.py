"""Families of sheared packings, the identity of their slopes, and the first change of contacts over pressure and N."""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.ensemble.callers import complete
from packmech.result import csv_text
from packmech.validation.studies.rows import MEMBERS, columns_of, complete_rows
from packmech.view.figures import COLORS, MARKERS, styled_figure

PRESSURES = tuple(float(x) for x in 10.0 ** np.arange(-2.0, -8.25, -0.5))
# N^2 P up to which first changes are at a strain in proportion to P, and from which to sqrt(P) / N
SMALL, LARGE = 0.1, 10.0
# number of discs, packings of each, and strain over which slopes are compared; and of ellipses of an aspect
SLOPES = ((10, 10, 0.1), (32, 10, 0.02), (128, 10, 0.002))
ELLIPSES = ((10, 10, 0.02), (32, 10, 0.01))
ASPECT = 1.5
WAYS = ("up", "down")
# half a step of the difference of packing fractions
_STEP = 1e-5
_FAMILIES = 4
# strain between the rows before a fall and after it is less than this
_AT_ONCE = 1e-8
# distances above jamming at which stress is followed over strain, as in figures 2.31 and 2.32 of the source, decades of
# the strain, and steps within each
DISTANCES = (6e-5, 3e-4, 1e-3, 4e-3, 2e-2)
DECADES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
_WITHIN = 8


@dataclass(frozen=True)
class Slope:
    """How well d ln(phi_J)/d(strain) = -Sigma/P holds along the families of one packing.

    `largest_error` is the largest difference of both sides in the middle of `compared` families.
    """

    particles: int
    aspect: float
    seed: int
    strain: float
    families: int
    changes: int
    jumps: int
    compared: int
    largest_error: float
    largest_slope: float
    imbalance: float
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:4])


@dataclass(frozen=True)
class FirstChange:
    """The first change of contacts of one shear-stabilized packing at constant volume.

    `one_shot` is the prediction of linear response at the start, `falls` whether the packing falls at the change, and
    `work_error` the relative difference of the energy's growth from the work done up to it.
    """

    particles: int
    pressure: float
    seed: int
    strain: float
    strain_from_above: float
    one_shot: float
    opened: int
    falls: int
    shear_modulus: float
    work_error: float
    contacts: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:3])


def jammed_discs(particles: int, seed: int, pressure: float = 1e-8, strain: str = "isotropic") -> pm.Scene:
    """Return the scene of a jammed packing of discs 1:1.4 in halves."""
    start = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed
    )  # fmt: skip
    scene = pm.Scene(start, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=pressure, strain=strain).packing)


def jammed_ellipses(particles: int, seed: int, aspect: float) -> pm.Packing:
    """Return a jammed packing of ellipses of an aspect, sizes 1:1.4 in halves, in a square box."""
    start = pm.random_packing(
        particles,
        dimension=2,
        sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=0.6,
        seed=seed,
        shapes=pm.Ellipses(aspect),
    )
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic").packing


# the map of families, as figure 2.7 of the source


def map_name(particles: int, aspect: float) -> str:
    """Return what tables and figure of a map begin with."""
    return f"map-{particles}" if aspect == 1.0 else f"map-ellipses-{aspect:g}-{particles}"


def walk_both_ways(particles: int, seed: int, strain: float, step: float, aspect: float) -> dict[str, Any]:
    """Return the tables of a packing's families up to a strain and back to zero, their changes, and how walks ended.

    A walk on which the packing is lost ends there, and its way back begins there.
    """
    start = jammed_discs(particles, seed).packing if aspect == 1.0 else jammed_ellipses(particles, seed, aspect)
    up = pm.shear_families(start, strain, step=step, check=False)
    down = pm.shear_families(up.packing, -float(up.strain_t[-1]), step=step, check=False)
    made: dict[str, Any] = {}
    for way, run, offset in zip(WAYS, (up, down), (0.0, up.strain_t[-1]), strict=True):
        table = run.table()
        columns = dict(table.columns) | {"strain": table["strain"] + offset}
        made |= {f"{way}_{name}": column for name, column in columns.items()}
        kept = [(one.strain + offset, one.cause, one.route, one.jump, one.moved) for one in run.changes]
        made[f"{way}_changes"] = csv_text(("strain", "cause", "route", "jump", "moved"), kept)
        made[f"{way}_lost"] = "" if run.ok else run.outcome.name
    return made


def map_families(
    folder: Path,
    wanted: Sequence[tuple[int, int, float, float, float]],
    progress: Callable[[int, int], None],
    workers: int | None = None,
) -> tuple[list[Path], list[str]]:
    """Return the tables of walks by (particles, seed, strain, step, aspect), each a member, and what went wrong."""
    names = ("particles", "seed", "strain", "step", "aspect")
    members = complete(
        walk_both_ways,
        [dict(zip(names, one, strict=True)) for one in wanted],
        folder / MEMBERS / "map",
        workers=workers,
        progress=lambda done, of, number, member: progress(done, of),
    )
    paths, lost = [], []
    for (particles, seed, _, _, aspect), member in zip(wanted, members, strict=True):
        arrays, name = member.arrays(), map_name(particles, aspect)
        for way in WAYS:
            columns = {key.removeprefix(f"{way}_"): one for key, one in arrays.items() if key.startswith(f"{way}_")}
            path = folder / f"{name}-{seed}-{way}.csv"
            rows = zip(*(column.tolist() for column in columns.values()), strict=True)
            path.write_text(csv_text(tuple(columns), rows), encoding="utf-8")
            changes = folder / path.name.replace("map", "changes")
            changes.write_text(member.values[f"{way}_changes"], encoding="utf-8")
            paths.append(path)
            outcome = member.values[f"{way}_lost"]
            if outcome:
                end = float(columns["strain"][-1])
                lost.append(f"{path.name} ends at a strain of {end:.6g} ({outcome.lower().replace('_', ' ')})")
    return paths, lost


def read_columns(path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a table of numbers."""
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = list(csv.reader(file))
    table = np.array(rows, dtype=np.float64).reshape(-1, len(head))
    return dict(zip(head, table.T, strict=True))


def draw_map(tables: Sequence[Path], particles: int, aspect: float, path: Path) -> int:
    """Draw the families in tables as packing fraction over strain; return how many pieces of them there are."""
    pieces = 0
    with styled_figure(path, (7.2, 5.4)) as figure:
        axes = figure.subplots()
        for number, table in enumerate(tables):
            found = read_columns(table)
            strain, fraction = found["strain"], found["packing_fraction"]
            # two rows, before a change and after it, at a strain or with a fall between them
            new = np.diff(found["family"]) != 0
            pieces += 1 + int(np.count_nonzero(new))
            breaks = np.flatnonzero(new | (np.abs(np.diff(strain)) < _AT_ONCE)) + 1
            # up in full, back in dots
            style = "-" if table.stem.endswith(WAYS[0]) else ":"
            for piece in np.split(np.arange(len(strain)), breaks):
                axes.plot(
                    strain[piece], fraction[piece], style, color=COLORS[number // 2 % len(COLORS)], linewidth=0.9
                )  # fmt: skip
        axes.set(xlabel="shear strain", ylabel="packing fraction at jamming")
        what = "discs" if aspect == 1.0 else f"ellipses of aspect {aspect:g},"
        axes.set_title(
            f"{pieces} pieces of families, {len(tables) // 2} packings of {particles} {what} 1:1.4,\n"
            "each sheared up and (dotted) back; kinks and breaks are changes of contacts",
            fontsize=8.0,
        )
    return pieces


# d ln(phi_J) / d(strain) = -Sigma / P


def compare_slopes(
    folder: Path,
    wanted: Sequence[tuple[int, float, int, float]],
    progress: Callable[[int, int, Slope | None], None],
    workers: int | None = None,
) -> list[Slope]:
    """Return how well the identity holds for (particles, aspect, seed, strain), each a member."""
    return complete_rows(folder / "slopes.csv", Slope, wanted, _slope, progress, workers)


def _slope(particles: int, aspect: float, seed: int, strain: float) -> Slope:
    if aspect == 1.0:
        packing, size = jammed_discs(particles, seed).packing, strain / 20.0
    else:
        packing, size = jammed_ellipses(particles, seed, aspect), strain / 5.0
    step = _STEP
    # where a packing is lost after a fall, up to there
    run = pm.shear_families(packing, strain, step=size, check=False)
    breaks = np.flatnonzero(np.diff(run.family_t) != 0) + 1
    ends = [run.strain_t[piece[[0, -1]]] for piece in np.split(np.arange(len(run.strain_t)), breaks)]
    middles = sorted(
        float(0.5 * (low + high)) for low, high in sorted(ends, key=lambda e: e[0] - e[1]) if high - low > 8.0 * step
    )[:_FAMILIES]
    errors, slopes = [], []
    kept = pm.shear_families(packing, strain, step=size, keep=middles, check=False).packings if middles else ()
    for packing_there in kept:
        both = [pm.shear_families(packing_there, sign * 2.0 * step, step=step) for sign in (1.0, -1.0)]
        if any(one.changes for one in both):
            continue
        (_, near, far), (_, less, least) = (np.log(one.packing_fraction_t) for one in both)
        slope = (8.0 * (near - less) - (far - least)) / (12.0 * step)
        errors.append(abs(float(slope + both[0].stress_ratio_t[0])))
        slopes.append(abs(float(slope)))
    return Slope(
        particles, aspect, seed, strain, run.families, len(run.changes), len(run.jumps()), len(errors),
        max(errors, default=math.nan), max(slopes, default=math.nan), run.residual, run.seconds,
    )  # fmt: skip


# the first change of contacts


def first_changes(
    folder: Path,
    *,
    particles: Sequence[int],
    pressures: Sequence[float],
    seeds: Sequence[int],
    progress: Callable[[int, int, FirstChange | None], None],
    workers: int | None = None,
) -> list[FirstChange]:
    """Return first changes of shear-stabilized packings of all sizes, seeds and pressures, each packing a member."""
    wanted = [(n, s, sorted(pressures, reverse=True)) for n, s in itertools.product(particles, seeds)]
    return complete_rows(folder / "first-change.csv", FirstChange, wanted, changes_over_pressure, progress, workers)


def changes_over_pressure(particles: int, seed: int, pressures: Sequence[float]) -> dict[str, NDArray[Any]]:
    """Return the rows of a packing that is followed through falling pressures; nan where no change is located."""
    scene = jammed_discs(particles, seed, pressure=max(pressures), strain="free")
    runs = pm.sweep_pressure(scene, pressures, strain="free", check=False)
    there = {goal: run for goal, run in zip(pressures, runs, strict=False) if run.ok}
    nothing = (math.nan, math.nan, math.nan, 0, 0, math.nan, math.nan, 0, math.nan)
    rows = []
    for pressure in pressures:
        found = None
        if pressure in there:
            found = _first_change(scene.replace(packing=there[pressure].packing), particles, pressure, seed)
        rows.append(found or FirstChange(particles, pressure, seed, *nothing))
    return columns_of(rows)


def _first_change(scene: pm.Scene, particles: int, pressure: float, seed: int) -> FirstChange | None:
    tiny = 1e-3 * pressure
    guess = float(pm.quasistatic_shear(scene, tiny, step=tiny, check=False).predicted_change_t[0])
    for factor in (1.1, 1.6, 3.0, 8.0):
        run = pm.quasistatic_shear(scene, factor * guess, step=guess / 12.0, check=False)
        first = run.first_change
        if first is not None:
            return FirstChange(
                particles, pressure, seed, first.strain, first.strain_from_above, guess, int(first.opened),
                int(first.falls), float(run.modulus_t[0]), abs(first.work / first.energy_change - 1.0),
                int(run.contacts_t[0]), run.seconds,
            )  # fmt: skip
    return None


def fit_first_changes(
    found: Sequence[FirstChange], *, large: bool, draws: int = 400
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return the fit ln(strain) = a + b ln(P) + c ln(N) where N^2 P is small, or large, its errors, and packings.

    By least squares; errors by drawing packings of each N, all pressures of one together, with replacement.

    Raises
    ------
    ValueError
        If packings of fewer than two N, or pressures, are left.

    """
    part = [one for one in found if math.isfinite(one.strain)]
    if large:
        part = [one for one in part if one.particles**2 * one.pressure >= LARGE]
    else:
        part = [one for one in part if one.particles**2 * one.pressure <= SMALL]
    packings = sorted({(one.particles, one.seed) for one in part})
    for name, words in (("particles", "N"), ("pressure", "pressures")):
        if len({getattr(one, name) for one in part}) < 2:
            raise ValueError(f"found must hold first changes of two or more {words} there, got {len(part)} of fewer")
    sizes = [[key for key in packings if key[0] == one] for one in sorted({key[0] for key in packings})]
    rows = {key: [one for one in part if (one.particles, one.seed) == key] for key in packings}
    rng = np.random.default_rng(0)

    def fitted(keys: Sequence[tuple[int, int]]) -> NDArray[np.float64]:
        chosen = [one for key in keys for one in rows[key]]
        x = np.array([[1.0, math.log(one.pressure), math.log(one.particles)] for one in chosen])
        y = np.log(np.array([one.strain for one in chosen]))
        return np.asarray(np.linalg.lstsq(x, y, rcond=None)[0])

    drawn = [fitted([keys[k] for keys in sizes for k in rng.integers(len(keys), size=len(keys))]) for _ in range(draws)]
    return fitted(packings), np.std(drawn, axis=0), len(packings)


def draw_first_changes(found: Sequence[FirstChange], path: Path) -> None:
    """Draw the first change over pressure, over both scalings, and which of them are openings."""
    with styled_figure(path, (10.8, 3.8)) as figure:
        left, middle, right = figure.subplots(1, 3)
        for number, particles in enumerate(sorted({one.particles for one in found})):
            rows = []
            for pressure in sorted({one.pressure for one in found}):
                part = [
                    one
                    for one in found
                    if (one.particles, one.pressure) == (particles, pressure) and math.isfinite(one.strain)
                ]
                if part:
                    strain = np.quantile([one.strain for one in part], [0.25, 0.5, 0.75])
                    rows.append((pressure, *strain, float(np.mean([one.opened for one in part]))))
            pressure_p, low, mid, high, opened = np.array(rows).T
            style = {"color": COLORS[number], "marker": MARKERS[number], "markersize": 4.0, "linewidth": 1.0}
            bars = np.array([mid - low, high - mid])
            left.errorbar(pressure_p, mid, bars, label=f"N = {particles}", capsize=2.0, **style)
            middle.errorbar(particles**2 * pressure_p, mid / pressure_p, bars / pressure_p, capsize=2.0, **style)
            right.plot(particles**2 * pressure_p, opened, **style)
            left.plot(pressure_p, np.sqrt(pressure_p) / particles, color=COLORS[number], linestyle=":", linewidth=1.0)
        x = np.array([min(one.pressure for one in found), max(one.pressure for one in found)])
        left.plot(x, 2.0 * x, color="#404040", linestyle="--", linewidth=1.0, label="2 P")
        left.plot([], [], color="#404040", linestyle=":", label="sqrt(P) / N")
        scaled = np.logspace(-4.0, 4.0, 60)
        middle.axhline(2.0, color="#404040", linestyle="--", linewidth=1.0)
        middle.plot(scaled[scaled > 0.05], 1.0 / np.sqrt(scaled[scaled > 0.05]), color="#404040", linestyle=":")
        left.set(xscale="log", yscale="log", xlabel="pressure", ylabel="strain of the first change of contacts")
        left.legend()
        middle.set(xscale="log", yscale="log", xlabel="$N^2 P$", ylabel="strain / pressure")
        right.set(xscale="log", xlabel="$N^2 P$", ylabel="fraction of openings", ylim=(-0.03, 1.03))
        left.set_title("medians and quartiles of packings", fontsize=8.0)


# stress over strain, as figures 2.31 and 2.32 of the source


@dataclass(frozen=True)
class Stressed:
    """Shear stress of a packing at one strain; `first_change` is the strain of the first change of contacts."""

    particles: int
    distance: float
    seed: int
    strain: float
    shear_stress: float
    modulus: float
    pressure: float
    contacts: int
    first_change: float
    residual: float


def stress_over_strain(particles: int, seed: int, strain: str, progress: Callable[[float], None]) -> list[Stressed]:
    """Return shear stresses, less that at the start, over five decades of strain and at all distances above jamming.

    Parameters
    ----------
    particles, seed
        Of the discs.
    strain
        Of `jam` and `compress`: "isotropic" as in the source, "free" for shear-stabilized packings.
    progress
        Called with each distance before it is followed.

    """
    found = []
    start = jammed_discs(particles, seed, strain=strain)
    for run in pm.compress(start, DISTANCES, strain=strain, check=False):
        distance = run.report["distance"]
        progress(distance)
        scene = start.replace(packing=run.packing)
        change = math.nan
        for end in DECADES:
            # from the start in each decade, so that none inherits the steps of another; the first change once
            sheared = pm.quasistatic_shear(
                scene, end, step=end / _WITHIN, locate="none" if math.isfinite(change) else "first", check=False
            )
            if sheared.first_change is not None:
                change = sheared.first_change.strain
            stress_t = sheared.shear_stress_t - sheared.shear_stress_t[0]
            found += [
                Stressed(
                    particles, distance, seed, float(sheared.strain_t[k]), float(stress_t[k]),
                    float(sheared.modulus_t[0]), float(sheared.pressure_t[k]), int(sheared.contacts_t[k]), change,
                    float(sheared.residual_t[k]),
                )
                for k in range(len(stress_t))
                if sheared.strain_t[k] > 0.1 * end
            ]  # fmt: skip
    return found


def draw_stress(found: Sequence[Stressed], path: Path) -> None:
    """Write the figure: shear stress over strain, one panel for each packing, and where contacts change first."""
    seeds = sorted({one.seed for one in found})
    with styled_figure(path, (4.2 * len(seeds), 4.2)) as figure:
        for ax, seed in zip(figure.subplots(1, len(seeds), sharey=True, squeeze=False).ravel(), seeds, strict=True):
            for number, distance in enumerate(sorted({one.distance for one in found})):
                mine = sorted(
                    (one for one in found if (one.seed, one.distance) == (seed, distance)), key=lambda x: x.strain
                )
                if not mine:
                    continue
                strain, stress = np.array([(one.strain, one.shear_stress) for one in mine]).T
                color, modulus, change = COLORS[number], mine[0].modulus, mine[-1].first_change
                # what unjammed bears no stress
                up = (stress > 0.0) & np.array([one.contacts > 0 for one in mine])
                ax.plot(
                    strain[up], stress[up], MARKERS[number], color=color, markersize=3.0,
                    label=f"{distance:g} above jamming",
                )  # fmt: skip
                if modulus > 0.0:
                    ax.plot(strain, modulus * strain, color=color, linewidth=0.8)
                    if math.isfinite(change):
                        ax.plot([change], [modulus * change], "|", color=color, markersize=14.0)
            ax.set(xscale="log", yscale="log", xlabel="shear strain")
            ax.set_title(f"packing {seed}", fontsize=9)
        figure.axes[0].set(ylabel="shear stress, less that at the start")
        figure.axes[0].legend(fontsize=7.0)
        figure.suptitle(
            f"{found[0].particles} discs 1:1.4; lines: modulus times strain; bars across: first change of contacts",
            fontsize=10,
        )
