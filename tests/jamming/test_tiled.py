"""Facts about copies of packings: crystals for all repeats, and random packings against programs on the copies."""

import itertools

import numpy as np
import pytest

import packmech as pm
from packmech.jamming.tiled import _commensurate, _Waves, copies_of


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
        found = pm.classify_jamming(copies_of(run.packing, repeats))
        assert (found.collectively.first_order_jammed, found.strictly.first_order_jammed) == (True, True)
        assert pm.classify_jamming(run.packing, tiled=repeats).tiled.strict == "jammed"


@pytest.mark.parametrize("seed", range(3))
def test_the_bounds_hold_at_wave_vectors_drawn_at_random(seed):
    waves = waves_of(jammed(16, seed, "free").packing)
    rng = np.random.default_rng(seed)
    for _ in range(40):
        middle, half = rng.uniform(-0.5, 0.5, size=2), rng.uniform(0.0, 0.05, size=2)
        there = middle + rng.uniform(-1.0, 1.0, size=2) * half
        assert abs(waves.smallest(middle) - waves.smallest(there)) <= waves.change(half)
    long = waves.long_waves()
    assert long > 0.0
    reciprocal = 2.0 * np.pi * waves.packing.box.inverse_dd
    for angle in rng.uniform(0.0, 2.0 * np.pi, size=20):
        for part in (1.0, 0.3):
            k = part * long * np.array([np.cos(angle), np.sin(angle)])
            assert waves.smallest(np.linalg.solve(reciprocal.T, k)) > 0.0


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
    many = copies_of(packing, repeats)
    rattling = np.tile(~waves.backbone_n, 6)
    contacts = pm.find_contacts(many, gap_tolerance=1e-6)
    inside = ~rattling[contacts.i_c] & ~rattling[contacts.j_c]
    rows = pm.rigidity_matrix(many, "none", contacts=contacts.select(inside)).toarray()
    rows = rows[:, np.repeat(~rattling, 2)]
    np.testing.assert_allclose(np.sort(values), np.sort(np.linalg.svd(rows, compute_uv=False)), atol=1e-12)


def test_each_wave_of_copies_is_looked_at_once_up_to_its_conjugate():
    found = _commensurate((4, 3))
    assert len({tuple(fraction) for _, fraction in found}) == len(found)
    for many, fraction in found:
        np.testing.assert_allclose(fraction * many, np.rint(fraction * many), atol=1e-12)
    # all fractions with denominators up to 4 and 3
    parts = [{p / k for k in range(1, n + 1) for p in range(k)} for n in (4, 3)]
    every = {(a, b) for a, b in itertools.product(*parts)} - {(0.0, 0.0)}
    listed = {tuple(f) for _, f in found} | {tuple((-one) % 1.0 for one in f) for _, f in found}
    assert {tuple(np.round(one, 12)) for one in listed} == {tuple(np.round(one, 12)) for one in every}


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
    with pytest.raises(ValueError, match="tiled must be left out with method"):
        pm.classify_jamming(pm.lattice_packing("triangular", repeats=(3, 3)), tiled=True, method="loads")


def test_links_and_shapes_are_refused():
    chain = pm.chain_packing(2, 4, dimension=2, packing_fraction=0.3, seed=1)
    with pytest.raises(ValueError, match="rigid links"):
        pm.classify_jamming(chain, tiled=True)
