"""`lssvm`: large-misalignment alignment by a least-squares support vector machine that has learnt from `aqe-sukf`.

Source: the LS-SVM large misalignment paper, sections 3 and 4.  In the loop the machine takes the place of the filter: from the
differences of SINS and GNSS (`insenv.estimators.parts.sins_gnss_differences`) it tells the misalignment, which is fed back to
the SINS.

    y(x) = sum over i of a_i K(x, x_i) + b,   K = exp(-|x - x_i|^2 / sigma^2)                                  (14)

Outputs: the vector part of half of R - R^T about north, east, down: the misalignment's axis times the sine of its angle.  It
is the rotation vector for small angles, and unlike that has no jump at 180 deg.  Fed back at every fix it brings any
misalignment to nothing in some steps, for what remains is seen at the next fix in the same differences, turned.

The kernel's exponential is a Taylor polynomial at 1/64 of the argument, squared six times: exactly rounded operations, and
`insenv.learning` learns with the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import casadi as ca

from insenv import geodesy
from insenv.core.elementary import minimum, polynomial, select
from insenv.core.model import Model, Step
from insenv.core.tables import Row, Table
from insenv.estimators import lssvm_file
from insenv.estimators.contract import Estimator, Knowledge
from insenv.estimators.loosely_coupled_tables import INPUTS as AIDED_INPUTS
from insenv.estimators.parts import sins_gnss_differences as lssvm_differences
from insenv.estimators.parts.sins_gnss_differences import FEATURES, READY

SUPPORT = 96
"""Support vectors that the model has room for; a machine with fewer leaves the rest at coefficient 0."""
LARGEST_ARGUMENT = 40.0
_EXP = tuple(1 / math.factorial(k) for k in range(10))

MACHINE = Table((
    Row("support", "Support vectors, over the kernel's width", "1", (SUPPORT, FEATURES), lower=-1e9, upper=1e9),
    Row("coefficients", "Coefficient of each in each output", "rad", (SUPPORT, 3), lower=-1e12, upper=1e12),
    Row("offset", "Constant term of each output", "rad", (3,), "n", lower=-1e12, upper=1e12),
    Row("scale", "What the inputs are multiplied by: 1 / the kernel's width", "1", (FEATURES,), lower=0.0, upper=1e12),
    Row("machine_sigma", "Scatter of the machine's output about that of the filter that it learnt from", "rad", (3,), "n",
        lower=0.0, upper=10.0),
))  # fmt: skip
"""The machine as parameter rows: all zero, it leaves the SINS as it is told."""

PARAMETERS = lssvm_differences.PARAMETERS + Table((
    Row("tilt_sigma", "Standard deviation of the start roll and pitch", "rad", start=1.0, lower=0.0, upper=10.0),
    Row("heading_sigma", "Standard deviation of the start heading", "rad", start=1.0, lower=0.0, upper=10.0),
)) + MACHINE  # fmt: skip

INPUTS = Table(tuple(row for row in AIDED_INPUTS if row.name != "standing"))

STATE = lssvm_differences.STATE + Table((
    Row("features", "The machine's inputs at the last fix", "1", (FEATURES,), "n"),
    Row("infer_due", "1 when the machine is to be asked"),
    Row("answers", "How often it has been asked", "1"),
))  # fmt: skip

OUTPUTS = Table((
    Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),
    Row("attitude_sigma", "Stated accuracy about north, east, down", "rad", (3,), "n"),
    Row("features", "The machine's inputs at the last fix", "1", (FEATURES,), "n"),
    Row("ready", "1 when the heading shows in them", "1"),
))  # fmt: skip


def kernel(square: Any) -> Any:
    """exp(-square) of a squared distance (SX, or an array), to 1e-7 of the value where that exceeds 1e-6, 1e-17 below."""
    clipped = minimum(square, LARGEST_ARGUMENT) if isinstance(square, (float, ca.SX)) else square.clip(max=LARGEST_ARGUMENT)
    value = polynomial(clipped * (-1 / 64), _EXP)
    for _ in range(6):
        value = value * value
    return value


def machine(p: Any, x: Any) -> Any:
    """Output (3, rad) of the machine for inputs (6), (14)."""
    scaled, answer = x * p.scale, p.offset
    for i in range(SUPPORT):
        answer = answer + p.coefficients[i, :].T * kernel(ca.sumsqr(scaled - p.support[i, :].T))
    return answer


def sample(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One inertial sample."""
    return {**lssvm_differences.sample(p, x, u), "infer_due": 0}


