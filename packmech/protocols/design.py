"""`design`: a packing or a network changed number by number, or bond by bond, until a figure is what is asked for."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import Row
from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import brief, finite_array, given_shape, instance, integer, one_of, real
from packmech.effects import Bonds, bonds_of
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.contact_forces import resting_forces
from packmech.mechanics.elasticity import elastic_moduli
from packmech.mechanics.sensitivity import FIGURES, sensitivity
from packmech.minimize.quench import quench
from packmech.packing import Packing
from packmech.protocols.jam import jam
from packmech.result import Condition, NotConverged, Outcome, Run
from packmech.scene import Scene

# what may be changed, and what is kept of it
NUMBERS = ("radius", "aspect", "exponent", "mass", "rest_length", "bonds")
KEPT = ("nothing", "mean", "mean and deviation")
# net force over mean contact force of the packings in between, and the pressure at which hard ones are sought
_AT_REST, _PRESSURE = 1e-12, 1e-6
# bonds that are tried at each step, those first that promise most
_TRIED = 10
# relative change of the figure at which the optimizer ends
_ENDS = 1e-9
# rounds in which numbers that are to keep their mean and deviation are brought within their bounds
_ROUNDS = 200

Objective = Callable[[Scene], tuple[float, ArrayLike]]


class _Reached(Exception):  # noqa: N818 - no error
    """Raised within the optimizer where the goal is reached, or steps have run out."""


@dataclass(frozen=True, eq=False, repr=False)
class Design(Run):
    """What a design arrived at: the scene whose figure is the best that was found.

    Attributes
    ----------
    scene
        The scene, its packing at rest.
    figure, by
        What was asked for, and what was changed.
    goal
        The bound that was asked for, infinite where there was none.
    value_t
        (T,) figures of all packings that were made, in order; the first that of the start. nan where one failed.
    number_k
        The numbers at the end, as `by` names them; of bonds which are left, by their number at the start.

    """

    scene: Scene = field(kw_only=True)
    figure: str = field(kw_only=True)
    by: str = field(kw_only=True)
    goal: float = field(kw_only=True)
    value_t: NDArray[np.float64] = field(kw_only=True)
    number_k: NDArray[Any] = field(kw_only=True)

    @property
    def value(self) -> float:
        """The figure of the scene that was reached."""
        return float(self.report["value"])

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, {self.figure} by {self.by}"

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        goal = [] if math.isinf(self.goal) else [("goal", f"{self.goal:.8g}", "")]
        start = ("value at the start", f"{self.value_t[0]:.8g}", f"{len(self.value_t)} packings were made")
        return [*super().rows(), start, *goal]


class _State(NamedTuple):
    """A scene at rest, with the figure and its derivatives."""

    scene: Scene
    value: float
    gradient: NDArray[np.float64]


class _Design:
    """A design on its way: the best scene so far, and what was found on the way."""

    def __init__(
        self, scene: Scene, objective: str | Objective, by: str, goal: float, sign: float, loop: RunLoop, steps: int
    ) -> None:
        self.objective, self.by, self.goal, self.sign = objective, by, goal, sign
        self.loop, self.step_limit, self.began = loop, steps, time.process_time()
        self.value_t: list[float] = []
        self.evaluations = 0
        self.index_b = np.arange(len(bonds_of(scene.effects) or ()))
        self.start = scene
        self.best = self.last = _State(scene, math.nan, np.zeros(0))
        # why packings could not be made since the figure last got better
        self.failed: list[str] = []

    @property
    def hard(self) -> bool:
        """Whether the figure is that of a hard packing."""
        return self.objective == "packing_fraction"

    @property
    def reached(self) -> bool:
        """Whether the best figure meets the goal."""
        return self.sign * self.best.value <= self.sign * self.goal

    def remade(self, scene: Scene) -> Scene:
        """Return the scene at rest again."""
        if self.hard:
            run = jam(scene, _PRESSURE, strain="isotropic", progress=False)
            if "hard_packing" not in run.report:
                raise ValueError(
                    "scene must jam as a hard packing for objective='packing_fraction', got one of which pm.jam knows "
                    "none"
                )
            return scene.replace(packing=run.report["hard_packing"])
        if self.by == "mass":
            return scene
        run = quench(scene, force_tolerance=_AT_REST, progress=False)
        self.evaluations += run.force_evaluations
        return scene.replace(packing=run.packing)

    def state(self, scene: Scene) -> _State:
        """Return a scene at rest with its figure and the derivatives of it."""
        if isinstance(self.objective, str):
            by = "bond_stiffness" if self.by == "bonds" else self.by
            found = sensitivity(scene, self.objective, by, one_sided=True)
            return _State(scene, found.value, found.gradient)
        value, gradient = self.objective(scene)
        shape = numbers_of(self.start, self.by).shape if self.by != "bonds" else (len(_bonds(scene)),)
        slopes = finite_array("objective's derivatives", gradient, shape=shape)
        return _State(scene, real("objective's figure", value), slopes)

    def keep(self, state: _State) -> None:
        """Take note of a figure, and end where it is what was asked for."""
        self.value_t.append(state.value)
        self.last, before = state, self.best.value
        if math.isnan(before) or self.sign * state.value < self.sign * before:
            self.best = state
            if not abs(state.value - before) <= _ENDS * abs(before):
                self.failed.clear()
        self._go_on(state.value)

    def fail(self, reason: str) -> None:
        """Take note of a packing that could not be made, and why."""
        self.value_t.append(math.nan)
        self.failed.append(reason)
        self._go_on(math.nan)

    def _go_on(self, value: float) -> None:
        """Report a figure, and end where the goal is reached or steps or time have run out."""
        self.loop.report("design", steps=len(self.value_t) - 1, value=value, best=self.best.value)
        if self.reached or len(self.value_t) > self.step_limit:
            raise _Reached
        self.loop.check_time()

    def ended(self) -> Outcome:
        """Return how the design ended, where nothing stopped it."""
        if self.reached:
            return Outcome.CONVERGED
        return Outcome.STEP_LIMIT if len(self.value_t) > self.step_limit else Outcome.STALLED

    def by_numbers(self, low_k: NDArray[np.float64], high_k: NDArray[np.float64], keep: str) -> Outcome:
        """Change numbers by sequential least-squares programming."""
        from scipy.optimize import minimize

        start = numbers_of(self.start, self.by)
        scale = float(np.abs(start).mean())
        size = max(abs(self.best.value), np.finfo(float).tiny)

        def at(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
            state = self._evaluated(_as_kept(scale * x, start, keep, low_k, high_k))
            return self.sign * state.value / size, self.sign * scale * state.gradient / size

        found = minimize(
            at, start / scale, jac=True, method="SLSQP", bounds=list(zip(low_k / scale, high_k / scale, strict=True)),
            constraints=_kept(start / scale, keep), options={"maxiter": self.step_limit, "ftol": _ENDS},
        )  # fmt: skip
        # with nothing asked for but the best, an end at an optimum is what was asked for; where packings failed since
        # the last gain, the optimizer ends for want of them
        optimum = found.status == 0 and not self.failed
        return Outcome.CONVERGED if math.isinf(self.goal) and optimum else self.ended()

    def _evaluated(self, number_k: NDArray[np.float64]) -> _State:
        """Return the packing relaxed again with other numbers; where it fails, something worse than all before."""
        if np.allclose(number_k, numbers_of(self.best.scene, self.by), rtol=1e-14, atol=0.0):
            return self.best
        changed = with_numbers(self.best.scene, self.by, number_k)
        try:
            state = self.state(self.remade(changed))
        except (NotConverged, ValueError) as error:
            self.fail(str(error))
            worse = self.sign * (abs(self.best.value) + abs(self.last.value))
            return _State(changed, worse, np.zeros_like(number_k))
        self.keep(state)
        return state

    def by_bonds(self) -> Outcome:
        """Take bonds away, at each step the one whose derivative promises most among those that leave it stable."""
        while True:
            better = self._without_one()
            if better is None:
                return self.ended()
            self.keep(better)

    def _without_one(self) -> _State | None:
        """Return the scene without one bond more; None where no bond that promises a gain gives one."""
        gain = self.sign * self.best.gradient
        for b in np.argsort(-gain, kind="stable")[:_TRIED]:
            if not gain[b] > 0.0:
                break
            self.loop.check_time()
            bonds = _bonds(self.best.scene)
            left = np.arange(len(bonds)) != b
            effects = tuple(bonds.select(left) if isinstance(one, Bonds) else one for one in self.best.scene.effects)
            try:
                scene = self.remade(self.best.scene.replace(effects=effects))
                moduli = elastic_moduli(scene)
                if not moduli.stable or moduli.floppy_positions or len(moduli.soft_directions):
                    continue
                state = self.state(scene)
            except (NotConverged, ValueError):
                continue
            if self.sign * state.value < self.sign * self.best.value:
                self.index_b = self.index_b[left]
                return state
        return None


def _bonds(scene: Scene) -> Bonds:
    bonds = bonds_of(scene.effects)
    assert bonds is not None
    return bonds


def _kept(start_k: NDArray[np.float64], keep: str) -> list[dict[str, Any]]:
    """Return the constraints that keep the mean, or the mean and the variance, of numbers."""
    count, mean = len(start_k), float(start_k.mean())
    rows = {
        "mean": (lambda x: x.mean() - mean, lambda x: np.full(count, 1.0 / count)),
        "deviation": (lambda x: x.var() - start_k.var(), lambda x: 2.0 * (x - x.mean()) / count),
    }
    return [{"type": "eq", "fun": value, "jac": slope} for name, (value, slope) in rows.items() if name in keep]


def _as_kept(
    number_k: NDArray[np.float64],
    start_k: NDArray[np.float64],
    keep: str,
    low_k: NDArray[np.float64],
    high_k: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return numbers within their bounds that keep what is to be kept: the optimizer keeps it at its end alone."""
    found = np.clip(number_k, low_k, high_k)
    for _ in range(_ROUNDS if keep != "nothing" else 0):
        spread = float(start_k.std() / found.std()) if "deviation" in keep and found.std() else 1.0
        found = start_k.mean() + spread * (found - found.mean())
        if ((found >= low_k) & (found <= high_k)).all():
            break
        found = np.clip(found, low_k, high_k)
    return found


