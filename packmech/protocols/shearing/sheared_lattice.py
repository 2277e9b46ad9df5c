"""Lattices of boxes that deform on and on: by shears, and by strains that are given in part."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from packmech.box import Box
from packmech.packing import Packing

# positions this many lattice vectors away are wrapped
_FAR = 2.0


class ShearedLattice:
    """The lattice (1 + strain e_flow e_gradient) of that at the start, by short vectors, and its images since then.

    Parameters
    ----------
    packing
        The packing at strain zero.
    axes
        Direction of the flow and of its gradient.

    """

    def __init__(self, packing: Packing, axes: tuple[int, int]) -> None:
        d = packing.dimension
        self.axes = axes
        self.shear_dd = np.zeros((d, d))
        self.shear_dd[axes] = 1.0
        # lattice of the shape at strain zero, as it is labeled now, and what labels have done to images since the start
        self.unsheared_dd = packing.box.lattice_dd
        self._change_dd = np.eye(d, dtype=np.int64)
        self._wrapped_nd = np.zeros((packing.particles, d), dtype=np.int64)

    def box(self, strain: float, volume: float) -> Box:
        """Return the box of the shape that belongs to a strain, at a volume."""
        sheared = (np.eye(len(self.shear_dd)) + strain * self.shear_dd) @ self.unsheared_dd
        return Box(sheared * (volume / abs(np.linalg.det(sheared))) ** (1.0 / len(sheared)))

    def moved_on(
        self,
        packing: Packing,
        strain: float,
        further: float,
        u_nq: NDArray[np.float64],
        gradient_dd: NDArray[np.float64],
    ) -> Packing:
        """Return the packing of a strain moved on to another along its rates, in the box of that, of the volume there.

        Parameters
        ----------
        packing, strain
            The packing, and its strain.
        further
            The other strain.
        u_nq
            (N, q) rates of positions beyond those that the gradient takes along, and of turns as lengths.
        gradient_dd
            (d, d) rate of the displacement gradient.

        """
        step, d = further - strain, packing.dimension
        along = np.hstack([packing.position_nd @ gradient_dd.T + u_nq[:, :d], u_nq[:, d:]])
        size = 1.0 + step * float(np.trace(gradient_dd)) / d
        return packing.moved(step * along).replace(box=self.box(further, packing.box.volume * size**d))

    def identity(
        self, contacts: Any, first_c: NDArray[np.int64], second_c: NDArray[np.int64]
    ) -> frozenset[tuple[int, ...]]:
        """Return the pairs (first, second, image), with the images that they had in the box and the cell of the start.

        First and second are particles, or sites of them.
        """
        moved = contacts.image_cd - self._wrapped_nd[contacts.j_c] + self._wrapped_nd[contacts.i_c]
        return frozenset(map(tuple, np.column_stack([first_c, second_c, moved @ self._change_dd.T]).tolist()))

    def renewed(self, packing: Packing, contacts: Any) -> tuple[Packing, NDArray[np.int64]] | None:
        """Return the packing with short lattice vectors and particles in the cell, and the images that contacts have.

        None where nothing has gone far.
        """
        fraction = packing.position_nd @ packing.box.inverse_dd.T
        small, change = packing.box.reduced()
        if np.abs(fraction).max() < _FAR and np.abs(change - np.eye(packing.dimension)).max() == 0:
            return None
        position, image = small.wrap(packing.position_nd)
        back = np.rint(np.linalg.inv(change)).astype(np.int64)
        self.unsheared_dd = self.unsheared_dd @ change
        # x = wrapped + lattice @ image, by the new vectors
        self._wrapped_nd = self._wrapped_nd @ back.T + image
        self._change_dd = self._change_dd @ change
        moved = contacts.image_cd @ back.T + image[contacts.j_c] - image[contacts.i_c]
        return packing.replace(position_nd=position, box=small), np.ascontiguousarray(moved)


class StrainedLattice:
    """A lattice that strains by given components of the velocity gradient, while others are free.

    Parameters
    ----------
    direction_dd
        (d, d) components given, for a way of one.

    """

    def __init__(self, direction_dd: NDArray[np.float64]) -> None:
        self.shear_dd = direction_dd

    def moved_on(
        self,
        packing: Packing,
        strain: float,
        further: float,
        u_nq: NDArray[np.float64],
        gradient_dd: NDArray[np.float64],
    ) -> Packing:
        """Return the packing moved on along its rates, as `ShearedLattice.moved_on` does.

        The box goes by the exponential of the gradient: its integral over the way is what strains count.
        """
        step, d = further - strain, packing.dimension
        whole_dd = expm(step * gradient_dd)
        along = packing.position_nd @ (whole_dd - np.eye(d)).T + step * u_nq[:, :d]
        moved = packing.moved(np.hstack([along, step * u_nq[:, d:]]))
        return moved.replace(box=Box(whole_dd @ packing.box.lattice_dd))
