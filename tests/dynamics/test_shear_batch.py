"""Batches of sheared packings: the bits of each alone, the paths of oscillatory_shear, and what becomes of failures."""

import math
from functools import cache

import numpy as np
import pytest

import packmech as pm

AMPLITUDE, FREQUENCY = 2e-3, 0.02


@cache
def plain(seed, n=24):
    packing = pm.random_packing(n, dimension=2, packing_fraction=0.9, seed=seed)
    # mass 1 for a small disc
    packing = packing.replace(mass_n=(packing.diameter_n / packing.reference_diameter) ** 2)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-8, check=False).packing)


@cache
def frictional(seed):
    """A scene whose loss modulus is as large as its storage modulus."""
    effects = (pm.Friction(coefficient=0.5, stiffness=0.5, damping=1.0), pm.ContactDamping(coefficient=2.0))
    scene = plain(seed)
    return scene.replace(effects=(*scene.effects, *effects))


@cache
def rolling(seed):
    """A scene whose contacts resist rolling, too."""
    scene = frictional(seed)
    return scene.replace(effects=(*scene.effects, pm.RollingResistance(0.2, 0.3, 0.1)))


def shaken(batch, frames, seed):
    rng = np.random.default_rng(seed)
    for _ in range(frames):
        batch.advance(rng.uniform(-2e-3, 2e-3, (len(batch), batch.controls)))
    return batch


def rolling_without_springs(seed):
    """A scene whose contacts damp rolling."""
    scene = frictional(seed)
    return scene.replace(effects=(*scene.effects, pm.ViscousRolling(5.0)))


@pytest.mark.parametrize("make", [plain, frictional, rolling, rolling_without_springs])
def test_a_packing_in_a_batch_has_the_bits_of_the_packing_alone_on_any_number_of_threads(make):
    scenes = [make(seed) for seed in range(5)]
    rng = np.random.default_rng(0)
    rates = rng.uniform(-0.02, 0.02, (60, 5, 1))
    batches = {threads: pm.ShearBatch(scenes, control="rate", steps=3, threads=threads) for threads in (1, 2, 3)}
    alone = [pm.ShearBatch([scene], control="rate", steps=3, dt=batches[1].dt) for scene in scenes]
    for k in range(len(rates)):
        for batch in batches.values():
            batch.advance(rates[k])
        for b, one in enumerate(alone):
            one.advance(rates[k, b : b + 1])
    for batch in batches.values():
        for b, one in enumerate(alone):
            assert np.array_equal(batch.figure_bk[b], one.figure_bk[0])
            assert batch.packing(b) == one.packing(0)
            assert np.array_equal(batch.velocities(b), one.velocities(0))
        batch.close()


def test_a_packing_that_rests_while_others_move_goes_on_as_if_nothing_had_been():
    rates = np.random.default_rng(1).uniform(-0.02, 0.02, (20, 2, 1))
    busy, lazy = (pm.ShearBatch([plain(0), plain(1)], steps=2) for _ in range(2))
    for one in rates:
        busy.advance(one)
    for one in rates:
        lazy.advance(one, np.array([True, False]))
    for one in rates:
        lazy.advance(one, np.array([False, True]))
    assert np.array_equal(busy.figure_bk, lazy.figure_bk)


@pytest.mark.parametrize("make", [frictional, rolling])
@pytest.mark.parametrize(("control", "path"), [("strain", "increments"), ("strain_and_rate", "exact")])
def test_a_scripted_sine_has_the_moduli_of_oscillatory_shear(control, path, make):
    scene = make(3)
    run = pm.oscillatory_shear(scene, amplitude=AMPLITUDE, frequency=FREQUENCY, periods=2, strain_path=path)
    every = run.steps // (len(run.time_t) - 1)
    batch = pm.ShearBatch([scene], control=control, dt=run.dt)
    omega = 2.0 * math.pi * FREQUENCY
    batch.restart(0, rate=AMPLITUDE * omega if path == "exact" else 0.0)
    rows = [batch.figure_bk[0].copy()]
    for k in range(1, run.steps + 1):
        phase = omega * k * run.dt
        rates = [AMPLITUDE * math.sin(phase), AMPLITUDE * omega * math.cos(phase)]
        batch.advance(np.array([rates[: batch.controls]]))
        if k % every == 0:
            rows.append(batch.figure_bk[0].copy())
    figures = dict(zip(batch.names, np.array(rows).T, strict=True))
    moduli = pm.demodulate(omega * figures["time"], figures["stress_xy"], amplitude=AMPLITUDE, periods=2)
    assert 0.3 < run.moduli.loss / run.moduli.storage < 3.0
    assert moduli.storage == pytest.approx(run.moduli.storage, rel=1e-12)
    assert moduli.loss == pytest.approx(run.moduli.loss, rel=1e-12)
    size = np.abs(run.shear_stress_t).max()
    assert np.abs(figures["stress_xy"] - run.shear_stress_t).max() <= 1e-12 * size
    assert np.array_equal(figures["contacts"], run.contacts_t)
    assert figures["pressure"] == pytest.approx(run.pressure_t, rel=1e-12)
    assert figures["kinetic_energy"] == pytest.approx(run.kinetic_t + run.rotational_t, abs=1e-12 * size)


