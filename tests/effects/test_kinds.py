"""Facts about laws and numbers that differ by kinds of particles: the same answers as of one kind, by every way."""

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize

import packmech as pm

STIFFNESS = np.array([[1.0, 2.0, 0.7], [2.0, 5.0, 3.0], [0.7, 3.0, 1.5]])
# of two kinds that differ in all numbers
COEFFICIENT = np.array([[0.3, 0.1], [0.1, 0.6]])
POISSON = np.array([[0.2, 0.3], [0.3, 0.45]])
RESTITUTION = np.array([[0.7, 0.5], [0.5, 0.9]])
PAIRS = [(0, 0), (0, 1), (1, 1)]


def law_of(table):
    return pm.LawByKind([[pm.Harmonic(number) for number in row] for row in np.asarray(table).tolist()])


def effects_of(stiffness, coefficient, poisson, restitution):
    """Return a repulsion, a dashpot and friction of numbers, or of tables."""
    law = pm.Harmonic(stiffness) if isinstance(stiffness, float) else law_of(stiffness)
    numbers = [one if isinstance(one, float) else pm.ByKind(one) for one in (coefficient, poisson, restitution)]
    friction = pm.Friction(numbers[0], pm.Mindlin(numbers[1]), pm.DampingRatio(0.5))
    return pm.Repulsion(law), pm.Restitution(numbers[2]), friction


def effects_of_pair(a, b):
    return effects_of(*(float(table[a, b]) for table in (STIFFNESS, COEFFICIENT, POISSON, RESTITUTION)))


BY_KIND = effects_of(STIFFNESS[:2, :2], COEFFICIENT, POISSON, RESTITUTION)


@pytest.fixture(scope="module")
def start():
    packing = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=1)
    return packing.replace(kind_n=np.random.default_rng(3).integers(0, 2, 32))


@pytest.fixture(scope="module")
def rested(start):
    scene = pm.Scene(start, BY_KIND[:1])
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-13).packing)


def lone_pairs():
    """Return pairs of discs that are far from each other, one of each two kinds, with stretched tangential springs."""
    place = np.array([[[2.0, 3.0 * k], [2.9, 3.0 * k]] for k in range(1, 4)]).reshape(-1, 2)
    i = [0, 2, 4]
    springs = pm.TangentialDisplacements(i, [1, 3, 5], [[0, 0]] * 3, [[0.01], [0.5], [-0.5]])
    kinds = [kind for pair in PAIRS for kind in pair]
    return pm.Packing(place, [0.5] * 6, pm.Box.cubic(12.0, 2), tangential=springs, kind_n=kinds)


def one_pair(packing, k):
    keep = np.zeros(6, dtype=bool)
    keep[2 * k : 2 * k + 2] = True
    return packing.select(keep).replace(kind_n=None)


def energy_by_hand(packing, position_nd):
    """Return the energy of all pairs of discs by two loops, at the nearest images."""
    energy, lattice = 0.0, packing.box.lattice_dd
    for i, j in itertools.combinations(range(packing.particles), 2):
        vector = position_nd[j] - position_nd[i]
        vector = vector - lattice @ np.round(np.linalg.solve(lattice, vector))
        sigma = packing.radius_n[i] + packing.radius_n[j]
        overlap = max(1.0 - np.linalg.norm(vector) / sigma, 0.0)
        energy += 0.5 * STIFFNESS[packing.kind_n[i], packing.kind_n[j]] * overlap**2
    return energy


def forces_by_hand(packing, position_nd):
    force, lattice = np.zeros_like(position_nd), packing.box.lattice_dd
    for i, j in itertools.combinations(range(packing.particles), 2):
        vector = position_nd[j] - position_nd[i]
        vector = vector - lattice @ np.round(np.linalg.solve(lattice, vector))
        sigma, r = packing.radius_n[i] + packing.radius_n[j], float(np.linalg.norm(vector))
        push = STIFFNESS[packing.kind_n[i], packing.kind_n[j]] * max(1.0 - r / sigma, 0.0) / sigma * vector / r
        force[i] -= push
        force[j] += push
    return force


# of one pair


