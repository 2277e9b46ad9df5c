"""Effects on touching pairs and `@pm.effect`, chosen by type: what a scene does not name is not compiled in.

An effect is a NamedTuple of numbers and laws whose class is decorated with `effect`, which says what it may define.
Compiled loops walk the scene's tuple of effects with `literal_unroll` and call the functions below.
"""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.calls.honors import EFFECTS
from packmech.check import brief
from packmech.effects.derivatives import (
    check_continuity,
    check_derivatives,
    check_interaction,
    default_record,
    may_jump,
)
from packmech.effects.partners import Partners, argument_of, as_asked, asks_for_partners, equal_partners
from packmech.jit.compiled import compiled_form, compiled_methods, kernel, own_name, tell_apart
from packmech.jit.source_key import written_name

E = TypeVar("E", bound=type)

_HOOKS = {
    "pair_energy": 3,
    "pair_first": 3,
    "pair_second": 3,
    "pair_damping": 2,
    "tangential_force": 3,
    "rolling_dashpot": 3,
    "cap_force": 3,
    "reach": 2,
    "interaction_energy": 4,
    "interaction_first": 4,
    "interaction_second": 4,
    "remember": 4,
    "body_force": 9,
    "body_energy": 6,
    "body_second": 6,
    "spin_drag": 1,
    "bath_rate": 1,
}
# hooks of packmech's own effects alone
_OWN = {
    "tangential_force": "friction is that of Friction alone",
    "rolling_dashpot": "resistance to rolling is that of ConstantRolling and ViscousRolling alone",
}
_INTERACTION = tuple(name for name in _HOOKS if name == "reach" or name.startswith("interaction"))
# those of the distance and the contact distance, or the partners
_OF_PAIRS = ("pair_energy", "pair_first", "pair_second", "cap_force")
_COMPILED: dict[type, dict[str, Callable[..., float]]] = {}
# the same of records that stand for effects inside loops
_INNER: dict[type, dict[str, Callable[..., float]]] = {}


# relative overlaps, rates and masses at which dashpots are asked for their coefficient
_OVERLAPS, _RATES, _MASSES = (0.0, 1e-9, 1e-3, 0.3), (-1.0, 1e-6), (0.3, 70.0)


class TouchingPair(NamedTuple):
    """What dashpots may depend on: how a pair touches and moves, and the sums over the effects with an energy.

    Attributes
    ----------
    distance, contact_distance, effective_radius
        Of ellipses, spheroids and beads as laws take them, the last as in `Partners` [length].
    rate
        d(distance)/dt, negative on approach [length/time].
    energy, first, second
        Energy of the contact and its derivatives by the distance [energy], [force], [force/length].
    mass
        Inertia of the pair against a change of the distance: m_i m_j / (m_i + m_j) of discs and spheres, that of the
        other where one is held [mass]. Shapes that are touched off center turn as well and count less. Rigid links are
        not counted. 0 where nothing can move.
    kinds
        Which pair of kinds of particles they are, as in `Partners`.

    """

    distance: float
    contact_distance: float
    rate: float
    energy: float
    first: float
    second: float
    mass: float
    effective_radius: float
    kinds: int = 0


