"""Facts about calls that may last: each shows what it does, and after Ctrl-C gives what it had."""

import inspect

import pytest

import packmech as pm

# calls that end within two seconds at any size that fits in memory, or only make what others use
SHORT = {
    *("assign_kinds", "at_packing_fraction", "bond_contacts", "change_of_basis", "contact_distance", "contact_forces"),
    *("coefficient_of_restitution", "viscoelastic_time"),
    *("contact_statistics", "coordination_number", "correlation_function", "crossing_links", "cut_fragments"),
    *(
        "constrained_rigidity_matrix",
        "constraint_basis",
        "constraint_jacobian",
        "contact_dissipation",
        "displaced",
        "displacements",
        "draw_frame",
    ),
    *("dynamical_matrix", "energy", "fill_box", "find_contacts", "find_rattlers", "find_shape_contacts"),
    *("force_chains", "force_distribution", "forces", "hessian", "lattice_packing", "link_tension"),
    *("material_constants", "n_matrix", "nematic_order", "observable", "packing_fraction", "pressure"),
    *("project_force", "random_packing", "bead_packing", "rigidity_matrix", "rough_plates", "reaffix_links"),
    *("remove_rattlers", "reinforced_kagome_packing", "tunneled_packing", "vacancy_packing", "stiffness_matrix"),
    *("stress_tensor", "torques", "wall_contacts", "wave_indices", "wave_vectors", "bond_orientational_order"),
    *(
        "shell_average",
        "write_scene",
        "export_scene",
        "read_scene",
        "plot",
        "write_table",
        "read_trajectory",
        "snapshots",
    ),
}
# calls on what a long one returned, or that register something
ON_RESULTS = {
    *("bootstrap", "demodulate", "fit_power_law", "group_statistics", "histogram", "mean_with_error", "read_ensemble"),
    *("to_ase", "from_ase", "to_freud", "from_freud", "to_hoomd", "from_hoomd", "to_networkx", "from_networkx"),
    *(
        "soft_spots",
        "softening_strain",
        "yield_strain",
        "small_value_exponent",
        "mandel_tensor",
        "mandel_vector",
        "read_law",
    ),
    *("read_table", "list_scenes", "drive", "effect", "law", "minimizer", "packing_kind", "kernel", "soft_spots"),
}


def test_every_call_that_may_last_shows_what_it_does():
    silent = []
    for name in pm.__all__:
        call = getattr(pm, name)
        if not inspect.isfunction(call) or name in SHORT | ON_RESULTS:
            continue
        if not hasattr(call, "shown_as") and "progress" not in inspect.signature(call).parameters:
            silent.append(name)
    assert silent == []


def discs(count=16, fraction=0.9):
    packing = pm.random_packing(count, dimension=2, packing_fraction=fraction, seed=1)
    return pm.Scene(packing, (pm.Repulsion(),))


def damped(count=16):
    scene = discs(count)
    rest = pm.quench(scene, force_tolerance=1e-10).packing
    return scene.replace(packing=rest, effects=(*scene.effects, pm.BackgroundDamping(0.2)))


def jammed(count=16, pressure=1e-3):
    scene = discs(count)
    return scene.replace(packing=pm.jam(scene, pressure).packing)


CALLS = {
    "quench": lambda progress: pm.quench(discs(64), force_tolerance=1e-12, progress=progress),
    "jam": lambda progress: pm.jam(discs(), 1e-3, progress=progress),
    "compress": lambda progress: pm.compress(discs(16, 0.6), [1e-3, 2e-3], progress=progress),
    "sweep_pressure": lambda progress: pm.sweep_pressure(jammed(), [2e-3, 4e-3], progress=progress),
    "shear_stabilize": lambda progress: pm.shear_stabilize(jammed(), progress=progress),
    "quasistatic_shear": lambda progress: pm.quasistatic_shear(jammed(), 0.05, progress=progress),
    "local_yield_stress": lambda progress: pm.local_yield_stress(
        jammed(128), [[3.0, 3.0], [6.0, 6.0]], radius=1.5, progress=progress
    ),
    "deform": lambda progress: pm.deform(jammed(), strain={"xy": 0.05}, progress=progress),
    "deform_at_rate": lambda progress: pm.deform_at_rate(damped(), rate=0.1, strain={"xy": 200.0}, progress=progress),
    "cyclic_shear": lambda progress: pm.cyclic_shear(jammed(), 0.02, 2, progress=progress),
    "shear_families": lambda progress: pm.shear_families(jammed().packing, 0.01, progress=progress),
    "tap": lambda progress: pm.tap(jammed(), 0.1, 2, seed=1, pressure=1e-3, progress=progress),
    "simulate": lambda progress: pm.simulate(damped(), duration=50.0, trace_every=20, progress=progress),
    "oscillatory_shear": lambda progress: pm.oscillatory_shear(
        damped(), amplitude=1e-3, frequency=2e-4, periods=4, progress=progress
    ),
    "steady_shear": lambda progress: pm.steady_shear(
        damped(), rates=[0.1], applied_strain=200.0, skip_strain=0.1, progress=progress
    ),
    "ramp_strain": lambda progress: pm.ramp_strain(damped(), rate=0.1, applied_strain=200.0, progress=progress),
    "creep": lambda progress: pm.creep(damped(), stress=1e-4, duration=2e4, progress=progress),
    "amplitude_sweep": lambda progress: pm.amplitude_sweep(
        damped(), amplitudes=[1e-3, 2e-3], frequency=2e-4, periods=4, progress=progress
    ),
    "play_motion": lambda progress: pm.play_motion(
        pm.lattice_packing("square", repeats=(3, 3)),
        pm.classify_jamming(pm.lattice_packing("square", repeats=(3, 3))).unjamming_motion,
        progress=progress,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_a_call_that_is_interrupted_gives_what_it_had(name):
    def press(stage, figures):
        if stage != "start":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        CALLS[name](press)
    kept = getattr(stop.value, "run", None) or stop.value.runs
    assert kept is not None
