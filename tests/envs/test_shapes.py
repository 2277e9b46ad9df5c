"""Environments of ellipses, spheroids and rigid bodies: what is observed of their turns, bits, pictures, recordings."""

import math
import warnings
from functools import cache

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from packmech_envs.batched import QuenchVectorEnv, ShearVectorEnv
from packmech_envs.recorder import RerunRecorder
from packmech_envs.single import QuenchEnv, ShearEnv

import packmech as pm

KINDS = {
    "ellipses": (2, pm.Ellipses(aspect=1.5), 0.85),
    "dimers": (2, pm.Dimer(), 0.8),
}
SLOW = {"spheroids": (3, pm.Ellipses(aspect=0.7), 0.6), "trimers": (3, pm.Trimer(), 0.6)}


@cache
def scene(kind, effects=()):
    dimension, shapes, fraction = {**KINDS, **SLOW}[kind]
    packing = pm.random_packing(10, dimension=dimension, shapes=shapes, packing_fraction=fraction, seed=4)
    return pm.Scene(packing, (pm.Repulsion(), *effects))


@cache
def sheared(dimension=2):
    kind = "ellipses" if dimension == 2 else "spheroids"
    start = scene(kind).replace(effects=(pm.Repulsion(), pm.ContactDamping(0.5), pm.Friction(0.3)))
    packing = start.packing
    dense = pm.scattered_packing(packing, packing_fraction=0.95 if dimension == 2 else 0.75, seed=1)
    return start.replace(packing=dense)


