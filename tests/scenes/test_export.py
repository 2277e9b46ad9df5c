"""Facts about scenes for other programs: these find the energy and pressure that packmech finds."""

import math
import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec

import pytest
from peer_programs import lammps

import packmech as pm
from packmech import cli
from packmech.scenes.export import PROGRAMS

LAWS = [
    pm.Harmonic(2.0),
    pm.Hertz(0.7),
    pm.PowerLaw(1.5, 3.0),
    pm.PowerLaw(1.5, 1.75),
    pm.LinearSpring(3.0),
    pm.RepulsiveLennardJones(0.7),
    pm.ElasticSpheres(2.0),
]


def scene(law=LAWS[0], dimension=2, effects=()):
    """Return a scene of 120 particles that overlap but little."""
    start = pm.random_packing(120, dimension=dimension, packing_fraction={2: 0.95, 3: 0.75}[dimension], seed=3)
    packing = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-2, check=False).packing
    return pm.Scene(packing, (pm.Repulsion(law), *effects))


def springs(packing):
    """Return linear springs along the contacts of a packing, stretched."""
    law = pm.LinearSpring(4.0)
    made = pm.bond_contacts(packing, compression=law, tension=law, tangential_stiffness=0.0)
    return replace(made, rest_length_b=0.98 * made.rest_length_b)


def scenes():
    """Return a scene of every law in two dimensions and in three, and those of other parts."""
    for dimension in (2, 3):
        for law in LAWS:
            yield scene(law, dimension)
    plain = scene()
    yield scene(effects=(springs(plain.packing),))
    yield scene(effects=(pm.FixedParticles(tuple(range(40))),))
    box = plain.packing.box.strained([[0.02, 0.4], [0.1, 0.0]])
    yield plain.replace(packing=plain.packing.replace(box=box))


@pytest.mark.parametrize("k", range(2 * len(LAWS) + 3))
def test_lammps_finds_the_energy_and_the_pressure(tmp_path, monkeypatch, k):
    given = list(scenes())[k]
    export = pm.export_scene(given, tmp_path / "there", to="lammps")
    peer = lammps()
    monkeypatch.chdir(export.script.parent)
    peer.file(export.script.name)
    found = peer.get_thermo("pe"), peer.get_thermo("press")
    peer.close()
    assert found == pytest.approx((pm.energy(given), pm.pressure(given)), rel=1e-12)


@pytest.mark.skipif(find_spec("jax_md") is None, reason="JAX MD is not there")
@pytest.mark.parametrize("k", range(2 * len(LAWS) + 3))
def test_jax_md_finds_the_energy_and_the_pressure(tmp_path, k):
    given = list(scenes())[k]
    export = pm.export_scene(given, tmp_path, to="jax-md")
    said = subprocess.run([sys.executable, export.script], check=True, capture_output=True, text=True).stdout
    number = r"-?\d[-+.e\d]*"
    energy, own, pressure, own_pressure = map(float, re.findall(number, said))
    assert (own, own_pressure) == (export.energy, export.pressure) == (pm.energy(given), pm.pressure(given))
    assert (energy, pressure) == pytest.approx((own, own_pressure), rel=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_the_formulas_written_are_the_laws(tmp_path, law):
    # of one size, so that a formula has one pair of radii
    export = pm.export_scene(
        pm.Scene(pm.lattice_packing("square", repeats=(4, 4)), (pm.Repulsion(law),)), tmp_path, to="lammps"
    )
    formula = re.search(r"step\(sigma - r\)\*\((.*)\); sigma", export.script.read_text())[1].replace("^", "**")
    for r in (0.3, 0.9, 0.999999):
        radii = {"r": r, "sigma": 1.0, "R": 0.25, "sqrt": math.sqrt, "abs": abs}
        pair = pm.Packing([[1.0, 1.0], [1.0 + r, 1.0]], [0.5, 0.5], pm.Box.cubic(5.0, 2))
        # the sum of the same digits, but for the rounding of the overlap
        bound = 1e-15 / (1.0 - r) + 1e-15
        assert eval(formula, radii) == pytest.approx(pm.energy(pm.Scene(pair, (pm.Repulsion(law),))), rel=10.0 * bound)  # noqa: S307


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_other_programs_have_no_place_for_is_refused_by_name(tmp_path, program):
    plain = scene()
    packing = plain.packing
    sheared = pm.bond_contacts(packing)

    def refused(words, given):
        with pytest.raises((ValueError, TypeError), match=words):
            pm.export_scene(given, tmp_path, to=program)

    refused("ContactDamping", scene(effects=(pm.ContactDamping(0.1),)))
    refused("Friction", scene(effects=(pm.Friction(0.5),)))
    refused("Gravity", scene(effects=(pm.Gravity(),)))
    refused("springs|tangential", scene(effects=(sheared,)))
    ellipses = pm.random_packing(20, dimension=2, packing_fraction=0.8, shapes=pm.Ellipses(1.5), seed=1)
    refused("shapes", pm.Scene(ellipses, (pm.Repulsion(),)))
    table = pm.LawByKind([[pm.Harmonic(1.0), pm.Harmonic(5.0)], [pm.Harmonic(5.0), pm.Harmonic(2.0)]])
    refused("repel by one of", pm.Scene(pm.assign_kinds(packing, [0.5, 0.5], seed=1), (pm.Repulsion(table),)))
    assert not any(tmp_path.iterdir())


def test_jax_md_is_not_given_boxes_in_which_pairs_touch_twice(tmp_path):
    narrow = pm.Scene(pm.lattice_packing("square", repeats=(1, 8)), (pm.Repulsion(),))
    with pytest.raises(ValueError, match="at least two diameters across"):
        pm.export_scene(narrow, tmp_path, to="jax-md")
    assert pm.export_scene(narrow, tmp_path, to="lammps").energy == pm.energy(narrow)


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_command_writes_a_scene_and_says_what_to_expect(tmp_path, capsys, program):
    plain = scene()
    pm.write_scene(plain, tmp_path / "plain.toml")
    assert cli.execute(("export", str(tmp_path / "plain.toml"), "--as", program, "--out", str(tmp_path / "there"))) == 0
    assert f"energy {pm.energy(plain):.16g}, pressure {pm.pressure(plain):.16g}" in capsys.readouterr().out
    assert len(list((tmp_path / "there").iterdir())) == 2


def test_bonded_pairs_that_touch_by_another_image_are_no_input_of_lammps(tmp_path):
    pair = pm.Packing([[0.5, 0.9], [1.4, 0.9]], 0.46, pm.Box.cubic(1.8, 2))
    bond = pm.Bonds([0], [1], [[0, 0]], [0.8], tangential_stiffness=0.0)
    with pytest.raises(ValueError, match="bonded pair that touches by another image for LAMMPS, got 0-1"):
        pm.export_scene(pm.Scene(pair, (pm.Repulsion(), bond)), tmp_path, to="lammps")
