"""The simulated vehicle without a link: agreement with `insenv run`, answers, control."""

import json
from dataclasses import replace
from math import nan

import numpy as np
import pytest

from insenv import attitude, estimators, geodesy, run
from insenv.errors import InputError
from insenv.mavlink import Simulation, Vehicle
from insenv.mavlink.answers import HANDLERS, answers
from insenv.mavlink.commands import ACTIONS, names_by_number
from insenv.mavlink.manual import AXIS_UNUSED, Sticks
from insenv.mavlink.messages import DEFAULT_HZ
from insenv.mavlink.metadata import checksum
from insenv.mavlink.outbox import AT_ONCE, PEERS, WAITING, Outbox
from insenv.mavlink.pacing import BURST_MESSAGES, GIVE_UP_S, Pacer
from insenv.mavlink.parameters import NEVER, NEXT_ALIGNMENT, NOW
from insenv.mavlink.wire.further import DEFINITIONS
from insenv.scenario import build, load
from insenv.sensors.short_names import LONGEST_NAME, elements
from insenv.vehicles import AircraftSection, CarSection, ShipSection

common = pytest.importorskip("pymavlink.dialects.v20.common")

SILENT = dict.fromkeys(DEFAULT_HZ, 0.0)
UNSUPPORTED, DENIED, ACCEPTED = 3, 2, 0


def quiet(scenario="car-city-drive", **options):
    """A vehicle without streamed messages."""
    return Vehicle(load(scenario), rates=SILENT, **options)


def steps(vehicle, seconds):
    """Simulate `seconds`, and return the messages sent meanwhile."""
    return [message for _ in range(round(seconds / vehicle.simulation.interval)) for message in vehicle.step()]


def sent(name, *values, system=245, component=190):
    """A client's message as the vehicle reads it."""
    message = getattr(common, f"MAVLink_{name.lower()}_message")(*values)
    return common.MAVLink(None).decode(bytearray(message.pack(common.MAVLink(None, system, component))))


def answered(vehicle, message):
    """The answers as the client reads them; those that its pymavlink does not know as they are."""
    reader, sender = common.MAVLink(None), common.MAVLink(None, 1, 1)
    packed = [(m, bytearray(m.pack(sender))) for m in answers(vehicle, message)]
    return [m if m.get_type() in DEFINITIONS else reader.decode(frame) for m, frame in packed]


def command(vehicle, number, *parameters):
    """The result of a command, and the other answers."""
    padded = [*parameters, *[0.0] * (7 - len(parameters))]
    ack, *more = answered(vehicle, sent("COMMAND_LONG", 1, 1, number, 0, *padded))
    assert (ack.get_type(), ack.command, ack.target_system, ack.target_component) == ("COMMAND_ACK", number, 245, 190)
    return ack.result, more


def texts(vehicle):
    return [message.text for message in vehicle.texts()]


# --- agreement with a run ----------------------------------------------------------------------------


@pytest.mark.parametrize("scenario, estimator", [("car-city-drive", "loosely-coupled"), ("ship-swaying", "qakf")])
def test_estimates_are_those_of_a_run(scenario, estimator):
    result = run(load(scenario), [estimator], duration_s=20.0).results[0]
    vehicle = quiet(scenario, estimator=estimator)
    found = []
    for _ in range(4000):
        vehicle.step()
        found.append(vehicle.simulation.estimate["q_nb"].copy())
    every = round(4000 / len(result.time))
    np.testing.assert_array_equal(np.array(found)[every - 1 :: every], result.outputs["q_nb"])
    assert vehicle.simulation.time == pytest.approx(result.time[-1])


def test_a_lost_sample_is_bridged_by_the_one_before():
    vehicle = quiet()
    place = vehicle.parameters.find("S_IMU_DROP_PROB")
    vehicle.parameters.all[place].set(0.2)
    before = vehicle.simulation.increments.copy()
    for _ in range(400):
        held = vehicle.simulation.last_increment.copy()
        vehicle.step()
        truth = vehicle.simulation.truth
        shown = held if not truth["imu_valid"] else np.concatenate([truth["delta_angle"], truth["delta_velocity"]])
        np.testing.assert_array_equal(vehicle.simulation.last_increment, shown)
        np.testing.assert_allclose(vehicle.simulation.increments - before, shown, rtol=0, atol=1e-12)
        before = vehicle.simulation.increments.copy()
    assert 40 < vehicle.simulation.bridged < 130


def test_estimators_that_cannot_run_live_are_refused():
    with pytest.raises(InputError, match="loosely-coupled"):
        Simulation(load("car-city-drive"), "smoother")
    with pytest.raises(InputError, match="GNSS"):
        Simulation(load("ship-swaying"), "loosely-coupled")
    with pytest.raises(InputError, match="in place"):
        Simulation(load("car-city-drive"), "q-method")


# --- texts ------------------------------------------------------------------------------------------


def test_a_long_text_comes_in_chunks_that_give_it_back():
    """MAVLink: chunks of one text have its number, and count; a chunk that does not fill the field is the last."""
    vehicle = quiet()
    for text in ("x" * 49, "x" * 50, "short"):
        vehicle.announce(text)
        (message,) = vehicle.texts()
        assert (message.text, message.id, message.chunk_seq) == (text, 0, 0)
    numbers = set()
    for length in (51, 99, 100, 101, 250):
        text = "".join(chr(ord("a") + k % 26) for k in range(length))
        vehicle.announce(text)
        chunks = vehicle.texts()
        assert "".join(chunk.text for chunk in chunks) == text
        assert [chunk.chunk_seq for chunk in chunks] == list(range(len(chunks)))
        assert all(len(chunk.text) == 50 for chunk in chunks[:-1]) and len(chunks[-1].text) < 50
        (number,) = {chunk.id for chunk in chunks}
        numbers.add(number)
    assert len(numbers) == 5 and 0 not in numbers


# --- parameters --------------------------------------------------------------------------------------


