"""What is known of a packing, gathered once: counts, verdict, moduli, modes, and what each of them cost."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.status import shown_as
from packmech.check import BoxStrain, brief, function, instance, integer, one_of, real
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts, crossing_links, find_contacts
from packmech.effects import (
    Friction,
    Gravity,
    MeshWalls,
    RollingResistance,
    TwistingResistance,
    Walls,
    acting_contacts,
    acting_friction,
    acts_on_single,
    friction_of,
    held_particles,
    rolling_spring_of,
    twisting_of,
)
from packmech.jamming.classify import METHODS, classify_jamming
from packmech.jamming.verdict import Verdict, verdict_numbers, verdict_rows
from packmech.jit.compiled import compile_clock, compiling_noted
from packmech.measure.contact_forces import contact_forces, force_balance, rattlers_in, resting_forces
from packmech.measure.counting import mean_contacts, mean_of_moving, packing_fraction
from packmech.measure.stress import energy, pressure, stress_tensor
from packmech.measure.walls import wall_contacts
from packmech.mechanics.elasticity import Moduli, elastic_moduli
from packmech.mechanics.modes import Modes, normal_modes
from packmech.mechanics.network import contact_network
from packmech.mechanics.quartic import quartic_modes
from packmech.packing import Packing
from packmech.protocols.protocol import shaped_count
from packmech.result import NotConverged, Row, Run, Stage, Summary, onset_row, particles_in_words
from packmech.scene import Scene

# what a part of the examination may raise for a packing that does not allow it; the other parts still count
REFUSALS = (NotConverged, np.linalg.LinAlgError, ValueError)
# contacts that overlap by no more than so many spacings of the coordinates, in the mean, carry no force but rounding
_SPACINGS = 8.0
# squared frequencies below this, in units of the largest, are rounding
_ZERO = 1e-12
# what a run says of itself that the report takes in; what is counted from its packing is left to the report
_OF_RUN = (
    *(
        "outcome",
        "steps",
        "force_evaluations",
        "seconds",
        "build_seconds",
        "method",
        "start",
        "jamming_packing_fraction",
        "onset_between",
        "cementing",
    ),
    *("pressure_asked", "stress_anisotropy", "gap_error", "force_imbalance", "redundant_patches"),
)

# what is not asked with friction, and what to use instead
_WITH_FRICTION = {
    "verdict": "it is about particles without friction, whose contacts push along their normals alone; with friction "
    "compare contacts with the isostatic number, and see pm.contact_forces and `packmech guide friction`",
    "modes": "with friction: pm.frictional_modes",
}
# largest net force over the mean contact force of what is at rest, where no verdict knows better [1]
_AT_REST = 1e-5
# counts that friction makes others
_OF_SMOOTH_CONTACTS = ("floppy_modes", "states_of_self_stress", "rank_certain")
# overlap over the contact distance beyond which laws of contacts are out of place [1]
_DEEP = 0.5
# how many different sizes are listed, each with its count
_FEW = 4

ReportFunction = Callable[[Scene], bool | int | float | str | None]


@dataclass(frozen=True)
class ReportFigure:
    """A figure of the report that was added: what it is called there, its unit, and the function of a scene."""

    name: str
    function: ReportFunction
    unit: str = ""
    label: str = ""


REPORT_FIGURES: dict[str, ReportFigure] = {}


@shown_as("figure")
def report_figure(*, unit: str = "", label: str = "") -> Callable[[ReportFunction], ReportFunction]:
    """Return a decorator that adds a function of a scene to the reports of packings.

    The function's name is that of the figure in ``--json`` and in `Report.numbers`. It is given the scene with the
    packing as it stands and returns a number, a text, True or False, or None where it has no meaning.

    Parameters
    ----------
    unit
        Its unit, or what it is: the note in the table.
    label
        What the table calls it; the name unless given.

    Raises
    ------
    TypeError, ValueError
        If what is decorated is no function with a name.

    Examples
    --------
    >>> import packmech as pm
    >>> @pm.report_figure(unit="length")
    ... def largest_gap(scene):
    ...     return float(pm.find_contacts(scene.packing, gap_tolerance=0.5).gap_c.max())
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=-0.01)
    >>> round(examine(pm.Scene(crystal, (pm.Repulsion(),)), modes=0).numbers["largest_gap"], 3)
    0.01
    >>> del REPORT_FIGURES["largest_gap"]

    """
    instance("unit", unit, str)
    instance("label", label, str)

    def add(measure: ReportFunction) -> ReportFunction:
        function("measure", measure)
        name = str(getattr(measure, "__name__", ""))
        if not name.isidentifier():
            raise ValueError(f"measure must be a function with a name, got {brief(measure)}")
        REPORT_FIGURES[name] = ReportFigure(name, measure, unit, label or name.replace("_", " "))
        return measure

    return add


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
        of sqrt(energy_scale / mean mass) / reference_diameter; those of at most frequency_floor are zero to rounding.
        force_residual is None where no contact carries a force.
    stages
        What each part of the examination achieved and cost.
    missing
        Parts that could not be had, with the reason.
    verdict, moduli, modes
        The records themselves; None where missing.
    run
        The run that made the packing, if there was one.

    """

    scene: Scene
    numbers: dict[str, Any]
    stages: list[Stage] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    verdict: Verdict | None = None
    moduli: Moduli | None = None
    modes: Modes | None = None
    run: Run | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the results by name, as plain values, with what the run says of itself."""
        numbers = dict(self.numbers)
        if self.run is None:
            numbers["seconds"] = sum(stage.seconds for stage in self.stages)
        else:
            of_run = self.run.to_dict()
            numbers |= {name: of_run[name] for name in _OF_RUN if name in of_run}
            if numbers["force_residual"] is not None:  # some contact carries a force
                numbers["force_residual"] = self.run.residual
        return numbers

    def summary(self) -> Summary:
        """Return the results and what each step achieved and cost, in words."""
        before = () if self.run is None else self.run.summary().stages
        rows = result_rows(self.to_dict(), self.missing)
        return Summary(particles_in_words(self.scene.packing), tuple(rows), (*before, *self.stages))


def examine(
    scene: Scene,
    *,
    run: Run | None = None,
    strain: BoxStrain = "isotropic",
    modes: int = 10,
    verdict: bool = True,
    gap_tolerance: float | None = None,
    method: str = "certificate",
    progress: Callable[[str], None] = lambda part: None,
) -> Report:
    """Return everything that the command prints about a packing as it stands.

    Parameters
    ----------
    scene
        The scene; nothing in it is moved.
    run
        The run that made its packing; its outcome and cost are reported too.
    strain
        "isotropic": the box kept its shape; "free": every strain relaxed. It decides the isostatic count.
    modes
        How many of the lowest vibrations, translations and rattlers left out.
    verdict
        Whether to ask if it is jammed, or of shapes for their quartic modes.
    gap_tolerance, method
        Of the verdict, as `classify_jamming` takes them.
    progress
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
    one_of("strain", strain, ("isotropic", "free"))
    modes = integer("modes", modes, at_least=0)
    asked = check_verdict_settings(gap_tolerance, method)
    effects = scene.effects
    rough = any(one is not None for one in (acting_friction(effects), rolling_spring_of(effects), twisting_of(effects)))
    if not rough:
        # those of coefficient 0 are none
        scene = scene.without(Friction, RollingResistance, TwistingResistance)
    report = Report(scene, _counts(scene, strain), run=run)
    if rough and not verdict:
        report.missing |= {"modes": _WITH_FRICTION["modes"]} if modes else {}
    elif rough:
        report.missing |= _WITH_FRICTION if modes else {"verdict": _WITH_FRICTION["verdict"]}
    elif verdict and scene.packing.shapes.has_orientations:
        with _part(report, "quartic modes", progress):
            _stability(report)
    elif verdict:
        with _part(report, "verdict", progress):
            _verdict(report, *asked)
        if _has_its_hard_packing(report):
            with _part(report, "verdict of the hard packing", progress):
                _hard_verdict(report, asked[1])
    if "coordination_number" not in report.numbers:  # with friction it counts contacts that bear a force
        # made of the counts that are shown, which the verdict may have bettered
        counts = (report.numbers[name] for name in ("contacts", "rattlers", "particles"))
        report.numbers["coordination_number"] = mean_contacts(*counts)
    report.numbers |= _excess(report.numbers)
    with _part(report, "moduli", progress):
        _moduli(report)
    if modes and not rough:
        with _part(report, "modes", progress):
            _modes(report, modes)
    if report.numbers.get("at_rest") is None:
        report.numbers["at_rest"] = resting_forces(scene).balances_to(_AT_REST)
    for figure in REPORT_FIGURES.values():
        try:
            found = figure.function(scene)
        except REFUSALS as refusal:
            report.missing[figure.label] = str(refusal).partition("\n")[0]
        else:
            if found is not None:
                report.numbers[figure.name] = found
    return report


