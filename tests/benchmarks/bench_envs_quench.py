"""Quench-v0: what a step of the environment costs beyond its engine, and batches against processes and threads.

256 packings of 32 discs, random actions, every step so many steps of the minimizer, or a full relaxation. Wall time is
what counts where processes or threads share the machine: run it on a quiet one.

Run: OMP_NUM_THREADS=1 python tests/benchmarks/bench_envs_quench.py [environments] [processes]
"""

from __future__ import annotations

import sys
import time

import gymnasium as gym
import numpy as np
from packmech_envs.batched import QuenchVectorEnv
from packmech_envs.single import QuenchEnv

import packmech as pm

SECONDS = 3.0


def clocked(act, least=3):
    """Return wall and CPU seconds of a call, the least of several stretches."""
    act()
    best = np.full(2, np.inf)
    stretches = 3
    for _ in range(stretches):
        began, cpu, calls = time.perf_counter(), time.process_time(), 0
        while calls < least or time.perf_counter() - began < SECONDS / stretches:
            act()
            calls += 1
        best = np.minimum(best, [(time.perf_counter() - began) / calls, (time.process_time() - cpu) / calls])
    return best


def stepper(envs, count):
    """Return a call that steps a batch, its random actions drawn beforehand."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (64, count, 2))
    envs.reset(seed=0)
    turn = iter(range(1 << 60))
    return lambda: envs.step(actions[next(turn) % 64])


def overhead(relax):
    """Print what a step of a single environment costs beyond the engine's."""
    arguments = {"relax": relax, "step_budget": None, "evaluation_budget": None, "largest_pressure": 1e-9}
    env = QuenchEnv(**arguments)
    env.reset(seed=0)
    action = np.zeros(2)
    batch = pm.QuenchBatch(env.scene, relax=relax)
    batch.restart(0, env.packing, relax=relax == "full")
    none = np.zeros(1)
    whole, engine = clocked(lambda: env.step(action), 50)[1], clocked(lambda: batch.step(none, none), 50)[1]
    print(f"| {relax} | {whole * 1e6:.0f} | {engine * 1e6:.0f} | {(whole - engine) * 1e6:.0f} |")


def batches(relax, count, processes):
    """Print a batch on one and on two threads against processes."""
    # small changes about a compressed packing, so that there is something to relax in every step
    arguments = {
        "relax": relax,
        "start_packing_fraction": 0.88,
        "largest_change": 2e-3,
        "largest_strain": 1e-2,
        "step_budget": 100,
        "evaluation_budget": None,
    }
    found = {}
    for threads in (1, 2):
        envs = QuenchVectorEnv(count, **arguments, threads=threads, autoreset_mode="SameStep")
        found[threads] = clocked(stepper(envs, count))
        envs.close()
    many = gym.vector.AsyncVectorEnv([lambda: QuenchEnv(**arguments)] * processes)
    asked = clocked(stepper(many, processes))[0] / processes
    many.close()
    one, two = found[1][0] / count, found[2][0] / count
    print(
        f"| {relax} | {one * 1e6:.0f} | {two * 1e6:.0f} | {one / two:.2f} | {asked * 1e6:.0f} "
        f"| {asked / min(one, two):.1f} | {found[1][1] / count * 1e6:.0f} |"
    )


def main() -> None:
    """Print both tables."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    processes = int(sys.argv[2]) if len(sys.argv) > 2 else count
    print("A single environment of 32 discs, us of CPU time a step\n")
    print("| relax | step | engine | beyond |\n|---|---|---|---|")
    for relax in (1, 10):
        overhead(relax)
    print(f"\n{count} packings of 32 discs against AsyncVectorEnv of {processes} processes, us a packing and step\n")
    print("| relax | 1 thread | 2 threads | ratio | processes | processes / batch | 1 thread, CPU |")
    print("|---|---|---|---|---|---|---|")
    for relax in (1, 10, "full"):
        batches(relax, count, processes)


if __name__ == "__main__":
    main()
