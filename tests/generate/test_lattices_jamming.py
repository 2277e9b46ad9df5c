"""Which crystals are jammed, in cells of several sizes: by the definition, with a simplex solver of its own.

Contacts are found here by listing images, the motions are all displacements and symmetric strains with the volume not
growing, one particle pinned. A packing is jammed when no such motion leaves all contacts touching or opening: when the
rows have full column rank and no motion opens any of them (simplex, HiGHS). Nothing of this goes through packmech.
"""

import itertools

import highspy
import numpy as np
import pytest
import scipy.sparse
from hard_cases.defects import random_strain, strain_packing

import packmech as pm
from packmech.generate import LATTICE_NAMES

# name: collectively and strictly jammed in every cell but the small ones, and the cells that are tried
JAMMED = {
    "triangular": (True, True),
    "square": (False, False),
    "honeycomb": (False, False),
    "kagome": (False, False),
    "elongated triangular": (False, False),
    "snub square": (True, False),
    "snub hexagonal": (True, True),
    "rhombitrihexagonal": (False, False),
    "truncated square": (False, False),
    "truncated hexagonal": (False, False),
    "truncated trihexagonal": (False, False),
    "reinforced kagome": (True, True),
    "filled square": (True, True),
    "filled triangular": (True, True),
    "sc": (False, False),
    "bcc": (False, False),
    "fcc": (True, True),
    "hcp": (True, True),
    "diamond": (False, False),
    "pyrochlore": (False, False),
    "tunneled fcc": (False, False),
    "tunneled hcp": (False, False),
    "filled sc": (True, True),
}
# too small to unjam in a fixed box
HELD = {"square", "honeycomb", "elongated triangular", "sc", "bcc", "diamond", "tunneled fcc", "tunneled hcp"}
HELD_IN_SMALL_CELLS = {
    ("bcc", "right-angled"),
    ("tunneled fcc", "skew"),
    ("tunneled hcp", "skew"),
    ("tunneled hcp", "right-angled"),
}
SKEW = {2: [[2, 1], [0, 2]], 3: [[2, 1, 0], [0, 2, 1], [0, 0, 1]]}


def touching(packing, largest_gap=1e-9):
    """Return (i, j, vector) of every touching pair once, by listing all images."""
    lattice_dd, radius_n = packing.box.lattice_dd, packing.radius_n
    fraction_nd = np.linalg.solve(lattice_dd, packing.position_nd.T).T
    position_nd = (fraction_nd - np.floor(fraction_nd)) @ lattice_dd.T
    height_d = 1 / np.linalg.norm(np.linalg.inv(lattice_dd), axis=1)
    reach = np.ceil(2.1 * radius_n.max() / height_d).astype(int) + 1
    found = []
    for image in itertools.product(*[range(-m, m + 1) for m in reach]):
        vector = position_nd[None] - position_nd[:, None] + lattice_dd @ image
        near = np.linalg.norm(vector, axis=2) <= (1 + largest_gap) * (radius_n[:, None] + radius_n[None])
        forward = next((z > 0 for z in image if z), False)
        found += [(i, j, vector[i, j]) for i, j in np.argwhere(near) if i < j or (i == j and forward)]
    return found


def rows_of(pairs, particles, dimension, strain):
    """Return the rows of contact extensions (and of minus the volume strain), the first particle pinned."""
    component = list(itertools.combinations_with_replacement(range(dimension), 2)) if strain else []
    rows = np.zeros((len(pairs) + bool(strain), particles * dimension + len(component)))
    for row, (i, j, vector) in zip(rows, pairs, strict=False):
        normal = vector / np.linalg.norm(vector)
        row[j * dimension : (j + 1) * dimension] += normal
        row[i * dimension : (i + 1) * dimension] -= normal
        for k, (a, b) in enumerate(component):
            row[particles * dimension + k] = normal[a] * vector[b] + (normal[b] * vector[a] if a != b else 0)
    for k, (a, b) in enumerate(component):
        rows[-1, particles * dimension + k] = -(a == b)
    return rows[:, dimension:]


def is_trivial(rows):
    """Return whether rows @ y >= 0 has no solution but y = 0."""
    if not rows.shape[1]:
        return True
    if not len(rows) or np.linalg.matrix_rank(rows, tol=1e-9) < rows.shape[1]:
        return False
    solver = highspy.Highs()
    for option, value in (("output_flag", False), ("solver", "simplex"), ("threads", 1)):
        solver.setOptionValue(option, value)
    matrix = scipy.sparse.csc_array(rows)
    model = highspy.HighsLp()
    model.num_row_, model.num_col_ = rows.shape
    model.col_cost_ = -rows.sum(axis=0)
    model.col_lower_, model.col_upper_ = -np.ones(rows.shape[1]), np.ones(rows.shape[1])
    model.row_lower_, model.row_upper_ = np.zeros(len(rows)), np.full(len(rows), np.inf)
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_, model.a_matrix_.index_ = matrix.indptr, matrix.indices
    model.a_matrix_.value_ = matrix.data
    solver.passModel(model)
    solver.run()
    assert solver.getModelStatus() == highspy.HighsModelStatus.kOptimal
    return -solver.getInfo().objective_function_value < 1e-6