def checked(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*A Box observation space m")
        warnings.filterwarnings("ignore", message=".*we recommend using a symmetric and normalized space")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


MADE = {
    **{f"quench {kind}": lambda kind=kind, **how: QuenchEnv(scene(kind), orientations=True, **how) for kind in KINDS},
    "shear ellipses": lambda **how: ShearEnv(sheared(), frame_skip=3, orientations=True, **how),
}
MADE_SLOW = {
    **{f"quench {kind}": lambda kind=kind, **how: QuenchEnv(scene(kind), orientations=True, **how) for kind in SLOW},
    "shear spheroids": lambda **how: ShearEnv(sheared(3), frame_skip=3, orientations=True, **how),
}
ALL = [*MADE, *(pytest.param(name, marks=pytest.mark.slow) for name in MADE_SLOW)]


def made(name, **how):
    return {**MADE, **MADE_SLOW}[name](**how)


@pytest.mark.parametrize("name", ALL)
def test_the_checker_passes(name):
    checked(made(name))


@pytest.mark.parametrize("name", ALL)
def test_observations_say_how_particles_are_turned(name):
    env = made(name)
    env.reset(seed=3)
    env.action_space.seed(1)
    for _ in range(3):
        observation, *_ = env.step(0.1 * env.action_space.sample())
    seen = dict(zip(env.observation_names, observation, strict=True))
    shapes = env.packing.shapes
    order = pm.nematic_order(env.packing).tensor_dd
    for name, value in seen.items():
        if name.startswith("order_"):
            a, b = ("xyz".index(letter) for letter in name[-2:])
            assert value == order[a, b]
    each = [value for name, value in seen.items() if name.startswith(("director_", "axis_", "quaternion_"))]
    given = np.reshape(each, shapes.orientation_nq.shape)
    assert shapes.oriented(given).rotation_since(shapes) == pytest.approx(0.0, abs=1e-14)
    assert env.observation_space.contains(observation)


def test_bodies_without_one_longest_axis_have_no_order_and_are_seen_each():
    corner = 0.3 * np.array([[np.cos(t), np.sin(t)] for t in 2.0 * np.pi / 3.0 * np.arange(3)])
    place = np.concatenate([corner + center for center in ([1.0, 1.0], [3.0, 1.0], [1.0, 3.0], [3.0, 3.0])])
    beads = pm.Packing(place, np.full(12, 0.4), pm.Box.cubic(4.0, 2))
    start = pm.Scene(pm.rigid_packing(beads, np.repeat(np.arange(4), 3)), (pm.Repulsion(),))
    env = QuenchEnv(start, orientations=True)
    observation, _ = env.reset(seed=1)
    assert not [name for name in env.observation_names if name.startswith("order")]
    assert np.array_equal(observation[-8:], env.packing.shapes.orientation_nq.ravel())


def test_without_shapes_nothing_is_added_and_directions_of_each_are_refused():
    assert not [name for name in QuenchEnv().observation_names if name.startswith("order")]
    with pytest.raises(ValueError, match="orientations must be left out for a scene of discs or spheres"):
        QuenchEnv(orientations=True)
    with pytest.raises(ValueError, match="orientations must be left out for a scene of discs or spheres"):
        ShearEnv("triangular", orientations=True)


def rows(env, seed, actions):
    observation, info = env.reset(seed=seed)
    found = [observation.tobytes()]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        found.append((observation.tobytes(), np.float64(reward).tobytes(), terminated, truncated))
        if terminated:
            break
    return found


@pytest.mark.parametrize("name", ALL)
def test_a_batch_has_the_bits_of_single_environments(name):
    env = made(name)
    rng = np.random.default_rng(5)
    low, high = env.action_space.low, env.action_space.high
    actions = rng.uniform(0.3 * low, 0.3 * high, (5, 3, len(low)))
    kind = QuenchVectorEnv if name.startswith("quench") else ShearVectorEnv
    given = scene(name.split()[1]) if kind is QuenchVectorEnv else sheared(2 if "ellipses" in name else 3)
    how = {} if kind is QuenchVectorEnv else {"frame_skip": 3}
    for threads in (1, 2):
        envs = kind(3, given, orientations=True, threads=threads, autoreset_mode="Disabled", **how)
        observations, _ = envs.reset(seed=7)
        found = [[observations[b].tobytes()] for b in range(3)]
        for step in range(5):
            observations, rewards, terminated, truncated, _ = envs.step(actions[step])
            for b in range(3):
                found[b].append((observations[b].tobytes(), rewards[b].tobytes(), terminated[b], truncated[b]))
            assert not terminated.any()
        for b in range(3):
            assert rows(env, 7 + b, actions[:, b]) == found[b]


@pytest.mark.parametrize("name", MADE)
def test_pictures_and_recordings_show_shapes_and_change_no_bit(name, tmp_path):
    actions = np.random.default_rng(2).uniform(-0.01, 0.01, (3, *made(name).action_space.shape))
    bare = rows(made(name), 4, actions)
    drawn = made(name, render_mode="rgb_array")
    assert rows(drawn, 4, actions) == bare
    picture = drawn.render()
    now = drawn.packing
    assert np.array_equal(picture, pm.draw_frame(now, effects=drawn.scene.effects))
    # another picture than that of discs of these areas
    assert not np.array_equal(picture, pm.draw_frame(now.replace(shapes=None), effects=drawn.scene.effects))
    recorded = RerunRecorder(made(name), tmp_path)
    assert rows(recorded, 4, actions) == bare
    recorded.close()
    files = list(tmp_path.glob("*.rrd"))
    assert len(files) == 1 and files[0].stat().st_size > 1000


def test_ellipses_that_are_jammed_by_the_verdict_end_the_episode():
    """One that is jammed by the verdict ends the episode, though it has fewer contacts than degrees of freedom."""
    start = scene("ellipses")
    jammed = pm.jam(start, pressure=1e-4, strain="isotropic").packing
    env = QuenchEnv(
        start.replace(packing=jammed), start="scene", largest_pressure=2e-4, force_tolerance=1e-8, step_budget=30
    )
    observation, info = env.reset(seed=1)
    assert 0.0 < info["pressure"] / env.scene.pressure_unit <= 2e-4
    assert info["jammed"] == (pm.classify_jamming(env.scene.replace(packing=env.packing)).collective == "jammed")
    assert info["jammed"]


def test_the_stress_of_ellipses_that_are_sheared_is_that_of_the_packing():
    env = ShearEnv(sheared(), frame_skip=1, control="strain", relax=True)
    observation, _ = env.reset(seed=1)
    seen = dict(zip(env.observation_names, observation, strict=True))
    here = env.scene.without(pm.Friction, pm.ContactDamping).replace(packing=env.packing.replace(tangential=None))
    assert seen["pressure"] == pytest.approx(pm.pressure(here), rel=1e-9)
    assert seen["contacts"] == len(env.contacts())
    assert math.isfinite(seen["stress_xy"])


def test_rigid_bodies_are_quenched_and_not_sheared():
    with pytest.raises(ValueError, match="Beads"):
        ShearEnv(scene("dimers"))
    made = gym.make("packmech_envs:packmech/Quench-v0", scene=scene("dimers"))
    made.reset(seed=1)
    assert isinstance(made.unwrapped.packing.shapes, pm.Beads)
