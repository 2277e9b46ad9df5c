"""Peers that have an environment of their own: a process of that Python, asked by lines of JSON.

jax-md, particleShear and rigidpy need nothing of packmech and packmech nothing of them:

    python3 -m venv peers-venv && peers-venv/bin/pip install jax-md particleshear rigidpy
"""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

_SCRIPT = Path(__file__).with_name("other_process.py")


class OtherPython:
    """A process of another Python on one core; without a path none of its peers is there."""

    def __init__(self, python: Path | None) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._process = None
        self.versions: dict[str, str] = {}
        if python is None:
            return
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "JAX_PLATFORMS": "cpu"}
        self._process = subprocess.Popen(
            [python, _SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self.versions = self.ask("versions")["versions"]

    def ask(self, name: str, **given: Any) -> dict[str, Any]:
        """Return what a function of the process answers."""
        assert self._process is not None and self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps([name, given]) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError(f"the process of the other Python ended while it was asked for {name}")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise RuntimeError(f"{name}: {answer['error']}")
        return answer

    def prepared(self, name: str, arrays: dict[str, Any], **given: Any) -> tuple[Callable[[], float], dict[str, Any]]:
        """Have a peer prepare its work on arrays; return the call that returns its CPU seconds, and a first answer."""
        path = Path(self._folder.name) / f"{name}.npz"
        np.savez(path, **arrays)
        first = self.ask("prepare", peer=name, path=os.fspath(path), **given)
        return lambda: float(self.ask("again")["seconds"]), first

    def close(self) -> None:
        """End the process."""
        if self._process is not None and self._process.stdin is not None:
            self._process.stdin.close()
            self._process.wait()
        self._folder.cleanup()
