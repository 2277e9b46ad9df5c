"""A plain window that shows pictures, for ``render_mode="human"``; it needs nothing but Python's own tkinter."""

from __future__ import annotations

import time
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

__all__ = ["Window"]


class Window:
    """A window that opens with its first picture and shows one after the other, no faster than asked for.

    A window that its user has closed stays closed; what was to be seen goes on unseen. So it does where no window can
    open, for want of a display or of tkinter: a warning says once what is needed.

    Parameters
    ----------
    title
        What stands above.
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
        # an episode need not end for want of somebody who looks on
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
                "and RerunRecorder writes files to be looked at elsewhere"
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
