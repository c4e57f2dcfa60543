"""The unit: what its frames hold, when they are due, what its status says, and its answers to commands."""

from pathlib import Path

import numpy as np
import pytest
from changed_scenario import changed
from scipy.spatial.transform import Rotation
from streamed_vehicle import quiet, steps
from vectornav_host import INS, commands, read

from insenv.base.errors import InputError
from insenv.base.toml import read_toml
from insenv.mavlink.vectornav import MODELS, Unit

OLDER = {
    "vn300": (["75,3,8,34,072E,0106,0612", "76,3,80,4E,0002,0010,20B8,0018"], {"342e0706011206": 40, "4e02001000b8201800": 10}),
    "vn100": (["75,3,1,14,073E,0004"], {"143e070400": 40, "1101000601": 40}),
}
"""Masks of older drivers by model, and the packets of two seconds by their headers."""
REFUSED = read_toml(Path(__file__).with_name("refused.toml"))
DOUBTED = {"heading_error_deg": 60.0, "heading_sigma_deg": 5.0}
GPS_MINUS_UNIX_2026 = 18 - 315964800


def unit_of(vehicle, model="vn300"):
    return Unit(MODELS[model], 1.0 / vehicle.simulation.interval)


def answers(unit, data):
    return b"".join(answer for _, answer in unit.take(data)[0]).decode()


def sent(unit, vehicle, seconds):
    """The bytes of `seconds`."""
    data = b""
    for _ in range(round(seconds / vehicle.simulation.interval)):
        vehicle.step()
        data += b"".join(frame for _, frame in unit.frames(vehicle.view))
    return data


def status(vehicle):
    """Mode and bits of InsStatus after one more sample, from an output of it alone."""
    unit = unit_of(vehicle)
    answers(unit, commands("VNWRG,76,3,1,20,0001"))
    vehicle.step()
    word = int.from_bytes(dict(unit.frames(vehicle.view))["OUTPUT_76"][-4:-2], "little")
    return word & 3, {bit for bit in range(2, 16) if word >> bit & 1}


@pytest.fixture(scope="module")
def driven():
    """A car after 70 s, its fixes 0.4 s late, and the bytes of the last second."""
    late = changed("car-city-drive", gnss={"latency_s": 0.4}, rate_hz=200)
    vehicle = quiet(late, start_unix=1.8e9)
    steps(vehicle, 68.995)
    unit = unit_of(vehicle)
    sent(unit, vehicle, 0.005)
    return vehicle, sent(unit, vehicle, 1.0)


def test_the_default_outputs_have_the_rates_and_the_state_of_the_estimator(driven):
    vehicle, found = driven[0], read(driven[1])
    assert {header: len(all_of) for header, all_of in found.items()} == {
        "012107": 200, "31010006011306": 50, "490300b8261800": 5,
    }  # fmt: skip
    view, estimate = vehicle.view, vehicle.simulation.estimate
    ins = dict(zip(INS, found["31010006011306"][-1], strict=True))
    assert ins["time"] == 70_000_000_000
    attitude, small = Rotation.from_quat(estimate["q_nb"][[1, 2, 3, 0]]), 1e-4
    ypr = attitude.as_euler("ZYX", degrees=True)
    np.testing.assert_allclose(ins["ypr"], ypr, rtol=1e-6)
    np.testing.assert_allclose(ins["quaternion"], estimate["q_nb"][[1, 2, 3, 0]], rtol=1e-6, atol=1e-7)
    turned = [(Rotation.from_rotvec(small * axis) * attitude).as_euler("ZYX", degrees=True) - ypr for axis in np.eye(3)]
    variances = estimate["attitude_sigma"] ** 2 @ (np.array(turned) / small) ** 2
    np.testing.assert_allclose(ins["sigmas"], np.sqrt(variances), rtol=1e-3)
    place = [np.degrees(float(estimate["latitude"])), np.degrees(float(estimate["longitude"])), float(estimate["height"])]
    np.testing.assert_allclose(ins["place"], place, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ins["velocity"], estimate["velocity_n"], rtol=1e-6)
    for name in ("position", "velocity"):
        assert ins[f"{name}_sigma"] == pytest.approx(np.sqrt(np.mean(estimate[f"{name}_sigma"] ** 2)))
    gnss, fix = found["490300b8261800"][-1], vehicle.simulation.fix
    assert gnss[:4] == (70_000_000_000, (1_800_000_070 + GPS_MINUS_UNIX_2026) * 10**9, 12, 3) and gnss[-2:] == (12, 3)
    np.testing.assert_allclose(gnss[4:7], [np.degrees(fix.latitude), np.degrees(fix.longitude), fix.height], rtol=0, atol=1e-12)
    np.testing.assert_allclose(gnss[7:10], fix.velocity_n, rtol=1e-6)
    np.testing.assert_allclose(gnss[10:13], fix.position_sigma, rtol=1e-6)
    assert gnss[13] == pytest.approx(np.sqrt(np.mean(fix.velocity_sigma**2))) and view.has_lock


