"""What vibrates: second derivatives over masses on the motions that a scene admits, and counts of their eigenvalues."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import BoxStrain, Kind
from packmech.constraints.basis import motion_basis
from packmech.constraints.jacobian import scale_of_strain
from packmech.linalg.inertia import CountBelow
from packmech.linalg.mandel import strain_directions
from packmech.mechanics.hessian import corner_of
from packmech.mechanics.linked_systems import Operator, free_translations, link_motions, operator_of, rows_on
from packmech.mechanics.network import Network
from packmech.mechanics.system import bordered, system_of
from packmech.scene import Scene

# enough for all modes that the dense method takes on [bytes]
_BASIS_BYTES = 3e9
# eigenvalues up to this part of the largest are zero to rounding
ZERO = 1e-10


@dataclass(frozen=True, eq=False)
class Vibrations:
    """Second derivatives over masses on the motions that a scene admits.

    Attributes
    ----------
    network
        Particles, contacts and links.
    operator
        Second derivatives by the free coordinates times roots of masses, then by strains times their scale.
    rows
        Independent rows that vanish on what the links admit.
    index_n
        (N',) particles that move, by their numbers in the packing.
    free_nq
        (N', q) which of their coordinates do.
    axis_f, root_f
        (F,) of each free coordinate its place among its particle's, and the root of its mass.
    translation
        (F + s, t) uniform translations that cost nothing, orthonormal.
    admitted_es, strain_scale
        Mandel strains that the box may do, as columns, and the length that makes coordinates of them.
    largest
        Bound on the largest eigenvalue, by row sums [1/time^2].

    """

    network: Network
    operator: Operator
    rows: sp.csr_array
    index_n: NDArray[np.int64]
    free_nq: NDArray[np.bool_]
    axis_f: NDArray[np.int64]
    root_f: NDArray[np.float64]
    translation: NDArray[np.float64]
    admitted_es: NDArray[np.float64]
    strain_scale: float
    largest: float

    @property
    def available(self) -> int:
        """Number of modes besides translations that cost nothing."""
        return max(self.operator.motions - self.translation.shape[1], 0) if len(self.index_n) else 0

    def basis(self) -> NDArray[np.float64] | None:
        """Return an orthonormal basis of what the links admit, as columns; None where there are none."""
        links, network = self.network.links, self.network
        if not len(links):
            return None
        if not network.free_f.all():
            return link_motions(self.rows)
        basis = motion_basis(
            links,
            self.admitted_es,
            mass_n=network.parent.mass_n[self.index_n],
            strain_scale=self.strain_scale,
            memory_limit=_BASIS_BYTES,
        )
        f = len(self.root_f)
        parts = [basis[:f] * self.root_f[:, None], self.admitted_es.T @ basis[f:] * self.strain_scale]
        return np.concatenate(parts)

    def level(self, frequency: float) -> float:
        """Return the eigenvalue of a frequency; of zero one just below those that are zero to rounding.

        Beyond all eigenvalues it is one that lies there, too, but has no more digits than they have.
        """
        unit = self.largest or 1.0
        level = float(np.copysign(min(abs(frequency), 2.0 * unit**0.5) ** 2, frequency))
        return -ZERO * unit if abs(level) <= np.finfo(float).tiny else level

    def count(self, level: float) -> CountBelow:
        """Return how many modes have eigenvalues below a level, and how sure that is."""
        if not len(self.index_n):
            return CountBelow(0, 0.0, float("inf"), None, 0)
        found = self.operator.count(level)
        # uniform translations are zero modes of the matrix, not vibrations
        return found._replace(number=found.number - (self.translation.shape[1] if level > 0.0 else 0))


def vibrations_of(
    scene: Scene,
    kind: Kind = "exact",
    *,
    strain: BoxStrain = "none",
    volume_curvature: str = "det",
    strain_scale: float | None = None,
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
) -> Vibrations:
    """Return what vibrates in a scene; arguments as of `normal_modes`."""
    packing = scene.packing
    mass, dimension = packing.mass_n, packing.dimension
    scale = scale_of_strain(packing, strain_scale)
    admitted = strain_directions(dimension, strain)
    system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers=rattlers, strained=strain != "none")
    network, matrix = system.network, system.matrix()
    moves = network.free_nq.any(axis=1)
    index, free = network.index_n[moves], network.free_nq[moves]
    # turns are lengths, and so have their particle's mass
    axis, root = np.nonzero(free)[1], np.repeat(np.sqrt(mass[index]), free.sum(axis=1))
    if strain != "none":
        corner = admitted.T @ corner_of(system, kind, strain, volume_curvature) @ admitted
        matrix = bordered(matrix, system.column() @ admitted / scale, corner / scale**2)
    weight = np.concatenate([1.0 / root, np.ones(admitted.shape[1])])
    matrix = sp.csr_array(matrix.multiply(weight[:, None]).multiply(weight[None, :]))
    rows = rows_on(system.links, network.free_f, 1.0 / root, admitted, scale)
    translation = free_translations(matrix, rows, root, axis, dimension, network.anchored)
    largest = float(abs(matrix).sum(axis=0).max()) if len(index) else 0.0
    return Vibrations(
        *(network, operator_of(matrix, rows, dimension), rows, index, free, axis, root, translation, admitted, scale),
        largest,
    )
