"""Facts about tables by kinds where runs are cut, many at once, driven at a frequency, or of rigid bodies."""

import itertools

import numpy as np
import pytest

import packmech as pm

STIFFNESS = np.array([[1.0, 2.0], [2.0, 0.7]])
LAW = pm.LawByKind([[pm.LinearSpring(number) for number in row] for row in STIFFNESS.tolist()])
FRICTION = pm.Friction(pm.ByKind([[0.3, 0.1], [0.1, 0.6]]), pm.Mindlin(pm.ByKind([[0.2, 0.3], [0.3, 0.45]])), 0.2)
RESTITUTION = pm.Restitution(pm.ByKind([[0.7, 0.5], [0.5, 0.9]]))
TABLES = (pm.Repulsion(LAW), RESTITUTION, FRICTION)


def mixture(particles=32, fraction=0.9, seed=1, **more):
    packing = pm.random_packing(particles, dimension=2, packing_fraction=fraction, seed=seed, **more)
    return pm.assign_kinds(packing, (1, 1), seed=3)


@pytest.fixture(scope="module")
def pressed():
    """Return a scene of discs of two kinds that were pressed with friction."""
    scene = pm.Scene(mixture(16, fraction=0.8, seed=5), TABLES)
    return scene.replace(packing=pm.jam(scene, pressure=1e-2, strain="isotropic").packing)


# runs that are cut, and many at once


@pytest.mark.parametrize("step", [1, 33, 59])
def test_a_run_that_goes_on_from_a_checkpoint_has_the_bits_of_one_that_was_never_cut(step, tmp_path):
    scene = pm.Scene(mixture(), TABLES)
    manner = {"applied_strain": pm.SteadyStrain(0.05), "dt": 0.02, "temperature": 1e-3, "seed": 2, "check": False}
    whole = pm.simulate(scene, steps=60, **manner)
    pm.simulate(scene, steps=step, checkpoint=tmp_path / "run.npz", **manner)
    again = pm.resume(tmp_path / "run.npz", scene, steps=60, check=False)
    assert again.packing == whole.packing and again.packing.kind_n.tolist() == scene.packing.kind_n.tolist()
    np.testing.assert_array_equal(again.velocity_nd, whole.velocity_nd)
    np.testing.assert_array_equal(again.spin_nk, whole.spin_nk)
    assert len(whole.packing.tangential) > 16
    # other kinds, or other numbers of these, are another scene
    swapped = scene.packing.replace(kind_n=1 - scene.packing.kind_n)
    other = scene.replace(effects=(*TABLES[:2], FRICTION._replace(coefficient=pm.ByKind([[0.3, 0.2], [0.2, 0.6]]))))
    for wrong, part in ((scene.replace(packing=swapped), "packing"), (other, "effects")):
        with pytest.raises(ValueError, match=f"scene must be the one .* got one that differs in {part}"):
            pm.resume(tmp_path / "run.npz", wrong, steps=60)


@pytest.mark.parametrize("shapes", [None, pm.Dimer()])
def test_a_batch_of_packings_of_kinds_is_relaxed_as_single_quenches_are(shapes):
    starts = [mixture(seed=seed, shapes=shapes) for seed in (1, 2)]
    scene = pm.Scene(starts[0], (pm.Repulsion(LAW),))
    batch = pm.QuenchBatch(scene, 2, force_tolerance=1e-9, threads=2)
    # a restart takes bodies apart that lie deep in each other, as a quench does
    for b, start in enumerate(starts):
        batch.restart(b, start)
    batch.step([0.0, 0.0], [0.0, 0.0])
    for b, start in enumerate(starts):
        single = pm.QuenchBatch(scene.replace(packing=start), 1, force_tolerance=1e-9)
        single.restart(0, start)
        single.step([0.0], [0.0])
        assert batch.packing(b) == single.packing(0)
        run = pm.quench(scene.replace(packing=start), force_tolerance=1e-9, method=pm.Fire())
        # one loop compiled in two places: products and sums may be fused otherwise
        np.testing.assert_allclose(batch.packing(b).position_nd, run.packing.position_nd, rtol=0.0, atol=1e-11)
        assert pm.energy(scene.replace(packing=run.packing)) > 0.0


# at a frequency


def test_complex_moduli_of_kinds_go_to_the_elastic_ones_at_low_frequencies(pressed):
    moduli = pm.elastic_moduli(pressed, contacts_at_limit="stick")
    gradient = np.zeros((2, 2))
    gradient[0, 1] = 1.0
    symmetric, turn = 0.5 * (gradient + gradient.T), 0.5 * (gradient - gradient.T)
    stress = pm.contact_forces(pressed).stress_dd
    expected = np.einsum("abcd,cd->ab", moduli.tensor(tangent="cauchy"), symmetric) + turn @ stress - stress @ turn
    found = pm.complex_modulus(pressed, [1e-6])
    np.testing.assert_allclose(found.stress_fdd[0].real, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())


def test_a_run_in_time_of_kinds_has_the_complex_modulus(pressed):
    # larger coefficients, so that no contact is at its limit
    rough = FRICTION._replace(coefficient=pm.ByKind([[3.0, 4.0], [4.0, 6.0]]))
    effects = (TABLES[0], pm.ContactDamping(pm.ByKind([[0.3, 0.1], [0.1, 0.5]])), rough, pm.BackgroundDamping(0.2))
    scene = pressed.replace(effects=effects)
    assert not pm.contact_forces(scene).at_limit_c.any()
    found = pm.complex_modulus(scene, [0.02]).modulus_f[0]
    run = pm.oscillatory_shear(scene, amplitude=1e-6, frequency=0.02, periods=10, skip_periods=8, dt=0.02)
    assert np.ptp(run.contacts_t) == 0
    assert abs(run.moduli.storage + 1j * run.moduli.loss - found) < 1e-5 * abs(found)


