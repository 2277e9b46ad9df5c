"""Facts about contacts that a user gives: what does not belong to the packing as it stands is named."""

from dataclasses import replace

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.given import check_given

CRYSTAL = pm.lattice_packing("triangular", (3, 3))
TINY = pm.lattice_packing("triangular", (1, 1))


def touching(packing=CRYSTAL):
    return pm.find_contacts(packing, gap_tolerance=1e-9)


def changed(name, contact, value):
    contacts = touching()
    values = getattr(contacts, name).copy()
    values[contact] = value
    return replace(contacts, **{name: values})


def other_side(contacts, contact):
    """Return the contacts with one of them told from its other end."""
    i, j, image, normal = (getattr(contacts, name).copy() for name in ("i_c", "j_c", "image_cd", "normal_cd"))
    i[contact], j[contact] = j[contact], i[contact]
    image[contact] *= -1
    normal[contact] *= -1.0
    return replace(contacts, i_c=i, j_c=j, image_cd=image, normal_cd=normal)


@pytest.mark.parametrize("packing", [CRYSTAL, TINY, pm.lattice_packing("fcc", (2, 2, 2))], ids=["2d", "images", "3d"])
def test_contacts_found_belong_in_any_order_and_from_either_side(packing):
    contacts = touching(packing)
    order = np.random.default_rng(0).permutation(len(contacts))
    check_given(packing, contacts)
    check_given(packing, contacts.select(order))
    check_given(packing, contacts.select(order[:2]))
    check_given(packing, other_side(contacts, 0))
    check_given(packing, contacts.select(order[:0]))


@pytest.mark.parametrize("packing", [CRYSTAL, TINY], ids=["pairs", "own images"])
def test_the_same_pair_twice_is_refused_from_the_other_side_too(packing):
    contacts = touching(packing)
    double = contacts.select([*range(len(contacts)), 1])
    for given in (double, other_side(double, len(contacts))):
        with pytest.raises(ValueError, match=f"name each pair once, got .* for contacts 1 and {len(contacts)}"):
            check_given(packing, given)


@pytest.mark.parametrize(
    ("contacts", "message"),
    [
        (changed("j_c", 4, 9), "between particles 0 to 8, got . and 9 for contact 4"),
        (changed("i_c", 2, -1), "between particles 0 to 8, got -1 and . for contact 2"),
        (changed("image_cd", 5, [3, 0]), r"vectors from center to center, .* contact 5 .* image \[3, 0\]"),
        (changed("distance_c", 7, 1.01), "vectors from center to center, .* for contact 7"),
        (changed("distance_c", 7, np.nan), "vectors from center to center, .* for contact 7"),
        (changed("normal_cd", 3, [0.6, 0.8]), "vectors from center to center, .* for contact 3"),
        (
            changed("contact_distance_c", 6, 0.9),
            "or its distances, got 0.9 instead of 1 or 1 for contact 6",
        ),
    ],
    ids=["j", "i", "image", "distance", "no number", "normal", "radii"],
)
def test_contact_that_is_not_the_packing_s_is_named(contacts, message):
    for function in (pm.classify_jamming, pm.find_rattlers, pm.remove_rattlers):
        with pytest.raises(ValueError, match=message):
            function(CRYSTAL, contacts=contacts)


def test_pairs_are_said_to_touch_by_their_distances_whatever_the_radii_are():
    small = CRYSTAL.replace(radius_n=np.full(9, 1e-9))
    contacts = touching()
    assert pm.classify_jamming(small, contacts=contacts).strict == "jammed"
    with pytest.raises(ValueError, match="got 0.9 instead of 2e-09 or 1 for contact 6"):
        check_given(small, changed("contact_distance_c", 6, 0.9))


def test_particle_in_contact_with_itself_is_refused():
    contacts = touching()
    j, image = contacts.j_c.copy(), contacts.image_cd.copy()
    j[0], image[0] = contacts.i_c[0], 0
    with pytest.raises(ValueError, match="two particles or images, got 0 and itself for contact 0"):
        check_given(CRYSTAL, replace(contacts, j_c=j, image_cd=image))


def test_contacts_of_another_packing_of_as_many_particles_are_refused():
    other = CRYSTAL.replace(position_nd=CRYSTAL.position_nd[::-1].copy())
    with pytest.raises(ValueError, match="contacts must have the packing's vectors"):
        pm.classify_jamming(other, contacts=touching())


def test_particles_may_have_moved_a_little_since_their_contacts_were_found():
    shaken = CRYSTAL.replace(position_nd=CRYSTAL.position_nd + 1e-8 * np.sin(np.arange(18)).reshape(9, 2))
    assert pm.classify_jamming(shaken, contacts=touching()).strict == "jammed"


@pytest.mark.parametrize("overlap", [0.2, -0.05])
def test_contacts_of_particles_that_overlap_or_are_apart_belong_by_their_sums_of_radii_or_by_their_distances(overlap):
    packing = pm.lattice_packing("triangular", (3, 3), relative_overlap=overlap)
    contacts = pm.find_contacts(packing, gap_tolerance=0.1)
    assert len(contacts) == 27
    check_given(packing, contacts)
    check_given(packing, replace(contacts, contact_distance_c=contacts.distance_c.copy()))
    between = 0.5 * (contacts.distance_c + contacts.contact_distance_c)
    with pytest.raises(ValueError, match="sums of radii or its distances, got .* for contact 0"):
        check_given(packing, replace(contacts, contact_distance_c=between))


@pytest.mark.parametrize(("way", "belong"), [(0.9e-6, True), (1.1e-6, False)])
def test_particles_may_have_moved_by_a_millionth_of_their_distance(way, belong):
    position = CRYSTAL.position_nd.copy()
    position[4, 0] += way
    moved = CRYSTAL.replace(position_nd=position)
    if belong:
        check_given(moved, touching())
    else:
        with pytest.raises(ValueError, match="vectors from center to center"):
            check_given(moved, touching())
