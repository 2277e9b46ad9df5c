"""Structure of jammed packings: order and correlation lengths against disorder, and the spectral density of sizes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.ensemble.callers import complete
from packmech.measure.scattering import average_shells
from packmech.validation.studies.families import jammed_discs
from packmech.validation.studies.rows import MEMBERS, Progress, complete_rows, kept_of
from packmech.validation.studies.shapes import mean_and_error
from packmech.view.figures import COLORS, MARKERS, styled_figure

ORDER = "order.csv"
# kinds of disorder: sizes of discs (largest over smallest), aspects of ellipses and of dimers
DISCS, ELLIPSES, DIMERS = 0, 1, 2
KINDS = {DISCS: "discs, sizes", ELLIPSES: "ellipses, aspect", DIMERS: "dimers, aspect"}
RATIOS = (1.02, 1.05, 1.1, 1.15, 1.2, 1.3, 1.4, 1.5)
ASPECTS = (1.02, 1.05, 1.1, 1.2, 1.3, 1.4, 1.6)
# of these there are correlations
SHOWN = (1.1, 1.2, 1.3, 1.4, 1.5, 1.6)
# of these packings of dimers are drawn
PICTURED = (1.05, 1.1, 1.2, 1.3, 1.4, 1.6)
PRESSURE = 1e-6
# dilute starts of shapes, which are compressed
_START = 0.6
# a spectrum's packing: first packing fraction, largest number of quenches, net force over mean contact force of each
SPECTRAL_PRESSURE = 1e-3
_SPECTRAL_START, _SPECTRAL_STEPS, _SPECTRAL_TOLERANCE = 0.9, 12, 1e-4
# bins and reach of correlations, in mean diameters; maxima nearer than this are those of contacts
_WIDTH, _REACH, _FAR, _APART = 0.05, 14.0, 1.5, 0.4


@dataclass(frozen=True)
class Ordered:
    """Order of one jammed packing of a kind of disorder."""

    kind: int
    particles: int
    disorder: float
    pressure: float
    seed: int
    packing_fraction: float
    coordination_number: float
    rattlers: int
    global_order: float
    local_order: float
    nematic_order: float
    converged: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:5])


def packing_of(folder: Path, row: Ordered) -> pm.Packing:
    """Return the packing of a row."""
    return kept_of(folder / ORDER, row).packing()


def jam_disordered(kind: int, particles: int, disorder: float, pressure: float, seed: int) -> dict[str, Any]:
    """Return the row of a packing of one kind and degree of disorder in a square box, and the packing."""
    given: dict[str, Any] = {"dimension": 2, "seed": seed, "packing_fraction": 0.9 if kind == DISCS else _START}
    given["sizes"] = pm.Uniform(disorder) if kind == DISCS else pm.Monodisperse()
    if kind == ELLIPSES:
        given["shapes"] = pm.Ellipses(disorder)
    elif kind == DIMERS:
        # length over width is 1 + distance of the beads / width
        given["shapes"] = pm.Dimer(disorder - 1.0)
    scene = pm.Scene(pm.random_packing(particles, **given), (pm.Repulsion(),))
    run = pm.jam(scene, pressure=pressure, strain="isotropic", check=False)
    bonds = pm.bond_orientational_order(run.packing, 6)
    report = run.report
    row = Ordered(
        *(kind, particles, disorder, pressure, seed),
        report["packing_fraction"],
        2.0 * report["contacts"] / max(particles - report["rattlers"], 1),
        report["rattlers"],
        bonds.global_order,
        bonds.local_order,
        math.nan if kind == DISCS else float(pm.nematic_order(run.packing)),
        int(run.ok),
        run.seconds,
    )
    return asdict(row) | {"packing": run.packing}


def jam_all(
    folder: Path,
    *,
    particles: int,
    kinds: Sequence[int],
    seeds: Sequence[int],
    pressure: float,
    progress: Progress[Ordered],
    workers: int | None = None,
) -> list[Ordered]:
    """Return jammed packings of all kinds of disorder in square boxes, each a member with its packing."""
    wanted = [
        (kind, particles, disorder, pressure, seed)
        for kind in kinds
        for seed, disorder in itertools.product(seeds, RATIOS if kind == DISCS else ASPECTS)
    ]
    return complete_rows(folder / ORDER, Ordered, wanted, jam_disordered, progress, workers)


@dataclass(frozen=True, eq=False)
class Correlated:
    """Correlations of packings of one kind and degree of disorder together: psi_6 and g - 1, with their lengths."""

    kind: int
    disorder: float
    r_b: NDArray[np.float64]
    value_b: NDArray[np.float64]
    bond_length: pm.CorrelationLength
    pair_length: pm.CorrelationLength


def correlate(folder: Path, rows: Sequence[Ordered]) -> Correlated:
    """Return the correlations of packings of a kind and degree of disorder, pooled; distances in mean diameters.

    Noise is twice the standard error over the packings, averaged over a diameter, or of the pairs if that is more:
    without it lines go through maxima of noise, and lengths are those of the box. Correlations of psi_6, less those of
    its mean, are taken with their sign: beyond the domains they are negative, because they add up to nothing over the
    box, and do not decay.
    """
    packings = [packing_of(folder, one) for one in rows]
    # up to half the smallest box
    half = min(0.5 * float(packing.box.reduced()[0].height_d.min()) for packing in packings)
    bins = math.floor(min(_REACH, half) / _WIDTH)
    reach = bins * _WIDTH
    counts, values, connected, excess = [], [], [], []
    for packing in packings:
        psi = pm.bond_orientational_order(packing, 6).psi_n
        one = pm.correlation_function(packing, psi, r_max=reach, bins=bins)
        counts.append(one.count_b)
        values.append(np.nan_to_num(one.value_b))
        connected.append(values[-1] - one.mean_square)
        excess.append(pm.pair_distribution(packing, r_max=reach, bins=bins).g_b - 1.0)
    count_b = np.sum(counts, axis=0)
    # averages over pairs; the number of pairs is what g counts itself
    pairs_pb, alike_pb = np.array(counts) / np.maximum(count_b, 1), np.full((len(rows), bins), 1.0 / len(rows))
    window = np.ones(round(1.0 / _WIDTH))
    covered_b = np.convolve(np.ones(bins), window, "same")

    def length(value_pb: NDArray[np.float64], weight_pb: NDArray[np.float64]) -> pm.CorrelationLength:
        mean_b = (weight_pb * value_pb).sum(axis=0)
        square_b = (weight_pb * (value_pb - mean_b) ** 2).sum(axis=0) / max(len(rows) - 1, 1)
        spread_b = 2.0 * np.sqrt(np.convolve(square_b, window, "same") / covered_b)
        noise_b = np.maximum(spread_b, 2.0 / np.sqrt(np.maximum(count_b, 1.0)))
        return pm.correlation_length(one.r_b, mean_b, count_b, noise_b=noise_b, r_min=_FAR, separation=_APART)

    value_b = np.abs((pairs_pb * np.array(values)).sum(axis=0))
    lengths = length(np.array(connected), pairs_pb), length(np.array(excess), alike_pb)
    return Correlated(rows[0].kind, rows[0].disorder, one.r_b, value_b, *lengths)


def draw_order(found: Sequence[Ordered], correlated: Sequence[Correlated], folder: Path, path: Path) -> None:
    """Write the figure: order over disorder, correlations, their maxima and lengths, numbers of contacts."""
    with styled_figure(path, (14.0, 8.0)) as figure:
        axes = figure.subplots(2, 3).ravel()
        for number, kind in enumerate(sorted({one.kind for one in found})):
            mine = [one for one in found if one.kind == kind and one.converged]
            x = sorted({one.disorder for one in mine})
            for name, style in (("global_order", "-"), ("local_order", ":")):
                rows = [mean_and_error([getattr(one, name) for one in mine if one.disorder == each]) for each in x]
                mean, error = np.array(rows).T
                seeds = len({one.seed for one in mine})
                label = f"{KINDS[kind]}, {seeds} packings of {mine[0].particles}" if style == "-" else None
                axes[0].errorbar(
                    x, mean, error, linestyle=style, label=label, color=COLORS[number], marker=MARKERS[number],
                    markersize=4.0, capsize=2.0,
                )  # fmt: skip
        axes[0].set(xlabel="largest over smallest diameter, or aspect", ylabel="|psi_6|, global and (dotted) local")
        axes[0].legend(fontsize=8.0)
        discs = [one for one in correlated if one.kind == DISCS]
        panels = (
            ("value_b", "|<psi_6(r) psi_6*(0)>|"),
            ("bond_length", "maxima of C(r)"),
            ("pair_length", "maxima of g(r) - 1"),
        )
        for ax, (name, words) in zip(axes[1:4], panels, strict=True):
            for number, one in enumerate(discs):
                color = COLORS[number % len(COLORS)]
                if name == "value_b":
                    ax.plot(one.r_b, one.value_b, color=color, linewidth=0.8, label=f"ratio {one.disorder:g}")
                    continue
                line = getattr(one, name)
                ax.plot(line.r_m, line.value_m, MARKERS[number % len(MARKERS)], color=color, markersize=3.5)
                if math.isfinite(line.length):
                    ax.plot(line.r_m, line.amplitude * np.exp(-line.r_m / line.length), color=color, linewidth=0.9)
            ax.set(yscale="log", xlabel="distance [mean diameter]", ylabel=words, xlim=(0.0, _REACH))
        axes[1].set(ylim=(1e-3, 1.0))
        axes[1].legend(fontsize=8.0)
        for number, kind in enumerate(sorted({one.kind for one in correlated})):
            alike = [one for one in correlated if one.kind == kind]
            for name, style, words in (("bond_length", "--", "psi_6"), ("pair_length", "-", "g - 1")):
                lines = [getattr(one, name) for one in alike]
                axes[4].errorbar(
                    [one.disorder for one in alike], [one.length for one in lines], [one.error for one in lines],
                    label=f"{KINDS[kind]}, {words}", color=COLORS[number], linestyle=style, marker=MARKERS[number],
                    markersize=4.0, capsize=2.0,
                )  # fmt: skip
        axes[4].set(xlabel="largest over smallest diameter, or aspect", ylabel="correlation length [mean diameter]")
        axes[4].legend(fontsize=8.0, handlelength=3.5)
        _draw_numbers(axes[5], found, folder)
        figure.suptitle(f"Jammed packings at pressure {found[0].pressure:g} in square boxes", fontsize=10)


def _draw_numbers(ax: Any, found: Sequence[Ordered], folder: Path) -> None:
    """Draw the shares of particles with 3, 4, ... contacts for discs of the ratio 1.4."""
    total = np.zeros(16)
    for one in found:
        if one.kind == DISCS and one.disorder == 1.4:
            count = pm.contact_statistics(packing_of(folder, one)).count_z
            total[: len(count)] += count
    if total.any():
        top = int(np.flatnonzero(total)[-1])
        ax.bar(np.arange(top + 1), total[: top + 1] / total.sum(), color=COLORS[0])
    ax.set(xlabel="contacts of a disc, ratio 1.4, rattlers left out", ylabel="share", xlim=(1.5, 7.5))


def bidisperse_packing(particles: int, seed: int) -> pm.Packing:
    """Return a jammed packing of discs 1:1.4 in halves."""
    return jammed_discs(particles, seed).packing


def contact_numbers(
    folder: Path,
    *,
    particles: int,
    seeds: Sequence[int],
    progress: Callable[[int, int], None],
    workers: int | None = None,
) -> NDArray[np.int64]:
    """Return how many discs of jammed packings, each a member, have 0, 1, 2, ... contacts.

    Rattlers have none, and contacts of the others with them do not count.
    """
    members = complete(
        bidisperse_packing,
        [{"particles": particles, "seed": one} for one in seeds],
        folder / MEMBERS / "contacts",
        workers=workers,
        progress=lambda done, of, number, member: progress(done, of),
    )
    total = np.zeros(16, dtype=np.int64)
    for one in members:
        found = pm.contact_statistics(one.packing())
        total[: len(found.count_z)] += found.count_z
        total[0] += particles - int(found.count_z.sum())
    return total[: int(np.flatnonzero(total)[-1]) + 1]


def draw_contact_numbers(count_z: NDArray[np.int64], particles: int, path: Path) -> None:
    """Write the figure: shares of discs with so many contacts, figure 2.20 of Schreck and O'Hern."""
    with styled_figure(path, (5.4, 3.8)) as figure:
        ax = figure.subplots()
        share = count_z / count_z.sum()
        number = np.arange(len(count_z))
        ax.set_axisbelow(True)
        ax.bar(number, share, color=["#b0b0b0" if one == 0 else COLORS[0] for one in number])
        ax.errorbar(number, share, np.sqrt(share * (1.0 - share) / count_z.sum()), fmt="none", color="#404040")
        mean = float((number * count_z)[1:].sum() / count_z[1:].sum())
        ax.set(xlabel="contacts of a disc (gray: rattlers)", ylabel="share of the discs")
        ax.set_title(
            f"{count_z.sum() // particles} packings of {particles} discs 1:1.4; mean without rattlers {mean:.3f}",
            fontsize=9,
        )


