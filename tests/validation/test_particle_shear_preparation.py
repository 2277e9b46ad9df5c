"""Facts about the preset's preparation: how discs are bonded and cut into fragments, in the package's order and law."""

import functools
import pathlib

import numpy as np
import pytest
from scipy import stats

from packmech.validation import particle_shear as ps

SEEDS = range(50)
PARTICLES = 60


@functools.cache
def loose(seed):
    return ps.prepared_discs(ps.ParticleShear(particles=PARTICLES), seed=seed, steps=30)


@functools.cache
def bonded(seed, **how):
    return ps.bond_fragments(loose(seed), seed=seed, **(how or {"centers": 5}))


def inside_bonds(discs):
    """Return the bonds that do not lead through the boundary, as the package tells: by positions as they are."""
    pair_ck = discs.contact_ck[discs.bonded_c]
    apart = np.abs(np.diff(discs.position_nd[pair_ck], axis=1)[:, 0])
    return pair_ck[(apart < (discs.width / 2.0, discs.height / 2.0)).all(axis=1)]


def fragments(discs):
    """Return sets of discs that bonds inside the cell hold together."""
    own = {n: {n} for n in range(discs.discs)}
    for i, j in inside_bonds(discs).tolist():
        if own[i] is not own[j]:
            own[i] |= own[j]
            for n in own[j]:
                own[n] = own[i]
    return list({id(one): one for one in own.values()}.values())


def height(discs, fragment):
    y, r = discs.position_nd[sorted(fragment), 1], discs.radius_n[sorted(fragment)]
    return (y + r).max() - (y - r).min()


def test_no_disc_is_left_without_a_bond_in_fifty_seeds():
    for seed in SEEDS:
        discs = bonded(seed)
        assert np.isin(np.arange(PARTICLES), discs.contact_ck[discs.bonded_c]).all()


def test_no_fragment_spans_the_height_but_by_a_disc_that_was_joined_to_it_in_fifty_seeds():
    higher = 0
    for seed in SEEDS:
        discs = bonded(seed)
        for fragment in fragments(discs):
            if height(discs, fragment) > 0.9 * discs.height:
                higher += 1
                ends = np.bincount(inside_bonds(discs).ravel(), minlength=PARTICLES)
                assert height(discs, {n for n in fragment if ends[n] > 1}) <= 0.9 * discs.height
    # the rule looks at the fragments before isolated discs are joined to them
    assert higher <= 3


def test_fragments_are_allowed_to_span_where_nothing_can_avoid_it_or_by_name():
    for how in ({"centers": 0}, {"centers": 1}, {"lines": 0}, {"centers": 5, "spanning": "allowed"}):
        assert not bonded(3, **how).preparation.no_spanning
    spanning = [
        max(height(one, fragment) for fragment in fragments(one)) > 0.9 * one.height
        for one in (bonded(seed, centers=5, spanning="allowed") for seed in range(20))
    ]
    assert any(spanning)
    assert inside_bonds(bonded(3, centers=0)).shape[0] > 0 and bonded(3, centers=0).bonded_c.all()
    with pytest.raises(ValueError, match="spanning must be 'allowed' .* in each of 2 tries"):
        # two lines next to the vertical leave fragments as high as the cell
        ps.bond_fragments(loose(1), lines=2, avoided_angle=85.0, seed=1, tries=2)


def test_fragments_by_centers_are_those_of_the_nearest_centers():
    discs = loose(1)
    cut = ps.bond_fragments(discs, centers=4, spanning="allowed", seed=7)
    center_kd = np.random.default_rng(7).random((4, 2)) * 500.0
    apart = discs.position_nd[:, None] - center_kd
    owner_n = np.argmin(((apart - 500.0 * np.round(apart / 500.0)) ** 2).sum(axis=2), axis=1)
    same_c = owner_n[discs.contact_ck[:, 0]] == owner_n[discs.contact_ck[:, 1]]
    assert cut.bonded_c[same_c].all() and not same_c.all()
    # the other bonds are those of discs without a bond inside the cell
    before = inside_bonds(discs.replace(kind_c=np.where(same_c, "bond", "slip")))
    joined_ck = discs.contact_ck[cut.bonded_c & ~same_c]
    assert (~np.isin(joined_ck, before)).any(axis=1).all()


def test_fuzziness_mixes_discs_near_the_edges_only():
    sharp = bonded(2, centers=5, spanning="allowed")
    fuzzy = bonded(2, centers=5, spanning="allowed", edge_fuzziness=1e-9)
    # the package draws the numbers of a sharp cut, too
    assert np.array_equal(sharp.kind_c, fuzzy.kind_c)
    rough = bonded(2, centers=5, spanning="allowed", edge_fuzziness=2.0)
    assert rough.bonded_c.sum() < sharp.bonded_c.sum()
    assert rough.preparation.edge_fuzziness == 2.0


