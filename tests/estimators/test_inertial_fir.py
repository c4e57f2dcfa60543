"""inertial-fir: its delay, weights and stated noise, levelling, any attitude, rate and place."""

import casadi as ca
import numpy as np
import pytest
from driven import fed
from resting import ATTITUDES, at_rest, attitude_error, drawn, samples
from scipy.linalg import solve_continuous_are
from scipy.signal import freqz

import insenv
from insenv import attitude, geodesy
from insenv.core.runner import make_runner
from insenv.estimators import get, inertial_fir
from insenv.estimators.inertial_fir import BLOCK_S, FILTERS, STRIDES
from insenv.geodesy import OMEGA_IE
from insenv.reproduce.unit_limits import bias_tilts
from insenv.scenario import load, parse
from insenv.scenario.inputs import input_rows
from insenv.studies.campaign.block import run_block
from insenv.studies.campaign.plan import make_plan

G, LATITUDE, LEVEL = 9.8, 0.6, np.array([1.0, 0.0, 0.0, 0.0])
QUIET = dict.fromkeys(("accel_bias_sigma", "gyro_bias_sigma", "angle_random_walk", "velocity_random_walk"), 0.0)


def impulse_response():
    """Of the cascade of low-passes as one filter at the rate of the blocks, (span,)."""
    total = np.ones(1)
    for h, stride in zip(FILTERS, STRIDES, strict=True):
        spread = np.zeros((len(h) - 1) * stride + 1)
        spread[::stride] = h
        total = np.convolve(total, spread)
    return total


def test_a_ramp_is_delayed_by_exactly_the_stated_delay():
    """Specific force rising linearly along body z, no rotation: every filtered vector is the ramp at its own time."""
    dt, n = 0.05, 2600
    end = dt * np.arange(1, n + 1)
    columns = {
        "delta_angle": np.zeros((n, 3)),
        "delta_velocity": np.stack([0 * end, 0 * end, 0.01 * (end**2 - (end - dt) ** 2) / 2], axis=1),  # of 0.01 t m/s^2
        "dt": np.full(n, dt),
    }
    model = get("inertial-fir").model
    state = fed(model, columns, {"block_samples": 2}).state
    assert state["blocks"] == 1300
    ages = (0.5 + inertial_fir.CASCADE_DELAY) * 0.1 + 2.0 * np.arange(5)  # of the newest ones, all with full memory
    assert np.abs(state["filtered"][:5, 2] - 0.01 * (130.0 - ages)).max() < 1e-10 * 1.3
    assert abs((0.5 + inertial_fir.CASCADE_DELAY) * 0.1 + 54.0 - inertial_fir.DELAY * 0.1) < 1e-9


def test_the_stated_noise_is_that_of_the_weights():
    """The weights by the recursion of the mean, also after the memory is full."""
    memory = 100.0
    for fixes in (1, 5, 10, 30, 60, 150, 300):
        stated = [float(v) for v in inertial_fir.noise_times(2.0 * (fixes - 1), memory)]
        expected = times_of(edges_after(fixes, memory), inertial_fir.END)
        assert stated == pytest.approx(expected, rel=0.13)
        assert stated[0] == pytest.approx(expected[0], rel=0.02)
    printed = np.zeros(55)
    printed[54], printed[0] = 1 / 54, -1 / 54
    for elapsed in (0.0, 60.0):
        assert [float(v) for v in inertial_fir.noise_times(elapsed, 0.0)] == pytest.approx(times_of(printed, (1.0,)), rel=1e-3)


def edges_after(fixes, memory):
    """Weights of the ends at the edges, per step, the oldest first (54 + fixes), by the recursion of the mean."""
    ends = np.zeros(54 + fixes)
    ends[54], ends[0] = 1 / inertial_fir.START, -1 / inertial_fir.START
    for k in range(1, fixes):
        new = 1 / (inertial_fir.START + min(k, memory / 2))
        ends *= 1 - new
        ends[54 + k] += new
        ends[54 + k - 1] -= new
    return ends