def isostatic_contacts(particles: int, dimension: int, strain: BoxStrain, links: int = 0) -> int:
    """Return the fewest contacts that jam this many backbone particles: d N' - d + 1, with strains d N' - d + d(d+1)/2.

    Independent links between them each take the place of a contact.

    Examples
    --------
    >>> tuple(isostatic_contacts(100, d, strain) for d, strain in ((2, "isotropic"), (2, "free"), (3, "isotropic")))
    (199, 201, 298)

    """
    if particles == 0:
        return 0
    extra = 1 if strain == "isotropic" else dimension * (dimension + 1) // 2
    return dimension * particles - dimension + extra - links


@contextmanager
def _part(report: Report, name: str, progress: Callable[[str], None]) -> Iterator[None]:
    progress(name)
    try:
        # the report itself says of a packing that it is not at rest
        with compile_clock() as clock, warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            yield
        done = report.stages[-1]
        report.stages[-1] = replace(done, note=compiling_noted(done.note, clock(), done.seconds))
    except REFUSALS as refusal:
        report.missing[name] = str(refusal).partition("\n")[0]


def _counts(scene: Scene, strain: BoxStrain) -> dict[str, Any]:
    packing, unit = scene.packing, scene.pressure_unit
    counted = (_counts_of_shapes if packing.shapes.has_orientations else _counts_of_discs)(scene, strain)
    bears = counted.pop("bears", True)
    if friction_of(scene.effects) is not None:
        counted = _counts_with_friction(scene, counted)
    largest, mean = force_balance(scene) if bears else (0.0, 0.0)
    return {
        "particles": packing.particles,
        "dimension": packing.dimension,
        **_sizes(packing),
        **_kinds(packing),
        "packing_fraction": packing_fraction(packing),
        "pressure": pressure(scene) / unit + 0.0,  # no minus zero
        "pressure_unit": unit,
        "energy": energy(scene) / scene.energy_scale,
        "stress": (stress_tensor(scene) / unit).tolist(),
        **counted,
        **_supported(scene),
        "strain": strain,
        "force_residual": largest / mean if mean > 0.0 else None,
    }