def without_rattlers(pairs, kept):
    """Return the pairs and the particles that are left when those not held by their contacts are taken out."""
    while True:
        normal = {k: [v for i, _, v in pairs if i == k] + [-v for _, j, v in pairs if j == k] for k in kept}
        loose = {k for k in kept if not normal[k] or not is_trivial(np.array(normal[k]))}
        if not loose:
            return pairs, kept
        kept = kept - loose
        pairs = [one for one in pairs if one[0] in kept and one[1] in kept]


def by_definition(packing, pairs=None):
    """Return whether the packing is locally, collectively and strictly jammed, rattlers taken out."""
    pairs, kept = without_rattlers(touching(packing) if pairs is None else pairs, set(range(packing.particles)))
    if not kept:
        return False, False, False
    number = {k: m for m, k in enumerate(sorted(kept))}
    pairs = [(number[i], number[j], vector) for i, j, vector in pairs]
    return True, *(is_trivial(rows_of(pairs, len(kept), packing.dimension, strain)) for strain in (False, True))


def answers(verdict):
    return tuple(
        {"jammed": True, "not jammed": False}[one] for one in (verdict.local, verdict.collective, verdict.strict)
    )


def test_every_lattice_has_its_answer():
    assert set(JAMMED) == set(LATTICE_NAMES)


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_supercells_of_crystals_are_jammed_as_the_definition_has_it(name):
    d = pm.lattice_packing(name).dimension
    cells = {
        "double": {"repeats": 2},
        "skew": {"supercell": np.array(SKEW[d])},
        "right-angled": {"conventional": True, "repeats": (2, 3, 1)[:d]},
    }
    for cell, arguments in cells.items():
        packing = pm.lattice_packing(name, **arguments)
        if packing.particles <= 64:
            collective, strict = JAMMED[name]
            expected = (True, collective or (name, cell) in HELD_IN_SMALL_CELLS, strict)
            assert by_definition(packing) == expected, cell
            assert answers(pm.classify_jamming(packing)) == expected, cell


@pytest.mark.parametrize("name", LATTICE_NAMES)
def test_primitive_cells_of_some_crystals_hold_each_other_in_a_fixed_box_only(name):
    packing = pm.lattice_packing(name)
    collective, strict = JAMMED[name]
    expected = (True, collective or name in HELD, strict)
    assert by_definition(packing) == expected
    assert answers(pm.classify_jamming(packing)) == expected


@pytest.mark.parametrize("repeats", [(3, 3), (4, 2), (1, 5)])
def test_the_snub_square_crystal_is_collectively_but_not_strictly_jammed_in_larger_cells(repeats):
    packing = pm.lattice_packing("snub square", repeats)
    assert by_definition(packing) == answers(pm.classify_jamming(packing)) == (True, True, False)


@pytest.mark.parametrize(("cells", "repeats"), [(1, 1), (1, (2, 1)), (1, 2), (2, 1), (2, (1, 2)), (3, 1), (4, 1)])
def test_the_reinforced_kagome_lattice_is_strictly_jammed(cells, repeats):
    packing = pm.reinforced_kagome_packing(cells, repeats)
    assert by_definition(packing) == answers(pm.classify_jamming(packing)) == (True, True, True)


def test_kagome_cells_reinforced_by_rows_of_one_direction_only_are_not_strictly_jammed():
    # five rows of the triangular lattice by four: two full rows side by side, and no full columns side by side
    triangular = pm.lattice_packing("triangular", repeats=(4, 5))
    site = [(i, j) for i in range(4) for j in range(5)]
    kept = np.array([not (i % 2 and j % 2) for i, j in site])
    packing = pm.Packing(triangular.position_nd[kept], triangular.radius_n[kept], triangular.box)
    assert by_definition(packing)[2] is answers(pm.classify_jamming(packing))[2] is False


@pytest.mark.parametrize(
    "steps", [(0,), (4,), (0, 1), (0, 2), (0, 3), (0, 0, 3), (0, 2, 4), (0, 3, 1, 4), (0, 0, 3, 3), (0, 5, 1, 2, 3)]
)
def test_no_tunneled_crystal_is_strictly_jammed_in_its_primitive_cell(steps):
    packing = pm.tunneled_packing(steps)
    local, _, strict = by_definition(packing)
    verdict = answers(pm.classify_jamming(packing))
    assert (local, strict) == (verdict[0], verdict[2]) == (True, False)


