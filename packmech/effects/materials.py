"""What particles and walls of materials do where they touch: from Young's modulus, Poisson's ratio, restitution.

Two bodies of different materials touch as two of one material that stands for both (`Material` of the pair): what a
contact depends on, E*, G*, restitution and friction, are four numbers of it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.check import brief, did_you_mean, instance, integer, one_of, positive, real
from packmech.effects.body import Walls
from packmech.effects.damping import Restitution
from packmech.effects.friction import DampingRatio, Friction, Mindlin
from packmech.effects.kinds import ByKind, LawByKind, LawPerKind, PerKind, checked_pair
from packmech.effects.laws import ElasticSpheres, LinearSpring
from packmech.effects.repulsion import Repulsion
from packmech.packing import Packing, masses_of_density

# means of a number of two materials, by name
MIXING: dict[str, Callable[[float, float], float]] = {
    "geometric": lambda one, other: math.sqrt(one * other),
    "harmonic": lambda one, other: 2.0 * one * other / (one + other) if one * other > 0.0 else 0.0,
    "mean": lambda one, other: 0.5 * (one + other),
    "min": min,
}
# what the means are of
MIXED = ("friction", "restitution")


def _means(mixing: str | Mapping[str, str]) -> dict[str, Callable[[float, float], float]]:
    """Return the means of what two materials have: one for all, or those that a mapping names."""
    if not isinstance(mixing, Mapping):
        return dict.fromkeys(MIXED, MIXING[one_of("mixing", mixing, tuple(MIXING))])
    for name in mixing:
        if name not in MIXED:
            raise ValueError(
                f"mixing must be of {' or '.join(MIXED)}, got {brief(name)}{did_you_mean(str(name), MIXED)}"
            )
    return {name: MIXING[one_of(f"mixing.{name}", mixing.get(name, "geometric"), tuple(MIXING))] for name in MIXED}


def _modulus_of(one: Material, other: Material) -> float:
    """Return E* of two bodies of these materials, 1/E* = sum of (1 - nu^2) / E [force/length^2]."""
    return 1.0 / (1.0 / (2.0 * one.effective_modulus) + 1.0 / (2.0 * other.effective_modulus))


@shown()
@dataclass(frozen=True)
class Material:
    """A material that particles and walls are made of.

    Parameters
    ----------
    young_modulus
        E [force/length^2]; in a plane that of parallel cylinders, per length of these.
    poisson_ratio
        nu, from 0 to 0.5 [1].
    density
        Mass over volume, or over area in a plane [mass/length^d].
    restitution
        Share of the speed that head-on collisions leave, above 0 and at most 1 [1].
    friction
        Coulomb's coefficient [1].

    Raises
    ------
    TypeError, ValueError
        Naming the constant.

    Examples
    --------
    >>> import packmech as pm
    >>> glass = pm.Material(young_modulus=7e4, poisson_ratio=0.22, density=2.5, restitution=0.9, friction=0.4)
    >>> beads = pm.lattice_packing("fcc", repeats=(2, 2, 2))
    >>> [type(one).__name__ for one in glass.effects(beads)]
    ['Repulsion', 'Restitution', 'Friction']

    """

    young_modulus: float
    poisson_ratio: float = 0.3
    density: float = 1.0
    restitution: float = 1.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        checked = {
            "young_modulus": positive("young_modulus", self.young_modulus),
            "poisson_ratio": real("poisson_ratio", self.poisson_ratio, at_least=0.0, at_most=0.5),
            "density": positive("density", self.density),
            "restitution": real("restitution", self.restitution, above=0.0, at_most=1.0),
            "friction": real("friction", self.friction, at_least=0.0),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, float(value))

    @property
    def effective_modulus(self) -> float:
        """Of the contact of two particles, E* = E / (2 (1 - nu^2)) [force/length^2]."""
        return self.young_modulus / (2.0 * (1.0 - self.poisson_ratio**2))

    @property
    def shear_modulus(self) -> float:
        """G = E / (2 (1 + nu)) [force/length^2]."""
        return self.young_modulus / (2.0 * (1.0 + self.poisson_ratio))

    def effects(self, packing: Packing) -> tuple[Any, ...]:
        """Return what acts between touching particles of a packing.

        Spheres repel as Hertz's, F = (4/3) E* sqrt(R) overlap^(3/2) with R = r_i r_j / (r_i + r_j), and slide as
        Mindlin's; discs are slices of parallel cylinders and repel by k = pi E / (8 (1 - nu^2)) times the overlap.
        `Restitution` and the tangential dashpot, as strong, are there unless collisions leave all; friction where its
        coefficient is not 0.

        Masses are those of the packing: give calls that make it `density=material.density`.

        Parameters
        ----------
        packing
            Of discs or spheres.

        Raises
        ------
        TypeError, ValueError
            If it is no packing, or of other shapes.

        """
        return (Repulsion(self._law(packing, self.effective_modulus)), *self._dashpots(), *self._sliding())

    def walls(self, packing: Packing, axis: int, low: float, high: float, *, of: Material | None = None) -> Walls:
        """Return two walls across an axis that particles of this material touch as thick plates.

        Spheres are pressed by F = (4/3) E* sqrt(r) overlap^(3/2) and slide as Mindlin's, discs by (pi/4) E* times the
        overlap, 1/E* = (1 - nu^2)/E of the particles + that of the walls; collisions leave the restitution. (Walls with
        the law of the pairs are rigid plates: E* is twice that of two bodies of one material.)

        Parameters
        ----------
        packing
            Of discs or spheres.
        axis, low, high
            As of `Walls`.
        of
            What the walls are made of, the particles' material unless given. Restitution and friction are the geometric
            means of both.

        Raises
        ------
        TypeError, ValueError
            If an argument is wrong.

        Examples
        --------
        >>> import packmech as pm
        >>> glass, steel = pm.Material(7e4, 0.22, restitution=0.9), pm.Material(2e5, 0.3, restitution=0.4)
        >>> ball = pm.Packing([[2.0, 2.0, 1.0]], [0.5], pm.Box.cubic(4.0, 3))
        >>> floor = glass.walls(ball, axis=2, low=0.0, high=3.5, of=steel)
        >>> round(floor.damping.coefficient, 12)
        0.6

        """
        other = self if of is None else of
        instance("of", other, Material)
        both = self if of is None else self.mixed(other)
        # the law is that of the mirror image, whose overlap is twice as deep
        law = self._law(packing, 0.5 * _modulus_of(self, other))
        friction = both._sliding() or ((Friction(0.0),) if self.friction > 0.0 else (None,))
        return Walls._make((axis, low, high, law, *(both._dashpots() or (0.0,)), *friction, *(None,) * 4))

    def mixed(self, other: Material, mixing: str | Mapping[str, str] = "geometric") -> Material:
        """Return the material of which two bodies touch as one of this and one of the other.

        Its E* is that of both, 1/E* = sum of (1 - nu^2) / E, and its G*, 1/G* = sum of (2 - nu) / G, of which the
        stiffness across smooth contacts is made (Johnson, Contact Mechanics, 1985, section 7.3). The density is the
        mean.

        Parameters
        ----------
        other
            The other material.
        mixing
            Restitution and friction are these means of both: "geometric", "harmonic", "mean" (arithmetic), or "min"; a
            mapping such as {"friction": "min"} names a mean for each, geometric unless named.

        Raises
        ------
        TypeError, ValueError
            If an argument is wrong.

        Examples
        --------
        >>> import packmech as pm
        >>> pair = pm.Material(1.0, 0.3, friction=0.2).mixed(pm.Material(3.0, 0.3, friction=0.8))
        >>> round(pair.young_modulus, 12), round(pair.poisson_ratio, 12), round(pair.friction, 12)
        (1.5, 0.3, 0.4)

        """
        instance("other", other, Material)
        means = _means(mixing)
        modulus = _modulus_of(self, other)
        shear = 1.0 / sum((2.0 - one.poisson_ratio) / one.shear_modulus for one in (self, other))
        # of one material 4 G*/E* = 2 (1 - nu)/(2 - nu)
        ratio = 4.0 * shear / modulus
        poisson = min(max((2.0 - 2.0 * ratio) / (2.0 - ratio), 0.0), 0.5)
        return Material(
            young_modulus=2.0 * modulus * (1.0 - poisson**2),
            poisson_ratio=poisson,
            density=0.5 * (self.density + other.density),
            **{name: mean(getattr(self, name), getattr(other, name)) for name, mean in means.items()},
        )

    def _law(self, packing: Packing, modulus: float) -> ElasticSpheres | LinearSpring:
        """Return the repulsion of discs or spheres whose contacts have this E*."""
        instance("packing", packing, Packing)
        if packing.shapes.has_orientations:
            raise ValueError(
                f"packing must be of discs or spheres, whose curvature contacts feel, got {packing.shapes.names[1]}"
            )
        return ElasticSpheres(modulus) if packing.dimension == 3 else LinearSpring(0.25 * math.pi * modulus)

    def _dashpots(self) -> tuple[Restitution, ...]:
        return (Restitution(self.restitution),) if self.restitution < 1.0 else ()

    def _sliding(self) -> tuple[Friction, ...]:
        if not self.friction > 0.0:
            return ()
        across: Any = DampingRatio(1.0) if self.restitution < 1.0 else 0.0
        return (Friction(self.friction, Mindlin(self.poisson_ratio), across),)


@shown()
@dataclass(frozen=True)
class Materials:
    """Materials of the particles of a scene: those of kind k (`Packing.kind_n`) are of the k-th.

    Parameters
    ----------
    materials
        A `Material` for each kind.
    mixing
        Restitution and friction of two different materials are these means of both: "geometric", "harmonic", "mean"
        (arithmetic) or "min"; a mapping such as {"friction": "min"} names a mean for each, geometric unless named.
        Stiffnesses follow from the constants of both (`Material.mixed`).
    exceptions
        What was measured of pairs: {(a, b): {"friction": 0.3}}, with any fields of `Material` but the density; two
        bodies touch then as two of one material with these constants, and for the others those of both. Of a kind with
        itself these stand for its own.

    Raises
    ------
    TypeError, ValueError
        Naming the argument.

    Examples
    --------
    >>> import packmech as pm
    >>> glass = pm.Material(7e4, 0.22, density=2.5, restitution=0.9, friction=0.4)
    >>> steel = pm.Material(2e5, 0.3, density=7.8, restitution=0.6, friction=0.1)
    >>> both = pm.Materials((glass, steel), exceptions={(0, 1): {"friction": 0.3}})
    >>> both.of(0, 1).friction, round(both.of(0, 1).restitution, 6)
    (0.3, 0.734847)
    >>> crystal = pm.lattice_packing("fcc", repeats=(2, 2, 2))
    >>> beads = crystal.replace(kind_n=[0, 1] * (crystal.particles // 2))
    >>> beads = beads.replace(mass_n=both.masses(beads))
    >>> [type(one).__name__ for one in both.effects(beads)]
    ['Repulsion', 'Restitution', 'Friction']

    """

    materials: Sequence[Material]
    mixing: str | Mapping[str, str] = "geometric"
    exceptions: Mapping[tuple[int, int], Mapping[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if isinstance(self.materials, Material) or not isinstance(self.materials, Sequence) or not self.materials:
            raise TypeError(f"materials must be a tuple of materials, one for each kind, got {brief(self.materials)}")
        for k, one in enumerate(self.materials):
            instance(f"materials[{k}]", one, Material)
        object.__setattr__(self, "materials", tuple(self.materials))
        _means(self.mixing)
        instance("exceptions", self.exceptions, Mapping)
        known = {each.name for each in fields(Material)} - {"density"}
        checked: dict[tuple[int, int], dict[str, float]] = {}
        for pair, numbers in self.exceptions.items():
            low, high = checked_pair("exceptions", pair)
            if high >= len(self.materials):
                raise ValueError(
                    f"exceptions must name kinds below {len(self.materials)}, the number of materials, "
                    f"got {brief(pair)}"
                )
            if (low, high) in checked:
                raise ValueError(f"exceptions must name kinds {low} and {high} once, got {brief(pair)} again")
            if not isinstance(numbers, Mapping) or not set(numbers) <= known:
                names = ", ".join(sorted(known))
                raise ValueError(
                    f"exceptions must hold numbers by name, among {names}, got {brief(numbers)} for {pair!r}"
                )
            checked[low, high] = dict(numbers)
        object.__setattr__(self, "exceptions", checked)
        for pair in self._pairs():
            try:
                self.of(*pair)
            except (TypeError, ValueError) as error:
                raise type(error)(f"exceptions[{pair}].{error}") from error

    def of(self, one: int, other: int) -> Material:
        """Return the material of which two particles touch as those of these kinds do."""
        low, high = checked_pair("kinds", (one, other))
        first, second = self.materials[low], self.materials[high]
        both = first if first == second else first.mixed(second, self.mixing)
        return replace(both, **self.exceptions.get((low, high), {}))

    def effects(self, packing: Packing) -> tuple[Any, ...]:
        """Return what acts between touching particles of a packing, as `Material.effects` of each pair of kinds.

        Numbers that are the same for all pairs are no tables; of one material the effects are those of
        `Material.effects`. `Restitution` is there if collisions of some pair do not leave all, friction if the
        coefficient of some pair is not 0.

        Masses are those of the packing: `masses` are those of the materials.

        Parameters
        ----------
        packing
            Of discs or spheres.

        Raises
        ------
        TypeError, ValueError
            If it is no packing, of other shapes, or of more kinds than there are materials.

        """
        self._check(packing)
        table = [self.of(*pair) for pair in self._pairs()]
        laws = [one._law(packing, one.effective_modulus) for one in table]
        law: Any = laws[0] if len(set(laws)) == 1 else LawByKind(tuple(laws))
        found: list[Any] = [Repulsion(law)]
        inelastic = any(one.restitution < 1.0 for one in table)
        if inelastic:
            found.append(Restitution(_by_kind([one.restitution for one in table])))
        if any(one.friction > 0.0 for one in table):
            across: Any = DampingRatio(1.0) if inelastic else 0.0
            stiffness = Mindlin(_by_kind([one.poisson_ratio for one in table]))
            found.append(Friction(_by_kind([one.friction for one in table]), stiffness, across))
        return tuple(found)

    def walls(self, packing: Packing, axis: int, low: float, high: float, *, of: Material | int) -> Walls:
        """Return two walls across an axis that particles of each kind touch as thick plates: `Material.walls` of each.

        Restitution and friction are the means of both materials. Numbers that are the same for all kinds are no rows
        (`LawPerKind`, `PerKind`).

        Parameters
        ----------
        packing
            Of discs or spheres.
        axis, low, high
            As of `Walls`.
        of
            What the walls are made of: a material, or the place of one among these, of whose pairs with the others
            `exceptions` hold. It may be one that no particle is of.

        Raises
        ------
        TypeError, ValueError
            If an argument is wrong, or the packing is of more kinds than there are materials.

        Examples
        --------
        >>> import packmech as pm
        >>> glass, steel = pm.Material(7e4, 0.22, restitution=0.9), pm.Material(2e5, 0.3, restitution=0.4)
        >>> balls = pm.Packing([[1.0, 1.0, 1.0], [3.0, 1.0, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 3), kind_n=[0, 1])
        >>> both = pm.Materials((glass, steel), exceptions={(0, 1): {"restitution": 0.7}})
        >>> both.walls(balls, axis=2, low=0.0, high=3.5, of=1).damping
        Restitution(coefficient=PerKind(values=(0.7, 0.4)))

        """
        self._check(packing)
        pairs = [self._with_wall(kind, of) for kind in range(len(self.materials))]
        laws = [pair._law(packing, 0.5 * modulus) for pair, modulus in pairs]
        law: Any = laws[0] if len(set(laws)) == 1 else LawPerKind(tuple(laws))
        inelastic = any(pair.restitution < 1.0 for pair, _ in pairs)
        dashpot = Restitution(_per_kind([pair.restitution for pair, _ in pairs])) if inelastic else 0.0
        friction = None
        if any(pair.friction > 0.0 for pair, _ in pairs):
            across: Any = DampingRatio(1.0) if inelastic else 0.0
            stiffness = Mindlin(_per_kind([pair.poisson_ratio for pair, _ in pairs]))
            friction = Friction(_per_kind([pair.friction for pair, _ in pairs]), stiffness, across)
        elif any(self.of(*pair).friction > 0.0 for pair in self._pairs()):
            friction = Friction(0.0)
        return Walls._make((axis, low, high, law, dashpot, friction, *(None,) * 4))

    def _with_wall(self, kind: int, of: Material | int) -> tuple[Material, float]:
        """Return the material of which particles of a kind and walls touch as, and E* [force/length^2]."""
        one = self.materials[kind]
        if isinstance(of, Material):
            return (one if one == of else one.mixed(of, self.mixing)), _modulus_of(one, of)
        if isinstance(of, bool) or not isinstance(of, int | np.integer):
            raise TypeError(f"of must be a Material, or the number of one of these, got {brief(of)}")
        place = integer("of", of, at_least=0, at_most=len(self.materials) - 1)
        both = self.of(kind, place)
        measured = self.exceptions.get((min(kind, place), max(kind, place)), {})
        if {"young_modulus", "poisson_ratio"} & set(measured):
            return both, both.effective_modulus
        return both, _modulus_of(one, self.materials[place])

    def masses(self, packing: Packing) -> NDArray[np.float64]:
        """Return the (N,) masses of a packing's particles, of the densities of their materials [mass].

        Raises
        ------
        TypeError, ValueError
            If it is no packing, or of more kinds than there are materials.

        """
        self._check(packing)
        kind_n = np.zeros(packing.particles, np.int64) if packing.kind_n is None else packing.kind_n
        density = np.array([one.density for one in self.materials])
        volume = masses_of_density(1.0, packing.radius_n, packing.dimension)
        return np.asarray(density[kind_n] * np.asarray(volume))

    def _pairs(self) -> list[tuple[int, int]]:
        """Return all pairs of kinds, in the order of tables."""
        kinds = range(len(self.materials))
        return [(low, high) for high, low in itertools.product(kinds, kinds) if low <= high]

    def _check(self, packing: Packing) -> None:
        instance("packing", packing, Packing)
        if packing.kind_n is None and len(self.materials) > 1:
            raise ValueError(
                f"packing must have kinds for {len(self.materials)} materials, got none: kind_n=..., "
                "pm.assign_kinds(...), or the table [kinds] of a scene file"
            )
        if packing.kinds > len(self.materials):
            raise ValueError(
                f"packing must be of as many kinds as there are materials, {len(self.materials)}, got {packing.kinds}"
            )


def _per_kind(numbers: list[float]) -> Any:
    """Return a row of numbers of kinds, or the number where all are the same."""
    return numbers[0] if len(set(numbers)) == 1 else PerKind(tuple(numbers))


def _by_kind(numbers: list[float]) -> Any:
    """Return a table of numbers of pairs, or the number where all are the same."""
    return numbers[0] if len(set(numbers)) == 1 else ByKind(tuple(numbers))
