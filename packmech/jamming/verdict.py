"""What is known about whether a packing is jammed, and on what grounds; as a record, as numbers, as words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import counted, shown
from packmech.check import BoxStrain
from packmech.constraints.motion_rules import follow_links
from packmech.constraints.projection import reaffix_links
from packmech.contacts import Contacts
from packmech.jamming.contact_selection import ContactSelection, RestCheck
from packmech.jamming.motion_cone import MotionCone
from packmech.linalg.mandel import mandel_tensor, strain_components
from packmech.packing import Packing
from packmech.result import Solve

JAMMED, NOT_JAMMED, AMBIGUOUS = "jammed", "not jammed", "ambiguous"


@dataclass(frozen=True, eq=False)
class JammingAnswer:
    """The answer to one question: is the packing collectively (box fixed) or strictly (box free to deform) jammed.

    Attributes
    ----------
    verdict, reason
        "jammed", "not jammed" or "ambiguous", and one sentence why.
    first_order_jammed
        Whether the contacts admit no motion to first order; None when no solver could tell. The verdict is ambiguous,
        and this is not, when the contacts themselves are ambiguous. For discs and spheres a first-order motion unjams.
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


@shown(lambda one: str(one).partition("\n")[0])
@dataclass(frozen=True, eq=False)
class TiledAnswer:
    """Whether a packing is jammed when its box is repeated.

    Attributes
    ----------
    collective, strict
        "jammed", "not jammed" or "ambiguous": with the box of all copies fixed, and with it free to deform.
    reason
        One sentence why.
    repeats
        The copies in each direction: of which the answer holds where some were asked for, or the smallest that unjam;
        None where it holds for all.
    wave_vector_d
        (d,) fractions of the reciprocal lattice of the wave that unjams [1]; None where there is none.
    smallest_singular_value
        The smallest found of R(f), of rows of unit normals [1].
    nearest_d
        (d,) wave vector at which it was found, outside of the region about 0.
    long_waves
        Wave vectors up to this are covered by the bound about 0 [1/length].
    cells
        Number of cells of wave vectors that cover the rest.
    packing
        The copies that unjam; None where there are none.
    motion
        The motion of these that keeps all contacts; None where there is none.
    seconds
        CPU time.

    """

    collective: str
    strict: str
    reason: str
    repeats: tuple[int, ...] | None = None
    wave_vector_d: NDArray[np.float64] | None = None
    smallest_singular_value: float = np.nan
    nearest_d: NDArray[np.float64] | None = None
    long_waves: float = 0.0
    cells: int = 0
    packing: Packing | None = None
    motion: UnjammingMotion | None = None
    seconds: float = 0.0

    def __str__(self) -> str:
        """Return the answer, and below it the whole reason."""
        return f"copies: collectively {self.collective}, strictly {self.strict}\n{self.reason}"


