"""What packmech answers, before and after a change: the cases of answer_cases.py stored in a file, two files compared.

Before the change, then after it with the packings of before, so that static questions are asked of the same packings:

    python tests/benchmarks/bench_answers.py write BEFORE.npz
    python tests/benchmarks/bench_answers.py write AFTER.npz --packings BEFORE.npz
    python tests/benchmarks/bench_answers.py compare BEFORE.npz AFTER.npz

`write` prints the seconds of each case; --only PATTERN ... (as in a shell, such as "jam/*") makes some cases only, and
`list` prints their names. Bits are reproduced by the same command once all code is compiled: functions are linked to
the copies of others that the process loaded first, so run it twice before bits are compared, and with the same cases.

`compare` prints for each case the largest difference of its arrays over the largest size in the array, the worst case
first: those that are static, where more than rounding (--tolerance) is named as "MOVED", and those in which rounding
grows. It ends with 1 where a case is missing or something discrete differs: integers, booleans, texts, shapes of
arrays, and whether a call refuses (with --strict also where a static case moved). Not judged are

 - counts of work, below "work" in a name: steps, force evaluations, entries that a matrix stores;
 - residuals and their like (RESIDUALS) while they are small: they are named where they grew by much;
 - numbers in messages of refusals.

Numbers count as at least FLOOR in size: what is below is zero to rounding in the units of the cases.
"""

from __future__ import annotations

import argparse
import enum
import fnmatch
import io
import json
import os
import re
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from answer_cases import CASES, PACKINGS, refusal
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import packmech as pm

FLOOR = 1e-6
# what is zero but for rounding and tolerances while it is below SMALL, and by how much more it has grown
SMALL, GROWN, LEAST = 1e-6, 100.0, 1e-12
RESIDUALS = (
    *("*residual*", "*error*", "*imbalance*", "*balance*", "*gap*", "*drift*", "*anisotropy*", "*kinetic_energy*"),
    *("rounding_floor", "*singular value*"),
)
_NUMBER = re.compile(r"[-+]?\d*\.?\d+(?:e[-+]?\d+)?")

Arrays = dict[str, NDArray[Any]]


# -- write -------------------------------------------------------------------------------------------------------------


class Packings:
    """Packings by name: as a file has them, or made, and then as they come back from a file.

    Attributes
    ----------
    file
        Name -> bytes of the packing's own file, of all that were taken.
    taken
        Names that were asked for since this was last emptied, not counting what packings are made from.

    """

    def __init__(self, stored: Mapping[str, NDArray[np.uint8]]) -> None:
        self.stored = stored
        self.file: Arrays = {}
        self.taken: list[str] = []
        self._found: dict[str, pm.Packing | Exception] = {}
        self._depth = 0

    def __call__(self, name: str) -> pm.Packing:
        if self._depth == 0 and name not in self.taken:
            self.taken.append(name)
        if name not in self._found:
            self._depth += 1
            try:
                self._found[name] = self._find(name)
            except Exception as error:  # noqa: BLE001 - the answer of every case that takes it
                self._found[name] = error
            finally:
                self._depth -= 1
        found = self._found[name]
        if isinstance(found, Exception):
            raise RuntimeError(f"packing {name!r} could not be made: {type(found).__name__}: {found}") from found
        return found

    def _find(self, name: str) -> pm.Packing:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "packing.npz"
            if name in self.stored:
                path.write_bytes(self.stored[name].tobytes())
            else:
                pm.write_packing(PACKINGS[name](self), path)
            self.file[name] = np.frombuffer(path.read_bytes(), dtype=np.uint8)
            return pm.read_packing(path)


