"""Packings that are mechanically stable beside ones that are only locally stable (Schreck and O'Hern, figure 2.15).

Discs of one size in a square periodic box. Mechanically stable packings are what random starts jam to. Locally stable
ones are what is left of random starts when discs move one at a time, each to the middle of the cage of the others: the
smallest distance grows until no disc can make it larger by itself. That is the local jamming of Torquato and Stillinger
(J. Phys. Chem. B 105, 11849 (2001)), and every disc without room has three contacts around it. With seven discs and
eleven contacts, one collective motion changes no contact to first order. Straight along it distances only grow, so that
it costs no energy until discs meet that did not touch.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.jamming.verdict import JAMMED, NOT_JAMMED
from packmech.view.figures import COLORS, styled_figure

DISCS = 7
# how far packings are drawn along their lowest mode, and where energies are taken [diameter]
SHOWN = 0.2
AMPLITUDES = tuple(float(x) for x in np.logspace(-5.0, -0.5, 46))
MECHANICAL, LOCAL = "mechanically stable", "locally stable"
# packing fractions that differ by less are nearly the same [1]
_SIMILAR = 0.01
_START = 0.6
# quenched deeper, nearly all starts end in the densest packing
_METHOD = pm.HardVertex(start_packing_fraction=0.74)
_PRESSURE = 1e-9
# all nine cells that a disc can reach
_CELLS = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])
_SWEEPS = 2000
# neighbors nearer than this, over the smallest distance, touch; the next must be farther by more [1]
_TOUCHING, _APART = 1e-6, 1e-4
# discs are smaller than their distances by this, which is more than rounding makes of a distance [1]
_ROOM = 1e-13


@dataclass(frozen=True, eq=False)
class Found:
    """A packing that a search ended in, and what the verdict says of it.

    `search` is what was looked for, and `fits` whether it is that: without rattlers and, if only locally stable, with a
    floppy mode. `local` and `collective` are answers of the verdict.
    """

    search: str
    fits: bool
    seed: int
    packing_fraction: float
    contacts: int
    rattlers: int
    floppy_modes: int
    states_of_self_stress: int
    local: str
    collective: str
    scene: pm.Scene

    @property
    def mode_nd(self) -> NDArray[np.float64]:
        """The (N, 2) lowest mode of the dynamical matrix, of unit length and the sign that costs less energy [1]."""
        mode = pm.normal_modes(self.scene, count=1, rattlers="keep").displacement_mnd[0]
        both = [self.energy_change(sign * mode, (SHOWN,))[0] for sign in (1.0, -1.0)]
        return np.asarray(mode if both[0] <= both[1] else -mode)

    def moved(self, mode_nd: NDArray[np.float64], amplitude: float) -> pm.Packing:
        """Return the packing after a straight motion of this length [diameter]."""
        packing = self.scene.packing
        way = amplitude * packing.reference_diameter * mode_nd
        return packing.replace(position_nd=packing.position_nd + way)

    def energy_change(self, mode_nd: NDArray[np.float64], amplitudes: Sequence[float]) -> NDArray[np.float64]:
        """Return what the energy a particle grows by along a straight motion [energy scale]."""
        start = pm.energy(self.scene)
        moved = [pm.energy(self.scene.replace(packing=self.moved(mode_nd, one))) for one in amplitudes]
        return np.asarray((np.array(moved) - start) / self.scene.packing.particles)


@dataclass(frozen=True)
class Deformed:
    """A row of the table: energy a particle along the lowest mode, forward and backward, less that at the start."""

    search: str
    seed: int
    amplitude: float
    forward: float
    backward: float


def _judged(search: str, seed: int, scene: pm.Scene) -> Found:
    verdict = pm.classify_jamming(scene)
    wanted = (JAMMED, JAMMED if search == MECHANICAL else NOT_JAMMED)
    rattlers = int(verdict.rattlers.sum())
    # a motion that costs nothing, of discs that all are held
    fits = (verdict.local, verdict.collective) == wanted and not rattlers
    fits = fits and (search == MECHANICAL or verdict.collectively.floppy_modes > 0)
    return Found(
        search,
        fits,
        seed,
        pm.packing_fraction(scene.packing),
        verdict.contacts,
        rattlers,
        verdict.collectively.floppy_modes,
        verdict.collectively.states_of_self_stress,
        verdict.local,
        verdict.collective,
        scene,
    )


def mechanically_stable(seed: int, particles: int = DISCS) -> Found:
    """Return what a random start jams to in a square box, at a pressure of 1e-9 [energy scale / diameter^2]."""
    start = pm.random_packing(particles, dimension=2, sizes=pm.Monodisperse(), packing_fraction=_START, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(),))
    run = pm.jam(scene, pressure=_PRESSURE, strain="isotropic", method=_METHOD, check=False)
    return _judged(MECHANICAL, seed, scene.replace(packing=run.packing))


def locally_stable(seed: int, particles: int = DISCS) -> Found | None:
    """Return the packing in which random discs cannot grow any more by moves of single ones; None without an end."""
    rng = np.random.default_rng(seed)
    place, last = rng.random((particles, 2)), 0.0
    for _ in range(_SWEEPS):
        for n in rng.permutation(particles):
            others = (np.delete(place, n, axis=0)[:, None] + _CELLS).reshape(-1, 2)
            place[n] = middle_of_cage(place[n], others) % 1.0
        distance = _distances(place)[1].min()
        if distance <= last * (1.0 + 1e-15):
            break
        last = distance
    else:
        return None
    ends, distance_p = _distances(place)
    touching = distance_p <= last * (1.0 + _TOUCHING)
    if (distance_p[~touching] <= last * (1.0 + _APART)).any():
        return None
    place, diameter = _touching(place, [one[touching] for one in ends], last)
    # lengths in diameters
    packing = pm.Packing(place / diameter, np.full(particles, 0.5 * (1.0 - _ROOM)), pm.Box.cubic(1.0 / diameter, 2))
    return _judged(LOCAL, seed, pm.Scene(packing, (pm.Repulsion(),)))


def search(
    seeds: Sequence[int], progress: Callable[[int, int, Found | None], None], particles: int = DISCS
) -> list[Found]:
    """Return what both searches found from starts of these seeds."""
    found: list[Found] = []
    for count, seed in enumerate(seeds):
        progress(count, len(seeds), found[-1] if found else None)
        found.extend(one for one in (mechanically_stable(seed, particles), locally_stable(seed, particles)) if one)
    return found


def similar_pair(found: Sequence[Found]) -> tuple[Found, Found]:
    """Return a mechanically and a locally stable packing of nearly the same packing fraction.

    Of the locally stable ones within .01 of a mechanically stable one, that which is moved farthest without a cost.

    Raises
    ------
    ValueError
        If there is no such pair.

    """
    mechanical, local = ([one for one in found if one.fits and one.search == kind] for kind in (MECHANICAL, LOCAL))
    pairs = [(one, other) for one in mechanical for other in local if _difference(one, other) < _SIMILAR]
    if not pairs:
        raise ValueError(
            f"packings must be enough for a {MECHANICAL} and a {LOCAL} one of packing fractions within {_SIMILAR:g}, "
            f"got {len(mechanical)} and {len(local)}"
        )
    farthest = {id(other): max(free_way(deform(other))) for _, other in pairs}
    return min(pairs, key=lambda pair: (-farthest[id(pair[1])], _difference(*pair)))


def _difference(one: Found, other: Found) -> float:
    return abs(one.packing_fraction - other.packing_fraction)


def middle_of_cage(place_d: NDArray[np.float64], others_nd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the distance to the nearest of the others is largest, on the steepest way up from this place.

    The way goes straight from the nearest one until another is as near, then between both until a third is, and so on,
    and ends where three are as near that lie around it.
    """
    place = place_d
    for _ in range(len(others_nd)):
        apart = place - others_nd
        square = (apart**2).sum(axis=1)
        nearest = square <= square.min() * (1.0 + 1e-13)
        way = _steepest(apart[nearest] / np.sqrt(square[nearest])[:, None])
        if way is None:
            break
        # differences of squared distances are linear along the way
        first = others_nd[int(np.argmax(nearest))]
        approach = 2.0 * (others_nd - first) @ way
        nearer = (approach > 1e-14) & ~nearest
        if not nearer.any():
            break
        place = place + float(((square - square.min())[nearer] / approach[nearer]).min()) * way
    return place


