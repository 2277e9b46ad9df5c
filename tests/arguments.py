"""Arguments with which every public function and record works: what tests of bad input and of chance vary."""

import dataclasses
import functools
import inspect
from typing import NamedTuple

import numpy as np

import packmech as pm
from packmech.effects import is_effect, is_law

# made by packmech for users to read, not by users, and what users derive classes from
RESULTS = {
    "Answer", "Average", "Cementing", "ConstrainedForce", "ConstraintBasis", "Contacts",
    "ComplexModulus", "ContactForces", "Demodulation", "FrictionalModes", "OscillatoryShear",
    "JamMethod", "StrainRun", "BrokenBonds", "ContactDissipation", "EnergyLedger", "MovedWalls",
    "AmplitudeSweep", "Condition", "Creep", "FlowCurve", "ShearCurve", "ShearSeries", "ShearTrial",
    "Crossings", "FloppyModes", "IndependentLinks", "ModeCounts", "Modes", "Moduli", "MotionTrace", "NotConverged",
    "Outcome",
    "Equilibration", "MaterialConstants", "ParticleShearRun",
    "PlayedMotion", "TouchingPair", "Partners",
    "Rattling", "ReaffixedLinks",
    "Run",
    "Design", "SelfStress", "Sensitivity", "Simulation", "SoftSpots", "Solve", "Stage", "State", "StateDensity",
    "Table", "Trace", "Trial", "Verdict", "ContactData", "Snapshots",
    "PressureShear", "WallContacts",
    "WallModuli",
    "WorkPrecision", "CheapestSettings",
    "QuarticModes", "SecondOrder", "ShapeContacts",
    "Avalanche", "BondOrder", "ContactChange", "ContactStatistics", "Correlation", "CorrelationLength",
    "Ensemble",
    "FamilyChange", "ForceChains", "ForceDistribution", "GroupStatistics", "Histogram", "Neighbors",
    "NematicOrder", "PairDistribution", "PartialStructureFactors", "PowerLawFit", "QuasistaticShear", "LocalYield",
    "Deformation", "DisplacedRest",
    "ShearFamilies", "ShellAverage", "SpectrumFit",
    "CoarseFields", "Displacements", "LocalStrain", "MeanSquareDisplacement", "SelfScattering",
    "particle_shear",
    "Export", "RigidClusters", "SoundSpeeds", "TiledAnswer", "Verification", "Waves",
}  # fmt: skip

MINIMIZERS = {
    "ConjugateGradient", "DampedDynamics", "Fire", "Fire2", "GradientDescent", "LBFGS", "Newton", "SteepestDescent",
}  # fmt: skip

INTEGRATORS = {"SemiImplicitEuler", "VelocityVerlet"}


class Motionless(NamedTuple):
    """A minimizer that only says where it stands."""

    def start(self, program):
        return program.progress(2, 0)

    def advance(self, program, goal, progress, steps):
        return program.judge(goal)[0]


@dataclasses.dataclass(frozen=True)
class Idle:
    """A drive that does nothing."""

    def run(self, scene):
        return None


def lone_particle(radius: float = 0.5):
    """Return a packing of one particle."""
    return pm.Packing([[0.0, 0.0]], [radius], pm.Box.cubic(2.0, 2))


class Toothless(NamedTuple):
    """Neither a law nor an effect: it has none of their methods."""

    energy_scale: float = 1.0


@functools.cache
def touching():
    return pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)


@functools.cache
def scene():
    return pm.Scene(touching(), (pm.Repulsion(),))


@functools.cache
def ellipses():
    shapes = pm.Spheroids([2.0, 1.5], [[1.0, 0.2], [0.0, 1.0]])
    return pm.Packing([[0.5, 0.5], [1.4, 1.3]], [0.5, 0.5], pm.Box.cubic(1.8, 2), shapes=shapes)


@functools.cache
def pressed():
    return scene().replace(packing=pm.lattice_packing("triangular", relative_overlap=1e-3))


@functools.cache
def crystal():
    return pm.lattice_packing("triangular", repeats=(3, 3))


@functools.cache
def hard_packing():
    """Return a jammed packing of few particles."""
    start = pm.random_packing(5, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.6, seed=1)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), strain="isotropic").packing


