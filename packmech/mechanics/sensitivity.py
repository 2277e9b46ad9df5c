"""Every derivative of a packing at rest: how its figures change with sizes, springs, laws, shapes, masses and strains.

A figure phi of a packing depends on the coordinates y at which it rests and on numbers p. As p changes the packing
relaxes again, K dy = -df with f the slopes of the energy and K their derivatives, so that with the adjoint a

    d phi / dp = (d phi / dp at fixed y) - a . df/dp,        K a = d phi / dy

one further solve gives the derivatives by all numbers at once. Figures are sums over pairs, of energies, of pulls, and
of stiffnesses W along motions w that are stationary (relaxed strains, normal modes), so that these motions stay as they
are: phi = sum of W : M + pull . b. What K and f lack are the third derivatives, those of W along the coordinates of its
pair, which are found pair by pair (`packmech.mechanics.pair_changes`). Rigid links are springs with a force that is an
unknown of its own, and their lengths among the equations.
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import boolean, brief, instance, integer, one_of
from packmech.contacts import Contacts
from packmech.contacts.elements import Elements, sum_slopes
from packmech.contacts.fused_volume import shared_volume
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import Friction, acting_contacts, acting_friction, bonds_of
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import mandel_basis, trace_vector
from packmech.measure.contact_forces import resting_forces
from packmech.measure.counting import packing_fraction
from packmech.mechanics.network import Network, contact_network
from packmech.mechanics.pair_changes import (
    TOUCHING,
    BondPairs,
    Change,
    ContactPairs,
    LinkPairs,
    Pairs,
    difference,
)
from packmech.mechanics.pair_figures import Figure, Rest, figure_of, refuse_dependent
from packmech.mechanics.self_stress import states_of_self_stress
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.shapes import Spheroids, Superellipsoids

FIGURES = (
    "energy", "pressure", "bulk_modulus", "shear_modulus", "young_modulus", "poisson_ratio", "frequency",
    "packing_fraction",
)  # fmt: skip
NUMBERS = (
    "radius", "contact_stiffness", "bond_stiffness", "rest_length", "link_length", "law", "aspect", "exponent", "mass",
    "applied_strain",
)  # fmt: skip
# gaps beyond these, over the contact distance, are not looked at for the margin
_NEAR = 0.05
# relative steps of numbers of laws, and of shapes in distances
_OF_NUMBERS, _SMALL = 3e-3, 1e-3
# relative overlaps below which no derivative of one side is taken, and the rounding of a difference times the overlap
_SHALLOWEST, _ROUNDINGS = 1e-12, 1000.0
# lowest exponent of superellipsoids, at which they are ellipsoids
_ROUND = 2.0


def _headline(one: Sensitivity) -> str:
    return f"d {one.of} / d {one.to}, {one.of} {one.value:.6g}; {one.statement}"


@shown(_headline)
@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives of one figure of a packing by all numbers of one kind, the packing at rest all along.

    Attributes
    ----------
    of, to
        The figure and the numbers, by their names.
    value
        The figure.
    gradient
        Its derivatives, [unit of the figure over that of the numbers]: (N,) by "radius", "aspect", "exponent" and
        "mass" of the particles; (C,) by "contact_stiffness" and (B,) by "bond_stiffness", factors on the energies of
        single contacts and bonds, 1 as they are; (B,) by "rest_length" of bonds and (L,) by "link_length"; (K,) by the
        numbers of the "law"; (d, d) by an "applied_strain" E, the box v -> (1 + E) v: the figure changes by
        (gradient * E).sum(), whether E turns the box or not. Zeros for rattlers.
    i_c, j_c
        (C,) particles of the contacts, where these are asked for; empty otherwise.
    names
        Names of the numbers of the law, where these are asked for.
    residual
        What the adjoint solve, and that of the strains, left unbalanced, over the largest entry of the right side [1].
    force_residual
        Largest net force on a particle over the mean contact force of the packing as given [1].
    difference_error
        Bound on the error of the differences of single pairs, over their largest [1].
    solves
        Right sides that were solved for, by one factorization; it does not grow with the number of derivatives.
    margin
        Smallest relative overlap of a contact, or gap of a pair that does not touch: how near contacts are to change
        [1]. Bonded pairs are no contacts.
    seconds
        CPU time.

    """

    of: str
    to: str
    value: float
    gradient: NDArray[np.float64]
    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    names: tuple[str, ...]
    residual: float
    force_residual: float
    difference_error: float
    solves: int
    margin: float
    seconds: float

    @property
    def statement(self) -> str:
        """One sentence on how far the derivatives hold."""
        if not np.isfinite(self.margin):
            return "no contact is near to opening or closing"
        return f"contacts stay the same until gaps change by {self.margin:.2g} of a contact distance"


