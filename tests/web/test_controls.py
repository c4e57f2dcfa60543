"""Which keys become controls, and between which bounds; what a page holds, without its WebAssembly."""

import numpy as np
import pytest

import insenv
from insenv.scenario import load
from insenv.web.controls import setting_of, with_values
from insenv.web.live import live

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def uncompiled(monkeypatch):
    monkeypatch.setattr("insenv.web.live.wasm", lambda source: b"")


def test_keys_with_another_effect_are_no_controls():
    found = {control.key: control for control in live("ship-irregular-sea", "q-method", duration_s=10.0).controls}
    assert "start.latitude_deg" in found and "start.heading_deg" not in found  # the heading changes every wave
    assert len(found["vehicle.sea"].options) == 6 and len(found["imu.grade"].options) > 30
    assert not any("drop" in key or key.startswith("vehicle.sea.") for key in found)


def test_bounds_keep_what_run_refuses_out():
    """The fastest and largest motion that the controls of a ship at 50 Hz allow is one that `insenv run` takes."""
    made = live("ship-dvl", "loosely-coupled", duration_s=10.0)
    sway = {control.key: control for control in made.controls if "sway" in control.key}
    roll, period = sway["vehicle.sway.roll.0.amplitude_deg"], sway["vehicle.sway.roll.0.period_s"]
    assert roll.maximum < 80.0 and roll.minimum == 0.0 and period.minimum > 0.5
    corner = {key: c.worst for key, c in sway.items()}
    load(with_values(made.values, setting_of(made.controls, corner)))
    beyond = {key: 80.0 if key.endswith("amplitude_deg") else 0.5 for key in corner}
    with pytest.raises(insenv.InputError, match="rotation of"):
        load(with_values(made.values, setting_of(made.controls, beyond)))


def test_an_estimator_of_ones_own_and_settings_have_a_page():
    made = live("car-city-drive", insenv.fusion(["gyro_scale"], id="mine"), duration_s=10.0)
    assert made.page.members[0].estimator.id == "mine"
    settings = {"loosely-coupled": {"innovation_gate": 4.25}}
    made = live("car-city-drive", "loosely-coupled", duration_s=10.0, settings=settings)
    assert np.all(made.parameters[made.page.model.parameters.slice("e0_innovation_gate")] == 4.25)