def test_all_parameters_are_sent_as_real32_with_short_names():
    vehicle = quiet()
    listed = answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 1))
    assert len(listed) == len(vehicle.parameters) > 100
    assert [m.param_index for m in listed] == list(range(len(listed))) and {m.param_type for m in listed} == {9}
    ids = [m.param_id for m in listed]
    assert len(set(ids)) == len(ids) and all(len(name) <= LONGEST_NAME for name in ids)
    values = {m.param_id: m.param_value for m in listed}
    plant = vehicle.simulation.plant
    assert values["SIM_SPEED"] == 1 and values["SIM_RATE"] == 200 and values["E_INN_GATE"] == 5
    north = plant.parameters["gnss_position_noise"][0]
    assert values["S_GNSS_POS_N_N"] == pytest.approx(north, rel=1e-7)
    arw = np.degrees(plant.knowledge.sensors.angle_random_walk) * 60
    assert values["E_ANG_R_W"] == pytest.approx(arw, rel=1e-7)  # deg/sqrt(h)
    (one,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, b"E_INN_GATE", -1))
    assert one.param_value == 5 and one.param_id == "E_INN_GATE"
    (again,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, b"", one.param_index))
    assert again.param_id == "E_INN_GATE"
    for name, index in ((b"NONE", -1), (b"", 30000)):
        (wrong,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, name, index))
        assert (wrong.get_type(), wrong.param_id, wrong.param_index, wrong.error) == ("PARAM_ERROR", name.decode(), index, 1)
        assert (wrong.target_system, wrong.target_component) == (245, 190)
    (wrong,) = answered(vehicle, sent("PARAM_SET", 1, 1, b"NONE", 1.0, 9))
    assert (wrong.get_type(), wrong.error) == ("PARAM_ERROR", 1)


def test_every_estimator_and_plant_has_names_for_its_parameters():
    plants = [("S", build(load(name)).model) for name in ("ship-irregular-sea", "car-city-drive", "aircraft-survey")]
    for prefix, model in [*plants, *(("E", e.model) for e in estimators.registered().values())]:
        ids = [name for _, _, name in elements(prefix, model.parameters, model.parameters.names)]
        assert len(set(ids)) == len(ids) and all(len(name) <= LONGEST_NAME and name.isascii() for name in ids)


def set_parameter(vehicle, name, value, kind=9):
    answer, *wrong = answered(vehicle, sent("PARAM_SET", 1, 1, name.encode(), value, kind))
    parameter = vehicle.parameters.all[vehicle.parameters.find(name)]
    if wrong:
        assert [(m.get_type(), m.param_id, m.error) for m in wrong] == [
            ("PARAM_ERROR", name, 5 if parameter.acts == NEVER else 2)
        ]
    assert bool(wrong) == (answer.param_value != np.float32(value) or kind != 9)
    return answer.param_value


def test_a_parameter_acts_at_once_or_announces_when():
    vehicle, untouched = quiet(), quiet()
    assert set_parameter(vehicle, "E_ANG_R_W", 30.0) == 30.0
    steps(vehicle, 2.0), steps(untouched, 2.0)
    assert vehicle.simulation.estimate["attitude_sigma"][0] > 1.5 * untouched.simulation.estimate["attitude_sigma"][0]
    np.testing.assert_array_equal(vehicle.simulation.truth["q_nb"], untouched.simulation.truth["q_nb"])
    assert {p.acts for p in vehicle.parameters.all} == {NOW, NEXT_ALIGNMENT, NEVER}

    vehicle.texts()
    assert set_parameter(vehicle, "E_HDG_SIG", 90.0) == 90.0
    assert texts(vehicle) == ["E_HDG_SIG: acts at next alignment"]
    vehicle.realign()
    assert np.degrees(vehicle.simulation.estimate["attitude_sigma"][2]) == pytest.approx(90.0)
    (answer,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, b"E_ANG_R_W", -1))
    assert answer.param_value == 30.0  # it stays in force


def test_the_undulation_is_given_before_the_start():
    vehicle = quiet(undulation=47.0)
    (answer,) = answered(vehicle, sent("PARAM_REQUEST_READ", 1, 1, b"SIM_UNDULATION", -1))
    assert answer.param_value == 47.0 and vehicle.view.undulation == 47.0
    assert set_parameter(vehicle, "SIM_UNDULATION", 0.0) == 47.0 and vehicle.view.undulation == 47.0
    assert texts(vehicle) == ["SIM_UNDULATION cannot be set during a run"]
    for wrong in (121.0, -121.0, nan):
        with pytest.raises(InputError, match="allowed is -120 to 120 m"):
            quiet(undulation=wrong)


def test_noise_of_the_receiver_can_be_set_live():
    vehicle = quiet()
    for axis in "NED":
        set_parameter(vehicle, f"S_GNSS_POS_N_{axis}", 500.0)
    vehicle.simulation.gnss_on = True
    errors = []
    for _ in range(3000):
        vehicle.step()
        fix, truth = vehicle.simulation.fix, vehicle.simulation.truth
        if truth["gnss_valid"]:
            errors.append((fix.height - float(truth["height"])) / 500.0)
    assert 0.4 < np.std(errors) < 2.0 and len(errors) == 14


@pytest.mark.parametrize(
    "name, value, kind",
    [
        ("E_INN_GATE", nan, 9), ("E_INN_GATE", -1.0, 9), ("E_INN_GATE", 6.0, 6), ("S_GYR_BIAS_X", 1.0, 9),
        ("SIM_RATE", 100.0, 9), ("SIM_UNDULATION", 47.0, 9),
        ("SIM_SPEED", 1e9, 9), ("E_COV_DT", float("inf"), 9), ("E_ST_LAT", 1.0, 9),
    ],
)  # fmt: skip
def test_a_wrong_value_changes_nothing_and_is_announced(name, value, kind):
    vehicle = quiet()
    before = vehicle.parameters.all[vehicle.parameters.find(name)].value()
    assert set_parameter(vehicle, name, value, kind) == pytest.approx(before, rel=1e-7)
    assert any(name in text for text in texts(vehicle))


