"""Packings at rest under gravity, between walls and on held particles: closed forms and exact identities of statics."""

from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.effects.pair import effect

G = 1e-3
# each compiles a loop of its own
METHODS = [
    None,
    pm.LBFGS(),
    *(pytest.param(one, marks=pytest.mark.slow) for one in (pm.Fire2(), pm.ConjugateGradient(), pm.DampedDynamics())),
]


def column(height=5, law=None):
    """Return equal discs above each other on a floor, just touching, and their scene.

    Walls that press it a little from both sides keep the column from buckling.
    """
    box = pm.Box([[2.0, 0.0], [0.0, height + 2.0]])
    position = np.column_stack([np.full(height, 0.7), 1.0 + np.arange(height)])
    packing = pm.Packing(position, np.full(height, 0.5), box, mass_n=np.linspace(1.0, 2.0, height))
    law = pm.Harmonic() if law is None else law
    walls = (pm.Walls(1, 0.5, height + 1.5), pm.Walls(0, 0.25, 1.15))
    return pm.Scene(packing, (pm.Repulsion(law), pm.Gravity(0.0, -G), *walls))


def pile(dimension=2, particles=60, seed=1, *more):
    """Return a scene of particles that fall on a floor, from a random start."""
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=0.4, seed=seed)
    top = packing.box.lattice_dd[1, 1]
    return pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -G), pm.Walls(1, 0.2, top - 0.2), *more))


def at_rest(scene, tolerance=1e-10, **settings):
    run = pm.quench(scene, force_tolerance=tolerance, **settings)
    return scene.replace(packing=run.packing)


