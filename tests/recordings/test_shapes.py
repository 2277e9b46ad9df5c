"""Facts about the studies of shapes: trimers side by side, seven discs, the crossover of shear moduli."""

import numpy as np
import pytest

import packmech as pm


@pytest.fixture(scope="module")
def bodies(script):
    return script("shapes/bodies")


def jammed(bodies, seed, scatter=0.0):
    return pm.jam(pm.Scene(bodies.start(16, 3, 180.0, scatter, seed), (pm.Repulsion(),)), pressure=1e-7)


def side_by_side(shift, apart, beads=3):
    """Return two straight bodies of touching discs of diameter 1, the second moved along and across the first."""
    row = np.column_stack([np.arange(beads, dtype=float), np.zeros(beads)])
    place = np.concatenate([row, row + [shift, apart]]) + [3.0, 3.0]
    return pm.rigid_packing(pm.Packing(place, np.full(2 * beads, 0.5), pm.Box.cubic(12.0, 2)), np.repeat([0, 1], beads))


@pytest.mark.parametrize(
    ("shift", "apart", "contacts", "states"),
    [
        # bead against bead: all normals are parallel, so that three contacts hold one distance and one angle
        (0.0, 1.0, 3, 1),
        # beads in the notches of the other: five contacts hold the three relative coordinates
        (0.5, np.sqrt(0.75), 5, 2),
    ],
)
def test_contacts_of_two_like_straight_bodies_bear_self_stress_among_themselves(shift, apart, contacts, states):
    pair = side_by_side(shift, apart)
    found = pm.find_shape_contacts(pair, gap_tolerance=1e-9)
    assert len(found) == contacts
    assert pm.states_of_self_stress(pair, contacts=found).count == states


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_jammed_like_trimers_have_one_state_of_self_stress_more_than_pairs_of_them_have(bodies, seed):
    run = jammed(bodies, seed)
    within = bodies.states_within_pairs(run.packing)
    assert within > 0 and run.report["rank_certain"]
    assert run.report["states_of_self_stress"] == within + 1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_trimers_whose_beads_differ_a_little_are_isostatic(bodies, seed):
    run = jammed(bodies, seed, scatter=0.05)
    assert bodies.states_within_pairs(run.packing) == 0
    assert run.report["states_of_self_stress"] == 1 and run.report["rank_certain"]


DISTANCES = np.logspace(-5.0, -1.0, 13)


def moduli(place, noise, seeds=10):
    rng = np.random.default_rng(3)
    curve = 0.7 * DISTANCES / np.sqrt(1.0 + DISTANCES / place)
    return curve * np.exp(noise * rng.normal(size=(seeds, len(DISTANCES))))


@pytest.mark.parametrize("place", [1e-3, 2e-2])
def test_crossover_is_found_where_the_exponent_of_the_curve_is_three_quarters(script, place):
    study, known = script("shapes/moduli"), moduli(place, 0.0)
    found = study.crossover(DISTANCES, known)
    assert found == pytest.approx(place, rel=1e-6) and study.crossover_error(DISTANCES, known) < 1e-6
    h = 1e-4
    curve = [np.log(x / np.sqrt(1.0 + x / found)) for x in (found * np.exp(-h), found * np.exp(h))]
    assert (curve[1] - curve[0]) / (2.0 * h) == pytest.approx(0.75, abs=1e-6)


def test_error_of_the_crossover_is_that_of_packings_drawn_again(script):
    study, known = script("shapes/moduli"), moduli(1e-2, 0.2)
    found, error = study.crossover(DISTANCES, known), study.crossover_error(DISTANCES, known)
    assert 0.03 < error < 0.3 and abs(np.log(found / 1e-2)) < 3.0 * error


MECHANICAL_SEED, LOCAL_SEED = 3, 34
AMPLITUDES = np.logspace(-5.0, -0.5, 46)


@pytest.fixture(scope="module")
def discs(script):
    return script("shapes/seven_discs")


@pytest.fixture(scope="module")
def mechanical(discs):
    return pm.Scene(discs.mechanically_stable(MECHANICAL_SEED), (pm.Repulsion(),))


@pytest.fixture(scope="module")
def local(discs):
    return pm.Scene(discs.locally_stable(LOCAL_SEED), (pm.Repulsion(),))


