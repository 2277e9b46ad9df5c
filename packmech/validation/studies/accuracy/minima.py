"""Where the minimum lies: which share of random starts ends in the minimum that steepest descent leads to, and phi_J.

Every start is quenched by every method. Two minima are the same when their energies agree and their contact networks,
rattlers taken out, are equal. Each minimum is then followed down in pressure to its jamming point.

Two limits of strong damping are compared: drag against a background gives steepest descent, dx/dt = F; dashpots along
the contacts of touching pairs (eq. 2.3 of Schreck and O'Hern) give b R^T R v = F, which is another path.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.integrate import BDF, Radau

import packmech as pm
from packmech.measure.counting import remove_rattlers
from packmech.minimize.passes.kernels import RUNNING, STALLED, Goal
from packmech.minimize.program import Program
from packmech.result import csv_text, markdown_table
from packmech.validation.studies.rows import complete_rows
from packmech.view.figures import COLORS, styled_figure

PARTICLES, FRACTION, STARTS = 64, 0.9, 200
# of the first so many starts also the jamming point
JAMMED = 20
TOLERANCE = 1e-10
# energies of one minimum reached twice differ by rounding and the square of the residual
SAME_ENERGY = 1e-8
STEP_LIMIT = 20_000_000
REFERENCE, PAIR_LIMIT = "steepest descent, 1e-9", "dashpots, b = 1000, dt = 0.02 b"


class StiffDescent(NamedTuple):
    """dx/dt = F by one of scipy's methods for stiff equations, with the exact Hessian as a sparse Jacobian."""

    solver: Any
    tolerance: float

    def start(self, program: Program) -> _Path:
        """Return the path at its start."""
        return _Path(self, program)

    def advance(self, program: Program, goal: Goal, path: _Path, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        for _ in range(steps):
            status = path.judge(goal)
            if status != RUNNING:
                return status
            path.solver.step()
            path.steps += 1
            if path.solver.status != "running":
                return STALLED
        return path.judge(goal)


class _Path:
    """A path on its way: the solver of the differential equation, displacements in reference diameters."""

    def __init__(self, method: StiffDescent, program: Program) -> None:
        self.program, self.steps, self.force_evaluations = program, 0, 0
        self.start_nd = program.positions()
        self.length = program.scene.packing.reference_diameter
        self.force = program.scene.energy_scale / self.length
        self.solver = method.solver(
            self._rate,
            0.0,
            np.zeros(self.start_nd.size),
            np.inf,
            rtol=method.tolerance,
            atol=method.tolerance,
            jac=self._slope,
        )

    def judge(self, goal: Goal) -> int:
        """Return how the place that the solver has reached stands to the goal."""
        self.force_evaluations += 1
        self.program.place(self._place(self.solver.y))
        return self.program.judge(goal)[0]

    def _place(self, moved_x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self.start_nd + self.length * moved_x.reshape(self.start_nd.shape))

    def _rate(self, time: float, moved_x: NDArray[np.float64]) -> NDArray[np.float64]:
        self.force_evaluations += 1
        return np.asarray(self.program.evaluate(self._place(moved_x)).force_nd.ravel() / self.force)

    def _slope(self, time: float, moved_x: NDArray[np.float64]) -> sp.csc_matrix:
        scene = self.program.scene
        here = scene.replace(packing=scene.packing.replace(position_nd=self._place(moved_x)))
        # scipy's solvers know sparse matrices only, no sparse arrays
        return sp.csc_matrix(pm.hessian(here, "none") * (-self.length / self.force))


class Method(NamedTuple):
    """A method by its name, its damping if it has one, and how many starts it takes on."""

    name: str
    make: Any
    damping: float = math.nan
    starts: int = STARTS


def dashpots(damping: float) -> Method:
    """Return damped dynamics with dashpots of this strength."""
    return Method(f"dashpots, b = {damping:g}", pm.DampedDynamics(damping=damping), damping)


METHODS = (
    Method(REFERENCE, pm.SteepestDescent(1e-9)),
    Method("FIRE", pm.Fire()),
    Method("FIRE 2.0", pm.Fire2()),
    Method("conjugate gradient", pm.ConjugateGradient()),
    Method("L-BFGS", pm.LBFGS()),
    Method("default route", None),
    Method("gradient descent, step 0.8", pm.GradientDescent()),
    dashpots(0.1),
    dashpots(1.0),
    dashpots(10.0),
    dashpots(100.0),
    Method("steepest descent, 1e-6", pm.SteepestDescent(1e-6)),
    dashpots(0.3),
    dashpots(3.0),
    dashpots(30.0),
    dashpots(1000.0),
    Method("gradient descent, step 0.1", pm.GradientDescent(step=0.1), starts=50),
    Method("dashpots, b = 1, dt = 0.02", pm.DampedDynamics(damping=1.0, dt=0.02), 1.0, 30),
    Method(PAIR_LIMIT, pm.DampedDynamics(damping=1000.0, dt=0.02), 1000.0, 30),
    Method("scipy BDF, 1e-8", StiffDescent(BDF, 1e-8), starts=8),
    Method("scipy Radau, 1e-6", StiffDescent(Radau, 1e-6), starts=2),
)
# the first so many of them take on all starts before the others begin
_USUAL = 11
ROWS, ONSETS = "minima-starts.csv", "minima-onsets.csv"
# the ends of the errors of a share: one standard deviation
_Z = 1.0


@dataclass(frozen=True)
class Ended:
    """Where one method took one start: energy, network as a checksum, and what it cost."""

    method: int
    seed: int
    converged: int
    energy: float
    network: int
    contacts: int
    rattlers: int
    evaluations: int
    seconds: float

    @property
    def settings(self) -> tuple[int, int]:
        """What it was asked for."""
        return (self.method, self.seed)

    def same_as(self, other: Ended) -> bool:
        """Return whether both ended in one minimum."""
        near = abs(self.energy - other.energy) <= SAME_ENERGY * max(abs(self.energy), abs(other.energy))
        return bool(self.converged and other.converged and near and self.network == other.network)


@dataclass(frozen=True)
class Onset:
    """The packing fraction at which the minimum that a method took a start to, followed down, is jammed."""

    method: int
    seed: int
    packing_fraction: float

    @property
    def settings(self) -> tuple[int, int]:
        """What it was asked for."""
        return (self.method, self.seed)


def start(seed: int) -> pm.Scene:
    """Return a random start: discs 50:50, 1:1.4, V = overlap^2 / 2, in a square box."""
    packing = pm.random_packing(
        PARTICLES, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=FRACTION, seed=seed
    )
    return pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),))


