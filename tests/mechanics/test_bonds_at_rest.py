"""Bonds at rest: forces, stress, second derivatives, modes and moduli of normal springs between named pairs."""

import dataclasses

import numpy as np
import pytest

import packmech as pm
from packmech.minimize.program import build_program

LAW, PULL = pm.LinearSpring(2.0), pm.ExponentialTension(1.5, 0.2)


def bonded(dimension=2, particles=12, shapes=None, seed=3, part=2):
    """Return a scene out of balance: every second contact is a bond, of a length of its own; one bond spans a gap."""
    rng = np.random.default_rng(seed)
    packing = pm.random_packing(particles, dimension=dimension, packing_fraction=0.9, seed=seed, shapes=shapes)
    packing = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-2).packing
    bonds = pm.bond_contacts(packing, compression=LAW, tension=PULL, tangential_stiffness=0.0, rest="distance")
    bonds = bonds.select(np.arange(len(bonds)) % part == 0)
    there = np.zeros((1, dimension), dtype=np.int64)
    far = pm.Bonds([0], [particles - 1], there, [1.0], LAW, PULL, 0.0)
    names = ("i_b", "j_b", "image_bd", "rest_length_b")
    both = [np.concatenate([getattr(bonds, name), getattr(far, name)]) for name in names]
    _, first = np.unique(np.column_stack(both[:3]), axis=0, return_index=True)
    length = both[3] * rng.uniform(0.95, 1.05, len(both[3]))
    springs = pm.Bonds(both[0][first], both[1][first], both[2][first], length[first], LAW, PULL, 0.0)
    return pm.Scene(packing, (pm.Repulsion(), springs))


SCENES = {
    "discs": {},
    "spheres": {"dimension": 3},
    "ellipses": {"shapes": pm.Ellipses(1.4), "particles": 8},
}


@pytest.fixture(scope="module", params=SCENES)
def scene(request):
    return bonded(**SCENES[request.param])


def moved(scene, change_nd):
    return scene.replace(packing=scene.packing.replace(position_nd=scene.packing.position_nd + change_nd))


def strained(scene, strain_dd):
    packing, map_dd = scene.packing, np.eye(scene.packing.dimension) + strain_dd
    place = packing.position_nd @ map_dd.T
    return scene.replace(packing=packing.replace(position_nd=place, box=pm.Box(map_dd @ packing.box.lattice_dd)))


def test_forces_and_stress_are_differences_of_the_energy(scene):
    step, size = 1e-5, scene.packing.position_nd.shape
    direction = np.random.default_rng(1).normal(size=size)
    slope = (pm.energy(moved(scene, step * direction)) - pm.energy(moved(scene, -step * direction))) / (2.0 * step)
    assert -(pm.forces(scene) * direction).sum() == pytest.approx(slope, rel=1e-6)
    # shapes do not turn with the strain
    strain = np.random.default_rng(2).normal(size=(size[1], size[1]))
    slope = (pm.energy(strained(scene, step * strain)) - pm.energy(strained(scene, -step * strain))) / (2.0 * step)
    assert (pm.stress_tensor(scene) * strain).sum() * scene.packing.box.volume == pytest.approx(slope, rel=1e-6)
    assert pm.pressure(scene) == pytest.approx(-np.trace(pm.stress_tensor(scene)) / size[1])


def test_what_is_bonded_is_no_contact(scene):
    (bonds,) = (one for one in scene.effects if isinstance(one, pm.Bonds))
    slack = dataclasses.replace(bonds, compression=pm.LinearSpring(1e-300), tension=pm.LinearSpring(1e-300))
    touching = (
        pm.find_shape_contacts(scene.packing)
        if scene.packing.shapes.has_orientations
        else pm.find_contacts(scene.packing)
    )
    pairs = {tuple(row) for row in np.column_stack([bonds.i_b, bonds.j_b, bonds.image_bd])}
    kept = [tuple(row) not in pairs for row in np.column_stack([touching.i_c, touching.j_c, touching.image_cd])]
    overlap = 1.0 - touching.distance_c / touching.contact_distance_c
    expected = 0.5 * (np.maximum(overlap, 0.0)[kept] ** 2).sum()
    assert 0 < sum(kept) < len(kept)
    assert pm.energy(scene.replace(effects=(pm.Repulsion(), slack))) == pytest.approx(expected, rel=1e-12)


