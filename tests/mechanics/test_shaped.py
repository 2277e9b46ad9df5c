"""Facts about the mechanics of packings of ellipses and spheroids: Hessian, modes, moduli, counts, quartic modes."""

import functools
from contextlib import nullcontext

import numpy as np
import pytest

import packmech as pm


@functools.cache
def jammed(d=2, count=24, aspect=1.6, seed=3, pressure=1e-3, strain="free"):
    start = pm.random_packing(
        count, dimension=d, packing_fraction=0.6 if d == 2 else 0.4, seed=seed, shapes=pm.Ellipses(aspect)
    )
    scene = pm.Scene(start, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=pressure, strain=strain).packing)


def round_and_shaped(d, pressure=1e-4):
    """Return a jammed packing of discs or spheres, and the same written as spheroids of aspect 1."""
    start = pm.random_packing(24, dimension=d, packing_fraction=0.6 if d == 2 else 0.4, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=pressure).packing)
    shapes = pm.Spheroids(np.ones(24), np.random.default_rng(0).normal(size=(24, d)))
    return scene, scene.replace(packing=scene.packing.replace(shapes=shapes))


@pytest.mark.parametrize("d", [2, 3])
def test_aspect_one_has_the_moduli_modes_and_counts_of_discs(d):
    scene, shaped = round_and_shaped(d)
    one, other = pm.elastic_moduli(scene), pm.elastic_moduli(shaped)
    assert np.abs(one.cauchy - other.cauchy).max() < 1e-12 * np.abs(one.cauchy).max()
    assert (one.particles, one.contacts, one.negative_positions) == (
        other.particles, other.contacts, other.negative_positions,
    )  # fmt: skip
    for strain in ("none", "isochoric", "free"):
        flat, turning = (pm.normal_modes(each, strain=strain) for each in (scene, shaped))
        assert len(flat) == len(turning) and not turning.rotation_m.any()
        assert np.abs(flat.eigenvalue_m - turning.eigenvalue_m).max() < 1e-13 * flat.largest
        counted = [pm.states_of_self_stress(pm.remove_rattlers(each.packing)[0], strain) for each in (scene, shaped)]
        assert (counted[0].count, counted[0].motions, counted[0].rank) == (
            counted[1].count, counted[1].motions, counted[1].rank,
        )  # fmt: skip


@pytest.mark.parametrize("d", [2, 3])
def test_the_hessian_is_the_derivative_of_forces_and_torques(d):
    scene = jammed(d, count=12, aspect=1.7, pressure=1e-2)
    packing = scene.packing
    turn = packing.shapes.turn_basis(packing.radius_n)
    matrix = pm.hessian(scene, strain="none").toarray()
    assert np.abs(matrix - matrix.T).max() < 1e-14

    def pull(other):
        torque = pm.torques(scene.replace(packing=other)).reshape(12, -1)
        # along the rotations of the start: the same to second order in small turns about them
        return np.hstack([pm.forces(scene.replace(packing=other)), np.einsum("nkt,nt->nk", turn, torque)])

    rng, step, width = np.random.default_rng(1), 1e-6, d + turn.shape[1]
    for _ in range(3):
        way = rng.normal(size=(12, width))
        way[:, d:] *= np.eye(12)[:, [3]] if d == 3 else 1.0
        ends = [pull(pm.displaced(packing, sign * step * way[:, :d], sign * step * way[:, d:])) for sign in (1, -1)]
        found = (ends[1] - ends[0]).ravel() / (2 * step)
        expected = matrix @ way.ravel()
        if d == 3:
            # a turn about one axis and then another is not one about their sum: torques at rest only
            found, expected = found.reshape(12, width)[:, :d], expected.reshape(12, width)[:, :d]
        assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
        energy = pm.perturbation_energy(scene, way)
        moved = [pm.energy(scene.replace(packing=pm.displaced(packing, s * 1e-4 * way[:, :d], s * 1e-4 * way[:, d:])))
                 for s in (1, -1)]  # fmt: skip
        assert (sum(moved) - 2 * pm.energy(scene)) / 2e-8 == pytest.approx(energy, rel=1e-4)


