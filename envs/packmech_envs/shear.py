"""Shear-v0: time-stepped shear of a packing, for scripts that step physics and for agents that learn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.actions import Actions
from packmech_envs.drawing import RENDER_FPS, RENDER_MODES, Screen, draw
from packmech_envs.shear_core import ShearCore
from packmech_envs.shear_tasks import FAILED, GOING, REASONS, Task

METADATA: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": RENDER_FPS}


@dataclass(frozen=True, eq=False)
class ShearEpisode:
    """An episode so far, frame by frame, its start included: (T,) figures in the scene's units.

    Attributes
    ----------
    names, figure_tk
        Names of the figures, and (T, K) their values: those of `pm.ShearBatch`.
    reward_t
        (T,) rewards; 0 at the start.
    dimension
        2 or 3.
    axes
        The component of the stress that answers to the strain.

    """

    names: tuple[str, ...]
    figure_tk: NDArray[np.float64]
    reward_t: NDArray[np.float64]
    dimension: int
    axes: tuple[int, int]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the (T,) values of one figure, such as "time", "strain", "pressure" or "work"."""
        if name not in self.names:
            raise KeyError(f"name must be one of {', '.join(map(repr, self.names))}, got {name!r}")
        return self.figure_tk[:, self.names.index(name)]

    @property
    def time_t(self) -> NDArray[np.float64]:
        """The (T,) times [time]."""
        return self["time"]

    @property
    def strain_t(self) -> NDArray[np.float64]:
        """The (T,) strains [1]."""
        return self["strain"]

    @property
    def stress_tdd(self) -> NDArray[np.float64]:
        """The (T, d, d) overall stress, Cauchy, tension positive [energy/length^d]."""
        letters = "xyz"[: self.dimension]
        rows = [[self["stress_" + "".join(sorted(a + b))] for b in letters] for a in letters]
        return np.moveaxis(np.array(rows), 2, 0)

    @property
    def shear_stress_t(self) -> NDArray[np.float64]:
        """The (T,) component of the stress that answers to the strain [energy/length^d]."""
        a, b = self.axes
        return self.stress_tdd[:, a, b]


