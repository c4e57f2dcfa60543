"""The multirotor: it follows its commands and leans as its thrust must."""

import numpy as np
import pytest
from lone_vehicle import DEG, history

from insenv.geodesy import STANDARD_GRAVITY
from insenv.vehicles.multirotor import SCRIPT, MultirotorLeg, flight


def test_it_flies_turns_and_climbs_as_its_legs_say() -> None:
    legs = [{"hover_s": 5}, {"fly_s": 20, "forward_mps": 8.0}, {"turn_deg": 90, "duration_s": 6},
            {"fly_s": 20, "right_mps": -3.0}, {"fly_s": 10, "climb_mps": 2.0}, {"hover_s": 20}]  # fmt: skip
    segments = SCRIPT.table(flight([MultirotorLeg(**leg) for leg in legs]))
    start = {"start_latitude": 0.8, "start_height": 100.0, "sample_interval": 0.02, "segments": segments}
    rows = history("multirotor", start, 4050)
    ahead, left, stopped = rows["velocity_n"][[1245, 2545, 4045]]
    np.testing.assert_allclose(ahead, [8.0, 0.0, 0.0], atol=1e-3)
    # against the drag it leans forward, and the accelerometer feels the drag
    force = rows["true_delta_velocity"][1245] / 0.02
    np.testing.assert_allclose(force[0], -STANDARD_GRAVITY * np.sin(0.15 * 8.0 / STANDARD_GRAVITY), rtol=2e-3)
    side = rows["true_delta_velocity"][1400, 1] / 0.02  # in the turn it leans by as much as the turn takes
    assert side == pytest.approx(0.0, abs=0.05)
    assert rows["yaw"][-1] == pytest.approx(90 * DEG, abs=1e-6)
    np.testing.assert_allclose(left, [3.0, 0.0, 0.0], atol=2e-3)  # of east
    assert rows["height"][-1] == pytest.approx(120.0, abs=0.01)
    np.testing.assert_allclose(stopped, 0.0, atol=1e-3)


@pytest.mark.parametrize("leg", [{"forward_mps": 6.0}, {"right_mps": 6.0}, {"right_mps": -6.0}])
def test_in_a_turn_it_leans_by_as_much_as_the_turn_takes(leg: dict[str, float]) -> None:
    """Whatever the direction of flight, the thrust makes the centripetal acceleration: the unit feels drag alone, none here."""
    legs = [{"fly_s": 15, **leg}, {"turn_deg": 90, "duration_s": 12}]
    segments = SCRIPT.table(flight([MultirotorLeg(**each) for each in legs]))
    rows = history("multirotor", {"sample_interval": 0.02, "drag": 0.0, "segments": segments}, 1200)
    np.testing.assert_allclose(rows["true_delta_velocity"][1100, :2] / 0.02, 0.0, atol=0.05)
