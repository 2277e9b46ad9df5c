"""Coarse-grained fields: their integrals, the balances of mass and momentum at every point, and a plain sum."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import packmech as pm


def crowd(dimension, seed, particles=12, effects=(), links=None):
    """Return an overlapping packing out of balance in a skewed box, and velocities."""
    rng = np.random.default_rng(seed)
    side = 4.0 if dimension == 2 else 2.6
    box = pm.Box(side * (np.eye(dimension) + 0.1 * rng.standard_normal((dimension, dimension))))
    place = rng.random((particles, dimension)) @ box.lattice_dd.T
    packing = pm.Packing(place, rng.uniform(0.5, 0.7, particles), box, links)
    return pm.Scene(packing, (pm.Repulsion(), *effects)), rng.standard_normal((particles, dimension))


def divergence(fields, box, flux_gid):
    """Return the divergence over the last axis of a smooth periodic field on the grid, by Fourier transforms."""
    shape, d = fields.shape, box.dimension
    wave = [np.fft.fftfreq(n, 1.0 / n) for n in shape]
    index = np.stack(np.meshgrid(*wave, indexing="ij"), axis=-1)
    k = 2.0 * np.pi * index @ box.inverse_dd
    grid = flux_gid.reshape(*shape, -1, d)
    found = np.einsum("...id,...d->...i", np.fft.fftn(grid, axes=tuple(range(d))), 1j * k)
    return np.fft.ifftn(found, axes=tuple(range(d))).real.reshape(len(flux_gid), -1)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("width", [0.3, 0.9])
def test_integrals_are_mass_momentum_and_whole_stress(dimension, width):
    scene, velocity = crowd(dimension, 1)
    fields = pm.coarse_grain(scene, width, velocity_nd=velocity)
    packing = scene.packing
    volume, mass = packing.box.volume, packing.mass_n
    scale = np.abs(pm.stress_tensor(scene)).max()
    assert volume * fields.density_g.mean() == pytest.approx(mass.sum(), rel=1e-12)
    np.testing.assert_allclose(volume * fields.momentum_gd.mean(axis=0), mass @ velocity, rtol=1e-11)
    np.testing.assert_allclose(fields.contact_stress_gdd.mean(axis=0), pm.stress_tensor(scene), atol=1e-12 * scale)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_divergence_of_the_contact_stress_is_the_force_on_the_particles(dimension):
    scene, _ = crowd(dimension, 2)
    packing, width = scene.packing, 0.5
    fields = pm.coarse_grain(scene, width, shape=40 if dimension == 2 else 32)
    found = divergence(fields, packing.box, fields.contact_stress_gdd)
    # forces spread as masses are: the momentum of particles whose velocities are their forces over their masses
    force = pm.forces(scene)
    spread = pm.coarse_grain(scene, width, shape=fields.shape, velocity_nd=force / packing.mass_n[:, None]).momentum_gd
    np.testing.assert_allclose(found, spread, atol=1e-10 * np.abs(spread).max())


def test_density_changes_by_what_flows_in():
    scene, velocity = crowd(2, 3)
    packing, step = scene.packing, 1e-4
    fields = pm.coarse_grain(scene, 0.6, shape=32, velocity_nd=velocity)
    later, earlier = (
        pm.coarse_grain(
            scene.replace(packing=packing.replace(position_nd=packing.position_nd + sign * step * velocity)),
            0.6,
            shape=32,
        )
        for sign in (1.0, -1.0)
    )
    change = (later.density_g - earlier.density_g) / (2.0 * step)
    flows = divergence(fields, packing.box, fields.momentum_gd[:, None, :])[:, 0]
    # central differences err by step^2 / 6 times the third derivative, about 1 / width^3
    np.testing.assert_allclose(change, -flows, atol=1e-6 * np.abs(flows).max())


def test_momentum_of_free_flight_changes_by_the_kinetic_stress():
    """d(rho V)/dt + div(rho V V) = div(kinetic stress) where nothing touches."""
    box = pm.Box.cubic(6.0, 2)
    rng = np.random.default_rng(4)
    packing = pm.Packing(rng.random((6, 2)) * 6.0, np.full(6, 1e-3), box, mass_n=rng.uniform(1.0, 2.0, 6))
    velocity, step = rng.standard_normal((6, 2)), 1e-4
    scene = pm.Scene(packing, (pm.Repulsion(),))
    fields = pm.coarse_grain(scene, 1.2, shape=24, velocity_nd=velocity)
    moved = [
        pm.coarse_grain(
            scene.replace(packing=packing.replace(position_nd=packing.position_nd + sign * step * velocity)),
            1.2, shape=24, velocity_nd=velocity,
        ).momentum_gd
        for sign in (1.0, -1.0)
    ]  # fmt: skip
    carried = fields.momentum_gd[:, :, None] * fields.velocity_gd[:, None, :]
    change = (moved[0] - moved[1]) / (2.0 * step) + divergence(fields, box, carried)
    expected = divergence(fields, box, fields.kinetic_stress_gdd)
    np.testing.assert_allclose(change, expected, atol=1e-6 * np.abs(expected).max())
    assert (np.trace(fields.kinetic_stress_gdd, axis1=1, axis2=2) <= 1e-15).all()


def test_fields_at_a_point_are_those_of_a_plain_sum_along_lines():
    scene, velocity = crowd(2, 5)
    packing, width = scene.packing, 0.4
    fields = pm.coarse_grain(scene, width, shape=(5, 7), velocity_nd=velocity)
    contacts, force = pm.contact_forces(scene).contacts, pm.contact_forces(scene).force_cd
    index = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    images, height = index @ packing.box.lattice_dd.T, 1.0 / (2.0 * np.pi * width**2)
    for g in (0, 11, 34):
        away = fields.point_gd[g] - packing.position_nd[:, None, :] + images
        bell = height * np.exp(-0.5 * (away**2).sum(axis=2) / width**2).sum(axis=1)
        assert fields.density_g[g] == pytest.approx(packing.mass_n @ bell, rel=1e-11)
        np.testing.assert_allclose(fields.momentum_gd[g], (packing.mass_n * bell) @ velocity, rtol=1e-10, atol=1e-13)
        stress = np.zeros((2, 2))
        for c, vector in enumerate(contacts.vector_cd):
            start = fields.point_gd[g] - packing.position_nd[contacts.i_c[c]] + images

            def at(s, start=start, vector=vector):
                return (np.exp(-0.5 * ((start - s * vector) ** 2).sum(axis=1) / width**2)).sum() / (
                    2.0 * np.pi * width**2
                )

            stress += np.outer(force[c], vector) * quad(at, 0.0, 1.0, epsabs=1e-13, epsrel=1e-12)[0]
        np.testing.assert_allclose(fields.contact_stress_gdd[g], stress, atol=1e-10 * np.abs(stress).max())


def test_friction_bonds_and_links_bear_their_parts_of_the_stress():
    start = pm.cluster_packing(6, pm.Dimer(), dimension=2, packing_fraction=0.9, seed=1)
    crowded, _ = crowd(2, 6)
    bonds = pm.Bonds([0, 2], [1, 5], [[0, 0], [0, 0]], [2.0, 3.0])
    for scene in (
        pm.Scene(start, (pm.Repulsion(),)),
        crowded.replace(effects=(*crowded.effects, bonds)),
    ):
        fields = pm.coarse_grain(scene, 0.6)
        whole = pm.stress_tensor(scene)
        np.testing.assert_allclose(fields.contact_stress_gdd.mean(axis=0), whole, atol=1e-12 * np.abs(whole).max())


def test_what_cannot_be_a_grid_is_refused():
    scene, velocity = crowd(2, 7)
    with pytest.raises(ValueError, match="width must be"):
        pm.coarse_grain(scene, 0.0)
    with pytest.raises(ValueError, match="shape must be 2 numbers of points"):
        pm.coarse_grain(scene, 1.0, shape=(3, 3, 3))
    with pytest.raises(ValueError, match="width must be so large that 67108864 points are enough, got 1e-06"):
        pm.coarse_grain(scene, 1e-6)
    with pytest.raises(ValueError, match="shape must be at most"):
        pm.coarse_grain(scene, 1.0, shape=100_000)
    with pytest.raises(ValueError, match=r"width and shape must be .* got a width of 100 and 5000 x 5000 points"):
        pm.coarse_grain(scene, 100.0, shape=5000)
    with pytest.raises(ValueError, match="velocity_nd must"):
        pm.coarse_grain(scene, 1.0, velocity_nd=velocity[:3])
