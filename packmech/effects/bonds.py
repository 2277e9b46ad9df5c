"""Bonds: permanent springs between pairs of particles, which hold whether these touch or not; and bonds of contacts."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import (
    LARGEST_FLOAT,
    brief,
    entries,
    finite_array,
    instance,
    integer_array,
    one_of,
    positive_array,
    real,
)
from packmech.contacts import Contacts, find_contacts, pair_contacts
from packmech.contacts.shape_contacts import ShapeContacts, find_shape_contacts
from packmech.effects.held import held_particles
from packmech.effects.kinds import kinds_matter
from packmech.effects.laws import Law, LinearSpring, is_law, law_first
from packmech.effects.pair import bound_effect
from packmech.effects.partners import equal_partners, feels_curvature
from packmech.links import Links, named_rows
from packmech.packing import Packing, images_between

T = TypeVar("T", bound=Contacts | ShapeContacts)


# what a bond may break by, in the order of the limits
BREAKING_MODES = ("tension", "compression", "stretch", "squeeze", "shear")


@shown(str)
@dataclass(frozen=True)
class BondLimits:
    """Loads beyond which a bond breaks, for good; each is one number or one for each bond, None where there is none.

    Tension and compression have limits of their own: a bond with a limit in tension alone never breaks in compression.
    Forces are those of the springs, without what dashpots add.

    Parameters
    ----------
    tension
        Largest pulling force of the normal spring [force].
    compression
        Largest pushing force of the normal spring [force].
    stretch
        Largest relative elongation, distance / rest length - 1 [1].
    squeeze
        Largest relative shortening, 1 - distance / rest length, below 1 [1].
    shear
        Largest force of the tangential spring [force].

    Raises
    ------
    TypeError, ValueError
        If a limit is no number and no list of numbers, is not positive, or is a squeeze of 1 or more, which no bond can
        exceed; or if there is no limit at all.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.BondLimits(tension=0.02, shear=0.01)
    <packmech.BondLimits> tension 0.02, shear 0.01
      tension  0.02  [force]
      shear    0.01  [force]

    """

    tension: float | tuple[float, ...] | None = None
    compression: float | tuple[float, ...] | None = None
    stretch: float | tuple[float, ...] | None = None
    squeeze: float | tuple[float, ...] | None = None
    shear: float | tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        for name in BREAKING_MODES:
            object.__setattr__(self, name, _limit(name, getattr(self, name)))
        if not self.modes:
            raise ValueError(f"tension must be given, or one of {', '.join(BREAKING_MODES[1:])}, got no limit")

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the limits that there are."""
        return tuple(name for name in BREAKING_MODES if getattr(self, name) is not None)

    def __str__(self) -> str:
        return ", ".join(
            f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {min(value):.6g} to {max(value):.6g}"
            for name in self.modes
            if (value := getattr(self, name)) != ()
        )

    def table(self, bonds: int) -> NDArray[np.float64]:
        """Return the (B, 5) limits of so many bonds, in the order of the fields; infinite where there is none."""
        found = np.full((bonds, len(BREAKING_MODES)), np.inf)
        for k, name in enumerate(BREAKING_MODES):
            if getattr(self, name) is not None:
                found[:, k] = getattr(self, name)
        return found

    def select(self, which_b: NDArray[Any]) -> BondLimits:
        """Return the limits of the bonds that are marked or numbered."""
        many = {name: getattr(self, name) for name in self.modes if isinstance(getattr(self, name), tuple)}
        return dataclasses.replace(
            self, **{name: tuple(np.array(value, dtype=float)[which_b].tolist()) for name, value in many.items()}
        )


