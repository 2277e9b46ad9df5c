"""Bad input gets one clear error that names the argument: every parameter of every public function and record.

A new public name is covered as soon as it is public: the tests read its signature and look each parameter up in BAD,
by ``name.parameter`` first, then by the parameter's own name. What is missing there fails the test of completeness.
"""

import concurrent.futures
import re

import numpy as np
import pytest
from arguments import (
    Toothless,
    call,
    contacts_of_another,
    crystal,
    good,
    lone_particle,
    parameters,
    public,
    scene,
    touching,
    write_files,
)
from fuzz.calls import Shy

import packmech as pm

NAN, INF = float("nan"), float("inf")

# texts and other values of which any will do
ANYTHING = {
    "work_precision.reference", "work_precision.reference_is", "work_precision.title", "work_precision.knob",
    "work_precision.failures", "record_packing.summary", "record_run.summary", "plot.options",
}  # fmt: skip


# decorators name what they decorate
CALLED = {"law.cls": "law", "effect.cls": "effect", "minimizer.cls": "minimizer", "drive.cls": "drive"}

POSITIVE = [NAN, INF, 0.0, -1.0, "1", None, True, [1.0]]
NOT_NEGATIVE = [NAN, -1.0, "1", None]
COUNT = [0, -1, 2.5, "2", True]
CHOICE = ["no such name", 3, None]
SWITCH = ["yes", 1, None]
FILE = [3, None, 1.5]
CALL = [3, "call"]
TABLE = [3, "table", [1, 2]]