def numbers_of(scene: Scene, by: str) -> NDArray[np.float64]:
    """Return the numbers of one kind that a scene has."""
    packing = scene.packing
    if by == "rest_length":
        return _bonds(scene).rest_length_b
    holder: Any = packing if by in ("radius", "mass") else packing.shapes
    found: NDArray[np.float64] = getattr(holder, f"{by}_n")
    return found


def with_numbers(scene: Scene, by: str, number_k: NDArray[np.float64]) -> Scene:
    """Return the scene with other numbers of one kind."""
    packing: Packing = scene.packing
    if by == "rest_length":
        changed = dataclasses.replace(_bonds(scene), rest_length_b=number_k)
        return scene.replace(effects=tuple(changed if isinstance(one, Bonds) else one for one in scene.effects))
    if by in ("radius", "mass"):
        return scene.replace(packing=packing.replace(**{f"{by}_n": number_k}))
    shapes: Any = packing.shapes
    return scene.replace(packing=packing.replace(shapes=dataclasses.replace(shapes, **{f"{by}_n": number_k})))


@honors("repulsion kinds bonds links shapes", at_rest=True)
def design(
    scene: Scene,
    objective: str | Objective,
    by: str,
    *,
    at_least: float | None = None,
    at_most: float | None = None,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    keep: str = "nothing",
    step_limit: int = 200,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Design:
    """Return the run that changes a scene until a figure of it is as large, or as small, as asked for.

    Derivatives of the figure by all numbers (`sensitivity`, one-sided where pairs are about to touch or to part) say
    how to change them. Each packing on the way is brought to rest again in its box, a hard one jammed again, so that
    every figure is that of a packing that is there.

    Parameters
    ----------
    scene
        The scene to begin with.
    objective
        A figure that `sensitivity` knows, such as "poisson_ratio" or "packing_fraction" (that of the hard packing of
        discs or spheres, by their radii: box and particles are jammed again); or a function of a scene at rest that
        returns a figure and its derivatives by the numbers, made of those of `sensitivity`.
    by
        What to change: "radius", "aspect", "exponent", "mass", or "rest_length" of bonds, all within bounds; or
        "bonds", which are taken away one by one as long as the rest stays stable to all strains and without floppy
        modes. Particles that a bond held apart, or together, then touch as others do.
    at_least, at_most
        The figure to reach, one of them: the run ends there. `at_most=-np.inf` or `at_least=np.inf`, no goal: as far as
        it goes.
    bounds
        Lowest and highest numbers, one for all or one for each; to be left out for "bonds".
    keep
        What is kept of the numbers: "nothing", their "mean", or their "mean and deviation".
    step_limit
        Largest number of packings that are made.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress("design", figures), figures a dict with "steps", "value" and "best".
    check
        Raise NotConverged when the goal is not reached; otherwise return the run all the same.

    Returns
    -------
    Design
        With the best scene that was found. Outcome.CONVERGED where the goal is reached, or an optimum where none was
        set; Outcome.STALLED at an optimum, or where no bond helps, short of the goal, or where packings beyond the best
        could not be made: `unmet` says how many, and why.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.
    NotConverged
        If the goal is not reached and `check` is set; its `.run` holds the best.
    KeyboardInterrupt
        Passed on with `.run` set to the best so far.

    Examples
    --------
    A network that grows wide when it is pulled:

    >>> import packmech as pm
    >>> start = pm.random_packing(48, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.96, seed=1)
    >>> scene = pm.Scene(start, (pm.Repulsion(),))
    >>> rest = pm.quench(scene, force_tolerance=1e-12).packing
    >>> bonds = pm.bond_contacts(rest, rest="distance", tangential_stiffness=0.0)
    >>> network = pm.Scene(rest.replace(radius_n=0.1 * rest.radius_n), (pm.Repulsion(), bonds))
    >>> run = pm.design(network, "poisson_ratio", "bonds", at_most=-0.3)
    >>> pm.elastic_moduli(run.scene).poisson_ratio <= -0.3, run.outcome.name
    (True, 'CONVERGED')

    """
    instance("scene", scene, Scene)
    one_of("by", by, NUMBERS)
    one_of("keep", keep, KEPT)
    if not callable(objective):
        if not isinstance(objective, str):
            raise TypeError(f"objective must be the name of a figure or a function of a scene, got {brief(objective)}")
        if objective not in FIGURES and not set(objective) <= set("xyz"):
            raise ValueError(
                f"objective must be one of {', '.join(FIGURES)}, a component, or a function, got {objective!r}"
            )
        if objective == "packing_fraction":
            _refuse_unhard(scene, by)
    sign, goal = _goal(at_least, at_most)
    low, high = _bounds(scene, by, bounds, keep)
    settings = run_settings(
        step_limit=integer("step_limit", step_limit, at_least=1), time_limit=time_limit, progress=progress, check=check
    )
    loop = RunLoop(settings)
    work = _Design(scene, objective, by, goal, sign, loop, step_limit)

    def go() -> Outcome:
        try:
            work.keep(work.state(work.remade(scene)))
            return work.by_bonds() if by == "bonds" else work.by_numbers(low, high, keep)
        except _Reached:
            return work.ended()

    def finished(outcome: Outcome) -> Design:
        best, seconds = work.best, time.process_time() - work.began
        name = objective if isinstance(objective, str) else getattr(objective, "__name__", "figure")
        hint = f"{len(work.failed)} packings since the best could not be made: {work.failed[-1]}" if work.failed else ""
        reached = [] if outcome.ok else [Condition(name, best.value, goal, hint=hint, lower=sign < 0)]
        residual = _residual(best.scene, work.hard and not math.isnan(best.value))
        return Design(
            best.scene.packing, outcome, residual, max(len(work.value_t) - 1, 0), work.evaluations, seconds,
            report={"value": best.value}, unmet=tuple(reached), scene=best.scene, figure=name, by=by, goal=goal,
            value_t=np.array(work.value_t),
            number_k=work.index_b if by == "bonds" else numbers_of(best.scene, by),
        )  # fmt: skip

    return loop.run(go, finished)


def _residual(scene: Scene, hard: bool) -> float:
    """Return the largest net force over the mean contact force, of hard packings that of their state of self stress."""
    return sensitivity(scene, "packing_fraction", "radius").force_residual if hard else resting_forces(scene).residual


def _refuse_unhard(scene: Scene, by: str) -> None:
    """Refuse scenes of which no hard packing is known, and numbers that it does not know."""
    packing = scene.packing
    there = {
        "links": len(packing.links) > 0,
        f"shapes ({type(packing.shapes).__name__})": packing.shapes.has_orientations,
        "bonds": bonds_of(scene.effects) is not None,
    }
    held = [name for name, present in there.items() if present]
    if held:
        raise ValueError(
            "scene must be of discs or spheres without links, shapes or bonds for objective='packing_fraction', as "
            f"pm.jam knows no hard packing of others, got one with {' and '.join(held)}"
        )
    if by != "radius":
        raise ValueError(f"by must be 'radius' for objective='packing_fraction' of discs or spheres, got {by!r}")


def _goal(at_least: float | None, at_most: float | None) -> tuple[float, float]:
    """Return 1 where a figure is to fall and -1 where it is to rise, and how far."""
    given = {name: goal for name, goal in (("at_least", at_least), ("at_most", at_most)) if goal is not None}
    for name, goal in given.items():
        real(name, goal, infinite=True)
    if not given:
        raise ValueError("at_least must be given, or at_most (-np.inf: as low as it goes), got neither")
    if len(given) > 1:
        raise ValueError(f"at_most must be left out where at_least is given, got {at_most} and {at_least}")
    (goal,) = given.values()
    return (-1.0 if at_most is None else 1.0), float(goal)


def _bounds(scene: Scene, by: str, bounds: Any, keep: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest numbers, checked against those that the scene has."""
    none = np.zeros(0)
    if by in ("bonds", "rest_length") and bonds_of(scene.effects) is None:
        raise ValueError(f"scene.effects must hold Bonds for by={by!r}, got none")
    if by == "bonds":
        if bounds is not None or keep != "nothing":
            raise ValueError('bounds and keep must be left out for by="bonds", which are there or not')
        return none, none
    if by in ("aspect", "exponent") and not hasattr(scene.packing.shapes, f"{by}_n"):
        kind = type(scene.packing.shapes).__name__
        raise ValueError(f"by must be numbers that the scene has, got {by!r} of {kind}")
    if not isinstance(bounds, tuple | list) or len(bounds) != 2:
        raise TypeError(f"bounds must be the lowest and the highest numbers, got {brief(bounds)}")
    start = numbers_of(scene, by)
    low, high = (
        np.full(start.shape, real(f"bounds[{k}]", one)) if not given_shape(one)
        else finite_array(f"bounds[{k}]", one, shape=start.shape) for k, one in enumerate(bounds)
    )  # fmt: skip
    wrong = ~((low > 0.0) & (low <= start) & (start <= high) & (high < np.inf))
    if wrong.any():
        k = int(np.argmax(wrong))
        raise ValueError(
            f"bounds must be positive and hold the numbers at the start, got {low[k]:g} to {high[k]:g} for {start[k]:g}"
            f" at {k}"
        )
    return np.array(low), np.array(high)
