"""Derivatives of packings at rest are central differences of packings made anew, which share no code with them."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

import packmech as pm

# how much of the largest derivative the two may differ by, and how many entries are looked at
_ERROR, _FEW, _MANY = 1e-6, 3, 200


def at_rest(scene, tolerance=1e-14):
    """Return the scene with its packing brought to rest by Newton's method, as far as rounding allows."""
    return scene.replace(packing=pm.quench(scene, force_tolerance=tolerance, method=pm.Newton()).packing)


@functools.cache
def scene_of(kind):
    """Return a packing at rest of one kind."""
    law = pm.Hertz()
    if kind in ("discs", "bonds", "kinds"):
        start = pm.random_packing(30, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
        law = pm.Harmonic()
    elif kind == "powers":
        start = pm.random_packing(30, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=1)
        law = pm.PowerLaw(energy_scale=1.3, exponent=2.2)
    elif kind == "spheres":
        start = pm.random_packing(40, dimension=3, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.75, seed=1)
    elif kind == "elastic spheres":
        start = pm.random_packing(32, dimension=3, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=2)
        law = pm.ElasticSpheres(2.0)
    elif kind == "ellipses":
        start = pm.random_packing(24, dimension=2, shapes=pm.Ellipses(aspect=1.5), packing_fraction=0.95, seed=1)
    elif kind == "spheroids":
        start = pm.random_packing(30, dimension=3, shapes=pm.Ellipses(aspect=1.5), packing_fraction=0.8, seed=1)
    elif kind == "superellipses":
        shapes = pm.Superellipses(exponent=3.0, ratios=(1.0, 1.3))
        start = pm.random_packing(24, dimension=2, shapes=shapes, packing_fraction=0.95, seed=1)
    elif kind == "superellipsoids":
        shapes = pm.Superellipses(exponent=3.0, ratios=(1.0, 1.2, 1.4))
        start = pm.random_packing(20, dimension=3, shapes=shapes, packing_fraction=0.85, seed=1)
    elif kind == "bodies":
        start = pm.rigid_packing(pm.cluster_packing(12, pm.Dimer(), dimension=2, packing_fraction=0.95, seed=1))
    else:
        start = pm.cluster_packing(10, pm.Trimer(), dimension=2, packing_fraction=0.95, seed=1)
    found = pm.Scene(start, (pm.Repulsion(law=law),))
    found = at_rest(found.replace(packing=pm.quench(found, force_tolerance=1e-13).packing))
    if kind == "bonds":
        bonds = pm.bond_contacts(
            found.packing, tangential_stiffness=0.0, gap_tolerance=0.05,
            compression=pm.Harmonic(0.5), tension=pm.LinearSpring(0.3),
        )  # fmt: skip
        found = at_rest(found.replace(effects=(*found.effects, bonds.select(np.arange(len(bonds)) % 3 > 0))))
    if kind == "kinds":
        # each particle is of a kind of its own, so that a law can be that of one contact
        count = found.packing.particles
        same = pm.LawByKind([[pm.Harmonic(1.0)] * count] * count)
        found = pm.Scene(found.packing.replace(kind_n=range(count)), (pm.Repulsion(law=same),))
    return found


def figure(scene, of, mode=2):
    """Return a figure by the call that measures it."""
    if of in ("energy", "pressure"):
        return getattr(pm, of)(scene)
    if of == "frequency":
        return pm.normal_modes(scene, mode + 2).frequency_m[mode]
    if len(of) == 2:
        return pm.stress_tensor(scene)["xyz".index(of[0]), "xyz".index(of[1])]
    moduli = pm.elastic_moduli(scene)
    if len(of) == 4:
        return moduli.component(of)
    return moduli.hill.young_modulus if of == "young_modulus" else getattr(moduli, of)


def changed_array(array, k, change):
    found = np.array(array)
    found[k] += change
    return found


def changed(scene, to, k, change):
    """Return the scene with one number changed, before it comes to rest again."""
    packing = scene.packing
    if to == "radius":
        return scene.replace(packing=packing.replace(radius_n=changed_array(packing.radius_n, k, change)))
    if to == "mass":
        return scene.replace(packing=packing.replace(mass_n=changed_array(packing.mass_n, k, change)))
    if to in ("aspect", "exponent"):
        array = changed_array(getattr(packing.shapes, f"{to}_n"), k, change)
        return scene.replace(packing=packing.replace(shapes=replace(packing.shapes, **{f"{to}_n": array})))
    if to == "applied_strain":
        strain = np.zeros((packing.dimension, packing.dimension))
        a, b = np.unravel_index(k, strain.shape)
        strain[a, b] += change
        change_dd = np.eye(packing.dimension) + strain
        box = pm.Box(change_dd @ packing.box.lattice_dd)
        return scene.replace(packing=packing.replace(position_nd=packing.position_nd @ change_dd.T, box=box))
    if to == "rest_length":
        repulsion, bonds = scene.effects
        rest = changed_array(bonds.rest_length_b, k, change)
        return scene.replace(effects=(repulsion, replace(bonds, rest_length_b=rest)))
    if to == "link_length":
        links = packing.links
        links = pm.Links(links.i_l, links.j_l, links.image_ld, changed_array(links.length_l, k, change))
        moved = pm.Packing(packing.position_nd, packing.radius_n, packing.box, links=links)
        return scene.replace(packing=pm.reaffix_links(moved).packing)
    law = scene.effects[0].law
    if to == "law":
        return scene.replace(effects=(pm.Repulsion(law=type(law)(*changed_array(list(law), k, change))),))
    assert to == "contact_stiffness"
    contacts, count = pm.find_contacts(packing), packing.particles
    pair = {int(contacts.i_c[k]), int(contacts.j_c[k])}
    laws = [[pm.Harmonic(1.0 + change * ({a, b} == pair)) for a in range(count)] for b in range(count)]
    return scene.replace(effects=(pm.Repulsion(law=pm.LawByKind(laws)),))


def central(scene, of, to, k, step):
    """Return the central difference of fourth order of a figure of packings made anew."""
    back, near, there, far = (
        figure(at_rest(changed(scene, to, k, steps * step)), of) for steps in (-2.0, -1.0, 1.0, 2.0)
    )
    return (8.0 * (there - near) - (far - back)) / (12.0 * step)


# the kind of packing, the numbers, and the figures
_CASES = {
    "discs": (("radius", "applied_strain"), ("energy", "pressure", "xy", "bulk_modulus", "poisson_ratio", "frequency")),
    "kinds": (("contact_stiffness",), ("pressure", "shear_modulus", "frequency")),
    "powers": (("law", "radius"), ("energy", "pressure", "shear_modulus", "xyxy", "frequency")),
    "spheres": (("radius", "applied_strain"), ("pressure", "bulk_modulus", "shear_modulus", "frequency")),
    "elastic spheres": (("radius", "law"), ("shear_modulus",)),
    "bonds": (("radius", "rest_length", "applied_strain"), ("energy", "bulk_modulus", "young_modulus", "frequency")),
    "links": (("radius", "link_length"), ("energy", "pressure", "shear_modulus", "frequency")),
    "ellipses": (("radius", "aspect", "applied_strain"), ("pressure", "shear_modulus", "frequency")),
    "spheroids": (("radius", "aspect"), ("bulk_modulus", "frequency")),
    "superellipses": (("radius", "exponent"), ("shear_modulus", "frequency")),
    "superellipsoids": (("radius", "exponent"), ("shear_modulus", "frequency")),
    "bodies": (("radius",), ("energy", "bulk_modulus", "frequency")),
}
_EACH = [(kind, to, of) for kind, (numbers, figures) in _CASES.items() for to in numbers for of in figures]


def entries_of(gradient, count):
    """Return the places of some of the derivatives, spread over all."""
    return np.unique(np.linspace(0, gradient.size - 1, min(count, gradient.size)).astype(int))


def compare(kind, to, of, count):
    scene = scene_of(kind)
    found = pm.sensitivity(scene, of, to, mode=2)
    assert found.value == pytest.approx(figure(scene, of), rel=1e-12)
    largest = np.abs(found.gradient).max()
    for k in entries_of(found.gradient, count):
        expected = central(scene, of, to, int(k), 1e-6)
        assert abs(found.gradient.ravel()[k] - expected) <= _ERROR * largest, (kind, to, of, k)
    assert found.residual < 1e-10 and found.difference_error < 1e-6


@pytest.mark.parametrize(("kind", "to", "of"), _EACH)
def test_derivatives_are_central_differences_of_packings_made_anew(kind, to, of):
    compare(kind, to, of, _FEW)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "to", "of"), _EACH)
