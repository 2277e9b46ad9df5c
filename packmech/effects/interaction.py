"""Interactions: forces between centers, of a range of their own, and torques between directions.

An effect (`packmech.effects.pair.effect`) is one where it defines

    reach(self, contact_distance)                           distance beyond which it is zero [length]
    interaction_energy(self, distance, contact_distance, alignment)    energy of a pair [energy]
    interaction_first(self, distance, contact_distance, alignment)     its derivatives by the distance [force] and by
                                                                       the alignment [energy]
    interaction_second(self, distance, contact_distance, alignment)    second derivatives by the distance, by both, by
                                                                       the alignment

for distances of centers below its reach, whether the particles touch or not. The alignment of a pair is the cosine of
the angle between its directions: the directors of ellipses and spheroids, the first axes of rigid bodies. Discs and
spheres have none: theirs is 1, and nothing turns them. A hook that names a parameter `partners` where these have
`contact_distance` is given the effective radius of the two as well (`packmech.effects.partners`). What an interaction
does is an element like a contact (`packmech.contacts.elements`), with the slopes of the distance and of the alignment.

An interaction of discs and spheres may remember what happened to a pair. Its class says how many numbers it keeps of
each, `memory = 1`, and defines

    remember(self, distance, contact_distance, memory)      the numbers (a tuple) at this distance, from those before

It reaches as far as contact at least: `reach` is not asked where particles touch. Where its class says
`begins_at_contact = True` there is nothing to remember, and no force, of a pair apart that holds zeros: it is not asked
of such a pair, which is faster.
The hooks above, all but `reach`, then take the numbers as their last argument. They are 0 for pairs that come within
reach, and again beyond it. Time steps ask for new ones before each force, at rest they are those that the packing holds
(`TangentialDisplacements.memory_ck`), or zeros, brought to the distance of the pair: what was remembered once is
remembered the same when asked for again at the same distance. Derivatives are those at fixed numbers.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from packmech.check import brief
from packmech.contacts.elements import Elements
from packmech.contacts.excluded import Excluded
from packmech.contacts.network import Candidates, Contacts, candidate_pairs, pair_contacts
from packmech.effects.bonds import acting_contacts, bonds_of
from packmech.effects.kinds import bounding_partners
from packmech.effects.laws import law_energy, law_first, law_second
from packmech.effects.pair import hook_of
from packmech.effects.partners import Partners, argument_of, as_asked, equal_partners, feels_curvature
from packmech.jit.compiled import compiled_form, device, kernel
from packmech.jit.source_key import written_name
from packmech.links import named_rows
from packmech.packing import Packing


class PairLaw(NamedTuple):
    """Energy of a pair, its derivatives by distance and alignment, and second ones by the two, both, and the second."""

    energy: float
    first: float
    turning: float
    second: float
    mixed: float
    bending: float


def is_interaction(effect: Any) -> bool:
    """Return whether an effect, or numba's type of one, acts between centers within a reach of its own."""
    cls = getattr(effect, "instance_class", type(effect))
    return hasattr(cls, "reach") and hasattr(cls, "interaction_energy")


