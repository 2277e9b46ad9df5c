"""Cohesion of discs and spheres: contacts that pull, with and without a memory of having touched.

All are interactions (`packmech.effects.interaction`): they act along the line of centers, beside a `Repulsion` or, as
`JKR` does, in its place. R is the effective radius r_i r_j / (r_i + r_j) of the two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import brief, positive
from packmech.contacts.network import effective_radius
from packmech.effects.pair import effect
from packmech.effects.partners import Partners
from packmech.jit.compiled import device

# part by which the cube of a remembered square may be off [1]
_SAME_CONTACT = 1e-12
# x = (a / length)^(1/2) at which a JKR contact breaks where distances are held: d(overlap)/dx = 0, 4 x^3 = 1
_BREAKS = 0.25 ** (1.0 / 3.0)
# the larger root of x^4 - x = overlap is a smooth function of the width w = (overlap + 3 b/4)^(1/2), b = _BREAKS; the
# axis of w + _OFFSET is cut into octaves, and each of these into so many pieces (a power of 2) ...
_OFFSET, _PIECES, _OCTAVES = 0.5, 16, 18
# ... on which a polynomial of this degree is within 1e-16 of it
_DEGREE = 7


def _roots_of_pieces() -> NDArray[np.float64]:
    """Return the (octaves * pieces, degree + 1) coefficients, of t from -1 to 1 on each piece, lowest power first."""
    node = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    octave_k, piece_k = np.divmod(np.arange(_OCTAVES * _PIECES), _PIECES)
    width = _OFFSET * (2.0**octave_k * (1.0 + (piece_k + 0.5 + 0.5 * node[:, None]) / _PIECES) - 1.0)
    # Halley's method for u = x - b, u^2 (6 b^2 + 4 b u + u^2) = w^2, from what is exact of bonds about to break
    bend = math.sqrt(1.5) * _BREAKS
    u = width / (bend + np.sqrt(bend * bend + width))
    for _ in range(4):
        left = u * u * (6.0 * _BREAKS * _BREAKS + u * (4.0 * _BREAKS + u)) - width * width
        slope = u * (12.0 * _BREAKS * _BREAKS + u * (12.0 * _BREAKS + 4.0 * u))
        u -= left * slope / (slope * slope - 6.0 * (_BREAKS + u) ** 2 * left)
    return np.ascontiguousarray(np.linalg.solve(np.vander(node, increasing=True), _BREAKS + u).T)


_ROOTS = _roots_of_pieces()
# bits of a number from 1 to 2, of what is behind its point, and of the piece in it
_ONE, _FRACTION = 0x3FF0000000000000, 0x000FFFFFFFFFFFFF
_PIECE_BITS = 52 - (_PIECES.bit_length() - 1)
_FIRST_PIECE = int(np.float64(_OFFSET).view(np.int64)) >> _PIECE_BITS


@effect
class ShortRangeAttraction(NamedTuple):
    """A spring that goes on beyond contact to a largest tension, which then falls linearly to zero.

    With s = r/sigma the energy is (energy_scale / 2) (1 - s)^2 - energy_scale width^2 from contact to s = 1 + width,
    and -(energy_scale / 2) (1 + 2 width - s)^2 from there to 1 + 2 width; it is constant below contact, where the
    repulsion acts. Beside `Repulsion(Harmonic(energy_scale))` this is the model of Irani, Chaudhuri and Heussinger,
    Phys. Rev. Lett. 112, 188303 (2014), whose spring is one from deep overlaps to the largest tension
    energy_scale width / sigma. No contact is ever made or broken by a jump: there is no memory.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    energy_scale
        Of the spring; that of the harmonic repulsion makes it one with it [energy].
    width
        Stretch of the largest tension over the contact distance, half the range [1].

    Examples
    --------
    >>> well = ShortRangeAttraction(width=0.01)
    >>> [round(well.interaction_first(r, 1.0, 1.0)[0], 12) for r in (0.9, 1.005, 1.01, 1.015)]
    [0.0, 0.005, 0.01, 0.005]

    """

    energy_scale: float = 1.0
    width: float = 0.01

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        return "" if self.width > 0.0 else f"width must be positive, got {brief(self.width)}"

    def reach(self, contact_distance: float) -> float:
        """Return the distance beyond which it is zero [length]."""
        return (1.0 + 2.0 * self.width) * contact_distance

    def interaction_energy(self, distance: float, contact_distance: float, alignment: float) -> float:
        """Return the energy [energy]."""
        stretch = max((distance - contact_distance) / contact_distance, 0.0)
        if stretch < self.width:
            return self.energy_scale * (0.5 * stretch * stretch - self.width * self.width)
        left = 2.0 * self.width - stretch
        return -0.5 * self.energy_scale * left * left

    def interaction_first(self, distance: float, contact_distance: float, alignment: float) -> tuple[float, float]:
        """Return the slopes by distance [force] and alignment [energy]."""
        stretch = max((distance - contact_distance) / contact_distance, 0.0)
        return self.energy_scale / contact_distance * min(stretch, 2.0 * self.width - stretch), 0.0

    def interaction_second(
        self, distance: float, contact_distance: float, alignment: float
    ) -> tuple[float, float, float]:
        """Return the second derivatives: by distance [force/length], both, alignment."""
        stretch = (distance - contact_distance) / contact_distance
        stiffness = self.energy_scale / (contact_distance * contact_distance)
        return 0.0 if stretch < 0.0 else stiffness if stretch < self.width else -stiffness, 0.0, 0.0


@effect
class DMT(NamedTuple):
    """The pull F = 2 pi w R of Derjaguin, Muller and Toporov (1975), beside `Repulsion(ElasticSpheres(...))`.

    It is constant while particles touch, so that it takes F to part them. Beyond contact it goes on as the van der
    Waals force of the same strength, A R / (6 (gap + z)^2) with A = 12 pi w z^2, lowered in proportion so that it is F
    at contact and ends at a gap of `cut` z: forces are continuous, nothing is remembered. LAMMPS (granular, dmt) lets
    the pull jump to zero at contact; the reversible adhesion of MercuryDPM lets it fall linearly over a range, as
    `ShortRangeAttraction` does. From contact it takes the work F z c / (c + 2) to part them, c the cut.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    adhesion
        w, the work of adhesion per area [energy/length^2].
    separation
        z, the range of the van der Waals force [length].
    cut
        Largest gap over z [1].

    Examples
    --------
    >>> pull = DMT(adhesion=0.01, separation=0.01)
    >>> round(pull.interaction_first(0.99, Partners(1.0, 0.25), 1.0)[0] / (2 * math.pi * 0.01 * 0.25), 12)
    1.0

    """

    adhesion: float = 0.01
    separation: float = 0.01
    cut: float = 10.0

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        if not self.separation > 0.0:
            return f"separation must be positive, got {brief(self.separation)}"
        # nearer than that the force would be over before it begins, in double precision
        return "" if self.cut > 1e-6 else f"cut must be positive, above 1e-6, got {brief(self.cut)}"

    def reach(self, partners: Partners) -> float:
        """Return the distance beyond which it is zero [length]."""
        return partners.contact_distance + self.cut * self.separation

    def pull_off_force(self, radius: float, other: float) -> float:
        """Return the largest tension between particles of two radii, 2 pi w R: what parts them [force].

        >>> round(DMT(adhesion=0.01).pull_off_force(0.5, 0.5) / (2.0 * math.pi * 0.01 * 0.25), 12)
        1.0
        """
        return (
            2.0
            * math.pi
            * self.adhesion
            * float(effective_radius(positive("radius", radius), positive("other", other)))
        )

    def cap_force(self, distance: float, partners: Partners) -> float:
        """Return the normal force under Coulomb's cap beside the repulsion: -F + 2 F [force]."""
        return 2.0 * math.pi * self.adhesion * partners.effective_radius

    def interaction_energy(self, distance: float, partners: Partners, alignment: float) -> float:
        """Return the energy [energy]."""
        pull = 2.0 * math.pi * self.adhesion * partners.effective_radius
        last = 1.0 + self.cut
        lowest = 1.0 / (last * last)
        gap = (distance - partners.contact_distance) / self.separation
        at = 1.0 + max(gap, 0.0)
        beyond = (1.0 / at - 1.0 / last - lowest * (last - at)) / (1.0 - lowest)
        return pull * self.separation * (min(gap, 0.0) - beyond)

    def interaction_first(self, distance: float, partners: Partners, alignment: float) -> tuple[float, float]:
        """Return the slopes by distance [force] and alignment [energy]."""
        pull = 2.0 * math.pi * self.adhesion * partners.effective_radius
        lowest = 1.0 / ((1.0 + self.cut) * (1.0 + self.cut))
        at = 1.0 + max((distance - partners.contact_distance) / self.separation, 0.0)
        return pull * (1.0 / (at * at) - lowest) / (1.0 - lowest), 0.0

    def interaction_second(self, distance: float, partners: Partners, alignment: float) -> tuple[float, float, float]:
        """Return the second derivatives: by distance [force/length], both, alignment."""
        if distance < partners.contact_distance:
            return 0.0, 0.0, 0.0
        pull = 2.0 * math.pi * self.adhesion * partners.effective_radius
        lowest = 1.0 / ((1.0 + self.cut) * (1.0 + self.cut))
        at = 1.0 + (distance - partners.contact_distance) / self.separation
        return -2.0 * pull / (self.separation * at * at * at * (1.0 - lowest)), 0.0, 0.0