class _Weighted(NamedTuple):
    """Pairs with the weights of their stiffnesses and pulls in a figure, and its slopes along their coordinates."""

    pairs: Pairs
    quadratic_cxx: NDArray[np.float64]
    linear_cx: NDArray[np.float64]
    slope_cx: NDArray[np.float64]
    # the same along link forces
    force_c: NDArray[np.float64]


def _weigh(rest: Rest, figure: Figure, pairs: Pairs) -> _Weighted:
    """Return the weights of pairs in a figure, and the figure's slopes along their coordinates, motions held."""
    own, d = pairs.own, rest.d
    x = own.pull_cx.shape[1]
    weight, volume = figure.weight_ee / figure.volume, figure.volume
    motion_ecx = np.array(
        [rest.changes(own, one, strain) for one, strain in zip(figure.motion_enq, figure.strain_edd, strict=True)]
    ).reshape(len(weight), len(own.i_c), x)
    left_ecx = motion_ecx
    if figure.left_enq is not None:
        both = zip(figure.left_enq, figure.strain_edd, strict=True)
        left_ecx = np.array([rest.changes(own, one, strain) for one, strain in both])
    quadratic = np.einsum("ef,ecx,fcy->cxy", weight, left_ecx, motion_ecx, optimize=True)
    linear = np.zeros_like(own.pull_cx)
    linear[:, :d] = own.vector_cd @ figure.stress_dd.T / volume
    slope = np.einsum("cxy,cx->cy", own.stiffness_cxx, linear) + figure.energy * own.pull_cx
    slope[:, :d] += own.pull_cx[:, :d] @ figure.stress_dd / volume
    force = np.zeros(len(own.i_c))
    if len(weight):
        stiff_ecx = np.einsum("cxy,ecy->ecx", own.stiffness_cxx, motion_ecx)
        turned_ecx = stiff_ecx if left_ecx is motion_ecx else np.einsum("cxy,ecx->ecy", own.stiffness_cxx, left_ecx)
        if isinstance(pairs, LinkPairs):
            normal, bend = pairs.pairs.normal_cd, pairs.pairs.curvature_cxx
            mixed_el = 0.5 * (weight + weight.T) @ figure.link_el
            slope[:, :d] += 2.0 * np.einsum("ec,cab,ecb->ca", mixed_el, bend, motion_ecx[:, :, :d], optimize=True)
            stiff_ecx = stiff_ecx.copy()
            stiff_ecx[:, :, :d] += figure.link_el[:, :, None] * normal
            turned_ecx = stiff_ecx
            force = np.einsum("cab,cab->c", bend, quadratic[:, :d, :d])
        for each, sides in ((weight, stiff_ecx), (weight.T, turned_ecx)):
            slope[:, :d] += np.einsum("ef,eba,fcb->ca", each, figure.strain_edd, sides[:, :, :d], optimize=True)
        slope += _third(rest, pairs, quadratic)
        if figure.vibrates and d == 3 and own.rotations:
            for part in (slice(d, d + 3), slice(d + 3, d + 6)):
                turned = np.cross(motion_ecx[:, :, part], stiff_ecx[:, :, part])
                slope[:, part] += 2.0 * np.einsum("ee,ecx->cx", weight, turned)
    if isinstance(pairs, LinkPairs):
        force = force + (pairs.pairs.normal_cd * linear[:, :d]).sum(axis=1)
    return _Weighted(pairs, quadratic, linear, slope, force)


