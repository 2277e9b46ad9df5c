"""Ellipses, spheroids and rigid bodies between walls, with weight, and held: at rest, and stepped through time."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import packmech as pm
from packmech.measure.contact_forces import force_balance
from packmech.minimize.program import build_program
from packmech.view.report import examine

KINDS = {
    "ellipses": (2, pm.Ellipses(aspect=1.7)),
    "spheroids": (3, pm.Ellipses(aspect=0.6)),
    "bent trimers": (2, pm.Trimer(angle=2.0)),
    "trimers": (3, pm.Trimer()),
    "superellipses": (2, pm.Superellipses(3.0, (2.0, 1.0))),
    "superellipsoids": (3, pm.Superellipses(2.6, (2.4, 1.5, 1.0))),
}


@cache
def boxed(kind, particles=8, fraction=0.6):
    """A skewed box with walls across x and y, of two laws, and a weight in an odd direction."""
    d, shapes = KINDS[kind]
    packing = pm.random_packing(particles, dimension=d, packing_fraction=fraction, shapes=shapes, seed=1)
    side = packing.box.lattice_dd[0, 0]
    packing = packing.replace(box=pm.Box(packing.box.lattice_dd + 0.2 * side * np.eye(d, k=1)))
    effects = (
        pm.Repulsion(),
        pm.Walls(0, 0.2, side - 0.2),
        pm.Walls(1, 0.2, side - 0.2, law=pm.PowerLaw(1.0, 2.5)),
        pm.Gravity(0.1, -0.3, 0.2 if d == 3 else 0.0),
    )
    return pm.Scene(packing, effects)


def moved(scene, i, along_x, turn):
    """Return the scene with one particle moved and turned."""
    packing = scene.packing
    position, rotation = packing.position_nd.copy(), np.zeros((packing.particles, len(turn)))
    position[i] += along_x
    rotation[i] = turn
    return scene.replace(packing=packing.replace(position_nd=position, shapes=packing.shapes.turned(rotation)))


@pytest.mark.parametrize("kind", KINDS)
def test_forces_torques_and_the_hessian_are_the_derivatives_of_the_energy(kind):
    scene = boxed(kind)
    packing, d = scene.packing, scene.packing.dimension
    n, h = packing.particles, 1e-6
    force, torque = pm.forces(scene), pm.torques(scene).reshape(n, -1)
    t = torque.shape[1]
    turn = packing.shapes.turn_basis(packing.radius_n)
    q = d + turn.shape[1]
    hessian = pm.hessian(scene, "none").toarray()
    assert np.abs(torque).max() > 0.1 and len(pm.wall_contacts(scene)) >= 4
    for i in range(n):
        for a in range(d + t):
            step = h * np.eye(d + t)[a]
            low, high = (pm.energy(moved(scene, i, sign * step[:d], sign * step[d:])) for sign in (-1, 1))
            given = force[i, a] if a < d else torque[i, a - d]
            assert (low - high) / (2.0 * h) == pytest.approx(given, abs=1e-7)
        for a in range(q):
            along = h * np.eye(d)[a] if a < d else np.zeros(d)
            rotation = np.zeros(t) if a < d else h * turn[i, a - d]
            ends = [moved(scene, i, sign * along, sign * rotation) for sign in (1, -1)]
            slopes = [
                -np.hstack([pm.forces(one), np.einsum("nkt,nt->nk", turn, pm.torques(one).reshape(n, -1))])
                for one in ends
            ]
            change = (slopes[0] - slopes[1]) / (2.0 * h) - hessian[:, i * q + a].reshape(n, q)
            if d == 3:
                # of its own turns only the symmetric part is a second derivative where torques do not balance
                change[i, d:] = 0.0
            assert np.abs(change).max() < 1e-7


@pytest.mark.parametrize("kind", ["spheroids", "trimers", "superellipsoids"])
def test_second_derivatives_by_turns_in_space_are_those_of_the_energy(kind):
    scene = boxed(kind)
    packing, h = scene.packing, 5e-4
    turn = packing.shapes.turn_basis(packing.radius_n)
    q, hessian = 3 + turn.shape[1], pm.hessian(scene, "none")
    touching = set(pm.wall_contacts(scene).particle_w.tolist())
    for i in sorted(touching)[:3]:
        own = hessian[i * q + 3 : (i + 1) * q, i * q + 3 : (i + 1) * q].toarray()
        for along in (np.eye(q - 3)[0], np.ones(q - 3)):
            rotation = h * along @ turn[i]
            energy = {k: pm.energy(moved(scene, i, np.zeros(3), k * rotation)) for k in (-2, -1, 0, 1, 2)}
            # of fourth order in h
            near, far = (energy[k] - 2.0 * energy[0] + energy[-k] for k in (1, 2))
            assert (16.0 * near - far) / (12.0 * h**2) == pytest.approx(along @ own @ along, abs=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_compiled_loops_have_the_energy_and_the_forces_of_the_measures(kind):
    scene = boxed(kind)
    program = build_program(scene)
    found = program.evaluate()
    assert found.energy == pytest.approx(pm.energy(scene), rel=1e-13)
    n = scene.packing.particles
    np.testing.assert_allclose(found.force_nd[:n], pm.forces(scene), rtol=0, atol=1e-12)
    # the slope along a turn is the torque, in the coordinates that minimizers walk over
    gradient = np.einsum("nd,nd->", found.force_nd, found.force_nd)
    ahead = program.coordinates() + 1e-7 * found.force_nd
    assert (found.energy - program.evaluate(ahead).energy) / 1e-7 == pytest.approx(gradient, rel=1e-4)


def test_an_ellipse_on_a_floor_has_the_energy_of_its_reach():
    radius, aspect, angle, height = 0.6, 2.2, 0.7, 0.5
    director = [[math.cos(angle), math.sin(angle)]]
    packing = pm.Packing([[2.0, 1.0 + height]], [radius], pm.Box.cubic(6.0, 2), shapes=pm.Spheroids([aspect], director))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Walls(1, 1.0, 5.0, law=pm.LinearSpring(3.0))))
    a, b = radius * math.sqrt(aspect), radius / math.sqrt(aspect)
    reach = math.hypot(a * math.sin(angle), b * math.cos(angle))
    rho = 2.0 * height * radius / reach
    # half of what the ellipse and its mirror image have
    assert pm.energy(scene) == pytest.approx(0.75 * (2.0 * radius - rho) ** 2, rel=1e-14)
    touch = pm.wall_contacts(scene)
    assert touch.force_w == pytest.approx([3.0 * (2.0 * radius - rho) * radius / reach], rel=1e-14)
    assert touch.normal_wd.tolist() == [[0.0, -1.0]]
    # where the two just touch nothing is pushed
    apart = scene.replace(packing=packing.replace(position_nd=[[2.0, 1.0 + reach * (1.0 + 1e-12)]]))
    assert pm.energy(apart) == 0.0 and len(pm.wall_contacts(apart)) == 0


@cache
def discs(dimension):
    packing = pm.random_packing(10, dimension=dimension, packing_fraction=0.5, seed=2)
    side = packing.box.lattice_dd[0, 0]
    weight = pm.Gravity(0.0, -0.05)
    walls = (pm.Walls(1, 0.3, side - 0.3), pm.Walls(0, 0.25, side - 0.2))
    return pm.Scene(packing, (pm.Repulsion(), *walls, weight, pm.FixedParticles((4,))))


def written(scene, how):
    """Return the scene with its discs or spheres written as round spheroids, or as bodies of one bead."""
    packing = scene.packing
    n, d = packing.position_nd.shape
    if how == "round":
        return scene.replace(packing=packing.replace(shapes=pm.Spheroids(np.ones(n), np.eye(d)[[0] * n])))
    return scene.replace(packing=pm.rigid_packing(packing, np.arange(n)))


@pytest.mark.parametrize("how", ["round", "one bead"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_discs_written_as_shapes_rest_on_walls_as_discs_do(dimension, how):
    scene = discs(dimension)
    other = written(scene, how)
    assert pm.energy(other) == pytest.approx(pm.energy(scene), rel=1e-12)
    np.testing.assert_allclose(pm.forces(other), pm.forces(scene), rtol=0, atol=1e-12)
    assert np.abs(pm.torques(other)).max() <= 1e-14
    one, two = pm.wall_contacts(scene), pm.wall_contacts(other)
    assert np.array_equal(one.particle_w, two.particle_w) and np.array_equal(one.normal_wd, two.normal_wd)
    np.testing.assert_allclose(two.force_w, one.force_w, rtol=0, atol=1e-12)
    q = dimension + scene.packing.dimension * (dimension - 1) // 2 if how == "one bead" else 2 * dimension - 1
    positions = (np.arange(10)[:, None] * q + np.arange(dimension)).ravel()
    hessian = pm.hessian(other, "none").toarray()
    np.testing.assert_allclose(hessian[np.ix_(positions, positions)], pm.hessian(scene, "none").toarray(), atol=1e-11)
    assert np.abs(np.delete(hessian, positions, axis=0)).max(initial=0.0) <= 1e-13


@pytest.mark.parametrize("how", ["round", "one bead"])
def test_discs_written_as_shapes_come_to_rest_and_vibrate_as_discs_do(how):
    scene = discs(2)
    rest = scene.replace(packing=pm.quench(scene, force_tolerance=1e-9).packing)
    # at rest for both, from where the path of a descent depends on no rounding
    again = pm.quench(written(rest, how), force_tolerance=1e-8)
    assert again.residual < 1e-8
    np.testing.assert_allclose(again.packing.position_nd, rest.packing.position_nd, rtol=0, atol=1e-12)
    modes = [pm.normal_modes(one, rattlers="remove") for one in (rest, written(rest, how))]
    # a disc has no turn to vibrate in
    np.testing.assert_allclose(modes[1].frequency_m, modes[0].frequency_m, rtol=0, atol=1e-7)


@pytest.mark.parametrize("how", ["round", "one bead"])
def test_what_is_held_takes_no_part_in_the_modes_of_shapes_as_in_those_of_discs(how):
    packing = pm.random_packing(24, dimension=2, packing_fraction=0.9, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.FixedParticles([0, 3, 5])))
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-10).packing)
    one, other = pm.normal_modes(scene), pm.normal_modes(written(scene, how))
    assert np.array_equal(other.index_n, one.index_n) and not np.isin([0, 3, 5], other.index_n).any()
    np.testing.assert_allclose(other.participation_m, one.participation_m, rtol=1e-9)


@pytest.mark.parametrize("kind", ["ellipses", "bent trimers", "superellipses"])
def test_the_floor_carries_the_weight_of_a_pile(kind):
    d, shapes = KINDS[kind]
    packing = pm.random_packing(12, dimension=d, packing_fraction=0.35, shapes=shapes, seed=3)
    side = packing.box.lattice_dd[0, 0]
    effects = (pm.Repulsion(), pm.Gravity(0.0, -0.01), pm.Walls(1, 0.0, 3.0 * side), pm.Walls(0, 0.0, side))
    scene = pm.Scene(packing.replace(box=pm.Box(np.diag([side, 3.0 * side]))), effects)
    run = pm.quench(scene, force_tolerance=1e-6, step_limit=200_000)
    assert run.ok
    rest = scene.replace(packing=run.packing)
    weight = 0.01 * packing.mass_n.sum()
    on_walls = pm.wall_contacts(rest).on_walls()
    assert on_walls == pytest.approx([0.0, -weight], abs=1e-5 * weight)
    assert np.abs(pm.torques(rest)).max() < 1e-5 * weight


@pytest.mark.parametrize(("aspect", "flat"), [(2.0, 0.0), (0.5, 1.0)])
def test_a_spheroid_on_a_floor_lies_flat(aspect, flat):
    director = np.array([[0.5, 0.6, 0.3]])
    packing = pm.Packing([[2.0, 1.2, 2.0]], [0.5], pm.Box.cubic(4.0, 3), shapes=pm.Spheroids([aspect], director))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -0.02, 0.0), pm.Walls(1, 0.5, 3.5)))
    run = pm.quench(scene, force_tolerance=1e-10)
    up = abs(float(run.packing.shapes.director_nd[0, 1]))
    assert up == pytest.approx(flat, abs=1e-4)
    assert pm.wall_contacts(scene.replace(packing=run.packing)).on_walls()[1] == pytest.approx(
        -0.02 * packing.mass_n[0], rel=1e-9
    )


def lying(aspect=2.0, weight=0.01, stiffness=50.0):
    """An ellipse that lies flat on a floor under its weight, and its semi-axes and the height of its center."""
    radius = 0.5
    a, b = radius * math.sqrt(aspect), radius / math.sqrt(aspect)
    mass = math.pi * radius**2
    # weight = k (2 r - rho) r / b
    height = b * (1.0 - mass * weight * b / (2.0 * stiffness * radius**2))
    packing = pm.Packing([[2.0, 1.0 + height]], [radius], pm.Box.cubic(4.0, 2), shapes=pm.Spheroids([aspect], [[1, 0]]))
    floor = pm.Walls(1, 1.0, 3.9, law=pm.LinearSpring(stiffness))
    return pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -weight), floor)), a, b, height


def test_an_ellipse_on_a_floor_bounces_and_rocks_at_the_frequencies_of_its_shape():
    """Rocking raises the center: the energy's second derivative by the angle is m g D (a^2 - b^2) / b^2."""
    scene, a, b, height = lying()
    assert np.abs(pm.forces(scene)).max() < 1e-12
    modes = pm.normal_modes(scene, rattlers="keep")
    rocking = 0.01 * height * (a**2 - b**2) / b**2 / ((a**2 + b**2) / 4.0)
    bouncing = 2.0 * 50.0 * (0.5 / b) ** 2 / (math.pi * 0.25)
    # gliding along the floor costs nothing and is none of the modes
    assert modes.eigenvalue_m == pytest.approx([rocking, bouncing], rel=1e-9)


