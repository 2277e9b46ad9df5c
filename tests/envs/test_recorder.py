"""Facts about recorders: which episodes are recorded, what a file holds, and that nothing recorded is changed."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import NormalizeObservation, TimeLimit
from packmech_envs.recorder import RerunRecorder, RerunVectorRecorder, cubes_and_thousands

import packmech as pm

START = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))


class Shaken(gym.Env):
    """A crystal whose particles an action and the generator shake; an episode has five steps."""

    observation_names, action_names = ("height", "noise"), ("push",)

    def __init__(self, steps=5):
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (2,), np.float64)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (1,), np.float64)
        self.steps, self.fails = steps, False

    @property
    def scene(self):
        return START

    @property
    def packing(self):
        return START.packing.replace(position_nd=START.packing.position_nd + 0.01 * self.height)

    def _seen(self):
        return np.array([self.height, self.np_random.random()])

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.height, self.count = 0.0, 0
        return self._seen(), {"time": 0.0, "reason": "none"}

    def step(self, action):
        if self.fails:
            raise FloatingPointError("shaken to pieces")
        self.height += float(action[0]) + 0.1 * self.np_random.random()
        self.count += 1
        return self._seen(), self.height, self.count >= self.steps, False, {"time": 0.5 * self.count}


def read_back(path):
    """Return {entity column: {step: value}} of a recording, and how many layouts it has."""
    import rerun.chunk as chunk

    found, reader = {}, chunk.RrdReader(path)
    for piece in reader.stream().to_chunks():
        batch = piece.to_record_batch()
        if "step" not in batch.schema.names:
            continue
        for name in set(batch.schema.names) - {"log_time", "log_tick", "time", "step", "rerun.controls.RowId"}:
            rows = zip(batch.column("step").to_pylist(), batch.column(name).to_pylist(), strict=True)
            found.setdefault(f"{piece.entity_path} {name.partition(':')[2] or name}", {}).update(rows)
    return found, len(reader.blueprints())


def play(env, episodes=3, seed=7):
    """Play whole episodes with random actions; return all that was seen."""
    env.action_space.seed(3)
    seen = []
    for episode in range(episodes):
        observation, _ = env.reset(seed=seed if episode == 0 else None)
        seen.append(observation.tobytes())
        over = False
        while not over:
            observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
            seen.append((observation.tobytes(), float(reward), terminated, truncated, sorted(info)))
            over = terminated or truncated
    return seen


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_every_episode_whose_number_the_trigger_likes_is_a_file_with_all_of_its_frames(tmp_path):
    env = RerunRecorder(Shaken(), tmp_path / "new", episode_trigger=lambda episode: episode % 2 == 0)
    play(env, episodes=4)
    env.close()
    assert names(tmp_path / "new") == ["packmech-episode-0.rrd", "packmech-episode-2.rrd"]
    for path in (tmp_path / "new").iterdir():
        found, layouts = read_back(path)
        assert sorted(found["/state/position position_nd"]) == list(range(6))
        assert layouts == 1


def test_a_file_holds_observations_actions_rewards_and_infos_by_name(tmp_path):
    env = RerunRecorder(Shaken(), tmp_path)
    first, _ = env.reset(seed=1)
    second, reward, *_ = env.step(np.array([0.25]))
    env.step(np.array([-0.5]))
    env.close()
    found, _ = read_back(tmp_path / "packmech-episode-0.rrd")
    assert found["/series/height scalars"][0] == [first[0]] and found["/series/noise scalars"][1] == [second[1]]
    assert found["/series/action_push scalars"] == {1: [0.25], 2: [-0.5]}
    assert found["/series/reward scalars"][1] == [reward]
    assert found["/series/time scalars"] == {0: [0.0], 1: [0.5], 2: [1.0]}
    assert sum(value[0] for value in found["/series/reward scalars"].values()) == pytest.approx(
        found["/series/return scalars"][2][0]
    )
    assert not any("reason" in name for name in found)


def test_observations_that_a_wrapper_has_changed_are_not_told_under_their_old_names(tmp_path):
    env = RerunRecorder(NormalizeObservation(Shaken()), tmp_path)
    env.reset(seed=1)
    env.step(np.array([0.25]))
    env.close()
    found, _ = read_back(tmp_path / "packmech-episode-0.rrd")
    assert "/series/height scalars" not in found and "/series/action_push scalars" in found


def test_recording_changes_no_bit_of_what_is_seen(tmp_path):
    bare = play(Shaken())
    assert play(RerunRecorder(Shaken(), tmp_path / "a", episode_trigger=lambda episode: True)) == bare
    assert play(RerunRecorder(Shaken(), tmp_path / "b", step_trigger=lambda step: step == 4)) == bare
    assert play(TimeLimit(RerunRecorder(Shaken(), tmp_path / "c"), 100)) == bare


def test_a_step_can_start_a_recording_and_its_length_may_span_episodes(tmp_path):
    env = RerunRecorder(Shaken(), tmp_path, step_trigger=lambda step: step in (3, 9), recording_length=4)
    play(env, episodes=4)
    env.close()
    assert names(tmp_path) == ["packmech-step-3.rrd", "packmech-step-9.rrd"]
    found, _ = read_back(tmp_path / "packmech-step-3.rrd")
    # steps 3 and 4, the start of the next episode, and its steps 5 and 6
    assert sorted(found["/state/position position_nd"]) == list(range(5))
    assert sorted(found["/series/action_push scalars"]) == [0, 1, 3, 4]


def test_unless_said_otherwise_cubes_and_thousands_are_recorded():
    recorded = [episode for episode in range(3001) if cubes_and_thousands(episode)]
    assert recorded == [0, 1, 8, 27, 64, 125, 216, 343, 512, 729, 1000, 2000, 3000]


def test_an_exception_in_a_step_leaves_a_complete_file_and_comes_through(tmp_path):
    env = RerunRecorder(Shaken(), tmp_path)
    env.reset(seed=1)
    env.step(np.array([0.5]))
    env.unwrapped.fails = True
    with pytest.raises(FloatingPointError, match="shaken to pieces"):
        env.step(np.array([0.5]))
    assert not env.recording
    found, layouts = read_back(tmp_path / "packmech-episode-0.rrd")
    assert sorted(found["/state/position position_nd"]) == [0, 1] and layouts == 1


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"episode_trigger": 3}, TypeError, "episode_trigger must be a function"),
        ({"step_trigger": "all"}, TypeError, "step_trigger must be a function"),
        ({"recording_length": -1}, ValueError, "recording_length must be 0 for whole episodes or positive, got -1"),
        ({"recording_length": 1.5}, TypeError, "recording_length must be an integer"),
        ({"folder": 3}, TypeError, "folder must be a folder's name, got 3"),
    ],
)
def test_bad_arguments_are_named(tmp_path, arguments, error, message):
    with pytest.raises(error, match=message):
        RerunRecorder(Shaken(), **({"folder": tmp_path} | arguments))


def test_an_environment_without_a_packing_is_refused(tmp_path):
    with pytest.raises(TypeError, match="env must have a packing to record.*got CartPoleEnv"):
        RerunRecorder(gym.make("CartPole-v1"), tmp_path)
    with pytest.raises(TypeError, match="got SyncVectorEnv; give each environment a RerunRecorder of its own"):
        RerunVectorRecorder(SyncVectorEnv([lambda: gym.make("CartPole-v1")]), tmp_path)
    with pytest.raises(ValueError, match="index must be that of one of 2 environments, got 2"):
        RerunVectorRecorder(SyncVectorEnv([Shaken] * 2), tmp_path, index=2)


def play_batch(envs, steps=14):
    envs.action_space.seed(3)
    observations, _ = envs.reset(seed=7)
    seen = [observations.tobytes()]
    over = np.zeros(envs.num_envs, dtype=bool)
    for _ in range(steps):
        if envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED and over.any():
            observations, _ = envs.reset(options={"reset_mask": over})
        observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
        over = terminated | truncated
        seen.append((observations.tobytes(), rewards.tobytes(), over.tobytes()))
    return seen


@pytest.mark.parametrize(
    ("mode", "frames"),
    [(AutoresetMode.NEXT_STEP, 6), (AutoresetMode.SAME_STEP, 5), (AutoresetMode.DISABLED, 6)],
)
def test_one_of_a_batch_is_recorded_episode_by_episode_however_it_is_reset(tmp_path, mode, frames):
    def batch():
        return SyncVectorEnv([Shaken] * 3, autoreset_mode=mode)

    envs = RerunVectorRecorder(batch(), tmp_path, lambda episode: True, index=1)
    assert play_batch(envs) == play_batch(batch())
    envs.close()
    assert names(tmp_path)[:2] == ["packmech-episode-0.rrd", "packmech-episode-1.rrd"]
    for name in names(tmp_path)[:2]:
        found, _ = read_back(tmp_path / name)
        assert sorted(found["/state/position position_nd"]) == list(range(frames))
        height = found["/series/height scalars"]
        for step, position in found["/state/position position_nd"].items():
            assert position[0] == START.packing.position_nd[0, 0] + 0.01 * height[step][0]


class Batch(VectorEnv):
    """Three crystals that are looked at by number, as those of a native batch."""

    def __init__(self):
        self.num_envs, self.metadata = 3, {"autoreset_mode": AutoresetMode.NEXT_STEP}
        one = Shaken()
        self.single_observation_space, self.single_action_space = one.observation_space, one.action_space
        self.observation_space = gym.vector.utils.batch_space(one.observation_space, 3)
        self.action_space = gym.vector.utils.batch_space(one.action_space, 3)

    def packing(self, index):
        return START.packing.replace(position_nd=START.packing.position_nd + index)

    def scene(self, index):
        return START

    def reset(self, *, seed=None, options=None):
        return np.zeros((3, 2)), {}

    def step(self, actions):
        return np.zeros((3, 2)), np.arange(3.0), np.zeros(3, bool), np.zeros(3, bool), {}


def test_one_of_a_native_batch_is_looked_at_by_its_number(tmp_path):
    envs = RerunVectorRecorder(Batch(), tmp_path, index=2)
    envs.reset(seed=1)
    envs.step(np.zeros((3, 1)))
    envs.close()
    found, _ = read_back(tmp_path / "packmech-episode-0.rrd")
    assert found["/state/position position_nd"][1] == (START.packing.position_nd + 2).ravel().tolist()
    assert found["/series/reward scalars"] == {1: [2.0]}
