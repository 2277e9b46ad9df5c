"""Fragments: what stays together when bonds of a packing are cut along straight lines or around centers."""

from __future__ import annotations

import itertools
import math
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.check import boolean, brief, clear_errors, instance, integer, one_of, real
from packmech.generate.random import generator_of
from packmech.links import Links, image_offsets
from packmech.packing import Packing

SPANNING = ("avoided", "allowed")
# a fragment this high over the box spans it
_HIGH = 0.9


class BondsLike(Protocol):
    """What is cut here: bonds between particles i_b and j_b, through images, that can be selected."""

    @property
    def i_b(self) -> NDArray[np.int64]:
        """(B,) first particles."""
        ...

    @property
    def j_b(self) -> NDArray[np.int64]:
        """(B,) second particles."""
        ...

    @property
    def image_bd(self) -> NDArray[np.int64]:
        """(B, d) images."""
        ...

    def select(self, keep_b: NDArray[np.bool_]) -> Any:
        """Return the bonds that are marked."""
        ...


B = TypeVar("B", bound=BondsLike)


@clear_errors
def cut_fragments(
    bonds: B,
    packing: Packing,
    *,
    centers: int | None = None,
    lines: int | None = None,
    edge_fuzziness: float = 0.0,
    avoided_angle: float = math.pi / 12.0,
    cut_top_bottom: bool = False,
    join_isolated: bool = True,
    removed_fraction: float = 0.0,
    spanning: str = "avoided",
    axis: int = 1,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    tries: int = 100,
) -> B:
    """Return the bonds that are left when a bonded packing is cut into fragments.

    First the cuts, then isolated particles are joined, then it is seen whether a fragment spans the box (the cuts are
    drawn again if so), then non-essential bonds are taken away. So does particleShear; a bond across
    the boundary of the box is a bond like any other.

    Parameters
    ----------
    bonds
        The bonds, such as those of `pm.bond_contacts`.
    packing
        The packing that they are in.
    centers
        Each particle goes to the nearest of so many random centers, through the nearest of its images; bonds between
        particles that go to different ones are cut. 0: none is.
    lines
        Or cut along so many random straight lines (planes in space) through the cell: bonds that cross one, as seen
        from either end, are cut. Lines end at the cell's sides, so that what lies on both sides of these hangs together
        unless `cut_top_bottom` is set.
    edge_fuzziness
        A number drawn between 0 and this times the largest radius is added to each distance from a center [1].
    avoided_angle
        Lines closer than this to lying across the axis are drawn again [rad].
    cut_top_bottom
        Cut the bonds that cross the sides of the cell across the axis.
    join_isolated
        Give particles without a bond one of the bonds back that they had, by chance (not one that crosses a side that
        is cut).
    removed_fraction
        Take this share of the bonds away after the cuts [1], by chance among those whose loss leaves fragments whole.
    spanning
        "avoided": no fragment is higher along the axis than 0.9 of the box, or winds around it there; "allowed".
        Without centers and lines it has no part.
    axis
        Lattice vector along which heights are measured (across the layers of the box's other vectors).
    seed, rng
        Exactly one of them: a seed, or a generator. The same seed gives the same bits.
    tries
        How often cuts are drawn at most.

    Raises
    ------
    TypeError, ValueError
        Naming the argument; also where a fragment spans the box in all tries, or fewer bonds than asked for can go.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(12, 12), relative_overlap=0.01)
    >>> bonds = pm.bond_contacts(packing)
    >>> cut = pm.cut_fragments(bonds, packing, centers=6, seed=1)
    >>> len(bonds) > len(cut), len(set(fragment_numbers(cut, packing.particles)))
    (True, 6)

    """
    instance("packing", packing, Packing)
    if not all(hasattr(bonds, name) for name in ("i_b", "j_b", "image_bd", "select")):
        raise TypeError(f"bonds must be Bonds, got {brief(bonds)}")
    _fits(bonds, packing)
    if centers is not None:
        centers = integer("centers", centers, at_least=0, bytes_each=16.0)
        if lines is not None:
            raise ValueError(f"lines must be left out where centers are given, got {brief(lines)}")
    if lines is not None:
        lines = integer("lines", lines, at_least=0)
    fuzziness = real("edge_fuzziness", edge_fuzziness, at_least=0.0)
    angle = real("avoided_angle", avoided_angle, at_least=0.0, below=math.pi / 2.0)
    boolean("cut_top_bottom", cut_top_bottom)
    boolean("join_isolated", join_isolated)
    removed = real("removed_fraction", removed_fraction, at_least=0.0, at_most=1.0)
    one_of("spanning", spanning, SPANNING)
    axis = integer("axis", axis, at_least=0, at_most=packing.dimension - 1)
    rng = generator_of(seed, rng)
    tries = integer("tries", tries, at_least=1)

    cell = _CutCell(packing, bonds)
    whole_b = cell.image_bd[:, axis] == 0 if cut_top_bottom else np.ones(len(bonds.i_b), dtype=bool)
    cutting = bool(centers) or bool(lines)
    for _ in range(tries):
        keep_b = whole_b.copy()
        if centers:
            keep_b &= cell.same_center(centers, fuzziness, rng)
        if lines:
            keep_b &= cell.uncut(lines, axis, angle, rng)
        if join_isolated:
            _join(keep_b, whole_b, bonds, packing.particles, rng)
        if not cutting or spanning == "allowed" or not cell.spans(keep_b, axis):
            break
    else:
        raise ValueError(
            "spanning must be 'allowed' (or take more centers or lines, or cut_top_bottom), "
            f"got a fragment as high as the box in each of {tries} tries"
        )
    left: B = bonds.select(keep_b)
    if removed > 0.0:
        left = left.select(_thinned(left, packing.particles, removed, rng))
    return left


