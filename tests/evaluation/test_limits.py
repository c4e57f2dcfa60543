"""The limit: against values of an independent program, closed forms, an independent mechanization and ensembles."""

import re
from dataclasses import replace
from functools import cache, lru_cache
from types import SimpleNamespace

import earth_fixed
import numpy as np
import pytest
from changed_scenario import changed
from earth_fixed import ACCEL, EARTH_RATE, GYRO, PHI, SCALE, frame_n, quaternion_of, skew
from interpreted import interpreted  # noqa: F401
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from yardsticks import bound_of_unit

import insenv
from insenv import geodesy
from insenv.base.errors import InputError
from insenv.evaluation.errors import CHANNELS, POSITION, VELOCITY
from insenv.evaluation.limits import Limit, Prior, bound, ratio, ratio_bounds
from insenv.evaluation.limits.bound import limit_of
from insenv.evaluation.limits.recursion import Layout, recursion
from insenv.evaluation.limits.states import Mooring, entering, mooring_of, receiver_of, unit_of
from insenv.evaluation.limits.steps import DR, DV, PSI, _summed, earth_axes, fixes_of, integrals, local, step_ends, steps_along
from insenv.runs.ensemble import ensemble
from insenv.scenario import build, limits, load
from insenv.scenario.limits import prior_of


def rows_of(plant):
    return plant.model.parameters.unpack(plant.model.parameters.pack({**plant.parameters, "seed": 1.0}))


def steps_of(plant, **changes):
    """Fixes and steps of a plant's trajectory, with rows of the steps replaced by functions of their number."""
    rows = rows_of(plant)
    fixes, interval = fixes_of(rows, plant.sample_interval), plant.sample_interval
    ends = step_ends(plant.samples, interval, fixes)
    blocks = steps_along(plant.model, plant.model.parameters.pack(rows), interval, ends, unit_of(rows).C_bs)
    return fixes, (replace(block, **{k: make(len(block.time)) for k, make in changes.items()}) for block in blocks)


def bound_with(plant, rest, mooring=None):
    """The limit of a plant said to rest always or never, whatever it does, and with a sway or without."""
    rows = rows_of(plant)
    fixes, blocks = steps_of(plant, rest=lambda count: np.full(count, rest))
    layout = Layout(unit_of(rows), receiver_of(rows) if fixes else (), fixes, mooring)
    times, sigmas = zip(*recursion(blocks, layout, prior_of(plant.scenario.knowledge)), strict=True)
    return limit_of(np.concatenate(times), np.concatenate(sigmas))


def test_a_roll_moves_the_unit_by_its_lever_arm():
    rows = {"roll_amplitude": 0.1, "roll_angular_frequency": 1.0, "north_amplitude": 1.2, "north_angular_frequency": 2.0}
    assert mooring_of({**rows, "imu_lever_arm_b": [0.0, 3.0, -4.0]}).sigma == pytest.approx(1.3)


@pytest.mark.parametrize(("times", "from_s", "words"), [
    ([], 0.0, "at least one"), ([900.0], 0.0, "time 900 s: allowed is 0 to 60 s"), ("late", 0.0, "times = 'late'"),
    ([float("nan")], 0.0, "time nan s"),
])  # fmt: skip
def test_a_limit_is_asked_only_for_times_that_it_has(times, from_s, words):
    limit = Limit(np.array([0.0, 60.0]), np.zeros((2, 3)), {"roll_deg": np.array([3.0, 1.0])})
    assert limit.rms([0.0, 60.0])["roll_deg"] == pytest.approx(np.sqrt(5.0))
    with pytest.raises(InputError, match=re.escape(words)):
        limit.rms(times, from_s)


@pytest.mark.parametrize(("pitch_deg", "unjudged"), [(0.0, ()), (79.0, ()), (85.0, ("roll_deg", "heading_deg"))])
def test_a_heading_that_exceeds_what_the_axes_cause_is_not_judged(pitch_deg, unjudged):
    """0.02 deg about level axes, none about down: a heading error of tan(pitch) times that."""
    level = np.radians(0.02)
    heading = 0.02 * np.tan(np.radians(pitch_deg))
    limit = Limit(np.zeros(1), np.array([[level, 0.0, 0.0]]), {"heading_deg": np.array([heading])})
    assert limit.unjudged == unjudged


