"""Quench-v0 natively batched: many packings strained and relaxed in one compiled call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.batched import Advanced, BatchedEnv, Infos
from packmech_envs.drawing import draw
from packmech_envs.quench import METADATA
from packmech_envs.quench_core import QuenchCore
from packmech_envs.quench_reward import QuenchReward

__all__ = ["QuenchVectorEnv"]


class QuenchVectorEnv(BatchedEnv):
    """As many Quench-v0 as one likes, advanced together, with the bits of single environments of the same seeds.

    Parameters
    ----------
    num_envs
        How many.
    threads
        How many of them are advanced at a time; the bits do not depend on it.
    autoreset_mode
        AutoresetMode.NEXT_STEP, SAME_STEP or DISABLED, or its name such as "SameStep".
    max_episode_steps
        A further budget of steps, beside step_budget.
    render_mode
        None or "rgb_array": `render` returns a picture of each.
    scene, bonds, relax, force_tolerance, force_floor, method, start, start_packing_fraction, packing_fraction_limits
        As of `QuenchEnv`.
    largest_change, smallest_change, largest_strain, largest_pressure, verdict, shear_modulus, step_budget
        As of `QuenchEnv`.
    evaluation_budget, reward
        As of `QuenchEnv`.

    Examples
    --------
    >>> envs = QuenchVectorEnv(3, autoreset_mode="SameStep")
    >>> observations, infos = envs.reset(seed=1)
    >>> observations, rewards, terminated, truncated, infos = envs.step(np.zeros((3, 2)))
    >>> observations.shape, infos["pressure"].tolist()
    ((3, 8), [0.0, 0.0, 0.0])

    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Any = None,
        *,
        bonds: str = "refuse",
        relax: str | int = "full",
        force_tolerance: float = 1e-8,
        force_floor: float = 0.0,
        method: Any = None,
        start: str = "random",
        start_packing_fraction: Any = None,
        packing_fraction_limits: Any = None,
        largest_change: float = 0.05,
        smallest_change: float | None = None,
        largest_strain: float = 0.05,
        largest_pressure: float | None = None,
        verdict: str = "collective",
        shear_modulus: bool = False,
        step_budget: int | None = 40,
        evaluation_budget: int | None = 50_000,
        reward: QuenchReward | None = None,
        render_mode: str | None = None,
        threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array' for a batch, got {render_mode!r:.60}")
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs must be an integer at least 1, got {num_envs!r:.60}")
        self._core = QuenchCore(
            int(num_envs),
            scene=scene,
            bonds=bonds,
            relax=relax,
            force_tolerance=force_tolerance,
            force_floor=force_floor,
            method=method,
            start=start,
            start_packing_fraction=start_packing_fraction,
            packing_fraction_limits=packing_fraction_limits,
            largest_change=largest_change,
            smallest_change=smallest_change,
            largest_strain=largest_strain,
            largest_pressure=largest_pressure,
            verdict=verdict,
            shear_modulus=shear_modulus,
            step_budget=step_budget,
            evaluation_budget=evaluation_budget,
            reward=reward,
            threads=threads,
        )
        super().__init__(
            int(num_envs),
            observation_space=self._core.observation_space,
            action_space=self._core.action_space,
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            metadata=METADATA,
            render_mode=render_mode,
        )

    @property
    def observation_names(self) -> tuple[str, ...]:
        """The names of the numbers in an observation."""
        return self._core.observation_names

    @property
    def action_names(self) -> tuple[str, ...]:
        """The names of the numbers in an action."""
        return self._core.action_names

    @property
    def scene(self) -> pm.Scene:
        """The scene, with the effects that are minimized."""
        return self._core.scene

    def action(self, packing_fraction_change: float = 0.0, shear_strain: float = 0.0) -> NDArray[np.float64]:
        """Return the action of a single environment that asks for these changes, as `QuenchEnv.action` does."""
        return self._core.action_of(packing_fraction_change, shear_strain)

    def packing(self, index: int) -> pm.Packing:
        """Return one packing as it is now.

        Parameters
        ----------
        index
            Which one.

        """
        return self._core.batch.packing(index)

    def contacts(self, index: int) -> pm.Contacts:
        """Return who touches whom in one packing now.

        Parameters
        ----------
        index
            Which one.

        """
        return pm.find_contacts(self.packing(index))

    def _reset_some(
        self, index_k: NDArray[np.int64], rngs: Sequence[np.random.Generator], options: dict[str, Any]
    ) -> None:
        self._core.start(index_k.tolist(), rngs, options)

    def _observations(self) -> NDArray[np.float64]:
        return self._core.observation_bk.copy()

    def _starting_infos(self) -> Infos:
        return self._core.infos()

    def _advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_]) -> Advanced:
        core = self._core
        core.advance(action_bk, active_b)
        return Advanced(core.reward_b, core.jammed_b.copy(), core.truncated_b.copy(), core.infos())

    def _frame(self, index: int) -> NDArray[np.uint8]:
        return draw(self.packing(index), effects=self.scene.effects)
