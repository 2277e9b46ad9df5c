"""Facts about balance by displacements: what it did not reach it names."""

import pytest

import packmech as pm


def test_forces_that_do_not_balance_are_named():
    packing = pm.random_packing(32, dimension=2, packing_fraction=0.87, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    jammed = scene.replace(packing=pm.jam(scene, pressure=1e-10, strain="isotropic").packing)
    short = pm.displaced_rest(jammed, pressure=1e-12, step_limit=0, check=False)
    assert not short.ok and [one.name for one in short.unmet] == ["force residual"]
    assert short.unmet[0].reached == short.residual > short.unmet[0].asked == 1e-10
    with pytest.raises(pm.NotConverged, match="force residual"):
        pm.displaced_rest(jammed, pressure=1e-12, step_limit=0)
    assert pm.displaced_rest(jammed, pressure=1e-12).unmet == ()
