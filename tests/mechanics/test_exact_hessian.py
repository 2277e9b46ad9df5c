"""Facts about exact and paper Hessian with links, against differences of stress and energy of packings at rest."""

import numpy as np
import pytest
from hard_cases.finite_differences import at_rest, finite_tangent, kept_step, second_difference

import packmech as pm
from packmech.effects import contact_terms

KINDS = ("exact", "paper")
CASES = [(name, dimension) for name in ("dimers", "rigid trimers", "flexible chains") for dimension in (2, 3)]


def state(name, dimension):
    """Return 20 to 21 particles in clusters, shear-stabilized at pressure .1, without rattlers."""
    common = {"dimension": dimension, "packing_fraction": {2: 0.9, 3: 0.7}[dimension], "seed": 1}
    if name == "dimers":
        packing = pm.cluster_packing(10, pm.Dimer(), **common)
    elif name == "rigid trimers":
        packing = pm.cluster_packing(7, pm.Trimer(angle=(1.1, 2.6)), **common)
    else:
        packing = pm.chain_packing(4, 5, **common)
    run = pm.shear_stabilize(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)), pressure=0.1)
    return at_rest(pm.Scene(pm.remove_rattlers(run.packing)[0], (pm.Repulsion(law=pm.Harmonic()),)))


def relative(one_ee, other_ee):
    """Return the largest entry of the difference over the largest entry of the second."""
    return float(np.abs(one_ee - other_ee).max() / np.abs(other_ee).max())


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_exact_tangent_is_the_difference_of_the_stress_at_rest_again_and_paper_is_not(name, dimension):
    scene = state(name, dimension)
    step = kept_step(scene, 1e-4)
    tangent = finite_tangent(scene, step)
    exact, paper = (pm.elastic_moduli(scene, kind=kind).cauchy for kind in KINDS)
    error = relative(exact, tangent)
    assert error <= 1e-6
    assert relative(exact, finite_tangent(scene, step / 2.0)) == pytest.approx(error / 4.0, rel=0.05)
    assert relative(paper, tangent) > 1e-3


@pytest.mark.parametrize(("name", "dimension"), [("rigid trimers", 2), ("flexible chains", 2)])
def test_exact_energy_tangent_is_the_second_difference_of_the_energy_at_rest_again(name, dimension):
    scene = state(name, dimension)
    step = kept_step(scene, 1e-3)
    exact, paper = (pm.elastic_moduli(scene, kind=kind).energy for kind in KINDS)
    far, near = (relative(exact, second_difference(scene, part * step)) for part in (1.0, 0.5))
    # where contacts are kept for small steps only, rounding of four energies shows in their second difference: of the
    # distances of contacts, which is that of coordinates, times their forces
    contacts = pm.find_contacts(scene.packing)
    force_c = contact_terms(scene.effects, contacts).first_c
    energy = np.finfo(float).eps * np.abs(scene.packing.position_nd).max() * np.sqrt((force_c**2).sum())
    rounding = 4.0 * energy / (0.5 * step) ** 2 / scene.packing.box.volume / np.abs(exact).max()
    assert near == pytest.approx(far / 4.0, rel=0.1, abs=2.0 * rounding)
    fine = second_difference(scene, min(step, 1e-4))
    assert relative(exact, fine) <= 1e-6
    assert relative(paper, fine) > 1e-3


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
