"""What environments show: a window, a picture as an array, or a line of text."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech_envs.words import brief

__all__ = ["METADATA", "Screen", "Window", "contacts_of"]

METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 30}


def contacts_of(packing: pm.Packing) -> pm.Contacts | pm.ShapeContacts:
    """Return the touching pairs of a packing, of discs and spheres or of other shapes.

    Parameters
    ----------
    packing
        The packing.

    Examples
    --------
    >>> len(contacts_of(pm.lattice_packing("triangular", repeats=(2, 2))))
    12

    """
    return (pm.find_shape_contacts if packing.shapes.has_orientations else pm.find_contacts)(packing)


class Screen:
    """What an environment's `render` does in each of its modes.

    An environment makes one with its render_mode, calls `refresh` at the end of `reset` and `step`, `render` in
    `render`, and `close` in `close`. Pictures are drawn only where they are shown.

    Parameters
    ----------
    render_mode
        "rgb_array", "human" (a window), "ansi" (text), or None.
    title
        Title of the window.
    fps
        Largest number of pictures in a second in the window.

    Raises
    ------
    ValueError
        For another render_mode.

    Examples
    --------
    >>> screen = Screen("ansi", "packmech")
    >>> screen.render(lambda: np.zeros((48, 64, 3), dtype=np.uint8), lambda: "strain 0.1")
    'strain 0.1'

    """

    def __init__(self, render_mode: str | None, title: str, fps: float = METADATA["render_fps"]) -> None:
        modes = METADATA["render_modes"]
        if render_mode is not None and not (isinstance(render_mode, str) and render_mode in modes):
            raise ValueError(f"render_mode must be one of {', '.join(modes)} or None, got {brief(render_mode)}")
        self.render_mode = render_mode
        self.window = Window(title, fps) if render_mode == "human" else None

    def refresh(self, picture: Callable[[], NDArray[np.uint8]]) -> None:
        """Show the picture of now in the window, if that is the mode."""
        if self.window is not None and self.window.open():
            self.window.show(picture())

    def render(
        self, picture: Callable[[], NDArray[np.uint8]], text: Callable[[], str]
    ) -> NDArray[np.uint8] | str | None:
        """Return what the mode asks for: a picture, a text, or None, with a warning where no mode was chosen."""
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


class Window:
    """A plain window of Python's own tkinter that shows pictures one after the other, no faster than asked for.

    It opens with its first picture. A window that its user has closed stays closed, and the episode goes on. So it does
    where no window can open, without a display or without tkinter: one warning says what is needed.

    Parameters
    ----------
    title
        Title of the window.
    fps
        Largest number of pictures in a second.

    """

    def __init__(self, title: str, fps: float) -> None:
        self.title, self.fps = title, fps
        self.shown = 0
        self._tried = False
        self._root: Any = None
        self._label: Any = None
        self._photo: Any = None
        self._next = 0.0

    @property
    def is_open(self) -> bool:
        """Whether there is a window."""
        return self._root is not None

    def open(self) -> bool:
        """Return whether there is a window, after it was opened where that has not been tried yet."""
        if not self._tried:
            self._tried = True
            self._open()
        return self.is_open

    def show(self, pixels: NDArray[np.uint8]) -> None:
        """Show a picture (height, width, 3), after a wait where the last one has just been shown."""
        if not self.open():
            return
        import tkinter

        wait = self._next - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
        self._next = time.monotonic() + 1.0 / self.fps
        height, width, _ = pixels.shape
        data = b"P6 %d %d 255\n" % (width, height) + np.ascontiguousarray(pixels).tobytes()
        try:
            # the label does not keep its picture alive
            self._photo = tkinter.PhotoImage(master=self._root, data=data, format="PPM")
            self._label.configure(image=self._photo)
            self._root.update()
        except tkinter.TclError:  # closed while it was painted
            self._root = None
        self.shown += 1

    def _open(self) -> None:
        # an episode goes on without a window
        try:
            import tkinter
        except ImportError:
            gym.logger.warn(
                'render_mode="human" needs tkinter, a part of Python that some systems package apart '
                '(Debian: apt-get install python3-tk); nothing is shown. "rgb_array" needs nothing'
            )
            return
        try:
            root = tkinter.Tk()
        except tkinter.TclError as missing:
            gym.logger.warn(
                f'render_mode="human" needs a display ({missing}); nothing is shown. "rgb_array" draws without one, '
                "and RerunRecorder writes files to open elsewhere"
            )
            return
        root.title(self.title)
        root.resizable(False, False)
        root.protocol("WM_DELETE_WINDOW", self.close)
        self._label = tkinter.Label(root, borderwidth=0)
        self._label.pack()
        self._root = root

    def close(self) -> None:
        """Close the window, if there is one."""
        root, self._root = self._root, None
        self._photo = self._label = None
        if root is not None:
            root.destroy()
