"""Aiding instruments in the limit: their equations against differences of independent ones, and closed forms."""

import math

import numpy as np
import pytest
from interpreted import interpreted  # noqa: F401
from scipy.spatial.transform import Rotation

from insenv import geodesy
from insenv.evaluation.limits import recursion
from insenv.evaluation.limits.states import Aid, aids_of, receiver_of, unit_of
from insenv.evaluation.limits.steps import Steps, fixes_of
from insenv.geodesy.magnetic import world_magnetic_model
from insenv.scenario import build, limit, load

CAR = {
    "title": "Car", "duration_s": 60.0, "rate_hz": 100.0,
    "start": {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "heading_deg": 30.0},
    "vehicle": {"kind": "car", "legs": [{"accelerate_to_mps": 15.0}, {"drive_s": 600.0}]},
    "imu": {"grade": "tactical"},
}  # fmt: skip
ERRORS = {
    "barometer": {"bias_m": 1.0, "drift_sigma_m": 1.0, "scale_factor_percent": 1.0, "speed_error_percent": 5.0},
    "magnetometer": {
        "hard_iron_sigma_nt": 100.0, "anomaly_sigma_nt": 100.0, "soft_iron_sigma_percent": 1.0, "coupling_sigma_percent": 1.0,
        "drift_sigma_nt": 10.0,
    },
    "odometer": {"mounting_deg": [1.0, -4.0, 8.0], "lever_arm_m": [-1.0, 0.7, 0.5], "slip_sigma_percent_s2_m": 0.1,
                 "mounting_sigma_deg": 1.0},
    "dvl": {"lever_arm_m": [5.0, -1.0, 3.0], "water_track": True, "current_mps": [0.1, 0.1, 0.1], "current_sigma_mps": 0.2},
    "heading": {"baseline_m": [0.8, -0.5, 0.2]},
}  # fmt: skip


def one_step(seed):
    """A step of a random motion near the start of `CAR`; the rows that instruments use."""
    rng = np.random.default_rng(seed)
    q = np.roll(Rotation.random(random_state=seed).as_quat(), 1)[None]
    fill = {
        "end": np.array([10]), "time": np.array([0.1]), "length": np.array([0.1]), "C_ns": np.eye(3)[None],
        "angle": np.zeros((1, 3, 3, 3)), "force": np.zeros((1, 3, 3, 3)), "rest": np.array([False]),
    }  # fmt: skip
    return Steps(
        **fill, thrust=0.1 * rng.normal(size=(1, 3)) * 9, q_nb=q, rate_n=rng.normal(size=(1, 3)) * 0.3,
        velocity_n=rng.normal(size=(1, 3)) * 10, latitude=np.radians([48.0]) + 1e-4 * rng.normal(size=1),
        longitude=np.radians([11.0]) + 1e-4 * rng.normal(size=1), height=500.0 + 50 * rng.normal(size=1),
    )  # fmt: skip


def shown(id, steps, C_nb, velocity_n, height, error):
    """What the instrument shows, from its definition on the page, with `error` by name of the source."""

    def of(name, size=1):
        return np.asarray(error.get(name, np.zeros(size)))

    if id == "barometer":
        bias = of("barometer bias") + of("barometer drift") + of("barometer scale factor") * (height - 500.0)
        return height + bias + of("barometer speed error") * np.sum(velocity_n**2) / (2 * 9.80665)
    if id == "magnetometer":
        place = math.radians(48.0), math.radians(11.0)
        field, gradient = world_magnetic_model(*place, 500.0, 2026.0)
        lat, lon, h = (float(value[0]) for value in (steps.latitude, steps.longitude, steps.height))
        R_M, R_N = (float(r) for r in geodesy.numeric.radii(math.sin(lat)))
        way = [(lat - place[0]) * (R_M + h), (lon - place[1]) * (R_N + h) * math.cos(lat), 500.0 - h]
        field_b = C_nb.T @ (field + gradient @ way + of("magnetometer anomaly", 3))
        soft = of("magnetometer soft iron", 9).reshape(3, 3)
        return (np.eye(3) + soft) @ field_b + of("magnetometer hard iron", 3) + of("magnetometer drift", 3)
    velocity_b, rate_b = C_nb.T @ velocity_n, true_C(steps).T @ steps.rate_n[0]
    if id == "odometer":
        mounting = Rotation.from_rotvec(np.radians([1.0, -4.0, 8.0])) * Rotation.from_rotvec(of("odometer mounting", 3))
        speed = mounting.apply([1.0, 0.0, 0.0]) @ (velocity_b + np.cross(rate_b, [-1.0, 0.7, 0.5]))
        force = (true_C(steps).T @ steps.thrust[0])[0] / 0.1
        return (1 + of("odometer scale factor") + of("odometer slip") * force) * speed
    if id == "dvl":
        current = of("dvl current", 3) + np.append(of("dvl changing current", 2), 0.0)
        velocity = C_nb.T @ (velocity_n - current) + np.cross(rate_b, [5.0, -1.0, 3.0])
        return (1 + of("dvl scale factor")) * Rotation.from_rotvec(of("dvl misalignment", 3)).inv().apply(velocity)
    return C_nb @ ([0.8, -0.5, 0.2] + of("heading baseline", 3)) + of("heading wander", 3)


