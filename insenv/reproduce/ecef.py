"""The ECEF fine-alignment paper: table 1 without noise, figures 1 and 2 with noise.

What the paper does not state is chosen here: the white noise (`ARW`, `VRW`: a laser-gyro unit with such biases) and the
initial covariance and noise of the filter, and the gravity disturbance that its model counts as noise (`READINGS`, of the
printed filter, `ecef-kf-printed`).  Table 1 is computed with two priors: `WIDE`, whose influence is below the
last digit of the paper, and that of the data sheet and the initial errors, which changes pitch by 1e-4 deg: with known
sigmas the filter attributes the drift of the down gyro partly to an east tilt, which is optimal on average over units
but not for this one.
"""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np

from insenv import attitude
from insenv.core.tables import Array
from insenv.evaluation.chi_square import quantile
from insenv.report.panels import TRUTH_GROUP, Curve, Picture, Range, TimePanel
from insenv.reproduce import Quantity, both, rms
from insenv.reproduce.unit_limits import bias_errors_deg, unit_limit
from insenv.runs.ensemble import Ensemble, ensemble
from insenv.scenario import Scenario, load

ID, PRINTED_ID = IDS = ("ecef-kf", "ecef-kf-printed")
ARW, VRW = 0.0005, 10.0  # deg/sqrt(h), ug/sqrt(Hz)
# chosen after the data-sheet prior missed 0.00003 deg in pitch; both are reported
WIDE = {"tilt_sigma": radians(1.0), "heading_sigma": radians(10.0), "gyro_bias_sigma": radians(0.01) / 3600}
READINGS = {
    "velocity of zero within 1e-2 m/s": {"zero_velocity_sigma": 1e-2},
    "velocity of zero within 1e-4 m/s": {"zero_velocity_sigma": 1e-4},
    "dg of 5e-5 m/s^1.5": {"gravity_noise": 5e-5},
    "dg of 5e-4 m/s^1.5": {"gravity_noise": 5e-4},
}
"""What the text leaves open in the printed filter (default: 1e-3 m/s at each sample, no dg)."""
SEEDS = 60
PRINTED = {"roll": (0.00117, 0.00120), "pitch": (-0.00117, -0.00117), "heading": (-0.01195, -0.00944)}
"""Theory and result as printed, deg."""
LEVEL_SIGN = "printed with the opposite sign: at rest and level, +b_aN appears as nose up and +b_aE as left side up"
HEADING_SIGN = (
    "the printed theory -0.01195 gives both parts of (42) the same sign; the balance of (22) gives them opposite signs"
)
CONDITIONS = (
    "scenario static-ecef, 200 Hz, 10 min; without noise one run, in which nothing is random; with white noise seeds 0 to"
    " 19; the NEES over seeds 0 to 59, at 50 Hz, with biases and start errors drawn. Judged by the error (estimate minus "
    "truth) at 10 min; limit: what the biases of the unit cause, with noise also what white noise leaves"
)
"""Those of all rows."""


def noisy(rate_hz: float = 200.0) -> Scenario:
    """The paper's test with white noise."""
    base = load("static-ecef")
    imu = base.imu.model_copy(update={"gyro_arw_deg_sqrt_h": ARW, "accel_vrw_ug_sqrt_hz": VRW})
    return base.model_copy(update={"imu": imu, "rate_hz": rate_hz})


def laboratory() -> Scenario:
    """The same location and noise with random biases and initial errors, for statistics over seeds."""
    base = noisy(50.0)
    imu = base.imu.model_copy(
        update={"gyro_bias_deg_h": 0.0, "accel_bias_ug": 0.0, "gyro_bias_sigma_deg_h": 0.002, "accel_bias_sigma_ug": 20.4}
    )
    drawn: dict[str, Any] = {f"{angle}_error_deg": None for angle in ("roll", "pitch", "heading")}
    knowledge = base.knowledge.model_copy(update={"draw_errors": True, **drawn})
    return base.model_copy(update={"imu": imu, "knowledge": knowledge})


def nees(runs: Ensemble, id: str = ID) -> Array:
    """Squared attitude errors normalised by the stated covariance (seeds, records); 3 on average."""
    outputs = runs.outputs[id]
    error = attitude.numeric.error_rotation_vector(outputs["q_nb"], runs.truth["q_nb"])
    return np.einsum("rti,rtij,rtj->rt", error, np.linalg.inv(outputs["attitude_covariance"]), error)


