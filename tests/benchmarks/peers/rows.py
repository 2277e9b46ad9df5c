"""What is compared: packmech's work and each peer's, from the same start, row by row."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import bench_fire
import bench_march
import bench_structure
import bench_verdict
import hand_fire
import hand_march
import lammps_runs
import literal_program
import numpy as np
from comparison import Pair, Row, cpu_of, timed
from other_python import OtherPython

import packmech as pm
from packmech.dynamics.deformation import Sine
from packmech.dynamics.engine import build_engine
from packmech.minimize.passes.kernels import Goal
from packmech.minimize.program import space_order

# with these LAMMPS is fastest on the machines seen; larger steps make its FIRE ten times slower
FIRE_STEP, FIRE_SKIN = 0.05, 0.2
SHEAR_SKIN = 0.3
# the loops written by hand are fastest with this
HAND_SKIN = 0.2
LARGEST_FORCE = 1e-12
FRICTIONAL = (bench_march.SPRING, bench_march.DASHPOT, bench_march.FRICTION)


# -- minimizing -------------------------------------------------------------------------------------------------------


def fire_step(seed: int, *, particles: int, steps: int = 400) -> Pair:
    """Return FIRE's steps near a minimum in packmech and LAMMPS, list keeping included, setting up left out."""
    program = bench_fire.relaxed_program(particles, seed=seed)
    start, packing, method = program.positions(), program.packing(), pm.Fire()

    def ours() -> float:
        program.place(start)
        progress = method.start(program)
        return cpu_of(lambda: method.advance(program, Goal(1e-300, 0.0), progress, steps))

    def theirs() -> float:
        # what preparing costs is in both
        few, many = (
            lammps_runs.measure_fire(packing, FIRE_STEP, FIRE_SKIN, steps=count)[0] for count in (20, steps + 20)
        )
        return float(many - few)

    return Pair(ours, theirs, lambda: "the same start and number of steps", steps)


def fire_step_by_hand(seed: int, *, particles: int) -> Pair:
    """Return the bare loops of FIRE: effects chosen by type, and one written by hand."""
    program = bench_fire.relaxed_program(particles, seed=seed)
    program.evaluate()
    program.force_nd[:] = program.velocity_nd[:] = 0.0
    steps = max(20, 2_000_000 // particles)
    typed, hand = bench_fire.loop_arguments(program, steps), hand_fire.arguments(program, steps)
    ours, theirs = timed(lambda: bench_fire.typed_loop(*typed)), timed(lambda: hand_fire.fire_steps(*hand))
    return Pair(ours, theirs, lambda: "the same start and number of steps, no lists made", steps)


def quench(seed: int, *, particles: int) -> Pair:
    """Return whole quenches from random places until no net force is above 1e-12 energy scale / diameter."""
    packing = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.88, seed=seed
    )
    order = space_order(packing)
    packing = packing.replace(position_nd=packing.position_nd[order], radius_n=packing.radius_n[order])
    scene = pm.Scene(packing, (pm.Repulsion(),))
    # the tolerance is relative to the mean contact force, which is the same in all minima to some per cent
    rest = scene.replace(packing=pm.quench(scene, force_tolerance=1e-6).packing)
    tolerance = LARGEST_FORCE / pm.contact_forces(rest).mean_force
    found: dict[str, int] = {}

    def ours() -> float:
        began = time.process_time()
        run = pm.quench(scene, force_tolerance=tolerance)
        took = time.process_time() - began
        found["ours"] = run.force_evaluations
        return took

    def theirs() -> float:
        took, steps, force = lammps_runs.measure_fire(packing, FIRE_STEP, FIRE_SKIN, largest_force=LARGEST_FORCE)
        if not force <= LARGEST_FORCE:
            raise FloatingPointError(f"LAMMPS stopped at a largest force of {force:g}")
        found["theirs"] = steps
        return float(took)

    return Pair(ours, theirs, lambda: f"{found['ours']} and {found['theirs']} steps, each to a minimum of its own")


# -- stepping through time --------------------------------------------------------------------------------------------


@functools.lru_cache(1)
def sheared(particles: int, seed: int) -> Any:
    """Return the start of bench_march.py."""
    return bench_march.make_start(particles, seed)


def stepped(start: Any, steps: int) -> Callable[[], float]:
    """Return the call that steps packmech's engine from a start."""

    def ours() -> float:
        engine = bench_march.ours(start, FRICTIONAL)
        engine.advance(3)
        return cpu_of(lambda: engine.advance(steps))

    return ours


