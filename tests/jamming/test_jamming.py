"""Facts about the verdict: crystals whose answers are published, jammed packings, and the same with a contact gone."""

import pathlib

import numpy as np
import pytest
from scipy.optimize import brentq, linprog

import packmech as pm
from packmech.contacts.rattlers import rattlers_of

HARD = np.load(pathlib.Path(__file__).parents[1] / "golden" / "hard_packings.npz")
NAMES = sorted({key.split("/")[0] for key in HARD.files if "/" in key})
YES, NO = "jammed", "not jammed"
WAYS = [("certificate", "clarabel"), ("certificate", "highs"), ("loads", "clarabel"), ("loads", "highs")]


def hard_packing(name):
    position, radius, lattice = (HARD[f"{name}/{part}"] for part in ("position_nd", "radius_n", "lattice_dd"))
    return pm.Packing(position, radius, pm.Box(lattice))


def soft_packing(particles, dimension, strain, seed):
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.87 if dimension == 2 else 0.68
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8, strain=strain).packing


# Torquato and Stillinger, Rev. Mod. Phys. 82, 2633, table II (after Donev et al. 2004); smallest cells that unjam
CRYSTALS = [
    ("triangular", (1, 1), YES, YES),
    ("triangular", (2, 1), YES, YES),
    ("triangular", (3, 4), YES, YES),
    ("triangular", (8, 8), YES, YES),
    ("square", (1, 1), YES, NO),
    ("square", (2, 1), NO, NO),
    ("square", (1, 2), NO, NO),
    ("square", (4, 3), NO, NO),
    ("honeycomb", (1, 1), YES, NO),
    ("honeycomb", (2, 1), NO, NO),
    ("honeycomb", (1, 2), NO, NO),
    ("honeycomb", (4, 4), NO, NO),
    ("kagome", (1, 1), NO, NO),
    ("kagome", (2, 1), NO, NO),
    ("kagome", (3, 3), NO, NO),
    ("sc", (1, 1, 1), YES, NO),
    ("sc", (1, 1, 2), NO, NO),
    ("sc", (2, 1, 1), NO, NO),
    ("sc", (3, 3, 3), NO, NO),
    ("fcc", (1, 1, 1), YES, YES),
    ("fcc", (1, 1, 2), YES, YES),
    ("fcc", (3, 3, 3), YES, YES),
]


@pytest.mark.parametrize(("method", "solver"), WAYS)
@pytest.mark.parametrize(("name", "repeats", "collective", "strict"), CRYSTALS)
def test_crystal_is_what_the_table_says(name, repeats, collective, strict, method, solver):
    verdict = pm.classify_jamming(pm.lattice_packing(name, repeats), method=method, solver=solver)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, collective, strict)


@pytest.mark.parametrize("bound", ["ball", "box"])
@pytest.mark.parametrize("method", ["certificate", "loads"])
@pytest.mark.parametrize(("name", "repeats", "collective", "strict"), CRYSTALS[2::4])
def test_program_as_it_reads_says_so_too(name, repeats, collective, strict, method, bound):
    crystal = pm.lattice_packing(name, repeats)
    verdict = pm.classify_jamming(crystal, method=method, solver="cvxpy", bound=bound)
    assert (verdict.collective, verdict.strict) == (collective, strict)


@pytest.mark.parametrize("strain", ["free", "isochoric"])
@pytest.mark.parametrize(("name", "repeats", "collective", "strict"), CRYSTALS[::3])
def test_fixed_volume_makes_no_difference_for_spheres(name, repeats, collective, strict, strain):
    for method in ("certificate", "loads"):
        verdict = pm.classify_jamming(pm.lattice_packing(name, repeats), method=method, strain=strain)
        assert (verdict.collective, verdict.strict) == (collective, strict)


SUPERCELLS = [[[2, 1], [-1, 3]], [[1, 5], [0, 1]], [[3, 0], [1, 2]]]


