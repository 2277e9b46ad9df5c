"""What pictures and recordings show of a run, before it is drawn: frames at some steps, curves against step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief, clear_errors, instance
from packmech.contacts import pair_contacts
from packmech.contacts.shape_contacts import touching_pairs
from packmech.dynamics.breaking import BrokenBonds
from packmech.dynamics.moved_walls import MovedWalls
from packmech.dynamics.pair_forces import Touching
from packmech.dynamics.simulation import MotionTrace
from packmech.effects import acting_contacts, bonds_of
from packmech.files.snapshot import ContactData, Snapshot
from packmech.links import image_offsets
from packmech.measure.contact_forces import force_balance, rattlers_in
from packmech.measure.stress import energy, pressure
from packmech.minimize.quench import orientations_of
from packmech.observables import OBSERVABLES, State, measure_added
from packmech.packing import Packing
from packmech.result import Run, Trace
from packmech.rheology.strain_run import StrainRun
from packmech.scene import Scene
from packmech.view import drawing

# more frames than any run keeps
_ALL = 2**62
Curve = tuple[NDArray[np.int64], NDArray[np.float64]]

# an eigenvalue this small against the stiffness of a contact belongs to a free motion (a translation, a rattler);
# the softest true mode of a jammed packing of 16,000 discs is at 1e-6 (near jamming, over the contact stiffness)
FREE_MOTION = 1e-9
# a mark reaches from here to there on its disc, over the radius
MARK_FROM, MARK_TO = 0.35, 0.9


@dataclass(frozen=True, eq=False)
class PackingFrame:
    """A packing at one step, its contacts (None: found when drawn), and (N, d) unit vectors that turn with spins.

    broken_e are the places of bonds that broke before, in those of the scene, and effects those of the scene with walls
    where they stood then, None where none moves.
    """

    step: int
    time: float
    packing: Packing
    touching: Touching | None = None
    mark_nd: NDArray[np.float64] | None = None
    broken_e: NDArray[np.int64] | None = None
    effects: tuple[Any, ...] | None = None


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Snapshots of a run, curves (step, value) by name, and stress against strain.

    Attributes
    ----------
    frames
        What is drawn.
    effects
        The effects whose forces, bonds and walls are drawn.
    curves
        Observables against step.
    strain_t, stress_t
        (T,) strain and the stress that answers to it; empty where nothing was strained.
    moduli
        G' and G'' where they are known, by name.
    held_n
        (N,) particles that were held.
    in_motion
        Whether it is of a time integration that kept contacts, drawn with bonds, marks and walls.

    """

    frames: tuple[PackingFrame, ...]
    effects: tuple[Any, ...]
    curves: Mapping[str, Curve]
    strain_t: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    stress_t: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    moduli: Mapping[str, float] = field(default_factory=dict)
    held_n: NDArray[np.bool_] | None = None
    in_motion: bool = False

    @property
    def step_f(self) -> NDArray[np.int64]:
        """The (F,) steps of the frames."""
        return np.array([one.step for one in self.frames])

    @property
    def packing_f(self) -> tuple[Packing, ...]:
        """The packings of the frames."""
        return tuple(one.packing for one in self.frames)

    @property
    def final(self) -> Packing:
        """The last packing."""
        return self.frames[-1].packing

    def colors(self) -> NDArray[np.uint8]:
        """Return the (N, 3) colors of the particles; rattlers are those of the last packing, unless it is in motion."""
        rattler_n = None
        if not self.in_motion:
            rattler_n = rattlers_in(Scene(self.final, self.effects))
        return drawing.particle_colors(self.final, self.effects, rattler_n, self.held_n)


@dataclass(frozen=True, eq=False)
class DrawnMode:
    """A mode to draw: a short name, what to say of it, and (N, d) displacements."""

    name: str
    title: str
    displacement_nd: NDArray[np.float64]


def trajectory_of_packing(subject: Packing | Scene) -> Trajectory:
    """Return the trajectory of one packing: a single frame, and its numbers as curves of one point."""
    if isinstance(subject, Packing):
        curves = {"contacts": _point(len(touching_pairs(subject)))}
        return Trajectory((PackingFrame(0, 0.0, subject),), (), curves)
    packing = subject.packing
    values = {"energy": energy(subject), "pressure": pressure(subject), "max force": force_balance(subject)[0]}
    curves = {f"log10 {name}": _point(np.log10(value)) for name, value in values.items() if value > 0.0}
    curves["contacts"] = _point(len(acting_contacts(touching_pairs(packing), subject.effects)))
    return Trajectory((PackingFrame(0, 0.0, packing),), subject.effects, curves)