def test_all_derivatives_are_central_differences_of_packings_made_anew(kind, to, of):
    compare(kind, to, of, _MANY)


@pytest.mark.parametrize("kind", ["discs", "spheres", "ellipses"])
@pytest.mark.parametrize("of", ["shear_modulus", "xyxy", "xxyy", "xy"])
def test_simple_shears_turn_what_components_name(kind, of):
    scene = scene_of(kind)
    d = scene.packing.dimension
    found, step = pm.sensitivity(scene, of, "applied_strain"), 1e-6
    # the shear of Lees and Edwards, which strains and turns, and a turn alone, which no scalar knows of
    for strain in (np.eye(d, k=1) * (np.arange(d) == 1), np.eye(d, k=1) - np.eye(d, k=-1)):

        def at(steps, strain=strain):
            packing, change = scene.packing, np.eye(d) + steps * step * strain
            box = pm.Box(change @ packing.box.lattice_dd)
            moved = packing.replace(position_nd=packing.position_nd @ change.T, box=box)
            return figure(at_rest(scene.replace(packing=moved)), of)

        expected = (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * step)
        assert abs((found.gradient * strain).sum() - expected) <= _ERROR * np.abs(found.gradient).max()


def test_no_scalar_changes_as_a_packing_turns():
    scene = scene_of("discs")
    for of in ("energy", "pressure", "bulk_modulus", "young_modulus", "frequency"):
        gradient = pm.sensitivity(scene, of, "applied_strain", mode=2).gradient
        np.testing.assert_allclose(gradient, gradient.T, rtol=0.0, atol=1e-9 * np.abs(gradient).max())