class ShearEnv(gym.Env[NDArray[np.float64], NDArray[np.float64]], gym.utils.EzPickle):
    """A packing that is sheared frame by frame, as Newton's equations go, with a task.

    **Action**, float64, by the name of the control: "rate": the strain rate of the frame [1/time]; "strain": the strain
    at its end [1]; both are applied as equal strain increments in all its time steps. "strain_and_rate": both at its
    end, and the strain follows a cubic from those before. With `extra_actions=("friction",)` the last number is
    Coulomb's coefficient of the frame, from 0 to the scene's. An action outside the space is an error.

    **Observation**, float64, at the end of the frame:

    ================  =============================================================  ===============
    name              what                                                           unit
    ================  =============================================================  ===============
    strain            of the box, along `axes`                                       1
    rate              of the strain                                                  1/time
    stress_xx ...     xx, yy, xy (in space xx, yy, zz, yz, xz, xy) of the overall    energy/length^d
                      stress, Cauchy, tension positive
    pressure          -trace/d of that                                               energy/length^d
    kinetic_energy    of peculiar velocities and spins                               energy
    contacts          touching pairs that no bond joins                              1
    sliding_fraction  part of them at Coulomb's cap                                  1
    ...               what the task adds, see its class                              see there
    ================  =============================================================  ===============

    **Reward**: the sum of the task's terms, each of which is in info under its name.

    **Infos**: time [time], elastic_energy and work of the shear [energy], the reward's terms, what the task tells, and
    "reason" where an episode is terminated: "strain_reached", "yielded", or "step_too_long" where something moved by
    the smallest diameter in one time step or a number overflowed: the observation is the last good one then.

    **Start**: the scene before its drive, at its energy minimum: one whose drive jams it may start far from jammed, so
    shear the packing that came of it, in a Scene. By `start`, drawn from the environment's own generator alone. Nothing
    of an episode survives a reset. reset(options={"rate": r}) starts with a strain rate.
    A copy, pickled or not, is made anew from the same arguments and must be reset.

    **End**: terminated by the task, truncated after `budget` frames.

    Parameters
    ----------
    scene
        A shipped scene by name (`pm.list_scenes()`), a scene file, or a pm.Scene; its effects are what is simulated.
    task
        "follow_stress", "dissipate_least", "find_yield_strain", or one of their records with weights of your own.
    control
        "rate", "strain" or "strain_and_rate".
    frame_skip
        Time steps of a frame; `frame_time` is what they take together.
    dt
        Time step. Unless given: that of the scene's drive, or the method's fraction of the shortest of
        sqrt(m / stiffness) and m / damping.
    axes
        Direction of the displacements, and of their gradient; unless given those of the scene's drive, or (0, 1).
    method
        pm.VelocityVerlet() or pm.SemiImplicitEuler(); unless given that of the scene's drive, or the former.
    largest_strain
        Bound of the strain that an action asks for [1].
    largest_rate
        Bound of the rate that an action asks for [1/time]; unless given a strain of 0.01 in a frame.
    extra_actions
        ("friction",) or (): further numbers of an action.
    start
        "as_prepared"; "random": every episode starts from a packing of its own, made by the scene's recipe with a seed
        drawn from the generator, which may take a second; or a whole number K: drawn among K of them, each made once.
    relax
        Whether the start is brought to its energy minimum first, where a minimizer knows the scene's energy.
    links, link_stiffness
        What becomes of rigid links: "refuse", or "bonds": each a permanent bond of this stiffness (ten times
        energy_scale / reference_diameter^2 unless given).
    budget
        Frames of an episode; None: no end.
    units
        Of observations: "scene": those of the scene; "reduced": energies in its energy_scale, stresses in energy_scale
        / reference_diameter^d, rates in the largest rate, contacts per degree of freedom of the particles.
    render_mode
        None, "rgb_array", "human" (a window) or "ansi" (a line of text).

    Examples
    --------
    >>> env = ShearEnv("triangular", control="strain", frame_skip=10)
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step([1e-3])
    >>> dict(zip(env.observation_names, observation))["strain"].item()
    0.001

    """

    metadata = METADATA

    def __init__(
        self,
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
    ) -> None:
        # before any other local name
        arguments = {name: value for name, value in locals().items() if name not in ("self", "__class__")}
        gym.utils.EzPickle.__init__(self, **arguments)
        self.render_mode = render_mode
        self._screen = Screen(render_mode, "packmech/Shear-v0")
        self._core = ShearCore(
            1,
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
        )
        self.observation_space, self.action_space = self._core.observation_space, self._core.action_space
        self._actions = Actions(self._core.action_space)
        self._info_names = self._core.info_names
        # the figures of the start of an episode and of its frames, and rewards; room for more
        self._figure_tk = np.zeros((256, len(self._core.batch.names)))
        self._reward_t = np.zeros(256)
        self._frames = 0
        self._must_reset = True

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

    @property
    def scene(self) -> pm.Scene:
        """The scene as this episode started from it."""
        return self._core.batch.scenes[0]

    @property
    def packing(self) -> pm.Packing:
        """The packing as it is now."""
        return self._core.batch.packing(0)

    def contacts(self) -> pm.Contacts:
        """Return who touches whom now, pairs that a bond joins among them."""
        return pm.find_contacts(self.packing)

    @property
    def run(self) -> ShearEpisode:
        """The figures of the episode so far."""
        batch = self._core.batch
        return ShearEpisode(
            batch.names,
            self._figure_tk[: self._frames + 1].copy(),
            self._reward_t[: self._frames + 1].copy(),
            self.scene.packing.dimension,
            batch.axes,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start an episode anew; return its first observation and info.

        Parameters
        ----------
        seed
            Of the environment's generator; None: it goes on.
        options
            {"rate": r} for a strain rate at the start.

        """
        super().reset(seed=seed)
        core = self._core
        core.start([0], [self.np_random], options)
        self._frames = 0
        self._figure_tk[0] = core.batch.figure_bk[0]
        self._must_reset = False
        self._screen.refresh(self._picture)
        return core.observation_bk[0].copy(), dict(zip(self._info_names, core.info_bk[0].tolist(), strict=True))

    def step(self, action: Any) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Shear for a frame; return observation, reward, terminated, truncated and info.

        Raises
        ------
        TypeError, ValueError
            If the action is outside the space.
        gymnasium.error.ResetNeeded
            Before the first reset, or after a step that was too long.

        """
        if self._must_reset:
            raise gym.error.ResetNeeded("the environment must be reset before it can be stepped")
        core = self._core
        core.advance(self._actions.one(action))
        *infos, reward, reason = core.answer_k.tolist()
        frames = self._frames = self._frames + 1
        if frames == len(self._reward_t):
            self._figure_tk = np.concatenate([self._figure_tk, np.zeros_like(self._figure_tk)])
            self._reward_t = np.concatenate([self._reward_t, np.zeros_like(self._reward_t)])
        self._figure_tk[frames] = core.figure_k
        self._reward_t[frames] = reward
        info = dict(zip(self._info_names, infos, strict=True))
        if reason != GOING:
            info["reason"] = REASONS[int(reason)]
            self._must_reset = reason == FAILED
        truncated = core.budget is not None and frames >= core.budget
        if self.render_mode == "human":
            self._screen.refresh(self._picture)
        return core.observation_k.copy(), reward, reason != GOING, truncated, info

    def render(self) -> NDArray[np.uint8] | str | None:
        """Return a picture of the packing, (H, W, 3) bytes, or a line of text; or show it in a window."""
        return self._screen.render(self._picture, self._text)

    def _picture(self) -> NDArray[np.uint8]:
        return draw(self.packing, effects=self.scene.effects)

    def _text(self) -> str:
        now = dict(zip(self.observation_names, self._core.observation_bk[0].tolist(), strict=True))
        return ", ".join(f"{name} {value:.4g}" for name, value in now.items())

    def close(self) -> None:
        """Close the window, if there is one."""
        self._screen.close()
