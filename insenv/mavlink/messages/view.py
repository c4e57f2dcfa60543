"""What there is to tell at the present sample: the simulation, and what is derived from it when first asked for."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, pi
from typing import Any

import numpy as np

from insenv.core.tables import Vector
from insenv.mavlink.messages.derived import Derived, no_vector
from insenv.mavlink.messages.fields import Fields
from insenv.mavlink.simulation import Fix, Simulation
from insenv.mavlink.surroundings import Surroundings
from insenv.vehicles import traits_of


@dataclass(frozen=True)
class Thresholds:
    """From what stated 1-sigma on an estimate counts as good: tilt and heading (deg), velocity (m/s), position (m)."""

    tilt_deg: float = 1.0
    heading_deg: float = 5.0
    velocity: float = 1.0
    position: float = 20.0


class View:
    """The simulated vehicle as its messages see it.

    start_unix: Unix time (s) of the run's start.  undulation: height of the geoid over the ellipsoid (m), taken as the same
    everywhere: height over the sea = height over the ellipsoid - undulation.  Home is where the estimator was told the
    vehicle starts.
    """

    def __init__(self, simulation: Simulation, surroundings: Surroundings, start_unix: float) -> None:
        self.simulation = simulation
        self.surroundings = surroundings
        self.fields = Fields()
        self.thresholds = Thresholds()
        self.start_unix = start_unix
        self.undulation = 0.0
        self.armed = True
        self.load = 0.0
        known = simulation.plant.knowledge
        self.home = known.latitude, (known.longitude + pi) % (2 * pi) - pi, known.height
        self.traits = traits_of(simulation.plant.scenario.vehicle.kind)
        self.sent_increments: dict[str, tuple[int, Vector]] = {}
        self.sent_air: dict[str, tuple[int, int]] = {}
        self.sent_fix = 0
        self._derived = Derived()
        self._derived.inputs["home"][:] = self.home
        self._derived_at = -1
        self._air_at = -1
        self._rate_sigma = known.sensors.angle_random_walk / np.sqrt(simulation.interval)

    def forget(self) -> None:
        """What was derived holds no more: the estimate has been changed between two samples."""
        self._derived_at = -1

    # --- time ---------------------------------------------------------------------------------------

    @property
    def time_us(self) -> int:
        """The simulation clock in microseconds: "time since boot"."""
        return round(self.simulation.time * 1e6)

    @property
    def time_ms(self) -> int:
        """The simulation clock in milliseconds."""
        return round(self.simulation.time * 1e3)

    @property
    def unix_us(self) -> int:
        """Unix time of the simulation clock, microseconds."""
        return round(self.start_unix * 1e6) + self.time_us

    # --- what is told -------------------------------------------------------------------------------

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
        """Estimated latitude (rad) or height (m); of an alignment, which knows where it is, the one told."""
        return float(self._evaluated().inputs[f"estimated_{name}"])

    @property
    def estimated_velocity_n(self) -> Vector:
        """Estimated velocity (3, m/s, n); of an alignment in place: none."""
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
    def air(self) -> Surroundings:
        """Magnetometer and barometer, up to date."""
        if self._air_at != self.simulation.samples:
            self._air_at = self.simulation.samples
            height_msl = float(self.truth["height"]) - self.undulation
            self.surroundings.update(self.simulation.time, self.truth, height_msl)
        return self.surroundings

    @property
    def fix(self) -> Fix | None:
        """The latest fix delivered."""
        return self.simulation.fix

    @property
    def has_lock(self) -> bool:
        """Whether the receiver is on and its latest fix no older than two and a half intervals."""
        fix, simulation = self.simulation.fix, self.simulation
        if fix is None or not simulation.gnss_on or simulation.plant.scenario.gnss is None:
            return False
        return simulation.time - fix.time < 2.5 * simulation.plant.scenario.gnss.interval_s

    # --- how good it is -----------------------------------------------------------------------------

    @property
    def position_sigma(self) -> Vector | None:
        """Stated sigmas of the position (3, m, n), None if none are; of an alignment those of the position it was told."""
        if self.simulation.estimator.kind == "alignment":
            return np.asarray(self.simulation.plant.knowledge.position_sigma, dtype=np.float64)
        return self.estimate.get("position_sigma")

    @property
    def tilt_sigma_deg(self) -> float:
        """Larger one of the stated sigmas of the misalignment about north and east; NaN if none is stated."""
        sigma = self.estimate.get("attitude_sigma")
        return float("nan") if sigma is None else degrees(max(float(sigma[0]), float(sigma[1])))

    @property
    def heading_sigma_deg(self) -> float:
        """Stated sigma of the misalignment about down; NaN if none is stated."""
        sigma = self.estimate.get("attitude_sigma")
        return float("nan") if sigma is None else degrees(float(sigma[2]))

    @property
    def aligned(self) -> bool:
        """Whether tilt and heading are good by what the estimator states; one that states nothing navigates as it was told."""
        if self.simulation.diverged:
            return False
        if "attitude_sigma" not in self.estimate:
            return True
        return self.tilt_sigma_deg < self.thresholds.tilt_deg and self.heading_sigma_deg < self.thresholds.heading_deg

    @property
    def state(self) -> str:
        """In a word: diverged, aligning, aligned (an alignment), navigating."""
        if self.simulation.diverged:
            return "diverged"
        if not self.aligned:
            return "aligning"
        return "aligned" if self.simulation.estimator.kind == "alignment" else "navigating"
