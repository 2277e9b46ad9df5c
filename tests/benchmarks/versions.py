# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""One vocabulary for two versions of packmech: the tables of what is called otherwise, and the facade that reads them.

Cases for both versions are written once, in the words of the newer one (the "head"), against the facade `Versions`.
Under the older one (the "tag") the facade says the same in its words. Both get every default stated, so that one that
changes does not make two versions differ.

How to extend the tables when something is renamed: change the word in the cases and in `STATED`, and say here what the
tag calls it.

=============================================  ========================================================================
what was renamed                               where it is said
=============================================  ========================================================================
an argument                                    ``RENAMED["call"] = {"new": "old"}``
its values                                     ``RENAMED["call"] = {"new": {value: {"old": old_value}}}``
the orientation or unit of what returns        ``RESULTS["call"] = function``, from the tag's result to the head's
a field of a record, a key of a report         ``NAMES["ending of the old name"] = "ending of the new name"``
a text among results                           ``WORDS["name pattern"] = {"old": "new"}``
modules and private names                      ``PRIVATE["word"] = ("head.module:name", "tag.module:name")``
what is gone on purpose                        ``GONE["case pattern"] = {"array pattern": "reason"}``
masses: arguments of calls at the tag,         ``MASSES["call"] = function`` of a packing: those of the tag unless
of the packing at the head                     given; ``DENSITY``: drives that have a density at the tag
=============================================  ========================================================================

In cases only arguments without a default go by position, all others by name.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import fnmatch
import functools
import importlib
import io
import math
import os
import runpy
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

SIDES = ("head", "tag")


# -- the tables -------------------------------------------------------------------------------------------------------

_KEPT_SHAPE = {"strain": {"free": {"strain": "free"}, "isotropic": {"strain": "fixed"}}}
_STRAINS_OR_NOT = {"strain": {"none": {"strain": False}, "free": {"strain": True}}}
_STRAINS = {
    "strain": {
        "none": {"strain": False, "volume": "free"},
        "free": {"strain": True, "volume": "free"},
        "isochoric": {"strain": True, "volume": "fixed"},
    }
}
_CONSTRAINED = {
    "strain": {
        "none": {"strain": False, "volume": False},
        "free": {"strain": True, "volume": False},
        "isochoric": {"strain": True, "volume": True},
    }
}
_APPLIED = {"applied_strain": "strain"}
_SHRINKING = {"strain": {"free": {"volume": "nonincreasing"}, "isochoric": {"volume": "fixed"}}}

# call -> {argument of the head: the tag's word for it, or for each value the arguments of the tag that say the same}
RENAMED: dict[str, dict[str, str | dict[Any, dict[str, Any]]]] = {
    "jam": _KEPT_SHAPE,
    "compress": _KEPT_SHAPE,
    "JamDrive": _KEPT_SHAPE,
    "rigidity_matrix": _STRAINS_OR_NOT,
    "independent_links": _STRAINS_OR_NOT,
    "change_of_basis": _STRAINS,
    "constrained_rigidity_matrix": _STRAINS,
    "n_matrix": _STRAINS,
    "hessian": _STRAINS,
    "dynamical_matrix": _STRAINS,
    "normal_modes": _STRAINS,
    "perturbation_energy": {"strain": {"free": {"volume": "free"}, "isochoric": {"volume": "fixed"}}},
    "constraint_jacobian": _CONSTRAINED,
    "constraint_basis": _CONSTRAINED,
    "project_force": {"strain": {"free": {"volume": False}, "isochoric": {"volume": True}}},
    "classify_jamming": _SHRINKING,
    "play_motion": _SHRINKING,
    **dict.fromkeys(("simulate", "ramp_strain", "steady_shear", "RampStrainDrive", "SteadyShearDrive"), _APPLIED),
    "Shear-v0": {"goal": "task"},
}


class _InColumns:
    """A basis of constraints of the tag, whose motions are in rows, with motions in columns."""

    def __init__(self, basis: Any) -> None:
        self._basis = basis

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._basis, name)
        return value.T if name == "null_basis" else value


