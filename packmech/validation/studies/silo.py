"""A silo of discs with friction between rough walls whose floor is lowered: stress against depth, and Janssen's law.

H. A. Janssen, Z. Ver. Dtsch. Ing. 39, 1045 (1895), in a plane: walls a width W apart bear mu_w K of the vertical stress
that grains press on each other with, so that it comes to rest at rho g lambda with lambda = W / (2 mu_w K).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

import packmech as pm
from packmech.view.figures import COLORS, styled_figure

# acceleration [k d / m] and speed of the floor [d sqrt(k / m)]: overlaps of some 1e-3, inertial numbers near 1e-3
_GRAVITY, _SPEED = 1e-4, 3e-4
# how far the floor sinks before anything counts, and while it does [d]; how often one looks
_BEFORE, _WHILE, _LOOKS = 2.0, 1.5, 20
# the start: columns and rows of discs that do not touch, and how long they fall, in units of sqrt(2 H / g)
_COLUMN, _ROW, _FALLING, _DRAG = 1.25, 1.1, 6.0, 0.01
# packing fraction of what has fallen
_FILLED = 0.82
# layers that stress is averaged over [d]; what of the height is fitted: neither the heap's top nor next to the floor
_LAYER, _FITTED = 2.0, (0.05, 0.9)
_BELOW = 8.0


# depth, vertical stress, stress on the walls and along them, by layers
Profiles = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


class Silo(NamedTuple):
    """Stress of grains by layers of depth, mean over the looks; compression positive.

    `width` is that between the walls' surfaces, `weight` that of all grains over it and their height [stress / length].
    """

    width: float
    weight: float
    depth_l: NDArray[np.float64]
    vertical_l: NDArray[np.float64]
    wall_normal_l: NDArray[np.float64]
    wall_shear_l: NDArray[np.float64]
    floor_part: float

    @property
    def profiles(self) -> Profiles:
        """The four columns by layers."""
        return self.depth_l, self.vertical_l, self.wall_normal_l, self.wall_shear_l


@dataclass(frozen=True)
class Janssen:
    """What a silo says of Janssen's law: the length by a fit, and what it should be from the stresses on the walls."""

    wall_friction: float
    stress_ratio: float
    length: float
    fitted_ratio: float
    height: float