def _limit(name: str, value: Any) -> float | tuple[float, ...] | None:
    """Return a limit that was checked: a number above 0, or several; infinite ones never break a bond."""
    if value is None:
        return None
    value = value.tolist() if isinstance(value, np.ndarray) else value
    several = isinstance(value, list | tuple) and not hasattr(value, "_fields")
    given = list(value) if several else [value]
    for one in given:
        if isinstance(one, bool) or not isinstance(one, int | float | np.integer | np.floating):
            raise TypeError(f"{name} must be a number, or one for each bond, or None, got {brief(one)}")
        if not one > 0.0:
            raise ValueError(f"{name} must be positive, got {brief(one)}")
        if LARGEST_FLOAT < one < math.inf:
            raise ValueError(f"{name} must be a number that a float64 holds, or inf, got {brief(one)}")
        if name == "squeeze" and 1.0 <= one < math.inf:
            raise ValueError(
                f"squeeze must be below 1, as no bond is shorter than 0, or inf for none, got {brief(one)}"
            )
    return tuple(map(float, given)) if several else float(given[0])


@shown(lambda one: f"{len(one)} bonds")
@bound_effect
@dataclass(frozen=True, eq=False)
class Bonds:
    """Permanent bonds: a normal spring of any distance, an unbounded tangential spring, and dashpots along both.

    A bonded pair is no contact: the bond's compression stands for its repulsion. These are the permanent links of
    particleShear (Braschler, 2021), not packmech's rigid links. `pm.bond_contacts` makes
    them of the contacts of a packing. Bonds of ellipses, spheroids and rigid bodies act on their centers and turn
    them no more than gravity does: those with tangential springs or dashpots are refused there. At the start of a scene
    tangential springs are slack. Second derivatives of energies, modes and `quench` take bonds without them
    (tangential_stiffness=0.0); `elastic_moduli`, `stiffness_matrix` and `complex_modulus` with them.

    With limits (`breaks_at`) bonds break in runs that step through time: one that is beyond a limit at the end of a
    step never acts again, and its pair is an ordinary contact from then on. Such a run holds what broke as
    `broken_bonds` and what is left as `bonds`. Calls that would strain bonds without breaking them, such as `quench`,
    refuse limits; take them away with `unbreakable`.

    Parameters
    ----------
    i_b, j_b
        (B,) particles of each bond, i < j, or i == j with an image.
    image_bd
        (B, d) image vectors: the bond's vector is x_j - x_i + lattice @ image.
    rest_length_b
        (B,) distances at which the normal spring is slack [length].
    compression, tension
        Laws of the distance and the rest length below and above it.
    tangential_stiffness
        Of the tangential spring [energy/length^2].
    damping, tangential_damping
        Of the dashpots along and across the bond [mass/time].
    breaks_at
        Loads beyond which a bond breaks (`BondLimits`); None: never.

    Examples
    --------
    A bond that breaks when it is pulled with a force of more than 0.02:

    >>> import packmech as pm
    >>> pair = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    >>> bond = pm.Bonds([0], [1], [[0, 0]], [1.0], breaks_at=pm.BondLimits(tension=0.02))
    >>> scene = pm.Scene(pair, (pm.Repulsion(), bond))
    >>> run = pm.simulate(scene, duration=1.0, velocity_nd=[[-0.05, 0.0], [0.05, 0.0]])
    >>> run.broken_bonds.mode_e.tolist(), len(run.bonds)
    (['tension'], 0)

    """

    i_b: NDArray[np.int64]
    j_b: NDArray[np.int64]
    image_bd: NDArray[np.int64]
    rest_length_b: NDArray[np.float64]
    compression: Law = LinearSpring()
    tension: Law = LinearSpring()
    tangential_stiffness: float = 1.0
    damping: float = 0.0
    tangential_damping: float = 0.0
    breaks_at: BondLimits | None = None

    acts_as: ClassVar[str] = "bonds"

    def __post_init__(self) -> None:
        i = integer_array("i_b", self.i_b, shape=(None,))
        j = integer_array("j_b", self.j_b, shape=i.shape)
        image = entries("image_bd", self.image_bd, "iu", "integers")
        image = integer_array("image_bd", image, shape=(len(i), image.shape[1] if image.ndim == 2 else None))
        rest = finite_array("rest_length_b", self.rest_length_b, shape=i.shape, what="bond", empty=True)
        if len(rest):
            rest = positive_array("rest_length_b", rest, shape=i.shape, what="bond")
        for name, end in {"i_b": i, "j_b": j}.items():
            if len(end) and int(end.min()) < 0:
                raise ValueError(f"{name} must not be negative, got {int(end.min())} for bond {int(end.argmin())}")
        flip = i > j
        i, j = np.where(flip, j, i), np.where(flip, i, j)
        image = np.where(flip[:, None], -image, image)
        order = np.lexsort((*image.T[::-1], j, i))
        for name, value in {
            "i_b": i[order],
            "j_b": j[order],
            "image_bd": np.ascontiguousarray(image[order]),
            "rest_length_b": rest[order],
        }.items():
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        for name in ("compression", "tension"):
            one = getattr(self, name)
            if not is_law(one):
                raise TypeError(f"{name} must be a law such as LinearSpring(...), got {brief(one)}")
            if feels_curvature(one):
                raise ValueError(
                    f"{name} must be a law of the distance and the rest length, as bonds have no effective radius, got "
                    f"{one!r}"
                )
            if kinds_matter((one,)):
                raise ValueError(
                    f"{name} must be the same for all kinds of particles, as bonds join particles by name, "
                    f"got {brief(one)}"
                )
        self._check_tension()
        for name in ("tangential_stiffness", "damping", "tangential_damping"):
            object.__setattr__(self, name, real(name, getattr(self, name), at_least=0.0))
        if self.breaks_at is not None:
            self._check_limits(order)

    def _check_tension(self) -> None:
        """Refuse a law of the tension that holds below its contact distance alone; numbers are the scene's to check."""
        tension = cast(tuple[Any, ...], self.tension)
        if not all(math.isfinite(one) for one in tension if isinstance(one, int | float)):
            return
        for rest in (float(self.rest_length_b.min()), float(self.rest_length_b.max())) if len(self) else ():
            try:
                force = float(law_first(self.tension, 1.1 * rest, equal_partners(rest)))
            except (ArithmeticError, ValueError):
                force = math.nan
            if not math.isfinite(force):
                raise ValueError(
                    "tension must be a law that holds beyond the rest length, such as LinearSpring(...) or "
                    f"ExponentialTension(...), got {brief(self.tension)}"
                )

    def _check_limits(self, order_b: NDArray[np.int64]) -> None:
        """Check the limits, and put those of single bonds in the order of the bonds."""
        instance("breaks_at", self.breaks_at, BondLimits)
        limits = cast(BondLimits, self.breaks_at)
        for name in limits.modes:
            value = getattr(limits, name)
            if isinstance(value, tuple) and len(value) != len(order_b):
                raise ValueError(
                    f"breaks_at.{name} must be a number or one for each of {len(order_b)} bonds, got {len(value)}"
                )
        if limits.shear is not None and not self.tangential_stiffness:
            raise ValueError(
                "breaks_at.shear must be None for bonds without tangential springs (tangential_stiffness=0.0), which "
                f"bear no shear, got {limits.shear}"
            )
        object.__setattr__(self, "breaks_at", limits.select(order_b))

    @property
    def acts_also(self) -> tuple[str, ...]:
        """Further columns of `packmech effects`: bonds with limits break."""
        return () if self.breaks_at is None else ("breaking",)

    def __len__(self) -> int:
        return len(self.i_b)

    def __eq__(self, other: object) -> bool:
        if type(other) is not Bonds:
            return NotImplemented
        return all(_same(getattr(self, name), getattr(other, name)) for name in self.__dataclass_fields__)

    __hash__ = None  # type: ignore[assignment]

    def select(self, keep_b: NDArray[np.bool_]) -> Bonds:
        """Return the bonds that are marked."""
        return dataclasses.replace(
            self,
            i_b=self.i_b[keep_b],
            j_b=self.j_b[keep_b],
            image_bd=self.image_bd[keep_b],
            rest_length_b=self.rest_length_b[keep_b],
            breaks_at=None if self.breaks_at is None else self.breaks_at.select(keep_b),
        )

    def unbreakable(self) -> Bonds:
        """Return the bonds without limits: they never break.

        Examples
        --------
        >>> import packmech as pm
        >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
        >>> bonds = pm.bond_contacts(crystal, tangential_stiffness=0.0, breaks_at=pm.BondLimits(tension=0.02))
        >>> scene = pm.Scene(crystal, (pm.Repulsion(), bonds.unbreakable()))
        >>> pm.quench(scene, force_tolerance=1e-9).ok
        True

        """
        return dataclasses.replace(self, breaks_at=None)

    def continued(self, start: Packing, end: Packing) -> Bonds:
        """Return the bonds of a packing that has become another one, particles of which may have been wrapped.

        A bond between particles of which one was wrapped goes on at the image at which its vector has changed less.
        """
        if not len(self) or {end.position_nd.shape, (start.particles, self.image_bd.shape[1])} != {
            start.position_nd.shape
        }:
            return self
        image = images_between(start.position_nd, start.box, end.position_nd, end.box)
        if image is None or not image.any() or int(self.j_b.max()) >= start.particles:
            return self

        def vectors(packing: Packing, image_bd: NDArray[np.int64]) -> NDArray[np.float64]:
            place = packing.position_nd
            return np.asarray(place[self.j_b] - place[self.i_b] + image_bd @ packing.box.lattice_dd.T)

        other = self.image_bd - image[self.j_b] + image[self.i_b]
        before = vectors(start, self.image_bd)
        here, there = (((vectors(end, one) - before) ** 2).sum(axis=1) for one in (self.image_bd, other))
        if not (there < here).any():
            return self
        return dataclasses.replace(self, image_bd=np.where((there < here)[:, None], other, self.image_bd))


