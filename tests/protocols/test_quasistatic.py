"""Facts about packings sheared from equilibrium to equilibrium."""

import functools
import math

import numpy as np
import pytest

import packmech as pm
from packmech.jit.blas import single_thread
from packmech.loop.run_loop import run_settings
from packmech.protocols.shearing.quasistatic import _protocol
from packmech.protocols.shearing.sheared_lattice import ShearedLattice
from packmech.protocols.shearing.strain_path import StrainPath


@functools.cache
def scene(pressure=1e-3, seed=1, law=None, shapes=False):
    form = {"shapes": pm.Ellipses(1.5)} if shapes else {}
    start = pm.random_packing(
        24 if shapes else 32,
        dimension=2,
        sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=0.6 if shapes else 0.8,
        seed=seed,
        **form,
    )
    whole = pm.Scene(start, (pm.Repulsion(law or pm.Harmonic()),))
    return whole.replace(packing=pm.jam(whole, pressure=pressure).packing)


@functools.cache
def first(pressure=None, law=None, shapes=False):
    applied = 0.0084 if shapes else 0.0027 if law is None else 0.0033
    run = pm.quasistatic_shear(scene(law=law, shapes=shapes), applied, step=3e-4, pressure=pressure)
    return run, run.first_change


@pytest.mark.parametrize("shapes", [False, True])
def test_the_modulus_at_the_start_is_that_of_linear_response(shapes):
    run, _ = first(shapes=shapes)
    moduli = pm.elastic_moduli(scene(shapes=shapes))
    # at constant volume: Cauchy's, of simple shear
    assert run.modulus_t[0] == pytest.approx(moduli.simple_shear(0, 1), rel=1e-8)


@pytest.mark.parametrize("pressure", [None, 1e-3])
def test_the_tangent_modulus_is_the_slope_of_volume_times_stress(pressure):
    run = pm.quasistatic_shear(scene(), 4e-4, step=1e-4, pressure=pressure)
    slope = run.shear_stress_t / run.packing_fraction_t * run.packing_fraction_t[2]
    difference = (8.0 * (slope[3] - slope[1]) - (slope[4] - slope[0])) / 12e-4
    assert difference == pytest.approx(run.modulus_t[2], rel=1e-8)


@pytest.mark.parametrize("law", [None, pm.Hertz()])
@pytest.mark.parametrize("pressure", [None, 1e-3])
def test_the_first_change_is_the_same_from_both_sides(pressure, law):
    run, change = first(pressure, law)
    assert abs(change.strain - change.strain_from_above) < 1e-10
    there = int(np.flatnonzero(np.abs(run.strain_t - change.strain) < 1e-12)[0])
    assert run.contacts_t[there - 1] - run.contacts_t[-1] >= 1 and change.opened


def test_the_same_of_ellipses():
    _, change = first(shapes=True)
    assert abs(change.strain - change.strain_from_above) < 1e-10


def test_a_contact_that_closes_first_is_found_from_both_sides():
    whole = scene(pressure=1e-2, seed=4)
    guess = pm.quasistatic_shear(whole, 1e-5, step=1e-5).predicted_change_t[0]
    run = pm.quasistatic_shear(whole, 1.2 * guess, step=guess / 4.0)
    change = run.first_change
    assert not change.opened
    assert abs(change.strain - change.strain_from_above) < 1e-10
    assert run.contacts_t[-1] > run.contacts_t[0]


@pytest.mark.parametrize(
    ("particles", "seed", "pressure", "rattle", "opened"),
    [
        # two particles lose all contacts, a rattler is caught, two contacts bear only together
        (16, 10, 1e-3, 2, True),
        (24, 28, 1e-3, -1, False),
        (16, 11, 1e-2, 0, True),
    ],
)
def test_several_contacts_that_change_at_once_are_found_from_both_sides(particles, seed, pressure, rattle, opened):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    whole = pm.Scene(start, (pm.Repulsion(),))
    whole = whole.replace(packing=pm.jam(whole, pressure=pressure, strain="free").packing)
    guess = pm.quasistatic_shear(whole, 1e-6, step=1e-6).predicted_change_t[0]
    change = pm.quasistatic_shear(whole, 1.2 * guess, step=guess / 6.0).first_change
    assert abs(change.strain - change.strain_from_above) < 1e-10 and change.opened == opened and not change.falls
    sides = [pm.quasistatic_shear(whole, change.strain + off, locate="none", step=1.0) for off in (-1e-7, 1e-7)]
    before, after = (side.packing for side in sides)
    assert abs(sides[0].contacts_t[-1] - sides[1].contacts_t[-1]) > 1
    assert int(pm.find_rattlers(after).sum()) - int(pm.find_rattlers(before).sum()) == rattle