def _third(rest: Rest, pairs: Pairs, quadratic_cxx: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C, X) slopes of stiffnesses times weights along the pairs' coordinates: third derivatives."""
    own, d = pairs.own, rest.d
    count, x = own.pull_cx.shape
    found = np.zeros((count, x))
    reach = _reaches(rest, own)
    # bonds act on centers, whatever turns
    for k in range(d if isinstance(pairs, BondPairs | LinkPairs) else x):
        step = pairs.step_c if k < d else pairs.step_c / reach
        move = np.zeros((count, x))
        move[:, k] = step
        slope = rest.difference(functools.partial(_work, pairs, Change(move), quadratic_cxx))
        found[:, k] = slope / step
    return found


def _reaches(rest: Rest, own: Elements) -> NDArray[np.float64]:
    """Return the (C,) sums of how far the particles of each pair reach from their centers [length]."""
    reach_n = rest.network.packing.shapes.reach(rest.network.packing.radius_n)
    return np.asarray(reach_n[own.i_c] + reach_n[own.j_c])


def _work(
    pairs: Pairs, change: Change, quadratic_cxx: NDArray[np.float64], steps: float, linear_cx: Any = None,
    energy: float = 0.0,
) -> NDArray[np.float64]:  # fmt: skip
    """Return the (C,) parts of single pairs in a figure after so many steps of a change."""
    found = pairs.at(change, steps)
    total: NDArray[np.float64] = np.einsum("cxy,cxy->c", found.stiffness_cxx, quadratic_cxx)
    if linear_cx is not None:
        total = total + (found.pull_cx * linear_cx).sum(axis=1)
    return total + energy * pairs.energies(change, steps) if energy else total


def _numbers_in(record: Any, name: str = "") -> list[tuple[str, tuple[Any, ...], float]]:
    """Return the names, places and values of all numbers in a record and the records in it."""
    found: list[tuple[str, tuple[Any, ...], float]] = []
    names = getattr(record, "_fields", range(len(record)))
    for k, (each, value) in enumerate(zip(names, record, strict=True)):
        label = f"{name}.{each}" if name else str(each)
        if isinstance(value, tuple):
            found += [(one, (k, *place), number) for one, place, number in _numbers_in(value, label)]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found.append((label, (k,), float(value)))
    return found


def _with_number(record: Any, place: tuple[int, ...], value: float) -> Any:
    """Return a record with another number at one place."""
    k = place[0]
    new = value if len(place) == 1 else _with_number(record[k], place[1:], value)
    values = [new if m == k else one for m, one in enumerate(record)]
    return record._make(values) if hasattr(record, "_make") else tuple(values)


def _changed_law(
    effects: tuple[Any, ...], m: int, place: tuple[int, ...], value: float, step: float, steps: float
) -> tuple[Any, ...]:
    """Return the effects with one number of the m-th changed by so many steps."""
    return (*effects[:m], _with_number(effects[m], place, value + steps * step), *effects[m + 1 :])


