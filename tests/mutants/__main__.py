"""Small faults, put one by one into a copy of the checkout, and whether a test fails because of each.

    python tests/mutants [--file PATTERN ...] [--guards] [--table tests/mutants/results.md]
    python tests/mutants --generate packmech/mechanics/stability.py --seed 0 --count 20 [--keep]

A fault of the catalogue is a text that stands once in a file and what stands in its place; generated ones are made from
the syntax tree, and those that were kept (`drawn.json`) belong to the catalogue as long as their texts stand. The tests
that should notice are run in the copy: a fault is killed where one of them fails or the limit of CPU time is reached,
and survives where all pass. Those that are named as equivalent change no answer, and are not run. The outcomes go to a
table, in which one run's stand beside those of others.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from mutants.catalogue import CATALOGUE, TESTS, Fault, keep_drawn, part_of, read_drawn, stands  # noqa: E402
from mutants.generate import generated  # noqa: E402
from mutants.warm import Warm  # noqa: E402

KILLED, TOO_LONG, SURVIVED, EQUIVALENT, NOT_TRIED = "killed", "killed: too long", "survived", "equivalent", "not tried"
HEAD = ("file", "fault", "guard", "outcome", "seconds", "killed by, or why equivalent")
# how many times the limit of CPU time a run may take on a machine that is shared
_PATIENCE = 20
# signals by which limits of time end a process
_LIMITS = (signal.SIGXCPU, signal.SIGKILL)


def copied(folder: Path) -> Path:
    """Return a copy of what tests need of the checkout."""
    here = folder / "checkout"
    here.mkdir()
    left_out = shutil.ignore_patterns("__pycache__", ".*")
    for name in ("packmech", "envs", "tests"):
        shutil.copytree(ROOT / name, here / name, ignore=left_out)
    for name in ("pyproject.toml", "README.md"):
        shutil.copy2(ROOT / name, here / name)
    (here / "recordings").symlink_to(ROOT / "recordings")
    return here


def write(here: Path, file: str, text: str) -> None:
    """Write a file of the copy, and forget what was compiled of the last."""
    path = here / file
    path.write_text(text, encoding="utf-8")
    for old in path.parent.glob(f"__pycache__/{path.stem}.*"):
        old.unlink()


def run_tests(here: Path, tests: tuple[str, ...], seconds: int) -> tuple[str, str]:
    """Return the outcome of tests in the copy, and which failed first."""
    paths = os.pathsep.join([str(here), str(here / "envs")])
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=no", *tests]
    process = subprocess.Popen(
        command, cwd=here, env=os.environ | {"PYTHONPATH": paths}, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5)),
    )  # fmt: skip
    try:
        said = process.communicate(timeout=_PATIENCE * seconds)[0]
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        process.communicate()
        return TOO_LONG, ""
    if process.returncode < 0:
        return TOO_LONG if -process.returncode in _LIMITS else KILLED, ""
    if process.returncode == 0:
        return SURVIVED, ""
    failed = re.search(r"^(?:FAILED|ERROR) ([^\s]+)", said, re.MULTILINE)
    if process.returncode in (1, 2) and failed:
        return KILLED, failed.group(1)
    if process.returncode in (2, 4) and re.search("while loading conftest|errors? during collection", said):
        return KILLED, "no module that imports it"
    raise SystemExit(f"tests could not be run, pytest ended with {process.returncode}:\n{said[-2000:]}")


def outcome(here: Path, fault: Fault, seconds: int, warm: Warm | None = None) -> tuple[str, str, float]:
    """Return what becomes of one fault, which test killed it, and how long that took [s]."""
    text = (here / fault.file).read_text(encoding="utf-8")
    began = time.perf_counter()
    if warm is not None:
        ended = warm.outcome(fault, text, fault.tests or TESTS[fault.file], seconds)
        # tests that could not be run at all are looked at in a process of their own
        if ended is not None and ended[0] <= 2:
            code, by = ended
            found = SURVIVED if code == 0 else TOO_LONG if -code in _LIMITS else KILLED
            return found, by, time.perf_counter() - began
    write(here, fault.file, fault.put_into(text))
    try:
        found, by = run_tests(here, fault.tests or TESTS[fault.file], seconds)
    finally:
        write(here, fault.file, text)
    return found, by, time.perf_counter() - began


def read_table(path: Path) -> dict[tuple[str, str], tuple[str, ...]]:
    """Return the rows of a table of outcomes by file and fault; none where there is no table yet."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    rows = [tuple(one.strip().replace("\\|", "|") for one in re.split(r"(?<!\\)\|", line)[1:-1]) for line in lines]
    return {row[:2]: row for row in rows if len(row) == len(HEAD) and row != HEAD and set(row[0]) != {"-"}}


