"""Checks at the edge of a batch of sheared packings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import finite_array, instance, integer
from packmech.packing import Packing, without_links
from packmech.scene import Scene


def scenes_of(scenes: Any) -> list[Scene]:
    """Return the scenes of a batch, which must be alike."""
    if isinstance(scenes, Scene) or not isinstance(scenes, Sequence):
        raise TypeError(f"scenes must be a list of scenes, got {scenes!r:.60}")
    if not scenes:
        raise ValueError("scenes must hold at least one scene, got none")
    for b, scene in enumerate(scenes):
        must_be_alike(f"scenes[{b}]", scene, scenes[0])
    return list(scenes)


def must_be_alike(name: str, scene: Any, first: Scene) -> None:
    """Check that a scene has the dimension and kinds of effects of the first one of its batch, and no rigid links."""
    instance(name, scene, Scene)
    without_links(f"{name}.packing", scene.packing)
    if scene.packing.dimension != first.packing.dimension:
        raise ValueError(f"{name} must have the dimension of the first scene, got {scene.packing.dimension}")
    if _kinds(scene.effects) != _kinds(first.effects):
        raise ValueError(f"{name} must have the kinds of effects of the first scene, got {scene.effects!r:.100}")


def _kinds(effects: Any) -> Any:
    """Return the classes in a tuple of effects, those of their laws too: what compiled code goes by."""
    if isinstance(effects, tuple):
        return type(effects), tuple(_kinds(one) for one in effects)
    return type(effects)


def direction_of(axes: Any, dimension: int) -> NDArray[np.float64]:
    """Return M of a shear along the first of two axes, its gradient along the second."""
    if not isinstance(axes, tuple | list) or len(axes) != 2:
        raise TypeError(f"axes must be two axes, got {axes!r}")
    a, b = (integer("axes", axis, at_least=0, at_most=dimension - 1) for axis in axes)
    if a == b:
        raise ValueError(f"axes must be two different axes, got {axes}")
    direction = np.zeros((dimension, dimension))
    direction[a, b] = 1.0
    return direction


def motion_of(
    packing: Packing, velocity_nd: Any, spin_nk: Any, held_n: Any
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None, NDArray[np.bool_] | None]:
    """Return velocities, spins and who is held, checked; None where not given."""
    n, d = packing.particles, packing.dimension
    velocity = None if velocity_nd is None else finite_array("velocity_nd", velocity_nd, shape=(n, d))
    spin = None if spin_nk is None else finite_array("spin_nk", spin_nk, shape=(n, 1 if d == 2 else 3))
    if held_n is None:
        return velocity, spin, None
    held = np.asarray(held_n)
    if held.dtype != bool:
        raise TypeError(f"held_n must be True or False for each particle, got {held_n!r:.60}")
    if held.shape != (n,):
        raise ValueError(f"held_n must have shape ({n},), got {held.shape}")
    return velocity, spin, held