def superellipse(exponent, turn, height, ratio=(1.5, 1.0)):
    """A superellipse over a floor at 1, with a weight."""
    shapes = pm.Superellipsoids([exponent], [ratio], [turn])
    packing = pm.Packing([[2.0, 1.0 + height]], [0.5], pm.Box.cubic(4.0, 2), shapes=shapes)
    floor = pm.Walls(1, 1.0, 3.9, law=pm.LinearSpring(50.0))
    return pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -0.01), floor))


def test_a_superellipse_that_lies_on_a_floor_presses_it_with_its_weight():
    scene = superellipse(2.5, [0.8, 0.5], 0.6)
    run = pm.quench(scene, force_tolerance=1e-7)
    weight = 0.01 * run.packing.mass_n[0]
    rest = scene.replace(packing=run.packing)
    assert pm.wall_contacts(rest).on_walls() == pytest.approx([0.0, -weight], rel=1e-6)
    # on a long face, where b is the reach: weight = k (2 r - 2 D r / b) r / b
    assert run.packing.shapes.orientation_nq[0] == pytest.approx([1.0, 0.0], abs=1e-7)
    b = run.packing.shapes.axes(run.packing.radius_n)[0, 1]
    assert run.packing.position_nd[0, 1] - 1.0 == pytest.approx(b * (1.0 - weight * b / 25.0), rel=1e-9)