def _supported(scene: Scene) -> dict[str, Any]:
    """Return what particles do to walls and held particles along gravity, and their weight [force].

    Nothing without gravity, nor where nothing holds them, or links do, whose tension is not counted.
    """
    packing, d = scene.packing, scene.packing.dimension
    pull = sum((np.array(one[:d]) for one in scene.effects if isinstance(one, Gravity)), np.zeros(d))
    strength = float(np.sqrt(pull @ pull))
    held, links = held_particles(scene.effects, packing.particles), packing.links
    held_n = np.zeros(packing.particles, dtype=bool) if held is None else held
    tied = bool((held_n[links.i_l] != held_n[links.j_l]).any())
    walled = any(isinstance(one, Walls | MeshWalls) for one in scene.effects)
    if strength == 0.0 or tied or not (walled or held_n.any()):
        return {}
    on_held = -resting_forces(scene).reaction_nd.sum(axis=0)
    on_walls = wall_contacts(scene).on_walls() if walled else np.zeros(d)
    return {
        "force_on_held": float(on_held @ pull) / strength,
        "force_on_walls": float(on_walls @ pull) / strength,
        "weight": strength * float(packing.mass_n[~held_n].sum()),
    }


def _sizes(packing: Packing) -> dict[str, Any]:
    """Return the smallest and the largest diameter [length], and each with its count where there are few."""
    if packing.shapes.has_orientations:
        return {}
    diameter, count = np.unique(2.0 * packing.radius_n, return_counts=True)
    listed = list(zip(diameter.tolist(), count.tolist(), strict=True)) if len(diameter) <= _FEW else []
    return {"diameter_min": float(diameter[0]), "diameter_max": float(diameter[-1]), "diameters": listed}


