"""Facts about a jamming method of one's own: one class, taken by `jam` and scene files as those that ship."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import packmech as pm


@dataclass(frozen=True)
class SlowPress(pm.JamMethod):
    """FIRE in positions and the size of the box, from ten times the pressure down to it."""

    steps: int = 3
    start_packing_fraction: float | None = None

    honors = {"isotropic": "shapes"}

    def follow(self, protocol, pressure):
        packing = protocol.scene.packing
        if self.begins_afresh:
            packing = pm.at_packing_fraction(packing, self.start_packing_fraction)
        with protocol.stage("slow press") as figures:
            for factor in np.geomspace(10.0, 1.0, self.steps):
                done = protocol.relax_strained(packing, factor * pressure, 1e-9, 100_000)
                packing, figures.steps = done.packing, figures.steps + done.steps
        protocol.report["presses"] = self.steps
        return packing, pm.Outcome.CONVERGED


def scene(**given):
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(24, dimension=2, sizes=sizes, packing_fraction=0.95, seed=1, **given)
    return pm.Scene(packing, (pm.Repulsion(),))


@pytest.mark.parametrize("shapes", [None, pm.Ellipses(aspect=1.4)])
def test_jam_takes_a_method_of_ones_own(shapes):
    given = {} if shapes is None else {"shapes": shapes}
    run = pm.jam(scene(**given), pressure=1e-3, strain="isotropic", method=SlowPress())
    assert run.report["method"] == "SlowPress" and run.report["presses"] == 3 and run.report["pressure_asked"] == 1e-3
    assert pm.pressure(scene().replace(packing=run.packing)) == pytest.approx(
        1e-3 * scene().replace(packing=run.packing).pressure_unit, rel=1e-5
    )
    assert [stage.name for stage in run.stages] == ["slow press"] and run.steps > 0


def test_it_begins_where_it_says_or_where_a_jammed_packing_stands():
    jammed = pm.jam(scene(), pressure=1e-3, strain="isotropic", method=SlowPress())
    assert jammed.report["start"] == "fresh"
    again = pm.jam(scene().replace(packing=jammed.packing), pressure=1e-3, strain="isotropic", method=SlowPress())
    assert again.report["start"] == "continued"
    given = SlowPress(start_packing_fraction=0.9)
    fresh = pm.jam(scene().replace(packing=jammed.packing), pressure=1e-3, strain="isotropic", method=given)
    assert fresh.report["start"] == "fresh"


def test_what_it_does_not_honor_is_refused_by_name():
    with pytest.raises(ValueError, match=r"method must be HardVertex, .* got SlowPress"):
        pm.jam(scene(), strain="free", method=SlowPress())
    rough = pm.Scene(scene().packing, (pm.Repulsion(), pm.Friction(0.5)))
    with pytest.raises(ValueError, match="method must be Press for a scene with friction, got SlowPress"):
        pm.jam(rough, strain="isotropic", method=SlowPress())
    held = pm.Scene(scene().packing, (pm.Repulsion(), pm.Gravity()))
    with pytest.raises(ValueError, match="got Gravity"):
        pm.jam(held, strain="isotropic", method=SlowPress())


def test_it_may_honor_what_none_that_ships_does():
    @dataclass(frozen=True)
    class Sinking(pm.JamMethod):
        honors = {"isotropic": "gravity"}

        def follow(self, protocol, pressure):
            return protocol.relax(protocol.scene.packing, 1e-6, 10)[0], pm.Outcome.STEP_LIMIT

    heavy = pm.Scene(scene().packing, (pm.Repulsion(), pm.Gravity(0.01)))
    run = pm.jam(heavy, strain="isotropic", method=Sinking(), check=False)
    assert run.outcome is pm.Outcome.STEP_LIMIT


def test_one_that_ends_elsewhere_takes_no_pressure():
    @dataclass(frozen=True)
    class Still(pm.JamMethod):
        ends_at = "the packing fraction that it has"

        def follow(self, protocol, pressure):
            packing, _ = protocol.relax(protocol.scene.packing, 1e-6, 100_000)
            return packing, pm.Outcome.CONVERGED

    assert pm.jam(scene(), method=Still(), check=False).report["pressure_asked"] is None
    with pytest.raises(ValueError, match="pressure must be left out for Still, which ends at the packing fraction"):
        pm.jam(scene(), pressure=1e-3, method=Still())


def test_a_scene_file_names_it(tmp_path):
    drive = pm.JamDrive(pressure=1e-3, strain="isotropic", method=SlowPress(steps=2))
    pm.write_scene(scene().replace(drive=drive), tmp_path / "slow.toml")
    read = pm.read_scene(tmp_path / "slow.toml")
    assert read.drive.method == SlowPress(steps=2)
    assert pm.run(read).report["presses"] == 2


def test_it_has_a_name_of_its_own():
    with pytest.raises(ValueError, match="method must have a name that none of packmech's has, got HardVertex"):
        type("HardVertex", (pm.JamMethod,), {})