def test_moduli_are_slopes_of_the_stress_of_packings_that_relaxed():
    scene = jammed()
    moduli, packing, step = pm.elastic_moduli(scene), scene.packing, 1e-6
    assert moduli.stable and moduli.force_residual < 1e-6

    def stress(strain):
        grown = np.eye(2) + strain
        moved = packing.replace(position_nd=packing.position_nd @ grown.T, box=pm.Box(grown @ packing.box.lattice_dd))
        run = pm.quench(scene.replace(packing=moved), force_tolerance=1e-11, method=pm.Newton(), check=False)
        return pm.stress_tensor(scene.replace(packing=run.packing))

    shear, swell = np.array([[0.0, 1.0], [0.0, 0.0]]), np.eye(2)
    slopes = [(stress(step * one) - stress(-step * one)) / (2 * step) for one in (shear, swell)]
    assert slopes[0][0, 1] == pytest.approx(moduli.shear_modulus, rel=1e-6)
    assert np.trace(slopes[1]) / 4 == pytest.approx(moduli.bulk_modulus, rel=1e-7)


@pytest.mark.parametrize("d", [2, 3])
def test_modes_are_orthonormal_and_counted_with_their_rotations(d):
    scene = jammed(d, count=16, aspect=1.5)
    modes = pm.normal_modes(scene)
    packing = scene.packing
    mass = packing.mass_n[:, None]
    u, t = modes.displacement_mnd * np.sqrt(mass), modes.turn_mnk * np.sqrt(mass)
    both = np.concatenate([u.reshape(len(modes), -1), t.reshape(len(modes), -1)], axis=1)
    assert np.abs(both @ both.T - np.eye(len(modes))).max() < 1e-12
    assert np.allclose(modes.rotation_m, (t**2).sum(axis=(1, 2)), atol=1e-12)
    free = len(modes.index_n) * (3 if d == 2 else 5)
    assert modes.available == free - d and modes.translation_error < 1e-12 and modes.missed == 0
    # all directions add up to one for each coordinate, of which rotations are a part
    assert 0.2 < modes.rotation_m.sum() / (free - d) < 0.8
    density = pm.density_of_states(scene, 8)
    assert np.array_equal(density.count_b, pm.density_of_states(modes, 8).count_b)
    few = pm.normal_modes(scene, 5, method="shift-invert")
    assert np.abs(few.eigenvalue_m - modes.eigenvalue_m[:5]).max() < 1e-10 * modes.largest
    whole = np.linalg.eigvalsh(pm.dynamical_matrix(scene).toarray())
    assert np.abs(np.sort(whole)[-3:] - modes.eigenvalue_m[-3:]).max() < 1e-10 * modes.largest


@pytest.mark.parametrize(("d", "aspect", "strain"), [(2, 1.05, "isotropic"), (2, 1.5, "free"), (3, 1.3, "isotropic")])
def test_what_is_missing_in_contacts_is_there_in_quartic_modes(d, aspect, strain):
    scene = jammed(d, count=20, aspect=aspect, pressure=1e-6, strain=strain)
    held, _ = pm.remove_rattlers(scene.packing)
    states = pm.states_of_self_stress(held, "none" if strain == "isotropic" else "isochoric")
    assert states.count == 1 and states.certain and states.residual < 1e-10
    missing = states.motions - d - states.contacts + 1
    modes = pm.quartic_modes(scene, strain="none" if strain == "isotropic" else "isochoric")
    assert len(modes) == missing > 0 and modes.certain and modes.stretch < 1e-9
    assert (modes.curvature_m > 0.0).all() and modes.curvature_m.max() < 30 * modes.pressure


def test_curvatures_of_quartic_modes_fall_with_the_pressure_and_the_energy_is_of_fourth_order():
    found = {}
    for pressure in (1e-5, 1e-7, 1e-10):
        scene = jammed(count=20, aspect=1.3, seed=1, pressure=1e-5, strain="isotropic")
        run = pm.sweep_pressure(scene, [pressure], strain="isotropic", check=False)[0]
        found[pressure] = pm.quartic_modes(scene.replace(packing=run.packing)), run.packing
    high, low = (found[one][0] for one in (1e-5, 1e-7))
    assert len(high) == len(low)
    assert np.abs(high.curvature_m / high.pressure - low.curvature_m / low.pressure).max() < 0.05
    modes, packing = found[1e-10]
    amplitude = np.logspace(-3, -2, 9)
    start = pm.energy(scene.replace(packing=packing))

    def moved(m, a):
        there = pm.displaced(packing, a * modes.displacement_mnd[m], a * modes.turn_mnk[m])
        return pm.energy(scene.replace(packing=there))

    for m in range(len(modes)):
        energy = [moved(m, a) for a in amplitude]
        slope = np.polyfit(np.log(amplitude), np.log(np.array(energy) - start), 1)[0]
        assert slope == pytest.approx(4.0, abs=0.05)
    # below the root of the pressure it is the prestress alone
    assert moved(0, 1e-7) - start == pytest.approx(0.5e-14 * modes.curvature_m[0], rel=0.2)


