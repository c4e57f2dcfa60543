"""Units and columns that are not those of the log are refused, by its own data, and named; right ones are not."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from places import ROOT
from simulated_log import IMU, simulated_log

import insenv
from insenv.base.errors import InputError
from insenv.logs import load
from insenv.logs.declared_units import check_units
from insenv.logs.instruments import description_class
from insenv.logs.rest import rest_rate_notes, rest_until

WITHOUT = "velocity"


def loaded(folder, *changes):
    """The example log with a changed description; `WITHOUT`: without the velocities of its fixes."""
    plain = ROOT / "examples" / "logs" / "plain"
    text = plain.with_suffix(".toml").read_text().replace("plain-", f"{plain.as_posix()}-")
    if WITHOUT in changes:
        text = re.sub(r'^velocity(_sigma)? = \["(vn|std_vn)".*?\n', "", text, count=2, flags=re.MULTILINE)
    for old, new in (each for each in changes if each != WITHOUT):
        text = text.replace(old, new, 1)
    (folder / "log.toml").write_text(text)
    return load(folder / "log.toml")


WRONG = {
    "g as m/s2": ([('"g"', '"m/s2"')], "accel_unit = 'm/s2': at rest the specific force is 0.999", "fit accel_unit = 'g'"),
    "scale": ([('accel_unit = "g"', 'accel_unit = "g"\naccel_scale = 1.03')], "is 10.09 m/s2", "9.64 to 9.96", "and grade"),
    "rates": ([('kind = "rate"', 'kind = "increment"'), ('"deg/s"', '"deg"'), ('"g"', '"m/s"')], "deg/s' with kind = 'rate'"),
    "deg/s as rad/s": ([('"deg/s"', '"rad/s"')], "gyro_unit = 'rad/s': the gyros turn 57 times", "fit gyro_unit = 'deg/s'"),
    "deg/s as rad/h": ([('"deg/s"', '"rad/h"')], "the gyros turn 0.0158 times", "fit gyro_unit = 'deg/s'"),
    "noise at rest": ([WITHOUT, ('"deg/s"', '"rad/s"')], "times the noise of their grade", "fit gyro_unit = 'deg/s'"),
    "place": ([("lat_deg", "x"), ("lon_deg", "lat_deg"), ('"x"', '"lon_deg"')], "they are the other's", "4.69e+03 km from"),
    "east first": ([('["vn", "ve", "vd"]', '["ve", "vn", "vd"]')], "gnss.velocity: its first two columns are east and north"),
}  # fmt: skip


def named(check, words):
    """The message of the error of a check has all the words."""
    with pytest.raises(InputError) as caught:
        check()
    assert not [word for word in words if word not in str(caught.value)], str(caught.value)


def test_right_units_are_not_refused(tmp_path):
    assert loaded(tmp_path).notes == loaded(tmp_path, WITHOUT).notes == ()
    assert not [each for each in loaded(tmp_path, ('axes = "RFU"', 'axes = "FRD"')).notes if each.code == "turns-differ"]


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_unit_of_the_example_log_is_named(name, tmp_path):
    changes, *words = WRONG[name]
    named(lambda: loaded(tmp_path, *changes), words)


def test_what_contradicts_a_unit_and_fits_no_other_is_a_note(tmp_path):
    (note,) = loaded(tmp_path, ('gyro_unit = "deg/s"', 'gyro_unit = "deg/s"\ngyro_scale = 5.0')).notes
    assert note.code == "turns-differ" and "turn 4.97 times" in note
    log = simulated("car-parked")
    log = replace(log, delta_angle=log.delta_angle + [0.0, 0.0, np.radians(1.0 / 36.0) * log.dt[0]])
    check_units(log)
    (note,) = rest_rate_notes(log)
    assert note.code == "rate-at-rest" and "check gyro_unit" in note


def declared(log, grade, **sections):
    """A simulated log as rates in deg/s and m/s^2, with the rest that it then shows."""
    imu = {**IMU, "kind": "rate", "gyro_unit": "deg/s", "accel_unit": "m/s2", "grade": grade}
    dt = log.dt[:, None]
    until = rest_until(log.imu_time, log.delta_angle / dt, log.delta_velocity / dt, log.gnss)
    kept = {"title": "simulated", "imu": imu, "initial": {"static_until_s": until}, **sections}
    return replace(log, description=description_class().model_validate(kept))


@cache
def simulated(scenario):
    """A simulated log of a minute, of a car with instruments or of a vehicle in place."""
    grade, sections = ("tactical", DESCRIBED) if scenario == "car-odometer" else ("marine", {})
    values = insenv.load(scenario).model_dump(exclude_unset=True, mode="json") | {"imu": {"grade": grade}}
    values |= {id: {} for id in sections if id != "gnss"}
    values.pop("estimator", None)
    of = insenv.record(values, seed=3, duration_s=60.0)
    log = replace(simulated_log(values, 3, 60.0), instruments=of.instruments, stated_errors=of.stated_errors, reference=None)
    return declared(log, grade, **sections)


def other(log, **scales):
    """The log with columns of other units, by factors."""
    gnss, scaled = log.gnss, {id: scales[id] for id in ("delta_angle", "delta_velocity") if id in scales}
    if gnss is not None:
        place, speed = scales.get("place", 1.0), scales.get("speed", 1.0)
        gnss = replace(gnss, latitude=gnss.latitude * place, longitude=gnss.longitude * place,
            velocity_n=gnss.velocity_n * speed)  # fmt: skip
    readings = tuple(replace(each, values=each.values * scales.get(each.id, 1.0)) for each in log.instruments)
    log = replace(log, gnss=gnss, instruments=readings, **{name: getattr(log, name) * size for name, size in scaled.items()})
    return declared(log, log.description.imu.grade, **(DESCRIBED if readings else {}))


ODOMETER = {"file": "none", "time": 0, "speed": 1, "lever_arm_m": [0, 0, 0]}
MAGNETOMETER = {"file": "none", "time": 0, "field": [1, 2, 3], "field_unit": "uT", "axes": "FRD"}
GNSS = {"file": "none", "time": 0, "latitude": 1, "longitude": 2, "height": 3, "position_unit": "deg", "velocity": [4, 5, 6],
        "position_sigma_m": [1, 1, 1], "velocity_sigma_mps": [1, 1, 1], "lever_arm_m": [0, 0, 0]}  # fmt: skip
DESCRIBED = {"odometer": ODOMETER, "magnetometer": MAGNETOMETER, "gnss": GNSS}
FAULTS = {
    "odometer": ("car-odometer", {"odometer": 3.6}, "odometer.speed_unit = 'm/s'", "speed_unit = 'km/h'"),
    "gauss": ("car-odometer", {"magnetometer": 1e-2}, "magnetometer.field_unit = 'uT'", "field_unit = 'G'"),
    "degrees": ("car-odometer", {"place": np.radians(1.0)}, "gnss.position_unit = 'deg': it is rad"),
    "km/h": ("car-odometer", {"speed": 3.6}, "gnss.velocity: it is in km/h"),
    "swaying": ("ship-swaying", {"delta_angle": np.degrees(1.0)}, "as far as the direction of the specific force", "'deg/s'"),
    "increments": ("car-parked", {"delta_velocity": 0.005}, "the columns fit accel_unit = 'm/s' with kind = 'increment'"),
    "parked": ("car-parked", {"delta_angle": np.radians(1.0)}, "at rest the gyros measure 0.2"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_wrong_unit_of_a_simulated_log_is_named(name):
    scenario, scales, *words = FAULTS[name]
    check_units(simulated(scenario))
    named(lambda: check_units(other(simulated(scenario), **scales)), words)
