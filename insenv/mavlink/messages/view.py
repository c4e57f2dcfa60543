"""The simulated vehicle as its messages see it: the simulation, and quantities derived from it on first use."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, nan, pi, radians
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.core.elementary import wrap_angle
from insenv.core.numeric import vectorized
from insenv.core.tables import Vector
from insenv.evaluation.contradiction import FIXES
from insenv.evaluation.nis import WRONG
from insenv.geodesy import STANDARD_GRAVITY
from insenv.mavlink.messages.fields import DEG_E7, Fields
from insenv.mavlink.simulation import POSE, Simulation
from insenv.mavlink.surroundings import AirData, air_data

# Quantities that messages need beyond truth and estimate, in one symbolic function: angles, body rates, covariances.
#
# The attitude error is a rotation vector e in n with the estimator's stated sigmas, uncorrelated.  To first order it
# changes
#
#     roll    by (cos psi e_N + sin psi e_E) / cos theta
#     pitch   by cos psi e_E - sin psi e_N
#     heading by e_D + tan theta (cos psi e_N + sin psi e_E)
#
# where psi is the heading and theta the pitch.

DERIVED = (
    "euler", "rate_nb_b", "velocity_b", "offset", "longitude_wrapped", "true_rate_nb_b", "true_longitude_wrapped",
    "pose_covariance", "velocity_covariance",
)  # fmt: skip
"""Estimated: roll, pitch, heading (-pi to pi, rad); rates of b relative to n (3, rad/s); velocity (3, m/s, b); position from
home along the NED axes at home (3, m); longitude (-pi to pi, rad).  True rates and longitude.  Covariances as upper triangles
by rows (21): of position in n (m), roll, pitch, heading (rad), and of velocity in b (m/s), rates (rad/s)."""


def _derived(
    q_nb: Any, velocity_n: Any, latitude: Any, longitude: Any, height: Any, rate_ib_b: Any, home: Any,
    true_q_nb: Any, true_velocity_n: Any, true_latitude: Any, true_longitude: Any, true_height: Any, true_rate_ib_b: Any,
    position_sigma: Any, velocity_sigma: Any, attitude_sigma: Any, rate_sigma: Any,
) -> tuple[Any, ...]:  # fmt: skip
    """`DERIVED` from estimate and truth.

    rate_ib_b: measured, minus the estimated bias (3, rad/s).  home: latitude, longitude (rad), height (m).  position_sigma,
    velocity_sigma (3, m, m/s, n), attitude_sigma (3, rad, n): stated by the estimator, NaN if it states none.  rate_sigma: of
    the measured rate (rad/s).
    """
    wrapped_longitude = wrap_angle(longitude)
    roll, pitch, heading = attitude.to_euler(q_nb)
    s, c = ca.sin(heading), ca.cos(heading)
    across, tangent = 1.0 / ca.cos(pitch), ca.tan(pitch)
    turning = ca.vertcat(
        ca.horzcat(c * across, s * across, 0.0), ca.horzcat(-s, c, 0.0), ca.horzcat(c * tangent, s * tangent, 1.0)
    )
    angles = turning @ ca.diag(attitude_sigma**2) @ turning.T
    C_bn = attitude.to_dcm(q_nb).T
    velocity = C_bn @ ca.diag(velocity_sigma**2) @ C_bn.T
    return (
        ca.vertcat(roll, pitch, heading),
        rate_ib_b - _rate_in_b(q_nb, velocity_n, latitude, height),
        attitude.rotate_inverse(q_nb, velocity_n),
        geodesy.ned_offset(latitude, wrapped_longitude, height, *ca.vertsplit(home)),
        wrapped_longitude,
        true_rate_ib_b - _rate_in_b(true_q_nb, true_velocity_n, true_latitude, true_height),
        wrap_angle(true_longitude),
        _triangle(ca.diagcat(ca.diag(position_sigma**2), angles)),
        _triangle(ca.diagcat(velocity, ca.SX.eye(3) * rate_sigma**2)),
    )


def _rate_in_b(q_nb: Any, velocity_n: Any, latitude: Any, height: Any) -> Any:
    """omega_in^b: Earth rate plus transport rate, in b."""
    rate_n = geodesy.earth_rate_n(latitude) + geodesy.transport_rate_n(velocity_n, latitude, height)
    return attitude.rotate_inverse(q_nb, rate_n)


def _triangle(matrix: Any) -> Any:
    full = ca.densify(matrix)
    return ca.vertcat(*[full[i, j] for i in range(6) for j in range(i, 6)])


_evaluate = vectorized(_derived, 4, 3, (), (), (), 3, 3, 4, 3, (), (), (), 3, 3, 3, 3, ())


@dataclass(frozen=True)
class Mode:
    """What steers the vehicle.  number: MAVLink's custom mode.  automatic: whether it follows the script."""

    number: int
    name: str
    automatic: bool