def widest_angle(packing, particle):
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    out = np.concatenate([contacts.normal_cd[contacts.i_c == particle], -contacts.normal_cd[contacts.j_c == particle]])
    angle = np.sort(np.arctan2(out[:, 1], out[:, 0]))
    return np.diff(np.append(angle, angle[0] + 2.0 * np.pi)).max()


def test_search_by_moves_of_single_discs_ends_where_no_disc_can_move_by_itself(local):
    assert max(widest_angle(local.packing, n) for n in range(7)) < np.pi - 0.01


def test_one_is_collectively_jammed_and_the_other_only_locally_at_nearly_the_same_packing_fraction(mechanical, local):
    one, other = pm.classify_jamming(mechanical), pm.classify_jamming(local)
    assert (one.local, one.collective) == ("jammed", "jammed")
    assert (other.local, other.collective) == ("jammed", "not jammed")
    assert not one.rattlers.any() and not other.rattlers.any()
    # 11 distances of 14 coordinates, two of which are translations
    for verdict, counts in ((one, (13, 1, 0)), (other, (11, 0, 1))):
        found = verdict.collectively
        assert (verdict.contacts, found.states_of_self_stress, found.floppy_modes) == counts
    assert abs(pm.packing_fraction(mechanical.packing) - pm.packing_fraction(local.packing)) < 0.01


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_energy_along_the_lowest_mode_grows_as_the_square_in_the_mechanically_stable_one(discs, mechanical, sign):
    amplitude = AMPLITUDES[AMPLITUDES <= 1e-2]
    cost = discs.energy_change(mechanical, sign * discs.lowest_mode(mechanical), amplitude)
    assert np.abs(np.diff(np.log(cost)) / np.diff(np.log(amplitude)) - 2.0).max() < 0.05


def test_energy_along_the_lowest_mode_is_exactly_zero_to_a_finite_amplitude_in_the_locally_stable_one(discs, local):
    mode_nd = discs.lowest_mode(local)
    ways = [discs.energy_change(local, sign * mode_nd, AMPLITUDES) for sign in (1.0, -1.0)]
    ahead, back = (AMPLITUDES[int(np.argmax(one != 0.0)) - 1] for one in ways)
    assert ahead > 0.15 and back > 1e-3
    assert (ways[0][AMPLITUDES <= ahead] == 0.0).all()
    # where the way ends, discs meet that did not touch
    start_nd, unit = local.packing.position_nd, local.packing.reference_diameter
    moved = local.packing.replace(position_nd=start_nd + 1.3 * ahead * unit * mode_nd)
    start, found = pm.find_contacts(local.packing, gap_tolerance=1e-9), pm.find_contacts(moved)
    pairs, now = ({tuple(r) for r in np.column_stack([c.i_c, c.j_c, c.image_cd]).tolist()} for c in (start, found))
    assert pm.energy(local.replace(packing=moved)) > 0.0 and now
    # and no old contact was closed: straight motions that change a distance to second order only make it larger
    assert not now & pairs


def test_middle_of_a_cage_is_as_far_from_three_neighbors_that_surround_it(discs):
    rng = np.random.default_rng(7)
    for _ in range(20):
        ring = np.linspace(0.0, 2.0 * np.pi, 6)[:-1] + rng.uniform(0.0, 0.8, 5)
        others = rng.uniform(0.8, 1.4, 5)[:, None] * np.column_stack([np.cos(ring), np.sin(ring)])
        middle = discs.middle_of_cage(np.zeros(2), others)
        distance = np.sort(np.sqrt(((others - middle) ** 2).sum(axis=1)))
        assert distance[2] - distance[0] < 1e-12
        near = np.sqrt(((others - middle) ** 2).sum(axis=1)) < distance[0] + 1e-9
        # no small step leads farther from all of them
        step = 1e-4 * np.column_stack([np.cos(np.linspace(0, 6.28, 200)), np.sin(np.linspace(0, 6.28, 200))])
        after = np.sqrt(((middle + step[:, None] - others[near]) ** 2).sum(axis=-1)).min(axis=1)
        assert after.max() <= distance[0] + 1e-8


def test_motion_of_an_unbounded_program_is_played_at_unit_size(discs):
    # the solver returns a motion of 1e170 here
    motion = pm.classify_jamming(pm.Scene(discs.locally_stable(51), (pm.Repulsion(),))).unjamming_motion
    assert 0.5 < np.abs(motion.displacement_nd).max() <= 1.0 and motion.opening > 0.01 and motion.closing < 1e-9