def _point(value: float) -> Curve:
    return np.array([0]), np.array([float(value)])


def trajectory_of_run(run: Run, scene: Scene, frames: int) -> Trajectory:
    """Return the trajectory of a run: frames evenly chosen from those that were kept, every observable that was.

    Parameters
    ----------
    run
        A run. With frames, or a trace with positions, the frames are those; otherwise its start and its end.
    scene
        The scene that was run.
    frames
        Largest number of frames.

    """
    if isinstance(run, StrainRun):
        return _of_strain(run, scene, frames)
    trace = run.trace
    if isinstance(trace, MotionTrace) and trace.touching_t is not None:
        return _of_motion(run, trace, scene, frames)
    if trace is None or trace.position_tnd is None or len(trace.step_t) == 0:
        ends = (
            PackingFrame(0, 0.0, scene.packing),
            PackingFrame(max(run.steps, 1), float(max(run.steps, 1)), run.packing),
        )
        return Trajectory(ends, scene.effects, {} if trace is None else curves_of_trace(trace))
    kept = _frames_of(
        scene,
        trace.step_t,
        trace.step_t,
        trace.position_tnd,
        trace.lattice_tdd,
        None,
        None,
        trace.orientation_tnq,
        frames - 1,
    )
    last = max(int(run.steps), kept[-1].step + 1)
    return Trajectory((*kept, PackingFrame(last, float(last), run.packing)), scene.effects, curves_of_trace(trace))


@clear_errors
def snapshots(run: Run, scene: Scene) -> Iterator[Snapshot]:
    """Return every packing that a run kept, one after another, for `pm.write_trajectory`.

    With velocities (peculiar ones in a box that deforms) and spins where these were kept, and of discs and spheres in
    motion the forces of contacts, dashpots and friction included.

    Parameters
    ----------
    run
        A run with frames, or a trace with positions; of others the start and the end.
    scene
        The scene that was run.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind, or a scene of another number of particles.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> scene = pm.Scene(crystal, (pm.Repulsion(),))
    >>> run = pm.simulate(scene, steps=20, dt=0.1, temperature=0.01, seed=1, trace_every=5, trace_positions=True)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "run.gsd"
    >>> pm.write_trajectory(pm.snapshots(run, scene), path)
    >>> [one.step for one in pm.read_trajectory(path)], list(pm.read_trajectory(path)[-1].fields)
    ([0, 5, 10, 15, 20], ['velocity_nd'])

    """
    instance("run", run, Run)
    instance("scene", scene, Scene)
    if run.packing.particles != scene.packing.particles:
        raise ValueError(f"scene must have the run's {run.packing.particles} particles, got {scene.packing.particles}")
    trace = run.trace
    velocity = trace.velocity_tnd if isinstance(trace, MotionTrace) else None
    spin = trace.spin_tnk if isinstance(trace, MotionTrace) else getattr(run, "spin_fnk", None)
    kept = trajectory_of_run(run, scene, _ALL).frames
    fields = [{} for _ in kept] if velocity is None else [{"velocity_nd": one} for one in velocity]
    if spin is not None:
        fields = [{**found, "spin_nk": one} for found, one in zip(fields, spin, strict=True)]
    return (
        Snapshot(frame.packing, found, contact_forces=_contact_data(frame), step=frame.step)
        for frame, found in zip(kept, fields, strict=True)
    )


def _contact_data(frame: PackingFrame) -> ContactData | None:
    """Return the forces of the contacts of a frame that has them, of discs and spheres."""
    touching, packing = frame.touching, frame.packing
    if touching is None or packing.shapes.has_orientations:
        return None
    i, j, image = touching.i_c, touching.j_c, touching.image_cd
    normal_cd = pair_contacts(packing, i, j, image).normal_cd
    normal = -(touching.force_cd * normal_cd).sum(axis=1)
    return ContactData(i, j, image, normal, touching.force_cd + normal[:, None] * normal_cd)


def _evenly(count: int, chosen: int) -> NDArray[np.int64]:
    """Return evenly spaced numbers below count, the first and the last among them."""
    return np.unique(np.rint(np.linspace(0, count - 1, min(chosen, count))).astype(int))


