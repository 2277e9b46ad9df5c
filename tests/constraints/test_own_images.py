"""Facts about links of a particle to its own image: honored as held strains, or refused by one message."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def crystal():
    """Return a triangular crystal with a small disc in a hole, and the same with that disc linked to its own image."""
    whole = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=1e-3)
    # above the middle between two neighbors in a row: far from all three discs around the hole
    row = whole.box.lattice_dd[:, 0] / 4.0
    hole = whole.position_nd[0] + row / 2.0 + np.array([-row[1], row[0]]) / (2.0 * np.sqrt(3.0))
    free = pm.Packing(np.vstack([whole.position_nd, hole]), np.append(whole.radius_n, 0.05), whole.box)
    length = float(np.linalg.norm(whole.box.lattice_dd[:, 0]))
    return free, free.replace(links=pm.Links([16], [16], [[1, 0]], [length]))


def scene(packing):
    return pm.Scene(packing, (pm.Repulsion(),))


FREE, LINKED = crystal()
# calls on the state as it stands, whose answer the link changes just where a strain of the box is among the freedoms
SAME = {
    "energy": lambda packing: pm.energy(scene(packing)),
    "forces": lambda packing: pm.forces(scene(packing)),
    "stress": lambda packing: pm.stress_tensor(scene(packing)),
    "pressure": lambda packing: pm.pressure(scene(packing)),
    "contacts": lambda packing: pm.find_contacts(packing).overlap_c,
    "packing fraction": pm.packing_fraction,
    "crossings": lambda packing: len(pm.crossing_links(packing)),
    "rigidity matrix": lambda packing: pm.rigidity_matrix(packing).toarray(),
    "hessian": lambda packing: pm.hessian(scene(packing)).toarray(),
    "dynamical matrix": lambda packing: pm.dynamical_matrix(scene(packing)).toarray(),
}
HELD = {
    "constraint jacobian": lambda packing: pm.constraint_jacobian(packing, strain="free").shape[1],
    "constraint basis": lambda packing: -pm.constraint_basis(packing, strain="free").freedoms,
    "change of basis": lambda packing: -min(pm.change_of_basis(packing).shape),
    "stiff directions": lambda packing: len(pm.elastic_moduli(scene(packing)).stiff_directions),
    "compliance": lambda packing: (np.abs(pm.compliance_matrix(scene(packing))).max(axis=0) == 0.0).sum(),
    "compliance by pseudoinverse": lambda packing: (
        np.abs(pm.compliance_matrix(scene(packing), method="pseudoinverse")).max(axis=0) < 1e-14
    ).sum(),
}
REFUSED = {
    "quench": lambda: pm.quench(scene(LINKED), force_tolerance=1e-6),
    "quench batch": lambda: pm.QuenchBatch(scene(LINKED)),
    "jam": lambda: pm.jam(scene(LINKED)),
    "compress": lambda: pm.compress(scene(LINKED), [1e-3]),
    "shear_stabilize": lambda: pm.shear_stabilize(scene(LINKED)),
    "simulate": lambda: pm.simulate(scene(LINKED), duration=0.1),
    "reaffix_links": lambda: pm.reaffix_links(LINKED),
    "scattered_packing": lambda: pm.scattered_packing(LINKED, packing_fraction=0.5, seed=1),
    "coordination_number": lambda: pm.coordination_number(LINKED),
    "find_rattlers": lambda: pm.find_rattlers(LINKED),
    "remove_rattlers": lambda: pm.remove_rattlers(LINKED),
    "find_rattling_clusters": lambda: pm.find_rattling_clusters(LINKED),
    "classify_jamming": lambda: pm.classify_jamming(LINKED),
}


@pytest.mark.parametrize("name", SAME)
def test_calls_in_the_box_as_it_is_answer_as_without_the_link(name):
    assert np.array_equal(SAME[name](LINKED), SAME[name](FREE))


@pytest.mark.parametrize("name", HELD)
def test_calls_that_know_strains_hold_the_one_that_the_link_holds(name):
    assert HELD[name](LINKED) == HELD[name](FREE) + 1


@pytest.mark.parametrize("name", REFUSED)
def test_calls_that_would_not_honor_the_link_refuse_it_by_one_message(name):
    with pytest.raises(ValueError, match="packing must have no link of a particle to its own image for this call, got"):
        REFUSED[name]()


def test_the_link_bears_the_least_that_balances_which_is_nothing():
    assert pm.link_tension(scene(LINKED)).tolist() == [0.0]
