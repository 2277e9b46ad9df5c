# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Faces of walls that move: where they stand, what pushes them, and their part in time steps.

A face moves along an axis at a velocity that is given (its inverse mass is zero), or as a piston that holds a stress,
stepped as particles are. Of a scene whose walls all stand still nothing of this is compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.effects import SIDES, HeldStress, Walls, moved_along
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined

# columns of a face: its axis, where it stood at the start and stands now along it; then three numbers each along x, y,
# z: how far it moved, its velocity (at the end of a step, or extrapolated there), that in the middle of a step, the
# force of the particles on it, the whole force, the work that moved it at a velocity that is given, the force of the
# stress that is held, the coefficient of the dashpot, and the inverse mass
AXIS, START, PLACE = 0, 1, 2
MOVED, VELOCITY, HALF, FORCE, WHOLE, WORK, HELD, DRAG, INVERSE = (3 + 3 * k for k in range(9))
NUMBERS = 30
# of these the constant ones
_CONSTANT = (AXIS, START, *(first + a for first in (HELD, DRAG, INVERSE) for a in range(3)))


class Faces(NamedTuple):
    """The faces of all walls that move, low before high, by the columns above, and the forces on them by blocks."""

    number_fk: NDArray[np.float64]
    force_bfd: NDArray[np.float64]


def face_area(box: Box, axis: int) -> float:
    """Return the area of the cell across an axis, a length in a plane; refuse a box whose other vectors slant.

    Raises
    ------
    ValueError
        If a lattice vector beside the one along the walls' normal does not lie in them.

    """
    height = box.height_across(axis)
    if height is None:
        raise ValueError(
            f"scene.packing.box must have all lattice vectors but one in walls across axis {axis} that move, got "
            f"{box.lattice_dd.tolist()}"
        )
    return box.volume / height


def make_faces(walls: tuple[Walls, ...], box: Box, blocks: int) -> Faces | None:
    """Return the faces of the walls that move; None where none does."""
    moving = [one for one in walls if one.moves]
    number = np.zeros((SIDES * len(moving), NUMBERS))
    for f, (one, side) in enumerate((one, side) for one in moving for side in range(SIDES)):
        axis = int(one.axis)
        area = face_area(box, axis)
        number[f, AXIS] = axis
        number[f, START] = number[f, PLACE] = one.high if side else one.low
        for a, along in enumerate(moved_along(one.high_motion if side else one.low_motion)):
            if isinstance(along, HeldStress):
                number[f, HELD + a] = along.stress * area * (1.0 if side else -1.0)
                number[f, DRAG + a] = along.damping * area
                number[f, INVERSE + a] = 1.0 / (along.inertia * area)
                number[f, VELOCITY + a] = along.velocity
            else:
                number[f, VELOCITY + a] = along
    return Faces(number, np.zeros((blocks, len(number), 3))) if moving else None


def restore_faces(faces: Faces, saved_fk: NDArray[np.float64]) -> None:
    """Go on with faces as a checkpoint kept them; axes, starts and held stresses stay those of the scene."""
    constant = faces.number_fk[:, _CONSTANT].copy()
    faces.number_fk[:] = saved_fk
    faces.number_fk[:, _CONSTANT] = constant


@device
def _move(faces, split):
    number_fk, largest = faces.number_fk, 0.0
    for f in range(number_fk.shape[0]):
        for a in range(3):
            _work(number_fk, f, a, split.early)
            before = number_fk[f, VELOCITY + a]
            kicked = before + split.early * number_fk[f, INVERSE + a] * number_fk[f, WHOLE + a]
            number_fk[f, MOVED + a] += split.dt * kicked
            number_fk[f, HALF + a] = kicked
            number_fk[f, VELOCITY + a] = kicked + split.ahead * (kicked - before)
            # written so that a displacement that is not a number is the largest
            if not abs(split.dt * kicked) <= largest:
                largest = abs(split.dt * kicked)
        number_fk[f, PLACE] = number_fk[f, START] + number_fk[f, MOVED + int(number_fk[f, AXIS])]
    return largest


@device
def _push(faces):
    number_fk, force_bfd = faces.number_fk, faces.force_bfd
    for f in range(number_fk.shape[0]):
        for a in range(3):
            force = 0.0
            for b in range(force_bfd.shape[0]):
                force += force_bfd[b, f, a]
            number_fk[f, FORCE + a] = force
            drag = number_fk[f, DRAG + a] * number_fk[f, VELOCITY + a]
            number_fk[f, WHOLE + a] = force + number_fk[f, HELD + a] - drag


@device
def _finish(faces, late):
    number_fk = faces.number_fk
    for f in range(number_fk.shape[0]):
        for a in range(3):
            _work(number_fk, f, a, late)
            kick = late * number_fk[f, INVERSE + a]
            number_fk[f, VELOCITY + a] = number_fk[f, HALF + a] + kick * number_fk[f, WHOLE + a]


@inlined
def _work(number_fk, f, a, time):
    """Add the work of what moves a face against the particles' force for a time."""
    if number_fk[f, INVERSE + a] == 0.0:
        number_fk[f, WORK + a] -= time * number_fk[f, FORCE + a] * number_fk[f, VELOCITY + a]


@device
def _clear(faces, b):
    for f in range(faces.force_bfd.shape[1]):
        for a in range(3):
            faces.force_bfd[b, f, a] = 0.0


@inlined
def load_face(faces, b, f, fx, fy, fz):
    """Take the reaction to a force on a row of a block."""
    faces.force_bfd[b, f, 0] -= fx
    faces.force_bfd[b, f, 1] -= fy
    faces.force_bfd[b, f, 2] -= fz


@device
def _measure(faces):
    number_fk = faces.number_fk
    kinetic = potential = 0.0
    for f in range(number_fk.shape[0]):
        for a in range(3):
            velocity, inverse = number_fk[f, VELOCITY + a], number_fk[f, INVERSE + a]
            if inverse > 0.0:
                kinetic += 0.5 / inverse * velocity * velocity
                potential -= number_fk[f, HELD + a] * number_fk[f, MOVED + a]
            potential -= number_fk[f, WORK + a]
    return kinetic, potential


# kicks faces, and takes them to the end of a step; returns how far one moves along an axis at most
move_faces = by_type(lambda faces, split: 0.0, {Faces: _move})
# sets the forces on the faces of a block to zero, before its rows push them
clear_faces = by_type(lambda faces, b: None, {Faces: _clear})
# sums the forces on faces over the blocks, in their order
push_faces = by_type(lambda faces: None, {Faces: _push})
# kicks faces at the end of a step
finish_faces = by_type(lambda faces, late: None, {Faces: _finish})
# kinetic energies of faces that hold stresses, and minus the work done on faces: a potential of what moves them
measure_faces = by_type(lambda faces: (0.0, 0.0), {Faces: _measure})


def face_number(faces: Any) -> int:
    """Return how many faces move."""
    return 0 if faces is None else len(faces.number_fk)