def test_an_opening_that_leaves_no_equilibrium_is_located_and_followed_by_a_fall():
    whole = tipping()
    guess = pm.quasistatic_shear(whole, 1e-5, step=1e-5).predicted_change_t[0]
    run = pm.quasistatic_shear(whole, 1.1 * guess, step=guess / 6.0)
    change = run.first_change
    assert change.opened and abs(change.strain - change.strain_from_above) < 1e-10
    assert abs(run.avalanches[0].strain - change.strain) < 1e-6


def tipping():
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=6)
    whole = pm.Scene(start, (pm.Repulsion(),))
    return whole.replace(packing=pm.jam(whole, pressure=1e-2, strain="free").packing)


def test_the_growth_of_the_energy_is_exact_where_it_is_a_billionth_of_it():
    start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    whole = pm.Scene(start, (pm.Repulsion(),))
    whole = whole.replace(packing=pm.jam(whole, pressure=1e-2, strain="free").packing)
    guess = pm.quasistatic_shear(whole, 1e-5, step=1e-5).predicted_change_t[0]
    run = pm.quasistatic_shear(whole, 1.1 * guess, step=guess / 6.0)
    change = run.first_change
    assert change.energy_change < 1e-6 * run.energy_t[0]
    assert change.work == pytest.approx(change.energy_change, rel=1e-9)


@pytest.mark.parametrize(("pressure", "shapes"), [(None, False), (1e-3, False), (None, True)])
def test_with_the_tangent_renewed_the_error_of_the_prediction_falls_quadratically(pressure, shapes):
    run, change = first(pressure, shapes=shapes)
    before = run.strain_t < change.strain - 1e-9
    left = change.strain - run.strain_t[before]
    error = np.abs(run.predicted_change_t[before] - change.strain)
    order = np.diff(np.log(error)) / np.diff(np.log(left))
    # the remainder is of third order
    assert abs(order[-1] - 2.0) < 0.15 and error[0] > 1e-6
    near, predicted = np.array([pair for pair in change.tangents if 1e-7 < change.strain - pair[0] < 1e-4]).T
    constant = error[-1] / left[-1] ** 2
    assert (np.abs(predicted - change.strain) < 1.3 * constant * (change.strain - near) ** 2 + 1e-12).all()


@pytest.mark.parametrize("pressure", [None, 1e-3])
def test_the_energy_grows_by_the_work_of_the_stress(pressure):
    _, change = first(pressure)
    assert change.work == pytest.approx(change.energy_change, rel=1e-8)
    run, _ = first()
    assert change.shear_stress == pytest.approx(run.modulus_t[0] * change.strain, rel=0.05)


def test_where_all_changes_are_located_work_is_energy_throughout():
    run = pm.quasistatic_shear(scene(), 6e-3, step=2e-4, locate="all")
    assert len(run.changes) > 3 and not run.avalanches
    growth = run.energy_t - run.energy_t[0]
    assert np.abs(run.work_t - growth)[1:].max() < 1e-8 * growth.max()
    # among them a particle that loses its three contacts at once, found by halving
    assert 3 in -np.diff(run.contacts_t)


def test_pressure_is_held_and_the_packing_dilates_or_contracts():
    run, _ = first(1e-3)
    assert np.abs(run.pressure_t / 1e-3 - 1.0).max() < 1e-9
    assert np.ptp(run.packing_fraction_t) > 1e-6
    held, _ = first()
    assert np.ptp(held.packing_fraction_t) < 1e-13


