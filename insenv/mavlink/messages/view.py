"""The simulated vehicle as its messages see it: the simulation, and quantities derived from it on first use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import degrees, pi, radians
from typing import Any

import casadi as ca
import numpy as np

from insenv import attitude, geodesy
from insenv.core.elementary import wrap_angle
from insenv.core.tables import Row, Table, Vector
from insenv.evaluation.contradiction import FIXES
from insenv.evaluation.nis import WRONG
from insenv.geodesy import STANDARD_GRAVITY
from insenv.mavlink.messages.fields import DEG_E7, Fields, Message
from insenv.mavlink.simulation import Fix, Simulation
from insenv.mavlink.surroundings import AirData, Surroundings

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

_POSE = (
    ("q_nb", "1", (4,), (1.0, 0.0, 0.0, 0.0)),
    ("velocity_n", "m/s", (3,), 0.0),
    ("latitude", "rad", (), 0.0),
    ("longitude", "rad", (), 0.0),
    ("height", "m", (), 0.0),
)
INPUTS = Table((
    *(Row(name, f"True {name}", unit, shape, start=start) for name, unit, shape, start in _POSE),
    *(Row(f"estimated_{name}", f"Estimated {name}", unit, shape, start=start) for name, unit, shape, start in _POSE),
    Row("rate_ib_b", "True rate of b relative to i", "rad/s", (3,), "b"),
    Row("measured_rate_ib_b", "Measured rate of b relative to i, minus the estimated bias", "rad/s", (3,), "b"),
    Row("home", "Latitude and longitude (rad) and height (m) of home", "SI", (3,)),
    Row("position_sigma", "Stated by the estimator; NaN if it states none", "m", (3,), "n"),
    Row("velocity_sigma", "Stated by the estimator; NaN if it states none", "m/s", (3,), "n"),
    Row("attitude_sigma", "Stated by the estimator; NaN if it states none", "rad", (3,), "n"),
    Row("rate_sigma", "Sigma of the measured rate", "rad/s", (), "b"),
))  # fmt: skip
TRIANGLE = 21
OUTPUTS = Table((
    Row("euler", "Estimated roll, pitch and heading (-pi to pi)", "rad", (3,)),
    Row("rate_nb_b", "Estimated rate of b relative to n", "rad/s", (3,), "b"),
    Row("velocity_b", "Estimated velocity over the Earth", "m/s", (3,), "b"),
    Row("offset", "Estimated position relative to home, along the NED axes at home", "m", (3,)),
    Row("estimated_longitude_wrapped", "Estimated longitude, -pi to pi", "rad"),
    Row("true_rate_nb_b", "True rate of b relative to n", "rad/s", (3,), "b"),
    Row("true_longitude_wrapped", "True longitude, -pi to pi", "rad"),
    Row("true_offset", "True position relative to home, along the NED axes at home", "m", (3,)),
    Row("pose_covariance", "Upper triangle by rows: position in n (m), roll, pitch, heading (rad)", "SI", (TRIANGLE,)),
    Row("velocity_covariance", "Upper triangle by rows: velocity in b (m/s), rates (rad/s)", "SI", (TRIANGLE,)),
))  # fmt: skip


class Derived:
    """The quantities of `OUTPUTS`, computed on fixed arrays without conversion or allocation.

    inputs, outputs: by row name, views of the arrays that each `evaluate` reads and writes.
    """

    def __init__(self) -> None:
        self._u, self._y = INPUTS.start_vector(), np.zeros(OUTPUTS.size)
        self.inputs, self.outputs = INPUTS.unpack(self._u), OUTPUTS.unpack(self._y)
        buffer: Any  # CasADi's stub knows no memoryview of an array
        buffer, self.evaluate = _function().buffer()
        self._buffer = buffer  # must live as long as `evaluate`
        buffer.set_arg(0, self._u.data)
        buffer.set_res(0, self._y.data)

    evaluate: Callable[[], None]


@lru_cache(maxsize=1)
def _function() -> Any:
    flat = ca.SX.sym("u", INPUTS.size)
    u = INPUTS.symbols(flat)
    longitude = wrap_angle(u.estimated_longitude)
    place, true_place = (u.estimated_latitude, longitude, u.estimated_height), (u.latitude, u.longitude, u.height)
    home = u.home[0], u.home[1], u.home[2]
    roll, pitch, heading = attitude.to_euler(u.estimated_q_nb)
    values = {
        "euler": ca.vertcat(roll, pitch, heading),
        "rate_nb_b": u.measured_rate_ib_b - _rate_in_b(u.estimated_q_nb, u.estimated_velocity_n, place),
        "velocity_b": attitude.rotate_inverse(u.estimated_q_nb, u.estimated_velocity_n),
        "offset": geodesy.ned_offset(*place, *home),
        "estimated_longitude_wrapped": longitude,
        "true_rate_nb_b": u.rate_ib_b - _rate_in_b(u.q_nb, u.velocity_n, true_place),
        "true_longitude_wrapped": wrap_angle(u.longitude),
        "true_offset": geodesy.ned_offset(*true_place, *home),
        "pose_covariance": _pose_covariance(u, pitch, heading),
        "velocity_covariance": _velocity_covariance(u),
    }
    return ca.Function("derived", [flat], [ca.densify(OUTPUTS.assemble(values))], {"cse": True})


def _rate_in_b(q_nb: Any, velocity_n: Any, place: Sequence[Any]) -> Any:
    """omega_in^b: Earth rate plus transport rate, in b."""
    latitude, _, height = place
    rate_n = geodesy.earth_rate_n(latitude) + geodesy.transport_rate_n(velocity_n, latitude, height)
    return attitude.rotate_inverse(q_nb, rate_n)


def _pose_covariance(u: Any, pitch: Any, heading: Any) -> Any:
    s, c = ca.sin(heading), ca.cos(heading)
    across, tangent = 1.0 / ca.cos(pitch), ca.tan(pitch)
    moved = ca.vertcat(
        ca.horzcat(c * across, s * across, 0.0), ca.horzcat(-s, c, 0.0), ca.horzcat(c * tangent, s * tangent, 1.0)
    )
    angles = moved @ ca.diag(u.attitude_sigma**2) @ moved.T
    return _triangle(ca.diagcat(ca.diag(u.position_sigma**2), angles))


def _velocity_covariance(u: Any) -> Any:
    C_bn = attitude.to_dcm(u.estimated_q_nb).T
    velocity = C_bn @ ca.diag(u.velocity_sigma**2) @ C_bn.T
    return _triangle(ca.diagcat(velocity, ca.SX.eye(3) * u.rate_sigma**2))


def _triangle(matrix: Any) -> Any:
    full = ca.densify(matrix)
    return ca.vertcat(*[full[i, j] for i in range(6) for j in range(i, 6)])


def no_vector() -> Vector:
    """Three unknown numbers (NaN)."""
    return np.full(3, np.nan)


@dataclass(frozen=True)
class Mode:
    """What steers the vehicle.  number: MAVLink's custom mode.  automatic: whether it follows the script."""

    number: int
    name: str
    automatic: bool


