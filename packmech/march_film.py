"""What is to be seen of discs and spheres on a march, as arrays: bonds, contacts that stick or slide, marks that turn.

Draws nothing; Rerun recordings and pictures are made of the same arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from packmech import drawing
from packmech.box import Box
from packmech.dynamics.march.touching import Touching
from packmech.dynamics.rheology.travel import StrainRun
from packmech.dynamics.simulation import MotionTrace, Simulation
from packmech.effects import Bonds, Walls
from packmech.outcome import Run
from packmech.packing import Packing
from packmech.recording_film import Curve, Film
from packmech.scene import Scene

SLIDING, HELD, WALL = (96, 200, 255), (170, 176, 190), (214, 216, 222)
MARK = (13, 17, 26)
# half widths over the reference diameter
BOND_WIDTH, MARK_WIDTH, WALL_WIDTH = 0.06, 0.035, 0.05
# a mark reaches from here to there on its disc, over the radius
MARK_FROM, MARK_TO = 0.35, 0.9
# a box so much flatter than it need be is drawn with its shortest vectors
_FLAT = 0.7


@dataclass(frozen=True, eq=False)
class Moment:
    """A march at one step: packing, contacts (None: whoever touches), and (N, d) unit vectors that turn with spins."""

    step: int
    time: float
    packing: Packing
    touching: Touching | None
    mark_nd: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class Picture:
    """Lines to draw over the discs of `drawing`; forces are over their mean, pulls over the mean |extension|."""

    drawing: drawing.Drawing
    sticking_sed: NDArray[np.float64]
    sticking_force_s: NDArray[np.float64]
    sliding_sed: NDArray[np.float64]
    sliding_force_s: NDArray[np.float64]
    bond_sed: NDArray[np.float64]
    bond_pull_s: NDArray[np.float64]
    mark_ned: NDArray[np.float64]
    wall_ed: list[NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class MarchFilm:
    """Moments of a march, curves (step, value) by name, and stress against strain.

    Attributes
    ----------
    scene
        What was run.
    moments
        What is drawn.
    curves
        Figures against step.
    strain_t, stress_t
        (T,) strain and the stress that answers to it; empty where nothing was strained.
    moduli
        G' and G'' where they are known, by name.
    held_n
        (N,) particles that were held.

    """

    scene: Scene
    moments: tuple[Moment, ...]
    curves: Mapping[str, Curve]
    strain_t: NDArray[np.float64]
    stress_t: NDArray[np.float64]
    moduli: Mapping[str, float]
    held_n: NDArray[np.bool_] | None = None

    def film(self) -> Film:
        """Return the film as packings and curves, for what all recordings share."""
        step_f = np.array([moment.step for moment in self.moments])
        return Film(step_f, tuple(moment.packing for moment in self.moments), self.scene.effects, self.curves)

    def colors(self) -> NDArray[np.uint8]:
        """Return the (N, 3) colors of the particles: bonded fragments in hues of their own, who is held in gray."""
        return particle_colors(self.scene, self.held_n)


def is_march(run: Run) -> TypeGuard[StrainRun | Simulation]:
    """Whether a run kept what a march has to show."""
    trace = run.trace
    return isinstance(run, StrainRun) or (
        isinstance(run, Simulation) and isinstance(trace, MotionTrace) and trace.touching_t is not None
    )


def film_of_march(run: StrainRun | Simulation, scene: Scene, frames: int) -> MarchFilm:
    """Return the film of a march: moments evenly chosen from those that were kept, every figure that was.

    Parameters
    ----------
    run
        A run of `pm.simulate` with trace_positions, or of `pm.oscillatory_shear`, with frames if more than its start
        and its end are to be seen.
    scene
        The scene that was run.
    frames
        Largest number of moments.

    """
    if isinstance(run, StrainRun):
        time_f, position, lattice = run.frame_time_f, run.position_fnd, run.lattice_fdd
        step_f = np.rint(time_f / run.dt).astype(np.int64)
        spin, touching = run.spin_fnk, run.touching_f or None
        if len(time_f) == 0:  # its start and its end
            packings = (scene.packing, run.packing)
            time_f, step_f = run.time_t[[0, -1]], np.array([0, max(run.steps, 1)])
            position = np.array([one.position_nd for one in packings])
            lattice = np.array([one.box.lattice_dd for one in packings])
        figures, strained = _figures_of_strain(run), (run.strain_t, run.shear_stress_t)
    else:
        trace = run.trace
        assert isinstance(trace, MotionTrace) and trace.position_tnd is not None and trace.lattice_tdd is not None
        time_f, step_f, position, lattice = trace.time_t, trace.step_t, trace.position_tnd, trace.lattice_tdd
        spin, touching = trace.spin_tnk, trace.touching_t
        figures = _figures_of_motion(trace)
        strained = (trace.strain_t, trace.overall_stress_tdd[:, 0, 1])
    mark = None if spin is None else turned_marks(np.asarray(time_f), np.asarray(spin), scene.packing.dimension)
    chosen = np.unique(np.rint(np.linspace(0, len(time_f) - 1, min(frames, len(time_f)))).astype(int))
    moments = tuple(
        Moment(
            int(step_f[f]),
            float(time_f[f]),
            scene.packing.replace(position_nd=position[f], box=Box(lattice[f])),
            None if touching is None else touching[f],
            None if mark is None else mark[f],
        )
        for f in chosen
    )
    moduli = getattr(run, "moduli", None)
    told = {} if moduli is None else {"storage_modulus": float(moduli.storage), "loss_modulus": float(moduli.loss)}
    if not np.ptp(strained[0]) > 0.0:
        strained = (np.zeros(0), np.zeros(0))
    return MarchFilm(scene, moments, figures, *strained, told, run.held_n)


def _figures_of_motion(trace: MotionTrace) -> dict[str, Curve]:
    share = trace.sliding_t / np.maximum(trace.contacts_t, 1)
    return _curves(
        trace.step_t, trace.strain_t, trace.overall_stress_tdd, trace.contacts_t, share, trace.energy_t, trace.kinetic_t
    )


def _figures_of_strain(run: StrainRun) -> dict[str, Curve]:
    step = np.rint(run.time_t / run.dt).astype(np.int64)
    potential, kinetic = run.potential_t + run.tangential_t, run.kinetic_t + run.rotational_t
    share = run.sliding_fraction_t
    return _curves(step, run.strain_t, run.stress["overall"], run.contacts_t, share, potential, kinetic, run.axes)


def _curves(
    step_t: NDArray[np.int64],
    strain_t: NDArray[np.float64],
    stress_tdd: NDArray[np.float64],
    contacts_t: NDArray[np.int64],
    sliding_t: NDArray[np.float64],
    energy_t: NDArray[np.float64],
    kinetic_t: NDArray[np.float64],
    axes: tuple[int, int] = (0, 1),
) -> dict[str, Curve]:
    """Return what to plot against step, less what does not change."""
    d = stress_tdd.shape[1]
    curves: dict[str, Curve] = {
        "strain": (step_t, strain_t),
        f"stress {''.join('xyz'[a] for a in axes)}": (step_t, stress_tdd[:, axes[0], axes[1]]),
        "pressure": (step_t, -np.trace(stress_tdd, axis1=1, axis2=2) / d),
        "contacts": (step_t, contacts_t.astype(float)),
        "sliding part": (step_t, sliding_t),
    }
    for name, value_t in (("energy", energy_t), ("kinetic energy", kinetic_t)):
        seen_t = value_t > 0.0
        curves[f"log10 {name}"] = (step_t[seen_t], np.log10(value_t[seen_t]))
    return {name: curve for name, curve in curves.items() if len(curve[1]) and np.ptp(curve[1]) > 0.0}


def turned_marks(
    time_t: NDArray[np.float64],
    spin_tnk: NDArray[np.float64],
    dimension: int,
    start_nd: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return (T, N, d) unit vectors that turn with the spins, by the trapezoidal rule in between.

    Parameters
    ----------
    time_t, spin_tnk
        (T,) times and (T, N, 1 or 3) spins.
    dimension
        2 or 3.
    start_nd
        (N, d) vectors at the first time; along x unless given.

    Examples
    --------
    >>> turned_marks(np.array([0.0, np.pi / 2]), np.ones((2, 1, 1)), 2)[1].round(12).tolist()
    [[0.0, 1.0]]

    """
    n = spin_tnk.shape[1]
    mark = np.tile(np.eye(3)[0], (n, 1))
    if start_nd is not None:
        mark[:, :dimension] = start_nd
    turn = np.zeros((len(time_t) - 1, n, 3))
    turn[:, :, 3 - spin_tnk.shape[2] :] = np.diff(time_t)[:, None, None] * 0.5 * (spin_tnk[1:] + spin_tnk[:-1])
    found = [mark]
    for turn_nd in turn:
        angle = np.linalg.norm(turn_nd, axis=1)[:, None]
        axis = turn_nd / np.where(angle > 0.0, angle, 1.0)
        along = np.sum(axis * mark, axis=1)[:, None] * axis
        # Rodrigues: what lies along the axis stays, the rest turns
        mark = along + np.cos(angle) * (mark - along) + np.sin(angle) * np.cross(axis, mark)
        found.append(mark)
    return np.array(found)[:, :, :dimension]