def _states_in_columns(found: Any) -> dict[str, Any]:
    """Return a record of states of self stress or of floppy modes with its bases in columns."""
    record = {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}
    if "force_kc" in record:
        force = record.pop("force_kc")
        return record | {"force_ck": None if force is None else force.T}
    moved, strain = record.pop("displacement_knd"), record.pop("strain_ke")
    motion = None if moved is None else np.hstack([moved.reshape(len(moved), math.prod(moved.shape[1:])), strain]).T
    return record | {"motion_xk": motion}


# call -> function from what the tag returns to what the head does: another orientation or unit
RESULTS: dict[str, Callable[[Any], Any]] = {
    "change_of_basis": np.transpose,
    "constraint_basis": _InColumns,
    "states_of_self_stress": _states_in_columns,
    "floppy_modes": _states_in_columns,
}

# ending of names in results at the tag -> the head's: fields of records, keys of reports and of JSON files
NAMES: dict[str, str] = {
    "verdict.volume": "verdict.strain",
    "verdict_volume": "verdict_strain",
    "ramp.strain": "ramp.applied_strain",
    "steady shear.strain": "steady shear.applied_strain",
}

# pattern of the head's names in results -> {text at the tag: the head's}; the first pattern that matches holds
WORDS: dict[str, dict[str, str]] = {
    "*verdict?strain": {"nonincreasing": "free", "fixed": "isochoric"},
    "*strain": {"fixed": "isotropic"},
}

# what is not public: word -> (head's module:name, tag's module:name)
PRIVATE: dict[str, tuple[str, str]] = {
    "prepared_discs": (
        "packmech.validation.particle_shear:prepared_discs",
        "packmech.dynamics.particle_shear:prepared_discs",
    ),
    "scenarios": ("packmech.validation.particle_shear:SCENARIOS", "packmech.dynamics.particle_shear:SCENARIOS"),
    "FollowStress": ("packmech_envs.shear_goals:FollowStress", "packmech_envs.shear_tasks:FollowStress"),
    "QuenchReward": ("packmech_envs.quench:QuenchReward", "packmech_envs.quench_reward:QuenchReward"),
    "lattice_names": ("packmech.generate:LATTICE_NAMES", "packmech.generate:LATTICE_NAMES"),
}

# pattern of case names -> {pattern of array names at the tag: why the head has none}
GONE: dict[str, dict[str, str]] = {
    cases: {"*touching_t": "contacts are given with positions for every scene"}
    for cases in ("simulate/*", "checkpoint/*", "scenarios/two-spheres-central", "measure/effects of one's own")
} | {
    cases: {"*.density": "masses belong to the packing", "*.masses*": "masses belong to the packing"}
    for cases in ("files/*", "scenes/*")
}
GONE["contacts/links"] = {"*.loose_n": "called rattling_n"}
GONE["jamming/*"] = {"*.friction": "verdicts refuse scenes with friction"}
GONE["command/*"] = {"*friction_left_out": "verdicts refuse scenes with friction"}
GONE["cement/*"] = {"*least_new*": "called smallest_new"}


def _reference_masses(packing: Any) -> np.ndarray:
    """Return masses of one density, 1 for a particle of the reference diameter."""
    return (2.0 * packing.radius_n / packing.reference_diameter) ** packing.dimension


def _equal_masses(packing: Any) -> np.ndarray:
    """Return masses 1."""
    return np.ones(packing.particles)


# call -> the masses that it took at the tag unless given; at the head they are put into the packings of its scenes
MASSES: dict[str, Callable[[Any], np.ndarray]] = {
    **dict.fromkeys(
        (
            "simulate", "resume", "oscillatory_shear", "steady_shear", "ramp_strain", "creep", "equilibrate",
            "amplitude_sweep", "frequency_sweep", "shear_series", "complex_modulus", "ShearBatch", "Shear-v0",
        ),
        _reference_masses,
    ),
    **dict.fromkeys(("dynamical_matrix", "normal_modes", "density_of_states"), _equal_masses),
}  # fmt: skip
# what drives are given at the tag; at the head it is what packings have unless masses are given
_ONE = {"density": 1.0}
DENSITY: dict[str, dict[str, float]] = dict.fromkeys(
    ("SimulateDrive", "OscillatoryShearDrive", "SteadyShearDrive", "RampStrainDrive", "CreepDrive"), _ONE
)

