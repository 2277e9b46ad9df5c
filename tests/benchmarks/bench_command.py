"""Seconds from the start of a new process of `packmech jam` to its first force evaluation, kernels from the disk cache.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_command.py
Wall and CPU seconds of several processes after one that may compile. The mark is set when the first portion of the
quench (the first force evaluation and twenty steps) returns.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time

from calibration import calibrate

PROCESSES = 7

MARKED = """
import sys, time
import packmech.minimize.program as program
advance = program.Program.advance
def marked(*given, **named):
    advance(*given, **named)
    print(time.time(), time.process_time())
    raise SystemExit
program.Program.advance = marked
sys.argv = ["packmech", "jam"]
from packmech.cli import main
main()
"""


def until_first_forces(folder: str) -> tuple[float, float]:
    """Return wall and CPU seconds from the start of the process."""
    began = time.time()
    done = subprocess.run([sys.executable, "-c", MARKED], cwd=folder, capture_output=True, text=True, check=True)
    wall, cpu = (float(word) for word in done.stdout.split())
    return wall - began, cpu


def main() -> None:
    """Print the figures."""
    calibrate()
    with tempfile.TemporaryDirectory() as folder:
        print("first process: wall {:.2f} s, CPU {:.2f} s".format(*until_first_forces(folder)))
        taken = [until_first_forces(folder) for _ in range(PROCESSES)]
    wall, cpu = (sorted(column) for column in zip(*taken, strict=True))
    print(f"{PROCESSES} more: wall median {statistics.median(wall):.2f} s, best {wall[0]:.2f} s; ", end="")
    print(f"CPU median {statistics.median(cpu):.2f} s, best {cpu[0]:.2f} s (to be within 1.0 s)")


if __name__ == "__main__":
    main()