def traced():
    return pm.Trace(np.arange(2), np.zeros(2), np.zeros(2), np.arange(2), np.zeros(2))


@functools.cache
def contacts_of_another():
    return pm.find_contacts(pm.lattice_packing("kagome", repeats=(3, 3)), gap_tolerance=1e-9)


def stopped_run(folder):
    """Return the path of the checkpoint of a short run, written anew: a run that was resumed writes it, too."""
    path = folder / "run.npz"
    path.unlink(missing_ok=True)
    pm.simulate(scene(), steps=2, checkpoint=path)
    return path


def good(name, folder):
    """Return arguments with which the public function or record works."""
    ones = {
        "Box": lambda: {"lattice_dd": np.eye(2)},
        "Packing": lambda: {"position_nd": [[0.0, 0.0]], "radius_n": [0.5], "box": pm.Box.cubic(2.0, 2)},
        "Links": lambda: {"i_l": [0], "j_l": [1], "image_ld": [[0, 0]], "length_l": [1.0]},
        "Mixture": lambda: {"ratios": (1.0, 2.0), "fractions": (1.0, 1.0)},
        "random_packing": lambda: {"particles": 4, "dimension": 2, "packing_fraction": 0.8, "seed": 1},
        "assign_kinds": lambda: {"packing": touching(), "shares": (1, 1), "seed": 1},
        "scattered_packing": lambda: {"packing": touching(), "packing_fraction": 0.8, "seed": 1},
        "lattice_packing": lambda: {"name": "square"},
        "reinforced_kagome_packing": lambda: {"cells": 1},
        "tunneled_packing": lambda: {"steps": (0,)},
        "vacancy_packing": lambda: {"packing": touching(), "vacancies": 1, "seed": 1},
        "Cluster": lambda: {"position_bd": [[0.0, 0.0], [1.0, 0.0]], "radius_b": [0.5, 0.5]},
        "RingCluster": lambda: {"beads": 3},
        "StarCluster": lambda: {"arms": 3},
        "LinearCluster": lambda: {"beads": 2},
        "chain_packing": lambda: {"count": 2, "beads": 4, "dimension": 2, "packing_fraction": 0.5, "seed": 1},
        "cluster_packing": lambda: {
            "count": 2,
            "shape": pm.Trimer(),
            "dimension": 2,
            "packing_fraction": 0.8,
            "seed": 1,
        },
        "BondLimits": lambda: {"tension": 0.1},
        "Bonds": lambda: {"i_b": [0], "j_b": [1], "image_bd": [[0, 0]], "rest_length_b": [1.0]},
        "Spheroids": lambda: {"aspect_n": [2.0, 0.5], "director_nd": [[1.0, 0.0], [0.0, 1.0]]},
        "contact_distance": lambda: {
            "vector_cd": [[1.0, 0.0]],
            "semi_axes_i_ck": [[1.0, 0.5]],
            "director_i_cd": [[1.0, 0.0]],
            "semi_axes_j_ck": [[0.5, 1.0]],
            "director_j_cd": [[0.0, 1.0]],
        },
        "Superellipsoids": lambda: {
            "exponent_n": [4.0, 2.0],
            "ratio_nd": [[1.0, 1.0], [2.0, 1.0]],
            "orientation_nq": [[1.0, 0.0], [0.0, 1.0]],
        },
        "MeshWalls": lambda: {
            "vertices": [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]],
            "triangles": [[0, 1, 2]],
        },
        "read_mesh": lambda: {"path": folder / "a.off"},
        "Ellipses": lambda: {"aspect": 1.5},
        "Beads": lambda: {
            "start_n": [0, 2],
            "offset_bd": [[0.5, 0.0], [-0.5, 0.0]],
            "size_b": [0.7, 0.7],
            "gyration_nk": [[0.8]],
            "orientation_nq": [[1.0, 0.0]],
        },
        "rigid_packing": lambda: {"packing": touching(), "body_n": np.zeros(touching().particles, dtype=int)},
        "bead_packing": lambda: {
            "packing": pm.random_packing(2, dimension=2, packing_fraction=0.5, seed=1, shapes=pm.Dimer())
        },
        "find_shape_contacts": lambda: {"packing": ellipses()},
        "quartic_modes": lambda: {"scene": pm.Scene(ellipses(), (pm.Repulsion(),))},
        "second_order": lambda: {"scene": scene()},
        "displaced": lambda: {"packing": ellipses(), "displacement_nd": np.zeros((2, 2)), "turn_nk": np.zeros((2, 1))},
        "FixedParticles": lambda: {"particles": (0, 3), "velocity": (1.0, 0.0)},
        "shear_jam": lambda: {"scene": scene(), "pressure": 1e-3, "largest_strain": 0.01},
        "shear_at_pressure": lambda: {
            "scene": scene(),
            "rate": 0.01,
            "pressure": 1e-3,
            "applied_strain": 0.02,
            "skip_strain": 0.0,
            # too short to be steady
            "check": False,
        },
        "SteadyStrain": lambda: {"rate": 0.1},
        "OscillatoryShearDrive": lambda: {"amplitude": 0.1, "frequency": 0.2},
        "SteadyShearDrive": lambda: {"rates": (0.1,)},
        "DeformDrive": lambda: {"strain": {"yy": -0.1}},
        "ShearAtPressureDrive": lambda: {"rate": 0.1, "pressure": 1e-3},
        "SettleDrive": lambda: {},
        "SimulateDrive": lambda: {"steps": 2},
        "CreepDrive": lambda: {"stress": 0.1, "duration": 2.0},
        "RampStrainDrive": lambda: {"rate": 0.1, "applied_strain": 0.2},
        "rough_plates": lambda: {"packing": pm.random_packing(30, dimension=2, packing_fraction=0.9, seed=1)},
        "equilibrate": lambda: {"scene": scene(), "amplitude": 1e-3, "frequency": 0.2, "dt": 0.2},
        "OscillatoryStrain": lambda: {"amplitude": 0.1, "frequency": 0.2},
        "cut_fragments": lambda: {"bonds": pm.bond_contacts(touching()), "packing": touching(), "seed": 1},
        "fill_box": lambda: {"box": pm.Box.cubic(9.0, 2), "particles": 4, "packing_fraction": 0.8, "seed": 1},
        "read_packing": lambda: {"path": folder / "a.npz"},
        "read_law": lambda: {"path": folder / "a.npz"},
        "read_trajectory": lambda: {"path": folder / "a.npz"},
        "write_trajectory": lambda: {"snapshots": [touching()], "path": folder / "b.dump"},
        "Snapshot": lambda: {"packing": touching()},
        "snapshots": lambda: {"run": pm.Run(touching(), pm.Outcome.CONVERGED, 0.0, 1, 1, 0.0), "scene": scene()},
        "from_ase": lambda: {"atoms": pm.to_ase(touching())},
        "from_hoomd": lambda: {"frame": pm.to_hoomd(touching())},
        "from_freud": lambda: {"system": pm.to_freud(touching()), "radius": 0.5},
        "to_networkx": lambda: {"contacts": pm.find_contacts(touching())},
        "from_networkx": lambda: {"graph": pm.to_networkx(pm.find_contacts(touching())), "packing": touching()},
        "read_scene": lambda: {"path": "default"},
        "write_packing": lambda: {"packing": touching(), "path": folder / "b.npz"},
        "write_scene": lambda: {"scene": scene(), "path": folder / "b.toml"},
        "export_scene": lambda: {"scene": scene(), "folder": folder / "peer", "to": "lammps"},
        "Scene": lambda: {"packing": touching(), "effects": (pm.Repulsion(),)},
        "perturbation_energy": lambda: {"scene": scene(), "displacement_nd": np.zeros((9, 2))},
        "project_force": lambda: {"packing": touching(), "force_nd": np.ones((9, 2))},
        "density_of_states": lambda: {"source": scene()},
        "count_modes": lambda: {"scene": scene(), "below": [1.0, 2.0]},
        "sensitivity": lambda: {"scene": pressed(), "of": "pressure", "to": "radius"},
        "design": lambda: {
            "scene": pressed(),
            "objective": "pressure",
            "by": "radius",
            "at_least": 1e-6,
            "bounds": (0.1, 1.0),
        },
        "soft_spots": lambda: {"modes": pm.normal_modes(scene())},
        "waves": lambda: {"scene": scene(), "wave_vectors": [[0.1, 0.2]]},
        "dispersion": lambda: {"scene": scene(), "path": [[0.0, 0.0], [0.5, 0.0]], "points": 4},
        "sound_speeds": lambda: {"scene": scene(), "direction": [1.0, 0.0]},
        "verify": lambda: {"path": folder / "a.npz"},
        "write_certificate": lambda: {"verdict": pm.classify_jamming(touching()), "path": folder / "c.npz"},
        "quench": lambda: {"scene": scene(), "force_tolerance": 1e-6},
        "settle": lambda: {"scene": scene(), "force_tolerance": 1e-6},
        "run": lambda: {"scene": scene().replace(drive=pm.QuenchDrive(force_tolerance=1e-6))},
        "QuenchBatch": lambda: {"scene": scene()},
        "simulate": lambda: {"scene": scene(), "steps": 2},
        "contact_dissipation": lambda: {"scene": scene(), "velocity_nd": np.zeros((9, 2))},
        "ShearBatch": lambda: {"scenes": [scene()]},
        "complex_modulus": lambda: {"scene": scene(), "frequency_f": [0.1]},
        "mean_with_error": lambda: {"value_r": [1.0, 2.0]},
        "at_packing_fraction": lambda: {"packing": touching(), "value": 0.5},
        "mandel_tensor": lambda: {"vector_e": [1.0, 2.0, 0.0]},
        "mandel_vector": lambda: {"tensor_dd": [[1.0, 0.0], [0.0, 2.0]]},
        "ramp_strain": lambda: {"scene": scene(), "rate": 0.1, "applied_strain": 0.1, "samples": 5},
        "steady_shear": lambda: {
            "scene": scene(),
            "rates": [0.1],
            "applied_strain": 0.2,
            "skip_strain": 0.1,
            "blocks": 2,
            "samples": 20,
        },
        "creep": lambda: {"scene": scene(), "stress": 1e-3, "duration": 1.0, "hold": 0.5},
        "amplitude_sweep": lambda: {
            "scene": scene(),
            "amplitudes": [1e-3],
            "frequency": 0.2,
            "periods": 2.0,
            "samples_per_period": 20,
        },
        "shear_series": lambda: {
            "prepare": lambda seed: scene(),
            "amplitudes": [1e-3],
            "repeats": 1,
            "frequency": 0.2,
            "periods": 2.0,
            "samples_per_period": 20,
        },
        "oscillatory_shear": lambda: {
            "scene": scene(),
            "amplitude": 1e-3,
            "frequency": 0.2,
            "periods": 2.0,
            "samples_per_period": 20,
            "dt": 0.2,
        },
        "demodulate": lambda: {"phase_t": np.linspace(0.0, 20.0, 400), "stress_t": np.zeros(400), "amplitude": 0.1},
        "yield_strain": lambda: {"amplitude_a": [0.1, 0.2], "storage_a": [2.0, 0.5], "loss_a": [1.0, 1.0]},
        "softening_strain": lambda: {"amplitude_a": [0.1, 0.2], "storage_a": [2.0, 0.5]},
        "play_motion": lambda: {"packing": touching(), "motion": np.eye(9, 2), "steps": 2},
        "compress": lambda: {"scene": scene(), "distances": [1e-3]},
        "small_value_exponent": lambda: {"values": [[0.1, 0.2], [0.3]], "largest": 1.0},
        "coefficient_of_restitution": lambda: {"effects": (pm.Repulsion(), pm.Restitution(0.5)), "speed": 0.01},
        "Material": lambda: {"young_modulus": 1.0},
        "Materials": lambda: {"materials": (pm.Material(1.0),)},
        "ByKind": lambda: {"numbers": [[1.0, 2.0], [2.0, 3.0]]},
        "LawByKind": lambda: {"laws": [[pm.Harmonic()]]},
        "PerKind": lambda: {"values": [1.0, 2.0]},
        "LawPerKind": lambda: {"laws": [pm.Harmonic(1.0), pm.Harmonic(2.0)]},
        "viscoelastic_time": lambda: {"law": pm.Hertz(), "restitution": 0.8, "speed": 0.01},
        "TangentialDisplacements": lambda: {
            "i_c": [0],
            "j_c": [1],
            "image_cd": [[0, 0]],
            "displacement_ck": [[0.1]],
            "at_wall_w": [0],
            "wall_stretch_wk": [[0.1]],
        },
        "sweep_pressure": lambda: {
            "scene": scene().replace(packing=pm.lattice_packing("triangular", relative_overlap=1e-3)),
            "pressures": [2e-3],
        },
        "sweep_stress": lambda: {
            "scene": scene().replace(packing=pm.lattice_packing("triangular", relative_overlap=1e-3)),
            "stresses": [[[-2e-3, 0.0], [0.0, -2e-3]]],
        },
        "deform": lambda: {"scene": pressed(), "strain": {"yy": -1e-4}, "steps": 1},
        "deform_at_rate": lambda: {"scene": scene(), "rate": 0.01, "strain": {"xx": -0.002}},
        "settings_for": lambda: {
            "scene": pm.Scene(touching(), (pm.Repulsion(),), pm.QuenchDrive()),
            "target": "energy:10 absolute",
            "time_limit": 5.0,
        },
        "work_precision": lambda: {"problem": lambda setting: setting, "settings": (1.0, 0.5), "reference": 0.0},
        "plot": lambda: {"thing": touching()},
        "write_pictures": lambda: {
            "run": pm.Run(touching(), pm.Outcome.CONVERGED, 0.0, 1, 1, 0.0),
            "folder": folder,
            "scene": scene(),
        },
        "write_table": lambda: {"subject": traced(), "path": folder / "b.csv"},
        "read_table": lambda: {"path": folder / "a.csv"},
        "resume": lambda: {"path": stopped_run(folder), "scene": scene()},
        "draw_frame": lambda: {"packing": touching(), "contacts": pm.find_contacts(touching()), "size": (40, 30)},
        "Recording": lambda: {"path": folder / "steps.rrd", "scene": scene()},
        "record_packing": lambda: {"subject": touching(), "path": folder / "a.rrd"},
        "record_motion": lambda: {
            "played": pm.play_motion(touching(), np.eye(9, 2), steps=2),
            "path": folder / "m.rrd",
        },
        "bond_orientational_order": lambda: {"packing": touching()},
        "coarse_grain": lambda: {"scene": scene(), "width": 0.5},
        "displacements": lambda: {"before": touching(), "after": touching()},
        "local_strain": lambda: {"before": touching(), "after": touching()},
        "mean_square_displacement": lambda: {"frames": [touching(), touching()]},
        "self_scattering": lambda: {"frames": [touching(), touching()], "wave_number": 2.0},
        "find_neighbors": lambda: {"packing": touching(), "rule": "cutoff", "cutoff": 1.2},
        "nematic_order": lambda: {"packing": ellipses()},
        "correlation_function": lambda: {"packing": touching(), "value_n": np.arange(9.0), "r_max": 1.1},
        "correlation_length": lambda: {"r_b": np.arange(5.0), "value_b": np.zeros(5), "count_b": np.ones(5)},
        "pair_distribution": lambda: {"packing": touching(), "r_max": 1.1},
        "structure_factor": lambda: {"packing": touching(), "index_kd": [[1, 0], [0, 1]]},
        "partial_structure_factors": lambda: {"packing": touching(), "index_kd": [[1, 0], [0, 1]]},
        "spectral_density": lambda: {"packing": crystal(), "index_kd": [[1, 0], [0, 1]]},
        "shell_average": lambda: {"box": pm.Box.cubic(2.0, 2), "index_kd": [[1, 0], [0, 1]], "value_k": [1.0, 2.0]},
        "wave_indices": lambda: {"box": pm.Box.cubic(2.0, 2), "k_max": 4.0},
        "wave_vectors": lambda: {"box": pm.Box.cubic(2.0, 2), "index_kd": [[1, 0], [0, 1]]},
        "displaced_rest": lambda: {"scene": pressed(), "pressure": 1e-3},
        "anneal_shape": lambda: {"scene": pressed(), "aspects": [1.05], "seed": 1, "pressure": 1e-3},
        "cyclic_shear": lambda: {"scene": pressed(), "amplitude": 1e-3},
        "tap": lambda: {"scene": pressed(), "amplitude": 1e-3, "seed": 1, "pressure": 1e-3},
        "quasistatic_shear": lambda: {"scene": pressed(), "applied_strain": 1e-3},
        "local_yield_stress": lambda: {
            "scene": scene().replace(packing=pm.lattice_packing("triangular", repeats=(8, 8), relative_overlap=1e-3)),
            "centers": [[1.0, 1.0]],
            "radius": 1.0,
            "largest_strain": 1e-3,
        },
        "shear_families": lambda: {"packing": hard_packing(), "applied_strain": 1e-3},
        "bootstrap": lambda: {"value_r": [1.0, 2.0], "draws": 10},
        "histogram": lambda: {"value_r": [1.0, 2.0]},
        "fit_power_law": lambda: {"size_g": [1.0, 2.0, 4.0], "value_g": [4.0, 2.0, 1.0], "error_g": [0.1, 0.1, 0.1]},
        "group_statistics": lambda: {"ensemble": pm.read_ensemble(folder / "ensemble"), "name": "value", "draws": 10},
        "read_ensemble": lambda: {"folder": folder / "ensemble"},
        "resume_ensemble": lambda: {"folder": folder / "ensemble", "trust": True},
        "run_ensemble": lambda: {
            "job": "calendar:leapdays",
            "grid": {"y1": 2000, "y2": 2010},
            "folder": folder / "ensemble",
        },
        "law": lambda: {"cls": type(pm.Harmonic())},
        "effect": lambda: {"cls": type(pm.Repulsion())},
        "minimizer": lambda: {"cls": Motionless},
        "drive": lambda: {"cls": Idle},
        "packing_kind": lambda: {"recipe": lone_particle},
        "kernel": lambda: {"function": lone_particle},
    }
    if name in ones:
        return ones[name]()
    parameters = inspect.signature(getattr(pm, name)).parameters
    made = {"scene": scene, "packing": touching}
    found = {key: make() for key, make in made.items() if key in parameters}
    if name == "record_run":
        found |= {"run": pm.Run(touching(), pm.Outcome.CONVERGED, 0.0, 1, 1, 0.0), "path": folder / "a.rrd"}
    return found


