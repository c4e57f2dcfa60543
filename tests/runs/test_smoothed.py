"""Fixed-interval smoothing: the compiled form against Rauch, Tung and Striebel's (1965) in NumPy; runs and replays."""

from collections import namedtuple

import casadi as ca
import numpy as np
import pytest
from changed_scenario import changed
from driven import columns_of, fed_outputs
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import insenv
from insenv import geodesy
from insenv.base.errors import InputError
from insenv.core import symmetric
from insenv.estimators import get
from insenv.estimators.loosely_coupled import SMOOTHING
from insenv.estimators.parts.error_model import ACCEL, GYRO, TILT, Interval, navigation_transition
from insenv.estimators.parts.error_model import VELOCITY as DV
from insenv.evaluation.errors import CHANNELS, POSITION, VELOCITY, errors
from insenv.runs.ensemble import ensemble
from insenv.runs.simulated import track_of
from insenv.runs.smoothed import Smoother, smooth, smoother_outputs
from insenv.scenario import build, load

PLACE = ("latitude", "longitude", "height")


Scalars = namedtuple("Scalars", "gain weight left")
"""The scalar measurements of one instant in the order used: gain (m, n); weight (m): inverse variances of the innovations, 0
with a gain of 0: not used; left (m): innovations minus what the measurements before them explained."""
Pass = namedtuple("Pass", "transition noise covariance scalars")
"""A filter's pass over K instants of a system of n states, and the scalars of each instant.

The error state is relative to the filter's state after feedback: just after the measurements of an instant its estimate is 0,
and at a measurement the state that it refers to jumps by the correction fed back.  transition, noise (K, n, n): of the interval
that *ends* at each instant; those of the first are not used.  covariance (K, n, n): after the measurements of each instant."""