def _of_strain(run: StrainRun, scene: Scene, frames: int) -> Trajectory:
    """Return the trajectory of a strained run."""
    time_f, position, lattice = run.frame_time_f, run.position_fnd, run.lattice_fdd
    step_f = np.rint(time_f / run.dt).astype(np.int64)
    if len(time_f) == 0:  # its start and its end
        packings = (scene.packing, run.packing)
        time_f, step_f = run.time_t[[0, -1]], np.array([0, max(run.steps, 1)])
        position = np.array([one.position_nd for one in packings])
        lattice = np.array([one.box.lattice_dd for one in packings])
    about = run.about()
    kept = (step_f, time_f, position, lattice, run.spin_fnk, run.touching_f or None, run.orientation_fnq)
    shear = f"stress {''.join('xyz'[a] for a in run.axes)}"
    columns = {
        "strain": run.strain_t,
        shear: run.shear_stress_t,
        "pressure": run.pressure_t,
        "contacts": run.contacts_t,
        "sliding_fraction": run.sliding_fraction_t,
        "energy": run.potential_t + run.tangential_t,
        "kinetic": run.kinetic_t + run.rotational_t,
        **run.added,
    }
    moduli: dict[str, float] = {name: about[name] for name in ("storage_modulus", "loss_modulus") if name in about}
    step_t = np.rint(run.time_t / run.dt).astype(np.int64)
    shown = _with_broken(_frames_of(scene, *kept, frames), run.broken_bonds)
    return _in_motion(scene, shown, step_t, columns, shear, run.held_n, moduli)


def _with_broken(frames: tuple[PackingFrame, ...], broken: BrokenBonds | None) -> tuple[PackingFrame, ...]:
    """Return frames that know which bonds are broken."""
    if broken is None:
        return frames
    return tuple(replace(one, broken_e=broken.bond_e[broken.step_e <= one.step]) for one in frames)


def _with_walls(frames: tuple[PackingFrame, ...], walls: MovedWalls | None) -> tuple[PackingFrame, ...]:
    """Return frames that know where walls stood that move."""
    if walls is None:
        return frames
    return tuple(replace(one, effects=walls.at(int(np.abs(walls.time_t - one.time).argmin()))) for one in frames)


def _of_motion(run: Run, trace: MotionTrace, scene: Scene, frames: int) -> Trajectory:
    """Return the trajectory of a simulation that kept contacts."""
    assert trace.position_tnd is not None and trace.lattice_tdd is not None
    overall, lattice = trace.overall_stress_tdd, trace.lattice_tdd
    columns = {
        "strain": trace.strain_t,
        "stress xy": overall[:, 0, 1],
        "pressure": -np.trace(overall, axis1=1, axis2=2) / overall.shape[1],
        "contacts": trace.contacts_t,
        "sliding_fraction": trace.sliding_t / np.maximum(trace.contacts_t, 1),
        "energy": trace.energy_t,
        "kinetic": trace.kinetic_t,
        **trace.added,
    }
    turning = (trace.spin_tnk, trace.touching_t, trace.orientation_tnq)
    kept = (trace.step_t, trace.time_t, trace.position_tnd, lattice, *turning)
    held_n = getattr(run, "held_n", None)
    shown = _with_broken(_frames_of(scene, *kept, frames), getattr(run, "broken_bonds", None))
    shown = _with_walls(shown, getattr(run, "walls", None))
    return _in_motion(scene, shown, trace.step_t, columns, "stress xy", held_n, {})


def _in_motion(
    scene: Scene,
    frames: tuple[PackingFrame, ...],
    step_t: NDArray[np.int64],
    columns: Mapping[str, NDArray[Any]],
    shear: str,
    held_n: NDArray[np.bool_] | None,
    moduli: Mapping[str, float],
) -> Trajectory:
    """Return the trajectory of a time integration, with stress against strain where something was strained."""
    curves = curves_of(step_t, columns, linear=("pressure", shear))
    varying = {name: curve for name, curve in curves.items() if len(curve[1]) and np.ptp(curve[1]) > 0.0}
    strain_t, stress_t = columns["strain"], columns[shear]
    if not np.ptp(strain_t) > 0.0:
        strain_t = stress_t = np.zeros(0)
    return Trajectory(frames, scene.effects, varying, strain_t, stress_t, moduli, held_n, in_motion=True)


