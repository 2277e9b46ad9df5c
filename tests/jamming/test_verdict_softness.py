"""Facts about verdicts on soft motions: a soft one that rounding or gaps may hide behind is never called held."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.network import pair_contacts
from packmech.jamming import backbone as judging
from packmech.jamming.certificates import Finding


def saddle(tilt, gap):
    """Return four spheres, and contacts that hold the second between two below and two above it, by little tilts.

    It is free to leave when the gap, of the contact distance, is above half the square of the tilt.
    """
    large, upper = np.sqrt(2.0 + 4.0 * tilt**2) / 2.0, 0.9
    small = np.sqrt(1.0 + tilt**2) - large
    top = 2.0 * tilt + large + upper
    height = top + np.sqrt((large + upper) ** 2 - 2.0)
    place = [[0, 0, 0], [1, 0, tilt], [1, 1, 2 * tilt], [1, 1, top]]
    radius = np.array([large, small, large, upper]) * (1.0 - gap)
    packing = pm.Packing(np.array(place), radius, pm.Box(np.diag([2.0, 2.0, height])))
    contacts = pm.find_contacts(packing, gap_tolerance=1e-8)
    return packing, contacts.select(np.abs(contacts.gap_c) < 1e-8)


def pair_and_saddle(tilt):
    """Return five spheres held at rest, two (5 and 6) that move together freely, one (7) held by little tilts."""
    ends = [[0, 0, 0], [0, 0, 0.5], [0.5, 0.5, 0], [0.5, 0.5, 0.5], [0.5, 0.5, 2 * tilt]]
    place = np.array([*ends, [0.5, 0, 0], [0.5, 0, 0.5], [0, 0.5, tilt]])
    held = list(itertools.combinations(range(5), 2))
    near = [(0, 5), (2, 5), (1, 6), (3, 6), (5, 6), (0, 7), (4, 7)]
    pairs = []
    for (i, j), image in itertools.product(held + near, itertools.product((-1, 0, 1), repeat=3)):
        distance = np.sqrt(((place[j] - place[i] + image) ** 2).sum())
        if (0.3 < distance < 1.6) if (i, j) in held else abs(distance - 0.5) < 1e-3:
            pairs.append((i, j, image))
    packing = pm.Packing(place, np.full(8, 0.25), pm.Box.cubic(1.0, 3))
    i, j, image = (np.array([pair[k] for pair in pairs]) for k in range(3))
    contacts = pair_contacts(packing, i, j, image)
    return packing, replace(contacts, contact_distance_c=contacts.distance_c)


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_sphere_that_is_held_by_tilts_of_its_contacts_belongs_to_the_backbone_where_they_touch(method):
    packing, contacts = saddle(1e-5, 0.0)
    verdict = pm.classify_jamming(packing, contacts=contacts, method=method)
    assert verdict.collective == "jammed" and not verdict.rattlers.any()


@pytest.mark.parametrize("method", ["certificate", "loads"])
@pytest.mark.parametrize(("tilt", "gap"), [(1e-5, 9e-10), (1e-5, 9e-11), (1e-6, 9e-10), (1e-6, 1e-12), (1e-7, 1e-12)])
def test_sphere_is_not_called_held_by_tilts_of_contacts_whose_gaps_let_it_go(tilt, gap, method):
    packing, contacts = saddle(tilt, gap)
    verdict = pm.classify_jamming(packing, contacts=contacts, method=method)
    assert gap > tilt**2 / 2
    assert verdict.collective == "ambiguous" or (verdict.collective == "jammed" and verdict.rattlers[1])


@pytest.mark.parametrize("method", ["certificate", "loads"])
@pytest.mark.parametrize("tilt", [1e-4, 1e-5, 3e-6, 1e-6, 3e-7, 1e-7, 3e-8, 2e-8])
def test_free_pair_beside_a_soft_sphere_is_never_held_and_never_unjams_the_others(tilt, method):
    packing, contacts = pair_and_saddle(tilt)
    verdict = pm.classify_jamming(packing, contacts=contacts, method=method)
    assert verdict.collective == "ambiguous" or verdict.rattlers[5:7].all()
    assert "not jammed" not in (verdict.collective, verdict.strict)


def test_part_that_no_solver_could_judge_leaves_the_answer_open_but_for_strains():
    packing, contacts = pair_and_saddle(1e-3)
    whole = len(pm.classify_jamming(packing, contacts=contacts).touching.contacts)

    def judged(strain):
        def decide(cone):
            if cone.opening.shape[0] < whole:
                return Finding(None, "not known")
            motion = np.zeros(cone.unknowns)
            motion[15:18], motion[24:] = 1.0, strain
            return Finding(False, "moves", motion=motion)

        def part(cone, finding, network):
            return None if finding.jammed is None else network.select(np.arange(len(network) - 20))

        return judging.judge_network(packing, contacts, "free", decide, part)

    assert judged(0.0).jammed == (None, None)
    assert judged(-0.1).jammed == (None, False)
    assert judged(0.0).collective[1].reason == "moves; whether a part is jammed by itself no solver could tell"