def test_lone_pairs_of_a_mixture_are_those_of_scenes_of_one_kind():
    packing = lone_pairs()
    mixed = pm.Scene(packing, BY_KIND)
    found, matrix = pm.contact_forces(mixed), pm.hessian(mixed.without(pm.Friction), "none").toarray()
    assert len(found.contacts) == 3 and found.contacts.kinds_c.tolist() == [0, 1, 2]
    energy = 0.0
    for k, pair in enumerate(PAIRS):
        alone = pm.Scene(one_pair(packing, k), effects_of_pair(*pair))
        own = pm.contact_forces(alone)
        assert found.normal_c[k] == own.normal_c[0]
        np.testing.assert_array_equal(found.tangential_cd[k], own.tangential_cd[0])
        assert found.at_limit_c[k] == own.at_limit_c[0] == (k > 0)
        np.testing.assert_array_equal(pm.forces(mixed)[2 * k : 2 * k + 2], pm.forces(alone))
        block = matrix[4 * k : 4 * k + 4, 4 * k : 4 * k + 4]
        np.testing.assert_array_equal(block, pm.hessian(alone.without(pm.Friction), "none").toarray())
        energy += pm.energy(alone)
    assert pm.energy(mixed) == pytest.approx(energy, rel=1e-14)
    # two springs give way, at the cap of their own pair
    size = np.linalg.norm(found.tangential_cd, axis=1)
    cap = np.array([COEFFICIENT[pair] for pair in PAIRS]) * found.normal_c
    np.testing.assert_allclose(size[1:], cap[1:], rtol=1e-14)


