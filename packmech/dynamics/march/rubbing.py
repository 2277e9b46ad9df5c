# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Friction between the particles of a march, chosen by type: a scene without it holds no stretches and no code."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from packmech.compiled import compiled_form, device
from packmech.dynamics.march.springs import (
    Pace,
    slip_in_plane,
    slip_in_space,
    stretch_after,
    stretch_before,
    with_moment,
)
from packmech.effects.pair import hook_of


def slide(friction: Any, stretch: float, slip: float) -> float:
    """Return the tangential force of a friction before its cap [force]."""
    return float(friction.tangential_force(stretch, slip))


@compiled_form(slide)
def _choose_slide(friction: Any, stretch: Any, slip: Any) -> Any:
    function = hook_of(friction, "tangential_force")
    if function is None:
        return None
    return lambda friction, stretch, slip: function(friction, stretch, slip)


def turning_axes(friction: Any, axes: Any) -> Any:
    """Return a tuple as long as the torques that a pair has: none without friction, 1 in a plane, 3 in space."""
    return () if friction is None else axes if len(axes) == 3 else axes[:1]


@compiled_form(turning_axes)
def _choose_turning_axes(friction: Any, axes: Any) -> Any:
    if isinstance(friction, types.NoneType):
        return lambda friction, axes: ()
    return (lambda friction, axes: axes) if len(axes) == 3 else (lambda friction, axes: (0,))


@device
def _rub_in_plane(friction, body, held_pk, p, i, j, nx, ny, ux, uy, r, sigma, normal, pace):
    ai, aj, slip = slip_in_plane(body, i, j, nx, ny, ux, uy, r, sigma)
    stretch = held_pk[p, 0] + pace.before * slip
    force = slide(friction, stretch, slip)
    cap = friction.coefficient * normal
    soft = 1.0 / friction.stiffness
    # whether contacts slide is not to be foretold: without a branch, what the cap takes is taken off the spring too;
    # never past rest nor beyond what it was, so that a strong dashpot does not wind it
    capped = min(max(force, -cap), cap)
    less = stretch + (capped - force) * soft
    stretch = min(max(less, min(stretch, 0.0)), max(stretch, 0.0))
    force = capped
    held_pk[p, 0] = stretch + pace.after * slip
    # along t = (-ny, nx); the moment n x t is one
    return force * -ny, force * nx, 0.0, 0.0, 0.0, force, ai, aj


@device
def _rub_in_space(friction, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
    ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_before(held_pk, p, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
    fx = slide(friction, x, sx)
    fy = slide(friction, y, sy)
    fz = slide(friction, z, sz)
    square = fx * fx + fy * fy + fz * fz
    cap = friction.coefficient * normal
    soft = 1.0 / friction.stiffness
    if square > cap * cap:
        size = math.sqrt(square)
        # as in a plane: the spring gives way along the force, and no farther than to rest
        along = (x * fx + y * fy + z * fz) / size
        less = min((size - cap) * soft, max(along, 0.0)) / size
        x -= less * fx
        y -= less * fy
        z -= less * fz
        scale = cap / size
        fx *= scale
        fy *= scale
        fz *= scale
    stretch_after(held_pk, p, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
    return with_moment(nx, ny, nz, fx, fy, fz, ai, aj)


def rub(
    friction: Any,
    axes: Any,
    body: Any,
    held_pk: Any,
    p: int,
    i: int,
    j: int,
    nx: float,
    ny: float,
    nz: float,
    ux: float,
    uy: float,
    uz: float,
    r: float,
    sigma: float,
    normal: float,
    pace: Pace,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return the friction on i of a touching pair with relative velocity u, its moment and arms; zeros without."""
    raise NotImplementedError("friction acts in compiled loops")


@compiled_form(rub)
def _choose_rub(
    friction: Any,
    axes: Any,
    body: Any,
    held_pk: Any,
    p: Any,
    i: Any,
    j: Any,
    nx: Any,
    ny: Any,
    nz: Any,
    ux: Any,
    uy: Any,
    uz: Any,
    r: Any,
    sigma: Any,
    normal: Any,
    pace: Any,
) -> Any:
    if isinstance(friction, types.NoneType):

        def none(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
            return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0

        return none
    if len(axes) == 2:

        def plane(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
            return _rub_in_plane(friction, body, held_pk, p, i, j, nx, ny, ux, uy, r, sigma, normal, pace)

        return plane

    def space(friction, axes, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
        return _rub_in_space(friction, body, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace)

    return space


def forget(axes: Any, held_pk: Any, p: int) -> None:
    """Forget the stretch of a pair that does not touch; nothing where no stretches are held."""
    if held_pk is not None:
        held_pk[p] = 0.0


@compiled_form(forget)
def _choose_forget(axes: Any, held_pk: Any, p: Any) -> Any:
    if isinstance(held_pk, types.NoneType):
        return lambda axes, held_pk, p: None

    def clear(axes, held_pk, p):
        held_pk[p, 0] = 0.0
        if len(axes) == 3:
            held_pk[p, 1] = 0.0
            held_pk[p, 2] = 0.0

    return clear
