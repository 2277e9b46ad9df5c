"""CPU time per step of the preset beside the reference package's own, all nine tensors measured at every step.

Run: OMP_NUM_THREADS=1 python tests/benchmarks/bench_particle_shear.py
The last column is for the reference machine of the calibration loop.
"""

import time

import numpy as np
from calibration import REFERENCE_NS, calibrate

from packmech.validation import particle_shear as ps

# the package on one core, stress recorded at every step: (discs, fragments' centers) -> seconds per step
PACKAGE = {(45, None): 0.0101, (150, None): 0.0585, (150, 5): 0.0608, (400, None): 0.302}


def seconds_per_step(count, centers, steps=2240):
    """Return the least CPU time of five runs through most of a period of shear, and the contacts there."""
    experiment = ps.ParticleShear(particles=count, pre_periods=0.0)
    start = ps.prepared_discs(experiment, seed=1, centers=centers)
    time_t = np.arange(steps) * experiment.time_step
    rate_t = experiment.strain_rate(time_t)
    spent, contacts = [], 0
    for _ in range(5):
        before = time.process_time()
        run = ps.advance(start, experiment.material, experiment.rules, rate_t)
        spent.append((time.process_time() - before) / steps)
        contacts = int(np.median(run.contacts_t))
    return min(spent), contacts


def main():
    slower = calibrate() / REFERENCE_NS
    print(
        f"{'discs':>6} {'bonds':>6} {'contacts':>9} {'us/step':>9} {'ns/contact':>11} {'times faster':>13} {'there':>7}"
    )
    for (count, centers), package in PACKAGE.items():
        seconds, contacts = seconds_per_step(count, centers)
        print(
            f"{count:6d} {'yes' if centers else 'no':>6} {contacts:9d} {seconds * 1e6:9.2f} "
            f"{seconds / contacts * 1e9:11.1f} {package / seconds:13.0f} {package / seconds * slower:7.0f}"
        )


if __name__ == "__main__":
    main()
