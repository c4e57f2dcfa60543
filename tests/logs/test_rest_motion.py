"""Rest and travel as a log shows them; an alignment in place is refused where the vehicle travels."""

import numpy as np
import pytest
from text_logs import TOML

from insenv import geodesy, replay
from insenv.base.errors import InputError
from insenv.logs import load

DRIVE = (
    TOML.replace('"deg/s"', '"rad/s"')
    .replace('"g"', '"m/s2"')
    .replace('position_sigma = ["sn", "se", "sd"]', "position_sigma_m = [1.0, 1.0, 2.0]")
    .replace("[1.0, 2.0, -3.0]", "[0.0, 0.0, 0.0]")
)
IMU = DRIVE[: DRIVE.index("[gnss]")]
VELOCITY = 'velocity = ["vn", "ve", "vd"]\nvelocity_sigma_mps = [0.1, 0.1, 0.2]\n'


def drive(folder, stands_s, push, *, speed=0.0, velocity=True):
    """A vehicle northward at `speed` m/s for `stands_s`, which then accelerates by `push` m/s^2 for 10 s; 60 s in all."""
    draw = np.random.default_rng(1)
    time = np.arange(1, 6001) / 100
    pushes = np.where((time > stands_s) & (time <= stands_s + 10), push, 0.0)
    rates = geodesy.numeric.earth_rate_n(np.radians(47.0)) + draw.normal(0, 1e-3, (6000, 3))
    forces = draw.normal(0, 0.02, (6000, 3)) + np.stack([pushes, 0 * time, np.full(6000, -9.81)], axis=1)
    rows = np.column_stack([time, rates, forces])
    np.savetxt(folder / "imu.csv", rows, delimiter=",", header="t,gx,gy,gz,ax,ay,az", comments="")
    velocities = speed + np.cumsum(pushes) / 100
    way = np.cumsum(velocities) / 100
    fixes = np.column_stack([time, 47 + (way + draw.normal(0, 0.5, 6000)) / 111_180.0, 0 * time + 15, 0 * time + 400])
    fixes = np.column_stack([fixes, velocities, 0 * time, 0 * time])[99::100]
    np.savetxt(folder / "gnss.csv", fixes, delimiter=",", header="t,lat,lon,h,vn,ve,vd", comments="")
    path = folder / "log.toml"
    path.write_text(DRIVE + (VELOCITY if velocity else ""))
    return path


@pytest.mark.parametrize(("push", "velocity"), [(0.3, True), (0.3, False), (2.0, True)])
def test_the_time_at_rest_is_found(push, velocity, tmp_path):
    """Also where the start is gentle, and where the receiver gives no velocity; what the description states goes before."""
    path = drive(tmp_path, 30.0, push, velocity=velocity)
    found = load(path).description.initial.static_until_s
    assert 28.9 < found < 31.2
    text = path.read_text()
    path.write_text(text + "[initial]\nstatic_until_s = 12.0\n")
    assert load(path).description.initial.static_until_s == 12.0
    path.write_text(text + "[initial]\nstatic_from_s = 10.0\n")
    assert load(path).description.initial.static_until_s == pytest.approx(30.0, abs=1.01)


def test_a_start_that_only_positions_show_ends_the_rest_before_it(tmp_path):
    """0.05 m/s^2 from 30 s on: the unit does not tell it from a bias, and the fixes show it when it has gone 4 m."""
    found = load(drive(tmp_path, 30.0, 0.05, velocity=False)).description.initial.static_until_s
    assert 25.0 < found <= 33.0


@pytest.mark.parametrize(("speed", "velocity"), [(1.0, True), (1.0, False), (20.0, True)])
def test_a_smooth_ride_is_no_rest(speed, velocity, tmp_path):
    log = load(drive(tmp_path, 60.0, 0.0, speed=speed, velocity=velocity))
    assert log.description.initial.static_until_s is None


@pytest.mark.parametrize("velocity", [True, False])
def test_an_alignment_in_place_is_refused_on_a_vehicle_that_travels(velocity, tmp_path):
    """A navigation starts there by itself."""
    path = drive(tmp_path, 20.0, 2.0, velocity=velocity)
    for id in ("q-method", "gyrocompass", "analytic"):
        with pytest.raises(
            InputError, match=rf"'{id}' is for a vehicle that stays in place, and .* of the log moves \(at .* m/s about"
        ):
            replay(path, id)
    result = replay(path, "loosely-coupled").results[0]
    assert abs(result.outputs["velocity_n"][-1, 0] - 20.0) < 0.5
    path.write_text(path.read_text().replace('title = "test"', 'title = "test"\nstop_s = 19.0'))
    assert replay(path, "q-method").results[0].outputs["q_nb"].shape[1] == 4
