"""`compass-fusion`: GNSS, rest and a compass whose constant error is estimated."""

from math import radians

from insenv import Row, Table, fusion
from insenv.core.elementary import atan2, wrap_angle
from insenv.estimators.fusion import Aid, constant, gate_row, sigma_row

ERROR_SIGMA = sigma_row("compass_error_sigma", "Standard deviation of the compass's error", "rad", start=radians(2.0))
NOISE = sigma_row("compass_noise_sigma", "White noise of a reading", "rad", start=radians(0.5))
ERROR = constant("compass_error", "constant error of the compass", "rad", 1, ERROR_SIGMA)


def shown_minus_reading(p, seen, u):
    C_nb = seen.C_nw @ seen.C_wb
    heading = atan2(C_nb[1, 0], C_nb[0, 0])
    return wrap_angle(heading + seen.value("compass_error", 0.0) - u.compass_heading)


COMPASS = Aid(
    id="compass", title="the compass", size=1, what="heading", unit="rad", sensors=("compass",),
    residual=shown_minus_reading,
    variance=lambda p, x, u, spread: p.compass_noise_sigma**2,
    due=lambda p, x, u: u.compass_valid,
    inputs=Table((Row("compass_valid", "1 with a reading"), Row("compass_heading", "Compass reading", "rad"))),
    parameters=Table((NOISE, gate_row("compass"))),
    gate="compass_gate",
    causes="its deviation, and iron near it",
)  # fmt: skip
ESTIMATOR = fusion(states=[ERROR], aids=["gnss", "zero_velocity", COMPASS], id="compass-fusion")
