"""What environments show of themselves: pictures as arrays, a window, or a line of text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.window import Window

__all__ = ["RENDER_FPS", "RENDER_MODES", "Screen", "draw"]

RENDER_MODES = ["human", "rgb_array", "ansi"]
RENDER_FPS = 30


def draw(
    packing: pm.Packing,
    *,
    contacts: pm.Contacts | None = None,
    force_c: Any = None,
    size: tuple[int, int] = (480, 480),
    **more: Any,
) -> NDArray[np.uint8]:
    """Return a picture (height, width, 3) of a packing and the forces of its contacts; the same bytes every time.

    Parameters
    ----------
    packing, contacts, force_c, size
        As of `pm.draw_frame`.
    more
        Its other arguments: `effects`, `sliding_c`, `rattler_n`, `beads`.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> draw(pm.lattice_packing("kagome", repeats=(2, 2)), size=(60, 40)).shape
    (40, 60, 3)

    """
    picture: NDArray[np.uint8] = pm.draw_frame(packing, contacts=contacts, force_c=force_c, size=size, **more)
    return picture


class Screen:
    """What an environment's `render` does in each of its modes.

    An environment makes one with its render_mode, calls `refresh` at the end of `reset` and `step`, `render` in
    `render`, and `close` in `close`. Nothing is drawn that is not asked for.

    Parameters
    ----------
    render_mode
        "rgb_array", "human" (a window), "ansi" (text), or None.
    title
        What stands above the window.
    fps
        Largest number of pictures in a second in the window.

    Raises
    ------
    ValueError
        For another render_mode.

    Examples
    --------
    >>> screen = Screen("ansi", "packmech")
    >>> screen.render(lambda: draw(pm.lattice_packing("square")), lambda: "strain 0.1")
    'strain 0.1'

    """

    def __init__(self, render_mode: str | None, title: str, fps: float = RENDER_FPS) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ValueError(f"render_mode must be one of {', '.join(RENDER_MODES)} or None, got {render_mode!r}")
        self.render_mode = render_mode
        self.window = Window(title, fps) if render_mode == "human" else None

    def refresh(self, picture: Callable[[], NDArray[np.uint8]]) -> None:
        """Show the present moment in the window, if that is the mode."""
        if self.window is not None and self.window.open():
            self.window.show(picture())

    def render(
        self, picture: Callable[[], NDArray[np.uint8]], text: Callable[[], str]
    ) -> NDArray[np.uint8] | str | None:
        """Return what the mode says: a picture, a text, or None, with a warning where no mode was chosen."""
        if self.render_mode is None:
            gym.logger.warn(
                "render() was called without a render_mode: choose one when making the environment, "
                'such as gym.make("packmech/Shear-v0", render_mode="rgb_array")'
            )
            return None
        if self.render_mode == "rgb_array":
            return picture()
        if self.render_mode == "ansi":
            return text()
        self.refresh(picture)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.window is not None:
            self.window.close()