@device
def jkr_root(overlap: float) -> float:
    """Return the larger root x of x^4 - x = overlap, in units in which a contact of radius x^2 has this overlap.

    To rounding, without a division: by the polynomials of `_roots_of_pieces`. Where the bond breaks, and beyond, it is
    the value there. In the limit of Hertz, beyond the pieces, x = (overlap + overlap^(1/4))^(1/4).
    """
    depth = overlap + 0.75 * _BREAKS
    if depth <= 0.0:
        return _BREAKS
    place = np.float64(math.sqrt(depth) + _OFFSET)
    bits = place.view(np.int64)
    # unsigned, so that nan is out of range, too
    k = np.uint64((bits >> _PIECE_BITS) - _FIRST_PIECE)
    if k >= np.uint64(_OCTAVES * _PIECES):
        return math.sqrt(math.sqrt(overlap + math.sqrt(math.sqrt(overlap))))
    behind = np.int64(bits & _FRACTION)
    at = np.int64(behind | _ONE).view(np.float64)
    begin = np.int64((behind >> _PIECE_BITS << _PIECE_BITS) | _ONE).view(np.float64)
    t = 2.0 * _PIECES * (at - begin) - 1.0
    square = t * t
    low = _ROOTS[k, 0] + t * _ROOTS[k, 1] + square * (_ROOTS[k, 2] + t * _ROOTS[k, 3])
    high = _ROOTS[k, 4] + t * _ROOTS[k, 5] + square * (_ROOTS[k, 6] + t * _ROOTS[k, 7])
    return float(low + square * square * high)


