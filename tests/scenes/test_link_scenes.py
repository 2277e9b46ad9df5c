"""Facts about the shipped scenes with rigid links, and about the drive that relaxes positions and strains."""

import json

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute
from packmech.contacts.excluded import rigid_clusters

LINKED = ["chain-of-thirty", "crossing-dimers", "fifty-trimers-2d", "fifty-trimers-3d", "flexible-chains-3d"]


def clusters(name):
    packing = pm.read_scene(name).packing
    return np.bincount(packing.links.clusters(packing.particles))


def examined(name, folder):
    """Run a scene as the command does; its exit code and the numbers that it writes."""
    files = {"--record": folder / "run.rrd", "--out": folder / "end.npz", "--json": folder / "end.json"}
    words = [word for option, path in files.items() for word in (option, str(path))]
    code = execute(["run", str(name), *words, "--modes", "2"])
    return code, json.loads((folder / "end.json").read_text()), pm.read_packing(folder / "end.npz")


def test_every_shipped_scene_with_links_is_known_here():
    assert LINKED == sorted(name for name in pm.list_scenes() if pm.read_scene(name).packing.links)


@pytest.mark.parametrize("dimension", [2, 3])
def test_fifty_trimers_are_rigid_and_every_one_has_an_angle_of_its_own(dimension):
    packing = pm.read_scene(f"fifty-trimers-{dimension}d").packing
    assert packing.dimension == dimension
    assert clusters(f"fifty-trimers-{dimension}d").tolist() == [3] * 50
    assert rigid_clusters(packing).all()
    angle = 2.0 * np.arcsin(0.5 * packing.links.length_l[packing.links.shape_l])
    assert len(np.unique(angle)) == 50
    assert angle.min() >= 1.1
    assert angle.max() <= 2.8
    assert np.std(angle) > 0.3


def test_trimers_and_the_chain_in_a_plane_start_without_crossing_bonds():
    for name in ("fifty-trimers-2d", "chain-of-thirty"):
        assert len(pm.crossing_links(pm.read_scene(name).packing)) == 0


def test_chains_are_flexible_and_as_many_as_they_say():
    assert clusters("chain-of-thirty").tolist() == [30]
    assert clusters("flexible-chains-3d").tolist() == [10] * 12
    for name in ("chain-of-thirty", "flexible-chains-3d"):
        packing = pm.read_scene(name).packing
        assert not packing.links.shape_l.any()
        assert not rigid_clusters(packing).any()


def test_two_crossed_dimers_stay_crossed_in_force_balance_at_an_overlap_beyond_the_bound(tmp_path):
    """Two crossing bonds of one diameter have ends nearer than 1/sqrt(2) of it: relative overlap 0.29 and more."""
    code, numbers, packing = examined("crossing-dimers", tmp_path)
    assert code == 0
    assert len(pm.crossing_links(pm.read_scene("crossing-dimers").packing)) == 1
    assert numbers["crossing_links"] == len(pm.crossing_links(packing)) == 1
    assert numbers["force_residual"] < 1e-10
    assert pm.find_contacts(packing).overlap_c.max() >= 1.0 - 0.5**0.5


def test_a_chain_of_thirty_comes_to_rest_with_an_end_that_touches_nothing(tmp_path):
    code, numbers, packing = examined("chain-of-thirty", tmp_path)
    assert code == 0
    assert numbers["pressure"] == pytest.approx(1e-4, rel=1e-8)
    assert numbers["crossing_links"] == 0
    assert numbers["link_error"] < 1e-13
    assert np.flatnonzero(pm.find_rattling_clusters(packing).dangling_n).tolist() == [0]
    # 29 beads, 28 links between them, every strain free
    assert numbers["isostatic_contacts"] == 2 * 29 - 2 + 3 - 28


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "pressure"), [("fifty-trimers-2d", 1e-6), ("fifty-trimers-3d", 1e-6), ("flexible-chains-3d", 1e-6)]
)
def test_scenes_with_links_run_to_balance_at_their_pressure(tmp_path, name, pressure):
    code, numbers, packing = examined(name, tmp_path)
    assert code == 0
    assert numbers["force_residual"] < 1e-8
    assert numbers["pressure"] == pytest.approx(pressure, rel=1e-8)
    assert numbers["link_error"] < 1e-13
    assert packing.link_error < 1e-13
    stress = np.array(numbers["stress"])
    assert np.abs(stress + numbers["pressure"] * np.eye(packing.dimension)).max() < 1e-8 * numbers["pressure"]
    if pressure == 1e-6:
        assert numbers["strict"] == "jammed"
        assert numbers["contacts"] == numbers["isostatic_contacts"]


def test_the_drive_relaxes_at_the_volume_as_it_is_unless_told_a_pressure(tmp_path):
    text = """
effects = [{ kind = "repulsion", law = "harmonic" }]
[packing]
kind = "clusters"
count = 8
packing_fraction = 0.95
seed = 1
shape = { kind = "trimer", angle = [1.1, 2.8] }
[drive]
kind = "shear-stabilize"
force_tolerance = 1e-8
"""
    (tmp_path / "held.toml").write_text(text)
    code, numbers, packing = examined(tmp_path / "held.toml", tmp_path)
    assert code == 0
    assert numbers["packing_fraction"] == pytest.approx(0.95, rel=1e-13)
    assert numbers["strain"] == "free"
    assert pm.stress_tensor(pm.Scene(packing, (pm.Repulsion(),)))[0, 1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("arguments", [{"pressure": 0.0}, {"pressure": "1"}, {"force_tolerance": 0.0}])
def test_a_drive_with_a_wrong_number_is_refused_by_its_field(arguments):
    with pytest.raises((TypeError, ValueError), match=f"^drive.{next(iter(arguments))} must"):
        pm.ShearStabilizeDrive(**arguments)


def test_the_cementing_scene_starts_at_one_state_of_self_stress_and_says_what_pm_cement_says(tmp_path):
    code, numbers, packing = examined("cementing", tmp_path)
    assert code == 0
    means = numbers["cementing"]
    assert means["states_of_self_stress"] == 1
    assert len(means["first_stiff"]) == 5
    alone = pm.cement(pm.Scene(packing, (pm.Repulsion(),)), seed=2)
    assert means["first_stiff"][2] == alone.first_stiff / 64
    assert means["all_stiff"][2] == alone.all_stiff / 64
    for name in ("bulk_modulus", "shear_modulus"):
        reuss, voigt = (np.array(means[f"{name}_{bound}"]) for bound in ("reuss", "voigt"))
        assert np.all(np.diff(reuss) > 0)
        assert np.all(voigt >= reuss * (1 - 1e-12))


@pytest.mark.parametrize("arguments", [{"pressure": 0.0}, {"orders": 0}, {"seed": -1}, {"step": 0.0}, {"freeze": "no"}])
def test_cementing_with_a_wrong_number_is_refused_by_its_field(arguments):
    with pytest.raises((TypeError, ValueError), match=f"^drive.{next(iter(arguments))} must"):
        pm.CementDrive(**arguments)