def fragment_numbers(bonds: BondsLike, particles: int) -> NDArray[np.int64]:
    """Return (N,) which fragment each particle belongs to, counted from 0 in the order of their first particles."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(bonds.i_b)), (bonds.i_b, bonds.j_b)), shape=(particles, particles))
    _, label_n = connected_components(graph, directed=False)
    _, first, number_n = np.unique(label_n, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[number_n])


def _fits(bonds: BondsLike, packing: Packing) -> None:
    if len(bonds.j_b) and int(bonds.j_b.max()) >= packing.particles:
        raise ValueError(f"bonds must be between {packing.particles} particles, got particle {int(bonds.j_b.max())}")
    if bonds.image_bd.shape[1] != packing.dimension:
        raise ValueError(f"bonds must have images of {packing.dimension} numbers, got {bonds.image_bd.shape[1]}")


class _CutCell:
    """Particles brought into the cell, and their bonds with the images that belong to them there."""

    def __init__(self, packing: Packing, bonds: BondsLike) -> None:
        self.packing, self.box = packing, packing.box
        fraction = packing.position_nd @ packing.box.inverse_dd.T
        wrap_nd = np.floor(fraction).astype(np.int64)
        self.fraction_nd = fraction - wrap_nd
        self.i_b, self.j_b = bonds.i_b, bonds.j_b
        self.image_bd = bonds.image_bd + wrap_nd[bonds.j_b] - wrap_nd[bonds.i_b]

    def same_center(self, centers: int, fuzziness: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Return whether both ends of each bond go to the same image of the same random center."""
        n, d = self.fraction_nd.shape
        fraction_kd = rng.random((centers, d))
        blur = fuzziness * float(self.packing.radius_n.max())
        reduced, change_dd = self.box.reduced()
        # in the reduced lattice the nearest image is one of the 3^d around the one that rounding finds
        around = np.array(list(itertools.product((-1, 0, 1), repeat=d)))
        back = np.rint(np.linalg.inv(change_dd))
        best_n = np.full(n, np.inf)
        owner_n = np.zeros(n, dtype=np.int64)
        image_nd = np.zeros((n, d), dtype=np.int64)
        for k in range(centers):
            apart = (fraction_kd[k] - self.fraction_nd) @ back.T
            nearest = -np.rint(apart)
            vector = (apart + nearest)[:, None, :] + around
            square = (np.einsum("de,nae->nad", reduced.lattice_dd, vector) ** 2).sum(axis=2)
            which = np.argmin(square, axis=1)
            distance = np.sqrt(square[np.arange(n), which])
            if blur > 0.0:
                distance = distance + blur * rng.random(n)
            nearer = distance < best_n
            best_n[nearer], owner_n[nearer] = distance[nearer], k
            image = ((nearest + around[which]) @ change_dd.T).astype(np.int64)
            image_nd[nearer] = image[nearer]
        same_b = owner_n[self.i_b] == owner_n[self.j_b]
        through_b = (image_nd[self.i_b] == image_nd[self.j_b] + self.image_bd).all(axis=1)
        return np.asarray(same_b & through_b)

    def uncut(self, lines: int, axis: int, avoided: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Return whether no random line crosses each bond."""
        lattice = self.box.lattice_dd
        # the direction across the layers that the other lattice vectors span
        across_d = self.box.inverse_dd[axis] / np.linalg.norm(self.box.inverse_dd[axis])
        position = np.einsum("de,ne->nd", lattice, self.fraction_nd)
        shift = np.einsum("de,be->bd", lattice, self.image_bd.astype(float))
        kept_b = np.ones(len(self.i_b), dtype=bool)
        for _ in range(lines):
            if not kept_b.any():
                # further lines find nothing to cut
                break
            point = np.einsum("de,e->d", lattice, rng.random(len(lattice)))
            while True:
                normal = rng.standard_normal(len(lattice))
                normal /= np.linalg.norm(normal)
                if abs(float(normal @ across_d)) < math.cos(avoided):
                    break
            side_n = np.einsum("nd,d->n", position - point, normal)
            step_b = np.einsum("bd,d->b", shift, normal)
            kept_b &= side_n[self.i_b] * (side_n[self.j_b] + step_b) > 0.0
            kept_b &= side_n[self.j_b] * (side_n[self.i_b] - step_b) > 0.0
        return kept_b

    def spans(self, keep_b: NDArray[np.bool_], axis: int) -> bool:
        """Return whether a fragment of these bonds winds around the box along the axis, or is nearly as high."""
        n = len(self.fraction_nd)
        offset_n, number_n = np.zeros(n, dtype=np.int64), np.arange(n)
        if keep_b.any():
            length_b = np.ones(np.count_nonzero(keep_b))
            links = Links(self.i_b[keep_b], self.j_b[keep_b], self.image_bd[keep_b], length_b)
            offset_n, number_n = image_offsets(links, n)[0][:, axis], links.clusters(n)
            if (offset_n[links.j_l] - offset_n[links.i_l] != links.image_ld[:, axis]).any():
                return True
        height = float(self.box.height_d[axis])
        place_n = (self.fraction_nd[:, axis] + offset_n) * height
        top, bottom = np.full(n, -np.inf), np.full(n, np.inf)
        np.maximum.at(top, number_n, place_n + self.packing.radius_n)
        np.minimum.at(bottom, number_n, place_n - self.packing.radius_n)
        used = np.unique(number_n)
        return bool((top[used] - bottom[used]).max() > _HIGH * height)


def _join(
    keep_b: NDArray[np.bool_],
    whole_b: NDArray[np.bool_],
    bonds: BondsLike,
    particles: int,
    rng: np.random.Generator,
) -> None:
    """Give every particle without a bond one of its own back, in place."""
    bonded = np.zeros(particles, dtype=bool)
    bonded[bonds.i_b[keep_b]] = bonded[bonds.j_b[keep_b]] = True
    had_b = np.flatnonzero(whole_b & (bonds.i_b != bonds.j_b))
    lone_b = had_b[~bonded[bonds.i_b[had_b]] | ~bonded[bonds.j_b[had_b]]]
    choices: dict[int, list[int]] = {}
    for b in lone_b.tolist():
        for end in (int(bonds.i_b[b]), int(bonds.j_b[b])):
            choices.setdefault(end, []).append(b)
    for i in np.flatnonzero(~bonded).tolist():
        if not bonded[i] and i in choices:
            b = choices[i][int(rng.integers(len(choices[i])))]
            keep_b[b] = True
            bonded[bonds.i_b[b]] = bonded[bonds.j_b[b]] = True


def _thinned(bonds: BondsLike, particles: int, fraction: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which bonds stay when a share of them goes, one after the other by chance, without parting a fragment.

    Bonds are tried in random order, and one that holds its fragment together when its turn comes does so ever after.
    What this leaves in the end is the spanning forest in which bonds late in the order come first (Kruskal's algorithm
    backwards), so that no fragment has to be looked at on the way.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    count = len(bonds.i_b)
    order = rng.permutation(count)
    turn_b = np.empty(count, dtype=np.int64)
    turn_b[order] = np.arange(count)
    weight_b = count - turn_b
    low, high = np.minimum(bonds.i_b, bonds.j_b), np.maximum(bonds.i_b, bonds.j_b)
    sorted_b = np.lexsort((weight_b, high, low))
    # of several bonds between two particles only the lightest can be in the forest, and a ring of one cannot
    first = np.ones(count, dtype=bool)
    first[1:] = (np.diff(low[sorted_b]) != 0) | (np.diff(high[sorted_b]) != 0)
    light_b = sorted_b[first & (low[sorted_b] != high[sorted_b])]
    graph = coo_array((weight_b[light_b].astype(float), (low[light_b], high[light_b])), shape=(particles, particles))
    forest = np.rint(minimum_spanning_tree(graph.tocsr()).data).astype(np.int64)
    essential_b = np.zeros(count, dtype=bool)
    essential_b[order[count - forest]] = True
    spare = order[~essential_b[order]]
    due = round(fraction * count)
    if due > len(spare):
        raise ValueError(
            f"removed_fraction must be at most {len(spare) / count:.4g}, or fragments fall apart, got {fraction:g}"
        )
    keep_b = np.ones(count, dtype=bool)
    keep_b[spare[:due]] = False
    return keep_b
