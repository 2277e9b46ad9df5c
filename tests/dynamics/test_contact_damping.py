"""Facts about dashpots between touching particles: how they set in, and the order that this leaves."""

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.integrators import choose_time_step


def collided(effects, gap, dt):
    """Return the distance of two discs that met, and how fast they part."""
    packing = pm.Packing([[4.0, 5.0], [5.0 + gap, 5.0]], [0.5, 0.5], pm.Box.cubic(10.0, 2))
    scene = pm.Scene(packing, effects)
    run = pm.simulate(scene, duration=6.0, dt=dt, velocity_nd=[[0.1, 0.0], [-0.1, 0.0]])
    return np.array([np.diff(run.packing.position_nd[:, 0])[0], np.diff(run.velocity_nd[:, 0])[0]])


def order(damping):
    """Return the order of the error after a collision, over starts that meet a step anywhere."""
    effects = (pm.Repulsion(), damping)
    gaps = 0.05 + 0.1 * np.modf(0.6180339887 * np.arange(24))[0]
    steps = 2.0 ** -np.arange(4, 9)
    fine = [collided(effects, gap, 2.0**-13) for gap in gaps]
    error = [
        np.sqrt(np.mean([(collided(effects, gap, dt) - exact) ** 2 for gap, exact in zip(gaps, fine, strict=True)]))
        for dt in steps
    ]
    return np.polyfit(np.log(steps), np.log(error), 1)[0]


def test_a_dashpot_that_jumps_leaves_velocity_verlet_at_first_order_across_a_collision():
    assert order(pm.ContactDamping(0.4)) == pytest.approx(1.0, abs=0.15)


def test_a_smooth_onset_restores_second_order_across_a_collision():
    assert order(pm.ContactDamping(0.4, onset="smooth")) == pytest.approx(2.0, abs=0.15)


def test_a_smooth_dashpot_vanishes_at_contact_and_is_half_at_its_onset():
    dashpot = pm.ContactDamping(0.3, onset=0.02)
    touching = pm.TouchingPair(2.0, 2.0, rate=1.0, energy=0.0, first=0.0, second=0.0, mass=1.0, effective_radius=1.0)
    assert dashpot.pair_damping(touching) == 0.0
    assert dashpot.pair_damping(touching._replace(distance=1.96)) == pytest.approx(0.15, rel=1e-12)


def test_onset_by_name_is_a_number_in_scenes_and_their_files(tmp_path):
    packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.ContactDamping(0.3, onset="smooth")))
    assert scene.effects[1].onset == 0.01
    pm.write_scene(scene, tmp_path / "scene.toml")
    assert pm.read_scene(tmp_path / "scene.toml").effects == scene.effects
    text = (tmp_path / "scene.toml").read_text()
    (tmp_path / "scene.toml").write_text(text.replace("onset = 0.01", 'onset = "smooth"'))
    assert pm.read_scene(tmp_path / "scene.toml").effects == scene.effects


def chosen(*effects, distance=0.9):
    """Return the time step that is chosen for two discs of mass 1, over the method's fraction of it."""
    packing = pm.Packing([[4.0, 5.0], [4.0 + distance, 5.0]], [0.5, 0.5], pm.Box.cubic(10.0, 2), mass_n=[1.0, 1.0])
    return choose_time_step(pm.Scene(packing, effects), 0.01) / 0.01


def bond(**numbers):
    return pm.Bonds([0], [1], [[0, 0]], [1.0], **numbers)


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        # a tangential spring turns discs as well: 1 + m r^2 / I = 3 times its stiffness
        ((pm.Friction(0.5, stiffness=4.0),), 12.0**-0.5),
        ((pm.Friction(0.5, stiffness=0.1, damping=20.0),), 1.0 / 60.0),
        ((bond(compression=pm.LinearSpring(9.0)),), 9.0**-0.5),
        ((bond(tension=pm.LinearSpring(16.0)),), 16.0**-0.5),
        ((bond(tangential_stiffness=12.0),), 36.0**-0.5),
        ((bond(damping=50.0),), 1.0 / 50.0),
        ((bond(tangential_damping=50.0),), 1.0 / 150.0),
        ((pm.BackgroundDamping(8.0),), 1.0 / 8.0),
        # dashpots and drag slow the same motion
        ((pm.ContactDamping(5.0), pm.BackgroundDamping(8.0)), 1.0 / 13.0),
        # a wall is a mirror: the step is that of a particle and its image
        ((pm.Walls(1.0, 0.0, 10.0, law=pm.LinearSpring(8.0)),), 8.0**-0.5),
        ((pm.Walls(1.0, 0.0, 10.0, damping=30.0),), 1.0 / 30.0),
        ((pm.Gravity(),), 1.0),
    ],
    ids=lambda value: "" if isinstance(value, float) else "-".join(type(one).__name__ for one in value),
)
def test_time_step_follows_whatever_is_stiffest_or_most_damped(effects, expected):
    assert chosen(pm.Repulsion(), *effects) == pytest.approx(expected, rel=1e-12)
