"""How particles moved from one packing to another: with the box, beyond it, and beyond a strain of their neighbors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import finite_array, instance, one_of
from packmech.contacts.surroundings import RULES, Neighbors, find_neighbors
from packmech.packing import Packing

# neighbors that are nearer than this are compared, as Falk and Langer did [mean diameter]
_NEAR = 2.5
# the least of the sums of squares along the axes of a neighborhood over their mean, below which no strain is known
_FLAT = 1e-9


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class Displacements:
    """Displacements of particles between two packings of them.

    Attributes
    ----------
    deformation_dd
        (d, d) F that takes the lattice vectors of the first box to those of the second.
    nonaffine_nd
        (N, d) x' - F x, to the nearest image [length].
    displacement_nd
        (N, d) x' - x for the positions as they stand in the first packing: (F - 1) x more [length].

    """

    deformation_dd: NDArray[np.float64]
    nonaffine_nd: NDArray[np.float64]
    displacement_nd: NDArray[np.float64]

    @property
    def drift_d(self) -> NDArray[np.float64]:
        """The (d,) mean of the nonaffine displacements [length]."""
        return np.asarray(self.nonaffine_nd.mean(axis=0))

    @property
    def mean_square(self) -> float:
        """Mean square of the nonaffine displacements about their mean [length^2]."""
        return float(((self.nonaffine_nd - self.drift_d) ** 2).sum(axis=1).mean())

    @property
    def participation(self) -> float:
        """The part of the particles that moves, (sum u^2)^2 / (N sum u^4) about the mean: 1/N for one, 1 for all."""
        square = ((self.nonaffine_nd - self.drift_d) ** 2).sum(axis=1)
        total = float((square**2).sum())
        return float(square.sum()) ** 2 / (len(square) * total) if total > 0.0 else math.nan

    def __repr__(self) -> str:
        return (
            f"Displacements of {len(self.nonaffine_nd)} particles: nonaffine, root mean square "
            f"{math.sqrt(self.mean_square):.6g}, of a share of {self.participation:.3g}"
        )


def _check_same(before: Packing, after: Packing) -> None:
    instance("before", before, Packing)
    instance("after", after, Packing)
    for name in ("particles", "dimension"):
        if getattr(before, name) != getattr(after, name):
            raise ValueError(
                f"after must have the {name} of before, {getattr(before, name)}, got {getattr(after, name)}"
            )


@honors("links shapes", packing_only=True)
def displacements(before: Packing, after: Packing, *, deformation_dd: ArrayLike | None = None) -> Displacements:
    """Return how the particles of a packing moved to those of another: with the box, and beyond its strain.

    Parameters
    ----------
    before, after
        Packings of the same particles. Beyond the strain of the box none may have moved farther than half of its
        shortest lattice vector: of packings that are farther apart, compare those between.
    deformation_dd
        (d, d) strain of the box, 1 + the gradient of displacements; it takes the first box to the second, or to another
        choice of its lattice vectors. None: it takes lattice vectors to lattice vectors.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packings are not of the same particles.

    Examples
    --------
    >>> import packmech as pm
    >>> box = pm.Box.cubic(4.0, 2)
    >>> one = pm.Packing([[0.1, 1.0], [2.0, 3.0]], [0.5, 0.5], box)
    >>> other = pm.Packing([[3.9, 1.0], [2.0, 3.0]], [0.5, 0.5], box)
    >>> displacements(one, other).nonaffine_nd.round(12).tolist()
    [[-0.2, 0.0], [0.0, 0.0]]

    """
    _check_same(before, after)
    d = before.dimension
    if deformation_dd is None:
        deformation = after.box.lattice_dd @ before.box.inverse_dd
    else:
        deformation = finite_array("deformation_dd", deformation_dd, shape=(d, d))
    apart = after.position_nd - before.position_nd @ deformation.T
    nonaffine = apart + after.box.nearest_images(apart) @ after.box.lattice_dd.T
    affine = before.position_nd @ (deformation - np.eye(d)).T
    return Displacements(deformation, nonaffine, affine + nonaffine)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class LocalStrain:
    """The strain of each particle's neighborhood, and what of the motion is none (D2min).

    Attributes
    ----------
    d2min_n
        (N,) least sums over neighbors of |r' - F_i r|^2 [length^2]; nan where neighbors do not determine a strain.
    deformation_ndd
        (N, d, d) the F_i of that least sum.
    neighbors
        The neighbors in the first packing.

    """

    d2min_n: NDArray[np.float64]
    deformation_ndd: NDArray[np.float64]
    neighbors: Neighbors

    @property
    def mean_d2min_n(self) -> NDArray[np.float64]:
        """The (N,) same sums over the numbers of neighbors [length^2]."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.d2min_n / self.neighbors.count_n)

    @property
    def strain_ndd(self) -> NDArray[np.float64]:
        """The (N, d, d) strains (F^T F - 1) / 2 of Green and Lagrange [1]."""
        f = self.deformation_ndd
        return np.asarray(0.5 * (np.einsum("nki,nkj->nij", f, f) - np.eye(f.shape[1])))

    @property
    def shear_strain_n(self) -> NDArray[np.float64]:
        """The (N,) shear strains of von Mises, sqrt(e : e / 2) of the strain's deviator e [1]."""
        strain = self.strain_ndd
        d = strain.shape[1]
        trace = np.trace(strain, axis1=1, axis2=2)
        deviator = strain - trace[:, None, None] / d * np.eye(d)
        return np.asarray(np.sqrt(0.5 * (deviator**2).sum(axis=(1, 2))))

    @property
    def undetermined(self) -> int:
        """Number of particles whose neighbors are too few, or all on a line or plane, to have a strain."""
        return int(np.isnan(self.d2min_n).sum())

    def __repr__(self) -> str:
        known = self.d2min_n[~np.isnan(self.d2min_n)]
        middle, most = (float(np.median(known)), float(known.max())) if len(known) else (math.nan, math.nan)
        without = f"; {self.undetermined} have none" if self.undetermined else ""
        return (
            f"LocalStrain of {len(self.d2min_n)} particles: D2min, median {middle:.6g}, largest {most:.6g}, neighbors "
            f"by {self.neighbors.rule}{without}"
        )