def test_the_margin_is_that_of_pairs_that_repel_and_no_bond_joins():
    scene = scene_of("discs")
    packing, margin = scene.packing, pm.sensitivity(scene, "pressure", "radius").margin
    near = pm.find_contacts(packing, gap_tolerance=0.05)
    kept = ~pm.find_rattlers(packing)
    apart = np.where(kept[near.i_c] & kept[near.j_c], np.abs(near.overlap_c), np.inf)
    k, second = np.argsort(apart)[:2]
    assert margin == pytest.approx(apart[k], rel=1e-12)
    # a bond in place of the nearest pair that pushes with the same force, so that all stays at rest
    assert near.overlap_c[k] > 0.0
    bond = pm.Bonds(
        [near.i_c[k]], [near.j_c[k]], [near.image_cd[k]], [near.contact_distance_c[k]], tangential_stiffness=0.0,
        compression=pm.Harmonic(),
    )  # fmt: skip
    bonded = scene.replace(effects=(*scene.effects, bond))
    assert pm.sensitivity(bonded, "pressure", "radius").margin == pytest.approx(apart[second], rel=1e-12)


def test_frequencies_by_masses():
    scene = scene_of("discs")
    found = pm.sensitivity(scene, "frequency", "mass", mode=2)
    for k in (0, 7):
        expected = central(scene, "frequency", "mass", k, 2e-3)
        assert found.gradient[k] == pytest.approx(expected, rel=1e-8)
    # twice the mass is a frequency lower by the square root of two: homogeneous of degree -1/2
    assert found.gradient @ scene.packing.mass_n == pytest.approx(-0.5 * found.value, rel=1e-10)


def test_moduli_and_pressure_are_homogeneous_in_the_stiffness_of_contacts_and_the_energy_scale():
    scene = scene_of("discs")
    for of in ("energy", "pressure", "bulk_modulus", "shear_modulus", "xyxy"):
        by_contacts = pm.sensitivity(scene, of, "contact_stiffness")
        assert by_contacts.gradient.sum() == pytest.approx(by_contacts.value, rel=1e-10)
        by_law = pm.sensitivity(scene, of, "law")
        assert by_law.names == ("law.energy_scale",)
        assert by_law.gradient[0] == pytest.approx(by_law.value, rel=1e-10)
    assert pm.sensitivity(scene, "poisson_ratio", "contact_stiffness").gradient.sum() == pytest.approx(0.0, abs=1e-10)