BAD = {
    # the reference package's experiment
    **{
        f"ParticleShear.{name}": POSITIVE
        for name in (
            "amplitude", "young_modulus", "packing_fraction", "density", "relative_frequency", "periods",
            "reinforcement_normal", "reinforcement_tangential", "width", "height",
            "tensile_range",
        )
    },
    **{
        f"ParticleShear.{name}": NOT_NEGATIVE
        for name in ("friction_coefficient", "relative_viscosity", "tangential_ratio", "pre_periods", "post_periods")
    },
    "ParticleShear.size_ratio": [0.5, NAN, "1", None],
    "ParticleShear.divergence": [-0.1, 1.1, NAN, "1", None],
    "ParticleShear.cooling": [0.0, -1.0, 1.5, NAN, "1", None],
    "ParticleShear.keep_viscosity": SWITCH,
    "ParticleShear.law": CHOICE,
    "ParticleShear.plateau_begin": [0.0, -1.0, 1.1, NAN, "1", None],
    "ParticleShear.plateau_end": [0.2, 1.1, NAN, "1", None],
    "ParticleShear.plateau_slope": [-0.1, 1.1, NAN, "1", None],
    # packings and boxes
    "lattice_dd": [np.zeros((2, 2)), [[1.0, NAN], [0.0, 1.0]], np.eye(4), np.ones((2, 3)), 3.0, "box", None, []],
    "position_nd": [[[0.0, NAN]], [[0.0, INF]], [[0.0]], [0.0, 0.0], [], np.zeros((0, 2)), "x", None, [[0.0, 1j]]],
    "radius_n": [[NAN], [INF], [-0.5], [0.0], [0.5, 0.5], [], 0.5, "r", None, [[0.5]]],
    "Packing.radius_n": [[NAN], [-0.5], [0.5, 0.5], [], 0.0, -0.5, NAN, INF, True, "r", None, [[0.5]]],
    "Packing.box": ["box", np.eye(2), None, 0.0, -1.0, NAN, True, [1.0], [1.0, -1.0], [1.0, 1.0, 1.0]],
    "packing": [None, "packing", 3, np.zeros((2, 2)), pm.Box.cubic(1.0, 2)],
    "box": ["box", np.eye(4), np.zeros((2, 2)), [[1.0, NAN], [0.0, 1.0]]],
    "particles": [*COUNT, None],
    "dimension": [1, 4, 2.0, "2", None],
    "packing_fraction": POSITIVE,
    "sizes": ["bidisperse", 1.4, pm.Bidisperse, [0.5, -0.5], [NAN]],
    "seed": [-1, 1.5, "1", True],
    "shares": ["1", [1, -1], [0, 0], [NAN, 1], [[1, 1]], np.ones(65), [1, None]],
    "kind_n": [3, "a", [-1, 0], [64, 0], [0.5, 1.0], [[0, 1]], [0] * 99],
    "rng": [1, np.random.Generator, "rng"],
    "name": CHOICE,
    "repeats": [0, (1, 2, 3), (1, -1), (1.5, 1), "two"],
    "supercell": [np.eye(2), np.zeros((2, 2), dtype=int), np.eye(3, dtype=int), "cell"],
    "conventional": SWITCH,
    "cells": COUNT,
    "tunneled_packing.steps": [(), (6,), (-1,), (0.5,), "0", 3, None],
    "tunneled_packing.repeats": [0, (1, 2), (1, -1, 1), "two"],
    "tunneled_packing.supercell": [np.eye(3), np.zeros((3, 3), dtype=int), np.eye(2, dtype=int), "cell"],
    "vacancies": [*COUNT, 9, None],
    "apart": SWITCH,
    "relative_overlap": [NAN, 1.0, 2.0, "0", None],
    "diameter": POSITIVE,
    "ratio": [NAN, INF, 1.0, -1.0, "1.4", None],
    "DampingRatio.ratio": [NAN, INF, -1.0, "1", None],
    "fraction": [NAN, 0.0, 1.0, "half", "1:0", "1:2:3", None],
    "scatter": [NAN, -0.1, 0.31, "0", None],
    "spread": [NAN, INF, 0.0, -1.0, "0", None],
    "ratios": [(), (1.0, -1.0), (1.0, NAN), "12", 3, None],
    "fractions": [(), (1.0,), (1.0, -1.0), (1.0, NAN), "12", 3, None],
    "links": [3, "links", [[0, 1]]],
    "i_l": [NAN, [NAN], [0.5], [-1], "i", None],
    "j_l": [NAN, [NAN], [0.5], [-1], "j", None, [0, 1]],
    "image_ld": [NAN, [[NAN, 0.0]], [[0.5, 0.0]], [[0, 0, 0, 0]], "z", None],
    "length_l": [NAN, [NAN], [0.0], [-1.0], "l", None, [1.0, 1.0]],
    "shape_l": [[0], [True, True], "no"],
    # clusters
    "position_bd": [[[0.0, NAN], [1.0, 0.0]], [[0.0, 0.0]], [[0.0, 0.0]] * 2, [0.0], [], np.zeros((2, 4)), "x", None],
    "radius_b": [[NAN, 0.5], [0.0, 0.5], [0.5], 0.5, "r", None],
    "Cluster.links": [3, "links", [[0, 2]], [[0, 0]], [[0, 1], [1, 0]], [[0, 0.5]], [[-1, 0]], [[NAN, 1]], []],
    "length": POSITIVE,
    "radii": [NAN, 0.0, -1.0, "r", None, (0.5,) * 20, (0.5, NAN), [[0.5]]],
    "angle": [NAN, 0.0, np.pi, 4.0, -1.0, "1", None, (1.0,), (2.0, 1.0), (0.0, 1.0), (1.0, 4.0), (1.0, NAN), ()],
    "beads": [*COUNT, None],
    "arms": [*COUNT, None],
    "arm_beads": [*COUNT, None],
    "rigid": SWITCH,
    "shape": ["dimer", 3, None, pm.Dimer],
    "crossing": CHOICE,
    "tries": [*COUNT, None],
    "largest_overlap": [-0.1, 1.0, np.nan, "deep"],
    "scattered_packing.largest_overlap": [-0.1, 1.1, np.nan, "deep"],
    "link_length": POSITIVE,
    "chain_packing.radii": [NAN, 0.0, -1.0, "r", (0.5,) * 20, (0.5, NAN), [[0.5]]],
    "angles": ["bent", None, NAN, 0.0, np.pi, -1.0, (1.0,) * 9, (1.0, NAN), (1.0, 4.0)],
    "bend": [NAN, -0.1, 4.0, "1", None],
    "chain_packing.form": ["knot", 3, None, (0,), (0, 0, 3), (0, 0, -1), (0, 0.5, 0)],
    "winding": [(1, 0), 1, "x"],
    # bonds, bodies, strains
    "i_b": [[NAN], [0.5], [-1], "i", None],
    "j_b": [[NAN], [0.5], [-1], "j", None, [0, 1]],
    "image_bd": [[[NAN, 0.0]], [[0.5, 0.0]], [[0, 0]] * 2, "z", None],
    "rest_length_b": [[NAN], [0.0], [-1.0], "l", None, [1.0, 1.0]],
    "compression": ["linear", 3, pm.LinearSpring, Toothless()],
    "tension": ["linear", 3, pm.LinearSpring, Toothless()],
    "breaks_at": [3, 0.1, "1", pm.BondLimits, {"tension": 0.1}],
    **{
        f"BondLimits.{name}": [NAN, 0.0, -1.0, "1", True, [0.1, -1.0], ["1"], Toothless()]
        for name in ("tension", "compression", "stretch", "squeeze", "shear")
    },
    "tangential_stiffness": NOT_NEGATIVE,
    "tangential_damping": NOT_NEGATIVE,
    "rest": CHOICE,
    **{name: [NAN, INF, "1", None, True] for name in ("x", "y", "z", "low", "high")},
    **{f"Langevin.{name}": [NAN, INF, -1.0, "1", None, True] for name in ("temperature", "rate")},
    **{
        name: [NAN, INF, -1.0, "1", None, True]
        for name in (
            *("JKR.modulus", "JKR.adhesion", "DMT.adhesion", "DMT.separation", "DMT.cut"),
            *("ShortRangeAttraction.energy_scale", "ShortRangeAttraction.width"),
            *("CapillaryBridge.surface_tension", "CapillaryBridge.contact_angle"),
        )
    },
    "Langevin.seed": [NAN, INF, -1, 0.5, 1 << 53, "1", None, True],
    "BackgroundDamping.rate": [NAN, INF, -1.0, "1", None, True],
    "Walls.axis": [NAN, -1.0, 0.5, 3.0, "1", None],
    "Walls.high": [NAN, 0.0, -1.0, "1", None],
    "Walls.law": ["hertz", 3, None, pm.Hertz, Toothless()],
    **{f"Walls.{name}": [3, 0.3, "1", pm.Friction, pm.Gravity()] for name in ("friction", "rolling", "twisting")},
    "Walls.low_motion": [3, 0.3, "1", pm.WallMotion, pm.HeldStress(1.0)],
    "Walls.high_motion": [3, 0.3, "1", pm.WallMotion, pm.HeldStress(1.0)],
    "HeldStress.stress": [NAN, INF, "1", None, True],
    "HeldStress.velocity": [NAN, INF, "1", None, True],
    "MeshWalls.vertices": [3, "a", None, [], [[0.0, 0.0]], [[NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]],
    "MeshWalls.triangles": [3, "a", None, [], [[0, 1]], [[0, 1, 3]], [[-1, 0, 1]], [[0.0, 1.0, 2.0]], [[0, 1, 1]]],
    "MeshWalls.law": ["hertz", 3, None, pm.Hertz, Toothless()],
    "MeshWalls.friction": [3, 0.3, "1", pm.Friction, pm.RollingResistance(0.3)],
    "MeshWalls.rolling": [3, 0.3, "1", pm.RollingResistance, pm.Friction(0.3)],
    "MeshWalls.twisting": [3, 0.3, "1", pm.TwistingResistance, pm.Friction(0.3)],
    "read_mesh.scale": [NAN, INF, 0.0, -1.0, "1", None, True],
    "read_mesh.drop_flat": [1, "true", None],
    "Superellipsoids.exponent_n": ["a", None, [], [1.5, 4.0], [NAN, 4.0], [60.0, 4.0]],
    "Superellipsoids.ratio_nd": [3, "a", None, [], [[1.0, 0.0], [1.0, 1.0]], [[NAN, 1.0], [1.0, 1.0]], [[1.0, 1.0]]],
    "Superellipsoids.orientation_nq": [3, "a", None, [], [[0.0, 0.0], [1.0, 0.0]], [[NAN, 1.0], [1.0, 0.0]]],
    "SteadyStrain.rate": [NAN, INF, "1", None, True],
    "SteadyStrain.start": [NAN, INF, "1", None, True],
    "OscillatoryStrain.start": NOT_NEGATIVE,
    "OscillatoryStrain.periods": POSITIVE,
    **{f"{name}.mode": CHOICE for name in ("SteadyStrain", "OscillatoryStrain")},
    "SteadyStrain.axes": [3, None, (0,), (0, 0), (0, 3), (0, -1), "01"],
    "OscillatoryStrain.axes": [3, None, (0,), (0, 0), (0, 3), (0, -1), "01"],
    "density": [NAN, INF, 0.0, -1.0, "1"],
    "Packing.mass_n": [1.0, [1.0, 1.0, 1.0], [0.0], [-1.0], [NAN], "m"],
    # preparation
    **{
        f"material_constants.{name}": POSITIVE
        for name in ("young_modulus", "density", "packing_fraction", "side", "relative_frequency")
    },
    **{
        f"material_constants.{name}": NOT_NEGATIVE
        for name in ("friction_coefficient", "relative_viscosity", "tangential_ratio")
    },
    "poisson_ratio": [NAN, -0.1, 0.6, "1", None],
    "ByKind.numbers": [None, 3, "e", [], {}, [[1.0, 2.0]], [[1.0, 2.0], [3.0, 4.0]], (1.0, 2.0), {"a": 1.0}],
    "PerKind.values": [None, 3, "e", [], {}, [[1.0]], [True], ["a"], [None]],
    "LawPerKind.laws": [None, 3, pm.Harmonic(), [], [pm.Harmonic], (1.0,), (pm.Harmonic(), pm.Hertz())],
    "LawByKind.laws": [None, 3, pm.Harmonic(), [], [[pm.Harmonic]], (1.0,), (pm.Harmonic(), pm.Hertz(), pm.Hertz())],
    "Materials.materials": [None, 3, (), pm.Material(1.0), (3,), (pm.Harmonic(),)],
    "Materials.mixing": [None, 3, "largest"],
    "Materials.exceptions": [None, 3, {0: {}}, {(0, 1): {}}, {(0, 0): 0.3}, {(0, 0): {"density": 2.0}}],
    "coefficient_of_restitution.kinds": [None, 3, "e", (0,), (0, -1), (0.5, 1), (True, 0)],
    "Material.young_modulus": POSITIVE,
    "Material.density": POSITIVE,
    "Material.friction": NOT_NEGATIVE,
    "Material.restitution": [NAN, 0.0, -1.0, 1.1, "1", None],
    "size_ratio": [NAN, 0.9, "1", None],
    "period_decay": [NAN, 0.0, -1.0, 1.1, "1", None],
    "largest_oscillation": [NAN, INF, 0.0, -1.0, "1"],
    "equilibrate.largest_oscillation": POSITIVE,
    "expected_stress": POSITIVE,
    "frictionless": [*SWITCH],
    "equilibrate.axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"],
    "equilibrate.method": ["verlet", 3, pm.VelocityVerlet, pm.Fire()],
    "equilibrate.step_limit": [*COUNT, None],
    **{
        f"OscillatoryShearDrive.{name}": [NAN, INF, 0.0, -1.0, "1"]
        for name in ("frequency", "relative_frequency", "dt", "expected_stress")
    },
    "OscillatoryShearDrive.periods": POSITIVE,
    **{f"{one}.dt": [NAN, INF, 0.0, -1.0, "1"] for one in ("CreepDrive", "RampStrainDrive")},
    **{
        f"{one}.axes": [3, None, (0,), (0, 0), (0, 3), (0, -1), (0.5, 1), "01"]
        for one in ("CreepDrive", "RampStrainDrive")
    },
    **{f"{one}.method": ["verlet", 3, pm.VelocityVerlet] for one in ("CreepDrive", "RampStrainDrive")},
    "CreepDrive.stress": [NAN, INF, 0.0, "1", None],
    "RampStrainDrive.rate": [NAN, INF, 0.0, "1", None],
    "RampStrainDrive.applied_strain": POSITIVE,
    "RampStrainDrive.mode": CHOICE,
    "RampStrainDrive.samples": [*COUNT, None],
    "OscillatoryShearDrive.plates": ["rough", NAN, 0.0, -1.0, True],
    "OscillatoryShearDrive.carried": [*SWITCH, False],
    "oscillatory_shear.carried": [*SWITCH, False],
    "rough_plates.packing": [None, "packing", 3, np.zeros((2, 2)), pm.Box.cubic(1.0, 2)],
    "rough_plates.layer": ["rough", NAN, 0.0, -1.0, 1e9, None],
    "rough_plates.axis": [-1, 2, 0.5, "y", None],
    "SimulateDrive.steps": [*COUNT, None],
    **{f"SimulateDrive.{name}": [NAN, INF, 0.0, -1.0, "1"] for name in ("duration", "dt")},
    "SimulateDrive.method": ["verlet", 3, pm.VelocityVerlet],
    "SimulateDrive.velocities": [1.0, "1", [[0.0, 1.0]], ((NAN, 0.0),), (("1", 0.0),), (1.0,)],
    "SimulateDrive.spins": [1.0, "1", [[0.0]], ((INF,),), (("1",),), (1.0,)],
    "SimulateDrive.trace_every": [0, -1, 2.5, "2", True],
    "SimulateDrive.held": [0, "0", [0], (-1,), (0.5,), ("0",), None],
    "SteadyShearDrive.rates": [(), 0.1, (0.0,), (NAN,), ("1",), None],
    "SteadyShearDrive.applied_strain": [NAN, 0.0, -1.0, "1", None],
    "SteadyShearDrive.skip_strain": [NAN, -1.0, 3.0, "1", None],
    "SteadyShearDrive.blocks": [*COUNT, 1, None],
    "SteadyShearDrive.samples": [*COUNT, None],
    "SteadyShearDrive.dt": [NAN, INF, 0.0, -1.0, "1"],
    "SteadyShearDrive.axes": [3, None, (0,), (0, 0), (0, 3), (0, -1), (0.5, 1), "01"],
    "SteadyShearDrive.method": ["verlet", 3, pm.VelocityVerlet],
    **{f"DeformDrive.{name}": [0.1, ["xx"], "xx", {"yx": 0.1}, {"xx": NAN}] for name in ("strain", "stress")},
    **{f"DeformDrive.{name}": [NAN, INF, 0.0, -1.0, "1"] for name in ("rate", "pressure", "dt")},
    **{f"DeformDrive.{name}": [NAN, INF, 0.0, -1.0, "1"] for name in ("answer", "stress_tolerance")},
    "DeformDrive.steps": [0, -1, 1.5, "2"],
    "ShearAtPressureDrive.rate": POSITIVE,
    "ShearAtPressureDrive.pressure": POSITIVE,
    "ShearAtPressureDrive.applied_strain": [NAN, 0.0, -1.0, "1", None],
    "ShearAtPressureDrive.skip_strain": [NAN, -1.0, 5.0, "1", None],
    "ShearAtPressureDrive.blocks": [*COUNT, 1, None],
    "ShearAtPressureDrive.dt": [NAN, INF, 0.0, -1.0, "1"],
    "ShearAtPressureDrive.axes": [3, None, (0,), (0, 0), (0, 3), (0, -1), (0.5, 1), "01"],
    "ShearAtPressureDrive.answer": POSITIVE,
    "ShearAtPressureDrive.pressure_tolerance": POSITIVE,
    "SettleDrive.force_tolerance": POSITIVE,
    "SettleDrive.step_limit": [*COUNT, None],
    "OscillatoryShearDrive.skip_periods": [-1.0, NAN, 4.0, "1"],
    "OscillatoryShearDrive.axes": [3, None, (0,), (0, 0), (0, 3), (0, -1), (0.5, 1), "01"],
    "OscillatoryShearDrive.method": ["verlet", 3, pm.VelocityVerlet],
    # fragments
    "cut_fragments.bonds": [None, 3, "bonds", [[0, 1]], pm.Bonds([0], [9], [[0, 0]], [1.0])],
    "cut_fragments.packing": [None, "packing", 3, np.zeros((2, 2)), pm.Box.cubic(1.0, 2)],
    "centers": [-1, 2.5, "2", True, 2**53 + 1],
    "lines": [-1, 2.5, "2", True],
    "edge_fuzziness": NOT_NEGATIVE,
    "avoided_angle": [NAN, -0.1, 1.6, "1", None],
    "cut_top_bottom": SWITCH,
    "join_isolated": SWITCH,
    "removed_fraction": [NAN, -0.1, 0.9, 1.1, "1", None],
    "spanning": CHOICE,
    "axis": [-1, 2, 1.0, "y", None],
    "fill_box.box": ["box", np.eye(2), None],
    # files
    "path": FILE,
    "description": [3, None],
    "kernel.function": [3, "half", None],
    "kernel.contract": [3, "yes", None],
    "observable.unit": [3, None],
    "observable.shape": ["n", 3, None],
    "observable.plot": ["log", 3, None],
    "observable.label": [3, None],
    "report_figure.unit": [3, None],
    "report_figure.label": [3, None],
    "write_packing.law": ["harmonic", 3, pm.Harmonic, Toothless()],
    # scenes
    "scene": [None, "scene", 3, touching()],
    "effects": [
        None, "repulsion", pm.Repulsion(), (pm.Harmonic(),), (pm.Repulsion,), (pm.Repulsion(law="hertz"),),
        (Toothless(),),
    ],
    "drive": ["jam", pm.JamDrive, 3],
    "recipe": [3, "row", None],
    "cls": [3, "law", dict, pm.Harmonic(), Toothless],
    "Repulsion.law": ["harmonic", 3, None, pm.Harmonic, Toothless()],
    "energy_scale": [NAN, INF, 0.0, -1.0, "1", None, True],
    "stiffness": [NAN, INF, 0.0, -1.0, "1", None, True],
    "ElasticSpheres.modulus": [NAN, INF, 0.0, -1.0, "1", None, True],
    "exponent": [NAN, INF, 1.0, -1.0, "2", None, True],
    "divergence": [NAN, -0.1, 1.1, "1", None, True],
    "cap": [NAN, INF, 0.9, -1.0, "1", None, True],
    "begin": [NAN, 0.0, -0.1, 1.1, "1", None, True],
    "end": [NAN, 0.1, -0.1, 1.1, "1", None, True],
    "slope": [NAN, -0.1, 1.1, "1", None, True],
    "PlateauRepulsion.law": ["hertz", 3, None, pm.Hertz, Toothless()],
    "ExponentialTension.fraction": [NAN, INF, 0.0, -1.0, "1", None, True],
    "coefficient": [NAN, INF, -1.0, "1", None, True],
    "onset": [NAN, INF, -1.0, "fast", None, True],
    # contacts and measures
    "gap_tolerance": [NAN, INF, -2.0, "0", [0.0]],
    "contacts": [3, "contacts", contacts_of_another()],
    "parts": CHOICE,
    "rattlers": CHOICE,
    # rheology
    "frequency_f": ["f", None, [], [0.0], [-1.0], [NAN]],
    "complex_modulus.mode": CHOICE,
    "complex_modulus.axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"],
    "held_n": [3, "held", np.zeros(9), np.zeros(8, dtype=bool)],
    "oscillatory_shear.method": ["verlet", 3, pm.VelocityVerlet, pm.Fire()],
    "frequency": [NAN, INF, 0.0, -1.0, "1", None],
    "relative_frequency": POSITIVE,
    "value": [NAN, INF, 0.0, -1.0, "1", None],
    "contact_distance.vector_cd": [None, "v", 3.0, [1.0, 0.0], [[NAN, 0.0]], [[0.0, 0.0]], [[1.0]]],
    **dict.fromkeys(("semi_axes_i_ck", "semi_axes_j_ck"), [None, "a", [2.0, 2.0], [[2.0]], [[2.0, -1.0]]]),
    **dict.fromkeys(("director_i_cd", "director_j_cd"), [None, "d", [1.0, 0.0], [[0.0, 0.0]], [[1.0, NAN]]]),
    "TangentialDisplacements.bead_c2": ["b", 3, [0], [[0]], [[-1, 0]], [[0.5, 0]], [[NAN, 0]]],
    "Beads.start_n": [None, "s", [0, 1], [1, 2], [0.5, 2.0], [[0, 2]]],
    "Beads.offset_bd": [None, "o", [0.5, -0.5], [[0.5], [-0.5]], [[NAN, 0.0], [0.5, 0.0]]],
    "Beads.size_b": [None, "s", [0.5], [0.5, 0.0], [NAN, 0.5]],
    "Beads.gyration_nk": [None, "g", [0.7], [[0.0]], [[0.7, 0.7]]],
    "Beads.orientation_nq": [None, "o", [1.0, 0.0], [[0.0, 0.0]], [[NAN, 0.0]]],
    "rigid_packing.body_n": [None, "b", [0], [0, 2], [0.5, 1.0], [-1, 0]],
    "random_packing.shapes": [3, "ellipses", pm.Ellipses],
    "fill_box.shapes": [3, "ellipses", pm.Ellipses],
    "contact_distance.level": CHOICE,
    "find_shape_contacts.packing": [None, 3, "p", touching()],
    "second": SWITCH,
    "quartic_modes.scene": [None, 3, "scene", touching(), scene()],
    "quartic_modes.strain": CHOICE,
    "second_order.scene": [None, 3, "scene"],
    "second_order.strain": CHOICE,
    "second_order.tolerance": [NAN, INF, 0.0, 0.1, -1.0, "1", None],
    "size_limit": COUNT,
    "turn_nk": [np.zeros(9), np.zeros((9, 1)), np.full((2, 1), NAN), "t", range(10**18), [[1.0], [1.0, 2.0]]],
    "displaced.displacement_nd": [np.zeros(4), np.zeros((9, 2)), np.full((2, 2), NAN), "u", None],
    "aspect": [NAN, 0.0, -1.0, "2", [], [1.0, 0.0, 1.0, 1.0]],
    "Packing.shapes": [3, "ellipses", pm.Spheroids([2.0, 2.0], [[1.0, 0.0], [1.0, 0.0]])],
    "aspect_n": [None, "a", [0.0, 1.0], [NAN, 1.0], [[2.0, 2.0]]],
    "director_nd": [None, "d", [1.0, 0.0], [[1.0], [1.0]], [[0.0, 0.0], [1.0, 0.0]], [[NAN, 0.0], [1.0, 0.0]]],
    "FixedParticles.velocity": [None, "1", 3.0, [NAN, 0.0], [[1.0, 0.0]]],
    **{
        f"{one}.{name}": [None, 0.1, ["xx"], {"yx": 0.1}, {"xx": NAN}, {"xx": "1"}, {0: 1.0}, {"yy": 0.1, "zz": 0.1}]
        for one in ("deform", "deform_at_rate")
        for name in ("strain", "stress")
    },
    "sweep_stress.stresses": [None, "1", [], [[-1.0, -1.0]], [[[NAN, 0.0], [0.0, -1.0]]], [[[-1.0, 0.1], [0.0, -1.0]]]],
    "pressures": [None, "1", [], [0.0], [-1.0], [NAN], [[1.0]]],
    "tangential": [3, "springs"],
    "contacts_at_limit": CHOICE,
    "rolling_ck": ["d", [[NAN]], [[0.1, 0.2]], [0.1]],
    "twisting_c": ["d", [NAN], [[0.1]], [0.1, 0.2]],
    "memory_ck": ["d", [[NAN]], [[0.1], [0.2]], [0.1]],
    "at_wall_w": ["w", 3, [0.5], [[0]], [-1], [0, 0]],
    "wall_stretch_wk": ["w", 3, [0.1], [[NAN]], [[0.1], [0.2]]],
    "coefficient_of_restitution.effects": [None, 3, "e", [3], (pm.Repulsion,), pm.Repulsion()],
    "coefficient_of_restitution.speed": [*POSITIVE, 1e9, 1e-12, 1e-200, 1e200],
    "viscoelastic_time.law": [None, 3, "hertz", pm.Repulsion()],
    "viscoelastic_time.restitution": [NAN, INF, 0.0, 1.0, -1.0, "1", None],
    "viscoelastic_time.speed": [*POSITIVE, 1e9, 1e-200],
    "masses": [None, "m", 1.0, (1.0,), (1.0, 0.0), (1.0, NAN), (INF, INF), (1.0, -1.0)],
    "ViscoelasticDamping.time": NOT_NEGATIVE,
    "displacement_ck": [None, "d", [[NAN]], [[0.1, 0.2]], [0.1]],
    "i_c": [None, "i", [0.5], [-1]],
    "j_c": [None, "j", [0.5], [-1]],
    "image_cd": [None, "k", [[0.5, 0.0]], [[0]]],
    "Press.rate": [NAN, INF, 0.0, -1.0, "1", None],
    "Press.drag": [NAN, INF, 0.0, -1.0, "1", None],
    "vector_e": ["v", None, [], [NAN, 0.0, 0.0], [[1.0]], [1.0, 2.0]],
    "tensor_dd": ["t", None, [], [[NAN, 0.0], [0.0, 1.0]], [[1.0]], [1.0, 2.0]],
    "value_r": ["v", None, [], [NAN], [[1.0]]],
    "mean_with_error.error": CHOICE,
    "draws": [*COUNT, None],
    "ramp_strain.rate": [NAN, INF, 0.0, "1", None],
    "rates": [3, "0.1", [], [0.0], [NAN], ["1"], None],
    "simulate.applied_strain": [3, "shear", 0.1, pm.SteadyStrain],
    "contact_dissipation.applied_strain": [3, "shear", 0.1, pm.SteadyStrain],
    "ramp_strain.applied_strain": POSITIVE,
    "steady_shear.applied_strain": POSITIVE,
    "steady_shear.drift_tolerance": POSITIVE,
    "ramp_strain.mode": CHOICE,
    **{
        f"{one}.axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"]
        for one in (
            *("ramp_strain", "steady_shear", "creep", "amplitude_sweep", "shear_series"),
            *("shear_at_pressure", "shear_jam"),
        )
    },
    **{
        f"{one}.{name}": POSITIVE
        for one, names in {
            "shear_at_pressure": ("rate", "pressure", "applied_strain", "answer", "pressure_tolerance"),
            "shear_jam": ("rate", "pressure", "step", "largest_strain", "force_tolerance"),
            "deform_at_rate": ("rate", "answer", "stress_tolerance"),
        }.items()
        for name in names
    },
    "samples": [*COUNT, None],
    "skip_strain": [NAN, -1.0, 1e9, "1", None],
    "blocks": [*COUNT, 1, None],
    "creep.stress": [NAN, INF, 0.0, "1", None],
    "hold": [NAN, 0.0, 1e9, "1"],
    "inertia": POSITIVE,
    "viscosity": [NAN, INF, -1.0, "1"],
    "creep.frames": [-1, 2.5, "2", None],
    "ramp_strain.frames": [-1, 2.5, "2", None],
    "steady_shear.frames": [-1, 2.5, "2", None],
    "amplitude_sweep.frames": [-1, 2.5, "2", None],
    **{f"{one}.method": ["verlet", 3, pm.VelocityVerlet, pm.Fire()] for one in (
        "ramp_strain", "steady_shear", "creep", "amplitude_sweep",
    )},
    "amplitudes": [3, "0.1", [], [0.0], [NAN], [0.1, 0.1], None],
    "amplitude_sweep.periods": POSITIVE,
    "shear_series.periods": POSITIVE,
    "shear_series.repeats": [*COUNT, None],
    "shear_series.error": CHOICE,
    "prepare": [3, "scene", None],
    "frictions": [3, "0.1", [], [-0.1], [NAN], [0.1, 0.1]],
    "controls": [3, "bulk", [], ["none"], [3], None],
    "pre_periods": NOT_NEGATIVE,
    "post_periods": NOT_NEGATIVE,
    "oscillatory_shear.periods": POSITIVE,
    "oscillatory_shear.skip_periods": [-1.0, NAN, 2.0, "1"],
    "oscillatory_shear.axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"],
    "oscillatory_shear.frames": [-1, 2.5, "2", None],
    "spin_nk": [np.zeros(9), np.zeros((9, 3)), np.full((9, 1), NAN), "s"],
    "samples_per_period": [*COUNT, 7, None],
    "strain_path": CHOICE,
    # demodulation
    "phase_t": ["phase", 3, None, [], [0.0, NAN], np.zeros(400), np.linspace(7.0, 7.1, 400)],
    "stress_t": ["stress", 3, None, [], [0.0], np.full(400, NAN)],
    "skip_periods": NOT_NEGATIVE,
    "demodulate.periods": [0.0, 1.0, NAN, "1"],
    "amplitude_a": [3, "a", None, [], [0.1, 0.1], [0.1, -0.1], [0.1, NAN]],
    "storage_a": [3, "a", None, [], [0.1], [0.1, NAN]],
    "loss_a": [3, "a", None, [], [0.1], [0.1, NAN]],
    "remaining": [NAN, 0.0, 1.0, "1", None],
    # jamming
    "pressure": POSITIVE,
    "force_tolerance": POSITIVE,
    "energy_tolerance": POSITIVE,
    "jam.strain": CHOICE,
    "JamDrive.strain": CHOICE,
    "JamDrive.method": ["fast", 3, pm.HardVertex],
    "QuenchDrive.method": ["fire", 3, pm.Fire],
    "compress.strain": CHOICE,
    "displaced_rest.strain": CHOICE,
    "distances": [[], [0.0], [-1.0], [1e-3, NAN], 3, None, "1"],
    "jam.method": ["fast", 3, pm.HardVertex],
    "progress": CALL,
    "check": SWITCH,
    "start_packing_fraction": POSITIVE,
    "stop_pressure": POSITIVE,
    "factor": [NAN, 0.0, 1.0, -1.0, "0.5", None],
    "increment": [NAN, 0.0, 0.5, -1.0, "0.5", None],
    "quench_tolerance": [NAN, 0.0, 1.0, -1.0, "0.5", None],
    "quench_steps": [-1, 2.5, "2", None],
    "iteration_limit": [*COUNT, None],
    "step_limit": [-1, 2.5, "2", None],
    "StepHalving.step_limit": [*COUNT, None],
    "program_limit": [*COUNT, None],
    "trust_radius": [NAN, 0.0, 0.5, -1.0, "0.1", None],
    "minimizer": [3, "fire"],
    # minimizers
    "quench.method": ["fire", 3, pm.Fire],
    "QuenchBatch.batch": COUNT,
    "QuenchBatch.relax": ["whole", 0, -1, 2.5, None, True],
    "QuenchBatch.force_floor": NOT_NEGATIVE,
    "QuenchBatch.method": ["fire", 3, pm.Fire, pm.LBFGS()],
    "QuenchBatch.step_limit": COUNT,
    "QuenchBatch.packing_fraction_limits": [0.5, (0.5, 0.4), (0.0, 1.0), (0.5, NAN), (0.5, 0.6, 0.7), "all"],
    "QuenchBatch.threads": COUNT,
    "scenes": [None, 3, "scene", [], [3]],
    "control": CHOICE,
    "ShearBatch.steps": [*COUNT, None],
    "switched_friction": [*SWITCH, True],
    "ShearBatch.axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"],
    "ShearBatch.method": ["verlet", 3, pm.VelocityVerlet, pm.Fire()],
    "ShearBatch.threads": [*COUNT, None],
    "checkpoint": [3, 1.5, "run.txt", "no such folder/run.npz"],
    "checkpoint_every": [*COUNT, 10],
    "resume.steps": [*COUNT, 1],
    "trace_every": COUNT,
    "threads": COUNT,
    "trace_positions": SWITCH,
    "ledger": SWITCH,
    "time_limit": [NAN, 0.0, -1.0, "1"],
    "dt": POSITIVE,
    "dt_max": POSITIVE,
    "dt_min": NOT_NEGATIVE,
    "delay": NOT_NEGATIVE,
    "grow": [NAN, 0.5, "1", None],
    "shrink": [NAN, 0.0, 2.0, "1", None],
    "mixing": [NAN, -1.0, 2.0, "1", None],
    "mixing_decay": [NAN, -1.0, 2.0, "1", None],
    "largest_step": POSITIVE,
    "slope_ratio": [NAN, 0.0, 2.0, "1", None],
    "damping": NOT_NEGATIVE,
    "memory": [*COUNT, None],
    "step": POSITIVE,
    "skin": POSITIVE,
    # dynamics
    "simulate.method": ["verlet", 3, pm.VelocityVerlet, pm.Fire()],
    "VelocityVerlet.fraction": POSITIVE,
    "SemiImplicitEuler.fraction": POSITIVE,
    "steps": COUNT,
    "duration": POSITIVE,
    "temperature": POSITIVE,
    "play_motion.steps": [*COUNT, None],
    "amplitude": POSITIVE,
    "overlap_tolerance": POSITIVE,
    "motion": [None, 3, "motion", np.zeros(18), np.zeros((9, 3)), np.full((9, 2), NAN), np.zeros((9, 2))],
    "velocity_nd": [np.zeros(18), np.zeros((9, 3)), np.full((9, 2), NAN), "v"],
    # mechanics
    "solver": CHOICE,
    "method": CHOICE,
    "start": CHOICE,
    "bound": CHOICE,
    "volume": CHOICE,
    "CapillaryBridge.volume": POSITIVE,
    "kind": CHOICE,
    "constraint_jacobian.volume": SWITCH,
    "project_force.volume": SWITCH,
    "force_nd": [np.zeros(18), np.zeros((9, 3)), np.full((9, 2), NAN), "f", None],
    "strain_force": [np.zeros(2), np.full(3, NAN), "f", 1.0],
    "constraint_basis.volume": SWITCH,
    "constraint_basis.form": CHOICE,
    "constraint_jacobian.form": CHOICE,
    "volume_curvature": CHOICE,
    "strain": SWITCH,
    "floppy_modes.strain": CHOICE,
    "states_of_self_stress.strain": CHOICE,
    "rest_tolerance": [NAN, 0.0, -1.0, "1", None, Shy()],
    "tolerance": [NAN, INF, 0.0, -1.0, "1", None],
    "rank_tolerance": [NAN, INF, 0.0, 1.0, "1", None],
    "memory_limit": [NAN, INF, 0.0, -1.0, "1", None],
    "basis_limit": [NAN, INF, 0.0, -1.0, "1", None],
    "count": COUNT,
    "count_modes.below": [NAN, [1.0, INF], [[1.0]], "w", None],
    "signs": SWITCH,
    "normal_modes.between": [(2.0, 1.0), (1.0,), 1.0, (0.0, INF), "w"],
    "density_of_states.repeats": [(1, 2, 3), (2, 0), (1.5, 1), "two", (2**62, 2**62)],
    "bins": [0, -1, 2.5, "two", [1.0], [1.0, 0.5], [0.0, NAN], None],
    "particle": [-1, 1.5, "0", None],
    "source": [3, "modes", None, touching()],
    "strain_scale": [NAN, INF, 0.0, -1.0, "1"],
    "displacement_nd": [np.zeros(18), np.zeros((9, 3)), np.full((9, 2), NAN), "u", None],
    "wave_vectors": [[0.1, 0.2], [[0.1]], [[0.1, NAN]], "w", None],
    "wave_vector": [[0.1], [0.1, NAN], [[0.1, 0.2]], "w", 0.5],
    "dispersion.path": [[0.1, 0.2], [[0.1, 0.2]], [[0.0, 0.0], [0.1, INF]], "p", None],
    "dispersion.points": [*COUNT, None],
    "sound_speeds.direction": [[0.0, 0.0], [1.0], [1.0, NAN], "x", None],
    "record_packing.clusters": [3, "clusters", touching()],
    "write_certificate.verdict": [3, "verdict", None, touching()],
    "export_scene.to": ["hoomd", "", 3, None],
    "export_scene.folder": ["", 3, None, "a\0b"],
    "tiled": [(0, 1), (2,), (1, 99), 3, "yes", None],
    "strain_dd": [np.eye(3), [[0.0, 1.0], [0.0, 0.0]], np.full((2, 2), INF), "e"],
    # accuracy and recording
    "draw_frame.contacts": [3, "contacts", contacts_of_another()],
    "draw_frame.beads": [NAN, 0.0, -1.0, 1.1, "1", None, True],
    "force_c": [np.zeros(3), np.full(27, NAN), "f", [[1.0]]],
    "sliding_c": [np.zeros(27), np.zeros(3, dtype=bool), "s"],
    "rattler_n": [np.zeros(9), np.zeros(3, dtype=bool), "r"],
    "size": [3, None, (480,), (0, 480), (480, 1.5), (480, -1), (480, 10**5), "480x480"],
    "loop": [3, "strain", ("strain",), ("strain", 3)],
    "problem": [3, None, {}, {"a": 3}],
    "settings": [(), (0.0,), (-1.0,), (NAN,), (1.0, 1.0), 3, None, ("a",)],
    "error": CALL,
    "clock": [*CALL, None],
    "work_precision.repeats": [*COUNT, None],
    "settings_for.target": [3, None, (), "pressure", "pressure:0", {"pressure": -1.0}, {}],
    "settings_for.knobs": [3, "drive.dt=1,2", {}, {"drive.dt": (1.0, 2.0)}, {"drive.force_tolerance": (1e-3,)}],
    "settings_for.starts": [*COUNT, None],
    "settings_for.mean": SWITCH,
    "subject": [3, None, "packing"],
    "run": [3, None, touching()],
    "played": [3, None, touching()],
    "frames": [1, 0, 2.5, "2", None],
    "read_packing.frame": [2.5, "2", True],
    "read_packing.box": [3, "box", np.eye(2)],
    "read_packing.radius": [0.0, -1.0, NAN, "r", [], [0.5, -0.5], {}, {1: 0.0}, {1: "r"}],
    "read_trajectory.box": [3, "box", np.eye(2)],
    "read_trajectory.radius": [0.0, -1.0, NAN, "r", [], [0.5, -0.5], {}, {1: 0.0}, {1: "r"}],
    "write_packing.packing": [None, "packing", 3, np.zeros((2, 2)), pm.Box.cubic(1.0, 2)],
    "write_trajectory.snapshots": [None, "packing", 3, touching(), [], [3], [touching(), None]],
    "drop": SWITCH,
    "fields": [
        3, "velocity", None, [1.0], {3: np.zeros(9)}, {"": np.zeros(9)}, {"radius_n": np.zeros(9)}, {"a": np.zeros(8)},
        {"a": [None] * 9}, {"velocity_nd": np.full((9, 2), NAN)}, {"a": 3.0}, {"velocity_nd": np.zeros((9, 3))},
        {"spin_nk": np.zeros((9, 2))},
    ],
    "Snapshot.bonds": [
        3, None, "bonds", [3], pm.Bonds([0], [9], [[0, 0]], [1.0]), pm.Bonds([0], [1], [[0, 0, 0]], [1.0]),
    ],
    "Snapshot.contact_forces": [
        3, "forces", pm.find_contacts(touching()),
        pm.ContactData([0], [9], [[0, 0]], [1.0], [[0.0, 0.0]]),
        pm.ContactData([0], [1], [[0, 0]], [NAN], [[0.0, 0.0]]),
        pm.ContactData([0], [1], [[0, 0]], [1.0, 2.0], [[0.0, 0.0]]),
    ],
    "Snapshot.step": [-1, 2.5, "2", True],
    "atoms": [3, None, touching()],
    "from_ase.box": [3, "box", np.eye(2)],
    "from_ase.radius": [0.0, -1.0, NAN, "r", [], [0.5, -0.5], {}, {1: 0.0}],
    "from_hoomd.frame": [3, None, touching()],
    "system": [3, None, touching(), (1, 2)],
    "from_freud.radius": [0.0, -1.0, NAN, "r", [], [0.5], None, {}, {1: 0.5}],
    "to_networkx.contacts": [3, None, "contacts", touching()],
    "graph": [3, None, touching()],
    "run.frames": [-1, 2.5, "2", None],
    "modes": [3, "modes"],
    "plot.thing": [None, 3, "x", pm.Fire()],
    "plot.ax": [3, "x", [None]],
    "write_pictures.folder": [3, 1.5, None],
    "format": CHOICE,
    "mode_count": [-1, 2.5, "2", None],
    "parameters": TABLE,
    "results": TABLE,
    # cementing
    "order": [3, "all", [], [[0]], [0.5], [-1], [10**6], [0, 0], [NAN]],
    "freeze": CHOICE,
    "packings": [*COUNT, None],
    "orders": [*COUNT, None],
    "folder": [3, 1.5],
    # surroundings and structure
    "degree": [0, -1, 41, 2.5, "6", None, True],
    "neighbors": ["nearest", 3, None, pm.find_neighbors(lone_particle(), "contact")],
    "find_neighbors.rule": CHOICE,
    "cutoff": POSITIVE,
    "smallest_drop": [one for one in POSITIVE if one is not None],
    "soft_spots.count": [0, -1, 1.5, "2", 1000],
    "soft_spots.particles": [0, -1, 1.5, "2", 1000],
    # derivatives and designs
    "of": CHOICE,
    "to": CHOICE,
    "sensitivity.mode": [-1, 1.5, "2", None, True],
    "one_sided": SWITCH,
    "displaced_rest.pressure": [*POSITIVE, 7.0],
    "objective": [*CHOICE, lambda scene: (NAN, np.zeros(3))],
    "design.by": CHOICE,
    "at_least": [NAN, "1", None, True, [1.0], 10**400],
    "at_most": [NAN, "1", True, [1.0], 0.5],
    "bounds": [None, 3, (0.1,), (0.6, 1.0), (0.0, 1.0), (0.1, NAN), ("a", 1.0), ([0.1, 0.1], 1.0), (-1.0, 1.0)],
    "design.keep": CHOICE,
    "local_strain.cutoff": [one for one in POSITIVE if one is not None],
    # fields and motion
    "coarse_grain.width": [*POSITIVE, 5e-324, 1e6, 1e308],
    "coarse_grain.shape": [0, -1, 2.5, "2", (3,), (3, 0), (3, 3, 3), 10**6],
    "before": [None, "packing", 3, np.zeros((9, 2))],
    "after": [None, "packing", 3, np.zeros((9, 2)), lone_particle()],
    "deformation_dd": ["f", 3.0, np.eye(3), [[1.0, NAN], [0.0, 1.0]], []],
    **{
        f"{call}.frames": [None, "run", 3, [], [lone_particle()], [lone_particle(), crystal()], [None, None]]
        for call in ("mean_square_displacement", "self_scattering")
    },
    "mean_square_displacement.time_t": ["t", 3.0, [0.0], [0.0, NAN], [1.0, 0.0], [0.0, 0.0]],
    "self_scattering.time_t": ["t", 3.0, [0.0], [0.0, NAN], [1.0, 0.0], [0.0, 0.0]],
    "lags": ["1", [0], [-1], [1.5], [2], [NAN], []],
    "mean_square_displacement.particles": ["all", [], [9], [-1], [0.5], np.zeros(9, dtype=bool), 3],
    "self_scattering.particles": ["all", [], [9], [-1], [0.5], np.zeros(9, dtype=bool), 3],
    "remove_drift": SWITCH,
    "wave_number": POSITIVE,
    "smallest_face": NOT_NEGATIVE,
    "value_n": [None, "v", 3.0, [], [1.0], np.full(9, NAN), np.full(9, 1j * INF), np.zeros((9, 2, 2), dtype=object)],
    "r_max": [*POSITIVE, 1e9],
    "r_b": [None, "r", 3.0, [], [0.0, NAN], [[0.0]], np.zeros(5), np.arange(5.0)[::-1]],
    "value_b": [None, "v", 3.0, [], [1.0], np.full(5, INF), np.zeros((5, 1)), [[1.0], [1.0, 2.0]]],
    "noise_b": ["n", 3.0, [], [1.0], np.full(5, NAN), np.full(5, -1), np.zeros((5, 1))],
    "small_value_exponent.values": [None, 3, ["a"], [[0.0]], [[-1.0]], [[NAN]]],
    "count_b": [None, "c", 3.0, [], [1.0], np.full(5, NAN), np.full(5, -1), np.zeros((5, 1))],
    "r_min": [NAN, INF, "1", None, True],
    "separation": NOT_NEGATIVE,
    "largest": POSITIVE,
    "force_chains.angle": [NAN, 0.0, -1.0, 90.5, "1", None, True, [45.0]],
    "index_kd": [None, "k", 3, [1, 0], [[0.5, 0.0]], [[NAN, 0.0]], [[1, 0, 0]], [[1, 0], [1]], [[True, False]]],
    **{
        f"{one}.index_kd": [None, "k", 3, [1, 0], [[0.5, 0.0]], [[NAN, 0.0]], [[1, 0, 0]], [[1, 0], [1]], [[10**9, 0]]]
        for one in ("structure_factor", "partial_structure_factors", "spectral_density")
    },
    "shell_average.index_kd": [None, "k", 3, [1, 0], [[0.5, 0.0]], [[1, 0, 0]], [[1, 0], [1]], [[0, 0], [0, 0]]],
    "value_k": [None, "v", 3.0, [], [1.0], [1.0, NAN], [[1.0], [1.0]]],
    "width": POSITIVE,
    "wave_indices.k_max": [*POSITIVE, 1e9],
    "half": SWITCH,
    "spectral_density.packing": [None, "packing", 3, np.zeros((2, 2)), pm.Box.cubic(1.0, 2)],
    "nematic_order.packing": [None, "packing", 3, np.zeros((2, 2)), touching()],
    # shapes and shear of jammed packings
    "aspects": [3, "1.1", None, [], [0.0], [-1.0], [NAN], [[1.1]], ["1.1"]],
    **{
        f"{one}.{name}": values
        for one in ("shear_families", "quasistatic_shear")
        for name, values in {
            "applied_strain": [NAN, INF, "1", None, True, [0.1]],
            "axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"],
        }.items()
    },
    "avalanche_limit": [0, -1, 2.5, "2", True],
    "local_yield_stress.centers": ["all", 3.0, [[NAN, 0.0]], [[0.0, 0.0, 0.0]], [1.0, 2.0]],
    "local_yield_stress.radius": [*POSITIVE, 1e6],
    "directions": [None, "x", 0.0, [NAN], [[0.0]]],
    "largest_strain": POSITIVE,
    "cyclic_shear.axes": [3, None, (0,), (0, 0), (0, 2), (0, -1), (0.5, 1), "01"],
    "cycles": [0, -1, 2.5, "2", None, True],
    "taps": [0, -1, 2.5, "2", None, True],
    "shear_families.applied_strain": [NAN, INF, "1", None, True, [0.1], 1e308],
    "shear_families.packing": [None, "packing", 3, np.zeros((2, 2)), pm.Box.cubic(1.0, 2), lone_particle()],
    "keep": [3, "0", None, [NAN], [-0.1], [0.2], ["0"], [[0.0]]],
    "locate": CHOICE,
    "states": SWITCH,
    "changes": [3, "packing", [1], {3: 1}],
    # ensembles
    "bootstrap.value_r": ["v", None, 3.0, [NAN], [[1.0]]],
    "statistic": CHOICE,
    "ensemble": [3, None, "ensemble", touching()],
    "by": [3, "seed", [3], ["no such name"], ["state"]],
    "size_g": [None, "s", 3.0, [], [1.0, 2.0, 2.0], [0.0, 1.0, 2.0], [1.0, 2.0, NAN], [[1.0, 2.0, 3.0]]],
    "value_g": [None, "v", 3.0, [], [1.0, 2.0], [1.0, 2.0, 0.0], [1.0, 2.0, NAN], [[1.0, 2.0, 3.0]]],
    "error_g": [None, "e", 3.0, [], [1.0, 2.0], [1.0, 2.0, 0.0], [1.0, 2.0, NAN], [[1.0, 2.0, 3.0]]],
    "fit_power_law.exponent": [NAN, INF, 0.0, "2", True, [1.0]],
    "read_ensemble.folder": [3, 1.5, None],
    "resume_ensemble.folder": [3, 1.5, None],
    "run_ensemble.folder": [3, 1.5, None],
    "job": [3, None, touching(), scene(), lambda seed: seed, "math:no_such_name", "no_such_module:run", "no_such.py:f",
        "no-such-scene", "no_such.toml"],
    "grid": [
        3, "x", None, touching(), [], [3], [np.eye(2)], {}, {"y1": []}, {"y1": NAN}, {"y1": touching()}, {3: 1.0},
        {"a b": 1.0}, {"y": 1.0}, {"y1": 1}, {"y1": [1, 1], "y2": 2}, {"y1": 1, "y1.x": 2},
    ],
    "executor": [3, "threads", concurrent.futures.ThreadPoolExecutor],
    "workers": [one for one in COUNT if one != 0],
    "group": COUNT,
    "part": ["3", "0/2", "3/2", 3, 0.5, ("1", "2")],
    "retry": SWITCH,
    "trust": SWITCH,
    "members": [3, "x", ["no such folder"], [3], [["x"]]],
    "measures": [3, "value", [3], [touching()], [None], [abs], [lambda scene: 1.0]],
    "seeding": CHOICE,
    "keep_packings": SWITCH,
    "load": [3, "file.py", None, [3], [touching()], ["no such file.py"], [__file__ + "c"]],
}  # fmt: skip


