# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Two versions of packmech on the same cases: do they give the same bits, and where not, why and how far apart.

Run both versions and compare, on one machine, each version in a process of its own:

    python tests/benchmarks/compare_versions.py both --tag PATH_OF_A_CHECKOUT [--out FOLDER] [--cases PATTERN ...]

The other version (the "tag") is a checkout of its commit, for example of `git worktree add PATH COMMIT`. Or one by one,
where PYTHONPATH says whose results are made, and --names in whose words that packmech speaks:

    PYTHONPATH=TAG:TAG/envs python tests/benchmarks/compare_versions.py run --names tag --out FOLDER_A
    PYTHONPATH=$PWD:$PWD/envs python tests/benchmarks/compare_versions.py run --names head --out FOLDER_B
    python tests/benchmarks/compare_versions.py compare FOLDER_A FOLDER_B

`run` writes a .npz file for each case and skips cases whose file is there, so that it may be stopped and started again;
take a file away to make it anew (--anew makes all anew). `list` prints the names of the cases; PATTERN is as in a
shell, such as "jam/*". `compare` prints a row for each case and everything that differs; it ends with 1 where a case
does not agree as it should, failed, or is missing on one side.

Every case is run in a process of its own, forked before any machine code is loaded, and once more where something had
to be compiled. For a function that several compiled functions call is linked to the copy of it that the process loaded
first, and copies may fuse products and sums differently: bits would depend on which cases were run before.

The cases stand in version_cases.py, in the head's words. After a change of the vocabulary, change it in the cases and
extend the tables of versions.py, which say what the tag calls it and how its results are turned into the head's; what
is gone from results on purpose is named there, too (`GONE`). Results are bit for bit the same unless `AGREEMENT` in
version_cases.py says otherwise, case by case, with the reason: for runs through time whose sums go in another order,
`order_of_sums(reason)` asks for rounding over the first 100 steps and then for conserved quantities and averages.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba.core.event import install_recorder
from threadpoolctl import threadpool_limits
from version_cases import AGREEMENT, CASES, Agreement, Near
from versions import GONE, SIDES, Versions

_HERE = Path(__file__).resolve()
_HEAD = _HERE.parents[2]


def file_of(folder: Path, name: str) -> Path:
    """Return the file of a case."""
    return folder / (name.replace("/", "--").replace(" ", "_") + ".npz")


def chosen(patterns: list[str]) -> list[str]:
    """Return the names of the cases that match."""
    names = [name for name in CASES if any(fnmatch.fnmatchcase(name, one) for one in patterns)]
    if not names:
        raise SystemExit(f"cases must match the name of a case (see `list`), got {patterns}")
    return names


# -- run ---------------------------------------------------------------------------------------------------------------


MADE, FAILED, COMPILED = range(3)


def make(versions: Versions, name: str, path: Path) -> int:
    """Write the results of a case; return COMPILED where something was compiled for it."""
    try:
        # one thread of BLAS: bits must not depend on how many cores are free
        with warnings.catch_warnings(), threadpool_limits(limits=1), install_recorder("numba:compile") as compiled:
            warnings.simplefilter("ignore")
            arrays = versions.record(CASES[name](versions))
    except Exception as error:
        steps = "".join(traceback.format_tb(error.__traceback__)[-4:])
        print(f"FAILED {name}\n{steps}{type(error).__name__}: {str(error)[:1000]}", flush=True)
        return FAILED
    # named after the process, so that two may fill one folder
    made = path.with_suffix(f".{os.getpid()}.part")
    with made.open("wb") as file:
        np.savez_compressed(file, **arrays)
    made.replace(path)
    return COMPILED if compiled.buffer else MADE