def draw_dimers(found: Sequence[Ordered], folder: Path, path: Path) -> None:
    """Write the figure: one packing of dimers at each of six aspects, figure 2.26 of Schreck and O'Hern."""
    first = {one.disorder: one for one in reversed(found) if one.kind == DIMERS and one.converged}
    chosen = [first[aspect] for aspect in sorted(first) if aspect in PICTURED]
    with styled_figure(path, (6.6, 4.8)) as figure:
        for ax, one in zip(figure.subplots(2, 3).ravel(), chosen, strict=False):
            packing = packing_of(folder, one)
            # bodies alone, without lines between those that touch
            none = pm.find_shape_contacts(packing, gap_tolerance=-0.9)
            ax.imshow(pm.draw_frame(packing, contacts=none, rattler_n=pm.find_rattlers(packing), size=(300, 300)))
            ax.set_axis_off()
            ax.set_title(f"aspect {one.disorder:g}, global |psi_6| = {one.global_order:.2f}", fontsize=8)
        figure.suptitle(
            f"Jammed packings of {chosen[0].particles} equal dimers, pressure {chosen[0].pressure:g}", fontsize=10
        )


def spectral_packing(particles: int, seed: int, pressure: float) -> pm.Packing:
    """Return a jammed packing of discs 1:1.4 in halves, rattlers included, in a square box.

    Quenched at packing fractions .9 and .88, and from there on where a line through the last two pressures leads, down
    to the pressure within a tenth: the exact hard packing of so many is out of reach, and not asked for.
    """
    fraction = _SPECTRAL_START
    packing = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=fraction, seed=seed
    )
    before: tuple[float, float] | None = None
    for _ in range(_SPECTRAL_STEPS):
        scene = pm.Scene(pm.at_packing_fraction(packing, fraction), (pm.Repulsion(),))
        packing = pm.quench(scene, force_tolerance=_SPECTRAL_TOLERANCE).packing
        reached = pm.pressure(scene.replace(packing=packing))
        if abs(reached - pressure) < 0.1 * pressure:
            return packing
        further = fraction - 0.02
        if before is not None and before[1] != reached:
            further = fraction - (reached - pressure) * (before[0] - fraction) / (before[1] - reached)
        before, fraction = (fraction, reached), further
    raise RuntimeError(f"{particles} discs from seed {seed} do not come to the pressure {pressure:g}, got {reached:g}")