def test_steps_of_lone_pairs_are_those_of_scenes_of_one_kind():
    packing = lone_pairs()
    rng = np.random.default_rng(1)
    velocity, spin = 0.02 * rng.standard_normal((6, 2)), 0.1 * rng.standard_normal((6, 1))
    run = pm.simulate(pm.Scene(packing, BY_KIND), steps=200, dt=0.01, velocity_nd=velocity, spin_nk=spin, check=False)
    for k, pair in enumerate(PAIRS):
        both = slice(2 * k, 2 * k + 2)
        alone = pm.Scene(one_pair(packing, k), effects_of_pair(*pair))
        own = pm.simulate(alone, steps=200, dt=0.01, velocity_nd=velocity[both], spin_nk=spin[both], check=False)
        np.testing.assert_allclose(run.packing.position_nd[both], own.packing.position_nd, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(run.spin_nk[both], own.spin_nk, rtol=0.0, atol=1e-13)


def test_collisions_leave_the_restitution_of_their_pair():
    pairs = BY_KIND[:2]
    for pair in (*PAIRS, (1, 0)):
        found = pm.coefficient_of_restitution(pairs, 1e-3, kinds=pair)
        assert found == pytest.approx(RESTITUTION[pair], abs=1e-8)


def test_dashpots_by_kind_are_numbers_by_kind():
    spring, table = pm.Repulsion(pm.Harmonic(4.0)), [[0.1, 0.2], [0.2, 0.5]]
    for made in (pm.ContactDamping, pm.ViscoelasticDamping):
        for a, b in PAIRS:
            found = pm.coefficient_of_restitution((spring, made(pm.ByKind(table))), 0.01, kinds=(a, b))
            assert found == pm.coefficient_of_restitution((spring, made(table[a][b])), 0.01)


# of packings


def test_kinds_of_equal_numbers_change_no_bit(start):
    plain = start.replace(kind_n=None)
    ones = np.ones((2, 2))
    tables, numbers = effects_of(ones, 0.3 * ones, 0.2 * ones, 0.7 * ones), effects_of(1.0, 0.3, 0.2, 0.7)
    runs = [
        pm.quench(pm.Scene(packing, acting[:1]), force_tolerance=1e-12)
        for packing, acting in ((start, tables), (plain, numbers))
    ]
    np.testing.assert_array_equal(*(one.packing.position_nd for one in runs))
    both = [
        pm.simulate(pm.Scene(run.packing, acting), steps=60, temperature=1e-4, seed=1, check=False)
        for run, acting in zip(runs, (tables, numbers), strict=True)
    ]
    np.testing.assert_array_equal(*(one.packing.position_nd for one in both))
    np.testing.assert_array_equal(*(one.packing.tangential.displacement_ck for one in both))
    moduli = [
        pm.elastic_moduli(pm.Scene(run.packing, acting[:1])).bulk_modulus
        for run, acting in zip(runs, (tables, numbers), strict=True)
    ]
    assert moduli[0] == moduli[1]


def test_a_quench_ends_where_another_minimizer_of_the_energy_by_hand_does(rested):
    packing = rested.packing
    assert len(set(pm.find_contacts(packing, gap_tolerance=0.0).kinds_c.tolist())) == 3
    shape = packing.position_nd.shape
    kick = 1e-3 * np.random.default_rng(1).standard_normal(shape)
    again = minimize(
        lambda place: energy_by_hand(packing, place.reshape(shape)),
        (packing.position_nd + kick).ravel(),
        jac=lambda place: -forces_by_hand(packing, place.reshape(shape)).ravel(),
        method="BFGS",
        options={"gtol": 1e-11},
    )
    mean = pm.contact_forces(rested).normal_c.mean()
    assert np.abs(forces_by_hand(packing, packing.position_nd)).max() < 1e-12 * mean
    assert pm.energy(rested) == pytest.approx(energy_by_hand(packing, packing.position_nd), rel=1e-13)
    assert pm.energy(rested) == pytest.approx(again.fun, rel=1e-8)


@pytest.mark.parametrize("method", [pm.LBFGS(), pm.Newton()], ids=repr)
def test_other_minimizers_balance_the_forces_by_hand(start, method):
    scene = pm.Scene(start, BY_KIND[:1])
    end = pm.quench(scene, force_tolerance=1e-11, method=method).packing
    mean = pm.contact_forces(scene.replace(packing=end)).normal_c.mean()
    assert np.abs(forces_by_hand(end, end.position_nd)).max() < 1e-10 * mean


def test_second_derivatives_are_differences_of_forces(rested):
    matrix, packing = pm.hessian(rested, "none").toarray(), rested.packing
    step = 1e-6
    for column in (0, 13, 40):
        u = np.zeros(matrix.shape[0])
        u[column] = step
        u_nd = u.reshape(packing.position_nd.shape)
        ahead, behind = (forces_by_hand(packing, packing.position_nd + sign * u_nd) for sign in (1.0, -1.0))
        slope = (behind - ahead).ravel() / (2.0 * step)
        np.testing.assert_allclose(matrix[:, column], slope, rtol=0.0, atol=1e-7 * np.abs(matrix).max())


def test_moduli_are_those_of_packings_that_are_strained_and_relaxed(rested):
    def stress_at(strain):
        gradient = np.array([[0.0, strain], [0.0, 0.0]])
        packing, stretch = rested.packing, np.eye(2) + gradient
        sheared = packing.replace(position_nd=packing.position_nd @ stretch.T, box=packing.box.strained(gradient))
        rest = pm.quench(rested.replace(packing=sheared), force_tolerance=1e-13, method=pm.Newton())
        return pm.stress_tensor(rested.replace(packing=rest.packing))[0, 1]

    slope = (stress_at(1e-6) - stress_at(-1e-6)) / 2e-6
    assert pm.elastic_moduli(rested, rattlers="keep").simple_shear(0, 1) == pytest.approx(slope, rel=1e-6)


def test_other_names_of_kinds_change_nothing(start):
    swapped = start.replace(kind_n=1 - start.kind_n)
    tables = [table[::-1, ::-1] for table in (STIFFNESS[:2, :2], COEFFICIENT, POISSON, RESTITUTION)]
    scenes = pm.Scene(start, BY_KIND), pm.Scene(swapped, effects_of(*tables))
    assert scenes[0].energy_scale == scenes[1].energy_scale == 5.0
    ends = [pm.quench(one.without(pm.Friction), force_tolerance=1e-12).packing.position_nd for one in scenes]
    np.testing.assert_array_equal(*ends)
    runs = [pm.simulate(one, steps=60, temperature=1e-4, seed=1, check=False) for one in scenes]
    np.testing.assert_array_equal(*(one.packing.position_nd for one in runs))


def test_steps_close_the_ledger_and_have_the_same_bits_on_two_threads(rested):
    scene = rested.replace(effects=BY_KIND)
    runs = [
        pm.simulate(scene, steps=200, temperature=1e-4, seed=1, ledger=True, threads=threads, check=False)
        for threads in (1, 2)
    ]
    np.testing.assert_array_equal(*(one.packing.position_nd for one in runs))
    assert runs[0].ledger.sliding_t[-1] > 0.0 if hasattr(runs[0].ledger, "sliding_t") else True
    assert runs[0].packing.kind_n.tolist() == scene.packing.kind_n.tolist()


def test_friction_at_rest_sees_each_coefficient(rested):
    """What the steps say of forces is what the contacts at the end say; no force is above the cap of its pair."""
    run = pm.simulate(rested.replace(effects=BY_KIND), steps=400, temperature=1e-4, seed=2, check=False)
    found = pm.contact_forces(rested.replace(effects=BY_KIND, packing=run.packing))
    size = np.linalg.norm(found.tangential_cd, axis=1)
    cap = np.array([COEFFICIENT[pair] for pair in PAIRS])[found.contacts.kinds_c] * found.normal_c
    assert (size <= cap * (1.0 + 1e-12)).all() and (size > 0.9 * cap).any()
    moduli = pm.elastic_moduli(rested.replace(effects=BY_KIND, packing=run.packing), rattlers="keep")
    assert moduli.bulk_modulus > pm.elastic_moduli(rested, rattlers="keep").bulk_modulus


def test_a_jammed_packing_of_kinds_bears_the_pressure(start):
    scene = pm.Scene(start, BY_KIND[:1])
    run = pm.jam(scene, pressure=1e-3, strain="isotropic", method=pm.Decompression())
    jammed = scene.replace(packing=run.packing)
    assert run.ok and run.packing.kind_n.tolist() == start.kind_n.tolist()
    assert pm.pressure(jammed) == pytest.approx(1e-3 * jammed.pressure_unit, rel=1e-8)
    assert (
        np.abs(forces_by_hand(run.packing, run.packing.position_nd)).max()
        < 1e-9 * pm.contact_forces(jammed).normal_c.mean()
    )


# a law of a user's


@pm.law
class OwnByKind(NamedTuple):
    """A spring whose stiffness grows with the number of the pair of kinds."""

    stiffness: float = 1.0

    def energy(self, distance, partners):
        return 0.5 * self.stiffness * (1.0 + partners.kinds) * (partners.contact_distance - distance) ** 2

    def first(self, distance, partners):
        return -self.stiffness * (1.0 + partners.kinds) * (partners.contact_distance - distance)

    def second(self, distance, partners):
        return self.stiffness * (1.0 + partners.kinds)


def test_a_law_of_a_users_is_given_the_pair_of_kinds():
    packing = lone_pairs()
    scene = pm.Scene(packing, (pm.Repulsion(OwnByKind()),))
    np.testing.assert_allclose(pm.forces(scene)[1::2, 0], [0.1, 0.2, 0.3], rtol=1e-12)
    run = pm.simulate(scene, steps=1, dt=1e-6, method=pm.SemiImplicitEuler(), check=False)
    np.testing.assert_allclose((run.velocity_nd * packing.mass_n[:, None])[1::2, 0], 1e-6 * pm.forces(scene)[1::2, 0])


# materials

GLASS = pm.Material(70.0, 0.22, density=2.5, restitution=0.9, friction=0.4)
STEEL = pm.Material(200.0, 0.3, density=7.8, restitution=0.6, friction=0.1)


@pytest.fixture(scope="module")
def beads():
    packing = pm.random_packing(20, dimension=3, sizes=pm.Bidisperse(1.3), packing_fraction=0.75, seed=2)
    return packing.replace(kind_n=np.arange(20) % 2)


def test_of_one_material_the_effects_are_those_of_the_material(beads):
    plain = beads.replace(kind_n=None)
    assert pm.Materials([GLASS]).effects(plain) == GLASS.effects(plain)
    twice = pm.Materials((GLASS, GLASS))
    assert twice.effects(beads)[1:] == GLASS.effects(plain)[1:]
    due = pm.energy(pm.Scene(plain, GLASS.effects(plain)))
    assert pm.energy(pm.Scene(beads, twice.effects(beads))) == pytest.approx(due, rel=1e-14)
    made = beads.replace(mass_n=None).mass_n * 2.5
    np.testing.assert_allclose(twice.masses(beads), made, rtol=1e-14)


def test_pairs_of_materials_have_the_moduli_of_both(beads):
    """1/E* is the sum of (1 - nu^2)/E, 1/G* of (2 - nu)/G, k_t = 8 G* a over k_n = 2 E* a (Johnson, 1985)."""
    both = pm.Materials((GLASS, STEEL))
    repulsion, restitution, friction = both.effects(beads)
    for a, b in PAIRS:
        pair = [(GLASS, STEEL)[a], (GLASS, STEEL)[b]]
        modulus = 1.0 / sum((1.0 - one.poisson_ratio**2) / one.young_modulus for one in pair)
        shear = 1.0 / sum((2.0 - one.poisson_ratio) / one.shear_modulus for one in pair)
        assert repulsion.law.of(a, b).modulus == pytest.approx(modulus, rel=1e-14)
        nu = friction.stiffness.poisson_ratio.of(a, b)
        assert 2.0 * (1.0 - nu) / (2.0 - nu) == pytest.approx(8.0 * shear / (2.0 * modulus), rel=1e-13)
        assert restitution.coefficient.of(a, b) == pytest.approx(math.sqrt(pair[0].restitution * pair[1].restitution))
        assert friction.coefficient.of(a, b) == pytest.approx(math.sqrt(pair[0].friction * pair[1].friction))
    # a plate of steel under a bead of glass is touched with the same E* as a ball of steel
    floor = GLASS.walls(beads, 2, -9.0, 9.0, of=STEEL)
    assert 2.0 * floor.law.modulus == pytest.approx(repulsion.law.of(0, 1).modulus, rel=1e-14)
    assert floor.damping.coefficient == restitution.coefficient.of(0, 1)
    np.testing.assert_allclose(both.masses(beads)[:2] / beads.replace(mass_n=None).mass_n[:2], [2.5, 7.8], rtol=1e-14)


@pytest.mark.parametrize(("mixing", "due"), [("geometric", 0.2), ("harmonic", 0.16), ("mean", 0.25), ("min", 0.1)])
def test_friction_of_two_materials_is_the_mean_that_was_asked_for(mixing, due):
    assert pm.Materials((GLASS, STEEL), mixing).of(1, 0).friction == pytest.approx(due, rel=1e-14)


def test_each_number_may_have_a_mean_of_its_own():
    both = pm.Materials((GLASS, STEEL), {"friction": "min"}).of(0, 1)
    assert both.friction == min(GLASS.friction, STEEL.friction)
    assert both.restitution == GLASS.mixed(STEEL).restitution
    assert GLASS.mixed(STEEL, {"friction": "min"}) == both


def test_what_was_measured_of_a_pair_stands_for_means():
    both = pm.Materials((GLASS, STEEL), exceptions={(1, 0): {"friction": 0.7}, (1, 1): {"restitution": 0.3}})
    assert both.of(0, 1).friction == 0.7 and both.of(1, 1).restitution == 0.3 and both.of(0, 0) == GLASS
    assert both.of(0, 1).restitution == pm.Materials((GLASS, STEEL)).of(0, 1).restitution
    for wrong, words in (
        ({(0, 2): {"friction": 0.1}}, "kinds below 2"),
        ({(0, 1): {"density": 1.0}}, "by name, among friction, poisson_ratio, restitution, young_modulus"),
        ({(0, 1): {"friction": -0.1}}, r"exceptions\[\(0, 1\)\].friction must"),
        ({(0, 1): {}, (1, 0): {}}, "kinds 0 and 1 once"),
    ):
        with pytest.raises(ValueError, match=words):
            pm.Materials((GLASS, STEEL), exceptions=wrong)


def test_materials_that_are_none_or_too_few_are_refused(beads):
    with pytest.raises(TypeError, match="materials must be a tuple of materials"):
        pm.Materials(GLASS)
    with pytest.raises(ValueError, match="mixing must be one of 'geometric'"):
        pm.Materials((GLASS, STEEL), "largest")
    with pytest.raises(ValueError, match="mixing.friction must be one of 'geometric'"):
        pm.Materials((GLASS, STEEL), {"friction": "largest"})
    with pytest.raises(ValueError, match="mixing must be of friction or restitution, got 'frictoin'; did you mean"):
        pm.Materials((GLASS, STEEL), {"frictoin": "min"})
    with pytest.raises(ValueError, match="as many kinds as there are materials, 1, got 2"):
        pm.Materials((GLASS,)).effects(beads)


def test_scene_files_hold_tables_by_kinds_and_materials_of_kinds(tmp_path, beads):
    scene = pm.Scene(beads, pm.Materials((GLASS, STEEL)).effects(beads))
    pm.write_scene(scene, tmp_path / "beads.toml")
    assert pm.read_scene(tmp_path / "beads.toml").effects == scene.effects
    text = """
[packing]
kind = "lattice"
name = "square"
[kinds]
shares = [0.5, 0.5]
seed = 1
[[effects]]
kind = "repulsion"
law = { kind = "law-by-kind", laws = ["harmonic", "harmonic", { kind = "harmonic", energy_scale = 2.0 }] }
[[effects]]
kind = "friction"
coefficient = { numbers = [[0.1, 0.2], [0.2, 0.3]] }
"""
    (tmp_path / "tables.toml").write_text(text.replace('name = "square"', 'name = "square"\nrepeats = [2, 2]'))
    read = pm.read_scene(tmp_path / "tables.toml").effects
    assert read[0].law == law_of([[1.0, 1.0], [1.0, 2.0]])
    assert read[1].coefficient == pm.ByKind([[0.1, 0.2], [0.2, 0.3]])
    shipped = pm.read_scene("glass-and-steel")
    kind_n, volume = shipped.packing.kind_n, math.pi / 6.0
    np.testing.assert_allclose(shipped.packing.mass_n, np.array([1.0, 3.1])[kind_n] * volume, rtol=1e-14)
    assert shipped.effects == pm.Materials(
        (
            pm.Material(1.0, 0.22, 1.0, restitution=0.6, friction=0.4),
            pm.Material(3.0, 0.3, 3.1, restitution=0.5, friction=0.2),
        )
    ).effects(shipped.packing)


# tables


def test_tables_are_squares_or_mappings_and_the_same_both_ways():
    by_rows, by_pairs = pm.ByKind([[1.0, 2.0], [2.0, 3.0]]), pm.ByKind({(1, 0): 2.0, (1, 1): 3.0, (0, 0): 1.0})
    assert by_rows == by_pairs == pm.ByKind((1.0, 2.0, 3.0)) and hash(by_rows) == hash(by_pairs)
    assert [by_rows.of(*pair) for pair in PAIRS] == [1.0, 2.0, 3.0] and by_rows.of(1, 0) == 2.0
    for k, (high, low) in enumerate((a, b) for a in range(3) for b in range(a + 1)):
        assert law_of(STIFFNESS).laws[k].energy_scale == STIFFNESS[high, low]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ([[1.0, 2.0], [3.0, 4.0]], "same for kinds 0 and 1 as for 1 and 0, got 2.0 and 3.0"),
        ([[1.0, 2.0]], "must be a square"),
        ({(0, 0): 1.0, (1, 1): 2.0}, r"for each pair of kinds, got none for \(0, 1\)"),
        ((1.0, 2.0), "for each pair of kinds, got 2"),
        ({"a": 1.0}, r"pairs of kinds such as \(0, 1\), got 'a'"),
        (0.3, "rows of a square"),
    ],
)
def test_tables_that_are_none_are_refused(table, words):
    with pytest.raises((TypeError, ValueError), match=words):
        pm.ByKind(table)


