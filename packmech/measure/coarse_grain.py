# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Fields of a packing on a grid: density, momentum and stress, averaged with a Gaussian so that their balances hold.

Goldhirsch, Granular Matter 12, 239 (2010): what a contact bears is spread along the line between the centers, so that
the divergence of the stress is the force on the particles, spread as their mass is, at every point and width.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import STRAINED, honors
from packmech.calls.status import shown_as
from packmech.check import brief, finite_array, instance, integer, positive
from packmech.jit.compiled import kernel
from packmech.measure.contact_forces import ContactForces, resting_forces
from packmech.scene import Scene

# the Gaussian is cut where it has fallen to 6e-13 of its height [width]
_CUT = 7.5
# points of a grid are so far apart where none is asked for: sums over them are integrals to 1e-15 [width]
_SPACING = 0.7
# more points than this are refused: their stresses alone take gigabytes
_MOST = 2**26
# and what visits more of them: ten minutes of work
_MOST_VISITS = 1e11


@kernel
def _spread(start_sd, vector_sd, value_sq, lattice_dd, inverse_dd, height_d, shape_d, width, field_gq):
    """Add values of straight segments, or points, to a periodic grid, each spread by a Gaussian about it."""
    d = lattice_dd.shape[0]
    low, high, place = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(3)
    unit = (2.0 * math.pi) ** (-0.5 * d) * width ** (-d)
    across_unit = unit * math.sqrt(2.0 * math.pi) * width
    for s in range(start_sd.shape[0]):
        length = 0.0
        for a in range(d):
            length += vector_sd[s, a] * vector_sd[s, a]
        length = math.sqrt(length)
        for a in range(d):
            begin, along = 0.0, 0.0
            for b in range(d):
                begin += inverse_dd[a, b] * start_sd[s, b]
                along += inverse_dd[a, b] * vector_sd[s, b]
            reach = _CUT * width / height_d[a]
            low[a] = math.ceil((min(begin, begin + along) - reach) * shape_d[a])
            high[a] = math.floor((max(begin, begin + along) + reach) * shape_d[a]) + 1
        third_low, third_high = (low[2], high[2]) if d == 3 else (0, 1)
        for k0 in range(low[0], high[0]):
            for k1 in range(low[1], high[1]):
                for k2 in range(third_low, third_high):
                    square, along = 0.0, 0.0
                    for a in range(d):
                        x = lattice_dd[a, 0] * k0 / shape_d[0] + lattice_dd[a, 1] * k1 / shape_d[1]
                        if d == 3:
                            x += lattice_dd[a, 2] * k2 / shape_d[2]
                        place[a] = x - start_sd[s, a]
                        square += place[a] * place[a]
                        along += place[a] * vector_sd[s, a]
                    if length > 0.0:
                        along /= length
                        ends = math.erf(along / (math.sqrt(2.0) * width))
                        ends -= math.erf((along - length) / (math.sqrt(2.0) * width))
                        across = max(square - along * along, 0.0)
                        weight = across_unit * math.exp(-0.5 * across / (width * width)) * 0.5 * ends / length
                    else:
                        weight = unit * math.exp(-0.5 * square / (width * width))
                    g = k0 % shape_d[0] * shape_d[1] + k1 % shape_d[1]
                    if d == 3:
                        g = g * shape_d[2] + k2 % shape_d[2]
                    for q in range(value_sq.shape[1]):
                        field_gq[g, q] += weight * value_sq[s, q]


