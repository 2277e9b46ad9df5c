"""Facts about patches that are sheared by what surrounds them."""

import functools
import math

import numpy as np
import pytest
from scipy.optimize import minimize

import packmech as pm

CENTER, RADIUS = np.array([3.0, 6.0]), 2.5
# of pairs of two kinds
STIFFNESS = np.array([[1.0, 0.6], [0.6, 2.0]])


@functools.cache
def scene(pressure=3e-3, kinds=1):
    start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.86, seed=3)
    law = pm.Harmonic()
    if kinds > 1:
        start = pm.assign_kinds(start, (1, 1), seed=5)
        law = pm.LawByKind([[pm.Harmonic(number) for number in row] for row in STIFFNESS.tolist()])
    whole = pm.Scene(start, (pm.Repulsion(law),))
    return whole.replace(packing=pm.jam(whole, pressure=pressure).packing)


def patch_about(packing, center, radius, direction=0.0):
    """Return places from the center turned so that the flow is along x, radii, which are free, and kinds."""
    lattice = packing.box.lattice_dd
    images = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    apart = packing.position_nd - center + (images @ lattice.T)[:, None]
    near = apart[np.argmin((apart**2).sum(axis=2), axis=0), np.arange(packing.particles)]
    cos, sin = math.cos(direction), math.sin(direction)
    turned = near @ np.array([[cos, -sin], [sin, cos]])
    far = np.hypot(*near.T)
    kept = far < radius + 3.0
    kind = np.zeros(packing.particles, dtype=int) if packing.kind_n is None else packing.kind_n
    return turned[kept], packing.radius_n[kept], far[kept] < radius, kind[kept]


def energy_and_slopes(place, radius, free, kind):
    """Return the energy of harmonic discs, those of pairs that are held left out, and its slopes."""
    i, j = np.triu_indices(len(place), 1)
    some = free[i] | free[j]
    i, j = i[some], j[some]
    sigma, vector = radius[i] + radius[j], place[j] - place[i]
    distance = np.hypot(*vector.T)
    overlap = np.maximum(1.0 - distance / sigma, 0.0)
    stiffness = STIFFNESS[kind[i], kind[j]]
    pull = -(stiffness * overlap / (sigma * distance))[:, None] * vector
    slope = np.zeros_like(place)
    np.add.at(slope, j, pull)
    np.add.at(slope, i, -pull)
    return 0.5 * float((stiffness * overlap**2).sum()), slope


def minimal_energies(place, radius, free, kind, strains):
    """Return least energies of a patch at strains, each minimized from the last by a library's method."""
    now, before, found = place.copy(), 0.0, []

    def of(free_x):
        whole = now.copy()
        whole[free] = free_x.reshape(-1, 2)
        energy, slope = energy_and_slopes(whole, radius, free, kind)
        return energy, slope[free].ravel()

    for strain in strains:
        now[:, 0] += (strain - before) * now[:, 1]
        before = strain
        done = minimize(
            of, now[free].ravel(), jac=True, method="L-BFGS-B",
            options={"gtol": 1e-13, "ftol": 1e-30, "maxiter": 100_000, "maxls": 60, "maxcor": 30},
        )  # fmt: skip
        now[free] = done.x.reshape(-1, 2)
        found.append(done.fun)
    return np.array(found)


@functools.cache
def fallen(kinds=1):
    return pm.local_yield_stress(
        scene(kinds=kinds), [CENTER], radius=RADIUS, directions=(0.0, math.pi / 2.0), largest_strain=0.08
    )


@pytest.mark.parametrize("kinds", [1, 2])
def test_a_patch_falls_where_a_minimization_by_other_means_loses_energy(kinds):
    run = fallen(kinds)
    # nan of a direction in which it stands to the end
    k = int(np.nanargmax(run.energy_drop_pk[0]))
    strain, drop = run.yield_strain_pk[0, k], run.energy_drop_pk[0, k] * STIFFNESS[:kinds, :kinds].max()
    # near the fall a minimization that starts too far away leaves for another minimum
    near = [*np.arange(0.0, strain - 1e-3, 1e-3), *(strain - np.geomspace(1e-3, 4e-5, 12))]
    patch = patch_about(scene(kinds=kinds).packing, CENTER, RADIUS, run.direction_k[k])
    energy = minimal_energies(*patch, [*near, *(strain + np.array([-3e-5, -2e-5, -1e-5, 1e-5, 2e-5]))])[-5:]
    # up to the fall the energy grows steadily, and behind it what is missing is what the fall freed
    grown = np.diff(energy)
    assert grown[1] == pytest.approx(grown[0], rel=1e-3)
    # half of the way is under the stress of before, half under that behind it
    assert grown[1] + grown[3] - grown[2] == pytest.approx(drop, rel=2e-3)