def particle_colors(scene: Scene, held_n: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """Return (N, 3) colors: by size, bonded fragments in hues of their own, who is held in gray.

    Parameters
    ----------
    scene
        The scene.
    held_n
        (N,) who is held, if anybody is.

    """
    color_nc = fragment_colors(scene.packing, scene.effects)
    if held_n is not None:
        color_nc[held_n] = HELD
    return color_nc


def fragment_colors(packing: Packing, effects: tuple[Any, ...]) -> NDArray[np.uint8]:
    """Return (N, 3) colors by size, bonded fragments in hues of their own.

    Parameters
    ----------
    packing
        The packing.
    effects
        Effects; bonds among them hold fragments together.

    """
    color_nc = drawing.particle_colors(packing.radius_n, np.zeros(packing.particles, dtype=bool))
    bonds = _bonds(effects)
    if bonds is not None:
        from scipy.sparse import coo_array
        from scipy.sparse.csgraph import connected_components

        n = packing.particles
        graph = coo_array((np.ones(len(bonds)), (bonds.i_b, bonds.j_b)), shape=(n, n))
        _, fragment_n = connected_components(graph, directed=False)
        bonded = np.unique(np.concatenate([bonds.i_b, bonds.j_b]))
        hues = np.array(drawing.CLUSTERS, dtype=np.uint8)
        color_nc[bonded] = hues[np.unique(fragment_n[bonded], return_inverse=True)[1].ravel() % len(hues)]
    return color_nc


def _bonds(effects: tuple[Any, ...]) -> Bonds | None:
    return next((one for one in effects if isinstance(one, Bonds) and len(one)), None)


def draw_moment(moment: Moment, scene: Scene) -> Picture:
    """Return what to draw of a march at one moment, all of it inside the cell.

    Parameters
    ----------
    moment
        The moment.
    scene
        The scene: its bonds and walls are drawn too.

    """
    packing = moment.packing
    box, back = shown_box(packing.box)
    inside, image = box.wrap(packing.position_nd)
    shown = replace(packing, position_nd=inside, box=box)

    def lines(i: Any, j: Any, image_cd: Any) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
        """Lines between pairs, the pair of each line, and the distance of each pair."""
        whole = np.asarray(image_cd) @ back.T + image[j] - image[i]
        vector = inside[j] - inside[i] + whole @ box.lattice_dd.T
        segments, pair_s = drawing.pair_lines(inside, i, j, whole, vector)
        return segments, pair_s, np.linalg.norm(vector, axis=1)

    d = packing.dimension
    none, zero = np.zeros((0, 2, d)), np.zeros(0)
    touching = moment.touching
    if touching is None:
        whole = drawing.draw_packing(shown, tuple(one for one in scene.effects if hasattr(type(one), "pair_energy")))
        sticking, sticking_force = whole.segment_sed, whole.force_s
        sliding, sliding_force = none, zero
    else:
        whole = drawing.draw_packing(shown)
        segments, pair_s, _ = lines(touching.i_c, touching.j_c, touching.image_cd)
        mean = float(touching.normal_c.mean()) if len(touching.normal_c) else 0.0
        force_s = touching.normal_c[pair_s] / mean if mean > 0.0 else np.zeros(len(pair_s))
        slides_s = touching.sliding_c[pair_s]
        sticking, sticking_force = segments[~slides_s], force_s[~slides_s]
        sliding, sliding_force = segments[slides_s], force_s[slides_s]
    bonds = _bonds(scene.effects)
    bond, pull = none, zero
    if bonds is not None:
        bond, pair_s, distance = lines(bonds.i_b, bonds.j_b, bonds.image_bd)
        extension = distance / bonds.rest_length_b - 1.0
        mean = float(np.abs(extension).mean())
        pull = extension[pair_s] / mean if mean > 0.0 else np.zeros(len(pair_s))
    mark = none
    if moment.mark_nd is not None:
        reach = packing.radius_n[:, None] * moment.mark_nd
        mark = np.stack([inside + MARK_FROM * reach, inside + MARK_TO * reach], axis=1)
    return Picture(
        whole, sticking, sticking_force, sliding, sliding_force, bond, pull, mark, wall_outlines(scene.effects, box)
    )


def shown_box(box: Box) -> tuple[Box, NDArray[np.int64]]:
    """Return the box to draw, and whole numbers that turn images of the box as it is into images of that."""
    small, change = box.reduced()
    if box.height_d.min() >= _FLAT * small.height_d.min():
        return box, np.eye(box.dimension, dtype=np.int64)
    return small, np.rint(np.linalg.inv(change)).astype(np.int64)


def wall_outlines(effects: Sequence[Any], box: Box) -> list[NDArray[np.float64]]:
    """Return polylines along the smooth walls among the effects, across the extent of the cell."""
    corner_kd = np.concatenate(drawing.box_outline(box))
    low, high = corner_kd.min(axis=0), corner_kd.max(axis=0)
    found = []
    for wall in (one for one in effects if isinstance(one, Walls)):
        axis = int(wall.axis)
        others = [a for a in range(box.dimension) if a != axis]
        for place in (wall.low, wall.high):
            turns = [(0,), (1,)] if len(others) == 1 else [(0, 0), (0, 1), (1, 1), (1, 0), (0, 0)]
            line = np.empty((len(turns), box.dimension))
            line[:, axis] = place
            for k, a in enumerate(others):
                line[:, a] = [(low[a], high[a])[turn[k]] for turn in turns]
            found.append(line)
    return found