def rts(run: Pass) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed error states (K, n) about the fed-back states, and their covariances (K, n, n).

    Every predicted covariance is inverted, scaled to a unit diagonal.
    """
    states, covariances = np.empty(run.covariance.shape[:2]), np.empty(run.covariance.shape)
    state, covariance = np.zeros(run.covariance.shape[-1]), run.covariance[-1]
    states[-1], covariances[-1] = state, covariance
    for k in reversed(range(len(run.covariance) - 1)):
        Phi, P, scalars = run.transition[k + 1], run.covariance[k], run.scalars[k + 1]
        predicted = Phi @ P @ Phi.T + run.noise[k + 1]
        scale = np.sqrt(np.diag(predicted))
        solved = np.linalg.solve(predicted / np.outer(scale, scale), (Phi @ P) / scale[:, None])
        gain = (solved / scale[:, None]).T
        # the smoothed state at k + 1 less the predicted one: beyond the fed-back state, and the jump to that
        state = gain @ (state + scalars.left @ scalars.gain)
        covariance = P + gain @ (covariance - predicted) @ gain.T
        states[k], covariances[k] = state, covariance
    return states, covariances


def drive(duration_s=40.0, outages=((15.0, 25.0),), seed=0, **gnss):
    """(columns, parameters of the filter) of a simulated run with the sensor errors that the filter models."""
    receiver = {"grade": "rtk", "outages_s": outages, "outlier_probability": 0.0, **gnss}
    loaded = changed("car-city-drive", rate_hz=100.0, gnss=receiver)
    plant = build(loaded, seed=seed, duration_s=duration_s)
    for key in plant.parameters:
        if "scale_factor" in key or "misalignment" in key:
            plant.parameters[key] = np.zeros_like(np.asarray(plant.parameters[key], dtype=float))
    columns = columns_of(plant)
    columns["standing"] = np.zeros(plant.samples)
    unmoved = {"rotation_error": 0.0, "thrust_error": 0.0}
    return columns, {**get("smoother").parameters(plant.knowledge), **unmoved}


def kept_pass(kept, p, own=SMOOTHING):
    """The record of a forward pass of 15 states, every instant smoothed, as a `Pass`; transitions from the error model."""
    flat = ca.SX.sym("i", own.interval.size)
    rows = own.interval.symbols(flat)
    interval = Interval(rows.last_since_propagation, rows.last_since_propagation_velocity_w, rows.last_omega_ie_w,
        rows.last_omega_ew_w)  # fmt: skip
    A = ca.SX(15, 15)
    A[:9, :9] = navigation_transition(interval, geodesy.NOMINAL_GRAVITY)
    A[TILT, GYRO] = rows.last_since_propagation_angle_gyro_bias
    A[DV, ACCEL] = -rows.last_since_propagation_angle_gyro_bias  # - integral of C_wb, of either bias
    for part, time in ((GYRO, p["gyro_correlation_time"]), (ACCEL, p["accel_correlation_time"])):
        A[part, part] = ca.SX.eye(3) * ca.expm1(-rows.last_since_propagation / time)
    function = ca.Function("A", [flat], [ca.densify(A)])
    density = np.repeat([0, p["velocity_random_walk"], p["angle_random_walk"], p["gyro_bias_sigma"], p["accel_bias_sigma"]], 3)
    density = density**2
    times = np.repeat([p["gyro_correlation_time"], p["accel_correlation_time"]], 3)
    transition, noise, covariance, scalars = [], [], [], []
    for block, instants, nominal in reversed(list(kept.backward())):
        covariance += list(symmetric.full_array(own.nominal.unpack(nominal)["covariance"], 15))
        first = np.flatnonzero(block[:, own.backward.inputs.slice("carried").start])
        assert len(instants) == len(first)
        for begin, last in zip(first, instants, strict=True):
            rows = own.backward.inputs.unpack(block[begin : last + 1])
            given = function(block[begin, -own.interval.size :]).full()
            Phi = np.eye(15)
            for i in range(15):  # row after row, as kalman.propagate applies them
                E = np.eye(15)
                E[i] = given[i] * (1 + given[i, i])
                E[i, i] = 1 + given[i, i]
                Phi = E @ Phi
            duration = rows["last_since_propagation"][0]
            Q = np.diag(density * np.r_[np.full(9, duration), -np.expm1(-2 * duration / times)])
            used = np.any([rows[name] == 1 for name in rows if name.startswith("scalar_")], axis=0)
            # all in the axes after the turns of this instant, so that the other form need not know of any
            T, gain = np.eye(15), rows["gain"].copy()
            for k in reversed(np.flatnonzero(used)):
                if rows["turned"][k]:
                    C = Rotation.from_rotvec(rows["turn"][k]).as_matrix()
                    T = T @ block_diag(np.eye(3), C, C, np.eye(6))
                gain[k] = T @ gain[k]
            transition.append(T @ Phi)
            noise.append(T @ Q @ T.T)
            scalars.append(Scalars(gain[used], rows["weight"][used], rows["left"][used]))
    return Pass(np.array(transition), np.array(noise), np.array(covariance), scalars)


def test_both_forms_agree_on_a_drive_with_an_outage_and_a_stop():
    columns, p = drive()
    wanted = np.arange(len(columns["dt"])) % 5 == 4
    columns["standing"][wanted] = (columns["time"][wanted] > 30) & (columns["time"][wanted] < 31)
    columns["gnss_latitude"] = columns["gnss_latitude"] + 1e-4 * (np.arange(len(wanted)) == 999)  # one is rejected
    run_ = Smoother(p)
    run_.take(columns, wanted)
    _, states, covariances = run_.error_states()
    kept = kept_pass(run_.record, p)
    assert min(weight for s in kept.scalars for weight in s.weight) == 0  # the one refused
    sigma = np.sqrt(np.einsum("kii->ki", covariances))
    other, other_covariances = rts(kept)
    assert np.abs((other - states) / sigma).max() < 1e-7
    assert np.abs((other_covariances - covariances) / (sigma[:, :, None] * sigma[:, None, :])).max() < 1e-7


def test_from_an_unknown_start_both_forms_agree_from_where_the_attitude_is_found():
    """Before that the states are the filter's; after it the covariance also holds what is of second order."""
    plant = build(load("ship-at-sea"), seed=4, duration_s=15.0)
    columns, few = columns_of(plant), plant.adapted(insenv.fusion((), ("gnss",), "few", smoother=True))
    p = {**plant.parameters_of(few), "rotation_error": 0.0, "thrust_error": 0.0}
    run_ = Smoother(p, few.smoothing)
    run_.take(columns, np.ones(plant.samples, dtype=bool))
    nominal, states, covariances = run_.error_states()
    values = few.smoothing.nominal.unpack(nominal)
    P = symmetric.full_array(values["covariance"], 15)
    begin = int(np.argmin(values["alignment_seeking"]))
    assert 200 < begin < 600 and not values["alignment_seeking"][begin:].any()
    assert not states[:begin].any() and np.array_equal(covariances[:begin], P[:begin])

    whole = kept_pass(run_.record, p, few.smoothing)
    later = Pass(*(part[begin:] for part in (whole.transition, whole.noise, whole.covariance, whole.scalars)))
    sigma = np.sqrt(np.einsum("kii->ki", covariances[begin:]))
    cross = np.cross(np.eye(3)[:, None], np.eye(3))  # a x b = cross[i, j] a_i b_j
    other, expected = rts(later)
    explained = P[begin:] - expected
    for part in (slice(0, 3), DV, TILT):
        both = np.einsum("kab,kcd->kacbd", P[begin:, TILT, TILT], explained[:, part, part])
        expected[:, part, part] += np.einsum("aci,bdj,kacbd->kij", cross, cross, both)
    assert np.abs((other - states[begin:]) / sigma).max() < 1e-6
    assert np.abs((expected - covariances[begin:]) / (sigma[:, :, None] * sigma[:, None, :])).max() < 1e-6