@pytest.mark.parametrize("supercell", SUPERCELLS)
@pytest.mark.parametrize(("name", "expected"), [("triangular", YES), ("kagome", NO)])
def test_any_supercell_of_a_crystal_gives_its_answer(name, expected, supercell):
    verdict = pm.classify_jamming(pm.lattice_packing(name, supercell=supercell))
    assert (verdict.collective, verdict.strict) == (expected, expected)


def test_another_primitive_cell_of_the_square_crystal_is_as_vacuously_jammed():
    verdict = pm.classify_jamming(pm.lattice_packing("square", supercell=[[1, 4], [0, 1]]))
    assert (verdict.collective, verdict.strict) == (YES, NO)
    assert "without any condition" in verdict.collectively.reason


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_square_crystal_has_two_sliding_lines_less_translations_and_a_shear(repeats):
    verdict = pm.classify_jamming(pm.lattice_packing("square", repeats))
    assert verdict.collectively.floppy_modes == 2 * repeats - 2
    assert verdict.strictly.floppy_modes == 2 * repeats - 1
    assert verdict.states_of_self_stress == {"none": 2 * repeats, "isochoric": 2 * repeats - 1}


@pytest.mark.parametrize("repeats", [3, 5])
def test_triangular_crystal_has_as_many_self_stresses_as_counted(repeats):
    verdict = pm.classify_jamming(pm.lattice_packing("triangular", repeats))
    assert verdict.states_of_self_stress == {"none": repeats**2 + 2, "isochoric": repeats**2}
    assert verdict.contacts == 3 * repeats**2
    assert verdict.isostatic_contacts == 2 * repeats**2 + 1


@pytest.mark.parametrize("name", NAMES)
def test_stored_packings_touch_exactly(name):
    packing = hard_packing(name)
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    assert np.abs(contacts.gap_c).max() < 1e-13
    assert len(pm.find_contacts(packing, gap_tolerance=1e-8)) == len(contacts)


def balance(packing, verdict, strain):
    """Return the largest net force, and with strain the deviation of the stress from a pressure, of the certificate."""
    network, force = verdict.network, verdict.contact_force_c
    net = np.zeros_like(packing.position_nd)
    push = force[:, None] * network.normal_cd
    np.add.at(net, network.j_c, push)
    np.add.at(net, network.i_c, -push)
    stress = np.einsum("c,ca,cb->ab", force, network.vector_cd, network.normal_cd)
    deviator = stress - np.trace(stress) / packing.dimension * np.eye(packing.dimension)
    return max(np.abs(net).max(), np.abs(deviator).max() / np.abs(stress).max() if strain else 0.0)


@pytest.mark.parametrize(
    "name", ["2d-16-shape-fixed-0", "2d-64-shape-fixed-0", "2d-256-shape-fixed-3", "3d-32-shape-fixed-0"]
)
def test_packing_of_a_fixed_box_shape_is_collectively_but_not_strictly_jammed(name):
    packing = hard_packing(name)
    verdict = pm.classify_jamming(packing)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, YES, NO)
    backbone = int(verdict.backbone.sum())
    assert verdict.contacts == verdict.isostatic_contacts == packing.dimension * (backbone - 1) + 1
    assert verdict.states_of_self_stress == {"none": 1, "isochoric": 0}
    assert balance(packing, verdict, strain=False) < 1e-12


@pytest.mark.parametrize(
    "name", ["2d-32-shape-free-2", "2d-64-shape-free-0", "2d-256-shape-free-0", "3d-64-shape-free-0"]
)
def test_packing_with_all_strains_free_is_strictly_jammed_under_a_pure_pressure(name):
    packing = hard_packing(name)
    verdict = pm.classify_jamming(packing)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, YES, YES)
    d, backbone = packing.dimension, int(verdict.backbone.sum())
    assert verdict.contacts == verdict.isostatic_contacts == d * (backbone - 1) + d * (d + 1) // 2
    assert verdict.states_of_self_stress["isochoric"] == 1
    assert balance(packing, verdict, strain=True) < 1e-12
    assert verdict.contact_force_c.min() == pytest.approx(verdict.strictly.smallest_force)
    assert verdict.contact_force_c.mean() == pytest.approx(1.0)


