"""Facts about kinds of particles: numbers of each are exact, places are drawn; what is made of a packing keeps them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.loop.checkpoint import scene_fingerprints
from packmech.protocols.shearing.families import _hard_packing
from packmech.protocols.shearing.local_yield import _cut

EFFECTS = (pm.Repulsion(),)


def discs(particles=24, seed=1, **kwargs):
    return pm.random_packing(particles, dimension=2, packing_fraction=0.9, seed=seed, **kwargs)


def striped(packing, kinds=3):
    """Return the packing with kinds 0, 1, ... in turn."""
    return packing.replace(kind_n=np.arange(packing.particles) % kinds)


# -- assign_kinds ------------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6).filter(any), st.integers(1, 40), st.integers(0, 99))
def test_numbers_of_each_kind_are_within_one_of_their_shares(shares, particles, seed):
    packing = pm.Packing(np.zeros((particles, 2)), 0.5, 9.0)
    kind_n = pm.assign_kinds(packing, shares, seed=seed).kind_n
    count_k = np.bincount(kind_n, minlength=len(shares))
    assert count_k.sum() == particles and len(count_k) == len(shares)
    assert np.abs(count_k - particles * np.array(shares) / sum(shares)).max() < 1.0 + 1e-6
    assert (count_k[np.array(shares) == 0.0] == 0).all()


def test_the_largest_remainders_get_what_is_left_and_the_earlier_kind_where_they_tie():
    # shares of 10: 4.5, 4.5, 1; of 7: 3.5, 2.1, 1.4
    assert np.bincount(pm.assign_kinds(discs(10), (45, 45, 10), seed=3).kind_n).tolist() == [5, 4, 1]
    assert np.bincount(pm.assign_kinds(discs(7), (0.5, 0.3, 0.2), seed=3).kind_n).tolist() == [4, 2, 1]


def test_every_particle_is_of_a_kind_as_often_as_its_share_says():
    packing = discs(10)
    drawn = np.array([pm.assign_kinds(packing, (0.7, 0.3), seed=seed).kind_n for seed in range(2000)])
    # binomial: standard error sqrt(0.21 / 2000) = 0.0102
    assert np.abs(drawn.mean(axis=0) - 0.3).max() < 5.0 * 0.0103
    # without replacement two particles are both of kind 1 with probability (3/10) (2/9)
    assert abs((drawn[:, 0] * drawn[:, 7]).mean() - 3 / 10 * 2 / 9) < 5.0 * np.sqrt(0.0667 * 0.9333 / 2000)


def test_the_same_seed_gives_the_same_kinds_and_a_generator_goes_on():
    packing, rng = discs(40), np.random.default_rng(5)
    one, other = (pm.assign_kinds(packing, (1, 1), rng=rng) for _ in range(2))
    assert one == pm.assign_kinds(packing, (1, 1), seed=5) != other


def test_all_else_of_the_packing_stays_as_it_is():
    springs = pm.TangentialDisplacements([0], [1], [[0, 0]], [[0.1]])
    packing = discs().replace(mass_n=np.arange(1.0, 25.0)).replace(tangential=springs)
    assigned = pm.assign_kinds(packing, (1, 2), seed=1)
    assert assigned.tangential == springs
    assert assigned != packing and assigned.replace(kind_n=None) == packing


def test_kinds_by_size_number_sizes_from_the_smallest_whatever_rounding_made_of_them():
    packing = pm.Packing(np.zeros((6, 2)), [0.7, 0.5, 0.5 * (1 + 1e-12), 1.0, 0.7, 0.5], 9.0)
    assert pm.assign_kinds(packing, by="size").kind_n.tolist() == [1, 0, 0, 2, 1, 0]


@pytest.mark.parametrize(
    ("packing", "arguments", "message"),
    [
        (discs(), {}, r"^shares must be given \(or by='size'\), got None"),
        (discs(), {"shares": (1, 1)}, "^seed must be an integer"),
        (discs(), {"shares": (1, -1), "seed": 1}, "^shares must not be negative, got -1 for kind 1"),
        (discs(), {"shares": (0, 0), "seed": 1}, "^shares must not all be zero"),
        (discs(), {"shares": np.ones(65), "seed": 1}, "^shares must be of at most 64 kinds, got 65"),
        (discs(), {"shares": (1, float("nan")), "seed": 1}, "^shares must be finite"),
        (discs(), {"shares": (1, 1), "by": "size"}, "^shares must be left out with by='size'"),
        (discs(), {"seed": 1, "by": "size"}, "^seed must be left out with by='size', got 1"),
        (discs(), {"by": "mass"}, "^by must be one of 'size', got 'mass'"),
        (
            discs(sizes=pm.LogNormal(0.1)),
            {"by": "size"},
            "^packing must have a few sizes, .*: 24 sizes of 24 particles",
        ),
        (
            pm.Packing(np.zeros((130, 2)), np.repeat(np.arange(1.0, 66.0), 2), 999.0),
            {"by": "size"},
            "^packing must have at most 64 sizes for kinds by size, got 65",
        ),
    ],
)
def test_wrong_arguments_are_refused_by_name(packing, arguments, message):
    with pytest.raises(ValueError, match=message):
        pm.assign_kinds(packing, **arguments)


# -- what is made of a packing -----------------------------------------------------------------------------------------


def test_bodies_have_the_kind_of_their_beads_and_beads_that_of_their_body():
    dimers = pm.cluster_packing(6, pm.Dimer(), dimension=2, packing_fraction=0.4, seed=1)
    kind_n = np.array([0, 3, 1, 1, 0, 2])
    bodies = pm.rigid_packing(dimers.replace(kind_n=np.repeat(kind_n, 2)))
    assert bodies.kind_n.tolist() == kind_n.tolist()
    assert pm.bead_packing(bodies).kind_n.tolist() == np.repeat(kind_n, 2).tolist()
    assert pm.rigid_packing(dimers).kind_n is None


def test_a_body_of_beads_of_two_kinds_is_refused():
    dimers = pm.cluster_packing(3, pm.Dimer(), dimension=2, packing_fraction=0.4, seed=1)
    with pytest.raises(ValueError, match="beads are of one kind, got kinds 2 and 0 in body 1"):
        pm.rigid_packing(dimers.replace(kind_n=[0, 0, 2, 0, 0, 0]))


def test_selected_wrapped_scattered_and_thinned_packings_keep_kinds():
    packing = striped(discs())
    kept = packing.kind_n != 1
    assert packing.select(kept).kind_n.tolist() == packing.kind_n[kept].tolist()
    assert packing.wrapped().kind_n.tolist() == packing.kind_n.tolist()
    assert pm.at_packing_fraction(packing, 0.5).kind_n.tolist() == packing.kind_n.tolist()
    assert pm.scattered_packing(packing, packing_fraction=0.3, seed=2).kind_n.tolist() == packing.kind_n.tolist()
    # of as many kinds as particles, those of a thinned crystal say which ones are left
    crystal = striped(pm.lattice_packing("triangular", repeats=(6, 6)), kinds=36)
    thinned = pm.vacancy_packing(crystal, 5, seed=1)
    assert np.array_equal(thinned.position_nd, crystal.position_nd[thinned.kind_n])


def test_minimized_jammed_and_decompressed_packings_keep_kinds():
    packing = striped(discs(16))
    scene = pm.Scene(packing, EFFECTS)
    assert pm.quench(scene, force_tolerance=1e-9).packing.kind_n.tolist() == packing.kind_n.tolist()
    run = pm.jam(scene, pressure=1e-4, strain="isotropic", method=pm.HardVertex())
    for found in (run.packing, run.report["hard_packing"], run.report["packing_below_onset"]):
        assert found.kind_n.tolist() == packing.kind_n.tolist()


@pytest.mark.parametrize("method", [pm.ProgramChain(), pm.Decompression(), pm.StepHalving()])
def test_every_jamming_method_keeps_kinds(method):
    packing = striped(discs(12))
    run = pm.jam(pm.Scene(packing, EFFECTS), strain="isotropic", method=method, check=False)
    assert run.packing.kind_n.tolist() == packing.kind_n.tolist()


def test_a_hard_packing_in_reduced_units_and_a_patch_that_is_cut_out_have_kinds():
    packing = striped(discs(32))
    run = pm.jam(pm.Scene(packing, EFFECTS), pressure=1e-6, strain="isotropic")
    assert _hard_packing(run.packing).packing.kind_n.tolist() == packing.kind_n.tolist()
    sheared = pm.shear_families(run.packing, 1e-3)
    assert sheared.packing.kind_n.tolist() == packing.kind_n.tolist()
    patch = _cut(pm.Scene(run.packing, EFFECTS), run.packing.position_nd[0], 1.0, 0.3).scene.packing
    assert patch.particles < packing.particles
    # radii tell which particles they are in a packing of one size for each
    sizes = run.packing.replace(radius_n=0.5 + 1e-6 * np.arange(32))
    patch = _cut(pm.Scene(sizes, EFFECTS), sizes.position_nd[0], 1.0, 0.3).scene.packing
    own = np.rint((patch.radius_n - 0.5) / 1e-6).astype(int)
    assert patch.kind_n.tolist() == packing.kind_n[own].tolist()


def test_a_packing_moved_in_time_and_each_of_a_batch_keeps_kinds():
    packing = striped(discs(16))
    run = pm.simulate(pm.Scene(packing, EFFECTS), steps=4, dt=0.01, trace_every=2, trace_positions=True)
    assert run.packing.kind_n.tolist() == packing.kind_n.tolist()
    frames = list(pm.snapshots(run, pm.Scene(packing, EFFECTS)))
    assert len(frames) > 1 and all(one.packing.kind_n.tolist() == packing.kind_n.tolist() for one in frames)
    batch = pm.QuenchBatch(pm.Scene(packing, EFFECTS), 2, force_tolerance=1e-8)
    assert [batch.packing(b).kind_n.tolist() for b in range(2)] == 2 * [packing.kind_n.tolist()]


def test_scenes_that_differ_in_kinds_alone_have_other_fingerprints():
    packing = discs()
    plain, zero, one, other = (
        scene_fingerprints(pm.Scene(packing.replace(kind_n=kind_n), EFFECTS))["packing"]
        for kind_n in (None, np.zeros(24, dtype=int), np.arange(24) % 2, (np.arange(24) + 1) % 2)
    )
    assert plain == zero
    assert len({plain, one, other}) == 3
