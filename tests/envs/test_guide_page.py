"""The scripts of the guide's page on environments do what the page says, as they are printed there."""

import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import packmech as pm

PAGE = Path(__file__).parents[2] / "packmech" / "guide" / "environments.md"


WORDS = ("action(packing", "np.sin(phase)", "action_space.sample()", "PPO(")


def scripts():
    """Return the Python blocks of the page that stand alone, each found by a word of its own."""
    found = re.findall(r"^```python[^\n]*\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [script for word in WORDS for script in found if word in script]


def run(script, folder, monkeypatch):
    """Run a script in a folder of its own and return its names."""
    monkeypatch.chdir(folder)
    names = {"__name__": "__main__"}
    exec(compile(script, PAGE.name, "exec"), names)
    return names


@pytest.fixture(autouse=True)
def gymnasium_warnings(monkeypatch):
    # wrappers of gymnasium's own warn of what is no fault here, such as bounds without an end
    monkeypatch.setattr(gym.logger, "warn", lambda *told, **more: None)


def test_the_page_has_four_scripts_that_stand_alone():
    found = scripts()
    assert len(found) == 4
    for script, word in zip(found, WORDS, strict=True):
        assert word in script and "import gymnasium as gym" in script


def test_stepping_by_hand_ends_in_a_packing_that_is_jammed(tmp_path, monkeypatch, capsys):
    names = run(scripts()[0], tmp_path, monkeypatch)
    packing = names["env"].unwrapped.packing
    assert names["terminated"] and names["info"]["jammed"]
    assert pm.classify_jamming(packing).collective == "jammed"
    assert capsys.readouterr().out.split()[0] == "True"
    assert 0.80 < names["info"]["packing_fraction"] < 0.87


def test_the_scripted_oscillation_measures_the_moduli_of_oscillatory_shear(tmp_path, monkeypatch):
    names = run(scripts()[1], tmp_path, monkeypatch)
    env, moduli = names["env"].unwrapped, names["moduli"]
    period = round(1.0 / 0.02 / env.frame_time)
    twin = pm.oscillatory_shear(
        env.scene,
        amplitude=1e-3,
        frequency=0.02,
        periods=3,
        skip_periods=1,
        dt=env.frame_time,
        samples_per_period=period,
    )
    assert moduli.storage == pytest.approx(twin.moduli.storage, rel=1e-11)
    assert moduli.loss == pytest.approx(twin.moduli.loss, rel=1e-11)
    # springs across the contacts add to those along them
    bare = pm.elastic_moduli(pm.Scene(env.scene.packing, (pm.Repulsion(),))).shear_modulus
    assert moduli.storage > 3.0 * bare


def test_the_random_agent_leaves_a_recording_and_pictures(tmp_path, monkeypatch):
    names = run(scripts()[2], tmp_path, monkeypatch)
    assert names["pictures"][0].shape == (480, 480, 3) and len(names["pictures"]) == 8
    assert len(set(names["returned"].tolist())) == 8 and np.isfinite(names["returned"]).all()
    assert [path.name for path in (tmp_path / "recordings-of-shear").iterdir()] == ["packmech-episode-0.rrd"]


@pytest.mark.slow
def test_the_agent_learns_for_a_while(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    script = scripts()[3]
    assert "learn(65_536)" in script
    names = run(script.replace("learn(65_536)", "learn(2_048)"), tmp_path, monkeypatch)
    assert names["agent"].num_timesteps >= 2048
    assert names["actions"].shape == (100, 2) and len(names["jammed"]) == 100