def test_floppy_modes_of_shapes_stretch_nothing():
    scene = jammed(count=20, aspect=1.3, seed=1, pressure=1e-5, strain="isotropic")
    held, _ = pm.remove_rattlers(scene.packing)
    floppy = pm.floppy_modes(held)
    contacts = pm.find_shape_contacts(held)

    def distances(motion, step):
        there = pm.displaced(held, step * motion[:, :2], step * motion[:, 2:])
        found = pm.find_shape_contacts(there, gap_tolerance=1e-3)
        pairs = zip(found.i_c, found.j_c, found.image_cd.tolist(), strict=True)
        return dict(zip([(i, j, *image) for i, j, image in pairs], found.distance_c, strict=True))

    for k in range(floppy.count):
        motion = floppy.motion_xk[: 3 * held.particles, k].reshape(held.particles, 3)
        ends = [distances(motion, step) for step in (1e-4, -1e-4)]
        pairs = zip(contacts.i_c, contacts.j_c, contacts.image_cd.tolist(), strict=True)
        both = [key for key in ((i, j, *image) for i, j, image in pairs) if key in ends[0] and key in ends[1]]
        assert len(both) > 0.9 * len(contacts)
        assert max(abs(ends[0][key] - ends[1][key]) for key in both) / 2e-4 < 1e-6


@pytest.mark.parametrize("d", [2, 3])
def test_a_packing_whose_particles_all_rattle_has_nothing(d):
    start = pm.random_packing(6, dimension=d, packing_fraction=0.01, seed=1, shapes=pm.Ellipses(1.5))
    few = pm.Packing(
        [[1.0] * d, [1.9, *[1.0] * (d - 1)]], [0.5, 0.5], pm.Box.cubic(8.0, d),
        shapes=pm.Spheroids([1.5, 1.2], np.eye(d)[:2]),
    )  # fmt: skip
    for packing in (start, few):
        scene = pm.Scene(packing, (pm.Repulsion(),))
        # the two that touch are not at rest
        with pytest.warns(UserWarning, match="2 of 2 particles count as") if packing is few else nullcontext():
            moduli, modes = pm.elastic_moduli(scene), pm.normal_modes(scene)
        assert moduli.particles == 0 and not moduli.cauchy.any()
        assert len(pm.quartic_modes(scene)) == len(modes) == 0
        assert pm.find_rattlers(packing).all()
    # kept, the two that touch have one vibration and the others cost nothing
    assert (pm.normal_modes(scene, kind="unstressed", rattlers="keep").eigenvalue_m > 1e-6).sum() == 1
    assert pm.floppy_modes(few).count == 2 * (3 if d == 2 else 5) - d - 1


@pytest.mark.parametrize("shapes", [pm.Ellipses(aspect=1.5), pm.Dimer()], ids=["ellipses", "dimers"])
def test_the_compliance_is_the_inverse_of_the_stiffness_by_both_methods(shapes):
    packing = pm.random_packing(14, dimension=2, packing_fraction=0.95, shapes=shapes, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-10).packing)
    sparse, dense = (pm.compliance_matrix(scene, method=name) for name in ("sparse", "pseudoinverse"))
    size = np.abs(sparse).max()
    assert np.abs(sparse - dense).max() < 1e-10 * size
    assert np.abs(sparse @ pm.elastic_moduli(scene).energy - np.eye(3)).max() < 1e-10


def test_discs_written_as_round_ellipses_are_as_compliant_as_discs():
    packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    n = packing.particles
    scene = pm.Scene(packing, (pm.Repulsion(),))
    round_ones = scene.replace(packing=packing.replace(shapes=pm.Spheroids(np.ones(n), np.eye(2)[[0] * n])))
    for method in ("sparse", "pseudoinverse"):
        one, other = (pm.compliance_matrix(each, method=method) for each in (scene, round_ones))
        assert np.abs(one - other).max() < 1e-10 * np.abs(one).max()


