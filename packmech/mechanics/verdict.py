"""What is known about whether a packing is jammed, and on what grounds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import Contacts
from packmech.mechanics.touching import RestCheck, Touching
from packmech.mechanics.unjamming import UnjammingMotion
from packmech.outcome import Solve

JAMMED, NOT_JAMMED, AMBIGUOUS = "jammed", "not jammed", "ambiguous"


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to one question: is the packing collectively (box fixed) or strictly (box free to deform) jammed.

    Attributes
    ----------
    verdict, reason
        "jammed", "not jammed" or "ambiguous", and one sentence why.
    first_order_jammed
        Whether the contacts admit no motion to first order; None when no solver could tell. The verdict is ambiguous,
        and this is not, when the contacts themselves are in doubt. For discs and spheres a first-order motion unjams.
    isostatic_contacts
        The fewest contacts that can hold this many backbone particles: d N' - d + 1 in a fixed box, d N' - d + d(d+1)/2
        when it may deform; less one for each rigid link between them that does not depend on others.
    states_of_self_stress
        Independent balanced contact forces: strain `none` for the collective question, `isochoric` for the strict one.
    floppy_modes
        Independent motions that change no contact (nor the volume), translations apart.
    smallest_singular_value
        Of the rigidity matrix and the rows of links and volume over the largest, translations removed [1]: the rank
        certificate.
        Infinity when no motion is left to have one; NaN when the method did not ask.
    smallest_force
        Smallest over mean contact force of the certificate [1]; not positive, or minus infinity, when there is none.
    contact_force_c
        (C,) the certificate: contact forces of mean 1 in balance, all positive, on `Verdict.network`; None unless
        jammed, and when the method gives none.
    link_tension_l
        (L,) what the rigid links bear in it, tension positive, of either sign [mean contact force]; 0 where a link
        depends on others. None without links or without a certificate.
    balance
        Largest component of the net forces of the certificate [mean contact force].
    unjamming_motion
        A motion that closes no contact; None unless not jammed.
    stable
        Whether the energy's Hessian, contact forces included, is positive on all motions but translations: at fixed box
        for the collective question, at fixed volume for the strict one. None without a law, or away from rest. With
        rigid links it is asked of the backbone as judged, on the motions that the links admit.
    solves
        What each solver achieved and took.

    """

    verdict: str
    reason: str
    first_order_jammed: bool | None
    isostatic_contacts: int
    states_of_self_stress: int
    floppy_modes: int
    smallest_singular_value: float = np.nan
    smallest_force: float = np.nan
    contact_force_c: NDArray[np.float64] | None = None
    link_tension_l: NDArray[np.float64] | None = None
    balance: float = 0.0
    unjamming_motion: UnjammingMotion | None = None
    stable: bool | None = None
    solves: tuple[Solve, ...] = ()

    @property
    def gap(self) -> float:
        """Largest duality gap of the programs that were solved, relative to their value or 1; NaN where none was."""
        return max((solve.gap for solve in self.solves if solve.outcome.ok and solve.iterations), default=np.nan)

    @property
    def status(self) -> str:
        """What the solvers said of themselves, in the order in which they were asked."""
        return "; ".join(solve.status for solve in self.solves)

    def __str__(self) -> str:
        """Return the verdict with its reason in short: not jammed (empty backbone)."""
        return f"{self.verdict} ({self.reason.partition(':')[0].partition(';')[0]})"


