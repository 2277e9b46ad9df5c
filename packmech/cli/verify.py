"""`packmech verify`: whether an independent referee proves what the certificate in a file claims."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

import packmech as pm
from packmech.cli import FAILED, OK
from packmech.cli.output import Files, Json, show


def verify(
    file: Annotated[
        Path, Parameter(help="a certificate (.npz): --certificate of analyze and unjam, write_certificate")
    ],
    /,
    *,
    json: Json = None,
) -> int:
    """Say whether what a certificate of jamming claims is proven; the exit code is 0 where it is, else 1."""
    files = Files(json=json)
    found = pm.verify(file)
    show(str(found))
    files.write_json(vars(found) | {"reasons": list(found.reasons)})
    files.say_what_was_written()
    return OK if found.accepted else FAILED
