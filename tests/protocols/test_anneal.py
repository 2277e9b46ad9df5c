"""Facts about shape annealing: what stays as particles change, directors, ends at rest, interrupts and limits."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def discs(dimension=2, particles=24):
    packing = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=1
    )
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-5, strain="isotropic").packing)


@functools.cache
def annealed():
    return pm.anneal_shape(discs(), (1.05, 1.1, 1.15, 1.2), seed=3, pressure=1e-5)


def test_areas_and_the_shape_of_the_box_stay_and_every_packing_is_jammed_at_the_pressure():
    start = discs().packing
    for run, aspect in zip(annealed(), (1.05, 1.1, 1.15, 1.2), strict=True):
        packing = run.packing
        assert run.report["aspect"] == aspect and (packing.shapes.aspect_n == aspect).all()
        assert np.array_equal(packing.radius_n, start.radius_n)
        shape = packing.box.lattice_dd / start.box.lattice_dd[0, 0]
        assert np.abs(shape - shape[0, 0] * np.eye(2)).max() < 1e-12
        assert run.report["pressure"] == pytest.approx(1e-5, rel=1e-6) and run.residual < 1e-5
        assert run.report["states_of_self_stress"] >= 1
        # discs that become ellipses of 1.05 have other contacts
        assert run.report["start"] == "rearranged" and run.report["method"] == "anneal_shape"
        assert run.report["contacts_closed"] > 0


def test_a_packing_annealed_to_the_aspect_and_pressure_that_it_has_stays():
    last = annealed()[-1]
    (again,) = pm.anneal_shape(discs().replace(packing=last.packing), [1.2], pressure=1e-5)
    assert again.report["start"] == "continued"
    assert np.array_equal(again.packing.position_nd, last.packing.position_nd)


def test_a_tap_too_weak_to_unbalance_forces_leaves_the_network():
    scene = discs()
    (run,) = pm.tap(scene, 1e-12, seed=1, pressure=1e-5)
    assert run.report["start"] == "continued"
    assert abs(pm.packing_fraction(run.packing) - pm.packing_fraction(scene.packing)) < 1e-9


def test_directors_are_kept_from_step_to_step_and_places_nearly():
    """In a packing with a twentieth more aspect nothing turns far: not as random directors would."""
    for one, other in zip(annealed(), annealed()[1:], strict=False):
        turn = np.abs((one.packing.shapes.director_nd * other.packing.shapes.director_nd).sum(axis=1))
        assert np.median(np.arccos(np.clip(turn, -1.0, 1.0))) < 0.25


def test_annealed_ellipses_are_denser_than_the_discs_they_come_from():
    fraction = [pm.packing_fraction(run.packing) for run in annealed()]
    assert (np.diff([pm.packing_fraction(discs().packing), *fraction]) > 0.0).all()


def test_the_same_seed_gives_the_same_bits_and_going_on_is_going_through():
    again = pm.anneal_shape(discs(), (1.05, 1.1), seed=3, pressure=1e-5)
    assert again[-1].packing == annealed()[1].packing
    further = pm.anneal_shape(discs().replace(packing=again[-1].packing), [1.15], pressure=1e-5)
    assert further[0].packing == annealed()[2].packing
    other = pm.anneal_shape(discs(), [1.05], rng=np.random.default_rng(4), pressure=1e-5)
    assert other[0].packing != annealed()[0].packing


def test_spheres_become_oblate_and_prolate_spheroids():
    start = discs(3, 16)
    for aspect in (0.9, 1.1):
        (run,) = pm.anneal_shape(start, [aspect], seed=1, pressure=1e-4)
        assert run.ok and run.packing.shapes.aspect_n[0] == aspect


def test_discs_become_dimers_of_equal_area():
    runs = pm.anneal_shape(discs(), (1.1, 1.2), beads=2, seed=1, pressure=1e-4)
    for run in runs:
        shapes, radius = run.packing.shapes, run.packing.radius_n
        bead = shapes.site_radius(radius)[::2]
        apart = np.linalg.norm(np.diff(shapes.arms(radius).reshape(-1, 2, 2), axis=1)[:, 0], axis=1)
        np.testing.assert_allclose(1.0 + apart / (2.0 * bead), run.report["aspect"], rtol=1e-9)
        assert np.array_equal(radius, discs().packing.radius_n)
        # area of two discs less their lens
        half = np.arccos(0.5 * apart / bead)
        area = 2.0 * np.pi * bead**2 - bead**2 * (2.0 * half - np.sin(2.0 * half))
        np.testing.assert_allclose(area, np.pi * radius**2, rtol=1e-9)
        assert run.ok


def test_time_is_limited_in_all_and_interrupts_pass_on_what_was_finished():
    runs = pm.anneal_shape(discs(), [1.1, 1.2], seed=1, time_limit=1e-9, check=False)
    assert len(runs) == 1 and runs[0].outcome is pm.Outcome.TIME_LIMIT
    seen = []

    def stop(stage, figures):
        # each step is compressed, then decompressed
        if stage == "compression" and "decompression" in seen:
            raise KeyboardInterrupt
        seen.append(stage)

    with pytest.raises(KeyboardInterrupt) as stopped:
        pm.anneal_shape(discs(), [1.05, 1.1, 1.15, 1.2], seed=3, pressure=1e-5, progress=stop)
    (finished,) = stopped.value.runs
    assert finished.packing == annealed()[0].packing


def test_what_cannot_be_annealed_is_refused():
    scene = discs()
    loose = scene.replace(packing=pm.random_packing(24, dimension=2, packing_fraction=0.3, seed=1))
    with pytest.raises(ValueError, match="scene.packing must be jammed"):
        pm.anneal_shape(loose, [1.1], seed=1)
    with pytest.raises(ValueError, match="seed must be an integer"):
        pm.anneal_shape(scene, [1.1])
    with pytest.raises(ValueError, match="aspects must be above 1 and at most the number of beads, 2, got 2.5"):
        pm.anneal_shape(scene, [1.1, 2.5], beads=2, seed=1)
    ellipses = scene.replace(packing=annealed()[0].packing)
    with pytest.raises(ValueError, match="must be of discs, spheres or Beads, got Spheroids"):
        pm.anneal_shape(ellipses, [1.2], beads=2)
    with pytest.raises(ValueError, match="seed and rng must be left out"):
        pm.anneal_shape(ellipses, [1.2], seed=1)
