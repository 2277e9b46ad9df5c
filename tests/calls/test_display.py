"""Facts about how results are shown: short at a prompt, whole in a notebook's table, never an array in full."""

import dataclasses
import inspect
import math
import re

import numpy as np
import pytest

import packmech as pm
from packmech.calls.display import LETTERS, LINES, as_text, in_words, shown, value_with_error

LONGEST = 1500


@pytest.fixture(scope="module")
def results():
    start = pm.random_packing(512, dimension=2, packing_fraction=0.9, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(), pm.Friction(0.3)))
    run = pm.quench(scene.without(pm.Friction), force_tolerance=1e-9)
    at_rest = scene.without(pm.Friction).replace(packing=run.packing)
    chains = pm.chain_packing(20, 20, dimension=2, packing_fraction=0.4, seed=1)
    ellipses = pm.random_packing(300, dimension=2, packing_fraction=0.5, seed=1, shapes=pm.Ellipses(1.5))
    bodies = pm.random_packing(300, dimension=2, packing_fraction=0.5, seed=1, shapes=pm.Dimer())
    return {
        "run": run,
        "scene": at_rest,
        "packing": run.packing,
        "contacts": pm.find_contacts(run.packing),
        "forces": pm.contact_forces(at_rest),
        "moduli": pm.elastic_moduli(at_rest),
        "modes": pm.normal_modes(at_rest, 5),
        "verdict": pm.classify_jamming(run.packing),
        "stress states": pm.states_of_self_stress(run.packing),
        "links": chains.links,
        "linked": chains,
        "spheroids": ellipses.shapes,
        "beads": bodies.shapes,
        "bonds": pm.bond_contacts(run.packing),
        "bonded scene": at_rest.replace(effects=(*at_rest.effects, pm.bond_contacts(run.packing))),
        "held": pm.FixedParticles(tuple(range(0, 512, 2))),
        "g(r)": pm.pair_distribution(run.packing, r_max=4.0, bins=200),
        "states": pm.density_of_states(at_rest),
        "counts": pm.count_modes(at_rest, np.linspace(0.0, 2.0, 9)),
    }  # fmt: skip


def test_no_repr_is_longer_than_a_dozen_lines(results):
    for name, one in results.items():
        text = repr(one)
        assert len(text) <= LONGEST, name
        assert len(text.splitlines()) <= LINES, name


def test_every_public_record_with_arrays_is_shown_by_its_own_repr():
    small = {"Box", "Cluster"}  # d x d numbers, and beads written by hand
    written_by_dataclasses = []
    for name in pm.__all__:
        cls = getattr(pm, name)
        if not (inspect.isclass(cls) and dataclasses.is_dataclass(cls)):
            continue
        arrays = any("NDArray" in str(one.type) for one in dataclasses.fields(cls))
        if name not in small and arrays and hasattr(cls.__repr__, "__wrapped__"):
            written_by_dataclasses.append(name)
    assert written_by_dataclasses == []


def test_the_first_line_of_a_run_says_how_it_ended_and_what_it_cost(results):
    first = repr(results["run"]).splitlines()[0]
    assert re.match(r"<packmech.Run> 512 discs: converged, residual \d\.\de-\d+, \d+ steps, [\d.e-]+ CPU s$", first)


def test_a_run_that_failed_says_what_to_change_in_its_second_line(results):
    failed = pm.quench(results["scene"].replace(packing=pm.random_packing(
        64, dimension=2, packing_fraction=0.9, seed=2)), force_tolerance=1e-12, step_limit=3, check=False)  # fmt: skip
    assert "raise step_limit or loosen the tolerance" in repr(failed).splitlines()[1]


def test_a_notebook_s_table_names_every_field_with_its_meaning_and_escapes_what_is_no_html(results):
    page = results["moduli"]._repr_html_()
    for field in dataclasses.fields(pm.Moduli):
        if getattr(results["moduli"], field.name) is not None:
            assert f"<b>{field.name}</b>" in page
    assert "<packmech" not in page


def test_a_notebook_shows_a_picture_of_what_can_be_seen(results):
    assert "<svg" in results["run"]._repr_html_()
    assert "<svg" in results["g(r)"]._repr_html_()
    assert "<svg" not in results["contacts"]._repr_html_()