def test_a_flat_face_on_a_floor_bears_its_weight_and_holds_its_turn_stiffly():
    b = superellipse(8.0, [1.0, 0.0], 0.5).packing.shapes.axes(0.5)[0, 1]
    weight = 0.01 * math.pi * 0.25
    flat = superellipse(8.0, [1.0, 0.0], b * (1.0 - weight * b / 25.0))
    assert np.abs(pm.forces(flat)).max() < 1e-14 * 50.0 and (pm.torques(flat) == 0.0).all()
    value = np.linalg.eigvalsh(pm.hessian(flat, "none").toarray())
    assert value[0] == 0.0 and 1e9 < value[2] / weight < 1e15
    # turned by an angle it falls back: the reach grows as b + (a angle)^q / q b^(q - 1), q = p / (p - 1)
    a, angle = flat.packing.shapes.axes(flat.packing.radius_n)[0, 0], 1e-6
    turned = flat.replace(packing=flat.packing.replace(shapes=flat.packing.shapes.turned(np.array([[angle]]))))
    torque = -weight * a * (a * angle / b) ** (1.0 / 7.0)
    assert float(pm.torques(turned).ravel()[0]) == pytest.approx(torque, rel=2e-3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_superellipsoids_of_exponent_two_and_two_equal_axes_rest_on_walls_as_spheroids_do(dimension):
    scene = boxed("ellipses" if dimension == 2 else "spheroids")
    packing, n = scene.packing, scene.packing.particles
    director, aspect = packing.shapes.director_nd, packing.shapes.aspect_n[0]
    turn = director
    if dimension == 3:
        turn = [Rotation.align_vectors(one[None], [[1.0, 0.0, 0.0]])[0].as_quat(scalar_first=True) for one in director]
    shapes = pm.Superellipsoids(np.full(n, 2.0), [[aspect, 1.0, 1.0][:dimension]] * n, turn)
    other = scene.replace(packing=packing.replace(shapes=shapes))
    assert pm.energy(other) == pytest.approx(pm.energy(scene), rel=1e-12)
    np.testing.assert_allclose(pm.forces(other), pm.forces(scene), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(pm.torques(other), pm.torques(scene), rtol=0.0, atol=1e-11)
    one, two = pm.wall_contacts(scene), pm.wall_contacts(other)
    assert np.array_equal(one.particle_w, two.particle_w)
    np.testing.assert_allclose(two.force_w, one.force_w, rtol=1e-11)
    # along the same motions, coordinates of which differ
    rng, h = np.random.default_rng(2), 1 if dimension == 2 else 3
    for _ in range(3):
        shift, rotation = rng.normal(size=(n, dimension)), rng.normal(size=(n, h))
        if dimension == 3:
            # turns about the axes of spheroids are no motions of theirs
            rotation -= (rotation * director).sum(axis=1)[:, None] * director
        curved = []
        for each in (scene, other):
            basis = each.packing.turn_nkt
            turning = np.array([np.linalg.lstsq(basis[i].T, rotation[i], rcond=None)[0] for i in range(n)])
            along = np.hstack([shift, turning])
            curved.append(along.ravel() @ (pm.hessian(each, "none") @ along.ravel()))
        assert curved[1] == pytest.approx(curved[0], rel=1e-10)


def test_the_modes_of_superellipses_on_a_floor_are_those_of_differences_of_their_forces():
    packing = pm.random_packing(6, dimension=2, packing_fraction=0.35, shapes=pm.Superellipses(2.5, (1.6, 1.0)), seed=3)
    side = packing.box.lattice_dd[0, 0]
    walls = pm.Walls(1, 0.0, 3.0 * side), pm.Walls(0, 0.0, side)
    packing = packing.replace(box=pm.Box(np.diag([side, 3.0 * side])))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Gravity(0.0, -0.05), *walls))
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-9, step_limit=400_000).packing)
    packing, size, h = scene.packing, scene.packing.particles * 3, 1e-7

    def slopes(way):
        there = scene.replace(packing=packing.moved(way.reshape(-1, 3)))
        turning = np.einsum("nkt,nt->nk", packing.turn_nkt, pm.torques(there).reshape(-1, 1))
        return -np.hstack([pm.forces(there), turning]).ravel()

    changes = np.array([(slopes(h * way) - slopes(-h * way)) / (2.0 * h) for way in np.eye(size)])
    root = np.sqrt(np.repeat(packing.mass_n, 3))
    value = np.linalg.eigvalsh(0.5 * (changes + changes.T) / root[:, None] / root)
    modes = pm.normal_modes(scene, rattlers="keep").eigenvalue_m
    np.testing.assert_allclose(modes, value[-len(modes) :], rtol=0.0, atol=1e-6 * value.max())
    assert len(modes) >= size - 2 and modes.min() > 0.0


