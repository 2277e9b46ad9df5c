"""Members: names as signac gives them, seeds that do not depend on each other, grids and parts."""

import hashlib
import json

import numpy as np
import pytest

from packmech.ensemble import folder
from packmech.ensemble.members import flattened, member_of, members_of, part_of, state_point_text, values_in


def test_the_name_of_a_member_is_the_md5_of_its_sorted_state_point():
    one = member_of({"seed": 3, "effects.friction.coefficient": np.float64(0.1), "drive.pressure": 1e-3})
    point = {"drive": {"pressure": 0.001}, "effects": {"friction": {"coefficient": 0.1}}, "seed": 3}
    assert json.loads(state_point_text(one.parameters)) == point
    assert one.id == hashlib.md5(json.dumps(point, sort_keys=True).encode()).hexdigest()
    assert flattened(point) == one.parameters


def test_the_name_does_not_depend_on_the_order_of_the_parameters():
    assert member_of({"a": 1, "b": 2}).id == member_of({"b": 2, "a": 1}).id


def test_random_seeds_of_a_grid_all_differ_and_are_spread_evenly():
    seeds = np.array([one.random_seed for one in members_of({"mu": [0.0, 0.1], "seed": range(1000)})], dtype=float)
    assert len(set(seeds.tolist())) == 2000
    share = seeds / 2.0**63
    # mean and variance of uniform numbers, four standard errors
    assert abs(share.mean() - 0.5) < 4.0 / np.sqrt(12.0 * 2000)
    assert abs(np.corrcoef(share[:1000], share[1000:])[0, 1]) < 4.0 / np.sqrt(1000)


def test_a_grid_is_every_combination_the_last_parameter_fastest():
    found = [tuple(one.parameters.values()) for one in members_of({"n": (8, 16), "mu": 0.5, "seed": range(2)})]
    assert found == [(8, 0.5, 0), (8, 0.5, 1), (16, 0.5, 0), (16, 0.5, 1)]
    assert len(members_of([{"n": 8, "seed": [0, 1]}, {"n": 16, "seed": [5]}])) == 3


@pytest.mark.parametrize(
    ("grid", "words"),
    [
        ({}, "tables of values"),
        ({"a": []}, "at least one member"),
        ({"a": [1, 1]}, "each member once"),
        ({"a": 1, "a.b": 2}, "a value and what lies in it"),
        ({"a.b": 2, "a": 1}, "a value and what lies in it"),
        ({"a b": 1}, "by words"),
        ({"a": float("nan")}, "finite"),
        ({"a": [object()]}, "number"),
        ("seed", "table of values"),
    ],
)
def test_a_grid_that_is_none_is_refused(grid, words):
    with pytest.raises((TypeError, ValueError), match=words):
        members_of(grid)


def test_parts_are_disjoint_and_together_all():
    members = members_of({"seed": range(100)})
    parts = [part_of(members, f"{k}/3") for k in (1, 2, 3)]
    names = [one.id for part in parts for one in part]
    assert sorted(names) == sorted(one.id for one in members)
    assert len(set(names)) == 100
    for wrong in ("0/3", "4/3", "3", "a/b"):
        with pytest.raises(ValueError, match="K/N"):
            part_of(members, wrong)


def test_values_of_the_command_line():
    assert values_in("0.01:1:3:log") == [0.01, 0.1, 1.0]
    assert values_in("1,2,true,bulk") == [1, 2, True, "bulk"]
    assert values_in("5:7") == [5, 6]
    for wrong in ("", "5:5", "1:2:x:log", "0:1:5:log", "1:2:3"):
        with pytest.raises(ValueError, match="FIRST:END"):
            values_in(wrong)


def test_a_folder_that_another_process_makes_meanwhile_is_the_same(tmp_path, monkeypatch):
    job, write = {"function": {"name": "f"}, "check": True}, folder._write

    def meanwhile(path, text):
        monkeypatch.setattr(folder, "_write", write)
        folder.prepare(tmp_path, job)
        write(path, text)

    monkeypatch.setattr(folder, "_write", meanwhile)
    folder.prepare(tmp_path, job)
    assert folder.read_job(tmp_path) == job