@pytest.mark.parametrize("latitude", [-1.3, 0.0, 0.8])
def test_an_error_of_position_turns_the_axes_of_the_estimate(latitude):
    """The misalignment and velocity error that an error of position alone makes, against the axes n at both places."""
    velocity, height, nothing = np.array([20.0, -10.0, 3.0]), 500.0, np.zeros((1, 3, 3))
    C = geodesy.numeric.C_en(latitude, 0.4)
    step = SimpleNamespace(
        time=np.zeros(1), latitude=np.array([latitude]), height=np.array([height]), velocity_n=velocity[None], C_ns=nothing
    )
    W = local(step, C[None])[0]
    for offset in np.diag([100.0, 100.0, 100.0]):
        there = np.ravel(geodesy.numeric.geodetic_from_ned_offset(offset, latitude, 0.4, height))
        other = geodesy.numeric.C_en(*there[:2])
        turn = Rotation.from_matrix(other.T @ C).as_rotvec()  # what is C in e is turned by that in the axes of the estimate
        found = W @ np.concatenate([np.zeros(6), C @ offset])
        assert found[PSI] == pytest.approx(turn, abs=2e-9)
        assert found[DV] == pytest.approx((other.T - C.T) @ C @ velocity, abs=1e-7)
        assert found[DR] == pytest.approx(offset)


NINE = ("roll_deg", "pitch_deg", "heading_deg", *VELOCITY, *POSITION)
TENTHS = np.arange(0.1, 900.05, 0.1)


def statistic(limit, from_s, channels=NINE):
    times = TENTHS[: np.searchsorted(TENTHS, limit.time[-1] + 1e-9)]
    found = limit.rms(times, from_s)
    return [found[name] for name in channels]


OF_DRIVE = (
    (0.0421, 0.0416, 0.567, 0.0361, 0.0348, 0.0108, 1.200, 1.193, 1.760),
    (0.0355, 0.0358, 0.102, 0.0, 0.0, 0.0, 0.798, 0.819, 1.301),
)


@pytest.mark.parametrize(
    ("name", "from_s", "rms", "end"),
    [("static-ecef", 450.0, *[(0.001168, 0.001155, 0.01084)] * 2), ("car-city-drive", 0.0, *OF_DRIVE)],
)
def test_the_limit_is_that_of_an_independent_program(name, from_s, rms, end, monkeypatch):
    """Values of a program that shares nothing with insenv; it counts the first second of a stop as rest as well.

    static-ecef has biases b alone: b / g of tilt; heading hypot(tilt tan L, b_gE / (Omega cos L)).
    """
    monkeypatch.setenv("INSENV_BACKEND", "native")
    found = insenv.limit(name)
    channels = NINE[: len(rms)]
    assert statistic(found, from_s, channels) == pytest.approx(rms, rel=0.02)
    assert [found.sigma[c][-1] for c in channels] == pytest.approx(end, rel=0.005, abs=1.1e-5)


def test_the_limit_at_rest_swaying_and_moving_is_that_of_an_independent_program(monkeypatch):
    monkeypatch.setenv("INSENV_BACKEND", "native")
    still = bound_with(build(load("ship-swaying"), seed=1), True)
    assert statistic(still, 225.0, NINE[:3]) == pytest.approx((0.000443, 0.000537, 0.0384), rel=0.003)
    displaced = Mooring(2 * np.pi / np.array([6.0, 7.0, 8.0]), 1.2)
    swaying = bound_with(build(load("ship-swaying"), seed=1), False, displaced)
    assert statistic(swaying, 225.0, NINE[:3]) == pytest.approx((0.000582, 0.000588, 0.0385), rel=0.003)
    assert [swaying.sigma[c][-1] for c in NINE[:3]] == pytest.approx((0.000577, 0.000584, 0.0350), rel=0.003)
    moving = bound_with(build(load("car-city-drive"), seed=1), False)
    expected = (0.0502, 0.0509, 0.574, 0.0524, 0.0515, 0.0171, 1.556, 1.542, 1.878)
    assert statistic(moving, 0.0) == pytest.approx(expected, rel=0.003)