def bonds_of(effects: tuple[Any, ...]) -> Bonds | None:
    """Return the bonds among the effects; None without."""
    return next((one for one in effects if isinstance(one, Bonds) and len(one)), None)


def acts(contacts: Contacts | ShapeContacts, effects: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Return (C,) which contacts push something: of pairs that no bond joins at the same image, and not of two held."""
    held, bonds = held_particles(effects, contacts.particles), bonds_of(effects)
    acting = np.ones(len(contacts), dtype=bool) if held is None else ~(held[contacts.i_c] & held[contacts.j_c])
    if bonds is not None:
        named = (contacts.i_c, contacts.j_c, contacts.image_cd)
        acting &= named_rows((bonds.i_b, bonds.j_b, bonds.image_bd), named) < 0
    return acting


def acting_contacts(contacts: T, effects: tuple[Any, ...]) -> T:
    """Return the contacts that push something (`acts`)."""
    acting = acts(contacts, effects)
    return contacts if acting.all() else cast(T, contacts.select(acting))


def links_and_bonds(packing: Packing, effects: tuple[Any, ...]) -> Links:
    """Return the packing's links and its bonds as such: what bonds join goes together, as clusters do."""
    bonds = bonds_of(effects)
    if bonds is None:
        return packing.links
    length = pair_contacts(packing, bonds.i_b, bonds.j_b, bonds.image_bd).distance_c
    return packing.links.joined(Links(bonds.i_b, bonds.j_b, bonds.image_bd, length))


def refuse_tangential_bonds(effects: tuple[Any, ...], shapes: Any) -> None:
    """Refuse tangential springs and dashpots of bonds between particles that are no discs or spheres."""
    one = bonds_of(effects)
    if one is not None and shapes.has_orientations and (one.tangential_stiffness or one.tangential_damping):
        raise ValueError(
            f"scene.effects[{effects.index(one)}] must have tangential_stiffness=0.0 and tangential_damping=0.0 for "
            f"{type(shapes).__name__}, on whose centers bonds act, got {one.tangential_stiffness:g} and "
            f"{one.tangential_damping:g}"
        )


def refuse_tangential_springs(effects: tuple[Any, ...]) -> None:
    """Refuse bonds with tangential springs where only those along bonds have an energy.

    Raises
    ------
    ValueError
        Naming the effect and the way out.

    """
    one = bonds_of(effects)
    if one is not None and one.tangential_stiffness:
        raise ValueError(
            f"scene.effects[{effects.index(one)}] must have tangential_stiffness=0.0 here: tangential springs of bonds "
            "have no energy of positions, since they stretch as particles move and turn on their way, got "
            f"{one.tangential_stiffness:g}; use pm.complex_modulus or pm.simulate"
        )


def _same(one: Any, other: Any) -> bool:
    return bool(np.array_equal(one, other)) if isinstance(one, np.ndarray) else bool(one == other)


def _between_shapes(
    packing: Packing, rest: str, gap_tolerance: float | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return which particles with shapes touch through which images, each pair once, and the lengths of their bonds."""
    if packing.shapes.has_beads and rest == "contact":
        raise ValueError('rest must be "distance" for rigid bodies, which may touch in several places, got "contact"')
    found = find_shape_contacts(packing, gap_tolerance=gap_tolerance)
    pairs = np.column_stack([found.i_c, found.j_c, found.image_cd])
    first = np.sort(np.unique(pairs, axis=0, return_index=True)[1])
    length = np.sqrt((found.vector_cd**2).sum(axis=1))
    if rest == "contact":
        length = length * (found.contact_distance_c / found.distance_c)
    return found.i_c[first], found.j_c[first], found.image_cd[first], length[first]


REST = ("contact", "distance")


@honors("shapes", packing_only=True)
def bond_contacts(
    packing: Packing,
    *,
    compression: Law | None = None,
    tension: Law | None = None,
    tangential_stiffness: float = 1.0,
    damping: float = 0.0,
    tangential_damping: float = 0.0,
    rest: str = "contact",
    gap_tolerance: float | None = None,
    breaks_at: BondLimits | None = None,
) -> Bonds:
    """Return bonds between all particles that touch.

    Parameters
    ----------
    packing
        The packing.
    compression, tension
        Laws of the normal springs; LinearSpring() unless given.
    tangential_stiffness, damping, tangential_damping
        As of `Bonds`.
    rest
        Lengths at which the normal springs are slack: "contact", the sums of the radii, so that bonds made in a
        compressed packing push; "distance", the distances as they are, so that they do not. Of ellipses and spheroids
        the former are the distances of the centers at which they would just touch as they are turned; of rigid bodies
        only the latter are defined, and bodies that touch in several places get one bond.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching.
    breaks_at
        Loads beyond which bonds break; None: never.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> bonds = bond_contacts(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01))
    >>> len(bonds), float(bonds.rest_length_b[0])
    (27, 1.0)

    """
    instance("packing", packing, Packing)
    one_of("rest", rest, REST)
    if not packing.shapes.has_orientations:
        contacts = find_contacts(packing, gap_tolerance=gap_tolerance)
        i, j, image = contacts.i_c, contacts.j_c, contacts.image_cd
        length = contacts.contact_distance_c if rest == "contact" else contacts.distance_c
    else:
        i, j, image, length = _between_shapes(packing, rest, gap_tolerance)
    return Bonds(
        i,
        j,
        image,
        length,
        LinearSpring() if compression is None else compression,
        LinearSpring() if tension is None else tension,
        tangential_stiffness,
        damping,
        tangential_damping,
        breaks_at,
    )
