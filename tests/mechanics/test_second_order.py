"""Facts about rigidity to second order: frameworks with known answers, discs, and ellipses by their quartic modes."""

import numpy as np
import pytest

import packmech as pm
from packmech.mechanics.system import system_of


def framework(place, bars, held=(), *, kind="bonds", size=40.0):
    """Return points in a wide box joined by bars, at their lengths."""
    place = np.array(place, dtype=float) + 0.3 * size
    i, j = np.array(bars).T
    length, image = np.linalg.norm(place[i] - place[j], axis=1), np.zeros((len(i), place.shape[1]), dtype=int)
    links = pm.Links(i, j, image, length) if kind == "links" else None
    packing = pm.Packing(place, np.full(len(place), 1e-3), pm.Box.cubic(size, place.shape[1]), links)
    effects = () if links else (pm.Bonds(i, j, image, length, tangential_stiffness=0.0),)
    return pm.Scene(packing, (*effects, *([pm.FixedParticles(tuple(held))] if held else [])))


def bonded(kind, repeats):
    """Return the bonds of a crystal that touches, without its contacts."""
    packing = pm.lattice_packing(kind, repeats=repeats)
    return pm.Scene(packing, (pm.bond_contacts(packing, tangential_stiffness=0.0),))


def answers(found):
    return found.first_order_rigid, found.prestress_stable, found.second_order_rigid


def stretched(scene, found, amplitude):
    """Return the changes of the members' lengths along the flex x + s q' + s^2 q''/2."""
    moved = pm.displaced(scene.packing, amplitude * found.first_nq + 0.5 * amplitude**2 * found.second_nq).position_nd
    i, j, box = found.i_e, found.j_e, scene.packing.box
    before = scene.packing.position_nd[j] - scene.packing.position_nd[i]
    image = -np.rint(before @ np.linalg.inv(box.lattice_dd).T) @ box.lattice_dd.T
    change = moved - scene.packing.position_nd
    after = before + image + change[j] - change[i]
    return np.linalg.norm(after, axis=1) - np.linalg.norm(before + image, axis=1)


def extends(scene, found):
    """Return whether all lengths of bars change by the third power of the amplitude, and contacts do not close."""
    contacts, one, other = found.contacts, stretched(scene, found, 1e-2), stretched(scene, found, 1e-3)
    bars = np.abs(one[contacts:]).max(initial=0.0), np.abs(other[contacts:]).max(initial=0.0)
    return max(bars) < 2e-5 and bars[1] < 2e-3 * bars[0] + 1e-13 and other[:contacts].min(initial=0.0) > -1e-8


@pytest.mark.parametrize("kind", ["bonds", "links"])
@pytest.mark.parametrize("one, other", [(1.0, 1.0), (0.7, 2.3)])
def test_a_joint_on_a_line_between_held_ends_is_held_by_a_pull(kind, one, other):
    scene = framework([[0, 0], [one, 0], [one + other, 0]], [(0, 1), (1, 2)], (0, 2), kind=kind)
    found = pm.second_order(scene)
    assert answers(found) == ("no", "yes", "yes")
    assert (found.floppy_modes, found.self_stresses, found.trivial) == (1, 1, 0)
    # pulls 1/sqrt(2) across a displacement y: y^2 / sqrt(2) (1/a + 1/b)
    assert abs(found.smallest_curvature - np.sqrt(0.5) * (1.0 / one + 1.0 / other)) < 1e-12
    assert np.abs(found.stress_e + np.sqrt(0.5)).max() < 1e-12
    assert found.curvature_error < 1e-9


def test_in_space_a_joint_on_a_line_has_two_floppy_modes_with_the_same_curvature():
    found = pm.second_order(framework([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1), (1, 2)], (0, 2)))
    assert answers(found) == ("no", "yes", "yes") and found.floppy_modes == 2
    assert abs(found.smallest_curvature - np.sqrt(2.0)) < 1e-12


