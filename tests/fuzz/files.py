"""Damaged files of every format that packmech reads, and what is wrong with how they are taken.

    python tests/fuzz/files.py [--seed 0] [--files 10000] [--only PATTERN ...]

A file that packmech wrote is damaged at random: cut off, bits turned, blocks zeroed, moved, repeated or put in, lines
and words of texts changed. Reading it ends well with the original answer, or with an error of packmech's own in one
line that names what is wrong. A foreign error is a fault everywhere. That a damaged file is read as something else is
one where the format has a seal or a count (`SEALED`); in a text without, a changed digit is another number.
"""

from __future__ import annotations

import argparse
import fnmatch
import shutil
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "envs"), str(ROOT / "tests")]

from fuzz.calls import judge  # noqa: E402

import packmech as pm  # noqa: E402
from packmech.loop.checkpoint import fingerprint  # noqa: E402

Damage = Callable[[bytes, np.random.Generator], bytes]
# files whose bytes are under a seal: whatever is read of them must be what was written
SEALED = ("packing.npz", "packing.gsd", "shapes.npz", "run.npz", "ensemble/result")


def discs() -> pm.Packing:
    """Return a packing of discs of two sizes."""
    return pm.random_packing(12, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.8, seed=1)


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: rng.integers(len(content))]


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    held = bytearray(content)
    for at in rng.integers(len(held), size=1 + rng.integers(4)):
        held[at] ^= 1 << int(rng.integers(8))
    return bytes(held)


def _block(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    first = int(rng.integers(len(content)))
    return first, min(first + 1 + int(rng.integers(64)), len(content))


def _zero(content: bytes, rng: np.random.Generator) -> bytes:
    first, end = _block(content, rng)
    return content[:first] + bytes(end - first) + content[end:]


def _leave_out(content: bytes, rng: np.random.Generator) -> bytes:
    first, end = _block(content, rng)
    return content[:first] + content[end:]


def _repeat(content: bytes, rng: np.random.Generator) -> bytes:
    first, end = _block(content, rng)
    return content[:end] + content[first:]


def _put_in(content: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(content)))
    return content[:at] + rng.bytes(1 + int(rng.integers(32))) + content[at:]


def _append(content: bytes, rng: np.random.Generator) -> bytes:
    return content + rng.bytes(1 + int(rng.integers(200)))


def _nothing(content: bytes, rng: np.random.Generator) -> bytes:
    return b""


