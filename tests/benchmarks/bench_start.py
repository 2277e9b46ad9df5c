"""What a new process costs until its first forces: imports, the default scene, kernels from the disk cache.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_start.py
Wall and CPU seconds, medians of new processes after one that may compile; `python -c pass` is the floor below them all.
"one line of numba" imports numpy and numba and calls a function of one line from numba's own cache: what compiled code
costs in a new process whoever wrote it.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from calibration import calibrate

STEPS = {
    "nothing": "pass",
    "import packmech": "import packmech",
    "import numpy, numba": "import numpy, numba",
    "read the default scene": "import packmech as pm; pm.read_scene('default')",
    "first forces": "import packmech as pm; pm.forces(pm.read_scene('default'))",
    "packmech scenes": "import sys; sys.argv = ['packmech', 'scenes']; from packmech.cli import main; main()",
}

ONE_LINE = """
import numpy, numba


@numba.njit(cache=True)
def more(number):
    return number + 1.0


more(1.0)
"""


def seconds(code: str) -> tuple[float, float]:
    """Return wall and CPU seconds of a new process that runs the code."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, check=False)
    took, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return took, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the table."""
    calibrate()
    print(f"{'new process':<28}{'wall s':>8}{'CPU s':>8}")
    with tempfile.TemporaryDirectory() as folder:
        one_line = Path(folder) / "one_line.py"
        one_line.write_text(ONE_LINE)
        for name, code in {**STEPS, "one line of numba": f"import runpy; runpy.run_path({str(one_line)!r})"}.items():
            seconds(code)
            taken = [seconds(code) for _ in range(7)]
            wall, cpu = (statistics.median(column) for column in zip(*taken, strict=True))
            print(f"{name:<28}{wall:8.3f}{cpu:8.3f}")


if __name__ == "__main__":
    main()
