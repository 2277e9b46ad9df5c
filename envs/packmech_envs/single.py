"""Single environments: Quench-v0 and Shear-v0, each a batch of one packing with what scripts read of an episode."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.drawing import METADATA, Screen, contacts_of
from packmech_envs.episodes import Actions, Episodes
from packmech_envs.quench import QuenchEpisodes, QuenchTask
from packmech_envs.shear import ShearEpisodes, ShearTask
from packmech_envs.shear_goals import FAILED, GOING, REASONS
from packmech_envs.tasks import task_of
from packmech_envs.words import brief

__all__ = ["QuenchEnv", "ShearEnv", "ShearTrace"]

Kind = TypeVar("Kind", bound=Episodes)


class SingleEnv(gym.Env[NDArray[np.float64], NDArray[np.float64]], gym.utils.EzPickle, Generic[Kind]):
    """The first of a batch of one packing, with pictures of it; a subclass gives `step`, and what is kept of a start.

    Parameters
    ----------
    episodes
        The batch.
    screen
        Shows the packing.
    arguments
        Those that a copy is made from.

    Attributes
    ----------
    task
        The options.
    observation_names, action_names
        The names of the numbers in an observation, and in an action.

    """

    metadata = METADATA

    def __init__(self, episodes: Kind, screen: Screen, **arguments: Any) -> None:
        gym.utils.EzPickle.__init__(self, **arguments)
        self.render_mode = screen.render_mode
        self._screen, self._episodes = screen, episodes
        self.task = episodes.task
        self.observation_names, self.action_names = episodes.observation_names, episodes.action_names
        self.observation_space, self.action_space = episodes.observation_space, episodes.action_space
        self._actions = Actions(episodes.action_space)
        self._must_reset, self._closed = True, False
        self._start = 0.0

    @property
    def scene(self) -> pm.Scene:
        """The scene as this episode started from it, with the effects that act in it."""
        return self._episodes.scene(0)

    @property
    def packing(self) -> pm.Packing:
        """The packing as it is now."""
        return self._episodes.packing(0)

    def contacts(self) -> pm.Contacts | pm.ShapeContacts:
        """Return the contacts now, pairs that a bond joins among them."""
        return contacts_of(self.packing)

    def _checked(self, action: Any) -> NDArray[np.float64]:
        """Return a (1, K) action inside the space, if a step may be taken."""
        if self._must_reset:
            self._check_open()
            raise gym.error.ResetNeeded("the environment must be reset before it can be stepped")
        return self._actions.one(action)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start an episode; return its first observation and info.

        Parameters
        ----------
        seed
            Of the environment's generator; None: it goes on.
        options
            Those that the environment has for a start; None: none.

        """
        self._check_open()
        super().reset(seed=seed)
        self._start = time.process_time()
        self._episodes.start([0], [self.np_random], options)
        self._must_reset = False
        self._begin()
        self._screen.refresh(self._picture)
        return self._episodes.observation_bk[0].copy(), self._info()

    def _begin(self) -> None:
        """Keep what scripts read of the start of an episode."""
        raise NotImplementedError

    def _info(self) -> dict[str, Any]:
        return {name: array[0].item() for name, array in self._episodes.infos().items()}

    def render(self) -> NDArray[np.uint8] | str | None:
        """Return a picture of the packing, (H, W, 3) bytes, or a line of text; or show it in a window."""
        return self._screen.render(self._picture, self._text)

    def _picture(self) -> NDArray[np.uint8]:
        picture: NDArray[np.uint8] = pm.draw_frame(self.packing, effects=self.scene.effects)
        return picture

    def _text(self) -> str:
        now = dict(zip(self.observation_names, self._episodes.observation_bk[0].tolist(), strict=True))
        return ", ".join(f"{name} {value:.4g}" for name, value in now.items())

    def close(self) -> None:
        """Close the window, if there is one, and the environment: it takes no more steps."""
        self._screen.close()
        self._closed = self._must_reset = True

    def _check_open(self) -> None:
        if self._closed:
            raise gym.error.ClosedEnvironmentError("the environment must be open, got one that is closed: make another")


