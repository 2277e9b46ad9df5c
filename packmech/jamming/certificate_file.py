"""A verdict in a file, with all that an independent referee needs to check it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.status import shown_as
from packmech.check import clear_errors, instance
from packmech.contacts import Contacts, find_contacts
from packmech.files.archive import SEAL, UNREADABLE, seal, write_archive
from packmech.files.paths import existing_file, replacing, writable_file
from packmech.jamming import referee
from packmech.jamming.verdict import AMBIGUOUS, JAMMED, NOT_JAMMED, JammingAnswer, Verdict

KIND, VERSION = "certificate of jamming", 1
# gap tolerance from which on an answer is no more than one for the contacts as taken [1]
_LOOSE = 1e-3


@dataclass(frozen=True)
class Verification:
    """What a referee says of a certificate.

    Attributes
    ----------
    accepted
        Whether all that it claims was proven, without what made it.
    collective, strict
        What was proven: "jammed", "not jammed", or "" where nothing was claimed or the proof failed.
    reasons
        A sentence on each question, and on the file.
    gap_tolerance
        Up to which gaps and overlaps pairs were taken for contacts, in contact distances [1]: all is proven for these.
    smallest_singular_value
        A bound from below, of the strongest claim, for unit vectors of contacts within a factor of 2 [1]; 0 if unused.
    smallest_weight, weight_error
        The smallest weight of a contact over their mean, and how far it may be from balance [1]; 0 where not needed.

    """

    accepted: bool
    collective: str
    strict: str
    reasons: tuple[str, ...]
    gap_tolerance: float = 0.0
    smallest_singular_value: float = 0.0
    smallest_weight: float = 0.0
    weight_error: float = 0.0

    def __bool__(self) -> bool:
        return self.accepted

    def __str__(self) -> str:
        loose = f", for gaps up to {self.gap_tolerance:.1g} of a contact distance" * (self.gap_tolerance > _LOOSE)
        return "\n".join((f"accepted{loose}" if self.accepted else "refused", *self.reasons))


@shown_as("writing")
@clear_errors
def write_certificate(verdict: Verdict, path: str | Path) -> None:
    """Write what a verdict claims and its grounds, for `verify`: a .npz file that numpy alone reads.

    An answer is claimed where it comes with grounds: contact forces for jammed, a motion or an empty backbone for not
    jammed. Answers that are ambiguous, and those of the load programs that give no forces, claim nothing.

    Parameters
    ----------
    verdict
        What `classify_jamming` returned for discs or spheres, with or without rigid links.
    path
        The file, ending in .npz; one that is there is replaced.

    Raises
    ------
    ValueError
        If the packing has shapes, nothing is claimed, or contacts have gaps or overlaps that a referee refuses: a tenth
        of their distance and more, or overlaps beyond the gap tolerance.

    Examples
    --------
    >>> import tempfile
    >>> import packmech as pm
    >>> verdict = pm.classify_jamming(pm.lattice_packing("triangular", repeats=(3, 3)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pm.write_certificate(verdict, f"{folder}/triangular.npz")
    ...     found = pm.verify(f"{folder}/triangular.npz")
    >>> found.accepted, found.collective, found.strict
    (True, 'jammed', 'jammed')

    """
    instance("verdict", verdict, Verdict)
    target = writable_file("path", path)
    if target.suffix != ".npz":
        raise ValueError(f"path must end in .npz, got {target.name!r}")
    packing, network = verdict.packing, verdict.network
    if packing is None or not isinstance(network, Contacts) or packing.shapes.has_orientations:
        raise ValueError("verdict must be that of discs or spheres, whose contacts a referee can check, got shapes")
    answers = {"collective": verdict.collectively, "strict": verdict.strictly}
    claimed = {name: _claimed(one, len(network)) for name, one in answers.items()}
    if not any(claimed.values()):
        raise ValueError(f"verdict must have an answer with grounds, got {verdict.collective} and {verdict.strict}")
    links, tolerance = packing.links, verdict.touching.tolerance
    if np.isnan(tolerance):
        # contacts that were given
        tolerance = float(np.abs(network.gap_c / network.contact_distance_c).max(initial=0.0))
    if not 0.0 <= tolerance < referee.WIDEST:
        raise ValueError(
            f"verdict must be of contacts within a gap tolerance of 0 or more and below {referee.WIDEST:g}, which a "
            f"referee accepts, got {tolerance:g}"
        )
    deepest = float(find_contacts(packing, gap_tolerance=0.0).overlap_c.max(initial=0.0))
    if deepest > tolerance + 2.0 * float(np.finfo(np.float64).eps):
        raise ValueError(
            f"verdict must be of overlaps within its gap tolerance, {tolerance:.3g}, as a referee asks it, got one of "
            f"{deepest:.3g}: ask with gap_tolerance={deepest:.1g} or more, or at a lower pressure"
        )
    arrays: dict[str, Any] = {
        "kind": KIND,
        "version": VERSION,
        "position_nd": packing.position_nd,
        "radius_n": packing.radius_n,
        "lattice_dd": packing.box.lattice_dd,
        "backbone_n": verdict.backbone,
        "gap_tolerance": tolerance,
        "strain": verdict.strain,
        **{f"{name}_c": getattr(network, f"{name}_c") for name in ("i", "j")},
        "image_cd": network.image_cd,
        "i_l": links.i_l,
        "j_l": links.j_l,
        "image_ld": links.image_ld,
    }
    for name, answer in answers.items():
        arrays |= {f"{name}_verdict": claimed[name], **_grounds(name, answer, claimed[name])}
    with replacing(target) as partial, open(partial, "wb") as file:
        write_archive(file, arrays)


def _claimed(answer: JammingAnswer, contacts: int) -> str:
    """Return the answer where it comes with grounds, else nothing."""
    given = {
        JAMMED: answer.contact_force_c is not None,
        NOT_JAMMED: answer.unjamming_motion is not None or contacts == 0,
        AMBIGUOUS: False,
    }
    return answer.verdict if given[answer.verdict] else ""


def _grounds(name: str, answer: JammingAnswer, claimed: str) -> dict[str, NDArray[np.float64]]:
    motion = answer.unjamming_motion
    if claimed == JAMMED and answer.contact_force_c is not None:
        found = {f"{name}_force_c": answer.contact_force_c}
        if answer.link_tension_l is not None:
            found[f"{name}_tension_l"] = answer.link_tension_l
        return found
    if claimed == NOT_JAMMED and motion is not None:
        return {f"{name}_displacement_nd": motion.displacement_nd, f"{name}_strain_dd": motion.strain_dd}
    return {}


@shown_as("checking the certificate")
@clear_errors
def verify(path: str | Path) -> Verification:
    """Return whether an independent referee proves what the certificate in a file claims.

    The referee (packmech/jamming/referee.py) needs numpy alone and calls nothing that made the verdict. Jammed: the
    rank of the contacts by a factorization whose rounding is bounded, and the balance of their forces in whole numbers.
    Not jammed: a motion that closes no pair, in whole numbers, after a search for all pairs; without a backbone, that
    particles can be taken out one after the other.

    Parameters
    ----------
    path
        What `write_certificate` wrote.

    Returns
    -------
    Verification
        True where all that is claimed was proven; with the reasons, and bounds on singular values and weights. Where
        the file is not as it was written, by its seal, a reason says so: what it claims now was judged.

    Raises
    ------
    TypeError, FileNotFoundError
        If there is no such file. What is no certificate is refused, not raised.

    Examples
    --------
    >>> import tempfile
    >>> import packmech as pm
    >>> verdict = pm.classify_jamming(pm.lattice_packing("kagome", repeats=(2, 2)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pm.write_certificate(verdict, f"{folder}/kagome.npz")
    ...     print(pm.verify(f"{folder}/kagome.npz"))
    accepted
    collective: not jammed: a motion closes no pair by more than ...
    strict: not jammed: a motion closes no pair by more than ...
    contacts: pairs with gaps or overlaps up to ... of their distance

    """
    where = existing_file("path", path)
    found = Verification(*referee.verify(where))
    if _is_changed(where):
        said = "the file was changed since it was written, by its seal: judged is what it holds now"
        found = replace(found, reasons=(*found.reasons, said))
    return found


def _is_changed(path: Path) -> bool:
    """Return whether a file has a seal that does not fit its arrays; what cannot be read the referee has refused."""
    try:
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = dict(file)
        return SEAL in arrays and str(arrays[SEAL]) != seal(arrays)
    except UNREADABLE:
        return False