def quenched(method: int, seed: int) -> tuple[pm.Scene, pm.Run]:
    """Return where a method, by its number, takes a start."""
    scene = start(seed)
    chosen = {} if METHODS[method].make is None else {"method": METHODS[method].make, "step_limit": STEP_LIMIT}
    run = pm.quench(scene, force_tolerance=TOLERANCE, check=False, **chosen)
    return scene.replace(packing=run.packing), run


def end(method: int, seed: int) -> Ended:
    """Return the row of where a method takes a start."""
    scene, run = quenched(method, seed)
    backbone, index = remove_rattlers(run.packing)
    contacts = pm.find_contacts(backbone)
    pairs = np.sort(np.stack([index[contacts.i_c], index[contacts.j_c]], axis=1), axis=1)
    network = zlib.crc32(np.ascontiguousarray(pairs[np.lexsort(pairs.T)], dtype="<i8").tobytes())
    return Ended(
        *(method, seed, int(run.ok), pm.energy(scene), network, len(contacts)),
        *(PARTICLES - backbone.particles, run.force_evaluations, run.seconds),
    )


def onset(method: int, seed: int) -> Onset:
    """Return the jamming point of where a method takes a start; nan where it cannot be followed."""
    scene, run = quenched(method, seed)
    jammed = pm.jam(scene, strain="isotropic", check=False) if run.ok else run
    return Onset(method, seed, jammed.report["jamming_packing_fraction"] if jammed.ok else math.nan)