def interactions_of(effects: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the interactions among the effects."""
    return tuple(one for one in effects if is_interaction(one))


def memory_size(effect: Any) -> int:
    """Return how many numbers an effect, its class, or that of numba's type of one, keeps of each pair."""
    return int(getattr(getattr(effect, "instance_class", effect), "memory", 0))


@compiled_form(memory_size, inline=True)
def _choose_memory_size(effect: Any) -> Any:
    size = memory_size(effect)
    return lambda effect: size


def remembers(effect: Any) -> bool:
    """Return whether an effect, or numba's type of one, keeps numbers of pairs."""
    return memory_size(effect) > 0


def begins_at_contact(effect: Any) -> bool:
    """Return whether an effect, or numba's type of one, keeps zeros of pairs until they touch, and is zero for them."""
    return bool(getattr(getattr(effect, "instance_class", effect), "begins_at_contact", False))


def memory_columns(effects: tuple[Any, ...]) -> int:
    """Return how many numbers all effects together keep of each pair."""
    return sum(memory_size(one) for one in effects if is_interaction(one))


def refuse_curvature_of_shapes(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse effects that feel effective radii where shapes have none: of ellipses, spheroids, and bodies' centers.

    Beads that touch have theirs, as discs and spheres do. What remembers is `refuse_memory_of_shapes`'s to refuse.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    shapes = packing.shapes
    for k, one in enumerate(effects if shapes.has_orientations else ()):
        if not feels_curvature(one) or remembers(one):
            continue
        way = f"leave it out with scene.without(pm.{written_name(type(one))})"
        if is_interaction(one):
            raise ValueError(
                f"effects must hold no {written_name(type(one))} for {shapes.names[1]}, as it acts between surfaces of "
                f"discs or spheres about the centers, got {brief(one)} at {k}: {way}"
            )
        if not shapes.has_beads:
            raise ValueError(
                f"effects must hold nothing that asks for effective radii for {shapes.names[1]}, whose curvature "
                f"differs from place to place, got {brief(one)} at {k}: take a law of distances alone, such as "
                f"pm.Hertz, or {way}"
            )


def refuse_memory_of_shapes(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse interactions that remember of particles with shapes: they act between discs and spheres.

    Raises
    ------
    ValueError
        Naming the effect.

    """
    for k, one in enumerate(effects):
        if remembers(one) and packing.shapes.has_orientations:
            raise ValueError(
                f"scene.effects must hold no {type(one).__qualname__} for {type(packing.shapes).__name__}: what "
                f"remembers acts between discs and spheres, got it at {k}"
            )


def memory_at(effect: Any, number_pk: Any, p: int, column: int) -> tuple[float, ...]:
    """Return the numbers that one effect keeps of a pair, a tuple, from the row p of an array from a column on."""
    return tuple(float(number_pk[p, column + k]) for k in range(memory_size(effect)))


def _reader(size: int) -> Any:
    """Return a compiled function that reads so many numbers into a tuple."""
    if size == 0:
        return device(lambda number_pk, p, column: ())
    before, last = _reader(size - 1), size - 1
    return device(lambda number_pk, p, column: (*before(number_pk, p, column), number_pk[p, column + last]))


@compiled_form(memory_at, inline=True)
def _choose_memory_at(effect: Any, number_pk: Any, p: Any, column: Any) -> Any:
    read, size = _readers(memory_size(effect)), memory_size(effect)
    if size == 0:
        return lambda effect, number_pk, p, column: ()
    return lambda effect, number_pk, p, column: read(number_pk, p, column)


_readers = functools.lru_cache(_reader)


def reach_of(effect: Any, partners: Partners) -> float:
    """Return the distance from which on an interaction is zero [length]."""
    return float(effect.reach(as_asked(effect, "reach", partners)))


def remembered(effect: Any, distance: float, partners: Partners, memory: tuple[float, ...]) -> tuple[float, ...]:
    """Return the numbers that one effect keeps of a pair at this distance; zeros from its reach on."""
    if not remembers(effect):
        return ()
    apart = (
        distance >= partners.contact_distance and begins_at_contact(effect) and memory == (0.0,) * memory_size(effect)
    )
    if apart or distance >= reach_of(effect, partners):
        return (0.0,) * memory_size(effect)
    return tuple(effect.remember(distance, as_asked(effect, "remember", partners), memory))


@compiled_form(remembered)
def _choose_remembered(effect: Any, distance: Any, partners: Any, memory: Any) -> Any:
    if not remembers(effect):
        return lambda effect, distance, partners, memory: ()
    reach, hook, nothing = hook_of(effect, "reach"), hook_of(effect, "remember"), (0.0,) * memory_size(effect)
    assert reach is not None and hook is not None
    at_reach, at_hook = (argument_of(effect.instance_class, name) for name in ("reach", "remember"))
    at_contact = begins_at_contact(effect)

    def numbers(effect, distance, partners, memory):  # type: ignore[no-untyped-def]
        if distance >= partners.contact_distance:
            if at_contact and memory == nothing:
                return nothing
            if distance >= reach(effect, at_reach(partners)):
                return nothing
        return hook(effect, distance, at_hook(partners), memory)

    return numbers


def remembered_energy(effect: Any, distance: float, partners: Partners, memory: tuple[float, ...]) -> float:
    """Return the energy of a pair with the numbers kept of it, beyond its reach that at it; 0 where none are kept."""
    if not remembers(effect):
        return 0.0
    at = min(distance, reach_of(effect, partners))
    return float(effect.interaction_energy(at, as_asked(effect, "interaction_energy", partners), 1.0, memory))


@compiled_form(remembered_energy)
def _choose_remembered_energy(effect: Any, distance: Any, partners: Any, memory: Any) -> Any:
    if not remembers(effect):
        return lambda effect, distance, partners, memory: 0.0
    reach, hook = hook_of(effect, "reach"), hook_of(effect, "interaction_energy")
    assert reach is not None and hook is not None
    at_reach, at_hook = (
        argument_of(effect.instance_class, "reach"),
        argument_of(effect.instance_class, "interaction_energy"),
    )

    def energy(effect, distance, partners, memory):  # type: ignore[no-untyped-def]
        return hook(effect, min(distance, reach(effect, at_reach(partners))), at_hook(partners), 1.0, memory)

    return energy


def bring_memory(effect: Any, distance: float, partners: Partners, number_pk: Any, p: int, column: int) -> None:
    """Bring the numbers that one effect keeps of a pair, in the row p from a column on, to this distance."""
    for k, one in enumerate(remembered(effect, distance, partners, memory_at(effect, number_pk, p, column))):
        number_pk[p, column + k] = one


@compiled_form(bring_memory, inline=True)
def _choose_bring_memory(effect: Any, distance: Any, partners: Any, number_pk: Any, p: Any, column: Any) -> Any:
    size = memory_size(effect)
    if size == 0:
        return lambda effect, distance, partners, number_pk, p, column: None

    def bring(effect, distance, partners, number_pk, p, column):  # type: ignore[no-untyped-def]
        now = remembered(effect, distance, partners, memory_at(effect, number_pk, p, column))
        for k in range(size):
            number_pk[p, column + k] = now[k]

    return bring


def interaction_law(effect: Any, distance: float, partners: Partners, alignment: float) -> PairLaw:
    """Return the law of a pair under one effect: zero beyond its reach, and under an effect that is no interaction.

    One that remembers has the numbers of a pair that came to this distance from afar.
    """
    nothing = (0.0,) * memory_size(effect)
    numbers = remembered(effect, distance, partners, nothing) if is_interaction(effect) else nothing
    return remembering_law(effect, distance, partners, alignment, numbers)


def remembering_law(
    effect: Any, distance: float, partners: Partners, alignment: float, memory: tuple[float, ...]
) -> PairLaw:
    """Return the same with the numbers that the effect keeps of the pair."""
    if not is_interaction(effect) or distance >= reach_of(effect, partners):
        return PairLaw(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    numbers = (memory,) if remembers(effect) else ()
    energy, firsts, seconds = (
        getattr(effect, name)(distance, as_asked(effect, name, partners), alignment, *numbers)
        for name in ("interaction_energy", "interaction_first", "interaction_second")
    )
    return PairLaw(energy, *firsts, *seconds)


@compiled_form(interaction_law)
def _choose_interaction_law(effect: Any, distance: Any, partners: Any, alignment: Any) -> Any:
    if not is_interaction(effect):
        return lambda effect, distance, partners, alignment: PairLaw(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if remembers(effect):
        # compiled in minimizers and batches, which refuse these effects by name
        return lambda effect, distance, partners, alignment: PairLaw(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    (reach, at_reach), (energy, at_energy), (firsts, at_first), (seconds, at_second) = (
        (hook_of(effect, name), argument_of(effect.instance_class, name))
        for name in ("reach", "interaction_energy", "interaction_first", "interaction_second")
    )

    assert reach is not None and energy is not None and firsts is not None and seconds is not None

    def law(effect, distance, partners, alignment):  # type: ignore[no-untyped-def]
        if distance >= reach(effect, at_reach(partners)):
            return PairLaw(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        first, turning = firsts(effect, distance, at_first(partners), alignment)
        second, mixed, bending = seconds(effect, distance, at_second(partners), alignment)
        whole = energy(effect, distance, at_energy(partners), alignment)
        return PairLaw(whole, first, turning, second, mixed, bending)

    return law


@compiled_form(remembering_law)
def _choose_remembering_law(effect: Any, distance: Any, partners: Any, alignment: Any, memory: Any) -> Any:
    if not remembers(effect) or not is_interaction(effect):
        return lambda effect, distance, partners, alignment, memory: interaction_law(
            effect, distance, partners, alignment
        )
    (reach, at_reach), (energy, at_energy), (firsts, at_first), (seconds, at_second) = (
        (hook_of(effect, name), argument_of(effect.instance_class, name))
        for name in ("reach", "interaction_energy", "interaction_first", "interaction_second")
    )
    assert reach is not None and energy is not None and firsts is not None and seconds is not None

    def law(effect, distance, partners, alignment, memory):  # type: ignore[no-untyped-def]
        if distance >= reach(effect, at_reach(partners)):
            return PairLaw(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        first, turning = firsts(effect, distance, at_first(partners), alignment, memory)
        second, mixed, bending = seconds(effect, distance, at_second(partners), alignment, memory)
        whole = energy(effect, distance, at_energy(partners), alignment, memory)
        return PairLaw(whole, first, turning, second, mixed, bending)

    return law


def remembering_slope(
    effect: Any, distance: float, partners: Partners, alignment: float, memory: tuple[float, ...]
) -> float:
    """Return the derivative by distance alone, which is all that forces between discs and spheres ask for."""
    return remembering_law(effect, distance, partners, alignment, memory).first


@compiled_form(remembering_slope)
def _choose_remembering_slope(effect: Any, distance: Any, partners: Any, alignment: Any, memory: Any) -> Any:
    if not is_interaction(effect):
        return lambda effect, distance, partners, alignment, memory: 0.0
    reach, firsts = hook_of(effect, "reach"), hook_of(effect, "interaction_first")
    assert reach is not None and firsts is not None
    at_reach, at_first = (
        argument_of(effect.instance_class, "reach"),
        argument_of(effect.instance_class, "interaction_first"),
    )
    if not remembers(effect):

        def forgetful(effect, distance, partners, alignment, memory):  # type: ignore[no-untyped-def]
            if distance >= reach(effect, at_reach(partners)):
                return 0.0
            return firsts(effect, distance, at_first(partners), alignment)[0]

        return forgetful

    at_contact, nothing = begins_at_contact(effect), (0.0,) * memory_size(effect)

    def slope(effect, distance, partners, alignment, memory):  # type: ignore[no-untyped-def]
        # what remembers reaches as far as contact at least
        if distance >= partners.contact_distance:
            if at_contact and memory == nothing:
                return 0.0
            if distance >= reach(effect, at_reach(partners)):
                return 0.0
        return firsts(effect, distance, at_first(partners), alignment, memory)[0]

    return slope


def reach_beyond_contact(effects: tuple[Any, ...], packing: Packing) -> float:
    """Return how far beyond contact a scene's interactions reach [length]; 0 where it has none.

    Parameters
    ----------
    effects
        The scene's effects.
    packing
        The packing, of whose radii the contact distances are made.

    """
    pairs, acting = bounding_partners(effects, packing), interactions_of(effects)
    return max([0.0, *(reach_of(one, partners) - partners.contact_distance for one in acting for partners in pairs)])


@dataclass(frozen=True, eq=False)
class Interactions:
    """Pairs whose centers act on each other whether they touch or not: bonded ones, and those within reach.

    Attributes
    ----------
    pairs
        The pairs by their centers; contact distances of bonded ones are the rest lengths of the bonds.
    energy_c
        (C,) energies [energy].
    first_ck
        (C, 2) derivatives by distance [force] and alignment [energy].
    second_ckk
        (C, 2, 2) second derivatives by these.
    turning_ct
        (C, t) slopes of the alignments along rotations of i; those along rotations of j are the opposite. t = 0 for
        discs and spheres.
    bending_cxx
        (C, X, X) second derivatives of the alignments by the pairs' coordinates, X = d + 2 t.

    """

    pairs: Contacts
    energy_c: NDArray[np.float64]
    first_ck: NDArray[np.float64]
    second_ckk: NDArray[np.float64]
    turning_ct: NDArray[np.float64]
    bending_cxx: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.pairs)

    @functools.cached_property
    def slope_ckx(self) -> NDArray[np.float64]:
        """The (C, 2, X) slopes of distances and alignments by the pairs' coordinates."""
        (count, d), t = self.pairs.vector_cd.shape, self.turning_ct.shape[1]
        slope = np.zeros((count, 2, d + 2 * t))
        slope[:, 0, :d] = self.pairs.normal_cd
        slope[:, 1, d : d + t] = self.turning_ct
        slope[:, 1, d + t :] = -self.turning_ct
        return slope

    @property
    def pull_cx(self) -> NDArray[np.float64]:
        """The (C, X) derivatives of the energies by the pairs' coordinates."""
        return np.asarray(np.einsum("ck,ckx->cx", self.first_ck, self.slope_ckx))

    def net(self) -> NDArray[np.float64]:
        """Return the (N, d + t) net forces and torques, t = 0 for discs and spheres."""
        d, t = self.pairs.dimension, self.turning_ct.shape[1]
        pull, total = self.pull_cx, np.zeros((self.pairs.particles, d + t))
        for end, sign, begin in ((self.pairs.i_c, 1.0, d), (self.pairs.j_c, -1.0, d + t)):
            force = np.hstack([sign * pull[:, :d], -pull[:, begin : begin + t]])
            total += np.stack([np.bincount(end, part, len(total)) for part in force.T], axis=1)
        return total

    def virial(self) -> NDArray[np.float64]:
        """Return the (d, d) stress times the volume, tension positive [energy]."""
        return np.asarray(self.pull_cx[:, : self.pairs.dimension].T @ self.pairs.vector_cd)

    def select(self, keep_c: NDArray[Any]) -> Interactions:
        """Return the pairs that a mask or an index array names."""
        return Interactions(self.pairs.select(keep_c), *(part[keep_c] for part in self._parts()))

    def joined(self, other: Interactions | None) -> Interactions:
        """Return these pairs, and then others (None: no others)."""
        if other is None:
            return self
        parts, names = zip(self._parts(), other._parts(), strict=True), ("i_c", "j_c", "image_cd", "normal_cd")
        lengths = ("distance_c", "contact_distance_c", "effective_radius_c", "kinds_c")
        pairs: dict[str, Any] = {
            name: np.concatenate([getattr(one.pairs, name) for one in (self, other)]) for name in (*names, *lengths)
        }
        return Interactions(replace(self.pairs, **pairs), *(np.concatenate(both) for both in parts))

    def _parts(self) -> tuple[NDArray[np.float64], ...]:
        return self.energy_c, self.first_ck, self.second_ckk, self.turning_ct, self.bending_cxx

    def among(self, index_n: NDArray[np.int64]) -> Interactions:
        """Return the pairs between these particles alone, numbered in their order."""
        particles = len(index_n)
        number_n = np.full(self.pairs.particles, -1)
        number_n[index_n] = np.arange(particles)
        i, j = number_n[self.pairs.i_c], number_n[self.pairs.j_c]
        kept = self.select((i >= 0) & (j >= 0))
        i, j = number_n[kept.pairs.i_c], number_n[kept.pairs.j_c]
        return replace(kept, pairs=replace(kept.pairs, i_c=i, j_c=j, particles=particles))

    def elements(self, kind: str = "exact") -> Elements:
        """Return them as elements; "unstressed" leaves out what the first derivatives add to the second."""
        slope, d = self.slope_ckx, self.pairs.dimension
        stiffness = np.einsum("ckx,ckm,cmy->cxy", slope, self.second_ckk, slope)
        first = np.zeros_like(self.first_ck) if kind == "unstressed" else self.first_ck
        stiffness[:, :d, :d] += first[:, 0, None, None] * self.pairs.curvature_cxx
        stiffness += first[:, 1, None, None] * self.bending_cxx
        pull = np.einsum("ck,ckx->cx", first, slope)
        return Elements(self.pairs.i_c, self.pairs.j_c, self.pairs.vector_cd, pull, stiffness)


@device
def _law_of(
    effect: Any, distance: float, partners: Partners, alignment: float, memory_ck: Any, c: int, column: int
) -> PairLaw:
    """Return the law of a pair under one effect with the numbers that it keeps, brought to this distance.

    Their count is its own: kernels that unroll a tuple of effects have one type for each of their names.
    """
    numbers = remembered(effect, distance, partners, memory_at(effect, memory_ck, c, column))
    return remembering_law(effect, distance, partners, alignment, numbers)


@kernel
def _laws(effects, pair_ck, kinds_c, alignment_c, memory_ck, energy_c, first_ck, second_ckk):  # type: ignore[no-untyped-def]
    """Add the laws of the pairs, with the numbers that are kept of them; return nothing.

    Columns of pair_ck are distances, contact distances and effective radii.
    """
    for c in range(pair_ck.shape[0]):
        column, r, alignment = 0, pair_ck[c, 0], alignment_c[c]
        partners = Partners(pair_ck[c, 1], pair_ck[c, 2], kinds_c[c])
        for one in literal_unroll(effects):
            law = _law_of(one, r, partners, alignment, memory_ck, c, column)
            column += memory_size(one)
            energy_c[c] += law.energy
            first_ck[c, 0] += law.first
            first_ck[c, 1] += law.turning
            second_ckk[c, 0, 0] += law.second
            second_ckk[c, 0, 1] += law.mixed
            second_ckk[c, 1, 0] += law.mixed
            second_ckk[c, 1, 1] += law.bending


def find_interactions(packing: Packing, effects: tuple[Any, ...]) -> Interactions:
    """Return the pairs that bonds join, and others within reach of a scene's interactions; none where it has neither.

    Parameters
    ----------
    packing
        The packing. Linked pairs at the link's image, pairs within a rigid cluster, and bonded pairs do not interact.
    effects
        The scene's effects.

    """
    refuse_memory_of_shapes(effects, packing)
    acting, bonded = interactions_of(effects), bonded_pairs(packing, effects)
    pairs = Candidates(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, packing.dimension), np.int64))
    if acting:
        beyond = reach_beyond_contact(acting, packing)
        pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, skin=beyond)
    near = pair_contacts(packing, *pairs)
    if acting:
        near = acting_contacts(near, effects)
        near = near.select(~Excluded(packing).mask(near.i_c, near.j_c, near.image_cd))
    energy, first, second = np.zeros(len(near)), np.zeros((len(near), 2)), np.zeros((len(near), 2, 2))
    alignment, turning, bending = _alignments(packing, near)
    found = Interactions(near, energy, first, second, turning, bending)
    if acting:
        memory = _memory_of(packing, near, memory_columns(acting))
        pairs_ck = np.stack([near.distance_c, near.contact_distance_c, near.effective_radius_c], axis=1)
        _laws(acting, pairs_ck, near.kinds_c, alignment, memory, energy, first, second)
        found = found.select((energy != 0.0) | first.any(axis=1) | second.any(axis=(1, 2)))
    return found.joined(bonded)