def test_a_flat_triangle_is_prestress_stable_and_its_turns_are_trivial():
    found = pm.second_order(framework([[0, 0], [1, 0], [2, 0]], [(0, 1), (1, 2), (0, 2)]))
    assert answers(found) == ("no", "yes", "yes")
    assert (found.floppy_modes, found.trivial) == (1, 3)
    in_space = pm.second_order(framework([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [(0, 1), (1, 2), (0, 2)]))
    # a row in space has two rotations
    assert (in_space.floppy_modes, in_space.trivial) == (2, 5) and answers(in_space) == ("no", "yes", "yes")


@pytest.mark.parametrize("kind", ["bonds", "links"])
def test_a_square_of_bars_has_a_flex(kind):
    scene = framework([[0, 0], [1, 0], [1, 1], [0, 1]], [(0, 1), (1, 2), (2, 3), (3, 0)], kind=kind)
    found = pm.second_order(scene)
    assert answers(found) == ("no", "no", "no")
    assert (found.floppy_modes, found.self_stresses, found.trivial) == (1, 0, 3)
    assert found.flex_error < 1e-12 and extends(scene, found)


def test_a_square_with_a_diagonal_is_rigid_to_first_order():
    bars = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)]
    found = pm.second_order(framework([[0, 0], [1, 0], [1, 1], [0, 1]], bars))
    assert answers(found) == ("yes", "yes", "yes") and found.stress_e is None and found.first_nq is None


TRIANGLE = np.array([[np.cos(a), np.sin(a)] for a in (0.3, 2.2, 4.4)])
PRISM = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]


def test_a_prism_in_perspective_from_a_point_is_held_and_one_with_parallel_equal_bars_moves():
    seen = framework(np.vstack([TRIANGLE, 2.5 * TRIANGLE]), PRISM)
    found = pm.second_order(seen)
    assert (found.floppy_modes, found.self_stresses) == (1, 1) and answers(found) == ("no", "yes", "yes")
    parallel = framework(np.vstack([TRIANGLE, TRIANGLE + [0.4, 3.0]]), PRISM)
    found = pm.second_order(parallel)
    assert (found.floppy_modes, found.self_stresses) == (1, 1) and answers(found) == ("no", "no", "no")
    assert extends(parallel, found)


def test_six_joints_each_of_three_with_three_are_held_on_a_circle_and_move_on_two_perpendicular_lines():
    """K(3,3) is flexible to first order with its joints on a conic, and moves on two perpendicular lines (Dixon)."""
    bars = [(i, j) for i in range(3) for j in range(3, 6)]
    angle = np.array([0.1, 1.9, 4.0, 0.9, 3.0, 5.5])
    found = pm.second_order(framework(np.column_stack([np.cos(angle), np.sin(angle)]), bars))
    assert (found.floppy_modes, found.self_stresses) == (1, 1) and answers(found) == ("no", "yes", "yes")
    lines = framework([[1.0, 0], [2.3, 0], [-1.6, 0], [0, 1.2], [0, -2.0], [0, 2.9]], bars)
    found = pm.second_order(lines)
    assert (found.floppy_modes, found.self_stresses) == (1, 1) and answers(found) == ("no", "no", "no")
    assert extends(lines, found)


# two joints whose heights are free, and a third that is held at its height by a bar out of the plane
FLAT = [(0, 1), (0, 2), (1, 2), (0, 3), (0, 4), (1, 5), (1, 6), (2, 7)]


def flat_forms(place):
    """Return the forms of the heights of joints 0 and 1 by both states of self stress of the plane, written out."""
    rows = np.zeros((len(FLAT), 6))
    for k, (i, j) in enumerate(FLAT):
        along = (place[j] - place[i]) / np.linalg.norm(place[j] - place[i])
        for joint, side in ((i, -1.0), (j, 1.0)):
            if joint < 3:
                rows[k, 2 * joint : 2 * joint + 2] = side * along
    forms = []
    for one in np.linalg.svd(rows.T)[2][6:]:
        height = np.array([[float(i == n) - float(j == n) for n in range(2)] for i, j in FLAT])
        length = np.array([np.linalg.norm(place[j] - place[i]) for i, j in FLAT])
        forms.append(-(height.T * (one / length)) @ height)
    return forms


def test_two_flat_joints_may_be_rigid_to_second_order_and_not_prestress_stable():
    """Two forms leave one direction X of the 2 x 2 forms: is it definite none of theirs is, else one of theirs is.

    Where X = q q^T neither state holds q; elsewhere each q has a state that does.
    """
    seen = []
    for seed in range(12):
        place = np.random.default_rng(seed).uniform(-3.0, 3.0, size=(8, 2))
        one, other = (np.array([form[0, 0], form[1, 1], 2.0 * form[0, 1]]) for form in flat_forms(place))
        xx, yy, xy = np.cross(one, other) / np.linalg.norm(np.cross(one, other))
        determinant = xx * yy - xy**2
        if abs(determinant) < 0.03:
            continue
        points = np.vstack([np.column_stack([place, np.zeros(8)]), [1.0, 2.0, 4.0]])
        found = pm.second_order(framework(points, [*FLAT, (2, 8)], range(3, 9)))
        assert (found.floppy_modes, found.self_stresses) == (2, 2)
        assert answers(found) == (("no", "no", "yes") if determinant > 0.0 else ("no", "yes", "yes")), seed
        assert found.first_nq is None
        seen.append(found.prestress_stable)
    assert {"yes", "no"} == set(seen)


