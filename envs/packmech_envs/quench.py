"""Quench-v0: from a random start to a jammed packing, by compression, shear and relaxation."""

from __future__ import annotations

import time
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.actions import Actions
from packmech_envs.drawing import RENDER_FPS, RENDER_MODES, Screen, draw
from packmech_envs.quench_core import QuenchCore
from packmech_envs.quench_reward import QuenchReward

__all__ = ["METADATA", "QuenchEnv"]

METADATA: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": RENDER_FPS}


class QuenchEnv(gym.Env[NDArray[np.float64], NDArray[np.float64]], gym.utils.EzPickle):
    """A packing that is compressed or expanded, sheared and relaxed, until it is jammed.

    **Action**, two float64 numbers between -1 and 1, both signed and on a logarithmic scale: sign(a) s (exp(|a| L) - 1)
    with L = log(1 + c / s), s `smallest_change`, up to which the scale is linear. The first is the change of the
    packing fraction, c `largest_change`; the second a simple shear of the box along x with its gradient along y, c
    `largest_strain`. `action` gives the numbers for a change and a strain. Particles, or clusters of linked ones, go
    along with the box and then relax. An action outside the space is an error.

    **Observation**, float64, after the relaxation, clipped to its bounds:

    ========================  ===========================================================  =========================
    name                      what                                                         unit, bounds
    ========================  ===========================================================  =========================
    packing_fraction          volumes of the particles over that of the box                1, `packing_fraction_limits`
    log_energy                log10 of the energy per particle                             energy_scale, 2 b to 4
    log_pressure              log10 of the pressure; b = log10(largest_pressure) - 2       pressure unit, b to 4
                              where nothing presses
    log_max_force             log10 of the largest net force on a particle                 energy_scale / d, -16 to 4
    excess_contacts           contacts beyond those of one state of self stress, a         1, -dimension to 50
                              particle (see `pm.QuenchBatch.step`)
    stress_xx, _yy, _xy       stress, Cauchy, tension positive                             pressure unit, -1e4 to 1e4
    (_xx, _yy, _zz, _yz, _xz, _xy in space)
    shear_modulus             relaxed; by option, as it costs a factorization; 0 where     pressure unit, -1e4 to 1e4
                              nothing is held at rest
    ========================  ===========================================================  =========================

    d is the reference diameter and energy_scale / d^dimension the pressure unit.

    **Reward**: the sum of three terms, see `QuenchReward`, each in info under its name: "reward_distance" from jamming,
    "reward_evaluations", the force evaluations spent, and "reward_stability" of the result.

    **Infos**, in the scene's units: packing_fraction, energy, pressure, shear_strain (since the start),
    force_evaluations (of the step), relaxed, jammed, and the reward's terms.

    **Start**: particles at independent uniform places, or clusters of linked ones placed and turned at random without
    deep overlaps, at a packing fraction drawn from `start_packing_fraction`, all from the environment's own generator;
    with relax="full" relaxed. Nothing of an episode survives a reset. A copy, pickled or not, is made anew from the
    same arguments and must be reset.

    **End**: terminated when jammed and verified: relaxed, with a pressure above zero and up to `largest_pressure`,
    contacts enough by counting, and then `pm.classify_jamming` of the scene. Truncated after `step_budget` steps or
    `evaluation_budget` force evaluations.

    Parameters
    ----------
    scene
        A shipped scene by name (`pm.list_scenes()`), a scene file, or a pm.Scene; None: 32 bidisperse harmonic discs.
        Effects without an energy (friction, dashpots) have no part, as in pm.quench; gravity and walls are refused.
    bonds
        What becomes of bonds, which no minimizer knows: "refuse" or "leave out".
    relax
        "full": each step relaxes to the tolerance. A number k: each takes k steps of the minimizer, which goes on where
        it was, so that the quench itself is watched; it then starts from overlaps as they were drawn.
    force_tolerance
        Largest net force over mean contact force that counts as relaxed [1].
    force_floor
        Mean contact force that counts as none [energy_scale / d].
    method
        pm.Fire(), pm.Fire2() or pm.DampedDynamics(); None: Fire().
    start
        "random", or "scene": the packing as the scene has it.
    start_packing_fraction
        A number, or a pair between which it is drawn; None: below jamming; for start="scene" that of the packing.
    packing_fraction_limits
        (low, high) between which steps keep the packing fraction; None: those of `pm.QuenchBatch`.
    largest_change, largest_strain, smallest_change
        c and s of the action; s unless given a tenth of largest_pressure.
    largest_pressure
        Up to which a packing may count as jammed [pressure unit]; None: 0.1 / N^2, where pressure closes few gaps yet.
    verdict
        "collective" or "strict": which verdict ends an episode.
    shear_modulus
        Whether it is observed.
    step_budget, evaluation_budget
        Steps and force evaluations of an episode; None: no end.
    reward
        The weights: QuenchReward(distance_weight=0.25, evaluation_weight=0.1, stability_weight=5).
    render_mode
        None, "rgb_array", "human" (a window) or "ansi" (a line of text).

    Examples
    --------
    >>> env = QuenchEnv()
    >>> observation, info = env.reset(seed=1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action(packing_fraction_change=0.05))
    >>> change = env.run.report["packing_fraction_t"]
    >>> (change[1] - change[0]).round(12).item(), info["relaxed"]
    (0.05, True)

    """

    metadata = METADATA

    def __init__(
        self,
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
    ) -> None:
        # before any other local name
        arguments = {name: value for name, value in locals().items() if name not in ("self", "__class__")}
        gym.utils.EzPickle.__init__(self, **arguments)
        self.render_mode = render_mode
        self._screen = Screen(render_mode, "packmech/Quench-v0")
        self._core = QuenchCore(
            1,
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
            threads=1,
        )
        self.observation_space, self.action_space = self._core.observation_space, self._core.action_space
        self._actions = Actions(self._core.action_space)
        self._ready = False
        self._active = np.ones(1, dtype=bool)
        self._rows: list[tuple[float, float, float, int, float]] = []
        self._counts = (0, 0)
        self._seconds = 0.0

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

    @property
    def largest_pressure(self) -> float:
        """The largest pressure that counts as jammed [energy_scale / reference_diameter^d]."""
        return self._core.largest_pressure

    @property
    def packing(self) -> pm.Packing:
        """The packing as it is now."""
        return self._core.batch.packing(0)

    def contacts(self) -> pm.Contacts:
        """Return who touches whom now."""
        return pm.find_contacts(self.packing)

    @property
    def run(self) -> pm.Run:
        """The episode so far: its packing, outcome of the last relaxation, counts, and a trace with a row per step.

        Its report holds packing_fraction, pressure [energy_scale / reference_diameter^d], shear_strain, rattlers,
        excess_contacts, jammed, and packing_fraction_t.
        """
        batch, rows = self._core.batch, self._rows
        mean, most = float(batch.mean_force_b[0]), float(batch.max_force_b[0])
        columns = [np.array([row[k] for row in rows]) for k in range(5)]
        return pm.Run(
            packing=self.packing,
            outcome=batch.outcome(0),
            residual=most / mean if mean > 0.0 else 0.0,
            steps=self._counts[0],
            force_evaluations=self._counts[1],
            seconds=self._seconds,
            trace=pm.Trace(
                step_t=np.arange(len(rows)),
                energy_t=columns[0],
                pressure_t=columns[1],
                contacts_t=columns[3].astype(np.int64),
                max_force_t=columns[2],
            ),
            report={
                "packing_fraction": float(batch.packing_fraction_b[0]),
                "pressure": float(batch.pressure_b[0]) / self.scene.pressure_unit,
                "shear_strain": float(batch.strain_b[0]),
                "rattlers": int(batch.rattlers_b[0]),
                "excess_contacts": int(batch.excess_contacts_b[0]),
                "jammed": bool(self._core.jammed_b[0]),
                "packing_fraction_t": columns[4],
            },
        )

    def action(self, packing_fraction_change: float = 0.0, shear_strain: float = 0.0) -> NDArray[np.float64]:
        """Return the action that asks for these changes.

        Parameters
        ----------
        packing_fraction_change
            Of the packing fraction, at most largest_change [1].
        shear_strain
            Of the box, at most largest_strain [1].

        """
        return self._core.action_of(packing_fraction_change, shear_strain)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Start an episode anew; return its first observation and info.

        Parameters
        ----------
        seed
            Of the environment's generator; None: it goes on.
        options
            None: there are none.

        """
        super().reset(seed=seed)
        began = time.process_time()
        self._core.start([0], [self.np_random], options)
        self._ready = True
        self._rows, self._counts = [], (0, 0)
        self._keep(began)
        self._screen.refresh(self._picture)
        return self._core.observation_bk[0].copy(), self._info()

    def step(self, action: Any) -> tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]:
        """Strain and relax; return observation, reward, terminated, truncated and info.

        Raises
        ------
        TypeError, ValueError
            If the action is outside the space.
        gymnasium.error.ResetNeeded
            Before the first reset.

        """
        if not self._ready:
            raise gym.error.ResetNeeded("the environment must be reset before it can be stepped")
        core = self._core
        began = time.process_time()
        core.advance(self._actions.one(action), self._active)
        self._keep(began)
        self._screen.refresh(self._picture)
        ended = bool(core.jammed_b[0]), bool(core.truncated_b[0])
        return core.observation_bk[0].copy(), float(core.reward_b[0]), *ended, self._info()

    def _keep(self, began: float) -> None:
        batch = self._core.batch
        self._seconds = time.process_time() - began + (self._seconds if self._rows else 0.0)
        steps, evaluations = self._counts
        self._counts = steps + int(batch.steps_b[0]), evaluations + int(batch.force_evaluations_b[0])
        self._rows.append(
            (
                float(batch.energy_b[0]),
                float(batch.pressure_b[0]),
                float(batch.max_force_b[0]),
                int(batch.contacts_b[0]),
                float(batch.packing_fraction_b[0]),
            )
        )

    def _info(self) -> dict[str, Any]:
        return {name: array[0].item() for name, array in self._core.infos().items()}

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
