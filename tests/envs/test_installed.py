"""The environments work from an installed wheel, outside the repository, in every mode that Gymnasium has."""

import json
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

SCRIPT = """
import json, sys
import gymnasium as gym
import numpy as np

numbers = {"modes": {}}
for name, more in (("Shear-v0", {"scene": "triangular", "frame_skip": 5}), ("Quench-v0", {})):
    env = gym.make(f"packmech_envs:packmech/{name}", render_mode="rgb_array", **more)
    observation, info = env.reset(seed=1)
    env.action_space.seed(1)
    observation, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observation) and env.render().shape == (480, 480, 3)
    env.close()
    for mode in ("vector_entry_point", "sync", "async"):
        envs = gym.make_vec(f"packmech_envs:packmech/{name}", num_envs=2, vectorization_mode=mode, **more)
        envs.reset(seed=1)
        envs.action_space.seed(1)
        observations, *_ = envs.step(envs.action_space.sample())
        numbers["modes"][f"{name} {mode}"] = np.asarray(observations).tolist()
        envs.close()
import packmech, packmech_envs
numbers["files"] = [packmech.__file__, packmech_envs.__file__]
numbers["scenes"] = len(packmech.list_scenes())
print(json.dumps(numbers))
"""

WITHOUT = """
import sys
sys.modules["gymnasium"] = None
try:
    import packmech_envs
except ModuleNotFoundError as missing:
    print(missing)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A Python that has the wheel, and everything that this one has but the repository."""
    folder = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(folder), str(ROOT)], check=True)
    (wheel,) = folder.glob("packmech-*.whl")
    venv.create(folder / "venv", symlinks=True)
    python = folder / "venv" / "bin" / "python"
    subprocess.run([*pip, "--python", str(python), "install", "--no-deps", "--no-index", str(wheel)], check=True)
    # what packmech depends on; links to the repository that may lie there are not followed from here
    asked = "import sysconfig; print(sysconfig.get_path('purelib'))"
    there = subprocess.run([python, "-c", asked], check=True, capture_output=True, text=True).stdout.strip()
    (Path(there) / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python, folder


@pytest.mark.slow
def test_both_environments_are_made_in_every_mode_from_a_wheel_outside_the_repository(installed):
    python, folder = installed
    (folder / "script.py").write_text(SCRIPT)
    done = subprocess.run([python, "-I", "script.py"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout.splitlines()[-1])
    assert all(Path(file).is_relative_to(folder / "venv") for file in numbers["files"])
    assert numbers["scenes"] > 10
    for name in ("Shear-v0", "Quench-v0"):
        batch, sync, parallel = (numbers["modes"][f"{name} {mode}"] for mode in ("vector_entry_point", "sync", "async"))
        assert batch == sync == parallel  # to the last bit


@pytest.mark.slow
def test_without_gymnasium_the_wheel_says_which_extra_to_install(installed):
    python, folder = installed
    done = subprocess.run([python, "-I", "-c", WITHOUT], cwd=folder, capture_output=True, text=True, check=True)
    assert 'pip install "packmech[envs]"' in done.stdout