def times_of(edges, end):
    """Inverse integrals of the squares of the weights of drift, and of their slopes (s, s^3)."""
    slopes = slopes_of(edges, end)
    assert abs(slopes.sum()) < 1e-12
    drift = np.cumsum(slopes)
    assert abs(drift.sum() * 0.1) == pytest.approx(1.0, abs=1e-9)
    return [1 / (np.sum(drift**2) * 0.1), 1 / (np.sum((slopes / 0.1) ** 2) * 0.1)]


def slopes_of(edges, end):
    """Weights of the tilts of the blocks, the oldest first, in the rate of tilt (1/s).

    edges: weights of the ends, per step, the oldest first; end: the weights inside an end. The oldest end is the mirror image.
    """
    vectors = np.zeros(len(edges))
    for place in np.flatnonzero(edges):
        inward = np.arange(len(end)) * (1 if place == 0 else -1)
        vectors[place + inward] += edges[place] * np.array(end)
    blocks = np.zeros((len(vectors) - 1) * 20 + 1)
    blocks[::20] = vectors / 2.0  # 1/s
    return np.convolve(impulse_response(), blocks)


@pytest.mark.parametrize("memory", [20.0, 600.0])
def test_the_heading_weighs_the_forces_as_its_stated_noise_says(memory):
    """The answer to small northward forces, another one in each block, over 240 s: their sum with the weights of the mean."""
    latitude, blocks = 0.5, 2400
    fixes = (blocks - inertial_fir.SPAN) // inertial_fir.STRIDE + 1
    slopes = slopes_of(edges_after(fixes, memory), inertial_fir.END)
    used = inertial_fir.SPAN + (fixes - 1) * inertial_fir.STRIDE
    force = np.zeros((blocks, 3))
    force[:, 0] = 1e-6 * np.random.default_rng(3).standard_normal(blocks)
    given = {"block_samples": 1, "heading_memory": memory}
    runners = [at_rest("inertial-fir", LEVEL, latitude, 240.0, 0.1, given, accel_bias=a) for a in (0.0 * force, force)]
    quiet, shaken = (attitude_error(runner, LEVEL)[2] for runner in runners)
    gravity = float(geodesy.numeric.normal_gravity(np.sin(latitude), 0.0))
    expected = slopes @ force[used - len(slopes) : used, 0] / (gravity * geodesy.OMEGA_IE * np.cos(latitude))
    assert shaken - quiet == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("latitude", [-1.5, -0.6, 0.02, 1.2])
def test_any_attitude_is_found_but_for_the_attenuation_of_what_turns_with_the_earth(latitude):
    """Gravity appears that much closer to the axis."""
    gain = np.abs(freqz(impulse_response(), worN=[OMEGA_IE], fs=2 * np.pi / 0.1)[1][0])
    tilt = np.sin(2 * latitude) / 2 * (1 - gain)
    for q_nb in [*ATTITUDES, drawn(1)]:
        error = attitude_error(at_rest("inertial-fir", q_nb, latitude, 180.0, parameters={"block_samples": 2}), q_nb)
        assert np.allclose(error[:2], [0, tilt], atol=1e-9)
        assert abs(error[2]) < 2e-9 / np.cos(latitude)


@pytest.mark.parametrize("rate", [50.0, 100.0, 125.0, 400.0])
def test_one_model_serves_all_rates(rate):
    """Also where 0.1 s is not a whole number of samples: the delay uses the actual length of a block."""
    q_nb, known = attitude.numeric.from_euler(0.1, -0.2, 2.0), {"block_samples": max(1, round(0.1 * rate))}
    assert np.abs(attitude_error(at_rest("inertial-fir", q_nb, 0.5, 184.0, 1 / rate, known), q_nb)).max() < 2e-7


def test_a_day_at_rest():
    """24 h: attitude stays at its limit (the averaged heading lags by 600 s of drift), covariance positive definite."""
    latitude, bias = 0.7, np.radians([0.008, -0.008, 0.008]) / 3600
    columns, model = samples(LEVEL, latitude, 0.1, 0.1, gyro_bias=bias), get("inertial-fir").model
    runner = make_runner(model, {"latitude": latitude, "block_samples": 1, "gyro_bias_sigma": 4e-8})
    runner.run(864_000, input_rows(model, columns, 1)[0], 0)
    assert np.allclose(attitude_error(runner, LEVEL), bias_tilts(bias, np.zeros(3), latitude, 0.0), atol=4e-5)
    v, t, vt = (float(runner.state[name]) for name in ("velocity_variance", "tilt_variance", "velocity_tilt"))
    assert v > 0 and t > 0 and vt * vt < v * t


