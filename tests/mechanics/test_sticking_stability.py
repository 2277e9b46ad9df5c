"""Facts about packings with friction that stand: what rolls, what buckles where all contacts stick."""

import numpy as np
import pytest

import packmech as pm
from packmech.mechanics import stability as module
from packmech.mechanics.stability import stability


@pytest.mark.parametrize("dense", [10, 10_000])
@pytest.mark.parametrize(("stiffness", "stands"), [(1e-3, False), (0.5, True)])
def test_springs_that_are_stiff_enough_hold_a_square_crystal(monkeypatch, dense, stiffness, stands):
    monkeypatch.setattr(module, "_DENSE", dense)
    square = pm.lattice_packing("square", repeats=(6, 6), relative_overlap=0.1)
    scene = pm.Scene(square, (pm.Repulsion(), pm.Friction(0.5, stiffness=stiffness)))
    negative = stability(scene).negative
    # as many as the symmetric matrix has, which no tangential force spoils here
    matrix = pm.stiffness_matrix(scene, "none")
    values = np.linalg.eigvalsh(matrix.toarray())
    assert negative == int((values < -1e-6).sum())
    assert (negative == 0) == stands
    # forces that do not balance bend contacts by four times their size over the radius: more than any curvature here
    assert stability(scene, unbalanced=1.0).negative == 0


@pytest.mark.parametrize("side", [0.0, 0.2])
def test_a_disc_in_the_cradle_of_two_stands_and_on_one_rolls(side):
    # held discs so far apart; the third rests on both, or on top of one
    pull, apart = 1e-4, 1.0 + side
    mass = np.pi / 4.0
    held = [[2.0, 1.0], [2.0 + apart, 1.0]]
    run = pm.quench(
        pm.Scene(
            pm.Packing([*held, [2.0 + 0.5 * apart, 1.9]], [0.5] * 3, pm.Box.cubic(8.0, 2)),
            (pm.Repulsion(), pm.Gravity(0.0, -pull), pm.FixedParticles((0, 1))),
        ),
        force_tolerance=1e-10,
    )
    effects = (pm.Repulsion(), pm.Friction(0.5), pm.Gravity(0.0, -pull))
    cradle = pm.Scene(run.packing, (*effects, pm.FixedParticles((0, 1))))
    assert stability(cradle).negative == 0
    on_top = pm.Packing([[2.0, 1.0], [2.0, 2.0 - pull * mass]], [0.5] * 2, pm.Box.cubic(8.0, 2))
    assert stability(pm.Scene(on_top, (*effects, pm.FixedParticles((0,))))).negative == 1
