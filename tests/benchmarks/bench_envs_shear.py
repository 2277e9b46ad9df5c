# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What Shear-v0 costs: a step of the environment against its program's, batches against processes, threads, friction.

Tables: (1) CPU time of `env.step` at N = 64 against what it must do, the same steps and figures in the program's own
loop, and against calling that program from Python; (2) wall time of 256 packings of N = 32 in one batch, on 1 and 2
threads, against Gymnasium's AsyncVectorEnv over processes; (3) a frictionless environment against the bare program, and
against one with friction.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_envs_shear.py
[--processes P], P the largest number of AsyncVectorEnv's processes (256 unless given).
"""

from __future__ import annotations

import argparse
import time

import gymnasium as gym
import numpy as np
from packmech_envs.batched import ShearVectorEnv
from packmech_envs.single import ShearEnv

import packmech as pm
from packmech.dynamics.deformation import Driven
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import new_ledger

RUBBING = (pm.Friction(coefficient=0.5, stiffness=0.5, damping=0.1), pm.ContactDamping(coefficient=0.1))
RATE = 1e-3
GOALS = {"overhead": 15.0, "processes": 5.0, "threads": 1.6}


def scene_of(particles, effects=(), seed=1):
    """Return a quenched scene of so many discs."""
    packing = pm.random_packing(particles, dimension=2, packing_fraction=0.9, seed=seed)
    plain = pm.Scene(packing, (pm.Repulsion(),))
    packing = pm.quench(plain, force_tolerance=1e-8, check=False).packing
    return pm.Scene(packing, (pm.Repulsion(), *effects))


def best(call, count, clock=time.process_time, repeats=7):
    """Return the shortest time of so many calls, in microseconds a call."""

    def once():
        start = clock()
        for _ in range(count):
            call()
        return clock() - start

    return min(once() for _ in range(repeats)) / count * 1e6


def program(scene, dt):
    """Return the bare engine under a steady shear, running."""
    path = np.array([0.0, 1e9, 0.0, RATE * 1e9, RATE, RATE])
    engine = build_engine(
        scene,
        dt=dt,
        velocity_nd=np.zeros((scene.packing.particles, 2)),
        profile=Driven(path),
        direction_dd=np.array([[0.0, 1.0], [0.0, 0.0]]),
    )
    engine.advance(100)
    return engine


def in_the_loop(scene, dt, every):
    """Return the CPU time of so many steps and one look, all in compiled loops, in microseconds."""
    engine, frames = program(scene, dt), 20_000 // every

    def run():
        engine.advance(frames * every, new_ledger(every, frames + 1))

    return best(run, 1) / frames


def single(effects, name):
    """Print a row for each frame_skip."""
    scene = scene_of(64, effects)
    for skip in (1, 20):
        env = ShearEnv(scene, frame_skip=skip, budget=None, largest_rate=1.0)
        env.reset(seed=0)
        action = np.array([RATE])
        batch = pm.ShearBatch([scene], control="rate", steps=skip, dt=env.dt)
        told = action[None]
        loop = in_the_loop(scene, env.dt, skip)
        called = best(lambda batch=batch, told=told: batch.advance(told), 2000)
        whole = best(lambda env=env, action=action: env.step(action), 2000)
        engine = program(scene, env.dt)
        bare = best(lambda engine=engine, skip=skip: (engine.advance(skip), engine.observe()), 1000)
        print(
            f"{name:<14}{skip:>5}{loop:>12.1f}{called:>14.1f}{bare:>14.1f}{whole:>12.1f}"
            f"{whole - loop:>14.1f}{whole - called:>14.1f}"
        )


def frames_in_a_second(envs, count):
    """Return how many frames of one packing are taken in a second of wall time."""
    actions = np.full(envs.action_space.shape, RATE)
    envs.reset(seed=0)
    for _ in range(5):
        envs.step(actions)
    best_time = np.inf
    for _ in range(3):
        start = time.perf_counter()
        for _ in range(count):
            envs.step(actions)
        best_time = min(best_time, time.perf_counter() - start)
    envs.close()
    return envs.num_envs * count / best_time


def batches(processes):
    """Print frames in a second of 256 packings of N = 32."""
    scene = scene_of(32)
    for skip in (1, 20):
        how = {"scene": scene, "frame_skip": skip, "budget": None, "largest_rate": 1.0, "relax": False}
        speed = {}
        for threads in (1, 2):
            envs = ShearVectorEnv(256, **how, threads=threads)
            speed[f"{threads} thread{'s' * (threads > 1)}"] = frames_in_a_second(envs, 200 if skip == 1 else 50)
        for count in sorted({2, processes}):
            envs = gym.vector.AsyncVectorEnv([lambda how=how: ShearEnv(**how)] * count)
            speed[f"{count} processes"] = frames_in_a_second(envs, 30)
        for name, value in speed.items():
            print(f"{skip:>5}  {name:<16}{value:>14.0f}")
        fastest = max(value for name, value in speed.items() if "processes" in name)
        print(f"{skip:>5}  2 threads / 1: {speed['2 threads'] / speed['1 thread']:.2f} (goal {GOALS['threads']})")
        print(f"{skip:>5}  2 threads / AsyncVectorEnv: {speed['2 threads'] / fastest:.1f} (goal {GOALS['processes']})")


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--processes", type=int, default=256)
    arguments = parser.parse_args()
    print("One environment, N = 64, CPU microseconds a frame (goal: at most 15 more than the program and its figures)")
    print(
        f"{'effects':<14}{'skip':>5}{'in the loop':>12}{'ShearBatch':>14}{'March + see':>14}{'env.step':>12}"
        f"{'over loop':>14}{'over batch':>14}"
    )
    single((), "frictionless")
    single(RUBBING, "friction")
    print("256 packings, N = 32, frames of one packing in a second of wall time")
    batches(arguments.processes)


if __name__ == "__main__":
    main()
