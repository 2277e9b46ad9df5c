"""Facts about units and far places: results scale, and what double precision cannot carry is refused by name."""

import functools

import numpy as np
import pytest

import packmech as pm

# powers of two change no digit; lengths near 1e57 and 1e-57, energies near 1e117 and 1e-117
SCALES = [(190, 0), (-190, 0), (0, 390), (0, -390), (190, 390), (-190, -390), (100, -180)]
DENSE = {2: 0.95, 3: 0.75}


def scene(dimension, length=1.0, energy=1.0, shift=0.0):
    packing = pm.random_packing(24, dimension=dimension, packing_fraction=DENSE[dimension], seed=1)
    scaled = pm.Packing((packing.position_nd + shift) * length, packing.radius_n * length, packing.box.scaled(length))
    return pm.Scene(scaled, (pm.Repulsion(law=pm.Harmonic(energy)),))


@functools.cache
def reference(dimension):
    start = scene(dimension)
    run = pm.quench(start, force_tolerance=1e-10)
    return start, run, pm.jam(start, pressure=1e-4)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("length", "energy"), [(2.0**a, 2.0**b) for a, b in SCALES])
def test_forces_contacts_and_quenched_packings_scale_to_the_last_bit(dimension, length, energy):
    start, rest, _ = reference(dimension)
    scaled = scene(dimension, length, energy)
    assert np.array_equal(pm.forces(scaled), pm.forces(start) * (energy / length))
    one, other = pm.find_contacts(start.packing, gap_tolerance=0.0), pm.find_contacts(scaled.packing, gap_tolerance=0.0)
    assert np.array_equal(one.image_cd, other.image_cd) and np.array_equal(one.gap_c * length, other.gap_c)
    run = pm.quench(scaled, force_tolerance=1e-10)
    assert run.outcome is rest.outcome and run.steps == rest.steps > 0
    assert np.array_equal(run.packing.position_nd, rest.packing.position_nd * length)
    now, then = (pm.pressure(before.replace(packing=end.packing)) for before, end in ((scaled, run), (start, rest)))
    assert now / (energy / length**dimension) == pytest.approx(then, rel=1e-13)
    wrapped, image = scaled.packing.box.wrap(scaled.packing.position_nd)
    expected, same = start.packing.box.wrap(start.packing.position_nd)
    assert np.array_equal(image, same) and np.abs(wrapped / length - expected).max() < 1e-14


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("length", "energy"), [(2.0**a, 2.0**b) for a, b in SCALES])
def test_jammed_packings_scale_to_rounding(dimension, length, energy):
    jammed = reference(dimension)[2]
    run = pm.jam(scene(dimension, length, energy), pressure=1e-4)
    assert run.ok and np.abs(run.packing.position_nd / length - jammed.packing.position_nd).max() < 1e-8
    for name in ("packing_fraction", "jamming_packing_fraction", "pressure"):
        assert run.report[name] == pytest.approx(jammed.report[name], rel=1e-9)


@pytest.mark.parametrize("length", [1e77, 1e-77, 1e200, 1e-200, 1e300])
def test_lengths_beyond_double_precision_are_refused_by_name(length):
    packing = scene(2).packing
    with pytest.raises(ValueError, match=r"lattice_dd must have columns of lengths between 1e-60 and 1e\+60"):
        packing.box.scaled(length)
    with pytest.raises(ValueError, match=r"radius_n must lie between 1e-60 and 1e\+60 .* for particle"):
        packing.replace(radius_n=packing.radius_n * length)


@pytest.mark.parametrize(("energy", "length"), [(1e-200, 1.0), (1e200, 1.0), (1e100, 1e-30), (1e-100, 1e30)])
def test_laws_whose_forces_have_no_squares_are_refused_by_name(energy, length):
    with pytest.raises(ValueError, match="effects must have energy_scale.* between 1e-120 and .* got"):
        scene(2, length, energy)


@pytest.mark.parametrize("far", [1e11, 1e15, 1e20, 1e30, 1e300])
def test_particles_so_far_away_that_rounding_is_seen_are_refused_by_name(far):
    packing = scene(2).packing
    place = packing.position_nd.copy()
    place[7, 1] = -far
    with pytest.raises(ValueError, match=r"position_nd must be so near .* smallest radius .* for particle 7"):
        packing.replace(position_nd=place)
    with pytest.raises(ValueError, match=r"position_nd must stay within 2147483648 lattice vectors .* for particle 7"):
        packing.box.wrap(place)
    with pytest.raises(ValueError, match=r"box must be so small that rounding is below .* smallest radius"):
        packing.replace(box=pm.Box(np.diag([10.0, min(far, 1e59)])))


@pytest.mark.parametrize("far", [1e5, 1e8, 1e9])
def test_a_quench_far_away_ends_where_it_does_nearby_to_the_rounding_of_places(far):
    rest = reference(2)[1]
    run = pm.quench(scene(2, shift=far), force_tolerance=1e-10)
    assert run.outcome in (pm.Outcome.CONVERGED, pm.Outcome.ROUNDING_FLOOR)
    apart = run.packing.position_nd - far - rest.packing.position_nd
    assert np.abs(apart).max() < 1e3 * np.spacing(far)


@pytest.mark.parametrize("far", [1e5, 1e8, 1e9])
def test_jamming_starts_far_away_from_the_same_particles_in_the_cell(far):
    start = scene(2, shift=far)
    run = pm.jam(start, pressure=1e-4)
    near = pm.jam(start.replace(packing=start.packing.wrapped()), pressure=1e-4)
    assert run.ok and run.packing == near.packing
