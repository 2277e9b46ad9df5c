"""What contacts do in numbers: how many there are, where they point, how hard they press, and the chains they form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import instance, integer, one_of, positive, real
from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.jit.blas import single_thread
from packmech.measure.contact_forces import resting_forces
from packmech.measure.rattlers import find_rattlers
from packmech.packing import Packing, no_tangential
from packmech.scene import Scene

_BIN_BYTES = 64.0


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class ContactStatistics:
    """Numbers and directions of the contacts between particles that do not rattle.

    Attributes
    ----------
    count_z
        (Z,) numbers of particles with 0, 1, 2, ... contacts, rattlers left out.
    rattlers
        Number of particles that were left out.
    angle_b
        (B + 1,) edges of the bins of directions: angles of the normals from the first axis, 0 to pi, as a contact has
        no head [rad]; in space cosines of the angle from the last axis, 0 to 1 [1].
    direction_b
        (B,) density of the directions [1/rad], in space [1]: 1/pi and 1 where there is no preference.
    between_b
        (B,) density of the angles between contacts of one particle, neighbors in the order around it in a plane and all
        pairs in space, in `bins` equal bins from 0 to 2 pi in a plane and 0 to pi in space [1/rad].
    fabric_dd
        (d, d) mean of n n over the normals; 1/d times the identity where there is no preference.

    """

    count_z: NDArray[np.int64]
    rattlers: int
    angle_b: NDArray[np.float64]
    direction_b: NDArray[np.float64]
    between_b: NDArray[np.float64]
    fabric_dd: NDArray[np.float64]

    @property
    def mean(self) -> float:
        """Mean number of contacts of a particle [1]; nan without particles."""
        many = int(self.count_z.sum())
        return float((self.count_z * np.arange(len(self.count_z))).sum() / many) if many else math.nan

    @property
    def share_z(self) -> NDArray[np.float64]:
        """The (Z,) shares of particles with so many contacts [1]."""
        return np.asarray(self.count_z / max(int(self.count_z.sum()), 1))

    @property
    def anisotropy(self) -> float:
        """Largest less smallest eigenvalue of the fabric [1]."""
        return float(np.ptp(np.linalg.eigvalsh(self.fabric_dd)))

    def __repr__(self) -> str:
        shares = ", ".join(f"{z}: {share:.3f}" for z, share in enumerate(self.share_z) if share)
        return f"ContactStatistics: mean {self.mean:.6g}, shares {shares}; {self.rattlers} rattlers"


@honors("links shapes", packing_only=True)
def contact_statistics(
    packing: Packing, *, bins: int = 36, gap_tolerance: float | None = None, rattlers: str = "remove"
) -> ContactStatistics:
    """Return histograms of the numbers of contacts of particles and of the directions of contacts.

    Of bodies of beads, contacts between beads count, as in `coordination_number`. Directions are those in which
    contacts press.

    Parameters
    ----------
    packing
        The packing.
    bins
        Number of bins of directions.
    gap_tolerance
        As in `find_contacts`.
    rattlers
        "remove" leaves rattlers and their contacts out; "keep" counts everything.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.contact_statistics(pm.lattice_packing("triangular", repeats=(3, 3)))
    ContactStatistics: mean 6, shares 6: 1.000; 0 rattlers

    """
    instance("packing", packing, Packing)
    no_tangential("packing", packing)
    number = integer("bins", bins, at_least=1, bytes_each=_BIN_BYTES)
    one_of("rattlers", rattlers, ("remove", "keep"))
    contacts = touching_pairs(packing, gap_tolerance)
    loose = np.zeros(packing.particles, dtype=bool)
    if rattlers == "remove":
        loose = find_rattlers(packing, gap_tolerance=gap_tolerance)
        contacts = contacts.among(~loose)
    d, normal = packing.dimension, contacts.normal_cd
    if d == 2:
        angle = np.mod(np.arctan2(normal[:, 1], normal[:, 0]), np.pi)
        edges = np.pi * np.arange(number + 1) / number
    else:
        angle, edges = np.abs(normal[:, 2]), np.arange(number + 1) / number
    between, widest = _angles_between(contacts, normal)
    with single_thread():
        fabric = normal.T @ normal / max(len(normal), 1)
    return ContactStatistics(
        count_z=np.bincount(contacts.count_n()[~loose]),
        rattlers=int(loose.sum()),
        angle_b=edges,
        direction_b=_shares(angle, edges),
        between_b=_shares(between, widest * np.arange(number + 1) / number),
        fabric_dd=fabric,
    )


def _shares(value: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the density of values over bins; a value at an edge to rounding lies above it, the last edge below."""
    wide = float(edges[1])
    place = np.minimum((value * (1.0 + 1e-12) / wide).astype(np.int64), len(edges) - 2)
    return np.asarray(np.bincount(place, minlength=len(edges) - 1) / (max(len(value), 1) * wide))


