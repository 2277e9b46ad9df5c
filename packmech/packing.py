"""A packing: positions, radii, masses and the periodic box, checked once."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import LONGEST, SHORTEST, Box, Copies
from packmech.calls.display import shown
from packmech.calls.honors import LINK_TOLERANCE, STRAINED
from packmech.check import (
    brief,
    check_memory,
    finite_array,
    given_shape,
    instance,
    integer,
    integer_array,
    listed,
    positive,
    positive_array,
)
from packmech.links import Links, image_offsets
from packmech.shapes import Discs, Shapes, Spheroids
from packmech.tangential import TangentialDisplacements

# more sizes than this are a continuous distribution, whose reference diameter is the mean
DISCRETE_SIZES = 10
# largest rounding of a position, relative to the smallest radius, at which contacts still mean something [1]
_COARSEST = 1e-6
# positions that differ from others by whole lattice vectors and this, relative to the largest, are the same places [1]
_SAME_PLACE = 16.0 * float(np.finfo(float).eps)
# kinds of particles; tables by pairs of kinds are that large at most
MOST_KINDS = 64
T = TypeVar("T")
# a link that does not hold is looked for at this many images along each lattice vector: those within its length
_MOST_IMAGES = 4


def masses_of_density(
    density: float | None, radius_n: NDArray[np.float64], dimension: int
) -> NDArray[np.float64] | None:
    """Return the (N,) masses of discs or spheres of one density [mass/length^d]; None where no density is given."""
    if density is None:
        return None
    ball = math.pi if dimension == 2 else 4.0 * math.pi / 3.0
    return np.asarray(positive("density", density) * ball * radius_n**dimension)


def _box_of(box: Any, position_nd: Any) -> Box:
    """Return the box that is given as such, as one length, or by the lengths of its sides."""
    if isinstance(box, Box):
        return box
    d = finite_array("position_nd", position_nd, shape=(None, None)).shape[1]
    if d not in (2, 3):
        raise ValueError(f"position_nd must have two or three components, got {d}")
    if isinstance(box, int | float | np.number) and not isinstance(box, bool):
        return Box.cubic(positive("box", box), d)
    if isinstance(box, list | tuple | np.ndarray) and given_shape(box) == (d,):
        return Box(positive_array("box", box, shape=(d,), what="side"))
    raise TypeError(f"box must be a Box, got {brief(box)} (one length, or those of its {d} sides, would do, too)")


class _Masses:
    """The field `mass_n` of a packing: the masses that were given, else those of density 1, which follow the radii."""

    @overload
    def __get__(self, packing: None, owner: type[Packing]) -> None: ...

    @overload
    def __get__(self, packing: Packing, owner: type[Packing]) -> NDArray[np.float64]: ...

    def __get__(self, packing: Packing | None, owner: type[Packing]) -> NDArray[np.float64] | None:
        if packing is None:
            return None  # the default of the constructor's argument
        given = packing.given_mass_n
        return masses_of_density(1.0, packing.radius_n, packing.dimension) if given is None else given

    def __set__(self, packing: Packing, mass_n: ArrayLike | None) -> None:
        packing.__dict__["given_mass_n"] = mass_n


class _Held(Generic[T]):
    """A field of a packing that may be given as None, and never is None after that."""

    def __set_name__(self, owner: type[Packing], name: str) -> None:
        self._name = name

    @overload
    def __get__(self, packing: None, owner: type[Packing]) -> None: ...

    @overload
    def __get__(self, packing: Packing, owner: type[Packing]) -> T: ...

    def __get__(self, packing: Packing | None, owner: type[Packing]) -> T | None:
        return None if packing is None else packing.__dict__[self._name]

    def __set__(self, packing: Packing, given: T | None) -> None:
        packing.__dict__[self._name] = given


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class Packing:
    """Discs (d = 2) or spheres (d = 3), or particles of other shapes, in a periodic box.

    Parameters
    ----------
    position_nd
        (N, d) centers [length], inside the cell or not.
    radius_n
        (N,) radii [length], or one for all; of other shapes those of the disc or sphere of equal area or volume.
    box
        The periodic box; or one length of a square or cube, or the (d,) lengths of the sides of a rectangular one.
    links
        Rigid links between particles; `Links` of length zero where they are left out or None. One that does not hold at
        its image, but at exactly one other, joins particles that were wrapped, and gets that image. Where one holds at
        none, calls refuse the packing, and `reaffix_links` brings the particles back.
    mass_n
        (N,) masses. Unless given those of density 1: a particle's area pi r^2, or its volume 4/3 pi r^3 in space, which
        follow the radii; masses that are given stay when radii change.
    tangential
        Displacements of the contacts' tangential springs, which act where a scene has friction; None: all are slack.
    shapes
        `Spheroids`, `Superellipsoids` or rigid `Beads`, without links; `Discs` where they are left out or None. Calls
        that know discs and spheres only refuse others by name (`packmech effects` lists which).
    kind_n
        (N,) kinds of the particles, whole numbers 0 to 63 (`assign_kinds` draws them); None: all are of kind 0.

    Attributes
    ----------
    given_mass_n
        (N,) masses that were given; None where they are those of density 1.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what is required, what was given, for which particle; also where lengths exceed double
        precision, or a particle so far away that rounding of its position exceeds 1e-6 of the smallest radius.

    Examples
    --------
    >>> packing = Packing([[0.0, 0.0], [1.0, 0.0]], 0.5, 2.0)
    >>> packing.particles, packing.dimension, packing.reference_diameter
    (2, 2, 1.0)
    >>> packing.mass_n.round(6).tolist(), packing.replace(mass_n=[1.0, 3.0]).mass_n.tolist()
    ([0.785398, 0.785398], [1.0, 3.0])

    """

    position_nd: NDArray[np.float64]
    radius_n: NDArray[np.float64]
    box: Box
    links: _Held[Links] = _Held()
    mass_n: _Masses = _Masses()
    tangential: TangentialDisplacements | None = None
    shapes: _Held[Shapes] = _Held()
    kind_n: NDArray[np.int64] | None = None
    given_mass_n: NDArray[np.float64] | None = dataclasses.field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "box", _box_of(self.box, self.position_nd))
        position = finite_array("position_nd", self.position_nd, shape=(None, self.box.dimension))
        radius_n = self.radius_n
        if isinstance(radius_n, int | float | np.number) and not isinstance(radius_n, bool):
            radius_n = np.full(len(position), positive("radius_n", radius_n))
        radius = positive_array("radius_n", radius_n, shape=(None,))
        if len(radius) != len(position):
            raise ValueError(f"radius_n must have one entry per particle ({len(position)}), got {len(radius)}")
        _check_digits(position, radius, self.box)
        arrays = {"position_nd": position, "radius_n": radius}
        if self.given_mass_n is not None:
            arrays["given_mass_n"] = positive_array("mass_n", self.given_mass_n, shape=(len(position),))
        for name, array in arrays.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if self.kind_n is not None:
            object.__setattr__(self, "kind_n", _kinds_of(self.kind_n, len(position)))
        self._check_links(self.links)
        self._check_shapes(self.shapes)
        if self.tangential is not None:
            self._check_tangential(self.tangential)

    def _check_shapes(self, shapes: Any) -> None:
        if shapes is None:
            shapes = Discs(self.particles, self.dimension)
            object.__setattr__(self, "shapes", shapes)
        if not isinstance(shapes, Shapes):
            instance("shapes", shapes, Spheroids)
        if (len(shapes), shapes.dimension) != self.position_nd.shape:
            raise ValueError(
                f"shapes must be of as many particles and axes as position_nd, {self.position_nd.shape}, "
                f"got {(len(shapes), shapes.dimension)}"
            )
        if shapes.has_orientations and self.links:
            raise ValueError(f"shapes must be left out where a packing has links, got {type(shapes).__name__}")

    def _check_tangential(self, tangential: Any) -> None:
        instance("tangential", tangential, TangentialDisplacements)
        if tangential.dimension != self.dimension:
            raise ValueError(f"tangential must have images of {self.dimension} components, got {tangential.dimension}")
        named = [tangential.i_c, tangential.j_c, *([] if tangential.at_wall_w is None else [tangential.at_wall_w])]
        last = int(max(one.max(initial=-1) for one in named))
        if last >= self.particles:
            raise ValueError(f"tangential must name particles below {self.particles}, got {last}")
        bead = tangential.bead_c2
        if self.shapes.has_beads != (bead is not None):
            raise ValueError(f"tangential must have bead_c2 for rigid bodies and only for these, got {brief(bead)}")
        if bead is not None:
            beads = np.diff(self.shapes.start_n)[np.stack([tangential.i_c, tangential.j_c], axis=1)]
            if (bead >= beads).any():
                c = int((bead >= beads).any(axis=1).argmax())
                raise ValueError(
                    f"tangential.bead_c2 must be below {beads[c].tolist()}, got {bead[c].tolist()} for contact {c}"
                )

    def _check_links(self, links: Any) -> None:
        if links is not None:
            instance("links", links, Links)
        if not links:
            object.__setattr__(self, "links", Links.none(self.dimension))
            return
        if links.dimension != self.dimension:
            raise ValueError(f"links must have images of {self.dimension} components, got {links.dimension}")
        last = int(max(links.i_l.max(), links.j_l.max()))
        if last >= self.particles:
            raise ValueError(f"links must name particles below {self.particles}, got {last}")
        if self.link_error > LINK_TOLERANCE:
            held = self._at_images_that_hold(links)
            if held is not links:
                object.__setattr__(self, "links", held)
                del self.__dict__["_link_error_l"]

    def _at_images_that_hold(self, links: Links) -> Links:
        """Return the links, those that hold at exactly one other image there: their ends were wrapped."""
        vector = links.vectors(self.position_nd, self.box.lattice_dd)
        # the way to another image is at least the smallest height of the box
        far = 1.01 * (np.sqrt((vector**2).sum(axis=1)) + links.length_l) > self.box.height_d.min()
        off = np.flatnonzero((self._link_error_l > LINK_TOLERANCE) & (links.i_l != links.j_l) & far)
        if not len(off):
            return links
        vector, length = vector[off], links.length_l[off, None]
        fraction, reach = vector @ self.box.inverse_dd.T, (1.0 + LINK_TOLERANCE) * length / self.box.height_d
        low = np.ceil(-fraction - reach)
        count = np.floor(reach - fraction) - low + 1.0
        near = ((count >= 1.0) & (count <= _MOST_IMAGES)).all(axis=1)
        if not near.any():
            return links
        off, vector, length, low, count = off[near], vector[near], length[near], low[near], count[near]
        step = np.indices(count.max(axis=0).astype(int)).reshape(self.dimension, -1).T
        shift = low[:, None] + step
        distance = np.sqrt(((vector[:, None] + shift @ self.box.lattice_dd.T) ** 2).sum(axis=2))
        allowed = LINK_TOLERANCE * np.maximum(length, self.diameter_n.mean())
        holds = (np.abs(distance - length) <= allowed) & (step < count[:, None]).all(axis=2)
        alone = holds.sum(axis=1) == 1
        if not alone.any():
            return links
        image = links.image_ld.copy()
        image[off[alone]] += shift[alone, holds[alone].argmax(axis=1)].astype(np.int64)
        if len(np.unique(np.column_stack([links.i_l, links.j_l, image]), axis=0)) < len(links):
            # another link of the pair is there: one of them is wrong, and calls refuse it
            return links
        return links.at_images(image)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Packing) and (
            self.box == other.box
            and np.array_equal(self.position_nd, other.position_nd)
            and np.array_equal(self.radius_n, other.radius_n)
            and self.links == other.links
            and self.tangential == other.tangential
            and self.shapes == other.shapes
            and self._given_masses() == other._given_masses()
            and self._kinds() == other._kinds()
        )

    def __hash__(self) -> int:
        arrays = self.position_nd.tobytes(), self.radius_n.tobytes()
        return hash((*arrays, self.box, self.links, self.tangential, self.shapes, self._given_masses(), self._kinds()))

    def _kinds(self) -> bytes | None:
        return None if self.given_kind_n is None else self.given_kind_n.tobytes()

    def _given_masses(self) -> bytes | None:
        return None if self.given_mass_n is None else self.given_mass_n.tobytes()

    def __repr__(self) -> str:
        small, large = float(self.radius_n.min()), float(self.radius_n.max())
        links = len(self.links)
        held = [f"{links} rigid link{'' if links == 1 else 's'}" if links else ""]
        held.append(type(self.shapes).__name__ if self.shapes.has_orientations else "")
        held.append(f"{self.tangential.springs} tangential displacements" if self.tangential is not None else "")
        held.append("masses given" if self.given_mass_n is not None else "")
        held.append(f"{self.kinds} kinds" if self.kinds > 1 else "")
        radii = f"radius {small:.6g}" if small == large else f"radii {small:.6g} to {large:.6g}"
        volume = f"box of {'area' if self.dimension == 2 else 'volume'} {self.box.volume:.6g}"
        return (
            f"Packing of {self.particles} particle{'' if self.particles == 1 else 's'} in {self.dimension}D: "
            + ", ".join([radii, volume, *filter(None, held)])
        )

    @property
    def particles(self) -> int:
        """Number of particles N."""
        return len(self.radius_n)

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return self.box.dimension

    @property
    def kinds(self) -> int:
        """Number of kinds of particles, the largest of `kind_n` + 1; 1 where it is None."""
        return 1 if self.kind_n is None else int(self.kind_n.max(initial=0)) + 1

    @property
    def given_kind_n(self) -> NDArray[np.int64] | None:
        """The (N,) kinds of the particles; None where all are of kind 0."""
        return self.kind_n if self.kinds > 1 else None

    @property
    def plain(self) -> bool:
        """Whether particles are discs or spheres without links."""
        return not (self.shapes.has_orientations or self.links)

    @property
    def diameter_n(self) -> NDArray[np.float64]:
        """The (N,) diameters [length]."""
        return 2.0 * self.radius_n

    @functools.cached_property
    def reference_diameter(self) -> float:
        """Diameter that sets the unit of length: the smallest of a mixture, the mean of a continuous distribution."""
        diameter = np.sort(self.diameter_n)
        return float(diameter[0] if same_sizes(diameter)[-1] < DISCRETE_SIZES else diameter.mean())

    @property
    def rounding(self) -> float:
        """Largest rounding of a position, relative to the smallest radius [1]."""
        return float(np.spacing(np.abs(self.position_nd).max()) / self.radius_n.min())

    def replace(self, **changes: Any) -> Packing:
        """Return a packing with the named fields exchanged.

        Particles that are moved by whole lattice vectors are where they were: links, and tangential displacements where
        nothing else is changed, go with them to other images. Tangential displacements belong to the contacts as they
        stand: a packing with other positions, radii, shapes or another box has none unless they are given, too.
        """
        kept: dict[str, Any] = {"mass_n": self.given_mass_n}
        if not self.shapes.has_orientations:
            kept["shapes"] = None  # discs of as many particles and axes as there are then
        if not {"position_nd", "radius_n", "box", "shapes"}.isdisjoint(changes):
            kept["tangential"] = None
            if "position_nd" in changes and (len(self.links) or self.tangential is not None):
                kept |= self._continued(changes)
        return dataclasses.replace(self, **(kept | changes))

    def _continued(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Return the links and tangential displacements that go with particles to other images."""
        try:
            position = np.asarray(changes["position_nd"], dtype=np.float64)
        except Exception:  # an object that is asked for numbers may raise anything: the constructor names it
            return {}
        box = changes.get("box", self.box)
        if position.shape != self.position_nd.shape or not isinstance(box, Box) or box.dimension != self.dimension:
            return {}
        image = images_between(self.position_nd, self.box, position, box)
        if image is None:
            return {}
        found: dict[str, Any] = {}
        if self.tangential is not None and {"radius_n", "shapes"}.isdisjoint(changes) and box == self.box:
            apart = position - self.position_nd - image @ box.lattice_dd.T
            size = max(float(np.abs(one).max()) for one in (position, self.position_nd, box.lattice_dd))
            if np.abs(apart).max() <= _SAME_PLACE * size:
                found["tangential"] = self.tangential.moved(-image)
        links = self.links
        if len(links) and image.any():
            both = (links, links.moved(-image))
            here, there = (
                np.abs(np.sqrt((one.vectors(position, box.lattice_dd) ** 2).sum(axis=1)) - one.length_l) for one in both
            )
            # only of links much shorter than the box is the nearer image known where they hold at neither
            near = np.maximum(STRAINED * links.length_l, 0.5 * box.height_d.min() - links.length_l)
            nearer = (there <= LINK_TOLERANCE * links.length_l) | ((there <= near) & (here > near))
            moved = np.where(nearer[:, None], both[1].image_ld, links.image_ld)
            # links that hold at neither image may come to name a pair twice: they stay, and calls refuse them
            if len(np.unique(np.column_stack([links.i_l, links.j_l, moved]), axis=0)) == len(links):
                found["links"] = links.at_images(moved)
        return found

    @functools.cached_property
    def turn_nkt(self) -> NDArray[np.float64]:
        """The (N, K, t) rotations that one length of each coordinate of turns makes; K = 0 for discs and spheres.

        Of discs and spheres among other shapes they are zero: there are no such coordinates.
        """
        return self.shapes.turn_basis(self.radius_n)

    @property
    def cluster_n(self) -> NDArray[np.int64]:
        """The (N,) number of the cluster of linked particles of each; a particle without links is one of its own."""
        return self.links.clusters(self.particles)

    @property
    def unwrapping_nd(self) -> NDArray[np.int64]:
        """The (N, d) lattice vectors, by their numbers, that bring every cluster into one piece (`image_offsets`)."""
        return self._unwrapped[0]

    @property
    def winding_n(self) -> NDArray[np.bool_]:
        """The (N,) particles of clusters that close around the box."""
        return self._unwrapped[1]

    @functools.cached_property
    def _unwrapped(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        return image_offsets(self.links, self.particles)

    def moved(self, displacement_nq: NDArray[np.float64]) -> Packing:
        """Return the packing after (N, d + K) displacements, turns measured in lengths last."""
        d = self.dimension
        position = self.position_nd + displacement_nq[:, :d]
        rotation = np.einsum("nk,nkt->nt", displacement_nq[:, d:], self.turn_nkt)
        return self.replace(position_nd=position, shapes=self.shapes.turned(rotation))

    @functools.cached_property
    def spin_nkk(self) -> NDArray[np.float64]:
        """The (N, k, k) rotations that one length of each of k coordinates makes, where friction turns every particle.

        Angles times radii of gyration are lengths; k = 1 in a plane and 3 in space.
        """
        return self.shapes.spin_basis(self.radius_n)

    def select(self, kept_n: NDArray[Any], links: Links | None = None) -> Packing:
        """Return the packing of some of the particles, by number or by (N,) truth, with links between them.

        The links are those of the packing that join particles which are kept, unless others are given.
        """
        given = self.given_mass_n
        number = _numbers_of(kept_n, self.particles)
        return Packing(
            self.position_nd[kept_n],
            self.radius_n[kept_n],
            self.box,
            self.links.numbered(number) if links is None else links,
            None if given is None else given[kept_n],
            None if self.tangential is None else self.tangential.numbered(number),
            self.shapes.select(kept_n),
            None if self.kind_n is None else self.kind_n[kept_n],
        )

    def repeated(self, repeats: tuple[int, ...]) -> Packing:
        """Return copies of the packing side by side, in one box, with their links; those of the first box come first.

        Parameters
        ----------
        repeats
            Number of copies along each lattice vector.

        Raises
        ------
        TypeError, ValueError
            If these are no whole numbers from 1 on, or the packing has tangential displacements.

        Examples
        --------
        >>> import packmech as pm
        >>> pm.lattice_packing("square", repeats=(2, 2)).repeated((3, 2))
        Packing of 24 particles in 2D: radius 0.5, box of area 24

        """
        given = listed("repeats", repeats, "whole numbers")
        if len(given) != self.dimension:
            raise ValueError(f"repeats must be {self.dimension} whole numbers, got {brief(repeats)}")
        number = tuple(integer(f"repeats[{k}]", one, at_least=1) for k, one in enumerate(given))
        copies = math.prod(number)
        check_memory("repeats", 8.0 * copies * self.particles * (3 * self.dimension + 4))
        if self.tangential is not None:
            raise ValueError(f"packing must have no tangential displacements, got {self.tangential.springs}")
        which_n = np.tile(np.arange(self.particles), copies)
        place_md = Copies(number).place_md
        return Packing(
            (self.position_nd[None] + (place_md @ self.box.lattice_dd.T)[:, None]).reshape(-1, self.dimension),
            self.radius_n[which_n],
            Box(self.box.lattice_dd * np.array(number)),
            self.links.repeated(number, self.particles),
            None if self.given_mass_n is None else self.given_mass_n[which_n],
            shapes=self.shapes.select(which_n),
            kind_n=None if self.kind_n is None else self.kind_n[which_n],
        )

    def wrapped(self) -> Packing:
        """Return the same packing with every center inside the cell."""
        position, image = self.box.wrap(self.position_nd)
        links = self.links.moved(image)
        tangential = None if self.tangential is None else self.tangential.moved(image)
        return self.replace(position_nd=position, links=links, tangential=tangential)

    @property
    def link_error(self) -> float:
        """Largest error of a link's length, over the larger of that and the mean diameter [1]; 0 without links."""
        return float(self._link_error_l.max(initial=0.0))

    @functools.cached_property
    def _link_error_l(self) -> NDArray[np.float64]:
        """The (L,) errors of the links' lengths, over the larger of these and the mean diameter [1]."""
        links = self.links
        vector, length = links.vectors(self.position_nd, self.box.lattice_dd), links.length_l
        error = np.abs(np.sqrt((vector**2).sum(axis=1)) - length)
        return np.asarray(error / np.maximum(length, self.diameter_n.mean()))

    def check_link_lengths(self, name: str, call: str, tolerance: float = LINK_TOLERANCE) -> None:
        """Check that links have their lengths, for a call whose answer depends on it.

        Raises
        ------
        ValueError
            Naming the argument, the pair that is farthest from its length, and the way out.

        """
        if self.link_error <= tolerance:
            return
        links, worst = self.links, int(self._link_error_l.argmax())
        distance = float(np.sqrt((links.vectors(self.position_nd, self.box.lattice_dd)[worst] ** 2).sum()))
        raise ValueError(
            f"{name} must have links at their lengths to {tolerance:g} for pm.{call}, got particles "
            f"{links.i_l[worst]} and {links.j_l[worst]} at distance {distance:.9g} (image "
            f"{links.image_ld[worst].tolist()}) for a link of length {links.length_l[worst]:.9g}: bring particles that "
            "are near their links back with pm.reaffix_links(packing), or give links with the images of the positions"
        )


def same_sizes(ascending_n: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the number of the size of each of (N,) ascending lengths, from 0; rounding makes no other size."""
    step = np.diff(ascending_n) > 1e-9 * ascending_n[1:]
    return np.concatenate([[0], np.cumsum(step)])


def images_between(
    start_nd: NDArray[np.float64], start_box: Box, end_nd: NDArray[np.float64], end_box: Box
) -> NDArray[np.int64] | None:
    """Return the (N, d) whole lattice vectors nearest to how particles moved: end = start + lattice @ image + rest.

    Strains of the box count as no motion. None where the way is no number, or too far for whole ones.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        image = np.rint(end_nd @ end_box.inverse_dd.T - start_nd @ start_box.inverse_dd.T)
    return image.astype(np.int64) if (np.abs(image) <= 2.0**31).all() else None


def _kinds_of(kind_n: Any, particles: int) -> NDArray[np.int64]:
    """Return the checked (N,) kinds of particles.

    Raises
    ------
    TypeError, ValueError
        Naming the argument and the particle.

    """
    found = integer_array("kind_n", kind_n, shape=(particles,))
    wrong = (found < 0) | (found >= MOST_KINDS)
    if wrong.any():
        n = int(wrong.argmax())
        raise ValueError(f"kind_n must lie between 0 and {MOST_KINDS - 1}, got {found[n]} for particle {n}")
    found.setflags(write=False)
    return found


def _numbers_of(kept_n: NDArray[Any], particles: int) -> NDArray[np.int64]:
    """Return the new number of each particle, -1 of those that are not kept."""
    number = np.full(particles, -1)
    number[kept_n] = np.arange(len(np.arange(particles)[kept_n]))
    return number


def _check_digits(position_nd: NDArray[np.float64], radius_n: NDArray[np.float64], box: Box) -> None:
    """Check that double precision carries the lengths, and places to a small part of the smallest radius.

    Raises
    ------
    ValueError
        Naming the argument, what was given and for which particle.

    """
    smallest, largest = int(radius_n.argmin()), int(radius_n.argmax())
    for n in (smallest, largest):
        if not SHORTEST <= radius_n[n] <= LONGEST:
            raise ValueError(
                f"radius_n must lie between {SHORTEST:g} and {LONGEST:g} (take another unit of length), "
                f"got {radius_n[n]} for particle {n}"
            )
    coarsest = _COARSEST * float(radius_n[smallest])
    if np.spacing(max(float(position_nd.max()), -float(position_nd.min()))) > coarsest:
        far = int(np.abs(position_nd).max(axis=1).argmax())
        raise ValueError(
            f"position_nd must be so near that rounding is below {_COARSEST:g} of the smallest radius "
            f"({radius_n[smallest]:g}), got {position_nd[far].tolist()} for particle {far}"
        )
    longest = float(np.abs(box.lattice_dd).max())
    if np.spacing(longest) > coarsest:
        raise ValueError(
            f"box must be so small that rounding is below {_COARSEST:g} of the smallest radius "
            f"({radius_n[smallest]:g}), got a lattice vector with a component of {longest:g}"
        )


def without_springs(packing: Packing) -> Packing:
    """Return the packing with tangential springs that are slack; what effects remember of its pairs is kept."""
    held = packing.tangential
    return packing if held is None else packing.replace(tangential=held.without_springs())


def no_tangential(name: str, packing: Packing) -> None:
    """Check that a packing has no tangential displacements, for rules of rattlers that know no friction.

    Raises
    ------
    ValueError
        Naming the argument, and the call that knows friction.

    """
    if packing.tangential is not None:
        raise ValueError(
            f"{name} must have no tangential displacements for this call, to which only normal forces hold particles, "
            f"got {packing.tangential.springs}: ask pm.contact_forces(scene), or leave them out with "
            "packing.replace(tangential=None)"
        )


def no_own_images(name: str, packing: Packing) -> None:
    """Check that no link joins a particle to an image of itself, for calls that would not honor it.

    Such a link holds a strain and no particle. Calls that move particles, strain the box, or tell which particles can
    be taken out refuse it; those that take it into account as a constraint on strains accept it.

    Raises
    ------
    ValueError
        Naming the argument and the particle.

    """
    links = packing.links
    if (links.i_l == links.j_l).any():
        particle = int(links.i_l[links.i_l == links.j_l][0])
        raise ValueError(
            f"{name} must have no link of a particle to its own image for this call, got particle {particle}"
        )