# rigid bodies


def energy_of_beads(packing):
    """Return the energy of all pairs of beads of different bodies by two loops, at the nearest images."""
    beads, energy, found = pm.bead_packing(packing), 0.0, set()
    shapes, lattice = packing.shapes, packing.box.lattice_dd
    owner = np.repeat(np.arange(packing.particles), np.diff(shapes.start_n))
    for i, j in itertools.combinations(range(beads.particles), 2):
        if owner[i] == owner[j]:
            continue
        vector = beads.position_nd[j] - beads.position_nd[i]
        vector = vector - lattice @ np.round(np.linalg.solve(lattice, vector))
        overlap = max(beads.radius_n[i] + beads.radius_n[j] - np.linalg.norm(vector), 0.0)
        pair = packing.kind_n[owner[i]], packing.kind_n[owner[j]]
        energy += 0.5 * STIFFNESS[pair] * overlap**2
        if overlap > 0.0:
            found.add(tuple(sorted(pair)))
    return energy, found


@pytest.fixture(scope="module")
def bodies():
    """Return a scene of rigid bent bodies of two kinds that are not at rest."""
    start = mixture(12, fraction=0.8, seed=2, shapes=pm.Trimer(angle=2.0))
    loose = pm.quench(pm.Scene(start, (pm.Repulsion(pm.LinearSpring()),)), force_tolerance=1e-2).packing
    return pm.Scene(loose, TABLES)


def test_the_energy_of_bodies_of_kinds_is_that_of_their_beads(bodies):
    energy, found = energy_of_beads(bodies.packing)
    assert found == {(0, 0), (0, 1), (1, 1)}
    assert pm.energy(bodies) == pytest.approx(energy, rel=1e-12)


def test_forces_on_bodies_of_kinds_are_slopes_of_the_energy_of_their_beads(bodies):
    packing, force, step = bodies.packing, pm.forces(bodies.without(pm.Friction)), 1e-6
    for n, axis in ((0, 0), (5, 1), (11, 0)):
        shift = np.zeros_like(packing.position_nd)
        shift[n, axis] = step
        ahead, behind = (
            energy_of_beads(packing.replace(position_nd=packing.position_nd + sign * shift))[0] for sign in (1.0, -1.0)
        )
        assert force[n, axis] == pytest.approx((behind - ahead) / (2.0 * step), abs=1e-8)


def test_steps_of_bodies_of_kinds_begin_with_these_forces_and_close_the_ledger_of_dashpots(bodies):
    scene = bodies.replace(effects=TABLES[:1])
    first = pm.simulate(scene, steps=1, dt=1e-6, method=pm.SemiImplicitEuler(), check=False)
    push = first.velocity_nd * scene.packing.mass_n[:, None] / 1e-6
    np.testing.assert_allclose(push, pm.forces(scene), rtol=0.0, atol=1e-5 * np.abs(push).max())
    scene = bodies.without(pm.Friction)
    run = pm.simulate(scene, steps=300, dt=0.01, temperature=1e-3, seed=1, ledger=True, check=False)
    assert run.ledger.closed and run.ledger.dissipated["normal_dashpots"][-1] > 0.0
    assert run.packing.kind_n.tolist() == scene.packing.kind_n.tolist()


def test_two_bodies_of_kinds_collide_as_bodies_of_one_kind_with_the_numbers_of_their_pair():
    for pair in ((0, 0), (0, 1), (1, 1)):
        start = pm.random_packing(2, dimension=2, packing_fraction=0.1, seed=1, shapes=pm.Trimer(angle=2.0))
        middle = start.box.lattice_dd.sum(axis=1) / 2.0
        start = start.replace(position_nd=middle + np.array([[0.0, 0.0], [1.4, 0.3]]))
        velocity = np.array([[0.1, 0.0], [-0.1, 0.0]])
        numbers = (
            pm.Repulsion(LAW.of(*pair)),
            pm.Restitution(RESTITUTION.coefficient.of(*pair)),
            pm.Friction(FRICTION.coefficient.of(*pair), pm.Mindlin(FRICTION.stiffness.poisson_ratio.of(*pair)), 0.2),
        )
        alone = pm.simulate(pm.Scene(start, numbers), steps=800, dt=0.01, velocity_nd=velocity, check=False)
        mixed = pm.Scene(start.replace(kind_n=list(pair)), TABLES)
        run = pm.simulate(mixed, steps=800, dt=0.01, velocity_nd=velocity, check=False)
        # they met, slid and turned
        assert np.abs(run.spin_nk).max() > 1e-3
        np.testing.assert_allclose(run.velocity_nd, alone.velocity_nd, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(run.spin_nk, alone.spin_nk, rtol=0.0, atol=1e-13)


def test_bodies_of_kinds_are_quenched_to_the_balance_of_their_beads(bodies):
    scene = bodies.replace(effects=TABLES[:1])
    end = pm.quench(scene, force_tolerance=1e-11)
    rest = scene.replace(packing=end.packing)
    assert end.ok and end.packing.kind_n.tolist() == scene.packing.kind_n.tolist()
    energy, _ = energy_of_beads(end.packing)
    assert pm.energy(rest) == pytest.approx(energy, rel=1e-11) and energy > 0.0
    # no small step of a body lowers it
    rng = np.random.default_rng(1)
    for _ in range(5):
        shift = 1e-3 * rng.standard_normal(end.packing.position_nd.shape)
        assert energy_of_beads(end.packing.replace(position_nd=end.packing.position_nd + shift))[0] > energy
