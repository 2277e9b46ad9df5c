"""Facts about cases in which a naive method gives the wrong answer: its answer is shown beside the right one."""

import functools

import numpy as np
import pytest
from scipy.optimize import linprog

import packmech as pm

YES, NO, UNKNOWN = "jammed", "not jammed", "ambiguous"
EFFECTS = (pm.Repulsion(),)


def dense_rows(packing, contacts, particles=None):
    """Return the rigidity matrix in the fixed box, columns of the given particles only."""
    columns = np.arange(packing.particles) if particles is None else np.flatnonzero(particles)
    columns = (columns[:, None] * packing.dimension + np.arange(packing.dimension)).ravel()
    return pm.rigidity_matrix(packing, "none", contacts=contacts).toarray()[:, columns]


def some_forces_balance(rows):
    """Return the naive answer of forces alone: jammed if forces of at least one on every contact balance."""
    found = linprog(
        np.zeros(len(rows)), A_eq=rows.T, b_eq=np.zeros(rows.shape[1]), bounds=(1.0, None), method="highs-ds"
    )
    assert found.status in (0, 2)
    return YES if found.status == 0 else NO


def no_motion_is_free(rows, dimension):
    """Return the naive answer of rank alone: jammed if only translations keep the length of every contact."""
    return YES if np.linalg.matrix_rank(rows, tol=1e-6) == rows.shape[1] - dimension else NO


def counted(packing, contacts, rattlers):
    """Return the naive answer of Maxwell counting: jammed if there are d (N' - 1) + 1 contacts."""
    return YES if len(contacts) >= packing.dimension * (int((~rattlers).sum()) - 1) + 1 else NO


@functools.cache
def made(particles, dimension, pressure=1e-8, seed=1):
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.87 if dimension == 2 else 0.68
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    return pm.jam(pm.Scene(start, EFFECTS), pressure=pressure, strain="isotropic").packing


@pytest.mark.parametrize("name", ["square", "honeycomb", "kagome"])
def test_positive_self_stress_with_floppy_modes_is_jammed_by_forces_alone_and_is_not(name):
    crystal = pm.lattice_packing(name, (3, 3))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    rows = dense_rows(crystal, contacts)
    assert some_forces_balance(rows) == YES
    assert no_motion_is_free(rows, 2) == NO
    for method in ("certificate", "loads"):
        assert pm.classify_jamming(crystal, method=method).collective == NO


@pytest.mark.parametrize("which", [0, 40, -1])
@pytest.mark.parametrize("dimension", [2, 3])
def test_full_rank_without_positive_self_stress_is_jammed_by_rank_alone_and_is_not(dimension, which):
    packing = made(64 if dimension == 2 else 32, dimension)
    verdict = pm.classify_jamming(packing)
    assert verdict.collective == YES and verdict.states_of_self_stress["none"] == 1
    part = verdict.network.select(np.argsort(np.argsort(verdict.contact_force_c)) != which % verdict.contacts)
    rows = dense_rows(packing, part, verdict.backbone)
    assert no_motion_is_free(rows, dimension) == YES
    assert some_forces_balance(rows) == NO
    for method in ("certificate", "loads"):
        less = pm.classify_jamming(packing, contacts=part, method=method)
        assert less.collective == less.strict == NO


def test_isostatic_count_less_a_contact_plus_one_elsewhere_is_jammed_by_counting_and_is_not():
    # two crystals side by side: contacts to spare in the one make up for those that are missing beside it
    crystal = pm.lattice_packing("triangular", (6, 6))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    part = contacts.select(~((contacts.i_c < 12) & (np.abs(contacts.normal_cd[:, 1]) > 0.1)))
    assert counted(crystal, part, np.zeros(36, dtype=bool)) == YES
    for method in ("certificate", "loads"):
        assert pm.classify_jamming(crystal, contacts=part, method=method).collective == NO


def test_rattlers_kept_unjam_every_packing_by_rank_and_they_alone_move():
    packing = made(64, 2)
    verdict = pm.classify_jamming(packing)
    contacts = pm.find_contacts(packing, gap_tolerance=verdict.touching.tolerance)
    rattlers = int(verdict.rattlers.sum())
    assert rattlers > 0
    kept = dense_rows(packing, contacts)
    assert no_motion_is_free(kept, 2) == NO
    assert kept.shape[1] - 2 - np.linalg.matrix_rank(kept, tol=1e-6) == 2 * rattlers
    assert no_motion_is_free(dense_rows(packing, verdict.network, verdict.backbone), 2) == YES
    for method in ("certificate", "loads"):
        assert pm.classify_jamming(packing, method=method).collective == YES


