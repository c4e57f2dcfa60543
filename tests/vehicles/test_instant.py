"""What sensors other than the inertial unit see between samples: rate and acceleration of the unit, by differences."""

import casadi as ca
import numpy as np
import pytest
from lone_vehicle import history, plant
from scipy.spatial.transform import Rotation

from insenv.vehicles import aircraft, regular_sway, ship
from insenv.vehicles.truth import truth_instant

ARM = np.array([8.0, -3.0, -5.0])


def flight():
    start = {
        "start_speed": 220.0,
        "start_height": 3000.0,
        "start_latitude": 1.2,
        "start_heading": 1.0,
        "gust_time_constant": 20.0,
    }
    return aircraft(), start


def swaying():
    regular, values = regular_sway([
        {"motion": "roll", "amplitude_deg": 15, "period_s": 4}, {"motion": "yaw", "amplitude_deg": 10, "period_s": 5},
        {"motion": "pitch", "amplitude_deg": 8, "period_s": 3, "phase_deg": 40},
        {"motion": "north", "amplitude_m": 2, "period_s": 6},
    ])  # fmt: skip
    return ship(regular), values | {"start_latitude": 0.5}


@pytest.mark.parametrize("make", [flight, swaying])
def test_instant_is_the_derivative_of_the_state(make):
    """Acceleration: of the velocity in n. Rate over the Earth: of the attitude in n, and the transport rate."""
    vehicle, parameters = make()
    h = 1e-3
    rows = history(vehicle, parameters | {"sample_interval": h, "imu_lever_arm_b": ARM}, 900, backend="interpreter")
    model, now = plant(vehicle), 700
    p = model.parameters.symbols(
        ca.SX(ca.DM(model.parameters.pack(parameters | {"sample_interval": h, "imu_lever_arm_b": ARM})))
    )
    x = model.state.symbols(ca.SX(ca.DM(model.state.pack({name: values[now] for name, values in rows.items()}))))
    rate, *_, acceleration = (np.array(ca.DM(ca.evalf(value))).ravel() for value in truth_instant(vehicle)(p, x))
    step = (rows["velocity_n"][now + 1] - rows["velocity_n"][now - 1]) / (2 * h)
    assert np.allclose(acceleration, step, atol=2e-5 * (1 + np.abs(step).max()))
    a, e2 = 6378137.0, (2 - 1 / 298.257223563) / 298.257223563
    latitude, (north, east, _) = rows["latitude"][now], rows["velocity_n"][now]
    N = a / np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    M = N * (1 - e2) / (1 - e2 * np.sin(latitude) ** 2)
    height = rows["height"][now]
    transport = np.array([east / (N + height), -north / (M + height), -east * np.tan(latitude) / (N + height)])
    before, here, after = (Rotation.from_quat(rows["q_nb"][k], scalar_first=True) for k in (now - 1, now, now + 1))
    rate_nb = (before.inv() * after).as_rotvec() / (2 * h)
    assert np.allclose(rate - rate_nb, here.inv().apply(transport), rtol=0, atol=2e-6)
