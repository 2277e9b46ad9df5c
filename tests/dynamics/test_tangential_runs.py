"""Facts about tangential springs that stay in the packing: runs go on from them, files keep them."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def rough(dimension, method=None, time=8.0, dt=0.02):
    """Return a frictional scene on its way and the run there: springs are stretched, and some contacts slide."""
    packing = pm.random_packing(40, dimension=dimension, packing_fraction=1.0 if dimension == 2 else 0.75, seed=2)
    effects = pm.Repulsion(pm.LinearSpring(1.0)), pm.Friction(0.3, 0.6, 0.05), pm.ContactDamping(0.1)
    scene = pm.Scene(packing, effects)
    turn = np.linspace(-0.2, 0.2, 40 * (1 if dimension == 2 else 3)).reshape(40, -1)
    return scene, pm.simulate(scene, steps=round(time / dt), dt=dt, spin_nk=turn, method=method)


def positions(scene, run, packing, method=None, dt=0.02):
    motion = {"velocity_nd": run.velocity_nd, "spin_nk": run.spin_nk}
    after = pm.simulate(scene.replace(packing=packing), steps=round(2.0 / dt), dt=dt, method=method, **motion)
    return after.packing.position_nd


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_run_cut_in_two_by_way_of_the_packing_goes_on(dimension):
    method = pm.SemiImplicitEuler()
    scene, first = rough(dimension, method)
    whole = rough(dimension, method, 10.0)[1].packing.position_nd
    assert len(first.packing.tangential) > 40
    moved = np.abs(whole - first.packing.position_nd).max()
    assert np.abs(positions(scene, first, first.packing, method) - whole).max() < 1e-11 * moved
    slack = positions(scene, first, first.packing.replace(tangential=None), method)
    assert np.abs(slack - whole).max() > 1e-3 * moved


@pytest.mark.parametrize("dimension", [2, 3])
def test_verlet_goes_on_to_the_order_of_its_step(dimension):
    """It takes forces at velocities extrapolated to the end of a step, which the run begun anew has exactly."""
    apart = []
    for dt in (0.02, 0.005):
        scene, first = rough(dimension, None, 8.0, dt)
        whole = rough(dimension, None, 10.0, dt)[1].packing.position_nd
        apart.append(np.abs(positions(scene, first, first.packing, None, dt) - whole).max())
    assert apart[0] < 1e-4 and apart[0] / apart[1] > 40.0


@pytest.mark.parametrize("ending", ["npz", "gsd"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_files_keep_them_to_the_last_bit(dimension, ending, tmp_path):
    if ending == "gsd":
        pytest.importorskip("gsd")
    packing = rough(dimension)[1].packing
    pm.write_packing(packing, tmp_path / f"rough.{ending}")
    assert pm.read_packing(tmp_path / f"rough.{ending}") == packing
    with pytest.raises(ValueError, match="no tangential displacements for .txt files"):
        pm.write_packing(packing, tmp_path / "rough.txt")


def test_half_of_their_arrays_is_no_packing(tmp_path):
    packing = rough(2)[1].packing
    pm.write_packing(packing, tmp_path / "rough.npz")
    arrays = dict(np.load(tmp_path / "rough.npz"))
    del arrays["tangential_image_cd"], arrays["sha256"]
    np.savez(tmp_path / "half.npz", **arrays)
    with pytest.raises(
        ValueError, match="all arrays of its tangential displacements, got none named tangential_image_cd"
    ):
        pm.read_packing(tmp_path / "half.npz")


def test_wrapping_a_packing_does_not_change_how_it_goes_on():
    scene, first = rough(2)
    moved = first.packing.replace(
        position_nd=first.packing.position_nd + np.arange(40)[:, None] % 3 * first.packing.box.lattice_dd[:, 0],
        tangential=first.packing.tangential.moved(np.outer(-(np.arange(40) % 3), [1, 0])),
    )
    assert moved.wrapped().tangential == first.packing.wrapped().tangential
    one, other = positions(scene, first, first.packing), positions(scene, first, moved)
    assert np.abs(one - other + (moved.position_nd - first.packing.position_nd)).max() < 1e-11


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_frictional_packing_at_rest_stays_there_from_its_own_springs(dimension):
    scene, _ = rough(dimension)
    damped = scene.replace(effects=(*scene.effects, pm.BackgroundDamping(1.0)))
    rest = pm.simulate(damped, steps=20_000, dt=0.05)
    assert len(rest.packing.tangential) > 40 and np.abs(rest.velocity_nd).max() < 1e-10
    again = pm.simulate(damped.replace(packing=rest.packing), steps=200, dt=0.05)
    assert np.abs(again.packing.position_nd - rest.packing.position_nd).max() < 1e-8
    slack = pm.simulate(damped.replace(packing=rest.packing.replace(tangential=None)), steps=200, dt=0.05)
    assert np.abs(slack.packing.position_nd - rest.packing.position_nd).max() > 1e-5


def test_a_strained_run_goes_on_from_them_and_hands_them_over():
    scene, first = rough(2)
    ahead = scene.replace(packing=first.packing)
    run = pm.ramp_strain(ahead, rate=0.01, applied_strain=0.002, dt=0.02)
    slack = pm.ramp_strain(
        scene.replace(packing=first.packing.replace(tangential=None)), rate=0.01, applied_strain=0.002, dt=0.02
    )
    assert run.shear_stress_t[0] != slack.shear_stress_t[0]
    assert len(run.packing.tangential) > 40
    # the box has sheared: images and springs belong to the packing as it is
    assert run.packing.box != scene.packing.box


def test_equilibration_begins_with_slack_springs_as_it_says():
    scene, first = rough(2)

    def found(packing):
        here = scene.replace(packing=packing)
        return pm.equilibrate(
            here,
            amplitude=0.01,
            relative_frequency=0.05,
            expected_stress=0.01,
            frictionless=False,
            step_limit=2000,
            check=False,
        )

    one, other = found(first.packing), found(first.packing.replace(tangential=None))
    assert one.packing == other.packing and one.packing.tangential is None


def test_a_checkpoint_knows_its_scene_by_them(tmp_path):
    scene, first = rough(2)
    here = scene.replace(packing=first.packing)
    pm.simulate(here, steps=50, dt=0.02, checkpoint=tmp_path / "run.npz")
    on = pm.resume(tmp_path / "run.npz", here, steps=100)
    assert on.packing == pm.simulate(here, steps=100, dt=0.02).packing
    with pytest.raises(ValueError, match="differs in packing"):
        pm.resume(tmp_path / "run.npz", scene.replace(packing=first.packing.replace(tangential=None)), steps=100)