def test_counting_rattlers_as_particles_makes_a_jammed_packing_lack_contacts():
    packing = made(64, 2)
    verdict = pm.classify_jamming(packing)
    assert counted(packing, verdict.network, np.zeros(64, dtype=bool)) == NO
    assert counted(packing, verdict.network, verdict.rattlers) == YES == verdict.collective


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_unconverged_packing_is_called_not_jammed_without_a_look_at_its_forces_and_is_ambiguous(share):
    # displaced by a part of the overlaps, some weak contacts open: what is left does not balance
    packing = made(64, 2)
    overlap = float(pm.find_contacts(packing).overlap_c.max())
    push = np.random.default_rng(3).standard_normal(packing.position_nd.shape)
    shaken = packing.replace(position_nd=packing.position_nd + share * overlap * push)
    verdict = pm.classify_jamming(shaken)
    assert (verdict.local, verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN, UNKNOWN)
    assert "not at rest" in verdict.collectively.reason and verdict.rest.residual > 1e-3
    # the naive answer takes for contacts what overlaps
    overlapping = pm.find_contacts(shaken)
    naive = pm.classify_jamming(shaken, contacts=overlapping.select(overlapping.overlap_c > 0))
    assert naive.collective == NO


def source_program(rows, load):
    """Return the motion of the source's program as printed: A y <= 0, |y_k| <= 1, translations among the motions."""
    found = linprog(load, A_ub=rows, b_ub=np.zeros(len(rows)), bounds=(-1.0, 1.0), method="highs-ds")
    assert found.status == 0
    return found.x


@pytest.mark.parametrize("seed", range(3))
def test_translation_not_removed_unjams_every_packing_and_is_all_that_moves(seed):
    packing = made(64, 2)
    verdict = pm.classify_jamming(packing)
    rows = dense_rows(packing, verdict.network, verdict.backbone)
    load = np.random.default_rng(seed).standard_normal(rows.shape[1])
    for sign in (1.0, -1.0):
        motion = source_program(rows, sign * load).reshape(-1, 2)
        assert np.abs(motion).max() > 0.999
        assert np.abs(motion - motion.mean(axis=0)).max() < 1e-6
    assert verdict.collective == YES == pm.classify_jamming(packing, method="loads", seed=seed).collective


def test_printed_sign_gives_motions_that_close_contacts():
    packing = made(64, 2)
    verdict = pm.classify_jamming(packing)
    part = verdict.network.select(np.arange(verdict.contacts) != 20)
    rows = dense_rows(packing, part, verdict.backbone)
    load = np.random.default_rng(0).standard_normal(rows.shape[1])
    closing = [(rows @ source_program(rows, sign * load)).min() for sign in (1.0, -1.0)]
    assert min(closing) < -1e-3
    less = pm.classify_jamming(packing, contacts=part)
    assert less.collective == NO and less.unjamming_motion.closing < 1e-9 < 1e-3 < less.unjamming_motion.opening


def test_gaps_of_1e_minus_4_at_256_in_three_dimensions_hide_that_a_contact_is_missing():
    packing = made(256, 3)
    verdict = pm.classify_jamming(packing)
    wide = pm.find_contacts(packing, gap_tolerance=1e-4)
    assert verdict.collective == YES and verdict.states_of_self_stress["none"] == 1
    # a tolerance of 1e-4 counts near misses: more states of self stress than the one that there is
    naive = pm.classify_jamming(packing, contacts=wide)
    assert naive.states_of_self_stress["none"] > 1
    # so that it stays "jammed" without one of the weak contacts that it cannot do without
    for one in np.argsort(verdict.contact_force_c)[16:24]:
        answers = {}
        for name, contacts in (("near", verdict.touching.contacts), ("wide", wide)):
            same = (contacts.i_c == verdict.network.i_c[one]) & (contacts.j_c == verdict.network.j_c[one])
            same &= (contacts.image_cd == verdict.network.image_cd[one]).all(axis=1)
            assert same.sum() == 1
            answers[name] = pm.classify_jamming(packing, contacts=contacts.select(~same)).collective
        assert answers["near"] == NO
        if answers["wide"] == YES:
            return
    pytest.fail("no contact can be spared by the near misses")
