"""What Newton's method sees of a soft packing with links: the same, on the motions that the links admit.

Steps solve [[H, Omega], [Omega^T, 0]] with H the Hessian of the contacts and of the links under their tension, so that
they are Newton's on the curved surface that the links leave; positions are re-affixed after each.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.contacts.excluded import Excluded
from packmech.contacts.neighbors import Candidates
from packmech.dynamics.soft_network import Bonds, SoftNetwork, Units
from packmech.dynamics.tether import Tether
from packmech.mechanics.block_system import Factored
from packmech.mechanics.saddle import factor_saddle
from packmech.packing import Packing


class LinkedNetwork(SoftNetwork):
    """Contacts and links of a packing; `uphill_nd` is what the links do not bear, `tension_l` what they do."""

    def __init__(self, packing: Packing, units: Units, basis_kdd: NDArray[np.float64], pressure: float | None) -> None:
        self._tether = Tether(packing)
        self._excluded = Excluded(packing)
        self.links = links = self._tether.links
        self.tension_l = np.zeros(len(links))
        self._cluster_n = links.clusters(packing.particles)
        super().__init__(self._affixed(packing), units, basis_kdd, pressure)

    def _affixed(self, packing: Packing) -> Packing:
        return packing.replace(position_nd=self._tether.affixed(packing.position_nd, packing.box))

    def search(self, packing: Packing) -> Candidates:
        """Return the pairs that touch or may soon, neither linked nor of one rigid cluster."""
        pairs = super().search(packing)
        apart = ~self._excluded.mask(*pairs)
        return Candidates(*(part[apart] for part in pairs))

    def lay_out(self) -> None:
        """Do nothing: the system with links is laid out when it is factored."""

    def slopes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the slopes along the motions that the links admit, their tension included, and the virial."""
        out, load_k, virial = super().slopes()
        packing = self.packing
        left, self.tension_l = self._tether.project(packing.position_nd, packing.box, -out)
        vector = self.links.vectors(packing.position_nd, packing.box.lattice_dd)
        distance = np.sqrt((vector**2).sum(axis=1))
        self._vector_ld, self._normal_ld = vector, vector / distance[:, None]
        self._distance_l = distance
        self._stretch_lk = np.einsum("la,kab,lb->lk", self._normal_ld, self.basis_kdd, vector)
        return -left, load_k + self._stretch_lk.T @ self.tension_l, virial + float((self.tension_l * distance).sum())

    def bonds(self) -> Bonds:
        """Return the contacts and the links, which are stiff across by their tension."""
        links, none = self.links, np.zeros(len(self.links))
        own = Bonds(
            links.i_l, links.j_l, self._normal_ld, self._vector_ld, none, self.tension_l / self._distance_l
        )  # fmt: skip
        return Bonds(*(np.concatenate(both) for both in zip(super().bonds(), own, strict=True)))

    def factor(self, bonds: Bonds, tie: float) -> Factored:
        """Return the factored system of positions and tensions; negative pivots beyond one a link are unstable."""
        packing = self.packing
        n, d, count = packing.particles, packing.dimension, len(self.links)
        unit = float(np.abs(self.second_c).mean()) if len(self.second_c) else 1.0
        normal = bonds.normal_cd
        block = (bonds.along_c - bonds.across_c)[:, None, None] * normal[:, :, None] * normal[:, None, :]
        block += bonds.across_c[:, None, None] * np.eye(d)
        i, j = bonds.i_c, bonds.j_c
        sign = np.array([1.0, 1.0, -1.0, -1.0])
        rows, columns = np.stack([i, j, i, j]), np.stack([i, j, j, i])
        values = sign[:, None, None, None] * block
        axis = np.arange(d)
        row = (rows[:, :, None, None] * d + axis[:, None]) + 0 * axis
        column = (columns[:, :, None, None] * d + axis) + 0 * axis[:, None]
        # a cluster that nothing touches is held, all others tied a trace
        held = np.bincount(self._cluster_n, self.contacts.count_n(), minlength=n)[self._cluster_n] == 0
        diagonal = np.repeat(np.where(held, unit, tie), d)
        pinned = int(np.argmax(np.where(held, -1, self.contacts.count_n())))
        diagonal[pinned * d : pinned * d + d] += unit
        links = self.links
        everything = np.arange(n * d)
        stiff = sp.coo_array(
            (
                np.concatenate([values.ravel(), diagonal]),
                (np.concatenate([row.ravel(), everything]), np.concatenate([column.ravel(), everything])),
            ),
            shape=(n * d, n * d),
        ).tocsr()
        gradient = sp.coo_array(
            (
                np.concatenate([-self._normal_ld, self._normal_ld]).ravel(),
                (
                    np.repeat(np.tile(np.arange(count), 2), d),
                    (np.concatenate([links.i_l, links.j_l])[:, None] * d + axis).ravel(),
                ),
            ),
            shape=(count, n * d),
        ).tocsr()
        done = factor_saddle(stiff, gradient, d, stiffness=unit)
        return Factored(done.solve, done.inertia.negative - count, pinned)

    def border(self, coupling: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coupling with the links' stretches below, in the unit of their rows."""
        unit = float(np.abs(self.second_c).mean()) if len(self.second_c) else 1.0
        return np.concatenate([coupling, unit * self._stretch_lk])

    def moved(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing after displacements and strains, back on its links."""
        return self._affixed(super().moved(u_nd, strain_k))
