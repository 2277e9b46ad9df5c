"""Facts about the study of constraint bases: its chains, its measures, and that its words follow from its table."""

from functools import partial

import numpy as np
import pytest

import packmech as pm
from packmech.validation.studies.accuracy import constraint_bases as study
from packmech.validation.work_precision import Answer, work_precision


@pytest.mark.parametrize(("reach", "links"), [(2, 397), (4, 790)])
def test_links_of_the_chain_have_rank_two_n_less_three(reach, links):
    packing = study.chain(0.5, reach)
    assert len(packing.links) == links
    assert np.linalg.matrix_rank(pm.constraint_jacobian(packing).toarray(), rtol=1e-10) == 397


def test_what_a_basis_leaves_out_is_nothing_for_all_links_and_all_of_a_link_that_it_lacks():
    packing = study.chain(0.5, 2)
    assert study.left_out(packing, pm.constraint_basis(packing)) < 1e-14
    fewer = packing.replace(links=packing.links.select(np.arange(1, 397)))
    assert study.left_out(packing, pm.constraint_basis(fewer)) > 1e-3


def test_words_tell_orthogonality_at_both_ends_and_a_rank_that_is_wrong():
    def answer(name, angle):
        wrong = 3.0 if name.startswith("gram-schmidt,") else 0.0
        return Answer({study.ORTHOGONALITY: 1e-16 / angle, study.SPAN: 0.0, study.RANK: 397.0 - wrong})

    names = [f"{method}, {links}" for links in study.LINKS for method in study.METHODS]
    reference = {study.ORTHOGONALITY: 0.0, study.SPAN: 0.0, study.RANK: 397.0}
    problem = {name: partial(answer, name) for name in names}
    words = study.describe(work_precision(problem, study.ANGLES, reference, repeats=1))
    assert "| householder | angles fixed | 1.0e-16 | 1.0e-14 | 0.0e+00 | 0 |" in words
    assert "| gram-schmidt | all pairs up to 4 | 1.0e-16 | 1.0e-14 | 0.0e+00 | 3 |" in words
