# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Friction between the particles of a march, chosen by type: a scene without it holds no stretches and no code."""

from __future__ import annotations

import math
from typing import Any

from numba import types

from packmech.compiled import compiled_form, device
from packmech.dynamics.march.springs import Pace, push_in_space, slip_in_space, stretch_after, stretch_before
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


@device
def rub_flat(friction, body, push, held_pk, p, i, j, nx, ny, ux, uy, r, sigma, normal, pace):
    """Add friction in a plane: the stretch is a number along t = (-ny, nx); return the tangential force."""
    ai = body[i, 3] * r / sigma
    aj = body[j, 3] * r / sigma
    slip = ux * -ny + uy * nx - ai * body[i, 6] - aj * body[j, 6]
    stretch = held_pk[p, 0] + pace.before * slip
    force = slide(friction, stretch, slip)
    cap = friction.coefficient * normal
    if abs(force) > cap:
        force = math.copysign(cap, force)
        stretch = (force - friction.damping * slip) / friction.stiffness
    held_pk[p, 0] = stretch + pace.after * slip
    push[i, 0] += force * -ny
    push[i, 1] += force * nx
    push[j, 0] -= force * -ny
    push[j, 1] -= force * nx
    push[i, 2] += ai * force
    push[j, 2] += aj * force
    return force


@device
def rub_in_space(friction, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
    """Add friction between spheres: the stretch is a vector across n; return the tangential force."""
    ai, aj, sx, sy, sz, ox, oy, oz = slip_in_space(body, i, j, nx, ny, nz, ux, uy, uz, r, sigma)
    x, y, z = stretch_before(held_pk, p, nx, ny, nz, sx, sy, sz, ox, oy, oz, pace.before)
    fx = slide(friction, x, sx)
    fy = slide(friction, y, sy)
    fz = slide(friction, z, sz)
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    cap = friction.coefficient * normal
    if size > cap:
        scale = cap / size
        fx *= scale
        fy *= scale
        fz *= scale
        soft = 1.0 / friction.stiffness
        x = (fx - friction.damping * sx) * soft
        y = (fy - friction.damping * sy) * soft
        z = (fz - friction.damping * sz) * soft
    stretch_after(held_pk, p, x, y, z, sx, sy, sz, ox, oy, oz, pace.after)
    push_in_space(push, i, j, ai, aj, nx, ny, nz, fx, fy, fz)
    return size


def rub(
    friction: Any,
    axes: Any,
    body: Any,
    push: Any,
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
) -> None:
    """Add the friction of a touching pair with the relative velocity u; nothing where the scene has none."""
    raise NotImplementedError("friction acts in compiled loops")


@compiled_form(rub)
def _choose_rub(
    friction: Any,
    axes: Any,
    body: Any,
    push: Any,
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
        return lambda friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace: None
    if len(axes) == 2:

        def flat(friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
            rub_flat(friction, body, push, held_pk, p, i, j, nx, ny, ux, uy, r, sigma, normal, pace)

        return flat

    def space(friction, axes, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace):
        rub_in_space(friction, body, push, held_pk, p, i, j, nx, ny, nz, ux, uy, uz, r, sigma, normal, pace)

    return space


def forget(held_pk: Any, p: int) -> None:
    """Forget the stretch of a pair that does not touch; nothing where no stretches are held."""
    if held_pk is not None:
        held_pk[p] = 0.0


@compiled_form(forget)
def _choose_forget(held_pk: Any, p: Any) -> Any:
    if isinstance(held_pk, types.NoneType):
        return lambda held_pk, p: None

    def clear(held_pk, p):
        for a in range(held_pk.shape[1]):
            if held_pk[p, a] != 0.0:
                held_pk[p, a] = 0.0

    return clear