def spectral_packings(
    folder: Path,
    particles: int,
    seeds: Sequence[int],
    pressure: float,
    progress: Callable[[int, int], None],
    workers: int | None = None,
) -> list[pm.Packing]:
    """Return packings of several seeds (`spectral_packing`), each a member."""
    found = complete(
        spectral_packing,
        [{"particles": particles, "seed": one, "pressure": pressure} for one in seeds],
        folder / MEMBERS / "spectrum",
        workers=workers,
        progress=lambda done, of, number, member: progress(done, of),
    )
    return [one.packing() for one in found]


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Spectral density of what particles fill and structure factor of their centers, over shells; k in 1/diameter."""

    particles: int
    packings: int
    diameter: float
    filled: pm.ShellAverage
    centers: pm.ShellAverage

    def to_csv(self) -> str:
        """Return the shells as comma-separated values."""
        lines = ["k_diameter,wave_vectors,spectral_density,error,structure_factor,structure_factor_error"]
        one, other = self.filled, self.centers
        for row in zip(one.k_b, one.count_b, one.value_b, one.error_b, other.value_b, other.error_b, strict=True):
            lines.append(f"{row[0]:.6g},{row[1]}," + ",".join(f"{value:.6g}" for value in row[2:]))
        return "\n".join(lines) + "\n"


def measure_spectrum(packings: Sequence[pm.Packing], *, k_max: float = 12.0, width: float = 0.04) -> Spectrum:
    """Return the spectrum of packings of one box, pooled: k and areas in units of the mean diameter."""
    diameter = float(packings[0].diameter_n.mean())
    filled, centers, every = [], [], []
    for packing in packings:
        index = pm.wave_indices(packing.box, k_max / diameter, half=True)
        filled.append(pm.spectral_density(packing, index) / diameter**2)
        centers.append(pm.structure_factor(packing, index))
        every.append(np.linalg.norm(pm.wave_vectors(packing.box, index), axis=1) * diameter)
    # boxes differ a little in size, so that shells are of the length in diameters
    length = np.concatenate(every)
    shells = [average_shells(length, np.concatenate(values), width) for values in (filled, centers)]
    return Spectrum(packings[0].particles, len(packings), diameter, *shells)


def draw_spectrum(found: Spectrum, fit: pm.SpectrumFit, path: Path) -> None:
    """Write the figure: spectral density and structure factor over the wave number, and the power law in its window."""
    with styled_figure(path, (9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        shells = found.filled
        left.errorbar(shells.k_b, shells.value_b, shells.error_b, color=COLORS[0], linewidth=0.8, label="measured")
        k = np.array([fit.k_min, fit.k_max])
        left.plot(
            k, fit.amplitude * k**fit.exponent, color=COLORS[1],
            label=f"exponent {fit.exponent:.3f} +- {fit.exponent_error:.3f}",
        )  # fmt: skip
        left.axvspan(shells.k_b[0], fit.k_min, color="#f0f0f0", label="no claim")
        left.set(xscale="log", yscale="log", xlabel="k d", ylabel="spectral density of the discs / d^2")
        left.legend(fontsize=8.0)
        right.plot(shells.k_b, found.centers.value_b, color=COLORS[2], linewidth=0.8)
        right.set(xlabel="k d", ylabel="S(k) of the centers")
        figure.suptitle(
            f"{found.packings} jammed packing(s) of {found.particles} discs 1:1.4, rattlers included; d mean diameter",
            fontsize=10,
        )