class QuenchEnv(SingleEnv[QuenchEpisodes]):
    """A packing that is compressed or expanded, sheared and relaxed, until it is jammed.

    **Action**, two float64 numbers between -1 and 1, both signed and on a logarithmic scale: sign(a) s (exp(|a| L) - 1)
    with L = log(1 + c / s), s `smallest_change`, up to which the scale is linear. The first is the change of the
    packing fraction, c `largest_change`; the second a simple shear of the box along x with its gradient along y, c
    `largest_strain`. `action` gives the numbers for a change and a strain. Particles, or clusters of linked ones, are
    strained with the box and then relax. An action outside the space is an error.

    With actions="steps", two whole numbers instead: compress, 1 for compression and 0 for expansion, and halvings h of
    the largest change: the packing fraction changes by `largest_change` / 2^h, at least `smallest_change`. There is no
    shear. `action` gives the step nearest to a change, by ratio.

    **Observation**, float64, after the relaxation, clipped to its bounds:

    ========================  ===========================================================  =========================
    name                      what                                                         unit, bounds
    ========================  ===========================================================  =========================
    packing_fraction          volumes of the particles over that of the box                1, `packing_fraction_limits`
    log_energy                log10 of the energy per particle                             energy_scale, 2 b to 4
    log_pressure              log10 of the pressure; b = log10(largest_pressure) - 2       pressure unit, b to 4
                              at pressure zero
    log_max_force             log10 of the largest net force on a particle                 energy_scale / d, -16 to 4
    excess_contacts           contacts beyond those of one state of self stress, a         1, -dimension to 50
                              particle (see `pm.QuenchBatch.step`)
    stress_xx, _yy, _xy       stress, Cauchy, tension positive                             pressure unit, -1e4 to 1e4
    (_xx, _yy, _zz, _yz, _xz, _xy in space)
    shear_modulus             relaxed; by option, as it costs a factorization; 0 where     pressure unit, -1e4 to 1e4
                              nothing is rigid
    log_bracket               by option: log10 of the distance between the packing         1,
                              fractions last seen without pressure (log_pressure at b)     log10(smallest_change)
                              and with it; 0 where one side is not known                   to 0
    order_xx, _xy             of shapes that have directors: the order tensor of           1, -1 to 1
                              `pm.nematic_order`, without trace
    (_xx, _yy, _yz, _xz, _xy in space)
    director_0_x, ...         of shapes, with `orientations`: how each particle is         1, -1 to 1
                              turned, see `packmech_envs.turned.ObservedOrientations`
    ========================  ===========================================================  =========================

    d is the reference diameter and energy_scale / d^dimension the pressure unit.

    **Reward**: the sum of its terms, see `QuenchReward`, each in info under its name: "reward_distance" from jamming,
    "reward_evaluations", the force evaluations spent, "reward_stability" of the result; with reward="progress" not the
    distance but "reward_progress", the decades by which the step narrowed the bracket of jamming, and "reward_steps",
    the same cost for every step.

    **To learn**, give actions="steps", bracket=True, reward="progress": then the defaults of a learner do. Bisection by
    what is observed, half of the bracket at a time, ends jammed after 11 steps.

    **Infos**, in the scene's units: packing_fraction, energy, pressure, shear_strain (since the start),
    force_evaluations (of the step), relaxed, jammed, and the reward's terms.

    **Start**: particles at independent uniform positions, or clusters of linked ones placed and rotated at random
    without deep overlaps, shapes turned at random, at a packing fraction drawn from `start_packing_fraction`, all from
    the environment's own generator; with relax="full" relaxed. Nothing of an episode survives a reset. A copy, pickled
    or not, is made again from the same arguments and must be reset.

    **End**: terminated when jammed and verified: relaxed, with a pressure above zero and up to `largest_pressure`,
    contacts enough by counting (which says nothing of shapes), and then `pm.classify_jamming` of the scene. Truncated
    after `step_budget` steps or `evaluation_budget` force evaluations.

    Parameters
    ----------
    scene
        A shipped scene by name (`pm.list_scenes()`), a scene file, or a pm.Scene; None: 32 bidisperse harmonic discs.
        Effects without an energy (friction, dashpots) have no part, as in pm.quench; gravity and walls are refused.
        Particles may be ellipses, spheroids or rigid bodies (pm.Beads).
    task
        The options as a record, `QuenchTask`; None: the default one.
    render_mode
        None, "rgb_array", "human" (a window) or "ansi" (a line of text).
    options
        Fields of `QuenchTask` by name: they change the task.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong; for an option that there is not, with those that there are.

    Examples
    --------
    >>> env = QuenchEnv()
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action(packing_fraction_change=0.05))
    >>> change = env.run.report["packing_fraction_t"]
    >>> (change[1] - change[0]).round(12).item(), info["relaxed"]
    (0.05, True)

    """

    def __init__(
        self, scene: Any = None, *, task: QuenchTask | None = None, render_mode: str | None = None, **options: Any
    ) -> None:
        task = task_of(QuenchTask, task, options)
        screen = Screen(render_mode, "packmech/Quench-v0")
        super().__init__(QuenchEpisodes(1, scene, task), screen, scene=scene, task=task, render_mode=render_mode)
        self._active_b = np.ones(1, dtype=bool)
        self._rows: list[dict[str, float]] = []
        self._fractions: list[float] = []
        self._counts = (0, 0)
        self._seconds = 0.0

    @property
    def largest_pressure(self) -> float:
        """The largest pressure that counts as jammed [energy_scale / reference_diameter^d]."""
        return self._episodes.largest_pressure

    @property
    def run(self) -> pm.Run:
        """The episode so far: its packing, outcome of the last relaxation, counts, and a trace with a row per step.

        Its report holds packing_fraction, pressure [energy_scale / reference_diameter^d], shear_strain, rattlers,
        excess_contacts, jammed, and packing_fraction_t.
        """
        batch = self._episodes.batch
        mean, largest = float(batch.mean_force_b[0]), float(batch.max_force_b[0])
        return pm.Run(
            packing=self.packing,
            outcome=batch.outcome(0),
            residual=largest / mean if mean > 0.0 else 0.0,
            steps=self._counts[0],
            force_evaluations=self._counts[1],
            seconds=self._seconds,
            trace=pm.Trace.of_rows(self._rows),
            report={
                "packing_fraction": float(batch.packing_fraction_b[0]),
                "pressure": float(batch.pressure_b[0]) / self.scene.pressure_unit,
                "shear_strain": float(batch.strain_b[0]),
                "rattlers": int(batch.rattlers_b[0]),
                "excess_contacts": int(batch.excess_contacts_b[0]),
                "jammed": bool(self._episodes.terminated_b[0]),
                "packing_fraction_t": np.array(self._fractions),
            },
        )

    def action(self, packing_fraction_change: float = 0.0, shear_strain: float = 0.0) -> NDArray[np.float64]:
        """Return the action that asks for these changes; with actions="steps" the step nearest to it, without strain.

        Parameters
        ----------
        packing_fraction_change
            Of the packing fraction, at most largest_change [1]; not 0 with actions="steps".
        shear_strain
            Of the box, at most largest_strain [1].

        """
        return self._episodes.action(packing_fraction_change, shear_strain)

    def _begin(self) -> None:
        self._rows, self._fractions, self._counts = [], [], (0, 0)
        self._record_step()

    def step(self, action: Any) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Strain and relax; return observation, reward, terminated, truncated and info.

        Raises
        ------
        TypeError, ValueError
            If the action is outside the space.
        gymnasium.error.ResetNeeded
            Before the first reset.

        """
        episodes = self._episodes
        checked = self._checked(action)
        self._start = time.process_time()
        episodes.advance(checked, self._active_b)
        self._record_step()
        self._screen.refresh(self._picture)
        ended = bool(episodes.terminated_b[0]), bool(episodes.truncated_b[0])
        return episodes.observation_bk[0].copy(), float(episodes.reward_b[0]), *ended, self._info()

    def _record_step(self) -> None:
        batch = self._episodes.batch
        self._seconds = time.process_time() - self._start + (self._seconds if self._rows else 0.0)
        steps, evaluations = self._counts
        self._counts = steps + int(batch.steps_b[0]), evaluations + int(batch.force_evaluations_b[0])
        row = {name: getattr(batch, f"{name}_b")[0].item() for name in ("energy", "pressure", "contacts", "max_force")}
        self._rows.append({"step": len(self._rows), **row})
        self._fractions.append(float(batch.packing_fraction_b[0]))


@dataclass(frozen=True, eq=False)
class ShearTrace:
    """An episode so far, frame by frame, its start included, in the scene's units.

    Attributes
    ----------
    names, figure_tk
        Names of the figures, and (T, K) their values: those of `pm.ShearBatch`.
    reward_t
        (T,) rewards; 0 at the start.
    dimension
        2 or 3.
    axes
        Direction of the displacements, and of their gradient.

    """

    names: tuple[str, ...]
    figure_tk: NDArray[np.float64]
    reward_t: NDArray[np.float64]
    dimension: int
    axes: tuple[int, int]

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the (T,) values of one figure, such as "time", "strain", "pressure" or "work"."""
        if name not in self.names:
            raise KeyError(f"name must be one of {', '.join(map(repr, self.names))}, got {brief(name)}")
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
        """The (T,) component of the stress that does work on the strain [energy/length^d]."""
        a, b = self.axes
        return self.stress_tdd[:, a, b]