def shear_lammps(seed: int, *, particles: int) -> Pair:
    """Return steps of sheared frictional discs in packmech and in LAMMPS (gran/hooke/history)."""
    start, steps = sheared(particles, seed), bench_march.STEPS[particles]
    contacts = [0.0]

    def theirs() -> float:
        took, contacts[0] = lammps_runs.measure_shear(
            start, bench_march.LAW, bench_march.RATE, bench_march.DT, steps, SHEAR_SKIN
        )
        return float(took)

    def agreement() -> str:
        engine = bench_march.ours(start, FRICTIONAL)
        engine.advance(steps + 10)
        return f"{engine.observe()[bench_march.CONTACTS]:.0f} and {contacts[0]:.0f} contacts at the end"

    return Pair(stepped(start, steps), theirs, agreement, steps)


def shear_by_hand(seed: int, *, particles: int) -> Pair:
    """Return steps of sheared frictional discs in packmech and in a loop written by hand for them."""
    start, steps = sheared(particles, seed), bench_march.STEPS[particles]

    def by_hand() -> hand_march.HandMarch:
        return hand_march.HandMarch(
            start, bench_march.LAW, hand_march.friction_pass, bench_march.RATE, bench_march.DT, HAND_SKIN
        )

    def theirs() -> float:
        hand = by_hand()
        hand.advance(3)
        return cpu_of(lambda: hand.advance(steps))

    def agreement() -> str:
        engine, hand = bench_march.ours(start, FRICTIONAL), by_hand()
        engine.advance(20)
        hand.advance(20)
        return f"positions {float(np.abs(engine.positions() - hand.row[:, :2]).max()):.0e} apart after 20 steps"

    return Pair(stepped(start, steps), theirs, agreement, steps)


@functools.lru_cache(1)
def frictional_discs(seed: int, particles: int) -> tuple[Any, Any, Any]:
    """Return an experiment of the reference package, its discs without contacts yet, and rates of a period of shear."""
    ps = pm.particle_shear
    experiment = ps.ParticleShear(particles=particles, pre_periods=0.0)
    made = ps.prepared_discs(experiment, seed=seed)
    start = ps.ShearedDiscs(made.position_nd, made.radius_n, made.mass_n, width=made.width, height=made.height)
    return experiment, start, experiment.strain_rate(np.arange(2240) * experiment.time_step)


def particle_shear(seed: int, *, other: OtherPython, particles: int, native: bool) -> Pair:
    """Return steps of the reference package and packmech's: its own steps again, or the native engine's."""
    experiment, start, rate_t = frictional_discs(seed, particles)
    made, rules, steps = experiment.material, experiment.rules, 10
    call, first = other.prepared(
        "particle_shear",
        {
            "position_nd": start.position_nd,
            "radius_n": start.radius_n,
            "mass_n": start.mass_n,
            "rate_t": rate_t,
            "side": start.width,
        },
        steps=steps,
        k=made.stiffness,
        nu=made.viscosity,
        k_t=made.tangential_stiffness,
        nu_t=made.tangential_viscosity,
        mu=made.friction_coefficient,
        divergence=made.divergence,
        dt=rules.time_step,
        cooling=rules.cooling,
    )
    theirs, many = (lambda: call() / steps), len(rate_t)
    if not native:
        end = pm.particle_shear.advance(start, made, rules, rate_t[:steps]).final.position_nd
        apart = np.abs(end - np.array(first["position_nd"])).max() / start.radius_n.mean()
        advance = functools.partial(pm.particle_shear.advance, start, made, rules, rate_t)
        note = f"positions {apart:.0e} radii apart after {steps} steps"
        return Pair(lambda: cpu_of(advance) / many, theirs, lambda: note)
    scene = pm.particle_shear.to_scene(experiment, start, plates=False)

    def ours() -> float:
        engine = build_engine(
            scene.replace(drive=None),
            dt=rules.time_step,
            velocity_nd=np.zeros_like(start.position_nd),
            spin_nk=np.zeros((particles, 1)),
            profile=Sine(experiment.amplitude, 2.0 * math.pi * experiment.frequency, 0.0, math.inf),
            direction_dd=bench_march.SHEAR,
        )
        engine.advance(3)
        return cpu_of(lambda: engine.advance(many)) / many

    return Pair(
        ours, theirs, lambda: "the same model without its faults; stresses, which it cannot leave out, in theirs only"
    )


# -- mechanics --------------------------------------------------------------------------------------------------------


