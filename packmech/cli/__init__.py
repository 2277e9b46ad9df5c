"""The command `packmech`: one module for each verb, imported when it is called. Each is a few calls of the library."""

from __future__ import annotations

import errno
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from types import FrameType

from cyclopts import App, CycloptsError, Parameter

OK, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
# errors that need no traceback; PACKMECH_TRACEBACK=1 shows where they came from
EXPECTED = (ValueError, TypeError, OSError, ImportError, CycloptsError)

ABOUT = "Mechanics of jammed packings: make them, ask whether they are jammed, how stiff they are, how they vibrate."
NEXT = """
Begin here:
  packmech jam                                   jam 256 discs, say what the packing is, leave a recording
  packmech jam --particles 500 --dimension 3 --law hertz
  packmech new mine.toml --friction 0.3          a scene file with comments, to change by hand
  packmech jam mine.toml --set drive.pressure=1e-4
  packmech guide                                 what there is to read
Help on a verb: packmech VERB --help"""
# what to do where one run is asked for several values
SEVERAL = "one run for each value, or for each seed, is made by packmech ensemble SCENE"
# verb: what it does. Its function is packmech.cli.VERB.VERB
# options of which several values are a sweep
_SWEPT = ("--pressure", "--friction", "--particles", "--packing-fraction", "--seed", "--set")
VERBS = {
    "new": "Write a scene file with comments, to change by hand.",
    "jam": "Jam a scene, say what the packing is, and leave a recording of it.",
    "run": "Do what a scene's own [drive] says, and report the result.",
    "analyze": "Examine a packing made elsewhere; nothing is moved.",
    "accuracy": "Find the cheapest settings with which a scene's run is as exact as asked.",
    "unjam": "Ask whether a packing is jammed, and play the motion that unjams it.",
    "export": "Write a scene as input of LAMMPS or JAX MD, with the energy that it must find.",
    "verify": "Say whether the certificate of a verdict is proven, by an independent referee.",
    "scenes": "List, show or copy the scenes that ship inside the package.",
    "gallery": "List or run short scripts that each answer one question, with a figure.",
    "effects": "Say which call honors which effect of a scene.",
    "ensemble": "Run a scene or a function over seeds and parameters, here or on a cluster; resumes what it finds.",
    "guide": "List what there is to read, or print one page of it.",
}


def app() -> App:
    """Return the command line; the module of a verb is imported once the verb is called, or its help asked for."""
    made = App(
        name="packmech",
        help=ABOUT,
        version=lambda: f"packmech {version('packmech')}",
        help_format="plaintext",
        default_parameter=Parameter(negative=()),
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
        suppress_keyboard_interrupt=False,
    )
    for verb, about in VERBS.items():
        name = verb.replace("-", "_")
        made.command(f"packmech.cli.{name}:{name}", name=verb, help=about)
    return made


def execute(words: Sequence[str]) -> int:
    """Do what the words of a command line say; return the exit code."""
    made = app()
    if not words:
        made.help_print()
        print(NEXT)
        return OK
    _refuse_several(words)
    code = made(_with_live_target(list(words)))
    return OK if code is None else int(code)


def _refuse_several(words: Sequence[str]) -> None:
    """Refuse what asks one run for several values, and say which verb takes them."""
    verb, found = words[0], None
    if verb == "sweep":
        found = f"verb must be one of {', '.join(VERBS)}, got 'sweep'"
    elif verb in ("run", "jam"):
        for k, word in enumerate(words):
            name = word.partition("=")[0]
            if name in ("--grid", "--sweep", "--seeds"):
                found = f"{name} must be left out of packmech {verb}, which makes one run"
            elif word in _SWEPT and len(words) > k + 2 and all(map(_is_number, words[k + 1 : k + 3])):
                found = f"{name} must be one number, got {words[k + 1]} {words[k + 2]}"
    if found is not None:
        raise ValueError(f"{found}: {SEVERAL} --grid drive.pressure=1e-6,1e-5 --seeds 0:4")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _with_live_target(words: list[str]) -> list[str]:
    """Name the viewer where `--live` stands without a target."""
    for k, word in enumerate(words):
        if word == "--live" and (k + 1 == len(words) or words[k + 1].startswith("-")):
            return [*words[: k + 1], "viewer", *words[k + 1 :]]
    return words


def _terminate(number: int, frame: FrameType | None) -> None:
    """Stop as after Ctrl-C, which waits for the compiler, also where Ctrl-C itself is ignored."""
    if callable(signal.getsignal(signal.SIGINT)):
        signal.raise_signal(signal.SIGINT)
    else:
        raise KeyboardInterrupt


_FORMAT_WARNING = warnings.formatwarning


def _format_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Return a warning of packmech's as one line without its place in the code, which is the command's own."""
    if category is not UserWarning or os.environ.get("PACKMECH_TRACEBACK"):
        return _FORMAT_WARNING(message, category, filename, lineno, line)
    return f"packmech: {message}\n"


def main() -> None:
    """Run the command; an error of the input or of convergence is one line and an exit code."""
    signal.signal(signal.SIGTERM, _terminate)
    warnings.formatwarning = _format_warning
    # a command without somewhere to say anything does its work
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - until the process ends
    try:
        code = execute(sys.argv[1:])
        sys.stdout.flush()
        sys.exit(code)
    except BrokenPipeError:  # whoever reads the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILED)
    except KeyboardInterrupt as stop:
        words, folder = "packmech: interrupted", getattr(stop, "folder", None)
        if folder is not None and folder.exists():
            words += f"; {stop.finished} of {stop.wanted} members are finished and stay in {folder}"  # type: ignore[attr-defined]
            words += "; the same command goes on"
        print(words, file=sys.stderr)
        sys.exit(INTERRUPTED)
    except (*EXPECTED, RuntimeError) as error:
        not_converged = isinstance(error, RuntimeError) and hasattr(error, "run")
        if os.environ.get("PACKMECH_TRACEBACK") or not (not_converged or isinstance(error, EXPECTED)):
            raise
        lines = [" ".join(line.split()) for line in str(error).splitlines()]
        if isinstance(error, OSError) and error.errno == errno.ENOSPC and error.filename is None:
            # what is left of the output cannot be written at the end, either
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            lines = [f"the output could not be written: {error.strerror}"]
        print("packmech:", "\n".join(lines) or type(error).__name__, file=sys.stderr)
        sys.exit(FAILED if not_converged else BAD_INPUT)


if __name__ == "__main__":
    main()