@dataclass(frozen=True, eq=False)
class Verdict:
    """Whether a packing is locally, collectively and strictly jammed, after Torquato and Stillinger (2001).

    Attributes
    ----------
    local
        "jammed" when some particles hold each other in place one by one (d + 1 contacts or more, not all in one closed
        half space; with links, each cluster with the others at rest): what is left after the rattlers are taken out.
    local_reason
        One sentence why.
    collectively, strictly
        The two other questions with their grounds; `collective` and `strict` are their verdicts.
    rattlers
        (N,) particles that are not part of the backbone: not held by their contacts, or, while the others are jammed,
        held by contacts that carry no force in any state of self stress, or able to move together against the others.
    network
        The contacts between backbone particles, in the packing's own numbers.
    touching
        Which pairs were taken for contacts, and what a tenth and ten times the gap tolerance would have given.
    rest
        The balance of the overlaps; None when the contacts were given.
    method, solver, volume
        As asked for.
    seconds
        CPU time.
    cluster_n
        (N,) number of each particle's cluster; None without rigid links.
    bound
        "ball" or "box": what bounded the motions of the load programs; always "box" with HiGHS, which solves linear
        programs only. None for the certificate.
    friction
        Whether the scene has friction, which is left out: particles are judged as frictionless, and friction may hold
        packings that are not jammed without it.

    """

    local: str
    local_reason: str
    collectively: Answer
    strictly: Answer
    rattlers: NDArray[np.bool_]
    network: Contacts
    touching: Touching
    rest: RestCheck | None
    method: str
    solver: str
    volume: str
    seconds: float
    cluster_n: NDArray[np.int64] | None = None
    bound: str | None = None
    friction: bool = False

    @property
    def collective(self) -> str:
        """Verdict with the box fixed."""
        return self.collectively.verdict

    @property
    def strict(self) -> str:
        """Verdict with the box free to deform, its volume not growing."""
        return self.strictly.verdict

    @property
    def backbone(self) -> NDArray[np.bool_]:
        """The (N,) particles that do not rattle."""
        return ~self.rattlers

    @property
    def rattling_clusters(self) -> NDArray[np.bool_]:
        """The (N,) particles of clusters that rattle as a whole; a single particle is one."""
        if self.cluster_n is None:
            return self.rattlers
        held = np.bincount(self.cluster_n, ~self.rattlers) > 0
        return np.asarray(~held[self.cluster_n])

    @property
    def backbone_links(self) -> int:
        """Number of rigid links that hold the backbone and do not depend on others."""
        particles, d = int(self.backbone.sum()), self.network.dimension
        return d * particles - d + 1 - self.collectively.isostatic_contacts if particles else 0

    @property
    def danglers(self) -> NDArray[np.bool_]:
        """The (N,) rattlers that touch nothing."""
        return np.asarray(self.rattlers & (self.touching.contacts.count_n() == 0))

    @property
    def _strongest(self) -> Answer:
        return self.strictly if self.strictly.first_order_jammed else self.collectively

    @property
    def contacts(self) -> int:
        """Number of contacts between backbone particles."""
        return len(self.network)

    @property
    def isostatic_contacts(self) -> int:
        """Fewest contacts for the strongest category reached: strict if it is strictly jammed, else collective."""
        return self._strongest.isostatic_contacts

    @property
    def states_of_self_stress(self) -> dict[str, int]:
        """Independent balanced contact forces, by what the strain may do: `none` (fixed box) and `isochoric`."""
        return {
            "none": self.collectively.states_of_self_stress,
            "isochoric": self.strictly.states_of_self_stress,
        }

    @property
    def contact_force_c(self) -> NDArray[np.float64] | None:
        """The (C,) certificate of the strongest category reached, mean 1, or None."""
        return self._strongest.contact_force_c

    @property
    def unjamming_motion(self) -> UnjammingMotion | None:
        """A motion that unjams: in the fixed box if there is one, else with a strain; None if strictly jammed."""
        return self.collectively.unjamming_motion or self.strictly.unjamming_motion

    @property
    def first_order_jammed(self) -> bool | None:
        """Whether the contacts admit no motion to first order, strains included; `collectively` has it without."""
        return self.strictly.first_order_jammed

    @property
    def mechanically_stable(self) -> bool | None:
        """Whether all but d eigenvalues of the Hessian in the fixed box are positive, rattlers apart; needs a law."""
        return self.collectively.stable

    @property
    def prestress_stable(self) -> bool | None:
        """The same with strains at fixed volume: whether the contact forces leave the packing stable; needs a law."""
        return self.strictly.stable

    @property
    def ok(self) -> bool:
        """Whether no answer is ambiguous."""
        return AMBIGUOUS not in (self.local, self.collective, self.strict)

    def __str__(self) -> str:
        """Return the answers with their grounds and what was assumed, one line each."""
        from packmech.mechanics.verdict_text import verdict_text

        return verdict_text(self)
