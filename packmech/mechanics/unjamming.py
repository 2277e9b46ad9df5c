"""A motion that opens contacts and closes none: displacements of all particles of a packing, a strain of its box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.mechanics.link_rules import follow_links
from packmech.mechanics.motions import MotionCone
from packmech.mechanics.strain import mandel_tensor, strain_components
from packmech.packing import Packing


@dataclass(frozen=True, eq=False)
class UnjammingMotion:
    """A motion along which contacts open or keep their length and none closes, to first order.

    Attributes
    ----------
    displacement_nd
        (N, d) displacements, without translation; the largest of them, or strain_scale times the largest strain, is one
        reference diameter [length]. Rattlers stay, or follow their links.
    strain_dd
        (d, d) symmetric strain of the box [1]; zero in a fixed box.
    closing, opening
        Largest shortening and largest lengthening of a contact [length].

    """

    displacement_nd: NDArray[np.float64]
    strain_dd: NDArray[np.float64]
    closing: float
    opening: float

    def moved(self, packing: Packing, amplitude: float) -> Packing:
        """Return the packing moved along the motion: x -> (1 + a strain)(x + a displacement), the box strained alike.

        Rigid links get their lengths back.

        Parameters
        ----------
        packing
            The packing that was classified.
        amplitude
            a, in reference diameters [1].

        """
        change = np.eye(packing.dimension) + amplitude * self.strain_dd
        position = (packing.position_nd + amplitude * self.displacement_nd) @ change.T
        moved = packing.replace(position_nd=position, box=packing.box.strained(amplitude * self.strain_dd))
        if moved.links is None:
            return moved
        from packmech.mechanics.reaffixing import reaffix_links

        return reaffix_links(moved).packing


def unjamming_motion(packing: Packing, cone: MotionCone, motion: NDArray[np.float64]) -> UnjammingMotion:
    """Return the motion of a cone as displacements of all particles of the packing and a strain of its box."""
    d = packing.dimension
    moving = len(cone.kept_n) * d
    motion = cone.without_translations(motion)
    displacement = np.zeros((packing.particles, d))
    displacement[cone.kept_n] = motion[:moving].reshape(-1, d)
    strain = np.zeros(strain_components(d))
    if cone.strain_scale:
        strain = motion[moving:] / cone.strain_scale
    if packing.links is not None:
        follow_links(packing, cone.kept_n, displacement, strain)
    size = max(np.sqrt((displacement**2).sum(axis=1)).max(), cone.strain_scale * np.abs(strain).max())
    factor = packing.reference_diameter / size if size > 0 else 0.0
    stretch = factor * (cone.opening @ motion)
    return UnjammingMotion(
        factor * displacement,
        factor * mandel_tensor(strain),
        closing=float(max(0.0, -stretch.min(initial=0.0))),
        opening=float(max(0.0, stretch.max(initial=0.0))),
    )