def levelled(seconds, **parameters):
    """Tilt variance of `inertial-fir` after blocks of levelling from a known one, with a sway too large to learn from."""
    model = get("inertial-fir").model
    values = {"sway_velocity_sigma": 100.0, **QUIET, **parameters}
    p, block = model.parameters.pack(values), model.kernels["level"]
    x = model.state.pack({"block_time": BLOCK_S, "gravity": G, "axis_n": [np.cos(LATITUDE), 0, -np.sin(LATITUDE)],
                          "tilt_variance": 0.0,
                          "velocity_variance": 0.0, "force_sum": [0, 0, -G * BLOCK_S]})  # fmt: skip
    u = model.inputs.start_vector()
    for _ in range(round(seconds / BLOCK_S)):
        done, result = 0, np.array(block.function(p, x, u, [])).ravel()
        for span in block.spans:
            x[span] = result[done : done + span.stop - span.start]
            done += span.stop - span.start
    return float(model.state.unpack(x)["tilt_variance"])


def test_levelling_allows_for_the_drift_of_the_gyros():
    """White noise grows with the time; a bias as noise that drifts as far as it does in 100 s."""
    assert levelled(100.0, gyro_bias_sigma=4e-8) == pytest.approx((4e-8 * 100.0) ** 2, rel=1e-3)
    assert levelled(100.0, angle_random_walk=2e-7) == pytest.approx(2e-7**2 * 100.0, rel=1e-3)


def test_levelling_reaches_the_variance_of_the_optimal_loop():
    """Two states, velocity and tilt, against the steady Riccati equation of the continuous filter."""
    N, V, sway = 5e-6, 1e-3, 0.3
    F, H = np.array([[0.0, G], [0.0, 0.0]]), np.array([[1.0, 0.0]])
    P = solve_continuous_are(F.T, H.T, np.diag([V**2, N**2]), np.array([[sway**2]]))
    found = levelled(300.0, angle_random_walk=N, velocity_random_walk=V, sway_velocity_sigma=sway)
    assert found == pytest.approx(P[1, 1], rel=0.05)


def test_tilt_of_the_fix_allows_for_what_the_gyros_drift_in_its_delay():
    """At the first fix, of a vertical in the middle of the vectors: the delay of the cascade and half the baseline."""
    model = get("inertial-fir").model
    runner = make_runner(model, {**QUIET, "gyro_bias_sigma": 4e-8, "latitude": LATITUDE}, "interpreter")
    runner.x[:] = model.state.pack({"fixes": 1.0, "tilt_variance": 0.0}, base=runner.x)
    delay = BLOCK_S * (inertial_fir.CASCADE_SPAN / 2) + 54.0
    assert runner.outputs()["attitude_sigma"][:2] == pytest.approx([4e-8 * delay] * 2, rel=1e-6)
    assert runner.outputs()["attitude_sigma"][2] == pytest.approx(4e-8 / (OMEGA_IE * np.cos(LATITUDE)), rel=1e-6)


def test_the_mean_square_of_the_horizontal_acceleration_is_followed_in_a_minute():
    """A force of 0.5 m/s^2 across gravity, after one block: the first step of s' = (a^2 - s) / 60 s."""
    model, block = get("inertial-fir").model, 0.1
    state = {"block_time": block, "gravity_n": [0.0, 0.0, G], "gravity": G, "shaking": 0.01, "axis_n": [1.0, 0.0, 0.0],
             "force_sum": np.array([0.3, -0.4, -G]) * block}  # fmt: skip
    p, x = (table.symbols(ca.DM(table.pack(rows))) for table, rows in ((model.parameters, {}), (model.state, state)))
    found = float(ca.DM(ca.evalf(inertial_fir.level(p, x, None)["shaking"])))
    assert found == pytest.approx(0.01 + block / 60.0 * (0.25 - 0.01), rel=1e-5)


