"""The arguments that all strained runs share, and their checks."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, integer, positive, positive_array
from packmech.dynamics.engine import refuse_misfits
from packmech.dynamics.integrators import INTEGRATORS, SemiImplicitEuler, VelocityVerlet, choose_time_step
from packmech.loop.checkpoint import RunsFile
from packmech.loop.run_loop import Progress, RunLoop, run_settings
from packmech.packing import without_links
from packmech.scene import Scene

Method = VelocityVerlet | SemiImplicitEuler
F = TypeVar("F", bound=Callable[..., Any])


class Several(TypedDict, total=False):
    """Arguments of every call that strains a scene, those that make several runs among them."""

    dt: float | None
    method: Method | None
    mass_n: ArrayLike | None
    held_n: ArrayLike | None
    frames: int
    progress: Progress | None
    checkpoint: str | os.PathLike[str] | RunsFile | None


class Common(Several, total=False):
    """Arguments of the calls that make a single run."""

    velocity_nd: ArrayLike | None
    spin_nk: ArrayLike | None
    time_limit: float | None
    check: bool


KIND = "strained runs"
_DEFAULTS = {"frames": 0, "check": True}


def listed(arguments: type) -> Callable[[F], F]:
    """Return a decorator that lists the arguments behind a function's ``**common`` in its signature, one by one.

    Examples
    --------
    >>> @listed(Several)
    ... def strained(scene, **common): ...
    >>> list(inspect.signature(strained).parameters)
    ['scene', 'dt', 'method', 'mass_n', 'held_n', 'frames', 'progress', 'checkpoint']

    """
    keyword = inspect.Parameter.KEYWORD_ONLY
    hints: dict[str, Any] = {}
    for part in reversed(arguments.__mro__):
        hints |= getattr(part, "__annotations__", {})
    further = [
        inspect.Parameter(name, keyword, default=_DEFAULTS.get(name), annotation=hint) for name, hint in hints.items()
    ]

    def list_them(function: F) -> F:
        signature = inspect.signature(function)
        own = [one for one in signature.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
        function.__signature__ = signature.replace(parameters=[*own, *further])  # type: ignore[attr-defined]
        return function

    return list_them


@dataclass(frozen=True)
class StrainSettings:
    """Checked arguments that all strained runs share; one loop and one file serve all runs of a call."""

    scene: Scene
    method: Method
    mass_n: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    held_n: NDArray[np.bool_] | None
    longest: float
    frames: int
    loop: RunLoop
    file: RunsFile | None


def check_arguments(
    scene: Scene,
    *,
    dt: float | None = None,
    method: Method | None = None,
    mass_n: ArrayLike | None = None,
    velocity_nd: ArrayLike | None = None,
    spin_nk: ArrayLike | None = None,
    held_n: ArrayLike | None = None,
    time_limit: float | None = None,
    progress: Progress | None = None,
    frames: int = 0,
    checkpoint: str | os.PathLike[str] | RunsFile | None = None,
    check: bool = True,
    **unknown: Any,
) -> StrainSettings:
    """Return the arguments as the engine takes them.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """
    for name in unknown:
        raise TypeError(f"{name} must be left out: there is no such argument")
    instance("scene", scene, Scene)
    without_links("scene.packing", scene.packing)
    refuse_misfits(scene)
    packing = scene.packing
    n, d = packing.particles, packing.dimension
    method = VelocityVerlet() if method is None else method
    if not isinstance(method, INTEGRATORS):
        raise TypeError(f"method must be VelocityVerlet() or SemiImplicitEuler(), got {method!r}")
    fraction = positive("method.fraction", method.fraction)
    if mass_n is None:
        mass = (packing.diameter_n / packing.reference_diameter) ** d
    else:
        mass = positive_array("mass_n", mass_n, shape=(n,))
    velocity = np.zeros((n, d)) if velocity_nd is None else finite_array("velocity_nd", velocity_nd, shape=(n, d))
    spin = None if spin_nk is None else finite_array("spin_nk", spin_nk, shape=(n, 1 if d == 2 else 3))
    held = None
    if held_n is not None:
        held = np.asarray(held_n)
        if held.dtype != bool:
            raise TypeError(f"held_n must be True or False for each particle, got {held_n!r}")
        if held.shape != (n,):
            raise ValueError(f"held_n must have shape ({n},), got {held.shape}")
        velocity[held] = 0.0
    longest = choose_time_step(scene, mass, fraction) if dt is None else positive("dt", dt)
    return StrainSettings(
        scene,
        method,
        mass,
        velocity,
        spin,
        held,
        longest,
        integer("frames", frames, at_least=0),
        RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check)),
        runs_file(checkpoint),
    )


def runs_file(checkpoint: Any) -> RunsFile | None:
    """Return the file of strained runs that is named; what is one already, or None, as it is."""
    return checkpoint if checkpoint is None or isinstance(checkpoint, RunsFile) else RunsFile(checkpoint, KIND)


def two_axes(axes: Any) -> tuple[int, int]:
    """Return the axes after checking that they are two of three."""
    if not isinstance(axes, tuple | list) or len(axes) != 2:
        raise TypeError(f"axes must be two axes, got {axes!r}")
    return (integer("axes", axes[0], at_least=0, at_most=2), integer("axes", axes[1], at_least=0, at_most=2))