def test_an_isotropic_strain_changes_the_pressure_by_the_bulk_modulus_and_radii_by_scale():
    scene = scene_of("discs")
    by_strain = pm.sensitivity(scene, "pressure", "applied_strain")
    bulk = pm.elastic_moduli(scene).bulk_modulus
    # dP = - K dV / V
    assert np.trace(by_strain.gradient) == pytest.approx(-2.0 * bulk, rel=1e-10)
    # energies that depend on the relative overlap alone do not know the unit of length: E(a r, a L) = E(r, L)
    by_radius = pm.sensitivity(scene, "energy", "radius").gradient @ scene.packing.radius_n
    assert by_radius == pytest.approx(-np.trace(pm.sensitivity(scene, "energy", "applied_strain").gradient), rel=1e-10)


def test_the_stress_changes_by_the_cauchy_tangent():
    scene = scene_of("spheres")
    moduli, names = pm.elastic_moduli(scene), ("xx", "yy", "zz", "yz", "xz", "xy")
    for of in names:
        gradient = pm.sensitivity(scene, of, "applied_strain").gradient
        # strains without rotation
        gradient = 0.5 * (gradient + gradient.T)
        for a, b in names:
            expected = moduli.component(of + a + b)
            assert gradient["xyz".index(a), "xyz".index(b)] == pytest.approx(expected, abs=1e-9 * moduli.bulk_modulus)


def test_bonds_of_a_network_add_what_they_strain():
    """Of slack springs at rest dC/dk is the energy that each holds under the relaxed strain: positions do not move."""
    packing = scene_of("discs").packing
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.0, rest="distance")
    # points that nothing but bonds holds
    scene = pm.Scene(packing.replace(radius_n=0.1 * packing.radius_n), (pm.Repulsion(law=pm.Harmonic()), bonds))
    found = pm.sensitivity(scene, "bulk_modulus", "bond_stiffness")
    assert found.gradient.sum() == pytest.approx(found.value, rel=1e-10) and (found.gradient >= 0.0).all()
    # the relaxed energy is the least of functions linear in each stiffness: without a bond it falls by more than that
    worst = int(np.argmin(found.gradient))
    less = scene.replace(effects=(scene.effects[0], bonds.select(np.arange(len(bonds)) != worst)))
    assert found.value - pm.elastic_moduli(less).bulk_modulus >= found.gradient[worst] * (1.0 - 1e-9)


def test_the_cost_does_not_grow_with_the_number_of_derivatives():
    solves = set()
    for count in (24, 96):
        start = pm.random_packing(count, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=1)
        scene = pm.Scene(start, (pm.Repulsion(),))
        scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-12).packing)
        solves.add(pm.sensitivity(scene, "shear_modulus", "radius").solves)
        assert pm.sensitivity(scene, "energy", "radius").solves == 0
        assert pm.sensitivity(scene, "pressure", "radius").solves == 1
    assert solves == {4}


@functools.cache
def hard(strain):
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=3)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(law=pm.Harmonic()),)), pressure=1e-7, strain=strain)
    return run.report["hard_packing"]


def vertex(packing, strain):
    """Return the packing fraction at which the same contacts just touch again, by Newton's method on their gaps."""
    contacts = pm.find_contacts(hard(strain), gap_tolerance=1e-9)
    for _ in range(8):
        gap = contacts.at(packing).gap_c
        rows = pm.rigidity_matrix(packing, strain="free", contacts=contacts.at(packing)).toarray()
        d, size = packing.dimension, packing.position_nd.size
        if strain == "isotropic":
            rows = np.column_stack([rows[:, :size], rows[:, size : size + d].sum(axis=1)])
        move = np.linalg.lstsq(rows, -gap, rcond=1e-12)[0]
        stretch = move[size] * np.eye(d) if strain == "isotropic" else pm.mandel_tensor(move[size:])
        change = np.eye(d) + stretch
        place = (packing.position_nd + move[:size].reshape(-1, d)) @ change.T
        packing = packing.replace(position_nd=place, box=pm.Box(change @ packing.box.lattice_dd))
    assert np.abs(contacts.at(packing).gap_c).max() < 1e-14
    return pm.packing_fraction(packing)


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_packing_fractions_of_hard_packings_by_radii_are_those_of_contacts_closed_again(strain):
    packing = hard(strain)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    found = pm.sensitivity(scene, "packing_fraction", "radius")
    assert found.value == pm.packing_fraction(packing) and found.solves == 0
    for k in range(packing.particles):
        ends = [vertex(packing.replace(radius_n=changed_array(packing.radius_n, k, h)), strain) for h in (1e-6, -1e-6)]
        assert found.gradient[k] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-8)
    # larger particles in a larger box are the same packing
    assert found.gradient @ packing.radius_n == pytest.approx(0.0, abs=1e-10)