def test_an_avalanche_frees_energy_at_its_strain():
    run = pm.quasistatic_shear(scene(), 0.04, step=2e-3, locate="none")
    assert len(run.avalanches) >= 1
    for one in run.avalanches:
        assert one.energy_drop > 0.0 and one.width < 2e-3 / 500
        assert one.contacts_opened + one.contacts_closed > 0
    assert 0.0 < run.yield_strain < 0.04 and run.linear_range() < run.yield_strain
    balance = run.energy_t - run.energy_t[0] - run.work_t
    lost = sum(one.energy_drop for one in run.avalanches)
    # between falls work is energy, to the order of steps over which contacts change
    assert balance[-1] == pytest.approx(-lost, abs=0.3 * lost)


def falling():
    start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=1)
    whole = pm.Scene(start, (pm.Repulsion(),))
    return whole.replace(packing=pm.jam(whole, pressure=1e-2).packing)


def test_an_avalanche_holds_both_packings_and_what_moved_between_them():
    whole = falling()
    run = pm.quasistatic_shear(whole, 4e-3, step=1e-3, locate="none")
    (event,) = run.avalanches
    assert event.plastic and event.after.box.volume == pytest.approx(event.before.box.volume, rel=1e-13)
    energies, stresses = [], []
    for one in (event.before, event.after):
        found = pm.contact_forces(whole.replace(packing=one))
        assert found.residual < 1e-8
        energies.append(found.energy)
        stresses.append(found.stress_dd[0, 1])
    # both at the strain after the fall: what the stress does over the width is taken off, to second order of it
    work = stresses[0] * event.width * event.before.box.volume
    assert energies[0] + work - energies[1] == pytest.approx(event.energy_drop, rel=1e-4)
    assert stresses[0] - stresses[1] == pytest.approx(event.stress_drop * whole.pressure_unit, rel=1e-9)
    # the strain of its place is none of the box, whose strain is the width
    assert event.local_strain.d2min_n[event.particle] == event.local_strain.d2min_n[~event.rattler_n].max()
    assert 1.0 <= event.participation_number < 64.0
    # sheared back from behind it the packing does not return, from before it it does
    after = whole.replace(packing=event.after)
    back = pm.quasistatic_shear(after, -event.width, step=event.width, locate="none").packing
    assert pm.displacements(event.before, back).mean_square > 0.5 * event.displacements.mean_square


def test_what_goes_on_comes_back_and_a_fall_does_not():
    whole = falling()
    protocol = _protocol(whole, None, 1e-9, run_settings())
    with single_thread():
        path = StrainPath(protocol, ShearedLattice(protocol.reduced(whole.packing), (0, 1)), None)
        start = path.now
        further, fell = path.step(1e-4)
        assert fell is None and further.pairs != start.pairs
        assert path.comes_back(start, further)
        while fell is None:
            before, fell = path.step(path.now.strain + 1e-3)
        assert not path.comes_back(before, fell)
    run = pm.quasistatic_shear(whole, 4e-3, step=1e-3, locate="none")
    assert run.avalanches and all(one.plastic for one in run.avalanches)


def test_no_fall_of_a_larger_energy_drop_is_passed_over():
    """From the same packing a step finds what tenths of it find; here one passes over a fall unless told not to."""
    start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=2)
    whole = pm.Scene(start, (pm.Repulsion(),))
    whole = whole.replace(packing=pm.jam(whole, pressure=1e-2).packing)
    whole = whole.replace(packing=pm.quasistatic_shear(whole, 0.017, step=1e-3, locate="none").packing)
    fine = pm.quasistatic_shear(whole, 1e-3, step=1e-4, locate="none").avalanches
    assert [one.energy_drop > 1e-6 for one in fine] == [False, True]
    assert not pm.quasistatic_shear(whole, 1e-3, step=1e-3, locate="none").avalanches
    (found,) = pm.quasistatic_shear(whole, 1e-3, step=1e-3, locate="none", smallest_drop=1e-6).avalanches
    # but for the small fall before it, which is passed over
    assert found.energy_drop == pytest.approx(fine[1].energy_drop, abs=fine[0].energy_drop)
    assert found.strain == pytest.approx(fine[1].strain, abs=1e-6)


