"""Facts about contacts in numbers: counts, directions and angles of crystals, forces, chains that are laid by hand."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def jammed(shapes=None):
    packing = pm.random_packing(
        64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=2, shapes=shapes
    )
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-4, strain="isotropic").packing)


@pytest.mark.parametrize("shapes", [None, pm.Ellipses(1.5)])
def test_shares_of_contact_numbers_have_the_mean_of_all_contacts(shapes):
    packing = jammed(shapes).packing
    found = pm.contact_statistics(packing)
    assert found.mean == pytest.approx(pm.coordination_number(packing), rel=1e-12)
    assert found.count_z.sum() + found.rattlers == 64 and found.rattlers == pm.find_rattlers(packing).sum()
    assert found.count_z[:3].sum() == 0 and found.share_z.sum() == pytest.approx(1.0)
    for density, width in ((found.direction_b, np.pi / 36), (found.between_b, 2.0 * np.pi / 36)):
        assert density.sum() * width == pytest.approx(1.0, rel=1e-12)
    assert np.trace(found.fabric_dd) == pytest.approx(1.0, rel=1e-12)
    kept = pm.contact_statistics(packing, rattlers="keep")
    assert kept.mean == pytest.approx(pm.coordination_number(packing, rattlers="keep"), rel=1e-12)


def test_crystals_have_their_directions_and_angles():
    triangular = pm.contact_statistics(pm.lattice_packing("triangular", repeats=(3, 3)), bins=36)
    assert np.flatnonzero(triangular.direction_b).tolist() == [0, 12, 24]
    # a sixth of a turn, at the edge of a bin, lies above it
    assert np.flatnonzero(triangular.between_b).tolist() == [6]
    assert triangular.anisotropy < 1e-12 and triangular.count_z.tolist() == [0] * 6 + [9]
    square = pm.contact_statistics(pm.lattice_packing("square", repeats=(3, 3)), rattlers="keep")
    assert np.flatnonzero(square.between_b).tolist() == [9] and square.anisotropy < 1e-12
    fcc = pm.contact_statistics(pm.lattice_packing("fcc", repeats=(3, 3, 3)), bins=36)
    # 66 pairs of twelve neighbors at 60, 90, 120 and 180 degrees
    share = fcc.between_b * np.pi / 36 * 66
    assert share[[12, 18, 24, 35]] == pytest.approx([24.0, 12.0, 24.0, 6.0]) and share.sum() == pytest.approx(66.0)
    np.testing.assert_allclose(fcc.fabric_dd, np.eye(3) / 3.0, atol=1e-12)


def test_a_row_of_contacts_has_all_its_fabric_along_itself():
    row = pm.Packing([[0.5 + k, 0.5] for k in range(4)], [0.5] * 4, pm.Box([[4.0, 0.0], [0.0, 3.0]]))
    found = pm.contact_statistics(row, rattlers="keep")
    np.testing.assert_allclose(found.fabric_dd, [[1.0, 0.0], [0.0, 0.0]], atol=1e-15)
    assert found.anisotropy == pytest.approx(1.0)
    none = pm.contact_statistics(row)
    assert none.rattlers == 4 and np.isnan(none.mean) and not none.between_b.any()


@pytest.mark.parametrize("shapes", [None, pm.Ellipses(1.5)])
def test_forces_over_their_mean_are_those_of_the_contacts(shapes):
    scene = jammed(shapes)
    found = pm.force_distribution(scene, bins=200, largest=10.0)
    if shapes is None:
        size = np.abs(pm.contact_forces(scene).normal_c)
    else:
        contacts = pm.find_shape_contacts(scene.packing)
        size = (contacts.overlap_c / contacts.contact_distance_c * contacts.push_c)[contacts.gap_c < 0.0]
    np.testing.assert_allclose(found.ratio_c, np.sort(size) / size.mean(), rtol=1e-9)
    assert found.mean == pytest.approx(size.mean(), rel=1e-9) and found.moment(1) == pytest.approx(1.0, rel=1e-12)
    assert found.density_b.sum() * 0.05 == pytest.approx(1.0, rel=1e-12)
    assert found.share_below(1.0) == (found.ratio_c < 1.0).mean()


def test_friction_adds_its_part_to_the_forces():
    springs = pm.TangentialDisplacements([0], [1], [[0, 0]], [[0.03]])
    pair = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), tangential=springs)
    found = pm.force_distribution(pm.Scene(pair, (pm.Repulsion(), pm.Friction(0.5, 1.0))))
    assert found.mean == pytest.approx(np.hypot(0.1, 0.03))


def laid(path, others=()):
    """Return a scene of discs that overlap by a tenth along a path, and others that do not touch."""
    place = np.concatenate([np.asarray(path, float), np.asarray(others, float).reshape(-1, 2)])
    return pm.Scene(pm.Packing(place, np.full(len(place), 0.5), pm.Box.cubic(30.0, 2)), (pm.Repulsion(),))


def bent(degrees, length=4):
    """Return a path that goes on at an angle after some steps of .9."""
    straight = [[2.0 + 0.9 * k, 10.0] for k in range(length)]
    turn = np.deg2rad(degrees) * np.ones(length)
    way = np.cumsum(0.9 * np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0)
    return straight + (np.array(straight[-1]) + way).tolist()


def test_chains_follow_bends_that_are_smaller_than_twice_the_angle_and_end_at_larger_ones():
    # the principal axis of the particle at the bend halves it
    lone = [[2.0 + 2.0 * k, 20.0] for k in range(10)]
    assert [sorted(one) for one in pm.force_chains(laid(bent(50), lone)).chains] == [list(range(8))]
    short = pm.force_chains(laid(bent(50), lone), angle=20.0)
    assert sorted(short.length_k.tolist()) == [3, 4] and short.closed == (False, False)
    row = pm.force_chains(laid(bent(0), lone))
    assert row.length_k.tolist() == [8] and row.stressed_n.sum() == 8 and row.share == pytest.approx(8 / 18)
    assert row.chains[0].tolist() in (list(range(8)), list(range(8))[::-1])
    # force .1 (law 1/2 xi^2 over sigma 1), half the vector .45 at each of two contacts
    assert row.stress_n[1] == pytest.approx(2 * 0.1 * 0.45) and row.stress_n[0] == pytest.approx(0.1 * 0.45)


def test_chains_do_not_branch_and_take_the_straightest_way():
    path = [[2.0 + 0.9 * k, 10.0] for k in range(5)]
    side = [path[4][0] + 0.9 * np.cos(0.9), 10.0 + 0.9 * np.sin(0.9)], [path[4][0] + 0.9, 10.0]
    more = [[side[0][0] + 0.9 * np.cos(0.9) * k, side[0][1] + 0.9 * np.sin(0.9) * k] for k in range(1, 4)]
    ahead = [[side[1][0] + 0.9 * k, 10.0] for k in range(1, 4)]
    lone = [[2.0 + 2.0 * k, 20.0] for k in range(13)]
    found = pm.force_chains(laid([*path, *side, *more, *ahead], lone))
    every = np.concatenate(found.chains)
    assert len(set(every.tolist())) == len(every)
    assert any({3, 4, 6} <= set(one.tolist()) for one in found.chains)
    assert not any({4, 5} <= set(one.tolist()) for one in found.chains)


def test_chains_do_not_know_turned_axes_or_the_names_of_particles():
    scene = jammed()
    order = np.random.default_rng(1).permutation(64)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    packing = scene.packing.replace(
        position_nd=scene.packing.position_nd @ turn.T, box=pm.Box(turn @ scene.packing.box.lattice_dd)
    ).select(order)
    one, two = pm.force_chains(scene), pm.force_chains(scene.replace(packing=packing))
    assert {frozenset(order[c].tolist()) for c in two.chains} == {frozenset(c.tolist()) for c in one.chains}
    assert len(one.chains) > 3 and one.length_k.min() >= 3 and one.stressed_n.mean() < 0.6
    # closed or open, neighbors in a chain touch
    touching = {
        (int(i), int(j)) for i, j in zip(*(lambda c: (c.i_c, c.j_c))(pm.find_contacts(scene.packing)), strict=True)
    }
    for chain in one.chains:
        assert all((min(a, b), max(a, b)) in touching for a, b in zip(chain, chain[1:], strict=False))


@pytest.mark.parametrize("shapes", [None, pm.Ellipses(1.5)])
def test_participation_counts_turns_and_lies_between_one_particle_and_all(shapes):
    scene = jammed(shapes)
    modes = pm.normal_modes(scene)
    found = modes.participation_m
    energy = scene.packing.mass_n * ((modes.displacement_mnd**2).sum(axis=2) + (modes.turn_mnk**2).sum(axis=2))
    # modes are normalized in the mass metric, turns included: without them the sum would fall short
    np.testing.assert_allclose(energy.sum(axis=1), 1.0, rtol=1e-10)
    np.testing.assert_allclose(found, 1.0 / (len(modes.index_n) * (energy**2).sum(axis=1)), rtol=1e-10)
    assert found.min() >= 1.0 / len(modes.index_n) and found.max() <= 1.0


def test_waves_along_a_crystal_take_part_by_two_thirds_or_whole():
    """Of pairs of standing waves, each mode is a mixture whose ratio lies between 2/3 and 1, by closed form."""
    crystal = pm.lattice_packing("triangular", repeats=(5, 1))
    found = pm.normal_modes(pm.Scene(crystal, (pm.Repulsion(),))).participation_m
    assert ((found > 2.0 / 3.0 - 1e-9) & (found < 1.0 + 1e-9)).all()
