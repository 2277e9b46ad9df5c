"""Cementing: compliance against independent methods, what each contact adds, and thresholds."""

import numpy as np
import pytest
import scipy.linalg as sl

import packmech as pm
from packmech.linalg.mandel import mandel_basis

BIDISPERSE = pm.Bidisperse(ratio=1.4)


def jammed(particles, dimension):
    start = pm.random_packing(particles, dimension=dimension, sizes=BIDISPERSE, packing_fraction=0.6, seed=1)
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-7).packing
    return pm.Scene(packing, (pm.Repulsion(),))


@pytest.fixture(scope="module")
def scenes():
    return {2: jammed(24, 2), 3: jammed(32, 3)}


def dense_compliance(scene, links, kind):
    """Return the compliance from the null space of the links' gradients and of uniform translations."""
    packing = scene.packing
    d, hessian = packing.dimension, pm.hessian(scene, strain="free", kind=kind).toarray()
    s = d * (d + 1) // 2
    vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
    distance = np.sqrt((vector**2).sum(axis=1))
    normal = vector / distance[:, None]
    rows = np.zeros((len(links) + d, len(hessian)))
    for k in range(len(links)):
        for a in range(d):
            rows[k, d * links.j_l[k] + a] += normal[k, a]
            rows[k, d * links.i_l[k] + a] -= normal[k, a]
        rows[k, -s:] = [distance[k] * normal[k] @ strain @ normal[k] for strain in mandel_basis(d)]
    for a in range(d):
        rows[len(links) + a, a:-s:d] = 1.0
    motion = sl.null_space(rows, rcond=1e-10)
    value, mode = np.linalg.eigh(motion.T @ hessian @ motion)
    firm = value > 1e-11 * value[-1]
    strain = (motion @ mode)[-s:, firm]
    return packing.box.volume * (strain / value[firm]) @ strain.T


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("freeze", ["angles", "clusters", "nothing"])
@pytest.mark.parametrize("kind", ["unstressed", "exact"])
def test_compliance_is_that_of_a_dense_null_space(scenes, dimension, freeze, kind):
    scene = scenes[dimension]
    found = pm.cement(scene, seed=2, freeze=freeze, kind=kind)
    moving = np.flatnonzero(found.stiff_k < len(found.compliance_kee[0]))
    for k in moving[1::3]:
        expected = dense_compliance(scene, found.links.select(found.added_l <= found.cemented_k[k]), kind)
        assert np.abs(found.compliance_kee[k] - expected).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("freeze", ["angles", "clusters"])