@pytest.mark.parametrize("kind", ["square", "kagome"])
def test_crystals_of_bars_are_held_by_pulls_and_those_of_discs_move(kind):
    scene = bonded(kind, (3, 3))
    bars, discs = pm.second_order(scene), pm.second_order(scene.packing)
    assert answers(bars) == ("no", "yes", "yes") and bars.bonds == discs.contacts
    assert answers(discs) == ("no", "no", "no")
    assert bars.floppy_modes == pm.floppy_modes(scene.packing).count
    assert bars.self_stresses == pm.states_of_self_stress(scene.packing).count
    assert discs.flex_error < 1e-12 and extends(scene.replace(effects=()), discs)
    assert discs.idle_contacts == 0


def test_beyond_the_limit_of_the_program_equal_pulls_hold_a_kagome_lattice():
    scene = bonded("kagome", (6, 6))
    found = pm.second_order(scene, size_limit=3)
    assert answers(found) == ("no", "yes", "yes") and np.isnan(found.largest_curvature)
    assert np.abs(found.stress_e - found.stress_e.mean()).max() < 1e-12
    # equal pulls t along bars of length 1: t times the smallest eigenvalue of the squared transverse differences
    i, j = found.i_e, found.j_e
    packing = scene.packing
    apart = packing.position_nd[j] - packing.position_nd[i]
    apart -= np.rint(apart @ np.linalg.inv(packing.box.lattice_dd).T) @ packing.box.lattice_dd.T
    length = np.linalg.norm(apart, axis=1)
    along, across = np.zeros((2, len(i), 2 * packing.particles))
    for c, (n, size) in enumerate(zip(apart / length[:, None], length, strict=True)):
        for row, vector in ((along, n), (across, np.array([-n[1], n[0]]) / np.sqrt(size))):
            row[c, 2 * i[c] : 2 * i[c] + 2], row[c, 2 * j[c] : 2 * j[c] + 2] = -vector, vector
    _, value, right = np.linalg.svd(along)
    floppy = right[np.count_nonzero(value > 1e-9) :]
    curvature = np.linalg.eigvalsh(floppy @ across.T @ across @ floppy.T)
    # two translations
    assert abs(curvature[1]) < 1e-12
    assert abs(found.smallest_curvature - curvature[2] / np.sqrt(len(i))) < 1e-10


def test_a_triangular_crystal_is_rigid_to_first_order_and_a_gas_is_not_rigid():
    assert answers(pm.second_order(pm.lattice_packing("triangular", repeats=(4, 4)))) == ("yes", "yes", "yes")
    gas = pm.second_order(pm.random_packing(10, dimension=2, packing_fraction=0.1, seed=1))
    assert answers(gas) == ("no", "no", "no") and gas.rattlers == 10


def test_contacts_that_nothing_pushes_are_idle_and_open():
    """A row of discs around the box bears pushes along it; one that a bond hangs on it touches a second without any."""
    row = [[0.5, 1.0], [1.5, 1.0], [2.5, 1.0]]
    packing = pm.Packing([*row, [1.0, 1.0 + np.sqrt(0.75)]], [0.5] * 4, pm.Box([[3.0, 0.0], [0.0, 6.0]]))
    held = pm.Bonds([0], [3], [[0, 0]], [1.0], tangential_stiffness=0.0)
    found = pm.second_order(pm.Scene(packing, (held, pm.FixedParticles((0, 1, 2)))))
    assert (found.contacts, found.idle_contacts, found.bonds) == (1, 1, 1)
    assert answers(found) == ("no", "no", "no")
    # it turns away from the disc that it touches
    assert found.first_nq[3, 0] * np.sqrt(0.75) - found.first_nq[3, 1] * 0.5 < 0.0