def write_table(path: Path, rows: dict[tuple[str, str], tuple[str, ...]]) -> None:
    """Write the rows with their counts before them."""
    lines = ["# Small faults and the tests that notice them", "", "Written by `python tests/mutants`.", ""]
    lines += [
        *counts(rows),
        "",
        *(_line(one) for one in (HEAD, ("---",) * len(HEAD), *(rows[k] for k in sorted(rows)))),
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _line(row: tuple[str, ...]) -> str:
    return f"| {' | '.join(one.replace('|', chr(92) + '|') for one in row)} |"


def counts(rows: dict[tuple[str, str], tuple[str, ...]]) -> list[str]:
    """Return the counts in words, of all faults, of those that take a guard of a verdict away, and of each part."""
    found, every = [], list(rows.values())
    parts = {part_of(row[0]): [one for one in every if part_of(one[0]) == part_of(row[0])] for row in every}
    for name, kept in (
        ("all", every),
        ("guards of verdicts", [row for row in every if row[2]]),
        *sorted(parts.items()),
    ):
        count = Counter(row[3] for row in kept)
        killed, survived = count[KILLED] + count[TOO_LONG], count[SURVIVED]
        tried = killed + survived
        share = f"{100.0 * killed / tried:.1f} % killed" if tried else "none tried"
        found.append(
            f"- {name}: {len(kept)} faults, tried {tried}, killed {killed} ({count[TOO_LONG]} by the limit of time), "
            f"survived {survived}, equivalent {count[EQUIVALENT]}, not tried {count[NOT_TRIED]}: {share}"
        )
    return found


def row_of(fault: Fault, found: str, seconds: float | None = None, by: str = "") -> tuple[str, ...]:
    """Return the row of a fault in the table."""
    took = "" if seconds is None else f"{seconds:.0f}"
    return (fault.file, fault.what, "guard" if fault.guard else "", found, took, by)


def main() -> int:
    """Try the faults that the command asks for, print what becomes of them, and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--file", nargs="*", default=["*"], help="patterns of the files whose faults are tried")
    parser.add_argument("--fault", nargs="*", default=["*"], help="patterns of the faults' sentences")
    parser.add_argument("--guards", action="store_true", help="only faults that take a guard of a verdict away")
    parser.add_argument("--left", action="store_true", help="only faults that have no outcome in the table yet")
    parser.add_argument("--again", action="store_true", help="only faults that survived")
    parser.add_argument("--list", action="store_true", help="print the faults and try none")
    parser.add_argument("--check", action="store_true", help="run the tests without any fault first: they must pass")
    parser.add_argument("--warm", action="store_true", help="in forks of one process that has run the tests")
    parser.add_argument("--generate", nargs="*", default=[], metavar="FILE", help="make faults from these files")
    parser.add_argument("--keep", action="store_true", help="keep what is generated with the catalogue")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=20, help="of generated faults for each file")
    parser.add_argument("--tests", nargs="*", default=[], help="to run, instead of those that the catalogue names")
    parser.add_argument("--seconds", type=int, default=300, help="limit of CPU time for the tests of one fault")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="no fault is begun after these")
    parser.add_argument("--table", type=Path, default=ROOT / "tests" / "mutants" / "results.md")
    asked = parser.parse_args()
    rows, began = read_table(asked.table), time.perf_counter()
    faults = [*CATALOGUE, *(one for one in read_drawn() if stands(one, ROOT))]
    if asked.generate:
        faults = [one for file in asked.generate for one in generated(ROOT, file, asked.seed, asked.count)]
    if asked.generate and asked.keep:
        keep_drawn(faults)
    faults = [
        one._replace(tests=tuple(asked.tests) or one.tests)
        for one in faults
        if any(fnmatch.fnmatch(one.file, f"*{pattern}") for pattern in asked.file)
        and any(fnmatch.fnmatch(one.what, f"*{pattern}*") for pattern in asked.fault)
        and (one.guard or not asked.guards)
        and (not asked.left or rows.get(one.key, ("",) * 4)[3] in ("", NOT_TRIED))
        and (not asked.again or rows.get(one.key, ("",) * 4)[3] == SURVIVED)
    ]
    if asked.list:
        print("\n".join(f"{one.file}: {one.what}" for one in faults))
        return 0
    for one in faults:
        rows.setdefault(one.key, row_of(one, NOT_TRIED))
    survived = 0
    with tempfile.TemporaryDirectory() as folder:
        here = copied(Path(folder))
        warm = None
        if asked.warm:
            warm = Warm(here, tuple(dict.fromkeys(name for one in faults for name in one.tests or TESTS[one.file])))
        elif asked.check:
            names = dict.fromkeys(name for one in faults for name in one.tests or TESTS[one.file])
            found, by = run_tests(here, tuple(names), 10 * asked.seconds)
            if found != SURVIVED:
                raise SystemExit(f"tests must pass without a fault, got {found}: {by}")
        for one in faults:
            if one.equivalent:
                rows[one.key] = row_of(one, EQUIVALENT, by=one.equivalent)
                continue
            if time.perf_counter() - began > 60.0 * asked.minutes:
                continue
            found, by, seconds = outcome(here, one, asked.seconds, warm)
            survived += found == SURVIVED
            rows[one.key] = row_of(one, found, seconds, by)
            print(f"{found:16} {seconds:5.0f} s  {one.file}: {one.what}  {by}", flush=True)
            write_table(asked.table, rows)
    write_table(asked.table, rows)
    print("\n".join(counts(rows)))
    return bool(survived)


if __name__ == "__main__":
    sys.exit(main())
