"""What is known of a packing, gathered once: counts, verdict, moduli, modes, and what each of them cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, integer, one_of, real
from packmech.compiled import compile_clock, compiling_noted
from packmech.contacts import Contacts, find_contacts
from packmech.measure import energy, force_balance, packing_fraction, pressure, stress_tensor
from packmech.measure.link_tension import link_gradients
from packmech.measure.rattlers import find_rattlers
from packmech.outcome import NotConverged, Stage
from packmech.packing import Packing
from packmech.scene import Scene

if TYPE_CHECKING:
    from packmech.mechanics.modes import Modes
    from packmech.mechanics.moduli import Moduli
    from packmech.mechanics.verdict import Verdict

# what a part of the examination may raise for a packing that does not allow it; the other parts still count
REFUSALS = (NotConverged, np.linalg.LinAlgError, ValueError)
# contacts that overlap by no more than so many spacings of the coordinates, in the mean, carry no force but rounding
_SPACINGS = 8.0
# squared frequencies below this, in units of the largest, are rounding
_ZERO = 1e-12


@dataclass(eq=False)
class Report:
    """A scene's packing examined.

    Attributes
    ----------
    scene
        The scene as it stands.
    numbers
        Results by name, as `packmech jam --json` writes them. Pressures and moduli are in units of
        energy_scale / reference_diameter^d: elastic_constants are second derivatives of the energy by symmetric
        strains over the volume, stiffness_cauchy is the Mandel matrix of the Cauchy stress. Frequencies are in units
        of sqrt(energy_scale / mass) / reference_diameter; those of at most frequency_floor are zero to rounding.
        force_residual is None where no contact carries a force.
    stages
        What each part of the examination achieved and cost.
    missing
        Parts that could not be had, with the reason.
    verdict, moduli, modes
        The records themselves; None where missing.

    """

    scene: Scene
    numbers: dict[str, Any]
    stages: list[Stage] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    verdict: Verdict | None = None
    moduli: Moduli | None = None
    modes: Modes | None = None


def examine(
    scene: Scene,
    *,
    strain: str = "fixed",
    modes: int = 10,
    gap_tolerance: float | None = None,
    method: str = "certificate",
    told: Callable[[str], None] = lambda part: None,
) -> Report:
    """Return everything that the command prints about a packing as it stands.

    Parameters
    ----------
    scene
        The scene; nothing in it is moved.
    strain
        Whether the packing was made in a "fixed" box or with every strain "free": which isostatic count applies.
    modes
        How many of the lowest vibrations, translations and rattlers left out.
    gap_tolerance, method
        Of the verdict, as `classify_jamming` takes them.
    told
        Called with the name of each part before it begins.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or unknown.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=1e-6)
    >>> report = examine(pm.Scene(crystal, (pm.Repulsion(),)), modes=2)
    >>> report.numbers["contacts"], report.numbers["isostatic_contacts"], report.numbers["strict"]
    (48, 31, 'jammed')

    """
    instance("scene", scene, Scene)
    one_of("strain", strain, ("fixed", "free"))
    modes = integer("modes", modes, at_least=0)
    asked = check_judging(gap_tolerance, method)
    report = Report(scene, _counts(scene, strain))
    with _part(report, "verdict", told):
        _verdict(report, *asked)
    with _part(report, "moduli", told):
        _moduli(report)
    if modes:
        with _part(report, "modes", told):
            _modes(report, modes)
    return report


def isostatic_contacts(particles: int, dimension: int, strain: str, links: int = 0) -> int:
    """Return the fewest contacts that jam this many backbone particles: d N' - d + 1, with strains d N' - d + d(d+1)/2.

    Independent links between them each take the place of a contact.

    Examples
    --------
    >>> isostatic_contacts(100, 2, "fixed"), isostatic_contacts(100, 2, "free"), isostatic_contacts(100, 3, "fixed")
    (199, 201, 298)

    """
    if particles == 0:
        return 0
    extra = 1 if strain == "fixed" else dimension * (dimension + 1) // 2
    return dimension * particles - dimension + extra - links


@contextmanager
def _part(report: Report, name: str, told: Callable[[str], None]) -> Iterator[None]:
    told(name)
    try:
        with compile_clock() as clock:
            yield
        done = report.stages[-1]
        report.stages[-1] = replace(done, note=compiling_noted(done.note, clock(), done.seconds))
    except REFUSALS as refusal:
        report.missing[name] = str(refusal).partition("\n")[0]


def _counts(scene: Scene, strain: str) -> dict[str, Any]:
    packing = scene.packing
    linked: dict[str, Any] = {}
    held_links = 0
    if packing.links is None:
        rattler_n = find_rattlers(packing)
    else:
        rattler_n, held_links = _links(packing, linked)
    contacts = find_contacts(packing)
    held_c = ~rattler_n[contacts.i_c] & ~rattler_n[contacts.j_c]
    backbone = packing.particles - int(rattler_n.sum())
    largest, mean = force_balance(scene) if _carries_force(packing, contacts) else (0.0, 0.0)
    unit = scene.pressure_unit
    return {
        "particles": packing.particles,
        "dimension": packing.dimension,
        "packing_fraction": packing_fraction(packing),
        "pressure": pressure(scene) / unit + 0.0,  # no minus zero
        "pressure_unit": unit,
        "energy": energy(scene) / scene.energy_scale,
        "stress": (stress_tensor(scene) / unit).tolist(),
        "rattlers": packing.particles - backbone,
        "contacts": int(held_c.sum()),
        "isostatic_contacts": isostatic_contacts(backbone, packing.dimension, strain, held_links),
        "strain": strain,
        "force_residual": largest / mean if mean > 0.0 else None,
        **linked,
    }


def _links(packing: Packing, numbers: dict[str, Any]) -> tuple[NDArray[np.bool_], int]:
    """Return which particles move apart from the backbone, and how many links hold it; tell of the links."""
    from packmech.contacts.crossing import crossing_links
    from packmech.mechanics.rattling import find_rattling_clusters

    links = packing.links
    assert links is not None and links.shape_l is not None
    rattling_n = find_rattling_clusters(packing).rattling_n
    within = ~rattling_n[links.i_l] & ~rattling_n[links.j_l] & ~link_gradients(packing).dependent_l
    numbers["links"] = len(links)
    numbers["shape_links"] = int(links.shape_l.sum())
    numbers["backbone_links"] = int(within.sum())
    numbers["link_error"] = packing.link_error
    if packing.dimension == 2:
        numbers["crossing_links"] = len(crossing_links(packing))
    return rattling_n, int(within.sum())


def _carries_force(packing: Packing, contacts: Contacts) -> bool:
    """Whether overlaps are more than what rounding of the coordinates makes of particles that just touch."""
    extent = max(float(np.abs(packing.position_nd).max()), float(np.abs(packing.box.lattice_dd).max()))
    overlap = float(np.maximum(-contacts.gap_c, 0.0).mean()) if len(contacts) else 0.0
    return overlap > _SPACINGS * float(np.spacing(extent))


def check_judging(gap_tolerance: float | None, method: str) -> tuple[float | None, str]:
    """Return what was asked of a verdict after checking it: a part of the report may be missing, but not for that.

    Parameters
    ----------
    gap_tolerance, method
        As `classify_jamming` takes them.

    Raises
    ------
    TypeError, ValueError
        If the tolerance is no number that it takes, or the method is unknown.

    """
    from packmech.mechanics.jamming import METHODS

    if gap_tolerance is not None:
        gap_tolerance = real("gap_tolerance", gap_tolerance, above=-0.1, below=1.0)
    return gap_tolerance, one_of("method", method, METHODS)


def _verdict(report: Report, gap_tolerance: float | None, method: str) -> None:
    from packmech.mechanics.jamming import classify_jamming
    from packmech.mechanics.verdict_text import verdict_numbers

    verdict = classify_jamming(report.scene, gap_tolerance=gap_tolerance, method=method)
    report.verdict = verdict
    answers = {"collective": verdict.collectively, "strict": verdict.strictly}
    strain = report.numbers["strain"]
    if verdict.touching.on_plateau:
        # the verdict's network allows for rounding in the gaps, so its counts are the better ones
        asked = answers["collective" if strain == "fixed" else "strict"]
        report.numbers |= {
            "rattlers": int(verdict.rattlers.sum()),
            "contacts": verdict.contacts,
            "isostatic_contacts": asked.isostatic_contacts,
            "states_of_self_stress": asked.states_of_self_stress,
        }
        if verdict.cluster_n is not None:
            report.numbers["backbone_links"] = verdict.backbone_links
    report.numbers |= verdict_numbers(verdict)
    report.stages.append(Stage("verdict", max(a.balance for a in answers.values()), seconds=verdict.seconds))


def _moduli(report: Report) -> None:
    from packmech.mechanics.elasticity import elastic_moduli

    moduli = elastic_moduli(report.scene)
    report.moduli = moduli
    unit = report.scene.pressure_unit
    report.numbers |= {
        "bulk_modulus": moduli.bulk_modulus / unit,
        "shear_modulus": moduli.shear_modulus / unit,
        "shear_modulus_mean": moduli.voigt.shear_modulus / unit,
        "shear_modulus_reuss": moduli.reuss.shear_modulus / unit,
        "elastic_constants": {name: moduli.component(name, tangent="energy") / unit for name in _constants(moduli)},
        "stiffness_cauchy": (moduli.cauchy / unit).tolist(),
        "negative_modes": moduli.negative_modes,
        "soft_directions": len(moduli.soft_directions),
        "elastically_stable": moduli.stable,
    }
    report.stages.append(Stage("moduli", moduli.residual, seconds=moduli.seconds))


def _constants(moduli: Moduli) -> list[str]:
    """Name each independent component of the stiffness once: xxxx, xxyy, xxxy, ..."""
    axes = "xyz"[: moduli.dimension]
    pairs = [2 * axis for axis in axes] + [a + b for k, a in enumerate(axes) for b in axes[k + 1 :]]
    return [first + second for k, first in enumerate(pairs) for second in pairs[k:]]


def _modes(report: Report, count: int) -> None:
    from packmech.mechanics.modes import normal_modes

    scene = report.scene
    modes = normal_modes(scene, count)
    report.modes = modes
    unit = np.sqrt(scene.energy_scale) / scene.packing.reference_diameter
    report.numbers["lowest_frequencies"] = (modes.frequency_m / unit).tolist()
    report.numbers["frequency_floor"] = float(np.sqrt(_ZERO * modes.largest)) / unit
    report.stages.append(Stage("modes", modes.residual, seconds=modes.seconds))
