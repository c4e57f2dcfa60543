"""The three-axis turntable: where it turns, that it stays in place, and its limits."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from insenv.core.runner import make_runner
from insenv.errors import InputError
from insenv.geodesy.numeric import earth_rate_n
from insenv.scenario import build, load, parse
from insenv.vehicles.three_axis_table import SETTLED, turning_time

PLAN = [
    {"duration_s": 5.0, "roll_deg": 90.0, "rate_deg_s": 40.0},
    {"duration_s": 10.0, "pitch_deg": 360.0, "rate_deg_s": 60.0},
    {"duration_s": 5.0, "heading_deg": 30.0},
]


def scenario(legs, rate_hz=100.0, duration_s=20.0):
    values = load("turntable-calibration").model_dump(mode="json", warnings=False, exclude_none=True)
    values |= {"vehicle": {"kind": "turntable", "legs": legs}, "rate_hz": rate_hz, "duration_s": duration_s}
    return parse({**values, "imu": {"grade": "perfect"}}, "table", "table")


def columns(**keys):
    plant = build(scenario(PLAN, **keys), seed=1)
    return plant, plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))


def test_it_turns_to_the_angles_and_stays_in_place():
    plant, found = columns()
    ends = [round(t / plant.sample_interval) - 1 for t in (5.0, 15.0, 20.0)]
    expected = [Rotation.from_euler("ZYX", angles, degrees=True) for angles in ((0, 0, 90), (0, 360, 90), (30, 360, 90))]
    for k, there in zip(ends, expected, strict=True):
        q = found["q_nb"][k]
        assert (Rotation.from_quat(q[[1, 2, 3, 0]]).inv() * there).magnitude() < 5e-4
    assert not found["velocity_n"].any()
    assert np.ptp(found["latitude"]) == 0.0 and np.ptp(found["height"]) == 0.0
    rates = np.linalg.norm(found["delta_angle"], axis=1) / plant.sample_interval
    assert np.degrees(rates.max()) == pytest.approx(60.0, rel=0.01)


def test_the_increments_are_those_of_the_attitude():
    """The product of the rotations, less the Earth's, is the attitude; the specific force is gravity."""
    plant, found = columns(rate_hz=400.0)
    turned = Rotation.identity()
    for increment in found["delta_angle"]:
        turned = turned * Rotation.from_rotvec(increment)
    q = found["q_nb"][-1]
    earth = Rotation.from_rotvec(earth_rate_n(plant.knowledge.latitude) * 20.0)
    assert ((earth.inv() * turned).inv() * Rotation.from_quat(q[[1, 2, 3, 0]])).magnitude() < 5e-4
    force = np.linalg.norm(found["delta_velocity"], axis=1) / plant.sample_interval
    assert np.ptp(force) < 1e-4 * force.mean()


def test_a_rate_that_the_samples_do_not_resolve_is_refused():
    with pytest.raises(InputError, match=r"rate_deg_s = 1000 turns by 1.7 rad in a sample: allowed is 0.2 rad"):
        build(scenario([{"duration_s": 5.0, "roll_deg": 90.0, "rate_deg_s": 1000.0}], rate_hz=10.0))


def test_a_leg_too_short_for_its_turn_is_refused_with_the_time_that_it_takes():
    def built(*legs, **keys):
        values = scenario(list(legs)).model_dump(mode="json", warnings=False, exclude_none=True)
        values["vehicle"] |= keys
        return build(parse(values, "table", "table"), seed=1)

    with pytest.raises(
        InputError,
        match=r"vehicle.legs\[1\]: duration_s = 20 is too short for roll_deg = 720: a turn by 630 deg at 10 deg/s takes 64.4 s",
    ):
        built({"duration_s": 12.0, "roll_deg": 90.0}, {"duration_s": 20.0, "roll_deg": 720.0})
    back = [{"duration_s": 12.0, "pitch_deg": 5.0}, {"duration_s": 12.0, "pitch_deg": 90.0}]
    built(*back)
    built(*back, repeat_legs=True)
    far = [{"duration_s": 12.0, "pitch_deg": 5.0}, {"duration_s": 30.0, "pitch_deg": 180.0}]
    built(*far)
    with pytest.raises(InputError, match=r"vehicle.legs\[0\]: duration_s = 12 .* turn by 175 deg"):
        built(*far, repeat_legs=True)


@pytest.mark.parametrize("rate_hz", [100.0, 10.0])
@pytest.mark.parametrize(("turn", "rate"), [(0.5, 40.0), (15.0, 40.0), (90.0, 40.0), (360.0, 60.0)])
def test_the_time_of_a_turn_is_that_at_which_the_table_stands(turn, rate, rate_hz):
    needed = turning_time(np.radians(turn), np.radians(rate), 1.0 / rate_hz)
    leg = {"duration_s": 30.0, "heading_deg": turn, "rate_deg_s": rate}
    plant = build(scenario([leg], rate_hz=rate_hz), seed=1)
    found = plant.model.outputs.unpack(make_runner(plant.model, plant.parameters).run(plant.samples))
    half = np.abs(np.arctan2(found["q_nb"][:, 3], found["q_nb"][:, 0])) % np.pi
    short = 2.0 * np.abs(half - np.radians(turn) / 2.0 % np.pi)
    stands = (np.flatnonzero(np.minimum(short, 2.0 * np.pi - short) > SETTLED)[-1] + 1) / rate_hz
    assert needed == pytest.approx(stands, abs=0.05 + 1.0 / rate_hz)
