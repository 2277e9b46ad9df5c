"""Facts about what environments show: each render mode, the window, and what is said where it cannot open."""

import sys

import gymnasium as gym
import numpy as np
import pytest
from packmech_envs.drawing import METADATA, Screen, Window

import packmech as pm

CRYSTAL = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)


def picture():
    return pm.draw_frame(CRYSTAL, size=(64, 48))


def test_each_mode_returns_what_gymnasium_expects_of_it():
    array = Screen("rgb_array", "packmech").render(picture, lambda: "text")
    assert array.shape == (48, 64, 3) and array.dtype == np.uint8
    assert Screen("ansi", "packmech").render(picture, lambda: "text") == "text"


def test_without_a_mode_render_warns_and_draws_nothing(monkeypatch):
    said = []
    monkeypatch.setattr(gym.logger, "warn", said.append)
    screen = Screen(None, "packmech")
    screen.refresh(pytest.fail)
    assert screen.render(pytest.fail, pytest.fail) is None
    assert len(said) == 1 and "render_mode" in said[0]


def test_an_unknown_mode_is_refused_by_name():
    with pytest.raises(ValueError, match="render_mode must be one of human, rgb_array, ansi or None, got 'video'"):
        Screen("video", "packmech")
    assert set(METADATA["render_modes"]) == {"human", "rgb_array", "ansi"}


def test_nothing_is_drawn_step_by_step_but_for_the_window():
    for mode in ("rgb_array", "ansi", None):
        Screen(mode, "packmech").refresh(pytest.fail)


def test_without_a_display_a_warning_says_once_what_is_needed_and_nothing_is_drawn(monkeypatch):
    pytest.importorskip("tkinter")
    monkeypatch.setenv("DISPLAY", "")
    if sys.platform != "linux":
        pytest.skip("displays are named by DISPLAY on Linux")
    said = []
    monkeypatch.setattr(gym.logger, "warn", said.append)
    screen = Screen("human", "packmech")
    screen.refresh(pytest.fail)
    assert screen.render(pytest.fail, pytest.fail) is None
    assert len(said) == 1 and '"human" needs a display' in said[0] and '"rgb_array" draws without one' in said[0]
    screen.close()


def test_without_tkinter_a_warning_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "tkinter", None)
    said = []
    monkeypatch.setattr(gym.logger, "warn", said.append)
    window = Window("packmech", 30)
    window.show(picture())
    window.show(picture())
    assert len(said) == 1 and "needs tkinter" in said[0] and "python3-tk" in said[0]
    assert not window.is_open and window.shown == 0


WINDOW = """
import time
import numpy as np
import packmech as pm
from packmech_envs.drawing import Screen

pixels = pm.draw_frame(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), size=(64, 48))
screen = Screen("human", "packmech", fps=20.0)
began = time.monotonic()
for _ in range(5):
    screen.refresh(lambda: pixels)
assert time.monotonic() - began >= 4 / 20.0
window = screen.window
assert window.is_open and window.shown == 5
photo = window._photo
assert (photo.width(), photo.height()) == (64, 48)
assert photo.get(20, 30) == tuple(int(part) for part in pixels[30, 20])
window.close()  # as its user does
assert screen.render(lambda: pixels, str) is None
assert not window.is_open and window.shown == 5
screen.close()
print("all is well")
"""


def test_the_window_shows_pictures_no_faster_than_asked_and_stays_closed_once_closed(on_a_display):
    assert on_a_display(WINDOW) == "all is well\n"