@pytest.mark.parametrize("kinds", [1, 2])
def test_the_stress_of_a_patch_is_half_of_each_virial_to_either_particle(kinds):
    run, whole = fallen(kinds), scene(kinds=kinds)
    for k, direction in enumerate(run.direction_k):
        place, radius, free, kind = patch_about(whole.packing, CENTER, RADIUS, direction)
        total = 0.0
        for i in range(len(place)):
            for j in range(i):
                vector = place[i] - place[j]
                distance, sigma = np.hypot(*vector), radius[i] + radius[j]
                if distance < sigma:
                    share = 0.5 * (float(free[i]) + float(free[j])) * STIFFNESS[kind[i], kind[j]]
                    total -= share * (1.0 - distance / sigma) / sigma * vector[0] * vector[1] / distance
        area = math.pi * (radius[free] ** 2).sum() / pm.packing_fraction(whole.packing)
        assert run.start_stress_pk[0, k] * whole.pressure_unit == pytest.approx(total / area, rel=1e-10)
        assert run.free_p[0] == free.sum()


def test_shear_stresses_of_directions_at_right_angles_are_opposite():
    stress = fallen().start_stress_pk[0]
    assert stress[1] == pytest.approx(-stress[0], rel=1e-12)


def test_a_packing_turned_by_a_right_angle_falls_alike_in_the_direction_turned_with_it():
    run, packing = fallen(), scene().packing
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = packing.replace(position_nd=packing.position_nd @ quarter.T, box=pm.Box(quarter @ packing.box.lattice_dd))
    other = pm.local_yield_stress(
        scene().replace(packing=turned), [quarter @ CENTER], radius=RADIUS, largest_strain=0.08,
        directions=(math.pi / 2.0, math.pi),
    )  # fmt: skip
    # falls are found to within a strain of 1e-8
    assert other.yield_strain_pk == pytest.approx(run.yield_strain_pk, abs=1e-7)
    assert other.yield_stress_pk == pytest.approx(run.yield_stress_pk, rel=1e-5, nan_ok=True)


def test_a_patch_of_a_rattler_or_of_nothing_bears_no_stress_and_does_not_fall():
    packing = scene().packing
    rattler = np.flatnonzero(pm.find_rattlers(packing))
    centers = [packing.position_nd[rattler[0]]] if len(rattler) else []
    # a center as far from all particles as can be
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 6.0, 60)] * 2), axis=-1).reshape(-1, 2)
    apart = np.hypot(*(grid[:, None] - packing.position_nd).T).min(axis=0)
    run = pm.local_yield_stress(scene(), [*centers, grid[np.argmax(apart)]], radius=0.3)
    assert np.isinf(run.yield_strain_pk).all() and np.isinf(run.yield_stress_pk).all() and run.ok
    assert np.isinf(run.weakest_p).all() and run.weakest is None


def test_what_was_done_stays_where_time_is_up():
    run = pm.local_yield_stress(scene(), [CENTER, CENTER + 3.0], radius=RADIUS, time_limit=1e-6, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert "patches and directions" in str(run.unmet[0])
    assert run.table()["yield_strain"].shape == (2,)


def test_patches_that_meet_their_images_are_refused_with_the_largest_radius():
    with pytest.raises(ValueError, match="radius must be at most"):
        pm.local_yield_stress(scene(), [CENTER], radius=8.0)


def test_a_packing_in_space_is_refused():
    start = pm.random_packing(32, dimension=3, packing_fraction=0.7, seed=1)
    with pytest.raises(ValueError, match="must be in a plane"):
        pm.local_yield_stress(pm.Scene(start, (pm.Repulsion(),)), [[1.0, 1.0]])
