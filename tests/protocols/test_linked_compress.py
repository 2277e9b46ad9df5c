"""Facts about compression from the onset with links: the distances, the onset by another method, links kept."""

import functools

import numpy as np
import pytest

import packmech as pm

HARMONIC = (pm.Repulsion(law=pm.Harmonic()),)
DISTANCES = (1e-6, 1e-5, 1e-2)


@functools.cache
def compressed(shape, dimension, strain):
    wanted = dict(dimension=dimension, packing_fraction={2: 0.35, 3: 0.2}[dimension], seed=2)
    if shape == "chain":
        packing = pm.chain_packing(2, 8, **wanted)
    else:
        packing = pm.cluster_packing(6, pm.Trimer(angle=(1.1, 2.6)), largest_overlap=0.1, **wanted)
    jammed = pm.jam(pm.Scene(packing, HARMONIC), strain=strain)
    return packing, jammed, pm.compress(pm.Scene(jammed.packing, HARMONIC), DISTANCES, strain=strain)


@pytest.mark.parametrize(
    "case", [("trimer", 2, "free"), ("chain", 2, "isotropic"), ("trimer", 3, "isotropic")], ids=str
)
def test_each_distance_above_the_onset_is_reached_in_balance_with_the_links_at_their_lengths(case):
    start, jammed, runs = compressed(*case)
    assert runs[0].report["onset"] == pytest.approx(jammed.report["jamming_packing_fraction"], abs=1e-8)
    for run, distance in zip(runs, DISTANCES, strict=True):
        packing = run.packing
        assert run.report["packing_fraction"] - run.report["onset"] == pytest.approx(distance, abs=1e-12)
        assert run.ok and run.residual < 1e-8
        assert np.abs(packing.link_error).max() <= 1e-13
        assert np.array_equal(packing.links.length_l, start.links.length_l)
        if case[2] == "isotropic":
            edge = [one.box.lattice_dd / one.box.volume ** (1.0 / one.dimension) for one in (packing, start)]
            assert edge[0] == pytest.approx(edge[1], rel=1e-13)
        else:
            assert run.report["stress_anisotropy"] < 1e-8


def test_pressure_of_linked_packings_grows_in_proportion_to_the_distance_while_the_network_stays():
    near, far = compressed("trimer", 2, "free")[2][:2]
    assert all(run.report["contacts_closed"] == run.report["contacts_opened"] == 0 for run in (near, far))
    slope = [run.report["pressure"] / run.report["distance"] for run in (near, far)]
    assert slope[0] == pytest.approx(slope[1], rel=1e-3)


def test_the_onset_is_that_of_the_exact_hard_packing_when_only_rattlers_are_linked():
    discs = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=5)
    hard = pm.jam(pm.Scene(discs, HARMONIC), strain="isotropic")
    packing = hard.packing
    # a dimer in the largest hole of the packing: it touches nothing, and adds its own area alone
    place = packing.box.lattice_dd @ np.random.default_rng(0).uniform(size=(2, 3000))
    shift = packing.box.lattice_dd @ np.array([[a, b] for a in (-1, 0, 1) for b in (-1, 0, 1)]).T
    wrapped = packing.box.wrap(packing.position_nd)[0]
    apart = np.linalg.norm(place.T[:, None, None] - wrapped[:, None] - shift.T, axis=3) - packing.radius_n[:, None]
    gap = apart.min(axis=(1, 2))
    hole, room = place[:, gap.argmax()], gap.max()
    more = pm.Packing(
        np.vstack([packing.position_nd, hole, hole + [0.2 * room, 0.0]]),
        np.append(packing.radius_n, [0.2 * room] * 2),
        packing.box,
        pm.Links([32], [33], [[0, 0]], [0.2 * room]),
    )
    runs = pm.compress(pm.Scene(more, HARMONIC), [1e-5])
    # two discs at the distance of their radius: a union of (4 pi/3 + sqrt(3)/2) radii squared
    union = (0.2 * room) ** 2 * (4 * np.pi / 3 + 3**0.5 / 2)
    added = 1.0 + union / (np.pi * (packing.radius_n**2).sum())
    assert runs[0].report["onset"] == pytest.approx(hard.report["jamming_packing_fraction"] * added, abs=1e-11)
    alone = pm.compress(pm.Scene(packing, HARMONIC), [1e-5 / added])
    assert runs[0].report["contacts"] == alone[0].report["contacts"]
    pressures = [pm.pressure(pm.Scene(run.packing, HARMONIC)) for run in (*runs, *alone)]
    assert pressures[0] == pytest.approx(pressures[1], rel=1e-5)


def test_a_dilute_packing_with_links_is_compressed_until_it_jams_first():
    packing, jammed, _ = compressed("trimer", 2, "free")
    run = pm.compress(pm.Scene(packing, HARMONIC), [1e-4], strain="free")[0]
    assert run.ok and run.report["pressure"] > 0.0
    assert abs(run.report["onset"] - jammed.report["jamming_packing_fraction"]) < 0.1


def test_chains_around_the_box_are_followed_above_their_onset():
    packing = pm.chain_packing(2, 10, dimension=2, packing_fraction=0.4, form="wound", seed=3)
    run = pm.compress(pm.Scene(packing, HARMONIC), [1e-4])[0]
    links = run.packing.links
    assert run.ok and np.abs(run.packing.link_error).max() <= 1e-13
    cluster = links.clusters(run.packing.particles)
    way = np.zeros((2, 2))
    for k, sign in zip(range(len(links)), np.where(links.j_l - links.i_l == 1, 1, -1), strict=True):
        way[cluster[links.i_l[k]]] += sign * links.image_ld[k]
    assert np.abs(way).tolist() == [[1.0, 0.0], [1.0, 0.0]]


def test_a_link_to_a_particles_own_image_is_refused_by_name():
    side = 4.0
    packing = pm.Packing([[0.0, 0.0]], [0.5], pm.Box.cubic(side, 2), pm.Links([0], [0], [[1, 0]], [side]))
    with pytest.raises(ValueError, match="scene.packing must have no link of a particle to its own image"):
        pm.compress(pm.Scene(packing, HARMONIC), [1e-3])