def share_and_error(hits: int, of: int) -> tuple[float, float]:
    """Return a share and its binomial error, half of Wilson's interval of one standard deviation.

    Examples
    --------
    >>> share, error = share_and_error(50, 200)
    >>> round(share, 3), round(error, 3)
    (0.25, 0.031)

    """
    share = hits / of
    half = _Z / (1.0 + _Z**2 / of) * math.sqrt(share * (1.0 - share) / of + _Z**2 / (4.0 * of**2))
    return share, half


@dataclass(frozen=True)
class Share:
    """How one method compares with the two limits over its starts; nan where it has none in common with one."""

    name: str
    damping: float
    starts: int
    failed: int
    same: float
    same_error: float
    pair_limit: float
    pair_limit_error: float
    energy: float
    energy_error: float
    onset: float
    onset_error: float
    moved: float
    moved_scatter: float
    evaluations: float
    seconds: float


@dataclass(frozen=True)
class Minima:
    """The table: a line a method, and the shares in which any two agree."""

    title: str
    shares: tuple[Share, ...]
    agreement_mm: NDArray[np.float64]

    def to_csv(self) -> str:
        """Return the lines, as comma-separated values."""
        return csv_text(
            ("method", "damping", "starts", "failed", "same minimum", "+-", "same as the pair limit", "+-",
             "energy per particle", "+-", "jamming packing fraction", "+-",
             "mean difference of it where the minimum differs", "standard deviation of it",
             "median force evaluations", "median CPU s"),
            ([one.name, *(f"{x:.6g}" for x in _numbers(one))] for one in self.shares),
        )  # fmt: skip

    def to_markdown(self) -> str:
        """Return the table in Markdown."""
        rows = []
        for one in self.shares:
            rows.append(
                (
                    one.name,
                    f"{one.starts}",
                    f"{one.failed}",
                    f"{100 * one.same:.1f} +- {100 * one.same_error:.1f}",
                    "-"
                    if math.isnan(one.pair_limit)
                    else f"{100 * one.pair_limit:.0f} +- {100 * one.pair_limit_error:.0f}",
                    f"{1e3 * one.energy:.4f} +- {1e3 * one.energy_error:.4f}",
                    "-" if math.isnan(one.onset) else f"{one.onset:.5f} +- {one.onset_error:.5f}",
                    "-" if math.isnan(one.moved) else f"{1e3 * one.moved:+.2f}, sd {1e3 * one.moved_scatter:.2f}",
                    f"{one.evaluations:.0f}",
                    f"{one.seconds:.3f}",
                )
            )
        head = (
            "method", "starts", "failed", "same minimum, %", "as dashpots' limit, %", "1000 E / N", "phi_J",
            "1000 x difference of phi_J where minima differ", "force evaluations", "CPU s",
        )  # fmt: skip
        return markdown_table(head, rows)

    def save_figure(self, path: str | Path) -> None:
        """Write the picture: shares over damping and by method, phi_J, and how any two methods agree."""
        draw(self, Path(path))


def _numbers(one: Share) -> list[float]:
    return [float(getattr(one, name)) for name in Share.__dataclass_fields__ if name != "name"]


def _mean(values: Sequence[float]) -> tuple[float, float]:
    finite = np.array([x for x in values if math.isfinite(x)])
    if len(finite) < 2:
        return math.nan, math.nan
    return float(finite.mean()), float(finite.std(ddof=1) / math.sqrt(len(finite)))


