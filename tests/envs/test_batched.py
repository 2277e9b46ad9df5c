"""The base of batched environments answers as Gymnasium's SyncVectorEnv over single environments does, in all modes."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from packmech_envs.batched import BatchedEnv, QuenchVectorEnv

OBSERVED = Box(-np.inf, np.inf, (2,), np.float64)
MOVES = Box(np.array([-1.0, 0.0]), np.array([1.0, 0.5]), dtype=np.float64)


class Walk(gym.Env):
    """A walk from a random place that ends beyond 2; it tells why, but only then."""

    observation_space, action_space = OBSERVED, MOVES

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.place = self.np_random.uniform(-1.0, 1.0, 2)
        return self.place.copy(), {"start": float(self.place[0])}

    def step(self, action):
        self.place = self.place + action
        over = bool(self.place.sum() > 2.0)
        info = {"sum": float(self.place.sum()), "place": self.place.copy()}
        if over:
            info["reason"] = "too far"
        return self.place.copy(), float(action[0]), over, False, info


class WalkEpisodes:
    """As many walks, in arrays."""

    observation_space, action_space = OBSERVED, MOVES
    observation_names, action_names, task = ("x", "y"), ("step_x", "step_y"), None

    def __init__(self, count):
        self.observation_bk = np.zeros((count, 2))
        self.reward_b, self.truncated_b = np.zeros(count), np.zeros(count, dtype=bool)
        self.terminated_b = np.zeros(count, dtype=bool)
        self.starting = True

    def __len__(self):
        return len(self.reward_b)

    def start(self, index_k, rngs, options):
        for b, rng in zip(index_k, rngs, strict=True):
            self.observation_bk[b] = rng.uniform(-1.0, 1.0, 2)
        self.starting = True

    def advance(self, action_bk, active_b):
        self.observation_bk[active_b] += action_bk[active_b]
        self.reward_b, self.terminated_b = action_bk[:, 0], self.observation_bk.sum(axis=1) > 2.0
        self.starting = False

    def infos(self):
        place = self.observation_bk
        if self.starting:
            return {"start": place[:, 0]}
        return {"sum": place.sum(axis=1), "place": place, "reason": np.where(self.terminated_b, "too far", None)}


def Walks(count, **how):
    return BatchedEnv(WalkEpisodes(count), **how)


def peer(count, mode, limit):
    def one():
        return Walk() if limit is None else gym.wrappers.TimeLimit(Walk(), limit)

    return SyncVectorEnv([one] * count, autoreset_mode=mode)


@pytest.mark.parametrize("limit", [None, 3])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_batch_answers_as_a_sync_vector_env_does(mode, limit):
    ours, theirs = Walks(5, autoreset_mode=mode, max_episode_steps=limit), peer(5, mode, limit)
    assert data_equivalence(ours.reset(seed=3), theirs.reset(seed=3), exact=True)
    theirs.action_space.seed(1)
    ended = 0
    for _ in range(30):
        actions = theirs.action_space.sample()
        mine = ours.step(actions)
        assert data_equivalence(mine, theirs.step(actions), exact=True)
        ended += int((mine[2] | mine[3]).sum())
    assert ended > 5
    assert data_equivalence(ours.reset(), theirs.reset(), exact=True)
    assert data_equivalence(
        ours.reset(seed=[7, None, 9, None, 1]), theirs.reset(seed=[7, None, 9, None, 1]), exact=True
    )


def test_without_autoreset_a_mask_says_whom_to_reset():
    ours, theirs = Walks(4, autoreset_mode="Disabled"), peer(4, AutoresetMode.DISABLED, None)
    ours.reset(seed=0), theirs.reset(seed=0)
    up = np.tile([1.0, 0.5], (4, 1))
    for _ in range(12):
        mine = ours.step(up)
        assert data_equivalence(mine, theirs.step(up), exact=True)
        over = mine[2]
        if over.any():
            with pytest.raises(gym.error.ResetNeeded, match=f"environment {np.flatnonzero(over)[0]} must be reset"):
                ours.step(up)
            again = ours.reset(options={"reset_mask": over.copy()})
            assert data_equivalence(again, theirs.reset(options={"reset_mask": over.copy()}), exact=True)


def test_seeds_of_a_batch_count_up_and_generators_go_on():
    walks = Walks(3)
    first, _ = walks.reset(seed=10)
    again, _ = walks.reset()
    assert walks.np_random_seed == (10, 11, 12)
    for b in range(3):
        single = Walk()
        assert np.array_equal(single.reset(seed=10 + b)[0], first[b])
        assert np.array_equal(single.reset()[0], again[b])


def test_the_action_after_an_end_is_not_looked_at():
    walks = Walks(2, max_episode_steps=1)
    walks.reset(seed=0)
    walks.step(np.zeros((2, 2)))
    walks.step(np.full((2, 2), np.nan))
    with pytest.raises(ValueError, match=r"action\[0\] must lie between -1 and 1, got nan for environment 0"):
        walks.step(np.full((2, 2), np.nan))


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (np.zeros((3, 2)), ValueError, r"actions must have shape \(2, 2\), got \(3, 2\)"),
        ([["a", "b"], ["c", "d"]], TypeError, "action must be an array of real numbers"),
        ([[0.0, 0.0], [0.0, 0.6]], ValueError, r"action\[1\] must lie between 0 and 0.5, got 0.6 for environment 1"),
        ([[np.inf, 0.0], [0.0, 0.0]], ValueError, "got inf for environment 0"),
    ],
)
def test_actions_outside_the_space_are_refused_and_change_nothing(actions, error, message):
    walks = Walks(2)
    walks.reset(seed=0)
    before = walks._episodes.observation_bk.copy()
    with pytest.raises(error, match=message):
        walks.step(actions)
    assert np.array_equal(walks._episodes.observation_bk, before)


def test_an_action_at_a_bound_that_went_through_float32_counts_as_the_bound():
    walks = Walks(1)
    assert np.array_equal(walks.actions.one(np.float32([1.0, 0.5])), [[1.0, 0.5]])
    third = type(walks.actions)(Box(-0.1, 0.1, (1,), np.float64))
    assert float(np.float32(0.1)) > 0.1
    assert third.one(np.float32([0.1]))[0, 0] == 0.1


@pytest.mark.parametrize(
    ("reset", "error", "message"),
    [
        ({"seed": [1]}, ValueError, "seed must hold one seed for each of 2 environments, got 1"),
        ({"options": {"reset_mask": [True, False]}}, TypeError, "must be a numpy array of bool"),
        ({"options": {"reset_mask": np.array([True])}}, ValueError, r"must have shape \(2,\), got \(1,\)"),
        ({"options": {"reset_mask": np.zeros(2, dtype=bool)}}, ValueError, "at least one environment, got none"),
    ],
)
def test_wrong_seeds_and_masks_are_refused(reset, error, message):
    with pytest.raises(error, match=message):
        Walks(2).reset(**reset)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"num_envs": 0}, "num_envs must be an integer at least 1, got 0"),
        ({"max_episode_steps": 0}, "max_episode_steps must be an integer at least 1, got 0"),
        ({"autoreset_mode": "now"}, "autoreset_mode must be one of 'NextStep', 'SameStep', 'Disabled'"),
        ({"render_mode": "human"}, "render_mode must be None or 'rgb_array' for a batch, got 'human'"),
    ],
)
def test_wrong_settings_of_a_batch_are_refused(how, message):
    with pytest.raises(ValueError, match=message):
        QuenchVectorEnv(**how)


def test_environments_that_are_closed_take_no_steps_and_no_resets():
    envs = Walks(2)
    envs.reset(seed=1)
    envs.close()
    envs.close()
    for act in (envs.reset, lambda: envs.step(np.zeros((2, 2)))):
        with pytest.raises(gym.error.ClosedEnvironmentError, match="environments must be open, got some .* closed"):
            act()


def test_a_step_before_any_reset_is_refused():
    with pytest.raises(gym.error.ResetNeeded, match="environment 0 must be reset"):
        Walks(2).step(np.zeros((2, 2)))