def _frames_of(
    scene: Scene,
    step_f: NDArray[np.int64],
    time_f: NDArray[Any],
    position_fnd: NDArray[np.float64],
    lattice_fdd: NDArray[np.float64] | None,
    spin_fnk: NDArray[np.float64] | None,
    touching_f: Sequence[Touching] | None,
    orientation_fnq: NDArray[np.float64] | None,
    frames: int,
) -> tuple[PackingFrame, ...]:
    """Return evenly chosen frames; boxes and orientations are those of the scene where none were kept."""
    packing = scene.packing
    mark = None if spin_fnk is None else turned_marks(np.asarray(time_f), spin_fnk, packing.dimension)
    return tuple(
        PackingFrame(
            int(step_f[f]),
            float(time_f[f]),
            packing.replace(
                position_nd=position_fnd[f],
                box=packing.box if lattice_fdd is None else Box(lattice_fdd[f]),
                shapes=packing.shapes if orientation_fnq is None else packing.shapes.oriented(orientation_fnq[f]),
            ),
            None if touching_f is None else touching_f[f],
            None if mark is None else mark[f],
        )
        for f in _evenly(len(time_f), frames)
    )


def curves_of_trace(trace: Trace) -> dict[str, Curve]:
    """Return what to plot of a minimization's trace."""
    columns = trace.columns()
    named = ("energy", "pressure", "max_force", "contacts")
    return curves_of(trace.step_t, {name: columns[name] for name in named} | dict(trace.added))


def curves_of(
    step_t: NDArray[np.int64], columns: Mapping[str, NDArray[Any]], linear: tuple[str, ...] = ()
) -> dict[str, Curve]:
    """Return the columns that are plotted against step, under the labels of their observables.

    The viewer has no logarithmic axis, so logarithms are taken here and zeros left out.

    Parameters
    ----------
    step_t
        (T,) steps.
    columns
        (T,) numbers by the name of their observable; others are plotted as they are.
    linear
        Those that are plotted without a logarithm here, whatever the declaration says.

    """
    curves: dict[str, Curve] = {}
    for name, value_t in columns.items():
        known = OBSERVABLES.get(name)
        label = name.replace("_", " ") if known is None or not known.label else known.label
        plot = "linear" if known is None or name in linear else known.plot
        if plot == "log10":
            positive_t = value_t > 0.0
            curves[f"log10 {label}"] = (step_t[positive_t], np.log10(value_t[positive_t]))
        elif plot == "linear" and value_t.ndim == 1:
            finite_t = np.isfinite(value_t)
            if not finite_t.any():
                continue
            curves[label] = (step_t[finite_t], value_t[finite_t].astype(float))
    return curves


def trace_of(scene: Scene, step_t: Sequence[int], packing_t: Sequence[Packing]) -> Trace:
    """Return the trace of packings of one scene that were kept on the way, with their energies and forces.

    Packings in which nothing touches are left out.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.1)
    >>> trace_of(pm.Scene(crystal, (pm.Repulsion(),)), [0], [crystal]).contacts_t.tolist()
    [27]

    """
    # the pairs of a hard packing touch to rounding only: there is no force to draw
    kept = [
        (step, packing) for step, packing in zip(step_t, packing_t, strict=True) if len(touching_pairs(packing)) > 0
    ]
    scenes = [scene.replace(packing=packing) for _, packing in kept]
    if not scenes:
        kept, scenes = [(0, scene.packing)], [scene]
    rows = [
        {
            "step": step,
            "energy": energy(one),
            "pressure": pressure(one),
            "contacts": len(acting_contacts(touching_pairs(one.packing), one.effects)),
            "max_force": force_balance(one)[0],
            **measure_added(partial(State, one.packing, one.effects, step)),
        }
        for (step, _), one in zip(kept, scenes, strict=True)
    ]
    return Trace.of_rows(
        rows,
        position_tnd=np.array([_in_images_of(scene.packing, one.packing) for one in scenes]),
        lattice_tdd=np.array([one.packing.box.lattice_dd for one in scenes]),
        orientation_tnq=orientations_of([one.packing for one in scenes]),
    )


def _in_images_of(start: Packing, packing: Packing) -> NDArray[np.float64]:
    """Return the positions moved by lattice vectors so that links have the images that they have in the start."""
    if start.links == packing.links:
        return packing.position_nd
    now, _ = image_offsets(packing.links, packing.particles)
    before, _ = image_offsets(start.links, start.particles)
    moved: NDArray[np.float64] = packing.position_nd + (now - before) @ packing.box.lattice_dd.T
    return moved