@shown_as("local strain")
@honors("links shapes", packing_only=True)
def local_strain(
    before: Packing,
    after: Packing,
    neighbors: Neighbors | str = "cutoff",
    *,
    cutoff: float | None = None,
    deformation_dd: ArrayLike | None = None,
) -> LocalStrain:
    """Return the strain of each particle's neighborhood between two packings, and D2min, what is left beyond it.

    Of the vectors r to neighbors in the first packing and r' to the same in the second, F_i makes the sum of
    |r' - F_i r|^2 least, and D2min is that least sum: equations 2.11 to 2.13 of Falk and Langer, Phys. Rev. E 57, 7192
    (1998). A homogeneous strain has none.

    Parameters
    ----------
    before, after, deformation_dd
        As in `displacements`.
    neighbors
        A rule of `find_neighbors`, or the neighbors that it gave for the first packing.
    cutoff
        Of the rules that have one. None: 2.5 mean diameters for "cutoff".

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packings are not of the same particles.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(6, 6))
    >>> box = crystal.box.strained([[0.0, 0.1], [0.0, 0.0]])
    >>> sheared = crystal.replace(box=box, position_nd=crystal.position_nd @ [[1.0, 0.0], [0.1, 1.0]])
    >>> found = local_strain(crystal, sheared)
    >>> bool(found.d2min_n.max() < 1e-25), (found.deformation_ndd[0].round(12) + 0.0).tolist()
    (True, [[1.0, 0.1], [0.0, 1.0]])

    """
    moved = displacements(before, after, deformation_dd=deformation_dd)
    if isinstance(neighbors, str):
        rule = one_of("neighbors", neighbors, RULES)
        if rule == "cutoff" and cutoff is None:
            cutoff = _NEAR * 2.0 * float(before.radius_n.mean())
        neighbors = find_neighbors(before, rule, cutoff=cutoff)
    elif cutoff is not None:
        raise TypeError("cutoff must be left out where neighbors are given")
    instance("neighbors", neighbors, Neighbors)
    n, d = before.particles, before.dimension
    if neighbors.particles != n:
        raise ValueError(f"neighbors must be those of the packing, of {n} particles, got {neighbors.particles}")
    i, j, old = neighbors.i_p, neighbors.j_p, neighbors.vector_pd
    new = old @ moved.deformation_dd.T + moved.nonaffine_nd[j] - moved.nonaffine_nd[i]
    across, along = np.zeros((n, d, d)), np.zeros((n, d, d))
    for a in range(d):
        for b in range(d):
            across[:, a, b] = np.bincount(i, new[:, a] * old[:, b], n)
            along[:, a, b] = np.bincount(i, old[:, a] * old[:, b], n)
    least = np.linalg.eigvalsh(along)[:, 0]
    flat = ~(least > _FLAT * np.trace(along, axis1=1, axis2=2))
    along[flat] = np.eye(d)
    solved = np.linalg.solve(along, across.transpose(0, 2, 1))
    deformation = np.asarray(solved.transpose(0, 2, 1), dtype=np.float64).copy()
    deformation[flat] = np.nan
    left = new - np.einsum("pab,pb->pa", deformation[i], old)
    d2min = np.asarray(np.bincount(i, (left**2).sum(axis=1), n), dtype=np.float64)
    d2min[flat] = np.nan
    return LocalStrain(d2min, deformation, neighbors)