def compare(found: Sequence[Ended], onsets: Sequence[Onset] = ()) -> Minima:
    """Return the table of what the methods found."""
    fraction = {(one.method, one.seed): one.packing_fraction for one in onsets}
    by = {(one.method, one.seed): one for one in found}
    numbers = sorted({one.method for one in found})
    names = [METHODS[k].name for k in numbers]
    reference, limit = numbers[names.index(REFERENCE)], names.index(PAIR_LIMIT) if PAIR_LIMIT in names else None
    agreement = np.full((len(numbers), len(numbers)), math.nan)
    shares = []
    for a, k in enumerate(numbers):
        mine = [one for one in found if one.method == k]
        for b, other in enumerate(numbers):
            common = [(one, by[other, one.seed]) for one in mine if (other, one.seed) in by]
            if common:
                agreement[a, b] = sum(one.same_as(two) for one, two in common) / len(common)
        pairs = [(one, by[reference, one.seed]) for one in mine if (reference, one.seed) in by]
        hits = sum(one.same_as(two) for one, two in pairs)
        limit_share = (math.nan, math.nan)
        if limit is not None:
            common = [(one, by[numbers[limit], one.seed]) for one in mine if (numbers[limit], one.seed) in by]
            limit_share = share_and_error(sum(one.same_as(two) for one, two in common), len(common))
        missing = math.nan
        moved = np.array(
            [
                fraction.get(one.settings, missing) - fraction.get(two.settings, missing)
                for one, two in pairs
                if not one.same_as(two)
            ]
        )
        moved = moved[np.isfinite(moved)]
        shares.append(
            Share(
                METHODS[k].name,
                METHODS[k].damping,
                len(mine),
                sum(not one.converged for one in mine),
                *share_and_error(hits, len(pairs)),
                *limit_share,
                *_mean([one.energy / PARTICLES for one in mine]),
                *_mean([fraction.get(one.settings, missing) for one in mine]),
                float(moved.mean()) if len(moved) > 1 else math.nan,
                float(moved.std(ddof=1)) if len(moved) > 1 else math.nan,
                float(np.median([one.evaluations for one in mine])),
                float(np.median([one.seconds for one in mine])),
            )
        )
    title = f"Where the minimum lies: N = {PARTICLES} bidisperse discs quenched at packing fraction {FRACTION:g}"
    return Minima(title, tuple(shares), agreement)


def describe(table: Minima) -> str:
    """Return what the table shows, every figure taken from it."""
    by = {one.name: one for one in table.shares}
    best = max((one for one in table.shares if one.name in _FAST), key=lambda one: one.same)
    strong = [one for one in table.shares if one.name.startswith("dashpots") and one.damping >= 100.0]
    lines = [
        f"Random starts at packing fraction {FRACTION:g} (discs 50:50, 1:1.4, V = overlap^2 / 2, square box), each",
        f"quenched to a net force of {TOLERANCE:.0e} of the mean contact force. The minimum is the same as that of",
        "steepest descent where energies agree to 1e-8 and the contact networks without rattlers are equal. Errors of",
        "shares are binomial (Wilson, one standard deviation). phi_J: each minimum followed down in pressure.",
        "",
    ]
    for name in ("steepest descent, 1e-6", "scipy BDF, 1e-8", "scipy Radau, 1e-6"):
        if name in by:
            one = by[name]
            lines.append(
                f"The reference, {REFERENCE}, is confirmed by {name} in {round(one.same * one.starts)} of {one.starts} "
                "starts."
            )
    lines.append(
        f"Of the usual minimizers {best.name} ends in that minimum most often, in {100 * best.same:.1f} +- "
        f"{100 * best.same_error:.1f} %."
    )
    for one in strong:
        lines.append(
            f"{one.name} (b in sqrt(m k)): {100 * one.same:.1f} +- {100 * one.same_error:.1f} % as steepest descent."
        )
    lines += [
        "Strong dashpots along contacts do not lead to steepest descent: b R^T R v = F relaxes every contact at one",
        "rate, soft modes as fast as stiff ones; dx/dt = F is the limit of drag against a background.",
    ]
    return "\n".join(lines)


_FAST = ("FIRE", "FIRE 2.0", "conjugate gradient", "L-BFGS", "default route")