def closed_again(packing, contacts, length_l, radius_n):
    """Return the packing whose contacts just touch with other radii and links, in a box that keeps its shape."""
    links, lattice, place = packing.links, packing.box.lattice_dd, packing.position_nd
    i, j = np.concatenate([contacts.i_c, links.i_l]), np.concatenate([contacts.j_c, links.j_l])
    image = np.concatenate([contacts.image_cd, links.image_ld])
    wanted = np.concatenate([radius_n[contacts.i_c] + radius_n[contacts.j_c], length_l])
    for _ in range(10):
        vector = place[j] - place[i] + image @ lattice.T
        size = np.sqrt((vector**2).sum(axis=1))
        rows, row = np.zeros((len(i), place.size + 1)), np.arange(len(i))
        for a in range(2):
            np.add.at(rows, (row, 2 * j + a), vector[:, a] / size)
            np.add.at(rows, (row, 2 * i + a), -vector[:, a] / size)
        rows[:, -1] = size
        move = np.linalg.lstsq(rows, wanted - size, rcond=1e-12)[0]
        place, lattice = (place + move[:-1].reshape(-1, 2)) * (1.0 + move[-1]), lattice * (1.0 + move[-1])
    assert np.abs(size - wanted).max() < 1e-13
    return pm.Packing(place, radius_n, pm.Box(lattice), pm.Links(links.i_l, links.j_l, links.image_ld, length_l))


def test_packing_fractions_of_hard_dimers_by_link_lengths_and_radii_are_those_of_contacts_closed_again():
    start = pm.cluster_packing(12, pm.Dimer(1.1), dimension=2, packing_fraction=0.6, seed=3)
    soft = pm.jam(pm.Scene(start, (pm.Repulsion(law=pm.Harmonic()),)), pressure=1e-8, strain="isotropic").packing
    contacts, length, radius = pm.find_contacts(soft), soft.links.length_l, soft.radius_n
    packing, step = closed_again(soft, contacts, length, radius), 1e-6
    scene = pm.Scene(packing, (pm.Repulsion(),))
    for to, count in (("link_length", 12), ("radius", 24)):
        found = pm.sensitivity(scene, "packing_fraction", to)
        for k in range(0, count, 3):
            ends = []
            for change in (step, -step):
                one = [length, changed_array(radius, k, change)]
                if to == "link_length":
                    one = [changed_array(length, k, change), radius]
                ends.append(pm.packing_fraction(closed_again(packing, contacts, *one)))
            assert found.gradient[k] == pytest.approx((ends[0] - ends[1]) / (2.0 * step), abs=1e-8)


def test_packing_fractions_of_fused_and_bonded_particles_are_refused_by_name():
    fused = pm.cluster_packing(12, pm.Dimer(0.8), dimension=2, packing_fraction=0.6, seed=3)
    for to in ("radius", "link_length"):
        with pytest.raises(ValueError, match=r"scene.packing must have no fused particles, .* share a volume of"):
            pm.sensitivity(pm.Scene(fused, (pm.Repulsion(),)), "packing_fraction", to)
    bond = pm.Bonds([0], [1], [[0, 0]], [2.0], tangential_stiffness=0.0)
    with pytest.raises(ValueError, match=r"scene must hold no bonds for of='packing_fraction'.*without\(pm.Bonds\)"):
        pm.sensitivity(pm.Scene(hard("isotropic"), (pm.Repulsion(), bond)), "packing_fraction", "radius")


