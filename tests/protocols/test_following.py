"""Facts about jamming a packing that is jammed already: it is followed from where it stands."""

import numpy as np
import pytest

import packmech as pm


def network(packing):
    """Return the pairs that touch, rattlers left out."""
    contacts, rattling = pm.find_contacts(packing), pm.find_rattlers(packing)
    kept = ~(rattling[contacts.i_c] | rattling[contacts.j_c])
    return set(zip(contacts.i_c[kept].tolist(), contacts.j_c[kept].tolist(), strict=True))


def jammed(seed, strain, method=None):
    drawn = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    return pm.jam(pm.Scene(drawn, (pm.Repulsion(),)), pressure=1e-6, strain=strain, method=method)


@pytest.mark.parametrize("strain", ["isotropic", "free"])
@pytest.mark.parametrize("seed", range(4))
def test_a_jammed_packing_keeps_its_network_and_its_jamming_packing_fraction(seed, strain):
    first = jammed(seed, strain)
    again = pm.jam(pm.Scene(first.packing, (pm.Repulsion(),)), pressure=1e-6, strain=strain)
    assert (first.report["start"], again.report["start"]) == ("anew", "continued")
    assert network(again.packing) == network(first.packing)
    assert np.isclose(
        again.report["jamming_packing_fraction"], first.report["jamming_packing_fraction"], rtol=1e-12, atol=0.0
    )


@pytest.mark.parametrize("strain", ["isotropic", "free"])
@pytest.mark.parametrize("pressure", [1e-4, 2e-4, 1e-3])
def test_a_packing_under_pressure_keeps_its_network_at_this_pressure(pressure, strain):
    for seed in range(3):
        first = jammed(seed, strain)
        scene = pm.Scene(first.packing, (pm.Repulsion(),))
        pressed = pm.sweep_pressure(scene, [pressure], strain=strain)[0]
        again = pm.jam(scene.replace(packing=pressed.packing), pressure=pressure, strain=strain)
        assert again.report["start"] == "continued"
        assert network(again.packing) == network(pressed.packing)
        assert np.isclose(again.report["packing_fraction"], pressed.report["packing_fraction"], rtol=1e-9, atol=0.0)


@pytest.mark.parametrize(
    "method", [pm.ProgramChain(), pm.Decompression(), pm.StepHalving()], ids=lambda m: type(m).__name__
)
def test_every_method_follows(method):
    first = jammed(1, "isotropic")
    given = {} if isinstance(method, pm.StepHalving) else {"pressure": 1e-6}
    again = pm.jam(pm.Scene(first.packing, (pm.Repulsion(),)), strain="isotropic", method=method, **given)
    assert again.report["start"] == "continued"
    assert network(again.packing) == network(first.packing)
    assert abs(again.report["jamming_packing_fraction"] - first.report["jamming_packing_fraction"]) < 1e-6


def test_a_packing_out_of_balance_or_one_that_is_asked_to_starts_anew():
    first = jammed(1, "isotropic")
    scene = pm.Scene(first.packing, (pm.Repulsion(),))
    anew = pm.jam(scene, pressure=1e-6, strain="isotropic", start="anew")
    moved = first.packing.position_nd + 0.01 * np.random.default_rng(1).normal(size=(64, 2))
    shaken = pm.jam(scene.replace(packing=first.packing.replace(position_nd=moved)), pressure=1e-6, strain="isotropic")
    assert anew.report["start"] == shaken.report["start"] == "anew"
    assert network(anew.packing) != network(first.packing)
    with pytest.raises(ValueError, match="start must be one of"):
        pm.jam(scene, start="again")