def draw(table: Minima, path: Path) -> None:
    """Write the picture of the table."""
    shares = table.shares
    damped = [one for one in shares if one.name == f"dashpots, b = {one.damping:g}"]
    jammed = any(math.isfinite(one.onset) for one in shares)
    with styled_figure(path, (13.2, 9.4 if jammed else 5.2)) as figure:
        axes = figure.subplots(2 if jammed else 1, 2, width_ratios=(1.0, 1.25), squeeze=False)
        upper, matrix = axes[0]
        b = [one.damping for one in damped]
        for name, error, label, color in (
            ("same", "same_error", "as steepest descent", COLORS[0]),
            ("pair_limit", "pair_limit_error", "as strong dashpots, small steps", COLORS[1]),
        ):
            if all(math.isnan(getattr(one, name)) for one in damped):
                continue
            upper.errorbar(
                b, [getattr(one, name) for one in damped], [getattr(one, error) for one in damped],
                color=color, marker="o", markersize=4.0, capsize=2.0, label=label,
            )  # fmt: skip
        for number, one in enumerate(one for one in shares if one.name in _FAST[:4]):
            upper.axhline(one.same, color=COLORS[2 + number], linewidth=1.0, linestyle="--", label=one.name)
        upper.set(xscale="log", xlabel="damping of the contacts, $b/\\sqrt{mk}$", ylabel="share of the same minimum")
        upper.set_ylim(0.0, 1.0)
        upper.legend(fontsize=7.0)
        count = len(shares)
        picture = matrix.imshow(table.agreement_mm, vmin=0.0, vmax=1.0, cmap="viridis")
        names = [one.name for one in shares]
        matrix.set_xticks(range(count), names, rotation=90, fontsize=6.0)
        matrix.set_yticks(range(count), names, fontsize=6.0)
        matrix.set_title("share of starts in which two methods agree", fontsize=9)
        matrix.grid(visible=False)
        figure.colorbar(picture, ax=matrix)
        if jammed:
            _draw_onsets(axes[1], shares)
        figure.suptitle(table.title, fontsize=10)


def _draw_onsets(axes: Any, shares: Sequence[Share]) -> None:
    """Draw the packing fractions at jamming, by method, and over the energy that the quench left."""
    onset, lower = axes
    names = [one.name for one in shares]
    count = len(shares)
    place = np.arange(count)
    onset.errorbar(
        [one.onset for one in shares], place, xerr=[one.onset_error for one in shares], color=COLORS[0],
        marker="o", markersize=4.0, linestyle="", capsize=2.0,
    )  # fmt: skip
    onset.set_yticks(place, names, fontsize=6.0)
    onset.invert_yaxis()
    onset.set(xlabel="packing fraction at jamming, mean over starts")
    lower.errorbar(
        [one.energy for one in shares], [one.onset for one in shares],
        [one.onset_error for one in shares], [one.energy_error for one in shares],
        color=COLORS[2], marker="o", markersize=4.0, linestyle="", capsize=2.0,
    )  # fmt: skip
    lower.set(xlabel="energy per particle at the quench", ylabel="packing fraction at jamming")


def run(progress: Callable[[str, float], None], folder: Path, workers: int | None = None) -> tuple[Minima, str]:
    """Run the study, resuming what the folder holds; return its table and what it shows in words."""
    usual = [(k, seed) for seed in range(STARTS) for k in range(_USUAL)]
    further = [(k, seed) for k in range(_USUAL, len(METHODS)) for seed in range(METHODS[k].starts)]
    wanted = usual + further
    jammed = [(k, seed) for seed in range(JAMMED) for k, one in enumerate(METHODS) if one.starts == STARTS]

    def report(done: int, of: int, last: Ended | Onset | None) -> None:
        if last is not None:
            progress(METHODS[last.method].name, float(last.seed))

    found = complete_rows(folder / ROWS, Ended, wanted, end, report, workers)
    onsets = complete_rows(folder / ONSETS, Onset, jammed, onset, report, workers)
    table = compare(found, onsets)
    return table, describe(table)
