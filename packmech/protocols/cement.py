"""`cement`: random contacts of a jammed packing become rigid links, and the moduli are followed.

The compliance is updated as pairs of particles are held at their distance, one after another.
"""

from __future__ import annotations

import copy
import dataclasses
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg as sl
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import Kind, brief, entries, instance, integer, one_of, positive, real
from packmech.contacts import Contacts, find_contacts
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import mandel_basis, trace_vector
from packmech.links import Links
from packmech.mechanics.elasticity import Average, inverse_across, universal_anisotropy, voigt_average
from packmech.mechanics.network import contact_network
from packmech.mechanics.self_stress import states_of_self_stress
from packmech.mechanics.system import assembled_system, bordered, closed_terms
from packmech.packing import Packing
from packmech.scene import Scene

FREEZE = ("angles", "clusters", "nothing")
ORDERS = ("random", "aggregate")
MODULI = ("bulk", "shear")
AVERAGES = ("reuss", "hill", "voigt")


class HeldPair(NamedTuple):
    """Two particles at the image and the vector from one to the other; `shape` marks all but the contact itself."""

    i: int
    j: int
    image: tuple[int, ...]
    vector: NDArray[np.float64]
    shape: bool


def canonical(pair: HeldPair) -> tuple[int, int, tuple[int, ...]]:
    """Return the particles and the image of a pair as `Links` names it."""
    back = tuple(-z for z in pair.image)
    if pair.i > pair.j or (pair.i == pair.j and pair.image < back):
        return pair.j, pair.i, back
    return pair.i, pair.j, pair.image


def own_pairs(packing: Packing) -> list[HeldPair]:
    """Return the pairs that the packing's own links hold."""
    links = packing.links
    vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
    rows = zip(links.i_l.tolist(), links.j_l.tolist(), links.image_ld.tolist(), vector, links.shape_l, strict=True)
    return [HeldPair(i, j, tuple(image), one, bool(shape)) for i, j, image, one, shape in rows]


class Cement:
    """Contacts cemented one after another, and the new pairs that each of them holds at a fixed distance.

    With "angles", any two particles cemented to the same third keep their distance: bond angles are frozen, turns about
    a bond stay free. With "clusters", all particles that are cemented together, directly or not, move as one body.
    With "nothing", the contact alone keeps its length. Links that the packing has count as cemented where angles are
    frozen, but for those that hold a shape themselves; angles between two of them stay free, and they make no body of a
    chain.
    """

    def __init__(self, contacts: Contacts, packing: Packing) -> None:
        self._contacts = contacts
        self._place = packing.position_nd
        self._lattice = packing.box.lattice_dd
        own = own_pairs(packing)
        self._seen = {canonical(pair) for pair in own}
        self._around: dict[int, list[tuple[int, NDArray[np.int64], NDArray[np.float64]]]] = {}
        for pair in own:
            if not pair.shape:
                self._join(pair.i, pair.j, np.array(pair.image), pair.vector)
        # clusters: number of each particle's, its members, and the images that unwrap them
        self._cluster = np.arange(contacts.particles)
        self._members = [[n] for n in range(contacts.particles)]
        self._offset = np.zeros((contacts.particles, contacts.dimension), dtype=np.int64)

    def add(self, contact: int, freeze: str) -> list[HeldPair]:
        """Return the pairs that are held once this contact is cemented and that were not named before."""
        c = self._contacts
        i, j = int(c.i_c[contact]), int(c.j_c[contact])
        image, vector = c.image_cd[contact], c.vector_cd[contact]
        pairs = [HeldPair(i, j, tuple(image.tolist()), vector, False)]
        if freeze == "angles":
            pairs += self._angles(i, j, image, vector)
        elif freeze == "clusters":
            pairs += self._bodies(i, j, image)
        new = []
        for pair in pairs:
            key = canonical(pair)
            if key not in self._seen and (pair.i != pair.j or any(pair.image)):
                self._seen.add(key)
                new.append(pair)
        return new

    def _angles(self, i: int, j: int, image: NDArray[np.int64], vector: NDArray[np.float64]) -> Iterator[HeldPair]:
        for k, its_image, its_vector in self._around.get(i, []):
            yield HeldPair(k, j, tuple((image - its_image).tolist()), vector - its_vector, True)
        for k, its_image, its_vector in self._around.get(j, []):
            yield HeldPair(i, k, tuple((image + its_image).tolist()), vector + its_vector, True)
        self._join(i, j, image, vector)

    def _join(self, i: int, j: int, image: NDArray[np.int64], vector: NDArray[np.float64]) -> None:
        self._around.setdefault(i, []).append((j, image, vector))
        self._around.setdefault(j, []).append((i, -image, -vector))

    def _unwrapped(self, member: list[int]) -> NDArray[np.float64]:
        place: NDArray[np.float64] = self._place[member] + self._offset[member] @ self._lattice.T
        return place

    def _frame(self, n: int) -> list[int]:
        """Return up to three members of a particle's cluster, itself first, that span the widest triangle with it."""
        member = self._members[self._cluster[n]]
        if len(member) <= 3:
            return member
        arm = self._unwrapped(member) - self._unwrapped([n])
        far = int((arm**2).sum(axis=1).argmax())
        along = arm[far] / np.sqrt(arm[far] @ arm[far])
        aside = arm - np.outer(arm @ along, along)
        return [n, member[far], member[int((aside**2).sum(axis=1).argmax())]]

    def _bodies(self, i: int, j: int, image: NDArray[np.int64]) -> list[HeldPair]:
        # the image of j's cluster that touches i's, once both are unwrapped
        apart = image + self._offset[i] - self._offset[j]
        one, other = int(self._cluster[i]), int(self._cluster[j])
        if one == other and not apart.any():
            return []
        pairs = []
        for a in self._frame(i):
            for b in self._frame(j):
                reach = apart - self._offset[a] + self._offset[b]
                vector = self._place[b] - self._place[a] + self._lattice @ reach
                pairs.append(HeldPair(a, b, tuple(reach.tolist()), vector, True))
        if one != other:
            if len(self._members[one]) < len(self._members[other]):
                one, other, apart = other, one, -apart
            moved = self._members[other]
            self._offset[moved] += apart
            self._cluster[moved] = one
            self._members[one] = self._members[one] + moved
            self._members[other] = []
        return pairs