def test_what_leaves_an_idle_contact_as_it_is_to_first_order_opens_it_to_second():
    """A disc swings below a bead and rises to a joint of two bars in a row, which pull at each other and not at it.

    Beads at 0.2 and 0.8 above the disc: a swing u shortens the gap to the joint by (1/0.2 - 1/0.8) u^2 / 2, and the
    joint rises as much: its bars keep their lengths but for the fourth power of u.
    """
    place = np.array([[0.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [0.0, -0.8], [0.0, -0.6]]) + 3.0
    packing = pm.Packing(place, [0.3, 0.05, 0.05, 0.5, 0.05], pm.Box.cubic(8.0, 2))
    bars = pm.Bonds([1, 0, 3], [0, 2, 4], [[0, 0]] * 3, [1.0, 1.0, 0.2], tangential_stiffness=0.0)
    scene = pm.Scene(packing, (bars, pm.FixedParticles((1, 2, 4))))
    found = pm.second_order(scene)
    assert (found.contacts, found.idle_contacts, found.floppy_modes, found.self_stresses) == (1, 1, 2, 1)
    assert answers(found) == ("no", "no", "no") and found.flex_error < 1e-12
    assert extends(scene, found)
    swing, rise = found.first_nq[3, 0], found.second_nq[0, 1] - found.second_nq[3, 1]
    # the distance is that of centers: (joint - disc)'' + u^2 / 0.8 = 0
    assert abs(swing) > 0.5 and abs(rise + swing**2 / 0.8) < 1e-12
    assert abs(found.second_nq[3, 1] - swing**2 / 0.2) < 1e-12


def test_contacts_of_a_hard_packing_all_open_to_first_order_in_a_free_box():
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.84, seed=3)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic")
    hard = run.report["hard_packing"]
    found = pm.second_order(hard, strain="free")
    assert answers(found) == ("no", "no", "no") and found.self_stresses == 0
    assert found.idle_contacts == found.contacts and found.flex_error < 1e-12
    lattice, position = hard.box.lattice_dd, hard.position_nd
    before = position[found.j_e] - position[found.i_e]
    before -= np.rint(before @ np.linalg.inv(lattice).T) @ lattice.T
    rate = before @ found.first_dd.T + found.first_nq[found.j_e] - found.first_nq[found.i_e]
    assert (np.einsum("cd,cd->c", rate, before) > 1e-4 * np.abs(rate).max()).all()


@pytest.mark.parametrize("drop", [1e-3, 1e-6, 1e-7, 1e-8])
def test_what_bars_hold_by_less_than_the_tolerance_is_ambiguous_and_never_moves(drop):
    """A joint hangs on two bars by a small drop, which two bars below it keep: their pull is 2 drop of that of theirs.

    Of size 1 the state is (1, 1, 2 drop, 2 drop) / sqrt(2): the bead in the row below moves against 2 pulls of
    2 drop / sqrt(2) over a length of 1.
    """
    place = [[-1, 0], [1, 0], [0, -drop], [0, -1 - drop], [0, -2 - drop]]
    scene = framework(place, [(0, 2), (1, 2), (2, 3), (3, 4)], (0, 1, 4))
    usual, fine, coarse = (pm.second_order(scene, tolerance=one) for one in (1e-7, 1e-10, 1e-2))
    assert answers(fine) == ("no", "yes", "yes")
    assert answers(usual) == ("no", *["yes" if drop > 1e-7 else "ambiguous"] * 2)
    assert answers(coarse) == ("no", "ambiguous", "ambiguous") and coarse.first_nq is None
    assert abs(fine.smallest_curvature / (2.0 * np.sqrt(2.0) * drop) - 1.0) < 1e-3 + 1e-13 / drop
    assert fine.curvature_error < fine.smallest_curvature


def test_particles_that_are_all_held_are_rigid_and_rattlers_beside_held_ones_are_not():
    pair = pm.Packing([[2.0, 2.0], [3.0, 2.0]], [0.5, 0.5], pm.Box.cubic(8.0, 2))
    both, one = (pm.second_order(pm.Scene(pair, (pm.FixedParticles(held),))) for held in ((0, 1), (0,)))
    assert answers(both) == ("yes", "yes", "yes") and (both.rattlers, both.trivial) == (0, 0)
    assert answers(one) == ("no", "no", "no") and (one.rattlers, one.trivial) == (1, 0)


def test_no_contact_pulls_in_the_most_definite_state_of_a_crystal_of_discs():
    crystal = pm.lattice_packing("square", repeats=(3, 3))
    for limit in (60, 1):
        found = pm.second_order(crystal, size_limit=limit)
        assert found.self_stresses == 6 and found.stress_e.min() >= -1e-16
        assert answers(found) == ("no", "no", "no") and found.smallest_curvature <= found.curvature_error


def jammed(strain="isotropic"):
    start = pm.random_packing(24, dimension=2, packing_fraction=0.6, seed=3, shapes=pm.Ellipses(1.6))
    scene = pm.Scene(start, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-5, strain=strain).packing)