def noise_tilts(N, V, latitude, time):
    """Standard deviations about north, east, down (3, rad) from white noise: the errors of the best linear unbiased estimates
    of a drift from a Brownian path (N), and of a constant, of the end and of the slope of a line from white noise (V).

    The tilt about east follows a line whose slope is the heading error times the horizontal Earth rate.
    """
    g = float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))
    tilt, drift = 2 * V / (g * np.sqrt(time)), N**2 / time + 12 * V**2 / (g**2 * time**3)
    return np.array([tilt / 2, tilt, np.sqrt(drift) / (geodesy.OMEGA_IE * np.cos(latitude))])


@pytest.mark.parametrize(("N", "V"), [(1e-5, 1e-7), (1e-9, 1e-3)])
def test_one_noise_alone_gives_the_closed_form(N, V):
    values = {"gyro_arw_deg_sqrt_h": float(np.degrees(N) * 60), "accel_vrw_ug_sqrt_hz": V / 9.80665e-6}
    scenario = changed("static-ecef", duration_s=300.0, rate_hz=20.0, imu={"grade": "perfect", **values},
                       knowledge={"tilt_sigma_deg": 60.0, "heading_sigma_deg": 360.0})  # fmt: skip
    found = bound_with(build(scenario, seed=1), True).at(np.array([100.0, 300.0]))
    for place, time in enumerate((100.0, 300.0)):
        expected = np.degrees(noise_tilts(N, V, np.radians(45.0), time))
        assert found["heading_deg"][place] == pytest.approx(expected[2], rel=0.03)
        if V > 1e-6:
            assert found["roll_deg"][place] == pytest.approx(expected[0], rel=0.03)
            assert found["pitch_deg"][place] == pytest.approx(expected[1], rel=0.03)


FREE_S, WARM_S, RAMP, MEMORY_S, G = 30.0, 200.0, 1 / 36, 20.0, 9.8061978
WARMED = 20.0 * (FREE_S - WARM_S * (1.0 - np.exp(-FREE_S / WARM_S))) + RAMP * FREE_S**2 / 2
TURN = EARTH_RATE[2] * np.sin(np.pi / 4)  # about down and about north


def remembered(time):
    """What one sigma of a stationary Gauss-Markov rate adds to its integral."""
    return np.sqrt(2.0 * time * (FREE_S - time * (1.0 - np.exp(-FREE_S / time))))


GROWTH = {
    "bias": FREE_S, "bias_sigma": FREE_S, "rate_random_walk": FREE_S**1.5 / np.sqrt(3.0), "temperature_slope": WARMED,
    "instability_sigma": remembered(MEMORY_S),
    "flicker": np.sqrt(np.log(10.0) / (2.0 * np.log(2.0)) * sum(remembered(4.0 * 10.0**k) ** 2 for k in range(5))),
}  # fmt: skip
"""What one sigma of an error of a rate adds to its integral."""
SOURCES = {
    **{f"gyro_{name}": ("heading_deg", growth) for name, growth in GROWTH.items()},
    **{f"accel_{name}": ("vd_mps", growth) for name, growth in GROWTH.items()},
    **{f"{name}{end}": of for end in ("", "_sigma") for name, of in {
        "gyro_scale_factor": ("heading_deg", TURN * FREE_S), "gyro_misalignment": ("heading_deg", TURN * FREE_S),
        "accel_scale_factor": ("vd_mps", G * FREE_S), "accel_misalignment": ("vn_mps", G * FREE_S),
        "mounting_error": ("vn_mps", G * FREE_S)}.items()},
    "angle_random_walk": ("heading_deg", FREE_S**0.5), "velocity_random_walk": ("vd_mps", FREE_S**0.5),
    "gyro_scale_factor_slope": ("heading_deg", TURN * WARMED), "accel_scale_factor_slope": ("vd_mps", G * WARMED),
    "gyro_g_sensitivity": ("heading_deg", G * FREE_S), "gravity_disturbance_n": ("vd_mps", FREE_S),
}  # fmt: skip


