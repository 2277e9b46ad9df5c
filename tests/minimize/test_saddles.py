"""Facts about saddles: no quench ends on one with success, whatever bears the forces there."""

from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.linalg.factor import NotDefinite
from packmech.mechanics.stability import stability
from packmech.minimize.second_order.newton import newton

HARMONIC = (pm.Repulsion(),)
LOWEST = -1e-8


def lowest_over_largest(scene, step=1e-6):
    """Return the lowest eigenvalue over the largest, of central differences of the forces of what can move."""
    position = scene.packing.position_nd
    moves = np.ones(len(position), dtype=bool)
    for one in scene.effects:
        if isinstance(one, pm.FixedParticles):
            moves[list(one.particles)] = False
    rows = []
    for n, a in np.argwhere(np.repeat(moves[:, None], position.shape[1], axis=1)):
        aside = np.zeros_like(position)
        aside[n, a] = step
        back, ahead = (
            pm.forces(scene.replace(packing=scene.packing.replace(position_nd=position + sign * aside)))[moves].ravel()
            for sign in (-1.0, 1.0)
        )
        rows.append((back - ahead) / (2.0 * step))
    eigenvalue = np.linalg.eigvalsh(0.5 * (np.array(rows) + np.array(rows).T))
    return eigenvalue[0] / max(eigenvalue[-1], 1e-300)


def row(count, overlap, dimension=2, effects=HARMONIC):
    """Return discs or spheres in a straight row around the box, which has room for them to part."""
    position = np.full((count, dimension), 1.5)
    position[:, 0] = np.arange(count) + 0.5
    box = pm.Box(np.diag([float(count)] + [3.0] * (dimension - 1)))
    return pm.Scene(pm.Packing(position, np.full(count, 0.5 * (1.0 + overlap)), box), effects)


def strip(count, rows, overlap):
    """Return rows of discs as in the triangular crystal, with nothing above and below."""
    place = [[0.5 + i + 0.5 * (r % 2), 1.0 + r * np.sqrt(0.75)] for r in range(rows) for i in range(count)]
    box = pm.Box(np.diag([float(count), rows + 3.0]))
    return pm.Scene(pm.Packing(place, np.full(len(place), 0.5 * (1.0 + overlap)), box), HARMONIC)


@pytest.mark.parametrize("method", [None, pm.Fire(), pm.LBFGS(), pm.Newton()], ids=lambda one: type(one).__name__)
@pytest.mark.parametrize(("count", "overlap"), [(6, 0.05), (5, 0.01)])
def test_a_pressed_straight_row_buckles_until_nothing_touches(count, overlap, method):
    scene = row(count, overlap)
    run = pm.quench(scene, force_tolerance=1e-10, method=method)
    assert run.outcome is pm.Outcome.UNJAMMED
    assert pm.energy(scene.replace(packing=run.packing)) == pytest.approx(0.0, abs=1e-28)


def test_a_pressed_straight_row_in_space_buckles_until_nothing_touches():
    scene = row(6, 0.05, dimension=3)
    run = pm.quench(scene, force_tolerance=1e-10)
    assert run.outcome is pm.Outcome.UNJAMMED and pm.energy(scene.replace(packing=run.packing)) == 0.0


def test_a_row_buckles_at_a_loose_tolerance_too():
    scene = row(6, 0.05)
    run = pm.quench(scene, force_tolerance=1e-3, method=pm.Fire())
    assert pm.energy(scene.replace(packing=run.packing)) == 0.0


@pytest.mark.parametrize("rows", [2, 3])
def test_pressed_strips_of_a_triangular_crystal_part(rows):
    scene = strip(6, rows, 0.04)
    run = pm.quench(scene, force_tolerance=1e-10)
    assert pm.energy(scene.replace(packing=run.packing)) == pytest.approx(0.0, abs=1e-28)


@pytest.mark.parametrize("method", [None, pm.Fire(), pm.LBFGS(), pm.Newton()], ids=lambda one: type(one).__name__)
def test_a_square_crystal_ends_in_a_minimum(method):
    square = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    run = pm.quench(pm.Scene(square, HARMONIC), force_tolerance=1e-10, method=method)
    assert run.ok and run.report["negative_modes"] == 0
    assert lowest_over_largest(pm.Scene(run.packing, HARMONIC)) > LOWEST