@pytest.mark.parametrize("layers", [1, 2, 3, *(pytest.param(count, marks=pytest.mark.slow) for count in (4, 5))])
def test_every_tunneled_crystal_of_so_many_layers_has_a_floppy_strain_at_fixed_volume(layers):
    # by symmetry the first step is along 0
    for rest in itertools.product(range(6), repeat=layers - 1):
        packing = pm.tunneled_packing((0, *rest))
        rows = rows_of(touching(packing), packing.particles, 3, True)
        assert np.linalg.matrix_rank(rows, tol=1e-9) < rows.shape[1], rest


@pytest.mark.parametrize("steps", [(0,), (0, 3)])
def test_a_tunneled_crystal_shears_into_a_denser_one_without_overlap(steps):
    packing = pm.tunneled_packing(steps)
    rows = rows_of(touching(packing), packing.particles, 3, True)
    motion = np.linalg.svd(rows)[2][-1]
    assert np.abs(rows @ motion).max() < 1e-14
    xx, xy, xz, yy, yz, zz = motion[-6:]
    strain_dd = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert np.linalg.norm(strain_dd) > 0.1
    moved_nd = np.vstack([np.zeros(3), motion[:-6].reshape(-1, 3)])
    amplitude = 0.05
    after = packing.replace(
        position_nd=packing.position_nd + amplitude * (packing.position_nd @ strain_dd + moved_nd),
        box=packing.box.strained(amplitude * strain_dd),
    )
    assert len(touching(after, -1e-12)) == 0
    assert pm.packing_fraction(after) > pm.packing_fraction(packing) * (1 + 1e-4)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("name", "repeats"), [("triangular", (5, 5)), ("fcc", (3, 3, 3))])
def test_crystals_with_vacancies_apart_are_jammed_as_the_definition_has_it(name, repeats, seed):
    crystal = pm.lattice_packing(name, repeats)
    packing = pm.vacancy_packing(crystal, 1 + seed % 3, seed=seed, apart=True)
    expected = by_definition(packing)
    assert expected[0]
    assert answers(pm.classify_jamming(packing)) == expected


@pytest.mark.parametrize("repeats", [3, 4, 6])
def test_the_triangular_crystal_stays_strictly_jammed_without_one_disc(repeats):
    packing = pm.vacancy_packing(pm.lattice_packing("triangular", repeats), 1, seed=repeats)
    assert by_definition(packing) == answers(pm.classify_jamming(packing)) == (True, True, True)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("name", "repeats", "vacancies"),
    [("triangular", 5, 4), ("triangular", 5, 9), ("fcc", 3, 5), ("fcc", 3, 11), ("hcp", 2, 3), ("filled square", 3, 3)],
)
def test_crystals_with_any_vacancies_are_jammed_as_the_definition_has_it(name, repeats, vacancies, seed):
    packing = pm.vacancy_packing(pm.lattice_packing(name, repeats), vacancies, seed=seed)
    verdict = pm.classify_jamming(packing)
    assert answers(verdict) == by_definition(packing)
    _, kept = without_rattlers(touching(packing), set(range(packing.particles)))
    if verdict.collective == "not jammed":
        assert set(np.flatnonzero(verdict.backbone).tolist()) == kept


@pytest.mark.parametrize("size", [1e-11, 1e-9, 1e-6])
@pytest.mark.parametrize("seed", range(6))
def test_strained_fcc_crystals_are_ambiguous_where_the_networks_at_a_tenth_and_ten_times_disagree(seed, size):
    crystal = pm.lattice_packing("fcc", 2)
    strain_dd = random_strain(3, size, seed=seed)
    pairs = touching(crystal)
    vector_cd = np.array([vector for *_, vector in pairs])
    gap_c = np.linalg.norm(vector_cd + vector_cd @ strain_dd, axis=1) - 1
    overlap_c = -gap_c[gap_c < -1e-15]
    tolerance = max(7 * overlap_c.mean() if len(overlap_c) else 0.0, 1e-9)
    fewest, most = (
        by_definition(crystal, [one for one, gap in zip(pairs, gap_c, strict=True) if gap <= factor * tolerance])
        for factor in (0.1, 10.0)
    )
    expected = tuple(
        "jammed" if few else "ambiguous" if many else "not jammed" for few, many in zip(fewest, most, strict=True)
    )
    verdict = pm.classify_jamming(strain_packing(crystal, strain_dd))
    assert (verdict.local, verdict.collective, verdict.strict) == expected
