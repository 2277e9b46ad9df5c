"""Bonds between the centers of ellipses: they push and pull along the line of centers, and turn nobody."""

import math

import numpy as np
import pytest

import packmech as pm


def bonded(**how):
    """Two ellipses that overlap, bonded at a distance, far from others but for a third that touches one of them."""
    shapes = pm.Spheroids([2.0, 1.5, 1.5], [[1.0, 0.2], [0.3, 1.0], [1.0, 0.0]])
    packing = pm.Packing([[2.0, 2.0], [2.9, 2.1], [6.0, 6.0]], [0.5, 0.5, 0.4], pm.Box.cubic(8.0, 2), shapes=shapes)
    spring = pm.LinearSpring(2.0)
    how = {"tangential_stiffness": 0.0, **how}
    bonds = pm.Bonds([0], [1], [[0, 0]], [0.9], spring, spring, **how)
    return pm.Scene(packing, (pm.Repulsion(), bonds))


def test_a_bond_swings_at_its_frequency_and_turns_no_ellipse():
    scene = bonded()
    packing = scene.packing
    mass = packing.mass_n[:2]
    frequency = math.sqrt(2.0 * (1.0 / mass).sum())
    start = float(np.linalg.norm(packing.position_nd[1] - packing.position_nd[0])) - 0.9
    steps = 1000
    # half a period on: as far from rest on the other side, though the ellipses overlap: a bonded pair is no contact
    run = pm.simulate(scene, steps=steps, dt=math.pi / frequency / steps, check=False)
    end = run.packing
    assert np.linalg.norm(end.position_nd[1] - end.position_nd[0]) - 0.9 == pytest.approx(-start, rel=1e-4)
    assert np.abs(end.shapes.rotation_since(packing.shapes)).max() < 1e-15
    assert len(pm.find_shape_contacts(packing, gap_tolerance=0.0)) == 1


def test_bonded_ellipses_that_spin_go_on_spinning_and_keep_momentum_and_energy():
    scene = bonded()
    spin = np.array([[0.3], [-0.2], [0.1]])
    velocity = np.array([[0.1, 0.0], [-0.1, 0.05], [0.0, 0.0]])
    run = pm.simulate(scene, steps=800, dt=0.01, spin_nk=spin, velocity_nd=velocity, trace_every=80, check=False)
    assert np.abs(run.spin_nk - spin).max() < 1e-14
    trace = run.trace
    whole = trace.energy_t + trace.kinetic_t
    assert np.abs(whole - whole[0]).max() < 1e-4 * whole[0]
    assert run.momentum_error < 1e-13


def test_a_dashpot_of_a_bond_slows_the_approach_of_centers():
    run = pm.simulate(bonded(damping=0.4), steps=1500, dt=0.02, trace_every=150, check=False)
    whole = run.trace.energy_t + run.trace.kinetic_t
    assert np.diff(whole).max() <= 1e-12 and whole[-1] < 0.02 * whole[0]


def test_tangential_springs_between_ellipses_are_refused_with_the_way_out():
    with pytest.raises(
        ValueError, match=r"tangential_stiffness=0.0 and tangential_damping=0.0 for Spheroids, .* got 1"
    ):
        pm.simulate(bonded(tangential_stiffness=1.0), steps=1, dt=0.01)


def test_bonds_of_touching_ellipses_are_slack_at_the_distance_of_their_touch():
    packing = bonded().packing
    contacts = pm.find_shape_contacts(packing, gap_tolerance=0.0)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.0)
    distance = np.linalg.norm(contacts.vector_cd[0])
    assert bonds.rest_length_b == pytest.approx([distance / (contacts.distance_c[0] / contacts.contact_distance_c[0])])
    # apart by just that they touch in a point
    moved = packing.position_nd.copy()
    moved[1] = moved[0] + contacts.vector_cd[0] * float(bonds.rest_length_b[0]) / distance
    near = pm.find_shape_contacts(packing.replace(position_nd=moved), gap_tolerance=1e-9)
    assert near.gap_c == pytest.approx([0.0], abs=1e-12)
    assert pm.bond_contacts(packing, rest="distance").rest_length_b == pytest.approx([distance])


def test_rigid_bodies_that_touch_twice_get_one_bond():
    square = pm.Packing([[0, 0], [1, 0], [0, 0.95], [1, 0.95]], [0.5] * 4, pm.Box.cubic(6.0, 2))
    bodies = pm.rigid_packing(square, [0, 0, 1, 1])
    assert len(pm.find_shape_contacts(bodies, gap_tolerance=0.0)) == 2
    assert pm.bond_contacts(bodies, rest="distance").rest_length_b.round(12).tolist() == [0.95]
    with pytest.raises(ValueError, match='rest must be "distance" for rigid bodies'):
        pm.bond_contacts(bodies)