def test_two_discs_stacked_under_gravity_end_side_by_side_on_the_floor():
    stacked = pm.Packing([[2.0, 0.5], [2.0, 1.47]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    effects = (pm.Repulsion(pm.LinearSpring()), pm.Gravity(0.0, -1e-2), pm.Walls(1, 0.0, 4.0))
    run = pm.quench(pm.Scene(stacked, effects), force_tolerance=1e-10)
    (x, y), (other_x, other_y) = run.packing.position_nd
    assert run.ok and run.outcome is not pm.Outcome.UNJAMMED
    assert y == pytest.approx(other_y, abs=1e-9) and abs(x - other_x) > 0.99


def test_a_disc_balanced_on_a_held_one_falls_to_the_floor():
    balanced = pm.Packing([[2.0, 0.5], [2.0, 1.49]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    effects = (
        pm.Repulsion(pm.LinearSpring()), pm.Gravity(0.0, -1e-2), pm.Walls(1, 0.0, 4.0), pm.FixedParticles((0,)),
    )  # fmt: skip
    run = pm.quench(pm.Scene(balanced, effects), force_tolerance=1e-10)
    assert run.ok and run.packing.position_nd[1, 1] < 0.5
    np.testing.assert_array_equal(run.packing.position_nd[0], [2.0, 0.5])


def test_a_disc_pressed_between_two_held_ones_leaves_them():
    place = [[1.0, 2.0], [2.0, 2.0], [3.0, 2.0]]
    scene = pm.Scene(
        pm.Packing(place, [0.5, 0.55, 0.5], pm.Box.cubic(5.0, 2)), (pm.Repulsion(), pm.FixedParticles((0, 2)))
    )
    run = pm.quench(scene, force_tolerance=1e-10)
    assert run.outcome is pm.Outcome.UNJAMMED and pm.energy(scene.replace(packing=run.packing)) == 0.0


def test_ellipses_end_to_end_turn_aside():
    director = np.tile([1.0, 0.0], (3, 1))
    shapes = pm.Spheroids(np.full(3, 2.0), director)
    length = 1.94 * float(shapes.semi_axes(0.5)[0][0])
    place = np.column_stack([length * (np.arange(3) + 0.5), np.full(3, 2.5)])
    scene = pm.Scene(pm.Packing(place, np.full(3, 0.5), pm.Box(np.diag([3.0 * length, 5.0])), shapes=shapes), HARMONIC)
    run = pm.quench(scene, force_tolerance=1e-10)
    assert run.ok and pm.energy(scene.replace(packing=run.packing)) == pytest.approx(0.0, abs=1e-28)


def test_linked_dimers_in_a_straight_row_fold():
    x = np.array([0.2, 1.2, 2.15, 3.15])
    links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    packing = pm.Packing(np.column_stack([x, np.full(4, 2.0)]), np.full(4, 0.5), pm.Box(np.diag([3.9, 4.0])), links)
    run = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-10)
    assert run.ok and pm.energy(pm.Scene(run.packing, HARMONIC)) == pytest.approx(0.0, abs=1e-28)


def test_translations_and_rattlers_are_no_saddles():
    crystal = pm.lattice_packing("triangular", repeats=(6, 6), relative_overlap=0.03)
    gone = np.arange(36) != 14
    place = np.vstack([crystal.position_nd[gone], crystal.position_nd[14] + 0.03])
    packing = pm.Packing(place, np.append(crystal.radius_n[gone], 0.05), crystal.box)
    run = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-11)
    assert run.ok and run.report["negative_modes"] == 0
    assert not any("saddle" in stage.name for stage in run.stages)


def test_a_place_whose_second_derivative_cannot_be_factored_is_no_minimum_alone_or_in_a_batch(monkeypatch):
    def singular(scene):
        raise NotDefinite("matrix must be nonsingular")

    scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), HARMONIC)
    batch = pm.QuenchBatch(scene)
    batch.step([0.0], [0.0])
    assert batch.outcome(0) is pm.Outcome.CONVERGED
    monkeypatch.setattr("packmech.mechanics.stability.curvature_of", singular)
    assert stability(scene).negative is None and stability(scene).unstable == 1
    batch.step([0.0], [0.0])
    assert batch.outcome(0) is pm.Outcome.UNSTABLE
    assert newton(scene, force_tolerance=1e-10, check=False).outcome is pm.Outcome.UNSTABLE