def test_without_friction_and_damping_the_work_of_the_shear_is_what_the_energies_gain_to_second_order():
    def lost(dt, steps):
        batch = pm.ShearBatch([plain(2)], control="rate", dt=dt)
        columns = {name: k for k, name in enumerate(batch.names)}
        start = batch.figure_bk[0, columns["elastic_energy"]]
        most = 0.0
        for k in range(steps):
            batch.advance(np.array([[2e-3 * math.sin(2.0 * math.pi * (k + 0.5) / steps)]]))
            now = batch.figure_bk[0]
            gained = now[columns["kinetic_energy"]] + now[columns["elastic_energy"]] - start
            most = max(most, abs(now[columns["work"]] - gained))
        return most

    coarse, fine = lost(0.05, 400), lost(0.025, 800)
    assert 3.0 < coarse / fine < 5.0


def test_a_restart_leaves_nothing_of_what_was_before():
    used, new = (pm.ShearBatch([frictional(0), frictional(1)], steps=2) for _ in range(2))
    shaken(used, 30, 0)
    used.restart(1)
    used.restart(0, frictional(0), rate=0.0)
    assert np.array_equal(used.figure_bk, new.figure_bk)
    shaken(used, 30, 1), shaken(new, 30, 1)
    assert np.array_equal(used.figure_bk, new.figure_bk)


def test_large_strains_are_carried_by_other_lattice_vectors_and_come_back():
    batch = pm.ShearBatch([plain(0)], control="strain", steps=40)
    path = [*np.linspace(0.1, 2.5, 25), *np.linspace(2.4, 0.0, 25)]
    for k, strain in enumerate(path):
        assert batch.advance(np.array([[strain]])).all()
        if k % 7 != 0:
            continue
        packing = batch.packing(0)
        scene = plain(0).replace(packing=packing)
        column = batch.names.index("pressure")
        assert batch.figure_bk[0, column] == pytest.approx(pm.pressure(scene), rel=1e-9)
    assert batch.packing(0).box.lattice_dd == pytest.approx(plain(0).packing.box.lattice_dd, abs=1e-12)


def test_one_jump_of_the_strain_within_a_frame_is_taken_in_parts():
    batch = pm.ShearBatch([plain(0), plain(1)], control="strain", steps=10)
    assert batch.advance(np.array([[1.7], [0.0]])).all()
    scene = plain(0).replace(packing=batch.packing(0))
    assert batch.figure_bk[0, batch.names.index("elastic_energy")] == pytest.approx(pm.energy(scene), rel=1e-9)
    assert batch.figure_bk[0, 1] == 1.7


def exploding():
    """Two particles so near to each other that the first step throws them far apart.

    Their law is soft where particles touch, so that the step is not too long for any contact of little overlap.
    """
    packing = pm.Packing([[1.0, 1.0], [1.01, 1.0], [3.0, 3.0]], [0.5] * 3, pm.Box.cubic(6.0, 2))
    return pm.Scene(packing, (pm.Repulsion(pm.PowerLaw(1e3, 6.0)),))


def test_a_packing_that_moves_too_fast_is_put_back_and_rests_until_it_is_restarted():
    calm = pm.Packing([[1.0, 1.0], [1.9999, 1.0], [3.0, 3.0]], [0.5] * 3, pm.Box.cubic(6.0, 2))
    scenes = [exploding(), exploding().replace(packing=calm)]
    batch = pm.ShearBatch(scenes, control="rate", dt=1.0)
    start = batch.figure_bk.copy()
    assert batch.advance(np.array([[0.01], [0.01]])).tolist() == [False, True]
    assert [batch.outcome(b) for b in (0, 1)] == [pm.Outcome.STEP_TOO_LONG, pm.Outcome.FINISHED]
    assert np.array_equal(batch.figure_bk[0], start[0])
    assert batch.packing(0) == scenes[0].packing
    assert batch.advance(np.array([[0.01], [0.01]])).tolist() == [False, True]
    assert np.array_equal(batch.figure_bk[0], start[0])
    assert batch.figure_bk[1, 0] == 2.0
    batch.restart(0, scenes[1])
    assert batch.advance(np.array([[0.0], [0.0]])).all()