SCRIPTED, MANUAL = Mode(0, "Scenario", True), Mode(1, "Manual control", False)


@dataclass(frozen=True)
class Thresholds:
    """Stated 1-sigma below which an estimate counts as good: tilt and heading (deg), velocity (m/s), position (m)."""

    tilt_deg: float = 1.0
    heading_deg: float = 5.0
    velocity: float = 1.0
    position: float = 20.0


SURE = 3.0
"""Number of standard deviations by which data must tell a wrong heading from the right one."""
MILLI_G, MM_S2 = 1e3 / STANDARD_GRAVITY, 1e3
"""Units of accelerations in HIL_STATE_QUATERNION per m/s^2: of MAVLink's definition, and as PX4 reads them."""


class View:
    """The state from which messages are made.

    start_unix: Unix time (s) at the start of the run.  undulation: height of the geoid above the ellipsoid (m), the
    same everywhere: height above mean sea level = ellipsoidal height - undulation.  system, component: the sender that
    messages state.  hil_acceleration: `MILLI_G` or `MM_S2`.  mode: the present one of `modes`.  metadata_crc: checksum of the
    file that COMPONENT_METADATA names.  home: the known initial latitude,
    longitude (rad) and height (m).  traits: of the vehicle.  load: share of one core that the process takes.
    """

    def __init__(self, simulation: Simulation, surroundings: Surroundings, start_unix: float) -> None:
        self.simulation = simulation
        self.surroundings = surroundings
        self.fields = Fields()
        self.thresholds = Thresholds()
        self.start_unix = start_unix
        self.undulation = 0.0
        self.system, self.component = 1, 1  # clients look for component 1
        self.hil_acceleration = MILLI_G
        self.mode = SCRIPTED
        self.metadata_crc = 0
        self.armed = True
        self.load = 0.0
        known = simulation.plant.knowledge
        self.home = known.latitude, wrapped(known.longitude), known.height
        self.traits = simulation.plant.scenario.vehicle.traits
        self.sent_increments: dict[str, tuple[int, Vector]] = {}
        self.sent_air: dict[str, tuple[int, int]] = {}
        self.sent_fix = self.sent_gps_at = 0
        self._derived = Derived()
        self._derived.inputs["home"][:] = self.home
        self._derived_at = -1
        self._air: AirData | None = None
        self._air_at = (-1, 0.0)
        self._rate_sigma = known.sensors.angle_random_walk / np.sqrt(simulation.interval)

    def forget(self) -> None:
        """Discard derived quantities: the estimate has changed between two samples."""
        self._derived_at = -1

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

    # --- truth, estimate, sensors -------------------------------------------------------------------

    @property
    def truth(self) -> dict[str, Any]:
        """The plant's outputs by row name."""
        return self.simulation.truth

    @property
    def estimate(self) -> dict[str, Any]:
        """The estimator's outputs by row name."""
        return self.simulation.estimate

    @property
    def values(self) -> dict[str, Any]:
        """`derived.OUTPUTS` at the present sample."""
        return self._evaluated().outputs

    def estimated(self, name: str) -> float:
        """Estimated latitude (rad) or height (m); of an alignment the known initial one."""
        return float(self._evaluated().inputs[f"estimated_{name}"])

    @property
    def estimated_velocity_n(self) -> Vector:
        """Estimated velocity (3, m/s, n); of an alignment zero."""
        return self._evaluated().inputs["estimated_velocity_n"]

    def _evaluated(self) -> Derived:
        if self._derived_at != self.simulation.samples:
            self._derived_at = self.simulation.samples
            self._fill()
            self._derived.evaluate()
        return self._derived

    def _fill(self) -> None:
        simulation, u = self.simulation, self._derived.inputs
        truth, estimate = simulation.truth, simulation.estimate
        for name in ("q_nb", "velocity_n", "latitude", "longitude", "height"):
            u[name][...] = truth[name]
        u["estimated_q_nb"][:] = estimate["q_nb"]
        u["estimated_velocity_n"][:] = estimate.get("velocity_n", 0.0)
        known = simulation.plant.knowledge
        for name in ("latitude", "longitude", "height"):
            u[f"estimated_{name}"][...] = estimate.get(name, getattr(known, name))
        dt = simulation.interval
        u["rate_ib_b"][:] = truth["true_delta_angle"] / dt
        u["measured_rate_ib_b"][:] = truth["delta_angle"] / dt - estimate.get("gyro_bias", 0.0)
        stated = self.position_sigma
        u["position_sigma"][:] = no_vector() if stated is None else stated
        u["velocity_sigma"][:] = estimate.get("velocity_sigma", no_vector())
        u["attitude_sigma"][:] = estimate.get("attitude_sigma", no_vector())
        u["rate_sigma"][...] = self._rate_sigma

    @property
    def air(self) -> AirData:
        """Magnetometer, barometer and air at the present sample."""
        if self._air is None or self._air_at != (self.simulation.samples, self.undulation):
            self._air_at = self.simulation.samples, self.undulation
            self._air = self.surroundings.data(self.truth, self.undulation, self.simulation.readings["barometer"])
        return self._air

    def place(self, latitude: float, longitude: float, height: float) -> tuple[float, float, float]:
        """Latitude and longitude (1e-7 deg) and height above mean sea level (mm), the units of MAVLink."""
        return latitude * DEG_E7, longitude * DEG_E7, (height - self.undulation) * 1e3

    @property
    def fix(self) -> Fix | None:
        """The latest fix received."""
        return self.simulation.fix

    @property
    def in_outage(self) -> bool:
        """Whether the estimator is aided by fixes and there are none: its position is dead reckoning."""
        return self.simulation.estimator.aided and not self.has_lock

    @property
    def has_lock(self) -> bool:
        """Whether the receiver is on and its latest fix is younger than 2.5 fix intervals."""
        fix, simulation = self.simulation.fix, self.simulation
        if fix is None or not simulation.gnss_on or simulation.plant.scenario.gnss is None:
            return False
        return simulation.time - fix.time < 2.5 * simulation.plant.scenario.gnss.interval_s

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
        return float("nan") if sigma is None else degrees(max(float(sigma[0]), float(sigma[1])))

    @property
    def heading_sigma_deg(self) -> float:
        """The stated attitude sigma about down; NaN if none is stated."""
        sigma = self.estimate.get("attitude_sigma")
        return float("nan") if sigma is None else degrees(float(sigma[2]))

    @property
    def aligned(self) -> bool:
        """Whether the stated sigmas of tilt and heading are below `thresholds`, and nothing speaks against them (`doubt`).

        True if none are stated: such an estimator navigates from a known attitude.
        """
        if self.simulation.diverged:
            return False
        if "attitude_sigma" not in self.estimate:
            return True
        small = self.tilt_sigma_deg < self.thresholds.tilt_deg and self.heading_sigma_deg < self.thresholds.heading_deg
        return small and not self.doubt

    @property
    def doubt(self) -> str:
        """Why the estimate may not be trusted whatever sigmas it states; empty if nothing speaks against it.

        A filter with fixes is also in doubt while its innovations are not as it states, and until fixes could contradict a
        reported heading: until the changes of velocity alone would give a heading that is off by the threshold away.
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
        threshold = radians(self.thresholds.heading_deg)
        is_believed = self.simulation.reported_heading_sigma < SURE * threshold
        if health.fixes < FIXES or (is_believed and SURE * health.heading_sigma > threshold):
            return "heading as reported; no fix can contradict it before the vehicle accelerates or turns"
        return "" if health.well else "filter overconfident: its innovations were larger than stated seconds ago"

    @property
    def errors(self) -> dict[str, float]:
        """Errors of the estimate, against the truth: tilt, heading (deg); of a navigation velocity (m/s), position (m) too.

        tilt: of the vertical.  heading: signed.  velocity, position: lengths of the differences.
        """
        estimate, truth = self.estimate, self.truth
        rotation = np.ravel(attitude.numeric.error_rotation_vector(estimate["q_nb"], truth["q_nb"]))
        found = {"tilt": degrees(float(np.hypot(rotation[0], rotation[1]))), "heading": degrees(float(rotation[2]))}
        if self.simulation.estimator.navigates:
            found["velocity"] = float(np.linalg.norm(estimate["velocity_n"] - truth["velocity_n"]))
            place = (tuple(float(each[name]) for name in ("latitude", "longitude", "height")) for each in (estimate, truth))
            estimated, true = place
            found["position"] = float(np.linalg.norm(np.ravel(geodesy.numeric.ned_offset(*estimated, *true))))
        return found

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


Maker = Callable[[View], Message | None]
"""Makes a message of the present sample, or None if it has no content yet."""


def by_name(*makers: Maker) -> dict[str, Maker]:
    """Makers by the name of their message, which is that of the function in capitals."""
    return {maker.__name__.upper(): maker for maker in makers}
