# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The cases of compare_versions.py: small, of every public call, in the words of the newer version.

A case is a function of the facade (see versions.py) that returns named results: arrays, numbers, texts, records of the
package and mappings of these, all of which are recorded. Runs through time return four groups: "early", everything up
to 100 steps; "later", everything beyond, chaotic where sums change their order; "conserved", what stays the same up to
a small number; "average", means over time, which do not depend on the order of sums.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

EARLY = 100


@dataclasses.dataclass(frozen=True)
class Near:
    """How far two versions may be apart: absolute + relative times the largest size in the array."""

    relative: float = 0.0
    absolute: float = 0.0


@dataclasses.dataclass(frozen=True)
class Agreement:
    """What a case has to agree in where it is not bit for bit, and why.

    Attributes
    ----------
    reason
        Why bits differ, for the table that is printed.
    arrays
        Pattern of array names -> Near, or None where nothing is compared. The first that matches holds; what none
        matches agrees bit for bit.

    """

    reason: str
    arrays: Mapping[str, Near | None]


def order_of_sums(reason: str, *, early: float = 1e-9, average: float = 0.05, **arrays: Near | None) -> Agreement:
    """Return the agreement of a run through time whose sums go in another order: rounding grows as chaos has it."""
    listed = {"early*": Near(early, early), "later*": None, "conserved*": Near(0.0, 1e-9), "average*": Near(average)}
    return Agreement(reason, {**arrays, **listed})


# pattern of case names -> agreement, where it is not bit for bit; the first pattern that matches holds
_ONE_ENGINE = order_of_sums(
    "without friction the tag had an engine of its own: sums now go by the blocks of the lists; the parts of stress "
    "and energy by torques and spins, contacts and lattice vectors are given for every scene, zero where nothing "
    "turns; with dashpots the residual is over elastic contact forces and the largest force that of the step, as in "
    "all scenes",
    **{
        f"*{name}": None
        for name in (
            *("lattice_tdd", "touching_t*", "torque_stress_tdd", "spin_stress_tdd", "bond_stress_tdd"),
            *("tangential_t", "rotational_t", "angular_momentum_tk"),
        )
    },
    **{"*residual": None, "early*max_force_t": Near(0.05)},
)
AGREEMENT: dict[str, Agreement] = {
    f"simulate/{name}": _ONE_ENGINE
    for name in (
        *("frictionless*", "dashpots that set in smoothly", "dimers*", "trimers*", "chains*", "links, Euler"),
        "default time step and duration",
    )
} | {f"checkpoint/simulate, {name}": _ONE_ENGINE for name in ("frictionless", "dimers", "trimers in space")}
AGREEMENT["scenarios/two-spheres-central"] = _ONE_ENGINE
for _name in ("simulate/bonds, 3D", "rheology/oscillatory, spheres"):
    AGREEMENT[_name] = Agreement(
        "potential energies in space are summed by code that is compiled for plane and space alike: their last bit",
        {"*.energy_t": Near(1e-15), "*.potential_t": Near(1e-15), "*.energy_drift": Near(0.0, 1e-15)},
    )

AGREEMENT["measure/effects of one's own"] = Agreement(
    _ONE_ENGINE.reason, {"*, blown*": Near(), "quench*": Near(), **_ONE_ENGINE.arrays}
)

for _name in (
    *("simulate/gravity and walls, 2D", "simulate/gravity and walls, 3D", "simulate/gravity and Hertzian walls"),
    "rheology/smooth walls",
):
    AGREEMENT[_name] = Agreement(
        "a contact with a wall is one with the mirror image: half the force of the tag, twice its dashpot", {"*": None}
    )

_ONE_FACTOR = (
    "forces in links and the response of linked packings come from the one factor of their constraints; the tag had "
    "an elimination of its own for each"
)
_ROUNDING = Near(1e-12)
AGREEMENT["measure/links"] = Agreement(
    _ONE_FACTOR,
    {"*.tension": _ROUNDING, "*.total": _ROUNDING, "*.links": _ROUNDING, "*.pressure": Near(0.0, 1e-15)},
)
AGREEMENT["jamming/motions played"] = Agreement(
    "motions are told relative to the backbone, whose mean displacement is another sum than that of all particles",
    {f"{name}.*": _ROUNDING for name in ("square, strictly", "blocked", "links")},
)
AGREEMENT["mechanics/Hessians"] = Agreement(_ONE_FACTOR, {"trimers, exact.*": _ROUNDING})
AGREEMENT["jamming/verdicts with links"] = Agreement(_ONE_FACTOR, {"*.rest.residual": Near(0.0, 1e-14)})
AGREEMENT["mechanics/modes and spectra"] = Agreement(_ONE_FACTOR, {"*.translation_error": Near(0.0, 1e-15)})
AGREEMENT["mechanics/moduli"] = Agreement(
    f"{_ONE_FACTOR}; averages of unstable packings are no longer numbers",
    {
        "*residual": Near(0.0, 1e-8),
        **{f"{kind}, *": Near(1e-9) for kind in ("dimers", "trimers", "chains")},
        **{f"*.exact.{bound}, *": None for bound in ("voigt", "reuss", "hill")},
    },
)
for _name in ("dimers", "trimers", "chains", "chains around the box"):
    AGREEMENT[f"jam/{_name}"] = Agreement(
        _ONE_FACTOR, {"*.report.pressure": _ROUNDING, "*.report.stress_anisotropy": Near(0.0, 1e-14)}
    )
for _name in ("step halving", "compress", "shear_stabilize"):
    AGREEMENT[f"jam/{_name}"] = Agreement(
        _ONE_FACTOR,
        {f"{kind}*.report.pressure": _ROUNDING for kind in ("trimers", "chains")}
        | {f"{kind}*.report.stress_anisotropy": Near(0.0, 1e-14) for kind in ("trimers", "chains")},
    )
_steps = ("steps", "force_evaluations", "stages.0.steps", "stages.0.force_evaluations")
AGREEMENT["jam/compress"] = Agreement(
    f"{_ONE_FACTOR}; compress asks for no pressure, and counts FIRE steps with strains",
    {**AGREEMENT["jam/compress"].arrays, "*.pressure_asked": None, **{f"discs, free.2.{one}": None for one in _steps}},
)
AGREEMENT["generate/clusters*"] = AGREEMENT["generate/chains"] = Agreement(
    "the packing fraction of fused particles is that of their union: the box has another size, and chains and clusters "
    "in it other places",
    {"*position_nd": None, "*box.lattice_dd": None},
)
_ONE_METRIC = "strains count as they are in Jacobian, bases and projections, no longer times V^(1/d)"
AGREEMENT["mechanics/change of basis"] = Agreement(_ONE_METRIC, {"*.change": None})
AGREEMENT["mechanics/constraints of links"] = Agreement(
    _ONE_METRIC, {"*projected with strain.*": None, "*basis with strain.null": None}
)
AGREEMENT["particle_shear/experiments"] = Agreement(
    "discs prepared in a box of another width have the density of the rest: such runs have other masses",
    {f"{law}.*": None for law in ("divergent", "plateau", "exponential")},
)
_MASSES_ROUNDED = (
    "masses come from the packing: pi r^2 times a density is rounded in another way than (2 r / d)^2, and chaos does "
    "the rest; starts that a task makes itself have density 1"
)
AGREEMENT["rheology/series of shears"] = Agreement(_MASSES_ROUNDED, {"later.*": None})
AGREEMENT["environments/Shear-v0, shipped scenes and starts"] = Agreement(
    _MASSES_ROUNDED, {"early, drawn.*": None, "early, triangular.*": None}
)
AGREEMENT["command/*"] = Agreement(
    "modes have the packing's masses, danglers are linked particles alone, and averages of unstable packings are no "
    "numbers",
    {
        **{f"numbers.{name}": None for name in ("danglers", "frequency_floor", "shear_modulus_*", "bulk_modulus_*")},
        "numbers.lowest_frequencies*": None,
    },
)
for _name in ("chain-of-thirty", "crossing-dimers", "fifty-trimers-2d", "fifty-trimers-3d", "flexible-chains-3d"):
    AGREEMENT[f"scenes/{_name}"] = Agreement(_ONE_FACTOR, {"scene.stress": _ROUNDING})

CASES: dict[str, Callable[[Any], dict[str, Any]]] = {}


def case(name: str, /, **settings: Any):
    """Register a function as a case of this name, called with these settings."""

    def registered(function):
        if name in CASES:
            raise ValueError(f"name must be that of no other case, got {name!r}")
        CASES[name] = functools.partial(function, **settings)
        return function

    return registered


# -- what cases are made of --------------------------------------------------------------------------------------------


@functools.cache
def discs(pm, particles=32, packing_fraction=0.9, seed=1):
    """Return random discs of two sizes."""
    return pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(), packing_fraction=packing_fraction, seed=seed
    )


@functools.cache
def spheres(pm, particles=32, packing_fraction=0.7, seed=1):
    """Return random spheres of one size."""
    return pm.random_packing(
        particles, dimension=3, sizes=pm.Monodisperse(), packing_fraction=packing_fraction, seed=seed
    )


def simple(pm, dimension=2, **settings):
    """Return random discs or spheres."""
    return discs(pm, **settings) if dimension == 2 else spheres(pm, **settings)