@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
def test_each_contact_of_a_column_bears_what_lies_above(method):
    scene = column()
    rest = at_rest(scene, method=method)
    above = np.cumsum(scene.packing.mass_n[::-1])[::-1] * G
    distance = np.diff(rest.packing.position_nd[:, 1])
    # harmonic overlaps: force = 1 - distance for unit diameters
    assert (1.0 - distance) == pytest.approx(above[1:], rel=1e-8)
    walls = pm.wall_contacts(rest)
    floor = walls.normal_wd[:, 1] < 0.0
    assert walls.particle_w[floor].tolist() == [0]
    assert walls.force_w[floor] == pytest.approx(above[:1], rel=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_floor_bears_the_weight(dimension):
    scene = pile(dimension)
    rest = at_rest(scene)
    weight = G * scene.packing.mass_n.sum()
    left = pm.forces(rest)[:, 1].sum()
    assert abs(pm.wall_contacts(rest).on_walls()[1] + weight + left) < 1e-12 * weight
    assert abs(left) < 1e-8 * weight


def test_force_through_every_level_is_the_weight_above():
    rest = at_rest(pile(particles=200))
    packing = rest.packing
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    push = 1.0 - contacts.distance_c / contacts.contact_distance_c
    push = push / contacts.contact_distance_c
    y = packing.position_nd[:, 1]
    low = np.where(contacts.normal_cd[:, 1] > 0.0, y[contacts.i_c], y[contacts.j_c])
    high = low + np.abs(contacts.vector_cd[:, 1])
    weight = G * packing.mass_n.sum()
    for level in np.quantile(y, [0.1, 0.3, 0.5, 0.7, 0.9]) + 1e-3:
        through = (push * np.abs(contacts.normal_cd[:, 1]))[(low < level) & (level < high)].sum()
        assert through == pytest.approx(G * packing.mass_n[y > level].sum(), abs=1e-9 * weight)


def test_a_hopper_of_held_particles_bears_the_weight_and_stays():
    # a V of held discs under loose ones
    spots = np.arange(9)
    wedge = np.column_stack([0.8 * spots + 0.8, 1.0 + 0.6 * np.abs(spots - 4.0)])
    rng = np.random.default_rng(3)
    loose = np.column_stack([rng.uniform(2.5, 5.5, 12), 6.0 + np.arange(12) * 0.9])
    packing = pm.Packing(np.vstack([wedge, loose]), np.full(21, 0.5), pm.Box([[8.0, 0.0], [0.0, 20.0]]))
    fixed = pm.FixedParticles(tuple(range(9)))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -G), pm.Walls(1, 0.1, 19.9), fixed))
    rest = at_rest(scene)
    assert np.array_equal(rest.packing.position_nd[:9], wedge)
    free = rest.replace(effects=(rest.effects[0],))
    on_held = pm.forces(free)[:9].sum(axis=0)
    between_held = pm.forces(free.replace(packing=packing.select(np.arange(9)))).sum(axis=0)
    weight = G * packing.mass_n[9:].sum()
    assert on_held - between_held == pytest.approx([0.0, -weight], abs=1e-8 * weight)
    assert not pm.forces(rest)[:9].any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_hessian_with_walls_and_held_particles_is_the_derivative_of_the_forces(dimension):
    scene = pile(dimension, 30, 2, pm.FixedParticles((3, 7)))
    rest = at_rest(scene)
    d, position = dimension, rest.packing.position_nd
    matrix = pm.hessian(rest, "none").toarray()
    half, columns = 1e-6, []
    for k in range(position.size):
        step = np.zeros(position.size)
        step[k] = half * (k // d not in (3, 7))
        step = step.reshape(position.shape)
        forces = [
            pm.forces(rest.replace(packing=rest.packing.replace(position_nd=position + sign * step))).ravel()
            for sign in (1, -1)
        ]
        columns.append((forces[1] - forces[0]) / (2.0 * half))
    assert np.abs(matrix - np.array(columns).T).max() < 1e-7 * np.abs(matrix).max()


def test_energy_of_gravity_and_walls_has_the_forces_as_its_slope():
    scene = pile(2, 30, 2)
    packing = scene.packing
    step = 1e-6 * np.random.default_rng(1).normal(size=packing.position_nd.shape)
    up, down = (scene.replace(packing=packing.replace(position_nd=packing.position_nd + s * step)) for s in (1, -1))
    change = pm.energy(up) - pm.energy(down)
    assert change == pytest.approx(-2.0 * (pm.forces(scene) * step).sum(), rel=1e-6)


def test_modes_of_a_column_are_those_of_a_chain_of_springs():
    rest = at_rest(column(3), 1e-13)
    mass = rest.packing.mass_n
    # the image comes as far as the disc: twice the stiffness of the law
    k = np.array([2.0, 1.0, 1.0])
    chain = np.diag([k[0] + k[1], k[1] + k[2], k[2]]) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    root = np.sqrt(mass)
    expected = np.sqrt(np.linalg.eigvalsh(chain / np.outer(root, root)))
    modes = pm.normal_modes(rest, rattlers="keep")
    assert modes.translations == modes.negative == 0
    upright = np.abs(modes.displacement_mnd[:, :, 0]).max(axis=1) < 1e-8
    assert modes.frequency_m[upright] == pytest.approx(expected, rel=1e-9)


def test_modes_by_both_methods_and_the_density_of_states_agree():
    # without a disc that lies on the floor alone, where it slides at no cost
    rest = at_rest(pile(2, 120, 5, pm.FixedParticles((5,))))
    dense = pm.normal_modes(rest, 8, method="dense")
    sparse = pm.normal_modes(rest, 8, method="shift-invert")
    assert sparse.frequency_m == pytest.approx(dense.frequency_m, rel=1e-7)
    assert dense.translations == sparse.translations == sparse.missed == 0
    states = pm.density_of_states(rest, 12)
    assert states.count_b.sum() == states.modes == dense.available


def test_a_ball_held_by_walls_alone_does_not_rattle():
    ball = pm.Packing([[1.0, 1.0], [3.0, 3.0]], [0.5, 0.2], pm.Box.cubic(4.0, 2))
    scene = pm.Scene(ball, (pm.Repulsion(), pm.Walls(0, 0.6, 1.4), pm.Walls(1, 0.6, 1.4)))
    modes = pm.normal_modes(scene.replace(packing=ball.select([0])))
    # two walls of stiffness 2 each way, mass pi/4
    assert modes.frequency_m == pytest.approx(np.sqrt(4.0 / (np.pi / 4.0)) * np.ones(2), rel=1e-12)


def test_quench_and_damped_motion_end_in_the_same_place():
    scene = pile(2, 20, 5)
    rest = at_rest(scene)
    shaken = rest.packing.replace(position_nd=rest.packing.position_nd + 1e-5)
    drag = (pm.ContactDamping(0.3), pm.BackgroundDamping(0.3))
    moved = pm.simulate(scene.replace(packing=shaken, effects=(*scene.effects, *drag)), steps=6000, dt=0.1)
    again = at_rest(scene.replace(packing=shaken))
    apart = moved.packing.position_nd - again.packing.position_nd
    # nothing resists a shift along the smooth floor
    apart[:, 0] -= apart[:, 0].mean()
    assert np.abs(apart).max() < 1e-7


def test_simulated_particles_that_are_held_stay():
    scene = pile(2, 20, 5, pm.FixedParticles((2, 11)))
    start = scene.packing.position_nd
    moved = pm.simulate(scene, steps=100, dt=0.1).packing.position_nd
    assert np.array_equal(moved[[2, 11]], start[[2, 11]])
    assert np.abs(moved - start).max() > 1e-3


def test_what_cannot_be_honored_is_refused_by_name():
    scene = pile(2, 10)
    with pytest.raises(ValueError, match="strain must be 'none' where walls, gravity or held particles are"):
        pm.hessian(scene)
    with pytest.raises(ValueError, match="strain must be 'none'"):
        pm.normal_modes(scene, strain="free")
    with pytest.raises(ValueError, match=r"particles must be below 10, the number of particles, got 10"):
        pm.forces(scene.replace(effects=(pm.Repulsion(), pm.FixedParticles((10,)))))
    links = pm.Links([0], [1], [[0, 0]], [np.linalg.norm(np.diff(scene.packing.position_nd[:2], axis=0))])
    linked = scene.replace(packing=scene.packing.replace(links=links))
    with pytest.raises(ValueError, match="must hold no particle that is linked"):
        pm.quench(linked.replace(effects=(pm.Repulsion(), pm.FixedParticles((0,)))), force_tolerance=1e-3)
    for wrong in ([1.5], "12", 3, (True,), (-1,), (1, 1)):
        with pytest.raises((TypeError, ValueError), match="particles must"):
            pm.FixedParticles(wrong)


@effect
class Trap(NamedTuple):
    """A potential well that says nothing of its curvature."""

    strength: float = 1e-3

    def body_force(self, x, y, z, u, v, w, mass, radius):
        return -self.strength * (x - 2.0), -self.strength * (y - 2.0), 0.0

    def body_energy(self, x, y, z, mass, radius):
        return 0.5 * self.strength * ((x - 2.0) ** 2 + (y - 2.0) ** 2)


def test_an_effect_without_second_derivatives_is_quenched_to_the_end_and_refused_by_the_hessian():
    packing = pm.random_packing(12, dimension=2, packing_fraction=0.2, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(), Trap()))
    rest = at_rest(scene, 1e-9)
    assert np.abs(pm.forces(rest)).max() < 1e-9
    with pytest.raises(ValueError, match=r"body_second.*Trap"):
        pm.hessian(rest, "none")


