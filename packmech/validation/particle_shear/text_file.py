"""The reference package's text file: a header in its words, and 42 columns, a line for every step.

The labels are the ones that the package's evaluation in R looks for; numbers are written without exponents, since its
patterns read digits and a point. What the package writes wrong there is right here: the periods after the
measurement, the time simulated, the two radii and their masses, and how the discs were bonded.
"""

from __future__ import annotations

import dataclasses
import pathlib
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech import check
from packmech.check import brief
from packmech.validation.particle_shear.experiment import ParticleShear, ParticleShearRun
from packmech.validation.particle_shear.material import contact_stiffness, contact_viscosity
from packmech.validation.particle_shear.step import STRESSES, Preparation, ShearedDiscs

# the columns' names of our tensors, in the order of the file
COLUMNS = {
    "love_weber": "Love_Weber",
    "otsuki": "peculiar_acceleration_otsuki",
    "external": "from_external_forces",
    "linear_acceleration": "linear_acceleration",
    "unbalanced": "unbalanced_linear_forces",
    "torque": "tangential_torque",
    "internal_torque": "internal_tangential_torque",
    "centrifugal": "centrifugal",
    "overall": "overall",
}

HEADINGS = (
    *("index", "t", "strain", "strain_rate", "stress_measured_at_surface", "shear_stress_internal_stress-tensor"),
    *(f"stress_tensor_{column}_{entry}" for column in COLUMNS.values() for entry in ("00", "01", "10", "11")),
)
_START = "Detailed stress tensor data"


def _plain(number: float) -> str:
    """Return a number with all its digits and no exponent; whole ones without a point."""
    return np.format_float_positional(float(number), trim="-")


def _call(run: ParticleShearRun, how: Preparation) -> str:
    experiment = run.experiment
    numbers = {
        "N": experiment.particles,
        "packing_fraction": experiment.packing_fraction,
        "density": experiment.density,
        "bimodal_factor": experiment.size_ratio,
        "amplitude": experiment.amplitude,
        "Young_modulus_spheres": experiment.young_modulus,
        "mu": experiment.friction_coefficient,
        "relative_viscosity": experiment.relative_viscosity,
        "relative_frequency": experiment.relative_frequency,
        "relative_transversal_link_strength": experiment.tangential_ratio,
        "central_repulsion_coefficient": experiment.divergence,
        "avoid_horizontal_angle_degree": how.avoided_angle,
        "interface_reenforcement_central": experiment.reinforcement_normal,
        "interface_reenforcement_tangential": experiment.reinforcement_tangential,
        "remove_link_fraction": how.removed_fraction,
        "edge_fuzziness": how.edge_fuzziness,
    }
    words: dict[str, Any] = {"do_permanent_links": how.bonded, "cut_lines": how.pieces}
    words |= {name: _plain(number) for name, number in numbers.items()}
    words |= {
        "avoid_height_spanning_particles": how.no_spanning,
        "keep_viscosity_coefficients_constant": experiment.keep_viscosity,
        "cut_top_bottom": how.cut_top_bottom,
        "doCutByTriangulation": how.by_centers,
        "doDrawing": False,
    }
    return "ParticleShear(" + ",".join(f"{name}={value}" for name, value in words.items()) + ")"


def _about_bonds(how: Preparation) -> list[str]:
    """Return the lines that say how discs were bonded."""
    if not how.bonded:
        return ["Dermal filler control ensemble: No permanent links"]
    if not how.pieces:
        return ["Dermal filler control ensemble: no cut lines"]
    tool = "Centers" if how.by_centers else "Cutting lines"
    return ["Dermal filler Ensemble:", f"\t{tool} used to generate the particles = {how.pieces}"]


def _about_law(experiment: ParticleShear) -> list[str]:
    """Return the lines that say which law is in force, where it is not the package's own one."""
    if experiment.law == "plateau":
        numbers = experiment.plateau_begin, experiment.plateau_end, experiment.plateau_slope
        return [f"Elastic force law = plateau, begin, end and slope = {', '.join(map(_plain, numbers))}[-]"]
    if experiment.law == "exponential":
        return [f"Tensile force law = exponential, range = {_plain(experiment.tensile_range)}[-]"]
    return []