def _memory_of(packing: Packing, pairs: Contacts, columns: int) -> NDArray[np.float64]:
    """Return the (C, K) numbers that the packing holds of pairs; zeros for all others."""
    found, held = np.zeros((len(pairs), columns)), packing.tangential
    if columns and held is not None and held.memory_ck is not None:
        held.check_memory(columns)
        known, asked = ((one.i_c, one.j_c, one.image_cd) for one in (pairs, held))
        place = named_rows(known, asked)
        found[place[place >= 0]] = held.memory_ck[place >= 0]
    return found


@kernel
def _normal_springs(compression, tension, distance_b, rest_b, energy_b, first_bk, second_bkk):  # type: ignore[no-untyped-def]
    """Fill in the laws of bonds, which know no directions; return nothing."""
    for b in range(distance_b.shape[0]):
        r, rest = distance_b[b], equal_partners(rest_b[b])
        if r < rest_b[b]:
            energy_b[b] = law_energy(compression, r, rest)
            first_bk[b, 0] = law_first(compression, r, rest)
            second_bkk[b, 0, 0] = law_second(compression, r, rest)
        else:
            energy_b[b] = law_energy(tension, r, rest)
            first_bk[b, 0] = law_first(tension, r, rest)
            second_bkk[b, 0, 0] = law_second(tension, r, rest)


