"""The minimizers by name, and how a user adds one."""

from __future__ import annotations

import inspect
from typing import Any, TypeVar

from packmech.check import brief
from packmech.jit.compiled import own_name
from packmech.minimize.first_order.conjugate_gradient import ConjugateGradient
from packmech.minimize.first_order.damped import DampedDynamics
from packmech.minimize.first_order.fire import Fire, Fire2
from packmech.minimize.first_order.gradient_descent import GradientDescent
from packmech.minimize.first_order.lbfgs import LBFGS
from packmech.minimize.first_order.steepest_descent import SteepestDescent
from packmech.minimize.second_order.newton import Newton

M = TypeVar("M", bound=type)

_REGISTERED: list[type] = [
    Fire, Fire2, ConjugateGradient, LBFGS, DampedDynamics, GradientDescent, SteepestDescent, Newton,
]  # fmt: skip


def minimizer(cls: M) -> M:
    """Return the class registered as a minimizer that scene files may name.

    Parameters
    ----------
    cls
        A NamedTuple of settings with the methods `start(program)`, which returns `program.progress(numbers, vectors)`
        with at least two numbers (steps and force evaluations so far), and `advance(program, goal, progress, steps)`,
        which takes up to `steps` steps, counts them and returns a status code as `program.judge(goal)` gives it.
        A method `check()` may raise where a setting is wrong.

    Raises
    ------
    TypeError, ValueError
        If the class is not such a NamedTuple, or has the name of a minimizer that ships.

    Examples
    --------
    >>> import packmech as pm
    >>> from typing import NamedTuple
    >>> @minimizer
    ... class SmallSteps(NamedTuple):
    ...     step: float = 0.2
    ...     def start(self, program):
    ...         return program.progress(2, 0)
    ...     def advance(self, program, goal, progress, steps):
    ...         for _ in range(steps):
    ...             status, now = program.judge(goal)
    ...             progress.number[1] += 1
    ...             if status:
    ...                 return status
    ...             program.place(program.coordinates() + self.step * now.force_nd)
    ...             progress.number[0] += 1
    ...         return program.judge(goal)[0]
    >>> packing = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1)
    >>> pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-3, method=SmallSteps()).outcome.name
    'CONVERGED'

    """
    if not (isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")):
        raise TypeError(f"minimizer must be a NamedTuple class, got {brief(cls)}")
    for name, arguments in (("start", 2), ("advance", 5)):
        method = vars(cls).get(name)
        if not inspect.isfunction(method) or len(inspect.signature(method).parameters) != arguments:
            raise TypeError(
                f"minimizer {cls.__name__} must define {name} with {arguments} parameters, got {brief(method)}"
            )
    own_name("minimizer", cls, _REGISTERED)
    _REGISTERED.append(cls)
    return cls


def registered_minimizers() -> tuple[type, ...]:
    """Return every minimizer class, in the order of registration."""
    return tuple(_REGISTERED)


def checked_minimizer(method: Any) -> Any:
    """Return the minimizer with numbers that are floats as usual as floats, for which compiled loops exist.

    Raises
    ------
    TypeError, ValueError
        Naming `method`, or the field of it that is wrong.

    """
    able = isinstance(method, Newton) or (hasattr(method, "start") and hasattr(method, "advance"))
    if isinstance(method, type) or not able:
        raise TypeError(f"method must be a minimizer such as Fire() or LBFGS(), got {brief(method)}")
    if hasattr(method, "check"):
        method.check()
    usual = getattr(method, "_field_defaults", {})
    plain = {name: float(getattr(method, name)) for name, value in usual.items() if type(value) is float}
    return method._replace(**plain) if plain else method