def test_the_hessian_is_the_difference_of_forces(scene):
    step, (n, d) = 1e-6, scene.packing.position_nd.shape
    hessian = pm.hessian(scene, "none").toarray()
    q = len(hessian) // n
    direction = np.random.default_rng(1).normal(size=(n, d))
    change = np.zeros((n, q))
    change[:, :d] = direction
    ends = [pm.forces(moved(scene, side * step * direction)) for side in (1.0, -1.0)]
    found = (hessian @ change.ravel()).reshape(n, q)[:, :d]
    expected = (ends[1] - ends[0]) / (2.0 * step)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_mixed_and_strain_derivatives_are_differences_of_energies(scene):
    if scene.packing.shapes.has_orientations:
        pytest.skip("turns do not follow a strain")
    step, d = 1e-4, scene.packing.dimension
    rng = np.random.default_rng(4)
    strain = rng.normal(size=(d, d))
    strain = 0.5 * (strain + strain.T)
    one = pm.energy(scene)
    second = (
        pm.energy(strained(scene, step * strain)) + pm.energy(strained(scene, -step * strain)) - 2.0 * one
    ) / step**2
    # e = mandel components of the strain
    e = pm.mandel_vector(strain)
    corner = pm.hessian(scene).toarray()[-len(e) :, -len(e) :]
    assert e @ corner @ e == pytest.approx(second, rel=1e-5)


@pytest.fixture(scope="module")
def rest():
    """Return a crystal whose every contact is a bond, stretched as a whole: at rest without a single contact."""
    packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=-0.05)
    bonds = pm.bond_contacts(
        packing, compression=LAW, tension=PULL, tangential_stiffness=0.0, rest="contact", gap_tolerance=0.06
    )
    return pm.Scene(packing, (pm.Repulsion(), bonds))


def test_a_stretched_crystal_of_bonds_pulls_with_its_law(rest):
    (_, bonds) = rest.effects
    r = pm.find_contacts(rest.packing, gap_tolerance=0.06).distance_c
    assert len(r) == len(bonds) and (r > bonds.rest_length_b).all()
    assert pm.energy(rest) == pytest.approx(sum(PULL.energy(x, 1.0) for x in r))
    # P V d = - sum of u' r
    assert pm.pressure(rest) * 2.0 * rest.packing.box.volume == pytest.approx(-sum(PULL.first(x, 1.0) * x for x in r))
    assert np.abs(pm.forces(rest)).max() < 1e-14


def test_moduli_of_a_bonded_crystal_are_differences_of_its_stress(rest):
    moduli, step = pm.elastic_moduli(rest), 1e-5
    for strain in (np.eye(2) / np.sqrt(2.0), np.array([[1.0, 0.0], [0.0, -1.0]]) / np.sqrt(2.0)):
        ends = [pm.stress_tensor(strained(rest, side * step * strain)) for side in (1.0, -1.0)]
        found = (ends[0] - ends[1]) / (2.0 * step)
        # one particle in a cell of a lattice: nothing relaxes
        expected = moduli.cauchy @ pm.mandel_vector(strain)
        assert pm.mandel_vector(0.5 * (found + found.T)) == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert moduli.bulk_modulus > 0.0 and moduli.particles == 16
    sparse = pm.compliance_matrix(rest)
    assert sparse == pytest.approx(pm.compliance_matrix(rest, method="pseudoinverse"), rel=1e-8, abs=1e-10)


def test_moduli_are_those_at_low_frequencies(rest):
    found = pm.complex_modulus(rest, [1e-6]).modulus_f[0].real
    assert pm.elastic_moduli(rest).shear_modulus == pytest.approx(found, rel=1e-6)


def test_modes_of_a_bonded_crystal_are_those_of_its_dynamical_matrix(rest):
    modes = pm.normal_modes(rest)
    values = np.linalg.eigvalsh(pm.dynamical_matrix(rest).toarray())
    assert len(modes) == 30 and modes.eigenvalue_m == pytest.approx(values[2:], abs=1e-10)
    assert pm.density_of_states(rest, 10).count_b.sum() == 30