@cache
def free_at_rest():
    """Rows and steps of a perfect unit at rest, level and to the north, that warms up by 20 K and along a ramp."""
    imu = {"grade": "perfect", "temperature_end_degc": 40.0, "warm_up_s": WARM_S, "temperature_ramp_k_h": 100.0}
    plant = build(changed("static-ecef", duration_s=FREE_S, rate_hz=10.0, imu=imu), seed=1)
    return rows_of(plant), list(steps_of(plant, rest=lambda count: np.full(count, False))[1])


@pytest.mark.parametrize("row", SOURCES)
def test_every_source_alone_adds_what_its_integral_is(row):
    """Without measurements and with a known start, over 30 s, at two sizes; of a matrix the largest element counts."""
    rows, blocks = free_at_rest()
    channel, growth = SOURCES[row]
    shape = np.shape(rows[row])
    for size in (1e-3, 2e-3):
        own = {**rows, "gyro_instability_time": MEMORY_S, "accel_instability_time": MEMORY_S, row: np.full(shape, size)}
        nothing = Prior(np.full(3, 1e-12), np.full(3, 1e-12), np.full(3, 1e-9))
        times, sigmas = zip(*recursion(iter(blocks), Layout(unit_of(own), (), None, None), nothing), strict=True)
        found = limit_of(np.concatenate(times), np.concatenate(sigmas)).sigma[channel][-1]
        assert (np.radians(found) if channel == "heading_deg" else found) == pytest.approx(size * growth, rel=0.01)


@pytest.mark.parametrize(("row", "growth"), [("gyro_scale_factor_sigma", remembered(MEMORY_S)), ("gyro_scale_factor", FREE_S)])
def test_of_a_scale_factor_with_a_correlation_time_the_drawn_part_drifts(row, growth):
    rows, blocks = free_at_rest()
    own = {**rows, "gyro_scale_factor_time": MEMORY_S, row: np.full(3, 1e-3)}
    nothing = Prior(np.full(3, 1e-12), np.full(3, 1e-12), np.full(3, 1e-9))
    times, sigmas = zip(*recursion(iter(blocks), Layout(unit_of(own), (), None, None), nothing), strict=True)
    found = limit_of(np.concatenate(times), np.concatenate(sigmas)).sigma["heading_deg"][-1]
    assert np.radians(found) == pytest.approx(1e-3 * TURN * growth, rel=0.01)


def sampled(motion, count, dt):
    """Outputs of a plant that moves along a motion: its `count` samples."""
    t = dt * np.arange(1, count + 1)
    r = motion.position(t)
    C_ne, (angle, velocity) = frame_n(r).swapaxes(1, 2), motion.increments(dt, count)
    rows = {"true_delta_angle": angle, "true_delta_velocity": velocity, "q_nb": quaternion_of(C_ne @ motion.attitude(t))}
    place = dict(zip(("latitude", "longitude", "height"), earth_fixed.geodetic(r), strict=True))
    return rows | place | {"velocity_n": (C_ne @ motion.velocity(t)[..., None])[..., 0]}