@shown(lambda one: f"locally {one.local}, collectively {one.collective}, strictly {one.strict}")
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
        The contacts between backbone particles, in the packing's own numbers; `ShapeContacts` of particles with shapes,
        by their numbers among the backbone particles.
    touching
        Which pairs were taken for contacts, and what a tenth and ten times the gap tolerance would have given.
    rest
        The balance of the overlaps; None when the contacts were given.
    method, solver, strain
        As asked for.
    seconds
        CPU time.
    cluster_n
        (N,) number of each particle's cluster; None without rigid links.
    bound
        "ball" or "box": what bounded the motions of the load programs; always "box" with HiGHS, which solves linear
        programs only. None for the certificate.
    packing
        The packing that was classified; None where it is not known.
    tiled
        Whether it stays jammed when copies of it lie side by side; None where that was not asked.

    """

    local: str
    local_reason: str
    collectively: JammingAnswer
    strictly: JammingAnswer
    rattlers: NDArray[np.bool_]
    network: Contacts
    touching: ContactSelection
    rest: RestCheck | None
    method: str
    solver: str
    strain: BoxStrain
    seconds: float
    cluster_n: NDArray[np.int64] | None = None
    bound: str | None = None
    packing: Packing | None = field(default=None, repr=False)
    tiled: TiledAnswer | None = None

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
        """The (N,) rattlers that their clusters alone hold: linked particles that touch nothing."""
        if self.cluster_n is None:
            return np.zeros(len(self.rattlers), dtype=bool)
        linked = np.bincount(self.cluster_n)[self.cluster_n] > 1
        return np.asarray(self.rattlers & linked & (self.touching.contacts.count_n() == 0))

    @property
    def _strongest(self) -> JammingAnswer:
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
        return verdict_text(self)


@shown(lambda one: f"of {len(one.displacement_nd)} particles, closes no contact by more than {one.closing:.1e}")
@dataclass(frozen=True, eq=False)
class UnjammingMotion:
    """A motion along which contacts open or keep their length and none closes, to first order.

    Attributes
    ----------
    displacement_nd
        (N, d) displacements, without translation; the largest of them, or strain_scale times the largest strain, is one
        reference diameter [length]. Rattlers stay, or follow their links.
    strain_dd
        (d, d) symmetric strain of the box [1]; zero in a fixed box.
    closing, opening
        Largest shortening and largest lengthening of a contact [length].

    """

    displacement_nd: NDArray[np.float64]
    strain_dd: NDArray[np.float64]
    closing: float
    opening: float

    def moved(self, packing: Packing, amplitude: float) -> Packing:
        """Return the packing moved along the motion: x -> (1 + a strain)(x + a displacement), the box strained alike.

        Rigid links get their lengths back.

        Parameters
        ----------
        packing
            The packing that was classified.
        amplitude
            a, in reference diameters [1].

        """
        change = np.eye(packing.dimension) + amplitude * self.strain_dd
        position = (packing.position_nd + amplitude * self.displacement_nd) @ change.T
        moved = packing.replace(position_nd=position, box=packing.box.strained(amplitude * self.strain_dd))
        return reaffix_links(moved).packing


def unjamming_motion(packing: Packing, cone: MotionCone, motion: NDArray[np.float64]) -> UnjammingMotion:
    """Return the motion of a cone as displacements of all particles of the packing and a strain of its box."""
    d = packing.dimension
    moving = len(cone.kept_n) * d
    # where nothing bounds them, solvers return motions of any size: their squares may be too large for numbers
    largest = float(np.abs(motion).max(initial=0.0))
    motion = cone.without_translations(motion / largest if largest > 0.0 else motion)
    displacement = np.zeros((packing.particles, d))
    displacement[cone.kept_n] = motion[:moving].reshape(-1, d)
    strain = np.zeros(strain_components(d))
    if cone.strain_scale:
        strain = motion[moving:] / cone.strain_scale
    follow_links(packing, cone.kept_n, displacement, strain)
    size = max(np.sqrt((displacement**2).sum(axis=1)).max(), cone.strain_scale * np.abs(strain).max())
    factor = packing.reference_diameter / size if size > 0 else 0.0
    stretch = factor * (cone.opening @ motion)
    return UnjammingMotion(
        factor * displacement,
        factor * mandel_tensor(strain),
        closing=float(max(0.0, -stretch.min(initial=0.0))),
        opening=float(max(0.0, stretch.max(initial=0.0))),
    )


Row = tuple[str, str, str]
# how the reason begins where overlaps hide which pairs touch
OFF_PLATEAU = "the gap tolerance is off its plateau"


def verdict_numbers(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as numbers, words and lists by name, without the arrays of its certificates.

    Parameters
    ----------
    verdict
        The verdict.

    """
    selection, rest = verdict.touching, verdict.rest
    numbers: dict[str, Any] = {
        "local": verdict.local,
        "collective": verdict.collective,
        "strict": verdict.strict,
        "local_reason": verdict.local_reason,
        **_answer_numbers("collective", verdict.collectively),
        **_answer_numbers("strict", verdict.strictly),
        "mechanically_stable": verdict.mechanically_stable,
        "prestress_stable": verdict.prestress_stable,
        "first_order_jammed": verdict.first_order_jammed,
        "backbone_particles": int(verdict.backbone.sum()),
        "backbone_contacts": verdict.contacts,
        "rattling_particles": np.flatnonzero(verdict.rattlers).tolist(),
        "danglers": int(verdict.danglers.sum()),
        "gap_tolerance": None if np.isnan(selection.tolerance) else selection.tolerance,
        "gap_rule": selection.rule,
        "gap_levels": [
            {"tolerance": one.tolerance, "contacts": one.contacts, "particles": one.particles, "excess": one.excess}
            for one in selection.levels
        ],
        "mean_overlap": selection.mean_overlap,
        "rest": None if rest is None else {"residual": rest.residual, "limit": rest.limit, "law": rest.law},
        "at_rest": None if rest is None else rest.at_rest,
        "verdict_method": verdict.method,
        "verdict_solver": verdict.solver,
        "verdict_strain": verdict.strain,
        "verdict_bound": verdict.bound,
        "verdict_seconds": verdict.seconds,
    }
    if verdict.tiled is not None:
        numbers |= _tiled_numbers(verdict.tiled)
    if verdict.cluster_n is not None:
        numbers["rattling_clusters"] = len(np.unique(verdict.cluster_n[verdict.rattling_clusters]))
    return numbers