def test_a_strain_that_breaks_a_frame_after_particles_were_wrapped_leaves_the_last_good_packing():
    stiff = plain(0).replace(effects=(pm.Repulsion(law=pm.Harmonic(energy_scale=400.0)),))
    batch = pm.ShearBatch([stiff], control="strain", steps=50, dt=0.05)
    before = None
    for strain in (0.3, 0.9, 1.6, 2.0, 3.0, 4.0, 6.0, 9.0):
        before = batch.packing(0), batch.figure_bk.copy()
        if not batch.advance(np.array([[strain]])).all():
            break
    assert batch.outcome(0) is pm.Outcome.STEP_TOO_LONG
    now = batch.packing(0)
    assert now.box == before[0].box
    assert now.position_nd == pytest.approx(before[0].position_nd, abs=1e-9)
    assert np.array_equal(batch.figure_bk, before[1])


def test_a_friction_of_zero_by_switch_is_none_and_the_scenes_own_is_no_change():
    scene = frictional(1)
    bare, own, off = (
        pm.ShearBatch([scene], steps=2, dt=0.02, switched_friction=switched) for switched in (False, True, True)
    )
    for rate in np.random.default_rng(2).uniform(-0.02, 0.02, 40):
        bare.advance(np.array([[rate]]))
        own.advance(np.array([[rate, 0.5]]))
        off.advance(np.array([[rate, 0.0]]))
    sliding = bare.names.index("sliding_fraction")
    assert np.array_equal(bare.figure_bk, own.figure_bk)
    assert off.figure_bk[0, sliding] == 1.0 > bare.figure_bk[0, sliding]


def test_a_frame_that_is_cut_by_wrapping_goes_on_with_the_friction_it_was_switched_to():
    scene = frictional(1)
    weak = scene.replace(effects=tuple(
        one._replace(coefficient=0.1) if isinstance(one, pm.Friction) else one for one in scene.effects
    ))  # fmt: skip
    switched = pm.ShearBatch([scene], control="strain", steps=400, dt=0.02, switched_friction=True)
    own = pm.ShearBatch([weak], control="strain", steps=400, dt=0.02)
    for strain in (0.5, 1.0, 1.6):
        switched.advance(np.array([[strain, 0.1]]))
        own.advance(np.array([[strain]]))
        assert np.array_equal(switched.figure_bk, own.figure_bk)
    assert switched._engines[0].wrap_nd.any()


def test_a_frictionless_batch_holds_no_history_and_no_spins():
    batch = pm.ShearBatch([plain(0)])
    engine = batch._engines[0]
    assert engine.track is None and engine.acting.friction is None
    assert engine.state.spins == () and engine.state.push.shape[1] == 2
    assert batch.spins(0) is None
    assert pm.ShearBatch([frictional(0)]).spins(0).shape == (24, 1)


def test_what_a_batch_is_told_must_be_numbers_of_its_shape():
    for threads in (1, 2):
        batch = pm.ShearBatch([plain(0), plain(1)], control="rate", threads=threads)
        before = batch.figure_bk.copy()
        with pytest.raises(ValueError, match=r"control_bk must be finite, got \[nan\] for packing 1"):
            batch.advance(np.array([[0.1], [np.nan]]))
        with pytest.raises(ValueError, match=r"control_bk must have shape \(2, 1\), got \(1, 2\)"):
            batch.advance(np.array([[0.1, 0.1]]))
        with pytest.raises(TypeError, match="control_bk must be an array of real numbers"):
            batch.advance([["a"], ["b"]])
        with pytest.raises(ValueError, match="active_b must be 2 times True or False"):
            batch.advance(np.zeros((2, 1)), np.ones(3, dtype=bool))
        assert np.array_equal(batch.figure_bk, before)


def test_the_time_step_of_a_batch_is_the_smallest_of_its_scenes_in_whatever_order():
    light = plain(0)
    light = light.replace(packing=light.packing.replace(mass_n=0.25 * light.packing.mass_n))
    alone = pm.ShearBatch([light]).dt
    assert alone == pytest.approx(0.5 * pm.ShearBatch([plain(0)]).dt, rel=1e-12)
    assert pm.ShearBatch([plain(1), light]).dt == pm.ShearBatch([light, plain(1)]).dt == alone
    assert pm.ShearBatch([plain(1), light], dt=0.1).dt == 0.1


def test_scenes_of_a_batch_must_be_alike():
    with pytest.raises(ValueError, match=r"scenes\[1\] must have the kinds of effects of the first scene"):
        pm.ShearBatch([plain(0), frictional(0)])
    space = pm.Scene(pm.lattice_packing("fcc", repeats=(2, 2, 2)), (pm.Repulsion(),))
    with pytest.raises(ValueError, match=r"scenes\[1\] must have the dimension of the first scene, got 3"):
        pm.ShearBatch([plain(0), space])
    batch = pm.ShearBatch([plain(0)])
    with pytest.raises(ValueError, match="index must be an integer at least 0 and at most 0, got 1"):
        batch.restart(1)
    with pytest.raises(ValueError, match="switched_friction must be left out for scenes without friction"):
        pm.ShearBatch([plain(0)], switched_friction=True)