def test_the_forward_pass_is_bit_identical_to_the_filter():
    columns, p = drive(12.0, ((4.0, 8.0),))
    models = [get(id).model for id in ("loosely-coupled", "smoother")]
    runs = [fed_outputs(m, columns, p, 100) for m in models]
    smoothed = smooth(p, columns, every=len(columns["dt"]))
    for name in models[0].outputs.names:
        assert np.array_equal(runs[0][name], runs[1][name]), name
        if name in ("q_nb", "velocity_n", *PLACE, "position_sigma"):
            assert np.allclose(smoothed[name][0], runs[0][name][-1], rtol=1e-12, atol=1e-12), name


def test_where_a_first_order_holds_the_second_pass_says_what_the_first_said(monkeypatch):
    columns, p = drive(12.0, ((4.0, 8.0),))
    once = smooth(p, columns, every=60)
    monkeypatch.setattr("insenv.runs.smoothed.astray", lambda *_: True)
    monkeypatch.setattr("insenv.runs.smoothed.PASSES", 2)
    run_ = Smoother(p)
    run_.take(columns, np.arange(1, 1201) % 60 == 0)
    twice = run_.smoothed()
    assert 0.0 < run_.apart < 0.05  # it would go on
    for name, size in (("velocity_n", "velocity_sigma"), ("height", "position_sigma"), ("gyro_bias", None)):
        sigma = once[size][:, -1] if name == "height" else once[size] if size else 1e-5
        assert 0.0 < np.abs((twice[name] - once[name]) / sigma).max() < 0.05, name
    for name in ("position_sigma", "velocity_sigma", "attitude_sigma"):
        assert np.abs(twice[name] / once[name] - 1.0).max() < 0.05, name


