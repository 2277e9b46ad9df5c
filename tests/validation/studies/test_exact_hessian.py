"""Facts about exact and paper Hessian with links, against differences of stress and energy of packings at rest."""

import numpy as np
import pytest

import packmech as pm
from packmech.effects import contact_terms
from packmech.validation.studies.accuracy import exact_hessian as study
from packmech.validation.studies.accuracy.exact_hessian import at_rest, finite_tangent, kept_step, second_difference
from packmech.validation.work_precision import Answer, work_precision

CASES = [(name, dimension) for name in study.STATES for dimension in (2, 3)]


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_exact_tangent_is_the_difference_of_the_stress_at_rest_again_and_paper_is_not(name, dimension):
    scene = study.state(name, dimension, 0.1)
    step = kept_step(scene, 1e-4)
    tangent = finite_tangent(scene, step)
    exact, paper = (pm.elastic_moduli(scene, kind=kind).cauchy for kind in study.KINDS)
    error = study.relative(exact, tangent)
    assert error <= 1e-6
    assert study.relative(exact, finite_tangent(scene, step / 2.0)) == pytest.approx(error / 4.0, rel=0.05)
    assert study.relative(paper, tangent) > 1e-3


@pytest.mark.parametrize(("name", "dimension"), [("rigid trimers", 2), ("flexible chains", 2)])
def test_exact_energy_tangent_is_the_second_difference_of_the_energy_at_rest_again(name, dimension):
    scene = study.state(name, dimension, 0.1)
    step = kept_step(scene, 1e-3)
    exact, paper = (pm.elastic_moduli(scene, kind=kind).energy for kind in study.KINDS)
    far, near = (study.relative(exact, second_difference(scene, part * step)) for part in (1.0, 0.5))
    # where contacts are kept for small steps only, rounding of four energies shows in their second difference: of the
    # distances of contacts, which is that of coordinates, times their forces
    contacts = pm.find_contacts(scene.packing)
    force_c = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c).first_c
    energy = np.finfo(float).eps * np.abs(scene.packing.position_nd).max() * np.sqrt((force_c**2).sum())
    rounding = 4.0 * energy / (0.5 * step) ** 2 / scene.packing.box.volume / np.abs(exact).max()
    assert near == pytest.approx(far / 4.0, rel=0.1, abs=2.0 * rounding)
    fine = second_difference(scene, min(step, 1e-4))
    assert study.relative(exact, fine) <= 1e-6
    assert study.relative(paper, fine) > 1e-3


def test_without_contacts_nothing_pulls_a_strained_dimer_back():
    links = pm.Links([0], [1], [[0, 0]], [1.0])
    dimer = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(5.0, 2), links)
    scene = at_rest(pm.Scene(dimer, (pm.Repulsion(),)))
    assert np.abs(finite_tangent(scene, 1e-3)).max() == 0.0


def test_a_step_is_halved_until_no_contact_is_made():
    # next neighbors along the rows stand a gap of 1e-3 apart
    rows = pm.lattice_packing("square", repeats=(3, 3), relative_overlap=0.0)
    packing = rows.replace(position_nd=rows.position_nd * 1.001, box=rows.box.scaled(1.001))
    assert kept_step(pm.Scene(packing, (pm.Repulsion(),)), 0.0039) == pytest.approx(0.0039 / 4)


def test_words_tell_the_power_of_the_pressure_with_which_the_kinds_come_together():
    def answer(pressure):
        return Answer(
            {
                study.COMPLIANCE: 2.0 * pressure, study.LOWEST: pressure, study.EXACT: 1e-9,
                study.FINER: 1e-10, study.PAPER: 3.0 * pressure,
            }
        )  # fmt: skip

    reference = dict.fromkeys((study.COMPLIANCE, study.LOWEST, study.EXACT, study.FINER, study.PAPER), 0.0)
    table = work_precision({"dimers, 2D": answer}, study.PRESSURES, reference)
    words = study.describe(table)
    assert "pressure to the power 1.00 to 1.00 below 1e-4" in words
    assert "| dimers, 2D | 2.0e-01 | 2.0e-02 | 2.0e-03 | 2.0e-04 | 2.0e-05 | 2.0e-06 |" in words
    assert "exact form from finite differences: 1.0e-09." in words
