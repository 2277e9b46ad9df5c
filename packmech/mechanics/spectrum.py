"""Density of vibrational states, exact for any bins: from all modes, or by counting eigenvalues between them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, integer, one_of
from packmech.compiled import single_thread
from packmech.mechanics.hessian import closed_terms, scene_sums
from packmech.mechanics.link_modes import FreeOperator, LinkedOperator, Operator, weighted_rows
from packmech.mechanics.modes import Modes
from packmech.mechanics.network import held_network
from packmech.mechanics.rigidity import TOUCHING
from packmech.scene import Scene


@dataclass(frozen=True, eq=False)
class StateDensity:
    """Density of vibrational states over angular frequency.

    Attributes
    ----------
    edge_b
        (B + 1,) edges of the bins [1/time].
    count_b
        (B,) number of modes in each bin, uniform translations left out.
    modes
        Number of modes that the packing has besides translations, d N' - d.
    seconds
        CPU time.

    """

    edge_b: NDArray[np.float64]
    count_b: NDArray[np.int64]
    modes: int
    seconds: float

    @property
    def density_b(self) -> NDArray[np.float64]:
        """The (B,) density [time]: its integral over all frequencies is 1."""
        return self.count_b / (np.diff(self.edge_b) * self.modes)

    @property
    def center_b(self) -> NDArray[np.float64]:
        """The (B,) middles of the bins [1/time]."""
        return (self.edge_b[1:] + self.edge_b[:-1]) / 2.0


def density_of_states(
    source: Modes | Scene,
    bins: int | ArrayLike = 50,
    *,
    kind: str = "exact",
    rattlers: str = "remove",
    gap_tolerance: float = TOUCHING,
) -> StateDensity:
    """Return the density of vibrational states D(omega) = (N(omega + d omega) - N(omega)) / d omega, normalized to 1.

    N counts the modes up to a frequency, uniform translations left out, so that the normalization is d N' - d modes.
    For a scene N is counted by the inertia of the shifted Hessian, one sparse factorization for each bin edge and no
    mode computed: exact for any number of particles. Frequencies of unstable modes are minus their growth rates.

    Parameters
    ----------
    source
        All modes of a packing (`normal_modes(scene)`), or a scene, taken with masses 1 in its fixed box.
    bins
        Number of bins between zero (or the lowest unstable frequency) and the highest, or their edges [1/time].
    kind, rattlers, gap_tolerance
        As in `normal_modes`; used for a scene.

    Raises
    ------
    TypeError, ValueError
        If the source is neither, the modes are only some of the packing's, or the edges do not increase.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(6, 6)), (pm.Repulsion(),))
    >>> states = pm.density_of_states(scene, 10)
    >>> int(states.count_b.sum()), round(float((states.density_b * np.diff(states.edge_b)).sum()), 12)
    (70, 1.0)

    """
    start = time.process_time()
    if isinstance(source, Modes):
        if not source.complete:
            raise ValueError(
                f"source must hold all modes, got {len(source)} of {source.available}; "
                "call normal_modes without a count, or pass the scene"
            )
        frequency = source.frequency_m
        top = max(float(frequency.max(initial=0.0)), 0.0)
        edge = _edges(bins, min(float(frequency.min(initial=0.0)), 0.0), top)
        count = np.histogram(frequency, edge)[0]
        return StateDensity(edge, count.astype(np.int64), source.available, time.process_time() - start)
    instance("source", source, Scene)
    one_of("kind", kind, ("exact", "paper", "unstressed"))
    contacts, index, links = held_network(source.packing, gap_tolerance=gap_tolerance, rattlers=rattlers)
    dimension = source.packing.dimension
    if not len(index):
        return StateDensity(_edges(bins, 0.0, 1.0), np.zeros(1, np.int64), 0, time.process_time() - start)
    with single_thread():
        matrix = scene_sums(contacts, closed_terms(source, contacts), kind, links).position_matrix()
        operator: Operator = FreeOperator(matrix)
        if links is not None:
            size = matrix.shape[0]
            rows = weighted_rows(links, np.ones(size), np.zeros((dimension * (dimension + 1) // 2, 0)), 1.0)
            operator = LinkedOperator(matrix, rows, dimension)
        low, high = _ends(operator)
        edge = _edges(bins, low, high)
        # zero modes have eigenvalues of either sign at rounding: an edge at zero counts all of them above it
        rounding = 1e-10 * high**2
        level = np.sign(edge) * edge**2
        level[np.abs(level) < rounding] = -rounding
        below = np.array([operator.below(float(one)) for one in level])
        # uniform translations are zero modes of the matrix, not vibrations
        below = below - np.where(level > 0.0, dimension, 0)
    modes = operator.motions - dimension
    return StateDensity(edge, np.diff(below).astype(np.int64), modes, time.process_time() - start)


def _edges(bins: int | ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    if isinstance(bins, int | np.integer):
        number = integer("bins", bins, at_least=1)
        return np.linspace(low, high if high > low else low + 1.0, number + 1)
    edge = finite_array("bins", bins, shape=(None,), what="edge")
    if len(edge) < 2 or (np.diff(edge) <= 0.0).any():
        raise ValueError(f"bins must be a number or at least two increasing edges, got {edge.tolist()}")
    return edge


def _ends(operator: Operator) -> tuple[float, float]:
    """Return frequencies just below the lowest and above the highest mode, zero if none is unstable."""
    import scipy.sparse.linalg as spla

    rows = operator.size
    if rows < 40:
        value = np.linalg.eigvalsh(operator.apply(operator.project(np.eye(rows))))
        lowest, highest = float(value[0]), float(value[-1])
    else:
        begin = operator.project(np.random.default_rng(0).normal(size=rows))
        plain = spla.LinearOperator((rows, rows), matvec=lambda v: operator.apply(v.ravel()), dtype=np.float64)
        highest = float(spla.eigsh(plain, k=1, which="LA", v0=begin, return_eigenvectors=False)[0])
        lowest = 0.0
        if operator.below(-1e-10 * highest):
            lowest = float(spla.eigsh(plain, k=1, which="SA", v0=begin, return_eigenvectors=False)[0])
    floor = -1e-10 * abs(highest)
    # a hair outside, so that the outermost modes fall inside the outermost bins
    low = -np.sqrt(-lowest) * (1.0 + 1e-9) if lowest < floor else 0.0
    return float(low), float(np.sqrt(max(highest, 0.0)) * (1.0 + 1e-9))