def test_what_bonds_join_is_taken_out_only_as_a_whole():
    pair = pm.Packing([[1.0, 1.0], [2.0, 1.0], [4.0, 4.0]], [0.5] * 3, pm.Box.cubic(6.0, 2))
    scene = pm.Scene(pair, (pm.Repulsion(), pm.Bonds([0], [1], [[0, 0]], [1.0], tangential_stiffness=0.0)))
    assert len(pm.normal_modes(scene)) == 0
    kept = pm.normal_modes(scene, rattlers="keep")
    # one stretches; with the translations of the box left out there are three others that cost nothing
    assert np.count_nonzero(kept.eigenvalue_m > 1e-9) == 1


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("method", [None, pm.LBFGS(), pm.Newton()])
def test_a_quench_ends_where_bonds_and_contacts_balance_in_a_minimum(dimension, method):
    scene = bonded(dimension, particles=16, part=3)
    run = pm.quench(scene, force_tolerance=1e-9, method=method, trace_every=20)
    end = scene.replace(packing=run.packing)
    (_, bonds) = scene.effects
    force = np.abs(pm.forces(end)).max()
    assert run.residual <= 1e-9 and 0.0 <= force < 1e-8 * np.abs(pm.forces(scene)).max()
    assert pm.energy(end) < pm.energy(scene) and run.report["negative_modes"] == 0
    # what was kept on the way is what stands there
    assert run.trace["energy"][-1] == pytest.approx(pm.energy(end), rel=1e-12)
    assert run.trace["pressure"][-1] == pytest.approx(pm.pressure(end), rel=1e-9)
    hessian = pm.hessian(end, "none").toarray()
    assert np.linalg.eigvalsh(hessian)[0] > -1e-9 * np.abs(hessian).max()
    # moduli are changes of the stress of packings that are strained a little and quenched again
    if method is None and dimension == 2:
        moduli, step = pm.elastic_moduli(end, rattlers="keep"), 1e-6
        shear = np.array([[0.0, 0.5], [0.5, 0.0]])
        ends = [
            pm.quench(strained(end, side * step * shear), force_tolerance=1e-12, check=False).packing
            for side in (1, -1)
        ]
        up, down = (pm.stress_tensor(end.replace(packing=one)) for one in ends)
        found = pm.mandel_vector(0.5 * (up - down + (up - down).T)) / (2.0 * step)
        assert found == pytest.approx(moduli.cauchy @ pm.mandel_vector(shear), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("shapes", [pm.Ellipses(1.4), pm.Trimer()], ids=["ellipses", "bodies"])
def test_bonds_of_shapes_are_relaxed_as_those_of_discs(shapes):
    scene = bonded(shapes=shapes, particles=8)
    run = pm.quench(scene, force_tolerance=1e-9)
    end = scene.replace(packing=run.packing)
    assert run.residual <= 1e-9 and run.report["negative_modes"] == 0
    # the loops of minimizers and what is measured of a packing agree
    program = build_program(end)
    assert program.evaluate().energy == pytest.approx(pm.energy(end), rel=1e-12)
    assert np.abs(pm.forces(end)).max() < 1e-8 * np.abs(pm.forces(scene)).max()
    here = build_program(scene).evaluate()
    assert here.force_nd[:8] == pytest.approx(pm.forces(scene), abs=1e-12)
    assert here.contacts == pm.elastic_moduli(scene, rattlers="keep").contacts
    assert pm.elastic_moduli(end).bulk_modulus > 0.0


@pytest.fixture(scope="module", params=[2, 3])
def rough(request):
    """Return frictional discs or spheres at rest in a crystal, a third of whose contacts are bonds, pushed across."""
    d = request.param
    name, repeats = {2: ("triangular", (3, 3)), 3: ("fcc", (2, 2, 1))}[d]
    packing = pm.lattice_packing(name, repeats=repeats, relative_overlap=0.02)
    bonds = pm.bond_contacts(packing, compression=LAW, tension=LAW, tangential_stiffness=0.3, rest="contact")
    bonds = bonds.select(np.arange(len(bonds)) % 3 == 0)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.4, stiffness=0.7), bonds))
    smooth = (pm.Repulsion(), dataclasses.replace(bonds, tangential_stiffness=0.0))
    run = pm.quench(pm.Scene(packing, smooth), force_tolerance=1e-13, check=False)
    return scene.replace(packing=run.packing)


def slips(packing, contacts, change_nq):
    """Return the (C, 3) slips at the points of contact of displacements and rotations, these measured in lengths."""
    d, radius = packing.dimension, packing.radius_n
    u, spin, normal = np.zeros((len(radius), 3)), np.zeros((len(radius), 3)), np.zeros((len(contacts), 3))
    u[:, :d], normal[:, :d] = change_nq[:, :d], contacts.normal_cd
    turned = np.einsum("nk,nkt->nt", change_nq[:, d:], packing.spin_nkk)
    spin[:, 3 - turned.shape[1] :] = turned
    i, j = contacts.i_c, contacts.j_c
    arm = contacts.distance_c / (radius[i] + radius[j])
    rate = u[j] - u[i] - np.cross((arm * radius[i])[:, None] * spin[i] + (arm * radius[j])[:, None] * spin[j], normal)
    return rate - (rate * normal).sum(axis=1)[:, None] * normal