def effect(cls: E) -> E:
    """Return the class registered as an effect that compiled loops can call.

    Parameters
    ----------
    cls
        A NamedTuple class that defines at least one of these methods; what it leaves out is zero.

        =====================================================  =========================================================
        method, after self                                     what it returns
        =====================================================  =========================================================
        pair_energy(distance, contact_distance)                energy of a touching pair [energy]
        pair_first(distance, contact_distance)                 its radial derivative [force], minus the force on j along
                                                               n
        pair_second(distance, contact_distance)                its second radial derivative [force/length]
        pair_damping(pair)                                     coefficient c >= 0 of a dashpot, whose force on j along n
                                                               is -c d(distance)/dt [mass/time]; pair is a
                                                               `TouchingPair`
        cap_force(distance, contact_distance)                  what it adds to the normal force of the repulsion that
                                                               Coulomb's limit is made of [force]: of cohesion, its
                                                               own force and twice the pull-off force
        body_energy(x, y, z, mass, radius)                     energy of a single particle [energy]
        body_force(x, y, z, u, v, w, mass, radius)             the three components of the force on it [force]; (u, v,
                                                               w) is its peculiar velocity
        body_second(x, y, z, mass, radius)                     second derivatives xx, yy, zz, yz, xz, xy of its energy
        spin_drag()                                            rate at which spins relax to the flow's [1/time]
        reach(contact_distance), interaction_energy(distance,  forces between centers, of a range of their own, and
        contact_distance, alignment), interaction_first,       torques between directions; these, and `remember` with
        interaction_second                                     `memory = 1`, the numbers that a class keeps of each
                                                               pair, and `begins_at_contact = True`, are described in
                                                               `packmech.effects.interaction`
        =====================================================  =========================================================

        Those of pairs are asked for distances below contact. A hook that names a parameter `partners` where these have
        `contact_distance` is given the effective radius of the two as well (`Partners`). (x, y, z) is the place in the
        cell: an energy that differs at opposite faces jumps where a particle crosses one. A class whose force is meant
        to jump at contact says so, `force_jumps = True`; others must go to zero there.

    Raises
    ------
    TypeError
        If it is not, or if a hook takes the wrong number of arguments.
    ValueError
        If `pair_first` is not the derivative of `pair_energy`, or `pair_second` not that of `pair_first`: looked at by
        differences, with the numbers that stand where none are given; scenes look again with their own. If one of the
        first two jumps at contact, or below it, and the class does not say so. Or if a dashpot drives.

    Examples
    --------
    >>> @effect
    ... class Quartic(NamedTuple):
    ...     strength: float = 1.0
    ...     def pair_energy(self, distance, contact_distance):
    ...         return self.strength * (1.0 - distance / contact_distance) ** 4
    ...     def pair_first(self, distance, contact_distance):
    ...         return -4.0 * self.strength * (1.0 - distance / contact_distance) ** 3 / contact_distance
    ...     def pair_second(self, distance, contact_distance):
    ...         return 12.0 * self.strength * (1.0 - distance / contact_distance) ** 2 / contact_distance**2
    >>> terms = contact_terms((Quartic(2.0),), equal_touches(np.array([0.5]), np.array([1.0])))
    >>> terms.energy_c.tolist(), terms.first_c.tolist()
    ([0.125], [-1.0])

    """
    if not (isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")):
        raise TypeError(f"effect must be a NamedTuple class, got {brief(cls)}")
    hooks = {name: vars(cls)[name] for name in _HOOKS if inspect.isfunction(vars(cls).get(name))}
    if not hooks:
        raise TypeError(f"effect {cls.__name__} must define at least one of {', '.join(_HOOKS)}")
    missing = [name for name in _INTERACTION if name not in hooks]
    if missing and len(missing) < len(_INTERACTION):
        raise TypeError(f"effect {cls.__name__} must define {', '.join(missing)}, too, where it acts within a reach")
    memory = _memory_of(cls, hooks)
    for name, function in hooks.items():
        count = _HOOKS[name] + (bool(memory) and name.startswith("interaction"))
        if len(inspect.signature(function).parameters) != count:
            raise TypeError(f"effect {cls.__name__}.{name} must take {count} arguments, self included")
    for name, why in _OWN.items():
        if name in hooks and not cls.__module__.startswith("packmech."):
            raise TypeError(f"effect {cls.__name__} must not define {name}: {why}")
    said = getattr(cls, "acts_as", EFFECTS[0])
    if said not in EFFECTS:
        raise ValueError(f"effect {cls.__name__}.acts_as must be one of {', '.join(EFFECTS)}, got {brief(said)}")
    own_name("effect", cls, _COMPILED)
    tell_apart(cls)
    example = default_record(cls)
    if example is not None:
        check_effect(example)
    records: dict[str, tuple[Any, ...]] = {"pair_damping": (TouchingPair(0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 0),)}
    numbers = ((0.0,) * memory,) if memory else ()
    for name in hooks:
        pair: tuple[Any, ...] = (equal_partners(1.0) if asks_for_partners(cls, name) else 1.0,)
        if name in _OF_PAIRS:
            records[name] = (1.0, *pair)
        elif name == "reach":
            records[name] = pair
        elif name == "remember":
            records[name] = (1.0, *pair, *numbers)
        elif name in _INTERACTION:
            records[name] = (1.0, *pair, 1.0, *numbers)
    _COMPILED[cls] = compiled_methods("effect", cls, hooks, records)
    return cls


def _memory_of(cls: type, hooks: dict[str, Any]) -> int:
    """Return how many numbers a class keeps of each pair, and refuse what says so without keeping any."""
    memory = getattr(cls, "memory", 0)
    if "memory" in getattr(cls, "_fields", ()) or isinstance(memory, bool) or not isinstance(memory, int) or memory < 0:
        raise TypeError(
            f"effect {cls.__name__}.memory must be how many numbers it keeps of each pair, got {brief(memory)}"
        )
    if bool(memory) != ("remember" in hooks) or (memory and "reach" not in hooks):
        raise TypeError(
            f"effect {cls.__name__} must have memory = (how many numbers it keeps of each pair), remember(distance, "
            "contact_distance, memory) and the hooks of an interaction, or none of the first two"
        )
    begins = getattr(cls, "begins_at_contact", False)
    if not isinstance(begins, bool) or (begins and not memory) or "begins_at_contact" in getattr(cls, "_fields", ()):
        raise TypeError(
            f"effect {cls.__name__}.begins_at_contact must be True or False for the whole class, and False where it "
            f"has no memory, got {brief(begins)}"
        )
    return memory


def check_effect(effect: Any) -> None:
    """Refuse an effect whose hooks for pairs are not derivatives of each other, or jump, or whose dashpot drives.

    A hook that it lacks is zero.
    """
    hooks = (
        lambda distance, contact_distance: pair_energy(effect, distance, equal_partners(contact_distance)),
        lambda distance, contact_distance: pair_first(effect, distance, equal_partners(contact_distance)),
        lambda distance, contact_distance: pair_second(effect, distance, equal_partners(contact_distance)),
    )
    what, names = f"effect {written_name(type(effect))}", ("pair_energy", "pair_first", "pair_second")
    check_derivatives(what, names, hooks)
    if not may_jump(effect):
        check_continuity(what, names, hooks)
    if hasattr(type(effect), "interaction_energy"):
        check_interaction(what, effect)
    if damps(effect):
        _check_damping(what, effect)


def _check_damping(what: str, effect: Any) -> None:
    """Refuse a dashpot that pushes along the motion, or is no number, under a spring of stiffness 1."""
    for overlap, rate, mass in itertools.product(_OVERLAPS, _RATES, _MASSES):
        pair = TouchingPair(1.0 - overlap, 1.0, rate, 0.5 * overlap**2, -overlap, 1.0, mass, 0.25)
        try:
            found = pair_damping(effect, pair)
        except ArithmeticError:
            # of what just touches the energy and the force are 0
            found = math.nan
        if not 0.0 <= found < math.inf:
            raise ValueError(f"{what}.pair_damping must be finite and not negative, got {brief(found)} for {pair}")


def bound_effect(cls: E) -> E:
    """Return a class of effects that hold arrays of their own, registered so that scenes take them.

    Loops do not walk such an effect with the others: what it does is written out where it acts.
    """
    _COMPILED[cls] = {}
    return cls


def inner_record(cls: E) -> E:
    """Return a record class with hooks of single particles, arrays among its fields: used in compiled loops.

    It stands for an effect that holds arrays of its own, and is none of a scene itself.
    """
    hooks = {name: vars(cls)[name] for name in _HOOKS if inspect.isfunction(vars(cls).get(name))}
    tell_apart(cls)
    _INNER[cls] = compiled_methods("effect", cls, hooks)
    return cls


def plain_record(record: Any) -> Any:
    """Return the record with every number a float, so that one combination of effects compiles once."""
    values = (
        plain_record(value) if isinstance(value, tuple) else None if value is None else float(value) for value in record
    )
    return type(record)(*values) if hasattr(record, "_fields") else tuple(values)


def is_bound(value: object) -> bool:
    """Return whether the value is an effect with arrays of its own."""
    return is_effect(value) and not isinstance(value, tuple)


def is_effect(value: object) -> bool:
    """Return whether the value is an instance of a registered effect."""
    return type(value) in _COMPILED


def registered_effects() -> tuple[type, ...]:
    """Return every registered effect class, in the order of registration."""
    return tuple(_COMPILED)


def pair_energy(effect: Any, distance: float, partners: Partners) -> float:
    """Return the energy of a touching pair under one effect [energy]."""
    hook = getattr(effect, "pair_energy", None)
    return 0.0 if hook is None else hook(distance, as_asked(effect, "pair_energy", partners))


def pair_first(effect: Any, distance: float, partners: Partners) -> float:
    """Return the radial derivative of the energy of a touching pair under one effect [force]."""
    hook = getattr(effect, "pair_first", None)
    return 0.0 if hook is None else hook(distance, as_asked(effect, "pair_first", partners))


def pair_second(effect: Any, distance: float, partners: Partners) -> float:
    """Return the second radial derivative of a touching pair under one effect [force/length]."""
    hook = getattr(effect, "pair_second", None)
    return 0.0 if hook is None else hook(distance, as_asked(effect, "pair_second", partners))


def pair_damping(effect: Any, pair: TouchingPair) -> float:
    """Return the coefficient of the dashpot of a touching pair under one effect [mass/time]."""
    hook = getattr(effect, "pair_damping", None)
    return 0.0 if hook is None else hook(pair)


def cap_force(effect: Any, distance: float, partners: Partners) -> float:
    """Return what one effect adds to the normal force of Coulomb's limit [force]."""
    hook = getattr(effect, "cap_force", None)
    return 0.0 if hook is None else hook(distance, as_asked(effect, "cap_force", partners))


def damps(effect: Any) -> bool:
    """Return whether an effect, its class, or numba's type of one, puts dashpots between touching pairs."""
    return hasattr(getattr(effect, "instance_class", effect), "pair_damping")


def hook_of(numba_type: Any, name: str) -> Callable[..., Any] | None:
    """Return the compiled hook of an effect's numba type, or None where it has none."""
    cls: Any = getattr(numba_type, "instance_class", None)
    return (_COMPILED.get(cls) or _INNER.get(cls, {})).get(name)


def _hook_at(effect: Any, name: str) -> Callable[..., float]:
    """Return what compiled code runs for a hook of touching pairs of an effect of this type; zero without one."""
    function = hook_of(effect, name)
    if function is None:
        return lambda effect, distance, partners: 0.0
    contact = argument_of(effect.instance_class, name)
    return lambda effect, distance, partners: function(effect, distance, contact(partners))


@compiled_form(pair_energy, inline=True)
def _pair_energy(effect: Any, distance: Any, partners: Any) -> Any:
    return _hook_at(effect, "pair_energy")


@compiled_form(pair_first, inline=True)
def _pair_first(effect: Any, distance: Any, partners: Any) -> Any:
    return _hook_at(effect, "pair_first")


@compiled_form(pair_second, inline=True)
def _pair_second(effect: Any, distance: Any, partners: Any) -> Any:
    return _hook_at(effect, "pair_second")


@compiled_form(cap_force, inline=True)
def _cap_force(effect: Any, distance: Any, partners: Any) -> Any:
    return _hook_at(effect, "cap_force")


@compiled_form(pair_damping)
def _pair_damping(effect: Any, pair: Any) -> Any:
    function = hook_of(effect, "pair_damping")
    if function is None:
        return lambda effect, pair: 0.0
    return function


def at_overlap(effects: Sequence[Any], overlap: float, partners: Partners, mass: float) -> TouchingPair:
    """Return a pair that touches and hardly moves, under effects walked in plain Python.

    Parameters
    ----------
    effects
        Effects of pairs, none with arrays of their own.
    overlap
        Relative overlap, 1 - distance / contact distance [1].
    partners
        The two particles.
    mass
        As of a `TouchingPair`.

    """
    distance = (1.0 - overlap) * partners.contact_distance
    energy, first, second = (
        float(sum(part(one, distance, partners) for one in effects)) for part in (pair_energy, pair_first, pair_second)
    )
    return TouchingPair(
        distance, partners.contact_distance, 0.0, energy, first, second, mass, partners.effective_radius, partners.kinds
    )


class Touches(Protocol):
    """Contacts, as laws are asked for them: their (C,) distances, contact distances, effective radii and kinds."""

    @property
    def distance_c(self) -> NDArray[np.float64]:
        """Distances of the centers, or those at which laws are taken [length]."""
        ...

    @property
    def contact_distance_c(self) -> NDArray[np.float64]:
        """Distances at which they would just touch [length]."""
        ...

    @property
    def effective_radius_c(self) -> NDArray[np.float64]:
        """Effective radii, as in `Partners` [length]."""
        ...

    @property
    def kinds_c(self) -> NDArray[np.int64]:
        """Pairs of kinds, as in `Partners`."""
        ...


class ContactLengths(NamedTuple):
    """The (C,) distances, contact distances and effective radii of contacts [length], their kinds, and no more."""

    distance_c: NDArray[np.float64]
    contact_distance_c: NDArray[np.float64]
    effective_radius_c: NDArray[np.float64]
    kinds_c: NDArray[np.int64]


def at_distances(touches: Touches, distance_c: NDArray[np.float64]) -> ContactLengths:
    """Return the contacts at other distances."""
    return ContactLengths(distance_c, touches.contact_distance_c, touches.effective_radius_c, touches.kinds_c)


def equal_touches(distance_c: NDArray[np.float64], contact_distance_c: NDArray[np.float64]) -> ContactLengths:
    """Return contacts of particles of one size and of kind 0, or with a mirror image.

    Effective radii are a quarter of the contact distances.
    """
    kinds = np.zeros(len(contact_distance_c), dtype=np.int64)
    return ContactLengths(distance_c, contact_distance_c, 0.25 * contact_distance_c, kinds)


class ContactTerms(NamedTuple):
    """Energy and radial derivatives of each contact, summed over the effects; zero where not touching."""

    energy_c: NDArray[np.float64]
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]