_UNKNOWN, _STANDING = np.full(3, np.nan), np.zeros(3)
SCRIPTED, MANUAL = Mode(0, "Scenario", True), Mode(1, "Manual control", False)

TILT_LIMIT_DEG, HEADING_LIMIT_DEG, VELOCITY_LIMIT, POSITION_LIMIT = 1.0, 5.0, 1.0, 20.0
"""Stated 1-sigma below which an estimate counts as good: deg, deg, m/s, m."""
SURE = 3.0
"""Number of standard deviations by which data must tell a wrong heading from the right one."""
IMU_LOST = 10
"""Consecutive lost samples after which the inertial unit counts as failed."""
MILLI_G, MM_S2 = 1e3 / STANDARD_GRAVITY, 1e3
"""Units of accelerations in HIL_STATE_QUATERNION per m/s^2: of MAVLink's definition, and as PX4 reads them."""


class View:
    """The state from which messages are made.

    start_unix: Unix time (s) at the start of the run.  undulation: height of the geoid above the ellipsoid (m), the
    same everywhere: height above mean sea level = ellipsoidal height - undulation.  system, component: the sender that
    messages state; clients look for component 1.  hil_acceleration: `MILLI_G` or `MM_S2`.  mode: the present one of
    `modes`.  home: the known initial latitude, longitude (rad) and height (m).  traits: of the vehicle.  load: share of
    one core that the process takes.

    truth, estimate: outputs of the plant and of the estimator by row name.  sent_increments, sent_readings, sent_fix,
    sent_gps_at: what messages of the sensors have sent last.
    """

    def __init__(
        self,
        simulation: Simulation,
        start_unix: float,
        *,
        undulation: float = 0.0,
        system: int = 1,
        component: int = 1,
        hil_acceleration: float = MILLI_G,
    ) -> None:
        self.simulation = simulation
        self.truth, self.estimate = simulation.truth, simulation.estimate
        self.fields = Fields()
        self.start_unix, self.undulation = start_unix, undulation
        self.system, self.component = system, component
        self.hil_acceleration = hil_acceleration
        self.mode = SCRIPTED
        self.armed = True
        self.load = 0.0
        known = simulation.plant.knowledge
        self.home = known.latitude, wrapped(known.longitude), known.height
        self.traits = simulation.plant.scenario.vehicle.traits
        self.sent_increments: dict[str, tuple[int, Vector]] = {}
        self.sent_readings: dict[str, dict[str, int]] = {}
        self.sent_fix = self.sent_gps_at = 0
        self._rate_sigma = known.sensors.angle_random_walk / np.sqrt(simulation.interval)
        self._values: dict[str, Any] = {}
        self._values_at = -1
        self._air: AirData | None = None
        self._air_at = (-1, 0.0)

    def forget(self) -> None:
        """Discard derived quantities: the estimate has changed between two samples."""
        self._values_at = -1

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes that the vehicle can have."""
        return (SCRIPTED, MANUAL) if self.simulation.commands else (SCRIPTED,)

    # --- time ---------------------------------------------------------------------------------------

    @property
    def time_us(self) -> int:
        """The simulation clock in microseconds, MAVLink's time since boot."""
        return round(self.simulation.time * 1e6)

    @property
    def time_ms(self) -> int:
        """The simulation clock in milliseconds."""
        return round(self.simulation.time * 1e3)

    @property
    def unix_us(self) -> int:
        """Unix time of the simulation clock in microseconds."""
        return round(self.start_unix * 1e6) + self.time_us

    # --- estimate and sensors -----------------------------------------------------------------------

    @property
    def values(self) -> dict[str, Any]:
        """The quantities `DERIVED` at the present sample."""
        simulation, truth, estimate = self.simulation, self.truth, self.estimate
        if self._values_at != simulation.samples:
            self._values_at = simulation.samples
            place, stated = (self.estimated(name) for name in ("latitude", "longitude", "height")), self.position_sigma
            rate_ib_b = truth["delta_angle"] / simulation.interval - estimate.get("gyro_bias", 0.0)
            results = _evaluate(
                estimate["q_nb"], self.estimated_velocity_n, *place, rate_ib_b, self.home,
                *(truth[name] for name in POSE), truth["true_delta_angle"] / simulation.interval,
                _UNKNOWN if stated is None else stated, estimate.get("velocity_sigma", _UNKNOWN),
                estimate.get("attitude_sigma", _UNKNOWN), self._rate_sigma,
            )  # fmt: skip
            self._values = dict(zip(DERIVED, results, strict=True))
        return self._values

    def derived(self, *names: str) -> list[float]:
        """The elements of some of `DERIVED`, one after another."""
        return [element for name in names for element in self.values[name].tolist()]

    def estimated(self, name: str) -> float:
        """Estimated latitude, longitude (rad) or height (m); of an alignment the known initial one."""
        return float(self.estimate[name] if name in self.estimate else getattr(self.simulation.plant.knowledge, name))

    @property
    def estimated_velocity_n(self) -> Vector:
        """Estimated velocity (3, m/s, n); of an alignment zero."""
        return self.estimate.get("velocity_n", _STANDING)

    @property
    def air(self) -> AirData:
        """Magnetometer, barometer and air at the present sample."""
        simulation = self.simulation
        if self._air is None or self._air_at != (simulation.samples, self.undulation):
            self._air_at = simulation.samples, self.undulation
            self._air = air_data(self.truth, self.undulation, simulation.readings["barometer"], simulation.plant.seed)
        return self._air

    def place(self, latitude: float, longitude: float, height: float) -> tuple[float, float, float]:
        """Latitude and longitude (1e-7 deg) and height above mean sea level (mm), the units of MAVLink."""
        return latitude * DEG_E7, longitude * DEG_E7, (height - self.undulation) * 1e3

    @property
    def in_outage(self) -> bool:
        """Whether the estimator is aided by fixes and there are none: its position is dead reckoning."""
        return self.simulation.estimator.aided and not self.has_lock

    @property
    def has_lock(self) -> bool:
        """Whether the receiver is on and its latest fix is younger than 2.5 fix intervals."""
        simulation = self.simulation
        fix, gnss = simulation.fix, simulation.plant.scenario.gnss
        if fix is None or not simulation.gnss_on or gnss is None:
            return False
        return simulation.time - fix.time < 2.5 * gnss.interval_s

    @property
    def imu_lost(self) -> bool:
        """Whether the latest `IMU_LOST` inertial samples were lost: the unit counts as failed."""
        return self.simulation.lost_in_a_row >= IMU_LOST

    # --- quality of the estimate --------------------------------------------------------------------

    @property
    def position_sigma(self) -> Vector | None:
        """Stated position sigmas (3, m, n), or None; of an alignment those of the initial position."""
        if not self.simulation.estimator.navigates:
            return np.asarray(self.simulation.plant.knowledge.position_sigma, dtype=np.float64)
        return self.estimate.get("position_sigma")

    @property
    def tilt_sigma_deg(self) -> float:
        """Larger of the stated attitude sigmas about north and east; NaN if none is stated."""
        sigma = self.estimate.get("attitude_sigma")
        return nan if sigma is None else degrees(max(float(sigma[0]), float(sigma[1])))

    @property
    def heading_sigma_deg(self) -> float:
        """The stated attitude sigma about down; NaN if none is stated."""
        sigma = self.estimate.get("attitude_sigma")
        return nan if sigma is None else degrees(float(sigma[2]))

    @property
    def aligned(self) -> bool:
        """Whether the stated sigmas of tilt and heading are below their limits, and nothing speaks against them (`doubt`).

        True if none are stated: such an estimator navigates from a known attitude.
        """
        if self.simulation.diverged:
            return False
        return self.states_alignment and ("attitude_sigma" not in self.estimate or not self.doubt)

    @property
    def states_alignment(self) -> bool:
        """Whether the stated sigmas of tilt and heading are below their limits, or none are stated, whatever the `doubt`."""
        if "attitude_sigma" not in self.estimate:
            return True
        return self.tilt_sigma_deg < TILT_LIMIT_DEG and self.heading_sigma_deg < HEADING_LIMIT_DEG

    @property
    def doubt(self) -> str:
        """Why the estimate may not be trusted whatever sigmas it states; empty if nothing speaks against it.

        A filter with fixes is also in doubt while its innovations are not as it states, and until fixes could contradict a
        reported heading: until the changes of velocity alone would give a heading that is off by the limit away.
        """
        notes = self.simulation.notes()
        if notes:
            return notes[0]
        health = self.simulation.health
        if health is None:
            return ""
        if health.verdict in WRONG:
            return f"filter {health.verdict}: its innovations are larger than stated"
        if health.contradicted:
            return "fixes contradict the estimate"
        limit = radians(HEADING_LIMIT_DEG)
        is_believed = self.simulation.reported_heading_sigma < SURE * limit
        if health.fixes < FIXES or (is_believed and SURE * health.heading_sigma > limit):
            return "heading as reported; no fix can contradict it before the vehicle accelerates or turns"
        return "" if health.well else "filter overconfident: its innovations were larger than stated seconds ago"

    @property
    def errors(self) -> dict[str, float]:
        """Errors of the estimate, against the truth: tilt, heading (deg); of a navigation velocity (m/s), position (m) too.

        tilt: of the vertical.  heading: signed.  velocity, position: lengths of the differences.
        """
        estimate, truth = self.estimate, self.truth
        rotation = np.ravel(attitude.numeric.error_rotation_vector(estimate["q_nb"], truth["q_nb"]))
        values = {"tilt": degrees(float(np.hypot(rotation[0], rotation[1]))), "heading": degrees(float(rotation[2]))}
        if self.simulation.estimator.navigates:
            values["velocity"] = float(np.linalg.norm(estimate["velocity_n"] - truth["velocity_n"]))
            places = [float(rows[name]) for rows in (estimate, truth) for name in ("latitude", "longitude", "height")]
            values["position"] = float(np.linalg.norm(np.ravel(geodesy.numeric.ned_offset(*places))))
        return values

    @property
    def state(self) -> str:
        """``"diverged"``, ``"aligning"``, ``"aligned"`` (an alignment) or ``"navigating"``."""
        if self.simulation.diverged:
            return "diverged"
        if not self.aligned:
            return "aligning"
        return "navigating" if self.simulation.estimator.navigates else "aligned"


def wrapped(longitude: float) -> float:
    """A longitude (rad) wrapped to -pi to pi."""
    return (longitude + pi) % (2 * pi) - pi