def test_what_is_held_neither_moves_nor_turns_at_rest():
    scene = boxed("ellipses")
    held = scene.replace(effects=(*scene.effects, pm.FixedParticles((2, 5))))
    run = pm.quench(held, force_tolerance=1e-6, check=False)
    start, end = scene.packing, run.packing
    assert np.array_equal(end.position_nd[[2, 5]], start.position_nd[[2, 5]])
    assert np.abs(end.shapes.rotation_since(start.shapes)[[2, 5]]).max() < 1e-15
    assert np.abs(end.shapes.rotation_since(start.shapes)).max() > 1e-2
    assert (pm.forces(held)[[2, 5]] == 0.0).all() and (pm.torques(held)[[2, 5]] == 0.0).all()
    matrix = pm.hessian(held, "none").toarray()
    assert not matrix[6:9].any() and not matrix[:, 15:18].any()
    modes = pm.normal_modes(held.replace(packing=end), rattlers="keep")
    moving = np.flatnonzero(np.abs(modes.displacement_mnd).max(axis=(0, 2)) > 0.0)
    assert not np.isin([2, 5], moving).any() and np.isin(moving, modes.index_n).all()
    assert not np.isin([2, 5], modes.index_n).any()


def test_walls_of_ones_own_are_refused_by_name():
    @pm.effect
    class Slope(NamedTuple):
        rate: float = 1.0

        acts_as = "walls"

        def body_force(self, x, y, z, u, v, w, mass, radius):
            return 0.0, self.rate * max(radius - y, 0.0), 0.0

        def body_energy(self, x, y, z, mass, radius):
            return 0.5 * self.rate * max(radius - y, 0.0) ** 2

    scene = boxed("ellipses").replace(effects=(pm.Repulsion(), Slope()))
    for call in (pm.energy, pm.wall_contacts, lambda one: pm.simulate(one, steps=1, dt=0.1)):
        with pytest.raises(ValueError, match="must hold no .*Slope for Spheroids, which it would take for discs"):
            call(scene)