def _answer_numbers(name: str, answer: JammingAnswer) -> dict[str, Any]:
    motion = answer.unjamming_motion
    return {
        f"{name}_reason": answer.reason,
        f"{name}_first_order_jammed": answer.first_order_jammed,
        f"{name}_isostatic_contacts": answer.isostatic_contacts,
        f"{name}_states_of_self_stress": answer.states_of_self_stress,
        f"{name}_floppy_modes": answer.floppy_modes,
        f"{name}_smallest_singular_value": answer.smallest_singular_value,
        f"{name}_smallest_force": answer.smallest_force,
        f"{name}_balance": answer.balance,
        f"{name}_duality_gap": answer.gap,
        f"{name}_solver_status": answer.status,
        f"{name}_motion": None if motion is None else {"opening": motion.opening, "closing": motion.closing},
    }


def _tiled_numbers(answer: TiledAnswer) -> dict[str, Any]:
    return {
        "tiled_collective": answer.collective,
        "tiled_strict": answer.strict,
        "tiled_reason": answer.reason,
        "tiled_repeats": None if answer.repeats is None else list(answer.repeats),
        "tiled_wave_vector": None if answer.wave_vector_d is None else answer.wave_vector_d.tolist(),
        "tiled_smallest_singular_value": answer.smallest_singular_value,
        "tiled_seconds": answer.seconds,
    }


def verdict_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """Return rows of question, answer and grounds, from what `verdict_numbers` gives.

    Parameters
    ----------
    numbers
        Those numbers, others among them or not.

    """
    rows = [
        ("locally jammed", numbers["local"], numbers["local_reason"]),
        _answer_row(numbers, "collective", "box fixed"),
        _answer_row(numbers, "strict", f"box free to deform, strain {numbers['verdict_strain']}"),
    ]
    if "tiled_collective" in numbers:
        answer = f"{numbers['tiled_collective']}, strictly {numbers['tiled_strict']}"
        rows.append(("when tiled", answer, numbers["tiled_reason"]))
    if numbers["mechanically_stable"] is not None:
        stable, strained = numbers["mechanically_stable"], numbers["prestress_stable"]
        note = f"Hessian positive in the fixed box; with strains at fixed volume: {_yes(strained)}"
        rows.append(("mechanically stable", _yes(stable), note))
    rows.append(_gap_row(numbers))
    if numbers["rest"] is not None:
        rest = numbers["rest"]
        rows.append(("at rest", _yes(numbers["at_rest"]), f"{_balance(rest)}; law: {rest['law']}"))
    return rows


