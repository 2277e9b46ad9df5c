"""Facts about the compiled program: the same physics as the measures, in any box, order, list or process."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts.cells import find_pairs, frame_of, size_levels
from packmech.minimize.passes.pair_list import SKIN_FULL
from packmech.minimize.program import build_program

REPULSION = (pm.Repulsion(law=pm.Harmonic()),)


def mixture(particles=64, *, dimension=2, packing_fraction=0.9, seed=1):
    return pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=packing_fraction, seed=seed
    )


def skewed(particles, dimension, seed, *, tilt=2.0):
    packing = mixture(particles, dimension=dimension, seed=seed)
    shear = np.eye(dimension)
    shear[0, 1] = tilt
    box = pm.Box(shear @ packing.box.lattice_dd)
    return packing.replace(position_nd=packing.position_nd @ shear.T, box=box)


def assert_same_physics(scene, program, position_nd=None, lattice_dd=None):
    now = program.evaluate(position_nd, lattice_dd)
    assert now.energy == pytest.approx(pm.energy(scene), rel=1e-12, abs=1e-13)
    assert np.abs(now.force_nd - pm.forces(scene)).max() <= 1e-12
    assert np.abs(now.stress_dd - pm.stress_tensor(scene)).max() <= 1e-12 * max(1.0, np.abs(now.stress_dd).max())
    assert now.contacts == len(pm.find_contacts(scene.packing, gap_tolerance=0.0))


@given(st.integers(1, 40), st.sampled_from([2, 3]), st.integers(0, 10**6), st.sampled_from([0.0, 0.4, 3.7, 10.2]))
@settings(max_examples=40)
def test_energy_forces_and_stress_are_those_of_the_measures_in_any_box(particles, dimension, seed, tilt):
    scene = pm.Scene(skewed(particles, dimension, seed, tilt=tilt), REPULSION)
    assert_same_physics(scene, build_program(scene))


@pytest.mark.parametrize("side", [0.09, 0.3, 0.55, 0.98])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_particle_that_touches_many_of_its_own_images_has_their_energy_and_stress(side, dimension):
    if dimension == 3 and side < 0.2:
        side = 0.21
    packing = pm.Packing(np.full((1, dimension), 0.3), [0.5], pm.Box.cubic(side, dimension))
    scene = pm.Scene(packing, REPULSION)
    assert_same_physics(scene, build_program(scene))


def test_sizes_that_differ_a_thousandfold_are_searched_rightly():
    rng = np.random.default_rng(5)
    radius = np.where(np.arange(120) < 3, 500.0, 0.5)
    packing = pm.Packing(rng.uniform(0.0, 1800.0, (120, 2)), radius, pm.Box.cubic(1800.0, 2))
    scene = pm.Scene(packing, REPULSION)
    assert_same_physics(scene, build_program(scene))


def test_positions_far_outside_the_cell_give_the_same_forces():
    packing = mixture()
    away = packing.position_nd + np.random.default_rng(2).integers(-90, 90, (64, 2)) @ packing.box.lattice_dd.T
    scene = pm.Scene(packing.replace(position_nd=away), REPULSION)
    assert np.abs(build_program(scene).evaluate().force_nd - pm.forces(pm.Scene(packing, REPULSION))).max() < 1e-11


@pytest.mark.parametrize("dimension", [2, 3])
def test_lists_follow_a_box_that_is_strained_step_by_step(dimension):
    rng = np.random.default_rng(3)
    packing = skewed(40, dimension, 1)
    program = build_program(pm.Scene(packing, REPULSION))
    position, lattice = packing.position_nd, packing.box.lattice_dd
    for _ in range(25):
        change = np.eye(dimension) + 0.03 * rng.standard_normal((dimension, dimension))
        lattice = change @ lattice
        position = position @ change.T + 0.05 * rng.standard_normal(position.shape)
        scene = pm.Scene(packing.replace(position_nd=position, box=pm.Box(lattice)), REPULSION)
        assert_same_physics(scene, program, position, lattice)


@pytest.mark.parametrize(
    "law",
    [pm.Harmonic(2.0), pm.Hertz(0.3), pm.PowerLaw(1.0, 3.3), pm.LinearSpring(4.0), pm.RepulsiveLennardJones(0.1)],
    ids=lambda law: type(law).__name__,
)
def test_forces_are_minus_the_gradient_of_the_energy(law):
    packing = pm.quench(pm.Scene(mixture(12, seed=4), REPULSION), force_tolerance=1e-1).packing
    program = build_program(pm.Scene(packing, (pm.Repulsion(law=law),)))
    position = packing.position_nd
    force = program.evaluate().force_nd
    step = 1e-6
    for i in range(12):
        for k in range(2):
            moved = np.zeros_like(position)
            moved[i, k] = step
            slope = (program.evaluate(position + moved).energy - program.evaluate(position - moved).energy) / (2 * step)
            assert -slope == pytest.approx(force[i, k], abs=2e-8 * max(1.0, np.abs(force).max()))


def test_forces_of_two_effects_are_the_sum_of_their_forces():
    packing = mixture()
    one, two = pm.Repulsion(law=pm.Harmonic(0.7)), pm.Repulsion(law=pm.Hertz(0.2))
    both = build_program(pm.Scene(packing, (one, two))).evaluate()
    first, second = (build_program(pm.Scene(packing, (effect,))).evaluate() for effect in (one, two))
    assert np.abs(both.force_nd - first.force_nd - second.force_nd).max() < 1e-14
    assert both.energy == pytest.approx(first.energy + second.energy, rel=1e-14)


def test_effects_without_an_energy_have_no_part_in_the_program():
    packing = mixture()
    damped = build_program(pm.Scene(packing, (*REPULSION, pm.ContactDamping(0.3))))
    assert damped.effects == REPULSION


def relaxed(scene, *, skin=None):
    program = build_program(scene)
    if skin is not None:
        program.pairs.number[SKIN_FULL] = skin
    return program, program.relax(force_tolerance=1e-11, method=pm.Fire())


@pytest.mark.parametrize("skin", [0.02, 0.2, 1.5])
def test_the_skin_of_the_lists_changes_no_bit_of_a_run(skin):
    scene = pm.Scene(mixture(), REPULSION)
    usual, run = relaxed(scene)
    other, same = relaxed(scene, skin=skin)
    assert usual.pairs.number[SKIN_FULL] != other.pairs.number[SKIN_FULL]
    assert np.array_equal(run.packing.position_nd, same.packing.position_nd)
    assert run.steps == same.steps


def test_relabelled_particles_take_the_same_way_to_the_last_bit():
    packing = mixture()
    order = np.random.default_rng(7).permutation(64)
    shuffled = packing.replace(position_nd=packing.position_nd[order], radius_n=packing.radius_n[order])
    _, run = relaxed(pm.Scene(packing, REPULSION))
    _, same = relaxed(pm.Scene(shuffled, REPULSION))
    assert np.array_equal(run.packing.position_nd[order], same.packing.position_nd)


def test_a_program_used_before_gives_the_same_bits_as_a_new_one():
    packing = mixture()
    scene = pm.Scene(packing, REPULSION)
    program, run = relaxed(scene)
    again = program.relax(packing.position_nd, force_tolerance=1e-11, method=pm.Fire())
    assert np.array_equal(run.packing.position_nd, again.packing.position_nd)


def test_a_thousand_times_smaller_box_than_particle_is_refused_with_a_reason():
    packing = pm.Packing([[0.0, 0.0]], [1e4], pm.Box.cubic(1.0, 2))
    with pytest.raises(ValueError, match="too small for its particles"):
        build_program(pm.Scene(packing, REPULSION)).evaluate()


def test_positions_of_the_wrong_shape_are_refused():
    program = build_program(pm.Scene(mixture(), REPULSION))
    with pytest.raises(ValueError, match=r"coordinate_rd must have shape"):
        program.place(np.zeros((3, 2)))


def test_effects_that_hold_no_energy_are_refused():
    with pytest.raises(ValueError, match="effects must"):
        build_program(pm.Scene(mixture(), (pm.ContactDamping(0.3),)))


@given(st.integers(0, 10**6), st.sampled_from([2, 3]), st.sampled_from([0.3, 1.0, 2.0]))
@settings(max_examples=20)
def test_pair_table_is_sorted_and_holds_each_pair_of_a_search_through_all_images_once(seed, dimension, side):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 12))
    radius = rng.choice([0.05, 0.3, 0.5], count)
    box = pm.Box(side * (np.eye(dimension) + 0.3 * rng.standard_normal((dimension, dimension)))).reduced()[0]
    row = np.zeros((count, 4))
    row[:, :dimension] = rng.uniform(-1.0, 2.0, (count, dimension)) @ box.lattice_dd.T
    row[:, 3] = radius
    table = find_pairs((0,) * dimension, row, size_levels(radius), frame_of(box), 1.0, 0.1)
    j = table.code_p >> table.bits
    image = table.image_kd[table.code_p & ((1 << table.bits) - 1), :dimension]
    found = [(int(a), int(b), *map(int, z)) for a, b, z in zip(table.i_p, j, image, strict=True)]
    assert found == sorted(set(found))
    reach = int(np.ceil(3.0 * 1.2 / box.height_d.min())) + 4
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * dimension, indexing="ij"), -1).reshape(-1, dimension)
    expected = set()
    for a in range(count):
        for b in range(a, count):
            vector = row[b, :dimension] - row[a, :dimension] + steps @ box.lattice_dd.T
            near = (vector**2).sum(axis=1) <= (radius[a] + radius[b] + 0.1) ** 2
            for z in steps[near]:
                if a < b or next((k for k in z if k), 0) > 0:
                    expected.add((a, b, *map(int, z)))
    assert set(found) == expected


COUNT_COMPILATIONS = """
import numpy as np
from numba.core.event import install_recorder
import packmech as pm
with install_recorder("numba:compile") as recorder:
    packing = pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=1)
    pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-4)
    pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-4, method=pm.LBFGS())
print(len(recorder.buffer))
"""


def test_a_second_process_compiles_nothing():
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", COUNT_COMPILATIONS], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "0"
