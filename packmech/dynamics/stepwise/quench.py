"""`QuenchBatch`: many packings of one kind, strained and relaxed step by step by outside hands."""

from __future__ import annotations

import itertools
import weakref
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import finite_array, instance, integer, one_of, positive, real
from packmech.dynamics.damped import DampedDynamics
from packmech.dynamics.fire import Fire, Fire2
from packmech.dynamics.program import OUTCOME_OF, Program, build_program
from packmech.dynamics.stepwise import quench_kernels as qk
from packmech.dynamics.stepwise.quench_parts import bodies_of, settings_of, soften
from packmech.links import Links
from packmech.outcome import Outcome
from packmech.packing import Packing
from packmech.scene import Scene

# whether a status code is a success
_SUCCESS = np.array([OUTCOME_OF[code].ok for code in sorted(OUTCOME_OF)])
# threads take up this many shares each, as packings take unequal times
_SHARES = 8
# packing fractions below which nothing of interest happens, and above which pairs are too many
_LIMITS = {2: (0.1, 1.3), 3: (0.05, 1.1)}


class QuenchBatch:
    """A batch of packings that are strained, then relaxed, in one compiled call on any number of threads.

    Every packing has particles of the same number, and the scene's effects. A step changes the packing fraction of each
    by scaling its box, shears it, and then minimizes the energy in the box as it is. Scaling and shear carry particles
    along, or the centers of clusters of linked particles, which keep their shape; a cluster that winds around the box
    is strained with it. What one packing does never depends on the others, nor on the number of threads, to the bit.

    Figures are arrays with one entry for each packing, of the present moment: `packing_fraction_b` [1], `energy_b`
    [energy], `pressure_b` [energy/length^d], `stress_bdd` (Cauchy, tension positive), `max_force_b`, the largest net
    force on a particle, and `mean_force_b`, the mean contact force [force], `contacts_b`, `rattlers_b` and
    `excess_contacts_b`, see `step`, `strain_b`, all shear since the restart [1], `steps_b` and `force_evaluations_b` of
    the last step.

    Parameters
    ----------
    scene
        The scene whose packing all start from; effects without an energy have no part, as in pm.quench.
    batch
        How many packings.
    relax
        "full": every step relaxes to the tolerance, and the minimizer starts anew each time. A number k: every step
        takes k steps of the minimizer, which goes on where it was, so that the quench itself can be watched.
    force_tolerance
        Largest net force over mean contact force at which a packing counts as relaxed [1].
    force_floor
        Mean contact force at which it counts as unjammed [energy_scale / reference diameter].
    method
        pm.Fire(), pm.Fire2() or pm.DampedDynamics(); None: Fire().
    step_limit
        Most steps of a full relaxation.
    packing_fraction_limits
        (low, high) between which steps keep the packing fraction [1]; None: (0.1, 1.3) in two dimensions, (0.05, 1.1)
        in three.
    threads
        How many packings are advanced at a time.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=1)
    >>> batch = pm.QuenchBatch(pm.Scene(packing, (pm.Repulsion(),)), 2, force_tolerance=1e-8)
    >>> batch.step([-0.1, 0.0], [0.0, 0.01])
    >>> batch.packing_fraction_b.round(6).tolist(), [batch.outcome(b).name for b in range(2)]
    ([0.8, 0.9], ['UNJAMMED', 'CONVERGED'])

    """

    def __init__(
        self,
        scene: Scene,
        batch: int = 1,
        *,
        relax: str | int = "full",
        force_tolerance: float = 1e-8,
        force_floor: float = 0.0,
        method: Fire | Fire2 | DampedDynamics | None = None,
        step_limit: int = 100_000,
        packing_fraction_limits: ArrayLike | None = None,
        threads: int = 1,
    ) -> None:
        instance("scene", scene, Scene)
        self.scene = scene
        self.batch = integer("batch", batch, at_least=1)
        if isinstance(relax, str):
            one_of("relax", relax, ("full",))
            self.relax: str | int = relax
        else:
            self.relax = integer("relax", relax, at_least=1)
        limits = _LIMITS[scene.packing.dimension] if packing_fraction_limits is None else packing_fraction_limits
        low, high = finite_array("packing_fraction_limits", limits, shape=(2,), what="limit").tolist()
        if not 0.0 < low < high:
            raise ValueError(f"packing_fraction_limits must be positive and rise, got ({low:g}, {high:g})")
        self.packing_fraction_limits = (low, high)
        self.force_tolerance = positive("force_tolerance", force_tolerance)
        floor = real("force_floor", force_floor, at_least=0.0) * scene.energy_scale / scene.packing.reference_diameter
        limit = integer("step_limit", step_limit, at_least=1)
        self.threads = integer("threads", threads, at_least=1)
        method = Fire() if method is None else method
        if not isinstance(method, Fire | Fire2 | DampedDynamics):
            raise TypeError(f"method must be Fire(), Fire2() or DampedDynamics(), got {method!r}")
        self._programs: list[Program] = []
        program = build_program(scene)
        self._effects, self._axes = program.effects, program.axes
        begun = method.start(program)
        self._start_k, self._vectors = begun.number.copy(), begun.vector_kf
        self._settings, cap = settings_of(method, scene)
        full = self.relax == "full"
        self._orders = qk.Orders(
            steps=limit if isinstance(self.relax, str) else self.relax,
            anew=full,
            force_tolerance=self.force_tolerance,
            force_floor=floor,
            cap=cap * program.step_unit,
            low=low,
            high=high,
        )
        self._figure_bk = np.zeros((self.batch, qk.FIGURES))
        self._stress_bdd = np.zeros((self.batch, 3, 3))
        self._none_b = np.zeros(self.batch)
        self._slots: Any = None
        self._all = np.arange(self.batch)
        self._pool: ThreadPoolExecutor | None = None
        for b in range(self.batch):
            self._place(b, build_program(scene) if b else program)
        self._advance(self._all, self._none_b, self._none_b, relax=False)

    # what a step reads and writes

    def restart(self, index: int, packing: Packing, *, relax: bool = False) -> None:
        """Put a packing in the place of another. Nothing of what was there is kept: no list, velocity or count.

        Under a law that diverges at the center, deep overlaps are first relaxed with the harmonic law, as in pm.quench.

        Parameters
        ----------
        index
            Which one.
        packing
            The packing, with as many particles as the scene's; with links if that has links.
        relax
            Take the minimizer's steps of a step, in the box as it is.

        """
        b = self._index(index)
        instance("packing", packing, Packing)
        own = self.scene.packing
        if (packing.particles, packing.dimension) != (own.particles, own.dimension):
            raise ValueError(
                f"packing must have {own.particles} particles in {own.dimension} dimensions, "
                f"got {packing.particles} in {packing.dimension}"
            )
        if (packing.links is None) != (own.links is None):
            raise ValueError(f"packing must have links just if the scene's has, got {packing.links!r:.60}")
        instance("relax", relax, bool)
        program = build_program(self.scene.replace(packing=packing))
        soften(program)
        self._figure_bk[b] = 0.0
        self._place(b, program)
        self._advance(np.array([b]), self._none_b, self._none_b, relax=relax)

    def step(
        self,
        packing_fraction_change_b: ArrayLike,
        shear_strain_b: ArrayLike,
        *,
        active_b: ArrayLike | None = None,
    ) -> None:
        """Strain every packing, or the active ones, and relax it.

        Contacts are counted between particles, or clusters, with more than d of them, again and again: `rattlers_b` are
        the particles of the others. `excess_contacts_b` is their number less that of one state of self stress in a box
        of fixed shape, N_dof - d + 1, N_dof the motions of what is no rattler. It may be negative. Where forces or
        links would be lost, a packing stays where it was before the step, with Outcome.STALLED.

        Parameters
        ----------
        packing_fraction_change_b
            (B,) changes of the packing fraction [1], kept inside the limits.
        shear_strain_b
            (B,) simple shear along the first axis with its gradient along the second, in [-1, 1] [1].
        active_b
            (B,) which packings to advance; None: all.

        Raises
        ------
        TypeError, ValueError
            Numbers of another shape, not finite, or too large.

        """
        change = finite_array(
            "packing_fraction_change_b", packing_fraction_change_b, shape=(self.batch,), what="packing"
        )
        strain = finite_array("shear_strain_b", shear_strain_b, shape=(self.batch,), what="packing")
        if (np.abs(strain) > 1.0).any():
            b = int(np.argmax(np.abs(strain)))
            raise ValueError(f"shear_strain_b must lie between -1 and 1, got {strain[b]} for packing {b}")
        if active_b is None:
            index = self._all
        else:
            active = np.asarray(active_b)
            if active.dtype != np.bool_ or active.shape != (self.batch,):
                raise TypeError(f"active_b must be ({self.batch},) booleans, got {active_b!r:.60}")
            index = np.flatnonzero(active)
        self._advance(index, change, strain, relax=True)

    def packing(self, index: int) -> Packing:
        """Return a packing as it is now; its lattice vectors and images may be others of the same lattice.

        Parameters
        ----------
        index
            Which one.

        """
        program = self._programs[self._index(index)]
        self._follow_box(program)
        return program.scene.packing.replace(position_nd=program.positions(), box=program.box)

    def outcome(self, index: int) -> Outcome:
        """Return how the last relaxation of a packing ended; STEP_LIMIT while it is on its way.

        Parameters
        ----------
        index
            Which one.

        """
        return OUTCOME_OF[int(self._figure_bk[self._index(index), qk.STATUS])]

    @property
    def packing_fraction_b(self) -> NDArray[np.float64]:
        """The (B,) packing fractions [1]."""
        return self._figures(qk.FRACTION)

    @property
    def energy_b(self) -> NDArray[np.float64]:
        """The (B,) energies [energy]."""
        return self._figures(qk.ENERGY)

    @property
    def pressure_b(self) -> NDArray[np.float64]:
        """The (B,) pressures [energy/length^d]."""
        return self._figures(qk.PRESSURE)

    @property
    def stress_bdd(self) -> NDArray[np.float64]:
        """The (B, d, d) Cauchy stresses, tension positive [energy/length^d]."""
        d = len(self._axes)
        return self._stress_bdd[:, :d, :d] + 0.0

    @property
    def max_force_b(self) -> NDArray[np.float64]:
        """The (B,) largest net forces on a particle [force]."""
        return self._figures(qk.MAX_FORCE)

    @property
    def mean_force_b(self) -> NDArray[np.float64]:
        """The (B,) mean contact forces [force]."""
        return self._figures(qk.MEAN_FORCE)

    @property
    def contacts_b(self) -> NDArray[np.int64]:
        """The (B,) numbers of touching pairs."""
        return self._figures(qk.CONTACTS).astype(np.int64)

    @property
    def rattlers_b(self) -> NDArray[np.int64]:
        """The (B,) numbers of particles that too few contacts hold."""
        return self._figures(qk.RATTLERS).astype(np.int64)

    @property
    def excess_contacts_b(self) -> NDArray[np.int64]:
        """The (B,) contacts beyond those of one state of self stress."""
        return self._figures(qk.EXCESS).astype(np.int64)

    @property
    def strain_b(self) -> NDArray[np.float64]:
        """The (B,) sums of the shear strains since the restart [1]."""
        return self._figures(qk.STRAIN)

    @property
    def steps_b(self) -> NDArray[np.int64]:
        """The (B,) steps that the minimizer took in the last step."""
        return self._figures(qk.STEPS).astype(np.int64)

    @property
    def force_evaluations_b(self) -> NDArray[np.int64]:
        """The (B,) passes over the forces in the last step, the one for the figures among them."""
        return self._figures(qk.EVALUATIONS).astype(np.int64)

    @property
    def relaxed_b(self) -> NDArray[np.bool_]:
        """The (B,) answers whether the last relaxation met the tolerance, or found that nothing touches."""
        return np.asarray(_SUCCESS[self._figure_bk[:, qk.STATUS].astype(np.int64)])

    # within

    def _figures(self, k: int) -> NDArray[np.float64]:
        return self._figure_bk[:, k] + 0.0  # no negative zeros

    def _index(self, index: int) -> int:
        return integer("index", index, at_least=0, at_most=self.batch - 1)

    def _place(self, b: int, program: Program, number_k: NDArray[np.float64] | None = None) -> None:
        number = self._start_k.copy() if number_k is None else number_k
        slot = (
            program.row, program.force_nd, program.velocity_nd, program.space, program.pairs, bodies_of(program),
            number, self._vectors.copy(),
        )  # fmt: skip
        if self._slots is None:
            self._slots = qk.new_slots(slot)
        else:
            qk.put_slot(self._slots, b, slot)
        if b == len(self._programs):
            self._programs.append(program)
            self._numbers.append(number)
        else:
            self._programs[b] = program
            self._numbers[b] = number

    def _advance(self, index_k: Any, change_b: Any, strain_b: Any, *, relax: bool) -> None:
        orders = self._orders if relax else self._orders._replace(steps=-1)
        count = len(index_k)

        def share(low: int, high: int) -> None:
            qk.advance_slots(
                self._slots, index_k, low, high, self._effects, self._axes, self._settings, orders, self._start_k,
                change_b, strain_b, self._figure_bk, self._stress_bdd,
            )  # fmt: skip

        size = max(1, -(-count // (_SHARES * self.threads)))
        if self.threads == 1 or count <= size:
            share(0, count)
        else:
            places = itertools.count(0, size)

            def work() -> None:
                while (low := next(places)) < count:
                    share(low, min(low + size, count))

            pool = self._threads()
            others = [pool.submit(work) for _ in range(self.threads - 1)]
            try:
                work()
            finally:
                for other in others:
                    other.result()
        for b in index_k[self._figure_bk[index_k, qk.OUTSIDE] > 0.0]:
            self._bring_home(int(b))

    def _threads(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads - 1)
            weakref.finalize(self, self._pool.shutdown, wait=False)
        return self._pool

    def _follow_box(self, program: Program) -> None:
        d = len(self._axes)
        back = np.rint(np.linalg.inv(program.change_dd))
        program.box = Box(program.space.frame.lattice_dd[:d, :d] @ back)

    def _bring_home(self, b: int) -> None:
        """Choose short lattice vectors, and particles in their cell; velocities and the minimizer go on."""
        old = self._programs[b]
        packing = self.packing(b)
        box, change = packing.box.reduced()
        links = packing.links
        if links is not None:
            back = np.rint(np.linalg.inv(change)).astype(np.int64)
            links = Links(links.i_l, links.j_l, links.image_ld @ back.T, links.length_l, links.shape_l)
        program = build_program(self.scene.replace(packing=packing.replace(box=box, links=links).wrapped()))
        velocity = np.empty_like(old.velocity_nd)
        velocity[old.order_n] = old.velocity_nd
        program.velocity_nd[:] = velocity[program.order_n]
        self._place(b, program, self._numbers[b])

    @property
    def _numbers(self) -> list[NDArray[np.float64]]:
        return cast("list[NDArray[np.float64]]", self.__dict__.setdefault("_number_lists", []))