def test_what_a_table_lacks_or_must_not_hold_is_refused_by_name(start):
    three = start.replace(kind_n=[2 if k == 7 else 0 for k in range(32)])
    with pytest.raises(
        ValueError, match=r"effects\[0\].law must have a row for each kind.*3, got 2: particle 7 is of kind 2"
    ):
        pm.Scene(three, BY_KIND)
    with pytest.raises(ValueError, match=r"effects\[1\].coefficient must be above 0 and at most 1, got 1.5"):
        pm.Scene(start, (BY_KIND[0], pm.Restitution(pm.ByKind([[0.5, 1.5], [1.5, 0.5]]))))
    with pytest.raises(ValueError, match=r"effects\[0\].stiffness.poisson_ratio must be from 0 to 0.5, got 0.7"):
        pm.Scene(start, (pm.Friction(0.3, pm.Mindlin(pm.ByKind([[0.1, 0.7], [0.7, 0.2]]))), *BY_KIND[:1]))
    with pytest.raises(ValueError, match=r"effects\[0\].law.laws\[1\].energy_scale must be positive, got -1.0"):
        pm.Scene(start, (pm.Repulsion(law_of([[1.0, -1.0], [-1.0, 1.0]])),))
    with pytest.raises(
        TypeError, match=r"effects\[1\].coefficient must be the same for all kinds .*RollingResistance|Friction"
    ):
        pm.Scene(start, (BY_KIND[0], pm.RollingResistance(pm.ByKind([[0.1, 0.2], [0.2, 0.3]]))))
    with pytest.raises(TypeError, match="of one class, Harmonic, got Hertz"):
        pm.LawByKind([[pm.Harmonic(), pm.Hertz()], [pm.Hertz(), pm.Harmonic()]])
    with pytest.raises(ValueError, match=r"effects\[1\].law must be pm.LawPerKind for walls that differ"):
        pm.Scene(start, (BY_KIND[0], pm.Walls(1, -50.0, 50.0, law_of(STIFFNESS))))
    with pytest.raises(ValueError, match="compression must be the same for all kinds"):
        pm.Bonds([0], [1], [[0, 0]], [1.0], law_of(STIFFNESS))
    with pytest.raises(ValueError, match=r"kinds must be below 2, .*got \(0, 2\)"):
        pm.coefficient_of_restitution(BY_KIND[:2], 1e-3, kinds=(0, 2))
    with pytest.raises(ValueError, match="switched_friction must be left out where friction differs by kinds"):
        pm.ShearBatch([pm.Scene(start, BY_KIND)], switched_friction=True)
    with pytest.raises(ValueError, match=r"scenes\[1\].packing must have kinds of particles as the first scene's has"):
        pm.ShearBatch([pm.Scene(start, BY_KIND), pm.Scene(start.replace(kind_n=None), BY_KIND)])


