"""Straight trimers that are alike lie side by side, where contacts between two of them repeat each other."""

import numpy as np
import pytest

import packmech as pm
from packmech.validation.studies import bodies


def jammed(seed, scatter=0.0):
    shape = bodies.body_shape(bodies.TRIMER, 180.0)
    start = pm.random_packing(16, dimension=2, packing_fraction=0.5, seed=seed, shapes=shape)
    if scatter:
        start = bodies.scattered_beads(start, scatter, seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-7)


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
def test_jammed_like_trimers_have_one_state_of_self_stress_more_than_pairs_of_them_have(seed):
    run = jammed(seed)
    within = bodies.states_within_pairs(run.packing)
    assert within > 0 and run.report["rank_certain"]
    assert run.report["states_of_self_stress"] == within + 1


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_trimers_whose_beads_differ_a_little_are_isostatic(seed):
    run = jammed(seed, scatter=0.05)
    assert bodies.states_within_pairs(run.packing) == 0
    assert run.report["states_of_self_stress"] == 1 and run.report["rank_certain"]
