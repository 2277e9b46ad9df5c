"""Effects and laws are plain tuples of numbers: a scene checks them, and their docstrings say so."""

import inspect

import pytest

import packmech as pm

# each with a number that no such record may have
WRONG = (
    pm.BackgroundDamping(-1.0),
    pm.ContactDamping(-1.0),
    pm.Friction(-0.1),
    pm.Friction(0.5, stiffness=pm.Mindlin(4.0)),
    pm.Friction(0.5, damping=pm.DampingRatio(-1.0)),
    pm.Gravity(float("nan")),
    pm.Langevin(-1.0),
    pm.Repulsion(pm.Harmonic(-1.0)),
    pm.Repulsion(pm.PowerLaw(1.0, 1.2)),
    pm.Restitution(3.0),
    pm.RollingResistance(-1.0),
    pm.Walls(5),
)


@pytest.mark.parametrize("wrong", WRONG, ids=repr)
def test_a_scene_refuses_what_a_record_lets_pass(wrong):
    packing = pm.lattice_packing("square", repeats=(4, 4))
    effects = (wrong,) if isinstance(wrong, pm.Repulsion) else (pm.Repulsion(), wrong)
    with pytest.raises(ValueError, match=r"^effects\[[01]\]\.\w+.* (must|from) "):
        pm.Scene(packing, effects)


def test_every_record_that_cannot_check_its_numbers_says_who_does():
    records = [one for _, one in inspect.getmembers(pm, inspect.isclass) if issubclass(one, tuple)]
    # what effects are told
    given = (pm.TouchingPair, pm.Partners)
    effects = [one for one in records if one.__module__.startswith("packmech.effects") and one not in given]
    assert len(effects) > 20
    silent = [one.__name__ for one in effects if "checked when a `Scene` is made with it" not in (one.__doc__ or "")]
    assert not silent


def test_walls_across_an_axis_by_letter_are_told_its_number():
    with pytest.raises(ValueError, match=r"effects\[0\].axis must be 0, 1 or 2, for x, y or z, got 'y'"):
        pm.Scene(pm.lattice_packing("square"), (pm.Walls(axis="y", low=0.0, high=0.5),))


def test_walls_across_an_axis_that_the_packing_lacks_are_refused():
    packing = pm.lattice_packing("triangular", repeats=(4, 4))
    with pytest.raises(ValueError, match=r"effects\[1\]\.axis must be 0 or 1 in a plane, got 2"):
        pm.Scene(packing, (pm.Repulsion(), pm.Walls(2, 0.0, 1.0)))


def test_gravity_acts_along_what_is_named_and_down_where_nothing_is():
    assert tuple(pm.Gravity()) == (0.0, -1.0, 0.0)
    assert tuple(pm.Gravity(z=-9.81)) == (0.0, 0.0, -9.81)
    assert tuple(pm.Gravity(0.5)) == (0.5, 0.0, 0.0)
    assert tuple(pm.Gravity(0.0, -0.1)) == (0.0, -0.1, 0.0)
    assert pm.Gravity()._replace(y=-2.0) == pm.Gravity(y=-2.0)