def test_units_stand_beside_the_values_that_have_one():
    @shown()
    @dataclasses.dataclass(frozen=True)
    class Pendulum:
        """A pendulum.

        Attributes
        ----------
        length
            Of the rod [length].
        swings
            How many.

        """

        length: float
        swings: int

    assert repr(Pendulum(0.25, 3)) == "<packmech.Pendulum>\n  length  0.25  [length]\n  swings  3"
    assert "Of the rod" in Pendulum(0.25, 3)._repr_html_()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.zeros((0, 2)), "[]"),
        (np.arange(3), "[0, 1, 2]"),
        (np.full((50, 2), 2.0), "(50, 2) array, all 2"),
        (np.array([np.nan] * 9), "(9,) array"),
        (np.r_[np.nan, np.arange(9.0)], "(10,) array, 0 to 8"),
        (np.ones(20, dtype=bool), "(20,) array, 20 true"),
        ((1.0, 2.0), "(1, 2)"),
        ([pm.Fire()] * 20, "20 of Fire"),
        ({"a": 1, "b": 2}, "2 of: a, b"),
        ("x" * 500, "x" * (LETTERS - 3) + "..."),
    ],
)
def test_a_value_is_one_short_line(value, words):
    assert in_words(value) == words


@pytest.mark.parametrize(
    ("value", "error", "words"),
    [
        (0.84543, 0.0007, "0.8454 +- 0.0007"),
        (0.84543, 0.00096, "0.8454 +- 0.0010"),
        (-0.704, 0.02, "-0.704 +- 0.020"),
        (12345.6, 30.0, "12346 +- 30"),
        (12345.6, 1234.5, "12300 +- 1200"),
        (3.5, 1.66, "3.5 +- 1.7"),
        (3.5, 3.54, "3.5 +- 3.5"),
        (3.5, 3.55, "4 +- 4"),
        (0.5, 1e-16, "0.5 +- 1e-16"),
        (0.0, 5e-324, "0 +- 5e-324"),
        (3e-9, 2e-10, "3.00e-09 +- 2.0e-10"),
        (5e7, 3e5, "5.000e+07 +- 3.0e+05"),
        (1234567.0, 9.6e4, "1.23e+06 +- 1.0e+05"),
        (3e-9, 9.6e-10, "3.0e-09 +- 1.0e-09"),
        (5e7, 4e5, "5.00e+07 +- 4e+05"),
        (2.0, 1e9, "2e+00 +- 1.0e+09"),
        (0.0, 2e-6, "0e+00 +- 2.0e-06"),
        (0.5, math.nan, "0.5"),
        (0.5, 0.0, "0.5 +- 0"),
        (-0.01, 0.4, "0.0 +- 0.4"),
    ],
)
def test_a_value_is_written_to_the_digit_of_its_error(value, error, words):
    assert value_with_error(value, error) == words


def test_empty_fields_and_signs_of_zeros_are_left_out():
    @shown()
    @dataclasses.dataclass(frozen=True)
    class Shear:
        """A shear."""

        strain: float = -0.0
        stress_d: np.ndarray = dataclasses.field(default_factory=lambda: np.array([-0.0, 1.0]))
        soft: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 2)))
        words: tuple[str, ...] = ("", "free", "")
        note: str = ""
        added: dict[str, float] = dataclasses.field(default_factory=dict)

    assert repr(Shear()) == "<packmech.Shear>\n  strain    0\n  stress_d  [0, 1]\n  words     (free)"
    assert "<b>note</b>" in Shear()._repr_html_() and ">-0<" not in Shear()._repr_html_()
    rows = tuple((name, "-0.000", "") for name in ("", *"abcdefghijklm"))
    assert as_text("Run", "-0", [*rows[1:], rows[0], rows[0]]).splitlines() == [
        "<packmech.Run> 0", *(f"  {name}  0.000" for name in "abcdefghij"), "  and k, l, m"
    ]  # fmt: skip
    assert "-0" not in str(pm.result.Summary("shear", rows, ()))


def test_modes_and_moduli_name_their_lowest_frequencies_and_their_unit(results):
    first = repr(results["modes"]).splitlines()[0]
    shown = re.fullmatch(r"<packmech.Modes> 5 modes, frequencies (.*) \[1/time\]", first)
    assert [float(one) for one in shown[1].split(", ")] == pytest.approx(results["modes"].frequency_m, rel=1e-4)
    assert repr(results["moduli"]).splitlines()[0].endswith("[energy/length^2]")


def test_a_verdict_shows_its_pairs_and_its_balance_in_words():
    crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=1e-6)
    shown = pm.classify_jamming(pm.Scene(crystal, (pm.Repulsion(),)))._repr_html_()
    assert "48 pairs, gaps up to" in shown and "at rest: net forces up to" in shown
    assert "RestCheck(" not in shown and "ContactSelection(" not in shown