@pytest.mark.parametrize("method", [None, pm.Fire()], ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("seed", range(4))
def test_random_packings_end_in_minima_their_rattlers_among_them(seed, method):
    packing = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.88, seed=seed)
    run = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-10, method=method)
    assert run.ok and lowest_over_largest(pm.Scene(run.packing, HARMONIC), 1e-8) > LOWEST


def test_the_way_off_a_saddle_has_the_same_bits_every_time():
    one, two = (pm.quench(row(6, 0.05), force_tolerance=1e-10).packing.position_nd for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_a_batch_calls_a_saddle_unstable():
    batch = pm.QuenchBatch(row(6, 0.05))
    batch.step([0.0], [0.0])
    assert batch.outcome(0) is pm.Outcome.UNSTABLE


@pm.effect
class Bowl(NamedTuple):
    """A potential of single particles whose second derivative is not given."""

    depth: float = 0.1

    def body_force(
        self, x: float, y: float, z: float, u: float, v: float, w: float, mass: float, radius: float
    ) -> tuple[float, float, float]:
        return 0.0, -self.depth * (y - 1.5), 0.0

    def body_energy(self, x: float, y: float, z: float, mass: float, radius: float) -> float:
        return 0.5 * self.depth * (y - 1.5) ** 2


def test_a_row_in_a_potential_without_a_second_derivative_buckles_in_zigzag():
    scene = row(6, 0.05, effects=(pm.Repulsion(), Bowl()))
    run = pm.quench(scene, force_tolerance=1e-8)
    assert run.report == {"negative_modes": 0}
    # a bead at a height h from the middle is pulled back by depth h and pushed by both neighbors at 2 h
    sideways = run.packing.position_nd[:, 1] - 1.5
    height = float(np.abs(sideways).mean())
    np.testing.assert_allclose(sideways, np.sign(sideways[0]) * height * np.array([1, -1] * 3), rtol=1e-6)
    distance = np.hypot(1.0, 2.0 * height)
    push = (1.0 - distance / 1.05) / 1.05
    assert 2.0 * push * 2.0 * height / distance == pytest.approx(0.1 * height, rel=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("apart", [0.0, 1e-150, 1e-12, 1e-3])
def test_coincident_centers_part_under_a_law_that_diverges(apart, dimension):
    place = np.ones((3, dimension))
    place[1, 0] += apart
    place[2] += 1.3
    packing = pm.Packing(place, np.full(3, 0.5), pm.Box.cubic(4.0, dimension))
    scene = pm.Scene(packing, (pm.Repulsion(pm.DivergentRepulsion()),))
    run = pm.quench(scene, force_tolerance=1e-8, step_limit=2000)
    assert run.outcome is pm.Outcome.UNJAMMED and np.isfinite(run.packing.position_nd).all()


@pytest.mark.parametrize("law", [pm.DivergentRepulsion(), pm.Harmonic()], ids=lambda one: type(one).__name__)
def test_coincident_centers_part_under_newtons_method(law):
    packing = pm.Packing(np.ones((5, 2)), np.full(5, 0.5), pm.Box.cubic(5.0, 2))
    run = pm.quench(pm.Scene(packing, (pm.Repulsion(law),)), force_tolerance=1e-8, method=pm.Newton())
    assert run.outcome is pm.Outcome.UNJAMMED


@pytest.mark.parametrize("tolerance", [0.3, 0.1, 0.03])
def test_what_is_not_yet_at_rest_is_no_saddle_and_a_loose_tolerance_costs_less_than_a_tight_one(tolerance):
    for seed in range(4):
        packing = pm.random_packing(64, dimension=2, packing_fraction=0.9, seed=seed)
        loose, tight = (
            pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=one) for one in (tolerance, 1e-6)
        )
        assert loose.ok and loose.residual <= tolerance and loose.report["negative_modes"] == 0
        assert not any("saddle" in stage.name for stage in loose.stages)
        assert loose.steps < tight.steps