def _angles_between(
    contacts: Contacts | ShapeContacts, normal_cd: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the angles between contacts of one particle, and the largest that there can be."""
    d = contacts.dimension
    owner = np.concatenate([contacts.i_c, contacts.j_c])
    outward = np.concatenate([normal_cd, -normal_cd])
    if d == 2:
        angle = np.mod(np.arctan2(outward[:, 1], outward[:, 0]), 2.0 * np.pi)
        order = np.lexsort((angle, owner))
        owner, angle = owner[order], angle[order]
        new = np.concatenate([[True], owner[1:] != owner[:-1]]) if len(owner) else np.zeros(0, bool)
        group = np.cumsum(new) - 1
        first = np.flatnonzero(new)
        following = np.concatenate([angle[1:], [0.0]]) if len(angle) else angle
        last = np.concatenate([first[1:] - 1, [len(angle) - 1]]) if len(angle) else first
        following[last] = angle[first] + 2.0 * np.pi
        alone = np.bincount(group)[group] < 2 if len(group) else np.zeros(0, bool)
        return (following - angle)[~alone], 2.0 * np.pi
    order = np.argsort(owner, kind="stable")
    owner, outward = owner[order], outward[order]
    found = []
    size = np.bincount(owner) if len(owner) else np.zeros(0, np.int64)
    start = np.concatenate([[0], np.cumsum(size)])
    for count in np.unique(size):
        # all particles with so many contacts at once
        rows = start[:-1][size == count]
        one, other = np.triu_indices(int(count), 1)
        cosine = (outward[rows[:, None] + one] * outward[rows[:, None] + other]).sum(axis=2)
        found.append(np.arccos(np.clip(cosine, -1.0, 1.0)).ravel())
    return np.concatenate(found) if found else np.zeros(0), np.pi


class _Pressed(NamedTuple):
    """Contacts of a scene and the (C, d) forces on j, [force]."""

    contacts: Contacts | ShapeContacts
    force_cd: NDArray[np.float64]
    vector_cd: NDArray[np.float64]


def _pressed(scene: Scene) -> _Pressed:
    """Return the contacts of a scene, with friction if it has some, that press."""
    instance("scene", scene, Scene)
    found = resting_forces(scene)
    return _Pressed(found.contacts, -found.force_cd, found.contacts.vector_cd)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class ForceDistribution:
    """Sizes of the contact forces, over their mean.

    Attributes
    ----------
    ratio_c
        (C,) sizes of the forces over their mean, growing [1].
    edge_b
        (B + 1,) edges of the bins [1].
    density_b
        (B,) density of the ratios [1]; its sum times the width is the share below the last edge.
    mean
        Mean force [force].

    """

    ratio_c: NDArray[np.float64]
    edge_b: NDArray[np.float64]
    density_b: NDArray[np.float64]
    mean: float

    @property
    def middle_b(self) -> NDArray[np.float64]:
        """The (B,) middles of the bins [1]."""
        return np.asarray(0.5 * (self.edge_b[1:] + self.edge_b[:-1]))

    def share_below(self, ratio: float) -> float:
        """Return the share of contacts whose force is below this many means [1]."""
        return float(np.searchsorted(self.ratio_c, ratio) / max(len(self.ratio_c), 1))

    def moment(self, order: float) -> float:
        """Return the mean of the ratios to a power [1]; 1 for the first, nan without contacts."""
        return float((self.ratio_c**order).mean()) if len(self.ratio_c) else math.nan

    def __repr__(self) -> str:
        return (
            f"ForceDistribution of {len(self.ratio_c)} contacts: mean {self.mean:.6g}, second moment "
            f"{self.moment(2):.4g} of it squared, {100.0 * self.share_below(1.0):.3g} % below the mean"
        )


@honors("repulsion kinds friction rolling gravity walls held shapes", at_rest=True)
def force_distribution(scene: Scene, *, bins: int = 50, largest: float = 5.0) -> ForceDistribution:
    """Return the distribution of the sizes of the contact forces over their mean.

    Forces between particles, tangential ones included where there is friction; pushes of walls are none of them.

    Parameters
    ----------
    scene
        The scene.
    bins
        Number of bins of equal width.
    largest
        Upper edge of the last one, in means [1].

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> pm.force_distribution(pm.Scene(crystal, (pm.Repulsion(),))).ratio_c.round(9).tolist()[:2]
    [1.0, 1.0]

    """
    number, top = integer("bins", bins, at_least=1, bytes_each=_BIN_BYTES), positive("largest", largest)
    size = np.sqrt((_pressed(scene).force_cd ** 2).sum(axis=1))
    mean = float(size.mean()) if len(size) else 0.0
    ratio = np.sort(size / mean) if mean > 0.0 else np.zeros(0)
    edges = top * np.arange(number + 1) / number
    count = np.histogram(ratio, edges)[0]
    return ForceDistribution(ratio, edges, count / (max(len(ratio), 1) * top / number), mean)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class ForceChains:
    """Quasi-linear chains of particles under above-mean stress.

    Attributes
    ----------
    chains
        Each chain's particles from one end to the other, of three or more; closed ones begin anywhere.
    closed
        Which of them are rings.
    stressed_n
        (N,) particles whose largest compressive principal stress is above the mean.
    stress_n
        (N,) that stress times the particle's volume [energy].
    direction_nd
        (N, d) its axis.

    """

    chains: tuple[NDArray[np.int64], ...]
    closed: tuple[bool, ...]
    stressed_n: NDArray[np.bool_]
    stress_n: NDArray[np.float64]
    direction_nd: NDArray[np.float64]

    @property
    def length_k(self) -> NDArray[np.int64]:
        """The (K,) lengths of the chains, in particles."""
        return np.array([len(one) for one in self.chains], dtype=np.int64)

    @property
    def mean_length(self) -> float:
        """Mean length of a chain, in particles; nan without chains."""
        return float(self.length_k.mean()) if self.chains else math.nan

    @property
    def share(self) -> float:
        """Share of the particles that are in a chain [1]."""
        return float(self.length_k.sum() / len(self.stress_n))

    def __repr__(self) -> str:
        return (
            f"ForceChains: {len(self.chains)} chains of {self.mean_length:.4g} particles on average, "
            f"{100.0 * self.share:.3g} % of {len(self.stress_n)}"
        )


@honors("repulsion kinds friction rolling gravity walls held shapes", at_rest=True)
def force_chains(scene: Scene, *, angle: float = 45.0) -> ForceChains:
    """Return the force chains of a scene at rest.

    After Peters, Muthuswamy, Wibowo and Tordesillas, Physical Review E 72, 041307 (2005): particles whose largest
    compressive principal stress is above the mean of all, where each next one touches the one before and lies within an
    angle of the principal axis of either. Of several next ones at one end the straightest counts, by the larger of the
    two angles, and a step is one that both ends choose: so chains do not branch. A chain has three particles at least.
    A particle's stress is the sum over its contacts of force times arm, the arm half the vector between centers.

    Parameters
    ----------
    scene
        The scene.
    angle
        Largest angle between a principal axis and the way to the next particle [degrees], up to 90.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> place = [[0.45 + 0.9 * k, 0.5] for k in range(5)] + [[2.0, 2.5]]
    >>> row = pm.Packing(place, [0.5] * 6, pm.Box([[4.5, 0.0], [0.0, 4.0]]))
    >>> found = pm.force_chains(pm.Scene(row, (pm.Repulsion(),)))
    >>> found.length_k.tolist(), found.closed
    ([5], (True,))

    """
    limit = math.cos(math.radians(real("angle", angle, above=0.0, at_most=90.0)))
    contacts, force, vector = _pressed(scene)
    n, d = scene.packing.particles, scene.packing.dimension
    # either end of a contact has the same force times half the vector; compression counts positive
    half = 0.5 * force[:, :, None] * vector[:, None, :]
    half = 0.5 * (half + half.transpose(0, 2, 1))
    moment = np.zeros((n, d, d))
    for a in range(d):
        for b in range(d):
            moment[:, a, b] = np.bincount(contacts.i_c, half[:, a, b], n) + np.bincount(contacts.j_c, half[:, a, b], n)
    value, axis = np.linalg.eigh(moment)
    stress, direction = value[:, -1], axis[:, :, -1]
    stressed = stress > stress.mean() if n else np.zeros(0, bool)
    steps = _steps(contacts, vector, stressed, direction, limit)
    chains, closed = _walked(steps)
    return ForceChains(chains, closed, stressed, stress, direction)


def _steps(
    contacts: Contacts | ShapeContacts,
    vector_cd: NDArray[np.float64],
    stressed_n: NDArray[np.bool_],
    direction_nd: NDArray[np.float64],
    limit: float,
) -> dict[tuple[int, int], tuple[int, int]]:
    """Return, for ends (particle, side) of which each is the other's straightest, the end that they meet."""
    i, j = contacts.i_c, contacts.j_c
    unit = vector_cd / np.sqrt((vector_cd**2).sum(axis=1, keepdims=True))
    at_i, at_j = ((unit * direction_nd[one]).sum(axis=1) for one in (i, j))
    straight = np.minimum(np.abs(at_i), np.abs(at_j))
    kept = np.flatnonzero(stressed_n[i] & stressed_n[j] & (i != j) & (straight >= limit))
    # straightest first, and of equal ones in the order of the contacts
    kept = kept[np.argsort(-straight[kept], kind="stable")]
    chosen: dict[tuple[int, int], int] = {}
    ends = {}
    for c in kept.tolist():
        ends[c] = (int(i[c]), int(at_i[c] > 0.0)), (int(j[c]), int(at_j[c] < 0.0))
        for end in ends[c]:
            chosen.setdefault(end, c)
    found = {}
    for c, (one, other) in ends.items():
        if chosen[one] == c and chosen[other] == c:
            found[one], found[other] = other, one
    return found


def _walked(steps: dict[tuple[int, int], tuple[int, int]]) -> tuple[tuple[NDArray[np.int64], ...], tuple[bool, ...]]:
    """Return the chains of three particles or more that the steps make, and which are closed."""
    chains, closed = [], []
    seen: set[int] = set()

    def walk(start: int, side: int) -> list[int]:
        row, end = [start], (start, side)
        while end in steps:
            n, came = steps[end]
            if n == start:
                break
            row.append(n)
            end = (n, 1 - came)
        return row

    particles = sorted({n for n, _ in steps})
    # ends first, so that only rings are left
    for tips in (True, False):
        for n in particles:
            sides = [side for side in (0, 1) if (n, side) in steps]
            if n in seen or (tips and len(sides) != 1):
                continue
            row = walk(n, sides[0])
            seen.update(row)
            if len(row) >= 3:
                chains.append(np.array(row, dtype=np.int64))
                closed.append(not tips)
    return tuple(chains), tuple(closed)
