"""How well d ln(phi_J)/d(strain) = -Sigma/P holds along the families of sheared discs, and of ellipses of aspect 1.5.

python recordings/families/slopes.py
"""

from pathlib import Path

import numpy as np
from cyclopts import run

import packmech as pm

# number of particles, aspect, strain over which families are walked
KINDS = ((10, 1.0, 0.1), (32, 1.0, 0.02), (128, 1.0, 0.002), (10, 1.5, 0.02), (32, 1.5, 0.01))
STEP = 1e-5


def compare(particles: int, aspect: float, strain: float, seed: int) -> dict[str, float]:
    """Return the largest difference of both sides in the middle of the four longest families of a packing."""
    shapes = {"packing_fraction": 0.8} if aspect == 1.0 else {"packing_fraction": 0.6, "shapes": pm.Ellipses(aspect)}
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), seed=seed, **shapes)
    pressure, size = (1e-8, strain / 20.0) if aspect == 1.0 else (1e-6, strain / 5.0)
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="isotropic").packing
    walked = pm.shear_families(packing, strain, step=size, check=False)
    pieces = np.split(walked.strain_t, np.flatnonzero(np.diff(walked.family_t)) + 1)
    longest = sorted(pieces, key=lambda piece: piece[0] - piece[-1])[:4]
    middles = sorted(float(0.5 * (one[0] + one[-1])) for one in longest if one[-1] - one[0] > 8.0 * STEP)
    errors, slopes = [], []
    kept = pm.shear_families(packing, strain, step=size, keep=middles, check=False).packings if middles else ()
    for there in kept:
        both = [pm.shear_families(there, sign * 2.0 * STEP, step=STEP) for sign in (1.0, -1.0)]
        if not any(one.changes for one in both):
            (_, near, far), (_, less, least) = (np.log(one.packing_fraction_t) for one in both)
            slopes.append(float(8.0 * (near - less) - (far - least)) / (12.0 * STEP))
            errors.append(abs(slopes[-1] + float(both[0].stress_ratio_t[0])))
    counts = {"families": walked.families, "changes": len(walked.changes), "jumps": len(walked.jumps())}
    largest = {"largest_error": max(errors, default=np.nan), "largest_slope": max(map(abs, slopes), default=np.nan)}
    return counts | largest | {"compared": len(errors), "imbalance": walked.residual}


def main(*, packings: int = 10, kinds: int = 5, out: Path = Path(__file__).parent, workers: int | None = None) -> None:
    """Compare the slopes of each kind, write the table and print the largest differences."""
    names = ("particles", "aspect", "strain")
    grid = [dict(zip(names, kind, strict=True)) | {"seed": range(packings)} for kind in KINDS[:kinds]]
    found = pm.run_ensemble(compare, grid, out / "members" / "slopes", workers=workers).of(grid)
    pm.write_table(found, out / "slopes.csv")
    for particles, aspect, _ in KINDS[:kinds]:
        part = found.where(particles=particles, aspect=aspect)
        print(particles, aspect, f"{part['compared'].sum()} families, off by {np.nanmax(part['largest_error']):.1e}")


if __name__ == "__main__":
    run(main)