def test_derivatives_where_a_contact_opens_are_those_of_the_side_where_it_is_one():
    """A change of radii at which contacts change, by bisection: the derivative by radii jumps there."""
    scene = scene_of("discs")
    radius = scene.packing.radius_n
    pattern = np.linspace(-1.0, 1.0, len(radius))

    @functools.cache
    def relaxed(change):
        there = scene.replace(packing=scene.packing.replace(radius_n=radius * (1.0 + change * pattern)))
        there = there.replace(packing=pm.quench(there, force_tolerance=1e-13).packing)
        return there, len(pm.find_contacts(there.packing))

    def slope(change, **how):
        return pm.sensitivity(relaxed(change)[0], "pressure", "radius", **how).gradient

    low, high = 0.0, 1e-3
    while relaxed(high)[1] == relaxed(0.0)[1]:
        low, high = high, high + 1e-3
    while high - low > 1e-11:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if relaxed(middle)[1] == relaxed(0.0)[1] else (low, middle)
    closed, outward = (low, -1.0) if relaxed(low)[1] > relaxed(high)[1] else (high, 1.0)
    with pytest.raises(ValueError, match="must have contacts that overlap by more than 1e-09.*ask for one_sided ones"):
        slope(closed)
    found, size = slope(closed, one_sided=True), np.abs(slope(0.0)).max()
    # continuous on the side where the contact is one, in proportion to the distance; on the other they jump
    for far in (1e-5, 1e-6):
        assert np.abs(found - slope(closed + outward * far)).max() < 100.0 * far * size
    assert np.abs(found - slope(closed - outward * 1e-6)).max() > 1e-2 * size


@pytest.mark.parametrize("overlap", [9e-10, 1e-10, 1e-11])
def test_derivatives_of_one_side_are_as_good_as_they_say(overlap):
    """Of discs in a triangle in a fixed box pressure and bulk modulus by all radii have a closed form."""
    crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=overlap)
    scene = pm.Scene(crystal, (pm.Repulsion(law=pm.Harmonic()),))
    # in units of the diameter at contact: P = sqrt(3) overlap, so that dP/d(ln radius) = sqrt(3), B = sqrt(3)/2
    found = {of: pm.sensitivity(scene, of, "radius", one_sided=True) for of in ("pressure", "bulk_modulus")}
    for of, slope in (("pressure", 2.0 * math.sqrt(3.0)), ("bulk_modulus", -math.sqrt(3.0))):
        assert abs(found[of].gradient.sum() / slope - 1.0) < max(found[of].difference_error, 1e-9)


def test_what_has_no_derivative_is_refused_by_name():
    for overlap in (1e-13, 0.0):
        bare = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=overlap)
        with pytest.raises(ValueError, match="must have contacts that overlap by more than 1e-12"):
            pm.sensitivity(pm.Scene(bare, (pm.Repulsion(),)), "pressure", "radius", one_sided=True)
    crystal = pm.lattice_packing("triangular", repeats=(4, 4))
    touching = pm.Scene(crystal, (pm.Repulsion(),))
    with pytest.raises(ValueError, match=r"scene.packing must have contacts that overlap by more than 1e-09"):
        pm.sensitivity(touching, "shear_modulus", "radius")
    with pytest.raises(ValueError, match="must have one state of self stress"):
        pm.sensitivity(touching, "packing_fraction", "radius")
    pressed = pm.Scene(pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01), (pm.Repulsion(),))
    with pytest.raises(ValueError, match="mode must be one whose frequency no other has"):
        pm.sensitivity(pressed, "frequency", "radius")
    moved = pressed.packing.position_nd + np.random.default_rng(1).normal(size=(16, 2)) * 1e-3
    with pytest.raises(ValueError, match="scene must be at rest"):
        pm.sensitivity(pressed.replace(packing=pressed.packing.replace(position_nd=moved)), "pressure", "radius")
    with pytest.raises(ValueError, match=r"to must be a number that the scene has, got 'aspect' of one without Sphero"):
        pm.sensitivity(pressed, "pressure", "aspect")
    with pytest.raises(ValueError, match="to must not be 'mass'"):
        pm.sensitivity(pressed, "pressure", "mass")
    with pytest.raises(ValueError, match="of must be energy, pressure"):
        pm.sensitivity(pressed, "volume", "radius")