@pytest.mark.parametrize(
    ("dimension", "shapes"),
    [(2, pm.Ellipses(aspect=1.5)), (3, pm.Ellipses(aspect=0.7)), (3, pm.Trimer())],
    ids=["ellipses", "spheroids", "trimers"],
)
def test_the_rigidity_matrix_makes_net_forces_torques_and_the_unstressed_hessian(dimension, shapes):
    packing = pm.random_packing(9, dimension=dimension, packing_fraction=0.7, shapes=shapes, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(2.0)),))
    contacts = pm.find_shape_contacts(packing)
    matrix = pm.rigidity_matrix(packing)
    push = 2.0 * (contacts.contact_distance_c - contacts.distance_c)
    gained = matrix.T @ push
    turn = packing.shapes.turn_basis(packing.radius_n)
    torque = np.einsum("nkt,nt->nk", turn, pm.torques(scene).reshape(9, -1))
    net = np.hstack([pm.forces(scene), torque]).ravel()
    np.testing.assert_allclose(gained[: net.size], net, rtol=0, atol=1e-12)
    # columns of strains: minus V times the stress, its symmetric part
    stress = pm.stress_tensor(scene)
    assert gained[net.size :][:dimension] == pytest.approx(-packing.box.volume * np.diag(stress), rel=1e-12)
    full = pm.hessian(scene, kind="unstressed", strain_scale=1.0).toarray()
    np.testing.assert_allclose(2.0 * (matrix.T @ matrix).toarray(), full, rtol=0, atol=1e-10)
    assert pm.rigidity_matrix(packing, contacts=contacts, strain="none").shape == (len(contacts), net.size)
    with pytest.raises(TypeError, match="ShapeContacts for a packing with shapes, got Contacts"):
        pm.rigidity_matrix(packing, contacts=pm.find_contacts(packing.replace(shapes=None)))


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_the_one_state_of_self_stress_of_ellipses_is_their_pressure(strain):
    scene = jammed(2, count=20, aspect=1.5, pressure=1e-6, strain=strain)
    held, _ = pm.remove_rattlers(scene.packing)
    # what is jammed with the shape of the box free has no other stress than pressure
    count = {"none": 1, "isotropic": 0} | ({"isochoric": 1, "free": 0} if strain == "free" else {})
    for admitted, states in count.items():
        found = pm.states_of_self_stress(held, admitted)
        assert found.count == states and found.residual < 1e-10, admitted


def test_quartic_modes_at_constant_pressure_are_those_at_constant_volume():
    """A motion that stretches no contact does no work against the pressure: it changes no volume."""
    scene = jammed(2, count=20, aspect=1.5, pressure=1e-6, strain="free")
    for one, other in (("none", "isotropic"), ("isochoric", "free")):
        first, second = (pm.quartic_modes(scene, strain=strain) for strain in (one, other))
        assert len(first) == len(second) > 0
        # modes that strain the box are of size 1 with their strains, whose unit is that of the strains admitted
        relative = 1e-6 if one == "none" else 0.1
        np.testing.assert_allclose(second.curvature_m, first.curvature_m, rtol=relative, atol=1e-9 * first.pressure)


def touched_at_one_bead(scene):
    """Return the bodies that touch others at one bead alone, and the arm from the center to it."""
    held, index = pm.remove_rattlers(scene.packing)
    found = pm.find_shape_contacts(held)
    found = found.select(found.gap_c < 0.0)
    sites = [set() for _ in range(held.particles)]
    for ends, beads in ((found.i_c, found.site_i_c), (found.j_c, found.site_j_c)):
        for n, bead in zip(ends.tolist(), beads.tolist(), strict=True):
            sites[n].add(bead)
    arm = held.shapes.arms(held.radius_n)
    return {int(index[n]): arm[next(iter(one))] for n, one in enumerate(sites) if len(one) == 1}


@pytest.mark.parametrize(("d", "turns"), [(2, 1), pytest.param(3, 2, marks=pytest.mark.slow)])
def test_spins_about_the_only_bead_that_is_touched_are_no_quartic_modes(d, turns):
    dimer = pm.Dimer(0.4, radii=(0.5, 0.3))
    start = pm.random_packing(24, dimension=d, packing_fraction=0.5 if d == 2 else 0.3, seed=3, shapes=dimer)
    scene = pm.Scene(start, (pm.Repulsion(),))
    run = pm.jam(scene, pressure=1e-6, strain="isotropic")
    scene = scene.replace(packing=run.packing)
    free = touched_at_one_bead(scene)
    found = pm.quartic_modes(scene)
    assert found.free_turns == turns * len(free) > 0
    assert len(found) == run.report["floppy_modes"] - found.free_turns
    assert (found.curvature_m > 1e-3 * found.pressure).all()
    # turned about that bead by ten times the overlaps nothing changes; about the center it does
    energy, shapes = pm.energy(scene), run.packing.shapes
    for about_bead in (True, False):
        position, rotation = run.packing.position_nd.copy(), np.zeros((24, 1 if d == 2 else 3))
        for n, arm in free.items():
            angle = 1e-5
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            moved = arm.copy()
            moved[:2] = turn @ arm[:2]
            rotation[n, -1] = angle
            position[n] += (arm - moved) if about_bead else 0.0
        turned = scene.replace(packing=run.packing.replace(position_nd=position, shapes=shapes.turned(rotation)))
        change = abs(pm.energy(turned) - energy)
        assert change < 1e-8 * energy if about_bead else change > 1e-2 * energy