def true_C(steps):
    return Rotation.from_quat(np.roll(steps.q_nb[0], -1)).as_matrix()


def aid_of(id, **section):
    plant = build(load({**CAR, id: section or ERRORS[id]}))
    rows = plant.model.parameters.unpack(plant.model.parameters.pack(plant.parameters))
    (aid,) = aids_of(rows, plant.sample_interval)
    return aid


@pytest.mark.parametrize("id", ERRORS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_equations_are_the_derivatives_of_what_is_shown(id, seed):
    aid, steps, h = aid_of(id), one_step(seed), 1e-6
    C_en = np.asarray(geodesy.numeric.C_en(steps.latitude, steps.longitude))
    nav, own = aid.linear(steps, C_en)
    C_nb, C_ne, velocity, height = true_C(steps), C_en[0].T, steps.velocity_n[0], float(steps.height[0])

    def at(name, x):
        """What is shown with one error: of the navigation, in e, or a source of the instrument."""
        psi, dv, dr = (x if name == each else np.zeros(3) for each in ("psi", "dv", "dr"))
        turned = C_ne @ Rotation.from_rotvec(psi).as_matrix() @ C_en[0] @ C_nb  # the axes n are those of the truth
        return np.atleast_1d(shown(id, steps, turned, velocity + C_ne @ dv, height - (C_ne @ dr)[2], {name: x}))

    def derivatives(name, size):
        return np.stack([(at(name, h * unit) - at(name, -h * unit)) / (2 * h) for unit in np.eye(size)], axis=1)

    for place, name in enumerate(("psi", "dv", "dr")):
        difference = derivatives(name, 3)
        if id == "barometer" and name != "dr":  # by the page, what its own errors change with the speed is left out
            difference = 0 * difference
        found = nav[0, :, 3 * place : 3 * place + 3]
        np.testing.assert_allclose(found, difference, rtol=1e-5, atol=1e-7 * np.abs(nav).max())
    assert {source.name for source in aid.sources} <= set(own)
    for name, (columns,) in own.items():
        if name == "heading offset":  # of a filter alone
            continue
        difference, scale = derivatives(name, columns.shape[1]), max(np.abs(columns).max(), 1e-12)
        # a variance has no sign
        np.testing.assert_allclose(np.abs(columns), np.abs(difference), rtol=1e-5, atol=1e-7 * scale)


def test_the_equations_of_a_fix_are_the_derivatives_of_what_it_shows():
    """Of an epoch 8 ms before its sample: position and velocity of an antenna whose arm and delay are uncertain."""
    receiver = {"lever_arm_m": [2.0, -1.0, 3.0], "epoch_offset_s": 0.008, "lever_arm_sigma_m": 0.1, "delay_sigma_s": 0.1}
    plant, steps, h = build(load({**CAR, "gnss": {"grade": "rtk", **receiver}})), one_step(4), 1e-6
    rows = plant.model.parameters.unpack(plant.model.parameters.pack(plant.parameters))
    fixes, C_en = fixes_of(rows, plant.sample_interval), np.asarray(geodesy.numeric.C_en(steps.latitude, steps.longitude))[0]
    layout = recursion.Layout(unit_of({}), receiver_of(rows), fixes, None)
    H = recursion.fix_of(layout, fixes, steps, C_en[None])[0][0]
    gravity, rate_b = geodesy.numeric.normal_gravity(np.sin(steps.latitude), steps.height), true_C(steps).T @ steps.rate_n[0]
    acceleration = steps.thrust[0] / 0.1 + [0.0, 0.0, gravity[0]]

    def shown(psi, dv, dr, arm, delay):
        C = C_en.T @ Rotation.from_rotvec(psi).as_matrix() @ C_en @ true_C(steps)
        arm_n, turning = (C @ each for each in (receiver["lever_arm_m"] + arm, np.cross(rate_b, receiver["lever_arm_m"] + arm)))
        moved = steps.velocity_n[0] + C_en.T @ dv
        late = delay * (steps.velocity_n[0] + true_C(steps) @ np.cross(rate_b, receiver["lever_arm_m"]))
        return np.concatenate([C_en.T @ dr + arm_n - 0.008 * moved + late, moved + turning + delay * acceleration])

    for k, column in enumerate(H.T):
        up, down = (shown(*np.split(sign * h * np.eye(13)[k], [3, 6, 9, 12])) for sign in (1, -1))
        np.testing.assert_allclose(column, (up - down) / (2 * h), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(("id", "section", "noise"), [
    ("heading", {"noise_m": [0.01, 0.02, 0.03], "outlier_probability": 0.75}, [0.02, 0.04, 0.06]),
    ("barometer", {"noise_m": 0.3, "quantum_m": 1.2}, math.hypot(0.3, 1.2 / 12**0.5)),
])  # fmt: skip
def test_a_detected_outlier_is_a_measurement_that_is_missing_and_rounding_is_noise(id, section, noise):
    np.testing.assert_allclose(aid_of(id, **{"grade": "perfect", **section}).noise, noise, rtol=1e-12)


def test_epochs_of_a_step_without_those_in_outages():
    aid = aid_of("odometer")  # every 10 samples of 0.01 s
    begin, end = np.array([0, 9, 10, 95, 105, 200]), np.array([9, 10, 40, 105, 130, 200])
    assert aid.epochs(begin, end).tolist() == [0, 1, 3, 1, 3, 0]
    lost = Aid(**{**vars(aid), "outages": np.array([[1.0, 1.2]])})  # the epochs at 1.0 and 1.1 s
    assert lost.epochs(begin, end).tolist() == [0, 1, 3, 0, 2, 0]


def final(**changes):
    """The limit at the end of a drive, by channel."""
    return {name: float(values[-1]) for name, values in limit({**CAR, "rate_hz": 20.0, **changes}).sigma.items()}


EAST = {
    "start": {**CAR["start"], "heading_deg": 90.0}, "imu": {},
    "vehicle": {"kind": "car", "start_speed_mps": 15.0, "legs": [{"drive_s": 600.0}]},
    "knowledge": {"velocity_sigma_mps": [1e-4, 10.0, 1e-4], "tilt_sigma_deg": 1e-5, "heading_sigma_deg": 1e-5},
}  # fmt: skip
"""Straight on with a perfect unit: the start tells nothing of the velocity along it."""
LEVEL = {"grade": "tactical", "accel_bias_sigma_ug": 10.0, "accel_instability_ug": 0.0, "accel_misalignment_sigma_urad": 0.0}
"""To 10 ug; the gyros tell nothing of north."""
FREE = {"knowledge": {"position_sigma_m": [1.0, 1.0, 6.0], "velocity_sigma_mps": 1e-3}, "duration_s": 600.0}
SAILING = {
    "vehicle": {"kind": "ship", "start_speed_mps": 8.0}, "knowledge": {"velocity_sigma_mps": 5.0, "heading_sigma_deg": 0.01},
}  # fmt: skip


def parked(**knowledge):
    return {"vehicle": {"kind": "car"}, "knowledge": {"heading_sigma_deg": 40.0, **knowledge}}


@pytest.mark.parametrize(("id", "section", "drive", "channel", "expected", "near"), [
    # start and bias are constants: the height is their weighted mean, whatever the unit does
    ("barometer", {"bias_sigma_m": 4.0}, FREE, "down_m", 1 / math.hypot(1 / 6.0, 1 / 4.0), 0.01),
    # the anomaly over the horizontal field, of which it alone has an east component
    ("magnetometer", {"anomaly_sigma_nt": [0.0, 300.0, 0.0], "field_nt": [20000.0, 0.0, 40000.0]},
     {"imu": LEVEL, **parked(tilt_sigma_deg=0.5)}, "heading_deg", math.degrees(300.0 / 20000.0), 0.02),
    ("odometer", {"noise_mps": 0.05}, EAST, "ve_mps", 0.05 / math.sqrt(600), 0.02),
    # at one speed nothing shows the scale
    ("odometer", {"noise_mps": 0.05, "scale_factor_sigma_percent": 1.0}, EAST, "ve_mps", 0.15, 0.02),
    ("heading", {"noise_m": 0.01, "interval_s": 1.0, "baseline_m": [2.0, 0.0, 0.0]},
     {"imu": {"grade": "navigation"}, **parked()}, "heading_deg", math.degrees(0.005 / math.sqrt(60)), 0.02),
    ("dvl", {"water_track": True, "current_sigma_mps": 0.4, "current_time_s": 1e6},
     SAILING, "vn_mps", 0.4, 0.02),
])  # fmt: skip
def test_what_an_instrument_tells_is_its_closed_form(id, section, drive, channel, expected, near):
    assert final(**{id: {"grade": "perfect", **section}}, **drive)[channel] == pytest.approx(expected, rel=near)
    assert final(**drive)[channel] > 3 * expected, "it is the instrument that tells it"


def test_unknown_lever_arm_and_delay_only_add_to_the_limit():
    receiver = {"grade": "centimetre", "latency_s": 0.4}
    drive = {"kind": "car", "start_speed_mps": 15.0, "legs": [{"drive_s": 600.0}]}
    known, unknown = (
        final(gnss={**receiver, **more}, vehicle=drive) for more in ({}, {"lever_arm_sigma_m": 0.5, "delay_sigma_s": 0.1})
    )
    assert all(unknown[name] >= known[name] * (1 - 1e-9) for name in known)
    # straight on nothing shows the arm: fixes tell the sum of it and the height, of which the start tells 1 m
    assert unknown["down_m"] == pytest.approx(1 / math.hypot(1 / 0.5, 1 / 1.0), rel=0.01)
