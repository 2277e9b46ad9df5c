"""Facts about the contacts of a time-stepped run: they are those of its figures and of its forces."""

from functools import cache

import numpy as np
import pytest

import packmech as pm


@cache
def sheared(dimension):
    """A slowly sheared packing with friction and without bonds or dashpots, and what was kept on the way."""
    fraction = 0.95 if dimension == 2 else 0.75
    packing = pm.random_packing(40, dimension=dimension, packing_fraction=fraction, seed=6)
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.Friction(0.3, 0.4, 0.0)))
    return scene, pm.simulate(
        scene, steps=60, dt=0.05, applied_strain=pm.SteadyStrain(0.5), trace_every=12, trace_positions=True
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_as_many_contacts_touch_and_slide_as_the_figures_say(dimension):
    _, run = sheared(dimension)
    trace = run.trace
    assert [len(one.i_c) for one in trace.touching_t] == trace.contacts_t.tolist()
    assert [int(one.sliding_c.sum()) for one in trace.touching_t] == trace.sliding_t.tolist()
    assert 0 < trace.sliding_t[-1] < trace.contacts_t[-1]


@pytest.mark.parametrize("dimension", [2, 3])
def test_contacts_are_those_of_the_packing_at_that_time(dimension):
    scene, run = sheared(dimension)
    trace = run.trace
    for t, touching in enumerate(trace.touching_t):
        packing = scene.packing.replace(position_nd=trace.position_tnd[t], box=pm.Box(trace.lattice_tdd[t]))
        contacts = pm.find_contacts(packing, gap_tolerance=0.0)
        assert np.array_equal(touching.i_c, contacts.i_c)
        assert np.array_equal(touching.j_c, contacts.j_c)
        assert np.array_equal(touching.image_cd, contacts.image_cd)
        assert touching.normal_c == pytest.approx(contacts.contact_distance_c - contacts.distance_c, abs=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_times_branch_vectors_add_up_to_the_stress(dimension):
    scene, run = sheared(dimension)
    trace = run.trace
    for t, one in enumerate(trace.touching_t):
        box = pm.Box(trace.lattice_tdd[t])
        position = trace.position_tnd[t]
        branch = position[one.j_c] - position[one.i_c] + one.image_cd @ box.lattice_dd.T
        stress = np.einsum("ca,cb->ab", one.force_cd, branch) / box.volume
        assert stress == pytest.approx(trace.stress_tdd[t], abs=1e-12 * np.abs(trace.stress_tdd[t]).max())


def test_what_slides_is_at_the_cap_and_nothing_is_beyond():
    scene, run = sheared(2)
    trace = run.trace
    for t, one in enumerate(trace.touching_t):
        position = trace.position_tnd[t]
        branch = position[one.j_c] - position[one.i_c] + one.image_cd @ trace.lattice_tdd[t].T
        normal = branch / np.linalg.norm(branch, axis=1)[:, None]
        along = np.sum(one.force_cd * normal, axis=1)
        across = np.linalg.norm(one.force_cd - along[:, None] * normal, axis=1)
        cap = 0.3 * one.normal_c
        assert np.all(across <= cap * (1.0 + 1e-9))
        assert across[one.sliding_c] == pytest.approx(cap[one.sliding_c], rel=1e-8)
