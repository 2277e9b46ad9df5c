"""Facts about pairs that nearly touch: by default the Hessian is the derivative of the forces, and all calls agree."""

import numpy as np

import packmech as pm


def near(gap):
    """Return overlapping discs in a row, and one that a gap [1] parts from its neighbor."""
    place = np.array([[0.0, 0.0], [0.95, 0.0], [1.9, 0.1], [1.9, 0.1 + 1.0 + gap]])
    return pm.Packing(place, np.full(4, 0.5), pm.Box.cubic(6.0, 2))


def test_the_default_hessian_is_the_derivative_of_the_forces_beside_a_gap_of_half_a_billionth():
    packing = near(5e-10)
    step = 1e-10
    matrix = pm.hessian(pm.Scene(packing, (pm.Repulsion(),)), "none").toarray()
    for k in range(8):
        shift = np.zeros(8)
        shift[k] = step
        ahead, behind = (
            pm.forces(
                pm.Scene(packing.replace(position_nd=packing.position_nd + s * shift.reshape(4, 2)), (pm.Repulsion(),))
            )
            for s in (1.0, -1.0)
        )
        assert np.allclose(matrix[:, k], -(ahead - behind).ravel() / (2.0 * step), atol=1e-5)


def test_all_calls_count_the_same_contacts_by_default():
    pressed, touching = near(5e-10), pm.lattice_packing("kagome", (2, 2))
    for packing, count in ((pressed, 2), (touching, 2 * touching.particles)):
        assert len(pm.find_contacts(packing, gap_tolerance=None)) == count
        assert pm.rigidity_matrix(packing, "none").shape[0] == count
        assert pm.coordination_number(packing, rattlers="keep") == 2.0 * count / packing.particles
        matrix = pm.hessian(pm.Scene(packing, (pm.Repulsion(),)), "none", kind="unstressed").toarray()
        assert np.isclose(np.trace(matrix), 2.0 * count)
    assert len(pm.find_contacts(pressed, gap_tolerance=1e-9)) == 3


def test_one_overlap_leaves_contacts_that_are_open_by_rounding():
    crystal = pm.lattice_packing("triangular", (4, 4))
    pushed = crystal.position_nd * (1.0 + 2e-16)
    pushed[5, 0] += 3e-9
    packing = crystal.replace(position_nd=pushed)
    lost = len(pm.find_contacts(crystal, gap_tolerance=None)) - len(pm.find_contacts(packing, gap_tolerance=None))
    # the particle that moved parts from the neighbors behind it only
    assert 1 <= lost <= 3
