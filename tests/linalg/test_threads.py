"""Facts about threads of factorizations: they change no bit, and only what asks for them gets them."""

import numpy as np
import pytest
import scipy.sparse as sp

import packmech as pm
from packmech.linalg.block_system import BlockSystem
from packmech.linalg.factor import factorize
from packmech.linalg.threads import allowed_threads, factor_threads
from packmech.minimize import program


@pytest.fixture(scope="module")
def spheres():
    """A packing of spheres large enough for supernodes, pressed."""
    crystal = pm.lattice_packing("fcc", repeats=(9, 9, 9), relative_overlap=1e-3)
    shaken = crystal.position_nd + 1e-4 * np.random.default_rng(0).normal(size=crystal.position_nd.shape)
    scene = pm.Scene(crystal.replace(position_nd=shaken), (pm.Repulsion(),))
    return scene.replace(packing=pm.quench(scene, force_tolerance=1e-10).packing)


def few_spheres():
    return pm.Scene(pm.random_packing(60, dimension=3, packing_fraction=0.6, seed=5), (pm.Repulsion(),))


def test_a_factorization_has_the_same_bits_on_any_number_of_threads(spheres):
    matrix = pm.hessian(spheres, "none") + 1e-3 * sp.eye_array(3 * spheres.packing.particles)
    right = np.random.default_rng(1).normal(size=(matrix.shape[0], 3))
    found = []
    for threads in (1, 2, 3):
        with factor_threads(threads):
            factor = factorize(matrix)
            found.append((factor.backend, factor.inertia, factor.solve(right).tobytes()))
    assert found[0][0] == "rslab"
    assert found[0] == found[1] == found[2]


def test_a_system_of_contacts_has_the_same_bits_on_any_number_of_threads(spheres):
    contacts = pm.find_contacts(spheres.packing)
    weight = np.exp(np.random.default_rng(2).normal(size=len(contacts)))
    right = np.random.default_rng(3).normal(size=3 * spheres.packing.particles)
    right -= np.tile(right.reshape(-1, 3).mean(axis=0), spheres.packing.particles)
    found = []
    for threads in (1, 2, 3):
        with factor_threads(threads):
            system = BlockSystem(contacts.i_c, contacts.j_c, spheres.packing.particles, 3, backend="rslab")
            found.append(system.factor(contacts.normal_cd, weight).solve(right).tobytes())
    assert found[0] == found[1] == found[2]


def test_threads_are_allowed_where_they_are_asked_for_and_not_after(spheres, monkeypatch):
    rslab = pytest.importorskip("rslab")
    analyze, asked = rslab.analyze, []

    def seen(*given, threads, **named):
        asked.append(threads)
        return analyze(*given, threads=threads, **named)

    monkeypatch.setattr(rslab, "analyze", seen)
    for call in (pm.elastic_moduli, lambda scene, **named: pm.count_modes(scene, 0.5, **named)):
        call(spheres, threads=3)
        assert set(asked) == {3}
        asked.clear()
        call(spheres)
        assert set(asked) == {1}
        asked.clear()
    with pytest.raises(RuntimeError), factor_threads(2):
        raise RuntimeError
    assert allowed_threads() == 1


@pytest.mark.parametrize(
    "figures",
    [
        lambda scene, threads: pm.elastic_moduli(scene, threads=threads).energy,
        lambda scene, threads: pm.normal_modes(scene, count=5, threads=threads).displacement_mnd,
        lambda scene, threads: pm.count_modes(scene, [0.3, 0.6], threads=threads).count_v,
        lambda scene, threads: pm.jam(few_spheres(), 1e-4, threads=threads, check=False).packing.position_nd,
    ],
    ids=["elastic_moduli", "normal_modes", "count_modes", "jam"],
)
def test_calls_give_the_same_bits_on_any_number_of_threads(spheres, figures):
    assert figures(spheres, 1).tobytes() == figures(spheres, 2).tobytes()


@pytest.mark.parametrize("strain", ["free", "isotropic"])
def test_jam_in_blocks_of_rows_gives_the_same_bits_on_any_number_of_threads(strain, monkeypatch):
    monkeypatch.setattr(program, "_BLOCK", 25)
    packing = pm.random_packing(100, dimension=2, sizes=pm.Bidisperse(), packing_fraction=0.8, seed=6)
    runs = [pm.jam(pm.Scene(packing, (pm.Repulsion(),)), 1e-4, strain=strain, threads=k) for k in (1, 2, 3)]
    assert len({run.packing.position_nd.tobytes() for run in runs}) == len({run.steps for run in runs}) == 1


def test_pressing_with_friction_gives_the_same_bits_on_two_threads():
    packing = pm.random_packing(600, dimension=2, sizes=pm.Bidisperse(), packing_fraction=0.8, seed=4)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.3)))
    method = pm.Press(rate=1e-2, step_limit=2000)
    one, two = (pm.jam(scene, 1e-2, method=method, threads=threads, check=False) for threads in (1, 2))
    assert one.packing.position_nd.tobytes() == two.packing.position_nd.tobytes()
    assert one.steps == two.steps > 0
