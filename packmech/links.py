"""Rigid links: distances between particles that never change."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Copies
from packmech.calls.display import shown
from packmech.check import brief, entries, finite_array, positive_array
from packmech.jit.compiled import kernel

# images beyond this leave no digits of a position
_FARTHEST = 2**31
# what a link has
_FIELDS = ("i_l", "j_l", "image_ld", "length_l", "shape_l")


def _whole_numbers(name: str, value: Any, shape: tuple[int | None, ...], what: str) -> NDArray[np.int64]:
    array = finite_array(name, value, shape=shape, what=what, empty=True)
    whole = np.rint(array).astype(np.int64)
    wrong = np.argwhere(whole != array)
    if len(wrong):
        first = tuple(int(k) for k in wrong[0])
        raise ValueError(f"{name} must hold whole numbers, got {array[first]} for {what} {first[0]}")
    return whole


def one_way(
    i_p: NDArray[np.int64], j_p: NDArray[np.int64], image_pd: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
    """Return pairs named from one end, i < j, or of a particle and its own image the first nonzero number positive.

    The last of the four arrays marks the pairs that were turned round.
    """
    first = image_pd[np.arange(len(i_p)), (image_pd != 0).argmax(axis=1)]
    turned = (i_p > j_p) | ((i_p == j_p) & (first < 0))
    image = np.where(turned[:, None], -image_pd, image_pd)
    return np.where(turned, j_p, i_p), np.where(turned, i_p, j_p), image, turned


class NamedPairs(NamedTuple):
    """Pairs of particles and images, sorted by (i, j, image), each named from one end as in `one_way`.

    order_p says which of the pairs that were given each is; turned_p, in that order, which were turned round. site_p2
    are the places on either particle that pairs are of, None where pairs have none.
    """

    i_p: NDArray[np.int64]
    j_p: NDArray[np.int64]
    image_pd: NDArray[np.int64]
    order_p: NDArray[np.int64]
    turned_p: NDArray[np.bool_]
    site_p2: NDArray[np.int64] | None = None


def named_pairs(
    what: str, axis: str, i_p: Any, j_p: Any, image_pd: Any, site: tuple[str, Any] | None = None
) -> NamedPairs:
    """Return pairs in their order, checked; `what` they are and the letter of their `axis` are for messages.

    Where pairs are of places on the particles, `site` is the name and the numbers of these, (P, 2).

    Raises
    ------
    TypeError, ValueError
        Naming the argument and the pair: not whole numbers, negative ones, another length, a particle with itself
        without an image, the same pair twice.

    """
    i, j = (_whole_numbers(f"{name}_{axis}", value, (None,), what) for name, value in (("i", i_p), ("j", j_p)))
    if len(j) != len(i):
        raise ValueError(f"j_{axis} must have as many entries as i_{axis} ({len(i)}), got {len(j)}")
    image = _whole_numbers(f"image_{axis}d", image_pd, (len(i), None), what)
    if np.abs(image).max(initial=0) > _FARTHEST:
        k = int(np.abs(image).max(axis=1).argmax())
        raise ValueError(f"image_{axis}d must stay within {_FARTHEST}, got {image[k].tolist()} for {what} {k}")
    if image.shape[1] not in (2, 3):
        raise ValueError(f"image_{axis}d must have two or three components, got {image.shape[1]}")
    for name, array in ((f"i_{axis}", i), (f"j_{axis}", j)):
        if len(i) and array.min() < 0:
            raise ValueError(f"{name} must not be negative, got {array.min()} for {what} {array.argmin()}")
    own = (i == j) & ~image.any(axis=1)
    if own.any():
        k = int(np.flatnonzero(own)[0])
        raise ValueError(f"image_{axis}d must not be zero for a {what} of a particle with itself, got {what} {k}")
    i, j, image, turned = one_way(i, j, image)
    place = np.zeros((len(i), 2), dtype=np.int64)
    if site is not None:
        place = _whole_numbers(*site, (len(i), 2), what)
        if place.min(initial=0) < 0:
            k = int(place.min(axis=1).argmin())
            raise ValueError(f"{site[0]} must not be negative, got {place[k].tolist()} for {what} {k}")
        place = np.where(turned[:, None], place[:, ::-1], place)
    order = np.lexsort((*place.T[::-1], *image.T[::-1], j, i))
    place = place[order]
    found = NamedPairs(i[order], j[order], image[order], order, turned[order], None if site is None else place)
    key = np.column_stack((*found[:3], place))
    twice = np.flatnonzero((key[1:] == key[:-1]).all(axis=1))
    if len(twice):
        k = int(twice[0])
        pair = f"{found.i_p[k]}-{found.j_p[k]} at image {found.image_pd[k].tolist()}"
        raise ValueError(f"{what}s must name each pair once, got {pair} twice")
    return found


def named_rows(
    known: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    asked: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    known_site: NDArray[np.int64] | None = None,
    asked_site: NDArray[np.int64] | None = None,
) -> NDArray[np.int64]:
    """Return the places of the asked pairs (i, j, image) among the known ones, named from any end; -1 where none is.

    Sites (P, 2) are places on the particles that distinguish pairs of the same particles, such as beads.
    """
    rows = []
    for pairs, site in ((known, known_site), (asked, asked_site)):
        *named, turned = one_way(*pairs)
        place = np.zeros((len(turned), 2), np.int64) if site is None else np.where(turned[:, None], site[:, ::-1], site)
        rows.append(np.column_stack([*named, place]))
    count = len(rows[0])
    _, key = np.unique(np.vstack(rows), axis=0, return_inverse=True)
    key = key.reshape(-1)
    number = np.full(len(key), -1)
    number[key[:count]] = np.arange(count)
    found: NDArray[np.int64] = number[key[count:]]
    return found


@shown(lambda one: f"{len(one)} links")
@dataclass(frozen=True, eq=False)
class Links:
    """Links of a packing: |x_j - x_i + lattice @ image| = length. Each once, sorted by (i, j, image).

    A link's image vector is a part of its state, never the nearest one: a link may be longer than half the box, and a
    chain may wind around it. A packing corrects it only where a link does not hold, and does at exactly one other.

    Parameters
    ----------
    i_l, j_l
        (L,) particles. Links are stored with i < j, or i == j and the image's first nonzero component positive.
    image_ld
        (L, d) integer vectors, for the positions as they stand in the packing.
    length_l
        (L,) lengths [length].
    shape_l
        (L,) which links hold an angle or a shape and are no bond of the molecule: they may be crossed by others, and
        are drawn apart; none does where it is left out.

    Raises
    ------
    TypeError, ValueError
        Naming the argument and the link: not whole numbers, a length that is not positive, a particle linked to
        itself without an image, two links of one pair.

    Examples
    --------
    >>> links = Links([1, 1], [0, 2], [[0, 0], [0, 1]], [1.0, 1.4])
    >>> links.i_l.tolist(), links.j_l.tolist(), links.image_ld.tolist()
    ([0, 1], [1, 2], [[0, 0], [0, 1]])

    """

    i_l: NDArray[np.int64]
    j_l: NDArray[np.int64]
    image_ld: NDArray[np.int64]
    length_l: NDArray[np.float64]
    shape_l: NDArray[np.bool_] = None  # type: ignore[assignment]  # an array of False is made of it

    def __post_init__(self) -> None:
        pairs = named_pairs("link", "l", self.i_l, self.j_l, self.image_ld)
        count = len(pairs.i_p)
        length = positive_array("length_l", self.length_l, shape=(None,), what="link", empty=True)
        given = (
            np.zeros(count, dtype=bool)
            if self.shape_l is None
            else np.array(entries("shape_l", self.shape_l, "b", "truth values"))
        )
        if given.dtype != bool or given.ndim != 1:
            raise TypeError(f"shape_l must hold truth values, got {brief(self.shape_l)}")
        own: tuple[tuple[str, NDArray[Any]], ...] = (("length_l", length), ("shape_l", given))
        for name, array in own:
            if len(array) != count:
                raise ValueError(f"{name} must have one entry per link ({count}), got {len(array)}")
        parts = (*pairs[:3], *(array[pairs.order_p] for _, array in own))
        for name, array in zip(_FIELDS, parts, strict=True):
            array = np.ascontiguousarray(array)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @classmethod
    @functools.cache
    def none(cls, dimension: int) -> Links:
        """Return the links of particles that have none."""
        return cls([], [], np.zeros((0, dimension)), [])  # type: ignore[arg-type]

    def __len__(self) -> int:
        return len(self.i_l)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Links) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in _FIELDS
        )

    def __hash__(self) -> int:
        return hash((self.i_l.tobytes(), self.j_l.tobytes(), self.image_ld.tobytes(), self.length_l.tobytes()))

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.image_ld.shape[1])

    def find(self, i_l: NDArray[np.int64], j_l: NDArray[np.int64], image_ld: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers of the links between these particles and images, which may be named from either end."""
        found = named_rows((self.i_l, self.j_l, self.image_ld), (i_l, j_l, image_ld))
        if (found < 0).any():
            k = int(np.flatnonzero(found < 0)[0])
            raise ValueError(f"links must hold {i_l[k]}-{j_l[k]} at image {image_ld[k].tolist()}, got none")
        return found

    def select(self, keep_l: ArrayLike) -> Links:
        """Return the links that a boolean mask or an index array names."""
        keep = np.asarray(keep_l)
        return Links(*(getattr(self, name)[keep] for name in _FIELDS))

    def joined(self, others: Links) -> Links:
        """Return these links and others."""
        return Links(*(np.concatenate([getattr(self, name), getattr(others, name)]) for name in _FIELDS))

    def scaled(self, factor: float) -> Links:
        """Return the links with every length multiplied by the factor."""
        return dataclasses.replace(self, length_l=factor * self.length_l)

    def at_images(self, image_ld: NDArray[Any]) -> Links:
        """Return the same links at other images."""
        return dataclasses.replace(self, image_ld=image_ld)

    def moved(self, image_nd: NDArray[np.int64]) -> Links:
        """Return the same links after the particles were moved: x = new x + lattice @ image."""
        return self.at_images(self.image_ld + image_nd[self.j_l] - image_nd[self.i_l]) if len(self) else self

    def numbered(self, number_n: NDArray[np.int64]) -> Links:
        """Return the links with particles renumbered; links of a particle with a negative number are left out."""
        if not len(self):
            return self
        kept = self.select((number_n[self.i_l] >= 0) & (number_n[self.j_l] >= 0))
        return dataclasses.replace(kept, i_l=number_n[kept.i_l], j_l=number_n[kept.j_l])

    def repeated(self, repeats: tuple[int, ...], particles: int) -> Links:
        """Return the links of copies of a box side by side; copy (a, b) holds the particles from its own number on."""
        if not len(self):
            return self
        copies = Copies(repeats)
        # a link that leaves the box ends in another copy, or beyond all of them
        there, beyond = copies.reached(self.image_ld)
        return Links(
            (self.i_l + particles * np.arange(len(copies))[:, None]).ravel(),
            (self.j_l + particles * there).ravel(),
            beyond.reshape(-1, self.dimension),
            np.tile(self.length_l, len(copies)),
            np.tile(self.shape_l, len(copies)),
        )

    def vectors(self, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (L, d) vectors from i to j [length]."""
        vector: NDArray[np.float64] = position_nd[self.j_l] - position_nd[self.i_l] + self.image_ld @ lattice_dd.T
        return vector

    def clusters(self, particles: int) -> NDArray[np.int64]:
        """Return the (N,) number of the cluster of each particle; clusters count up by their smallest particle."""
        if not len(self):
            return np.arange(particles)
        kept: dict[int, NDArray[np.int64]] = self._kept("clusters")
        if particles not in kept:
            kept[particles] = number_by_first(self._components(particles))
            kept[particles].setflags(write=False)
        return kept[particles]

    def _kept(self, what: str) -> dict[int, Any]:
        """Return what was found about these links before, by number of particles: links never change."""
        found: dict[int, Any] = self.__dict__.setdefault(f"_{what}", {})
        return found

    def _components(self, particles: int) -> NDArray[Any]:
        # a scene without links imports nothing of SciPy until it needs it
        import scipy.sparse as sp
        from scipy.sparse.csgraph import connected_components

        ones = np.ones(len(self.i_l))
        _, label = connected_components(
            sp.coo_array((ones, (self.i_l, self.j_l)), shape=(particles, particles)), directed=False
        )
        components: NDArray[Any] = label
        return components


def number_by_first(label_n: NDArray[Any]) -> NDArray[np.int64]:
    """Return labels 0, 1, .. in the order in which they first occur."""
    _, first, inverse = np.unique(label_n, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse.reshape(-1)]


@kernel
def _walk(start, entry, i_l, j_l, image_ld):  # type: ignore[no-untyped-def]
    """Return the offsets along a spanning tree of each cluster; entry e < L is link e at its first end."""
    particles, count = start.shape[0] - 1, i_l.shape[0]
    offset = np.zeros((particles, image_ld.shape[1]), dtype=np.int64)
    seen = np.zeros(particles, dtype=np.bool_)
    stack = np.empty(particles, dtype=np.int64)
    for first in range(particles):
        if seen[first]:
            continue
        seen[first] = True
        stack[0] = first
        height = 1
        while height:
            height -= 1
            here = stack[height]
            for k in range(start[here], start[here + 1]):
                e = entry[k]
                link = e if e < count else e - count
                there = j_l[link] if e < count else i_l[link]
                if not seen[there]:
                    seen[there] = True
                    for a in range(offset.shape[1]):
                        shift = image_ld[link, a]
                        offset[there, a] = offset[here, a] + (shift if e < count else -shift)
                    stack[height] = there
                    height += 1
    return offset


def image_offsets(links: Links, particles: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return (N, d) integer vectors that unwrap every cluster, and (N,) whether its cluster winds around the box.

    x + lattice @ offset has each cluster in one piece along a spanning tree of its links. A cluster winds where the
    links' images do not close around some ring.
    """
    if not len(links):
        return np.zeros((particles, links.dimension), dtype=np.int64), np.zeros(particles, dtype=bool)
    kept = links._kept("image_offsets")
    if particles not in kept:
        kept[particles] = _offsets(links, particles)
        for array in kept[particles]:
            array.setflags(write=False)
    found: tuple[NDArray[np.int64], NDArray[np.bool_]] = kept[particles]
    return found


def tree_offsets(
    i_l: NDArray[np.int64], j_l: NDArray[np.int64], image_ld: NDArray[np.int64], particles: int
) -> NDArray[np.int64]:
    """Return (N, d) integer vectors that unwrap what pairs join into pieces, along a spanning tree of each piece."""
    end = np.concatenate([i_l, j_l])
    # entries of a particle in the order of the links, so that the tree is the same as one walked link by link
    entry = np.lexsort((np.tile(np.arange(len(i_l)), 2), end))
    start = np.concatenate([[0], np.cumsum(np.bincount(end, minlength=particles))])
    return np.asarray(_walk(start, entry, i_l, j_l, image_ld))


def _offsets(links: Links, particles: int) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    offset = tree_offsets(links.i_l, links.j_l, links.image_ld, particles)
    ring = (links.image_ld + offset[links.i_l] - offset[links.j_l]).any(axis=1)
    cluster = links.clusters(particles)
    winding = np.zeros(particles, dtype=bool)
    winding[:] = np.isin(cluster, cluster[links.i_l[ring]])
    return offset, winding