def _kinds(packing: Packing) -> dict[str, Any]:
    """Return how many particles are of each kind, where there are several."""
    kind_n = packing.given_kind_n
    return {} if kind_n is None else {"kinds": np.bincount(kind_n).tolist()}


def _counts_of_discs(scene: Scene, strain: BoxStrain) -> dict[str, Any]:
    """Return the counts of a packing of discs or spheres, and whether its contacts bear a force."""
    packing = scene.packing
    rattler_n = rattlers_in(scene)
    linked = _links(packing, rattler_n)
    # weights and walls need no count of contacts to balance
    acting = acts_on_single(scene.effects)
    contacts = acting_contacts(find_contacts(packing, gap_tolerance=0.0), scene.effects)
    backbone = packing.particles - int(rattler_n.sum())
    isostatic: int | None = isostatic_contacts(backbone, packing.dimension, strain, linked.get("backbone_links", 0))
    overlap_c = -contacts.gap_c / contacts.contact_distance_c
    return {
        "bears": _carries_force(packing, contacts),
        "largest_overlap": float(overlap_c.max(initial=0.0)) + 0.0,
        "rattlers": packing.particles - backbone,
        "contacts": int((~rattler_n[contacts.i_c] & ~rattler_n[contacts.j_c]).sum()),
        "isostatic_contacts": None if acting else isostatic,
        **({"wall_contacts": len(wall_contacts(scene))} if acting else {}),
        **linked,
        **_of_moving(scene, contacts.among(~rattler_n).count_n(), rattler_n),
    }


def _excess(numbers: Mapping[str, Any]) -> dict[str, Any]:
    """Return z - z_iso; nothing where all rattle, or walls and weights make that no measure of what holds them.

    z_iso is 2 / N' times the isostatic number of contacts, and with friction (d + 1) + 2 n_m / d.
    """
    contacts, rattlers, particles = (numbers[name] for name in ("isostatic_contacts", "rattlers", "particles"))
    if contacts is None or rattlers == particles:
        return {}
    isostatic = numbers.get("isostatic_coordination", mean_contacts(contacts, rattlers, particles))
    return {"excess_coordination": numbers["coordination_number"] - isostatic}


