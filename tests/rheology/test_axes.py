"""Wrong axes of an applied strain are refused by the name that the caller gave them."""

import pytest

import packmech as pm

SCENE = pm.Scene(
    pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=0.01),
    (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.1)),
)
CALLS = {
    "oscillatory_shear": lambda axes: pm.oscillatory_shear(SCENE, amplitude=0.01, frequency=0.1, axes=axes),
    "equilibrate": lambda axes: pm.equilibrate(SCENE, amplitude=0.01, frequency=0.1, axes=axes),
    "steady_shear": lambda axes: pm.steady_shear(SCENE, rates=[0.1], applied_strain=2.0, axes=axes),
    "ramp_strain": lambda axes: pm.ramp_strain(SCENE, rate=0.1, applied_strain=0.1, axes=axes),
    "creep": lambda axes: pm.creep(SCENE, stress=0.01, duration=1.0, axes=axes),
    "complex_modulus": lambda axes: pm.complex_modulus(SCENE, [0.1], axes=axes),
    "shear_batch": lambda axes: pm.ShearBatch([SCENE], axes=axes),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
@pytest.mark.parametrize(
    ("axes", "words"),
    [(0, "two axes, got 0"), ((0, 0), r"two different axes, got \(0, 0\)"), ((0, 2), "at most 1, got 2")],
)
def test_calls_with_axes_name_axes(call, axes, words):
    with pytest.raises((TypeError, ValueError), match=rf"^axes must be .*{words}"):
        call(axes)


@pytest.mark.parametrize(
    ("axes", "words"), [(0, "a tuple, got 0"), ((0, 0), "two different axes"), ((0, 2), "at most 1, got 2")]
)
def test_an_applied_strain_and_a_drive_name_their_own_axes(axes, words):
    with pytest.raises((TypeError, ValueError), match=rf"^applied_strain.axes must be .*{words}"):
        pm.simulate(SCENE, steps=1, applied_strain=pm.SteadyStrain(0.1, axes=axes))
    if axes != (0, 2):
        with pytest.raises((TypeError, ValueError), match=rf"^drive.axes must be .*{words}"):
            pm.CreepDrive(stress=0.01, duration=1.0, axes=axes)


def test_axes_may_be_equal_where_the_strain_has_one():
    run = pm.ramp_strain(SCENE, rate=0.1, applied_strain=0.01, mode="uniaxial", axes=(1, 1), samples=1)
    assert run.packing.box.lattice_dd[1, 1] > SCENE.packing.box.lattice_dd[1, 1]