def quantities() -> list[Quantity]:
    """Table 1, and the figures and the covariance over many seeds."""
    rows = []
    for title, prior in (("wide prior", WIDE), ("data-sheet prior", {})):
        runs = ensemble(load("static-ecef"), IDS, [1], tuning=dict.fromkeys(IDS, prior), records=10)
        ours, printed = (runs.attitude_errors_deg(id)[0, -1] for id in IDS)
        expected = bias_errors_deg(runs)[0]
        for i, (name, (theirs, published)) in enumerate(PRINTED.items()):
            note = HEADING_SIGN if name == "heading" else LEVEL_SIGN
            rows.append(_row(f"{name} at 10 min, {title}", published, ours[i], printed[i], expected[i], note=note))
            # with the sign convention of the paper for the level angles, so that the two distances compare
            apart = round(abs(published - theirs), 5)
            away = np.abs([ours[i] - expected[i], printed[i] - expected[i]])
            rows.append(_row(f"{name} from theory, {title}", apart, away[0], away[1]))
        away = np.abs(np.array([ours[2], printed[2]]) - PRINTED["heading"][0])
        rows.append(_row(f"heading from the printed theory, {title}", 0.00251, away[0], away[1], note=HEADING_SIGN))

    runs = ensemble(noisy(), IDS, range(20), records=100)
    limits_deg = unit_limit(runs, bias_errors_deg(runs), float(runs.time[-1]))
    note = f"white noise assumed: {ARW:g} deg/sqrt(h), {VRW:g} ug/sqrt(Hz); limit: biases of this unit and white noise"
    for i, name in enumerate(PRINTED):
        numbers = both(IDS, lambda id, i=i: rms(runs.attitude_errors_deg(id)[:, -1, i]))  # type: ignore[misc]
        rows.append(_row(f"{name} RMS at 10 min with noise (figure 2)", None, *numbers, limits_deg[i], 20, note))
    return rows + consistency() + readings()


def readings() -> list[Quantity]:
    """Attitude at 10 min of the printed filter in other readings, without noise, with the prior of the data sheet."""
    rows = []
    for name, reading in READINGS.items():
        runs = ensemble(load("static-ecef"), [PRINTED_ID], [1], tuning={PRINTED_ID: reading}, records=10)
        errors, expected = runs.attitude_errors_deg(PRINTED_ID)[0, -1], bias_errors_deg(runs)[0]
        for i, (angle, (_, published)) in enumerate(PRINTED.items()):
            label, note = f"{angle} at 10 min, data-sheet prior, read with {name}", "a reading of the printed filter"
            rows.append(_row(label, published, None, errors[i], expected[i], note=note))
    return rows


def consistency() -> list[Quantity]:
    """NEES after convergence (from 120 s) over `SEEDS` units."""
    runs = ensemble(laboratory(), IDS, range(SEEDS), records=120)
    low, high = quantile([0.025, 0.975], 3 * SEEDS) / SEEDS
    note = f"mean NEES of 3 states within [{low:.2f}, {high:.2f}], random biases and initial errors, 120 to 600 s"
    means = {id: nees(runs, id).mean(axis=0)[runs.time >= 120.0] for id in IDS}
    average = both(IDS, lambda id: means[id].mean())
    inside = both(IDS, lambda id: 100 * float(np.mean((means[id] > low) & (means[id] < high))))
    return [
        Quantity("mean NEES of attitude", "1", None, *average, 3.0, SEEDS, note),
        Quantity("share of time with NEES in its 95 % bounds", "%", None, *inside, None, SEEDS, note),
    ]


def _row(
    quantity: str, published: float | None, ours: float | None, printed: float, limit: float | None = None, seeds: int = 1,
    note: str = "",
) -> Quantity:  # fmt: skip
    """A row in degrees."""
    ours, limit = (None if value is None else float(value) for value in (ours, limit))
    return Quantity(quantity, "deg", published, ours, float(printed), limit, seeds, note)


def pictures() -> dict[str, Picture]:
    """Figures 1 and 2 with insenv's filter and with the printed one, by the ending of their names."""
    runs = ensemble(noisy(), IDS, [1], records=1200)
    return {"": _picture(runs, ID), "-printed": _picture(runs, PRINTED_ID)}


def _picture(runs: Ensemble, id: str) -> Picture:
    """Misalignment in e as fed back by the filter, and attitude, with white noise."""
    outputs, errors, time = runs.outputs[id], runs.attitude_errors_deg(id)[0], runs.time
    sigma, fed_back = np.degrees(outputs["attitude_sigma"][0]), np.degrees(outputs["misalignment_e"][0])
    first = TimePanel("Figure 1: misalignment fed back", "deg", time)
    first.marks = [Curve(i + 2, fed_back[:, i], label=f"$\\phi_{axis}^e$") for i, axis in enumerate("xyz")]
    panels = [first]
    for i, (name, expected) in enumerate(zip(PRINTED, bias_errors_deg(runs)[0], strict=True)):
        span = 0.05 if name == "heading" else 0.004
        panel = TimePanel(f"Figure 2: {name} error", "deg", time, span=(-span, span))
        low, high = expected - sigma[:, i], expected + sigma[:, i]
        panel.marks = [
            Range(TRUTH_GROUP, low, high, label="error by the biases ± stated sigma"),
            Curve(TRUTH_GROUP, np.full(len(time), expected), "model", label="error by the biases"),
            Curve(0, errors[:, i]),
        ]
        panels.append(panel)
    title = "Fine alignment at rest with white noise, seed 1, 10 min"
    return Picture(title, [panels[:2], panels[2:]], (id,), (9.0, 6.5), columns=3)
