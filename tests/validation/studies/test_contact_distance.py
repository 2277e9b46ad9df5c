"""Facts about the study of contact distances: what it measures is what the corrected specification states."""

import numpy as np
import pytest

from packmech.validation.studies.accuracy import contact_distance as study

# log10 of the mean error over unlike pairs by another implementation, 4e5 of them; pairs without contact are left out
STATED = {
    "gaussian": (-1.86, -1.84, -1.78, -1.65, -1.43, -0.95),
    "linear": (-3.69, -3.67, -3.66, -3.60, -1.46, -1.25),
    "quadratic": (-6.16, -6.09, -6.22, -5.02, -3.89, -2.37),
}


@pytest.mark.parametrize("level", STATED)
def test_mean_errors_are_the_stated_ones(level):
    for aspect, stated in zip(study.ASPECTS, STATED[level], strict=True):
        found = study.measure(aspect, level, pairs=40_000, timed=10)
        # ten times fewer pairs; single pairs of aspect 3 and 10 of the linear level make up its mean
        bound = 0.02 if aspect < 3.0 else 0.06 if level != "linear" else 0.3
        assert np.log10(found.mean) == pytest.approx(stated, abs=bound)


def test_the_table_has_a_row_for_every_level_and_says_where_no_contact_is_found():
    rows = tuple(study.measure(aspect, level, 2000, 100) for aspect in study.ASPECTS for level in study.LEVELS)
    table = study.LevelTable(rows, dict.fromkeys(study.ASPECTS, 100.0))
    text = table.to_markdown()
    assert text.count("\n") > 8 and "no contact found" in text and "printed" in text
    assert table.to_csv().count("\n") == len(rows) + 1
    assert "of pairs of aspect 10 find no" in study.describe(table)


def test_discs_of_unlike_sizes_have_exact_errors():
    """At aspect 1 there is nothing to average: the closed form half way, and levels with 50 digits."""
    errors = [study.measure(1.0, level, 100, 10).mean for level in ("gaussian", "linear", "quadratic", "exact")]
    # sigma = 1.2 for radii .5 and .7; half way sigma^2 = 2 (r^2 + R^2)
    assert errors[0] == pytest.approx(np.sqrt(2.0 * (0.25 + 0.49)) / 1.2 - 1.0, rel=1e-12)
    assert errors[1:3] == pytest.approx([1.200243745200567 / 1.2 - 1.0, 1.200000830745467 / 1.2 - 1.0], rel=1e-8)
    assert errors[3] < 1e-15