# -- defaults, in the head's words; functions are called with the facade -----------------------------------------------

_AXES = {"axes": (0, 1)}
_STRAINED = {"method": lambda pm: pm.VelocityVerlet()}
_SHEARED = {"pre_periods": 0.0, "periods": 4.0, "post_periods": 0.0, "samples_per_period": 200, **_AXES}
_CRYSTAL = {"conventional": False, "relative_overlap": 0.0, "diameter": 1.0}
_BASIS = {"strain": "free", "gap_tolerance": 1e-9}
_CURVED = {"kind": "exact", "volume_curvature": "det", "gap_tolerance": 1e-9}
_COUNT = {"strain": "none", "gap_tolerance": 1e-9, "rank_tolerance": 1e-5, "method": "auto"}

STATED: dict[str, dict[str, Any]] = {
    # laws and effects
    "Harmonic": {"energy_scale": 1.0},
    "Hertz": {"energy_scale": 1.0},
    "LinearSpring": {"stiffness": 1.0},
    "PowerLaw": {"energy_scale": 1.0, "exponent": 2.0},
    "RepulsiveLennardJones": {"energy_scale": 1.0},
    "DivergentRepulsion": {"stiffness": 1.0, "divergence": 1.0, "cap": 1000.0},
    "ExponentialTension": {"stiffness": 1.0, "fraction": 0.2},
    "PlateauRepulsion": {"begin": 0.3, "end": 0.8, "slope": 0.1, "law": lambda pm: pm.LinearSpring()},
    "Repulsion": {"law": lambda pm: pm.Harmonic()},
    "BackgroundDamping": {"rate": 0.1},
    "ContactDamping": {"coefficient": 0.1, "onset": "jump"},
    "Friction": {"coefficient": 0.5, "stiffness": 1.0, "damping": 0.0},
    "Gravity": {"x": 0.0, "y": -1.0, "z": 0.0},
    "Walls": {"axis": 1.0, "low": 0.0, "high": 1.0, "law": lambda pm: pm.LinearSpring(), "damping": 0.0},
    "bond_contacts": {
        "compression": lambda pm: pm.LinearSpring(),
        "tension": lambda pm: pm.LinearSpring(),
        "tangential_stiffness": 1.0,
        "damping": 0.0,
        "tangential_damping": 0.0,
        "rest": "contact",
        "gap_tolerance": 0.0,
    },
    # starting packings
    "Monodisperse": {"scatter": 0.0},
    "Bidisperse": {"ratio": 1.4, "fraction": 0.5, "scatter": 0.0},
    "Mixture": {"scatter": 0.0},
    "Uniform": {"ratio": 1.4},
    "Normal": {"spread": 0.1},
    "LogNormal": {"spread": 0.1},
    "Dimer": {"length": 1.0, "radii": 0.5},
    "Trimer": {"length": 1.0, "angle": np.pi / 3.0, "radii": 0.5},
    "LinearCluster": {"length": 1.0, "radii": 0.5},
    "RingCluster": {"length": 1.0, "radii": 0.5, "rigid": True},
    "StarCluster": {"arm_beads": 1, "length": 1.0, "radii": 0.5, "rigid": True},
    "lattice_packing": _CRYSTAL,
    "reinforced_kagome_packing": _CRYSTAL,
    "tunneled_packing": {"relative_overlap": 0.0, "diameter": 1.0},
    "vacancy_packing": {"apart": False},
    "cluster_packing": {"crossing": "avoided", "tries": 1000},
    "chain_packing": {
        "link_length": 1.0,
        "angles": "free",
        "bend": 2.0 * np.pi / 3.0,
        "form": "open",
        "crossing": "avoided",
        "tries": 200,
    },
    "scattered_packing": {"largest_overlap": 0.1},
    "cut_fragments": {
        "edge_fuzziness": 0.0,
        "avoided_angle": np.pi / 12.0,
        "cut_top_bottom": False,
        "join_isolated": True,
        "removed_fraction": 0.0,
        "spanning": "avoided",
        "axis": 1,
        "tries": 100,
    },
    "rough_plates": {"layer": "crossing", "axis": 1},
    "material_constants": {
        "young_modulus": 8000.0,
        "poisson_ratio": 0.0,
        "density": 1000.0,
        "particles": 150,
        "packing_fraction": 1.5,
        "side": 500.0,
        "size_ratio": 1.4,
        "friction_coefficient": 0.01,
        "relative_viscosity": 0.1,
        "tangential_ratio": 1.0,
        "relative_frequency": 0.025,
        "period_decay": 0.5,
    },
    # contacts and measures
    "find_contacts": {"gap_tolerance": 0.0},
    "find_rattlers": {"gap_tolerance": 1e-9},
    "find_rattling_clusters": {"gap_tolerance": 1e-9},
    "remove_rattlers": {"gap_tolerance": 1e-9},
    "coordination_number": {"gap_tolerance": 0.0, "rattlers": "remove"},
    "stress_tensor": {"parts": "total"},
    "pressure": {"parts": "total"},
    "demodulate": {"skip_periods": 1.0},
    "mean_with_error": {"error": "standard", "draws": 2000, "seed": 0},
    "softening_strain": {"remaining": 0.9},
    # mechanics
    "rigidity_matrix": {"strain": "free", "gap_tolerance": 1e-9},
    "constrained_rigidity_matrix": _BASIS,
    "n_matrix": _BASIS,
    "change_of_basis": {"strain": "free"},
    "constraint_jacobian": {"strain": "none", "form": "exact", "strain_scale": 1.0},
    "constraint_basis": {"strain": "none", "method": "householder", "form": "exact", "rank_tolerance": 1e-10},
    "project_force": {"strain": "free", "method": "clusters"},
    "reaffix_links": {"tolerance": 1e-13, "iteration_limit": 50},
    "independent_links": {"strain": "none", "tolerance": 1e-9, "rank_tolerance": 1e-6},
    "floppy_modes": _COUNT,
    "states_of_self_stress": _COUNT,
    "hessian": {"strain": "free", **_CURVED},
    "dynamical_matrix": {"strain": "none", **_CURVED},
    "perturbation_energy": {"strain": "free", **_CURVED},
    "normal_modes": {"strain": "none", "rattlers": "remove", "method": "auto", **_CURVED},
    "density_of_states": {"bins": 50, "kind": "exact", "rattlers": "remove", "gap_tolerance": 1e-9},
    "elastic_moduli": {"kind": "exact", "rattlers": "remove", "gap_tolerance": 1e-9},
    "compliance_matrix": {"kind": "exact", "method": "sparse", "rattlers": "remove", "gap_tolerance": 1e-9},
    "complex_modulus": {"mode": "shear", **_AXES},
    "classify_jamming": {
        "method": "certificate",
        "solver": "clarabel",
        "strain": "free",
        "rest_tolerance": 1e-5,
        "tolerance": 1e-8,
        "bound": "ball",
        "seed": 0,
    },
    "play_motion": {"amplitude": 0.5, "steps": 50, "strain": "free", "overlap_tolerance": 1e-9},
    # minimizers and protocols
    "ConjugateGradient": {"slope_ratio": 0.1, "largest_step": 0.1},
    "DampedDynamics": {"damping": 1.0, "dt": 0.2, "largest_step": 0.1},
    "Fire": {
        "dt": 0.3,
        "dt_max": 0.6,
        "dt_min": 0.02,
        "delay": 10.0,
        "grow": 1.1,
        "shrink": 0.8,
        "mixing": 0.15,
        "mixing_decay": 0.97,
        "largest_step": 0.1,
    },
    "Fire2": {
        "dt": 0.1,
        "dt_max": 0.5,
        "dt_min": 0.002,
        "delay": 20.0,
        "grow": 1.1,
        "shrink": 0.5,
        "mixing": 0.25,
        "mixing_decay": 0.99,
        "largest_step": 0.1,
    },
    "GradientDescent": {"step": 0.8, "largest_step": 0.1},
    "SteepestDescent": {"tolerance": 1e-8, "largest_step": 0.1},
    "LBFGS": {"memory": 8, "slope_ratio": 0.9, "largest_step": 0.1},
    "Newton": {"largest_step": 0.1, "skin": 0.3},
    "quench": {"step_limit": 500_000},
    "HardVertex": {"quench_tolerance": 1e-3, "quench_steps": 200_000, "iteration_limit": 2000},
    "ProgramChain": {
        "stop_pressure": 1e-3,
        "quench_tolerance": 3e-3,
        "quench_steps": 500_000,
        "solver": "clarabel",
        "trust_radius": 0.05,
        "program_limit": 200,
    },
    "StepHalving": {
        "increment": 1e-4,
        "energy_tolerance": 1e-16,
        "quench_tolerance": 1e-5,
        "quench_steps": 1_000_000,
        "step_limit": 10_000,
    },
    "Decompression": {
        "stop_pressure": 1e-4,
        "factor": 0.15,
        "quench_tolerance": 1e-4,
        "quench_steps": 1_000_000,
        "iteration_limit": 2000,
    },
    "jam": {"strain": "free", "force_tolerance": 1e-5},
    "compress": {"strain": "isotropic", "force_tolerance": 1e-9, "iteration_limit": 2000},
    "shear_stabilize": {"force_tolerance": 1e-10, "step_limit": 200_000},
    "cement": {"seed": 0, "step": 0.05, "freeze": "angles", "kind": "unstressed", "gap_tolerance": 1e-9},
    "QuenchBatch": {
        "batch": 1,
        "relax": "full",
        "force_tolerance": 1e-8,
        "force_floor": 0.0,
        "method": lambda pm: pm.Fire(),
        "step_limit": 100_000,
        "threads": 1,
    },
    # motion and rheology
    "VelocityVerlet": {"fraction": 0.05},
    "SemiImplicitEuler": {"fraction": 0.05},
    "SteadyStrain": {"start": 0.0, "mode": "shear", **_AXES},
    "OscillatoryStrain": {"start": 0.0, "mode": "shear", **_AXES},
    "simulate": {"threads": 1, **_STRAINED},
    "resume": {"threads": 1},
    "equilibrate": {"largest_oscillation": 0.1, "step_limit": 500_000, **_STRAINED, **_AXES},
    "oscillatory_shear": {"carried": True, "strain_path": "exact", **_STRAINED, **_SHEARED},
    "amplitude_sweep": {**_STRAINED, **_SHEARED},
    "shear_series": {"repeats": 3, "controls": ("prepared",), "seed": 0, "error": "standard", **_SHEARED},
    "steady_shear": {"applied_strain": 3.0, "skip_strain": 1.0, "blocks": 8, "samples": 400, **_STRAINED, **_AXES},
    "ramp_strain": {"mode": "shear", "samples": 200, **_STRAINED, **_AXES},
    "creep": {**_STRAINED, **_AXES},
    "ShearBatch": {"control": "rate", "steps": 1, "switched_friction": False, "threads": 1, **_STRAINED, **_AXES},
    "ParticleShear": {
        "amplitude": 0.2,
        "friction_coefficient": 0.01,
        "young_modulus": 8000.0,
        "particles": 150,
        "packing_fraction": 1.5,
        "density": 50.0,
        "size_ratio": 1.4,
        "relative_viscosity": 0.1,
        "tangential_ratio": 1.0,
        "relative_frequency": 0.025,
        "divergence": 1.0,
        "reinforcement_normal": 1.0,
        "reinforcement_tangential": 1.0,
        "keep_viscosity": False,
        "pre_periods": 2.0,
        "periods": 3.0,
        "post_periods": 1.0,
        "cooling": 0.5,
        "law": "divergent",
    },
    # drives of scene files
    "JamDrive": {"strain": "free"},
    "QuenchDrive": {"force_tolerance": 1e-12},
    "OscillatoryShearDrive": {"largest_oscillation": 0.1, "carried": True, **_SHEARED},
    # pictures and tables
    "draw_frame": {"effects": (), "beads": 1.0, "size": (480, 480)},
    "work_precision": {"knob": "setting", "reference_is": "", "repeats": 3},
    "write_scene": {"description": ""},
    # environments, made by `Versions.make` and `Versions.make_vec`
    "Quench-v0": {
        "bonds": "refuse",
        "relax": "full",
        "force_tolerance": 1e-8,
        "force_floor": 0.0,
        "method": lambda pm: pm.Fire(),
        "start": "random",
        "largest_change": 0.05,
        "largest_strain": 0.05,
        "verdict": "collective",
        "shear_modulus": False,
        "step_budget": 40,
        "evaluation_budget": 50_000,
    },
    "Shear-v0": {
        "goal": "follow_stress",
        "control": "rate",
        "frame_skip": 20,
        "largest_strain": 0.2,
        "extra_actions": (),
        "start": "as_prepared",
        "relax": True,
        "links": "refuse",
        "budget": 200,
        "units": "scene",
    },
}