def bonded_pairs(packing: Packing, effects: tuple[Any, ...]) -> Interactions | None:
    """Return the pairs that bonds join and the energies of their normal springs, in the bonds' order; None without.

    Tangential springs are slack as a scene starts (`Bonds`), so that they have no part in energies and forces.
    """
    bonds = bonds_of(effects)
    if bonds is None:
        return None
    pairs = pair_contacts(packing, bonds.i_b, bonds.j_b, bonds.image_bd)
    pairs = replace(pairs, contact_distance_c=bonds.rest_length_b, effective_radius_c=0.25 * bonds.rest_length_b)
    energy, first, second = np.zeros(len(bonds)), np.zeros((len(bonds), 2)), np.zeros((len(bonds), 2, 2))
    _normal_springs(bonds.compression, bonds.tension, pairs.distance_c, bonds.rest_length_b, energy, first, second)
    _, turning, bending = _alignments(packing, pairs)
    return Interactions(pairs, energy, first, second, np.zeros_like(turning), np.zeros_like(bending))


def _alignments(
    packing: Packing, pairs: Contacts
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the alignments of pairs, their slopes along rotations of i, and second derivatives by all coordinates.

    An axis e turned by a rotation vector w is e + w x e + w x (w x e) / 2: of e_i . e_j the slope along w_i is
    e_i x e_j, and the second derivatives are (e_i e_j + e_j e_i) / 2 - (e_i . e_j) 1 by w_i twice or w_j twice, and
    (e_i . e_j) 1 - e_j e_i by both.
    """
    count, d, shapes = len(pairs), packing.dimension, packing.shapes
    if not shapes.has_orientations:
        return np.ones(count), np.zeros((count, 0)), np.zeros((count, d, d))
    one, other = shapes.axis_nd[pairs.i_c], shapes.axis_nd[pairs.j_c]
    alignment = (one * other).sum(axis=1)
    if d == 2:
        turning = (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])[:, None]
        own = -alignment[:, None, None]
        both = -own
    else:
        turning = np.cross(one, other)
        product = one[:, :, None] * other[:, None, :]
        upright = alignment[:, None, None] * np.eye(3)
        own = 0.5 * (product + product.transpose(0, 2, 1)) - upright
        both = upright - product.transpose(0, 2, 1)
    t = turning.shape[1]
    bending = np.zeros((count, d + 2 * t, d + 2 * t))
    bending[:, d : d + t, d : d + t] = bending[:, d + t :, d + t :] = own
    bending[:, d : d + t, d + t :] = both
    bending[:, d + t :, d : d + t] = both.transpose(0, 2, 1)
    return alignment, turning, bending
