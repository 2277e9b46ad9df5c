"""Derivatives of frictional packings are central differences of rests that numpy alone finds anew."""

import functools

import numpy as np
import pytest

import packmech as pm

_SPRING = 0.7


@functools.cache
def loaded():
    """Return a packing of discs at rest whose contacts bear tangential forces below the Coulomb limit."""
    start = pm.random_packing(16, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.98, seed=1)
    effects = pm.Repulsion(law=pm.Harmonic()), pm.Friction(50.0, stiffness=_SPRING), pm.ContactDamping(0.3)
    scene = pm.Scene(start, effects)
    smooth = pm.quench(scene.without(pm.Friction), force_tolerance=1e-12).packing
    change = 1.0 + 0.02 * np.random.default_rng(3).normal(size=smooth.particles)
    larger = smooth.replace(radius_n=smooth.radius_n * change)
    run = pm.settle(scene.replace(packing=larger), force_tolerance=1e-12)
    scene = scene.replace(packing=run.packing)
    return scene.replace(packing=settled(scene, run.packing.radius_n, np.eye(2)))


def settled(scene, radius_n, change_dd):
    """Return the packing at rest with other radii in a strained box, springs grown by the slip of the midpoint."""
    packing, contacts = scene.packing, pm.contact_forces(scene).contacts
    i, j, count = contacts.i_c, contacts.j_c, packing.particles
    lattice = change_dd @ packing.box.lattice_dd
    held = packing.tangential.displacement_ck[:, 0]
    before = packing.position_nd[j] - packing.position_nd[i] + contacts.image_cd @ packing.box.lattice_dd.T
    old_share, share = (one[i] / (one[i] + one[j]) for one in (packing.radius_n, radius_n))
    sigma = radius_n[i] + radius_n[j]

    def tangent(vector):
        size = np.sqrt((vector**2).sum(axis=1))[:, None]
        return np.stack([-vector[:, 1], vector[:, 0]], axis=1) / size

    def state(y):
        place, angle = y[: 2 * count].reshape(-1, 2), y[2 * count :]
        vector = place[j] - place[i] + contacts.image_cd @ lattice.T
        size = np.sqrt((vector**2).sum(axis=1))
        middle = 0.5 * (before + vector)
        across, length = tangent(middle), np.sqrt((middle**2).sum(axis=1))
        part = 0.5 * (old_share + share)
        slip = (across * (vector - before)).sum(axis=1) - length * (part * angle[i] + (1.0 - part) * angle[j])
        return place, vector, size, held + slip

    def residual(y):
        _, vector, size, stretch = state(y)
        push, drag = (1.0 - size / sigma) / sigma, _SPRING * stretch
        on_j = push[:, None] * vector / size[:, None] - drag[:, None] * tangent(vector)
        force, torque = np.zeros((count, 2)), np.zeros(count)
        np.add.at(force, j, on_j)
        np.add.at(force, i, -on_j)
        np.add.at(torque, i, share * size * drag)
        np.add.at(torque, j, (1.0 - share) * size * drag)
        return np.concatenate([force.ravel(), torque])

    y = np.concatenate([(packing.position_nd @ change_dd.T).ravel(), np.zeros(count)])
    for _ in range(8):
        step = 1e-6
        moves = step * np.eye(len(y))
        slopes = np.stack([(residual(y + one) - residual(y - one)) / (2.0 * step) for one in moves], axis=1)
        y = y - np.linalg.lstsq(slopes, residual(y), rcond=1e-9)[0]
    assert np.abs(residual(y)).max() < 1e-14
    place, _, _, stretch = state(y)
    springs = pm.TangentialDisplacements(i, j, contacts.image_cd, stretch[:, None])
    return packing.replace(position_nd=place, radius_n=radius_n, box=pm.Box(lattice), tangential=springs)


def figure(scene, of):
    if of == "pressure":
        return pm.pressure(scene)
    moduli = pm.elastic_moduli(scene)
    return moduli.component(of) if of == "xyxy" else getattr(moduli, of)


@pytest.mark.parametrize("of", ["pressure", "bulk_modulus", "shear_modulus", "xyxy", "poisson_ratio"])
def test_frictional_derivatives_are_central_differences_of_rests_found_anew(of):
    scene, step = loaded(), 2e-6
    forces = pm.contact_forces(scene)
    across = np.sqrt((forces.tangential_cd**2).sum(axis=1))
    assert across.max() > 0.05 * np.abs(forces.normal_c).mean() and forces.residual < 1e-12
    by_radius, by_strain = (pm.sensitivity(scene, of, to) for to in ("radius", "applied_strain"))
    assert by_radius.value == pytest.approx(figure(scene, of), rel=1e-12)
    largest, radius = np.abs(by_radius.gradient).max(), scene.packing.radius_n

    def central(at):
        back, near, there, far = (figure(scene.replace(packing=at(k * step)), of) for k in (-2.0, -1.0, 1.0, 2.0))
        return (8.0 * (there - near) - (far - back)) / (12.0 * step)

    for n in (0, 5, 11):
        grown = np.arange(len(radius)) == n
        expected = central(lambda t, grown=grown: settled(scene, radius + t * grown, np.eye(2)))
        assert abs(by_radius.gradient[n] - expected) <= 1e-6 * largest
    for strain in ([[1.0, 0.3], [0.3, -0.5]], [[0.0, 0.5], [0.5, 0.0]], [[0.0, 1.0], [0.0, 0.0]]):
        strain = np.array(strain)
        expected = central(lambda t, strain=strain: settled(scene, radius, np.eye(2) + t * strain))
        assert abs((by_strain.gradient * strain).sum() - expected) <= 1e-6 * np.abs(by_strain.gradient).max()


def test_frictional_figures_without_an_energy_are_refused():
    with pytest.raises(ValueError, match="of must not be 'frequency' for a scene with friction"):
        pm.sensitivity(loaded(), "frequency", "radius")
    sliding = loaded().replace(
        effects=(pm.Repulsion(law=pm.Harmonic()), pm.Friction(1e-3, stiffness=_SPRING), pm.ContactDamping(0.3))
    )
    with pytest.raises(ValueError, match="must hold no contacts at the Coulomb limit|scene must be at rest"):
        pm.sensitivity(sliding, "pressure", "radius")
    bonded = loaded().replace(effects=(*loaded().effects, pm.bond_contacts(loaded().packing)))
    with pytest.raises(ValueError, match="scene must hold no bonds or links beside friction"):
        pm.sensitivity(bonded, "pressure", "radius")