# --- commands ----------------------------------------------------------------------------------------


def test_every_command_is_answered():
    vehicle = quiet()
    for number in (0, 1, 16, 176, 300, 511, 65535, *ACTIONS):
        for parameters in ([0.0] * 7, [nan] * 7, [float("inf")] * 7, [1e30] * 7):
            result, _ = command(vehicle, number, *parameters)
            assert result == UNSUPPORTED if number not in ACTIONS else result in (0, 1, 2, 3)
    (ack,) = answered(vehicle, sent("COMMAND_INT", 1, 1, 0, 31011, 0, 0, 0.0, 0, 0, 0, 0, 0, 0))
    assert (ack.get_type(), ack.result) == ("COMMAND_ACK", ACCEPTED) and not vehicle.simulation.gnss_on


def test_gnss_is_switched_off_and_on():
    vehicle = quiet()
    steps(vehicle, 60.5)  # moving: at standstill the estimator would use that
    fixes = vehicle.simulation.fixes
    assert fixes == 60 and vehicle.view.has_lock
    assert command(vehicle, 31011, 0.0)[0] == ACCEPTED
    before = float(vehicle.simulation.estimate["position_sigma"][0])
    steps(vehicle, 4.0)
    assert vehicle.simulation.fixes == fixes and not vehicle.view.has_lock
    assert vehicle.simulation.estimate["position_sigma"][0] > before
    assert vehicle.make("GPS_RAW_INT").fix_type == 1 and not vehicle.make("SYS_STATUS").onboard_control_sensors_health & 32
    assert command(vehicle, 31011, 1.0)[0] == ACCEPTED
    steps(vehicle, 2.0)
    assert vehicle.simulation.fixes == fixes + 2 and vehicle.view.has_lock
    assert command(vehicle, 31011, 0.5)[0] == DENIED
    assert command(quiet("ship-swaying"), 31011, 0.0)[0] == DENIED


def test_a_receiver_that_is_off_is_an_outage_to_the_estimator():
    """The estimate is bit-identical to that of an outage window of the scenario."""
    cut = quiet()
    steps(cut, 5.5)
    cut.set_gnss(False)
    steps(cut, 4.0)
    with_outage = load("car-city-drive")
    gnss = with_outage.gnss.model_copy(update={"outages_s": ((5.5, 9.5),)})
    other = Vehicle(with_outage.model_copy(update={"gnss": gnss}), rates=SILENT)
    steps(other, 9.5)
    np.testing.assert_array_equal(cut.simulation.estimate["q_nb"], other.simulation.estimate["q_nb"])
    assert float(cut.simulation.estimate["height"]) == float(other.simulation.estimate["height"])


def test_a_new_alignment_starts_with_the_errors_of_the_first():
    vehicle = quiet("car-city-drive")
    first = vehicle.simulation
    start_error = attitude.numeric.error_rotation_vector(first.estimate["q_nb"], first.truth["q_nb"])
    steps(vehicle, 60.0)
    assert first.truth["velocity_n"][0] ** 2 + first.truth["velocity_n"][1] ** 2 > 25
    assert command(vehicle, 31010)[0] == ACCEPTED and first.alignments == 2
    error = attitude.numeric.error_rotation_vector(first.estimate["q_nb"], first.truth["q_nb"])
    assert np.linalg.norm(error) == pytest.approx(np.linalg.norm(start_error), rel=0.2) and np.linalg.norm(error) > 1e-3
    assert np.linalg.norm(first.estimate["velocity_n"] - first.truth["velocity_n"]) < 1.0
    message = vehicle.make("ATTITUDE")
    assert message.yaw == pytest.approx(float(attitude.numeric.to_euler(first.estimate["q_nb"])[2]), abs=1e-9)
    steps(vehicle, 30.0)
    assert vehicle.view.state == "navigating"