def bad_values(name, parameter):
    for key in (f"{name}.{parameter}", parameter):
        if key in BAD:
            return BAD[key]
    return []


def brief(value):
    text = re.sub(r"0x[0-9a-f]+", "", repr(value)).replace("\n", "")
    return text if len(text) < 30 else text[:27] + "..."


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("files")
    write_files(made)
    return made


def test_every_parameter_is_covered():
    missing = [
        f"{name}.{parameter}"
        for name in public()
        for parameter in parameters(name)
        if not bad_values(name, parameter) and f"{name}.{parameter}" not in ANYTHING
    ]  # fmt: skip
    assert missing == []


@pytest.mark.parametrize("name", public())
def test_good_arguments_pass(name, folder):
    call(name, good(name, folder))


def fault(name, arguments, parameter, value):
    """Return what is wrong with what happens at a bad argument; nothing where one error names it."""
    arguments = arguments | {parameter: value}
    if parameter == "rng":
        arguments.pop("seed")
    try:
        call(name, arguments)
    except (TypeError, ValueError) as error:
        message = str(error)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    else:
        return "no error"
    shown = CALLED.get(f"{name}.{parameter}", parameter)
    named = re.search(rf"(^|[\w\]]\.){shown}\b", message.split(" must ")[0])
    return "" if named and " must " in message and "\n" not in message else message


@pytest.mark.parametrize("name", public())
def test_each_bad_argument_gets_one_error_that_names_it(name, folder):
    arguments = good(name, folder)
    faults = []
    for parameter, declared in parameters(name).items():
        for value in bad_values(name, parameter):
            if value is None and declared.default is None:
                continue
            found = fault(name, arguments, parameter, value)
            if found:
                faults.append(f"{parameter} = {brief(value)}: {found}")
    assert not faults, "\n".join(faults)


def test_unreadable_file_is_refused_by_the_name_of_its_argument(tmp_path):
    for ending, read in ((".npz", pm.read_packing), (".gsd", pm.read_packing), (".toml", pm.read_scene)):
        path = tmp_path / f"broken{ending}"
        path.write_bytes(b"\x80\x00 nothing of the kind")
        with pytest.raises(ValueError, match=f"^path must name a .*broken{ending}"):
            read(path)
        with pytest.raises(FileNotFoundError, match="^path must name an existing file, got .*none"):
            read(tmp_path / f"none{ending}")
