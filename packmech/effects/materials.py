"""What touching particles of one material do, from its constants: Young's modulus, Poisson's ratio, restitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from packmech.calls.display import shown
from packmech.check import instance, positive, real
from packmech.effects.damping import Restitution
from packmech.effects.friction import DampingRatio, Friction, Mindlin
from packmech.effects.laws import ElasticSpheres, LinearSpring
from packmech.effects.material import contact_stiffness
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

        Parameters
        ----------
        packing
            Of discs or spheres.

        Raises
        ------
        TypeError, ValueError
            If it is no packing, or of other shapes.

        """
        instance("packing", packing, Packing)
        if packing.shapes.has_orientations:
            raise ValueError(
                f"packing must be of discs or spheres, whose curvature contacts feel, got {packing.shapes.names[1]}"
            )
        law: Any = LinearSpring(contact_stiffness(self.young_modulus, poisson_ratio=self.poisson_ratio))
        if packing.dimension == 3:
            law = ElasticSpheres(self.effective_modulus)
        dashpot = (Restitution(self.restitution),) if self.restitution < 1.0 else ()
        sliding: tuple[Any, ...] = ()
        if self.friction > 0.0:
            across = DampingRatio(1.0) if dashpot else 0.0
            sliding = (Friction(self.friction, Mindlin(self.poisson_ratio), across),)
        return (Repulsion(law), *dashpot, *sliding)