def _header(run: ParticleShearRun, how: Preparation) -> list[str]:
    experiment, discs, made = run.experiment, run.start, run.experiment.material
    stiffness = contact_stiffness(experiment.young_modulus)
    bond = made.bond_normal_ratio, made.bond_tangential_ratio
    damped = bond if made.bond_viscosity_follows else (1.0, 1.0)
    sizes = sorted(set(discs.radius_n.tolist()), reverse=True)
    overall, outer = run.moduli("overall"), run.moduli("external")
    high = "discarded" if how.no_spanning else "allowed"
    return [
        *_about_bonds(how),
        f"\tN={discs.discs} spheres, nominal packing density = {_plain(experiment.packing_fraction)}",
        f"\tYoung modulus of the individual spheres = {_plain(experiment.young_modulus)} Pa",
        f"\tFriction coefficient = {_plain(experiment.friction_coefficient)}",
        "",
        "Function call :",
        _call(run, how),
        f"\tbaseline_pre_periods = {_plain(experiment.pre_periods)}",
        f"\tbaseline_post_periods = {_plain(experiment.post_periods)}",
        f"\trunSimulation(periods={_plain(experiment.periods)}, cool_factor={_plain(experiment.cooling)})",
        "",
        "Oscillatory shear experiment",
        "",
        "Model parameters",
        f"Width of simulation area size_x = {_plain(discs.width)}micrometers",
        f"Height of simulation area size_y = {_plain(discs.height)}micrometers",
        f"Nominal packing fraction = {_plain(experiment.packing_fraction)}",
        f"Young modulus spheres = {_plain(experiment.young_modulus)}Pa",
        f"Relative density spheres = {_plain(experiment.density)}kg/m^3",
        f"Characteristic time constant = {_plain(experiment.tau)}s",
        f"Characteristic spring constant = {_plain(stiffness)}mg/s^2",
        f"Characteristic viscosity = {_plain(contact_viscosity(experiment.mass, stiffness, relative=1.0))}mg/s",
        "",
        "Ensemble parameters",
        f"Particle mass m = {_plain(experiment.mass)}mg",
        f"Central spring constant k = {_plain(made.stiffness)}mg*s^(-2)",
        f"Central viscosity constant nu = {_plain(made.viscosity)}mg*s^(-1)",
        f"Lateral spring constant k_t = {_plain(made.tangential_stiffness)}mg*s^(-2)",
        f"Lateral viscosity constant nu_t = {_plain(made.tangential_viscosity)}mg*s^(-1)",
        f"Friction coefficient mu = {_plain(made.friction_coefficient)}",
        f"Sample width = {_plain(discs.width)}micrometers",
        f"Sample height = Gap height = {_plain(discs.height)}micrometers",
        f"Particle number = {discs.discs}",
        "Radii = " + " ".join(_plain(size) for size in sizes[:8]) + "micrometers",
        f"Nonlinear enhancement for repulsion near sphere center = {_plain(experiment.divergence)}[-]",
        *_about_law(experiment),
        f"Adjustment coefficient for central force in permanent links = {_plain(bond[0])}[-]",
        f"\tk_permanent={_plain(made.stiffness * bond[0])}mg*s^(-2)",
        f"Adjustment coefficient for tangential force in permanent links = {_plain(bond[1])}[-]",
        f"\tk_t_permanent={_plain(made.tangential_stiffness * bond[1])}mg*s^(-2)",
        f"\tnu_permanent={_plain(made.viscosity * damped[0])}mg*s^(-1)",
        f"\tnu_t_permanent={_plain(made.tangential_viscosity * damped[1])}mg*s^(-1)",
        f"avoid_height_spanning_particles: Ensembles with full height spanning particles {high}",
        f"Actual fraction of randomly removed non-essential permanent bonds = {_plain(how.removed)}[-]",
        f"Edge fuzziness for creating interlocking = {_plain(how.edge_fuzziness)}[-]",
        "",
        "Rheology experiment information",
        f"Simulated time = {_plain(run.final.time)}s",
        f"Time step = {_plain(experiment.time_step)}s",
        f"Frequency = {_plain(experiment.frequency)}Hz",
        f"Strain amplitude = {_plain(100.0 * experiment.amplitude)}%",
        f"Damping factor = {_plain(experiment.rules.cooling)} [1 = no damping]",
        f"Pre-measurement periods = {_plain(experiment.pre_periods)} [-]",
        f"Oscillatory shear periods = {_plain(experiment.periods)} [-]",
        f"Post-measurement periods = {_plain(experiment.post_periods)} [-]",
        "",
        "Output data",
        "Summary data",
        f"In phase stress = {_plain(overall.in_phase)}Pa",
        f"Out of phase stress = {_plain(overall.out_of_phase)}Pa",
        f"Stress = {_plain(np.hypot(overall.in_phase, overall.out_of_phase))}Pa",
        f"G'={_plain(overall.storage)}Pa",
        f"G''={_plain(overall.loss)}Pa",
        f"G'(by surface force)={_plain(outer.storage)}Pa",
        f"G''(by surface force)={_plain(outer.loss)}Pa",
        "",
    ]


