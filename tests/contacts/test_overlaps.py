"""Facts about the check of all pairs that packings of hard particles pass."""

import numpy as np

import packmech as pm
from packmech.contacts.overlaps import largest_overlap, overlap_of_hard


def pair_at(distance, image=0.0, shapes=None):
    return pm.Packing([[0.1, 0.2], [0.1 + distance + image, 0.2]], [0.5, 1.0], pm.Box.cubic(8.0, 2), shapes=shapes)


def test_the_overlap_is_over_the_contact_distance_and_names_its_pair_and_image():
    found = largest_overlap(pair_at(1.2, image=-8.0))
    assert abs(found.relative - 0.2) < 1e-14
    assert found.pair == (0, 1, 1, 0)
    assert str(found) == "particles 0 and 1 across the box [1, 0] overlap by 2.0e-01 of their contact distance"


def test_ellipses_side_by_side_overlap_by_their_short_axes():
    # semi-axes 2, 1/2 and 4, 1 of areas of discs of radius 1/2 and 1 for aspect 4 are r * sqrt(4), r / sqrt(4)
    shapes = pm.Spheroids([4.0, 4.0], [[0.0, 1.0], [0.0, 1.0]])
    assert abs(largest_overlap(pair_at(0.6, shapes=shapes)).relative - 0.2) < 1e-12


def test_hard_discs_may_overlap_by_a_trillionth_and_no_more():
    assert overlap_of_hard(pair_at(1.5 * (1.0 - 5e-13))) is None
    assert overlap_of_hard(pair_at(1.5 * (1.0 - 2e-12))) is not None
    assert overlap_of_hard(pair_at(1.6)) is None


def test_rattlers_of_soft_packings_overlap_by_less_than_the_force_tolerance():
    for ratio, seed in ((1.4, 2), (3.0, 3), (10.0, 3)):
        sizes = pm.Bidisperse(ratio=ratio)
        start = pm.random_packing(32, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
        run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-4, strain="isotropic")
        rattling, contacts = pm.find_rattlers(run.packing), pm.find_contacts(run.packing)
        assert rattling.any()
        loose = rattling[contacts.i_c] | rattling[contacts.j_c]
        found = largest_overlap(run.packing, rattling)
        assert (0.0 if found is None else found.relative) <= 1e-5 * float(np.mean(contacts.overlap_c[~loose]))


def test_the_hard_packing_that_jam_reports_has_no_overlap():
    for ratio, dimension in ((1.4, 2), (3.0, 2), (3.0, 3)):
        sizes = pm.Bidisperse(ratio=ratio)
        start = pm.random_packing(24, dimension=dimension, sizes=sizes, packing_fraction=0.6, seed=4)
        for method in (pm.HardVertex(), pm.ProgramChain()):
            run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), strain="isotropic", method=method)
            assert overlap_of_hard(run.report["hard_packing"]) is None