def test_the_inertial_output_is_what_the_unit_measures_with_and_without_the_estimated_biases(driven):
    vehicle, found = driven[0], read(driven[1])
    simulation, air = vehicle.simulation, vehicle.view.air
    time, *values = found["012107"][-1]
    rate, force, raw_force, raw_rate, mag, (temperature, pressure) = np.split(np.array(values), [3, 6, 9, 12, 15])
    measured = simulation.last_increment / simulation.interval
    assert time == 70_000_000_000
    np.testing.assert_allclose(raw_rate, measured[:3], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(raw_force, measured[3:], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(rate, raw_rate - simulation.estimate["gyro_bias"], rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(force, raw_force - simulation.estimate["accel_bias"], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(mag, air.magnetic_b * 1e4, rtol=1e-6)
    np.testing.assert_allclose([temperature, pressure], [air.temperature - 273.15, air.pressure / 1e3], rtol=1e-6)


def test_a_slower_output_loses_no_increment():
    vehicle = quiet()
    unit = unit_of(vehicle)
    answers(unit, commands("VNWRG,75,3,8,01,0200"))
    forces = np.array(read(sent(unit, vehicle, 2.0))["010002"])
    sums = vehicle.simulation.increments
    np.testing.assert_allclose(forces.sum(axis=0) / 50.0, [*sums[3:], *sums[:3]], rtol=1e-5, atol=1e-5)  # at 50 Hz


@pytest.mark.parametrize("model", OLDER)
def test_masks_of_older_drivers_and_a_rate_above_that_of_the_samples(model):
    vehicle = quiet(hz=20)
    unit = unit_of(vehicle, model)
    masks, expected = OLDER[model]
    answers(unit, commands(*(f"VNWRG,{text}" for text in masks), "VNWRG,77,0,1,01,0001"))
    found = read(sent(unit, vehicle, 2.0))
    assert {header: len(each) for header, each in found.items()} == expected
    if model == "vn100":
        quaternion = vehicle.simulation.estimate["q_nb"]
        np.testing.assert_allclose(found["143e070400"][-1][-4:], quaternion[[1, 2, 3, 0]], rtol=1e-6, atol=1e-7)


def test_the_status_aligns_tracks_loses_gnss_and_comes_back():
    vehicle = quiet(hz=20)
    assert status(vehicle) == (1, set())
    steps(vehicle, 60.0)
    assert status(vehicle) == (2, {2})
    vehicle.set_gnss(False)
    steps(vehicle, 3.0)
    assert status(vehicle) == (3, {7})
    vehicle.set_gnss(True)
    steps(vehicle, 15.0)
    assert status(vehicle) == (2, {2})
    vehicle.disturb_gnss(2.0, (200.0, 0.0, 0.0))  # fixes that are refused: the receiver has one, the estimator none
    steps(vehicle, 2.75)
    assert status(vehicle) == (3, {2})
    steps(vehicle, 4.0)  # it has taken them for right, and is contradicted
    assert status(vehicle) == (1, {2})
    vehicle.realign()
    vehicle.disturb_gnss(0.0, (0.0, 0.0, 0.0))
    assert status(vehicle) == (1, {2})
    vehicle.simulation._filter.x[:] = np.nan
    assert status(vehicle)[0] == 0


@pytest.mark.parametrize(("changes", "expected"), [
    ({"gnss": {"outages_s": ((50.0, 90.0),)}}, (3, set())),
    ({"knowledge": DOUBTED}, (1, {2})),
    ({"knowledge": DOUBTED, "gnss": {"outages_s": ((50.0, 90.0),)}}, (3, set())),  # whatever the doubt
    ({"imu": {"gyro_range_deg_s": 0.001}}, (1, {2})),
    # with the heading of two antennas
    pytest.param({"imu": {"drop_probability": 0.999}, "heading": {}}, (1, {2, 5, 9, 10}), marks=pytest.mark.slow),
])  # fmt: skip
def test_failures_of_a_scenario_reach_the_bytes(changes, expected):
    vehicle = quiet(changed("car-city-drive", **changes), hz=20, estimator="fusion" if "heading" in changes else None)
    steps(vehicle, 60.0)
    assert status(vehicle) == expected


def test_the_commands_of_the_driver_are_answered_in_any_pieces():
    vehicle = quiet(hz=20)
    unit = unit_of(vehicle)
    asked = ["VNASY,0", "VNWRG,06,0,1", "VNWRG,06,1", "VNRRG,01", "VNWRG,75,3,16,01,0721", "VNRRG,75"]
    data = commands(*asked)
    rest, found = b"", ""
    for begin in range(0, len(data), 7):
        got, rest = unit.take(rest + data[begin : begin + 7])
        found += "".join(answer.decode() for _, answer in got)
    expected = [*asked[:3], "VNRRG,01,VN-300", asked[4], "VNRRG,75,3,16,01,0721"]
    assert found == commands(*expected).decode() and rest == b""
    assert sent(unit, vehicle, 1.0) == b""
    # a checksum of 16 bits (that in the comments of ArduPilot's driver), none, and what came before $
    answers(unit, b"\x00\xff$$VNWRG,75,3,16,01,0721*D415\r\n$VNASY,1*xx\n")
    assert not unit.refused and len(read(sent(unit, vehicle, 1.0))) == 3


@pytest.mark.parametrize("line", REFUSED)
def test_what_a_unit_lacks_is_refused_and_said(line):
    (model, text), (code, why) = line.split(), REFUSED[line]
    unit = Unit(MODELS[model], 200.0)
    before = dict(unit.registers)
    assert answers(unit, commands(text)) == commands(f"VNERR,{code:02X}").decode()
    assert answers(unit, b"$" + text.encode() + b"*00\r\n") == commands("VNERR,03").decode()
    (refusal, checksum) = unit.refused
    assert refusal.startswith(f"{text}: ") and why in refusal and "checksum 00" in checksum
    assert unit.registers == before


def test_outputs_must_fit_into_the_line():
    with pytest.raises(InputError, match="57600 baud: the outputs of the VN-300 need 221500"):
        Unit(MODELS["vn300"], 200.0, 57600)
    unit = Unit(MODELS["vn300"], 200.0, 230400)
    assert answers(unit, commands("VNWRG,76,3,2,31,0001,0106,0613")) == commands("VNERR,0C").decode()


def test_noise_is_no_command_and_a_flood_is_bounded():
    unit = Unit(MODELS["vn300"], 200.0)
    noise = np.random.default_rng(5).integers(0, 256, 100_000, dtype=np.uint8).tobytes()
    assert answers(unit, noise.replace(b"$", b"")) == "" and answers(unit, b"$" * 100_000) == ""
    assert len(unit.take(b"$" * 1000)[1]) == 256
    for begin in (b"VNASY,0,", b"VNWRG,06,", b"VNWRG,75,3,8,", b"VNRRG,1"):
        for at in range(0, 3000, 6):
            assert answers(unit, b"$" + begin + noise[at : at + 6] + b"*XX\n").isascii()
    unit = Unit(MODELS["vn300"], 200.0)
    assert answers(unit, noise[:999] + b"\n" + commands("VNRRG,1")) == commands("VNRRG,1,VN-300").decode()
    assert answers(unit, commands(*["VNRRG,1"] * 99)).count("VN-300") == 16
    for number in range(1000):
        answers(unit, commands(f"VNRRG,{number + 100}"))
    assert len(unit.refused) == 65 and unit.refused["others"] == 1000 - 64