@kernel
def _contact_terms(  # type: ignore[no-untyped-def]
    effects, distance_c, contact_distance_c, effective_radius_c, kinds_c, touching_c, energy_c, first_c, second_c
):
    for c in range(distance_c.shape[0]):
        if touching_c[c]:
            r = distance_c[c]
            partners = Partners(contact_distance_c[c], effective_radius_c[c], kinds_c[c])
            energy = 0.0
            first = 0.0
            second = 0.0
            for one in literal_unroll(effects):
                energy += pair_energy(one, r, partners)
                first += pair_first(one, r, partners)
                second += pair_second(one, r, partners)
            energy_c[c] = energy
            first_c[c] = first
            second_c[c] = second


@kernel
def _cap_forces(effects, distance_c, contact_distance_c, effective_radius_c, kinds_c, cap_c):  # type: ignore[no-untyped-def]
    for c in range(distance_c.shape[0]):
        partners = Partners(contact_distance_c[c], effective_radius_c[c], kinds_c[c])
        for one in literal_unroll(effects):
            cap_c[c] += cap_force(one, distance_c[c], partners)


def under_cap(effects: tuple[Any, ...], normal_c: NDArray[np.float64], touches: Touches) -> NDArray[np.float64]:
    """Return the (C,) normal forces that Coulomb's limit is made of: those given, and what cohesion adds.

    Parameters
    ----------
    effects
        The scene's effects.
    normal_c
        (C,) normal forces of the repulsion, whose sizes count [force].
    touches
        The contacts.

    """
    acting = tuple(one for one in effects if hasattr(type(one), "cap_force"))
    cap = np.abs(normal_c)
    if not acting:
        return cap
    _cap_forces(acting, *_columns(touches), cap)
    return np.asarray(np.maximum(cap, 0.0))