@functools.lru_cache(2)
def jammed(seed: int, particles: int) -> pm.Scene:
    """Return a packing at a pressure of 1e-6 in a square box."""
    packing = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=seed)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-6, strain="isotropic").packing)


def moduli_jax(seed: int, *, other: OtherPython, particles: int) -> Pair:
    """Return all elastic moduli by packmech and by jax-md's `athermal_moduli`."""
    scene = jammed(seed, particles)
    packing = scene.packing
    call, first = other.prepared(
        "jax_md",
        {"position_nd": packing.position_nd, "radius_n": packing.radius_n, "lattice_dd": packing.box.lattice_dd},
    )
    tensor, found = np.array(first["tensor"]), pm.elastic_moduli(scene).energy
    # jax-md's strains are symmetric tensors, packmech's the components xx, yy and xy
    own = np.array([tensor[0, 0, 0, 0], tensor[1, 1, 1, 1], tensor[0, 0, 1, 1]])
    apart = float(np.abs(own - [found[0, 0], found[1, 1], found[0, 1]]).max() / found[0, 0])
    note = "" if first["converged"] else ", not converged"
    return Pair(timed(lambda: pm.elastic_moduli(scene)), call, lambda: f"{apart:.0e} apart, of the largest{note}")


def moduli_rigidpy(seed: int, *, other: OtherPython, particles: int) -> Pair:
    """Return all elastic moduli by packmech, and the bulk modulus of the same springs by rigidpy."""
    scene = jammed(seed, particles)
    packing = scene.packing
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    place, _ = packing.box.wrap(packing.position_nd)
    call, first = other.prepared(
        "rigidpy",
        {
            "position_nd": place,
            "lattice_dd": packing.box.lattice_dd,
            "bond_ck": np.stack([contacts.i_c, contacts.j_c], axis=1),
            "stiffness_c": contacts.contact_distance_c**-2.0,
        },
    )
    apart = abs(first["bulk_modulus"] / pm.elastic_moduli(scene).bulk_modulus - 1.0)
    note = f"bulk moduli {apart:.0e} apart, theirs without prestress"
    return Pair(timed(lambda: pm.elastic_moduli(scene)), call, lambda: note)


@functools.lru_cache(1)
def linked_discs(seed: int, particles: int) -> tuple[pm.Packing, float]:
    """Return jammed discs half of which are linked in pairs, and the CPU seconds of the literal program."""
    discs = bench_verdict.soft_packing(particles, 2, "free", seed)
    packing = literal_program.with_matching(discs, 0.5, seed)
    return packing, literal_program.literal(packing, None)[0]


def verdict(seed: int, *, particles: int, method: str) -> Pair:
    """Return packmech's verdict, both questions, and the literal program's answer to one, which is timed once."""
    packing, literal = linked_discs(seed, particles)

    def agreement() -> str:
        return f"packmech, both questions: {pm.classify_jamming(packing, method=method).strict}"

    return Pair(timed(lambda: pm.classify_jamming(packing, method=method)), lambda: literal, agreement)


# -- structure --------------------------------------------------------------------------------------------------------


def freud_system(packing: pm.Packing, *, thin: bool = False) -> tuple[Any, Any]:
    """Return freud's box and positions; discs in a thin box of three dimensions where freud knows no other."""
    import freud

    freud.parallel.set_num_threads(1)
    lattice, d = packing.box.lattice_dd, packing.dimension
    place = np.zeros((packing.particles, 3))
    place[:, :d] = packing.position_nd
    depth = {"Lz": lattice[2, 2]} if d == 3 else {"Lz": 0.5} if thin else {"is2D": True}
    box = freud.box.Box(Lx=lattice[0, 0], Ly=lattice[1, 1], xy=lattice[0, 1] / lattice[1, 1], **depth)
    return box, box.wrap(place).astype(np.float32)


def pair_distribution(seed: int, *, particles: int, dimension: int) -> Pair:
    """Return g(r) up to three diameters in 60 bins by packmech and freud."""
    import freud

    packing = bench_structure.scattered(particles, dimension, seed)
    system, found = freud_system(packing), freud.density.RDF(bins=60, r_max=3.0)

    def agreement() -> str:
        apart = float(np.abs(pm.pair_distribution(packing, 3.0, 60).g_b - found.rdf).max())
        return f"{apart:.0e} apart; theirs in single precision"

    return Pair(timed(lambda: pm.pair_distribution(packing, 3.0, 60)), timed(lambda: found.compute(system)), agreement)