def _of_moving(scene: Scene, count_n: NDArray[np.int64], rattler_n: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the coordination number of what moves, and how much is held; nothing where nothing is."""
    held = held_particles(scene.effects, scene.packing.particles)
    if held is None:
        return {}
    return {"held": int(held.sum()), "coordination_number": mean_of_moving(count_n, rattler_n, held)}


def _counts_with_friction(scene: Scene, smooth: Mapping[str, Any]) -> dict[str, Any]:
    """Return the counts with what friction holds in place of those of smooth contacts."""
    found = contact_forces(scene)
    kept = ~found.rattlers_n
    counted = {name: value for name, value in smooth.items() if name not in _OF_SMOOTH_CONTACTS}
    if counted["isostatic_contacts"] is not None:
        isostatic = found.isostatic_coordination
        counted["isostatic_contacts"] = math.ceil(0.5 * int(kept.sum()) * isostatic)
        counted["isostatic_coordination"] = isostatic
    held = held_particles(scene.effects, scene.packing.particles)
    numbers, named = found.to_dict(), ("coordination_number", "contacts_at_limit", "doubtful_at_limit")
    return counted | {
        "rattlers": int((~kept).sum()),
        "contacts": len(found.contacts.among(kept)),
        **{name: numbers[name] for name in named},
        **({} if held is None else {"held": int(held.sum())}),
    }


def _counts_of_shapes(scene: Scene, strain: BoxStrain) -> dict[str, Any]:
    """Return the counts of a packing with shapes."""
    counted = _counts_on_walls(scene) if acts_on_single(scene.effects) else shaped_count(scene.packing, strain)
    return {name: value for name, value in counted.items() if name not in ("particles", "excess_contacts")}


def _counts_on_walls(scene: Scene) -> dict[str, Any]:
    """Return the counts of a packing with shapes that walls, weights or held particles hold, too."""
    network = contact_network(scene.packing, scene.effects, second=False)
    count_n, rattler_n = np.zeros(scene.packing.particles, dtype=np.int64), np.ones(scene.packing.particles, dtype=bool)
    count_n[network.index_n], rattler_n[network.index_n] = network.contacts.count_n(), False
    return {
        "rattlers": scene.packing.particles - len(network.index_n),
        "contacts": len(network.contacts),
        "isostatic_contacts": None,
        "wall_contacts": len(wall_contacts(scene)),
        **_of_moving(scene, count_n, rattler_n),
    }


def _links(packing: Packing, rattling_n: NDArray[np.bool_]) -> dict[str, Any]:
    """Return the counts of the links, if there are any: all of them, and those that hold the backbone."""
    links = packing.links
    if not len(links):
        return {}
    within = ~rattling_n[links.i_l] & ~rattling_n[links.j_l] & ~ConstraintFactor(packing).dependent_l
    return {
        "links": len(links),
        "shape_links": int(links.shape_l.sum()),
        "backbone_links": int(within.sum()),
        "link_error": packing.link_error,
        **({"crossing_links": len(crossing_links(packing))} if packing.dimension == 2 else {}),
    }


def _carries_force(packing: Packing, contacts: Contacts) -> bool:
    """Whether overlaps are more than what rounding of the coordinates makes of particles that just touch."""
    extent = max(float(np.abs(packing.position_nd).max()), float(np.abs(packing.box.lattice_dd).max()))
    overlap = float(np.maximum(-contacts.gap_c, 0.0).mean()) if len(contacts) else 0.0
    return overlap > _SPACINGS * float(np.spacing(extent))


def check_verdict_settings(gap_tolerance: float | None, method: str) -> tuple[float | None, str]:
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
    if gap_tolerance is not None:
        gap_tolerance = real("gap_tolerance", gap_tolerance, above=-0.1, below=1.0)
    return gap_tolerance, one_of("method", method, METHODS)


def _verdict(report: Report, gap_tolerance: float | None, method: str) -> None:
    verdict = classify_jamming(report.scene, gap_tolerance=gap_tolerance, method=method)
    report.verdict = verdict
    answers = {"collective": verdict.collectively, "strict": verdict.strictly}
    strain = report.numbers["strain"]
    if verdict.touching.on_plateau:
        # the verdict's network allows for rounding in the gaps, so its counts are the better ones
        asked = answers["collective" if strain == "isotropic" else "strict"]
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


def _has_its_hard_packing(report: Report) -> bool:
    """Whether overlaps hide which particles touch, and the run began at a hard packing of the same contacts."""
    verdict, known = report.verdict, getattr(report.run, "report", {})
    return verdict is not None and not verdict.touching.on_plateau and {"onset_between", "hard_packing"} <= set(known)


def _hard_verdict(report: Report, method: str) -> None:
    assert report.run is not None
    verdict = classify_jamming(report.run.report["hard_packing"], method=method)
    report.numbers |= {"hard_collective": verdict.collective, "hard_strict": verdict.strict}
    balance = max(verdict.collectively.balance, verdict.strictly.balance)
    report.stages.append(Stage("verdict of the hard packing", balance, seconds=verdict.seconds))


def _stability(report: Report) -> None:
    """Ask the Hessian of a packing with shapes, and what only its contact forces hold."""
    scene = report.scene
    if report.numbers["rattlers"] == report.numbers["particles"]:
        raise ValueError("no particle is held")
    lowest = normal_modes(scene, 1)
    numbers = report.numbers
    numbers["local_minimum"] = lowest.negative == 0
    quartic = quartic_modes(scene, strain="none" if numbers["strain"] == "isotropic" else "isochoric")
    numbers["quartic_modes"] = len(quartic)
    if quartic.free_turns:
        numbers["free_turns"] = quartic.free_turns
    if len(quartic) and quartic.pressure > 0.0:
        numbers["least_quartic_curvature"] = float(quartic.curvature_m[0]) / quartic.pressure
    report.stages.append(Stage("quartic modes", quartic.stretch, seconds=quartic.seconds + lowest.seconds))


def _moduli(report: Report) -> None:
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
    scene = report.scene
    modes = normal_modes(scene, count)
    report.modes = modes
    packing = scene.packing
    unit = np.sqrt(scene.energy_scale / packing.mass_n.mean()) / packing.reference_diameter
    report.numbers["lowest_frequencies"] = (modes.frequency_m / unit).tolist()
    report.numbers["frequency_floor"] = float(np.sqrt(_ZERO * modes.largest)) / unit
    report.stages.append(Stage("modes", modes.residual, seconds=modes.seconds))


# what a run that went on from a jammed packing says of it
_FOLLOWED = {
    "continued": ", followed from the packing as it stood",
    "rearranged": ", followed from the packing as it stood, whose contacts rearranged on the way",
}


def result_rows(numbers: Mapping[str, Any], missing: Mapping[str, str]) -> list[Row]:
    """Return rows of quantity, value and what the value is, for what the numbers hold."""
    d = numbers["dimension"]
    unit = f"energy_scale / diameter^{d}"
    rows: list[Row] = []
    if _moves(numbers):
        note = "counts, verdict and moduli mean little as it stands: relax it first, by packmech jam FILE or pm.quench"
        rows.append(("NOT AT REST", "", note))
    if "jamming_packing_fraction" in numbers:
        followed = _FOLLOWED.get(numbers.get("start", ""), "")
        note = f"of the hard packing, rattlers included; protocol {numbers['method']}{followed}"
        rows.append(("packing fraction at jamming", f"{numbers['jamming_packing_fraction']:.8f}", note))
    if "onset_between" in numbers:
        rows.append(onset_row(*numbers["onset_between"]))
    rows += [
        *_sizes_row(numbers),
        *_kinds_row(numbers),
        ("packing fraction", f"{numbers['packing_fraction']:.8f}", "as it stands, rattlers included"),
        *_deep_row(numbers),
        ("pressure", f"{numbers['pressure']:.6g}", unit),
        _residual(numbers["force_residual"]),
        *_supported_row(numbers),
        _contacts_row(numbers),
        _coordination_row(numbers),
        _rattlers(numbers),
    ]
    if "links" in numbers:
        rows.append(_link_row(numbers))
    if numbers.get("redundant_patches"):
        sizes = ", ".join(str(len(patch)) for patch in numbers["redundant_patches"])
        rows.append(("redundant self stress", "yes", f"crystalline patches of {sizes} particles, listed in --json"))
    if "collective" in numbers:
        rows += verdict_rows(numbers)
    if "hard_strict" in numbers:
        answer = f"collectively {numbers['hard_collective']}, strictly {numbers['hard_strict']}"
        rows.append(("hard packing", answer, "that it was pressed from, by its exact contacts"))
    if "local_minimum" in numbers:
        rows += _stability_rows(numbers)
    if "bulk_modulus" in numbers:
        rows += _moduli_rows(numbers, unit)
    if "lowest_frequencies" in numbers:
        rows.append(_frequencies(numbers["lowest_frequencies"][:6], numbers["frequency_floor"]))
    for figure in REPORT_FIGURES.values():
        if figure.name in numbers:
            value = numbers[figure.name]
            rows.append((figure.label, f"{value:.6g}" if isinstance(value, float) else str(value), figure.unit))
    rows += [(part, "not available", reason) for part, reason in missing.items()]
    return rows


def _moves(numbers: Mapping[str, Any]) -> bool:
    """Whether a packing that was given, not made by a run, is out of balance."""
    if "outcome" in numbers or numbers["force_residual"] is None:
        return False
    return not numbers["at_rest"]


def _sizes_row(numbers: Mapping[str, Any]) -> list[Row]:
    """Return how large the particles are, where the numbers hold it."""
    if "diameters" not in numbers:
        return []
    words, note = ", ".join(f"{count} of {size:.6g}" for size, count in numbers["diameters"]), "particles of a diameter"
    if not words:
        words, note = f"{numbers['diameter_min']:.4g} to {numbers['diameter_max']:.4g}", "diameters"
    return [("sizes", words, f"{note} [length]")]


def _kinds_row(numbers: Mapping[str, Any]) -> list[Row]:
    """Return how many particles are of each kind, where there are several."""
    if "kinds" not in numbers:
        return []
    words = ", ".join(f"{count} of {kind}" for kind, count in enumerate(numbers["kinds"]) if count)
    return [("kinds", words, "particles of a kind")]


def _deep_row(numbers: Mapping[str, Any]) -> list[Row]:
    """Return the largest overlap, over the contact distance, where it is more than laws of contacts are meant for."""
    overlap = numbers.get("largest_overlap", 0.0)
    if overlap <= _DEEP:
        return []
    note = f"DEEP: beyond {_DEEP:.0%} of the contact distance laws of contacts mean little; lower the pressure"
    return [("largest overlap", f"{overlap:.1%}", note)]


def _residual(residual: float | None) -> Row:
    if residual is None:
        return ("force residual", "-", "no contact carries a force")
    return ("force residual", f"{residual:.1e}", "largest net force / mean contact force")


def _supported_row(numbers: Mapping[str, Any]) -> list[Row]:
    """Return what walls and held particles bear, beside the weight that they have to bear at rest."""
    if "weight" not in numbers:
        return []
    held, walls = numbers["force_on_held"], numbers["force_on_walls"]
    where = "walls" if not numbers.get("held") else "held particles"
    if numbers.get("held") and walls:
        where = f"held particles ({held:.6g}) and walls ({walls:.6g})"
    note = f"on {where}, along gravity [force]; weight of the particles that are not held: {numbers['weight']:.6g}"
    return [("force on supports", f"{held + walls:.6g}", note)]


def _frequencies(frequencies: Sequence[float], floor: float) -> Row:
    listed = ["0" if abs(value) <= floor else f"{value:.3g}" for value in frequencies]
    note = "sqrt(energy_scale / mean mass) / diameter"
    if "0" in listed:
        note += f"; 0: within rounding, {floor:.0e} (1e-6 of the stiffest)"
    return ("lowest frequencies", "  ".join(listed) or "none", note)


def _contacts_row(numbers: Mapping[str, Any]) -> Row:
    d = numbers["dimension"]
    all_strains = d * (d + 1) // 2
    extra, other, words = (
        (1, all_strains, "free") if numbers["strain"] == "isotropic" else (all_strains, 1, "isotropic")
    )
    note = f"isostatic: {numbers['isostatic_contacts']}"
    if numbers["isostatic_contacts"] is None:
        note = f"and {numbers['wall_contacts']} with walls"
    if "contacts_at_limit" in numbers:
        note += f" with friction; {numbers['contacts_at_limit']} at the Coulomb limit"
        note += f", {numbers['doubtful_at_limit']} of doubt" if numbers["doubtful_at_limit"] else ""
    elif "rank_certain" in numbers:
        note += f" with turns, strain {numbers['strain']}"
        note += "" if numbers["rank_certain"] else "; rank uncertain"
    elif numbers["isostatic_contacts"]:
        less = " - L'" if "links" in numbers else ""
        note += f" = {d}N'{extra - d:+d}{less}, strain {numbers['strain']}"
        note += f" ({numbers['isostatic_contacts'] + other - extra} with strain {words})"
    if "states_of_self_stress" in numbers:
        states = numbers["states_of_self_stress"]
        note += f"; {states} state{'s' if states != 1 else ''} of self stress"
    return ("contacts", str(numbers["contacts"]), note)


def _coordination_row(numbers: Mapping[str, Any]) -> Row:
    which = "contacts that bear a force" if "contacts_at_limit" in numbers else "contacts"
    counted = "that is no rattler, 2 N_c / N'"
    if numbers.get("held"):
        counted = f"that neither rattles nor is one of {numbers['held']} held"
    note = f"{which} per particle {counted}"
    if "excess_coordination" in numbers:
        note += f"; {numbers['excess_coordination']:+.4f} beyond the isostatic one"
    return ("coordination number", f"{numbers['coordination_number']:.4f}", note)


def _rattlers(numbers: Mapping[str, Any]) -> Row:
    share = numbers["rattlers"] / numbers["particles"]
    note = f"{share:.1%} of {numbers['particles']} particles"
    if "danglers" in numbers:
        note += f"; {numbers['danglers']} held by their clusters alone"
    if "rattling_clusters" in numbers:
        note += f", {numbers['rattling_clusters']} clusters rattle as a whole"
    return ("rattlers", str(numbers["rattlers"]), note)


def _link_row(numbers: Mapping[str, Any]) -> Row:
    shapes = numbers["shape_links"]
    note = f"{numbers['links'] - shapes} bonds, {shapes} hold shapes; lengths kept to {numbers['link_error']:.0e}"
    if numbers.get("crossing_links"):
        count = numbers["crossing_links"]
        note += f"; {count} pair{'s' if count != 1 else ''} of bonds CROSS"
    return ("links", str(numbers["links"]), note)


def _stability_rows(numbers: Mapping[str, Any]) -> list[Row]:
    held = "motions that stretch no contact, held by contact forces alone"
    if "least_quartic_curvature" in numbers:
        held += f"; least curvature {numbers['least_quartic_curvature']:.3g} of the pressure"
    if "free_turns" in numbers:
        held += f"; {numbers['free_turns']} turns of single bodies cost nothing and are none of them"
    asked = "by the Hessian, forces and turns included; as hard particles pm.classify_jamming judges it"
    rows = [("local minimum", "yes" if numbers["local_minimum"] else "NO", asked)]
    return [("quartic modes", str(numbers["quartic_modes"]), held), *rows] if "quartic_modes" in numbers else rows


def _moduli_rows(numbers: Mapping[str, Any], unit: str) -> list[Row]:
    shear = f"simple shear xy, relaxed; mean over directions {numbers['shear_modulus_mean']:.4g}, {unit}"
    if numbers.get("contacts_at_limit"):
        shear += f"; the {numbers['contacts_at_limit']} contacts at the Coulomb limit stick"
    if numbers["shear_modulus"] < 0.0:
        shear += "; NEGATIVE: this shear lowers the energy"
    if not numbers["elastically_stable"]:
        shear += "; elastically unstable: some motion of particles and box lowers the energy"
    return [
        ("bulk modulus", f"{numbers['bulk_modulus']:.6g}", f"box scaled, particles relaxed, {unit}"),
        ("shear modulus", f"{numbers['shear_modulus']:.6g}", shear),
    ]