def _steepest(unit_kd: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the direction that leads fastest away from the nearest of what lies behind these; None where none does."""
    angle = np.sort(np.arctan2(unit_kd[:, 1], unit_kd[:, 0]))
    gap = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
    widest = int(gap.argmax())
    if gap[widest] <= np.pi + 1e-9:
        return None
    # all lie in a half plane: halfway between the two at its sides
    middle = angle[widest] - 0.5 * (2.0 * np.pi - gap[widest])
    return np.array([np.cos(middle), np.sin(middle)])


def _distances(place_nd: NDArray[np.float64]) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Return (i, j, cell) of all pairs in a unit box and nine cells, and their distances."""
    i, j = np.triu_indices(len(place_nd), 1)
    i, j, cell = np.repeat(i, len(_CELLS)), np.repeat(j, len(_CELLS)), np.tile(_CELLS, (len(i), 1))
    apart = place_nd[j] + cell - place_nd[i]
    return [i, j, cell], np.sqrt((apart**2).sum(axis=1))


def _touching(
    place_nd: NDArray[np.float64], pairs: list[NDArray[np.float64]], diameter: float
) -> tuple[NDArray[np.float64], float]:
    """Return places in which all these pairs are at one distance to rounding, by Newton's method, and that distance."""
    i, j, cell = pairs
    row = np.arange(len(i))
    for _ in range(20):
        apart = place_nd[j] + cell - place_nd[i]
        distance = np.sqrt((apart**2).sum(axis=1))
        slope = np.zeros((len(i), len(place_nd), 2))
        slope[row, j] += apart / distance[:, None]
        slope[row, i] -= apart / distance[:, None]
        matrix = np.column_stack([slope.reshape(len(i), -1), -np.ones(len(i))])
        step = np.linalg.lstsq(matrix, diameter - distance, rcond=1e-10)[0]
        place_nd, diameter = place_nd + step[:-1].reshape(-1, 2), diameter + float(step[-1])
        if np.abs(step).max() < 1e-15:
            break
    return place_nd, diameter


def write_found(found: Sequence[Found], path: Path) -> None:
    """Write what the searches ended in, a row each."""
    names = [one.name for one in fields(Found) if one.name != "scene"]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([getattr(one, name) for name in names] for one in found)


def deform(found: Found) -> list[Deformed]:
    """Return the energies of a packing along its lowest mode, both ways."""
    mode = found.mode_nd
    both = [found.energy_change(sign * mode, AMPLITUDES) for sign in (1.0, -1.0)]
    return [
        Deformed(found.search, found.seed, *row) for row in zip(AMPLITUDES, *map(np.ndarray.tolist, both), strict=True)
    ]


def write_deformed(rows: Sequence[Deformed], path: Path) -> None:
    """Write the energies along lowest modes."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [one.name for one in fields(Deformed)])
        writer.writeheader()
        writer.writerows(asdict(one) for one in rows)


def exponent_of_energy(rows: Sequence[Deformed], low: float = 1e-5, high: float = 1e-2) -> float:
    """Return the exponent of the energy, mean of both ways, over the amplitude between two amplitudes."""
    taken = [one for one in rows if low <= one.amplitude <= high * 1.0001]
    change = [0.5 * (one.forward + one.backward) for one in taken]
    return float(np.polyfit(np.log([one.amplitude for one in taken]), np.log(change), 1)[0])


def free_way(rows: Sequence[Deformed]) -> tuple[float, float]:
    """Return the largest amplitudes up to which the energy is zero all the way, forward and backward [diameter]."""
    ways = []
    for name in ("forward", "backward"):
        costs = [getattr(one, name) != 0.0 for one in rows]
        first = costs.index(True) if any(costs) else len(rows)
        ways.append(rows[first - 1].amplitude if first else 0.0)
    return ways[0], ways[1]


def draw_stability(pair: Sequence[Found], rows: Sequence[Deformed], path: Path) -> None:
    """Write the figure: both packings, and moved along their lowest mode; energy over the amplitude."""
    with styled_figure(path, (12.6, 4.4)) as figure:
        *drawn, right = figure.subplots(1, 3)
        for number, (ax, one) in enumerate(zip(drawn, pair, strict=True)):
            mine = [row for row in rows if row.search == one.search]
            _draw_packing(ax, one, COLORS[number])
            ax.set_title(
                f"({'ab'[number]}) {one.search}: seed {one.seed}\npacking fraction {one.packing_fraction:.4f}, "
                f"{one.contacts} contacts, floppy modes: {one.floppy_modes}",
                fontsize=9,
            )
            for name, style in (("forward", "-"), ("backward", "--")):
                change = np.array([getattr(row, name) for row in mine])
                right.plot(
                    AMPLITUDES, change, style, color=COLORS[number], label=f"{one.search}, {name}", linewidth=1.2
                )
        shown = np.array(AMPLITUDES)
        right.plot(shown, 0.1 * shown**2, ":", color="#808080", linewidth=1.0, label="slope 2")
        right.set(xscale="log", xlabel="amplitude along the lowest mode [diameter]", ylabel="energy a particle",
                  title="(c) change of energy")  # fmt: skip
        # zero is on this axis
        right.set_yscale("symlog", linthresh=1e-13, linscale=0.5)
        right.set_ylim(-1e-14, 1e-1)
        right.legend(fontsize=7.0, loc="upper left")


def _draw_packing(ax: Any, one: Found, color: str) -> None:
    """Draw the discs of a cell and their copies around it, where they are and, dashed, where the mode takes them."""
    packing = one.scene.packing
    side, radius = float(packing.box.lattice_dd[0, 0]), float(packing.radius_n[0])
    start = packing.wrapped().position_nd
    end = start + one.moved(one.mode_nd, SHOWN).position_nd - packing.position_nd
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    rim = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    for cell in side * _CELLS:
        strength = 1.0 if not cell.any() else 0.25
        for before, after in zip(start + cell, end + cell, strict=True):
            ax.plot(*(before + rim).T, color=color, linewidth=1.1, alpha=strength)
            ax.plot(*(after + rim).T, "--", color="#404040", linewidth=0.8, alpha=strength)
            ax.plot(*np.array([before, after]).T, color="#000000", linewidth=1.6, alpha=strength)
    ax.plot([0.0, side, side, 0.0, 0.0], [0.0, 0.0, side, side, 0.0], color="#b0b0b0", linewidth=0.8)
    ax.set(xlim=(-0.25 * side, 1.25 * side), ylim=(-0.25 * side, 1.25 * side), aspect="equal", xticks=[], yticks=[])
