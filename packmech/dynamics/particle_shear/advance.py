"""Steps of the preset from a state: one with everything that it saw, or many with their stresses."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import check
from packmech.dynamics.particle_shear.discs import KINDS, Discs
from packmech.dynamics.particle_shear.material import Material
from packmech.dynamics.particle_shear.pairs import OPEN, Pairs
from packmech.dynamics.particle_shear.step import Body, Cell, Motion, Register, run_steps

# the nine tensors of the package, in the order of its text file but for the last, which the rest add up to
STRESSES = (
    "love_weber",
    "external",
    "linear_acceleration",
    "unbalanced",
    "torque",
    "internal_torque",
    "centrifugal",
    "otsuki",
    "overall",
)

# of the mean radius; wider lists are scanned less often and hold more pairs that do not touch
MARGIN = 0.35


@dataclasses.dataclass(frozen=True)
class StepRules:
    """What a step does besides the contacts: its length, cooling, plates, and whose terms enter the stresses.

    Parameters
    ----------
    time_step
        [s].
    cooling
        Factor of the velocities relative to the local flow, and of the spins, at every step [1].
    plates
        Whether discs nearer to y = 0 or y = height than their radius are caught by plates that shear the cell, for
        ever; without, the cell is periodic in both directions.
    clears_forces
        Whether the forces on caught discs are cleared after the step, as in the package's oscillatory runs; in its
        library-level step, which its unit tests take, they add up.
    all_spin
        Whether the centrifugal and the Otsuki terms count caught discs, as in the package's unit tests.
    otsuki_flow
        Whether the Otsuki term takes velocities relative to the sheared flow; the package's unit tests do not.

    """

    time_step: float
    cooling: float = 1.0
    plates: bool = True
    clears_forces: bool = True
    all_spin: bool = False
    otsuki_flow: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_step", check.positive("time_step", self.time_step))
        object.__setattr__(self, "cooling", check.real("cooling", self.cooling, above=0.0, at_most=1.0))
        for name in ("plates", "clears_forces", "all_spin", "otsuki_flow"):
            if not isinstance(getattr(self, name), bool | np.bool_):
                raise TypeError(f"{name} must be True or False, got {getattr(self, name)!r}")


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluation:
    """What one step saw when it evaluated its forces.

    Attributes
    ----------
    mobile_n
        (N,) discs that no plate held.
    force_nd, torque_n
        Total forces [1e-12 N/m] and torques [1e-18 N].
    inner_force_nd, outer_force_nd, inner_torque_n, outer_torque_n
        The parts from contacts inside the cell between mobile discs, and from all others, on mobile discs.
    stress_sdd
        (9, 2, 2) the tensors by the order of `STRESSES` [Pa], compression positive.
    history_ck
        (C, 2) histories of the contacts, as the forces left them; those of the state after the step have been wound.

    """

    mobile_n: NDArray[np.bool_]
    force_nd: NDArray[np.float64]
    torque_n: NDArray[np.float64]
    inner_force_nd: NDArray[np.float64]
    outer_force_nd: NDArray[np.float64]
    inner_torque_n: NDArray[np.float64]
    outer_torque_n: NDArray[np.float64]
    stress_sdd: NDArray[np.float64]
    history_ck: NDArray[np.float64]

    def stress(self, name: str) -> NDArray[np.float64]:
        """Return the (2, 2) tensor of that name [Pa]."""
        return np.asarray(self.stress_sdd[STRESSES.index(check.one_of("name", name, STRESSES))])


@dataclasses.dataclass(frozen=True, eq=False)
class Steps:
    """Series over the steps of a run, each taken when its forces were evaluated, and the state after the last one.

    Attributes
    ----------
    final
        The state after the last step.
    time_t, strain_t, strain_rate_t
        [s], [1], [1/s].
    stress_tsdd
        (T, 9, 2, 2) tensors by the order of `STRESSES` [Pa].
    caught_t, contacts_t
        Numbers of discs held by plates, and of contacts and bonds.
    last
        The last step's evaluation.

    """

    final: Discs
    time_t: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    strain_rate_t: NDArray[np.float64]
    stress_tsdd: NDArray[np.float64]
    caught_t: NDArray[np.int64]
    contacts_t: NDArray[np.int64]
    last: Evaluation

    def stress(self, name: str) -> NDArray[np.float64]:
        """Return the (T, 2, 2) tensor of that name [Pa]."""
        return np.asarray(self.stress_tsdd[:, STRESSES.index(check.one_of("name", name, STRESSES))])


def _start_pairs(discs: Discs) -> Pairs:
    kinds = np.array([KINDS[str(kind)] for kind in discs.kind_c], dtype=np.int64)
    i_p, j_p = (np.array(discs.contact_ck[:, k]) for k in (0, 1))
    state_p9 = np.zeros((len(kinds), 9))
    state_p9[:, :2] = discs.history_ck
    return Pairs(i_p, j_p, kinds, state_p9)


def advance(discs: Discs, material: Material, rules: StepRules, strain_rate_t: ArrayLike) -> Steps:
    """Return the run of as many steps as there are strain rates.

    Parameters
    ----------
    discs
        The state to start from; it stays as it is.
    material
        Constants of the contacts.
    rules
        Length of the step, cooling, plates.
    strain_rate_t
        (T,) shear rate that each step sets at its start [1/s].

    Examples
    --------
    >>> pair = Discs([[200.0, 250.0], [310.0, 250.0]], [60.0, 60.0], [1.0, 1.0])
    >>> steps = advance(pair, Material(stiffness=1.0), StepRules(0.1, plates=False), [0.0])
    >>> print(steps.last.force_nd[0], steps.stress("love_weber")[0, 0, 0] * 500.0**2 / 1e-6)
    [-10.   0.] 1100.0

    """
    check.instance("discs", discs, Discs)
    check.instance("material", material, Material)
    check.instance("rules", rules, StepRules, "an instance of")
    rate_t = check.finite_array("strain_rate_t", strain_rate_t, shape=(None,), what="step")
    count, steps = discs.discs, len(rate_t)
    motion = Motion(*(np.array(getattr(discs, name)) for name in Motion._fields))
    push_n, turn_n = rules.time_step / discs.mass_n, rules.time_step / discs.inertia_n
    body = Body(discs.radius_n.copy(), discs.mass_n.copy(), push_n, turn_n)
    cell = Cell(
        discs.width, discs.height, bool(rules.plates), rules.time_step, rules.cooling,
        bool(rules.clears_forces), bool(rules.all_spin), bool(rules.otsuki_flow),
    )  # fmt: skip
    register = Register(
        np.zeros((count, 8)), np.zeros((count, 2, 4)), np.zeros((count, 2)), np.zeros(count), np.zeros((2, 2))
    )
    stress_tsdd, count_tk, strain_t = np.empty((steps, 9, 2, 2)), np.empty((steps, 2), np.int64), np.empty(steps)
    pairs, seen_p9, strain, rate, time = run_steps(
        motion, body, cell, material.checked(), (discs.strain, discs.strain_rate, discs.time), rate_t,
        MARGIN * float(np.mean(discs.radius_n)), _start_pairs(discs), register, stress_tsdd, count_tk, strain_t,
    )  # fmt: skip
    held = np.flatnonzero(pairs.kind_p != OPEN)
    names = {number: name for name, number in KINDS.items()}
    if not np.isfinite(motion.position_nd).all():
        raise FloatingPointError(
            f"the run blew up: a disc's position is no number after {steps} steps; take a smaller time_step"
        )
    final = Discs(
        *(motion.position_nd, body.radius_n, body.mass_n, motion.velocity_nd, motion.spin_n, motion.angle_n),
        contact_ck=np.stack([pairs.i_p[held], pairs.j_p[held]], axis=1),
        kind_c=np.array([names[int(kind)] for kind in pairs.kind_p[held]], dtype="U5"),
        history_ck=pairs.state_p9[held, :2],
        width=discs.width,
        height=discs.height,
        strain=strain,
        strain_rate=rate,
        time=time,
        carried_nd=motion.carried_nd,
    )
    mobile_n = register.row_n8[:, 6] == 1.0
    inner_n4, outer_n4 = register.part_n24[:, 0], np.where(mobile_n[:, None], register.part_n24[:, 1], 0.0)
    last = Evaluation(
        *(mobile_n, register.force_nd, register.torque_n, inner_n4[:, :2], outer_n4[:, :2], inner_n4[:, 2]),
        outer_torque_n=outer_n4[:, 2],
        stress_sdd=stress_tsdd[-1],
        history_ck=seen_p9[held, :2],
    )
    # the clock of the package adds up its steps one by one
    time_t = np.add.accumulate(np.concatenate([[discs.time], np.full(steps - 1, rules.time_step)]))
    return Steps(final, time_t, strain_t, rate_t, stress_tsdd, count_tk[:, 0], count_tk[:, 1], last)