def test_transition_and_error_sources_are_those_of_an_independent_mechanization():
    """A flight in curves: every navigation error, and every kind of error of a unit that is 1 K too warm."""
    motion, seconds, dt, size = earth_fixed.Motion(), 10.0, 0.01, 1e-5
    kinds = ("bias", "temperature_slope", "scale_factor", "misalignment", "scale_factor_slope")
    rows = {f"{triad}_{kind}": 1.0 for triad in ("gyro", "accel") for kind in kinds}
    warm = {"imu_temperature_initial": 294.15, "imu_temperature_final": 294.15}
    unit = unit_of({**rows, **warm, "gyro_g_sensitivity": 1.0, "mounting_error": 1.0})
    count = round(seconds / dt)
    ends = np.arange(5, count + 1, 5)  # errors fall with the square of a step
    steps, _ = _summed(sampled(motion, count, dt), ends, 0, dt, unit.C_bs, 0.0)
    C_en = earth_axes(steps.latitude, steps.longitude)
    A = integrals(steps, C_en, steps.thrust)
    enter = np.concatenate([entering(source, unit, steps, steps.force) for source in unit.sources], axis=2)
    effect = np.concatenate([C_en @ enter[:, :3], C_en @ enter[:, 3:], 0 * enter[:, 3:]], axis=1)
    found = np.eye(9, 9 + enter.shape[2])
    for a, own in zip(A, effect, strict=True):
        found = found + a @ found + a @ a @ found / 2
        found[:, 9:] += own + a @ own / 2

    starts, by = np.zeros((found.shape[1], 15)), np.zeros((3, found.shape[1], 3, 3))
    for own, other, sign in ((PSI, PHI, -1.0), (DV, earth_fixed.VELOCITY, 1.0), (DR, earth_fixed.POSITION, 1.0)):
        starts[own, other] = sign * np.diag(SCALE[other])
    groups = {"psi": [0, 1, 2], "dv": [3, 4, 5], "dr": [6, 7, 8]}
    for column, (source, place) in enumerate([(each, place) for each in unit.sources for place in each.place], 9):
        groups.setdefault(f"{source.name} of {source.triad}", []).append(column)
        if source.name.endswith("bias"):
            starts[column, (GYRO, ACCEL)[source.triad]][place] = size
        elif source.name == "mounting":  # what is sensed turns the other way
            by[:2, column] = -size * skew(np.eye(3)[place])
        else:
            matrix = by[2 if source.name == "g-sensitivity" else source.triad, column]
            matrix.flat[4 * place if source.name == "thermal scale factor" else place] = size
    both = np.concatenate([by, -by], axis=1)
    after = earth_fixed.moved(motion, [*starts, *-starts], seconds, 0.05, False, *both)
    (r, r_), (v, v_), (C, C_) = (np.split(part, 2) for part in after)
    psi = Rotation.from_matrix(C @ C_.swapaxes(1, 2)).as_rotvec()
    sizes = np.concatenate([np.repeat(SCALE[[6, 3, 0]], 3), np.full(enter.shape[2], size)])
    expected = np.concatenate([psi, v - v_, r - r_], axis=1).T / (2 * sizes)
    for name, columns in groups.items():
        exact, error = (np.abs(part[:, columns]).reshape(3, -1).max(axis=1) for part in (expected, found - expected))
        assert np.all(error <= 1e-4 * exact + 1e-7 * exact.max()), name
    # gravity's change with latitude is below that; so is its north part above the ellipsoid, which the model leaves out
    north, down = frame_n(motion.position(0.0))[:, 0], C_en[-1][:, 2]
    assert down @ found[DV, DR] @ north == pytest.approx(down @ expected[DV, DR] @ north, rel=0.02)