# Linked packings in the plane with deep overlaps are relaxed first so that no links cross; the tag lets them cross.
# These modules begin with that stage, which is left out here so that everything after it can be compared;
# tests/minimize/test_linked_minimizers.py proves what it does.
LEFT_OUT = ("packmech.minimize.quench", "packmech.protocols.linked_jam")


# -- the facade --------------------------------------------------------------------------------------------------------


class Call:
    """A public name under the head's words: states defaults and, at the tag, translates."""

    def __init__(self, versions: Versions, name: str, target: Callable[..., Any] | None = None) -> None:
        self._versions, self._name = versions, name
        self._target = versions.raw(name) if target is None else target

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call it with what is given and the stated defaults."""
        for name, value in STATED.get(self._name, {}).items():
            if name not in kwargs:
                kwargs[name] = value(self._versions) if callable(value) else value
        if self._versions.side == "head":
            if self._name in MASSES:
                mass_n = kwargs.pop("mass_n", None)
                args = tuple(self._with_masses(one, mass_n) for one in args)
                kwargs = {name: self._with_masses(one, mass_n) for name, one in kwargs.items()}
            return self._target(*args, **kwargs)
        renamed = RENAMED.get(self._name, {})
        translated: dict[str, Any] = {}
        for name, value in kwargs.items():
            old = renamed.get(name, name)
            translated |= {old: value} if isinstance(old, str) else old[value]
        translated = DENSITY.get(self._name, {}) | translated
        return RESULTS.get(self._name, _unchanged)(self._target(*args, **translated))

    def _with_masses(self, given: Any, mass_n: Any) -> Any:
        """Return a scene, or a list of them, with the masses of the tag in its packings; anything else as it is."""
        if isinstance(given, list) and given and hasattr(given[0], "packing"):
            return [self._with_masses(scene, mass_n) for scene in given]
        if not (hasattr(given, "packing") and hasattr(given, "effects")) or given.packing.given_mass_n is not None:
            return given
        packing = given.packing
        return given.replace(packing=packing.replace(mass_n=MASSES[self._name](packing) if mass_n is None else mass_n))

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of what is called, such as a class method."""
        return getattr(self._target, name)


