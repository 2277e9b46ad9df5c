"""Facts about copies of packings: crystals for all repeats, and random packings against programs on the copies."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import packmech as pm
from packmech.jamming.tiled import _commensurate, _cover, _Waves, judge_tiled


def jammed(particles, seed, strain):
    start = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed
    )  # fmt: skip
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-9, strain=strain, check=False)


def waves_of(packing):
    verdict = pm.classify_jamming(packing)
    return _Waves(packing, verdict.network, verdict.backbone)


@pytest.mark.parametrize(
    ("name", "repeats", "answer"),
    [
        ("triangular", (3, 3), "jammed"),
        ("triangular", (3, 4), "jammed"),
        ("square", (3, 3), "not jammed"),
        ("kagome", (2, 2), "not jammed"),
        ("honeycomb", (2, 2), "not jammed"),
        pytest.param("fcc", (2, 2, 2), "jammed", marks=pytest.mark.slow),
        pytest.param("hcp", (2, 2, 2), "jammed", marks=pytest.mark.slow),
    ],
)
def test_crystals_for_all_repeats(name, repeats, answer):
    tiled = pm.classify_jamming(pm.lattice_packing(name, repeats=repeats), tiled=True).tiled
    assert (tiled.collective, tiled.strict) == (answer, answer)


@pytest.mark.parametrize("seed", range(4))
def test_discs_jammed_in_a_fixed_shape_unjam_in_two_boxes_and_the_program_says_so(seed):
    # d N' - d + 1 contacts are fewer than the d N' coordinates of waves
    run = jammed(20, seed, "isotropic")
    verdict = pm.classify_jamming(run.packing, tiled=True)
    if verdict.collective != "jammed":
        pytest.skip("not jammed in one box")
    tiled = verdict.tiled
    assert tiled.collective == tiled.strict == "not jammed" and sorted(tiled.repeats) == [1, 2]
    assert max(tiled.motion.closing, tiled.motion.opening) < 1e-12
    assert pm.classify_jamming(tiled.packing).collective == "not jammed"


@pytest.mark.parametrize("seed", range(2))
def test_discs_that_also_resist_shear_are_jammed_in_copies_and_programs_agree(seed):
    run = jammed(16, seed, "free")
    verdict = pm.classify_jamming(run.packing, tiled=True)
    assert verdict.strict == "jammed"
    tiled = verdict.tiled
    assert tiled.collective == tiled.strict == "jammed" and tiled.cells > 100 and tiled.smallest_singular_value > 0.0
    for repeats in ((2, 1), (2, 2)):
        found = pm.classify_jamming(run.packing.repeated(repeats))
        assert (found.collectively.first_order_jammed, found.strictly.first_order_jammed) == (True, True)
        assert pm.classify_jamming(run.packing, tiled=repeats).tiled.strict == "jammed"


@pytest.mark.parametrize(("pressure", "seed"), [(1e-4, 2), (1e-3, 1)])
def test_copies_are_left_open_where_gaps_that_may_be_contacts_would_jam_them(pressure, seed):
    start = pm.random_packing(16, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="isotropic", check=False)
    verdict = pm.classify_jamming(run.packing, tiled=True)
    assert verdict.collective == "jammed" and verdict.tiled.collective == "ambiguous"
    assert "gap tolerance is off its plateau" in verdict.tiled.reason
    assert pm.classify_jamming(run.packing.repeated((1, 2))).collective == "ambiguous"
    # by the pairs that press there is no such doubt, and the program finds the motion of two copies
    pressing = pm.classify_jamming(run.packing, contacts=pm.find_contacts(run.packing), tiled=True).tiled
    copies = pressing.packing
    assert pressing.collective == "not jammed" and pressing.repeats == (1, 2)
    assert pm.classify_jamming(copies, contacts=pm.find_contacts(copies)).collective == "not jammed"


@pytest.mark.parametrize("seed", range(3))
def test_the_bounds_hold_at_wave_vectors_drawn_at_random(seed):
    waves = waves_of(jammed(16, seed, "free").packing)
    rng = np.random.default_rng(seed)
    for _ in range(40):
        middle, half = rng.uniform(-0.5, 0.5, size=2), rng.uniform(0.0, 0.05, size=2)
        there = middle + rng.uniform(-1.0, 1.0, size=2) * half
        assert abs(waves.smallest(middle) - waves.smallest(there)) <= waves.change(half)


@pytest.mark.parametrize("seed", range(3))
def test_the_bound_for_long_waves_holds_for_waves_drawn_at_random(seed):
    waves = waves_of(jammed(16, seed, "free").packing)
    rng = np.random.default_rng(seed)
    long, bounds = waves.long_waves(), waves.strained()
    assert long > 0.0
    reciprocal = 2.0 * np.pi * waves.packing.box.inverse_dd
    for angle in rng.uniform(0.0, 2.0 * np.pi, size=40):
        size = float(rng.uniform(0.0, 1.0)) * long
        k = size * np.array([np.cos(angle), np.sin(angle)])
        rows = waves.rows(np.linalg.solve(reciprocal.T, k))
        moved = rng.normal(size=rows.shape[1]) + 1j * rng.normal(size=rows.shape[1])
        mean = moved.reshape(-1, 2).mean(axis=0)
        rest = moved - np.tile(mean, len(moved) // 2)
        # waves that are all but translations, and others
        for part in (1.0, 1e-3):
            wave = np.tile(mean, len(moved) // 2) + part * rest
            alpha, beta = bounds.errors(size)
            x = bounds.scale * np.linalg.norm(mean) * size / np.sqrt(2.0)
            w = part * np.linalg.norm(rest)
            assert np.linalg.norm(rows @ wave) >= bounds.smallest * np.hypot(x, w) - alpha * x - beta * w


def test_a_wave_that_changes_nothing_is_no_proof_however_small_its_cell(monkeypatch):
    waves = waves_of(jammed(16, 0, "free").packing)
    there = np.array([0.312, 0.27])
    monkeypatch.setattr(waves, "smallest", lambda f: 0.9 * waves.change(np.abs(f - there)) + 1e-16)
    found = _cover(waves)
    assert found.collective == "ambiguous"
    np.testing.assert_allclose(found.wave_vector_d, there, atol=1e-6)
    # nor where a part of its cell is about 0, where the bound for long waves holds
    k = 2.0 * np.pi * there @ waves.packing.box.inverse_dd
    monkeypatch.setattr(waves, "long_waves", lambda: 0.9 * float(np.sqrt(k @ k)))
    assert _cover(waves).collective == "ambiguous"


def test_one_disc_among_its_own_images_is_jammed_for_all_repeats():
    tiled = pm.classify_jamming(pm.lattice_packing("triangular", repeats=(1, 1)), tiled=True).tiled
    assert (tiled.collective, tiled.strict) == ("jammed", "jammed")


@pytest.mark.parametrize("seed", range(2))
def test_where_particles_are_written_does_not_matter(seed):
    packing = jammed(16, seed, "free").packing
    away = np.random.default_rng(seed).integers(-2, 3, size=(16, 2))
    moved = packing.replace(position_nd=packing.position_nd + away @ packing.box.lattice_dd.T)
    one, two = (pm.classify_jamming(p, tiled=(3, 2)).tiled for p in (packing, moved))
    assert (one.collective, one.strict) == (two.collective, two.strict)


def test_rows_of_all_waves_are_the_rows_of_copies():
    packing = jammed(16, 0, "free").packing
    waves = waves_of(packing)
    repeats = (2, 3)
    values = np.concatenate(
        [
            np.linalg.svd(waves.rows(np.array([a / 2, b / 3])), compute_uv=False)
            for a, b in itertools.product(range(2), range(3))
        ]
    )
    many = packing.repeated(repeats)
    rattling = np.tile(~waves.backbone_n, 6)
    contacts = pm.find_contacts(many, gap_tolerance=1e-6)
    inside = ~rattling[contacts.i_c] & ~rattling[contacts.j_c]
    rows = pm.rigidity_matrix(many, "none", contacts=contacts.select(inside)).toarray()
    rows = rows[:, np.repeat(~rattling, 2)]
    np.testing.assert_allclose(np.sort(values), np.sort(np.linalg.svd(rows, compute_uv=False)), atol=1e-12)


def test_each_wave_of_copies_is_looked_at_once_up_to_its_conjugate():
    found = _commensurate((4, 3))
    listed = {tuple(np.round(fraction, 12)) for _, fraction in found}
    opposite = {tuple(np.round(-fraction % 1.0, 12)) for _, fraction in found}
    assert len(listed) == len(found)
    # only waves that are their own conjugates are in both
    assert all(2.0 * a % 1.0 == 0.0 and 2.0 * b % 1.0 == 0.0 for a, b in listed & opposite)
    for many, fraction in found:
        np.testing.assert_allclose(fraction * many, np.rint(fraction * many), atol=1e-12)
    # all fractions with denominators up to 4 and 3
    parts = [{p / k for k in range(1, n + 1) for p in range(k)} for n in (4, 3)]
    every = {(a, b) for a, b in itertools.product(*parts)} - {(0.0, 0.0)}
    assert listed | opposite == {tuple(np.round(one, 12)) for one in every}


@pytest.mark.parametrize(
    ("tiled", "message"),
    [
        ((0, 1), "tiled must be between 1 and 12"),
        ((2, 50), "tiled must be between 1 and 12"),
        ((2,), "tiled must have"),
    ],
)
def test_bad_numbers_of_copies_are_refused(tiled, message):
    with pytest.raises(ValueError, match=message):
        pm.classify_jamming(pm.lattice_packing("triangular", repeats=(3, 3)), tiled=tiled)
    with pytest.raises(ValueError, match='which gives no contact forces: method="certificate"'):
        pm.classify_jamming(pm.lattice_packing("triangular", repeats=(3, 3)), tiled=True, method="loads")


def test_without_forces_on_every_contact_copies_are_not_jammed_for_sure():
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    found = pm.classify_jamming(packing)
    for force_c in (None, 1.0 * (np.arange(27) > 0)):
        answer = replace(found.collectively, contact_force_c=force_c)
        tiled = judge_tiled(packing, answer, found.strictly, found.network, found.backbone, (2, 2))
        assert tiled.collective == "ambiguous" and "no forces are known" in tiled.reason


def test_copies_are_no_more_strictly_jammed_than_one_box():
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    found = pm.classify_jamming(packing)
    for word in ("jammed", "not jammed", "ambiguous"):
        strictly = replace(found.strictly, verdict=word)
        tiled = judge_tiled(packing, found.collectively, strictly, found.network, found.backbone, (2, 2))
        assert (tiled.collective, tiled.strict) == ("jammed", word)


def test_fewer_contacts_than_coordinates_have_no_smallest_singular_value_but_zero():
    waves = waves_of(jammed(20, 0, "isotropic").packing)
    assert waves.count < waves.size and waves.smallest(np.array([0.3, 0.1])) == 0.0


def test_strains_that_cost_nothing_but_rounding_leave_no_bound_for_long_waves(monkeypatch):
    waves = waves_of(jammed(16, 0, "free").packing)
    assert waves.long_waves() > 0.0
    floppy = waves.strained()._replace(smallest=1e-12)
    monkeypatch.setattr(waves, "strained", lambda: floppy)
    assert waves.long_waves() == 0.0


def test_the_motion_of_copies_does_not_depend_on_the_phase_of_its_wave(monkeypatch):
    waves = waves_of(jammed(20, 0, "isotropic").packing)
    half = np.array([0.0, 0.5])
    wave = waves.floppy(half)
    # at half a reciprocal vector waves are real up to a phase
    wave = (wave * np.exp(-1j * np.angle(wave[np.argmax(np.abs(wave))]))).real
    moved = []
    for factor in (1.0, 1j):
        monkeypatch.setattr(waves, "floppy", lambda _, factor=factor: factor * wave)
        motion = waves.motion(half, (1, 2))[1]
        assert max(motion.closing, motion.opening) < 1e-12
        moved.append(motion.displacement_nd)
    np.testing.assert_allclose(moved[0], moved[1], rtol=1e-12)


def test_the_bound_on_rows_is_above_those_of_a_disc_among_its_images():
    waves = waves_of(pm.lattice_packing("triangular", repeats=(1, 1)))
    # rows 2 i n sin(phi) of three contacts, two of them with sin(phi) = 1: their n n^T add up to eigenvalues of 3/2
    norm = np.linalg.norm(waves.rows(np.array([0.5, 0.0])), 2)
    assert norm == pytest.approx(2.0 * np.sqrt(1.5), rel=1e-12) and norm <= waves.bound * (1.0 + 1e-12)


def test_links_and_shapes_are_refused():
    chain = pm.chain_packing(2, 4, dimension=2, packing_fraction=0.3, seed=1)
    with pytest.raises(ValueError, match="rigid links"):
        pm.classify_jamming(chain, tiled=True)
