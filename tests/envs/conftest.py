"""What tests of environments share: programs that run with a display in memory."""

import os
import shutil
import subprocess
import sys

import pytest


@pytest.fixture(scope="session")
def on_a_display():
    """A function that runs a program where a display is, in a process of its own: Tk outlives no display."""
    pytest.importorskip("tkinter")
    server_program = shutil.which("Xvfb")
    if server_program is None:
        pytest.skip("needs Xvfb")
    read, write = os.pipe()
    server = subprocess.Popen(
        [server_program, "-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as display:
        number = display.readline().strip()

    def run(code):
        environment = {**os.environ, "DISPLAY": f":{number}"}
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, env=environment, timeout=120, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    yield run
    server.terminate()
    server.wait()
