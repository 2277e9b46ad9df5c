"""Laws of repulsion: energy of a touching pair and its first two derivatives with respect to distance.

A law is a small record of numbers with three methods. Each is a scalar function of the distance r of two centers and
of their contact distance sigma, asked for only while r < sigma, and works both in plain Python and inside compiled
loops, which choose it by its type. One that names `partners` in place of `contact_distance` is given the effective
radius as well (`packmech.effects.partners`). A user's own law is written the same way::

    @pm.law
    class Quartic(NamedTuple):
        energy_scale: float = 1.0

        def energy(self, distance, contact_distance):
            return self.energy_scale * (1.0 - distance / contact_distance) ** 4 / 4.0

        def first(self, distance, contact_distance): ...

        def second(self, distance, contact_distance): ...
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeVar

from packmech.check import brief
from packmech.effects.derivatives import check_continuity, check_derivatives, default_record, may_jump
from packmech.effects.partners import Partners, argument_of, as_asked, asks_for_partners, equal_partners
from packmech.jit.compiled import compiled_form, compiled_methods, own_name, tell_apart
from packmech.jit.source_key import written_name


class Law(Protocol):
    """What every law offers; distances are [length], `energy_scale`, `stiffness` or `modulus` is a field.

    The second argument is the contact distance, or the `Partners` where a method names it so.
    """

    def energy(self, distance: float, contact_distance: Any, /) -> float:
        """Return the energy of a touching pair [energy]."""
        ...

    def first(self, distance: float, contact_distance: Any, /) -> float:
        """Return du/dr [energy/length]."""
        ...

    def second(self, distance: float, contact_distance: Any, /) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        ...


L = TypeVar("L", bound=type)

_METHODS = ("energy", "first", "second")
_COMPILED: dict[type, dict[str, Callable[..., float]]] = {}


def law(cls: L) -> L:
    """Return the class registered as a law that compiled loops can call.

    Parameters
    ----------
    cls
        A NamedTuple of numbers with the methods energy, first and second of (self, distance, contact_distance), or of
        (self, distance, partners) where the effective radius counts, too (`Partners`), and with a field `energy_scale`
        [energy], `stiffness` [energy/length^2] or `modulus` [energy/length^3] that sets the unit of energy, or a field
        `law` with another law that does, or `laws` with several, of which the largest does. A further method
        `fault(self)` may return what is wrong with the numbers, as "name must ..., got ...", for scenes to say; an
        empty text is none. Energy and force must go to zero at contact and be continuous below it, for what minimizers
        and time steps are sure of rests on that; a class whose force is meant to jump says so, `force_jumps = True`.

    Raises
    ------
    TypeError
        If the class is not such a NamedTuple; the message names what is missing.
    ValueError
        If `first` is not the derivative of `energy`, or `second` not that of `first`, or `energy` or `first` jumps at
        contact or below it: looked at by differences, with the numbers that stand where none are given; scenes look
        again with their own.

    Examples
    --------
    >>> @law
    ... class Cubic(NamedTuple):
    ...     energy_scale: float = 1.0
    ...     def energy(self, distance, contact_distance):
    ...         return self.energy_scale * (1.0 - distance / contact_distance) ** 3 / 3.0
    ...     def first(self, distance, contact_distance):
    ...         return -self.energy_scale * (1.0 - distance / contact_distance) ** 2 / contact_distance
    ...     def second(self, distance, contact_distance):
    ...         return 2.0 * self.energy_scale * (1.0 - distance / contact_distance) / contact_distance**2
    >>> round(Cubic().energy(0.5, 1.0), 12)
    0.041666666667

    """
    if not (isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")):
        raise TypeError(f"law must be a NamedTuple class, got {brief(cls)}")
    for name in _METHODS:
        method = vars(cls).get(name)
        if not inspect.isfunction(method):
            raise TypeError(
                f"law {cls.__name__} must define the method {name}(self, distance, contact_distance), got none"
            )
        if len(inspect.signature(method).parameters) != 3:
            raise TypeError(f"law {cls.__name__}.{name} must take (self, distance, contact_distance)")
    if not {"energy_scale", "stiffness", "modulus", "law", "laws"} & set(cls._fields):
        raise TypeError(f"law {cls.__name__} must have a field energy_scale, stiffness or modulus, got {cls._fields}")
    own_name("law", cls, _COMPILED)
    tell_apart(cls)
    example = default_record(cls)
    if example is not None:
        check_law(example)
    pair = (1.0, equal_partners(1.0))
    records: dict[str, tuple[Any, ...]] = {name: pair for name in _METHODS if asks_for_partners(cls, name)}
    _COMPILED[cls] = compiled_methods("law", cls, {name: vars(cls)[name] for name in _METHODS}, records)
    return cls


def check_law(law: Any) -> None:
    """Refuse a law whose derivatives, with its numbers, are not derivatives of each other, or jump."""
    what = f"law {written_name(type(law))}"
    hooks = (
        lambda distance, contact_distance: law_energy(law, distance, equal_partners(contact_distance)),
        lambda distance, contact_distance: law_first(law, distance, equal_partners(contact_distance)),
        lambda distance, contact_distance: law_second(law, distance, equal_partners(contact_distance)),
    )
    check_derivatives(what, _METHODS, hooks)
    if not may_jump(law):
        check_continuity(what, _METHODS, hooks)


def is_law(value: object) -> bool:
    """Return whether the value is an instance of a registered law."""
    return type(value) in _COMPILED


def registered_laws() -> tuple[type, ...]:
    """Return every registered law class, in the order of registration."""
    return tuple(_COMPILED)


def law_energy(law: Law, distance: float, partners: Partners) -> float:
    """Return the energy of a touching pair; compiled loops choose the law by its type."""
    return law.energy(distance, as_asked(law, "energy", partners))


def law_first(law: Law, distance: float, partners: Partners) -> float:
    """Return du/dr of a touching pair; compiled loops choose the law by its type."""
    return law.first(distance, as_asked(law, "first", partners))


def law_second(law: Law, distance: float, partners: Partners) -> float:
    """Return d2u/dr2 of a touching pair; compiled loops choose the law by its type."""
    return law.second(distance, as_asked(law, "second", partners))


def _chosen(numba_type: Any, name: str) -> Callable[..., float] | None:
    """Return what compiled code runs for a method of a law of this type; None where it is no law."""
    cls = getattr(numba_type, "instance_class", None)
    if cls not in _COMPILED:
        return None
    method, contact = _COMPILED[cls][name], argument_of(cls, name)
    return lambda law, distance, partners: method(law, distance, contact(partners))


@compiled_form(law_energy, inline=True)
def _law_energy(law: Any, distance: Any, partners: Any) -> Any:
    return _chosen(law, "energy")


@compiled_form(law_first, inline=True)
def _law_first(law: Any, distance: Any, partners: Any) -> Any:
    return _chosen(law, "first")


@compiled_form(law_second, inline=True)
def _law_second(law: Any, distance: Any, partners: Any) -> Any:
    return _chosen(law, "second")


@law
class PowerLaw(NamedTuple):
    """u = (energy_scale / exponent) xi^exponent with the relative overlap xi = 1 - r/sigma.

    Equation 2.1 of Schreck and O'Hern (2010); exponent 2 is harmonic, 5/2 Hertzian. Any exponent of at least 1.5 keeps
    forces continuous; below 2 the stiffness diverges as contacts open.

    Its numbers are checked when a `Scene` is made with it.
    """

    energy_scale: float = 1.0
    exponent: float = 2.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        overlap = (contact_distance - distance) / contact_distance
        return self.energy_scale / self.exponent * math.pow(overlap, self.exponent)

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        overlap = (contact_distance - distance) / contact_distance
        return -self.energy_scale / contact_distance * math.pow(overlap, self.exponent - 1.0)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        overlap = (contact_distance - distance) / contact_distance
        scale = self.energy_scale * (self.exponent - 1.0) / (contact_distance * contact_distance)
        return scale * math.pow(overlap, self.exponent - 2.0)


@law
class Harmonic(NamedTuple):
    """u = (energy_scale / 2) xi^2 with the relative overlap xi = 1 - r/sigma.

    Its numbers are checked when a `Scene` is made with it.
    """

    energy_scale: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        overlap = (contact_distance - distance) / contact_distance
        return 0.5 * self.energy_scale * overlap * overlap

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        # one division, and a difference that is exact near contact, however small the overlap
        inverse = 1.0 / contact_distance
        return -self.energy_scale * inverse * inverse * (contact_distance - distance)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        return self.energy_scale / (contact_distance * contact_distance)


@law
class Hertz(NamedTuple):
    """u = (2 energy_scale / 5) xi^(5/2) with the relative overlap xi = 1 - r/sigma.

    Its numbers are checked when a `Scene` is made with it.
    """

    energy_scale: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        overlap = (contact_distance - distance) / contact_distance
        return 0.4 * self.energy_scale * overlap * overlap * math.sqrt(overlap)

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        overlap = (contact_distance - distance) / contact_distance
        return -self.energy_scale / contact_distance * overlap * math.sqrt(overlap)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        overlap = (contact_distance - distance) / contact_distance
        return 1.5 * self.energy_scale / (contact_distance * contact_distance) * math.sqrt(overlap)


@law
class RepulsiveLennardJones(NamedTuple):
    """u = energy_scale (s^-12 - 2 s^-6 + 1) with s = r/sigma; value and slope vanish at s = 1.

    Equation 2.2 of Schreck and O'Hern (2010), evaluated through expm1(-6 ln s), which keeps full precision near
    contact.

    Its numbers are checked when a `Scene` is made with it.
    """

    energy_scale: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        change = math.expm1(-6.0 * math.log(distance / contact_distance))
        return self.energy_scale * change * change

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        s = distance / contact_distance
        change = math.expm1(-6.0 * math.log(s))
        return -12.0 * self.energy_scale * change / (s**7 * contact_distance)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        s = distance / contact_distance
        inverse2 = 1.0 / (s * s)
        inverse8 = inverse2 * inverse2 * inverse2 * inverse2
        inverse6 = inverse2 * inverse2 * inverse2
        scale = self.energy_scale / (contact_distance * contact_distance)
        return scale * inverse8 * (156.0 * inverse6 - 84.0)


@law
class LinearSpring(NamedTuple):
    """u = (stiffness / 2) (sigma - r)^2: a spring of the same stiffness [energy/length^2] for every pair of sizes.

    Its numbers are checked when a `Scene` is made with it.
    """

    stiffness: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy [energy]."""
        overlap = contact_distance - distance
        return 0.5 * self.stiffness * overlap * overlap

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr [energy/length]."""
        return -self.stiffness * (contact_distance - distance)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        return self.stiffness


@law
class ElasticSpheres(NamedTuple):
    """Hertz's contact of elastic spheres of any two sizes: u = (8/15) E sqrt(R) (sigma - r)^(5/2).

    R = r_i r_j / (r_i + r_j); the force is (4/3) E sqrt(R) overlap^(3/2) (Johnson, Contact Mechanics (1985), equation
    4.23). `Hertz` is the same for spheres of one size, with the energy_scale (4/3) E sqrt(radius/2) (2 radius)^(5/2);
    of several sizes it is the law that the literature on jamming takes: energies depend on the relative overlap alone.
    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    modulus
        E, that of the contact: 1/E = (1 - nu_i^2)/E_i + (1 - nu_j^2)/E_j [energy/length^3].

    Examples
    --------
    >>> round(-law_first(ElasticSpheres(3.0), 1.96, Partners(2.0, 0.25)), 12)  # 4 * 0.5 * 0.04**1.5
    0.016

    """

    modulus: float = 1.0

    def energy(self, distance: float, partners: Partners) -> float:
        """Return the energy [energy]."""
        overlap = partners.contact_distance - distance
        return 8.0 / 15.0 * self.modulus * math.sqrt(partners.effective_radius * overlap) * overlap * overlap

    def first(self, distance: float, partners: Partners) -> float:
        """Return du/dr [energy/length]."""
        overlap = partners.contact_distance - distance
        return -4.0 / 3.0 * self.modulus * math.sqrt(partners.effective_radius * overlap) * overlap

    def second(self, distance: float, partners: Partners) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        overlap = partners.contact_distance - distance
        return 2.0 * self.modulus * math.sqrt(partners.effective_radius * overlap)


def law_scale(law: Any, length: float) -> float:
    """Return the energy unit of a law: its energy_scale, stiffness * length^2, modulus * length^3, or that of its law.

    Parameters
    ----------
    law
        An instance of a registered law.
    length
        Reference diameter [length], used by laws with a stiffness or a modulus.

    """
    within = getattr(law, "law", None)
    if within is not None:
        return law_scale(within, length)
    if hasattr(law, "laws"):
        return max(law_scale(one, length) for one in law.laws)
    for name, power in (("energy_scale", 0), ("stiffness", 2)):
        if hasattr(law, name):
            return float(getattr(law, name)) * length**power
    return float(law.modulus) * length**3