class _Grid(NamedTuple):
    """A periodic grid of a box, and the width of what is spread on it."""

    box: Box
    shape: tuple[int, ...]
    width: float

    def spread(
        self,
        value_sq: NDArray[np.float64],
        start_sd: NDArray[np.float64],
        vector_sd: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return the (G, Q) field of values at points, or on segments from these."""
        field = np.zeros((math.prod(self.shape), value_sq.shape[1]))
        vector = np.zeros_like(start_sd) if vector_sd is None else np.ascontiguousarray(vector_sd)
        box = self.box
        _spread(
            np.ascontiguousarray(start_sd),
            vector,
            np.ascontiguousarray(value_sq),
            box.lattice_dd,
            box.inverse_dd,
            box.height_d,
            np.array(self.shape),
            self.width,
            field,
        )
        return field


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class CoarseFields:
    """Fields on a periodic grid of the cell; point g has the fractions (g0 / n0, g1 / n1, ...), the last runs fastest.

    Attributes
    ----------
    point_gd
        (G, d) points [length].
    density_g
        (G,) mass over volume [mass/length^d].
    momentum_gd
        (G, d) momentum over volume; zero without velocities.
    contact_stress_gdd
        (G, d, d) stress of contacts, bonds and links [energy/length^d], tension positive, row = force component.
    kinetic_stress_gdd
        (G, d, d) minus the momentum that velocities about the local mean carry [energy/length^d].
    shape
        Numbers of points along the lattice vectors; an array f_g is f_g.reshape(shape) on the grid.
    width
        Standard deviation of the Gaussian [length].

    """

    point_gd: NDArray[np.float64]
    density_g: NDArray[np.float64]
    momentum_gd: NDArray[np.float64]
    contact_stress_gdd: NDArray[np.float64]
    kinetic_stress_gdd: NDArray[np.float64]
    shape: tuple[int, ...]
    width: float

    @property
    def velocity_gd(self) -> NDArray[np.float64]:
        """The (G, d) momentum over density [length/time]; nan where there is no mass."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.momentum_gd / self.density_g[:, None])

    @property
    def stress_gdd(self) -> NDArray[np.float64]:
        """The (G, d, d) whole stress [energy/length^d], tension positive."""
        return self.contact_stress_gdd + self.kinetic_stress_gdd

    @property
    def pressure_g(self) -> NDArray[np.float64]:
        """The (G,) pressures -trace(stress) / d [energy/length^d]."""
        return np.asarray(-np.trace(self.stress_gdd, axis1=1, axis2=2) / self.point_gd.shape[1])

    def __repr__(self) -> str:
        pressure = self.pressure_g
        return (
            f"CoarseFields on {' x '.join(map(str, self.shape))} points, width {self.width:.4g}: density "
            f"{self.density_g.min():.4g} to {self.density_g.max():.4g}, pressure {pressure.min():.4g} to "
            f"{pressure.max():.4g}"
        )


def _shape(shape: int | Sequence[int] | None, box: Box, width: float) -> tuple[int, ...]:
    """Return the numbers of points along the lattice vectors, checked."""
    d = box.dimension
    if shape is None:
        with np.errstate(over="ignore", divide="ignore"):
            count = np.ceil(np.sqrt((box.lattice_dd**2).sum(axis=0)) / (_SPACING * width))
        if not math.prod(count.tolist()) <= _MOST:
            raise ValueError(f"width must be so large that {_MOST} points are enough, got {width:g}")
        found = tuple(int(one) for one in count)
    elif isinstance(shape, Sequence) and not isinstance(shape, str):
        if len(shape) != d:
            raise ValueError(f"shape must be {d} numbers of points, got {brief(shape)}")
        found = tuple(integer("shape", one, at_least=1) for one in shape)
    else:
        found = (integer("shape", shape, at_least=1),) * d
    if math.prod(found) > _MOST:
        raise ValueError(f"shape must be at most {_MOST} points in all, got {' x '.join(map(str, found))}")
    return found


def _contact_stress(grid: _Grid, forces: ContactForces) -> NDArray[np.float64]:
    """Return the (G, d, d) stress of all that acts between two particles."""
    position, d = forces.scene.packing.position_nd, forces.scene.packing.dimension
    contacts = forces.contacts
    parts = [(contacts.i_c, contacts.vector_cd, forces.force_cd)]
    beyond = forces.interactions
    if len(beyond):
        parts.append((beyond.pairs.i_c, beyond.pairs.vector_cd, beyond.pull_cx[:, :d]))
    if forces.scene.packing.links:
        links = forces.link_pairs
        parts.append((links.i_c, links.vector_cd, forces.tension_l[:, None] * links.normal_cd))
    stress = np.zeros((math.prod(grid.shape), d * d))
    for i, vector, force in parts:
        stress += grid.spread((force[:, :, None] * vector[:, None, :]).reshape(len(i), d * d), position[i], vector)
    return stress.reshape(-1, d, d)


@shown_as("coarse graining")
@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links shapes breaking memory",
    at_rest=True,
    link_tolerance=STRAINED,
)
def coarse_grain(
    scene: Scene,
    width: float,
    *,
    shape: int | Sequence[int] | None = None,
    velocity_nd: ArrayLike | None = None,
) -> CoarseFields:
    """Return density, momentum and stress of a scene on a grid, averaged with a Gaussian of a width.

    Equations 9 to 26 of Goldhirsch, Granular Matter 12, 239 (2010). Mass and momentum sit at the centers, and a force
    between two particles is spread along the line from center to center, so that at every point the divergence of the
    contact stress is the sum of the forces between particles on each, spread as its mass is. Its mean over the cell is
    `stress_tensor`. Weights and pushes of walls have no part in it.

    Parameters
    ----------
    scene
        The scene.
    width
        Standard deviation of the Gaussian [length]: below a diameter particles are seen, at some diameters fields.
    shape
        Numbers of points along the lattice vectors, or one for all. None: points .7 widths apart, so that sums over
        them are integrals.
    velocity_nd
        (N, d) velocities [length/time]; None: at rest.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> fields = coarse_grain(pm.Scene(crystal, (pm.Repulsion(),)), width=1.0)
    >>> apart = fields.contact_stress_gdd.mean(axis=0) - pm.stress_tensor(pm.Scene(crystal, (pm.Repulsion(),)))
    >>> fields.shape, bool(np.abs(apart).max() < 1e-15)
    ((6, 6), True)

    """
    instance("scene", scene, Scene)
    packing = scene.packing
    n, d = packing.particles, packing.dimension
    grid = _Grid(packing.box, _shape(shape, packing.box, positive("width", width)), float(width))
    reach = (grid.width / height for height in packing.box.height_d.tolist())
    visits = float(n) * math.prod(1.0 + 2.0 * _CUT * r * k for r, k in zip(reach, grid.shape, strict=True))
    if not visits <= _MOST_VISITS:
        raise ValueError(
            f"width and shape must be such that particles spread to {_MOST_VISITS:.0e} points at most, counted again "
            f"in each copy of the cell, got a width of {grid.width:g} and {' x '.join(map(str, grid.shape))} points, "
            f"which takes {visits:.1e}"
        )
    velocity = np.zeros((n, d))
    if velocity_nd is not None:
        velocity = finite_array("velocity_nd", velocity_nd, shape=(n, d), what="particle")
    mass = packing.mass_n[:, None]
    carried = (velocity[:, :, None] * velocity[:, None, :]).reshape(n, d * d)
    sums = grid.spread(np.hstack([mass, mass * velocity, mass * carried]), packing.position_nd)
    density, momentum = sums[:, 0], sums[:, 1 : 1 + d]
    inverse = np.divide(1.0, density, out=np.zeros_like(density), where=density > 0.0)
    whole = momentum[:, :, None] * momentum[:, None, :] * inverse[:, None, None]
    count = np.meshgrid(*[np.arange(k) / k for k in grid.shape], indexing="ij")
    point = np.stack(count, axis=-1).reshape(-1, d) @ packing.box.lattice_dd.T
    kinetic = whole - sums[:, 1 + d :].reshape(-1, d, d)
    stress = _contact_stress(grid, resting_forces(scene))
    return CoarseFields(point, density, momentum, stress, kinetic, grid.shape, grid.width)