@pytest.mark.parametrize("tilt", [(2e-4, 0.0), (-1e-4, 3e-4)])
def test_levelling_removes_a_tilt_about_either_axis(tilt):
    """At rest, from a tilt that its variance allows: velocity feedback takes it out within two minutes."""
    model, dt = get("inertial-fir").model, 0.1
    given = {"latitude": LATITUDE, "block_samples": 1, "sway_velocity_sigma": 0.01, "heading_memory": 0.0, **QUIET}
    q = np.array([1.0, tilt[0] / 2, tilt[1] / 2, 0.0])
    rows = {"begin": 0.0, "fixes": 1.0, "q_n0i": q / np.linalg.norm(q), "velocity_variance": 1e-4, "tilt_variance": 1e-7}
    columns = samples([1.0, 0, 0, 0], LATITUDE, 120.0, dt)
    left = 2 * fed(model, columns, given, "interpreter", **rows).outputs()["q_nb"][1:3]
    assert np.abs(left).max() < 0.02 * np.abs(tilt).max()


def test_the_cascade_passes_the_vertical_attenuates_sway_and_delays_by_half_its_span():
    """What would fold into the band in a decimation is a part of the response of the equivalent filter."""
    h = impulse_response()
    assert [sum(own) for own in inertial_fir.FILTERS] == pytest.approx([1.0] * 3, abs=1e-10)
    passed = np.abs(freqz(h, worN=np.linspace(0, inertial_fir.PASS_HZ, 300), fs=10)[1])
    assert np.abs(passed - 1).max() <= 0.01
    assert len(h) == inertial_fir.CASCADE_SPAN == 711
    f = np.linspace(inertial_fir.STOP_HZ, 5, 40_000)
    assert 20 * np.log10(np.abs(freqz(h, worN=f, fs=10)[1]).max()) <= -inertial_fir.STOP_DB + 0.01
    # group delay: the phase is linear to rounding
    f = np.linspace(1e-4, 0.02, 50)
    response = freqz(h, worN=f, fs=10)[1] * np.exp(2j * np.pi * f / 10 * inertial_fir.CASCADE_DELAY)
    assert np.abs(response.imag).max() < 1e-12
    assert abs(inertial_fir.SPAN * BLOCK_S - 180.0) < 1e-9


SURGE = {"amplitude_m": 0.3, "period_s": 25.0}


def surging(surge, latitude_deg):
    """Errors and stated sigmas (8 runs, times from 200 s on; roll, pitch, heading; deg) of a ship that surges."""
    values = load("ship-slow-surge").model_dump(mode="json", warnings=False)
    values["vehicle"]["sway"]["north"][1] = surge
    values["start"]["latitude_deg"] = latitude_deg
    plan = make_plan(parse(values, "surge", "surge"), "inertial-fir", 8, first_seed=300)
    block = run_block(plan, 0)
    return [block[name][:, plan.times >= 200.0][:, :, :3] for name in ("error", "sigma")]


@pytest.mark.parametrize(("surge", "latitude_deg"),
    [(SURGE, 45.0), pytest.param({"amplitude_m": 2.0, "period_s": 18.0}, 70.0, marks=pytest.mark.slow)])  # fmt: skip
def test_motion_below_the_stop_band_counts_in_the_stated_sigmas(surge, latitude_deg):
    """Without it, three of four headings are beyond three sigma."""
    error, sigma = surging(surge, latitude_deg)
    assert ((np.abs(error) > 3 * sigma).mean(axis=(0, 1)) <= 0.01).all()
    rms, stated = (np.sqrt((part[:, part.shape[1] // 2 :] ** 2).mean(axis=(0, 1))) for part in (error, sigma))
    assert (stated < [6 * rms[0], 6 * rms[1], 2 * rms[2]]).all()
    if surge == SURGE:  # levelling allows for the Earth's rotation that a wrong heading leaves over
        assert rms[:2].max() < 0.0025


@pytest.mark.parametrize(("scenario", "codes"), [("ship-swaying", []), ("ship-slow-surge", ["slow-motion"])])
def test_slow_motion_is_named(scenario, codes):
    """Not the bend of gravity's way, 2e-3 m/s^2 in ten minutes, nor noise of the stated size."""
    report = insenv.run(scenario, "inertial-fir", duration_s=600.0, seed=5)
    assert [note.code for note in report.results[0].notes] == codes
