"""The packings and cases of bench_answers.py: what packmech answers to its public calls, small and with fixed seeds.

A packing is a function registered by `packing(name)`, a case one by `case(name)`. Both are given `take`, which returns
a packing by its name: made, or as an earlier file has it. A case returns its answer, a mapping from names to numbers,
arrays, texts or further mappings; `ask` adds what a call answers, or that it refuses.

Cases are either static, asked of packings that are taken (what follows from these to rounding: moduli, modes,
certificates, a hundred steps of time), or say `amplifies=True`: random jamming, paths through changes of contacts and
long runs through time, where rounding grows. Names of what is stored tell how it is compared: see bench_answers.py.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import packmech as pm

Answer = dict[str, Any]
Take = Callable[[str], pm.Packing]

SHORT, LONG = 100, 2000  # steps of runs through time
RIGID = {"rigid dimers": pm.Dimer(0.8), "rigid trimers": pm.Trimer(0.8)}
LAWS = {
    "harmonic": pm.Harmonic(),
    "hertz": pm.Hertz(),
    "lennard-jones": pm.RepulsiveLennardJones(),
    "linear spring": pm.LinearSpring(),
    "power law": pm.PowerLaw(1.0, 3.0),
}
HARMONIC = (pm.Repulsion(),)
DAMPED = (pm.Repulsion(), pm.ContactDamping(0.3))
ROUGH = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3), pm.Friction(0.5, damping=0.1))
SLIPPERY = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3), pm.Friction(0.1, damping=0.1))


class Case(NamedTuple):
    """A case: its function, and whether rounding grows in it."""

    function: Callable[[Take], Answer]
    amplifies: bool


PACKINGS: dict[str, Callable[[Take], pm.Packing]] = {}
CASES: dict[str, Case] = {}


def packing(name: str, /, **settings: Any) -> Callable[[Callable[..., pm.Packing]], Callable[..., pm.Packing]]:
    """Register a function as the packing of this name, called with these settings."""

    def registered(function: Callable[..., pm.Packing]) -> Callable[..., pm.Packing]:
        if name in PACKINGS:
            raise ValueError(f"name must be that of no other packing, got {name!r}")
        PACKINGS[name] = partial(function, **settings)
        return function

    return registered


def case(
    name: str, /, *, amplifies: bool = False, **settings: Any
) -> Callable[[Callable[..., Answer]], Callable[..., Answer]]:
    """Register a function as the case of this name, called with these settings."""

    def registered(function: Callable[..., Answer]) -> Callable[..., Answer]:
        if name in CASES:
            raise ValueError(f"name must be that of no other case, got {name!r}")
        CASES[name] = Case(partial(function, **settings), amplifies)
        return function

    return registered


def refusal(error: Exception) -> Answer:
    """Return an exception as an answer."""
    return {"refused": type(error).__name__, "message": str(error)}


def ask(found: Answer, name: str, call: Callable[..., Any], *given: Any, **settings: Any) -> None:
    """Add what a call answers under a name; that it refuses is an answer, too."""
    try:
        found[name] = call(*given, **settings)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is compared
        found[name] = refusal(error)


# -- what is stored of results -----------------------------------------------------------------------------------------


def has_shapes(one: pm.Packing) -> bool:
    """Return whether particles are no discs or spheres, in every version: packings of discs once had no shapes."""
    return np.size(getattr(one.shapes, "orientation_nq", ())) > 0


def of_packing(one: pm.Packing) -> Answer:
    """Return where particles are."""
    found = {"position": one.position_nd, "lattice": one.box.lattice_dd, "packing fraction": pm.packing_fraction(one)}
    if has_shapes(one):
        found["orientation"] = one.shapes.orientation_nq
    if one.links:
        found["link residual"] = one.link_error
    if one.tangential is not None:
        found["springs"] = len(one.tangential)
        found["spring displacement"] = np.linalg.norm(one.tangential.displacement_ck, axis=1)
    return found


def of_run(run: pm.Run) -> Answer:
    """Return what a run reached."""
    report = {
        key: value for key, value in run.report.items() if isinstance(value, bool | int | float | str | np.generic)
    }
    unmet = [one.name for one in run.unmet]
    work = {"steps": run.steps, "force_evaluations": run.force_evaluations}
    # changes of contacts on the way: some come and go within rounding
    work |= {key: report.pop(key) for key in ("contacts_closed", "contacts_opened") if key in report}
    reached = {"outcome": run.outcome, "unmet": ", ".join(unmet), "residual": run.residual}
    return {**reached, "work": work, "packing": of_packing(run.packing), "report": report}


def run_of(call: Callable[..., Any], *given: Any, **settings: Any) -> Answer:
    """Return what the run of a call reached, or its runs."""
    run = call(*given, **settings)
    if isinstance(run, tuple):
        return {f"{k}": of_run(one) for k, one in enumerate(run)}
    return of_run(run)


def of_matrix(matrix: Any) -> Answer:
    """Return a matrix by its shape, its entries beyond rounding, its norm and a random bilinear form."""
    dense = matrix.toarray() if hasattr(matrix, "toarray") else np.asarray(matrix)
    rng = np.random.default_rng(0)
    left, right = rng.standard_normal(dense.shape[0]), rng.standard_normal(dense.shape[1])
    size = np.abs(dense)
    return {
        "shape": dense.shape,
        "nonzero": int((size > 1e-10 * size.max(initial=0.0)).sum()),
        "norm": np.linalg.norm(dense),
        "bilinear form": left @ dense @ right,
        "work": {"stored entries": getattr(matrix, "nnz", dense.size)},
    }


def matrix_of(call: Callable[..., Any], *given: Any, **settings: Any) -> Answer:
    """Return the matrix that a call returns, by a few numbers."""
    return of_matrix(call(*given, **settings))


def moduli_of(scene: pm.Scene, **settings: Any) -> Answer:
    """Return the moduli of a scene."""
    moduli = pm.elastic_moduli(scene, **settings)
    found: Answer = {
        "cauchy": moduli.cauchy,
        "energy": moduli.energy,
        "affine": moduli.affine,
        "compliance": moduli.compliance,
        "stress": moduli.stress_dd,
        "negative positions": moduli.negative_positions,
        "negative strains": moduli.negative_strains,
        "soft directions": len(moduli.soft_directions),
        "stiff directions": len(moduli.stiff_directions),
        "floppy positions": moduli.floppy_positions,
        "particles": moduli.particles,
        "contacts": moduli.contacts,
        "at limit": moduli.at_limit_k,
        "sliding": moduli.sliding_k,
        "doubtful at limit": moduli.doubtful_at_limit,
        "residual": moduli.residual,
        "force residual": moduli.force_residual,
        "stable": moduli.stable,
    }
    for name in ("bulk_modulus", "shear_modulus", "poisson_ratio"):
        ask(found, name, getattr, moduli, name)
    return found


def modes_of(scene: pm.Scene, count: int | None = 12, **settings: Any) -> Answer:
    """Return the lowest frequencies, zero where they are so to rounding."""
    modes = pm.normal_modes(scene, count, **settings)
    zero_m = modes.zero_m
    return {
        "frequency": np.where(zero_m, 0.0, modes.frequency_m),
        "zero": int(zero_m.sum()),
        "negative": modes.negative,
        "available": modes.available,
        "translations": modes.translations,
        "particles": len(modes.index_n),
        "method": modes.method,
        "residual": modes.residual,
        "force residual": modes.force_residual,
    }


def verdict_of(given: Any, **settings: Any) -> Answer:
    """Return a verdict and what its certificates are worth."""
    verdict = pm.classify_jamming(given, **settings)
    found: Answer = {
        "local": verdict.local,
        "rattlers": verdict.rattlers,
        "contacts": verdict.contacts,
        "at rest": verdict.rest is None or verdict.rest.at_rest,
        # where overlaps are rounding, so is what forces they leave
        "residual at rest": 0.0 if verdict.rest is None or verdict.rest.floor > 1e-3 else verdict.rest.residual,
    }
    for name, one in (("collectively", verdict.collectively), ("strictly", verdict.strictly)):
        found[name] = {
            "verdict": one.verdict,
            "first order": str(one.first_order_jammed),
            "isostatic contacts": one.isostatic_contacts,
            "states of self stress": one.states_of_self_stress,
            "floppy modes": one.floppy_modes,
            "smallest singular value": one.smallest_singular_value,
            "smallest force": one.smallest_force,
            "stable": str(one.stable),
            "solves": ", ".join(f"{solve.outcome.value}" for solve in one.solves),
            "balance": one.balance,
            "duality gap": one.gap,
        }
    return found


def moved(scene: pm.Scene, steps: int = SHORT, **settings: Any) -> Answer:
    """Return the state after a few steps of time, and the trace up to there."""
    run = pm.simulate(scene, steps=steps, trace_every=10, **settings)
    trace = run.trace
    found = of_run(run) | {"dt": run.dt, "velocity": run.velocity_nd, "strain": run.strain}
    found |= {"drift": run.energy_drift, "link residual": run.link_error, "momentum residual": run.momentum_error}
    if run.spin_nk is not None:
        found["spin"] = run.spin_nk
    for name in ("energy_t", "kinetic_t", "contacts_t", "sliding_t", "stress_tdd", "overall_stress_tdd"):
        found[name] = getattr(trace, name)
    return found


def averaged(scene: pm.Scene, **settings: Any) -> Answer:
    """Return means over the second half of a long run through time."""
    run = pm.simulate(scene, steps=LONG, trace_every=20, **settings)
    trace, half = run.trace, LONG // 40
    means = {
        name: np.asarray(getattr(trace, name), dtype=float)[half:].mean(axis=0)
        for name in ("energy_t", "kinetic_t", "contacts_t", "overall_stress_tdd")
    }
    conserved = {"link residual": run.link_error, "momentum residual": run.momentum_error}
    return {"outcome": run.outcome, "dt": run.dt, "mean": means, **conserved}


def strained(run: Any) -> Answer:
    """Return the stress of a run under strain, and its mean."""
    return {
        "outcome": run.outcome,
        "dt": run.dt,
        "strain": run.strain_t,
        "shear stress": run.shear_stress_t,
        "pressure": run.pressure_t,
        "mean contacts": float(run.contacts_t.mean()),
        "mean sliding": float(run.sliding_t.mean()),
        "residual": run.residual,
    }


def generic(one: pm.Packing, scale: float = 0.02, *, turns: bool = True) -> Answer:
    """Return velocities, and spins, of no symmetry."""
    rng = np.random.default_rng(7)
    found = {"velocity_nd": scale * rng.standard_normal(one.position_nd.shape)}
    if turns:
        found["spin_nk"] = scale * rng.standard_normal((one.particles, 1 if one.dimension == 2 else 3))
    return found


# -- packings ----------------------------------------------------------------------------------------------------------


def of_fraction(fraction: float, dimension: int, particles: int, **settings: Any) -> pm.Packing:
    """Return a random packing, seed 1."""
    return pm.random_packing(particles, dimension=dimension, packing_fraction=fraction, seed=1, **settings)


STARTS: dict[str, Callable[[], pm.Packing]] = {
    "discs": partial(of_fraction, 0.9, 2, 48, sizes=pm.Bidisperse(1.4)),
    "discs, ratio 3": partial(of_fraction, 0.95, 2, 64, sizes=pm.Bidisperse(3.0)),
    "discs, ratio 10": partial(of_fraction, 0.95, 2, 80, sizes=pm.Bidisperse(10.0, 0.95)),
    "discs, equal": partial(of_fraction, 0.9, 2, 48),
    "loose discs": partial(of_fraction, 0.7, 2, 40, sizes=pm.Bidisperse(1.4)),
    "spheres": partial(of_fraction, 0.68, 3, 32),
    "spheres, ratio 1.4": partial(of_fraction, 0.7, 3, 32, sizes=pm.Bidisperse(1.4)),
    "spheres, ratio 3": partial(of_fraction, 0.75, 3, 64, sizes=pm.Bidisperse(3.0, 0.8)),
    "loose spheres": partial(of_fraction, 0.5, 3, 24),
    "ellipses": partial(of_fraction, 0.6, 2, 32, shapes=pm.Ellipses(1.5)),
    "spheroids": partial(of_fraction, 0.5, 3, 20, shapes=pm.Ellipses(1.5)),
    "rigid dimers": partial(of_fraction, 0.6, 2, 24, shapes=RIGID["rigid dimers"]),
    "rigid trimers": partial(of_fraction, 0.4, 3, 16, shapes=RIGID["rigid trimers"]),
    "dimers": partial(
        pm.cluster_packing, 12, pm.Dimer(), dimension=2, packing_fraction=0.35, largest_overlap=0.1, seed=1
    ),
    "trimers": partial(
        pm.cluster_packing,
        12,
        pm.Trimer(angle=(1.1, 2.6)),
        dimension=2,
        packing_fraction=0.35,
        largest_overlap=0.1,
        seed=1,
    ),
    "trimers in space": partial(
        pm.cluster_packing,
        10,
        pm.Trimer(angle=(1.1, 2.6)),
        dimension=3,
        packing_fraction=0.2,
        largest_overlap=0.1,
        seed=1,
    ),
    "chains": partial(pm.chain_packing, 3, 8, dimension=2, packing_fraction=0.35, seed=3),
    "chains in space": partial(pm.chain_packing, 3, 8, dimension=3, packing_fraction=0.2, seed=3),
}
# what is jammed without friction, in the words of the starts
SMOOTH = {
    "plain": ("discs", "discs, ratio 3", "discs, ratio 10", "discs, equal", "spheres", "spheres, ratio 1.4"),
    "shapes": ("ellipses", "spheroids", "rigid dimers", "rigid trimers"),
    "links": ("dimers", "trimers", "trimers in space", "chains", "chains in space"),
}
FRICTIONAL = {
    "rough discs": ("loose discs", ROUGH),
    "slippery discs": ("loose discs", SLIPPERY),
    "rough spheres": ("loose spheres", ROUGH),
}
LATTICES = {
    "triangular": (4, 4),
    "square": (3, 3),
    "kagome": (2, 2),
    "honeycomb": (3, 3),
    "snub square": (2, 2),
    "reinforced kagome": (1, 1),
    "fcc": (2, 2, 2),
    "hcp": (2, 2, 2),
    "diamond": (2, 2, 2),
    "tunneled fcc": (2, 2, 2),
}


def start(take: Take, name: str) -> pm.Packing:
    """Return a random start."""
    return STARTS[name]()


def jammed(take: Take, name: str, pressure: float) -> pm.Packing:
    """Return a packing that is jammed with every strain free."""
    found = pm.jam(pm.Scene(take(f"start: {name}"), HARMONIC), pressure=pressure, strain="free").packing
    if not found.plain:
        return found
    # what rattles touches its cage to rounding: smaller, it has no contact that may come and go
    return found.replace(radius_n=np.where(pm.find_rattlers(found), 0.98, 1.0) * found.radius_n)


def pressed(take: Take, name: str) -> pm.Packing:
    """Return a packing that is jammed with friction."""
    begin, effects = FRICTIONAL[name]
    return pm.jam(pm.Scene(take(f"start: {begin}"), effects), pressure=1e-3, strain="isotropic").packing


def lattice(take: Take, name: str, relative_overlap: float = 0.0) -> pm.Packing:
    """Return a lattice."""
    return pm.lattice_packing(name, LATTICES[name], relative_overlap=relative_overlap)


for _name in STARTS:
    packing(f"start: {_name}", name=_name)(start)
for _family in SMOOTH.values():
    for _name in _family:
        packing(f"jammed: {_name}", name=_name, pressure=1e-3)(jammed)
for _name in ("discs", "spheres", "trimers", "ellipses", "rigid dimers"):
    packing(f"hard: {_name}", name=_name, pressure=1e-8)(jammed)
for _name in FRICTIONAL:
    packing(f"jammed: {_name}", name=_name)(pressed)
for _name in LATTICES:
    packing(f"lattice: {_name}", name=_name)(lattice)
    packing(f"pressed lattice: {_name}", name=_name, relative_overlap=0.01)(lattice)


@packing("at rest: harmonic discs", dimension=2, law="harmonic")
@packing("at rest: hertz discs", dimension=2, law="hertz")
@packing("at rest: lennard-jones discs", dimension=2, law="lennard-jones")
@packing("at rest: linear spring discs", dimension=2, law="linear spring")
@packing("at rest: power law discs", dimension=2, law="power law")
@packing("at rest: harmonic spheres", dimension=3, law="harmonic")
@packing("at rest: hertz spheres", dimension=3, law="hertz")
@packing("at rest: linear spring spheres", dimension=3, law="linear spring")
def at_rest(take: Take, dimension: int, law: str) -> pm.Packing:
    """Return a packing at a minimum of its energy, far beyond jamming."""
    fraction = {2: 1.0, 3: 0.78}[dimension]
    begin = of_fraction(fraction, dimension, 36, sizes=pm.Bidisperse(1.4))
    return pm.quench(pm.Scene(begin, (pm.Repulsion(LAWS[law]),)), force_tolerance=1e-12).packing


def pile_effects(one: pm.Packing) -> tuple[Any, ...]:
    """Return the effects of a pile: gravity, and walls at the ends of the cell."""
    top = float(one.box.lattice_dd[1, 1])
    return (pm.Repulsion(), pm.Gravity(0.0, -1e-3), pm.Walls(1, 0.2, top))


def held_effects() -> tuple[Any, ...]:
    """Return the effects of a packing some of whose particles are held."""
    return (pm.Repulsion(), pm.FixedParticles((0, 5, 11)))


@packing("pile: discs", name="loose discs")
@packing("pile: spheres", name="loose spheres")
@packing("pile: ellipses", name="ellipses")
def pile(take: Take, name: str) -> pm.Packing:
    """Return particles at rest under gravity between walls."""
    begin = take(f"start: {name}")
    return pm.quench(pm.Scene(begin, pile_effects(begin)), force_tolerance=1e-10, check=False).packing


@packing("held: discs", name="discs")
@packing("held: spheres", name="spheres")
@packing("held: ellipses", name="ellipses")
def held(take: Take, name: str) -> pm.Packing:
    """Return particles at rest of which some are held, in a box that presses them."""
    begin = take(f"start: {name}")
    smaller = (pm.packing_fraction(begin) / {"discs": 0.95, "spheres": 0.75, "ellipses": 1.0}[name]) ** (
        1.0 / begin.dimension
    )
    dense = begin.replace(position_nd=begin.position_nd * smaller, box=begin.box.scaled(smaller))
    return pm.quench(pm.Scene(dense, held_effects()), force_tolerance=1e-11).packing


def scene_at_rest(take: Take, dimension: int = 2, law: str = "harmonic", *effects: Any) -> pm.Scene:
    """Return the scene of a packing at rest, with further effects."""
    name = f"at rest: {law} {'discs' if dimension == 2 else 'spheres'}"
    return pm.Scene(take(name), (pm.Repulsion(LAWS[law]), *effects))


def smooth_scenes(take: Take, *families: str) -> dict[str, pm.Scene]:
    """Return the jammed packings of families, with the harmonic law."""
    names = [name for family in families for name in SMOOTH[family]]
    return {name: pm.Scene(take(f"jammed: {name}"), HARMONIC) for name in names}


def frictional_scenes(take: Take) -> dict[str, pm.Scene]:
    """Return the jammed packings with friction, and two whose most loaded contact is at the Coulomb limit."""
    found = {name: pm.Scene(take(f"jammed: {name}"), effects) for name, (_, effects) in FRICTIONAL.items()}
    return found | {f"{name}, at limit": at_limit(found[name]) for name in ("rough discs", "rough spheres")}


def at_limit(scene: pm.Scene) -> pm.Scene:
    """Return a scene with as little friction as bears its tangential forces."""
    forces = pm.contact_forces(scene)
    loaded_c = forces.normal_c > 1e-3 * forces.normal_c.mean()
    size_c = np.linalg.norm(forces.tangential_cd, axis=1)
    coefficient = float((size_c[loaded_c] / forces.normal_c[loaded_c]).max())
    repulsion, damping, _ = scene.effects
    return scene.replace(effects=(repulsion, damping, pm.Friction(coefficient, damping=0.1)))


def law_scenes(take: Take) -> dict[str, pm.Scene]:
    """Return packings at rest with each law."""
    found = {law: scene_at_rest(take, 2, law) for law in LAWS}
    return found | {f"{law} in space": scene_at_rest(take, 3, law) for law in ("harmonic", "hertz", "linear spring")}


def acted_scenes(take: Take) -> dict[str, pm.Scene]:
    """Return packings under gravity between walls, and such of which some are held."""
    found = {}
    for name in ("discs", "spheres", "ellipses"):
        one = take(f"pile: {name}")
        found[f"pile of {name}"] = pm.Scene(one, pile_effects(one))
        found[f"held {name}"] = pm.Scene(take(f"held: {name}"), held_effects())
    return found


def lattice_scenes(take: Take) -> dict[str, pm.Scene]:
    """Return lattices that are pressed."""
    return {name: pm.Scene(take(f"pressed lattice: {name}"), HARMONIC) for name in LATTICES}


def bonded(take: Take, dimension: int = 2, *, friction: bool = True) -> pm.Scene:
    """Return a packing with bonds along half of its contacts, dashpots, drag and friction."""
    one = take(f"at rest: linear spring {'discs' if dimension == 2 else 'spheres'}")
    bonds = pm.bond_contacts(one, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3)
    half = bonds.select(np.arange(len(bonds)) % 2 == 0)
    effects = ROUGH if friction else ROUGH[:2]
    return pm.Scene(one, (*effects, half, pm.BackgroundDamping(0.02)))


SCENES: dict[str, Callable[[Take], dict[str, pm.Scene]]] = {
    "discs and spheres": lambda take: smooth_scenes(take, "plain"),
    "shapes": lambda take: smooth_scenes(take, "shapes"),
    "links": lambda take: smooth_scenes(take, "links"),
    "laws": law_scenes,
    "friction": frictional_scenes,
    "walls, gravity, held": acted_scenes,
    "lattices": lattice_scenes,
}

# -- starting packings -------------------------------------------------------------------------------------------------


@case("generate/random")
def generate_random(take: Take) -> Answer:
    found: Answer = {}
    for name, make in STARTS.items():
        if name not in SMOOTH["links"]:
            ask(found, name, lambda make: of_packing(make()), make)
    return found


@case("generate/clusters and chains", amplifies=True)
def generate_linked(take: Take) -> Answer:
    found: Answer = {}
    for name in SMOOTH["links"]:
        ask(found, name, lambda name: of_packing(STARTS[name]()), name)
    return found


@case("generate/lattices")
def generate_lattices(take: Take) -> Answer:
    return {name: of_packing(lattice(take, name)) for name in LATTICES}


# -- quench ------------------------------------------------------------------------------------------------------------

METHODS: dict[str, Any] = {
    "default": None,
    "fire": pm.Fire(),
    "fire2": pm.Fire2(),
    "conjugate gradient": pm.ConjugateGradient(),
    "lbfgs": pm.LBFGS(),
    "newton": pm.Newton(),
    "damped dynamics": pm.DampedDynamics(),
    "steepest descent": pm.SteepestDescent(),
    "gradient descent": pm.GradientDescent(),
}


@case("quench/methods", amplifies=True)
def quench_methods(take: Take) -> Answer:
    found: Answer = {}
    scene = pm.Scene(take("start: discs"), HARMONIC)
    for name, method in METHODS.items():
        ask(found, name, run_of, pm.quench, scene, force_tolerance=1e-8, method=method, step_limit=20000, check=False)
    return found


@case("quench/laws", amplifies=True)
def quench_laws(take: Take) -> Answer:
    found: Answer = {}
    for name, law in LAWS.items():
        for kind in ("discs", "spheres"):
            scene = pm.Scene(take(f"start: {kind}"), (pm.Repulsion(law),))
            ask(found, f"{name}, {kind}", run_of, pm.quench, scene, force_tolerance=1e-9, check=False)
    return found


def quench_family(take: Take, family: str) -> Answer:
    found: Answer = {}
    for name in SMOOTH[family]:
        scene = pm.Scene(take(f"start: {name}"), HARMONIC)
        ask(found, name, run_of, pm.quench, scene, force_tolerance=1e-9, check=False)
    return found


case("quench/sizes", amplifies=True, family="plain")(quench_family)
case("quench/shapes", amplifies=True, family="shapes")(quench_family)
case("quench/links", amplifies=True, family="links")(quench_family)


@case("quench/walls, gravity, held", amplifies=True)
def quench_acted(take: Take) -> Answer:
    found: Answer = {}
    for name in ("loose discs", "loose spheres", "ellipses", "rigid dimers"):
        one = take(f"start: {name}")
        ask(found, f"pile of {name}", run_of, pm.quench, pm.Scene(one, pile_effects(one)), force_tolerance=1e-9)
        ask(found, f"held {name}", run_of, pm.quench, pm.Scene(one, held_effects()), force_tolerance=1e-9)
    return found


@case("quench/refusals")
def quench_refusals(take: Take) -> Answer:
    found: Answer = {}
    for name, scene in {
        "bonds": bonded(take, friction=False),
        "friction": pm.Scene(take("start: discs"), ROUGH),
        "linked, held": pm.Scene(take("start: dimers"), held_effects()),
    }.items():
        ask(found, name, run_of, pm.quench, scene, force_tolerance=1e-9)
    one = take("start: loose discs")
    walled = pm.Scene(one, (*ROUGH, *pile_effects(one)[1:]))
    ask(found, "too few steps", run_of, pm.quench, pm.Scene(one, HARMONIC), force_tolerance=1e-12, step_limit=1)
    ask(found, "walls, jam", run_of, pm.jam, pm.Scene(one, pile_effects(one)), pressure=1e-3)
    ask(found, "walls and friction, simulate", moved, walled)
    ask(found, "friction, hessian", matrix_of, pm.hessian, pm.Scene(one, ROUGH))
    ask(found, "bonds, moduli", moduli_of, bonded(take, friction=False))
    ask(found, "friction, verdict", verdict_of, pm.Scene(take("jammed: rough discs"), ROUGH))
    return found


@case("quench/batch", amplifies=True)
def quench_batch(take: Take) -> Answer:
    found: Answer = {}
    rng = np.random.default_rng(0)
    change, shear = 0.02 + rng.uniform(-0.02, 0.02, (5, 3)), rng.uniform(-0.05, 0.05, (5, 3))

    def stepped(name: str, relax: str | int, threads: int) -> Answer:
        scene = pm.Scene(take(f"start: {name}"), HARMONIC)
        batch = pm.QuenchBatch(scene, batch=3, relax=relax, threads=threads)
        for k in range(len(change)):
            batch.step(change[k], shear[k])
        rows = {
            "packing fraction": batch.packing_fraction_b,
            "energy": batch.energy_b,
            "stress": batch.stress_bdd,
            "contacts": batch.contacts_b,
            "rattlers": batch.rattlers_b,
            "excess": batch.excess_contacts_b,
            "strain": batch.strain_b,
            "residual": batch.max_force_b,
            "relaxed": batch.relaxed_b,
            "work": {"steps": batch.steps_b},
        }
        ends = {f"{b}": of_packing(batch.packing(b)) | {"outcome": batch.outcome(b)} for b in range(3)}
        return {"rows": rows, "packings": ends}

    for name in ("discs", "spheres", "trimers", "ellipses", "rigid dimers"):
        ask(found, f"{name}, full", stepped, name, "full", 1)
        ask(found, f"{name}, 15 steps, 2 threads", stepped, name, 15, 2)
    return found


# -- jamming -----------------------------------------------------------------------------------------------------------


@case("jam/discs, strains", amplifies=True, name="discs")
@case("jam/spheres, strains", amplifies=True, name="spheres")
@case("jam/ellipses, strains", amplifies=True, name="ellipses")
@case("jam/trimers, strains", amplifies=True, name="trimers")
def jam_strains(take: Take, name: str) -> Answer:
    found: Answer = {}
    scene = pm.Scene(take(f"start: {name}"), HARMONIC)
    for strain in ("none", "isotropic", "isochoric", "free"):
        ask(found, strain, run_of, pm.jam, scene, pressure=1e-5, strain=strain)
    return found


@case("jam/methods", amplifies=True)
def jam_methods(take: Take) -> Answer:
    found: Answer = {}
    scene = pm.Scene(take("start: discs"), HARMONIC)
    for method in (pm.HardVertex(), pm.Decompression(), pm.ProgramChain()):
        for strain in ("isotropic", "free"):
            name = f"{type(method).__name__}, {strain}"
            ask(found, name, run_of, pm.jam, scene, pressure=1e-6, strain=strain, method=method)
    halving = pm.StepHalving(energy_tolerance=1e-14)
    ask(found, "StepHalving", run_of, pm.jam, scene, strain="isotropic", method=halving)
    quick = pm.Press(rate=1e-3, force_tolerance=1e-6)
    ask(found, "Press", run_of, pm.jam, scene, pressure=1e-3, strain="isotropic", method=quick)
    return found


def jam_family(take: Take, family: str) -> Answer:
    found: Answer = {}
    for name in SMOOTH[family]:
        scene = pm.Scene(take(f"start: {name}"), HARMONIC)
        ask(found, name, run_of, pm.jam, scene, pressure=1e-3, strain="isotropic")
    return found


case("jam/sizes", amplifies=True, family="plain")(jam_family)
case("jam/shapes", amplifies=True, family="shapes")(jam_family)
case("jam/links", amplifies=True, family="links")(jam_family)


@case("jam/laws", amplifies=True)
def jam_laws(take: Take) -> Answer:
    found: Answer = {}
    for name, law in LAWS.items():
        scene = pm.Scene(take("start: discs"), (pm.Repulsion(law),))
        ask(found, name, run_of, pm.jam, scene, pressure=1e-4, strain="isotropic")
    return found


@case("jam/friction", amplifies=True)
def jam_friction(take: Take) -> Answer:
    found: Answer = {}
    quick = pm.Press(rate=1e-3, force_tolerance=1e-6)
    for name, (begin, effects) in FRICTIONAL.items():
        scene = pm.Scene(take(f"start: {begin}"), effects)
        ask(found, name, run_of, pm.jam, scene, pressure=1e-3, strain="isotropic", method=quick)
    return found


@case("jam/followed in pressure")
def jam_followed(take: Take) -> Answer:
    found: Answer = {}
    for name in ("discs", "spheres", "ellipses", "rigid dimers", "trimers"):
        scene = pm.Scene(take(f"jammed: {name}"), HARMONIC)
        ask(found, name, run_of, pm.jam, scene, pressure=1.2e-3, strain="free")
    return found


@case("protocol/shear_stabilize")
def shear_stabilize(take: Take) -> Answer:
    found: Answer = {}
    for name, scene in {
        "discs": scene_at_rest(take),
        "spheres": scene_at_rest(take, 3),
        "ellipses": pm.Scene(take("jammed: ellipses"), HARMONIC),
        "trimers": pm.Scene(take("jammed: trimers"), HARMONIC),
        "rigid dimers": pm.Scene(take("jammed: rigid dimers"), HARMONIC),
    }.items():
        ask(found, f"{name}, volume", run_of, pm.shear_stabilize, scene, force_tolerance=1e-9)
        ask(found, f"{name}, pressure", run_of, pm.shear_stabilize, scene, pressure=2e-3, force_tolerance=1e-9)
    return found


@case("protocol/compress", amplifies=True)
def compress(take: Take) -> Answer:
    found: Answer = {}
    for name in ("discs", "spheres", "trimers", "ellipses", "rigid dimers"):
        scene, distances = pm.Scene(take(f"hard: {name}"), HARMONIC), [1e-6, 1e-4, 1e-3]
        for strain in ("isotropic", "free"):
            ask(found, f"{name}, {strain}", run_of, pm.compress, scene, distances, strain=strain, force_tolerance=1e-7)
    return found


@case("protocol/sweep_pressure", amplifies=True)
def sweep_pressure(take: Take) -> Answer:
    found: Answer = {}
    for name in ("discs", "spheres", "trimers", "ellipses", "rigid dimers"):
        scene = pm.Scene(take(f"jammed: {name}"), HARMONIC)
        for strain in ("isotropic", "free"):
            ask(found, f"{name}, {strain}", run_of, pm.sweep_pressure, scene, [5e-4, 2e-3, 1e-3], strain=strain)
    return found


@case("protocol/sweep_stress", amplifies=True)
def sweep_stress(take: Take) -> Answer:
    found: Answer = {}
    turned = np.array([[0.0, 1.0], [1.0, 0.0]])
    stresses = [-1e-3 * (np.eye(2) + share * turned) for share in (0.0, 0.02, -0.02)]
    for name in ("discs", "ellipses", "trimers"):
        scene = pm.Scene(take(f"jammed: {name}"), HARMONIC)
        ask(found, name, run_of, pm.sweep_stress, scene, stresses)
    return found


@case("protocol/shear_families")
def shear_families(take: Take) -> Answer:
    found: Answer = {}

    def followed(name: str) -> Answer:
        families = pm.shear_families(take(f"hard: {name}"), 2e-3, step=5e-4)
        return {
            "outcome": families.outcome,
            "strain": families.strain_t,
            "packing fraction": families.packing_fraction_t,
            "stress ratio": families.stress_ratio_t,
            "family": families.family_t,
            "contacts": families.contacts_t,
            "rattlers": families.rattlers_t,
            "gap_error": families.gap_error_t,
            "imbalance": families.imbalance_t,
            "changes": [one.strain for one in families.changes],
            "causes": ", ".join(f"{one.cause}, {one.route}" for one in families.changes),
        }

    for name in ("discs", "spheres", "ellipses"):
        ask(found, name, followed, name)
    return found


@case("protocol/quasistatic_shear", amplifies=True)
def quasistatic_shear(take: Take) -> Answer:
    found: Answer = {}

    def followed(name: str, pressure: float | None) -> Answer:
        scene = pm.Scene(take(f"jammed: {name}"), HARMONIC)
        sheared = pm.quasistatic_shear(scene, 3e-3, step=1e-3, pressure=pressure)
        first, step = sheared.first_change, sheared.strain_t / 1e-3
        # rows at changes of contacts are on one or the other side of them
        kept_t = np.abs(step - np.round(step)) < 1e-6
        return {
            "outcome": sheared.outcome,
            "strain": sheared.strain_t[kept_t],
            "shear stress": sheared.shear_stress_t[kept_t],
            "pressure": sheared.pressure_t[kept_t],
            "packing fraction": sheared.packing_fraction_t[kept_t],
            "energy": sheared.energy_t[kept_t],
            "modulus": sheared.modulus_t[kept_t],
            "contacts": sheared.contacts_t[kept_t],
            "networks": len(np.unique(sheared.network_t)),
            "residual": sheared.residual_t,
            "first change": [] if first is None else [first.strain, first.strain_from_above],
            "first pair": [] if first is None else list(first.pair),
            "avalanches": len(sheared.avalanches),
        }

    for name in ("discs", "spheres", "ellipses", "rigid trimers"):
        ask(found, f"{name}, volume", followed, name, None)
        ask(found, f"{name}, pressure", followed, name, 1e-3)
    return found


@case("protocol/cement")
def cement(take: Take) -> Answer:
    found: Answer = {}

    def cemented(name: str, freeze: str, kind: str) -> Answer:
        done = pm.cement(pm.Scene(take(f"jammed: {name}"), HARMONIC), seed=2, step=0.1, freeze=freeze, kind=kind)
        return {
            "compliance": done.compliance_kee,
            "contact": done.contact_l,
            "cemented": done.cemented_k,
            "stiff": done.stiff_k,
            "first stiff": str(done.first_stiff),
            "all stiff": str(done.all_stiff),
            "links": len(done.links),
            "self stress": done.self_stress,
        }

    for name in ("discs", "spheres", "trimers"):
        for freeze in ("angles", "clusters", "nothing"):
            ask(found, f"{name}, {freeze}", cemented, name, freeze, "unstressed")
        ask(found, f"{name}, exact", cemented, name, "angles", "exact")
    return found


@case("protocol/cyclic_shear, tap", amplifies=True)
def cycled(take: Take) -> Answer:
    found: Answer = {}
    scene = pm.Scene(take("jammed: discs"), HARMONIC)
    ask(found, "cycles", run_of, pm.cyclic_shear, scene, 2e-3, 1, pressure=1e-3)
    ask(found, "taps", run_of, pm.tap, scene, 0.2, 1, seed=1, pressure=1e-3)
    return found


@case("protocol/settle", amplifies=True)
def settle(take: Take) -> Answer:
    found: Answer = {}
    one = take("pile: discs")
    lowest = np.argsort(one.position_nd[:, 1])[:6]
    floor = pm.FixedParticles(tuple(int(n) for n in lowest))
    scene = pm.Scene(one, (*ROUGH, pm.Gravity(0.0, -1e-3), floor))
    ask(found, "rough discs", run_of, pm.settle, scene, force_tolerance=1e-6, step_limit=100000, check=False)
    return found


# -- motion ------------------------------------------------------------------------------------------------------------


def moving(take: Take) -> dict[str, tuple[pm.Scene, Answer]]:
    """Return scenes that move, and how they start."""
    rough = {d: scene_at_rest(take, d, "linear spring", *ROUGH[1:]) for d in (2, 3)}
    loose = {name: take(f"start: {name}") for name in ("loose discs", "loose spheres", "ellipses", "rigid trimers")}
    ends = {
        "discs": (scene_at_rest(take), {"temperature": 1e-3, "seed": 1}),
        "spheres": (scene_at_rest(take, 3), {"temperature": 1e-3, "seed": 1}),
        "discs, Euler": (
            scene_at_rest(take),
            {"temperature": 1e-3, "seed": 1, "method": pm.SemiImplicitEuler(), "dt": 0.05},
        ),
        "hertz": (scene_at_rest(take, 2, "hertz"), {"temperature": 1e-4, "seed": 1}),
        "dashpots": (
            scene_at_rest(take, 2, "harmonic", pm.ContactDamping(0.3)),
            generic(take("at rest: harmonic discs"), turns=False),
        ),
        "drag": (
            scene_at_rest(take, 2, "harmonic", pm.BackgroundDamping(0.1)),
            generic(take("at rest: harmonic discs"), turns=False),
        ),
    }
    for d, scene in rough.items():
        ends[f"friction, {d}D"] = (scene, generic(scene.packing))
        ends[f"friction, strained, {d}D"] = (scene, {"applied_strain": pm.SteadyStrain(0.02)})
        ends[f"bonds, {d}D"] = (bonded(take, d), generic(scene.packing))
    ends["bonds without friction"] = (bonded(take, friction=False), generic(take("at rest: linear spring discs")))
    ends["oscillating box"] = (rough[2], {"applied_strain": pm.OscillatoryStrain(0.02, 0.1)})
    for name, one in loose.items():
        ends[f"gravity and walls, {name}"] = (pm.Scene(one, (*pile_effects(one), pm.ContactDamping(0.3))), {})
    for name in ("trimers", "trimers in space", "chains", "dimers"):
        one = take(f"start: {name}")
        ends[f"linked {name}"] = (pm.Scene(one, HARMONIC), {"temperature": 0.05, "seed": 2})
        ends[f"linked {name}, dashpots"] = (pm.Scene(one, DAMPED), {"temperature": 0.05, "seed": 2})
    for name in SMOOTH["shapes"]:
        one = take(f"jammed: {name}")
        ends[name] = (pm.Scene(one, HARMONIC), generic(one))
        ends[f"{name}, friction"] = (pm.Scene(one, ROUGH), generic(one))
    one = take("held: discs")
    moved_floor = pm.FixedParticles((0, 5, 11), velocity=(0.01, 0.0))
    ends["held that move"] = (pm.Scene(one, (*DAMPED, moved_floor)), {})
    return ends


@case("simulate/discs, spheres, laws", names=("discs", "spheres", "discs, Euler", "hertz", "dashpots", "drag"))
@case("simulate/friction", names=("friction*", "oscillating box"))
@case("simulate/bonds", names=("bonds*",))
@case("simulate/gravity, walls, held", names=("gravity*", "held*"))
@case("simulate/links", names=("linked*",))
@case("simulate/shapes", names=("ellipses*", "spheroids*", "rigid*"))
def simulate_short(take: Take, names: tuple[str, ...]) -> Answer:
    found: Answer = {}
    for name, (scene, begin) in matching(moving(take), names).items():
        ask(found, name, moved, scene, **begin)
    return found


@case(
    "simulate/long, discs and spheres",
    amplifies=True,
    names=("discs", "spheres", "friction, 2D", "friction, 3D", "bonds, 2D", "gravity and walls, loose discs"),
)
@case(
    "simulate/long, links and shapes",
    amplifies=True,
    names=("linked trimers", "linked chains", "ellipses, friction", "rigid trimers", "spheroids"),
)
def simulate_long(take: Take, names: tuple[str, ...]) -> Answer:
    found: Answer = {}
    for name, (scene, begin) in matching(moving(take), names).items():
        ask(found, name, averaged, scene, **begin)
    return found


def matching(scenes: dict[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    """Return those with one of these names, where a star stands for any end."""
    return {
        name: one
        for name, one in scenes.items()
        if any(name.startswith(word[:-1]) if word.endswith("*") else name == word for word in names)
    }


@case("simulate/threads")
def simulate_threads(take: Take) -> Answer:
    found: Answer = {}

    def both(scene: pm.Scene, begin: Mapping[str, Any]) -> Answer:
        one, two = (pm.simulate(scene, steps=SHORT, threads=threads, **begin) for threads in (1, 2))
        same = np.array_equal(one.packing.position_nd, two.packing.position_nd)
        return {"same bits on two threads": same, "one thread": of_run(one)}

    for name, (scene, begin) in matching(moving(take), ("friction, 2D", "friction, 3D", "bonds, 2D", "discs")).items():
        ask(found, name, both, scene, begin)
    begin_many = of_fraction(0.95, 2, 600, sizes=pm.Bidisperse(1.4))
    ask(found, "600 rough discs", both, pm.Scene(begin_many, ROUGH), {"dt": 0.05})
    return found


@case("simulate/checkpoints")
def simulate_checkpoints(take: Take) -> Answer:
    found: Answer = {}

    def cut(scene: pm.Scene, begin: Mapping[str, Any]) -> Answer:
        whole = pm.simulate(scene, steps=SHORT, **begin)
        same = {}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.npz"
            for step in (1, 33):
                pm.simulate(scene, steps=step, checkpoint=path, **begin)
                resumed = pm.resume(path, scene, steps=SHORT, threads=1 if step == 1 else 2)
                equal = np.array_equal(resumed.packing.position_nd, whole.packing.position_nd)
                same[f"same bits, cut at {step}"] = equal and np.array_equal(resumed.velocity_nd, whole.velocity_nd)
        return {**same, "whole": of_run(whole)}

    names = ("friction, 2D", "bonds, 3D", "discs", "linked trimers", "ellipses, friction", "rigid trimers", "spheroids")
    for name, (scene, begin) in matching(moving(take), names).items():
        ask(found, name, cut, scene, begin)
    return found


# -- rheology ----------------------------------------------------------------------------------------------------------


def rheological(take: Take) -> dict[str, pm.Scene]:
    """Return scenes to shear."""
    return {
        "friction": scene_at_rest(take, 2, "linear spring", *ROUGH[1:]),
        "bonds": bonded(take),
        "spheres": scene_at_rest(take, 3, "linear spring", *ROUGH[1:]),
        "ellipses": pm.Scene(take("jammed: ellipses"), DAMPED),
        "rigid dimers": pm.Scene(take("jammed: rigid dimers"), DAMPED),
        "trimers": pm.Scene(take("jammed: trimers"), DAMPED),
    }


@case("rheology/oscillatory shear", amplifies=True)
def oscillatory_shear(take: Take) -> Answer:
    found: Answer = {}

    def sheared(scene: pm.Scene, amplitude: float) -> Answer:
        run = pm.oscillatory_shear(
            scene, amplitude=amplitude, frequency=0.02, periods=2.0, samples_per_period=50, check=False
        )
        moduli = run.moduli
        return strained(run) | {"storage": moduli.storage, "loss": moduli.loss, "harmonic residual": moduli.residual}

    for name, scene in rheological(take).items():
        ask(found, name, sheared, scene, 1e-3)
    ask(found, "friction, far", sheared, rheological(take)["friction"], 0.1)
    return found


@case("rheology/complex modulus")
def complex_modulus(take: Take) -> Answer:
    found: Answer = {}

    def responded(scene: pm.Scene, mode: str) -> Answer:
        one = pm.complex_modulus(scene, [1e-3, 0.03, 0.5], mode=mode)
        return {
            "storage": one.storage_f,
            "loss": one.loss_f,
            "stress": one.stress_fdd,
            "residual": one.residual,
            "rest residual": one.rest,
        }

    for name, scene in rheological(take).items():
        for mode in ("shear", "isotropic"):
            ask(found, f"{name}, {mode}", responded, scene, mode)
    # tangential springs are stretched at rest
    ask(found, "pressed with friction", responded, frictional_scenes(take)["rough discs"], "shear")
    return found


@case("rheology/ramp and creep", amplifies=True)
def ramp_and_creep(take: Take) -> Answer:
    found: Answer = {}
    for name, scene in rheological(take).items():
        ramp = {"rate": 0.01, "applied_strain": 0.05, "samples": 40}
        creep = {"stress": 1e-4, "duration": 20.0, "hold": 12.0}
        ask(found, f"{name}, ramp", lambda scene, given: strained(pm.ramp_strain(scene, **given)), scene, ramp)
        ask(found, f"{name}, creep", lambda scene, given: strained(pm.creep(scene, **given)), scene, creep)
    return found


@case("rheology/steady shear", amplifies=True)
def steady_shear(take: Take) -> Answer:
    found: Answer = {}

    def flowing(scene: pm.Scene) -> Answer:
        curve = pm.steady_shear(scene, rates=[0.05, 0.2], applied_strain=2.0, skip_strain=0.5, samples=60, check=False)
        return {
            "stress": curve.stress_r,
            "pressure": curve.pressure_r,
            "mean contacts": curve.contacts_r,
            "mean sliding": curve.sliding_r,
        }

    for name, scene in rheological(take).items():
        ask(found, name, flowing, scene)
    return found


@case("rheology/checkpoints", amplifies=True)
def rheology_checkpoints(take: Take) -> Answer:
    found: Answer = {}
    calls: dict[str, tuple[Callable[..., Any], Answer]] = {
        "oscillatory": (pm.oscillatory_shear, {"amplitude": 0.05, "frequency": 2e-3, "samples_per_period": 20}),
        "ramp": (pm.ramp_strain, {"rate": 1e-4, "applied_strain": 0.05, "samples": 25}),
        "creep": (pm.creep, {"stress": 0.02, "duration": 500.0, "hold": 300.0}),
    }

    def cut(call: Callable[..., Any], given: Answer) -> Answer:
        scene = bonded(take)
        whole = call(scene, dt=0.1, **given)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.npz"
            first = call(scene, dt=0.1, checkpoint=path, time_limit=1e-9, check=False, **given)
            resumed = call(scene, dt=0.1, checkpoint=path, **given)
        same = np.array_equal(resumed.packing.position_nd, whole.packing.position_nd)
        return {"was cut": 0 < first.steps < whole.steps, "same bits": same, "mean contacts": whole.contacts_t.mean()}

    for name, (call, given) in calls.items():
        ask(found, name, cut, call, given)
    return found


@case("rheology/batch")
def shear_batch(take: Take) -> Answer:
    found: Answer = {}
    rate_kb = np.random.default_rng(0).uniform(-0.02, 0.02, (20, 2))

    def stepped(scene: pm.Scene, control: str, threads: int) -> Answer:
        batch = pm.ShearBatch([scene] * 2, control=control, steps=4, dt=0.05, threads=threads)
        strain_b, good = np.zeros(2), []
        for rate_b in rate_kb:
            strain_b = strain_b + 0.2 * rate_b
            told = {"rate": [rate_b], "strain": [strain_b], "strain_and_rate": [strain_b, rate_b]}[control]
            good.append(batch.advance(np.stack(told, axis=1)))
        ends = {"figures": batch.figure_bk.copy(), "names": ", ".join(batch.names), "good": np.array(good)}
        ends |= {"packing": of_packing(batch.packing(1)), "velocity": batch.velocities(1), "outcome": batch.outcome(1)}
        batch.close()
        return ends

    for name, scene in rheological(take).items():
        ask(found, f"{name}, rate", stepped, scene, "rate", 1)
        ask(found, f"{name}, rate, 2 threads", stepped, scene, "rate", 2)
        ask(found, f"{name}, strain", stepped, scene, "strain", 1)
    return found


# -- mechanics and measures --------------------------------------------------------------------------------------------


def moduli_case(take: Take, scenes: str) -> Answer:
    found: Answer = {}
    for name, scene in SCENES[scenes](take).items():
        for kind in ("exact", "unstressed"):
            if scenes == "friction":
                for at_limit in ("stick", "slip"):
                    ask(found, f"{name}, {kind}, {at_limit}", moduli_of, scene, kind=kind, contacts_at_limit=at_limit)
            else:
                ask(found, f"{name}, {kind}", moduli_of, scene, kind=kind)
    return found


def modes_case(take: Take, scenes: str) -> Answer:
    found: Answer = {}
    for name, scene in SCENES[scenes](take).items():
        for strain in ("none", "free"):
            ask(found, f"{name}, {strain}", modes_of, scene, strain=strain)
        ask(found, f"{name}, unstressed", modes_of, scene, kind="unstressed")
        ask(found, f"{name}, density", density_of, scene)
    return found


def density_of(scene: pm.Scene) -> Answer:
    """Return the density of states, in bins that rounding does not shift modes across."""
    density = pm.density_of_states(scene, bins=6)
    return {"edge": density.edge_b, "count": density.count_b, "modes": density.modes}


def hessian_case(take: Take, scenes: str) -> Answer:
    found: Answer = {}
    for name, scene in SCENES[scenes](take).items():
        for kind in ("exact", "unstressed", "paper") if scenes == "links" else ("exact", "unstressed"):
            for strain in ("none", "isotropic", "isochoric", "free"):
                ask(found, f"{name}, {kind}, {strain}", matrix_of, pm.hessian, scene, strain, kind)
        ask(found, f"{name}, dynamical", matrix_of, pm.dynamical_matrix, scene)
        ask(found, f"{name}, compliance", matrix_of, pm.compliance_matrix, scene)
        ask(found, f"{name}, compliance, dense", matrix_of, pm.compliance_matrix, scene, method="pseudoinverse")
    return found


def rigidity_case(take: Take, scenes: str) -> Answer:
    found: Answer = {}
    for name, scene in SCENES[scenes](take).items():
        one = scene.packing
        for strain in ("none", "isotropic", "isochoric", "free"):
            ask(found, f"{name}, {strain}, rigidity", matrix_of, pm.rigidity_matrix, one, strain)
            ask(found, f"{name}, {strain}, counts", counts_of, one, strain)
        ask(found, f"{name}, rattlers", rattlers_of, one)
    return found


def counts_of(one: pm.Packing, strain: str) -> Answer:
    """Return how many states of self stress and floppy modes there are."""
    stress, floppy = pm.states_of_self_stress(one, strain), pm.floppy_modes(one, strain)
    return {
        "states of self stress": stress.count,
        "contacts": stress.contacts,
        "rank": stress.rank,
        "motions": stress.motions,
        "trivial": stress.trivial,
        "certain": stress.certain,
        "floppy modes": floppy.count,
        "columns": floppy.columns,
        "residual": stress.residual,
    }


def rattlers_of(one: pm.Packing) -> Answer:
    """Return who rattles, the coordination and the contacts."""
    contacts = (pm.find_shape_contacts if has_shapes(one) else pm.find_contacts)(one)
    distance = contacts.distance_c
    found: Answer = {
        "rattlers": pm.find_rattlers(one),
        "coordination": pm.coordination_number(one),
        "i": contacts.i_c,
        "j": contacts.j_c,
        "image": contacts.image_cd,
        "distance": distance,
    }
    ask(found, "rattling clusters", lambda: pm.find_rattling_clusters(one).rattling_cluster_n)
    return found


def measures_case(take: Take, scenes: str) -> Answer:
    found: Answer = {}

    def measured(scene: pm.Scene) -> Answer:
        force_nd = pm.forces(scene)
        ends: Answer = {"energy": pm.energy(scene), "residual force": np.abs(force_nd).max()}
        ask(ends, "pressure", pm.pressure, scene)
        ask(ends, "stress", pm.stress_tensor, scene)
        for part in ("contacts", "links"):
            ask(ends, f"stress, {part}", pm.stress_tensor, scene, parts=part)
        ask(ends, "residual torque", lambda: np.abs(pm.torques(scene)).max())
        ask(ends, "tension", pm.link_tension, scene)
        # of a packing that is shaken, forces are no rounding; lengths of links must hold to 0.01
        one = scene.packing
        scale = 0.001 if one.links else 0.01
        shaken_nd = one.position_nd + scale * np.random.default_rng(3).standard_normal(one.position_nd.shape)
        shaken = scene.replace(packing=one.replace(position_nd=shaken_nd))
        for name, call in (("forces", pm.forces), ("torques", pm.torques), ("energy", pm.energy)):
            ask(ends, f"{name}, shaken", call, shaken)
        return ends

    for name, scene in SCENES[scenes](take).items():
        ask(found, name, measured, scene)
    return found


for _name in SCENES:
    case(f"moduli/{_name}", scenes=_name)(moduli_case)
    case(f"measures/{_name}", scenes=_name)(measures_case)
    if _name != "friction":
        case(f"modes/{_name}", scenes=_name)(modes_case)
        case(f"hessian/{_name}", scenes=_name)(hessian_case)
    if _name not in ("friction", "laws", "walls, gravity, held"):
        case(f"rigidity/{_name}", scenes=_name)(rigidity_case)


@case("frictional/stiffness and modes")
def frictional(take: Take) -> Answer:
    found: Answer = {}

    def lowest(scene: pm.Scene, at_limit: str) -> Answer:
        modes = pm.frictional_modes(scene, 12, contacts_at_limit=at_limit)
        zero_m = modes.zero_m
        value = np.where(zero_m, 0.0, modes.eigenvalue_m)
        return {
            "eigenvalue": value.real,
            "growth": np.where(zero_m, 0.0, modes.growth_m),
            "zero": int(zero_m.sum()),
            "available": modes.available,
            "symmetric": modes.symmetric,
            "residual": modes.residual,
            "force residual": modes.force_residual,
        }

    for name, scene in frictional_scenes(take).items():
        for at_limit in ("stick", "slip"):
            for strain in ("none", "free"):
                title = f"{name}, {at_limit}, {strain}, stiffness"
                ask(found, title, matrix_of, pm.stiffness_matrix, scene, strain, contacts_at_limit=at_limit)
            ask(found, f"{name}, {at_limit}, modes", lowest, scene, at_limit)
    for name, scene in smooth_scenes(take, "plain").items():
        ask(found, f"{name}, without friction", matrix_of, pm.stiffness_matrix, scene)
    return found


@case("frictional/contact forces")
def contact_forces(take: Take) -> Answer:
    found: Answer = {}

    def balanced(scene: pm.Scene) -> Answer:
        one = pm.contact_forces(scene)
        return {
            "pressure": one.pressure,
            "stress": one.stress_dd,
            "normal": one.normal_c,
            "tangential": one.tangential_cd,
            "at limit": one.at_limit_c,
            "bearing": one.bearing_c,
            "rattlers": one.rattlers_n,
            "spinning": one.spinning_n,
            "sliding fraction": one.sliding_fraction,
            "coordination": one.coordination_number,
            "isostatic coordination": one.isostatic_coordination,
            "residual": one.residual,
            "imbalance": one.largest_imbalance,
        }

    for name, scene in (frictional_scenes(take) | smooth_scenes(take, "plain", "shapes", "links")).items():
        ask(found, name, balanced, scene)
    return found


@case("shapes/quartic modes")
def quartic_modes(take: Take) -> Answer:
    found: Answer = {}

    def lowest(scene: pm.Scene, strain: str) -> Answer:
        modes = pm.quartic_modes(scene, strain=strain)
        return {
            "count": len(modes),
            "curvature": modes.curvature_m,
            "stretch": modes.stretch,
            "certain": modes.certain,
            "pressure": modes.pressure,
            "free turns": modes.free_turns,
        }

    for name in ("hard: ellipses", "jammed: ellipses", "jammed: spheroids", "jammed: rigid dimers", "hard: discs"):
        for strain in ("none", "free"):
            ask(found, f"{name}, {strain}", lowest, pm.Scene(take(name), HARMONIC), strain)
    return found


@case("links/jacobian and projection")
def link_jacobian(take: Take) -> Answer:
    found: Answer = {}
    rng = np.random.default_rng(8)

    def projected(one: pm.Packing, force_nd: NDArray[np.float64], strain: str, method: str) -> Answer:
        pull_e = np.ones(one.dimension * (one.dimension + 1) // 2)
        given = {} if strain == "none" else {"strain_force": pull_e, "strain": strain}
        done = pm.project_force(one, force_nd, method=method, **given)
        return {"force": done.force_nd, "strain force": done.strain_force_e, "multiplier": done.multiplier_l}

    def basis_rank(one: pm.Packing, strain: str) -> int:
        return pm.constraint_basis(one, strain).rank

    def reaffixed(one: pm.Packing) -> Answer:
        back = pm.reaffix_links(one).packing
        found = of_packing(back)
        ask(found, "tension", pm.link_tension, pm.Scene(back, HARMONIC))
        return found

    def independent(one: pm.Packing) -> Answer:
        links = pm.independent_links(one)
        return {"rank": links.rank, "removed": links.removed_l}

    for name in SMOOTH["links"]:
        one = take(f"jammed: {name}")
        force_nd = rng.standard_normal(one.position_nd.shape)
        shaken = one.replace(position_nd=one.position_nd + 0.02 * force_nd)
        for strain in ("none", "isochoric", "free"):
            title = f"{name}, {strain}"
            for form in ("exact", "paper"):
                ask(found, f"{title}, {form}, jacobian", matrix_of, pm.constraint_jacobian, one, strain, form=form)
            for method in ("clusters", "whole-matrix"):
                ask(found, f"{title}, {method}, projected", projected, one, force_nd, strain, method)
            ask(found, f"{title}, n matrix", matrix_of, pm.n_matrix, one, strain)
            ask(found, f"{title}, constrained", matrix_of, pm.constrained_rigidity_matrix, one, strain)
            ask(found, f"{title}, basis rank", basis_rank, one, strain)
        ask(found, f"{name}, reaffixed", reaffixed, shaken)
        ask(found, f"{name}, independent", independent, one)
        ask(found, f"{name}, tension", pm.link_tension, pm.Scene(one, HARMONIC))
        ask(found, f"{name}, tension, shaken", pm.link_tension, pm.Scene(shaken, HARMONIC))
    return found


@case("walls/contacts")
def wall_contacts(take: Take) -> Answer:
    found: Answer = {}

    def touched(scene: pm.Scene) -> Answer:
        one = pm.wall_contacts(scene)
        return {
            "particle": one.particle_w,
            "wall": one.wall_w,
            "normal": one.normal_wd,
            "force": one.force_w,
            "on walls": one.on_walls(),
        }

    for name, scene in acted_scenes(take).items():
        ask(found, name, touched, scene)
    return found


# -- verdicts ----------------------------------------------------------------------------------------------------------


@case("verdict/lattices, certificate", method="certificate")
@case("verdict/lattices, loads", method="loads")
def verdict_lattices(take: Take, method: str) -> Answer:
    found: Answer = {}
    for name in LATTICES:
        ask(found, name, verdict_of, take(f"lattice: {name}"), method=method)
    return found


@case("verdict/random packings, certificate", method="certificate")
@case("verdict/random packings, loads", method="loads")
def verdict_random(take: Take, method: str) -> Answer:
    found: Answer = {}
    for name in ("discs", "spheres", "trimers", "ellipses", "rigid dimers"):
        for strain in ("isochoric", "free"):
            ask(found, f"{name}, {strain}", verdict_of, take(f"hard: {name}"), method=method, strain=strain)
    ask(found, "pressed", verdict_of, take("jammed: discs"), method=method)
    ask(found, "loose", verdict_of, take("start: loose discs"), method=method)
    return found


@case("verdict/links")
def verdict_links(take: Take) -> Answer:
    found: Answer = {}
    for name in SMOOTH["links"]:
        ask(found, name, verdict_of, pm.Scene(take(f"jammed: {name}"), HARMONIC))
    return found