@pytest.mark.parametrize("strain", ["none", "isochoric"])
def test_ellipses_are_held_by_pushes_as_their_quartic_modes_say(strain):
    scene = jammed("isotropic" if strain == "none" else "free")
    found, quartic = pm.second_order(scene, strain=strain), pm.quartic_modes(scene, strain=strain)
    assert answers(found) == ("no", "yes", "yes")
    assert found.floppy_modes == len(quartic) > 0 and found.self_stresses == 1
    # the forces of the law are that state of self stress
    force = np.linalg.norm(system_of(scene).terms.first_c)
    assert abs(found.smallest_curvature * force / quartic.curvature_m[0] - 1.0) < 1e-6
    assert (found.stress_e > 0.0).all() and found.idle_contacts == 0


def test_the_curvature_goes_as_one_over_the_length():
    bars = [(0, 1), (1, 2), (0, 2)]
    one, other = (pm.second_order(framework(np.array([[0, 0], [1, 0], [2, 0]]) * s, bars)) for s in (1.0, 3.0))
    assert abs(one.smallest_curvature / other.smallest_curvature - 3.0) < 1e-12


def test_equal_pulls_hold_a_square_lattice_by_the_wave_that_turns_its_bars_least():
    """Of 2 n^2 pulls of size 1 in all, each 1 / sqrt(2 n^2); rows slide by waves of 2 - 2 cos(2 pi / n)."""
    for n in (3, 5):
        found = pm.second_order(bonded("square", (n, n)))
        expected = (2.0 - 2.0 * np.cos(2.0 * np.pi / n)) / np.sqrt(2.0 * n**2)
        assert abs(found.smallest_curvature - expected) < 1e-8 and abs(found.largest_curvature - expected) < 1e-8


def test_a_square_lattice_of_bars_shears_in_a_free_box_and_not_at_fixed_volume():
    """Rhombi of the same sides have smaller areas, to second order; pulls hold the rest while the box stays."""
    scene = bonded("square", (3, 3))
    fixed, volume, free = (pm.second_order(scene, strain=strain) for strain in ("none", "isochoric", "free"))
    assert fixed.self_stresses == 6 and volume.self_stresses == 5 and free.self_stresses == 4
    assert fixed.floppy_modes + 1 == volume.floppy_modes == free.floppy_modes
    assert answers(fixed) == answers(volume) == ("no", "yes", "yes") and answers(free) == ("no", "no", "no")
    # lengths along the flex, x + s q' + s^2 q'' / 2 in a box strained alike
    before = scene.packing.position_nd[free.j_e] - scene.packing.position_nd[free.i_e]
    lattice = scene.packing.box.lattice_dd
    before -= np.rint(before @ np.linalg.inv(lattice).T) @ lattice.T
    error = []
    for s in (1e-2, 1e-3):
        strain = s * free.first_dd + 0.5 * s**2 * free.second_dd
        moved = s * free.first_nq + 0.5 * s**2 * free.second_nq
        after = before + before @ strain + moved[free.j_e] - moved[free.i_e]
        error.append(np.abs(np.linalg.norm(after, axis=1) - np.linalg.norm(before, axis=1)).max())
    assert error[0] < 1e-5 and error[1] < 2e-3 * error[0] + 1e-13


def test_a_flex_at_fixed_volume_keeps_it_to_second_order_and_opens_contacts():
    """One disc that touches its own images: the shear of its box is the only floppy mode, and a push drives it."""
    disc = pm.Packing([[0.5, 0.5]], [0.5], pm.Box.cubic(1.0, 2))
    assert answers(pm.second_order(disc)) == ("yes", "yes", "yes")
    found = pm.second_order(disc, strain="isochoric")
    assert answers(found) == ("no", "no", "no") and found.floppy_modes == found.self_stresses == 1
    volume, length = [], []
    for s in (1e-1, 1e-2):
        strain = np.eye(2) + s * found.first_dd + 0.5 * s**2 * found.second_dd
        volume.append(np.linalg.det(strain) - 1.0)
        length.append(np.linalg.norm(strain, axis=0) - 1.0)
    # what is left goes as the fourth power here
    assert 0.0 < abs(volume[0]) < 1e-4 and abs(volume[1]) < 2e-4 * abs(volume[0])
    shear = abs(found.first_dd[0, 1])
    # sides sqrt((1 + u)^2 + s^2 shear^2) with u = (s shear)^2 / 2, which the volume asks for
    assert np.abs(length[1] - (1e-2 * shear) ** 2).max() < 1e-8 and shear > 0.1
