"""Starts with deep overlaps of what must not pass through each other: linked particles, and rigid bodies of beads.

Bodies that were put down across each other stay so: their beads hold them like the arms of a puzzle, and forces between
two of them that share a center do not even show in the pressure. So deep overlaps are taken out by shrinking all bodies
in place until overlaps are shallow, and growing them again little by little, relaxed at each size.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from packmech.contacts.shape_contacts import find_shape_contacts
from packmech.effects import acting_contacts
from packmech.minimize.first_order.fire import Fire
from packmech.minimize.links_apart import separate_links
from packmech.minimize.program import Program, build_program
from packmech.packing import Packing

# relative overlaps of beads up to which bodies do not pass through each other [1]
SHALLOW = 0.25
# bodies are made smaller by this factor at a time, down to that; and grow by this part of their smallest bead
_SMALLER, _SMALLEST, _GROWTH = 0.7, 1e-4, 0.15
# where a relaxation on the way stops: net force over mean contact force [1], and its maximum number of steps
_TOLERANCE, _STEPS = 1e-2, 300


def deep_overlaps(packing: Packing, effects: tuple[Any, ...] = ()) -> int:
    """Return the number of pairs of rigid bodies whose beads overlap deeply: some of them pass through each other."""
    contacts = acting_contacts(find_shape_contacts(packing, gap_tolerance=0.0), effects)
    deep = contacts.overlap_c > SHALLOW
    pairs = np.column_stack([contacts.i_c, contacts.j_c, contacts.image_cd])[deep]
    return len(np.unique(pairs, axis=0))


def report_of_bodies(packing: Packing, effects: tuple[Any, ...] = ()) -> dict[str, int]:
    """Return the number of deep overlaps of rigid bodies, as runs report it; nothing of other particles."""
    return {"deep_overlaps": deep_overlaps(packing, effects)} if packing.shapes.has_beads else {}


def separate(
    program: Program, packing: Packing, *, step_limit: int | None = None, look: Callable[[], None] | None = None
) -> tuple[Packing, int]:
    """Return the packing with deep overlaps relaxed where they would stay, and the number of steps that took.

    Parameters
    ----------
    program
        The compiled scene.
    packing
        Where to start; returned as it is without rigid bodies, without links in the plane, or with shallow overlaps.
    step_limit
        Maximum number of steps, if below the usual one.
    look
        Called now and then: raises where time is up.

    """
    if not packing.shapes.has_beads:
        limit = {} if step_limit is None else {"step_limit": step_limit}
        return separate_links(program, packing, **limit, look=look)
    radius, size, effects = packing.radius_n, 1.0, program.scene.effects
    if not deep_overlaps(packing, effects):
        return packing, 0
    while size > _SMALLEST and deep_overlaps(packing.replace(radius_n=size * radius), effects):
        size *= _SMALLER
    shapes = packing.shapes
    slender = float((shapes.reach(radius)[shapes.particle_b] / shapes.site_radius(radius)).max())
    steps = 0
    while size < 1.0:
        if look is not None:
            look()
        size = min(1.0, size * (1.0 + _GROWTH / slender))
        small = program.scene.replace(packing=packing.replace(radius_n=size * radius))
        left = _STEPS if step_limit is None else min(_STEPS, max(step_limit - steps, 0))
        done = build_program(small).relax(force_tolerance=_TOLERANCE, method=Fire(), step_limit=left)
        packing = done.packing.replace(radius_n=radius)
        steps += done.steps
    return packing, steps
