# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Write recordings/dynamics/effect_costs.md: effects present against arrays, bytes, and ns a step.

Run with one thread: OMP_NUM_THREADS=1 python tests/benchmarks/effect_costs.py [number of particles]
"""

from __future__ import annotations

import pathlib
import sys
import time

import numpy as np
from bench_march import DASHPOT, FRICTION, SPRING, make_start, ours, some_bonds
from calibration import calibrate

import packmech as pm
from packmech.dynamics.march.look import CONTACTS
from packmech.dynamics.march.tally import new_ledger

TARGET = pathlib.Path(__file__).parents[2] / "recordings" / "dynamics" / "effect_costs.md"
STEPS = 1000


def arrays(record):
    """Return the arrays that hold something in nested records."""
    if isinstance(record, np.ndarray):
        return [record] if record.size else []
    return [one for part in record for one in arrays(part)] if isinstance(record, tuple) else []


def figures(start, effects, every):
    """Return number and bytes of the arrays, contacts and bonds, and the least CPU seconds of a step."""
    best = np.inf
    for _ in range(4):
        march = ours(start, effects)
        ledger = None if every is None else new_ledger(every, STEPS // every + 4)
        march.advance(4, ledger)
        began = time.process_time()
        march.advance(STEPS, ledger)
        best = min(best, (time.process_time() - began) / STEPS)
    held = arrays((march.state, march.space, march.pairs, march.track, ledger))
    bonds = next((len(one) for one in effects if isinstance(one, pm.Bonds)), 0)
    return len(held), sum(one.nbytes for one in held), int(march.see()[CONTACTS]) + bonds, best


def main(particles=1_000):
    """Measure and write the table."""
    machine = calibrate()
    start = make_start(particles)
    bonds, drag = some_bonds(start), pm.BackgroundDamping(0.01)
    rows = [
        ("spring", (SPRING,), None),
        ("spring, dashpot", (SPRING, DASHPOT), None),
        ("spring, dashpot, friction", (SPRING, DASHPOT, FRICTION), None),
        ("spring, dashpot, friction, bonds", (SPRING, DASHPOT, FRICTION, bonds), None),
        ("spring, dashpot, friction; stress and figures every step", (SPRING, DASHPOT, FRICTION), 1),
        ("the same; every 10 steps", (SPRING, DASHPOT, FRICTION), 10),
        ("spring, dashpot, friction, background damping", (SPRING, DASHPOT, FRICTION, drag), None),
    ]
    lines = [
        "# What each effect of a march costs",
        "",
        f"{particles} discs, packing fraction 0.95, steady shear, one thread, lists remade on the way; CPU time. The",
        f"calibration loop (8 ns a contact on the reference machine) took {machine:.1f} ns in the same run. Made by",
        "`python tests/benchmarks/effect_costs.py`.",
        "",
        "| effects | arrays | bytes | bytes a particle | us a step | contacts and bonds | ns a contact and step |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, effects, every in rows:
        count, size, contacts, seconds = figures(start, effects, every)
        each = seconds / contacts * 1e9
        lines.append(
            f"| {name} | {count} | {size} | {size / particles:.0f} | {seconds * 1e6:.1f} | {contacts} | {each:.1f} |"
        )
        print(lines[-1], flush=True)
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    TARGET.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*(int(float(word)) for word in sys.argv[1:]))