def flatten(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Find the arrays of an answer, under names that say where they stand in it."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from flatten(f"{name}/{key}" if name else str(key), part)
    elif isinstance(value, enum.Enum):
        yield name, np.array(str(value.value))
    else:
        array = np.asarray(value)
        if array.dtype.kind not in "biufcU":
            raise TypeError(f"{name} must be a number, a text or an array of these, got {type(value).__name__}")
        yield name, array


def write(path: Path, patterns: list[str], packings: Path | None) -> None:
    """Make the answers of the cases that match and store them."""
    stored = {} if packings is None else read(packings).packings
    take, arrays, about = Packings(stored), {}, {}
    begin = time.perf_counter()
    for name in chosen(patterns):
        take.taken = []
        started = time.perf_counter()
        with warnings.catch_warnings(), threadpool_limits(limits=1):
            warnings.simplefilter("ignore")
            try:
                answer = CASES[name].function(take)
            except Exception as error:  # noqa: BLE001 - that a case raises is its answer
                answer = refusal(error)
            made = dict(flatten("", answer))
        seconds = time.perf_counter() - started
        arrays |= {f"answer::{name}::{key}": array for key, array in made.items()}
        about[name] = {"amplifies": CASES[name].amplifies, "seconds": seconds, "packings": take.taken}
        refused = sum(key.split("/")[-1] == "refused" for key in made)
        note = f", {refused} refusals" if refused else ""
        print(f"{seconds:8.2f} s  {name}  ({len(made)} arrays{note})", flush=True)
    arrays |= {f"packing::{name}": array for name, array in take.file.items()}
    part = path.with_suffix(f".{os.getpid()}.part")
    with part.open("wb") as file:
        np.savez_compressed(file, about=np.array(json.dumps(about)), **arrays)
    part.replace(path)
    new = sorted(set(take.file) - set(stored))
    print(f"{len(about)} cases, {time.perf_counter() - begin:.1f} s; {len(take.file)} packings, {len(new)} made anew")


def chosen(patterns: list[str]) -> list[str]:
    """Return the names of the cases that match."""
    names = [name for name in CASES if any(fnmatch.fnmatchcase(name, one) for one in patterns)]
    if not names:
        raise SystemExit(f"--only must match the name of a case (see `list`), got {patterns}")
    return names


# -- compare -----------------------------------------------------------------------------------------------------------


class Stored(NamedTuple):
    """What a file holds: of each case its arrays and what is told about it, and the packings."""

    answers: dict[str, Arrays]
    about: dict[str, dict[str, Any]]
    packings: dict[str, NDArray[np.uint8]]


class Difference(NamedTuple):
    """How one array differs: relative size, nan where it is not measured so, and in words."""

    name: str
    relative: float
    words: str
    discrete: bool = False


class Row(NamedTuple):
    """What came of the comparison of one case."""

    name: str
    amplifies: bool
    arrays: int
    equal: int
    differences: list[Difference]
    other_packings: list[str]

    @property
    def worst(self) -> float:
        """The largest relative difference."""
        return max((one.relative for one in self.differences if not np.isnan(one.relative)), default=0.0)

    @property
    def discrete(self) -> int:
        """How many discrete answers differ."""
        return sum(one.discrete for one in self.differences)


def read(path: Path) -> Stored:
    """Return what a file holds."""
    with np.load(path, allow_pickle=False) as file:
        about = json.loads(str(file["about"]))
        answers: dict[str, Arrays] = {name: {} for name in about}
        packings = {}
        for key in file.files:
            kind, _, name = key.partition("::")
            if kind == "answer":
                one, _, array = name.partition("::")
                answers[one][array] = file[key]
            elif kind == "packing":
                packings[name] = file[key]
    return Stored(answers, about, packings)


def same_bits(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """Whether two arrays are the same to the last bit."""
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


def is_work(name: str) -> bool:
    """Whether an array counts work."""
    return "work" in name.split("/")


def is_residual(name: str) -> bool:
    """Whether an array is a residual, or else zero but for rounding where it is small."""
    last = name.split("/")[-1]
    return any(fnmatch.fnmatchcase(last, pattern) for pattern in RESIDUALS)


def in_short(array: NDArray[Any]) -> str:
    """Return an array in a few words."""
    text = str(array) if array.ndim == 0 else np.array2string(array, threshold=6, edgeitems=2, separator=" ")
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def largest(array: NDArray[Any]) -> float:
    """Return the largest size in an array of numbers."""
    return float(np.abs(array).max(initial=0.0))


def difference(name: str, one: NDArray[Any], other: NDArray[Any]) -> Difference | None:
    """Return how two arrays that are not bit for bit the same differ; None where that is no difference."""
    apart = f"{in_short(one)} -> {in_short(other)}"
    real = one.dtype.kind in "fc" and other.dtype.kind in "fc"
    if one.shape != other.shape:
        return Difference(name, np.nan, f"shape {one.shape} -> {other.shape}", discrete=True)
    if not real:
        if one.dtype.kind == other.dtype.kind == "U" and name.split("/")[-1] == "message":
            plain = [_NUMBER.sub("#", str(text)) for text in (one, other)]
            return None if plain[0] == plain[1] else Difference(name, np.nan, apart, discrete=True)
        if one.dtype.kind == other.dtype.kind and np.array_equal(one, other):
            return None
        return Difference(name, np.nan, apart, discrete=True)
    if is_residual(name):
        before, after = largest(one), largest(other)
        if max(before, after) < SMALL:
            grown = after > max(GROWN * before, LEAST)
            return Difference(name, np.nan, f"grew: {before:.1e} -> {after:.1e}") if grown else None
    finite = np.isfinite(one) & np.isfinite(other)
    if not np.array_equal(one[~finite], other[~finite], equal_nan=True):
        return Difference(name, np.inf, f"not finite: {apart}", discrete=True)
    distance = largest(np.where(finite, one, 0.0) - np.where(finite, other, 0.0))
    size = max(largest(one[finite]), largest(other[finite]), FLOOR)
    return Difference(name, distance / size, f"by {distance:.1e} in {size:.1e}") if distance else None


def compare_case(name: str, before: Stored, after: Stored) -> Row:
    """Compare what two files hold of a case."""
    one, other = before.answers[name], after.answers[name]
    differences, equal = [], 0
    judged = [key for key in one if not is_work(key)]
    for key in judged:
        if key not in other:
            differences.append(Difference(key, np.nan, f"lost, was {in_short(one[key])}", discrete=True))
        elif same_bits(one[key], other[key]):
            equal += 1
        else:
            found = difference(key, one[key], other[key])
            differences += [] if found is None else [found]
    new = [key for key in other if key not in one and not is_work(key)]
    differences += [Difference(key, np.nan, f"new: {in_short(other[key])}", discrete=True) for key in new]
    differences.sort(key=lambda found: (not found.discrete, -np.nan_to_num(found.relative, nan=0.0)))
    taken = before.about[name]["packings"]
    others = [key for key in taken if not same_packing(before.packings.get(key), after.packings.get(key))]
    return Row(name, before.about[name]["amplifies"], len(judged), equal, differences, others)


def same_packing(one: NDArray[np.uint8] | None, other: NDArray[np.uint8] | None) -> bool:
    """Whether two packings have the same arrays in their files."""
    if one is None or other is None:
        return one is other
    if np.array_equal(one, other):
        return True
    with np.load(io.BytesIO(one.tobytes())) as first, np.load(io.BytesIO(other.tobytes())) as second:
        return set(first.files) == set(second.files) and all(same_bits(first[key], second[key]) for key in first.files)


def print_row(row: Row, tolerance: float, shown: int) -> None:
    """Print a case and its differences."""
    words = []
    if row.discrete:
        words.append(f"{row.discrete} DISCRETE")
    if not row.amplifies and row.worst > tolerance:
        words.append("MOVED")
    if row.other_packings:
        words.append(f"other packings: {len(row.other_packings)}")
    worst = "equal bits" if row.equal == row.arrays and not row.differences else f"{row.worst:.1e}"
    print(f"{row.name:42s} {worst:>10s} {row.equal:6d}/{row.arrays:<6d} {', '.join(words)}".rstrip())
    for one in row.differences[:shown]:
        size = "" if np.isnan(one.relative) else f"{one.relative:.1e}"
        print(f"    {size:>8s}  {one.name}  {one.words}")
    if len(row.differences) > shown > 0:
        print(f"    and {len(row.differences) - shown} more (--all)")


def compare(before: Path, after: Path, *, tolerance: float, strict: bool, shown: int) -> int:
    """Print the table; return 1 where something is missing or something discrete differs."""
    one, other = read(before), read(after)
    missing = [name for name in one.about if name not in other.about]
    rows = [compare_case(name, one, other) for name in one.about if name in other.about]
    rows.sort(key=lambda row: (-min(row.discrete, 1), -row.worst, row.equal == row.arrays))
    for amplifies, title in ((False, "static: equal to rounding"), (True, "rounding grows")):
        print(f"\n{title:42s} {'largest':>10s} {'equal bits':>13s}")
        for row in rows:
            if row.amplifies == amplifies:
                print_row(row, tolerance, shown)
    for name in missing:
        print(f"MISSING: {name}")
    new = [name for name in other.about if name not in one.about]
    if new:
        print(f"only in {after}: {', '.join(new)}")
    static, grown = ([row for row in rows if row.amplifies == amplifies] for amplifies in (False, True))
    moved = sum(row.worst > tolerance for row in static)
    seconds = [sum(about["seconds"] for about in file.about.values()) for file in (one, other)]
    print(
        f"\n{len(rows)} cases, {len(missing)} missing; equal bits in {sum(row.equal == row.arrays for row in rows)}; "
        f"discrete differences in {sum(row.discrete > 0 for row in static)} static cases and "
        f"{sum(row.discrete > 0 for row in grown)} in which rounding grows; {moved} static cases moved by more than "
        f"{tolerance:g}; {seconds[0]:.0f} s before, {seconds[1]:.0f} s after"
    )
    wrong = bool(missing) or any(row.discrete for row in rows) or (strict and moved > 0)
    return int(wrong)


def main(words: list[str] | None = None) -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    make: Any = verbs.add_parser("write", help="make the answers and store them")
    make.add_argument("file", type=Path)
    make.add_argument("--only", nargs="+", default=["*"], metavar="PATTERN", help="cases by name")
    make.add_argument("--packings", type=Path, metavar="FILE", help="take the packings that an earlier file holds")
    two: Any = verbs.add_parser("compare", help="compare two files")
    two.add_argument("before", type=Path)
    two.add_argument("after", type=Path)
    two.add_argument("--tolerance", type=float, default=1e-7, help="what rounding may do in static cases (%(default)g)")
    two.add_argument("--strict", action="store_true", help="end with 1 also where a static case moved")
    two.add_argument("--all", action="store_true", help="print every array that differs")
    verbs.add_parser("list", help="print the names of the cases")
    given = parser.parse_args(words)
    if given.verb == "list":
        print("\n".join(CASES))
        return 0
    if given.verb == "write":
        write(given.file, given.only, given.packings)
        return 0
    shown = sys.maxsize if given.all else 4
    return compare(given.before, given.after, tolerance=given.tolerance, strict=given.strict, shown=shown)


if __name__ == "__main__":
    sys.exit(main())
