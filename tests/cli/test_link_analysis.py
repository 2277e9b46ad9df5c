"""Facts about `packmech analyze` on packings with rigid links: the numbers are those of the library."""

import contextlib
import io
import json
import pathlib
import sys

import numpy as np
import pytest

import packmech as pm
from packmech.cli import main

GOLDEN = pathlib.Path(__file__).parents[1] / "golden"


def stored(name):
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    links = pm.Links(*([link[key] for link in data["links"]] for key in ("i", "j", "z", "length")))
    return pm.Packing(data["positions"], data["radii"], pm.Box(data["lattice_columns"]), links), data


def analyzed(packing, folder):
    """Return what the command prints about the packing, in one line, and the numbers that it writes."""
    pm.write_packing(packing, folder / "linked.npz")
    out, argv = io.StringIO(), sys.argv
    sys.argv = ["packmech", "analyze", "linked.npz", "--json", "numbers.json"]
    try:
        with contextlib.chdir(folder), contextlib.redirect_stdout(out):
            with contextlib.suppress(SystemExit):
                main()
    finally:
        sys.argv = argv
    return " ".join(out.getvalue().split()), json.loads((folder / "numbers.json").read_text())


@pytest.mark.parametrize("name", ["jammed_trimer_fixedbox", "jammed_dimer_strain"])
def test_analyze_tells_counts_verdict_moduli_and_modes_of_the_library(name, tmp_path):
    packing, data = stored(name)
    _, numbers = analyzed(packing, tmp_path)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    verdict = pm.classify_jamming(scene)
    rattling = data.get("rattling_particles", [])
    assert (numbers["rattlers"], numbers["danglers"]) == (len(rattling), len(rattling))
    assert numbers["contacts"] == len(data["contacts"])
    assert numbers["isostatic_contacts"] == verdict.collectively.isostatic_contacts
    assert numbers["backbone_links"] == verdict.backbone_links == {7: 7, 15: 9}[len(packing.links)]
    assert (numbers["collective"], numbers["strict"]) == (verdict.collective, verdict.strict)
    assert numbers["first_order_jammed"] == verdict.first_order_jammed
    assert numbers["collective_states_of_self_stress"] == verdict.states_of_self_stress["none"]
    moduli = pm.elastic_moduli(scene)
    assert numbers["bulk_modulus"] == pytest.approx(moduli.bulk_modulus / scene.pressure_unit, rel=1e-9)
    unit = np.sqrt(scene.energy_scale / packing.mass_n.mean()) / packing.reference_diameter
    assert np.allclose(numbers["lowest_frequencies"], pm.normal_modes(scene, 10).frequency_m / unit, atol=1e-7)


def test_analyze_says_which_particles_count_and_what_the_links_take_off(tmp_path):
    printed, _ = analyzed(stored("jammed_trimer_fixedbox")[0], tmp_path)
    assert "isostatic: 12 = " in printed and "; 1 state of self stress" in printed
    assert "26.7% of 15 particles; 4 held by their clusters alone, 0 clusters rattle as a whole" in printed


def test_analyze_of_an_all_rattling_packing_names_the_empty_backbone(tmp_path):
    packing, _ = stored("jammed_trimer_fixedbox")
    printed, numbers = analyzed(packing.replace(radius_n=0.5 * packing.radius_n), tmp_path)
    assert "collectively jammed not jammed box fixed; empty backbone: every particle rattles" in printed
    assert (numbers["rattlers"], numbers["rattling_clusters"], numbers["contacts"]) == (15, 5, 0)