def call(name, arguments):
    """Call a function or make a record; a law or an effect is checked by its scene, a minimizer by its quench."""
    made = getattr(pm, name)(**arguments)
    if is_effect(made):
        # for spheres
        space = isinstance(made, pm.TwistingResistance | pm.MeshWalls)
        beside = () if isinstance(made, pm.JKR) else (pm.Repulsion(),)
        pm.Scene(pm.lattice_packing("fcc") if space else touching(), (*beside, made))
    if isinstance(made, pm.WallMotion | pm.HeldStress):
        motion = pm.WallMotion(y=made) if isinstance(made, pm.HeldStress) else made
        pm.Scene(touching(), (pm.Repulsion(), pm.Walls(1, 0.0, 1.0, high_motion=motion)))
    if isinstance(made, pm.Mindlin):
        pm.Scene(touching(), (pm.Repulsion(), pm.Friction(0.5, made)))
    if isinstance(made, pm.DampingRatio):
        pm.Scene(touching(), (pm.Repulsion(), pm.Friction(0.5, 1.0, made)))
    if is_law(made):
        pm.Scene(touching(), (pm.Repulsion(law=made),))
    if name in MINIMIZERS:
        pm.quench(scene(), force_tolerance=1e-6, method=made)
    if name in INTEGRATORS:
        pm.simulate(scene(), steps=2, method=made)
    return made


