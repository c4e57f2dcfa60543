"""`ahrs`: level from the accelerometers, heading from a compass where there is one (a complementary filter)."""

import casadi as ca

from insenv import Estimator, Model, Row, Step, Table, attitude, geodesy
from insenv.core.elementary import wrap_angle

LEVELLING, HEADING = 20.0, 10.0  # time constants, s


def sample(p, x, u):
    earth = attitude.from_small_rotation_vector(-geodesy.earth_rate_n(p.latitude) * u.dt)
    q = attitude.multiply(attitude.multiply(earth, x.q_nb), attitude.from_small_rotation_vector(u.delta_angle))
    force = attitude.rotate(q, u.delta_velocity) / (9.81 * u.dt)
    off = wrap_angle(u.compass_heading - attitude.to_euler(q)[2]) * u.compass_new * p.compass_interval / HEADING
    turn = ca.vertcat(-force[1] * u.dt / LEVELLING, force[0] * u.dt / LEVELLING, off)
    return {"q_nb": attitude.renormalize(attitude.multiply(attitude.from_small_rotation_vector(turn), q))}


ESTIMATOR = Estimator(
    Model(
        id="ahrs",
        title="complementary filter: level from accelerometers, heading from a compass",
        parameters=Table(
            (Row("latitude", "Latitude", "rad"), Row("compass_interval", "Time between compass readings", "s", start=0.1))
            + tuple(Row(f"start_{angle}", f"Initial {angle}", "rad") for angle in ("roll", "pitch", "heading"))
        ),
        state=Table((Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),)),
        inputs=Table(
            (
                Row("delta_angle", "Gyro increment", "rad", (3,), "b"),
                Row("delta_velocity", "Accelerometer increment", "m/s", (3,), "b"),
                Row("dt", "Length of the sample", "s", start=0.005),
                Row("compass_new", "1 with a compass reading"),
                Row("compass_heading", "Compass reading", "rad"),
            )
        ),
        outputs=Table((Row("q_nb", "Attitude: takes b components to n components", "1", (4,), "n", (1, 0, 0, 0)),)),
        steps={"sample": Step(sample)},
        output=lambda p, x: {"q_nb": x.q_nb},
        start=lambda p: {"q_nb": attitude.from_euler(p.start_roll, p.start_pitch, p.start_heading)},
    ),
    kind="alignment",
    motion="any",
)
