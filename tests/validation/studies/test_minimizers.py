"""Facts about the minimizer study: what its decompression finds, and that its words follow from its table."""

import math
from functools import partial

import pytest

import packmech as pm
from packmech.validation.studies.accuracy import minimizers as study
from packmech.validation.studies.accuracy import studies
from packmech.validation.work_precision import Answer, work_precision

CLOSE_PACKING = math.pi / (2.0 * math.sqrt(3.0))


@pytest.mark.parametrize("overlap", [1e-3, 1e-4])
def test_a_crystal_decompresses_to_its_close_packing(overlap):
    """The last step down leaves a 64th of the pressure; a straight line from there errs by its square."""
    crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=overlap)
    scene = pm.Scene(crystal, (pm.Repulsion(),))
    found = study.decompress(scene, partial(pm.quench, force_tolerance=1e-12), slope=1.0)
    left = pm.packing_fraction(found.scene.packing) - CLOSE_PACKING
    assert 0.0 < left < 0.05 * overlap
    assert abs(found.packing_fraction - CLOSE_PACKING) < 5.0 * left * left / 0.25


def test_methods_that_go_downhill_go_to_the_same_jamming_point():
    """Tolerance 1e-4 leaves 1e-9 (slow methods 1e-8, the study's own table); other minima were seen 1e-6 away."""
    downhill = {name: method for name, method in study.methods().items() if name != "damped dynamics"}
    onset = [study.trial(method, 1e-4).value[study.ONSET] for method in downhill.values()]
    assert max(onset) - min(onset) < 1e-7


def table_of(**errors_by_method):
    """A table of the study's quantities with errors tolerance**order down to a floor of 1e-14, made up."""

    def answer(order, tolerance):
        error = max(tolerance**order, 1e-14)
        return Answer({study.ONSET: 0.8 + error, study.CONTACTS: 250.0, study.SHEAR: 1e-3 * (1.0 + error)})

    reference = {study.ONSET: 0.8, study.CONTACTS: 250.0, study.SHEAR: 1e-3}
    problem = {name: partial(answer, order) for name, order in errors_by_method.items()}
    return work_precision(problem, study.TOLERANCES, reference, error=study.errors, repeats=1), reference


def test_words_name_the_order_of_every_method():
    words = study.describe(*table_of(slow=1.0, quick=2.0))
    assert "| slow | 1.0" in words
    assert "| quick | 2.0" in words


def test_words_name_a_method_that_went_elsewhere():
    words = study.describe(*table_of(lost=0.0, found=1.0))
    assert "lost met tolerance 1e-12 and still differs by 1e+00" in words
    assert "found met tolerance" not in words


def test_the_error_of_the_shear_modulus_is_relative():
    reference = {study.ONSET: 0.8, study.CONTACTS: 250.0, study.SHEAR: 2e-3}
    value = {study.ONSET: 0.8, study.CONTACTS: 249.0, study.SHEAR: 1e-3}
    assert study.errors(value, reference) == {study.ONSET: 0.0, study.CONTACTS: 1.0, study.SHEAR: 0.5}


def test_the_study_is_found_by_name():
    assert studies()["minimizers"].args == (study.run,)