def write_text(
    run: ParticleShearRun, folder: str | pathlib.Path, *, preparation: Preparation | None = None, tensors: bool = True
) -> pathlib.Path:
    """Return the path of the text file written, named by what was run and the first number that is free.

    Parameters
    ----------
    run
        The experiment's result.
    folder
        An existing folder.
    preparation
        How the discs were bonded, where they do not say so themselves (`ShearedDiscs.preparation`); discs without
        bonds need none.
    tensors
        Whether to write the series of all tensors besides the header.

    Raises
    ------
    NotADirectoryError
        If there is no such folder.
    ValueError
        If it is not known how the discs were bonded, or what is said of it is not so.

    Examples
    --------
    >>> import tempfile
    >>> from packmech.validation.particle_shear import ParticleShear, prepared_discs
    >>> experiment = ParticleShear(particles=20, pre_periods=0.1, periods=0.1, post_periods=0.1)
    >>> run = experiment.run(prepared_discs(experiment, seed=1, centers=0, steps=5))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = write_text(run, folder)
    ...     found = read_text(path)
    >>> path.name, len(found.time_t) == experiment.steps
    ('dermal_filler_bulk0.01_f_1447.2025_strain_0.2_nr_1.txt', True)

    """
    check.instance("run", run, ParticleShearRun)
    how = _preparation(run.start, preparation)
    check.boolean("tensors", tensors)
    place = pathlib.Path(folder)
    if not place.is_dir():
        raise NotADirectoryError(f"folder must be an existing folder, got {place}")
    experiment = run.experiment
    stem = (
        f"dermal_filler{how.kind}{_plain(experiment.friction_coefficient)}_f_{_plain(round(experiment.frequency, 4))}"
    )
    stem += f"_strain_{_plain(round(experiment.amplitude, 5))}_nr_"
    number = 1
    while (place / f"{stem}{number}.txt").exists():
        number += 1
    lines = _header(run, how)
    if tensors:
        lines += [_START, "\t".join(HEADINGS)]
        lines += ["\t".join([str(index), *map(repr, row)]) for index, row in enumerate(_rows(run).tolist())]
    path = place / f"{stem}{number}.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _preparation(discs: ShearedDiscs, given: Preparation | None) -> Preparation:
    """Return how discs were bonded, after holding what is given against what is known of them."""
    if given is not None:
        check.instance("preparation", given, Preparation)
    bonded = bool(discs.bonded_c.any())
    how = discs.preparation if given is None else given
    if how is None:
        if bonded:
            raise ValueError("preparation must be given where bonded discs do not say how they were bonded, got None")
        how = Preparation(bonded=False)
    if discs.preparation not in (None, how):
        raise ValueError(f"preparation must be that of the discs, {discs.preparation}, got {given}")
    if how.bonded != bonded:
        raise ValueError(f"preparation must say bonded={bonded} as the discs are, got bonded={how.bonded}")
    return how


def _rows(run: ParticleShearRun) -> NDArray[np.float64]:
    series = run.series
    columns = [series.time_t, series.strain_t, series.strain_rate_t]
    columns += [run.shear_stress("external"), run.shear_stress("overall")]
    order = [STRESSES.index(name) for name in COLUMNS]
    return np.concatenate([np.stack(columns, axis=1), series.stress_tsdd[:, order].reshape(len(series.time_t), -1)], 1)


@dataclasses.dataclass(frozen=True, eq=False)
class TextData:
    """What a text file of the package holds.

    Attributes
    ----------
    header
        Lines before the series.
    time_t, strain_t, strain_rate_t
        [s], [1], [1/s].
    stresses
        (T, 2, 2) tensors by our names [Pa].

    """

    header: tuple[str, ...]
    time_t: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    strain_rate_t: NDArray[np.float64]
    stresses: dict[str, NDArray[np.float64]]

    def number(self, label: str) -> float:
        """Return the number that the header gives right after this label, such as "G'=" or "Time step = ".

        Raises
        ------
        KeyError
            If no line of the header has the label with a number after it.

        """
        pattern = re.compile(re.escape(label) + r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)")
        for line in self.header:
            found = pattern.search(line)
            if found:
                return float(found.group(1))
        raise KeyError(f"label must be in the header with a number after it, got {brief(label)}")


def read_text(path: str | pathlib.Path) -> TextData:
    """Return what a text file says, of ours or of the package; one without series has none of length above 0.

    Raises
    ------
    ValueError
        If the series lacks a column or has a line of another length, naming the line.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "a.txt"
    ...     _ = path.write_text("G'=120.5Pa")
    ...     read_text(path).number("G'=")
    120.5

    """
    lines = pathlib.Path(path).read_text(encoding="utf-8").splitlines()
    starts = [n for n, line in enumerate(lines) if line.strip() == _START]
    if not starts:
        empty = np.empty(0)
        return TextData(tuple(lines), empty, empty, empty, {name: np.empty((0, 2, 2)) for name in COLUMNS})
    head = starts[0]
    names = lines[head + 1].split() if head + 1 < len(lines) else []
    missing = [name for name in HEADINGS if name not in names]
    if missing:
        raise ValueError(f"the series must have the column {missing[0]}, got {len(names)} columns without it in {path}")
    rows = []
    for n, line in enumerate(lines[head + 2 :], start=head + 3):
        if line.strip():
            fields = line.split()
            if len(fields) != len(names):
                raise ValueError(f"line {n} must have {len(names)} columns, got {len(fields)} in {path}")
            rows.append([float(field) for field in fields])
    table = np.array(rows).reshape(len(rows), len(names))
    column = {name: table[:, k] for k, name in enumerate(names)}
    stresses = {
        ours: np.stack([column[f"stress_tensor_{theirs}_{e}"] for e in ("00", "01", "10", "11")], 1).reshape(-1, 2, 2)
        for ours, theirs in COLUMNS.items()
    }
    return TextData(tuple(lines[:head]), column["t"], column["strain"], column["strain_rate"], stresses)
