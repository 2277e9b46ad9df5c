"""`cement`: random contacts of a jammed packing become rigid links, and the moduli are followed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, integer, one_of, positive, real
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import trace_vector
from packmech.links import Links
from packmech.mechanics.elasticity import Average, inverse_across, voigt_average
from packmech.mechanics.rigidity import TOUCHING
from packmech.packing import Packing, without_links
from packmech.protocols.held_compliance import (
    FREEZE,
    Backbone,
    Cement,
    HeldCompliance,
    HeldPair,
    backbone_of,
    canonical,
)
from packmech.scene import Scene

KINDS = ("unstressed", "exact")


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
        The links that hold the packing at the last step, as many as are independent of each other; those besides the
        cemented contacts are marked as holding a shape.
    added_l
        (L,) n_l at which each of these links came.
    self_stress
        States of self stress of the packing before cementing, the box free to change its shape but not its volume.
    bearing
        Particles that bear force; the others rattle.
    freeze, kind
        As given.
    least_new, largest_old
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
    kind: str
    least_new: float
    largest_old: float
    seconds: float

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

    def poisson_ratio(self, step: int) -> float:
        """Return the Poisson ratio [1] of the mean of the bounds, or of the lower one where the upper is infinite.

        nan at complete rigidity.
        """
        low, high = _bounds(self.compliance_kee[step])
        if np.isinf(high.bulk_modulus) or np.isinf(high.shear_modulus):
            return low.poisson_ratio
        bulk, shear = (low.bulk_modulus + high.bulk_modulus) / 2.0, (low.shear_modulus + high.shear_modulus) / 2.0
        return Average(bulk, shear, low.dimension).poisson_ratio

    def packing_at(self, step: int) -> Packing:
        """Return the packing with the links that hold it at a step."""
        keep = self.added_l <= self.cemented_k[step]
        return self.packing.replace(links=self.links.select(keep) if keep.any() else None)


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


def cement(
    scene: Scene,
    *,
    seed: int = 0,
    order: Sequence[int] | NDArray[np.int64] | None = None,
    step: float = 0.05,
    freeze: str = "angles",
    kind: str = "unstressed",
    gap_tolerance: float = TOUCHING,
) -> Cementing:
    """Return the moduli of a packing while random contacts become rigid links, up to complete rigidity.

    Positions stay as they are: contacts keep the lengths that they have. The compliance is that of particles and box
    free to relax; each new link takes a positive matrix away from it (section 14 of the corrected specification, in
    the metric of the Hessian), so that no modulus or bound ever falls.

    Parameters
    ----------
    scene
        A scene whose packing resists every strain: jammed with `strain="free"`, at a low pressure.
    seed
        Draws the order of cementing: every contact with equal chances, also those that links hold already.
    order
        Contacts in the order to be cemented, as numbers in `find_contacts(packing, gap_tolerance=...)`, in place of a
        random one. Cementing ends with the last.
    step
        Moduli are measured every `step` in n_l/N [1], n_l cemented contacts and N all particles.
    freeze
        "angles": two particles cemented to the same third keep their distance, so that bond angles are fixed while
        parts of a cluster may still turn about a bond in three dimensions (as the polymer source has it). "clusters":
        also these turns; all that is cemented together moves as one body. "nothing": contacts keep their lengths.
    kind
        "unstressed": the limit of small pressures. "exact": with the forces that contacts and links carry; the
        compliance is then the inverse of `Moduli.energy`.
    gap_tolerance
        Pairs with a gap up to this times the contact distance [1] are contacts.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing is not rigid under every strain before it is cemented.

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
    without_links("scene.packing", scene.packing)
    seed = integer("seed", seed, at_least=0)
    step = positive("step", step)
    one_of("freeze", freeze, FREEZE)
    one_of("kind", kind, KINDS)
    gap_tolerance = real("gap_tolerance", gap_tolerance, at_least=0.0)
    began = time.process_time()
    with single_thread():
        backbone = backbone_of(scene, kind, gap_tolerance)
        if order is None:
            sequence = np.random.default_rng(seed).permutation(len(backbone.contacts))
        else:
            sequence = _sequence(order, backbone)
        return cement_backbone(backbone, sequence, step, freeze, kind, began)


def _sequence(order: Sequence[int] | NDArray[np.int64], backbone: Backbone) -> NDArray[np.int64]:
    """Return places in the backbone's contacts from those in the packing's."""
    given = np.asarray(order)
    if given.ndim != 1 or not given.size or given.dtype.kind not in "iu":
        raise TypeError(f"order must be a list of numbers of contacts, at least one, got {order!r}")
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
    return max(int(np.floor(number * step * particles + 1e-9)), last + 1)


def cement_backbone(
    backbone: Backbone, sequence_l: NDArray[np.int64], step: float, freeze: str, kind: str, began: float | None = None
) -> Cementing:
    """Return the moduli while the contacts of a backbone are cemented in this order; see `cement`."""
    began = time.process_time() if began is None else began
    packing, contacts = backbone.scene.packing, backbone.contacts
    d, s = packing.dimension, packing.dimension * (packing.dimension + 1) // 2
    glue = Cement(contacts, packing.position_nd, packing.box.lattice_dd)
    course = _Course(HeldCompliance(backbone), [], [])
    cemented, compliance, stiff = [0], [course.compliance.compliance()], [0]
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
        self_stress=len(contacts) - (d * backbone.bearing + s - d) + 1,
        bearing=backbone.bearing,
        freeze=freeze,
        kind=kind,
        least_new=course.compliance.least_new,
        largest_old=course.compliance.largest_old,
        seconds=time.process_time() - began,
    )


def _sorted_like(links: Links, course: _Course) -> NDArray[np.int64]:
    """Return when each link came, in the order of the links."""
    when = {canonical(pair): added for pair, added in zip(course.pairs, course.added, strict=True)}
    triples = zip(links.i_l.tolist(), links.j_l.tolist(), links.image_ld.tolist(), strict=True)
    return np.array([when[i, j, tuple(image)] for i, j, image in triples], dtype=np.int64)
