"""The unit-test scenarios of the reference package as data: what is set up, what is run, what is stated of it.

A scenario holds a start and a protocol, and its rows: for each tensor what the package's table expects of the preset,
and what the native model states in its place. Statements are names out of `STATEMENTS`, so that either model's
measurements can be held against them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from packmech.validation.particle_shear.experiment import ParticleShear
from packmech.validation.particle_shear.material import Material
from packmech.validation.particle_shear.preparation import prepared_discs
from packmech.validation.particle_shear.step import STRESSES, ShearedDiscs, StepRules, Steps, advance

Tensors = Mapping[str, NDArray[np.float64]]


def _near(found: NDArray[np.float64], expected: NDArray[np.float64], scale: float, tolerance: float = 1e-13) -> bool:
    return bool(np.abs(found - expected).max() <= tolerance * scale)


def _diagonal_near(found: NDArray[np.float64], expected: NDArray[np.float64], tolerance: float) -> bool:
    return bool((np.abs(np.diag(found) - np.diag(expected)) < tolerance * np.abs(np.diag(expected))).all())


# a statement takes the tensor it is about and all tensors at that time [Pa], compression positive
STATEMENTS: dict[str, Callable[[NDArray[np.float64], Tensors], bool]] = {
    "zero": lambda s, _: not s.any(),
    "symmetric": lambda s, _: abs(s[0, 1] - s[1, 0]) <= 1e-13 * np.abs(s).max(),
    "asymmetric": lambda s, _: abs(s[0, 1] - s[1, 0]) > 1e-6 * np.abs(s).max(),
    "positive diagonal": lambda s, _: bool((np.diag(s) > 0.0).all()),
    "not zero": lambda s, _: bool(s.any()),
    "diagonal above 500 Pa": lambda s, _: bool((np.diag(s) > 500.0).all()),
    "shear below 10 % of the xx entry": lambda s, _: max(abs(s[0, 1]), abs(s[1, 0])) < 0.1 * abs(s[0, 0]),
    "spin pressure": lambda s, all_of: (
        s[0, 0] < 0.0 and _near(s, s[0, 0] * np.eye(2), abs(s[0, 0])) and _near(s, all_of["centrifugal"], abs(s[0, 0]))
    ),
    "as love_weber": lambda s, all_of: _near(s, all_of["love_weber"], np.abs(s).max()),
    "minus unbalanced": lambda s, all_of: bool(s.any()) and _near(s, -all_of["unbalanced"], np.abs(s).max()),
    "below 10 % of overall xx": lambda s, all_of: bool(np.abs(s).max() < 0.1 * abs(all_of["overall"][0, 0])),
    "diagonal within 10 % of overall": lambda s, all_of: _diagonal_near(s, all_of["overall"], 0.1),
    "conserved": lambda s, _: bool(s[1] <= 1e-13),
}


@dataclasses.dataclass(frozen=True)
class Row:
    """One row of a table: what about, what is stated of the preset, and of the native model in its place.

    Attributes
    ----------
    about
        A tensor by our name, "angular momentum" or "linear momentum".
    states
        Names out of `STATEMENTS`; none where the table tests nothing.
    native
        What native dynamics states, by the same names.
    because
        Why the native statement is another one, where it is.
    fails
        Whether the package itself fails this row.

    """

    about: str
    states: tuple[str, ...]
    native: tuple[str, ...]
    because: str = ""
    fails: bool = False


@dataclasses.dataclass(frozen=True, eq=False)
class Scenario:
    """A start, a protocol and its rows.

    Attributes
    ----------
    name, table
        Ours, and the table's number in the package's documentation.
    start, material, rules, strain_rate_t
        What to run; as many steps as rates.
    measured_step
        The step whose tensors the rows are about; momentum is compared between the first step and the end.
    rows
        What is stated.

    """

    name: str
    table: str
    start: ShearedDiscs
    material: Material
    rules: StepRules
    strain_rate_t: NDArray[np.float64]
    measured_step: int
    rows: tuple[Row, ...]

    def run(self) -> Steps:
        """Return the scenario run with the preset."""
        return advance(self.start, self.material, self.rules, self.strain_rate_t)


def momentum(discs: ShearedDiscs) -> tuple[NDArray[np.float64], float]:
    """Return the linear momentum [mg um/s] and the angular one about the origin [mg um^2/s], per metre of depth."""
    linear = (discs.mass_n[:, None] * discs.velocity_nd).sum(axis=0)
    x, v = discs.position_nd, discs.velocity_nd
    orbital = discs.mass_n * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])
    return linear, float((orbital + discs.inertia_n * discs.spin_n).sum())


def judge(scenario: Scenario, steps: Steps) -> dict[str, dict[str, bool]]:
    """Return which of the preset's statements hold, by what they are about.

    Examples
    --------
    >>> scenario = SCENARIOS["single_sphere_spinning"]()
    >>> judge(scenario, scenario.run())["overall"]
    {'spin pressure': True}

    """
    tensors: dict[str, NDArray[np.float64]] = {name: steps.stress(name)[scenario.measured_step] for name in STRESSES}
    start, end = momentum(scenario.start), momentum(steps.final)
    each = scenario.start.mass_n * np.linalg.norm(scenario.start.velocity_nd, axis=1)
    reach = float((each * 500.0 + scenario.start.inertia_n * np.abs(scenario.start.spin_n)).sum())
    # linear momentum on the scale of the discs' own, so that a total of nothing can be judged
    own = float(each.sum()) + float((scenario.start.mass_n * np.abs(scenario.start.spin_n)).sum())
    tensors["linear momentum"] = np.array([0.0, float(np.abs(end[0] - start[0]).max()) / (own or 1.0)])
    tensors["angular momentum"] = np.array([0.0, abs(end[1] - start[1]) / (reach or 1.0)])
    return {
        row.about: {name: STATEMENTS[name](tensors[row.about], tensors) for name in row.states} for row in scenario.rows
    }


def is_as_stated(row: Row, found: Mapping[str, bool]) -> bool:
    """Return whether a row holds, or fails as it does in the package; `found` is what `judge` says of it.

    Examples
    --------
    >>> is_as_stated(Row("overall", ("symmetric",), ()), {"symmetric": True})
    True

    """
    return all(found.values()) is not row.fails


_CONSERVED = tuple(Row(f"{kind} momentum", ("conserved",), ("conserved",)) for kind in ("angular", "linear"))
_KINETIC = "kinetic parts of stress stand apart and are off; asked for by name they are + m p p / V, not zero"
_AT_REST = "the kinetic part is of velocities less their mean: a disc that flies alone has none"
_PLATE = "a contact with a wall's disc is a contact like any other: its virial counts"
_ACROSS = "a contact across the periodic boundary is a contact like any other: its virial counts"
_MISSED = "all contacts count: the preset misses more than a third of the pressure"
_NO_OUTSIDE = "nothing is outside a periodic cell: there are no outer forces"


def _same(about: str, *states: str) -> Row:
    return Row(about, states, states)


def _pair(
    position_nd: list[list[float]],
    velocity_nd: list[list[float]],
    spin_n: list[float],
    *,
    bonded: bool = False,
) -> ShearedDiscs:
    count = len(position_nd)
    pair = ShearedDiscs(
        np.array(position_nd), np.full(count, 60.0), np.ones(count), np.array(velocity_nd), np.array(spin_n)
    )
    if not bonded:
        return pair
    return pair.replace(contact_ck=np.array([[0, 1]]), kind_c=np.array(["bond"]), history_ck=np.zeros((1, 2)))


def _unit(time_step: float, *, plates: bool = False) -> StepRules:
    return StepRules(time_step, plates=plates, clears_forces=False, all_spin=True, otsuki_flow=False)


def single_sphere_moving() -> Scenario:
    """Return a disc in free flight (Table S4-2)."""
    return Scenario(
        "single_sphere_moving", "S4-2", _pair([[150.0, 200.0]], [[0.7, 0.3]], [0.0]),
        Material(1.0, 0.01, 1.0, 0.01, 0.1), _unit(0.1), np.zeros(40), 20,
        (
            *(_same(name, "zero") for name in ("love_weber", "overall", "unbalanced", "external")),
            Row("otsuki", ("zero",), ("zero",), _AT_REST, fails=True),
            *_CONSERVED,
        ),
    )  # fmt: skip


def single_sphere_spinning() -> Scenario:
    """Return a disc that spins in place (Table S4-3)."""
    return Scenario(
        "single_sphere_spinning", "S4-3", _pair([[150.0, 200.0]], [[0.0, 0.0]], [2.6]),
        Material(1.0, 0.01, 1.0, 0.01, 0.1), _unit(0.1), np.zeros(40), 20,
        (
            _same("overall", "spin pressure"),
            *(_same(name, "zero") for name in ("love_weber", "unbalanced", "external", "otsuki")),
            *_CONSERVED,
        ),
    )  # fmt: skip


def two_spheres_central() -> Scenario:
    """Return a frictionless elastic collision of two discs (Table S4-4)."""
    return Scenario(
        "two_spheres_central", "S4-4",
        _pair([[150.0, 200.0], [350.0, 300.0]], [[15.0, 0.0], [-15.0, 0.0]], [0.0, 0.0]),
        Material(1.0, friction_coefficient=0.01), _unit(0.1), np.zeros(120), 50,
        (
            _same("love_weber", "symmetric", "positive diagonal"),
            _same("overall", "as love_weber"),
            _same("unbalanced", "as love_weber"),
            _same("external", "zero"),
            Row("otsuki", ("zero",), ("not zero",), _KINETIC, fails=True),
            *_CONSERVED,
        ),
    )  # fmt: skip


def two_spheres_tangential() -> Scenario:
    """Return two bonded discs with tangential forces alone (Table S4-5): Love-Weber is F_T times the branch vector."""
    return Scenario(
        "two_spheres_tangential", "S4-5",
        _pair([[150.0, 200.0], [220.0, 260.0]], [[0.0, 0.0], [0.0, 0.0]], [0.0, 0.25], bonded=True),
        Material(0.0, 0.0, 1.0, 1.0, 0.01), _unit(0.01), np.zeros(150), 20,
        (
            _same("love_weber", "asymmetric"),
            _same("overall", "symmetric"),
            _same("unbalanced", "as love_weber"),
            _same("external", "zero"),
            Row("otsuki", (), (), _KINETIC),
            *_CONSERVED,
        ),
    )  # fmt: skip


def two_spheres_general() -> Scenario:
    """Return two bonded discs with all four kinds of force (Table S4-6)."""
    return Scenario(
        "two_spheres_general", "S4-6",
        _pair([[150.0, 200.0], [220.0, 260.0]], [[10.0, 0.0], [-10.0, 0.0]], [0.0, 0.25], bonded=True),
        Material(1.0, 1.0, 1.0, 1.0, 0.01), _unit(0.01), np.zeros(150), 20,
        (
            _same("love_weber", "positive diagonal", "asymmetric"),
            _same("overall", "symmetric", "positive diagonal"),
            _same("unbalanced", "as love_weber"),
            _same("external", "zero"),
            Row("otsuki", (), (), _KINETIC),
            *_CONSERVED,
        ),
    )  # fmt: skip


def sphere_against_plate() -> Scenario:
    """Return a disc that hits one held by the lower plate (Table S4-7)."""
    return Scenario(
        "sphere_against_plate", "S4-7",
        _pair([[150.0, 80.0], [300.0, 10.0]], [[10.0, 0.0], [-10.0, 0.0]], [0.0, 0.0]),
        Material(1.0, 1.0, 1.0, 1.0, 0.5), _unit(0.1, plates=True), np.zeros(90), 60,
        (
            Row("love_weber", ("zero",), ("positive diagonal", "asymmetric"), _PLATE),
            Row("overall", ("spin pressure",), ("positive diagonal", "symmetric"), _PLATE),
            Row("unbalanced", (), (), "no value is foreseen"),
            _same("external", "minus unbalanced"),
        ),
    )  # fmt: skip


def two_spheres_across() -> Scenario:
    """Return two discs in contact across the periodic boundary in x (Table S4-8)."""
    return Scenario(
        "two_spheres_across", "S4-8",
        _pair([[20.0, 200.0], [480.0, 230.0]], [[10.0, 0.0], [-10.0, 0.0]], [0.0, 0.25]),
        Material(1.0, 1.0, 1.0, 1.0, 0.5), _unit(0.01), np.zeros(100), 20,
        (
            Row("love_weber", ("zero",), ("positive diagonal", "asymmetric"), _ACROSS),
            Row("overall", ("spin pressure",), ("positive diagonal", "symmetric"), _ACROSS),
            Row("unbalanced", (), ("as love_weber",), "with positions unwrapped through the contact"),
            Row("external", ("minus unbalanced",), ("zero",), _NO_OUTSIDE),
        ),
    )  # fmt: skip


def _assembly_rows(*of_love_weber: str) -> tuple[Row, ...]:
    return (
        Row("love_weber", of_love_weber, of_love_weber, _MISSED),
        _same("overall", "symmetric", "diagonal above 500 Pa"),
        Row("unbalanced", ("below 10 % of overall xx",), ("below 10 % of overall xx",), "net forces on the discs"),
        Row("external", ("diagonal within 10 % of overall",), ("zero",), _NO_OUTSIDE),
    )


def _assembly(
    name: str, table: str, experiment: ParticleShear, seed: int, centers: int | None, turns: float
) -> Scenario:
    # as dense as the native scenes, which they are compared with
    start = prepared_discs(experiment, seed=seed, centers=centers, radii="equal numbers", steps=30)
    steps = int(turns / experiment.frequency / experiment.time_step)
    time_t = np.add.accumulate(np.concatenate([[0.0], np.full(steps - 1, experiment.time_step)]))
    rows: tuple[str, ...] = ("positive diagonal", "diagonal above 500 Pa")
    if turns <= experiment.pre_periods:
        rows = (*rows, "shear below 10 % of the xx entry")
    return Scenario(
        name, table, start, experiment.material, experiment.rules, experiment.strain_rate(time_t), steps - 1,
        _assembly_rows(*rows),
    )  # fmt: skip


def assembly_at_rest(*, seed: int = 1) -> Scenario:
    """Return 45 relaxed discs at rest (Table S4-9)."""
    experiment = ParticleShear(particles=45, pre_periods=0.1)
    return _assembly("assembly_at_rest", "S4-9", experiment, seed, None, 0.1)


def assembly_sheared(*, seed: int = 1) -> Scenario:
    """Return 45 relaxed discs sheared until shortly after the largest strain (Table S4-10)."""
    experiment = ParticleShear(particles=45, pre_periods=0.1)
    return _assembly("assembly_sheared", "S4-10", experiment, seed, None, 0.1 + 0.27)


def crosslinked_sheared(*, seed: int = 1) -> Scenario:
    """Return 60 discs bonded to five fragments, sheared until shortly after the largest strain (Table S4-11)."""
    experiment = ParticleShear(particles=60, pre_periods=0.1)
    return _assembly("crosslinked_sheared", "S4-11", experiment, seed, 5, 0.1 + 0.27)


SCENARIOS: dict[str, Callable[[], Scenario]] = {
    function.__name__: function
    for function in (
        single_sphere_moving,
        single_sphere_spinning,
        two_spheres_central,
        two_spheres_tangential,
        two_spheres_general,
        sphere_against_plate,
        two_spheres_across,
        assembly_at_rest,
        assembly_sheared,
        crosslinked_sheared,
    )
}