@functools.cache
def molecules(pm, kind, dimension=2, packing_fraction=None, count=8, seed=3):
    """Return dimers, rigid trimers or flexible chains, none deep in another."""
    fraction = {2: 0.35, 3: 0.2}[dimension] if packing_fraction is None else packing_fraction
    given = {"dimension": dimension, "packing_fraction": fraction, "seed": seed}
    if kind == "chains":
        return pm.chain_packing(max(2, count // 4), 8, **given)
    shape = {"dimers": pm.Dimer(), "trimers": pm.Trimer(angle=(1.1, 2.6))}[kind]
    return pm.cluster_packing(count, shape, largest_overlap=0.1, sizes=None, **given)


@functools.cache
def crowded(pm, kind, dimension, packing_fraction, count=8):
    """Return molecules at a high packing fraction, some deep in others."""
    given = {"dimension": dimension, "packing_fraction": packing_fraction, "seed": 4, "crossing": "allowed"}
    if kind == "chains":
        return pm.chain_packing(max(2, count // 4), 8, **given)
    return pm.cluster_packing(count, {"dimers": pm.Dimer(), "trimers": pm.Trimer()}[kind], **given)


def repulsive(pm, packing, law=None, *more):
    """Return the scene of a packing with a repulsion and further effects."""
    return pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic() if law is None else law), *more))


@functools.cache
def at_rest(pm, dimension=2, particles=32, packing_fraction=None, law="Harmonic"):
    """Return a packing at the minimum of its energy."""
    fraction = {2: 0.95, 3: 0.75}[dimension] if packing_fraction is None else packing_fraction
    packing = simple(pm, dimension, particles=particles, packing_fraction=fraction)
    scene = repulsive(pm, packing, getattr(pm, law)())
    return pm.quench(scene, force_tolerance=1e-11).packing


@functools.cache
def jammed(pm, dimension=2, particles=32, strain="free", pressure=1e-6):
    """Return a jammed packing."""
    packing = simple(pm, dimension, particles=particles, packing_fraction={2: 0.87, 3: 0.68}[dimension])
    return pm.jam(repulsive(pm, packing), pressure=pressure, strain=strain, method=pm.HardVertex()).packing


@functools.cache
def jammed_molecules(pm, kind, dimension=2, strain="free"):
    """Return jammed molecules."""
    scene = repulsive(pm, molecules(pm, kind, dimension))
    return pm.jam(scene, pressure=1e-6, strain=strain, method=pm.Decompression()).packing


def masses(packing):
    """Return masses of one density, 1 for a particle of the reference diameter."""
    return (2.0 * packing.radius_n / packing.reference_diameter) ** packing.dimension


def some_bonds(pm, packing, every=2):
    """Return bonds along some of the contacts."""
    spring = pm.LinearSpring()
    bonds = pm.bond_contacts(
        packing, compression=spring, tension=spring, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3
    )
    return bonds.select(np.arange(len(bonds)) % every == 0)


def damped(pm):
    """Return dashpots at contacts."""
    return pm.ContactDamping(coefficient=0.3)


def friction(pm):
    """Return friction with dashpots."""
    return pm.Friction(coefficient=0.5, stiffness=0.6, damping=0.2)


@functools.cache
def gel(pm, dimension=2, particles=24, bonds=True):
    """Return particles at rest under all effects: contacts with friction and dashpots, bonds, drag."""
    packing = at_rest(pm, dimension, particles=particles, law="LinearSpring")
    bonded = (some_bonds(pm, packing),) if bonds else ()
    return repulsive(pm, packing, pm.LinearSpring(), damped(pm), friction(pm), *bonded, pm.BackgroundDamping(rate=0.02))


def generic(packing, turns=True, scale=0.01):
    """Return velocities, and spins, of no symmetry."""
    rng = np.random.default_rng(7)
    shape = (packing.particles, packing.dimension)
    given = {"velocity_nd": scale * rng.standard_normal(shape)}
    if turns:
        given["spin_nk"] = scale * rng.standard_normal((shape[0], 1 if shape[1] == 2 else 3))
    return given


def raised(call, *kinds):
    """Return the exception that a call must raise."""
    try:
        call()
    except kinds as stop:
        return stop
    raise AssertionError(f"the call must raise one of {kinds}, it raised nothing")


def split(run, dt):
    """Return a record's fields against time in the groups "early" and "later", and all others in "later"."""
    time_t = run.time_t
    first = int(np.searchsorted(time_t, (EARLY + 0.5) * dt))
    early, later = {}, {}
    for field in dataclasses.fields(run):
        value = getattr(run, field.name)
        if field.name == "stress":
            early[field.name] = {key: part[:first] for key, part in value.items()}
            later[field.name] = {key: part[first:] for key, part in value.items()}
        elif isinstance(value, np.ndarray) and field.name.endswith(("_t", "_td", "_tk", "_tdd", "_tnd")):
            early[field.name], later[field.name] = value[:first], value[first:]
        else:
            later[field.name] = value
    return early, later


def strained(run, **average):
    """Return the groups of a strained run."""
    early, later = split(run, run.dt)
    means = {
        "stress": run.stress["overall"].mean(axis=0),
        "contacts": run.contacts_t.mean(),
        "potential": run.potential_t.mean(),
    }
    ends = {"outcome": run.outcome, "steps": run.steps, "dt": run.dt, "strain_t": run.strain_t, "rate_t": run.rate_t}
    return {"early": early, "later": later, "average": {**means, **average}, "set": ends}


def followed(pm, scene, steps=400, **settings):
    """Return the groups of a run through time at given masses."""
    settings = {"mass_n": masses(scene.packing), "dt": 0.05, **settings}
    early = pm.simulate(scene, steps=EARLY, trace_every=20, trace_positions=True, **settings)
    later = pm.simulate(scene, steps=steps, trace_every=20, **settings)
    trace = later.trace
    conserved = {
        "momentum_error": later.momentum_error,
        "link_error": later.link_error,
        "total_momentum": trace.momentum_td[-1] - trace.momentum_td[0],
    }
    # what is lost, and what is left: means over the second half
    half = len(trace.step_t) // 2
    average = {
        "energy": (trace.energy_t + trace.kinetic_t)[half:].mean(),
        "stress": trace.overall_stress_tdd[half:].mean(axis=0),
        "contacts": trace.contacts_t[half:].mean(),
    }
    ends = {"outcome": later.outcome, "steps": later.steps, "dt": later.dt, "strain": later.strain}
    return {"early": early, "later": later, "conserved": conserved, "average": average, "set": ends}


# -- starting packings -------------------------------------------------------------------------------------------------


@case("generate/random, sizes in 2D", dimension=2)
@case("generate/random, sizes in 3D", dimension=3)
def random_sizes(pm, dimension):
    sizes = {
        "monodisperse": pm.Monodisperse(scatter=0.02),
        "bidisperse": pm.Bidisperse(ratio=1.3, fraction=0.3),
        "mixture": pm.Mixture(ratios=(1.0, 1.5, 2.0), fractions=(0.5, 0.3, 0.2), scatter=0.01),
        "uniform": pm.Uniform(ratio=3.0),
        "normal": pm.Normal(spread=0.2),
        "log-normal": pm.LogNormal(spread=0.3),
    }
    found = {
        name: pm.random_packing(40, dimension=dimension, sizes=one, packing_fraction=0.6, seed=5)
        for name, one in sizes.items()
    }
    tilted = pm.Box(np.eye(dimension) + 0.3 * np.eye(dimension, k=1))
    found["in a box"] = pm.random_packing(
        20, dimension=dimension, sizes=sizes["uniform"], packing_fraction=0.5, seed=6, box=tilted
    )
    found["filled"] = pm.fill_box(tilted, 20, sizes=sizes["bidisperse"], packing_fraction=0.5, seed=6)
    found["scattered"] = pm.scattered_packing(
        molecules(pm, "trimers", dimension), packing_fraction=0.25, seed=2, largest_overlap=0.3
    )
    return found


@case("generate/crystals")
def crystals(pm):
    found = {}
    for name in pm.private("lattice_names"):
        found[name] = pm.lattice_packing(name, repeats=2)
        found[f"{name}, conventional"] = pm.lattice_packing(name, repeats=1, conventional=True, diameter=2.0)
    found["supercell"] = pm.lattice_packing("triangular", supercell=[[3, 1], [0, 4]], relative_overlap=0.02)
    found["reinforced"] = pm.reinforced_kagome_packing(2, repeats=(1, 2))
    found["tunneled"] = pm.tunneled_packing((0, 3, 1), repeats=2)
    crystal = pm.lattice_packing("triangular", repeats=(6, 6))
    found["vacancies"] = pm.vacancy_packing(crystal, 4, seed=3)
    found["vacancies apart"] = pm.vacancy_packing(crystal, 3, seed=3, apart=True)
    return found


@case("generate/clusters in 2D", dimension=2)
@case("generate/clusters in 3D", dimension=3)
def clusters(pm, dimension):
    shapes = {
        "dimer": pm.Dimer(length=0.8, radii=(0.5, 0.7)),
        "trimer": pm.Trimer(angle=(1.1, 2.6)),
        "row": pm.LinearCluster(4),
        "ring": pm.RingCluster(5, rigid=False),
        "star": pm.StarCluster(3, arm_beads=2) if dimension == 2 else pm.StarCluster(4),
    }
    corners = [[0, 0], [1.0, 0.1], [1.4, 1.0], [0.2, 1.2]] if dimension == 2 else np.eye(3)
    shapes["by hand"] = pm.Cluster(corners, [0.5] * len(corners))
    return {
        name: pm.cluster_packing(6, shape, dimension=dimension, packing_fraction=0.4, seed=1, crossing="allowed")
        for name, shape in shapes.items()
    } | {name: molecules(pm, name, dimension) for name in ("dimers", "trimers", "chains")}


@case("generate/chains")
def chains(pm):
    star = (0, 0, 0, 1, 2, 3, 4, 5, 6)
    return {
        f"{form}, {dimension}D, {angles}": pm.chain_packing(
            2, 10, dimension=dimension, packing_fraction=0.4, form=form, angles=angles, link_length=1.1, seed=3
        )
        for form in ("open", "ring", "wound", star)
        for dimension in (2, 3)
        for angles in ("free", "fixed")
    }


@case("generate/bonds, fragments, plates, material")
def fragments(pm):
    packing = at_rest(pm, particles=100, law="LinearSpring")
    bonds = pm.bond_contacts(packing, tension=pm.ExponentialTension(stiffness=1.0, fraction=0.3))
    return {
        "bonds": bonds,
        "at distance": pm.bond_contacts(packing, rest="distance", gap_tolerance=0.01),
        "by centers": pm.cut_fragments(bonds, packing, centers=5, edge_fuzziness=0.5, removed_fraction=0.1, seed=4),
        "by lines": pm.cut_fragments(bonds, packing, lines=6, cut_top_bottom=True, seed=4),
        "plates": pm.rough_plates(packing),
        "thin plates": pm.rough_plates(packing, layer=0.8, axis=0),
        "material": pm.material_constants(density=50.0),
        "material effects": pm.material_constants(friction_coefficient=0.2, tangential_ratio=0.5).effects(),
    }


# -- contacts and measures ---------------------------------------------------------------------------------------------


@case("contacts/discs and spheres")
def contacts(pm):
    found = {}
    for name, packing in {"discs": jammed(pm), "spheres": jammed(pm, 3), "loose": discs(pm, 60, 0.7)}.items():
        found[name] = {
            "contacts": pm.find_contacts(packing),
            "near": pm.find_contacts(packing, gap_tolerance=0.1),
            "rattlers": pm.find_rattlers(packing),
            "backbone": None if name == "loose" else pm.remove_rattlers(packing),
            "z": pm.coordination_number(packing),
            "z with rattlers": pm.coordination_number(packing, rattlers="keep"),
            "fraction": pm.packing_fraction(packing),
        }
    return found


@case("contacts/links")
def linked_contacts(pm):
    crossed = pm.chain_packing(6, 10, dimension=2, packing_fraction=0.9, crossing="allowed", seed=1)
    found = {"crossings": pm.crossing_links(crossed), "crossed": crossed}
    for name in ("dimers", "trimers", "chains"):
        for dimension in (2, 3):
            packing = jammed_molecules(pm, name, dimension)
            found[f"{name}, {dimension}D"] = {
                "contacts": pm.find_contacts(packing),
                "rattlers": pm.find_rattlers(packing),
                "clusters": pm.find_rattling_clusters(packing),
                "fraction": pm.packing_fraction(packing),
                "link error": packing.link_error,
                "wrapped": packing.wrapped(),
            }
    return found


@case("measure/every law")
def laws(pm):
    laws = {
        "harmonic": pm.Harmonic(energy_scale=2.0),
        "hertz": pm.Hertz(),
        "power law": pm.PowerLaw(exponent=2.3),
        "spring": pm.LinearSpring(stiffness=3.0),
        "divergent": pm.DivergentRepulsion(divergence=0.5),
        "plateau": pm.PlateauRepulsion(begin=0.05, end=0.3, law=pm.Hertz()),
        "lennard-jones": pm.RepulsiveLennardJones(),
    }
    found = {}
    for dimension in (2, 3):
        packing = at_rest(pm, dimension)
        for name, law in laws.items():
            scene = repulsive(pm, packing, law)
            found[f"{name}, {dimension}D"] = {
                "energy": pm.energy(scene),
                "forces": pm.forces(scene),
                "stress": pm.stress_tensor(scene),
                "pressure": pm.pressure(scene),
                "energy_scale": scene.energy_scale,
                "pressure_unit": scene.pressure_unit,
            }
    return found


class Cosine(NamedTuple):
    """A user's own law."""

    energy_scale: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy."""
        return self.energy_scale * (1.0 + np.cos(np.pi * distance / contact_distance))

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr."""
        return -self.energy_scale * np.pi / contact_distance * np.sin(np.pi * distance / contact_distance)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2."""
        return -self.energy_scale * (np.pi / contact_distance) ** 2 * np.cos(np.pi * distance / contact_distance)


@functools.cache
def cosine(pm):
    """Return the user's law, registered."""
    return pm.law(Cosine)


@case("measure/a law of one's own")
def own_law(pm):
    scene = repulsive(pm, discs(pm), cosine(pm)(energy_scale=0.5))
    run = pm.quench(scene, force_tolerance=1e-9, method=pm.Fire())
    scene = scene.replace(packing=run.packing)
    return {
        "run": run,
        "energy": pm.energy(scene),
        "moduli": pm.elastic_moduli(scene),
        "stress": pm.stress_tensor(scene),
    }


class Spring(NamedTuple):
    """A user's own pair effect: a spring between particles that touch."""

    stiffness: float = 1.0

    def pair_energy(self, distance, contact_distance):
        """Return the energy."""
        return 0.5 * self.stiffness * (distance - contact_distance) ** 2

    def pair_first(self, distance, contact_distance, rate):
        """Return the pull."""
        return self.stiffness * (distance - contact_distance)

    def pair_second(self, distance, contact_distance):
        """Return the stiffness."""
        return self.stiffness


class Wind(NamedTuple):
    """A user's own body effect: a drag towards a flow."""

    speed: float = 1.0

    def body_force(self, x, y, z, u, v, w, mass, radius):
        """Return the force."""
        return 0.1 * radius * (self.speed - u), -0.1 * radius * v, -0.1 * radius * w


@case("measure/effects of one's own")
def own_effects(pm):
    spring, wind = pm.effect(Spring)(2.0), pm.effect(Wind)(0.1)
    packing = at_rest(pm)
    plain = pm.Scene(packing, (pm.Repulsion(), spring))
    blown = pm.Scene(packing, (pm.Repulsion(), spring, friction(pm), wind))
    return {
        "energy": pm.energy(plain),
        "forces": pm.forces(plain),
        "stress": pm.stress_tensor(plain),
        "quench": pm.quench(plain, force_tolerance=1e-8, method=pm.Fire()),
        **followed(pm, plain, **generic(packing, turns=False)),
        **{f"{group}, blown": part for group, part in followed(pm, blown).items()},
    }


@case("measure/links")
def linked_measures(pm):
    found = {}
    for name in ("dimers", "trimers", "chains"):
        for dimension in (2, 3):
            scene = repulsive(pm, jammed_molecules(pm, name, dimension))
            found[f"{name}, {dimension}D"] = {
                "energy": pm.energy(scene),
                "forces": pm.forces(scene),
                "tension": pm.link_tension(scene),
                "pressure": pm.pressure(scene),
                **{parts: pm.stress_tensor(scene, parts=parts) for parts in ("total", "contacts", "links")},
            }
    return found


@case("measure/averages and demodulation")
def averages(pm):
    phase = np.linspace(-2.0, 8.0 * np.pi, 900)
    stress = 0.3 * np.sin(phase) + 0.1 * np.cos(phase) + 0.02 * np.sin(3.0 * phase) + 0.001 * phase
    stress += 0.01 * np.random.default_rng(1).standard_normal(len(phase))
    amplitude, storage = np.logspace(-4, 0, 9), 1.0 / (1.0 + np.logspace(-3, 1, 9))
    value = np.random.default_rng(2).standard_normal((7,))
    return {
        "demodulated": pm.demodulate(phase, stress, amplitude=0.01, periods=4),
        "all periods": pm.demodulate(phase, stress, amplitude=0.01, skip_periods=0.0),
        "softening": pm.softening_strain(amplitude, storage),
        "yield": pm.yield_strain(amplitude, storage, storage[::-1]),
        "mean": pm.mean_with_error(value),
        "bootstrap": pm.mean_with_error(value, error="bootstrap"),
    }


# -- files, scenes, tables, pictures -----------------------------------------------------------------------------------


@case("files/packings")
def packing_files(pm):
    found = {}
    packings = {"discs": jammed(pm), "spheres": jammed(pm, 3), "trimers": molecules(pm, "trimers", 3)}
    with tempfile.TemporaryDirectory() as folder:
        for name, packing in packings.items():
            for ending in ("npz", "gsd", "txt"):
                if packing.links and ending == "txt":
                    continue
                path = Path(folder) / f"{name}.{ending}"
                law = pm.Hertz(energy_scale=3.0) if ending == "npz" else None
                pm.write_packing(packing, path, law=law)
                found[f"{name}, {ending}"] = pm.read_packing(path)
                if law is not None:
                    found[f"{name}, law"] = pm.read_law(path)
                if ending == "txt":
                    found[f"{name}, lines"] = path.read_text().splitlines()
    return found


def wholly(pm, scene):
    """Return what a scene is, with its energy and forces where it knows them."""
    plain = pm.Scene(scene.packing, tuple(one for one in scene.effects if hasattr(one, "pair_energy")))
    return {
        "packing": scene.packing,
        "effects": scene.effects,
        "drive": scene.drive,
        "energy": pm.energy(plain),
        "forces": pm.forces(plain),
        "stress": pm.stress_tensor(plain),
        "contacts": pm.find_contacts(scene.packing),
    }


@case("files/scene of one's own")
def scene_file(pm):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        drive = pm.OscillatoryShearDrive(amplitude=0.01, frequency=0.05, periods=2.0, samples_per_period=40)
        scene = gel(pm).replace(drive=drive)
        pm.write_scene(scene, path)
        again = pm.read_scene(path)
    return {"scene": wholly(pm, again)}


def shipped_scene(pm, name):
    found = {"scene": wholly(pm, pm.read_scene(name))}
    if name not in DRAWN_BY_NOTHING:
        found["another seed"] = pm.read_scene(name, seed=2).packing
    return found


SCENES = (
    *("default", "assembly-at-rest", "assembly-sheared", "bulk", "cementing", "chain-of-thirty", "crossing-dimers"),
    *("crosslinked-sheared", "fifty-trimers-2d", "fifty-trimers-3d", "fixed-box", "flexible-chains-3d", "frictionless"),
    *("hertz", "kagome", "microgel", "plateau", "polydisperse", "quench", "repulsive-lennard-jones", "rough-plates"),
    *("single-sphere-moving", "single-sphere-spinning", "sphere-against-plate", "spheres", "triangular"),
    *("two-spheres-across", "two-spheres-central", "two-spheres-general", "two-spheres-tangential", "uncrosslinked"),
)
SPHERES = tuple(name for name in SCENES if name.startswith(("single-sphere", "two-spheres", "sphere-against")))
DRAWN_BY_NOTHING = ("kagome", "triangular", *SPHERES)
for _name in SCENES:
    case(f"scenes/{_name}", name=_name)(shipped_scene)


# scenes that ship since
NEW_SCENES = {"rough-discs"}


@case("files/drives")
def drives(pm):
    found = {"shipped": sorted(set(pm.list_scenes()) - NEW_SCENES)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        for name, drive in DRIVES.items():
            scene, told = drive(pm)
            pm.write_scene(scene.replace(drive=told), path)
            found[name] = pm.read_scene(path).drive
    return found


@case("files/tables of runs")
def tables(pm):
    subjects = {
        "simulation": pm.simulate(gel(pm), steps=40, dt=0.05, mass_n=masses(gel(pm).packing), trace_every=10),
        "ramp": pm.ramp_strain(
            gel(pm), rate=0.01, applied_strain=0.02, dt=0.05, samples=8, mass_n=masses(gel(pm).packing)
        ),
        "quench": pm.quench(
            repulsive(pm, discs(pm)), force_tolerance=1e-6, method=pm.Fire(), trace_every=10, trace_positions=True
        ),
    }
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, run in subjects.items():
            for ending in ("csv", "parquet"):
                path = Path(folder) / f"{name}.{ending}"
                pm.write_table(run, path)
                table = pm.read_table(path)
                found[f"{name}, {ending}"] = {"columns": table.columns, "units": table.units}
    return found


@case("view/draw_frame")
def frames(pm):
    scene = gel(pm)
    contacts = pm.find_contacts(scene.packing)
    return {
        "plain": pm.draw_frame(jammed(pm), size=(200, 200)),
        "all": pm.draw_frame(
            scene.packing,
            contacts=contacts,
            force_c=contacts.overlap_c,
            effects=scene.effects,
            rattler_n=pm.find_rattlers(scene.packing),
            size=(240, 200),
        ),
        "spheres": pm.draw_frame(jammed(pm, 3), size=(200, 200)),
        "links": pm.draw_frame(molecules(pm, "trimers"), size=(200, 200)),
    }


@case("validation/work_precision")
def work_precision(pm):
    ticks = iter(range(1_000_000))

    def trapezoidal(count):
        x = np.linspace(0.0, 1.0, int(count) + 1)
        return float(((x[1:] - x[:-1]) * 0.5 * (np.exp(x[1:]) + np.exp(x[:-1]))).sum())

    study = pm.work_precision(
        {"trapezoidal": trapezoidal, "no better": lambda count: 1.7}, [4, 8, 16], np.e - 1.0, clock=lambda: next(ticks)
    )
    return {
        "order": study.order("trapezoidal"),
        "errors": [trial.error for trial in study.trials],
        "settings": [trial.setting for trial in study.trials],
        "methods": study.methods,
    }


# -- mechanics ---------------------------------------------------------------------------------------------------------


@case("mechanics/rigidity and counts")
def rigidity(pm):
    found = {}
    packings = {
        "jammed discs": jammed(pm),
        "jammed spheres": jammed(pm, 3),
        "kagome": pm.lattice_packing("kagome", repeats=(2, 2)),
        "square": pm.lattice_packing("square", repeats=(3, 3)),
        "trimers": jammed_molecules(pm, "trimers"),
    }
    for name, packing in packings.items():
        one = {
            "rigidity": pm.rigidity_matrix(packing),
            "rigidity, still box": pm.rigidity_matrix(packing, strain="none"),
        }
        for strain in ("none", "free", "isochoric"):
            floppy, stress = pm.floppy_modes(packing, strain=strain), pm.states_of_self_stress(packing, strain=strain)
            one[strain] = {"floppy": floppy, "self stress": stress}
        found[name] = one
    return found


@case("mechanics/Hessians")
def hessians(pm):
    found = {}
    motion = np.random.default_rng(4)
    for dimension in (2, 3):
        packing = at_rest(pm, dimension)
        scene = repulsive(pm, packing)
        displacement, strain = motion.standard_normal(packing.position_nd.shape), np.diag(np.arange(1.0, dimension + 1))
        one = {"law": pm.hessian(repulsive(pm, packing, pm.Hertz()))}
        for kind in ("exact", "unstressed"):
            one[kind] = pm.hessian(scene, kind=kind)
            one[f"{kind}, still box"] = pm.hessian(scene, strain="none", kind=kind)
            one[f"{kind}, fixed volume"] = pm.hessian(scene, strain="isochoric", kind=kind)
            one[f"{kind}, dynamical"] = pm.dynamical_matrix(scene, kind=kind, mass_n=masses(packing))
            one[f"{kind}, dynamical with strain"] = pm.dynamical_matrix(
                scene, strain="free", kind=kind, strain_scale=2.0
            )
            one[f"{kind}, energy"] = pm.perturbation_energy(scene, displacement, strain_dd=strain, kind=kind)
        found[f"{dimension}D"] = one
    trimers = repulsive(pm, jammed_molecules(pm, "trimers"))
    for kind in ("exact", "unstressed", "paper"):
        found[f"trimers, {kind}"] = {
            "hessian": pm.hessian(trimers, kind=kind),
            "dynamical": pm.dynamical_matrix(trimers, kind=kind),
        }
    return found


@case("mechanics/modes and spectra")
def modes(pm):
    found = {}
    scenes = {
        "discs": repulsive(pm, at_rest(pm)),
        "spheres": repulsive(pm, at_rest(pm, 3)),
        "trimers": repulsive(pm, jammed_molecules(pm, "trimers")),
        "chains in space": repulsive(pm, jammed_molecules(pm, "chains", 3)),
    }
    for name, scene in scenes.items():
        one = {"few": pm.normal_modes(scene, count=8, mass_n=masses(scene.packing))}
        one["with strain"] = pm.normal_modes(scene, count=8, strain="free", strain_scale=1.5)
        one["unstressed"] = pm.normal_modes(scene, count=6, kind="unstressed")
        one["density"] = pm.density_of_states(scene, bins=12)
        found[name] = one
    return found


def averaged(moduli):
    """Return moduli with their averages."""
    found = {"moduli": moduli, "bulk": moduli.bulk_modulus, "shear": moduli.shear_modulus, "stable": moduli.stable}
    for bound in ("voigt", "reuss", "hill"):
        for tangent in ("energy", "cauchy"):
            found[f"{bound}, {tangent}"] = moduli.average(bound, tangent=tangent)
    return found


@case("mechanics/moduli")
def moduli(pm):
    found = {}
    scenes = {
        "discs": repulsive(pm, at_rest(pm)),
        "spheres": repulsive(pm, at_rest(pm, 3)),
        "hertz": repulsive(pm, at_rest(pm, law="Hertz"), pm.Hertz()),
        "jammed discs": repulsive(pm, jammed(pm)),
        "jammed spheres": repulsive(pm, jammed(pm, 3)),
    }
    for kind in ("dimers", "trimers", "chains"):
        for dimension in (2, 3):
            scenes[f"{kind}, {dimension}D"] = repulsive(pm, jammed_molecules(pm, kind, dimension))
    for name, scene in scenes.items():
        found[name] = {
            "exact": averaged(pm.elastic_moduli(scene)),
            "unstressed": averaged(pm.elastic_moduli(scene, kind="unstressed")),
            "compliance": pm.compliance_matrix(scene),
            "pseudoinverse": pm.compliance_matrix(scene, method="pseudoinverse"),
        }
    return found


@case("mechanics/complex modulus")
def complex_modulus(pm):
    frequency = [1e-3, 0.03, 0.5]
    found = {}
    for dimension in (2, 3):
        scene = gel(pm, dimension)
        for mode in ("shear", "uniaxial", "isotropic"):
            found[f"{mode}, {dimension}D"] = pm.complex_modulus(
                scene, frequency, mode=mode, mass_n=masses(scene.packing)
            )
    scene = gel(pm, particles=48)
    plates = pm.rough_plates(scene.packing)
    found["plates"] = pm.complex_modulus(scene, frequency, held_n=plates, mass_n=masses(scene.packing))
    return found


@case("mechanics/constraints of links")
def constraints(pm):
    found = {}
    rng = np.random.default_rng(8)
    for kind in ("dimers", "trimers", "chains"):
        for dimension in (2, 3):
            packing = jammed_molecules(pm, kind, dimension)
            force = rng.standard_normal(packing.position_nd.shape)
            pull = rng.standard_normal(dimension * (dimension + 1) // 2)
            moved = packing.replace(position_nd=packing.position_nd + 0.02 * force)
            one = {
                "jacobian": pm.constraint_jacobian(packing),
                "jacobian with strain": pm.constraint_jacobian(packing, strain="isochoric", strain_scale=2.0),
                "paper": pm.constraint_jacobian(packing, strain="free", form="paper"),
                "projected": pm.project_force(packing, force),
                "projected with strain": pm.project_force(packing, force, strain_force=pull, strain="isochoric"),
                "projected, dense": pm.project_force(packing, force, method="whole-matrix"),
                "re-affixed": pm.reaffix_links(moved),
                "independent": pm.independent_links(packing),
            }
            for method in ("householder", "gram-schmidt", "gram-schmidt-twice", "whole-matrix"):
                basis = pm.constraint_basis(packing, method=method)
                one[method] = {"rank": basis.rank, "links": basis.link_basis, "null": basis.null_basis}
            basis = pm.constraint_basis(packing, strain="isochoric")
            one["basis with strain"] = {"rank": basis.rank, "links": basis.link_basis, "null": basis.null_basis}
            found[f"{kind}, {dimension}D"] = one
    return found


@case("mechanics/change of basis")
def change_of_basis(pm):
    found = {}
    for name, packing in {"discs": jammed(pm), "trimers": jammed_molecules(pm, "trimers")}.items():
        for strain in ("none", "free", "isochoric"):
            found[f"{name}, {strain}"] = {
                "change": pm.change_of_basis(packing, strain=strain, strain_scale=2.0),
                "n matrix": pm.n_matrix(packing, strain=strain, strain_scale=2.0),
                "rigidity": pm.constrained_rigidity_matrix(packing, strain=strain, strain_scale=2.0),
            }
    return found


@case("mechanics/redundant links")
def redundant_links(pm):
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    pairs = np.array([(i, j) for i in range(4) for j in range(i + 1, 4)])
    length = np.linalg.norm(square[pairs[:, 0]] - square[pairs[:, 1]], axis=1)
    links = pm.Links(pairs[:, 0], pairs[:, 1], np.zeros((6, 2)), length)
    packing = pm.Packing(square + 0.7, np.full(4, 0.5), pm.Box.cubic(3.0, 2), links)
    return {
        "independent": pm.independent_links(packing),
        "with strain": pm.independent_links(packing, strain="free"),
        "basis": pm.constraint_basis(packing).rank,
        "tension": pm.link_tension(repulsive(pm, packing)),
    }


# -- verdicts ----------------------------------------------------------------------------------------------------------


def judged(verdict):
    """Return a verdict with what follows from it."""
    return {
        "verdict": verdict,
        "local": verdict.local,
        "collective": verdict.collective,
        "strict": verdict.strict,
        "force": verdict.contact_force_c,
        "motion": verdict.unjamming_motion,
        "states": verdict.states_of_self_stress,
    }


@case("jamming/verdicts on crystals, certificate", method="certificate")
@case("jamming/verdicts on crystals, loads", method="loads")
def crystals_judged(pm, method):
    crystals = {
        "triangular": (4, 4),
        "square": (3, 3),
        "kagome": (2, 2),
        "honeycomb": (3, 3),
        "snub square": (2, 2),
        "reinforced kagome": (1, 1),
        "sc": (2, 2, 2),
        "fcc": (2, 2, 2),
        "hcp": (2, 2, 2),
        "diamond": (2, 2, 2),
        "tunneled fcc": (2, 2, 2),
    }
    return {
        name: judged(pm.classify_jamming(pm.lattice_packing(name, repeats=repeats), method=method))
        for name, repeats in crystals.items()
    }


@case("jamming/verdicts on random packings, certificate", method="certificate")
@case("jamming/verdicts on random packings, loads", method="loads")
def random_judged(pm, method):
    packings = {
        "discs, free": jammed(pm, pressure=1e-8),
        "discs, still box": jammed(pm, strain="isotropic", pressure=1e-8),
        "spheres, free": jammed(pm, 3, pressure=1e-8),
        "spheres, still box": jammed(pm, 3, strain="isotropic", pressure=1e-8),
        "pressed": jammed(pm, pressure=1e-2),
        "loose": discs(pm, 32, 0.6),
    }
    found = {name: judged(pm.classify_jamming(one, method=method)) for name, one in packings.items()}
    scene = repulsive(pm, packings["discs, free"])
    found["scene"] = judged(pm.classify_jamming(scene, method=method, strain="isochoric", gap_tolerance=1e-6))
    return found


@case("jamming/verdicts with links")
def linked_judged(pm):
    found = {}
    for kind in ("dimers", "trimers", "chains"):
        for dimension in (2, 3):
            packing = jammed_molecules(pm, kind, dimension)
            found[f"{kind}, {dimension}D"] = judged(pm.classify_jamming(packing))
    found["loads"] = judged(pm.classify_jamming(jammed_molecules(pm, "trimers"), method="loads"))
    found["still box"] = judged(pm.classify_jamming(jammed_molecules(pm, "trimers", strain="isotropic")))
    return found


@case("jamming/verdict by cvxpy")
def readable_verdicts(pm):
    found = {}
    for method in ("certificate", "loads"):
        for name, packing in {"kagome": pm.lattice_packing("kagome", repeats=(2, 2)), "discs": jammed(pm)}.items():
            verdict = pm.classify_jamming(packing, method=method, solver="cvxpy")
            found[f"{name}, {method}"] = {"collective": verdict.collective, "strict": verdict.strict}
    return found


@case("jamming/motions played")
def played(pm):
    found = {}
    for name, repeats in {"kagome": (2, 2), "square": (3, 3), "diamond": (2, 2, 2)}.items():
        packing = pm.lattice_packing(name, repeats=repeats)
        verdict = pm.classify_jamming(packing)
        for question in ("collectively", "strictly"):
            motion = getattr(verdict, question).unjamming_motion
            found[f"{name}, {question}"] = pm.play_motion(packing, motion, amplitude=0.3, steps=12)
    scene = repulsive(pm, jammed(pm, strain="isotropic", pressure=1e-8))
    mode = pm.normal_modes(scene, count=3).displacement_mnd[0]
    motion = np.zeros_like(scene.packing.position_nd)
    motion[: len(mode)] = mode
    found["blocked"] = pm.play_motion(scene, motion, amplitude=0.2, steps=8)
    trimers = molecules(pm, "trimers")
    found["links"] = pm.play_motion(
        trimers, np.ones_like(trimers.position_nd) * [[1.0, 0.0]] * (np.arange(len(trimers.radius_n)) < 6)[:, None],
        amplitude=0.1, steps=5,
    )  # fmt: skip
    return found


# -- minimizers --------------------------------------------------------------------------------------------------------

MINIMIZERS = {
    "FIRE": lambda pm: pm.Fire(),
    "FIRE 2": lambda pm: pm.Fire2(),
    "conjugate gradients": lambda pm: pm.ConjugateGradient(),
    "L-BFGS": lambda pm: pm.LBFGS(),
    "damped dynamics": lambda pm: pm.DampedDynamics(),
    "gradient descent": lambda pm: pm.GradientDescent(step=0.3),
    "Newton": lambda pm: pm.Newton(),
}


def started(pm, scene, name):
    """Return the scene near a minimum where the method needs that."""
    if name != "Newton":
        return scene
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-4, method=pm.Fire()).packing)


def quenched(pm, name):
    method = MINIMIZERS[name](pm)
    tolerance = 1e-5 if name == "gradient descent" else 1e-8
    found = {}
    for dimension in (2, 3):
        scene = started(pm, repulsive(pm, simple(pm, dimension)), name)
        trace = {} if name == "Newton" else {"trace_every": 10, "trace_positions": True}
        found[f"{dimension}D"] = pm.quench(scene, force_tolerance=tolerance, method=method, **trace)
    scene = started(pm, repulsive(pm, discs(pm, 32, 0.95), pm.Hertz()), name)
    found["few steps"] = pm.quench(scene, force_tolerance=1e-12, method=method, step_limit=20, check=False)
    return found


def quenched_molecules(pm, name):
    method = MINIMIZERS[name](pm)
    tolerance = 1e-5 if name == "gradient descent" else 1e-7
    found = {}
    dense = {("dimers", 2): 0.95, ("trimers", 2): 0.95, ("trimers", 3): 0.75, ("chains", 2): 0.95}
    for (kind, dimension), fraction in dense.items():
        scene = started(pm, repulsive(pm, crowded(pm, kind, dimension, fraction)), name)
        found[f"{kind}, {dimension}D"] = pm.quench(scene, force_tolerance=tolerance, method=method, check=False)
    return found


for _name in MINIMIZERS:
    case(f"quench/{_name}", name=_name)(quenched)
    case(f"quench/{_name} with links", name=_name)(quenched_molecules)


@case("quench/default route")
def default_route(pm):
    found = {}
    for name, packing in {
        "discs": discs(pm),
        "spheres": spheres(pm),
        "broad": pm.random_packing(40, dimension=2, sizes=pm.Uniform(ratio=25.0), packing_fraction=0.9, seed=2),
        "unjammed": discs(pm, 32, 0.6),
        "chains": crowded(pm, "chains", 3, 0.75),
    }.items():
        found[name] = pm.quench(repulsive(pm, packing), force_tolerance=1e-11)
    found["lennard-jones"] = pm.quench(
        repulsive(pm, discs(pm), pm.RepulsiveLennardJones()), force_tolerance=1e-9, trace_every=20
    )
    crystal = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    found["saddle"] = pm.quench(repulsive(pm, crystal), force_tolerance=1e-9)
    found["effects without energy"] = pm.quench(
        repulsive(pm, discs(pm), None, damped(pm), pm.BackgroundDamping()), force_tolerance=1e-9
    )
    return found


@case("quench/not converged")
def not_converged(pm):
    scene = repulsive(pm, discs(pm))
    kind = pm.raw("NotConverged")
    found = {"few steps": raised(lambda: pm.quench(scene, force_tolerance=1e-12, step_limit=7), kind).run}
    loose = repulsive(pm, discs(pm, 32, 0.6))
    found["loose"] = raised(lambda: pm.jam(loose, pressure=1e-6, method=pm.HardVertex(iteration_limit=2)), kind).run
    found["out of time"] = raised(
        lambda: pm.simulate(scene, steps=10**7, dt=0.01, mass_n=masses(scene.packing), time_limit=1e-9), kind
    ).run.outcome
    return found


@case("quench/bonds are refused")
def quenched_bonds(pm):
    stop = raised(lambda: pm.quench(gel(pm), force_tolerance=1e-9, method=pm.Fire()), ValueError)
    return {"kind": type(stop).__name__}


@case("quench/batch")
def quench_batch(pm):
    found = {}
    rng = np.random.default_rng(0)
    change, shear = rng.uniform(-0.02, 0.02, (6, 3)), rng.uniform(-0.05, 0.05, (6, 3))
    scenes = {
        "discs": repulsive(pm, discs(pm, 24)),
        "spheres": repulsive(pm, spheres(pm, 24)),
        "trimers": repulsive(pm, molecules(pm, "trimers", packing_fraction=0.4)),
    }
    for name, scene in scenes.items():
        for relax in ("full", 15):
            for threads in (1, 2):
                batch = pm.QuenchBatch(scene, batch=3, relax=relax, threads=threads)
                rows = []
                for k in range(6):
                    batch.step(change[k] + 0.02, shear[k])
                    rows.append(batched(batch))
                batch.restart(1, scene.packing)
                batch.step(change[0], shear[0])
                rows.append(batched(batch))
                found[f"{name}, {relax}, {threads} threads"] = {
                    "rows": rows,
                    "packings": [batch.packing(b) for b in range(3)],
                    "outcomes": [batch.outcome(b) for b in range(3)],
                }
    for minimizer in (pm.Fire2(), pm.DampedDynamics()):
        batch = pm.QuenchBatch(scenes["discs"], batch=1, method=minimizer, force_tolerance=1e-6)
        batch.step([0.0], [0.0])
        found[type(minimizer).__qualname__] = batched(batch)
    return found


def batched(batch):
    """Return the figures of a batch."""
    return {
        "packing_fraction": batch.packing_fraction_b,
        "energy": batch.energy_b,
        "pressure": batch.pressure_b,
        "stress": batch.stress_bdd,
        "max_force": batch.max_force_b,
        "mean_force": batch.mean_force_b,
        "contacts": batch.contacts_b,
        "rattlers": batch.rattlers_b,
        "excess": batch.excess_contacts_b,
        "strain": batch.strain_b,
        "steps": batch.steps_b,
        "evaluations": batch.force_evaluations_b,
        "relaxed": batch.relaxed_b,
    }


# -- jamming protocols -------------------------------------------------------------------------------------------------


@case("jam/hard vertex, 2D", dimension=2)
@case("jam/hard vertex, 3D", dimension=3)
def hard_vertex(pm, dimension):
    packing = simple(pm, dimension, particles=48, packing_fraction={2: 0.85, 3: 0.66}[dimension])
    return {
        f"{strain}, {pressure:g}": pm.jam(
            repulsive(pm, packing), pressure=pressure, strain=strain, method=pm.HardVertex()
        )
        for strain in ("free", "isotropic")
        for pressure in (1e-8, 1e-3)
    }


@case("jam/other laws")
def jam_laws(pm):
    return {
        "hertz": pm.jam(repulsive(pm, discs(pm, 32, 0.85), pm.Hertz()), pressure=1e-5, method=pm.HardVertex()),
        "spring": pm.jam(repulsive(pm, spheres(pm, 32, 0.66), pm.LinearSpring()), pressure=1e-6, strain="isotropic"),
        "own": pm.jam(repulsive(pm, discs(pm, 32, 0.85), cosine(pm)()), pressure=1e-5, method=pm.HardVertex()),
        "lennard-jones": pm.jam(
            repulsive(pm, discs(pm, 32, 0.85), pm.RepulsiveLennardJones()), pressure=1e-4, strain="isotropic"
        ),
    }


@case("jam/chain of programs")
def program_chain(pm):
    scene = repulsive(pm, discs(pm, 32, 0.8, seed=4))
    return {
        f"{strain}, {solver}": pm.jam(scene, pressure=1e-8, strain=strain, method=pm.ProgramChain(solver=solver))
        for strain, solver in (("isotropic", "clarabel"), ("isotropic", "highs"), ("free", "clarabel"))
    } | {
        "spheres": pm.jam(
            repulsive(pm, spheres(pm, 24, 0.6)), pressure=1e-8, strain="isotropic", method=pm.ProgramChain()
        )
    }


@case("jam/step halving")
def step_halving(pm):
    scene = repulsive(pm, discs(pm, 32, 0.8, seed=3))
    return {
        "isotropic": pm.jam(scene, strain="isotropic", method=pm.StepHalving(energy_tolerance=1e-14)),
        "free": pm.jam(scene, strain="free", method=pm.StepHalving(energy_tolerance=1e-14)),
        "by energy": pm.jam(scene, strain="isotropic", energy_tolerance=1e-12),
        "other minimizer": pm.jam(
            repulsive(pm, discs(pm, 16, 0.8, seed=3)),
            strain="isotropic",
            method=pm.StepHalving(energy_tolerance=1e-12, minimizer=pm.LBFGS()),
        ),
        "trimers": pm.jam(
            repulsive(pm, molecules(pm, "trimers")),
            strain="isotropic",
            method=pm.StepHalving(increment=1e-2, start_packing_fraction=0.5),
        ),
    }


@case("jam/decompression")
def decompression(pm):
    return {
        "isotropic": pm.jam(
            repulsive(pm, discs(pm, 48, 0.8, seed=2)),
            pressure=1e-8,
            strain="isotropic",
            method=pm.Decompression(stop_pressure=1e-5),
        ),
        "free": pm.jam(
            repulsive(pm, discs(pm, 32, 0.8, seed=2)), pressure=1e-8, strain="free", method=pm.Decompression()
        ),
        "spheres": pm.jam(
            repulsive(pm, spheres(pm, 32, 0.6)), pressure=1e-6, strain="isotropic", method=pm.Decompression()
        ),
    }


@case("jam/dimers", kind="dimers")
@case("jam/trimers", kind="trimers")
@case("jam/chains", kind="chains")
def jam_molecules(pm, kind):
    found = {}
    for dimension in (2, 3):
        scene = repulsive(pm, molecules(pm, kind, dimension))
        for strain in ("free", "isotropic"):
            found[f"{strain}, {dimension}D"] = pm.jam(
                scene, pressure=1e-6, strain=strain, method=pm.Decompression(), check=False
            )
    return found


@case("jam/chains around the box")
def jam_wound(pm):
    packing = pm.chain_packing(2, 12, dimension=2, packing_fraction=0.4, form="wound", seed=1)
    scene = repulsive(pm, packing)
    return {"jammed": pm.jam(scene, pressure=1e-6, strain="isotropic", method=pm.Decompression())}


@case("jam/compress")
def compress(pm):
    found = {}
    for strain in ("isotropic", "free"):
        scene = repulsive(pm, jammed(pm, strain=strain, pressure=1e-8))
        found[f"discs, {strain}"] = pm.compress(scene, [1e-6, 1e-3, 5e-2], strain=strain)
    found["spheres"] = pm.compress(repulsive(pm, jammed(pm, 3, strain="isotropic", pressure=1e-8)), [1e-5, 1e-2])
    for kind, strain in (("trimers", "free"), ("chains", "isotropic")):
        scene = repulsive(pm, jammed_molecules(pm, kind, strain=strain))
        found[f"{kind}, {strain}"] = pm.compress(scene, [1e-6, 1e-3], strain=strain)
    return found


@case("jam/shear_stabilize")
def shear_stabilize(pm):
    dense = crowded(pm, "trimers", 2, 0.9)
    return {
        "volume": pm.shear_stabilize(repulsive(pm, at_rest(pm))),
        "pressure": pm.shear_stabilize(repulsive(pm, at_rest(pm)), pressure=1e-3),
        "spheres": pm.shear_stabilize(repulsive(pm, at_rest(pm, 3))),
        "trimers": pm.shear_stabilize(repulsive(pm, dense), force_tolerance=1e-9),
        "trimers, pressure": pm.shear_stabilize(repulsive(pm, dense), pressure=1e-4, force_tolerance=1e-9),
    }


@case("cement/freezing angles", freeze="angles")
@case("cement/freezing clusters", freeze="clusters")
@case("cement/freezing nothing", freeze="nothing")
def cement(pm, freeze):
    found = {}
    for dimension in (2, 3):
        scene = repulsive(pm, jammed(pm, dimension, pressure=1e-7))
        for kind in ("unstressed", "exact"):
            cementing = pm.cement(scene, seed=2, freeze=freeze, kind=kind, step=0.1)
            found[f"{kind}, {dimension}D"] = {
                "cementing": cementing,
                "voigt": [cementing.voigt(k) for k in range(len(cementing.cemented_k))],
                "reuss": [cementing.reuss(k) for k in range(len(cementing.cemented_k))],
                "half way": cementing.packing_at(len(cementing.cemented_k) // 2),
            }
    return found


# -- motion ------------------------------------------------------------------------------------------------------------

METHODS = {"Verlet": lambda pm: pm.VelocityVerlet(), "Euler": lambda pm: pm.SemiImplicitEuler()}


@case("simulate/frictionless, 2D", dimension=2, method="Verlet")
@case("simulate/frictionless, 3D", dimension=3, method="Verlet")
@case("simulate/frictionless, Euler", dimension=2, method="Euler")
def simulate_plain(pm, dimension, method):
    scene = repulsive(pm, at_rest(pm, dimension, particles=40))
    return followed(pm, scene, method=METHODS[method](pm), temperature=1e-4, seed=1)


@case("simulate/frictionless with dashpots, 2D", dimension=2)
@case("simulate/frictionless with dashpots, 3D", dimension=3)
def simulate_damped(pm, dimension):
    scene = repulsive(pm, at_rest(pm, dimension, particles=40), None, damped(pm))
    return followed(pm, scene, **generic(scene.packing, turns=False, scale=0.05))


@case("simulate/dashpots that set in smoothly")
def simulate_onset(pm):
    effects = pm.ContactDamping(coefficient=0.3, onset="smooth")
    scene = repulsive(pm, at_rest(pm), None, effects)
    return followed(pm, scene, **generic(scene.packing, turns=False, scale=0.05))


@case("simulate/dimers", kind="dimers", dimension=2)
@case("simulate/dimers, 3D", kind="dimers", dimension=3)
@case("simulate/trimers", kind="trimers", dimension=2)
@case("simulate/trimers, 3D", kind="trimers", dimension=3)
@case("simulate/chains", kind="chains", dimension=2)
@case("simulate/chains, 3D", kind="chains", dimension=3)
def simulate_links(pm, kind, dimension):
    packing = molecules(pm, kind, dimension, packing_fraction={2: 0.45, 3: 0.25}[dimension])
    found = followed(pm, repulsive(pm, packing), temperature=0.05, seed=2)
    dashpots = followed(pm, repulsive(pm, packing, None, damped(pm)), temperature=0.05, seed=2)
    return found | {f"{group} with dashpots": part for group, part in dashpots.items()}


@case("simulate/links, Euler")
def simulate_links_euler(pm):
    packing = molecules(pm, "trimers", packing_fraction=0.45)
    return followed(pm, repulsive(pm, packing), temperature=0.05, seed=2, method=pm.SemiImplicitEuler())


@case("simulate/friction, 2D", dimension=2, method="Verlet")
@case("simulate/friction, 3D", dimension=3, method="Verlet")
@case("simulate/friction, Euler", dimension=2, method="Euler")
def simulate_friction(pm, dimension, method):
    scene = gel(pm, dimension, particles=40, bonds=False)
    return followed(pm, scene, method=METHODS[method](pm), **generic(scene.packing, scale=0.05))


@case("simulate/friction alone")
def simulate_friction_alone(pm):
    scene = repulsive(pm, at_rest(pm, law="LinearSpring"), pm.LinearSpring(), friction(pm))
    return followed(pm, scene, **generic(scene.packing, scale=0.05))


@case("simulate/bonds, 2D", dimension=2)
@case("simulate/bonds, 3D", dimension=3)
def simulate_bonds(pm, dimension):
    scene = gel(pm, dimension, particles=40)
    return followed(pm, scene, **generic(scene.packing, scale=0.05))


@case("simulate/bonds without friction")
def simulate_bonds_alone(pm):
    packing = at_rest(pm, law="LinearSpring")
    bonds = pm.bond_contacts(
        packing, compression=pm.Hertz(), tension=pm.ExponentialTension(), tangential_stiffness=0.4, rest="distance"
    )
    return followed(pm, repulsive(pm, packing, pm.LinearSpring(), bonds), **generic(packing, scale=0.05))


@case("simulate/gravity and walls, 2D", dimension=2)
@case("simulate/gravity and walls, 3D", dimension=3)
def simulate_walls(pm, dimension):
    packing = simple(pm, dimension, particles=40, packing_fraction={2: 0.5, 3: 0.3}[dimension])
    height = float(packing.box.lattice_dd[1, 1])
    walls = pm.Walls(axis=1, low=0.0, high=height, law=pm.LinearSpring(stiffness=5.0), damping=0.5)
    gravity = pm.Gravity(x=0.01, y=-0.05)
    scene = repulsive(pm, packing, pm.LinearSpring(stiffness=5.0), damped(pm), gravity, walls)
    return followed(pm, scene, dt=0.02)


@case("simulate/gravity and Hertzian walls")
def simulate_hertzian_walls(pm):
    packing = discs(pm, 40, 0.5)
    height = float(packing.box.lattice_dd[1, 1])
    walls = pm.Walls(axis=1, low=0.0, high=height, law=pm.Hertz(energy_scale=3.0))
    scene = repulsive(pm, packing, pm.LinearSpring(stiffness=5.0), damped(pm), pm.Gravity(y=-0.05), walls)
    return followed(pm, scene, dt=0.02)


@case("simulate/background damping")
def simulate_background(pm):
    scene = repulsive(pm, at_rest(pm), None, pm.BackgroundDamping(rate=0.2))
    return followed(pm, scene, **generic(scene.packing, turns=False, scale=0.1))


@case("simulate/plateau and divergent laws")
def simulate_laws(pm):
    found = {}
    laws = {"plateau": pm.PlateauRepulsion(law=pm.DivergentRepulsion()), "own": cosine(pm)()}
    for name, law in laws.items():
        scene = repulsive(pm, at_rest(pm), law, damped(pm), friction(pm))
        found |= {f"{group}, {name}": part for group, part in followed(pm, scene, **generic(scene.packing)).items()}
    return found


STRAINS = {
    "steady": lambda pm: pm.SteadyStrain(0.05),
    "oscillatory": lambda pm: pm.OscillatoryStrain(0.05, 0.1, start=0.5, periods=1.5),
    "uniaxial": lambda pm: pm.SteadyStrain(-0.01, mode="uniaxial"),
    "isotropic": lambda pm: pm.OscillatoryStrain(0.02, 0.1, mode="isotropic"),
}


def simulate_strain(pm, name):
    found = {}
    scenes = {"plain": repulsive(pm, at_rest(pm), None, damped(pm)), "all": gel(pm)}
    if name == "steady":
        scenes["spheres"] = gel(pm, 3, bonds=False)
    for key, scene in scenes.items():
        parts = followed(pm, scene, applied_strain=STRAINS[name](pm))
        found |= {f"{group}, {key}": part for group, part in parts.items()}
    return found


for _name in STRAINS:
    case(f"simulate/{_name} strain", name=_name)(simulate_strain)


@case("simulate/far shear, other lattice vectors")
def simulate_far(pm):
    return followed(pm, gel(pm, bonds=False), steps=600, applied_strain=pm.SteadyStrain(0.7), dt=0.02)


@case("simulate/held particles")
def simulate_held(pm):
    scene = gel(pm, particles=40)
    return followed(pm, scene, held_n=pm.rough_plates(scene.packing), applied_strain=pm.SteadyStrain(0.02))


@case("simulate/default time step and duration")
def simulate_defaults(pm):
    scene = gel(pm)
    return {
        "early": pm.simulate(scene, duration=1.0, trace_every=5, mass_n=masses(scene.packing)),
        "early, frictionless": pm.simulate(
            repulsive(pm, at_rest(pm)), duration=2.0, temperature=1e-3, seed=3, mass_n=masses(at_rest(pm))
        ),
    }


@case("simulate/step too long")
def simulate_blows_up(pm):
    packing = discs(pm, 32, 0.9)
    scene = repulsive(pm, packing, pm.LinearSpring(), damped(pm), friction(pm))
    run = pm.simulate(scene, steps=200, dt=5.0, mass_n=masses(packing), check=False)
    return {"outcome": run.outcome}


def threaded_scene(pm, name):
    """Return a scene of several blocks of rows."""
    if name == "friction, 3D":
        packing = at_rest(pm, 3, particles=300, law="LinearSpring")
        return repulsive(pm, packing, pm.LinearSpring(), damped(pm), friction(pm), pm.BackgroundDamping(rate=0.02))
    packing = at_rest(pm, particles=600, law="LinearSpring")
    bonds = (some_bonds(pm, packing),) if name == "bonds" else ()
    return repulsive(pm, packing, pm.LinearSpring(), damped(pm), friction(pm), *bonds, pm.BackgroundDamping(rate=0.02))


@case("threads/friction, 1 thread", name="friction", threads=1)
@case("threads/friction, 2 threads", name="friction", threads=2)
@case("threads/friction in 3D, 2 threads", name="friction, 3D", threads=2)
@case("threads/bonds, 1 thread", name="bonds", threads=1)
@case("threads/bonds, 2 threads", name="bonds", threads=2)
def simulate_threads(pm, name, threads):
    scene = threaded_scene(pm, name)
    return followed(
        pm,
        scene,
        steps=200,
        threads=threads,
        applied_strain=pm.SteadyStrain(0.02),
        **generic(scene.packing, scale=0.05),
    )


# -- checkpoints -------------------------------------------------------------------------------------------------------


def looked(run):
    """Return a run less what depends on when somebody looked."""
    skipped = ("energy_drift", "momentum_error", "link_error", "force_evaluations", "stages")
    return {field.name: getattr(run, field.name) for field in dataclasses.fields(run) if field.name not in skipped}


CHECKPOINTS = {
    "all effects, sheared": lambda pm: (gel(pm), {"applied_strain": pm.SteadyStrain(0.7), "trace_every": 7}),
    "spheres, held, oscillating": lambda pm: (
        gel(pm, 3, bonds=False),
        {
            "applied_strain": pm.OscillatoryStrain(0.1, 1.0),
            "held_n": np.arange(24) < 4,
            "method": pm.SemiImplicitEuler(),
            "trace_every": 10,
            "trace_positions": True,
        },
    ),
    "frictionless": lambda pm: (repulsive(pm, at_rest(pm)), {"temperature": 1e-3, "seed": 2, "trace_every": 15}),
    "dimers": lambda pm: (repulsive(pm, molecules(pm, "dimers")), {"temperature": 0.5, "seed": 2, "trace_every": 15}),
    "trimers in space": lambda pm: (repulsive(pm, molecules(pm, "trimers", 3)), {"temperature": 0.5, "seed": 2}),
}


def simulate_checkpoint(pm, name):
    scene, given = CHECKPOINTS[name](pm)
    given = {"dt": 0.02, "mass_n": masses(scene.packing), **given}
    found = {"early": looked(pm.simulate(scene, steps=EARLY, **given))}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.npz"
        for step in (1, 33, 99):
            pm.simulate(scene, steps=step, checkpoint=path, **given)
            found[f"early, cut at {step}"] = looked(pm.resume(path, scene, steps=EARLY))
        pm.simulate(scene, steps=60, checkpoint=path, checkpoint_every=11, **given)
        threads = 2 if "applied_strain" in given else 1
        found["early, written often"] = looked(pm.resume(path, scene, steps=EARLY, threads=threads))
    return found


for _name in CHECKPOINTS:
    case(f"checkpoint/simulate, {_name}", name=_name)(simulate_checkpoint)

_LONG = {"frequency": 5e-4, "samples_per_period": 20, "dt": 0.1}
CUT = {
    "oscillatory": ("oscillatory_shear", {"amplitude": 0.2, "pre_periods": 0.2, "periods": 2.0, **_LONG}),
    "ramp": ("ramp_strain", {"rate": 1e-4, "applied_strain": 0.3, "samples": 25, "dt": 0.1}),
    "creep": ("creep", {"stress": 0.02, "duration": 2000.0, "hold": 1500.0, "dt": 0.1}),
}


def strained_checkpoint(pm, name):
    call, given = getattr(pm, CUT[name][0]), CUT[name][1]
    scene = gel(pm)
    given = {**given, "mass_n": masses(scene.packing), "frames": 4}
    whole = call(scene, **given)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.npz"
        cut = call(scene, checkpoint=path, time_limit=1e-9, check=False, **given)
        if not 0 < cut.steps < whole.steps:
            raise AssertionError(f"the run must be cut on its way, it took {cut.steps} of {whole.steps} steps")
        resumed = call(scene, checkpoint=path, **given)
        again = call(scene, checkpoint=path, **given)
    found = {}
    for key, run in {"whole": whole, "resumed": resumed, "again": again}.items():
        found |= {f"{group}, {key}": part for group, part in strained(run).items()}
    same = all(np.array_equal(run.packing.position_nd, whole.packing.position_nd) for run in (resumed, again))
    return found | {"same": same}


for _name in CUT:
    case(f"checkpoint/{_name}", name=_name)(strained_checkpoint)


class StopAt:
    """Progress that interrupts when it is called for the n-th time."""

    def __init__(self, turn):
        self.left = turn

    def __call__(self, *told):
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


@case("checkpoint/several runs, interrupted")
def several_checkpoint(pm):
    scene = gel(pm)
    weight = {"mass_n": masses(scene.packing)}
    short = {"frequency": 0.05, "samples_per_period": 20, "dt": 0.05}
    calls = {
        "sweep": (pm.amplitude_sweep, {"amplitudes": [0.01, 0.2], "periods": 2.0, **short, **weight}, 2),
        "steady": (
            pm.steady_shear,
            {"rates": [0.2, 0.3], "applied_strain": 2.0, "samples": 40, "dt": 0.05, **weight},
            2,
        ),
        "equilibrate": (
            pm.equilibrate,
            {"amplitude": 1e-4, "frequency": 0.05, "expected_stress": 1e-4, "dt": 0.05, "step_limit": 3000, **weight},
            1,
        ),
    }
    found = {}
    for name, (call, given, turn) in calls.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.npz"
            stop = StopAt(turn)
            raised(lambda: call(scene, checkpoint=path, progress=stop, **given), KeyboardInterrupt)  # noqa: B023
            found[f"{name}, resumed"] = call(scene, checkpoint=path, **given)
        found[name] = call(scene, **given)
    return {"later": found}


@case("checkpoint/simulate, interrupted")
def interrupted(pm):
    scene = gel(pm)
    given = {"dt": 0.02, "mass_n": masses(scene.packing), "applied_strain": pm.SteadyStrain(0.02)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.npz"
        stop = raised(
            lambda: pm.simulate(scene, steps=20_000, checkpoint=path, progress=StopAt(1), **given), KeyboardInterrupt
        )
        cut = stop.run.steps
        end = cut + 50
        resumed = pm.resume(path, scene, steps=end)
    whole = pm.simulate(scene, steps=end, **given)
    same = np.array_equal(whole.packing.position_nd, resumed.packing.position_nd)
    return {"cut": 0 < cut < 20_000, "same": same, "steps": resumed.steps == end}


# -- rheology ----------------------------------------------------------------------------------------------------------

_SINE = {"frequency": 0.05, "samples_per_period": 40, "dt": 0.05}


def sheared(pm, scene, **settings):
    """Return the groups of a run under oscillatory shear, and its moduli."""
    given = {"amplitude": 0.05, "periods": 3.0, "mass_n": masses(scene.packing), "frames": 3, **_SINE, **settings}
    run = pm.oscillatory_shear(scene, **given)
    moduli = run.moduli
    found = strained(run, storage=moduli.storage, loss=moduli.loss)
    found["later"]["contact"] = run.demodulated("contact", (1, 0))
    found["later"]["derived"] = [run.phase_t, run.pressure_t, run.shear_stress_t, run.sliding_fraction_t]
    return found


@case("rheology/oscillatory, all effects", dimension=2, bonds=True)
@case("rheology/oscillatory, friction", dimension=2, bonds=False)
@case("rheology/oscillatory, spheres", dimension=3, bonds=True)
def oscillatory(pm, dimension, bonds):
    scene = gel(pm, dimension, bonds=bonds)
    axes = (0, 1) if dimension == 2 else (2, 0)
    return sheared(pm, scene, axes=axes, **generic(scene.packing))


@case("rheology/oscillatory, frictionless")
def oscillatory_plain(pm):
    return sheared(pm, repulsive(pm, at_rest(pm), None, damped(pm)), strain_path="increments", pre_periods=0.5)


@case("rheology/oscillatory, Euler and rests")
def oscillatory_rests(pm):
    return sheared(
        pm, gel(pm), method=pm.SemiImplicitEuler(), pre_periods=0.5, post_periods=0.5, skip_periods=1.0, dt=None
    )


@case("rheology/oscillatory, relative frequency")
def oscillatory_relative(pm):
    return sheared(pm, gel(pm), frequency=None, relative_frequency=0.05, dt=None)


@case("rheology/rough plates", carried=True)
@case("rheology/rough plates alone drive", carried=False)
def plates(pm, carried):
    scene = gel(pm, particles=48)
    return sheared(pm, scene, held_n=pm.rough_plates(scene.packing), carried=carried, periods=2.0)


@case("rheology/smooth walls")
def smooth_walls(pm):
    scene = gel(pm, particles=48).without(pm.Friction)
    height = float(scene.packing.box.lattice_dd[1, 1])
    walls = pm.Walls(axis=1, low=-0.3, high=height + 0.3, law=pm.LinearSpring())
    return sheared(pm, scene.replace(effects=(*scene.effects, walls)), periods=2.0)


@case("rheology/ramps")
def ramps(pm):
    found = {}
    for mode, dimension in (("shear", 2), ("uniaxial", 2), ("isotropic", 2), ("shear", 3)):
        scene = gel(pm, dimension, bonds=dimension == 2)
        run = pm.ramp_strain(
            scene,
            rate=-0.01,
            applied_strain=0.15,
            mode=mode,
            samples=60,
            dt=0.05,
            mass_n=masses(scene.packing),
            frames=3,
        )
        found |= {f"{group}, {mode}, {dimension}D": part for group, part in strained(run).items()}
    return found


@case("rheology/creep")
def creep(pm):
    found = {}
    for name, scene, choices in (
        ("all effects", gel(pm), {}),
        ("inertia", gel(pm), {"inertia": 100.0, "viscosity": 1.0}),
        ("spheres", gel(pm, 3, bonds=False), {"axes": (1, 2)}),
    ):
        run = pm.creep(scene, stress=0.01, duration=40.0, hold=25.0, dt=0.05, mass_n=masses(scene.packing), **choices)
        found |= {f"{group}, {name}": part for group, part in strained(run).items() if group != "set"}
    return found


@case("rheology/amplitude sweep")
def amplitude_sweep(pm):
    scene = gel(pm)
    sweep = pm.amplitude_sweep(scene, amplitudes=[1e-4, 0.05, 0.3], periods=2.0, mass_n=masses(scene.packing), **_SINE)
    return {
        "later": sweep,
        "average": {"storage": sweep.storage_a, "loss": sweep.loss_a},
        "set": {"amplitude": sweep.amplitude_a},
        "later, yields": [sweep.yield_strain, sweep.softening_strain()],
    }


@case("rheology/steady shear")
def steady_shear(pm):
    scene = gel(pm, bonds=False)
    curve = pm.steady_shear(
        scene, rates=[0.05, 0.3], applied_strain=3.0, samples=120, dt=0.05, mass_n=masses(scene.packing), frames=2
    )
    return {
        "later": curve,
        "average": {"stress": curve.stress_r, "pressure": curve.pressure_r, "contacts": curve.contacts_r},
        "later, ratios": [curve.viscosity_r, curve.stress_ratio_r],
    }


@case("rheology/series of shears")
def shear_series(pm):
    scene = gel(pm)

    def prepare(seed):
        return scene

    given = {
        "amplitudes": [1e-3, 0.1],
        "frictions": [0.2, 0.5],
        "controls": ("prepared", "bulk", "uncrosslinked", "frictionless"),
        "periods": 2.0,
        **_SINE,
    }
    with tempfile.TemporaryDirectory() as folder:
        pm.shear_series(prepare, folder, repeats=1, **given)
        series = pm.shear_series(prepare, folder, repeats=2, **given)
    trials = {f"{trial}": result for trial, result in sorted(series.trials.items(), key=repr)}
    return {"later": {"curves": series.curves, "trials": list(trials.values()), "keys": list(trials)}}


@case("rheology/equilibrate")
def equilibrate(pm):
    found = {}
    given = {"amplitude": 1e-3, "frequency": 0.05, "dt": 0.05}
    for name, scene, expected in (("all", gel(pm), 1e-4), ("friction", gel(pm, bonds=False), None)):
        found[name] = pm.equilibrate(scene, mass_n=masses(scene.packing), expected_stress=expected, **given)
    scene = gel(pm)
    shaken = scene.packing.position_nd + 0.02 * np.random.default_rng(2).standard_normal((24, 2))
    moved = scene.replace(packing=scene.packing.replace(position_nd=shaken))
    found["shaken"] = pm.equilibrate(
        moved, mass_n=masses(moved.packing), expected_stress=1e-4, step_limit=4000, check=False, **given
    )
    return {"later": found, "average": {name: run.expected_stress for name, run in found.items()}}


@case("rheology/batch, frictionless", name="plain")
@case("rheology/batch, friction", name="friction")
@case("rheology/batch, all effects", name="all")
@case("rheology/batch, spheres", name="spheres")
def shear_batch(pm, name):
    scene = {
        "plain": lambda: repulsive(pm, at_rest(pm, particles=24)),
        "friction": lambda: gel(pm, bonds=False),
        "all": lambda: gel(pm),
        "spheres": lambda: gel(pm, 3, bonds=False),
    }[name]()
    rng = np.random.default_rng(0)
    found = {}
    for control, threads in (("rate", 1), ("rate", 2), ("strain", 1), ("strain_and_rate", 2)):
        switched = name == "friction" and control == "rate"
        scenes = [scene] * 3
        batch = pm.ShearBatch(
            scenes,
            control=control,
            steps=4,
            dt=0.05,
            threads=threads,
            switched_friction=switched,
            mass_n=masses(scene.packing),
        )
        rows, good = [batch.figure_bk.copy()], []
        strain = np.zeros(3)
        for _ in range(60):
            rate = rng.uniform(-0.02, 0.02, 3)
            strain = strain + 0.2 * rate
            told = {"rate": [rate], "strain": [strain], "strain_and_rate": [strain, rate]}[control]
            if switched:
                told = [*told, rng.uniform(0.0, 0.5, 3)]
            good.append(batch.advance(np.stack(told, axis=1)))
            rows.append(batch.figure_bk.copy())
        key = f"{control}, {threads} threads"
        figures = np.array(rows)
        found[f"early, {key}"] = figures[:26]
        found[f"later, {key}"] = {
            "figures": figures[26:],
            "packing": batch.packing(2),
            "velocities": batch.velocities(2),
            "spins": batch.spins(2),
        }
        found[f"set, {key}"] = {"names": list(batch.names), "good": np.array(good), "outcome": batch.outcome(0)}
        batch.restart(1, rate=0.01)
        found[f"early, {key}, anew"] = batch.figure_bk
        batch.close()
    return found


# -- the reference model -----------------------------------------------------------------------------------------------


@case("particle_shear/experiments")
def particle_shear(pm):
    found = {}
    for law in ("divergent", "plateau", "exponential"):
        experiment = pm.ParticleShear(
            particles=40, pre_periods=0.1, periods=0.5, post_periods=0.1, amplitude=0.1, law=law
        )
        run = experiment.run(pm.private("prepared_discs")(experiment, seed=4, centers=3), frames=3)
        found[law] = {
            "constants": [experiment.frequency, experiment.mass, experiment.tau, experiment.time_step],
            "steps": experiment.steps,
            "time": run.time_t,
            "strain": run.strain_t,
            "position": run.position_tnd,
            "final": run.final,
            **{tensor: run.stress(tensor) for tensor in ("overall", "love_weber", "otsuki")},
            "moduli": run.moduli("overall", drift="none"),
        }
    return found


@case("particle_shear/scenarios")
def scenarios(pm):
    found = {}
    for name, make in pm.private("scenarios").items():
        if name.startswith(("assembly", "crosslinked")):
            continue
        steps = make().run()
        found[name] = {"final": steps.final, "last": steps.last}
    return found


def native_scenario(pm, name):
    scene = pm.read_scene(name)
    drive = scene.drive
    steps = drive.steps if drive.steps is not None else round(drive.duration / drive.dt)
    packing = scene.packing
    if pm.side == "head":
        mass = packing.mass_n
    else:
        mass = drive.masses if drive.masses is not None else drive.density * np.pi * packing.radius_n**2
    held = np.zeros(packing.particles, dtype=bool)
    held[list(drive.held)] = True
    given = {"dt": drive.dt, "mass_n": np.array(mass), "velocity_nd": drive.velocities}
    if drive.spins is not None:
        given["spin_nk"] = np.reshape(drive.spins, (packing.particles, -1))
    if held.any():
        given["held_n"] = held
    return followed(pm, scene, steps=min(steps, 400), **given)


for _name in SPHERES:
    case(f"scenarios/{_name}", name=_name)(native_scenario)


# -- environments ------------------------------------------------------------------------------------------------------


def episode(env, seed, actions, options=None):
    """Return observations, rewards, ends and infos of an episode."""
    observation, info = env.reset(seed=seed, options=options)
    rows = [{"observation": np.array(observation), "info": dict(info)}]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        rows.append(
            {
                "observation": np.array(observation),
                "reward": np.array(reward),
                "terminated": np.array(terminated),
                "truncated": np.array(truncated),
                "info": dict(info),
            }
        )
        if np.ndim(terminated) == 0 and (terminated or truncated):
            break
    return rows


def quench_scene(pm, name):
    """Return a scene for Quench-v0."""
    return {
        "discs": lambda: repulsive(pm, discs(pm, 16, 0.8)),
        "spheres": lambda: repulsive(pm, spheres(pm, 16, 0.6)),
        "trimers": lambda: repulsive(pm, molecules(pm, "trimers", packing_fraction=0.4)),
        "default": lambda: None,
        "triangular": lambda: "triangular",
    }[name]()


QUENCHES = {
    "discs": {"shear_modulus": True},
    "spheres": {"verdict": "strict"},
    "trimers": {"relax": 20},
    "default": {},
    "triangular": {"start": "scene", "relax": 5},
}


@case("environments/Quench-v0 alone")
def quench_alone(pm):
    found = {}
    actions = np.random.default_rng(1).uniform(-0.6, 1.0, (15, 2))
    for name, given in QUENCHES.items():
        env = pm.make("Quench-v0", scene=quench_scene(pm, name), **given)
        found[name] = {
            "rows": episode(env, 5, actions),
            "packing": env.unwrapped.packing,
            "names": list(env.unwrapped.observation_names),
            "spaces": [env.observation_space.low, env.observation_space.high, env.action_space.low],
        }
        env.close()
    return found


@case("environments/Quench-v0 by hand")
def quench_by_hand(pm):
    env = pm.make("Quench-v0", scene=repulsive(pm, discs(pm, 16, 0.8)))
    observation, info = env.reset(seed=1)
    change, over, rows = 0.02, False, []
    while not over:
        observation, reward, terminated, truncated, info = env.step(
            env.unwrapped.action(packing_fraction_change=change)
        )
        rows.append({"observation": observation, "reward": reward, "info": dict(info), "end": [terminated, truncated]})
        if (info["pressure"] > 1e-9) == (change > 0.0):
            change *= -0.5
        over = terminated or truncated
    return {"rows": rows, "packing": env.unwrapped.packing}


@case("environments/Quench-v0 batched, 1 thread", threads=1)
@case("environments/Quench-v0 batched, 2 threads", threads=2)
def quench_batched(pm, threads):
    found = {}
    for name in ("discs", "trimers"):
        envs = pm.make_vec("Quench-v0", 3, scene=quench_scene(pm, name), threads=threads, **QUENCHES[name])
        actions = np.random.default_rng(2).uniform(-0.6, 1.0, (45, 3, 2))
        found[name] = episode(envs, 7, actions)
        envs.close()
    return found


GOALS = ("follow_stress", "dissipate_least", "find_yield_strain")


def shear_episode(pm, goal, num_envs=None, threads=None):
    found = {}
    rng = np.random.default_rng(3)
    scenes = {
        "frictionless": repulsive(pm, at_rest(pm, particles=24)),
        "friction": gel(pm, bonds=False),
        "all": gel(pm),
    }
    controls = {"frictionless": "rate", "friction": "strain", "all": "strain_and_rate"}
    for name, scene in scenes.items():
        given = {"scene": scene, "goal": goal, "control": controls[name], "frame_skip": 5, "dt": 0.05, "budget": 50}
        if name == "friction":
            given["extra_actions"] = ("friction",)
        if num_envs is None:
            env = pm.make("Shear-v0", **given)
            space = env.action_space
        else:
            env = pm.make_vec("Shear-v0", num_envs, threads=threads, **given)
            space = env.single_action_space
        lead = () if num_envs is None else (num_envs,)
        actions = []
        strain = np.zeros(lead)
        for _ in range(45):
            rate = rng.uniform(-0.01, 0.015, lead)
            strain = strain + rate * 0.25
            numbers = {"rate": [rate], "strain": [strain], "strain_and_rate": [strain, rate]}[controls[name]]
            if name == "friction":
                numbers = [*numbers, np.full(lead, 0.3)]
            actions.append(np.clip(np.stack(numbers, axis=-1), space.low, space.high))
        rows = episode(env, 11, actions, options={"rate": 0.0})
        found[f"early, {name}"] = rows[:21]
        found[f"later, {name}"] = rows[21:]
        if num_envs is None:
            run = env.unwrapped.run
            found[f"later, {name}, run"] = [run.figure_tk, run.reward_t, run.stress_tdd]
            found[f"set, {name}"] = [list(run.names), list(env.unwrapped.observation_names)]
        env.close()
    return found


for _name in GOALS:
    case(f"environments/Shear-v0 alone, {_name}", goal=_name)(shear_episode)
    case(f"environments/Shear-v0 batched, {_name}, 1 thread", goal=_name, num_envs=3, threads=1)(shear_episode)
case("environments/Shear-v0 batched, follow_stress, 2 threads", goal=GOALS[0], num_envs=3, threads=2)(shear_episode)


@case("environments/goals and rewards of one's own")
def own_goals(pm):
    goal = pm.private("FollowStress")(amplitude=0.005, period=12.0, random=True, weight_stress=2.0, weight_effort=0.3)
    env = pm.make("Shear-v0", scene=gel(pm, bonds=False), goal=goal, frame_skip=5, dt=0.05, budget=30)
    found = {"early, goal": episode(env, 4, np.full((18, 1), 2e-3))}
    env.close()
    reward = pm.private("QuenchReward")(distance_weight=0.5, evaluation_weight=0.2, stability_weight=3.0)
    env = pm.make("Quench-v0", scene=quench_scene(pm, "discs"), reward=reward)
    found["reward"] = episode(env, 4, np.random.default_rng(6).uniform(-0.3, 1.0, (12, 2)))
    env.close()
    return found


@case("environments/Shear-v0, shipped scenes and starts")
def shear_starts(pm):
    found = {}
    actions = np.full((10, 1), 1e-3)
    for name, given in {
        "triangular": {"scene": "triangular", "units": "reduced"},
        "links as bonds": {"scene": repulsive(pm, molecules(pm, "trimers", packing_fraction=0.4)), "links": "bonds"},
        "drawn": {"scene": "quench", "start": 2},
        "microgel": {"scene": "microgel", "relax": False},
    }.items():
        env = pm.make("Shear-v0", frame_skip=4, **given)
        found[f"early, {name}"] = episode(env, 3, actions * min(1.0, float(env.action_space.high[0]) / 1e-3))
        env.close()
    return found


# -- drives and the command --------------------------------------------------------------------------------------------


def numbers_of(pm, *words):
    """Return the numbers that a command writes, and its exit code."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.json"
        code = pm.command(*words, "--json", os.fspath(path))
        return {"code": code, "numbers": json.loads(path.read_text())}


_DRIVEN = {"dt": 0.05, "axes": (0, 1)}

# drive -> (scene, drive) of a facade
DRIVES = {
    "quench": lambda pm: (repulsive(pm, discs(pm)), pm.QuenchDrive(force_tolerance=1e-10, method=pm.LBFGS())),
    "jam": lambda pm: (
        repulsive(pm, discs(pm, 32, 0.85)),
        pm.JamDrive(pressure=1e-6, strain="isotropic", method=pm.HardVertex()),
    ),
    "shear-stabilize": lambda pm: (
        repulsive(pm, at_rest(pm)),
        pm.ShearStabilizeDrive(pressure=1e-3, force_tolerance=1e-9),
    ),
    "cement": lambda pm: (
        repulsive(pm, discs(pm, 24, 0.8)),
        pm.CementDrive(pressure=1e-8, orders=2, seed=0, step=0.1, freeze="clusters"),
    ),
    "simulate": lambda pm: (
        gel(pm),
        pm.SimulateDrive(
            steps=50,
            dt=0.05,
            method=pm.SemiImplicitEuler(),
            velocities=tuple((0.01 * (k % 3), -0.02 * (k % 2)) for k in range(24)),
            spins=tuple((0.01 * k,) for k in range(24)),
            held=(3, 5),
        ),
    ),
    "oscillatory shear": lambda pm: (
        gel(pm),
        pm.OscillatoryShearDrive(
            amplitude=0.01, frequency=0.05, periods=2.0, samples_per_period=20, method=pm.VelocityVerlet(), **_DRIVEN
        ),
    ),
    "steady shear": lambda pm: (
        gel(pm, bonds=False),
        pm.SteadyShearDrive(rates=(0.1, 0.2), applied_strain=1.0, skip_strain=0.5, blocks=4, samples=40, **_DRIVEN),
    ),
    "ramp": lambda pm: (
        gel(pm),
        pm.RampStrainDrive(rate=-0.01, applied_strain=0.05, mode="uniaxial", samples=20, **_DRIVEN),
    ),
    "creep": lambda pm: (gel(pm), pm.CreepDrive(stress=0.01, duration=20.0, hold=10.0, **_DRIVEN)),
}


def driven(pm, name):
    """Return what the command writes of a scene file with this drive."""
    scene, drive = DRIVES[name](pm)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        pm.write_scene(scene.replace(drive=drive), path)
        packing = os.fspath(Path(folder) / "out.npz")
        found = numbers_of(pm, "run", os.fspath(path), "--modes", "0", "--out", packing)
        return {**found, "packing": pm.read_packing(packing) if Path(packing).exists() else None}


for _name in DRIVES:
    case(f"command/run, drive {_name}", name=_name)(driven)


@case("command/jam")
def command_jam(pm):
    return numbers_of(pm, "jam", "hertz", "--no-record", "--modes", "4", "--pressure", "1e-6", "--seed", "2")


@case("command/run, quench", words=("run", "quench", "--modes", "2"))
@case("command/run, two spheres", words=("run", "two-spheres-general", "--modes", "0"))
@case("command/unjam", words=("unjam", "kagome", "--repeats", "2", "2", "--steps", "10"))
def command(pm, words):
    return numbers_of(pm, *words)


@case("command/analyze")
def command_analyze(pm):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "packing.npz"
        pm.write_packing(jammed(pm), path, law=pm.Harmonic())
        return numbers_of(pm, "analyze", os.fspath(path), "--modes", "4")