class Versions:
    """The packmech that is importable, in the head's words.

    Parameters
    ----------
    side
        "head", or "tag": whose words the importable packmech speaks.

    """

    def __init__(self, side: str) -> None:
        if side not in SIDES:
            raise ValueError(f"names must be one of {SIDES}, got {side!r}")
        self.side = side
        self.module = importlib.import_module("packmech")
        if side == "head":
            for place in LEFT_OUT:
                importlib.import_module(place).separate = lambda program, packing, **_: (packing, 0)

    def __getattr__(self, name: str) -> Any:
        """Return a public name: what it is where nothing is to be stated or translated, else a call."""
        if name.startswith("__"):
            raise AttributeError(name)
        value = (
            Call(self, name)
            if name in STATED or name in RENAMED or name in MASSES or name in DENSITY
            else self.raw(name)
        )
        setattr(self, name, value)
        return value

    def raw(self, name: str) -> Any:
        """Return the object of this name itself, for `isinstance` and `scene.without`."""
        return getattr(self.module, name)

    def private(self, word: str) -> Any:
        """Return what is not public, by its word in `PRIVATE`."""
        return _found(PRIVATE[word][SIDES.index(self.side)])

    def benchmark(self, place: str) -> Any:
        """Return what a benchmark of this version's own checkout defines, such as "bench_march:make_start"."""
        folder = os.fspath(Path(self.module.__file__).parents[1] / "tests" / "benchmarks")
        if sys.path[0] != folder:
            sys.path.insert(0, folder)
        return _found(place)

    def make(self, name: str, **kwargs: Any) -> Any:
        """Return an environment such as "Quench-v0"."""
        import gymnasium

        return Call(self, name, functools.partial(gymnasium.make, f"packmech_envs:packmech/{name}"))(**kwargs)

    def make_vec(self, name: str, num_envs: int, **kwargs: Any) -> Any:
        """Return a batch of environments."""
        import gymnasium

        made = functools.partial(gymnasium.make_vec, f"packmech_envs:packmech/{name}", num_envs=num_envs)
        return Call(self, name, made)(**kwargs)

    def command(self, *words: str) -> int:
        """Run the command in this process and return its exit code; what it prints goes nowhere."""
        before, sys.argv = sys.argv, ["packmech", *words]
        said = io.StringIO()
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                runpy.run_module("packmech", run_name="__main__")
        except SystemExit as end:
            code = 0 if end.code is None else end.code
        else:
            code = 0
        finally:
            sys.argv = before
        if code not in (0, 1):
            raise RuntimeError(f"packmech {' '.join(words)} ended with {code}: {said.getvalue()[-2000:]}")
        return int(code)

    def load(self) -> None:
        """Import all modules that public names and environments are in."""
        for name in self.module.__all__:
            getattr(self.module, name)
        for name in ("packmech_envs", *(place.partition(":")[0] for place in self._places())):
            importlib.import_module(name)

    def _places(self) -> list[str]:
        return [places[SIDES.index(self.side)] for places in PRIVATE.values()]

    # -- results as named arrays ------------------------------------------------------------------------------------

    def record(self, results: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return everything in a case's results as arrays, under the head's names; times and prose are left out."""
        found: dict[str, np.ndarray] = {}
        for name, value in results.items():
            self._record(name, value, found)
        return found if self.side == "head" else dict(_in_heads_words(*one) for one in found.items())

    def _record(self, name: str, value: Any, found: dict[str, np.ndarray]) -> None:
        if value is None or isinstance(value, str):
            found[name] = np.array(str(value))
        elif isinstance(value, enum.Enum):
            self._record(name, value.name, found)
        elif isinstance(value, bool | int | float | complex | np.generic):
            found[name] = np.asarray(value)
        elif isinstance(value, np.ndarray):
            if value.dtype == object:
                self._record(name, list(value.ravel()), found)
            else:
                found[name] = value
        elif sp.issparse(value):
            found[name] = value.toarray()
        elif isinstance(value, Mapping):
            for key, part in value.items():
                if not _is_left_out(str(key), part):
                    self._record(f"{name}.{key}", part, found)
        elif dataclasses.is_dataclass(value) or hasattr(value, "_fields"):
            names = value._fields if hasattr(value, "_fields") else [field.name for field in dataclasses.fields(value)]
            for word in names:
                part = getattr(value, word)
                if not _is_left_out(word, part):
                    self._record(f"{name}.{word}", part, found)
        elif isinstance(value, tuple | list | set | frozenset):
            parts = sorted(value) if isinstance(value, set | frozenset) else value
            found[f"{name}.count"] = np.asarray(len(parts))
            for k, part in enumerate(parts):
                self._record(f"{name}.{k}", part, found)
        else:
            raise TypeError(f"{name} must be made of records, mappings, sequences and arrays, got {type(value)}")


# masses, which runs hold at the tag and packings at the head, and texts for readers
_PROSE = frozenset(
    {"mass_n", "given_mass_n", "note", "reason", "local_reason", "status", "name", "experiment", "about", "description"}
)


def _unchanged(result: Any) -> Any:
    """Return what is given."""
    return result


def _in_heads_words(name: str, array: np.ndarray) -> tuple[str, np.ndarray]:
    """Return the name and the array of a result of the tag in the head's words."""
    for old, new in NAMES.items():
        if name.endswith(old):
            name = name.removesuffix(old) + new
    for pattern, words in WORDS.items():
        if array.dtype.kind == "U" and array.ndim == 0 and fnmatch.fnmatchcase(name, pattern):
            return name, np.array(words.get(str(array), str(array)))
    return name, array


def _is_left_out(name: str, value: Any) -> bool:
    """Whether a field tells how long something took, or is prose."""
    return "seconds" in name or name in _PROSE or (callable(value) and not hasattr(value, "_fields"))


def _found(place: str) -> Any:
    """Return what "module:name" says."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)
