"""Facts about cementing packings that have links, and clusters that grow."""

import collections
import functools

import numpy as np
import pytest

import packmech as pm
from packmech.protocols.cement import backbone_of, drawn_order


@functools.cache
def linked(seed=1, dimension=2, pressure=1e-6):
    start = pm.cluster_packing(
        24, pm.Trimer(angle=(1.1, 2.6)), dimension=dimension, packing_fraction=0.35, largest_overlap=0.1, seed=seed
    )
    scene = pm.Scene(start, (pm.Repulsion(pm.Harmonic()),))
    return scene.replace(packing=pm.jam(scene, pressure=pressure).packing)


@functools.cache
def monomers(seed=1, particles=32):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(pm.Hertz()),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-6).packing)


@pytest.mark.parametrize("kind", ["exact", "unstressed"])
def test_before_cementing_moduli_are_those_of_the_linked_packing(kind):
    scene = linked()
    found = pm.cement(scene, kind=kind, step=0.02, order=first_contacts(scene, 2))
    moduli = pm.elastic_moduli(scene, kind=kind)
    inverse = np.linalg.inv(found.compliance_kee[0])
    assert np.abs(inverse - moduli.energy).max() < 1e-8 * np.abs(moduli.energy).max()


def first_contacts(scene, count):
    """Return contacts between particles that bear force."""
    contacts = pm.find_contacts(scene.packing, gap_tolerance=0.0)
    rattling = pm.find_rattlers(scene.packing)
    return np.flatnonzero(~rattling[contacts.i_c] & ~rattling[contacts.j_c])[:count]


@functools.cache
def with_free_ends(dimension):
    """Dimers of which some can turn at no cost about the bead that presses on others."""
    shape = pm.Dimer(length=0.8, radii=(0.5, 0.35))
    start = pm.cluster_packing(16, shape, dimension=dimension, packing_fraction=0.3, largest_overlap=0.1, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-6).packing)


def far_from_moduli(found, scene, kind):
    """Return by how much each step without stiff strains differs from the moduli of the packing with all its links."""
    far = []
    for step in np.flatnonzero(found.stiff_k == 0):
        energy = pm.elastic_moduli(scene.replace(packing=found.packing_at(step)), kind=kind).energy
        far.append(np.abs(np.linalg.inv(found.compliance_kee[step]) - energy).max() / np.abs(energy).max())
    return np.array(far)


@pytest.mark.parametrize("freeze", ["angles", "clusters", "nothing"])
@pytest.mark.parametrize("kind", ["exact", "unstressed"])
def test_each_step_is_the_packing_with_its_own_and_the_cemented_links(freeze, kind):
    scene = linked(seed=2)
    found = pm.cement(scene, kind=kind, freeze=freeze, seed=3, step=0.06)
    assert len(found.packing_at(1).links) > len(scene.packing.links)
    far = far_from_moduli(found, scene, kind)
    assert len(far) > 3 and far.max() < 1e-10


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kind", ["exact", "unstressed"])
def test_ends_that_turn_at_no_cost_resist_nothing_before_they_are_held(dimension, kind):
    scene = with_free_ends(dimension)
    moduli = pm.elastic_moduli(scene, kind=kind)
    assert moduli.floppy_positions > 0 and moduli.stable
    found = pm.cement(scene, kind=kind, seed=1)
    far = far_from_moduli(found, scene, kind)
    assert len(far) > 5 and far.max() < 1e-10
    assert found.self_stress == pm.states_of_self_stress(scene.packing, strain="isochoric").count
    assert found.stiff_k[-1] == dimension * (dimension + 1) // 2
    again = pm.cement(scene, kind=kind, order=found.contact_l, step=2.0)
    assert (again.first_stiff, again.all_stiff) == (found.first_stiff, found.all_stiff)


def test_links_that_are_strongly_compressed_are_held_however_soft_the_springs_of_contacts():
    scene = linked(seed=1, pressure=3e-3)
    assert pm.elastic_moduli(scene).stable
    found = pm.cement(scene, kind="exact", seed=2, step=0.1)
    far = far_from_moduli(found, scene, "exact")
    assert len(far) > 2 and far.max() < 1e-10


@pytest.mark.parametrize("kind", ["exact", "unstressed"])
def test_a_linked_packing_that_yields_to_a_strain_is_refused(kind):
    square = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=1e-3)
    contacts = pm.find_contacts(square, gap_tolerance=0.0)
    link = pm.Links(contacts.i_c[:1], contacts.j_c[:1], contacts.image_cd[:1], contacts.distance_c[:1])
    with pytest.raises(ValueError, match="^scene.packing must resist every strain"):
        pm.cement(pm.Scene(square.replace(links=link), (pm.Repulsion(),)), kind=kind)


