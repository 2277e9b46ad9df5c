"""Effects on single particles inside compiled loops, chosen by type."""

from __future__ import annotations

from typing import Any

from packmech.compiled import compiled_form
from packmech.effects.pair import hook_of


def body_force(
    effect: Any, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
) -> tuple[float, float, float]:
    """Return the force of one effect on a particle at (x, y, z) with the peculiar velocity (u, v, w) [force]."""
    hook = getattr(effect, "body_force", None)
    return (0.0, 0.0, 0.0) if hook is None else hook(x, y, z, u, v, w, mass, radius)


def body_energy(effect: Any, x: float, y: float, z: float, mass: float, radius: float) -> float:
    """Return the energy of a particle under one effect [energy]."""
    hook = getattr(effect, "body_energy", None)
    return 0.0 if hook is None else hook(x, y, z, mass, radius)


def spin_drag(effect: Any) -> float:
    """Return the rate at which one effect lets spins relax to the flow's [1/time]."""
    hook = getattr(effect, "spin_drag", None)
    return 0.0 if hook is None else hook()


@compiled_form(body_force)
def _body_force(effect: Any, x: Any, y: Any, z: Any, u: Any, v: Any, w: Any, mass: Any, radius: Any) -> Any:
    function = hook_of(effect, "body_force")
    if function is None:
        return lambda effect, x, y, z, u, v, w, mass, radius: (0.0, 0.0, 0.0)
    return lambda effect, x, y, z, u, v, w, mass, radius: function(effect, x, y, z, u, v, w, mass, radius)


@compiled_form(body_energy)
def _body_energy(effect: Any, x: Any, y: Any, z: Any, mass: Any, radius: Any) -> Any:
    function = hook_of(effect, "body_energy")
    if function is None:
        return lambda effect, x, y, z, mass, radius: 0.0
    return lambda effect, x, y, z, mass, radius: function(effect, x, y, z, mass, radius)


@compiled_form(spin_drag)
def _spin_drag(effect: Any) -> Any:
    function = hook_of(effect, "spin_drag")
    if function is None:
        return lambda effect: 0.0
    return lambda effect: function(effect)
