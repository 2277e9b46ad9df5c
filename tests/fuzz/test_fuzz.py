"""What chance finds: hostile calls and damaged files end well. More of them: python tests/fuzz/calls.py, files.py."""

import os
import time
import warnings

import numpy as np
import pytest
from arguments import METHODS, public, write_files
from fuzz.calls import HOSTILE, Fault, calls, fields_of, made, run
from fuzz.files import DAMAGES, damaged, originals
from fuzz.kills import COMMANDS, killed, load, undisturbed

# calls that compile little and return at once
QUICK = (
    *("Box", "Packing", "Links", "Mixture", "Bonds", "BondLimits", "Gravity", "Walls", "Friction", "Material"),
    *(
        "Materials",
        "Beads",
        "Spheroids",
        "Cluster",
        "FixedParticles",
        "Langevin",
        "JKR",
        "DMT",
        "MeshWalls",
        "Ellipses",
    ),
    *("lattice_packing", "mandel_tensor", "mandel_vector", "bootstrap", "histogram", "fit_power_law", "Snapshot"),
    *(
        "mean_with_error",
        "write_scene",
        "write_packing",
        "read_packing",
        "read_table",
        "Scene",
        "TangentialDisplacements",
    ),
    *(
        "Contacts.select",
        "Contacts.among",
        "Contacts.at",
        "Table.__getitem__",
        "Trace.__getitem__",
        "Snapshots.__getitem__",
    ),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("hostile")
    write_files(made)
    return made


@pytest.fixture(autouse=True)
def _files_of_hostile_names_elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def faults(asked, folder):
    found = (run(name, hostile, folder) for name, hostile in asked)
    return [f"{one.where} {one.call}: {one.what}" for one in found if one is not None]


@pytest.mark.parametrize("seed", range(3))
def test_hostile_arguments_of_quick_calls_get_an_answer_or_one_clear_error(seed, folder):
    assert set(QUICK) <= {*public(), *METHODS}
    assert faults(calls(np.random.default_rng(seed), list(QUICK), 1500, folder), folder) == []


# calls that once ended badly, found by chance
FOUND = (
    ("Table.tensor", {"name": "[]"}),
    ("Trace.table", {"about": "0"}),
    ("Snapshots.__getitem__", {"number": "Decimal nan"}),
    ("WorkPrecision.cheapest", {"error_below": "Decimal nan"}),
    ("stiffness_matrix", {"strain_scale": "1e+200"}),
    ("stiffness_matrix", {"strain_scale": "5e-324"}),
    ("cut_fragments", {"lines": "9223372036854775807"}),
    ("chain_packing", {"link_length": "2147483648"}),
    ("tap", {"pressure": "1e+308"}),
    ("cyclic_shear", {"pressure": "9.223372036854776e+18"}),
    ("shear_jam", {"force_tolerance": "5e-324"}),
    ("oscillatory_shear", {"dt": "1e-12"}),
    ("QuenchVectorEnv", {"threads": "2147483648"}),
    ("QuenchVectorEnv.step", {"actions": "pretender"}),
    ("ShearEnv", {"task": "list of shy"}),
    ("ShearEnv", {"scene": "long name"}),
    ("ShearEnv", {"render_mode": "shy"}),
    ("ShearEnv", {"start": "shy"}),
    ("ShearEnv.step", {"action": "huge range"}),
    ("ShearVectorEnv", {"num_envs": "9223372036854775808"}),
    ("ShearVectorEnv", {"max_episode_steps": "shy"}),
    ("ShearVectorEnv.reset", {"seed": "huge range"}),
    ("demodulate", {"periods": "2147483648"}),
    ("write_pictures", {"folder": "device"}),
    ("WorkPrecision.order", {"quantity": "shy"}),
    ("WorkPrecision.of", {"method": "shy"}),
    ("record_packing", {"path": "surrogate"}),
    ("Recording", {"path": "surrogate"}),
    ("Recording", {"path": "no folder"}),
    ("rough_plates", {"layer": "shy"}),
    ("mean_square_displacement", {"lags": "pretender"}),
    ("self_scattering", {"lags": "huge range"}),
    ("viscoelastic_time", {"masses": "huge in list"}),
    ("read_ensemble", {"folder": "very long text"}),
    ("run_ensemble", {"folder": "very long text"}),
    ("shear_series", {"folder": "device"}),
    ("chain_packing", {"radii": "huge range"}),
    ("chain_packing", {"radii": "1e+18"}),
    ("chain_packing", {"radii": "1e+308"}),
    ("chain_packing", {"angles": "pretender"}),
    ("count_modes", {"below": "pretender"}),
    ("count_modes", {"below": "long"}),
    ("classify_jamming", {"tiled": "pretender"}),
    ("export_scene", {"folder": "device"}),
    ("work_precision", {"error": "raises"}),
    ("work_precision", {"reference": "pretender"}),
    ("design", {"at_least": "10**400"}),
    ("classify_jamming", {"rest_tolerance": "shy"}),
    ("coefficient_of_restitution", {"speed": "1e-200"}),
    ("coefficient_of_restitution", {"speed": "1e-12"}),
    ("viscoelastic_time", {"speed": "1e+308"}),
    ("coarse_grain", {"width": "5e-324"}),
    ("coarse_grain", {"width": "1000000.0"}),
    ("displaced", {"turn_nk": "huge range"}),
    ("density_of_states", {"repeats": "pair of huge"}),
    ("sensitivity", {"of": "shy", "to": "generator"}),
    ("cut_fragments", {"centers": "9007199254740993"}),
    ("shear_families", {"applied_strain": "1e+308"}),
    ("oscillatory_shear", {"frames": "9007199254740993"}),
    ("draw_frame", {"rattler_n": "pretender"}),
    ("displaced_rest", {"pressure": "7"}),
    ("creep", {"inertia": "1e+308"}),
    ("work_precision", {"settings": "long"}),
    ("settings_for", {"target": "huge range"}),
    ("coefficient_of_restitution", {"kinds": "pretender"}),
    ("material_constants", {"side": "1e-200"}),
    ("material_constants", {"side": "1e+200"}),
    ("resume_ensemble", {"members": "long"}),
    ("shear_series", {"samples_per_period": "10**5000"}),
    ("shear_series", {"samples_per_period": "recursive"}),
    ("run_ensemble", {"grid": "pretender"}),
    ("work_precision", {"settings": "pretender"}),
    ("cement", {"order": "huge range"}),
    ("cement", {"step": "1e+308"}),
    ("oscillatory_shear", {"frequency": "1e+308"}),
    ("shear_series", {"frictions": "huge range"}),
    ("write_trajectory", {"snapshots": "pretender"}),
    ("anneal_shape", {"aspects": "pair of huge"}),
    ("steady_shear", {"dt": "1e-12"}),
    ("amplitude_sweep", {"dt": "1e-12"}),
)


@pytest.mark.parametrize("name, hostile", FOUND)
def test_calls_that_once_ended_badly_do_not_any_more(name, hostile, folder):
    assert set(hostile) <= set(fields_of(name, folder)) | {"start"}
    assert faults([(name, hostile)], folder) == []


def test_calls_that_end_their_process_or_never_come_back_are_faults_and_the_rest_is_made(monkeypatch, tmp_path):
    def one(name, hostile, folder):
        if hostile["at"] == "end":
            os._exit(3)
        if hostile["at"] == "stay":
            time.sleep(600.0)
        return Fault("a", "b", "c") if hostile["at"] == "fault" else None

    monkeypatch.setattr("fuzz.calls.run", one)
    monkeypatch.setattr("fuzz.calls.LOST", 0.5)
    asked = [("name", {"at": what}) for what in ("well", "end", "well", "stay", "fault", "end")]
    ends = [one and one.what for one in made(asked, tmp_path)]
    assert ends == [None, "ended the process: 3", None, "never came back", "b", "ended the process: 3"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*public(), *METHODS])
def test_every_hostile_value_at_every_parameter_gets_an_answer_or_one_clear_error(name, folder):
    asked = [(name, {field: value}) for field in fields_of(name, folder) for value in HOSTILE]
    assert faults(asked, folder) == []


def test_damaged_files_are_read_as_they_were_or_refused_by_name_and_under_a_seal_as_nothing_else(tmp_path):
    rng = np.random.default_rng(1)
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, (path, read) in originals(tmp_path).items():
            for damage in DAMAGES:
                found += [damaged(name, path, read, damage, rng)[0] for _ in range(3)]
    assert [one for one in found if one] == []


@pytest.mark.slow
def test_commands_that_are_killed_at_random_times_end_with_the_bits_of_one_that_nobody_disturbed(tmp_path):
    load(tmp_path)
    rng = np.random.default_rng(1)
    for k, command in enumerate(COMMANDS.values()):
        right = undisturbed(command, tmp_path / f"right-{k}")
        assert killed(command, tmp_path / f"killed-{k}", right, 3, rng)[1] == []