# part of a row across those before it, below which it depends on them. New rows have 1e-7 and more, most 1e-3;
# redundant ones 1e-12 until a row of small part p has come, 1e-16/p from then on
DEPENDENT = 1e-8
# strains that stresses make, over those before cementing (both in the metric of the Hessian), below which none is left
STIFF = 1e-7
_SOFT = 1e-12
# motions of length 1 that cost nothing carry no strain where they strain by less than this; most do by 1e-14
_CARRIES = 1e-6


@dataclasses.dataclass(frozen=True, eq=False)
class Backbone:
    """The backbone of a packing with its Hessian factored and inverted, to be cemented many times.

    Attributes
    ----------
    contacts
        Contacts among all particles of the packing, those of rattlers left out.
    place_c
        For every contact of the packing its place among these, -1 for those of rattlers.
    bearing
        Number of particles that bear force.
    self_stress
        States of self stress, the box free to change its shape but not its volume.
    own
        Pairs that the packing's own links hold among them.
    inverse_xm
        (N d + s, M) columns with inverse_xm inverse_xm^T the inverse of the Hessian, on what costs energy; zero rows
        for what does not move.
    zero_xz
        (N d + s, Z) orthonormal motions that cost nothing and strain nothing, such as turns of a chain's end; None
        where there are none.
    length, volume
        Scale of the strains, and volume of the box.

    """

    scene: Scene
    contacts: Contacts
    place_c: NDArray[np.int64]
    bearing: int
    self_stress: int
    own: list[HeldPair]
    inverse_xm: NDArray[np.float64]
    zero_xz: NDArray[np.float64] | None
    length: float
    volume: float

    @property
    def strain_em(self) -> NDArray[np.float64]:
        """(s, M) strains in the metric of the Hessian."""
        d = self.contacts.dimension
        columns: NDArray[np.float64] = self.inverse_xm[-(d * (d + 1) // 2) :] / self.length
        return columns

    def rows(self, pairs: list[HeldPair], motion_xm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (B, M) changes of the pairs' distances by each of the motions."""
        d = self.contacts.dimension
        i, j = (d * np.array([pair[k] for pair in pairs], dtype=np.int64) for k in (0, 1))
        vector = np.array([pair.vector for pair in pairs])
        distance = np.sqrt((vector**2).sum(axis=1))
        normal = vector / distance[:, None]
        rows = np.zeros((len(pairs), motion_xm.shape[1]))
        for a in range(d):
            rows += normal[:, a, None] * (motion_xm[j + a] - motion_xm[i + a])
        for strain, columns in zip(mandel_basis(d), motion_xm[self.scene.packing.particles * d :], strict=True):
            stretch = distance * ((normal @ strain) * normal).sum(axis=1) / self.length
            rows += stretch[:, None] * columns
        return rows


# of the springs in place of links, over the mean contact's: the first that lets no motion lower the energy
LINK_STIFFNESS = (1.0, 1e2, 1e4)


def backbone_of(scene: Scene, kind: Kind, gap_tolerance: float | None) -> Backbone:
    """Return the factored backbone of a packing.

    Raises
    ------
    ValueError
        If no contacts bear force, some strain costs nothing, or some motion or strain lowers the energy.

    """
    packing = scene.packing
    held = contact_network(packing, gap_tolerance=gap_tolerance)
    contacts, d = held.contacts, packing.dimension
    if not len(contacts):
        raise ValueError("scene.packing must be jammed, got one whose particles all rattle")
    terms = closed_terms(scene, contacts)
    free = held.pinned_f
    volume = packing.box.volume
    length = float(volume ** (1.0 / d))
    strains = d * (d + 1) // 2

    def parts(stiffness: float) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        # links as stiff springs: what they hold later is not changed
        system = assembled_system(scene, held, kind, link_stiffness=stiffness * float(terms.second_c.mean()))
        whole = bordered(system.matrix(free), system.column(free), system.corner).toarray()
        whole[-strains:] /= length
        whole[:, -strains:] /= length
        return _inverted(whole, strains)

    # compressed links make room for motions that lower the energy where they are not stiff enough (Finsler's lemma)
    last = LINK_STIFFNESS[0] if not held.links or kind == "unstressed" else LINK_STIFFNESS[-1]
    for stiffness in LINK_STIFFNESS:
        try:
            inverse, zero = parts(stiffness)
            break
        except ValueError:
            if stiffness == last:
                raise
    moving = (held.index_n[:, None] * d + np.arange(d)).ravel()[free]

    def spread(motion: NDArray[np.float64]) -> NDArray[np.float64]:
        rows = np.zeros((packing.particles * d + strains, motion.shape[1]))
        rows[moving] = motion[:-strains]
        rows[-strains:] = motion[-strains:]
        return rows

    wide, still = spread(inverse), None if zero is None else spread(zero)
    found = find_contacts(packing, gap_tolerance=gap_tolerance)
    bears = np.zeros(packing.particles, dtype=bool)
    bears[held.index_n] = True
    own = [pair for pair in own_pairs(packing) if bears[pair.i] and bears[pair.j]]
    kept = bears[found.i_c] & bears[found.j_c]
    place = np.where(kept, np.cumsum(kept) - 1, -1)
    if not packing.links:
        motions = d * (contacts.particles - 1) + strains - 1
        self_stress = len(contacts) - motions + (0 if zero is None else zero.shape[1])
    else:
        # motions that only the links' tension resists count as well
        self_stress = states_of_self_stress(packing, strain="isochoric", gap_tolerance=gap_tolerance).count
    return Backbone(scene, found.select(kept), place, len(held.index_n), self_stress, own, wide, still, length, volume)


def _inverted(whole: NDArray[np.float64], strains: int) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Return columns that make up the inverse of a Hessian with its strains last, and motions that cost nothing."""
    try:
        factor = sl.cholesky(whole, lower=True, overwrite_a=False, check_finite=False)
    except sl.LinAlgError:
        factor = None
    if factor is not None and (np.diag(factor) ** 2).min() > _SOFT * np.diag(whole).max():
        inverse = sl.solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False, overwrite_b=True)
        return inverse.T, None
    value, vector = np.linalg.eigh(whole)
    small = _SOFT * value[-1]
    firm = value > small
    zero = vector[:, ~firm]
    if value[0] < -small or np.linalg.norm(zero[-strains:], 2) > _CARRIES:
        raise ValueError(
            "scene.packing must resist every strain (shear-stabilized: jam with strain='free'), got one with a strain "
            "that costs nothing or a direction that lowers the energy"
        )
    zero[-strains:] = 0.0
    return vector[:, firm] / np.sqrt(value[firm]), zero


class _ZeroModes:
    """Motions that cost nothing, of which pairs take one after another before they hold anything else.

    A pair that changes with a motion not taken so far fixes how far that goes and resists no strain. Where its part in
    such motions is a sum of earlier pairs', the same sum taken from it is left for what costs energy.
    """

    def __init__(self, backbone: Backbone, zero_xz: NDArray[np.float64]) -> None:
        self._backbone, self._zero = backbone, zero_xz
        inverse = backbone.inverse_xm
        # no gradient of length 1 is shorter than this where all of it costs energy
        self._shortest = float(np.sqrt((inverse**2).sum(axis=0).min()))
        # orthonormal parts taken, and the rows that go with them
        self.taken = np.zeros((0, zero_xz.shape[1])), np.zeros((0, inverse.shape[1]))

    def take(self, pairs: list[HeldPair]) -> tuple[list[int], list[int], NDArray[np.float64]]:
        """Return which pairs take a motion, which do not, and the rows that these leave, of length about 1."""
        zero, rows = self._backbone.rows(pairs, self._zero), self._backbone.rows(pairs, self._backbone.inverse_xm)
        size = np.sqrt((rows**2).sum(axis=1)) + self._shortest
        part, going = self.taken
        for _ in range(2):
            share = zero @ part.T
            zero, rows = zero - share @ part, rows - share @ going
            size = size + np.abs(share) @ np.sqrt((going**2).sum(axis=1))
        q, triangle, order = sl.qr(zero.T, mode="economic", pivoting=True, check_finite=False)
        count = int(np.count_nonzero(np.abs(np.diag(triangle)) > DEPENDENT))
        first, rest = order[:count], order[count:]
        # zero[order] = triangle^T q^T: rows of the new parts, and their share in the other pairs
        if not count:
            return [], list(range(len(pairs))), rows / size[:, None]
        new = sl.solve_triangular(triangle[:count, :count], rows[first], trans=1, check_finite=False)
        share = triangle[:count, count:].T
        size = size[rest] + np.abs(share) @ np.sqrt((new**2).sum(axis=1))
        left = (rows[rest] - share @ new) / size[:, None]
        self.taken = np.concatenate([part, q[:, :count].T]), np.concatenate([going, new])
        return first.tolist(), rest.tolist(), left


class HeldCompliance:
    """The compliance of a backbone, updated as pairs are held."""

    def __init__(self, backbone: Backbone) -> None:
        self._backbone = backbone
        self._basis = np.empty((backbone.inverse_xm.shape[1], backbone.inverse_xm.shape[1]))
        self._strain = backbone.strain_em
        self._scale = float(np.sqrt((self._strain**2).sum(axis=1).max()))
        self.rank = 0
        self._free = None if backbone.zero_xz is None else _ZeroModes(backbone, backbone.zero_xz)
        # parts of rows across those before: the smallest that counted, and the largest that did not
        self.smallest_new, self.largest_old = 1.0, 0.0

    def saved(self) -> dict[str, Any]:
        """Return what `restore` needs to come back here; rows of the basis beyond the rank are of no matter."""
        return {**vars(self), "_free": copy.copy(self._free)}

    def restore(self, state: dict[str, Any]) -> None:
        """Take back what was held since."""
        vars(self).update(state)

    def hold(self, pairs: list[HeldPair]) -> list[int]:
        """Hold the pairs; return which of them are independent of each other and of those before, in order."""
        room = len(self._basis) - self.rank
        if not pairs or not room:
            return []
        if self._free is None:
            taking: list[int] = []
            number = list(range(len(pairs)))
            rows = self._backbone.rows(pairs, self._backbone.inverse_xm)
            rows /= np.sqrt((rows**2).sum(axis=1))[:, None]
        else:
            taking, number, rows = self._free.take(pairs)
            if not number:
                return sorted(taking)
        basis = self._basis[: self.rank]
        for _ in range(2):
            rows -= (rows @ basis.T) @ basis
        q, triangle, order = sl.qr(rows.T, mode="economic", pivoting=True, check_finite=False)
        part = np.abs(np.diag(triangle))
        count = min(int(np.count_nonzero(part > DEPENDENT)), room)
        if count < len(part):
            self.largest_old = max(self.largest_old, float(part[count]))
        if not count:
            return sorted(taking)
        self.smallest_new = min(self.smallest_new, float(part[count - 1]))
        # parts that are small lose their right angle to the basis in proportion
        new = q[:, :count].T
        new = new - (new @ basis.T) @ basis
        new = sl.qr(new.T, mode="economic", check_finite=False)[0].T
        self._basis[self.rank : self.rank + count] = new
        self.rank += count
        self._strain = self._strain - (self._strain @ new.T) @ new
        return sorted(taking + [number[k] for k in order[:count]])

    def stiff_directions(self) -> NDArray[np.float64]:
        """Return the (k, s) orthonormal strains that the held pairs forbid."""
        direction, size, _ = np.linalg.svd(self._strain, full_matrices=False)
        stiff: NDArray[np.float64] = direction.T[size <= STIFF * self._scale]
        return stiff

    def compliance(self) -> NDArray[np.float64]:
        """Return the (s, s) compliance [length^d/energy] in Mandel components, zero along the stiff directions."""
        stiff = self.stiff_directions()
        across = np.eye(len(self._strain)) - stiff.T @ stiff
        strain = across @ self._strain
        if len(stiff) == len(strain):
            strain = np.zeros_like(strain)
        product: NDArray[np.float64] = self._backbone.volume * (strain @ strain.T)
        return product


KINDS: tuple[Kind, ...] = ("unstressed", "exact")


@shown()
@dataclass(frozen=True, eq=False)
class Cementing:
    """Moduli of a packing while its contacts are cemented one after another, at steps k.

    Attributes
    ----------
    packing
        The packing before cementing.
    contact_l
        Contacts in the order of cementing, as numbers in `find_contacts(packing)`; as many as were cemented.
    cemented_k
        (K,) contacts cemented at each step: n_l. Links that freeze angles do not count, those of contacts that were
        held already do.
    compliance_kee
        (K, s, s) compliance in Mandel components [length^d/energy], zero along stiff directions.
    stiff_k
        (K,) number of infinitely stiff directions of strain.
    first_stiff, all_stiff
        n_l at which the first direction of strain became infinitely stiff, and all of them: complete rigidity. None
        where cementing ended before.
    first_direction_ke
        (k, s) orthonormal strains that became stiff at `first_stiff`; none where none did.
    links
        The links that hold the packing at the last step besides its own, as many as are independent of each other and
        of these; those besides the cemented contacts are marked as holding a shape.
    added_l
        (L,) n_l at which each of these links came.
    self_stress
        States of self stress of the packing before cementing, the box free to change its shape but not its volume.
    bearing
        Particles that bear force; the others rattle.
    freeze, kind
        As given.
    smallest_new, largest_old
        Parts of links' gradients across those before [1]: the smallest that was taken for independent, the largest that
        was taken for rounding. Counts are safe where these are far apart.
    seconds
        CPU time.

    """

    packing: Packing
    contact_l: NDArray[np.int64]
    cemented_k: NDArray[np.int64]
    compliance_kee: NDArray[np.float64]
    stiff_k: NDArray[np.int64]
    first_stiff: int | None
    all_stiff: int | None
    first_direction_ke: NDArray[np.float64]
    links: Links
    added_l: NDArray[np.int64]
    self_stress: int
    bearing: int
    freeze: str
    kind: Kind
    smallest_new: float
    largest_old: float
    seconds: float

    @property
    def curves(self) -> dict[str, NDArray[np.float64]]:
        """(K,) arrays by name, what the calls below return at each step.

        bulk_reuss, bulk_hill, bulk_voigt, shear_reuss, shear_hill, shear_voigt [energy/length^d], infinite where a
        strain is forbidden; anisotropy [1], infinite once a Voigt average is; poisson [1].
        """
        steps = range(len(self.cemented_k))
        averages = {name: [getattr(self, name)(k) for k in steps] for name in AVERAGES}
        found = {
            f"{modulus}_{name}": np.array([getattr(one, f"{modulus}_modulus") for one in averages[name]])
            for modulus in MODULI
            for name in averages
        }
        found["anisotropy"] = np.array([self.anisotropy(k) for k in steps])
        found["poisson"] = np.array([self.poisson_ratio(k) for k in steps])
        return found

    @property
    def link_fraction_k(self) -> NDArray[np.float64]:
        """n_l/N at each step, N all particles of the packing [1]."""
        fraction: NDArray[np.float64] = self.cemented_k / self.packing.particles
        return fraction

    def voigt(self, step: int) -> Average:
        """Return the Voigt average at a step: the response to imposed strains, infinite once a strain is forbidden."""
        return _bounds(self.compliance_kee[step])[1]

    def reuss(self, step: int) -> Average:
        """Return the Reuss average at a step: the response to imposed stresses."""
        return _bounds(self.compliance_kee[step])[0]

    def hill(self, step: int) -> Average:
        """Return the mean of the Voigt and Reuss averages at a step."""
        low, high = _bounds(self.compliance_kee[step])
        bulk, shear = (low.bulk_modulus + high.bulk_modulus) / 2.0, (low.shear_modulus + high.shear_modulus) / 2.0
        return Average(bulk, shear, low.dimension)

    def anisotropy(self, step: int) -> float:
        """Return the universal anisotropy at a step, `universal_anisotropy` of its averages [1]; inf once one is."""
        low, high = _bounds(self.compliance_kee[step])
        return universal_anisotropy(high, low)

    def poisson_ratio(self, step: int) -> float:
        """Return the Poisson ratio [1] of the mean of the bounds, or of the lower one where the upper is infinite.

        nan at complete rigidity.
        """
        low, high = _bounds(self.compliance_kee[step])
        if np.isinf(high.bulk_modulus) or np.isinf(high.shear_modulus):
            return low.poisson_ratio
        return self.hill(step).poisson_ratio

    def packing_at(self, step: int) -> Packing:
        """Return the packing with the links that hold it at a step."""
        keep, own = self.added_l <= self.cemented_k[step], self.packing.links
        if not keep.any():
            return self.packing
        added = self.links.select(keep)
        return self.packing.replace(links=added if own is None else own.joined(added))


def _bounds(compliance_ee: NDArray[np.float64]) -> tuple[Average, Average]:
    """Return the Reuss and Voigt averages of a compliance that may be singular."""
    d = 2 if len(compliance_ee) == 3 else 3
    one, deviators = trace_vector(d), (d - 1) * (d + 2) // 2
    around = float(one @ compliance_ee @ one)
    sheared = 2.0 * (float(np.trace(compliance_ee)) - around / d) / deviators
    reuss = Average(_inverse(around), _inverse(sheared), d)
    value, vector = np.linalg.eigh(compliance_ee)
    # a direction that stays free keeps more than 1e-10 of the compliance, a forbidden one rounding
    stiff = vector.T[value <= 1e-13 * max(float(value[-1]), 0.0)]
    return reuss, voigt_average(inverse_across(compliance_ee, stiff), stiff)


def _inverse(compliance: float) -> float:
    return 1.0 / compliance if compliance > 0.0 else float("inf")


@shown_as("cementing")
@honors("repulsion kinds links", at_rest=True)
def cement(
    scene: Scene,
    *,
    seed: int = 0,
    order: str | Sequence[int] | NDArray[np.int64] = "random",
    step: float = 0.05,
    freeze: str = "angles",
    kind: Kind = "unstressed",
    gap_tolerance: float | None = None,
) -> Cementing:
    """Return the moduli of a packing while random contacts become rigid links, up to complete rigidity.

    Positions stay as they are: contacts keep the lengths that they have. The compliance is that of particles and box
    free to relax; each new link takes a positive matrix away from it (in the metric of
    the Hessian), so that no modulus or bound ever falls.

    Parameters
    ----------
    scene
        A scene whose packing resists every strain: jammed with `strain="free"`, at a low pressure. Links that it has
        are held from the start. Particles may move where that costs nothing and strains nothing, such as the end of a
        chain that touches nothing.
    seed
        Draws the order of cementing, in which contacts that links hold already have their turn, too.
    order
        "random": every contact with equal chances next. "aggregate": the next one touches what has been cemented, with
        equal chances, so that one cluster grows from one contact until all it can reach is part of it. Or contacts in
        the order to be cemented, as numbers in `find_contacts(packing, gap_tolerance=...)`; cementing ends with the
        last.
    step
        Moduli are measured every `step` in n_l/N [1], n_l cemented contacts and N all particles.
    freeze
        "angles": two particles cemented to the same third keep their distance, so that bond angles are fixed while
        parts of a cluster may still turn about a bond in three dimensions (as Dennis, 2021, has it). "clusters":
        also these turns; all that is cemented together moves as one body. "nothing": contacts keep their lengths.
    kind
        "unstressed": the limit of small pressures. "exact": with the forces that contacts and links carry; the
        compliance is then the inverse of `Moduli.energy`.
    gap_tolerance
        Pairs with a gap up to this times the contact distance [1] are contacts.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing does not resist every strain before it is cemented.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    >>> jammed = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8).packing
    >>> cementing = pm.cement(pm.Scene(jammed, (pm.Repulsion(),)), seed=5)
    >>> cementing.reuss(3).bulk_modulus > cementing.reuss(0).bulk_modulus
    True
    >>> cementing.first_stiff <= cementing.all_stiff
    True

    """
    instance("scene", scene, Scene)
    seed = integer("seed", seed, at_least=0)
    step = positive("step", step)
    one_of("freeze", freeze, FREEZE)
    one_of("kind", kind, KINDS)
    gap_tolerance = None if gap_tolerance is None else real("gap_tolerance", gap_tolerance, at_least=0.0)
    began = time.process_time()
    with single_thread():
        backbone = backbone_of(scene, kind, gap_tolerance)
        if isinstance(order, str):
            sequence = drawn_order(one_of("order", order, ORDERS), backbone, np.random.default_rng(seed))
        else:
            sequence = _sequence(order, backbone)
        return cement_backbone(backbone, sequence, step, freeze, kind, began)


def drawn_order(name: str, backbone: Backbone, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the contacts of a backbone in a random order or in one in which a cluster grows."""
    contacts = backbone.contacts
    if name == "random":
        return rng.permutation(len(contacts))
    around: list[list[int]] = [[] for _ in range(contacts.particles)]
    for c, (i, j) in enumerate(zip(contacts.i_c.tolist(), contacts.j_c.tolist(), strict=True)):
        around[i].append(c)
        around[j].append(c)
    # the packing's links join what they link, whatever is cemented
    linked: list[list[int]] = [[] for _ in range(contacts.particles)]
    for pair in backbone.own:
        linked[pair.i].append(pair.j)
        linked[pair.j].append(pair.i)
    order: list[int] = []
    left = set(range(len(contacts)))
    reached = np.zeros(contacts.particles, dtype=bool)
    # contacts that touch the cluster, each once
    edge: list[int] = []
    listed: set[int] = set()
    while left:
        if not edge:
            edge = [sorted(left)[int(rng.integers(len(left)))]]
            listed.update(edge)
        place = int(rng.integers(len(edge)))
        edge[place], edge[-1] = edge[-1], edge[place]
        c = edge.pop()
        left.remove(c)
        order.append(c)
        waiting = [int(contacts.i_c[c]), int(contacts.j_c[c])]
        while waiting:
            n = waiting.pop()
            if not reached[n]:
                reached[n] = True
                new = [one for one in around[n] if one not in listed]
                edge += new
                listed.update(new)
                waiting += linked[n]
    return np.array(order, dtype=np.int64)


def _sequence(order: Sequence[int] | NDArray[np.int64], backbone: Backbone) -> NDArray[np.int64]:
    """Return places in the backbone's contacts from those in the packing's."""
    given = entries("order", order, "iu", "numbers of contacts")
    if given.ndim != 1 or not given.size:
        raise TypeError(f"order must be a list of numbers of contacts, at least one, got {brief(order)}")
    place = backbone.place_c
    bad = np.flatnonzero((given < 0) | (given >= len(place)))
    if len(bad):
        raise ValueError(f"order must hold numbers of contacts below {len(place)}, got {given[bad[0]]}")
    if len(np.unique(given)) != len(given):
        raise ValueError("order must name each contact once, got one twice")
    found: NDArray[np.int64] = place[given.astype(np.int64)]
    if (found < 0).any():
        raise ValueError(f"order must name contacts that bear force, got {given[found < 0][0]}, of a rattler")
    return found


@dataclass
class _Course:
    """What has been cemented so far: the compliance, the pairs held, and when strains became stiff."""

    compliance: HeldCompliance
    pairs: list[HeldPair]
    added: list[int]
    stiff: int = 0
    first: int | None = None
    whole: int | None = None
    direction: NDArray[np.float64] | None = None

    def begin(self, own: list[HeldPair]) -> None:
        """Hold the packing's own links."""
        if own:
            self.compliance.hold(own)
            self._note(self.compliance.stiff_directions(), 0)

    def hold(self, pieces: list[list[HeldPair]], before: int) -> None:
        """Hold the pairs of the next contacts at once; where a direction becomes stiff, once more one by one."""
        state = self.compliance.saved()
        together = [pair for piece in pieces for pair in piece]
        new = self.compliance.hold(together)
        stiff = self.compliance.stiff_directions()
        if len(stiff) == self.stiff or len(pieces) == 1:
            number = np.repeat(np.arange(len(pieces)), [len(piece) for piece in pieces])
            self.pairs += [together[k] for k in new]
            self.added += [before + int(number[k]) + 1 for k in new]
            self._note(stiff, before + len(pieces))
            return
        self.compliance.restore(state)
        for k, piece in enumerate(pieces):
            self.hold([piece], before + k)

    def _note(self, stiff: NDArray[np.float64], cemented: int) -> None:
        if len(stiff) and self.first is None:
            self.first, self.direction = cemented, stiff
        if len(stiff) == stiff.shape[1] and self.whole is None:
            self.whole = cemented
        self.stiff = len(stiff)


def step_end(number: int, last: int, step: float, particles: int) -> int:
    """Return n_l at the end of a step, at least one contact after the last."""
    # as many as there are numbers, where the product is beyond them
    return max(int(min(np.floor(number * step * particles + 1e-9), 2.0**62)), last + 1)


def cement_backbone(
    backbone: Backbone, sequence_l: NDArray[np.int64], step: float, freeze: str, kind: Kind, began: float | None = None
) -> Cementing:
    """Return the moduli while the contacts of a backbone are cemented in this order; see `cement`."""
    began = time.process_time() if began is None else began
    packing, contacts = backbone.scene.packing, backbone.contacts
    d, s = packing.dimension, packing.dimension * (packing.dimension + 1) // 2
    glue = Cement(contacts, packing)
    course = _Course(HeldCompliance(backbone), [], [])
    course.begin(backbone.own)
    cemented, compliance, stiff = [0], [course.compliance.compliance()], [course.stiff]
    while cemented[-1] < len(sequence_l) and course.whole is None:
        last = cemented[-1]
        target = min(step_end(len(cemented), last, step, packing.particles), len(sequence_l))
        course.hold([glue.add(int(c), freeze) for c in sequence_l[last:target]], last)
        cemented.append(target)
        compliance.append(course.compliance.compliance())
        stiff.append(course.stiff)
    length = np.array([np.sqrt(pair.vector @ pair.vector) for pair in course.pairs])
    links = Links(
        np.array([pair.i for pair in course.pairs], dtype=np.int64),
        np.array([pair.j for pair in course.pairs], dtype=np.int64),
        np.array([pair.image for pair in course.pairs], dtype=np.int64).reshape(-1, d),
        length,
        np.array([pair.shape for pair in course.pairs], dtype=bool),
    )
    number = np.flatnonzero(backbone.place_c >= 0)
    return Cementing(
        packing=packing,
        contact_l=number[sequence_l[: cemented[-1]]],
        cemented_k=np.array(cemented),
        compliance_kee=np.array(compliance),
        stiff_k=np.array(stiff),
        first_stiff=course.first,
        all_stiff=course.whole,
        first_direction_ke=np.zeros((0, s)) if course.direction is None else course.direction,
        links=links,
        added_l=_sorted_like(links, course),
        self_stress=backbone.self_stress,
        bearing=backbone.bearing,
        freeze=freeze,
        kind=kind,
        smallest_new=course.compliance.smallest_new,
        largest_old=course.compliance.largest_old,
        seconds=time.process_time() - began,
    )


def _sorted_like(links: Links, course: _Course) -> NDArray[np.int64]:
    """Return when each link came, in the order of the links."""
    when = {canonical(pair): added for pair, added in zip(course.pairs, course.added, strict=True)}
    triples = zip(links.i_l.tolist(), links.j_l.tolist(), links.image_ld.tolist(), strict=True)
    return np.array([when[i, j, tuple(image)] for i, j, image in triples], dtype=np.int64)