def _env(name):
    """Return a constructor of packmech_envs, and an environment that it made, after its reset."""
    import packmech_envs.batched
    import packmech_envs.single

    made = getattr(packmech_envs.batched if "Vector" in name else packmech_envs.single, name)
    number = {"num_envs": 2} if "Vector" in name else {}
    return made, {**number, "scene": pressed()}


@functools.cache
def _reset_env(name):
    make, arguments = _env(name)
    env = make(**arguments)
    env.reset(seed=1)
    return env


def _method(make, method, **arguments):
    """Return what gives a method of something that `make` gives in a folder, and arguments with which it works."""
    return lambda folder: (getattr(make(folder), method), arguments)


def _contacts(folder):
    return pm.find_contacts(touching())


def _shape_contacts(folder):
    return pm.find_shape_contacts(ellipses(), gap_tolerance=1.0)


def _ensemble(folder):
    return pm.read_ensemble(folder / "ensemble")


@functools.cache
def _moduli():
    return pm.elastic_moduli(pressed())


@functools.cache
def _soft_spots():
    return pm.soft_spots(pm.normal_modes(scene()))


@functools.cache
def _work_precision():
    return pm.work_precision(lambda setting: setting, (1.0, 0.5), reference=0.0)


@functools.cache
def _tensors():
    return pm.deform(pressed(), strain={"yy": -1e-4}, steps=1).table()