def test_isostatic_count_is_not_enough_when_a_contact_would_have_to_pull():
    verdict = pm.classify_jamming(hard_packing("2d-256-shape-fixed-2"))
    assert verdict.states_of_self_stress["none"] == 1
    assert verdict.collective == NO
    assert verdict.collectively.smallest_force < 0


def oracle(packing, contacts, strain):
    """Return whether the packing is jammed by HiGHS' simplex alone: drop what rattles or opens until nothing does."""
    d = packing.dimension
    while True:
        loose = rattlers_of(contacts)
        contacts = contacts.select(~loose[contacts.i_c] & ~loose[contacts.j_c])
        if not len(contacts):
            return False
        kept = np.flatnonzero(~loose)
        matrix = pm.rigidity_matrix(packing, "free" if strain else "none", contacts=contacts).toarray()
        columns = (kept[1:, None] * d + np.arange(d)).ravel()
        matrix = np.hstack([matrix[:, columns], matrix[:, packing.particles * d :]])
        count, unknowns = matrix.shape
        rule = np.zeros((1 if strain else 0, unknowns + count))
        if strain:
            rule[0, unknowns - d * (d + 1) // 2 :][:d] = 1.0
        found = linprog(
            np.concatenate([np.zeros(unknowns), -np.ones(count)]),
            A_ub=np.vstack([np.hstack([-matrix, np.eye(count)]), rule]),
            b_ub=np.zeros(count + len(rule)),
            bounds=[(None, None)] * unknowns + [(0.0, 1.0)] * count,
            method="highs-ds",
        )
        assert found.status == 0
        opened = found.x[unknowns:] > 0.5
        if not opened.any():
            held = np.vstack([matrix, rule[:, :unknowns]])
            return bool(np.linalg.matrix_rank(held, tol=1e-7) == unknowns)
        contacts = contacts.select(~opened)


def without(packing, verdict, which):
    """Return the contacts less the one whose certified force has the given rank."""
    contacts = verdict.touching.contacts
    chosen = np.argsort(verdict.contact_force_c)[which]
    network = verdict.network
    gone = (contacts.i_c == network.i_c[chosen]) & (contacts.j_c == network.j_c[chosen])
    gone &= (contacts.image_cd == network.image_cd[chosen]).all(axis=1)
    assert gone.sum() == 1
    return contacts.select(~gone)


SMALL = [name for name in NAMES if "256" not in name and "128" not in name]


@pytest.mark.parametrize("method", ["certificate", "loads"])
@pytest.mark.parametrize("rank", ["weakest", "median"])
@pytest.mark.parametrize("name", SMALL)
def test_without_one_contact_a_single_self_stress_is_gone_and_simplex_decides_the_rest(name, rank, method):
    packing = hard_packing(name)
    verdict = pm.classify_jamming(packing)
    contacts = without(packing, verdict, 0 if rank == "weakest" else verdict.contacts // 2)
    less = pm.classify_jamming(packing, contacts=contacts, method=method)
    assert less.strict == NO
    if verdict.states_of_self_stress["none"] == 1:
        assert less.collective == NO
    for strain, answer in ((False, less.collective), (True, less.strict)):
        assert (answer == YES) == oracle(packing, contacts, strain)


@pytest.mark.parametrize(("dimension", "seed"), [(2, 1), (2, 3), (3, 2)])
@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_soft_packing_of_the_protocol_is_jammed_and_is_not_without_a_contact(dimension, seed, strain):
    packing = soft_packing(64, dimension, strain, seed)
    verdict = pm.classify_jamming(pm.Scene(packing, (pm.Repulsion(),)))
    assert verdict.collective == YES
    assert verdict.strict == (YES if strain == "free" else NO)
    assert verdict.mechanically_stable
    assert verdict.rest.at_rest
    question = "isochoric" if strain == "free" else "none"
    assert verdict.states_of_self_stress[question] == 1
    for which in (0, verdict.contacts // 2):
        contacts = without(packing, verdict, which)
        less = pm.classify_jamming(packing, contacts=contacts)
        assert (less.strict if strain == "free" else less.collective) == NO
        assert (less.collective == YES) == oracle(packing, contacts, strain=False)


@pytest.mark.parametrize(("name", "keep"), [("triangular", 40), ("kagome", 20), ("fcc", 50)])
@pytest.mark.parametrize("seed", range(4))
def test_crystal_with_contacts_struck_out_at_random_is_what_simplex_says(name, keep, seed):
    crystal = pm.lattice_packing(name, 4 if name != "fcc" else (2, 2, 3))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    chosen = np.sort(np.random.default_rng(seed).permutation(len(contacts))[: max(keep, len(contacts) - 3 - seed)])
    contacts = contacts.select(chosen)
    for method in ("certificate", "loads"):
        verdict = pm.classify_jamming(crystal, contacts=contacts, method=method)
        for strain, answer in ((False, verdict.collective), (True, verdict.strict)):
            assert (answer == YES) == oracle(crystal, contacts, strain)


@pytest.mark.parametrize("method", ["certificate", "loads"])
@pytest.mark.parametrize(("name", "repeats", "collective", "strict"), [row for row in CRYSTALS if row[3] == NO])
def test_unjamming_motion_closes_no_contact(name, repeats, collective, strict, method):
    motion = pm.classify_jamming(pm.lattice_packing(name, repeats), method=method).unjamming_motion
    size = max(np.abs(motion.displacement_nd).max(), np.abs(motion.strain_dd).max())
    assert size > 0.05
    assert motion.closing < 1e-6
    assert np.trace(motion.strain_dd) < 1e-9


@pytest.mark.parametrize(("name", "repeats"), [("square", (3, 2)), ("honeycomb", (2, 2)), ("kagome", (2, 2))])
def test_motion_in_the_fixed_box_opens_contacts_at_finite_amplitude(name, repeats):
    # |v + du| >= n.(v + du): what keeps its length to first order grows to second
    crystal = pm.lattice_packing(name, repeats)
    verdict = pm.classify_jamming(crystal)
    moved = verdict.unjamming_motion.moved(crystal, 0.02)
    before, after = (len(pm.find_contacts(one, gap_tolerance=1e-7)) for one in (crystal, moved))
    assert after < before
    assert pm.find_contacts(moved).overlap_c.max(initial=0.0) < 1e-9


def test_strain_of_the_square_crystal_is_its_shear():
    crystal = pm.lattice_packing("square", (1, 1))
    motion = pm.classify_jamming(crystal).unjamming_motion
    assert motion.strain_dd == pytest.approx(np.array([[0.0, 1.0], [1.0, 0.0]]) * motion.strain_dd[0, 1], abs=1e-12)
    assert np.abs(motion.displacement_nd).max() == 0.0
    sheared = motion.moved(crystal, 0.1)
    assert sheared.box.volume < crystal.box.volume


def test_weakest_contact_gone_gives_a_motion_that_opens_all_others():
    packing = hard_packing("2d-64-shape-fixed-0")
    verdict = pm.classify_jamming(packing)
    contacts = without(packing, verdict, 0)
    less = pm.classify_jamming(packing, contacts=contacts)
    motion = less.collectively.unjamming_motion
    stretch = pm.rigidity_matrix(packing, "none", contacts=less.network) @ motion.displacement_nd.ravel()
    assert stretch.min() > -1e-9
    assert stretch.max() > 1e-6


def crystal_with_guest():
    """Return a triangular crystal with a small disc in a vacancy, hanging by one contact."""
    crystal = pm.lattice_packing("triangular", repeats=(5, 5))
    position = np.vstack([crystal.position_nd[1:], crystal.position_nd[0] + [0.2, 0.0]])
    return pm.Packing(position, np.append(crystal.radius_n[1:], 0.3), crystal.box)


def test_rattler_hanging_by_one_contact_does_not_unjam_the_crystal_around_it():
    packing = crystal_with_guest()
    for method in ("certificate", "loads"):
        verdict = pm.classify_jamming(packing, method=method)
        assert (verdict.collective, verdict.strict) == (YES, YES)
        assert np.flatnonzero(verdict.rattlers).tolist() == [24]


def crystal_with_pinwheel():
    """Return a triangular crystal with three small discs in a vacancy, each touching the two others and one neighbor.

    The contacts with the crystal all lie off the radius to the same side: each disc is held while the others stay, but
    nothing balances their common torque, so together they turn.
    """
    crystal = pm.lattice_packing("triangular", repeats=(5, 5))
    turn = np.radians(10.0)

    def misfit(radius):
        circle = 2.0 * radius / np.sqrt(3.0)
        return np.sqrt(1.0 + circle**2 - 2.0 * circle * np.cos(turn)) - 0.5 - radius

    radius = brentq(misfit, 0.1, 0.3, xtol=1e-16, rtol=1e-15)
    angle = turn + np.radians([0.0, 120.0, 240.0])
    guests = 2.0 * radius / np.sqrt(3.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    position = np.vstack([crystal.position_nd[1:], crystal.position_nd[0] + guests])
    return pm.Packing(position, np.append(crystal.radius_n[1:], [radius] * 3), crystal.box)


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_discs_that_hold_one_another_but_carry_no_force_rattle_and_the_crystal_is_jammed(method):
    packing = crystal_with_pinwheel()
    assert pm.find_contacts(packing, gap_tolerance=1e-9).count_n()[-3:].tolist() == [3, 3, 3]
    assert not pm.find_rattlers(packing).any()
    verdict = pm.classify_jamming(packing, method=method)
    assert (verdict.collective, verdict.strict) == (YES, YES)
    assert np.flatnonzero(verdict.rattlers).tolist() == [24, 25, 26]


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_dilute_packing_has_an_empty_backbone(method):
    packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=-0.1)
    verdict = pm.classify_jamming(packing, method=method)
    assert (verdict.local, verdict.collective, verdict.strict) == (NO, NO, NO)
    assert "empty backbone" in verdict.collectively.reason
    assert verdict.rattlers.all()
    assert verdict.contacts == verdict.isostatic_contacts == 0


def test_chain_of_discs_is_not_jammed_and_shows_a_motion():
    chain = pm.Packing([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [0.5] * 3, pm.Box.cubic(5.0, 2))
    verdict = pm.classify_jamming(chain)
    assert verdict.local == NO
    assert verdict.unjamming_motion.opening > 0.1
    assert verdict.unjamming_motion.closing < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("particles", "dimension", "strain", "seed"),
    [
        (256, 2, "isotropic", 1),
        (256, 2, "free", 2),
        (256, 3, "isotropic", 1),
        (256, 3, "free", 2),
        (1024, 2, "isotropic", 1),
    ]
    + [(1024, 2, "free", 2), (1024, 3, "isotropic", 1), (1024, 3, "free", 1)],
)
def test_large_packings_of_the_protocol_are_jammed_by_both_methods_and_not_without_a_contact(
    particles, dimension, strain, seed
):
    packing = soft_packing(particles, dimension, strain, seed)
    verdicts = [pm.classify_jamming(packing, method=method) for method in ("certificate", "loads")]
    for verdict in verdicts:
        assert verdict.collective == YES
        assert verdict.strict == (YES if strain == "free" else NO)
    verdict = verdicts[0]
    question = "isochoric" if strain == "free" else "none"
    for which in (0, verdict.contacts // 2):
        contacts = without(packing, verdict, which)
        less = pm.classify_jamming(packing, contacts=contacts)
        if verdict.states_of_self_stress[question] == 1:
            assert (less.strict if strain == "free" else less.collective) == NO
        if verdict.states_of_self_stress[question] > 1 or particles == 256:
            exact = pm.classify_jamming(packing, contacts=contacts, solver="highs")
            assert (less.collective, less.strict) == (exact.collective, exact.strict)