def test_linked_particles_fall_too():
    packing = pm.cluster_packing(8, pm.Dimer(), dimension=2, packing_fraction=0.2, seed=1, largest_overlap=0.1)
    top = packing.box.lattice_dd[1, 1]
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -G), pm.Walls(1, 0.2, top - 0.2)))
    run = pm.quench(scene, force_tolerance=1e-9)
    rest = scene.replace(packing=run.packing)
    weight = G * packing.mass_n.sum()
    assert pm.wall_contacts(rest).on_walls()[1] == pytest.approx(-weight, rel=1e-7)
    assert run.packing.link_error < 1e-12


def test_a_file_keeps_held_particles(tmp_path):
    scene = pile(2, 10, 1, pm.FixedParticles((4, 2)))
    path = tmp_path / "pile.toml"
    pm.write_scene(scene, path)
    assert pm.read_scene(path).effects == scene.effects


def test_frictional_grains_settle_on_a_rough_floor_with_forces_and_torques_in_balance():
    sizes = pm.Bidisperse(ratio=1.4)
    loose = pm.random_packing(40, dimension=2, sizes=sizes, packing_fraction=0.35, seed=7)
    floor_x = np.arange(0.0, loose.box.lattice_dd[0, 0] - 0.6, 0.9)
    grains = len(floor_x)
    position = np.vstack([np.column_stack([floor_x, np.full(grains, 0.5)]), loose.position_nd + [0.0, 1.5]])
    radius = np.concatenate([np.full(grains, 0.5), loose.radius_n])
    box = pm.Box(loose.box.lattice_dd + np.diag([0.0, 6.0]))
    packing = pm.Packing(position, radius, box)
    acting = (pm.Repulsion(), pm.Friction(0.4, 0.5, 0.3), pm.ContactDamping(0.5), pm.BackgroundDamping(0.2))
    scene = pm.Scene(packing, (*acting, pm.Gravity(0.0, -G), pm.FixedParticles(tuple(range(grains)))))
    run = pm.simulate(scene, steps=40_000, dt=0.2)
    found = pm.contact_forces(scene.replace(packing=run.packing))
    assert found.residual < 1e-8
    weight = G * packing.mass_n[grains:].sum()
    # what the floor bears: the forces on grains that are held, but for those between them
    both = (found.contacts.i_c < grains) & (found.contacts.j_c < grains)
    on_floor = np.zeros(2)
    for ends, sign in ((found.contacts.i_c, 1.0), (found.contacts.j_c, -1.0)):
        on_floor += sign * found.force_cd[(ends < grains) & ~both].sum(axis=0)
    assert on_floor == pytest.approx([0.0, -weight], abs=1e-7 * weight)
    assert not found.rattlers_n[:grains].any()
    assert np.abs(found.tangential_cd).max() > 0.01 * weight / 40