FLIGHTS = {
    # every error that a scenario can draw
    "wander-sins": {
        "imu": {
            "grade": "perfect", "gyro_bias_sigma_deg_h": 1.0, "gyro_arw_deg_sqrt_h": 0.02, "gyro_instability_deg_h": 3.0,
            "gyro_instability_time_s": 30.0, "gyro_rrw_deg_h_sqrt_h": 20.0, "gyro_scale_factor_sigma_ppm": 300.0,
            "gyro_flicker_deg_h": 2.0, "accel_flicker_ug": 200.0, "gyro_misalignment_sigma_urad": 200.0,
            "accel_bias_sigma_ug": 100.0, "accel_vrw_ug_sqrt_hz": 200.0, "accel_instability_ug": 300.0,
            "accel_instability_time_s": 20.0, "accel_scale_factor_sigma_ppm": 100.0, "accel_misalignment_sigma_urad": 100.0,
        },
        "knowledge": {"tilt_sigma_deg": 0.02, "position_sigma_m": 2.0, "velocity_sigma_mps": 0.03},
    },
    # white noise, constant biases and white fixes, which are all that the filter models
    "loosely-coupled": {
        "imu": {
            "grade": "perfect", "gyro_bias_sigma_deg_h": 5.0, "gyro_arw_deg_sqrt_h": 0.1, "accel_bias_sigma_ug": 500.0,
            "accel_vrw_ug_sqrt_hz": 100.0,
        },
        "gnss": {
            "grade": "rtk", "position_noise_m": 1.0, "velocity_noise_mps": 0.1, "wander_sigma_m": 0.0, "latency_s": 0.2,
            "interval_s": 1.0, "lever_arm_m": [1.0, 0.5, -1.5], "outages_s": [[50.0, 61.0]],
        },
        "knowledge": {"tilt_sigma_deg": 0.5, "heading_sigma_deg": 1.0, "position_sigma_m": 3.0, "velocity_sigma_mps": 0.3},
    },
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("id", FLIGHTS)
def test_an_optimal_filter_reaches_the_limit_and_does_not_beat_it(id, monkeypatch):
    """Where nothing is measured, free inertial navigation is optimal.  96 units."""
    monkeypatch.setenv("INSENV_BACKEND", "native")
    legs = [{"turn_deg": 180.0, "bank_deg": 25.0}, {"fly_s": 20.0}, {"turn_deg": -180.0, "bank_deg": 25.0}]
    vehicle = {"legs": legs, "engine": []}
    scenario = changed("aircraft-free-inertial", duration_s=200.0, rate_hz=50.0, vehicle=vehicle, **FLIGHTS[id])
    found = ensemble(scenario, [id], range(1, 97), records=200)
    truth, own = found.truth, found.outputs[id]
    places = [np.asarray(t[n]) for t in (own, truth) for n in ("latitude", "longitude", "height")]
    position = np.asarray(geodesy.numeric.ned_offset(*places))
    of_attitude, of_velocity = found.attitude_errors_deg(id), own["velocity_n"] - truth["velocity_n"]
    rms = np.sqrt(np.mean(np.concatenate([of_attitude, position, of_velocity], axis=-1) ** 2, axis=0))
    limit = insenv.limit(scenario).at(found.time)
    at = [int(np.argmin(np.abs(found.time - second))) for second in (60.0, 200.0)]
    ratios = np.array([rms[at, channel] / limit[name][at] for channel, name in enumerate(CHANNELS)])
    low, high = np.sqrt(chi2.ppf((0.00025, 0.99975), 96) / 96)  # for 20 numbers together with a probability of 99 %
    assert ratios.min() > low
    assert ratios.max() < high


CITY = {"duration_s": 60.0, "rate_hz": 20.0, "vehicle": {"engine": []}}
MORE = {
    "gnss": {
        "position_noise_m": [10.0] * 3, "velocity_noise_mps": [1.0] * 3, "velocity": False, "wander_sigma_m": [20.0] * 3,
        "outages_s": [[20.0, 50.0]], "outlier_probability": 0.5, "interval_s": 5.0,
    },
    "knowledge": {
        "tilt_sigma_deg": 5.0, "heading_sigma_deg": 30.0, "velocity_sigma_mps": [1.0] * 3,
        "position_sigma_m": [30.0, 30.0, 60.0],
    },
}  # fmt: skip


@cache
def of_city():
    return insenv.limit(changed("car-city-drive", **CITY)).at(np.arange(0.0, 60.0, 0.5))


@pytest.mark.parametrize(("section", "key"), [(section, key) for section, keys in MORE.items() for key in keys])
def test_more_error_is_not_less_limit(section, key):
    """In every channel and at every time, and more in some."""
    before, worse = of_city(), changed("car-city-drive", **CITY, **{section: {key: MORE[section][key]}})
    after = insenv.limit(worse).at(np.arange(0.0, 60.0, 0.5))
    # fixes move the ends of the steps, and so the numbers by about 1e-4
    assert all(np.all(after[name] >= before[name] * (1 - 1e-3) - 1e-7) for name in CHANNELS)
    assert max(np.max(after[name] / before[name]) for name in CHANNELS) > 1.02


def test_no_setting_of_an_estimator_and_no_seed_moves_the_limit():
    settings = {"loosely-coupled": {"innovation_gate": 0.0, "rotation_error": 0.1, "arw_deg_sqrt_h": 9.0}}
    given = {"duration_s": 4.0}
    first = insenv.run("car-city-drive", "loosely-coupled", seed=1, **given).results[0]
    second = insenv.run("car-city-drive", "loosely-coupled", seed=7, settings=settings, **given).results[0]
    other = insenv.run("car-city-drive", "aqe-ekf", seed=9, **given).results[0]
    assert first.limit == second.limit == other.limit and set(first.limit) == set(CHANNELS)
    assert not np.array_equal(first.sigma["north_m"], second.sigma["north_m"])
    result = insenv.run("ship-swaying", "q-method", **given).results[0]
    late = result.time >= result.from_s - 1e-9
    assert 0 < late.sum() < len(late)
    for name, value in result.limit.items():
        assert value == pytest.approx(np.sqrt(np.mean(result.limit_sigma[name][late] ** 2)), rel=1e-12)
        assert result.limit_sigma[name].shape == result.time.shape


def test_a_late_fix_counts_from_its_delivery():
    """Fixes at 1, 2, ... s, delivered 0.5 s later, without velocity: the position's limit falls at 1.5, 2.5, ... s."""
    scenario = changed("car-city-drive", duration_s=6.0, gnss={"latency_s": 0.5, "velocity": False, "outages_s": [[2.9, 3.5]]},
                       vehicle={"legs": [], "engine": [], "start_speed_mps": 10.0},
                       knowledge={"position_sigma_m": 100.0})  # fmt: skip
    found = insenv.limit(scenario)
    falls = found.time[1:][np.diff(found.sigma["north_m"]) < -0.005]
    assert falls == pytest.approx([1.5, 2.5, 4.5, 5.5])


@pytest.mark.parametrize("sigma", [0.01, 10.0])
def test_a_told_velocity_of_a_swaying_ship_tells_its_heading(sigma):
    """The sway goes about a place: the velocity's sigma over the speed at time 0, beside what the gyro biases allow."""
    known = {"heading_sigma_deg": 100.0, "velocity_sigma_mps": [sigma] * 3}
    scenario = changed("ship-swaying", rate_hz=20.0, imu={"grade": "tactical"}, knowledge=known)
    speed = np.hypot(0.5 * 2 * np.pi / 7.0, 0.5 * 2 * np.pi / 6.0)
    bias = np.radians(4.0 / 3600.0) / (7.2921150e-5 * np.cos(np.radians(30.0)))
    told = 1.0 / np.sqrt((speed / sigma) ** 2 + 1.0 / bias**2 + 1.0 / np.radians(100.0) ** 2)
    assert np.radians(insenv.limit(scenario).sigma["heading_deg"][-1]) == pytest.approx(told, rel=0.02)


def test_sway_does_not_tell_the_biases_of_accelerometers():
    """A moored ship is levelled to b / g and no better: it moves at the frequencies at which it turns."""
    found, b = insenv.limit(changed("ship-moored-paper", rate_hz=20.0)), 50e-6
    for channel in ("roll_deg", "pitch_deg"):
        assert np.degrees(b) * 0.95 < found.sigma[channel][-1] < np.degrees(b) * 1.1


def test_ratios_and_their_bounds():
    """Channels at the floor of the numbers have no ratio."""
    assert ratio(1.0, 9e-6, "vn_mps") is None and ratio(1.0, None, "heading_deg") is None
    assert ratio(1.0, 0.5, "heading_deg") == 2.0
    perfect = insenv.limit(changed("static-ecef", duration_s=60.0, imu={"grade": "perfect"}))
    assert all(ratio(1.0, perfect.sigma[n][-1], n) is None for n in ("roll_deg", "pitch_deg"))
    assert ratio_bounds(1) == pytest.approx((0.03, 2.24), abs=0.005)
    assert ratio_bounds(64) == pytest.approx((0.83, 1.17), abs=0.005)


def test_a_limit_is_kept_on_disk_and_a_broken_file_is_not_believed(tmp_path, monkeypatch):
    monkeypatch.setenv("INSENV_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(limits, "WORTH_KEEPING_S", 0.0)
    limits._stored.cache_clear()
    first = insenv.limit("static-ecef", duration_s=2.0)
    (path,) = (tmp_path / "limits").glob("*.npz")
    monkeypatch.setattr(limits.limits, "bound", None)  # a limit that is read is not computed
    limits._stored.cache_clear()
    again = insenv.limit("static-ecef", duration_s=2.0)
    assert all(np.array_equal(again.sigma[n], first.sigma[n]) for n in CHANNELS)
    monkeypatch.setattr(limits.limits, "bound", bound)
    path.write_bytes(b"not a file of NumPy")
    limits._stored.cache_clear()
    assert np.array_equal(insenv.limit("static-ecef", duration_s=2.0).sigma["heading_deg"], first.sigma["heading_deg"])


def test_a_limit_is_kept_for_that_on_which_it_depends_alone(tmp_path, monkeypatch):
    """Each part of a case by itself makes another limit, in memory and on disk; the seed of a run does not."""
    plant, asked = build(load("static-ecef"), seed=1), []

    def numbered(*case, **_):
        asked.append(case)
        return Limit(np.array([0.0, 1.0]), np.zeros((2, 3)), {"roll_deg": np.full(2, float(len(asked)))})

    def found(model, rows, prior, samples, in_place):
        stored = Prior(*np.split(np.array(prior), 3))
        return limits.limit_along(model, rows, stored, samples, in_place).sigma["roll_deg"][0]

    monkeypatch.setenv("INSENV_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(limits, "WORTH_KEEPING_S", -1.0)
    monkeypatch.setattr(limits.limits, "bound", numbered)
    monkeypatch.setattr(limits, "_stored", lru_cache(limits._stored.__wrapped__))
    parameters, rows, prior = plant.model.parameters, plant.model.parameters.pack(plant.parameters), np.arange(1.0, 10.0)
    model = SimpleNamespace(parameters=parameters, fingerprint="one")
    whole = {"model": model, "rows": rows, "prior": prior, "samples": 200, "in_place": True}
    other = SimpleNamespace(parameters=parameters, fingerprint="two")
    changes = [{}, {"samples": 201}, {"samples": 1}, {"in_place": False}, {"model": other}]
    changes += [{"prior": np.where(row, prior + 1e-9, prior)} for row in np.eye(9)]
    of_rows = [row for row in np.eye(len(rows)) if not row[parameters.slice("seed")].any()]
    changes += [{"rows": np.where(row, rows * 1.001 + 1e-9, rows)} for row in of_rows]
    cases = [{**whole, **change} for change in changes]
    assert [found(**case) for case in cases] == [1.0 + n for n in range(len(cases))]
    assert [case[3] for case in asked[:3]] == [200, 201, 1]
    limits._stored.cache_clear()
    again = rows.copy()
    again[parameters.slice("seed")] = 7.0
    cases.append({**whole, "rows": again})
    assert [found(**case) for case in cases] == [*(1.0 + n for n in range(len(cases) - 1)), 1.0]
    assert len(asked) == len(cases) - 1


def test_errors_of_a_unit_that_nothing_shows_keep_what_is_known_of_them():
    """At rest, over 2 s, each has its name and its component."""
    plant = build(changed("static-ecef", duration_s=2.0, imu={"grade": "perfect", "gyro_arw_deg_sqrt_h": 1.0}), seed=1)
    told = {"gyro_bias": np.array([5e-6, 1e-5, 2e-5]), "gyro_scale": np.array([1e-5, 2e-5, 3e-5]),
            "gyro_misalignment": 1e-6 * np.arange(1.0, 7.0)}  # fmt: skip
    sigmas = {f"{name.replace('scale', 'scale_factor')}_sigma": values for name, values in told.items()}
    rows = {**rows_of(plant), "gyro_bias": np.zeros(3), **sigmas}
    found = bound_of_unit(plant.model, rows, prior_of(plant.scenario.knowledge), plant.samples, in_place=True)
    gyros = {name: values for name, values in found.items() if name.startswith("gyro")}
    assert gyros.keys() == told.keys()
    for name, values in told.items():
        assert gyros[name] == pytest.approx(values, rel=0.01), name


def test_a_sensor_that_is_not_known_gives_no_limit():
    plant = build(load("car-city-drive"), seed=1)
    assert limits.no_limit(plant) == ()
    further = SimpleNamespace(commands=plant.commands, sensors=frozenset({"gnss", "odometer", "compass"}))
    assert "measurement equation of every sensor, there is none of 'compass'" in limits.no_limit(further)[0]