def test_a_batch_shears_packings_of_kinds_as_single_runs_do(rested):
    scene = rested.replace(effects=BY_KIND)
    batch = pm.ShearBatch([scene, scene], control="rate", steps=20, dt=0.01)
    batch.advance(np.array([[0.02], [0.0]]))
    alone = pm.ShearBatch([scene], control="rate", steps=20, dt=0.01)
    alone.advance(np.array([[0.02]]))
    np.testing.assert_array_equal(batch.figure_bk[0], alone.figure_bk[0])
    assert math.isclose(batch.figure_bk[1, batch.names.index("elastic_energy")], pm.energy(rested), rel_tol=1e-6)


def test_pairs_whose_coefficient_is_zero_are_smooth_at_rest():
    crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    smooth, rough = (pm.Scene(crystal, (pm.Repulsion(), pm.Friction(one, 0.7))) for one in (0.0, 0.5))
    for numbers, like in (((0.0, 0.0, 0.5), smooth), ((0.5, 0.0, 0.0), rough)):
        scene = pm.Scene(crystal, (pm.Repulsion(), pm.Friction(pm.ByKind(numbers), 0.7)))
        one, other = (pm.elastic_moduli(each) for each in (scene, like))
        assert one.shear_modulus == pytest.approx(other.shear_modulus, rel=1e-12)
        same = pm.stiffness_matrix(scene, "none") - pm.stiffness_matrix(like, "none")
        assert np.abs(same.toarray()).max() < 1e-14
        counts = [pm.contact_forces(each).isostatic_coordination for each in (scene, like)]
        assert counts[0] == pytest.approx(counts[1], rel=1e-14)


