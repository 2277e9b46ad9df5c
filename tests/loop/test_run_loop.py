"""Facts about the run loop: limits are kept inside long calls, and no interrupt finds anything half done."""

import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import packmech as pm
from packmech.loop import run_loop
from packmech.loop.run_loop import RunLoop, run_settings


class Counting:
    """A task of so many steps that take a while each, and are never half done."""

    def __init__(self, steps, stop_every, seconds=0.0, each=lambda step: None):
        self.end, self.stop_every, self.seconds, self.each = steps, stop_every, seconds, each
        self.steps, self.half, self.portions, self.stops = 0, 0, [], []

    def next_stop(self):
        if self.steps >= self.end:
            return pm.Outcome.FINISHED
        return min(self.end, (self.steps // self.stop_every + 1) * self.stop_every)

    def advance(self, steps):
        self.portions.append(steps)
        for _ in range(steps):
            self.half += 1
            until = time.process_time() + self.seconds
            while time.process_time() < until:
                pass
            self.steps += 1
            self.half -= 1
            self.each(self.steps)

    def observe(self):
        self.stops.append(self.steps)

    def figures(self):
        return "counting", {"steps": self.steps}


def test_stops_are_those_of_the_task_however_it_is_cut(monkeypatch):
    whole = Counting(1000, 70)
    RunLoop(run_settings()).advance(whole)
    monkeypatch.setattr(run_loop, "_SLICE", 0.002)
    cut = Counting(1000, 70, seconds=1e-4)
    assert RunLoop(run_settings(time_limit=100.0)).advance(cut) is pm.Outcome.FINISHED
    assert cut.stops == whole.stops
    assert len(cut.portions) > 1.5 * len(whole.portions)


@pytest.mark.parametrize("seconds", [1e-5, 1e-3, 0.05])
def test_a_time_limit_is_kept_inside_one_long_stretch(seconds):
    task = Counting(10**9, 10**9, seconds=seconds)
    began = time.process_time()
    assert RunLoop(run_settings(time_limit=0.5)).advance(task) is pm.Outcome.TIME_LIMIT
    assert 0.5 <= time.process_time() - began < 0.8
    assert task.steps > 0


def test_a_time_limit_of_a_quench_is_kept_where_a_step_takes_long():
    packing = pm.random_packing(400, dimension=3, packing_fraction=0.7, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    given = {"force_tolerance": 1e-15, "method": pm.GradientDescent(step=1e-6), "check": False}
    pm.quench(scene, step_limit=3, **given)
    run = pm.quench(scene, time_limit=0.5, step_limit=10**9, **given)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert 0.4 <= run.seconds < 0.9


METHODS = [
    None, pm.Fire(), pm.Fire2(), pm.ConjugateGradient(), pm.LBFGS(), pm.DampedDynamics(), pm.GradientDescent(),
    pm.SteepestDescent(),
]  # fmt: skip


@pytest.mark.parametrize("method", METHODS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("linked", [False, True])
def test_cutting_a_minimization_changes_no_bit(method, linked, monkeypatch):
    if linked:
        packing = pm.cluster_packing(20, shape=pm.Dimer(), dimension=2, packing_fraction=0.9, seed=3)
    else:
        packing = pm.random_packing(40, dimension=2, packing_fraction=0.9, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    given = {"force_tolerance": 1e-4, "method": method, "step_limit": 3000, "check": False}
    whole = pm.quench(scene, **given)
    monkeypatch.setattr(run_loop, "_FIRST", 3)
    monkeypatch.setattr(run_loop, "_SLICE", 1e-5)
    cut = pm.quench(scene, time_limit=1e6, **given)
    assert cut.packing == whole.packing
    assert cut.steps == whole.steps
    assert cut.force_evaluations == whole.force_evaluations


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupts_at_random_moments_find_nothing_half_done(number):
    rng = np.random.default_rng(3)
    for _ in range(20):
        saved, finished = [], []
        task = Counting(10**9, 50, seconds=2e-5)
        timer = threading.Timer(float(rng.uniform(0.0, 0.05)), signal.raise_signal, (number,))

        def run(outcome, task=task, finished=finished):
            assert task.half == 0
            finished.append(outcome)
            return outcome

        def save(task=task, saved=saved):
            assert task.half == 0
            saved.append(task.steps)

        loop = RunLoop(run_settings())

        # a signal before the loop listens ends the process
        def work(loop=loop, task=task, save=save, timer=timer):
            timer.start()
            return loop.advance(task, save)

        with pytest.raises(KeyboardInterrupt) as caught:
            loop.run(work, run)
        assert caught.value.run is pm.Outcome.INTERRUPTED
        assert finished == [pm.Outcome.INTERRUPTED]
        assert saved[-1] == task.steps
        timer.join()


TERMINATED = """
import sys, numpy as np, packmech as pm
packing = pm.random_packing(60, dimension=2, packing_fraction=0.9, seed=1)
scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.5)))
def ready(stage, figures):
    print(figures["steps"], flush=True)
try:
    pm.ramp_strain(scene, rate=1e-4, applied_strain=10.0, checkpoint=sys.argv[1], progress=ready)
except KeyboardInterrupt as stop:
    print("stopped", stop.run.outcome.name, stop.run.steps, flush=True)
"""


def test_a_process_that_is_told_to_terminate_keeps_its_work(tmp_path):
    path = tmp_path / "run.npz"
    with subprocess.Popen(
        [sys.executable, "-c", TERMINATED, str(path)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=pathlib.Path(__file__).parents[2],
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        os.kill(process.pid, signal.SIGTERM)
        told = process.stdout.read().splitlines()[-1].split()
    assert process.returncode == 0
    assert told[:2] == ["stopped", "INTERRUPTED"]
    assert int(told[2]) > 0
    assert path.exists()


def test_a_program_that_handles_sigterm_itself_goes_on_doing_so():
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        task = Counting(20, 5, each=lambda step: signal.raise_signal(signal.SIGTERM) if step == 3 else None)
        assert RunLoop(run_settings()).advance(task) is pm.Outcome.FINISHED
    finally:
        signal.signal(signal.SIGTERM, before)
    assert heard == [signal.SIGTERM]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"time_limit": 0.0}, "time_limit must be a finite number above 0, got 0"),
        ({"step_limit": -1}, "step_limit must be an integer at least 0, got -1"),
        ({"threads": 0}, "threads must be an integer at least 1, got 0"),
        ({"checkpoint": "run.txt"}, r"checkpoint must end in \.npz"),
        ({"checkpoint_every": 3}, "checkpoint_every must be left out where no checkpoint is given"),
        ({"progress": 3}, "progress must be a function, got 3"),
        ({"check": 1}, "check must be True or False, got 1"),
    ],
)
def test_settings_are_checked_in_one_place(given, message):
    with pytest.raises((TypeError, ValueError), match=message):
        run_settings(**given)
