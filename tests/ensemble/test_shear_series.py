"""Series of shears: controls are what their names say, and trials go on with the same bits wherever they are run."""

import dataclasses
import os
import signal

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import Engine
from packmech.rheology import strain_run

LAW = pm.LinearSpring()
SINE = {"frequency": 0.05, "samples_per_period": 20}
SERIES = {
    "amplitudes": [1e-4, 1e-3],
    "repeats": 2,
    "frictions": [0.2, 0.5],
    "controls": ("prepared", "bulk", "uncrosslinked", "frictionless"),
    "frequency": 0.1,
    "periods": 6.0,
    "samples_per_period": 20,
}


@pytest.fixture(scope="module")
def scene():
    """Discs with friction at rest, every second contact a bond; the effects of test_rheology."""
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
    start = start.replace(mass_n=(start.diameter_n / start.reference_diameter) ** 2)
    packing = pm.quench(pm.Scene(start, (pm.Repulsion(law=LAW),)), force_tolerance=1e-12).packing
    bonds = pm.bond_contacts(
        packing, compression=LAW, tension=LAW, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3
    )
    bonds = bonds.select(np.arange(len(bonds)) % 2 == 0)
    return pm.Scene(
        packing,
        (pm.Repulsion(law=LAW), pm.ContactDamping(0.3), pm.Friction(0.5, 0.6, 0.2), bonds, pm.BackgroundDamping(0.02)),
    )


def bits(series):
    """Return what trials say but for their CPU times, as bytes."""
    names = [field.name for field in dataclasses.fields(pm.ShearTrial) if field.name != "seconds"]
    return {key: [np.asarray(getattr(trial, name)).tobytes() for name in names] for key, trial in series.trials.items()}


@pytest.fixture(scope="module")
def prepare(scene):
    def turned(seed):
        """Return the scene mirrored or not: repeats that differ, at no cost."""
        shift = np.random.default_rng(seed).random(2)
        return scene.replace(packing=scene.packing.replace(position_nd=scene.packing.position_nd + shift))

    return turned


@pytest.mark.slow
def test_a_series_is_resumed_from_its_folder_with_the_same_bits_and_knows_its_controls(prepare, tmp_path):
    whole = pm.shear_series(prepare, **SERIES)
    seen = []

    def stop(*trial):
        seen.append(trial)
        if len(seen) == 9:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pm.shear_series(prepare, tmp_path, progress=stop, **SERIES)
    assert pm.read_ensemble(tmp_path).counts()["done"] == 9
    again = pm.shear_series(prepare, tmp_path, **SERIES)
    assert len(whole.trials) == 2 * 2 * 7
    assert bits(again) == bits(whole)
    # every control is what its name says: the moduli of that network in the frequency domain
    scene = prepare(1)
    pairs, dashpots, friction, bonds, drag = scene.effects
    whole_bonds = pm.bond_contacts(
        scene.packing, compression=LAW, tension=LAW, tangential_stiffness=0.5, damping=0.4, tangential_damping=0.3
    )
    for name, rub, effects in (
        ("prepared", 0.5, scene.effects),
        ("bulk", 0.5, (pairs, dashpots, friction, whole_bonds, drag)),
        ("uncrosslinked", 0.5, (pairs, dashpots, friction, drag)),
        ("frictionless", None, (pairs, dashpots, bonds, drag)),
    ):
        exact = pm.complex_modulus(pm.Scene(scene.packing, effects), [0.1]).modulus_f[0]
        found = again.curve(name, rub)
        assert abs(found.storage_a[0] + 1j * found.loss_a[0] - exact) < 0.02 * abs(exact)
        assert found.storage_error_a[0] < 0.01 * abs(exact)
    # another preparation is other members
    pm.shear_series(lambda seed: prepare(seed + 1), tmp_path, **(SERIES | {"repeats": 1, "amplitudes": [1e-3]}))
    assert len(pm.read_ensemble(tmp_path)) == 28 + 7
    assert bits(pm.shear_series(prepare, tmp_path, **SERIES)) == bits(whole)


