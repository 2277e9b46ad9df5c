"""Tangential displacements: one name for a contact seen from either end, and what a packing does with them."""

from __future__ import annotations

import numpy as np
import pytest

import packmech as pm


def _packing() -> pm.Packing:
    springs = pm.TangentialDisplacements([0, 2], [1, 0], [[0, 0], [1, 0]], [[0.01], [-0.02]])
    return pm.Packing([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [0.5, 0.5, 0.5], pm.Box.cubic(3.0, 2), tangential=springs)


def test_contacts_are_named_from_one_end() -> None:
    """The vector of space turns round with the contact; in the plane the tangent does, and its component stays."""
    plane = pm.TangentialDisplacements([3, 1], [1, 2], [[1, 0], [0, 0]], [[0.3], [0.1]])
    assert plane.i_c.tolist() == [1, 1] and plane.j_c.tolist() == [2, 3]
    assert plane.image_cd.tolist() == [[0, 0], [-1, 0]] and plane.displacement_ck.tolist() == [[0.1], [0.3]]
    space = pm.TangentialDisplacements([3], [1], [[0, 0, 0]], [[0.3, 0.0, -0.1]])
    assert space == pm.TangentialDisplacements([1], [3], [[0, 0, 0]], [[-0.3, 0.0, 0.1]])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0], [1], [[0, 0]], [[0.1, 0.2, 0.3]]), r"displacement_ck must have shape \(1, 1\)"),
        (([0, 1], [1, 0], [[0, 0], [0, 0]], [[0.1], [0.1]]), "contacts must name each pair once, got 0-1"),
        (([0], [0], [[0, 0]], [[0.1]]), "image_cd must not be zero for a contact of a particle with itself"),
        (([0.5], [1], [[0, 0]], [[0.1]]), "i_c must hold whole numbers, got 0.5 for contact 0"),
        (([0], [1], [[0, 0]], [[np.nan]]), "displacement_ck must be finite"),
    ],
)
def test_wrong_displacements_are_named(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pm.TangentialDisplacements(*arguments)  # type: ignore[arg-type]


def test_a_packing_keeps_them_only_where_it_stands() -> None:
    packing = _packing()
    assert packing.tangential is not None
    assert packing.replace(mass_n=[1.0, 1.0, 1.0]).tangential == packing.tangential
    assert packing.replace(position_nd=packing.position_nd + 0.1).tangential is None
    assert packing.replace(radius_n=packing.radius_n * 1.1).tangential is None
    assert packing.replace(box=pm.Box.cubic(4.0, 2)).tangential is None
    assert packing != packing.replace(tangential=None)


def test_wrapping_and_selecting_carry_them_along() -> None:
    packing = _packing()
    away = packing.replace(
        position_nd=packing.position_nd + np.array([[0.0, 0.0], [3.0, 0.0], [0.0, -3.0]]),
        tangential=pm.TangentialDisplacements([0, 0], [1, 2], [[-1, 0], [-1, 1]], [[0.01], [-0.02]]),
    )
    assert away.wrapped().tangential == packing.tangential
    kept = packing.select(np.array([0, 2])).tangential
    assert kept == pm.TangentialDisplacements([0], [1], [[-1, 0]], [[-0.02]])
    assert packing.select(np.array([1, 2])).tangential is None
    assert packing.select(np.array([True, True, False])).tangential == pm.TangentialDisplacements(
        [0], [1], [[0, 0]], [[0.01]]
    )


def test_particles_that_are_not_there_are_named() -> None:
    springs = pm.TangentialDisplacements([0], [7], [[0, 0]], [[0.1]])
    with pytest.raises(ValueError, match="tangential must name particles below 3, got 7"):
        _packing().replace(tangential=springs)