def _snapshots(folder):
    pm.write_trajectory([touching(), touching()], folder / "two.dump")
    return pm.read_trajectory(folder / "two.dump")


ENVS = ("QuenchEnv", "ShearEnv", "QuenchVectorEnv", "ShearVectorEnv")
# of results what is asked with an argument, and environments: a name -> what is called, and arguments that work
METHODS = {
    "Contacts.select": _method(_contacts, "select", keep_c=[0, 1]),
    "Contacts.among": _method(_contacts, "among", kept_n=np.ones(9, dtype=bool)),
    "Contacts.at": _method(_contacts, "at", packing=touching()),
    "Contacts.points": _method(_contacts, "points", radius_n=np.full(9, 0.5)),
    "ShapeContacts.select": _method(_shape_contacts, "select", keep_c=[0]),
    "ShapeContacts.at": _method(_shape_contacts, "at", packing=ellipses()),
    "Ensemble.__getitem__": _method(_ensemble, "__getitem__", name="value"),
    "Ensemble.arrays": _method(_ensemble, "arrays", row=0),
    "Ensemble.path": _method(_ensemble, "path", row=0),
    "Ensemble.take": _method(_ensemble, "take", rows=[0]),
    "Moduli.average": _method(lambda folder: _moduli(), "average", bound="hill"),
    "Moduli.component": _method(lambda folder: _moduli(), "component", indices="xxyy"),
    "Moduli.simple_shear": _method(lambda folder: _moduli(), "simple_shear"),
    "Moduli.tensor": _method(lambda folder: _moduli(), "tensor"),
    "Snapshots.__getitem__": _method(_snapshots, "__getitem__", number=0),
    "SoftSpots.rank": _method(lambda folder: _soft_spots(), "rank", particle=0),
    "Table.__getitem__": _method(lambda folder: pm.read_table(folder / "a.csv"), "__getitem__", name="step"),
    "Table.tensor": _method(lambda folder: _tensors(), "tensor", name="stress"),
    "Trace.__getitem__": _method(lambda folder: traced(), "__getitem__", name="energy"),
    "Trace.table": _method(lambda folder: traced(), "table"),
    "WorkPrecision.of": _method(lambda folder: _work_precision(), "of"),
    "WorkPrecision.order": _method(lambda folder: _work_precision(), "order"),
    "WorkPrecision.cheapest": _method(lambda folder: _work_precision(), "cheapest", error_below=1.0),
    **{name: (lambda folder, name=name: _env(name)) for name in ENVS},
    **{f"{name}.step": _method(lambda folder, name=name: _reset_env(name), "step") for name in ENVS},
    **{f"{name}.reset": _method(lambda folder, name=name: _reset_env(name), "reset") for name in ENVS},
}


def public():
    return [name for name in pm.__all__ if name not in RESULTS]


def parameters(name):
    return inspect.signature(getattr(pm, name)).parameters


def write_files(folder):
    """Write into a folder what `good` reads."""
    pm.write_packing(touching(), folder / "a.npz", law=pm.Harmonic())
    (folder / "a.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    stopped_run(folder)
    pm.write_table(traced(), folder / "a.csv")
    pm.run_ensemble("calendar:leapdays", {"y1": 2000, "y2": 2010}, folder / "ensemble", workers=1)