def test_bounds_never_fall_and_hill_lies_between_them():
    found = pm.cement(linked(seed=3), seed=1)
    assert found.all_stiff is not None
    for step in range(len(found.cemented_k)):
        low, middle, high = found.reuss(step), found.hill(step), found.voigt(step)
        for name in ("bulk_modulus", "shear_modulus"):
            assert getattr(low, name) <= getattr(middle, name) * (1 + 1e-12)
            assert getattr(middle, name) <= getattr(high, name) * (1 + 1e-12)
            if step:
                assert getattr(found.reuss(step - 1), name) <= getattr(low, name) * (1 + 1e-9)
        anisotropy = found.anisotropy(step)
        assert anisotropy > -1e-9 and (np.isfinite(anisotropy) == np.isfinite(high.bulk_modulus + high.shear_modulus))
    assert found.curves["bulk_hill"][-1] == found.curves["shear_hill"][-1] == found.curves["anisotropy"][-1] == np.inf


def test_anisotropy_and_hill_are_those_of_the_moduli():
    scene = monomers()
    found = pm.cement(scene, kind="unstressed")
    moduli = pm.elastic_moduli(scene, kind="unstressed")
    tensor = moduli.energy
    one = np.array([1.0, 1.0, 0.0])
    bulk = one @ tensor @ one / 4.0
    shear = (np.trace(tensor) - one @ tensor @ one / 2.0) / 4.0
    inverse = np.linalg.inv(tensor)
    soft_bulk, soft_shear = 1.0 / (one @ inverse @ one), 2.0 / (2.0 * (np.trace(inverse) - one @ inverse @ one / 2.0))
    assert found.hill(0).bulk_modulus == pytest.approx((bulk + soft_bulk) / 2.0, rel=1e-9)
    assert found.hill(0).shear_modulus == pytest.approx((shear + soft_shear) / 2.0, rel=1e-9)
    assert found.anisotropy(0) == pytest.approx(bulk / soft_bulk + 2.0 * shear / soft_shear - 3.0, rel=1e-8)


def test_aggregation_grows_one_cluster():
    scene = monomers(seed=2, particles=48)
    found = pm.cement(scene, order="aggregate", seed=4, freeze="nothing")
    contacts = pm.find_contacts(scene.packing, gap_tolerance=0.0)
    cluster = set()
    for k, c in enumerate(found.contact_l.tolist()):
        ends = {int(contacts.i_c[c]), int(contacts.j_c[c])}
        assert k == 0 or ends & cluster
        cluster |= ends
    again = pm.cement(scene, order="aggregate", seed=4, freeze="nothing")
    assert np.array_equal(found.contact_l, again.contact_l)


def test_links_of_the_packing_belong_to_the_cluster_that_grows():
    scene = linked(seed=2)
    backbone = backbone_of(scene, "unstressed", None)
    contacts, body = backbone.contacts, scene.packing.links.clusters(scene.packing.particles)
    order = drawn_order("aggregate", backbone, np.random.default_rng(7))
    assert np.array_equal(np.sort(order), np.arange(len(contacts)))
    cluster, beyond = set(), 0
    for k, c in enumerate(order.tolist()):
        ends = {int(contacts.i_c[c]), int(contacts.j_c[c])}
        bodies = {int(body[n]) for n in ends}
        assert k == 0 or bodies & {int(body[n]) for n in cluster}
        beyond += k > 0 and not ends & cluster
        cluster |= ends
    assert beyond > 0


def test_the_next_contact_of_a_cluster_is_each_with_equal_chances():
    """All contacts that touch the first one come second equally often: a chi-square of a few degrees of freedom."""
    backbone = backbone_of(monomers(seed=2, particles=48), "unstressed", None)
    contacts = backbone.contacts
    drawn = [drawn_order("aggregate", backbone, np.random.default_rng(seed))[:2].tolist() for seed in range(4000)]
    first = drawn[0][0]
    seen = collections.Counter(second for one, second in drawn if one == first)
    ends = {int(contacts.i_c[first]), int(contacts.j_c[first])}
    assert all({int(contacts.i_c[c]), int(contacts.j_c[c])} & ends for c in seen)
    count = np.array(list(seen.values()))
    assert ((count - count.mean()) ** 2 / count.mean()).sum() < 30.0
