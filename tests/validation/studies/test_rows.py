"""Rows of studies: each once, in order, with the same bits wherever its member runs, and written to the table."""

import math
from dataclasses import asdict, dataclass

import pytest

from packmech.validation.studies import bodies, shapes, spectra
from packmech.validation.studies.rows import columns_of, complete_rows, kept_of, read_rows


@dataclass(frozen=True)
class Row:
    """A row of the test."""

    seed: int
    scale: float
    value: float
    count: int

    @property
    def settings(self):
        return (self.seed, self.scale)


def silent(done, of, last):
    """Report nothing."""


def test_interrupted_rows_go_on_and_rows_of_other_settings_stay_in_the_table(tmp_path):
    path, ran, said = tmp_path / "rows.csv", [], []

    def make(seed, scale):
        ran.append(seed)
        if ran == [0, 1, 2]:
            raise KeyboardInterrupt
        return Row(seed, scale, scale * seed / 3.0 if seed else math.nan, seed)

    wanted = [(seed, 2) for seed in range(4)]
    with pytest.raises(KeyboardInterrupt):
        complete_rows(path, Row, wanted, make, silent, workers=0)
    found = complete_rows(path, Row, wanted, make, lambda *one: said.append(one), workers=0)
    assert ran == [0, 1, 2, 2, 3]
    assert [one.seed for one in found] == [0, 1, 2, 3] and isinstance(found[0].scale, float)
    assert [done for done, _, _ in said] == [0, 1, 2, 3, 4] and said[-1][2] == found[3]
    assert found[2].value == 4.0 / 3.0 and math.isnan(found[0].value)
    more = complete_rows(path, Row, [(7, 2.0)], make, silent, workers=0)
    assert read_rows(path, Row)[1:] == found[1:] + more


def test_a_member_may_be_several_rows_and_keep_arrays(tmp_path):
    def follow(seed, scales):
        return columns_of([Row(seed, scale, scale / 3.0, seed) for scale in scales])

    def make(seed, scale):
        return asdict(Row(seed, scale, 0.5, 1)) | {"kept": [1.0, scale]}

    found = complete_rows(tmp_path / "several.csv", Row, [(k, [1.0, 2.5]) for k in range(2)], follow, silent, workers=0)
    assert [one.settings for one in found] == [(0, 1.0), (0, 2.5), (1, 1.0), (1, 2.5)]
    assert read_rows(tmp_path / "several.csv", Row) == found
    (row,) = complete_rows(tmp_path / "one.csv", Row, [(3, 1.5)], make, silent, workers=0)
    assert kept_of(tmp_path / "one.csv", row).arrays()["kept"].tolist() == [1.0, 1.5]


def test_a_member_that_fails_is_an_error_and_is_run_again(tmp_path):
    broken = [True]

    def make(seed, scale):
        if broken and seed:
            raise ZeroDivisionError("the study divided by nothing")
        return Row(seed, scale, 0.0, 0)

    with pytest.raises(ZeroDivisionError):
        complete_rows(tmp_path / "rows.csv", Row, [(0, 1.0), (1, 1.0)], make, silent, workers=0)
    # what is finished stands in the table
    assert read_rows(tmp_path / "rows.csv", Row) == [Row(0, 1.0, 0.0, 0)]
    broken.clear()
    assert len(complete_rows(tmp_path / "rows.csv", Row, [(0, 1.0), (1, 1.0)], make, silent, workers=0)) == 2


def test_two_processes_give_the_same_bits_as_none(tmp_path):
    given = {"dimension": 2, "particles": 16, "seeds": [1, 2], "progress": silent}
    here, there = (
        spectra.touch_all(tmp_path / name, workers=workers, **given) for name, workers in (("here", 0), ("there", 2))
    )
    assert here == there
    names = [spectra.contacts_table(tmp_path / name, 2).read_bytes() for name in ("here", "there")]
    assert names[0] == names[1]


def test_packings_that_are_followed_give_a_row_at_each_distance(tmp_path, monkeypatch):
    monkeypatch.setattr(shapes, "DISTANCES", (1e-3, 1e-2))
    given = {"dimension": 2, "particles": 12, "seeds": [1], "progress": silent, "workers": 0}
    found = shapes.shear_all(tmp_path, aspects=[1.5], **given)
    assert [one.distance for one in found] == [1e-3, 1e-2]
    assert 0.0 < found[0].shear_modulus < found[1].shear_modulus
    edges = spectra.edges_all(tmp_path, distances=[1e-2, 1e-3], **given)
    assert [one.distance for one in edges] == [1e-3, 1e-2]
    assert edges[0].pressure < edges[1].pressure


def test_jammed_shapes_and_bodies_keep_what_is_drawn(tmp_path, monkeypatch):
    given = {"dimension": 2, "particles": 12, "pressure": 1e-4, "seeds": [1], "progress": silent, "workers": 0}
    found = shapes.jam_all(tmp_path, aspects=[1.2, 1.5], **given)
    packing = kept_of(shapes.jammed_table(tmp_path, 2), found[0]).packing()
    assert packing.particles == 12
    shapes.draw_jammed(found, tmp_path, tmp_path / "jammed.png")
    assert (tmp_path / "jammed.png").stat().st_size > 10_000
    monkeypatch.setattr(bodies, "ASYMMETRIES", (0.6,))
    monkeypatch.setattr(bodies, "ANGLES", (120.0,))
    rows = bodies.jam_bodies(tmp_path, scatter=0.0, **given)
    assert [(one.beads, one.shape) for one in rows] == [(2, 0.6), (3, 120.0)]