@device
def jkr_square(modulus: float, adhesion: float, radius: float, before: float) -> float:
    """Return the square of the length that contact radii are x^2 of; the number before, where it is that one.

    A root of the third power takes as long as all else of a contact.
    """
    force = 2.0 * math.pi * adhesion * radius * radius
    left = modulus * modulus * before * before * before - force * force
    if abs(left) <= _SAME_CONTACT * force * force:
        return before
    cube = force / modulus
    return float(np.cbrt(cube * cube))


@effect
class JKR(NamedTuple):
    """Contacts of soft adhesive spheres: Johnson, Kendall and Roberts, Proc. R. Soc. A 324, 301 (1971).

    In place of a repulsion, which it contains: with no adhesion it were Hertz's. A circle of radius a joins the two,

        overlap = a^2/R - sqrt(2 pi w a/E),     F = 4 E a^3/(3 R) - sqrt(8 pi w E a^3),

    with the stable a, the larger one. Particles that touch are bound, and stay so up to a negative overlap of
    (3/4) (pi^2 w^2 R/E^2)^(1/3), where the bond breaks; whether a pair is bound is remembered (one number: 0 of a pair
    that is not, else (2 pi w R^2/E)^(2/3), which is found as the bond forms; any other number counts as bound).
    A bond is strongest before, at F = -(3/2) pi w R. As it forms the force jumps; what making and breaking of a bond
    takes, 7.09 (w^5 R^4/E^2)^(1/3), is lost (Thornton and Ning, Powder Technol. 99 (1998) 154).

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    modulus
        E, that of the contact: 1/E = (1 - nu_i^2)/E_i + (1 - nu_j^2)/E_j [energy/length^3].
    adhesion
        w, the work of adhesion per area [energy/length^2].

    Examples
    --------
    >>> contact = JKR(modulus=1.0, adhesion=0.01)
    >>> bound = contact.remember(0.99, Partners(1.0, 0.25), (0.0,))
    >>> at_touch = contact.interaction_first(1.0, Partners(1.0, 0.25), 1.0, bound)[0]
    >>> round(float(at_touch) / (1.5 * math.pi * 0.01 * 0.25), 6)  # 8/9 of the pull-off force
    0.888889

    """

    modulus: float = 1.0
    adhesion: float = 0.01

    contains_repulsion = True  # type: ignore[misc]
    memory = 1  # type: ignore[misc]
    begins_at_contact = True  # type: ignore[misc]
    force_jumps = True  # type: ignore[misc]

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        if not self.modulus > 0.0:
            return f"modulus must be positive, got {brief(self.modulus)}"
        return "" if self.adhesion > 0.0 else f"adhesion must be positive, got {brief(self.adhesion)}"

    def reach(self, partners: Partners) -> float:
        """Return the distance at which bonds break [length]."""
        radius = partners.effective_radius
        ratio = math.pi * self.adhesion / self.modulus
        return partners.contact_distance + 0.75 * float(np.cbrt(ratio * ratio * radius))

    def remember(self, distance: float, partners: Partners, memory: tuple[float]) -> tuple[float]:
        """Return the square of its length for a pair that is bound, else 0."""
        if distance >= partners.contact_distance and memory[0] == 0.0:
            return (0.0,)
        return (jkr_square(self.modulus, self.adhesion, partners.effective_radius, memory[0]),)

    def pull_off_force(self, radius: float, other: float) -> float:
        """Return the largest tension between particles of two radii, (3/2) pi w R: what parts them [force].

        >>> round(JKR(adhesion=0.01).pull_off_force(0.5, 0.5) / (1.5 * math.pi * 0.01 * 0.25), 12)
        1.0
        """
        return (
            1.5
            * math.pi
            * self.adhesion
            * float(effective_radius(positive("radius", radius), positive("other", other)))
        )

    def cap_force(self, distance: float, partners: Partners) -> float:
        """Return the normal force under Coulomb's cap: F and twice the pull-off force [force]."""
        radius = partners.effective_radius
        square = jkr_square(self.modulus, self.adhesion, radius, 0.0)
        x = jkr_root((partners.contact_distance - distance) * (radius / square))
        x3 = x * x * x
        return math.pi * self.adhesion * radius * (3.0 - 8.0 / 3.0 * x3 * (1.5 - x3))

    def interaction_energy(self, distance: float, partners: Partners, alignment: float, memory: tuple[float]) -> float:
        """Return the energy, 0 of spheres apart [energy]."""
        if memory[0] == 0.0:
            return 0.0
        radius = partners.effective_radius
        # a number that came with a packing may be any but 0
        square = jkr_square(self.modulus, self.adhesion, radius, memory[0])
        x = jkr_root((partners.contact_distance - distance) * (radius / square))
        x3 = x * x * x
        return 8.0 / 3.0 * math.pi * self.adhesion * square * x * x3 * (0.4 * x3 * x3 - x3 + 0.375)

    def interaction_first(
        self, distance: float, partners: Partners, alignment: float, memory: tuple[float]
    ) -> tuple[float, float]:
        """Return the slopes by distance [force] and alignment [energy]."""
        if memory[0] == 0.0:
            return 0.0, 0.0
        radius, square = partners.effective_radius, memory[0]
        x = jkr_root((partners.contact_distance - distance) * (radius / square))
        x3 = x * x * x
        return 8.0 / 3.0 * math.pi * self.adhesion * radius * x3 * (1.5 - x3), 0.0

    def interaction_second(
        self, distance: float, partners: Partners, alignment: float, memory: tuple[float]
    ) -> tuple[float, float, float]:
        """Return the second derivatives: by distance [force/length], both, alignment."""
        if memory[0] == 0.0:
            return 0.0, 0.0, 0.0
        radius, square = partners.effective_radius, memory[0]
        x = jkr_root((partners.contact_distance - distance) * (radius / square))
        steep = x * x * (6.0 * x * x * x - 4.5) / max(4.0 * x * x * x - 1.0, 1e-300)
        return 8.0 / 3.0 * math.pi * self.adhesion * radius * radius / square * steep, 0.0, 0.0


