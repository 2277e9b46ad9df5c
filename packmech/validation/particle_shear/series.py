"""The package's series of runs: repetitions, amplitudes and friction coefficients, with its controls."""

from __future__ import annotations

import dataclasses
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from packmech import check
from packmech.validation.particle_shear.experiment import ParticleShear, ParticleShearRun
from packmech.validation.particle_shear.preparation import prepared_discs
from packmech.validation.particle_shear.text_file import write_text

CONTROLS = ("bulk", "uncrosslinked", "frictionless")


def run_series(
    experiment: ParticleShear,
    *,
    amplitudes: Sequence[float],
    friction_coefficients: Sequence[float],
    repetitions: int,
    seed: int,
    controls: Sequence[str] = (),
    folder: str | pathlib.Path | None = None,
    tensors: bool = True,
    **preparation: Any,
) -> Iterator[ParticleShearRun]:
    """Return an iterator over runs of an experiment, each on discs of its own; a run is made when it is asked for.

    Repetitions are the outermost loop, friction coefficients the innermost, as in the package.

    Parameters
    ----------
    experiment
        All other parameters.
    amplitudes, friction_coefficients
        What to run [1].
    repetitions
        How often.
    seed
        Of all draws; the same seed gives the same bits.
    controls
        What to run besides each run: "bulk", the same without cuts; "uncrosslinked", without bonds; "frictionless".
    folder
        An existing folder for a text file of each run; None: none are written.
    tensors
        Whether text files hold the series of tensors.
    preparation
        What `prepared_discs` takes, such as centers=5.

    Examples
    --------
    >>> short = ParticleShear(particles=20, pre_periods=0.1, periods=0.1, post_periods=0.1)
    >>> settings = {"amplitudes": [0.1, 0.2], "friction_coefficients": [0.01], "repetitions": 1, "seed": 1}
    >>> runs = run_series(short, **settings, controls=["uncrosslinked"], centers=2, steps=5)
    >>> [(run.experiment.amplitude, run.start.preparation.bonded) for run in runs]
    [(0.1, True), (0.1, False), (0.2, True), (0.2, False)]

    """
    check.instance("experiment", experiment, ParticleShear)
    strains = [check.positive(f"amplitudes[{k}]", one) for k, one in enumerate(amplitudes)]
    frictions = [
        check.real(f"friction_coefficients[{k}]", one, at_least=0.0) for k, one in enumerate(friction_coefficients)
    ]
    times = check.integer("repetitions", repetitions, at_least=1)
    rng = np.random.default_rng(check.integer("seed", seed, at_least=0))
    wanted = [check.one_of(f"controls[{k}]", one, CONTROLS) for k, one in enumerate(controls)]
    check.boolean("tensors", tensors)
    if folder is not None and not pathlib.Path(folder).is_dir():
        raise NotADirectoryError(f"folder must be an existing folder, got {folder}")
    cut = "lines" if preparation.get("lines") is not None else "centers"
    bonding = {name: value for name, value in preparation.items() if name in ("radii", "steps")}
    each: list[tuple[bool, dict[str, Any]]] = [(False, preparation)]
    if "bulk" in wanted:
        each.append((False, {**preparation, cut: 0}))
    if "uncrosslinked" in wanted:
        each.append((False, bonding))
    if "frictionless" in wanted:
        each.append((True, preparation))

    def runs() -> Iterator[ParticleShearRun]:
        for _ in range(times):
            for amplitude in strains:
                for friction in frictions:
                    for slippery, how in each:
                        one = dataclasses.replace(
                            experiment, amplitude=amplitude, friction_coefficient=0.0 if slippery else friction
                        )
                        run = one.run(prepared_discs(one, seed=int(rng.integers(2**62)), **how))
                        if folder is not None:
                            write_text(run, folder, tensors=tensors)
                        yield run

    return runs()