def _line(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    at, kind = int(rng.integers(len(lines))), int(rng.integers(3))
    lines[at : at + 1] = ([], [lines[at], lines[at]], [lines[(at + 1) % len(lines)]])[kind]
    return b"\n".join(lines)


_WORDS = (b"nan", b"inf", b"-1", b"0", b"1e999", b"9" * 30, b"-9223372036854775808", b"word", b"", b"1.5", b"\xff")


def _word(content: bytes, rng: np.random.Generator) -> bytes:
    words = content.split(b" ")
    words[int(rng.integers(len(words)))] = _WORDS[int(rng.integers(len(_WORDS)))]
    return b" ".join(words)


DAMAGES: dict[str, Damage] = {
    "cut off": _cut,
    "bits": _flip,
    "zeros": _zero,
    "left out": _leave_out,
    "repeated": _repeat,
    "put in": _put_in,
    "appended": _append,
    "empty": _nothing,
    "line": _line,
    "word": _word,
}


def originals(folder: Path) -> dict[str, tuple[Path, Callable[[Path], Any]]]:
    """Write files of all formats; return by name the file that is damaged, and what reads it."""
    packing, springs = discs(), pm.Scene(discs(), (pm.Repulsion(),))
    ellipses = pm.random_packing(6, dimension=2, packing_fraction=0.6, seed=1, shapes=pm.Ellipses(1.5))
    found: dict[str, tuple[Path, Callable[[Path], Any]]] = {}
    for ending in ("npz", "gsd", "txt", "csv", "data", "dump", "extxyz", "vtp"):
        path = folder / f"packing.{ending}"
        pm.write_packing(packing, path, drop=True)
        found[path.name] = path, pm.read_packing
    pm.write_packing(ellipses, folder / "shapes.npz")
    found["shapes.npz"] = folder / "shapes.npz", pm.read_packing
    pm.write_trajectory([packing, packing], folder / "two.dump")
    found["two.dump"] = folder / "two.dump", lambda path: list(pm.read_trajectory(path))
    pm.write_scene(springs, folder / "scene.toml")
    found["scene.toml"] = folder / "scene.toml", pm.read_scene
    run = pm.simulate(springs, steps=20, trace_every=5, dt=0.01, checkpoint=folder / "run.npz")
    found["run.npz"] = folder / "run.npz", lambda path: pm.resume(path, springs, steps=24).packing
    pm.write_table(run, folder / "trace.csv")
    found["trace.csv"] = folder / "trace.csv", _columns
    (folder / "corner.off").write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 1\n3 0 1 2\n3 1 2 3\n")
    found["corner.off"] = folder / "corner.off", lambda path: pm.read_mesh(path).vertices
    pm.run_ensemble("calendar:leapdays", {"y1": 2000, "y2": [2010, 2020]}, folder / "ensemble", workers=1)
    member = next((folder / "ensemble" / "workspace").iterdir())
    for name, one in (
        ("ensemble/job", folder / "ensemble" / "ensemble.json"),
        ("ensemble/result", member / "result.json"),
        ("ensemble/parameters", member / "signac_statepoint.json"),
    ):
        found[name] = one, lambda path: _table(folder / "ensemble")
    return found


def _columns(path: Path) -> dict[str, Any]:
    found = pm.read_table(path)
    return {name: found[name] for name in found.columns}


def _table(folder: Path) -> dict[str, Any] | None:
    """Return what an ensemble's folder says; None where it says that a result is missing."""
    found = pm.read_ensemble(folder)
    if found.counts()["missing"]:
        return None
    return {name: found[name] for name in found.columns if name not in ("seconds", "id")}


def main() -> int:
    """Damage the files that the command asks for and print the faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--only", nargs="*", default=["*"])
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    faults, taken = Counter[str](), Counter[str]()
    with tempfile.TemporaryDirectory() as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(temporary)
        known = {
            name: one
            for name, one in originals(folder).items()
            if any(fnmatch.fnmatch(name, pattern) for pattern in asked.only)
        }
        for k in range(asked.files):
            name = list(known)[k % len(known)]
            damage = list(DAMAGES)[int(rng.integers(len(DAMAGES)))]
            fault, how = damaged(name, *known[name], damage, rng)
            taken[f"{name} {how}"] += 1
            if fault:
                faults[fault] += 1
                if faults[fault] == 1:
                    print(fault, flush=True)
    for name, count in sorted(taken.items()):
        print(f"{name:40} {count}")
    print(f"{asked.files} files, {sum(faults.values())} faults of {len(faults)} kinds")
    return bool(faults)


def damaged(
    name: str, path: Path, read: Callable[[Path], Any], damage: str, rng: np.random.Generator
) -> tuple[str, str]:
    """Read a file once it is damaged, and put it back; return what is wrong, if anything, and how it was taken."""
    content = path.read_bytes()
    right = fingerprint(_plain(read(path)))
    kept = path.with_name("kept")
    shutil.copy2(path, kept)
    found: list[str] = []
    try:
        changed = DAMAGES[damage](content, rng)
        path.write_bytes(changed)
        fault = judge(f"{name}, {damage}", lambda: found.append(fingerprint(_plain(read(path)))))
    finally:
        kept.replace(path)
    if fault is not None:
        return f"{name}, {damage}: {fault.what} at {fault.where}", "wrongly"
    if not found or found[0] == fingerprint(None):
        return "", "refused"
    if found[0] == right:
        return "", "as it was"
    return (f"{name}, {damage}: read as something else" if name in SEALED else ""), "as something else"


def _plain(value: Any) -> Any:
    """Return what is compared of an answer."""
    if isinstance(value, pm.Packing):
        return value.position_nd, value.radius_n, value.box.lattice_dd, value.mass_n
    if isinstance(value, pm.Scene):
        return _plain(value.packing), value.effects, value.drive
    if isinstance(value, dict):
        return [(name, _plain(one)) for name, one in value.items()]
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return _plain(value.packing) if hasattr(value, "packing") else value


if __name__ == "__main__":
    sys.exit(main())