def verdict_text(verdict: Verdict) -> str:
    """Return the verdict and its grounds, one line each.

    Parameters
    ----------
    verdict
        The verdict.

    """
    numbers = verdict_numbers(verdict)
    particles = len(verdict.rattlers)
    rattlers = counted(int(verdict.rattlers.sum()), "rattler")
    note = f"{counted(verdict.contacts, 'contact')}; {rattlers}, {numbers['danglers']} held by their clusters alone"
    if "rattling_clusters" in numbers:
        note += f", {counted(numbers['rattling_clusters'], 'whole cluster')} among them"
    rows = [
        *verdict_rows(numbers),
        ("backbone", f"{numbers['backbone_particles']} of {particles}", note),
        ("method", verdict.method, _solver(verdict)),
    ]
    wide = [max(len(row[k]) for row in rows) for k in range(2)]
    return "\n".join(f"{name:<{wide[0]}}  {value:<{wide[1]}}  {note}" for name, value, note in rows)


def _solver(verdict: Verdict) -> str:
    bound = "" if verdict.bound is None else f", loads bounded by a {verdict.bound}"
    return f"solver {verdict.solver}{bound}, {verdict.seconds:.3f} CPU seconds"


def _yes(answer: bool | None) -> str:
    return {True: "yes", False: "no", None: "not known"}[answer]


def _balance(rest: Mapping[str, Any]) -> str:
    """Return how well the overlaps balance; rounding of exact crystals is no force that could be large or small."""
    if rest["residual"] == 0.0 and rest["limit"] < 1.0:
        note = "no net forces"
    elif rest["limit"] >= 1.0:
        note = "overlaps are rounding of the coordinates, no forces to balance"
        if rest["residual"] > rest["limit"]:
            note = "overlaps hardly above rounding of the coordinates, and out of balance"
    else:
        note = f"net forces up to {rest['residual']:.1e} of the mean contact force, allowed {rest['limit']:.1e}"
    return note


def _answer_row(numbers: Mapping[str, Any], name: str, where: str) -> Row:
    grounds, reason = [where], numbers[f"{name}_reason"]
    if name == "strict" and reason and (numbers[name], reason) == (numbers["collective"], numbers["collective_reason"]):
        reason = "for the same reason"
    elif "hard_strict" in numbers and reason.startswith(OFF_PLATEAU):
        reason = f"{OFF_PLATEAU} (see touching); the hard packing, below, has no overlaps"
    force = numbers[f"{name}_smallest_force"]
    if numbers[name] == "jammed" and not np.isnan(force):
        softest = numbers[f"{name}_smallest_singular_value"]
        grounds += [
            reason if np.isnan(softest) else f"smallest singular value {softest:.1e}",
            f"smallest force {force:.1e} of the mean",
            f"balanced to {numbers[f'{name}_balance']:.0e}",
        ]
        if not np.isnan(gap := numbers[f"{name}_duality_gap"]):
            grounds.append(f"duality gap {gap:.0e}")
    else:
        grounds.append(reason)
    # what is out of balance and has other contacts at every tolerance has none to go by
    apart = numbers["at_rest"] is False and len({level["excess"] for level in numbers["gap_levels"]}) > 1
    if numbers[name] == "ambiguous" and numbers[f"{name}_first_order_jammed"] is not None and not apart:
        first = "jammed" if numbers[f"{name}_first_order_jammed"] else "not jammed"
        grounds.append(f"by the contacts as taken: {first} to first order")
    return (f"{'collectively' if name == 'collective' else 'strictly'} jammed", numbers[name], "; ".join(grounds))


def _gap_row(numbers: Mapping[str, Any]) -> Row:
    tolerance = numbers["gap_tolerance"]
    if tolerance is None:
        return ("touching", "as given", "the contacts were given, gaps and rest not looked at")
    note = f"gaps of contacts in contact distances; {numbers['gap_rule']}"
    if len(numbers["gap_levels"]) == 3:
        few, at, many = (level["excess"] for level in numbers["gap_levels"])
        note += f"; contacts beyond the fewest that jam: {few:+d} at a tenth, {at:+d}, {many:+d} at ten times"
    return ("touching", f"up to {tolerance:.1e}", note)
