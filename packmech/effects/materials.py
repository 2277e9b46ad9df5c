"""What touching particles of one material do, from its constants: Young's modulus, Poisson's ratio, restitution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from packmech.calls.display import shown
from packmech.check import instance, positive, real
from packmech.effects.body import Walls
from packmech.effects.damping import Restitution
from packmech.effects.friction import DampingRatio, Friction, Mindlin
from packmech.effects.laws import ElasticSpheres, Law, LinearSpring
from packmech.effects.repulsion import Repulsion
from packmech.packing import Packing


@shown()
@dataclass(frozen=True)
class Material:
    """A material that all particles of a scene are made of.

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
        modulus = 1.0 / (1.0 / (2.0 * self.effective_modulus) + 1.0 / (2.0 * other.effective_modulus))
        both = self if of is None else self._mixed(other, modulus)
        dashpots, sliding = both._dashpots(), both._sliding()
        # the law is that of the mirror image, whose overlap is twice as deep
        law = self._law(packing, 0.5 * modulus)
        friction = sliding[0] if sliding else Friction(0.0) if self.friction > 0.0 else None
        return Walls._make((axis, low, high, law, dashpots[0] if dashpots else 0.0, friction, *(None,) * 4))

    def _mixed(self, other: Material, modulus: float) -> Material:
        """Return the material of which two bodies touch as one of this and one of the other, of this E*."""
        shear = 1.0 / sum((2.0 - one.poisson_ratio) / one.shear_modulus for one in (self, other))
        # of one material 4 G*/E* = 2 (1 - nu)/(2 - nu)
        ratio = 4.0 * shear / modulus
        poisson = min(max((2.0 - 2.0 * ratio) / (2.0 - ratio), 0.0), 0.5)
        return Material(
            young_modulus=2.0 * modulus * (1.0 - poisson**2),
            poisson_ratio=poisson,
            restitution=math.sqrt(self.restitution * other.restitution),
            friction=math.sqrt(self.friction * other.friction),
        )

    def _law(self, packing: Packing, modulus: float) -> Law:
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