def test_moduli_with_friction_and_bonds_are_those_at_low_frequencies(rough):
    moduli = pm.elastic_moduli(rough)
    slow = {mode: pm.complex_modulus(rough, [1e-6], mode=mode).modulus_f[0].real for mode in ("uniaxial", "isotropic")}
    d = rough.packing.dimension
    cauchy, one = moduli.cauchy, np.eye(d)
    assert cauchy[0, 0] == pytest.approx(slow["uniaxial"], rel=1e-6)
    assert moduli.bulk_modulus == pytest.approx(slow["isotropic"] / d, rel=1e-6)
    # bonds hold: without them, or with slack ones across, the packing is softer
    free = rough.without(pm.Bonds)
    assert pm.mandel_vector(one) @ cauchy @ pm.mandel_vector(one) > 0.0 and len(free.effects) == 2
    (*others, bonds) = rough.effects
    slack = rough.replace(effects=(*others, dataclasses.replace(bonds, tangential_stiffness=0.0)))
    assert pm.elastic_moduli(slack).shear_modulus < moduli.shear_modulus


def test_the_stiffness_with_friction_and_bonds_is_the_difference_of_forces(rough):
    (*others, bonds) = rough.effects
    # tangential springs stretch along the way: those of bonds and contacts left out, forces are functions of places
    normal = (pm.Repulsion(), pm.Friction(0.4, stiffness=1e-12), dataclasses.replace(bonds, tangential_stiffness=0.0))
    scene, step = rough.replace(effects=normal), 1e-6
    n, d = scene.packing.position_nd.shape
    matrix = pm.stiffness_matrix(scene, "none").toarray()
    direction = np.random.default_rng(5).normal(size=(n, d))
    change = np.zeros((n, len(matrix) // n))
    change[:, :d] = direction
    ends = [pm.forces(moved(scene, side * step * direction)) for side in (1.0, -1.0)]
    expected = (ends[1] - ends[0]) / (2.0 * step)
    found = (matrix @ change.ravel()).reshape(change.shape)[:, :d]
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
    # slack tangential springs add half their stiffness times the square of the slip
    change[:, d:] = np.random.default_rng(6).normal(size=change[:, d:].shape)
    more = pm.stiffness_matrix(rough, "none").toarray() - matrix
    contacts = pm.find_contacts(rough.packing)
    pairs = {tuple(row) for row in np.column_stack([bonds.i_b, bonds.j_b, bonds.image_bd])}
    names = zip(contacts.i_c, contacts.j_c, contacts.image_cd, strict=True)
    is_bond = np.array([(i, j, *image) in pairs for i, j, image in names])
    stiffness = np.where(is_bond, bonds.tangential_stiffness, 0.7)
    square = (slips(rough.packing, contacts, change) ** 2).sum(axis=1)
    assert 0 < is_bond.sum() == len(bonds) < len(contacts)
    assert change.ravel() @ more @ change.ravel() == pytest.approx((stiffness * square).sum(), rel=1e-9)
    modes = pm.frictional_modes(rough)
    assert modes.residual < 1e-10 and (modes.eigenvalue_m.real > -1e-9 * modes.largest).all()


def test_tangential_springs_of_bonds_stiffen_without_friction(rest):
    (law, bonds) = rest.effects
    stiff = rest.replace(effects=(law, dataclasses.replace(bonds, tangential_stiffness=0.5)))
    moduli = pm.elastic_moduli(stiff)
    found = pm.complex_modulus(stiff, [1e-6]).modulus_f[0].real
    assert moduli.shear_modulus == pytest.approx(found, rel=1e-6)
    assert moduli.shear_modulus > 1.1 * pm.elastic_moduli(rest).shear_modulus


@pytest.mark.parametrize("call", [pm.hessian, pm.normal_modes])
def test_tangential_springs_have_no_energy_and_are_refused_by_name(rest, call):
    (law, bonds) = rest.effects
    stiff = rest.replace(effects=(law, dataclasses.replace(bonds, tangential_stiffness=0.5)))
    # slack as a scene starts
    assert (pm.forces(stiff) == pm.forces(rest)).all() and pm.energy(stiff) == pm.energy(rest)
    with pytest.raises(
        ValueError, match=r"scene.effects\[1\] must have tangential_stiffness=0.0 here.* pm.complex_modulus"
    ):
        call(stiff)