SHORT = {"amplitudes": [0.01], "repeats": 2, "controls": ("prepared", "bulk"), "periods": 2.0, **SINE}


def test_an_interrupted_series_goes_on_with_the_same_bits(prepare, tmp_path):
    whole = pm.shear_series(prepare, **SHORT)
    assert [key[:3] for key in whole.trials][:3] == [("prepared", None, 0), ("bulk", None, 0), ("prepared", None, 1)]
    seen = []

    def stop(*trial):
        seen.append(trial)
        if len(seen) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pm.shear_series(prepare, tmp_path, progress=stop, **SHORT)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("workspace/*/result.json")}
    assert len(before) == 3 and len(list(tmp_path.glob("scenes/*.toml"))) == 2
    assert bits(pm.shear_series(prepare, tmp_path, **SHORT)) == bits(whole)
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_two_processes_one_of_them_killed_give_the_same_bits_as_none(prepare, tmp_path, children):
    killed = []

    def kill(*trial):
        there = children(os.getpid())
        if there and not killed:
            killed.append(there[0])
            os.kill(there[0], signal.SIGKILL)

    found = pm.shear_series(prepare, tmp_path, workers=2, progress=kill, **SHORT)
    assert killed
    assert bits(found) == bits(pm.shear_series(prepare, **SHORT))


def test_what_a_trial_refuses_passes_on_from_here_and_from_other_processes(prepare, tmp_path):
    given = SHORT | {"samples_per_period": 1}
    with pytest.raises(ValueError, match="^samples_per_period must be") as here:
        pm.shear_series(prepare, tmp_path / "here", **given)
    with pytest.raises(ValueError, match="^samples_per_period must be.*4 of 4 members failed") as there:
        pm.shear_series(prepare, tmp_path / "there", workers=1, **given)
    assert str(there.value).startswith(str(here.value))
    with pytest.raises(ValueError, match="^periods must be a finite number at least 1"):
        pm.shear_series(prepare, **(SHORT | {"periods": 0.5}))
    # failures stay, and are of other members
    assert pm.read_ensemble(tmp_path / "here").counts()["failed"] == 1
    assert len(pm.shear_series(prepare, tmp_path / "here", **SHORT).trials) == 4


def steps_taken(monkeypatch):
    """Return a list that gets the steps of every advance from now on."""
    taken, usual = [], Engine.advance

    def advance(engine, steps, ledger=None):
        taken.append(steps)
        return usual(engine, steps, ledger)

    monkeypatch.setattr(Engine, "advance", advance)
    return taken


def test_a_trial_of_a_series_goes_on_where_it_was(scene, tmp_path, monkeypatch):
    given = {"amplitudes": [0.1], "repeats": 1, "periods": 4, **SINE}
    # look up every few steps
    monkeypatch.setattr(strain_run, "_CHUNK", 2000)
    usual, taken = Engine.advance, steps_taken(monkeypatch)
    whole = pm.shear_series(lambda seed: scene, **given)
    steps = sum(taken)

    def advance(engine, due, ledger=None):
        if engine.steps > steps // 2:
            monkeypatch.setattr(Engine, "advance", usual)
            signal.raise_signal(signal.SIGINT)
        return usual(engine, due, ledger)

    monkeypatch.setattr(Engine, "advance", advance)
    with pytest.raises(KeyboardInterrupt):
        pm.shear_series(lambda seed: scene, tmp_path, **given)
    taken = steps_taken(monkeypatch)
    again = pm.shear_series(lambda seed: scene, tmp_path, **given)
    (key,) = whole.trials
    assert again.trials[key].stress_tdd.tobytes() == whole.trials[key].stress_tdd.tobytes()
    assert 0 < sum(taken) < steps // 2
    assert not list(tmp_path.glob("workspace/*/checkpoint.npz"))