def motions_of(modes: Any, packing: Packing, stiffness: float, count: int) -> list[DrawnMode]:
    """Return the lowest modes that are no free motions, at most `count` of them.

    Raises
    ------
    TypeError, ValueError
        When the modes are none, or belong to another packing.

    """
    if not hasattr(modes, "displacement_mnd"):
        raise TypeError(f"modes must be what pm.normal_modes returns, got {brief(modes)}")
    displacement_mnd = np.asarray(modes.displacement_mnd)
    if displacement_mnd.shape[1:] != packing.position_nd.shape:
        raise ValueError(
            f"modes must be those of the packing with positions of shape {packing.position_nd.shape}, "
            f"got displacements of shape {displacement_mnd.shape[1:]}"
        )
    vibrating = np.flatnonzero(np.abs(modes.eigenvalue_m) > FREE_MOTION * stiffness)[:count]
    return [
        DrawnMode(f"mode_{rank}", f"mode {rank}: frequency {modes.frequency_m[m]:.4g}", displacement_mnd[m])
        for rank, m in enumerate(vibrating, start=1)
    ]


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


@dataclass(frozen=True, eq=False)
class DrawnFrame:
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


def draw_moving(frame: PackingFrame, effects: Sequence[Any]) -> DrawnFrame:
    """Return what to draw of a packing in motion, all of it inside the cell.

    Parameters
    ----------
    frame
        The frame.
    effects
        Effects whose forces are drawn where no contacts were kept; bonds and walls among them are drawn too.

    """
    packing, effects = frame.packing, tuple(effects)
    cell = drawing.ShownCell(packing)
    shown = packing.replace(links=None, position_nd=cell.inside_nd, box=cell.box)
    d = packing.dimension
    none, zero = np.zeros((0, 2, d)), np.zeros(0)
    touching = frame.touching
    if touching is None:
        drawn = drawing.draw_packing(shown, tuple(one for one in effects if hasattr(type(one), "pair_energy")))
        sticking, sticking_force = drawn.segment_sed, drawn.force_s
        sliding, sliding_force = none, zero
    else:
        drawn = drawing.draw_packing(shown)
        segments, pair_s, _ = cell.lines(touching.i_c, touching.j_c, touching.image_cd)
        mean = float(touching.normal_c.mean()) if len(touching.normal_c) else 0.0
        force_s = touching.normal_c[pair_s] / mean if mean > 0.0 else np.zeros(len(pair_s))
        slides_s = touching.sliding_c[pair_s]
        sticking, sticking_force = segments[~slides_s], force_s[~slides_s]
        sliding, sliding_force = segments[slides_s], force_s[slides_s]
    links = packing.links
    line_sed, link_s, _ = cell.lines(links.i_l, links.j_l, links.image_ld)
    shape_s = links.shape_l[link_s]
    drawn = replace(  # the forces of links are not kept
        drawn,
        bond_sed=line_sed[~shape_s],
        bond_tension_s=np.zeros(int((~shape_s).sum())),
        shape_sed=line_sed[shape_s],
        shape_tension_s=np.zeros(int(shape_s.sum())),
    )
    bonds = bonds_of(effects)
    bond, pull = none, zero
    if bonds is not None and frame.broken_e is not None:
        bonds = bonds.select(~np.isin(np.arange(len(bonds)), frame.broken_e))
    if bonds is not None and len(bonds):
        bond, pair_s, vector = cell.lines(bonds.i_b, bonds.j_b, bonds.image_bd)
        extension = np.linalg.norm(vector, axis=1) / bonds.rest_length_b - 1.0
        mean = float(np.abs(extension).mean())
        pull = extension[pair_s] / mean if mean > 0.0 else np.zeros(len(pair_s))
    mark = none
    if frame.mark_nd is not None:
        reach = packing.radius_n[:, None] * frame.mark_nd
        mark = np.stack([cell.inside_nd + MARK_FROM * reach, cell.inside_nd + MARK_TO * reach], axis=1)
    return DrawnFrame(
        drawn,
        sticking,
        sticking_force,
        sliding,
        sliding_force,
        bond,
        pull,
        mark,
        drawing.wall_outlines(effects if frame.effects is None else frame.effects, cell.box),
    )