def piled(shapes):
    """Return a few particles that came to rest on a floor between side walls."""
    start = pm.random_packing(8, dimension=2, packing_fraction=0.3, shapes=shapes, seed=2)
    side = start.box.lattice_dd[0, 0]
    effects = (pm.Repulsion(), pm.Walls(1, 0.2, 9.0 * side), pm.Walls(0, 0.2, side - 0.2), pm.Gravity(0.0, -0.01))
    scene = pm.Scene(start, effects)
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-9).packing)


@pytest.mark.parametrize("shapes", [pm.Ellipses(aspect=1.7), pm.Dimer(0.8)], ids=["ellipses", "dimers"])
def test_a_pile_is_counted_with_its_walls_and_its_stress_is_not_symmetric_by_what_they_turn(shapes):
    scene = piled(shapes)
    report = examine(scene, modes=0)
    numbers = report.numbers
    found = pm.find_shape_contacts(scene.packing, gap_tolerance=0.0)
    touching = found.count_n() + np.bincount(pm.wall_contacts(scene).particle_w, minlength=scene.packing.particles)
    assert numbers["rattlers"] == (touching == 0).sum() < 8
    assert numbers["contacts"] == len(found) > 0 and numbers["wall_contacts"] == len(pm.wall_contacts(scene)) > 1
    assert numbers["local_minimum"] is True
    text = str(report.summary())
    assert f"and {numbers['wall_contacts']} with walls" in text and "local minimum" in text
    # V (sigma_yx - sigma_xy) is the sum of the torques of contacts, which walls balance
    stress, volume = pm.stress_tensor(scene), scene.packing.box.volume
    by_contacts = pm.torques(scene.without(pm.Walls)).sum()
    by_walls = pm.torques(scene).sum() - by_contacts
    skew = volume * (stress[1, 0] - stress[0, 1])
    assert skew == pytest.approx(by_contacts, rel=1e-10)
    assert skew == pytest.approx(-by_walls, rel=1e-5) and abs(skew) > 1e-6


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("shaped", [False, True])
@pytest.mark.parametrize("missing", [1e-3, 1e-9])
def test_the_net_force_on_what_leans_on_a_floor_alone_is_compared_with_its_weight(dimension, shaped, missing):
    # the disc is pushed by k (2 r - 2 h): a part of its weight is missing
    down = [0.0, -0.01, 0.0][:dimension]
    shapes = pm.Spheroids([1.0], [[1.0, 0.0, 0.0][:dimension]]) if shaped else None
    start = pm.Packing(np.full((1, dimension), 2.0), [0.5], pm.Box.cubic(4.0, dimension), shapes=shapes)
    weight = 0.01 * start.mass_n[0]
    height = 0.5 - (1.0 - missing) * weight / 2.0 / 10.0
    place = np.array(start.position_nd)
    place[0, 1] = 1.0 + height
    floor = pm.Walls(1, 1.0, 3.9, law=pm.LinearSpring(10.0))
    scene = pm.Scene(start.replace(position_nd=place), (pm.Repulsion(), pm.Gravity(*down), floor))
    net, mean = force_balance(scene)
    # the weight and the floor's push
    assert net == pytest.approx(missing * weight, rel=1e-5)
    assert mean == pytest.approx((1.0 - 0.5 * missing) * weight, rel=1e-12)
    # at rest just where the tolerance allows what is missing
    run = pm.quench(scene, force_tolerance=1.01 * net / mean, method=pm.Fire())
    assert run.steps == 0 and run.residual == pytest.approx(net / mean, rel=1e-5)
    assert pm.quench(scene, force_tolerance=0.99 * net / mean, method=pm.Fire()).steps > 0