class _Response:
    """A figure, its adjoint, and its derivatives by numbers of all kinds."""

    def __init__(self, rest: Rest, of: str, mode: int) -> None:
        self.rest, self.figure = rest, figure_of(rest, of, mode)
        network, figure = rest.network, self.figure
        self.weighted = [_weigh(rest, figure, one) for one in rest.pairs]
        slope = np.zeros(network.there_nq.shape)
        length = np.zeros((len(network.links), 1))
        for one in self.weighted:
            own = one.pairs.own
            slope += sum_slopes(own.i_c, own.j_c, one.slope_cx, network.turn_nkt, rest.d)
            if isinstance(one.pairs, LinkPairs):
                length[:, 0] = one.force_c
        self.solves, self.residual = figure.solves, figure.residual
        self.adjoint_nq, self.adjoint_l = np.zeros_like(slope), np.zeros(len(length))
        # the energy is stationary: its adjoint is nothing
        if not figure.energy and network.pinned_f.any():
            adjoint, force, left = rest.solve(slope[:, :, None], length, transposed=True)
            self.adjoint_nq, self.adjoint_l = adjoint[:, :, 0], force[:, 0]
            self.solves, self.residual = self.solves + 1, max(self.residual, left)
        self.linear = [one.linear_cx - rest.changes(one.pairs.own, self.adjoint_nq, None) for one in self.weighted]

    def by(self, k: int, change: Change) -> NDArray[np.float64]:
        """Return the (C,) derivatives per step of a change of pairs of one kind."""
        one = self.weighted[k]
        at = functools.partial(
            _work, one.pairs, change, one.quadratic_cxx, linear_cx=self.linear[k], energy=self.figure.energy
        )
        return self.rest.difference(at)

    def factors(self, k: int) -> NDArray[np.float64]:
        """Return the (C,) derivatives by factors on the energies of pairs."""
        one = self.weighted[k]
        return _work(one.pairs, Change(), one.quadratic_cxx, 0.0, self.linear[k], self.figure.energy)

    def per_particle(self, name: str, value_n: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return the (N',) derivatives by the radii of contacts' particles, or by a named array of their shapes."""
        rest, total = self.rest, np.zeros(len(self.rest.network.index_n))
        for k, one in enumerate(self.weighted):
            pairs = one.pairs
            if not isinstance(pairs, ContactPairs):
                continue
            for side, end in enumerate((pairs.i_c, pairs.j_c)):
                step = pairs.step_c
                if value_n is not None:
                    step = step / _reaches(rest, pairs.own) * value_n[end]
                both = np.zeros((len(step), 2))
                both[:, side] = step
                change = Change(radius_c2=both) if value_n is None else Change(shape=name, shape_c2=both)
                total += np.bincount(end, self.by(k, change) / step, len(total))
        return total

    def by_law(self) -> tuple[NDArray[np.float64], tuple[str, ...]]:
        """Return the derivatives by all numbers of the effects of touching pairs, and their names."""
        effects, names, slopes, rough = self.rest.scene.effects, [], [], self.rest.rough
        at = [k for k, one in enumerate(self.weighted) if isinstance(one.pairs, ContactPairs)]
        for m, one in enumerate(effects):
            if not hasattr(type(one), "pair_energy") and not (rough and isinstance(one, Friction)):
                continue
            for name, place, value in _numbers_in(one):
                step = _OF_NUMBERS * (abs(value) or 1.0)

                changed = functools.partial(_changed_law, effects, m, place, value, step)
                names.append(name)
                slopes.append(sum(float(self.by(k, Change(effects=changed)).sum()) for k in at) / step)
        return np.array(slopes), tuple(names)

    def by_strain(self) -> NDArray[np.float64]:
        """Return the (d, d) derivatives by an applied strain."""
        rest, figure, d = self.rest, self.figure, self.rest.d
        system, network = rest.system, rest.network
        basis = mandel_basis(d)
        explicit = np.zeros(len(basis))
        for one in self.weighted:
            stretched = np.einsum("eab,cb->eca", basis, one.pairs.own.vector_cd)
            explicit += np.einsum("eca,ca->e", stretched, one.slope_cx[:, :d])
        whole = np.ones(network.free_f.size, dtype=bool)
        explicit -= system.column(whole).T @ self.adjoint_nq.ravel() + rest.affine() @ self.adjoint_l
        if not (figure.vibrates or figure.energy):
            # what is a density is over the volume
            explicit -= trace_vector(d) * self._over_volume()
        found = np.asarray(np.einsum("e,eab->ab", explicit, basis))
        # a packing that turns with its box stays at rest, and only what names axes changes
        return found if figure.turned_dd is None else found + figure.turned_dd

    def _over_volume(self) -> float:
        """Return the figure's weighted sums: its value where it is linear in stiffness and stress."""
        figure, total = self.figure, float((self.figure.stress_dd * self.rest.system.virial_dd).sum())
        total /= figure.volume
        for one in self.weighted:
            total += float((one.quadratic_cxx * one.pairs.own.stiffness_cxx).sum())
        return total

    def by_masses(self) -> NDArray[np.float64]:
        """Return the (N',) derivatives by masses."""
        return self.figure.mass_n / self.rest.packing.mass_n[self.rest.network.index_n]


def _derivatives(rest: Rest, response: _Response, to: str) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return the derivatives by numbers of one kind, and the names of the numbers of a law."""
    packing, network, figure = rest.packing, rest.network, response.figure
    if to == "applied_strain":
        return response.by_strain(), ()
    if to == "law":
        return response.by_law()
    kinds = {"contact_stiffness": ContactPairs, "bond_stiffness": BondPairs, "rest_length": BondPairs}
    if to in kinds:
        bonds = bonds_of(rest.scene.effects)
        total = np.zeros(len(bonds) if kinds[to] is BondPairs and bonds is not None else 0)
        for k, one in enumerate(response.weighted):
            if not isinstance(one.pairs, kinds[to]):
                continue
            if to == "contact_stiffness":
                return response.factors(k), ()
            pairs = one.pairs
            assert isinstance(pairs, BondPairs)
            step = pairs.step_c
            found = response.factors(k) if to == "bond_stiffness" else response.by(k, Change(rest_c=step)) / step
            total[pairs.index_b] = found
        return total, ()
    if to == "link_length":
        found_l = np.zeros(len(packing.links))
        found_l[_links_among(network)] = response.adjoint_l if not figure.energy else -_tension_of(rest)
        return found_l, ()
    total = np.zeros(packing.particles)
    total[network.index_n] = _per_particle(rest, response, to)
    return total, ()


def _links_among(network: Network) -> NDArray[np.bool_]:
    """Return the (L,) mask of the links between particles that are kept."""
    links = network.parent.links
    return np.isin(links.i_l, network.index_n) & np.isin(links.j_l, network.index_n)


def _tension_of(rest: Rest) -> NDArray[np.float64]:
    """Return the forces of the links: minus these is what their lengths change the energy by."""
    assert rest.links is not None
    return rest.links.tension_c


def _per_particle(rest: Rest, response: _Response, to: str) -> NDArray[np.float64]:
    """Return the (N',) derivatives by numbers of particles: radii, shapes, masses."""
    packing, network, figure = rest.packing, rest.network, response.figure
    if to == "mass":
        return response.by_masses()
    kept = network.packing
    moment = figure.gyration_nk
    if to == "radius":
        found = response.per_particle("")
        if figure.vibrates:
            # masses of density 1 grow with the volume, radii of gyration with the radius
            if packing.given_mass_n is None:
                found = found + rest.d * figure.mass_n / kept.radius_n
            found = found + moment.sum(axis=1) / kept.radius_n
        return found
    name = {"aspect": "aspect_n", "exponent": "exponent_n"}[to]
    value = getattr(kept.shapes, name)
    found = response.per_particle(name, value)
    if figure.vibrates:
        found = found + (moment * _gyration_slopes(rest, kept, name, value)).sum(axis=1)
    return found


def _with_numbers(shapes: Any, name: str, value_n: NDArray[np.float64]) -> Any:
    """Return shapes with other numbers under one name."""
    return replace(shapes, **{name: value_n})


def _gyration_slopes(rest: Rest, kept: Packing, name: str, value_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N', K) relative derivatives of radii of gyration by numbers of shapes."""
    step, shapes = _OF_NUMBERS * value_n, kept.shapes

    def sizes(steps: float) -> NDArray[np.float64]:
        changed: Any = _with_numbers(shapes, name, value_n + steps * step)
        rate = np.sqrt((changed.turn_basis(kept.radius_n) ** 2).sum(axis=2))
        return np.asarray(-np.log(np.where(rate > 0.0, rate, 1.0)))

    return rest.difference(sizes) / step[:, None]


def _check_names(scene: Scene, of: str, to: str) -> None:
    """Refuse figures and numbers that there are not, or that the scene has none of."""
    d = scene.packing.dimension
    letters = isinstance(of, str) and len(of) in (2, 4) and set(of) <= set("xyz"[:d])
    if not letters and not (isinstance(of, str) and of in FIGURES):
        axes = "xyz"[:d]
        raise ValueError(
            f"of must be {', '.join(FIGURES)}, a component of the stress such as 'xy', or one of the stiffness such as "
            f"'xyxy', of the axes {axes}, got {brief(of)}"
        )
    one_of("to", to, NUMBERS)
    shapes, packing = scene.packing.shapes, scene.packing
    lacking = {
        "bond_stiffness": bonds_of(scene.effects) is None,
        "rest_length": bonds_of(scene.effects) is None,
        "link_length": not packing.links,
        "aspect": not isinstance(shapes, Spheroids),
        "exponent": not isinstance(shapes, Superellipsoids),
    }
    if lacking.get(to):
        what = {"aspect": "Spheroids", "exponent": "Superellipsoids", "link_length": "links"}.get(to, "Bonds")
        raise ValueError(f"to must be a number that the scene has, got {to!r} of one without {what}")
    if to == "mass" and of != "frequency":
        raise ValueError(
            f"to must not be 'mass' but for of='frequency', as no mass changes a packing at rest, got {of!r}"
        )
    if isinstance(shapes, Superellipsoids) and to == "exponent":
        low = shapes.exponent_n * (1.0 - 4.0 * _OF_NUMBERS) < _ROUND
        if low.any():
            n = int(np.argmax(low))
            raise ValueError(
                f"to must not be 'exponent' where exponents are {_ROUND:g}, the lowest that there are, got "
                f"{shapes.exponent_n[n]:g} for particle {n}"
            )
    rough = acting_friction(scene.effects) is not None
    if rough and (bonds_of(scene.effects) is not None or packing.links):
        raise ValueError(
            "scene must hold no bonds or links beside friction for pm.sensitivity: leave the friction out with "
            "scene.without(pm.Friction)"
        )
    if rough and of in ("energy", "frequency", "packing_fraction"):
        raise ValueError(
            f"of must not be {of!r} for a scene with friction, whose forces derive from no energy: leave it out with "
            "scene.without(pm.Friction)"
        )
    if of == "packing_fraction" and bonds_of(scene.effects) is not None:
        raise ValueError(
            "scene must hold no bonds for of='packing_fraction', which is that of a hard packing held by contacts and "
            "rigid links: leave them out with scene.without(pm.Bonds), or make them links"
        )
    if of == "packing_fraction" and to not in ("radius", "link_length", "aspect", "exponent"):
        raise ValueError(
            "to must be 'radius', 'link_length', 'aspect' or 'exponent' for of='packing_fraction', which is that of "
            f"the hard packing and knows no energies, got {to!r}"
        )


@shown_as("derivatives of a packing")
@honors("repulsion kinds friction bonds links shapes", at_rest=True)
def sensitivity(scene: Scene, of: str, to: str, *, mode: int = 0, one_sided: bool = False) -> Sensitivity:
    """Return the derivatives of one figure of a packing at rest by all numbers of one kind, for the price of a solve.

    They are those of packings that relax again in their box, with the same contacts, as one number changes:
    an adjoint solve on the factored stiffness takes the motion into account, however many numbers there are.

    With friction contacts stick, each with its spring as it stands: a number changes at first with forces of springs as
    they are, and springs grow by the slip on the way to rest (`stiffness_matrix`). Pressure, stress and moduli have
    derivatives then; factors on contacts scale both forces, and numbers of the law are those of `Friction`, too.

    Parameters
    ----------
    scene
        The scene; its packing must be at rest, and for moduli and frequencies to many digits: these derivatives err by
        about the net forces over the contact forces, over the smallest relative overlap.
    of
        "energy", "pressure", "bulk_modulus", "shear_modulus", "young_modulus", "poisson_ratio" (the last two of the
        Hill average), a component of Cauchy's stress ("xy") or of the relaxed stiffness ("xyxy"), all as
        `elastic_moduli` defines them; "frequency", that of one mode; or "packing_fraction": that of a hard packing,
        whose particles just touch and are not fused, held by contacts and links alone, jammed in a box that keeps its
        shape or under pressure alone. It rises with what presses its contacts apart least: the forces of its one state
        of self stress are the derivatives.
    to
        "radius" of the particles (masses that were not given follow), "contact_stiffness" (factors on the energies of
        single contacts), "bond_stiffness" (of bonds), "rest_length" (of bonds), "link_length", "law" (all numbers of
        the effects of touching pairs), "aspect" of ellipses and spheroids and "exponent" of superellipsoids (at the
        same volume), "mass" (of frequencies), or "applied_strain" of the box.
    mode
        The mode, counted from the lowest as in `normal_modes`.
    one_sided
        Take contacts that just touch, overlapping by 1e-12 to 1e-9, as contacts: the derivatives are then those of
        changes that press them further, beside those of changes that open them. Otherwise such packings are refused.
        Of no account for packing fractions, whose contacts all just touch.

    Returns
    -------
    Sensitivity
        The derivatives, and what solves and differences achieved.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, the scene is not at rest (a net force above 1e-2 of the
        mean contact force), contacts just touch, where stiffnesses jump (but for packing fractions and with
        `one_sided`), or are at the Coulomb limit, or the mode is degenerate.

    Examples
    --------
    A stiffer law makes all moduli larger, in proportion:

    >>> import packmech as pm
    >>> start = pm.random_packing(24, dimension=2, packing_fraction=0.95, seed=1)
    >>> scene = pm.Scene(start, (pm.Repulsion(law=pm.Harmonic(energy_scale=2.0)),))
    >>> rest = scene.replace(packing=pm.quench(scene, force_tolerance=1e-12).packing)
    >>> found = pm.sensitivity(rest, of="shear_modulus", to="law")
    >>> found.names, round(float(found.gradient[0] * 2.0 / found.value), 9), found.solves
    (('law.energy_scale',), 1.0, 4)

    All contacts together are all of the stiffness:

    >>> stiffness = pm.sensitivity(rest, of="shear_modulus", to="contact_stiffness")
    >>> round(float(stiffness.gradient.sum() / found.value), 9)
    1.0

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    _check_names(scene, of, to)
    mode = integer("mode", mode, at_least=0)
    boolean("one_sided", one_sided)
    with single_thread():
        if of == "packing_fraction":
            return _of_packing_fraction(scene, to, start)
        forces = resting_forces(scene)
        if not forces.at_rest:
            raise ValueError(
                f"scene must be at rest, got a net force of {forces.residual:.2g} mean contact forces: "
                "quench or jam it first"
            )
        rest = Rest(scene)
        rounding = _refuse_touching(rest, one_sided)
        response = _Response(rest, of, mode)
        gradient, names = _derivatives(rest, response, to)
    ends = (np.zeros(0, np.int64), np.zeros(0, np.int64))
    contacts = rest.network.contacts
    if to == "contact_stiffness":
        ends = rest.network.index_n[contacts.i_c], rest.network.index_n[contacts.j_c]
    return Sensitivity(
        of, to, response.figure.value, gradient, *ends, names, response.residual, forces.residual,
        max(rest.error, rounding), response.solves, _margin(rest), time.process_time() - start,
    )  # fmt: skip


def _refuse_touching(rest: Rest, one_sided: bool) -> float:
    """Refuse contacts that just touch, where stiffnesses jump; return how much rounding makes of others that nearly do.

    Steps of differences are parts of the overlap, and rounding errors of distances over them.
    """
    contacts = rest.network.contacts
    least = _SHALLOWEST if one_sided else TOUCHING
    low = contacts.overlap_c <= least
    if low.any():
        c = int(np.argmax(low))
        i, j = (int(rest.network.index_n[end[c]]) for end in (contacts.i_c, contacts.j_c))
        raise ValueError(
            f"scene.packing must have contacts that overlap by more than {least:g} of their contact distance, as "
            f"nothing has a derivative where they open and close, got particles {i} and {j}, which overlap by "
            f"{float(contacts.overlap_c[c]):.2g}: compress it, {'' if one_sided else 'ask for one_sided ones, '}"
            "or of='packing_fraction'"
        )
    shallow = float(contacts.overlap_c.min(initial=np.inf))
    return _ROUNDINGS * float(np.finfo(np.float64).eps) / shallow if shallow <= TOUCHING else 0.0


def _margin(rest: Rest) -> float:
    """Return the smallest relative overlap of contacts that take part, or gap of pairs near to touching."""
    return float(np.abs(_near(rest.scene, rest.network).overlap_c).min(initial=np.inf))


def _near(scene: Scene, network: Network) -> Contacts | ShapeContacts:
    """Return the pairs of kept particles that touch or nearly do, without bonded ones, which no repulsion presses."""
    kept = np.zeros(scene.packing.particles, dtype=bool)
    kept[network.index_n] = True
    return acting_contacts(touching_pairs(scene.packing, _NEAR), scene.effects).among(kept)


def _of_packing_fraction(scene: Scene, to: str, start: float) -> Sensitivity:
    """Return the derivatives of the packing fraction of a hard packing, from its state of self stress.

    With forces f of contacts and tensions -f of links that are in balance, gaps g and lengths l of links,

        sum f (dg/dE + dg/dp dp) = 0,   dg/dE = distance per unit of strain:   d E = -(sum f dg/dp dp) / sum f g_E

    whatever the particles do, and the packing fraction changes by the particles' volumes less d times the strain.
    """
    packing, d = scene.packing, scene.packing.dimension
    shared = shared_volume(packing)
    if shared:
        raise ValueError(
            "scene.packing must have no fused particles, whose union changes with sizes and links, for "
            f"of='packing_fraction', got particles that share a volume of {shared:.3g}"
        )
    network = contact_network(packing, scene.effects)
    contacts = network.contacts
    deepest = float(np.abs(contacts.overlap_c).max(initial=0.0))
    if not len(contacts) or deepest > 1e-6:
        raise ValueError(
            "scene.packing must be a hard packing, whose particles touch to 1e-6 of their contact distance, for "
            f"of='packing_fraction', got {len(contacts)} contacts and an overlap of {deepest:.2g}: take "
            'run.report["hard_packing"] of pm.jam'
        )
    states = states_of_self_stress(network.packing, "none", contacts=contacts)
    if states.count != 1:
        states = states_of_self_stress(network.packing, "isochoric", contacts=contacts)
    if states.count != 1 or states.force_ck is None:
        raise ValueError(
            "scene.packing must have one state of self stress, in its box or under pressure alone, for "
            "of='packing_fraction', whose derivatives are its forces, as with several they differ from side to side, "
            f"got {states.count} states"
        )
    force = states.force_ck[:, 0]
    force = force * np.sign(force.sum())
    own = Elements(
        contacts.i_c, contacts.j_c, contacts.vector_cd, np.zeros_like(contacts.slope_cx), np.zeros((0, 0, 0))
    )
    pairs = ContactPairs(scene, network, own, smooth=True)
    along = (contacts.slope_cx[:, :d] * contacts.vector_cd).sum(axis=1)
    work = float(force @ along)
    tension = np.zeros(len(network.links))
    if len(tension):
        push = sum_slopes(contacts.i_c, contacts.j_c, force[:, None] * contacts.slope_cx, network.turn_nkt, d)
        tension = network.links.multipliers(push[:, :d])
        work += float(tension @ network.links.pairs.distance_c)
    if not (force > 0.0).all():
        raise ValueError("scene.packing must be jammed by contacts that all push for of='packing_fraction'")
    fraction, error = packing_fraction(packing), 0.0
    if to == "link_length":
        refuse_dependent(network)
        gradient = np.zeros(len(packing.links))
        gradient[_links_among(network)] = -fraction * d * tension / work
    else:
        gradient = np.zeros(packing.particles)
        opened, error = _openings(pairs, to, force)
        gradient[network.index_n] = fraction * d * opened / work
        if to == "radius":
            volume = packing.radius_n**d
            gradient += fraction * d * volume / volume.sum() / packing.radius_n
    none = np.zeros(0, np.int64)
    return Sensitivity(
        "packing_fraction", to, fraction, gradient, none, none, (), states.residual, states.residual, error, 0,
        _next_gap(scene, network), time.process_time() - start,
    )  # fmt: skip


def _openings(pairs: ContactPairs, to: str, force_c: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return the (N',) sums of forces times derivatives of gaps by numbers of particles, and a bound on their error."""
    total, worst = np.zeros(pairs.contacts.particles), 0.0
    name = {"aspect": "aspect_n", "exponent": "exponent_n"}.get(to, "")
    for side, end in enumerate((pairs.i_c, pairs.j_c)):
        step = pairs.step_c
        if name:
            step = _SMALL * getattr(pairs.contacts.shapes, name)[end]
        both = np.zeros((len(step), 2))
        both[:, side] = step
        change = Change(shape=name, shape_c2=both) if name else Change(radius_c2=both)
        slope, error = difference(lambda steps, change=change: pairs.geometry(change, steps).gap_c)  # type: ignore[misc]
        total += np.bincount(end, force_c * slope / step, len(total))
        worst = max(worst, error)
    return total, worst


def _next_gap(scene: Scene, network: Network) -> float:
    """Return the smallest gap of pairs that are no contacts, over the contact distance [1]."""
    gap = -_near(scene, network).overlap_c
    return float(np.sort(gap)[len(network.contacts) :].min(initial=np.inf))