def make_alone(versions: Versions, name: str, path: Path) -> int:
    """Do the same in a process of its own that has loaded no machine code yet; print what it took."""
    began = time.perf_counter()
    child = os.fork()
    if child == 0:
        code = FAILED
        try:
            code = make(versions, name, path)
        finally:
            sys.stdout.flush()
            os._exit(code)
    _, status, usage = os.wait4(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        print(f"FAILED {name}\nthe process ended with signal {-code}", flush=True)
    elif code != FAILED:
        cpu = usage.ru_utime + usage.ru_stime
        note = "  (compiled)" if code == COMPILED else ""
        print(f"{time.perf_counter() - began:7.2f} s, {cpu:7.2f} s CPU  {name}{note}", flush=True)
    return code


def run(folder: Path, names: list[str], side: str, *, anew: bool) -> int:
    """Make the results of the importable packmech; return how many cases failed."""
    versions = Versions(side)
    versions.load()
    folder.mkdir(parents=True, exist_ok=True)
    print(f"{len(names)} cases of {Path(versions.module.__file__).parent} in the words of the {side}", flush=True)
    failed = 0
    for name in names:
        path = file_of(folder, name)
        if path.exists() and not anew:
            continue
        path.unlink(missing_ok=True)
        code = make_alone(versions, name, path)
        if code == COMPILED:
            # results are those of machine code that is loaded; what is just compiled may be linked otherwise
            code = make_alone(versions, name, path)
        failed += code not in (MADE, COMPILED)
    return failed


# -- compare -----------------------------------------------------------------------------------------------------------


class Difference(NamedTuple):
    """How an array differs: its name, how far apart (inf: of another shape or kind), in what size, and the kind."""

    name: str
    apart: float
    size: float
    kind: str

    @property
    def relative(self) -> float:
        """Return the difference over the largest size in the array."""
        return self.apart / self.size if self.apart else 0.0


def same_bits(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays are of one type and shape and have the same bits."""
    return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()


def difference(name: str, one: np.ndarray, other: np.ndarray) -> Difference:
    """Return how far two arrays are apart that do not have the same bits."""
    if one.shape != other.shape:
        return Difference(name, np.inf, 1.0, f"shapes {one.shape} and {other.shape}")
    if one.dtype.kind in "US" or other.dtype.kind in "US":
        same = bool((one == other).all()) if one.dtype.kind == other.dtype.kind else False
        return Difference(name, 0.0 if same else np.inf, 1.0, f"{one} and {other}"[:60])
    kind = "" if one.dtype == other.dtype else f"types {one.dtype} and {other.dtype}"
    a, b = one.astype(np.complex128), other.astype(np.complex128)
    # infinities of one sign, and what is no number on both sides, are the same
    with np.errstate(invalid="ignore"):
        apart = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b))
    apart = np.where(np.isnan(apart), np.inf, apart)
    finite = np.concatenate([np.abs(x[np.isfinite(x)]).ravel() for x in (a, b)])
    return Difference(name, float(apart.max(initial=0.0)), float(finite.max(initial=0.0)) or 1.0, kind)


def agreement_of(name: str) -> Agreement | None:
    """Return how a case has to agree where that is not bit for bit."""
    return next((one for pattern, one in AGREEMENT.items() if fnmatch.fnmatchcase(name, pattern)), None)


def near_of(agreement: Agreement | None, array: str) -> Near | None:
    """Return how near an array has to be; None where it is not compared."""
    if agreement is not None:
        for pattern, near in agreement.arrays.items():
            if fnmatch.fnmatchcase(array, pattern):
                return near
    return Near()


def is_gone(name: str, array: str) -> bool:
    """Whether an array of the tag is gone on purpose."""
    return any(
        fnmatch.fnmatchcase(name, pattern) and any(fnmatch.fnmatchcase(array, one) for one in listed)
        for pattern, listed in GONE.items()
    )


class Row(NamedTuple):
    """What came of the comparison of one case."""

    agrees: bool
    identical: int
    compared: int
    worst: Difference | None
    lines: list[str]


def compare_case(name: str, one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> Row:
    """Compare the tag's results of a case with the head's."""
    agreement = agreement_of(name)
    identical, compared, agrees, lines, worst = 0, 0, True, [], None
    for array in one:
        if array not in other:
            if not is_gone(name, array):
                agrees = False
                lines.append(f"lost: {array}")
            continue
        near = near_of(agreement, array)
        if near is None:
            continue
        compared += 1
        if same_bits(one[array], other[array]):
            identical += 1
            continue
        apart = difference(array, one[array], other[array])
        if worst is None or apart.relative > worst.relative:
            worst = apart
        # what has to have the same bits has to be of the same type; nothing is near infinity
        ok = not apart.kind if near == Near() else np.isfinite(apart.apart)
        if near == Near() or not ok or not apart.apart <= near.absolute + near.relative * apart.size:
            agrees = False
            lines.append(f"differs: {array} by {apart.apart:.2g} in {apart.size:.2g} {apart.kind}".rstrip())
    new = [array for array in other if array not in one]
    if new:
        lines.append(f"only at the head: {len(new)} arrays, such as {new[0]}")
    return Row(agrees, identical, compared, worst, lines)


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a file."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def compare(tag: Path, head: Path, names: list[str], *, all_lines: bool) -> int:
    """Print the table and return how many cases do not agree."""
    wrong = 0
    print(f"{'case':58s} {'agreement':>12s} {'same bits':>13s} {'largest relative difference':>28s}")
    reasons: dict[str, list[str]] = {}
    for name in names:
        missing = [
            side for side, folder in zip(SIDES[::-1], (tag, head), strict=True) if not file_of(folder, name).exists()
        ]
        if missing:
            wrong += 1
            print(f"{name:58s} NO RESULTS of the {' and the '.join(missing)}")
            continue
        row = compare_case(name, read(file_of(tag, name)), read(file_of(head, name)))
        agreement = agreement_of(name)
        if agreement is not None:
            reasons.setdefault(agreement.reason, []).append(name)
        wrong += not row.agrees
        asked = "bits" if agreement is None else "named below"
        worst = "" if row.worst is None else f"{row.worst.relative:.1e} {row.worst.name[-40:]}"
        print(
            f"{name:58s} {asked:>12s} {row.identical:6d}/{row.compared:<6d} {worst:>28s}"
            f"{'' if row.agrees else '  DOES NOT AGREE'}"
        )
        for line in row.lines if all_lines else row.lines[:12]:
            print(f"    {line}")
        if len(row.lines) > 12 and not all_lines:
            print(f"    and {len(row.lines) - 12} more (--all)")
    for reason, listed in reasons.items():
        print(f"\nnot bit for bit: {reason}\n    {', '.join(listed)}")
    gone = {reason for listed in GONE.values() for reason in listed.values()}
    for reason in sorted(gone):
        print(f"\ngone on purpose: {reason}")
    print(f"\n{len(names) - wrong} of {len(names)} cases agree")
    return wrong


def both(tag: Path, folder: Path, patterns: list[str], *, anew: bool, all_lines: bool) -> int:
    """Make the results of both versions, each in a process of its own, and compare them."""
    failed = 0
    for side, checkout in (("tag", tag), ("head", _HEAD)):
        path = os.pathsep.join(map(os.fspath, (checkout, checkout / "envs")))
        environment = {**os.environ, "PYTHONPATH": path}
        if side == "tag" and "NUMBA_CACHE_DIR" in environment:
            environment["NUMBA_CACHE_DIR"] += "-tag"
        words = [sys.executable, os.fspath(_HERE), "run", "--names", side, "--out", os.fspath(folder / side)]
        done = subprocess.run([*words, *(["--anew"] * anew), "--cases", *patterns], env=environment, check=False)
        failed += done.returncode != 0
    return failed + compare(folder / "tag", folder / "head", chosen(patterns), all_lines=all_lines)


def main(words: list[str] | None = None) -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verb: Any = verbs.add_parser("run", help="make the results of the importable packmech")
    verb.add_argument("--out", type=Path, required=True)
    verb.add_argument("--names", choices=SIDES, default="head")
    verb.add_argument("--anew", action="store_true")
    other: Any = verbs.add_parser("compare", help="compare two folders of results")
    other.add_argument("tag_results", type=Path)
    other.add_argument("head_results", type=Path)
    other.add_argument("--all", action="store_true", help="print everything that differs")
    two: Any = verbs.add_parser("both", help="run two versions and compare them")
    two.add_argument("--tag", type=Path, required=True, help="a checkout of the other version")
    two.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "packmech-versions")
    two.add_argument("--anew", action="store_true")
    two.add_argument("--all", action="store_true", help="print everything that differs")
    listed: Any = verbs.add_parser("list", help="print the names of the cases")
    for one in (verb, other, two, listed):
        one.add_argument("--cases", nargs="+", default=["*"], metavar="PATTERN")
    given = parser.parse_args(words)
    names = chosen(given.cases)
    if given.verb == "list":
        print("\n".join(names))
        return 0
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        # for the processes that are started
        os.environ.setdefault(name, "1")
    if given.verb == "run":
        return int(run(given.out, names, given.names, anew=given.anew) > 0)
    if given.verb == "compare":
        return int(compare(given.tag_results, given.head_results, names, all_lines=given.all) > 0)
    return int(both(given.tag.resolve(), given.out, given.cases, anew=given.anew, all_lines=given.all) > 0)


if __name__ == "__main__":
    sys.exit(main())
