"""Facts about soft spots and vibralities."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def scene(kind):
    if kind == "discs":
        start = pm.random_packing(48, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=3)
    elif kind == "spheres":
        start = pm.random_packing(40, dimension=3, sizes=pm.Bidisperse(1.4), packing_fraction=0.72, seed=2)
    else:
        start = pm.random_packing(24, dimension=2, packing_fraction=0.9, seed=1, shapes=pm.Ellipses(1.5))
    mass = np.random.default_rng(5).uniform(0.5, 2.0, start.particles)
    whole = pm.Scene(start.replace(mass_n=mass), (pm.Repulsion(),))
    return whole.replace(packing=pm.jam(whole, pressure=1e-2).packing)


def inverse_of(whole, index):
    """Return the diagonal of the pseudo-inverse of the dynamical matrix, summed over each particle's coordinates."""
    packing = whole.packing
    per = pm.hessian(whole, "none").shape[0] // packing.particles
    root = np.repeat(1.0 / np.sqrt(packing.mass_n), per)
    matrix = pm.hessian(whole, "none").toarray() * root[:, None] * root
    rows = (index[:, None] * per + np.arange(per)).ravel()
    matrix = matrix[np.ix_(rows, rows)]
    inverse = np.linalg.pinv(matrix, rcond=1e-10, hermitian=True)
    return np.diag(inverse).reshape(len(index), per).sum(axis=1)


@pytest.mark.parametrize("kind", ["discs", "spheres", "ellipses"])
def test_vibrality_is_the_diagonal_of_the_inverse_of_the_dynamical_matrix(kind):
    modes = pm.normal_modes(scene(kind))
    spots = pm.soft_spots(modes)
    part = spots.vibrality_n[modes.index_n]
    assert part.sum() == pytest.approx((1.0 / modes.eigenvalue_m[~modes.zero_m]).sum(), rel=1e-12)
    # rattlers bear nothing: their rows hold no stiffness
    np.testing.assert_allclose(part, inverse_of(scene(kind), modes.index_n), rtol=1e-7)
    others = np.setdiff1d(np.arange(scene(kind).packing.particles), modes.index_n)
    assert np.isnan(spots.vibrality_n[others]).all() and spots.complete
    assert set(spots.order_n) == set(modes.index_n)


def test_low_modes_participate_and_mark():
    modes = pm.normal_modes(scene("discs"))
    spots = pm.soft_spots(modes, 5, particles=7)
    assert np.nansum(spots.participation_n) == pytest.approx(1.0, rel=1e-12)
    assert spots.marks_n.sum() == 35 and spots.marks_n.max() <= 5 and spots.low == 5
    # the vibrality is of all modes, whatever counts as low; that of few modes is less
    assert np.array_equal(pm.soft_spots(modes, 9).vibrality_n, spots.vibrality_n, equal_nan=True)
    few = pm.soft_spots(pm.normal_modes(scene("discs"), 12))
    known = modes.index_n
    assert not few.complete and (few.vibrality_n[known] < spots.vibrality_n[known]).all()
    assert spots.rank(int(spots.order_n[0])) == 1.0 and spots.rank(int(spots.order_n[-1])) == 0.0


def test_vibrality_turns_and_is_numbered_with_the_packing():
    whole = scene("discs")
    packing = whole.packing
    before = pm.soft_spots(pm.normal_modes(whole)).vibrality_n
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cos, -sin], [sin, cos]])
    order = np.random.default_rng(1).permutation(packing.particles)
    moved = pm.Packing(
        (packing.position_nd @ turn.T)[order],
        packing.radius_n[order],
        pm.Box(turn @ packing.box.lattice_dd),
        mass_n=packing.mass_n[order],
    )
    after = pm.soft_spots(pm.normal_modes(whole.replace(packing=moved))).vibrality_n
    np.testing.assert_allclose(after, before[order], rtol=1e-7)


def test_kept_rattlers_have_zero_modes_that_are_left_out():
    whole = scene("discs")
    kept, removed = (pm.soft_spots(pm.normal_modes(whole, rattlers=one)) for one in ("keep", "remove"))
    known = removed.order_n
    assert kept.modes == removed.modes
    np.testing.assert_allclose(kept.vibrality_n[known], removed.vibrality_n[known], rtol=1e-8)


def test_unstable_packings_have_no_vibrality():
    crystal = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.02)
    with pytest.raises(ValueError, match="modes must be of a stable packing, got"):
        pm.soft_spots(pm.normal_modes(pm.Scene(crystal, (pm.Repulsion(),))))


@pytest.mark.slow
def test_the_softest_particles_are_where_plastic_events_are():
    """Vibralities at the start of each elastic branch say more than chance would where the fall at its end will be."""
    ranks = []
    for seed in range(1, 9):
        start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
        whole = pm.Scene(start, (pm.Repulsion(),))
        whole = whole.replace(packing=pm.jam(whole, pressure=1e-2).packing)
        before = whole.packing
        for event in pm.quasistatic_shear(whole, 0.05, step=2e-3, locate="none").avalanches:
            if event.plastic and event.energy_drop > 1e-7:
                spots = pm.soft_spots(pm.normal_modes(whole.replace(packing=before)))
                if not np.isnan(spots.vibrality_n[event.particle]):
                    ranks.append(spots.rank(event.particle))
            before = event.after
    # ranks by chance are uniform, with a mean of 1/2 +- 1 / sqrt(12 n); a tenth of them would be above 0.9
    assert len(ranks) > 40
    assert np.mean(ranks) > 0.5 + 4.0 / np.sqrt(12 * len(ranks))
    assert np.mean(np.array(ranks) > 0.9) > 0.1 + 4.0 * np.sqrt(0.09 / len(ranks))