def structure_factor(seed: int, *, particles: int, dimension: int, k_max: float = 4.0) -> Pair:
    """Return S(k) averaged over directions by packmech and freud.

    The wave vectors are freud's: in a box with right angles, those without a negative component.
    """
    import freud

    tilted = bench_structure.scattered(particles, dimension, seed)
    side = float(tilted.box.lattice_dd[0, 0])
    packing = tilted.replace(position_nd=tilted.position_nd % side, box=pm.Box.cubic(side, dimension))
    system = freud_system(packing, thin=True)
    theirs = freud.diffraction.StaticStructureFactorDirect(bins=50, k_max=k_max)
    edge_b = np.linspace(0.0, k_max, 51)

    def shells() -> tuple[Any, Any]:
        index = pm.wave_indices(packing.box, k_max)
        index = index[(index >= 0).all(axis=1)]
        length = np.linalg.norm(pm.wave_vectors(packing.box, index), axis=1)
        count = np.histogram(length, edge_b)[0]
        return np.histogram(length, edge_b, weights=pm.structure_factor(packing, index))[0], count

    def agreement() -> str:
        total, count = shells()
        # the first shells hold few vectors, and theirs the vector zero
        used = (count > 5) & (np.arange(50) > 4)
        apart = float(np.median(np.abs(total[used] / count[used] / theirs.S_k[used] - 1.0)))
        return f"{int(count.sum())} wave vectors, {apart:.0e} apart (median of shells)"

    return Pair(timed(shells), timed(lambda: theirs.compute(system)), agreement)


# -- all of them ------------------------------------------------------------------------------------------------------


def all_rows(other: OtherPython, there: Callable[[str], bool]) -> Iterator[Row]:
    """Yield the rows of the peers that are there."""

    def row(
        work: str, peer: str, needs: str, make: Callable[..., Pair], wanted: float | None = None, **given: Any
    ) -> Row:
        turns = given.pop("turns", 4)
        return Row(work, peer, needs, functools.partial(make, **given), wanted, turns)

    listed = [
        row("FIRE step, N = 4096", "LAMMPS, fire", "lammps", fire_step, 2.3, particles=4096),
        row("bare FIRE loop, N = 4096", "by hand", "", fire_step_by_hand, particles=4096),
        row("quench to 1e-12, N = 1024", "LAMMPS, fire", "lammps", quench, 3.0, particles=1024, turns=2),
        row("quench to 1e-12, N = 4096", "LAMMPS, fire", "lammps", quench, 3.0, particles=4096, turns=1),
    ]
    for n in (1_000, 10_000, 100_000):
        work = f"step of frictional shear, N = {n:g}"
        turns = 2 if n > 50_000 else 4
        listed.append(row(work, "LAMMPS, gran/hooke/history", "lammps", shear_lammps, 3.3, particles=n, turns=turns))
        listed.append(row(work, "by hand", "", shear_by_hand, particles=n, turns=turns))
    sheared_discs = {"other": other, "particles": 150}
    listed += [
        row(
            "step of 150 frictional discs",
            "particleShear",
            "particleshear",
            particle_shear,
            8000.0,
            **sheared_discs,
            native=True,
        ),
        row(
            "the same, bit for bit as theirs",
            "particleShear",
            "particleshear",
            particle_shear,
            **sheared_discs,
            native=False,
        ),
        row(
            "moduli, N = 1024, pressure 1e-6",
            "jax-md",
            "jax-md",
            moduli_jax,
            130.0,
            other=other,
            particles=1024,
            turns=2,
        ),
        row(
            "moduli, theirs the bulk modulus, N = 512",
            "rigidpy",
            "rigidpy",
            moduli_rigidpy,
            other=other,
            particles=512,
            turns=1,
        ),
    ]
    for method, wanted in (("certificate", 150.0), ("loads", 100.0)):
        listed.append(
            row(
                f"strictly jammed? N = 1024, {method}",
                "literal program, cvxpy",
                "cvxpy",
                verdict,
                wanted,
                particles=1024,
                method=method,
                turns=3,
            )
        )
    for d in (2, 3):
        listed.append(
            row(f"g(r), {d}D, N = 10000", "freud", "freud", pair_distribution, 1.0, particles=10_000, dimension=d)
        )
    for d in (2, 3):
        listed.append(
            row(
                f"S(k), {d}D, N = 10000",
                "freud",
                "freud",
                structure_factor,
                1.0,
                particles=10_000,
                dimension=d,
                turns=1,
            )
        )
    yield from (one for one in listed if there(one.needs))