def test_blocks_and_file_do_not_change_the_result(monkeypatch):
    columns, p = drive(12.0, ())
    whole = smooth(p, columns, every=60)
    monkeypatch.setattr("insenv.runs.smoothing_record.MEMORY", 1000)
    parts = Smoother(p)
    for begin in range(0, 1200, 120):
        parts.take({name: c[begin : begin + 120] for name, c in columns.items()}, np.arange(1, 121) % 60 == 0)
    for name, value in parts.smoothed().items():
        assert np.array_equal(value, whole[name]), name
    run_ = Smoother(p)
    run_.take(columns, (np.arange(1200) + 1) % 240 == 0)
    assert run_.record.size * 600 < 50e6  # some 45 MB for 2 h, a fix per second and 3000 smoothed instants


@pytest.mark.parametrize(("seeds", "seconds"), [(3, 40.0), pytest.param(24, 100.0, marks=pytest.mark.slow)])
def test_smoothed_errors_agree_with_their_covariance(seeds, seconds):
    """Normalised errors in mid-run, at the middle of an outage, inside the 99.9 % chi-square bounds."""
    total, count, middle = 0.0, 0, round(50 * seconds)
    for seed in range(seeds):
        columns, p = drive(seconds, ((0.5 * seconds - 5.0, 0.5 * seconds + 5.0),), seed)
        run_ = Smoother(p)
        run_.take(columns, np.arange(1, 2 * middle + 1) % middle == 0)
        y = run_.smoothed()
        nominal, _, covariances = run_.error_states()
        at = slice(middle - 1, middle)
        truth = track_of(np.zeros(1), {name: columns[name][at] for name in ("q_nb", "velocity_n", *PLACE)})
        error = errors(track_of(np.zeros(1), {name: value[:1] for name, value in y.items()}), truth)
        e = np.array([error[name][0] for name in (*POSITION, *VELOCITY)])
        wander = geodesy.numeric.geodetic_from_q_ew(SMOOTHING.nominal.unpack(nominal)["q_ew"][0])[2]
        c, s = np.cos(wander), np.sin(wander)
        turn = np.kron(np.eye(2), [[c, -s, 0], [s, c, 0], [0, 0, 1]])  # C_nw
        total += e @ np.linalg.solve(turn @ covariances[0][:6, :6] @ turn.T, e)
        count += 6
    low, high = chi2.ppf([0.0005, 0.9995], count)
    assert low < total < high, f"{total / count:.2f} per degree of freedom, bounds {low / count:.2f} to {high / count:.2f}"


def test_rounding_that_leaves_no_variance_leaves_the_filter_s():
    """Of a filter that has diverged P - P L P has negative variances."""
    rng = np.random.default_rng(3)
    L = rng.normal(size=(2, SMOOTHING.n, SMOOTHING.n))
    P = L @ L.transpose(0, 2, 1)
    packed = [np.array(ca.DM(symmetric.triangle(ca.DM(own)))).ravel() for own in P]
    level = {"q_ew": [1, 0, 0, 0], "q_wb": [1, 0, 0, 0]}
    nominal = np.array([SMOOTHING.nominal.pack({"covariance": own, **level}) for own in packed])
    kept = P / 4
    kept[1, 3, 3] = -1e-9
    shown = smoother_outputs(SMOOTHING, nominal, np.zeros((2, SMOOTHING.n)), kept)
    own = smoother_outputs(SMOOTHING, nominal, np.zeros((2, SMOOTHING.n)), P)
    for name in ("position_sigma", "velocity_sigma", "attitude_sigma"):
        assert np.isfinite(shown[name]).all() and (shown[name] <= own[name] * (1 + 1e-12)).all(), name
        assert np.allclose(shown[name][0], own[name][0] / 2), name
    assert (shown["velocity_sigma"][1] == own["velocity_sigma"][1]).sum() >= 1


def test_a_smoother_is_not_measured_by_a_filter_s_limit():
    smoothed, filtered = insenv.run("car-city-drive", ["smoother", "loosely-coupled"], duration_s=5.0).results
    assert smoothed.limit == {}
    assert set(filtered.limit) == set(smoothed.stated()) == set(CHANNELS)
    with pytest.raises(InputError, match="whole run"):
        ensemble(load("car-city-drive"), ["smoother"], [0, 1], duration_s=1.0)
