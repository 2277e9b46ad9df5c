"""Open a recording in the Rerun viewer without a display and save a picture of it.

    python recordings/picture.py run.rrd picture.png [--step 1200] [--size 1600x900]

Needs a Vulkan driver; on a machine without a graphics card a software one does
(Debian: apt-get install mesa-vulkan-drivers libvulkan1). Fails if any view reports a warning or an error.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import rerun_cli
from PIL import Image
from rerun.experimental import ViewerClient

# the part of the window's height that the menu bar takes; it says nothing about the recording
MENU = 0.034


def picture(recording: Path, target: Path, *, step: int | None, size: tuple[int, int], port: int = 9880) -> list[str]:
    """Save the picture; return what the views report: warnings and errors, none when all is well."""
    if not recording.is_file():  # the viewer would show an empty window
        raise FileNotFoundError(f"recording must name an existing file, got {str(recording)!r}")
    # the binary itself: `rerun` on the path is a wrapper that would leave the viewer running when closed
    viewer_path = Path(rerun_cli.__file__).parent / "rerun"
    viewer = ViewerClient.spawn(headless=True, port=port, executable_path=str(viewer_path), hide_welcome_screen=True)
    try:
        viewer.open(str(recording.absolute()))
        shot = target.absolute().with_suffix(".full.png")
        # the viewer paints its start-up notices over the first pictures
        for _ in range(8):
            time.sleep(1.0)
            if step is not None:
                viewer.set_time("step", sequence=step, play_state="paused")
            viewer.save_screenshot(str(shot))
        reports = [str(report) for view in viewer.get_state().views for report in view.reports]
    finally:
        viewer.quit()
    with Image.open(shot) as image:
        menu = round(MENU * image.height)
        fitted = image.convert("RGB").crop((0, menu, image.width, image.height))
        fitted.thumbnail(size, Image.Resampling.LANCZOS)
        fitted.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(target, optimize=True)
    shot.unlink()
    return reports


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--step", type=int, default=None, help="step to show; the viewer's own choice if not given")
    parser.add_argument("--size", default="1600x900", help="largest width and height")
    given = parser.parse_args()
    width, height = (int(part) for part in given.size.split("x"))
    reported = picture(given.recording, given.target, step=given.step, size=(width, height))
    print("\n".join(reported) or f"{given.target}: no view reports a warning or an error")
    raise SystemExit(bool(reported))
