"""The verdict on ellipses, spheroids and rigid bodies: what is known of them by other means."""

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.elements import sum_ends

REPULSION = (pm.Repulsion(),)


def jammed(d, shapes, strain, seed=3, pressure=1e-6, count=24):
    start = pm.random_packing(count, dimension=d, packing_fraction=0.6 if d == 2 else 0.35, seed=seed, shapes=shapes)
    run = pm.jam(pm.Scene(start, REPULSION), pressure=pressure, strain=strain)
    return run, pm.Scene(run.packing, REPULSION)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("shapes", [pm.Ellipses(1.5), pm.Trimer(0.7, 2.0)])
def test_shear_stabilized_packings_are_strictly_jammed_and_others_collectively(d, shapes):
    run, scene = jammed(d, shapes, "free")
    verdict = pm.classify_jamming(scene)
    assert (verdict.local, verdict.collective, verdict.strict) == ("jammed",) * 3
    assert verdict.states_of_self_stress["isochoric"] == run.report["states_of_self_stress"]
    # a body that turns freely comes to rest against another, which it does not push
    idle = run.report["contacts"] - verdict.contacts
    assert verdict.strictly.floppy_modes == run.report["floppy_modes"] + idle
    # the certificate is in balance and positive
    force, one = verdict.contact_force_c, verdict.network
    assert force.min() > 0.0 and force.mean() == pytest.approx(1.0)
    assert np.abs(sum_ends(one, force)).max() < 1e-5
    _, scene = jammed(d, shapes, "isotropic")
    verdict = pm.classify_jamming(scene)
    assert verdict.collective == "jammed" and verdict.strict == "not jammed"
    assert "no contact forces are in balance" in verdict.strictly.reason


def test_hypostatic_ellipses_are_held_to_second_order_and_the_answer_says_so():
    _, scene = jammed(2, pm.Ellipses(1.2), "free")
    verdict = pm.classify_jamming(scene)
    assert verdict.strict == "jammed" and verdict.first_order_jammed is False
    assert verdict.strictly.floppy_modes == len(pm.quartic_modes(scene, strain="isochoric")) > 0
    assert "quartic modes" in verdict.strictly.reason and "quartic modes" in str(verdict)
    # pairs that are taken apart hold nothing
    spread = scene.packing.replace(radius_n=0.99 * scene.packing.radius_n)
    assert pm.classify_jamming(spread).collective == "not jammed"


def test_a_packing_out_of_balance_is_ambiguous():
    _, scene = jammed(2, pm.Ellipses(1.5), "free")
    packing = scene.packing
    shaken = packing.replace(position_nd=packing.position_nd + 1e-9 * np.random.default_rng(0).normal(size=(24, 2)))
    verdict = pm.classify_jamming(shaken)
    assert verdict.collective == "ambiguous" and "not at rest" in verdict.collectively.reason


def test_forces_that_do_not_hold_an_ellipse_leave_it_free():
    # between two walls of ellipses tip to tip an ellipse that stands up falls over: a needle on its point
    column = pm.Spheroids([3.0, 3.0], [[0.0, 1.0], [0.0, 1.0]])
    along = 0.5 * np.sqrt(3.0)
    height = 4.0 * along * (1.0 - 1e-6)
    packing = pm.Packing(
        [[2.0, 0.0], [2.0, 0.5 * height]], [0.5, 0.5], pm.Box([[4.0, 0.0], [0.0, height]]), shapes=column
    )
    verdict = pm.classify_jamming(packing)
    assert verdict.collective != "jammed"


@pytest.mark.parametrize("d", [2, 3])
def test_aspect_one_and_single_beads_get_the_verdict_of_discs_and_spheres(d):
    start = pm.random_packing(30, dimension=d, packing_fraction=0.6 if d == 2 else 0.4, seed=2)
    plain = pm.jam(pm.Scene(start, REPULSION), pressure=1e-6).packing
    expected = pm.classify_jamming(plain)
    director = np.random.default_rng(1).normal(size=(30, d))
    for packing in (
        plain.replace(shapes=pm.Spheroids(np.ones(30), director)), pm.rigid_packing(plain, np.arange(30)),
    ):  # fmt: skip
        found = pm.classify_jamming(packing)
        assert (found.local, found.collective, found.strict) == (expected.local, expected.collective, expected.strict)
        assert found.contacts == expected.contacts and np.array_equal(found.rattlers, expected.rattlers)
        assert np.abs(found.contact_force_c - expected.contact_force_c).max() < 1e-10


def test_given_contacts_are_refused():
    _, scene = jammed(2, pm.Ellipses(1.5), "free", count=12)
    plain = scene.packing.replace(shapes=None)
    with pytest.raises(ValueError, match="contacts must be left out for Spheroids"):
        pm.classify_jamming(scene.packing, contacts=pm.find_contacts(plain))