def test_compliance_is_that_of_explicit_links(scenes, dimension, freeze):
    found = pm.cement(scenes[dimension], seed=0, freeze=freeze, kind="exact")
    for k in np.flatnonzero(found.stiff_k == 0)[::3]:
        expected = pm.compliance_matrix(pm.Scene(found.packing_at(k), (pm.Repulsion(),)))
        assert np.abs(found.compliance_kee[k] - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("freeze", ["angles", "nothing"])
def test_compliance_of_particles_of_two_kinds_is_that_of_a_dense_null_space_and_of_explicit_links(freeze):
    start = pm.random_packing(24, dimension=2, sizes=BIDISPERSE, packing_fraction=0.6, seed=1)
    law = pm.LawByKind([[pm.Harmonic(1.0), pm.Harmonic(4.0)], [pm.Harmonic(4.0), pm.Harmonic(0.3)]])
    scene = pm.Scene(pm.assign_kinds(start, (1, 1), seed=2), (pm.Repulsion(law),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-6).packing)
    assert len(set(pm.find_contacts(scene.packing, gap_tolerance=0.0).kinds_c.tolist())) == 3
    found = pm.cement(scene, seed=2, freeze=freeze, kind="exact")
    moving = np.flatnonzero(found.stiff_k < len(found.compliance_kee[0]))
    for k in moving[::3]:
        expected = dense_compliance(scene, found.links.select(found.added_l <= found.cemented_k[k]), "exact")
        assert np.abs(found.compliance_kee[k] - expected).max() < 1e-11 * np.abs(expected).max()
    for k in np.flatnonzero(found.stiff_k == 0)[::3]:
        expected = pm.compliance_matrix(scene.replace(packing=found.packing_at(k)))
        assert np.abs(found.compliance_kee[k] - expected).max() < 1e-9 * np.abs(expected).max()


def test_bounds_are_those_of_moduli_with_links(scenes):
    found = pm.cement(scenes[3], seed=0, kind="exact")
    moduli = pm.elastic_moduli(pm.Scene(found.packing_at(6), (pm.Repulsion(),)))
    for bound in ("voigt", "reuss"):
        expected, reached = moduli.average(bound, tangent="energy"), getattr(found, bound)(6)
        assert reached.bulk_modulus == pytest.approx(expected.bulk_modulus, rel=1e-9)
        assert reached.shear_modulus == pytest.approx(expected.shear_modulus, rel=1e-9)


@pytest.mark.parametrize("freeze", ["angles", "clusters", "nothing"])
def test_a_positive_matrix_leaves_the_compliance_at_each_step(scenes, freeze):
    for scene in scenes.values():
        compliance = pm.cement(scene, seed=3, freeze=freeze).compliance_kee
        for before, after in zip(compliance[:-1], compliance[1:], strict=True):
            assert np.linalg.eigvalsh(before - after)[0] > -1e-12 * np.abs(compliance[0]).max()


def test_bounds_are_ordered_and_never_fall(scenes):
    for scene in scenes.values():
        found = pm.cement(scene, seed=4)
        steps = range(len(found.cemented_k))
        low, high = [found.reuss(k) for k in steps], [found.voigt(k) for k in steps]
        for name in ("bulk_modulus", "shear_modulus"):
            lower, upper = (np.array([getattr(x, name) for x in bounds]) for bounds in (low, high))
            assert (lower <= upper * (1.0 + 1e-12)).all()
            assert (lower[1:] >= lower[:-1] * (1.0 - 1e-12)).all()
            assert (upper[1:] >= upper[:-1] * (1.0 - 1e-12)).all()


def test_cementing_ends_at_complete_rigidity(scenes):
    found = pm.cement(scenes[3], seed=0)
    assert found.stiff_k[-1] == 6 and not found.compliance_kee[-1].any()
    assert np.isinf(found.reuss(-1).shear_modulus) and np.isinf(found.reuss(-1).bulk_modulus)
    assert np.isnan(found.poisson_ratio(-1))
    assert found.cemented_k[-2] < found.all_stiff <= found.cemented_k[-1]
    assert found.first_stiff < found.all_stiff


def test_thresholds_do_not_depend_on_the_step(scenes):
    fine, coarse = (pm.cement(scenes[3], seed=1, step=step) for step in (0.01, 0.4))
    assert (fine.first_stiff, fine.all_stiff) == (coarse.first_stiff, coarse.all_stiff)


def test_the_start_has_one_state_of_self_stress(scenes):
    for scene in scenes.values():
        counted = pm.states_of_self_stress(scene.packing, strain="isochoric").count
        assert pm.cement(scene, step=2.0).self_stress == counted == 1


def path_of_four(scene):
    """Return contacts a-b, b-c, c-d with no contact among others of the four, and these contacts' places."""
    contacts = pm.find_contacts(scene.packing, gap_tolerance=1e-9)
    bears = ~pm.find_rattlers(scene.packing)
    ends = [(int(i), int(j)) for i, j in zip(contacts.i_c, contacts.j_c, strict=True)]
    around = {n: [(k, i + j - n) for k, (i, j) in enumerate(ends) if n in (i, j)] for n in range(len(bears))}
    for a in np.flatnonzero(bears):
        for one, b in around[a]:
            for two, c in around[b]:
                for three, e in around[c]:
                    four = {int(a), b, c, e}
                    if len(four) == 4 and sum(i in four and j in four for i, j in ends) == 3:
                        return [one, two, three]
    raise AssertionError("no such path")


@pytest.mark.parametrize(("freeze", "links"), [("nothing", 3), ("angles", 5), ("clusters", 6)])
def test_a_chain_of_four_in_space_may_turn_about_its_middle_bond_unless_clusters_are_frozen(scenes, freeze, links):
    found = pm.cement(scenes[3], order=path_of_four(scenes[3]), freeze=freeze)
    assert len(found.links) == links
    assert np.count_nonzero(~found.links.shape_l) == 3


def test_frozen_angles_make_whole_clusters_rigid_in_a_plane(scenes):
    for seed in range(3):
        one, other = (pm.cement(scenes[2], seed=seed, freeze=freeze) for freeze in ("angles", "clusters"))
        assert (one.first_stiff, one.all_stiff) == (other.first_stiff, other.all_stiff)
        size = np.abs(one.compliance_kee[0]).max()
        assert np.abs(one.compliance_kee - other.compliance_kee).max() < 1e-11 * size


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_rigid_cluster_around_the_box_cannot_be_strained_along_its_way(scenes, dimension):
    seen = 0
    for seed in range(6):
        found = pm.cement(scenes[dimension], seed=seed, freeze="clusters")
        # one way around, two ways, three ways
        assert set(found.stiff_k) <= ({0, 1, 3} if dimension == 2 else {0, 1, 3, 6})
        if len(found.first_direction_ke) == 1:
            seen += 1
            tensor = np.einsum("e,eab->ab", found.first_direction_ke[0], mandel_basis(dimension))
            value, vector = np.linalg.eigh(tensor * np.sign(np.trace(tensor)))
            assert value[-1] == pytest.approx(1.0, abs=1e-9)
            way = np.linalg.solve(scenes[dimension].packing.box.lattice_dd, vector[:, -1])
            way /= np.abs(way[np.abs(way) > 1e-9]).min()
            assert np.abs(way - way.round()).max() < 1e-7
    assert seen >= 2


def test_a_contact_that_is_held_already_counts_but_adds_nothing():
    scene = pm.Scene(pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=1e-6), (pm.Repulsion(),))
    contacts = pm.find_contacts(scene.packing, gap_tolerance=0.0)
    pairs = list(zip(contacts.i_c.tolist(), contacts.j_c.tolist(), strict=True))
    i, j = pairs[0]
    k = next(k for k in range(16) if (min(i, k), max(i, k)) in pairs and (min(j, k), max(j, k)) in pairs)
    triangle = [pairs.index((min(x), max(x))) for x in ((i, j), (j, k), (i, k))]
    found = pm.cement(scene, order=triangle, step=1 / 16)
    assert found.cemented_k.tolist() == [0, 1, 2, 3] and len(found.links) == 3
    assert np.array_equal(found.compliance_kee[2], found.compliance_kee[3])