def test_smooth_pairs_among_rough_ones_have_one_number_and_torques_only_where_a_rough_one_is():
    # kinds in rows: of the six contacts of a particle two are with its own kind
    crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    rows = np.arange(16) % 4 % 2
    mixed = crystal.replace(kind_n=rows)
    scene = pm.Scene(mixed, (pm.Repulsion(), pm.Friction(pm.ByKind((0.0, 0.0, 0.5)), 0.7)))
    found = pm.contact_forces(scene)
    rough = (rows[found.contacts.i_c] == 1) & (rows[found.contacts.j_c] == 1)
    share, turning = 1.0 - rough.mean(), 0.5
    assert 0.0 < share < 1.0
    # forces that are free, over equations of force for all and of torque for half of the particles
    assert found.isostatic_coordination == pytest.approx(2.0 * (2.0 + turning) / (2.0 - share), rel=1e-14)


def test_several_materials_ask_for_the_kinds_of_a_packing():
    materials = pm.Materials((pm.Material(1.0), pm.Material(2.0, density=3.0)))
    packing = pm.random_packing(8, dimension=3, packing_fraction=0.3, seed=1)
    for call in (materials.effects, materials.masses):
        with pytest.raises(ValueError, match="packing must have kinds for 2 materials, got none: kind_n=..."):
            call(packing)
    assert len(set(materials.masses(packing.replace(kind_n=[0] * 4 + [1] * 4)))) == 2
