# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Tangential displacements at one time: springs in the loops are ahead of the force taken last, by `Pace.after`."""

from __future__ import annotations

import math

from packmech.dynamics.deformation import rates, relative
from packmech.dynamics.friction import stretch_now
from packmech.dynamics.observables import is_touching, slip_of
from packmech.dynamics.shape_pairs import slip_of_shapes
from packmech.jit.compiled import device, lean


@device
def _slip(shapes, axes, body, lattice, flowing, i, j, one, other, x, y, z):
    """Return whether two rows touch, and what `slip_of` says of them."""
    dx = body[j, 0] - body[i, 0] + (lattice[0, 0] * x + lattice[0, 1] * y + lattice[0, 2] * z)
    dy = body[j, 1] - body[i, 1] + (lattice[1, 0] * x + lattice[1, 1] * y + lattice[1, 2] * z)
    dz = 0.0
    if len(axes) == 3:
        dz = body[j, 2] - body[i, 2] + (lattice[2, 0] * x + lattice[2, 1] * y + lattice[2, 2] * z)
    if shapes is not None:
        return slip_of_shapes(shapes, axes, body, flowing, i, j, one, other, dx, dy, dz)
    r = math.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / r if r > 0.0 else 0.0
    ux, uy, uz = relative(flowing, axes, body, i, j, dx, dy, dz)
    sigma = body[i, 3] + body[j, 3]
    found = slip_of(axes, body, i, j, dx * inverse, dy * inverse, dz * inverse, ux, uy, uz, r, sigma)
    return is_touching(body, i, j, dx, dy, dz), found


@lean
def displacements_now(shapes, axes, state, space, i_p, j_p, image_pd, bead_p2, stretch_pk, after, out_pk):
    """Write the displacements that the forces taken last were made of; pairs that do not touch are left out."""
    flowing = rates(space.flow)
    for p in range(i_p.shape[0]):
        image = image_pd[p, 0], image_pd[p, 1], image_pd[p, 2]
        touching, (_, _, sx, sy, sz, ox, oy, oz) = _slip(
            shapes,
            axes,
            state.body,
            space.frame.lattice_dd,
            flowing,
            i_p[p],
            j_p[p],
            bead_p2[p, 0],
            bead_p2[p, 1],
            *image,
        )
        if touching:
            x, y, z = stretch_now(axes, stretch_pk, p, sx, sy, sz, ox, oy, oz, after)
            out_pk[p, 0] = x
            if len(axes) == 3:
                out_pk[p, 1] = y
                out_pk[p, 2] = z
