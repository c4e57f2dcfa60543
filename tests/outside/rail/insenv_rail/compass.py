"""A compass: heading with a constant deviation and white noise, at its own rate."""

from math import radians
from typing import ClassVar

from insenv import Row, Sensor, SensorSection, Step, Table, attitude
from insenv.base.toml import Number, key
from insenv.core.compose import Part
from insenv.core.elementary import normal_pair


def _count(p, x, u):
    counter = x.compass_counter + 1
    due = counter * p.sample_interval > p.compass_interval - 0.5 * p.sample_interval
    return {"compass_counter": counter * (1 - due), "compass_valid": due}


def _measure(p, x, u, r):
    noise = p.compass_noise * normal_pair(r[0], r[1])[0]
    return {"compass_heading": attitude.to_euler(x.q_nb)[2] + p.compass_deviation + noise}


COMPASS = Sensor(
    "compass",
    part=lambda instant: Part(
        parameters=Table(
            (
                Row("compass_interval", "Time between readings", "s", start=0.1, lower=1e-4),
                Row("compass_noise", "White noise of a reading", "rad", lower=0.0),
                Row("compass_deviation", "Constant error", "rad"),
            )
        ),
        state=Table(
            (
                Row("compass_valid", "1 with a reading"),
                Row("compass_heading", "Latest reading", "rad"),
                Row("compass_counter", "Samples since the latest reading"),
            )
        ),
        steps={"sample": Step(_count), "compass": Step(_measure, when="compass_valid", uniforms=2)},
    ),
    outputs=("compass_valid", "compass_heading"),
)


class CompassSection(SensorSection):
    """A compass."""

    sensor: ClassVar[Sensor] = COMPASS

    interval_s: Number = key(0.1, "time between readings", "s", gt=0, le=3600)
    noise_deg: Number = key(0.5, "white noise of a reading", "deg", ge=0, le=180)
    deviation_deg: Number = key(0.0, "constant error", "deg", ge=-180, le=180)

    def rows(self, rate_hz: float) -> dict:
        return {
            "compass_interval": self.interval_s,
            "compass_noise": radians(self.noise_deg),
            "compass_deviation": radians(self.deviation_deg),
        }