def _columns(touches: Touches) -> ContactLengths:
    """Return distances, contact distances, effective radii and kinds, each one behind the other in memory."""
    columns = touches.distance_c, touches.contact_distance_c, touches.effective_radius_c
    distance, sigma, radius = (np.ascontiguousarray(column, dtype=np.float64) for column in columns)
    return ContactLengths(distance, sigma, radius, np.ascontiguousarray(touches.kinds_c, dtype=np.int64))


def contact_terms(effects: tuple[Any, ...], touches: Touches, *, closing: bool = False) -> ContactTerms:
    """Return energy, du/dr and d2u/dr2 of each contact, summed over the effects.

    Parameters
    ----------
    effects
        The scene's effects.
    touches
        The contacts, or their (C,) distances, contact distances, effective radii and kinds: `ContactLengths`.
    closing
        Give pairs that just touch, or are open, the derivatives of the closed side at contact (distance = contact
        distance). A lattice at its jamming point has the stiffness V''(1-) this way.

    Examples
    --------
    >>> import packmech as pm
    >>> effects = (pm.Repulsion(law=pm.Harmonic()),)
    >>> touches = equal_touches(np.array([0.8, 1.2]), np.array([1.0, 1.0]))
    >>> contact_terms(effects, touches).second_c.tolist()
    [1.0, 0.0]

    """
    distance, sigma, radius, kinds = _columns(touches)
    touching = distance < sigma
    if closing:
        distance = np.minimum(distance, sigma)
        touching = np.ones_like(touching)
    energy, first, second = (np.zeros_like(distance) for _ in range(3))
    acting = tuple(one for one in effects if not is_bound(one))
    if acting:
        _contact_terms(acting, distance, sigma, radius, kinds, touching, energy, first, second)
    return ContactTerms(energy, first, second)