def fix(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """One fix: the differences, and the machine's inputs."""
    rows = lssvm_differences.fix(p, x, u)
    after = SimpleNamespace(**{**vars(x), **rows})
    ready = select(lssvm_differences.heading_sigma(after) < READY, 1.0, 0.0)
    return {**rows, "features": lssvm_differences.features(p, after), "infer_due": ready}


def infer(p: Any, x: Any, u: Any) -> dict[str, Any]:
    """The machine asked, and its answer fed back."""
    return {"q_n0i": lssvm_differences.turned_back(x, machine(p, x.features)), "answers": x.answers + 1}


def output(p: Any, x: Any) -> dict[str, Any]:
    """Attitude, and what noises, biases and the machine's own scatter leave; before the first answer what was told."""
    horizontal = geodesy.OMEGA_IE * (ca.fabs(x.axis_n[0]) + 1e-12)
    by_bias = p.accel_bias_sigma / x.gravity
    tilt, heading = lssvm_differences.tilt_sigma(x), lssvm_differences.heading_sigma(x)
    sigma = ca.sqrt(
        ca.vertcat(
            tilt**2 + by_bias**2,
            tilt**2 + by_bias**2,
            heading**2 + (p.gyro_bias_sigma / horizontal) ** 2 + (by_bias * x.axis_n[2]) ** 2 / (x.axis_n[0] ** 2 + 1e-24),
        )
        + p.machine_sigma**2
    )
    told = ca.vertcat(p.tilt_sigma, p.tilt_sigma, p.heading_sigma)
    asked = x.answers > 0
    return {
        "q_nb": lssvm_differences.q_nb(x),
        "attitude_sigma": ca.vertcat(*[select(asked, minimum(sigma[i], told[i] + sigma[i]), told[i]) for i in range(3)]),
        "features": x.features,
        "ready": select(lssvm_differences.heading_sigma(x) < READY, 1.0, 0.0),
    }


MODEL = Model(
    id="lssvm",
    title="large misalignment in place: least-squares support vector machine that has learnt from aqe-sukf",
    parameters=PARAMETERS,
    state=STATE,
    inputs=INPUTS,
    outputs=OUTPUTS,
    steps={
        "sample": Step(sample),
        "fix": Step(fix, when="gnss_valid"),
        "infer": Step(infer, when="infer_due"),
    },
    output=output,
    start=lssvm_differences.start,
)


def prepare(known: Knowledge) -> dict[str, Any]:
    """Parameters from what is known, with the machine that insenv ships."""
    sensors = known.sensors
    return {
        "latitude": known.latitude,
        "longitude": known.longitude,
        "height": known.height,
        "start_roll": known.roll,
        "start_pitch": known.pitch,
        "start_heading": known.heading,
        "tilt_sigma": min(known.tilt_sigma, math.pi),
        "heading_sigma": min(known.heading_sigma, 2 * math.pi),
        "gyro_bias_sigma": sensors.gyro_bias_sigma,
        "accel_bias_sigma": sensors.accel_bias_sigma,
        "angle_random_walk": sensors.angle_random_walk,
        "velocity_random_walk": sensors.velocity_random_walk,
        "antenna_lever_arm": known.antenna_lever_arm,
        **shipped(),
    }


def read_file(path: str) -> Mapping[str, Any]:
    """Rows of `MACHINE` of a file that `insenv train lssvm` wrote.  Raises `InputError`."""
    return lssvm_file.load(path).rows(SUPPORT)


def shipped() -> Mapping[str, Any]:
    """Rows of `MACHINE` of the file that insenv ships."""
    return lssvm_file.shipped().rows(SUPPORT)


ESTIMATOR = Estimator(MODEL, kind="alignment", sensors=("gnss",), prepare=prepare, read_file=read_file)
