"""Averages of G' and G'' over periods and over repeats: their errors, those that packmech states, and what they cost.

    python recordings/accuracy/averages.py

The unbonded discs of `shear_time_step.py`, which keep rearranging. An average over periods of one start is held against
the last periods of a long run of that start, one over repeats, each of a few periods, against the long runs of all
other starts. Stated are `storage_error` and `loss_error` of a run, and `mean_with_error` of repeats. The floor is what
the reference is uncertain by: half the difference of the halves of a long run, or the standard error over starts.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
from against import compare, write
from cyclopts import run
from scipy.stats import t as student
from shear_time_step import FREQUENCY, scene_of

import packmech as pm

NAMES = ("G' (relative)", "G'' (relative)")
BEFORE, EACH = 16, 4


def shear(particles: int, start: int, periods: int) -> pm.OscillatoryShear:
    """Return one start under shear, of which so many periods count after the first."""
    given = {"amplitude": 0.2, "relative_frequency": FREQUENCY, "samples_per_period": 50, "check": False}
    return pm.oscillatory_shear(scene_of("unlinked", particles, start), periods=periods + 1.0, **given)


@cache
def long_means(particles: int, starts: int, periods: int) -> np.ndarray:
    """Return (2, starts, 2) means of G' and G'' over both halves of the last periods of long runs."""
    found = [shear(particles, one, BEFORE + periods).moduli for one in range(starts)]
    each = np.array([[one.storage_p[BEFORE:], one.loss_p[BEFORE:]] for one in found])
    return np.array([half.mean(axis=2) for half in np.array_split(each, 2, axis=2)])


def trial(kind: str, particles: int, starts: int, longest: int, count: float) -> pm.Answer:
    """Return root mean squares of relative errors, and of those stated, with the share of averages that they cover."""
    halves, number = long_means(particles, starts, longest), int(count)
    long = halves.mean(axis=0)
    periods, members = (number, 1) if kind == "periods" else (EACH, number)
    found = [shear(particles, one, periods).moduli for one in range(starts)]
    value = np.array([[one.storage, one.loss] for one in found])
    if kind == "periods":
        off, stated = value - long, np.array([[one.storage_error, one.loss_error] for one in found])
        floor = np.sqrt((np.diff(halves, axis=0)[0] ** 2).mean(axis=0)) / 2.0
    else:
        groups = [np.arange(k, k + number) for k in range(0, starts - number + 1, number)]
        off = np.array([value[one].mean(axis=0) - np.delete(long, one, axis=0).mean(axis=0) for one in groups])
        stated = np.array([[pm.mean_with_error(value[one, k])[1] for k in (0, 1)] for one in groups])
        floor = long.std(axis=0, ddof=1) / np.sqrt(starts)
    scale = np.abs(long.mean(axis=0))
    expected = 2.0 * student.cdf(1.0, number - 1) - 1.0 if number > 1 else np.nan
    work = {"periods": (periods + 1.0) * members, "floor": floor[0] / scale[0], "expected share": expected}
    for k, name in enumerate(("G'", "G''")):
        work[f"stated {name}"] = float(np.sqrt((stated[:, k] ** 2).mean()) / scale[k])
        work[f"covered {name}"] = float((np.abs(off[:, k]) <= stated[:, k]).mean()) if number > 1 else np.nan
    error = np.sqrt((off**2).mean(axis=0)) / scale
    return pm.Answer(dict(zip(NAMES, error.tolist(), strict=True)), work=work)


def main(
    *, particles: int = 100, starts: int = 48, longest: int = 48, most: int = 8, out: Path = Path(__file__).parent
) -> None:
    """Average over periods and over repeats; write table, text and figure."""
    long_means(particles, starts, longest)
    names = {"periods": "periods of one start", "repeats": f"repeats of {EACH} periods"}
    table = compare(
        {name: partial(trial, kind, particles, starts, longest) for kind, name in names.items()},
        [float(2**k) for k in range(most.bit_length())],
        NAMES,
        knob="periods or repeats averaged",
        title=f"Averages of G' and G'': {particles} discs without bonds, {starts} starts",
        reference_is=f"{longest} periods after the first {BEFORE + 1} of the same start, or of all other starts",
    )
    words = "CPU s: all starts together. Periods: what one average takes, the first, which does not count, among them."
    write(table, out, "averages", words, floor="floor", clock=False)


if __name__ == "__main__":
    run(main)
