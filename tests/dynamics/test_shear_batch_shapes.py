"""Batches of sheared ellipses and spheroids: the bits of each alone, the paths of oscillatory shear, and failures."""

import math
from functools import cache

import numpy as np
import pytest

import packmech as pm


@cache
def scene(seed, dimension=2, friction=True):
    packing = pm.random_packing(
        16, dimension=dimension, shapes=pm.Ellipses(aspect=1.5), packing_fraction=0.95 if dimension == 2 else 0.75,
        seed=seed,
    )  # fmt: skip
    smooth = pm.Scene(packing, (pm.Repulsion(),))
    rest = pm.quench(smooth, force_tolerance=1e-8, check=False).packing
    rough = (pm.Friction(0.5, stiffness=0.5, damping=1.0), pm.ContactDamping(coefficient=2.0)) if friction else ()
    return smooth.replace(packing=rest, effects=(*smooth.effects, *rough))


@pytest.mark.parametrize("dimension", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_packing_in_a_batch_has_the_bits_of_the_packing_alone_on_any_number_of_threads(dimension):
    scenes = [scene(seed, dimension) for seed in range(3)]
    rates = np.random.default_rng(0).uniform(-0.02, 0.02, (30, 3, 1))
    batches = {threads: pm.ShearBatch(scenes, control="rate", steps=3, threads=threads) for threads in (1, 2)}
    alone = [pm.ShearBatch([one], control="rate", steps=3, dt=batches[1].dt) for one in scenes]
    for k in range(len(rates)):
        for batch in batches.values():
            batch.advance(rates[k])
        for b, one in enumerate(alone):
            one.advance(rates[k, b : b + 1])
    for batch in batches.values():
        for b, one in enumerate(alone):
            assert np.array_equal(batch.figure_bk[b], one.figure_bk[0])
            assert batch.packing(b) == one.packing(0)
            assert np.array_equal(batch.orientations(b), one.packing(0).shapes.director_nd)
            assert np.array_equal(batch.spins(b), one.spins(0))
        batch.close()
    assert not np.array_equal(alone[0].orientations(0), scenes[0].packing.shapes.director_nd)


def test_a_scripted_sine_has_the_stresses_of_oscillatory_shear():
    here, amplitude, frequency = scene(3), 2e-3, 0.02
    run = pm.oscillatory_shear(here, amplitude=amplitude, frequency=frequency, periods=1, strain_path="increments")
    every = run.steps // (len(run.time_t) - 1)
    batch = pm.ShearBatch([here], control="strain", dt=run.dt)
    rows = [batch.figure_bk[0].copy()]
    for k in range(1, run.steps + 1):
        batch.advance(np.array([[amplitude * math.sin(2.0 * math.pi * frequency * k * run.dt)]]))
        if k % every == 0:
            rows.append(batch.figure_bk[0].copy())
    figures = dict(zip(batch.names, np.array(rows).T, strict=True))
    size = np.abs(run.shear_stress_t).max()
    assert np.abs(figures["stress_xy"] - run.shear_stress_t).max() <= 1e-11 * size
    assert np.array_equal(figures["contacts"], run.contacts_t)
    turned = batch.packing(0).shapes.rotation_since(run.packing.shapes)
    assert np.abs(turned).max() < 1e-11


def test_what_moves_too_fast_is_put_back_turned_as_it_was():
    # a law that is soft where particles touch, so that the step is not too long for contacts of little overlap: under
    # shear these become deep, until something crosses a diameter in a step
    start = scene(0)
    steep = start.replace(effects=(pm.Repulsion(pm.PowerLaw(1e3, 6.0)), *start.effects[1:]))
    batch = pm.ShearBatch([steep], control="rate", steps=2, dt=0.4)
    for _ in range(200):
        good, figures = batch.packing(0), batch.figure_bk.copy()
        if not batch.advance(np.array([[0.2]])).all():
            break
    assert batch.outcome(0) is pm.Outcome.STEP_TOO_LONG and figures[0, 0] > 0.0
    now = batch.packing(0)
    assert now.shapes == good.shapes and np.array_equal(now.position_nd, good.position_nd)
    assert np.array_equal(batch.figure_bk, figures)


def test_one_kind_of_shape_in_a_batch_and_no_rigid_bodies():
    discs = scene(0).replace(packing=scene(0).packing.replace(shapes=None))
    with pytest.raises(ValueError, match=r"scenes\[1\].packing must have shapes of the kind of the first scene's"):
        pm.ShearBatch([scene(0), discs])
    dimers = pm.random_packing(6, dimension=2, shapes=pm.Dimer(), packing_fraction=0.5, seed=1)
    with pytest.raises(ValueError, match="discs, spheres, ellipses or spheroids for pm.ShearBatch, got Beads"):
        pm.ShearBatch([pm.Scene(dimers, (pm.Repulsion(),))])
