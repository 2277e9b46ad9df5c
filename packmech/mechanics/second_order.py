"""Rigidity to second order: whether what leaves a motion free to first order holds it by its prestress.

Contacts, links and bonds are members. A contact may open and not close, a link or bond keeps its length. A first-order
motion q' closes no contact and changes no link: R q' = 0 on bars, R q' >= 0 on contacts. It extends to second order
where some q'' makes the second derivatives of the lengths R q'' + b(q') zero on bars, and not negative on contacts that
q' leaves as they are; b are the second derivatives of the lengths along q'. By duality (Connelly and Whiteley, SIAM J.
Discrete Math. 9, 453 (1996)) there is such a q'' unless some state of self stress w, pushing at every contact, has

    Q_w(q') = - sum over members of w b(q') > 0        w positive for a push

which is the prestress part of the Hessian along q', the forces w borne. A framework is prestress stable where one w has
Q_w > 0 for all nontrivial q', second-order rigid where every q' has a w of its own. Contacts that no such state pushes
open in some first-order motion; by strict complementarity motions keep the lengths of all others.

Along a motion that keeps its length a bar between points has b = |q'_j - q'_i|^2 / length: a pull holds, a push
destabilizes. Contacts of discs and spheres push, so that without links or bonds second order never helps them.
Distances of ellipses are curved the other way, too: pushes may hold their quartic modes.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import STRAINS, BoxStrain, instance, integer, one_of, positive, real
from packmech.constraints.factor import BASIS_LIMIT
from packmech.contacts import Contacts
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.elements import elements_of, pair_rows
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import acting_contacts, held_particles, refuse_tangential_springs
from packmech.jit.blas import single_thread
from packmech.linalg.definite import most_definite, pushing_share
from packmech.linalg.linear_programs import inner_direction
from packmech.linalg.mandel import mandel_tensor, strain_directions, trace_vector
from packmech.links import Links, image_offsets
from packmech.measure.rattlers import pushing_rows, rattlers_among
from packmech.mechanics.assembly import assemble
from packmech.mechanics.hessian import check_strain_of_box
from packmech.mechanics.network import Network, network_among
from packmech.mechanics.rigidity import strain_columns
from packmech.mechanics.self_stress import (
    RANK_TOLERANCE,
    RigidityRows,
    null_space,
    orthonormal,
    shifted_square,
    with_strains,
)
from packmech.packing import Packing
from packmech.result import Outcome
from packmech.scene import Scene

YES, NO, AMBIGUOUS = "yes", "no", "ambiguous"
# eigenvalues below this part of the largest row sum of the matrix of all coordinates are zero
_TOLERANCE = 1e-7
# of the semidefinite and linear programs
_SOLVER_TOLERANCE = 1e-11
# directions that states of self stress hold by less, over the largest row sum, are tried as flexes
_NEARLY_ZERO = 1e-6
# of a row of the matrix and of the solution with it
_ROUNDING = 1e-15
# directions of two modes that are tried, and random starts of the search for a flex
_DIRECTIONS, _STARTS = 4096, 24
_SWEEPS = 12


@shown(
    lambda one: (
        f"first-order rigid: {one.first_order_rigid}, prestress stable: {one.prestress_stable}, "
        f"second-order rigid: {one.second_order_rigid}"
    )
)
@dataclass(frozen=True, eq=False)
class SecondOrder:
    """Whether a framework or packing is rigid to first order, prestress stable, and rigid to second order.

    Attributes
    ----------
    first_order_rigid, prestress_stable, second_order_rigid
        "yes", "no" or "ambiguous". Each implies the next.
    reason
        What decided.
    floppy_modes
        Number of motions, less the trivial ones, that change no member which a state of self stress can bear.
    self_stresses
        Number of independent states of self stress, whatever their signs, of members that can bear one.
    smallest_curvature
        Smallest eigenvalue of the form Q_w on the floppy modes for the stress that is given, of size 1 [1/length]; nan
        where there is none.
    curvature_error
        Bound on its error, by rounding and by what the modes stretch [1/length].
    largest_curvature
        No state of self stress of size 1 has a larger smallest eigenvalue [1/length]; nan where that is not known,
        beyond `size_limit` for one.
    trivial
        Number of trivial motions: translations, and where members join all particles and do not wind around the box
        also rotations and the admitted strains, which then strain nothing; none where particles are held.
    contacts, bonds, links
        Numbers of members among the particles that do not rattle.
    idle_contacts
        Number of contacts that bear no push in any state of self stress without pulls at contacts: they can open.
    rattlers
        Number of particles left out.
    i_e, j_e
        (E,) particles of the members: contacts, then bonds, then links.
    stress_e
        (E,) the state of self stress of size 1 whose form is the most definite that was found, positive for pushes;
        None where none was found or it does not fit the memory.
    first_nq, second_nq
        (N, q) a flex (q', q''): displacements and then turns as lengths, first and second derivatives, those of x in
        x + strain x; None unless one was found. Contacts that no state of self stress pushes open along it.
    first_dd, second_dd
        (d, d) strains of the box along it.
    flex_error
        Largest violation of a second-order condition by the flex, over the largest second derivative of a length [1].
    certain
        Whether counts stay the same for tolerances of the rank ten times looser and tighter, and all pushes were found.
    seconds
        CPU time.

    """

    first_order_rigid: str
    prestress_stable: str
    second_order_rigid: str
    reason: str
    floppy_modes: int
    self_stresses: int
    smallest_curvature: float
    curvature_error: float
    largest_curvature: float
    trivial: int
    contacts: int
    bonds: int
    links: int
    idle_contacts: int
    rattlers: int
    i_e: NDArray[np.int64]
    j_e: NDArray[np.int64]
    stress_e: NDArray[np.float64] | None
    first_nq: NDArray[np.float64] | None
    second_nq: NDArray[np.float64] | None
    first_dd: NDArray[np.float64] | None
    second_dd: NDArray[np.float64] | None
    flex_error: float
    certain: bool
    seconds: float


class _Members(NamedTuple):
    """Contacts, bonds and links of a network, and the rows of their lengths, in this order."""

    network: Network
    parts: tuple[Contacts | ShapeContacts, ...]
    rows: RigidityRows
    strain: BoxStrain

    @property
    def positions(self) -> int:
        """Number of coordinates of the particles."""
        return self.network.there_nq.size

    def bearing(self, keep_c: NDArray[np.bool_]) -> _Members:
        """Return the members without contacts that are not marked."""
        keep = np.concatenate([keep_c, np.ones(self.rows.links, dtype=bool)])
        contacts = self.network.contacts.select(np.flatnonzero(keep_c))
        rows = RigidityRows(
            sp.csr_array(self.rows.matrix[np.flatnonzero(keep)]), len(contacts), self.rows.strain_map,
            self.rows.pinned, self.rows.absent,
        )  # fmt: skip
        return self._replace(parts=(contacts, *self.parts[1:]), rows=rows)

    def strain_of(self, motion_x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the Mandel strain of a motion."""
        return np.asarray(self.rows.strain_map @ motion_x[self.positions :])

    def second(self, motion_x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (E,) second derivatives of the lengths along a motion, with what keeps a fixed volume."""
        network, d = self.network, self.network.dimension
        moved = motion_x[: self.positions].reshape(network.there_nq.shape)
        strain = self.strain_of(motion_x)
        tilt, turn = mandel_tensor(strain), np.einsum("nk,nkt->nt", moved[:, d:], network.turn_nkt)
        found = []
        for one in self.parts:
            change = moved[one.j_c, :d] - moved[one.i_c, :d] + one.vector_cd @ tilt
            if one.slope_cx.shape[1] > d:
                change = np.hstack([change, turn[one.i_c], turn[one.j_c]])
            bent = np.einsum("cx,cxy,cy->c", change, one.curvature_cxx, change)
            if self.strain == "isochoric":
                bent = bent + strain_columns(one) @ trace_vector(d) * (float(strain @ strain) / d)
            found.append(bent)
        return np.concatenate(found)

    def form(self, stress_e: NDArray[np.float64], motion_xm: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
        """Return the (M, M) form Q_w on motions, and the largest sum of a row of its matrix of all coordinates."""
        network, d = self.network, self.network.dimension
        ends = np.cumsum([len(one.i_c) for one in self.parts])[:-1]
        elements = [
            elements_of(one, -part, np.zeros(len(part)))
            for one, part in zip(self.parts, np.split(stress_e, ends), strict=True)
        ]
        found = assemble(elements, network.turn_nkt, d)
        everything = np.ones(self.positions, dtype=bool)
        matrix, column, corner = found.matrix(everything), found.column(everything), found.corner_ee
        if self.strain == "isochoric":
            trace = trace_vector(d)
            virial = sum(float((one.pull_cx[:, :d] * one.vector_cd).sum()) for one in elements)
            corner = corner - virial / d * (np.outer(trace, trace) - np.eye(len(trace)))
        place, strain = motion_xm[: self.positions], self.strain_of(motion_xm)
        mixed = place.T @ (column @ strain)
        value = place.T @ (matrix @ place) + mixed + mixed.T + strain.T @ (corner @ strain)
        return 0.5 * (value + value.T), float(abs(matrix).sum(axis=0).max())


def _network(scene: Scene, gap_tolerance: float | None) -> Network:
    """Return what does not rattle; where everything does, what links and bonds join, a framework by itself."""
    packing = scene.packing
    contacts = acting_contacts(touching_pairs(packing, gap_tolerance, second=True), scene.effects)
    kept = ~rattlers_among(packing, contacts, scene.effects)
    found = network_among(packing, contacts, kept, scene.effects, packing.turn_nkt)
    bars = len(found.links.links) + len(found.interactions)
    if len(found.contacts) or bars:
        return found
    joined = np.zeros(packing.particles, dtype=bool)
    everything = network_among(packing, contacts, ~joined, scene.effects, packing.turn_nkt)
    for one in (everything.links.pairs, everything.interactions.pairs):
        joined[one.i_c] = joined[one.j_c] = True
    return network_among(packing, contacts, joined, scene.effects, packing.turn_nkt)


def _members(network: Network, strain: BoxStrain) -> _Members:
    """Return the members of a network, with strains as columns of about the size of the others."""
    d, (particles, width) = network.dimension, network.there_nq.shape
    parts: tuple[Contacts | ShapeContacts, ...] = (network.contacts, network.interactions.pairs, network.links.pairs)
    position = sp.vstack([pair_rows(one.i_c, one.j_c, one.slope_cx, network.turn_nkt, d) for one in parts])
    admitted = strain_directions(d, strain)
    side = np.concatenate([strain_columns(one) for one in parts]) @ admitted
    matrix, scale = with_strains(position, side, particles * d)
    held = not np.array_equal(network.free_nq, network.there_nq)
    touches = sum(np.bincount(np.append(one.i_c, one.j_c), minlength=particles) for one in parts)
    pinned = width * int(np.argmax(touches)) + np.arange(0 if held else d)
    absent = np.flatnonzero(~network.free_nq.ravel())
    return _Members(network, parts, RigidityRows(matrix, len(parts[0].i_c), admitted * scale, pinned, absent), strain)


def _trivial(members: _Members) -> NDArray[np.float64]:
    """Return motions besides translations that move the members as one: (X, T), none where they wind around the box."""
    network, d = members.network, members.network.dimension
    (particles, width), columns = network.there_nq.shape, members.rows.matrix.shape[1]
    none = np.zeros((columns, 0))
    if not len(members.rows.pinned) or not members.rows.matrix.shape[0]:
        return none
    pairs = np.concatenate([np.column_stack([one.i_c, one.j_c, one.image_cd]) for one in members.parts])
    own = (pairs[:, 0] == pairs[:, 1]).any()
    pairs = np.unique(pairs, axis=0)
    if own:
        return none
    joined = Links(pairs[:, 0], pairs[:, 1], pairs[:, 2:], np.ones(len(pairs)))
    offset, winds = image_offsets(joined, particles)
    if winds.any() or len(np.unique(joined.clusters(particles))) > 1:
        return none
    place = network.packing.position_nd + offset @ network.packing.box.lattice_dd.T
    place = place - place.mean(axis=0)
    found = []
    turned, spin = turned_arms(place), np.linalg.pinv(network.turn_nkt)
    for k in range(turned.shape[2]):
        motion = np.zeros((particles, width))
        motion[:, :d] = turned[:, :, k]
        if width > d:
            motion[:, d:] = spin[:, k]
        found.append(np.append(motion.ravel(), np.zeros(columns - motion.size)))
    for k, strain in enumerate(members.rows.strain_map.T):
        motion = np.zeros((particles, width))
        motion[:, :d] = -place @ mandel_tensor(strain)
        found.append(np.append(motion.ravel(), np.eye(members.rows.strain_map.shape[1])[k]))
    left, value, _ = np.linalg.svd(np.array(found).T, full_matrices=False)
    # a straight row in space does not turn about itself
    return np.asarray(left[:, value > 1e-9 * value[0]])


def _motions(members: _Members, basis: NDArray[np.float64], trivial: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (X, M) orthonormal motions without the trivial ones, from a null space on the columns that can move."""
    rows, network = members.rows, members.network
    motion = np.zeros((rows.matrix.shape[1], basis.shape[1]))
    motion[rows.kept] = basis
    if len(rows.pinned):
        free = motion[: members.positions].reshape(*network.there_nq.shape, -1)[:, : network.dimension]
        free -= free.mean(axis=0)
    if motion.shape[1]:
        motion = orthonormal(motion)
    count = min(trivial.shape[1], motion.shape[1])
    if not count:
        return motion
    return np.asarray(motion @ np.linalg.qr(motion.T @ trivial, mode="complete")[0][:, count:])


def _pushing(members: _Members) -> tuple[NDArray[np.bool_], bool]:
    """Return (C,) which contacts some state of self stress pushes that pulls at none, and whether that is certain."""
    rows, count = members.rows.reduced.tocsr(), members.rows.contacts
    try:
        return pushing_rows(rows[:count], rows[count:]), True
    except np.linalg.LinAlgError:
        return np.ones(count, dtype=bool), False


def _into_cone(value_k: NDArray[np.float64], push_ck: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the projection of a vector onto the shares that push at every contact; all of it without contacts."""
    if not len(push_ck):
        return value_k
    return np.asarray(value_k + push_ck.T @ nnls(-push_ck.T, value_k)[0])


@dataclass(eq=False)
class _Search:
    """Motions that may extend to second order, and the first that was found to do so."""

    members: _Members
    whole: _Members
    bears_e: NDArray[np.bool_]
    stress_ek: NDArray[np.float64] | None
    motion_xm: NDArray[np.float64]
    rank_tolerance: float
    first_x: NDArray[np.float64] | None = None
    second_x: NDArray[np.float64] | None = None
    error: float = float("nan")
    # trace of the strain's second derivative at fixed volume
    volume: float = 0.0

    @functools.cached_property
    def idle(self) -> sp.csr_array:
        """The rows of the contacts that no state of self stress pushes."""
        return sp.csr_array(self.whole.rows.matrix[np.flatnonzero(~self.bears_e)])

    @functools.cached_property
    def opening_m(self) -> NDArray[np.float64] | None:
        """Shares of the floppy modes that open all idle contacts to first order; None without any, or if not found."""
        if not self.idle.shape[0]:
            return None
        kept, motion = self.whole.rows.kept, np.zeros(self.whole.rows.matrix.shape[1])
        idle, others = sp.csr_array(self.idle[:, kept]), sp.csr_array(self.members.rows.reduced)
        motion[kept] = inner_direction(idle, others, _SOLVER_TOLERANCE)
        share = self.motion_xm.T @ motion
        share = share / (float(np.linalg.norm(share)) or 1.0)
        return share if (self.idle @ (self.motion_xm @ share)).min() > self.still else None

    @property
    def still(self) -> float:
        """Rates of lengths along a motion of size 1 that are none [1]."""
        return 1e-9 * self.whole.rows.largest

    def finds(self, shares: Sequence[NDArray[np.float64]] | NDArray[np.float64]) -> bool:
        """Return whether what opens all idle contacts, or one of these combinations, extends to second order."""
        opening = [] if self.opening_m is None else [self.opening_m]
        return any(self.tries(share) for share in (*opening, *shares))

    def tries(self, share_m: NDArray[np.float64]) -> bool:
        """Return whether a combination of the floppy modes, or its opposite, extends to second order."""
        motion = self.motion_xm @ (share_m / np.linalg.norm(share_m))
        rate, limit = self.idle @ motion, self.still
        if len(rate) and rate.min() < -limit:
            if rate.max() > limit:
                return False
            motion, rate = -motion, -rate
        every = self.whole.second(motion)
        bent = every[self.bears_e]
        opened = self._opening(bent)
        second = self._solve(opened - bent)
        closing = rate <= limit
        second, closed = self._opened(second, self.idle[np.flatnonzero(closing)], every[~self.bears_e][closing])
        error = max(float(np.abs(self.members.rows.matrix @ second + bent - opened).max(initial=0.0)), closed)
        if error > self._rounding(motion, second):
            return False
        if self.members.strain == "isochoric":
            # the isotropic part that the second derivatives of the lengths hold already
            self.volume = float(np.square(self.members.strain_of(motion)).sum())
        self.first_x, self.second_x = motion, second
        self.error = error / (float(np.abs(every).max(initial=0.0)) or 1.0)
        return True

    def _opened(
        self, second_x: NDArray[np.float64], idle: sp.csr_array, bent_c: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], float]:
        """Return q'' with as much of what opens idle contacts as keeps them from closing, and how much they still do.

        These are idle contacts that q' leaves as they are: R q'' + b must not be negative.
        """
        closing = -(idle @ second_x + bent_c)
        if closing.max(initial=0.0) > 0.0 and self.opening_m is not None:
            opening = self.motion_xm @ self.opening_m
            second_x = second_x + float((closing / (idle @ opening)).max()) * opening
            closing = -(idle @ second_x + bent_c)
        return second_x, float(closing.max(initial=0.0))

    def _rounding(self, motion_x: NDArray[np.float64], second_x: NDArray[np.float64]) -> float:
        """Return what rounding and stretches of a motion may do to second derivatives of lengths [1/length]."""
        rows = self.members.rows
        gap, size = self.rank_tolerance * rows.largest, float(np.abs(motion_x).max())
        stretch = float(np.linalg.norm(rows.matrix @ motion_x)) + _ROUNDING * self.whole.rows.largest * size
        wrong = 8.0 * self.bend * size * (stretch / gap if gap > 0.0 else _ROUNDING)
        return wrong + 8.0 * _ROUNDING * self.whole.rows.largest * float(np.abs(second_x).max())

    @functools.cached_property
    def bend(self) -> float:
        """Largest sum of a row of second derivatives of a length [1/length]."""
        return max(float(np.abs(one.curvature_cxx).sum(axis=2).max(initial=0.0)) for one in self.whole.parts)

    def _opening(self, bent_e: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return second derivatives of the lengths, none negative, zero on bars, that balance those along a motion."""
        count, opened = self.members.rows.contacts, np.zeros(len(bent_e))
        if count == len(bent_e) and (bent_e >= 0.0).all():
            return bent_e
        if count and self.stress_ek is not None and self.stress_ek.shape[1]:
            opened[:count] = nnls(self.stress_ek[:count].T, self.stress_ek.T @ bent_e)[0]
        return opened

    def _solve(self, wanted_e: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the smallest motion whose rates of the lengths are nearest to those wanted."""
        rows = self.members.rows
        found = np.zeros(rows.matrix.shape[1])
        if not wanted_e.any():
            return found
        if rows.method == "dense":
            found[rows.kept] = np.linalg.lstsq(rows.reduced.toarray(), wanted_e, rcond=self.rank_tolerance)[0]
            return found
        reduced, factor = shifted_square(rows, self.rank_tolerance)
        part = np.zeros(reduced.shape[1])
        for _ in range(_SWEEPS):
            part = part + factor.solve(reduced.T @ (wanted_e - reduced @ part))
        found[rows.kept] = part
        return found

    def among(self, form_kmm: NDArray[np.float64], push_ck: NDArray[np.float64], span_mr: NDArray[np.float64]) -> bool:
        """Return whether a combination of some directions was found that no state of self stress holds."""
        inner = np.einsum("ma,kmn,nb->kab", span_mr, form_kmm, span_mr)

        def held(y: NDArray[np.float64]) -> NDArray[np.float64]:
            y = y / np.linalg.norm(y)
            return _into_cone(np.einsum("a,kab,b->k", y, inner, y), push_ck)

        count = span_mr.shape[1]
        starts = [*np.eye(count), *np.random.default_rng(0).normal(size=(_STARTS, count))]
        for start in starts[: count if count == 1 else None]:
            end = least_squares(held, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x if count > 1 else start
            if np.linalg.norm(held(end)) < _NEARLY_ZERO and self.tries(span_mr @ end):
                return True
        return False


def _held_everywhere(form_kmm: NDArray[np.float64], push_ck: NDArray[np.float64], tolerance: float) -> bool:
    """Return whether each direction of two modes has a state of self stress that holds it, by directions in between.

    Twice the angle turns a form from its mean to its deviator: nothing changes faster than the deviator is large.
    """
    angle = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    one, other, mixed = form_kmm[:, 0, 0], form_kmm[:, 1, 1], form_kmm[:, 0, 1]
    value = 0.5 * (one + other) + np.cos(angle)[:, None] * (0.5 * (one - other)) + np.sin(angle)[:, None] * mixed
    lowest = min(float(np.linalg.norm(_into_cone(each, push_ck))) for each in value)
    speed = float(np.hypot(np.linalg.norm(0.5 * (one - other)), np.linalg.norm(mixed)))
    return lowest - speed * np.pi / _DIRECTIONS > tolerance


class _Stress(NamedTuple):
    """The most definite form that was found: shares of the states of self stress, bounds, and directions of flexes."""

    share_k: NDArray[np.float64]
    lowest: float
    error: float
    bound: float
    size: float
    span_mr: NDArray[np.float64]


def _of_one(form_mm: NDArray[np.float64], pulls: bool, error: float, size: float) -> _Stress:
    """Return what the eigenvalues of the form of a single state of self stress say, of either sign where it may pull.

    A combination of the lowest and the highest eigenvector along which the form is zero extends where both signs do.
    """
    value, vector = np.linalg.eigh(form_mm)
    low, high = float(value[0]), float(value[-1])
    sign = -1.0 if pulls and -high > low else 1.0
    lowest = low if sign > 0.0 else -high
    span = vector[:, :1]
    if pulls and low < 0.0 < high:
        span = (np.sqrt(high) * vector[:, 0] + np.sqrt(-low) * vector[:, -1])[:, None]
    elif sign < 0.0:
        span = vector[:, -1:]
    return _Stress(np.array([sign]), lowest, error, lowest, size, span)


def _error_of(search: _Search, size: float) -> float:
    """Return what rounding, stretches of the modes and unbalanced forces may do to an eigenvalue of the form."""
    members, stress = search.members, search.stress_ek
    assert stress is not None
    rows = members.rows
    gap = search.rank_tolerance * rows.largest
    stretch = float(np.linalg.norm(rows.matrix @ search.motion_xm))
    net = float(np.linalg.norm(rows.reduced.T @ stress))
    return float((2.0 * size * stretch + 4.0 * search.bend * net) / gap + 1e-15 * search.motion_xm.shape[1] * size)


@shown_as("rigidity to second order")
@honors("repulsion kinds bonds held links shapes", at_rest=True)
def second_order(
    scene: Scene | Packing,
    *,
    strain: BoxStrain = "none",
    gap_tolerance: float | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    tolerance: float = _TOLERANCE,
    size_limit: int = 60,
    basis_limit: float = BASIS_LIMIT,
) -> SecondOrder:
    """Return whether a framework or packing is rigid to first order, prestress stable, and rigid to second order.

    Members are the contacts of the packing, which can open and push only, its rigid links, and the bonds of the scene,
    which keep their lengths and bear forces of either sign: forces are not those of the laws, but any in balance.
    Particles that are held move nowhere; where none is, translations are trivial, and so are rotations of what its
    members join without winding around the box. Rattlers are left out; where all rattle, what links and bonds join is
    judged by itself. A rigid body that turns about the only bead that it touches with moves.

    Answers in floating-point numbers: "yes" needs a form that is positive on all floppy modes by more than its error
    and the tolerance, "no" a bound on all forms (the dual of the semidefinite program) that is zero within the error
    and for `second_order_rigid` a flex that meets the conditions of second order within rounding. All else is
    "ambiguous", what holds by less than the tolerance too. Without any state of self stress every floppy mode extends:
    "no". Where all particles are held the answer is "yes", where all others rattle "no", without a flex. With one
    state of self stress, or two and no contacts beside three floppy modes or more, prestress stable and second-order
    rigid are the same; with two floppy modes every direction is looked at.

    Parameters
    ----------
    scene
        The scene, or a packing: laws do not matter.
    strain
        What the box may do: "none", "isotropic", "isochoric" (at fixed volume, to second order too) or "free"; "none"
        where particles are held.
    gap_tolerance, rank_tolerance, basis_limit
        As in `floppy_modes`.
    tolerance
        Smallest eigenvalue of a form, over the largest row sum of its matrix of all coordinates, that counts as
        positive [1].
    size_limit
        Largest number of floppy modes, and of states of self stress, of which the semidefinite program is solved; a
        single state of self stress has no such limit. Beyond it one stress, nearest to equal pushes, is tried.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, bonds have tangential springs, or the floppy modes fill the memory.

    Examples
    --------
    Two bars on a line between held ends: a pull holds the joint, which is free to first order.

    >>> import packmech as pm
    >>> row = pm.Packing([[1.0, 2.0], [2.0, 2.0], [3.0, 2.0]], [0.2, 0.2, 0.2], pm.Box.cubic(4.0, 2))
    >>> bars = pm.Bonds([0, 1], [1, 2], [[0, 0], [0, 0]], [1.0, 1.0], tangential_stiffness=0.0)
    >>> found = pm.second_order(pm.Scene(row, (bars, pm.FixedParticles((0, 2)))))
    >>> found.first_order_rigid, found.prestress_stable, (found.stress_e < 0.0).tolist()
    ('no', 'yes', [True, True])

    """
    start = time.process_time()
    if isinstance(scene, Packing):
        scene = Scene(scene, ())
    instance("scene", scene, Scene)
    one_of("strain", strain, STRAINS)
    check_strain_of_box(scene, strain)
    real("rank_tolerance", rank_tolerance, above=0.0, below=0.1)
    real("tolerance", tolerance, above=0.0, below=0.1)
    integer("size_limit", size_limit, at_least=1)
    positive("basis_limit", basis_limit)
    refuse_tangential_springs(scene.effects)
    with single_thread():
        network = _network(scene, gap_tolerance)
        if not len(network.index_n):
            return _nothing(scene, start)
        whole = _members(network, strain)
        pushing, sure = _pushing(whole)
        members = whole.bearing(pushing)
        rows, idle = members.rows, int((~pushing).sum())
        rank, certain, count, basis = null_space(rows, rows.method, rank_tolerance, basis_limit, left=False)
        if basis is None:
            raise ValueError(f"basis_limit must hold the floppy modes, got {basis_limit:g} bytes for {count} modes")
        trivial = _trivial(whole)
        motion = _motions(members, basis, trivial)
        states = rows.matrix.shape[0] - rank
        bears = np.append(pushing, np.ones(whole.rows.links, dtype=bool))
        search = _Search(members, whole, bears, None, motion, rank_tolerance)
        answers, reason, best = _answers(search, states, (size_limit, basis_limit, tolerance))
        certain = certain and sure
        if not certain:
            answers, reason = (AMBIGUOUS,) * 3, f"the rank of the members is not certain ({reason})"
    stress = None
    if best is not None and search.stress_ek is not None:
        stress = np.zeros(whole.rows.matrix.shape[0])
        stress[bears] = search.stress_ek @ best.share_k
    flex = _flex(scene.packing, search)
    return SecondOrder(
        *answers, reason,
        floppy_modes=motion.shape[1],
        trivial=len(rows.pinned) + trivial.shape[1],
        self_stresses=states,
        contacts=whole.rows.contacts,
        bonds=len(network.interactions),
        links=len(network.links.links),
        idle_contacts=idle,
        rattlers=scene.packing.particles - len(network.index_n),
        smallest_curvature=np.nan if best is None else best.lowest,
        curvature_error=np.nan if best is None else best.error,
        largest_curvature=best.bound if best is not None and np.isfinite(best.bound) else np.nan,
        i_e=network.index_n[np.concatenate([one.i_c for one in whole.parts])],
        j_e=network.index_n[np.concatenate([one.j_c for one in whole.parts])],
        stress_e=stress,
        first_nq=flex[0], second_nq=flex[1], first_dd=flex[2], second_dd=flex[3],
        flex_error=search.error,
        certain=certain,
        seconds=time.process_time() - start,
    )  # fmt: skip


def _nothing(scene: Scene, start: float) -> SecondOrder:
    """Return the answer for a packing whose particles all rattle or are held."""
    nan, none = float("nan"), np.zeros(0, dtype=np.int64)
    particles, trivial, answer, reason = scene.packing.particles, scene.packing.dimension, NO, "all particles rattle"
    held = held_particles(scene.effects, particles)
    if held is not None and held.any():
        trivial, particles = 0, int(np.count_nonzero(~held))
        answer, reason = (NO, f"{reason} or are held") if particles else (YES, "all particles are held")
    return SecondOrder(
        answer, answer, answer, reason, 0, 0, nan, nan, nan, trivial, 0, 0, 0, 0, particles,
        none, none, None, None, None, None, None, nan, True, time.process_time() - start,
    )  # fmt: skip


def _answers(
    search: _Search, states: int, limits: tuple[int, float, float]
) -> tuple[tuple[str, str, str], str, _Stress | None]:
    """Return the three answers, what decided, and the best stress; the search then holds the flex."""
    members, (size_limit, basis_limit, tolerance) = search.members, limits
    rows, modes = members.rows, search.motion_xm.shape[1]
    if not modes:
        if search.idle.shape[0]:
            return (AMBIGUOUS,) * 3, "contacts that no state of self stress pushes, and no floppy modes", None
        return (YES, YES, YES), "no floppy modes", None
    if states:
        _, _, _, search.stress_ek = null_space(rows, rows.method, search.rank_tolerance, basis_limit, left=True)
    if not states:
        search.finds(np.eye(modes)[:size_limit])
        return (NO, NO, NO), "no state of self stress to hold the floppy modes", None
    if search.stress_ek is None:
        answer = NO if search.finds(np.eye(modes)[:1]) else AMBIGUOUS
        return (NO, answer, answer), "the states of self stress do not fit the memory", None
    best, forms, push, status = _most_stable(search, states, size_limit)
    if best is None:
        answer = NO if search.finds(np.eye(modes)[:1]) else AMBIGUOUS
        return (NO, answer, answer), "no state of self stress was found that pulls at no contact", None
    scale = best.size or 1.0
    if best.lowest - best.error > tolerance * scale:
        return (NO, YES, YES), "a state of self stress holds all floppy modes", best
    if best.lowest > best.error:
        return (NO, AMBIGUOUS, AMBIGUOUS), "a state of self stress holds all floppy modes by less than tolerance", best
    if search.finds(() if forms is not None else best.span_mr.T[:1]) or (
        forms is not None and search.among(forms / scale, push, best.span_mr)
    ):
        return (NO, NO, NO), "a flex of second order", best
    stable = AMBIGUOUS
    if not search.idle.shape[0] and best.bound <= best.error:
        stable = NO
    enough = tolerance + best.error / scale
    if forms is not None and modes == 2 and states > 1 and _held_everywhere(forms / scale, push, enough):
        return (NO, stable, YES), "each direction of two floppy modes has a state of self stress that holds it", best
    known = (
        "no state of self stress holds all floppy modes" if stable == NO else f"no stress that holds was found{status}"
    )
    return (NO, stable, AMBIGUOUS), f"{known}, and no flex was found", best


def _most_stable(
    search: _Search, states: int, size_limit: int
) -> tuple[_Stress | None, NDArray[np.float64] | None, NDArray[np.float64], str]:
    """Return the most definite form on the floppy modes, those of all states, their pushes, and how a solver failed.

    None instead of a form where no state of self stress was found that pulls at no contact.
    """
    members, stress, motion = search.members, search.stress_ek, search.motion_xm
    assert stress is not None
    contacts = members.rows.contacts
    push = stress[:contacts]
    if states == 1:
        if contacts:
            stress *= np.sign(push.sum())
            if push.min() < 0.0:
                return None, None, push, ""
        form, size = members.form(stress[:, 0], motion)
        return _of_one(form, not contacts, _error_of(search, size), size), form[None], push, ""
    if max(states, motion.shape[1]) <= size_limit:
        both = [members.form(one, motion) for one in stress.T]
        forms = np.array([form for form, _ in both])
        found = most_definite(forms, push, _SOLVER_TOLERANCE)
        value, vector = np.linalg.eigh(found.weight_mm)
        size = float(np.linalg.norm([size for _, size in both]))
        span = vector[:, value > _NEARLY_ZERO * value[-1]]
        bound = max(found.bound, found.lowest)
        status = "" if found.solve.outcome is Outcome.CONVERGED else f" ({found.solve.status})"
        return _Stress(found.share_k, found.lowest, _error_of(search, size), bound, size, span), forms, push, status
    # pushes, or pulls of bars, as equal as they can be in balance
    share = push.sum(axis=0) if contacts else stress.sum(axis=0)
    pushing = pushing_share(share / (float(np.linalg.norm(share)) or 1.0), push, _SOLVER_TOLERANCE)
    if pushing is None:
        return None, None, push, ""
    form, size = members.form(stress @ pushing, motion)
    best = _of_one(form, not contacts, _error_of(search, size), size)
    return best._replace(share_k=best.share_k[0] * pushing, bound=np.inf), None, push, ""


def _flex(packing: Packing, search: _Search) -> tuple[NDArray[np.float64] | None, ...]:
    """Return a flex for all particles: first and second derivatives, then those of the strain; Nones without one."""
    if search.first_x is None or search.second_x is None:
        return None, None, None, None
    members, network = search.members, search.members.network
    moved, strained = [], []
    for motion in (search.first_x, search.second_x):
        whole = np.zeros((packing.particles, network.there_nq.shape[1]))
        whole[network.index_n] = motion[: members.positions].reshape(network.there_nq.shape)
        moved.append(whole)
        strained.append(mandel_tensor(members.strain_of(motion)))
    strained[1] = strained[1] + np.eye(packing.dimension) * (search.volume / packing.dimension)
    return *moved, *strained