def test_one_seed_gives_the_same_bits_and_another_another_order(scenes):
    one, again, other = (pm.cement(scenes[3], seed=seed) for seed in (7, 7, 8))
    assert np.array_equal(one.compliance_kee, again.compliance_kee) and one.links == again.links
    assert not np.array_equal(one.contact_l[:10], other.contact_l[:10])


def test_order_given_by_hand_repeats_the_drawn_one(scenes):
    drawn = pm.cement(scenes[3], seed=5)
    given = pm.cement(scenes[3], order=drawn.contact_l)
    assert np.array_equal(drawn.compliance_kee, given.compliance_kee)


def test_a_packing_that_yields_to_a_strain_is_refused():
    square = pm.Scene(pm.lattice_packing("square", repeats=(3, 3)), (pm.Repulsion(),))
    with pytest.raises(ValueError, match="^scene.packing must resist every strain"):
        pm.cement(square)
    loose = pm.random_packing(20, dimension=2, packing_fraction=0.1, seed=0)
    with pytest.raises(ValueError, match=r"^scene.packing must be jammed"):
        pm.cement(
            pm.Scene(pm.quench(pm.Scene(loose, (pm.Repulsion(),)), force_tolerance=1e-9).packing, (pm.Repulsion(),))
        )


def test_a_link_that_hangs_on_others_by_a_hair_is_found_as_dependent():
    # the dependence is small on the last link of its cluster: one squared pivot alone does not show it
    packing = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.6, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-7).packing)
    curve = pm.cement(scene, seed=2, freeze="clusters")
    moduli = pm.elastic_moduli(scene.replace(packing=curve.packing_at(20)))
    assert len(moduli.stiff_directions) == curve.stiff_k[20] == 1
