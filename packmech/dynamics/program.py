"""The program: a scene compiled to one loop over exactly the effects that it names."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import finite_array, instance, integer, positive, real
from packmech.contacts.cells import Sizes, frame_of, size_levels
from packmech.dynamics.fire import Fire
from packmech.dynamics.joints import make_joints
from packmech.dynamics.kernels import (
    CONVERGED,
    FLOOR,
    NOT_FINITE,
    RUNNING,
    STALLED,
    UNJAMMED,
    Goal,
    Space,
    evaluate,
)
from packmech.dynamics.method import Evaluation, Minimizer, Progress, Relaxation
from packmech.dynamics.pair_list import SKIN_FULL, PairList, empty_list, strain_list
from packmech.dynamics.tether import workable_links
from packmech.effects import pair_energy, refuse_bound
from packmech.links import Links
from packmech.outcome import Outcome
from packmech.packing import Packing
from packmech.scene import Scene

# skin of the wide pair list in units of the harmonic mean diameter, which many small or a few tiny particles set alike
_SKIN = 0.6

OUTCOME_OF = {
    RUNNING: Outcome.STEP_LIMIT,
    CONVERGED: Outcome.CONVERGED,
    FLOOR: Outcome.ROUNDING_FLOOR,
    UNJAMMED: Outcome.UNJAMMED,
    NOT_FINITE: Outcome.STALLED,
    STALLED: Outcome.STALLED,
}


@dataclass(eq=False)
class Program:
    """A scene compiled for its effects, with its working arrays: rows sorted in space, velocities and pair lists.

    The rows are sorted once, when the program is built, by the places of the particles; relabelled particles therefore
    go through the same arithmetic. Build one with `build_program`; one program serves many positions and boxes of the
    same particles, one at a time.

    Attributes
    ----------
    scene
        The scene it was built from.
    effects
        Those of its effects that have an energy.
    order_n
        (N,) particle of each row.
    diverges
        Whether the energy of two particles grows beyond measure as their centers meet.
    links
        The links between rows, if there are any.
    build_seconds
        CPU seconds spent on building.

    """

    scene: Scene
    effects: tuple[Any, ...]
    order_n: NDArray[np.int64]
    axes: tuple[int, ...]
    row: NDArray[np.float64]
    force_nd: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    sizes: Sizes
    home_nd: NDArray[np.float64]
    box: Box
    change_dd: NDArray[np.int64]
    space: Space
    pairs: PairList
    diverges: bool
    links: Links | None = None
    build_seconds: float = 0.0

    @property
    def step_unit(self) -> float:
        """Unit of a method's largest step [length]: the largest diameter; the smallest under a law that diverges."""
        radius = self.row[:, 3]
        return 2.0 * float(radius.min() if self.diverges else radius.max())

    @property
    def chunk(self) -> int:
        """Steps of some tens of milliseconds: compiled loops come back as often, so that an interrupt is seen."""
        return max(1, 1_000_000 // self.velocity_nd.size)

    def place(self, position_nd: ArrayLike, lattice_dd: ArrayLike | None = None) -> None:
        """Put the particles at the given positions, in the given box, at rest.

        Pair lists are kept as far as they still hold: they follow an affine change of the box and are checked against
        what is left of the displacements.

        Parameters
        ----------
        position_nd
            (N, d) positions in the order of the scene's packing [length].
        lattice_dd
            (d, d) lattice vectors as columns [length]; the present box when left out.

        """
        d = len(self.axes)
        position = finite_array("position_nd", position_nd, shape=(len(self.order_n), d))
        affine = np.eye(d)
        if lattice_dd is not None and not np.array_equal(lattice_dd, self.box.lattice_dd):
            box = lattice_dd if isinstance(lattice_dd, Box) else Box(np.asarray(lattice_dd, dtype=np.float64))
            affine = box.lattice_dd @ self.box.inverse_dd
            self._set_box(box)
        self.row[:, :d] = (position - self.home_nd @ self.box.lattice_dd.T)[self.order_n]
        self.velocity_nd[:] = 0.0
        extent = max(float(np.abs(self.row[:, :d]).max()), float(np.abs(self.space.frame.lattice_dd[:d, :d]).max()))
        self.space = self.space._replace(resolution=np.finfo(np.float64).eps * extent)
        strain_list(self.pairs, affine, 4.0 * float(self.sizes.largest_a.max()))

    def _set_box(self, box: Box) -> None:
        self.box = box
        lattice = Box(box.lattice_dd @ self.change_dd)
        shortest = box.reduced()[0].height_d.min()
        if lattice.height_d.min() < 0.3 * shortest:
            # the box was strained so far that other vectors are short now: start the lists afresh
            lattice, self.change_dd = box.reduced()
            self.pairs = empty_list(len(self.order_n), float(self.pairs.number[SKIN_FULL]))
            self.join()
        self.space = self.space._replace(frame=frame_of(lattice))

    def join(self) -> None:
        """Make the links anew, for the lattice vectors that the loops use."""
        packing = self.scene.packing
        if packing.links is not None:
            self.links, joints = make_joints(
                packing, workable_links(packing), self.order_n, self.home_nd, self.change_dd
            )
            self.space = self.space._replace(joints=joints)

    def _link_virial(self) -> NDArray[np.float64]:
        """Return the links' part of V times the stress, at the last evaluation."""
        joints, d = self.space.joints, len(self.axes)
        if joints is None or self.links is None:
            return np.zeros((d, d))
        vector = self.links.vectors(self.row[:, :d], self.space.frame.lattice_dd[:d, :d])
        distance = np.sqrt((vector**2).sum(axis=1))
        return np.asarray(np.einsum("l,la,lb->ab", joints.multiplier_l / distance, vector, vector))

    def positions(self) -> NDArray[np.float64]:
        """Return the (N, d) positions in the order of the scene's packing [length]."""
        d = len(self.axes)
        position = np.empty((len(self.order_n), d))
        position[self.order_n] = self.row[:, :d]
        return position + self.home_nd @ self.box.lattice_dd.T

    def evaluate(self, position_nd: ArrayLike | None = None, lattice_dd: ArrayLike | None = None) -> Evaluation:
        """Return energy, stress, forces and contacts at the given, or else the present, positions.

        Parameters
        ----------
        position_nd, lattice_dd
            As in `place`.

        """
        if position_nd is not None:
            self.place(position_nd, lattice_dd)
        sums, totals, self.pairs = evaluate(
            self.effects, self.axes, self.row, self.force_nd, self.velocity_nd, self.space, self.pairs
        )
        d = len(self.axes)
        force = np.empty((len(self.order_n), d))
        force[self.order_n] = self.force_nd
        stress = totals.virial_dd[:d, :d] / self.box.volume
        if self.links is not None:
            stress += self._link_virial() / self.box.volume
        mean = sums.total / sums.touching if sums.touching else 0.0
        largest = math.sqrt(sums.most)
        return Evaluation(
            energy=float(totals.energy),
            pressure=(0.0 - float(np.trace(stress))) / d,
            stress_dd=stress,
            contacts=int(sums.touching),
            max_force=largest,
            mean_force=mean,
            residual=largest / mean if mean > 0 else 0.0,
            force_nd=force,
            force_floor=float(totals.stiffness * self.space.resolution),
            deepest_overlap=float(totals.deepest),
        )

    def progress(self, numbers: int, vectors: int) -> Progress:
        """Return the empty state of a minimization: so many numbers, and so many vectors over all coordinates."""
        return Progress(np.zeros(numbers), np.zeros((vectors, self.velocity_nd.size)))

    def advance(
        self,
        steps_kernel: Any,
        settings: Any,
        goal: Goal,
        progress: Progress,
        steps: int,
        largest_step: float | None = None,
    ) -> int:
        """Run a minimizer's compiled loop for up to `steps` steps; return its status code.

        Parameters
        ----------
        steps_kernel
            The loop.
        settings
            The record of its numbers.
        goal, progress, steps
            When to stop, the state, which is updated, and the largest number of steps.
        largest_step
            Bound on every particle's displacement in a step [step_unit]; that of the settings when left out.

        """
        cap = settings.largest_step if largest_step is None else largest_step
        status, self.pairs = steps_kernel(
            self.effects,
            self.axes,
            self.row,
            self.force_nd,
            self.velocity_nd,
            self.space,
            self.pairs,
            settings,
            goal,
            cap * self.step_unit,
            progress.number,
            progress.vector_kf,
            steps,
        )
        return int(status)

    def relax(
        self,
        position_nd: ArrayLike | None = None,
        lattice_dd: ArrayLike | None = None,
        *,
        force_tolerance: float,
        method: Minimizer | None = None,
        step_limit: int = 500_000,
        force_floor: float = 0.0,
    ) -> Relaxation:
        """Return where a minimizer ends in the box as it is; a failure to converge is told by `outcome` only.

        Parameters
        ----------
        position_nd, lattice_dd
            As in `place`; the present positions when left out.
        force_tolerance
            Stop when the largest net force falls to this times the mean contact force [1].
        method
            Fire() unless given.
        step_limit
            Largest number of steps.
        force_floor
            Call the packing unjammed when the mean contact force falls to this [force].

        """
        goal = Goal(positive("force_tolerance", force_tolerance), real("force_floor", force_floor, at_least=0.0))
        limit = integer("step_limit", step_limit, at_least=0)
        method = Fire() if method is None else method
        if position_nd is None:
            self.velocity_nd[:] = 0.0
        else:
            self.place(position_nd, lattice_dd)
        progress = method.start(self)
        while True:
            status = method.advance(self, goal, progress, min(self.chunk, limit - progress.steps))
            if status != RUNNING or progress.steps >= limit:
                break
        outcome = OUTCOME_OF[status]
        end = self.evaluate()
        return Relaxation(
            position_nd=self.positions(),
            outcome=outcome,
            residual=end.residual,
            max_force=end.max_force,
            mean_force=end.mean_force,
            energy=end.energy,
            pressure=end.pressure,
            contacts=end.contacts,
            steps=progress.steps,
            force_evaluations=progress.force_evaluations + 1,
        )

    def fire(
        self, position_nd: ArrayLike | None = None, lattice_dd: ArrayLike | None = None, **settings: Any
    ) -> Relaxation:
        """Return where FIRE ends: `relax` with its usual method.

        Parameters
        ----------
        position_nd, lattice_dd, settings
            As in `relax`.

        """
        return self.relax(position_nd, lattice_dd, **settings)


def space_order(packing: Packing) -> NDArray[np.int64]:
    """Return the order of rows: along a Z-shaped curve through the box, ties by place and radius."""
    d = packing.dimension
    box, _ = packing.box.reduced()
    fraction = packing.position_nd @ box.inverse_dd.T
    fraction -= np.floor(fraction)
    bits = max(1, int(np.ceil(np.log2(packing.particles) / d)) + 1)
    cell = np.minimum((fraction * (1 << bits)).astype(np.int64), (1 << bits) - 1)
    key = np.zeros(packing.particles, dtype=np.int64)
    for b in range(bits):
        for k in range(d):
            key |= ((cell[:, k] >> b) & 1) << (d * b + k)
    order: NDArray[np.int64] = np.lexsort((packing.radius_n, *fraction.T[::-1], key))
    return order


def _diverges(scene: Scene) -> bool:
    sigma = scene.packing.reference_diameter
    try:
        near = sum(float(pair_energy(one, 0.01 * sigma, sigma)) for one in scene.effects)
    except (OverflowError, ZeroDivisionError, ValueError):
        return True
    return not near < 1e3 * scene.energy_scale


def build_program(scene: Scene) -> Program:
    """Return the scene compiled for its effects, its particles sorted in space.

    Parameters
    ----------
    scene
        The scene; effects without an energy (damping) have no part in minimization and are left out.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.0, 0.0], [0.5, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    >>> program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
    >>> program.evaluate().force_nd[1].tolist()
    [0.5, 0.0]
    >>> program.fire(force_tolerance=1e-10).outcome.name
    'UNJAMMED'

    """
    started = time.process_time()
    instance("scene", scene, Scene)
    packing = scene.packing
    refuse_bound("effects", scene.effects)
    effects = tuple(one for one in scene.effects if hasattr(type(one), "pair_energy"))
    if not effects:
        raise ValueError("effects must contain one with an energy, such as Repulsion(...), got none")
    d = packing.dimension
    fraction = packing.position_nd @ packing.box.inverse_dd.T
    # positions stay as given unless some lie far outside: their image vectors would make the table of images long
    home = np.where((fraction < -1.0) | (fraction >= 2.0), np.floor(fraction), 0.0)
    order = space_order(packing)
    row = np.zeros((packing.particles, 4))
    row[:, 3] = packing.radius_n[order]
    small, change = packing.box.reduced()
    sizes = size_levels(row[:, 3].copy())
    skin = _SKIN / float(np.mean(1.0 / packing.diameter_n))
    program = Program(
        scene=scene,
        effects=effects,
        order_n=order,
        axes=tuple(range(d)),
        row=row,
        force_nd=np.zeros((packing.particles, d)),
        velocity_nd=np.zeros((packing.particles, d)),
        sizes=sizes,
        home_nd=home,
        box=packing.box,
        change_dd=change,
        space=Space(sizes, frame_of(small), 0.0),
        pairs=empty_list(packing.particles, skin),
        diverges=_diverges(scene),
    )
    program.join()
    program.place(packing.position_nd)
    program.build_seconds = time.process_time() - started
    return program


__all__ = ["OUTCOME_OF", "Evaluation", "Minimizer", "Program", "Relaxation", "build_program"]
