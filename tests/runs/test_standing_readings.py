"""Heading and datum of what instruments read of a vehicle that stands."""

from dataclasses import replace

import numpy as np
import pytest
from changed_scenario import changed
from standing_car import NOTHING, car, started
from written_logs import written_log

from insenv import record, replay
from insenv.base.errors import InputError
from insenv.logs.recorded import RecordedLog
from insenv.logs.rest import rest_of, rest_rows
from insenv.runs.instrument_start import heading_at_rest

WITH = {
    "rm3100": {"magnetometer": {"grade": "rm3100"}},
    "autopilot": {"magnetometer": {"grade": "autopilot"}},
    "two antennas": {"heading": {"grade": "rtk", "baseline_m": [0.5, 1.0, 0.0]}},
}


def standing(name: str, seed: int) -> RecordedLog:
    """Ten seconds of a car that stands, with an instrument, of which the log gives no start."""
    scenario = changed("car-city-drive", **{**car("autopilot").model_dump(mode="json", exclude_unset=True), **WITH[name]})
    return started(record(scenario, seed=seed, duration_s=10.0), static_until_s=9.5, **NOTHING)


@pytest.mark.parametrize("name", ["rm3100", "two antennas", pytest.param("autopilot", marks=pytest.mark.slow)])
def test_the_heading_at_rest_is_as_good_as_stated(name):
    """Eight seeds; the level, which turns the field's vertical part, is that of the accelerometers."""
    ratios = []
    for seed in range(200, 208):
        log = standing(name, seed)
        rest = rest_of(log, rest_rows(log), 0)
        shown = heading_at_rest(log, rest.level, rest.tilt_sigma(log.sensors(in_place=True)), 400.0)
        assert shown.sigma < np.radians(4.0)
        ratios.append(float(np.angle(np.exp(1j * (shown.heading - log.reference.heading[0])))) / shown.sigma)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.7 and np.abs(ratios).max() < 3.0


@pytest.mark.parametrize("id", [pytest.param("fusion", marks=pytest.mark.slow), "loosely-coupled"])
def test_a_log_that_does_not_move_starts_with_that_heading(id):
    result = replay(standing("autopilot", 200), id).results[0]
    assert any("is that of the magnetometer while the vehicle stands" in note for note in result.notes)
    assert abs(result.errors["heading_deg"][-1]) < 3.0 * result.sigma["heading_deg"][-1] < 30.0


def test_a_field_that_is_not_that_of_the_earth_shows_no_heading():
    log = standing("autopilot", 200)
    wrong = replace(log, instruments=tuple(replace(each, values=1e3 * each.values) for each in log.instruments))
    with pytest.raises(InputError, match="no instrument measures it"):
        replay(wrong, "fusion")


@pytest.mark.parametrize("offset", [-199.0, 5.0])
def test_a_barometer_with_another_datum_starts_with_the_difference_as_sigma(tmp_path, offset):
    report = replay(written_log(tmp_path, duration_s=35.0, barometer=offset), "fusion")
    said = [note for note in report.notes if "reads" in note and "below the fixes at the start" in note]
    assert len(said) == (offset < -100)
    (result,) = report.results
    assert result.outputs["barometer_bias"][-1] == pytest.approx(offset, abs=20.0) and result.health.verdict == "consistent"
