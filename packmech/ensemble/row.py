"""What row needs to run an ensemble on a cluster: its workflow.toml, with members grouped."""

from __future__ import annotations

from pathlib import Path

import tomli_w

from packmech.check import integer, positive
from packmech.ensemble.folder import RESULT, STATE_POINT
from packmech.files.paths import replacing

FILE = "workflow.toml"


def write_row(folder: Path, *, group: int = 100, seconds: float = 60.0, options: str = "") -> Path:
    """Write row's workflow.toml into the folder of an ensemble; return its path.

    ``row submit`` then hands the members that have no result yet to the cluster's scheduler, so many to a job; each job
    runs ``packmech ensemble resume`` on its members, and trusts the code of the folder that it was written into.

    Parameters
    ----------
    folder
        That of the ensemble.
    group
        Members to a job.
    seconds
        Walltime that a member may take [s].
    options
        Further options of the command, such as limits.

    """
    integer("group", group, at_least=1)
    positive("seconds", seconds)
    whole = max(1, round(seconds))
    command = f"packmech ensemble resume --folder . --workers 1 --trust {options}".strip()
    tables = {
        "workspace": {"value_file": STATE_POINT},
        "action": [
            {
                "name": "packmech",
                "command": f"{command} --members {{directories}}",
                "products": [RESULT],
                "resources": {
                    "processes": {"per_submission": 1},
                    "threads_per_process": 1,
                    "walltime": {"per_directory": f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}"},
                },
                "group": {"maximum_size": group},
            }
        ],
    }
    path = folder / FILE
    with replacing(path) as partial:
        partial.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path