@pytest.mark.parametrize("lines", [1, 4])
def test_no_bond_crosses_a_line_nearer_to_the_horizontal_than_is_avoided(lines):
    discs = bonded(5, lines=lines, spanning="allowed")
    assert not discs.preparation.by_centers and discs.preparation.pieces == lines
    assert 0 < discs.bonded_c.sum() < len(discs.bonded_c)


def test_cut_top_and_bottom_leave_no_bond_through_them():
    def through(discs):
        y = discs.position_nd[discs.contact_ck[discs.bonded_c], 1]
        return np.abs(np.diff(y, axis=1))[:, 0] > discs.height / 2.0

    assert through(bonded(1, centers=0)).any()
    cut = ps.bond_fragments(loose(1), centers=0, cut_top_bottom=True, seed=1)
    assert not through(cut).any() and cut.preparation.cut_top_bottom


def test_removed_bonds_leave_fragments_whole_and_are_the_share_asked_for():
    whole, thinned = bonded(6, centers=0), bonded(6, centers=0, removed_fraction=0.3)
    count = len(inside_bonds(whole))
    assert sorted(map(sorted, fragments(whole))) == sorted(map(sorted, fragments(thinned)))
    gone = count - len(inside_bonds(thinned))
    assert gone == np.ceil(0.3 * count)
    assert thinned.preparation.removed == pytest.approx(gone / count, rel=1e-14)
    # what remains of all that can go are trees, or nearly: the package gives up after 1000 failures
    bare = bonded(6, centers=0, removed_fraction=1.0)
    assert len(inside_bonds(bare)) == PARTICLES - len(fragments(whole))


def test_bonds_are_at_rest_and_cut_contacts_slip_without_history():
    discs = bonded(4)
    assert set(discs.kind_c) == {"bond", "slip"} and not discs.history_ck.any()
    assert loose(4).preparation == ps.Preparation(bonded=False)


def test_radii_are_flips_of_a_coin_or_of_equal_numbers():
    experiment = ps.ParticleShear(particles=20)
    large = [
        int((discs.radius_n > discs.radius_n.mean()).sum())
        for discs in (ps.prepared_discs(experiment, seed=seed, steps=1) for seed in range(60))
    ]
    # binomial: 10 +- 2.2, and the mean of 60 within three errors
    assert np.mean(large) == pytest.approx(10.0, abs=3.0 * np.sqrt(5.0 / 60.0)) and np.var(large) > 2.0
    half = ps.prepared_discs(experiment, seed=1, steps=1, radii="equal numbers")
    assert (half.radius_n > half.radius_n.mean()).sum() == 10


def test_the_same_seed_prepares_the_same_discs_and_the_run_keeps_how():
    experiment = ps.ParticleShear(particles=30, pre_periods=0.1, periods=0.1, post_periods=0.0)
    first, second = (ps.prepared_discs(experiment, seed=9, centers=3, steps=10) for _ in range(2))
    assert np.array_equal(first.position_nd, second.position_nd) and np.array_equal(first.kind_c, second.kind_c)
    assert first.time == 0.0 and first.preparation.pieces == 3
    assert experiment.run(first).final.preparation == first.preparation


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, "centers must be given, or else lines, got neither"),
        ({"centers": 2, "lines": 2}, "centers must be given, or else lines, got both"),
        ({"centers": -1}, "centers must be"),
        ({"lines": 1.5}, "lines must be"),
        ({"centers": 2, "spanning": "maybe"}, "spanning must be one of"),
        ({"centers": 2, "avoided_angle": 90.0}, "avoided_angle must be"),
        ({"centers": 2, "removed_fraction": 1.1}, "removed_fraction must be"),
    ],
)
def test_bonding_refuses_what_cannot_be(changes, message):
    with pytest.raises((TypeError, ValueError), match=message):
        ps.bond_fragments(loose(1), seed=1, **changes)


def test_fragments_and_contacts_are_distributed_as_in_fifty_preparations_of_the_package():
    """Two samples of one law: Kolmogorov-Smirnov probabilities above a thousandth for each of seven figures."""
    golden = pathlib.Path(__file__).parent.parent / "golden" / "particle_shear" / "f_preparation_N40.npz"
    experiment = ps.ParticleShear(particles=40)
    found = {name: [] for name in ("fragments", "single", "largest", "height", "bonds", "contacts", "unbonded")}
    for seed in SEEDS:
        one = ps.prepared_discs(experiment, seed=seed, centers=4, edge_fuzziness=0.5, removed_fraction=0.15, steps=30)
        parts = fragments(one)
        sizes = [len(part) for part in parts]
        row = len(parts), sizes.count(1), max(sizes), max(height(one, part) for part in parts) / one.height
        bonded = np.isin(np.arange(one.discs), one.contact_ck[one.bonded_c])
        row += one.bonded_c.sum(), len(one.contact_ck), (~bonded).sum()
        for column, value in zip(found.values(), row, strict=True):
            column.append(value)
    with np.load(golden) as data:
        for name, column in found.items():
            assert stats.ks_2samp(column, data[name]).pvalue > 1e-3, name