@effect
class CapillaryBridge(NamedTuple):
    """A bridge of liquid between touching spheres, beside a repulsion, that ruptures as they part.

    F = 2 pi r g cos(theta) (1 - h/sqrt(h^2 + 2 V/(pi r))) at a gap h of two spheres of radius r = 2 R, and its value at
    h = 0 where they touch: Rabinovich, Esayanur and Moudgil, Langmuir 21, 10992 (2005), equations 19 and 20, in closed
    form. It forms as they touch, and ruptures at a gap of (1 + theta/2) V^(1/3) (Lian, Thornton and Adams, J. Colloid
    Interface Sci. 161, 138 (1993)), where the force jumps to zero; whether there is one is remembered. Each bridge has
    the same volume.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    volume
        V, of the liquid of each bridge [length^3].
    surface_tension
        g [energy/length^2].
    contact_angle
        theta, from 0 to pi/2 [rad].

    Examples
    --------
    >>> wet = CapillaryBridge(volume=1e-3, surface_tension=0.01)
    >>> round(wet.reach(Partners(1.0, 0.25)), 12)
    1.1
    >>> round(wet.interaction_first(0.99, Partners(1.0, 0.25), 1.0, (1.0,))[0] / math.pi, 12)
    0.01

    """

    volume: float = 1e-4
    surface_tension: float = 0.01
    contact_angle: float = 0.0

    memory = 1  # type: ignore[misc]
    begins_at_contact = True  # type: ignore[misc]
    force_jumps = True  # type: ignore[misc]

    def fault(self) -> str:
        """Return what is wrong with the numbers; nothing is, where it is empty."""
        if not self.volume > 0.0:
            return f"volume must be positive, got {brief(self.volume)}"
        right = self.contact_angle < 0.5 * math.pi
        return "" if right else f"contact_angle must be below pi/2, got {brief(self.contact_angle)}"

    def reach(self, partners: Partners) -> float:
        """Return the distance at which bridges rupture [length]."""
        return partners.contact_distance + (1.0 + 0.5 * self.contact_angle) * math.pow(self.volume, 1.0 / 3.0)

    def remember(self, distance: float, partners: Partners, memory: tuple[float]) -> tuple[float]:
        """Return whether there is a bridge, 1 or 0."""
        return (1.0 if distance < partners.contact_distance else memory[0],)

    def cap_force(self, distance: float, partners: Partners) -> float:
        """Return the normal force under Coulomb's cap beside the repulsion: -F + 2 F [force]."""
        return 4.0 * math.pi * partners.effective_radius * self.surface_tension * math.cos(self.contact_angle)

    def interaction_energy(self, distance: float, partners: Partners, alignment: float, memory: tuple[float]) -> float:
        """Return the energy, so that it is 0 at the rupture [energy]."""
        if memory[0] == 0.0:
            return 0.0
        pull = 4.0 * math.pi * partners.effective_radius * self.surface_tension * math.cos(self.contact_angle)
        square = self.volume / (math.pi * partners.effective_radius)
        last = (1.0 + 0.5 * self.contact_angle) * math.pow(self.volume, 1.0 / 3.0)
        gap = distance - partners.contact_distance
        at = max(gap, 0.0)
        return pull * (gap - math.sqrt(at * at + square) - last + math.sqrt(last * last + square))

    def interaction_first(
        self, distance: float, partners: Partners, alignment: float, memory: tuple[float]
    ) -> tuple[float, float]:
        """Return the slopes by distance [force] and alignment [energy]."""
        if memory[0] == 0.0:
            return 0.0, 0.0
        pull = 4.0 * math.pi * partners.effective_radius * self.surface_tension * math.cos(self.contact_angle)
        square = self.volume / (math.pi * partners.effective_radius)
        gap = max(distance - partners.contact_distance, 0.0)
        return pull * (1.0 - gap / math.sqrt(gap * gap + square)), 0.0

    def interaction_second(
        self, distance: float, partners: Partners, alignment: float, memory: tuple[float]
    ) -> tuple[float, float, float]:
        """Return the second derivatives: by distance [force/length], both, alignment."""
        if memory[0] == 0.0 or distance < partners.contact_distance:
            return 0.0, 0.0, 0.0
        pull = 4.0 * math.pi * partners.effective_radius * self.surface_tension * math.cos(self.contact_angle)
        square = self.volume / (math.pi * partners.effective_radius)
        gap = distance - partners.contact_distance
        size = gap * gap + square
        return -pull * square / (size * math.sqrt(size)), 0.0, 0.0