def test_a_diverged_estimate_is_announced_and_not_sent():
    vehicle = Vehicle(load("car-city-drive"))
    steps(vehicle, 2.5)
    vehicle.simulation._filter.x[:] = nan
    said = steps(vehicle, 2.0)
    kinds = {m.get_type() for m in said}
    position = {"GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "ODOMETRY", "ALTITUDE"}
    estimated = position | {"ATTITUDE", "ATTITUDE_QUATERNION", "VFR_HUD"}
    assert not kinds & estimated and {"HIL_SENSOR", "HIL_STATE_QUATERNION", "GPS_RAW_INT", "ESTIMATOR_STATUS"} <= kinds
    assert vehicle.view.fields.refused["GLOBAL_POSITION_INT.lat"] == 20
    assert [m.text for m in said if m.get_type() == "STATUSTEXT"] == ["estimate diverged: start a new alignment"]
    assert not vehicle.make("SYS_STATUS").onboard_control_sensors_health & 1 << 28
    assert command(vehicle, 31010)[0] == ACCEPTED
    assert estimated <= {m.get_type() for m in steps(vehicle, 2.0)} and vehicle.view.state == "aligning"


def test_pause_speed_and_arming():
    vehicle = quiet()
    assert command(vehicle, 31012, 1.0)[0] == ACCEPTED and vehicle.paused
    assert command(vehicle, 31012, 0.0)[0] == ACCEPTED and not vehicle.paused
    assert command(vehicle, 31013, 4.0)[0] == ACCEPTED and vehicle.speed == 4.0
    assert command(vehicle, 31013, -1.0)[0] == DENIED and vehicle.speed == 4.0
    assert set_parameter(vehicle, "SIM_PAUSE", 1.0) == 1.0 and vehicle.paused
    assert vehicle.make("HEARTBEAT").base_mode & 128
    assert command(vehicle, 400, 0.0)[0] == ACCEPTED and not vehicle.make("HEARTBEAT").base_mode & 128


def test_messages_are_requested_and_timed():
    vehicle = quiet()
    steps(vehicle, 2.5)
    for number, name in names_by_number().items():
        result, more = command(vehicle, 512, float(number))
        if name == "HIL_GPS" and not more:
            assert result == 1  # a fix is sent once
            continue
        assert (result, [m.get_type() for m in more]) == (ACCEPTED, [name] * (2 if name == "AVAILABLE_MODES" else 1))
    assert command(vehicle, 512, 437.0) == (UNSUPPORTED, [])
    assert command(vehicle, 520)[1][0].get_type() == "AUTOPILOT_VERSION"
    assert command(vehicle, 410)[1][0].get_type() == "HOME_POSITION"
    attitude_id = 30.0
    assert command(vehicle, 511, attitude_id, 10_000.0)[0] == ACCEPTED
    sent_now = [m.get_type() for _ in range(200) for m in vehicle.step()]
    assert sent_now.count("ATTITUDE") == 100
    assert command(vehicle, 510, attitude_id)[1][0].interval_us == 10_000
    assert command(vehicle, 512, 244.0, attitude_id)[1][0].interval_us == 10_000
    assert command(vehicle, 511, attitude_id, -1.0)[0] == ACCEPTED
    assert command(vehicle, 510, attitude_id)[1][0].interval_us == -1
    assert command(vehicle, 511, attitude_id, 0.0)[0] == ACCEPTED and vehicle.schedule.rates["ATTITUDE"] == 20
    assert command(vehicle, 511, attitude_id, -5.0)[0] == DENIED and command(vehicle, 511, 9999.0, 1.0)[0] == UNSUPPORTED


def test_data_streams_leave_rates_of_the_command_line_alone():
    vehicle = Vehicle(load("car-city-drive"), rates={"ATTITUDE": 33.0})
    assert not answered(vehicle, sent("REQUEST_DATA_STREAM", 1, 1, 0, 4, 1))
    rates = vehicle.schedule.rates
    assert (rates["ATTITUDE"], rates["VFR_HUD"], rates["HIL_SENSOR"], rates["HEARTBEAT"]) == (33.0, 4.0, 200.0, 1.0)
    answered(vehicle, sent("REQUEST_DATA_STREAM", 1, 1, 6, 4, 0))
    assert rates["GLOBAL_POSITION_INT"] == 0 and rates["VFR_HUD"] == 4.0


# --- steering ------------------------------------------------------------------------------------------


def steer(vehicle, x, y, z, r):
    assert not answered(vehicle, sent("MANUAL_CONTROL", 1, x, y, z, r, 0))


def test_a_car_is_driven_by_manual_control_and_stops_without_it():
    vehicle = quiet()
    said = []
    for _ in range(80):  # 10 s at 8 Hz
        steer(vehicle, 0, 0, 600, 500)
        said += steps(vehicle, 0.125)
    truth = vehicle.simulation.truth
    speed = np.hypot(*truth["velocity_n"][:2])
    assert speed == pytest.approx(0.6 * vehicle.sticks.full_scale["SPEED"], rel=0.02)
    turned = np.degrees(float(vehicle.view.values["true_rate_nb_b"][2]))
    rates = []
    for _ in range(200):
        said += vehicle.step()
        rates.append(np.degrees(float(vehicle.view.values["true_rate_nb_b"][2])))
    assert abs(np.mean(rates) - 0.5 * vehicle.sticks.full_scale["TURN"]) < 0.5 and abs(turned) < 30
    said += steps(vehicle, 12.0)
    assert np.hypot(*truth["velocity_n"][:2]) < 0.05
    assert [m.text for m in said] == ["manual control: the script has ended", "manual control lost"]


def test_an_aircraft_banks_and_climbs():
    vehicle = quiet("aircraft-inflight-alignment")
    before = float(vehicle.simulation.truth["height"])
    for _ in range(40):
        steer(vehicle, -1000, 500, 1000, AXIS_UNUSED)
        steps(vehicle, 0.5)
    roll = np.degrees(float(attitude.numeric.to_euler(vehicle.simulation.truth["q_nb"])[0]))
    assert 10 < roll < 20 and float(vehicle.simulation.truth["height"]) > before + 50


def test_vehicles_that_cannot_be_steered_announce_it_once():
    for scenario, why in (("ship-swaying", "aligning in place"), ("car-parked", "aligning in place")):
        vehicle = quiet(scenario)
        for _ in range(5):
            steer(vehicle, 0, 0, 1000, 0)
        assert texts(vehicle) == [f"no manual control: {why}"]
    prescribed = quiet("large-misalignment")
    steer(prescribed, 0, 0, 1000, 0)
    assert texts(prescribed) == ["no manual control: motion is prescribed"]
    with pytest.raises(InputError, match="prescribed"):
        prescribed.simulation.command({"speed": 1.0})


def test_missing_axes_command_nothing():
    car, ship, aircraft = (Sticks(section.traits.sticks) for section in (CarSection, ShipSection, AircraftSection))
    assert car.commanded(0, AXIS_UNUSED, AXIS_UNUSED, AXIS_UNUSED) == {}
    assert car.commanded(0, 500, 0, 0) == {"speed": 0.0, "yaw_rate": pytest.approx(np.radians(10.0))}
    assert car.commanded(0, AXIS_UNUSED, AXIS_UNUSED, 0) == {"yaw_rate": 0.0} == car.commanded(0, 0, AXIS_UNUSED, AXIS_UNUSED)
    assert ship.commanded(0, 500, -300, -1000) == {"speed": 0.0, "turn_rate": pytest.approx(-np.radians(3.0))}
    full = {"speed": 80.0, "bank": pytest.approx(np.radians(30.0)), "climb_rate": 5.0}
    assert aircraft.commanded(-32768, 32766, 9999, 0) == full
    assert aircraft.released() == {"bank": 0.0, "climb_rate": 0.0} and car.released() == {"speed": 0.0, "yaw_rate": 0.0}


def test_every_stick_command_is_a_command_of_its_vehicle():
    for scenario in ("ship-underway", "car-city-drive", "aircraft-survey"):
        plant = build(load(scenario))
        sticks = plant.scenario.vehicle.traits.sticks
        rows = [plant.model.inputs.names.index(f"command_{stick.command}") for stick in sticks]
        assert rows == sorted(rows)


# --- interference --------------------------------------------------------------------------------------


def fixes_and_errors(vehicle, seconds):
    """The fixes delivered in `seconds`, and the displacement of each from the undisturbed one (3, m, n)."""
    twin = quiet()
    steps(twin, vehicle.simulation.time)
    found = []
    for _ in range(round(seconds / vehicle.simulation.interval)):
        before = vehicle.simulation.fixes
        vehicle.step(), twin.step()
        if vehicle.simulation.fixes > before:
            fix, clean = vehicle.simulation.fix, twin.simulation.fix
            place = (clean.latitude, clean.longitude, clean.height)
            moved = np.ravel(geodesy.numeric.ned_offset(fix.latitude, fix.longitude, fix.height, *place))
            found.append((vehicle.simulation.time, moved, fix, clean))
    return found


def test_spoofing_and_drift_displace_the_fixes_and_mislead_the_estimate():
    vehicle = quiet()
    steps(vehicle, 10.5)
    assert command(vehicle, 31014, 2.0, 3.0, -4.0, 1.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: spoofing"
    for _, moved, fix, clean in fixes_and_errors(vehicle, 5.0):
        np.testing.assert_allclose(moved, [3.0, -4.0, 1.0], atol=1e-3)
        np.testing.assert_array_equal(fix.position_sigma, clean.position_sigma)  # the receiver does not notice
    begun = vehicle.simulation.time
    assert command(vehicle, 31014, 3.0, 0.0, 0.5, 0.0)[0] == ACCEPTED
    for time, moved, fix, clean in fixes_and_errors(vehicle, 5.0):
        np.testing.assert_allclose(moved, [0.0, 0.5 * (time - begun), 0.0], atol=1e-3)
        np.testing.assert_allclose(fix.velocity_n - clean.velocity_n, [0.0, 0.5, 0.0], atol=1e-12)
    assert command(vehicle, 31014, 0.0)[0] == ACCEPTED and texts(vehicle)[-1] == "GNSS: undisturbed"
    assert all(not np.any(moved) for _, moved, _, _ in fixes_and_errors(vehicle, 3.0))


def test_jamming_loses_fixes_and_lost_satellites_make_them_worse():
    jammed = quiet()
    assert command(jammed, 31014, 1.0, 0.5)[0] == ACCEPTED
    steps(jammed, 100.0)
    assert 30 < jammed.simulation.fixes < 70
    command(jammed, 31014, 1.0, 1.0)
    before = jammed.simulation.fixes
    steps(jammed, 5.0)
    assert jammed.simulation.fixes == before and not jammed.view.has_lock
    again = quiet()
    command(again, 31014, 1.0, 0.5)
    steps(again, 100.0)
    assert again.simulation.fixes == before  # a function of seed and fix number
    few = quiet()
    assert command(few, 31014, 4.0, 10.0)[0] == ACCEPTED
    found = fixes_and_errors(few, 60.0)
    for _, _, fix, clean in found:
        np.testing.assert_allclose(fix.position_sigma, 10.0 * clean.position_sigma)
    scaled = np.array([moved / (np.sqrt(99.0) * clean.position_sigma) for _, moved, _, clean in found])
    assert 0.8 < np.std(scaled) < 1.2 and len(found) >= 58


@pytest.mark.parametrize("values", [(5.0,), (0.5,), (nan,), (1.0, 1.5), (1.0, nan), (2.0, 1e9), (4.0, 0.5), (3.0, 1.0, nan)])
def test_wrong_interference_is_refused(values):
    vehicle = quiet()
    assert command(vehicle, 31014, *values)[0] == DENIED and vehicle.simulation.interference is None
    assert "allowed is" in texts(vehicle)[-1]
    assert command(quiet("ship-swaying"), 31014, 1.0, 1.0)[0] == DENIED


# --- several vehicles, states, errors ------------------------------------------------------------------


def test_vehicles_beside_one_another_have_systems_of_their_own():
    first, second = quiet(), quiet(system=2)
    off = sent("COMMAND_LONG", 2, 1, 31011, 0, *[0.0] * 7)
    assert not answered(first, off) and first.simulation.gnss_on
    assert [m.get_type() for m in answered(second, off)] == ["COMMAND_ACK"] and not second.simulation.gnss_on
    assert not answered(second, sent("PARAM_REQUEST_READ", 1, 1, b"SIM_RATE", -1))
    # a command of the other vehicle is a command; what a vehicle sent itself is not
    assert answered(second, sent("PING", 1, 1, 0, 0, system=1, component=1))
    assert not answered(second, sent("PING", 1, 1, 0, 0, system=2, component=1))
    assert first.make("AUTOPILOT_VERSION").uid != second.make("AUTOPILOT_VERSION").uid
    for wrong in (0, 256):
        with pytest.raises(InputError, match="1 to 255"):
            quiet(system=wrong)


def test_the_heartbeat_tells_boot_aligning_and_aligned():
    ship = quiet("ship-swaying")
    states = [ship.make("HEARTBEAT").system_status]
    for seconds in (1.0, 100.0):  # q-method needs 100 s
        steps(ship, seconds)
        states.append(ship.make("HEARTBEAT").system_status)
    assert states == [common.MAV_STATE_BOOT, common.MAV_STATE_STANDBY, common.MAV_STATE_ACTIVE]
    ship.simulation._filter.x[:] = nan
    steps(ship, 0.01)
    assert ship.make("HEARTBEAT").system_status == common.MAV_STATE_CRITICAL


def test_an_estimate_that_its_estimator_warns_of_is_not_aligned():
    """With a given attitude ecef-kf states small sigmas at once; whether it may be trusted is in its notes."""
    sentence = "heading is good to 55 deg only: a gyro error of 9.91 deg/h"

    def warned(parameters, duration_s):
        assert parameters["angle_random_walk"] > 0.0
        return (sentence,) if duration_s < 4.0 else ()

    warning = replace(estimators.get("ecef-kf"), applicability=warned, needs=None)
    ship = Vehicle(load("static-ecef"), warning, rates={**SILENT, "HEARTBEAT": 1.0})
    assert ship.view.tilt_sigma_deg < 1 and ship.view.heading_sigma_deg < 5
    found = steps(ship, 6.0)
    states = [m.system_status for m in found if m.get_type() == "HEARTBEAT"]
    assert states == [3, 3, 3, 4, 4, 4]
    assert [m.text for m in found if m.get_type() == "STATUSTEXT"] == [sentence.partition(":")[0], "aligned"]
    assert ship.make("SYS_STATUS").onboard_control_sensors_health & 1 << 28
    ship.realign()
    steps(ship, 1.0)
    assert ship.view.state == "aligning"  # the time counts from the new alignment


def reported(name, error_deg):
    """A vehicle whose reported heading is off by an angle, with the scenario's standard deviation of a few degrees."""
    scenario = load(name)
    return quiet(
        scenario.model_copy(update={"knowledge": scenario.knowledge.model_copy(update={"heading_error_deg": error_deg})})
    )


@pytest.mark.parametrize(("name", "seconds"), [("aircraft-survey", 60), ("car-city-drive", 60), ("ship-underway", 300)])
def test_a_wrong_reported_heading_is_never_aligned(name, seconds):
    """It counts as aligned only where the filter has found the true heading: car and aircraft do so as they accelerate."""
    vehicle = reported(name, 20.0)
    assert vehicle.view.heading_sigma_deg < 5.0 and vehicle.view.state == "aligning"
    for _ in range(seconds):
        steps(vehicle, 1.0)
        right = abs(vehicle.view.errors["heading"]) < 3 * vehicle.view.heading_sigma_deg
        assert vehicle.view.state == "aligning" or right
        aligned = bool(vehicle.make("SYS_STATUS").onboard_control_sensors_health & 1 << 28)
        assert aligned == (vehicle.view.state != "aligning")
    assert name == "ship-underway" or right


def test_a_right_reported_heading_is_aligned_once_fixes_could_contradict_it():
    """The car stands for 30 s, then accelerates to 12 m/s."""
    car = quiet("car-city-drive")
    for _ in range(30):
        steps(car, 1.0)
        assert car.view.state == "aligning" and car.view.doubt.startswith("heading as reported; ")
    steps(car, 10.0)
    assert car.view.state == "navigating" and car.view.doubt == ""
    assert abs(car.view.errors["heading"]) < 1.0
    car.realign()
    assert car.view.state == "aligning"  # the fixes count from the new alignment
    car.parameters.all[car.parameters.find("E_HDG_SIG")].set(90.0)  # acts at the next alignment: 3 deg are in force
    assert np.degrees(car.simulation.reported_heading_sigma) == pytest.approx(3.0)


def test_a_filter_that_the_fixes_contradict_is_not_aligned():
    car = quiet("car-city-drive")
    steps(car, 40.0)
    assert car.view.state == "navigating"
    car.disturb_gnss(2, (60.0, 0.0, 0.0))  # spoofing
    steps(car, 8.0)
    assert car.view.state == "aligning" and car.view.doubt.startswith("filter diverged: ")


def test_errors_against_the_truth_are_sent_on_request():
    car = Vehicle(load("car-city-drive"), rates={**SILENT, "HEARTBEAT": 1.0}, show_errors=True)
    sent_errors = [m for m in steps(car, 2.0) if m.get_type() == "NAMED_VALUE_FLOAT"]
    assert len(sent_errors) == 8
    found = {m.name: m.value for m in sent_errors[4:]}
    estimate, truth = car.simulation.estimate, car.simulation.truth
    c_error = attitude.numeric.to_dcm(estimate["q_nb"]) @ attitude.numeric.to_dcm(truth["q_nb"]).T
    heading = np.degrees(np.arctan2(c_error[1, 0] - c_error[0, 1], 2.0))
    tilt = np.degrees(np.hypot(c_error[2, 1] - c_error[1, 2], c_error[0, 2] - c_error[2, 0]) / 2.0)
    assert found["ERR_HDG"] == pytest.approx(heading, rel=1e-2) and found["ERR_TILT"] == pytest.approx(tilt, rel=1e-2)
    assert found["ERR_VEL"] == pytest.approx(np.linalg.norm(estimate["velocity_n"] - truth["velocity_n"]), rel=1e-6)
    apart = 6.37e6 * np.hypot(
        estimate["latitude"] - truth["latitude"], np.cos(truth["latitude"]) * (estimate["longitude"] - truth["longitude"])
    )
    assert found["ERR_POS"] == pytest.approx(np.hypot(apart, estimate["height"] - truth["height"]), rel=1e-2)
    assert not [m for m in steps(Vehicle(load("car-city-drive")), 1.0) if m.get_type() == "NAMED_VALUE_FLOAT"]


# --- unsupported services ------------------------------------------------------------------------------


def transfer(vehicle, opcode, data=b"", *, sequence=0, session=0, offset=0, size=None):
    """The payloads that answer a request of FILE_TRANSFER_PROTOCOL."""
    request = bytearray(251)
    request[0:2], request[2], request[3] = sequence.to_bytes(2, "little"), session, opcode
    request[4], request[8:12], request[12 : 12 + len(data)] = (
        len(data) if size is None else size,
        offset.to_bytes(4, "little"),
        data,
    )
    found = answered(vehicle, sent("FILE_TRANSFER_PROTOCOL", 0, 1, 1, list(request)))
    assert all((m.target_system, m.target_component) == (245, 190) for m in found)
    return [bytes(m.payload) for m in found]


def test_file_transfer_is_refused_with_the_next_number_and_the_same_session():
    vehicle = quiet()
    (reply,) = transfer(vehicle, 4, b"@PARAM/param.pck?withdefaults=1", sequence=65535, session=7)
    assert reply[:6] == bytes([0, 0, 7, 129, 1, 4]) and reply[12] == 10
    assert not transfer(vehicle, 129) and not transfer(vehicle, 0)  # answers are not answered
    for opcode, error in ((6, 9), (8, 9), (99, 7), (5, 4)):
        (reply,) = transfer(vehicle, opcode, b"/x", session=9)
        assert (reply[3], reply[5], reply[12]) == (129, opcode, error)
    for opcode in (1, 2):
        assert [reply[3] for reply in transfer(vehicle, opcode)] == [128]


@pytest.mark.parametrize("burst", [False, True])
def test_names_units_and_ranges_of_parameters_are_read_as_component_metadata(burst):
    vehicle = quiet()
    result, (offered,) = command(vehicle, 512, 397.0)
    assert (result, offered.get_type(), offered.uri) == (ACCEPTED, "COMPONENT_METADATA", b"mftp:///general.json")

    def read(uri):
        (opened,) = transfer(vehicle, 4, uri.removeprefix("mftp://").encode())
        assert opened[3] == 128
        session, length, content = opened[2], int.from_bytes(opened[12:16], "little"), b""
        while True:
            replies = transfer(vehicle, 15 if burst else 5, session=session, offset=len(content), size=239)
            numbers = [int.from_bytes(reply[:2], "little") for reply in replies]
            assert numbers == list(range(1, len(replies) + 1)) and (not burst or replies[-1][6] or replies[-1][3] == 129)
            for reply in replies:
                if reply[3] == 129:
                    assert reply[12] == 6 and len(content) == length  # the end of the file
                    return content
                assert int.from_bytes(reply[8:12], "little") == len(content)
                content += reply[12 : 12 + reply[4]]

    general = read("mftp:///general.json")
    (entry,) = json.loads(general)["metadataTypes"]
    assert checksum(general) == offered.file_crc and entry["type"] == 1
    parameters = read(entry["uri"])
    assert checksum(parameters) == entry["fileCrc"]
    (crc,) = transfer(vehicle, 14, b"/parameter.json")
    assert int.from_bytes(crc[12:16], "little") == entry["fileCrc"]
    listed = {row["name"]: row for row in json.loads(parameters)["parameters"]}
    assert list(listed) == [parameter.name for parameter in vehicle.parameters.all]
    gate = listed["E_INN_GATE"]
    assert (gate["type"], gate["min"], gate["readOnly"]) == ("Float", 0.0, False) and gate["shortDesc"]
    assert listed["SIM_RATE"]["readOnly"] is True and listed["E_ANG_R_W"]["units"] == "deg/sqrt(h)"


def test_the_checksum_of_files_is_that_of_mavlink():
    """Bit by bit, as the specification defines it: polynomial 0xEDB88320, start 0, no inversion."""
    register = 0
    for byte in b"123456789":
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ (0xEDB88320 if register & 1 else 0)
    assert checksum(b"123456789") == register == 0x2DFD2D88


def test_modes_are_named_and_follow_from_what_steers():
    vehicle = quiet()
    assert [m.mode_name.decode() for m in command(vehicle, 512, 435.0)[1]] == ["Scenario", "Manual control"]
    assert [m.mode_name.decode() for m in command(vehicle, 512, 435.0, 2.0)[1]] == ["Manual control"]
    assert command(vehicle, 512, 435.0, 3.0)[0] == DENIED
    assert (vehicle.make("HEARTBEAT").custom_mode, vehicle.make("CURRENT_MODE").custom_mode) == (0, 0)
    assert command(vehicle, 176, 1.0, 0.0)[0] == ACCEPTED and command(vehicle, 176, 1.0, 1.0)[0] == DENIED
    assert texts(vehicle) == ["mode Manual control: not by command"]
    (ack,) = answered(vehicle, sent("SET_MODE", 1, 1, 7))
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 176, DENIED)
    answered(vehicle, sent("MANUAL_CONTROL", 1, 0, 0, 500, 0, 0))
    assert (vehicle.make("HEARTBEAT").custom_mode, vehicle.make("CURRENT_MODE").custom_mode) == (1, 1)
    assert [m.mode_name.decode() for m in command(quiet("ship-swaying"), 512, 435.0)[1]] == ["Scenario"]


def test_clients_are_told_that_there_are_no_missions_logs_and_older_protocols():
    vehicle = quiet()
    capabilities = vehicle.make("AUTOPILOT_VERSION").capabilities
    for name in ("MISSION_INT", "MISSION_FENCE", "MISSION_RALLY", "PARAM_FLOAT", "COMMAND_INT", "FTP", "MAVLINK2"):
        assert capabilities & getattr(common, f"MAV_PROTOCOL_CAPABILITY_{name}"), name
    assert [m.max_version for m in command(vehicle, 519)[1]] == [200] == [m.version for m in command(vehicle, 512, 300.0)[1]]
    (current,) = answered(vehicle, sent("MISSION_SET_CURRENT", 1, 1, 4))
    assert (current.get_type(), current.seq, current.total, current.mission_state) == ("MISSION_CURRENT", 0, 0, 1)
    (data,) = answered(vehicle, sent("LOG_REQUEST_DATA", 1, 1, 3, 90, 180))
    assert (data.get_type(), data.id, data.ofs, data.count) == ("LOG_DATA", 3, 90, 0)


def test_missions_logs_clocks_and_pings():
    vehicle = quiet()
    steps(vehicle, 1.0)
    for kind in (0, 1, 2):
        (count,) = answered(vehicle, sent("MISSION_REQUEST_LIST", 1, 1, kind))
        assert (count.count, count.mission_type, count.target_system) == (0, kind, 245)
    for kind in (3, 9, 255):
        (refusal,) = answered(vehicle, sent("MISSION_REQUEST_LIST", 1, 1, kind))
        assert (refusal.get_type(), refusal.type, refusal.mission_type) == ("MISSION_ACK", 3, kind)
    assert [m.type for m in answered(vehicle, sent("MISSION_COUNT", 1, 1, 5, 0))] == [3]
    assert [m.type for m in answered(vehicle, sent("MISSION_CLEAR_ALL", 1, 1, 0))] == [0]
    assert [m.num_logs for m in answered(vehicle, sent("LOG_REQUEST_LIST", 1, 1, 0, 65535))] == [0]
    (clock,) = answered(vehicle, sent("TIMESYNC", 0, 1234))
    assert (clock.tc1, clock.ts1) == (1_000_000_000, 1234) and not answered(vehicle, sent("TIMESYNC", 5, 1234))
    (echo,) = answered(vehicle, sent("PING", 99, 3, 0, 0))
    assert (echo.seq, echo.target_system) == (3, 245) and not answered(vehicle, sent("PING", 99, 3, 1, 1))


def test_messages_for_others_are_ignored():
    vehicle = quiet()
    assert not answered(vehicle, sent("PARAM_REQUEST_LIST", 2, 1)) and not answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 100))
    assert not answered(vehicle, sent("COMMAND_LONG", 7, 1, 31010, 0, *[0.0] * 7)) and vehicle.simulation.alignments == 1
    assert not answered(vehicle, sent("PARAM_REQUEST_LIST", 1, 1, system=1, component=1))  # our own, returned
    assert len(answered(vehicle, sent("PARAM_REQUEST_LIST", 0, 0))) == len(vehicle.parameters)
    for name in ("HEARTBEAT", "COMMAND_ACK", "PARAM_VALUE", "NAMED_VALUE_FLOAT"):
        assert name not in HANDLERS
    assert not answered(vehicle, sent("ATTITUDE", 1000, *[0.0] * 6))