class ShearEnv(SingleEnv[ShearEpisodes]):
    """A packing that is sheared frame by frame, by Newton's equations, with a goal.

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
    sliding_fraction  fraction of them at the Coulomb limit                          1
    ...               what the goal adds, see its class                              see there
    order_xx, _xy     of shapes: the order tensor of `pm.nematic_order`, without     1, -1 to 1
                      trace (_xx, _yy, _yz, _xz, _xy in space)
    director_0_x ...  of shapes, with `orientations`: each particle's director       1, -1 to 1
    ================  =============================================================  ===============

    **Reward**: the sum of the goal's terms, each of which is in info under its name.

    **Infos**: time [time], elastic_energy and work of the shear [energy], the reward's terms, the goal's own, and
    "reason" where an episode is terminated: "strain_reached", "yielded", or "step_too_long" where something moved by
    the smallest diameter in one time step or a number overflowed: the observation is the last good one then.

    **Start**: the scene before its drive, at its energy minimum. One whose drive jams it may start far from jammed: run
    it, and shear the packing that comes of it in a Scene. With `start` "random" or a number, drawn from the
    environment's own generator alone. Nothing of an episode survives a reset. reset(options={"rate": r}) starts with a
    strain rate. A copy, pickled or not, is made again from the same arguments and must be reset.

    **End**: terminated by the goal, truncated after `budget` frames.

    Parameters
    ----------
    scene
        A shipped scene by name (`pm.list_scenes()`), a scene file, or a pm.Scene; its effects are what is simulated.
        Particles may be ellipses or spheroids.
    task
        The options as a record, `ShearTask`; None: the default one.
    render_mode
        None, "rgb_array", "human" (a window) or "ansi" (a line of text).
    options
        Fields of `ShearTask` by name: they change the task.

    Attributes
    ----------
    dt, frame_time
        The time step, and the time of a frame: frame_skip steps [time].

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong; for an option that there is not, with those that there are.

    Examples
    --------
    >>> env = ShearEnv("triangular", control="strain", frame_skip=10)
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step([1e-3])
    >>> round(dict(zip(env.observation_names, observation))["strain"].item(), 12)
    0.001

    """

    def __init__(
        self, scene: Any = "default", *, task: ShearTask | None = None, render_mode: str | None = None, **options: Any
    ) -> None:
        task = task_of(ShearTask, task, options)
        screen = Screen(render_mode, "packmech/Shear-v0")
        super().__init__(ShearEpisodes(1, scene, task), screen, scene=scene, task=task, render_mode=render_mode)
        # the figures of the start of an episode and of its frames, and rewards; room for more
        self._figure_tk = np.zeros((256, len(self._episodes.batch.names)))
        self._reward_t = np.zeros(256)
        self._frames = 0
        self.dt, self.frame_time = self._episodes.dt, self._episodes.frame_time

    @property
    def run(self) -> ShearTrace:
        """The figures of the episode so far."""
        batch = self._episodes.batch
        return ShearTrace(
            batch.names,
            self._figure_tk[: self._frames + 1].copy(),
            self._reward_t[: self._frames + 1].copy(),
            self.scene.packing.dimension,
            batch.axes,
        )

    def _begin(self) -> None:
        self._frames = 0
        self._figure_tk[0] = self._episodes.batch.figure_bk[0]

    def _info(self) -> dict[str, Any]:
        return dict(zip(self._episodes.info_names, self._episodes.result_k[:-2].tolist(), strict=True))

    def step(self, action: Any) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Shear for a frame; return observation, reward, terminated, truncated and info.

        Raises
        ------
        TypeError, ValueError
            If the action is outside the space.
        gymnasium.error.ResetNeeded
            Before the first reset, or after a step that was too long.

        """
        episodes = self._episodes
        episodes.advance(self._checked(action))
        *infos, reward, reason = episodes.result_k.tolist()
        frames = self._frames = self._frames + 1
        if frames == len(self._reward_t):
            self._figure_tk = np.concatenate([self._figure_tk, np.zeros_like(self._figure_tk)])
            self._reward_t = np.concatenate([self._reward_t, np.zeros_like(self._reward_t)])
        self._figure_tk[frames] = episodes.figure_k
        self._reward_t[frames] = reward
        info = dict(zip(episodes.info_names, infos, strict=True))
        if reason != GOING:
            info["reason"] = REASONS[int(reason)]
            self._must_reset = reason == FAILED
        truncated = episodes.budget is not None and frames >= episodes.budget
        if self.render_mode == "human":
            self._screen.refresh(self._picture)
        return episodes.observation_k.copy(), reward, reason != GOING, truncated, info