def fill(width: float, height: float, friction: float, seed: int) -> tuple[pm.Scene, int, int]:
    """Return a scene of discs 0.86 to 1.2 across between rough walls at rest, and how many grains and floor discs.

    Walls are one column of held discs in a box that is periodic along x, the floor is a row of them.
    """
    rng = np.random.default_rng(seed)
    across = int((width - 1.0) // _COLUMN)
    # mean area of a disc, and of what a row of them fills
    rows = round(height * width * _FILLED / (math.pi / 4.0 * (1.0 + 1.4**2) / 2.0 / 1.2**2 * across))
    place = [(1.1 + _COLUMN * (i + 0.25 * (j % 2)), 1.5 + _ROW * j) for j in range(rows) for i in range(across)]
    grain_nd = np.array(place) + rng.uniform(-0.05, 0.05, (len(place), 2))
    radius = np.where(rng.permutation(len(place)) < len(place) // 2, 1.0, 1.4) / 2.4
    top = float(grain_nd[:, 1].max())
    beside = np.linspace(1.15, width - 0.15, int(width - 1.0))
    floor_nd = np.column_stack([beside, np.zeros_like(beside)])
    up = np.arange(-_BELOW + 1.0, top + 3.0)
    wall_nd = np.column_stack([np.zeros_like(up), up])
    position = np.concatenate([grain_nd, floor_nd, wall_nd]) + (0.0, _BELOW)
    radius = np.concatenate([radius, np.full(len(floor_nd) + len(wall_nd), 0.5)])
    packing = pm.Packing(position, radius, pm.Box(np.diag([width + 1.0, top + 4.0 + 3.0 * _BELOW])))
    damping = 0.5 * math.sqrt(packing.mass_n.mean())
    effects = (
        pm.Repulsion(pm.LinearSpring(1.0)),
        pm.Friction(friction, 0.5),
        pm.ContactDamping(damping),
        pm.Gravity(y=-_GRAVITY),
        pm.FixedParticles(tuple(range(len(grain_nd) + len(floor_nd), len(position)))),
    )
    falling = pm.Scene(packing, (*effects, _floor(len(grain_nd), len(floor_nd), 0.0), pm.BackgroundDamping(_DRAG)))
    run = pm.simulate(falling, duration=_FALLING * math.sqrt(2.0 * height / _GRAVITY))
    return pm.Scene(run.packing, effects), len(grain_nd), len(floor_nd)


def _floor(grains: int, discs: int, speed: float) -> pm.FixedParticles:
    return pm.FixedParticles(tuple(range(grains, grains + discs)), (0.0, -speed) if speed else ())


def lower_floor(width: float, height: float, friction: float, seed: int, progress: Callable[[int, int], None]) -> Silo:
    """Return the stresses in a silo while its floor sinks, so that the grains slide down the walls."""
    scene, grains, discs = fill(width, height, friction, seed)
    moving = scene.replace(effects=(*scene.effects, _floor(grains, discs, _SPEED)))
    resting = scene.replace(effects=(*scene.effects, _floor(grains, discs, 0.0)))
    looks: list[Silo] = []
    run = pm.simulate(moving, duration=_BEFORE / _SPEED)
    for look in range(_LOOKS):
        progress(look, _LOOKS)
        further = moving.replace(packing=run.packing)
        run = pm.simulate(further, duration=_WHILE / _LOOKS / _SPEED, velocity_nd=run.velocity_nd, spin_nk=run.spin_nk)
        looks.append(measure(resting.replace(packing=run.packing), grains, discs, width))
    # layers that all looks have
    layers = min(len(one.depth_l) for one in looks)
    return Silo(
        width,
        float(np.mean([one.weight for one in looks])),
        *_mean_profiles([one.profiles for one in looks], layers),
        float(np.mean([one.floor_part for one in looks])),
    )


def _mean_profiles(looks: Sequence[Profiles], layers: int) -> Profiles:
    first, second, third, fourth = (np.mean([one[k][:layers] for one in looks], axis=0) for k in range(4))
    return first, second, third, fourth


def measure(scene: pm.Scene, grains: int, discs: int, width: float) -> Silo:
    """Return the stresses in a silo as it stands: forces through levels, and of the walls between them."""
    packing, found = scene.packing, pm.contact_forces(scene)
    contacts, force = found.contacts, found.force_cd
    y, is_grain = packing.position_nd[:, 1], np.arange(packing.particles) < grains
    top = float(np.sort(y[:grains])[-round(width / 2.0) :].mean())
    bottom = float(y[grains : grains + discs].mean()) + 0.5
    low, vector = y[contacts.i_c], contacts.vector_cd
    high = low + vector[:, 1]
    within = is_grain[contacts.i_c] & is_grain[contacts.j_c]
    edge = top - _LAYER * np.arange(int((top - bottom) / _LAYER) + 1)
    level = 0.5 * (edge[1:] + edge[:-1])
    above = np.where(low[:, None] > level, force[:, 1:], -force[:, 1:])
    crossing = (np.minimum(low, high)[:, None] < level) & (np.maximum(low, high)[:, None] > level) & within[:, None]
    vertical = (above * crossing).sum(axis=0) / width
    is_wall = np.arange(packing.particles) >= grains + discs
    at_wall = is_wall[contacts.i_c] ^ is_wall[contacts.j_c]
    on_grain = np.where(is_wall[contacts.i_c][:, None], -force, force)[at_wall]
    layer = np.digitize((top - np.where(is_wall[contacts.i_c], low, high))[at_wall], top - edge) - 1
    inside = (layer >= 0) & (layer < len(level))
    sums = [np.bincount(layer[inside], one[inside], len(level)) for one in (np.abs(on_grain[:, 0]), on_grain[:, 1])]
    weight = float(packing.mass_n[:grains].sum()) * _GRAVITY
    is_floor = ~is_grain & ~is_wall
    on_floor = is_floor[contacts.i_c] ^ is_floor[contacts.j_c]
    borne = float(np.abs(np.where(is_floor[contacts.i_c], force[:, 1], -force[:, 1])[on_floor].sum()))
    normal, shear = (one / (2.0 * _LAYER) for one in sums)
    return Silo(width, weight / (width * (top - bottom)), top - level, vertical, normal, shear, borne / weight)


def janssen_stress(
    depth: NDArray[np.float64] | float, length: float, surface: float, weight: float
) -> NDArray[np.float64]:
    """Return the vertical stress of Janssen's law below a surface."""
    return np.asarray(weight * length * (1.0 - np.exp((surface - depth) / length)))


def fit_silo(found: Silo) -> tuple[Janssen, float]:
    """Return what a silo says of Janssen's law, its length fitted to the vertical stress, and where the law begins."""
    height = found.depth_l[-1]
    used = (found.depth_l > _FITTED[0] * height) & (found.depth_l < _FITTED[1] * height)
    normal, shear = found.wall_normal_l[used].sum(), found.wall_shear_l[used].sum()

    def law(depth: NDArray[np.float64], length: float, surface: float) -> NDArray[np.float64]:
        return janssen_stress(depth, length, surface, found.weight)

    (length, surface), _ = curve_fit(law, found.depth_l[used], found.vertical_l[used], p0=(found.width, 0.0))
    friction = float(shear / normal)
    ratio = float(normal / found.vertical_l[used].sum())
    return Janssen(friction, ratio, float(length), found.width / (2.0 * friction * float(length)), height), surface


_HEADINGS = ("depth", "vertical", "wall_normal", "wall_shear", "weight", "floor_part")


def lower_all(
    folder: Path,
    *,
    width: float,
    height: float,
    friction: float,
    seeds: Sequence[int],
    progress: Callable[[int, int, int, int], None],
) -> list[Silo]:
    """Return the silos of all seeds; each is written to a file once it is there, and found there again."""
    silos = []
    for done, seed in enumerate(seeds):
        path = folder / f"silo-w{width:g}-h{height:g}-mu{friction:g}-seed{seed}.csv"
        if not path.exists():
            found = lower_floor(
                width,
                height,
                friction,
                seed,
                lambda k, of, done=done: progress(done, len(seeds), k, of),  # type: ignore[misc]
            )
            with path.open("w", encoding="utf-8", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(_HEADINGS)
                rows = zip(*(column.tolist() for column in found.profiles), strict=True)
                writer.writerows((*row, found.weight, found.floor_part) for row in rows)
        depth, vertical, normal, shear, weight, part = np.loadtxt(path, delimiter=",", skiprows=1).T
        silos.append(Silo(width, float(weight[0]), depth, vertical, normal, shear, float(part[0])))
    return silos


def draw_silos(found: Sequence[Silo], path: Path) -> None:
    """Write the figure: vertical stress and that on the walls over depth, with the weight above and Janssen's law."""
    with styled_figure(path, (9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        for k, one in enumerate(found):
            unit = one.weight * one.width
            janssen, surface = fit_silo(one)
            words = (f"K = {janssen.fitted_ratio:.2f} fitted, {janssen.stress_ratio:.2f} measured", None)[k > 0]
            left.plot(one.depth_l, one.vertical_l / unit, ".", color=COLORS[0], markersize=3.0)
            law = janssen_stress(one.depth_l, janssen.length, surface, one.weight)
            left.plot(one.depth_l, law / unit, color=COLORS[1], linewidth=1.0, label=words)
            right.plot(one.depth_l, one.wall_normal_l / one.vertical_l, ".", color=COLORS[0], markersize=3.0)
            right.plot(one.depth_l, one.wall_shear_l / one.wall_normal_l, ".", color=COLORS[2], markersize=3.0)
        one = found[0]
        deep = one.depth_l[one.depth_l < 2.5 * one.width]
        left.plot(deep, deep / one.width, color="#909090", linestyle="--", label="weight above")
        right.plot([], [], ".", color=COLORS[0], label="on the wall / vertical: K")
        right.plot([], [], ".", color=COLORS[2], label="along / on the wall")
        left.set(xlabel="depth [d]", ylabel="vertical stress / (density g W)", ylim=(0.0, None))
        right.set(xlabel="depth [d]", ylabel="ratio of stresses", ylim=(0.0, 2.0))
        for ax in (left, right):
            ax.legend(fontsize=8.0)
        figure.suptitle(f"Silo {one.width:g} d wide between rough walls, its floor sinking", fontsize=10)