# --- outbox and pacing ---------------------------------------------------------------------------------


def test_answers_are_bounded_and_each_peer_has_its_turn():
    outbox, out = Outbox(), []
    for peer in ("a", "b"):
        for _ in range(WAITING + 50):
            outbox.put(peer, [peer])
    assert outbox.dropped == 100
    while outbox.send(lambda peer, message: out.append((peer, message))):
        assert len(out) <= 2 * WAITING
    assert out[:4] == [("a", "a"), ("b", "b")] * 2 and out.count(("a", "a")) == out.count(("b", "b")) == WAITING
    for number in range(PEERS + 10):
        outbox.put(number, [0])
    assert outbox.dropped == 110
    assert outbox.send(lambda *_: None) == AT_ONCE
    # all parameters requested repeatedly: one list is pending
    fresh, out = Outbox(), []
    for _ in range(1000):
        fresh.put("a", iter(range(40)))
        fresh.put("b", iter(range(40)))
    while fresh.send(lambda peer, message: out.append(peer)):
        pass
    assert out.count("a") == out.count("b") == 40


class Clock:
    def __init__(self):
        self.now, self.slept = 0.0, []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds


def test_deadlines_are_absolute_and_bursts_have_pauses():
    clock = Clock()
    pacer = Pacer(0.005, 2.0, clock, clock.sleep)
    for _ in range(1000):
        pacer.wait(lambda: True)
        clock.now += 0.001  # the time that a sample takes
    assert clock.now == pytest.approx(2.5 + 0.001, abs=1e-9) and pacer.lateness(1.0) < 1e-9
    clock.now += 1.0  # a stall of 400 samples: caught up, in bursts
    clock.slept.clear()
    for _ in range(400):
        pacer.wait(lambda: True)
        pacer.sent(2)
    assert len(clock.slept) >= 400 * 2 // BURST_MESSAGES - 1 and pacer.slips == 0
    assert pacer.lateness(0.99) > 0.5
    clock.now += GIVE_UP_S + 2.0
    pacer.wait(lambda: True)
    assert pacer.slips == 1 and pacer.slipped == pytest.approx(GIVE_UP_S + 2.0, abs=0.2)
    served = []
    slow = Pacer(1.0, 1.0, clock, clock.sleep)
    assert slow.wait(lambda: served.append(clock.now) is None)
    assert len(served) > 40  # answers continue during a long wait
    pacer.restart(0.0)
    clock.slept.clear()
    assert pacer.wait(lambda: False)
    pacer.wait(lambda: True)
    assert not clock.slept


def test_a_new_speed_counts_at_once_and_keeps_the_part_of_the_sample_that_has_passed():
    clock = Clock()
    pacer = Pacer(1.0, 0.01, clock, clock.sleep)  # 100 s a sample
    assert not pacer.wait(lambda: clock.now < 25.0)  # interrupted after a quarter
    pacer.change(1.0)
    assert pacer.wait(lambda: True) and clock.now == pytest.approx(25.75, abs=0.05)
    # changes that follow one another without end do not delay a sample
    begun = clock.now
    speeds = [1.0, 0.5]
    while not pacer.wait(lambda: False):
        speeds.reverse()
        pacer.change(speeds[0])
    assert 1.0 <= clock.now - begun < 2.0


@pytest.mark.parametrize("speed", [1e-6, 0.0099, -1.0, 100.1, nan])
def test_speeds_that_would_freeze_the_stream_are_refused(speed):
    vehicle = quiet()
    assert command(vehicle, 31013, speed)[0] == DENIED and vehicle.speed == 1.0
    assert "0.01" in texts(vehicle)[0]
    assert set_parameter(vehicle, "SIM_SPEED", speed) == 1.0
    with pytest.raises(InputError, match=r"0.01 to 100"):
        quiet(speed=speed)
