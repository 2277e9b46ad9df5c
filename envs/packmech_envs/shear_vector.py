"""Shear-v0 for many packings at once: one compiled call advances them all, on any number of threads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.batched import Advanced, BatchedEnv, Infos
from packmech_envs.drawing import draw
from packmech_envs.shear import METADATA
from packmech_envs.shear_core import ShearCore
from packmech_envs.shear_tasks import GOING, REASONS, Task

_REASONS = np.array(REASONS, dtype=object)


class ShearVectorEnv(BatchedEnv):
    """Many `ShearEnv` in one batch, with the same bits as each of them alone with the same seed.

    Parameters
    ----------
    num_envs
        How many.
    scene, task, control, frame_skip, dt, axes, method, largest_strain, largest_rate, extra_actions, start, relax, \
links, link_stiffness, budget, units, render_mode
        As for `ShearEnv`.
    threads
        Number of threads; it changes no bit.
    autoreset_mode
        AutoresetMode.NEXT_STEP, SAME_STEP or DISABLED, or its name such as "SameStep".
    max_episode_steps
        A further limit of an episode, as Gymnasium's TimeLimit; None: the budget alone.

    Examples
    --------
    >>> envs = ShearVectorEnv(3, "triangular", control="strain", frame_skip=10)
    >>> observations, infos = envs.reset(seed=1)
    >>> observations, rewards, terminated, truncated, infos = envs.step([[1e-3], [2e-3], [3e-3]])
    >>> observations[:, envs.observation_names.index("strain")].tolist()
    [0.001, 0.002, 0.003]

    """

    def __init__(
        self,
        num_envs: int = 1,
        scene: Any = "default",
        *,
        task: str | Task = "follow_stress",
        control: str = "rate",
        frame_skip: int = 20,
        dt: float | None = None,
        axes: tuple[int, int] | None = None,
        method: Any = None,
        largest_strain: float = 0.2,
        largest_rate: float | None = None,
        extra_actions: Sequence[str] = (),
        start: str | int = "as_prepared",
        relax: bool = True,
        links: str = "refuse",
        link_stiffness: float | None = None,
        budget: int | None = 200,
        units: str = "scene",
        render_mode: str | None = None,
        threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array' for a batch, got {render_mode!r:.60}")
        if isinstance(num_envs, bool) or not isinstance(num_envs, int | np.integer) or num_envs < 1:
            raise ValueError(f"num_envs must be an integer at least 1, got {num_envs!r:.60}")
        self._core = ShearCore(
            int(num_envs),
            scene=scene,
            task=task,
            control=control,
            frame_skip=frame_skip,
            dt=dt,
            axes=axes,
            method=method,
            largest_strain=largest_strain,
            largest_rate=largest_rate,
            extra_actions=extra_actions,
            start=start,
            relax=relax,
            links=links,
            link_stiffness=link_stiffness,
            budget=budget,
            units=units,
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
    def dt(self) -> float:
        """The time step [time]."""
        return self._core.dt

    @property
    def frame_time(self) -> float:
        """The time of a frame: frame_skip steps [time]."""
        return self._core.frame_time

    @property
    def task(self) -> Task:
        """The task."""
        return self._core.task

    def scene(self, index: int) -> pm.Scene:
        """Return one scene as its episode started from it.

        Parameters
        ----------
        index
            Which one.

        """
        return self._core.batch.scenes[index]

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
        return {name: self._core.info_bk[:, k].copy() for k, name in enumerate(self._core.info_names)}

    def _advance(self, action_bk: NDArray[np.float64], active_b: NDArray[np.bool_]) -> Advanced:
        core = self._core
        core.advance(action_bk, active_b)
        terminated_b = core.reason_b != GOING
        infos = self._starting_infos()
        if (terminated_b & active_b).any():
            infos["reason"] = _REASONS[core.reason_b.astype(np.int64)]
        if core.budget is None:
            truncated_b = np.zeros(self.num_envs, dtype=bool)
        else:
            truncated_b = core.elapsed_b >= core.budget
        return Advanced(core.reward_b.copy(), terminated_b, truncated_b, infos)

    def _frame(self, index: int) -> NDArray[np.uint8]:
        return draw(self.packing(index), effects=self._core.batch.scenes[index].effects)

    def close_extras(self, **kwargs: Any) -> None:
        """Let the threads go."""
        self._core.batch.close()