def test_avalanches_of_the_mirror_image_are_mirrored():
    whole, mirror, found = falling(), np.diag([-1.0, 1.0]), []
    packing = whole.packing
    box = pm.Box(mirror @ packing.box.lattice_dd @ mirror)
    image = packing.replace(position_nd=packing.position_nd @ mirror, box=box)
    for one, way in ((packing, 1.0), (image, -1.0)):
        run = pm.quasistatic_shear(whole.replace(packing=one), way * 4e-3, step=1e-3, locate="none")
        found.append(run.avalanches[0])
    event, other = found
    assert other.strain == pytest.approx(-event.strain, rel=1e-9) and other.particle == event.particle
    assert other.participation_number == pytest.approx(event.participation_number, rel=1e-5)


def test_the_way_back_is_the_way_where_nothing_changed():
    start = scene()
    there = pm.quasistatic_shear(start, 2e-3, step=1e-3)
    back = pm.quasistatic_shear(start.replace(packing=there.packing), -2e-3, step=1e-3)
    assert not there.changes and not back.changes
    assert back.energy_t[-1] == pytest.approx(there.energy_t[0], rel=1e-10)
    assert np.abs(back.shear_stress_t[::-1] - there.shear_stress_t).max() < 1e-12


def test_links_are_honored():
    start = pm.cluster_packing(
        16, pm.Dimer(0.8), dimension=2, packing_fraction=0.35, largest_overlap=0.1, seed=1
    )  # fmt: skip
    whole = pm.Scene(start, (pm.Repulsion(),))
    whole = whole.replace(packing=pm.jam(whole, pressure=1e-3).packing)
    run = pm.quasistatic_shear(whole, 4e-5, step=2e-5)
    assert run.packing.link_error < 1e-12
    assert run.modulus_t[0] == pytest.approx(pm.elastic_moduli(whole).simple_shear(0, 1), rel=1e-6)
    difference = (run.shear_stress_t[2] - run.shear_stress_t[0]) / 4e-5
    assert difference == pytest.approx(run.modulus_t[1], rel=1e-4)


def test_what_is_not_jammed_is_refused():
    loose = pm.random_packing(16, dimension=2, packing_fraction=0.4, seed=1)
    with pytest.raises(ValueError, match="scene.packing must be jammed"):
        pm.quasistatic_shear(pm.Scene(loose, (pm.Repulsion(),)))
    with pytest.raises(ValueError, match="locate must be one of"):
        pm.quasistatic_shear(scene(), locate="second")


def test_what_was_finished_is_kept_where_time_is_up():
    run = pm.quasistatic_shear(scene(), 0.5, step=1e-3, time_limit=0.1, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT and len(run.strain_t) > 1
    assert len(run.to_csv().splitlines()) == len(run.strain_t) + 1
    assert math.isfinite(run.to_dict()["modulus"]) and "quasistatically" in repr(run)


@pytest.mark.parametrize("pressure", [None, 1e-3])
def test_where_all_changes_are_located_a_change_that_falls_is_located_once_and_passed(pressure):
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.85, seed=3)
    pressed = pm.Scene(start, (pm.Repulsion(),))
    pressed = pressed.replace(packing=pm.jam(pressed, pressure=1e-3).packing)
    near = pm.quasistatic_shear(pressed, 2.8e-3, step=1.4e-3, pressure=pressure, locate="none").packing
    run = pm.quasistatic_shear(
        pressed.replace(packing=near), 2e-4, step=1e-4, pressure=pressure, locate="all", time_limit=20.0
    )
    assert run.outcome is pm.Outcome.FINISHED
    falling = [one for one in run.changes if one.pair[:2] == (20, 42)]
    assert len(falling) == 1 and falling[0].falls
    fall = run.avalanches[0]
    assert falling[0].strain < fall.strain < falling[0].strain + 1e-4 / 1000.0
    assert fall.energy_drop > 0.0


def test_a_cycle_that_was_stopped_says_how_many_of_its_steps_are_done():
    (run,) = pm.cyclic_shear(scene(), 0.5, step=1e-3, time_limit=0.1, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert str(run.unmet[0]).startswith("steps of strain of the cycle ")
    assert f"where 2000 was asked for (it stands at shear strain {run.strain_t[-1]:.4g})" in str(run.unmet[0])
