"""Curves of cementing: weighted means, work that goes on, and the same bits wherever it is done."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.ensemble.cementing_curve import weighted_mean

SMALL = {"particles": [16], "packings": 2, "dimension": 2, "sizes": pm.Bidisperse(ratio=1.4)}


@functools.cache
def monomers(seed=1, particles=32):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(pm.Hertz()),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-6).packing)


def test_weighted_mean_has_the_closed_forms():
    value, weight = np.array([[[1.0], [2.0]], [[4.0], [np.inf]]]), np.array([[[1.0], [2.0]], [[1.0], [0.0]]])
    found = weighted_mean(value, weight)
    assert found.mean_k == pytest.approx([9.0 / 4.0])
    # off by -1.25 - 0.5 in one packing, by 1.75 in the other
    assert found.error_k == pytest.approx([np.sqrt(2.0 * 2.0 * 1.75**2) / 4.0])
    assert found.trials_k.tolist() == [3]


def same(one, other):
    return all(
        np.array_equal(a.curves[name], b.curves[name], equal_nan=True) and np.array_equal(a.all_o, b.all_o)
        for x, y in zip(one, other, strict=True)
        for a, b in zip(x.trials, y.trials, strict=True)
        for name in a.curves
    )


def test_interrupted_work_goes_on_with_the_same_numbers_and_keeps_what_was_finished(tmp_path):
    whole = pm.cementing_curve(orders=3, **SMALL)

    def stop(particles, packing, done):
        if (packing, done) == (1, 2):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pm.cementing_curve(tmp_path, orders=3, progress=stop, **SMALL)
    trials = pm.read_ensemble(tmp_path / "trials")
    assert trials.where(state="done")["packing"].tolist() == [0, 0, 0, 1, 1]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("*/workspace/*/result.json")}
    assert same(pm.cementing_curve(tmp_path, orders=3, **SMALL), whole)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    more = pm.cementing_curve(tmp_path, orders=1, step=0.1, **SMALL)
    assert len(more[0].link_fraction_k) < len(whole[0].link_fraction_k)
    assert len(pm.read_ensemble(tmp_path / "packings")) == 2


def test_two_processes_give_the_same_numbers_as_none(tmp_path):
    assert same(pm.cementing_curve(tmp_path, orders=2, workers=2, **SMALL), pm.cementing_curve(orders=2, **SMALL))


def test_sizes_of_ones_own_are_drawn_from_here_only(tmp_path):
    class Alternating:
        def radii(self, particles, rng):
            return np.where(np.arange(particles) % 2 == 0, 0.5, 0.35)

    (curve,) = pm.cementing_curve(tmp_path, orders=1, **(SMALL | {"packings": 1, "sizes": Alternating()}))
    radius = curve.trials[0].packing.radius_n
    assert radius[0] / radius[1] == pytest.approx(0.5 / 0.35)
    with pytest.raises(ValueError, match="^workers must be 0 for sizes of your own"):
        pm.cementing_curve(tmp_path, orders=1, workers=2, **(SMALL | {"sizes": Alternating()}))


def test_a_folder_of_former_results_is_refused(tmp_path):
    (tmp_path / "n00016-packing000.npz").touch()
    with pytest.raises(ValueError, match="^folder must hold members of ensembles, or none"):
        pm.cementing_curve(tmp_path, orders=1, **SMALL)


def test_curves_of_ones_own_packings_are_resumed_and_not_confused(tmp_path):
    scenes = [monomers(1), monomers(2), monomers(2, 48)]
    settings = {"orders": 2, "seed": 5, "step": 0.2}
    curves = pm.cementing_curve(tmp_path, scenes=scenes, **settings)
    assert [(one.particles, len(one.trials)) for one in curves] == [(32, 2), (48, 1)]
    again = pm.cementing_curve(tmp_path, scenes=scenes, **settings)
    assert all(np.array_equal(a.bulk.mean_k, b.bulk.mean_k, equal_nan=True) for a, b in zip(curves, again, strict=True))
    alone = pm.cement(scenes[0], kind="unstressed", step=0.2)
    assert np.abs(curves[0].trials[0].curves["bulk_reuss"][0, 0] / alone.reuss(0).bulk_modulus - 1.0) < 1e-12
    assert curves[1].anisotropy.mean_k[0] == pytest.approx(pm.cement(scenes[2], step=0.2).anisotropy(0), rel=1e-9)
    assert len(list(tmp_path.glob("trials/scenes/*.toml"))) == 3
    (other, _) = pm.cementing_curve(tmp_path, scenes=scenes[1:], **settings)
    assert len(pm.read_ensemble(tmp_path / "trials")) == 8
    assert other.trials[0].packing == scenes[1].packing
    loose = pm.Scene(pm.random_packing(16, dimension=2, packing_fraction=0.3, seed=1), (pm.Repulsion(),))
    with pytest.raises(ValueError, match=r"scenes\[1\]: scene.packing must be jammed"):
        pm.cementing_curve(scenes=[scenes[0], loose], orders=1)
    with pytest.raises(ValueError, match=r"scenes\[0\].effects must hold nothing"):
        pm.cementing_curve(scenes=[scenes[0].replace(effects=(pm.Repulsion(), pm.Friction()))], orders=1)
