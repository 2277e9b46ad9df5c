"""Vibrations near jamming, and forces and gaps of exact hard packings: densities of states, omega*, small exponents.

Three studies, each an ensemble, so that a run that was stopped goes on where it was: vibrational modes of discs and
ellipses a little above jamming; the frequency omega* at which the plateau of states of large packings of discs ends,
over the distance to jamming; contact forces and gaps of exact hard packings.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.validation.studies.rows import Progress, columns_of, complete_rows, kept_of
from packmech.validation.studies.shapes import start_of
from packmech.view.figures import COLORS, MARKERS, styled_figure

# distance to jamming of the packings whose modes are looked at [1]
DISTANCE = 1e-4
ASPECTS = (1.0, 1.1, 1.5)
EDGE_DISTANCES = tuple(float(x) for x in np.logspace(-5.0, -2.0, 7))
# bins of frequencies [sqrt(energy_scale / mass) / diameter]
_BINS = np.logspace(-3.6, 0.8, 67)
# mean field: gaps ~ h^-gamma, forces on all but bucklers ~ f^theta, on bucklers ~ f^theta_local; see `hard_contacts`
GAPS, EXTENDED, LOCALIZED = 0.41269, 0.42311, 0.17462
# what counts as a small force [mean force] and as a small gap [contact distance]
SMALL_FORCE, SMALL_GAP = 0.1, 1e-2
# a contact of an exact packing is closed to this [contact distance]
_CLOSED = 1e-10


@dataclass(frozen=True)
class Vibrated:
    """The modes of one packing at a distance above jamming: how many there are, and where they are kept."""

    dimension: int
    particles: int
    aspect: float
    distance: float
    seed: int
    modes: int
    contacts: int
    isostatic_contacts: int
    unstable_modes: int
    pressure: float
    residual: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:5])


@dataclass(frozen=True)
class Ended:
    """Where the plateau of states of one packing ends at a distance above jamming, without its stress."""

    dimension: int
    particles: int
    distance: float
    seed: int
    plateau_edge: float
    plateau: float
    pressure: float
    excess_coordination: float
    residual: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:4])


@dataclass(frozen=True)
class Touched:
    """One exact hard packing: its contacts, and how many of its forces and gaps are small."""

    dimension: int
    particles: int
    seed: int
    packing_fraction: float
    contacts: int
    isostatic_contacts: int
    bucklers: int
    gap_error: float
    force_imbalance: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:3])


@dataclass(frozen=True)
class HardContacts:
    """Forces and gaps of an exact hard packing.

    force_c [mean force] and on_buckler_c, which of them press on a particle with d + 1 contacts; gap_p [contact
    distance] of pairs of the backbone that do not touch, up to a tenth; bucklers, their number.
    """

    force_c: NDArray[np.float64]
    on_buckler_c: NDArray[np.bool_]
    gap_p: NDArray[np.float64]
    bucklers: int


def states_table(folder: Path, dimension: int) -> Path:
    """Return the table of packings whose modes are kept."""
    return folder / f"states-{dimension}d.csv"


def contacts_table(folder: Path, dimension: int) -> Path:
    """Return the table of hard packings whose forces and gaps are kept."""
    return folder / f"contacts-{dimension}d.csv"


def vibrate(dimension: int, particles: int, aspect: float, distance: float, seed: int) -> dict[str, Any]:
    """Return the row of a packing, and frequencies, rotational parts and participation ratios of its modes."""
    scene = start_of(dimension, particles, aspect, seed)
    if aspect == 1.0:
        scene = scene.replace(packing=scene.packing.replace(shapes=None))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-6, strain="isotropic").packing)
    (run,) = pm.compress(scene, [distance], check=False)
    packing = run.packing.replace(mass_n=np.ones(particles))
    modes = pm.normal_modes(scene.replace(packing=packing))
    report = run.report
    row = Vibrated(
        *(dimension, particles, aspect, distance, seed),
        *(len(modes), report["contacts"], report["isostatic_contacts"], modes.negative),
        *(report["pressure"], run.residual),
    )
    return asdict(row) | {
        "frequency_m": modes.frequency_m,
        "rotation_m": modes.rotation_m,
        "participation_m": modes.participation_m,
    }


def vibrate_all(
    folder: Path,
    *,
    dimension: int,
    particles: int,
    aspects: Sequence[float],
    seeds: Sequence[int],
    progress: Progress[Vibrated],
    workers: int | None = None,
) -> list[Vibrated]:
    """Return packings of all aspects and seeds at DISTANCE, members with their modes; all particles have mass 1."""
    wanted = itertools.product((dimension,), (particles,), aspects, (DISTANCE,), seeds)
    return complete_rows(states_table(folder, dimension), Vibrated, wanted, vibrate, progress, workers)


def follow_edge(dimension: int, particles: int, seed: int, distances: Sequence[float]) -> dict[str, NDArray[Any]]:
    """Return the rows of a packing of discs that is followed upward; nan where it ended."""
    packing = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=seed
    )
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-7, strain="isotropic").packing)
    rows = {each: Ended(dimension, particles, each, seed, *(5 * (math.nan,))) for each in distances}
    for distance, run in zip(distances, pm.compress(scene, distances, check=False), strict=False):
        here = scene.replace(packing=run.packing.replace(mass_n=np.ones(particles)))
        states = pm.density_of_states(here, _BINS, kind="unstressed")
        backbone = particles - run.report["rattlers"]
        rows[distance] = Ended(
            *(dimension, particles, distance, seed, states.plateau_edge, states.plateau),
            *(run.report["pressure"], 2.0 * run.report["excess_contacts"] / backbone, run.residual),
        )
    return columns_of(list(rows.values()))


def edges_all(
    folder: Path,
    *,
    dimension: int,
    particles: int,
    distances: Sequence[float],
    seeds: Sequence[int],
    progress: Progress[Ended],
    workers: int | None = None,
) -> list[Ended]:
    """Return where the plateau of states ends, for each packing of discs and each distance above its jamming."""
    wanted = [(dimension, particles, seed, sorted(distances)) for seed in seeds]
    return complete_rows(folder / f"edges-{dimension}d.csv", Ended, wanted, follow_edge, progress, workers)


def hard_contacts(hard: pm.Packing) -> tuple[HardContacts, float, pm.Packing]:
    """Return forces and gaps of an exact hard packing, the residual of its forces, and its backbone.

    The forces are those of its single state of self stress in the fixed box.

    Raises
    ------
    ValueError
        If the packing has another number of states of self stress than one.

    """
    backbone, _ = pm.remove_rattlers(hard, gap_tolerance=_CLOSED)
    near = pm.find_contacts(backbone, gap_tolerance=0.1)
    gap = near.gap_c / near.contact_distance_c
    contacts = near.select(gap <= _CLOSED)
    found = pm.states_of_self_stress(backbone, contacts=contacts)
    if found.count != 1 or found.force_ck is None:
        raise ValueError(f"hard must have one state of self stress, got {found.count}")
    force = found.force_ck[:, 0] * np.sign(found.force_ck[:, 0].sum())
    count = contacts.count_n()
    buckler = count == hard.dimension + 1
    return (
        HardContacts(
            force / force.mean(),
            buckler[contacts.i_c] | buckler[contacts.j_c],
            gap[gap > _CLOSED],
            int(np.count_nonzero(buckler)),
        ),
        found.residual / float(force.mean()),
        backbone,
    )


def touch(dimension: int, particles: int, seed: int) -> dict[str, Any]:
    """Return the row of an exact hard packing, and its forces and gaps if it has one state of self stress."""
    packing = pm.random_packing(
        particles,
        dimension=dimension,
        sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction={2: 0.87, 3: 0.68}[dimension],
        seed=seed,
    )
    run = pm.jam(pm.Scene(packing, (pm.Repulsion(),)), strain="isotropic", check=False)
    asked = (dimension, particles, seed)
    hard = run.report.get("hard_packing")
    if hard is None or run.report["hard_excess_contacts"] != 0:
        return asdict(Touched(*asked, math.nan, 0, 0, 0, math.nan, math.nan))
    found, residual, backbone = hard_contacts(hard)
    row = Touched(
        *(*asked, run.report["jamming_packing_fraction"], len(found.force_c)),
        *(dimension * (backbone.particles - 1) + 1, found.bucklers, run.report["gap_error"], residual),
    )
    return asdict(row) | {"force_c": found.force_c, "on_buckler_c": found.on_buckler_c, "gap_p": found.gap_p}


def touch_all(
    folder: Path,
    *,
    dimension: int,
    particles: int,
    seeds: Sequence[int],
    progress: Progress[Touched],
    workers: int | None = None,
) -> list[Touched]:
    """Return exact hard packings of discs or spheres with one state of self stress, members with forces and gaps.

    Rows of packings with another number of states have no gap error: crystalline patches of equal particles.
    """
    wanted = itertools.product((dimension,), (particles,), seeds)
    return complete_rows(contacts_table(folder, dimension), Touched, wanted, touch, progress, workers)


def read_contacts(folder: Path, rows: Sequence[Touched]) -> list[HardContacts]:
    """Return forces and gaps of the packings that have one state of self stress."""
    found = []
    for one in rows:
        kept = kept_of(contacts_table(folder, one.dimension), one).arrays()
        if kept:
            found.append(HardContacts(kept["force_c"], kept["on_buckler_c"], kept["gap_p"], one.bucklers))
    return found


def small_exponent(values: Sequence[NDArray[np.float64]], largest: float) -> tuple[float, float, int]:
    """Return e of a density ~ x^e below `largest`, its error, and the number of values that take part.

    The maximum of the likelihood, n / sum of log(largest / x) - 1 (Hill); the error is found by leaving out packings.

    Parameters
    ----------
    values
        Those of each packing, positive.
    largest
        Up to which the density is taken to be a power law.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> parts = [rng.random(1000) ** (1 / 1.4) for _ in range(20)]  # density ~ x^0.4
    >>> exponent, error, count = small_exponent(parts, 1.0)
    >>> abs(exponent - 0.4) < 3.0 * error < 0.1, count
    (True, 20000)

    """
    logs = [np.log(largest / one[one < largest]) for one in values]
    count = np.array([len(one) for one in logs], dtype=float)
    total = np.array([one.sum() for one in logs])
    if count.sum() == 0:
        return math.nan, math.nan, 0
    exponent = count.sum() / total.sum() - 1.0
    error = math.nan
    if len(logs) > 1:
        left = (count.sum() - count) / (total.sum() - total) - 1.0
        error = math.sqrt((len(left) - 1) * float(((left - left.mean()) ** 2).mean()))
    return float(exponent), error, int(count.sum())


def exponents(found: Sequence[HardContacts]) -> list[tuple[str, float, float, int, float]]:
    """Return by name the small exponents of forces and gaps, their errors, values used, and those of mean field."""
    bucklers = [one.force_c[one.on_buckler_c] for one in found]
    extended = [one.force_c[~one.on_buckler_c] for one in found]
    every = [one.force_c for one in found]
    gaps = [one.gap_p for one in found]
    low, error, count = small_exponent(gaps, SMALL_GAP)
    return [
        ("forces on bucklers", *small_exponent(bucklers, SMALL_FORCE), LOCALIZED),
        ("other forces", *small_exponent(extended, SMALL_FORCE), EXTENDED),
        ("all forces", *small_exponent(every, SMALL_FORCE), LOCALIZED),
        ("gaps, minus", -low, error, count, GAPS),
    ]


def draw_contacts(found: Sequence[HardContacts], dimension: int, particles: int, path: Path) -> None:
    """Write the figure: cumulative distributions of forces and of gaps, with the power laws of mean field."""
    with styled_figure(path, (11.0, 4.4)) as figure:
        left, right = figure.subplots(1, 2)
        kinds = (
            ("on bucklers", [one.force_c[one.on_buckler_c] for one in found], LOCALIZED),
            ("others", [one.force_c[~one.on_buckler_c] for one in found], EXTENDED),
        )
        for number, (name, parts, theory) in enumerate(kinds):
            value = np.sort(np.concatenate(parts))
            share = np.arange(1, len(value) + 1) / len(value)
            left.plot(value, share, color=COLORS[number], linewidth=1.2, label=f"forces {name}")
            at = np.searchsorted(value, SMALL_FORCE)
            line = np.geomspace(1e-4, SMALL_FORCE, 20)
            left.plot(
                line, share[at] * (line / SMALL_FORCE) ** (1.0 + theory), color=COLORS[number], linestyle=":",
                label=f"mean field, {1.0 + theory:.3f}",
            )  # fmt: skip
        left.set(xscale="log", yscale="log", xlabel="contact force over its mean", ylabel="share of smaller forces")
        left.set_xlim(1e-4, 10.0)
        left.set_ylim(1e-6, 1.5)
        left.legend(fontsize=7.5)
        gap = np.sort(np.concatenate([one.gap_p for one in found]))
        number_below = np.arange(1, len(gap) + 1) / sum(len(one.force_c) for one in found)
        right.plot(gap, number_below, color=COLORS[2], linewidth=1.2, label="pairs that do not touch")
        at = np.searchsorted(gap, SMALL_GAP)
        line = np.geomspace(1e-6, SMALL_GAP, 20)
        right.plot(
            line, number_below[at] * (line / SMALL_GAP) ** (1.0 - GAPS), color=INK, linestyle=":",
            label=f"mean field, {1.0 - GAPS:.3f}",
        )  # fmt: skip
        right.set(xscale="log", yscale="log", xlabel="gap over contact distance", ylabel="smaller gaps per contact")
        right.set_xlim(1e-7, 0.1)
        right.legend(fontsize=7.5)
        figure.suptitle(f"{len(found)} exact hard packings of N = {particles}, d = {dimension}", fontsize=10)


INK = "#444444"


def draw_states(found: Sequence[Vibrated], folder: Path, path: Path) -> None:
    """Write the figure: density of states, rotational part and participation ratio over frequency, by aspect."""
    edges = np.logspace(-4.0, 0.8, 41)
    center = np.sqrt(edges[1:] * edges[:-1])
    with styled_figure(path, (13.2, 4.2)) as figure:
        density, rotation, participation = figure.subplots(1, 3)
        for number, aspect in enumerate(sorted({one.aspect for one in found})):
            rows = [one for one in found if one.aspect == aspect]
            parts = []
            for one in rows:
                kept = kept_of(states_table(folder, one.dimension), one).arrays()
                parts.append(np.stack([kept["frequency_m"], kept["rotation_m"], kept["participation_m"]]))
            frequency, turned, taking_part = np.concatenate(parts, axis=1)
            bin_m = np.digitize(frequency, edges) - 1
            inside = (bin_m >= 0) & (bin_m < len(center))
            count = np.bincount(bin_m[inside], minlength=len(center)).astype(float)
            style = {
                "color": COLORS[number], "marker": MARKERS[number], "markersize": 3.5, "linewidth": 1.0,
                "label": f"aspect {aspect:g}, {len(rows)} packings",
            }  # fmt: skip
            some = count > 0
            density.plot(center[some], (count / (np.diff(edges) * len(frequency)))[some], **style)
            for ax, value in ((rotation, turned), (participation, taking_part)):
                total = np.bincount(bin_m[inside], value[inside], minlength=len(center))
                ax.plot(center[some], total[some] / count[some], **style)
        density.set(xscale="log", yscale="log", xlabel="frequency", ylabel="density of states")
        rotation.set(xscale="log", xlabel="frequency", ylabel="rotational part of modes", ylim=(-0.02, 1.02))
        participation.set(xscale="log", xlabel="frequency", ylabel="participation ratio", ylim=(0.0, 0.8))
        density.legend(fontsize=7.0)
        figure.suptitle(
            f"N = {found[0].particles}, d = {found[0].dimension}, {found[0].distance:g} above jamming, masses alike",
            fontsize=10,
        )


def edge_rows(found: Sequence[Ended]) -> list[tuple[float, float, float, int]]:
    """Return for each distance the mean of omega*, its standard error and the number of packings with a plateau."""
    rows = []
    for distance in sorted({one.distance for one in found}):
        value = np.array([one.plateau_edge for one in found if one.distance == distance])
        value = value[np.isfinite(value)]
        error = float(value.std(ddof=1) / math.sqrt(len(value))) if len(value) > 1 else math.nan
        rows.append((distance, float(value.mean()) if len(value) else math.nan, error, len(value)))
    return rows


def draw_edges(found: Sequence[Ended], path: Path) -> None:
    """Write the figure: omega* over the distance to jamming, and beside it over the contacts in excess."""
    with styled_figure(path, (9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        rows = np.array([row[:3] for row in edge_rows(found)])
        left.errorbar(*rows.T[:2], rows.T[2], color=COLORS[0], marker="o", markersize=4.0, linestyle="", capsize=2.0)
        top = rows[-1]
        left.plot(
            rows[:, 0], top[1] * np.sqrt(rows[:, 0] / top[0]), color=INK, linestyle=":", label="slope 1/2"
        )  # fmt: skip
        left.set(xscale="log", yscale="log", xlabel="packing fraction above jamming", ylabel=r"$\omega^*$")
        left.legend()
        excess = [one.excess_coordination for one in found]
        edge = [one.plateau_edge for one in found]
        right.plot(excess, edge, ".", color=COLORS[1])
        right.set(xscale="log", yscale="log", xlabel=r"contacts in excess, $z - z_{iso}$", ylabel=r"$\omega^*$")
        seeds = len({one.seed for one in found})
        figure.suptitle(f"{seeds} packings of N = {found[0].particles}, d = {found[0].dimension}", fontsize=10)
