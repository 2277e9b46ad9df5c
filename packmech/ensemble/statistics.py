"""Statistics of an ensemble: means, widths and medians over groups with bootstrap errors, histograms, power laws."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import in_words, shown
from packmech.check import (
    bin_edges,
    brief,
    clear_errors,
    finite_array,
    instance,
    integer,
    listed,
    one_of,
    positive,
    positive_array,
    real,
)
from packmech.ensemble.folder import read_job
from packmech.ensemble.table import Ensemble
from packmech.linalg.line import Line, fit_line

# what is taken of the values of a group
STATISTICS: dict[str, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
    "mean": lambda value_dr: value_dr.mean(axis=-1),
    "width": lambda value_dr: value_dr.std(axis=-1, ddof=1),
    "median": lambda value_dr: np.median(value_dr, axis=-1),
}
# results of packings without friction that level off at low pressure, and N^2 P above which they do not; 53 of 60
# packings have no contact too many at N^2 P = .04, 13 of 20 at .7, none at 10 (classify.py)
_PLATEAU_AT_LOW_PRESSURE = (
    "coordination_number",
    "excess_coordination",
    "shear_modulus",
    "shear_modulus_mean",
    "shear_modulus_reuss",
)
_BEYOND_PLATEAU = 10.0
# drawn samples that are held at once
_AT_ONCE = 200


@clear_errors
def bootstrap(
    value_r: NDArray[np.float64], *, statistic: str = "mean", draws: int = 2000, seed: int = 0
) -> tuple[float, float]:
    """Return a statistic of independent values, and its error from samples that are drawn with replacement.

    Parameters
    ----------
    value_r
        (R,) values.
    statistic
        "mean"; "width", the standard deviation; or "median".
    draws, seed
        Of the samples. Errors are larger by sqrt(R / (R - 1)), without which they are too small for few values.

    Returns
    -------
    The statistic and its standard error; nan where there are too few values.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> bootstrap(np.array([1.0, 2.0, 3.0, 4.0]))[0], round(bootstrap(np.arange(400.0), draws=500)[1], 1)
    (2.5, 5.6)

    """
    value = finite_array("value_r", value_r, shape=(None,), what="value", empty=True)
    of = STATISTICS[one_of("statistic", statistic, STATISTICS)]
    integer("draws", draws, at_least=2, bytes_each=8.0)
    rng = np.random.default_rng(integer("seed", seed, at_least=0))
    least = 2 if statistic == "width" else 1
    if len(value) < least:
        return math.nan, math.nan
    if len(value) == 1:
        return float(of(value)), math.nan
    parts = [min(_AT_ONCE, draws - k) for k in range(0, draws, _AT_ONCE)]
    drawn = np.concatenate([of(value[rng.integers(len(value), size=(part, len(value)))]) for part in parts])
    return float(of(value)), float(drawn.std(ddof=1) * math.sqrt(len(value) / (len(value) - 1.0)))


@shown()
@dataclass(frozen=True, eq=False)
class GroupStatistics:
    """A statistic of a result over groups of members with equal parameters.

    Attributes
    ----------
    name, statistic
        The result, and what was taken of it.
    by
        (G,) values of each parameter that the groups differ in, by name.
    value_g, error_g
        (G,) the statistic and its bootstrap error; nan where a group has too few values.
    count_g
        (G,) finite values in each group.

    """

    name: str
    statistic: str
    by: dict[str, NDArray[Any]]
    value_g: NDArray[np.float64]
    error_g: NDArray[np.float64]
    count_g: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.value_g)


def varied_parameters(ensemble: Ensemble) -> tuple[str, ...]:
    """Return the parameters other than seeds of which the ensemble has several values."""
    return tuple(
        name
        for name in ensemble.parameters
        if name.rpartition(".")[2] != "seed" and len(set(ensemble[name].tolist())) > 1
    )


def values_of(ensemble: Ensemble, name: str) -> NDArray[np.float64]:
    """Return the values of a result of the members that are done, those that are finite.

    Raises
    ------
    KeyError, ValueError
        If there is no such result, or it is none of numbers.

    """
    column = ensemble[name]
    if column.dtype.kind == "U":
        raise ValueError(f"name must be that of numbers, got {brief(name)}, a text")
    value: NDArray[np.float64] = column[ensemble["state"] == "done"].astype(np.float64)
    finite: NDArray[np.float64] = value[np.isfinite(value)]
    return finite


@clear_errors
def group_statistics(
    ensemble: Ensemble,
    name: str,
    by: Sequence[str] | None = None,
    *,
    statistic: str = "mean",
    draws: int = 2000,
    seed: int = 0,
) -> GroupStatistics:
    """Return a statistic of a result over groups of members, with its error.

    Parameters
    ----------
    ensemble
        The ensemble; members that are not done do not count.
    name
        Of the result.
    by
        Names of the parameters that groups differ in; None: all of which there are several values, but for seeds.
    statistic, draws, seed
        As in `bootstrap`.

    Raises
    ------
    TypeError, ValueError
        If there is no such result or parameter, or another argument is not what it must be.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> folder = pathlib.Path(tempfile.mkdtemp()) / "out"
    >>> grid = {"dimension": 2, "particles": [4, 16], "packing_fraction": 0.5, "seed": range(3)}
    >>> made = pm.run_ensemble("packmech.generate:random_packing", grid, folder, workers=1)
    >>> found = pm.group_statistics(made, "seconds", ["particles"])
    >>> found.by["particles"].tolist(), found.count_g.tolist()
    ([4, 16], [3, 3])

    """
    instance("ensemble", ensemble, Ensemble, "an")
    one_of("name", name, ensemble.columns)
    names = varied_parameters(ensemble) if by is None else tuple(listed("by", by, "names of parameters"))
    for k, one in enumerate(names):
        one_of(f"by[{k}]", one, ensemble.parameters)
    one_of("statistic", statistic, STATISTICS)
    integer("draws", draws, at_least=2, bytes_each=8.0)
    integer("seed", seed, at_least=0)
    keys = [tuple(row) for row in zip(*(ensemble[one].tolist() for one in names), strict=True)] if names else []
    keys = keys or [()] * len(ensemble)
    groups = {key: np.flatnonzero([one == key for one in keys]) for key in sorted(set(keys))}
    rows = []
    for index in groups.values():
        value = values_of(ensemble.take(index), name)
        rows.append((*bootstrap(value, statistic=statistic, draws=draws, seed=seed), len(value)))
    value_g, error_g, count_g = (np.array(one) for one in zip(*rows, strict=True))
    columns = {one: np.array([key[k] for key in groups]) for k, one in enumerate(names)}
    return GroupStatistics(name, statistic, columns, value_g, error_g, count_g.astype(np.int64))


@shown()
class Histogram(NamedTuple):
    """How values are spread: (B+1,) edges, (B,) counts, and the density with its error from counting."""

    edge_b: NDArray[np.float64]
    count_b: NDArray[np.int64]
    density_b: NDArray[np.float64]
    error_b: NDArray[np.float64]


@clear_errors
def histogram(value_r: NDArray[np.float64], *, bins: int | NDArray[np.float64] | None = None) -> Histogram:
    """Return the histogram of values.

    Parameters
    ----------
    value_r
        (R,) values.
    bins
        How many of equal width, or their edges; None: as many as the rule of Freedman and Diaconis says.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> histogram(np.array([0.0, 1.0, 1.0, 2.0]), bins=2).count_b.tolist()
    [1, 3]

    """
    value = finite_array("value_r", value_r, shape=(None,), what="value")
    given = None if bins is None else bin_edges("bins", bins)
    try:
        count, edge = np.histogram(value, bins="fd" if given is None else given)
    except ValueError as error:
        raise ValueError(f"value_r must differ by more than their rounding for so many bins: {error}") from None
    area = np.diff(edge) * max(1, count.sum())
    return Histogram(edge, count.astype(np.int64), count / area, np.sqrt(count) / area)


class PowerLawFit(NamedTuple):
    """value = limit + prefactor * size**exponent, each with its standard error; `chi_square` per degree of freedom.

    Where chi_square is above one the law misses the values by more than their errors, and the errors of the fit are
    larger by its root.
    """

    exponent: float
    exponent_error: float
    prefactor: float
    prefactor_error: float
    limit: float
    limit_error: float
    chi_square: float


@clear_errors
def fit_power_law(
    size_g: NDArray[Any], value_g: NDArray[np.float64], error_g: NDArray[np.float64], *, exponent: float | None = None
) -> PowerLawFit:
    """Return the power law that fits values of groups, weighted by their errors.

    Parameters
    ----------
    size_g
        (G,) positive, such as the number of particles.
    value_g, error_g
        (G,) values and their errors.
    exponent
        None: of value = prefactor size^exponent, a straight line of the logarithms. A number: of value = limit +
        prefactor size^exponent with this exponent, which gives the limit of infinite size where it is negative.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, there are fewer than three sizes, or values that are not positive where
        logarithms are taken.

    Examples
    --------
    >>> size = np.array([32, 64, 256, 1024])
    >>> found = fit_power_law(size, 0.3 * size**-0.5, 0.001 * size**-0.5)
    >>> round(found.exponent, 6), round(found.prefactor, 6)
    (-0.5, 0.3)
    >>> found = fit_power_law(size, 0.84 - 0.1 / size, np.full(4, 1e-4), exponent=-1.0)
    >>> round(found.limit, 6), round(found.prefactor, 6)
    (0.84, -0.1)

    """
    size = positive_array("size_g", size_g, shape=(None,), what="group")
    error = positive_array("error_g", error_g, shape=size.shape, what="group")
    if len(np.unique(size)) < 3:
        raise ValueError(f"size_g must hold three sizes or more for a fit, got {np.unique(size).tolist()}")
    if exponent is None:
        value = positive_array("value_g", value_g, shape=size.shape, what="group")
        # about the middle, where slope and height are least dependent
        middle = float(np.exp(np.log(size).mean()))
        slope, height, slope_error, height_error, chi = _missed(
            fit_line(np.log(size / middle), np.log(value), error / value)
        )
        prefactor = math.exp(height) * middle**-slope
        relative = math.hypot(height_error, math.log(middle) * slope_error)
        return PowerLawFit(slope, slope_error, prefactor, prefactor * relative, 0.0, 0.0, chi)
    power = real("exponent", exponent)
    if power == 0.0:
        raise ValueError(f"exponent must differ from zero, where the law is its limit alone, got {brief(exponent)}")
    with np.errstate(over="ignore", under="ignore"):
        raised = size**power
    if not (np.isfinite(raised) & (raised > 0.0)).all():
        raise ValueError(f"exponent must be so small that sizes to its power are numbers, got {brief(exponent)}")
    value = finite_array("value_g", value_g, shape=size.shape, what="group")
    if not np.ptp(raised) > 1e-12 * np.abs(raised).max():
        raise ValueError(f"exponent must tell sizes apart when they are raised to it, got {brief(exponent)}")
    slope, height, slope_error, height_error, chi = _missed(fit_line(raised, value, error))
    return PowerLawFit(power, 0.0, slope, slope_error, height, height_error, chi)


def _missed(line: Line) -> Line:
    """Return a line whose errors hold what it misses the points by beyond theirs."""
    wider = math.sqrt(max(1.0, line.chi_square))
    return line._replace(slope_error=line.slope_error * wider, height_error=line.height_error * wider)


@clear_errors
def small_value_exponent(values: Sequence[NDArray[np.float64]], largest: float) -> tuple[float, float, int]:
    """Return e of a density ~ x^e below `largest`, its error, and the number of values that take part.

    The maximum of the likelihood, n / sum of log(largest / x) - 1 (Hill); the error is found by leaving out packings,
    and nan where one has all of the values.

    Parameters
    ----------
    values
        Those of each packing, positive.
    largest
        Up to which the density is taken to be a power law.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> parts = [rng.random(1000) ** (1 / 1.4) for _ in range(20)]  # density ~ x^0.4
    >>> exponent, error, count = small_value_exponent(parts, 1.0)
    >>> abs(exponent - 0.4) < 3.0 * error < 0.1, count
    (True, 20000)

    """
    end = positive("largest", largest)
    if isinstance(values, str) or not isinstance(values, Sequence):
        raise TypeError(f"values must be a sequence of arrays, one for each packing, got {brief(values)}")
    parts = [finite_array(f"values[{k}]", one, shape=(None,), what="value", empty=True) for k, one in enumerate(values)]
    for k, one in enumerate(parts):
        if (one <= 0.0).any():
            raise ValueError(f"values[{k}] must be positive, got {one.min():g}")
    logs = [np.log(end / one[one < end]) for one in parts]
    count = np.array([len(one) for one in logs], dtype=float)
    total = np.array([one.sum() for one in logs])
    if count.sum() == 0:
        return math.nan, math.nan, 0
    exponent = count.sum() / total.sum() - 1.0
    error = math.nan
    # without any packing some values must be left
    if len(logs) > 1 and (count < count.sum()).all():
        left = (count.sum() - count) / (total.sum() - total) - 1.0
        error = math.sqrt((len(left) - 1) * float(((left - left.mean()) ** 2).mean()))
    return float(exponent), error, int(count.sum())


def crossover_warning(ensemble: Ensemble, name: str, over: str) -> str:
    """Return what must be said of a power law of a result over pressure; empty where nothing must be.

    Below N^2 P of about one, P in units of the stiffness of contacts, packings of N particles without friction have the
    one contact more than isostatic that a rigid packing must have, and shear moduli of order 1/N, whatever the pressure
    (Goodrich, Liu and Nagel, Phys. Rev. Lett. 109, 095704 (2012); Dagois-Bohy et al., Phys. Rev. Lett. 109, 095703
    (2012)). Pressures are taken in the units of `jam`, which are these for contacts of a constant stiffness; of other
    power laws the stiffness at the pressure counts.

    Parameters
    ----------
    ensemble
        The ensemble.
    name
        Of the result.
    over
        The parameter that it is fitted over.

    """
    particles = next((one for one in ("particles", "packing.particles") if one in ensemble.columns), None)
    if over.rpartition(".")[2] != "pressure" or name not in _PLATEAU_AT_LOW_PRESSURE or particles is None:
        return ""
    exponent = _exponent_of_contacts(ensemble)
    done = ensemble["state"] == "done"
    pressure, number = (ensemble[one][done].astype(np.float64) for one in (over, particles))
    if exponent is None or not len(pressure) or not (pressure > 0.0).all():
        return ""
    # P grows as overlap^(exponent - 1), and the stiffness as overlap^(exponent - 2)
    size = float((number**2 * pressure ** (1.0 / (exponent - 1.0))).min())
    if not size < _BEYOND_PLATEAU:
        return ""
    return (
        f"warning: N^2 P is {size:.2g} at the lowest pressure, in units of the stiffness of contacts: below about "
        f"{_BEYOND_PLATEAU:g} z - z_iso and G of a packing of N particles level off, and a fit is of this crossover, "
        "not of the exponent of large packings (Goodrich, Liu and Nagel 2012; Dagois-Bohy et al. 2012)"
    )


# of energies in the overlap, where it is not 2
_EXPONENTS = {"hertz": 2.5, "elastic-spheres": 2.5}


def _exponent_of_contacts(ensemble: Ensemble) -> float | None:
    """Return the exponent of the energy in the overlap, 2 where it is not known; None where friction changes the rule.

    Functions, and laws that are no power of the overlap, count as contacts of a constant stiffness.
    """
    scene = read_job(ensemble.folder).get("scene", {})
    effects = scene.get("effects", [])
    if "material" in scene or any(one["kind"] == "friction" for one in effects):
        return None
    law = next((one.get("law") for one in effects if one["kind"] == "repulsion"), None)
    # near contact a law of another one is that
    while isinstance(law, Mapping) and "law" in law:
        law = law["law"]
    kind, given = (law.get("kind"), law) if isinstance(law, Mapping) else (law, {})
    return float(given.get("exponent", 2.0)) if kind == "power-law" else _EXPONENTS.get(str(kind), 2.0)


def series_of(found: GroupStatistics, over: str) -> list[tuple[str, NDArray[np.int64]]]:
    """Return the curves over one parameter: a label for the values of the others, and the groups on it in order."""
    others = [name for name in found.by if name != over]
    keys = [tuple(found.by[name][g] for name in others) for g in range(len(found))]
    curves = []
    for key, part in itertools.groupby(
        sorted(range(len(found)), key=lambda g: (keys[g], found.by[over][g])), keys.__getitem__
    ):
        label = ", ".join(f"{name} = {in_words(value)}" for name, value in zip(others, key, strict=True))
        curves.append((label, np.array(list(part))))
    return curves
